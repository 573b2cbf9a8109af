"""The database has the settings of the table `conflictdb.model.settings`: columns, defaults, rules, sentences."""

import inspect
from dataclasses import fields, replace
from typing import Any, get_type_hints

import numpy as np
import psycopg
import pytest

from conflictdb import store
from conflictdb.jobs import models
from conflictdb.model import settings
from conflictdb.model.plans import Scene
from conflictdb.model.settings import SETTINGS, SettingType

Conn = psycopg.Connection[Any]
COLUMNS = tuple(column for setting in SETTINGS for column in setting.columns)
TYPES = dict.fromkeys(SettingType, "double precision") | {SettingType.CHOICE: "text"}


def catalog(conn: Conn, relation: str) -> dict[str, tuple[str, str, str | None]]:
    rows = conn.execute(
        """SELECT a.attname, format_type(a.atttypid, a.atttypmod), col_description(a.attrelid, a.attnum),
                  pg_get_expr(d.adbin, d.adrelid)
           FROM pg_attribute a LEFT JOIN pg_attrdef d ON (d.adrelid, d.adnum) = (a.attrelid, a.attnum)
           WHERE a.attrelid = %s::regclass AND a.attnum > 0 AND NOT a.attisdropped""",
        [f"conflictdb.{relation}"],
    ).fetchall()
    return {name: (kind, comment, default) for name, kind, comment, default in rows}


@pytest.mark.parametrize("relation", ["scene", "scenes"])
def test_columns_have_the_types_and_sentences_of_the_table(conn: Conn, relation: str) -> None:
    """A comment may say more, and a place has two."""
    said = catalog(conn, relation)
    for setting in SETTINGS:
        for column in setting.columns:
            kind, comment, _ = said[column]
            assert kind == TYPES[setting.type], column
            assert setting.type is SettingType.PLACE or comment == setting.meaning


def test_a_scene_has_the_settings_of_the_table_and_nothing_else(conn: Conn) -> None:
    """_settings_of lists, in one place, the columns that are not settings."""
    conn.execute("SELECT conflictdb.create_scene('s')")
    row = conn.execute("SELECT conflictdb_internal._settings_of(s) FROM conflictdb.scene s").fetchone()
    assert row is not None
    assert set(row[0]) == {"name", *COLUMNS}
    assert set(catalog(conn, "scene")) == {
        "name",
        *COLUMNS,
        "scene_id",
        "history_kept",
        "owner",
        "expanded",
        "parent_scene_id",
    }


def test_defaults_are_those_of_the_table(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    assert store.scene_settings(conn, "s") == Scene("s")
    assert [one.name for one in fields(Scene)] == ["name", *settings.NAMES, "rules"]
    defaults = {one.name: one.default for one in fields(Scene)}
    assert {one.name: one.default for one in SETTINGS} == {name: defaults[name] for name in settings.NAMES}


@pytest.mark.parametrize("motion", ["rhumb", "great_circle"])
def test_a_copy_has_every_setting(conn: Conn, motion: str) -> None:
    """A copy without a separation would miss conflicts."""
    distances = {one.name: 0.1 + k for k, one in enumerate(SETTINGS) if one.name in settings.NUMBERS}
    place = {"centre": (10.1, 57.3)} if motion == "great_circle" else {}
    choices = {"method": "screen", "intervals": "closed", "vertical_datum": "wgs84", "regions": "off"}
    given = Scene("s", motion=motion, earth="sphere", **choices, **distances, **place)  # type: ignore[arg-type]
    changed = {one.name for one in SETTINGS if getattr(given, one.name) != one.default}
    assert changed | {"motion", "centre"} == set(settings.NAMES)
    store.set_scene(conn, given)
    conn.execute("SELECT conflictdb.copy_scene('s', 'copy')")
    assert replace(store.scene_settings(conn, "copy"), name="s") == given


def test_the_parameters_of_create_scene_are_the_columns(conn: Conn) -> None:
    row = conn.execute("SELECT proargnames FROM pg_proc WHERE proname = 'create_scene'").fetchone()
    assert row is not None
    assert sorted(row[0]) == sorted(f"p_{name}" for name in ("name", *COLUMNS))


def test_models_have_the_settings() -> None:
    for model in (models.SceneRow, models.SceneStateRow):
        assert set(COLUMNS) <= set(inspect.get_annotations(model))


def test_settings_of_a_detection_are_typed() -> None:
    assert set(get_type_hints(settings.Changes)) == {one.name for one in settings.STORED_BY_DETECT}


@pytest.mark.parametrize("name", settings.METRES)
def test_each_distance_is_kept_to_the_last_digit_and_checked(conn: Conn, name: str) -> None:
    """Also with few digits in the caller's session, given by `Scene` or by SQL."""
    value = float(np.nextafter(100.0, 200.0))
    conn.execute("SET extra_float_digits = -15")
    store.set_scene(conn, Scene("s", **{name: value}))
    conn.execute(f"SELECT conflictdb.create_scene('t', p_{name} => {value!r})".encode())
    for scene in ("s", "t"):
        known = store.scene_settings(conn, scene)
        assert known is not None
        assert getattr(known, name) == value
    conn.execute("DELETE FROM conflictdb.change")
    for wrong in ("-1", "'NaN'", "'infinity'", "20000001"):
        with pytest.raises(psycopg.Error) as refused, conn.transaction():
            conn.execute(f"SELECT conflictdb.create_scene('s', p_{name} => {wrong})".encode())
        assert refused.value.sqlstate == "ZC009"
        assert f"{name}: must be" in str(refused.value)


@pytest.mark.parametrize("wrong", ["-1", "'NaN'", "'infinity'", "2592000.1", "1e-7"])
def test_the_horizon_of_stored_delays_is_checked(conn: Conn, wrong: str) -> None:
    with pytest.raises(psycopg.Error) as refused, conn.transaction():
        conn.execute(f"SELECT conflictdb.create_scene('s', p_delays_within_s => {wrong})".encode())
    assert refused.value.sqlstate == "ZC009"
    assert "delays_within_s: must be whole microseconds, 0 to 2592000" in str(refused.value)
