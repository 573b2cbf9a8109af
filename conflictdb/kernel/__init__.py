"""Python binding of the kernel, a C library that finds and proves contacts of moving polygons.

`kernel.h` is the contract of the library. `library` loads it; `kernel_scene` and the other modules call it with arrays.
Threads may share a `KernelScene`, and calls release the GIL. The answer for a pair does not depend on the other pairs
of the call (`Questions.pairs_of_objects` divides work budgets), nor on the number of threads.

See docs/explanation/kernel.md.
"""

from conflictdb.kernel.contacts import Guess, Questions, contacts
from conflictdb.kernel.convex import convex_parts
from conflictdb.kernel.kernel_scene import KernelPlane, KernelScene, Work
from conflictdb.kernel.slices import Hulls, apart, hulls

__all__ = [
    "Guess",
    "Hulls",
    "KernelPlane",
    "KernelScene",
    "Questions",
    "Work",
    "apart",
    "contacts",
    "convex_parts",
    "hulls",
]
