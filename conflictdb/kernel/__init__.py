"""The kernel in C: when two pieces touch, or come nearer than a distance, a pair at a time and with proofs.

`kernel.h` is the contract of the library; `library` loads it, `scene` and the parts beside it call it with arrays. A
`Scene` may be used by several threads, and a call lets other threads of Python run. What is answered for a pair depends
on that pair alone: not on its company, nor on how many threads there are.

`build.py` makes the library; ./run and the wheel's build do that by themselves. docs/explanation/kernel.md says more.
"""

from conflictdb.kernel.contacts import Guess, Questions, contacts
from conflictdb.kernel.convex import convex_parts
from conflictdb.kernel.scene import Plane, Scene, Work
from conflictdb.kernel.slices import Hulls, apart, hulls

__all__ = ["Guess", "Hulls", "Plane", "Questions", "Scene", "Work", "apart", "contacts", "convex_parts", "hulls"]
