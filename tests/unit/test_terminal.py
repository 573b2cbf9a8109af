"""Output on a terminal: progress with estimates, tables that fit, colours; and no colours elsewhere."""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from io import StringIO
from types import SimpleNamespace
from typing import Any

import pytest
from patience import WAIT_S

from conflictdb import Conflict
from conflictdb.cli import meter, output, tables
from conflictdb.cli.load_report import conflict_table, scene_table
from conflictdb.model.methods import Method
from conflictdb.model.results import Kind, Verdict

START = datetime(2026, 6, 1, 9, tzinfo=UTC)
RED, RESET = "\033[31m", "\033[0m"


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], tuple[Terminal, Terminal]]:
    """Return a function that makes standard output and standard error terminals of a width."""

    def make(columns: int) -> tuple[Terminal, Terminal]:
        streams = Terminal(), Terminal()
        monkeypatch.setattr("sys.stdout", streams[0])
        monkeypatch.setattr("sys.stderr", streams[1])
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.delenv("NO_COLOR", raising=False)
        return streams

    return make


def conflict(a_key: str = "AREA", verdict: Verdict = Verdict.CONFLICT) -> Conflict:
    return Conflict(
        scene="bay", a_key=a_key, a_kind=Kind.AREA, b_key="FERRY", b_kind=Kind.TRACK, periods=((START, START),),
        verdict=verdict, method=Method.EXACT, time_error_s=0.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (("storing 200,000 objects", 0, 0, 149.2), "storing 200,000 objects, 2 min 29 s so far"),
        (("preparing objects", 50_000, 200_000, 10.0), "preparing objects: 50,000 of 200,000, about 30 s left"),
        (("preparing objects", 100, 200_000, 3.0), "preparing objects: 100 of 200,000, 3 s so far"),
        (("reading objects", 5_000, 0, 3.0), "reading objects: 5,000, 3 s so far"),
        (("solving pairs", 7, 7, 9.0), "solving pairs: 7 of 7, about 0 s left"),
        (("solving pairs", 1, 10, 900.0), "solving pairs: 1 of 10, about 2 h 15 min left"),
        (("preparing objects", 30, 20, 2.0), "preparing objects: 30 of 20, about 0 s left"),
    ],
)
def test_a_phase_says_how_long_it_will_last(given: tuple[str, int, int, float], text: str) -> None:
    assert meter.phase_text(*given) == text


def test_long_phases_are_shown_and_short_ones_are_not(
    terminal: Callable[[int], tuple[Terminal, Terminal]], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, err = terminal(80)
    clock_s = [0.0]
    monkeypatch.setattr(meter, "time", SimpleNamespace(monotonic=lambda: clock_s[0]))
    with meter.shown_phases({"long": 100}, after_s=2.0, every_s=0.01) as phase:
        phase("short", 0, 0)
        clock_s[0] = 1.9
        phase("long", 50, 0)
        clock_s[0] = 4.0
        until = time.monotonic() + WAIT_S
        while "long" not in err.getvalue() and time.monotonic() < until:
            time.sleep(0.01)
        output.remark("in between")
    assert "short" not in err.getvalue()
    assert re.search(r"\r\033\[Klong: 50 of 100, about \d+ s left", err.getvalue())
    assert "\r\033[Kconflictdb: in between\n" in err.getvalue()
    assert err.getvalue().endswith("\r\033[K")


def test_a_pipe_gets_no_progress(capsys: pytest.CaptureFixture[str]) -> None:
    with meter.shown_phases(after_s=0.0) as phase:
        phase("long", 0, 0)
    assert capsys.readouterr() == ("", "")


def test_tables_fit_a_terminal_and_stay_whole_in_a_pipe(
    terminal: Callable[[int], tuple[Terminal, Terminal]],
) -> None:
    whole = conflict_table([conflict("K" * 100)])
    assert max(map(len, whole.splitlines())) > 150
    out, _ = terminal(100)
    tables.show_table(conflict_table([conflict("K" * 100), conflict()]))
    lines = re.sub(r"\033\[\d+m", "", out.getvalue()).splitlines()
    assert max(map(len, lines)) == 100
    assert lines[1].startswith("KKKKKKKKKKKK")
    assert "…KKKKKKKKKK  FERRY" in lines[1]
    assert lines[1].endswith("2026-06-01 09:00:00  2026-06-01 09:00:00        1")
    assert lines[0].index("VERDICT") == lines[1].index("conflict") == lines[2].index("conflict")


def test_names_are_the_last_columns_and_give_way_first(
    terminal: Callable[[int], tuple[Terminal, Terminal]],
) -> None:
    """On a terminal with some room they are cut, with none they are left out, and said to be; the rest stays whole."""
    named = replace(conflict("PIER"), a_name="Pier, out of order", b_name="The ferry to the north and back")
    wide = conflict_table([named, conflict()]).splitlines()
    assert wide[1].endswith("  1  Pier, out of order  The ferry to the north and back")
    assert "NAME" not in conflict_table([conflict()])
    for width, end in ((100, "  1  Pier, ou…der  The ferr…ack"), (96, "  1  Pier, …der  The fe…ack"), (95, "  1")):
        out, _ = terminal(width)
        tables.show_table(conflict_table([named, conflict()]))
        lines = re.sub(r"\033\[\d+m", "", out.getvalue()).splitlines()
        line = lines[1]
        assert (lines[-1] == "(no room for A NAME, B NAME)") == (width == 95)
        assert len(line) <= width
        assert line.startswith("PIER")
        assert "2026-06-01 09:00:00  2026-06-01 09:00:00" in line
        assert line.endswith(end)


def shown(width: int, terminal: Callable[[int], tuple[Terminal, Terminal]], **options: Sequence[str]) -> list[str]:
    """Return the lines of a table with a name, a time and a number."""
    terminal(width)
    header = ["KEY", "AT THIS TIME", "NAME", "METRES"]
    rows = [["K1", "2026-06-01 09:00:00", "Øresund, 水道 east of the island", 12]]
    return tables.table(header, rows, right=["METRES"], whole=["AT THIS TIME"], **options).splitlines()


def test_a_table_loses_the_least_that_makes_it_fit(terminal: Callable[[int], tuple[Terminal, Terminal]]) -> None:
    """Text is shortened before times wrap; before either would be too narrow, each row is a block that has it all."""
    assert shown(80, terminal)[1:] == ["K1   2026-06-01 09:00:00  Øresund, 水道 east of the island      12"]
    assert shown(56, terminal)[1:] == ["K1   2026-06-01 09:00:00  Øresund, 水道 … island      12"]
    assert shown(36, terminal) == [
        "KEY  AT THIS     NAME         METRES",
        "     TIME",
        "K1   2026-06-01  Øresund…and      12",
        "     09:00:00",
    ]
    assert shown(30, terminal) == [
        "KEY           K1",
        "AT THIS TIME  2026-06-01",
        "              09:00:00",
        "NAME          Øresund, 水道",
        "              east of the",
        "              island",
        "METRES        12",
    ]
    assert shown(36, terminal, extra=["NAME"])[-1] == "(no room for NAME)"


@pytest.mark.parametrize("width", [26, 27, 28, 33, 40, 60])
def test_no_line_is_wider_than_the_terminal(
    width: int, terminal: Callable[[int], tuple[Terminal, Terminal]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if words are longer than the room, and if characters are two columns wide."""
    for options in ({}, {"extra": ["NAME"]}):
        assert max(map(tables._width, shown(width, terminal, **options))) <= width
    terminal(width)
    lines = tables.table(["KEY", "NAME"], [["K" * 99, "水" * 99]], whole=["KEY", "NAME"]).splitlines()
    assert max(map(tables._width, lines)) <= width
    assert "".join(lines).count("水") == 99
    assert max(map(len, tables.wrapped(f"  {'word ' * 40}{'w' * 100}").splitlines())) <= width
    monkeypatch.setattr("sys.stdout", StringIO())
    assert tables.table(["KEY"], [["K" * 99]]) == f"KEY\n{'K' * 99}"


def test_verdicts_have_colours_on_a_terminal(
    terminal: Callable[[int], tuple[Terminal, Terminal]], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, _ = terminal(120)
    tables.show_table(conflict_table([conflict(verdict=one) for one in Verdict]))
    text = out.getvalue()
    assert f"{RED}conflict{RESET}" in text
    assert len(set(re.findall(r"\033\[\d+m", text))) == 5
    monkeypatch.setenv("NO_COLOR", "1")
    assert RED not in "".join(conflict_table([conflict()]))
    plain = conflict_table([conflict()])
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "dumb")
    assert conflict_table([conflict()]) == plain


def test_a_key_cannot_colour_anything(terminal: Callable[[int], tuple[Terminal, Terminal]]) -> None:
    out, _ = terminal(120)
    tables.show_table(conflict_table([conflict("\ue000evil\ue00f\033[2J")]))
    assert "\\ue000evil\\ue00f\\x1b[2J" in out.getvalue()
    assert out.getvalue().count(RED) == 1
    assert "\033[2J" not in out.getvalue()


def test_a_scene_is_one_line_of_eighty_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run and time go first, and are named below."""
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setattr(tables, "_room", lambda: 80)
    one: Any = SimpleNamespace(
        scene=SimpleNamespace(name="a scene with a long name"), areas=120, tracks=4000, pending=0, conflicts=123_456,
        run_id=12_345, finished_at=START, error=None, branch_of="skagerrak tomorrow",
    )  # fmt: skip
    lines = scene_table([one, one]).splitlines()
    assert len(lines) == 4
    assert max(map(len, lines)) <= 80
    assert lines[-1] == "(no room for RUN, FINISHED (UTC))"
