"""The compiled library: found, loaded and checked once, its errors told, and arrays held for it.

`kernel.h` is its contract. Each part of it has a module here that calls it with arrays, over this one.
"""

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, ClassVar, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import KernelMissing
from conflictdb.kernel import build
from conflictdb.waiting import answer_of

# As kernel.h has them.
ABI: Final = 19
_STATUS: Final = {
    1: "no memory is left",
    2: "an array is missing",
    3: "a count is negative, or too large",
    4: "there is no such plane",
    5: "the offsets of vertices do not begin at 0, decrease, or do not end with the vertices",
    6: "the number of a pair's piece is none of the pieces', or that of its area none of the areas'",
    7: "a separation or tolerance is negative, or no number",
    8: "a range of pieces is not within them",
}
_POINTER, _NUMBER, _COUNT = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
# What each function of kernel.h takes; it returns a status, unless _RETURNS says otherwise.
TAKES: Final[dict[str, tuple[Any, ...]]] = {
    "kernel_abi": (),
    "kernel_fingerprint": (),
    "kernel_scene_make": (_POINTER,) * 3,
    "kernel_scene_free": (_POINTER,),
    "kernel_contacts": (_POINTER,) * 6,
    "kernel_contacts_free": (_POINTER,),
    "kernel_meetings": (_POINTER,) * 3,
    "kernel_distances": (_POINTER,) * 3,
    "kernel_approaches": (_POINTER,) * 10,
    "kernel_whole_depths": (_POINTER,) * 7,
    "kernel_states": (_POINTER, _POINTER),
    "kernel_positions": (_POINTER, _POINTER, _POINTER, _COUNT, _POINTER),
    "kernel_references": (_POINTER,) * 4,
    "kernel_bounds": (_POINTER,) * 5,
    "kernel_interleave": (_POINTER, _COUNT, _COUNT, _POINTER, _COUNT),
    "kernel_digests": (_POINTER, _COUNT, _COUNT, _POINTER, _POINTER),
    "kernel_hulls": (_POINTER, _POINTER, _COUNT, _COUNT, _NUMBER, *[_POINTER] * 4),
    "kernel_convex_parts": (_POINTER, _POINTER, _COUNT, *[_POINTER] * 3),
    "kernel_apart": (_POINTER, _COUNT, _POINTER, _COUNT, _POINTER, _POINTER, _COUNT, _POINTER),
    "kernel_bundles": (_POINTER,) * 3 + (_COUNT, _POINTER, _POINTER),
    "kernel_wkb_rings": (_POINTER, _COUNT, _POINTER, _COUNT, _POINTER, _COUNT, _POINTER, _COUNT),
    "kernel_bundled_pairs": (*[_POINTER] * 3, _COUNT, _POINTER, _POINTER, _COUNT, _POINTER),
    "kernel_box_order": (_POINTER, _POINTER),
    "kernel_box_pairs": (_POINTER, _POINTER, _COUNT, _POINTER, _POINTER, _COUNT, *[_POINTER] * 3),
    "kernel_regions": (_POINTER, _POINTER, _NUMBER, *[_POINTER] * 3),
    "kernel_joined": (_POINTER, _COUNT, _POINTER, _POINTER, _COUNT, *[_POINTER] * 4),
}
_RETURNS: Final[dict[str, Any]] = {
    "kernel_fingerprint": ctypes.c_char_p,
    **dict.fromkeys(("kernel_scene_free", "kernel_contacts_free"), None),
}
# Rows that a thread takes at once: milliseconds of work.
SHARE: Final = 2048
# The smallest part of that which several threads share at the end of a call: half a millisecond of work, ten times what
# a call of the library takes around it.
LEAST_PART: Final = 8
# A pair of so many more vertices counts as one more row.
FEW_VERTICES: Final = 64

_T = TypeVar("_T")


@cache
def library() -> Any:
    """Return the library, which is of these sources and of this interface."""
    path = build.library()
    try:
        loaded = ctypes.CDLL(str(path))
    except OSError as error:
        raise KernelMissing(f"the kernel cannot be loaded ({error})") from error
    loaded.kernel_fingerprint.restype = ctypes.c_char_p
    if loaded.kernel_abi() != ABI or loaded.kernel_fingerprint().decode() != build.fingerprint():
        raise KernelMissing(f"the kernel is not that of the sources beside it: {path}")
    for name, types in TAKES.items():
        function = getattr(loaded, name)
        function.argtypes, function.restype = types, _RETURNS.get(name, ctypes.c_int)
    return loaded


def check(status: int) -> None:
    """Raise what a KernelStatus says: MemoryError, or ValueError for arrays that are refused."""
    if status == 1:
        raise MemoryError(f"kernel: {_STATUS[status]}")
    if status:
        raise ValueError(f"kernel: {_STATUS.get(status, status)}")


def fields_of(types: dict[str, Any], *counts: str) -> tuple[tuple[str, Any], ...]:
    """Return the fields of a struct of counts and then of pointers to arrays, as `Held` has them."""
    return (*((name, _COUNT) for name in counts), *((name, _POINTER) for name in types))


class Held(ctypes.Structure):
    """Counts and pointers to arrays, which it keeps alive.

    types : what each array is of, in the order of its fields
    """

    types: ClassVar[dict[str, Any]] = {}

    def hold(self, **arrays: Any) -> None:
        """Point to arrays by name, copies where they are of another type or not contiguous; others stay NULL."""
        self._arrays = []
        for name, values in arrays.items():
            array = np.ascontiguousarray(values, self.types[name])
            self._arrays.append(array)
            setattr(self, name, array.ctypes.data)


def shared(
    solve: Callable[[slice], _T], n: int, threads: int, share: int = SHARE, vertices: NDArray[np.int64] | None = None
) -> list[_T]:
    """Return what `solve` answers to slices of n rows, in their order; threads take them as they get to them.

    share : rows that a thread takes at once, at most
    vertices : (n,) of each row's pieces: fewer rows are taken of large ones, so that a call lasts milliseconds
    """
    weight = np.ones(n, np.int64) if vertices is None else 1 + vertices // FEW_VERTICES
    slices = _slices(np.cumsum(weight), threads, share)
    if threads <= 1 or len(slices) <= 1:
        return [solve(rows) for rows in slices]
    # What is next is given to one thread alone: no other runs between the two ends of such a step.
    left, done = iter(range(len(slices))), dict[int, _T]()

    def work() -> None:
        try:
            while (number := next(left, None)) is not None:
                done[number] = solve(slices[number])
        except BaseException:
            for _ in left:
                pass
            raise

    # The thread that asks waits: where it works, too, a busy machine may keep the others on its processor.
    with ThreadPoolExecutor(threads) as pool:
        for worker in [pool.submit(work) for _ in range(min(threads, len(slices)))]:
            answer_of(worker)
    return [done[number] for number in range(len(slices))]


def _slices(done: NDArray[np.int64], threads: int, share: int) -> list[slice]:
    """Return slices of rows, whose weights add up to done (n,).

    Of several threads each slice takes a part of what is left, down to a small one, so that all end at about the same
    time and few calls are made (guided self-scheduling: C. D. Polychronopoulos, D. J. Kuck, IEEE Trans. Comput. C-36
    (1987), doi:10.1109/TC.1987.5009495).
    """
    slices, first, taken = [], 0, 0
    while first < len(done):
        part = share
        if threads > 1:
            part = max(share // LEAST_PART, min(share, (int(done[-1]) - taken) // (2 * threads)))
        end = max(int(np.searchsorted(done, taken + part, side="right")), first + 1)
        slices.append(slice(first, end))
        first, taken = end, int(done[end - 1])
    return slices
