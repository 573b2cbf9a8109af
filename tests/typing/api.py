"""How programs use the package, as the type checker sees it: never run, checked by test_typing.py."""

from datetime import UTC, datetime
from typing import assert_type

import numpy as np
import psycopg
import shapely
import sqlalchemy
from numpy.typing import NDArray
from sqlalchemy.orm import Session

import conflictdb
from conflictdb import models


def by_database(connection: psycopg.Connection[tuple[object, ...]], engine: sqlalchemy.Engine, at: datetime) -> None:
    for target in ("postgresql:///mission", connection, engine, engine.connect(), Session(engine), None):
        with conflictdb.connect(target) as db:
            assert_type(db, conflictdb.Database)
    with conflictdb.connect() as db:
        scene = db.load("exercise-7.geojson", replace=True)
        assert_type(scene, conflictdb.StoredScene)
        run = scene.detect(method="nlp", tolerance_m=1.0, separation_m=0.0, full=True, jobs=2)
        assert_type(run, conflictdb.Run)
        assert_type(run.conflicts, int)
        for conflict in scene.conflicts(at, with_region=True):
            assert_type(conflict, conflictdb.Conflict)
            assert_type(conflict.a_key, str)
            assert_type(conflict.first_contact, datetime | None)
            assert_type(conflict.verdict, conflictdb.Verdict)
            assert_type(conflict.approach, conflictdb.Approach | None)
            assert_type(conflict.periods, tuple[tuple[datetime | None, datetime | None], ...])
        found = scene.conflicts()
        assert_type(found, conflictdb.Listing[conflictdb.Conflict])
        assert_type(found.is_current, bool)
        conflictdb.write(found, "found.geojson")
        conflictdb.write(scene.approaches(), "near.csv")
        assert_type(found.state, conflictdb.SceneState)
        scene.wait_until_current(timeout_s=5.0)
        assert_type(db.load_files(["a.csv", "b.gpkg"], "s"), list[conflictdb.Loaded])
        advice = scene.advise(sample=200, seed=1)
        assert_type(advice, conflictdb.Advice)
        assert_type(advice.recommendation, str)
        assert_type(advice.estimates[0].seconds, float)
        scene.export("out.geojson")


def by_models(session: Session) -> None:
    for conflict in session.scalars(sqlalchemy.select(models.ConflictRow)):
        assert_type(conflict.a_key, str)
        assert_type(conflict.first_contact, datetime | None)


def in_memory() -> None:
    area = conflictdb.Area("A", shapely.MultiPolygon([shapely.box(4.0, 57.0, 5.0, 58.0)]), floor_m=-10.0)
    track = conflictdb.Track(
        "T",
        np.array([[3.0, 57.5], [6.0, 57.5]]),
        np.array([0, 3_600_000_000]),
        conflictdb.rectangle_outline_m(fore_m=100.0, aft_m=50.0, port_m=10.0, starboard_m=10.0),
    )
    start = datetime(2026, 6, 1, 8, tzinfo=UTC)
    area = conflictdb.Area("B", shapely.box(4.0, 57.0, 5.0, 58.0), start_us=start, end_us=np.datetime64("2026-06-02"))
    assert_type(area.start_us, int | None)
    track = conflictdb.Track("U", [(3.0, 57.5), (6.0, 57.5)], [start, start.replace(hour=9)], [[0, 0]])
    track = conflictdb.Track("V", shapely.LineString(), np.array([], "datetime64[us]"), shapely.box(0, 0, 1, 1))
    assert_type(track.times_us, NDArray[np.int64])
    assert_type(conflictdb.__version__, str)
    scene = conflictdb.Scene("s", earth=conflictdb.EarthModel.SPHERE, method=conflictdb.Method.NLP)
    assert_type(conflictdb.solve([track], [area], scene), conflictdb.Results[conflictdb.Conflict])


def from_files() -> list[conflictdb.Skipped]:
    scene, areas, tracks, skipped = conflictdb.read("ais.csv.gz", max_speed_kn=60.0)
    assert_type(scene, conflictdb.Scene | None)
    assert_type(areas, list[conflictdb.Area])
    assert_type(tracks, list[conflictdb.Track])
    return skipped


def errors(refused: conflictdb.InvalidInput) -> tuple[str, str, str, str]:
    caught: type[ValueError] = conflictdb.InvalidInput
    every: list[type[conflictdb.ConflictDBError]] = [
        conflictdb.SchemaMissing,
        conflictdb.SchemaOutdated,
        conflictdb.SchemaTooNew,
        conflictdb.ServerError,
        conflictdb.StoreError,
    ]
    assert_type(every[0], type[conflictdb.ConflictDBError])
    assert_type(caught, type[ValueError])
    return refused.source, refused.key, refused.field, refused.rule
