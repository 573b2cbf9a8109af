"""At which speeds a track, or one of its legs, is in conflict: factors of time, from the kernel.

A track at f times its planned speed takes k = 1 / f as long: what it does at u, seconds after its departure, it does
at k u. It meets an object that is at the same place at v if and only if k = v / u; with a separation in time, T, if k u
and v are at most T apart (`factors_within`). If one leg alone has another speed, that holds on this leg, since its
beginning; what comes before it stays as planned, and what comes after is (k - 1) L later, L being the duration of the
leg. Outer intervals contain all forbidden speeds; inner ones contain no others. With a separation in time nothing is
proven about two tracks if one climbs, unless their heights always overlap.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows
from conflictdb.core import delays, forbidden
from conflictdb.core.climbs import with_heights
from conflictdb.core.delays import Differences
from conflictdb.core.factors_within import factors_within
from conflictdb.core.near import Memory, Question
from conflictdb.core.pieces.covers import COVER, is_covered
from conflictdb.earth.registry import Setup
from conflictdb.kernel.differences import Shifts, difference_parts
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Scene
from conflictdb.model.results import ForbiddenSpeeds, Kind, Speeds

_Ints = NDArray[np.int64]

# Units of speeds, by the planned one: a trillionth moves the end of a voyage of ten days by a microsecond.
UNIT: Final = 10**12
# More than factors are rounded by, relative.
_ROUNDING: Final = 1e-15
# More than instants are rounded by, microseconds: those of waypoints after another speed, and differences.
_ROUNDED_US: Final = 1.0


def speeds_of_tracks(
    setup: Setup,
    placed: Memory,
    tracks: _Ints,
    begin_us: _Ints,
    end_us: _Ints,
    slowest: float,
    fastest: float,
    threads: int = 1,
) -> Differences:
    """Return the speeds from slowest to fastest, in `UNIT` of the planned one, that bring tracks into contact.

    Each track alone has another speed; the rows of one do not depend on the others asked about.

    setup : which the pieces were made with
    tracks : (m,) their numbers, ascending
    begin_us, end_us : (m,) when each track departs and arrives, or the leg of a single track begins and ends
    """
    parts = placed.parts(setup.scene)
    if parts[0][1] is not placed:
        given = tracks, begin_us, end_us, slowest, fastest, threads
        return Differences.concatenate([speeds_of_tracks(setup.under(own), part, *given) for own, part in parts])
    pieces, number = placed.pieces, placed.number
    least, most = 1.0 / fastest, 1.0 / slowest
    lasts_us = end_us - begin_us
    horizon_us = np.ceil(max(1.0 - least, most - 1.0) * lasts_us + _ROUNDED_US).astype(np.int64)
    within_us = setup.scene.time_separation_us
    mine = np.flatnonzero(np.isin(number, tracks) & (pieces.part != COVER))
    of = np.searchsorted(tracks, number[mine])
    is_before, is_after = pieces.end_us[mine] <= begin_us[of], pieces.start_us[mine] >= end_us[of]
    is_leg = ~(is_before | is_after)
    leg, zero_us = mine[is_leg], begin_us[of[is_leg]]
    earliest_us = zero_us + np.floor(least * (pieces.start_us[leg] - zero_us) - _ROUNDED_US).astype(np.int64)
    latest_us = zero_us + np.ceil(most * (pieces.end_us[leg] - zero_us) + _ROUNDED_US).astype(np.int64)
    earlier_us, later_us = pieces.start_us[leg] - earliest_us, latest_us - pieces.end_us[leg]
    pairs = [
        placed.rows(question)
        for question in (
            Question.shifted(mine[is_before], within_us, each_way=True),
            Question(leg, earlier_us + within_us, later_us + within_us, each_way=True),
            Question.shifted(mine[is_after], horizon_us[of[is_after]] + within_us, each_way=True),
        )
    ]
    a, b = (np.concatenate(both) for both in zip(*pairs, strict=True))
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces, a, b)
    planned = delays.delays_of_pairs(setup.scene, prepared, number, *pairs[0], 0, threads=threads)
    later = delays.delays_of_pairs(
        setup.scene, prepared, number, *pairs[2], int(horizon_us.max(initial=0)), threads=threads
    )
    zero_us = begin_us[np.searchsorted(tracks, number[pairs[1][0]])]
    return Differences.concatenate(
        [
            delays.of_covers(placed, tracks, horizon_us + within_us),
            delays.as_planned(planned),
            *(
                _of_stretched(
                    setup.scene,
                    prepared,
                    number,
                    PieceRows(pairs[1][0][some]),
                    PieceRows(pairs[1][1][some]),
                    zero_us[some],
                    least,
                    most,
                    threads,
                )
                for some in delays.batches(len(zero_us))
            ),
            _after_leg(later, lasts_us[np.searchsorted(tracks, later.track)]),
        ]
    )


def speeds_of(
    key: str, leg: int | None, keys: dict[int, str], found: Differences, slowest: float, fastest: float
) -> Speeds:
    """Return the speeds of a track; found: those of this track alone."""
    least, most = int(np.ceil(slowest * UNIT)), int(np.floor(fastest * UNIT))
    every, first, last = np.zeros(len(found.low), np.int64), np.array([least]), np.array([most])
    [own] = forbidden.answers(keys, found, every, (least, most), UNIT, first, last)
    return Speeds(
        key,
        leg,
        tuple(
            ForbiddenSpeeds(low / UNIT, high / UNIT, from_error / UNIT, to_error / UNIT, is_proven, by)
            for low, high, from_error, to_error, is_proven, by in own.forbidden
        ),
        None if own.earlier is None else own.earlier / UNIT,
        None if own.later is None else own.later / UNIT,
        own.blocked_by,
    )


def _after_leg(found: Differences, lasts_us: _Ints) -> Differences:
    """Return the speeds of a leg that delay the later legs into contact; lasts_us: (n,) of the leg of each row."""
    duration = lasts_us + np.array([found.low, found.high, found.inner_low, found.inner_high], np.float64)
    pad = np.array([[-_ROUNDED_US], [_ROUNDED_US], [0.0], [0.0]])
    return _speeds(found.track, found.other, *((duration + pad) / lasts_us))


def _of_stretched(
    scene: Scene,
    prepared: kernel.KernelScene,
    number: _Ints,
    a: PieceRows,
    b: PieceRows,
    zero_us: _Ints,
    least: float,
    most: float,
    threads: int,
) -> Differences:
    """Return the speeds at which pieces a are in contact with b, for factors of time from `least` to `most`.

    zero_us : (n,) when the track of a departs, or its leg begins
    """
    pieces, reach_m = prepared.pieces, scene.separation_m + scene.tolerance_m
    still, covered = pieces.kind[b] == Kind.AREA.code, is_covered(pieces, a, b)
    nothing, within_s = np.zeros(len(a)), scene.time_separation_us / 1e6
    a_start_s, a_end_s = (pieces.start_us[a] - zero_us) / 1e6, (pieces.end_us[a] - zero_us) / 1e6
    b_start_s, b_end_s = _since(pieces.start_us[b], zero_us), _since(pieces.end_us[b], zero_us)
    parts = []

    def put(rows: _Ints, *factors: Floats) -> None:
        parts.append(_speeds(number[a[rows]], number[b[rows]], *factors))

    # Two that move.
    rows = np.flatnonzero(~covered & ~still)
    times = a_start_s[rows], a_end_s[rows], b_start_s[rows], b_end_s[rows]
    asked = np.full(len(rows), least), np.full(len(rows), most)
    shifts = Shifts(a[rows], b[rows], zero_us[rows], zero_us[rows], *times, *asked, is_factor=True)
    left, shifts, doubt_s = with_heights(pieces, shifts)
    if scene.time_separation_us:
        row, *factors = factors_within(
            prepared, shifts, doubt_s, least, most, reach_m, scene.time_separation_us, threads
        )
        put(rows[left[row]], *factors)
    else:
        row, _, found = difference_parts(prepared, shifts, reach_m, kernel.Work(), threads)
        # Doubts of the ends of both times, as doubts of factors: a factor moves the times of a.
        doubt = np.maximum(found["inner_high"], 1.0) * doubt_s[row] / np.maximum(shifts.a_start_s[row], 1e-6)
        found["inner_low"] += doubt
        found["inner_high"] -= doubt
        put(rows[left[row]], found["outer_low"], found["outer_high"], found["inner_low"], found["inner_high"])
    # An area: a is in contact with it during some of its own seconds, at any speed.
    rows = np.flatnonzero(~covered & still)
    ever = np.full(len(rows), np.inf)
    shifts = Shifts(
        *(a[rows], b[rows], zero_us[rows], nothing[rows].astype(np.int64)),
        *(a_start_s[rows], a_end_s[rows], nothing[rows], nothing[rows], -ever, ever),
    )
    left, shifts, doubt_s = with_heights(pieces, shifts)
    row, _, found = difference_parts(prepared, shifts, reach_m, kernel.Work(), threads)
    found["inner_low"] += doubt_s[row]
    found["inner_high"] -= doubt_s[row]
    rows = rows[left]
    rows, is_known = rows[row], found["inner_low"] <= found["inner_high"]
    pad_s = _ROUNDED_US / 1e6
    first_s, last_s = b_start_s - within_s, b_end_s + within_s
    low, high = _factors(-found["outer_high"], -found["outer_low"], first_s[rows], last_s[rows], pad_s)
    inner_low, inner_high = _factors(-found["inner_high"], -found["inner_low"], first_s[rows], last_s[rows], 0.0)
    put(rows, low, high, np.where(is_known, inner_low, np.inf), np.where(is_known, inner_high, -np.inf))
    # Covers have only times.
    rows = np.flatnonzero(covered)
    low, high = _factors(a_start_s[rows], a_end_s[rows], first_s[rows], last_s[rows], pad_s)
    put(rows, low, high, np.full(len(rows), np.inf), np.full(len(rows), -np.inf))
    return Differences.concatenate(parts)


def _factors(
    a_start_s: Floats, a_end_s: Floats, b_start_s: Floats, b_end_s: Floats, pad_s: float
) -> tuple[Floats, Floats]:
    """Return the factors that bring some second of a, of 0 or more, into the time of b."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = np.where(b_start_s > pad_s, (b_start_s - pad_s) / a_end_s, 0.0)
        high = np.where(a_start_s > pad_s, (b_end_s + pad_s) / (a_start_s - pad_s), np.inf)
    return low, np.where(b_end_s > -pad_s, high, -np.inf)


def _since(instant_us: _Ints, zero_us: _Ints) -> Floats:
    """Return seconds since other instants; infinite for infinite instants."""
    endless = np.where(instant_us == MINUS_INFINITY_US, -np.inf, np.inf)
    is_known = (instant_us != MINUS_INFINITY_US) & (instant_us != INFINITY_US)
    return np.where(is_known, (np.where(is_known, instant_us, zero_us) - zero_us) / 1e6, endless)


def _speeds(
    track: _Ints, other: _Ints, low: Floats, high: Floats, inner_low: Floats, inner_high: Floats
) -> Differences:
    """Return the speeds of factors of time: outer intervals rounded outward, inner ones inward."""
    sooner, later = UNIT * (1.0 - _ROUNDING), UNIT * (1.0 + _ROUNDING)
    is_any, is_known = (low <= high) & (high > 0.0), (inner_low <= inner_high) & (inner_high > 0.0)
    return Differences(
        track[is_any],
        other[is_any],
        np.floor(_speed(high, sooner))[is_any].astype(np.int64),
        np.ceil(_speed(low, later))[is_any].astype(np.int64),
        np.where(is_known, np.ceil(_speed(inner_high, later)), 1)[is_any].astype(np.int64),
        np.where(is_known, np.floor(_speed(inner_low, sooner)), -1)[is_any].astype(np.int64),
    )


def _speed(factor: Floats, unit: float) -> Floats:
    """Return the speeds of factors, at most what 62 bits hold."""
    with np.errstate(divide="ignore"):
        return np.minimum(unit / np.maximum(factor, 0.0), 2.0**61)
