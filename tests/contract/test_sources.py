"""The contract of every source of pairs (`core.near.PairSource`): the pairs of brute force, the same rows."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np
import pytest
import scenes
import shapely
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from sources import SOURCES, Open, Opened

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.run import run_scene
from conflictdb.core.stage1_broad_phase import hulls_of
from conflictdb.core.stage2_intersection import intersections
from conflictdb.earth.registry import Setup, centred
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, EarthModel, Scene, Track

# Hulls are padded by more than a metre: a smaller overlap or gap decides no contact, plane metres.
ROUNDING_M: Final = 1e-3

Objects = tuple[Scene, Sequence[Area], Sequence[Track]]
Member = tuple[int, str, int, int]  # kind, key, part, turn


def known(scene: scenes.Known) -> Objects:
    return scene.scene, scene.areas, scene.tracks


def within(time_s: float, objects: Objects) -> Objects:
    return replace(objects[0], time_separation_s=time_s), objects[1], objects[2]


def jagged(middle: tuple[float, float], corners: int) -> shapely.Polygon:
    """A star about a place, within 1 degree of it."""
    angle = np.linspace(0.0, 2.0 * np.pi, 2 * corners, endpoint=False)
    reach = np.tile([1.0, 0.6], corners)
    return shapely.Polygon(np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1) + middle)


THROWN: Final[dict[str, Objects]] = {
    "nothing": (Scene("nothing"), [], []),
    "seam": known(scenes.seam(EarthModel.WGS84)),
    "many parts on the seam": (
        Scene("jagged"),
        [Area(f"A{i}", shapely.MultiPolygon([jagged((180.0, 10.0 + 0.2 * i), 40 + i)])) for i in range(3)],
        [],
    ),
    "touching": known(scenes.touching(EarthModel.SPHERE)),
    "heights": known(scenes.heights(EarthModel.WGS84)),
    "spans": known(scenes.spans(EarthModel.WGS84)),
    "circles over the pole": known(scenes.circles_over_the_pole()),
    "random": plain_scene(LOW_LATITUDE, 7, 8, 8),
    "spans apart in time": within(200.000001, known(scenes.spans(EarthModel.WGS84))),
    "random apart in time": within(3600.0, plain_scene(LOW_LATITUDE, 7, 8, 8)),
    "seam apart in time": within(86_400.0, known(scenes.seam(EarthModel.WGS84))),
}

every_source = pytest.mark.parametrize("open_source", SOURCES.values(), ids=list(SOURCES))
every_scene = pytest.mark.parametrize("scene_name", THROWN)


def brute_force(objects: Objects) -> tuple[Pieces, list[str], np.ndarray, np.ndarray]:
    """Pieces, the key of each, and which pairs of pieces (2, n) stage 1 must and may find."""
    scene, areas, tracks = objects
    scene = centred(scene, areas, tracks)
    pieces = pieces_of(Setup.of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
    keys = [(areas, tracks)[kind][number].key for kind, number in zip(pieces.kind, pieces.object_id, strict=True)]
    a, b = np.triu_indices(len(pieces), 1)
    differ = (pieces.kind[a] != pieces.kind[b]) | (pieces.object_id[a] != pieces.object_id[b])
    differ &= (pieces.turn[a] == 0) | (pieces.turn[b] == 0)
    differ &= (pieces.floor_m[a] < pieces.ceiling_m[b]) & (pieces.floor_m[b] < pieces.ceiling_m[a])
    within_us = scene.time_separation_us
    start, end = pieces.longer(within_us, 0).shared_span(a, b)
    box = shapely.bounds(hulls_of(pieces)) if len(pieces) else np.empty((0, 4))
    gap = np.maximum(box[a, :2] - box[b, 2:], box[b, :2] - box[a, 2:]).max(axis=1, initial=-np.inf)
    # Spans that share only an instant are tested elsewhere.
    must = differ & (start < end) & (gap <= 0.0)
    may = differ & (start <= end) & (gap <= 1.0)  # boxes of an index are rounded outward
    return pieces, keys, np.stack([a, b])[:, must], np.stack([a, b])[:, may]


def member(opened: Opened, pieces: Pieces, row: int) -> Member:
    number = int(pieces.kind[row]), int(pieces.object_id[row])
    return number[0], opened.key[number], int(pieces.part[row]), int(pieces.turn[row])


@every_source
@every_scene
def test_stages_1_and_2_find_what_brute_force_finds(dsn: str, open_source: Open, scene_name: str) -> None:
    """No candidate is missing, and all hulls that meet are found, each pair once; with regions where a member moves.

    Pieces come by kind, key, part and turn: of contacts that begin together every source reports the same one first.
    """
    objects = THROWN[scene_name]
    pieces, keys, must, may = brute_force(objects)
    hulls = hulls_of(pieces)
    columns = (pieces.kind, keys, pieces.part, pieces.turn)
    named = [(int(kind), key, int(part), int(turn)) for kind, key, part, turn in zip(*columns, strict=True)]
    apart = shapely.distance(hulls[may[0]], hulls[may[1]])
    shared = shapely.area(shapely.intersection(hulls[must[0]], hulls[must[1]]))
    surely = {frozenset((named[a], named[b])) for a, b in must[:, shared > ROUNDING_M].T}
    perhaps = {frozenset((named[a], named[b])) for a, b in may[:, apart <= ROUNDING_M].T}
    with open_source(dsn, *objects) as opened:
        chunks = list(opened.chunks())
        count = sum(len(one.a) if one.candidate_pairs is None else one.candidate_pairs for one in chunks)
        assert must.shape[1] <= count <= may.shape[1]
        for pieces, *_ in chunks:
            names = [member(opened, pieces, row) for row in range(len(pieces))]
            order = [(kind, key.encode(), part, -turn) for kind, key, part, turn in names]
            assert order == sorted(order)
        for regions in (True, False):
            found, of_objects = [], []
            for some, *candidates in (chunk[:3] for chunk in chunks):
                pairs = intersections(some, *candidates, regions=regions)
                of_chunk = set()
                for k in range(len(pairs)):
                    a, b = (member(opened, some, int(row)) for row in (pairs.a[k], pairs.b[k]))
                    found.append(frozenset((a, b)))
                    of_chunk.add(frozenset((a[:2], b[:2])))
                    region = pairs.region_xy[pairs.region_offset[k] : pairs.region_offset[k + 1]]
                    assert (len(region) > 0) == (regions and (a[0] == 1 or b[0] == 1))
                    if len(region):
                        for name in (a, b):
                            within = shapely.distance(hulls[named.index(name)], shapely.points(region))
                            assert within.max() <= ROUNDING_M
                of_objects.append(of_chunk)
            assert len(found) == len(set(found)) <= count
            assert surely <= set(found) <= perhaps
            # All pairs of the same two objects are in one chunk.
            assert sum(map(len, of_objects)) == len(set().union(*of_objects))


def rows(opened: Opened) -> dict[tuple[str, str], tuple[object, ...]]:
    """The rows of all pairs of a source, by the keys of the two objects."""
    answer: dict[tuple[str, str], tuple[object, ...]] = {}
    for found, _ in run_scene(Setup.of(opened.scene), opened.source):
        answer |= rows_of_chunk(opened, found)
    return answer


def rows_of_chunk(opened: Opened, found: Conflicts) -> dict[tuple[str, str], tuple[object, ...]]:
    answer: dict[tuple[str, str], tuple[object, ...]] = {}
    for k in range(len(found)):
        members = ((found.a_kind, found.a_id), (found.b_kind, found.b_id))
        a, b = (opened.key[int(kind[k]), int(number[k])] for kind, number in members)
        periods = found.period_us[found.period_offset[k] : found.period_offset[k + 1]].tolist()
        row = (
            *(int(found.verdict[k]), periods, float(found.time_error_s[k]), found.first_contact_deg[k]),
            *(found.closest_m[k], found.closest_us[k], found.lacking_s[k]),
        )
        assert all(MINUS_INFINITY_US <= start <= end <= INFINITY_US for start, end in periods)
        assert frozenset((a, b)) not in map(frozenset, answer)
        answer[min(a, b), max(a, b)] = row
    return answer


@cache
def rows_from_memory(name: str) -> dict[tuple[str, str], tuple[object, ...]]:
    with SOURCES["in memory"]("", *THROWN[name]) as opened:
        return rows(opened)


@every_source
@every_scene
def test_the_same_scene_has_the_same_rows_from_every_source(dsn: str, open_source: Open, scene_name: str) -> None:
    """To the bit, as from memory."""
    expected = rows_from_memory(scene_name)
    with open_source(dsn, *THROWN[scene_name]) as opened:
        found = rows(opened)
    assert found.keys() == expected.keys()
    for pair, row in found.items():
        np.testing.assert_equal(row, expected[pair], err_msg=str(pair))


@every_source
def test_footprints_are_those_of_the_areas_asked_for(dsn: str, open_source: Open) -> None:
    scene, areas, tracks = THROWN["seam"]
    with open_source(dsn, scene, areas, tracks) as opened:
        next(opened.chunks())
        numbers = [number for kind, number in opened.key if kind == 0][::-1]
        found = opened.source.footprints(np.array(numbers))
        shape = {area.key: area.footprint for area in areas}
        for number, footprint in zip(numbers, found, strict=True):
            assert shapely.equals_exact(footprint, shape[opened.key[0, number]], 0.0)
