"""Time to load a scene file, phase by phase; and the terminal's output of loading and detecting a large one.

    ./.venv/bin/python benchmarks/loading.py [--objects 2000 20000 200000] [--record 200000] [--dsn DSN]
        [--files FOLDER] [--document docs/explanation/performance.md] [--folder docs/explanation/performance]

The scenes are the sea of made_scenes.py: half of the objects are areas, half tracks, here of 5 to 10 legs. Each file is
loaded by a fresh process, into a new database. Seconds are those of the processor, of the client and of its backend in
the server, and by the clock. Beside it stands the least that a loader does: to parse the JSON, as `json.load` does,
and to COPY its finished rows into tables without indexes and triggers.
"""

import argparse
import fcntl
import json
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from made_scenes import AT_ONCE, DEGREES_PER_ROOT, SEA, Kind
from measured import backend_clock, fresh_database, in_fresh_process, peak_mb, server_pid, versions, write_csv
from mixed_scenes import plain_scene
from tables import markdown, show

import conflictdb
from conflictdb import Area, Scene, Track
from conflictdb.formats import read
from conflictdb.formats.scene_file import scene_text
from conflictdb.model.rules import KINDS
from conflictdb.store import copy_binary
from conflictdb.store.connection import call
from conflictdb.store.stored_objects import _staged

OBJECTS: Final = (2_000, 20_000, 200_000)
SEED: Final = 1
LEGS: Final = (5, 11)  # from five to ten
MAX_FILE_MB: Final = 1_000
COLUMNS: Final = 100
# Lines of a phase that a recording shows: the first, the last, and one per EVERY_S seconds between. A phase that
# returns for every part of the scene shows its first times only.
EVERY_S: Final = 30.0
TIMES: Final = 2
_CLEARED: Final = re.compile(r"\r\x1b\[K")


def made_file(objects: int, folder: Path) -> Path:
    """Return a scene file of `count` objects in a folder; write it if it does not exist."""
    path = folder / f"sea-{objects}.geojson"
    if path.exists():
        return path
    areas: list[Area] = []
    tracks: list[Track] = []
    sea = replace(SEA, window=DEGREES_PER_ROOT * objects**0.5, legs=LEGS)
    for first in range(0, objects, AT_ONCE):
        _, standing, moving = plain_scene(sea, SEED + first, *Kind.MIXED.split(min(AT_ONCE, objects - first)))
        areas += [replace(area, key=f"{first}-{area.key}") for area in standing]
        tracks += [replace(track, key=f"{first}-{track.key}") for track in moving]
    with path.open("w") as file:
        file.writelines(scene_text(Scene("sea"), areas, tracks))
    return path


def loaded(dsn: str, path: Path) -> tuple[dict[str, tuple[float, float, float]], float]:
    """Load a file; return seconds of each phase, of the client, of the server and by the clock, and the client's MB."""
    with conflictdb.connect(dsn) as db:
        backend = backend_clock(db.connection)
        if server_pid(db.connection) is None:
            raise SystemExit("the server's processes cannot be seen here")

        def now() -> tuple[float, float, float]:
            return time.process_time(), backend(), time.monotonic()

        begun = [("reading", now())]

        def phase(name: str, done: int, of: int) -> None:
            if name != begun[-1][0]:
                begun.append((name, now()))

        db.load_files([path], max_file_mb=MAX_FILE_MB, phase=phase)
        begun.append(("", now()))
    took: dict[str, tuple[float, float, float]] = {}
    for (name, start), (_, end) in pairwise(begun):
        before = took.get(name, (0.0, 0.0, 0.0))
        took[name] = tuple(x + b - a for x, a, b in zip(before, start, end, strict=True))  # type: ignore[assignment]
    return took, peak_mb()


def alone(dsn: str, path: Path) -> tuple[float, float]:
    """Parse a file, and COPY its rows into plain tables; return seconds of the client and of the server."""
    contents = read(path, max_file_mb=MAX_FILE_MB)
    columns = {kind: _staged(kind, plans) for kind, plans in zip(KINDS, (contents.areas, contents.tracks), strict=True)}
    encoded = {kind: copy_binary.rows(some) for kind, some in columns.items()}
    with path.open() as file:
        began = time.process_time()
        json.load(file)
        parsed_s = time.process_time() - began
    with conflictdb.connect(dsn) as db:
        conn = db.connection
        backend = backend_clock(conn)
        call(conn, "_begin_load")
        for kind in columns:
            conn.execute(f"CREATE TABLE public.plain_{kind} (LIKE pg_temp.staged_{kind})".encode())
        began, began_server = time.process_time(), backend()
        for kind, names in columns.items():
            copy_binary.send_rows(conn, f"public.plain_{kind}", names, encoded[kind])
        copied_s = time.process_time() - began
        server_s = backend() - began_server
        conn.rollback()
    return parsed_s + copied_s, server_s


def measured(dsn: str, objects: int, path: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each phase of loading a file, and one for all of them."""
    took, client_mb = in_fresh_process(loaded, dsn, path)
    took["all"] = tuple(sum(column) for column in zip(*took.values(), strict=True))
    least = in_fresh_process(alone, dsn, path)
    ratio = sum(took["all"][:2]) / sum(least)
    took[f"JSON and COPY alone; all is {ratio:.1f} times that"] = (*least, sum(least))
    for name, (client_s, server_s, clock_s) in took.items():
        row = {"objects": objects, "file_mb": path.stat().st_size / 1e6, "phase": name}
        yield row | {"client_s": client_s, "server_s": server_s, "clock_s": clock_s, "client_mb": client_mb}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return a table in Markdown, one row for each phase of each size."""
    heads = ("objects", "file, MB", "phase", "client, s", "server, s", "us an object", "by the clock, s", "client, MB")
    lines = []
    for row in rows:
        is_all = row["phase"] == "all"
        us = 1e6 * (row["client_s"] + row["server_s"]) / row["objects"]
        cells = [row["phase"], *(f"{row[name]:.2f}" for name in ("client_s", "server_s")), f"{us:.0f}"]
        cells.append(f"{row['clock_s']:.2f}")
        cells = [f"**{cell}**" if is_all else cell for cell in cells]
        size = [f"{row['objects']:,}", f"{row['file_mb']:.0f}"] if is_all else ["", ""]
        lines.append([*size, *cells, f"{row['client_mb']:,.0f}" if is_all else ""])
    return markdown(heads, lines)


def recorded(arguments: Sequence[str], folder: Path, dsn: str, output: Path | None = None) -> Iterator[str]:
    """Run a command of the program on a terminal; yield its lines, with some of the lines that show progress.

    output : the file of its standard output; by default the terminal
    """
    shown = "" if output is None else f" > {output.name}"
    yield f"$ conflictdb {' '.join(arguments)}{shown}"
    terminal, other_end = pty.openpty()
    fcntl.ioctl(other_end, termios.TIOCSWINSZ, struct.pack("HHHH", 40, COLUMNS, 0, 0))
    environment = {**os.environ, "CONFLICTDB_DSN": dsn, "NO_COLOR": "1", "XDG_STATE_HOME": str(folder)}
    began = time.monotonic()
    with (output or Path(os.devnull)).open("wb") as file:
        command = [sys.executable, "-m", "conflictdb", *arguments]
        running = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=other_end if output is None else file, stderr=other_end
        )
    os.close(other_end)
    yield from _some_frames(_frames(terminal, began))
    os.close(terminal)
    if running.wait():
        raise SystemExit(f"conflictdb {' '.join(arguments)} failed")


def _frames(terminal: int, began: float) -> Iterator[tuple[float, str, bool]]:
    """Yield the lines of a terminal: seconds since the beginning, the text, and whether it is replaced."""
    text = ""
    while True:
        try:
            text += os.read(terminal, 65_536).decode(errors="replace")
        except OSError:  # the command has ended
            break
        *lines, text = re.split(r"(?=\r\x1b\[K)|(?<=\n)", text)
        for line in lines:
            is_replaced = not line.endswith("\n")
            if line := _CLEARED.sub("", line).rstrip():
                yield time.monotonic() - began, line, is_replaced
    if text := _CLEARED.sub("", text).rstrip():
        yield time.monotonic() - began, text, False


def _some_frames(frames: Iterator[tuple[float, str, bool]]) -> Iterator[str]:
    """Yield lines that stay, and some of those that show progress, with their times."""
    last: tuple[float, str] | None = None
    name, shown_s, is_cut = "", 0.0, False
    times: Counter[str] = Counter()
    for at_s, line, is_replaced in frames:
        phase = re.split(r"[:,]", line)[0] if is_replaced else ""
        if phase != name:
            if last is not None:
                yield _timed(*last)
            last, name = None, phase
            times[phase] += 1
            if is_replaced and times[phase] == TIMES + 1 and not is_cut:
                is_cut = True
                yield "[…]"
        if not is_replaced:
            yield line
        elif times[phase] > TIMES:
            continue
        elif last is None or at_s - shown_s > EVERY_S:
            yield _timed(at_s, line)
            last, shown_s = (at_s, line), at_s
        else:
            last = at_s, line


def _timed(at_s: float, line: str) -> str:
    return f"[{int(at_s) // 60}:{int(at_s) % 60:02d}] {line}"


def session(dsn: str, path: Path) -> str:
    """Return a recording of loading and detecting a file."""
    folder = path.parent
    load = ["load", path.name, "--max-file-mb", f"{path.stat().st_size // 1_000_000 + 1}"]
    lines = list(recorded(load, folder, dsn))
    lines += recorded(["detect", "--format", "csv"], folder, dsn, folder / "conflicts.csv")
    return "```text\n" + "\n".join(lines) + "\n```"


def main() -> None:
    """Measure, record, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server to make databases on (default: the embedded one)")
    parser.add_argument("--objects", type=int, nargs="*", default=list(OBJECTS))
    parser.add_argument("--record", type=int, help="record a session with so many objects, too")
    parser.add_argument("--files", type=Path, help="keep the scene files there (default: they are made, and removed)")
    parser.add_argument("--document", type=Path, help="put table and recording there")
    parser.add_argument("--folder", type=Path, help="write loading.csv there")
    args = parser.parse_args()
    rows: list[dict[str, Any]] = []
    software = ""
    with TemporaryDirectory() as temporary:
        folder = args.files or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for objects in args.objects:
            with fresh_database(args.dsn) as dsn:
                rows += measured(dsn, objects, made_file(objects, folder))
                with conflictdb.connect(dsn) as db:
                    software = versions(db.connection)
        if rows:
            text = f"{table(rows)}\n\n{software}."
            show(text, "loading", args.document)
            if args.folder:
                write_csv(args.folder / "loading.csv", rows)
        if args.record:
            with fresh_database(args.dsn) as dsn:
                text = session(dsn, made_file(args.record, folder))
            show(text, "session", args.document)


if __name__ == "__main__":
    main()
