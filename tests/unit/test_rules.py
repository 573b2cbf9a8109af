"""Separation rules by class, and owners, in memory: the most specific rule, and the answer of each pair alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb import Area, InvalidInput, Scene, Track, solve
from conflictdb.model.rules import Rule, RuleTable

KINDS = ("area", "track")
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
    """Tracks and areas of five classes and some owners, with heights."""
    tracks, areas = [], []
    for i in range(n):
        ruled = {
            "object_class": (None, *CLASSES, "unnamed")[rng.integers(7)],
            "owner": (None, None, "one", "other")[rng.integers(4)],
        }
        floor_m = float(rng.integers(-3, 4)) * 40.0
        heights = {} if rng.random() < 0.3 else {"floor_m": floor_m, "ceiling_m": floor_m + 30.0}
        x, y = rng.uniform(0.0, width_deg, 2) + (4.0, 56.0)
        start = 1_772_323_200_000_000 + int(rng.integers(0, 7200)) * 1_000_000
        if i % 3 == 0:
            box = shapely.box(x, y, x + rng.uniform(0.005, 0.05), y + rng.uniform(0.005, 0.05))
            span = {} if rng.random() < 0.3 else {"start_us": start, "end_us": start + 1_800_000_000}
            areas.append(Area(f"A{i:04}", shapely.MultiPolygon([box]), **heights, **span, **ruled))
            continue
        end = np.array([x, y]) + rng.uniform(-0.2, 0.2, 2)
        times = [start, start + int(rng.integers(1800, 7200)) * 1_000_000]
        outline = [(50.0, 80.0), (50.0, -80.0), (-50.0, -80.0), (-50.0, 80.0)]
        times_us = np.array(times, "datetime64[us]")
        tracks.append(Track(f"T{i:04}", [(x, y), tuple(end)], times_us, outline, **heights, **ruled))
    return tracks, areas


def settings_of(scene: Scene, one: Area | Track, other: Area | Track) -> Scene | None:
    """The settings of one pair, by reading the rules as the reference says; None: not compared."""
    if one.owner is not None and one.owner == other.owner:
        return None

    def fits(side: str | None, item: Area | Track) -> bool:
        return side in (None, "area" if isinstance(item, Area) else "track", item.object_class)

    best, rank = None, -1
    for rule in scene.rules:
        sides = (rule.a_class, rule.b_class)
        if any(fits(sides[0], x) and fits(sides[1], y) for x, y in ((one, other), (other, one))):
            classes = sum(side is not None and side not in KINDS for side in sides)
            score = 10 * classes + sum(side in KINDS for side in sides)
            if score > rank:
                best, rank = rule, score
    plain = replace(scene, rules=())
    if best is None:
        return plain
    if best.allowed:
        return None
    values = {
        "separation_m": best.separation_m,
        "vertical_separation_m": best.vertical_m,
        "time_separation_s": best.time_s,
    }
    return replace(plain, **{name: value for name, value in values.items() if value is not None})


def check(seed: int, n: int, width_deg: float, **settings: Any) -> tuple[int, int]:
    """Compare `solve` with every pair alone; return the numbers of conflicts and of pairs that rules let through."""
    rng = np.random.default_rng(seed)
    tracks, areas = sea(rng, n, width_deg)
    scene = Scene("rules", **settings, rules=random_rules(rng))
    found = {(one.a_key, one.b_key): one for one in solve(tracks, areas, scene)}
    expected, allowed = {}, 0
    groups: dict[Scene, set[tuple[str, str]]] = {}
    objects: list[Area | Track] = [*areas, *tracks]
    for i, one in enumerate(objects):
        for other in objects[i + 1 :]:
            own = settings_of(scene, one, other)
            if own is None:
                allowed += 1
            else:
                groups.setdefault(own, set()).add((one.key, other.key))
    bare = [replace(one, object_class=None, owner=None) for one in areas]
    bare_tracks = [replace(one, object_class=None, owner=None, max_speed_kn=np.inf) for one in tracks]
    for own, keys in groups.items():
        for one in solve(bare_tracks, bare, own):
            if (one.a_key, one.b_key) in keys:
                expected[one.a_key, one.b_key] = one
    assert found.keys() == expected.keys()
    for key, one in found.items():
        other = expected[key]
        assert one.verdict == other.verdict, key
        # Pieces that are padded for other classes too have other slices, and so other errors.
        error_s = 2e-6 + one.time_error_s + other.time_error_s
        ends, others = (np.array(item.periods, "datetime64[us]").astype(np.float64) / 1e6 for item in (one, other))
        assert np.allclose(ends, others, rtol=0.0, atol=error_s, equal_nan=True), key
        if one.approach is not None or other.approach is not None:
            assert one.closest_m == pytest.approx(other.closest_m, abs=1e-3), key
        assert one.lacking_s == pytest.approx(other.lacking_s, abs=error_s), key
    return len(found), allowed


@pytest.mark.parametrize("seed", range(3))
def test_each_pair_has_the_answer_of_its_own_settings(seed: int) -> None:
    found, allowed = check(seed, 120, 0.6, separation_m=300.0, vertical_separation_m=20.0, nearest_m=1000.0)
    assert found > 100
    assert allowed > 500


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_each_pair_of_a_large_scene_has_the_answer_of_its_own_settings(seed: int) -> None:
    found, _ = check(100 + seed, 2000, 3.0, separation_m=300.0)
    assert found > 2000


def test_rules_apply_on_great_circles() -> None:
    check(7, 60, 0.4, motion="great_circle", separation_m=100.0)


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ([Rule("ferry", None, 5.0), Rule(None, "sub", 6.0)], "apply alike to a pair of area of class 'ferry' and area of"),
        ([Rule("ferry", "area", 5.0), Rule("area", "ferry", 6.0)], "is given twice"),
        ([Rule("ferry", None, 5.0), Rule("track", "area", 6.0)], ""),
        (["ferry"], r"rules\[0\]: must be a Rule"),
    ],
)
def test_ambiguous_rules_are_refused(rules: list[Any], message: str) -> None:
    if not message:
        assert Scene("s", rules=rules).rules == tuple(rules)
        return
    with pytest.raises(InvalidInput, match=message):
        Scene("s", rules=rules)


def test_a_rule_of_both_classes_resolves_a_tie() -> None:
    rules = [Rule("ferry", None, 5.0), Rule(None, "sub", 6.0), Rule("sub", "ferry", 7.0)]
    assert len(Scene("s", rules=rules).rules) == 3


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"a_class": None, "b_class": None}, "a_class: must name a class"),
        ({"a_class": "x", "b_class": "", "separation_m": 1.0}, "b_class: must be a text of 1 to 200 bytes"),
        ({"a_class": "x", "b_class": "y", "separation_m": float("nan")}, "separation_m: must be a finite number"),
        ({"a_class": "x", "b_class": "y", "vertical_m": -1.0}, "vertical_m: must be a finite number"),
        ({"a_class": "x", "b_class": "y", "time_s": 1e9}, "time_s: must be at most"),
        ({"a_class": "x", "b_class": "y", "allowed": True, "separation_m": 5.0}, "separation_m: has no meaning"),
        ({"a_class": "x", "b_class": "y", "allowed": 1}, "allowed: must be true or false"),
        ({"a_class": "x", "b_class": "y", "yields": "x"}, "yields: must be 'a', 'b' or absent"),
        ({"a_class": "x", "b_class": "x", "yields": "a"}, "yields: needs two different sides"),
    ],
)
def test_rules_that_mean_nothing_are_refused(members: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        Rule(**members)
