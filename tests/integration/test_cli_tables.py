"""Every command that prints a table fits a terminal; in a pipe nothing is cut."""

import re
from collections.abc import Callable

import pytest
from commands import STRAIT, Run, runner

COMMANDS = [
    ("conflicts",),
    ("conflicts", "--tz", "Europe/Copenhagen"),
    ("conflicts", "--show", "position,microseconds,acknowledged"),
    ("detect",),
    ("approaches",),
    ("objects",),
    ("scenes",),
    ("status",),
    ("history",),
    ("explain", "FIRING", "FERRY"),
    ("delays", "--clear-within-m", "500"),
    ("delays", "TOW"),
    ("speeds",),
    ("speeds", "TOW"),
    ("advise", "--sample", "5"),
    ("probe", "--late", "FERRY", "20m"),
    ("probe", "--late", "FERRY", "20m", "--diff"),
    ("demo",),
    ("admin", "attachments"),
    ("admin", "share", "--scene", "strait"),
]


@pytest.fixture
def on_terminal(dsn: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[[int], Run]:
    """Return a function that returns one that runs commands on a terminal of a width."""

    def make(width: int) -> Run:
        monkeypatch.setattr("sys.stdout.isatty", lambda: True)
        monkeypatch.setenv("COLUMNS", str(width))
        return runner(dsn, capsys)

    return make


def width_of(text: str) -> int:
    return max(map(len, re.sub(r"\033\[\d+m", "", text).splitlines()))


def test_every_table_fits_a_terminal(run: Run, on_terminal: Callable[[int], Run]) -> None:
    run("detect", STRAIT, "--nearest-m", "5000")
    run("acknowledge", "FIRING", "FERRY", "--reason", "the range waits until the ferry has passed", "--by", "Anna")
    for width in (40, 80, 100):
        typed = on_terminal(width)
        for words in COMMANDS:
            done = typed(*words)
            assert done.code == 0, (words, done.err)
            # Commands and addresses to copy stay on one line.
            text = done.out.split("Try next:")[0].partition("workers ")[2 if words == ("status",) else 0]
            assert width_of(text) <= width, (width, words, done.out)


def test_no_table_is_cut_in_a_pipe(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """`COLUMNS`, which some shells export, is about the terminal."""
    run("detect", STRAIT)
    monkeypatch.setenv("COLUMNS", "40")
    for words in COMMANDS:
        assert "…" not in run(*words).out
    assert "Tug with a barge on a long line" in run("conflicts", "FERRY").out
    assert "Tug with a barge on a long line" in run("delays").out
