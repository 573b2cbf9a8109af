"""Rhumb lines along shortest lines, against PROJ's geodesics."""

import numpy as np
import pyproj
import pytest

from conflictdb.earth.shortest_lines import DEVIATION_M, NoShortestLineError, followed

GEOD = pyproj.Geod(ellps="WGS84")


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((0.0, 50.0), (3.0, 50.0)),
        ((-40.0, 52.0), (170.0, -33.0)),
        ((170.0, 60.0), (-170.0, 62.0)),
        ((4.0, 57.0), (4.0, -57.0)),
        ((10.0, 84.9), (60.0, 84.0)),
        ((0.0, 0.0), (90.0, 0.0)),
        ((20.0, 10.0), (20.0001, 10.0001)),
    ],
)
def test_rhumb_lines_follow_the_shortest_line(start: tuple[float, float], end: tuple[float, float]) -> None:
    """Vertices are on the geodesic, and middles of rhumb lines within the stated deviation of it."""
    line, at = followed(np.array([start, end]))
    assert at.tolist() == [0, len(line) - 1]
    azimuth, _, length_m = GEOD.inv(*start, *end)
    for lon, lat in line[1:]:
        there, _, away_m = GEOD.inv(*start, lon, lat)
        assert abs(away_m * np.sin(np.radians(there - azimuth))) < 1e-3
    assert line[-1, 0] % 360.0 == pytest.approx(end[0] % 360.0)
    assert np.abs(np.diff(line[:, 0])).max() < 180.0
    # The middle of each rhumb line, from the mercator plane of a sphere: good to far below the deviation.
    psi = np.arcsinh(np.tan(np.radians(line[:, 1])))
    middle_lat = np.degrees(np.arctan(np.sinh(0.5 * (psi[1:] + psi[:-1]))))
    middle_lon = 0.5 * (line[1:, 0] + line[:-1, 0])
    for k in range(0, len(middle_lon), max(1, len(middle_lon) // 50)):
        there, back, piece_m = GEOD.inv(*line[k], *line[k + 1])
        bearing, _, away_m = GEOD.inv(*line[k], middle_lon[k], middle_lat[k])
        assert abs(away_m * np.sin(np.radians(bearing - there))) <= DEVIATION_M * 1.01, k
        assert back is not None
        assert piece_m <= length_m


def test_several_lines_keep_their_places() -> None:
    given = np.array([(0.0, 50.0), (5.0, 50.0), (5.0, 51.0), (-175.0 + 360.0, 51.0)])
    line, at = followed(given)
    assert np.array_equal(line[at][:, 1], given[:, 1])
    assert np.allclose(line[at][:, 0], given[:, 0])
    assert len(line) > 100


def test_opposite_places_have_no_shortest_line() -> None:
    with pytest.raises(NoShortestLineError):
        followed(np.array([(0.0, 0.1), (179.9, -0.05)]))
