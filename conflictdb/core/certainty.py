"""Prove that all voyages within the tolerances of two plans conflict.

Two tests are sound; a pair that passes neither *may* conflict:

- A gate is a place of a leg. Every voyage passes it, at some time between two bounds. The pair must conflict if the
  ship conflicts there at all offsets within the cross-track limits, at all those times, with all that the other object
  may be by then.
- At an instant at which all voyages are under way, the pair must conflict if ships at all places where voyages may be
  conflict.

The distance of two convex polygons is a convex function of how they are displaced. So the ship conflicts at all places
of a rectangle if it does at its corners, less a margin for the curvature of the earth.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.column_numbers import IN_PIECES
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import OF_TOLERANCES, PieceRows, Pieces, level_m
from conflictdb.core.object_pairs import object_numbers
from conflictdb.core.pieces.covers import COVER
from conflictdb.core.pieces.ribbons import Passage
from conflictdb.earth.geodesy import MEAN_RADIUS_M
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.kernel.movement import Movement
from conflictdb.model.results import Certainty, Kind, Verdict

# Given numbers of tracks with tolerances, returns those that still exist, in any order.
Plans = Callable[[NDArray[np.int64]], TrackBatch]

# Gates between the ends of the part of a leg that an area may meet, instants in each period, and cells of a rectangle.
_GATES: Final = 11
_INSTANTS: Final = 9
_CELLS: Final = 8
# Places of a leg, between which distances along it are interpolated.
_PLACES: Final = 65
# A pair with more parts of an area, or periods, is looked at as far as these.
_MOST_PARTS: Final = 64
_MOST_PERIODS: Final = 4
# More than rounding displaces a vertex, metres, an instant, microseconds, and a height, metres.
_ROUNDING_M: Final = 0.05
_ROUNDING_US: Final = 10.0
_ROUNDING_HEIGHT_M: Final = 1e-6
# Bend of lines in a gnomonic plane up to 60 degrees from its centre: at most twice the tangent, twice.
_GNOMONIC_BEND: Final = 8.0


def with_certainty(setup: Setup, pieces: Pieces, conflicts: Conflicts, plans: Plans) -> Conflicts:
    """Return conflicts that say whether all voyages of plans with tolerances conflict.

    pieces : all pieces of the conflicts' objects that meet others
    plans : called for the tracks with tolerances in conflicts
    """
    has_limits = pieces.part >= OF_TOLERANCES
    if not len(conflicts) or not has_limits.any():
        return conflicts
    limited = np.unique(object_numbers(pieces)[has_limits])
    a, b = (numbers_of(kind, ids) for kind, ids in _members(conflicts))
    certainty = np.where(
        (np.isin(a, limited) | np.isin(b, limited))
        & ((conflicts.verdict == Verdict.CONFLICT.code) | (conflicts.verdict == Verdict.GRAZING.code)),
        Certainty.MAY.code,
        conflicts.certainty,
    ).astype(np.int8)
    rows = np.flatnonzero((certainty == Certainty.MAY.code) & (conflicts.verdict == Verdict.CONFLICT.code))
    if len(rows):
        proofs = _Proofs(setup, pieces, plans, conflicts.take(rows))
        for some, is_proven in isolated(
            np.arange(len(rows)),
            lambda some: np.array([proofs.must(i) for i in some.tolist()], np.bool_),
            lambda some: np.zeros(len(some), np.bool_),
            "conflict",
        ):
            certainty[rows[some[is_proven]]] = Certainty.MUST.code
    return replace(conflicts, certainty=certainty)


def _members(conflicts: Conflicts) -> list[tuple[NDArray[np.int8], NDArray[np.int64]]]:
    return [(conflicts.a_kind, conflicts.a_id), (conflicts.b_kind, conflicts.b_id)]


@dataclass(frozen=True, slots=True)
class _Leg:
    """A leg, and the ship that sails along it within cross-track limits.

    outline_m : of the ship, counter-clockwise
    bearing_deg : its heading at the start
    band_m : heights that the ship always overlaps, each half of the vertical separation further out: floor and ceiling
    """

    plane: Plane
    start_deg: Floats
    end_deg: Floats
    bearing_deg: float
    length_m: float
    outline_m: Floats
    port_m: float
    starboard_m: float
    band_m: tuple[float, float]
    _moving: list[Movement] = field(default_factory=list)
    _known: list[tuple[Floats, Floats]] = field(default_factory=list)

    @property
    def size_m(self) -> float:
        """No two vertices of the ship are further from each other."""
        return 2.0 * float(np.hypot(*self.outline_m.T).max())

    @property
    def width_m(self) -> float:
        """The width between the cross-track limits."""
        return self.port_m + self.starboard_m

    def ships(self, along_m: Floats, cells: int) -> NDArray[np.object_]:
        """Return ships (n, c) in the plane at distances (n,) from the start of the leg, and at offsets across it.

        The offsets are `cells` + 1 from limit to limit, `cells` a divisor of _CELLS; one if both limits are 0.
        """
        moving = self._sailing()
        chosen = np.arange(0, len(moving.piece), _CELLS // cells)
        t = np.repeat(np.clip(along_m, 0.0, self.length_m), len(chosen))
        rings = moving.take(np.tile(chosen, len(along_m))).positions(t).transpose(2, 1, 0)
        if not np.isfinite(rings).all():
            raise ValueError("a ship has no place in the plane")
        hulls = shapely.convex_hull(shapely.multipoints(rings))
        return np.asarray(hulls, dtype=object).reshape(len(along_m), len(chosen))

    def along_of(self, xy: Floats) -> Floats:
        """Return distances from the start of the leg that lie beside points (n, 2) of the plane, about."""
        along_m, (x, y) = self._places()
        turn = self.plane.turn_m
        beside = xy[:, 0] - (turn * np.round((xy[:, 0] - 0.5 * (x[0] + x[-1])) / turn) if turn else 0.0)
        way_x, way_y = x[-1] - x[0], y[-1] - y[0]
        # Legs are straight in the plane.
        return np.interp(beside * way_x + xy[:, 1] * way_y, x * way_x + y * way_y, along_m)

    def _places(self) -> tuple[Floats, Floats]:
        """Return distances (n,) from the start of the leg, and its places there in the plane (2, n)."""
        if not self._known:
            along_m = np.linspace(0.0, self.length_m, _PLACES)
            self._known.append((along_m, self._sailing().take(np.zeros(_PLACES, np.int64)).reference(along_m)))
        return self._known[0]

    def _sailing(self) -> Movement:
        """Return ships that sail along the leg at a metre per second, at offsets across it."""
        if not self._moving:
            offsets = np.linspace(-self.port_m, self.starboard_m, _CELLS + 1) if self.width_m else np.zeros(1)
            pieces = self._pieces(offsets)
            prepared = kernel.KernelScene(self.plane.kernel_plane, pieces)
            rows = PieceRows(np.arange(len(offsets)))
            self._moving.append(Movement.of(prepared, rows, np.zeros(len(offsets), np.int64)))
        return self._moving[0]

    def _pieces(self, offsets: Floats) -> Pieces:
        n, corners = len(offsets), len(self.outline_m)
        shape = np.tile(self.outline_m, (n, 1))
        shape[:, 0] += np.repeat(offsets, corners)
        nothing, none = np.zeros(n), np.zeros(n, np.int64)
        end = np.full(n, max(round(1e6 * self.length_m), 1))
        return Pieces(
            piece_id=none,
            kind=np.full(n, Kind.TRACK.code, np.int8),
            object_id=none,
            version=none,
            part=np.arange(n, dtype=np.int32),
            turn=np.zeros(n, np.int16),
            start_us=none,
            end_us=end,
            end_inclusive=np.ones(n, np.bool_),
            floor_m=nothing,
            ceiling_m=nothing,
            climb_m=level_m(nothing, nothing),
            hull_xy=np.empty((0, 2)),
            hull_offset=np.zeros(n + 1, np.int64),
            shape_xy=shape,
            shape_to_xy=shape,
            shape_offset=corners * np.arange(n + 1),
            leg_start_us=none,
            leg_end_us=end,
            leg_start_deg=np.tile(self.start_deg, (n, 1)),
            leg_end_deg=np.tile(self.end_deg, (n, 1)),
            bearing_deg=np.full(n, self.bearing_deg),
            numbers=np.zeros((n, len(IN_PIECES)), np.int64),
        )


@dataclass(frozen=True, slots=True)
class _Rectangle:
    """Places of a leg from low_m to high_m from its start, and within its cross-track limits."""

    leg: _Leg
    low_m: float
    high_m: float

    def corners(self) -> NDArray[np.object_]:
        """Return the ships (2, c) at the corners."""
        return self.leg.ships(np.array([self.low_m, self.high_m]), 1)

    @property
    def across_m(self) -> float:
        """The length of the diagonal."""
        return float(np.hypot(self.high_m - self.low_m, self.leg.width_m))


@dataclass(frozen=True, slots=True)
class _Plan:
    """A track without tolerances: its legs (n,), in the order of their times (n, 2), microseconds."""

    legs: list[_Leg]
    times_us: NDArray[np.int64]

    @classmethod
    def of(cls, plane: Plane, pieces: Pieces) -> "_Plan":
        """Return the legs of some pieces of a track; none if its haven changes."""
        if not len(pieces) or pieces.changed().any() or (pieces.part == COVER).any():
            return cls([], np.empty((0, 2), np.int64))
        times_us, rows = np.unique(np.stack([pieces.leg_start_us, pieces.leg_end_us], 1), axis=0, return_index=True)
        start, end = pieces.leg_start_deg[rows], pieces.leg_end_deg[rows]
        lengths = plane.courses(start, end)[0].tolist()
        legs = []
        for k, row in enumerate(rows.tolist()):
            shape = pieces.shape_xy[pieces.shape_offset[row] : pieces.shape_offset[row + 1]]
            climb = pieces.climb_m[row]
            band = float(climb[:2].max()), float(climb[2:].min())
            bearing = float(pieces.bearing_deg[row])
            legs.append(_Leg(plane, start[k], end[k], bearing, lengths[k], shape, 0.0, 0.0, band))
        return cls(legs, times_us)

    def places(self, first_us: float, last_us: float) -> list[_Rectangle]:
        """Return where the track is during a time; none if it is not under way, or not known then."""
        start, end = self.times_us.astype(np.float64).T
        rows = np.flatnonzero((start <= last_us) & (first_us <= end))
        if not (len(rows) and start[rows[0]] < first_us and last_us < end[rows[-1]]):
            return []
        if (end[rows[:-1]] != start[rows[1:]]).any():
            return []
        found = []
        for row in rows.tolist():
            low, high = np.clip((np.array([first_us, last_us]) - start[row]) / (end[row] - start[row]), 0.0, 1.0)
            length_m = self.legs[row].length_m
            found.append(_Rectangle(self.legs[row], float(low) * length_m, float(high) * length_m))
        return found


@dataclass(frozen=True, slots=True)
class _Voyages:
    """The voyages of a track within its tolerances. zero_us : when the plan departs; passages count from it."""

    passage: Passage
    zero_us: int
    legs: list[_Leg]

    @classmethod
    def of(cls, plane: Plane, track: TrackBatch, half_m: float) -> "_Voyages":
        """Return the voyages of a track, the only one of a batch; half_m : half of the vertical separation."""
        passage = Passage.of(plane, track)
        x, y = track.outline_m.T
        doubled = float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
        outline = track.outline_m if doubled >= 0.0 else track.outline_m[::-1]
        positions, limits = passage.positions_deg, passage.limits
        legs = [
            _Leg(
                plane,
                positions[k],
                positions[k + 1],
                float(passage.first_deg[k]),
                float(passage.length_m[k]),
                outline,
                float(limits.port_m[k]),
                float(limits.starboard_m[k]),
                # The voyage may be at any height of a leg that climbs.
                (float(track.floor_m[k].max()) - half_m, float(track.ceiling_m[k].min()) + half_m),
            )
            for k in range(len(passage.length_m))
        ]
        return cls(passage, int(track.times_us[0]), legs)

    def gate(self, i: int, along_m: Floats) -> tuple[Floats, Floats]:
        """Return between which instants (n,), microseconds, voyages pass places (n,) of a step, inside of it."""
        step, (begin_first, begin_last, end_first, end_last) = self.passage.steps[i], self.passage.span(i)
        slowest, fastest = step.speeds_mps
        gone_m, left_m = along_m - step.begin_m, step.end_m - along_m
        with np.errstate(divide="ignore"):
            first = np.maximum(begin_first + gone_m / fastest, end_first - left_m / slowest)
            last = np.minimum(begin_last + gone_m / slowest, end_last - left_m / fastest)
        return self.zero_us + 1e6 * first - _ROUNDING_US, self.zero_us + 1e6 * last + _ROUNDING_US

    def places(self, first_us: float, last_us: float) -> list[_Rectangle]:
        """Return where voyages may be during a time; none if one may not be under way, or in a turn or a stop."""
        return [place for _, place in self.numbered_places(first_us, last_us)]

    def numbered_places(self, first_us: float, last_us: float) -> list[tuple[int, _Rectangle]]:
        """Return `places` with the numbers of their steps."""
        passage = self.passage
        first, last = ((at - self.zero_us) / 1e6 for at in (first_us - _ROUNDING_US, last_us + _ROUNDING_US))
        if not (passage.latest_s[0] < first and last < passage.earliest_s[-1]):
            return []
        found = []
        for i, step in enumerate(passage.steps):
            span = passage.span(i)
            if not (span[0] <= last and first <= span[3]):
                continue
            if step.leg < 0:
                if step.longest_s > 0.0:
                    return []
                continue  # the heading changes in no time: ships are on the legs before and after it
            low, high = step.gone_m(np.array([first, last]), span)
            if low[0] <= high[1]:
                place = _Rectangle(self.legs[step.leg], step.begin_m + float(low[0]), step.begin_m + float(high[1]))
                found.append((i, place))
        return found


@dataclass(frozen=True, slots=True)
class _Area:
    """Convex parts (n,) of an area in the plane, each with a span and heights of its pieces."""

    polygons: NDArray[np.object_]
    pieces: Pieces

    def are_active(self, first_us: Floats, last_us: Floats) -> NDArray[np.bool_]:
        """Return (n, m) whether parts exist from before to after times (m,)."""
        start, end = (ends.astype(np.float64)[:, None] for ends in (self.pieces.start_us, self.pieces.end_us))
        return np.asarray((start < first_us) & (last_us < end))

    def share_heights(self, leg: _Leg) -> NDArray[np.bool_]:
        """Return (n,) whether parts overlap the heights of a ship."""
        floor_m, ceiling_m = leg.band_m
        low, high = self.pieces.floor_m + _ROUNDING_HEIGHT_M, self.pieces.ceiling_m - _ROUNDING_HEIGHT_M
        return np.asarray((floor_m < high) & (low < ceiling_m))


class _Proofs:
    """Tests of conflicts (n,) of a scene."""

    def __init__(self, setup: Setup, pieces: Pieces, plans: Plans, conflicts: Conflicts) -> None:
        self._scene, self._plane, self._pieces, self._conflicts = setup.scene, setup.plane, pieces, conflicts
        numbers = object_numbers(pieces)
        self._order = np.argsort(numbers, kind="stable")
        self._numbers = numbers[self._order]
        limited = np.unique(pieces.object_id[pieces.part >= OF_TOLERANCES])
        ids = np.concatenate([ids[kind == Kind.TRACK.code] for kind, ids in _members(conflicts)])
        self._plans = plans(np.intersect1d(ids, limited))
        self._row = {number: row for row, number in enumerate(self._plans.track_id.tolist())}
        self._limited = set(limited.tolist())
        self._tracks: dict[int, _Voyages | _Plan] = {}
        self._areas: dict[int, _Area] = {}

    def must(self, i: int) -> bool:
        """Return whether all voyages of a conflict are proven to conflict."""
        a, b = ((int(kind[i]), int(ids[i])) for kind, ids in _members(self._conflicts))
        if Kind.AREA.code in (a[0], b[0]):
            area, number = (a[1], b[1]) if a[0] == Kind.AREA.code else (b[1], a[1])
            track = self._track(number)
            return isinstance(track, _Voyages) and self._must_meet(track, self._area(area), i)
        return self._must_meet_each_other(self._track(a[1]), self._track(b[1]), i)

    def _track(self, number: int) -> _Voyages | _Plan:
        if number not in self._tracks:
            if number not in self._limited:
                found: _Voyages | _Plan = _Plan.of(self._plane, self._pieces_of(Kind.TRACK, number))
            elif number in self._row:
                track = self._plans.take(np.array([self._row[number]]))
                found = _Voyages.of(self._plane, track, 0.5 * self._scene.vertical_separation_m)
            else:  # it was removed meanwhile
                found = _Plan([], np.empty((0, 2), np.int64))
            self._tracks[number] = found
        return self._tracks[number]

    def _pieces_of(self, kind: Kind, number: int) -> Pieces:
        of = int(numbers_of(np.array([kind.code]), np.array([number]))[0])
        first, last = np.searchsorted(self._numbers, [of, of + 1])
        return self._pieces.take(self._order[first:last])

    def _area(self, number: int) -> _Area:
        if number not in self._areas:
            pieces = self._pieces_of(Kind.AREA, number)
            pieces = pieces.take(np.flatnonzero(pieces.part != COVER)[:_MOST_PARTS])
            piece_of = np.repeat(np.arange(len(pieces)), np.diff(pieces.shape_offset))
            rings = shapely.linearrings(pieces.shape_xy, indices=piece_of) if len(pieces) else np.empty(0, object)
            self._areas[number] = _Area(np.asarray(shapely.polygons(rings), dtype=object), pieces)
        return self._areas[number]

    def _instants(self, i: int) -> list[float]:
        """Return instants in the periods of a conflict, microseconds."""
        found, offset = self._conflicts, self._conflicts.period_offset
        periods = found.period_us[offset[i] : offset[i + 1]][:_MOST_PERIODS].astype(np.float64)
        shares = (np.arange(_INSTANTS) + 0.5) / _INSTANTS
        at_us: list[float] = (periods[:, :1] + shares * (periods[:, 1:] - periods[:, :1])).ravel().tolist()
        return at_us

    def _must_meet(self, track: _Voyages, area: _Area, i: int) -> bool:
        if not len(area.polygons):
            return False
        return any(
            self._gates_meet(track, area, at) for at, step in enumerate(track.passage.steps) if step.leg >= 0
        ) or any(self._places_meet(track, area, at_us) for at_us in self._instants(i))

    def _gates_meet(self, track: _Voyages, area: _Area, at: int) -> bool:
        """Return whether ships at a gate of a step conflict with an area, whenever they pass it."""
        step = track.passage.steps[at]
        leg = track.legs[step.leg]
        corridor = leg.ships(np.array([step.begin_m, step.end_m]), 1)
        within = shapely.convex_hull(shapely.geometrycollections(corridor.ravel())).buffer(self._span_m(corridor))
        polygons = self._beside(area.polygons, corridor)
        near = shapely.intersection(polygons, within)
        chosen = np.flatnonzero(area.share_heights(leg) & ~shapely.is_empty(near))
        if not len(chosen):
            return False
        corners, part = shapely.get_coordinates(near[chosen], return_index=True)
        beside = np.clip(leg.along_of(corners), step.begin_m, step.end_m)
        bounds = np.searchsorted(part, np.arange(len(chosen)))
        first, last = (extreme.reduceat(beside, bounds) for extreme in (np.minimum, np.maximum))
        gates = np.linspace(first, last, _GATES + 2)[1:-1]
        along = np.unique(gates)
        along = along[(step.begin_m < along) & (along < step.end_m)]
        is_active = area.are_active(*track.gate(at, along))[chosen]
        some = np.flatnonzero(is_active.any(axis=0))
        if not len(some):
            return False
        meets = self._meet(leg.ships(along[some], _CELLS), polygons[chosen], leg.width_m / _CELLS, leg.size_m)
        meets &= is_active[:, some, None]
        return bool(_met_cells(meets, 2).all(axis=1).any())

    def _places_meet(self, track: _Voyages, area: _Area, at_us: float) -> bool:
        """Return whether ships at all places of an instant conflict with an area."""
        at = np.array([at_us])
        is_active = area.are_active(at - _ROUNDING_US, at + _ROUNDING_US)[:, 0]
        places = track.places(at_us, at_us) if is_active.any() else []
        for place in places:
            leg, parts = place.leg, is_active & area.share_heights(place.leg)
            if not parts.any():
                return False
            ships = place.corners()
            polygons = self._beside(area.polygons[parts], ships)
            if not self._meet(ships, polygons, 0.0, leg.size_m).any(axis=0).all():
                return False
            ships = leg.ships(np.linspace(place.low_m, place.high_m, _CELLS + 1), _CELLS)
            if not _met_cells(self._meet(ships, polygons, place.across_m / _CELLS, leg.size_m), 1, 2).all():
                return False
        return bool(places)

    def _must_meet_each_other(self, one: _Voyages | _Plan, other: _Voyages | _Plan, i: int) -> bool:
        instants = self._instants(i)
        if any(self._all_meet(one.places(at, at), other.places(at, at)) for at in instants):
            return True
        return any(
            isinstance(track, _Voyages) and self._gate_meets(track, against, at)
            for track, against in ((one, other), (other, one))
            for at in instants
        )

    def _gate_meets(self, track: _Voyages, other: _Voyages | _Plan, at_us: float) -> bool:
        """Return whether ships at a gate where a track is about at a time meet those of another, when they pass it."""
        for i, place in track.numbered_places(at_us, at_us):
            step, along = track.passage.steps[i], 0.5 * (place.low_m + place.high_m)
            if not step.begin_m < along < step.end_m:
                continue
            first, last = (float(bound[0]) for bound in track.gate(i, np.array([along])))
            times = np.linspace(first, last, _CELLS + 1).tolist()
            gate = [_Rectangle(place.leg, along, along)]
            if all(self._all_meet(gate, other.places(*span)) for span in pairwise(times)):
                return True
        return False

    def _all_meet(self, places: list[_Rectangle], others: list[_Rectangle]) -> bool:
        """Return whether ships at all places of two tracks conflict with each other."""
        return bool(places and others) and all(self._rectangles_meet(a, b) for a in places for b in others)

    def _rectangles_meet(self, a: _Rectangle, b: _Rectangle) -> bool:
        (floor_m, ceiling_m), (low_m, high_m) = a.leg.band_m, b.leg.band_m
        if not (floor_m < high_m - _ROUNDING_HEIGHT_M and low_m + _ROUNDING_HEIGHT_M < ceiling_m):
            return False
        ships, others = a.corners(), b.corners().ravel()
        others = self._beside(others, ships)
        return bool(self._meet(ships, others, a.across_m + b.across_m, a.leg.size_m + b.leg.size_m).all())

    def _beside(self, polygons: NDArray[np.object_], ships: NDArray[np.object_]) -> NDArray[np.object_]:
        """Return polygons of the plane, shifted by whole turns to lie beside ships."""
        turn = self._plane.turn_m
        if not turn:
            return polygons
        west, _, east, _ = shapely.total_bounds(ships.ravel())
        bounds = shapely.bounds(polygons)
        turns = np.round((0.5 * (west + east) - 0.5 * (bounds[:, 0] + bounds[:, 2])) / turn)
        if not turns.any():
            return polygons
        east = np.repeat(turns * turn, shapely.get_num_coordinates(polygons))
        xy = shapely.get_coordinates(polygons)
        return np.asarray(shapely.set_coordinates(polygons.copy(), xy + np.stack([east, 0.0 * east], axis=1)))

    def _span_m(self, ships: NDArray[np.object_]) -> float:
        """Return the separation in the plane, at the largest scale of ships."""
        if self._scene.separation_m == 0.0:
            return 0.0
        corners = _corners(shapely.total_bounds(ships.ravel()))
        return float(self._plane.span_m(self._scene.separation_m, self._plane.largest_scale(corners))[0])

    def _meet(
        self, ships: NDArray[np.object_], polygons: NDArray[np.object_], cell_m: float, size_m: float
    ) -> NDArray[np.bool_]:
        """Return (n, *ships.shape) whether polygons (n,) conflict with ships, by a margin.

        cell_m : how far ships in between are from these, and the polygons move; size_m : of ships and moving polygons
        """
        bounds, grown_m = shapely.total_bounds(ships.ravel()), self._span_m(ships)
        corners = _corners(bounds + grown_m * np.array([-1.0, -1.0, 1.0, 1.0]))
        bend = _GNOMONIC_BEND
        if self._plane.turn_m:
            _, lat = self._plane.from_plane(corners[0, :, 0], corners[1, :, 0])
            bend = 1.0 + 2.0 * float(np.tan(np.radians(np.abs(lat).max())))
        margin_m = _ROUNDING_M + cell_m * (cell_m + size_m) * bend / MEAN_RADIUS_M
        scales = self._plane.smallest_scale(corners)[0], self._plane.largest_scale(corners)[0]
        limit = float(self._scene.separation_m * scales[0] - margin_m * scales[1])
        if not np.isfinite(limit):
            return np.zeros((len(polygons), *ships.shape), np.bool_)
        if limit < 0.0:
            polygons, limit = shapely.buffer(polygons, limit, join_style="mitre"), 0.0
        near = polygons.reshape(-1, *(1,) * ships.ndim)
        return np.asarray(shapely.dwithin(ships[None], near, limit))


def _met_cells(meets: NDArray[np.bool_], *axes: int) -> NDArray[np.bool_]:
    """Return which cells between neighbours along axes one polygon (axis 0) meets at all corners."""
    for axis in axes:
        if (n := meets.shape[axis]) > 1:
            meets = meets.take(np.arange(n - 1), axis) & meets.take(np.arange(1, n), axis)
    return np.asarray(meets.any(axis=0))


def _corners(bounds: Floats) -> Floats:
    """Return the corners of a box as points (2, 4, 1)."""
    west, south, east, north = bounds.tolist()
    return np.array([[west, east, east, west], [south, south, north, north]])[:, :, None]
