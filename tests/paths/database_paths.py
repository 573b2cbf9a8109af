"""Paths of scenes that a database stores.

`stored` puts and detects a scene once; paths that change it work in scenes of their own, which they remove.
"""

import json
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import timedelta
from enum import StrEnum
from functools import cached_property
from threading import Thread
from typing import Any, Final

import psycopg
import shapely
from case import PLACES, Case, Finding, Plan, Rows, idle_schedules, only_of, same
from city import worker_connected
from memory_paths import (
    DAYS_S,
    HOURS_S,
    MINUTES_S,
    WITHIN_S,
    claims_of_delays,
    claims_of_resolve,
    claims_of_speeds,
    with_activations,
    with_closed_areas,
    with_other_days,
)
from patience import WAIT_S
from scene_features import Object

from conflictdb import Database, IncompleteWarning, StoredScene, connect
from conflictdb import delays as delays_in_memory
from conflictdb import speeds as speeds_in_memory
from conflictdb.formats.scene_file import feature_of
from conflictdb.jobs import probes
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Delays, Verdict
from conflictdb.model.settings import SETTINGS


@dataclass
class StoredCase(Case):
    """A case with a database.

    dsn : of another connection, for workers
    """

    db: Database = field(kw_only=True)
    dsn: str = field(kw_only=True)
    _made: dict[str, StoredScene] = field(default_factory=dict, init=False)

    @cached_property
    def stored(self) -> StoredScene:
        """The scene with all objects, detected."""
        return self.made("stored", self.mixed.objects)

    @cached_property
    def without_plan(self) -> StoredScene:
        """The scene without the plan, detected."""
        return self.made("without plan", [one for one in self.mixed.objects if one.key != self.mixed.plan_key])

    def beyond(self, track: Track) -> tuple[Case, StoredScene]:
        """Return the scene with areas that a track meets beyond the expanded window, and the stored one, detected."""
        found = with_other_days(self, track)
        name = f"beyond {track.key}"
        if name not in self._made:
            self._made[name] = self.made(name, found.mixed.objects)
        return found, self._made[name]

    def made(self, name: str, objects: Sequence[Object], *, detect: bool = True, **settings: Any) -> StoredScene:
        """Put objects into a new scene."""
        scene, wanted = self.db.scene(name), replace(self.scene, name=name, **settings)
        if objects:
            scene.put(objects, wanted)
        else:
            self._created(wanted)
        if detect:
            self.detect(scene)
        return scene

    def _created(self, settings: Scene) -> None:
        """Create a scene without objects."""
        values: dict[str, Any] = {f"p_{one.name}": getattr(settings, one.name) for one in SETTINGS}
        lon_lat = values.pop("p_centre") or (None, None)
        values |= {"p_name": settings.name, "p_centre_lon": lon_lat[0], "p_centre_lat": lon_lat[1]}
        given = ", ".join(f"{name} => %({name})s" for name in values)
        values = {name: str(value) if isinstance(value, StrEnum) else value for name, value in values.items()}
        with self.db.connection.transaction():
            self.db.connection.execute(f"SELECT conflictdb.create_scene({given})", values)  # type: ignore[arg-type]
        self.db.connection.commit()
        for rule in settings.rules:
            self.db.scene(settings.name).put_rule(rule)

    def detect(self, scene: StoredScene, **how: Any) -> None:
        """Detect, though schedules may have no activation."""
        with idle_schedules():
            scene.detect(**how)

    def remove(self) -> None:
        """Remove the scenes that the case has made."""
        self.db.connection.rollback()
        for status in sorted(self.db.scenes(), key=lambda one: one.branch_of is None):
            scene = self.db.scene(status.scene.name)
            if status.branch_of is None:
                scene.delete()
            else:
                scene.drop()

    @contextmanager
    def passing(self, name: str, objects: Sequence[Object], **how: Any) -> Iterator[StoredScene]:
        """A scene that is removed afterwards."""
        scene = self.made(name, objects, **how)
        try:
            yield scene
        finally:
            self.db.connection.rollback()
            scene.delete()

    def answer_requests(self) -> None:
        """Let a worker answer all requests."""
        with psycopg.connect(self.dsn) as worker:
            while probes.answer(worker):
                pass


def without_near(rows: Rows) -> Rows:
    """Return the rows of conflicts."""
    return {pair: row for pair, row in rows.items() if row.verdict is not Verdict.NEAR}


def _listed(case: StoredCase, scene: StoredScene) -> Finding:
    """Compare the conflicts and near pairs that a scene stores."""
    rows = [*scene.conflicts(), *(one.as_near() for one in scene.approaches() if one.verdict is Verdict.NEAR)]
    return same(case.rows, rows, is_exact=case.has_fixed_plane)


def _added(findings: Iterable[Finding]) -> Finding:
    whole = Finding()
    for one in findings:
        whole.add(one)
    return whole


def detect_full(case: StoredCase) -> Finding:
    """Load and detect once."""
    return _listed(case, case.stored)


def detect_few(case: StoredCase) -> Finding:
    """Detect, put the plan, and detect the change; remove it, and put it again before the next detection."""
    plan = case.mixed.plan
    others = [one for one in case.mixed.objects if one.key != plan.key]
    with case.passing("few", others) as scene:
        scene.put(plan)
        case.detect(scene)
        first = _listed(case, scene)
        scene.delete_objects(plan.key)
        scene.put(plan)
        case.detect(scene)
        return _added([first, _listed(case, scene)])


def detect_two_transactions(case: StoredCase) -> Finding:
    """Two sessions put objects; the first one ends after a detection of the changes of the second."""
    objects = case.mixed.objects
    half = len(objects) // 2
    with case.passing("two", objects[:1], detect=False) as scene, psycopg.connect(case.dsn) as other:
        conn = case.db.connection
        conn.execute(f"SET lock_timeout = '{WAIT_S:g} s'".encode())
        for one in objects[1 : half + 1]:
            put_by_sql(other, scene.name, one)
        for one in objects[half + 1 :]:
            put_by_sql(conn, scene.name, one)
        conn.commit()
        case.detect(scene)
        other.commit()
        case.detect(scene)
        return _listed(case, scene)


def detect_stepwise(case: StoredCase) -> Finding:
    """Put one object after the other, and detect each time."""
    first, *rest = case.mixed.objects[::-1]
    with case.passing("steps", [first]) as scene:
        for one in rest:
            scene.put(one)
            case.detect(scene)
        return _listed(case, scene)


def put_in_sql(case: StoredCase) -> Finding:
    """put_area and put_track."""
    with case.passing("sql", [], detect=False) as scene:
        for one in case.mixed.objects:
            put_by_sql(case.db.connection, scene.name, one)
        case.db.connection.commit()
        case.detect(scene)
        return _listed(case, scene)


def put_by_sql(conn: psycopg.Connection[Any], scene: str, one: Object) -> None:
    """Put an object by its routine."""
    routine = "put_area" if isinstance(one, Area) else "put_track"
    values = {"p_scene": scene, **{f"p_{name}": value for name, value in _as_sql(one).items()}}
    casts = {"p_activations": "::tstzmultirange", "p_departures": "::timestamptz[]", "p_active_span": "::tstzrange"}
    casts |= dict.fromkeys(("p_schedule", "p_tolerances", "p_properties"), "::jsonb")
    casts |= dict.fromkeys(("p_footprint", "p_outline", "p_outlines", "p_path"), "::geometry")
    casts |= dict.fromkeys(("p_floors_m", "p_ceilings_m"), "::double precision[]")
    given = ", ".join(f"{name} => %({name})s{casts.get(name, '')}" for name in values)
    if isinstance(one, Track):
        values["p_times"] = _instants(one.times_us.tolist())
        path = "conflictdb.track_path(%(p_path)s::geometry, %(p_times)s::timestamptz[])"
        given = given.replace("%(p_path)s::geometry", path)
    conn.execute(f"SELECT conflictdb.{routine}({given})", values)  # type: ignore[arg-type]


def _as_sql(one: Object) -> dict[str, Any]:
    """Return parameters of put_area and put_track, without the path's times."""
    values: dict[str, Any] = {
        "key": one.key,
        "name": one.name,
        "properties": json.dumps(dict(one.properties)),
        "class": one.object_class,
        "owner": one.owner,
        "schedule": None if one.schedule is None else json.dumps(one.schedule),
    }
    if isinstance(one, Area):
        span = None
        if one.spans_us is None and (one.start_us, one.end_us) != (None, None):
            span = _range(one.start_us, one.end_us)
        spans = None
        if one.spans_us is not None and one.schedule is None:
            spans = "{" + ",".join(_range(*pair) for pair in one.spans_us) + "}"
        values |= {
            "footprint": shapely.to_wkb(shapely.set_srid(one.footprint, 4326), hex=True, include_srid=True),
            "active_span": span,
            "activations": spans,
            "floor_m": one.floor_m,
            "ceiling_m": one.ceiling_m,
        }
        return values
    path = shapely.set_srid(shapely.LineString(one.positions_deg), 4326)
    return values | {
        "path": shapely.to_wkb(path, hex=True, include_srid=True),
        "outline": None if one.outlines_m is not None else _outline(one.outline_m),
        "outlines": None if one.outlines_m is None else _outlines(one),
        "grow_mps": one.grow_mps,
        "floor_m": one.floor_m if one.floors_m is None else None,
        "ceiling_m": one.ceiling_m if one.ceilings_m is None else None,
        "floors_m": _bounded(one.floors_m),
        "ceilings_m": _bounded(one.ceilings_m),
        "tolerances": None if one.tolerances is None else json.dumps(dict(one.tolerances)),
        "departures": None if one.departures_us is None or one.schedule is not None else _instants(one.departures_us),
    }


def _bounded(heights_m: Any) -> list[float | None] | None:
    """Return heights by leg or waypoint as SQL has them: null is unbounded."""
    return None if heights_m is None else [one if math.isfinite(one) else None for one in heights_m.tolist()]


def _outline(outline: Any) -> str:
    ring = outline if len(outline) > 2 else outline[[0, -1, -1]]  # a ring has at least four points
    return str(shapely.to_wkb(shapely.Polygon(ring), hex=True))


def _outlines(track: Track) -> str:
    outlines = track.outlines_m
    assert outlines is not None
    if outlines.shape[1] < 3:  # a ring has at least four points
        outlines = outlines[:, [0, -1, -1]]
    return str(shapely.to_wkb(shapely.MultiPolygon([shapely.Polygon(one) for one in outlines]), hex=True))


def _range(start_us: int | None, end_us: int | None) -> str:
    return f"[{_instant(start_us) or ''},{_instant(end_us) or ''})"


def _instant(at_us: int | None) -> str | None:
    return None if at_us is None else (EPOCH + at_us * MICROSECOND).isoformat()


def _instants(given: Iterable[int]) -> list[str]:
    return [(EPOCH + at * MICROSECOND).isoformat() for at in given]


def attached(case: StoredCase) -> Finding:
    """Tables of a stranger with a column for each field; objects with the same fields are attached together."""
    conn = case.db.connection
    groups = [("area", some) for some in _alike(case.mixed.areas)] + [
        ("track", some) for some in _alike(case.mixed.tracks)
    ]
    tables = [f"public.strange_{number}" for number in range(len(groups))]
    try:
        with case.passing("attached", [], detect=False) as scene:
            try:
                for table, (kind, objects) in zip(tables, groups, strict=True):
                    mapped = _table(conn, table, objects)
                    conn.commit()
                    scene.attach(kind, table, mapped)
                scene.follow()
                unmapped = scene.unmapped()
                case.detect(scene)
                finding = _listed(case, scene)
                finding.check(not unmapped, f"rows are not mapped: {unmapped}")
                return finding
            finally:
                conn.rollback()
                for one in scene.attachments():
                    scene.detach(one.table)
    finally:
        conn.rollback()
        conn.execute(f"DROP TABLE IF EXISTS {', '.join(tables)}")  # type: ignore[arg-type]
        conn.commit()


_TYPES: Final = {
    "footprint": "geometry",
    "path": "geometry",
    "outline": "geometry",
    "outlines": "geometry",
    "span": "tstzrange",
    "activations": "tstzmultirange",
    "properties": "jsonb",
    "schedule": "jsonb",
    "tolerances": "jsonb",
    "times": "timestamptz[]",
    "departures": "timestamptz[]",
    "floors_m": "double precision[]",
    "ceilings_m": "double precision[]",
    **dict.fromkeys(("floor_m", "ceiling_m", "grow_mps"), "double precision"),
}


def _table_row(one: Object) -> dict[str, Any]:
    row = _as_sql(one)
    if isinstance(one, Area):
        row["span"] = row.pop("active_span")
        return row
    return {**row, "times": _instants(one.times_us.tolist())}


def _table(conn: psycopg.Connection[Any], table: str, objects: Sequence[Object]) -> dict[str, str]:
    """Make a table with columns c_NAME of objects that have the same fields; return its map."""
    rows = [_table_row(one) for one in objects]
    names = [name for name in rows[0] if any(row[name] is not None for row in rows)]
    columns = ", ".join(f"c_{name} {_TYPES.get(name, 'text')}" for name in names)
    conn.execute(f"CREATE TABLE {table} ({columns})")  # type: ignore[arg-type]
    for row in rows:
        values = ", ".join(f"%({name})s::{_TYPES.get(name, 'text')}" for name in names)
        conn.execute(f"INSERT INTO {table} VALUES ({values})", row)  # type: ignore[arg-type]
    return {name: f"c_{name}" for name in names}


def _alike(objects: Sequence[Object]) -> list[list[Object]]:
    """Return objects in groups that have the same fields: a map may name no fields that exclude each other."""
    groups: dict[frozenset[str], list[Object]] = {}
    for one in objects:
        fields = frozenset(name for name, value in _table_row(one).items() if value is not None)
        groups.setdefault(fields, []).append(one)
    return list(groups.values())


def branch(case: StoredCase) -> Finding:
    """A branch in which the plan is edited; the branch is detected, then merged, and its parent is detected."""
    plan = case.mixed.plan
    elsewhere = replace(plan, owner="somebody", object_class=None, name="as it was")
    objects = [elsewhere if one.key == plan.key else one for one in case.mixed.objects]
    with case.passing("trunk", objects) as scene:
        edited = scene.branch("branch")
        edited.put(plan)
        case.detect(edited)
        of_branch = _listed(case, edited)
        edited.merge()
        case.detect(scene)
        return _added([of_branch, _listed(case, scene)])


def probe_one(case: StoredCase) -> Finding:
    """`probe` of the plan, in a scene without it and in the one that has it."""
    with idle_schedules():
        found = [scene.probe(case.mixed.plan) for scene in (case.without_plan, case.stored)]
    return _added(same(case.rows_of_plan, rows, is_exact=False) for rows in found)


def probe_undetected(case: StoredCase) -> Finding:
    """`probe` of the plan among objects that no detection has seen."""
    others = [one for one in case.mixed.objects if one.key != case.mixed.plan_key]
    with case.passing("undetected", others, detect=False) as scene, _incomplete():
        found = scene.probe(case.mixed.plan)
    return same(case.rows_of_plan, found, is_exact=False)


@contextmanager
def _incomplete() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        yield


def probe_several(case: StoredCase) -> Finding:
    """`probe` of the plan together with another object."""
    plans = _two(case)
    keys = {one.key for one in plans}
    with idle_schedules():
        found = case.stored.probe(plans)
    return same(only_of(case.rows, keys), found, is_exact=False)


def _two(case: StoredCase) -> list[Object]:
    other = next(one for one in case.mixed.objects[::-1] if one.key != case.mixed.plan_key)
    return [case.mixed.plan, other]


def probe_by_worker(case: StoredCase) -> Finding:
    """`probe` that a worker answers."""
    found: list[Any] = []

    def ask() -> None:
        with connect(case.dsn) as db, idle_schedules():
            try:
                found.append(db.scene(case.stored.name).probe(case.mixed.plan, worker_timeout_s=WAIT_S))
            except Exception as error:
                found.append(error)

    case.stored  # noqa: B018
    thread = Thread(target=ask)
    thread.start()
    while thread.is_alive():
        case.answer_requests()
        thread.join(0.02)
    if isinstance(found[0], Exception):
        raise found[0]
    return same(case.rows_of_plan, found[0], without=PLACES, is_exact=False)


def admit(case: StoredCase) -> Finding:
    """`admit`: admitted if and only if the plan meets nothing; refused plans change nothing."""
    plan = case.mixed.plan
    finding = Finding()
    others = [one for one in case.mixed.objects if one.key != plan.key]
    with case.passing("admission", others) as scene:
        with idle_schedules():
            answer = scene.admit(plan)
        expected = without_near(case.rows_of_plan)
        finding.check(
            answer.is_admitted == (not expected), f"admitted: {answer.is_admitted}, though it meets {expected.keys()}"
        )
        compared = same(expected, answer.conflicts, is_exact=case.has_fixed_plane)
        keys = {one.key for one in scene.objects()}
        finding.check((plan.key in keys) == answer.is_admitted, f"{plan.key} is stored: {plan.key in keys}")
    return _added([finding, compared])


def admit_in_sql(case: StoredCase) -> Finding:
    """The function admit, which a worker answers where SQL cannot decide."""
    plan, conn = case.mixed.plan, case.db.connection
    finding = Finding()
    others = [one for one in case.mixed.objects if one.key != plan.key]
    with case.passing("admission", others) as scene:
        given = json.dumps([feature_of(plan) | {"version": 1}])
        with worker_connected(conn.info.dsn):
            row = conn.execute("SELECT * FROM conflictdb.admit(%s, %s)", [scene.name, given]).fetchone()
            conn.commit()
        assert row is not None
        admitted, conflicts, request = row
        if request is not None:
            case.answer_requests()
            wait = f"SELECT * FROM conflictdb.wait_for_admission(%s, '{WAIT_S:g} s')"
            row = conn.execute(wait.encode(), [request]).fetchone()
            conn.commit()
            assert row is not None
            admitted, conflicts = row
        expected = without_near(case.rows_of_plan)
        pairs = {(one["a_key"], one["b_key"]): one["verdict"] for one in conflicts}
        finding.check(admitted == (not expected), f"admitted: {admitted}, though it meets {expected.keys()}")
        verdicts = {pair: str(one.verdict) for pair, one in expected.items()}
        finding.check(pairs == verdicts, f"meets {pairs}, expected {verdicts}")
        keys = {one.key for one in scene.objects()}
        finding.check((plan.key in keys) == admitted, f"{plan.key} is stored: {plan.key in keys}")
        if admitted:
            case.detect(scene)
            stored = _listed(case, scene)
            return _added([finding, stored])
    return finding


def explain(case: StoredCase) -> Finding:
    """`explain` of the pairs of the plan: the verdict of the pair, or apart."""
    finding = Finding()
    plan, rows = case.mixed.plan, without_near(case.rows_of_plan)
    for one in case.mixed.objects[:4]:
        if one.key == plan.key:
            continue
        with idle_schedules():
            facts = case.stored.explain(plan.key, one.key).facts
        row = next((row for pair, row in rows.items() if one.key in pair), None)
        expected = None if row is None else str(row.verdict)
        verdict = facts["verdict"] if facts["verdict"] in list(Verdict) else None
        verdict = None if verdict == "near" else verdict
        finding.check(verdict == expected, f"{plan.key}, {one.key}: {facts['verdict']!r}, expected {expected!r}")
    return finding


def delays_stored(case: StoredCase) -> Finding:
    """`delays_within_s`: stored delays are those that are computed, in memory and by key."""
    track = case.single_track()
    closed = with_closed_areas(case, track)
    settings, finding = replace(case.scene, delays_within_s=HOURS_S), Finding()
    with case.passing("stored delays", closed.mixed.objects, delays_within_s=HOURS_S) as scene, idle_schedules():
        answers = [(within_s, scene.delays(track.key, within_s)) for within_s in (MINUTES_S, HOURS_S)]
    for within_s, [stored] in answers:
        with idle_schedules():
            [computed] = delays_in_memory(closed.mixed.tracks, closed.mixed.areas, settings, track.key, within_s)
        finding.add(_same_delays(closed, stored, computed, track, within_s))
    return finding


def _same_delays(case: Case, stored: Delays, computed: Delays, track: Plan, within_s: float) -> Finding:
    """Compare delays with those of memory, whose claims are checked; without a fixed plane, check the claims."""
    if not case.has_fixed_plane:
        return claims_of_delays(case, stored, track, within_s)
    finding = Finding()
    finding.check(stored == computed, f"stored {stored}, computed {computed}")
    return finding


def delays_by_key(case: StoredCase) -> Finding:
    """`delays(key)` of a stored scene: those of memory."""
    track = case.single_track()
    beyond, scene = case.beyond(track)
    with idle_schedules():
        [stored] = scene.delays(track.key, DAYS_S)
        [computed] = delays_in_memory(beyond.mixed.tracks, beyond.mixed.areas, case.scene, track.key, DAYS_S)
    return _same_delays(beyond, stored, computed, track, DAYS_S)


def area_delays_by_key(case: StoredCase) -> Finding:
    """`delays(key)` of a stored area: those of memory."""
    area = case.single_area()
    with case.passing("area delays", case.mixed.objects) as scene, idle_schedules():
        case.detect(scene)
        [stored] = scene.delays(area.key, HOURS_S)
        [computed] = delays_in_memory(case.mixed.tracks, case.mixed.areas, case.scene, area.key, HOURS_S)
    fixed, expanded = with_activations(case, area, HOURS_S)
    return _same_delays(fixed, stored, computed, expanded, HOURS_S)


def delays_in_sql(case: StoredCase) -> Finding:
    """request_delays, which a worker answers: the least delays of `delays`."""
    track = case.single_track()
    beyond, scene = case.beyond(track)
    question = "SELECT conflictdb.request_delays(%s, %s, %s)"
    [answer] = _requested(case, question, [scene.name, track.key, timedelta(seconds=DAYS_S)], "wait_for_delays")
    with idle_schedules():
        [computed] = delays_in_memory(beyond.mixed.tracks, beyond.mixed.areas, case.scene, track.key, DAYS_S)
    finding = Finding()
    for name in ("least_later_s", "least_earlier_s"):
        own = getattr(computed, name)
        other = answer.get(name, answer.get(name.removesuffix("_s")))
        other = other.total_seconds() if isinstance(other, timedelta) else other
        is_near = own is other or (own is not None and other is not None and abs(own - other) < 1e-5)
        finding.check(is_near, f"{track.key}: {name} {other}, in memory {own}")
    return finding


def speeds_by_key(case: StoredCase) -> Finding:
    """`speeds(key)` of a stored scene: those of memory."""
    track = case.single_track(is_exact=True)
    beyond, scene = case.beyond(track)
    with idle_schedules():
        [stored] = scene.speeds(track.key, 0.6, 1.8)
        [computed] = speeds_in_memory(beyond.mixed.tracks, beyond.mixed.areas, case.scene, track.key, 0.6, 1.8)
    finding = claims_of_speeds(beyond, stored, track)
    if case.has_fixed_plane:
        finding.check(stored == computed, f"stored {stored}, computed {computed}")
    return finding


def resolve_stored(case: StoredCase) -> Finding:
    """`resolve` of a stored scene, applied and detected."""
    with case.passing("resolved", case.mixed.objects) as scene, idle_schedules():
        proposal = scene.resolve(within_s=WITHIN_S, limit_s=5.0)
        finding = claims_of_resolve(case, proposal)
        if proposal.moves and proposal.proposal_id is not None:
            case.db.apply_proposal(proposal.proposal_id)
            case.detect(scene)
            left = {one.key for one in proposal.left}
            moved = {move.key for move in proposal.moves}
            met = [
                (one.a_key, one.b_key)
                for one in scene.conflicts()
                if moved & {one.a_key, one.b_key} and not left & {one.a_key, one.b_key}
            ]
            finding.check(not met, f"after the proposal is applied, {met} meet")
    return finding


def request_probe(case: StoredCase) -> Finding:
    """request_plans_probe; and request_probe or request_track_probe, of plans that these have the fields of."""
    plan, name = case.mixed.plan, case.stored.name
    given = json.dumps([feature_of(plan) | {"version": 1}])
    asked = [("SELECT conflictdb.request_plans_probe(%s, %s::jsonb)", [name, given], "wait_for_plans_probe")]
    if (fields := _of_one_span(plan)) is not None:
        kind, values = fields
        asked.append((f"SELECT conflictdb.{kind}", [name, *values], "wait_for_probe"))
    finding = Finding()
    for question, parameters, wait in asked:
        rows = _requested(case, question, parameters, wait)
        met = {row["key"]: row["verdict"] for row in rows}
        expected = {key: str(row.verdict) for pair, row in case.rows_of_plan.items() for key in set(pair) - {plan.key}}
        finding.check(met == expected, f"{question}: {plan.key} meets {met}, expected {expected}")
    return finding


def _requested(case: StoredCase, question: str, parameters: Sequence[Any], wait: str) -> list[dict[str, Any]]:
    """Return the rows of an answer to a request."""
    conn = case.db.connection
    row = conn.execute(question, parameters).fetchone()  # type: ignore[arg-type]
    conn.commit()
    assert row is not None
    case.answer_requests()
    found = conn.execute(f"SELECT * FROM conflictdb.{wait}(%s, '{WAIT_S:g} s')".encode(), [row[0]])
    names = [column.name for column in found.description or ()]
    rows = [dict(zip(names, one, strict=True)) for one in found.fetchall()]
    conn.commit()
    return rows


def _of_one_span(plan: Object) -> tuple[str, list[Any]] | None:
    """Return the call of request_probe or request_track_probe, and its values without the scene; None: it has more."""
    values = _as_sql(plan)
    if plan.schedule is not None:
        return None
    heights = [plan.floor_m, plan.ceiling_m]
    if isinstance(plan, Area):
        if plan.spans_us is not None:
            return None
        call = "request_probe(%s, %s::geometry, %s::tstzrange, %s, %s, %s)"
        return call, [values["footprint"], values["active_span"], *heights, plan.key]
    if plan.tolerances or plan.outlines_m is not None or plan.floors_m is not None or plan.ceilings_m is not None:
        return None
    if plan.departures_us is not None:
        return None
    path = "conflictdb.track_path(%s::geometry, %s::timestamptz[])"
    call = f"request_track_probe(%s, {path}, %s::geometry, %s, %s, %s, %s)"
    times = _instants(plan.times_us.tolist())
    return call, [values["path"], times, values["outline"], *heights, plan.grow_mps, plan.key]


DATABASE_PATHS: Final = {
    "detect, full": detect_full,
    "detect, few changes": detect_few,
    "detect, two transactions": detect_two_transactions,
    "detect, stepwise": detect_stepwise,
    "put_area, put_track": put_in_sql,
    "attached tables": attached,
    "branch, edit, merge": branch,
    "probe": probe_one,
    "probe, undetected objects": probe_undetected,
    "probe, several plans": probe_several,
    "probe by a worker": probe_by_worker,
    "request_probe": request_probe,
    "admit": admit,
    "admit in SQL": admit_in_sql,
    "explain": explain,
    "stored delays": delays_stored,
    "delays of a stored scene": delays_by_key,
    "delays of a stored area": area_delays_by_key,
    "request_delays": delays_in_sql,
    "speeds of a stored scene": speeds_by_key,
    "resolve a stored scene": resolve_stored,
}
