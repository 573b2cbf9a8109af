"""The ellipsoid and the sphere: distances and directions on them."""
