"""Combine several files into scenes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final, Unpack

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats.contents import Contents, Phase, Remark, Skipped, left_out, name_of, unwatched, without_objects
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.hints import for_scene
from conflictdb.formats.reading import ReadOptions, read, stem
from conflictdb.model.plans import Area, Scene, Track


@dataclass(slots=True)
class GatheredScene:
    """The objects of one scene, from one or more files.

    name : of the scene
    settings : from a file, None if no file has settings
    sources : the files, in the order given
    source_of : the file of each object, by key
    derived : ids that no file says
    """

    name: str
    settings: Scene | None = None
    sources: list[str] = field(default_factory=list)
    areas: list[Area] = field(default_factory=list)
    tracks: list[Track] = field(default_factory=list)
    skipped: list[Skipped] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    source_of: dict[str, str] = field(default_factory=dict)
    derived: list[str] = field(default_factory=list)

    def leave_out(self, source: str, refused: InvalidInput) -> None:
        """Leave out the refused objects of a file, by name."""
        refusals = Refusals()
        with refusals:
            raise refused
        gone = {one.key for one in refused}
        self.skipped.extend(left_out(source, refusals))
        self.areas = [area for area in self.areas if f"area {area.key!r}" not in gone]
        self.tracks = [track for track in self.tracks if f"track {track.key!r}" not in gone]


# Settings that decide how other files of the scene are read.
_DECIDES_READING: Final = frozenset({"vertical_datum", "motion", "tolerance_m"})


def gather(
    paths: Sequence[str | Path],
    scene: str | None = None,
    *,
    phase: Phase = unwatched,
    settings_of: Callable[[str], Scene] = Scene,
    **options: Unpack[ReadOptions],
) -> list[GatheredScene]:
    """Return the scenes in some files, in order of first appearance.

    Parameters
    ----------
    paths : sequence of paths
        Files of one scene are combined as if they were one file.
    scene : str, optional
        Name of the one scene of all files; default is the name in each file, else the name of the file.
    settings_of : callable, optional
        Returns the settings of a scene by its name; for files without settings.
    phase, **options : optional
        See `conflictdb.formats.read`.

    Raises
    ------
    InvalidInput
        A file is refused or has neither objects nor settings, an id appears in two files of a scene, or the files have
        different settings.
    """
    plans: dict[str, GatheredScene] = {}
    refusals = Refusals()
    files: list[_SceneFile] = []
    for i, path in enumerate(paths):
        with refusals:
            if path in paths[:i]:
                raise InvalidInput("file", "", "is given twice", str(path))
            files.append(_SceneFile(path, scene_name(path, None, scene)))
    of_files: dict[str, Scene] = {}
    for file in files:
        file.read(partial(settings_of, file.scene), phase=phase, **options)
        if isinstance(file.outcome, Contents) and file.outcome.scene is not None:
            file.scene = scene_name(file.path, file.outcome.scene, scene)
            of_files[file.scene] = file.outcome.scene
    for file in files:
        own = of_files.get(file.scene)
        if file.settings is not None and own is not None and set(own.differing(file.settings)) & _DECIDES_READING:
            # Read for other settings than those of its scene, which are in another file.
            file.read(partial(replace, own), phase=phase, **options)
        with refusals:
            contents = file.found()
            if contents.scene is None and not (contents.areas or contents.tracks):
                raise without_objects("file", str(file.path), contents.skipped)
            _add(plans.setdefault(file.scene, GatheredScene(file.scene)), str(file.path), contents, refusals)
    refusals.raise_found()
    return list(plans.values())


@dataclass(slots=True)
class _SceneFile:
    """A file that was read, or refused.

    scene : name of its scene
    outcome : once it is read
    settings : of the scene that it was read for, None if it needs none
    """

    path: str | Path
    scene: str
    outcome: Contents | InvalidInput = field(init=False)
    settings: Scene | None = None

    def read(self, settings: Callable[[], Scene], *, phase: Phase, **options: Unpack[ReadOptions]) -> None:
        """Read the file for a scene."""
        self.settings = None

        def asked() -> Scene:
            self.settings = settings() if self.settings is None else self.settings
            return self.settings

        try:
            with for_scene(asked):
                self.outcome = read(self.path, phase=phase, **options)
        except InvalidInput as error:
            self.outcome = error

    def found(self) -> Contents:
        """Return what the file has; raises the InvalidInput with which it is refused."""
        if isinstance(self.outcome, InvalidInput):
            raise self.outcome
        return self.outcome


def scene_name(path: str | Path, settings: Scene | None, scene: str | None) -> str:
    """Return the scene name of a file: `scene` if given, else the name in the file, else the file's name."""
    own = settings.name if settings else stem(Path(path))
    return checked_key("scene", "name", own if scene is None else scene)


def _add(plan: GatheredScene, source: str, contents: Contents, refusals: Refusals) -> None:
    if contents.scene is not None:
        settings = replace(contents.scene, name=plan.name)
        if plan.settings is not None and (differing := settings.differing(plan.settings)):
            rule = f"differs from that in {plan.sources[0]}; a scene has one set of settings"
            with refusals:
                raise InvalidInput(f"scene {plan.name!r}", differing[0], rule, source)
        plan.settings = settings
    items: list[Area | Track] = [*contents.areas, *contents.tracks]
    for item in items:
        other = plan.source_of.setdefault(item.key, source)
        if other != source:
            rule = f"is also in {other}; ids must be unique in the scene"
            with refusals:
                raise InvalidInput(name_of(item), "id", rule, source)
    plan.sources.append(source)
    plan.areas.extend(contents.areas)
    plan.tracks.extend(contents.tracks)
    plan.skipped.extend(contents.skipped)
    plan.remarks.extend(contents.remarks)
    plan.derived.extend(contents.derived)
