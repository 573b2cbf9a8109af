"""Takes a scene through transaction 1, and computes by brute force the pairs that stages 1 and 2 must find in it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import psycopg
import shapely

from conflictdb import store
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Area, Scene, Track

Conn = psycopg.Connection[Any]


@dataclass(frozen=True)
class Stored:
    """A piece as stored in the table."""

    piece_id: int
    key: str
    is_track: bool
    part: int
    turn: int
    hull: shapely.Polygon
    start: float
    end: float
    floor_m: float
    ceiling_m: float


def load(conn: Conn, scene: Scene, areas: list[Area], tracks: list[Track]) -> int:
    """Load a scene and return its number."""
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    return store.scene_id(conn, scene.name)


def mark_all(conn: Conn, scene_id: int) -> int:
    """Mark every object of a scene as changed, and return their number."""
    row = conn.execute("SELECT conflictdb_internal._mark_all(%s)", [scene_id]).fetchone()
    assert row is not None
    return int(row[0])


def refresh(conn: Conn, scene_id: int) -> Pieces:
    """Make the pieces of changed objects, as a detection does, and return them."""
    store.begin_snapshot(conn)
    settings = store.read_settings(conn, scene_id)
    areas, tracks = store.changed_areas(conn, scene_id), store.changed_tracks(conn, scene_id)
    pieces = pieces_of(Setup.of(settings), areas, tracks)
    store.replace_pieces(conn, scene_id, [bundles_of(pieces)])
    conn.commit()
    return pieces


def write_run(conn: Conn, scene_id: int, run: store.RunRecord, found: Conflicts) -> store.RunOutcome:
    """Write back conflicts, in two parts, in the open transaction."""
    staged = store.begin_write(conn, scene_id, run)
    for rows in np.array_split(np.arange(len(found)), 2):
        stage(conn, staged, found.take(rows))
    return store.end_write(conn, staged, run)


def stage(conn: Conn, staged: store.Staged, found: Conflicts) -> None:
    """Hand over a part of the conflicts, as a detection does."""
    for part in store.differing(staged, found):
        store.stage(conn, staged, part, found.where(part.rows))


def stored_pieces(conn: Conn, scene_id: int) -> list[Stored]:
    """Return all pieces of a scene; spans as seconds since 1970."""
    rows = conn.execute(
        """SELECT p.piece_id, coalesce(a.key, t.key), p.object_kind = 1, p.part, p.turn, p.hull::text,
                  coalesce(extract(epoch FROM lower(p.span))::float8, '-infinity'),
                  coalesce(extract(epoch FROM upper(p.span))::float8, 'infinity'), p.floor_m, p.ceiling_m
           FROM conflictdb.piece p
           LEFT JOIN conflictdb.area a ON p.object_kind = 0 AND a.area_id = p.object_id
           LEFT JOIN conflictdb.track t ON p.object_kind = 1 AND t.track_id = p.object_id
           WHERE p.scene_id = %s""",
        [scene_id],
    ).fetchall()
    return [Stored(*row[:5], shapely.from_wkb(row[5]), *row[6:]) for row in rows]


def expected_pairs(pieces: list[Stored], grown: float = 0.0) -> set[frozenset[int]]:
    """Return the pairs (of piece numbers) whose boxes, grown by this many metres, meet in space, time and height."""
    box = shapely.bounds([p.hull for p in pieces]).reshape(-1, 4)
    start, end = np.array([p.start for p in pieces]), np.array([p.end for p in pieces])
    floor, ceiling = np.array([p.floor_m for p in pieces]), np.array([p.ceiling_m for p in pieces])
    turned = np.array([p.turn != 0 for p in pieces])
    found = set()
    for i, piece in enumerate(pieces):
        meet = (box[:, 0] <= box[i, 2] + grown) & (box[i, 0] <= box[:, 2] + grown)
        meet &= (box[:, 1] <= box[i, 3] + grown) & (box[i, 1] <= box[:, 3] + grown)
        # Spans that only touch may or may not share the instant; the database decides, a superset here.
        meet &= (start < end[i] + grown) & (start[i] < end + grown)
        meet &= (floor < ceiling[i]) & (floor[i] < ceiling)
        meet &= ~(turned & turned[i])
        for j in np.flatnonzero(meet):
            other = pieces[j]
            if (other.key, other.is_track) != (piece.key, piece.is_track):
                found.add(frozenset((piece.piece_id, other.piece_id)))
    return found
