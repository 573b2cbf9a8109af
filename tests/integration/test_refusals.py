"""Bad values of the columns of plans: one table, through every way in. Each way refuses each in the same words.

A way that cannot carry a value is not asked: an empty text of a file is no value.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import geopandas
import pandas as pd
import psycopg
import pytest
import shapely

from conflictdb import Area, InvalidInput, Scene, Track, connect, read
from conflictdb.formats.scene_file import read_plans
from conflictdb.memory.questions import solve

T0_S = 1_772_323_200  # 2026-03-01 00:00 UTC
SQUARE = [(4.0, 57.0), (5.0, 57.0), (5.0, 58.0), (4.0, 58.0), (4.0, 57.0)]
RING = [(-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0)]
AREA: dict[str, Any] = {"footprint": SQUARE}
TRACK: dict[str, Any] = {"path": [(4.0, 57.0), (4.5, 57.2), (5.0, 57.0)], "times": [0, 7200, 14400], "outline": RING}


@dataclass(frozen=True)
class Refusal:
    """A plan that is refused.

    given : what differs from a valid plan, times in seconds after T0_S
    says : a part of the sentence
    sqlstate, constraint : of the database's refusal; None: no geometry of PostGIS is such
    field : of the refusal in Python, as files name it
    in_sql : a part of the database's sentence, where it has another one
    """

    kind: str
    given: Mapping[str, Any]
    says: str
    field: str
    sqlstate: str | None = None
    constraint: str | None = None
    in_sql: str = ""

    @property
    def plan(self) -> dict[str, Any]:
        return {**(AREA if self.kind == "area" else TRACK), **self.given}

    def is_of_files(self) -> bool:
        """Whether JSON and tables have such a value: an empty text there is none."""
        numbers = [one for one in self.given.values() if isinstance(one, float)]
        both = {"floor_m", "floors_m"} <= self.given.keys()  # files have one of them
        is_more = "xtd" in self.given.get("tolerances", {})  # a property
        return not both and not is_more and "" not in self.given.values() and not any(map(math.isnan, numbers))


Ring = list[tuple[float, float]]
BOTH = ("area", "track")


def of_both(column: str, value: Any, says: str, *rule: str, **more: Any) -> dict[str, Refusal]:
    given = {column: value, **more}
    return {f"{kind} {column} {value!r:.12}": Refusal(kind, given, says, column, *rule) for kind in BOTH}


def area_at(ring: Ring, says: str, *rule: str) -> Refusal:
    return Refusal("area", {"footprint": ring}, says, "geometry", *rule)


def track_at(path: Ring, says: str, *rule: str) -> Refusal:
    return Refusal("track", {"path": path, "times": [7200 * n for n in range(len(path))]}, says, "geometry", *rule)


def track_with(field: str, value: Any, says: str, *rule: str) -> Refusal:
    column = {"outline_m": "outline"}.get(field, field.partition("[")[0])
    return Refusal("track", {column: value}, says, field, *rule)


def track_of(field: str, says: str, *rule: str, **given: Any) -> Refusal:
    return Refusal("track", given, says, field, *rule)


def tolerance(field: str, value: Any, says: str, constraint: str, in_sql: str) -> Refusal:
    name = field.partition("[")[0].removeprefix("tolerances.")
    return Refusal("track", {"tolerances": {name: value}}, says, field, "ZC007", f"tolerances_{constraint}", in_sql)


_SAME_TIME, _CONVEX = "two places at the same time", ("convex", "ZC006", "outline_convex")
_GROWTH = ("from 0 to 1e6", "ZC006", "track_growth_in_range")
_BYTES = "1 to 200 bytes"
_CONVEX_RING, _CROSSED = ("convex ring", "ZC006", "outline_convex"), [RING[n] for n in (0, 2, 1, 3)]
_SHARP = ("sharper than 1 degree", "ZC006", "outline_not_sharp")
_PER_WAYPOINT = ("ZC006", "outline_per_waypoint")
_PER_LEG = "one per leg (2) or one per waypoint (3)"
_LEGS = ("ZC004", "height_per_leg")
_ABOVE = ("above the floor", "ZC004", "ceiling_above_floor")
REFUSALS = {
    "area crosses itself": area_at(
        [(0, 0), (1, 1), (1, 0), (0, 1), (0, 0)], "Self-intersection", "ZC001", "footprint_valid"
    ),
    "area without width": area_at([(0, 0), (1, 1), (2, 2), (0, 0)], "valid polygon", "ZC001", "footprint_valid"),
    "area beyond the pole": area_at([(0, 0), (1, 0), (1, 91), (0, 0)], "latitude must", "ZC005", "latitude_in_range"),
    "area beyond a turn": area_at(
        [(400, 0), (401, 0), (401, 1), (400, 0)], "longitude must", "ZC005", "longitude_in_range"
    ),
    "area wider than a turn": area_at(
        [(-200, 0), (200, 0), (0, 1), (-200, 0)], "wider than 360", "ZC005", "footprint_within_a_turn"
    ),
    **of_both("ceiling_m", 10.0, "above floor_m", "ZC004", "ceiling_above_floor", floor_m=10.0),
    **of_both("floor_m", math.nan, "finite", "ZC004", "heights_finite"),
    **of_both("ceiling_m", math.inf, "finite", "ZC004", "heights_finite"),
    **of_both("class", "", _BYTES, "ZC008", "word_valid"),
    **of_both("class", "x" * 201, _BYTES, "ZC008", "word_valid"),
    **of_both("class", "track", "must not be 'track'", "ZC008", "class_no_kind"),
    **of_both("owner", "", _BYTES, "ZC008", "word_valid"),
    **of_both("owner", "é" * 101, _BYTES, "ZC008", "word_valid"),
    "track beyond the pole": track_at([(3, 56), (4, 157), (5, 57)], "latitude must", "ZC005", "latitude_in_range"),
    "track of one waypoint": track_at([(3, 56)], "at least two waypoints"),
    "track at two places": track_with("times[1]", [0, 0, 7200], _SAME_TIME, "ZC002", "path_time_increasing"),
    "track back in time": track_with("times[2]", [0, 7200, 3600], "later than", "ZC002", "path_time_increasing"),
    "track too fast": track_with("times[1]", [0, 10, 7200], "beyond 2000 kn", "ZC002", "path_speed_possible"),
    "haven not convex": track_with("outline_m", [(0, 0), (4, 0), (1, 1), (0, 4)], *_CONVEX),
    "haven crosses itself": track_with("outline_m", [(0, 0), (2, 2), (2, 0), (0, 2)], *_CONVEX),
    "track shrinks": track_with("grow_mps", -1.0, *_GROWTH),
    "track grows without measure": track_with("grow_mps", 2e6, *_GROWTH),
    "track grows by no number": track_with("grow_mps", math.nan, *_GROWTH),
    "a spike grows": track_of("outline_m", *_SHARP, outline=[(0, 0), (1000, 0), (1000, 5)], grow_mps=1.0),
    "a line grows": track_of("outline_m", *_SHARP, outline=[(0, 0), (5, 0), (9, 0)], grow_mps=1.0),
    "grows and changes": track_of(
        "grow_mps", "together with outlines", "ZC006", "track_growth_given_once", grow_mps=1.0, outlines_m=[RING] * 3
    ),
    "an outline too few": track_of("outlines_m", "3 waypoints, 2 outlines", *_PER_WAYPOINT, outlines_m=[RING] * 2),
    "turned inside out": track_of(
        "outlines_m[1]", "does not stay convex", "ZC006", "outlines_stay_convex", outlines_m=[RING, RING[::-1], RING]
    ),
    "changes and is not convex": track_of("outlines_m[2]", *_CONVEX_RING, outlines_m=[RING, RING, _CROSSED]),
    "heights too few": track_of("floor_m", f"{_PER_LEG}; got 1 heights", *_LEGS, floors_m=[1.0]),
    "no heights": track_of("floor_m", f"{_PER_LEG}; got 0 heights", *_LEGS, floors_m=[]),
    "a height is no number": track_of("ceiling_m[1]", "finite", "ZC004", "heights_finite", ceilings_m=[1.0, math.nan]),
    "a leg without height": track_of("ceiling_m[1]", *_ABOVE, floors_m=[1.0, 5.0], ceilings_m=[2.0, 5.0]),
    "a leg above the whole": track_of("ceiling_m", *_ABOVE, floors_m=[1.0, 5.0], ceiling_m=4.0),
    "the whole above a leg": track_of("ceiling_m[1]", *_ABOVE, floor_m=3.0, ceilings_m=[4.0, 3.0]),
    "another height of the whole": track_of(
        "floor_m", "must be that of all legs", "ZC004", "height_of_all_legs", floors_m=[0.0, 5.0], floor_m=4.0
    ),
    "unknown tolerance": tolerance("tolerances.xtd", 5, "is not known", "known", "'xtd' is not known"),
    "negative limit": tolerance("xtd_port_m", -1, "0 or more", "number", "a number from 0 to 18520; got -1"),
    "limit in nautical miles": tolerance(
        "xtd_port_m", 740_800, "in metres read as nautical miles", "number", "from 0 to 18520; got 740800"
    ),
    "limits too many": tolerance("xtd_port_m", [1, 2, 3], "one per leg: 2; got 3", "count", "must be one number, or 2"),
    "radii too many": tolerance("turn_radius_m", [1, 2], "one per turn: 1; got 2", "count", "must be one number, or 1"),
    "no speed": tolerance("max_speed_kn", 0, "greater than 0", "number", "must be a number from 0"),
    "window without its time": tolerance(
        "departure_window", ["2026-03-01T00:10Z", "2026-03-01T00:20Z"], "must contain", "window", "planned time of its"
    ),
    "window without its end": tolerance(
        "departure_window", ["2026-03-01T00:10Z"], "earliest, latest", "count", "must be [earliest, latest]"
    ),
    "window of words": tolerance("arrival_window[0]", ["soon", "later"], "ISO 8601", "window", "must be two instants"),
    # JSON of the database has no such number, and it takes the two others.
    "a limit is no number": track_of("xtd_starboard_m[1]", "finite", tolerances={"xtd_starboard_m": [1, math.nan]}),
    "slower than slowest": track_of(
        "min_speed_kn", "must not be greater than max_speed_kn", tolerances={"min_speed_kn": 5, "max_speed_kn": 4}
    ),
    "as slow as nothing": track_of("min_speed_kn", "without an arrival_window", tolerances={"min_speed_kn": 0}),
}  # fmt: skip


def instant(at_s: float) -> datetime:
    return datetime.fromtimestamp(T0_S + at_s, UTC)


def by_constructor(plan: dict[str, Any]) -> None:
    given = dict(plan)
    if "class" in given:
        given["object_class"] = given.pop("class")
    if "footprint" in given:
        Area("P", **given)
    else:
        path, times = given.pop("path"), [instant(one) for one in given.pop("times")]
        Track("P", path, times, given.pop("outline"), **given)


def as_feature(plan: dict[str, Any]) -> dict[str, Any]:
    given = dict(plan)
    if "footprint" in given:
        geometry = {"type": "Polygon", "coordinates": [given.pop("footprint")]}
    else:
        geometry = {"type": "LineString", "coordinates": given.pop("path")}
        given["times"] = [instant(one).isoformat() for one in given["times"]]
        outline = given.pop("outline")
        if "outlines_m" not in given:
            given["outline_m"] = outline
        for name in ("floor", "ceiling"):
            if f"{name}s_m" in given:
                given[f"{name}_m"] = given.pop(f"{name}s_m")
        given |= given.pop("tolerances", {})
    return {"type": "Feature", "id": "P", "geometry": geometry, "properties": given}


def by_file(plan: dict[str, Any], folder: Path) -> None:
    path = folder / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "scene": {"name": "s"}, "features": [as_feature(plan)]}))
    read(path)


def by_request(plan: dict[str, Any]) -> None:
    read_plans(
        json.dumps({"type": "FeatureCollection", "version": 1, "features": [as_feature(plan)]}), Scene("s"), 2000.0
    )


def by_frame(plan: dict[str, Any]) -> None:
    given = as_feature(plan)["properties"]
    if "times" in given:
        given["times"] = [pd.Timestamp(instant(one)) for one in plan["times"]]
    shape = shapely.Polygon(plan["footprint"]) if "footprint" in plan else shapely.LineString(plan["path"])
    frame = geopandas.GeoDataFrame({"id": ["P"], **{k: [v] for k, v in given.items()}}, geometry=[shape], crs=4326)
    solve([], frame) if "footprint" in plan else solve(frame, [])


def as_row(plan: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of a plan as PostgreSQL reads them."""
    given = dict(plan)
    if "footprint" in given:
        points = ",".join(f"{x} {y}" for x, y in given["footprint"])
        return {**given, "footprint": f"SRID=4326;MULTIPOLYGON((({points})))"}
    waypoints = ",".join(f"{x} {y} {T0_S + t}" for (x, y), t in zip(given["path"], given.pop("times"), strict=True))
    given |= {"path": f"SRID=4326;LINESTRING M({waypoints})", "outline": f"POLYGON({ring_text(given['outline'])})"}
    if "outlines_m" in given:
        given["outlines"] = f"MULTIPOLYGON({','.join(f'({ring_text(one)})' for one in given.pop('outlines_m'))})"
    if "tolerances" in given:
        given["tolerances"] = json.dumps(given["tolerances"])
    return given


def ring_text(ring: Ring) -> str:
    return f"({','.join(f'{x} {y}' for x, y in [*ring, ring[0]])})"


def by_put(plan: dict[str, Any], conn: psycopg.Connection[Any]) -> None:
    row = as_row(plan)
    kind = "area" if "footprint" in row else "track"
    named = ", ".join(f"p_{name} => %({name})s" for name in row)
    conn.execute(f"SELECT conflictdb.put_{kind}('s', 'P', {named})".encode(), row)


def by_copy(plan: dict[str, Any], conn: psycopg.Connection[Any]) -> None:
    row = as_row(plan)
    kind = "area" if "footprint" in row else "track"
    (scene_id,) = conn.execute("SELECT scene_id FROM conflictdb.scene").fetchone() or ()
    names = ", ".join(row)
    with conn.cursor().copy(f"COPY conflictdb.{kind} (scene_id, key, {names}) FROM STDIN".encode()) as copy:
        copy.write_row([scene_id, "P", *row.values()])


def said(enter: Callable[[dict[str, Any]], None], plan: dict[str, Any]) -> str:
    """Return the field and the sentence of the refusal of a plan; empty if it is taken."""
    try:
        enter(plan)
    except InvalidInput as refused:
        return f"{refused.field}: {refused.rule}"
    return ""


def wrong(found: Mapping[str, str], *, in_sql: bool = False) -> dict[str, str]:
    words = {name: (one.in_sql if in_sql and one.in_sql else one.says) for name, one in REFUSALS.items()}
    return {name: text for name, text in found.items() if words[name] not in text}


def wrong_in_python(found: Mapping[str, str]) -> dict[str, str]:
    named = {name: text for name, text in found.items() if not text.startswith(REFUSALS[name].field)}
    return wrong(found) | named


def test_python_refuses_each() -> None:
    assert wrong_in_python({name: said(by_constructor, one.plan) for name, one in REFUSALS.items()}) == {}


def test_files_and_requests_refuse_each(tmp_path: Path) -> None:
    asked = {name: one.plan for name, one in REFUSALS.items() if one.is_of_files()}
    assert (
        wrong_in_python({name: said(lambda plan: by_file(plan, tmp_path), plan) for name, plan in asked.items()}) == {}
    )
    assert wrong_in_python({name: said(by_request, plan) for name, plan in asked.items()}) == {}


def test_frames_refuse_each() -> None:
    asked = {name: one.plan for name, one in REFUSALS.items() if one.is_of_files() and one.sqlstate is not None}
    del asked["a height is no number"]  # which is none in a frame
    assert wrong_in_python({name: said(by_frame, plan) for name, plan in asked.items()}) == {}


@pytest.fixture
def scene(conn: psycopg.Connection[Any]) -> Iterator[psycopg.Connection[Any]]:
    conn.execute("SELECT conflictdb.create_scene('s')")
    yield conn
    conn.rollback()


@pytest.mark.parametrize("way", [by_put, by_copy])
def test_the_database_refuses_each(scene: psycopg.Connection[Any], way: Callable[..., None]) -> None:
    """With its own SQLSTATE, whoever writes: the rules are the tables'."""
    found, rules = {}, {}
    asked = {name: one for name, one in REFUSALS.items() if one.sqlstate is not None}
    for name, one in asked.items():
        try:
            with scene.transaction():
                way(one.plan, scene)
                raise psycopg.Rollback
        except psycopg.Error as refused:
            said = refused.diag
            found[name] = str(said.message_primary)
            rules[name] = (refused.sqlstate, said.constraint_name, bool(said.table_name and said.column_name))
    assert wrong(found, in_sql=True) == {}
    assert rules == {name: (one.sqlstate, one.constraint, True) for name, one in asked.items()}


def test_attached_tables_refuse_each(dsn: str) -> None:
    """Rows of a table of someone else that cannot be plans are listed with the reason."""
    names = ("floor_m", "ceiling_m", "class", "owner")
    with psycopg.connect(dsn) as conn:
        conn.execute("SELECT conflictdb.create_scene('s')")
        conn.execute(
            "CREATE SCHEMA mission; CREATE TABLE mission.plan (id text PRIMARY KEY, shape geometry,"
            " floor_m float8, ceiling_m float8, class text, owner text)"
        )
        asked = {name: one for name, one in REFUSALS.items() if one.kind == "area" and one.is_of_files()}
        for name, one in asked.items():
            row = as_row(one.plan)
            values = [name, row["footprint"], *(row.get(column) for column in names)]
            conn.execute("INSERT INTO mission.plan VALUES (%s, %s, %s, %s, %s, %s)", values)
    mapped = {"key": "id", "footprint": "shape", **{name: name for name in names}}
    with connect(dsn) as db:
        db.scene("s").attach("area", "mission.plan", mapped)
        db.scene("s").detect()
        found = {row.identity.strip('{}"'): row.reason for row in db.scene("s").unmapped()}
    assert wrong({name: found.get(name, str(found)) for name in asked}) == {}
