"""The conflicts that follow from latenesses: alarms, which begin when the slack of a pair is used up.

The pairs come from the stored differences (`store.following`). When and where they meet is asked of copies of both
plans, shifted by their latenesses. A track that is off is somewhere in a disc that grows until its next position.
"""

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import Any, Final

import numpy as np
import psycopg

from conflictdb import store
from conflictdb.core.keeping import OFF, Kept
from conflictdb.core.late_pairs import LatePairs, conflicts_if_late
from conflictdb.core.members import Members
from conflictdb.core.world import World
from conflictdb.earth.registry import Setup
from conflictdb.jobs.members_near import members
from conflictdb.jobs.off_plan import around
from conflictdb.model.plans import Scene
from conflictdb.model.results import Conflict

# An alarm ends when its pair has this much slack again, or its contact is over, or its track is on its plan again, for
# this long: latenesses waver, and so do ships at the edge of what is planned.
ENDS_AT_US: Final = 60_000_000
_NO_DELAYS: Final = "the scene stores no delays: set delays_within_s"
_BEYOND: Final = "its lateness exceeds delays_within_s ({:g} s)"
OFF_REASON: Final = "off its plan: it may be anywhere that it can reach"
_LOST: Final = "off its plan when it was last heard of"
_SLACK: Final = "they have slack again, less than {:g} s"

_PLANNED: Final = "planned"
_VERDICTS: Final = {"must": "must", _PLANNED: "must"}

Pair = tuple[str, str]


def follow(
    conn: psycopg.Connection[Any],
    scene_id: int,
    settings: Scene,
    states: Mapping[str, Kept],
    was_off: AbstractSet[str],
    now_us: int,
) -> None:
    """Store what follows from new states of tracks of a scene, which are stored, in the open transaction of a look.

    was_off : the keys of those that were off before
    """
    rows = store.following(conn, scene_id, list(states))
    former = store.open_alarms(conn, scene_id, list(states))
    found: dict[Pair, store.Alarm] = {}
    # The last row of a pair counts, if both of its tracks are late.
    met = {_pair(row): row for row in rows if row.verdict is not None}
    # As planned it is no alarm, but one that has begun has no slack yet.
    met = {pair: row for pair, row in met.items() if row.verdict != _PLANNED or pair in former}
    plans = _plans(conn, scene_id, settings, {key for row in met.values() for key in (row.key, row.other_key)})
    found |= _alarms(settings, plans, met, None, now_us)
    off = {key for key, state in states.items() if state.state == OFF}
    if off:
        plans, reached, lost = around(conn, scene_id, settings, off, now_us)
        found |= {(key, ""): store.Alarm("may", OFF_REASON) for key in lost}
        found |= _alarms(settings, plans, {_pair(row): row for row in reached}, OFF_REASON, now_us)
    near = {_pair(row): row.slack_us for row in rows}
    slack: dict[str, float] = {}
    for row in rows:
        if row.verdict is None:
            slack[row.key] = min(slack.get(row.key, np.inf), row.slack_us / 1e6)
        elif _pair(row) in found:
            slack[row.key] = 0.0
    horizon_us = round(1e6 * settings.delays_within_s)
    for key, state in states.items():
        late = state.late_us
        if state.is_as_planned or state.is_over or state.state == OFF:
            continue
        if late is None:
            found[key, ""] = store.Alarm("may", _LOST)
        elif not horizon_us:
            found[key, ""] = store.Alarm("may", _NO_DELAYS)
        elif late[0] < -horizon_us or late[1] > horizon_us:
            found[key, ""] = store.Alarm("may", _BEYOND.format(settings.delays_within_s))
    ended = []
    for pair, alarm in former.items():
        last_us = np.inf if alarm.last_us is None else alarm.last_us
        if pair in found:
            # Their distance rose, and falls again: another alarm.
            if last_us < now_us and (found[pair].first_us or 0) > max(last_us, now_us):
                ended.append(pair)
        elif last_us >= now_us and alarm.reason == OFF_REASON and was_off & {*pair}:
            found[pair] = alarm
        elif last_us >= now_us and alarm.reason == OFF_REASON and (alarm.as_of_us or 0) + ENDS_AT_US >= now_us:
            continue
        elif last_us + ENDS_AT_US < now_us or not 0 < near.get(pair, ENDS_AT_US) < ENDS_AT_US:
            ended.append(pair)
        else:
            found[pair] = alarm._replace(verdict="may", reason=_SLACK.format(ENDS_AT_US / 1e6))
    store.put_alarms(conn, scene_id, now_us, found, ended, slack)


def _pair(row: store.Following) -> Pair:
    """Return the keys of a pair: a track before an area, else in the order of bytes."""
    if row.other_kind == 1 and row.other_key.encode() < row.key.encode():
        return row.other_key, row.key
    return row.key, row.other_key


def _plans(conn: psycopg.Connection[Any], scene_id: int, settings: Scene, keys: set[str]) -> Members:
    if not keys:
        return Members.none()
    objects = store.replaced_objects(conn, scene_id, sorted(keys), None)
    return members(conn, scene_id, World(Setup.of(settings)), None, objects)


def _alarms(
    settings: Scene, plans: Members, rows: Mapping[Pair, store.Following], reason: str | None, now_us: int
) -> dict[Pair, store.Alarm]:
    """Return the alarms of pairs that meet at some lateness, without those whose contacts are over.

    Each at the difference in conflict, the first track late by about the middle; if that contact is over, at an end of
    the differences in conflict, the first track as late as possible.
    """
    place = {one.key: k for k, one in enumerate(plans.each)}
    found: dict[Pair, store.Alarm] = {}
    tried = {pair: (row.by_us, (row.low_us + row.high_us) // 2) for pair, row in rows.items()}
    ends = {pair: list(row.ends_us) for pair, row in rows.items()}
    is_first = True
    while tried:
        for pair, conflict in _conflicts(settings, plans, place, rows, tried).items():
            verdict = rows[pair].verdict or "may"
            if conflict is None and verdict == _PLANNED:
                continue
            alarm = _alarm(
                conflict, _VERDICTS.get(verdict, "may") if is_first and not reason else "may", reason, now_us
            )
            if alarm is not None:
                found[pair] = alarm
        tried = {pair: (ends[pair].pop(0), rows[pair].high_us) for pair in tried if pair not in found and ends[pair]}
        is_first = False
    # It may last until that of the latest contact that is possible.
    latest = {
        pair: (row.ends_us[0], row.high_us)
        for pair, row in rows.items()
        if pair in found and row.ends_us and (row.low_us < row.high_us or row.other_low_us < row.other_high_us)
    }
    for pair, conflict in _conflicts(settings, plans, place, rows, latest).items():
        last = None if conflict is None else _alarm(conflict, "may", reason, now_us)
        known_us = found[pair].last_us
        if last is not None and last.last_us is not None and known_us is not None:
            found[pair] = found[pair]._replace(last_us=max(known_us, last.last_us))
    return found


def _conflicts(
    settings: Scene,
    plans: Members,
    place: Mapping[str, int],
    rows: Mapping[Pair, store.Following],
    at_us: Mapping[Pair, tuple[int, int]],
) -> dict[Pair, Conflict | None]:
    """Return the conflicts of pairs: at a difference, the first of them late by about some time; None: unknown."""
    pairs: dict[Pair, tuple[int, int, int, int]] = {}
    for pair, (difference_us, wanted_us) in at_us.items():
        row = rows[pair]
        if row.key in place and row.other_key in place:
            late_us = min(max(wanted_us, difference_us + row.other_low_us), difference_us + row.other_high_us)
            late_us = min(max(late_us, row.low_us), row.high_us)
            pairs[pair] = place[row.key], place[row.other_key], late_us, late_us - difference_us
    if not pairs:
        return dict.fromkeys(at_us)
    found = conflicts_if_late(Setup.of(settings), plans, LatePairs.of(list(pairs.values())))
    return {**dict.fromkeys(at_us), **dict(zip(pairs, found, strict=True))}


def _alarm(conflict: Conflict | None, verdict: str, reason: str | None, now_us: int) -> "store.Alarm | None":
    """Return the alarm of a conflict of shifted plans; None if it is over, may without times if it is unknown."""
    if conflict is None:
        return store.Alarm("may", reason)
    spans = [(_us(first), _us(last)) for first, last in conflict.periods]
    ahead = [(first, last) for first, last in spans if last is None or last >= now_us]
    if spans and not ahead:
        return None
    first_us, last_us = ahead[0] if ahead else (None, None)
    if first_us is not None and first_us <= now_us and verdict == "must":
        verdict = "now"
    return store.Alarm(verdict, reason, first_us, last_us, conflict.first_contact_deg)


def _us(moment: Any) -> int | None:
    return None if moment is None else round(moment.timestamp() * 1e6)
