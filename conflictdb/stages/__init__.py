"""The stages of a detection, in the order of `run`.

Objects are cut into pieces, pairs of pieces pass stages 1 to 4, and `merge` makes rows of pairs of objects. Stage 3 is
the closed form of the kernel; `published` has that of the paper.
"""
