"""Once scenes are protected, a role sees and changes its own scenes and those shared with it; workers see all.

One database for all tests: scene "hers" is alice's and has a row in every table; each test is rolled back.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import psycopg
import pytest
from commands import runner
from databases import TestServer
from psycopg import conninfo, sql

from conflictdb.cli.codes import DONE
from conflictdb.jobs import detect, follow_attached

Conn = psycopg.Connection[Any]

HERS = """
SELECT conflictdb.create_scene('hers', p_nearest_m => 50000, p_delays_within_s => 3600);
SELECT conflictdb.put_area('hers', 'A', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))');
SELECT conflictdb.put_area('hers', 'B', 'SRID=4326;POLYGON((0.5 0, 1.5 0, 1.5 1, 0.5 1, 0.5 0))');
SELECT conflictdb.put_area('hers', 'N', 'SRID=4326;POLYGON((1.6 0, 1.7 0, 1.7 1, 1.6 1, 1.6 0))');
SELECT conflictdb.put_track('hers', 'T', 'SRID=4326;LINESTRING M (-1 0.5 1772323200, 2 0.5 1772409600)',
                            conflictdb.rectangle_outline(9, 9, 5, 5));
SELECT conflictdb.put_rule('hers', 'ferry', 'area', 500);
CREATE TABLE alices.ops (id integer, shape public.geometry);
INSERT INTO alices.ops VALUES (1, 'SRID=4326;POLYGON((5 5, 6 5, 6 6, 5 5))'), (2, 'POINT(1 1)');
SELECT conflictdb.attach('hers', 'area', 'alices.ops', '{"key": "id", "footprint": "shape"}');
"""
# Rows that detections write; then rows that wait for the next detection.
LATER = """
SELECT conflictdb.acknowledge('hers', 'A', 'B', 'seen');
SELECT conflictdb.request_probe('hers', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))', p_key => 'A');
SELECT conflictdb_internal._begin_admission('hers', 1, '{}', NULL);
SELECT conflictdb_internal._put_proposal(s.scene_id, to_jsonb(b), 'total', 60, 60, true,
    '[{"key": "T", "times_us": [1772323260000000, 1772409660000000], "delay_s": 60, "speed": 1, "clears": ["A"],
       "passes": [], "text": "T 1 min later"}]', '[{"key": "U", "blocked_by": ["A"]}]')
FROM conflictdb.scene s, conflictdb_internal._proposal_basis(s.scene_id) b WHERE s.name = 'hers';
SELECT conflictdb.remove_object('hers', 'N');
SELECT conflictdb.create_branch('hers', 'her branch');
SELECT conflictdb.remove_object('her branch', 'B');
UPDATE alices.ops SET id = 3 WHERE id = 1;
INSERT INTO conflictdb.position (scene, key, instant, place)
    VALUES ('hers', 'T', '2026-03-01 12:00Z', 'SRID=4326;POINT(0 0.5)');
"""
LIVE = """
SELECT conflictdb_internal._put_live(s.scene_id, 0, '{T}', '{off}', '{NULL}', '{NULL}', '{9}', '{0}', '{0}', '{0}',
                                     '{NULL}', '{10}', '{NULL}', '{NULL}', '{1}', '{8}')
FROM conflictdb.scene s WHERE s.name = 'hers';
SELECT conflictdb_internal._put_alarms(s.scene_id, 0, '{T}', '{""}', '{may}', '{off}', '{NULL}', '{NULL}', '{NULL}',
                                       '{NULL}', '[]', '{}') FROM conflictdb.scene s WHERE s.name = 'hers';
"""
EVERYTHING = """
SELECT c.relname FROM pg_class c
WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND c.relkind IN ('r', 'p', 'v')
    AND NOT c.relispartition
    AND c.relname NOT IN ('alembic_version', 'edit_seal', 'position_look', 'upper_limit', 'limits',
                          'worker_stamp', '_my_role')
ORDER BY 1
"""
# Each function that takes the name of a scene, as another role might call it.
READS = [
    "SELECT count(*) FROM conflictdb.conflicts_at('hers', '2026-03-01 12:00Z')",
    "SELECT count(*) FROM conflictdb.conflicts_of('hers', 'A')",
    "SELECT count(*) FROM conflictdb.conflicts_within('hers', 'SRID=4326;POINT(0.7 0.5)', '(,)')",
    "SELECT count(*) FROM conflictdb.candidates('hers')",
    "SELECT count(*) FROM conflictdb.probe('hers', 'SRID=4326;POINT(0.7 0.5)')",
    "SELECT count(*) FROM conflictdb.havens('hers', '2026-03-01', '2026-03-02', '6 h')",
    "SELECT count(conflictdb.haven_at('hers', 'T', '2026-03-01 12:00Z'))",
    "SELECT count(*) FROM conflictdb.conflict_history('hers', 'A')",
    "SELECT count(*) FROM conflictdb.conflicts_known_at('hers', now())",
    "SELECT count(conflictdb.explain_conflict('hers', 'A', 'B'))",
    "SELECT count(conflictdb.explain_conflict_text('hers', 'A', 'B'))",
    """SELECT octet_length(conflictdb.tile_areas(0, 0, 0, '{"scene": "hers"}'))""",
    """SELECT octet_length(conflictdb.tile_tracks(0, 0, 0, '{"scene": "hers"}'))""",
    """SELECT octet_length(conflictdb.tile_conflicts(0, 0, 0, '{"scene": "hers"}'))""",
]
KEYS = "SELECT array_agg(o.key) FROM conflictdb.list_objects('hers') o"
READS_WITHOUT_ROWS = [
    "SELECT conflictdb.heights_at('hers', 'T', '2026-03-01 12:00Z')",
    "SELECT conflictdb.request_probe('hers', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))')",
    """SELECT conflictdb.request_track_probe('hers', 'SRID=4326;LINESTRING M (0 0 1772323200, 1 1 1772409600)',
                                             conflictdb.rectangle_outline(9, 9, 5, 5))""",
]
WRITES = [
    "SELECT conflictdb.create_scene('hers', p_tolerance_m => 3)",
    "SELECT conflictdb.put_area('hers', 'X', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))')",
    "SELECT conflictdb.put_area('hers', 'A', 'SRID=4326;POLYGON((0 0, 1 0, 1 2, 0 1, 0 0))')",
    """SELECT conflictdb.put_track('hers', 'X', 'SRID=4326;LINESTRING M (0 0 0, 1 1 3600)',
                                   conflictdb.rectangle_outline(9, 9, 5, 5))""",
    "SELECT conflictdb.remove_object('hers', 'A')",
    "SELECT conflictdb.request_detection('hers')",
    "SELECT conflictdb.request_detection('hers', true)",
    "SELECT conflictdb.acknowledge('hers', 'A', 'B', 'mine now')",
    "SELECT conflictdb.unacknowledge('hers', 'A', 'B')",
    "SELECT conflictdb.attach('hers', 'area', 'bobs.ops', '{\"key\": \"id\", \"footprint\": \"shape\"}')",
    "SELECT conflictdb.preview_attachment('hers', 'area', 'bobs.ops', '{\"key\": \"id\", \"footprint\": \"shape\"}')",
    "SELECT conflictdb.detach('hers', 'alices.ops')",
    "SELECT conflictdb.put_rule('hers', 'ferry', 'area', 1)",
    "SELECT conflictdb.remove_rule('hers', 'ferry', 'area')",
]
OF_THE_OWNER = [
    "SELECT conflictdb.share_scene('hers', {bob}, 'write')",
    "SELECT conflictdb.unshare_scene('hers', {bob})",
    "SELECT conflictdb.give_scene('hers', {bob})",
]
# Statements on the tables touch nothing; a statement that would add a row is refused.
STATEMENTS = [
    "UPDATE conflictdb.scene SET tolerance_m = 7 WHERE scene_id = {hers}",
    "DELETE FROM conflictdb.scene WHERE scene_id = {hers}",
    "UPDATE conflictdb.area SET floor_m = 7 WHERE scene_id = {hers}",
    "DELETE FROM conflictdb.area WHERE scene_id = {hers}",
    "DELETE FROM conflictdb.track",
    "DELETE FROM conflictdb.attachment",
    "DELETE FROM conflictdb.attached_object",
    "DELETE FROM conflictdb.attached_change",
    "UPDATE conflictdb.acknowledgement SET ended_at = now()",
    "DELETE FROM conflictdb.scene_share",
]
ADDITIONS = [
    """INSERT INTO conflictdb.area (scene_id, key, footprint)
       VALUES ({hers}, 'X', 'SRID=4326;MULTIPOLYGON(((0 0, 1 0, 1 1, 0 1, 0 0)))')""",
    "INSERT INTO conflictdb.change (scene_id, object_kind, object_id, version) VALUES ({hers}, 0, 1, 1)",
    "INSERT INTO conflictdb.scene_share (scene_id, role, may_write) VALUES ({hers}, {bob}, true)",
    "INSERT INTO conflictdb.attached_change (attachment_id) VALUES ({attachment})",
    """INSERT INTO conflictdb.attachment (scene_id, object_kind, table_schema, table_name, map, identity_columns,
                                          has_triggers, every)
       VALUES ({hers}, 0, 'a', 'b', '{{}}', '{{}}', false, '1 h')""",
    """INSERT INTO conflictdb.probe_request (scene_id, kind, plans)
       VALUES ({hers}, 'probe', '[{{"type": "Feature", "version": 1, "id": "X", "geometry": {{"type": "Polygon",
               "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}}}}]')""",
    "INSERT INTO conflictdb.scene (name, owner) VALUES ('new', {alice})",
    "INSERT INTO conflictdb.scene (name, owner) VALUES ('new', NULL)",
    "INSERT INTO conflictdb.branch_edit (scene_id, key) VALUES ({hers}, 'A')",
]


@dataclass(frozen=True)
class Stage:
    """A database with protected scenes, and how its roles are called."""

    dsn: str
    alice: str
    bob: str
    carol: str
    worker: str
    hers: int
    attachment: int

    def filled(self, statement: str) -> str:
        names = {name: sql.Literal(getattr(self, name)).as_string(None) for name in ("alice", "bob")}
        return statement.format(hers=self.hers, attachment=self.attachment, **names)


@pytest.fixture(scope="module")
def stage(_server: TestServer, template: str, worker_id: str) -> Iterator[Stage]:
    """alice and bob edit, carol reads; each is a role of its own."""
    name = f"{_server.prefix}_{worker_id}_protected"
    dsn = _server.clone(template, name)
    roles = {role: f"{role}_of_{name}" for role in ("alice", "bob", "carol", "worker")}
    with psycopg.connect(dsn, autocommit=True) as conn:
        for role, group in (("alice", "editor"), ("bob", "editor"), ("carol", "reader"), ("worker", "worker")):
            user = sql.Identifier(roles[role])
            conn.execute(sql.SQL("CREATE ROLE {} IN ROLE {}").format(user, sql.Identifier(f"conflictdb_{group}")))
            conn.execute(sql.SQL("CREATE SCHEMA {} AUTHORIZATION {}").format(sql.Identifier(role + "s"), user))
        conn.execute("SELECT conflictdb.protect_scenes()")
        with acting(conn, roles["alice"]):
            conn.execute(HERS.encode())
        with acting(conn, roles["bob"]):
            conn.execute("CREATE TABLE bobs.ops (id integer, shape public.geometry)")
            conn.execute("SELECT conflictdb.create_scene('his')")
        with acting(conn, roles["alice"]):
            follow_attached.follow(conn, "hers", again=False)
        with acting(conn, roles["worker"]):
            detect.detect(conn, "hers", jobs=1)
        with acting(conn, roles["alice"]):
            conn.execute(LATER.encode())
        conn.execute(LIVE.encode())
        with acting(conn, roles["worker"]), conn.transaction():
            (probe_id,) = one(conn, "SELECT max(probe_id) FROM conflictdb.probe_request")
            conn.execute(
                """INSERT INTO conflictdb.probe_reply
                       (probe_id, plan_key, object_kind, key, verdict, periods, time_error_s)
                   VALUES (%s, 'P', 0, 'B', 'conflict', '{(,)}', 0)""",
                [probe_id],
            )
        (hers,) = one(conn, "SELECT scene_id FROM conflictdb.scene WHERE name = 'hers'")
        (attachment,) = one(conn, "SELECT attachment_id FROM conflictdb.attachment")
        yield Stage(dsn, hers=hers, attachment=attachment, **roles)
    _server.drop(name)
    with psycopg.connect(_server.dsn, autocommit=True) as conn:
        for role in roles.values():
            conn.execute(sql.SQL("DROP ROLE {}").format(sql.Identifier(role)))


@pytest.fixture
def protected(stage: Stage) -> Iterator[Conn]:
    with psycopg.connect(stage.dsn) as conn:
        yield conn
        conn.rollback()


@contextmanager
def acting(conn: Conn, role: str) -> Iterator[None]:
    conn.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
    yield
    conn.execute("RESET ROLE")


def one(conn: Conn, query: str) -> tuple[Any, ...]:
    row = conn.execute(query.encode()).fetchone()
    assert row is not None
    return row


def qualified(relation: str) -> str:
    return f"conflictdb_internal.{relation}" if relation.startswith("_") else f"conflictdb.{relation}"


def count(conn: Conn, relation: str) -> int:
    return int(one(conn, f"SELECT count(*) FROM {qualified(relation)}")[0])


def refused(conn: Conn, statement: str, *states: str) -> str:
    with pytest.raises(psycopg.Error) as caught, conn.transaction():
        conn.execute(statement.encode())
    assert caught.value.sqlstate in states, caught.value
    return str(caught.value)


def share(conn: Conn, stage: Stage, role: str, access: str) -> None:
    with acting(conn, stage.alice):
        conn.execute("SELECT conflictdb.share_scene('hers', %s, %s)", [role, access])


def test_nobody_else_sees_a_row_of_anything(protected: Conn, stage: Stage) -> None:
    """Whatever there is: a table or view that is new and not thought of here fails this test."""
    names = [name for (name,) in protected.execute(EVERYTHING.encode())]
    assert len(names) > 30
    whole = {name: count(protected, name) for name in names if name != "_accessible"}
    assert [name for name, rows in whole.items() if rows == 0] == ["scene_share"]
    with acting(protected, stage.worker):
        assert {name: count(protected, name) for name in whole if name != "shares"} == {
            name: rows for name, rows in whole.items() if name != "shares"
        }
    # Edits outlive their scenes, for workers and administrators.
    outliving = """SELECT count(*), coalesce(sum(cardinality(e.keys)), 0)::int FROM conflictdb.edit e
                   WHERE e.scene_id NOT IN (SELECT s.scene_id FROM conflictdb.scene s)"""
    gone = dict(zip(("edit", "edits"), one(protected, outliving), strict=True))
    his = {"edit": 1, "edits": 1, "scene": 1, "scenes": 1, "_accessible": 1, "_layer": 1, "shares": 1}
    with acting(protected, stage.alice):
        assert {name: count(protected, name) for name in whole} == {
            name: rows - his.get(name, 0) - gone.get(name, 0) for name, rows in whole.items()
        }
    with acting(protected, stage.bob):
        assert {name: count(protected, name) for name in names} == {name: his.get(name, 0) for name in names}
    with acting(protected, stage.carol):
        assert {name: count(protected, name) for name in names} == dict.fromkeys(names, 0)


@pytest.mark.parametrize("role", ["bob", "carol"])
def test_nobody_else_asks_about_a_scene(protected: Conn, stage: Stage, role: str) -> None:
    with acting(protected, getattr(stage, role)):
        for statement in READS + READS_WITHOUT_ROWS:
            assert "hers" not in refused(protected, statement, "ZC010").split("known:")[1], statement


def test_nobody_else_changes_a_scene(protected: Conn, stage: Stage) -> None:
    before = [count(protected, name) for (name,) in protected.execute(EVERYTHING.encode())]
    with acting(protected, stage.bob):
        for statement in WRITES + OF_THE_OWNER:
            refused(protected, stage.filled(statement) if "{bob}" in statement else statement, "ZC010", "42501")
        for statement in STATEMENTS:
            assert protected.execute(stage.filled(statement).encode()).rowcount == 0, statement
        for statement in ADDITIONS:
            refused(protected, stage.filled(statement), "42501")
    assert before == [count(protected, name) for (name,) in protected.execute(EVERYTHING.encode())]


def test_who_it_is_shared_with_reads_and_who_may_write_changes_it(protected: Conn, stage: Stage) -> None:
    for role, access in ((stage.carol, "read"), (stage.bob, "read"), (stage.bob, "write")):
        share(protected, stage, role, access)
        with acting(protected, role):
            assert count(protected, "conflicts") > 0
            assert count(protected, "attached_object") > 0
            for statement in READS:
                assert one(protected, statement)[0] > 0, statement
            for statement in READS_WITHOUT_ROWS:
                protected.execute(statement.encode())
            for statement in [] if role == stage.carol else WRITES:
                if access == "read":
                    assert "lets role" in refused(protected, statement, "42501"), statement
                elif "detach" not in statement:  # the caller must own the table, too
                    with protected.transaction(force_rollback=True):
                        protected.execute(statement.encode())
            for statement in OF_THE_OWNER:
                refused(protected, stage.filled(statement), "42501")
            if role == stage.bob:
                assert (
                    protected.execute(f"DELETE FROM conflictdb.scene WHERE scene_id = {stage.hers}".encode()).rowcount
                    == 0
                )
    with acting(protected, stage.alice):
        assert one(protected, stage.filled(OF_THE_OWNER[1])) == (True,)
        assert one(protected, stage.filled(OF_THE_OWNER[1])) == (False,)
    with acting(protected, stage.bob):
        assert count(protected, "conflicts") == 0


def test_reader_of_a_scene_branches_it_and_only_its_changer_merges(protected: Conn, stage: Stage) -> None:
    """A branch of another's scene belongs to its maker, and shows nothing to those who may not read the scene."""
    branch = "SELECT conflictdb.create_branch('hers', 'bobs')"
    with acting(protected, stage.bob):
        refused(protected, branch, "ZC010")
        refused(
            protected, f"INSERT INTO conflictdb.scene (name, parent_scene_id) VALUES ('spy', {stage.hers})", "ZC020"
        )
    share(protected, stage, stage.bob, "read")
    objects, conflicts = "SELECT count(*) FROM conflictdb.list_objects('bobs')", "conflicts WHERE scene = 'bobs'"
    with acting(protected, stage.bob):
        protected.execute(branch.encode())
        assert one(protected, objects) == (len(set(one(protected, KEYS)[0])),)
        assert count(protected, conflicts) == count(protected, "conflicts WHERE scene = 'hers'") > 0
        assert one(protected, "SELECT conflictdb.remove_object('bobs', 'A')") == (True,)
        assert count(protected, conflicts) < count(protected, "conflicts WHERE scene = 'hers'")
        assert "lets role" in refused(protected, "SELECT conflictdb.merge_branch('bobs')", "42501")
        for statement in ("UPDATE conflictdb.branch_edit SET version = 1", "DELETE FROM conflictdb.branch_edit"):
            refused(protected, statement, "42501")
        fake = (
            "INSERT INTO conflictdb.branch_edit (scene_id, key, version) SELECT scene_id, 'B', 1 FROM conflictdb.scene"
        )
        refused(protected, fake, "42501")
    with acting(protected, stage.carol):
        refused(protected, objects, "ZC010")
    with acting(protected, stage.alice):
        protected.execute(stage.filled(OF_THE_OWNER[1]).encode())
        # It stays, and the owner of its parent sees and may drop it.
        assert count(protected, "scenes WHERE scene = 'bobs' AND branch_of = 'hers'") == 1
        with protected.transaction(force_rollback=True):
            protected.execute("SELECT conflictdb.drop_branch('bobs')")
            assert count(protected, "scenes WHERE scene = 'bobs'") == 0
    with acting(protected, stage.bob):
        refused(protected, objects, "ZC010")
        assert count(protected, conflicts) == count(protected, "area") == count(protected, "branch_edit") == 0
    share(protected, stage, stage.bob, "write")
    with acting(protected, stage.bob):
        assert one(protected, "SELECT conflictdb.merge_branch('bobs')") == (1,)
        assert "A" not in one(protected, KEYS)[0]


def test_a_role_has_few_branches_of_a_scene(protected: Conn, stage: Stage) -> None:
    """Each detection of the scene starts one of each of its branches."""
    share(protected, stage, stage.bob, "read")
    with acting(protected, stage.bob):
        for number in range(20):
            protected.execute("SELECT conflictdb.create_branch('hers', %s)", [f"b{number}"])
        assert "at most 20" in refused(protected, "SELECT conflictdb.create_branch('hers', 'more')", "ZC017")
    with acting(protected, stage.alice):
        protected.execute("SELECT conflictdb.create_branch('hers', 'more')")


def test_nobody_is_told_who_admits_elsewhere(protected: Conn, stage: Stage) -> None:
    """A scene that is none, and one that nobody has admitted to yet, have no holders."""
    with psycopg.connect(stage.dsn) as other, acting(other, stage.alice):
        other.execute("SELECT conflictdb_internal._begin_admission('hers', 1, '{}', NULL)")
        with acting(protected, stage.bob):
            his = one(protected, "SELECT scene_id FROM conflictdb.scene WHERE name = 'his'")[0]
            for scene in (-1, his):
                holders = f"SELECT * FROM conflictdb_internal._admission_holders({scene})"
                assert protected.execute(holders.encode()).fetchall() == []
        other.rollback()


def test_public_is_everybody_who_reads(protected: Conn, stage: Stage) -> None:
    share(protected, stage, "public", "read")
    for role in (stage.bob, stage.carol):
        with acting(protected, role):
            assert count(protected, "conflicts") > 0
            assert protected.execute("SELECT role, access FROM conflictdb.shares WHERE scene = 'hers'").fetchall() == [
                (stage.alice, "own"), ("public", "read"),
            ]  # fmt: skip


def test_a_role_stands_for_its_members(protected: Conn, stage: Stage) -> None:
    protected.execute(sql.SQL("GRANT {} TO {}").format(sql.Identifier(stage.alice), sql.Identifier(stage.bob)))
    with acting(protected, stage.bob):
        assert count(protected, "conflicts") > 0
        protected.execute("SELECT conflictdb.remove_object('hers', 'A')")


def test_a_scene_is_given_away(protected: Conn, stage: Stage) -> None:
    with acting(protected, stage.alice):
        protected.execute(stage.filled(OF_THE_OWNER[2]).encode())
        assert count(protected, "conflicts") == 0
        refused(protected, "SELECT conflictdb.give_scene('his', current_user)", "ZC010")
    with acting(protected, stage.bob):
        assert count(protected, "conflicts") > 0
        refused(protected, "SELECT conflictdb.give_scene('hers', 'no such role')", "ZC009")
        refused(protected, "UPDATE conflictdb.scene SET owner = NULL", "ZC009")


def test_a_name_that_is_taken_unseen_is_refused(protected: Conn, stage: Stage) -> None:
    with acting(protected, stage.bob):
        assert "may not read" in refused(protected, "SELECT conflictdb.create_scene('hers')", "42501")


def test_only_the_owner_of_the_schema_protects(protected: Conn, stage: Stage) -> None:
    for role in (stage.alice, stage.worker):
        with acting(protected, role):
            refused(protected, "SELECT conflictdb.protect_scenes(false)", "42501")
    protected.execute("SELECT conflictdb.protect_scenes(false)")
    with acting(protected, stage.carol):
        assert count(protected, "conflicts") > 0


def test_notifications_name_nothing(protected: Conn, stage: Stage) -> None:
    """Any role that can connect can listen, whatever its other rights."""
    with psycopg.connect(stage.dsn, autocommit=True) as conn:
        conn.execute("LISTEN conflictdb; LISTEN conflictdb_event; LISTEN conflictdb_request")
        with acting(conn, stage.alice):
            conn.execute("SELECT conflictdb.create_scene('other')")
            conn.execute("SELECT conflictdb.put_area('other', 'A', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))')")
            conn.execute("SELECT conflictdb.put_area('other', 'B', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))')")
        with acting(conn, stage.worker):
            run = detect.detect(conn, "other", jobs=1)
        payloads = {n.channel: n.payload for n in conn.notifies(timeout=0.1)}
        with acting(conn, stage.alice):
            (event,) = one(conn, "SELECT event FROM conflictdb.conflict_events WHERE scene = 'other'")
            conn.execute("DELETE FROM conflictdb.scene WHERE name = 'other'")
    assert payloads["conflictdb_request"] == ""
    assert json.loads(payloads["conflictdb_event"]) == {
        "scene": None, "run": run.run_id, "kind": "opened", "events": [[event]],
    }  # fmt: skip
    assert json.loads(payloads["conflictdb"])["scene"] is None


def test_every_table_of_scenes_is_protected(protected: Conn) -> None:
    bare = """SELECT c.relname FROM pg_class c WHERE c.relnamespace = 'conflictdb'::regnamespace
                AND c.relkind IN ('r', 'p') AND NOT c.relrowsecurity ORDER BY 1"""
    assert [name for (name,) in protected.execute(bare.encode())] == [
        "alembic_version",
        "edit_seal",
        "position_look",
        "upper_limit",
        "worker_stamp",
    ]
    views = """SELECT c.relname FROM pg_class c
               WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND c.relkind = 'v'
                 AND NOT coalesce('security_invoker=true' = ANY (c.reloptions), false) ORDER BY 1"""
    assert [name for (name,) in protected.execute(views.encode())] == ["_accessible", "_my_role"]


def test_a_function_that_leaks_is_not_asked_about_hidden_rows(protected: Conn, stage: Stage) -> None:
    """The cheapest condition comes first, but not before the policies."""
    protected.execute("CREATE TABLE bobs.caught (what text)")
    protected.execute("GRANT INSERT ON bobs.caught TO PUBLIC")
    with acting(protected, stage.bob):
        protected.execute(
            """CREATE FUNCTION bobs.leak(text) RETURNS boolean LANGUAGE plpgsql COST 0.0000001 AS
               $$ BEGIN INSERT INTO bobs.caught VALUES ($1); RETURN true; END $$"""
        )
        for relation, column in (
            ("conflicts", "a_key"),
            ("conflict", "a_key"),
            ("area", "key"),
            ("_accessible", "scene_id::text"),
        ):
            protected.execute(f"SELECT count(*) FROM {qualified(relation)} WHERE bobs.leak({column})".encode())
    (his,) = one(protected, "SELECT scene_id::text FROM conflictdb.scene WHERE name = 'his'")
    assert {what for (what,) in protected.execute("SELECT what FROM bobs.caught")} <= {his}


def test_shares_from_the_command_line(stage: Stage, capsys: pytest.CaptureFixture[str]) -> None:
    as_alice = conninfo.make_conninfo(stage.dsn, options=f"-c role={stage.alice}")
    run = runner(as_alice, capsys)
    assert "may write it" in run("admin", "share", stage.bob, "--scene", "hers", "--access", "write").out
    assert [row.split()[1] for row in run("admin", "share", "--scene", "hers").out.splitlines()[1:]] == ["own", "write"]
    assert run("admin", "share", stage.bob, "--scene", "hers", "--access", "none").out == "taken back\n"
    assert run("admin", "share", stage.bob, "--scene", "hers", "--access", "none").out == "was not shared with it\n"
    assert run("admin", "share", "no one", "--scene", "hers").code != DONE
    assert "permission denied" in run("admin", "protect", "--off").err


def test_scenes_without_protection_are_everybodys(conn: Conn, capsys: pytest.CaptureFixture[str]) -> None:
    """As before there were owners; sharing warns that it has no effect yet, protecting counts the scenes it hides."""
    conn.execute("SET ROLE conflictdb_editor; SELECT conflictdb.create_scene('s'); RESET ROLE")
    conn.execute("SELECT conflictdb.create_scene('old'); UPDATE conflictdb.scene SET owner = NULL WHERE name = 'old'")
    conn.commit()
    with acting(conn, "conflictdb_reader"):
        assert count(conn, "scenes") == 2
        refused(conn, "INSERT INTO conflictdb.scene_share VALUES (1, 'conflictdb_reader', true)", "42501")
    with acting(conn, "conflictdb_worker"):
        refused(conn, "UPDATE conflictdb.scene SET owner = current_user", "42501")
        conn.execute("SELECT conflictdb.put_area('old', 'A', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))')")
    conn.rollback()
    run = runner(conn.info.dsn, capsys)
    assert "scenes are not protected in this database" in run("admin", "share", "conflictdb_reader", "--scene", "s").err
    assert "1 of the scenes belong to no role yet" in run("admin", "protect").err
    with acting(conn, "conflictdb_reader"):
        assert count(conn, "scenes") == 1


def test_only_the_owner_says_how_long_history_is_kept(protected: Conn, stage: Stage) -> None:
    """A shorter time prunes it, which roles that it is shared with may not."""
    kept = "UPDATE conflictdb.scene SET history_kept = {} WHERE scene_id = {}"
    share(protected, stage, stage.bob, "write")
    with acting(protected, stage.bob):
        assert "owner of the scene" in refused(protected, kept.format("'0'", stage.hers), "42501")
        protected.execute(kept.format("history_kept, tolerance_m = 3", stage.hers).encode())
        protected.execute("UPDATE conflictdb.scene SET history_kept = '1 day' WHERE name = 'his'")
    for role in (stage.alice, stage.worker):
        with acting(protected, role):
            assert protected.execute(kept.format(f"'{len(role)} days'", stage.hers).encode()).rowcount == 1
