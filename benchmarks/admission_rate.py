"""How many admissions a second several sessions reach in one scene, and how long each waits.

    ./run python benchmarks/admission_rate.py [--sessions 4] [--flights 1000] [--seconds 10] [--forms volumes tracks]

The scene is the city of `admit.py`, detected once. Each session is a process with a connection of its own, which stays
open as in a pool, and admits random flights one after the other. Times are by the clock, so the machine must be quiet.

`held` does not depend on other work: processor milliseconds of client and backend from the statement that takes the
lock until the commit, of one session alone. Admissions of a scene take turns, so at most 1,000 / held are possible.
"""

import argparse
import os
import statistics
import time
from multiprocessing import get_context
from typing import Any
from unittest.mock import patch

import numpy as np
from admit import flight, spread
from measured import processor_clock

import conflictdb
from conflictdb import Scene
from conflictdb.store.connection import call

SCENE = "benchmark of admissions a second"
WARM_UP = 5


def session(number: int, form: str, seconds: float, barrier: Any, answers: Any) -> None:
    """Admit flights for a time; put the milliseconds of each and the number of admitted flights into a queue."""
    rng = np.random.default_rng(1000 + number)
    with conflictdb.connect() as db:
        city, admitted = db.scene(SCENE), 0
        took: list[float] = []
        for k in range(WARM_UP):
            city.admit(flight(rng, f"warm {number} {k}", form).plans, owner=f"warm {number} {k}")
        barrier.wait()
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            owner = f"{number} {len(took)}"
            plans = flight(rng, owner, form).plans
            began = time.perf_counter()
            admitted += bool(city.admit(plans, owner=owner))
            took.append(1e3 * (time.perf_counter() - began))
    answers.put((took, admitted))


def held_ms(form: str, times: int = 60) -> float:
    """Return the processor milliseconds during which an admission holds the lock, median."""
    rng, held = np.random.default_rng(2), []
    with conflictdb.connect() as db:
        city, clock = db.scene(SCENE), processor_clock(db.connection) or time.process_time
        taken = [0.0]

        def timed(conn: Any, routine: str, *arguments: object) -> Any:
            if routine == "_begin_admission":
                taken[0] = clock()
            return call(conn, routine, *arguments)

        with patch("conflictdb.store.admissions.call", timed):
            for k in range(times):
                city.admit(flight(rng, f"held {k}", form).plans, owner=f"held {k}")
                held.append(1e3 * (clock() - taken[0]))
    return statistics.median(held)


def measure(form: str, sessions: int, flights: int, seconds: float) -> None:
    """Print the rate of one form of flights."""
    rng, processes = np.random.default_rng(1), get_context("spawn")
    with conflictdb.connect() as db:
        city = db.scene(SCENE)
        city.put([one for k in range(flights) for one in flight(rng, f"f{k}", form).plans], Scene(SCENE))
        city.detect()
        barrier, answers = processes.Barrier(sessions), processes.Queue()
        started: list[Any] = [
            processes.Process(target=session, args=(k, form, seconds, barrier, answers)) for k in range(sessions)
        ]
        for one in started:
            one.start()
        found = [answers.get() for _ in started]
        for one in started:
            one.join()
        took = [ms for some, _ in found for ms in some]
        print(
            f"{form}, {sessions} sessions: {len(took) / seconds:.1f} a second, {sum(n for _, n in found)} of "
            f"{len(took)} admitted, {spread(took)}; held {held_ms(form):.1f} ms; load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
        city.delete()


def main() -> None:
    """Measure both forms."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=4)
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--forms", nargs="*", default=["volumes", "tracks"])
    given = parser.parse_args()
    for form in given.forms:
        measure(form, given.sessions, given.flights, given.seconds)


if __name__ == "__main__":
    main()
