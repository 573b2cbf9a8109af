"""Stage 4: find when two moving polygons are in contact, and how near they come.

The first is continuous collision detection (time of impact), the second the closest point of approach (CPA: its
distance DCPA, its time TCPA). Most methods stop at the first time of impact, and sample or linearise the motion. This
one finds all intervals of contact. Bounds on the motion over intervals of time certify every answer (the kernel's
`proofs`).
"""
