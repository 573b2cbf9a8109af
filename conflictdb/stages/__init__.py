"""Stages 3 and 4 run on pairs of pieces, and merged to one row per pair of objects."""
