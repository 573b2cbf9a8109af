"""The conflicts that follow from latenesses: alarms, which begin when the slack of a pair is used up.

The pairs come from the stored differences (`store.following`). When and where they meet is asked of copies of both
plans, shifted by their latenesses. A track that is off is somewhere in a disc that grows until its next position.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import psycopg

from conflictdb import store
from conflictdb.core.keeping import OFF, Kept, PlannedTimes
from conflictdb.errors import InvalidInput
from conflictdb.jobs.plans_near import read_around
from conflictdb.memory import questions
from conflictdb.model.plans import MAX_GROWTH_MPS, Area, Scene, Track
from conflictdb.model.recurring_plans import later
from conflictdb.model.results import Conflict, Kind

# An alarm ends when its pair has this much slack again, not before: latenesses waver by seconds.
_ENDS_AT_US: Final = 60_000_000
_CORNERS: Final = 16
_NO_DELAYS: Final = "the scene stores no delays: set delays_within_s"
_BEYOND: Final = "its lateness exceeds delays_within_s ({:g} s)"
_OFF: Final = "off its plan: it may be anywhere that it can reach"
_LOST: Final = "off its plan when it was last heard of"

Pair = tuple[str, str]


def follow(
    conn: psycopg.Connection[Any],
    scene_id: int,
    settings: Scene,
    states: Mapping[str, Kept],
    plan_of: Callable[[str], PlannedTimes],
    now_us: int,
) -> None:
    """Store what follows from new states of tracks of a scene, in the open transaction of a look."""
    rows = store.following(conn, scene_id, list(states))
    former = store.open_alarms(conn, scene_id, list(states))
    found: dict[Pair, store.Alarm] = {}
    near: dict[Pair, int] = {}
    slack: dict[str, float] = {}
    met = [row for row in rows if row.verdict is not None]
    plans = _plans(conn, settings, {key for row in met for key in (row.key, row.other_key)})
    for row in rows:
        pair = _pair(row)
        near[pair] = row.slack_us
        if row.verdict is None:
            slack[row.key] = min(slack.get(row.key, np.inf), row.slack_us / 1e6)
            continue
        alarm = _contact(settings, plans, row, now_us)
        if alarm is not None:
            found[pair] = alarm
            slack[row.key] = 0.0
    horizon_us = round(1e6 * settings.delays_within_s)
    for key, state in states.items():
        late = state.late_us
        if state.is_as_planned or state.is_over:
            continue
        if state.state == OFF:
            found |= _around(conn, settings, key, state, plan_of(key), now_us)
        elif late is None:
            found[key, ""] = store.Alarm("may", _LOST)
        elif not horizon_us:
            found[key, ""] = store.Alarm("may", _NO_DELAYS)
        elif late[0] < -horizon_us or late[1] > horizon_us:
            found[key, ""] = store.Alarm("may", _BEYOND.format(settings.delays_within_s))
    ended = []
    for pair, alarm in former.items():
        is_over = alarm.last_us is not None and alarm.last_us < now_us
        if pair not in found:
            if not is_over and 0 < near.get(pair, _ENDS_AT_US) < _ENDS_AT_US:
                continue
            ended.append(pair)
    store.put_alarms(conn, scene_id, now_us, found, ended, slack)


def _pair(row: store.Following) -> Pair:
    """Return the keys of a pair: a track before an area, else in the order of bytes."""
    if row.other_kind == 1 and row.other_key.encode() < row.key.encode():
        return row.other_key, row.key
    return row.key, row.other_key


def _plans(conn: psycopg.Connection[Any], settings: Scene, keys: set[str]) -> dict[str, Area | Track]:
    if not keys:
        return {}
    _, areas, tracks = store.read_scene(conn, settings.name, sorted(keys))
    return {one.key: one for some in (areas, tracks) for one in some}


def _contact(
    settings: Scene, plans: Mapping[str, Area | Track], row: store.Following, now_us: int
) -> "store.Alarm | None":
    """Return when and where a pair meets at a difference in conflict; None if that is over, and at the latest, too."""
    verdict = row.verdict or "may"
    mine, other = plans.get(row.key), plans.get(row.other_key)
    if mine is None or other is None:
        return store.Alarm(verdict)

    def at(difference_us: int, wanted_us: int) -> "store.Alarm | None":
        """Return the alarm at a difference, the first of the pair late by `wanted_us`, or as near to it as possible."""
        late_us = min(max(wanted_us, difference_us + row.other_low_us), difference_us + row.other_high_us)
        late_us = min(max(late_us, row.low_us), row.high_us)
        conflict = _met(settings, [_later(mine, late_us), _later(other, late_us - difference_us)])
        return _alarm(conflict, verdict, None, now_us)

    alarm = at(row.by_us, (row.low_us + row.high_us) // 2)
    if alarm is None and row.latest_us is not None and (alarm := at(row.latest_us, row.high_us)) is not None:
        return alarm._replace(verdict="may")
    return alarm


def _later(plan: Area | Track, by_us: int) -> Area | Track:
    return later(plan, by_us)  # type: ignore[type-var]  # either class of the variable


def _met(settings: Scene, plans: Sequence[Area | Track]) -> Conflict | None:
    """Return the conflict of two plans; None without a conflict, or for a plan shifted out of the calendar."""
    try:
        return next(iter(_conflicts(settings, plans)), None)
    except InvalidInput:
        return None


def _conflicts(settings: Scene, plans: Sequence[Area | Track]) -> list[Conflict]:
    """Return the conflicts of plans."""
    areas = [one for one in plans if isinstance(one, Area)]
    tracks = [one for one in plans if isinstance(one, Track)]
    return [one for one in questions.solve(tracks, areas, settings) if one.verdict != "near"]


def _alarm(conflict: Conflict | None, verdict: str, reason: str | None, now_us: int) -> "store.Alarm | None":
    """Return the alarm of a conflict of shifted plans; None if it is over, without times if it is unknown."""
    if conflict is None:
        return store.Alarm(verdict, reason)
    spans = [(_us(first), _us(last)) for first, last in conflict.periods]
    ahead = [(first, last) for first, last in spans if last is None or last >= now_us]
    if spans and not ahead:
        return None
    first_us, last_us = ahead[0] if ahead else (None, None)
    if first_us is not None and first_us <= now_us:
        verdict = "now"
    return store.Alarm(verdict, reason, first_us, last_us, conflict.first_contact_deg)


def _us(moment: Any) -> int | None:
    return None if moment is None else round(moment.timestamp() * 1e6)


def _around(
    conn: psycopg.Connection[Any], settings: Scene, key: str, state: Kept, plan: PlannedTimes, now_us: int
) -> dict[Pair, "store.Alarm"]:
    """Return what a track that is off may meet until it is silent: the plans near a disc that grows."""
    until_us = max(state.at_us, now_us) + round(1e6 * store.silent_after_s(conn))
    found: dict[Pair, store.Alarm] = {}
    try:
        disc = _disc(key, state, plan, until_us)
        near, areas, tracks = read_around(conn, settings.name, disc)
        plans: list[Area | Track] = [*areas, *tracks]
        conflicts = _conflicts(near, [disc, *(_later(one, 0) for one in plans if one.key != key)])
    except InvalidInput:  # the disc leaves the plane
        return {(key, ""): store.Alarm("may", _OFF)}
    for conflict in conflicts:
        if key not in (conflict.a_key, conflict.b_key):
            continue
        other = conflict.b_key if conflict.a_key == key else conflict.a_key
        is_first = conflict.a_kind is Kind.TRACK and conflict.a_key == other
        alarm = _alarm(conflict, "may", _OFF, now_us)
        if alarm is not None:
            found[(other, key) if is_first else (key, other)] = alarm._replace(verdict="may")
    return found


def _disc(key: str, state: Kept, plan: PlannedTimes, until_us: int) -> Track:
    """Return the disc around the last position of a track that contains it later: a track that stands and grows."""
    azimuth = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    radius_m = max(state.error_m, 1.0) / np.cos(np.pi / _CORNERS)
    outline = radius_m * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    height: dict[str, Any] = {}
    if state.height_m is not None:
        height = {"floor_m": state.height_m - state.error_m, "ceiling_m": state.height_m + max(state.error_m, 1.0)}
    return Track(
        key,
        [state.lonlat, state.lonlat],
        [state.at_us, until_us],
        outline,
        grow_mps=min(plan.fastest_mps, MAX_GROWTH_MPS),
        **height,
    )
