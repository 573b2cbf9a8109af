"""`map`, `plot` and `report`."""

import argparse
import os
import sys
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path

from conflictdb import store
from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import remark_incomplete, require_current
from conflictdb.cli.output import note, out
from conflictdb.cli.session import connections, database, usual_scene, wait
from conflictdb.cli.values import chosen_units, chosen_zone
from conflictdb.client.database import DEMO_SCENE, Database
from conflictdb.client.stored_scene import StoredScene
from conflictdb.errors import ConflictDBError, InvalidInput


def plot(args: argparse.Namespace) -> int:
    """Draw a scene, two of its objects, or departures."""
    from conflictdb.plot import figures

    figures.check_name(args.file)
    with database(args) as db:
        scene = _required(db, args)
        draw = scene.plot_delays if args.delays else scene.plot
        figures.save(draw(*(args.conflict or ())), args.file)
    note(f"{args.file} is written")
    return DONE


def report(args: argparse.Namespace) -> int:
    """Write a report of a scene, or a brief of a plan."""
    units = chosen_units()
    with database(args) as db:
        if args.key is not None and _is_report(args.key) and not _is_report(args.file):
            args.key, args.file = str(args.file), Path(args.key)  # a key after the file
        if args.key is None and not _is_report(args.file):
            args.key = str(args.file)  # a key alone: the hint names it
            raise InvalidInput("report", "file", f"must end in .html or .pdf; write: report {args.key!r} FILE.pdf")
        _required(db, args).report(args.file, args.key, time_zone=args.tz or chosen_zone(), units=units)
    note(f"{args.file} is written")
    return DONE


def _is_report(file: str | Path) -> bool:
    return Path(file).suffix.lower() in (".html", ".pdf")


def _required(db: Database, args: argparse.Namespace) -> StoredScene:
    """Return the scene of a command, once it is as current as the options require; remarks if it is not."""
    wait(db, args)
    scene = db.scene(args.scene)
    state = scene.state()
    require_current(args, state)
    remark_incomplete([state])
    return scene


def show_map(args: argparse.Namespace) -> int:
    """Serve the page of a scene until interrupted, or write it into a file."""
    if args.html is not None:
        return _write_map(args)
    try:
        from conflictdb.map.serve import PageServer
    except ImportError as error:
        if error.name not in ("starlette", "uvicorn", "anyio"):
            raise
        raise ConflictDBError("map needs starlette and uvicorn: pip install 'conflictdb[map]'") from None
    with database(args) as db, connections(args, store.map_dsn) as connect:
        scene = _scene_of_map(db, args.scene)
        with PageServer(scene, connect, args.host, args.port) as server, suppress(KeyboardInterrupt):
            out(server.address, flush=True)
            _open_browser(server.address)
            server.serve_until_interrupted()
    note("stopped")
    return DONE


def _open_browser(address: str) -> None:
    """Open an address in the browser of a person at a terminal with a desktop; BROWSER=true prevents it."""
    has_desktop = sys.platform == "darwin" or "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ
    if has_desktop and sys.stdout.isatty():
        # In a thread: some browsers are awaited, and the page is not served before.
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()


def _write_map(args: argparse.Namespace) -> int:
    # Imported here: shapely is slow to import.
    from conflictdb.formats import write_lines
    from conflictdb.map.html import page

    with database(args) as db:
        text, left_out = page(db.connection, _scene_of_map(db, args.scene))
    write_lines(args.html, [text])
    note(f"{args.html} leaves out {left_out}")
    return DONE


def _scene_of_map(db: Database, name: str | None) -> str:
    """Return the name of the scene to show first, by default the usual one, else the first, else the demo's.

    Raises InvalidInput if it does not exist.
    """
    name = name or usual_scene(db)
    if name is None:
        if scenes := db.scenes():
            return scenes[0].scene.name
        db.load_demo()
        db.scene(DEMO_SCENE).detect()
        return DEMO_SCENE
    store.scene_or_branch_id(db.connection, name)
    return name
