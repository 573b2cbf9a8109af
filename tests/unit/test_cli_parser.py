"""Every command and option has help; values are checked before anything is started."""

import argparse
import inspect
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib import import_module

import pytest

from conflictdb.cli import codes
from conflictdb.cli.commands import build
from conflictdb.cli.parser import _OF_ALL_COMMANDS
from conflictdb.cli.values import count, duration_s, instant, mapping, metres, speed_kn
from conflictdb.model.methods import Method


def commands(parser: argparse.ArgumentParser, path: str = "") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield path, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield from commands(command, f"{path} {name}".strip())


ALL = dict(commands(build()))


@pytest.mark.parametrize("path", list(ALL))
def test_every_command_and_option_has_help(path: str) -> None:
    assert ALL[path].description
    for action in ALL[path]._actions:
        if not isinstance(action, argparse._SubParsersAction):
            assert action.help, action


@pytest.mark.parametrize("path", [path for path in ALL if "run" in ALL[path]._defaults])
def test_every_command_runs_a_function(path: str) -> None:
    target = inspect.getclosurevars(ALL[path]._defaults["run"]).nonlocals
    assert callable(getattr(import_module(f"conflictdb.cli.{target['module']}"), target["function"]))


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


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        (
            "detect f.geojson --separation 5",
            "detect: unrecognized arguments: --separation 5; did you mean --separation-m?",
        ),
        ("spark detect --output o --partition=4", "spark detect: unrecognized arguments: --partition=4; did you mean"),
        ("status --dsn dbname=x", "status: unrecognized arguments: --dsn dbname=x; --dsn goes before the command (see"),
        ("export --scene s out.json another.json", "export: unrecognized arguments: another.json (see"),
        ("conflicts --scene s --xyzzy", "conflicts: unrecognized arguments: --xyzzy (see conflictdb conflicts --help)"),
        (
            "detect --scene s --method window",
            "detect: argument --method: 'window' was removed: use exact, which is quicker",
        ),
        ("spark detect --output o --method window", "spark detect: argument --method: 'window' was removed: use exact"),
        ("--dns x status", "conflictdb: argument COMMAND: invalid choice: 'x'"),
    ],
)
def test_unknown_option_is_told_by_its_command(typed: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The command that was given an unknown option says so, names its own help, and what could have been meant."""
    with pytest.raises(SystemExit) as ended:
        build().parse_args(typed.split())
    assert ended.value.code == codes.USAGE
    assert told in capsys.readouterr().err


def test_options_of_all_commands_are_those_of_the_program() -> None:
    assert set(_OF_ALL_COMMANDS) == set(build()._option_string_actions) - {"-h", "--help"}


def test_every_exit_code_has_a_meaning_in_the_help() -> None:
    numbers = {value for name, value in vars(codes).items() if name.isupper() and isinstance(value, int)}
    assert numbers == set(codes.MEANING)
    help_text = build().format_help()
    for code, text in codes.MEANING.items():
        assert f"  {code:<4} {text}\n" in help_text
    for variable in ("CONFLICTDB_DSN", "CONFLICTDB_HOME", "CONFLICTDB_PG_BIN", "CONFLICTDB_NO_DOWNLOAD"):
        assert variable in help_text


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


def test_a_map_is_parted_at_commas_outside_of_parentheses_and_quotes() -> None:
    given = (
        """key=id,floor_m = -depth_ft*0.3048 ,position=ST_Point(x, y, 3857),name=concat(a[1,2], ','),outline="a,b"=1"""
    )
    assert mapping(given) == {
        "key": "id",
        "floor_m": "-depth_ft*0.3048",
        "position": "ST_Point(x, y, 3857)",
        "name": "concat(a[1,2], ',')",
        "outline": '"a,b"=1',
    }


@pytest.mark.parametrize("text", ["", "key", "key=", "key=id,,name=n", "key=id,key=nr", "=id", "key=id,", "a b=c"])
def test_a_map_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="FIELD=COLUMN"):
        mapping(text)
