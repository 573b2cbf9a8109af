"""Cost for writers of a table of attaching it: processor time of their session, with and without.

    ./run python benchmarks/attached_writes.py DSN

DSN is a scratch database on this machine (Linux), with the schema conflictdb; a schema `attached_writes` is created and
dropped. Processor time is that of the server's process, so other load does not count. The time of commits, mostly waits
for the disk, is excluded, too: including it, the share is less.
"""

import sys
from typing import Any, Final

import psycopg
from measured import backend_clock
from tables import markdown

ROWS: Final = 20_000
ROUNDS: Final = 6
UPDATES: Final = {
    "1,000 geometries": "UPDATE attached_writes.area SET shape = ST_Translate(shape, 1, 0) WHERE id BETWEEN 1 AND 1000",
    "1,000 numbers, no index": "UPDATE attached_writes.area SET depth = depth + 1 WHERE id BETWEEN 1 AND 1000",
    "1 geometry": "UPDATE attached_writes.area SET shape = ST_Translate(shape, 1, 0) WHERE id = 1",
}
MADE: Final = f"""
DROP SCHEMA IF EXISTS attached_writes CASCADE;
CREATE SCHEMA attached_writes;
CREATE TABLE attached_writes.area (id integer PRIMARY KEY, shape geometry(Polygon, 25832), depth double precision);
INSERT INTO attached_writes.area
SELECT i, ST_Transform(ST_Buffer(ST_Point(8 + mod(i, 100) * 0.01, 57 + i / 100 * 0.01, 4326), 0.002, 4), 25832), 0
FROM generate_series(1, {ROWS}) i;
CREATE INDEX ON attached_writes.area USING gist (shape);
SELECT conflictdb.create_scene('attached_writes');
"""
ATTACH: Final = """
SELECT conflictdb.attach('attached_writes', 'area', 'attached_writes.area', '{"key": "id", "footprint": "shape"}')
"""
DETACH: Final = "SELECT conflictdb.detach('attached_writes', 'attached_writes.area')"


def spent_ms(conn: psycopg.Connection[Any], statement: str, times: int) -> float:
    """Return the processor time of one execution in the server: the lower quartile of some."""
    clock, found = backend_clock(conn), []
    for _ in range(times):
        before = clock()
        conn.execute(statement.encode())
        found.append(1e3 * (clock() - before))
    return sorted(found)[times // 4]


def main(dsn: str) -> None:
    """Measure in turns, and print the best of each."""
    best: dict[tuple[str, bool], float] = {}
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(MADE.encode())
        for _ in range(ROUNDS):
            for is_attached in (False, True):
                if is_attached:
                    conn.execute(ATTACH)
                conn.execute("VACUUM ANALYZE attached_writes.area")
                for name, statement in UPDATES.items():
                    spent_ms(conn, statement, 2)
                    found = spent_ms(conn, statement, 12 if "1,000" in name else 200)
                    best[name, is_attached] = min(best.get((name, is_attached), found), found)
                if is_attached:
                    conn.execute(DETACH)
        conn.execute("DROP SCHEMA attached_writes CASCADE; DELETE FROM conflictdb.scene WHERE name = 'attached_writes'")
    rows = []
    for name in UPDATES:
        alone, attached = best[name, False], best[name, True]
        rows.append([name, f"{alone:.3f}", f"{attached:.3f}", f"{100 * (attached / alone - 1):+.0f} %"])
    print(markdown(["UPDATE of", "alone, ms", "attached, ms", "more"], rows))


if __name__ == "__main__":
    main(sys.argv[1])
