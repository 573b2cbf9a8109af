"""Estimate the cost and the answers of each method from a sample."""
