"""The page's what-if: what a track meets that departs at another time, as its modules compute it."""

from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any, Final

from case import Case, Finding, NotApplicable, idle_schedules, only_of, solved
from page_in_node import HORIZON_US, answers_of_page

from conflictdb.core.world import Reach, World
from conflictdb.map import what_if
from conflictdb.map.editing import PlanMove, moved
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import Track
from conflictdb.model.recurring_plans import expanded_track, later
from conflictdb.model.results import Conflict

# Later, microseconds, and higher, metres, if the track has a floor or a ceiling.
_MOVES: Final = (
    (0, 0.0),
    (417_000_000, 0.0),
    (-1_031_500_000, 0.0),
    (2_400_000_003, 0.0),
    (0, -35.5),
    (-90_000_000, 120.0),
)
_DAY_US: Final = 86_400_000_000
_ROUNDING: Final = timedelta(microseconds=2)


def what_if_of_page(case: Case) -> Finding:
    """The conflicts of delayed copies are those of `solve`, and their delays are shown as forbidden."""
    track = _track(case)
    with idle_schedules():
        pack = what_if.packed(case.scene, case.mixed.areas, case.mixed.tracks, {track.key})
        window = World.of(case.scene, case.mixed.areas, case.mixed.tracks, reach=Reach.either(_DAY_US)).window
    has_limits = any(getattr(track, name) is not None for name in ("floor_m", "ceiling_m", "floors_m", "ceilings_m"))
    moves = [(us, up_m) for us, up_m in _MOVES if has_limits or up_m == 0.0]
    [[answer]] = answers_of_page(case.folder, [(pack, [(track.key, moves)])])
    if answer.get("refusal") == "it is never under way":
        raise NotApplicable(answer["refusal"])
    finding = Finding()
    finding.check("refusal" not in answer, f"{track.key}: {answer.get('refusal')}")
    planned = track if window is None else expanded_track(track, window)
    base = EPOCH + int(answer["base"]) * MICROSECOND
    finding.check(answer["mayRise"] == has_limits, f"{track.key}: has limits: {has_limits}, may rise: not so")
    for (by_us, up_m), found in zip(moves, answer["conflicts"], strict=True):
        forbidden = dict(dict(answer["forbidden"])[up_m])
        copy = later(planned, by_us)
        copy = moved(copy, PlanMove(copy.key, "", 0, up_m, None, None))
        tracks = [copy if one.key == copy.key else one for one in case.mixed.tracks]
        rows = only_of(solved(tracks, case.mixed.areas, replace(case.scene, nearest_m=0.0)), {copy.key})
        expected = {next(key for key in pair if key != copy.key): row for pair, row in rows.items()}
        here = {one["other"]: one for one in found}
        for other in sorted(expected.keys() | here.keys()):
            row, one = expected.get(other), here.get(other)
            unlike = _unlike(row, one, base)
            finding.check(not unlike, f"{copy.key} with {other} {by_us / 1e6} s later, {up_m} m higher: {unlike}")
        for other in expected:
            spans = forbidden.get(other, [])
            is_forbidden = any(low <= by_us <= high for low, high in spans)
            finding.check(
                is_forbidden, f"{copy.key} meets {other} {by_us / 1e6} s later, {up_m} m higher, which {spans} allow"
            )
    return finding


def _track(case: Case) -> Track:
    """Return the plan, or a track in conflict if possible."""
    if not case.mixed.tracks:
        raise NotApplicable("there is no track")
    met = {key for pair in case.rows for key in pair}
    return max(case.mixed.tracks, key=lambda one: (one.key == case.mixed.plan_key, one.key in met, one.key))


def _unlike(row: Conflict | None, one: Any, base: datetime) -> str:
    """Return how the answer of the page differs from a row of `solve`."""
    if row is None or one is None:
        return f"the page has {one}, solve {row}"
    if one["verdict"] not in (row.verdict, None):
        return f"{one['verdict']} is {row.verdict}"
    error = timedelta(seconds=one["error_s"] + row.time_error_s) + _ROUNDING
    periods = [[base + us * MICROSECOND for us in map(round, period)] for period in one["us"]]
    is_like = len(periods) == len(row.periods) and all(
        end is not None and abs(at - end) <= error
        for mine, theirs in zip(periods, row.periods, strict=True)
        for at, end in zip(mine, theirs, strict=True)
    )
    return "" if is_like else f"{periods} are {row.periods}, within {error}"


PAGE_PATHS: Final = {"what-if of the page": what_if_of_page}
assert max(abs(us) for us, _ in _MOVES) < HORIZON_US
