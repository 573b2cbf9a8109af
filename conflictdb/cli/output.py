"""Print results on stdout, remarks and progress on stderr; progress on a terminal only.

Keys, names and messages are escaped for terminals (`printable`); only `data` is printed unchanged, for programs.
"""

import logging
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from threading import RLock
from typing import IO, Any, Final

from conflictdb.errors import InvalidInput, printable

# Marks around a cell that is coloured on a terminal. `printable` escapes them in texts of others.
_COLOURS: Final = {"\ue000": "\033[31m", "\ue001": "\033[33m", "\ue002": "\033[35m", "\ue003": "\033[36m"}
_PLAIN: Final = "\ue00f"
_MARKS: Final = "".join(_COLOURS) + _PLAIN
_VERDICTS: Final = dict(zip(("conflict", "grazing", "unresolved", "near"), _COLOURS, strict=True))
_LEAST_WIDTH: Final = 8  # of a column that is cut to fit the terminal

_LOCK: Final = RLock()  # a thread shows the progress
_CLEAR_LINE: Final = "\r\033[K"
_BREAK: Final = "\n"
_INSTALL_EXTRA: Final = re.compile(r"pip install 'conflictdb\[(?!spark)[a-z,]+\]'")


class Coloured(str):
    """A cell with marks of a colour around it."""

    __slots__ = ()


class Formatter(logging.Formatter):
    """Log records as lines with control characters escaped."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record as text; a traceback keeps its lines."""
        return printable(super().format(record), keep=_BREAK)


def out(text: str = "", *, flush: bool = False) -> None:
    """Print one line of a result; `flush` if somebody waits for it."""
    sys.stdout.write(f"{printable(text, keep=_BREAK)}\n")
    if flush:
        sys.stdout.flush()


def show_table(text: str) -> None:
    """Print a table of this module, with its colours; its cells are escaped."""
    text = printable(text, keep=_BREAK + _MARKS)
    for mark, colour in (*_COLOURS.items(), (_PLAIN, "\033[0m")):
        text = text.replace(mark, colour)
    sys.stdout.write(f"{text}\n")


def coloured(verdict: str, text: str) -> str:
    """Return a text in the colour of a verdict, for a cell of a table; unchanged if colours are not wanted."""
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    return Coloured(f"{_VERDICTS[verdict]}{printable(text)}{_PLAIN}")


def program() -> str:
    """Return the command for this program: as ./run was called, else its name."""
    return shlex.quote(os.environ.get("CONFLICTDB_PROGRAM") or "conflictdb")


def as_called(text: str) -> str:
    """Replace `conflictdb COMMAND` in a message by the command as this program was called, so that it can be typed.

    Under ./run, advice to install an extra with pip becomes `./run extras`, which installs into its own environment.
    """
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


def table(
    header: Sequence[str], rows: Iterable[Sequence[object]], right: Sequence[str] = (), extra: Sequence[str] = ()
) -> str:
    """Return rows under a header in aligned columns, without a final line break; columns in `right` end flush.

    On a terminal, long cells of other columns are cut to fit its width. The columns in `extra`, the last ones, are cut
    first, and left out where there is no room for them.
    """
    cells = [list(header), *([_text(value) for value in row] for row in rows)]
    widths = [max(_width(row[i]) for row in cells) for i in range(len(header))]
    if sys.stdout.isatty():
        if extra:
            _fit(widths, [_LEAST_WIDTH if name in extra else widths[i] for i, name in enumerate(header)])
            if _line(widths) > shutil.get_terminal_size().columns:
                cells = [row[: -len(extra)] for row in cells]
                header, widths = header[: -len(extra)], widths[: -len(extra)]
        _fit(widths, [_LEAST_WIDTH if name not in right else widths[i] for i, name in enumerate(header)])
    lines = []
    for row in cells:
        padded = [
            _padded(_cut(text, width), width, is_right=name in right)
            for text, width, name in zip(row, widths, header, strict=True)
        ]
        lines.append("  ".join(padded).rstrip())
    return "\n".join(lines)


def _fit(widths: list[int], least: Sequence[int]) -> None:
    """Narrow the widest columns, none below its least width, until a line fits the terminal, if it can."""
    most = shutil.get_terminal_size().columns
    while _line(widths) > most:
        i = max(range(len(widths)), key=lambda k: widths[k] if widths[k] > least[k] else 0)
        if widths[i] <= least[i]:
            return
        widths[i] -= 1


def _line(widths: Sequence[int]) -> int:
    """Return the width of a line."""
    return sum(widths) + 2 * (len(widths) - 1)


def _cut(text: str, width: int) -> str:
    """Return a cell that fits a column; an ellipsis stands for what is missing. Coloured cells keep their marks."""
    if _width(text) <= width:
        return text
    if text[0] in _MARKS:
        return f"{text[0]}{text[1:width]}…{_PLAIN}"
    return f"{text[: width - 1]}…"


def _padded(text: str, width: int, *, is_right: bool) -> str:
    blank = " " * (width - _width(text))
    return blank + text if is_right else text + blank


def _width(text: str) -> int:
    return len(text) - 2 if text[:1] in _COLOURS else len(text)


def _text(value: object) -> str:
    if value is None:
        return ""
    text = str(value)
    return text if isinstance(value, Coloured) else printable(text)
