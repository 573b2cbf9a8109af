"""Write scenes in memory to scene files, GeoJSON or GeoParquet."""

import warnings
from collections.abc import Sequence
from pathlib import Path

from conflictdb.errors import InvalidInput
from conflictdb.formats.objects_writing import object_lines
from conflictdb.formats.reading import is_parquet
from conflictdb.formats.unwritten_fields import unwritten
from conflictdb.formats.writing import whole_file, write_lines
from conflictdb.model.plans import LINES, Area, Scene, Track, check_keys, check_legs


def write_scene_file(plans: Sequence[Area | Track], path: str | Path, scene: Scene) -> None:
    """Write plans and the settings of their scene to a file from which `read` and `load` get exactly these.

    GeoParquet if its name ends in .parquet, which needs the extra `parquet`; RTZ, GPX, KML, ED-318 or F3548 if it ends
    in .rtz, .gpx, .kml, .ed318.json or .f3548.json, which hold less: a UserWarning says what they lose; else GeoJSON.
    Compressed if its name ends in .gz. The file appears when it is complete; if writing fails, an older file stays.

    Raises InvalidInput for other objects than areas and tracks, for keys that occur twice, and for a track whose legs
    are other lines than those of the scene.
    """
    for k, one in enumerate(plans):
        if not isinstance(one, Area | Track):
            raise InvalidInput("write_scene_file", f"plans[{k}]", f"must be an Area or a Track; got {one!r:.60}")
    if not isinstance(scene, Scene):
        raise InvalidInput("write_scene_file", "scene", f"must be a Scene; got {scene!r:.60}")
    check_keys(one.key for one in plans)
    areas, tracks = [one for one in plans if isinstance(one, Area)], [one for one in plans if isinstance(one, Track)]
    check_legs(LINES[scene.motion], tracks)  # files do not say it of each track
    if not is_parquet(path):
        write_lines(path, object_lines(path, scene, areas, tracks))
        for lost in unwritten(path, scene, areas, tracks):
            warnings.warn(str(lost), UserWarning, stacklevel=2)
        return
    from conflictdb.arrays.arrow.object_rows import of_objects  # needs pyarrow
    from conflictdb.formats.parquet_writing import write_objects

    with whole_file(path) as stream:
        write_objects(stream, scene, [of_objects(areas, tracks)])
