"""Peers that live in an environment of their own: run by benchmarks/peers.py with that environment's Python.

    python peers_elsewhere.py sedona|meos FOLDER TURNS

Reads FOLDER/given.npz, writes FOLDER/NAME.npz: pairs of input rows a, b, and the interval in which they are near
(microseconds; 0 if not reported). Prints a line of JSON: the version, and for each turn seconds and processor seconds.
It imports nothing of conflictdb.
"""

import json
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

# MEOS counts microseconds from 2000-01-01.
MEOS_EPOCH_US = 946_684_800_000_000


def sedona(given: Any) -> tuple[str, Callable[[], Any]]:
    """Return SedonaDB's version, and its join of swept hulls by space and time."""
    import pyarrow as pa
    import sedonadb

    database = sedonadb.connect()
    owner = np.repeat(np.arange(len(given["start_us"])), np.diff(given["hull_offset"]))
    hulls = shapely.polygons(shapely.linearrings(given["hull_xy"], indices=owner))
    columns = {"id": np.arange(len(hulls)), "object": given["object"], "t0": given["start_us"], "t1": given["end_us"]}
    swept = pa.table({**columns, "wkb": shapely.to_wkb(hulls).tolist()})
    database.create_data_frame(swept).to_view("given")
    database.sql("SELECT id, object, t0, t1, ST_GeomFromWKB(wkb) AS hull FROM given").to_memtable().to_view("swept")

    def join() -> Any:
        found = database.sql(
            "SELECT a.id AS a, b.id AS b FROM swept a JOIN swept b ON ST_Intersects(a.hull, b.hull) "
            "WHERE a.object < b.object AND a.t0 < b.t1 AND b.t0 < a.t1"
        ).to_arrow_table()
        a, b = (found[name].to_numpy() for name in "ab")
        return a, b, np.zeros(len(a), np.int64), np.zeros(len(a), np.int64)

    return sedonadb.__version__, join


def meos(given: Any) -> tuple[str, Callable[[], Any]]:
    """Return the version of PyMEOS, and its answer of when circles about the tracks overlap, in the plane."""
    from importlib.metadata import version

    import pymeos_cffi
    from pymeos import pymeos_initialize

    pymeos_initialize("UTC")
    rows = np.flatnonzero(given["moves"])
    start, end = (given[name][rows] for name in ("leg_start_xy", "leg_end_xy"))
    instants = [np.datetime_as_string(given[name][rows].astype("M8[us]")) for name in ("start_us", "end_us")]
    paths = [
        pymeos_cffi.tgeompoint_in(f"[POINT({x0!r} {y0!r})@{t0}, POINT({x1!r} {y1!r})@{t1}]")
        for (x0, y0), (x1, y1), t0, t1 in zip(start.tolist(), end.tolist(), *instants, strict=True)
    ]
    reach = given["reach"][rows]
    low, high = np.minimum(start, end) - reach[:, None], np.maximum(start, end) + reach[:, None]
    boxes = shapely.box(*low.T, *high.T)

    def join() -> Any:
        a, b = shapely.STRtree(boxes).query(boxes)
        a, b = a[a < b], b[a < b]
        found = []
        for i, j in zip(a.tolist(), b.tolist(), strict=True):
            near = pymeos_cffi.tdwithin_tgeo_tgeo(paths[i], paths[j], float(reach[i] + reach[j]), True, True)
            if near:
                first, last = pymeos_cffi.temporal_start_timestamptz(near), pymeos_cffi.temporal_end_timestamptz(near)
                found.append((rows[i], rows[j], first + MEOS_EPOCH_US, last + MEOS_EPOCH_US))
        return np.array(found, np.int64).reshape(-1, 4).T

    return version("pymeos"), join


def main() -> None:
    """Take turns, write the last answer, print their times."""
    warnings.simplefilter("ignore")
    name, folder, turns = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
    given = np.load(folder / "given.npz")
    version, join = {"sedona": sedona, "meos": meos}[name](given)
    seconds, cpu = [], []
    for _ in range(turns):
        began, began_cpu = time.perf_counter(), time.process_time()
        a, b, first_us, last_us = join()
        seconds.append(time.perf_counter() - began)
        cpu.append(time.process_time() - began_cpu)
    np.savez(folder / f"{name}.npz", a=a, b=b, first_us=first_us, last_us=last_us)
    print(json.dumps({"version": version, "seconds": seconds, "cpu": cpu}))


if __name__ == "__main__":
    main()
