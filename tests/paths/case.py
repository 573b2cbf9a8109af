"""One scene that is put to all paths, its answer by `solve`, and the comparison with it."""

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from functools import cache, cached_property
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from mixed_scenes import Mixed, mixed_scene

from conflictdb import IncompleteWarning, solve
from conflictdb.model.inputs import all_certain
from conflictdb.model.plans import Area, Motion, Scene, Track
from conflictdb.model.results import Conflict, Verdict

Pair = tuple[str, str]
Rows = dict[Pair, Conflict]

# What a record says of a pair, wherever it comes from.
FIELDS: Final = (
    "a_kind",
    "b_kind",
    "verdict",
    "certainty",
    "periods",
    "time_error_s",
    "lacking_s",
    "closest_at",
    "closest_m",
    "closest_error_m",
    "first_contact_deg",
    "closest_a_deg",
    "closest_b_deg",
)
# Fields that answers of workers lack.
PLACES: Final = frozenset({"first_contact_deg", "closest_a_deg", "closest_b_deg"})
_ROUNDING_S: Final = 2e-6


class NotApplicable(Exception):
    """The path has nothing to compare in this scene."""


Plan = TypeVar("Plan", Area, Track)


@dataclass
class Finding:
    """What a path found in a scene: the number of compared pairs or claims, and the ones that are wrong."""

    compared: int = 0
    problems: list[str] = field(default_factory=list)

    def check(self, is_right: bool, problem: str) -> None:
        """Count one claim."""
        self.compared += 1
        if not is_right:
            self.problems.append(problem)

    def add(self, other: "Finding") -> None:
        """Count all of another finding."""
        self.compared += other.compared
        self.problems += other.problems


@dataclass
class Case:
    """A scene, and a folder for files."""

    mixed: Mixed
    folder: Path

    @property
    def scene(self) -> Scene:
        return self.mixed.scene

    @cached_property
    def rows(self) -> Rows:
        """The answer of `solve`."""
        if self.mixed is scene_of(self.mixed.seed):
            return _rows_of(self.mixed.seed)
        return solved(self.mixed.tracks, self.mixed.areas, self.scene)

    @property
    def has_fixed_plane(self) -> bool:
        """Whether the plane does not depend on the objects: then answers are equal to the bit."""
        return self.scene.motion is Motion.RHUMB or self.scene.centre is not None

    @cached_property
    def rows_of_plan(self) -> Rows:
        """The pairs of the plan."""
        return only_of(self.rows, {self.mixed.plan_key})

    def single_track(self, is_exact: bool = False) -> Track:
        """Return a track with one voyage, the plan or one in conflict if possible."""
        fits = [
            track
            for track in self.mixed.tracks
            if track.departures_us is None and track.schedule is None and not (is_exact and track.tolerances)
        ]
        if not fits:
            raise NotApplicable("no track has a single voyage without tolerances")
        met = {key for pair, row in self.rows.items() if row.verdict is not Verdict.NEAR for key in pair}
        return max(fits, key=lambda track: (track.key in met, track.key == self.mixed.plan_key, track.key))

    def single_area(self) -> Area:
        """Return an area that is active at some times only, with several activations and in conflict if possible."""
        fits = [one for one in self.mixed.areas if one.schedule or one.spans_us or one.start_us or one.end_us]
        if not fits:
            raise NotApplicable("no area has a start or an end")
        met = {key for pair, row in self.rows.items() if row.verdict is not Verdict.NEAR for key in pair}
        return max(fits, key=lambda area: (bool(area.schedule or area.spans_us), area.key in met, area.key))

    def met_after(self, moved: Area | Track) -> set[str]:
        """Return the keys that a changed object meets, everything else as planned; also grazing or unresolved."""
        tracks = [moved if isinstance(moved, Track) and one.key == moved.key else one for one in self.mixed.tracks]
        areas = [moved if isinstance(moved, Area) and one.key == moved.key else one for one in self.mixed.areas]
        rows = solved(tracks, areas, replace(self.scene, nearest_m=0.0))
        return {key for pair in only_of(rows, {moved.key}) for key in pair} - {moved.key}


@cache
def scene_of(seed: int) -> Mixed:
    """Return the scene of a seed: the same object, which all paths are put to."""
    return mixed_scene(seed)


@cache
def _rows_of(seed: int) -> Rows:
    mixed = scene_of(seed)
    return solved(mixed.tracks, mixed.areas, mixed.scene)


def solved(tracks: Sequence[Track], areas: Sequence[Area], scene: Scene) -> Rows:
    """Return the answer of `solve`, by pair."""
    with idle_schedules():
        return by_pair(solve(tracks, areas, scene))


@contextmanager
def idle_schedules() -> Iterator[None]:
    """Allow schedules without an activation."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "no activation|.*no activation", IncompleteWarning)
        yield


def by_pair(rows: Iterable[Conflict]) -> Rows:
    """Return rows by their pairs; each pair has one."""
    found: Rows = {}
    for row in rows:
        assert (row.a_key, row.b_key) not in found, row
        found[row.a_key, row.b_key] = row
    return found


def only_of(rows: Rows, keys: Iterable[str]) -> Rows:
    """Return the rows with one of some keys."""
    wanted = set(keys)
    return {pair: row for pair, row in rows.items() if wanted & set(pair)}


def same(
    expected: Rows, found: Iterable[Conflict], *, without: frozenset[str] = frozenset(), is_exact: bool = True
) -> Finding:
    """Compare rows with those of `solve`: to the bit, or within the bounds of both.

    without : fields that the path does not return
    """
    rows, finding = by_pair(found), Finding()
    for pair in sorted(expected.keys() | rows.keys()):
        own, other = expected.get(pair), rows.get(pair)
        if own is None or other is None:
            row = own or other
            assert row is not None
            # Rounding decides whether two shapes that only touch are reported.
            is_touch = not is_exact and row.verdict is Verdict.GRAZING
            word = "is missing" if other is None else "is extra"
            finding.check(is_touch, f"{pair} {word}: {row.verdict}, {row.periods}")
            continue
        differing = [name for name in FIELDS if name not in without and not _agree(name, own, other, is_exact)]
        values = ", ".join(f"{name} {getattr(own, name)!r} but {getattr(other, name)!r}" for name in differing)
        finding.check(not differing, f"{pair} differs: {values}")
    return finding


def _agree(name: str, own: Conflict, other: Conflict, is_exact: bool) -> bool:
    one, two = getattr(own, name), getattr(other, name)
    if is_exact or name in ("a_kind", "b_kind"):
        return bool(one == two)
    if name == "verdict":
        return one == two or Verdict.GRAZING in (one, two)
    error_s = own.time_error_s + other.time_error_s + _ROUNDING_S
    if name == "periods":
        if Verdict.GRAZING in (own.verdict, other.verdict):
            return True
        return len(one) == len(two) and all(
            _near(a, b, error_s)
            for mine, others in zip(one, two, strict=True)
            for a, b in zip(mine, others, strict=True)
        )
    if name in ("closest_m", "lacking_s"):
        if one is None or two is None:
            return one is two
        errors = (own.closest_error_m or 0.0) + (other.closest_error_m or 0.0) if name == "closest_m" else error_s
        return abs(one - two) <= errors + 1e-6
    return name != "certainty" or one == two


def _near(one: datetime | None, two: datetime | None, error_s: float) -> bool:
    if one is None or two is None:
        return one is two
    return abs(one - two) <= timedelta(seconds=error_s)


def at_speed(track: Track, factor: float) -> Track:
    """Return a track at a factor of its speed on all legs, as large at each waypoint as planned."""
    since_us = np.rint((track.times_us - track.times_us[0]) / factor).astype(np.int64)
    times = all_certain(track.times_us[0] + since_us)
    return replace(track, times_us=times, grow_mps=track.grow_mps * factor, max_speed_kn=np.inf)


def waiting(track: Track, waypoint: int, by_us: int) -> Track:
    """Return a track that waits at a waypoint, 1 the first: it has that waypoint twice."""
    k = waypoint - 1
    times = np.insert(track.times_us, k + 1, track.times_us[k]).astype(np.int64)
    times[k + 1 :] += by_us
    positions = np.insert(track.positions_deg, k + 1, track.positions_deg[k], axis=0)
    if np.array_equal(track.positions_deg[k], track.positions_deg[k + 1]):  # it stands there as planned
        positions, times = (
            track.positions_deg,
            np.where(np.arange(len(track.times_us)) > k, track.times_us + by_us, track.times_us),
        )
    return replace(track, positions_deg=positions, times_us=all_certain(times), max_speed_kn=np.inf)
