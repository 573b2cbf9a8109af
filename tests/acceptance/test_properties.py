"""Changes that must not change an answer: place and time of a scene, order and form of its objects, other objects.

Random scenes are solved, changed in a way that leaves the motion as it is (or mirrors it), and solved again. The pairs
and their verdicts stay the same, periods agree up to the reported bounds, and a first contact lies in both polygons. No
oracle is needed, so the scenes may be of any size.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import oracle
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from layouts import WORKLOADS
from mixed_scenes import plain_scene
from oracle_motion import Globe
from scenes import T0_US
from verdicts import periods_us
from wild import throw_wild

from conflictdb import solve
from conflictdb.errors import InvalidInput
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track
from conflictdb.model.results import Verdict

# The changes below assume rhumb lines.
RHUMB: Final = [workload for workload in WORKLOADS if workload.motion is Motion.RHUMB]
CERTIFIED: Final = [method for method in Method if method is not Method.SCREEN]
OBJECTS: Final = 3  # areas, and as many tracks
ROUNDING_US: Final = 3.0  # each answer is rounded outward to the microsecond, and leaves this much over
# Coordinates are rounded to 3 nm, a distance on the earth to a millimetre in 100 km: of that a slow pair makes this.
SEPARATION_US: Final = 1e5
PLACE_M: Final = 0.1  # rounding error of places, with room to spare
INSTANT_S: Final = 1e-6  # resolution of instants

Pair = tuple[str, str]


@dataclass(frozen=True)
class Found:
    """The fields of a conflict that are compared; periods in microseconds."""

    a_key: str
    b_key: str
    verdict: Verdict
    periods_us: tuple[tuple[float | None, float | None], ...]
    time_error_s: float
    first_contact_deg: tuple[float, float] | None


Answer = dict[Pair, Found]
Period = tuple[float, float]


@dataclass(frozen=True)
class Thrown:
    """A scene and its objects."""

    scene: Scene
    areas: list[Area]
    tracks: list[Track]

    def answer(self) -> Answer:
        found = [
            Found(c.a_key, c.b_key, c.verdict, periods_us(c), c.time_error_s, c.first_contact_deg)
            for c in solve(self.tracks, self.areas, self.scene)
        ]
        return {(one.a_key, one.b_key): one for one in found}


@st.composite
def thrown(draw: st.DrawFn, ordinary: bool) -> Thrown:
    """A random scene of rhumb lines; without the slow ones if it shall be ordinary."""
    seed = draw(st.integers(0, 10**6))
    earth = draw(st.sampled_from(EarthModel))
    limits = [(1.0, 0.0), (0.0, 0.0), (50.0, 0.0), (0.0, 500.0), (0.0, 9260.0)]
    tolerance_m, separation_m = draw(st.sampled_from(limits[:3] if ordinary else limits))
    workload = draw(st.sampled_from(RHUMB if ordinary else [*RHUMB, None]))
    if workload is None:
        return Thrown(*throw_wild(seed, OBJECTS))
    if workload.window < 0.1:
        separation_m /= 100.0
    return Thrown(*plain_scene(workload, seed, OBJECTS, OBJECTS, earth, tolerance_m, separation_m))


# Changes of a scene: each returns the changed scene, and a function that turns its answer back.

Back = Callable[[Answer], Answer]
Change = Callable[[Thrown, st.DataObject], tuple[Thrown, Back]]


def shift_longitudes(before: Thrown, data: st.DataObject) -> tuple[Thrown, Back]:
    by = data.draw(st.sampled_from([360.0, -180.0, 90.0]) | st.floats(-180.0, 180.0), "degrees east")

    def area(one: Area) -> Area:
        middle = shapely.get_coordinates(one.footprint)[:, 0].mean() + by
        turn = by - 360.0 * np.round(middle / 360.0)
        return replace(one, footprint=shapely.transform(one.footprint, lambda xy: xy + np.array([turn, 0.0])))

    def track(one: Track) -> Track:
        lon = one.positions_deg[:, 0] + by
        lon = lon - 360.0 * np.round(lon / 360.0)
        return replace(one, positions_deg=np.stack([lon, one.positions_deg[:, 1]], axis=1))

    return changed(before, area, track), places(lambda lon, lat: (lon - by, lat))


def mirror(before: Thrown, data: st.DataObject) -> tuple[Thrown, Back]:
    """North becomes south, and starboard becomes port. An object that never moves heads north in both worlds."""

    def area(one: Area) -> Area:
        return replace(one, footprint=shapely.transform(one.footprint, lambda xy: xy * np.array([1.0, -1.0])))

    def track(one: Track) -> Track:
        turned = np.array([-1.0, 1.0]) if moves(one).any() else np.array([1.0, -1.0])
        return with_outlines(
            replace(one, positions_deg=one.positions_deg * np.array([1.0, -1.0])), lambda outlines: outlines * turned
        )

    return changed(before, area, track), places(lambda lon, lat: (lon, -lat))


def shift_time(before: Thrown, data: st.DataObject) -> tuple[Thrown, Back]:
    by = data.draw(st.integers(-(10**16), 10**16), "microseconds")
    return in_time(before, lambda us: us + by), periods(lambda start, end: (start - by, end - by))


def reverse_time(before: Thrown, data: st.DataObject) -> tuple[Thrown, Back]:
    """Tracks are sailed back, stern first. A loiter keeps the heading before it, another one then: such tracks go.

    So do havens that grow from the start of the track on, for none shrink towards its end.
    """

    def backwards(outlines: np.ndarray) -> np.ndarray:
        return outlines[::-1]

    def astern(outlines: np.ndarray) -> np.ndarray:
        return -outlines[::-1]

    tracks = [
        with_outlines(one, astern if moves(one).any() else backwards)
        for one in before.tracks
        if not one.grow_mps and (moves(one).all() or not moves(one).any())
    ]
    after = in_time(replace(before, tracks=tracks), lambda us: 2 * T0_US - us)
    return after, periods(lambda start, end: (2 * T0_US - end, 2 * T0_US - start))


def swap(before: Thrown, data: st.DataObject) -> tuple[Thrown, Back]:
    """Keys in the opposite order: a and b of a pair swap."""
    names = {one.key: one.key[0] + chr(ord("9") - int(one.key[1:])) for one in (*before.areas, *before.tracks)}
    old = {new: key for key, new in names.items()}

    def back(answer: Answer) -> Answer:
        return {
            (a, b): replace(one, a_key=a, b_key=b)
            for one in answer.values()
            for a, b in [sorted([old[one.a_key], old[one.b_key]])]
        }

    return changed(before, *2 * [lambda one: replace(one, key=names[one.key])]), back


def split_legs(before: Thrown, data: st.DataObject) -> tuple[Thrown, Back]:
    """A waypoint more on a leg of every track, somewhere on its rhumb line and at its time."""
    globe = Globe.of(before.scene.earth)

    def track(one: Track) -> Track:
        leg = data.draw(st.integers(0, len(one.times_us) - 2), f"leg of {one.key}")
        start, end = one.times_us[leg : leg + 2].tolist()
        at = start + int((end - start) * data.draw(st.floats(0.001, 0.999), "fraction"))
        motion = oracle.legs(globe, one)[leg]
        length, size = np.hypot(motion.north_m, motion.east_m), np.abs(one.outline_m).max()
        part = (at - start) / (end - start)
        # Rounding of a waypoint turns a short leg, and a large haven with it.
        if at in (start, end) or 0.0 < length * min(part, 1.0 - part) < 0.1 * size:
            return one
        point = one.positions_deg[leg]
        if length > 0.0:
            point = np.degrees(globe.step(motion.lon, motion.lat, part * motion.north_m, part * motion.east_m))
            point[0] -= 360.0 * np.round(point[0] / 360.0)
            same = one.positions_deg[leg] == one.positions_deg[leg + 1]
            point = np.where(same, one.positions_deg[leg], point)
        positions = np.insert(one.positions_deg, leg + 1, point, axis=0)
        return replace(one, positions_deg=positions, times_us=np.insert(one.times_us, leg + 1, at))

    return changed(before, lambda one: one, track), dict


def split_areas(before: Thrown, data: st.DataObject) -> tuple[Thrown, Back]:
    """Every area is cut in two along a line; an object that meets a part of it meets it."""
    globe = Globe.of(before.scene.earth)
    areas = []
    for one in before.areas:
        flat = oracle.plane(globe, one.footprint, 0.0)
        west, south, east, north = flat.bounds
        across = data.draw(st.floats(0.05, 0.95), f"where {one.key} is cut")
        slope = data.draw(st.sampled_from([0.0, 1.0, -0.3]), "how oblique")
        width, far = east - west, 2.0 * (east - west + north - south)
        foot, head = west + (across - slope / 2) * width, west + (across + slope / 2) * width
        side = shapely.Polygon([(foot, south), (head, north), (head - far, north), (foot - far, south)])
        for name, part in (("west", flat.intersection(side)), ("east", flat.difference(side))):
            polygons = [p for p in shapely.get_parts(part) if isinstance(p, shapely.Polygon) and p.area > 0.0]
            if polygons:
                round_ = shapely.transform(shapely.MultiPolygon(polygons), lambda xy: unplane(globe, xy))
                areas.append(replace(one, key=f"{one.key} {name}", footprint=round_))

    def back(answer: Answer) -> Answer:
        found: dict[Pair, list[Found]] = {}
        for one in answer.values():
            a, b = (key.split()[0] for key in (one.a_key, one.b_key))
            if a != b:
                found.setdefault((a, b), []).append(one)
        return {pair: together(pair, parts) for pair, parts in found.items()}

    return replace(before, areas=areas), back


def add_far_objects(before: Thrown, data: st.DataObject) -> tuple[Thrown, Back]:
    """Objects at other times, at other heights and in other places: conflicts of the first objects stay the same."""
    seed = data.draw(st.integers(0, 10**6), "seed of what is far")
    _, areas, tracks = plain_scene(data.draw(st.sampled_from(WORKLOADS), "workload of what is far"), seed, 3, 3)
    century = 3_155_760_000_000_000
    areas = [replace(one, key=f"Z{one.key}", start_us=T0_US - century, end_us=T0_US - century + 10) for one in areas]
    later = [replace(one, key=f"Z{one.key}", times_us=one.times_us + 5 * century) for one in tracks]
    keys = {one.key for one in (*before.areas, *before.tracks)}
    after = replace(before, areas=[*areas, *before.areas], tracks=[*later, *before.tracks])
    return after, lambda answer: {pair: one for pair, one in answer.items() if keys.issuperset(pair)}


CHANGES: Final[tuple[Change, ...]] = (
    shift_longitudes, mirror, shift_time, reverse_time, swap, split_legs, split_areas, add_far_objects,
)  # fmt: skip


# Building blocks of the changes.


def moves(track: Track) -> np.ndarray:
    """Which legs of a track lead to another place."""
    return np.any(np.diff(track.positions_deg, axis=0) != 0.0, axis=1)


def with_outlines(track: Track, change: Callable[[np.ndarray], np.ndarray]) -> Track:
    """The outlines at all waypoints, (n, v, 2), changed; of a rigid haven there is one."""
    if track.outlines_m is None:
        return replace(track, outline_m=change(track.outline_m[None])[0])
    outlines = change(track.outlines_m)
    return replace(track, outline_m=outlines[0], outlines_m=outlines)


def changed(before: Thrown, area: Callable[[Area], Area], track: Callable[[Track], Track]) -> Thrown:
    return replace(before, areas=[area(one) for one in before.areas], tracks=[track(one) for one in before.tracks])


def in_time(before: Thrown, change: Callable[[int], int]) -> Thrown:
    """Every instant changed; spans of areas that then run backwards are turned round."""

    def area(one: Area) -> Area:
        start, end = (None if us is None else change(us) for us in (one.start_us, one.end_us))
        if change(1) < change(0):
            start, end = end, start
        return replace(one, start_us=start, end_us=end)

    def track(one: Track) -> Track:
        times = np.array([change(us) for us in one.times_us.tolist()], dtype=np.int64)
        order = np.argsort(times)
        return replace(one, times_us=times[order], positions_deg=one.positions_deg[order])

    return changed(before, area, track)


def unplane(globe: Globe, xy: np.ndarray) -> np.ndarray:
    """Plane coordinates in degrees."""
    return np.degrees(np.stack([xy[:, 0] / globe.a, globe.latitude_of_isometric(xy[:, 1] / globe.a)], axis=-1))


def places(change: Callable[[float, float], tuple[float, float]]) -> Back:
    def back(answer: Answer) -> Answer:
        return {
            pair: replace(one, first_contact_deg=one.first_contact_deg and change(*one.first_contact_deg))
            for pair, one in answer.items()
        }

    return back


def periods(change: Callable[[float, float], Period]) -> Back:
    """Turn periods back; the first of them may be another one, so that its place is not compared."""

    def back(answer: Answer) -> Answer:
        return {
            pair: replace(one, periods_us=tuple(sorted(change(*p) for p in bounded(one))), first_contact_deg=None)
            for pair, one in answer.items()
        }

    return back


def together(pair: Pair, parts: Sequence[Found]) -> Found:
    """The conflicts of several parts of an object, merged."""
    verdicts = [one.verdict for one in parts]
    found = [v for v in (Verdict.CONFLICT, Verdict.UNRESOLVED, Verdict.GRAZING) if v in verdicts]
    return replace(
        min(parts, key=lambda one: bounded(one)[0][0]),
        a_key=pair[0],
        b_key=pair[1],
        verdict=found[0],
        periods_us=tuple(p for one in parts for p in one.periods_us),
        time_error_s=max(one.time_error_s for one in parts),
    )


def bounded(one: Found) -> list[Period]:
    """The periods in microseconds, infinite where unbounded."""
    return [(-np.inf if s is None else s, np.inf if e is None else e) for s, e in one.periods_us]


# The comparison.


def differences(before: Thrown, one: Answer, two: Answer, cut: bool) -> Iterable[str]:
    """Yield differences of two answers to the same scene; `cut`: the second is about areas cut in two."""
    for pair in sorted(one.keys() | two.keys()):
        if pair not in one or pair not in two:
            yield f"{pair}: only {'before' if pair in one else 'after'}: {one.get(pair) or two.get(pair)}"
            continue
        a, b = one[pair], two[pair]
        # Parts of an area may be too narrow for a contact that is deep in the whole area.
        shallower = cut and (a.verdict, b.verdict) == (Verdict.CONFLICT, Verdict.GRAZING)
        if a.verdict is not b.verdict and not shallower:
            yield f"{pair}: {a.verdict} before, {b.verdict} after: {a} {b}"
            continue
        if a.verdict is b.verdict is Verdict.CONFLICT:
            allowed = 1e6 * (a.time_error_s + b.time_error_s) + ROUNDING_US
            allowed += SEPARATION_US if before.scene.separation_m else 0.0
            mine, theirs = (joined(bounded(answer), 2 * allowed) for answer in (a, b))
            if before.scene.method is Method.NLP:  # may pass over a gap within a contact
                mine, theirs = ([(p[0][0], p[-1][1])] for p in (mine, theirs))
            if len(mine) != len(theirs):
                yield f"{pair}: {len(mine)} periods before, {len(theirs)} after: {a} {b}"
            elif any(
                x != y and abs(x - y) > allowed
                for p, q in zip(mine, theirs, strict=True)
                for x, y in zip(p, q, strict=True)
            ):
                yield f"{pair}: {a} before, {b} after"
            yield from (f"{pair}: {line}" for line in misplaced(before, a, b))


def joined(spans: list[Period], gap: float) -> list[Period]:
    """Join periods if the gap between them is within the error of the answers."""
    spans = sorted(spans)
    found = spans[:1]
    for start, end in spans[1:]:
        if start - found[-1][1] <= gap:
            found[-1] = found[-1][0], max(end, found[-1][1])
        else:
            found.append((start, end))
    return found


def misplaced(before: Thrown, a: Found, b: Found) -> Iterable[str]:
    """First contacts of the changed scene that lie neither in nor within the separation of both original objects."""
    start = a.periods_us[0][0]
    if b.first_contact_deg is None or start is None:
        return
    lon, lat = b.first_contact_deg
    lon -= 360.0 * np.round(lon / 360.0)
    globe = Globe.of(before.scene.earth)
    scale = globe.a / globe.across_m(np.radians(lat))
    objects: dict[str, Area | Track] = {one.key: one for one in (*before.areas, *before.tracks)}
    here = shapely.Point(0.0, globe.a * globe.isometric(np.radians(lat)))
    # Wild tracks are faster than aircraft.
    speed_mps = max([50.0, *(fastest_mps(globe, one) for one in before.tracks if one.key in (a.a_key, a.b_key))])
    late_s = a.time_error_s + b.time_error_s + INSTANT_S
    room_m = (PLACE_M + speed_mps * late_s + before.scene.separation_m * 1.01) * scale
    for key in (a.a_key, a.b_key):
        apart = [here.distance(p) for p in oracle.polygons_at(before.scene, objects[key], start, lon)]
        if min(apart, default=np.inf) > room_m:
            yield f"first contact {b.first_contact_deg} is {apart} m from {key}, before: {a}, after: {b}"


def fastest_mps(globe: Globe, track: Track) -> float:
    lasts_s = np.diff(track.times_us) / 1e6
    return max(np.hypot(leg.north_m, leg.east_m) / s for leg, s in zip(oracle.legs(globe, track), lasts_s, strict=True))


def check(change: Change, method: Method, before: Thrown, data: st.DataObject) -> None:
    """Solve, change, solve again, and compare."""
    before = replace(before, scene=replace(before.scene, method=method))
    try:
        after, back = change(before, data)
        if change is reverse_time:
            keys = {one.key for one in after.tracks}
            before = replace(before, tracks=[one for one in before.tracks if one.key in keys])
        one = before.answer()
        assume(one)
        two = back(after.answer())
    except InvalidInput:  # the changed scene may not fit the plane, although the first does
        assume(False)
    assert not list(differences(before, one, two, cut=change is split_areas))


def run(change: Change, method: Method, profile: settings, ordinary: bool) -> None:
    @settings(profile, print_blob=True)
    @given(before=thrown(ordinary), data=st.data())
    def same(before: Thrown, data: st.DataObject) -> None:
        check(change, method, before, data)

    same()


changes = pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
methods = pytest.mark.parametrize("method", CERTIFIED)


@changes
def test_same_answer(change: Change) -> None:
    """The same scenes every time, by the default method."""
    run(change, Method.EXACT, settings(max_examples=10, derandomize=True, database=None), ordinary=False)


@pytest.mark.slow
@methods
@changes
def test_same_answer_sweep(change: Change, method: Method) -> None:
    run(change, method, settings(max_examples=40 if method is Method.NLP else 1000), ordinary=False)


def test_a_difference_is_seen() -> None:
    """The comparison itself: a verdict, a pair, an end, a period and a place that are not the same."""
    before = Thrown(*plain_scene(WORKLOADS[0], 2, OBJECTS, OBJECTS))
    one = before.answer()
    pair = next(p for p, found in one.items() if found.verdict is Verdict.CONFLICT and found.periods_us[0][0])
    found = one[pair]
    (start, end), *rest = found.periods_us
    assert start is not None
    assert end is not None
    assert not list(differences(before, one, one, cut=False))
    for other in (
        replace(found, verdict=Verdict.GRAZING),
        replace(found, periods_us=((start, end + 5_000_000), *rest)),
        replace(found, periods_us=((start - 1_000_000, start - 900_000), (start, end), *rest)),
        replace(found, first_contact_deg=(0.0, 80.0)),
    ):
        assert list(differences(before, one, {**one, pair: other}, cut=False)), other
    assert list(differences(before, one, {p: x for p, x in one.items() if p != pair}, cut=False))
    assert all(a[1] < b[0] for a, b in pairwise(joined([(5.0, 6.0), (0.0, 1.0), (1.5, 2.0)], 1.0)))
