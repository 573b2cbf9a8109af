"""What the borders do not show of the columns of `made_up_columns`: rules, digests, versions, models, reference.

tests/paths/test_made_up_columns.py runs these tests, in a process that has the columns.
"""

from dataclasses import fields, replace
from typing import Any

import full_plans
import generate
import numpy as np
import psycopg
import pytest
from made_up_columns import MADE_UP, VALUES

from conflictdb import plans_schema, store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core.pieces.digests import area_digests, track_digests
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import Area, Track
from conflictdb.store.detections import changed_tracks
from conflictdb.store.object_state_rows import object_states

WRONG = {"cargo": ["", 7, 201 * "x"], "draught_m": ["7", float("nan")], "remark_of_pilot": [7], "papers": [{1: {2}}]}


@pytest.mark.parametrize("one", MADE_UP, ids=lambda one: one.name)
def test_field_is_checked_by_the_rule_of_its_form(one: Any) -> None:
    assert one.name in {each.name for each in fields(Track)}
    assert (one.name in {each.name for each in fields(Area)}) == ("area" in one.kinds)
    for value in WRONG[one.name]:
        with pytest.raises(InvalidInput, match=f"{one.name}: must be"):
            full_plans.track(**{one.name: value})


@pytest.mark.parametrize("one", MADE_UP, ids=lambda one: one.name)
def test_digests_differ_where_answers_may(one: Any) -> None:
    digests = track_digests(TrackBatch.of([full_plans.track(), full_plans.track(**{one.name: VALUES[one.name]})]))
    assert (digests[0] != digests[1]) == one.changes_answers
    if "area" in one.kinds:
        digests = area_digests(AreaBatch.of([full_plans.area(), full_plans.area(**{one.name: VALUES[one.name]})]))
        assert (digests[0] != digests[1]) == one.changes_answers


def test_detections_know_the_value_of_a_number(conn: psycopg.Connection[Any]) -> None:
    """Of plans as they are given, and of rows: the changed ones of a scene, and those that a copy compares."""
    deep, other = full_plans.track(draught_m=7.1), replace(full_plans.track(), key="other")
    given = TrackBatch.of([deep, other])
    np.testing.assert_array_equal(given.values("draught_m"), [7.1, np.nan])
    scene_id = store.set_scene(conn, full_plans.SCENE)
    store.put_plans(conn, full_plans.SCENE.name, [], [], [deep, other])
    stored = changed_tracks(conn, scene_id)
    np.testing.assert_array_equal(np.sort(stored.values("draught_m")), [7.1, np.nan])
    assert set(track_digests(stored)) == set(track_digests(given)) == set(object_states(conn, scene_id).digest)


def test_models_and_reference_have_it() -> None:
    models, plans, forms = generate.models(), generate.plans(), plans_schema()["$defs"]
    for one in MADE_UP:
        assert all(one.name in forms[kind]["properties"]["properties"]["properties"] for kind in one.kinds)
        assert models.count(f"    {one.name}: Mapped[") == len(one.kinds)
        assert f"| `{one.name}` |" in plans


def test_tables_check_it_and_make_versions(conn: psycopg.Connection[Any]) -> None:
    store.set_scene(conn, full_plans.SCENE)
    store.put_plans(conn, full_plans.SCENE.name, [], [], [full_plans.track()])
    for one, value in (("cargo", ""), ("draught_m", "NaN"), ("papers", "1e999")):
        with pytest.raises(psycopg.Error) as refused, conn.transaction():
            conn.execute(f"UPDATE conflictdb.track SET {one} = '{value}'".encode())
        assert refused.value.sqlstate == "ZC008"
        assert f"{one}: must be" in str(refused.value)
    for one in MADE_UP:
        query = f"UPDATE conflictdb.track SET {one.name} = %s RETURNING version".encode()
        value = psycopg.types.json.Jsonb(VALUES[one.name]) if one.name == "papers" else VALUES[one.name]
        (before,) = conn.execute(b"SELECT version FROM conflictdb.track").fetchone() or ()
        (after,) = conn.execute(query, [value]).fetchone() or ()
        assert (after > before) == one.changes_answers
    comments = conn.execute(
        "SELECT count(*) FROM pg_description WHERE objoid = 'conflictdb.track'::regclass AND description = ANY (%s)",
        [[one.doc for one in MADE_UP]],
    ).fetchone()
    assert comments == (len(MADE_UP),)
