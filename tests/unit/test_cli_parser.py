"""Every command and option has help and is documented; values are checked before anything is started."""

import argparse
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from conflictdb.cli import codes
from conflictdb.cli.parser import FORMATS, build, count, duration_s, instant, metres, speed_kn
from conflictdb.methods import Method

DOCUMENT = Path(__file__).parents[2] / "docs" / "reference" / "cli.md"


def commands(parser: argparse.ArgumentParser, path: str = "") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield path, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield from commands(command, f"{path} {name}".strip())


def sections() -> dict[str, str]:
    """Return the text of docs/reference/cli.md by command; several commands may share a section."""
    found: dict[str, str] = {}
    for part in DOCUMENT.read_text().split("\n## "):
        title, _, text = part.partition("\n")
        for name in title.split(", "):
            found[name] = text
    return found


ALL = dict(commands(build()))


@pytest.mark.parametrize("path", [path for path in ALL if path])
def test_every_command_is_documented_and_has_help(path: str) -> None:
    assert ALL[path].description
    assert f"`{path}`" in DOCUMENT.read_text() or f"`conflictdb {path}" in DOCUMENT.read_text()


@pytest.mark.parametrize("path", list(ALL))
def test_every_option_is_documented_and_has_help(path: str) -> None:
    text = sections()[path.split()[0]] if path else DOCUMENT.read_text()
    for action in ALL[path]._actions:
        if isinstance(action, argparse._HelpAction | argparse._SubParsersAction):
            continue
        assert action.help, action
        name = action.option_strings[-1] if action.option_strings else str(action.metavar)
        assert f"`{name}" in text, f"{path} {name}"


@pytest.mark.parametrize("path", list(ALL))
def test_help_can_be_shown(path: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        build().parse_args([*path.split(), "--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: conflictdb {path}".strip())


@pytest.mark.parametrize("path", list(ALL))
def test_choices_are_shown_as_words(path: str) -> None:
    """As the members of an enum they would read <Method.SCREEN: 'screen'> in the message about a wrong one."""
    choices = [one for action in ALL[path]._actions for one in action.choices or ()]
    assert [one for one in choices if type(one) is not str] == []


def test_a_wrong_choice_is_told_with_the_right_ones(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        build().parse_args(["detect", "--scene", "s", "--method", "exakt"])
    told = capsys.readouterr().err
    assert "'exakt'" in told
    assert all(method in told for method in Method)
    assert "<" not in told


def test_choices_exit_codes_and_environment_are_documented() -> None:
    text = DOCUMENT.read_text()
    for choice in (*FORMATS, *Method):
        assert f"`{choice}`" in text
    for name, code in vars(codes).items():
        if name.isupper():
            assert f"\n| {code} | " in text, name
    epilog = build().epilog or ""
    for variable in ("CONFLICTDB_DSN", "CONFLICTDB_HOME", "CONFLICTDB_PG_BIN", "CONFLICTDB_NO_DOWNLOAD"):
        assert variable in epilog
        assert f"`{variable}`" in text


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("90", 90.0), ("30s", 30.0), ("5m", 300.0), ("5 min", 300.0), ("1.5h", 5400.0), ("1d", 86400.0), ("250ms", 0.25)],
)
def test_duration(text: str, seconds: float) -> None:
    assert duration_s(text) == seconds


@pytest.mark.parametrize("text", ["", "0", "0s", "-5s", "5 parsecs", "s", "1e3s", "nan", "inf", "99999999999d"])
def test_what_is_no_duration(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        duration_s(text)


def test_numbers() -> None:
    assert (metres("0"), metres("1e3"), speed_kn("0.5"), count("12")) == (0.0, 1000.0, 0.5, 12)
    for read, wrong in ((metres, "-1"), (metres, "inf"), (metres, "nan"), (metres, "x"), (speed_kn, "0"), (count, "0")):
        with pytest.raises(argparse.ArgumentTypeError):
            read(wrong)
    for wrong in ("1.5", "-1", "", "x", "99999999"):
        with pytest.raises(argparse.ArgumentTypeError):
            count(wrong)


def test_instant_needs_an_offset() -> None:
    assert instant("2026-06-01T11:30:00+02:00") == datetime(2026, 6, 1, 9, 30, tzinfo=UTC)
    with pytest.raises(argparse.ArgumentTypeError, match="offset"):
        instant("2026-06-01T11:30:00")
