"""Build the files of the extension `conflictdb`: the same structure and routines as `schema.upgrade` creates.

A version of the extension is a revision of the structure. The script of a version creates everything. One update script
leads from each earlier extension version directly to the newest: only the newest routines exist as files.
"""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from conflictdb.errors import ServerError
from conflictdb.jobs import schema

_CONTROL: Final = """\
comment = 'which plans interfere, where, and exactly when: moving and static areas'
default_version = '{version}'
encoding = 'UTF8'
schema = conflictdb
relocatable = false
requires = 'postgis, btree_gist'
superuser = false
"""

_ONLY_AS_EXTENSION: Final = '\\echo Use "{command}" to load this file. \\quit\n'

# A database made by `conflictdb admin init` does not become an extension.
_REFUSE_BESIDE_INIT: Final = """
DO $$
BEGIN
    IF to_regclass('conflictdb.alembic_version') IS NOT NULL THEN
        RAISE EXCEPTION 'database % has the schema conflictdb already, made by `conflictdb admin init`',
                        current_database()
            USING ERRCODE = 'duplicate_schema',
                  HINT = 'It needs no extension: keep it current by `conflictdb admin upgrade`.';
    END IF;
END
$$;
"""

# The part of `schema.prepare` that a script can do.
_PREPARE: Final = """
DO $$
DECLARE
    v_path text := (SELECT format('conflictdb, conflictdb_internal, %I, pg_temp', n.nspname)
                    FROM pg_catalog.pg_extension e
                    JOIN pg_catalog.pg_namespace n ON n.oid = e.extnamespace WHERE e.extname = 'postgis');
    v_version text := (SELECT substring(e.extversion FROM '^[0-9]+[.][0-9]+') FROM pg_catalog.pg_extension e
                       WHERE e.extname = 'postgis');
BEGIN
    IF current_setting('server_version_num')::integer < {server}
       OR string_to_array(v_version, '.')::integer[] < string_to_array('{postgis}', '.')::integer[] THEN
        RAISE EXCEPTION 'PostgreSQL {major} or newer and PostGIS {postgis} or newer are needed'
            USING ERRCODE = 'feature_not_supported';
    END IF;
    CREATE SCHEMA IF NOT EXISTS conflictdb_internal;
    PERFORM set_config('search_path', v_path, true);
    PERFORM set_config('conflictdb.is_extension', 'on', true); -- for 90_grants.sql
END
$$;
"""

# Run files that need no PostGIS names without its schema on the path: users may have created names there.
_WITHOUT_POSTGIS: Final = """
SELECT pg_catalog.set_config('conflictdb.path'::text, pg_catalog.current_setting('search_path'::text), true);
SET LOCAL search_path = conflictdb, conflictdb_internal, pg_temp;
"""
_WITH_POSTGIS: Final = """
SELECT pg_catalog.set_config('search_path'::text, pg_catalog.current_setting('conflictdb.path'::text), true);
"""

# The routines recreate the functions of attached tables, and a script may replace only members of the extension. The
# functions belong to the database, which dumps them, so they are members only during the script.
_NOTES: Final = """
DO $$
DECLARE
    v_note regprocedure;
BEGIN
    FOR v_note IN SELECT p.oid FROM pg_catalog.pg_proc p
                  WHERE p.pronamespace IN ('conflictdb'::regnamespace, 'conflictdb_internal'::regnamespace)
                        AND p.proname ~ '^_note_[0-9]+$' LOOP
        EXECUTE format('ALTER EXTENSION conflictdb {action} FUNCTION %s', v_note);
    END LOOP;
END
$$;
"""

# Dumps include the contents of tables and the state of sequences; the extension sets the revision.
_DUMP_CONTENTS: Final = """
DO $$
DECLARE
    v_one regclass;
BEGIN
    FOR v_one IN SELECT c.oid FROM pg_catalog.pg_class c
                 WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind IN ('r', 'S')
                       AND c.relname <> 'alembic_version' LOOP
        PERFORM pg_extension_config_dump(v_one, '');
    END LOOP;
END
$$;
"""


def version() -> str:
    """Return the version of this program's extension."""
    return schema.head()


def files() -> Iterator[tuple[str, str]]:
    """Yield names and contents of the files that a server needs."""
    newest = version()
    yield "conflictdb.control", _CONTROL.format(version=newest)
    yield f"conflictdb--{newest}.sql", _install_script()
    for earlier in schema.revisions():
        if earlier < newest:
            yield f"conflictdb--{earlier}--{newest}.sql", _update_script(earlier)
    yield f"conflictdb--{schema.FORMER}--{newest}.sql", _update_script(schema.revisions()[0], schema.RESTAMP)


def build(directory: Path) -> list[Path]:
    """Write the files into a directory, created if missing; return their paths."""
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in files():
        path = directory / name
        path.write_text(text, encoding="utf-8")
        path.chmod(0o644)  # the server reads it as another user
        written.append(path)
    return written


def install_directory(pg_config: str) -> Path:
    """Return the extension directory of the server that a `pg_config` program belongs to.

    Raises
    ------
    ServerError
        The program does not exist, or reports no existing directory.
    """
    try:
        shared = subprocess.run([pg_config, "--sharedir"], check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError) as error:
        raise ServerError(
            f"{pg_config} does not say where its server looks for extensions ({error}): name the pg_config of the "
            "server, --pg-config /usr/lib/postgresql/17/bin/pg_config, or write the files anywhere by "
            "`conflictdb admin extension DIRECTORY` and copy them"
        ) from error
    directory = Path(shared, "extension")
    if not directory.is_dir():
        raise ServerError(f"there is no server beside {pg_config}: it has no directory {directory}")
    return directory


def _install_script() -> str:
    command = _ONLY_AS_EXTENSION.format(command="CREATE EXTENSION conflictdb")
    structure = schema.structure_sql()
    refusals = [_REFUSE_BESIDE_INIT, schema.REFUSE_FOREIGN_SCHEMA]
    return "".join([command, *refusals, _prepare(), structure, _routines(), _DUMP_CONTENTS])


def _update_script(earlier: str, first: str = "") -> str:
    command = _ONLY_AS_EXTENSION.format(command=f"ALTER EXTENSION conflictdb UPDATE TO '{version()}'")
    notes = [_NOTES.format(action=action) for action in ("ADD", "DROP")]
    structure = schema.structure_sql(earlier)
    parts = [_prepare(), first, structure, notes[0], _routines(), notes[1], schema.marking_sql(earlier), _DUMP_CONTENTS]
    return "".join([command, schema.REFUSE_FOREIGN_SCHEMA, *parts])


def _prepare() -> str:
    server, postgis = schema.MIN_SERVER_VERSION, ".".join(map(str, schema.MIN_POSTGIS_VERSION))
    return _PREPARE.format(server=server, major=server // 10000, postgis=postgis)


def _routines() -> str:
    parts = []
    for file in schema.routine_files():
        text = file.read_text(encoding="utf-8")
        parts += [_WITHOUT_POSTGIS, text, _WITH_POSTGIS] if schema.needs_no_postgis(file) else [text]
    return "\n".join([*parts, schema.REFUSE_FOREIGN_NAMES, schema.comment_sql()])
