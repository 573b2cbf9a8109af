"""A mission of a year in one run: partitions come and go, tables get other names and maps, rules change, a worker runs.

    ./run python tests/acceptance/mission_year.py --days 365

Each day is a partition that is created, loaded and, a week later, dropped or detached. After the edits of a day the
scene must become current, its objects must be the rows of the table, and an acknowledgement of the first day must still
hold. History is pruned each month. At the end a full detection must change nothing, and the tables that follow must be
as small as after a month.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

import psycopg
from own_server import own_server

from conflictdb import connect

Conn = psycopg.Connection[Any]

_KEPT_DAYS: Final = 7
_WAIT: Final = "10 minutes"
# Tables that must not grow with time, and how far the end may exceed the size after a month.
BOUNDED: Final = (
    *("change", "attached_change", "attached_object", "attached_relation", "piece", "area", "object_key"),
    *("conflict", "conflict_event", "run"),
)
_SLACK: Final = 2.0
_MONTH: Final = 30
# A day lasts less than a second, so autovacuum must not sleep for a minute between two looks.
_SERVER: Final = {"autovacuum_naptime": "1s"}
_SETUP: Final = """
CREATE SCHEMA mission; CREATE SCHEMA archive;
CREATE TABLE mission.op (id bigint, on_day timestamptz, shape geometry, note text) PARTITION BY RANGE (on_day);
CREATE TABLE mission.zone (id text PRIMARY KEY, shape geometry);
INSERT INTO mission.zone VALUES ('north', ST_MakeEnvelope(0, 0, 1, 1, 4326));
INSERT INTO mission.zone VALUES ('south', ST_MakeEnvelope(0.5, 0, 2, 1, 4326));
SELECT conflictdb.create_scene('year'),
       conflictdb.attach('year', 'area', 'mission.op', '{"key": "id", "footprint": "shape",
                         "span": "tstzrange(on_day, on_day + interval ''1 day'')"}'),
       conflictdb.attach('year', 'area', 'mission.zone', '{"key": "id", "footprint": "shape"}');
"""
_STATE: Final = """
SELECT (SELECT array_agg(a.key ORDER BY a.key) FROM conflictdb.area a WHERE a.key NOT IN ('north', 'south')),
       (SELECT s.is_current FROM conflictdb.scenes s), (SELECT c.acknowledged_for FROM conflictdb.conflicts c
                                                        WHERE c.a_key = 'north' AND c.b_key = 'south'),
       (SELECT count(*) FROM conflictdb.attachments a WHERE a.error IS NOT NULL OR a.remark IS NOT NULL)
"""
_SIZES: Final = """
SELECT c.relname::text, pg_total_relation_size(c.oid) FROM pg_class c
WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind = 'r' ORDER BY 2 DESC
"""


class Year:
    """The mission: its table has a name that changes."""

    def __init__(self, conn: Conn, areas: int) -> None:
        self.conn, self.areas, self.table = conn, areas, "mission.op"

    def _do(self, statement: str) -> None:
        self.conn.execute(statement.encode())

    def begin(self, day: int) -> None:
        """Create the partition of a day and load it: through the table, or at once into the partition."""
        start = f"timestamptz '2026-01-01Z' + {day} * interval '1 day'"
        self._do(
            f"DO $$ BEGIN EXECUTE format('CREATE TABLE mission.op_{day} PARTITION OF {self.table} FOR VALUES FROM (%L) "
            f"TO (%L)', {start}, {start} + interval '1 day'); END $$"
        )
        target = self.table if day % 3 else f"mission.op_{day}"
        count = self.areas * (6 if day % 10 == 5 else 1)
        self._do(
            f"INSERT INTO {target} SELECT {day} * 1000 + i, {start}, ST_MakeEnvelope(8 + 0.1 * i, 57, 8.15 + 0.1 * i, "
            f"57.1, 4326), 'day {day}' FROM generate_series(1, {count}) i"
        )

    def end(self, day: int) -> None:
        """Drop the partition of a day, or detach it."""
        if day >= 0:
            ways = (
                f"DROP TABLE mission.op_{day}",
                f"ALTER TABLE {self.table} DETACH PARTITION mission.op_{day}",
                f"ALTER TABLE {self.table} DETACH PARTITION mission.op_{day} CONCURRENTLY",
            )
            self._do(ways[day % 3])

    def edit(self, day: int) -> None:
        """Edit rows, and on some days the table, its map or the rules."""
        self._do(f"UPDATE {self.table} SET shape = ST_Translate(shape, 0, 0.01) WHERE id % 1000 = 1 + {day} % 5")
        self._do(f"DELETE FROM {self.table} WHERE id = {day} * 1000 + 7")
        for every, at, edit in _EDITS:
            if day % every == at:
                edit(self, day)

    def rename(self, day: int) -> None:
        schema = self.table.partition(".")[0]
        self._do(f"ALTER TABLE {self.table} RENAME TO op_of_{day}")
        self.table = f"{schema}.op_of_{day}"

    def move(self, day: int) -> None:
        schema, _, name = self.table.partition(".")
        other = "archive" if schema == "mission" else "mission"
        self._do(f"ALTER TABLE {self.table} SET SCHEMA {other}")
        self.table = f"{other}.{name}"

    def remap(self, day: int) -> None:
        change = "note" if day % 2 else "'op ' || id"
        self.conn.execute(
            "SELECT conflictdb.reattach('year', %s, jsonb_build_object('name', %s::text))", [self.table, change]
        )

    def change_rules(self, day: int) -> None:
        self._do(f"SELECT conflictdb.put_rule('year', 'area', 'area', {100 + day % 7})")


_EDITS: Final[tuple[tuple[int, int, Callable[[Year, int], None]], ...]] = (
    (30, 10, Year.rename),
    (45, 5, Year.move),
    (25, 12, Year.remap),
    (14, 3, Year.change_rules),
)


@contextmanager
def working(dsn: str) -> Iterator[None]:
    """Run a worker in a process of its own."""
    command = [sys.executable, "-m", "conflictdb", "--dsn", dsn, "worker", "--log", "json"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as worker:
        try:
            yield
        finally:
            worker.terminate()


def settled(conn: Conn, year: Year, day: int) -> None:
    """Wait until the scene is current, and check it."""
    conn.execute("SELECT conflictdb.wait_until_current('year', %s)", [_WAIT])
    keys, is_current, known, broken = conn.execute(_STATE.encode()).fetchone()  # type: ignore[misc]
    rows = conn.execute(
        f'SELECT array_agg(id::text ORDER BY id::text COLLATE "C") FROM {year.table}'.encode()
    ).fetchone()
    assert (is_current, known, broken) == (True, "on purpose", 0), (day, is_current, known, broken)
    assert rows == (keys,), day


def run(
    days: int, areas: int, say: Callable[[str], object] = lambda text: sys.stdout.write(f"{text}\n")
) -> dict[str, tuple[int, int]]:
    """Run the year; return the sizes of tables after a month and at the end, bytes."""
    os.environ.setdefault("XDG_STATE_HOME", f"{tempfile.mkdtemp()}/state")
    sizes: dict[str, list[int]] = {}
    with own_server(**_SERVER) as own, psycopg.connect(own.dsn, autocommit=True) as conn:
        conn.execute(_SETUP.encode())
        with connect(own.dsn) as db:
            db.scene("year").detect()
            db.scene("year").acknowledge("north", "south", reason="on purpose")
        year, started = Year(conn, areas), time.monotonic()
        with working(own.dsn):
            for day in range(days):
                year.begin(day)
                year.end(day - _KEPT_DAYS)
                year.edit(day)
                settled(conn, year, day)
                if day + 1 in (min(_MONTH, days), days):
                    for name, size in conn.execute(_SIZES.encode()).fetchall():
                        sizes.setdefault(name, []).append(size)
                if (day + 1) % _MONTH == 0:
                    conn.execute("SELECT conflictdb.prune_history('year', '0')")
                    say(f"{day + 1} days in {time.monotonic() - started:.0f} s")
        with connect(own.dsn) as db:
            again = db.scene("year").detect(full=True)
            assert (again.opened, again.changed, again.closed) == (0, 0, 0), again
    found = {name: (one[0], one[-1]) for name, one in sizes.items()}
    for name in BOUNDED:
        assert found[name][1] <= _SLACK * found[name][0] + 500_000, (name, found[name])
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--days", type=int, default=365)
    parser.add_argument("--areas", type=int, default=20, help="areas of a day; six times as many every tenth day")
    given = parser.parse_args()
    for name, (month, end) in run(given.days, given.areas).items():
        sys.stdout.write(f"{name:20} {month / 1e6:8.2f} MB after a month {end / 1e6:8.2f} MB at the end\n")


if __name__ == "__main__":
    main()
