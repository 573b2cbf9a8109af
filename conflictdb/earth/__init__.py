"""Distances and directions on the ellipsoid and the sphere."""
