"""The life of a conflict: it opens, changes, closes; earlier states stay known, and acknowledgements, too."""

import json
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from itertools import takewhile
from typing import Any

import psycopg
import pytest
from patience import WAIT_S
from psycopg import sql

from conflictdb.jobs import detect

Conn = psycopg.Connection[Any]

HOUR = "2026-03-01T{:02}:00:00Z"


def put(conn: Conn, key: str, hours: tuple[int, int], west: float = 0.0, scene: str = "s") -> None:
    """Put a square that is closed for some hours."""
    conn.execute(
        "SELECT conflictdb.put_area(%s, %s, ST_SetSRID(ST_MakeEnvelope(%s, 50, %s, 51), 4326), tstzrange(%s, %s))",
        [scene, key, west, west + 1, HOUR.format(hours[0]), HOUR.format(hours[1])],
    )
    conn.commit()


def run(conn: Conn, scene: str = "s", *, full: bool = False) -> tuple[int, int, int]:
    done = detect.detect(conn, scene, jobs=1, full=full)
    return done.opened, done.changed, done.closed


def rows(conn: Conn, query: str, *arguments: object) -> list[tuple[Any, ...]]:
    found = conn.execute(query.encode(), arguments).fetchall()
    conn.commit()
    return found


def clock(conn: Conn) -> datetime:
    ((now,),) = rows(conn, "SELECT clock_timestamp()")
    return now  # type: ignore[no-any-return]


LIFE = "SELECT conflict_id, kind, a_key, b_key, periods::text, closed_at IS NULL FROM conflictdb.conflict_events"
KNOWN = "SELECT a_key, b_key, acknowledged_by IS NOT NULL FROM conflictdb.conflicts_known_at('s', %s)"
NOW = "SELECT a_key, b_key, acknowledged_for FROM conflictdb.conflicts ORDER BY 1, 2"


@pytest.fixture
def scene(conn: Conn) -> Conn:
    """Return a connection to a database whose scene s has a conflict of A and B, from 6 to 8."""
    conn.execute("SET timezone = 'UTC'")
    conn.execute("SELECT conflictdb.create_scene('s')")
    put(conn, "A", (6, 10))
    put(conn, "B", (4, 8), 0.5)
    put(conn, "C", (6, 10), 5.0)
    assert run(conn) == (1, 0, 0)
    return conn


def test_a_conflict_opens_changes_and_closes_under_one_number_and_again_under_another(scene: Conn) -> None:
    ((first, opened_at, changed_at),) = rows(
        scene, "SELECT conflict_id, opened_at, changed_at FROM conflictdb.conflicts"
    )
    assert changed_at is None
    put(scene, "B", (4, 9), 0.5)
    assert run(scene) == (0, 1, 0)
    ((number, still, changed_at),) = rows(scene, "SELECT conflict_id, opened_at, changed_at FROM conflictdb.conflicts")
    assert (number, still) == (first, opened_at)
    assert changed_at > opened_at
    put(scene, "B", (4, 9), 5.5)
    assert run(scene) == (1, 0, 1)
    put(scene, "B", (4, 9), 0.5)
    assert run(scene) == (1, 0, 1)
    assert run(scene, full=True) == (0, 0, 0)
    life = rows(scene, f"{LIFE} WHERE a_key = 'A' ORDER BY event")
    assert [(number == first, *rest) for number, *rest in life] == [
        (True, "opened", "A", "B", '{["2026-03-01 06:00:00+00","2026-03-01 08:00:00+00"]}', True),
        (True, "changed", "A", "B", '{["2026-03-01 06:00:00+00","2026-03-01 09:00:00+00"]}', True),
        (True, "closed", "A", "B", '{["2026-03-01 06:00:00+00","2026-03-01 09:00:00+00"]}', False),
        (False, "opened", "A", "B", '{["2026-03-01 06:00:00+00","2026-03-01 09:00:00+00"]}', True),
    ]
    history = "SELECT kind FROM conflictdb.conflict_history('s', %s, %s)"
    assert rows(scene, history, "B", "A") == [("opened",), ("changed",), ("closed",), ("opened",)]
    assert rows(scene, history, "C", None) == [("opened",), ("closed",)]


def test_what_moves_by_less_than_it_is_uncertain_by_is_no_change_until_it_adds_up(scene: Conn) -> None:
    scene.execute("UPDATE conflictdb.conflict SET time_error_s = 10")
    for second, changed in ((15, 0), (19, 0), (25, 1)):
        scene.execute("UPDATE conflictdb.conflict SET time_error_s = 20")
        scene.execute(
            "UPDATE conflictdb.area SET active_span = tstzrange(lower(active_span), %s) WHERE key = 'B'",
            [f"2026-03-01T08:00:{second}Z"],
        )
        scene.commit()
        assert run(scene) == (0, changed, 0)
        ((last,),) = rows(scene, "SELECT last_contact FROM conflictdb.conflicts")
        assert last == datetime(2026, 3, 1, 8, 0, second, tzinfo=UTC)
    assert len(rows(scene, "SELECT FROM conflictdb.conflict_events")) == 2


def test_a_key_that_changes_is_a_change_and_an_object_that_goes_closes(scene: Conn) -> None:
    scene.execute("UPDATE conflictdb.area SET key = 'Z' WHERE key = 'A'")
    scene.commit()
    assert run(scene) == (0, 1, 0)
    scene.execute("SELECT conflictdb.remove_object('s', 'B')")
    scene.commit()
    assert run(scene) == (0, 0, 1)
    assert rows(scene, "SELECT kind, a_key, b_key FROM conflictdb.conflict_events ORDER BY event") == [
        ("opened", "A", "B"), ("changed", "B", "Z"), ("closed", "B", "Z"),
    ]  # fmt: skip
    scene.execute("DELETE FROM conflictdb.scene")
    scene.commit()
    for table in ("conflict_event", "history", "acknowledgement"):
        assert rows(scene, f"SELECT FROM conflictdb.{table}") == []


def test_what_was_known_at_an_instant_is_told_later(scene: Conn) -> None:
    early = clock(scene)
    put(scene, "C", (6, 10), 0.2)
    before_detection = clock(scene)
    run(scene)
    late = clock(scene)
    scene.execute("SELECT conflictdb.remove_object('s', 'B')")
    scene.commit()
    run(scene)
    both = [("A", "B", False), ("A", "C", False), ("B", "C", False)]
    assert rows(scene, KNOWN, early) == rows(scene, KNOWN, before_detection) == both[:1]
    assert sorted(rows(scene, KNOWN, late)) == both
    assert rows(scene, KNOWN, clock(scene)) == both[1:2]
    with pytest.raises(psycopg.Error, match="is before the first detection of the scene, which ended at"):
        rows(scene, KNOWN, "2020-01-01")
    scene.rollback()
    with pytest.raises(psycopg.Error, match="instant: must not be null"):
        rows(scene, KNOWN, None)


def test_history_that_was_pruned_is_refused_and_the_rest_is_told(scene: Conn) -> None:
    early = clock(scene)
    put(scene, "B", (4, 9), 0.5)
    run(scene)
    put(scene, "C", (6, 10), 0.2)
    run(scene)
    scene.execute("SELECT conflictdb.remove_object('s', 'C')")
    scene.commit()
    run(scene)
    late = clock(scene)
    # One event of A and B is left, and none of C.
    assert rows(scene, "SELECT conflictdb.prune_history('s', '0')") == [(5,)]
    assert rows(scene, "SELECT kind, a_key, b_key FROM conflictdb.conflict_events") == [("changed", "A", "B")]
    assert rows(scene, KNOWN, late) == [("A", "B", False)]
    assert len(rows(scene, "SELECT FROM conflictdb.run")) == 2
    with pytest.raises(psycopg.Error, match="is before what is kept of its history, which begins at") as refused:
        rows(scene, KNOWN, early)
    assert refused.value.sqlstate == "ZC003"
    scene.rollback()
    with pytest.raises(psycopg.Error, match="kept: must be 0 or longer; got -00:00:01"):
        rows(scene, "SELECT conflictdb.prune_history('s', '-1 s')")
    scene.rollback()
    assert run(scene, full=True) == (0, 0, 0)


@pytest.mark.parametrize(
    ("of_scene", "setting", "kept"),
    [
        (None, None, False),
        ("1 day", None, True),
        ("0", None, False),
        (None, "0", False),
        (None, "1 year", True),
        ("1 day", "0", True),
        (None, "300000 years", True),
    ],
)
def test_detections_prune_by_the_policy_of_the_scene_else_of_the_server(
    scene: Conn, of_scene: str | None, setting: str | None, kept: bool
) -> None:
    put(scene, "B", (4, 9), 0.5)
    run(scene)
    if kept is False and (of_scene, setting) == (None, None):
        scene.execute("UPDATE conflictdb.run SET finished_at = finished_at - interval '31 days'")
        scene.execute("UPDATE conflictdb.conflict_event SET at = at - interval '31 days'")
    scene.execute("UPDATE conflictdb.scene SET history_kept = %s", [of_scene])
    scene.execute("UPDATE conflictdb.history SET pruned_at = pruned_at - interval '2 hours'")
    scene.execute("SELECT set_config('conflictdb.history_kept', %s, false)", [setting or ""])
    scene.commit()
    run(scene)
    assert len(rows(scene, "SELECT FROM conflictdb.conflict_events")) == (2 if kept else 1)


def test_a_setting_that_is_no_interval_is_told_and_no_detection_fails_of_it(scene: Conn) -> None:
    notices: list[str] = []
    scene.add_notice_handler(lambda notice: notices.append(str(notice.message_primary)))
    scene.execute("SELECT set_config('conflictdb.history_kept', 'a while', false)")
    scene.execute("UPDATE conflictdb.history SET pruned_at = '2020-01-01'")
    scene.commit()
    run(scene, full=True)
    assert notices == ["conflictdb.history_kept: must be an interval, such as 30 days; got 'a while'; taken as 30 days"]


def test_an_acknowledgement_holds_while_the_conflict_is_no_more_than_that(scene: Conn) -> None:
    acknowledged = "SELECT conflictdb.acknowledge('s', 'B', 'A', 'agreed by radio')"
    ((number,),) = rows(scene, acknowledged)
    assert rows(scene, "SELECT conflict_id FROM conflictdb.conflicts") == [(number,)]
    then = clock(scene)
    state = "SELECT state FROM conflictdb.acknowledgements ORDER BY acknowledged_at"
    for until, held, as_told in (
        (7, "agreed by radio", "holds"), (9, None, "outgrown"), (8, "agreed by radio", "holds"),
    ):  # fmt: skip
        put(scene, "B", (4, until), 0.5)
        assert run(scene) == (0, 1, 0)
        assert rows(scene, NOW) == [("A", "B", held)]
        assert rows(scene, state) == [(as_told,)]
    assert rows(scene, KNOWN, then) == [("A", "B", True)]
    rows(scene, acknowledged)
    assert rows(scene, state) == [("ended",), ("holds",)]
    assert rows(scene, "SELECT conflictdb.unacknowledge('s', 'A', 'B')") == [(True,)]
    assert rows(scene, "SELECT conflictdb.unacknowledge('s', 'A', 'B')") == [(False,)]
    assert rows(scene, NOW) == [("A", "B", None)]
    rows(scene, acknowledged)
    scene.execute("UPDATE conflictdb.acknowledgement SET until = now() - interval '1 s' WHERE ended_at IS NULL")
    assert rows(scene, NOW) == [("A", "B", None)]
    assert rows(scene, state) == [("ended",), ("ended",), ("expired",)]
    rows(scene, acknowledged)
    put(scene, "B", (4, 8), 5.0)
    run(scene)
    assert rows(scene, state)[-1] == ("closed",)
    put(scene, "B", (4, 9), 0.5)
    run(scene)
    assert rows(scene, NOW) == [("A", "B", None)], "at other times"
    put(scene, "B", (4, 8), 5.0)
    run(scene)
    put(scene, "B", (4, 8), 0.5)
    run(scene)
    assert rows(scene, NOW) == [("A", "B", "agreed by radio")], "the same again"
    assert sorted(rows(scene, state))[-1] == ("holds",)
    rows(scene, "SELECT conflictdb.unacknowledge('s', 'A', 'B')")
    for height in (5.0, 0.5):
        put(scene, "B", (4, 8), height)
        run(scene)
    assert rows(scene, NOW) == [("A", "B", None)], "withdrawn"


@pytest.mark.parametrize(
    ("worse", "is_more"),
    [
        ("verdict = 'conflict'", True),
        ("verdict = 'unresolved'", True),
        ("verdict = 'grazing'", False),
        ("closest_m = 95", False),
        ("closest_m = 94", True),
        (", ".join(f"closest_{what} = NULL" for what in ("at", "m", "error_m", "a_point", "b_point")), False),
    ],
)
def test_a_worse_verdict_and_a_closer_approach_are_more_than_was_acknowledged(
    scene: Conn, worse: str, is_more: bool
) -> None:
    scene.execute(
        """UPDATE conflictdb.conflict SET verdict = 'grazing', closest_m = 100, closest_error_m = 2,
           closest_a_point = 'SRID=4326;POINT(0 0)', closest_b_point = 'SRID=4326;POINT(0 0)'"""
    )
    scene.execute("SELECT conflictdb.acknowledge('s', 'A', 'B', 'agreed')")
    scene.execute(f"UPDATE conflictdb.conflict SET {worse}".encode())
    assert rows(scene, NOW) == [("A", "B", None if is_more else "agreed")]


@pytest.mark.parametrize(
    ("arguments", "state", "says"),
    [
        (("t", "A", "B", "x", None), "ZC010", "scene 't': name: is not in this database"),
        (("s", "A", "C", "x", None), "ZC011", "scene 's': conflict: between 'A' and 'C' is not known"),
        (("s", "A", None, "x", None), "ZC011", "scene 's': conflict: between 'A' and NULL is not known"),
        (("s", "A", "B", " ", None), "ZC009", "'A' and 'B': reason: must be a text of 1 to 10000 bytes"),
        (("s", "A", "B", None, None), "ZC009", "reason: must be a text"),
        (("s", "A", "B", "x" * 10001, None), "ZC009", "reason: must be a text"),
        (("s", "A", "B", "x", "2020-01-01Z"), "ZC003", "until: must be later than now; got 2020-01-01"),
    ],
)
def test_what_cannot_be_acknowledged_is_refused(
    scene: Conn, arguments: tuple[object, ...], state: str, says: str
) -> None:
    with pytest.raises(psycopg.Error, match=says) as refused:
        rows(scene, "SELECT conflictdb.acknowledge(%s, %s, %s, %s, %s)", *arguments)
    assert refused.value.sqlstate == state


def test_editors_acknowledge_in_their_own_name_only_and_readers_read(scene: Conn) -> None:
    user = f"editor {scene.info.dbname}"
    scene.execute(sql.SQL("CREATE ROLE {} IN ROLE conflictdb_editor").format(sql.Identifier(user)))
    scene.commit()
    forged = "INSERT INTO conflictdb.acknowledgement (acknowledged_by) VALUES ('x')"
    try:
        scene.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(user)))
        scene.execute("SET DateStyle = 'German'")
        rows(scene, "SELECT conflictdb.acknowledge('s', 'A', 'B', 'seen', now() + interval '1 h')")
        for refused in (forged, "UPDATE conflictdb.acknowledgement SET reason = ''", "DELETE FROM conflictdb.history"):
            with pytest.raises(psycopg.errors.InsufficientPrivilege), scene.transaction():
                scene.execute(refused.encode())
        scene.execute("SET ROLE conflictdb_reader")
        with pytest.raises(psycopg.errors.InsufficientPrivilege), scene.transaction():
            scene.execute("SELECT conflictdb.acknowledge('s', 'A', 'B', 'seen')")
        assert rows(scene, "SELECT acknowledged_by FROM conflictdb.conflicts_known_at('s', now())") == [(user,)]
        assert rows(scene, "SELECT acknowledged_by, state FROM conflictdb.acknowledgements") == [(user, "holds")]
        assert rows(scene, "SELECT kind FROM conflictdb.conflict_history('s', 'A')") == [("opened",)]
        scene.execute("SET ROLE conflictdb_worker")
        rows(scene, "SELECT conflictdb.prune_history('s')")
    finally:
        scene.rollback()
        scene.execute("RESET ROLE")
        scene.execute(sql.SQL("DROP ROLE {}").format(sql.Identifier(user)))
        scene.commit()


@pytest.mark.parametrize("before", [False, True])
def test_of_two_who_acknowledge_at_once_the_second_waits_and_replaces_the_first(
    scene: Conn, dsn: str, before: bool
) -> None:
    acknowledge = "SELECT conflictdb.acknowledge('s', 'A', 'B', %s)"
    if before:
        rows(scene, acknowledge, "zeroth")
    waits = "SELECT FROM pg_locks WHERE pid = %s AND NOT granted"
    with psycopg.connect(dsn) as second, ThreadPoolExecutor(1) as beside:
        scene.execute(acknowledge.encode(), ["first"])
        # Any role that can connect could take an advisory lock, and block all others.
        held = scene.execute("SELECT FROM pg_locks WHERE locktype = 'advisory' AND pid = pg_backend_pid()")
        assert held.rowcount == 0
        later = beside.submit(rows, second, acknowledge, "second")
        with psycopg.connect(dsn, autocommit=True) as watcher:
            while watcher.execute(waits, [second.info.backend_pid]).rowcount == 0:
                assert not later.done()
        scene.commit()
        later.result(timeout=WAIT_S)
    states = rows(scene, "SELECT reason, state FROM conflictdb.acknowledgements ORDER BY acknowledged_at")
    assert states[-2:] == [("first", "ended"), ("second", "holds")]
    assert [state for _, state in states[:-2]] == ["ended"] * before


@pytest.mark.parametrize("name", ["s", 'a "quoted" \\ scene', "\x01" * 1000])
def test_listeners_are_told_the_keys_in_parts_that_fit(conn: Conn, dsn: str, name: str) -> None:
    """Also of hostile names, and where keys are so long that only the number of the event fits."""
    conn.execute("SELECT conflictdb.create_scene(%s)", [name])
    keys = [f"{n:03} «{'x' * (n % 50)}»" for n in range(60)] + ["\x01" * 1000, "é" * 500]
    for key in keys:
        put(conn, key, (6, 10), scene=name)
    with psycopg.connect(dsn, autocommit=True) as listener:
        listener.execute("LISTEN conflictdb_event; LISTEN conflictdb")
        opened, _, _ = run(conn, name)
        # The summary of the run comes last.
        heard = list(takewhile(lambda one: one.channel == "conflictdb_event", listener.notifies(timeout=WAIT_S)))
    assert opened == 62 * 61 / 2
    assert max(len(one.payload.encode()) for one in heard) < 8000
    payloads = [json.loads(one.payload) for one in heard]
    assert {(one["scene"], one["kind"]) for one in payloads} == {(name, "opened")}
    events = {event[0]: tuple(event[1:]) for one in payloads for event in one["events"]}
    known = rows(conn, "SELECT event, a_key, b_key FROM conflictdb.conflict_events")
    assert len(known) == len(events) == opened
    assert all(events[event] in ((a_key, b_key), ()) for event, a_key, b_key in known)
    assert sum(event == () for event in events.values()) == 121


def test_periods_that_are_rounded_to_the_next_microsecond_are_the_same(conn: Conn) -> None:
    """Ends are rounded outward: where the last bits were computed otherwise, conflicts changed that had not."""
    alike = """SELECT conflictdb_internal._is_alike(a, b, 1e-7), conflictdb_internal._has_grown(
                          b, 'conflict', 5e-8, NULL, NULL, a, 'conflict', 5e-8, NULL, NULL, 1)
               FROM (SELECT tstzmultirange(tstzrange('2026-01-01', '2026-01-02')) AS a,
                            tstzmultirange(tstzrange('2026-01-01', '2026-01-02'::timestamptz + %s::interval)) AS b) p"""
    assert conn.execute(alike, ["1 microsecond"]).fetchone() == (True, False)
    assert conn.execute(alike, ["2 microseconds"]).fetchone() == (False, True)


@pytest.mark.parametrize("periods", ["{}", "{(,)}", "{[infinity,)}", "{[4714-11-24 BC,294276-12-31]}", None])
def test_no_acknowledgement_breaks_the_view(scene: Conn, periods: str | None) -> None:
    """Editors once inserted all columns; an error of -1e308 s was an error of the view for all readers."""
    numbers = ["NaN", "Infinity", "-Infinity", "1.7e308", "-1.7e308", "0", None]
    measures = [(time_error_s, None, None) for time_error_s in numbers[:-1]]
    measures += [("0", closest_m, closest_error_m) for closest_m in numbers for closest_error_m in numbers]
    for written in measures:
        done = scene.execute(
            """INSERT INTO conflictdb.acknowledgement (scene_id, conflict_id, reason, a_key, b_key, periods, verdict,
                                                       time_error_s, closest_m, closest_error_m)
               SELECT c.scene_id, c.conflict_id, 'known', c.a_key, c.b_key, coalesce(%s, c.periods), c.verdict,
                      %s, %s, %s FROM conflictdb.conflict c""",
            [periods, *written],
        )
        assert done.rowcount == 1
        for seen in ("conflicts", "acknowledgements"):
            assert scene.execute(f"SELECT count(*) FROM conflictdb.{seen}".encode()).fetchone() == (1,)
        scene.rollback()


INSERT = """INSERT INTO conflictdb.acknowledgement (scene_id, conflict_id, reason, a_key, b_key)
            SELECT s.scene_id, c.conflict_id + %s, 'mine', c.a_key, c.b_key
            FROM conflictdb.scene s, conflictdb.conflict c WHERE s.name = %s"""


def test_an_editor_acknowledges_a_conflict_as_it_is_known(scene: Conn) -> None:
    """Wider periods would hide later growth."""
    for forged in ("periods = '{(,)}'", "verdict = 'conflict'", "closest_m = 0", "acknowledged_at = now()"):
        column, value = forged.split(" = ")
        statement = INSERT.replace("b_key)", f"b_key, {column})").replace("c.b_key\n", f"c.b_key, {value}\n")
        scene.execute("SET ROLE conflictdb_editor")
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            scene.execute(statement.encode(), [0, "s"])
        scene.rollback()
    scene.execute("SET ROLE conflictdb_editor")
    scene.execute(INSERT.encode(), [0, "s"])
    scene.execute("RESET ROLE")
    known = "periods, verdict, time_error_s, closest_m, closest_error_m"
    kept = rows(scene, f"SELECT {known} FROM conflictdb.acknowledgement")
    assert kept == rows(scene, f"SELECT {known} FROM conflictdb.conflict")
    put(scene, "B", (4, 9), 0.5)
    run(scene)
    assert rows(scene, "SELECT state FROM conflictdb.acknowledgements") == [("outgrown",)]


@pytest.mark.parametrize(("ahead", "name"), [(0, "t"), (1, "s")], ids=["another scene", "a later conflict"])
def test_no_editor_acknowledges_a_conflict_that_the_scene_does_not_have(scene: Conn, ahead: int, name: str) -> None:
    """The first kept editors of that scene waiting for ever; the second opened its conflict acknowledged."""
    scene.execute("SELECT conflictdb.create_scene('t')")
    scene.commit()
    scene.execute("SET ROLE conflictdb_editor")
    with pytest.raises(psycopg.Error, match="conflict of 'A' and 'B': conflict: is not known") as refused:
        scene.execute(INSERT.encode(), [ahead, name])
    assert refused.value.sqlstate == "ZC011"
    scene.rollback()
    scene.execute(f"SET LOCAL statement_timeout = '{WAIT_S:g} s'".encode())
    scene.execute("SELECT conflictdb.acknowledge('s', 'A', 'B', 'seen')")


def test_an_ended_acknowledgement_stays_ended_by_its_user(scene: Conn) -> None:
    rows(scene, "SELECT conflictdb.acknowledge('s', 'A', 'B', 'seen')")
    scene.execute("SET ROLE conflictdb_editor")
    with pytest.raises(psycopg.errors.InsufficientPrivilege), scene.transaction():
        scene.execute("UPDATE conflictdb.acknowledgement SET ended_by = 'another'")
    rows(scene, "UPDATE conflictdb.acknowledgement SET ended_at = '2020-01-01' RETURNING true")
    ((by, is_now),) = rows(scene, "SELECT ended_by, ended_at > now() - interval '1 h' FROM conflictdb.acknowledgement")
    assert (by, is_now) == ("conflictdb_editor", True)
    for at in ("NULL", "now()"):
        with pytest.raises(psycopg.Error, match="ended_at: is ended since") as refused, scene.transaction():
            scene.execute(f"UPDATE conflictdb.acknowledgement SET ended_at = {at}".encode())
        assert refused.value.sqlstate == "ZC013"
