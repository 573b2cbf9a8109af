"""Objects and their pieces, as far as conflicts show them: given plans, and what is stored near them."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.world import World, occupy
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Kind

Plan = Area | Track


def by_kind(plans: Sequence[Plan]) -> tuple[list[Area], list[Track]]:
    """Return the areas and the tracks of some plans."""
    return [one for one in plans if isinstance(one, Area)], [one for one in plans if isinstance(one, Track)]


class Member(NamedTuple):
    """One object, as far as conflicts show it: an area its footprint, a track its plan. owner : None: no owner."""

    kind: Kind
    key: str
    name: str | None
    footprint: Any = None
    owner: str | None = None
    plan: Callable[[], TrackBatch] | None = None

    @classmethod
    def of(cls, plan: Plan) -> Self:
        """Return a plan as a member."""
        if isinstance(plan, Area):
            return cls(Kind.AREA, plan.key, plan.name, plan.footprint, plan.owner)
        # Plans that repeat have no tolerances, for which it is read.
        return cls(Kind.TRACK, plan.key, plan.name, None, plan.owner, partial(TrackBatch.of, [plan], once=True))


class Members(NamedTuple):
    """Some objects and their pieces; of : (n,) the place in `each` of the object of a piece."""

    pieces: Pieces
    of: NDArray[np.int64]
    each: list[Member]

    @classmethod
    def none(cls) -> Self:
        """Return no objects."""
        return cls(_no_pieces(), np.empty(0, np.int64), [])

    @classmethod
    def of_plans(cls, world: World, plans: Sequence[Plan], *, warns: bool = False) -> Self:
        """Return plans; raises InvalidInput for those that do not fit the scene's plane; warns : as of `occupy`."""
        areas, tracks = by_kind(plans)
        places = [np.array([k for k, one in enumerate(plans) if isinstance(one, kind)]) for kind in (Area, Track)]
        pieces = occupy(world, areas, tracks, warns=warns).pieces
        row = pieces.object_id + np.where(pieces.kind == Kind.AREA.code, 0, len(areas))
        return cls(pieces, np.concatenate(places).astype(np.int64)[row], [Member.of(one) for one in plans])

    @classmethod
    def of_batches(
        cls, setup: Setup, areas: AreaBatch, tracks: TrackBatch, known: Mapping[tuple[int, int], Member]
    ) -> Self:
        """Return stored objects; those that cannot be cut are covered.

        known : without footprints and plans, by kind and id
        """
        pieces = pieces_of(setup, areas, tracks)
        each: list[Member] = []
        place: dict[tuple[int, int], int] = {}
        for k, number in enumerate(areas.area_id.tolist()):
            place[Kind.AREA.code, number] = len(each)
            each.append(known[Kind.AREA.code, number]._replace(footprint=areas.footprint[k]))
        for k, number in enumerate(tracks.track_id.tolist()):
            place[Kind.TRACK.code, number] = len(each)
            each.append(known[Kind.TRACK.code, number]._replace(plan=partial(tracks.take, np.array([k]))))
        ids = zip(pieces.kind.tolist(), pieces.object_id.tolist(), strict=True)
        return cls(pieces, np.array([place[one] for one in ids], np.int64), each)


@cache
def _no_pieces() -> Pieces:
    """Return no pieces, which have no plane."""
    return pieces_of(Setup.of(Scene("none")), AreaBatch.of([]), TrackBatch.of([]))
