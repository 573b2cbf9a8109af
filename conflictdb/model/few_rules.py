"""The rules of the columns that few plans have, on many of these plans or one: activations, voyages, heights, havens.

`AREA_FEW` and `TRACK_FEW` list them. The database has the same rules (sql/12_checks.sql).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model import inputs, plan_rules
from conflictdb.model.activations import INFINITY_US, MINUS_INFINITY_US, check_schedule, departures_us, joined, spans_us
from conflictdb.model.outlines import FASTEST_TIP, SHARPEST_CORNER_DEG, lose_convexity, mitred
from conflictdb.model.plan_columns import HEIGHT_LIMITS
from conflictdb.model.plan_rows import Broken, Many, Numbers, Rows, first_of, item, rows_of
from conflictdb.model.settings import Motion
from conflictdb.model.tolerances import as_members, tolerances_of

# No position is that uncertain; faster growth is a mistake in units.
MAX_GROWTH_MPS: Final = 1e6
_UNBOUNDED_US: Final = np.array([MINUS_INFINITY_US, INFINITY_US])
_ALL_BUT_LAST, _NEXT = slice(-1), slice(1, None)


class FewColumns(NamedTuple):
    """Columns that few plans have, and their rules.

    fields : of the columns; a plan that gives one of them must keep the rules
    keep : converts the fields of a plan to their own types, or raises InvalidInput
    rules : returns which of some plans break a rule
    derive : sets fields of a plan that breaks none
    needs : the column whose rules must be kept, `path` or `outline`; empty: none
    """

    fields: tuple[str, ...]
    keep: Callable[[str, Any], None]
    rules: Callable[[Sequence[Any]], Broken] | None = None
    derive: Callable[[Any], None] | None = None
    needs: str = ""

    def is_of(self, plan: Any) -> bool:
        """Return whether a plan gives one of the fields; a speed of 0 is none."""
        for name in self.fields:
            value = getattr(plan, name)
            if value is not None and not (type(value) is float and value == 0.0):
                return True
        return False

    def check(self, who: str, plan: Any) -> None:
        """Convert the fields of a plan, and check them; raises InvalidInput."""
        self.keep(who, plan)
        if self.rules is not None:
            self.rules([plan]).raise_for(0, who)
        if self.derive is not None:
            self.derive(plan)


def _set(plan: Any, **values: Any) -> None:
    for name, value in values.items():
        object.__setattr__(plan, name, value)


def _of_each(numbers: Iterable[Any]) -> Numbers:
    """Return a number of each plan (n,), or of one."""
    found = list(numbers)
    return found[0] if len(found) == 1 else np.array(found)


def _together(values: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return values[0] if len(values) == 1 else np.concatenate(values)


def _keep_spans(who: str, area: Any) -> None:
    _set(area, spans_us=spans_us(who, area.spans_us))


def _activations(areas: Sequence[Any]) -> Broken:
    """Return which areas break a rule of several spans, given as arrays (k, 2)."""
    rows = rows_of(_of_each(len(area.spans_us) for area in areas))
    spans = _together([area.spans_us for area in areas])
    broken = rows.broken()
    _add_place(broken, rows, "spans", spans[:, 0] >= spans[:, 1], "must end after it starts")
    is_several = _of_each(area.schedule is None and len(area.spans_us) > 0 for area in areas)
    for name, side, extreme in (("start", 0, rows.least), ("end", 1, rows.most)):
        own = [getattr(area, f"{name}_us") for area in areas]
        if own.count(None) < len(own):
            differs = extreme(spans[:, side], 0) != _of_each(0 if one is None else one for one in own)
            is_twice = is_several & _of_each(one is not None for one in own) & differs
            rule = "must not be given together with spans"
            broken.add(is_twice, lambda _, name=name, rule=rule: (name, rule))  # type: ignore[misc]
    is_outside = plan_rules.out_of_calendar(spans) & (spans != _UNBOUNDED_US)
    _add_place(broken, rows, "spans", is_outside, plan_rules.IN_CALENDAR)
    return broken


def _add_place(broken: Broken, rows: Rows, field: str, flags: NDArray[np.bool_], rule: str) -> None:
    """Add a rule that places (w,) break, or (w, k) for one of k reasons; the message names the first place."""
    if np.count_nonzero(flags):
        at = np.asarray(flags if flags.ndim == 1 else flags.any(axis=1))
        broken.add(rows.any(at), lambda i: (f"{field}[{first_of(at, rows, i)}]", rule))


def _derive_spans(area: Any) -> None:
    """Join spans, and take start and end of the area from them."""
    spans = joined(area.spans_us)
    _set(area, spans_us=spans)
    if spans and area.schedule is None:
        _set(area, start_us=spans[0][0], end_us=spans[-1][1])


def _keep_schedule(who: str, plan: Any) -> None:
    if not plan.is_stored:
        check_schedule(who, plan.schedule)


def _keep_departures(who: str, track: Any) -> None:
    _set(track, departures_us=departures_us(who, track.departures_us))


def _departures(tracks: Sequence[Any]) -> Broken:
    rows = rows_of(_of_each(len(track.departures_us) for track in tracks))
    lasts_us = _of_each(int(track.times_us[-1] - track.times_us[0]) for track in tracks)
    return departures(_together([track.departures_us for track in tracks]), rows, lasts_us)


def departures(departs_us: NDArray[np.int64], rows: Rows, lasts_us: Numbers) -> Broken:
    """Return which voyages are repeated against a rule.

    departs_us : (d,) microseconds of all departures
    lasts_us : how long a voyage takes
    """
    broken = rows.broken()
    is_late = rows.each_next(np.less_equal, departs_us)
    broken.add(
        rows.any(is_late),
        lambda i: (f"departures[{first_of(is_late, rows, i) + 1}]", "must be later than the one before"),
    )
    end_us = departs_us + rows.spread(lasts_us)
    is_under_way = rows.each_next(np.less, departs_us, end_us)

    def overlap(i: int) -> tuple[str, str]:
        took = f"a voyage takes {item(lasts_us, i) / 1e6:g} s, and one object is in one place: use two tracks"
        rule = f"is before the voyage before it has ended ({took})"
        return f"departures[{first_of(is_under_way, rows, i) + 1}]", rule

    broken.add(rows.any(is_under_way), overlap)
    # A sum that overflows is of a departure that is outside itself.
    is_outside = plan_rules.out_of_calendar(departs_us) | (end_us > plan_rules.MAX_INSTANT_US)
    broken.add(rows.any(is_outside), lambda _: ("departures", "must have voyages in the years 1 to 9999"))
    return broken


def _derive_departures(track: Any) -> None:
    _set(track, departures_us=tuple(track.departures_us.tolist()))


def _keep_legs(who: str, track: Any) -> None:
    if not isinstance(track.legs, Motion):
        raise InvalidInput(who, "legs", f"must be a Motion, or absent; got {track.legs!r:.60}")


def _growth_rule(speed: object) -> tuple[str, str]:
    rule = f"must be a number of metres per second from 0 to 1e6; got {speed!r}"  # MAX_GROWTH_MPS, as in SQL
    return "grow_mps", f"{rule} (a haven that shrinks takes outlines_m)"


def _keep_growth(who: str, track: Any) -> None:
    if isinstance(track.grow_mps, bool) or not isinstance(track.grow_mps, int | float):
        raise InvalidInput(who, *_growth_rule(track.grow_mps))


def _growth(tracks: Sequence[Any]) -> Broken:
    """Return which tracks grow against a rule."""
    ring = rows_of(_of_each(len(track.outline_m) for track in tracks))
    broken = ring.broken()
    speed = _of_each(float(track.grow_mps) for track in tracks)
    is_speed = (speed >= 0.0) & (speed <= MAX_GROWTH_MPS)
    broken.add(np.logical_not(is_speed), lambda i: _growth_rule(tracks[i].grow_mps))
    has_outlines = _of_each(track.outlines_m is not None for track in tracks)
    broken.add(has_outlines, lambda _: ("grow_mps", "must not be given together with outlines_m"))
    _, rate, offset = mitred(_together([track.outline_m for track in tracks]), ring.offset)
    is_sharp = ~(np.hypot(rate[:, 0], rate[:, 1]) <= FASTEST_TIP)
    rule = f"has a corner sharper than {SHARPEST_CORNER_DEG:g} degree, which would grow into a spike"
    remedy = "blunt it, or give outlines_m instead of grow_mps"
    broken.add(Many(offset).any(is_sharp), lambda _: ("outline_m", f"{rule}: {remedy}"))
    return broken


def _keep_outlines(who: str, track: Any) -> None:
    outlines = inputs.outlines_m(who, track.outlines_m)
    if outlines.ndim != 3 or outlines.shape[2] != 2:
        raise InvalidInput(who, "outlines_m", "must be rings of [starboard, forward] metres with equal vertex counts")
    _set(track, outlines_m=outlines)


def _outlines(tracks: Sequence[Any]) -> Broken:
    """Return which tracks have outlines, one per waypoint, that break a rule."""
    outlines = [track.outlines_m for track in tracks]
    count, corners = [len(one) for one in outlines], [one.shape[1] for one in outlines]
    rows, waypoints = rows_of(_of_each(count)), _of_each(len(track.positions_deg) for track in tracks)
    broken = rows.broken()

    def unequal(i: int) -> tuple[str, str]:
        return "outlines_m", f"must be one per waypoint: {item(waypoints, i)} waypoints, {count[i]} outlines"

    broken.add(rows.count != waypoints, unequal)
    sizes = plan_rules.sizes(rows.count * _of_each(corners), rows, "outlines_m", "vertices")
    broken.add(np.logical_not(sizes.is_sound), sizes.said)
    ring = _rings(count, corners)
    outline_m = _together([one.reshape(-1, 2) for one in outlines])
    of_rings = plan_rules.outlines(outline_m, ring, lambda _: "")
    is_unsound = ~np.asarray(of_rings.is_sound)

    def first(i: int) -> tuple[str, str]:
        k = first_of(is_unsound, rows, i)
        return f"outlines_m[{k}]", of_rings.said(rows.places(i).indices(len(is_unsound))[0] + k)[1]

    broken.add(rows.any(is_unsound), first)
    is_other = _of_each(not _are_equal(track.outlines_m[:1], track.outline_m[None]) for track in tracks)
    broken.add(is_other, lambda _: ("outline_m", "must be the first of outlines_m"))
    # From each outline to the next of the same track.
    ways = [max(0, n - 1) for n in count]
    start_m, end_m = (_together([one[part].reshape(-1, 2) for one in outlines]) for part in (_ALL_BUT_LAST, _NEXT))
    is_lost, way = lose_convexity(start_m, end_m, _rings(ways, corners)), rows_of(_of_each(ways))

    def inside_out(i: int) -> tuple[str, str]:
        k = first_of(is_lost, way, i)
        rule = f"does not stay convex on the way from outlines_m[{k}]: each vertex moves straight to its like"
        return f"outlines_m[{k + 1}]", f"{rule}; order the vertices alike, or add a waypoint"

    broken.add(way.any(is_lost), inside_out)
    return broken


def _rings(count: list[int], corners: list[int]) -> Many:
    """Return the corners of all rings of some tracks, each with `count` rings of equally many corners."""
    return Many.even(count[0], corners[0]) if len(count) == 1 else Many.of(np.repeat(corners, count))


def _are_equal(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Return whether arrays are equal, as `numpy.array_equal`."""
    return a.shape == b.shape and np.count_nonzero(a == b) == a.size


def _keep_heights(who: str, track: Any) -> None:
    for name, field, _ in HEIGHT_LIMITS:
        given = getattr(track, field)
        if given is not None:
            _set(track, **{field: inputs.heights_m(who, name, given)})


def _heights(tracks: Sequence[Any]) -> Broken:
    """Return which tracks have heights of legs that break a rule."""
    points = [len(track.positions_deg) for track in tracks]
    waypoints = _of_each(points)
    legs = rows_of(waypoints - 1)
    broken = legs.broken()
    for name, field, unbounded in HEIGHT_LIMITS:
        given = [getattr(track, field) for track in tracks]
        rows = rows_of(_of_each(0 if one is None else len(one) for one in given))
        heights = _together([np.empty(0) if one is None else one for one in given])
        has_some = _of_each(one is not None for one in given)

        def count(i: int, name: str = name, rows: Rows = rows) -> tuple[str, str]:
            rule = f"must be one number, one per leg ({points[i] - 1}) or one per waypoint ({points[i]})"
            return name, f"{rule}; got {item(rows.count, i)} heights"

        broken.add(has_some & (rows.count != waypoints) & (rows.count != waypoints - 1), count)
        _add_place(broken, rows, name, ~(np.isfinite(heights) | (heights == unbounded)), plan_rules.FINITE)
        wholes = [_whole(track, field) for track in tracks]

        def other(i: int, name: str = name, wholes: list[float | None] = wholes) -> tuple[str, str]:
            return name, f"must be that of all legs ({wholes[i]}), or be left out; got {getattr(tracks[i], name)}"

        own = [getattr(track, name) for track in tracks]
        broken.add(has_some & _of_each(a not in (None, b) for a, b in zip(own, wholes, strict=True)), other)
    # Heights that are not one per leg or waypoint are not compared.
    pairs = [
        track.heights_m() if item(broken.is_sound, i) else (np.zeros((points[i] - 1, 2)), np.ones((points[i] - 1, 2)))
        for i, track in enumerate(tracks)
    ]
    floors_m, ceilings_m = (_together([pair[side] for pair in pairs]) for side in (0, 1))
    is_low = ceilings_m <= floors_m

    def low(i: int) -> tuple[str, str]:
        leg, end = np.argwhere(is_low[legs.places(i)])[0].tolist()
        floor_m, ceiling_m = (each[legs.places(i)][leg, end] for each in (floors_m, ceilings_m))
        ceilings = tracks[i].ceilings_m
        per_waypoint = ceilings is not None and len(ceilings) == points[i]
        name = "ceiling_m" if ceilings is None else f"ceiling_m[{leg + end * per_waypoint}]"
        return name, f"must be above the floor of leg {leg} ({floor_m:g}); got {ceiling_m:g}"

    broken.add(legs.any(is_low), low)
    return broken


def _whole(track: Any, field: str) -> float | None:
    """Return the lowest floor or the highest ceiling of all legs; None: unbounded, or there are no heights."""
    heights = getattr(track, field)
    if heights is None or not len(heights):
        return None
    whole = float((np.minimum if field == "floors_m" else np.maximum).reduce(heights))
    return whole if np.isfinite(whole) else None


def _derive_heights(track: Any) -> None:
    """Take the band of the whole track from the heights of its legs."""
    for name, field, _ in HEIGHT_LIMITS:
        if getattr(track, field) is not None:
            _set(track, **{name: _whole(track, field)})


def _keep_tolerances(who: str, track: Any) -> None:
    tolerances_of(who, track.tolerances, track.times_us)
    _set(track, tolerances=as_members(track.tolerances))


def _tolerances(tracks: Sequence[Any]) -> Broken:
    """Return which tracks have tolerances beside other columns that they must not have."""
    broken = rows_of(_of_each([1] * len(tracks))).broken()
    is_repeated = _of_each(track.departures_us is not None or track.schedule is not None for track in tracks)
    rule = "must not be given for a voyage that is repeated: give each voyage as a track"
    broken.add(is_repeated, lambda _: ("tolerances", rule))
    changes = _of_each(track.outlines_m is not None or track.grow_mps != 0.0 for track in tracks)
    remedy = "must not be given for a haven that changes: give the outline of the ship"
    broken.add(changes, lambda _: ("tolerances", remedy))
    return broken


_SCHEDULE: Final = FewColumns(("schedule",), _keep_schedule)
AREA_FEW: Final = (FewColumns(("spans_us",), _keep_spans, _activations, _derive_spans), _SCHEDULE)
TRACK_FEW: Final = (
    FewColumns(("departures_us",), _keep_departures, _departures, _derive_departures, "path"),
    _SCHEDULE,
    FewColumns(("legs",), _keep_legs),
    FewColumns(("grow_mps",), _keep_growth, _growth, needs="outline"),
    FewColumns(("outlines_m",), _keep_outlines, _outlines, needs="outline"),
    FewColumns(tuple(one.of_legs for one in HEIGHT_LIMITS), _keep_heights, _heights, _derive_heights),
    FewColumns(("tolerances",), _keep_tolerances, _tolerances),
)
