"""Replay recorded traffic against plans made of it: whether alarms are right, and how many there are.

    ./.venv/bin/python benchmarks/live_replays.py [skagerrak] [switzerland] [switzerland-zones] [--hours 3]

A plan is every twentieth fix of a ship of the Skagerrak hour, or of a flight of the Swiss day, in a corridor, and
earlier by a lateness of its own; positions are all fixes, at their instants. Each step of the recorded time is a look
of a worker.

Two offline runs say what is right. `solve` on all fixes, as points, gives the encounters that happened: both members
have been in the corridors, or off, so an alarm, or the planned conflict, must have named each before, or at the first
look after it. And at some looks `solve` on copies of all plans, each shifted by a random lateness of those that its
positions leave possible, gives the pairs that follow: each must have an alarm, and a pair with `must` must be among
them.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
import psycopg
import swiss_flights
from data import real_input
from measured import fresh_database, load

import conflictdb
from conflictdb import Area, Rule, Scene, Track, rectangle_outline_m, solve
from conflictdb.formats.fixes import Fixes
from conflictdb.jobs.replay import replay
from conflictdb.model.recurring_plans import later
from conflictdb.store import transaction

EVERY = 20
DELAYS_WITHIN_S = 3600.0
# Minutes: most keep their plans.
LATENESSES_MIN = (0, 0, 0, 0, 0, 0, -5, 5, 12, 25)
# Looks between two comparisons with shifted copies.
COMPARED_EVERY = 30
MINUTE_US = 60_000_000
# No plan lasts longer.
SOON_US = 300 * MINUTE_US


@dataclass(frozen=True)
class Recorded:
    """Traffic: all fixes as points, areas, the separation of the scene, and half of the width of a corridor, metres.

    silent_after : how long a track may be without a position
    """

    name: str
    tracks: list[Track]
    areas: list[Area]
    separation_m: float
    corridor_m: float
    silent_after: str = "10 minutes"

    def plans(self) -> list[Track]:
        """Return the plans: every twentieth fix, and the last, earlier by what each is late."""
        rng, side = np.random.default_rng(50), self.corridor_m
        outline = rectangle_outline_m(side, side, side, side)
        plans = []
        for track in self.tracks:
            rows = np.unique([*range(0, len(track.times_us), EVERY), len(track.times_us) - 1])
            plan = Track(
                track.key,
                track.positions_deg[rows],
                track.times_us[rows],
                outline,
                floor_m=track.floor_m,
                ceiling_m=track.ceiling_m,
            )
            plans.append(later(plan, -int(rng.choice(LATENESSES_MIN)) * MINUTE_US))
        return plans

    def first(self, hours: float) -> "Recorded":
        """Return those of its tracks that begin in the first hours."""
        until_us = min(int(one.times_us[0]) for one in self.tracks) + 3.6e9 * hours
        return replace(self, tracks=[one for one in self.tracks if one.times_us[0] < until_us])

    def scene(self, name: str, delays_within_s: float = 0.0) -> Scene:
        """Return its settings: areas are not compared with each other."""
        rules = [Rule("area", "area", allowed=True)]
        return Scene(name, separation_m=self.separation_m, delays_within_s=delays_within_s, regions="off", rules=rules)


@dataclass
class Watch:
    """What the looks said.

    named : by pair, the instants of the first look that named it, microseconds
    alarms : numbers of alarms, by pair; wrong : contradictions; extra : pairs with may that a sample did not meet
    """

    conn: psycopg.Connection[Any]
    recorded: Recorded
    plans: list[Track]
    planned: set[frozenset[str]]
    named: dict[frozenset[str], int] = field(default_factory=dict)
    alarms: dict[frozenset[str], set[int]] = field(default_factory=dict)
    states: Counter[str] = field(default_factory=Counter)
    compared: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    over: dict[str, int] = field(default_factory=dict)
    looks: int = 0

    def look(self, now_us: int, _: int) -> None:
        """Note what is known after a look."""
        with transaction(self.conn):
            rows = self.conn.execute(
                "SELECT key, other_key, verdict, alarm_id, reason FROM conflictdb.live_conflicts"
            ).fetchall()
            over = self.conn.execute("SELECT key FROM conflictdb.live WHERE state = 'past its end'").fetchall()
        verdicts: dict[frozenset[str], str] = {}
        for key, other, verdict, number, _ in rows:
            pair = frozenset((key, other or ""))
            verdicts[pair] = verdict
            self.named.setdefault(pair, now_us)
            self.alarms.setdefault(pair, set()).add(number)
        self.over = {**dict.fromkeys((key for (key,) in over), now_us), **self.over}
        self.looks += 1
        if self.looks % COMPARED_EVERY == 0:
            self._compare(now_us, verdicts)

    def _compare(self, now_us: int, verdicts: dict[frozenset[str], str]) -> None:
        """Compare with copies of plans that are late by what is possible."""
        print(f"look {self.looks:,}: {sum(map(len, self.alarms.values())):,} alarms", file=sys.stderr, flush=True)
        with transaction(self.conn):
            rows = self.conn.execute("SELECT key, state, late_from_s, late_to_s FROM conflictdb.live").fetchall()
        states = {key: (state, low, high) for key, state, low, high in rows}
        self.states.update(state for state, _, _ in states.values())
        rng, copies, unknown = np.random.default_rng(now_us), [], set[str]()
        for plan in self.plans:
            state, low, high = states.get(plan.key, ("on plan", 0.0, 0.0))
            if state in ("on plan", "not yet under way"):
                low = high = 0.0
            if state == "past its end" or low is None or max(abs(low), abs(high)) > DELAYS_WITHIN_S:
                unknown.add(plan.key)
                continue
            late_us = round(1e6 * rng.uniform(low, high))
            # Nothing that is under way meets these.
            if (
                now_us - 30 * MINUTE_US <= plan.times_us[-1] + late_us
                and plan.times_us[0] + late_us <= now_us + SOON_US
            ):
                copies.append(later(plan, late_us))
        really, over = set[frozenset[str]](), set[frozenset[str]]()
        for one in solve(copies, self.recorded.areas, self.recorded.scene("copies")):
            ends = [last for _, last in one.periods]
            is_ahead = any(last is None or last.timestamp() * 1e6 > now_us for last in ends)
            (really if is_ahead else over).add(frozenset((one.a_key, one.b_key)))
        for pair in sorted(really - self.planned, key=sorted):
            self.compared["met"] += 1
            if pair not in verdicts:
                self.compared["missed"] += 1
                self.wrong.append(f"missed {sorted(pair)} at {now_us}")
        for pair, verdict in verdicts.items():
            if pair & unknown or "" in pair:
                continue
            outcome = "met" if pair in really else "it was over" if pair in over else "not met"
            self.compared[f"{verdict}, {outcome}"] += 1
            if verdict != "may" and outcome == "not met":
                self.wrong.append(f"{verdict} {sorted(pair)} at {now_us}")


def skagerrak() -> Recorded:
    """Return the hour of ships: points, half a kilometre apart, in corridors of a mile."""
    found = conflictdb.read(real_input("ais-skagerrak", "ais.csv.gz"), max_speed_kn=60.0)
    return Recorded("Skagerrak", _points(found.tracks), [], 500.0, 926.0)


def switzerland() -> Recorded:
    """Return the day of flights: points, a kilometre from each other and from drone zones, in corridors of 2 km.

    Zones that are always active are left out: at any lateness a flight meets them as planned.
    """
    every = switzerland_zones()
    timed = [one for one in every.areas if one.start_us or one.end_us or one.spans_us or one.schedule]
    return replace(every, name="Switzerland", areas=timed)


def switzerland_zones() -> Recorded:
    """Return the day of flights with all zones."""
    left_out: Counter[str] = Counter()
    tracks, _ = swiss_flights.flights(None, left_out)
    return Recorded(
        "Switzerland, all zones", _points(tracks), swiss_flights.zones(left_out), 1000.0, 1000.0, "1 minute"
    )


def _points(tracks: Iterable[Track]) -> list[Track]:
    point = rectangle_outline_m(0.0, 0.0, 0.0, 0.0)
    return [
        Track(one.key, one.positions_deg, one.times_us, point, floor_m=one.floor_m, ceiling_m=one.ceiling_m)
        for one in tracks
        if len(one.times_us) >= 2
    ]


def replayed(dsn: str, recorded: Recorded) -> str:
    """Replay; return the figures in lines."""
    plans = recorded.plans()
    with conflictdb.connect(dsn) as db:
        name = recorded.name
        db.connection.execute("SELECT set_config('conflictdb.silent_after', %s, false)", [recorded.silent_after])
        db.connection.commit()
        load(db, recorded.scene(name, DELAYS_WITHIN_S), [(recorded.areas, plans)])
        db.scene(name).detect()
        planned = {frozenset((one.a_key, one.b_key)) for one in db.scene(name).conflicts()}
        watch = Watch(db.connection, recorded, plans, planned)
        fixes = {
            one.key: Fixes(
                times_us=one.times_us.tolist(), positions_deg=[(lon, lat) for lon, lat in one.positions_deg.tolist()]
            )
            for one in recorded.tracks
        }
        count = replay(db.connection, name, fixes, speed=1e9, report=watch.look)
    hours = sum(int(one.times_us[-1] - one.times_us[0]) for one in recorded.tracks) / 3.6e9
    pairs = {pair: numbers for pair, numbers in watch.alarms.items() if "" not in pair}
    happened = solve(recorded.tracks, recorded.areas, recorded.scene("all fixes"))
    outcome = Counter(_outcome(watch, one) for one in happened)
    alarms, each = sum(map(len, watch.alarms.values())), [len(numbers) for numbers in pairs.values()] or [0]
    lines = [
        f"{name}: {len(plans):,} plans, {len(recorded.areas):,} areas, {count:,} positions, {watch.looks:,} looks",
        f"planned conflicts {len(planned):,}; states at the looks compared: {dict(watch.states.most_common())}",
        f"alarms {alarms:,} in {hours:,.0f} ship-hours: {alarms / hours:.2f} a ship-hour",
        f"pairs {len(pairs):,}, {np.mean(each):.2f} alarms a pair, at most {max(each)}",
        f"encounters that happened {len(happened):,}: {dict(outcome.most_common())}",
        f"against shifted copies: {dict(watch.compared.most_common())}",
        *(f"wrong: {one}" for one in watch.wrong[:20]),
        *(
            f"late or never: {text}"
            for one in happened
            if "never" in (text := _described(watch, one)) or "after" in text
        ),
    ]
    return "\n  ".join(lines)


def _outcome(watch: Watch, met: conflictdb.Conflict) -> str:
    """Return how an encounter was known before."""
    pair, first = frozenset((met.a_key, met.b_key)), met.first_contact
    at_us = 0 if first is None else round(first.timestamp() * 1e6)
    if pair in watch.named and watch.named[pair] <= at_us:
        return "alarm before"
    if pair in watch.planned:
        return "planned"
    if pair in watch.named:
        return "alarm after"
    if any(watch.named.get(frozenset((key, "")), at_us + 1) <= at_us for key in pair):
        return "by name of a track"
    ends_us = np.inf if met.last_contact is None else met.last_contact.timestamp() * 1e6
    return "plan over" if any(watch.over.get(key, np.inf) <= ends_us for key in pair) else "never named"


def _described(watch: Watch, met: conflictdb.Conflict) -> str:
    """Return how an encounter was known, with its members, and its first and last contact."""
    named = watch.named.get(frozenset((met.a_key, met.b_key)))
    return f"{_outcome(watch, met)} {met.a_key} {met.b_key} {met.first_contact} {met.last_contact} {named}"


def main() -> None:
    """Replay and print."""
    recorded = {"skagerrak": skagerrak, "switzerland": switzerland, "switzerland-zones": switzerland_zones}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*recorded, []], default=[])
    parser.add_argument("--hours", type=float, default=np.inf, help="only tracks that begin in the first hours")
    parser.add_argument("--target", metavar="DSN")
    args = parser.parse_args()
    with fresh_database(args.target) as dsn:
        for name in args.names or recorded:
            print(replayed(dsn, recorded[name]().first(args.hours)), flush=True)


if __name__ == "__main__":
    main()
