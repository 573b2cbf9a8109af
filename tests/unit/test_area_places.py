"""Where an area could be instead, in memory: what cannot be looked at is refused by name, and never free."""

import warnings

import pytest
import shapely

import conflictdb
from conflictdb.errors import IncompleteWarning, InvalidInput
from conflictdb.memory.area_places import places
from conflictdb.model.plans import Area, Scene

CENTRED = Scene("ball", motion="great_circle", centre=(0.0, 0.0))


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
    scene = Scene("ball", motion="great_circle")
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
