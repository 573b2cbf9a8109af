"""Values at the ends of what is valid: texts, numbers, instants; and a layout of objects anywhere."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from layouts import FAR_DAYS, MINUTE_US, Floats, Layout, Span, Voyage
from numpy.typing import NDArray
from scene_features import DAY_US, Feature

from conflictdb.formats.file_objects import AREA_MEMBERS, TRACK_MEMBERS
from conflictdb.model.methods import Method
from conflictdb.model.plans import MAX_INSTANT_US, MIN_INSTANT_US, EarthModel, rectangle_outline_m
from conflictdb.model.rules import KINDS

LONGEST: Final = 12
# Texts that mean something to a file format, SQL, a shell or a page.
TEXTS: Final = (
    "", " ", "0", "null", "true", "nan", "-1", "1e5", "2026-03-01T06:00:00Z", "a,b", 'say "so"', "it's", "<b>&amp;",
    "\\", "%s", "{}", "$1;--", "\n", "\r\n", "\t", " x ", "\x1b[1m", "\x7f", "\u2028", "\ufeff", "\u202eabc", "e\u0301",
    "\U0001f6a2", "\U0010ffff", "\ufffd", "\ue000", "\u6f22\u5b57", "\xdf", "\u0130",
)  # fmt: skip
ALPHABETS: Final = ((32, 127), (1, 0x250), (0x370, 0x3000), (0x3000, 0xD800), (0xE000, 0x10000), (0x10000, 0x110000))


def text(rng: np.random.Generator) -> str:
    """Return a text of at most 12 characters, without NUL and halves of surrogate pairs."""
    if rng.random() < 0.4:
        return TEXTS[int(rng.integers(len(TEXTS)))]
    first, after = ALPHABETS[int(rng.integers(len(ALPHABETS)))]
    return "".join(map(chr, rng.integers(first, after, int(rng.integers(LONGEST + 1))).tolist()))


def key(rng: np.random.Generator, taken: Collection[str] = ()) -> str:
    """Return a text that is not empty and not taken."""
    while not (found := text(rng)) or found in taken:
        pass
    return found


def number(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number between bounds, often one of them, or one next to these or to 0."""
    kind = rng.random()
    if kind < 0.3:
        tiny = [0.0, 5e-324, 1e-6, 1.0, 1.0 / 3.0]
        some = [low, high, np.nextafter(low, high), np.nextafter(high, low), *tiny, *(-one for one in tiny)]
        fits = [one for one in some if low <= one <= high]
        return float(fits[int(rng.integers(len(fits)))])
    if kind < 0.5:
        return float(np.clip(10.0 ** rng.uniform(-9.0, 5.0) * rng.choice([-1.0, 1.0]), low, high))
    return float(rng.uniform(low, high))


def instants(
    rng: np.random.Generator, n: int, first_us: int = MIN_INSTANT_US, last_us: int = MAX_INSTANT_US
) -> list[int]:
    """Return some instants, each later than the one before it, often next to another one, to an end or to 1970."""
    found, at_us = set[int](), 0
    while len(found) < n:
        near = (first_us, last_us, 0, at_us)[int(rng.integers(4))]
        at_us = near + int(rng.integers(-2, 3)) if rng.random() < 0.3 else int(rng.integers(first_us, last_us + 1))
        if first_us <= at_us <= last_us:
            found.add(at_us)
    return sorted(found)


def json_value(rng: np.random.Generator, deep: int = 2) -> Any:
    """Return any value that JSON can express, with integers that float64 resolves."""
    kind = int(rng.integers(7 if deep else 5))
    if kind < 5:
        some = (None, bool(rng.integers(2)), int(rng.integers(-(2**53), 2**53 + 1)), number(rng, -(2.0**53), 2.0**53))
        return (*some, text(rng))[kind]
    values = [json_value(rng, deep - 1) for _ in range(int(rng.integers(4)))]
    return values if kind == 5 else {text(rng): value for value in values}


def word(rng: np.random.Generator) -> str:
    """Return a text that a class or an owner may be."""
    return key(rng, KINDS)


def named(rng: np.random.Generator, without: Collection[str] = ()) -> dict[str, Any]:
    """Return a name and properties, and a class and an owner unless they are given otherwise."""
    names = [text(rng) for _ in range(int(rng.integers(4)))]
    found = {
        "name": None if rng.random() < 0.4 else text(rng),
        "properties": {name: json_value(rng) for name in names if name not in AREA_MEMBERS | TRACK_MEMBERS},
    }
    return found | {one: word(rng) for one in ("object_class", "owner") if one not in without and rng.random() < 0.6}


@dataclass(frozen=True)
class Anywhere:
    """Any valid places and times up to a latitude and within instants: these objects meet seldom.

    north_deg : the greatest latitude of a waypoint, north and south
    """

    north_deg: float = 90.0
    first_us: int = MIN_INSTANT_US
    last_us: int = MAX_INSTANT_US


# In this range the M of a database's path, float64 Unix seconds, resolves microseconds.
STORABLE: Final = Anywhere(60.0, -4_290_000_000_000_000, 4_290_000_000_000_000)


class Scattered(Layout):
    """Objects anywhere: boxes with parts and holes, and tracks of one to four legs."""

    far_us = FAR_DAYS * DAY_US
    grid_us = 1
    scale = 20.0
    lacks = frozenset({Feature.ANTIMERIDIAN, Feature.HIGH_LATITUDE, Feature.FAR, Feature.GREAT_CIRCLE})

    track_fields: Final = {"max_speed_kn": np.inf}
    t0_us = 0

    def __init__(self, anywhere: Anywhere, seed: int, features: Collection[Feature]) -> None:
        self.anywhere, self.rng = anywhere, np.random.default_rng([seed, 43])
        is_timed = {Feature.TIME_SEPARATION, Feature.CLASS_TIME} & set(features)
        self.methods = [Method.EXACT] if is_timed else list(Method)

    def settings(self) -> dict[str, Any]:
        rng = self.rng
        return {
            "name": _stripped(rng),
            "earth": list(EarthModel)[int(rng.integers(2))],
            "method": self.methods[int(rng.integers(len(self.methods)))],
            "tolerance_m": number(rng, 0.0, 1e5),
            "separation_m": number(rng, 0.0, 1e5),
        }

    def counts(self) -> tuple[int, int]:
        some = self.rng.integers(0, 4, 2).tolist()
        return some[0], some[1]

    def instants(self, n: int) -> list[int]:
        return instants(self.rng, n, self.anywhere.first_us, self.anywhere.last_us)

    def footprint(self) -> tuple[shapely.MultiPolygon, int]:
        rng = self.rng
        west, south = number(rng, -180.0, 170.0), number(rng, -80.0, 80.0)
        wide, high = number(rng, 1e-6, 4.0), number(rng, 1e-6, 4.0)
        boxes = [shapely.box(west, south, west + wide, south + high)]
        if rng.random() < 0.5:
            boxes.append(shapely.box(west + 5, south, west + 6, south + 1))
        if rng.random() < 0.5:
            outer = shapely.box(west + 5, south + 5, west + 8, south + 8)
            boxes.append(outer.difference(shapely.box(west + 6, south + 6, west + 7, south + 7)))
        return shapely.MultiPolygon(boxes), 0

    def span(self, at_us: int, is_bounded: bool) -> Span:
        start_us, end_us = self.instants(2)
        if is_bounded:
            start_us = min(start_us, self.anywhere.last_us - 10)  # another period may follow
            return start_us, max(start_us + 1, min(end_us, self.anywhere.last_us - 9))
        ends = [(start_us, end_us), (None, None), (start_us, None), (None, end_us)]
        return ends[int(self.rng.integers(4))]

    def session(self, start_us: int, end_us: int) -> tuple[int, int]:
        start_us = MINUTE_US * int(self.rng.integers(-40_000_000, 60_000_000))  # 1894 to 2084
        return start_us, start_us + MINUTE_US * int(self.rng.integers(1, 1440))

    def legs(self, *, is_last: bool = False) -> int:
        return int(self.rng.integers(1, 5))

    def voyage(self, legs: int, shift_us: int, may_stand: bool) -> Voyage:
        north, rng = self.anywhere.north_deg, self.rng
        lonlat = [(number(rng, -360.0, 360.0), number(rng, -north, north)) for _ in range(legs + 1)]
        return Voyage(np.array(lonlat), np.array(self.instants(legs + 1), np.int64), (1.0, 20.0))

    def haven(self, times_us: NDArray[np.int64]) -> dict[str, Any]:
        kind = int(self.rng.integers(6))
        some = [[[3.0, 4.0]], [[0.0, 1.0], [2.0, 3.0]], [[0.0, 1.0], [1.0, -1.0], [-1.5, 0.1]]]
        if kind < len(some):
            return {"outline_m": np.array(some[kind])}
        sides: Floats = np.array([number(self.rng, 0.0, 1e5) for _ in range(4)])
        return {"outline_m": rectangle_outline_m(*sides)}


def _stripped(rng: np.random.Generator) -> str:
    while not (found := text(rng)).strip():
        pass
    return found
