"""Fixtures of integration tests: a scene for admissions, and a page."""

from collections.abc import Iterator

import pytest
from city import CITY, worker_connected
from map_page import Client, served_page

from conflictdb import Database, StoredScene, connect, store


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    """Return a database with the empty scene `city`."""
    with connect(dsn) as db:
        store.set_scene(db.connection, CITY)
        yield db


@pytest.fixture
def city(dsn: str, db: Database) -> Iterator[StoredScene]:
    """Return that scene; a worker is connected."""
    with worker_connected(dsn):
        yield db.scene("city")


@pytest.fixture
def strait(dsn: str) -> Iterator[Client]:
    """Return a client of a page of the demo, detected."""
    with connect(dsn) as db:
        db.load_demo()
        db.scene("strait").detect()
    with served_page(dsn, "strait") as address:
        yield Client(address)
