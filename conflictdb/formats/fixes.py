"""Build tracks from observed fixes; unusable fixes are left out and noted."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count, pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth import geodesy
from conflictdb.formats.contents import FileRefusals, Skipped
from conflictdb.formats.hints import given_haven, max_gap_s
from conflictdb.model.inputs import all_certain
from conflictdb.model.plan_columns import TRACK, Form, columns_of
from conflictdb.model.plans import EarthModel, Track, rectangle_outline_m
from conflictdb.model.speed_limits import MPS_PER_KNOT

SIDES: Final = ("fore_m", "aft_m", "port_m", "starboard_m")
LENGTH_WIDTH: Final = ("length_m", "width_m")
# Fixes of a track, at least.
_LEAST_FIXES: Final = 2
# Two ships of one identity: how often their fixes alternate at least, how many of the others one ship explains, and how
# many ships are separated.
_LEAST_RUNS: Final = 3
_NEARLY_ALL: Final = 0.8
_MOST_SHIPS: Final = 4
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


def rows_of(fixes: Mapping[str, Fixes]) -> tuple[list[str], NDArray[np.int64], NDArray[np.float64]]:
    """Return the keys, the instants (n,), microseconds, and the places (n, 2), degrees, of all fixes."""
    every = fixes.values()
    keys = [key for key, own in fixes.items() for _ in own.times_us]
    at_us = np.array([at for own in every for at in own.times_us], np.int64)
    return keys, at_us, np.array([place for own in every for place in own.positions_deg], np.float64).reshape(-1, 2)


def tracks_of(
    source: str,
    objects: Iterable[tuple[str, Fixes]],
    size_columns: Sequence[str],
    max_speed_kn: float,
    left_out: dict[tuple[str, str], list[int]],
) -> tuple[list[Track], list[Skipped], list[str]]:
    """Return the tracks of the usable fixes of each object, what is left out, and remarks.

    Ships of one identity, and the fixes before and after a long gap, are tracks of their own. Raises InvalidInput with
    all errors.

    size_columns : SIDES, LENGTH_WIDTH, both, or none for points
    max_speed_kn : fixes reachable only above this speed are left out, as few as possible
    left_out : line numbers by key and reason
    """
    refusals = FileRefusals()
    tracks: list[Track] = []
    others: list[str] = []
    gaps: list[tuple[float, str]] = []
    given = list(objects)
    keys = {key for key, _ in given}
    for key, rows in given:
        with refusals:
            courses = list(_ships_of(key, rows, size_columns, max_speed_kn, left_out))
            parts = [(ship, part) for ship, course in enumerate(courses) for part in _parts(key, course, left_out)]
            for number, (ship, part) in enumerate(parts, 1):
                name = key if number == 1 else next(one for one in _numbered(key, number) if one not in keys)
                keys.add(name)
                if ship and ship > parts[number - 2][0]:
                    others.append(name)
                tracks.append(_track_of(name, rows, part, size_columns))
            gaps += [(course.longest_gap_s(), key) for course in courses if course.longest_gap_s() > max_gap_s()]
    refusals.raise_found()
    kept = {track.key for track in tracks}
    texts = []
    if others:
        of = f"{len(others):,} more ships than ids: fixes of one id alternate between places"
        texts.append(f"{of} that one ship cannot reach, so there are two ships; the other is {others[0]!r:.60}")
    if gaps:
        longest_s, key = max(gaps)
        of = f"{len(gaps):,} objects have gaps of more than {max_gap_s() / 3600.0:g} hours between their times"
        why = f"the longest, of {lasts(longest_s)}, is that of {key!r:.60}"
        texts.append(f"{of}, where their tracks are split; {why}: --max-gap takes another limit")
    skipped = [
        Skipped(source, key, reason, tuple(sorted(lines)), is_whole=key not in kept)
        for (key, reason), lines in left_out.items()
    ]
    return tracks, skipped, texts


def lasts(seconds: float) -> str:
    """Return a duration in hours, days or years."""
    days = seconds / 86_400.0
    if days < 3.0:
        return f"{24.0 * days:.0f} hours"
    return f"{days:.0f} days" if days < 1000.0 else f"{days / 365.25:.0f} years"


def _parts(key: str, course: "_Course", left_out: dict[tuple[str, str], list[int]]) -> Iterator["_Course"]:
    """Yield the parts of a course between long gaps; single fixes among these are noted and left out."""
    after = np.flatnonzero(np.diff(course.times_us) > max_gap_s() * 1e6) + 1
    bounds = [0, *after.tolist(), len(course)]
    for first, last in pairwise(bounds):
        if last - first >= _LEAST_FIXES:
            chosen = np.zeros(len(course), np.bool_)
            chosen[first:last] = True
            yield course.of(chosen)
        else:
            reason = "a single fix, with a gap of more than the limit to the others"
            left_out[key, reason].extend(course.lines[first:last].tolist())


def _numbered(key: str, number: int) -> Iterator[str]:
    yield from (f"{key}/{one}" for one in count(number))


@dataclass(frozen=True, slots=True)
class _Course:
    """Fixes in the order of time: line numbers (n,), instants (n,) and positions (n, 2)."""

    lines: NDArray[np.int64]
    times_us: NDArray[np.int64]
    positions_deg: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.lines)

    def longest_gap_s(self) -> float:
        """Return the longest time between two fixes, seconds."""
        return float(np.diff(self.times_us).max(initial=0)) / 1e6

    def of(self, chosen: NDArray[np.bool_]) -> "_Course":
        """Return some of the fixes."""
        return _Course(self.lines[chosen], self.times_us[chosen], self.positions_deg[chosen])

    def at_taken_times(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which fixes (n,) have the time of an earlier one, and which of these are at another place."""
        again = np.concatenate([[False], self.times_us[1:] == self.times_us[:-1]])[: len(self)]
        first = np.maximum.accumulate(np.where(again, 0, np.arange(len(again))))
        return again, again & np.any(self.positions_deg != self.positions_deg[first], axis=1)

    def of_one_ship(self, limit_mps: float) -> NDArray[np.bool_]:
        """Return the fixes (n,) of one ship, as many as possible: one at a time, each reached from the one before."""
        once = ~self.at_taken_times()[0]
        found = np.zeros(len(self), np.bool_)
        found[once] = _reachable(self.times_us[once], self.positions_deg[once], limit_mps)
        return found


def reached(times_us: NDArray[np.int64], positions_deg: NDArray[np.float64], max_speed_kn: float) -> NDArray[np.bool_]:
    """Return the fixes (n,) in the order of time that one ship reaches one after another, as many as possible."""
    course = _Course(np.arange(len(times_us)), times_us, positions_deg)
    return course.of_one_ship(max_speed_kn * MPS_PER_KNOT)


def _ships_of(
    key: str, rows: Fixes, size_columns: Sequence[str], max_speed_kn: float, left_out: dict[tuple[str, str], list[int]]
) -> Iterator[_Course]:
    """Yield the usable fixes of one object, and those of other ships of the same identity; note omissions."""
    if not rows.lines:
        return  # the reasons are noted already
    if _outline(rows.largest, size_columns) is None:
        missing = [column for column in size_columns if column not in rows.largest]
        left_out[key, f"no {' and '.join(missing)}"].extend(rows.lines)
        return
    order = np.argsort(np.array(rows.times_us, dtype=np.int64), kind="stable")
    course = _Course(
        np.array(rows.lines, dtype=np.int64)[order],
        np.array(rows.times_us, dtype=np.int64)[order],
        np.array(rows.positions_deg, dtype=np.float64).reshape(-1, 2)[order],
    )
    again, elsewhere = course.at_taken_times()
    same = again & ~elsewhere
    if same.any():
        left_out[key, "the same fix as an earlier row"].extend(course.lines[same].tolist())
        course = course.of(~same)
    limit_mps = max_speed_kn * MPS_PER_KNOT
    for _ in range(_MOST_SHIPS):
        own = course.of_one_ship(limit_mps)
        if own.sum() >= _LEAST_FIXES:
            yield course.of(own)
        else:
            left_out[key, "a single fix: no movement to follow"].extend(course.lines[own].tolist())
        if not _is_another_ship(course, own, limit_mps):
            break
        course, own = course.of(~own), np.zeros(int((~own).sum()), np.bool_)
    rest = ~own
    if rest.any():
        elsewhere = course.at_taken_times()[1] & rest
        for chosen, reason in (
            (elsewhere, "at another place at the same time as an earlier row"),
            (rest & ~elsewhere, f"not reached from the fixes around it at {max_speed_kn:g} kn"),
        ):
            if chosen.any():
                left_out[key, reason].extend(course.lines[chosen].tolist())


def _is_another_ship(course: _Course, own: NDArray[np.bool_], limit_mps: float) -> bool:
    """Return whether the fixes that are not a ship's own alternate with these, and are nearly all of one other ship."""
    begins = np.diff(np.concatenate([[0], ~own])) == 1
    if begins.sum() < _LEAST_RUNS:
        return False
    rest = course.of(~own)
    return float(rest.of_one_ship(limit_mps).mean()) >= _NEARLY_ALL


def _track_of(key: str, rows: Fixes, course: _Course, size_columns: Sequence[str]) -> Track:
    outline_m = _outline(rows.largest, size_columns)
    assert outline_m is not None  # noqa: S101
    words: dict[str, Any] = {one.field: rows.ruled.get(one.members[0]) for one in columns_of(TRACK, Form.WORD)}
    texts = {one.members[0]: one.field for one in columns_of(TRACK, Form.TEXT)}
    words |= {field: rows.constant.get(name) for name, field in texts.items()}
    return Track(
        key,
        course.positions_deg,
        all_certain(course.times_us),
        outline_m,
        floor_m=None if "floor_m" in rows.unbounded else rows.lowest.get("floor_m"),
        ceiling_m=None if "ceiling_m" in rows.unbounded else rows.largest.get("ceiling_m"),
        properties={name: v for name, v in rows.constant.items() if v is not None and name not in texts},
        **words,
        max_speed_kn=np.inf,  # unreachable fixes are left out
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

    It is the longest chain of fixes. Chains may skip up to _LOOK_BACK fixes, or continue from the end of any of the
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
