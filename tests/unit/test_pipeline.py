"""A scene through the stages: the answer does not depend on the chunks of its pairs, nor on the solver's process."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
import scenes
import shapely
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.funnel import Funnel
from conflictdb.core.near import Chunk, PairSource, Question
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.run import run_scene
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.earth.registry import Setup
from conflictdb.kernel.library import SHARE
from conflictdb.model.methods import Method
from conflictdb.model.plans import EarthModel, Scene

SCENE, AREAS, TRACKS = plain_scene(LOW_LATITUDE, 3, 6, 6)
SCENE = replace(SCENE, nearest_m=20_000.0)


@dataclass
class Chunked:
    """Pairs in `chunks` chunks; all pairs of two objects are in one."""

    pieces: Pieces
    footprint: NDArray[np.object_]
    chunks: int

    def pairs(self, _: Question) -> Iterator[Chunk]:
        a, b = candidates(self.pieces)
        objects = self.pieces.object_id[a] + self.pieces.object_id[b]
        for chunk in range(self.chunks):
            rows = np.flatnonzero(objects % self.chunks == chunk)
            yield Chunk(self.pieces, PieceRows(a[rows]), PieceRows(b[rows]))

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        return self.footprint[area_ids]

    def plans(self, track_ids: NDArray[np.int64]) -> TrackBatch:
        raise AssertionError("no track has tolerances")


def source(chunks: int) -> PairSource:
    batch = AreaBatch.of(AREAS)
    return Chunked(pieces_of(Setup.of(SCENE), batch, TrackBatch.of(TRACKS)), batch.footprint, chunks)


def rows(conflicts: Conflicts) -> set[str]:
    """All fields of each pair, in any order."""
    rows = []
    for k in range(len(conflicts)):
        periods = conflicts.period_us[conflicts.period_offset[k] : conflicts.period_offset[k + 1]].tolist()
        # No regions are needed here.
        columns = [one.name for one in fields(conflicts) if not one.name.startswith("period") and one.name != "where"]
        rows.append(repr((periods, [getattr(conflicts, name)[k].tolist() for name in columns])))
    assert len(set(rows)) == len(rows)
    return set(rows)


def run(scene: Scene, source: PairSource, **how: Any) -> tuple[Conflicts, Funnel]:
    """The conflicts of all chunks."""
    parts, summed = [], Funnel()
    for found, funnel in run_scene(Setup.of(scene), source, **how):
        parts.append(found)
        summed.add(funnel)
    return Conflicts.concatenate(parts), summed


def counts(funnel: Funnel) -> dict[str, int]:
    found = {column.name: getattr(funnel, column.name) for column in fields(funnel) if column.name.endswith("_pairs")}
    return found | funnel.effort.counts()


@pytest.mark.parametrize("method", [Method.EXACT, Method.SCREEN])
def test_chunks_of_pairs_give_what_all_of_them_give_at_once(method: Method) -> None:
    """Also one without any pair."""
    scene = replace(SCENE, method=method)
    reports: list[tuple[int, int]] = []
    whole, funnel = run(scene, source(1))
    parts, summed = run(scene, source(20), progress=lambda *done: reports.append(done))
    assert len(whole) > 5
    assert rows(parts) == rows(whole)
    assert counts(summed) == counts(funnel)
    assert reports == sorted(reports)
    decided = funnel.solved_pairs + funnel.effort.exact.closed_forms
    assert not reports or reports[-1] == (decided, decided)


@pytest.mark.parametrize(("share", "more"), [(0.25, 4), (None, 0)])
def test_progress_of_a_chunk_extrapolates_to_all_pairs_from_its_share(share: float | None, more: int) -> None:
    """An unknown share gives no estimate of the end."""

    class Part:
        def pairs(self, question: Question) -> Iterator[Chunk]:
            for chunk in source(1).pairs(question):
                yield chunk._replace(share=share)

        def footprints(self, area_ids: Any) -> Any:
            return source(1).footprints(area_ids)

        def plans(self, track_ids: Any) -> Any:
            return source(1).plans(track_ids)

    reports: list[tuple[int, int]] = []
    _, funnel = run(SCENE, Part(), progress=lambda *done: reports.append(done))
    decided = funnel.solved_pairs + funnel.effort.exact.closed_forms
    assert reports[-1] == (decided, more * decided)


@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("separation_m", [0.0, 10.0])
def test_stage_3_is_reported_for_the_pairs_that_it_decides(method: Method, separation_m: float) -> None:
    """Along the equator havens keep their shape: T and V do; not that of northbound U."""
    scene = Scene("s", earth=EarthModel.SPHERE, method=method, separation_m=separation_m)
    areas = [scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))]
    tracks = [scenes.track("T", [(0, 0), (1, 0)], [0, 3600]), scenes.track("U", [(0.5, -0.5), (0.5, 0.5)], [0, 3600])]
    # Ahead of T all the time, where T comes later.
    tracks.append(scenes.track("V", [(0.1, 0), (1.1, 0)], [0, 3600]))
    batch = AreaBatch.of(areas)
    pieces = Chunked(pieces_of(Setup.of(scene), batch, TrackBatch.of(tracks)), batch.footprint, 1)
    _, funnel = run(scene, pieces)
    exact, moving = funnel.effort.exact, funnel.intersecting_pairs
    if method is Method.EXACT and separation_m == 0.0:
        assert 0 < exact.closed_apart < exact.closed_forms < moving
        assert funnel.projected_pairs == exact.closed_forms
        assert (funnel.window_pairs, funnel.solved_pairs) == (moving - exact.closed_apart, moving - exact.closed_forms)
        assert 0.0 < funnel.stage3_s < funnel.stage3_s + funnel.stage4_s
    else:
        assert exact.closed_forms == exact.closed_apart == 0
        assert funnel.projected_pairs == (moving if method is Method.NLP else 0)
        assert (funnel.stage3_s > 0.0) == (method is Method.NLP)
        assert funnel.solved_pairs == (0 if method is Method.SCREEN else funnel.window_pairs)


def test_who_solves_the_pairs_does_not_matter() -> None:
    """One thread, or three that share them."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 3, 140, 140)
    batch = AreaBatch.of(areas)
    pieces = Chunked(pieces_of(Setup.of(scene), batch, TrackBatch.of(tracks)), batch.footprint, 1)
    alone, funnel = run(scene, pieces)
    assert funnel.solved_pairs > 2 * SHARE
    shared, effort = run(scene, pieces, jobs=3)
    assert rows(shared) == rows(alone)
    assert counts(effort) == counts(funnel)
