"""A stranger's database, with tables and names of its own, is attached by one command, and left as it was."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import psycopg
import pytest
from commands import runner
from databases import client_programs
from patience import WAIT_S, until

from conflictdb import connect
from conflictdb.jobs import schema

STRANGERS = """
CREATE EXTENSION postgis;
CREATE EXTENSION btree_gist;
CREATE SCHEMA "Planung";
CREATE TYPE "Planung".zustand AS ENUM ('geplant', 'abgesagt');
CREATE TABLE "Planung"."Sperrgebiete" (
    "Nr" integer PRIMARY KEY, umriss geometry(Polygon, 25832) NOT NULL, von timestamp NOT NULL, bis timestamp,
    tiefe_ft numeric(6, 1), "Zustand" "Planung".zustand NOT NULL DEFAULT 'geplant');
CREATE INDEX ON "Planung"."Sperrgebiete" USING gist (umriss);
CREATE TABLE "Planung".wegpunkte (
    fahrt uuid NOT NULL, folge smallint NOT NULL, zeit timestamptz NOT NULL, x double precision, y double precision,
    laenge_m real, breite_m real, PRIMARY KEY (fahrt, folge));
CREATE FUNCTION "Planung".protokoll() RETURNS trigger LANGUAGE plpgsql AS 'BEGIN RETURN NULL; END';
CREATE TRIGGER protokoll AFTER UPDATE ON "Planung".wegpunkte FOR EACH ROW EXECUTE FUNCTION "Planung".protokoll();
INSERT INTO "Planung"."Sperrgebiete"
SELECT i, ST_Transform(ST_MakeEnvelope(7 + i * 0.2, 55, 7.1 + i * 0.2, 55.1, 4326), 25832), '2026-03-01 06:00',
       '2026-03-01 18:00', 100
FROM generate_series(1, 5) i;
INSERT INTO "Planung".wegpunkte
SELECT md5(v::text)::uuid, i, timestamptz '2026-03-01 08:00Z' + i * interval '1 hour', ST_X(p), ST_Y(p), 120, 20
FROM generate_series(1, 3) v, generate_series(0, 4) i,
     ST_Transform(ST_Point(7 + i * 0.3, 55.2 + v * 0.2, 4326), 3857) p;
"""
AREAS = ("admin", "attach", "area", "--scene", "nordsee", "--table", '"Planung"."Sperrgebiete"', "--map")
AREA_MAP = (
    "key=Nr,footprint=umriss,start=von AT TIME ZONE 'UTC',end=bis AT TIME ZONE 'UTC',floor_m=-tiefe_ft*0.3048,"
    "name=concat('Gebiet ', \"Nr\"),properties=jsonb_build_object('zustand', \"Zustand\")"
)
TRACKS = ("admin", "attach", "track", "--scene", "nordsee", "--table", '"Planung".wegpunkte', "--map")
TRACK_MAP = (
    "key=fahrt,time=zeit,position=ST_Point(x, y, 3857),fore_m=laenge_m/2,aft_m=laenge_m/2,port_m=breite_m/2,"
    "starboard_m=breite_m/2"
)


@pytest.fixture
def dump(empty_dsn: str) -> Callable[[], str]:
    """Return a function that dumps the structure of all that is the stranger's."""
    with psycopg.connect(empty_dsn) as conn:
        programs, environ = client_programs(conn)
    command = [programs / "pg_dump", "--schema-only", "-N", "conflictdb", "-N", "conflictdb_internal", "-d", empty_dsn]

    def dumped() -> str:
        text = subprocess.run(command, check=True, env=environ, stdout=subprocess.PIPE, text=True).stdout
        # Newer versions of pg_dump guard against restores by psql, with a random word in each dump.
        return "\n".join(line for line in text.splitlines() if not line.startswith(("\\restrict", "\\unrestrict")))

    return dumped


@contextmanager
def working(dsn: str) -> Iterator[None]:
    worker = subprocess.Popen(
        [sys.executable, "-m", "conflictdb", "--dsn", dsn, "worker", "--every", "1h", "--jobs", "1"],
        stdout=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        worker.terminate()
        worker.wait(WAIT_S)


def test_a_strangers_tables_are_attached_kept_current_and_left_as_they_were(
    empty_dsn: str, dump: Callable[[], str], capsys: pytest.CaptureFixture[str]
) -> None:
    with psycopg.connect(empty_dsn) as conn:
        conn.execute(STRANGERS)
    before = dump()
    schema.upgrade(empty_dsn)
    assert dump() == before
    run = runner(empty_dsn, capsys)
    with psycopg.connect(empty_dsn, autocommit=True) as mission, connect(empty_dsn) as db, working(empty_dsn):

        def conflicts() -> set[tuple[str, str]]:
            rows = mission.execute("SELECT a_key, b_key FROM conflictdb.conflicts WHERE scene_is_current").fetchall()
            return set(rows)

        def is_current() -> bool:
            return bool(mission.execute("SELECT bool_and(is_current) FROM conflictdb.scenes").fetchone()[0])  # type: ignore[index]

        # The worker polls once an hour: notifications alone make the scene current within the limit.
        until(lambda: db.status().worker_count == 1)
        preview = run(*AREAS, AREA_MAP, "--dry-run")
        assert preview.code == 0, preview.err
        assert 'would create triggers conflictdb_1_… on "Planung"."Sperrgebiete"' in preview.out
        assert preview.out.count('"type": "Feature"') == 5
        assert dump() == before
        assert [run(*AREAS, AREA_MAP).code, run(*TRACKS, TRACK_MAP).code] == [0, 0]
        until(is_current)
        assert conflicts() == set()

        key = str(mission.execute("SELECT md5('1')::uuid").fetchone()[0])  # type: ignore[index]
        north = """UPDATE "Planung"."Sperrgebiete" SET umriss = ST_Transform(ST_Translate(
                       ST_Transform(umriss, 4326), 0, %s), 25832) WHERE "Nr" = 3"""
        for step, expected in ((0.35, {("3", key)}), (-0.35, set()), (0.35, {("3", key)})):
            mission.execute(north, [step])
            until(lambda expected=expected: is_current() and conflicts() == expected)  # type: ignore[misc]
        mission.execute("""DELETE FROM "Planung".wegpunkte WHERE fahrt = md5('1')::uuid""")
        until(lambda: is_current() and conflicts() == set())

        run("admin", "detach", "--scene", "nordsee", "--table", '"Planung"."Sperrgebiete"')
        assert run("admin", "detach", "--scene", "nordsee", "--table", '"Planung".wegpunkte').code == 0
        assert dump() == before
        assert mission.execute("SELECT objects FROM conflictdb.scenes").fetchall() == [(0,)]
        mission.execute('UPDATE "Planung"."Sperrgebiete" SET tiefe_ft = 1')
        mission.execute('TRUNCATE "Planung".wegpunkte')
        until(is_current)
        assert mission.execute("SELECT count(*) FROM conflictdb.attached_change").fetchone() == (0,)
    assert "Planung" in before


def test_tables_are_attached_where_postgis_lives_in_another_schema(empty_dsn: str) -> None:
    with psycopg.connect(empty_dsn) as conn:
        conn.execute('CREATE SCHEMA "My GIS"')
        conn.execute('CREATE EXTENSION postgis SCHEMA "My GIS"; CREATE EXTENSION btree_gist SCHEMA "My GIS"')
        conn.execute('CREATE TABLE public.zone (id integer, shape "My GIS".geometry)')
        conn.execute(
            """SET LOCAL search_path = "My GIS";
               INSERT INTO public.zone VALUES (1, ST_Transform(ST_MakeEnvelope(8, 57, 9, 58, 4326), 3857))"""
        )
        conn.commit()
        schema.upgrade(empty_dsn)
        with connect(conn) as db:
            conn.execute("SELECT conflictdb.create_scene('s')")
            conn.commit()
            db.scene("s").attach("area", "public.zone", {"key": "id", "footprint": "ST_Force2D(shape)"})
            db.scene("s").detect()
            conn.execute("DELETE FROM public.zone")
            conn.commit()
            assert _objects(conn) == 1
            db.scene("s").detect()
            assert _objects(conn) == 0


def _objects(conn: psycopg.Connection[Any]) -> int:
    with conn.transaction():
        row = conn.execute("SELECT objects FROM conflictdb.scenes").fetchone()
    assert row is not None
    return int(row[0])
