"""Distances and directions on the earth; planes in which rhumb lines or great circles are straight."""
