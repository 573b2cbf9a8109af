"""Forge and damage proofs: each is refused, or what it says is still true by the oracle.

    ./run python tests/acceptance/forged.py --proofs 20000 --seed 1 [--minutes 60]

Small random scenes are certified. One thing of a proof is changed at a time, as a forger would who wants to hide a
conflict or who sends the file over a bad line: an angle, an instant, a place, a step, a line, a verdict, a period, a
slice, an object. Digests are made anew, so that only what the proof says can give it away. Bytes are damaged, too, with
the digests as they were. A proof that is accepted although its objects or verdicts changed is compared with brute
force.
"""

import argparse
import copy
import json
import math
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support")]

import oracle
from layouts import WORKLOADS
from mixed_scenes import plain_scene
from verdicts import Reported, care_of, compare

import conflictdb
from conflictdb.errors import ConflictDBError
from conflictdb.formats import check_proof
from conflictdb.formats.scene_file import read_scene
from conflictdb.model.plans import EarthModel
from conflictdb.model.results import Verdict

Parts = dict[str, list[Any]]
# What makes a proof damaged, as in `check_proof.main`.
DAMAGED: Final = (ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError)
# Ends of periods are proven to ten milliseconds, with a separation to a second.
SHARP_S: Final = 1.1 * check_proof.SHARP_S
SHARP_APART_S: Final = 1.1 * check_proof.SHARP_APART_S
# Changed proofs of one scene.
_AT_ONCE: Final = 500
_TIMES: Final = (-1.0, 1.0, 1e3, -1e3, 1e6, -1e6, 3.6e9)


@dataclass
class Count:
    """Changed proofs by kind and outcome, and those that are accepted though false."""

    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    @property
    def tried(self) -> int:
        return self.outcomes.total()

    def add(self, other: "Count") -> None:
        self.outcomes.update(other.outcomes)
        self.wrong += other.wrong


def outcome(parts: Parts) -> str:
    """Return refused, or accepted, of the parts of a proof."""
    try:
        checker = check_proof.Checker(parts)
        checker.run()
    except (check_proof.Refused, *DAMAGED):
        return "refused"
    return "refused" if checker.unproven else "accepted"


def is_true(parts: Parts) -> list[str]:
    """Return what brute force says against the verdicts on the objects of a proof, which may be read or not."""
    document = {"type": "FeatureCollection", "scene": parts["settings"][0], "features": parts["objects"]}
    try:
        contents = read_scene(json.dumps(document), "forged")
    except ConflictDBError:
        return []
    assert contents.scene is not None
    scene, areas, tracks = contents.scene, contents.areas, contents.tracks
    truth = oracle.meetings(scene, areas, tracks, care_of(scene, areas, tracks))
    sharp_s = SHARP_APART_S if scene.separation_m else SHARP_S
    reported = {}
    for one in parts["verdicts"]:
        # A proof says nothing of other verdicts than where there is no contact.
        verdict = Verdict.CONFLICT if one["verdict"] == "conflict" else Verdict.UNRESOLVED
        pair = (one["a"], one["b"]) if (one["a"], one["b"]) in truth else (one["b"], one["a"])
        wide = round(1e6 * sharp_s)
        ends = [[check_proof._instant(at, None) for at in period] for period in one["periods"]]
        periods = tuple((None if a is None else a - wide, None if b is None else b + wide) for a, b in ends)
        reported[pair] = Reported(verdict, periods, one["time_error_s"] + 3.0 * sharp_s)
    # Pairs nearer than the tolerance are not proven to graze.
    return compare(replace(scene, tolerance_m=0.0), truth, reported).wrong


def forge(seed: int, count: int, folder: Path) -> Count:
    """Change the proof of a random scene `count` times."""
    rng = random.Random(seed)  # noqa: S311 no secret
    workload = WORKLOADS[seed % len(WORKLOADS)]
    more = {"separation_m": 926.0} if seed % 5 == 4 else {}
    scene, areas, tracks = plain_scene(workload, seed, 2, 3, list(EarthModel)[seed % 2], **more)
    conflictdb.certify(tracks, areas, folder / "proof", scene)
    text = (folder / "proof").read_text()
    given = check_proof.read(text.splitlines(keepends=True))
    found = Count()
    assert outcome(copy.deepcopy(given)) == "accepted", (workload.name, seed)
    assert not is_true(given), (workload.name, seed)
    for _ in range(count):
        ((kind, change, _),) = rng.choices(CHANGES, weights=[weight for _, _, weight in CHANGES])
        if kind == "bytes":
            found.outcomes[kind, _damaged(rng, text)] += 1
            continue
        parts = {name: list(lines) for name, lines in given.items()}
        if not change(rng, parts):
            continue
        said = outcome(parts)
        if said == "accepted" and any(parts[name] != given[name] for name in ("settings", "objects", "verdicts")):
            wrong = is_true(parts)
            said = "accepted, and says another thing that is true" if not wrong else "accepted, but false"
            found.wrong += [f"{workload.name} {seed}, {kind}: {one}" for one in wrong]
        found.outcomes[kind, said] += 1
    return found


def _damaged(rng: random.Random, text: str) -> str:
    at = rng.randrange(len(text))
    damaged = text[:at] + rng.choice(("", chr(rng.randrange(32, 127)), text[at] * 2)) + text[at + 1 :]
    if damaged == text:
        return "accepted"
    try:
        parts = check_proof.read(damaged.splitlines(keepends=True))
    except (check_proof.Refused, *DAMAGED):
        return "refused"
    # The first line is in no digest.
    return "accepted" if parts == check_proof.read(text.splitlines(keepends=True)) else "accepted, but false"


def _lines(parts: Parts, *, are_steps: bool) -> list[int]:
    return [k for k, line in enumerate(parts["proofs"]) if line.startswith('["') != are_steps]


def _edited(rng: random.Random, parts: Parts, edit: Callable[[list[Any]], object], *, are_steps: bool) -> bool:
    """Change a line of the proofs; return whether it is another."""
    if not (lines := _lines(parts, are_steps=are_steps)):
        return False
    k = rng.choice(lines)
    values = json.loads(parts["proofs"][k])
    edit(values)
    line = json.dumps(values, separators=(",", ":") if are_steps else None) + "\n"
    is_changed = json.loads(line) != json.loads(parts["proofs"][k])
    parts["proofs"][k] = line
    return is_changed


def _angle(rng: random.Random, parts: Parts) -> bool:
    def edit(values: list[Any]) -> None:
        k = rng.randrange(3, len(values), 2)
        turned = rng.choice((3.14159265, 1.5707963, rng.uniform(-3.2, 3.2), rng.gauss(0.0, 0.01), 1e-7))
        values[k] = rng.choice((None, rng.uniform(-7.0, 7.0))) if values[k] is None else values[k] + turned

    return _edited(rng, parts, edit, are_steps=True)


def _until(rng: random.Random, parts: Parts) -> bool:
    def edit(values: list[Any]) -> None:
        places = range(4, len(values), 2)
        if places and rng.random() < 0.7:
            values[rng.choice(places)] += rng.choice((1e-6, -1e-6, 1e-3, -1.0, rng.gauss(0.0, 1000.0), 1e9))
        elif len(values) > 5:
            del values[3:5]
        else:
            values[3:3] = [rng.uniform(-3.2, 3.2), rng.uniform(0.0, 5000.0)]

    return _edited(rng, parts, edit, are_steps=True)


def _piece(rng: random.Random, parts: Parts) -> bool:
    def edit(values: list[Any]) -> None:
        k = rng.randrange(3)
        values[k] += rng.choice((-1, 1, 2))

    return _edited(rng, parts, edit, are_steps=True)


def _lost(rng: random.Random, parts: Parts) -> bool:
    if not parts["proofs"]:
        return False
    del parts["proofs"][rng.randrange(len(parts["proofs"]))]
    return True


def _contact(rng: random.Random, parts: Parts) -> bool:
    def edit(values: list[Any]) -> None:
        k = rng.randrange(1, len(values))
        values[k] += rng.choice((-1, 1, 0.5)) if k < 4 else rng.choice((1e-9, 1e-6, -1e-3, 1.0, rng.gauss(0.0, 100.0)))
        if rng.random() < 0.2:
            values[0] = "deep" if values[0] == "contact" else "contact"

    return _edited(rng, parts, edit, are_steps=False)


def _hidden(rng: random.Random, parts: Parts) -> bool:
    if not parts["verdicts"]:
        return False
    del parts["verdicts"][rng.randrange(len(parts["verdicts"]))]
    return True


def _verdict(rng: random.Random, parts: Parts) -> bool:
    if not parts["verdicts"]:
        return False
    k = rng.randrange(len(parts["verdicts"]))
    one = parts["verdicts"][k] = copy.deepcopy(parts["verdicts"][k])
    which = rng.randrange(4)
    if which == 0:
        keys = [feature["id"] for feature in parts["objects"]]
        one[rng.choice("ab")] = rng.choice(keys)
    elif which == 1:
        one["verdict"] = rng.choice(("conflict", "grazing", "unresolved"))
    elif len(one["periods"]) > 1 and rng.random() < 0.5:
        del one["periods"][rng.randrange(len(one["periods"]))]
    else:
        period, side = rng.choice(one["periods"]), rng.randrange(2)
        if period[side] is None:
            period[side] = "2026-03-01T06:00:00Z"
        else:
            period[side] = _later(period[side], rng.choice((*_TIMES, rng.gauss(0.0, 6e8))))
    return True


def _later(text: str, by_us: float) -> str:
    at = check_proof.EPOCH + check_proof.timedelta(microseconds=check_proof._instant(text, 0) + round(by_us))
    return f"{at.isoformat(timespec='microseconds')[:-6]}Z"


def _cut(rng: random.Random, parts: Parts) -> bool:
    if not parts["pieces"]:
        return False
    k = rng.randrange(len(parts["pieces"]))
    one = parts["pieces"][k] = copy.deepcopy(parts["pieces"][k])
    if "cuts" in one and rng.random() < 0.7:
        j = rng.randrange(len(one["cuts"]))
        one["cuts"][j] += rng.choice((1, -1, 1_000_000, -60_000_000, 10**12))
    elif "parts" in one:
        part = rng.choice(one["parts"])
        if rng.random() < 0.5:
            part[rng.randrange(len(part))] = rng.randrange(-1, max(map(max, one["parts"])) + 2)
        else:
            one["parts"].remove(part)
    else:
        one["object"] += rng.choice((-1, 1))
    return True


def _times(rng: random.Random, parts: Parts) -> bool:
    """Give an object other times than it has, beside it."""
    k = rng.randrange(len(parts["objects"]))
    is_track = parts["objects"][k]["geometry"]["type"] == "LineString"
    at = rng.choice((0, 1_772_000_000_000_000, 4 * 10**15))
    member = {"departures": [at]} if is_track else {"spans": [[at, at + 1]]}
    parts["pieces"] = [one for one in parts["pieces"] if one["object"] != k]
    parts["pieces"].append({"object": k, **member, **rng.choice(({}, {"later": 10**12}))})
    if rng.random() < 0.5:
        key = parts["objects"][k]["id"]
        parts["verdicts"] = [one for one in parts["verdicts"] if key not in (one["a"], one["b"])]
    return True


def _object(rng: random.Random, parts: Parts) -> bool:
    k = rng.randrange(len(parts["objects"]))
    one = parts["objects"][k] = copy.deepcopy(parts["objects"][k])
    members = one["properties"]
    numbers = [name for name in members if name.endswith("_m") and isinstance(members[name], float)]
    if "times" in members and rng.random() < 0.4:
        j = rng.randrange(len(members["times"]))
        members["times"][j] = _later(members["times"][j], rng.choice(_TIMES))
    elif numbers and rng.random() < 0.3:
        members[rng.choice(numbers)] *= rng.choice((0.5, 1.0 + 1e-9, 2.0))
    else:
        place = rng.choice(list(_places(one["geometry"]["coordinates"])))
        # Rings begin and end alike.
        by = rng.choice((1e-12, -1e-9, 1e-6, 1e-3, 0.1, -0.5))
        before = list(place)
        for other in _places(one["geometry"]["coordinates"]):
            if other[:2] == before[:2]:
                other[rng.randrange(1)] += by
    return True


def _places(coordinates: Any) -> Iterator[Any]:
    if isinstance(coordinates[0], float | int):
        yield coordinates
    else:
        for one in coordinates:
            yield from _places(one)


def _setting(rng: random.Random, parts: Parts) -> bool:
    settings = parts["settings"][0] = dict(parts["settings"][0])
    name = rng.choice(("tolerance_m", "separation_m", "earth", "vertical_separation_m", "intervals"))
    if name == "earth" and settings["motion"] == "rhumb":
        settings[name] = "sphere" if settings[name] == "wgs84" else "wgs84"
    elif name == "intervals":
        settings[name] = "closed" if settings[name] == "half_open" else "half_open"
    elif name.endswith("_m"):
        settings[name] = rng.choice((0.0, 0.5, 10.0, 2.0 * settings[name] + 1.0))
    else:
        return False
    return True


# Those that brute force usually has to judge are rare, as it takes a hundred times as long.
CHANGES: Final[tuple[tuple[str, Callable[[random.Random, Parts], bool], float], ...]] = (
    ("angle", _angle, 1.0),
    ("until", _until, 1.0),
    ("piece", _piece, 1.0),
    ("line lost", _lost, 1.0),
    ("contact", _contact, 1.0),
    ("verdict lost", _hidden, 1.0),
    ("verdict", _verdict, 0.5),
    ("cuts", _cut, 1.0),
    ("times", _times, 0.3),
    ("object", _object, 0.03),
    ("setting", _setting, 0.03),
    ("bytes", lambda *_: True, 1.0),
)


def main() -> int:
    """Forge as many proofs as asked for, and print the outcomes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--proofs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after this time, with fewer")
    args = parser.parse_args()
    total, seed, ends = Count(), args.seed, time.monotonic() + 60.0 * args.minutes
    with tempfile.TemporaryDirectory() as folder:
        while total.tried < args.proofs and time.monotonic() < ends:
            total.add(forge(seed, min(_AT_ONCE, args.proofs - total.tried), Path(folder)))
            seed += 1
            sys.stderr.write(f"\r{total.tried:,} proofs, {len(total.wrong)} false ones accepted")
    for (kind, said), count in sorted(total.outcomes.items()):
        sys.stdout.write(f"{count:9,} {kind}: {said}\n")
    sys.stdout.write("".join(f"{one}\n" for one in total.wrong))
    return 1 if total.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
