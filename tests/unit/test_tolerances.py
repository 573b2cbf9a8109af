"""Havens of plans with tolerances contain every voyage within them, and little more."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.affinity

from conflictdb import delays, resolve, solve
from conflictdb.arrays import Floats
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows
from conflictdb.core.pieces.covers import COVER, pieces_of
from conflictdb.earth.geodesy import MEAN_RADIUS_M
from conflictdb.earth.registry import Setup, centred
from conflictdb.exchange.volumes_writing import in_steps
from conflictdb.formats.scene_file import read_scene, scene_text
from conflictdb.kernel import KernelScene
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import Area, Motion, Scene, Track, rectangle_outline_m
from conflictdb.model.recurring_plans import later
from conflictdb.plot.sketch import Sketch

T0_US = 1_772_323_200_000_000
SHIP = rectangle_outline_m(150.0, 150.0, 20.0, 20.0)
KNOT = 1852.0 / 3600.0


def step(motion: Motion, lon: Floats, lat: Floats, bearing: Floats, metres: Floats) -> tuple[Floats, Floats, Floats]:
    """A step on the sphere by textbook formulas: longitude, latitude and bearing after it, degrees."""
    phi, b, s = np.radians(lat), np.radians(bearing), metres / MEAN_RADIUS_M
    if motion is Motion.RHUMB:
        to = phi + s * np.cos(b)
        psi = np.arcsinh(np.tan(to)) - np.arcsinh(np.tan(phi))
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(np.abs(to - phi) > 1e-9, psi / (to - phi), 1.0 / np.cos(0.5 * (phi + to)))
        return lon + np.degrees(s * np.sin(b) * ratio), np.degrees(to), bearing
    to = np.arcsin(np.sin(phi) * np.cos(s) + np.cos(phi) * np.sin(s) * np.cos(b))
    turn = np.arctan2(np.sin(b) * np.sin(s) * np.cos(phi), np.cos(s) - np.sin(phi) * np.sin(to))
    after = np.arctan2(np.sin(b) * np.cos(phi), np.cos(s) * np.cos(phi) * np.cos(b) - np.sin(s) * np.sin(phi))
    return lon + np.degrees(turn), np.degrees(to), np.degrees(after)


def course(motion: Motion, start: Floats, end: Floats) -> tuple[float, float]:
    """Bearing at the start, degrees, and length of a leg on the sphere."""
    turn = np.radians((end[0] - start[0] + 180.0) % 360.0 - 180.0)
    (a, b) = np.radians([start[1], end[1]])
    if motion is Motion.RHUMB:
        psi = np.arcsinh(np.tan(b)) - np.arcsinh(np.tan(a))
        bearing = np.arctan2(turn, psi)
        length = abs((b - a) / np.cos(bearing)) if abs(b - a) > 1e-7 else abs(turn) * np.cos(a)
        return float(np.degrees(bearing)), float(length * MEAN_RADIUS_M)
    x, y = np.cos(a) * np.sin(b) - np.sin(a) * np.cos(b) * np.cos(turn), np.sin(turn) * np.cos(b)
    cosine = np.sin(a) * np.sin(b) + np.cos(a) * np.cos(b) * np.cos(turn)
    return float(np.degrees(np.arctan2(y, x))), float(np.arctan2(np.hypot(x, y), cosine) * MEAN_RADIUS_M)


def plan(rng: np.random.Generator, motion: Motion, **changes: Any) -> tuple[Scene, Track]:
    lat, legs = rng.uniform(0.0, 84.5), int(rng.integers(1, 21))
    way = [np.array([rng.uniform(-180.0, 180.0), lat])]
    heading = rng.uniform(0.0, 360.0)
    for _ in range(legs):
        heading += rng.uniform(-150.0, 150.0)
        length = rng.choice([500.0, 5_000.0, 50_000.0]) * rng.uniform(0.5, 2.0)
        while True:
            lon_to, lat_to, _ = step(motion, way[-1][0], way[-1][1], heading, length)
            if abs(lat_to) < 85.0:
                break
            heading += 90.0
        way.append(np.array([(float(lon_to) + 180.0) % 360.0 - 180.0, float(lat_to)]))
    positions = np.array(way)
    lengths = np.array([course(motion, a, b)[1] for a, b in pairwise(positions)])
    times = T0_US + np.append(0, np.cumsum(np.rint(1e6 * lengths / rng.uniform(5.0, 10.0, legs)).astype(np.int64)))
    early, late = (int(x) for x in rng.integers(0, 1_800_000_000, 2))
    window = [np.datetime64(int(times[0]) - early, "us"), np.datetime64(int(times[0]) + late, "us")]
    limits = {
        "xtd_port_m": rng.choice([0.0, 200.0, 4_000.0], legs).tolist(),
        "xtd_starboard_m": float(rng.choice([50.0, 900.0])),
        "min_speed_kn": (0.8 * 5.0 / KNOT * np.ones(legs)).tolist(),
        "max_speed_kn": 25.0,
        "departure_window": window,
        **changes,
    }
    scene = centred(Scene("s", motion, "sphere"), [], [])
    scene = Scene("s", motion, "sphere", centre=tuple(positions[0]) if motion is Motion.GREAT_CIRCLE else None)
    return scene, Track("T", positions, times, SHIP, tolerances=limits, max_speed_kn=np.inf)


def voyages(rng: np.random.Generator, motion: Motion, track: Track, count: int) -> tuple[Floats, Floats, Floats]:
    """Ships of random voyages at random instants: seconds after T0 (c,), longitude and latitude of corners (c, m)."""
    given = track.tolerances
    assert given is not None
    legs = len(track.times_us) - 1
    ways = [course(motion, a, b) for a, b in pairwise(track.positions_deg)]
    window_us = np.array([one.rstrip("Z") for one in given["departure_window"]], "datetime64[us]").astype(np.int64)
    window = (window_us - T0_US) / 1e6
    at = rng.choice([window[0], window[1], np.nan], count)
    at = np.where(np.isnan(at), rng.uniform(*window, count), at)
    legs_of, seconds, along = rng.integers(0, legs, count), np.zeros(count), np.zeros(count)
    planned = np.diff(track.times_us) / 1e6
    for k in range(legs):
        length = ways[k][1]
        low, high = min(given["min_speed_kn"][k] * KNOT, length / planned[k]), max(25.0 * KNOT, length / planned[k])
        # Two speeds on each leg, often the extremes.
        bend = rng.uniform(0.0, 1.0, count)
        speeds = np.where(
            rng.random((2, count)) < 0.5, rng.choice([low, high], (2, count)), rng.uniform(low, high, (2, count))
        )
        durations = np.stack([bend, 1.0 - bend]) * length / speeds
        share = rng.choice([0.0, 1.0, 0.5], count) if k % 3 == 0 else rng.uniform(0.0, 1.0, count)
        here = legs_of == k
        gone = share * durations.sum(axis=0)
        first = np.minimum(gone, durations[0])
        seconds[here], along[here] = (at + gone)[here], (first * speeds[0] + (gone - first) * speeds[1])[here]
        at = at + durations.sum(axis=0)
    port = np.array(given["xtd_port_m"])[legs_of]
    aside = np.where(rng.random(count) < 0.5, rng.choice([0.0, 1.0], count), rng.random(count))
    aside = aside * (port + given["xtd_starboard_m"]) - port
    start = track.positions_deg[legs_of]
    bearing = np.array([b for b, _ in ways])[legs_of]
    lon, lat, ahead = step(motion, start[:, 0], start[:, 1], bearing, along)
    lon, lat, right = step(motion, lon, lat, ahead + 90.0, aside)
    ahead = right - 90.0
    corners = []
    for x, y in track.outline_m:
        one = step(motion, lon, lat, ahead, np.full(count, y))
        corners.append(step(motion, one[0], one[1], one[2] + 90.0, np.full(count, x))[:2])
    return seconds, np.stack([c[0] for c in corners], 1), np.stack([c[1] for c in corners], 1)


def outside(scene: Scene, track: Track, seconds: Floats, lon: Floats, lat: Floats) -> int:
    """The number of ships that lie in no part of the haven at their instants."""
    setup = Setup.of(scene)
    pieces = pieces_of(setup, AreaBatch.of([]), TrackBatch.of([track]))
    assert (pieces.part != COVER).all()
    prepared = KernelScene(setup.plane.kernel_plane, pieces)
    left, xy = np.ones(len(seconds), np.bool_), np.stack(setup.plane.to_plane(lon, lat), axis=-1)
    turn = setup.plane.turn_m
    for row in np.flatnonzero(pieces.turn == 0).tolist():
        low, high = ((t[row] - T0_US) / 1e6 for t in (pieces.start_us, pieces.end_us))
        here = np.flatnonzero(left & (seconds >= low - 2e-6) & (seconds <= high + 2e-6))
        if not here.size:
            continue
        rows = PieceRows(np.full(len(here), row))
        moving = Movement.of(prepared, rows, np.full(len(here), pieces.start_us[row]))
        at = np.clip(seconds[here] - low, 0.0, high - low)
        ring = (moving.positions(at) + moving.origin[:, None]).transpose(2, 1, 0)[
            :, : int(np.diff(pieces.shape_offset)[row])
        ]
        ship = xy[here]
        if turn:
            ship = ship + np.round((ring.mean(axis=1) - ship.mean(axis=1))[:, None] / turn) * np.array([turn, 0.0])
        edge = np.roll(ring, -1, axis=1) - ring
        gone = ship[:, :, None] - ring[:, None]
        side = edge[:, None, :, 0] * gone[..., 1] - edge[:, None, :, 1] * gone[..., 0]
        left[here[(side >= 0.0).all(axis=(1, 2))]] = False
    return int(left.sum())


@pytest.mark.parametrize("motion", list(Motion))
def test_no_voyage_leaves_its_haven(motion: Motion) -> None:
    rng = np.random.default_rng(20261124)
    for _ in range(3):
        scene, track = plan(rng, motion)
        assert outside(scene, track, *voyages(rng, motion, track, 500)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("motion", list(Motion))
def test_no_voyage_of_a_million_leaves_its_haven(motion: Motion) -> None:
    rng = np.random.default_rng(7)
    for _ in range(500):
        scene, track = plan(rng, motion)
        assert outside(scene, track, *voyages(rng, motion, track, 1_000)) == 0


def ships_on_arcs(
    rng: np.random.Generator, motion: Motion, count: int
) -> tuple[Scene, Track, tuple[Floats, Floats, Floats]]:
    """A plan with one turn of a radius, and ships on its arc: as `voyages`."""
    radius = float(rng.choice([200.0, 1_000.0, 4_000.0]))
    heading, turn = rng.uniform(0.0, 360.0), float(rng.choice([-1.0, 1.0]) * rng.uniform(5.0, 150.0))
    cut = radius * np.tan(0.5 * np.radians(abs(turn)))
    start = np.array([rng.uniform(-180.0, 180.0), rng.uniform(0.0, 83.0)])
    length = 2.5 * cut + 3_000.0
    lon, lat, ahead = step(motion, *start, heading, length)
    lon_to, lat_to, _ = step(motion, lon, lat, ahead + turn, length)
    way = np.array([start, [lon, lat], [lon_to, lat_to]])
    way[:, 0] = (way[:, 0] + 180.0) % 360.0 - 180.0
    times = T0_US + np.array([0, 1, 2]) * int(1e6 * length / 7.0)
    late = np.datetime64(T0_US + 600_000_000, "us")
    port, starboard, low, high = *rng.choice([0.0, 50.0, 900.0], 2), 5.0, 9.0
    limits = {
        "xtd_port_m": port,
        "xtd_starboard_m": starboard,
        "min_speed_kn": low / KNOT,
        "max_speed_kn": high / KNOT,
        "departure_window": [np.datetime64(T0_US, "us"), late],
        "turn_radius_m": radius,
    }
    track = Track("T", way, times, SHIP, tolerances=limits)
    scene = Scene("s", motion, "sphere", centre=tuple(start) if motion is Motion.GREAT_CIRCLE else None)
    gone, angle = rng.choice([0.0, 0.5, 1.0], count), np.radians(abs(turn))
    gone = np.where(rng.random(count) < 0.5, gone, rng.random(count)) * angle
    speed = rng.choice([low, high, 7.0], (2, count))
    seconds = rng.choice([0.0, 300.0, 600.0], count) + (length - cut) / speed[0] + radius * gone / speed[1]
    aside = np.where(
        rng.random(count) < 0.5, rng.choice([-port, starboard], count), rng.uniform(-port, starboard, count)
    )
    here = step(motion, np.full(count, start[0]), np.full(count, start[1]), np.full(count, heading), length - cut)
    here = step(motion, *here, radius * np.sin(gone))
    side = np.sign(turn) * 90.0
    here = step(motion, here[0], here[1], here[2] + side, radius * (1.0 - np.cos(gone)))
    here = step(motion, here[0], here[1], here[2] - side + np.sign(turn) * np.degrees(gone) + 90.0, aside)
    corners = []
    for x, y in SHIP:
        one = step(motion, here[0], here[1], here[2] - 90.0, np.full(count, y))
        corners.append(step(motion, one[0], one[1], one[2] + 90.0, np.full(count, x))[:2])
    return scene, track, (seconds, np.stack([c[0] for c in corners], 1), np.stack([c[1] for c in corners], 1))


@pytest.mark.parametrize("motion", list(Motion))
@pytest.mark.parametrize("plans", [12, pytest.param(1_000, marks=pytest.mark.slow)])
def test_no_ship_on_the_arc_of_a_turn_leaves_its_haven(motion: Motion, plans: int) -> None:
    rng = np.random.default_rng(5)
    for _ in range(plans):
        scene, track, ships = ships_on_arcs(rng, motion, 200)
        assert outside(scene, track, *ships) == 0
    missed = 0
    for _ in range(10):
        scene, track, ships = ships_on_arcs(rng, motion, 200)
        assert track.tolerances is not None
        sharp = replace(track, tolerances={**track.tolerances, "turn_radius_m": 0.0})
        missed += outside(scene, sharp, *ships)
    assert missed > 0


def test_no_voyage_leaves_the_haven_of_a_plan_in_steps() -> None:
    """Volumes of F3548 are those of a plan with more waypoints: limits of legs, and arcs of turns, stay as they are."""
    rng = np.random.default_rng(42)
    for _ in range(6):
        scene, track = plan(rng, Motion.RHUMB)
        assert outside(scene, in_steps(scene, track), *voyages(rng, Motion.RHUMB, track, 300)) == 0
    more = 0
    for k in range(24):
        scene, track, ships = ships_on_arcs(rng, Motion.RHUMB, 200)
        assert track.tolerances is not None
        listed = {**track.tolerances, "turn_radius_m": [track.tolerances["turn_radius_m"]]}
        stepped = in_steps(scene, replace(track, tolerances=listed) if k % 2 else track)
        more += len(stepped.times_us) - len(track.times_us)
        assert outside(scene, stepped, *ships) == 0
    assert more > 0


def test_a_haven_that_is_too_small_would_be_noticed() -> None:
    rng = np.random.default_rng(3)
    scene, track = plan(rng, Motion.RHUMB)
    assert track.tolerances is not None
    seconds, lon, lat = voyages(rng, Motion.RHUMB, track, 500)
    small = Track("T", track.positions_deg, track.times_us, 0.99 * SHIP, tolerances=track.tolerances, max_speed_kn=1e9)
    assert outside(scene, small, seconds, lon, lat) > 0
    assert outside(scene, track, seconds + 30.0, lon, lat) > 0


@pytest.mark.parametrize("motion", list(Motion))
def test_on_legs_the_haven_exceeds_the_voyages_by_a_hundredth_at_most(motion: Motion) -> None:
    """The union of all ships on a leg is a rectangle of places grown by the ship: its border by dense points."""
    rng = np.random.default_rng(11)
    worst = 0.0
    for _ in range(16):
        start = np.array([rng.uniform(-180.0, 180.0), rng.uniform(0.0, 84.0)])
        length = rng.choice([20_000.0, 200_000.0])
        lon, lat, _ = step(motion, start[0], start[1], rng.uniform(90.0, 270.0), length)
        way = np.array([start, [float(lon), float(lat)]])
        hours = length / 8.0 / 3600.0
        times = np.array([T0_US, T0_US + int(hours * 3.6e9)])
        width = rng.choice([500.0, 5_000.0])
        early = np.datetime64(T0_US - 1_200_000_000, "us")
        limits = {
            "xtd_port_m": width,
            "xtd_starboard_m": width,
            "min_speed_kn": 12.0,
            "max_speed_kn": 20.0,
            "departure_window": [early, early + np.timedelta64(2400, "s")],
        }
        track = Track("T", way, times, SHIP, tolerances=limits)
        centre = tuple(start) if motion is Motion.GREAT_CIRCLE else None
        scene = Scene("s", motion, "sphere", centre=centre)
        setup = Setup.of(scene)
        pieces = pieces_of(setup, AreaBatch.of([]), TrackBatch.of([track]))
        prepared = KernelScene(setup.plane.kernel_plane, pieces)
        bearing, length = course(motion, *way)
        slow, fast = min(12.0 * KNOT, length / hours / 3600.0), max(20.0 * KNOT, length / hours / 3600.0)
        seconds = rng.uniform(-1100.0, 0.9 * hours * 3600.0)
        low, high = np.clip([slow * (seconds - 1200.0), fast * (seconds + 1200.0)], 0.0, length)
        corners = [(high, width), (low, width), (low, -width), (high, -width)]
        hull = shapely.convex_hull(shapely.multipoints([(y + x, a + s) for a, y in corners for x, s in SHIP]))
        border = shapely.get_coordinates(shapely.segmentize(hull, 100.0))
        count = len(border)
        lon, lat, ahead = step(motion, np.full(count, start[0]), np.full(count, start[1]), bearing, border[:, 1])
        lon, lat, _ = step(motion, lon, lat, ahead + 90.0, border[:, 0])
        x, y = setup.plane.to_plane(lon, lat)
        true = shapely.Polygon(np.stack([x, y], axis=1))
        at_us = T0_US + int(1e6 * seconds)
        parts = []
        for row in np.flatnonzero((pieces.start_us <= at_us) & (at_us <= pieces.end_us) & (pieces.turn == 0)).tolist():
            moving = Movement.of(prepared, PieceRows(np.array([row])), pieces.start_us[[row]])
            ring = moving.positions(np.array([(at_us - pieces.start_us[row]) / 1e6])) + moving.origin[:, None]
            parts.append(shapely.convex_hull(shapely.multipoints(ring[:, :, 0].T)))
        turn = setup.plane.turn_m
        if turn:
            away = [turn * np.round((true.centroid.x - one.centroid.x) / turn) for one in parts]
            parts = [shapely.affinity.translate(one, by) for one, by in zip(parts, away, strict=True)]
        haven = shapely.union_all(parts)
        assert true.difference(haven.buffer(1e-3)).area <= 1e-9 * true.area
        worst = max(worst, haven.area / true.area - 1.0)
    assert worst <= 0.01


def test_a_plan_without_limits_is_its_plan() -> None:
    """Tolerances of nothing give the answers of the plan, and never a shorter period."""
    way, times = np.array([[4.0, 57.0], [4.5, 57.1], [5.0, 57.0]]), T0_US + np.array([0, 3_600_000_000, 7_200_000_000])
    area = Area("A", shapely.MultiPolygon([shapely.box(4.3, 56.9, 4.7, 57.2)]))
    (plain,) = solve([Track("T", way, times, SHIP)], [area], Scene("s"))
    (same,) = solve([Track("T", way, times, SHIP, tolerances={})], [area], Scene("s"))
    assert same.verdict == plain.verdict
    for (start, end), (first, last) in zip(plain.periods, same.periods, strict=True):
        assert -1.0 < (first - start).total_seconds() <= 0.0
        assert 0.0 <= (last - end).total_seconds() < 1.0


def test_a_window_finds_what_the_plan_misses() -> None:
    way, times = np.array([[4.0, 57.0], [5.0, 57.0]]), T0_US + np.array([0, 7_200_000_000])
    there = shapely.MultiPolygon([shapely.box(4.9, 57.004, 5.1, 57.1)])
    early = Area("early", there, None, T0_US, T0_US + 6_000_000_000)
    (window,) = [[np.datetime64(T0_US - 1_800_000_000, "us"), np.datetime64(T0_US, "us")]]
    plan = Track("T", way, times, SHIP)
    assert solve([plan], [early], Scene("s")) == []
    limits = {"xtd_port_m": 500.0, "departure_window": window}
    (found,) = solve([Track("T", way, times, SHIP, tolerances=limits)], [early], Scene("s"))
    assert found.verdict == "conflict"
    assert solve([Track("T", way, times, SHIP, tolerances={"xtd_port_m": 500.0})], [early], Scene("s")) == []


def window_us(track: Track, name: str) -> list[int]:
    assert track.tolerances is not None
    return [int(np.datetime64(one.removesuffix("Z"), "us").astype(np.int64)) for one in track.tolerances[name]]


def test_a_later_plan_has_later_windows() -> None:
    """What `delays` says of a delay is what `solve` says of the plan with it, and `resolve` clears such a plan."""
    way, hour = np.array([[4.0, 57.0], [5.0, 57.0]]), 3_600_000_000
    windows = {
        "departure_window": [T0_US, T0_US + hour // 2],
        "arrival_window": [T0_US + 4 * hour, T0_US + 9 * hour // 2],
    }
    limits = {name: [np.datetime64(one, "us") for one in window] for name, window in windows.items()}
    plan = Track("T", way, T0_US + np.array([0, 4 * hour]), SHIP, tolerances=limits)
    berth = Area("A", shapely.box(3.99, 56.99, 4.01, 57.01), None, T0_US + 3_500_000_000, T0_US + 4_500_000_000)
    (found,) = delays([plan], [berth], Scene("s"), within_s=7200.0)
    (forbidden,) = found.forbidden
    assert 1000.0 < forbidden.from_s < forbidden.to_s < 7200.0
    for delay_s in (forbidden.from_s - 1.0, forbidden.from_s + 1.0, forbidden.to_s - 1.0, forbidden.to_s + 1.0):
        by_us = round(1e6 * delay_s)
        moved = later(plan, by_us)
        assert {name: window_us(moved, name) for name in windows} == {
            name: [one + by_us for one in window] for name, window in windows.items()
        }
        is_inside = forbidden.from_s < delay_s < forbidden.to_s
        assert bool(solve([moved], [berth], Scene("s"))) == is_inside
    (move,) = resolve([later(plan, round(1e6 * forbidden.from_s + 2e6))], [berth], Scene("s"), within_s=7200.0).moves
    assert move.delay_s > 0.0


def test_the_scene_of_the_page_has_the_conflict_that_it_names() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs/how-to/plan-with-tolerances.md").read_text()
    text = page.split("<<'END'\n")[1].split("END\n")[0]
    found = read_scene(text, "ferry")
    (conflict,) = solve(found.tracks, found.areas, found.scene)
    (start, end) = conflict.periods[0]
    assert (start.strftime("%H:%M"), end.strftime("%H:%M")) == ("11:00", "11:35")
    exact = [replace(track, tolerances=None) for track in found.tracks]
    assert solve(exact, found.areas, found.scene) == []
    again = read_scene("".join(scene_text(found.scene, found.areas, found.tracks)), "ferry")
    assert again.tracks[0].tolerances == found.tracks[0].tolerances


def test_figures_show_all_parts_of_a_haven() -> None:
    way, times = np.array([[4.0, 57.0], [4.5, 57.1], [4.6, 56.8]]), T0_US + np.array([0, 7_200_000_000, 14_400_000_000])
    window = [np.datetime64(T0_US, "us"), np.datetime64(T0_US + 3_600_000_000, "us")]
    sketch = Sketch(Scene("s"), [], [Track("T", way, times, SHIP, tolerances={"departure_window": window})])
    shape = sketch.shape_at(0, T0_US + 9_000_000_000)
    assert shape is not None
    assert shape.geom_type == "Polygon"
    assert shape.area < 0.5 * shape.convex_hull.area
