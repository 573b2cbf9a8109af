"""Objects cut into what the stages compare: convex parts of areas, slices of tracks."""
