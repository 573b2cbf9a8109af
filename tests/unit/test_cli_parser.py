"""Every command and option has help; values are checked before anything is started."""

import argparse
import inspect
import shlex
import subprocess
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from patience import WAIT_S

from conflictdb.cli import codes, main
from conflictdb.cli.commands import ENVIRONMENT, GROUPS, build
from conflictdb.cli.parser import _OF_ALL_COMMANDS
from conflictdb.cli.values import (
    bearing_deg,
    count,
    delay_s,
    duration_s,
    haven,
    height,
    hours,
    instant,
    mapping,
    margin,
    metres,
    speed_kn,
)
from conflictdb.model.methods import Method


def commands(parser: argparse.ArgumentParser, path: str = "") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield path, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield from commands(command, f"{path} {name}".strip())


ALL = dict(commands(build()))


@pytest.mark.parametrize("path", list(ALL))
def test_every_command_and_option_has_help_and_plain_choices(path: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Choices are words: members of an enum would read <Method.SCREEN: 'screen'> in the message about a wrong one."""
    assert ALL[path].description
    assert "None" not in ALL[path].format_usage()
    for action in ALL[path]._actions:
        if not isinstance(action, argparse._SubParsersAction):
            assert action.help, action
        assert all(type(choice) is str for choice in action.choices or ())
    with pytest.raises(SystemExit) as ended:
        build().parse_args([*path.split(), "--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: conflictdb {path}".strip())


@pytest.mark.parametrize("path", [path for path in ALL if "run" in ALL[path]._defaults])
def test_every_command_runs_a_function(path: str) -> None:
    target = inspect.getclosurevars(ALL[path]._defaults["run"]).nonlocals
    assert callable(getattr(import_module(f"conflictdb.cli.{target['module']}"), target["function"]))


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("report KEY --scene S x.pdf", {"key": "KEY", "file": Path("x.pdf"), "scene": "S"}),
        ("report --tz UTC KEY x.pdf", {"key": "KEY", "file": Path("x.pdf")}),
        ("report --scene=S x.pdf", {"key": None, "file": Path("x.pdf"), "scene": "S"}),
        ("rename OLD --scene S NEW", {"key": "OLD", "new": "NEW"}),
        ("explain A --scene S B", {"keys": ["A", "B"]}),
        ("branch create --scene S NEW", {"action": "create", "branch": "NEW"}),
        ("load a.geojson --scene S b.geojson", {"files": ["a.geojson", "b.geojson"]}),
        ("resolve A --within 1h B --movable C D", {"keys": ["A", "B"], "movable": ["C", "D"]}),
        ("probe a.json --move K -20m 270 b.json", {"files": ["a.json", "b.json"], "move": [["K", "-20m", "270"]]}),
        ("delete --scene S -- -KEY", {"keys": ["-KEY"], "scene": "S"}),
    ],
)
def test_options_may_stand_between_keys_and_files(line: str, found: dict[str, Any]) -> None:
    args = vars(build().parse_args(line.split()))
    assert {name: args[name] for name in found} == found


def test_the_error_of_a_wrong_choice_lists_the_right_ones(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        build().parse_args(["detect", "--scene", "s", "--method", "exakt"])
    err = capsys.readouterr().err
    assert "'exakt'" in err
    assert all(method in err for method in Method)
    assert "<" not in err


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (
            "detect f.geojson --separation 5",
            "detect: unrecognized arguments: --separation 5; did you mean --separation-m?",
        ),
        ("spark detect --output o --partition=4", "spark detect: unrecognized arguments: --partition=4; did you mean"),
        ("status --dsn dbname=x", "status: unrecognized arguments: --dsn dbname=x; --dsn goes before the command (see"),
        ("scenes out.json", "scenes: unrecognized arguments: out.json (see"),
        ("conflicts --scene s --xyzzy", "conflicts: unrecognized arguments: --xyzzy (see conflictdb conflicts --help)"),
        (
            "detect --scene s --method window",
            "detect: argument --method: 'window' was removed: use exact, which is quicker",
        ),
        ("spark detect --output o --method window", "spark detect: argument --method: 'window' was removed: use exact"),
        ("--dns x status", "conflictdb: unknown command 'x' (see conflictdb --help)"),
        ("detct f.geojson", "conflictdb: unknown command 'detct'; did you mean detect? (see conflictdb --help)"),
        ("share bob", "conflictdb: unknown command 'share'; did you mean admin share? (see conflictdb --help)"),
        (
            "conflicts --from 01/06/2026",
            "in ISO 8601, such as 2026-03-01 or 2026-03-01T06:00Z; got '01/06/2026' (see conflictdb conflicts --help)",
        ),
        ('slots "FERRY NORTH"', "conflictdb: unknown command 'slots'; use delays KEY (see conflictdb --help)"),
        ("delay FERRY 20m", "unknown command 'delay'; use probe --late KEY DURATION, or delays KEY (see"),
        ("move FERRY 2nmi W", "unknown command 'move'; use probe --move KEY DISTANCE BEARING (see"),
        ("probe --delay FERRY 20m", "unrecognized arguments: --delay; did you mean --late? (see"),
        ("conflicts --key FERRY", "unrecognized arguments: --key; KEY is given without an option (see"),
        ("delays FERRY 20m", "unrecognized arguments: 20m; a duration is given with --within (see"),
        ("branch create b sea", "unrecognized arguments: sea; --scene names the scene; quote a key that has blanks"),
        ("apply 1 --scene sea", "unrecognized arguments: --scene sea; this needs no scene (see"),
        ("undo 3", "unknown command 'undo'; use apply N --undo (see"),
        ("probe FERRY --late 20m", "probe: argument --late: needs KEY and DURATION (see"),
        ("conflicts --since yesterday", "got 'yesterday'; or so long ago, such as 24h or 7d (see"),
        ("export", "export: the following arguments are required: FILE (see"),
        (f"map {__file__}", "; it is a file: `detect FILE` loads it and detects (see"),
        ("admin servce cron", "conflictdb admin: unknown command 'servce'; did you mean service? (see"),
    ],
)
def test_error_of_an_unknown_option_names_its_command(
    typed: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command with an unknown option names its own help, and the option probably intended."""
    with pytest.raises(SystemExit) as ended:
        build().parse_args(shlex.split(typed))
    assert ended.value.code == codes.USAGE
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("value", "text", "expected"),
    [
        (metres, "500", 500.0),
        (metres, "500 m", 500.0),
        (metres, "2km", 2000.0),
        (metres, "0.5nmi", 926.0),
        (metres, "100ft", 30.48),
        (height, "-100", -100.0),
        (height, "-500ft", -152.4),
        (speed_kn, "12kn", 12.0),
        (speed_kn, "18.52km/h", 10.0),
        (speed_kn, "0.5m/s", 1800.0 / 1852.0),
        (hours, "6", 6.0),
        (hours, "90m", 1.5),
        (haven, "500,200m,0.1nmi,1km", {"fore_m": 500.0, "aft_m": 200.0, "port_m": 185.2, "starboard_m": 1000.0}),
    ],
)
def test_distances_heights_and_speeds_take_units(value: Callable[[str], Any], text: str, expected: object) -> None:
    """Without a unit they are in that of the option's name."""
    assert value(text) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *(
            (metres, text)
            for text in ("", "m", "nmi", "-1", "-1km", "5 yd", "nan", "nanm", "infkm", "1e308km", "5 m m")
        ),
        *((speed_kn, text) for text in ("0", "0m/s", "kn", "12mph", "nankn")),
        *((height, text) for text in ("deep", "m", "nan ft")),
        *((hours, text) for text in ("0", "0m", "-1", "soon")),
    ],
)
def test_values_without_a_meaning_are_refused(value: Callable[[str], Any], text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"must be a .*; got"):
        value(text)


def test_options_of_all_commands_are_those_of_the_program() -> None:
    assert set(_OF_ALL_COMMANDS) == set(build()._option_string_actions) - {"-h", "--help"}


def test_every_exit_code_and_variable_is_in_the_reference() -> None:
    numbers = {value for name, value in vars(codes).items() if name.isupper() and isinstance(value, int)}
    assert numbers == set(codes.MEANING)
    page = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "cli.md").read_text()
    for code, text in codes.MEANING.items():
        assert f"| {code} | {text} |\n" in page
    variables = ("DSN", "SCENE", "TZ", "UNITS", "HOME", "PG_BIN", "NO_DOWNLOAD")
    assert set(ENVIRONMENT) == {f"CONFLICTDB_{name}" for name in variables}
    assert all(f"| `{name}` |" in page for name in ENVIRONMENT)


def test_the_help_has_each_command_once_in_a_group_and_fits_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = build().format_help()
    assert len(text.splitlines()) <= 42
    assert [title for title, _ in GROUPS] == ["plan", "ask", "operate"]
    grouped = [name for _, names in GROUPS for name in names]
    assert sorted(grouped) == sorted(path for path in ALL if path and " " not in path)
    assert len(set(grouped)) == len(grouped)
    assert all(f"\n  {name} " in text for name in grouped)


def test_all_help_together_is_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Options are explained in some words each, and what several have in one place."""
    monkeypatch.setenv("COLUMNS", "100")
    assert sum(len(one.format_help().split()) for one in ALL.values()) <= 4000
    short = {
        f"{path} {one.option_strings}"
        for path, parser in ALL.items()
        for one in parser._actions
        if one.option_strings and one.help != argparse.SUPPRESS and len(str(one.help).split()) < 3
    }
    assert not short, "an option needs at least three words to say what it means"


def completed(shell_words: Sequence[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return the completions of bash for the last word."""
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "completion.bash"
    script.write_text(capsys.readouterr().out)
    words = " ".join(map(shlex.quote, shell_words))
    asked = f"source {script}; COMP_WORDS=({words}); COMP_CWORD={len(shell_words) - 1}; _shtab_conflictdb"
    done = subprocess.run(
        ["bash", "-c", f"{asked} conflictdb {shlex.quote(shell_words[-1])}; printf '%s\\n' \"${{COMPREPLY[@]}}\""],
        capture_output=True, text=True, check=True, timeout=WAIT_S,
    )  # fmt: skip
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["conflictdb", "confl"], ["conflicts"]),
        (["conflictdb", "admin", "att"], ["attach", "attachments"]),
        (["conflictdb", "conflicts", "--known"], ["--known-at"]),
        (["conflictdb", "conflicts", "--format", "geoj"], ["geojson"]),
    ],
)
def test_bash_completes(
    words: list[str], offered: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert completed(words, tmp_path, capsys) == offered


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_get_a_script_by_the_name_that_was_called(
    shell: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CONFLICTDB_PROGRAM", "./run")
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "conflicts" in script
    assert ("#compdef run" if shell == "zsh" else "complete -c run") in script


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("30s", 30.0), ("5m", 300.0), ("5 min", 300.0), ("1.5h", 5400.0), ("1d", 86400.0), ("250ms", 0.25),
        ("1h7m", 4020.0), ("1 h 07 min", 4020.0), ("1:07:24", 4044.0), ("0:02", 120.0),
        ("4:42:25.784273", 16945.784273), ("20 minutes", 1200.0), ("2hours 5mins", 7500.0), ("1 day 1 hr", 90000.0),
    ],
)  # fmt: skip
def test_duration(text: str, seconds: float) -> None:
    assert duration_s(text) == seconds


@pytest.mark.parametrize(
    "text",
    [
        "",
        "0",
        "0s",
        "20",
        "-5s",
        "7m1h",
        "5m5m",
        "1:7",
        "1:60:00",
        "5 parsecs",
        "s",
        "1e3s",
        "nan",
        "inf",
        "99999999999d",
        "20 minutess",
    ],
)
def test_what_is_no_duration(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        duration_s(text)


def test_a_delay_may_be_negative() -> None:
    assert (delay_s("-20m"), delay_s("+20m"), delay_s("20m")) == (-1200.0, 1200.0, 1200.0)
    args = build().parse_args(["probe", "--late", "FERRY", "-20m", "--late", "TOW", "1h"])
    assert args.late == [["FERRY", "-20m"], ["TOW", "1h"]]


def test_numbers() -> None:
    assert (metres("0"), metres("1e3"), speed_kn("0.5"), count("12")) == (0.0, 1000.0, 0.5, 12)
    for read, wrong in ((metres, "-1"), (metres, "inf"), (metres, "nan"), (metres, "x"), (speed_kn, "0"), (count, "0")):
        with pytest.raises(argparse.ArgumentTypeError):
            read(wrong)
    for wrong in ("1.5", "-1", "", "x", "99999999"):
        with pytest.raises(argparse.ArgumentTypeError):
            count(wrong)


def test_units_that_people_try_first_are_read() -> None:
    """NM is a nautical mile on charts and in the air; m is a metre in distances, and a minute in margins."""
    assert [metres(text) for text in ("2nm", "2 NM", "2nmi", "500meters", "300 feet")] == [
        *(3704.0, 3704.0, 3704.0, 500.0, pytest.approx(91.44)),
    ]
    assert [speed_kn(text) for text in ("18kts", "18 knots", "18kt")] == [18.0] * 3
    assert [margin(text) for text in ("0.5NM", "5 minutes", "500meters")] == [(0.0, 926.0), (300.0, 0.0), (0.0, 500.0)]
    assert [bearing_deg(text) for text in ("270", "270°", "W", "west", "NNE", "south-east", "north west")] == [
        *(270.0, 270.0, 270.0, 270.0, 22.5, 135.0, 315.0),
    ]
    for read, wrong in (
        (bearing_deg, "left"),
        (bearing_deg, "ww"),
        (metres, "2M"),
        (metres, "2nmm"),
        (margin, "5 nm m"),
    ):
        with pytest.raises(argparse.ArgumentTypeError):
            read(wrong)


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


def test_the_zone_of_all_commands_is_set_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """CONFLICTDB_TZ is the default of --tz, and checked like it; a program reads it once."""
    monkeypatch.setenv("CONFLICTDB_TZ", "Europe/Copenhagen")
    for words in (["delays"], ["resolve"], ["conflicts"]):
        assert str(build("in a zone").parse_args(words).tz) == "Europe/Copenhagen"
    assert str(build("in a zone").parse_args(["delays", "--tz", "UTC"]).tz) == "UTC"
    monkeypatch.setenv("CONFLICTDB_TZ", "Nowhere/None")
    with pytest.raises(SystemExit):
        build("nowhere").parse_args(["delays"])
    assert "must be a time zone such as Europe/Copenhagen; got 'Nowhere/None'" in capsys.readouterr().err
