"""Make, compare, merge and drop branches of scenes."""

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import psycopg

from conflictdb.model.results import Kind, Period
from conflictdb.store.connection import call, call_by_name, transaction


@dataclass(frozen=True, slots=True)
class ObjectChange:
    """An object in which a branch differs from its parent.

    change : added, changed or removed
    """

    change: str
    key: str
    kind: Kind
    name: str | None


@dataclass(frozen=True, slots=True)
class ConflictChange:
    """A conflict in which a branch differs from its parent.

    change : gone, new or changed
    verdict : in the branch; None if it is gone
    verdict_before : in the parent; None if it is new
    periods, periods_before : in the branch, and in the parent; empty if there is none
    """

    change: str
    a_key: str
    b_key: str
    verdict: str | None
    verdict_before: str | None
    periods: tuple[Period, ...] = ()
    periods_before: tuple[Period, ...] = ()


@dataclass(frozen=True, slots=True)
class BranchDiff:
    """The objects and conflicts in which a branch differs from its parent."""

    objects: list[ObjectChange]
    conflicts: list[ConflictChange]


def create_branch(conn: psycopg.Connection[Any], scene: str, name: str, proposal_id: int | None) -> None:
    """Make a branch of a scene, with the moves of a proposal if one is given.

    Raises InvalidInput if the scene does not exist, or is a branch, the name is taken, or the proposal is out of date.
    """
    with transaction(conn):
        call(conn, "create_branch", scene, name, proposal_id)


def drop_branch(conn: psycopg.Connection[Any], branch: str) -> None:
    """Remove a branch with its edits; InvalidInput for any other scene."""
    with transaction(conn):
        call(conn, "drop_branch", branch)


def merge_branch(conn: psycopg.Connection[Any], branch: str) -> int:
    """Take the edits of a branch over into its parent and remove it; return the number of changed objects.

    Raises InvalidInput, naming them, if objects were changed on both sides.
    """
    with transaction(conn):
        return int(call(conn, "merge_branch", branch)[0])


def diff_branch(conn: psycopg.Connection[Any], branch: str) -> BranchDiff:
    """Return how a branch differs from its parent; InvalidInput if one of them waits for a detection."""
    with transaction(conn):
        objects = call_by_name(conn, "branch_objects", branch)
        conflicts = call_by_name(conn, "_branch_conflicts", branch)
    return BranchDiff(
        [ObjectChange(kind=Kind(row.pop("kind")), **row) for row in objects],
        [
            ConflictChange(periods=_periods(row.pop("ends")), periods_before=_periods(row.pop("ends_before")), **row)
            for row in conflicts
        ],
    )


def _periods(ends: list[datetime | None] | None) -> tuple[Period, ...]:
    ends = ends or []
    return tuple(zip(ends[::2], ends[1::2], strict=True))


def follow_parent(conn: psycopg.Connection[Any], scene_id: int) -> None:
    """Let a branch follow changes of its parent that it has missed."""
    with transaction(conn):
        call(conn, "_follow_parent", scene_id)


def drop_orphans(conn: psycopg.Connection[Any]) -> None:
    """Remove branches that were in use when their parent was removed, and marks of removed scenes."""
    with transaction(conn):
        call(conn, "_drop_orphans")


def parent_name(conn: psycopg.Connection[Any], scene_id: int) -> str | None:
    """Return the name of the parent of a branch; None for any other scene."""
    with transaction(conn):
        name: str | None = call(conn, "_parent_name", scene_id)[0]
    return name
