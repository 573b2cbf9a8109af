"""Parse commands, and define options of several commands. Imports no library, so that help is fast."""

import argparse
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any, Final, NoReturn

from conflictdb.cli.values import count, duration_s, megabytes, memory_mb, method, metres, place, speed_kn
from conflictdb.model.methods import Method
from conflictdb.model.settings import Setting, Type
from conflictdb.stages.memory import MEMORY_MB

FORMATS: Final = ("table", "json", "csv", "geojson")
_OF_ALL_COMMANDS: Final = ("--dsn", "--debug", "--version")


class Parser(argparse.ArgumentParser):
    """A parser whose usage errors are one line that names the help.

    hands_on : it parses only --help; all other arguments are passed unchanged to another program as `arguments`
    """

    hands_on = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Return the namespace, and unknown arguments."""
        if not self.hands_on or args in (["-h"], ["--help"]):
            namespace, unknown = super().parse_known_args(args, namespace)
            if unknown:  # report it here, where the command's options are known
                self.error(f"unrecognized arguments: {' '.join(unknown)}{self._meant(unknown[0].partition('=')[0])}")
            return namespace, unknown
        namespace, _ = super().parse_known_args([], namespace)
        namespace.arguments = args
        return namespace, []

    def _meant(self, option: str) -> str:
        """Return a hint for an unknown option: it resembles another one, or goes before the command; may be empty."""
        if option in _OF_ALL_COMMANDS:
            return f"; {option} goes before the command"
        alike = get_close_matches(option, self._option_string_actions, 1) if option.startswith("--") else []
        return f"; did you mean {alike[0]}?" if alike else ""

    def error(self, message: str) -> NoReturn:
        """End the program with exit code 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def command(commands: Any, name: str, target: str, summary: str, more: str = "") -> Parser:
    """Add a command that runs function `target`, written ``module:function``, imported on demand."""
    module, _, function = target.partition(":")

    def run(args: argparse.Namespace) -> int:
        return int(getattr(import_module(f"conflictdb.cli.{module}"), function)(args))

    description = f"{summary[0].upper()}{summary[1:]}. {more}".strip()
    parser: Parser = commands.add_parser(name, help=summary, description=description, allow_abbrev=False)
    parser.set_defaults(run=run, parser=parser)
    return parser


def action(actions: Any, name: str, summary: str) -> argparse.ArgumentParser:
    """Add an action of a command."""
    parser: argparse.ArgumentParser = actions.add_parser(
        name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.", allow_abbrev=False
    )
    return parser


def add_settings(parser: argparse.ArgumentParser, settings: Iterable[Setting]) -> None:
    """Add an option for each setting of a scene."""
    for one in settings:
        if one.choices is not None:
            names = tuple(map(str, one.choices))  # plain strings: usage errors show each choice's repr
            parser.add_argument(one.option, type=method if one.choices is Method else str, choices=names, help=one.help)
        else:
            value, metavar = (metres, "M") if one.type is Type.METRES else (place, "LON,LAT")
            parser.add_argument(one.option, type=value, metavar=metavar, help=one.help)


def add_memory(parser: argparse.ArgumentParser) -> None:
    """Add `--memory-mb`."""
    parser.add_argument(
        "--memory-mb",
        type=memory_mb,
        default=MEMORY_MB,
        metavar="N",
        help=f"memory to keep below, megabytes (default {MEMORY_MB}): a detection of more works in smaller parts",
    )


def add_jobs(parser: Parser) -> None:
    """Add `--jobs`."""
    parser.add_argument("--jobs", type=count, metavar="N", help="threads to solve in (default: one per processor)")


def add_fail_on_conflict(parser: Parser) -> None:
    """Add `--fail-on-conflict`."""
    parser.add_argument(
        "--fail-on-conflict", action="store_true", help="exit with 10 if there are conflicts, also unresolved ones"
    )


def add_lock_timeout(parser: Parser, what: str) -> None:
    """Add `--lock-timeout`; `what` is its help text."""
    parser.add_argument(
        "--lock-timeout", type=duration_s, metavar="DURATION", help=f"{what}: 30s, 5m (default: no limit)"
    )


def add_loading(parser: Parser) -> None:
    """Add the options of loading files."""
    parser.add_argument(
        "--replace",
        action="store_true",
        help="remove objects of the scene that the files do not contain (default: add and update only)",
    )
    parser.add_argument(
        "--layer",
        action="append",
        metavar="NAME",
        help="of files that OGR opens (GeoPackage, KML, S-57): a layer to read; may be repeated (default: all)",
    )
    parser.add_argument(
        "--skip-invalid",
        action="store_true",
        help="load the rest where objects are refused; exits with 6 if any is left out",
    )
    parser.add_argument(
        "--max-speed-kn",
        type=speed_kn,
        metavar="KN",
        help="faster tracks are refused, faster fixes of positions left out (default 2000, 102.2 for AIS)",
    )
    parser.add_argument(
        "--max-file-mb",
        type=megabytes,
        metavar="MB",
        help="refuse files that hold, or unpack to, more (default 64, GeoParquet 4000, or 400 if read as a whole)",
    )


def add_wait(parser: Parser) -> None:
    """Add `--wait`."""
    parser.add_argument(
        "--wait",
        type=duration_s,
        metavar="DURATION",
        help="wait until a worker has detected what changed, at most so long (30s, 5m); exit with 7 if it has not",
    )


def add_require_current(parser: Parser) -> None:
    """Add `--require-current`."""
    parser.add_argument(
        "--require-current",
        action="store_true",
        help="exit with 7, and print nothing, if changes of the scene wait for detection",
    )


def add_output(parser: Parser) -> None:
    """Add the options of printing conflicts."""
    parser.add_argument("--format", choices=(*FORMATS, "geoparquet"), default="table", help="default: table")
    parser.add_argument("--no-region", action="store_true", help="leave out where each conflict is; tables and csv do")


def check(args: argparse.Namespace, rules: Sequence[tuple[bool, str]]) -> None:
    """End with a usage error (exit code 2) if a rule between options is broken."""
    for is_broken, message in rules:
        if is_broken:
            args.parser.error(message)
