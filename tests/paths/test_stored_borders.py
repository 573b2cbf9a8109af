"""Every field of areas and tracks on its way into a database, through its parts, and out of it (`test_borders`)."""

import json
import struct
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import psycopg
import pytest
import shapely
from city import worker_connected
from full_plans import HOUR_US, SCENE, Border, Plan, area, lost, track, values_of
from numpy.typing import NDArray

from conflictdb import formats, store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.client.database import connect
from conflictdb.client.stored_scene import StoredScene
from conflictdb.core.pieces.digests import area_digests, track_digests
from conflictdb.errors import ConflictDBError
from conflictdb.formats.instants import format_instant
from conflictdb.formats.scene_file import plans_text, read_plans
from conflictdb.jobs import probes
from conflictdb.model.plan_columns import AREA, TRACK, columns_of
from conflictdb.model.plans import Area, Track
from conflictdb.model.proposals import Goal, Move, Proposal
from conflictdb.model.recurring_plans import later
from conflictdb.store.object_state_rows import object_states
from conflictdb.store.proposal_rows import proposal_basis, put_proposal

# Columns of tables, parameters of put_area and put_track, and members of plans of admit, by field.
AREA_NAMES, TRACK_NAMES = (
    {"key": "key"} | {field: one.name for one in columns_of(kind) for field in one.python} for kind in (AREA, TRACK)
)
TRACK_NAMES |= {"legs": None}  # checked before, and not stored


Way = Callable[[StoredScene, Plan], Plan]


@pytest.fixture
def scene(dsn: str) -> Iterator[StoredScene]:
    with connect(dsn) as db:
        store.set_scene(db.connection, SCENE)
        yield db.scene(SCENE.name)


def stored(scene: StoredScene, key: str) -> Plan:
    """Return an object of a scene as it is stored."""
    _, areas, tracks = store.read_scene(scene.connection, scene.name, [key])
    (one,) = [*areas, *tracks]
    return one


def span_text(span: tuple[int | None, int | None]) -> str:
    start, end = ("" if at is None else format_instant(at) for at in span)
    return f"[{start},{end})"


def hex_of(shape: shapely.Geometry, srid: int) -> str:
    return str(shapely.to_wkb(shapely.set_srid(shape, srid), hex=True, include_srid=True))


def path_of(track: Track) -> str:
    """Return a LineStringM as hexadecimal EWKB."""
    points = np.column_stack([track.positions_deg, track.times_us / 1e6])
    return (struct.pack("<BIII", 1, 0x60000002, 4326, len(points)) + points.astype("<f8").tobytes()).hex()


def rings_of(outlines_m: NDArray[np.float64]) -> shapely.MultiPolygon:
    return shapely.MultiPolygon([shapely.Polygon(one) for one in outlines_m])


def heights_of(given: NDArray[np.float64] | None) -> list[float | None] | None:
    return None if given is None else [one if np.isfinite(one) else None for one in given.tolist()]


def sql_members(plan: Plan) -> dict[str, Any]:
    """Return what SQL is given for a plan, by the names of its columns; None: nothing."""
    names = AREA_NAMES if isinstance(plan, Area) else TRACK_NAMES
    assert names.keys() == values_of(type(plan)).keys()
    found: dict[str, Any] = {name: getattr(plan, each) for each, name in names.items() if name is not None}
    if isinstance(plan, Area):
        span, spans = (plan.start_us, plan.end_us), plan.spans_us
        found["footprint"] = hex_of(plan.footprint, 4326)
        found["active_span"] = None if spans is not None or span == (None, None) else span_text(span)
        found["activations"] = None if spans is None else f"{{{','.join(map(span_text, spans))}}}"
    else:
        found["path"] = path_of(plan)
        found["outline"] = hex_of(shapely.Polygon(plan.outline_m), 0)
        found["outlines"] = None if plan.outlines_m is None else hex_of(rings_of(plan.outlines_m), 0)
        found["floors_m"], found["ceilings_m"] = heights_of(plan.floors_m), heights_of(plan.ceilings_m)
        found["departures"] = None if plan.departures_us is None else [format_instant(at) for at in plan.departures_us]
        for name in ("floor_m", "ceiling_m"):
            found[name] = None if found[f"{name[:-2]}s_m"] is not None else found[name]
    return found


def put_in_sql(scene: StoredScene, plan: Plan) -> None:
    given = {name: value for name, value in sql_members(plan).items() if value is not None}
    values = [json.dumps(one) if isinstance(one, dict) else one for one in given.values()]
    arguments = ", ".join(f"p_{name} => %s" for name in given)
    routine = "put_area" if isinstance(plan, Area) else "put_track"
    run(scene, f"SELECT conflictdb.{routine}(%s, {arguments})", [scene.name, *values])


def run(scene: StoredScene, query: str, values: list[Any]) -> Any:
    try:
        return scene.connection.execute(query.encode(), values).fetchone()
    except psycopg.Error as error:
        raise ConflictDBError(str(error)) from error


def first_of(plan: Plan) -> Plan:
    """Return the plain object whose place a plan takes."""
    return area(key=plan.key) if isinstance(plan, Area) else track(key=plan.key)


def by_put(scene: StoredScene, plan: Plan) -> Plan:
    scene.put(plan)
    return stored(scene, plan.key)


def by_put_again(scene: StoredScene, plan: Plan) -> Plan:
    """The plan takes the place of a plain one: only the fields that differ tell that it is another one."""
    scene.put(first_of(plan))
    scene.put(plan)
    return stored(scene, plan.key)


def by_sql(scene: StoredScene, plan: Plan) -> Plan:
    put_in_sql(scene, plan)
    return stored(scene, plan.key)


def by_sql_again(scene: StoredScene, plan: Plan) -> Plan:
    put_in_sql(scene, first_of(plan))
    put_in_sql(scene, plan)
    return stored(scene, plan.key)


def by_export(folder: Path, name: str) -> Callable[[StoredScene, Plan], Plan]:
    """Return a function that loads a plan, exports its scene and reads the file."""

    def carry(scene: StoredScene, plan: Plan) -> Plan:
        scene.put(plan)
        scene.export(folder / name)
        read = formats.read(folder / name)
        (one,) = [*read.areas, *read.tracks]
        return one

    return carry


def by_branch(scene: StoredScene, plan: Plan) -> Plan:
    """A plan in a branch takes the place of a plain one of the scene: the branch names it, and merges it."""
    first = first_of(plan)
    scene.put(first)
    branch = scene.branch("branch")
    branch.put(plan)
    shown = stored(branch, plan.key)
    if lost(shown, stored(scene, plan.key)):
        changes = run(scene, "SELECT array_agg(change || ' ' || key) FROM conflictdb.branch_objects('branch')", [])
        assert changes == ([f"changed {plan.key}"],)
    branch.merge()
    assert not lost(shown, stored(scene, plan.key))
    return shown


def by_new_in_branch(scene: StoredScene, plan: Plan) -> Plan:
    branch = scene.branch("branch")
    branch.put(plan)
    branch.merge()
    return stored(scene, plan.key)


def by_copy(scene: StoredScene, plan: Plan) -> Plan:
    scene.put(plan)
    return stored(scene.copy("copy"), plan.key)


def by_new_key(scene: StoredScene, plan: Plan) -> Plan:
    scene.put(plan)
    scene.rename_object(plan.key, "other")
    scene.rename_object("other", plan.key)
    return stored(scene, plan.key)


def by_admission(scene: StoredScene, plan: Plan) -> Plan:
    assert scene.admit(plan).is_admitted
    return stored(scene, plan.key)


def by_admission_in_sql(scene: StoredScene, plan: Plan) -> Plan:
    """SQL admits at once, or a worker does."""
    given = {name: value for name, value in sql_members(plan).items() if value is not None}
    try:
        with worker_connected(scene.connection.info.dsn), scene.connection.transaction():
            query = "SELECT admitted FROM conflictdb.admit(%s, %s::jsonb)"
            (admitted,) = run(scene, query, [scene.name, json.dumps([given])])
        while probes.answer(scene.connection):
            assert admitted is None
        return stored(scene, plan.key)
    finally:
        scene.delete_objects(*(one.key for one in scene.objects()))


def by_request(scene: StoredScene, plan: Plan) -> Plan:
    """The plan that a worker reads."""
    number = store.request_probe(scene.connection, scene.name, plans_text([plan]))
    request = store.read_request(scene.connection, number)
    (one,) = read_plans(request.plans or "", scene.settings(), request.max_speed_kn)
    return one


def by_proposal(scene: StoredScene, plan: Plan) -> Plan:
    """A proposal delays a track; undone, it is as before."""
    assert isinstance(plan, Track)
    scene.put(plan)
    conn, moved = scene.connection, later(plan, HOUR_US)
    number = store.scene_or_branch_id(conn, scene.name)
    move = Move(plan.key, HOUR_US / 1e6, 1.0, (), ())
    proposal = Proposal((move,), (), Goal.TOTAL, 3600.0, 3600.0, is_least=True)
    proposal_id = put_proposal(conn, number, proposal_basis(conn, number), proposal, {plan.key: moved})
    store.apply_proposal(conn, proposal_id, attached=False)
    back = later(stored(scene, plan.key), -HOUR_US)
    store.undo_proposal(conn, proposal_id, attached=False)
    assert not lost(plan, stored(scene, plan.key))
    return back


def by_detection(scene: StoredScene, plan: Plan) -> Plan:
    """The columns that a detection reads give the digest of the plan; it has all fields on which conflicts depend."""
    scene.put(plan)
    states = object_states(scene.connection, store.scene_or_branch_id(scene.connection, scene.name))
    mine = area_digests(AreaBatch.of([plan])) if isinstance(plan, Area) else track_digests(TrackBatch.of([plan]))
    return plan if states.digest.tolist() == mine.tolist() else first_of(plan)


def by_table(scene: StoredScene, plan: Plan) -> Plan:
    """An attached table with a column for each field."""
    given = {name: value for name, value in sql_members(plan).items() if value is not None}
    conn, kind = scene.connection, "area" if isinstance(plan, Area) else "track"
    columns, marks = ", ".join(given), ", ".join(["%s"] * len(given))
    values = [json.dumps(one) if isinstance(one, dict) else one for one in given.values()]
    try:
        with conn.transaction():
            conn.execute(f"CREATE TABLE public.plan AS SELECT {columns} FROM conflictdb.{kind} WITH NO DATA".encode())
            conn.execute(f"INSERT INTO public.plan ({columns}) VALUES ({marks})".encode(), values)
        names = {"active_span": "span"}
        scene.attach(kind, "public.plan", {names.get(name, name): name for name in given})
        scene.follow()
        left_out = [one.reason for one in scene.unmapped()]
        if left_out:
            raise ConflictDBError(left_out[0])
        return stored(scene, plan.key)
    finally:
        if scene.attachments():
            scene.detach("public.plan")
        with conn.transaction():
            conn.execute("DROP TABLE public.plan")


def undone(scene: StoredScene, way: Way) -> Callable[[Plan], Plan]:
    """Return a way whose changes are rolled back."""

    def carry(plan: Plan) -> Plan:
        with scene.connection.transaction(force_rollback=True):
            return way(scene, plan)

    return carry


# Ways that compare a plan with another one are gone by plans that differ in one field.
_IN_ADMISSIONS_OF_SQL: Final = {"refuses": {"schedule": "schedule"}, "is_slow": True}
STORED: Final[Mapping[str, tuple[Way, dict[str, Any]]]] = {
    "put": (by_put, {"is_slow": True}),
    "put again": (by_put_again, {}),
    "put in SQL": (by_sql, {"is_slow": True}),
    "put again in SQL": (by_sql_again, {}),
    "branch": (by_branch, {}),
    "new in a branch": (by_new_in_branch, {"is_slow": True}),
    "copy": (by_copy, {"is_slow": True}),
    "other key": (by_new_key, {"is_slow": True}),
    "admission": (by_admission, {"is_slow": True}),
    "request to a worker": (by_request, {}),
    "detection": (by_detection, {"refuses": {"schedule": "is not expanded"}}),
    "proposal": (by_proposal, {"kinds": (Track,), "changes": {"schedule": (), "departures_us": ()}}),
}


@pytest.mark.parametrize("name", STORED)
def test_every_field_at_borders_of_a_database(scene: StoredScene, name: str) -> None:
    way, rest = STORED[name]
    faults = list(Border(undone(scene, way), **rest).faults())
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize("name", ["plan.geojson", "plan.parquet"])
def test_every_field_in_exports_of_a_database(scene: StoredScene, tmp_path: Path, name: str) -> None:
    faults = list(Border(undone(scene, by_export(tmp_path, name)), is_slow=True).faults())
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(("way", "rest"), [(by_table, {}), (by_admission_in_sql, _IN_ADMISSIONS_OF_SQL)])
def test_every_field_in_several_transactions(scene: StoredScene, way: Way, rest: dict[str, Any]) -> None:
    """Attached tables, and plans that SQL and workers admit."""
    faults = list(Border(partial(way, scene), **{"is_slow": True, **rest}).faults())
    assert not faults, "\n".join(faults)
