"""Map scenes to planes in which their tracks and edges are straight."""
