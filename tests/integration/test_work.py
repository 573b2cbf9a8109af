"""Work of seeded scenes, counted and not timed: a change that increases it has to change the limits here.

Limits are the counts at the time that they were set, and a twentieth more. A change that reduces work lowers them.
benchmarks/unit_costs.py measures the cost per unit.
"""

import sys
from collections.abc import Callable
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any

import psycopg
import pytest
from made_scenes import Kind, box, sea
from psycopg.conninfo import conninfo_to_dict

from conflictdb import Area, Scene, Track, connect, store
from conflictdb.core import conflict_regions
from conflictdb.jobs import schema
from conflictdb.jobs.detect import Run, detect
from conflictdb.store.parameters import Array

Conn = psycopg.Connection[Any]


@dataclass
class Traffic:
    """Traffic between the program and the server.

    statements : number sent, COPY included; commits : of transactions
    sent, received : bytes of COPY, of arrays that are sent as parameters, and of rows
    """

    statements: int = 0
    commits: int = 0
    sent: int = 0
    received: int = 0

    def since(self, began: "Traffic") -> "Traffic":
        """Return the counts since then."""
        return Traffic(*(now - then for now, then in zip(astuple(self), astuple(began), strict=True)))


@pytest.fixture
def traffic(dsn: str, monkeypatch: pytest.MonkeyPatch) -> Traffic:
    """Return counts that go on with all that psycopg does with the test's database, whoever connects.

    Servers of other tests work in this process, too, with databases of their own.
    """
    counts = Traffic()
    name = conninfo_to_dict(dsn)["dbname"]

    def is_counted(conn: Conn) -> bool:
        return not conn.closed and conn.info.dbname == name

    execute, copy, commit = psycopg.Cursor.execute, psycopg.Cursor.copy, psycopg.Connection.commit
    write, read = psycopg.Copy.write, psycopg.Copy.read

    def counted_execute(self: Any, *arguments: Any, **more: Any) -> Any:
        if not is_counted(self.connection):
            return execute(self, *arguments, **more)
        counts.statements += 1
        counts.sent += sum(len(one.sent) for some in arguments[1:] for one in some or () if isinstance(one, Array))
        execute(self, *arguments, **more)
        answer = self.pgresult
        counts.received += sum(
            len(answer.get_value(row, column) or b"")
            for row in range(answer.ntuples)
            for column in range(answer.nfields)
        )
        return self

    def counted_copy(self: Any, *arguments: Any, **more: Any) -> Any:
        counts.statements += is_counted(self.connection)
        return copy(self, *arguments, **more)

    def counted_commit(self: Any) -> None:
        counts.commits += is_counted(self)
        commit(self)

    def counted_write(self: Any, block: bytes) -> None:
        counts.sent += len(block) * is_counted(self.connection)
        write(self, block)

    def counted_read(self: Any) -> Any:
        block = read(self)
        counts.received += len(block) * is_counted(self.connection)
        return block

    monkeypatch.setattr(psycopg.Cursor, "execute", counted_execute)
    monkeypatch.setattr(psycopg.Cursor, "copy", counted_copy)
    monkeypatch.setattr(psycopg.Connection, "commit", counted_commit)
    monkeypatch.setattr(psycopg.Copy, "write", counted_write)
    monkeypatch.setattr(psycopg.Copy, "read", counted_read)
    return counts


def scene_of(name: str) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene by name: the paper's box, or a sea."""
    if name == "box":
        scene, areas, tracks = box(Kind.MIXED, 600, 1)
        return replace(scene, name=name), areas, tracks
    parts = list(sea(600, 1))
    return Scene(name), [a for areas, _ in parts for a in areas], [t for _, tracks in parts for t in tracks]


def effort(conn: Conn, run: Run) -> dict[str, int]:
    """Return the counts of stage 4 of a run."""
    row = conn.execute("SELECT settings FROM conflictdb.run WHERE run_id = %s", [run.run_id]).fetchone()
    conn.rollback()
    assert row is not None
    return {name: count for name, count in row[0].items() if isinstance(count, int)}


@pytest.fixture
def touched(conn: Conn) -> Callable[[str], int]:
    """Return a function that counts the rows of a table that are new or rewritten since its last call."""
    seen: dict[str, set[tuple[str, str]]] = {}

    def count(table: str) -> int:
        rows = {(str(a), str(b)) for a, b in conn.execute(f"SELECT ctid, xmin FROM conflictdb.{table}").fetchall()}
        conn.rollback()
        new = rows - seen.get(table, set())
        seen[table] = rows
        return len(new)

    return count


# Counts of a first detection, where every row is new; received and sent are kilobytes.
# corners: of all regions.
FIRST = {
    "box": {
        "pieces": 600,
        "candidate_pairs": 2633,
        "intersecting_pairs": 1794,
        "solved_pairs": 957,
        "windows": 958,
        "evaluations": 4828,
        "searched_pairs": 0,
        "written": 1583,
        "corners": 18686,
        "statements": 26,  # two of them limit the waits for locks, one for each transaction
        "commits": 2,
        "sent": 1505,
        "received": 206,  # objects and their order; no piece
    },
    "sea": {
        "pieces": 956,
        "candidate_pairs": 3811,
        "intersecting_pairs": 1235,
        "solved_pairs": 1082,
        "windows": 1086,
        "evaluations": 3924,
        "searched_pairs": 0,
        "written": 324,
        "corners": 2301,
        "statements": 26,  # two of them limit the waits for locks, one for each transaction
        "commits": 2,
        "sent": 1221,
        "received": 211,  # objects and their order; no piece
    },
}
# Counts of a detection after one of these tracks was delayed by a minute; received and sent are bytes.
ONE_CHANGE = {
    "box": {
        "pieces": 1,
        "candidate_pairs": 9,
        "written": 6,
        "statements": 6,
        "commits": 1,
        "sent": 4606,
        "received": 4536,
    },
    "sea": {
        "pieces": 4,
        "candidate_pairs": 17,
        "written": 2,
        "statements": 6,
        "commits": 1,
        "sent": 4650,
        "received": 24835,
    },
}
MORE = 1.05


def grown(counted: dict[str, int], limits: dict[str, int]) -> dict[str, tuple[int, int]]:
    """Return counts above their limits, each with its limit."""
    return {name: (counted[name], limit) for name, limit in limits.items() if counted[name] > limit * MORE}


def test_traffic_with_other_databases_is_not_counted(traffic: Traffic, conn: Conn, server_dsn: str) -> None:
    """A page's server of another test was counted."""
    with psycopg.connect(server_dsn) as other:
        other.execute("SELECT 1")
        with other.cursor() as cursor, cursor.copy("COPY (SELECT 1) TO STDOUT") as rows:
            assert list(rows)
        other.commit()
    assert traffic == Traffic()
    conn.execute("SELECT 'four'")
    with conn.cursor() as cursor, cursor.copy("COPY (SELECT 1) TO STDOUT") as rows:
        assert b"".join(rows) == b"1\n"
    conn.commit()
    assert traffic == Traffic(statements=2, commits=1, received=6)


def test_a_later_connection_reads_no_files(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading and hashing sql/ took longer than to connect."""
    connect(dsn).close()

    def refuse() -> list[Path]:
        pytest.fail("sql/ is read again")

    monkeypatch.setattr(schema, "routine_files", refuse)
    connect(dsn).close()


def test_a_detection_in_full_mends_pieces_and_leaves_the_others(conn: Conn, touched: Callable[[str], int]) -> None:
    scene, areas, tracks = scene_of("box")
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    query = "SELECT to_jsonb(p) - 'piece_id' FROM conflictdb.piece p ORDER BY object_kind, object_id, part, turn"
    sound = conn.execute(query).fetchall()
    conn.execute("DELETE FROM conflictdb.piece WHERE piece_id % 50 = 0")
    conn.execute("UPDATE conflictdb.piece SET hull = ST_Translate(hull, 1e-9, 0) WHERE piece_id % 50 = 1")
    conn.execute("UPDATE conflictdb.piece SET span = tstzrange(lower(span), NULL) WHERE piece_id % 50 = 2")
    conn.execute("UPDATE conflictdb.piece SET part = part + 7 WHERE piece_id % 50 = 3")
    conn.commit()
    assert conn.execute(query).fetchall() != sound
    touched("piece")
    detect(conn, scene.name, jobs=1, full=True)
    assert conn.execute(query).fetchall() == sound
    assert touched("piece") < 0.1 * len(sound)


@pytest.mark.parametrize("name", list(FIRST))
def test_work_does_not_grow(
    conn: Conn, traffic: Traffic, touched: Callable[[str], int], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For a first detection, for a second one, which writes no row, and for one change, by the rows it touches."""
    united: list[int] = []
    make = conflict_regions._united_in_degrees

    def counted_unions(plane: Any, ring: Any, ring_offset: Any, offset: Any, limit_m: float) -> Any:
        united.append(len(offset) - 1)
        return make(plane, ring, ring_offset, offset, limit_m)

    monkeypatch.setattr(conflict_regions, "_united_in_degrees", counted_unions)
    scene, areas, tracks = scene_of(name)
    store.replace_scene(conn, scene, areas, tracks, merge=False)

    began = replace(traffic)
    run = detect(conn, scene.name, jobs=1)
    first = traffic.since(began)
    counted = {**asdict(run), **effort(conn, run), **asdict(first), "pieces": touched("piece")}
    counted |= {"written": touched("conflict"), "sent": first.sent // 1000, "received": first.received // 1000}
    query = (
        "SELECT sum(ST_NPoints(region) - ST_NRings(region)), count(*) FILTER (WHERE region IS NULL) "
        "FROM conflictdb.conflict"
    )
    counted["corners"], unknown = conn.execute(query).fetchone() or (0, 0)
    conn.rollback()
    assert run.conflicts == counted["written"] > 0
    assert not grown(counted, FIRST[name])
    assert unknown == 0
    assert sum(united) <= 0.01 * run.conflicts  # all others are regions of the kernel, without GEOS

    began = replace(traffic)
    again = detect(conn, scene.name, jobs=1, full=True)
    assert (again.opened, again.changed, again.closed) == (0, 0, 0)
    assert touched("conflict") == touched("piece") == 0
    assert traffic.since(began).statements <= first.statements + 5

    delayed = replace(tracks[0], times_us=tracks[0].times_us + 60_000_000)
    store.replace_scene(conn, scene, [], [delayed], merge=True)
    began = replace(traffic)
    run = detect(conn, scene.name, jobs=1)
    counted = {**asdict(run), **asdict(traffic.since(began)), "pieces": touched("piece")}
    assert not grown({**counted, "written": touched("conflict")}, ONE_CHANGE[name])


@pytest.mark.parametrize("name", list(FIRST))
def test_a_change_replaces_its_own_differences(
    conn: Conn, traffic: Traffic, touched: Callable[[str], int], name: str
) -> None:
    """Of a scene that stores delays: with five statements more, and no row of a pair that did not change."""
    scene, areas, tracks = scene_of(name)
    store.replace_scene(conn, replace(scene, delays_within_s=3600.0), areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    assert touched("difference") > 500
    delayed = replace(tracks[0], times_us=tracks[0].times_us + 60_000_000)
    store.replace_scene(conn, replace(scene, delays_within_s=3600.0), [], [delayed], merge=True)
    began = replace(traffic)
    detect(conn, scene.name, jobs=1)
    assert traffic.since(began).statements == ONE_CHANGE[name]["statements"] + 5
    query = "SELECT count(*) FROM conflictdb.difference d JOIN conflictdb.track t ON t.key = %s "
    query += "AND (d.track_id = t.track_id OR (d.other_kind, d.other_id) = (1, t.track_id))"
    (own,) = conn.execute(query, [delayed.key]).fetchone() or (0,)
    conn.rollback()
    assert touched("difference") == own > 0


def test_stored_objects_are_checked_by_columns(conn: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not one by one, as they were when they were made: that took a third of the delays of all tracks."""
    scene, areas, tracks = scene_of("sea")
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    checked: list[str] = []
    monkeypatch.setattr(Area, "__post_init__", lambda one: checked.append(one.key))
    monkeypatch.setattr(Track, "__post_init__", lambda one, _: checked.append(one.key))
    _, own_areas, own_tracks = store.read_scene(conn, scene.name)
    assert (len(own_areas), len(own_tracks)) == (len(areas), len(tracks))
    assert not checked


def test_a_listed_conflict_takes_few_calls(conn: Conn) -> None:
    """Of Python functions: its row, its periods and their ends. Which column goes where is found once."""
    scene, areas, tracks = scene_of("box")
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    count = detect(conn, scene.name, jobs=1).conflicts
    calls: list[str] = []

    def counted(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and "conflictdb" in frame.f_code.co_filename:
            calls.append(frame.f_code.co_name)

    sys.setprofile(counted)
    try:
        found = list(store.each_conflict(conn, scene.name))
    finally:
        sys.setprofile(None)
    assert len(found) == count > 1000
    assert len(calls) < 8 * count
