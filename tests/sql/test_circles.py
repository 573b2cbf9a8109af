"""Circles made by SQL contain the circle, as those of Python do, and are at most a thousandth larger."""

from collections.abc import Callable
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely

from conflictdb import InvalidInput, Scene, circle, connect
from conflictdb.earth.registry import Setup
from conflictdb.formats.discs import places_at
from conflictdb.model.settings import EarthModel

Conn = psycopg.Connection[Any]


def to_plane(scene: Scene) -> Callable[[Any], Any]:
    plane = Setup.of(scene).plane
    return lambda xy: np.stack(plane.to_plane(*xy.T), axis=1)


def made(conn: Conn, name: str, lon: float, lat: float, radius_m: float) -> shapely.MultiPolygon:
    row = conn.execute("SELECT ST_AsBinary(conflictdb.circle(%s, %s, %s, %s))", [name, lon, lat, radius_m]).fetchone()
    assert row is not None
    return shapely.from_wkb(row[0])  # type: ignore[no-any-return]


@pytest.mark.parametrize("motion", ["rhumb", "great_circle"])
@pytest.mark.parametrize("earth", ["wgs84", "sphere"])
def test_circles_contain_all_places_within_their_radius(conn: Conn, motion: str, earth: str) -> None:
    if (motion, earth) == ("great_circle", "wgs84"):
        pytest.skip("great circles are on the sphere")
    for lon, lat, radius_m in (
        (8.0, 47.0, 120.0),
        (-179.9, -60.0, 20_000.0),
        (200.0, 0.0, 1.0),
        (10.0, 78.0, 50_000.0),
    ):
        home = (lon + 180.0) % 360.0 - 180.0
        scene = Scene("s", motion, earth, centre=(home, lat) if motion == "great_circle" else None)  # type: ignore[arg-type]
        conn.execute("DELETE FROM conflictdb.scene")
        conn.execute("SELECT conflictdb.create_scene('s', %s, %s)", [motion, earth])
        project = to_plane(scene)
        azimuth = np.linspace(0.0, 2.0 * np.pi, 3000)
        rims = [
            np.stack(places_at(lon, lat, m, azimuth, EarthModel(earth)), axis=1) for m in (radius_m, 1.0011 * radius_m)
        ]
        inner, outer = (shapely.polygons(project(rim)) for rim in rims)
        for footprint in (made(conn, "s", lon, lat, radius_m), circle((lon, lat), radius_m, scene)):
            flat = shapely.transform(footprint, project)
            assert flat.contains(inner)
            assert outer.contains(flat)


def test_circles_too_large_are_refused(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    for lon, lat, radius_m in ((0, 0, 0), (0, 0, 60_000), (0, 81, 10), (0, 0, float("nan")), (None, 0, 1), (400, 0, 1)):
        with pytest.raises(psycopg.Error, match="circle: ") as refused, conn.transaction():
            conn.execute("SELECT conflictdb.circle('s', %s, %s, %s)", [lon, lat, radius_m])
        assert refused.value.sqlstate in ("ZC001", "ZC005")
    for centre, radius in (((0.0, 100.0), 1.0), ((0.0,), 1.0), ("ab", 1.0), ((0.0, 0.0), None), ((0.0, 0.0), -1.0)):
        with pytest.raises(InvalidInput, match="circle: "):
            circle(centre, radius, Scene("s"))  # type: ignore[arg-type]


def test_a_probe_knows_closed_intervals(conn: Conn) -> None:
    """An area that ends when, or where, the question begins, and one that begins there as it ends."""
    for intervals, expected in (("half_open", []), ("closed", ["above", "after", "before", "below"])):
        name = intervals
        conn.execute("SELECT conflictdb.create_scene(%s, p_intervals => %s)", [name, intervals])
        square = "ST_GeomFromText('POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))', 4326)"
        for key, start, end, floor, ceiling in (
            ("before", 0, 1, 0, 10), ("after", 2, 3, 0, 10), ("below", 1, 2, 0, 4), ("above", 1, 2, 6, 10),
        ):  # fmt: skip
            conn.execute(
                f"SELECT conflictdb.put_area(%s, %s, {square}, tstzrange(to_timestamp(%s), to_timestamp(%s)), "
                "%s, %s)".encode(),
                [name, key, start, end, floor, ceiling],
            )
        conn.commit()
        connect(conn).scene(name).detect()
        rows = conn.execute(
            f"SELECT key FROM conflictdb.probe(%s, {square}, tstzrange(to_timestamp(1), to_timestamp(2)), 4, 6) "
            "ORDER BY 1".encode(),
            [name],
        )
        assert [key for (key,) in rows] == expected
        conn.commit()
