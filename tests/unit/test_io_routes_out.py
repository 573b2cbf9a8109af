"""Tracks written as routes: GPX reads back as the same ways and times, and files of RTZ have sound names."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from conflictdb.errors import InvalidInput
from conflictdb.formats.gpx_writing import gpx_lines, has_more
from conflictdb.formats.objects_writing import object_lines
from conflictdb.formats.reading import read
from conflictdb.formats.rtz_writing import file_names
from conflictdb.model.plans import Scene, Track, rectangle_outline_m

POINT = rectangle_outline_m(0.0, 0.0, 0.0, 0.0)
START_US = 1_796_104_800_000_000  # 2026-12-01T06:00Z


def track(key: str, *, departures: list[int] | None = None, lon: float = 9.1) -> Track:
    times = START_US + np.array([0, 3_600_000_001, 7_200_000_000], np.int64)
    places = [(lon, 57.123456789), (lon + 0.3, 57.2), (lon + 0.3, 57.5)]
    more = {} if departures is None else {"departures_us": np.array(departures, np.int64)}
    return Track(key, places, times, POINT, name="A & B <ferry>", max_speed_kn=np.inf, **more)


def read_back(path: Path, tracks: list[Track]) -> list[Track]:
    path.write_text("".join(object_lines(path, Scene("s"), [], tracks)))
    return list(read(path).tracks)


def test_routes_of_gpx_are_read_back_as_the_same_ways_and_times(tmp_path: Path) -> None:
    """Across the date line, too, and one for each voyage."""
    day_us = 86_400_000_000
    given = [track("A"), track("ü/..", lon=179.9), track("R", departures=[START_US, START_US + day_us])]
    found = read_back(tmp_path / "a.gpx", given)
    expected = [given[0], given[1], given[2], given[2]]
    later = [0, 0, 0, day_us]
    assert len(found) == 4
    for one, other, by_us in zip(found, expected, later, strict=True):
        assert (one.times_us == other.times_us + by_us).all()
        assert np.unwrap(one.positions_deg, period=360.0, axis=0) == pytest.approx(other.positions_deg, abs=1e-12)


def test_a_key_that_xml_cannot_hold_is_refused() -> None:
    with pytest.raises(InvalidInput, match="a character that XML cannot hold"):
        list(gpx_lines(Scene("s"), [], [track("a\x01b")]))


def test_names_of_files_are_sound_and_each_is_there_once() -> None:
    keys = ["a", "A", "a/b", "a\\b", "..", "", "x" * 500, "CON:", " lead", "trail.", "nul", "Com1.x"]
    names = file_names([track(key or "e") for key in keys])
    assert len({name.casefold() for name in names}) == len(keys)
    assert all(name.endswith(".rtz") and len(name) < 80 for name in names)
    # Names of devices on Windows, with any ending.
    assert not {name.casefold().partition(".")[0] for name in names} & {"con", "nul", "com1"}
    assert not any(set(name) & set('/\\:*?"<>|\0') or name.startswith((".", " ")) for name in names)


def test_a_way_of_a_point_has_no_more_than_gpx_unless_it_grows() -> None:
    given = track("A")
    assert not has_more(given)
    for more in ({"grow_mps": 0.5}, {"outline_m": [[1.0, 0.0]]}, {"ceiling_m": 5.0}, {"floors_m": [1.0, 2.0]}):
        assert has_more(replace(given, max_speed_kn=np.inf, **more)), more
