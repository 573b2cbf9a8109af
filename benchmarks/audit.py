"""Cost of the audit of edits for writers: processor time of their session, with its triggers and without.

    ./run python benchmarks/audit.py DSN [--areas 100000] [--rounds 5]

DSN is a scratch database on this machine (Linux), with the schema conflictdb; the owner of the schema connects. Areas
are loaded into a new scene by INSERT, in statements of 5,000 rows as loads use, then 1,000 are changed, and put singly.
Rounds with and without the triggers alternate; the table has the least of each. Processor time is that of the server's
process, so other load does not count.
"""

import argparse
from typing import Any, Final

import psycopg
from measured import backend_clock
from tables import markdown

AT_ONCE: Final = 5_000
FEW: Final = 1_000
LOAD: Final = """
INSERT INTO conflictdb.area (scene_id, key, footprint, floor_m, ceiling_m)
SELECT s.scene_id, 'area ' || n,
       ST_Multi(ST_Buffer(ST_Point(8 + mod(n, 300) * 0.01, 40 + n / 300 * 0.01, 4326), 0.004, 4)), 0, 100
FROM conflictdb.scene s, generate_series(%(first)s::int, %(last)s) n WHERE s.name = 'audit'
"""
CHANGE: Final = (
    "UPDATE conflictdb.area SET ceiling_m = ceiling_m + 1 WHERE key IN (SELECT 'area ' || generate_series(1, %(few)s))"
)
PUT: Final = """
SELECT conflictdb.put_area('audit', 'put ' || n, ST_Buffer(ST_Point(8 + mod(n, 300) * 0.01, 39, 4326), 0.004, 4))
FROM generate_series(1, %(few)s) n
"""


def switch(conn: psycopg.Connection[Any], state: str) -> None:
    """ENABLE or DISABLE the triggers of the audit."""
    found = conn.execute("SELECT tgrelid::regclass::text, tgname FROM pg_trigger WHERE tgname LIKE 'area_edits_%'")
    for table, name in found.fetchall():
        conn.execute(f"ALTER TABLE {table} {state} TRIGGER {name}".encode())


def one_round(conn: psycopg.Connection[Any], areas: int) -> dict[str, float]:
    """Return the milliseconds of each kind of edit, in a new scene."""
    clock = backend_clock(conn)

    def ms(statement: str, **arguments: int) -> float:
        before = clock()
        conn.execute(statement.encode(), arguments)
        return 1e3 * (clock() - before)

    conn.execute("DELETE FROM conflictdb.scene WHERE name = 'audit'")
    conn.execute("VACUUM conflictdb.area, conflictdb.change, conflictdb.object_key")
    conn.execute("SELECT conflictdb.create_scene('audit')")
    loads = sum(ms(LOAD, first=first, last=min(first + AT_ONCE - 1, areas)) for first in range(1, areas + 1, AT_ONCE))
    return {
        f"load of {areas:,} areas": loads,
        f"change of {FEW:,} areas in one statement": ms(CHANGE, few=FEW),
        f"{FEW:,} calls of put_area": ms(PUT, few=FEW),
    }


def main() -> None:
    """Measure in turns, and print the least of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dsn")
    parser.add_argument("--areas", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    best: dict[tuple[str, bool], float] = {}
    with psycopg.connect(given.dsn, autocommit=True) as conn:
        for number in range(2 * given.rounds):
            is_audited = number % 2 == 1
            switch(conn, "ENABLE" if is_audited else "DISABLE")
            for name, ms in one_round(conn, given.areas).items():
                best[name, is_audited] = min(best.get((name, is_audited), ms), ms)
        conn.execute("DELETE FROM conflictdb.scene WHERE name = 'audit'")
    rows = []
    for name in dict.fromkeys(name for name, _ in best):
        alone, audited = best[name, False], best[name, True]
        rows.append([name, f"{alone:,.0f}", f"{audited:,.0f}", f"{100 * (audited / alone - 1):+.1f} %"])
    print(markdown(["edit", "without, ms", "audited, ms", "more"], rows))


if __name__ == "__main__":
    main()
