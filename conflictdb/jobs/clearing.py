"""Proposals of a stored scene: read it, clear it in memory, store what was found."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import psycopg

from conflictdb import store
from conflictdb.memory.resolve import moved
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.proposals import Proposal


def resolve(
    conn: psycopg.Connection[Any], scene: str, compute: Callable[[list[Track], list[Area], Scene], Proposal]
) -> Proposal:
    """Store what clears a scene, as its objects are stored, and return it with its id.

    compute : called with tracks, areas and settings

    Raises InvalidInput if the scene does not exist, or changes meanwhile, ReadOnlyDatabase on a standby.
    """
    store.require_writable(conn)  # before the search, which may take minutes
    with store.snapshot(conn):
        scene_id = store.scene_id(conn, scene)
        basis = store.proposal_basis(conn, scene_id)
        settings, areas, tracks = store.read_scene(conn, scene)
    found = compute(tracks, areas, settings)
    moves = {one.key: one for one in found.moves}
    plans: list[Area | Track] = [*areas, *tracks]
    changed = {plan.key: moved(settings, plan, moves[plan.key]) for plan in plans if plan.key in moves}
    return replace(found, proposal_id=store.put_proposal(conn, scene_id, basis, found, changed))
