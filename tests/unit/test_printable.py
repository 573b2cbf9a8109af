"""Keys and names that attack a terminal or a spreadsheet are shown harmlessly, and come back unchanged."""

import csv
import json
import logging
from datetime import UTC, datetime
from io import StringIO
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conflictdb.cli import output
from conflictdb.cli.load_report import conflict_table, loaded_text, skipped_text
from conflictdb.cli.logs import Formatter
from conflictdb.client.loading import Loaded
from conflictdb.errors import InvalidInput, printable
from conflictdb.formats import Skipped, conflict_text
from conflictdb.formats.json_text import dumped
from conflictdb.model.methods import Method
from conflictdb.model.results import Conflict, Kind, Verdict
from conflictdb.store import LoadCounts

TITLE = "\x1b]0;owned\x07"
ATTACKS = [
    TITLE,
    "\x1b[2J",
    "\x9b2J",
    "a\nconflictdb: all is well",
    "a\rb",
    "\u202egnp.exe",
    "tab\there",
    "\x7f",
    "\x00",
    "\u2028",
]
FORMULAS = ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "＝1", "'=1", "''", "'"]  # noqa: RUF001
PLAIN = ["A1", "Firing area north", "Øst", "東京", "a=b", "1-2"]
NOW = datetime(2026, 3, 1, tzinfo=UTC)


def conflict(a_key: str, b_key: str = "B", scene: str = "s") -> Conflict:
    return Conflict(
        scene=scene,
        a_key=a_key,
        a_kind=Kind.AREA,
        b_key=b_key,
        b_kind=Kind.TRACK,
        periods=((NOW, NOW),),
        verdict=Verdict.CONFLICT,
        region=None,
        first_contact_deg=(4.0, 57.0),
        method=Method.EXACT,
        time_error_s=0.0,
        is_current=True,
        run_id=1,
        found_at=NOW,
        closest_at=NOW,
        closest_m=0.0,
        closest_error_m=0.0,
        closest_a_deg=None,
        closest_b_deg=None,
    )


def shown(text: str) -> bool:
    """Whether a terminal would only show it."""
    return all(line.isprintable() for line in text.split("\n"))


@pytest.mark.parametrize("attack", ATTACKS)
def test_messages_tables_and_logs_only_show(attack: str, capsys: pytest.CaptureFixture[str]) -> None:
    refused = str(InvalidInput(f"area {attack}", attack, f"must be {attack!r}", f"{attack}.geojson"))
    assert shown(refused)
    assert "\n" not in refused
    assert len(conflict_table([conflict(attack)]).split("\n")) == 2
    assert shown(conflict_table([conflict(attack)]))
    loaded = loaded_text(Loaded(attack, LoadCounts(1, 0, 0, 0), (), ()))
    skipped = skipped_text([Skipped(attack, attack, "no time", (1,), is_whole=True)])
    output.out(loaded)
    output.remark(attack)
    for line in skipped:
        output.remark(line)
    record = logging.LogRecord("conflictdb", logging.INFO, "", 1, "scene %s", (attack,), None)
    printed = capsys.readouterr()
    for text in (printed.out, printed.err, Formatter("%(message)s").format(record)):
        assert shown(text)


def test_what_prints_is_left_alone() -> None:
    for text in PLAIN:
        assert printable(text) == text
    assert printable("a\nb", keep="\n") == "a\nb"
    assert printable("a\nb") == r"a\nb"


@pytest.mark.parametrize("attack", ATTACKS)
def test_json_is_harmless_and_the_same_value(attack: str) -> None:
    for text in (dumped({attack: attack}), *conflict_text.as_json([conflict(attack)])):
        assert shown(text)
    (row,) = json.loads("".join(conflict_text.as_json([conflict(attack)])))
    assert row["a_key"] == attack
    assert json.loads(dumped({attack: attack})) == {attack: attack}


def read_back(text: str) -> list[dict[str, Any]]:
    return list(csv.DictReader(StringIO(text, newline="")))


@pytest.mark.parametrize("key", [*FORMULAS, *PLAIN])
def test_csv_holds_no_formula_and_gives_keys_back(key: str) -> None:
    """The documented rule: one leading apostrophe, taken away, leaves the key."""
    text = "".join(conflict_text.as_csv([conflict(key, key, key)], conflict_text.COLUMNS))
    (row,) = read_back(text)
    for column in ("scene", "a_key", "b_key"):
        assert row[column][0] not in "=+-@\t\r\n＝＋－＠"  # noqa: RUF001
        assert row[column].removeprefix("'") == key
    assert (row["a_key"] == key) == (key in PLAIN)


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1))
def test_csv_gives_every_key_back(key: str) -> None:
    assert conflict_text.cell(key).removeprefix("'") == key


def test_csv_on_a_terminal_only_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(StringIO):
        def isatty(self) -> bool:
            return True

    for stream, is_shown in ((Terminal(), True), (StringIO(), False)):
        monkeypatch.setattr("sys.stdout", stream)
        output.data(conflict_text.as_csv([conflict(TITLE)], conflict_text.COLUMNS), is_json=False)
        assert shown(stream.getvalue()) == is_shown
