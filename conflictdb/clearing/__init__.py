"""Clear a scene: choose new departures and speeds of tracks, prove how good they are, and verify them."""
