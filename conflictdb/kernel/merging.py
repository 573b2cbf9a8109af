"""Contacts of pieces, merged into the periods of pairs of objects."""

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Contacts
from conflictdb.kernel.header import structure
from conflictdb.kernel.library import Held, check, library

_Ints = NDArray[np.int64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Merged:
    """Periods of g groups of m contacts (KernelMerged).

    contacts : those given; one that ends before it starts is unresolved during its whole shared time
    start_us, end_us : (m,) contacts as instants, rounded outward to the microsecond
    order, order_offset : (k,), (g + 1,) reported contacts, by group, start and end
    period_us, period_offset : (p, 2), (g + 1,)
    time_error_s : (g,)
    verdict : (g,) of reported contacts
    is_open, meets : (g,) whether a reported contact is unresolved, and whether any touches
    lacking_s, lacking_error_s : (g,) NaN if unknown
    """

    contacts: Contacts
    start_us: _Ints
    end_us: _Ints
    order: _Ints
    order_offset: _Ints
    period_us: _Ints
    period_offset: _Ints
    time_error_s: Floats
    verdict: NDArray[np.int8]
    is_open: _Flags
    meets: _Flags
    lacking_s: Floats
    lacking_error_s: Floats


def merged(
    contacts: Contacts,
    group: _Ints,
    groups: int,
    shared_us: tuple[_Ints, _Ints],
    lacking_s: tuple[Floats, Floats] | None = None,
) -> Merged:
    """Merge contacts (m,) of groups, each the pairs of pieces of two objects.

    group : (m,) from 0
    shared_us : start and end (m,) of the time that both pieces share
    lacking_s : seconds (m,) that are lacking, and their errors; None: no separation in time
    """
    m, held, to = len(contacts), _Touching(len(contacts), groups), _Merged()
    names = "start_s", "end_s", "error_s", "verdict", "touches"
    times: dict[str, Any] = {name: getattr(contacts, name).copy() for name in names}
    lacking = dict(zip(("lacking_s", "lacking_error_s"), lacking_s or (), strict=False))
    times["touches"] = times["touches"].view(np.uint8)
    held.hold(group=group, shared_start_us=shared_us[0], shared_end_us=shared_us[1], **times, **lacking)
    found: dict[str, Any] = {
        **{name: np.empty(m, np.int64) for name in ("start_us", "end_us", "order")},
        **{name: np.empty(groups + 1, np.int64) for name in ("order_offset", "period_offset")},
        "period_us": np.empty((m, 2), np.int64),
        "verdict": np.empty(groups, np.int8),
        **{name: np.empty(groups, np.uint8) for name in ("is_open", "meets")},
        **{name: np.full(groups, np.nan) for name in ("time_error_s", "lacking_s", "lacking_error_s")},
    }
    to.hold(**found)
    check(library().kernel_merge(ctypes.byref(held), ctypes.byref(to)))
    found["order"] = found["order"][: found["order_offset"][-1]]
    found["period_us"] = found["period_us"][: found["period_offset"][-1]]
    for some, name in ((times, "touches"), (found, "is_open"), (found, "meets")):
        some[name] = some[name].view(np.bool_)
    return Merged(Contacts(contacts.pair, **times), **found)


class _Touching(Held):
    """KernelTouching."""

    _fields_, types = structure("KernelTouching")


class _Merged(Held):
    """KernelMerged."""

    _fields_, types = structure("KernelMerged")
