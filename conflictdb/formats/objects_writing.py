"""Write the objects of a scene; the ending of the name decides the format. To add a format: a row of `_WRITERS`."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from conflictdb.errors import InvalidInput
from conflictdb.formats.gpx_writing import gpx_lines
from conflictdb.formats.kml_writing import kml_lines
from conflictdb.formats.outside import of_exchange
from conflictdb.formats.reading import OTHER_ENDINGS
from conflictdb.formats.rtz_writing import rtz_lines
from conflictdb.formats.scene_file import scene_text
from conflictdb.model.plans import Area, Scene, Track

Lines: TypeAlias = Callable[[Scene, Sequence[Area], Sequence[Track]], Iterator[str]]


def _ed318_lines(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    yield from of_exchange("uas_zones_writing", "ed318_lines")(scene, areas, tracks)


def _f3548_lines(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    yield from of_exchange("volumes_writing", "f3548_lines")(scene, areas, tracks)


# Settings of a scene that every file of objects has, or that follow from the objects.
_OWN: Final = frozenset({"centre", "horizon_days", "vertical_datum", "regions"})


class WrittenFormat(NamedTuple):
    """A format that holds less than scene files do.

    settings : those of a scene that its objects have, or that follow from these; a remark names the others
    """

    title: str
    lines: Lines
    settings: frozenset[str] = _OWN


# By the endings of names, without .gz; any other is a scene file.
_WRITERS: Final = {
    ".rtz": WrittenFormat("RTZ", rtz_lines, _OWN | {"motion", "earth"}),
    ".gpx": WrittenFormat("GPX", gpx_lines),
    ".kml": WrittenFormat("KML", kml_lines),
    ".ed318.json": WrittenFormat("ED-318", _ed318_lines),
    ".f3548.json": WrittenFormat("ASTM F3548", _f3548_lines),
}
# Endings that are read as other formats: a scene file of such a name would not load.
_READ_ONLY: Final = (*(OTHER_ENDINGS - _WRITERS.keys()), ".gpkg", ".kmz", ".shp", ".zip")

# Endings of what other commands write, and the commands.
_OF_OTHERS: Final = {
    ".ics": "`conflicts KEY --format ics`",
    ".html": "`report`",
    ".pdf": "`report` or `plot`",
    ".png": "`plot`",
    ".svg": "`plot`",
}


def writer_of(path: str | Path) -> WrittenFormat | None:
    """Return the format in which a file of that name is written, None for scene files and GeoParquet."""
    name = Path(path).name.lower().removesuffix(".gz")
    return next((one for ending, one in _WRITERS.items() if name.endswith(ending)), None)


def object_lines(path: str | Path, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Return the lines of a file of objects, in the format of its name; raises InvalidInput for what it cannot hold."""
    name = Path(path).name.lower().removesuffix(".gz")
    if name.endswith(_READ_ONLY):
        rule = f"this format is read, not written: write {', '.join(_WRITERS)}, .geojson or .parquet"
        raise InvalidInput("file", Path(name).suffix, rule, str(path))
    if (other := _OF_OTHERS.get(Path(name).suffix)) is not None and not name.endswith(tuple(_WRITERS)):
        rule = f"holds no plans: {other} writes such a file; plans end in .geojson, .parquet, {', '.join(_WRITERS)}"
        raise InvalidInput("file", Path(name).suffix, rule, str(path))
    writer = writer_of(path)
    return (writer.lines if writer else scene_text)(scene, areas, tracks)
