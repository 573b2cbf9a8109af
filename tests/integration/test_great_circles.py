"""Great circles end to end: files in, conflicts out, the same file back; invalid changes are refused beforehand."""

import json
from pathlib import Path
from typing import Any

import geopandas
import pytest
import shapely

from conflictdb import InvalidInput, Motion, connect
from conflictdb.formats import read

HAVEN = {"fore_nmi": 5, "aft_nmi": 10, "port_nmi": 4, "starboard_nmi": 4}


def write(path: Path, scene: dict[str, Any], features: dict[str, tuple[Any, dict[str, Any]]]) -> Path:
    listed = [
        {"type": "Feature", "id": key, "geometry": shapely.geometry.mapping(geometry), "properties": properties}
        for key, (geometry, properties) in features.items()
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "scene": scene, "features": listed}))
    return path


def sail(*positions: tuple[float, float]) -> tuple[Any, dict[str, Any]]:
    return shapely.LineString(positions), {"start": "2026-03-01T00:00:00Z", "speed_kn": 480, **HAVEN}


POLAR = {
    "CAP": (shapely.Polygon([(-180, 88), (-60, 88), (60, 88), (180, 88), (180, 90), (-180, 90)]), {}),
    "SEAM": (shapely.box(175, 75, 185, 80), {}),
    "EAST": sail((-30, 70), (150, 70)),
    "WEST": sail((-140, 70), (40, 70)),
}


def test_a_polar_plan_from_file_to_file(dsn: str, tmp_path: Path) -> None:
    path = write(tmp_path / "polar.geojson", {"motion": "great_circle", "tolerance_m": 0.0}, POLAR)
    with connect(dsn) as db:
        assert db.load(path).name == "polar"
        db.scene("polar").detect()
        found = {(c.a_key, c.b_key): c for c in db.scene("polar").conflicts(with_region=True)}
        assert set(found) == {("CAP", "EAST"), ("CAP", "WEST"), ("EAST", "WEST")}
        for conflict in found.values():
            assert conflict.verdict == "conflict"
            assert conflict.time_error_s < 1e-5
            region = shapely.from_geojson(str(conflict.region))
            assert region.is_valid
            assert region.bounds[1] > 86.0
            assert region.bounds[3] == 90.0
            assert conflict.first_contact_deg is not None
            assert conflict.first_contact_deg[1] > 86.0
        out = tmp_path / "out.geojson"
        db.scene("polar").export(out)
        first = db.scene("polar").text()
        settings = read(out).scene
        assert settings is not None
        assert settings.motion is Motion.GREAT_CIRCLE
        assert settings.centre is not None
        assert settings.centre[1] > 80.0
        assert db.load(out, "again").name == "again"
        assert db.scene("again").text() == first.replace('"name": "polar"', '"name": "again"')
        assert db.load_files([path])[0].counts.unchanged == 4
        again = db.scene("polar").detect()
        assert (again.opened, again.changed, again.closed) == (0, 0, 0)
        screen = db.scene("polar").detect(method="screen")
        nlp = db.scene("polar").detect(method="nlp")
        assert screen.conflicts >= nlp.conflicts == 3


def test_centre_stays_until_a_file_gives_another(dsn: str, tmp_path: Path) -> None:
    scene = {"name": "s", "motion": "great_circle"}
    with connect(dsn) as db:
        db.load(write(tmp_path / "a.geojson", scene, {"T": sail((0, 10), (10, 10))}))
        before = db.scenes()[0].scene.centre
        assert before == pytest.approx((5.0, 10.0), abs=0.1)
        db.load(write(tmp_path / "b.geojson", scene, {"U": sail((20, 20), (30, 20))}))
        assert db.scenes()[0].scene.centre == before
        db.load(write(tmp_path / "c.geojson", {**scene, "centre": [15.5, -3]}, {"U": sail((20, 20), (30, 20))}))
        assert db.scenes()[0].scene.centre == (15.5, -3.0)
        assert db.scenes()[0].pending > 0


def test_what_is_too_far_is_named_before_anything_is_written(dsn: str, tmp_path: Path) -> None:
    scene = {"name": "s", "motion": "great_circle"}
    near, far = {"T": sail((0, 10), (10, 10))}, {"T": sail((0, 10), (1, 10)), "FAR": sail((80, 10), (90, 10))}
    with connect(dsn) as db:
        path = write(tmp_path / "far.geojson", {**scene, "centre": [0, 0]}, far)
        with pytest.raises(InvalidInput, match=r"far.geojson: track 'FAR': geometry: reaches beyond 60 degrees"):
            db.load(path)
        assert db.scenes() == []
        db.load(write(tmp_path / "near.geojson", scene, near))
        before = db.scene("s").text()
        for replace in (False, True):
            with pytest.raises(InvalidInput, match="give the scene a 'centre'"):
                db.load(write(tmp_path / "far.geojson", scene, far), replace=replace)
            assert db.scene("s").text() == before
        # Another motion, but the remaining objects do not fit its plane.
        db.load(write(tmp_path / "polar.geojson", {"name": "p", "motion": "great_circle"}, POLAR))
        with pytest.raises(InvalidInput, match="89"):
            db.load(write(tmp_path / "rhumb.geojson", {"name": "p", "motion": "rhumb"}, near))
        assert len(read_back(db, "p")) == 4
        db.load(write(tmp_path / "rhumb.geojson", {"name": "p", "motion": "rhumb"}, near), replace=True)
        assert db.scene("p").text().count('"Feature"') == 1


def read_back(db: Any, scene: str) -> list[Any]:
    return json.loads(db.scene(scene).text())["features"]


@pytest.mark.parametrize("name", ["zone.geojson", "zone.parquet"])
def test_long_sides_of_a_foreign_file_follow_great_circles(dsn: str, tmp_path: Path, name: str) -> None:
    """A ship 40 km north of the side along 60 N is outside, though the great circle between its ends is north of it."""
    scene = {"name": "s", "motion": "great_circle", "centre": [15, 55]}
    ring = [[0, 50], [30, 50], [30, 60], [0, 60], [0, 50]]
    frame = geopandas.GeoDataFrame({"id": ["Z"]}, geometry=[shapely.Polygon(ring)], crs=4326)
    (frame.to_parquet if name.endswith("parquet") else frame.to_file)(tmp_path / name)
    with connect(dsn) as db:
        db.load(write(tmp_path / "ship.geojson", scene, {"T": sail((14, 60.36), (16, 60.36))}))
        with pytest.warns(UserWarning, match="vertices are added along them, which exports have"):
            db.load(tmp_path / name, "s")
        db.scene("s").detect()
        assert list(db.scene("s").conflicts()) == []
        (zone,) = [one for one in read_back(db, "s") if one["id"] == "Z"]
        assert len(zone["geometry"]["coordinates"][0]) > 100
