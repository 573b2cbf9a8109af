"""Print results on stdout, remarks and progress on stderr; progress on a terminal only.

Keys, names and messages are escaped for terminals (`printable`); only `data` is printed unchanged, for programs.
"""

import os
import re
import shlex
import shutil
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from threading import RLock
from typing import IO, Any, Final

from conflictdb.errors import InvalidInput, printable

_LOCK: Final = RLock()  # a thread shows the progress
_CLEAR_LINE: Final = "\r\033[K"
_BREAK: Final = "\n"
_INSTALL_EXTRA: Final = re.compile(r"pip install 'conflictdb\[(?!spark)[a-z,]+\]'")


def out(text: str = "", *, flush: bool = False) -> None:
    """Print one line of a result; `flush` if somebody waits for it."""
    sys.stdout.write(f"{printable(text, keep=_BREAK)}\n")
    if flush:
        sys.stdout.flush()


def line(text: str) -> None:
    """Print one line of a result that has names: their line breaks are escaped, too."""
    out(printable(text))


def program() -> str:
    """Return the command for this program: as ./run was called, else its name."""
    return shlex.quote(os.environ.get("CONFLICTDB_PROGRAM") or "conflictdb")


def as_called(text: str) -> str:
    """Replace `conflictdb COMMAND` in a message by the command as this program was called, so that it can be typed."""
    if "CONFLICTDB_PROGRAM" in os.environ:
        text = _INSTALL_EXTRA.sub(f"{program()} extras", text)
    return text.replace("`conflictdb ", f"`{program()} ")


def data(lines: Iterable[str], *, is_json: bool) -> None:
    """Print data for programs unchanged; on a terminal, escape formats that cannot escape themselves."""
    shows = not is_json and sys.stdout.isatty()
    sys.stdout.writelines(printable(line, keep=_BREAK) if shows else line for line in lines)


def print_json(value: Any) -> None:
    """Print a value as JSON, indented."""
    from conflictdb.formats.json_text import dumped  # imported here, so that help is fast

    data([dumped(value, indent=2), "\n"], is_json=True)


@contextmanager
def binary() -> Iterator[IO[bytes]]:
    """Yield standard output for binary data; raises InvalidInput for a terminal."""
    if sys.stdout.isatty():
        raise InvalidInput("standard output", "", "is a terminal, which cannot show GeoParquet: name a file, or > FILE")
    sys.stdout.flush()
    yield sys.stdout.buffer
    sys.stdout.buffer.flush()


def remark(text: str) -> None:
    """Print a remark, which is not part of the result."""
    with _LOCK:
        progress("")
        sys.stderr.write(f"conflictdb: {printable(as_called(text), keep=_BREAK)}\n")


@contextmanager
def warnings_as_remarks() -> Iterator[None]:
    """Print warnings of the package as remarks."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    for one in caught:
        remark(str(one.message))


def note(text: str) -> None:
    """Print a remark only on a terminal."""
    if sys.stderr.isatty():
        remark(text)


def progress(text: str) -> None:
    """Show progress on one line of a terminal; nothing in a pipe. An empty text removes the line."""
    if sys.stderr.isatty():
        with _LOCK:
            sys.stderr.write(f"{_CLEAR_LINE}{printable(text)[: shutil.get_terminal_size().columns - 1]}")
            sys.stderr.flush()
