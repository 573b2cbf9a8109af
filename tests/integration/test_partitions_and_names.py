"""An attachment follows its table for years: partitions come and go, tables are renamed, maps change."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import psycopg
import pytest
from commands import runner

from conflictdb import connect, store
from conflictdb.client.database import Database
from conflictdb.errors import InvalidInput, LockTimeout, NotPermitted
from conflictdb.jobs import follow_attached

Conn = psycopg.Connection[Any]

MAP = {"key": "id", "footprint": "shape", "span": "tstzrange(on_day, on_day + interval '1 day')"}
# Areas 1 and 2 of a day overlap, so each day with both is a conflict.
DAYS = """
CREATE SCHEMA mission;
CREATE TABLE mission.day (id integer, on_day timestamptz, shape geometry, code text) PARTITION BY RANGE (on_day);
CREATE FUNCTION mission.add(p_day integer) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    v_day timestamptz := '2026-01-01Z'::timestamptz + p_day * interval '1 day';
BEGIN
    EXECUTE format('CREATE TABLE mission.day%s PARTITION OF mission.day FOR VALUES FROM (%L) TO (%L)', p_day, v_day,
                   v_day + interval '1 day');
    INSERT INTO mission.day SELECT 10 * p_day + i, v_day, ST_MakeEnvelope(8 + 0.1 * i, 57, 8.2 + 0.1 * i, 57.2, 4326),
                                   chr(96 + i) || p_day
        FROM generate_series(1, 2) i;
END
$$;
SELECT mission.add(1), mission.add(2);
"""


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with psycopg.connect(dsn) as conn:
        conn.execute(DAYS)
        conn.execute("SELECT conflictdb.create_scene('s')")
    with connect(dsn) as db:
        db.scene("s").attach("area", "mission.day", MAP)
        db.scene("s").detect()
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


def pairs(db: Database) -> list[str]:
    return ask(db, "SELECT a_key || ' ' || b_key FROM conflictdb.conflicts ORDER BY 1")


def triggers(db: Database, table: str) -> int:
    (number,) = ask(db, f"SELECT count(*) FROM pg_trigger WHERE tgrelid = '{table}'::regclass")
    return int(number)


def is_current(db: Database) -> bool:
    return db.scenes()[0].is_current


@pytest.mark.parametrize(
    "way",
    [
        "DROP TABLE mission.day1",
        "ALTER TABLE mission.day DETACH PARTITION mission.day1",
        "ALTER TABLE mission.day DETACH PARTITION mission.day1 CONCURRENTLY",
    ],
)
def test_a_partition_that_goes_takes_its_rows_along(db: Database, way: str) -> None:
    """At once the scene is not current; the next look of a worker finds it, and removes objects and triggers."""
    assert pairs(db) == ["11 12", "21 22"]
    assert store.waiting_scenes(db.connection) == {}
    with psycopg.connect(db.connection.info.dsn, password=db.connection.info.password, autocommit=True) as other:
        other.execute(way.encode())
    assert not is_current(db)
    assert list(store.waiting_scenes(db.connection)) == ["s"]
    assert store.scene_state(db.connection, "s").remark is not None
    db.scene("s").detect()
    assert is_current(db)
    assert pairs(db) == ["21 22"]
    if "DROP" not in way:
        assert triggers(db, "mission.day1") == 0
        # It comes again, as another object of the same key.
        do(
            db,
            "ALTER TABLE mission.day ATTACH PARTITION mission.day1 FOR VALUES FROM ('2026-01-02Z') TO ('2026-01-03Z')",
        )
        assert not is_current(db)
        db.scene("s").detect()
        assert is_current(db)
        assert pairs(db) == ["11 12", "21 22"]
        assert triggers(db, "mission.day1") == triggers(db, "mission.day2") == 5


def test_new_partitions_are_watched(db: Database) -> None:
    """Also partitions of partitions: the follower creates the triggers that are missing."""
    do(
        db,
        "SELECT mission.add(3)",
        "CREATE TABLE mission.later PARTITION OF mission.day FOR VALUES FROM ('2026-02-01Z') TO ('2026-03-01Z') "
        "PARTITION BY LIST (id)",
        "CREATE TABLE mission.later_7 PARTITION OF mission.later FOR VALUES IN (7)",
    )
    (one,) = db.attachments()
    assert "partitions or triggers changed" in str(one.remark)
    assert not is_current(db)
    db.scene("s").detect()
    assert is_current(db)
    assert pairs(db) == ["11 12", "21 22", "31 32"]
    # A statement that names the partition fires its triggers alone.
    do(
        db,
        "DELETE FROM mission.day3 WHERE id = 31",
        "INSERT INTO mission.later_7 SELECT 7, '2026-02-01Z', shape, 'x' FROM mission.day WHERE id = 21",
    )
    assert not is_current(db)
    db.scene("s").detect()
    assert pairs(db) == ["11 12", "21 22"]
    assert ask(db, "SELECT key FROM conflictdb.area ORDER BY key") == ["11", "12", "21", "22", "32", "7"]


def test_a_busy_partition_does_not_hold_up_the_others(db: Database) -> None:
    """Who writes it for long keeps its triggers from being made; other changes are followed, and its writers go on."""
    do(db, "SELECT mission.add(3)")
    with psycopg.connect(db.connection.info.dsn, password=db.connection.info.password) as writer:
        writer.execute("DELETE FROM mission.day3 WHERE id = 31")
        do(db, "DELETE FROM mission.day2 WHERE id = 21")
        db.scene("s").detect()
        assert pairs(db) == ["11 12", "31 32"], "statements that name the table are noted"
        assert not is_current(db)
        assert db.attachments()[0].error is None
        writer.execute("DELETE FROM mission.day3 WHERE id = 32")
    db.scene("s").detect()
    assert is_current(db)
    assert pairs(db) == ["11 12"]


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ('ALTER TABLE mission.day RENAME TO "Day of \'26"', 'mission."Day of \'26"'),
        ("CREATE SCHEMA archive; ALTER TABLE mission.day SET SCHEMA archive", "archive.day"),
        ("ALTER SCHEMA mission RENAME TO missions", "missions.day"),
    ],
)
def test_a_renamed_table_is_followed(db: Database, change: str, name: str) -> None:
    """Also if another table has its former name since."""
    (former,) = ask(db, "SELECT attachment_id FROM conflictdb.attachments")
    do(
        db,
        change,
        "CREATE SCHEMA IF NOT EXISTS mission",
        "CREATE TABLE mission.day (id integer, on_day timestamptz, shape geometry)",
        f"DELETE FROM {name} WHERE id = 11",
        "INSERT INTO mission.day SELECT 99, '2026-01-01Z', ST_MakeEnvelope(8, 57, 9, 58, 4326)",
    )
    assert not is_current(db)
    db.scene("s").detect()
    assert is_current(db)
    assert ask(db, "SELECT key FROM conflictdb.area ORDER BY key") == ["12", "21", "22"]
    assert ask(db, 'SELECT "table" FROM conflictdb.attachments') == [name]
    with pytest.raises(InvalidInput, match="day is not attached to it"):
        db.scene("s").detach("mission.day")
    # The name that is free again is another's.
    assert db.scene("s").attach("area", "mission.day", {**MAP, "key": "'x' || id"}) > former
    assert db.scene("s").detach(name) == 3


@pytest.mark.parametrize("again", ["CREATE TABLE", "CREATE VIEW"])
def test_a_table_that_was_made_again_is_reattached(db: Database, again: str) -> None:
    """Until then nothing is read, and the scene is not current; objects, conflicts and acknowledgements stay."""
    scene = db.scene("s")
    known = ask(db, "SELECT conflict_id FROM conflictdb.conflicts ORDER BY a_key")
    scene.acknowledge("11", "12", reason="known")
    do(
        db,
        "CREATE TABLE mission.kept AS SELECT * FROM mission.day",
        "DROP TABLE mission.day",
        f"{again} mission.day AS SELECT * FROM mission.kept WHERE id <> 22",
    )
    scene.follow()
    (one,) = db.attachments()
    assert "another one has its name" in str(one.remark)
    assert not is_current(db)
    assert ask(db, "SELECT count(*) FROM conflictdb.area") == [4]
    assert scene.reattach("mission.day") == one.attachment_id
    assert db.attachments()[0].has_triggers == (again == "CREATE TABLE")
    scene.detect()
    assert is_current(db)
    assert ask(db, "SELECT conflict_id, acknowledged_for FROM conflictdb.conflicts") == [(known[0], "known")]
    do(db, "DELETE FROM mission.kept", "DELETE FROM mission.day" if again == "CREATE TABLE" else "SELECT")
    if again == "CREATE VIEW":
        do(db, "UPDATE conflictdb.attachment SET compared_at = compared_at - interval '1 minute'")
    scene.detect()
    assert ask(db, "SELECT count(*) FROM conflictdb.area") == [0]


def test_a_table_that_is_gone_is_said_to_be(db: Database) -> None:
    do(db, "DROP TABLE mission.day")
    assert "no longer exists" in str(db.attachments()[0].remark)
    with pytest.raises(InvalidInput, match="no longer exists"):
        db.scene("s").reattach("mission.day")
    do(db, "CREATE TABLE mission.other (id integer, on_day timestamptz, shape geometry)")
    db.scene("s").reattach("mission.day", to="mission.other")
    db.scene("s").detect()
    assert is_current(db)
    assert ask(db, "SELECT count(*) FROM conflictdb.area") == [0]


@pytest.mark.parametrize(
    ("change", "changes", "keys"),
    [
        ("SELECT", {"name": "code"}, ["11", "12", "21", "22"]),
        ("SELECT", {"floor_m": "0", "ceiling_m": "id"}, ["11", "12", "21", "22"]),
        ("ALTER TABLE mission.day RENAME id TO nr", {"key": "nr"}, ["11", "12", "21", "22"]),
        ("SELECT", {"key": "'D' || id"}, ["D11", "D12", "D21", "D22"]),
        ("ALTER TABLE mission.day ADD again integer; UPDATE mission.day SET again = id", {"key": "again"},
         ["11", "12", "21", "22"]),
        ("SELECT", {"where": "id <> 21"}, ["11", "12", "22"]),
    ],
)  # fmt: skip
def test_another_map_keeps_objects_conflicts_and_acknowledgements(
    db: Database, change: str, changes: dict[str, str], keys: list[str]
) -> None:
    scene = db.scene("s")
    scene.acknowledge("11", "12", reason="known")
    ids = "SELECT area_id FROM conflictdb.area ORDER BY key"
    known, objects = ask(db, "SELECT conflict_id FROM conflictdb.conflicts WHERE a_key = '11'"), ask(db, ids)
    do(db, change)
    previewed = scene.preview_reattachment("day", changes)
    assert (len(previewed.objects), previewed.unmapped) == (len(keys), [])
    assert ask(db, ids) == objects
    scene.reattach("day", changes)
    scene.detect()
    assert is_current(db)
    assert ask(db, "SELECT key FROM conflictdb.area ORDER BY key") == keys
    assert set(ask(db, ids)) <= set(objects)
    kept = "SELECT conflict_id FROM conflictdb.conflicts WHERE acknowledged_for = 'known'"
    assert ask(db, kept) == known
    if "name" in changes:
        assert ask(db, "SELECT name FROM conflictdb.area ORDER BY name") == ["a1", "a2", "b1", "b2"]
        scene.reattach("day", {"name": None})
        scene.detect()
        assert ask(db, "SELECT count(name) FROM conflictdb.area") == [0]
    # Followed as before.
    do(db, "DELETE FROM mission.day WHERE code = 'b2'")
    scene.detect()
    assert is_current(db)
    assert len(ask(db, ids)) == len(keys) - 1
    assert triggers(db, "mission.day1") == 5


def test_keys_that_change_places_are_followed(db: Database) -> None:
    """Each object of the former key is another one's now, so these are inserted again."""
    do(
        db,
        "ALTER TABLE mission.day ADD turned integer",
        "UPDATE mission.day SET turned = CASE id WHEN 11 THEN 12 WHEN 12 THEN 21 WHEN 21 THEN 11 ELSE 22 END",
    )
    db.scene("s").reattach("day", {"key": "turned * (id / id)"})
    db.scene("s").detect()
    assert ask(db, "SELECT key || ' ' || lower(active_span)::date FROM conflictdb.area ORDER BY key") == [
        f"{key} 2026-01-0{day}" for key, day in ((11, 3), (12, 2), (21, 2), (22, 3))
    ]
    assert db.scene("s").unmapped() == []
    assert is_current(db)


def test_triggers_or_comparisons_may_change(db: Database) -> None:
    scene = db.scene("s")
    scene.reattach("day", every_s=5)
    (one,) = db.attachments()
    assert (one.has_triggers, one.every.total_seconds(), one.map) == (False, 5.0, MAP)
    assert triggers(db, "mission.day1") == triggers(db, "mission.day") == 0
    scene.reattach("day", every_s=0)
    (one,) = db.attachments()
    assert (one.has_triggers, one.every.total_seconds()) == (True, 3600.0)
    do(db, "ALTER TABLE mission.day1 DISABLE TRIGGER ALL")
    scene.detect()
    assert not is_current(db)
    scene.reattach("day")
    scene.detect()
    assert is_current(db)
    do(db, "DELETE FROM mission.day1 WHERE id = 11")
    assert not is_current(db)


def test_a_table_is_attached_twice_only_on_request(db: Database) -> None:
    """Then its attachments have numbers."""
    scene = db.scene("s")
    with pytest.raises(InvalidInput, match="is attached to scene 's' already, as attachment"):
        scene.attach("area", "mission.day", MAP)
    second = scene.attach("area", "mission.day", {**MAP, "key": "code", "where": "id < 20"}, again=True)
    scene.detect()
    assert ask(db, "SELECT key FROM conflictdb.area ORDER BY key") == ["11", "12", "21", "22", "a1", "b1"]
    with pytest.raises(InvalidInput, match=rf"is attached to it 2 times: give the number of one: \d+, {second}"):
        scene.reattach("mission.day", {"name": "code"})
    scene.reattach(str(second), {"name": "code"})
    scene.detect()
    assert ask(db, "SELECT name FROM conflictdb.area WHERE name IS NOT NULL ORDER BY name") == ["a1", "b1"]
    assert scene.detach(str(second)) == 2
    with psycopg.connect(db.connection.info.dsn, password=db.connection.info.password) as other:
        other.execute("SELECT conflictdb.create_scene('another')")
    db.scene("another").attach("area", "mission.day", MAP)


def test_who_waits_for_another_session_records_no_failure(db: Database) -> None:
    """A table that another session reads, or whose scene it loads, is no table that cannot be read."""
    scene = db.scene("s")
    do(db, "DELETE FROM mission.day WHERE id = 11")
    for lock in ("SELECT FROM conflictdb.attachment FOR UPDATE", "SELECT FROM conflictdb.scene FOR UPDATE"):
        with psycopg.connect(db.connection.info.dsn, password=db.connection.info.password) as other:
            other.execute(lock.encode())
            with store.waiting_at_most(db.connection, 0.05):
                if "attachment" in lock:
                    follow_attached.follow(db.connection, "s", again=False)  # as a worker: left to the other session
                with pytest.raises(LockTimeout):
                    scene.follow()
            other.rollback()
            assert db.attachments()[0].error is None
    with psycopg.connect(db.connection.info.dsn, password=db.connection.info.password) as other:
        other.execute("LOCK TABLE mission.day")
        follow_attached.follow(db.connection, "s", again=True)
        assert "another session has locked it" in str(db.attachments()[0].error)
    scene.detect()
    assert is_current(db)
    assert pairs(db) == ["21 22"]


# Rights.


@pytest.fixture
def roles(conn: Conn) -> Iterator[dict[str, str]]:
    """Return the names of two editors, each with a table, and of a reader; the first has attached its table."""
    names = {role: f"{role}_{conn.info.dbname}" for role in ("planner", "other", "reader")}
    for role, name in names.items():
        conn.execute(f"CREATE ROLE {name} NOLOGIN".encode())
        conn.execute(f"GRANT conflictdb_{'reader' if role == 'reader' else 'editor'} TO {name}".encode())
    for role in ("planner", "other"):
        conn.execute(f"CREATE SCHEMA of_{role} AUTHORIZATION {names[role]}".encode())
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.commit()
    for role in ("planner", "other"):
        with acting(conn, names[role]):
            conn.execute(
                f"CREATE TABLE of_{role}.ops AS SELECT 1 AS id, 'secret' AS secret, ST_MakeEnvelope(0, 0, 1, 1, 4326) "
                "AS shape".encode()
            )
            conn.execute(f"GRANT USAGE ON SCHEMA of_{role} TO PUBLIC; GRANT ALL ON of_{role}.ops TO PUBLIC".encode())
    with acting(conn, names["planner"]), connect(conn) as db:
        db.scene("s").attach("area", "of_planner.ops", {"key": "id", "footprint": "shape"})
    yield names
    conn.rollback()
    conn.execute("RESET ROLE")
    everybody = ", ".join(names.values())
    conn.execute(f"DROP OWNED BY {everybody} CASCADE; DROP ROLE {everybody}".encode())
    conn.commit()


@contextmanager
def acting(conn: Conn, role: str) -> Iterator[None]:
    """Work as a role, in transactions of its own."""
    conn.execute(f"SET ROLE {role}".encode())
    conn.commit()
    yield
    conn.commit()
    conn.execute("RESET ROLE")
    conn.commit()


@pytest.mark.parametrize("role", ["other", "reader", "superuser"])
def test_nobody_else_reattaches(conn: Conn, roles: dict[str, str], role: str) -> None:
    """Not even a superuser, whose sessions would then read another table as themselves."""
    before = conn.execute("SELECT * FROM conflictdb.attachment").fetchall()
    name = roles.get(role, str(conn.info.user))
    with acting(conn, name), connect(conn) as db:
        for to in (None, "of_other.ops"):
            with pytest.raises(NotPermitted, match=r"which attached the table|may not|permission denied"):
                db.scene("s").reattach("of_planner.ops", {"name": "'mine'"}, to=to)
            with pytest.raises(NotPermitted):
                db.scene("s").preview_reattachment("of_planner.ops", to=to)
    assert conn.execute("SELECT * FROM conflictdb.attachment").fetchall() == before


WITH_GIVEN = """
WITH given AS (SELECT attachment_id, 'of_other.ops'::regclass, false FROM conflictdb.attachment) {}
"""


@pytest.mark.parametrize(
    "statement",
    [
        'UPDATE conflictdb.attachment SET map = map || \'{"name": "secret"}\'',
        "UPDATE conflictdb.attachment SET table_name = 'other'",
        "UPDATE conflictdb.attachment SET identity_columns = '{}'",
        "UPDATE conflictdb.attachment SET identity_columns = '{secret}'",
        "UPDATE conflictdb.attachment SET compared_at = now()",
        "UPDATE conflictdb.attached_relation SET relation = 'of_other.ops'",
        "DELETE FROM conflictdb.attached_relation",
        "INSERT INTO conflictdb.attached_relation TABLE given",
    ],
)
def test_no_other_editor_changes_an_attachment(conn: Conn, roles: dict[str, str], statement: str) -> None:
    with acting(conn, roles["other"]):
        with pytest.raises(psycopg.errors.InsufficientPrivilege, match="alone, which attached the table"):
            conn.execute(WITH_GIVEN.format(statement).encode())
        conn.rollback()
        conn.execute("SET ROLE " + roles["other"])
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").follow()
        assert db.attachments()[0].error is None


def test_a_trigger_notes_no_other_columns_of_a_table_that_was_given_away(conn: Conn, roles: dict[str, str]) -> None:
    """Its triggers stay, with the columns that they had; the attaching role cannot add columns."""
    conn.execute(f"ALTER TABLE of_planner.ops OWNER TO {roles['other']}".encode())
    conn.commit()
    number = "SELECT attachment_id FROM conflictdb.attachment"
    with acting(conn, roles["planner"]):
        with pytest.raises(psycopg.Error, match="cannot be changed"):
            conn.execute("UPDATE conflictdb.attachment SET identity_columns = '{secret}'")
        conn.rollback()
        conn.execute("SET ROLE " + roles["planner"])
        # It may take the columns away, and with them the triggers.
        conn.execute("UPDATE conflictdb.attachment SET identity_columns = '{}'")
        conn.execute("UPDATE conflictdb.attachment SET identity_columns = '{secret}'")
        conn.execute(f"SELECT conflictdb_internal._create_note(({number}))".encode())
        with connect(conn) as db, pytest.raises(InvalidInput, match="does not own of_planner"):
            db.scene("s").reattach("of_planner.ops", {"key": "secret"})
    with acting(conn, roles["other"]):
        conn.execute("INSERT INTO of_planner.ops SELECT 2, 'hidden', shape FROM of_planner.ops")
    assert conn.execute(
        "SELECT count(*) FROM conflictdb.attached_change WHERE array_to_string(identities, '') ~ 'hidden|secret'"
    ).fetchone() == (0,)
    assert conn.execute("SELECT count(*) FROM pg_trigger WHERE tgrelid = 'of_planner.ops'::regclass").fetchone() == (0,)


def test_the_follower_makes_triggers_with_its_own_rights(conn: Conn, roles: dict[str, str]) -> None:
    """A partition of another owner gets none, and is not read."""
    planner, other = roles["planner"], roles["other"]
    with acting(conn, planner), connect(conn) as db:
        conn.execute("CREATE TABLE of_planner.parted (id integer, shape geometry) PARTITION BY LIST (id)")
        conn.execute("CREATE TABLE of_planner.part1 PARTITION OF of_planner.parted FOR VALUES IN (1)")
        db.scene("s").attach("area", "of_planner.parted", {"key": "'p' || id", "footprint": "shape"})
        db.scene("s").follow()
        conn.execute("CREATE TABLE of_planner.part2 PARTITION OF of_planner.parted FOR VALUES IN (2)")
    # The owner of the table, who needs no right to execute the function.
    conn.execute(f"ALTER TABLE of_planner.part2 OWNER TO {other}".encode())
    conn.commit()
    names = "SELECT tgname::text FROM pg_trigger WHERE tgrelid = 'of_planner.part2'::regclass"
    inherited = conn.execute(names.encode()).fetchall()
    with acting(conn, planner), connect(conn) as db:
        db.scene("s").follow()
        (one,) = (one for one in db.attachments() if one.table.endswith("parted"))
        assert f"role {planner} does not own of_planner.part2" in str(one.error)
        assert not db.scenes()[0].is_current
    assert conn.execute(names.encode()).fetchall() == inherited
    # A member of the owner may.
    conn.execute(f"GRANT {other} TO {planner}".encode())
    conn.commit()
    with acting(conn, planner), connect(conn) as db:
        db.scene("s").follow()
        assert all(one.error is None and one.remark is None for one in db.attachments())
    assert len(conn.execute(names.encode()).fetchall()) == 5


def test_an_attachment_is_given_away_with_its_function(conn: Conn, roles: dict[str, str]) -> None:
    """As after a restore without the role that attached the table: no object goes."""
    planner, other = roles["planner"], roles["other"]
    with acting(conn, planner), connect(conn) as db:
        db.scene("s").follow()
        (known,) = conn.execute("SELECT area_id FROM conflictdb.area").fetchall()
    (number,) = conn.execute("SELECT attachment_id FROM conflictdb.attachment").fetchall()[0]
    conn.execute(f"ALTER FUNCTION conflictdb_attached.rows_{number}(text[], text) OWNER TO {other}".encode())
    conn.execute(f"ALTER TABLE of_planner.ops OWNER TO {other}".encode())
    conn.execute("DISCARD TEMPORARY")
    conn.commit()
    with acting(conn, planner), connect(conn) as db, pytest.raises(NotPermitted, match="which attached the table"):
        db.scene("s").reattach("of_planner.ops")
    with acting(conn, other), connect(conn) as db:
        db.scene("s").reattach("of_planner.ops", to="of_other.ops")
        db.scene("s").follow()
        assert [(one.role, one.error, one.remark) for one in db.attachments()] == [(other, None, None)]
    assert conn.execute("SELECT area_id FROM conflictdb.area").fetchall() == [known]
    assert conn.execute("SELECT count(*) FROM pg_trigger WHERE tgrelid = 'of_planner.ops'::regclass").fetchone() == (0,)


# Joins.

KEYED = """
CREATE TABLE mission.keyed (
    nr bigint, code text, at timestamptz, uid uuid, sure boolean, share double precision, shape geometry);
INSERT INTO mission.keyed
SELECT i, nullif('c"' || i, 'c"2'), '2026-01-02 06:00Z', md5(i::text)::uuid, i = 1, nullif(i / 2.0, 1.5),
       ST_MakeEnvelope(8, 57, 9, 58, 4326)
FROM generate_series(1, 3) i;
UPDATE mission.keyed SET share = 'NaN' WHERE share IS NULL;
"""
# Each conflict with day1 or day2, by the whole identity on one side and by a number on the other.
JOINED = """
SELECT k.nr, d.id FROM conflictdb.conflicts c
JOIN mission.keyed k ON c.a_table = 'mission.keyed'
    AND c.a_row = to_jsonb(k) - 'shape' || jsonb_build_object('at', k.at::text)
JOIN mission.day d ON c.b_table = 'mission.day' AND c.b_row = jsonb_build_object('id', d.id) ORDER BY 1, 2
"""


def test_conflicts_name_the_rows_of_their_objects(db: Database) -> None:
    """Tables and rows join by columns of their own types; an object that comes from no table has nulls."""
    do(db, KEYED)
    key = "'0' || nr || coalesce(code, '') || at || uid || sure || share"
    db.scene("s").attach("area", "mission.keyed", {"key": key, "footprint": "shape", "start": "at"})
    do(db, "SELECT conflictdb.put_area('s', 'own', ST_MakeEnvelope(8, 57, 9, 58, 4326))")
    db.scene("s").detect()
    assert ask(db, JOINED) == [(nr, id_) for nr in (1, 2, 3) for id_ in (11, 12, 21, 22)]
    own = "SELECT DISTINCT a_table, b_table, b_row FROM conflictdb.conflicts_of('s', 'own') ORDER BY 1"
    assert ask(db, own) == [("mission.day", None, None), ("mission.keyed", None, None)]
    do(db, "ALTER TABLE mission.day RENAME TO days")
    assert len(ask(db, JOINED.replace("mission.day", "mission.days"))) == 12
    # Objects that an earlier release took over have it with the next comparison; nothing else changes.
    do(
        db,
        "UPDATE conflictdb.attached_object SET identity_json = NULL",
        "UPDATE conflictdb.attachment SET compared_at = NULL",
    )
    db.scene("s").follow()
    assert ask(db, "SELECT count(*) FROM conflictdb.change") == [0]
    assert len(ask(db, JOINED.replace("mission.day", "mission.days"))) == 12


def test_the_list_has_the_numbers_that_commands_take(
    db: Database, dsn: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table that is attached twice has no other name of its own."""
    db.scene("s").attach("area", "mission.day", {**MAP, "key": "'more ' || id"}, again=True)
    run = runner(dsn, capsys)
    header, *lines = (line.split() for line in run("admin", "attachments").out.splitlines()[:3])
    assert header[:3] == ["SCENE", "NUMBER", "TABLE"]
    first, second = ((line[1], line[2]) for line in lines)
    assert (first[1], second[1]) == ("mission.day", "mission.day")
    assert run("admin", "detach", "--scene", "s", "--table", second[0]).code == 0
    assert [str(one.attachment_id) for one in db.scene("s").attachments()] == [first[0]]
