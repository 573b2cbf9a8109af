"""Every acceptance scene is certified, and `check_proof.py` accepts the proof; forged and damaged ones it refuses."""

import ast
import contextlib
import hashlib
import io
import json
import math
import subprocess
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import digests
import forged
import forged_lines
import pytest
import shapely
from draws import draws
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from patience import WAIT_S

from conflictdb import Area, Scene, Track, certify, delays, solve
from conflictdb.errors import IncompleteWarning, InvalidInput
from conflictdb.formats import check_proof
from conflictdb.kernel import build, library

ACCEPTED, REFUSED = 0, 1
SOMETHING_IS_NOT_CHECKED = 2
CROWDED = replace(LOW_LATITUDE, window=1.5, around_haven=(8.0, 20.0), around_area=(5.0, 15.0))
SCENES = digests.acceptance_scenes()
# Scenes that every run certifies; the others with `-m slow`.
_FEW = 13


def checked(path: Path) -> tuple[int, str]:
    """Return the exit status and the report of the checker."""
    with contextlib.redirect_stdout(io.StringIO()) as report:
        status = check_proof.main([str(path)])
    return status, report.getvalue()


@contextlib.contextmanager
def quietly() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        yield


def _marked(k: int, name: str) -> object:
    return name if k % _FEW == 0 else pytest.param(name, marks=pytest.mark.slow)


@pytest.mark.parametrize("name", [_marked(k, name) for k, name in enumerate(SCENES)])
def test_proof_of_scene(tmp_path: Path, name: str) -> None:
    """Every pair has a proof; the checker skips only the kinds of answers that have none."""
    scene, areas, tracks = SCENES[name]()
    with quietly():
        made = certify(tracks, areas, tmp_path / "proof", scene)
    status, report = checked(tmp_path / "proof")
    assert made, made
    assert status in (ACCEPTED, SOMETHING_IS_NOT_CHECKED), report
    lines = [line for line in report.splitlines() if line.startswith("not checked")]
    known = ("with tolerances", "separation in time", "schedules", "verdicts", "which were not cut", "s of a plan")
    assert all(any(one in line for one in known) for line in lines), report


def test_the_checker_is_one_file_that_needs_nothing() -> None:
    """Strangers read it: it imports the standard library only, and has at most 750 lines without blank ones."""
    text = Path(check_proof.__file__).read_text()
    imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {
        name.split(".")[0]
        for node in imports
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names])
    }
    assert names <= sys.stdlib_module_names
    assert sum(bool(line.strip()) for line in text.splitlines()) <= 750


def test_the_checker_runs_alone(tmp_path: Path) -> None:
    """Copied somewhere else, without this package, it says how many objects it has and that all is proven."""
    scene, areas, tracks = SCENES["strait"]()
    certify(tracks, areas, tmp_path / "proof", scene)
    (tmp_path / "check.py").write_text(Path(check_proof.__file__).read_text())
    command = [sys.executable, "-I", "-S", str(tmp_path / "check.py"), str(tmp_path / "proof")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert (done.returncode, done.stderr) == (ACCEPTED, "")
    assert done.stdout.endswith("proven\n")


@draws("scenes", 4, 80)
def test_forged_proofs_are_refused_or_true(tmp_path: Path, scenes: int) -> None:
    """Whatever is changed, the checker accepts nothing that brute force says is false."""
    total = forged.Count()
    for seed in range(scenes):
        total.add(forged.forge(seed, 250, tmp_path))
    assert not total.wrong, "\n".join(total.wrong)
    refused = {kind for kind, said in total.outcomes if said == "refused"}
    assert refused >= {"angle", "until", "piece", "line lost", "contact", "verdict lost", "verdict", "cuts", "bytes"}
    assert total.tried > 150 * scenes


@draws("scenes", 3, 40)
def test_forged_lines_are_refused_or_true(tmp_path: Path, scenes: int) -> None:
    """Lines of a pair are changed, and only that pair is checked again; one proof in a hundred is a whole file."""
    total: Counter[tuple[str, str]] = Counter()
    for seed, mixed in islice(forged_lines.scenes(1), 3 * scenes):
        found, wrong = forged_lines.forge(seed, mixed, 400, tmp_path)
        assert not wrong
        total += found
    refused = {kind.split(":")[0] for kind, said in total if said == "refused"}
    assert refused == {"steps", "contact", "hidden, steps", "verdict", "invented", "whole file"}


def test_a_checker_that_believes_contacts_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Invented conflicts are false, and nothing else finds that out."""
    monkeypatch.setattr(check_proof.Checker, "lacks_conflict", lambda *_: "")
    ((seed, mixed),) = islice(forged_lines.scenes(1), 1)
    _, wrong = forged_lines.forge(seed, mixed, 400, tmp_path)
    assert f"scene {seed}: invented" in wrong


def proof_of(folder: Path, *objects: Area | Track) -> forged.Parts:
    """Return the parts of the proof of a scene of some objects."""
    areas = [one for one in objects if isinstance(one, Area)]
    tracks = [one for one in objects if isinstance(one, Track)]
    certify(tracks, areas, folder / "proof", Scene("s", tolerance_m=0.0))
    return check_proof.read((folder / "proof").read_text().splitlines(keepends=True))


SHIP = Track("ship", [(5.0, 56.0), (5.5, 56.0)], [0, 3_600_000_000], [(-20, 99), (20, 99), (20, -99), (-20, -99)])


@pytest.mark.parametrize("member", [{"object": 0, "spans": [[0, 1]]}, {"object": 1, "departures": [9 * 10**15]}])
def test_other_times_than_those_of_the_objects_are_refused(tmp_path: Path, member: dict[str, object]) -> None:
    """Spans and departures beside the objects would hide each conflict; only schedules have them."""
    area = Area("closed", shapely.box(5.2, 55.9, 5.3, 56.1), start_us=0, end_us=7_200_000_000)
    parts = proof_of(tmp_path, area, SHIP)
    assert forged.outcome(parts) == "accepted"
    hidden = {**parts, "verdicts": [], "proofs": []}
    assert forged.outcome(hidden) == "refused"
    with pytest.raises(check_proof.Refused, match="other times than its object, without a schedule"):
        check_proof.Checker({**hidden, "pieces": [member]})


def test_a_ring_that_is_not_closed_is_refused(tmp_path: Path) -> None:
    """Others close it, and would have a corner that the checker passes over."""
    parts = proof_of(tmp_path, Area("closed", shapely.box(5.2, 55.0, 5.3, 55.1)), SHIP)
    area = parts["objects"][0]
    ring = [[5.2, 55.0], [5.3, 55.0], [5.3, 55.1], [5.25, 56.5]]
    area["geometry"] = {"type": "Polygon", "coordinates": [ring]}
    with pytest.raises(check_proof.Refused, match="a ring of area 'closed' is not closed"):
        check_proof.Checker(parts)


def test_a_part_of_a_turn_is_refused(tmp_path: Path) -> None:
    """Moved by half a turn, ships on the other side of the earth would be in contact."""
    other = Track("other", SHIP.positions_deg - [180.0, 0.0], SHIP.times_us, SHIP.outline_m)
    parts = proof_of(tmp_path, SHIP, other)
    assert parts["verdicts"] == []
    period = ["1970-01-01T00:00:00Z", "1970-01-01T00:00:01Z"]
    verdict = {"a": "other", "b": "ship", "verdict": "conflict", "periods": [period], "time_error_s": 0.0}
    q = next(piece.number for piece in check_proof.Checker(parts).scene.pieces if piece.of == 1)
    contacts = [f'["contact", 0, {q}, -0.5, {at}, -175.0, 56.0]\n' for at in (0.0, 1.0)]
    invented = {**parts, "verdicts": [verdict], "proofs": [*contacts, f'["deep", 0, {q}, -0.5, 0.5]\n']}
    with pytest.raises(check_proof.Refused, match="no whole number of turns"):
        check_proof.Checker(invented)
    assert forged.outcome(invented) == "refused"


@pytest.mark.parametrize("steps", ["", ",null,0.0", ",3.14,1.0", ",null,9.0,null,10.0"])
def test_steps_that_end_too_early_are_refused(tmp_path: Path, steps: str) -> None:
    """The last direction must last to the end of the shared time."""
    parts = proof_of(tmp_path, Area("closed", shapely.box(5.2, 55.9, 5.3, 56.1)), SHIP)
    pieces = check_proof.Checker(parts).scene.pieces
    lines = [f"[{p.number},{q.number},0{steps}]\n" for p in pieces for q in pieces]
    hidden = {**parts, "verdicts": [], "proofs": lines}
    assert forged.outcome(hidden) == "refused"


def invented(a: str, b: str, *proofs: str, period: object = (None, None)) -> forged.Parts:
    """Return a conflict of two objects, with some proofs."""
    verdict = {"a": a, "b": b, "verdict": "conflict", "periods": [period], "time_error_s": 0.0}
    return {"verdicts": [verdict], "proofs": [f"{one}\n" for one in proofs]}


def test_a_conflict_of_an_object_with_itself_is_refused(tmp_path: Path) -> None:
    parts = proof_of(tmp_path, SHIP)
    proofs = '["contact", 0, 0, 0, 0.0, 5.0, 56.0]', '["deep", 0, 0, 0, 0.0]'
    assert forged.outcome({**parts, **invented("ship", "ship", *proofs, period=(0, 0))}) == "refused"


@pytest.mark.parametrize(("floor_m", "said"), [(100.0, "refused"), (99.0, "accepted")])
def test_a_conflict_of_heights_that_only_touch_is_refused(tmp_path: Path, floor_m: float, said: str) -> None:
    """Bands are half-open, as spans are."""
    shape = shapely.box(5.2, 55.9, 5.3, 56.1)
    low = Area("low", shape, floor_m=0.0, ceiling_m=100.0)
    parts = proof_of(tmp_path, low, Area("high", shape, floor_m=floor_m, ceiling_m=200.0))
    proofs = '["contact", 0, 1, 0, 0.0, 5.27, 56.0]', '["deep", 0, 1, 0, 0.0]'
    assert forged.outcome({**parts, **invented("low", "high", *proofs)}) == said


@pytest.mark.parametrize("is_turned", [False, True])
def test_a_conflict_in_a_hole_is_refused(tmp_path: Path, is_turned: bool) -> None:
    """Without parts an area is its hull, which shows that it is apart, but no contact."""
    hole = [(5.1, 55.95), (5.4, 55.95), (5.4, 56.05), (5.1, 56.05)]
    shape = shapely.Polygon([(5.0, 55.9), (5.5, 55.9), (5.5, 56.1), (5.0, 56.1)], [hole])
    parts = proof_of(tmp_path, Area("holed", shape), Area("inside", shapely.box(5.2, 55.98, 5.3, 56.02)))
    assert not parts["verdicts"]
    if is_turned:
        parts["objects"][0]["geometry"]["coordinates"][1].reverse()
    proofs = '["contact", 0, 1, 0, 0.0, 5.25, 56.0]', '["deep", 0, 1, 0, 0.0]'
    assert forged.outcome({**parts, "pieces": [], **invented("holed", "inside", *proofs)}) == "refused"


@pytest.mark.parametrize(
    "change",
    [
        *({name: value} for name in ("earth", "motion", "intervals") for value in ("flat", None)),
        *({name: value} for name in ("tolerance_m", "separation_m") for value in (math.nan, -1.0, math.inf)),
        {"rules": [{"separation_m": math.nan}]},
        {"rules": [{"time_s": -1.0}]},
    ],
    ids=str,
)
def test_settings_that_no_scene_has_are_refused(tmp_path: Path, change: dict[str, object]) -> None:
    parts = proof_of(tmp_path, SHIP)
    assert forged.outcome(parts) == "accepted"
    assert forged.outcome({**parts, "settings": [parts["settings"][0] | change]}) == "refused"


def test_numbers_that_are_none_are_refused(tmp_path: Path) -> None:
    """JSON of others may have NaN."""
    proof_of(tmp_path, SHIP)
    lines = (tmp_path / "proof").read_text().replace("56.0", "NaN", 1).splitlines(keepends=True)
    k = next(k for k, line in enumerate(lines) if '"part": "pieces"' in line)
    last = json.loads(lines[-1])
    last["sha256"]["objects"] = hashlib.sha256(lines[k - 1].encode()).hexdigest()
    with pytest.raises(ValueError, match="NaN"):
        check_proof.read([*lines[:-1], f"{json.dumps(last)}\n"])


def test_a_touch_as_a_plan_ends_is_named(tmp_path: Path) -> None:
    """The end does not belong to the plan: no conflict, and the checker says that the last part has no proof."""
    area = Area("closed", shapely.box(5.5, 55.9, 5.8, 56.1))
    haven_m = [(0.0, 0.0)]
    boat = Track("boat", [(5.0, 56.0), (5.5, 56.0)], [0, 3_600_000_000], haven_m)
    scene = Scene("s", tolerance_m=0.0)
    assert not solve([boat], [area], scene)
    certify([boat], [area], tmp_path / "proof", scene)
    status, report = checked(tmp_path / "proof")
    assert status == SOMETHING_IS_NOT_CHECKED, report
    assert "not checked: 1 pairs of pieces, for the last 0.01 s of a plan" in report


def delayed_scene(seed: int, **more: float) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene in which several tracks have least delays."""
    return plain_scene(CROWDED, seed, 3, 10, **more)


@pytest.mark.parametrize(("seed", "more"), [(1, {}), (1, {"tolerance_m": 0.0}), (1, {"separation_m": 500.0})])
def test_least_delays_are_proven(tmp_path: Path, seed: int, more: dict[str, float]) -> None:
    """Nothing is met at the least delay, and something within the tolerance a few microseconds before."""
    scene, areas, tracks = delayed_scene(seed, **more)
    least = {one.key: one.least_later_s for one in delays(tracks, areas, scene)}
    made = certify(tracks, areas, tmp_path / "proof", scene, delays=list(least))
    assert made
    assert made.delays == sum(bool(one) for one in least.values()) > 0
    status, report = checked(tmp_path / "proof")
    assert (status, f"{made.delays} least delays proven" in report) == (ACCEPTED, True), report
    parts = check_proof.read((tmp_path / "proof").read_text().splitlines(keepends=True))
    lines = [one for one in parts["verdicts"] if "delay" in one]
    assert {one["delay"]: one["least_us"] / 1e6 for one in lines} == {key: one for key, one in least.items() if one}
    assert all(one["error_us"] < 1000 for one in lines)


def test_least_delays_without_proof_are_refused(tmp_path: Path) -> None:
    """One sentence for each plan whose delay is another motion than that of a track."""
    area = Area("closed", shapely.box(5.2, 55.9, 5.3, 56.1), start_us=0, end_us=3_600_000_000)
    given = SHIP.positions_deg, SHIP.times_us, SHIP.outline_m
    daily = {"periods": [["10:00", "11:00"]], "timezone": "UTC", "from": "2026-12-01"}
    tracks = [Track("daily", *given, schedule=daily), Track("wide", *given, tolerances={"xtd_port_m": [5.0]})]
    for key, why in (("closed", "is an area"), ("daily", "has a schedule"), ("wide", "or tolerances")):
        with quietly(), pytest.raises(InvalidInput, match=f"{key!r} .*{why}.*leave it out"):
            certify(tracks, [area], tmp_path / "proof", delays=[key])
        assert not (tmp_path / "proof").exists()


def test_forged_least_delays_are_refused(tmp_path: Path) -> None:
    """Another delay, a contact that is lost or elsewhere, or one of other plans."""
    scene, areas, tracks = delayed_scene(1)
    key = next(one.key for one in delays(tracks, areas, scene) if one.least_later_s)
    certify(tracks, areas, tmp_path / "proof", scene, delays=[key])
    parts = check_proof.read((tmp_path / "proof").read_text().splitlines(keepends=True))
    assert forged.outcome(parts) == "accepted"
    for change in ({"least_us": 1_000_000}, {"error_us": 0}, {"least_us": 0}, {"least_us": 1.5}, {"delay": "none"}):
        verdicts = [one | (change if "delay" in one else {}) for one in parts["verdicts"]]
        assert forged.outcome({**parts, "verdicts": verdicts}) == "refused", change
    for by_us in (10**6, -(10**6), 10**12):
        verdicts = [
            one | ({"least_us": one["least_us"] + by_us} if "delay" in one else {}) for one in parts["verdicts"]
        ]
        assert forged.outcome({**parts, "verdicts": verdicts}) == "refused", by_us
    late = [line for line in parts["proofs"] if line.startswith('["late"')]
    assert len(late) == 1
    rest = [line for line in parts["proofs"] if line not in late]
    assert forged.outcome({**parts, "proofs": rest}) == "refused"
    kind, p, q, turns, at, *points = json.loads(late[0])
    for line in (
        [kind, p, q, turns, at + 60.0, *points],
        ["contact", p, q, turns, at, *points],
        [kind, q, q, turns, at],
    ):
        assert forged.outcome({**parts, "proofs": [*rest, json.dumps(line)]}) == "refused", line


@pytest.fixture
def faulty_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A kernel that drops contacts which end as a plan does, to rounding, as it once did."""
    rule = "    return !(clearance(pair, beyond) < -encounter_certainty_margin_m(pair));"
    files = []
    for path in (path for path in build.sources() if path.suffix == ".c"):
        text = path.read_text()
        if path.name == "search.c":
            begins = "    if (!(begins > 0.0 && begins >= beyond - END_RESOLUTION_S)) return false;\n"
            assert begins + rule in text
            text = text.replace(begins, "    (void)begins;\n")
            path = tmp_path / path.name
            path.write_text(text)
        files.append(path)
    made = tmp_path / "faulty.so"
    define = f'-DKERNEL_FINGERPRINT="{build.fingerprint()}"'
    command = ["cc", *build.FLAGS, "-O0", define, "-o", made, *files, *build.SHARED]
    subprocess.run(command, check=True, timeout=600)
    monkeypatch.setattr(build, "library", lambda: made)
    library.library.cache_clear()
    yield
    monkeypatch.undo()
    library.library.cache_clear()


def test_a_conflict_that_a_faulty_kernel_drops_is_noticed(tmp_path: Path, faulty_kernel: None) -> None:
    """A ship is in an area for 47 minutes, until its plan ends: nothing proves the two apart, so there is no proof."""
    area = Area("closed", shapely.box(5.05, 56.818, 5.323, 56.905))
    haven_m = [(-20, 281), (20, 281), (20, -281), (-20, -281)]
    start_us = 1_780_000_000_000_000
    ship = Track("ship", [(5.1865, 56.718), (5.1865, 56.90752338860283)], [start_us, start_us + 5_887_000_000], haven_m)
    scene = Scene("s", tolerance_m=0.0)
    assert not solve([ship], [area], scene), "the fault is not put back"
    made = certify([ship], [area], tmp_path / "proof", scene)
    assert not made
    assert made.unproven_pairs == 1
    status, report = checked(tmp_path / "proof")
    assert status == REFUSED
    assert "'closed' and 'ship': pieces 0 and 2 are not proven apart from 2026-05-28 21:17:07" in report
