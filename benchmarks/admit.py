"""Admit city flights one by one: how many, how fast, and whether any is refused without need.

    ./run python benchmarks/admit.py [FLIGHTS ...] [--stored] [--probed N] [--forms FORM ...] [--motions MOTION ...]

Flights of 2 to 8 km with one bend, in 20 km by 20 km within 4 hours, at 15 m/s. A flight is some six volumes (legs of a
kilometre at most, 50 m to every side, 20 m high, 10 s before and after), or a track whose haven is as uncertain. They
are requested until a given number is accepted, then 40 more. Before the last 1,000 (--probed) that are accepted, brute
force alone decides.

- box: the flight's bounding box in space and time, the algorithm of a UTM server's own engine (openutm/flight-blender)
- index: `Index.probe` and `put`
- solve: `solve` of all accepted volumes and the new ones
- stored: `scene.admit` and the function admit of SQL, in the embedded database, of 40 flights among the accepted ones,
  which a detection has seen. Plans that a worker must decide: by the clock, from the call of admit to its answer
- motions: processor time of `solve` of 20 tracks on great circles, as a multiple of that on rhumb lines
- memory: of an index of as many random flights, and of their plans themselves, in a process of its own

Brute force compares a flight with every accepted one whose box in space, time and height it meets, on a plane: volumes
as polygons, which it maps straight; tracks by the Minkowski sum of both havens and the line of their relative motion.
Its metres are true to 0.5 %, so pairs of tracks count only if havens 3 m closer or further apart give the same answer.
Times are processor milliseconds of this process, of `stored` with those of its backend, median and 95 %. Processor time
grows with the machine's load, too: `beat` is that of a fixed loop of Python, 0.9 ms where it was quiet.
"""

import argparse
import ctypes
import gc
import json
import math
import resource
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import measured
import numpy as np
import shapely
from numpy.typing import NDArray

import conflictdb
from conflictdb import Area, Index, Scene, Track, rectangle_outline_m, solve
from conflictdb.formats.scene_file import feature_of
from conflictdb.store import service

if TYPE_CHECKING:
    import psycopg

T0_US = 1_906_520_400_000_000
LAT, LON, M_LAT = 47.0, 8.0, 111_195.0
M_LON = M_LAT * math.cos(math.radians(LAT))
CITY_M, HOURS, SPEED_MPS = 20_000.0, 4.0, 15.0
HALF_WIDTH_M, LATE_S, BAND_M, LEG_M = 50.0, 10.0, 10.0, 1000.0
ASKED_MORE = 40
PROBED = 1000
AHEAD_M = 200.0
UNSURE_M = 3.0
Floats = NDArray[np.float64]
ANSWERS = (True, "admitted"), (False, "refused"), (None, "undecided")


class Box(NamedTuple):
    """A volume in metres and seconds, for brute force."""

    shape: shapely.Polygon
    start_s: float
    end_s: float
    floor_m: float
    ceiling_m: float

    def meets(self, other: "Box") -> bool:
        """Return whether two volumes share a place, an instant and a height."""
        return (
            self.start_s < other.end_s
            and other.start_s < self.end_s
            and self.floor_m < other.ceiling_m
            and other.floor_m < self.ceiling_m
            and bool(self.shape.intersects(other.shape))
        )


class Leg(NamedTuple):
    """A leg of a flight, metres and seconds, for brute force."""

    start_m: Floats
    end_m: Floats
    start_s: float
    end_s: float

    def at(self, seconds: float) -> Floats:
        """Return the position at a time."""
        return self.start_m + (seconds - self.start_s) / (self.end_s - self.start_s) * (self.end_m - self.start_m)

    def haven(self) -> Floats:
        """Return the corners of the haven about the position."""
        ahead = (self.end_m - self.start_m) / np.hypot(*(self.end_m - self.start_m))
        across = np.array([ahead[1], -ahead[0]])
        return np.array([f * AHEAD_M * ahead + s * HALF_WIDTH_M * across for f in (-1, 1) for s in (-1, 1)])

    def clearance_m(self, other: "Leg") -> float:
        """Return the least distance between the havens while both fly; negative: they meet by more than UNSURE_M."""
        start, end = max(self.start_s, other.start_s), min(self.end_s, other.end_s)
        if start >= end:
            return math.inf
        both = shapely.MultiPoint((self.haven()[:, None] - other.haven()[None]).reshape(-1, 2)).convex_hull
        moves = shapely.LineString([other.at(t) - self.at(t) for t in (start, end)])
        if not moves.intersects(both):
            return float(moves.distance(both))
        return -UNSURE_M if moves.intersects(both.buffer(-UNSURE_M)) else 0.0


@dataclass
class Flight:
    """A flight as volumes or as a track, made when they are first asked for; volumes and legs for brute force."""

    make: Callable[[], list[Area] | list[Track]]
    boxes: list[Box]
    legs: list[Leg]

    @cached_property
    def plans(self) -> list[Area] | list[Track]:
        """Return what is admitted."""
        return self.make()

    def clearance_m(self, other: "Flight") -> float:
        """Return how far apart two tracks are, at their least."""
        if self.boxes[0].floor_m >= other.boxes[0].ceiling_m or other.boxes[0].floor_m >= self.boxes[0].ceiling_m:
            return math.inf
        return min(a.clearance_m(b) for a in self.legs for b in other.legs)


def degrees(x: float, y: float) -> tuple[float, float]:
    """Return longitude and latitude of metres east and north of the city's corner."""
    return LON + x / M_LON, LAT + y / M_LAT


def instant(seconds: float) -> np.datetime64:
    """Return the instant a number of seconds after the beginning."""
    return np.datetime64(T0_US + round(seconds * 1e6), "us")


def course(rng: np.random.Generator) -> tuple[list[tuple[float, float, float]], float]:
    """Return waypoints (x, y, seconds) of a flight with one bend, and its height."""
    while True:
        length, bearing = rng.uniform(2000, 8000), rng.uniform(0, 2 * math.pi)
        x, y, s = *rng.uniform(0, CITY_M, 2).tolist(), 0.0
        points = [(x, y, s)]
        for turn in (0.0, rng.uniform(-0.8, 0.8)):
            x += 0.5 * length * math.sin(bearing + turn)
            y += 0.5 * length * math.cos(bearing + turn)
            s += 0.5 * length / SPEED_MPS
            points.append((x, y, s))
        if all(0 <= p[0] <= CITY_M and 0 <= p[1] <= CITY_M for p in points):
            begin = rng.uniform(0, HOURS * 3600 - s)
            return [(x, y, begin + t) for x, y, t in points], float(rng.uniform(50, 110))


def flight(rng: np.random.Generator, key: str, form: str) -> Flight:
    """Return a random flight."""
    points, height_m = course(rng)
    band = height_m - BAND_M, height_m + BAND_M
    boxes, rings = [], []
    for (x0, y0, t0), (x1, y1, t1) in pairwise(points):
        n = math.ceil(math.hypot(x1 - x0, y1 - y0) / LEG_M)
        for i in range(n):
            ax, ay, bx, by = (a + (b - a) * f / n for f in (i, i + 1) for a, b in ((x0, x1), (y0, y1)))
            length = math.hypot(bx - ax, by - ay)
            ux, uy = HALF_WIDTH_M * (bx - ax) / length, HALF_WIDTH_M * (by - ay) / length
            ring = [(ax - ux - uy, ay - uy + ux), (ax - ux + uy, ay - uy - ux)]
            ring += [(bx + ux + uy, by + uy - ux), (bx + ux - uy, by + uy + ux)]
            start, end = t0 + (t1 - t0) * i / n - LATE_S, t0 + (t1 - t0) * (i + 1) / n + LATE_S
            rings.append(ring)
            boxes.append(Box(shapely.Polygon(ring), start, end, *band))

    def volumes() -> list[Area]:
        return [
            Area(f"{key}#{i}", [degrees(*p) for p in ring], None, instant(box.start_s), instant(box.end_s), *band)  # type: ignore[arg-type]
            for i, (ring, box) in enumerate(zip(rings, boxes, strict=True))
        ]

    def track() -> list[Track]:
        outline = rectangle_outline_m(AHEAD_M, AHEAD_M, HALF_WIDTH_M, HALF_WIDTH_M)
        times = np.array([instant(t) for *_, t in points])
        return [Track(key, [degrees(x, y) for x, y, _ in points], times, outline, None, *band)]

    if form == "volumes":
        return Flight(volumes, boxes, [])
    return Flight(track, boxes, [Leg(np.array(p[:2]), np.array(q[:2]), p[2], q[2]) for p, q in pairwise(points)])


def box_of(boxes: Sequence[Box]) -> tuple[float, ...]:
    """Return west, south, east, north, start and end of a flight."""
    west, south, east, north = shapely.total_bounds([one.shape for one in boxes]).tolist()
    return west, south, east, north, min(one.start_s for one in boxes), max(one.end_s for one in boxes)


class Bounds:
    """The outer boxes of accepted flights (n, 8), for brute force: which of them it must look at."""

    def __init__(self, most: int) -> None:
        self._all, self._count = np.empty((most, 8)), 0

    @staticmethod
    def of(one: Flight) -> Floats:
        """Return west, south, start and floor of a flight, then the other ends negated; of a track, padded."""
        west, south, east, north, start, end = box_of(one.boxes)
        low, high = np.array([west, south, start]), np.array([east, north, end])
        if one.legs:
            pad_m = math.hypot(AHEAD_M, HALF_WIDTH_M) + UNSURE_M
            pads = np.array([pad_m, pad_m, 0.0])
            low, high = low - pads, high + pads
        return np.array([*low, one.boxes[0].floor_m, *-high, -one.boxes[0].ceiling_m])

    def add(self, bounds: Floats) -> None:
        """Add a flight."""
        self._all[self._count] = bounds
        self._count += 1

    def near(self, bounds: Floats) -> list[int]:
        """Return the flights that a flight may meet."""
        low, high = self._all[: self._count, :4], -self._all[: self._count, 4:]
        return np.flatnonzero(((low <= -bounds[4:]) & (bounds[:4] <= high)).all(axis=1)).tolist()


def boxes_meet(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Return whether two flights' boxes meet in space and time."""
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3] and a[4] <= b[5] and b[4] <= a[5]


def timed(do: Callable[[], object], into: list[float], clock: Callable[[], float] = time.process_time) -> object:
    """Return the result of a call; add its milliseconds."""
    began = clock()
    found = do()
    into.append(1e3 * (clock() - began))
    return found


def spread(times: list[float]) -> str:
    """Return median and 95 % of milliseconds."""
    times = sorted(times)
    return f"{statistics.median(times):6.2f} {times[int(0.95 * len(times))]:6.2f} ms"


def brute_force(one: Flight, near: Sequence[Flight]) -> tuple[bool, bool]:
    """Return whether a flight meets one of others, and whether that is certain."""
    if not one.legs:
        return any(a.meets(b) for other in near for a in one.boxes for b in other.boxes), True
    clearance_m = min((one.clearance_m(other) for other in near), default=math.inf)
    return clearance_m <= 0.0, clearance_m < 0.0 or clearance_m > UNSURE_M


def run(accepted: int, form: str, motion: str, stored: bool, most_probed: int) -> None:
    """Admit flights until a given number is accepted, and print the cost."""
    scene = Scene("admit", motion=motion, tolerance_m=0.005)  # type: ignore[arg-type]
    rng, index = np.random.default_rng(accepted), Index(scene)
    there: list[Flight] = []
    bounds = Bounds(accepted)
    asked = probed = wrongly = met = of_server = extra = 0
    server: list[tuple[float, ...]] = []
    asks: list[float] = []
    puts: list[float] = []
    boxed: list[float] = []
    while extra < ASKED_MORE:
        one = flight(rng, f"f{asked}", form)
        asked += 1
        extra += len(there) == accepted
        mine = Bounds.of(one)
        near = [there[k] for k in bounds.near(mine)]
        meets, is_sure = brute_force(one, near)
        refused = meets or not is_sure
        if len(there) >= accepted - most_probed:
            probed += 1
            refused = bool(timed(lambda one=one: index.probe(one.plans, owner="asked"), asks))
            wrongly += is_sure and refused and not meets
            met += is_sure and meets and not refused
        whole_box = box_of(one.boxes)
        if not timed(lambda box=whole_box: any(boxes_meet(box, other) for other in server), boxed):
            server.append(whole_box)
            of_server += 1
        if not refused and len(there) < accepted:
            timed(lambda one=one: index.put(one.plans, owner=one.plans[0].key), puts)
            there.append(one)
            bounds.add(mine)
    news: list[float] = []
    for k in range(ASKED_MORE):
        fresh = flight(rng, f"n{k}", form).plans
        timed(lambda fresh=fresh, k=k: index.put(fresh, owner=f"n{k}"), news)
    plans = [plan for one in there for plan in one.plans]
    whole: list[float] = []
    for k in range(3):
        more = [*plans, *flight(rng, f"s{k}", form).plans]
        both = [p for p in more if isinstance(p, Track)], [p for p in more if isinstance(p, Area)]
        timed(lambda both=both: solve(*both, scene), whole)
    last = slice(-ASKED_MORE, None)
    print(
        f"{motion} {form}: {len(there)} accepted of {asked} asked, the last {probed} by the index ({len(plans)} "
        f"objects), box {of_server} in {spread(boxed[last])}; refused without need {wrongly}, accepted that meet "
        f"{met}; index probe {spread(asks[last])}, put {spread(puts[last])}, unprobed {spread(news)}; "
        f"solve {spread(whole)}; beat {beat():.2f} ms",
        flush=True,
    )
    if stored:
        in_database(scene, there, rng, form)


def beat() -> float:
    """Return the processor milliseconds of a fixed loop, median of 50."""
    took: list[float] = []
    for _ in range(50):
        timed(lambda: sum(i * i for i in range(20_000)), took)
    return statistics.median(took)


def motions() -> float:
    """Return how many times as long `solve` of 20 tracks takes on great circles, by turns, median of 200."""
    rng = np.random.default_rng(20)
    tracks = [plan for k in range(20) for plan in flight(rng, f"f{k}", "tracks").plans]
    took: dict[str, list[float]] = {"rhumb": [], "great_circle": []}
    for _ in range(200):
        for motion, times in took.items():
            timed(lambda motion=motion: solve(tracks, [], Scene("motions", motion=motion)), times)
    return statistics.median(took["great_circle"]) / statistics.median(took["rhumb"])


def memory(flights: int, motion: str) -> tuple[int, float, float]:
    """Return the volumes of random flights, and the bytes a volume of an index that has them, and of the plans."""
    rng, index = np.random.default_rng(flights), Index(Scene("admit", motion=motion, tolerance_m=0.005))  # type: ignore[arg-type]
    index.put(flight(rng, "first", "volumes").plans, owner="first")
    index.probe(flight(rng, "asked", "volumes").plans, owner="asked")  # what a first use imports and makes is no volume
    size = [resident_bytes()]
    each = [flight(rng, f"f{k}", "volumes").plans for k in range(flights)]
    size.append(resident_bytes())
    for k, plans in enumerate(each):
        index.put(plans, owner=f"f{k}")
    size.append(resident_bytes())
    volumes = len(index)
    return volumes, (size[2] - size[1]) / volumes, (size[1] - size[0]) / volumes


def resident_bytes() -> int:
    """Return the memory of this process, after everything unused was collected and returned to the system."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def in_database(scene: Scene, there: list[Flight], rng: np.random.Generator, form: str) -> None:
    """Admit flights to a stored scene of the accepted ones."""
    with conflictdb.connect() as db:
        city = db.scene("benchmark of admissions")
        city.put([plan for one in there for plan in one.plans], scene)
        city.detect()
        clock = measured.processor_clock(db.connection) or time.perf_counter
        for name in ("detected", "with undetected"):
            took: list[float] = []
            for k in range(ASKED_MORE):
                plans = flight(rng, f"{name} {k}", form).plans
                timed(lambda plans=plans, k=k, name=name: city.admit(plans, owner=f"{name} {k}"), took, clock)
            print(f"    stored, {name}: admit {spread(took)}", flush=True)
        with measured.worker():  # else plans that one must decide are refused
            while not service(db.connection).worker_count:
                db.connection.rollback()
                time.sleep(0.1)
            in_sql(db.connection, rng, form, clock)
        print(f"    beat {beat():.2f} ms", flush=True)
        city.delete()


def in_sql(conn: "psycopg.Connection[Any]", rng: np.random.Generator, form: str, clock: Callable[[], float]) -> None:
    """Admit flights by the function of SQL; those that a worker must decide count as undecided."""
    took: list[float] = []
    answered: list[float] = []
    rows: list[Any] = []
    for k in range(ASKED_MORE):
        plans = json.dumps([as_plan(plan) for plan in flight(rng, f"sql {k}", form).plans])
        given = ("benchmark of admissions", plans, f"sql {k}")

        def ask(given: tuple[str, str, str] = given) -> None:
            query = "SELECT admitted, request_id FROM conflictdb.admit(%s, %s, %s)"
            rows.append(conn.execute(query, given).fetchone())
            conn.commit()

        began = time.perf_counter()
        timed(ask, took, clock)
        if rows[-1][0] is None:
            conn.execute("SELECT conflictdb.wait_for_admission(%s)", [rows[-1][1]])
            conn.commit()
            answered.append(1e3 * (time.perf_counter() - began))
    said = [row[0] for row in rows]
    counts = ", ".join(f"{said.count(one)} {name}" for one, name in ANSWERS)
    by_worker = f"; to a worker's answer {spread(answered)}" if answered else ""
    print(f"    stored, in SQL: admit {spread(took)}; {counts}{by_worker}", flush=True)


def as_plan(plan: Area | Track) -> dict[str, Any]:
    """Return a flight's plan as the function of SQL takes it."""
    return feature_of(plan) | {"version": 1}


def main() -> None:
    """Run the workload at all sizes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("flights", nargs="*", type=int, default=[100, 1000, 5000])
    parser.add_argument("--stored", action="store_true")
    parser.add_argument("--probed", type=int, default=PROBED)
    parser.add_argument("--forms", nargs="*", default=["volumes", "tracks"])
    parser.add_argument("--motions", nargs="*", default=["rhumb", "great_circle"])
    given = parser.parse_args()
    print(f"solve of 20 tracks: great circles {motions():.2f} times rhumb lines", flush=True)
    for accepted in given.flights:
        for motion in given.motions:
            volumes, of_index, of_plans = measured.in_fresh_process(memory, accepted, motion)
            print(f"{motion}: {volumes} volumes, index {of_index:.0f} bytes a volume, plans {of_plans:.0f}", flush=True)
        for form in given.forms:
            for motion in given.motions:
                run(accepted, form, motion, given.stored, given.probed)


if __name__ == "__main__":
    main()
