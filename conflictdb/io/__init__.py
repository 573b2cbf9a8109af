"""Reading of scene files and of what other programs write, and writing of scenes and conflicts.

`read` is the way in (`reading` finds the format, and is where a further one goes), `write` the way out (`writing`).
"""

from conflictdb.io.contents import Contents, Remark, Skipped
from conflictdb.io.reading import read
from conflictdb.io.scene_file import scene_text
from conflictdb.io.writing import write, write_lines

__all__ = ["Contents", "Remark", "Skipped", "read", "scene_text", "write", "write_lines"]
