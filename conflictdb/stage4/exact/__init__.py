"""The method `exact`: a certified solver."""
