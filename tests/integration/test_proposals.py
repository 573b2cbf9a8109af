"""Proposals of a stored scene: all or nothing, undone exactly, and refused in one sentence if out of date."""

import contextlib
import json
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from commands import STRAIT, runner
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from patience import WAIT_S, until, until_blocked
from psycopg import conninfo, sql
from verdicts import by_pair, compared

from conflictdb import (
    Area,
    InvalidInput,
    NotPermitted,
    Scene,
    StoreError,
    Track,
    connect,
    detours,
    rectangle_outline_m,
    resolve,
    store,
)
from conflictdb.cli.codes import DONE, FAILED, INPUT_REFUSED, USAGE
from conflictdb.client.database import Database
from conflictdb.client.stored_scene import StoredScene
from conflictdb.memory.resolve import moved

T0_US = 1_780_300_800_000_000
PATHS = "SELECT key, ST_AsEWKB(path) FROM conflictdb.track ORDER BY key"


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with connect(dsn) as database:
        yield database


@pytest.fixture
def scene(db: Database) -> StoredScene:
    """A detected scene with conflicts between tracks."""
    workload = replace(LOW_LATITUDE, window=1.5, around_haven=(8.0, 20.0), around_area=(5.0, 15.0))
    settings, areas, tracks = plain_scene(workload, 3, 4, 14)
    store.replace_scene(db.connection, settings, areas, tracks, merge=False)
    stored = db.scene(settings.name)
    stored.detect()
    return stored


def ask(db: Database, query: str, *values: object) -> list[Any]:
    with db.connection.transaction():
        return db.connection.execute(query.encode(), values).fetchall()


def pairs(scene: StoredScene) -> set[tuple[str, str]]:
    return {(one.a_key, one.b_key) for one in scene.conflicts()}


def proposed(scene: StoredScene) -> int:
    found = scene.resolve(within_s=6 * 3600.0)
    assert found.moves
    assert found.proposal_id is not None
    return found.proposal_id


def stored_moves(proposal: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the moves of tracks as the view shows them: with the clock time in their texts alone."""
    moves: list[dict[str, Any]] = json.loads(json.dumps(proposal["moves"]))
    return [{name: value for name, value in one.items() if name not in {"departs_at"}} for one in moves]


def test_proposal_is_that_of_memory(db: Database, scene: StoredScene) -> None:
    """A stored scene has the proposal of its objects; the view shows it."""
    found = scene.resolve(within_s=6 * 3600.0)
    settings, areas, tracks = store.read_scene(db.connection, scene.name)
    assert replace(found, proposal_id=None) == resolve(tracks, areas, settings, within_s=6 * 3600.0)
    [(state, moves, left, objective_s)] = ask(
        db, "SELECT state, moves, left_as_planned, objective_s FROM conflictdb.proposals"
    )
    expected = found.as_json()
    assert state == "open"
    assert moves == stored_moves(expected)
    assert left == json.loads(json.dumps(expected["left"]))
    assert objective_s == found.objective_s


def test_applying_clears_and_undoing_restores(db: Database, scene: StoredScene) -> None:
    """A detection of everything finds what the proposal says; undoing gives each path its exact former bytes."""
    before, paths = pairs(scene), ask(db, PATHS)
    found = scene.resolve(within_s=6 * 3600.0)
    assert db.apply_proposal(found.proposal_id or 0) == len(found.moves)
    scene.detect()
    after = pairs(scene)
    scene.detect(full=True)
    assert pairs(scene) == after
    assert after < before
    gone = before - after
    for move in found.moves:
        assert set(move.clears) == {key for pair in gone if move.key in pair for key in pair} - {move.key}
    assert {one.key for one in found.left} == {key for pair in after for key in pair if key.startswith("T")}
    closed = [one for one in scene.conflict_events() if one.kind == "closed"]
    assert {(one.a_key, one.b_key) for one in closed} == gone
    assert {one.proposal_id for one in closed} == {found.proposal_id}
    assert db.undo_proposal(found.proposal_id or 0) == len(found.moves)
    assert ask(db, PATHS) == paths
    scene.detect()
    assert pairs(scene) == before
    again = [one for one in scene.conflict_events() if one.kind == "opened" and one.proposal_id is not None]
    assert {(one.a_key, one.b_key) for one in again} == gone
    # An event of another change is not of the proposal.
    key = next(iter(gone))[0]
    scene.delete_objects(key)
    scene.detect()
    assert scene.conflict_events()[-1].proposal_id is None


def cleared(db: Database, seed: int) -> int:
    """Clear a stored scene, detect it as a whole, compare all its pairs with the oracle; return how many went."""
    workload = replace(LOW_LATITUDE, window=1.5, around_haven=(8.0, 20.0), around_area=(5.0, 15.0))
    settings, areas, tracks = plain_scene(workload, seed, 3, 9)
    store.replace_scene(db.connection, settings, areas, tracks, merge=False)
    scene = db.scene(settings.name)
    scene.detect()
    before, found = pairs(scene), scene.resolve(within_s=6 * 3600.0)
    if found.moves:
        assert db.apply_proposal(found.proposal_id or 0) == len(found.moves)
    scene.detect(full=True)
    gone = before - pairs(scene)
    assert pairs(scene) <= before
    for move in found.moves:
        assert set(move.clears) == {key for pair in gone if move.key in pair for key in pair} - {move.key}
    assert {one.key for one in found.left} == {key for pair in pairs(scene) for key in pair if key.startswith("T")}
    settings, areas, tracks = store.read_scene(db.connection, scene.name)
    assert compared(settings, areas, tracks, by_pair(scene.conflicts())).wrong == []
    return len(gone)


def test_cleared_scenes_equal_brute_force(db: Database) -> None:
    """Each proposal clears the conflicts that it names and makes none, by a full detection and by the oracle."""
    assert sum(cleared(db, seed) for seed in range(2)) > 0


@pytest.mark.slow
def test_hundred_cleared_scenes_equal_brute_force(db: Database) -> None:
    """The same for a hundred scenes."""
    assert sum(cleared(db, seed) for seed in range(100)) > 50


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ("SELECT conflictdb.put_area({scene}, 'NEW', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))')", "area 'NEW'"),
        ("UPDATE conflictdb.track SET path = ST_Reverse(path) WHERE false", None),
        ("UPDATE conflictdb.track SET floor_m = 7 WHERE key = 'T3'", "track 'T3'"),
        ("SELECT conflictdb.remove_object({scene}, 'A0')", "objects that were removed"),
        ("SELECT conflictdb.create_scene({scene}, p_tolerance_m => 3)", "settings of the scene"),
        ("SELECT conflictdb.put_rule({scene}, 'ferry', null, 500)", "settings of the scene"),
        ("SELECT conflictdb.rename_object({scene}, 'T3', 'T99')", "track 'T99'"),
        ("UPDATE conflictdb.scene SET name = 'renamed'", None),
    ],
)
def test_changed_scene_is_refused_by_name(db: Database, scene: StoredScene, change: str, named: str | None) -> None:
    """Whatever changed since the proposal was computed is named, and nothing moves."""
    number = proposed(scene)
    ask(db, change.format(scene=f"'{scene.name}'") + (" RETURNING 1" if change.startswith("UPDATE") else ""))
    paths = ask(db, PATHS)
    if named is None:
        assert db.apply_proposal(number) > 0
        return
    with pytest.raises(InvalidInput, match="has changed since it was computed") as refused:
        db.apply_proposal(number)
    assert named in str(refused.value)
    assert ask(db, PATHS) == paths
    assert named in ask(db, "SELECT conflictdb.proposal_changes(%s)", number)[0][0]


def test_change_while_computing_is_refused(db: Database, scene: StoredScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene that changes between reading and storing gets no proposal."""
    put = store.put_proposal

    def late(*values: Any) -> int:
        ask(db, "UPDATE conflictdb.track SET floor_m = 7 WHERE key = 'T3' RETURNING 1")
        return put(*values)

    monkeypatch.setattr(store, "put_proposal", late)
    with pytest.raises(InvalidInput, match="track 'T3'"):
        scene.resolve()
    assert ask(db, "SELECT FROM conflictdb.proposals") == []


def test_applied_once_undone_once(db: Database, scene: StoredScene) -> None:
    number = proposed(scene)
    with pytest.raises(StoreError, match="was not applied"):
        db.undo_proposal(number)
    db.apply_proposal(number)
    with pytest.raises(StoreError, match="was applied at"):
        db.apply_proposal(number)
    db.undo_proposal(number)
    with pytest.raises(StoreError, match="was undone before"):
        db.undo_proposal(number)
    with pytest.raises(StoreError, match="was undone at"):
        db.apply_proposal(number)
    with pytest.raises(InvalidInput, match="proposal 999: id: is not known"):
        db.apply_proposal(999)


def test_undoing_refuses_tracks_that_changed(db: Database, scene: StoredScene) -> None:
    """Other objects may have changed, but not the tracks that it moved."""
    found = scene.resolve(within_s=6 * 3600.0)
    number, key = found.proposal_id or 0, found.moves[0].key
    db.apply_proposal(number)
    ask(db, "SELECT conflictdb.put_area(%s, 'NEW', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))')", scene.name)
    ask(db, "UPDATE conflictdb.track SET ceiling_m = 9000 WHERE key = %s RETURNING 1", key)
    paths = ask(db, PATHS)
    with pytest.raises(InvalidInput, match=f"has changed since it was applied: track '{key}'"):
        db.undo_proposal(number)
    assert ask(db, PATHS) == paths


def test_two_sessions_apply_one_after_the_other(db: Database, scene: StoredScene, dsn: str) -> None:
    """A session waits for the other and is then refused: by the same proposal, and by another one of the scene."""
    number, other = proposed(scene), proposed(scene)
    for second, message in ((number, "was applied at"), (other, "has changed since it was computed")):
        outcome: list[str] = []

        def apply(proposal: int = second, outcome: list[str] = outcome) -> None:
            with connect(dsn) as session:
                try:
                    outcome.append(str(session.apply_proposal(proposal)))
                except (StoreError, InvalidInput) as error:
                    outcome.append(str(error))

        with psycopg.connect(dsn) as first:
            if message == "was applied at":
                first.execute("SELECT conflictdb.apply_proposal(%s)", [number])
            else:
                ask(db, "SELECT conflictdb.undo_proposal(%s)", number)
                number = proposed(scene)
                other = proposed(scene)
                first.execute("SELECT conflictdb.apply_proposal(%s)", [number])
                apply.__defaults__ = (other, outcome)
            waiting = threading.Thread(target=apply)
            waiting.start()
            until_blocked(db.connection, first)
            first.commit()
            waiting.join()
        assert message in outcome[0]


def test_killed_session_moves_nothing(db: Database, scene: StoredScene, dsn: str) -> None:
    """A session that is killed before it commits leaves no track moved, and the proposal open."""
    number, paths = proposed(scene), ask(db, PATHS)
    for end in ("kill", "roll back"):
        first = psycopg.connect(dsn)
        first.execute("SELECT conflictdb.apply_proposal(%s)", [number])
        if end == "kill":
            ask(db, "SELECT pg_terminate_backend(%s)", first.info.backend_pid)
        first.close()
        assert ask(db, PATHS) == paths
        assert ask(db, "SELECT state FROM conflictdb.proposals") == [("open",)]
    assert db.apply_proposal(number) > 0


def test_failing_track_moves_none(db: Database, scene: StoredScene) -> None:
    """An error in the middle, of a trigger of a user, undoes all of it."""
    found = scene.resolve(within_s=6 * 3600.0)
    last = found.moves[-1].key
    with db.connection.transaction():
        db.connection.execute(
            f"""CREATE FUNCTION public.no() RETURNS trigger LANGUAGE plpgsql AS
                $$ BEGIN RAISE EXCEPTION 'not {last}'; END $$;
                CREATE TRIGGER no BEFORE UPDATE ON conflictdb.track FOR EACH ROW WHEN (OLD.key = '{last}')
                EXECUTE FUNCTION public.no()""".encode()
        )
    paths = ask(db, PATHS)
    with pytest.raises(StoreError, match=f"not {last}"):
        db.apply_proposal(found.proposal_id or 0)
    assert ask(db, PATHS) == paths
    assert ask(db, "SELECT state FROM conflictdb.proposals") == [("open",)]
    with db.connection.transaction():
        db.connection.execute("DROP FUNCTION public.no CASCADE")


def test_only_read_committed(db: Database, scene: StoredScene, dsn: str) -> None:
    """A transaction that sees an old state cannot know that nothing changed."""
    number = proposed(scene)
    with psycopg.connect(dsn) as conn:
        conn.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        with pytest.raises(psycopg.Error, match="must see what others change meanwhile: READ COMMITTED"):
            conn.execute("SELECT conflictdb.apply_proposal(%s)", [number])


def test_rights(db: Database, scene: StoredScene, dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Readers may not apply; other editors not in a protected scene; who did is recorded, and cannot be forged."""
    number, paths = proposed(scene), ask(db, PATHS)
    suffix = conninfo.conninfo_to_dict(dsn)["dbname"]
    with psycopg.connect(dsn, autocommit=True) as conn:
        for group in ("reader", "editor"):
            user, role = sql.Identifier(f"{group}_of_{suffix}"), sql.Identifier(f"conflictdb_{group}")
            conn.execute(sql.SQL("CREATE ROLE {} IN ROLE {}").format(user, role))
        try:
            run = runner(conninfo.make_conninfo(dsn, options=f"-c role=reader_of_{suffix}"), capsys)
            for words in (["apply", number], ["resolve", "--scene", scene.name]):
                done = run(*words)
                assert done.code == FAILED
                assert "GRANT conflictdb_editor" in done.err
            conn.execute("SELECT conflictdb.protect_scenes()")
            conn.execute("SELECT conflictdb.share_scene(%s, %s)", [scene.name, f"editor_of_{suffix}"])
            with connect(conninfo.make_conninfo(dsn, options=f"-c role=editor_of_{suffix}")) as other:
                with pytest.raises(NotPermitted, match="but not change it"):
                    other.apply_proposal(number)
                with pytest.raises(NotPermitted, match="but not change it"):
                    other.scene(scene.name).resolve()
            assert ask(db, PATHS) == paths
            conn.execute("SELECT conflictdb.share_scene(%s, %s, 'write')", [scene.name, f"editor_of_{suffix}"])
            with connect(conninfo.make_conninfo(dsn, options=f"-c role=editor_of_{suffix}")) as other:
                assert other.apply_proposal(number) > 0
                assert other.undo_proposal(number) > 0
                with pytest.raises(psycopg.errors.InsufficientPrivilege), other.connection.transaction():
                    other.connection.execute("UPDATE conflictdb.proposal SET applied_by = 'another'")
            names = "SELECT applied_by, undone_by FROM conflictdb.proposals WHERE proposal_id = %s"
            assert ask(db, names, number) == [(f"editor_of_{suffix}",) * 2]
            assert ask(db, PATHS) == paths
            conn.execute("SELECT conflictdb.unshare_scene(%s, %s)", [scene.name, f"editor_of_{suffix}"])
            with (
                connect(conninfo.make_conninfo(dsn, options=f"-c role=editor_of_{suffix}")) as other,
                pytest.raises(InvalidInput, match="is not known"),
            ):
                other.apply_proposal(number)
        finally:
            conn.execute("SELECT conflictdb.protect_scenes(false)")
            for group in ("reader", "editor"):
                conn.execute(sql.SQL("DROP OWNED BY {0}; DROP ROLE {0}").format(sql.Identifier(f"{group}_of_{suffix}")))


VOYAGES = """
CREATE SCHEMA mission;
CREATE TABLE mission.fix (voyage text, n integer, at timestamptz, lon float, lat float);
INSERT INTO mission.fix VALUES
    ('E', 1, '2026-03-01 05:00Z', 0, 0), ('E', 2, '2026-03-01 06:00Z', 0.2, 0),
    ('N', 1, '2026-03-01 05:00Z', 0.1, -0.1), ('N', 2, '2026-03-01 06:00Z', 0.1, 0.1);
SELECT conflictdb.create_scene('s');
"""
VOYAGE_MAP = {
    "key": "voyage",
    "position": "ST_SetSRID(ST_MakePoint(lon, lat), 4326)",
    "time": "at",
    "order": "n",
    **dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), "100"),
}


def test_attached_rows_belong_to_their_table(db: Database, dsn: str) -> None:
    """Unasked the answer is the statement to run; with `attached`, the role that attached the table runs it."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(VOYAGES.encode())
    scene = db.scene("s")
    scene.attach("track", "mission.fix", VOYAGE_MAP)
    scene.detect()
    assert pairs(scene) == {("E", "N")}
    times = ask(db, "SELECT at FROM mission.fix ORDER BY voyage, n")
    found = scene.resolve(keep=["N"])
    number = found.proposal_id or 0
    with pytest.raises(InvalidInput, match="moves track 'E' of an attached table") as refused:
        db.apply_proposal(number)
    [(key, _, statement)] = ask(db, f"SELECT * FROM conflictdb.proposal_statements({number})")
    assert key == "E"
    assert statement in str(refused.value)
    assert statement.startswith("UPDATE mission.fix AS t SET at = t.at + interval '")
    assert db.apply_proposal(number, attached=True) == 1
    scene.detect()
    assert pairs(scene) == set()
    assert db.undo_proposal(number, attached=True) == 1
    scene.detect()
    assert pairs(scene) == {("E", "N")}
    assert ask(db, "SELECT at FROM mission.fix ORDER BY voyage, n") == times
    assert [(one.kind, one.proposal_id) for one in scene.conflict_events()][-2:] == [
        ("closed", number),
        ("opened", number),
    ]


def test_attached_rows_that_changed_are_refused(db: Database, dsn: str) -> None:
    """Rows that changed are not shifted, whether a detection has read them or not."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(VOYAGES.encode())
    scene = db.scene("s")
    scene.attach("track", "mission.fix", VOYAGE_MAP)
    scene.detect()
    later = "UPDATE mission.fix SET at = at + interval '1 s' WHERE voyage = 'E' RETURNING 1"
    number = scene.resolve(keep=["N"]).proposal_id or 0
    ask(db, later)
    with pytest.raises(InvalidInput, match=r"rows of mission\.fix, which a detection has not read yet"):
        db.apply_proposal(number, attached=True)
    with pytest.raises(InvalidInput, match=r"rows of mission\.fix, which a detection has not read yet"):
        scene.resolve(keep=["N"])
    scene.detect()
    number = scene.resolve(keep=["N"]).proposal_id or 0
    db.apply_proposal(number, attached=True)
    assert db.undo_proposal(number, attached=True) == 1
    scene.detect()
    number = scene.resolve(keep=["N"]).proposal_id or 0
    db.apply_proposal(number, attached=True)
    scene.detect()
    ask(db, later)
    scene.detect()
    with pytest.raises(InvalidInput, match="has changed since it was applied: track 'E'"):
        db.undo_proposal(number, attached=True)


def test_edit_that_commits_during_apply_is_named(db: Database, scene: StoredScene, dsn: str) -> None:
    """Applying waits for a session that edits a moved track, and then moves nothing."""
    found = scene.resolve(within_s=6 * 3600.0)
    key, outcome = found.moves[-1].key, []

    def apply() -> None:
        with connect(dsn) as session:
            try:
                outcome.append(str(session.apply_proposal(found.proposal_id or 0)))
            except InvalidInput as error:
                outcome.append(str(error))

    with psycopg.connect(dsn) as editor:
        editor.execute("UPDATE conflictdb.track SET floor_m = 7 WHERE key = %s", [key])
        waiting = threading.Thread(target=apply)
        waiting.start()
        until_blocked(db.connection, editor)
        editor.commit()
        paths = ask(db, PATHS)
        waiting.join()
    assert f"has changed since it was computed: track '{key}'" in outcome[0]
    assert ask(db, PATHS) == paths


def test_object_that_is_added_during_apply_is_detected(db: Database, scene: StoredScene, dsn: str) -> None:
    """Applying waits for nobody who edits other objects: the next detection reports what comes of both."""
    found = scene.resolve(within_s=6 * 3600.0)
    number, moved_keys = found.proposal_id or 0, {one.key for one in found.moves}
    with psycopg.connect(dsn) as editor:
        editor.execute(
            """SELECT conflictdb.put_area(%s, 'NEW', o.shape)
               FROM (SELECT ST_SetSRID(ST_Expand(ST_Extent(t.path), 1)::geometry, 4326) AS shape
                     FROM conflictdb.track t) o""",
            [scene.name],
        )
        assert db.apply_proposal(number) == len(moved_keys)
        editor.commit()
    scene.detect()
    assert {("NEW", key) for key in moved_keys} <= pairs(scene)
    opened = [one for one in scene.conflict_events() if one.kind == "opened" and "NEW" in (one.a_key, one.b_key)]
    assert {one.b_key for one in opened} >= moved_keys
    assert db.undo_proposal(number) == len(moved_keys)


FIXES = "SELECT voyage, n, at FROM mission.fix ORDER BY voyage, n"


def voyages(db: Database, dsn: str, **more: Any) -> StoredScene:
    """A detected scene of two voyages in an attached table, which are in conflict."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(VOYAGES.encode())
    scene = db.scene("s")
    scene.attach("track", "mission.fix", VOYAGE_MAP, **more)
    scene.detect()
    return scene


@pytest.mark.parametrize("every_s", [None, 3600.0], ids=["triggers", "compared"])
def test_attached_rows_are_compared_before_they_move(db: Database, dsn: str, every_s: float | None) -> None:
    """Rows that no detection has read are named, also in a table whose changes no trigger notes."""
    scene = voyages(db, dsn, every_s=every_s)
    number = scene.resolve(keep=["N"]).proposal_id or 0
    for change in (
        "UPDATE mission.fix SET lon = lon + 0.01 WHERE voyage = 'E' AND n = 2 RETURNING 1",
        "INSERT INTO mission.fix VALUES ('E', 3, '2026-03-01 07:00Z', 0.4, 0) RETURNING 1",
    ):
        with contextlib.suppress(psycopg.Rollback), db.connection.transaction() as block:
            db.connection.execute(change.encode())
            with pytest.raises(InvalidInput, match=r"since it was computed: .*rows of .*mission\.fix"):
                db.apply_proposal(number, attached=True)
            raise psycopg.Rollback(block)
    assert db.apply_proposal(number, attached=True) == 1


def test_attached_rows_that_changed_since_are_not_undone(db: Database, dsn: str) -> None:
    """Undoing gives the planned times or refuses, before a detection has read the moved rows and after it."""
    scene = voyages(db, dsn)
    planned = ask(db, FIXES)
    for is_detected in (False, True):
        number = scene.resolve(keep=["N"]).proposal_id or 0
        db.apply_proposal(number, attached=True)
        if is_detected:
            scene.detect()
        applied = ask(db, FIXES)
        ask(db, "UPDATE mission.fix SET at = at + interval '1 s' WHERE voyage = 'E' RETURNING 1")
        edited = ask(db, FIXES)
        with pytest.raises(InvalidInput, match=r"has changed since it was applied: rows of track 'E' in mission\.fix"):
            db.undo_proposal(number, attached=True)
        assert ask(db, FIXES) == edited
        ask(db, "UPDATE mission.fix SET at = at - interval '1 s' WHERE voyage = 'E' RETURNING 1")
        assert ask(db, FIXES) == applied
        db.undo_proposal(number, attached=True)
        assert ask(db, FIXES) == planned
        scene.detect()


def test_attached_row_that_is_edited_during_apply_is_named(db: Database, dsn: str) -> None:
    """Applying waits for a session that edits a row which it moves, and then moves nothing."""
    number, outcome = voyages(db, dsn).resolve(keep=["N"]).proposal_id or 0, []

    def apply() -> None:
        with connect(dsn) as session:
            try:
                outcome.append(str(session.apply_proposal(number, attached=True)))
            except InvalidInput as error:
                outcome.append(str(error))

    with psycopg.connect(dsn) as editor:
        editor.execute("UPDATE mission.fix SET at = at + interval '7 s' WHERE voyage = 'E' AND n = 2")
        waiting = threading.Thread(target=apply)
        waiting.start()
        until_blocked(db.connection, editor)
        editor.commit()
        fixes = ask(db, FIXES)
        waiting.join()
    assert "has changed since it was computed: rows of track 'E' in mission.fix" in outcome[0]
    assert ask(db, FIXES) == fixes


# At the step whose number its session has as a setting, a statement waits for the test.
STEPS = """
CREATE SEQUENCE public.step;
CREATE FUNCTION public.stops() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER AS $$
BEGIN
    IF nextval('public.step') = current_setting('test.stop', true)::bigint THEN
        PERFORM pg_advisory_xact_lock(1);
    END IF;
    RETURN NEW;
END $$;
CREATE TRIGGER stops BEFORE UPDATE ON {table} FOR EACH ROW EXECUTE FUNCTION public.stops();
CREATE TRIGGER stops_after AFTER UPDATE ON {table} FOR EACH ROW EXECUTE FUNCTION public.stops();
CREATE TRIGGER stops BEFORE UPDATE ON conflictdb.proposal_move FOR EACH ROW EXECUTE FUNCTION public.stops();
CREATE TRIGGER stops BEFORE UPDATE ON conflictdb.proposal FOR EACH ROW EXECUTE FUNCTION public.stops();
"""


@pytest.mark.parametrize("is_attached", [False, True], ids=["tracks", "attached"])
def test_killed_at_any_step_moves_all_or_nothing(
    db: Database, dsn: str, request: pytest.FixtureRequest, is_attached: bool
) -> None:
    """Sessions that are terminated while they apply or undo, row after row, move nothing."""
    scene = voyages(db, dsn) if is_attached else request.getfixturevalue("scene")
    number = proposed(scene)
    table, rows = ("mission.fix", FIXES) if is_attached else ("conflictdb.track", PATHS)
    with db.connection.transaction():
        db.connection.execute(STEPS.format(table=table).encode())
    planned = ask(db, rows)
    with psycopg.connect(dsn, autocommit=True) as keeper:
        keeper.execute("SELECT pg_advisory_lock(1)")
        for question, before, after in (("apply", "open", "applied"), ("undo", "applied", "undone")):
            at_first, killed = ask(db, rows), 0
            while step_is_killed(keeper, dsn, f"SELECT conflictdb.{question}_proposal({number}, true)", killed + 1):
                assert ask(db, "SELECT state FROM conflictdb.proposals WHERE proposal_id = %s", number) == [(before,)]
                assert ask(db, rows) == at_first
                killed += 1
            assert killed > 2
            assert ask(db, "SELECT state FROM conflictdb.proposals WHERE proposal_id = %s", number) == [(after,)]
            assert ask(db, rows) != at_first
    assert ask(db, rows) == planned


def step_is_killed(keeper: psycopg.Connection[Any], dsn: str, statement: str, step: int) -> bool:
    """Run a statement in a session that is terminated at a step; return whether it came to that step."""
    keeper.execute("SELECT setval('public.step', 1, false)")
    blocked = "SELECT %s = ANY (pg_blocking_pids(%s))"
    with (
        ThreadPoolExecutor(1) as thread,
        contextlib.closing(psycopg.connect(dsn, autocommit=True, options=f"-c test.stop={step}")) as session,
    ):
        pids = [keeper.info.backend_pid, session.info.backend_pid]
        running = thread.submit(session.execute, statement.encode())
        until(lambda: running.done() or keeper.execute(blocked, pids).fetchone() == (True,))
        if running.done():
            running.result()
            return False
        keeper.execute("SELECT pg_terminate_backend(%s)", pids[1:])
        with pytest.raises(psycopg.OperationalError):
            running.result(WAIT_S)
    return True


def test_detours_are_applied_and_undone(db: Database, scene: StoredScene) -> None:
    """New waypoints are stored as verified; undoing removes them, to the last digit."""
    paths = ask(db, PATHS)
    found = scene.resolve(aside_m=80_000.0)
    ways = {one.key for one in found.moves if one.detour is not None}
    assert ways
    settings, areas, tracks = store.read_scene(db.connection, scene.name)
    assert replace(found, proposal_id=None) == resolve(tracks, areas, settings, aside_m=80_000.0)
    [(moves,)] = ask(db, "SELECT moves FROM conflictdb.proposals")
    assert moves == stored_moves(found.as_json())
    ask(db, "SELECT conflictdb.apply_proposal(%s)", found.proposal_id)
    moves_of = {one.key: one for one in found.moves}
    changed = {one.key: moved(settings, one, moves_of[one.key]) for one in tracks if one.key in moves_of}
    _, _, after = store.read_scene(db.connection, scene.name)
    for one in after:
        if one.key in changed:
            np.testing.assert_array_equal(one.times_us, changed[one.key].times_us)
            np.testing.assert_array_equal(one.positions_deg, changed[one.key].positions_deg)
    scene.detect()
    assert not any(ways & {one.a_key, one.b_key} for one in scene.conflicts())
    ask(db, "SELECT conflictdb.undo_proposal(%s)", found.proposal_id)
    assert ask(db, PATHS) == paths


def test_branch_of_a_proposal(db: Database, scene: StoredScene, dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A branch with the moves of a proposal has the conflicts that applying it leaves; then it has no difference."""
    found = scene.resolve(within_s=6 * 3600.0, aside_m=80_000.0)
    number = found.proposal_id or 0
    branch = scene.branch("clear", number)
    branch.detect()
    diff = branch.diff()
    assert {(one.key, one.change) for one in diff.objects} == {(one.key, "changed") for one in found.moves}
    assert {one.change for one in diff.conflicts} == {"gone"}
    cleared = {frozenset((one.key, other)) for one in found.moves for other in one.clears}
    assert {frozenset((one.a_key, one.b_key)) for one in diff.conflicts} == cleared
    left = pairs(branch)
    db.apply_proposal(number)
    scene.detect(), branch.detect()
    assert pairs(scene) == pairs(branch) == left
    assert branch.diff().objects == []
    with pytest.raises(InvalidInput, match="has changed since it was computed"):
        scene.branch("late", number)
    run = runner(dsn, capsys)
    assert "is not known" in run("branch", "create", "none", "--proposal", 99, "--scene", scene.name).err
    ask(db, "SELECT conflictdb.create_scene('other')")
    other = db.scene("other")
    with pytest.raises(InvalidInput, match="is not of scene 'other'"):
        other.branch("wrong", number)
    assert {one.scene.name for one in db.scenes()} == {scene.name, "clear", "other"}
    number = scene.resolve(keep=[one.key for one in found.moves], aside_m=80_000.0).proposal_id or 0
    assert "--proposal goes with create" in run("branch", "diff", "clear", "--proposal", number).err
    assert run("branch", "create", "again", "--proposal", number, "--scene", scene.name).code == DONE


def test_windows_move_with_their_plan(db: Database) -> None:
    """Applied, undone, and in a branch; the page and probes move them, too."""
    hour = 3_600_000_000
    windows = {"departure_window": [T0_US, T0_US + hour // 2], "arrival_window": [T0_US + 4 * hour, T0_US + 5 * hour]}
    ship = rectangle_outline_m(90.0, 60.0, 12.0, 12.0)
    limits = {name: [np.datetime64(one, "us") for one in both] for name, both in windows.items()}
    plan = Track("F", [(4.0, 57.0), (5.0, 57.0)], [T0_US, T0_US + 4 * hour], ship, tolerances=limits)
    berth = Area("Z", shapely.box(3.99, 56.99, 4.01, 57.01), None, T0_US + hour // 12, T0_US + hour // 6)
    store.replace_scene(db.connection, Scene("late"), [berth], [plan], merge=False)
    scene = db.scene("late")
    scene.detect()
    assert len(scene.conflicts()) == 1
    number = proposed(scene)
    branch = scene.branch("moved", number)
    db.apply_proposal(number)
    scene.detect(), branch.detect()
    assert scene.conflicts() == branch.conflicts() == []
    query = "SELECT ST_M(ST_StartPoint(path)), tolerances FROM conflictdb.track WHERE scene_id = 1"
    [(path, tolerances)] = ask(db, query)
    by_us = round(1e6 * path) - T0_US
    assert by_us != 0
    for name, both in windows.items():
        moved_us = [int(np.datetime64(one[:-1], "us").astype(int)) for one in tolerances[name]]
        assert moved_us == [one + by_us for one in both]
    found = scene.delays("F")[0].forbidden
    assert found
    for late_s in (found[0].from_s - 1.0, found[0].from_s + 1.0):
        by = timedelta(seconds=late_s)
        assert bool(scene.probe(scene.delayed("F", by))) == (found[0].from_s < late_s < found[0].to_s)
    db.undo_proposal(number)
    assert ask(db, "SELECT tolerances FROM conflictdb.track WHERE scene_id = 1") == [(plan.tolerances,)]
    scene.detect()
    assert len(scene.conflicts()) == 1


def test_stored_scene_has_the_detours_of_its_objects(db: Database, scene: StoredScene) -> None:
    settings, areas, tracks = store.read_scene(db.connection, scene.name)
    key = scene.resolve().left[0].key
    found = scene.detours(key, 80_000.0)
    assert [(one.leg, one.waypoints_deg) for one in found] == [
        (one.leg, one.waypoints_deg) for one in detours(tracks, areas, settings, key=key, most_m=80_000.0)
    ]


PAIR = """
SELECT conflictdb.create_scene('s');
SELECT conflictdb.put_track('s', k, ST_GeomFromEWKT(path), ST_MakeEnvelope(-100, -100, 100, 100),
                            p_class => c)
FROM (VALUES ('E', 'ferry', 'SRID=4326;LINESTRINGM(0 0 1780000000, 0.2 0 1780003600)'),
             ('N', 'tow', 'SRID=4326;LINESTRINGM(0.1 -0.1 1780000000, 0.1 0.1 1780003600)')) v (k, c, path);
"""


def test_rules_weights_and_levels_from_sql_to_the_command_line(
    db: Database, dsn: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A rule entered in SQL says who moves; weights and levels of the command line are those of Python."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(PAIR.encode())
    run = runner(dsn, capsys)

    def movers(*words: str) -> list[str]:
        done = run("resolve", "--scene", "s", "--format", "json", *words)
        assert done.code == DONE, done.err
        [(moves,)] = ask(db, "SELECT moves FROM conflictdb.proposals ORDER BY proposal_id DESC LIMIT 1")
        assert [one["key"] for one in moves] == [one["key"] for one in json.loads(done.out)["moves"]]
        return [one["key"] for one in moves]

    assert movers("--weight", "E=9") == ["N"]
    assert movers("--weight", "N=9", "--weight", "E=2") == ["E"]
    assert "; weighted delay in all" in run("resolve", "--scene", "s", "--weight", "N=9", "--weight", "E=2").out
    assert "; delay in all" in run("resolve", "--scene", "s", "--weight", "N=9").out
    assert "; weighted largest delay" in run("resolve", "--scene", "s", "--weight", "E=2", "--goal", "largest", "E").out
    assert movers("--level", "E=1") == ["N"]
    for yielding, key in (("a", "E"), ("b", "N")):
        ask(db, "SELECT conflictdb.put_rule('s', 'ferry', 'tow', p_yields => %s)", yielding)
        assert movers("--weight", f"{key}=9") == [key]
        assert [one.key for one in db.scene("s").resolve(weights={key: 9.0}).moves] == [key]
        assert movers("--level", f"{key}=1") != [key]
        assert movers("--keep", key) != [key]
    for words in ("E", "=1", "E=0.5", "E=x"):
        assert run("resolve", "--scene", "s", "--level", words).code == USAGE
    for words in ("E", "E=0", "E=-1", "E=nan"):
        assert run("resolve", "--scene", "s", "--weight", words).code == USAGE


def test_command_line(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    """`resolve` explains each move, `apply` and `apply --undo` change the scene; JSON has the same."""
    with connect(dsn) as database:
        database.load(STRAIT)
        database.scene("strait").detect()
    run = runner(dsn, capsys)
    done = run("resolve", "--scene", "strait", "--within", "8h")
    assert done.code == DONE
    assert "apply it: conflictdb apply 1" in done.out
    assert "clears" in done.out
    assert "SURVEY (Survey aircraft) departs 2026-06-01 11:56 UTC (51 min later): " in done.out
    assert "clear, no margin; delay in all 15 h 53 min, the least before rounding: 15 h 51 min 45 s" in done.out
    assert "tried: delays up to 8 h; these look further: --within (longer delays), --now (earlier" in done.out
    answer = json.loads(run("resolve", "--scene", "strait", "--within", "8h", "--format", "json").out)
    assert answer["proposal_id"] == 2
    assert {"key", "delay_s", "clears", "passes", "text"} <= answer["moves"][0].keys()
    assert {"moves", "left", "objective_s", "bound_s"} <= answer.keys()
    assert run("apply", 2).out.startswith(f"moved {len(answer['moves'])} plan")
    assert run("apply", 1).code == INPUT_REFUSED
    assert run("apply", 2, "--undo").out.startswith(f"restored {len(answer['moves'])} plan")
    aside = run("resolve", "--scene", "strait", "--within", "8h", "--aside", "40000")
    assert " via " in aside.out
    assert "keeps clear of CABLE" in aside.out
    assert run("resolve", "--scene", "strait", "--keep", "nobody").code == INPUT_REFUSED
    words = ("--within", "8h", "--margin", "5m", "--movable", "DIVING", "--tz", "Europe/Copenhagen")
    areas = run("resolve", "--scene", "strait", *words)
    assert (
        "DIVING (Diving on a wreck) is active from 2026-06-01 15:17 Europe/Copenhagen (4 h 17 min later)" in areas.out
    )
    assert "1 left, clear by 5 min; " in areas.out
    assert "apply it: " in areas.out
    nothing = run("resolve", "--scene", "strait", "--within", "1s", "SUB-1")
    assert nothing.out.splitlines()[-2] == "nothing found that may move"
    tried = nothing.out.splitlines()[-1]
    assert tried.startswith("tried: delays up to 1 s; these look further: --within (longer delays), --now (earlier ")
    assert tried.endswith(
        "--movable (other times of areas, with --aside other places), no KEY, no --keep (all may move)"
    )


def test_an_area_that_got_a_schedule_since_is_not_undone(db: Database) -> None:
    """Its times are not those that the proposal gave it."""
    put = "SELECT conflictdb.put_area('s', 'A', 'SRID=4326;POLYGON((0.4 -0.1, 0.6 -0.1, 0.6 0.1, 0.4 -0.1))', {})"
    ask(db, "SELECT conflictdb.create_scene('s')")
    ask(db, put.format("p_active_span => '[2026-06-01 00:00Z, 2026-06-01 01:00Z)'"))
    ask(
        db,
        "SELECT conflictdb.put_track('s', 'F', conflictdb.track_path('SRID=4326;LINESTRING(0 0, 1 0)', "
        "ARRAY['2026-06-01 00:00Z', '2026-06-01 01:00Z']::timestamptz[]), "
        "conflictdb.rectangle_outline(100, 100, 100, 100))",
    )
    number = db.scene("s").resolve(movable=["A"], keep=["F"]).proposal_id or 0
    assert db.apply_proposal(number) == 1
    ask(db, put.format("""p_schedule => '[{"days": ["MON"], "periods": [["00:00", "01:00"]], "timezone": "UTC"}]'"""))
    with pytest.raises(InvalidInput, match="has changed since it was applied: area 'A'"):
        db.undo_proposal(number)


WEEKLY = """'[{"days": ["MON"], "periods": [["00:00", "01:00"]], "timezone": "UTC"}]'"""
TRIANGLE = "SRID=4326;POLYGON((0.4 -0.1, 0.6 -0.1, 0.6 0.1, 0.4 -0.1))"


def ferry(db: Database) -> StoredScene:
    """Return a scene with one track, across `TRIANGLE` on a Monday."""
    ask(db, "SELECT conflictdb.create_scene('s')")
    ask(
        db,
        "SELECT conflictdb.put_track('s', 'F', conflictdb.track_path('SRID=4326;LINESTRING(0 0, 1 0)', "
        "ARRAY['2026-06-01 00:00Z', '2026-06-01 01:00Z']::timestamptz[]), "
        "conflictdb.rectangle_outline(100, 100, 100, 100))",
    )
    return db.scene("s")


def test_the_history_names_the_proposal_that_moved_a_weekly_area(db: Database) -> None:
    """A detection expands its schedule, which is another version of the area; applied and undone."""
    scene = ferry(db)
    ask(db, f"SELECT conflictdb.put_area('s', 'A', '{TRIANGLE}', p_schedule => {WEEKLY})")
    scene.detect(horizon_days=5000)
    assert pairs(scene) == {("A", "F")}
    number = scene.resolve(movable=["A"], keep=["F"], aside_m=80_000.0).proposal_id or 0
    assert db.apply_proposal(number) == 1
    scene.detect()
    assert pairs(scene) == set()
    assert db.undo_proposal(number) == 1
    scene.detect()
    assert pairs(scene) == {("A", "F")}
    assert [(one.kind, one.proposal_id) for one in scene.conflict_events()][-2:] == [
        ("closed", number),
        ("opened", number),
    ]


def test_attached_areas_are_not_moved(db: Database, dsn: str) -> None:
    """Their rows belong to their table: the proposal says so, and nothing has moved, with and without `attached`."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(
            f"""
            CREATE SCHEMA mission;
            CREATE TABLE mission.zone (name text, shape geometry(Polygon, 4326), since timestamptz, until timestamptz);
            INSERT INTO mission.zone VALUES ('A', '{TRIANGLE}', '2026-06-01 00:00Z', '2026-06-01 01:00Z');
            """.encode()
        )
    scene = ferry(db)
    scene.attach("area", "mission.zone", {"key": "name", "footprint": "shape", "start": "since", "end": "until"})
    scene.detect()
    assert pairs(scene) == {("A", "F")}
    number = scene.resolve(movable=["A"], keep=["F"]).proposal_id or 0
    rows = ask(db, "SELECT * FROM mission.zone")
    for attached in (False, True):
        with pytest.raises(InvalidInput, match="moves area 'A' of an attached table"):
            db.apply_proposal(number, attached=attached)
    assert ask(db, "SELECT * FROM mission.zone") == rows
    scene.detect()
    assert pairs(scene) == {("A", "F")}
