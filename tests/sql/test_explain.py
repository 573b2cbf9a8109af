"""explain_conflict reports the known facts of a pair and the stage that decided it, or that they are not known."""

from typing import Any

import psycopg
import pytest
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from piecework import load
from scenes import T0_US, box, sail

from conflictdb import connect, delays
from conflictdb.jobs import detect
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Verdict
from conflictdb.model.rules import Rule

Conn = psycopg.Connection[Any]
HOUR_US = 3_600_000_000
HOSTILE = "a'b\"c\n\x1b[31m \\ é"


def explained(conn: Conn, a: str, b: str) -> dict[str, Any]:
    row = conn.execute("SELECT conflictdb.explain_conflict('s', %s, %s)", [a, b]).fetchone()
    assert row is not None
    return dict(row[0])


PAIRS = {
    # of the track T, from (0, 0) eastward to (1, 0)
    "meets": (box("X", 0.4, -0.1, 0.6, 0.1), "conflict", 4, "their motion"),
    "later": (box("X", 0.4, -0.1, 0.6, 0.1, start_us=T0_US + 9 * HOUR_US), "apart", 1, "time"),
    "above": (box("X", 0.4, -0.1, 0.6, 0.1, floor_m=50.0), "apart", 1, "height"),
    "elsewhere": (box("X", 0.4, 2.0, 0.6, 3.0), "apart", 1, "space"),
    "gone before it comes": (
        box("X", 0.9, -0.1, 0.95, 0.1, start_us=T0_US, end_us=T0_US + HOUR_US // 20),
        "apart", 1, "space, time and height together",
    ),
    "behind": (sail("X", (-0.02, 0.0), (0.98, 0.0)), "apart", 4, "their motion"),
    "near": (box("X", 0.4, 0.0025, 0.6, 0.1), "near", 4, "their motion"),
}  # fmt: skip
# Pairs of pieces decided in closed form, and their total.
CLOSED = {"meets": (2, 2), "behind": (2, 3), "near": (2, 2)}


@pytest.mark.parametrize("case", PAIRS)
def test_pairs_are_decided_by_what_keeps_them_apart(conn: Conn, case: str) -> None:
    other, verdict, stage, by = PAIRS[case]
    areas = [other] if isinstance(other, Area) else []
    tracks = [sail("T", (0.0, 0.0), (1.0, 0.0), ceiling_m=40.0), *([other] if isinstance(other, Track) else [])]
    load(conn, Scene("s", tolerance_m=0.001, nearest_m=100.0 if verdict == "near" else 0.0), areas, tracks)
    before = explained(conn, "T", "X")
    conn.commit()
    assert (before["verdict"], before["is_current"], before["decided_by"]) == ("unknown", False, None)
    assert before["why"] == "the scene was never detected"
    detect.detect(conn, "s", jobs=1)
    facts = explained(conn, "T", "X")
    assert (facts["verdict"], facts["is_current"]) == (verdict, True)
    assert facts["decided_by"] == {"stage": stage, "by": by}
    assert facts == explained(conn, "X", "T")
    assert (facts["closest"] is not None) == (verdict in ("conflict", "near"))
    conn.rollback()
    with connect(conn) as db:
        explanation = db.scene("s").explain("X", "T")
    assert (explanation.facts["closest"] is None) == (by in ("time", "height"))
    assert explanation.facts["are_never_together"] == (explanation.facts["closest"] is None)
    # The database does not store which pairs were decided in closed form: Python solves the pair again.
    closed, of = CLOSED.get(case, (0, 0))
    decided = {"stage": 3 if closed == of > 0 and verdict != "near" else stage, "by": by}
    if closed:
        facts["stages"][2]["says"] = f"{closed} of {of} pairs of pieces decided in closed form"
        facts["stages"][3]["says"] = verdict if decided["stage"] == 4 else "not asked: nothing was left"
    each = delays(tracks, areas, Scene("s", tolerance_m=0.001))
    assert explanation.facts == facts | {
        "delays": [one.as_json() for one in each],
        "closest": explanation.facts["closest"],
        "are_never_together": explanation.facts["closest"] is None,
        "decided_by": decided,
    }
    assert explanation.text.splitlines()[-len(each) - 1] == "  if only one of these two departs at another time:"
    assert f"decided by stage {decided['stage']}: {by}" in explanation.text
    assert ("closest: never there at the same time and height" in explanation.text) == (
        explanation.facts["closest"] is None
    )
    if case == "elsewhere":
        # From 500 m ahead of the equator's track to 2 degrees north: the track's side is 200 m north of the equator.
        assert explanation.facts["closest"]["m"] == pytest.approx(221_149.4 - 200.0, abs=1.0)
        assert explanation.facts["closest"]["error_m"] < 0.001
        assert "closest: 220949." in explanation.text
    conn.execute("UPDATE conflictdb.track SET ceiling_m = 39 WHERE key = 'T'")
    after = explained(conn, "T", "X")
    assert (after["is_current"], after["waiting"].startswith('"T" changed')) == (False, True)
    assert after["verdict"] == ("unknown" if verdict == "apart" else verdict)
    ((text,),) = conn.execute("SELECT conflictdb.explain_conflict_text('s', 'T', 'X')").fetchall()
    assert text.splitlines()[0].endswith(f": {after['verdict']}")
    assert 'not current: "T" changed' in text


@pytest.mark.parametrize("method", list(Method))
def test_every_pair_is_explained_as_it_is_reported(conn: Conn, method: Method) -> None:
    """A pair without a conflict is apart, and the stage that decided left nothing of it."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 7, 6, 6)
    scene = Scene("s", method=method)
    load(conn, scene, areas, tracks)
    detect.detect(conn, "s", jobs=1)
    with connect(conn) as db:
        found = {frozenset((one.a_key, one.b_key)): one.verdict for one in db.scene("s").conflicts()}
        decides = method is not Method.SCREEN
        assert all(
            (one.verdict != Verdict.UNRESOLVED) == (decides or one.b_kind == "area")
            for one in db.scene("s").conflicts()
        )
        keys = [one.key for one in (*areas, *tracks)]
        apart_by = set()
        for i, a in enumerate(keys):
            for b in keys[:i]:
                facts = db.scene("s").explain(a, b).facts
                assert facts["verdict"] == found.get(frozenset((a, b)), "apart")
                left = [facts["stages"][k]["left"] for k in (0, 1)]
                if facts["verdict"] == "apart":
                    apart_by.add(facts["decided_by"]["stage"])
                    assert [count > 0 for count in left] == [facts["decided_by"]["stage"] > k for k in (1, 2)]
                else:
                    assert left[1] > 0
                assert len(facts["pieces"]) + facts["pieces_not_listed"] == left[1]
    assert found
    assert 1 in apart_by


def test_hostile_keys_and_sessions_change_nothing(conn: Conn) -> None:
    load(conn, Scene("s"), [box(HOSTILE, 0.4, -0.1, 0.6, 0.1)], [sail("T", (0.0, 0.0), (1.0, 0.0))])
    detect.detect(conn, "s", jobs=1)
    say = "SELECT conflictdb.explain_conflict_text('s', 'T', %s)"
    plain = conn.execute(say, [HOSTILE]).fetchone()
    conn.execute("SET DateStyle = 'SQL, DMY'; SET TimeZone = 'Asia/Kolkata'; SET IntervalStyle = 'iso_8601'")
    conn.execute("SET extra_float_digits = -10")
    explanation = conn.execute(say, [HOSTILE]).fetchone()
    assert explanation is not None
    assert explanation == plain
    assert "\x1b" not in explanation[0]
    assert explanation[0].splitlines()[0].endswith('(area) and "T" (track): conflict')


def test_a_row_of_an_attached_table_that_waits_makes_it_unknown(conn: Conn) -> None:
    load(conn, Scene("s"), [], [sail("T", (0.0, 0.0), (1.0, 0.0)), sail("U", (0.0, 5.0), (1.0, 5.0))])
    detect.detect(conn, "s", jobs=1)
    conn.execute("CREATE TABLE ops (id text PRIMARY KEY, shape geometry)")
    mapped = '{"key": "id", "footprint": "shape"}'
    conn.execute("SELECT conflictdb.attach('s', 'area', 'ops', %s)", [mapped])
    conn.commit()
    facts = explained(conn, "T", "U")
    assert (facts["verdict"], facts["why"]) == ("unknown", "changes of an attached table wait to be taken over")


def test_pairs_with_rules_are_explained_with_their_own_separations(conn: Conn) -> None:
    rules = [
        Rule("wide", "wide", 800.0),
        Rule("narrow", "narrow", 50.0),
        Rule("high", "high", vertical_m=300.0),
        Rule("low", "low", vertical_m=100.0),
        Rule("late", "late", time_s=600.0),
        Rule("early", "early", time_s=60.0),
        Rule("escort", "escort", allowed=True),
        Rule("mine", "mine", 800.0),
    ]
    # Degrees to the north, metres higher, seconds later, owner. 0.009 degrees: 595 m between havens of 400 m.
    pairs = {
        "wide": (0.009, 0.0, 0, None),
        "narrow": (0.009, 0.0, 0, None),
        "high": (0.0, 200.0, 0, None),
        "low": (0.0, 200.0, 0, None),
        "late": (0.0, 0.0, 300, None),
        "early": (0.0, 0.0, 300, None),
        "escort": (0.009, 0.0, 0, None),
        "mine": (0.009, 0.0, 0, "me"),
        "none": (0.009, 0.0, 0, None),
    }
    tracks = [
        sail(
            f"{name} {'ab'[k]}",
            (0.0, row + k * north),
            (1.0, row + k * north),
            start_us=T0_US + k * later_s * 1_000_000,
            floor_m=k * higher_m,
            ceiling_m=k * higher_m + 50.0,
            object_class=name,
            owner=owner,
        )
        for row, (name, (north, higher_m, later_s, owner)) in enumerate(pairs.items())
        for k in (0, 1)
    ]
    scene = Scene("s", separation_m=100.0, vertical_separation_m=20.0, rules=rules)
    load(conn, scene, [], tracks)
    detect.detect(conn, "s", jobs=1)
    conn.commit()
    with connect(conn) as db:
        found = {(one.a_key, one.b_key) for one in db.scene("s").conflicts()}
        explanations = {name: db.scene("s").explain(f"{name} a", f"{name} b") for name in pairs}
    for name, one in explanations.items():
        assert ((f"{name} a", f"{name} b") in found) == (one.facts["verdict"] == "conflict"), name
        rule = None if name in ("none", "mine") else f'of "{name}" with "{name}"'
        assert (one.facts["rule"] or {}).get("text") == rule
        assert ("  rule " in one.text) == (rule is not None)
        assert ("never there at the same time" in one.text) == (name == "low"), name
    assert found == {(f"{name} a", f"{name} b") for name in ("wide", "high", "late")}
    assert "  they come closer than the required 800 m\n" in explanations["wide"].text
    assert '  rule of "wide" with "wide": separation 800 m\n' in explanations["wide"].text
    assert explanations["narrow"].facts["decided_by"]["stage"] in (1, 2, 4)
    assert "  they come closer than the required 100 m\n" in explanations["high"].text
    assert "vertical 300 m" in explanations["high"].text
    assert (
        "  one is between 0 and 50 m, the other between 200 and 250 m: 100 m or more apart\n"
        in explanations["low"].text
    )
    assert "10 min are required" in explanations["late"].text
    assert explanations["early"].facts["verdict"] == "apart"
    assert '  not compared: the rule of "escort" with "escort" allows it\n' in explanations["escort"].text
    assert '  not compared: both are of owner "me"\n' in explanations["mine"].text
    for name in ("escort", "mine", "none"):
        assert explanations[name].facts["closest"]["m"] == pytest.approx(595.2, abs=1.0)
