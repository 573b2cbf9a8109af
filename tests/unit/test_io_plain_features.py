"""Plain features, read many at once, are read as they would be one by one: the same objects, the same errors."""

import copy
import json
import random
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from draws import draws
from full_plans import lost, specimens
from hostile_objects import scene_file, throw
from hypothesis import given
from hypothesis import strategies as st
from mixed_scenes import odd_scene

from conflictdb.errors import InvalidInput
from conflictdb.formats import plain_features
from conflictdb.formats.contents import Contents
from conflictdb.formats.file_objects import FileContext
from conflictdb.formats.instants import parse_instant, parse_plain
from conflictdb.formats.scene_file import plans_text, read_scene, scene_text
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.tolerances import WINDOWS

# Values that take the place of any value of a feature.
STRANGE: list[Any] = [
    None, True, False, 0, -0.0, 1, -1, 7.5, 89.5, 91, -360.0, 361, 1e308, 10**400, float("nan"), float("inf"), "", "x",
    "track", "area", "Polygon", "LineString", "MultiPolygon", "Point", "\0", "\ud800", "é" * 501,
    "2026-03-01T06:00:00Z",
    "2026-03-01T06:00:00.000001Z", "2026-02-30T06:00:00Z", "2026-03-01 06:00", "2026-03-01T07:00:00.1234567+01:00",
    "0001-01-01T00:00:00Z", [], {}, [[]], [1, 2], [1, 2, 3], [[1, 2]], [[[1, 2]]], [0, True], ["4", "57"], {"x": 1},
    [[0, 0], [1, 0], [1, 1], [0, 0]], [[0, 0], [4, 0], [1, 1], [0, 4]], ["2026-03-01T06:00:00Z"],
]  # fmt: skip
# Members that a feature's properties may get.
NAMES = [
    "kind", "name", "start", "end", "times", "datetimes", "speed_kn", "outline_m", "outlines_m", "grow_mps", "floor_m",
    "ceiling_m", "fore_m", "aft_m", "port_m", "starboard_m", "fore_nmi", "radius_m", "Start", "floor_ft", "note",
    "separation_m", "properties", "geometry", "id", "crs", "class", "owner", "spans", "departures", "schedule",
    "xtd_port_m", "min_speed_kn", "departure_window", "speed_mps", "vertical_datum",
]  # fmt: skip


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of each value within a value, without the outermost value itself."""
    if at:
        yield at
    for name, member in (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    ):
        yield from places(member, (*at, name))


def changed(features: list[Any], seed: int) -> list[Any]:
    """The features, with some values replaced, and members removed or added."""
    rng = random.Random(seed)  # noqa: S311
    features = copy.deepcopy(features)
    for _ in range(rng.choice([0, 1, 1, 2, 5])):
        way = rng.choice(list(places(features)))
        inner = features
        for name in way[:-1]:
            inner = inner[name]
        deed = rng.choice(["replace", "replace", "remove", "add"])
        if deed == "replace":
            inner[way[-1]] = copy.deepcopy(rng.choice(STRANGE))
        elif deed == "remove" and len(way) > 1:
            del inner[way[-1]]
        elif isinstance(features[way[0]], dict) and isinstance(features[way[0]].get("properties"), dict):
            features[way[0]]["properties"][rng.choice(NAMES)] = copy.deepcopy(rng.choice(STRANGE))
    return features


def read(text: str, *, skip_invalid: bool) -> Contents | str:
    """The contents of a scene file, or the refusal."""
    try:
        return read_scene(text, "s", 1000.0, skip_invalid=skip_invalid)
    except InvalidInput as refused:
        return str(refused)


def one_by_one(text: str, *, skip_invalid: bool) -> Contents | str:
    """The same without plain features."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plain_features, "objects", lambda features, *_: [None] * len(features))
        return read(text, skip_invalid=skip_invalid)


def document(features: list[Any]) -> str:
    return json.dumps({"type": "FeatureCollection", "features": features})


def assert_read_alike(text: str, *, skip_invalid: bool) -> Contents | None:
    """The contents, if the file is not refused; both ways."""
    got, wanted = (way(text, skip_invalid=skip_invalid) for way in (read, one_by_one))
    if isinstance(got, str) or isinstance(wanted, str):
        assert got == wanted, text
        return None
    assert got.skipped == wanted.skipped
    items: list[list[Area | Track]] = [[*contents.areas, *contents.tracks] for contents in (got, wanted)]
    for one, other in zip(*items, strict=True):
        assert lost(one, other) == []
    return got


@draws("scenes", 100, 2000)
def test_plain_features_are_read_as_one_by_one(scenes: int) -> None:
    for seed in range(scenes):
        features = json.loads("".join(scene_text(*odd_scene(seed))))["features"]
        for change in range(4 if features else 0):
            assert_read_alike(document(changed(features, 4 * seed + change)), skip_invalid=change % 2 == 0)


def test_hostile_features_are_read_as_one_by_one() -> None:
    rng = np.random.default_rng(5)
    contents = assert_read_alike(scene_file([throw(rng, str(i)) for i in range(2_000)]), skip_invalid=True)
    assert contents is not None
    assert contents.areas
    assert contents.tracks
    assert contents.skipped


@draws("scenes", 100, 2000)
def test_exported_objects_are_plain(scenes: int) -> None:
    """Files of this package are read fast."""
    for seed in range(scenes):
        scene, areas, tracks = odd_scene(seed)
        features = json.loads("".join(scene_text(scene, areas, tracks)))["features"]
        assert all(plain_features.objects(features, FileContext(scene))), seed


def test_plans_with_every_column_are_plain() -> None:
    """Each is made without its class checking it again: checks of single objects are for what arrays refuse."""
    plans = [replace(one.plan, key=f"{i}") for i, one in enumerate(specimens())]
    features = json.loads(plans_text(plans))["features"]
    for feature in [one for one in features if "times" in one["properties"]]:
        members = {name: one for name, one in feature["properties"].items() if name not in ("times", *WINDOWS)}
        times = feature["properties"]["times"]
        for k, more in enumerate(({"start": times[0], "speed_kn": 10.0}, {"datetimes": times})):
            features.append({**feature, "id": f"{feature['id']} {k}", "properties": {**members, **more}})
    text = json.dumps({"type": "FeatureCollection", "features": features})
    checked: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        for kind in (Area, Track):
            patch.setattr(kind, "__post_init__", lambda one, *_: checked.append(one.key))
        found = read_scene(text, "s")
    assert checked == []
    assert len(found.areas) + len(found.tracks) == len(features)
    assert_read_alike(text, skip_invalid=False)


def test_a_property_without_a_name_is_no_id() -> None:
    ring = [[4, 57], [5, 57], [5, 58], [4, 57]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    features: list[Any] = [{"type": "Feature", "geometry": shape, "properties": {"": 7, "floor_m": 1.0}}]
    contents = assert_read_alike(document(features), skip_invalid=False)
    assert contents is not None
    assert [(one.key, one.properties) for one in contents.areas] == [("s.1", {"": 7})]


def test_a_strange_feature_leaves_the_others_plain() -> None:
    ring = [[4, 57], [5, 57], [5, 58], [4, 57]]
    features: list[Any] = [
        {"type": "Feature", "id": f"A{i}", "geometry": {"type": "Polygon", "coordinates": [ring]}, "properties": {}}
        for i in range(9)
    ]
    features[4] = {**features[4], "geometry": {"type": "Polygon", "coordinates": [[*ring[:2], [5, "58"], ring[3]]]}}
    found = plain_features.objects(features, FileContext(Scene("s")))
    assert [one is None for one in found] == [i == 4 for i in range(9)]


@given(
    st.lists(
        st.one_of(st.sampled_from([s for s in STRANGE if isinstance(s, str)]), st.datetimes().map(str)), max_size=9
    )
)
def test_plain_instants_are_those_of_the_parser(texts: list[str]) -> None:
    texts += [text.replace(" ", "T") + "Z" for text in texts]
    for text, us, is_plain in zip(texts, *(values.tolist() for values in parse_plain(texts)), strict=True):
        if is_plain:
            assert us == parse_instant(text)
        else:
            assert us == 0
