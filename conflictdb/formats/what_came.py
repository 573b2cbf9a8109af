"""What a load brought, in one line, and what in it is far from the rest: years, speeds, signs of depths."""

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, timedelta
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.formats import places
from conflictdb.formats.contents import Remark
from conflictdb.formats.track_times import speeds_kn
from conflictdb.model.inputs import EPOCH
from conflictdb.model.load_summary import LoadSummary
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track
from conflictdb.model.speed_limits import MPS_PER_KNOT

_YEAR_US: Final = 365 * 86_400_000_000
# Nobody plans further ahead.
_MOST_AHEAD_US: Final = 5 * _YEAR_US
# A track gets a remark if it is faster than the others by this factor.
_FASTER: Final = 5.0
# Fewer tracks have no usual speed.
_LEAST_TRACKS: Final = 3
# "The others" are nine of ten: kinds of traffic mix, and a mistake must not hide itself.
_OTHERS: Final = 0.9
# Aircraft are faster, and most ships slower.
_SHIP_KN: Final = 40.0
# Between knots, metres a second and kilometres an hour.
_BETWEEN_UNITS: Final = tuple(f for one in (MPS_PER_KNOT, 3.6, 3.6 * MPS_PER_KNOT) for f in (one, 1.0 / one))
# Remarks of one kind that name their object; the other objects are counted.
_MOST_NAMED: Final = 3
_WIDTH: Final = 9


@dataclass(slots=True)
class WhatCame:
    """The objects of a load: extent (degrees), start and end (microseconds), fastest leg (knots), heights (metres).

    Numbers of one object take 72 bytes; unknown ones are NaN.

    scene : its motion and earth decide how long legs are; None: as by default
    """

    scene: Scene | None = None
    _rows: "array[float]" = field(default_factory=lambda: array("d"))
    areas: int = 0
    tracks: int = 0
    scheduled: int = 0

    def add(self, areas: Sequence[Area], tracks: Sequence[Track]) -> None:
        """Add the objects of a part."""
        if not (areas or tracks):
            return
        rows = np.full((len(areas) + len(tracks), _WIDTH), np.nan)
        rows[:, :4] = places.extents(areas, tracks)
        ends = [(_bounded(one.start_us), _bounded(one.end_us)) for one in areas]
        rows[:, 4:6] = [*ends, *((float(one.times_us[0]), float(one.times_us[-1])) for one in tracks)]
        rows[len(areas) :, 6] = _fastest_kn(tracks, self.scene or Scene("file"))
        items: list[Area | Track] = [*areas, *tracks]
        rows[:, 7] = [np.nan if one.floor_m is None else one.floor_m for one in items]
        rows[:, 8] = [np.nan if one.ceiling_m is None else one.ceiling_m for one in items]
        self._rows.extend(rows.ravel().tolist())
        self.scheduled += sum(one.schedule is not None for one in items)
        self.areas += len(areas)
        self.tracks += len(tracks)

    def summary(self) -> LoadSummary:
        """Return how many, where, when, how fast and how high."""
        if not self._rows:
            return LoadSummary()
        rows = self._table()
        (since, _), (_, until) = _limits(rows[:, 4]), _limits(rows[:, 5])
        (slowest, fastest), (lowest, highest) = _limits(rows[:, 6]), _limits(rows[:, 7:9])
        west, south = rows[:, :2].min(axis=0).tolist()
        east, north = rows[:, 2:4].max(axis=0).tolist()
        return LoadSummary(
            areas=self.areas,
            tracks=self.tracks,
            scheduled=self.scheduled,
            west=west,
            south=south,
            east=east,
            north=north,
            since=None if since is None else EPOCH + timedelta(microseconds=int(since)),
            until=None if until is None else EPOCH + timedelta(microseconds=int(until)),
            slowest_kn=slowest,
            fastest_kn=fastest,
            lowest_m=lowest,
            highest_m=highest,
        )

    def remarks(self, source: str, name: Callable[[int], str], now_us: int) -> Iterator[Remark]:
        """Yield remarks on what is far from the rest in time, in speed, and above the sea where others are below.

        name : returns the name of an object, given its place in the order in which they were added
        """
        if self._rows:
            for rule in _RULES:
                for found in rule(self._table(), None, now_us):
                    yield from _named(source, name, *found)

    def far_from(
        self, areas: Sequence[Area], tracks: Sequence[Track], *, source: str, name: Callable[[int], str], now_us: int
    ) -> Iterator[Remark]:
        """Yield remarks on what is far from objects of a scene, without those that `remarks` and `places.far` yield."""
        stored = WhatCame(self.scene)
        stored.add(areas, tracks)
        if not self._rows or not stored._rows:
            return
        rows, others = self._table(), stored._table()
        for rule in (_far, *_RULES):
            known = [which for which, _ in rule(rows, None, now_us)]
            for which, text in rule(rows, others, now_us):
                yield from _named(source, name, np.setdiff1d(which, np.concatenate([*known, which[:0]])), text)
        if (text_of_all := _other_unit(rows, others)) is not None:
            yield Remark(source, "file", text_of_all)

    def _table(self) -> NDArray[np.float64]:
        return np.array(self._rows).reshape(-1, _WIDTH)


# Objects with a remark, and the text of each.
_Found = tuple[NDArray[np.intp], Callable[[int], str]]
_Others = NDArray[np.float64] | None


def _named(
    source: str, name: Callable[[int], str], which: NDArray[np.intp], text: Callable[[int], str]
) -> Iterator[Remark]:
    for i in which.tolist()[:_MOST_NAMED]:
        yield Remark(source, name(i), text(i))
    if len(which) > _MOST_NAMED:
        count = len(which) - _MOST_NAMED
        yield Remark(source, "file", f"{count:,} more objects are like {name(int(which[0]))} in this")


def _far(rows: NDArray[np.float64], others: _Others, _now_us: int) -> Iterator[_Found]:
    yield places.found_far(rows[:, :4], None if others is None else others[:, :4])


def _years(rows: NDArray[np.float64], others: _Others, now_us: int) -> Iterator[_Found]:
    begins = np.isfinite(rows[:, 4])
    at = _first_times(rows)
    known, of = np.flatnonzero(np.isfinite(at)), at if others is None else _first_times(others)
    of = of[np.isfinite(of)]
    if not known.size or not of.size:
        return
    middle = float(np.median(of))
    reach = float(np.sort(np.abs(of - middle))[max(0, int(_OTHERS * of.size) - 1)])
    far = known[np.abs(at[known] - middle) > max(_YEAR_US, 3.0 * reach)] if of.size > 2 else known[:0]

    def when(rest: str, i: int) -> str:
        return f"{'begins' if begins[i] else 'ends'} on {_moment(at[i])[:10]}, {rest}: is its year right?"

    yield far, partial(when, f"and {_who(others)} about {_moment(middle)[:10]}")
    ahead = np.setdiff1d(known[at[known] > now_us + _MOST_AHEAD_US], far)
    yield ahead, partial(when, "more than five years from now")


def _first_times(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return when objects begin, or end if they have no beginning, NaN for neither."""
    return np.where(np.isfinite(rows[:, 4]), rows[:, 4], rows[:, 5])


def _speeds(rows: NDArray[np.float64], others: _Others, _now_us: int) -> Iterator[_Found]:
    """Compare what flies with what flies, and the rest with the rest."""
    speed = rows[:, 6]
    for known, usual in _alike(rows, rows if others is None else others):
        if len(usual) < _LEAST_TRACKS:
            continue
        most = float(usual[max(1, int(_OTHERS * len(usual))) - 1])
        rest = f"and {_who(others)} at most at {most:,.0f} kn: is a time, a place or a unit wrong?"
        if most > 0.0:
            yield known[speed[known] > _FASTER * most], partial(_fast, speed, rest)


def _alike(
    rows: NDArray[np.float64], others: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.float64]]]:
    """Yield the rows of tracks that fly, and of those that do not, and the sorted speeds of such others."""
    for fly in (True, False):
        ours, theirs = (np.isfinite(some[:, 6]) & ((some[:, 7] > 0.0) == fly) for some in (rows, others))
        yield np.flatnonzero(ours), np.sort(others[theirs, 6])


def _other_unit(rows: NDArray[np.float64], others: NDArray[np.float64]) -> str | None:
    """Return a remark on tracks that are all slower or faster than the others, by a factor between units of speed."""
    for known, usual in _alike(rows, others):
        if min(len(known), len(usual)) < _LEAST_TRACKS:
            continue
        speed = rows[known, 6]
        low, high = np.quantile(usual, [1.0 - _OTHERS, _OTHERS])
        converted = float(np.median(speed)) * np.array(_BETWEEN_UNITS)
        if (speed.min() > high or speed.max() < low) and ((low <= converted) & (converted <= high)).any():
            own, rest = (f"{least:,.0f} to {most:,.0f} kn" for least, most in ((speed.min(), speed.max()), (low, high)))
            return f"its tracks travel at {own}, and {_who(others)} at {rest}: is the unit right (kn, m/s or km/h)?"
    return None


def _who(others: _Others) -> str:
    return "the others" if others is None else "those of the scene"


def _fast(speed: NDArray[np.float64], rest: str, i: int) -> str:
    return f"travels at {speed[i]:,.0f} kn, {rest}"


def _signs(rows: NDArray[np.float64], others: _Others, _now_us: int) -> Iterator[_Found]:
    floor, speed = rows[:, 7], rows[:, 6]
    above = np.flatnonzero(_is_above(rows))
    rest = rows if others is None else others
    if (rest[:, 7] < 0.0).any() and _is_above(rest).sum() <= max(1.0, (1.0 - _OTHERS) * len(rest)):
        whom = "others" if others is None else "some of the scene"
        why = f"and {whom} are below it: depths are heights below zero; is its sign right?"
        yield above, lambda i: f"is {floor[i]:,.0f} m above the sea at {speed[i]:,.0f} kn, {why}"


def _is_above(rows: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray((rows[:, 7] > 0.0) & (rows[:, 6] <= _SHIP_KN))


# Given objects, the others (None: the rest of them) and the time.
_RULES: Final[tuple[Callable[[NDArray[np.float64], _Others, int], Iterator[_Found]], ...]] = (_years, _speeds, _signs)


def _bounded(at_us: int | None) -> float:
    return np.nan if at_us is None or at_us in (MINUS_INFINITY_US, INFINITY_US) else float(at_us)


def _fastest_kn(tracks: Sequence[Track], scene: Scene) -> NDArray[np.float64]:
    if not tracks:
        return np.empty(0)
    return np.asarray(np.maximum.reduceat(*speeds_kn(tracks, scene.motion, scene.earth)))


def _limits(column: NDArray[np.float64]) -> tuple[float, float] | tuple[None, None]:
    known = column[np.isfinite(column)]
    return (float(known.min()), float(known.max())) if known.size else (None, None)


def _moment(at_us: float) -> str:
    return (EPOCH + timedelta(microseconds=int(at_us))).astimezone(UTC).strftime("%Y-%m-%d %H:%M")
