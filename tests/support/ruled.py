"""Random objects of classes and owners, random separation rules, and the settings of a pair, read plainly."""

from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from conflictdb import Area, InvalidInput, Scene, Track
from conflictdb.model.rule_table import RuleTable
from conflictdb.model.rules import Rule

KINDS = ("area", "track")
OWN = {"separation_m": "separation_m", "vertical_m": "vertical_separation_m", "time_s": "time_separation_s"}
CLASSES = ("ferry", "submarine", "drone", "range", "escort")


def random_rules(rng: np.random.Generator) -> list[Rule]:
    """Rules of five classes that no pair finds ambiguous."""
    sides = [None, *KINDS, *CLASSES]
    found: list[Rule] = []
    for a in range(len(sides)):
        for b in range(max(a, 1), len(sides)):
            if rng.random() < 0.3:
                continue
            values: dict[str, Any] = {"allowed": True} if rng.random() < 0.2 else {}
            if not values:
                for name, some in (
                    ("separation_m", [0.0, 500.0, 2000.0, 5000.0]),
                    ("vertical_m", [0.0, 50.0, 120.5]),
                    ("time_s", [0.0, 0.0, 600.0]),
                ):
                    if rng.random() < 0.6:
                        values[name] = float(rng.choice(some))
            rule = Rule(sides[a], sides[b], **values)
            try:
                RuleTable.of([*found, rule])
            except InvalidInput:
                continue
            found.append(rule)
    return found


def sea(rng: np.random.Generator, n: int, width_deg: float) -> tuple[list[Track], list[Area]]:
    """Tracks and areas of five classes and some owners, with heights; some tracks climb, some objects recur."""
    tracks, areas = [], []
    for i in range(n):
        ruled: dict[str, Any] = {
            "object_class": (None, *CLASSES, "unnamed")[rng.integers(7)],
            "owner": (None, None, "one", "other")[rng.integers(4)],
        }
        floor_m = float(rng.integers(-3, 4)) * 40.0
        heights: dict[str, Any] = {} if rng.random() < 0.3 else {"floor_m": floor_m, "ceiling_m": floor_m + 30.0}
        x, y = rng.uniform(0.0, width_deg, 2) + np.array([4.0, 56.0])
        start = 1_772_323_200_000_000 + int(rng.integers(0, 7200)) * 1_000_000
        if i % 3 == 0:
            box = shapely.box(x, y, x + rng.uniform(0.005, 0.05), y + rng.uniform(0.005, 0.05))
            span: dict[str, Any] = {} if rng.random() < 0.3 else {"start_us": start, "end_us": start + 1_800_000_000}
            if span and rng.random() < 0.3:
                span = {"spans_us": [(start + of, start + of + 900_000_000) for of in (0, 3_600_000_000)]}
            areas.append(Area(f"A{i:04}", shapely.MultiPolygon([box]), **heights, **span, **ruled))
            continue
        end = np.array([x, y]) + rng.uniform(-0.2, 0.2, 2)
        times = [start, start + int(rng.integers(1800, 7200)) * 1_000_000]
        outline = [(50.0, 80.0), (50.0, -80.0), (-50.0, -80.0), (-50.0, 80.0)]
        times_us = np.array(times, "datetime64[us]")
        if heights and rng.random() < 0.4:
            heights = {"floors_m": [floor_m, floor_m + 70.0], "ceilings_m": [floor_m + 30.0, floor_m + 100.0]}
        if rng.random() < 0.2:
            ruled["departures_us"] = [np.datetime64(start + of, "us") for of in (0, 10_000_000_000)]
        tracks.append(Track(f"T{i:04}", [(x, y), tuple(end)], times_us, outline, **heights, **ruled))
    return tracks, areas


def settings_of(scene: Scene, one: Area | Track, other: Area | Track) -> Scene | None:
    """The settings of one pair, by reading the rules as the reference says; None: not compared."""
    if one.owner is not None and one.owner == other.owner:
        return None

    def fits(side: str | None, item: Area | Track) -> bool:
        return side in (None, "area" if isinstance(item, Area) else "track", item.object_class)

    best: list[Rule] = []
    rank = 0
    for rule in scene.rules:
        sides = (rule.a_class, rule.b_class)
        if any(fits(sides[0], x) and fits(sides[1], y) for x, y in ((one, other), (other, one))):
            classes = sum(side is not None and side not in KINDS for side in sides)
            score = 10 * classes + sum(side in KINDS for side in sides)
            if score >= rank:
                best = [*best, rule] if score == rank else [rule]
                rank = score
    plain = replace(scene, rules=())
    compared = [own(plain, rule) for rule in best if not rule.allowed]
    if not best:
        return plain
    if not compared:
        return None
    larger = {name: max(getattr(each, name) for each in compared) for name in OWN.values()}
    return replace(plain, **larger)


def own(plain: Scene, rule: Rule) -> Scene:
    values = {setting: getattr(rule, name) for name, setting in OWN.items()}
    return replace(plain, **{name: value for name, value in values.items() if value is not None})
