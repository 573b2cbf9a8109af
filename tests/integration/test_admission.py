"""Plans are admitted only if they meet nobody, whatever was detected, and however many sessions ask at once."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
from city import CITY, HOUR_US, T0_US, asked, flight, keys, square, worker_connected
from draws import draws
from full_plans import lost
from mixed_scenes import odd_scene
from odd_values import STORABLE
from patience import WAIT_S, until

from conflictdb import (
    Area,
    ConflictDBError,
    Database,
    IncompleteWarning,
    Index,
    InvalidInput,
    LockTimeout,
    Motion,
    Rule,
    Scene,
    StoredScene,
    StoreError,
    Track,
    connect,
    solve,
    store,
)
from conflictdb.earth.registry import Setup
from conflictdb.jobs import probes


def test_what_meets_nobody_is_put(city: StoredScene) -> None:
    admission = city.admit(square("a", 0.0))
    assert admission
    assert admission.conflicts == admission.new == []
    # Not detected, and nevertheless seen.
    refused = city.admit([square("c", 0.5), square("b", 0.005)])
    assert not refused
    assert [(one.a_key, one.b_key, one.verdict) for one in refused.conflicts] == [("a", "b", "conflict")]
    assert keys(city) == ["a"]
    city.detect()
    assert not city.admit(square("b", 0.005))
    assert city.admit(square("b", 0.005, (1.0, 2.0)))
    assert keys(city) == ["a", "b"]


def test_plans_with_an_owner_are_not_compared_with_each_other(city: StoredScene) -> None:
    both = [square("1", 0.0), square("2", 0.005)]
    assert [one.b_key for one in city.admit(both).conflicts] == ["2"]
    assert city.admit(both, owner="f")
    assert city.admit([square("3", 0.0), flight("4", 0.005)], owner="f")  # in place of the other two
    assert keys(city) == ["3", "4"]
    assert not city.admit(square("1", 0.0), owner="g")
    for owner in ("g", None):
        with pytest.raises(InvalidInput, match="plan '3': key: belongs to owner 'f'"):
            city.admit(square("3", 0.6), owner=owner)
    assert city.admit(replace(square("1", 0.0), owner="f"))  # and without taking the place of anything
    assert keys(city) == ["1", "3", "4"]
    assert city.admit(replace(flight("3", 0.3), owner="f"), replace=["3"])  # an area becomes a track
    assert [(one.key, one.kind) for one in city.objects()] == [("1", "area"), ("3", "track"), ("4", "track")]


def test_settings_that_changed_since_the_last_admission_count(dsn: str, city: StoredScene) -> None:
    """Plans are cut before the lock under the settings that the connection knows, and again if these have changed."""
    assert city.admit(square("a", 0.0))
    assert city.admit(square("b", 0.012))
    with connect(dsn) as other:
        other.scene(city.name).put(square("far", 50.0), replace(CITY, separation_m=2_000.0))
    assert not city.admit(square("c", 0.03))
    assert keys(city) == ["a", "b", "far"]


def test_a_stored_key_must_be_named(city: StoredScene) -> None:
    """A flight with the key of a fence does not remove the fence; one of another owner is refused, named or not."""
    city.put([square("fence", 0.0), square("theirs", 0.3, owner="them")])
    for owner, named, rule in (
        (None, (), "plan 'fence': key: belongs to an object of the scene: name it in replace"),
        ("me", ("theirs",), "belongs to an object of the scene"),
    ):
        with pytest.raises(InvalidInput, match=rule):
            city.admit(flight("fence", 0.605), owner, replace=named)
    for owner, named in ((None, ()), ("me", ()), (None, ["theirs"]), ("me", ["theirs"])):
        with pytest.raises(InvalidInput, match="plan 'theirs': key: belongs to owner 'them'"):
            city.admit(flight("theirs", 0.605), owner, replace=named)
    with pytest.raises(InvalidInput, match="belongs to an object of the scene"):
        city.admit(replace(square("theirs", 0.605), owner="them"))
    for wrong in ("fence", [5], None):
        with pytest.raises(InvalidInput, match="admit: replace: must be a sequence of keys"):
            city.admit(flight("fence", 0.605), replace=wrong)  # type: ignore[arg-type]
    assert [(one.key, one.kind) for one in city.objects()] == [("fence", "area"), ("theirs", "area")]
    assert city.admit(flight("fence", 0.605), "me", replace=["fence", "unknown"])
    assert city.admit(square("theirs", 0.605, (2.0, 3.0)), "them")
    assert city.admit(replace(square("theirs", 0.3), owner="them"), replace={"theirs"})
    assert [(one.key, one.kind) for one in city.objects()] == [("fence", "track"), ("theirs", "area")]


def test_a_changed_plan_says_which_conflicts_are_new(city: StoredScene) -> None:
    """Those before may be allowed: with the same objects, at most as long and as severe."""
    city.put([square("a", 0.0), square("b", 0.005), square("c", 0.03)])
    assert not city.admit(square("a", 0.001), replace=["a"])
    later = city.admit(square("a", 0.001, (0.2, 0.9)), allow_known=True, replace=["a"])
    assert later
    assert [one.b_key for one in later.conflicts] == ["b"]
    assert later.new == []
    longer = city.admit(square("a", 0.001, (0.1, 0.9)), allow_known=True, replace=["a"])
    assert not longer
    assert [one.b_key for one in longer.new] == ["b"]
    moved = city.admit(square("a", 0.022, (0.2, 0.9)), allow_known=True, replace=["a"])
    assert [(one.a_key, one.b_key) for one in moved.new] == [("a", "c")]
    assert city.admit(square("a", 0.1), replace=["a"])


def test_what_detections_have_not_seen_counts(city: StoredScene) -> None:
    """Objects that are new, changed, moved away or gone, areas and tracks."""
    city.put([square("stays", 0.0), square("moves", 0.1), flight("flies", 0.205), square("goes", 0.3)])
    city.detect()
    city.put([square("moves", 0.4), flight("flies", 0.505)])
    city.delete_objects("goes")
    assert not city.admit(square("x", 0.005))
    assert city.admit([square("x", 0.1), square("y", 0.2), square("z", 0.3)])
    for lon in (0.4, 0.5):
        assert not city.admit(square("w", lon))


@draws("scenes", 25, 500)
def test_plans_are_admitted_as_they_are(conn: psycopg.Connection[Any], scenes: int) -> None:
    """Whatever an area or track may be, it is stored as a load stores it."""
    for name in ("put", "admitted"):
        store.set_scene(conn, Scene(name))
    for seed in range(scenes):
        _, some_areas, some_tracks = odd_scene(seed, replace(STORABLE, north_deg=80.0))
        store.replace_scene(conn, Scene("put"), some_areas, some_tracks, merge=False)
        store.replace_scene(conn, Scene("admitted"), [], [], merge=False)
        with store.transaction(conn):
            store.put_plans(conn, "admitted", [], some_areas, some_tracks)
        (_, *put), (_, *admitted) = (store.read_scene(conn, name) for name in ("put", "admitted"))
        for one, other in zip(put, admitted, strict=True):
            assert len(one) == len(other), seed
            for known in one:
                assert lost(known, next(item for item in other if item.key == known.key)) == [], seed


@pytest.mark.parametrize("detected", [False, True])
@pytest.mark.parametrize(
    ("rule", "area", "admitted"),
    [
        ({"separation_m": 5000.0}, square("a", 0.03), False),
        ({"separation_m": 500.0}, square("a", 0.03), True),
        ({"vertical_m": 100.0}, square("a", 0.0, floor_m=250.0), False),
        ({"vertical_m": 40.0}, square("a", 0.0, floor_m=250.0), True),
        ({"time_s": 1800.0}, square("a", 0.0, (-1.0, -0.2)), False),
        ({"time_s": 60.0}, square("a", 0.0, (-1.0, -0.2)), True),
        ({"allowed": True}, square("a", 0.0), True),
    ],
)
def test_separation_rules_apply(
    city: StoredScene, rule: dict[str, Any], area: Area, admitted: bool, detected: bool
) -> None:
    """Whether or not the other object has been detected, and as `solve` and an index do."""
    area, plan = replace(area, object_class="prison"), flight("d", 0.005, object_class="drone", ceiling_m=200.0)
    store.put_rule(city.connection, city.name, Rule("prison", "drone", **rule))
    city.put(area)
    if detected:
        city.detect()
    found = city.admit(plan)
    assert bool(found) is admitted
    scene = replace(CITY, rules=city.rules())
    index = Index(scene)
    index.put(area)
    pairs = [(one.a_key, one.b_key, one.periods) for one in solve([plan], [area], scene)]
    assert pairs == [(one.a_key, one.b_key, one.periods) for one in found.conflicts]
    assert pairs == [(one.a_key, one.b_key, one.periods) for one in index.probe(plan)]
    # It takes the place of the plan, under no rule.
    other = replace(plan, object_class="bird")
    assert bool(city.admit(other, replace=["d"])) is not bool(solve([other], [area], scene))


def test_an_object_that_cannot_be_cut_stops_nobody_else(city: StoredScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """During its time and at its heights it is unresolved; requests for other times are answered."""
    from conflictdb.core.pieces import covers

    city.put(square("bad", 0.0))
    cut = covers.area_pieces

    def fails(setup: Setup, some: object) -> object:
        if any(start == T0_US for start in some.active.at_us[:, 0]):  # type: ignore[attr-defined]
            raise ValueError("cannot be cut")
        return cut(setup, some)  # type: ignore[arg-type]

    monkeypatch.setattr(covers, "area_pieces", fails)
    [conflict] = city.admit(square("x", 0.005, (0.5, 2.0))).conflicts
    assert (conflict.a_key, conflict.verdict) == ("bad", "unresolved")
    assert city.admit(square("x", 0.005, (2.0, 3.0)))


ANSWER = """
SELECT error IS NULL AND (answer ->> 'admitted')::boolean FROM conflictdb.probe_request
WHERE probe_id = %s AND answered_at IS NOT NULL
"""


def rounds(dsn: str, count: int, seed: int) -> tuple[int, int]:
    """Let 2 to 8 sessions admit plans that exclude each other at once, in Python or SQL, and kill some of them.

    Returns how many were admitted, and how many sessions ended by a kill before they had their answer.
    """
    rng = np.random.default_rng(seed)
    admitted = killed = 0
    with connect(dsn) as db, worker_connected(dsn), psycopg.connect(dsn, autocommit=True) as killer:
        db.scene("city").put(square("fixed", 50.0), CITY)
        for turn in range(count):
            n, kills = int(rng.integers(2, 9)), rng.random() < 0.5
            lons = turn * 0.02 % 40.0 + rng.choice([0.0, 0.004, 0.012], n)
            plans: list[Area | Track] = [
                flight(f"{turn}-{k}", lon + 0.005) if rng.random() < 0.3 else square(f"{turn}-{k}", lon)
                for k, lon in enumerate(lons)
            ]
            if rng.random() < 0.2:
                plans = [replace(plans[0], key=f"{turn}-same")] * n  # the same plan from all of them
            in_sql = rng.random(n) < 0.5
            begin, pids, shot = threading.Barrier(n + 1), dict[int, int](), set[int]()

            def work(
                k: int,
                plans: list[Area | Track] = plans,
                in_sql: Any = in_sql,
                begin: threading.Barrier = begin,
                pids: dict[int, int] = pids,
                shot: set[int] = shot,
            ) -> bool | None:
                owner = f"{plans[k].key} of {k}"
                try:
                    with connect(dsn) as mine:
                        pids[k] = mine.connection.info.backend_pid
                        begin.wait(WAIT_S)
                        if in_sql[k]:
                            return admitted_in_sql(mine.connection, plans[k], owner)
                        return bool(mine.scene("city").admit(plans[k], owner=owner))
                except (ConflictDBError, psycopg.Error) as error:
                    if "belongs to owner" in str(error):
                        return False
                    if k not in shot:
                        raise
                return None

            with ThreadPoolExecutor(n) as threads:
                working = [threads.submit(work, k) for k in range(n)]
                begin.wait(WAIT_S)
                for k in rng.choice(n, int(kills) * int(rng.integers(1, n)), replace=False).tolist():
                    threading.Event().wait(float(rng.uniform(0.0, 0.03)))
                    shot.add(k)
                    killer.execute("SELECT pg_terminate_backend(%s, 60000)", [pids[k]])
                answers = [one.result() for one in working]
            while probes.answer(db.connection):  # what killed sessions asked
                pass
            _, areas_there, tracks_there = store.read_scene(db.connection, "city")
            db.connection.commit()
            there = {one.owner: one for one in [*areas_there, *tracks_there] if one.key != "fixed"}
            assert not solve(tracks_there, areas_there, CITY)
            for k, answer in enumerate(answers):
                if answer is not None:
                    assert answer == (f"{plans[k].key} of {k}" in there)
            # A refused plan meets an admitted one.
            for plan, answer in zip(plans, answers, strict=True):
                if answer is False:
                    every = [*areas_there, *tracks_there, replace(plan, key="refused", owner=None)]
                    assert solve(
                        [p for p in every if isinstance(p, Track)], [p for p in every if isinstance(p, Area)], CITY
                    )
            admitted, killed = admitted + len(there), killed + answers.count(None)
            if there:
                db.scene("city").delete_objects(*(one.key for one in there.values()))
    return admitted, killed


def admitted_in_sql(conn: psycopg.Connection[Any], plan: Area | Track, owner: str) -> bool:
    """Admit a plan by the function of SQL; the session is a worker, too."""
    admitted, _, request = asked(conn, plan, p_owner=owner)
    conn.commit()
    while admitted is None:
        probes.answer(conn)
        (admitted,) = conn.execute(ANSWER, [request]).fetchone() or (None,)
        conn.commit()
    return bool(admitted)


def test_of_sessions_that_exclude_each_other_one_succeeds(dsn: str) -> None:
    admitted, _ = rounds(dsn, 6, 1)
    assert admitted >= 4


@pytest.mark.slow
def test_a_thousand_rounds_of_sessions_with_kills(dsn: str) -> None:
    admitted, killed = rounds(dsn, 1000, 2)
    assert admitted > 1000
    assert killed > 200


def test_an_open_transaction_keeps_others_waiting(dsn: str, city: StoredScene) -> None:
    """Until it ends; then they see what it put, also with a snapshot of their own."""
    with psycopg.connect(dsn, application_name="desk") as conn:
        conn.execute("SELECT")
        first = connect(conn).scene("city")
        assert first.admit(square("a", 0.0))
        with pytest.raises(LockTimeout, match=r"another admission of scene 'city' .*'desk'"):
            city.admit(square("b", 0.005), lock_timeout_s=0.1)
        # Other scenes, and plain changes, do not wait.
        city.put(square("c", 0.5))
        with ThreadPoolExecutor(1) as thread:
            waits = thread.submit(city.admit, square("b", 0.005))
            conn.rollback()
            assert waits.result()
    assert keys(city) == ["b", "c"]


@pytest.mark.parametrize("in_sql", [True, False], ids=["sql", "python"])
@pytest.mark.parametrize(
    "away",
    ["SELECT conflictdb.rename_scene('city', 'former')", "SELECT conflictdb.remove_scene('city')"],
    ids=["renamed", "removed"],
)
def test_the_name_may_pass_to_another_scene_during_the_wait(
    dsn: str, city: StoredScene, *, in_sql: bool, away: str
) -> None:
    """The plan is compared with the objects of the scene that it would be put into."""

    def second() -> bool:
        if in_sql:
            with psycopg.connect(dsn) as other:
                return bool(asked(other, square("n", 0.0))[0])
        with connect(dsn) as db:
            return bool(db.scene("city").admit(square("n", 0.0)))

    with psycopg.connect(dsn) as conn, psycopg.connect(dsn, autocommit=True) as watch, ThreadPoolExecutor(1) as thread:
        asked(conn, square("x", 0.5))
        waits = thread.submit(second)
        waiting = "SELECT FROM pg_stat_activity WHERE %s = ANY (pg_blocking_pids(pid))"
        until(lambda: waits.done() or watch.execute(waiting, [conn.info.backend_pid]).fetchone() is not None)
        conn.execute(away.encode())
        store.replace_scene(conn, CITY, [square("other", 0.005)], [], merge=True)
        conn.commit()
        assert not waits.result()
    assert keys(city) == ["other"]


@pytest.mark.parametrize("in_sql", [True, False], ids=["sql", "python"])
@pytest.mark.parametrize("kind", [square, flight])
def test_an_object_that_is_put_meanwhile_is_not_replaced(
    dsn: str, city: StoredScene, *, in_sql: bool, kind: Any
) -> None:
    """Statements that put objects wait for no admission: theirs may commit after the admission has read the keys."""

    def admission() -> object:
        plan = kind("n", 0.0, owner="me")
        if in_sql:
            with psycopg.connect(dsn) as other:
                return asked(other, plan, p_owner="me")
        with connect(dsn) as db:
            return db.scene("city").admit(plan, "me")

    with psycopg.connect(dsn) as conn, psycopg.connect(dsn, autocommit=True) as watch, ThreadPoolExecutor(1) as thread:
        conn.execute("SELECT")
        connect(conn).scene("city").put(kind("n", 0.5, owner="them"))
        waits = thread.submit(admission)
        waiting = "SELECT FROM pg_stat_activity WHERE %s = ANY (pg_blocking_pids(pid))"
        until(lambda: waits.done() or watch.execute(waiting, [conn.info.backend_pid]).fetchone() is not None)
        conn.commit()
        with pytest.raises((InvalidInput, psycopg.Error), match="plan 'n': key: belongs to an object of the scene"):
            waits.result()
    assert [one.owner for one in city.objects()] == ["them"]


def test_a_transaction_that_is_too_old_is_refused(dsn: str, city: StoredScene) -> None:
    """It would not see what was admitted meanwhile."""
    city.admit(square("z", 0.9))
    with psycopg.connect(dsn) as conn:
        conn.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        conn.execute("SELECT count(*) FROM conflictdb.area").fetchone()
        assert city.admit(square("a", 0.0))
        with pytest.raises(StoreError, match="40001"):
            connect(conn).scene("city").admit(square("b", 0.005))
        conn.rollback()
        assert not connect(conn).scene("city").admit(square("b", 0.005))


def test_a_default_isolation_does_not_matter(dsn: str, city: StoredScene) -> None:
    with psycopg.connect(dsn, options="-c default_transaction_isolation=serializable") as conn, connect(dsn) as other:
        conn.autocommit = True
        scene = connect(conn).scene("city")
        assert scene.admit(square("a", 0.0))
        assert other.scene("city").admit(square("b", 0.02))
        assert not scene.admit(square("c", 0.025))


def test_admission_needs_the_right_to_change(dsn: str, db: Database, city: StoredScene) -> None:
    db.connection.execute("CREATE ROLE admits LOGIN; GRANT conflictdb_editor TO admits")
    db.connection.execute("CREATE ROLE reads LOGIN; GRANT conflictdb_reader TO reads")
    db.connection.commit()
    try:
        with psycopg.connect(dsn) as conn:
            for role, refusal in (("reads", "GRANT conflictdb_editor"), ("admits", None)):
                conn.execute(f"SET ROLE {role}")
                conn.commit()
                scene = connect(conn).scene("city")
                if refusal is None:
                    assert scene.admit(square("a", 0.0))
                    assert not scene.admit(flight("b", 0.005))
                    conn.commit()
                else:
                    with pytest.raises(ConflictDBError, match="permission denied"):
                        scene.admit(square("a", 0.0))
                    conn.rollback()
            db.protect_scenes()
            scene = connect(conn).scene("city")
            with pytest.raises(ConflictDBError, match="not in this database"):
                scene.admit(square("c", 0.5))
            conn.rollback()
            db.scene("city").share("admits", "read")
            with pytest.raises(ConflictDBError, match="not change it"):
                scene.admit(square("c", 0.5))
            conn.rollback()
            db.scene("city").share("admits", "write")
            assert scene.admit(square("c", 0.5))
            conn.rollback()
            conn.execute("RESET ROLE")
    finally:
        db.protect_scenes(on=False)
        for role in ("admits", "reads"):
            db.connection.execute(f"REASSIGN OWNED BY {role} TO CURRENT_USER; DROP OWNED BY {role}; DROP ROLE {role}")
        db.connection.commit()


def test_a_probe_of_many_plans_takes_as_many_round_trips_as_one_of_two(
    city: StoredScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It sees what no detection has seen, and conflicts of the plans with each other."""
    city.put([square(f"{k}", 0.1 * k) for k in range(8)])
    calls: list[str] = []
    known = psycopg.Cursor.execute

    def counted(self: Any, query: Any, *rest: Any, **options: Any) -> Any:
        calls.append(str(query))
        return known(self, query, *rest, **options)

    monkeypatch.setattr(psycopg.Cursor, "execute", counted)
    taken = []
    for count in (2, 8):
        calls.clear()
        plans = [square(f"new {k}", 0.1 * k + 0.005) for k in range(count - 1)] + [square("more", 0.012)]
        with pytest.warns(IncompleteWarning):
            found = city.probe(plans)
        assert [(one.a_key, one.b_key) for one in found] == sorted(
            [("more", "new 0"), *((f"{k}", f"new {k}") for k in range(count - 1))]
        )
        taken.append(len(calls))
    assert taken[0] == taken[1]


def test_bad_plans_change_nothing(city: StoredScene, db: Database) -> None:
    for plans, rule in (
        ([], "got none"),
        ("a", "must be an Area or a Track"),
        ([square("a", 0.0), square("a", 0.5)], "more than once"),
        (Track("t", [(0.0, 89.5), (1.0, 89.5)], [T0_US, T0_US + HOUR_US], [(0.0, 0.0)]), "beyond"),
    ):
        with pytest.raises(InvalidInput, match=rule):
            city.admit(plans)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="owner"):
        city.admit(square("a", 0.0), owner="")
    with pytest.raises(InvalidInput, match="city"):
        db.scene("town").admit(square("a", 0.0))
    assert keys(city) == []


def test_great_circles_get_a_centre_with_the_first_admission(db: Database) -> None:
    store.set_scene(db.connection, Scene("round", motion=Motion.GREAT_CIRCLE))
    scene = db.scene("round")
    assert scene.admit(square("a", 10.0))
    assert scene.settings().centre is not None
    assert not scene.admit(square("b", 10.005))
    with pytest.raises(InvalidInput, match="60 degrees"):
        scene.admit(square("c", 100.0))


def test_put_adds_and_replaces(db: Database) -> None:
    scene = db.scene("new")
    with pytest.raises(InvalidInput, match="new"):
        scene.put(square("a", 0.0))
    assert scene.put([square("a", 0.0), flight("b", 0.1)], Scene("other", tolerance_m=2.0)).added == 2
    assert scene.settings() == Scene("new", tolerance_m=2.0)
    counts = scene.put([square("a", 0.0), flight("b", 0.2)])
    assert (counts.updated, counts.unchanged) == (1, 1)
    assert [one.key for one in scene.objects()] == ["a", "b"]
