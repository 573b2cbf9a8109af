"""A polygon that moves along a track: the contract, and the planes in which its track is straight."""
