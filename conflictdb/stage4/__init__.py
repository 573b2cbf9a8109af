"""Stage 4: exactly when two moving polygons are in contact, and how near they come."""
