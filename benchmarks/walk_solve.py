"""Print the functions that `solve` enters on its way from objects to a conflict row, by room, and count them.

    ./run python benchmarks/walk_solve.py

The scene has two tracks that cross and an area. Comprehensions and lambdas belong to the function that contains them.
Three counts:

- entered: every function of the package
- apart from short helpers: without functions of one line that call no function of the package
- to read: functions of more than five lines that call others; a reader of the way opens these
"""

import sys
from collections import Counter, defaultdict
from pathlib import Path
from types import CodeType, FrameType
from typing import Final, NamedTuple

import numpy as np

import conflictdb
from conflictdb import Area, Scene, Track, rectangle_outline_m, solve

PACKAGE: Final = Path(conflictdb.__file__).parent
# Lines of a function that a reader takes in at a glance.
SHORT: Final = 5


class Function(NamedTuple):
    """A function of the package; room : its directory."""

    room: str
    file: str
    name: str
    lines: int


class Walk:
    """Records the functions that a call enters, in order, and which of them calls which."""

    def __init__(self) -> None:
        self.calls: defaultdict[Function, set[Function]] = defaultdict(set)

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        """Record a call; a hook of `sys.setprofile`."""
        entered = function_of(frame) if event == "call" else None
        if entered is not None:
            self.calls.setdefault(entered, set())
            caller = next((one for one in callers(frame) if one is not None), None)
            if caller is not None:
                self.calls[caller].add(entered)

    def helpers(self) -> set[Function]:
        """Return the functions of one line that call no others."""
        return {one for one, called in self.calls.items() if one.lines == 1 and not called}

    def to_read(self) -> set[Function]:
        """Return the functions of more than five lines that call others, apart from short helpers."""
        helpers = self.helpers()
        return {one for one, called in self.calls.items() if one.lines > SHORT and called - helpers}


def callers(frame: FrameType) -> "list[Function | None]":
    """Return the functions above a frame, the nearest first; None: of another package, or a comprehension."""
    found, above = [], frame.f_back
    while above is not None:
        found.append(function_of(above))
        above = above.f_back
    return found


def function_of(frame: FrameType) -> Function | None:
    """Return the function of a frame; None: of another package, or a comprehension."""
    code, path = frame.f_code, Path(frame.f_code.co_filename)
    if not path.is_relative_to(PACKAGE) or code.co_name.startswith("<"):
        return None
    file = path.relative_to(PACKAGE)
    return Function(file.parent.as_posix(), file.name, code.co_qualname, len(lines_of(code)))


def lines_of(code: CodeType) -> set[int]:
    """Return the lines of a function's body that run, with those of its comprehensions."""
    inner = [lines_of(one) for one in code.co_consts if isinstance(one, CodeType)]
    own = {line for _, _, line in code.co_lines() if line is not None} - {code.co_firstlineno}
    return own.union(*inner)


def small_scene() -> tuple[list[Track], list[Area], Scene]:
    """Return two tracks that cross, an area on the way of one, and the settings."""
    minute = np.datetime64("2030-06-01T00:00", "us") + np.arange(0, 180, 60).astype("timedelta64[m]")
    outline = rectangle_outline_m(200, 200, 50, 50)
    tracks = [
        Track("east", [(10.0, 54.0), (10.2, 54.0)], minute[:2], outline),
        Track("north", [(10.1, 53.95), (10.1, 54.05)], minute[:2], outline),
    ]
    ring = [(10.14, 53.99), (10.16, 53.99), (10.16, 54.01), (10.14, 54.01)]
    return tracks, [Area("square", ring, None, minute[0], minute[2])], Scene("walk")


def walk() -> Walk:
    """Return the walk of `solve` through the small scene, after a first call that fills caches."""
    solve(*small_scene())
    tracks, areas, scene = small_scene()
    found = Walk()
    sys.setprofile(found)
    try:
        solve(tracks, areas, scene)
    finally:
        sys.setprofile(None)
    return found


def main() -> None:
    """Print the functions, and the counts of functions and rooms."""
    found = walk()
    to_read, helpers = found.to_read(), found.helpers()
    for one in found.calls:
        mark = "*" if one in to_read else "." if one in helpers else " "
        print(f"{mark} {one.room}/{one.file} {one.name}")
    for name, some in (
        ("entered", set(found.calls)),
        ("apart from short helpers", set(found.calls) - helpers),
        ("to read (*)", to_read),
    ):
        rooms = Counter(one.room for one in some)
        print(f"{name}: {len(some)} functions in {len(rooms)} rooms: {dict(sorted(rooms.items()))}")


if __name__ == "__main__":
    main()
