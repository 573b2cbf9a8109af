"""Contacts of pieces merged to periods of objects: the ends, and their error bounds; by hand, in seconds."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb import Area, Scene, Track, rectangle_outline_m, solve
from conflictdb.arrays.answers import Contacts
from conflictdb.core import run
from conflictdb.kernel.merging import merged
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US

# Seconds that stand for no beginning and no end.
EVER = (-1e6, 1e6)


@pytest.mark.parametrize(
    ("contacts", "periods", "error_s"),
    [
        # One: its own error, even if it is in doubt altogether, but not more than it is long.
        ([(10, 30, 2)], [(10, 30)], 2.0),
        ([(10, 30, 15)], [(10, 30)], 15.0),
        ([(10, 30, 99)], [(10, 30)], 20.0),
        # Two that touch or overlap are one period; its ends are as good as those of the contacts there.
        ([(10, 30, 1), (30, 40, 3)], [(10, 40)], 3.0),
        ([(10, 40, 1), (20, 30, 3)], [(10, 40)], 1.0),
        ([(10, 30, 1), (31, 40, 3)], [(10, 30), (31, 40)], 3.0),
        # The first contact is in doubt altogether: the period may begin with the second, or end with it.
        ([(10, 20, 9), (14, 40, 1)], [(10, 40)], 5.0),
        ([(10, 30, 1), (25, 37, 9)], [(10, 37)], 8.0),
        ([(10, 20, 9), (20, 30, 9)], [(10, 30)], 20.0),
        # An unbounded end has no error.
        ([(EVER[0], 30, 1), (20, 40, 2)], [(EVER[0], 40)], 2.0),
        ([(10, EVER[1], 1)], [(10, EVER[1])], 1.0),
    ],
)
def test_periods_and_their_errors(
    contacts: list[tuple[float, float, float]], periods: list[tuple[float, float]], error_s: float
) -> None:
    """In a batch with other groups, whose contacts do not matter here."""
    other = [(0, 100, 0)]
    many = [*other, *contacts, *other]
    group = np.repeat([0, 1, 2], [1, len(contacts), 1])
    columns = np.array(many, dtype=np.float64).T
    start, end = ((column * 1e6).astype(np.int64) for column in columns[:2])
    start[columns[0] == EVER[0]], end[columns[1] == EVER[1]] = MINUS_INFINITY_US, INFINITY_US
    instants = {MINUS_INFINITY_US: EVER[0], INFINITY_US: EVER[1]}
    verdict, touches = np.zeros(len(many), np.int8), np.ones(len(many), np.bool_)
    every = np.arange(len(many))
    # Each contact lasts as long as its pieces share their time.
    whole = Contacts(every, 0.0 * every, np.inf + every, columns[2], verdict, touches)
    for order in (every, every[::-1]):
        row = merged(whole.take(order), group[order], 3, (start[order], end[order]))
        assert row.period_offset.tolist() == [0, 1, 1 + len(periods), 2 + len(periods)]
        found = [tuple(instants.get(at, at / 1e6) for at in period) for period in row.period_us[1:-1].tolist()]
        assert found == periods
        assert row.time_error_s.tolist() == [0.0, error_s, 0.0]


@pytest.mark.parametrize(
    "wrong",
    [{"start_s": 500.0, "end_s": 100.0}, {"start_s": 9e6, "end_s": 9.1e6}, {"end_s": np.nan}, {"error_s": np.nan}],
    ids=["inverted", "after the end", "no number", "no error"],
)
def test_a_contact_out_of_order_leaves_its_pair_alone_unresolved(
    monkeypatch: pytest.MonkeyPatch, wrong: dict[str, float]
) -> None:
    """Its pair is open during the whole time that both exist; the other pair keeps its answer."""
    track = Track("t", [(0.0, 0.0), (0.01, 0.0)], [0, 600_000_000], rectangle_outline_m(50, 50, 10, 10))
    first = Area("first", shapely.box(0.002, -0.1, 0.003, 0.1), end_us=400_000_000)
    second = Area("second", shapely.box(0.006, -0.1, 0.007, 0.1))
    scene = Scene("s")
    sound = {row.a_key: row for row in solve([track], [first, second], scene)}
    contacts = run.contacts

    def mistaken(*arguments: Any, **more: Any) -> tuple[Contacts, Any]:
        found, effort = contacts(*arguments, **more)
        columns = {name: getattr(found, name).copy() for name in wrong}
        for name, value in wrong.items():
            columns[name][found.pair == found.pair[0]] = value
        return replace(found, **columns), effort

    monkeypatch.setattr(run, "contacts", mistaken)
    rows = {row.a_key: row for row in solve([track], [first, second], scene)}
    assert rows["second"] == sound["second"]
    [(start, end)] = rows["first"].periods
    assert rows["first"].verdict == "unresolved"
    assert start is not None
    assert end is not None
    assert (start.timestamp(), end.timestamp()) == (0.0, 400.0)
    assert rows["first"].time_error_s == 400.0
