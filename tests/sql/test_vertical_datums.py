"""The vertical datum of a scene in the database: put routines, files, and changes of the setting."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import psycopg
import pytest
import shapely

from conflictdb import Area, Scene, connect
from conflictdb.errors import InvalidInput

PUT = "SELECT conflictdb.put_area('s', %s, 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))', NULL, 0, 100, p_properties => %s)"
CREATE = "SELECT conflictdb.create_scene('s', p_vertical_datum => 'wgs84')"
FEED = """{"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": {"type": "Polygon", "coordinates":
[[[8, 47], [8.1, 47], [8.1, 47.1], [8, 47]]], "layer": {"upper": 120, "upperReference": "WGS84", "uom": "m"}},
"properties": {"identifier": "Z1", "country": "CHE", "type": "PROHIBITED", "variant": "COMMON", "zoneAuthority":
[{"purpose": "INFORMATION"}]}}]}"""


def test_put_routines_refuse_another_datum(rolled_back: psycopg.Connection[Any]) -> None:
    rolled_back.execute(CREATE)
    rolled_back.execute(PUT, ["A", '{"vertical_datum": "W84"}'])
    for sql, values in (
        (PUT, ["B", '{"vertical_datum": "MSL"}']),
        (PUT, ["A", '{"vertical_datum": "AGL"}']),
        ("UPDATE conflictdb.area SET properties = %s", ['{"vertical_datum": 5}']),
        ("UPDATE conflictdb.scene SET vertical_datum = %s", ["msl"]),
        ("UPDATE conflictdb.scene SET vertical_datum = %s", ["egm96"]),
    ):
        with pytest.raises(psycopg.Error) as caught, rolled_back.transaction():
            rolled_back.execute(sql.encode(), values)
        assert caught.value.sqlstate in ("ZC004", "ZC009")
        assert "vertical_datum" in str(caught.value)
    rolled_back.execute("UPDATE conflictdb.area SET floor_m = NULL, ceiling_m = NULL, properties = '{}'")
    rolled_back.execute("UPDATE conflictdb.scene SET vertical_datum = 'msl'")


def test_feeds_are_loaded_for_the_datum_of_their_scene(dsn: str, tmp_path: Path) -> None:
    feed = tmp_path / "zones.json"
    feed.write_text(FEED)
    with connect(dsn) as db:
        with pytest.raises(InvalidInput, match="a scene with vertical_datum wgs84 at its own"):
            db.load_files([feed], "s")
        db.connection.execute(CREATE)
        db.connection.commit()
        db.load_files([feed], "s")
        row = db.connection.execute("SELECT vertical_datum FROM conflictdb.scenes").fetchone()
        assert row == ("wgs84",)
        row = db.connection.execute("SELECT ceiling_m FROM conflictdb.area").fetchone()
        db.connection.commit()
        assert row == (120.0,)
        scene = db.scene("s")
        box = shapely.MultiPolygon([shapely.box(8.0, 47.0, 8.2, 47.2)])
        stated = Area("B", box, floor_m=0.0, properties={"vertical_datum": "MSL"})
        for use in (scene.put, scene.probe):
            with pytest.raises(InvalidInput, match="vertical_datum: must be 'wgs84', the scene's"):
                use([stated])
        with pytest.raises(InvalidInput, match="vertical_datum: must stay"):
            scene.put(replace(stated, properties={}), settings=Scene("s"))
        scene.export(tmp_path / "s.geojson")
        assert '"vertical_datum": "wgs84"' in (tmp_path / "s.geojson").read_text()
        db.load_files([tmp_path / "s.geojson"])
