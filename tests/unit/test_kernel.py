"""The kernel's border: refusals, unresolved pairs, hostile arrays, and independence of the number of threads."""

import ctypes
import re
import shutil
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from kernel_internals import sanitized_program
from layouts import GROWING, GROWING_CIRCLES, HIGH_LATITUDE, OCEAN, Workload
from mixed_scenes import plain_scene
from patience import WAIT_S
from staged import Staged

from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.geodesy import MEAN_RADIUS_M
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput, KernelMissing
from conflictdb.kernel import KernelPlane, KernelScene, Questions, Work, build, contacts
from conflictdb.kernel.approach import closest
from conflictdb.kernel.header import functions
from conflictdb.kernel.kernel_scene import HeldPairs, HeldPieces, PieceState
from conflictdb.kernel.library import LEAST_PART, SHARE, library, shared
from conflictdb.kernel.meeting import distances
from conflictdb.model import plans
from conflictdb.model.plans import MAX_HAVEN_CORNERS, Area, EarthModel, Track, rectangle_outline_m
from conflictdb.model.results import Kind, Verdict

Columns = tuple[np.ndarray, ...]
UNRESOLVED = Verdict.UNRESOLVED.code


def batch(workload: Workload, seeds: int = 1, count: int = 10) -> tuple[KernelPlane, Pieces, Columns]:
    """A plane, pieces, and the pairs of them that might meet: a, b, zero_us, low_s, high_s."""
    scene, areas, tracks = plain_scene(workload, seeds, count, count, EarthModel.WGS84, 0.0)
    staged = Staged.of(scene, areas, tracks)
    pieces, pairs = staged.pieces, staged.pairs
    start, span_s = staged.spans()
    moving = np.flatnonzero((pieces.kind[pairs.a] == 1) | (pieces.kind[pairs.b] == 1))
    columns = pairs.a, pairs.b, start, np.zeros(len(pairs)), span_s
    return staged.setup.plane.kernel_plane, pieces, tuple(column[moving] for column in columns)


def found_of(
    scene: KernelScene,
    pairs: Columns,
    separation_m: float = 0.0,
    tolerance_m: float = 1.0,
    work: Work | None = None,
    **more: int,
) -> Contacts:
    """The contacts of pairs whose last instants count."""
    questions = Questions(*pairs, np.full(len(pairs[0]), np.inf))
    return contacts(scene, questions, separation_m, tolerance_m, work or Work(), **more)


def assert_same(one: Contacts, other: Contacts) -> None:
    for column in fields(Contacts):
        np.testing.assert_array_equal(getattr(one, column.name), getattr(other, column.name))


def some(found: Contacts, wanted: np.ndarray) -> Contacts:
    """The contacts of some of the pairs."""
    rows = np.flatnonzero(wanted[found.pair])
    return Contacts(*(getattr(found, column.name)[rows] for column in fields(Contacts)))


def assert_unresolved(found: Contacts, pairs: np.ndarray) -> None:
    """Each of these pairs is reported as unresolved, in all its time."""
    mine = some(found, pairs)
    assert mine.pair.tolist() == np.flatnonzero(pairs).tolist()
    assert (mine.verdict == UNRESOLVED).all()


@pytest.mark.parametrize("workload", [HIGH_LATITUDE, GROWING, OCEAN, GROWING_CIRCLES], ids=lambda w: w.name)
@pytest.mark.parametrize("separation_m", [0.0, 2000.0])
def test_any_number_of_threads_and_any_order_give_the_same_bits(workload: Workload, separation_m: float) -> None:
    plane, pieces, pairs = batch(workload)
    many = tuple(np.tile(column, 1 + 5000 // len(column)) for column in pairs)
    order = np.random.default_rng(0).permutation(len(many[0]))
    scene, works = KernelScene(plane, pieces), [Work(), Work(), Work()]
    one, two = (found_of(scene, many, separation_m, 1.0, works[n - 1], threads=n) for n in (1, 2))
    assert_same(one, two)
    mixed = found_of(scene, tuple(column[order] for column in many), separation_m, 1.0, works[2], threads=3)
    assert_same(one, Contacts.concatenate([mixed.of_pairs(order)]))
    assert works[0] == works[1] == works[2]
    assert 0 < len(np.unique(one.pair)) < len(order)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", ["shape_xy", "leg_start_deg", "leg_end_deg", "bearing_deg"])
def test_a_piece_that_is_no_number_leaves_its_own_pairs_unresolved(bad: float, column: str) -> None:
    plane, pieces, pairs = batch(HIGH_LATITUDE)
    expected = found_of(KernelScene(plane, pieces), pairs)
    spoilt = int(pairs[0][pieces.kind[pairs[0]] == 1][0])
    values = getattr(pieces, column).copy()
    values[pieces.shape_offset[spoilt] if column == "shape_xy" else spoilt] = bad
    columns: dict[str, Any] = {column: values}
    if column == "shape_xy":
        columns["shape_to_xy"] = values
    found = found_of(KernelScene(plane, replace(pieces, **columns)), pairs)
    its_own = (pairs[0] == spoilt) | (pairs[1] == spoilt)
    assert its_own.any()
    assert_unresolved(found, its_own)
    assert_same(some(found, ~its_own), some(expected, ~its_own))


def test_a_piece_without_vertices_leaves_its_pairs_unresolved() -> None:
    plane, pieces, pairs = batch(HIGH_LATITUDE)
    piece = int(pairs[0][0])
    count = np.diff(pieces.shape_offset)
    keep = np.repeat(np.arange(len(pieces)) != piece, count)
    count[piece] = 0
    offset, shape = np.concatenate([[0], np.cumsum(count)]), pieces.shape_xy[keep]
    without = replace(pieces, shape_offset=offset, shape_xy=shape, shape_to_xy=shape)
    found = found_of(KernelScene(plane, without), pairs)
    assert_unresolved(found, (pairs[0] == piece) | (pairs[1] == piece))


@pytest.mark.parametrize(
    ("offset", "message"), [([1, 8], "offsets"), ([0, 3], "offsets"), ([0, 9], "offsets"), ([0, -1], "offsets")]
)
def test_offsets_that_do_not_fit_are_refused(offset: list[int], message: str) -> None:
    plane, pieces, _ = batch(HIGH_LATITUDE)
    one = pieces.take(np.array([0]))
    one = replace(one, shape_offset=np.array(offset), shape_xy=np.zeros((8, 2)), shape_to_xy=np.zeros((8, 2)))
    with pytest.raises(ValueError, match=message):
        KernelScene(plane, one)


@pytest.mark.parametrize("row", [-1, 10**6, -(2**63), 2**63 - 1])
def test_pairs_of_pieces_that_there_are_not_are_refused(row: int) -> None:
    plane, pieces, pairs = batch(HIGH_LATITUDE)
    a = pairs[0].copy()
    a[-1] = row
    with pytest.raises(ValueError, match="an index of a piece"):
        found_of(KernelScene(plane, pieces), (a, *pairs[1:]))


@pytest.mark.parametrize(("separation_m", "tolerance_m"), [(-1.0, 1.0), (np.nan, 1.0), (0.0, np.nan), (np.inf, 1.0)])
def test_distances_that_are_none_are_refused(separation_m: float, tolerance_m: float) -> None:
    plane, pieces, pairs = batch(HIGH_LATITUDE)
    with pytest.raises(ValueError, match="separation or tolerance"):
        found_of(KernelScene(plane, pieces), pairs, separation_m, tolerance_m)


@pytest.mark.parametrize(("low_s", "high_s"), [(np.nan, 1.0), (0.0, np.inf), (2.0, 1.0), (-np.inf, np.inf)])
def test_times_that_are_none_are_unresolved(low_s: float, high_s: float) -> None:
    plane, pieces, (a, b, zero, _, _) = batch(HIGH_LATITUDE)
    low, high = np.full(len(a), low_s), np.full(len(a), high_s)
    found = found_of(KernelScene(plane, pieces), (a, b, zero, low, high))
    assert_unresolved(found, np.ones(len(a), np.bool_))


def test_columns_of_other_lengths_are_refused() -> None:
    plane, pieces, pairs = batch(HIGH_LATITUDE)
    with pytest.raises(ValueError, match="one length"):
        found_of(KernelScene(plane, pieces), (*pairs[:-1], pairs[-1][:-1]))


@pytest.mark.parametrize("turns", [1, 7], ids=["convex", "wound"])
def test_thousands_of_vertices_are_taken(turns: int) -> None:
    """In order, and seven times round, where the kernel uses their hull: the same answer."""
    plane, pieces, pairs = batch(HIGH_LATITUDE)
    row = int(np.flatnonzero(pieces.kind[pairs[0]] == 1)[0])
    both = pieces.take(np.array([pairs[0][row], pairs[1][row]]))
    angle = 2.0 * np.pi * np.arange(3000) / 3000
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * 1e5
    shape = np.concatenate([ring[np.arange(3000) * turns % 3000], both.shape_xy[both.shape_offset[1] :]])
    offset = np.concatenate([[0], both.shape_offset[1:] - both.shape_offset[1] + 3000])
    large = replace(both, shape_xy=shape, shape_to_xy=shape, shape_offset=offset)
    one = np.zeros(1, np.int64)
    found = found_of(KernelScene(plane, large), (one, one + 1, pairs[2][[row]], np.zeros(1), pairs[4][[row]]))
    assert UNRESOLVED not in found.verdict


def wide(pieces: Pieces, pair: tuple[int, int], count: int) -> Pieces:
    """Two pieces: the first becomes a circle of `count` vertices about its middle, far larger than the other."""
    both = pieces.take(np.array(pair))
    angle = 2.0 * np.pi * np.arange(count) / count
    middle = both.shape_xy[: both.shape_offset[1]].mean(axis=0)
    shape = np.concatenate(
        [middle + np.stack([np.cos(angle), np.sin(angle)], 1) * 1e5, both.shape_xy[both.shape_offset[1] :]]
    )
    offset = np.concatenate([[0], both.shape_offset[1:] - both.shape_offset[1] + count])
    return replace(both, shape_xy=shape, shape_to_xy=shape, shape_offset=offset)


def test_an_area_of_a_million_vertices_is_solved_in_seconds() -> None:
    """The answer is that of a thousand vertices, whose circle is 0.5 m narrower."""
    plane, pieces, (a, b, zero, _, high) = batch(HIGH_LATITUDE)
    row = int(np.flatnonzero((pieces.kind[a] == 0) & (pieces.kind[b] == 1))[0])
    one = np.zeros(1, np.int64)
    began, found = time.process_time(), []
    for count in (1000, 1_000_000):
        scene = KernelScene(plane, wide(pieces, (int(a[row]), int(b[row])), count))
        found.append(found_of(scene, (one, one + 1, zero[[row]], np.zeros(1), high[[row]])))
    assert time.process_time() - began < 30.0
    few, many = found
    np.testing.assert_array_equal(few.verdict, many.verdict)
    np.testing.assert_allclose(few.start_s, many.start_s, atol=5.0)
    np.testing.assert_allclose(few.end_s, many.end_s, atol=5.0)


@pytest.mark.parametrize(
    ("separation_m", "apart_m", "meets"), [(0.0, 199_900.0, 1), (0.0, 200_100.0, 0), (500.0, 200_100.0, 1)]
)
def test_two_areas_of_a_million_vertices_are_solved_in_seconds(separation_m: float, apart_m: float, meets: int) -> None:
    """Circles of 100 km about the equator, where the scale of the plane is 1."""
    plane, pieces, (a, _, zero, _, high) = batch(OCEAN)
    row, count, one = int(np.flatnonzero(pieces.kind[a] == 0)[0]), 1_000_000, np.zeros(1, np.int64)
    both = wide(pieces, (int(a[row]), int(a[row])), count)
    circle = both.shape_xy[:count] - both.shape_xy[:count].mean(axis=0)
    shape = np.concatenate([circle, circle + np.array([apart_m, 0.0])])
    both = replace(both, shape_xy=shape, shape_to_xy=shape, shape_offset=np.array([0, count, 2 * count]))
    began = time.process_time()
    found = found_of(KernelScene(plane, both), (one, one + 1, zero[[row]], np.zeros(1), high[[row]]), separation_m)
    assert time.process_time() - began < 30.0
    assert len(found.pair) == meets


@pytest.mark.parametrize(("more", "is_taken"), [(0, True), (1, False)])
def test_havens_of_too_many_vertices_cannot_be(more: int, is_taken: bool) -> None:
    """The memory of two of them grows with the square. Input refuses them, by the same limit."""
    header = (build.HERE / "kernel.h").read_text()
    assert f"#define KERNEL_MOST_VERTICES {MAX_HAVEN_CORNERS}\n" in header
    plane, pieces, (_, b, *_) = batch(HIGH_LATITUDE)
    moving = int(b[pieces.kind[b] == 1][0])
    state = KernelScene(plane, wide(pieces, (moving, moving), MAX_HAVEN_CORNERS + more)).states()
    assert (state[0] != PieceState.INVALID) == is_taken
    angle = 2.0 * np.pi * np.arange(MAX_HAVEN_CORNERS + more) / (MAX_HAVEN_CORNERS + more)
    given = np.array([(0.0, 0.0), (1.0, 1.0)]), np.array([0, 10**9]), np.stack([np.cos(angle), np.sin(angle)], 1) * 1e5
    if is_taken:
        Track("T", *given)
    else:
        with pytest.raises(InvalidInput, match=r"'T'.*at most 10000 corners; got 10001"):
            Track("T", *given)


def test_a_library_of_other_sources_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "fingerprint", lambda: "another")
    with pytest.raises(KernelMissing, match=r"\./run builds it"):
        library.__wrapped__()


def test_a_library_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(build, "library", lambda: tmp_path / "libkernel.so")
    with pytest.raises(KernelMissing, match=r"\./run builds it"):
        library.__wrapped__()


@pytest.mark.parametrize(
    "programs",
    [
        {},
        {
            "cc": "echo 'stdlib.h: No such file' >&2; exit 1",
            "uv": '[ "$1" = venv ] || { echo no network >&2; exit 1; }',
        },
    ],
    ids=["none, and pip", "bad, and uv"],
)
def test_no_compiler_and_no_network_are_one_clear_error(tmp_path: Path, programs: dict[str, str]) -> None:
    """The message of the compiler or installer comes first, the remedy last; no headers count as no compiler."""
    shutil.copytree(build.HERE, tmp_path, ignore=shutil.ignore_patterns("*.so", "__pycache__"), dirs_exist_ok=True)
    for name, script in programs.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / name).chmod(0o755)
    nothing = {"PATH": str(tmp_path), "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(tmp_path), "HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, tmp_path / "build.py"],
        env=nothing,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("kernel: no C compiler (cc) that works here, fetching one")
    assert "install a C compiler" in done.stderr.splitlines()[-1]
    assert not list(tmp_path.glob(".build-*"))


def test_run_and_build_know_the_library_of_these_sources_by_the_same_fingerprint() -> None:
    root = build.HERE.parents[1]
    function = re.search(r"^kernel_fingerprint\(\) \(.*?^\)$", (root / "run").read_text(), re.DOTALL | re.MULTILINE)
    assert function
    script = f"kernel={build.HERE}\n{function.group()}\nkernel_fingerprint"
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, timeout=WAIT_S, check=True)
    assert done.stdout.strip() == build.fingerprint()
    assert build.is_current()


def test_another_platform_has_another_fingerprint() -> None:
    """A tree that two machines share does not make one load the library of the other."""
    assert build.fingerprint("Darwin arm64") != build.fingerprint("Linux aarch64") != build.fingerprint()


@pytest.mark.slow  # .ci/sanitize runs it, and has built the kernel under sanitizers
def test_hostile_arrays_under_sanitizers(tmp_path: Path) -> None:
    """Any access outside an array (each is a block of its own), undefined operation or broken precondition ends it."""
    driver = Path(__file__).parents[1] / "support" / "hostile_kernel.c"
    program = sanitized_program(tmp_path / "hostile_kernel", driver)
    done = subprocess.run([program, "2000", "1"], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    counts = [[int(number) for number in line.split()[1:]] for line in done.stdout.splitlines()]
    assert min(counts[1]) > 100  # every outcome
    assert min(counts[0][:1] + counts[0][2:]) > 0  # every status but the lack of memory


def test_places_without_an_array_are_refused() -> None:
    """One that is not there is no place; of no place none is needed."""
    plane, _, _ = batch(HIGH_LATITUDE)
    place = (ctypes.c_double * 2)(1.0, 2.0)
    calls = ((None, 1, place), (place, 1, None), (place, 1, place), (None, 0, None), (place, -1, place))
    ok, null = 0, 2
    found = [library().kernel_degrees(ctypes.byref(plane), *given) for given in calls]
    assert found[:4] == [null, null, ok, ok]
    assert found[4] not in (ok, null)


def test_every_function_of_the_header_is_declared() -> None:
    """With as many arguments as it takes: a pointer passed as a plain number would lose its upper half."""
    header = re.sub(r"/\*.*?\*/", "", (build.HERE / "kernel.h").read_text(), flags=re.DOTALL)
    declared = re.findall(r"\b(kernel_\w+)\(([^)]*)\);", header)
    assert {name: 0 if takes == "void" else takes.count(",") + 1 for name, takes in declared} == {
        name: len(types) for name, (_, types) in functions().items()
    }


def test_only_functions_of_the_header_are_exported() -> None:
    """A host program's or another library's `join` or `sweep` never takes the place of the kernel's."""
    if not shutil.which("nm"):
        pytest.skip("no nm here")
    options = ["-gU"] if sys.platform == "darwin" else ["-D", "--defined-only"]
    listed = subprocess.run(
        ["nm", *options, build.library()], capture_output=True, text=True, timeout=WAIT_S, check=True
    )
    exported = {line.split()[-1].split("@")[0] for line in listed.stdout.splitlines() if line.split()[-2] != "A"}
    # Linkers add names with an underscore in front, as does every C symbol on macOS.
    own = {name.removeprefix("_") if sys.platform == "darwin" else name for name in exported}
    assert {name for name in own if not name.startswith("_")} == set(functions())


def test_every_function_of_the_header_meets_hostile_arrays() -> None:
    driver = (Path(__file__).parents[1] / "support" / "hostile_kernel.c").read_text()
    assert [name for name in functions() if f"{name}(" not in driver] == ["kernel_abi", "kernel_fingerprint"]


def test_structures_have_the_size_that_the_library_has() -> None:
    """On a platform where all numbers have their natural alignment."""
    assert ctypes.sizeof(KernelPlane) == 8 + 8 * (4 + 6 + 6 + 7 + 2)
    assert ctypes.sizeof(HeldPieces) == 8 * 15
    assert ctypes.sizeof(HeldPairs) == 8 * 6


def test_pairs_asked_about_beyond_a_pole_are_unresolved() -> None:
    """A leg that would go on past a pole after its end is undefined then: reported at once, and other pairs as ever."""
    plane, pieces, pairs = batch(HIGH_LATITUDE)
    scene = KernelScene(plane, pieces)
    change_deg = np.abs(pieces.leg_end_deg - pieces.leg_start_deg)[:, 1]
    rate = change_deg / np.maximum((pieces.leg_end_us - pieces.leg_start_us) / 1e6, 1.0)
    faster = np.maximum(rate[pairs[0]], rate[pairs[1]])
    beyond = (faster > 1e-6) & (np.arange(len(faster)) % 2 == 0)
    assert beyond.any()
    found = found_of(scene, (*pairs[:4], np.where(beyond, 180.0 / np.maximum(faster, 1e-6), pairs[4])))
    assert_unresolved(found, beyond)
    assert_same(some(found, ~beyond), some(found_of(scene, pairs), ~beyond))


@pytest.mark.parametrize("high_s", [2.0**64 / 1e6 * (1.0 + 1e-15), 1e195, 1e308])
def test_pairs_of_times_that_cannot_be_are_unresolved_at_once(high_s: float) -> None:
    """No two instants are that far apart: nothing is searched, and other pairs are as ever."""
    plane, pieces, pairs = batch(GROWING_CIRCLES)
    scene, work, usual = KernelScene(plane, pieces), Work(), Work()
    beyond = np.arange(len(pairs[0])) % 2 == 0
    found = found_of(scene, (*pairs[:4], np.where(beyond, high_s, pairs[4])), 2000.0, 1.0, work)
    assert_unresolved(found, beyond)
    expected = found_of(scene, tuple(column[~beyond] for column in pairs), 2000.0, 1.0, usual)
    assert work == usual
    for column in ("start_s", "end_s", "error_s", "verdict"):
        np.testing.assert_array_equal(getattr(some(found, ~beyond), column), getattr(expected, column))


def test_the_work_of_a_pair_that_meets_for_ever_is_bounded() -> None:
    """Around the earth thousands of times, as no leg goes: it takes no more than its share, in all steps together."""
    plane, pieces, pairs = batch(GROWING_CIRCLES)
    scene = KernelScene(plane, pieces)
    looks = []
    for i in range(len(pairs[0])):
        work = Work()
        one = Questions(
            *(column[i : i + 1] for column in pairs[:4]), np.array([1e9]), np.array([np.inf]), np.array([10**6])
        )
        contacts(scene, one, 2000.0, 1.0, work)
        looks.append(work.windows)
    assert 5000 < max(looks) < 20_000


def test_distances_of_a_pair_take_a_bounded_share_of_work() -> None:
    """Ten metres from a pole all of a parallel is as near: one distance takes hundreds of halvings."""
    scene = plans.Scene("s", earth=EarthModel.SPHERE)
    square = rectangle_outline_m(1.0, 1.0, 1.0, 1.0)
    way = Track("T", np.array([(10.0, 60.0), (12.0, 60.0)]), np.array([0, 3_600_000_000]), square)
    areas = AreaBatch.of([Area("A", shapely.MultiPolygon([shapely.box(0.0, 0.0, 90.0, 5.0)]))])
    setup = Setup.of(scene)
    pieces = pieces_of(setup, areas, TrackBatch.of([way]))
    north = (pieces.kind == Kind.TRACK.code)[:, None] * [0.0, 30.0 - np.degrees(10.0 / MEAN_RADIUS_M)]
    near_pole = replace(pieces, leg_start_deg=pieces.leg_start_deg + north, leg_end_deg=pieces.leg_end_deg + north)
    wanted_m = MEAN_RADIUS_M * np.radians(85.0) - 10.0
    a, b = np.array([0]), np.array([1])
    start, end = pieces.shared_span(a, b)
    times = (start, np.zeros(1), (end - start) / 1e6)
    prepared, work = KernelScene(setup.plane.kernel_plane, near_pole), Work()
    questions = Questions(a, b, *times, np.array([np.inf]), np.array([1000]))
    found = contacts(prepared, questions, wanted_m, 1e-3, work)
    assert found.verdict.tolist() == [UNRESOLVED]
    assert (found.start_s, found.end_s) == (0.0, times[2])
    assert work.evaluations < 400
    # Alone, with all of the work, it is known; so is one distance, and the least of a whole time.
    alone = contacts(prepared, replace(questions, pairs_of_objects=np.array([1])), wanted_m, 1e-3, Work())
    assert alone.verdict.tolist() == [Verdict.CONFLICT.code]
    assert distances(prepared, a, b, start, np.zeros(1)) == pytest.approx([wanted_m - 1.0], abs=0.01)
    near = closest(prepared, a, b, *times, np.array([0, 1]), np.array([np.inf]), np.zeros(1), Work())
    assert near.distance_m == pytest.approx([wanted_m - 1.0], abs=0.05)
    assert near.error_m < 0.1


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_shares_of_work_are_all_rows_in_order(threads: int) -> None:
    """Whatever the rows weigh; of several threads none takes much at the end, which the others would wait for."""
    rng = np.random.default_rng(threads)
    for n in (0, 1, SHARE, 11_000, 100_000):
        vertices = rng.integers(1, 12, n) * np.where(rng.random(n) < 0.001, 100_000, 1)
        slices = shared(lambda rows: rows, n, threads, vertices=vertices)
        assert [row for rows in slices for row in range(rows.start, rows.stop)] == list(range(n))
        plain = shared(lambda rows: rows.stop - rows.start, n, threads)
        assert max(plain, default=0) <= SHARE
        if threads > 1 and n > SHARE:
            assert plain[-1] <= SHARE // LEAST_PART


def test_what_fails_in_one_thread_ends_all() -> None:
    """The error is raised, and questions that no thread has begun are skipped."""
    begun: list[int] = []

    def solve(rows: slice) -> None:
        begun.append(rows.start)
        if len(begun) == 3:
            raise LookupError("third")

    with pytest.raises(LookupError, match="third"):
        shared(solve, 1_000_000, 2)
    assert len(begun) < 100
