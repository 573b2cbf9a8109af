"""GeoParquet by the command line: a scene goes out and comes in as it was, and conflicts go out."""

import io
import json
import sys
from pathlib import Path

import geopandas
import pyarrow.parquet as pq
import pytest
import shapely
from commands import STRAIT, Run

from conflictdb import connect

CHANGED = {
    "type": "FeatureCollection",
    "scene": {
        "motion": "great_circle",
        "centre": [10, 50],
        "tolerance_m": 0.25,
        "separation_m": 12.5,
        "nearest_m": 900,
    },
    "features": [
        {
            "type": "Feature",
            "id": "π ' \n",
            "geometry": {"type": "LineString", "coordinates": [[9, 49], [10.1, 50.30000000000001]]},
            "properties": {
                "times": ["2200-01-01T00:00:00.000001Z", "2200-01-01T09:00:00Z"],
                "outlines_m": [[[0, 1], [1, -1], [-1, -1]], [[0, 2], [2, -2], [-2, -2]]],
                "floor_m": [None],
                "ceiling_m": [1e-9],
                "note": {"a": [1, 2.5, None, True, "x"]},
            },
        },
        {
            "type": "Feature",
            "id": "A",
            "geometry": {"type": "Polygon", "coordinates": [[[9, 49], [11, 49], [11, 51], [9, 49]]]},
            "properties": {"name": "", "start": "1900-01-01T00:00:00Z", "floor_m": -3},
        },
    ],
}


def test_a_scene_goes_out_and_comes_in_as_it_was(run: Run, tmp_path: Path) -> None:
    """Settings, objects to the last bit, and so its conflicts; whatever the file is called."""
    (tmp_path / "changed.json").write_text(json.dumps(CHANGED))
    assert run("load", STRAIT, tmp_path / "changed.json").code == 0
    for scene in ("strait", "changed"):
        path = tmp_path / f"{scene}.parquet"
        assert run("export", "--scene", scene, path).code == 0
        other = tmp_path / "other"
        assert run("export", "--scene", scene, "--format", "geoparquet", other).code == 0
        assert pq.read_table(other).equals(pq.read_table(path))
        assert "0 added, 0 updated, 0 removed" in run("load", path).out
        assert run("load", path, "--scene", "copy", "--replace").code == 0
        one, copy = (run("export", "--scene", name, "-").json for name in (scene, "copy"))
        assert {**one["scene"], "name": "copy"} == copy["scene"]
        assert one["features"] == copy["features"]
        found = [run("detect", "--scene", name, "--format", "json").json for name in (scene, "copy")]
        kept = ("a_key", "b_key", "verdict", "periods", "region", "closest_m", "closest_a_point")
        assert [[row[name] for name in kept] for row in found[0]] == [[row[name] for name in kept] for row in found[1]]
        assert found[0]
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [
        "changed.json", "changed.parquet", "other", "strait.parquet",
    ]  # fmt: skip


def test_numbers_and_versions_are_those_of_the_database(run: Run, dsn: str, tmp_path: Path) -> None:
    run("load", STRAIT)
    assert run("export", "--scene", "strait", tmp_path / "strait.parquet").code == 0
    stored = pq.read_table(tmp_path / "strait.parquet", columns=["id", "kind", "object_id", "version"]).to_pylist()
    with connect(dsn) as db:
        rows = db.connection.execute(
            "SELECT key, 'area', area_id, version FROM conflictdb.area"
            " UNION ALL SELECT key, 'track', track_id, version FROM conflictdb.track"
        ).fetchall()
    assert sorted(tuple(row.values()) for row in stored) == sorted(rows)


def test_conflicts_go_out_with_where_they_are(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run("detect", STRAIT)
    found = run("conflicts", "--scene", "strait", "--format", "json").json
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, write_through=True))
    assert run("conflicts", "--scene", "strait", "--format", "geoparquet").code == 0
    path = tmp_path / "conflicts.parquet"
    path.write_bytes(written.getvalue())
    frame = geopandas.read_parquet(path)
    assert frame.geometry.name == "region"
    assert frame.geometry.notna().all()
    assert list(frame["a_key"]) == [row["a_key"] for row in found]
    assert list(frame["run_id"]) == [row["run_id"] for row in found]
    assert [len(periods) for periods in frame["periods"]] == [len(row["periods"]) for row in found]
    assert list(frame["closest_m"]) == [row["closest_m"] for row in found]


def test_conflicts_without_regions_go_out_with_first_contacts_and_a_remark(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The setting goes with the scene file; GeoJSON has points, GeoParquet null geometries."""
    says = "scene 'strait' stores no regions (setting regions is off): the place of a conflict is its first contact"
    assert run("detect", STRAIT, "--regions", "off", "--format", "csv").code == 0
    path = tmp_path / "strait.json"
    assert run("export", "--scene", "strait", path).code == 0
    assert json.loads(path.read_text())["scene"]["regions"] == "off"
    done = run("conflicts", "--scene", "strait", "--format", "geojson")
    assert says in done.err
    points = [one["geometry"] for one in done.json["features"]]
    assert points == [one["properties"]["first_contact_point"] for one in done.json["features"]]
    assert says not in run("conflicts", "--scene", "strait", "--format", "geojson", "--no-region").err
    assert {row["region"] for row in run("conflicts", "--scene", "strait", "--format", "json").json} == {None}
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, write_through=True))
    assert run("conflicts", "--scene", "strait", "--format", "geoparquet").code == 0
    frame = geopandas.read_parquet(io.BytesIO(written.getvalue()))
    assert len(frame) == 7
    assert frame.geometry.isna().all()
    assert frame["first_contact_point"].notna().all()


def test_conflicts_go_out_as_exactly_as_the_database_has_them(run: Run, dsn: str, tmp_path: Path) -> None:
    """Regions to the last bit, in GeoParquet and in JSON, and numbers and versions of objects; of those near, too."""
    near = {**json.loads(Path(STRAIT).read_text())}
    near["scene"] = {**near.get("scene", {}), "name": "strait", "nearest_m": 50_000}
    (tmp_path / "near.json").write_text(json.dumps(near))
    assert run("load", tmp_path / "near.json").code == 0
    written = io.BytesIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdout", io.TextIOWrapper(written, write_through=True))
        assert run("detect", "--scene", "strait", "--format", "geoparquet").code == 0
        rows = pq.read_table(io.BytesIO(written.getvalue())).to_pylist()
        sys.stdout.detach()
    names = ("a_key", "b_key", "a_id", "a_version", "b_id", "b_version")
    query = f"SELECT {', '.join(names)}, ST_AsBinary(region), verdict FROM conflictdb.conflict"
    with connect(dsn) as db:
        found = db.connection.execute(query).fetchall()
    known = [dict(zip((*names, "region", "verdict"), row, strict=True)) for row in found]
    assert {row["verdict"] for row in known} >= {"conflict", "near"}
    assert sorted([row[name] for name in names] for row in rows) == sorted(
        [row[name] for name in names] for row in known
    )
    regions = {(row["a_key"], row["b_key"]): row["region"] for row in known if row["verdict"] != "near"}
    exact = [(row["a_key"], row["b_key"]) for row in rows if row["verdict"] != "near"]
    assert {row["region"] for row in rows if row["verdict"] == "near"} == {None}
    assert {(row["a_key"], row["b_key"]): row["region"] for row in rows if row["region"]} == regions
    listed = run("conflicts", "--scene", "strait", "--format", "json").json
    assert len(listed) == len(exact)
    for row in listed:
        shape = shapely.geometry.shape(row["region"])
        assert shapely.to_wkb(shape, byte_order=1) == regions[row["a_key"], row["b_key"]]


def test_what_cannot_be_written_is_told(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "scene.parquet"
    path.write_text("older")
    assert run("export", "--scene", "nowhere", path).code == 4
    assert path.read_text() == "older"
    assert run("export", "--scene", "nowhere", "--format", "geojson", path).code == 2
    done = run("load", path)
    assert done.code == 4
    assert "cannot be read as Parquet" in done.err
