"""Certify a scene: find proofs of what was found about its objects, and write them for `check_proof.py`."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from conflictdb.core.proofs import ProofCounts, Reported, proofs_of
from conflictdb.core.world import Occupied, World, occupy
from conflictdb.formats.proof_file import proof_lines
from conflictdb.formats.writing import write_lines
from conflictdb.memory.questions import solved, world_of
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track
from conflictdb.model.results import Certified, Conflict, Verdict


def certify(
    tracks: Iterable[Track], areas: Iterable[Area], path: str | Path, scene: Scene | None = None, *, jobs: int = 1
) -> Certified:
    """Solve a scene as `solve` does, and write a file that proves its conflicts, and that there are no others.

    `check_proof.py` checks the file without this package. The file has objects, settings, verdicts and proofs.
    Nothing is proven about tracks with tolerances, about pairs with a separation in time, and about distances of near
    pairs.

    Parameters
    ----------
    path : str or Path
        The file; compressed if its name ends in .gz. It appears when it is complete.
    jobs : int
        Threads to compute in. Does not change the proofs.

    Raises
    ------
    InvalidInput
        As `solve`.
    """
    world, tracks, areas = world_of("certify", tracks, areas, scene)
    occupied = occupy(world, areas, tracks, warns=True)
    lines, counts = proof_of(world, occupied, solved(world.setup, occupied), jobs)
    write_lines(path, lines)
    return certified(occupied, counts)


def proof_of(
    world: World, occupied: Occupied, rows: Iterable[Conflict], jobs: int, about: dict[str, Any] | None = None
) -> tuple[Iterator[str], ProofCounts]:
    """Return the lines of the proof of a scene, and counts that are complete after the last.

    about : members of the first line
    """
    reported = _reported(occupied.plans(), rows)
    proofs = proofs_of(world.setup, occupied, reported, jobs)
    return proof_lines(world.setup.scene, occupied, reported, proofs, about or {}), proofs.counts


def certified(occupied: Occupied, counts: ProofCounts) -> Certified:
    """Return what was counted as a result."""
    return Certified(
        objects=len(occupied.areas) + len(occupied.tracks),
        pairs=counts.pairs,
        directions=counts.steps,
        conflicts=counts.conflicts,
        unproven_pairs=counts.unproven_pairs,
        unproven_conflicts=counts.unproven_conflicts,
    )


def _reported(objects: Sequence[Area | Track], rows: Iterable[Conflict]) -> list[Reported]:
    place = {one.key: k for k, one in enumerate(objects)}
    return [
        Reported(
            place[row.a_key],
            place[row.b_key],
            row.verdict,
            [(_microseconds(start, MINUS_INFINITY_US), _microseconds(end, INFINITY_US)) for start, end in row.periods],
            row.time_error_s,
        )
        for row in rows
        if row.verdict is not Verdict.NEAR
    ]


def _microseconds(moment: datetime | None, unbounded: int) -> int:
    return unbounded if moment is None else (moment - EPOCH) // MICROSECOND
