"""Remark what a written format has no room for: settings of the scene, and schedules."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from conflictdb.formats.contents import Remark
from conflictdb.formats.gpx_writing import has_more
from conflictdb.formats.objects_writing import writer_of
from conflictdb.formats.outside import of_exchange
from conflictdb.formats.rings import along_lines
from conflictdb.model.plans import LINES, Area, Scene, Track

_MOST_NAMED: Final = 3


def unwritten(path: str | Path, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[Remark]:
    """Yield remarks on what the file of a name does not hold of a scene; none for scene files and GeoParquet."""
    writer = writer_of(path)
    if writer is None:
        return
    form = writer.title
    lost = [one for one in scene.differing(Scene(scene.name)) if one not in writer.settings]
    if lost:
        text = f"{form} holds no settings of a scene: {', '.join(lost)} of {scene.name!r:.60} are not in the file"
        yield Remark(str(path), "file", text)
    if form == "RTZ":
        return
    if form == "GPX":
        if areas:
            text = f"GPX holds routes: {len(areas):,} area{' is' if len(areas) == 1 else 's are'} left out"
            yield Remark(str(path), "file", f"{text}: {_named([area.key for area in areas])}")
        if more := [track.key for track in tracks if has_more(track)]:
            text = "GPX holds ways and times: sizes, heights and tolerances are not in the file"
            yield Remark(str(path), "file", f"{text}: {_named(more)}")
        areas = ()
    if form == "KML":
        from conflictdb.core.world import World  # needs the kernel

        setup = World.around(scene, areas, tracks).setup
        longer = [one.key for one in areas if along_lines(setup, one.footprint) is not one.footprint]
        if longer:
            text = f"KML draws sides straight in longitude and latitude: {_areas(len(longer))} with added vertices"
            yield Remark(str(path), "file", f"{text}, along {LINES[scene.motion]}: {_named(longer)}")
    items: list[Area | Track] = [*areas, *tracks]
    recurring = [one.key for one in items if one.schedule is not None and not (form == "ED-318" and _is_kept(one))]
    if recurring:
        text = f"{form} holds no such schedules: {len(recurring):,} objects are in the file with their activations"
        within = f"within the horizon of {scene.horizon_days:g} days, and with no later ones"
        yield Remark(str(path), "file", f"{text} {within}: {_named(recurring)}")


def _named(keys: Sequence[str]) -> str:
    return ", ".join(map(repr, keys[:_MOST_NAMED])) + (", …" if len(keys) > _MOST_NAMED else "")


def _areas(count: int) -> str:
    return "1 area is written" if count == 1 else f"{count:,} areas are written"


def _is_kept(item: Area | Track) -> bool:
    return isinstance(item, Area) and bool(of_exchange("uas_zones_writing", "has_only_ed318")(item))
