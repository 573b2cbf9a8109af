"""Load files into scenes of a database, all or nothing, for `Database.load_files`."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Unpack

import numpy as np

from conflictdb import store
from conflictdb.core.world import World
from conflictdb.earth.registry import Setup, middle_deg, places_of, summed_directions
from conflictdb.errors import InvalidInput
from conflictdb.formats import Remark, Skipped
from conflictdb.formats.contents import Parts, Phase, name_of, without_objects
from conflictdb.formats.fixes import rows_of
from conflictdb.formats.gather import GatheredScene, gather, scene_name
from conflictdb.formats.hints import FileHints, for_scene
from conflictdb.formats.reading import ReadOptions, has_parts, is_parquet, read_observed, read_parts
from conflictdb.formats.scene_file import LateMembersError
from conflictdb.formats.what_came import WhatCame
from conflictdb.model.load_summary import LoadSummary
from conflictdb.model.plans import Area, Motion, Scene, Track

if TYPE_CHECKING:
    import psycopg

# Objects whose places are checked between two reports of progress.
_CHECKED_AT_ONCE: Final = 10_000
# Areas, and tracks, of a scene that new ones are compared with: nine of ten of them are known to a few per cent.
_COMPARED: Final = 500
# Options with which a file can be read in parts.
_OF_PARTS: Final = ("max_speed_kn", "max_file_mb")


@dataclass(frozen=True, slots=True)
class Loaded:
    """The effect of loading on one scene.

    counts : objects added, updated, removed, unchanged
    skipped : rows and objects that were left out
    remarks : valid input that is probably unintended
    came : what the files held: how many, where, when, how fast, how high; in one line as text
    """

    scene: str
    counts: store.LoadCounts
    skipped: tuple[Skipped, ...]
    remarks: tuple[Remark, ...]
    came: LoadSummary = field(default_factory=LoadSummary)

    @property
    def invalid(self) -> tuple[Skipped, ...]:
        """The objects of plans that were left out because they are refused, one entry per error."""
        return tuple(one for one in self.skipped if one.is_refused)


def load_files(
    connection: "psycopg.Connection[Any]",
    paths: Sequence[str | Path],
    scene: str | None,
    *,
    replace: bool,
    phase: Phase,
    **options: Unpack[ReadOptions],
) -> list[Loaded]:
    """Load files, those of one scene as if they were one; return the result for each scene.

    replace : remove the objects of the scene that the files do not contain
    phase : called with the name of each phase and the amounts done and to do (0: unknown), and again as it advances
    **options : of `conflictdb.formats.read`
    """
    phase("reading", 0, 0)
    if len(paths) == 1 and has_parts(paths[0]) and not any(v for name, v in options.items() if name not in _OF_PARTS):
        limits = options.get("max_speed_kn"), options.get("max_file_mb")
        return [_loaded_by_parts(connection, paths[0], scene, replace, *limits, phase)]
    gathered = gather(paths, scene, phase=phase, settings_of=partial(_stored_settings, connection), **options)
    plans = [_with_settings(connection, plan, options.get("skip_invalid", False), phase) for plan in gathered]
    for plan, settings in plans:
        _require_objects(plan, replace)
        _require_datum(settings, options.get("hints"))
    return [_loaded(connection, plan, settings, replace, phase) for plan, settings in plans]


def put(
    connection: "psycopg.Connection[Any]", name: str, plans: Sequence[Area | Track], settings: Scene | None
) -> store.LoadCounts:
    """Add plans to a scene, or replace those of their keys, all or none; settings create or change the scene."""
    areas, tracks = [one for one in plans if isinstance(one, Area)], [one for one in plans if isinstance(one, Track)]
    if settings is None:
        with store.transaction(connection):
            store.scene_or_branch_id(connection, name)  # raises InvalidInput for an unknown scene
    else:
        settings = dataclasses.replace(settings, name=name)
    world = World.of(_own_settings(connection, name, settings), areas, tracks)
    world.fit(areas, tracks)
    return store.replace_scene(connection, world.setup.scene, areas, tracks, merge=True)


def _with_settings(
    connection: "psycopg.Connection[Any]", plan: GatheredScene, skip_invalid: bool, phase: Phase
) -> tuple[GatheredScene, Scene]:
    """Return a plan and the settings of its scene: the file's, else the stored ones; checks all objects.

    With `skip_invalid`, objects that do not fit the scene's plane are left out of the plan.
    """
    count = len(plan.areas) + len(plan.tracks)
    phase("checking places", 0, count)
    own = _own_settings(connection, plan.name, plan.settings)
    settings = World.around(own, plan.areas, plan.tracks).setup.scene
    checked = partial(phase, "checking places")
    for source in plan.sources:
        while (refused := _refused(settings, plan, source, lambda done: checked(done, count))) is not None:
            if not skip_invalid:
                raise refused
            plan.leave_out(source, refused)
    return plan, settings


def _stored_settings(connection: "psycopg.Connection[Any]", name: str) -> Scene:
    """Return the settings of a stored scene; of one that is not stored, the default."""
    with store.transaction(connection):
        return store.scene_settings(connection, name) or Scene(name)


def _require_datum(settings: Scene, hints: FileHints | None) -> None:
    """Raise InvalidInput if files were read for another vertical datum than the scene's."""
    if hints is not None and hints.vertical_datum not in (None, settings.vertical_datum):
        rule = (
            f"is {settings.vertical_datum}, and the files were read for {hints.vertical_datum}: load them as they are"
        )
        raise InvalidInput(f"scene {settings.name!r}", "vertical_datum", rule)


def _own_settings(connection: "psycopg.Connection[Any]", name: str, settings: Scene | None) -> Scene:
    """Return the settings of a scene: a file's, else the stored ones."""
    if settings is not None and (settings.motion != Motion.GREAT_CIRCLE or settings.centre is not None):
        return settings
    if settings is None:
        return _stored_settings(connection, name)
    with store.transaction(connection):
        known = store.scene_settings(connection, name)
    # A stored centre is kept.
    return settings if known is None else dataclasses.replace(settings, centre=known.centre)


def _loaded_by_parts(
    connection: "psycopg.Connection[Any]",
    path: str | Path,
    scene: str | None,
    replace: bool,
    max_speed_kn: float | None,
    max_file_mb: float | None,
    phase: Phase,
) -> Loaded:
    """Load a file in parts, to bound memory."""
    read = partial(read_parts, path, max_speed_kn=max_speed_kn, max_file_mb=max_file_mb, phase=phase)
    read_for = cache(partial(_stored_settings, connection, scene_name(path, None, scene)))
    while True:
        try:
            with for_scene(read_for), read() as parts:
                name = scene_name(path, parts.settings, scene)
                settings = _own_settings(
                    connection, name, None if parts.settings is None else dataclasses.replace(parts.settings, name=name)
                )
                if settings.motion == Motion.GREAT_CIRCLE and settings.centre is None:
                    settings = _centred(settings, parts)
                    with read() as again:
                        return _stored_by_parts(connection, settings, again, str(path), replace, phase)
                return _stored_by_parts(connection, settings, parts, str(path), replace, phase)
        except LateMembersError as found:
            read = partial(read, late=found.members)


def _stored_by_parts(
    connection: "psycopg.Connection[Any]",
    settings: Scene,
    parts: Parts,
    source: str,
    replace: bool,
    phase: Phase,
) -> Loaded:
    who = "file" if parts.settings is None else f"scene {settings.name!r}"
    may_be_empty = replace and parts.settings is not None
    each = _some_objects(_fitting(settings, parts), parts, who, source, may_be_empty=may_be_empty)
    if is_parquet(source):
        each = _counted(each, phase)
    stored = store.read_sample(connection, settings.name, _COMPARED)
    counts = store.replace_scene_by_parts(connection, settings, each, merge=not replace, phase=phase)
    replaced = _replaced(source, counts, parts.derived if parts.settings is None else ())
    remarks = (*parts.remarks, *parts.far_from(*stored), *replaced)
    return Loaded(settings.name, counts, tuple(parts.skipped), remarks, parts.came)


def _counted(each: Iterator[tuple[list[Area], list[Track]]], phase: Phase) -> Iterator[tuple[list[Area], list[Track]]]:
    """Yield the parts of a file, and report how many objects they had."""
    done = 0
    for areas, tracks in each:
        yield areas, tracks
        done += len(areas) + len(tracks)
        phase("reading objects", done, 0)


def _loaded(
    connection: "psycopg.Connection[Any]", plan: GatheredScene, settings: Scene, replace: bool, phase: Phase
) -> Loaded:
    stored = store.read_sample(connection, plan.name, _COMPARED)
    try:
        counts = store.replace_scene(connection, settings, plan.areas, plan.tracks, merge=not replace, phase=phase)
    except InvalidInput as refused:
        named = (source for key, source in plan.source_of.items() if refused.key.endswith(repr(key)))
        raise refused.at(next(named, plan.sources[0])) from refused.__cause__
    items: list[Area | Track] = [*plan.areas, *plan.tracks]
    keys = [one.key for one in items] if plan.settings is None else []
    replaced = _replaced(plan.sources[0], counts, [*plan.derived, *(key for key in keys if _is_number(key, len(keys)))])
    came = WhatCame(settings)
    came.add(plan.areas, plan.tracks)
    remarks = (*plan.remarks, *_far_from(stored, plan, settings), *replaced)
    return Loaded(plan.name, counts, tuple(plan.skipped), remarks, came.summary())


def _far_from(stored: tuple[list[Area], list[Track]], plan: GatheredScene, settings: Scene) -> Iterator[Remark]:
    """Yield remarks on the objects of each file that are far from those that the scene had before."""
    for source in plan.sources:
        areas = [one for one in plan.areas if plan.source_of[one.key] == source]
        tracks = [one for one in plan.tracks if plan.source_of[one.key] == source]
        items: list[Area | Track] = [*areas, *tracks]
        names = [name_of(one) for one in items]
        came = WhatCame(settings)
        came.add(areas, tracks)
        yield from came.far_from(*stored, source=source, name=names.__getitem__, now_us=time.time_ns() // 1000)


def _is_number(key: str, count: int) -> bool:
    """Return whether an id is the number of a row of a file of `count` objects."""
    return key.isdecimal() and len(key) < 10 and int(key) <= count


def _replaced(source: str, counts: store.LoadCounts, derived: Sequence[str]) -> Iterator[Remark]:
    """Yield a remark if objects of the scene are replaced, and ids may belong to other objects in another file."""
    if counts.updated and derived:
        many = counts.updated != 1
        text = f"{counts.updated:,} object{'s replace those' if many else ' replaces that'} of the same id in the scene"
        why = f"ids such as {derived[0]!r:.60} are names or numbers of rows, which another file may have too"
        yield Remark(source, "file", f"{text}; {why}: --map id=COLUMN takes others, --scene another scene")


def _centred(settings: Scene, parts: Parts) -> Scene:
    """Return settings with the middle of all objects of a file as centre, as `World.around` does."""
    sums = np.zeros(4)
    first: tuple[list[Area], list[Track]] = ([], [])
    for part in parts.each:
        sums += summed_directions(places_of(*part))
        first = first if any(first) else part
    parts.refusals.raise_found()
    middle = middle_deg(sums) if any(first) else None
    return (
        World.around(settings, *first).setup.scene if middle is None else dataclasses.replace(settings, centre=middle)
    )


def _fitting(settings: Scene, parts: Parts) -> Iterator[tuple[list[Area], list[Track]]]:
    """Yield the parts of a file until the first error; all errors are raised at the end.

    Objects that do not fit the scene's plane are reported only if there is no other error.
    """
    world = World(Setup.of(settings))
    misfit: InvalidInput | None = None
    for areas, tracks in parts.each:
        if misfit is not None or parts.refusals.found:
            continue
        try:
            world.fit(areas, tracks)
        except InvalidInput as refused:
            misfit = refused
        else:
            yield areas, tracks
    parts.refusals.raise_found()
    if misfit is not None:
        raise misfit


def _some_objects(
    each: Iterator[tuple[list[Area], list[Track]]], parts: Parts, who: str, source: str, *, may_be_empty: bool
) -> Iterator[tuple[list[Area], list[Track]]]:
    """Yield the parts of a file; raises InvalidInput at the end of one without objects."""
    is_empty = True
    for areas, tracks in each:
        is_empty = is_empty and not (areas or tracks)
        yield areas, tracks
    if is_empty and (parts.skipped or not may_be_empty):
        raise without_objects(who, source, parts.skipped, has_settings=parts.settings is not None)


def _require_objects(plan: GatheredScene, replace: bool) -> None:
    """Raise InvalidInput for a plan without objects, with the reason for each object that was left out.

    Only files of settings alone may empty a scene, and only with `replace`.
    """
    if plan.areas or plan.tracks or (replace and not plan.skipped):
        return
    raise without_objects(f"scene {plan.name!r}", plan.sources[0], plan.skipped, has_settings=plan.settings is not None)


def _refused(
    settings: Scene, plan: GatheredScene, source: str, checked: Callable[[int], object]
) -> InvalidInput | None:
    """Return the error for an object of a file that does not fit the scene's plane, None if all fit.

    checked : called with the number of objects checked so far
    """
    areas = [area for area in plan.areas if plan.source_of[area.key] == source]
    tracks = [track for track in plan.tracks if plan.source_of[track.key] == source]
    world = World(Setup.of(settings))
    try:
        for first in range(0, len(areas), _CHECKED_AT_ONCE):
            world.fit(areas[first : first + _CHECKED_AT_ONCE], [])
            checked(min(first + _CHECKED_AT_ONCE, len(areas)))
        for first in range(0, len(tracks), _CHECKED_AT_ONCE):
            world.fit([], tracks[first : first + _CHECKED_AT_ONCE])
            checked(len(areas) + min(first + _CHECKED_AT_ONCE, len(tracks)))
    except InvalidInput as refused:
        return refused.at(source)
    return None


@dataclass(frozen=True, slots=True)
class LoadedPositions:
    """What was inserted of a file of positions.

    positions, tracks : how many positions, and of how many tracks
    unknown : ids that are no tracks of the scene, whose positions are left out
    left_out : positions without a time or a place
    """

    positions: int
    tracks: int
    unknown: tuple[str, ...]
    left_out: int


def load_positions(
    conn: "psycopg.Connection[Any]", scene: str, path: str | Path, max_file_mb: float | None, hints: FileHints | None
) -> LoadedPositions:
    """Insert the positions of a file, as `StoredScene.load_positions`."""
    fixes, left_out = read_observed(path, max_file_mb=max_file_mb, hints=hints)
    with store.transaction(conn):
        unknown = store.unknown_tracks(conn, scene, list(fixes))
        keys, at_us, lonlat = rows_of({key: own for key, own in fixes.items() if key not in unknown})
        if keys:
            store.insert_positions(conn, scene, keys, at_us, lonlat)
    return LoadedPositions(len(keys), len(set(keys)), tuple(sorted(unknown)), sum(map(len, left_out.values())))
