"""Separation rules by class, and owners, in memory: the most specific rule, and the answer of each pair alone."""

import time
from dataclasses import replace
from datetime import timedelta
from typing import Any

import numpy as np
import pytest
import shapely
from ruled import random_rules, sea, settings_of

from conflictdb import Area, InvalidInput, Scene, Track, solve
from conflictdb.core.separations import Separations
from conflictdb.model.rule_table import RuleTable
from conflictdb.model.rules import Rule


def check(seed: int, n: int, width_deg: float, **settings: Any) -> tuple[int, int]:
    """Compare `solve` with every pair alone; return the numbers of conflicts and of pairs that rules let through."""
    rng = np.random.default_rng(seed)
    tracks, areas = sea(rng, n, width_deg)
    scene = Scene("rules", **settings, rules=random_rules(rng))
    found = {(one.a_key, one.b_key): one for one in solve(tracks, areas, scene)}
    expected, allowed = {}, 0
    groups: dict[Scene, set[tuple[str, str]]] = {}
    objects: list[Area | Track] = [*areas, *tracks]
    known: dict[Any, Scene | None] = {}
    types = [(isinstance(one, Area), one.object_class, one.owner) for one in objects]
    for i, one in enumerate(objects):
        for j, other in enumerate(objects[i + 1 :], i + 1):
            if (types[i], types[j]) not in known:
                known[types[i], types[j]] = settings_of(scene, one, other)
            own = known[types[i], types[j]]
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
        assert len(one.periods) == len(other.periods), key
        for ends in zip(one.periods, other.periods, strict=True):
            for mine, theirs in zip(*ends, strict=True):
                assert mine == theirs or abs(mine - theirs) <= timedelta(seconds=error_s), key
        if one.approach is not None or other.approach is not None:
            assert one.closest_m == pytest.approx(other.closest_m, abs=1e-3), key
        assert one.lacking_s == pytest.approx(other.lacking_s, abs=error_s), key
    return len(found), allowed


@pytest.mark.parametrize("seed", range(3))
def test_each_pair_has_the_answer_of_its_own_settings(seed: int) -> None:
    found, allowed = check(seed, 150, 0.4, separation_m=300.0, vertical_separation_m=20.0, nearest_m=1000.0)
    assert found > 20
    assert allowed > 500


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_each_pair_of_a_large_scene_has_the_answer_of_its_own_settings(seed: int) -> None:
    found, _ = check(100 + seed, 2000, 1.5, separation_m=300.0)
    assert found > 1000


def test_rules_apply_on_great_circles() -> None:
    check(7, 60, 0.4, motion="great_circle", separation_m=100.0)


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        (
            [Rule("ferry", None, 5.0), Rule(None, "sub", 6.0)],
            "apply alike to a pair of area of class 'ferry' and area of",
        ),
        ([Rule("ferry", "area", 5.0), Rule("area", "ferry", 6.0)], "is given twice"),
        ([Rule("ferry", None, 5.0), Rule("track", "area", 6.0)], ""),
        (["ferry"], r"rules\[0\]: must be a Rule"),
    ],
)
def test_ambiguous_rules_are_refused(rules: list[Any], message: str) -> None:
    if not message:
        assert set(Scene("s", rules=rules).rules) == set(rules)
        return
    with pytest.raises(InvalidInput, match=message):
        Scene("s", rules=rules)


def test_rules_of_planners_are_entered() -> None:
    """Rules of submarines and of ferries with areas are both accepted: no track has both classes."""
    rules = [
        Rule("submarine", "submarine", 5000.0),
        Rule("submarine", "area", 1000.0, yields="a"),
        Rule("ferry", "area", 500.0, vertical_m=40.0),
        Rule("area", "area", allowed=True),
    ]
    scene = Scene("s", rules=rules)
    found = Separations.of(scene)
    box = shapely.box(0.0, 0.0, 1.0, 1.0)
    times = np.array(["2026-03-01T06", "2026-03-01T07"], "datetime64[us]")
    ferry, submarine = (
        Track(name, [(0, 0), (1, 0)], times, [(1, 1), (-1, 1), (0, -1)], object_class=name)
        for name in ("ferry", "submarine")
    )
    area = Area("A", box)
    assert found.of_two(area, replace(area, key="B")) is None
    assert [one.separation_m for one in map(found.of_two, (ferry, submarine), (area, area)) if one] == [500.0, 1000.0]
    assert (found.of_two(ferry, submarine) or scene).separation_m == 0.0
    # Areas that have these names satisfy both.
    areas = replace(area, object_class="ferry"), replace(area, key="B", object_class="submarine")
    both = found.of_two(*areas)
    assert both is not None
    assert (both.separation_m, both.vertical_separation_m) == (1000.0, 40.0)
    with pytest.raises(InvalidInput) as refused:
        Scene("s", rules=[Rule("submarine", "track", 5000.0), Rule("ferry", "track", 500.0)])
    assert str(refused.value) == (
        "rule 'ferry' with 'track': and rule 'submarine' with 'track' apply alike to a pair of "
        "track of class 'ferry' and track of class 'submarine': enter a rule for 'ferry' with 'submarine' first"
    )


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


def test_a_band_thinner_than_the_rounding_of_heights_is_not_empty() -> None:
    """Its heights rounded to one number: it met nobody, and the database refused its piece."""
    box = shapely.box(0.0, 0.0, 1.0, 1.0)
    thin, low = Area("THIN", box, floor_m=0.0, ceiling_m=1e-308), Area("LOW", box, floor_m=0.0, ceiling_m=10.0)
    scene = Scene("s", rules=(Rule("high", None, vertical_m=30.0),))
    assert [one.verdict for one in solve([], [thin, low], scene)] == ["conflict"]


def test_a_thousand_rules_take_no_minute() -> None:
    """Each touches its own pairs of classes; when each touched all pairs of types, they took 66 s."""
    rules = [Rule(f"a{i}", f"b{i}", separation_m=float(i)) for i in range(1000)]
    begun = time.process_time()
    table = RuleTable.of(rules)
    assert time.process_time() - begun < 10.0
    assert np.bincount(table.rule.ravel() + 1)[1:].tolist() == [8] * 1000
