"""Every field of areas and tracks at every border: it is kept to the last bit, or refused or changed as listed here.

The fields are those of the classes (`tests/support/full_plans.py`), so a new one fails until each border handles it.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import make_dataclass, replace
from pathlib import Path
from typing import Any, Final

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from full_plans import HOUR_US, SCENE, Border, Plan, lost, specimens, track, values_of

from conflictdb import formats
from conflictdb.arrays.arrow.object_rows import of_objects, to_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core.pieces.digests import area_digests, track_digests
from conflictdb.core.world import World
from conflictdb.errors import ConflictDBError, InvalidInput
from conflictdb.formats.from_frames import TimeZone, areas_of, tracks_of
from conflictdb.formats.hints import FileHints
from conflictdb.formats.scene_file import feature_of, read_scene, scene_text
from conflictdb.formats.writing_scenes import write_scene_file
from conflictdb.map.editing import PlanMove, digest, moved
from conflictdb.map.what_if import packed
from conflictdb.model.plan_columns import AREA, TRACK, columns_of
from conflictdb.model.plans import Area, Motion, Track, VerticalDatum
from conflictdb.model.recurring_plans import later
from conflictdb.spark.cut_objects import cut

_RECURS: Final = "spans_us", "departures_us", "schedule"


def only(found: tuple[list[Area], list[Track]]) -> Plan:
    some = [*found[0], *found[1]]
    assert some
    return some[0]


def copied(plan: Plan, **changes: Any) -> Plan:
    if isinstance(plan, Track):
        return replace(plan, **changes, max_speed_kn=np.inf)
    return replace(plan, **changes)


def split(plan: Plan) -> tuple[list[Area], list[Track]]:
    return ([plan], []) if isinstance(plan, Area) else ([], [plan])


def by_file(folder: Path, name: str) -> Callable[[Plan], Plan]:
    """Return a function that writes a plan to a file and reads it."""

    def carry(plan: Plan) -> Plan:
        write_scene_file([plan], folder / name, SCENE)
        read = formats.read(folder / name)
        return only((read.areas, read.tracks))

    return carry


def by_zone(folder: Path) -> Callable[[Plan], Plan]:
    """Return a function that writes an area as a zone and reads it, without what the standard requires of a zone."""
    carry = by_file(folder, "plan.ed318.json")

    def carried(plan: Plan) -> Plan:
        found = carry(plan)
        required = ("country", "type", "variant", "zoneAuthority")
        return copied(found, properties={name: one for name, one in found.properties.items() if name not in required})

    return carried


def by_text(plan: Plan) -> Plan:
    read = read_scene("".join(scene_text(SCENE, *split(plan))), "other")
    return only((read.areas, read.tracks))


def by_text_one_by_one(plan: Plan) -> Plan:
    """A box of the feature makes it no plain one: it is read by the other reader."""
    feature = {**feature_of(plan), "bbox": [0, 50, 10, 60]}
    read = read_scene(json.dumps({"type": "FeatureCollection", "features": [feature]}), "other")
    return only((read.areas, read.tracks))


def frame_of(plan: Plan, *, is_text: bool = False) -> geopandas.GeoDataFrame:
    """Return a frame with one row, whose columns are the members of a scene file; lists as they are, or as JSON."""
    feature = feature_of(plan)
    members: dict[str, Any] = {"id": plan.key, **feature["properties"]}
    del members["kind"]  # it is no column of a frame
    for name, value in members.items():
        if is_text and isinstance(value, list | dict):
            members[name] = json.dumps(value)
        elif name in ("start", "end") and not is_text:
            members[name] = pd.Timestamp(value)
    columns = {name: pd.Series([value], dtype=object if isinstance(value, list | dict) else None)
               for name, value in members.items()}  # fmt: skip
    return geopandas.GeoDataFrame(columns, geometry=[shapely.geometry.shape(feature["geometry"])], crs=4326)


def by_frame(plan: Plan) -> Plan:
    read = areas_of if isinstance(plan, Area) else lambda *given: tracks_of(*given[:2], {}, given[2])
    (one,) = read(frame_of(plan), SCENE, TimeZone(None))
    # A missing value of a column is an absent member.
    missing = {name: None for name, value in plan.properties.items() if value is None}
    return copied(one, properties={**one.properties, **missing})


def by_foreign_file(folder: Path, name: str) -> Callable[[Plan], Plan]:
    """Return a function that writes a plan with the columns of scene files, as another program does, and reads it."""

    def carry(plan: Plan) -> Plan:
        path = folder / name
        if name.endswith(".parquet"):
            frame_of(plan, is_text=True).to_parquet(path)
        else:
            path.unlink(missing_ok=True)
            frame_of(plan, is_text=True).to_file(path, driver="GPKG")
        read = formats.read(path)
        return only((read.areas, read.tracks))

    return carry


def by_positions(folder: Path) -> Callable[[Plan], Plan]:
    """Return a function that writes a track as a row for each waypoint, with its other members as columns."""

    def carry(plan: Plan) -> Plan:
        assert isinstance(plan, Track)
        feature = feature_of(plan)
        members = {"id": plan.key, **feature["properties"]}
        times, _ = members.pop("times"), members.pop("kind")
        cells = {name: one if isinstance(one, str) else json.dumps(one) for name, one in members.items()}
        rows = [
            {**cells, "time": at, "lon": lon, "lat": lat}
            for at, (lon, lat) in zip(times, plan.positions_deg.tolist(), strict=True)
        ]
        pd.DataFrame(rows).to_csv(folder / "fixes.csv", index=False)
        read = formats.read(folder / "fixes.csv")
        return only((read.areas, read.tracks))

    return carry


def by_arrow(plan: Plan) -> Plan:
    return only(to_objects(of_objects(*split(plan))))


def by_spark(plan: Plan) -> Plan:
    """Rows of objects, as Spark cuts them, have the digest of the plan: it has all fields on which conflicts depend."""
    areas, tracks = split(plan)
    world = World.of(SCENE, areas, tracks)
    rows = list(cut([of_objects(areas, tracks)], SCENE, window=world.window))
    refused = [one for row in rows for one in row.column("refused").to_pylist() if one is not None]
    if refused:
        raise ConflictDBError(refused[0])
    found = [one for row in rows for one in row.column("digest").to_pylist() if one is not None]
    areas, tracks = world.expanded(areas, tracks)
    mine = area_digests(AreaBatch.of(areas)) if areas else track_digests(TrackBatch.of(tracks))
    assert found == mine.tolist()
    return plan


def by_page(plan: Plan) -> Plan:
    """The plan that the page is given, which it shows and moves."""
    assert isinstance(plan, Track)
    data = packed(SCENE, [], [plan])
    head = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
    feature = head["plans"][plan.key]
    read = read_scene(json.dumps({"type": "FeatureCollection", "features": [feature]}), "other")
    return only((read.areas, read.tracks))


def by_move(plan: Plan) -> Plan:
    """A plan that the page moves there and back: later, higher, another waypoint."""
    assert isinstance(plan, Track)
    for way in (1, -1):
        move = PlanMove(plan.key, digest(plan), way * HOUR_US, way * 64.0, None, None)
        plan = moved(plan, move)
    place = (2, *plan.positions_deg[2].tolist())
    return moved(plan, PlanMove(plan.key, digest(plan), 0, 0.0, place, None))


# Nested ones are JSON texts; of positions all are texts.
_TEXTS: Final[Mapping[str, Sequence[str]]] = {"properties": ()}
IN_MEMORY: Final[Mapping[str, Callable[[Path], Border]]] = {
    "GeoJSON": lambda _: Border(by_text),
    "GeoJSON, one by one": lambda _: Border(by_text_one_by_one),
    "GeoParquet": lambda path: Border(by_file(path, "plan.parquet"), is_slow=True),
    "KML": lambda path: Border(
        by_file(path, "plan.kml"),
        refuses={"schedule": "schedule"},
        changes={"properties": (), "spans_us": ("key", "end_us"), "departures_us": ("key", "times_us")},
        is_slow=True,
    ),
    "RTZ": lambda path: Border(by_file(path, "plan.rtz"), kinds=(Track,), other_kind="areas"),
    "ED-318": lambda path: Border(
        by_zone(path), refuses={"schedule": "schedule"}, kinds=(Area,), other_kind="holds areas only"
    ),
    "foreign GeoParquet": lambda path: Border(by_foreign_file(path, "foreign.parquet"), changes=_TEXTS, is_slow=True),
    "GeoPackage": lambda path: Border(by_foreign_file(path, "foreign.gpkg"), changes=_TEXTS, is_slow=True),
    "positions": lambda path: Border(
        by_positions(path),
        refuses={
            **dict.fromkeys(
                ("outline_m", "grow_mps", "outlines_m", "tolerances", "departures_us", "schedule"), "column"
            ),
            "floors_m": "floor_m",
            "ceilings_m": "ceiling_m",
        },
        changes=_TEXTS,
        kinds=(Track,),
    ),
    "Arrow": lambda _: Border(by_arrow),
    "rows of Spark": lambda _: Border(by_spark),
    "frames": lambda _: Border(by_frame),
    "page": lambda _: Border(by_page, kinds=(Track,)),
    "moved on the page": lambda _: Border(by_move, refuses={"schedule": "change it instead"}, kinds=(Track,)),
    "later": lambda _: Border(lambda plan: later(plan, 0), changes={"schedule": ()}),
}


def test_field_that_no_border_knows_is_lost() -> None:
    new = make_dataclass("_NewArea", [("mood", str | None, None)], bases=(Area,), frozen=True)
    plan = new("A", shapely.box(4.0, 57.0, 5.0, 58.0), mood="calm")
    for carry in (by_text, by_text_one_by_one, by_arrow, by_frame):
        assert lost(plan, carry(plan)) == ["mood"]
    with pytest.raises(AssertionError, match="mood"):
        values_of(new)


@pytest.mark.parametrize("name", ["plan.geojson", "plan.parquet", "plan.kml", "plan.rtz", "plan.f3548.json"])
def test_legs_of_another_motion_are_refused(tmp_path: Path, name: str) -> None:
    """Files do not say the lines of a track, but those of the scene."""
    with pytest.raises(InvalidInput, match="legs: are great circles, and the scene follows rhumb lines"):
        write_scene_file([track(legs=Motion.GREAT_CIRCLE)], tmp_path / name, SCENE)
    assert not list(tmp_path.iterdir())


# Fields that become volumes, which contain the object, and fields of each volume.
_AS_VOLUMES: Final = {
    *("footprint", "start_us", "end_us", "spans_us", "positions_deg", "times_us", "departures_us", "outline_m"),
    *("outlines_m", "grow_mps", "floor_m", "ceiling_m", "floors_m", "ceilings_m", "tolerances"),
}
_REFUSED_BY_VOLUMES: Final = {"schedule", "legs"}
_OF_VOLUMES: Final = {one.field for one in columns_of(AREA) if one.is_member or one.name == "properties"} - (
    _AS_VOLUMES | _REFUSED_BY_VOLUMES
)
# Areas have no such.
_ONLY_OF_TRACKS: Final = {one.field for one in columns_of(TRACK) if one.is_member and AREA not in one.kinds}


@pytest.mark.parametrize("kind", [Area, Track])
def test_every_field_in_operational_intents(tmp_path: Path, kind: type[Plan]) -> None:
    assert values_of(kind).keys() - {"key"} <= _AS_VOLUMES | _OF_VOLUMES | _REFUSED_BY_VOLUMES | _ONLY_OF_TRACKS
    settings, path = replace(SCENE, vertical_datum=VerticalDatum.WGS84), tmp_path / "plan.f3548.json"
    for one in specimens():
        if not isinstance(one.plan, kind) or len(one.fields) == 1:
            continue
        if one.plan.schedule is not None:
            with pytest.raises(InvalidInput, match="schedule"):
                write_scene_file([one.plan], path, settings)
            continue
        write_scene_file([one.plan], path, settings)
        volumes = formats.read(path, hints=FileHints(vertical_datum=VerticalDatum.WGS84)).areas
        assert {area.key.rpartition("/")[0] for area in volumes} == {one.plan.key}
        for area in volumes:
            assert {**area.properties, **one.plan.properties} == area.properties
            for name in _OF_VOLUMES - {"properties"}:
                assert getattr(area, name) == getattr(one.plan, name)


@pytest.mark.parametrize("name", IN_MEMORY)
def test_every_field_at_borders_in_memory(tmp_path: Path, name: str) -> None:
    faults = list(IN_MEMORY[name](tmp_path).faults())
    assert not faults, "\n".join(faults)
