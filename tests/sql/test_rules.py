"""Separation rules in the database: entered, refused, marking only their pairs, and the answer of `solve`."""

import contextlib
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
from ruled import random_rules, sea

from conflictdb import InvalidInput, Scene, connect, solve, store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core.pieces.digests import area_digests, track_digests
from conflictdb.formats.scene_file import read_scene
from conflictdb.jobs.detect import detect
from conflictdb.model.rules import Rule

Conn = psycopg.Connection[Any]


def verdicts(found: Any) -> dict[tuple[str, str], str]:
    return {(one.a_key, one.b_key): one.verdict for one in found}


@pytest.mark.parametrize("few", [100, -1])
def test_detections_find_what_solve_finds_after_every_change(dsn: str, few: int) -> None:
    """Rules, classes and owners change; few changes, and many, are detected by different ways."""
    rng = np.random.default_rng(3)
    tracks, areas = sea(rng, 90, 0.5)
    tracks = [replace(one, max_speed_kn=np.inf) for one in tracks]
    rules: list[Rule] = []
    with connect(dsn) as db:
        for step in range(8):
            if step % 3 == 1:
                rules = random_rules(rng)
            elif step and rules:
                rules = [one for one in rules if rng.random() < 0.9]
                try:
                    Scene("s", rules=rules)
                except Exception:
                    rules = random_rules(rng)
            for k in rng.integers(0, len(tracks), 2 * (step % 2)).tolist():
                tracks[k] = replace(tracks[k], object_class="escort", owner="one", max_speed_kn=np.inf)
            scene = Scene("s", separation_m=200.0, rules=rules)
            store.replace_scene(db.connection, scene, areas, tracks, merge=False)
            detect(db.connection, "s", few_objects=few, full=step == 5)
            expected = {(one.a_key, one.b_key): one for one in solve(tracks, areas, scene)}
            found = db.scene("s").conflicts()
            assert verdicts(found) == verdicts(expected.values()), step
            for one in found:
                assert one.periods == expected[one.a_key, one.b_key].periods
            assert db.scene("s").settings() == scene


def explained(conn: Conn, *keys: str) -> dict[str, Any]:
    with conn.transaction():
        (explanation,) = conn.execute("SELECT conflictdb.explain_conflict('s', %s, %s)", keys).fetchone() or ({},)
    return dict(explanation)


def ruled(conn: Conn, *rules: tuple[Any, ...]) -> None:
    for rule in rules:
        conn.execute(f"SELECT conflictdb.put_rule('s', {', '.join(['%s'] * len(rule))})", rule)


def test_the_database_refuses_as_python_does(conn: Conn) -> None:
    """Random rules, one by one: both refuse the same ones as ambiguous."""
    rng, refused = np.random.default_rng(1), 0
    sides = [None, "area", "track", "ferry", "submarine", "drone"]
    for round_ in range(12):
        conn.execute("SELECT conflictdb.create_scene(%s)", [f"s{round_}"])
        known: list[Rule] = []
        for _ in range(12):
            a, b = (sides[k] for k in rng.integers(0, len(sides), 2))
            if (a, b) == (None, None):
                continue
            rule = Rule(a, b, separation_m=float(rng.integers(3)))
            kept = [one for one in known if one.sides != rule.sides]
            try:
                Scene("s", rules=[*kept, rule])
                is_sound = True
            except ValueError:
                is_sound = False
            state = None
            try:
                with conn.transaction():
                    values = [f"s{round_}", a, b, rule.separation_m]
                    conn.execute("SELECT conflictdb.put_rule(%s, %s, %s, %s)", values)
            except psycopg.Error as error:
                state = error.sqlstate
            assert state == (None if is_sound else "ZC019"), (known, rule)
            known = [*kept, rule] if is_sound else known
            refused += not is_sound
    assert refused > 10


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (("x", None, "NaN"), "separation_m: must be a finite number"),
        (("x", None, -1), "separation_m: must be from 0 to 20000000 metres"),
        ((None, None, 1), "a_class: must name a class"),
        (("", "x", 1), "a_class: must be a text of 1 to 200 bytes"),
        (("x", "y", 5, None, None, True), "allowed: leaves no meaning"),
        (("x", "x", 5, None, None, False, "a"), "yields: must be 'a' or 'b', of two different sides"),
        (("x", "y", None, None, 1e9), "time_s: must be whole microseconds"),
    ],
)
def test_rules_that_mean_nothing_are_refused(conn: Conn, values: tuple[Any, ...], message: str) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    with pytest.raises(psycopg.Error, match=message):
        ruled(conn, values)


def test_removing_a_rule_that_two_others_need_is_refused(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    ruled(conn, ("ferry", "sub", 1), ("ferry", None, 2), (None, "sub", 3))
    with pytest.raises(psycopg.Error, match="alike with rule") as refused:
        conn.execute("SELECT conflictdb.remove_rule('s', 'sub', 'ferry')")
    assert "Enter a rule for 'ferry' with 'sub' first" in str(refused.value.diag.message_hint)
    conn.rollback()


def test_a_changed_rule_recomputes_only_its_pairs(dsn: str) -> None:
    """The pairs of pieces that a detection compares are those of the two classes."""
    rng = np.random.default_rng(8)
    tracks, areas = sea(rng, 300, 0.5)
    tracks = [replace(one, owner=None, max_speed_kn=np.inf) for one in tracks]
    areas = [replace(one, owner=None) for one in areas]
    with connect(dsn) as db:
        scene = Scene("s", separation_m=200.0)
        store.replace_scene(db.connection, scene, areas, tracks, merge=False)
        whole = detect(db.connection, "s", few_objects=-1)
        db.connection.execute("SELECT conflictdb.put_rule('s', 'ferry', 'drone', 900)")
        db.connection.commit()
        run = detect(db.connection, "s", few_objects=-1)
        mine = {one.key for one in [*tracks, *areas] if one.object_class in ("ferry", "drone")}
        assert run.opened > 0
        assert 0 < run.candidate_pairs < 0.25 * whole.candidate_pairs
        rows = db.connection.execute(
            "SELECT a_key, b_key FROM conflictdb.conflicts WHERE run_id = %s", [run.run_id]
        ).fetchall()
        db.connection.commit()
        assert rows
        assert all({a, b} <= mine for a, b in rows)
        alone = detect(db.connection, "s", full=True, few_objects=-1)
        assert (alone.opened, alone.changed, alone.closed) == (0, 0, 0)


def test_a_rule_writes_what_it_changes_and_leaves_no_more_than_before(dsn: str) -> None:
    """A pair that begins or ends has one event, other pairs none: 14,476 conflicts took 130 MB after a rule."""
    areas = """INSERT INTO conflictdb.area (scene_id, key, footprint)
               SELECT s.scene_id, 'A' || i, ST_Multi(ST_MakeEnvelope(
                   i % 20 * 0.02, i / 20 * 0.02, i % 20 * 0.02 + 0.021, i / 20 * 0.02 + 0.019, 4326))
               FROM conflictdb.scene s, generate_series(0, 399) i"""
    rows = "SELECT array_agg((ctid, xmin)::text ORDER BY conflict_id) FROM conflictdb.conflict WHERE conflict_id <= %s"
    events = "SELECT kind, count(*)::integer FROM conflictdb.conflict_event WHERE run_id = %s GROUP BY kind"
    pages = "SELECT pg_relation_size('conflictdb.conflict') / 8192, max(conflict_id) FROM conflictdb.conflict"
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.create_scene('s')")
        conn.execute(areas)
        first = detect(conn, "s", jobs=1)
        size, last = conn.execute(pages).fetchone() or (0, 0)
        before = conn.execute(rows, [last]).fetchone()
        opened = 0
        # At 10 m the same pairs meet, at 1 km also those of neighbouring rows and corners.
        for separation_m in (10, 1000, 20):
            conn.execute("SELECT conflictdb.put_rule('s', 'area', 'area', %s)", [separation_m])
            run = detect(conn, "s", jobs=1)
            expected = {"opened": run.opened, "changed": 0, "closed": opened}
            found = dict(conn.execute(events, [run.run_id]).fetchall())
            assert found == {kind: count for kind, count in expected.items() if count}
            assert (run.opened > first.opened) == (separation_m == 1000)
            opened = run.opened
            assert conn.execute(rows, [last]).fetchone() == before
        conn.execute("VACUUM conflictdb.conflict")
        assert conn.execute(pages).fetchone() == (size, last)


def test_explain_names_the_rule_and_who_yields(dsn: str) -> None:
    rng = np.random.default_rng(8)
    tracks, _ = sea(rng, 60, 0.2)
    tracks = [
        replace(
            one, owner=None, object_class=("ferry", "drone")[i % 2], floor_m=None, ceiling_m=None, max_speed_kn=np.inf
        )
        for i, one in enumerate(tracks)
    ]
    with connect(dsn) as db:
        rules = [Rule("drone", "ferry", 700.0, yields="a"), Rule("ferry", "ferry", allowed=True)]
        store.replace_scene(db.connection, Scene("s", rules=rules), [], tracks, merge=False)
        db.scene("s").detect()
        found = db.scene("s").conflicts()
        drones = {one.key for one in tracks if one.object_class == "drone"}
        one = next(one for one in found if len({one.a_key, one.b_key} & drones) == 1)
        explanation = explained(db.connection, one.a_key, one.b_key)
        assert explanation["rule"]["text"] == 'of "drone" with "ferry"'
        assert explanation["rule"]["yields"] == next(iter({one.a_key, one.b_key} & drones))
        ferries = [one.key for one in tracks if one.object_class == "ferry"][:2]
        explanation = explained(db.connection, *ferries)
        assert (explanation["verdict"], explanation["decided_by"]["by"]) == ("apart", "rule")
        assert not any({one.a_key, one.b_key}.isdisjoint(drones) for one in found)
        # A rule that fits in both orders does not choose.
        with db.connection.transaction():
            db.connection.execute("SELECT conflictdb.put_rule('s', 'drone', 'track', 700, p_yields => 'a')")
        db.scene("s").detect()
        pair = [one.key for one in tracks if one.object_class == "drone"][:2]
        assert "yields" not in explained(db.connection, *pair)["rule"]


def test_two_rules_of_areas_both_apply_to_two_areas(dsn: str) -> None:
    """Areas of both classes keep the larger distances; the rules of planners are entered."""
    rules = [
        Rule("ferry", "area", 500.0, vertical_m=40.0),
        Rule("submarine", "area", 900.0),
        Rule("escort", "area", allowed=True),
        Rule("area", "area", allowed=True),
    ]
    rng = np.random.default_rng(11)
    _, areas = sea(rng, 240, 0.4)
    areas = [replace(one, owner=None) for one in areas]
    scene = Scene("s", separation_m=100.0, vertical_separation_m=10.0, rules=rules)
    expected = verdicts(solve([], areas, scene))
    class_of = {one.key: one.object_class for one in areas}
    assert any({class_of[a], class_of[b]} == {"ferry", "submarine"} for a, b in expected)
    assert any({class_of[a], class_of[b]} == {"escort", "submarine"} for a, b in expected)
    with connect(dsn) as db:
        store.replace_scene(db.connection, scene, areas, [], merge=False)
        db.scene("s").detect()
        assert verdicts(db.scene("s").conflicts()) == expected
        pair = next(pair for pair in expected if {class_of[key] for key in pair} == {"ferry", "submarine"})
        explanation = explained(db.connection, *pair)["rule"]
        assert (explanation["text"], explanation["separation_m"], explanation["vertical_m"]) == (
            'of "submarine" with "area"',
            900.0,
            40.0,
        )
        pair = next(pair for pair in expected if {class_of[key] for key in pair} == {"escort", "submarine"})
        assert explained(db.connection, *pair)["rule"]["separation_m"] == 900.0


def test_two_sessions_do_not_enter_ambiguous_rules(conn: Conn, dsn: str) -> None:
    """The second session waits for the first, and sees its rule."""
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.commit()
    outcome: list[str | None] = []

    def enter() -> None:
        with psycopg.connect(dsn) as second:
            try:
                ruled(second, (None, "sub", 3))
                outcome.append(None)
            except psycopg.Error as error:
                outcome.append(error.sqlstate)

    ruled(conn, ("ferry", None, 2))
    waiting = threading.Thread(target=enter)
    waiting.start()
    waiting.join(0.3)
    assert waiting.is_alive()
    conn.commit()
    waiting.join()
    assert outcome == ["ZC019"]


def test_editors_change_rules_and_readers_do_not(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    with conn.transaction():
        conn.execute("SET LOCAL ROLE conflictdb_editor")
        conn.execute("SELECT conflictdb.put_rule('s', 'ferry', 'area', 500)")
        assert conn.execute("SELECT conflictdb.remove_rule('s', 'area', 'ferry')").fetchone() == (True,)
        conn.execute("SELECT conflictdb.put_rule('s', 'ferry', 'area', 500)")
    conn.execute("SET ROLE conflictdb_reader")
    with pytest.raises(psycopg.errors.InsufficientPrivilege), conn.transaction():
        conn.execute("SELECT conflictdb.put_rule('s', 'ferry', 'area', 600)")
    with conn.transaction():
        assert conn.execute("SELECT a_class, b_class, separation_m FROM conflictdb.rules").fetchall() == [
            ("ferry", "area", 500.0)
        ]


def test_a_copy_has_the_rules(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    ruled(conn, ("ferry", "area", 500), ("area", "area", None, None, None, True))
    conn.execute("SELECT conflictdb.copy_scene('s', 'c')")
    assert conn.execute("SELECT count(*) FROM conflictdb.rules WHERE scene = 'c'").fetchone() == (2,)


def test_conflicts_of_a_class_and_of_one_owner(dsn: str) -> None:
    rng = np.random.default_rng(8)
    tracks, areas = sea(rng, 90, 0.3)
    tracks = [replace(one, max_speed_kn=np.inf) for one in tracks]
    owner_of = {one.key: one.owner for one in [*tracks, *areas]}
    class_of = {one.key: one.object_class for one in [*tracks, *areas]}
    with connect(dsn) as db:
        store.replace_scene(db.connection, Scene("s", separation_m=2000.0), areas, tracks, merge=False)
        db.scene("s").detect()
        found = db.scene("s").conflicts()
        assert not any(owner_of[one.a_key] == owner_of[one.b_key] is not None for one in found)
        ferries = db.scene("s").conflicts(object_class="ferry")
        expected = [one for one in found if "ferry" in (class_of[one.a_key], class_of[one.b_key])]
        assert 0 < len(expected) < len(found)
        assert {(one.a_key, one.b_key) for one in ferries} == {(one.a_key, one.b_key) for one in expected}
        with db.connection.transaction():
            count = db.connection.execute("SELECT count(*) FROM conflictdb.conflicts_of_class('s', 'ferry')").fetchone()
        assert count == (len(expected),)
        may = verdicts(db.scene("s").conflicts()).keys()
        with db.connection.transaction():
            rows = db.connection.execute("SELECT a_key, b_key FROM conflictdb.candidates('s')").fetchall()
        assert may <= set(rows)
        assert not any(owner_of[a] == owner_of[b] is not None for a, b in rows)


def test_states_of_stored_objects_are_those_of_plans(dsn: str) -> None:
    """So that conflicts that were computed elsewhere are taken over, and not those of another class or owner."""
    tracks, areas = sea(np.random.default_rng(5), 60, 0.3)
    with connect(dsn) as db:
        store.replace_scene(db.connection, Scene("s"), areas, tracks, merge=False)
        states = store.object_states(db.connection, store.scene_id(db.connection, "s"))
    stored = dict(zip(states.key.tolist(), states.digest.tolist(), strict=True))
    digests = [*area_digests(AreaBatch.of(areas)).tolist(), *track_digests(TrackBatch.of(tracks)).tolist()]
    assert stored == dict(zip([one.key for one in [*areas, *tracks]], digests, strict=True))


def test_python_and_files_carry_rules(dsn: str) -> None:
    rules = [Rule("ferry", "area", 500.0), Rule("escort", "convoy", allowed=True), Rule("sub", None, yields="b")]
    with connect(dsn) as db:
        store.replace_scene(db.connection, Scene("s"), *reversed(sea(np.random.default_rng(1), 9, 0.1)), merge=False)
        for rule in rules:
            db.scene("s").put_rule(rule)
        assert set(db.scene("s").rules()) == set(rules)
        text = "".join(db.scene("s").text())
        assert set(read_scene(text, "x").scene.rules) == set(rules)
        assert db.scene("s").remove_rule("area", "ferry")
        assert not db.scene("s").remove_rule("area", "ferry")
        assert len(db.scene("s").rules()) == 2
        with pytest.raises(InvalidInput, match="alike"):
            db.scene("s").put_rule(Rule(None, "escort", 7.0))


def test_pairs_that_rules_allow_are_those_whose_most_specific_rule_does(conn: Conn) -> None:
    """Random rules, all pairs of types: the lookup of detections, and the rule that explain names."""
    rng, classes = np.random.default_rng(5), ["x", "y", "z", "w"]
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    sides, seen = [*classes, "area", "track", None], 0
    for number in range(25):
        conn.execute("SELECT conflictdb.create_scene(%s)", [f"s {number}"])
        for _ in range(12):
            a, b = (sides[int(rng.integers(len(sides)))] for _ in range(2))
            is_allowed = bool(rng.random() < 0.5)
            values = [f"s {number}", a, b, None if is_allowed else 5.0, None, None, is_allowed]
            with contextlib.suppress(psycopg.Error), conn.transaction():  # two rules that apply alike
                conn.execute("SELECT conflictdb.put_rule(%s, %s, %s, %s, %s, %s, %s)", values)
        rows = conn.execute(
            """
            SELECT _are_compared(a.kind, _word_number(a.class), b.kind, _word_number(b.class),
                                 _allowed_types(s.scene_id)),
                   (_rule_between(s.scene_id, a.kind, a.class, b.kind, b.class)).allowed
            FROM conflictdb.scene s,
                 (SELECT k::smallint AS kind, c AS class FROM generate_series(0, 1) k,
                         unnest(ARRAY['x', 'y', 'z', 'w', 'other', NULL]) c) a,
                 (SELECT k::smallint AS kind, c AS class FROM generate_series(0, 1) k,
                         unnest(ARRAY['x', 'y', 'z', 'w', 'other', NULL]) c) b
            WHERE s.name = %s""",
            [f"s {number}"],
        ).fetchall()
        assert len(rows) == 144
        assert all(is_compared is not (allowed is True) for is_compared, allowed in rows)
        seen += sum(allowed is True for _, allowed in rows)
    assert seen > 300


def test_the_lookup_of_allowed_pairs_grows_with_the_rules_alone(conn: Conn) -> None:
    """Two names for each of a thousand rules, with as many classes: not the pairs of all classes."""
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute(
        """INSERT INTO conflictdb.rule (scene_id, a_class, b_class, separation_m, allowed)
        SELECT s.scene_id, format('a%s', n), CASE WHEN n % 2 = 0 THEN format('b%s', n) END,
               CASE WHEN n % 2 = 0 THEN 5 END, n % 2 = 1
        FROM conflictdb.scene s, generate_series(1, 1000) n"""
    )
    [(names,)] = conn.execute(
        "SELECT count(*) FROM conflictdb.scene s, jsonb_each(conflictdb_internal._allowed_types(s.scene_id))"
    ).fetchall()
    assert names == 2000
