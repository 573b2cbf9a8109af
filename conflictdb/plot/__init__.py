"""Figures of scenes and conflicts, drawn by matplotlib (extra `plot`), and reports of them."""
