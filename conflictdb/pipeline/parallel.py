"""Stage 4 in several processes: the same contacts, whoever computes them."""

from contextlib import closing
from dataclasses import replace

import numpy as np

from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.model import Scene
from conflictdb.motion.contract import Plane
from conflictdb.pipeline.funnel import Progress
from conflictdb.pipeline.processes import computed
from conflictdb.stage4.contacts import Effort, contacts


def contacts_by_jobs(
    scene: Scene,
    plane: Plane,
    pieces: Pieces,
    pairs: Pairs,
    first_s: Floats,
    last_s: Floats,
    *,
    jobs: int,
    pairs_per_job: int,
    progress: Progress | None,
) -> tuple[Contacts, Effort]:
    """Return the contacts of pairs, as `stage4.contacts` does, in up to so many processes.

    Where there is work for one of them only, it is done in this one.
    """
    decided = 0

    def advance(count: int) -> None:
        nonlocal decided
        decided += count
        if progress:
            progress(decided, len(pairs))

    advance(0)
    jobs = min(jobs, -(-len(pairs) // pairs_per_job))
    if jobs <= 1:
        return contacts(scene, plane, pieces, pairs, first_s, last_s, advance)
    effort, parts = Effort(), []
    starts = range(0, len(pairs), pairs_per_job)
    blocks = [PairRows(np.arange(k, min(k + pairs_per_job, len(pairs)))) for k in starts]
    tasks = (
        (scene, plane, *_with_own_pieces(pieces, pairs.take(rows)), first_s[rows], last_s[rows]) for rows in blocks
    )
    with closing(computed(contacts, tasks, jobs)) as answers:
        for number, (part, spent) in answers:
            parts.append(part.of_pairs(blocks[number]))
            effort.add(spent)
            advance(len(blocks[number]))
    return Contacts.concatenate(parts), effort


def _with_own_pieces(pieces: Pieces, pairs: Pairs) -> tuple[Pieces, Pairs]:
    """Return the pairs with only the pieces that occur in them."""
    rows, number = np.unique(np.concatenate([pairs.a, pairs.b]), return_inverse=True)
    return pieces.take(rows), replace(pairs, a=PieceRows(number[: len(pairs)]), b=PieceRows(number[len(pairs) :]))
