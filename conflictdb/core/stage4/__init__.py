"""Stage 4: find when two moving polygons are in contact, and how near they come.

The first is continuous collision detection (time of impact), the second the closest point of approach (CPA: its
distance DCPA, its time TCPA). The search finds all intervals of contact. Bounds on the motion over intervals of time
certify every answer (the kernel's `proofs`).
"""
