"""Write the objects of a scene; the ending of the name decides the format."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from conflictdb.errors import InvalidInput
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


# Endings of names without .gz; any other is a scene file.
_WRITERS: Final[dict[str, Lines]] = {
    ".rtz": rtz_lines,
    ".kml": kml_lines,
    ".ed318.json": _ed318_lines,
    ".f3548.json": _f3548_lines,
}
# Endings that are read as other formats: a scene file of such a name would not load.
_READ_ONLY: Final = (*(OTHER_ENDINGS - _WRITERS.keys()), ".gpkg", ".kmz", ".shp", ".zip")


def object_lines(path: str | Path, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Return the lines of a file of objects, in the format of its name; raises InvalidInput for what it cannot hold."""
    name = Path(path).name.lower().removesuffix(".gz")
    if name.endswith(_READ_ONLY):
        rule = f"this format is read, not written: write {', '.join(_WRITERS)}, .geojson or .parquet"
        raise InvalidInput("file", Path(name).suffix, rule, str(path))
    write = next((one for ending, one in _WRITERS.items() if name.endswith(ending)), scene_text)
    return write(scene, areas, tracks)
