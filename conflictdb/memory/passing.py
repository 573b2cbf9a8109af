"""Explain the moves of a proposal: which conflicts each one clears, and how it passes what it would meet."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import datetime
from typing import Final

import numpy as np

from conflictdb.core.delays import Differences
from conflictdb.memory import questions
from conflictdb.model.plans import MAX_DISTANCE_M, METRES_PER_NMI, Area, Scene, Track
from conflictdb.model.proposals import Move, NewPlace, NewWaypoints, Passing, Side
from conflictdb.model.results import Conflict

# Closest approaches are reported up to this far beyond the required separation, metres.
_NEAR_M: Final = 10.0 * METRES_PER_NMI


def moves_of(
    scene: Scene,
    changed: Mapping[str, Track],
    areas: Iterable[Area],
    delays: Mapping[str, int],
    exact: Mapping[str, int],
    speeds: Mapping[str, float],
    ways: Mapping[str, NewWaypoints],
    places: Mapping[str, NewPlace],
    cleared: Iterable[tuple[str, str]],
    found: Differences,
    key_of: Mapping[int, str],
    departs_at: Mapping[str, datetime | None],
) -> list[Move]:
    """Return the moves, by key.

    changed : all tracks as they are after the moves
    delays, speeds, ways, places : of the plans that move, microseconds, factors
    exact : the delays before they were rounded
    cleared : the pairs that are in conflict as planned, and no longer
    found : the differences of all plans that may move
    departs_at : when these depart then
    """
    moving = sorted({*delays, *speeds, *ways, *places}, key=str.encode)
    clears: dict[str, set[str]] = {key: set() for key in moving}
    for a, b in cleared:
        for key, other in ((a, b), (b, a)):
            if key in clears:
                clears[key].add(other)
    of_key = {key_of[number]: rows for number, rows in found.of_each_track()}
    sides: dict[str, dict[str, Side]] = {}
    for key in moving:
        own = of_key.get(key)
        if key in ways or key in places:
            sides[key] = dict.fromkeys(clears[key], Side.CLEAR)
        elif key in speeds:
            sides[key] = {other: _side(speeds[key] < 1.0, changed[key], changed.get(other)) for other in clears[key]}
        else:
            sides[key] = {} if own is None else _sides(own, key_of, delays, exact, key, clears[key], changed)
    near = _near(scene, changed, areas, {(key, other) for key in moving for other in sides[key]})
    moves = []
    for key in moving:
        passes = []
        for other in sorted(sides[key], key=str.encode):
            closest = near.get((key, other))
            passes.append(
                Passing(
                    other,
                    sides[key][other],
                    None if closest is None else closest.closest_m,
                    None if closest is None else closest.closest_at,
                )
            )
        cleared_keys = tuple(sorted(clears[key], key=str.encode))
        delay_s, speed = delays.get(key, 0) / 1e6, speeds.get(key, 1.0)
        change = delay_s, speed, cleared_keys, tuple(passes), ways.get(key)
        moves.append(Move(key, *change, departs_at.get(key), is_area=key not in changed, place=places.get(key)))
    return moves


def _sides(
    own: Differences,
    key_of: Mapping[int, str],
    delays: Mapping[str, int],
    exact: Mapping[str, int],
    key: str,
    clears: set[str],
    tracks: Mapping[str, Track],
) -> dict[str, Side]:
    """Return how a delayed plan passes what it clears, and what keeps it from a smaller exact delay."""
    found = {}
    for number in np.unique(own.other).tolist():
        rows, other = own.other == number, key_of[number]
        low, high = own.low[rows], own.high[rows]
        difference, least = (some[key] - some.get(other, 0) for some in (delays, exact))
        # Sooner than the nearest interval, or later.
        away = np.maximum(low - difference, difference - high)
        nearest = int(np.argmin(away))
        if other in clears or bool(((least == low - 1) | (least == high + 1)).any()):
            found[other] = _side(difference > high[nearest], tracks.get(key), tracks.get(other))
    return found


def _side(is_later: bool, own: Track | None, other: Track | None) -> Side:
    """Return how one passes the other; areas are None. Tracks pass each other if both are under way."""
    if own is None or other is None or not _are_together(own, other):
        return Side.AFTER if is_later else Side.BEFORE
    return Side.ASTERN if is_later else Side.AHEAD


def _are_together(a: Track, b: Track) -> bool:
    """Return whether two tracks may be under way at one time; tracks with several voyages count as such."""
    if a.departures_us is not None or b.departures_us is not None:
        return True
    return bool(a.times_us[0] < b.times_us[-1] and b.times_us[0] < a.times_us[-1])


def _near(
    scene: Scene, changed: Mapping[str, Track], areas: Iterable[Area], pairs: set[tuple[str, str]]
) -> dict[tuple[str, str], Conflict]:
    """Return the closest approaches of pairs of tracks that come near to each other."""
    tracks = {key for pair in pairs for key in pair if key in changed}
    wide = replace(scene, nearest_m=min(scene.largest_separation_m + _NEAR_M, MAX_DISTANCE_M))
    found = {}
    for one in questions.solve([changed[key] for key in sorted(tracks)], [], wide):
        for pair in ((one.a_key, one.b_key), (one.b_key, one.a_key)):
            if pair in pairs:
                found[pair] = one
    return found
