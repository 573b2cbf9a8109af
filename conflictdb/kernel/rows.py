"""Concatenate and digest rows of bytes: the building blocks of binary formats."""

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conflictdb.kernel.header import structure
from conflictdb.kernel.library import address, check, library

Bytes = NDArray[np.uint8]
# One column of n rows: (n, width) bytes; or ragged: bytes, and offsets of rows (n + 1,).
Part = Bytes | tuple[Bytes, NDArray[np.int64]]


class _HeldPart(ctypes.Structure):
    """KernelPart."""

    _fields_ = structure("KernelPart")[0]


def interleaved(parts: Sequence[Part]) -> Bytes:
    """Return the bytes of n rows one after the other: each row concatenates its parts. At least one part."""
    held, kept, n, total = _held(parts)
    rows = np.empty(total, np.uint8)
    check(library().kernel_interleave(held, len(parts), n, address(rows), total))
    del kept
    return rows


def digests(parts: Sequence[Part], key: bytes) -> NDArray[np.uint64]:
    """Return SipHash-2-4 digests (n,) of rows as in `interleaved`, under a key of 16 bytes."""
    held, kept, n, _ = _held(parts)
    words, found = np.frombuffer(key, "<u8", 2).astype(np.uint64), np.empty(n, np.uint64)
    check(library().kernel_digests(held, len(parts), n, address(words), address(found)))
    del kept
    return found


def _held(parts: Sequence[Part]) -> tuple[ctypes.Array[_HeldPart], list[Any], int, int]:
    """Return C structs of parts, the arrays to keep alive, the number of rows, and the number of bytes."""
    held = (_HeldPart * len(parts))()
    kept: list[Any] = []
    n, total = 0, 0
    for one, part in zip(held, parts, strict=True):
        if isinstance(part, tuple):
            data, offset = np.ascontiguousarray(part[0]), np.ascontiguousarray(part[1], np.int64)
            n, total = len(offset) - 1, total + int(offset[-1] - offset[0])
            one.data, one.size, one.offset = address(data), data.size, address(offset)
            kept += [data, offset]
        else:
            data = np.ascontiguousarray(part)
            n, total = len(data), total + data.size
            one.data, one.size, one.width = address(data), data.size, data.shape[1]
            kept.append(data)
    return held, kept, n, total
