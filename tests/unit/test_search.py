"""The kernel's search on a motion that meets and comes near as often as one likes (`swinging.c`); answers by hand."""

import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from conflictdb.earth.geodesy import earth_of
from conflictdb.earth.mercator import Mercator
from conflictdb.kernel import build
from conflictdb.kernel.contacts import CONTACT
from conflictdb.model.plans import EarthModel
from conflictdb.model.results import Verdict

SUPPORT: Final = Path(__file__).parents[1] / "support"
# Files below the motion, and files above it.
FILES: Final = ("earth", "polygon", "runs", "plane", "mercator", "gnomonic", "roots", "encounter", "window", "certain")
MORE_FILES: Final = ("proofs", "search", "zone", "approach_bounds")
SWING_S: Final = 100.0
BY_M: Final = 50.0
RATE: Final = 2.0 * np.pi / SWING_S
CONFLICT, GRAZING, UNRESOLVED = (one.code for one in (Verdict.CONFLICT, Verdict.GRAZING, Verdict.UNRESOLVED))


@cache
def _swinging() -> Any:
    with tempfile.TemporaryDirectory() as directory:
        made = Path(directory) / "swinging.so"
        files = [build.source(name) for name in (*FILES, *MORE_FILES)]
        flags = [*build.FLAGS, "-shared", "-fPIC"]
        subprocess.run(["cc", *flags, "-o", made, SUPPORT / "swinging.c", *files, "-lm"], check=True)
        library = ctypes.CDLL(str(made))
    library.swings.argtypes = [ctypes.c_void_p, *[ctypes.c_double] * 5, ctypes.c_void_p]
    return library


def searched(
    least_m: float,
    tolerance_m: float,
    low_s: float,
    high_s: float,
    separation_m: float = 0.0,
    earth: EarthModel = EarthModel.SPHERE,
) -> np.ndarray:
    """The contacts of a square that comes as near as least_m to the required separation, at 50 s, 150 s, ..."""
    plane, found = Mercator(earth_of(earth)).kernel_plane, np.empty(64, CONTACT)
    asked = least_m, separation_m, tolerance_m, low_s, high_s
    return found[: _swinging().swings(ctypes.byref(plane), *asked, found.ctypes.data)]


def half_s(least_m: float, within_m: float = 0.0) -> float:
    """Half the seconds for which a swing is within `within_m`."""
    return float(np.arccos(1.0 - (within_m - least_m) / BY_M) / RATE)


@pytest.mark.parametrize("least_m", [-1.0, -99.0, -0.01, -1e-4])
@pytest.mark.parametrize(("low_s", "high_s"), [(0.0, 500.0), (10.0, 1000.0), (50.0, 950.0)])
def test_every_contact_of_many_is_found_with_its_ends(least_m: float, low_s: float, high_s: float) -> None:
    """Also from contact to contact, where the window begins and ends in one, and where they are shallow."""
    found = searched(least_m, 0.0, low_s, high_s)
    swings = np.arange(50.0, high_s + 1.0, 100.0)
    wanted = np.stack([swings - half_s(least_m), swings + half_s(least_m)]).clip(low_s, high_s)
    wanted = wanted[:, wanted[0] < wanted[1]]
    assert found["verdict"].tolist() == [CONFLICT] * wanted.shape[1]
    assert found["touches"].all()
    for given, true, outward in ((found["start_s"], wanted[0], -1.0), (found["end_s"], wanted[1], 1.0)):
        further = outward * (given - true)
        assert (further >= -1e-9).all()
        assert (further <= found["error_s"] + 1e-9).all()
    # The last 1e-7 m take so long.
    assert found["error_s"].max() < 4e-7 / (2.0 * np.pi / SWING_S * np.sqrt(min(-least_m, 50.0) * 50.0)) + 2e-6


@pytest.mark.parametrize("separation_m", [300.0, 20_000.0])
@pytest.mark.parametrize("least_m", [-1.0, -30.0])
def test_every_loss_of_separation_of_many_is_found(least_m: float, separation_m: float) -> None:
    found = searched(least_m, 0.0, 10.0, 500.0, separation_m)
    assert found["verdict"].tolist() == [CONFLICT] * 5
    assert (np.diff(found["start_s"]) > 90.0).all()
    assert found["error_s"].max() < 1e-3


@pytest.mark.parametrize(("low_s", "high_s"), [(20.0, 90.0), (1.0, 53.3), (48.0, 99.0)])
@pytest.mark.parametrize(
    ("least_m", "verdict", "touches"),
    [(-0.5, GRAZING, True), (0.0, GRAZING, True), (0.1, GRAZING, False), (0.5, GRAZING, False), (-1.5, CONFLICT, True)],
)
def test_what_is_within_the_tolerance_grazes(
    least_m: float, verdict: int, touches: bool, low_s: float, high_s: float
) -> None:
    """The report has its times; a pair outside the tolerance is clear, a deeper pair is in conflict."""
    found = searched(least_m, 1.0, low_s, high_s)
    assert found["verdict"].tolist() == [verdict]
    assert (found["touches"] == touches).all()
    half = half_s(least_m, 0.0 if touches else 1.0)
    for outside_s in (max(50.0 - half, low_s) - found["start_s"][0], found["end_s"][0] - min(50.0 + half, high_s)):
        assert -1e-9 <= outside_s <= found["error_s"][0] + 1e-9
    assert len(searched(1.5, 1.0, low_s, high_s)) == 0


def test_what_may_be_further_apart_than_the_tolerance_is_unresolved() -> None:
    """3,000 km apart on the ellipsoid distances are understated by up to a metre: more than a tolerance of 0.5 m."""
    far_m = 3e6
    error_m = float(Mercator(earth_of(EarthModel.WGS84)).distance_error_m(far_m))
    assert 0.9 < error_m < 1.0
    for least_m, verdicts in (
        (error_m + 0.2, [UNRESOLVED]),
        (error_m + 0.8, []),
        (0.2 * error_m, [UNRESOLVED]),
        (-3.0, [CONFLICT]),
    ):
        found = searched(least_m, 0.5, 20.0, 90.0, far_m, EarthModel.WGS84)
        assert found["verdict"].tolist() == verdicts
