"""Plans put in an index meet the plans that `solve` says they meet, after any changes and from several threads."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from city import beyond_limits, within_limits
from layouts import ARCTIC, HARBOUR, HIGH_LATITUDE, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene

from conflictdb import Area, Conflict, Index, InvalidInput, Motion, Scene, Track, solve
from conflictdb.memory import index as index_module

Plan = Area | Track
Owned = dict[str, list[Plan]]


def solved(scene: Scene, owned: Owned, plans: list[Plan], owner: str) -> list[Conflict]:
    """What `solve` of all plans says of some that take the place of their owner's."""
    others = [one for name, of in owned.items() if name != owner for one in of]
    every = [*others, *plans]
    keys = {one.key for one in plans}
    found = solve([p for p in every if isinstance(p, Track)], [p for p in every if isinstance(p, Area)], scene)
    return [one for one in found if (one.a_key in keys) != (one.b_key in keys)]


def pool(workload: Workload, seed: int, **settings: object) -> tuple[Scene, Owned]:
    """A scene, and plans of owners that have one to three each, some with heights."""
    scene, areas, tracks = plain_scene(workload, seed, 14, 14)
    rng, plans = np.random.default_rng(seed), [*areas, *tracks]
    plans = [replace(p, floor_m=100.0, ceiling_m=200.0) if rng.random() < 0.2 else p for p in plans]
    plans = [plans[k] for k in rng.permutation(len(plans))]
    owned: Owned = {}
    while plans:
        owned[f"owner {len(owned)}"] = [plans.pop() for _ in range(min(len(plans), int(rng.integers(1, 4))))]
    return replace(scene, **settings), owned


CASES = [
    (LOW_LATITUDE, {}),
    (HIGH_LATITUDE, {"separation_m": 3000.0}),
    (SEAM, {}),
    (OCEAN, {}),
    (HARBOUR, {"nearest_m": 200.0}),
    (ARCTIC, {"vertical_separation_m": 50.0}),
    (SEAM, {"time_separation_s": 1800.0}),
    (LOW_LATITUDE, {"method": "screen"}),
]


def sequence(workload: Workload, seed: int, settings: dict[str, object], steps: int) -> int:
    """Put, remove and probe at random, and compare with `solve` after every step; return the conflicts compared."""
    scene, owned = pool(workload, seed, **settings)
    index, rng, there, compared = Index(scene), np.random.default_rng(seed), dict[str, list[Plan]](), 0
    names = list(owned)
    for _ in range(steps):
        owner = names[rng.integers(len(names))]
        if rng.random() < 0.6:
            some = owned[owner][: rng.integers(1, len(owned[owner]) + 1)]
            index.put(some, owner=owner)
            there[owner] = some
        else:
            assert index.remove(owner) == (there.pop(owner, None) is not None)
        assert len(index) == sum(map(len, there.values()))
        asked = names[rng.integers(len(names))]
        expected = solved(scene, there, owned[asked], asked)
        assert index.probe(owned[asked], owner=asked) == expected
        compared += len(expected)
    return compared


@pytest.mark.parametrize("case", range(len(CASES)))
def test_an_index_answers_as_solve_does(case: int) -> None:
    """After every step of four sequences, from four threads at once."""
    workload, settings = CASES[case]
    with ThreadPoolExecutor(4) as threads:
        compared = list(threads.map(lambda seed: sequence(workload, seed, settings, 8), range(4)))
    assert sum(compared) > 4


@pytest.mark.slow
@pytest.mark.parametrize("case", range(len(CASES)))
def test_many_sequences_answer_as_solve_does(case: int) -> None:
    workload, settings = CASES[case]
    with ThreadPoolExecutor(4) as threads:
        compared = list(threads.map(lambda seed: sequence(workload, seed, settings, 40), range(100, 200)))
    assert sum(compared) > 1000


def test_threads_share_an_index() -> None:
    """Each changes plans of its own and asks about them; a plan that stays is met by whoever should meet it."""
    scene, owned = pool(LOW_LATITUDE, 7)
    names = list(owned)
    stays = {name: owned[name] for name in names[:3]}
    index = Index(scene)
    for name, plans in stays.items():
        index.put(plans, owner=name)
    asked = [name for name in names[3:] if solved(scene, stays, owned[name], name)]
    assert len(asked) >= 3
    expected = {name: solved(scene, stays, owned[name], name) for name in asked}
    begin = threading.Barrier(4)

    def work(of: int) -> None:
        begin.wait()
        for turn in range(12):
            name = asked[(of + 4 * turn) % len(asked)]
            mine = f"{of}"
            index.put([replace(one, key=f"{of} {one.key}") for one in owned[name]], owner=mine)
            found = [
                one for one in index.probe(owned[name], owner=mine) if not {one.a_key[:2], one.b_key[:2]} & PREFIXES
            ]
            assert found == expected[name]
            if turn % 3 == 0:
                assert index.remove(mine)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(work, range(4)))


PREFIXES = {f"{of} " for of in range(4)}


def square(key: str, lon: float, **fields: float | str) -> Area:
    return Area(key, [(lon, 0.0), (lon + 1.0, 0.0), (lon + 1.0, 1.0), (lon, 1.0)], **fields)  # type: ignore[arg-type]


def test_plans_without_an_owner_are_their_own() -> None:
    index = Index()
    index.put([square("a", 0.0), square("b", 0.5)])
    assert [(one.a_key, one.b_key) for one in index.probe([square("c", 1.2), square("d", 1.4)])] == [
        ("b", "c"),
        ("b", "d"),
        ("c", "d"),
    ]
    assert [one.a_key for one in index.probe(square("b", 0.2))] == ["a"]
    with pytest.raises(InvalidInput, match="plan 'a': key: belongs to a plan of the index: name it in replace"):
        index.put(square("a", 40.0))
    index.put(square("a", 40.0), replace=["a"])
    assert not index.probe(square("b", 0.2))
    assert index.remove("a")
    assert not index.remove("a")
    assert len(index) == 1


def test_a_key_must_be_named_to_be_replaced() -> None:
    """A flight does not take the place of a fence by its key, nor by an owner of that name."""
    index = Index()
    index.put([square("fence", 0.0), square("stated", 10.0, owner="them")])
    index.put(square("owned", 20.0), owner="x")
    for plan, owner, named, rule in (
        (square("fence", 40.0), None, (), "belongs to a plan of the index"),
        (square("fence", 40.0), "fence", ("owned",), "belongs to a plan of the index"),
        (square("owned", 40.0), None, ("owned",), "belongs to owner 'x'"),
        (square("owned", 40.0), "y", ("owned",), "belongs to owner 'x'"),
        (square("stated", 40.0), "y", ("stated",), "belongs to owner 'them'; got owner 'y'"),
        (square("stated", 40.0), None, ("stated",), "belongs to owner 'them'; got owner None"),
        (square("stated", 40.0, owner="them"), None, (), "belongs to a plan of the index"),
    ):
        with pytest.raises(InvalidInput, match=rule):
            index.put(plan, owner, replace=named)
    with pytest.raises(InvalidInput, match="put: replace: must be a sequence of keys"):
        index.put(square("fence", 40.0), replace="fence")
    index.put(square("other", 30.0), owner="fence")
    assert len(index) == 4
    assert [one.a_key for one in index.probe(square("z", 0.5), owner="fence")] == ["fence"]
    index.put(square("fence", 40.0), owner="mine", replace=["fence"])
    assert not index.probe(square("z", 0.5))
    index.put(square("owned", 50.0), owner="x")
    index.put(square("stated", 60.0, owner="them"), replace=["stated"])
    assert len(index) == 4
    assert index.remove("mine")
    assert len(index) == 3


def test_many_changes_leave_little() -> None:
    """Plans that are gone do not stay in memory."""
    index = Index()
    for turn in range(200):
        index.put([square(f"{k}", 2.0 * k) for k in range(8)], owner=f"{turn % 2}") if turn % 2 == 0 else None
        index.remove("0")
    assert sum(len(level.put.plans) for level in index._state.levels) == 0


def test_plans_are_put_as_they_are_then() -> None:
    """Not as they were when this thread probed them."""
    index = Index()
    times = [np.datetime64("2030-01-01T00:00"), np.datetime64("2030-01-01T01:00")]
    plan = Track("moved", [(0.0, 0.5), (0.5, 0.5)], times, [(0.0, 0.0)])
    assert not index.probe([plan, square("a", 10.0)], owner="me")
    plan.positions_deg[:, 0] += 40.0
    index.put([plan, square("a", 20.0)], owner="me")
    for lon, met in ((-0.1, []), (9.9, []), (19.9, [{"a"}]), (39.9, [{"moved"}])):
        assert [{one.a_key, one.b_key} - {"z"} for one in index.probe(square("z", lon))] == met
    # The same plans, of which the earlier ones have changed meanwhile.
    again = replace(plan, key="again")
    assert not index.probe(again, owner="me")
    twin = replace(again, positions_deg=again.positions_deg.copy())
    again.positions_deg[:, 0] += 100.0
    index.put(twin, owner="me")
    assert [{one.a_key, one.b_key} - {"z"} for one in index.probe(square("z", 39.9))] == [{"again"}]


def test_tolerances_that_changed_since_a_probe_count() -> None:
    """Their lists can be changed in place."""
    times = [np.datetime64(f"2030-01-01T0{hour}:00") for hour in range(3)]
    legs = [(0.0, -0.1), (0.5, -0.1), (1.0, -0.1)]
    track = Track("track", legs, times, [(0.0, 0.0)], tolerances={"xtd_port_m": [10.0, 10.0]})
    index = Index()
    index.put(square("area", 0.0))
    assert not index.probe(track)
    assert track.tolerances is not None
    track.tolerances["xtd_port_m"][:] = [15_000.0, 15_000.0]
    assert [one.a_key for one in index.probe(track)] == ["area"]


def test_great_circles_get_a_centre_from_the_first_plans() -> None:
    index = Index(Scene("far", motion=Motion.GREAT_CIRCLE))
    assert not index.probe(square("a", 0.0))
    assert index.scene.centre is None
    index.put(square("a", 0.0))
    assert index.scene.centre == (0.399991, 0.400012)
    with pytest.raises(InvalidInput, match="beyond 60 degrees"):
        index.put(square("b", 100.0))
    assert len(index) == 1


def test_what_cannot_be_put_changes_nothing() -> None:
    index = Index()
    index.put(square("a", 0.0), owner="one")
    for plans, owner, rule in (
        ([square("b", 0.0), square("b", 1.0)], "two", "more than once"),
        ([square("c", 0.0), square("a", 1.0)], "two", "belongs to owner 'one'"),
        ([square("a", 1.0)], None, "belongs to owner 'one'"),
        ([], None, "got none"),
        ("a", None, "must be an Area or a Track"),
    ):
        with pytest.raises(InvalidInput, match=rule):
            index.put(plans, owner=owner)  # type: ignore[arg-type]
        assert len(index) == 1
        assert [one.a_key for one in index.probe(square("z", 0.5))] == ["a"]
    for owner in ("", 5, True, b"one", ["one"], "x" * 201):
        for ask in (index.put, index.probe):
            with pytest.raises(InvalidInput, match="owner: must be a text of 1 to 200 bytes"):
                ask(square("b", 0.0), owner=owner)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="remove: owner: must be a text"):
        index.remove(["one"])  # type: ignore[arg-type]
    assert len(index) == 1
    with pytest.raises(InvalidInput, match="must be a Scene"):
        Index("scene")  # type: ignore[arg-type]


def test_a_conflict_of_an_index_can_be_drawn() -> None:
    index = Index()
    index.put(square("a", 0.0))
    [conflict] = index.probe(square("b", 0.5))
    assert conflict.plot().axes


def test_limits_refuse_plans() -> None:
    index = Index(max_days_ahead=30, max_vertices=10_000)
    for plan, rule in beyond_limits():
        for ask in (index.put, index.probe):
            with pytest.raises(InvalidInput, match=rule):
                ask(plan)
    index.put(within_limits("a"))
    assert len(index) == 1
    for given in ({"max_days_ahead": -1.0}, {"max_days_ahead": float("nan")}, {"max_vertices": 0.5}):
        with pytest.raises(InvalidInput, match="must be a"):
            Index(**given)  # type: ignore[arg-type]


def test_plans_put_one_by_one_are_cut_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer is that of plans put at once, also if some are replaced, removed or changed in place meanwhile."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 3, 600, 20)
    index, wanted = Index(scene), Index(scene)
    wanted.put([*areas[10:], *tracks])
    probe = [replace(one, key=f"probe {one.key}") for one in tracks]
    cuts: list[int] = []
    original = index_module.Members.of_plans

    def counted(world: object, plans: list[Plan], **options: object) -> object:
        cuts.append(len(plans))
        return original(world, plans, **options)

    monkeypatch.setattr(index_module.Members, "of_plans", counted)
    for one in [*areas, *tracks, areas[20]]:
        changed = replace(one, positions_deg=one.positions_deg.copy()) if isinstance(one, Track) else one
        index.put(changed, replace=[one.key])
        if isinstance(changed, Track):
            changed.positions_deg[:] = 0.0
    for one in areas[:10]:
        assert index.remove(one.key)
    found = index.probe(probe, owner="probe")
    assert len(cuts) <= 2 + sum(cuts) // index_module._WAITING
    assert found == wanted.probe(probe, owner="probe")
    assert found
    with pytest.raises(InvalidInput):
        index.put(replace(areas[0], footprint=[(0.0, 89.2), (1.0, 89.2), (1.0, 89.4)]))


def test_a_plan_that_is_put_often_waits_once() -> None:
    """Plans that are replaced or removed before they are cut leave nothing: the work of a put does not grow."""
    index = Index()
    for turn in range(50):
        index.put(square("mine", turn / 10.0), replace=["mine"])
    assert len(index._waiting) == 1
    assert index.remove("mine")
    assert not index._waiting
    assert not index.probe(square("z", 0.0))
