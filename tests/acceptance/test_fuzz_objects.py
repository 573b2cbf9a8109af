"""No object in a scene stops it, or is missed silently: a sample, the sweep, and the objects that they found."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzz_objects import Tally, examine, fuzz
from hostile_objects import Hostile

import conflictdb.jobs.detect
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Motion, Scene

NOTHING = np.empty(0, np.int64)
RHUMB = Scene("found")
CIRCLES = Scene("found", motion=Motion.GREAT_CIRCLE, centre=(5.0, 25.0))
NORTH = Scene("found", motion=Motion.GREAT_CIRCLE, centre=(10.0, 60.0), separation_m=1.0, nearest_m=1e4)


def area(name: str, *ring: tuple[float, float], **more: object) -> Hostile:
    return Hostile(name, name, polygons=(((*ring, ring[0]) if ring else (),),), **more)  # type: ignore[arg-type]


# A comb whose teeth are 20 degrees long: over a pole, its region crossed itself by rounding.
TEETH = [(5 + 0.345 * (k // 2), 60.0 if (k // 2 + k) % 2 else 79.999) for k in range(56)]
FOUND = {
    "no triangles": (
        NORTH,
        area(
            "band",
            (-268.1457655166221, 51.66926928528588),
            (-228.14576551662208, 51.66926928528588),
            (-228.14576551662208, 51.66927984942372),
            (-248.14576551662208, 51.66927984942372),
            (-268.1457655166221, 51.66927984942372),
        ),
    ),
    "a comb at the pole": (CIRCLES, area("comb", *TEETH, (14.0, 59.0), (5.0, 59.0))),
    "a ring without points": (RHUMB, area("nothing")),
    "a span after all time": (
        RHUMB,
        area("late", (4.0, 57.0), (5.0, 57.0), (5.0, 58.0), span=(253402300800.0, None)),
    ),
    "a span before all time": (
        RHUMB,
        area("early", (4.0, 57.0), (5.0, 57.0), (5.0, 58.0), span=(None, -62135596800.0)),
    ),
    "a haven wider than the earth": (
        RHUMB,
        Hostile(
            "wide", "wide", path=((0.0, 0.0, 0.0), (1.0, 0.0, 60.0)), outline=((1.0, 1e308), (1.0, -1.0), (-1.0, 0.0))
        ),
    ),
}


@pytest.mark.parametrize("name", list(FOUND))
@pytest.mark.parametrize("by_file", [False, True], ids=["SQL", "file"])
def test_what_was_found_stops_nothing(dsn: str, tmp_path: Path, name: str, by_file: bool) -> None:
    scene, thing = FOUND[name]
    tally = Tally(tmp_path, name)
    examine(dsn, tally, scene, [thing], [by_file])
    assert not tally.wrong


def test_hostile_objects_stop_nothing(dsn: str, tmp_path: Path) -> None:
    tally = fuzz(dsn, 7, 24, tmp_path)
    assert not tally.wrong
    assert sum(tally.verdicts.values()) > 4


@pytest.mark.slow
def test_ten_thousand_hostile_objects_stop_nothing(dsn: str, tmp_path: Path) -> None:
    assert not fuzz(dsn, 20_261, 10_000, tmp_path).wrong


def test_the_fuzzing_finds_a_planted_bug(dsn: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A detection that loses the tracks of a scene, and a detection that fails."""
    pieces_of = conflictdb.jobs.detect.pieces_of

    def without_tracks(setup: Setup, areas: Any, tracks: Any) -> Any:
        return pieces_of(setup, areas, tracks.take(NOTHING))

    monkeypatch.setattr(conflictdb.jobs.detect, "pieces_of", without_tracks)
    assert any("no row with the witness" in one or "known conflict" in one for one in fuzz(dsn, 3, 24, tmp_path).wrong)
    monkeypatch.setattr(conflictdb.jobs.detect, "pieces_of", None)
    assert any("detection failed" in one for one in fuzz(dsn, 3, 4, tmp_path).wrong)
