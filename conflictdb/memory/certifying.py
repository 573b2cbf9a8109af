"""Certify a scene: find proofs of what was found about its objects, and write them for `check_proof.py`."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from conflictdb.core.proofs import Delayed, Late, ProofCounts, Reported, proofs_of
from conflictdb.core.world import Occupied, World, occupy
from conflictdb.errors import InvalidInput
from conflictdb.formats.proof_file import proof_lines
from conflictdb.formats.writing import write_lines
from conflictdb.memory.questions import delays as delays_of
from conflictdb.memory.questions import solved, world_of
from conflictdb.model import inputs
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track
from conflictdb.model.recurring_plans import later
from conflictdb.model.results import Certified, Conflict, Verdict

# The least delay is that after the last one that is forbidden: a microsecond and its rounding.
_NEXT_S: Final = 2e-6


def certify(
    tracks: Iterable[Track],
    areas: Iterable[Area],
    path: str | Path,
    scene: Scene | None = None,
    *,
    jobs: int = 1,
    delays: Collection[str] = (),
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
    delays : collection of str
        Keys of tracks whose least later departures (`delays`) are proven, too: the track is in contact with nothing
        then, and with something if it departs earlier by an error of some microseconds. Nothing is proven of tracks
        that wait first, and of those that no delay of two hours frees.

    Raises
    ------
    InvalidInput
        As `solve`, and for the key of an area, of a track with a schedule or tolerances, or of nothing.
    """
    delays = inputs.keys("certify", "delays", delays)
    world, tracks, areas = world_of("certify", tracks, areas, scene)
    occupied = occupy(world, areas, tracks, warns=True)
    lines, counts = proof_of(world, occupied, solved(world.setup, occupied), jobs, delays=delays)
    write_lines(path, lines)
    return certified(occupied, counts)


def proof_of(
    world: World,
    occupied: Occupied,
    rows: Iterable[Conflict],
    jobs: int,
    about: dict[str, Any] | None = None,
    delays: Collection[str] = (),
) -> tuple[Iterator[str], ProofCounts]:
    """Return the lines of the proof of a scene, and counts that are complete after the last.

    about : members of the first line
    delays : keys of tracks whose least delays are proven, too
    """
    reported, scene = _reported(occupied.plans(), rows), world.setup.scene
    if not delays:
        proofs = proofs_of(world.setup, occupied, reported, jobs)
        return proof_lines(scene, occupied, reported, proofs, about or {}), proofs.counts
    least, asked = _least(world, occupied, delays)
    copies = [_delayed(occupied, one, one.least_us) for one in least]
    early = _with(world, occupied, [_delayed(occupied, one, one.least_us - one.error_us) for one in least])
    keys = {one.key for one in copies}
    met = [row for row in solved(world.setup, early) if (row.a_key in keys) != (row.b_key in keys)]
    late = Late(early, [one._replace(verdict=Verdict.CONFLICT) for one in _reported(early.plans(), met)])
    occupied = _with(world, occupied, copies)
    proofs = proofs_of(world.setup, occupied, reported, jobs, least, late)
    proofs.counts.delays += asked - len(least)
    proofs.counts.unproven_delays += asked - len(least)
    return proof_lines(scene, occupied, reported, proofs, about or {}, least), proofs.counts


def _least(world: World, occupied: Occupied, keys: Collection[str]) -> tuple[list[Delayed], int]:
    """Return the least delays of tracks that are in conflict as planned, and how many have one."""
    plans, found = occupied.plans(), []
    place = {one.key: k for k, one in enumerate(plans)}
    for key in keys:
        if key in place and not _may_depart(plans[place[key]]):
            has = "is an area" if place[key] < len(occupied.areas) else "has a schedule or tolerances"
            rule = f"{key!r} {has}: only least delays of other tracks are proven; leave it out"
            raise InvalidInput("certify", "delays", rule)
    rows = delays_of(occupied.tracks, occupied.areas, world.setup.scene, key=list(keys))
    rows = [one for one in rows if one.least_later_s]
    for one in rows:
        least_s = one.least_later_s
        ends = [span for span in one.forbidden if least_s and abs(span.to_s - least_s) < _NEXT_S]
        if least_s and ends and not one.waits:
            error_us = math.ceil(1e6 * (least_s - ends[-1].to_s + ends[-1].to_error_s)) + 1
            least_us = round(1e6 * least_s)
            found.append(Delayed(place[one.key], least_us, min(error_us, least_us)))
    return found, len(rows)


def _may_depart(plan: Area | Track) -> bool:
    return isinstance(plan, Track) and plan.schedule is None and plan.tolerances is None


def _delayed(occupied: Occupied, one: Delayed, by_us: int) -> Track:
    """Return a track at another time, with a key that no object has."""
    track, keys = occupied.tracks[one.of - len(occupied.areas)], {plan.key for plan in occupied.plans()}
    key = f"{track.key} later"
    while key in keys:
        key += "'"
    return replace(later(track, by_us), key=key)


def _with(world: World, occupied: Occupied, copies: list[Track]) -> Occupied:
    return occupy(world, occupied.areas, [*occupied.tracks, *copies], is_lenient=True)


def certified(occupied: Occupied, counts: ProofCounts) -> Certified:
    """Return what was counted as a result."""
    return Certified(
        objects=len(occupied.areas) + len(occupied.tracks),
        pairs=counts.pairs,
        directions=counts.steps,
        conflicts=counts.conflicts,
        unproven_pairs=counts.unproven_pairs,
        unproven_conflicts=counts.unproven_conflicts,
        delays=counts.delays,
        unproven_delays=counts.unproven_delays,
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
