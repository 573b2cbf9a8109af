"""`map`: a scene on a map with time, in a browser."""

import argparse
from contextlib import suppress

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import note, out
from conflictdb.cli.session import connections, database, usual_scene
from conflictdb.db import store
from conflictdb.errors import ConflictDBError
from conflictdb.session.database import DEMO_SCENE, Database


def show(args: argparse.Namespace) -> int:
    """Serve the page of a scene until interrupted, or write it into a file."""
    if args.html is not None:
        return _write(args)
    try:
        from conflictdb.map.serve import PageServer
    except ImportError as error:
        if error.name not in ("starlette", "uvicorn", "anyio"):
            raise
        raise ConflictDBError("map needs starlette and uvicorn: pip install 'conflictdb[map]'") from None
    with database(args) as db, connections(args, store.map_dsn) as connect:
        scene = _scene(db, args.scene)
        with PageServer(scene, connect, args.host, args.port) as server, suppress(KeyboardInterrupt):
            out(server.address, flush=True)
            server.serve_until_interrupted()
    note("stopped")
    return DONE


def _write(args: argparse.Namespace) -> int:
    # Imported here: shapely is slow to import.
    from conflictdb.formats import write_lines
    from conflictdb.map.html import page

    with database(args) as db:
        text, left_out = page(db.connection, _scene(db, args.scene))
    write_lines(args.html, [text])
    note(f"{args.html} leaves out {left_out}")
    return DONE


def _scene(db: Database, name: str | None) -> str:
    """Return the name of the scene to show, by default the usual one, else the demo's, which is loaded.

    Raises InvalidInput if it does not exist.
    """
    name = name or usual_scene(db)
    if name is None:
        if all(status.scene.name != DEMO_SCENE for status in db.scenes()):
            db.load_demo()
            db.scene(DEMO_SCENE).detect()
        return DEMO_SCENE
    store.scene_id(db.connection, name)
    return name
