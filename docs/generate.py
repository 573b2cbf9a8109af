"""Writes the pages of docs/reference that are made from the program itself.

    ./run python docs/generate.py

`cli.md` is made from the parser of the command line, `python.md` from the docstrings of the public names, `sql.md` from
the comments in the catalog of a fresh schema, in an embedded database that is thrown away. In
`arrow.md` the columns of a conflict are made from the table `model.record`, and so are the
columns of the model `ConflictRow` in conflictdb/jobs/models.py. `paths.md` is made from `model.path_limits` and from
the counts in tests/paths/table.csv (`./run python tests/paths/table.py --write`). A table in `files.md` is made from
what each reader declares (`conflictdb.formats.standards`). `plans.md`, `plans.schema.json` and the models of areas and
tracks are made from the table `model.plan_columns` (lists in sql/: docs/plan_sql.py). Tests say when a page is out of
date (tests/unit/test_generated_pages.py, tests/sql/test_generated_page.py).
"""

import argparse
import ast
import csv
import dataclasses
import inspect
import json
import keyword
import os
import re
import tempfile
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, Final

import psycopg

import conflictdb
from conflictdb.arrays.arrow.found import FOUND
from conflictdb.cli import codes, commands
from conflictdb.cli.parser import NOTATION, Parser
from conflictdb.exchange import aixm, notam, openair, operational_intents, s124, s421, uas_zones
from conflictdb.formats import file_objects, gpx, kml_document, moving_features, positions, rtz
from conflictdb.formats.standards import Standard
from conflictdb.model import path_limits, plan_columns, record, settings
from conflictdb.model.rules import KINDS

REFERENCE: Final = Path(__file__).resolve().parent / "reference"
NOTE: Final = "<!-- Made by docs/generate.py: do not edit. -->"


def cell(text: str) -> str:
    """Return text for a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table."""
    header = list(header)
    lines = [header, ["---"] * len(header), *([cell(text) for text in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


# --- the form of scene files


def plans_schema() -> str:
    """Return the JSON Schema of scene files."""
    return json.dumps(conflictdb.plans_schema(), indent=1, ensure_ascii=False) + "\n"


# --- the table of what files hold

# What each reader declares, by the files that tests/support/whole_files.py has of it.
STANDARDS: Final[dict[str, Standard]] = {
    "a.geojson": file_objects.SCENE,
    "m.mfjson": moving_features.STANDARD,
    "a.csv": positions.STANDARD,
    "a.rtz": rtz.STANDARD,
    "a.s421": s421.STANDARD,
    "a.gpx": gpx.STANDARD,
    "a.kml": kml_document.STANDARD,
    "a.xml": aixm.STANDARD,
    "a.notam": notam.STANDARD,
    "a.openair": openair.STANDARD,
    "w.gml": s124.STANDARD,
    "z269.json": uas_zones.ED269,
    "z318.geojson": uas_zones.ED318,
    "i.json": operational_intents.STANDARD,
}
BEGINS, ENDS = "<!-- Made by docs/generate.py: begin -->", "<!-- Made by docs/generate.py: end -->"


def standards() -> str:
    """Return the table of what formats hold, and what is read and remarked of it."""

    def named(names: Mapping[str, str]) -> str:
        return "; ".join(f"`{group.replace(' ', '`, `')}`: {text}" for group, text in names.items()) or "none"

    rows = ((one.title, named(one.read), named(one.unread), named(one.aside)) for one in STANDARDS.values())
    return table(["format", "read, and becomes", "remarked, as it is not read", "says nothing of an object"], rows)


def files() -> str:
    """Return the page of files with its table made anew."""
    page = (REFERENCE / "files.md").read_text()
    before, after = page.partition(BEGINS)[0], page.partition(ENDS)[2]
    return f"{before}{BEGINS}\n\n{standards()}\n\n{ENDS}{after}"


# --- the command line

CLI: Final = f"""\
# Command line

{NOTE}

`conflictdb [--dsn DATABASE] [--debug] COMMAND …`, from the source tree `./run COMMAND …`. `conflictdb COMMAND --help`
shows what is below.

Results go to stdout; [what is printed](output.md) has their formats. Errors and remarks go to stderr, one line each:
what, where, which rule, what to do. Progress shows on a terminal and is silent in a pipe.

Without `--scene`, a command uses the scene of `CONFLICTDB_SCENE`, else the last one used in this database, else the
only one; a line on stderr names it. The last ones are in `~/.local/state/conflictdb/last-scene.json` (or below
`XDG_STATE_HOME`).

`conflictdb completion bash|zsh|fish` prints a script that completes commands and options; its first lines say where to
put it.

Values of options:

"""


def cli() -> str:
    """Return the page of the command line."""
    whole = commands.build()
    sections = [
        CLI,
        table(["value", "is"], ((f"`{name}`", text) for name, text in NOTATION.items())),
        table(["option", "means"], _options(whole)),
        table(["environment", "means"], ((f"`{name}`", text) for name, text in commands.ENVIRONMENT.items())),
        table(["exit code", "means"], ((str(code), text) for code, text in codes.MEANING.items())),
    ]
    for name, command in _sections(whole):
        words = " ".join(command.words())
        sections.append(f"## {name}\n\n`conflictdb {name}{' ' if words else ''}{words}`\n\n{command.description}")
        if rows := [*_options(command), *_actions(command)]:
            sections.append(table(["argument or option", "means"], rows))
    return "\n\n".join(part.strip() for part in sections) + "\n"


def _commands(whole: argparse.ArgumentParser) -> Iterator[tuple[str, Parser]]:
    for action in whole._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from action.choices.items()


def _sections(whole: argparse.ArgumentParser) -> Iterator[tuple[str, Parser]]:
    """Yield each command, and after it those below it that have options of their own."""
    for name, command in _commands(whole):
        yield name, command
        yield from ((f"{name} {lower}", one) for lower, one in _commands(command) if any(_options(one)))


def _actions(command: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    for name, action in _commands(command):
        yield f"`{name}`", f"{action.description}".rstrip(".")


def _options(command: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    for action in command._actions:
        if isinstance(action, argparse._SubParsersAction) or action.help == argparse.SUPPRESS:
            continue
        name = action.option_strings[-1] if action.option_strings else action.metavar or ""
        value = ""
        if action.choices:
            value = f" {'|'.join(map(str, action.choices))}"
        elif action.option_strings and action.nargs != 0:
            parts = action.metavar if isinstance(action.metavar, tuple) else (action.metavar or action.dest.upper(),)
            value = f" {' '.join(parts)}"
        yield f"`{f'{name}{value}'.strip()}`", str(action.help)


# --- Python

PYTHON: Final = f"""\
# Python

{NOTE}

`import conflictdb` has these names. Instants in arrays are whole microseconds since 1970 (`_us`), the others aware
datetimes; further [units](units-and-frames.md) are in the names.
"""
IN_MEMORY: Final = (
    *("read", "FileHints", "Contents", "Remark", "Skipped", "Scene", "Area", "Track", "rectangle_outline_m"),
    *("solve", "Results", "Conflict", "Approach", "write", "certify"),
)


def python() -> str:
    """Return the page of the Python interface."""
    things = {name: getattr(conflictdb, name) for name in conflictdb.__all__ if name != "__version__"}
    groups: dict[str, list[str]] = {
        "With a database": [],
        "Objects, files and detection in memory": list(IN_MEMORY),
        "Choices": [],
        "Errors and warnings": [],
    }
    for name in sorted(things, key=lambda name: (name != "connect", name != "Database", name != "StoredScene", name)):
        if name in IN_MEMORY:
            continue
        is_class = inspect.isclass(things[name])
        if is_class and issubclass(things[name], Exception):
            groups["Errors and warnings"].append(name)
        elif is_class and issubclass(things[name], Enum):
            groups["Choices"].append(name)
        else:
            groups["With a database"].append(name)
    sections = [PYTHON]
    for title, names in groups.items():
        sections.append(f"## {title}")
        for name in names:
            sections += [f"### {name}", *_described(things[name])]
    return "\n\n".join(part.strip() for part in sections) + "\n"


def _described(thing: Any) -> Iterator[str]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]
    if isinstance(tree, ast.FunctionDef):
        yield _code(_signature(tree))
        yield _doc(thing)
        return
    assert isinstance(tree, ast.ClassDef)  # noqa: S101
    if issubclass(thing, Exception):
        bases = ", ".join(base.__name__ for base in thing.__bases__)
        yield f"Base: `{bases}`."
    elif issubclass(thing, Enum):
        lines = inspect.getsource(thing).splitlines()
        yield _doc(thing)
        yield _code("\n".join(line.strip() for line in lines if re.match(r"    [A-Z]\w* = ", line)))
        return
    elif dataclasses.is_dataclass(thing):
        yield _code(_wrapped(thing.__name__, list(_fields(thing)), ""))
    yield _doc(thing)
    for method in tree.body:
        if isinstance(method, ast.FunctionDef) and not method.name.startswith("_"):
            yield f"#### {thing.__name__}.{method.name}"
            is_property = any(ast.unparse(one) == "property" for one in method.decorator_list)
            result = ast.unparse(method.returns).strip("'") if method.returns else "None"
            yield _code(f"{method.name}: {result}" if is_property else _signature(method))
            yield _doc(getattr(thing, method.name))


def _fields(thing: type) -> Iterator[str]:
    """Yield the fields of a dataclass, those of its bases first."""
    declared: dict[str, ast.AnnAssign] = {}
    for base in reversed(thing.__mro__):
        if "__dataclass_fields__" in vars(base):
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
            assert isinstance(tree, ast.ClassDef)  # noqa: S101
            declared |= {ast.unparse(one.target): one for one in tree.body if isinstance(one, ast.AnnAssign)}
    if all(one.kw_only for one in dataclasses.fields(thing)):
        yield "*"
    yield from map(_field, declared.values())


def _field(one: ast.AnnAssign) -> str:
    default = ast.unparse(one.value) if one.value else ""
    if default.startswith(("_", "field(")):  # of its own making: the text says what
        default = "…"
    return (
        ast.unparse(one) if not one.value else f"{ast.unparse(one.target)}: {ast.unparse(one.annotation)} = {default}"
    )


def _signature(function: ast.FunctionDef) -> str:
    args = function.args
    defaults: list[ast.expr | None] = [None] * (len(args.args) - len(args.defaults)) + list(args.defaults)
    parts = [_argument(arg, value) for arg, value in zip(args.args, defaults, strict=True) if arg.arg != "self"]
    if args.kwonlyargs:
        parts.append("*")
        parts += [_argument(arg, value) for arg, value in zip(args.kwonlyargs, args.kw_defaults, strict=True)]
    result = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    return _wrapped(function.name, parts, result)


def _argument(arg: ast.arg, value: ast.expr | None) -> str:
    kind = f": {ast.unparse(arg.annotation)}" if arg.annotation else ""
    if value is None:
        return f"{arg.arg}{kind}"
    default = ast.unparse(value)
    return f"{arg.arg}{kind} = {'…' if default.startswith('_') else default}"


def _wrapped(name: str, parts: list[str], result: str) -> str:
    line = f"{name}({', '.join(parts)}){result}"
    if len(line) > 100:
        line = "\n".join([f"{name}(", *(f"    {part}," for part in parts), f"){result}"])
    return re.sub(r"\b(store|inputs)\.", "", line.replace("'", ""))  # names of modules that are private


def _code(text: str) -> str:
    return f"```\n{text}\n```"


def _doc(thing: Any) -> str:
    """Return a docstring as Markdown: sections and fields become lists."""
    lines = inspect.cleandoc(thing.__doc__ or "").replace("``", "`").splitlines()
    out: list[str] = []
    in_section = False
    i = 0
    while i < len(lines):
        entry = re.match(r"(\w[\w, ]*?) : (.*)", lines[i])
        if i + 1 < len(lines) and re.fullmatch(r"-{3,}", lines[i + 1]):
            out += [f"**{lines[i]}**", ""]
            i += 2
            in_section = True
        elif entry or (in_section and lines[i] and not lines[i].startswith(" ")):
            names = ", ".join(f"`{name}`" for name in (entry[1] if entry else lines[i]).split(", "))
            said = [entry[2]] if entry else []
            i += 1
            body = []
            while i < len(lines) and lines[i].startswith("    "):
                body.append(lines[i].strip())
                i += 1
            if in_section and said:  # a type, and below it what it means
                names, said = f"{names} ({said[0]})", []
            out.append(f"- {names}: {' '.join([*said, *body])}")
        else:
            if lines[i] and out and out[-1].startswith("- "):
                out.append("")
            out.append(lines[i])
            i += 1
    return "\n".join(out).strip()


# --- columns of conflicts in Arrow

BEGIN: Final = "<!-- From here to the end mark made by docs/generate.py: do not edit. -->"
END: Final = "<!-- The end mark. -->"


def arrow() -> str:
    """Return the page of Arrow forms, with the columns of a conflict as they are."""
    before, rest = (REFERENCE / "arrow.md").read_text().split(f"{BEGIN}\n")
    after = rest.partition(END)[2]
    types = {one.name: f"{one.type}{'' if one.nullable else ', never null'}" for one in FOUND.schema}
    types["periods"] = "list of struct of `start`, `end`: timestamp[us, UTC], never null"
    rows = ((f"`{one.name}`", _arrow(types[one.name]), one.meaning) for one in (*record.COLUMNS, *record.STATES))
    return f"{before}{BEGIN}\n\n{table(['column', 'type', 'means'], rows)}\n\n{END}{after}"


# --- the model of SQLAlchemy

MADE: Final = "    # Made by docs/generate.py.\n"
MODELS: Final = REFERENCE.parents[1] / "conflictdb" / "jobs" / "models.py"
PRIMARY: Final = ("scene", "a_key", "b_key")
ANNOTATIONS: Final = {
    record.ColumnType.INSTANT: "datetime",
    record.ColumnType.PERIODS: "Sequence[Range[datetime]]",
    record.ColumnType.NUMBER: "float",
    record.ColumnType.WHOLE: "int",
    record.ColumnType.TRUTH: "bool",
    record.ColumnType.POINT: "WKBElement",
    record.ColumnType.REGION: "WKBElement",
    record.ColumnType.JSON: "dict[str, Any]",
}


# Columns of plans whose shape, or value of plans without, their type does not say.
MAPPED: Final = {
    "footprint": 'WKBElement] = mapped_column(_geometry("MULTIPOLYGON"))',
    "path": 'WKBElement] = mapped_column(_geometry("LINESTRINGM"))',
    "outline": 'WKBElement] = mapped_column(_geometry("POLYGON", srid=_METRES))',
    "outlines": 'WKBElement | None] = mapped_column(_geometry("MULTIPOLYGON", srid=_METRES))',
    "active_span": "Range[datetime]] = mapped_column(server_default=FetchedValue())",
}
OF_TYPE: Final = {
    "text": "str",
    "double precision": "float",
    "jsonb": "dict[str, Any]",
    "double precision[]": "list[float | None]",
    "tstzmultirange": "Sequence[Range[datetime]]",
    "timestamptz[]": "list[datetime]",
}


def models() -> str:
    """Return the module of models, with settings, the columns of plans and those of the record in their classes."""
    text = MODELS.read_text()
    made = {f"{kind.capitalize()}Row": "".join(map(_mapped_plan, plan_columns.columns_of(kind))) for kind in KINDS}
    made["SceneRow"] = _mapped_settings(" = mapped_column(server_default=FetchedValue())")
    made["SceneStateRow"] = _mapped_settings("")
    for name, columns in made.items():
        begin = text.index(MADE, text.index(f"class {name}(Base)")) + len(MADE)
        text = text[:begin] + columns + text[text.index("\n\nclass ", begin) :]
    begin = text.index("    scene: ", text.index("class ConflictRow(Base)"))
    return (
        text[:begin]
        + "".join(map(_mapped, (*record.COLUMNS, *record.ATTACHED)))
        + text[text.index("\n\n\n", begin) + 1 :]
    )


def _mapped_settings(default: str) -> str:
    """Return the columns of settings; default : the value of those that are never null."""
    return "".join(
        f"    {column}: Mapped[float | None]\n"
        if setting.type is settings.SettingType.PLACE
        else f"    {column}: Mapped[{'str' if setting.choices else 'float'}]{default}\n"
        for setting in settings.SETTINGS
        for column in setting.columns
    )


def _mapped_plan(column: plan_columns.PlanColumn) -> str:
    is_reserved = keyword.iskeyword(column.name)
    name = column.field if is_reserved else column.name
    rest = " | None]" if column.default == "NULL" else "] = mapped_column(server_default=FetchedValue())"
    mapped = MAPPED.get(column.name) or OF_TYPE[column.sql] + rest
    return f"    {name}: Mapped[{mapped}" + (f' = mapped_column("{column.name}")' if is_reserved else "") + "\n"


PLANS: Final = f"""\
# Plans

{NOTE}

The columns of a plan, an area or a track as it is written, and their names in each form. [Files](files.md) says how
they are written.

[plans.schema.json](plans.schema.json) is the form of scene files, and of plans in requests (those without the member
`scene`, with `"version": 1`), as a JSON Schema (draft 2020-12). It is made from this table; `conflictdb.plans_schema()`
returns it, and wheels contain the file. Every file that this program writes is
valid, and a valid document is read, unless it breaks a rule about values:

- the numbers of values, one per leg or waypoint; the order of times, and of floors and ceilings; dates of the calendar
- shapes: rings are closed, polygons valid, havens convex, and all are on the earth
- the languages of schedules; separation rules that contradict each other; ids that occur twice
- members of the other kind, and names that look like members; bytes of texts; the datum of heights
"""


def plans() -> str:
    """Return the page of the columns of a plan."""
    rows = (
        (
            f"`{one.name}`",
            " or ".join(kind for kind in KINDS if kind in one.kinds),
            *(", ".join(f"`{name}`" for name in names) for names in (one.python, one.members, one.arrow)),
            one.sql,
            one.unit or "",
            one.doc,
        )
        for one in plan_columns.PLAN_COLUMNS
    )
    head = [
        "column",
        "of",
        "`Area`, `Track`",
        "scene files, frames",
        "Arrow, GeoParquet",
        "SQL type",
        "unit",
        "meaning",
    ]
    return f"{PLANS}\n{table(head, rows)}\n"


def _mapped(column: record.Column) -> str:
    may_be_null = column.type is record.ColumnType.REGION or re.search(r"\bnull\b", column.meaning)
    annotation = ANNOTATIONS.get(column.type, "str") + (" | None" if may_be_null else "")
    made = {
        record.ColumnType.POINT: ' = mapped_column(_geometry("POINT"))',
        record.ColumnType.REGION: ' = mapped_column(_geometry("GEOMETRY"), deferred=True)  # it takes long',
    }.get(column.type, " = mapped_column(primary_key=True)" if column.name in PRIMARY else "")
    return f"    {column.name}: Mapped[{annotation}]{made}\n"


def _arrow(text: str) -> str:
    return text.replace("double", "float64").replace("tz=UTC", "UTC")


# --- SQL

SQL: Final = f"""\
# SQL

{NOTE}

Everything is in the schema `conflictdb`; `\\df conflictdb.*` in psql lists its routines. The schema
`conflictdb_internal` is private; its names begin with an underscore. Each role may do what the one before it may:
`conflictdb_reader`, `conflictdb_editor`, `conflictdb_worker`; `conflictdb_tracker` inserts positions and does nothing
else, and an editor may do the same; nothing is granted to PUBLIC. Geometries are longitude
and latitude in degrees, SRID 4326, unless it is said otherwise. [schema.sql](schema.sql) describes both schemas.
"""
ROLES: Final = {
    "To ask: conflictdb_reader": (
        "conflictdb_reader",
        [
            "conflicts",
            "map_areas",
            "map_tracks",
            "map_conflicts",
            "approaches",
            "conflict_events",
            "live",
            "live_conflicts",
            "live_events",
            "acknowledgements",
            "scenes",
            "proposals",
            "rules",
            "limits",
            "edits",
            "queue",
            "attachments",
            "unmapped",
            "shares",
        ],
    ),
    "To report positions: conflictdb_tracker": ("conflictdb_tracker", ["position"]),
    "To plan: conflictdb_editor": ("conflictdb_editor", ["scene", "area", "track"]),
    "To detect: conflictdb_worker": (
        "conflictdb_worker",
        [
            *("run", "conflict", "piece", "change", "object_key", "scene_lock"),
            *("attachment", "attached_relation", "attached_change", "attached_object"),
            *("probe_request", "probe_reply", "worker_stamp", "upper_limit", "edit", "edit_seal"),
            *("difference", "conflict_event", "acknowledgement", "history", "scene_share"),
            *("live_state", "live_conflict", "live_event", "position_look"),
            *("proposal", "proposal_move", "proposal_left", "admission_lock", "rule", "branch_edit"),
        ],
    ),
}
MAKES_INPUT: Final = ("rectangle_outline", "track_path")  # anybody may call them, but only editors have a use for them

COLUMNS: Final = """
SELECT a.attname, format_type(a.atttypid, a.atttypmod), coalesce(col_description(a.attrelid, a.attnum), '')
FROM pg_attribute a
WHERE a.attrelid = %s::regclass AND a.attnum > 0 AND NOT a.attisdropped ORDER BY a.attnum
"""
ROUTINES: Final = """
SELECT p.proname,
       coalesce('(' || (SELECT string_agg(format('%s %s', p.proargnames[i], format_type(t, NULL)), ', ' ORDER BY i)
                        FROM unnest(p.proallargtypes) WITH ORDINALITY u (t, i) WHERE p.proargmodes[i] = 'o') || ')',
                pg_get_function_result(p.oid)),
       coalesce(obj_description(p.oid, 'pg_proc'), ''),
       (SELECT array_agg(format('%s %s', p.proargnames[i], format_type(t, NULL))
                         || coalesce(' DEFAULT ' || pg_get_function_arg_default(p.oid, i::int), '') ORDER BY i)
        FROM unnest(p.proargtypes) WITH ORDINALITY u (t, i)),
       has_function_privilege('conflictdb_reader', p.oid, 'EXECUTE'),
       has_function_privilege('conflictdb_editor', p.oid, 'EXECUTE')
FROM pg_proc p
WHERE p.pronamespace = 'conflictdb'::regnamespace
ORDER BY p.proname, p.oid::regprocedure::text
"""


DEFINERS: Final = """
SELECT p.proname, p.prosrc, p.prorettype = 'trigger'::regtype, obj_description(p.oid, 'pg_proc'),
       ARRAY(SELECT r FROM unnest(ARRAY['conflictdb_reader', 'conflictdb_editor', 'conflictdb_worker']) r
             WHERE has_function_privilege(r, p.oid, 'EXECUTE'))
FROM pg_proc p
WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND p.prosecdef
ORDER BY p.proname
"""
TABLES: Final = """
SELECT c.relname FROM pg_class c
WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND c.relkind IN ('r', 'p', 'v')
"""
WRITES: Final = r"(?:INSERT INTO|DELETE FROM|\bUPDATE) (?:conflictdb\.)?(\w+)"
READS: Final = r"\b(?:FROM|JOIN|USING) (?:\(SELECT \w+\.\w+ FROM )?(?:conflictdb\.)?(pg_catalog\.\w+|\w+)"


def definers(conn: psycopg.Connection[Any]) -> str:
    """Return the section of routines that run as their owner; KeyError names one whose comment lacks its restriction.

    Tables are found in the text of a routine, also in statements that it puts together.
    """
    known = {name for (name,) in conn.execute(TABLES.encode())}
    rows = []
    for name, code, is_trigger, said, roles in conn.execute(DEFINERS.encode()).fetchall():
        restriction = re.search(r"Restricted to ([^.]+)\.", said or "")
        if restriction is None:
            raise KeyError(f"the comment of {name} does not say what it is restricted to")
        writes = {table for table in re.findall(WRITES, code) if table in known}
        code = re.sub(r"DELETE FROM", "", code)
        reads = {table for table in re.findall(READS, code) if table in known or table.startswith("pg_catalog.")}
        least = "its trigger" if is_trigger else roles[0].removeprefix("conflictdb_") if roles else "nobody"
        lists = (", ".join(f"`{table}`" for table in sorted(tables)) or "none" for tables in (reads, writes))
        rows.append([f"`{name}`", least, *lists, restriction[1]])
    said = (
        "These run with the rights of the owner of the schema, whoever calls them (SECURITY DEFINER), and resolve "
        "names in the schemas of conflictdb alone. Each table that is attached with triggers adds a routine "
        "`_note_N`, which notes the rows that changed."
    )
    heads = ["routine", "called by", "reads", "writes", "restricted to"]
    return f"## Routines that run as their owner\n\n{said}\n\n{table(heads, rows)}"


def sql(conn: psycopg.Connection[Any]) -> str:
    """Return the page of the SQL interface of a fresh schema."""
    conn.execute("SELECT set_config('search_path', 'conflictdb, conflictdb_internal, public', true)")
    routines = conn.execute(ROUTINES.encode()).fetchall()
    sections = [SQL]
    for title, (role, relations) in ROLES.items():
        sections.append(f"## {title}")
        for relation in relations:
            said = conn.execute("SELECT obj_description(%s::regclass, 'pg_class')", [relation]).fetchone()
            columns = conn.execute(COLUMNS.encode(), [relation]).fetchall()
            kind = "View" if role == "conflictdb_reader" else "Table"
            sections.append(f"### {relation}\n\n{kind}. {said[0] if said else ''}")
            rows = ((f"`{name}`", _type(kind), text) for name, kind, text in columns)
            sections.append(table(["column", "type", "means"], rows))
        for name, result, text, arguments, reads, edits in routines:
            least = "conflictdb_reader" if reads else "conflictdb_editor" if edits else "conflictdb_worker"
            if ("conflictdb_editor" if name in MAKES_INPUT else least) != role:
                continue
            parts = [_default(argument) for argument in arguments or []]
            sections.append(f"### {name}\n\n{_call(name, parts, _type(result))}\n\n{text}")
    sections += [definers(conn), _states()]
    return "\n\n".join(part.strip() for part in sections) + "\n"


def _call(name: str, parts: list[str], result: str) -> str:
    line = f"{name}({', '.join(parts)}) RETURNS {result}"
    if len(line) > 100:
        line = "\n".join([f"{name}(", ",\n".join(f"    {part}" for part in parts), f") RETURNS {result}"])
    return f"```\n{line}\n```"


def _type(text: str) -> str:
    return text.replace("timestamp with time zone", "timestamptz").replace("double precision", "float8")


def _default(argument: str) -> str:
    return re.sub(r"::[\w ]+(\[\])?", "", _type(argument))


def _states() -> str:
    """Return the section of what is refused, from the list in sql/10_refusals.sql."""
    text = (REFERENCE.parents[1] / "sql" / "10_refusals.sql").read_text()
    rows = ((f"`{state}`", name) for state, name in re.findall(r"(ZC\d{3}) (\w+)", text.partition("\n\n")[0]))
    said = (
        "Bad input is refused with one of these. For programs the error names the object (in its field TABLE), the "
        "field (COLUMN) and the rule (CONSTRAINT). PL/pgSQL also sends the routines that were running, which psql "
        "prints as CONTEXT; `conflictdb psql` does not, nor psql after `\\set SHOW_CONTEXT never` (in `~/.psqlrc`: "
        "always)."
    )
    return f"## SQLSTATEs\n\n{said}\n\n{table(['SQLSTATE', 'name'], rows)}"


# --- paths

PATHS: Final = f"""\
# Paths

{NOTE}

A path is a way of asking which plans interfere: `solve`, a detection, a probe, a file that is written and read, and so
on. Each path of the tables below gives the answer of `solve` with every feature of plans, or refuses by a row of the
first one. Random scenes of 3 to 12 objects mix the features. Claims about other plans, such as those of `delays`, are
checked by moving the plan and solving again.

`./run python tests/paths/table.py` compares again, `--seeds FIRST:END` other scenes, `--paths NAME` some paths, and
`./run test -m slow tests/paths` a hundred new scenes.
"""
COUNTS: Final = Path(__file__).resolve().parents[1] / "tests" / "paths" / "table.csv"
EVERY: Final = "every feature"


def paths() -> str:
    """Return the page of paths."""
    with COUNTS.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    names = list(dict.fromkeys(row["path"] for row in rows))
    number = {name: str(n) for n, name in enumerate(names, 1)}
    features = [name for name in dict.fromkeys(row["feature"] for row in rows) if name != EVERY]
    count = {(row["path"], row["feature"]): row for row in rows}
    totals = [
        [
            number[name],
            name,
            *(count[name, EVERY][column] for column in ("scenes", "comparisons", "failures", "refusals")),
        ]
        for name in names
    ]
    cells = [[feature, *(_count(count[name, feature]) for name in names)] for feature in features]
    reasons = [[row["path"], row["feature"], row["reason"]] for row in rows if row["reason"]]
    return (
        "\n\n".join(
            [
                PATHS.rstrip(),
                "## Refusals",
                table(["path", "feature", "message", "reason"], path_limits.PATH_LIMITS)
                if path_limits.PATH_LIMITS
                else "None.",
                "## Comparisons",
                "A comparison is that of one pair, or of one claim.",
                table(["", "path", "scenes", "comparisons", "failures", "refused scenes"], totals),
                "Comparisons in scenes with a feature, by the number of the path; r: refused, -: not applicable.",
                table(["feature", *number.values()], cells),
                "## Not applicable",
                table(["path", "feature", "reason"], reasons),
            ]
        )
        + "\n"
    )


def _count(row: dict[str, str]) -> str:
    if row["reason"]:
        return "-"
    return row["comparisons"] if int(row["comparisons"]) else "r"


def main() -> None:
    """Write all pages."""
    with tempfile.TemporaryDirectory() as home:
        Path(home).chmod(0o755)  # a server that root starts runs as another user
        os.environ["CONFLICTDB_HOME"] = f"{home}/database"
        with conflictdb.connect() as db, db.connection.transaction():
            pages = {"cli.md": cli(), "python.md": python(), "arrow.md": arrow(), "sql.md": sql(db.connection)}
        pages |= {"paths.md": paths(), "files.md": files(), "plans.md": plans()}
    pages["plans.schema.json"] = plans_schema()
    for name, text in pages.items():
        (REFERENCE / name).write_text(text)
    MODELS.write_text(models())


if __name__ == "__main__":
    main()
