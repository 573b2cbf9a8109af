"""Stage 4: exactly when two moving polygons are in contact, and how near they come.

The field calls the first question continuous collision detection or time of impact, the second closest point of
approach (CPA: its distance DCPA, its time TCPA). Most methods for it stop at the first time of impact, and sample or
linearise the motion. Here all intervals of contact are found, and every answer is proved by bounds on the motion over
intervals of time (`proofs`).
"""
