"""Peers on the same scene in the same run: time, answers, misses and omissions of each.

    ./.venv/bin/python benchmarks/peers.py [--objects 800 5000] [--turns 3] [--dsn DSN] [--without paper ...]
        [--document docs/explanation/performance.md] [--folder docs/explanation/performance] [--environment DIRECTORY]

Scenes of the paper's random workload (made_scenes.py), mixed and of tracks alone, on the sphere, tolerance 0. The truth
is the product's own `exact`, which is certified (docs/explanation/accuracy.md compares it with brute force).

    conflictdb            detection in the database, all rows new; and the stages in memory (`solve`: shapely's
                          STRtree, then the kernel)
    stages 1 and 2        those of that detection: who might meet
    paper                 its pipeline in Python (paper_pipeline.py)
    PostGIS               swept hulls in a table with a GiST index: ST_Intersects and spans; tracks as LineStringM
                          with circles around the havens: ST_CPAWithin
    SedonaDB              the same join of swept hulls
    MEOS                  `tdwithin` of moving points, in the plane, with the same circles

The times of peers exclude making legs and their swept hulls; those of conflictdb include its own. Seconds are the
median of the turns, by the clock and of all processors (client and server). SedonaDB and PyMEOS come from PyPI into an
environment of their own, which is created if missing. Peers that cannot be installed are reported and left out. A peer
that takes longer than ten seconds has one turn.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
import psycopg
import shapely
from made_scenes import Kind, box
from measured import detect, fresh_database, load, processor_clock, versions, write_csv
from numpy.typing import NDArray
from paper_pipeline import Answers, solve_pieces
from published import whole_legs
from tables import markdown, show

import conflictdb
from conflictdb import Area, EarthModel, Scene, Track
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.geodesy import earth_of
from conflictdb.earth.registry import Setup
from conflictdb.model.results import Kind as ObjectKind

PACKAGES: Final = {"sedona": ["sedonadb", "pyarrow", "geoarrow-pyarrow", "numpy", "shapely"], "meos": ["pymeos"]}
SECOND_US: Final = 1_000_000
LONG_S: Final = 10.0  # slower peers are not repeated
SPHERE_M: Final = earth_of(EarthModel.SPHERE).radius_m

Pair = tuple[str, str]
Spans = dict[Pair, tuple[int, int]]


@dataclass(frozen=True)
class PeerAnswer:
    """Answer and cost of one peer for a scene.

    spans : pairs and their first and last instant, microseconds; (0, 0) if it does not report times
    seconds, cpu_s : of each turn, by the clock and of processors
    """

    peer: str
    spans: Spans
    seconds: Sequence[float]
    cpu_s: Sequence[float]
    answers: str
    leaves_out: str
    tracks_only: bool = False


@dataclass(frozen=True)
class Given:
    """A scene, and its objects as one piece each: convex areas and whole legs, with swept hulls."""

    scene: Scene
    areas: list[Area]
    tracks: list[Track]
    pieces: Pieces

    @classmethod
    def of(cls, kind: Kind, objects: int) -> "Given":
        """Throw a scene."""
        scene, areas, tracks = box(kind, objects, 1)
        scene = replace(scene, name=f"{kind} {objects}", earth=EarthModel.SPHERE, tolerance_m=0.0)
        with whole_legs():
            pieces = pieces_of(Setup.of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
        return cls(scene, areas, tracks, pieces)

    def key(self, row: int) -> str:
        """Return the key of the object of a piece."""
        objects = self.tracks if self.pieces.kind[row] == ObjectKind.TRACK.code else self.areas
        return objects[int(self.pieces.object_id[row])].key

    def spans(self, a: NDArray[Any], b: NDArray[Any], first_us: NDArray[Any], last_us: NDArray[Any]) -> Spans:
        """Return pairs of pieces as pairs of objects, from the first to the last instant of all of their pieces."""
        found: Spans = {}
        for i, j, first, last in zip(*(column.tolist() for column in (a, b, first_us, last_us)), strict=True):
            one, other = sorted((self.key(i), self.key(j)))
            if one == other:
                continue
            known = found.get((one, other), (first, last))
            found[one, other] = min(first, known[0]), max(last, known[1])
        return found

    def save(self, path: Path) -> None:
        """Write the input of peers in other environments: hulls, spans, legs in the plane, circles around havens."""
        plane, pieces = Setup.of(self.scene).plane, self.pieces
        ends = [
            np.stack(plane.to_plane(*end.T), axis=1) + np.array([[plane.turn_m, 0.0]]) * pieces.turn[:, None]
            for end in (pieces.leg_start_deg, pieces.leg_end_deg)
        ]
        np.savez(
            path,
            hull_xy=pieces.hull_xy,
            hull_offset=pieces.hull_offset,
            object=pieces.object_id + np.where(self.moves, len(self.areas), 0),
            moves=self.moves,
            start_us=np.maximum(pieces.start_us, 0),
            end_us=np.minimum(pieces.end_us, 2**61),
            leg_start_xy=ends[0],
            leg_end_xy=ends[1],
            reach=self.reach(ends),
        )

    @property
    def moves(self) -> NDArray[np.bool_]:
        """Whether each piece is of a track."""
        return np.asarray(self.pieces.kind == ObjectKind.TRACK.code)

    def reach(self, ends: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return radii, metres of the plane, of circles around havens, where the leg's plane is stretched most."""
        far = np.hypot(*self.pieces.shape_xy.T)
        radius = np.maximum.reduceat(far, self.pieces.shape_offset[:-1])
        rim = [np.abs(end[:, 1]) / SPHERE_M + radius / SPHERE_M for end in ends]
        return np.asarray(np.where(self.moves, radius * np.cosh(np.maximum(*rim)), 0.0))


def in_turns(
    work: Callable[[], Any], turns: int, processor: Callable[[], float] | None = time.process_time
) -> tuple[Any, list[float], list[float]]:
    """Return the last answer, and the seconds of each turn: by the clock, and of processors (none: nothing)."""
    answer, seconds, cpu = None, [], []
    for _ in range(turns):
        began, began_cpu = time.perf_counter(), processor() if processor else 0.0
        answer = work()
        seconds.append(time.perf_counter() - began)
        if processor:
            cpu.append(processor() - began_cpu)
        if seconds[-1] > LONG_S:
            break
    return answer, seconds, cpu


def product(dsn: str, given: Given, turns: int) -> list[PeerAnswer]:
    """Return the answers of conflictdb: in the database, its first two stages, and in memory."""
    found = []
    with conflictdb.connect(dsn) as db:
        for turn in range(turns):
            name = f"{given.scene.name} {turn}"
            load(db, replace(given.scene, name=name), [(given.areas, given.tracks)])
            found.append(detect(db, name))
        spans = _spans(db.scene(name).conflicts())
    whole = PeerAnswer(
        "conflictdb",
        spans,
        [one.total_s for one in found],
        [one.cpu_s for one in found if one.cpu_s],
        "periods with proven bounds, where, in the database",
        "nothing of this scene",
    )
    solved, seconds, cpu = in_turns(lambda: conflictdb.solve(given.tracks, given.areas, given.scene), turns)
    memory = PeerAnswer(
        "conflictdb in memory", _spans(solved), seconds, cpu, "periods with proven bounds", "a database"
    )
    screened = replace(given.scene, method=conflictdb.Method.SCREEN)
    might = _spans(conflictdb.solve(given.tracks, given.areas, screened))
    first = [one.stage1_s + one.stage2_s for one in found]
    return [whole, memory, PeerAnswer("its stages 1 and 2", _timeless(might), [], first, "who might meet", "when")]


def _spans(conflicts: Sequence[conflictdb.Conflict]) -> Spans:
    """Return from when to when pairs interfere; always: from the first to the last instant that peers are given."""
    return {
        (min(c.a_key, c.b_key), max(c.a_key, c.b_key)): (
            0 if c.first_contact is None else round(c.first_contact.timestamp() * 1e6),
            2**61 if c.last_contact is None else round(c.last_contact.timestamp() * 1e6),
        )
        for c in conflicts
    }


def _timeless(spans: Spans) -> Spans:
    return dict.fromkeys(spans, (0, 0))


def paper(given: Given, turns: int) -> PeerAnswer:
    """Return the answer of the paper's pipeline."""
    earth = earth_of(given.scene.earth)
    found: Answers
    found, seconds, cpu = in_turns(lambda: solve_pieces(earth, given.pieces), turns)
    spans = given.spans(found.a, found.b, found.first_us, found.last_us)
    return PeerAnswer("the paper in Python", spans, seconds, cpu, "one period each", "bounds; proof; all but convex")


_TABLES: Final = """
CREATE TEMPORARY TABLE swept (row int, object int, span int8range, hull geometry);
CREATE TEMPORARY TABLE sailed (row int, object int, reach float8, path geometry, box geometry);
"""
_INDEXES: Final = """
CREATE INDEX ON swept USING gist (hull); CREATE INDEX ON sailed USING gist (box); ANALYZE swept; ANALYZE sailed;
"""
_INTERSECTS: Final = """
SELECT a.row, b.row FROM swept a JOIN swept b ON ST_Intersects(a.hull, b.hull) AND a.span && b.span
WHERE a.object < b.object
"""
_CPA_WITHIN: Final = """
SELECT a.row, b.row FROM sailed a JOIN sailed b ON a.box && b.box AND ST_CPAWithin(a.path, b.path, a.reach + b.reach)
WHERE a.object < b.object
"""


def postgis(dsn: str, given: Given, path: Path, turns: int) -> list[PeerAnswer]:
    """Return the answers of plain PostGIS: of swept hulls, and of circles around tracks."""
    columns = np.load(path)
    hulls = shapely.polygons(
        shapely.linearrings(
            columns["hull_xy"], indices=np.repeat(np.arange(len(given.pieces)), np.diff(columns["hull_offset"]))
        )
    )
    found = []
    with psycopg.connect(dsn) as conn:
        conn.execute(_TABLES)
        with conn.cursor().copy("COPY swept FROM STDIN") as copy:
            for i, wkb in enumerate(shapely.to_wkb(hulls, hex=True)):
                span = f"[{columns['start_us'][i]},{columns['end_us'][i]})"
                copy.write_row((i, int(columns["object"][i]), span, wkb))
        with conn.cursor().copy("COPY sailed FROM STDIN") as copy:
            for i in np.flatnonzero(columns["moves"]).tolist():
                (x0, y0), (x1, y1), reach = columns["leg_start_xy"][i], columns["leg_end_xy"][i], columns["reach"][i]
                s0, s1 = columns["start_us"][i] / SECOND_US, columns["end_us"][i] / SECOND_US
                line = f"LINESTRING M({x0!s} {y0!s} {s0!s}, {x1!s} {y1!s} {s1!s})"
                around = shapely.to_wkt(
                    shapely.box(min(x0, x1) - reach, min(y0, y1) - reach, max(x0, x1) + reach, max(y0, y1) + reach),
                    rounding_precision=-1,
                )
                copy.write_row((i, int(columns["object"][i]), float(reach), line, around))
        conn.execute(_INDEXES)
        for name, query, leaves_out, tracks_only in (
            ("PostGIS, ST_Intersects", _INTERSECTS, "when; motion", False),
            ("PostGIS, ST_CPAWithin", _CPA_WITHIN, "when; areas; polygons (circles)", True),
        ):
            rows, seconds, cpu = in_turns(
                lambda query=query: conn.execute(query).fetchall(), turns, processor_clock(conn)
            )
            a, b = np.array(rows, np.int64).reshape(-1, 2).T
            nothing = np.zeros(len(a), np.int64)
            spans = given.spans(a, b, nothing, nothing)
            found.append(PeerAnswer(name, spans, seconds, cpu, "who might meet", leaves_out, tracks_only))
    return found


def elsewhere(name: str, python: Path, given: Given, folder: Path, turns: int) -> PeerAnswer:
    """Return the answer of a peer in another environment."""
    command = [str(python), str(Path(__file__).with_name("peers_elsewhere.py")), name, str(folder), str(turns)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{name}: {done.stderr.strip()[-400:]}")
    said, found = json.loads(done.stdout), np.load(folder / f"{name}.npz")
    spans = given.spans(*(found[column] for column in ("a", "b", "first_us", "last_us")))
    title, answers, leaves_out = {
        "sedona": ("SedonaDB {}, ST_Intersects", "who might meet", "when; motion"),
        "meos": ("PyMEOS {}, tdwithin", "one period each", "bounds; areas; polygons (circles)"),
    }[name]
    seconds, cpu = said["seconds"], said["cpu"]
    return PeerAnswer(title.format(said["version"]), spans, seconds, cpu, answers, leaves_out, name == "meos")


def environment(folder: Path) -> tuple[Path, list[str]]:
    """Make the environment of the peers where it is missing; returns its Python and the peers that are in it."""
    python = folder / "bin" / "python"
    if not python.exists():
        print(f"making {folder} for peers", file=sys.stderr)
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        for name, packages in PACKAGES.items():
            command = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", *packages]
            if subprocess.run(command, check=False).returncode:
                print(f"left out: {name}: {' '.join(packages)} cannot be installed here", file=sys.stderr)
    known = []
    for name, packages in PACKAGES.items():
        if (
            subprocess.run([str(python), "-c", f"import {packages[0]}"], check=False, capture_output=True).returncode
            == 0
        ):
            known.append(name)
        else:
            print(f"left out: {name}: not in {folder}", file=sys.stderr)
    return python, known


def row_of(given: Given, answer: PeerAnswer, truth: Spans) -> dict[str, Any]:
    """Return a row: the cost of a peer, and its answer against the truth."""
    held = {pair: span for pair, span in truth.items() if not answer.tracks_only or (pair[0][0] == pair[1][0] == "T")}
    timed = [
        max(abs(answer.spans[pair][0] - span[0]), abs(answer.spans[pair][1] - span[1])) / 1e6
        for pair, span in held.items()
        if not answer.peer.startswith("conflictdb")
        and answer.spans.get(pair, (0, 0))[1]
        and span[0] > 0
        and "T" in pair[0][0] + pair[1][0]
    ]
    return {
        "scene": given.scene.name,
        "peer": answer.peer,
        "seconds": median(answer.seconds) if answer.seconds else None,
        "cpu_s": median(answer.cpu_s) if answer.cpu_s else None,
        "reported": len(answer.spans),
        "meet": len(held),
        "missed": len(held.keys() - answer.spans.keys()),
        "false": len(answer.spans.keys() - held.keys()),
        "end_median_s": median(timed) if timed else None,
        "end_worst_s": max(timed) if timed else None,
        "answers": answer.answers,
        "leaves_out": answer.leaves_out,
    }


def compare(dsn: str, kind: Kind, objects: int, turns: int, python: Path, names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the rows of one scene.

    names : available peers
    """
    given = Given.of(kind, objects)
    answers = product(dsn, given, turns)
    truth = answers[0].spans
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        given.save(folder / "given.npz")
        if "paper" in names:
            answers.append(paper(given, turns))
        if "postgis" in names:
            answers += postgis(dsn, given, folder / "given.npz", turns)
        answers += [elsewhere(name, python, given, folder, turns) for name in PACKAGES if name in names]
    return [row_of(given, one, truth) for one in answers]


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return a table in Markdown."""
    heads = (
        "scene",
        "by",
        "s",
        "processor, s",
        "reported",
        "missed",
        "false",
        "ends off: median / worst",
        "answers",
        "leaves out",
    )
    lines = [
        [
            row["scene"],
            row["peer"],
            "" if row["seconds"] is None else f"{row['seconds']:.3g}",
            "" if row["cpu_s"] is None else f"{row['cpu_s']:.3g}",
            f"{row['reported']:,} of {row['meet']:,}",
            f"{row['missed']:,}",
            f"{row['false']:,}",
            "" if row["end_median_s"] is None else f"{row['end_median_s']:.2g} / {row['end_worst_s']:.2g} s",
            row["answers"],
            row["leaves_out"],
        ]
        for row in rows
    ]
    return markdown(heads, lines)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server to make a database on (default: the embedded one)")
    parser.add_argument("--objects", type=int, nargs="+", default=[800, 5_000])
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--without", nargs="*", default=[], choices=["paper", "postgis", *PACKAGES])
    root = Path(__file__).resolve().parents[1]
    parser.add_argument("--environment", type=Path, default=root / ".venv-peers", help="of SedonaDB and PyMEOS")
    parser.add_argument("--folder", type=Path, help="write peers.csv there")
    parser.add_argument("--document", type=Path, help="put the table there")
    args = parser.parse_args()
    python, known = args.environment / "bin" / "python", []
    if not set(PACKAGES) <= set(args.without):
        python, known = environment(args.environment)
    names = [name for name in ("paper", "postgis", *known) if name not in args.without]
    rows = []
    with fresh_database(args.dsn) as dsn:
        for objects in args.objects:
            for kind in (Kind.MIXED, Kind.TRACKS):
                rows += compare(dsn, kind, objects, args.turns, python, names)
        with conflictdb.connect(dsn) as db:
            software = versions(db.connection)
    text = f"{table(rows)}\n\n{software}."
    show(text, "peers", args.document)
    if args.folder:
        write_csv(args.folder / "peers.csv", rows)


if __name__ == "__main__":
    main()
