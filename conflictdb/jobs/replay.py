"""Replay recorded positions as if they came now, for exercises and tests: an hour in a minute."""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import psycopg

from conflictdb import store
from conflictdb.errors import InvalidInput
from conflictdb.formats.fixes import Fixes, rows_of
from conflictdb.jobs import detect
from conflictdb.jobs.looks import Looks

# Recorded time that passes between two looks, microseconds, and in a second.
_STEP_US: Final = 10_000_000
SPEED: Final = 60.0
# A longer gap between positions is left out: one wrong date would last for years.
_LONGEST_GAP_US: Final = 86_400_000_000


def replay(
    conn: psycopg.Connection[Any],
    scene: str,
    fixes: Mapping[str, Fixes],
    *,
    speed: float = SPEED,
    report: Callable[[int, int], object] = lambda now_us, looked: None,
) -> int:
    """Insert positions of tracks of a scene at their instants, look at them then, and return their number.

    The clock of the looks is that of the positions. Positions of other keys are left out.

    It skips the rest of a gap between positions after a day. Raises InvalidInput for a position in the future, before
    it inserts any.

    speed : recorded seconds in a second
    report : called after each look with the instant and the number of positions
    """
    detect.detect_pending(conn, scene)
    with store.transaction(conn):
        unknown = store.unknown_tracks(conn, scene, list(fixes))
    every, at_us, lonlat = rows_of({key: own for key, own in fixes.items() if key not in unknown})
    if not every:
        return 0
    order = np.argsort(at_us, kind="stable")
    keys, at_us, lonlat = np.array(every, object)[order], at_us[order], lonlat[order]
    if at_us[-1] > time.time_ns() // 1000:
        raise InvalidInput(f"position of {keys[-1]!r}", "instant", "must not be in the future: these are recorded")
    looks, due_s, done = Looks(), time.monotonic(), 0
    now_us, end_us = int(at_us[0]), int(at_us[-1]) + _STEP_US
    while now_us < end_us:
        time.sleep(max(0.0, due_s - time.monotonic()))
        until = int(np.searchsorted(at_us, now_us, side="right"))
        if until > done:
            with store.transaction(conn):
                some = slice(done, until)
                store.insert_positions(conn, scene, keys[some].tolist(), at_us[some], lonlat[some])
            done = until
        looked = looks.look(conn, now_us, is_silence_due=True)
        while looks.is_behind:
            looked += looks.look(conn, now_us, is_silence_due=True)
        report(now_us, looked)
        due_s += _STEP_US / 1e6 / speed
        now_us += _STEP_US
        if done < len(at_us) and now_us - at_us[done - 1] > _LONGEST_GAP_US:
            now_us = max(now_us, int(at_us[done]))
    return done
