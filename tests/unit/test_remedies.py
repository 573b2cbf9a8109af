"""Advice for the command line: the hints of sql/ name routines of SQL, the messages of commands name commands."""

import re
import shlex
from pathlib import Path

import pytest

from conflictdb.cli import commands
from conflictdb.store.remedies import REMEDIES

SQL = Path(__file__).resolve().parents[2] / "sql"
# Parts of hints that only users of SQL can apply.
OF_SQL = re.compile(r"\b\w+\(|\bST_\w+|\bSELECT\b|\bview \w+|Give every,")
# Arguments that this package creates itself, and steps done in SQL also by users of commands: maps, settings, grants.
KEPT = {
    *("footprint_srid", "path_srid", "path_linestring_m", "outline_ring", "outlines_multipolygon", "outline_polygon"),
    *("path_trajectory", "path_speed_possible", "geometry_srid", "geometry_valid", "attached_srid", "map_expression"),
    *("limit_is_number", "attached_readable", "attached_whole", "attached_schema_owned", "attached_given_away"),
}


def arguments(call: str) -> list[str]:
    """Split the arguments of a call of SQL at the commas that separate them."""
    found, depth, is_text = [""], 0, False
    for character in call:
        is_text ^= character == "'"
        depth += 0 if is_text else (character in "([") - (character in ")]")
        if character == "," and depth == 0 and not is_text:
            found.append("")
        else:
            found[-1] += character
    return [" ".join(one.split()) for one in found]


def hints() -> list[tuple[str, str]]:
    """Return constraint and hint of everything that sql/ raises."""
    code = "".join(re.sub(r"^ *--.*", "", file.read_text(), flags=re.MULTILINE) for file in sorted(SQL.iterdir()))
    calls = [arguments(call) for call in re.findall(r"FOUND := _raise\((.*?)\);\n", code, re.DOTALL)]
    notices = re.findall(r"RAISE NOTICE [^;]*?USING ([^;]*?)HINT = ('.*?);\n", code, re.DOTALL)
    named = [(re.search(r"CONSTRAINT = ('\w+')", using), hint) for using, hint in notices]
    assert len(calls) > 100
    found = [(call[4], call[5]) for call in calls if len(call) > 5]
    found += [(constraint[1] if constraint else "''", hint) for constraint, hint in named]
    return [(constraint.strip("'"), hint) for constraint, hint in found]


def test_a_hint_of_sql_has_a_remedy_for_everybody_else() -> None:
    of_sql = {constraint for constraint, hint in hints() if OF_SQL.search(" ".join(re.findall("'[^']*'", hint)))}
    # The notice without a constraint goes with answers of SQL; this package warns of them itself.
    assert of_sql - KEPT - {""} - set(REMEDIES) == set()
    assert set(REMEDIES) <= {constraint for constraint, _ in hints()}
    assert not any(OF_SQL.search(text) for text in REMEDIES.values())


@pytest.mark.parametrize("constraint", [name for name, text in REMEDIES.items() if "`" in text])
def test_a_remedy_names_a_command_that_there_is(constraint: str) -> None:
    found = re.findall(r"`conflictdb ([^`]*)`", REMEDIES[constraint])
    assert found
    for command in found:
        commands.build().parse_args(shlex.split(command))


def test_a_refusal_is_no_statement_of_its_own() -> None:
    """PERFORM would add its source to the CONTEXT of the error."""
    assert [file.name for file in SQL.iterdir() if re.search(r"(PERFORM|SELECT) _raise\(", file.read_text())] == []
