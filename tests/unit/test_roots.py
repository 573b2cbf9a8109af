"""Roots of the kernel: the sign on either side is certain, and neither side is nearer to the root than that allows."""

import ctypes
from collections.abc import Callable

import pytest
from kernel_internals import internals

MOST_TOUCHES = 3.0
TOUCH = 1e-3


class Root(ctypes.Structure):
    """Root of roots.h."""

    _fields_ = (("outer", ctypes.c_double), ("inner", ctypes.c_double), ("is_found", ctypes.c_bool))


def root_between(
    measure: Callable[[float], float], outside: float, inside: float, touch: float, pace: float = float("nan")
) -> Root:
    """Where a measure changes its sign, by `root_between` of roots.h."""
    number = ctypes.c_double
    kind = ctypes.CFUNCTYPE(number, ctypes.c_void_p, number)
    function = internals().root_between
    function.argtypes, function.restype = [kind, ctypes.c_void_p, *[number] * 6], Root
    ends = outside, measure(outside), inside, measure(inside)
    return function(kind(lambda _, t: measure(t)), None, *ends, touch, pace)


@pytest.mark.parametrize("power", [1, 3, 7])
@pytest.mark.parametrize(("zero", "way"), [(0.5, 1.0), (0.01, 1.0), (0.99, 1.0), (0.7, -1.0)])
def test_ends_are_beyond_doubt_and_no_further(power: int, zero: float, way: float) -> None:
    """Falling evenly, or hardly at all for most of the way; in either direction of time."""

    def measure(t: float) -> float:
        return way * (zero**power - t**power)

    outside, inside = (0.0, 1.0) if way > 0.0 else (1.0, 0.0)
    touch = 1e-9 if power > 1 else TOUCH
    found = root_between(measure, outside, inside, touch)
    if measure(outside) > touch:
        assert found.is_found
        assert touch < measure(found.outer) < MOST_TOUCHES * touch
        assert touch < -measure(found.inner) < MOST_TOUCHES * touch


def test_an_outer_end_that_is_beyond_doubt_already_stays_where_it_is() -> None:
    """It is not searched again: the measure is evaluated on the inner side alone."""
    asked: list[float] = []

    def measure(t: float) -> float:
        asked.append(t)
        return 1.5 * TOUCH - t

    found = root_between(measure, 0.0, 1.0, TOUCH)
    assert found.is_found
    assert found.outer == 0.0
    assert -MOST_TOUCHES * TOUCH < 1.5 * TOUCH - found.inner < -TOUCH
    assert min(asked[2:]) >= 0.5 * TOUCH


@pytest.mark.parametrize("pace_share", [1.0, 0.9, 1.2, 100.0, 0.0, -1.0, float("inf")])
def test_a_pace_decides_the_work_alone(pace_share: float) -> None:
    """The right one saves steps where a measure has a bottom; with a wrong one it is found all the same."""
    asked = [0, 0]
    for knows in (True, False):

        def measure(t: float, knows: bool = knows) -> float:
            asked[knows] += 1
            return max(1000.0 - 100.0 * t + 0.05 * t * t, -20.0)

        pace = pace_share * -0.01 if knows else float("nan")
        found = root_between(measure, 0.0, 500.0, TOUCH, pace)
        assert found.is_found
        assert TOUCH < measure(found.outer) < MOST_TOUCHES * TOUCH
        assert TOUCH < -measure(found.inner) < MOST_TOUCHES * TOUCH
    if pace_share == 1.0:
        # Two evaluations of each for the ends, two for the assertions.
        assert asked[True] - 4 <= 5 < asked[False] - 4
