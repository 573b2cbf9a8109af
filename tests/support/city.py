"""Flights and areas of a city, to be admitted, and the function admit of SQL."""

import json
from typing import Any

import psycopg
import shapely

from conflictdb import Area, Scene, StoredScene, Track, rectangle_outline_m
from conflictdb.model.inputs import EPOCH, MICROSECOND

HOUR_US = 3_600_000_000
T0_US = 1_900_000_000_000_000
CITY = Scene("city", tolerance_m=0.005)


def square(key: str, lon: float, hours: tuple[float, float] = (0.0, 1.0), **fields: object) -> Area:
    ring = [(lon, 0.0), (lon + 0.01, 0.0), (lon + 0.01, 0.01), (lon, 0.01)]
    start, end = (T0_US + round(h * HOUR_US) for h in hours)
    return Area(key, ring, start_us=start, end_us=end, **fields)  # type: ignore[arg-type]


def flight(key: str, lon: float, hour: float = 0.0, **fields: object) -> Track:
    """A drone that crosses the squares about that longitude, from south to north within six minutes."""
    times = [T0_US + round(h * HOUR_US) for h in (hour, hour + 0.1)]
    return Track(key, [(lon, -0.01), (lon, 0.02)], times, rectangle_outline_m(50, 50, 50, 50), **fields)  # type: ignore[arg-type]


def keys(scene: StoredScene) -> list[str]:
    return [one.key for one in scene.objects()]


def instant(us: int | None) -> str | None:
    return None if us is None else (EPOCH + us * MICROSECOND).isoformat()


def as_plan(plan: Area | Track) -> dict[str, Any]:
    """A plan as the function admit takes it."""
    common = {"key": plan.key, "floor_m": plan.floor_m, "ceiling_m": plan.ceiling_m, "owner": plan.owner}
    if isinstance(plan, Area):
        span = f"[{instant(plan.start_us) or ''},{instant(plan.end_us) or ''})"
        return common | {"footprint": shapely.to_wkb(plan.footprint, hex=True), "active_span": span}
    return common | {
        "path": json.loads(shapely.to_geojson(shapely.LineString(plan.positions_deg))),
        "times": [instant(us) for us in plan.times_us.tolist()],
        "outline": shapely.Polygon(plan.outline_m).wkt,
    }


def asked(conn: psycopg.Connection[Any], *plans: Area | Track, scene: str = "city", **options: Any) -> tuple[Any, ...]:
    """The row of the function admit, in the open transaction."""
    given = {"p_scene": scene, "p_plans": json.dumps([as_plan(one) for one in plans]), **options}
    names = ", ".join(f"{name} => %({name})s" for name in given)
    row = conn.execute(f"SELECT * FROM conflictdb.admit({names})", given).fetchone()  # type: ignore[arg-type]
    assert row is not None
    return row


def pairs(conflicts: list[dict[str, Any]]) -> list[tuple[str, str]]:
    return sorted((one["a_key"], one["b_key"]) for one in conflicts)
