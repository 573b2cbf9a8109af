"""Load and check the compiled library once, raise its errors, and pass arrays and slices of work to it."""

import ctypes
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, ClassVar, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import KernelMissing
from conflictdb.kernel import build
from conflictdb.kernel.header import constant, functions
from conflictdb.kernel.waiting import ThreadWork

_STATUS: Final = {
    1: "out of memory",
    2: "a required array is missing",
    3: "a count is negative or too large, or a result does not fit",
    4: "the plane is unknown, or its earth is not finite and positive",
    5: "offsets do not begin at 0, decrease, or do not end at the number of items",
    6: "an index of a piece, area, bundle, hull or row is out of range",
    7: "a separation or tolerance is negative, NaN or infinite",
    8: "a range of pieces is out of range",
}
# Rows per slice of a thread: milliseconds of work.
SHARE: Final = 2048
# With several threads, slices at the end of a call shrink to this fraction of SHARE. That is half a millisecond of
# work, ten times the overhead of a call of the library.
LEAST_PART: Final = 8
# Each further 64 vertices of a pair count as one more row.
FEW_VERTICES: Final = 64

_T = TypeVar("_T")
_addressof, _byte_of = ctypes.addressof, ctypes.c_char.from_buffer


@cache
def library() -> Any:
    """Load the library. Raises KernelMissing unless it was built from these sources, with this interface."""
    path = build.library()
    try:
        loaded = ctypes.CDLL(str(path))
    except OSError as error:
        raise KernelMissing(f"the kernel cannot be loaded ({error})") from error
    loaded.kernel_fingerprint.restype = ctypes.c_char_p
    if loaded.kernel_abi() != constant("KERNEL_ABI") or loaded.kernel_fingerprint().decode() != build.fingerprint():
        raise KernelMissing(f"the kernel is not that of the sources beside it: {path}")
    for name, (result, takes) in functions().items():
        function = getattr(loaded, name)
        function.argtypes, function.restype = takes, result
    return loaded


def check(status: int) -> None:
    """Raise MemoryError or ValueError for a KernelStatus other than KERNEL_OK."""
    if status == 1:
        raise MemoryError(f"kernel: {_STATUS[status]}")
    if status:
        raise ValueError(f"kernel: {_STATUS.get(status, status)}")


class Held(ctypes.Structure):
    """A C struct of counts and pointers to arrays, which it keeps alive.

    types : element type of each array (`header.structure`)
    """

    types: ClassVar[dict[str, Any]]

    def hold(self, **arrays: Any) -> None:
        """Set pointers to arrays by name, copied if of another type or not contiguous; None and others stay NULL."""
        self.hold_each(arrays.items())

    def hold_each(self, arrays: Iterable[tuple[str, Any]]) -> None:
        """Set pointers as `hold` does, to names and arrays."""
        types = self.types
        self._arrays = [(name, np.ascontiguousarray(one, types[name])) for name, one in arrays if one is not None]
        for name, array in self._arrays:
            setattr(self, name, address(array))


def address(array: NDArray[Any]) -> int:
    """Return the address of the items of a contiguous array: as `array.ctypes.data`, in a quarter of the time."""
    try:
        return _addressof(_byte_of(array))  # type: ignore[arg-type]  # numpy declares no buffer
    except (TypeError, ValueError):  # read-only, or empty
        return int(array.ctypes.data)


def taken(found: ctypes.c_void_p, count: ctypes.c_int64, record: np.dtype[Any]) -> NDArray[Any]:
    """Return a list that a call allocated, and free it."""
    try:
        size = count.value * record.itemsize
        return np.frombuffer(ctypes.string_at(found, size) if size else b"", record).copy()
    finally:
        library().kernel_free(found)


def shared(
    solve: Callable[[slice], _T], n: int, threads: int, share: int = SHARE, vertices: NDArray[np.int64] | None = None
) -> list[_T]:
    """Call `solve` for slices of n rows, by several threads, and return the results in order of rows.

    share : most rows of a slice
    vertices : (n,) vertices of the row's pieces: slices of large pieces have fewer rows; a call lasts milliseconds
    """
    slices = _slices(n, threads, share, vertices)
    if threads <= 1 or len(slices) <= 1:
        return [solve(rows) for rows in slices]
    return _by_threads(solve, slices, threads)


def _by_threads(solve: Callable[[slice], _T], slices: list[slice], threads: int) -> list[_T]:
    """Return the results of slices, by several threads, in order."""
    # `next` of this iterator is atomic under the GIL: each slice goes to one thread.
    left, done = iter(range(len(slices))), dict[int, _T]()

    def skip() -> None:
        for _ in left:
            pass

    def work() -> None:
        try:
            while (number := next(left, None)) is not None:
                done[number] = solve(slices[number])
        except BaseException:
            skip()
            raise

    # The calling thread only waits: if it worked too, a busy machine might keep the others on its processor.
    workers: list[ThreadWork[None]] = []
    try:
        for _ in range(min(threads, len(slices))):
            workers.append(ThreadWork(work))
        for worker in workers:
            worker.result()
    finally:
        skip()
        for worker in workers:
            worker.wait()
    return [done[number] for number in range(len(slices))]


def _slices(n: int, threads: int, share: int, vertices: NDArray[np.int64] | None) -> list[slice]:
    """Return slices of n rows, as of `shared`.

    With several threads each slice takes a fraction of the remaining weight, down to a minimum, so that all threads end
    at about the same time after few calls (guided self-scheduling: C. D. Polychronopoulos, D. J. Kuck, IEEE Trans.
    Comput. C-36 (1987), doi:10.1109/TC.1987.5009495).
    """
    if threads <= 1 and n <= share and (vertices is None or n * (1 + vertices.max(initial=0) // FEW_VERTICES) <= share):
        return [slice(0, n)] if n else []
    done = np.cumsum(np.ones(n, np.int64) if vertices is None else 1 + vertices // FEW_VERTICES)
    slices, first, taken = [], 0, 0
    while first < len(done):
        part = share
        if threads > 1:
            part = max(share // LEAST_PART, min(share, (int(done[-1]) - taken) // (2 * threads)))
        end = max(int(np.searchsorted(done, taken + part, side="right")), first + 1)
        slices.append(slice(first, end))
        first, taken = end, int(done[end - 1])
    return slices
