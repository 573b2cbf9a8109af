"""Spark gives the answer of `solve`: ten scenes with all features are detected from GeoParquet by the command line.

Partitions split each scene, so that no worker knows the voyages over which the schedules of others are expanded.
"""

from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Final

import pyarrow as pa
import pytest
from case import Case
from mixed_scenes import Mixed, mixed_scene
from pyarrow import parquet
from scene_features import FEATURES, Feature
from spark_answers import Spark, in_order

from conflictdb.arrays.arrow.found import of_rows
from conflictdb.formats import write_scene_file

pytestmark = [pytest.mark.spark, pytest.mark.xdist_group("spark")]

# Nothing is refused: `conflictdb.model.path_limits` has no row for Spark.
SCENES: Final = {
    0: {Feature.ACTIVATIONS, Feature.SEPARATION, Feature.GROWTH, Feature.NEAREST},
    1: {Feature.DEPARTURES, Feature.OWNERS, Feature.SCHEDULE_OF_AREA, Feature.SCHEDULE_OF_TRACK},
    2: {Feature.CROSS_TRACK, Feature.DEPARTURE_WINDOW, Feature.CLASSES},
    3: {Feature.UNBOUNDED, Feature.SPEED_WINDOW, Feature.ARRIVAL_WINDOW, Feature.TURN_RADIUS},
    4: {Feature.CLIMBS, Feature.VERTICAL_SEPARATION, Feature.FAR},
    5: {Feature.LEG_HEIGHTS, Feature.CLOSED, Feature.ANTIMERIDIAN},
    6: {Feature.CLASSES, Feature.ALLOWED, Feature.CLASS_VERTICAL, Feature.FAR, Feature.DEPARTURES},
    7: {Feature.TIME_SEPARATION, Feature.CLASS_TIME, Feature.ZERO, Feature.SCHEDULE_OF_AREA},
    8: {Feature.OUTLINES, Feature.GREAT_CIRCLE, Feature.SCHEDULE_OF_TRACK},
    9: {Feature.HIGH_LATITUDE, Feature.SPHERE, Feature.HEIGHTS, Feature.FAR},
}
# Columns of a database, and those that rows of `solve` have in another form.
_NEVER: Final = {"spans_us": None, "start_us": None, "end_us": None}
_OTHERS: Final = ("a_version", "b_version", "a_name", "b_name", "region", "scene")


def test_ten_scenes_are_detected(tmp_path: Path, spark: Spark) -> None:
    cases = [Case(with_idle_area(mixed_scene(seed, features)), tmp_path) for seed, features in SCENES.items()]
    assert reduce(frozenset.union, (case.mixed.features for case in cases)) == frozenset(FEATURES)
    commands = []
    for case in cases:
        path = tmp_path / f"{case.mixed.seed}.parquet"
        write_scene_file(case.mixed.objects, path, case.scene)
        commands.append(["spark", "detect", "--partitions", "3", "--input", str(path)])
        commands[-1] += ["--output", str(path.with_suffix(".found"))]
    for case, (code, said) in zip(cases, spark.run(commands), strict=True):
        assert code == 0, (case.mixed.seed, said)
        assert "'idle': no activation of the schedule" in said, (case.mixed.seed, said)
        found = parquet.read_table(tmp_path / f"{case.mixed.seed}.found")
        expected = of_rows(list(case.rows.values()))
        assert expected.num_rows
        assert rows_of(found) == rows_of(pa.Table.from_batches([expected])), case.mixed.seed


def with_idle_area(mixed: Mixed) -> Mixed:
    """Return the scene with an area whose schedule has no activation in the expanded window."""
    past = {"rrule": "DTSTART:19700101T000000Z\nRRULE:FREQ=DAILY;COUNT=1", "duration": "PT1H"}
    return replace(mixed, areas=[*mixed.areas, replace(mixed.areas[0], key="idle", schedule=past, **_NEVER)])


def rows_of(found: pa.Table) -> list[dict[str, object]]:
    return in_order(found.drop_columns([name for name in _OTHERS if name in found.column_names])).to_pylist()
