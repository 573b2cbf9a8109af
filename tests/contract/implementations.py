"""The motions that the tests in this folder run on: one row each, with the facts that tests need.

A new motion is one row of MOTIONS: a scene with it, the places it accepts, the geodesics of its earth, and an oracle
with independent formulas for positions. Methods have their table in `conflictdb.model.methods`, sources of pairs theirs
in `sources`, write-backs in `stores`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, Final, Protocol

import numpy as np
import oracle_circle
import oracle_motion
import pytest
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st
from pyproj import Geod
from scenes import FLATTENING, RADIUS_M, T0_US

from conflictdb import kernel
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.cutting import check_plane, track_pieces
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.kernel.kernel_scene import PieceState
from conflictdb.kernel.movement import Bounds, Movement
from conflictdb.model.plans import MAX_INSTANT_US, MIN_INSTANT_US, EarthModel, Motion, Scene, Track, rectangle_outline_m

Floats = np.ndarray
Place = tuple[float, float]

# Examples of each property for each row: in every run, and in the sweep.
QUICK: Final = 10
MANY: Final = 1500
# Instants in [t0, t1] at which a bound is compared with the exact value.
SAMPLES: Final = 65


def largest_size_m(track: Track) -> float:
    """The largest distance of a vertex from the reference point, metres on the earth."""
    return max(float(np.hypot(*outline.T).max()) for outline in oracle_motion.outlines(track))


class Oracle(Protocol):
    """Where things are, by formulas that share nothing with the package."""

    def project(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """Plane metres (n, 2) of places."""

    def course(self, start: Place, end: Place) -> tuple[float, float, float]:
        """Length and bearing at the start and the end of the way from one place to another."""

    def haven(self, track: Track, leg: int, fraction: Floats, *, reference: bool = False) -> Floats:
        """Plane metres (n, m, 2) of a haven's vertices (or its reference point alone) at fractions of a leg."""

    def rounding_m(self, track: Track) -> float:
        """Error of vertices on the earth, because the heading of a short leg has few digits here."""


@dataclass(frozen=True)
class RhumbOracle:
    """Rhumb lines and their Mercator plane, by quadrature of the meridian (`oracle_motion`)."""

    globe: oracle_motion.Globe

    def project(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        return self._plane(np.radians(lon_deg), np.radians(lat_deg))

    def course(self, start: Place, end: Place) -> tuple[float, float, float]:
        north, east = self.globe.between(start[1], end[1], end[0] - start[0])
        bearing = float(np.degrees(np.arctan2(east, north)))
        return float(np.hypot(north, east)), bearing, bearing

    def haven(self, track: Track, leg: int, fraction: Floats, *, reference: bool = False) -> Floats:
        one = oracle_motion.legs(self.globe, track)[leg]
        if reference:
            one = replace(one, outline_m=np.zeros((1, 2)), growth_m=np.zeros((1, 2)))
        return self._plane(*one.vertices(self.globe, one.outline_m, fraction))

    def rounding_m(self, track: Track) -> float:
        """Rounded places of both ends turn a short leg, and shift distant vertices.

        Latitudes are rounded to 2.2e-16 each, a difference of longitudes over 180 degrees to 5e-16.
        """
        (lon0, lat0), (lon1, lat1) = track.positions_deg
        size_m = largest_size_m(track)
        wrapped = abs(lon1 - lon0) > 180.0
        length_m = self.course((lon0, lat0), (lon1 - (np.copysign(360.0, lon1 - lon0) if wrapped else 0.0), lat1))[0]
        # However short the leg, no vertex is farther off than on the other side of the waypoint.
        ends_m = (9.5e-16 if wrapped else 4.5e-16) * self.globe.a
        return min(ends_m / length_m, 2.0) * size_m if length_m > 0.0 else 0.0

    def _plane(self, lon: Floats, lat: Floats) -> Floats:
        return self.globe.a * np.stack(np.broadcast_arrays(lon, self.globe.isometric(lat)), axis=-1)


@dataclass(frozen=True)
class CircleOracle:
    """Great circles as vectors in long double, and a plane that touches the sphere (`oracle_circle`)."""

    centre: Place

    def project(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        return self._chart.plane(oracle_circle.space(np.stack([lon_deg, lat_deg], axis=-1)))

    def course(self, start: Place, end: Place) -> tuple[float, float, float]:
        first, back, length = ROUND.inv(*start, *end)
        return length, first, back + 180.0

    def haven(self, track: Track, leg: int, fraction: Floats, *, reference: bool = False) -> Floats:
        one = oracle_circle.legs(track)[leg]
        if reference:
            one = replace(one, outline_m=np.zeros((1, 2)), growth_m=np.zeros((1, 2)))
        return self._chart.plane(one.vertices(fraction))

    def rounding_m(self, track: Track) -> float:
        size_m = largest_size_m(track)
        angle = float(oracle_circle.legs(track)[0].angle)
        if angle == 0.0:  # too short for long double: any heading
            return 0.0 if np.array_equal(*track.positions_deg) else 2.0 * size_m
        return 1e-18 * size_m / angle

    @property
    def _chart(self) -> oracle_circle.Chart:
        return oracle_circle.Chart.at(*self.centre)


@dataclass(frozen=True, repr=False, eq=False)
class MotionRow:
    """A motion, and all facts about it that the tests need.

    scene : has this motion
    geod : geodesics of its earth
    places : draws valid places of waypoints and corners, (longitude, latitude)
    beyond_deg, haven_beyond_deg : degrees past the limit for waypoints and for havens; below 0 inside
    oracle : independent positions
    has_seam : whether a turn of longitude leads to another place of the plane
    home : a place in the middle of the valid region, near the date line if there is a seam
    rim : a place at its limit
    """

    scene: Scene
    geod: Geod
    places: st.SearchStrategy[Place]
    beyond_deg: Callable[[Floats, Floats], Floats]
    haven_beyond_deg: Callable[[Floats, Floats], Floats]
    oracle: Oracle
    has_seam: bool
    home: Place
    rim: Place

    def __repr__(self) -> str:
        return repr(self.scene)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(repr(self))

    @property
    def plane(self) -> Plane:
        return Setup.of(self.scene).plane

    def xy(self, *places: Place) -> Floats:
        """Plane metres (2, v) of places, by the plane itself."""
        lon, lat = np.array(places).T
        return np.stack(self.plane.to_plane(lon, lat))

    def apart_m(self, a: Floats, b: Floats) -> Floats:
        """Geodesic distances between points (2, ...) of the plane."""
        ends = [np.stack(self.plane.from_plane(*xy)) for xy in (a, b)]
        shape = np.broadcast_shapes(*(end.shape for end in ends))
        (lon1, lat1), (lon2, lat2) = (np.broadcast_to(end, shape).reshape(2, -1) for end in ends)
        return np.asarray(self.geod.inv(lon1, lat1, lon2, lat2)[2]).reshape(shape[1:])

    def accepts(self, track: Track) -> bool:
        try:
            check_plane(self.plane, [], [track])
        except InvalidInput:
            return False
        return True


ROUND: Final = Geod(a=RADIUS_M[EarthModel.SPHERE], b=RADIUS_M[EarthModel.SPHERE])
LONGITUDES: Final = st.floats(-180, 180) | st.sampled_from([-180.0, 180.0, 179.9999999, 0.0, -90.0])


def _rhumb(earth: EarthModel) -> MotionRow:
    latitudes = st.floats(-89, 89) | st.sampled_from([0.0, 1e-9, 89.0, -89.0, 88.9999999, -60.0])
    return MotionRow(
        Scene("s", Motion.RHUMB, earth),
        Geod(a=RADIUS_M[earth], f=FLATTENING[earth]),
        st.tuples(LONGITUDES, latitudes),
        lambda lon, lat: np.abs(lat) - 89.0,
        # 89.5 degrees of rectifying latitude, which differs from the geographic one by half a minute of arc there.
        lambda lon, lat: np.abs(lat) - (89.5 if earth is EarthModel.SPHERE else 89.5026),
        RhumbOracle(oracle_motion.Globe.of(earth)),
        has_seam=True,
        home=(179.0, 55.0),
        rim=(-30.0, -89.0),
    )


def _circles(centre: Place) -> MotionRow:
    def place(bearing: float, away_deg: float) -> Place:
        lon, lat, _ = ROUND.fwd(*centre, bearing, np.radians(away_deg) * ROUND.a)
        return float(lon), float(lat)

    def beyond(lon: Floats, lat: Floats) -> Floats:
        lon, lat = np.broadcast_arrays(lon, lat)
        away_m = ROUND.inv(lon.ravel(), lat.ravel(), np.full(lon.size, centre[0]), np.full(lon.size, centre[1]))[2]
        return np.degrees(np.reshape(away_m, lon.shape) / ROUND.a) - 60.0

    return MotionRow(
        Scene("s", Motion.GREAT_CIRCLE, centre=centre),
        ROUND,
        st.builds(place, st.floats(0, 360), st.floats(0, 60) | st.sampled_from([0.0, 60.0, 1e-9, 59.9999999])),
        beyond,
        beyond,
        CircleOracle(centre),
        has_seam=False,
        home=place(40.0, 25.0),
        rim=place(100.0, 60.0),
    )


MOTIONS: Final[dict[str, MotionRow]] = {
    "rhumb, wgs84": _rhumb(EarthModel.WGS84),
    "rhumb, sphere": _rhumb(EarthModel.SPHERE),
    "circles about (20, 50)": _circles((20.0, 50.0)),
    "circles about the date line": _circles((-179.5, -35.0)),
    "circles about a pole": _circles((0.0, 90.0)),
}

every_motion = pytest.mark.parametrize("row", MOTIONS.values(), ids=list(MOTIONS))


def for_every_motion(
    *strategies: Callable[[MotionRow], st.SearchStrategy[Any]],
    fixed: Callable[[MotionRow], Sequence[tuple[Any, ...]]] | None = None,
) -> Callable[[Callable[..., None]], Any]:
    """Make a test of a property: run it for every motion, on examples drawn by the motion's strategies.

    fixed : examples that are tested before those; these tests share what they draw. The sweep (marked slow) draws more.
    """

    def tested(holds: Callable[..., None]) -> Any:
        @pytest.mark.parametrize("count", [QUICK, pytest.param(MANY, marks=pytest.mark.slow)], ids=["", "many"])
        @every_motion
        def test(row: MotionRow, count: int) -> None:
            for one in fixed(row) if fixed else ():
                holds(row, *one)
            if fixed and count == QUICK:
                for one in _shared(row, strategies):
                    holds(row, *one)
            else:
                _draw(row, strategies, count, lambda drawn: holds(row, *drawn))

        test.__name__, test.__doc__, test.__module__ = holds.__name__, holds.__doc__, holds.__module__
        return test

    return tested


Strategies = tuple[Callable[[MotionRow], st.SearchStrategy[Any]], ...]


def _draw(row: MotionRow, strategies: Strategies, count: int, example: Callable[[tuple[Any, ...]], None]) -> None:
    """Test examples: the same few in every run; the sweep draws others each time, unless a seed is given."""
    once = given(st.tuples(*(strategy(row) for strategy in strategies)))(example)
    settings(max_examples=count, derandomize=count < MANY, database=None)(once)()


@cache
def _shared(row: MotionRow, strategies: Strategies) -> list[tuple[Any, ...]]:
    """Return examples for several properties: drawing one, and moving it, takes longer than most properties."""
    found: list[tuple[Any, ...]] = []

    def example(drawn: tuple[Any, ...]) -> None:
        found.append(drawn)

    _draw(row, strategies, 2 * QUICK, example)
    return found


def near(place: Place, other: Place) -> Place:
    """The other place with a longitude within half a turn of this one's."""
    return place[0] + float(np.remainder(other[0] - place[0] + 180.0, 360.0)) - 180.0, float(other[1])


@st.composite
def places_apart(draw: st.DrawFn, row: MotionRow) -> tuple[Place, Place]:
    """Two places: anywhere, or some centimetres to some thousand kilometres apart."""
    one = draw(row.places)
    if draw(st.booleans()):
        return one, draw(row.places)
    way_m = 10.0 ** draw(st.floats(-1, 7))
    lon, lat, _ = row.geod.fwd(*one, draw(st.floats(0, 360)), way_m)
    assume(row.beyond_deg(np.array(lon), np.array(lat)) <= 0.0)
    # The way runs on over the seam.
    return one, near(one, (lon, lat))


# Half a turn (exactly) either way, short legs, long ones, along and across meridians, none at all.
STEPS_DEG: Final = st.sampled_from(
    [(0.0, 0.0), (0.0, 1e-9), (1e-9, 0.0), (3.0, 0.0), (0.0, -2.0), (40.0, 1.0), (180.0, 0.0)]
)
DURATIONS_US: Final = st.sampled_from([1, 1_000_000, 36_000_000_000, MAX_INSTANT_US - MIN_INSTANT_US])
SIZES_M: Final = st.sampled_from([0.0, 1.0, 100.0, 1e4, 1e5, 1e6, 4e6]) | st.floats(0, 3e5)


@st.composite
def outlines(draw: st.DrawFn) -> Floats:
    """Convex outlines (m, 2): a point at the reference point or away from it, a line, or a polygon around it or not."""
    fore, aft, port, starboard = (draw(SIZES_M) for _ in range(4))
    box = np.array([(-port, -aft), (starboard, -aft), (starboard, fore), (-port, fore)])
    kind = draw(st.sampled_from(["box", "box", "point", "line", "triangle", "kite"]))
    if kind == "point":
        return box[:1]
    if kind == "line":
        return box[[0, 2]] if np.any(box[0] != box[2]) else box[:1]
    if kind == "triangle":
        return box[:3] + np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
    if kind == "kite":
        return np.array([(0.0, -aft - 1.0), (starboard + 1.0, 0.0), (0.0, fore + 1.0), (-port - 1.0, 0.0)])
    return box + np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


@st.composite
def tracks(draw: st.DrawFn, row: MotionRow) -> Track:
    """Valid tracks of one leg: anywhere, of any size and duration, rigid or changing.

    An invalid draw is shrunk until it is valid; half of these go to the very limit.
    """
    start = draw(row.places)
    end = draw(row.places)
    step = draw(st.none() | STEPS_DEG)
    if step is not None:
        lon, lat = start[0] + step[0], start[1] + step[1]
        end = (lon, lat) if row.beyond_deg(np.array(lon), np.array(lat)) <= 0.0 else start
    duration_us = draw(DURATIONS_US)
    outline = draw(outlines())
    change = draw(st.sampled_from([None, None, "grow", "outlines"]))
    factors = draw(st.tuples(st.floats(0.1, 3), st.floats(0.1, 3)))
    speed = draw(st.sampled_from([1e-9, 1e-3, 1.0, 6.0]))

    def sized(share: float) -> Track:
        given = Track(
            "T", np.array([start, end]), np.array([T0_US, T0_US + duration_us]), share * outline, max_speed_kn=np.inf
        )
        if duration_us > 10**15:
            given = replace(given, times_us=np.array([MIN_INSTANT_US, MAX_INSTANT_US]), max_speed_kn=np.inf)
        if change == "outlines":
            # The largest of both is as large as it was.
            both = share * np.stack([outline, outline * factors]) / max(1.0, *factors)
            return replace(given, outline_m=both[0], outlines_m=both, max_speed_kn=np.inf)
        if change == "grow" and len(np.unique(outline, axis=0)) == len(outline):
            grow_mps = min(share * speed, share * 1e6 / (duration_us / 1e6))
            return replace(given, grow_mps=grow_mps, max_speed_kn=np.inf)
        return given

    try:
        return within_limits(row, sized, to_the_limit=draw(st.booleans()))
    except InvalidInput:
        reject()  # too sharp to grow


def within_limits(row: MotionRow, sized: Callable[[float], Track], *, to_the_limit: bool) -> Track:
    """The first of sized(1), sized(1/8), ... that is accepted; or nearly the largest one."""
    share = 1.0
    while not row.accepts(sized(share)):
        share = share / 8.0 if share > 1e-9 else 0.0
    if share < 1.0 and to_the_limit:
        low, high = share, 8.0 * share
        for _ in range(8):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if row.accepts(sized(middle)) else (low, middle)
        share = low
    return sized(share)


@dataclass(frozen=True, repr=False)
class Moving:
    """A haven on (a slice of) the one leg of a track, and a part of the slice to bound.

    movement : of one row
    into_leg_s : seconds of the leg that are gone at t = 0
    t0, t1 : within the slice
    """

    row: MotionRow
    track: Track
    pieces: Pieces
    piece: int
    t0: float
    t1: float
    origin: Floats = field(default_factory=lambda: np.zeros((2, 1)))

    def __repr__(self) -> str:
        # To the last digit, so that it can be had again.
        given = {name: getattr(self.track, name) for name in ("positions_deg", "times_us", "outline_m", "outlines_m")}
        exact = {name: None if array is None else array.tolist() for name, array in given.items()}
        which = f"piece {self.piece} of {len(self.pieces)}, {self.t0} to {self.t1} s, from {self.origin.tolist()}"
        return f"{exact}, growing {self.track.grow_mps} m/s, {which}"

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        # Hypothesis would print all arrays.
        printer.text(repr(self))

    @cached_property
    def movement(self) -> Movement:
        rows = np.array([self.piece])
        slots = int(np.diff(self.pieces.shape_offset)[self.piece])
        return Movement(self.prepared, rows, self.pieces.start_us[rows], self.origin, slots)

    @cached_property
    def prepared(self) -> kernel.KernelScene:
        return kernel.KernelScene(self.row.plane.kernel_plane, self.pieces)

    @property
    def is_convex(self) -> bool:
        state = self.prepared.states()[self.piece]
        assert state in (PieceState.CONVEX, PieceState.NONCONVEX), "what is accepted can be"
        return bool(state == PieceState.CONVEX)

    @cached_property
    def bounds(self) -> Bounds:
        """The kernel's bounds for [t0, t1]."""
        return self.movement.bounds(np.array([self.t0]), np.array([self.t1]))

    @property
    def leg_s(self) -> float:
        return float(self.pieces.leg_end_us[self.piece] - self.pieces.leg_start_us[self.piece]) / 1e6

    @property
    def into_leg_s(self) -> float:
        return float(self.pieces.start_us[self.piece] - self.pieces.leg_start_us[self.piece]) / 1e6

    @cached_property
    def seconds(self) -> Floats:
        return np.linspace(self.t0, self.t1, SAMPLES)

    @property
    def fractions(self) -> Floats:
        """Fractions of the leg gone at `seconds`."""
        return (self.into_leg_s + self.seconds) / self.leg_s

    @property
    def samples(self) -> Movement:
        """The haven, once for each of `seconds`."""
        return self.movement.take(np.zeros(SAMPLES, np.int64))

    @cached_property
    def positions(self) -> Floats:
        """Vertices (2, v, SAMPLES) in the plane at `seconds`, by the kernel."""
        return self.from_origin + self.origin[:, :, None]

    @cached_property
    def from_origin(self) -> Floats:
        return self.samples.positions(self.seconds)

    @property
    def step_s(self) -> float:
        """Step between consecutive `seconds`."""
        return float(self.seconds[1] - self.seconds[0])

    @cached_property
    def velocities(self) -> Floats:
        """Mean velocities (2, v, SAMPLES - 1) of the vertices between consecutive `seconds`."""
        return np.asarray(np.diff(self.from_origin, axis=2) / self.step_s)

    @cached_property
    def scale(self) -> float:
        """The largest scale that any vertex is seen at."""
        return float(self.row.plane.largest_scale(self.positions).max())


@st.composite
def moving(draw: st.DrawFn, row: MotionRow) -> Moving:
    """A haven on any part of a slice, or of a whole leg."""
    track = draw(tracks(row))
    pieces = track_pieces(Setup(row.scene, row.plane), TrackBatch.of([track]))
    if draw(st.booleans()):
        # Shapes exist for the time of their slices: here those are the whole legs.
        pieces = replace(pieces, start_us=pieces.leg_start_us, end_us=pieces.leg_end_us)
    piece = draw(st.integers(0, len(pieces) - 1))
    low, high = sorted([draw(st.sampled_from([0.0, 0.25]) | st.floats(0, 0.9)), draw(st.just(1.0) | st.floats(0.1, 1))])
    slice_s = float(pieces.end_us[piece] - pieces.start_us[piece]) / 1e6
    t0, t1 = low * slice_s, high * slice_s
    assume(t1 - t0 > 1e-3 * slice_s)
    here = Moving(row, track, pieces, piece, t0, t1)
    if draw(st.booleans()):
        return replace(here, origin=here.positions[:, :1, 0].copy())
    return here


def whole_leg(row: MotionRow, track: Track) -> Moving:
    """The haven of a track during its whole leg."""
    pieces = track_pieces(Setup(row.scene, row.plane), TrackBatch.of([track]))
    pieces = replace(pieces, start_us=pieces.leg_start_us, end_us=pieces.leg_end_us)
    return Moving(row, track, pieces, 0, 0.0, (track.times_us[1] - track.times_us[0]) / 1e6)


@cache
def extremes(row: MotionRow) -> list[tuple[Moving]]:
    """Whole legs: ordinary ones, and those at the limits of validity."""
    return [(haven,) for haven in _extremes(row)]


def _extremes(row: MotionRow) -> Iterator[Moving]:
    hours, ever = 36_000_000_000, MAX_INSTANT_US - MIN_INSTANT_US
    (lon, lat), (rim_lon, rim_lat) = row.home, row.rim
    on, back = (lon + 5.0, lat - 3.0), (0.7 * lon + 0.3 * rim_lon, 0.7 * lat + 0.3 * rim_lat)
    box = rectangle_outline_m(1e5, 5e4, 3e4, 8e4)
    aside = np.array([(4e5, 3e5)])
    # Convex by a metre in the middle of each side, which neither plane shows.
    dents = 1e5 * np.array([(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)])
    dents[1::2] *= 1.00001
    for start, end, outline, duration_us, grown_m in (
        (row.home, on, box, hours, 0.0),
        (row.home, on, box, hours, 3e4),
        (row.home, row.home, box, hours, 1e5),  # a loiter
        (row.home, on, aside, hours, 0.0),
        (row.home, on, np.zeros((1, 2)), ever, 2e4),
        (row.home, row.rim, box, 1, 0.0),
        (row.rim, back, 100.0 * box, ever, 0.0),
        (row.rim, row.home, 100.0 * box, hours, 1e6),
        (row.rim, row.rim, 100.0 * box, 1, 0.0),
        (row.home, on, dents, hours, 0.0),
        (row.rim, row.rim, np.array([(-4e6, -28801.0)]), 1, 0.0),  # eight times around the pole
    ):
        start_us = MIN_INSTANT_US if duration_us == ever else T0_US

        def sized(share: float) -> Track:
            times_us = np.array([start_us, start_us + duration_us])  # noqa: B023
            speed = share * grown_m / (duration_us / 1e6)  # noqa: B023
            return Track("T", np.array([start, end]), times_us, share * outline, grow_mps=speed, max_speed_kn=np.inf)  # noqa: B023

        yield whole_leg(row, within_limits(row, sized, to_the_limit=True))
    if row.has_seam:
        # Over the seam by the last digit of a longitude, which a difference of both rounds away.
        for start_deg in (-180.0, 180.0):
            places = np.array([(start_deg, 57.0), (-np.nextafter(start_deg, 0.0), 57.0)])
            box = rectangle_outline_m(1.0, 1.0, 1.0, 1.0)
            yield whole_leg(row, Track("T", places, np.array([T0_US, T0_US + 1]), box, max_speed_kn=np.inf))
