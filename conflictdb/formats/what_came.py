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
        if not self._rows:
            return
        rows = self._table()
        for which, text in (*_years(rows, now_us), *_speeds(rows), *_signs(rows)):
            for i in which.tolist()[:_MOST_NAMED]:
                yield Remark(source, name(i), text(i))
            if len(which) > _MOST_NAMED:
                count = len(which) - _MOST_NAMED
                yield Remark(source, "file", f"{count:,} more objects are like {name(int(which[0]))} in this")

    def _table(self) -> NDArray[np.float64]:
        return np.array(self._rows).reshape(-1, _WIDTH)


# Objects with a remark, and the text of each.
_Found = tuple[NDArray[np.intp], Callable[[int], str]]


def _years(rows: NDArray[np.float64], now_us: int) -> Iterator[_Found]:
    begins = np.isfinite(rows[:, 4])
    at = np.where(begins, rows[:, 4], rows[:, 5])
    known = np.flatnonzero(np.isfinite(at))
    if not known.size:
        return
    middle = float(np.median(at[known]))
    apart = np.abs(at[known] - middle)
    reach = float(np.sort(apart)[max(0, int(_OTHERS * known.size) - 1)])
    far = known[apart > max(_YEAR_US, 3.0 * reach)] if known.size > 2 else known[:0]

    def when(rest: str, i: int) -> str:
        return f"{'begins' if begins[i] else 'ends'} on {_moment(at[i])[:10]}, {rest}: is its year right?"

    yield far, partial(when, f"and the others about {_moment(middle)[:10]}")
    ahead = np.setdiff1d(known[at[known] > now_us + _MOST_AHEAD_US], far)
    yield ahead, partial(when, "more than five years from now")


def _speeds(rows: NDArray[np.float64]) -> Iterator[_Found]:
    """Compare what flies with what flies, and the rest with the rest."""
    speed = rows[:, 6]
    flies = rows[:, 7] > 0.0
    for alike in (flies, ~flies):
        known = np.flatnonzero(np.isfinite(speed) & alike)
        if known.size < _LEAST_TRACKS:
            continue
        usual = float(np.sort(speed[known])[max(1, int(_OTHERS * known.size)) - 1])
        rest = f"and the others at most at {usual:,.0f} kn: is a time, a place or a unit wrong?"
        if usual > 0.0:
            yield known[speed[known] > _FASTER * usual], partial(_fast, speed, rest)


def _fast(speed: NDArray[np.float64], rest: str, i: int) -> str:
    return f"travels at {speed[i]:,.0f} kn, {rest}"


def _signs(rows: NDArray[np.float64]) -> Iterator[_Found]:
    floor, speed = rows[:, 7], rows[:, 6]
    above = np.flatnonzero((floor > 0.0) & (speed <= _SHIP_KN))
    if (floor < 0.0).any() and above.size <= max(1.0, (1.0 - _OTHERS) * len(rows)):
        rest = "and others are below it: depths are heights below zero; is its sign right?"
        yield above, lambda i: f"is {floor[i]:,.0f} m above the sea at {speed[i]:,.0f} kn, {rest}"


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
