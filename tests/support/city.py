"""Flights and areas of a city, to be admitted, and the function admit of SQL."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import psycopg
import shapely

from conflictdb import Area, Scene, StoredScene, Track, rectangle_outline_m
from conflictdb.formats.scene_file import feature_of
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.store import WORKER_NAME, WorkerStamp

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
    """A plan with the parameters of put_area and put_track, as the function admit took it before features."""
    common = {"key": plan.key, "floor_m": plan.floor_m, "ceiling_m": plan.ceiling_m, "owner": plan.owner}
    if isinstance(plan, Area):
        span = f"[{instant(plan.start_us) or ''},{instant(plan.end_us) or ''})"
        return common | {"footprint": shapely.to_wkb(plan.footprint, hex=True), "active_span": span}
    return common | {
        "path": json.loads(shapely.to_geojson(shapely.LineString(plan.positions_deg))),
        "times": [instant(us) for us in plan.times_us.tolist()],
        "outline": shapely.Polygon(plan.outline_m).wkt,
        "departures": None if plan.departures_us is None else [instant(us) for us in plan.departures_us],
    }


def as_feature(plan: Area | Track) -> dict[str, Any]:
    """A plan as requests carry it."""
    return feature_of(plan) | {"version": 1}


@contextmanager
def worker_connected(dsn: str) -> Iterator[None]:
    """Be counted as a worker, which answers nothing."""
    with psycopg.connect(dsn, application_name=WORKER_NAME) as conn:
        WorkerStamp().begin(conn)
        yield


def asked(
    conn: psycopg.Connection[Any],
    *plans: Area | Track,
    scene: str = "city",
    form: Callable[[Area | Track], dict[str, Any]] = as_feature,
    **options: Any,
) -> tuple[Any, ...]:
    """The row of the function admit, in the open transaction."""
    given = {"p_scene": scene, "p_plans": json.dumps([form(one) for one in plans]), **options}
    names = ", ".join(f"{name} => %({name})s" for name in given)
    row = conn.execute(f"SELECT * FROM conflictdb.admit({names})", given).fetchone()  # type: ignore[arg-type]
    assert row is not None
    return row


def pairs(conflicts: list[dict[str, Any]]) -> list[tuple[str, str]]:
    return sorted((one["a_key"], one["b_key"]) for one in conflicts)


def beyond_limits() -> list[tuple[Area | Track, str]]:
    """Plans that are refused by limits of 30 days and 10,000 vertices or waypoints, and the rules."""
    now_us = int(datetime.now(UTC).timestamp()) * 1_000_000
    soon = {"start_us": now_us, "end_us": now_us + HOUR_US}
    angles = np.linspace(0.0, 2.0 * np.pi, 10_000, endpoint=False)
    round_ = np.stack([0.01 * np.cos(angles), 0.01 * np.sin(angles)], axis=1)
    places = np.stack([np.linspace(0.0, 0.1, 10_001), np.zeros(10_001)], axis=1)
    times = now_us + 1_000_000 * np.arange(10_001)
    late = [now_us + 29 * 24 * HOUR_US, now_us + 31 * 24 * HOUR_US]
    haven = rectangle_outline_m(50, 50, 50, 50)
    return [
        (Area("p", square("p", 0.0).footprint), "at most 30 days from now; got no end"),
        (Area("p", square("p", 0.0).footprint, None, now_us), "at most 30 days from now; got no end"),
        (Area("p", square("p", 0.0).footprint, None, *late), "at most 30 days from now; got 20"),
        (Track("p", [(0.0, 0.0), (0.1, 0.0)], late, haven), "at most 30 days from now; got 20"),
        (
            Track("p", [(0.0, 0.0), (0.1, 0.0)], [now_us, now_us + HOUR_US], haven, departures_us=[now_us, late[1]]),
            "at most 30 days from now; got 20",
        ),
        (Area("p", round_, **soon), "at most 10000 vertices; got 10001"),  # type: ignore[arg-type]
        (Track("p", places, times, haven), "at most 10000 waypoints; got 10001"),
    ]


def within_limits(key: str) -> Area:
    """A square that ends in 29 days."""
    now_us = int(datetime.now(UTC).timestamp()) * 1_000_000
    return replace(square(key, 0.0), start_us=now_us, end_us=now_us + 29 * 24 * HOUR_US)
