"""Store proposals, apply them, and undo them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import psycopg
from psycopg.types.json import Jsonb

from conflictdb.errors import InvalidInput
from conflictdb.model.plans import Area, Track
from conflictdb.model.proposals import Proposal
from conflictdb.store.connection import call, call_many, transaction


def proposal_basis(conn: psycopg.Connection[Any], scene_id: int) -> dict[str, Any]:
    """Return what a proposal depends on, as the transaction sees it: settings and versions of a scene."""
    settings, last_version, objects_hash = call(conn, "_proposal_basis", scene_id)
    return {"settings": settings, "last_version": last_version, "objects_hash": objects_hash}


def put_proposal(
    conn: psycopg.Connection[Any],
    scene_id: int,
    basis: dict[str, Any],
    proposal: Proposal,
    changed: Mapping[str, Area | Track],
) -> int:
    """Store a proposal and return its id; InvalidInput if the scene has changed since the basis was read.

    changed : the plans that move, as they are then
    """
    rows = proposal.as_json()
    for row in rows["moves"]:
        plan = changed[row["key"]]
        if isinstance(plan, Area):
            row["footprint"] = None if row["place"] is None else plan.footprint.wkb_hex
            continue
        times_us = plan.times_us
        if (np.rint(times_us / 1e6 * 1e6).astype(np.int64) != times_us).any():
            rule = "cannot be kept to the microsecond: before November 1833 and after February 2106 it must be "
            rule += "whole seconds"
            raise InvalidInput(f"track {row['key']!r}", "times", rule)
        row["times_us"] = times_us.tolist()
    given = (proposal.goal.value, proposal.objective_s, proposal.bound_s, proposal.is_least)
    with transaction(conn):
        return int(
            call(conn, "_put_proposal", scene_id, Jsonb(basis), *given, Jsonb(rows["moves"]), Jsonb(rows["left"]))[0]
        )


def proposed(conn: psycopg.Connection[Any], scene: str, key: str) -> tuple[int, str, str, float, list[str]] | None:
    """Return the last proposal, open or applied, that moves an object, and how; None if there is none.

    Its id, its state, the move in one sentence and in seconds, and what changed in the scene since it was computed.
    """
    with transaction(conn):
        rows = list(call_many(conn, "_proposed", scene, key))
    return rows[0] if rows else None


def apply_proposal(conn: psycopg.Connection[Any], proposal_id: int, *, attached: bool) -> int:
    """Move the plans of a proposal, all or none; return their number.

    Raises InvalidInput if it does not exist, the scene has changed, or tracks of attached tables move unasked, and
    StoreError if it was applied before.
    """
    with transaction(conn):
        return int(call(conn, "apply_proposal", proposal_id, attached)[0])


def undo_proposal(conn: psycopg.Connection[Any], proposal_id: int, *, attached: bool) -> int:
    """Give the plans of an applied proposal their exact former times, all or none; return their number.

    Raises InvalidInput if one of them changed since, and StoreError if it is not applied.
    """
    with transaction(conn):
        return int(call(conn, "undo_proposal", proposal_id, attached)[0])
