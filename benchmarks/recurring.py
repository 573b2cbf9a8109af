"""Compare weekly schedules of areas with the same spans entered by hand: detections of a year, side by side.

    ./.venv/bin/python benchmarks/recurring.py [--areas 10000] [--tracks 2000] [--rounds 3] [--dsn DSN]

The areas of one scene have a schedule, those of the second its spans; in the third each span is an area. Seconds are
those of the processors of client and server (measured.py). Prints a table.
"""

import argparse
import time
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely
from measured import detect, fresh_database, in_fresh_process, load, peak_mb, processor_clock
from tables import markdown

import conflictdb
from conflictdb import Area, Scene, Track, rectangle_outline_m

DAYS: Final = ("MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN")
START: Final = np.datetime64("2027-01-01", "us")
HOUR: Final = np.timedelta64(3_600_000_000, "us")
WEEKS: Final = 52
CORNERS: Final = 12
TABLE_MB: Final = "SELECT pg_total_relation_size('conflictdb.piece') / 1e6"


def areas(count: int, seed: int = 5) -> list[Area]:
    """Return polygons in a sea of constant density, each active for two hours a week."""
    rng = np.random.default_rng(seed)
    side_deg = 6.0 * np.sqrt(count / 10_000)
    angles = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    found = []
    for i in range(count):
        centre = rng.uniform(0.0, side_deg, 2) + np.array([-20.0, 45.0])
        ring = centre + rng.uniform(0.01, 0.05) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        begin = int(rng.integers(0, 22))
        schedule = {
            "days": [DAYS[rng.integers(7)]],
            "periods": [[f"{begin:02}:00", f"{begin + 2:02}:00"]],
            "from": "2027-01-01",
            "until": "2027-12-30",
        }
        found.append(Area(f"A{i:05}", shapely.Polygon(ring), schedule=schedule))
    return found


def tracks(count: int, side_deg: float, seed: int = 6) -> list[Track]:
    """Return ships of some hours, all over the year."""
    rng = np.random.default_rng(seed)
    found = []
    for i in range(count):
        place = rng.uniform(0.0, side_deg, 2) + np.array([-20.0, 45.0])
        start = START + int(rng.integers(0, 8600)) * HOUR
        line = [tuple(place), tuple(place + rng.uniform(-0.6, 0.6, 2))]
        found.append(Track(f"T{i:05}", line, [start, start + 6 * HOUR], rectangle_outline_m(90, 60, 12, 12)))
    return found


def by_hand(scheduled: list[Area]) -> list[Area]:
    """Return areas with the spans of their schedules."""
    from conflictdb.model.recurring_plans import expanded_area

    window = tuple(int((START + days * 24 * HOUR).astype(np.int64)) for days in (-60, 400))
    spans = [expanded_area(area, window).spans_us for area in scheduled]  # type: ignore[arg-type]
    return [replace(area, schedule=None, spans_us=own) for area, own in zip(scheduled, spans, strict=True)]


def one_by_one(spanned: list[Area]) -> list[Area]:
    """Return an area for each span."""
    return [
        replace(area, key=f"{area.key}/{i}", spans_us=None, start_us=start, end_us=end)
        for area in spanned
        for i, (start, end) in enumerate(area.spans_us or ())
    ]


def measured(dsn: str, name: str, count: int, ships: int) -> dict[str, Any]:
    """Detect one scene in this process; return its costs."""
    given = areas(count)
    sailing = tracks(ships, 6.0 * np.sqrt(count / 10_000))
    if name != "schedule":
        given = by_hand(given)
    if name == "areas":
        given = one_by_one(given)
    with conflictdb.connect(dsn) as db:
        conn = db.connection
        [pages] = conn.execute(TABLE_MB).fetchone() or (0,)
        conn.commit()
        clock = processor_clock(conn) or time.process_time
        began, began_mb = clock(), peak_mb()
        load(db, Scene(name, horizon_days=400), [(given, sailing)])
        loaded = clock()
        run = detect(db, name)
        detected = clock()
        again = detect(db, name)
        [after] = conn.execute(TABLE_MB).fetchone() or (0,)
        conn.commit()
    return {
        "scene": name,
        "areas": len(given),
        "conflicts": run.conflicts,
        "load, s": loaded - began,
        "detect, s": detected - loaded,
        "both, s": detected - began,
        "pieces, s": run.pieces_s,
        "again, s": again.cpu_s,
        "before, MB": began_mb,
        "peak, MB": peak_mb(),
        "pieces, MB": float(after - pages),
    }


def main() -> None:
    """Measure, and print the least of some rounds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--areas", type=int, default=10_000)
    parser.add_argument("--tracks", type=int, default=2_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scenes", nargs="+", default=["spans", "schedule", "areas"])
    parser.add_argument("--dsn")
    given = parser.parse_args()
    best: dict[str, dict[str, Any]] = {}
    for _ in range(given.rounds):
        for name in given.scenes:
            with fresh_database(given.dsn) as dsn:
                row = in_fresh_process(measured, dsn, name, given.areas, given.tracks)
            known = best.setdefault(name, row)
            best[name] = {key: min(value, known[key]) if key != "scene" else value for key, value in row.items()}
    rows = [
        [str(cell) if not isinstance(cell, float) else f"{cell:.1f}" for cell in row.values()] for row in best.values()
    ]
    print(markdown(list(next(iter(best.values()))), rows))


if __name__ == "__main__":
    main()
