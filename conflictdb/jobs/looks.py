"""Compare positions with plans: the looks of a worker, each in one transaction.

A look reads the positions committed since the last one, finds how late each track is, and stores its state. One session
looks at a time; the others find nothing.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import psycopg

from conflictdb import store
from conflictdb.arrays.objects import AreaBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.keeping import NEAR_US, OFF, Kept, PlannedTimes
from conflictdb.core.lateness import Positions, distances_off_m, lateness_of
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup
from conflictdb.jobs.following import ENDS_AT_US, OFF_REASON, follow
from conflictdb.model.plans import Scene

_NO_AREAS: Final = AreaBatch.of([])
# Positions of a look: their pairs of pieces fit into memory, and it ends in seconds.
_AT_ONCE: Final = 20_000
# Plans that a worker keeps cut, of each scene: some hundred megabytes.
_MOST_PLANS: Final = 100_000
# A look during which objects get other keys is done again, but not for ever.
_ATTEMPTS: Final = 4


class _StaleKeys(Exception):
    """Objects got other keys during a look."""


@dataclass(slots=True)
class _CutPlan:
    """A plan, cut once: its version, its times and speeds, and its pieces."""

    version: int
    plan: PlannedTimes
    pieces: Pieces


@dataclass(slots=True)
class _SceneLooks:
    """The plans of a scene that have been cut, by the ids of their tracks, and with which settings.

    setup : without separations
    """

    settings: Scene
    setup: Setup
    cut: dict[int, _CutPlan] = field(default_factory=dict)


class Looks:
    """The looks of a worker. What it keeps between looks only saves work.

    is_behind : whether more positions wait than the last look read
    """

    def __init__(self) -> None:
        self.is_behind = False
        self._scenes: dict[int, _SceneLooks] = {}

    def look(self, conn: psycopg.Connection[Any], now_us: int, *, is_silence_due: bool) -> int:
        """Compare positions since the last look with plans, and commit; return their number.

        Reads at most 20,000: of a backlog those of the earliest transactions, of a larger transaction the oldest ones.

        is_silence_due : unless more positions wait, also look which tracks are silent, and which have other plans than
            their states are of
        """
        self.is_behind = False
        for attempt in range(1, _ATTEMPTS + 1):
            with suppress(_StaleKeys):
                is_last = attempt == _ATTEMPTS
                read, self.is_behind = self._attempt(conn, now_us, is_silence_due=is_silence_due, is_last=is_last)
                return read
        raise AssertionError("the last attempt counts")

    def _attempt(
        self, conn: psycopg.Connection[Any], now_us: int, *, is_silence_due: bool, is_last: bool
    ) -> tuple[int, bool]:
        """Return how many positions were read, and whether more wait."""
        with store.transaction(conn):
            heard = store.new_positions(conn, _AT_ONCE)
            is_behind = store.is_behind(conn)
            self._compare_all(conn, heard, now_us)
            if is_silence_due and not is_behind:
                self._compare_all(conn, store.replanned(conn), now_us, is_again=True)
                self._look_for_silence(conn, now_us)
            # An alarm under the former key would end, and begin again.
            if not is_last and store.are_keys_stale(conn):
                raise _StaleKeys
        return len(heard), is_behind

    def _compare_all(
        self, conn: psycopg.Connection[Any], heard: list[store.Heard], now_us: int, *, is_again: bool = False
    ) -> None:
        of_scenes: dict[int, list[store.Heard]] = defaultdict(list)
        for one in heard:
            of_scenes[one.scene_id].append(one)
        for scene_id, some in of_scenes.items():
            for first in range(0, len(some), _AT_ONCE):
                self._compare(conn, scene_id, some[first : first + _AT_ONCE], now_us, is_again=is_again)

    def _look_for_silence(self, conn: psycopg.Connection[Any], now_us: int) -> None:
        of_scenes: dict[int, list[store.Unheard]] = defaultdict(list)
        for one in store.unheard(conn, now_us, NEAR_US):
            of_scenes[one.scene_id].append(one)
        for scene_id, some in of_scenes.items():
            cut = self._cut(conn, scene_id, {one.track_id: one.version for one in some})
            former = store.live_states(conn, scene_id, [one.key for one in some])
            states = {
                one.key: former[one.key].unheard(cut.cut[one.track_id].plan, now_us)
                for one in some
                if one.key in former and one.track_id in cut.cut
            }
            self._put(conn, scene_id, cut, former, states, {one.key: one.track_id for one in some}, now_us)
        store.end_alarms(conn, now_us, ENDS_AT_US, OFF_REASON)

    def _compare(
        self, conn: psycopg.Connection[Any], scene_id: int, heard: list[store.Heard], now_us: int, *, is_again: bool
    ) -> None:
        """Store the states that follow from positions of a scene, in the order of their instants.

        is_again : of plans that have changed, with which former states have nothing to do
        """
        known = self._cut(conn, scene_id, {one.track_id: one.version for one in heard})
        former = {} if is_again else store.live_states(conn, scene_id, list({one.key for one in heard}))
        # One that is older than another says nothing new.
        heard = [
            one
            for one in heard
            if one.track_id in known.cut and not (one.key in former and one.at_us <= former[one.key].at_us)
        ]
        if not heard:
            return
        positions = Positions(
            np.array([one.track_id for one in heard]),
            np.array([one.at_us for one in heard]),
            np.array([(one.lon, one.lat) for one in heard]),
            np.array([np.nan if one.height_m is None else one.height_m for one in heard]),
            np.array([one.error_m for one in heard]),
        )
        pieces = Pieces.concatenate([known.cut[track].pieces for track in np.unique(positions.track).tolist()])
        latenesses = lateness_of(known.setup, pieces, positions)
        states: dict[int, Kept] = {}
        last: dict[str, int] = {}
        # One that the next one says as much as is left out.
        begun_us: dict[str, int] = {}
        for k, one in enumerate(heard):
            before = states[last[one.key]] if one.key in last else former.get(one.key)
            if before is not None and one.at_us <= before.at_us:
                continue
            here = Kept(OFF, None, None, one.at_us, (one.lon, one.lat), one.height_m, one.error_m, None)
            here = here.at(known.cut[one.track_id].plan, latenesses[k], before)
            if one.key in last and here.replaces(before, begun_us[one.key]):
                del states[last[one.key]]
            else:
                begun_us[one.key] = one.at_us
            states[k], last[one.key] = here, k
        off = [k for k in last.values() if states[k].state == OFF]
        if off:
            for k, off_m in zip(off, distances_off_m(known.setup, pieces, positions.take(np.array(off))), strict=True):
                states[k] = states[k].away(float(off_m))
        tracks = {one.key: one.track_id for one in heard}
        for some in _each_once({k: heard[k].key for k in states}):
            now = {heard[k].key: states[k] for k in some}
            self._put(conn, scene_id, known, former, now, tracks, now_us)
            former |= now

    def _put(
        self,
        conn: psycopg.Connection[Any],
        scene_id: int,
        known: "_SceneLooks",
        former: Mapping[str, Kept],
        states: dict[str, Kept],
        tracks: Mapping[str, int],
        now_us: int,
    ) -> None:
        """Store states, and what follows from those whose lateness is another than before."""
        cut = {key: known.cut[tracks[key]] for key in states}
        versions = {key: one.version for key, one in cut.items()}
        fastest_mps = {key: one.plan.fastest_mps for key, one in cut.items()}
        store.put_live(conn, scene_id, now_us, states, versions, fastest_mps)
        changed = {
            key: state
            for key, state in states.items()
            if not (state.is_as_planned and key in former and former[key].is_as_planned)
        }
        if changed:
            was_off = {key for key in changed if key in former and former[key].state == OFF}
            follow(conn, scene_id, known.settings, changed, was_off, now_us)

    def _cut(self, conn: psycopg.Connection[Any], scene_id: int, versions: dict[int, int]) -> _SceneLooks:
        """Return the plans of a scene that are cut, some tracks in these versions among them, unless they are gone."""
        settings = store.read_settings(conn, scene_id)
        known = self._scenes.get(scene_id)
        if known is None or known.settings != settings or len(known.cut) > _MOST_PLANS:
            known = self._scenes[scene_id] = _SceneLooks(settings, _without_separations(settings))
        missing = [t for t, v in versions.items() if t not in known.cut or known.cut[t].version != v]
        for first in range(0, len(missing), _AT_ONCE):
            tracks = store.some_tracks(conn, scene_id, missing[first : first + _AT_ONCE])
            pieces = pieces_of(known.setup, _NO_AREAS, tracks)
            order = np.argsort(pieces.object_id, kind="stable")
            ids = pieces.object_id[order]
            for row, track in enumerate(tracks.track_id.tolist()):
                own = order[np.searchsorted(ids, track) : np.searchsorted(ids, track, side="right")]
                version = int(tracks.version[row])
                known.cut[track] = _CutPlan(version, PlannedTimes.of(tracks, row), pieces.take(own))
        return known


def _each_once(keys: Mapping[int, str]) -> Iterator[list[int]]:
    """Yield the rows of keys in order, in parts that have each key at most once."""
    part: list[int] = []
    seen: set[str] = set()
    for k in sorted(keys):
        if keys[k] in seen:
            yield part
            part, seen = [], set()
        part.append(k)
        seen.add(keys[k])
    yield part


def _without_separations(scene: Scene) -> Setup:
    """Return the setup of a scene for positions: a haven contains them, without its separations."""
    return Setup.of(
        replace(scene, separation_m=0.0, vertical_separation_m=0.0, time_separation_s=0.0, nearest_m=0.0, rules=())
    )
