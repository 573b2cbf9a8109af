"""Where an area could be instead, in memory: what cannot be looked at is refused by name, and never free."""

import warnings

import pytest
import shapely

import conflictdb
from conflictdb.core.moving_plans import moved
from conflictdb.errors import IncompleteWarning, InvalidInput
from conflictdb.memory.area_places import places
from conflictdb.model.plans import Area, Motion, Scene
from conflictdb.model.units import Units

CENTRED = Scene("ball", motion=Motion.GREAT_CIRCLE, centre=(0.0, 0.0))


def box(key: str, lon: float, lat: float, size: float = 1.0, **more: object) -> Area:
    return Area(key, shapely.box(lon, lat, lon + size, lat + size), **more)  # type: ignore[arg-type]


def test_an_area_outside_the_plane_is_refused() -> None:
    """Its centre is 120 degrees from it: no piece of it can be compared."""
    far = box("FAR", 120.0, 0.0)
    with pytest.raises(InvalidInput, match=r"FAR.*geometry"):
        places([], [far, box("HERE", 0.0, 0.0)], CENTRED, "FAR", 20_000.0)
    with pytest.raises(InvalidInput, match=r"FAR.*geometry"):
        places([], [far, box("HERE", 0.0, 0.0)], CENTRED, "HERE", 20_000.0)


def test_the_plane_is_that_of_all_plans() -> None:
    """A scene without a centre: its middle is that of the area and the others, as in `solve`, not of the others."""
    scene = Scene("ball", motion=Motion.GREAT_CIRCLE)
    other, mine = box("OTHER", 100.0, 0.0), box("MINE", 0.0, 0.0)
    assert not conflictdb.solve([], [mine, other], scene)
    assert {one.distance_m for one in places([], [mine, other], scene, "MINE", 20_000.0)} == {0.0}


def test_an_area_that_is_never_active_is_named() -> None:
    """It meets nothing in the time that is looked at: a warning says so, as `solve` does."""
    idle = box("IDLE", 0.0, 0.0, schedule={"days": ["MON"], "periods": [["06:00", "07:00"]], "until": "2001-01-01"})
    with pytest.warns(IncompleteWarning, match="IDLE"):
        places([], [idle, box("HERE", 0.0, 0.0)], Scene("flat"), "IDLE", 20_000.0)


def test_a_place_that_meets_nothing_has_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        [one] = places([], [box("MINE", 0.0, 0.0), box("NORTH", 0.0, 3.0)], Scene("flat"), "MINE", 20_000.0, [0.0])
    assert (one.distance_m, one.meets) == (0.0, ())


@pytest.mark.parametrize("units", list(Units))
def test_a_shift_is_a_whole_number_of_tenths_that_was_checked(units: Units) -> None:
    """In words it is not rounded: the distance that is said is free, and one step less is not."""
    mine, wall = box("MINE", 0.0, 0.0, 0.1), box("WALL", 0.0, 0.0, 0.05)
    [one] = places([], [mine, wall], Scene("flat"), "MINE", 20_000.0, [0.0], units=units)
    assert one.distance_m is not None
    said = units.exact_distance(one.distance_m)
    assert said.endswith(" nmi" if units is Units.NAUTICAL else " km")
    said_m = float(said.split()[0]) * 10.0 * units.step_m
    for distance_m, is_free in ((said_m, True), (said_m - units.step_m, False)):
        copy = moved(mine, distance_m, 0.0, Scene("flat"))
        assert isinstance(copy, Area)
        assert (not conflictdb.solve([], [copy, wall], Scene("flat"))) == is_free


def test_a_proposal_in_metric_units_moves_an_area_by_tenths_of_a_kilometre() -> None:
    mine, wall = box("MINE", 0.0, 0.0, 0.1), box("WALL", 0.0, 0.0, 0.05)
    found = conflictdb.resolve([], [mine, wall], movable=["MINE"], aside_m=20_000.0, units="metric")
    [move] = found.moves
    assert move.place is not None
    assert move.place.distance_m == pytest.approx(100.0 * round(move.place.distance_m / 100.0), abs=1e-6)
    assert " km on " in move.text(units=Units.METRIC)
    with pytest.raises(InvalidInput, match="nautical, metric"):
        conflictdb.resolve([], [mine], units="miles")
