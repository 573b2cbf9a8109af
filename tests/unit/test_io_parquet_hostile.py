"""GeoParquet as attackers write it: no crash, bounded time and memory, one message."""

import json
import os
import struct
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import shapely
from draws import draws
from plan_files import hostile_refusal

from conflictdb import formats
from conflictdb.arrays.arrow.found import FOUND, GEOMETRIES
from conflictdb.arrays.arrow.object_rows import OBJECTS
from conflictdb.errors import InvalidInput
from conflictdb.formats import contents
from conflictdb.formats.computed import read_conflicts

pytestmark = pytest.mark.usefixtures("readers_of_users")

SQUARE = shapely.box(4, 57, 5, 58).wkb
LINE = shapely.LineString([(4, 57), (5, 58)]).wkb
ROW = {"kind": ["area"], "id": ["a"]}
XYM = {"x": 1.0, "y": 2.0, "m": 3.0}
DEEP = 200_000
NESTED = "row 0 nests geometries more than 32 deep"


def nested(kind: int) -> pa.Array:
    """Geometries in geometries: GEOS overflows the stack at far fewer levels."""
    return pa.array([struct.pack("<BII", 1, kind, 1) * 100_000 + struct.pack("<BII", 1, kind, 0)], pa.binary())


def of_scene(**columns: Any) -> pa.Table:
    return pa.table({**ROW, **columns}).replace_schema_metadata(OBJECTS.schema.metadata)


def of_others(encoding: str = "WKB", crs: Any = None, **columns: Any) -> pa.Table:
    column = {"encoding": encoding, "geometry_types": [], **({"crs": crs} if crs else {})}
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
    return pa.table(columns).replace_schema_metadata({"geo": json.dumps(geo)})


def refusal(path: Path, table: pa.Table, **options: Any) -> str:
    pq.write_table(table, path)
    return hostile_refusal(path, **options)


def of_properties(text: str) -> pa.Table:
    return of_scene(geometry=pa.array([SQUARE]), properties=[text])


def bits(count: int) -> dict[str, pa.Array]:
    return {f"c{i}": pa.nulls(1, pa.bool_()) for i in range(count)}


TABLES = {
    "collections in collections": (of_others(geometry=nested(7)), NESTED),
    "polygons in polygons": (of_others(geometry=nested(6)), "row 0 has a geometry of kind 6 where only kind 3 may be"),
    "of a scene": (of_scene(geometry=nested(7)), NESTED),
    "in hexadecimal": (of_others(geometry=pa.array([nested(7)[0].as_py().hex()])), NESTED),
    "at a time": (of_others(geometry=nested(7), id=["a"], time=["2026-01-01T00:00:00Z"]), NESTED),
    "lines that are points": (of_others("linestring", geometry=pa.array([XYM])), "must be 1 lists of structs of x and"),
    "points that are lines": (of_others("point", geometry=pa.array([[XYM]])), "must be 0 lists of structs of x and y"),
    "columns": (of_others(geometry=pa.array([SQUARE]), **bits(2_001)), "2,002 columns; at most 2,000 are read"),
    "members": (
        of_others(geometry=pa.array([SQUARE]), x=pa.StructArray.from_arrays([*bits(2_001).values()], [*bits(2_001)])),
        "2,002 columns; at most 2,000 are read",
    ),
    "lists in JSON": (of_others(geometry=pa.array([LINE]), times=["[" * DEEP]), "times: must be a list of dates"),
    "digits in JSON": (of_others(geometry=pa.array([LINE]), times=[f"[{'1' * DEEP}]"]), "times: must be a list of da"),
    "lists in properties": (of_properties('{"x":' + "[" * DEEP), "properties: must be a JSON object"),
    "digits in properties": (of_properties(f'{{"x":{"1" * DEEP}}}'), "properties: must be a JSON object"),
    "a long value": (of_others(geometry=pa.array([LINE]), times=["x" * 5_000_000]), "per waypoint; got 'xxx"),
    "many letters": (of_others(geometry=pa.array([SQUARE]), crs="COMPOUNDCRS[" * 10_000), "has 120,000 characters"),
}


@pytest.mark.parametrize("name", list(TABLES))
def test_hostile_columns_are_refused_at_once(tmp_path: Path, name: str) -> None:
    table, rule = TABLES[name]
    assert rule in refusal(tmp_path / "plan.parquet", table)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_hostile_conflicts_are_refused(tmp_path: Path, name: str) -> None:
    """They are decoded by another way than objects."""
    columns = {field.name: pa.nulls(1, field.type) for field in FOUND.schema}
    columns[name] = nested(7)
    for field in (field for field in FOUND.schema if not field.nullable):
        value = [] if pa.types.is_list(field.type) else "x" if pa.types.is_string(field.type) else 1
        columns[field.name] = pa.array([value], field.type)
    pq.write_table(pa.table(columns), tmp_path / "part.parquet")
    with pytest.raises(InvalidInput, match=f"column {name}: holds what is no geometry in WKB: row 0 nests"):
        list(read_conflicts(tmp_path, 1))


def test_nulls_count_as_what_they_take(tmp_path: Path) -> None:
    """A billion rows of the null type are a small file, and no bytes of Arrow."""
    path = tmp_path / "fixes.parquet"
    pq.write_table(pa.table({name: pa.nulls(100_000) for name in ("id", "time", "lon", "lat")}), path)
    with pytest.raises(InvalidInput, match="holds more than 3 MB"):
        formats.read(path, max_file_mb=3.0)
    assert formats.read(path, max_file_mb=4.0).skipped


@pytest.mark.parametrize("skip_invalid", [False, True])
@draws("most", 1_000, contents.MAX_MISTAKES)
def test_mistakes_without_end_are_not_all_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, skip_invalid: bool
) -> None:
    """A smaller limit ends the same loop: reading 100,000 mistakes takes seconds."""
    monkeypatch.setattr(contents, "MAX_MISTAKES", most)
    table = of_others(geometry=pa.nulls(most + most // 10, pa.binary()))
    message = refusal(tmp_path / "plan.parquet", table, skip_invalid=skip_invalid)
    assert f"has more than {most:,} mistakes, and is not read any further" in message


def test_a_reference_system_opens_no_file(tmp_path: Path) -> None:
    """PROJ would wait for ever for the content of a pipe."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    escaped = json.dumps({"type": "x", "file": str(pipe)}).replace("/", "\\u002f")
    grid = f"+proj=longlat +ellps=bessel +nadgrids=@{pipe}"
    for crs in (grid, f"+init={pipe}:x", f"+init=../{pipe.name}:x", escaped):
        message = refusal(tmp_path / "plan.parquet", of_others(geometry=pa.array([SQUARE]), crs=crs))
        assert "refers to a file or an address, which is not opened" in message
