"""Writes the lists of columns of plans and pieces in sql/, from `model.plan_columns` and `store.piece_columns`.

    ./run python docs/plan_sql.py

A list stands between two comments. The first says of which kind it is (`area`, `track`, `plan`: of either, or `piece`),
which columns it has, and what it has for each:

    /* area columns: n.NAME but footprint = ST_Multi(n.footprint) */
    ST_Multi(n.footprint), n.active_span, n.floor_m, …
    /* end */

Columns: all `columns`; `answers`, whose change makes a new version; `plain`, of the forms but OWN; of these `numbers`,
`strings`, the others, `texts` and `documents`; `numbered`, which detections read as 64-bit numbers; `measures`, numbers
of which batches have arrays; `bytes`, shapes and lists; `few`, which few plans have; `alone`, of no other kind;
`values`, plain but documents, and one member of scene files; `checked`, whose rule needs no other column; `pieces`,
whose numbers pieces have. Of pieces: `columns`; `content`, but ids; `scalars`, with one value a row; `numbers`.
WORDS below has the words that are replaced. Items are joined by commas, unless each begins or ends with a comma or
another sign of its own. A test says when a list is out of date (tests/unit/test_plan_columns.py).
"""

import re
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from conflictdb.arrays.column_numbers import IN_PIECES, NUMBERED, measures
from conflictdb.model.few_rules import AREA_FEW, TRACK_FEW
from conflictdb.model.plan_columns import (
    AREA,
    PLAN_COLUMNS,
    TRACK,
    Form,
    PlanColumn,
    bytes_columns,
    checked_columns,
    columns_of,
)
from conflictdb.model.rules import KINDS
from conflictdb.store.piece_columns import PIECE_COLUMNS, SCALARS, PieceColumn

FEW: Final = {AREA: AREA_FEW, TRACK: TRACK_FEW}
SQL: Final = Path(__file__).resolve().parents[1] / "sql"
_LIST: Final = re.compile(
    r"^(?P<indent> *)/\* (?P<kind>area|track|plan|piece) (?P<which>[a-z]+): (?P<item>[^*]+?) \*/\n"
    r"(?P<body>.*?)^ */\* end \*/$",
    re.MULTILINE | re.DOTALL,
)
_BUT: Final = re.compile(r" but (\w+) =(?= |$)")
# Without a space outside its texts.
_SQL_WORD: Final = re.compile(r"(?:'[^']*'|[^ '])+")
_WIDTH: Final = 120
_STAGED_AS: Final = {
    "active_span": "span_start timestamptz, span_end timestamptz",
    "floors_m": "floors_m text",
    "ceilings_m": "ceilings_m text",
}


def _parameter(one: PlanColumn) -> str:
    return f"p_{one.name} {one.sql}" + (f" DEFAULT {one.default}" if one.default else "")


def _members(one: PlanColumn) -> str:
    """Return the members that no column before has; geometry and properties are elsewhere."""
    before = {name for each in PLAN_COLUMNS[: PLAN_COLUMNS.index(one)] for name in each.members} | {
        "geometry",
        "properties",
    }
    return ", ".join(f"'{name}'" for name in one.members if name not in before)


def _written(one: PlanColumn, of: str) -> str:
    """Return a column as it was written, without the expansion of a schedule."""
    return f"CASE WHEN {of}.schedule IS NULL THEN {of}.{one.name} END" if one.is_expansion else f"{of}.{one.name}"


def _bytes(one: PlanColumn, of: str) -> str:
    """Return a column for a comparison that needs no operator of PostGIS."""
    return f"{of}.{one.name}::bytea" if one.sql == "geometry" else _written(one, of)


def _taken(one: PlanColumn, of: str) -> str:
    """Return a column of a stranger's row, as triggers normalise it."""
    value = f"{of}.{one.name}"
    if one.form is Form.DOCUMENT:
        return f"nullif({value}, 'null')"
    return value if one.default in ("", "NULL") else f"coalesce({value}, {one.default})"


def _present(one: PlanColumn, of: str) -> str:
    """Return a column, null for the value of a plan that does not give it."""
    return f"{of}.{one.name}" if one.absent is None else f"nullif({of}.{one.name}, {one.default})"


def _staged(one: PlanColumn, of: str) -> str:
    """Return a column of a temporary table that clients COPY into."""
    value = f"{of}.{one.name}"
    if one.name in ("footprint", "path"):
        return f"ST_SetSRID({value}, 4326)"
    if one.name == "active_span":
        return f"tstzrange(nullif({of}.span_start, '-infinity'), nullif({of}.span_end, 'infinity'))"
    if one.name in _STAGED_AS:
        return f"{value}::{one.sql}"
    return f"nullif({value}, 'NaN')" if one.form is Form.NUMBER else value


def _sent(one: PlanColumn, of: str) -> str:
    """Return a column without nulls, for COPY; clients read it by its form."""
    value = f"{of}.{one.name}"
    if one.form is Form.OWN:
        sent = _sent_bytes(one, value)
        if one.is_expansion:
            sent = f"CASE WHEN {of}.schedule_error IS NULL THEN {sent} END"
        return f"coalesce({sent}, '')" if one.default else sent
    if one.form is Form.NUMBER:
        return f"coalesce({value}, 'NaN')"
    return {
        Form.TEXT: f"coalesce(to_jsonb({value})::text, '')",
        Form.WORD: f"coalesce({value}, '')",
        Form.DOCUMENT: f"coalesce({value}::text, '')",
    }[one.form]


def _expanded(one: PlanColumn, of: str) -> str:
    """Return an expansion as `_sent`, a zero byte for that of a schedule which is not expanded."""
    sent = _sent_bytes(one, f"{of}.{one.name}")
    return (
        f"CASE WHEN {of}.schedule_error IS NULL AND {of}.{one.name} IS NOT NULL THEN {sent} "
        f"WHEN {of}.schedule IS NULL THEN '' ELSE '\\x00' END"
    )


def _sent_bytes(one: PlanColumn, value: str) -> str:
    if one.sql == "geometry":
        return f"ST_AsBinary({value}, 'NDR')"
    return f"array_send({f'_ends_of({value})' if one.sql == 'tstzmultirange' else value})"


def _numbered(one: PlanColumn, of: str) -> str:
    """Return the 64 bits by which detections know a column (conflictdb/arrays/column_numbers.py)."""
    value = f"{of}.{one.name}"
    if one.form is Form.NUMBER:
        return f"('x' || encode(float8send(coalesce({value} + 0, 'NaN')), 'hex'))::bit(64)::bigint"
    return f"_word_number({value})"


def _is_valid(one: PlanColumn, of: str) -> str:
    value = f"{of}.{one.name}"
    return {
        Form.WORD: f"(octet_length({value}) BETWEEN 1 AND 200) IS NOT FALSE",
        Form.NUMBER: f"({value} > '-infinity' AND {value} < 'infinity') IS NOT FALSE",
        Form.DOCUMENT: f"_is_plain(jsonb_build_object('', {value}))",
    }[one.form]


def _check(one: PlanColumn, of: str) -> str:
    value, rule = f"{of}.{one.name}", f"'{one.sqlstate}', v_who, '{one.members[0]}'"
    if one.form is Form.WORD:
        return f"PERFORM _check_word(v_who, '{one.members[0]}', {value});"
    says = "must be a finite number, or absent" if one.form is Form.NUMBER else "must be JSON of at most 99 levels"
    return f"IF NOT ({_is_valid(one, of)}) THEN FOUND := _raise({rule}, '{says}', '{one.name}_valid'); END IF;"


WORDS: Final[dict[str, Callable[[Any], str]]] = {
    "NAME": lambda one: one.name,
    "TYPE": lambda one: one.sql,
    "SENT_AS": lambda one: one.sent,
    "GIVEN": lambda one: (
        f"coalesce(p_numbers[{IN_PIECES.index(one.name) + 1}], 0)" if one.name in IN_PIECES else f"NULL::{one.sql}"
    ),
    "PLACE": lambda one: str(IN_PIECES.index(one.name) + 1),
    "MEMBERS": _members,
    "MEMBER": lambda one: f"'{one.members[0]}'",
    "PARAMETER": _parameter,
    "JSON": lambda one: "'number'" if one.form is Form.NUMBER else "'string'",
    "KIND": lambda one: "NULL" if len(one.kinds) > 1 else str(KINDS.index(min(one.kinds))),
    "ABSENT": lambda one: "IS NULL" if one.absent is None else f"= {one.default}",
    "DOC": lambda one: "'" + one.doc.replace("'", "''") + "'",
    "TEMPORARY": lambda one: _STAGED_AS.get(one.name, f"{one.name} {one.sql}"),
}
# These have an argument, the row: WRITTEN(a).
_OF_ROWS: Final[dict[str, Callable[[Any, str], str]]] = {
    "WRITTEN": _written,
    "BYTES": _bytes,
    "TAKEN": _taken,
    "STAGED": _staged,
    "SENT": _sent,
    "EXPANDED": _expanded,
    "NUMBER": _numbered,
    "VALID": _is_valid,
    "CHECK": _check,
    "STORED": lambda one, of: f"ST_GeomFromEWKB({of}.{one.name})" if one.sql == "geometry" else f"{of}.{one.name}",
    "PRESENT": lambda one, of: (
        f"nullif({of}.{one.name}, {one.default})" if one.absent is not None else f"{of}.{one.name}"
    ),
}


_OF_ROW: Final = re.compile(rf"\b({'|'.join(_OF_ROWS)})\(((?:\(\w+\)|\w+))\)")


_OF_PIECES: Final[dict[str, tuple[PieceColumn, ...]]] = {
    "columns": PIECE_COLUMNS,
    "content": PIECE_COLUMNS[2:],
    "scalars": SCALARS,
    "numbers": tuple(one for one in PIECE_COLUMNS if one.name in IN_PIECES),
}


def _chosen(kind: str, which: str) -> Iterator[PlanColumn]:
    plain = {Form.TEXT, Form.WORD, Form.NUMBER, Form.DOCUMENT}
    by_form = {
        "plain": plain,
        "texts": {Form.TEXT, Form.WORD},
        "numbers": {Form.NUMBER},
        "strings": plain - {Form.NUMBER},
        "documents": {Form.DOCUMENT},
    }
    if kind == "plan":
        seen = {one.name for each in KINDS for one in _chosen(each, which)}
        return (one for one in PLAN_COLUMNS if one.name in seen)
    if which == "numbered":
        return iter(NUMBERED[kind])
    if which == "pieces":
        return (one for one in NUMBERED[kind] if one.in_pieces)
    if which == "measures":
        return measures(kind)
    if which == "few":
        names = {name for few in FEW[kind] for name in few.fields}
        return (one for one in columns_of(kind) if one.field in names)
    if which == "bytes":
        return bytes_columns(kind)
    if which == "checked":
        return (one for one in checked_columns(kind) if one.form is not Form.TEXT)
    if which in by_form:
        return (one for one in columns_of(kind) if one.form in by_form[which])
    if which in ("members", "values"):
        return (
            one for one in columns_of(kind) if one.is_member and (which == "members" or one.form is not Form.DOCUMENT)
        )
    if which == "alone":
        return (one for one in columns_of(kind) if len(one.kinds) == 1)
    if which == "answers":
        return (one for one in columns_of(kind) if one.changes_answers and not one.is_expansion)
    if which != "columns":
        raise ValueError(f"no list of {which} of plans")
    return columns_of(kind)


def _item(one: PlanColumn | PieceColumn, template: str) -> str:
    text = re.sub("|".join(sorted(WORDS, key=len, reverse=True)), lambda found: WORDS[found[0]](one), template)
    return _OF_ROW.sub(lambda found: _OF_ROWS[found[1]](one, found[2]), text)


def _filled(found: re.Match[str]) -> str:
    template, *but = _BUT.split(" ".join(found["item"].split()))
    own = dict(zip(but[::2], map(str.strip, but[1::2]), strict=True))
    kind, which = found["kind"], found["which"]
    chosen = _OF_PIECES[which] if kind == "piece" else _chosen(kind, which)
    each = [_item(one, own.get(one.name, template)) for one in chosen]
    each = [text for text in each if text]
    is_joined = template.startswith((",", "AND", "||", "CHECK")) or template.endswith((",", ";"))
    if not is_joined:
        each = [f"{text}," for text in each[:-1]] + each[-1:]
    head = found[0][: found.start("body") - found.start()]
    width = _WIDTH - len(found["indent"])
    rows: list[str] = []
    for text in each:
        if rows and len(rows[-1]) + 1 + len(text) <= width and not text.endswith(";"):
            rows[-1] += f" {text}"
        else:
            rows += _wrapped(text, width)
    return head + textwrap.indent("".join(f"{row}\n" for row in rows), found["indent"]) + f"{found['indent']}/* end */"


def _wrapped(text: str, width: int) -> Iterator[str]:
    """Yield the lines of a long item, broken outside its texts."""
    line = ""
    for word in _SQL_WORD.findall(text):
        if line and len(line) + 1 + len(word) > width:
            yield line
            line = f"    {word}"
        else:
            line = f"{line} {word}" if line else word
    yield line


def filled(text: str) -> str:
    """Return the text of a file of sql/ with its lists as the table has them."""
    return _LIST.sub(_filled, text)


if __name__ == "__main__":
    for file in sorted(SQL.glob("*.sql")):
        before = file.read_text()
        if (after := filled(before)) != before:
            file.write_text(after)
