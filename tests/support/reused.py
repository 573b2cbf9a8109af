"""A database that tests use in turn: all that a test leaves is removed, or else the database is replaced."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from typing import Any

import psycopg
from databases import TestServer
from patience import WAIT_S
from psycopg.rows import tuple_row

# Catalogs that say all that a test may add, change or remove in a database.
CATALOGS = (
    "attrdef", "attribute", "cast", "class", "collation", "constraint", "conversion", "default_acl", "depend",
    "description", "enum", "event_trigger", "extension", "foreign_data_wrapper", "foreign_server", "foreign_table",
    "index", "inherits", "init_privs", "language", "largeobject_metadata", "namespace", "opclass", "operator",
    "opfamily", "policy", "proc", "publication", "range", "rewrite", "seclabel", "statistic_ext", "trigger", "type",
)  # fmt: skip
# The schemas of temporary tables stay.
PERMANENT = {"namespace": "r.nspname !~ '^pg_(toast_)?temp_'"}
# Columns that change with the rows of a table, not with its definition.
PASSING = {
    "class": "{relfilenode,relpages,reltuples,relallvisible,relhasrules,relhastriggers,relfrozenxid,relminmxid}",
    "index": "{indcheckxmin}",
}
# The number of rows of a catalog, and hashes of those written after a transaction.
ROWS = """
SELECT '{catalog}', count(*), array_agg(hashtextextended({content}, 0))
                     FILTER (WHERE age(r.xmin) < (SELECT age(%(since)s::text::xid)))
FROM pg_catalog.pg_{catalog} r WHERE {condition}
"""
# The catalogs, of those named, that other sessions have written. A session counts its writes when it ends or flushes
# its counts. Servers before 15 may count late: there the query returns all names.
WRITTEN = """
SELECT ARRAY(SELECT n.name FROM unnest(%(names)s::text[]) n (name) LEFT JOIN pg_stat_sys_tables s
                 ON s.schemaname = 'pg_catalog' AND s.relname = 'pg_' || n.name
             WHERE current_setting('server_version_num')::int < 150000
                   OR s.n_tup_ins + s.n_tup_upd + s.n_tup_del > 0
             ORDER BY 1)
"""
# Objects that are dropped if a test created them, in this order.
DROPPED = {
    "event_trigger": "true",
    "publication": "true",
    "extension": "true",
    "namespace": PERMANENT["namespace"],
    "foreign_data_wrapper": "true",
    "class": "r.relkind IN ('r', 'p', 'v', 'm', 'f', 'S')",
    "proc": "true",
    "type": "r.typtype IN ('d', 'e', 'r')",
    "trigger": "NOT r.tgisinternal",
    "policy": "true",
}
# Removed objects leave marks, so they come first.
TABLES = """
SELECT c.oid::regclass::text FROM pg_class c
WHERE c.relnamespace IN ('conflictdb'::regnamespace, 'conflictdb_internal'::regnamespace) AND c.relkind = 'r'
      AND c.relname <> 'alembic_version'
ORDER BY c.relname NOT IN ('area', 'track'), 1
"""
RESTART = """
SELECT setval(q.seqrelid, q.seqstart, false) FROM pg_sequence q JOIN pg_class c ON c.oid = q.seqrelid
WHERE c.relnamespace = 'conflictdb'::regnamespace AND pg_sequence_last_value(q.seqrelid) IS NOT NULL
"""
STATISTICS = """
SELECT c.oid::bigint, c.relpages, c.reltuples, c.relallvisible FROM pg_class c
WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind IN ('r', 'i')
"""
FORGET = """
DELETE FROM pg_statistic s USING pg_class c WHERE c.oid = s.starelid AND c.relnamespace = 'conflictdb'::regnamespace;
UPDATE pg_class c SET relpages = v.relpages, reltuples = v.reltuples, relallvisible = v.relallvisible
FROM (VALUES {rows}) v (oid, relpages, reltuples, relallvisible) WHERE c.oid = v.oid
"""
# Pages of indexes stay when their rows have gone, and a clone is made faster than so many rows are deleted.
HAS_LARGE_INDEXES = """
SELECT EXISTS (SELECT FROM pg_index i JOIN pg_class c ON c.oid = i.indexrelid
               WHERE c.relnamespace = 'conflictdb'::regnamespace GROUP BY i.indrelid
               HAVING sum(pg_relation_size(i.indexrelid)) > 256 * current_setting('block_size')::bigint)
"""
END_SESSIONS = """
SELECT pg_terminate_backend(pid) FROM pg_stat_activity
WHERE datname = current_database() AND pid NOT IN (pg_backend_pid(), %(kept)s) AND backend_type = 'client backend'
"""
# Owners and grants, as a number and a sum of hashes (a thousand rows in order would take a third of a clean-up), and
# settings, which the whole server keeps, and the version of the schema.
SHARED = """
SELECT ROW((SELECT ROW(count(*), sum(hashtextextended(ROW(d.classid, d.objid, d.refobjid, d.deptype)::text, 0)))
            FROM pg_shdepend d WHERE d.dbid = b.oid),
           (SELECT array_agg(ROW(s.setrole, s.setconfig) ORDER BY s.setrole) FROM pg_db_role_setting s
            WHERE s.setdatabase = b.oid),
           b.datdba, b.datconnlimit, b.datallowconn, b.datacl, shobj_description(b.oid, 'pg_database'),
           (SELECT array_agg(v.version_num) FROM conflictdb.alembic_version v))::text
FROM pg_database b WHERE b.datname = current_database()
"""
# As DISCARD ALL, which forgets plans as well.
FORGET_ALL = """
SET SESSION AUTHORIZATION DEFAULT; RESET ALL; CLOSE ALL; UNLISTEN *; SELECT pg_advisory_unlock_all();
DISCARD TEMP; DISCARD SEQUENCES
"""


class ReusedDatabase:
    """A clone of a template that tests use in turn.

    server : its server
    template : name of the database to clone
    prefix : what names of its clones begin with
    """

    def __init__(self, server: TestServer, template: str, prefix: str) -> None:
        self._server, self._template, self._prefix = server, template, prefix
        self._numbers = count(1)
        self._name = ""
        self._conn: psycopg.Connection[Any] | None = None
        self._kept: psycopg.Connection[Any] | None = None
        self._tables: list[str] = []
        self._statistics: set[tuple[Any, ...]] = set()
        self._counts: dict[str, int] = {}
        self._rows: set[int] = set()
        self._newest = 0
        self._shared = self._since = ""

    def dsn(self) -> str:
        """Return how to connect to it; it is as the template."""
        if self._conn is None:
            self._name = f"{self._prefix}_{next(self._numbers)}"
            dsn = self._server.clone(self._template, self._name)
            self._conn = psycopg.connect(dsn, application_name="cleaner", autocommit=True, row_factory=tuple_row)
            self._conn.execute(
                "SET session_replication_role = replica; SET client_min_messages = warning; SET track_counts = off"
            )
            if not self._tables:
                self._remember(self._conn)
            self._shared = self._one(self._conn, SHARED)
            self._since = self._one(self._conn, "SELECT pg_current_xact_id()::xid")
        return self._server.database(self._name)

    def clean(self) -> None:
        """Remove leftovers of a test; drop the database if anything remains."""
        if self._conn is None:
            return
        try:
            is_clean = self._is_cleaned(self._conn)
        except psycopg.Error:  # the test ended all sessions, or changed the schema
            is_clean = False
        if not is_clean:
            self.drop()

    @contextmanager
    def session(self, dsn: str) -> Iterator[psycopg.Connection[Any]]:
        """Give a connection in time zone UTC: the one of earlier tests, if they left it as it was.

        New sessions read catalogs and compile routines first, which takes longer than most tests.
        """
        own = dsn == self._server.database(self._name)
        conn = None
        if own:
            conn, self._kept = self._kept, None
        if conn is None:
            conn = psycopg.connect(dsn, options="-c timezone=UTC", prepare_threshold=None)
        before = state_of(conn)
        yield conn
        with suppress(psycopg.Error):  # the test ended the session
            conn.rollback()
            if own and state_of(conn) == before:
                conn.autocommit = True
                conn.execute(FORGET_ALL)
                if conn.info.server_version >= 150000:  # it has not ended, see WRITTEN
                    conn.execute("SELECT pg_stat_force_next_flush()")
                conn.autocommit = False
                self._kept = conn
                return
        conn.close()

    def drop(self) -> None:
        """Drop it; the next test gets another clone."""
        if self._kept is not None:
            self._kept.close()
            self._kept = None
        if self._conn is not None:
            self._conn.close()
            self._conn = None
            self._server.drop(self._name)

    def _remember(self, conn: psycopg.Connection[Any]) -> None:
        self._tables = [table for (table,) in conn.execute(TABLES)]
        self._statistics = set(conn.execute(STATISTICS))
        self._newest = max(self._one(conn, f"SELECT max(oid::bigint) FROM pg_{catalog}") or 0 for catalog in DROPPED)
        found = self._catalogs(conn, CATALOGS, "3")  # the first transaction
        self._counts = {catalog: rows for catalog, rows, _ in found}
        self._rows = {row for _, _, written in found for row in written or ()}

    def _is_cleaned(self, conn: psycopg.Connection[Any]) -> bool:
        end = time.monotonic() + WAIT_S
        kept = 0 if self._kept is None else self._kept.info.backend_pid
        while conn.execute(END_SESSIONS, {"kept": kept}).rowcount > 0:
            assert time.monotonic() < end, f"sessions of {self._name} do not end"
            time.sleep(0.002)
        if self._one(conn, HAS_LARGE_INDEXES):
            return False
        self._drop_added(conn)
        if not self._is_emptied(conn):
            return False
        if names := self._one(conn, WRITTEN, {"names": list(CATALOGS)}):
            found = self._catalogs(conn, names, self._since)
            left = {row for _, _, written in found for row in written or ()} - self._rows
            if left or any(rows != self._counts[catalog] for catalog, rows, _ in found):
                return False
        if self._one(conn, SHARED) != self._shared:
            return False
        # On other servers autovacuum counts the changes of one test, as in a clone of its own.
        conn.execute("SELECT pg_stat_reset()")
        self._since = self._one(conn, "SELECT pg_current_xact_id()::xid")
        return True

    def _drop_added(self, conn: psycopg.Connection[Any]) -> None:
        added = " UNION ALL ".join(
            f"SELECT i.type, i.identity FROM pg_{catalog} r, pg_identify_object(r.tableoid, r.oid, 0) i "
            f"WHERE r.oid > {self._newest} AND {condition}"
            for catalog, condition in DROPPED.items()
        )
        for kind, identity in conn.execute(added).fetchall():
            conn.execute(f"DROP {kind.replace('-', ' ')} IF EXISTS {identity} CASCADE")

    def _is_emptied(self, conn: psycopg.Connection[Any]) -> bool:
        emptied = set[str]()
        while full := self._full(conn):
            if emptied.issuperset(full):
                return False
            conn.execute("; ".join(f"DELETE FROM {table}" for table in full))
            emptied.update(full)
        conn.execute(RESTART)
        if emptied:  # free the pages, too, so that rows come in the order in which a test inserts them
            conn.execute(f"VACUUM (INDEX_CLEANUP ON, PARALLEL 0) {', '.join(emptied)}")
        # Plans must not depend on earlier tests.
        changed = self._statistics - set(conn.execute(STATISTICS))
        if changed:
            rows = ", ".join(f"({oid}, {pages}, {tuples}::real, {visible})" for oid, pages, tuples, visible in changed)
            conn.execute(FORGET.format(rows=rows))
        return True

    def _full(self, conn: psycopg.Connection[Any]) -> list[str]:
        full = " UNION ALL ".join(f"SELECT '{table}' WHERE EXISTS (SELECT FROM {table})" for table in self._tables)
        return [table for (table,) in conn.execute(full)]

    @staticmethod
    def _catalogs(
        conn: psycopg.Connection[Any], names: Sequence[str], since: str
    ) -> list[tuple[str, int, list[int] | None]]:
        query = " UNION ALL ".join(
            ROWS.format(
                content=f"(to_jsonb(r) - '{PASSING[catalog]}'::text[])::text" if catalog in PASSING else "r::text",
                catalog=catalog,
                condition=PERMANENT.get(catalog, "true"),
            )
            for catalog in names
        )
        return conn.execute(query, {"since": since}, prepare=True).fetchall()

    @staticmethod
    def _one(conn: psycopg.Connection[Any], query: str, values: dict[str, Any] | None = None) -> Any:
        row = conn.execute(query, values).fetchone()
        assert row is not None
        return row[0]


def state_of(conn: psycopg.Connection[Any]) -> list[object]:
    """Return what tests change of a connection."""
    handlers = [len(conn._notice_handlers), len(conn._notify_handlers)]
    factories = [conn.row_factory, conn.cursor_factory, conn.server_cursor_factory, conn.prepare_threshold]
    return [*handlers, *factories, conn.autocommit, conn.isolation_level, conn.read_only, conn.deferrable]
