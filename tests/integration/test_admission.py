"""Plans are admitted only if they meet nobody, whatever was detected, and however many sessions ask at once."""

from collections.abc import Iterator
from dataclasses import replace

import psycopg
import pytest

from conflictdb import Area, Database, InvalidInput, LockTimeout, Scene, StoredScene, Track, connect
from conflictdb.db import store

HOUR_US = 3_600_000_000
T0_US = 1_900_000_000_000_000


def square(key: str, lon: float, hours: tuple[float, float] = (0.0, 1.0), **fields: object) -> Area:
    ring = [(lon, 0.0), (lon + 0.01, 0.0), (lon + 0.01, 0.01), (lon, 0.01)]
    start, end = (T0_US + round(h * HOUR_US) for h in hours)
    return Area(key, ring, start_us=start, end_us=end, **fields)  # type: ignore[arg-type]


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with connect(dsn) as db:
        store.set_scene(db.connection, Scene("city", tolerance_m=0.005))
        yield db


@pytest.fixture
def city(db: Database) -> StoredScene:
    return db.scene("city")


def keys(scene: StoredScene) -> list[str]:
    return [one.key for one in scene.objects()]


def test_what_meets_nobody_is_put(city: StoredScene) -> None:
    admission = city.admit(square("a", 0.0))
    assert admission
    assert admission.conflicts == admission.new == []
    # Not detected, and nevertheless seen.
    refused = city.admit([square("c", 0.5), square("b", 0.005)])
    assert not refused
    assert [(one.a_key, one.b_key, one.verdict) for one in refused.conflicts] == [("a", "b", "conflict")]
    assert keys(city) == ["a"]
    city.detect()
    assert not city.admit(square("b", 0.005))
    assert city.admit(square("b", 0.005, (1.0, 2.0)))
    assert keys(city) == ["a", "b"]
