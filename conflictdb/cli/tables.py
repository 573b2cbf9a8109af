"""Tables, and how they fit a terminal."""

import os
import shutil
import sys
from collections.abc import Collection, Iterable, Sequence
from itertools import zip_longest
from typing import Final
from unicodedata import combining, east_asian_width

from conflictdb.errors import printable

# Marks around a cell that is coloured on a terminal. `printable` escapes them in texts of others.
_COLOURS: Final = {"\ue000": "\033[31m", "\ue001": "\033[33m", "\ue002": "\033[35m", "\ue003": "\033[36m"}
_PLAIN: Final = "\ue00f"
_MARKS: Final = "".join(_COLOURS) + _PLAIN
_VERDICTS: Final = dict(zip(("conflict", "grazing", "unresolved", "near"), _COLOURS, strict=True))
_LEAST_WIDTH: Final = 10  # of a shortened cell
_GAP: Final = 2  # between columns
_INDENT: Final = 4  # of the further lines of a line of prose


class Coloured(str):
    """A cell with marks of a colour around it."""

    __slots__ = ()


def show_table(text: str) -> None:
    """Print a table of this module, with its colours; its cells are escaped."""
    text = printable(text, keep="\n" + _MARKS)
    for mark, colour in (*_COLOURS.items(), (_PLAIN, "\033[0m")):
        text = text.replace(mark, colour)
    sys.stdout.write(f"{text}\n")


def coloured(verdict: str, text: str) -> str:
    """Return a text in the colour of a verdict, for a cell of a table; unchanged if colours are not wanted."""
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    return Coloured(f"{_VERDICTS[verdict]}{printable(text)}{_PLAIN}")


def table(
    header: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    right: Collection[str] = (),
    whole: Collection[str] = (),
    extra: Collection[str] = (),
) -> str:
    """Return rows under a header in aligned columns, without a final line break.

    Off a terminal columns are as wide as their cells. On a terminal the first of these that fits is taken:

    1. headers wrap at words;
    2. as 1, and columns in `extra` are shortened in the middle;
    3. as 1, columns in `extra` are left out, and named below the table;
    4. as 3, and other columns are shortened, but none in `right` and `whole`;
    5. as 4, and columns in `whole` wrap at words;
    6. each row becomes a block, with a line for each cell.

    right : columns of numbers, which end flush
    whole : columns that must not be shortened, such as times
    extra : columns that a narrow table can do without
    """
    cells = [[_text(value) for value in row] for row in rows]
    if not sys.stdout.isatty():
        return _lines(header, cells, [max(map(_width, column)) for column in zip(header, *cells, strict=True)], right)
    kept = [i for i, name in enumerate(header) if name not in extra]
    fewer, fewer_cells = [header[i] for i in kept], [[row[i] for i in kept] for row in cells]
    texts = [name for name in header if name not in right and name not in whole]
    for columns, some, shortened, wrapping in (
        (header, cells, (), ()),
        (header, cells, extra, ()),
        (fewer, fewer_cells, (), ()),
        (fewer, fewer_cells, texts, ()),
        (fewer, fewer_cells, texts, whole),
    ):
        widths = _fitting(columns, some, shortened, wrapping)
        if _line(widths) <= _room():
            text = _lines(columns, some, widths, right, wrapping)
            missing = [name for name in header if name not in columns]
            return "\n".join([text, wrapped(f"(no room for {', '.join(missing)})")]) if missing else text
    return _blocks(header, cells)


def wrapped(text: str) -> str:
    """Return lines of prose; on a terminal they wrap at words, and go on four columns further in."""
    if not sys.stdout.isatty():
        return text
    lines = []
    for line in text.split("\n"):
        words = line.lstrip(" ")
        margin = " " * (len(line) - len(words))
        room = max(_room() - len(margin), _INDENT + _LEAST_WIDTH)
        first, *rest = _split(words, room, room - _INDENT)
        lines += [margin + first, *(f"{margin}{' ' * _INDENT}{one}" for one in rest)]
    return "\n".join(lines)


def _room() -> int:
    return shutil.get_terminal_size().columns


def _fitting(
    header: Sequence[str], cells: Sequence[Sequence[str]], shortened: Collection[str], wrapping: Collection[str]
) -> list[int]:
    """Return widths of columns, the widest narrowed until a line fits the terminal, if it can."""
    widths, least = [], []
    for name, *column in zip(header, *cells, strict=True):
        is_wrapped = name in wrapping
        widest = max(map(_longest_word if is_wrapped else _width, column), default=0)
        widths.append(max(_longest_word(name) if is_wrapped else _width(name), widest))
        least.append(max(_longest_word(name), min(widest, _LEAST_WIDTH) if name in shortened else widest))
    while _line(widths) > _room():
        i = max(range(len(widths)), key=lambda k: widths[k] if widths[k] > least[k] else 0)
        if widths[i] <= least[i]:
            break
        widths[i] -= 1
    return widths


def _line(widths: Sequence[int]) -> int:
    """Return the width of a line."""
    return sum(widths) + _GAP * (len(widths) - 1)


def _lines(
    header: Sequence[str],
    cells: Sequence[Sequence[str]],
    widths: Sequence[int],
    right: Collection[str],
    wrapping: Collection[str] = (),
) -> str:
    """Return rows in columns of these widths; the header and columns in `wrapping` wrap, other cells are shortened."""
    lines = []
    for row in (header, *cells):
        parts = [
            _split(text, width) if row is header or name in wrapping else [_shortened(text, width)]
            for name, text, width in zip(header, row, widths, strict=True)
        ]
        for line in zip_longest(*parts, fillvalue=""):
            columns = zip(header, line, widths, strict=True)
            lines.append(
                (" " * _GAP)
                .join(_padded(text, width, is_right=name in right) for name, text, width in columns)
                .rstrip()
            )
    return "\n".join(lines)


def _blocks(header: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    """Return each row as lines of a column's header and its cell; empty cells are left out."""
    margin = max(map(_width, header)) + _GAP
    blocks = []
    for row in cells:
        lines = []
        for name, text in zip(header, row, strict=True):
            parts = _split(text, max(_room() - margin, _LEAST_WIDTH)) if text else ()
            lines += [_padded(name if i == 0 else "", margin) + part for i, part in enumerate(parts)]
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def _split(text: str, width: int, rest: int | None = None) -> list[str]:
    """Return the lines of a text that wraps at spaces, and within words that are too long.

    rest : width of the lines after the first, if it differs
    """
    if text[:1] in _COLOURS:
        return [f"{text[0]}{line}{_PLAIN}" for line in _split(text[1:-1], width, rest)]
    lines = [""]
    most = width
    for word in text.split(" "):
        if lines[-1] and _width(lines[-1]) + 1 + _width(word) <= most:
            lines[-1] += f" {word}"
            continue
        if lines[-1]:
            lines.append("")
            most = width if rest is None else rest
        while _width(word) > most:
            head = _head(word, most)
            lines[-1:] = [head, ""]
            word = word[len(head) :]
        lines[-1] = word
    return lines


def _shortened(text: str, width: int) -> str:
    """Return a cell that fits a column; an ellipsis stands for its middle. Coloured cells keep their marks."""
    if _width(text) <= width:
        return text
    if text[0] in _COLOURS:
        return f"{text[0]}{_shortened(text[1:-1], width)}{_PLAIN}"
    tail = _head(text[::-1], (width - 1) // 3)[::-1]
    return f"{_head(text, width - 1 - _width(tail))}…{tail}"


def _head(text: str, width: int) -> str:
    end = min(len(text), width)
    while _width(text[:end]) > width:
        end -= 1
    return text[:end]


def _padded(text: str, width: int, *, is_right: bool = False) -> str:
    blank = " " * (width - _width(text))
    return blank + text if is_right else text + blank


def _width(text: str) -> int:
    """Return how many columns a terminal needs for a text, without its marks."""
    if text.isascii():
        return len(text)
    wide = sum(east_asian_width(one) in "WF" for one in text)
    return len(text) + wide - sum(one in _MARKS or combining(one) != 0 for one in text)


def _longest_word(text: str) -> int:
    return max(map(_width, text.split(" ")))


def _text(value: object) -> str:
    if value is None:
        return ""
    return value if isinstance(value, Coloured) else printable(str(value))
