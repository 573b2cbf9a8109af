"""Represent objects, pieces, pairs and answers as arrays, which the stages exchange."""
