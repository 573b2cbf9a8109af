"""Open the database of a command, and load its files."""

import argparse
import os
import shlex
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Final, TextIO

from conflictdb import store
from conflictdb.cli.last_scene import recall, remember
from conflictdb.cli.meant import of_unknown_keys
from conflictdb.cli.meter import shown_phases
from conflictdb.cli.output import note, remark
from conflictdb.client.database import Database, connect
from conflictdb.errors import ConflictDBError, IncompleteWarning, InvalidInput, UnknownScheduleWarning

if TYPE_CHECKING:
    from psycopg import Connection

    from conflictdb.cli.parser import Parser
    from conflictdb.client.loading import Loaded
    from conflictdb.embedded import EmbeddedServer


# People read fewer mistakes one by one.
_MANY_MISTAKES: Final = 4


@contextmanager
def database(args: argparse.Namespace) -> Iterator[Database]:
    """Open the database of a command, and close it at the end; applies --lock-timeout to everything in between.

    Commands that need a scene get the usual one without --scene, and a scene that was named and used is remembered.
    """
    given, usual = getattr(args, "scene", None), None
    with warnings.catch_warnings(), connect(args.dsn, say=note) as opened:
        warnings.simplefilter("ignore", IncompleteWarning)  # commands print their own remarks
        _remark_once(UnknownScheduleWarning)
        with store.waiting_at_most(opened.connection, getattr(args, "lock_timeout", None)):
            if given is None and args.needs_scene:
                args.scene = usual = _needed_scene(opened, args)
            try:
                yield opened
            except InvalidInput:
                with suppress(ConflictDBError):
                    if hint := of_unknown_keys(opened, args):
                        remark(hint)
                raise
            if (used := getattr(args, "scene", None)) is not None and used != usual:
                remember(_name(opened), used)


def _remark_once(of: type[Warning]) -> None:
    """Print each warning of a category as one remark."""
    show, seen = warnings.showwarning, set[str]()

    def once(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if not issubclass(category, of):
            show(message, category, filename, lineno, file, line)
        elif str(message) not in seen:
            seen.add(str(message))
            remark(str(message))

    warnings.simplefilter("always", of)
    warnings.showwarning = once


def wait(db: Database, args: argparse.Namespace) -> None:
    """Wait until a worker has detected all changes of the scene, if `--wait` is given."""
    if args.wait is not None:
        db.scene(args.scene).wait_until_current(args.wait)


def usual_scene(db: Database) -> str | None:
    """Return the scene of the environment, else the last one used, else the only one, with a remark; or None."""
    if scene := os.environ.get("CONFLICTDB_SCENE"):
        reason = "CONFLICTDB_SCENE"
    elif (scene := recall(_name(db))) is not None and _exists(db, scene):
        reason = "the last one used"
    elif len(scenes := db.scenes()) == 1:
        scene, reason = scenes[0].scene.name, "the only one"
    else:
        return None
    remark(f"scene {scene!r} ({reason})")
    return scene


def _needed_scene(db: Database, args: argparse.Namespace) -> str:
    if (scene := usual_scene(db)) is not None:
        return scene
    known = ", ".join(repr(status.scene.name) for status in db.scenes()) or "none"
    parser: Parser = args.parser
    return parser.error(f"which scene? give --scene NAME; known: {known}")


def _exists(db: Database, scene: str) -> bool:
    try:
        with store.transaction(db.connection):
            store.scene_or_branch_id(db.connection, scene)
    except InvalidInput:
        return False
    return True


def _name(db: Database) -> str:
    """Return an identifier of a database, without a password."""
    info = db.connection.info
    return f"{info.host}:{info.port}/{info.dbname}"


def load_files(db: Database, args: argparse.Namespace) -> "list[Loaded]":
    """Load the files of a command with its options; the last of their scenes is remembered."""
    from conflictdb.formats.hints import MAX_GAP_S, FileHints

    hints = FileHints(
        args.map or {},
        args.time_zone and str(args.time_zone),
        None if args.haven is None else tuple(args.haven.values()),
        args.unbounded_heights,
        args.departure,
        args.speed_kn,
        max_gap_s=MAX_GAP_S if args.max_gap is None else 3600.0 * args.max_gap,
    )
    _refuse_path(db, args.scene)
    with shown_phases() as phase, _advice(args):
        loaded = db.load_files(
            args.files,
            args.scene,
            replace=args.replace,
            max_speed_kn=args.max_speed_kn,
            layers=args.layer or (),
            skip_invalid=args.skip_invalid,
            max_file_mb=args.max_file_mb,
            hints=None if hints == FileHints() else hints,
            phase=phase,
        )
    remember(_name(db), loaded[-1].scene)
    if len(names := list(dict.fromkeys(one.scene for one in loaded))) > 1 and args.scene is None:
        several = ", ".join(map(repr, names[:5])) + (", …" if len(names) > 5 else "")
        remark(f"scenes {several} are not compared with each other: --scene NAME loads all files into one")
    return loaded


def _refuse_path(db: Database, name: str | None) -> None:
    """Raise InvalidInput for a new scene whose name reads like the path of a branch; branches have names alone."""
    parent, slash, own = (name or "").partition("/")
    if not slash:
        return
    known = {one.scene.name: one.branch_of for one in db.scenes()}
    if name not in known and parent in known:
        makes = (
            ""
            if known.get(own) == parent
            else f"`conflictdb branch create {shlex.quote(own)} --scene {shlex.quote(parent)}`, then "
        )
        rule = f"reads like a branch of {parent!r}, which has a name of its own: {makes}--scene {shlex.quote(own)}"
        raise InvalidInput(f"scene {name!r}", "name", rule)


@contextmanager
def _advice(args: argparse.Namespace) -> Iterator[None]:
    """Print which option helps, if a file is refused for times without offset, or for many mistakes."""
    from conflictdb.formats.instants import OFFSET_RULE

    try:
        yield
    except InvalidInput as error:
        if args.time_zone is None and OFFSET_RULE in str(error):
            remark("times lack an offset: --time-zone ZONE says where they are local, such as UTC or Europe/Copenhagen")
        count = sum(1 for _ in error)
        if count >= _MANY_MISTAKES and not args.skip_invalid:
            remark(f"{count:,} mistakes, by reason: --skip-invalid leaves these objects out, and loads the others")
        raise


@contextmanager
def connections(args: argparse.Namespace, named: Callable[[str], str]) -> Iterator[Callable[[], "Connection[Any]"]]:
    """Yield a function that connects, repeatedly, for commands that run long; `named` converts the connection string.

    Restarts the embedded database if it has ended, and keeps it running.
    """
    from conflictdb.embedded import embedded

    in_use: list[EmbeddedServer] = []

    def connection() -> "Connection[Any]":
        if args.dsn:
            return store.connect(named(args.dsn))
        in_use.append(embedded(say=note))
        for former in in_use[:-1]:
            former.stop()
        del in_use[:-1]
        return store.connect(named(in_use[0].dsn))

    try:
        yield connection
    finally:
        for server in in_use:
            server.stop()
