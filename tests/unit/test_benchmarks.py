"""Common parts of benchmarks: scenes of a size, medians, exponents and files of numbers."""

import json
import math
import statistics
from collections import Counter
from dataclasses import replace
from pathlib import Path

import growth
import numpy as np
import profiles
import pyarrow.parquet as pq
import pytest
import quick_sea
import real_runs
import scale_out
import shapely
import sparked
import study
import walk_solve
from made_scenes import AT_ONCE, Kind, box, sea
from measured import Detection, medians, peak_mb, read_csv, write_csv
from scenes import T0_US

from conflictdb import Scene, solve
from conflictdb.arrays.arrow.object_rows import OBJECTS, to_objects
from conflictdb.model.plans import METRES_PER_NMI

DETECTION = Detection(10, 8, 6, 4, 2, 0.1, 0.2, 0.3, 0.0, 0.5, 0.4, 1.5, None, 1.0)


@pytest.mark.parametrize("kind", Kind)
def test_box_holds_what_its_kind_says(kind: Kind) -> None:
    """Areas have no time limits; the same seed throws the same scene."""
    scene, areas, tracks = box(kind, 7, 3)
    assert (len(areas), len(tracks)) == {Kind.STATIC: (7, 0), Kind.MIXED: (4, 3), Kind.TRACKS: (0, 7)}[kind]
    assert all(area.start_us is None and area.end_us is None for area in areas)
    assert all(len(track.times_us) >= 2 for track in tracks)
    assert box(kind, 7, 3)[0] == scene
    assert [area.footprint for area in box(kind, 7, 3)[1]] == [area.footprint for area in areas]


def test_box_is_as_large_as_the_paper_draws_it() -> None:
    """Vertices of areas are 50 to 100 nmi from a middle, sides of havens 20 to 40 nmi long; areas are convex."""
    _, areas, tracks = box(Kind.MIXED, 400, 1)
    across = []
    for area in areas:
        (polygon,) = area.footprint.geoms
        assert polygon.equals(polygon.convex_hull)
        nmi = shapely.transform(polygon, lambda lonlat: 60.0 * lonlat * [np.cos(np.radians(lonlat[:, 1].mean())), 1.0])
        across.append(2.0 * shapely.minimum_bounding_radius(nmi))
        assert 3 <= len(polygon.exterior.coords) - 1 <= 10
    assert 99.0 < min(across) < 130.0
    assert 190.0 < max(across) < 203.0
    sides = np.array([np.ptp(track.outline_m, axis=0) for track in tracks]) / METRES_PER_NMI
    assert 20.0 <= sides.min() < 21.0
    assert 39.0 < sides.max() <= 40.0
    assert np.corrcoef(sides.T)[0, 1] == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize(("kind", "conflicts"), [(Kind.STATIC, 4_545), (Kind.MIXED, 2_881), (Kind.TRACKS, 804)])
def test_box_has_as_many_conflicts_as_the_papers_numbers_give(kind: Kind, conflicts: int) -> None:
    found = []
    for seed in range(3):
        scene, areas, tracks = box(kind, 800, seed)
        found.append(len(solve(tracks, areas, scene)))
    assert statistics.median(found) == pytest.approx(conflicts, rel=0.06)


def test_sea_has_every_object_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also if it comes in parts, with a smaller last part."""
    assert AT_ONCE > 100
    monkeypatch.setattr("made_scenes.AT_ONCE", 10)
    parts = list(sea(25, 1))
    assert [len(areas) + len(tracks) for areas, tracks in parts] == [10, 10, 5]
    objects = [one for areas, tracks in parts for one in (*areas, *tracks)]
    assert len({one.key for one in objects}) == 25
    places = {tuple(one.positions_deg[0]) for _, tracks in parts for one in tracks}
    assert len(places) == sum(len(tracks) for _, tracks in parts)


def test_quick_sea_is_as_dense_as_the_sea(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every object is valid and unique, the number of legs is about as requested, and as many conflicts are found."""
    monkeypatch.setattr("quick_sea.AT_ONCE", 400)
    count = quick_sea.write(tmp_path / "sea.parquet", Scene("sea"), 1_150, 1)
    areas, tracks = to_objects(pq.read_table(tmp_path / "sea.parquet", columns=OBJECTS.schema.names))
    assert len({one.key for one in (*areas, *tracks)}) == len(areas) + len(tracks) == count == 1_000
    assert sum(len(track.times_us) - 1 for track in tracks) == pytest.approx(1_150, rel=0.1)
    ((closed, moving),) = sea(count, 1)
    expected = len(solve(moving, closed, Scene("sea")))
    assert len(solve(tracks, areas, Scene("sea"))) == pytest.approx(expected, rel=0.2)


def test_more_than_a_day_of_the_quick_sea_is_as_dense(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each day has tracks of its own; areas without time limits are shared. Both seas have as many conflicts."""
    found = []
    for most in (1_200, 400):
        monkeypatch.setattr("quick_sea.MOST", most)
        quick_sea.write(tmp_path / "sea.parquet", Scene("sea"), 1_200, 1)
        areas, tracks = to_objects(pq.read_table(tmp_path / "sea.parquet", columns=OBJECTS.schema.names))
        assert len({one.key for one in (*areas, *tracks)}) == len(areas) + len(tracks)
        days = Counter(int(track.times_us[0] - T0_US) // quick_sea._DAY_US for track in tracks)
        meetings = sum(pair.b_kind == "track" for pair in solve(tracks, areas, Scene("sea")))
        found.append((dict(days), sum(area.start_us is None for area in areas), len(areas), meetings))
    (one, for_ever, closed, met), (three, lasting, closed_apart, met_apart) = found
    assert (one, three) == ({0: 522}, {0: 174, 1: 174, 2: 174})
    assert lasting < 0.4 * for_ever
    assert closed_apart - lasting == pytest.approx(closed - for_ever, rel=0.1)
    assert met_apart == pytest.approx(met, rel=0.2)


def test_seconds_of_spark_come_from_its_log(tmp_path: Path) -> None:
    """Stages that run at once count once; a stage of one task is apart from those whose tasks share processors."""
    stages = [
        (0, 1_000, 2_000, 1, ["Scan parquet "]),
        (1, 3_000, 6_000, 2, ["PythonMapInArrow", "Exchange", "mapPartitionsInternal"]),
        (2, 7_000, 9_000, 4, ["InMemoryTableScan", "PythonMapInArrow", "mapPartitionsInternal", "Generate"]),
        (3, 8_000, 10_000, 4, ["PythonMapInArrow", "Exchange"]),
        (4, 10_000, 14_000, 8, ["WriteFiles", "Exchange"]),
    ]
    events = []
    for number, start, end, count, names in stages:
        metrics = {"Shuffle Write Metrics": {"Shuffle Bytes Written": 500_000}, "Disk Bytes Spilled": 0}
        task = {"Event": "SparkListenerTaskEnd", "Stage ID": number, "Task Metrics": metrics}
        events += [task | {"Task Info": {"Launch Time": start, "Finish Time": start + 600}}] * count
        told = {"Stage ID": number, "Number of Tasks": count, "Submission Time": start, "Completion Time": end}
        told["RDD Info"] = [{"Name": "MapPartitionsRDD", "Scope": json.dumps({"name": name})} for name in names]
        events.append({"Event": "SparkListenerStageCompleted", "Stage Info": told})
    (tmp_path / "events").mkdir()
    (tmp_path / "events" / "log").write_text("\n".join(map(json.dumps, events)))
    found = scale_out.times_of(sparked.events(tmp_path), 0.5, 14.5)
    parts = {"pieces_s": 4.0, "join_s": 3.0, "solve_s": 4.0, "between_s": 3.0, "single_s": 1.0}
    expected = {**parts, "task_s": 18 * 0.6, "shuffled_mb": 9.5, "spilled_mb": 0.0}
    assert found == pytest.approx(expected)
    assert scale_out.modelled_s(found, 1, 2) == pytest.approx(3.0 + 1.0 + 9 * 0.6)
    assert scale_out.modelled_s(found, 2, 2) == pytest.approx(3.0 + 1.0 + 4.5 * 0.6 + 9.5e6 / 4 / scale_out.NETWORK)


def test_medians_go_column_by_column() -> None:
    """The median of unknown values is unknown."""
    others = replace(DETECTION, total_s=3.0, conflicts=5), replace(DETECTION, total_s=2.0, pieces_s=9.0)
    found = medians([DETECTION, *others])
    assert (found.total_s, found.pieces_s, found.conflicts, found.cpu_s) == (2.0, 0.1, 2, None)


def test_spread_is_the_least_and_the_most_of_some_scenes() -> None:
    """The spread of unknown values is unknown."""
    found = study.spread([DETECTION, replace(DETECTION, conflicts=5, cpu_s=0.7), replace(DETECTION, cpu_s=0.2)])
    assert found == {"conflicts_least": 2, "conflicts_most": 5, "cpu_s_least": 0.2, "cpu_s_most": 0.7}
    assert study.spread([DETECTION])["cpu_s_most"] is None


def test_exponent_is_that_of_the_power_law() -> None:
    rows = [{"objects": n, "total_s": 3e-6 * n**1.25, "cpu_s": None} for n in (500, 5_000, 50_000)]
    assert growth.exponent(rows, "total_s") == pytest.approx(1.25)
    assert math.isnan(growth.exponent(rows, "cpu_s"))
    assert "time N^1.25" in growth.growth(rows)


def test_profile_has_the_share_and_the_limit_of_each_part() -> None:
    """By the limits of the scene's own series; the parts of the page are those of its numbers."""
    scene = {"series": "sea", "objects": 10, "pieces": 2_000_000, "solved_pairs": 10**6, "conflicts": 500_000}
    scene |= {"pieces_s": 40.0, "stage1_s": 20.0, "stage2_s": 1.0, "stage3_s": 1.0, "stage4_s": 30.0, "write_s": 8.0}
    limits = {"COPY alone": 5.0, "arithmetic alone": 10.0, "kernel alone": 2.0, "COPY, indexes, event": 16.0}
    costs = [{"scene": "sea 7", "limit": name, "limit_us": us} for name, us in limits.items()]
    costs += [{"scene": "box 7", "limit": name, "limit_us": 1e9} for name in limits]
    found = profiles.parts(scene | {"cpu_s": 100.0}, costs)
    assert [part["share"] for part in found] == [0.4, 0.2, 0.02, 0.38]
    assert [part["limit_s"] for part in found] == [pytest.approx(30.0), None, None, pytest.approx(10.0)]
    page = Path(__file__).parents[2] / "docs/explanation/performance.md"
    folder = page.with_suffix("")
    assert profiles.table(read_csv(folder / "growth.csv"), read_csv(folder / "unit-costs.csv")) in page.read_text()


def test_numbers_come_back_from_a_file(tmp_path: Path) -> None:
    """Rounded to four digits; words stay words, and unknown values stay unknown."""
    path = tmp_path / "numbers.csv"
    write_csv(path, [{"series": "sea", "objects": 1_000_000, "total_s": 1.23456, "cpu_s": None}])
    assert read_csv(path) == [{"series": "sea", "objects": 1_000_000, "total_s": 1.235, "cpu_s": None}]


def test_memory_is_told_in_megabytes() -> None:
    assert 20.0 < peak_mb() < 20_000.0


def test_real_runs_stand_side_by_side() -> None:
    """A column for each scene; its conflicts are compared with the known ones."""
    assert set(real_runs.SEPARATION_M) <= set(real_runs.KNOWN)
    run = real_runs.RealRun(
        "ais-hour",
        "183 ships",
        1.0,
        DETECTION,
        DETECTION,
        {"conflict": 26, "grazing": 6},
        {"track-track": 32},
        (0.0, 0.5),
        300.0,
    )
    lines = real_runs.table([run, replace(run, name="ais-hour-500m", verdicts={"conflict": 981})]).splitlines()
    assert lines[0] == "|  | ais-hour | ais-hour-500m |"
    assert "| conflicts | 2: 26 `conflict`, 6 `grazing` | 2: 981 `conflict` |" in lines
    assert "| stage4 | 0.5 | 0.5 |" in lines


def test_few_functions_lead_from_objects_to_a_conflict_row() -> None:
    """A reader opens these: more mean a layer that a scene without its feature should not enter."""
    assert len(walk_solve.walk().to_read()) <= 30
