"""Run the stages on objects in memory (`solve`, `delays`, `speeds`, `chances`): no database, the same answer."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import tzinfo
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.object_numbers import kinds_and_ids, numbers_of
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core import speeds as stage_of_speeds
from conflictdb.core.delays import FirstStops, Leeway, differences_of, waits_of
from conflictdb.core.forbidden import delays_of_each
from conflictdb.core.funnel import Funnel
from conflictdb.core.margins import least_margins
from conflictdb.core.near import Memory
from conflictdb.core.run import run_scene
from conflictdb.core.slots import closed_of, slots_of
from conflictdb.core.to_results import to_results
from conflictdb.core.world import AS_PLANNED, Occupied, Reach, World, occupy
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.formats import from_frames
from conflictdb.memory.delay_options import DelayOptions
from conflictdb.model import inputs
from conflictdb.model.plans import MINUS_INFINITY_US, Area, Scene, Track
from conflictdb.model.recurring_plans import Window, require_one_voyage
from conflictdb.model.results import Chances, Conflict, Delays, Kind, Results, Speeds

if TYPE_CHECKING:
    import geopandas
    from matplotlib.figure import Figure
    from movingpandas import TrajectoryCollection

Object = TypeVar("Object", Area, Track)

# Speeds are at most this many times faster or slower: instants of ten days stay sharper than a microsecond.
MOST_FACTOR: Final = 100.0
# Limit of uncertain delays, seconds.
_LATEST_S: Final = 1e9


def solve(
    tracks: "Iterable[Track] | geopandas.GeoDataFrame | TrajectoryCollection",
    areas: "Iterable[Area] | geopandas.GeoDataFrame",
    scene: Scene | None = None,
    *,
    haven: Mapping[str, Any] | None = None,
    time_zone: str | tzinfo | None = None,
) -> Results[Conflict]:
    """Return the pairs of tracks and areas that interfere, without a database.

    If the scene has `nearest_m`, near pairs are returned too, with verdict near and without periods.
    `Conflict.approach` is the closest approach of a pair. Rows are in the order of their keys, areas first. Stages and
    answer are those of a detection in the database. Raises InvalidInput for objects that do not fit the scene's plane,
    for duplicate keys, and for other types than tracks and areas.

    Parameters
    ----------
    tracks, areas : iterables of Track and Area, or GeoDataFrames; tracks also a TrajectoryCollection of MovingPandas
        The columns of a GeoDataFrame have the names and units of scene files; instants are datetimes with a zone.
        Without a column `id` the index is the key. It must have a reference system; systems other than longitude and
        latitude on WGS84 are transformed. The key of a trajectory is its id; its fixes that are not reached from the
        others (faster than 2,000 kn, with a column `mmsi` 102.2 kn) are left out with a UserWarning.
    haven : mapping, optional
        Default haven for rows of frames without size columns: ``{"fore_m": 60, "aft_m": 40, ...}``, as in scene files.
    time_zone : str or tzinfo, optional
        The zone of instants of frames without one; by default they are refused.
    """
    scene = scene_of("solve", scene)
    if haven is not None or time_zone is not None or from_frames.is_frame(tracks) or from_frames.is_frame(areas):
        tracks, areas = _of_frames(tracks, areas, scene, haven, time_zone)
    world, tracks, areas = world_of("solve", tracks, areas, scene)
    return solved(world.setup, occupy(world, areas, tracks, warns=True))


def solved(setup: Setup, occupied: Occupied) -> Results[Conflict]:
    """Return the conflicts and near pairs of objects that are cut into pieces."""
    source = Memory(occupied.pieces, occupied.batches)
    found = Conflicts.concatenate([conflicts for conflicts, _ in run_scene(setup, source)])
    rows = to_results(setup.scene, occupied.named(), found)
    origin = Objects(setup.scene, {one.key: one for one in occupied.plans()})
    return Results((conflict.found_by(origin) for conflict in rows), Conflict)


def delays(
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None = None,
    key: str | Sequence[str] | None = None,
    within_s: float = 7200.0,
    now: inputs.Instant | None = None,
    clear_within_m: float | None = None,
    waypoint: int | None = None,
    *,
    margin_s: float = 0.0,
    margin_m: float = 0.0,
    start: inputs.Instant | None = None,
    end: inputs.Instant | None = None,
    best: int | None = None,
) -> list[Delays]:
    """Return when each track could depart instead: the departures that are in conflict, and the least that is not.

    Delays are of a whole plan, everything else departs as planned, and the method is `exact`. A track whose first leg
    stands still waits there until it departs; any other is nowhere before that. Its haven begins to grow when it
    departs. An area departs when it is first active; a delay moves all its activations.

    Rows are in the order of keys, areas first. Raises the errors of `solve`, and InvalidInput for an unknown key.

    Parameters
    ----------
    key : str or sequence of str, optional
        A track or an area, or several; by default each track is asked about, one at a time.
    within_s : float
        The horizon: delays of up to this many seconds, either way.
    now : instant, optional
        Nothing departs before it: neither earlier delays are possible, nor any of a plan that has departed. A track
        that stands at its first waypoint may leave it now.
    clear_within_m : float, optional
        Compute `clear_by_m` of tracks, too, up to this many metres; by default it is None.
    waypoint : int, optional
        The track, which needs a key then, waits at this waypoint, 1 the first and not the last, instead of departing
        later, with the heading, haven and heights of the end of the leg before. Up to there all stays as planned; all
        later times are later.
    margin_s, margin_m : float
        Wanted on top of the required separations in time and in distance: departures that come nearer are forbidden.
    start, end : instant, optional
        Return the free windows of departures between these, which replace the horizon, as `slots`, and what closes the
        other departures as `closed`. The plan needs a key and must not repeat.
    best : int, optional
        The number of windows to return, those nearest to the planned departure; also without `start` and `end`.
    """
    options = DelayOptions.of(within_s, now, clear_within_m, waypoint, margin_s, margin_m, start, end, best)
    return delays_over(None, tracks, areas, scene, key, options)


def delays_over(
    window: Window | None,
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None,
    key: str | Sequence[str] | None,
    options: DelayOptions,
) -> list[Delays]:
    """Return as `delays`; window : schedules are expanded over at least this time."""
    tracks, areas = each("delays", "tracks", tracks, Track), each("delays", "areas", areas, Area)
    scene = scene_of("delays", scene)
    # The answer is the one that a detection stores.
    stored_us = 0 if options.margin else round(1e6 * scene.delays_within_s)
    scene = options.margin.added_to(scene)
    given = None if key is None else _several(key)
    asked = set(given or ())
    moved = [area for area in areas if area.key in asked]
    horizon_us = options.horizon_us
    if options.has_times:
        if len(asked) != 1:
            raise InvalidInput("delays", "start", "needs the key of one track or area")
        every_plan: list[Area | Track] = [*tracks, *areas]
        for plan in every_plan:  # an unknown key is refused below
            if plan.key in asked:
                horizon_us = options.reach_us(plan, departure_us(plan, options.waypoint))
    solved_us = max(horizon_us, stored_us)
    setup, pieces, keys, numbers, known, active = _numbered(
        "delays", tracks, areas, scene, Reach.either(solved_us), window, moved
    )
    scene, placed = setup.scene, Memory(pieces)
    if options.waypoint is not None:
        number, times_us = _one_track("delays", "waypoint", scene, keys, numbers, known, key)
        require_one_voyage("delays", "waypoint", [track for track in known if track.key == keys[number]])
        waits_us = int(times_us[_place("delays", "waypoint", options.waypoint, len(times_us) - 1) - 1])
        found = waits_of(setup, placed, number, waits_us, horizon_us)
        leeway = {keys[number]: Leeway.at(waits_us, horizon_us, options.now_us)}
        rows, of_row = np.array([number], np.int64), np.zeros(len(found.track), np.int64)
    else:
        plans: list[Area | Track] = [*known, *(area for area in active.values() if area.key in asked)]
        leeway = {plan.key: Leeway.of(plan, horizon_us, options.now_us) for plan in plans}
        every_number = np.array([*active, *numbers.tolist()], np.int64)
        rows = numbers if given is None else _known(scene, keys, every_number, given)
        if options.clear_within_m is not None and moved:
            raise InvalidInput("delays", "clear_within_m", f"is of tracks: {moved[0].key!r} is an area")
        stops = FirstStops.of(TrackBatch.of(known))
        found = differences_of(setup, placed, rows, solved_us, waits=stops, moves_areas=bool(moved))
        by_number = np.argsort(rows)
        of_row = by_number[np.searchsorted(rows, found.track, sorter=by_number)]
    names = [keys[number] for number in rows.tolist()]
    leeways = [leeway[name] for name in names]
    margins = options.margin.time_us / 1e6, options.margin.distance_m
    answers = delays_of_each(names, keys, found, of_row, horizon_us, leeways, margins)
    if options.has_slots:
        order = np.argsort(of_row, kind="stable")
        each_row = np.split(order, np.searchsorted(of_row[order], np.arange(1, len(answers))))
        for row, (answer, possible) in enumerate(zip(answers, leeways, strict=True)):
            if answer.departs_at is not None:
                own = found.take(each_row[row])
                least, most = options.window_us(possible.departs_us, possible.first_us, possible.last_us)
                closed = closed_of(answer, own, least, most, keys, active)
                answers[row] = replace(answer, slots=slots_of(answer, least, most, options.best), closed=closed)
    if options.clear_within_m is None:
        return answers
    batch = TrackBatch.of(known).take(kinds_and_ids(rows)[1])
    return _with_margins(answers, setup, placed, batch, options.clear_within_m)


def departure_us(plan: Area | Track, waypoint: int | None) -> int | None:
    """Return when a plan departs, or leaves a waypoint; None for an area without a start."""
    if isinstance(plan, Track) and waypoint is not None:
        place = _place("delays", "waypoint", waypoint, len(plan.times_us) - 1)
        return int(plan.times_us[place - 1])
    departs_us = Leeway.of(plan, 0).departs_us
    return None if departs_us == MINUS_INFINITY_US else departs_us


def _with_margins(
    answers: list[Delays], setup: Setup, placed: Memory, tracks: TrackBatch, within_m: float
) -> list[Delays]:
    """Return the delays of tracks (n,) with the least distances by which they exceed the required separations."""
    free = np.array([row for row, one in enumerate(answers) if one.clear_by_s != 0.0], np.int64)
    margins_m = least_margins(setup, placed, tracks.take(free), within_m)
    margins = dict(zip(free.tolist(), np.column_stack(margins_m).tolist(), strict=True))
    rows = []
    for row, one in enumerate(answers):
        margin_m, error_m = margins.get(row, (0.0, 0.0))
        by_m = None if margin_m > within_m else max(margin_m, 0.0)
        error = None if by_m is None or error_m == np.inf else error_m
        rows.append(replace(one, clear_within_m=within_m, clear_by_m=by_m, clear_error_m=error))
    return rows


def speeds(
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None = None,
    key: str | None = None,
    slowest: float = 0.5,
    fastest: float = 2.0,
    *,
    leg: int | None = None,
) -> list[Speeds]:
    """Return at which speeds each track could go instead: those that are in conflict, and the nearest that are not.

    Speeds are factors of the planned one, for all legs together: the track departs as planned, is on each leg
    `1 / factor` times as long, and its haven is as large at each waypoint as planned. Everything else stays as planned,
    and the method is `exact`. Free speeds are free also if the instants of waypoints are rounded to microseconds.

    With a separation in time, nothing is proven about pairs of tracks of which one climbs, unless their heights always
    overlap. Rows are in the order of keys. Raises the errors of `solve`, and InvalidInput for an unknown track or leg.

    Parameters
    ----------
    key : str, optional
        A track; by default all tracks of one voyage, in one computation. Each alone has another speed.
    slowest, fastest : float
        The limits: factors of the planned speed, above 0; 1 lies between them.
    leg : int, optional
        Only this leg of the track, which needs a key then, has another speed, 1 the first. Later legs are as fast as
        planned, and earlier or later.
    """
    return speeds_over(None, tracks, areas, scene, key, slowest, fastest, leg=leg)


def speeds_over(
    window: Window | None,
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None,
    key: str | None,
    slowest: float,
    fastest: float,
    *,
    leg: int | None,
) -> list[Speeds]:
    """Return as `speeds`; window : schedules are expanded over at least this time."""
    slowest, fastest = limits(slowest, fastest)
    setup, pieces, keys, numbers, tracks = numbered("speeds", tracks, areas, scene, Reach(slowest=slowest), window)
    scene = setup.scene
    once = [row for row, track in enumerate(tracks) if track.departures_us is None and track.schedule is None]
    # If all tracks are asked about, those that repeat stay as planned.
    given = tracks if key is None and not once else [track for track in tracks if track.key == key]
    require_one_voyage("speeds", "key", given)
    if leg is not None:
        number, times_us = _one_track("speeds", "leg", scene, keys, numbers, tracks, key)
        first = _place("speeds", "leg", leg, len(times_us) - 1) - 1
        asked, ends_us = np.array([number], np.int64), times_us[[[first, first + 1]]]
    else:
        asked = numbers[once] if key is None else _known(scene, keys, numbers, [key])
        known = [tracks[row] for row in kinds_and_ids(asked)[1].tolist()]
        for track in known:
            _require_exact("speeds", track)
        ends_us = np.array([track.times_us[[0, -1]] for track in known], np.int64).reshape(-1, 2)
    every = stage_of_speeds.speeds_of_tracks(
        setup, Memory(pieces), asked, ends_us[:, 0], ends_us[:, 1], slowest, fastest
    )
    found = dict(every.of_each_track())
    nothing = every.take(np.empty(0, np.int64))
    return [
        stage_of_speeds.speeds_of(keys[number], leg, keys, found.get(number, nothing), slowest, fastest)
        for number in asked.tolist()
    ]


def limits(slowest: Any, fastest: Any) -> tuple[float, float]:
    """Return the limits of speeds, factors of the planned one. Raises InvalidInput."""
    try:
        found = float(slowest), float(fastest)
    except (TypeError, ValueError):
        found = np.nan, np.nan
    if not 1.0 / MOST_FACTOR <= found[0] <= 1.0 <= found[1] <= MOST_FACTOR:
        rule = f"must be factors from 1/{MOST_FACTOR:g} to 1, and from 1 to {MOST_FACTOR:g}"
        raise InvalidInput("speeds", "slowest, fastest", f"{rule}; got {slowest!r:.20}, {fastest!r:.20}")
    return found


def _one_track(
    what: str,
    name: str,
    scene: Scene,
    keys: Mapping[int, str],
    numbers: NDArray[np.int64],
    tracks: list[Track],
    key: str | Sequence[str] | None,
) -> tuple[int, NDArray[np.int64]]:
    """Return the number of a track, and when it is at its waypoints. Raises InvalidInput."""
    if not isinstance(key, str):
        raise InvalidInput(what, name, "needs the key of a track")
    [number] = _known(scene, keys, numbers, [key]).tolist()
    one = next(track for track in tracks if track.key == key)
    _require_exact(name, one)
    return number, one.times_us


def _require_exact(name: str, track: Track) -> None:
    """Raise InvalidInput for a track with tolerances, whose haven contains other speeds and times already."""
    if track.tolerances is not None:
        rule = "has a meaning without tolerances only: give other windows or speeds, and detect"
        raise InvalidInput(f"track {track.key!r}", name, rule)


def _place(what: str, name: str, given: Any, count: int) -> int:
    """Return the number of a waypoint or leg, 1 the first. Raises InvalidInput."""
    if isinstance(given, bool) or not isinstance(given, int) or not 1 <= given <= count:
        raise InvalidInput(what, name, f"must be from 1 to {count}, of this track; got {given!r:.20}")
    return given


def chances(
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None = None,
    departures: Mapping[str, Any] | None = None,
) -> Chances:
    """Return how likely conflicts are if departures are uncertain: bounds on either side.

    Conflicts are those of tracks, with each other and with areas. All departures are independent of each other, and the
    method is `exact`. A departure shifts a whole plan: nothing of it is there before, and nothing after. The work is
    bounded: with many pairs, and with large empirical distributions, bounds are wider.

    Raises the errors of `solve`, and InvalidInput for an unknown track or another distribution.

    Parameters
    ----------
    departures : mapping, optional
        Delays in seconds by the keys of tracks: ``scipy.stats.norm(60, 300)``, ``scipy.stats.uniform(-300, 900)``, or a
        sequence of delays, each as likely. All other tracks depart as planned.
    """
    from conflictdb.core import chances as stage  # not above: it brings scipy

    uncertain: dict[str, stage.Uncertain] = {}
    for key, given in _by_key("departures", departures).items():
        try:
            uncertain[key] = stage.Uncertain.of(given, -_LATEST_S, _LATEST_S)
        except (TypeError, ValueError):
            rule = "must be norm or uniform of scipy.stats, with their parameters, or finite delays in seconds"
            limits = f"from {-_LATEST_S:g} to {_LATEST_S:g}"
            raise InvalidInput("chances", f"departures[{key!r}]", f"{rule}, {limits}; got {given!r:.60}") from None
    least_s, most_s = ([0.0, *(getattr(one, end) for one in uncertain.values())] for end in ("low", "high"))
    reach = Reach(math.ceil(-1e6 * min(least_s)), math.ceil(1e6 * max(most_s)))
    setup, pieces, keys, numbers, _ = numbered("chances", tracks, areas, scene, reach)
    known = {int(_known(setup.scene, keys, numbers, [key])[0]): one for key, one in uncertain.items()}
    tail = sum(one.tail for one in known.values())
    pairs, any_of = stage.chances_of(setup, Memory(pieces), numbers, known, tail)
    least, most = (float(sum(bound[k] for bound in pairs.values())) for k in (0, 1))
    return Chances(
        {(keys[a], keys[b]): bounds for (a, b), bounds in pairs.items()},
        (least, most + tail * len(keys)),
        {keys[number]: any_of.get(number, (0.0, tail)) for number in numbers.tolist()},
    )


def _by_key(name: str, given: Any) -> Mapping[str, Any]:
    """Return distributions by the keys of tracks. Raises InvalidInput."""
    if not isinstance(given, Mapping | None):
        rule = "must be distributions by the keys of tracks, or absent"
        raise InvalidInput("chances", name, f"{rule}; got {given!r:.60}")
    return given or {}


def numbered(
    what: str,
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None,
    reach: Reach = AS_PLANNED,
    window: Window | None = None,
) -> tuple[Setup, Pieces, dict[int, str], NDArray[np.int64], list[Track]]:
    """Return the setup and the pieces, the keys of all objects by number, the numbers of tracks, and these.

    reach : how far the question moves tracks
    window : schedules are expanded over at least this time
    """
    return _numbered(what, tracks, areas, scene, reach, window)[:5]


def numbered_with_areas(
    what: str,
    tracks: Iterable[Track],
    areas: Sequence[Area],
    scene: Scene | None,
    reach: Reach,
    movable: Collection[str],
) -> tuple[Setup, Pieces, dict[int, str], list[Track], list[Area]]:
    """Return the setup and the pieces, the keys of all objects by number, the tracks, and the areas.

    movable : the keys of areas that the question moves as far as the tracks
    """
    moved = [area for area in areas if area.key in movable]
    setup, pieces, keys, _, known, active = _numbered(what, tracks, areas, scene, reach, None, moved)
    return setup, pieces, keys, known, [*active.values()]


def _numbered(
    what: str,
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None,
    reach: Reach,
    window: Window | None,
    moved: Sequence[Area] = (),
) -> tuple[Setup, Pieces, dict[int, str], NDArray[np.int64], list[Track], dict[int, Area]]:
    """Return as `numbered`, and the areas by number.

    moved : areas that the question moves as far as the tracks
    """
    world, sorted_tracks, sorted_areas = world_of(what, tracks, areas, scene, reach, window, moved)
    occupied = occupy(world, sorted_areas, sorted_tracks, warns=True)
    known = occupied.tracks
    numbers = numbers_of(np.full(len(known), Kind.TRACK.code), np.arange(len(known)))
    keys = dict(enumerate(area.key for area in occupied.areas)) | dict(
        zip(numbers.tolist(), (track.key for track in known), strict=True)
    )
    return world.setup, occupied.pieces, keys, numbers, known, dict(enumerate(occupied.areas))


def world_of(
    what: str,
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None,
    reach: Reach = AS_PLANNED,
    window: Window | None = None,
    moved: Sequence[Area] = (),
) -> tuple[World, list[Track], list[Area]]:
    """Return the world of a question, and its tracks and areas in the order of their keys; raises InvalidInput.

    moved : areas that the question moves as far as the tracks
    """
    scene = scene_of(what, scene)
    # Numbered by key, as in the database: the answer does not depend on the order of the objects. World.of checks keys.
    known = sorted(each(what, "tracks", tracks, Track), key=_order)
    others = sorted(each(what, "areas", areas, Area), key=_order)
    return World.of(scene, others, known, reach=reach, known=window, moved=moved), known, others


def scene_of(what: str, scene: Any) -> Scene:
    """Return the settings of a question, by default those of a scene in memory; raises InvalidInput."""
    if not isinstance(scene, Scene | None):
        raise InvalidInput(what, "scene", f"must be a Scene, or absent; got {scene!r:.60}")
    return scene or Scene("in memory")


def _order(one: Area | Track) -> bytes:
    return one.key.encode(errors="surrogatepass")


def _known(
    scene: Scene, keys: Mapping[int, str], numbers: NDArray[np.int64], given: Collection[str]
) -> NDArray[np.int64]:
    """Return the numbers of some tracks, in order. Raises InvalidInput if there is none of a key."""
    of_key = {keys[number]: number for number in numbers.tolist()}
    for key in given:
        if not isinstance(key, str) or key not in of_key:
            problem = "is an area, which does not depart" if key in keys.values() else "is not known"
            raise InvalidInput(f"scene {scene.name!r}", "key", f"{key!r} {problem}")
    return np.array(sorted({of_key[key] for key in given}), np.int64)


def _several(key: Any) -> Collection[str]:
    """Return the keys given, one or several. Raises InvalidInput."""
    if isinstance(key, str):
        return [key]
    if not isinstance(key, Collection):
        raise InvalidInput("delays", "key", f"must be the key of a track or an area, or several; got {key!r:.60}")
    for one in key:
        if not isinstance(one, str):
            raise InvalidInput("delays", "key", f"{one!r:.60} is not known")
    return key


def counts(scene: Scene, areas: list[Area], tracks: list[Track]) -> Funnel:
    """Return what the stages count on the objects of a stored scene."""
    total = Funnel()
    occupied = occupy(World(Setup.of(scene)), areas, tracks, is_lenient=True)
    for _, funnel in run_scene(Setup.of(scene), Memory(occupied.pieces, occupied.batches)):
        total.add(funnel)
    return total


class Objects:
    """The input of `solve`, by key, for drawing its conflicts."""

    def __init__(self, scene: Scene, objects: Mapping[str, Area | Track]) -> None:
        self._scene, self._objects = scene, objects

    def plot_conflict(self, conflict: Conflict) -> "Figure":
        """Return the figure of a conflict; `conflict.plot()` calls this."""
        from conflictdb.plot import figures  # not above: it brings matplotlib

        a, b = (self._objects[key] for key in (conflict.a_key, conflict.b_key))
        return figures.plot_pair(self._scene, a, b, conflict)


def _of_frames(
    tracks: Any, areas: Any, scene: Scene, haven: Mapping[str, Any] | None, time_zone: str | tzinfo | None
) -> tuple[Iterable[Track], Iterable[Area]]:
    """Return the objects of frames, and others as given; raises InvalidInput."""
    in_frames = from_frames.is_frame(tracks), from_frames.is_frame(areas)
    sizes, zone = from_frames.checked_haven(haven), from_frames.TimeZone(time_zone)
    if haven is not None and not in_frames[0]:
        raise InvalidInput("solve", "haven", "is for tracks of frames: a Track has an outline_m of its own")
    if time_zone is not None and not any(in_frames):
        raise InvalidInput(
            "solve", "time_zone", "is for frames: instants of a Track or an Area need a zone of their own"
        )
    return (
        from_frames.tracks_of(tracks, scene, sizes, zone) if in_frames[0] else tracks,
        from_frames.areas_of(areas, scene, zone) if in_frames[1] else areas,
    )


def each(who: str, name: str, given: Iterable[Object], kind: type[Object]) -> list[Object]:
    """Return objects of one kind; raises InvalidInput for others."""
    what = f"must be {name}, in a list or the like"
    if isinstance(given, Area | Track) or not isinstance(given, Iterable):
        raise InvalidInput(who, name, f"{what}; got {type(given).__name__}")
    objects = list(given)
    for i, one in enumerate(objects):
        if not isinstance(one, kind):
            swapped = f": {who}(tracks, areas), are they swapped?" if isinstance(one, Area | Track) else ""
            raise InvalidInput(who, f"{name}[{i}]", f"{what}; got {type(one).__name__}{swapped}")
    return objects
