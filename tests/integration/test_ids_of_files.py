"""Ids that a file does not say have the file's name; objects of another file are never replaced without a word."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import geopandas
import pytest
import shapely

import conflictdb
from conflictdb.formats import FileHints

SPAN = ("2026-06-01T09:00:00Z", "2026-06-01T10:00:00Z")


def vector(path: Path, lat: float, **columns: Any) -> None:
    shape = shapely.box(9.0, lat, 9.1, lat + 0.1)
    frame = geopandas.GeoDataFrame({"colour": ["red"], **columns}, geometry=[shape], crs=4326)
    (frame.to_parquet if path.suffix == ".parquet" else frame.to_file)(path)


def geojson(path: Path, lat: float) -> None:
    shape = shapely.geometry.mapping(shapely.box(9.0, lat, 9.1, lat + 0.1))
    feature = {"type": "Feature", "geometry": shape, "properties": {}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature, feature]}))


def gpx(path: Path, lat: float) -> None:
    points = "".join(f'<trkpt lat="{lat}" lon="{9 + i}"><time>{at}</time></trkpt>' for i, at in enumerate(SPAN))
    route = f'<rte><rtept lat="{lat}" lon="9"/><rtept lat="{lat}" lon="9.1"/></rte>'
    path.write_text(f"<gpx>{route}<trk><trkseg>{points}</trkseg></trk></gpx>")


def kml(path: Path, lat: float) -> None:
    ring = " ".join(f"{x},{y}" for x, y in shapely.box(9.0, lat, 9.1, lat + 0.1).exterior.coords)
    shape = f"<Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs>"
    path.write_text(
        f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>{shape}</Polygon></Placemark></Document></kml>'
    )


HINTS = FileHints(departure=datetime(2026, 6, 1, 9, tzinfo=UTC), speed_kn=9.0)


@pytest.mark.parametrize(
    ("ending", "write", "count"),
    [
        (".shp", vector, 1),
        (".gpkg", vector, 1),
        (".parquet", vector, 1),
        (".geojson", geojson, 2),
        (".gpx", gpx, 2),
        (".kml", kml, 1),
    ],
)
def test_a_second_file_without_ids_adds_its_objects(
    ending: str, write: Any, count: int, dsn: str, tmp_path: Path
) -> None:
    """They replaced those of the first: "0 added, 1 updated"."""
    with conflictdb.connect(dsn) as db:
        for lat, name in ((57.0, "north"), (47.0, "south")):
            path = (tmp_path / name).with_suffix(ending)
            write(path, lat)
            (loaded,) = db.load_files([path], "S", hints=HINTS if ending == ".gpx" else None)
            assert (loaded.counts.added, loaded.counts.updated) == (count, 0)
            assert not any("replace" in one.text for one in loaded.remarks)
        write(path, 37.0)  # as another file of that name
        (loaded,) = db.load_files([path], "S", hints=HINTS if ending == ".gpx" else None)
        assert loaded.counts.updated == count
        (said,) = [one.text for one in loaded.remarks if "replace" in one.text]
        objects = "1 object replaces that" if count == 1 else f"{count} objects replace those"
        assert said.startswith(f"{objects} of the same id in the scene; ids such as 'south.")


def test_ids_that_are_numbers_of_rows_say_that_they_replace(dsn: str, tmp_path: Path) -> None:
    """A column `id` of 1, 2, 3, as QGIS makes it, is in each layer; other ids are those of the objects."""
    with conflictdb.connect(dsn) as db:
        for key, lat, is_said in (("1", 57.0, False), ("1", 47.0, True), ("R44", 57.0, False), ("R44", 47.0, False)):
            vector(tmp_path / f"{lat}.gpkg", lat, id=[key])
            (loaded,) = db.load_files([tmp_path / f"{lat}.gpkg"], "S")
            assert any("replace" in one.text for one in loaded.remarks) == is_said
            (tmp_path / f"{lat}.gpkg").unlink()
