"""`demo`: take a small packaged scene through all stages."""

import argparse
import os
import shlex
import sys
from importlib.util import find_spec
from typing import Final

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import conflict_table
from conflictdb.cli.meter import shown_phases
from conflictdb.cli.output import out, program
from conflictdb.cli.pictures import show_map
from conflictdb.cli.session import database
from conflictdb.cli.tables import show_table, table, wrapped
from conflictdb.client.database import DEMO_SCENE
from conflictdb.core.ranking import worst_first
from conflictdb.jobs.detect import Run

# Pairs that the scene was designed to show; mentioned only if the detection agrees.
_FALSE_ALARM: Final = ("CONVOY-1", "CONVOY-2")
_BELOW: Final = ("SUB-1", "SUB-2")


def demo(args: argparse.Namespace) -> int:
    """Load the scene, detect it completely, and show conflicts and stages; at a terminal, show the map, too."""
    # A database from the environment need not be named, and its password must not be printed.
    given = args.dsn and args.dsn != os.environ.get("CONFLICTDB_DSN")
    command = f"{program()} --dsn {shlex.quote(args.dsn)}" if given else program()
    with database(args) as db:
        db.load_demo()
        with shown_phases() as phase:
            run = db.scene(DEMO_SCENE).detect(full=True, phase=phase)
        scene = db.scene(DEMO_SCENE)
        found = scene.conflicts()
        known = scene.depths(found)
        args.scene = DEMO_SCENE  # the last one used
        (state,) = (scene for scene in db.scenes() if scene.scene.name == DEMO_SCENE)
    others = "(or positions in .csv, GPX, KML, GeoPackage, GeoParquet)"
    out(wrapped(f"Your own plans: {command} detect my.geojson {others}"))
    out(wrapped(f"Here, a strait on 1 June 2026: {state.areas} closed areas, {state.tracks} moving havens."))
    out()
    show_table(conflict_table(worst_first(found, known), known=known))
    out()
    out(funnel_table(run))
    out()
    pairs = {(conflict.a_key, conflict.b_key) for conflict in found}
    if _FALSE_ALARM not in pairs:
        told = "passed every stage but the last: one follows the other and they never touch."
        out(wrapped(f"CONVOY-1 and CONVOY-2 {told}"))
    if _BELOW not in pairs:
        out(wrapped("SUB-1 and SUB-2 cross, but one passes below the other: the first stage told them apart."))
    out()
    out("Try next:")
    out(f"  {command} conflicts --format geojson > conflicts.geojson   # for a map")
    out(f"  {command} export {DEMO_SCENE}.geojson   # change it, then:")
    out(f"  {command} detect {DEMO_SCENE}.geojson")
    out(f"  {command} status")
    out(f"  {command} psql   # the view conflictdb.conflicts, and what else SQL can ask")
    out(f"  {command} map   # the scene in your browser, with time; Ctrl-C ends it")
    return show_map(args) if _is_watched() else DONE


def _is_watched() -> bool:
    """Return whether a person sees this."""
    is_terminal = sys.stdin.isatty() and sys.stdout.isatty() and not os.environ.get("CI")
    return is_terminal and all(map(find_spec, ("starlette", "uvicorn")))


def funnel_table(run: Run) -> str:
    """Return the number of pairs of pieces after each stage, and its time."""
    met = f"they do: {run.conflicts} pairs of objects, with exact times"
    rows = [
        ["1 broad phase", "boxes meet in space, time and height", run.candidate_pairs, _ms(run.stage1_s)],
        ["2 intersection", "swept hulls meet", run.intersecting_pairs, _ms(run.stage2_s)],
        ["3 projection", "they are not yet shown apart", run.window_pairs, _ms(run.stage3_s)],
        ["4 solver", met, run.met_pairs, _ms(run.stage4_s)],
    ]
    return table(["STAGE", "KEEPS PAIRS OF PIECES WHERE", "PAIRS", "TIME"], rows, right=["PAIRS", "TIME"])


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms"
