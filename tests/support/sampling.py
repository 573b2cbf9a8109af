"""Samples of the true motion, compared with a solver's answers: `sampling.c`, compiled for the occasion."""

import ctypes
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from patience import WAIT_S
from scenes import FLATTENING, RADIUS_M

from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.kernel import build
from conflictdb.model.plans import Motion, Scene
from conflictdb.model.results import Verdict

KINDS: Final = {
    1: "overlap outside of all contacts",
    2: "apart within a certain contact",
    3: "a certain contact without any overlap",
}
# Number of contradictions whose place is kept.
KEPT: Final = 16


@dataclass
class Sampled:
    """Counts of a sampling.

    wrong : contradictions; `problems` describes the first of them: pair, kind, second and gap
    """

    samples: int = 0
    overlapping: int = 0
    wrong: int = 0
    problems: tuple[str, ...] = ()

    def add(self, other: "Sampled") -> None:
        self.samples += other.samples
        self.overlapping += other.overlapping
        self.wrong += other.wrong
        self.problems += other.problems


class _Earth(ctypes.Structure):
    _fields_ = (
        ("is_gnomonic", ctypes.c_int32),
        *((name, ctypes.c_double) for name in ("radius_m", "flattening", "centre_lon_deg", "centre_lat_deg")),
    )

    @classmethod
    def of(cls, scene: Scene) -> "_Earth":
        lon, lat = scene.centre or (0.0, 0.0)
        return cls(scene.motion is Motion.GREAT_CIRCLE, RADIUS_M[scene.earth], FLATTENING[scene.earth], lon, lat)


class _Arrays(ctypes.Structure):
    def hold(self, *arrays: np.ndarray) -> "_Arrays":
        self.held = arrays
        for (name, _), array in zip(self._fields_, arrays, strict=True):  # type: ignore[misc]
            setattr(self, name, array.ctypes.data)
        return self


def _as(values: Any, dtype: Any) -> np.ndarray:
    return np.ascontiguousarray(values, dtype)


class _Pieces(_Arrays):
    _fields_ = tuple(
        (name, ctypes.c_void_p)
        for name in (
            *("moves", "turn", "leg_start_us", "leg_end_us", "leg_start_deg", "leg_end_deg", "bearing_deg"),
            *("offset", "shape", "shape_to"),
        )
    )

    @classmethod
    def of(cls, pieces: Pieces) -> "_Arrays":
        return cls().hold(
            _as(pieces.kind, np.int8),
            _as(pieces.turn, np.int16),
            *(_as(column, np.int64) for column in (pieces.leg_start_us, pieces.leg_end_us)),
            *(_as(column, np.float64) for column in (pieces.leg_start_deg, pieces.leg_end_deg, pieces.bearing_deg)),
            _as(pieces.shape_offset, np.int64),
            *(_as(column, np.float64) for column in (pieces.shape_xy, pieces.shape_to_xy)),
        )


class _Claims(_Arrays):
    _fields_ = tuple((name, ctypes.c_void_p) for name in ("offset", "start_s", "end_s", "error_s", "is_certain"))


class _Findings(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int64) for name in ("samples", "overlapping", "wrong")),
        *((name, ctypes.c_int64 * KEPT) for name in ("pair", "kind")),
        *((name, ctypes.c_double * KEPT) for name in ("at_s", "gap_m")),
    )


@cache
def _library() -> Any:
    with TemporaryDirectory() as directory:
        made = Path(directory) / "sampling.so"
        source = Path(__file__).with_name("sampling.c")
        flags = [flag for flag in build.FLAGS if flag != "-O2"]
        subprocess.run(["cc", *flags, "-O3", "-o", made, source, *build.SHARED], check=True, timeout=WAIT_S)
        library = ctypes.CDLL(str(made))
    pointer, number = ctypes.c_void_p, ctypes.c_int64
    library.sampling_check.argtypes = [pointer, pointer, number, *[pointer] * 8]
    library.sampling_place.argtypes = [pointer, pointer, number, number, ctypes.c_double, pointer]
    library.sampling_place.restype = None
    return library


def sampled(scene: Scene, pieces: Pieces, pairs: Pairs, contacts: Contacts, rng: np.random.Generator) -> Sampled:
    """Compare all contacts of pairs, without a separation, with samples of the pieces while both exist."""
    start, end = pieces.shared_span(pairs.a, pairs.b)
    offset = np.searchsorted(contacts.pair, np.arange(len(pairs) + 1))
    claims = _Claims().hold(
        _as(offset, np.int64),
        *(_as(column, np.float64) for column in (contacts.start_s, contacts.end_s, contacts.error_s)),
        _as(contacts.verdict == Verdict.CONFLICT.code, np.int8),
    )
    columns = [_as(column, np.int64) for column in (pairs.a, pairs.b, start)]
    columns += [np.zeros(len(pairs)), (end - start) / 1e6, rng.random(len(pairs))]
    earth, held, found = _Earth.of(scene), _Pieces.of(pieces), _Findings()
    status = _library().sampling_check(
        ctypes.byref(earth),
        ctypes.byref(held),
        len(pairs),
        *(column.ctypes.data for column in columns),
        ctypes.byref(claims),
        ctypes.byref(found),
    )
    assert status == 0, "a piece has more vertices than sampling.c takes"
    problems = (
        f"pair {found.pair[k]}: {KINDS[found.kind[k]]}, {found.at_s[k]!r} s, a gap of {found.gap_m[k]:g} m in the plane"
        for k in range(min(found.wrong, KEPT))
    )
    return Sampled(found.samples, found.overlapping, found.wrong, tuple(problems))


def placed(scene: Scene, pieces: Pieces, piece: int, zero_us: int, t: float) -> np.ndarray:
    """Vertices (v, 2) of a piece at t seconds from an instant, plane metres."""
    earth, held = _Earth.of(scene), _Pieces.of(pieces)
    found = np.empty((int(np.diff(pieces.shape_offset)[piece]), 2))
    _library().sampling_place(ctypes.byref(earth), ctypes.byref(held), piece, zero_us, t, found.ctypes.data)
    return found
