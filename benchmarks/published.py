"""The published formulas of stage 3, as printed and with their extents mended, against the truth.

    ./.venv/bin/python benchmarks/published.py [--pairs 400] [--checked 50] [--document docs/explanation/accuracy.md]

A. Bienkowski, D. Sidoti, K. R. Pattipati, "Interference Identification for Time-Varying Polyhedra", IEEE Access 2021,
section IV-C, calls the projection exact for an area and a track. The package uses nothing of this module.

The region of stage 2, the overlap of the area and the swept haven, is projected on the leg: rho_min and rho_max are the
least and the largest fraction of the leg among its vertices. rho_f is the extent of the haven ahead of its reference
point, rho_b behind it (negative), as fractions of the leg.

    as printed   first = rho_min + rho_b    last = rho_max - rho_f    the haven is rigid
    mended       first = rho_min - rho_f    last = rho_max - rho_b    still rigid, as the haven is at the leg's start
    stage 3      the product: extents over both ends of the leg, and a bound on how they bend in between

Each is clamped to the leg, 0 to 1.

Contact begins when the haven's front reaches the region, so the start needs the front extent subtracted; the printed
formula uses the rear. The window of a haven that is longer ahead starts late by the difference. Contact ends when the
rear leaves the region; the reference point has passed it by then. The printed formula subtracts the front, so the
window ends early by the time that the haven takes to pass its own length: 30 nmi at 12 kn make 150 minutes. The error
left after mending is the haven's growth in the Mercator plane.

A row is --pairs random pairs of an area and a track of one leg that meet, on the sphere. Legs keep to the band of
latitudes. Areas and havens are those of the paper's random workload (made_scenes.py): 3 to 10 vertices, each 50 to 100
nmi from the middle; rectangles of 20 to 40 nmi a side. Speeds are 5 to 20 kn. The truth is the package's `exact` at
tolerance 0, and for some pairs of each row also brute force (tests/support/oracle.py), which must agree.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
import oracle
import shapely
from layouts import convex_around
from numpy.typing import NDArray
from scenes import T0_US
from tables import markdown, show

from conflictdb import Area, Scene, Track, kernel, rectangle_outline_m
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.published.stage3_projection import windows
from conflictdb.core.run import run_stages
from conflictdb.earth.geodesy import Earth, earth_of, rhumb_direct
from conflictdb.earth.registry import Setup
from conflictdb.model.methods import Method
from conflictdb.model.plans import METRES_PER_NMI, EarthModel
from conflictdb.model.results import Kind


@dataclass(frozen=True)
class Case:
    """A row of the table: latitudes of legs, degrees, and their lengths, nautical miles."""

    latitudes: tuple[float, float]
    leg_nmi: tuple[float, float]

    @property
    def name(self) -> str:
        """The name of the row."""
        (south, north), (short, long) = self.latitudes, self.leg_nmi
        return f"latitudes {south:g}-{north:g}, legs {short:g}-{long:g} nmi"


CASES: Final = (
    Case((0.0, 30.0), (50.0, 100.0)),
    Case((55.0, 65.0), (500.0, 1000.0)),
    Case((70.0, 80.0), (300.0, 600.0)),
)
LONGITUDES_DEG: Final = (-45.0, -15.0)
RADIUS_NMI: Final = (50.0, 100.0)
SIDE_NMI: Final = (20.0, 40.0)
SPEED_KN: Final = (5.0, 20.0)
SCENE: Final = Scene("published", earth=EarthModel.SPHERE, tolerance_m=0.0)
LEAST_WAY_M: Final = 1e-3  # a leg shorter than this in the plane is a loiter
# The product and brute force differ by at most this plus the reported bound, seconds: periods are whole microseconds
# rounded outward, and brute force is accurate to one.
ROUNDING_S: Final = 3e-6


def published_windows(earth: Earth, pieces: Pieces, pairs: Pairs, *, mended: bool) -> tuple[Floats, Floats]:
    """Return (first, last), (n,) seconds after the start of each pair's shared span, by the published formulas.

    mended : with the front taken off the start and the rear off the end, not the other way round; rigid all the same

    Both members' windows are intersected for two tracks. first > last where the formulas find no time.
    """
    start, end = pieces.shared_span(pairs.a, pairs.b)
    first, last = np.zeros(len(pairs)), (end - start) / 1e6
    region = np.repeat(np.arange(len(pairs)), np.diff(pairs.region_offset))
    for member in (pairs.a, pairs.b):
        moves = pieces.kind[member] == Kind.TRACK.code
        one, other = _fractions(earth, pieces, member, region, pairs.region_xy, mended=mended)
        leg_s = (pieces.leg_end_us[member] - pieces.leg_start_us[member]) / 1e6
        gone = (pieces.leg_start_us[member] - start) / 1e6
        first = np.where(moves, np.maximum(first, one * leg_s + gone), first)
        last = np.where(moves, np.minimum(last, other * leg_s + gone), last)
    return first, last


def _fractions(
    earth: Earth,
    pieces: Pieces,
    member: NDArray[np.int64],
    region: NDArray[np.int64],
    region_xy: Floats,
    *,
    mended: bool,
) -> tuple[Floats, Floats]:
    """Return the fractions of the legs' time between which the tracks `member` can be in the regions, (n,) each."""
    turn = 2.0 * np.pi * earth.radius_m * pieces.turn[member]
    ends = [np.stack(earth.to_plane(*at[member].T), axis=1) for at in (pieces.leg_start_deg, pieces.leg_end_deg)]
    for end in ends:
        end[:, 0] += turn
    way = ends[1] - ends[0]
    moves = np.hypot(*way.T) > LEAST_WAY_M
    length2 = np.where(moves, np.einsum("nk,nk->n", way, way), 1.0)

    # The haven at the start of the leg, taken as rigid from there on.
    vertices = np.diff(pieces.shape_offset)[member]
    owner = np.repeat(np.arange(len(member)), vertices)
    index = np.arange(len(owner)) - np.repeat(np.cumsum(vertices) - vertices, vertices)
    outline = pieces.shape_xy[pieces.shape_offset[member][owner] + index]
    outline = np.where((pieces.kind[member] == Kind.TRACK.code)[owner][:, None], outline, 0.0)
    bearing = pieces.bearing_deg[member][owner]
    ahead = rhumb_direct(earth, *pieces.leg_start_deg[member][owner].T, bearing, outline[:, 1])
    corner = np.stack(earth.to_plane(*rhumb_direct(earth, *ahead, bearing + 90.0, outline[:, 0])), axis=1)
    offset = corner + np.stack([turn, np.zeros(len(member))], axis=1)[owner] - ends[0][owner]
    extent = np.einsum("nk,nk->n", offset, way[owner]) / length2[owner]
    rho_f, rho_b = np.zeros(len(member)), np.zeros(len(member))
    np.maximum.at(rho_f, owner, extent)
    np.minimum.at(rho_b, owner, extent)

    rho = np.einsum("nk,nk->n", region_xy - ends[0][region], way[region]) / length2[region]
    rho_min, rho_max = np.full(len(member), np.inf), np.full(len(member), -np.inf)
    np.minimum.at(rho_min, region, rho)
    np.maximum.at(rho_max, region, rho)
    low, high = (rho_min - rho_f, rho_max - rho_b) if mended else (rho_min + rho_b, rho_max - rho_f)
    mu0, mu1 = (earth.rectifying(np.radians(at[member, 1])) for at in (pieces.leg_start_deg, pieces.leg_end_deg))
    psi0, psi1 = earth.isometric(mu0), earth.isometric(mu1)

    def of_time(fraction: Floats) -> Floats:
        """Fraction of the way, to latitude, to distance, to time; written so that an east-west leg needs no case."""
        mu = earth.rectifying(earth.latitude(psi0 + fraction * (psi1 - psi0)))
        return fraction * earth.stretch(mu0, mu1) / earth.stretch(mu0, mu)

    # A loiter has no leg to project on: the whole of it counts.
    low, high = np.where(moves, low, 0.0), np.where(moves, high, 1.0)
    return of_time(np.clip(low, 0.0, 1.0)), of_time(np.clip(high, 0.0, 1.0))


def throw_pair(rng: np.random.Generator, case: Case, number: int) -> tuple[Area, Track]:
    """Return a convex area and a track of one leg whose swept haven comes near it."""
    earth = earth_of(SCENE.earth)
    while True:
        lon, lat, bearing = rng.uniform(*LONGITUDES_DEG), rng.uniform(*case.latitudes), rng.uniform(0.0, 360.0)
        leg_m = rng.uniform(*case.leg_nmi) * METRES_PER_NMI
        end = rhumb_direct(earth, lon, lat, bearing, leg_m)
        if case.latitudes[0] <= end[1] <= case.latitudes[1]:
            break
    length_m, width_m = rng.uniform(*SIDE_NMI, 2) * METRES_PER_NMI
    fore_m, port_m = length_m * rng.uniform(0.1, 0.9), width_m * rng.uniform(0.1, 0.9)
    outline = rectangle_outline_m(fore_m, length_m - fore_m, port_m, width_m - port_m)
    ring_m = convex_around(rng, RADIUS_NMI) * METRES_PER_NMI
    radius_m = np.hypot(*ring_m.T).max()
    # Anywhere near the leg that the haven reaches: also at its sides, before and after it.
    along = rng.uniform(fore_m - length_m - radius_m, leg_m + fore_m + radius_m)
    across = rng.uniform(-port_m - radius_m, width_m - port_m + radius_m)
    middle = rhumb_direct(earth, *rhumb_direct(earth, lon, lat, bearing, along), bearing + 90.0, across)
    heading, distance = np.degrees(np.arctan2(*ring_m.T)), np.hypot(*ring_m.T)
    ring = np.stack(rhumb_direct(earth, *middle, heading, distance), axis=1)
    hours = leg_m / METRES_PER_NMI / rng.uniform(*SPEED_KN)
    area = Area(f"A{number:04}", shapely.MultiPolygon([shapely.Polygon(ring).convex_hull]))
    times = np.array([T0_US, T0_US + int(hours * 3.6e9)])
    return area, Track(f"T{number:04}", np.array([(lon, lat), end], dtype=np.float64), times, outline)


@dataclass(frozen=True)
class Errors:
    """Differences of the answers from the truth, minutes, over n pairs that meet; (n,) each, never negative.

    late : delay of the window's start after the first contact; by way of computing it
    early : time from the window's end to the last contact
    slack : (2 n,) time of the window of stage 3 without contact, before and after
    checked : pairs compared with brute force
    """

    late: dict[str, Floats]
    early: dict[str, Floats]
    slack: Floats
    checked: int


PRINTED: Final = "as printed"
MENDED: Final = "extents mended, rigid"
STAGE_3: Final = "stage 3"


def errors_of(case: Case, count: int, checked: int, seed: int = 1) -> Errors:
    """Return the errors over `count` random pairs that meet; AssertionError if brute force does not agree."""
    rng = np.random.default_rng([seed, round(case.latitudes[0]), round(case.leg_nmi[0])])
    thrown = [throw_pair(rng, case, number) for number in range(2 * count)]
    areas, tracks = ([pair[k] for pair in thrown] for k in (0, 1))
    footprints = AreaBatch.of(areas).footprint

    setup = Setup.of(SCENE)
    certified = run_stages(setup, *one_pair_each(areas, tracks), lambda numbers: footprints[numbers])[0]
    truth = hulls_s(certified, len(thrown))
    with whole_legs():
        pieces, pairs = one_pair_each(areas, tracks)
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces, pairs.a, pairs.b)
    start_us, end_us = pieces.shared_span(pairs.a, pairs.b)
    shared_s = np.stack([start_us - T0_US, end_us - T0_US], axis=1) / 1e6
    window = shared_s[:, :1] + np.stack(windows(setup, prepared, pairs), axis=1)
    window = np.clip(window, shared_s[:, :1], shared_s[:, 1:])
    bound_s = dict(zip(certified.a_id.tolist(), certified.time_error_s.tolist(), strict=True))
    rows = np.flatnonzero(np.isfinite(truth[pairs.a, 0]))[:count]
    if len(rows) < count:
        raise AssertionError(f"{case.name}: only {len(rows)} of {len(thrown)} pairs meet, {count} are wanted")
    met = pairs.a[rows]
    for number in met[:checked].tolist():
        found = oracle.meeting(SCENE, areas[number], tracks[number]).intervals_us
        brute_s = (np.array([found[0][0], found[-1][1]]) - T0_US) / 1e6
        off_s = float(np.abs(brute_s - truth[number]).max())
        if off_s > bound_s[number] + ROUNDING_S:
            raise AssertionError(f"{case.name}, pair {number}: {Method.EXACT.value} is {off_s} s from brute force")
    ways = {STAGE_3: window[rows]}
    for name, mended in ((PRINTED, False), (MENDED, True)):
        first, last = published_windows(earth_of(SCENE.earth), pieces, pairs, mended=mended)
        ways[name] = np.stack([first[rows], last[rows]], axis=1)
    return Errors(
        {name: np.maximum(way[:, 0] - truth[met, 0], 0.0) / 60.0 for name, way in ways.items()},
        {name: np.maximum(truth[met, 1] - way[:, 1], 0.0) / 60.0 for name, way in ways.items()},
        np.concatenate([truth[met, 0] - window[rows, 0], window[rows, 1] - truth[met, 1]]) / 60.0,
        min(checked, len(met)),
    )


def one_pair_each(areas: Sequence[Area], tracks: Sequence[Track]) -> tuple[Pieces, Pairs]:
    """Return the pieces, and the pairs of area i and a slice of track i whose hulls meet."""
    n = len(areas)
    pieces = pieces_of(Setup.of(SCENE), AreaBatch.of(areas), TrackBatch.of(tracks))
    if pieces.turn.any() or (pieces.kind[:n] != Kind.AREA.code).any() or (pieces.kind[n:] != Kind.TRACK.code).any():
        raise AssertionError("an area in parts, or a copy at the seam")
    owner = np.repeat(np.arange(len(pieces)), np.diff(pieces.hull_offset))
    hulls = shapely.polygons(shapely.linearrings(pieces.hull_xy, indices=owner))
    b = np.arange(n, len(pieces))
    b = b[shapely.intersects(hulls[pieces.object_id[b]], hulls[b])]
    a = pieces.object_id[b]
    xy, pair = shapely.get_coordinates(shapely.intersection(hulls[a], hulls[b]), return_index=True)
    return pieces, Pairs(a, b, xy, np.searchsorted(pair, np.arange(len(a) + 1)).astype(np.int64))


def whole_legs() -> "patch._patch_dict":
    """Return a context in which every leg becomes a single piece."""
    return patch.multiple("conflictdb.core.pieces.cutting", WHOLE_LEG_HAVENS=1e9, MAX_SLICES_FOR_DEVIATION=0)


def hulls_s(answer: Conflicts, n: int) -> Floats:
    """Return (n, 2) from when to when the numbered areas are in contact, seconds after T0; NaN where never."""
    hull = np.full((n, 2), np.nan)
    first, last = answer.period_offset[:-1], answer.period_offset[1:] - 1
    hull[answer.a_id, 0] = (answer.period_us[first, 0] - T0_US) / 1e6
    hull[answer.a_id, 1] = (answer.period_us[last, 1] - T0_US) / 1e6
    return hull


def report(pairs: int, checked: int, seed: int) -> str:
    """Return the table in Markdown."""

    def minutes(value: float) -> str:
        return "never" if value <= ROUNDING_S / 60.0 else f"{value:.0f} min" if value >= 10.0 else f"{value:.1f} min"

    rows = []
    for case in CASES:
        found = errors_of(case, pairs, checked, seed)
        late, early = found.late[PRINTED], found.early[PRINTED]
        rows.append(
            [
                case.name,
                f"{np.median(late):.0f} / {late.max():.0f} min",
                f"{np.median(early):.0f} / {early.max():.0f} min",
                f"{minutes(found.late[MENDED].max())} / {minutes(found.early[MENDED].max())}",
                minutes(max(found.late[STAGE_3].max(), found.early[STAGE_3].max())),
                " / ".join(f"{slack:.1f} min" for slack in np.quantile(found.slack, [0.5, 0.95, 1.0])),
            ]
        )
    heads = (
        f"{pairs} pairs each, sphere",
        "as printed: start too late, median / worst",
        "as printed: end too early, median / worst",
        "extents mended: start too late / end too early, worst",
        "stage 3: late or early",
        "slack of stage 3: median / 95 % / worst",
    )
    return markdown(heads, rows)


def main() -> None:
    """Print the table, and put it into a document if requested."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=400, help="pairs that meet, per row")
    parser.add_argument("--checked", type=int, default=50, help="of them held to brute force")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--document", type=Path, help="put the table into its place in this document")
    args = parser.parse_args()
    text = report(args.pairs, args.checked, args.seed)
    show(text, "published", args.document)


if __name__ == "__main__":
    main()
