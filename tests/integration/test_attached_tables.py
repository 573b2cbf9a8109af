"""Rows of attached tables become objects of a scene and follow the table, whatever happens to it."""

import json
import re
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import psycopg
import pytest
from patience import WAIT_S

from conflictdb import connect, store
from conflictdb.client.database import Database
from conflictdb.errors import InvalidInput

OPS = """
CREATE SCHEMA mission;
CREATE TABLE mission.ops (
    id integer PRIMARY KEY DEFERRABLE, shape geometry(Polygon, 25832), valid tstzrange, depth_ft numeric);
INSERT INTO mission.ops
SELECT i, ST_Transform(ST_MakeEnvelope(8 + i, 57, 8.5 + i, 57.5, 4326), 25832),
       '[2026-03-01 06:00Z, 2026-03-01 18:00Z)', 100 * i
FROM generate_series(1, 3) i;
"""
OPS_MAP = {"key": "id", "footprint": "shape", "span": "valid", "floor_m": "-depth_ft * 0.3048"}
FIXES = """
CREATE TABLE mission.fix (voyage text, at timestamptz, place geometry(Point, 3857), draught real, beam real);
INSERT INTO mission.fix
SELECT 'V' || v, timestamptz '2026-03-01 05:00Z' + i * interval '1 hour',
       ST_Transform(ST_Point(8 + i, 57 + v, 4326), 3857), 5, 20
FROM generate_series(1, 2) v, generate_series(0, 3) i;
"""
FIX_MAP = {
    "key": "voyage",
    "position": "place",
    "time": "at",
    "fore_m": "50",
    "aft_m": "50",
    "port_m": "beam/2",
    "starboard_m": "beam / 2",
}


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with psycopg.connect(dsn) as conn:
        conn.execute(OPS + FIXES)
        conn.execute("SELECT conflictdb.create_scene('s')")
    with connect(dsn) as db:
        yield db


def do(db: Database, *statements: str) -> None:
    """Run statements as a foreign program would: in a transaction of their own."""
    with psycopg.connect(db.connection.info.dsn, password=db.connection.info.password or None) as other:
        for statement in statements:
            other.execute(statement.encode())


def ask(db: Database, query: str) -> list[Any]:
    with db.connection.transaction():
        rows = db.connection.execute(query.encode()).fetchall()
    return [row[0] if len(row) == 1 else row for row in rows]


def keys(db: Database, kind: str = "area") -> list[str]:
    return ask(db, f"SELECT key FROM conflictdb.{kind} ORDER BY key")


def reasons(db: Database) -> list[tuple[str, str]]:
    return [(row.identity, row.reason) for row in db.scene("s").unmapped()]


def test_rows_become_areas_in_longitude_and_latitude(db: Database) -> None:
    db.scene("s").attach(
        "area", "mission.ops", {**OPS_MAP, "name": "'op ' || id", "properties": "to_jsonb(t) - 'shape'"}
    )
    assert keys(db) == []
    assert not db.connection.execute("SELECT is_current FROM conflictdb.scenes").fetchone()[0]  # type: ignore[index]
    db.connection.rollback()
    db.scene("s").follow()
    assert ask(
        db,
        """SELECT key, name, active_span::text, round(floor_m::numeric, 3)::text, properties ->> 'depth_ft',
                  ST_HausdorffDistance(footprint, ST_MakeEnvelope(9, 57, 9.5, 57.5, 4326)) < 1e-9
           FROM conflictdb.area WHERE key = '1'""",
    ) == [("1", "op 1", '["2026-03-01 06:00:00+00","2026-03-01 18:00:00+00")', "-30.480", "100", True)]
    assert keys(db) == ["1", "2", "3"]
    assert reasons(db) == []
    (one,) = db.scene("s").attachments()
    assert (one.table, one.kind, one.objects, one.is_waiting, one.remark) == ("mission.ops", "area", 3, False, None)


@pytest.mark.parametrize("every_s", [None, 1.0])
def test_only_rows_that_count_are_objects(db: Database, every_s: float | None) -> None:
    """They come and go as the condition becomes true and false; null is false."""
    do(
        db,
        "ALTER TABLE mission.ops ADD state text DEFAULT 'approved'",
        "UPDATE mission.ops SET state = NULL WHERE id = 2",
    )
    mapped = {**OPS_MAP, "where": "state = 'approved' AND depth_ft / nullif(id, 9) > 0"}
    assert len(db.scene("s").preview_attachment("area", "mission.ops", mapped).objects) == 2
    db.scene("s").attach("area", "mission.ops", mapped, every_s=every_s)

    def follow() -> list[str]:
        if every_s is not None:
            do(db, "UPDATE conflictdb.attachment SET compared_at = NULL")
        db.scene("s").follow()
        return keys(db)

    assert follow() == ["1", "3"]
    do(
        db,
        "UPDATE mission.ops SET state = 'draft' WHERE id = 3",
        "UPDATE mission.ops SET state = 'approved' WHERE id = 2",
    )
    assert follow() == ["1", "2"]
    # Errors of the mapping are reported for matching rows only.
    do(
        db,
        "INSERT INTO mission.ops (id, state) VALUES (4, 'draft'), (5, 'approved')",
        "DELETE FROM mission.ops WHERE id = 1",
    )
    do(db, "UPDATE mission.ops SET depth_ft = 1 WHERE id = 5")
    assert follow() == ["2"]
    assert [identity for identity, _ in reasons(db)] == ["{5}"]
    do(db, "UPDATE mission.ops SET state = 'draft'")
    assert (follow(), reasons(db)) == ([], [])
    db.scene("s").detach("mission.ops")
    for wrong, rule in (("id", "must be of type boolean"), ("random() > 1", "volatile"), ("no", "cannot be used")):
        with pytest.raises(InvalidInput, match=rule):
            db.scene("s").attach("area", "mission.ops", {**OPS_MAP, "where": wrong})
        db.connection.rollback()


def test_rows_of_waypoints_become_tracks(db: Database) -> None:
    """Also an outline that changes, and heights that differ along the way."""
    db.scene("s").attach("track", "mission.fix", {**FIX_MAP, "floor_m": "-draught", "ceiling_m": "30"})
    do(db, "UPDATE mission.fix SET draught = 8, beam = 40 WHERE voyage = 'V2' AND at >= '2026-03-01 07:00Z'")
    db.scene("s").follow()
    assert ask(
        db,
        """SELECT key, ST_AsText(ST_Force2D(ST_SnapToGrid(path, 1e-6))), ST_M(ST_StartPoint(path)),
                  ST_NumGeometries(outlines), floor_m, floors_m, ceiling_m FROM conflictdb.track ORDER BY key""",
    ) == [
        ("V1", "LINESTRING(8 58,9 58,10 58,11 58)", 1772341200.0, None, -5.0, None, 30.0),
        ("V2", "LINESTRING(8 59,9 59,10 59,11 59)", 1772341200.0, 4, -8.0, [-5.0, -8.0, -8.0], 30.0),
    ]


def test_paths_with_measures_and_paths_with_times_become_tracks(db: Database) -> None:
    do(
        db,
        """CREATE TABLE mission.leg (id text, way geometry, times timestamptz[]);
           INSERT INTO mission.leg VALUES
               ('m', ST_Transform('SRID=4326;LINESTRING M (8 57 1772341200, 9 57 1772344800)', 25832), NULL)""",
        "CREATE TABLE mission.plan (id text, way geometry, times timestamptz[])",
        """INSERT INTO mission.plan VALUES
               ('t', ST_Transform('SRID=4326;LINESTRING Z (8 57 5, 9 57 5)', 3857),
                ARRAY['2026-03-01 05:00Z', '2026-03-01 06:00Z']::timestamptz[]),
               ('short', 'SRID=4326;LINESTRING (8 57, 9 57)', ARRAY['2026-03-01 05:00Z']::timestamptz[]),
               ('none', 'SRID=4326;LINESTRING (8 57, 9 57)', NULL)""",
    )
    haven = {"key": "id", "path": "way", "outline": "conflictdb.rectangle_outline(10, 10, 5, 5)"}
    db.scene("s").attach("track", "mission.leg", haven)
    db.scene("s").attach("track", "mission.plan", {**haven, "times": "times"})
    db.scene("s").follow()
    assert ask(
        db, "SELECT key, ST_AsText(ST_SnapToGrid(path, 0, 0, 1e-6, 1e-6)) FROM conflictdb.track ORDER BY key"
    ) == [(key, "LINESTRING M (8 57 1772341200,9 57 1772344800)") for key in "mt"]
    assert [identity for identity, _ in reasons(db)] == ["{none}", "{short}"]


def test_changes_are_followed(db: Database) -> None:
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    before = dict(ask(db, "SELECT key, version FROM conflictdb.area"))
    do(
        db,
        "UPDATE mission.ops SET depth_ft = 7 WHERE id = 1",
        "DELETE FROM mission.ops WHERE id = 2",
        "INSERT INTO mission.ops SELECT 4, shape, valid, 1 FROM mission.ops WHERE id = 1",
    )
    assert [len(one) for one in ask(db, "SELECT identities FROM conflictdb.attached_change")] == [2, 1, 1]
    db.scene("s").follow()
    assert keys(db) == ["1", "3", "4"]
    after = dict(ask(db, "SELECT key, version FROM conflictdb.area"))
    assert after["1"] > before["1"]
    assert after["3"] == before["3"]
    assert ask(db, "SELECT floor_m FROM conflictdb.area WHERE key = '1'") == [pytest.approx(-7 * 0.3048)]


@pytest.mark.filterwarnings("ignore:attachment of mission.ops. areas are there at all times")
def test_what_does_not_change_an_object_leaves_no_mark(db: Database) -> None:
    db.scene("s").attach("area", "mission.ops", {"key": "id", "footprint": "shape"})
    db.scene("s").detect()
    do(db, "UPDATE mission.ops SET depth_ft = 5", "UPDATE mission.ops SET depth_ft = 6 WHERE false")
    assert ask(db, "SELECT count(*) FROM conflictdb.attached_change") == [1]
    db.scene("s").follow()
    assert ask(db, "SELECT is_current FROM conflictdb.scenes") == [True]


def test_other_keys_truncate_copy_and_large_statements_are_followed(db: Database) -> None:
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    do(db, "UPDATE mission.ops SET id = id + 10")
    db.scene("s").follow()
    assert keys(db) == ["11", "12", "13"]
    do(db, "UPDATE mission.ops SET id = 24 - id")  # 11 and 13 change places, 12 stays
    db.scene("s").follow()
    assert ask(db, "SELECT key, round(ST_XMin(footprint)) FROM conflictdb.area ORDER BY key") == [
        ("11", 11.0),
        ("12", 10.0),
        ("13", 9.0),
    ]
    do(
        db,
        "INSERT INTO mission.ops SELECT i, shape, valid, 1 FROM mission.ops, generate_series(100, 400) i WHERE id = 11",
    )
    assert ask(db, "SELECT identities FROM conflictdb.attached_change") == [None]
    db.scene("s").follow()
    assert len(keys(db)) == 304
    do(db, "TRUNCATE mission.ops")
    db.scene("s").follow()
    assert keys(db) == []
    with psycopg.connect(db.connection.info.dsn) as other, other.cursor().copy("COPY mission.ops FROM STDIN") as copy:
        copy.write(b"7\tSRID=25832;POLYGON((5e5 6e6,5.1e5 6e6,5.1e5 6.1e6,5e5 6e6))\t\\N\t1\n")
    db.scene("s").follow()
    assert keys(db) == ["7"]


def test_changes_that_arrive_as_replicas_are_followed(db: Database) -> None:
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    do(
        db,
        "SET session_replication_role = replica",
        "DELETE FROM mission.ops WHERE id = 1",
        "UPDATE mission.ops SET id = 20 WHERE id = 2",
        "INSERT INTO mission.ops SELECT 4, shape, valid, 1 FROM mission.ops WHERE id = 3",
    )
    db.scene("s").follow()
    assert keys(db) == ["20", "3", "4"]
    do(db, "SET session_replication_role = replica", "TRUNCATE mission.ops")
    db.scene("s").follow()
    assert keys(db) == []


def test_a_row_that_cannot_be_mapped_says_why_and_stops_no_other(db: Database) -> None:
    do(
        db,
        """INSERT INTO mission.ops VALUES
               (11, ST_GeomFromText('POLYGON((0 0, 9 9, 9 0, 0 9, 0 0))', 25832), NULL, 1),
               (12, NULL, NULL, 1), (13, NULL, 'empty', 0)""",
    )
    db.scene("s").attach("area", "mission.ops", {**OPS_MAP, "floor_m": "100 / depth_ft - 1000"})
    db.scene("s").follow()
    assert keys(db) == ["1", "2", "3"]
    assert [(identity, reason.partition("[")[0]) for identity, reason in reasons(db)] == [
        ("{11}", "area '11': footprint: must be a valid polygon: Self-intersection"),
        ("{12}", "area '12': footprint: must be a MultiPolygon without empty parts"),
        ("{13}", "division by zero"),
    ]
    do(
        db,
        "UPDATE mission.ops SET depth_ft = 0 WHERE id = 1",
        "UPDATE mission.ops SET shape = (SELECT shape FROM mission.ops WHERE id = 1) WHERE id = 12",
        "DELETE FROM mission.ops WHERE id = 11",
    )
    db.scene("s").follow()
    assert keys(db) == ["1", "12", "2", "3"]
    assert [(row.identity, row.is_kept) for row in db.scene("s").unmapped()] == [("{13}", False), ("{1}", True)]
    assert ask(db, "SELECT unmapped FROM conflictdb.scenes") == [2]
    do(db, "UPDATE mission.ops SET depth_ft = 5 WHERE id = 1")
    db.scene("s").follow()
    assert [row.identity for row in db.scene("s").unmapped()] == ["{13}"]
    do(db, "DELETE FROM mission.ops WHERE id = 1")
    db.scene("s").follow()
    assert keys(db) == ["12", "2", "3"]


def test_many_rows_that_cannot_be_mapped_are_told_one_by_one(db: Database) -> None:
    do(
        db,
        """INSERT INTO mission.ops SELECT i, CASE WHEN i % 7 > 0 THEN o.shape END, o.valid, 1
           FROM mission.ops o, generate_series(101, 800) i WHERE o.id = 1""",
    )
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    assert (len(keys(db)), len(db.scene("s").unmapped())) == (603, 100)


def test_null_keys_and_keys_twice_are_told(db: Database) -> None:
    do(
        db,
        "CREATE TABLE mission.zone (code text, part integer, shape geometry)",
        """INSERT INTO mission.zone SELECT c.code, c.part, 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))'
           FROM (VALUES ('a', 1), ('a', 1), ('b', NULL), (NULL, 1), ('c', 2), ('C', 3)) c (code, part)""",
    )
    db.scene("s").attach("area", "mission.zone", {"key": "upper(code)", "footprint": "shape", "name": "part::text"})
    db.scene("s").follow()
    assert keys(db) == ["B", "C"]
    reason = dict(reasons(db))
    assert reason == {
        "{a}": "key: 2 rows of the table have it",
        "{NULL}": "key: is null",
        "{c}": "key: another row of the table has it too",
    }
    do(db, "DELETE FROM mission.zone WHERE code = 'C'", "UPDATE mission.zone SET code = 'd' WHERE code IS NULL")
    db.scene("s").follow()
    assert (keys(db), [identity for identity, _ in reasons(db)]) == (["B", "C", "D"], ["{a}"])
    do(db, "UPDATE mission.zone SET part = 2 WHERE ctid = (SELECT min(ctid) FROM mission.zone WHERE code = 'a')")
    db.scene("s").detach("mission.zone")
    db.scene("s").attach("area", "mission.zone", {"key": "code || part", "footprint": "shape"})
    db.scene("s").follow()
    assert keys(db) == ["a1", "a2", "c2", "d1"]


def test_of_two_tables_with_one_key_the_first_has_it(db: Database) -> None:
    """When it gives the key up, the other one gets it."""
    do(db, "CREATE TABLE mission.more AS SELECT * FROM mission.ops WHERE id < 3")
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    db.scene("s").attach("area", "mission.more", OPS_MAP)
    with db.connection.transaction():
        db.connection.execute("SELECT conflictdb.put_area('s', 'mine', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))')")
    do(db, "UPDATE mission.more SET depth_ft = 1")
    db.scene("s").follow()
    assert reasons(db) == [(f"{{{i}}}", "key: is taken by a row of mission.ops") for i in (1, 2)]
    do(db, "DELETE FROM mission.ops WHERE id = 1")
    db.scene("s").follow()
    assert keys(db) == ["1", "2", "3", "mine"]
    assert ask(db, "SELECT floor_m FROM conflictdb.area WHERE key = '1'") == [pytest.approx(-0.3048)]
    assert db.scene("s").detach("mission.ops") == 2
    db.scene("s").follow()
    assert keys(db) == ["1", "2", "mine"]
    assert reasons(db) == []


def test_what_others_change_of_attached_objects_is_brought_back(db: Database) -> None:
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").detect()
    do(
        db,
        "SELECT conflictdb.remove_object('s', '1')",
        "UPDATE conflictdb.area SET floor_m = -1 WHERE key = '2'",
        "SELECT conflictdb.request_detection('s', true)",
    )
    db.scene("s").detect()
    assert ask(db, "SELECT key, round(floor_m) FROM conflictdb.area ORDER BY key") == [
        ("1", -30.0),
        ("2", -61.0),
        ("3", -91.0),
    ]
    assert ask(db, "SELECT is_current FROM conflictdb.scenes") == [True]


def test_views_are_compared_now_and_then(db: Database) -> None:
    do(db, "CREATE VIEW mission.deep AS SELECT *, depth_ft > 150 AS is_deep FROM mission.ops WHERE depth_ft > 150")
    db.scene("s").attach("area", "mission.deep", OPS_MAP)
    db.scene("s").follow()
    assert keys(db) == ["2", "3"]
    do(
        db,
        "UPDATE mission.ops SET depth_ft = 500 WHERE id = 1",
        "UPDATE mission.ops SET depth_ft = 5 WHERE id = 2",
        "UPDATE mission.ops SET depth_ft = 600 WHERE id = 3",
    )
    db.scene("s").follow()
    assert keys(db) == ["2", "3"], "not yet"
    do(db, "UPDATE conflictdb.attachment SET compared_at = compared_at - interval '1 minute'")
    db.scene("s").follow()
    assert ask(db, "SELECT key, round(floor_m) FROM conflictdb.area ORDER BY key") == [("1", -152.0), ("3", -183.0)]
    (one,) = db.scene("s").attachments()
    assert (one.has_triggers, one.every.total_seconds()) == (False, 60.0)


def test_foreign_tables_are_compared_now_and_then(db: Database) -> None:
    info = db.connection.info
    do(db, "CREATE EXTENSION postgres_fdw")
    do(
        db,
        f"CREATE SERVER elsewhere FOREIGN DATA WRAPPER postgres_fdw OPTIONS (host '{info.host}', port '{info.port}', "
        f"dbname '{info.dbname}')",
        f"CREATE USER MAPPING FOR CURRENT_USER SERVER elsewhere "
        f"OPTIONS (user '{info.user}', password '{info.password}')",
        "CREATE SCHEMA abroad",
        "IMPORT FOREIGN SCHEMA mission LIMIT TO (ops) FROM SERVER elsewhere INTO abroad",
    )
    db.scene("s").attach("area", "abroad.ops", OPS_MAP, every_s=1.0)
    db.scene("s").follow()
    assert keys(db) == ["1", "2", "3"]
    do(db, "DELETE FROM mission.ops WHERE id = 2")
    do(db, "UPDATE conflictdb.attachment SET compared_at = compared_at - interval '1 minute'")
    db.scene("s").follow()
    assert keys(db) == ["1", "3"]


def test_columns_and_tables_may_change_as_if_not_attached(db: Database) -> None:
    """Writes go on; an unreadable column is reported, and the objects stay."""
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    do(db, "ALTER TABLE mission.ops RENAME id TO nr", "UPDATE mission.ops SET nr = nr + 1", "DELETE FROM mission.ops")
    db.scene("s").follow()
    (one,) = db.scene("s").attachments()
    assert "column t.id does not exist" in str(one.error)
    assert keys(db) == ["1", "2", "3"]
    assert ask(db, "SELECT is_current FROM conflictdb.scenes") == [False]
    assert list(store.waiting_scenes(db.connection)) == ["s"], "of marks; the table is left alone for a minute"
    do(db, "ALTER TABLE mission.ops RENAME nr TO id", "ALTER TABLE mission.ops ALTER id TYPE bigint")
    db.scene("s").follow()
    assert keys(db) == []
    assert db.scene("s").attachments()[0].error is None
    do(db, "ALTER TABLE mission.ops DROP COLUMN depth_ft", "DROP TABLE mission.ops")
    assert "the table no longer exists" in str(db.scene("s").attachments()[0].remark)
    assert db.scene("s").detach("mission.ops") == 0
    assert ask(db, "SELECT to_regnamespace('conflictdb_attached') IS NULL") == [True]


@pytest.mark.parametrize("schemas", ["conflictdb", "conflictdb, conflictdb_internal"])
def test_dropping_the_schema_leaves_the_tables_as_they_were(db: Database, schemas: str) -> None:
    """Their writers go on, also if the private schema, whose functions are triggers on them, is not dropped."""
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").attach("track", "mission.fix", FIX_MAP)
    db.scene("s").follow()
    do(db, f"DROP SCHEMA {schemas} CASCADE")
    do(
        db,
        "UPDATE mission.ops SET depth_ft = 1",
        "INSERT INTO mission.fix SELECT * FROM mission.fix",
        "TRUNCATE mission.ops",
        "SET session_replication_role = replica",
        "DELETE FROM mission.fix",
        "RESET session_replication_role",
        "DROP SCHEMA IF EXISTS conflictdb_internal CASCADE",
    )
    assert ask(db, "SELECT tgname FROM pg_trigger WHERE NOT tgisinternal AND tgname ~ 'conflictdb'") == []
    assert ask(db, "SELECT proname FROM pg_proc WHERE pronamespace = to_regnamespace('conflictdb_attached')") == []


def test_names_of_any_characters(db: Database) -> None:
    do(
        db,
        'CREATE SCHEMA "Ünï ""q"" %s"',
        """CREATE TABLE "Ünï ""q"" %s"."select; --" ("order" text, "sh'ape" geometry, "t" timestamptz, "v_row" int,
               "a""b" text, conflictdb_error text, PRIMARY KEY ("order", "a""b"))""",
        """INSERT INTO "Ünï ""q"" %s"."select; --" VALUES
               ('{x,"y"}', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))', NULL, 1, 'NULL', 'e'),
               ('', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))', NULL, 1, E'\\\\ \\'', NULL),
               ('%', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))', NULL, 1, E'\\u2028', NULL)""",
    )
    name = '"Ünï ""q"" %s"."select; --"'
    db.scene("s").attach(
        "area", name, {"key": """"order" || '|' || "a""b\"""", "footprint": "sh'ape", "name": "order", "end": "t"}
    )
    db.scene("s").follow()
    assert sorted(keys(db)) == sorted(['{x,"y"}|NULL', "|\\ '", "%|\u2028"])
    do(
        db,
        f"UPDATE {name} SET \"order\" = 'z' WHERE \"order\" = ''",
        f'UPDATE {name} SET "a""b" = \'w\' WHERE "order" = \'%\'',
    )
    db.scene("s").follow()
    assert sorted(keys(db)) == sorted(['{x,"y"}|NULL', "z|\\ '", "%|w"])
    db.scene("s").detach(name)
    assert keys(db) == []


def test_areas_across_the_seam_stay_whole(db: Database) -> None:
    do(
        db,
        "CREATE TABLE mission.far (id integer, shape geometry)",
        """INSERT INTO mission.far VALUES
               (1, ST_Transform('SRID=4326;POLYGON((179 0, 179 1, -179 1, -179 0, 179 0))'::geometry, 3832)),
               (2, ST_Transform(ST_MakeEnvelope(-170, 0, 170, 10, 4326), 3857)),
               (3, ST_Transform(ST_MakeEnvelope(-10, 0, 10, 10, 4326), 3857))""",
    )
    db.scene("s").attach("area", "mission.far", {"key": "id", "footprint": "shape"})
    db.scene("s").follow()
    assert ask(
        db,
        "SELECT key, round(ST_XMin(footprint)), round(ST_XMax(footprint)) FROM conflictdb.area ORDER BY key",
    ) == [("1", 179.0, 181.0), ("2", -170.0, 170.0), ("3", -10.0, 10.0)]


def test_sessions_that_follow_at_the_same_time_take_turns(db: Database, dsn: str) -> None:
    """The second waits for the first, and then reads the table as it is."""
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    do(db, "UPDATE mission.ops SET depth_ft = 1 WHERE id = 1")
    with store.connect(dsn) as other, ThreadPoolExecutor(1) as pool:
        other.execute("SELECT * FROM conflictdb.follow_attached('s')")
        waiting = pool.submit(db.scene("s").follow)
        do(db, "UPDATE mission.ops SET depth_ft = 2 WHERE id = 1")
        waits = "SELECT EXISTS (SELECT FROM pg_locks WHERE NOT granted AND pid = %s)"
        until_s = time.monotonic() + WAIT_S
        while other.execute(waits, [db.connection.info.backend_pid]).fetchone() != (True,):
            assert time.monotonic() < until_s, "the second does not wait"
            time.sleep(0.01)
        other.commit()
        waiting.result(timeout=WAIT_S)
    assert ask(db, "SELECT floor_m FROM conflictdb.area WHERE key = '1'") == [pytest.approx(-2 * 0.3048)]
    assert ask(db, "SELECT count(*) FROM conflictdb.attached_change") == [0]


def test_other_settings_of_the_scene_give_refused_rows_another_chance(db: Database) -> None:
    do(db, "INSERT INTO mission.ops VALUES (9, ST_Transform(ST_MakeEnvelope(8, 89.2, 9, 89.5, 4326), 25832), NULL, 1)")
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    assert [identity for identity, _ in reasons(db)] == ["{9}"]
    do(db, "SELECT conflictdb.create_scene('s', 'great_circle')")
    db.scene("s").follow()
    assert reasons(db) == []


def test_a_scene_cannot_go_while_tables_are_attached(db: Database) -> None:
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").follow()
    with pytest.raises(psycopg.DatabaseError, match=r"tables: are attached to it: mission\.ops") as refused:
        do(db, "DELETE FROM conflictdb.scene")
    assert refused.value.sqlstate == "ZC009"
    assert db.scene("s").detach("mission.ops", keep=True) == 0
    assert keys(db) == ["1", "2", "3"]
    do(db, "UPDATE mission.ops SET depth_ft = 9", "DELETE FROM conflictdb.scene")


def test_columns_may_have_any_name_and_a_map_depends_on_the_row_alone(db: Database) -> None:
    do(
        db,
        """CREATE TABLE mission.odd (conflictdb_value text, conflictdb_one text, failure text, t text,
                                     shape geometry(Polygon, 4326))""",
        "INSERT INTO mission.odd VALUES ('A', 'b', 'c', 'now', ST_MakeEnvelope(0, 0, 1, 1, 4326))",
        "INSERT INTO mission.odd VALUES ('B', 'b', 'c', '2026-03-01T06:00:00Z', NULL)",
    )
    mapped = {"key": "conflictdb_value", "footprint": "shape", "name": "conflictdb_one || failure"}
    db.scene("s").attach("area", "mission.odd", mapped)
    db.scene("s").follow()
    assert ask(db, "SELECT key || name FROM conflictdb.area") == ["Abc"]
    assert [identity for identity, _ in reasons(db)] == ["{B}"]
    for field, wrong, rule in (
        ("start", "('now'::text)::timestamptz", "read an instant from text"),
        ("start", "t.t::timestamptz", "read an instant from text"),
        ("span", "('[' || t.t || ',)')::tstzrange", "read an instant from text"),
        ("name", "current_setting('application_name')", "only on the row"),
        ("name", "pg_get_userbyid(10)", "only on the row"),
        ("name", "ctid", "system columns"),
        ("name", "xmin::text", "system columns"),
        ("name", "tableoid::regclass::text", "system columns"),
    ):
        with pytest.raises(InvalidInput, match=rule):
            db.scene("s").attach("area", "mission.odd", {**mapped, field: wrong}, again=True)
    # The function that reads fixes the settings.
    db.scene("s").detach("mission.odd")
    do(
        db,
        "DELETE FROM mission.odd WHERE t = 'now'",
        "UPDATE mission.odd SET shape = ST_MakeEnvelope(0, 0, 1, 1, 4326)",
    )
    db.scene("s").attach("area", "mission.odd", {**mapped, "start": "conflictdb.instant(t.t) + interval '1 day'"})
    db.scene("s").follow()
    assert ask(db, "SELECT lower(active_span) = '2026-03-02 06:00Z' FROM conflictdb.area") == [True]


@pytest.mark.parametrize("harm", ["ALTER TABLE mission.ops DISABLE TRIGGER ALL", "DROP TABLE mission.ops"])
def test_a_scene_is_not_current_while_changes_go_unnoticed(db: Database, harm: str) -> None:
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    db.scene("s").detect()
    assert db.scenes()[0].is_current
    do(db, harm)
    (state,) = db.scenes()
    assert not state.is_current
    with db.connection.transaction():
        remark = store.scene_state(db.connection, "s").remark
    assert "mission.ops: " in str(remark)
    assert "reattach" in str(remark)


ORDERED = """
CREATE TABLE mission.leg (voyage text, nr integer, at timestamptz, place geometry(Point, 4326));
INSERT INTO mission.leg
SELECT v, i, timestamptz '2026-03-01 05:00Z' + i * interval '1 hour', ST_Point(8 + 0.2 * i, 57, 4326)
FROM unnest('{STEADY,LATE,TWICE,"NULL",FAST}'::text[]) v, generate_series(0, 3) i;
UPDATE mission.leg SET at = '2026-03-01 04:00Z' WHERE voyage = 'LATE' AND nr = 2;
UPDATE mission.leg SET nr = 1 WHERE voyage = 'TWICE' AND nr = 2;
UPDATE mission.leg SET nr = NULL WHERE voyage = 'NULL' AND nr = 2;
UPDATE mission.leg SET place = ST_Point(98, 57, 4326) WHERE voyage = 'FAST' AND nr = 3;
"""
LEG_MAP = {"key": "voyage", "position": "place", "time": "at"} | dict.fromkeys(
    ("fore_m", "aft_m", "port_m", "starboard_m"), "50"
)


def test_waypoints_in_an_order_must_have_times_that_increase(db: Database) -> None:
    """Sorted by time alone, a wrong time of arrival makes another route without a remark."""
    do(db, ORDERED)
    db.scene("s").attach("track", "mission.leg", {**LEG_MAP, "order": "nr"})
    db.scene("s").follow()
    assert keys(db, "track") == ["STEADY"]
    found = dict(reasons(db))
    assert re.fullmatch(
        r"track 'FAST': path: the leg to times\[3\] is travelled at 2\d{3} kn, beyond 2000 kn", found.pop("{FAST}")
    )
    assert found == {
        "{LATE}": "time: must increase along order: waypoint 2 is at 2026-03-01 04:00:00+00, waypoint 1 before it at "
        "2026-03-01 06:00:00+00",
        '{"NULL"}': "order: is null in a row",
        "{TWICE}": "order: 1 is given twice",
    }
    do(db, "UPDATE mission.leg SET at = '2026-03-01 07:00Z' WHERE voyage = 'LATE' AND nr = 2")
    db.scene("s").follow()
    assert keys(db, "track") == ["LATE", "STEADY"]


def test_without_an_order_waypoints_are_sorted_by_time(db: Database) -> None:
    do(db, ORDERED)
    db.scene("s").attach("track", "mission.leg", {**LEG_MAP, "where": "voyage = 'LATE'"})
    db.scene("s").follow()
    assert ask(db, "SELECT ST_X(ST_StartPoint(path)) FROM conflictdb.track") == [8.4]


@pytest.mark.parametrize(
    ("mapped", "rule"),
    [
        ({"key": "voyage", "path": "ST_MakeLine(place, place)", "order": "nr"}, "order: is of waypoints one by one"),
        ({**LEG_MAP, "order": "voyage"}, "'voyage' must be of type double precision; got text"),
    ],
)
def test_an_order_that_cannot_be_is_refused(db: Database, mapped: dict[str, str], rule: str) -> None:
    do(db, ORDERED)
    with pytest.raises(InvalidInput, match=rule):
        db.scene("s").attach("track", "mission.leg", LEG_MAP | mapped if "path" not in mapped else mapped)


RECUR = """
ALTER TABLE mission.ops ADD times tstzmultirange, ADD plan jsonb;
UPDATE mission.ops SET times = tstzmultirange(valid, tstzrange('2026-03-03 06:00Z', '2026-03-03 07:00Z')) WHERE id < 3;
UPDATE mission.ops SET plan = '{"days": ["TUE"], "periods": [["08:00", "10:00"]], "timezone": "UTC"}';
CREATE TABLE mission.line (id integer PRIMARY KEY, path geometry(LineStringM, 4326), starts timestamptz[], plan jsonb,
                           within json);
INSERT INTO mission.line
SELECT i, ST_SetSRID(ST_MakeLine(ST_MakePointM(8, 56.75 + i / 2.0, t), ST_MakePointM(12, 56.75 + i / 2.0, t + 14400)),
                     4326),
       ARRAY[to_timestamp(t), to_timestamp(t + 172800)],
       '{"rrule": "DTSTART:20260302T000000Z\\nRRULE:FREQ=DAILY", "duration": "PT1H"}',
       '{"xtd_port_m": 500}'
FROM generate_series(1, 2) i, extract(epoch FROM timestamptz '2026-03-01 05:00Z') t;
"""
LINE_MAP = {"key": "'L' || id", "path": "path", "outline": "ST_MakeEnvelope(-50, -50, 50, 50)"}
PLAIN_MAP = {"key": "id", "footprint": "shape"}


def as_put(db: Database, kind: str, fields: str) -> list[Any]:
    return ask(db, f"SELECT key, {fields} FROM conflictdb.{kind} ORDER BY key")


def test_activations_departures_and_tolerances_are_those_of_the_row(db: Database) -> None:
    """They are stored as put_area and put_track store them, follow the table, and detect as a full detection does."""
    do(db, RECUR)
    scene = db.scene("s")
    scene.attach("area", "mission.ops", {**PLAIN_MAP, "activations": "times", "class": "'c' || id", "owner": "NULL"})
    scene.attach("track", "mission.line", {**LINE_MAP, "departures": "starts", "owner": "'o' || id"})
    assert scene.detect().opened > 0
    first = '{["2026-03-01 06:00:00+00","2026-03-01 18:00:00+00"),["2026-03-03 06:00:00+00","2026-03-03 07:00:00+00")}'
    assert as_put(db, "area", "activations::text, class") == [("1", first, "c1"), ("2", first, "c2"), ("3", None, "c3")]
    assert as_put(db, "track", "cardinality(departures), owner") == [("L1", 2, "o1"), ("L2", 2, "o2")]
    assert any(len(one.periods) == 2 for one in scene.conflicts())
    for change in (
        "UPDATE mission.ops SET times = '{[2026-03-03 05:00Z, 2026-03-03 08:00Z)}' WHERE id = 1",
        "UPDATE mission.ops SET times = '{}' WHERE id = 1",
        "UPDATE mission.ops SET times = NULL WHERE id = 1",
        "UPDATE mission.line SET starts = starts[2:] WHERE id = 1",
        "UPDATE mission.line SET starts = NULL WHERE id = 1",
        "UPDATE mission.line SET starts = '{}' WHERE id = 1",
    ):
        do(db, change)
        scene.detect()
        found = scene.conflicts()
        alone = scene.detect(full=True)
        assert (alone.opened, alone.changed, alone.closed) == (0, 0, 0), change
        assert scene.conflicts() == found
    do(db, "UPDATE mission.line SET starts = ARRAY[starts[1], starts[1]] WHERE id = 2")
    scene.follow()
    assert [(who, why.split(":")[1]) for who, why in reasons(db)] == [("{2}", " departures[2]")]
    scene.detach("mission.line")
    scene.attach("track", "mission.line", {**LINE_MAP, "tolerances": "within"})
    scene.follow()
    assert as_put(db, "track", "tolerances ->> 'xtd_port_m'") == [("L1", "500"), ("L2", "500")]
    do(
        db,
        "UPDATE mission.line SET within = '{\"xtd_port_m\": 1e9}' WHERE id = 1",
        "UPDATE mission.line SET within = NULL WHERE id = 2",
    )
    scene.follow()
    assert as_put(db, "track", "tolerances ->> 'xtd_port_m'") == [("L1", "500"), ("L2", None)]
    assert [who for who, _ in reasons(db)] == ["{1}"]


def test_schedules_of_rows_are_expanded_by_the_next_detection(db: Database) -> None:
    do(db, RECUR)
    scene = db.scene("s")
    assert scene.settings().horizon_days == 366.0
    scene.attach("area", "mission.ops", {**PLAIN_MAP, "schedule": "plan", "start": "lower(valid)"})
    scene.attach("track", "mission.line", {**LINE_MAP, "schedule": "plan"})
    previewed = scene.preview_reattachment("mission.ops", {"start": None}).objects
    assert len(previewed) == 3
    assert all(json.loads(one)["properties"]["schedule"]["days"] == ["TUE"] for one in previewed)
    scene.detect()
    assert all(spans > 50 for _, spans in as_put(db, "area", "cardinality(array(SELECT unnest(activations)))"))
    assert all(voyages > 300 for _, voyages in as_put(db, "track", "cardinality(departures)"))
    # An expansion is no change by others, and nothing is read again.
    assert store.attachments_to_follow(db.connection, "s", again=False) == []
    do(
        db,
        'UPDATE mission.ops SET plan = \'{"days": ["FUNDAY"]}\' WHERE id = 1',
        "UPDATE mission.ops SET plan = 'null' WHERE id = 2",
    )
    scene.detect()
    assert as_put(db, "area", "schedule_error IS NULL, schedule IS NULL") == [
        ("1", False, False), ("2", True, True), ("3", True, False)
    ]  # fmt: skip
    alone = scene.detect(full=True)
    assert (alone.opened, alone.changed, alone.closed) == (0, 0, 0)


@pytest.mark.parametrize(
    ("kind", "more", "rule"),
    [
        ("area", {"activations": "times", "span": "valid"}, "activations: must not be given together"),
        ("area", {"activations": "times", "schedule": "plan"}, "activations: must not be given together"),
        ("area", {"activations": "valid"}, "activations: 'valid' must be of type tstzmultirange"),
        ("area", {"activations": "times::text::tstzmultirange"}, "must not read an instant from text"),
        ("area", {"departures": "plan"}, "departures: is no field of an area"),
        ("track", {"departures": "starts", "schedule": "plan"}, "departures: must not be given together"),
        ("track", {"tolerances": "within", "schedule": "plan"}, "tolerances: must not be given for a voyage"),
        ("track", {"departures": "ARRAY[now()]"}, "must depend only on the row"),
    ],
)
def test_fields_that_contradict_each_other_are_refused(
    db: Database, kind: str, more: dict[str, str], rule: str
) -> None:
    do(db, RECUR)
    table, given = ("mission.ops", PLAIN_MAP) if kind == "area" else ("mission.line", LINE_MAP)
    with pytest.raises(InvalidInput, match=rule):
        db.scene("s").attach(kind, table, {**given, **more})


def test_tables_that_an_earlier_release_attached_are_followed(db: Database) -> None:
    """Their functions return rows without the fields that maps have gained since."""
    db.scene("s").attach("area", "mission.ops", OPS_MAP)
    (source,) = ask(db, "SELECT pg_get_functiondef(p.oid) FROM pg_proc p WHERE p.proname ~ '^rows_'")
    fields = ["text", "text", "tstzmultirange", "timestamp with time zone[]", "jsonb", "jsonb"]
    gained = ", ".join(f"NULL::{type_}" for type_ in fields)
    assert gained in source
    former = source.replace("attached_plan", "attached_row").replace(", " + gained, "")
    (name,) = ask(db, "SELECT p.oid::regprocedure::text FROM pg_proc p WHERE p.proname ~ '^rows_'")
    do(db, f"DROP FUNCTION {name}", former)
    db.scene("s").follow()
    assert keys(db) == ["1", "2", "3"]
    do(db, "DELETE FROM mission.ops WHERE id = 2")
    db.scene("s").follow()
    assert keys(db) == ["1", "3"]
    assert db.scene("s").attachments()[0].error is None


@pytest.mark.parametrize(
    ("kind", "column", "type_"),
    [
        ("area", "activations", "tstzmultirange"),
        ("area", "schedule", "jsonb"),
        ("track", "departures", "timestamptz[]"),
        ("track", "tolerances", "json"),
    ],
)
def test_plans_whose_columns_the_map_leaves_out_are_refused(db: Database, kind: str, column: str, type_: str) -> None:
    table, given = ("mission.ops", PLAIN_MAP) if kind == "area" else ("mission.fix", FIX_MAP)
    do(db, f"ALTER TABLE {table} ADD {column} {type_}")
    with pytest.raises(InvalidInput, match=f"{column}: is a column that the map does not read"):
        db.scene("s").attach(kind, table, given)
    db.scene("s").attach(kind, table, {**given, column: column})
    db.scene("s").detach(table)
    # Such a name alone is no mistake.
    do(db, f"ALTER TABLE {table} DROP {column}", f"ALTER TABLE {table} ADD {column} text")
    db.scene("s").attach(kind, table, OPS_MAP if kind == "area" else FIX_MAP)
