"""Objects, pieces, pairs and answers as arrays: what the stages hand each other."""
