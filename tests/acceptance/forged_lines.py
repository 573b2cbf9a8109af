"""Forge a million proofs: re-check only the parts that can change, by the checker's own functions.

    ./run python tests/acceptance/forged_lines.py --proofs 1000000 --seed 1 [--minutes 60]

Scenes with features are certified. A forger changes lines of the proof of one pair: bits, instants, directions, pieces,
steps that are lost, cut off, doubled or of another pair. Often he also hides its conflict, shifts a period, or invents
a conflict and shows it by corners of both objects. The checker reads the lines and checks that pair again. One proof in
a hundred is written with new digests, after any of the changes of `forged.py`, and goes through the whole command.

A proof that is accepted must say what a detection of the same objects says, which brute force confirms elsewhere.
"""

import argparse
import contextlib
import hashlib
import io
import json
import math
import random
import struct
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support")]

import forged
from layouts import WORKLOADS
from mixed_scenes import mixed_scene
from scene_features import Feature

import conflictdb
from conflictdb.errors import ConflictDBError, IncompleteWarning
from conflictdb.formats import check_proof
from conflictdb.formats.scene_file import read_scene
from conflictdb.model.results import Verdict

Values = list[Any]
Pair = tuple[Any, Any]
# A verdict, periods in microseconds, and seconds of error.
Claim = tuple[str, list[tuple[float, float]], float]
FEATURES: Final = (
    *(Feature.UNBOUNDED, Feature.ACTIVATIONS, Feature.SCHEDULE_OF_AREA, Feature.SCHEDULE_OF_TRACK, Feature.DEPARTURES),
    *(Feature.HEIGHTS, Feature.LEG_HEIGHTS, Feature.CLIMBS, Feature.GROWTH, Feature.OUTLINES, Feature.CLASSES),
    *(Feature.ALLOWED, Feature.CLASS_VERTICAL, Feature.OWNERS, Feature.SEPARATION, Feature.VERTICAL_SEPARATION),
    *(Feature.CLOSED, Feature.GREAT_CIRCLE, Feature.SPHERE),
)
_AT_ONCE: Final = 5000
_WHOLE: Final = 0.01
_NOTHING: Final[Claim] = ("none", [], 0.0)
_SHIFTS_US: Final = (1, -1, 20_000, -20_000, 2_000_000, -2_000_000, 60_000_000, -60_000_000, 3_600_000_000)


def is_lie(truth: Claim, claim: Claim, sharp_s: float) -> bool:
    """Return whether a claim on a pair hides a conflict, or invents one."""
    (true_verdict, true_periods, _), (verdict, periods, error_s) = truth, claim
    wide = 1.1e6 * sharp_s
    for start, end in true_periods if true_verdict == "conflict" else ():
        t = start
        for a, b in [*sorted(periods), (math.inf, math.inf)]:
            # Neither the ends of periods nor the last moments of a plan are proven more sharply.
            if min(a - wide, end) - t > wide:
                return True
            t = max(t, b + wide)
    if verdict != "conflict":
        return False
    more = 1e6 * error_s + wide
    ends = [one for a, b in periods for one in ((a - 1, a + more), (b - more, b + 1))]
    return not all(any(start <= high and low <= end for start, end in true_periods) for low, high in ends)


# ---- Changes of a line


def _number(rng: random.Random, x: float) -> float:
    """Return another number: a bit is flipped, or it is shifted."""
    if rng.random() < 0.5:
        (bits,) = struct.unpack("<Q", struct.pack("<d", x))
        (flipped,) = struct.unpack("<d", struct.pack("<Q", bits ^ (1 << rng.randrange(64))))
        return float(flipped)
    return x + rng.choice((1e-9, 1e-6, -1e-3, 0.01, -1.0, math.pi, math.pi / 2, rng.gauss(0.0, 100.0)))


def _bits(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    k = rng.randrange(first, len(values))
    values[k] = rng.uniform(-4.0, 4.0) if values[k] is None else _number(rng, float(values[k]))


def _nothing(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    values[rng.randrange(first, len(values))] = None


def _shorter(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    del values[rng.randrange(first - 1, len(values)) :]


def _lost(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    k = rng.randrange(first, len(values))
    del values[k : k + rng.randrange(1, 3)]


def _twice(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    k = rng.randrange(first, len(values))
    values[k:k] = values[k : k + rng.randrange(1, 3)]


def _of_another(rng: random.Random, values: Values, first: int, other: Values) -> None:
    values[first:] = other[first:]


def _pieces(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    k = rng.randrange(first - 3, first)
    values[k] += rng.choice((-1, 1, 2, 0.5))


def _swapped(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    values[first - 3], values[first - 2] = values[first - 2], values[first - 3]


def _filled(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    angles = [one for one in values[first::2] if one is not None] or [rng.uniform(-math.pi, math.pi)]
    values[first::2] = [rng.choice(angles) if one is None else one for one in values[first::2]]


def _ended(rng: random.Random, values: Values, first: int, _other: Values) -> None:
    values[first:] = [None, rng.choice((0.0, 1e-6, 1.0, 1e9))]


CHANGES: Final = (_bits, _bits, _nothing, _shorter, _lost, _twice, _of_another, _pieces, _swapped, _filled, _ended)


def changed_line(rng: random.Random, line: str, other: str) -> tuple[str, str]:
    """Return the name of a change, and the line with it."""
    if rng.random() < 0.1:
        at = rng.randrange(len(line))
        return "byte", line[:at] + rng.choice(("", chr(rng.randrange(32, 127)), line[at] * 2)) + line[at + 1 :]
    change, values = rng.choice(CHANGES), json.loads(line)
    first = 4 if isinstance(values[0], str) else 3
    change(rng, values, first, json.loads(other))
    return change.__name__[1:].replace("_", " "), json.dumps(values, separators=(",", ":")) + "\n"


class Forger:
    """A proof whose lines are changed; `parts` stay as they are."""

    def __init__(self, rng: random.Random, parts: forged.Parts) -> None:
        self.rng, self.checker = rng, check_proof.Checker(parts)
        self.checker.run()
        assert not self.checker.unproven, self.checker.unproven
        scene = self.checker.scene
        self.keys = [feature["id"] for feature in scene.features]
        self.truth: dict[Any, Claim] = dict(self.checker.reported)
        self.steps, self.contacts = dict(self.checker.steps), dict(self.checker.contacts)
        self.pairs: dict[Pair, list[Any]] = {}
        for p, q, turns in check_proof._meeting(scene):
            self.pairs.setdefault(tuple(sorted((p.of, q.of))), []).append((p, q, turns))
        compared = [pair for pair in self.pairs if not scene.unproven.intersection(pair) and scene.separation(*pair)]
        self.near = [pair for pair in compared if any(self.key(one) in self.steps for one in self.pairs[pair])]
        self.met = [pair for pair in self.near if pair in self.truth]
        self.shown: dict[Pair, list[str]] = {}
        for line in (line for line in parts["proofs"] if line.startswith('["')):
            _, p, q, *_ = json.loads(line)
            pair = tuple(sorted((scene.pieces[p].of, scene.pieces[q].of)))
            self.shown.setdefault(pair, []).append(line)

    @staticmethod
    def key(pieces: Any) -> tuple[int, int, int]:
        p, q, turns = pieces
        return p.number, q.number, turns

    def sharp_s(self, pair: Pair) -> float:
        separation = self.checker.scene.separation(*pair)
        return check_proof.SHARP_APART_S if separation and separation[0] else check_proof.SHARP_S

    def verdict(self, pair: Pair, claim: Claim) -> dict[str, Any]:
        a, b = (self.keys[k] for k in pair)
        periods = [[None if abs(at) == math.inf else int(at) for at in period] for period in claim[1]]
        return {"a": a, "b": b, "verdict": claim[0], "periods": periods, "time_error_s": claim[2]}

    def tried(self) -> tuple[str, str]:
        """Return the kind of a forged proof, and what came of it."""
        rng = self.rng
        if rng.random() < 0.1:
            return self.invented()
        if rng.random() < 0.5:
            return self.with_line(rng.choice(self.near))
        return rng.choice((self.with_contact, self.hidden, self.hidden, self.with_verdict))(rng.choice(self.met))

    def other_line(self) -> str:
        return self.rng.choice(list(self.steps.values()))

    def with_line(self, pair: Pair) -> tuple[str, str]:
        """Change the steps of two pieces."""
        key = self.rng.choice([key for one in self.pairs[pair] if (key := self.key(one)) in self.steps])
        name, line = changed_line(self.rng, self.steps[key], self.other_line())
        left = {other: own for other, own in self.steps.items() if other != key}
        pieces = [one for one in self.pairs[pair] if self.key(one) == key]
        return f"steps: {name}", self.outcome(pair, self.truth.get(pair, _NOTHING), left, [line], pieces)

    def with_contact(self, pair: Pair) -> tuple[str, str]:
        """Change, or lose, a contact of a conflict."""
        lines = list(self.shown.get(pair, ()))
        if not lines:
            return self.hidden(pair)
        k = self.rng.randrange(len(lines))
        name, lines[k] = changed_line(self.rng, lines[k], self.rng.choice(self.rng.choice(list(self.shown.values()))))
        if self.rng.random() < 0.1:
            name = "lost"
            del lines[k]
        return f"contact: {name}", self.outcome(pair, self.truth[pair], self.steps, lines, [])

    def hidden(self, pair: Pair) -> tuple[str, str]:
        """Leave a verdict out, and change the steps of all pieces alike."""
        keys = [key for one in self.pairs[pair] if (key := self.key(one)) in self.steps]
        left, lines, state, other = dict(self.steps), [], self.rng.getstate(), self.other_line()
        for key in keys:
            self.rng.setstate(state)
            name, line = changed_line(self.rng, left.pop(key), other)
            lines.append(line)
        self.rng.random()
        return f"hidden, steps: {name}", self.outcome(pair, _NOTHING, left, lines, self.pairs[pair])

    def with_verdict(self, pair: Pair) -> tuple[str, str]:
        """Change a verdict or its periods; the proofs stay."""
        rng, (verdict, periods, error_s) = self.rng, self.truth[pair]
        k, which = rng.randrange(len(periods)), rng.randrange(5)
        a, b = periods[k]
        if which == 0:
            verdict = rng.choice(("conflict", "grazing", "unresolved", "near"))
        elif which == 1:
            error_s = rng.choice((0.0, -1.0, math.nan, 0.5 * error_s))
        else:
            by = rng.choice((*_SHIFTS_US, round(rng.gauss(0.0, 6e8))))
            a, b = (a + by if which != 3 else a), (b + by if which != 2 else b)
        changed = [*periods[:k], *([(a, b)] if which or rng.random() < 0.5 else []), *periods[k + 1 :]]
        lines = self.shown.get(pair, [])
        name = ("verdict", "error", "start", "end", "period")[which]
        return f"verdict: {name}", self.outcome(pair, (verdict, changed, error_s), self.steps, lines, self.pairs[pair])

    def invented(self) -> tuple[str, str]:
        """Invent a conflict of two objects, shown by corners of theirs, or by places between them."""
        rng, scene = self.rng, self.checker.scene
        p, q, turns = rng.choice(scene.pieces), rng.choice(scene.pieces), 0
        if self.pairs and rng.random() < 0.7:
            p, q, turns = rng.choice(self.pairs[rng.choice(list(self.pairs))])
        start, end = max(p.start, q.start), min(p.end, q.end)
        if start > end:  # a haven is nowhere outside of its leg
            return self.invented()
        is_still = p.is_still and q.is_still
        s = 0.0 if is_still else rng.choice((0.0, 0.5, 1.0, rng.random())) * max(end - start, 0) / 1e6
        zero = 0 if is_still else start
        period = (start, end) if is_still else (round(zero + 1e6 * s),) * 2
        corners = [rng.choice(one.at(zero, s)) for one in (p, q)]
        (x, y), (u, v) = corners
        points = [degrees(scene.plane, at) for at in (*corners, (0.5 * (x + u), 0.5 * (y + v)))]
        pair = tuple(sorted((p.of, q.of)))
        separation = scene.separation(*pair)
        shown = [*points[0], *points[1]] if separation and separation[0] else list(rng.choice(points))
        lines = [[kind, p.number, q.number, turns, s, *rest] for kind, rest in (("contact", shown), ("deep", []))]
        if rng.random() < 0.3:
            lines[1] = ["deep", *lines[0][1:]]
        claim = ("conflict", [period], rng.choice((0.0, 1e-6, 10.0)))
        return "invented", self.outcome(
            pair, claim, self.steps, [f"{json.dumps(one)}\n" for one in lines], self.pairs.get(pair, [])
        )

    def outcome(self, pair: Pair, claim: Claim, steps: Any, lines: Iterable[str], pieces: Iterable[Any]) -> str:
        """Return what the checker says of a pair with a claim, these steps and lines in place of its own."""
        checker, truth = self.checker, self.truth.get(pair, _NOTHING)
        checker.steps, checker.reported = dict(steps), {k: one for k, one in self.truth.items() if k != pair}
        checker.contacts = check_proof.defaultdict(list, {k: one for k, one in self.contacts.items() if k != pair})
        lines = list(lines)
        if claim is truth and not any(line.startswith('["') for line in lines):
            checker.contacts[pair] = list(self.contacts.get(pair, []))
        why = ""
        try:
            if claim is not _NOTHING:
                checker.read_verdict(self.verdict(pair, claim))
            for line in lines:
                checker.read_proof(line)
            for p, q, turns in pieces:
                why = why or checker.lacks_pair(pair, p, q, turns)
            if not why and claim[0] == "conflict" and (claim is not truth or not pieces):
                why = checker.lacks_conflict(pair, *checker.reported[pair][1:])
        except (check_proof.Refused, *forged.DAMAGED):
            return "refused"
        if why:
            return "refused"
        if claim is truth or claim == truth:
            return "accepted, and says the same"
        is_false = is_lie(truth, claim, self.sharp_s(pair))
        return "accepted, but false" if is_false else "accepted, and says another thing that is true"


def degrees(plane: Any, point: tuple[float, float]) -> tuple[float, float]:
    """Return longitude and latitude of a place of the plane."""
    x, y = point
    if isinstance(plane, check_proof._Mercator):
        return math.degrees(x / plane.a), math.degrees(plane.lat_of(y / plane.a))
    x, y = x / check_proof.MEAN_RADIUS_M, y / check_proof.MEAN_RADIUS_M
    a, b, c = (up + x * east + y * north for up, east, north in zip(plane.up, plane.east, plane.north, strict=True))
    return math.degrees(math.atan2(b, a)), math.degrees(math.atan2(c, math.hypot(a, b)))


# ---- Whole proofs


def written(parts: forged.Parts) -> str:
    """Return a proof with digests of what its parts have."""
    lines, digests = ['{"conflictdb_proof": 1}\n'], {}
    for name in check_proof.PARTS:
        own = parts[name] if name == "proofs" else [f"{json.dumps(one)}\n" for one in parts[name]]
        digests[name] = hashlib.sha256("".join(own).encode()).hexdigest()
        lines += [f"{json.dumps({'part': name})}\n", *own]
    return "".join([*lines, f"{json.dumps({'sha256': digests})}\n"])


def claims(verdicts: Iterable[Any]) -> dict[Pair, Claim]:
    """Return what verdicts say, by keys."""
    return {
        tuple(sorted((one["a"], one["b"]))): (
            one["verdict"],
            [(check_proof._instant(a, -math.inf), check_proof._instant(b, math.inf)) for a, b in one["periods"]],
            one["time_error_s"],
        )
        for one in verdicts
    }


def detected(parts: forged.Parts) -> dict[Pair, Claim] | None:
    """Return what a detection says of the objects of a proof; None: it refuses them."""
    document = {"type": "FeatureCollection", "scene": parts["settings"][0], "features": parts["objects"]}
    try:
        contents = read_scene(json.dumps(document), "forged")
        rows = conflictdb.solve(contents.tracks, contents.areas, contents.scene)
    except ConflictDBError:
        return None
    return claims(
        {
            "a": row.a_key,
            "b": row.b_key,
            "verdict": row.verdict.value,
            "time_error_s": row.time_error_s,
            "periods": [[None if at is None else at.isoformat() for at in period] for period in row.periods],
        }
        for row in rows
        if row.verdict is not Verdict.NEAR
    )


def whole(rng: random.Random, given: forged.Parts, text: str, folder: Path) -> tuple[str, str]:
    """Change a proof, write it, and run the checker on the file; return the kind and the outcome."""
    ((kind, change, _),) = rng.choices(forged.CHANGES, weights=[1.0 for _ in forged.CHANGES])
    parts = {name: list(lines) for name, lines in given.items()}
    if kind == "bytes":
        at = rng.randrange(text.index("\n") + 1, len(text))
        new = text[:at] + rng.choice(("", chr(rng.randrange(32, 127)), text[at] * 2)) + text[at + 1 :]
    else:
        change(rng, parts)
        new = written(parts)
    (folder / "forged").write_text(new)
    with contextlib.redirect_stdout(io.StringIO()):
        status = check_proof.main([str(folder / "forged")])
    kind = f"whole file: {kind}"
    if status == 1:
        return kind, "refused"
    changed = {name for name in ("settings", "objects", "verdicts", "pieces") if parts[name] != given[name]}
    if new == text or not changed - {"pieces"}:
        named = {one["object"] for one in parts["pieces"] if one not in given["pieces"]}
        is_schedule = any("schedule" in parts["objects"][k]["properties"] for k in named if k < len(parts["objects"]))
        same = "accepted, and says the same"
        return kind, "accepted, and names a schedule as not checked" if is_schedule else same
    truth = claims(given["verdicts"]) if changed <= {"verdicts", "pieces"} else detected(parts)
    if truth is None:
        return kind, "accepted, with objects or settings that no scene has"
    said, scheduled = claims(parts["verdicts"]), set()
    for one in parts["objects"]:
        scheduled |= {one["id"]} if "schedule" in one["properties"] else set()
    lies = [
        pair
        for pair in {*truth, *said}
        if is_lie(truth.get(pair, _NOTHING), said.get(pair, _NOTHING), check_proof.SHARP_APART_S)
    ]
    if not lies:
        return kind, "accepted, and says another thing that is true"
    is_schedule = all(scheduled.intersection(pair) for pair in lies)
    return kind, "accepted, and names a schedule as not checked" if is_schedule else "accepted, but false"


# ---- Runs


def scenes(seed: int) -> Iterator[tuple[int, Any]]:
    """Yield scenes of some features each, around hubs and in the workloads."""
    while True:
        rng = random.Random(seed)  # noqa: S311 no secret
        features = set(rng.sample(FEATURES, rng.randrange(1, 6))) | {FEATURES[seed % len(FEATURES)]}
        place = rng.choice((None, None, *WORKLOADS))
        with contextlib.suppress(ConflictDBError):
            yield seed, mixed_scene(seed, features, place, 2, 3)
        seed += 1


def forge(seed: int, mixed: Any, count: int, folder: Path) -> tuple[Counter[tuple[str, str]], list[str]]:
    """Return outcomes of `count` forged proofs of a scene, and those that are false and accepted."""
    rng, found, wrong = random.Random(seed), Counter[tuple[str, str]](), list[str]()  # noqa: S311 no secret
    scene, areas, tracks = mixed.content
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        conflictdb.certify(tracks, areas, folder / "proof", scene)
        text = (folder / "proof").read_text()
        given = check_proof.read(text.splitlines(keepends=True))
        forger = Forger(rng, given)
        if not forger.met:
            return found, wrong
        for _ in range(count):
            kind, said = whole(rng, given, text, folder) if rng.random() < _WHOLE else forger.tried()
            found[kind, said] += 1
            wrong += [f"scene {seed}: {kind}"] if said == "accepted, but false" else []
    return found, wrong


def remember() -> None:
    """Let the checker keep what it found of steps and contacts: most are the same in the next proof."""
    check_proof._is_apart = lru_cache(10_000)(check_proof._is_apart)
    contact = lru_cache(10_000)(check_proof.Checker.contact)
    check_proof.Checker.contact = lambda self, *given: contact(self, *given[:-1], tuple(given[-1]))


def main() -> int:
    """Forge as many proofs as asked for, and print the outcomes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--proofs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after this time, with fewer")
    args = parser.parse_args()
    remember()
    total, wrong, seen, ends = Counter[tuple[str, str]](), list[str](), 0, time.monotonic() + 60.0 * args.minutes
    with tempfile.TemporaryDirectory() as folder:
        for seed, mixed in scenes(args.seed):
            if total.total() >= args.proofs or time.monotonic() > ends:
                break
            found, lies = forge(seed, mixed, min(_AT_ONCE, args.proofs - total.total()), Path(folder))
            total, wrong, seen = total + found, wrong + lies, seen + bool(found)
            sys.stderr.write(f"\r{total.total():,} proofs of {seen:,} scenes, {len(wrong)} false ones accepted")
    sys.stdout.write(f"{seen:9,} scenes\n")
    for (kind, said), count in sorted(total.items()):
        sys.stdout.write(f"{count:9,} {kind}: {said}\n")
    sys.stdout.write("".join(f"{one}\n" for one in wrong))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
