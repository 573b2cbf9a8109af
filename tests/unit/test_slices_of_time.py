"""Activations of areas, all in one place, are compared in slices of time: the same pairs, at linear cost."""

import pytest
from scenes import T0_US, box, sail

from conflictdb import solve
from conflictdb.core import stage1_broad_phase
from conflictdb.model.plans import Area, Scene

MINUTE_US = 60_000_000


def recurring(key: str, west: float, later_us: int, spans: int) -> Area:
    """An area that is active for a minute of each hour."""
    starts_us = [T0_US + later_us + 60 * MINUTE_US * k for k in range(spans)]
    return box(key, west, -0.1, west + 1.0, 0.1, spans_us=[(start_us, start_us + MINUTE_US) for start_us in starts_us])


@pytest.mark.parametrize("within_s", [0.0, 600.0])
def test_slices_find_the_pairs_of_one_tree(monkeypatch: pytest.MonkeyPatch, within_s: float) -> None:
    areas = [recurring("A", 0.0, 0, 1_200), recurring("B", 0.5, MINUTE_US // 2, 900), recurring("C", 0.2, -1, 700)]
    areas.append(box("always", 0.8, -0.1, 1.5, 0.1))
    tracks = [sail("T", (0.0, 0.0), (1.0, 0.0), (2.0, 0.0)), sail("U", (0.1, 0.0), (0.9, 0.05))]
    scene = Scene("s", time_separation_s=within_s)
    found = []
    for most in (stage1_broad_phase._MOST_ALIVE, 0):
        monkeypatch.setattr(stage1_broad_phase, "_MOST_ALIVE", most)
        found.append([(one.a_key, one.b_key, one.verdict, one.periods) for one in solve(tracks, areas, scene)])
    assert found[0] == found[1]
    assert len(found[0]) > 6


def test_pairs_of_activations_stay_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """One tree finds the square of their number, which took 2.6 GB for an area that is active hourly in a year."""
    pairs = 0
    meeting = stage1_broad_phase._meeting

    def counted(*given):  # type: ignore[no-untyped-def]
        nonlocal pairs
        for a, b in meeting(*given):
            pairs += len(a)
            yield a, b

    monkeypatch.setattr(stage1_broad_phase, "_meeting", counted)
    solve([], [recurring("A", 0.0, 0, 9_000), recurring("B", 0.5, 0, 9_000)], Scene("s"))
    assert 0 < pairs <= 18_000 * 1_000 * 3
