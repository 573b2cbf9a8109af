"""Each public routine refuses numbers that no plan has in one clear sentence, not by an error of arithmetic."""

import json
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import psycopg
import pytest
from patience import WAIT_S

from conflictdb.jobs import probes

Conn = psycopg.Connection[Any]

# Values by type of a parameter; also each as the only member of an array.
HOSTILE = {
    "double precision": ["NaN", "Infinity", "-Infinity", "1e30", "-1e30", "1e308", "-1", "1e-320", None],
    "interval": ["-1 s", "-178000000 years", "178000000 years", "0", None],
    "timestamp with time zone": ["infinity", "-infinity", "4713-01-01 BC", "294276-12-31", None],
    "tstzrange": ["(,)", "empty", "[-infinity,infinity]", "[4713-01-01 BC,294276-12-31)", "[infinity,infinity]", None],
    "bigint": ["9223372036854775807", "-9223372036854775808", "-1", "0", None],
    "integer": ["2147483647", "-2147483648", "-1", "0", None],
}
# The same in JSON, as text: Python would round some of them.
NUMBERS = ["1e30", "-1e30", "1e400", "-1", "1e-400", "0.5", '"x"', '"NaN"', "null", "[]", "{}", "true", "9" * 5000]
FOOTPRINT = "SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))"
PATH = "SRID=4326;LINESTRING M (0 0 1893456000, 1 1 1893542400)"
HAVEN = "POLYGON((-50 -50, 50 -50, 50 50, -50 -50))"
# Valid values by name of a parameter, else by its type.
NAMED: dict[str, Any] = {
    "p_scene": "s", "p_key": "T", "p_a_key": "A", "p_b_key": "B", "p_branch": "b", "p_path": PATH, "p_outline": HAVEN,
    "p_table": "conflictdb.run", "p_map": "{}", "p_kind": "area", "p_step": "1 day",
}  # fmt: skip
VALID: dict[str, Any] = {
    "bigint": "1", "double precision": "1", "integer": "1", "interval": "1 s", "tstzrange": "(,)",
    "timestamp with time zone": "2030-01-01", "geometry": FOOTPRINT,
}  # fmt: skip
TRACK: dict[str, Any] = {
    "type": "Feature",
    "version": 1,
    "id": "P",
    "geometry": {"type": "LineString", "coordinates": [[0, 0], [1, 1]]},
    "properties": {
        "times": ["2030-01-01T00:00Z", "2030-01-02T00:00Z"],
        "outline_m": [[-50, -50], [50, -50], [50, 50]],
    },
}
MEMBERS = [
    "floor_m", "ceiling_m", "grow_mps", "xtd_port_m", "min_speed_kn", "max_speed_kn", "turn_radius_m", "speed_kn",
    "times", "departures", "outline_m", "outlines_m", "fore_m", "schedule", "departure_window", "spans", "start",
    "class",
]  # fmt: skip
# SQLSTATEs of the server for a parameter that names no table, or an object of another kind.
OWN_WORDS = {"42P01", "42809"}


@pytest.fixture
def scene(conn: Conn) -> Conn:
    conn.execute("SELECT conflictdb.create_scene('s')")
    for key in "AB":
        conn.execute("SELECT conflictdb.put_area('s', %s, %s)", [key, FOOTPRINT])
    conn.execute("SELECT conflictdb.put_track('s', 'T', %s, %s)", [PATH, HAVEN])
    conn.execute("SELECT conflictdb.create_branch('s', 'b')")
    conn.commit()
    return conn


def calls(conn: Conn) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each call of a public routine with one hostile value, the others being valid or by default."""
    routines = conn.execute(
        """SELECT p.proname, p.proargnames[1:p.pronargs], p.pronargs - p.pronargdefaults,
                  ARRAY(SELECT format_type(t, NULL) FROM unnest(p.proargtypes) WITH ORDINALITY u (t, n) ORDER BY n)
           FROM pg_proc p WHERE p.pronamespace = 'conflictdb'::regnamespace AND p.prorettype <> 'trigger'::regtype
           ORDER BY 1"""
    ).fetchall()
    for routine, names, needed, types in routines:
        parameters = list(zip(names or [], types, strict=True))
        valid = {name: NAMED.get(name, VALID.get(kind, "x")) for name, kind in parameters[:needed]}
        for name, kind in parameters:
            values = HOSTILE.get(kind.removesuffix("[]"), [])
            if kind.endswith("[]"):
                values = [f'{{"{value}"}}' if value is not None else "{NULL}" for value in values]
            given = ", ".join(f"{one} => %({one})s::{of}" for one, of in parameters if one in valid or one == name)
            for value in values:
                yield f"SELECT count(*) FROM conflictdb.{routine}({given})", {**valid, name: value}


def said(conn: Conn, statement: str, given: Any) -> tuple[str, str]:
    """Return SQLSTATE and message of a statement, which is rolled back; "00000" if it succeeds."""
    try:
        # Some wait for what nobody does.
        conn.execute(f"SET LOCAL statement_timeout = '{0.2 if 'wait_' in statement else WAIT_S:g} s'".encode())
        conn.execute(statement.encode(), given)
    except psycopg.Error as error:
        return error.sqlstate or "none", error.diag.message_primary or str(error)
    finally:
        conn.rollback()
    return "00000", ""


def is_clear(state: str) -> bool:
    return state == "00000" or state.startswith("ZC") or state in OWN_WORDS


def test_each_number_of_each_routine(scene: Conn) -> None:
    wrong, count, refused = [], 0, 0
    for statement, given in list(calls(scene)):
        state, message = said(scene, statement, given)
        count += 1
        refused += state.startswith("ZC")
        waits = "wait_" in statement and state == "57014"
        if not is_clear(state) and not waits:
            wrong.append((statement, given, state, message))
    assert wrong == []
    assert count > 500
    assert refused > 200


@pytest.mark.parametrize("option", ["now_us", "horizon_s"])
@pytest.mark.parametrize("number", NUMBERS)
def test_each_number_of_a_question_about_departures(scene: Conn, option: str, number: str) -> None:
    ask = "INSERT INTO conflictdb.probe_request (scene_id, kind, options) SELECT scene_id, 'delays', %s FROM "
    options = {"key": '"T"', "horizon_s": "60", option: number}
    text = "{" + ", ".join(f'"{name}": {value}' for name, value in options.items()) + "}"
    state, message = said(scene, ask + "conflictdb.scene WHERE name = 's'", [text])
    assert is_clear(state), message
    assert len(message) < 300
    if number in ("1e30", "-1e30", "1e400", "9" * 5000):
        assert state == "ZC003"
        assert message.startswith(f"what is asked about: {option}: must be ")


@pytest.mark.parametrize("number", NUMBERS)
def test_each_number_of_a_plan(scene: Conn, number: str) -> None:
    """In SQL and by a worker: it is read or refused, in a sentence that names the member."""
    for member in [*MEMBERS, "coordinates", "coordinate"]:
        plan = deepcopy(TRACK)
        if member == "coordinates":
            plan["geometry"]["coordinates"] = ["?"]
        elif member == "coordinate":
            plan["geometry"]["coordinates"][1][0] = "?"
        else:
            plan["properties"][member] = "?"
        if member == "fore_m":
            del plan["properties"]["outline_m"]
            plan["properties"] |= {"aft_m": 1, "port_m": 1, "starboard_m": 1}
        text = json.dumps([plan]).replace('"?"', number)
        state, message = said(scene, "SELECT conflictdb.admit('s', %s)", [text])
        assert is_clear(state), (member, state, message)
        assert len(message) < 500, member
        scene.execute("SELECT conflictdb.request_plans_probe('s', %s)", [text])
        scene.commit()
    while probes.answer(scene):
        pass
    answers = "SELECT error, attempts FROM conflictdb.probe_request WHERE error IS NOT NULL OR attempts > 1"
    for error, attempts in scene.execute(answers.encode()):
        assert attempts == 1, error
        assert "Traceback" not in error
        assert len(error) < 500
    assert scene.execute("SELECT count(*) FROM conflictdb.probe_request WHERE answered_at IS NULL").fetchone() == (0,)
