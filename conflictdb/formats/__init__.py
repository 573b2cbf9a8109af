"""Read scene files and files of other programs; write scenes and conflicts.

`read` is the entry point for reading (`reading` chooses the format), `write` for writing (`writing`).
"""

from typing import TYPE_CHECKING

from conflictdb.exports import exports

if TYPE_CHECKING:
    from conflictdb.formats.contents import Contents, Remark, Skipped
    from conflictdb.formats.discs import circle
    from conflictdb.formats.hints import FileHints
    from conflictdb.formats.json_schema import plans_schema
    from conflictdb.formats.objects_writing import object_lines
    from conflictdb.formats.reading import read
    from conflictdb.formats.scene_file import read_plans, scene_text
    from conflictdb.formats.unwritten_fields import unwritten
    from conflictdb.formats.writing import write, write_lines
    from conflictdb.formats.writing_scenes import write_scene_file

__all__ = [
    "Contents",
    "FileHints",
    "Remark",
    "Skipped",
    "circle",
    "object_lines",
    "plans_schema",
    "read",
    "read_plans",
    "scene_text",
    "unwritten",
    "write",
    "write_lines",
    "write_scene_file",
]

__getattr__ = exports(__name__, __file__)
