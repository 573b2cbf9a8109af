"""Finds the places that spell out a plan: blocks of code that name at least seven of its columns.

    ./run python tests/support/spellings.py

A block is a function, a class without its functions, a statement outside of them, a routine of sql/, or a function of
the page. Names are those of the tables, of `Area` and `Track`, and of the rows that clients COPY. Lists that
docs/plan_sql.py and docs/generate.py write are left out, and so are docstrings, comments, names that are called, the
`search_path`, and the column `name`, which is too common a word.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from conflictdb.model.plan_columns import PLAN_COLUMNS

ROOT: Final = Path(__file__).resolve().parents[2]
AT_LEAST: Final = 7
# The column of each name; both shapes count as one.
_OF_NAME: Final = {
    **{name: one.name for one in PLAN_COLUMNS for name in (one.name, *one.python) if name != "name"},
    "span_start": "active_span",
    "spans": "activations",
    "floors": "floors_m",
    "ceilings": "ceilings_m",
    **dict.fromkeys(("footprint", "path", "geometry", "shape", "positions_deg", "times_us"), "shape"),
}
# Ordinary words of Python.
_NOT_IN_PYTHON: Final = frozenset({"class", "path", "geometry", "shape"})
_LIST: Final = re.compile(r"^ */\* (area|track|plan|piece) [a-z]+:.*?^ */\* end \*/$", re.MULTILINE | re.DOTALL)
_MADE: Final = re.compile(r"^    # Made by docs/generate\.py\.\n(    .*\n)*", re.MULTILINE)
_STATEMENT: Final = re.compile(r"^(?=(?:CREATE|COMMENT|DO|ALTER|INSERT|GRANT|REVOKE|DROP|SELECT)\b)", re.MULTILINE)
_ROUTINE: Final = re.compile(r"(?:FUNCTION|PROCEDURE) (?:\w+\.)?(\w+)")
_OF_PAGE: Final = re.compile(
    r"^(?=(?:export |async |function |const |class |  (?:static |async |get )?#?\w+\([^)]*\) \{$))", re.MULTILINE
)


class Spelling(NamedTuple):
    """A block that names columns of a plan."""

    file: str
    block: str
    line: int
    columns: tuple[str, ...]

    @property
    def place(self) -> str:
        """Return the file and the block, which other lines of the file do not change."""
        return f"{self.file} {self.block}"


def _pattern(names: Iterator[str]) -> re.Pattern[str]:
    words = "|".join(sorted(names, key=len, reverse=True))
    return re.compile(rf"(?<![A-Za-z0-9])_?(?:p_|v_)?({words})(?![A-Za-z0-9(])")


_IN_SQL: Final = _pattern(iter(_OF_NAME))
_IN_PYTHON: Final = _pattern(name for name in _OF_NAME if name not in _NOT_IN_PYTHON)


def columns_named(text: str, *, in_python: bool) -> tuple[str, ...]:
    """Return the columns that a text names, each once."""
    return tuple(sorted({_OF_NAME[found] for found in (_IN_PYTHON if in_python else _IN_SQL).findall(text)}))


def _without(lines: re.Pattern[str], text: str) -> str:
    """Return a text without what a pattern matches, with the same number of lines."""
    return lines.sub(lambda found: "\n" * found[0].count("\n"), text)


def blocks_of_python(text: str) -> Iterator[tuple[str, int, str]]:
    """Yield name, line and code of each block."""
    tree, lines = ast.parse(text), [re.sub(r"#.*", "", line) for line in text.splitlines()]
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module) and ast.get_docstring(node):
            for row in range(node.body[0].lineno - 1, node.body[0].end_lineno or 0):
                lines[row] = ""

    def of_body(body: list[ast.stmt], around: str) -> Iterator[tuple[str, int, str]]:
        for node in body:
            rows = set(range(node.lineno - 1, node.end_lineno or node.lineno))
            if isinstance(node, ast.ClassDef):
                functions = [one for one in node.body if isinstance(one, ast.FunctionDef)]
                yield from of_body([*functions], f"{node.name}.")
                for one in functions:
                    rows -= set(range(one.lineno - 1, one.end_lineno or one.lineno))
            name = getattr(node, "name", "") or re.split(r"\W", lines[node.lineno - 1], maxsplit=1)[0]
            yield around + name, node.lineno, "\n".join(lines[row] for row in sorted(rows))

    yield from of_body(tree.body, "")


def blocks(path: Path) -> Iterator[tuple[str, int, str]]:
    """Yield name, line and code of each block of a file."""
    text = path.read_text()
    if path.suffix == ".py":
        yield from blocks_of_python(_without(_MADE, text))
        return
    text = text.replace("search_path", "")
    text = re.sub(r"--.*", "", _without(_LIST, text)) if path.suffix == ".sql" else re.sub(r"//.*", "", text)
    line = 1
    for part in (_STATEMENT if path.suffix == ".sql" else _OF_PAGE).split(text):
        if not part.startswith("COMMENT"):
            routine = _ROUTINE.search(part.partition("\n")[0]) or re.search(r"(\w+)\(|(\w+) =", part)
            yield next(filter(None, routine.groups())) if routine else "", line, part
        line += part.count("\n")


def spellings(at_least: int = AT_LEAST) -> Iterator[Spelling]:
    """Yield the places that name at least so many columns of a plan."""
    folders = ("conflictdb/**/*.py", "docs/*.py", "sql/*.sql", "conflictdb/map/page/**/*.js")
    for path in (path for one in folders for path in sorted(ROOT.glob(one))):
        for block, line, text in blocks(path):
            columns = columns_named(text, in_python=path.suffix == ".py")
            if len(columns) >= at_least:
                yield Spelling(str(path.relative_to(ROOT)), block, line, columns)


if __name__ == "__main__":
    found = list(spellings(int(sys.argv[1]) if len(sys.argv) > 1 else AT_LEAST))
    for one in found:
        sys.stdout.write(f"{one.file}:{one.line} {one.block}: {', '.join(one.columns)}\n")
    sys.stdout.write(f"{len(found)} places in {len({one.file for one in found})} files\n")
