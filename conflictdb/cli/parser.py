"""Parse commands, and define options of several commands. Imports no library."""

import argparse
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NoReturn

from conflictdb.cli.meant import COMMANDS, OPTIONS
from conflictdb.cli.values import (
    aware,
    count,
    days,
    duration_s,
    haven,
    hours,
    instant,
    mapping,
    margin,
    megabytes,
    memory_mb,
    method,
    metres,
    name,
    place,
    seconds,
    speed_kn,
    step_s,
    zone,
)
from conflictdb.core.memory_budget import MEMORY_MB
from conflictdb.model.methods import Method
from conflictdb.model.settings import Setting, SettingType

APPROACH_FORMATS: Final = ("table", "json", "csv", "geojson")
FORMATS: Final = (*APPROACH_FORMATS, "gpx", "ics")
_OF_ALL_COMMANDS: Final = ("--dsn", "--debug", "--version")
# Options of several commands, for `add_options`: value, default, name of the value in help, help.
_OPTIONS: Final[Mapping[str, tuple[Callable[[str], Any], object, str, str]]] = {
    "--jobs": (count, None, "N", "threads to compute with (default: one for each processor)"),
    "--lock-timeout": (duration_s, None, "DURATION", "give up if another session holds a lock for longer"),
    "--margin": (margin, (0.0, 0.0), "TIME|DISTANCE", "stay clear by this much more: 5m (minutes), 0.5nmi"),
    "--memory-mb": (memory_mb, MEMORY_MB, "N", f"memory to compute with, megabytes (default {MEMORY_MB})"),
    "--round": (step_s, 60.0, "DURATION", "show departures in whole steps (default: 1m; 0: exact)"),
    "--tz": (zone, None, "ZONE", "time zone of times without offset and of the table, Europe/Copenhagen"),
    "--wait": (duration_s, None, "DURATION", "wait so long for a worker to detect changes, else exit with 7"),
}
# Values of settings, and their names in help.
_VALUES: Final[Mapping[SettingType, tuple[Callable[[str], Any], str]]] = {
    SettingType.METRES: (metres, "DISTANCE"),
    SettingType.SECONDS: (seconds, "DURATION"),
    SettingType.DAYS: (days, "N"),
    SettingType.PLACE: (place, "LON,LAT"),
}
_FLAGS: Final = {
    "--fail-on-conflict": "exit with 10 if there are conflicts",
    "--no-region": "leave out the regions where conflicts happen: quicker, smaller",
    "--require-current": "exit with 7 if changes wait for a detection",
}
# Forms of values, shown below the options of a command that takes them.
NOTATION: Final = {
    "DURATION": "30s, 5m, 1.5h, 1d, 1h7m or 1:07:24",
    "DISTANCE": "metres, or with a unit: 500m, 2km, 0.5nmi, 300ft",
    "HEIGHT": "metres above the scene's datum, negative below, or with a unit: -100m, 500ft",
    "SPEED": "knots, or with a unit: 6m/s, 22km/h",
    "TIME": "2026-06-01T09:00Z, or with another offset; without one where --tz gives the zone",
}


class Parser(argparse.ArgumentParser):
    """A parser with short help, whose usage errors are one line that names the help.

    hands_on : it parses only --help; all other arguments are passed unchanged to another program as `arguments`
    groups : titles and names of commands, as help lists them instead of commands and options; needs a `usage`
    """

    hands_on = False
    groups: Sequence[tuple[str, Sequence[str]]] = ()

    def __init__(self, **options: Any) -> None:
        super().__init__(**options | {"add_help": False, "allow_abbrev": False})
        self._positionals.title = self._optionals.title = None
        self._negative_number_matcher = re.compile(r"-[\d.].*")  # -20m is a value, too
        self.add_argument("-h", "--help", action="help", help=argparse.SUPPRESS)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Return the namespace, and unknown arguments."""
        if not self.hands_on or args in (["-h"], ["--help"]):
            if args is not None:
                args = self._with_positionals_first(list(args))
            namespace, unknown = super().parse_known_args(args, namespace)
            if unknown:  # report it here, where the command's options are known
                self.error(f"unrecognized arguments: {' '.join(unknown)}{self._meant(unknown[0].partition('=')[0])}")
            return namespace, unknown
        namespace, _ = super().parse_known_args([], namespace)
        namespace.arguments = args
        return namespace, []

    def _with_positionals_first(self, args: list[str]) -> list[str]:
        """Return the arguments of a command with its positional ones first."""
        if "--" in args or any(isinstance(one, argparse._SubParsersAction) for one in self._actions):
            return args
        known, first, others = self._option_string_actions, list[str](), list[str]()
        rest = list(args)
        while rest:
            one = rest.pop(0)
            if not self._is_option(one):
                first.append(one)
                continue
            name, equals, _ = one.partition("=")
            if name not in known:
                return args
            others.append(one)
            takes = known[name].nargs
            most = takes if isinstance(takes, int) else 1 if takes in (None, "?") else len(rest)
            for _ in range(0 if equals else most):
                if not rest or self._is_option(rest[0]):
                    break
                others.append(rest.pop(0))
        return first + others

    def _is_option(self, word: str) -> bool:
        return len(word) > 1 and word[0] == "-" and " " not in word and not self._negative_number_matcher.match(word)

    def _meant(self, option: str) -> str:
        """Return a hint for an unknown option: it resembles another one, or goes before the command; may be empty."""
        if option in _OF_ALL_COMMANDS:
            return f"; {option} goes before the command"
        if not option.startswith("-"):
            return self._meant_by_word(option)
        for own in OPTIONS.get(option, ()):
            if own in self._option_string_actions:
                return f"; did you mean {own}?"
            if any(own in str(one.metavar) for one in self._actions if not one.option_strings):
                return f"; {own} is given without an option"
        if option == "--scene":
            return "; this needs no scene"
        alike = get_close_matches(option, self._option_string_actions, 1) if option.startswith("--") else []
        return f"; did you mean {alike[0]}?" if alike else ""

    def _meant_by_word(self, word: str) -> str:
        """Return a hint for a word that is of no option; may be empty."""
        if Path(word).is_file():
            return "; it is a file: `detect FILE` loads it and detects"
        takes_duration = next((one for one in self._actions if one.metavar == "DURATION"), None)
        if word[:1].isdigit() and takes_duration is not None:
            return f"; a duration is given with {takes_duration.option_strings[0]}"
        hints = []
        is_key = any("KEY" in str(one.metavar) for one in self._actions if not one.option_strings)
        if not is_key and "--scene" in self._option_string_actions:
            hints.append("--scene names the scene")
        if any("KEY" in str(one.metavar) for one in self._actions):
            hints.append("quote a key that has blanks: 'FERRY NORTH'")
        return "".join(f"; {one}" for one in hints)

    def _match_argument(self, action: argparse.Action, arg_strings_pattern: str) -> int:
        """Return how many arguments an option takes; the error for too few names them."""
        try:
            return super()._match_argument(action, arg_strings_pattern)
        except argparse.ArgumentError:
            if not isinstance(action.metavar, tuple):
                raise
            raise argparse.ArgumentError(action, f"needs {' and '.join(action.metavar)}") from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raise ArgumentError for an unknown choice."""
        if not isinstance(action, argparse._SubParsersAction) or value in action.choices:
            super()._check_value(action, value)
            return
        known = {lower: f"{name} {lower}" for name, one in action.choices.items() for lower in subcommands(one)}
        known |= {name: name for name in action.choices}
        if self.groups and value in COMMANDS:
            hint = f"; use {COMMANDS[value]}"
        else:
            alike = get_close_matches(str(value), known, 1)
            hint = f"; did you mean {known[alike[0]]}?" if alike else ""
        raise argparse.ArgumentError(None, f"unknown command {value!r}{hint}")

    def words(self) -> list[str]:
        """Return what a command takes: what it needs in full, the rest in brackets."""
        found, rest = [], False
        for one in self._actions:
            if isinstance(one, argparse._SubParsersAction):
                found.append(f"{one.metavar} …")
            elif not one.option_strings:
                more = {"*": "[{}…]", "+": "{}…", "?": "[{}]"}.get(str(one.nargs), "{}")
                label = one.metavar or "{" + ",".join(map(str, one.choices or ())) + "}"
                found += [more.format(label)] * (one.nargs if isinstance(one.nargs, int) else 1)
            elif one.required:
                found.append(f"{one.option_strings[-1]} {one.metavar}")
            else:
                rest = rest or one.help != argparse.SUPPRESS
        return [*found, "[OPTION…]"] if rest else found

    def notation(self) -> str:
        """Return what values of the shown options look like; may be empty."""
        shown = [one for one in self._actions if one.help != argparse.SUPPRESS]
        named = {name for one in shown for name in re.findall(r"[A-Z]+", f"{one.metavar} {one.help}")}
        return ". ".join(f"{name}: {text}" for name, text in NOTATION.items() if name in named)

    def format_help(self) -> str:
        """Return the help, with the commands in their groups."""
        if not self.groups:
            self.usage = " ".join([self.prog, *self.words()]).replace("%", "%%")
            self.epilog = self.notation()
            return super().format_help()
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, [], [])
        formatter.add_text(self.description)
        (commands,) = (one for one in self._actions if isinstance(one, argparse._SubParsersAction))
        by_name = {one.dest: one for one in commands._choices_actions}
        for title, names in self.groups:
            formatter.start_section(title)
            formatter.add_arguments([by_name[name] for name in names])
            formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()

    def error(self, message: str) -> NoReturn:
        """End the program with exit code 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def subcommands(parser: argparse.ArgumentParser) -> list[str]:
    """Return the names of the commands below a command."""
    found = (one.choices for one in parser._actions if isinstance(one, argparse._SubParsersAction))
    return [name for choices in found for name in choices]


def command(commands: Any, word: str, target: str, summary: str, more: str = "") -> Parser:
    """Add a command that runs function `target`, written ``module:function``, imported on demand."""
    module, _, function = target.partition(":")

    def run(args: argparse.Namespace) -> int:
        return int(getattr(import_module(f"conflictdb.cli.{module}"), function)(args))

    description = f"{summary[0].upper()}{summary[1:]}. {more}".strip()
    parser: Parser = commands.add_parser(word, help=summary, description=description)
    parser.set_defaults(run=run, parser=parser, needs_scene=False)
    return parser


def add_scene(parser: Parser, more: str = "") -> None:
    """Add `--scene`, which every command may leave out."""
    parser.add_argument("--scene", type=name, metavar="NAME", help=f"scene (default: the last one used{more})")
    parser.set_defaults(needs_scene=True)


def add_settings(parser: argparse.ArgumentParser, settings: Iterable[Setting]) -> None:
    """Add an option for each setting of a scene."""
    for one in settings:
        if one.choices is not None:
            names = tuple(map(str, one.choices))  # plain strings: usage errors show each choice's repr
            parser.add_argument(one.option, type=method if one.choices is Method else str, choices=names, help=one.help)
        else:
            value, metavar = _VALUES[one.type]
            parser.add_argument(one.option, type=value, metavar=metavar, help=one.help)


def add_options(parser: argparse.ArgumentParser, *options: str) -> None:
    """Add options that several commands have."""
    for one in options:
        if one in _FLAGS:
            parser.add_argument(one, action="store_true", help=_FLAGS[one])
        else:
            value, default, metavar, text = _OPTIONS[one]
            if one == "--tz":
                default = os.environ.get("CONFLICTDB_TZ") or default  # checked as if it was given
            parser.add_argument(one, type=value, default=default, metavar=metavar, help=text)


def add_loading(parser: Parser, *, is_shown: bool = True) -> None:
    """Add the options of loading files; the help of only one command shows them."""

    def add(option: str, text: str, **more: Any) -> None:
        parser.add_argument(option, help=text if is_shown else argparse.SUPPRESS, **more)

    add("--replace", "remove objects of the scene that the files lack", action="store_true")
    about = "layer to read, or schedule of a route; repeatable (default: all)"
    add("--layer", about, action="append", metavar="NAME")
    add("--skip-invalid", "leave out objects that are refused, and name them (exit code 6)", action="store_true")
    about = (
        "size of tracks whose file gives none: distances ahead, astern, to port, to starboard (500,200,0.1nmi,0.1nmi)"
    )
    add("--haven", about, type=haven, metavar="FORE,AFT,PORT,STARBOARD")
    add("--time-zone", "time zone of times without offset, Europe/Copenhagen", type=zone, metavar="ZONE")
    add("--departure", "departure of routes without times", type=instant, metavar="TIME")
    add("--speed-kn", "speed of routes without speeds", type=speed_kn, metavar="SPEED")
    about = "take flight levels and heights above ground as all heights (default: refuse them)"
    add("--unbounded-heights", about, action="store_true")
    about = "columns or properties of the file for fields, start=valid_from,end=valid_to"
    add("--map", about, type=mapping, metavar="FIELD=COLUMN,…")
    about = "refuse faster tracks, and leave out positions reached faster (default 2000, AIS 102.2)"
    add("--max-speed-kn", about, type=speed_kn, metavar="SPEED")
    about = "positions with a longer gap between them are two tracks (DURATION, or hours; default 24h)"
    add("--max-gap", about, type=hours, metavar="DURATION")
    about = "refuse larger files, megabytes unpacked (default 64; 4000 for scene files and GeoParquet)"
    add("--max-file-mb", about, type=megabytes, metavar="MB")


def resolve_times(args: argparse.Namespace, *names: str) -> None:
    """Give the times of options their offsets; ends with a usage error where one is unknown."""
    for one in names:
        try:
            setattr(args, one, aware(getattr(args, one), args.tz))
        except argparse.ArgumentTypeError as error:
            args.parser.error(str(error))


def add_format(parser: Parser, *formats: str) -> None:
    """Add `--format`; the first is the default."""
    parser.add_argument(
        "--format", choices=formats, default=formats[0], help=f"format to print (default: {formats[0]})"
    )


def check(args: argparse.Namespace, rules: Sequence[tuple[bool, str]]) -> None:
    """End with a usage error (exit code 2) if a rule between options is broken."""
    for is_broken, message in rules:
        if is_broken:
            args.parser.error(message)
