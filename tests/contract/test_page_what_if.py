"""The page computes what a track would meet that departs at another time: as a detection of a copy does."""

import base64
import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import shapely
from layouts import EQUATOR, GROWING, GROWING_CIRCLES, HARBOUR, HIGH_LATITUDE, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from page_in_node import HORIZON_US, answers_of_page, run_page
from ruled import CLASSES, random_rules

import conflictdb
from conflictdb.map import what_if
from conflictdb.model.plans import Area, EarthModel, Intervals, Scene, Track, rectangle_outline_m
from conflictdb.model.results import Conflict

# More than objects move in the quarter of a microsecond that instants of the page are rounded to, metres.
AN_INSTANT_M: Final = 1e-3
T0_US: Final = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
# Of each track how much later, microseconds, and how much higher, metres.
Asked = list[tuple[str, list[tuple[int, float]]]]
Plans = tuple[Scene, list[Area], list[Track]]
WORKLOADS: Final = (LOW_LATITUDE, HIGH_LATITUDE, SEAM, EQUATOR, HARBOUR, OCEAN, GROWING, GROWING_CIRCLES)

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="did not run: no node here")


def later(track: Track, by_us: int) -> Track:
    return replace(track, times_us=track.times_us + by_us, max_speed_kn=np.inf)


def higher(track: Track, up_m: float) -> Track:
    floor_m, ceiling_m = (None if end is None else end + up_m for end in (track.floor_m, track.ceiling_m))
    return replace(track, floor_m=floor_m, ceiling_m=ceiling_m, max_speed_kn=np.inf)


def of_copy(scene: Scene, areas: list[Area], tracks: list[Track], key: str, by_us: int, up_m: float) -> dict[str, Any]:
    """The conflicts of a later and higher track, in a copy of its scene, by the other object."""
    moved = [higher(later(one, by_us), up_m) if one.key == key else one for one in tracks]
    return {
        one.b_key if one.a_key == key else one.a_key: one
        for one in conflictdb.solve(moved, areas, scene)
        if key in (one.a_key, one.b_key) and one.periods
    }


def scenes_of(workload: Workload, seed: int) -> tuple[Scene, list[Area], list[Track]]:
    return plain_scene(workload, seed, 8, 12, separation_m=[0.0, 500.0][seed % 2])


def unlike(page: dict[str, Any], copy: Conflict, base_us: int) -> list[str]:
    """What differs between two answers on one pair; the sines of two C libraries differ in their last digits."""
    periods = [[base_us + int(us) for us in period] for period in page["us"]]
    there = [[instant_us(at) for at in period if at is not None] for period in copy.periods]
    if len(periods) != len(there) or max(abs(np.array(periods) - there).flat, default=0) > 1:
        return [f"{periods}, copy {there}"]
    if page["verdict"] != copy.verdict:
        return [f"{page['verdict']}, copy {copy.verdict}"]
    if not abs(page["error_s"] - copy.time_error_s) <= 1e-6:
        return [f"error {page['error_s']}, copy {copy.time_error_s}"]
    return []


def instant_us(at: datetime) -> int:
    return round((at - EPOCH) / timedelta(microseconds=1))


def differing(answer: Any, plans: Plans, key: str, delays: list[tuple[int, float]]) -> list[str]:
    """What differs between the answers of the page and of copies: pairs, verdicts, periods beyond a microsecond."""
    scene, areas, tracks = plans
    found, base_us = [], int(answer["base"])
    for (by_us, up_m), conflicts in zip(delays, answer["conflicts"], strict=True):
        copy = of_copy(scene, areas, tracks, key, by_us, up_m)
        here = {one["other"]: one for one in conflicts}
        if here.keys() != copy.keys():
            found.append(f"{scene.name} {key} {by_us}: {here.keys() ^ copy.keys()}")
        for other in here.keys() & copy.keys():
            unlikes = unlike(here[other], copy[other], base_us)
            found += [f"{scene.name} {key} {by_us} {other}: {text}" for text in unlikes]
        for other in copy:
            spans = dict(dict(answer["forbidden"])[up_m]).get(other, [])
            if abs(by_us) <= HORIZON_US and not any(low <= by_us <= high for low, high in spans):
                found.append(f"{scene.name} {key} {by_us}: {other} is met, and allowed by {spans}")
    return found


def check(tmp_path: Path, count: int, scenes: list[Plans], each: int, ups_m: tuple[float, ...] = (0.0,)) -> None:
    """A number of random (track, delay, height) over scenes."""
    rng = np.random.default_rng(7)
    asked: list[tuple[bytes, Asked]] = []
    for scene, areas, tracks in scenes:
        chosen = rng.choice(len(tracks), each, replace=False)
        delays = [
            [
                (0, 0.0),
                *((int(rng.integers(-HORIZON_US, HORIZON_US)), float(rng.choice(ups_m))) for _ in range(count - 1)),
            ]
            for _ in chosen
        ]
        asked.append(
            (
                what_if.packed(scene, areas, tracks),
                [(tracks[n].key, some) for n, some in zip(chosen, delays, strict=True)],
            )
        )
    found, met = [], 0
    for (scene, areas, tracks), (_, own), answers in zip(scenes, asked, answers_of_page(tmp_path, asked), strict=True):
        for (key, delays), answer in zip(own, answers, strict=True):
            assert "refusal" not in answer, (scene.name, key, answer)
            assert answer["mayRise"] or ups_m == (0.0,), (scene.name, key)
            found += differing(answer, (scene, areas, tracks), key, delays)
            met += sum(map(len, answer["conflicts"]))
            for one in answer["conflicts"][0]:
                within_m = scene.largest_separation_m + scene.tolerance_m + AN_INSTANT_M
                inside_m = [at_m for at_m in one["inside_m"] if at_m is not None]
                assert max(inside_m, default=0.0) <= within_m, (scene.name, key, one)
                if one["verdict"] == "conflict":
                    assert one["least_m"] <= min([scene.largest_separation_m, *inside_m]), (scene.name, key, one)
    assert found == []
    assert met > len(scenes)


def test_moved_track_meets_what_a_detection_of_its_copy_finds(tmp_path: Path) -> None:
    """Few delays of each workload; as planned, they are as near as their conflict says."""
    check(tmp_path, 3, [scenes_of(workload, seed) for seed, workload in enumerate(WORKLOADS)], 2)


@pytest.mark.slow
def test_many_moved_tracks_meet_what_detections_of_copies_find(tmp_path: Path) -> None:
    """A thousand."""
    check(tmp_path, 12, [scenes_of(workload, seed) for workload in WORKLOADS for seed in range(2, 5)], 4)


def dented(lon: float) -> Plans:
    """Areas with dents and holes, cut into parts narrower than the tolerance, and points that cross them."""
    rng, degree_m = np.random.default_rng(5), 111_195.0
    scene = Scene(f"dented {lon}", earth=EarthModel.SPHERE, tolerance_m=200.0)
    areas, tracks = [], []
    for n in range(6):
        middle = np.array([lon, 0.05 * n])
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 9))
        corners = rng.uniform(300.0, 1400.0, (9, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        hole = rng.uniform(-700.0, 700.0, 2) + rng.uniform(-200.0, 200.0, (3, 2))
        shape = shapely.make_valid(shapely.Polygon(corners)).difference(shapely.Polygon(hole))
        placed = shapely.transform(shape, lambda xy, to=middle: xy / degree_m + to)
        areas.append(Area(f"A{n}", shapely.MultiPolygon(shapely.get_parts(placed))))
        ends = np.array([[-0.02, -0.01], [0.02, 0.01]]) * rng.choice([-1.0, 1.0], 2) + middle
        tracks.append(Track(f"T{n}", ends, [T0_US, T0_US + HORIZON_US // 2], rectangle_outline_m(1, 1, 1, 1)))
    return scene, areas, tracks


def test_verdicts_on_areas_of_several_parts_are_those_of_detections(tmp_path: Path) -> None:
    """Also next to the antimeridian, where parts lie a turn away from their area."""
    check(tmp_path, 3, [dented(20.0), dented(-179.986)], 6)


def test_owners_heights_and_closed_intervals_count_as_in_a_detection(tmp_path: Path) -> None:
    """Objects of one owner are not compared, those without an owner are; spans end while tracks are there."""
    rng, plans = np.random.default_rng(3), []
    for seed, workload in enumerate((LOW_LATITUDE, SEAM)):
        scene, areas, tracks = plain_scene(workload, 50 + seed, 8, 10)
        first_us, last_us = int(tracks[0].times_us[0]), int(tracks[0].times_us[-1])
        spans = [{"start_us": first_us, "end_us": None}, {"start_us": None, "end_us": last_us}, {}]
        owned: list[Area | Track] = []
        for i, one in enumerate([*areas, *tracks]):
            more: dict[str, Any] = spans[i % 3] if isinstance(one, Area) else {"max_speed_kn": np.inf}
            floor_m, ceiling_m = float(rng.integers(0, 70)), float(rng.integers(80, 140))
            owned.append(
                replace(one, owner=["x", None, "y", None][i % 4], floor_m=floor_m, ceiling_m=ceiling_m, **more)
            )
        for settings in ({"vertical_separation_m": 12.3}, {"intervals": Intervals.CLOSED}, {"tolerance_m": 50.0}):
            own = replace(scene, **settings)
            plans.append((own, owned[: len(areas)], owned[len(areas) :]))
    check(tmp_path, 3, plans, 2)


def by_class(workload: Workload, seed: int, **settings: Any) -> Plans:
    """The objects of a scene at heights, of some classes and owners, with random separation rules without times."""
    rng = np.random.default_rng(seed)
    scene, areas, tracks = at_heights(*scenes_of(workload, seed), seed)

    def classed(one: Any, more: dict[str, Any]) -> Any:
        object_class = (None, *CLASSES, "unnamed")[rng.integers(7)]
        return replace(one, object_class=object_class, owner=(None, None, None, "x", "y")[rng.integers(5)], **more)

    rules = [replace(rule, time_s=None) for rule in random_rules(rng)]
    rules = [one for one in rules if one.allowed or one.separation_m is not None or one.vertical_m is not None]
    return (
        replace(scene, rules=tuple(rules), **settings),
        [classed(area, {}) for area in areas],
        [classed(track, {"max_speed_kn": np.inf}) for track in tracks],
    )


def test_separation_rules_count_as_in_a_detection(tmp_path: Path) -> None:
    """Each pair has its own separations, or is not compared; also higher, lower, and with a waypoint elsewhere."""
    some = [by_class(workload, 70 + seed) for seed, workload in enumerate((LOW_LATITUDE, SEAM, HARBOUR, GROWING))]
    check(tmp_path, 4, some, 3, (-40.0, -10.1, 0.0, 7.0, 25.3))
    check(tmp_path, 3, [by_class(LOW_LATITUDE, 80, intervals=Intervals.CLOSED)], 4)
    check_waypoints(tmp_path, some[:2], 4)


@pytest.mark.slow
def test_many_moved_tracks_of_classes_meet_what_detections_find(tmp_path: Path) -> None:
    some = [by_class(workload, seed) for workload in WORKLOADS for seed in range(90, 94)]
    check(tmp_path, 12, some, 4, (-40.0, -10.1, 0.0, 7.0, 25.3))


# Prints what a margin forbids to each key: [key, spans] each.
MARGINS: Final = """
import { readFileSync } from "node:fs";
import { Kernel } from "./kernel.mjs";
import { unpackPieces, withMargin } from "./near.mjs";
import { union, WhatIf } from "./what_if.mjs";
const kernel = await Kernel.of(readFileSync("kernel.wasm"));
const { horizon, scenes } = JSON.parse(readFileSync(0));
console.log(JSON.stringify(scenes.map(([text, margin, keys]) => {
  const pack = withMargin(unpackPieces(new Uint8Array(Buffer.from(text, "base64")).buffer), margin);
  return keys.map((key) => union([...new WhatIf(kernel, pack, key).forbidden(horizon).values()].flat()));
})));
"""


def test_margins_forbid_what_they_forbid_to_delays(tmp_path: Path) -> None:
    """Margins in time and in distance, also with rules, and across the date line; of pieces cut for it, or more."""
    horizon_s, asked, wanted = HORIZON_US / 1e6, [], []
    plans = [scenes_of(workload, seed) for seed, workload in enumerate(WORKLOADS)]
    plans += [by_class(workload, 70 + seed) for seed, workload in enumerate((LOW_LATITUDE, SEAM))]
    for nth, (scene, areas, tracks) in enumerate(plans):
        s, m = [(0.0, 185.2), (300.0, 0.0), (0.0, 2000.0)][nth % 3]
        pack = what_if.packed_whole(scene, areas, tracks) if nth % 2 else what_if.packed(scene, areas, tracks, None, m)
        keys = [track.key for track in tracks[:4]]
        asked.append([base64.b64encode(pack).decode(), {"s": s, "m": m}, keys])
        for key in keys:
            [found] = conflictdb.delays(tracks, areas, scene, key=key, within_s=horizon_s, margin_s=s, margin_m=m)
            wanted.append((scene.name, key, [(one.from_s, one.to_s) for one in found.forbidden]))
    answers = run_page(tmp_path, MARGINS, {"horizon": HORIZON_US, "scenes": asked})
    spans = [joined([(low / 1e6, high / 1e6) for low, high in own]) for scene in answers for own in scene]
    assert sum(map(len, spans)) > len(plans)
    for (name, key, own), page in zip(wanted, spans, strict=True):
        expected = joined([(max(-horizon_s, low), min(horizon_s, high)) for low, high in own])
        assert len(page) == len(expected), (name, key, page, expected)
        assert np.abs(np.array(page) - np.array(expected)).max(initial=0.0) <= 1e-3, (name, key, page, expected)


def joined(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The union of spans, of which some are less than a millisecond apart."""
    made: list[tuple[float, float]] = []
    for low, high in sorted(spans):
        if made and low <= made[-1][1] + 1e-3:
            made[-1] = made[-1][0], max(made[-1][1], high)
        else:
            made.append((low, high))
    return made


def check_waypoints(tmp_path: Path, scenes: list[Plans], each: int) -> None:
    """A number of random (track, waypoint, place, delay) over scenes."""
    rng = np.random.default_rng(11)
    asked: list[tuple[Any, ...]] = []
    for scene, areas, tracks in scenes:
        own = []
        for nth in rng.choice(len(tracks), each):
            track = tracks[nth]
            n = int(rng.integers(len(track.positions_deg)))
            others = tracks[int(rng.integers(len(tracks)))].positions_deg
            lon, lat = np.array(others[int(rng.integers(len(others)))]) + rng.normal(0.0, 0.002, 2)
            own.append((track.key, (n, float(lon), float(lat)), int(rng.integers(-HORIZON_US, HORIZON_US))))
        asked.append((what_if.packed(scene, areas, tracks), own))
    found, met = [], 0
    for (scene, areas, tracks), (_, own), answers in zip(scenes, asked, answers_of_page(tmp_path, asked), strict=True):
        for (key, place, by_us), answer in zip(own, answers, strict=True):
            assert "refusal" not in answer, (scene.name, key, place, answer)
            moved = [with_waypoint(one, *place) if one.key == key else one for one in tracks]
            copy = of_copy(scene, areas, moved, key, by_us, 0.0)
            here = {one["other"]: one for one in answer["conflicts"][0]}
            if here.keys() != copy.keys():
                found.append(f"{scene.name} {key} {place} {by_us}: {here.keys() ^ copy.keys()}")
            for other in here.keys() & copy.keys():
                unlikes = unlike(here[other], copy[other], int(answer["base"]))
                found += [f"{scene.name} {key} {place} {by_us} {other}: {text}" for text in unlikes]
            met += len(here)
    assert found == []
    assert met > len(scenes)


def with_waypoint(track: Track, number: int, lon: float, lat: float) -> Track:
    places = np.array(track.positions_deg)
    places[number] = lon, lat
    return replace(track, positions_deg=places, max_speed_kn=np.inf)


def test_track_with_a_waypoint_elsewhere_meets_what_a_detection_of_its_copy_finds(tmp_path: Path) -> None:
    """Few of each workload: on rhumb lines and great circles, across the date line, also of growing havens."""
    check_waypoints(tmp_path, [scenes_of(workload, seed) for seed, workload in enumerate(WORKLOADS)], 6)


@pytest.mark.slow
def test_many_waypoints_elsewhere_meet_what_detections_of_copies_find(tmp_path: Path) -> None:
    """A thousand."""
    check_waypoints(tmp_path, [scenes_of(workload, seed) for workload in WORKLOADS for seed in range(2, 7)], 25)


def at_heights(scene: Scene, areas: list[Area], tracks: list[Track], seed: int) -> Plans:
    """The objects of a scene in bands of some decimals, two without a floor; of every other seed with a separation."""
    rng = np.random.default_rng(seed)

    def banded(one: Any, n: int, **more: Any) -> Any:
        floor_m, thick_m = round(float(rng.integers(-600, 600)) / 10, 1), float(rng.integers(5, 40))
        return replace(one, floor_m=None if n == 0 else floor_m, ceiling_m=round(floor_m + thick_m, 1), **more)

    own = replace(scene, vertical_separation_m=[0.0, 12.3][seed % 2])
    return (
        own,
        [banded(area, n) for n, area in enumerate(areas)],
        [banded(track, n, max_speed_kn=np.inf) for n, track in enumerate(tracks)],
    )


def test_track_at_another_height_meets_what_a_detection_of_its_copy_finds(tmp_path: Path) -> None:
    """Bands that only touch do not overlap, also after they moved by decimals."""
    plans = [at_heights(*scenes_of(workload, seed), seed) for seed, workload in enumerate((HARBOUR, LOW_LATITUDE))]
    check(tmp_path, 6, plans, 4, (-40.0, -10.1, -0.1, 0.0, 0.2, 7.0, 25.3))


@pytest.mark.slow
def test_many_tracks_at_other_heights_meet_what_detections_of_copies_find(tmp_path: Path) -> None:
    """A thousand."""
    seeds = range(2, 5)
    plans = [at_heights(*scenes_of(workload, seed), seed) for workload in WORKLOADS for seed in seeds]
    check(tmp_path, 12, plans, 4, (-40.0, -10.1, -0.1, 0.0, 0.2, 7.0, 25.3))
