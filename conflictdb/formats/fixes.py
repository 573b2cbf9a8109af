"""Build tracks from observed fixes; unusable fixes are left out and noted."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth import geodesy
from conflictdb.formats.contents import FileRefusals, Skipped
from conflictdb.formats.hints import given_haven
from conflictdb.model.inputs import all_certain
from conflictdb.model.plans import EarthModel, Track, rectangle_outline_m
from conflictdb.model.speed_limits import MPS_PER_KNOT

SIDES: Final = ("fore_m", "aft_m", "port_m", "starboard_m")
LENGTH_WIDTH: Final = ("length_m", "width_m")
# Limit of the search for a predecessor, in fixes and in runs; bounds the work on unusable data.
_LOOK_BACK: Final = 100


@dataclass(slots=True)
class Fixes:
    """Rows of one object: line numbers, instants, positions, and the other cells by column.

    unbounded : columns of heights that a row with a position leaves empty
    ruled : class and owner
    """

    lines: list[int] = field(default_factory=list)
    times_us: list[int] = field(default_factory=list)
    positions_deg: list[tuple[float, float]] = field(default_factory=list)
    largest: dict[str, float] = field(default_factory=dict)
    lowest: dict[str, float] = field(default_factory=dict)
    constant: dict[str, str | None] = field(default_factory=dict)
    unbounded: set[str] = field(default_factory=set)
    ruled: dict[str, str] = field(default_factory=dict)


def tracks_of(
    source: str,
    objects: Iterable[tuple[str, Fixes]],
    size_columns: Sequence[str],
    max_speed_kn: float,
    left_out: dict[tuple[str, str], list[int]],
) -> tuple[list[Track], list[Skipped]]:
    """Return the tracks of the usable fixes of each object, and what is left out; raises InvalidInput with all errors.

    size_columns : SIDES, LENGTH_WIDTH, both, or none for points
    max_speed_kn : fixes reachable only above this speed are left out, as few as possible
    left_out : line numbers by key and reason
    """
    refusals = FileRefusals()
    tracks = []
    for key, rows in objects:
        with refusals:
            track = _track_of(key, rows, size_columns, max_speed_kn, left_out)
            if track is not None:
                tracks.append(track)
    refusals.raise_found()
    kept = {track.key for track in tracks}
    return tracks, [
        Skipped(source, key, reason, tuple(sorted(lines)), is_whole=key not in kept)
        for (key, reason), lines in left_out.items()
    ]


def _track_of(
    key: str, rows: Fixes, size_columns: Sequence[str], max_speed_kn: float, left_out: dict[tuple[str, str], list[int]]
) -> Track | None:
    """Return the track of one object's usable fixes, None if they make no track; note omissions."""
    if not rows.lines:
        return None  # the reasons are noted already
    outline_m = _outline(rows.largest, size_columns)
    if outline_m is None:
        missing = [column for column in size_columns if column not in rows.largest]
        left_out[key, f"no {' and '.join(missing)}"].extend(rows.lines)
        return None
    order = np.argsort(np.array(rows.times_us, dtype=np.int64), kind="stable")
    times_us = np.array(rows.times_us, dtype=np.int64)[order]
    positions = np.array(rows.positions_deg, dtype=np.float64).reshape(-1, 2)[order]
    lines = np.array(rows.lines, dtype=np.int64)[order]

    def keep(chosen: NDArray[np.bool_]) -> None:
        nonlocal times_us, positions, lines
        times_us, positions, lines = times_us[chosen], positions[chosen], lines[chosen]

    again = np.concatenate([[False], times_us[1:] == times_us[:-1]])[: len(times_us)]
    if again.any():
        first = np.maximum.accumulate(np.where(again, 0, np.arange(len(again))))
        elsewhere = np.any(positions != positions[first], axis=1)
        for chosen, reason in (
            (again & ~elsewhere, "the same fix as an earlier row"),
            (again & elsewhere, "at another place at the same time as an earlier row"),
        ):
            if chosen.any():
                left_out[key, reason].extend(lines[chosen].tolist())
        keep(~again)
    reached = _reachable(times_us, positions, max_speed_kn * MPS_PER_KNOT)
    if not reached.all():
        reason = f"not reached from the fixes around it at {max_speed_kn:g} kn"
        left_out[key, reason].extend(lines[~reached].tolist())
        keep(reached)
    if len(times_us) < 2:
        left_out[key, "a single fix: no movement to follow"].extend(lines.tolist())
        return None
    return Track(
        key,
        positions,
        all_certain(times_us),
        outline_m,
        name=rows.constant.get("name"),
        floor_m=None if "floor_m" in rows.unbounded else rows.lowest.get("floor_m"),
        ceiling_m=None if "ceiling_m" in rows.unbounded else rows.largest.get("ceiling_m"),
        properties={name: v for name, v in rows.constant.items() if v is not None and name != "name"},
        object_class=rows.ruled.get("class"),
        owner=rows.ruled.get("owner"),
        max_speed_kn=np.inf,  # unreachable fixes are left out above
    )


def without_size(left_out: Iterable[tuple[str, str]]) -> list[str]:
    """Return the keys of the objects that are left out because they have no size, of keys and reasons."""
    columns = {*SIDES, *LENGTH_WIDTH}
    return [key for key, reason in left_out if columns.issuperset(reason.removeprefix("no ").split(" and "))]


def _outline(size: dict[str, float], size_columns: Sequence[str]) -> NDArray[np.float64] | None:
    """Return the outline of an object, a point without size columns; None if it has no size."""
    default = given_haven()
    if not size_columns:
        return rectangle_outline_m(*(default or (0.0,) * 4))
    reach = []
    for i, side in enumerate(SIDES):
        whole, opposite = LENGTH_WIDTH[i // 2], SIDES[i ^ 1]
        if side in size:
            reach.append(size[side])
        elif whole in size:
            reach.append(max(size[whole] - size[opposite], 0.0) if opposite in size else 0.5 * size[whole])
        elif default is not None:
            reach.append(float(default[i]))
        else:
            return None
    return rectangle_outline_m(*reach)


def _reachable(times_us: NDArray[np.int64], positions_deg: NDArray[np.float64], limit_mps: float) -> NDArray[np.bool_]:
    """Return the largest set of fixes (n,) in which no step exceeds the speed limit.

    It is the longest chain of fixes. A wrong first fix is left out, not all fixes after it; of a jump only the fixes
    too close to it in time are left out. Chains may skip up to _LOOK_BACK fixes, or continue from the end of any of the
    last _LOOK_BACK runs of good fixes.
    """
    n = len(times_us)
    if n < 2:
        return np.ones(n, dtype=np.bool_)
    earth = geodesy.earth_of(EarthModel.WGS84)

    def is_fast(i: NDArray[np.int64], j: NDArray[np.int64] | int) -> NDArray[np.bool_]:
        length_m = geodesy.rhumb_distance(earth, *positions_deg[i].T, *positions_deg[j].T)
        return length_m > limit_mps * (times_us[j] - times_us[i]) * 1e-6

    starts = np.flatnonzero(is_fast(np.arange(n - 1), np.arange(1, n))) + 1  # of the second and later runs
    if not starts.size:
        return np.ones(n, dtype=np.bool_)
    best = np.ones(n, dtype=np.int64)  # length of the longest chain that ends here
    before = np.arange(-1, n - 1)
    runs_before = np.searchsorted(starts, np.arange(n), side="right")
    for i in range(1, n):
        run = int(runs_before[i])
        if run == 0 or i - starts[run - 1] > _LOOK_BACK:
            best[i] = best[i - 1] + 1  # far from any jump
            continue
        ends = starts[max(0, run - _LOOK_BACK) : run] - 1
        earlier = np.unique(np.concatenate([ends, np.arange(max(0, i - _LOOK_BACK), i)]))
        gain = np.where(is_fast(earlier, i), 0, best[earlier])
        k = int(len(gain) - 1 - np.argmax(gain[::-1]))  # of equal chains, the one that ends latest
        best[i] = gain[k] + 1
        before[i] = earlier[k] if gain[k] else -1
    kept = np.zeros(n, dtype=np.bool_)
    i = int(np.argmax(best))
    while i >= 0:
        kept[i] = True
        i = int(before[i])
    return kept
