"""`write`: conflicts and closest approaches as files, by the name of the file."""

import csv
import gzip
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import scenes
import shapely

import conflictdb
from conflictdb.errors import InvalidInput
from conflictdb.formats.conflict_text import APPROACH_COLUMNS, COLUMNS
from conflictdb.model.plans import Scene

AREA = scenes.area("A", shapely.box(0.4, -0.1, 0.6, 0.1))
ALWAYS = scenes.area("B", shapely.box(0.5, -0.1, 0.7, 0.1))
TRACK = scenes.track("T", [(0.0, 0.0), (1.0, 0.0)], [0, 3600], 50.0, 50.0, 10.0, 10.0)


@pytest.fixture(scope="module")
def found() -> list[conflictdb.Conflict]:
    return conflictdb.solve([TRACK], [AREA, ALWAYS], Scene("s"))


def test_the_name_says_the_format(found: list[conflictdb.Conflict], tmp_path: Path) -> None:
    """Columns that only a database fills are null, and empty cells."""
    for name in ("found.geojson", "found.json", "found.csv", "found.json.gz"):
        conflictdb.write(found, tmp_path / name)
    rows = json.loads((tmp_path / "found.json").read_text())
    assert [(row["a_key"], row["b_key"], row["verdict"], row["run_id"]) for row in rows] == [
        ("A", "B", "conflict", None),
        ("A", "T", "conflict", None),
        ("B", "T", "conflict", None),
    ]
    assert tuple(rows[0]) == COLUMNS
    assert rows[0]["periods"] == [[None, None]]
    assert gzip.decompress((tmp_path / "found.json.gz").read_bytes()) == (tmp_path / "found.json").read_bytes()
    features = json.loads((tmp_path / "found.geojson").read_text())
    assert "scenes" not in features
    assert [one["geometry"]["type"] for one in features["features"]] == ["Point"] * 3
    table = list(csv.DictReader((tmp_path / "found.csv").read_text().splitlines()))
    assert [(row["b_kind"], row["is_current"], row["found_at"]) for row in table] == [
        ("area", "", ""),
        ("track", "", ""),
        ("track", "", ""),
    ]
    assert table[0]["periods"] == "../.."


def test_names_may_be_in_capitals(found: list[conflictdb.Conflict], tmp_path: Path) -> None:
    """As for `read`: a file called .GZ is compressed."""
    for name in ("found.json", "FOUND.JSON", "FOUND.JSON.GZ"):
        conflictdb.write(found, tmp_path / name)
    plain = (tmp_path / "found.json").read_bytes()
    assert (tmp_path / "FOUND.JSON").read_bytes() == plain
    assert gzip.decompress((tmp_path / "FOUND.JSON.GZ").read_bytes()) == plain


def test_closest_approaches_have_columns_of_their_own(found: list[conflictdb.Conflict], tmp_path: Path) -> None:
    near = [one.approach for one in found if one.approach]
    assert [one.closest_m for one in near] == [0.0] * 3
    conflictdb.write(near, tmp_path / "near.csv")
    assert (tmp_path / "near.csv").read_text().splitlines()[0] == ",".join(APPROACH_COLUMNS)
    conflictdb.write([], tmp_path / "none.csv")
    assert (tmp_path / "none.csv").read_text() == ",".join(COLUMNS) + "\n"


def test_an_empty_answer_has_the_columns_of_what_was_asked_for(tmp_path: Path) -> None:
    state = conflictdb.SceneState("s", 0, 0, None, None, True, None)
    for kind, columns in ((conflictdb.Conflict, COLUMNS), (conflictdb.Approach, APPROACH_COLUMNS)):
        for empty in (conflictdb.Listing(state, [], kind), conflictdb.Stream(state, (_ for _ in ()), kind)):
            conflictdb.write(empty, tmp_path / "none.csv")
            assert (tmp_path / "none.csv").read_text() == ",".join(columns) + "\n"


def test_rows_are_written_as_they_come(found: list[conflictdb.Conflict], tmp_path: Path) -> None:
    """Batches of two thousand rows or so suffice for any length of file; an interrupted write leaves the old file."""
    conflictdb.write(found, tmp_path / "found.json")
    before = (tmp_path / "found.json").read_bytes()
    conflictdb.write((one for one in found), tmp_path / "found.json")
    assert (tmp_path / "found.json").read_bytes() == before

    def breaks_off() -> Iterator[conflictdb.Conflict]:
        yield found[0]
        assert [path.suffix for path in tmp_path.iterdir() if path.name != "found.json"] == [".part"]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        conflictdb.write(breaks_off(), tmp_path / "found.json")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [before]


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_no_number_in_json_is_refused(found: list[conflictdb.Conflict], value: float, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no number"):
        conflictdb.write([replace(found[0], time_error_s=value)], tmp_path / "found.json")
    assert not list(tmp_path.iterdir())


def test_only_what_is_near_is_a_row_without_periods(found: list[conflictdb.Conflict]) -> None:
    """A pair that conflicts has periods: its row is the conflict."""
    (near,) = conflictdb.solve([TRACK], [scenes.area("C", shapely.box(0.4, 0.1, 0.6, 0.2))], Scene("s", nearest_m=1e5))
    assert near.approach is not None
    assert near.approach.as_near() == near
    approach = found[1].approach
    assert approach is not None
    with pytest.raises(InvalidInput, match="'A' and 'T': verdict: must be near"):
        approach.as_near()


def test_a_screening_knows_no_approach() -> None:
    found = conflictdb.solve([TRACK], [AREA], Scene("s", method="screen"))
    assert [one.approach for one in found] == [None]


@pytest.mark.parametrize("name", ["found", "found.txt", "found.gz", "found.shp"])
def test_other_names_are_refused(found: list[conflictdb.Conflict], name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"must end in \.geojson, \.json, \.csv"):
        conflictdb.write(found, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_mixture_is_refused(found: list[conflictdb.Conflict], tmp_path: Path) -> None:
    assert found[0].approach
    for mixture in ([*found, found[0].approach], ["A"], [AREA], [None], found[0], None):
        with pytest.raises(InvalidInput, match="must be conflicts, or closest approaches, and not both"):
            conflictdb.write(mixture, tmp_path / "found.json")  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_a_link_stays_one_and_what_it_leads_to_is_written(found: list[conflictdb.Conflict], tmp_path: Path) -> None:
    target, link = tmp_path / "there" / "real.json", tmp_path / "found.json"
    target.parent.mkdir()
    for text in (None, "older"):
        if text:
            target.write_text(text)
        link.unlink(missing_ok=True)
        link.symlink_to(target)
        conflictdb.write(found, link)
        assert link.is_symlink()
        assert len(json.loads(target.read_text())) == len(found)
    assert [path.name for path in target.parent.iterdir()] == ["real.json"]


def test_a_device_that_is_full_is_named(found: list[conflictdb.Conflict], tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("did not run: no /dev/full")
    (tmp_path / "found.json").symlink_to("/dev/full")
    with pytest.raises(OSError, match=r"found\.json"):
        conflictdb.write(found, tmp_path / "found.json")


def test_a_region_is_written_as_the_database_gives_it(found: list[conflictdb.Conflict], tmp_path: Path) -> None:
    """Also where a key looks like the member itself."""
    region = '{"type":"Point","coordinates":[1.5,2.25]}'
    odd = replace(found[0], region=region, a_key='"region": null', scene='"region": null, "')
    conflictdb.write([odd, found[1]], tmp_path / "found.json")
    first, second = json.loads((tmp_path / "found.json").read_text())
    assert (first["region"], first["a_key"], first["scene"]) == (json.loads(region), odd.a_key, odd.scene)
    assert second["region"] is None
