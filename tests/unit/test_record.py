"""Every output of conflicts and closest approaches, of rows made by hand, equals tests/unit/record_outputs.txt."""

import os
from collections.abc import Iterator
from dataclasses import MISSING, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from conflictdb import Approach, Conflict, Kind, Method, Results, Verdict, write
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.arrow.found import FOUND, of_rows
from conflictdb.cli.load_report import conflict_table
from conflictdb.model import record
from conflictdb.model.results import Certainty
from conflictdb.plot.report import _verdict

OUTPUTS = Path(__file__).with_name("record_outputs.txt")
START, END = datetime(2026, 6, 1, 8, 0, 0, 250, tzinfo=UTC), datetime(2026, 6, 1, 9, 30, tzinfo=UTC)
REGION = '{"type": "Polygon", "coordinates": [[[1, 2], [3, 2], [3, 4], [1, 2]]]}'
ROWS = [
    Conflict(
        scene="=scene",
        a_key="A",
        a_kind=Kind.AREA,
        b_key='-T, "1"\n',
        b_kind=Kind.TRACK,
        verdict=Verdict.CONFLICT,
        periods=((START, END), (datetime(2026, 6, 2, tzinfo=UTC), None)),
        time_error_s=1.5e-6,
        method=Method.EXACT,
        first_contact_deg=(1.25, 2.5),
        closest_at=START,
        closest_m=0.0,
        closest_error_m=1e-3,
        closest_a_deg=(1.25, 2.5),
        closest_b_deg=(1.25, 2.5),
        region=REGION,
        is_current=True,
        scene_is_current=False,
        run_id=7,
        found_at=END,
        conflict_id=12,
        changed_at=START,
        acknowledged_by="=harbour",
        acknowledged_at=START,
        acknowledged_for="seen",
        acknowledged_until=END,
        a_name="=Pier",
        b_name="T & <b>",
        a_id=3,
        a_version=4,
        b_id=5,
        b_version=6,
    ),
    Conflict(
        scene="s",
        a_key="T1",
        a_kind=Kind.TRACK,
        b_key="T2",
        b_kind=Kind.TRACK,
        verdict=Verdict.NEAR,
        periods=(),
        time_error_s=0.0,
        method=Method.EXACT,
        closest_at=END,
        closest_m=120.5,
        closest_error_m=0.25,
        closest_a_deg=(179.5, 10.0),
        closest_b_deg=(-179.5, 10.0),
        is_current=False,
        run_id=8,
        found_at=START,
    ),
    Conflict(
        scene="s",
        a_key="A",
        a_kind=Kind.AREA,
        b_key="B",
        b_kind=Kind.AREA,
        verdict=Verdict.CONFLICT,
        periods=((None, None),),
        time_error_s=0.0,
        method=Method.EXACT,
        closest_m=0.0,
        closest_error_m=0.0,
        closest_a_deg=(1.0, 2.0),
        closest_b_deg=(1.5, 2.0),
    ),
    Conflict(
        scene="s",
        a_key="A",
        a_kind=Kind.AREA,
        b_key="T",
        b_kind=Kind.TRACK,
        verdict=Verdict.UNRESOLVED,
        periods=((START, END),),
        time_error_s=12.0,
        method=Method.SCREEN,
    ),
]
APPROACHES = [one.approach for one in ROWS if one.approach]


def outputs(folder: Path) -> Iterator[str]:
    """Yield every output, with a title each."""
    tables: dict[str, Results[Any]] = {
        "conflicts": Results(ROWS, Conflict),
        "approaches": Results(APPROACHES, Approach),
    }
    for name, rows in tables.items():
        for form in ("csv", "json", "geojson"):
            write(rows, folder / f"{name}.{form}")
            yield f"=== {name}.{form}\n{(folder / f'{name}.{form}').read_bytes().decode()}"
        yield f"=== {name}, HTML\n{rows._repr_html_()}\n"
        for title, frame in (("frame", rows.to_dataframe()), ("frame with geometry", rows.to_geodataframe())):
            yield f"=== {name}, {title}\n"
            for column in frame.columns:
                yield f"{column} {frame[column].dtype}: {frame[column].tolist()}\n"
    yield f"=== Arrow\n{FOUND.schema.to_string(show_field_metadata=True)}\n"
    yield "".join(f"{row}\n" for row in of_rows(ROWS).to_pylist())
    write(ROWS, folder / "conflicts.parquet")
    stored = pq.read_table(folder / "conflicts.parquet")
    yield f"=== GeoParquet\n{stored.schema.to_string()}\n{stored.to_pylist() == of_rows(ROWS).to_pylist()}\n"
    yield "".join(
        f"{key!r}: {text!r}\n" for key, text in pq.read_metadata(folder / "conflicts.parquet").metadata.items()
    )


def test_every_column_is_an_attribute() -> None:
    """For both kinds of rows, and every field of theirs belongs to a column."""
    for kind, columns in ((Conflict, record.COLUMNS), (Approach, record.APPROACH_COLUMNS)):
        names = {one.field for one in (*columns, *record.STATES)}
        assert all(hasattr(kind, name) for name in names)
        assert {one.name for one in fields(kind)} <= names
        assert {one.field for one in columns if one.required} <= {
            one.name for one in fields(kind) if one.default is MISSING
        }


def test_every_array_is_a_field_of_conflicts() -> None:
    arrays = {one.name for one in fields(Conflicts)} - {"a_kind", "b_kind", "verdict", "where"}
    assert {one.array for one in (*record.MEASURED, *record.STATES)} == arrays - {"period_us", "period_offset"}


def test_outputs_are_what_they_were(tmp_path: Path) -> None:
    """If a difference is intended: CONFLICTDB_UPDATE_SNAPSHOT=1 ./run test tests/unit/test_record.py."""
    text = "".join(outputs(tmp_path))
    if os.environ.get("CONFLICTDB_UPDATE_SNAPSHOT") == "1":
        OUTPUTS.write_text(text)
    assert text == OUTPUTS.read_text()


def test_remarks_are_shown_where_a_conflict_has_them() -> None:
    late = replace(ROWS[0], lacking_s=12.5, certainty=Certainty.MUST)
    header, row, other = conflict_table([late, ROWS[3]]).splitlines()
    assert "PERIODS  LACKING S  CERTAINTY" in header
    assert "       12.5  must" in row
    assert "must" not in other
    assert not {"LACKING S", "CERTAINTY"} & {*conflict_table(ROWS).splitlines()[0].split("  ")}
    assert _verdict(late) == "conflict (acknowledged, 12.5 s lacking, must happen)"
    assert _verdict(ROWS[3]) == "unresolved"
