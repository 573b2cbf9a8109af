"""Every public routine as each role that may call it: none lacks a right, and none makes another role wait.

The table in docs/explanation/waits.md says who can make whom wait.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import psycopg
import pytest
import shapely
from databases import TestServer
from psycopg import sql

from conflictdb import Area, Scene, connect, store
from conflictdb.jobs import detect, follow_attached

Conn = psycopg.Connection[Any]

#: Longest wait for a lock, seconds. Whatever takes longer waits for the other session, which never ends.
WATCH_S = 1.0
AREA = "'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))'"
PATH = "conflictdb.track_path('SRID=4326;LINESTRING(0 0, 1 1)', '{2026-03-01Z,2026-03-02Z}')"
OUTLINE = "conflictdb.rectangle_outline(9, 9, 5, 5)"
PLAN = """[{"key": "new", "path": "LINESTRING(70 0, 71 0)", "times": ["2026-03-01 06:30Z", "2026-03-01 07:30Z"],
            "outline": "POLYGON((-5 -5, 5 -5, 5 5, -5 5, -5 -5))"}]"""
MAP = '{"key": "id", "footprint": "shape"}'
FEATURES = """[{"type": "Feature", "version": 1, "id": "new", "properties": {},
                "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}}]"""
VOYAGE_MAP = {
    "key": "voyage",
    "position": "public.ST_SetSRID(public.ST_MakePoint(lon, lat), 4326)",
    "time": "at",
    "order": "n",
    **dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), "100"),
}
FIXES = """
CREATE TABLE {schema}.fix (voyage text, n integer, at timestamptz, lon float, lat float);
INSERT INTO {schema}.fix VALUES
    ('E', 1, '2026-03-01 05:00Z', 30, 0), ('E', 2, '2026-03-01 06:00Z', 30.2, 0),
    ('N', 1, '2026-03-01 05:00Z', 30.1, -0.1), ('N', 2, '2026-03-01 06:00Z', 30.1, 0.1);
CREATE TABLE {schema}.ops (id integer, shape public.geometry);
INSERT INTO {schema}.ops VALUES (7, 'SRID=4326;POLYGON((50 0, 51 0, 51 1, 50 1, 50 0))');
"""
# Each public routine, called as the owner of scene {s} with branch {b} and own schema {schema}: what needs no other
# calls first. Statements in one text follow each other.
READS = {
    "approaches_of": "SELECT * FROM conflictdb.approaches_of('{s}', 'A')",
    "branch_conflicts": "SELECT * FROM conflictdb.branch_conflicts('{b}')",
    "branch_objects": "SELECT * FROM conflictdb.branch_objects('{b}')",
    "candidates": "SELECT * FROM conflictdb.candidates('{s}')",
    "circle": "SELECT conflictdb.circle('{s}', 1, 1, 500)",
    "conflict_history": "SELECT * FROM conflictdb.conflict_history('{s}', 'A', 'B')",
    "conflicts_at": "SELECT * FROM conflictdb.conflicts_at('{s}', now())",
    "conflicts_known_at": "SELECT * FROM conflictdb.conflicts_known_at('{s}', now())",
    "conflicts_of": "SELECT * FROM conflictdb.conflicts_of('{s}', 'A')",
    "conflicts_of_class": "SELECT * FROM conflictdb.conflicts_of_class('{s}', 'tug')",
    "conflicts_within": f"SELECT * FROM conflictdb.conflicts_within('{{s}}', {AREA}, NULL)",
    "explain_conflict": "SELECT conflictdb.explain_conflict('{s}', 'A', 'B')",
    "explain_conflict_text": "SELECT conflictdb.explain_conflict_text('{s}', 'A', 'B')",
    "haven_at": "SELECT conflictdb.haven_at('{s}', 'T', '2026-03-01 12:00Z')",
    "havens": "SELECT * FROM conflictdb.havens('{s}', '2026-03-01', '2026-03-02', '6 h')",
    "heights_at": "SELECT conflictdb.heights_at('{s}', 'T', '2026-03-01 12:00Z')",
    "instant": "SELECT conflictdb.instant('2026-03-01T12:00:00Z')",
    "list_objects": "SELECT * FROM conflictdb.list_objects('{s}')",
    "probe": "SELECT * FROM conflictdb.probe('{s}', 'SRID=4326;POINT(0.7 0.5)')",
    "proposal_changes": "SELECT conflictdb.proposal_changes({p})",
    "proposal_statements": "SELECT * FROM conflictdb.proposal_statements({p})",
    "rectangle_outline": f"SELECT {OUTLINE}",
    "request_delays": "SELECT conflictdb.request_delays('{s}', 'T', '10 min', NULL)",
    "request_plans_probe": f"SELECT conflictdb.request_plans_probe('{{s}}', '{FEATURES}')",
    "request_probe": f"SELECT conflictdb.request_probe('{{s}}', {AREA})",
    "request_track_probe": f"SELECT conflictdb.request_track_probe('{{s}}', {PATH}, {OUTLINE})",
    "tile_areas": """SELECT conflictdb.tile_areas(0, 0, 0, '{"scene": "{s}"}')""",
    "tile_conflicts": """SELECT conflictdb.tile_conflicts(0, 0, 0, '{"scene": "{s}"}')""",
    "tile_havens": """SELECT conflictdb.tile_havens(0, 0, 0, '{"scene": "{s}", "at": "2026-03-01T12:00:00Z"}')""",
    "tile_tracks": """SELECT conflictdb.tile_tracks(0, 0, 0, '{"scene": "{s}"}')""",
    "track_path": f"SELECT {PATH}",
    "wait_for_delays": "SELECT * FROM conflictdb.wait_for_delays({d}, '1 ms')",
    "wait_for_plans_probe": "SELECT * FROM conflictdb.wait_for_plans_probe({r}, '1 ms')",
    "wait_for_probe": "SELECT * FROM conflictdb.wait_for_probe({r}, '1 ms')",
    "wait_until_current": "SELECT conflictdb.wait_until_current('{s}', '1 ms')",
}
WRITES = {
    "acknowledge": "SELECT conflictdb.acknowledge('{s}', 'A', 'B', 'seen')",
    "unacknowledge": "SELECT conflictdb.acknowledge('{s}', 'A', 'B', 'seen');"
    "SELECT conflictdb.unacknowledge('{s}', 'A', 'B')",
    "wait_for_admission": "SELECT * FROM conflictdb.wait_for_admission(0, '1 ms')",
    "admit": f"SELECT * FROM conflictdb.admit('{{s}}', '{PLAN}')",
    "apply_proposal": "SELECT conflictdb.apply_proposal({p}, true)",
    "undo_proposal": "SELECT conflictdb.apply_proposal({p}, true); SELECT conflictdb.undo_proposal({p}, true)",
    "attach": f"SELECT conflictdb.attach('{{s}}', 'area', '{{schema}}.ops', '{MAP}')",
    "preview_attachment": f"SELECT * FROM conflictdb.preview_attachment('{{s}}', 'area', '{{schema}}.ops', '{MAP}')",
    "preview_reattachment": "SELECT * FROM conflictdb.preview_reattachment('{s}', '{schema}.fix')",
    "reattach": "SELECT conflictdb.reattach('{s}', '{schema}.fix')",
    "follow_attached": "SELECT * FROM conflictdb.follow_attached('{s}')",
    "put_rule": "SELECT conflictdb.put_rule('{s}', 'ferry', 'tug', 500)",
    "remove_rule": "SELECT conflictdb.remove_rule('{s}', 'ferry', 'tug')",
    "put_area": f"SELECT conflictdb.put_area('{{s}}', 'X', {AREA});SELECT conflictdb.put_area('{{b}}', 'Y', {AREA});"
    f"SELECT conflictdb.put_area('{{b}}', 'A', {AREA})",
    "put_track": f"SELECT conflictdb.put_track('{{s}}', 'V', {PATH}, {OUTLINE})",
    "rename_object": "SELECT conflictdb.rename_object('{s}', 'B', 'B2')",
    "remove_object": "SELECT conflictdb.remove_object('{b}', 'B'); SELECT conflictdb.remove_object('{s}', 'A')",
    "request_detection": "SELECT conflictdb.request_detection('{s}'); SELECT conflictdb.request_detection('{s}', true)",
    "create_scene": "SELECT conflictdb.create_scene('{s}', p_separation_m => 5);"
    "SELECT conflictdb.create_scene('{s}_new')",
    "create_branch": "SELECT conflictdb.create_branch('{s}', '{s}_b2')",
    "copy_scene": "SELECT conflictdb.copy_scene('{s}', '{s}_copy')",
    "share_scene": "SELECT conflictdb.share_scene('{s}', 'public')",
    "unshare_scene": "SELECT conflictdb.unshare_scene('{s}', 'public')",
    "merge_branch": "SELECT conflictdb.create_branch('{s}', '{s}_b3');"
    f"SELECT conflictdb.put_area('{{s}}_b3', 'Z', {AREA}); SELECT conflictdb.merge_branch('{{s}}_b3')",
    "rename_scene": "SELECT conflictdb.rename_scene('{s}', '{s}_renamed')",
    "give_scene": "SELECT conflictdb.give_scene('{s}', current_user::text)",
    "drop_branch": "SELECT conflictdb.drop_branch('{b}')",
    "detach": "SELECT conflictdb.detach('{s}', '{schema}.fix')",
    "remove_scene": "SELECT conflictdb.detach('{s}', '{schema}.fix'); SELECT conflictdb.remove_scene('{s}')",
}
OF_WORKERS = {
    "prune_history": "SELECT conflictdb.prune_history('{s}', '0')",
    "seal_edits": "SELECT conflictdb.seal_edits()",
    "verify_edits": "SELECT * FROM conflictdb.verify_edits()",
}
OF_NOBODY = {"protect_scenes", "prune_edits", "set_limit"}
# A wait that ends without an answer, or conflicts that are not current.
ANSWERS = {"ZC013", "ZC014", "ZC015", "ZC018"}
# There is no such request.
ANSWERS_OF = {"wait_for_admission": {"ZC011"}}
# A reader sees no branches of others.
ANSWERS_OF_READERS = {"branch_conflicts": {"ZC010"}, "branch_objects": {"ZC010"}}


def filled(statement: str, values: dict[str, object]) -> str:
    """Fill names and numbers in; other braces stay."""
    for name, value in values.items():
        statement = statement.replace(f"{{{name}}}", str(value))
    return statement


@dataclass(frozen=True)
class Stage:
    """A database with protected scenes. alice owns `hers`, which bob, an editor, and carol, a reader, may read."""

    dsn: str
    roles: dict[str, str]
    values: dict[str, dict[str, object]]

    def filled(self, statement: str, who: str) -> str:
        return filled(statement, self.values[who])


@contextmanager
def acting(dsn: str, role: str) -> Iterator[Conn]:
    """Connect as a role: temporary tables belong to one."""
    with psycopg.connect(dsn) as conn:
        conn.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
        conn.commit()
        yield conn
        conn.rollback()


def number(conn: Conn, statement: str) -> int:
    row = conn.execute(statement.encode()).fetchone()
    assert row is not None
    return int(row[0])


def furnished(dsn: str, roles: dict[str, str], who: str, scene: str) -> dict[str, object]:
    """Give a role a scene with a branch, an attached table, a proposal and requests; return their names and numbers."""
    schema = f"{who}s"
    values: dict[str, object] = {"s": scene, "b": f"{scene}_b", "schema": schema}
    with acting(dsn, roles[who]) as conn:
        conn.execute(filled(FIXES, values).encode())
        conn.execute(f"SELECT conflictdb.create_scene('{scene}', p_delays_within_s => 600)".encode())
        for key in "AB":
            conn.execute(f"SELECT conflictdb.put_area('{scene}', '{key}', {AREA}, p_class => 'tug')".encode())
        conn.execute(f"SELECT conflictdb.put_track('{scene}', 'T', {PATH}, {OUTLINE})".encode())
        conn.execute(f"SELECT conflictdb.put_rule('{scene}', 'ferry', 'area', 1)".encode())
        conn.commit()
        with connect(conn) as db:
            db.scene(scene).attach("track", f"{schema}.fix", VOYAGE_MAP)
        follow_attached.follow(conn, scene, again=False)
    with acting(dsn, roles["worker"]) as worker:
        detect.detect(worker, scene, jobs=1)
    with acting(dsn, roles[who]) as conn:
        with connect(conn) as db:
            values["p"] = db.scene(scene).resolve(keep=["N", "T"]).proposal_id
        conn.execute(f"SELECT conflictdb.create_branch('{scene}', '{scene}_b')".encode())
        conn.execute(f"SELECT conflictdb.put_area('{scene}_b', 'B', {AREA}, p_class => 'ferry')".encode())
        values["r"] = number(conn, f"SELECT conflictdb.request_probe('{scene}', {AREA})")
        values["d"] = number(conn, f"SELECT conflictdb.request_delays('{scene}', 'T', '10 min', NULL)")
        conn.commit()
    with acting(dsn, roles["worker"]) as worker:
        detect.detect(worker, f"{scene}_b", jobs=1)
    return values


@pytest.fixture(scope="module")
def stage(_server: TestServer, template: str, worker_id: str) -> Iterator[Stage]:
    name = f"{_server.prefix}_{worker_id}_waits"
    dsn = _server.clone(template, name)
    groups = {"alice": "editor", "bob": "editor", "carol": "reader", "worker": "worker"}
    roles = {who: f"{who}_of_{name}" for who in groups}
    with psycopg.connect(dsn) as conn:
        for who, group in groups.items():
            user = sql.Identifier(roles[who])
            conn.execute(sql.SQL("CREATE ROLE {} IN ROLE {}").format(user, sql.Identifier(f"conflictdb_{group}")))
            conn.execute(sql.SQL("CREATE SCHEMA {} AUTHORIZATION {}").format(sql.Identifier(who + "s"), user))
        conn.execute("SELECT conflictdb.protect_scenes()")
        conn.commit()
        values = {
            "alice": furnished(dsn, roles, "alice", "hers"),
            "bob": furnished(dsn, roles, "bob", "his"),
            "worker": furnished(dsn, roles, "worker", "its"),
        }
        with acting(dsn, roles["alice"]) as alice:
            for who in ("bob", "carol"):
                alice.execute("SELECT conflictdb.share_scene('hers', %s)", [roles[who]])
            alice.commit()
        with acting(dsn, roles["bob"]) as bob:
            bob.execute("SELECT conflictdb.create_branch('hers', 'of_hers')")
            bob.execute(f"SELECT conflictdb.put_area('of_hers', 'B', {AREA})".encode())
            bob.commit()
        with acting(dsn, roles["carol"]) as carol:
            asked = {"r": number(carol, f"SELECT conflictdb.request_probe('hers', {AREA})")}
            asked["d"] = number(carol, "SELECT conflictdb.request_delays('hers', 'T', '10 min', NULL)")
            carol.commit()
        values["carol"] = {**values["alice"], **asked}
    yield Stage(dsn, roles, values)
    _server.drop(name)
    with psycopg.connect(_server.dsn, autocommit=True) as conn:
        for role in roles.values():
            conn.execute(sql.SQL("DROP ROLE {}").format(sql.Identifier(role)))


def test_every_public_routine_is_here(stage: Stage) -> None:
    """A new one needs a row above."""
    with psycopg.connect(stage.dsn) as conn:
        names = conn.execute(
            "SELECT DISTINCT proname FROM pg_proc WHERE pronamespace = 'conflictdb'::regnamespace"
        ).fetchall()
    assert {name for (name,) in names} == {*READS, *WRITES, *OF_WORKERS, *OF_NOBODY}


def calls(who: str) -> dict[str, str]:
    """Return the routines that the reference grants to a role."""
    return READS | (WRITES if who != "carol" else {}) | (OF_WORKERS if who == "worker" else {})


@pytest.mark.parametrize("who", ["carol", "bob", "worker"])
def test_each_role_lacks_no_right_for_what_it_may_call(stage: Stage, who: str) -> None:
    """Private routines and tables that a routine with the rights of its caller uses are granted, too."""
    failed = {}
    answers = ANSWERS_OF | (ANSWERS_OF_READERS if who == "carol" else {})
    with acting(stage.dsn, stage.roles[who]) as conn:
        for name, statement in calls(who).items():
            with conn.transaction(force_rollback=True):
                try:
                    conn.execute(stage.filled(statement, who).encode())
                except psycopg.Error as error:
                    if error.sqlstate not in ANSWERS | answers.get(name, set()):
                        failed[name] = str(error)
    assert failed == {}


def held(conn: Conn, stage: Stage, who: str) -> list[str]:
    """Call every routine of a role, on its own and on hers, in the open transaction; return those that succeeded."""
    begun = []
    conn.execute("SELECT 1")
    own = stage.values.get(who, stage.values["alice"])
    theirs = {**own, "s": "hers", "b": "of_hers"}
    for values in (own, theirs):
        for name, statement in calls(who).items():
            if who == "carol" and values is theirs:
                continue
            if name in ("detach", "remove_scene", "rename_scene") and values is own:
                continue  # at the end
            if name.startswith("wait"):
                continue
            try:
                with conn.transaction():
                    conn.execute(filled(statement, values).encode())
                begun.append(f"{name} of {values['s']}")
            except psycopg.Error:
                pass
    if who == "bob":
        conn.execute("SELECT conflictdb.detach('his', 'bobs.ops')")
        for name in ("rename_scene", "detach", "remove_scene"):
            with conn.transaction(force_rollback=name != "remove_scene"):
                conn.execute(stage.filled(WRITES[name], who).encode())
            begun.append(name)
    return begun


WORK = {
    "put_area": f"SELECT conflictdb.put_area('hers', 'X', {AREA}), conflictdb.put_area('hers', 'Y', {AREA}), "
    f"conflictdb.put_area('hers', 'B', {AREA})",
    "put_track": f"SELECT conflictdb.put_track('hers', 'V', {PATH}, {OUTLINE})",
    "remove_object": "SELECT conflictdb.remove_object('hers', 'A')",
    "rename_object": "SELECT conflictdb.rename_object('hers', 'B', 'B3')",
    "settings": "SELECT conflictdb.create_scene('hers', p_separation_m => 7)",
    "put_rule": "SELECT conflictdb.put_rule('hers', 'ferry', 'tug', 700)",
    "remove_rule": "SELECT conflictdb.remove_rule('hers', 'ferry', 'area')",
    "admit": filled(WRITES["admit"], {"s": "hers"}),
    "acknowledge": "SELECT conflictdb.acknowledge('hers', 'A', 'B', 'mine')",
    "request_probe": f"SELECT conflictdb.request_probe('hers', {AREA})",
    "request_detection": "SELECT conflictdb.request_detection('hers', true)",
    "create_branch": "SELECT conflictdb.create_branch('hers', 'another')",
    "merge_branch": "SELECT conflictdb.merge_branch('hers_b')",
    "copy_scene": "SELECT conflictdb.copy_scene('hers', 'another')",
    "apply_proposal": "SELECT conflictdb.apply_proposal({p}, true)",
    "share_scene": "SELECT conflictdb.share_scene('hers', 'public')",
    "give_scene": "SELECT conflictdb.give_scene('hers', current_user::text)",
    "rename_scene": "SELECT conflictdb.rename_scene('hers', 'hers_2')",
    "follow_attached": "INSERT INTO alices.fix VALUES ('W', 1, '2026-03-01 05:00Z', 60, 0), "
    "('W', 2, '2026-03-01 06:00Z', 60, 1); SELECT * FROM conflictdb.follow_attached('hers')",
    "remove_scene": "SELECT conflictdb.detach('hers', 'alices.fix'); SELECT conflictdb.remove_scene('hers')",
}


@pytest.mark.parametrize("who", ["carol", "bob"])
def test_no_other_role_makes_the_owner_of_a_scene_wait(stage: Stage, who: str) -> None:
    """While a transaction of a reader, or of an editor of another scene, has called every routine and stays open."""
    with acting(stage.dsn, stage.roles[who]) as other:
        assert len(held(other, stage, who)) > 20
        waited = []
        with acting(stage.dsn, stage.roles["alice"]) as conn:
            conn.execute(f"SET lock_timeout = '{WATCH_S:g} s'".encode())
            conn.commit()
            for name, statement in WORK.items():
                try:
                    with conn.transaction(force_rollback=True):
                        conn.execute(stage.filled(statement, "alice").encode())
                except psycopg.errors.LockNotAvailable as error:
                    waited.append(f"{name}: {error}")
                except psycopg.DatabaseError as error:
                    if error.sqlstate != "ZC018":  # a load below has changed the scene since it was computed
                        raise
            try:
                loaded = [Area("L", shapely.MultiPolygon([shapely.box(2, 2, 3, 3)]))]
                store.replace_scene(conn, Scene("hers"), loaded, [], merge=True)
            except psycopg.errors.LockNotAvailable as error:
                waited.append(f"load: {error}")
            follow_attached.follow(conn, "hers", again=True)
        with acting(stage.dsn, stage.roles["worker"]) as conn:
            detect.detect(conn, "hers", jobs=1, lock_timeout_s=WATCH_S, full=True)
            detect.detect(conn, "hers_b", jobs=1, lock_timeout_s=WATCH_S)
        assert waited == []
        assert re.match(r"INTRANS", other.info.transaction_status.name)
        other.rollback()
