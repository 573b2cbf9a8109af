"""Certify a stored scene: what its last detection found, on one state of the database."""

from collections.abc import Collection, Iterator
from typing import Any

import psycopg

from conflictdb import store
from conflictdb.core.proofs import ProofCounts
from conflictdb.core.world import Occupied, World, occupy
from conflictdb.errors import NotCurrent
from conflictdb.memory.certifying import proof_of


def proof_of_stored(
    conn: psycopg.Connection[Any], scene: str, *, jobs: int = 1, delays: Collection[str] = ()
) -> tuple[Iterator[str], Occupied, ProofCounts]:
    """Return the lines of the proof of a scene, its objects, and counts that are complete after the last line.

    Raises InvalidInput if the scene does not exist, NotCurrent if changes wait for a detection, StoreError if a
    transaction is open: objects and conflicts must be of one state of the database.
    """
    store.begin_snapshot(conn)
    try:
        state = store.scene_state(conn, scene)
        if not state.is_current:
            raise NotCurrent(f"scene {scene!r} is not current, so nothing is proven ({state.remark}): detect it first")
        settings, areas, tracks = store.read_scene(conn, scene)
        rows = list(store.each_conflict(conn, scene))
    finally:
        with store.translated():
            conn.rollback()
    world = World.around(settings, areas, tracks)
    occupied = occupy(world, areas, tracks, is_lenient=True)
    about = {"scene": scene, "run": max((row.run_id or 0 for row in rows), default=None)}
    lines, counts = proof_of(world, occupied, rows, jobs, about, delays)
    return lines, occupied, counts
