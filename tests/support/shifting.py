"""The oracle of delays, waits and speeds: copies of a track with other times, through stages 2 to 4."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import shapely

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows
from conflictdb.core import run
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.stage1_broad_phase import hulls_of
from conflictdb.core.stage2_intersection import intersections
from conflictdb.earth.registry import Setup, centred
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Delays


def shifted(track: Track, shift_us: int, key: str | None = None) -> Track:
    """The track departing that much later; if its first leg stands still, it waits there meanwhile."""
    moved = replace(track, key=key or track.key, times_us=track.times_us + shift_us, max_speed_kn=np.inf)
    if shift_us <= 0 or not np.array_equal(*track.positions_deg[:2]):
        return moved
    assert track.grow_mps == 0.0
    more: dict[str, Any] = {
        name: np.concatenate([values[:1], values])
        for name in ("outlines_m", "floors_m", "ceilings_m")
        if (values := getattr(track, name)) is not None
    }
    positions_deg = np.concatenate([track.positions_deg[:1], track.positions_deg])
    times_us = np.concatenate([track.times_us[:1], moved.times_us])
    # Voyages, too, begin as planned.
    return replace(moved, positions_deg=positions_deg, times_us=times_us, max_speed_kn=np.inf, **more)


def with_outlines(track: Track) -> Track:
    """The same track, whose growing haven has an outline at each waypoint instead, which other times do not change."""
    if track.grow_mps == 0.0:
        return track
    legs = np.arange(len(track.times_us) - 1)
    offset, start, end = TrackBatch.of([track]).outlines_on(np.zeros_like(legs), legs)
    outlines_m = np.stack([*np.split(start, offset[1:-1]), np.split(end, offset[1:-1])[-1]])
    return replace(track, grow_mps=0.0, outline_m=outlines_m[0], outlines_m=outlines_m, max_speed_kn=np.inf)


def waiting(track: Track, waypoint: int, wait_us: int) -> Track:
    """The track waiting that long at a waypoint, 1 the first, with the haven and the heights of the leg before."""
    if wait_us == 0:
        return track
    track, n = with_outlines(track), waypoint - 1
    more: dict[str, Any] = {
        name: np.concatenate([values[: n + 1], values[n:]])
        for name in ("positions_deg", "outlines_m")
        if (values := getattr(track, name)) is not None
    }
    for name in ("floors_m", "ceilings_m"):
        if (values := getattr(track, name)) is not None:
            # One per waypoint, or one per leg.
            kept = n + 1 if len(values) == len(track.times_us) or n == 0 else n
            more[name] = np.concatenate([values[:kept], values[kept - 1 :]])
    times_us = np.concatenate([track.times_us[: n + 1], track.times_us[n:] + wait_us])
    return replace(track, times_us=times_us, max_speed_kn=np.inf, **more)


def stretched(track: Track, factor: float, leg: int | None = None) -> Track:
    """The track at another speed, on all legs or on one, 1 the first; instants are rounded to microseconds."""
    track = with_outlines(track)
    durations_us = np.diff(track.times_us) / 1.0
    if leg is None:
        times_us = track.times_us[0] + np.rint((track.times_us - track.times_us[0]) / factor).astype(np.int64)
    else:
        times_us = track.times_us.copy()
        times_us[leg:] += round(durations_us[leg - 1] / factor) - int(durations_us[leg - 1])
    return replace(track, times_us=times_us, max_speed_kn=np.inf)


def meets_when_shifted(
    scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], key: str, shifts_us: np.ndarray
) -> list[set[str]]:
    """For each shift of a track the keys of all that it is in conflict with, also grazing or unresolved."""
    [one] = (track for track in tracks if track.key == key)
    copies = [shifted(one, shift, _copy(n)) for n, shift in enumerate(shifts_us.tolist())]
    return meets_when_changed(scene, areas, tracks, key, copies)


def _copy(number: int) -> str:
    return f"copy {number}"


def meets_when_changed(
    scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], key: str, changed: Sequence[Track]
) -> list[set[str]]:
    """For each changed copy of a track the keys of all that it is in conflict with, also grazing or unresolved."""
    scene = centred(scene, areas, tracks)
    setup = Setup.of(scene)
    rest = [track for track in tracks if track.key != key]
    copies = [
        one if one.key == _copy(n) else replace(one, key=_copy(n), max_speed_kn=np.inf) for n, one in enumerate(changed)
    ]
    batch = AreaBatch.of(areas)
    pieces = pieces_of(setup, batch, TrackBatch.of(rest + copies))
    is_copy = (pieces.kind == 1) & (pieces.object_id >= len(rest))
    hulls = hulls_of(pieces)
    mine, others = np.flatnonzero(is_copy), np.flatnonzero(~is_copy)
    i, j = shapely.STRtree(hulls[others]).query(hulls[mine])
    b, a = mine[i], others[j]  # the other object has the smaller number
    keep = (pieces.turn[a] == 0) | (pieces.turn[b] == 0)
    keep &= (pieces.floor_m[a] < pieces.ceiling_m[b]) & (pieces.floor_m[b] < pieces.ceiling_m[a])
    a, b = a[keep], b[keep]
    start, end = pieces.shared_span(PieceRows(a), PieceRows(b))
    last = np.ones(len(a), np.bool_)
    for member in (a, b):
        last &= (pieces.end_us[member] > end) | pieces.end_inclusive[member]
    keep = (start < end) | ((start == end) & last)
    order = np.lexsort((b[keep], a[keep]))
    pairs = intersections(pieces, PieceRows(a[keep][order]), PieceRows(b[keep][order]), regions=False)
    with patch.object(run, "with_closest_approaches", lambda *given: given[4]):  # they decide nothing
        conflicts, _ = run.run_stages(setup, pieces, pairs, lambda ids: batch.footprint[ids])
    found: list[set[str]] = [set() for _ in copies]
    for row in np.flatnonzero(conflicts.verdict < 3).tolist():
        of = areas if conflicts.a_kind[row] == 0 else rest
        found[conflicts.b_id[row] - len(rest)].add(of[conflicts.a_id[row]].key)
    return found


def is_forbidden(delays: Delays, shifts_us: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether each shift is in a forbidden interval, and whether it is proven to be forbidden."""
    forbidden, proven = np.zeros(len(shifts_us), np.bool_), np.zeros(len(shifts_us), np.bool_)
    for one in delays.forbidden:
        low, high = round(1e6 * one.from_s), round(1e6 * one.to_s)
        forbidden |= (shifts_us >= low) & (shifts_us <= high)
        inner_low, inner_high = low + round(1e6 * one.from_error_s), high - round(1e6 * one.to_error_s)
        proven |= one.is_proven & (shifts_us >= inner_low) & (shifts_us <= inner_high)
    return forbidden, proven


def shifts_of(delays: Delays, horizon_us: int, rng: np.random.Generator, count: int) -> np.ndarray:
    """Shifts within a horizon: some at random, and most near the ends of forbidden intervals, from a microsecond on."""
    ends = [
        [one.from_s, one.from_s + one.from_error_s, one.to_s, one.to_s - one.to_error_s] for one in delays.forbidden
    ]
    near_us = np.array([-1e6, -1e4, -10, -6, -4, -2, -1, 0, 1, 2, 4, 6, 10, 1e4, 1e6], np.int64)
    near = np.rint(1e6 * np.array(ends).reshape(-1)).astype(np.int64)[:, None] + near_us
    every = np.concatenate([rng.integers(-horizon_us, horizon_us, count), near.ravel()])
    return np.unique(every[np.abs(every) <= horizon_us])
