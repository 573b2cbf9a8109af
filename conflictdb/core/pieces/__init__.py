"""Cut objects into the pieces that the stages compare: convex parts of areas, slices of tracks."""
