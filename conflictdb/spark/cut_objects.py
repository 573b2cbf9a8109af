"""Cut objects into pieces on workers: batches of the form OBJECTS in, rows of pieces out.

A row contains a bundle of nearby parts of an area, or one slice of a track.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import shapely

from conflictdb.arrays.arrow.object_rows import OBJECTS, of_objects, to_objects
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.packed import WORD, packed
from conflictdb.arrays.pieces import Bundles
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.pieces.digests import area_digests, track_digests
from conflictdb.core.world import World, touched
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats.track_times import within_speed
from conflictdb.kernel.boxes import boxes_of
from conflictdb.model.plans import Area, Scene, Track, has_unknown_times, is_idle
from conflictdb.model.recurring_plans import Window
from conflictdb.model.results import Kind

# Bytes of objects cut at a time: their pieces take about ten times as much.
_AT_ONCE: Final = 4_000_000
# Of schedules: one without an activation; one of a database that is not understood.
IDLE: Final = "idle"
UNKNOWN: Final = "unknown"
# Number of an object without one.
NO_NUMBER: Final = -1
# A larger outline, in bytes (120 vertices), is not repeated in each row of its area: there may be many.
_MOST_CARRIED: Final = 2_000

# Start and end of times, microseconds.
TIMES: Final = pa.schema([pa.field("start_us", pa.int64()), pa.field("end_us", pa.int64())])

# Rows of pieces: their object, the box of their hulls (metres of the plane), span and heights, the packed pieces
# (`arrays.packed`), and the area's outline (WKB, degrees), which regions may need, or the plan of a track with
# tolerances. Each object also has a row of its
# own, with kind, key, number, version and digest (`core.pieces.digests`), its outline if that is large, and what is
# to be said of its schedule. A refused object is a row with only `refused`: JSON with key, field and rule.
SCHEMA: Final = pa.schema(
    [
        pa.field("kind", pa.int8()),
        pa.field("key", pa.string()),
        pa.field("turn", pa.int16()),
        pa.field("west", pa.float64()),
        pa.field("south", pa.float64()),
        pa.field("east", pa.float64()),
        pa.field("north", pa.float64()),
        pa.field("start_us", pa.int64()),
        pa.field("end_us", pa.int64()),
        pa.field("end_inclusive", pa.bool_()),
        pa.field("floor_m", pa.float64()),
        pa.field("ceiling_m", pa.float64()),
        pa.field("pieces", pa.binary()),
        pa.field("outline", pa.binary()),
        pa.field("object_id", pa.int64()),
        pa.field("version", pa.int64()),
        pa.field("digest", pa.int64()),
        pa.field("schedule", pa.string()),
        pa.field("refused", pa.string()),
    ]
)

_Plan = TypeVar("_Plan", Area, Track)


def check_case(who: str, names: Iterable[str]) -> None:
    """Raise InvalidInput for a column that differs from a known name only in case, and would be ignored."""
    for name in names:
        known = name.lower()
        if name != known and known in OBJECTS.schema.names:
            raise InvalidInput(who, f"column {name}", f"must be written {known}: rename it")


def touched_times(batches: Iterable[pa.RecordBatch], scene: Scene) -> Iterator[pa.RecordBatch]:
    """Yield, in the form TIMES, the times that the tracks of each batch may touch, for `cut`'s window.

    Batches with a refused object yield none: `cut` refuses it.
    """
    for batch in batches:
        with suppress(InvalidInput):
            span = touched(_objects(batch)[1], scene)
            if span is not None:
                yield pa.RecordBatch.from_arrays([pa.array([end], pa.int64()) for end in span], schema=TIMES)


def cut(
    batches: Iterable[pa.RecordBatch], scene: Scene, max_speed_kn: float = np.inf, window: Window | None = None
) -> Iterator[pa.RecordBatch]:
    """Yield the pieces of objects; a batch with a refused object is one row that says so.

    Of two with the same key the second is refused: they must be in the same batches.

    max_speed_kn : the speed over the ground beyond which a leg is refused, knots
    window : the time over which schedules are expanded; None: only given activations count
    """
    seen: set[str] = set()
    for batch in batches:
        rows = max(1, batch.num_rows * _AT_ONCE // max(batch.get_total_buffer_size(), 1))
        for first in range(0, batch.num_rows, rows):
            some = batch.slice(first, rows)
            try:
                _refuse_twins(some.column("id").to_pylist(), seen)
                yield from _pieces(some, World(Setup.of(scene), window), max_speed_kn)
            except InvalidInput as refusal:
                yield _refused(refusal)


def _refuse_twins(keys: list[str], seen: set[str]) -> None:
    for key in keys:
        if key in seen:
            raise InvalidInput(f"object {key!r}", "id", "occurs more than once: keys must be unique")
        seen.add(key)


def _objects(batch: pa.RecordBatch) -> tuple[list[Area], list[Track]]:
    """Return the objects of a batch; those of a database have numbers."""
    return to_objects(batch, are_stored=bool((_column(batch, "object_id", NO_NUMBER).to_numpy(False) >= 0).all()))


def _pieces(batch: pa.RecordBatch, world: World, max_speed_kn: float) -> Iterator[pa.RecordBatch]:
    """Yield the pieces of some objects, and these themselves."""
    given = _objects(batch)
    setup, scene = world.setup, world.setup.scene
    refusals = Refusals()
    within_speed(given[1], scene.motion, max_speed_kn, refusals)
    refusals.raise_found()
    areas, tracks = _active(world, *given)
    world.fit(areas, tracks)
    keys = {Kind.AREA: [area.key for area in areas], Kind.TRACK: [track.key for track in tracks]}
    of_kind = {kind: np.flatnonzero(_column(batch, "kind", "").to_numpy(False) == kind.value) for kind in Kind}
    versions, numbers = (
        {kind: _column(batch, name, value).to_numpy(False)[rows] for kind, rows in of_kind.items()}
        for name, value in (("version", 1), ("object_id", NO_NUMBER))
    )
    of_areas = replace(AreaBatch.of(areas), version=versions[Kind.AREA])
    of_tracks = replace(TrackBatch.of(tracks), version=versions[Kind.TRACK])
    states = of_areas, of_tracks
    if world.window is not None:
        states = AreaBatch.of(_states(given[0], areas)), TrackBatch.of(_states(given[1], tracks))
    pieces = pieces_of(setup, of_areas, of_tracks)
    is_slice = pieces.kind == Kind.TRACK.code
    parts, slices = (pieces.take(np.flatnonzero(one)) for one in (~is_slice, is_slice))
    bundles = Bundles.concatenate([bundles_of(parts), Bundles.of_each(slices)])
    pieces = bundles.pieces
    # Pieces number their objects within the batch.
    row = pieces.object_id + np.where(pieces.kind == Kind.TRACK.code, len(areas), 0)
    number = np.concatenate([numbers[Kind.AREA], numbers[Kind.TRACK]])
    outlines = shapely.to_wkb([area.footprint for area in areas])
    outline = pa.array([*outlines, *map(_plan, tracks)], pa.binary())
    is_carried = pc.less_equal(pc.binary_length(outline), _MOST_CARRIED)
    carried = pc.if_else(is_carried, outline, None)
    key, of = pa.array([*keys[Kind.AREA], *keys[Kind.TRACK]], pa.string()), pa.array(row[bundles.offset[:-1]])
    bundles = replace(bundles, pieces=replace(pieces, object_id=number[row]))
    yield rows_of(bundles, key.take(of), carried.take(of), scene.longest_time_us)
    large = pc.if_else(is_carried, None, outline)
    yield _rows_with(
        kind=pa.array(
            np.repeat([kind.code for kind in keys], [len(of_kind) for of_kind in keys.values()]).astype("i1")
        ),
        key=key,
        outline=large,
        object_id=pa.array(number),
        version=pa.array(np.concatenate([of_areas.version, of_tracks.version])),
        digest=pa.array(np.concatenate([area_digests(states[0]), track_digests(states[1])])),
        schedule=pa.array([*map(_said_of, areas), *map(_said_of, tracks)], pa.string()),
    )


def _active(world: World, areas: Sequence[Area], tracks: Sequence[Track]) -> tuple[list[Area], list[Track]]:
    """Return objects with the activations of their schedules in the window, and those that they have.

    A database expands over a time of its own: its activations count, too.
    """
    new_areas, new_tracks = world.expanded(areas, tracks)
    for i, (area, one) in enumerate(zip(areas, new_areas, strict=True)):
        if area.schedule is not None and area.spans_us is not None:
            new_areas[i] = replace(one, spans_us=(*area.spans_us, *(one.spans_us or ())))
    for i, (track, voyages) in enumerate(zip(tracks, new_tracks, strict=True)):
        if track.schedule is not None and track.departures_us is not None:
            both = {*track.departures_us, *(voyages.departures_us or ())}
            new_tracks[i] = replace(voyages, departures_us=tuple(sorted(both)), max_speed_kn=np.inf)
    return new_areas, new_tracks


def _states(given: Sequence[_Plan], active: Sequence[_Plan]) -> list[_Plan]:
    """Return objects with the activations that they have, by which a database knows their states."""
    own = (
        one.schedule is None or (one.spans_us if isinstance(one, Area) else one.departures_us) is not None
        for one in given
    )
    return [one if is_own else other for is_own, one, other in zip(own, given, active, strict=True)]


def _said_of(plan: Area | Track) -> str | None:
    return UNKNOWN if has_unknown_times(plan) else IDLE if is_idle(plan) else None


def _plan(track: Track) -> bytes | None:
    """Return the plan of a track with tolerances, for `read_plan`; None: it has none."""
    return None if track.tolerances is None else of_objects([], [track]).serialize().to_pybytes()


def read_plan(plan: bytes) -> Track:
    """Return the track that `_plan` has written."""
    return to_objects(pa.ipc.read_record_batch(pa.py_buffer(plan), OBJECTS.schema))[1][0]


def rows_of(bundles: Bundles, key: pa.Array, outline: pa.Array, within_us: int = 0) -> pa.RecordBatch:
    """Return bundles of pieces as rows, with the keys and outlines (n,) of their objects.

    within_us : microseconds; spans of rows meet if pieces come within this
    """
    pieces, first, last = bundles.pieces, bundles.offset[:-1], bundles.offset[1:] - 1
    words, offset = packed(pieces)
    boxes = boxes_of(pieces)
    low, high = (
        reduce.reduceat(some, first) if len(first) else some
        for reduce, some in ((np.minimum, boxes[:, :2]), (np.maximum, boxes[:, 2:]))
    )
    late = pieces.meeting_within(within_us)
    buffers = [None, pa.py_buffer((offset[bundles.offset] * WORD).astype(np.int32)), pa.py_buffer(words)]
    columns = [
        pa.array(pieces.kind[first]),
        key,
        pa.array(pieces.turn[first]),
        *(pa.array(np.ascontiguousarray(side)) for side in (*low.T, *high.T)),
        pa.array(late.start_us[first]),
        pa.array(late.end_us[last]),
        pa.array(pieces.end_inclusive[last]),
        pa.array(pieces.floor_m[first]),
        pa.array(pieces.ceiling_m[first]),
        pa.Array.from_buffers(pa.binary(), len(bundles), buffers),
        outline,
    ]
    rest = [pa.nulls(len(bundles), field.type) for field in list(SCHEMA)[len(columns) :]]
    return pa.RecordBatch.from_arrays([*columns, *rest], schema=SCHEMA)


def _column(batch: pa.RecordBatch, name: str, missing: object) -> pa.Array:
    """Return a column of a batch; nulls, or a missing column, are replaced by a value."""
    if batch.schema.get_field_index(name) < 0:
        return pa.array([missing] * batch.num_rows)
    return batch.column(name).fill_null(missing)


def _refused(refusal: InvalidInput) -> pa.RecordBatch:
    return _rows_with(refused=pa.array([json.dumps([refusal.key, refusal.field, refusal.rule, refusal.source])]))


def _rows_with(**known: pa.Array) -> pa.RecordBatch:
    """Return rows with the given columns; all others are null."""
    n = len(next(iter(known.values())))
    columns = [known.get(field.name, pa.nulls(n, field.type)) for field in SCHEMA]
    return pa.RecordBatch.from_arrays(columns, schema=SCHEMA)


def refusal_of(text: str) -> InvalidInput:
    """Parse the refusal in a row."""
    return InvalidInput(*json.loads(text))
