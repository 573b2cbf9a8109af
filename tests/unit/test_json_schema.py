"""The JSON Schema of scene files: documents that the product writes are valid, and the reader reads valid documents.

`DIFFERENCES` lists the rules of the reader that the schema does not have.
"""

import json
import random
from collections.abc import Iterator
from typing import Any, Final

import full_plans
import pytest
from docs_scripts import DOCS, script
from draws import draws
from jsonschema import Draft202012Validator
from mixed_scenes import mixed_scene, odd_scene

from conflictdb import InvalidInput, Scene, plans_schema
from conflictdb.formats.scene_file import plans_text, read_plans, read_scene, scene_text
from conflictdb.model.plan_columns import columns_of

SCHEMA: Final = plans_schema()
VALID: Final = Draft202012Validator(SCHEMA)
# Parts of sentences of the reader, by what the schema does not say of a document.
DIFFERENCES: Final = {
    "numbers of values: one per leg or waypoint": ("one per", "as many vertices"),
    "shapes: closed, valid, convex, on the earth": (
        "must be closed",
        "must be a valid polygon",
        "must be a convex ring",
        "sharper than",
        "latitude must",
        "longitude must",
        "wider than",
        "of the reference point",
        "turn over",
        "must not be empty",
        "two waypoints",
        "two places at the same time",
        "metres: at most",
        "must be one line",
        "same at the end",
    ),
    "order and length of times, and of heights": ("later than", "must be above", "must end after", "a year", "planned"),
    "dates that no calendar has, and the years 1 to 9999": ("must be a date and time", "years 1 to 9999"),
    "the languages of schedules": ("schedule",),
    "members of the other kind, and names that look like members": ("has a meaning for", "did you mean"),
    "rules that contradict each other, and ids given twice": ("apply alike", "given twice"),
    "bytes of texts, words that rules use, and largest numbers": ("bytes", "must not be '", "at most", "no meaning"),
    "separation rules: which side yields": ("yields: needs",),
    "the datum of heights": ("vertical_datum",),
}
VALUES: Final = (
    *(None, True, 5, -1, 0, 1e300, "", "x", "2026-01-01T00:00:00Z", "2026-01-01", "area", "track", "Polygon"),
    *("LineString", "Point", "MultiPolygon", [], {}, [1], [None], [1, 2], [1, "x"], [[1, 2]], [[1, 2], [3, 4]]),
    *([[[1, 2], [3, 4], [3, 5], [1, 2]]], ["2026-01-01T00:00:00Z"], [["2026-01-01T00:00:00Z", None]], {"a": 1}),
)
NAMES: Final = sorted(
    {"radius_m", "id", "type", "geometry", "features", "scene", "version", "foreign", "coordinates", "zzz"}
    | {name for kind in ("area", "track") for one in columns_of(kind) for name in one.members}
)


def written(seed: int) -> Iterator[dict[str, Any]]:
    for scene, areas, tracks in (mixed_scene(seed).content, odd_scene(seed)):
        yield json.loads("".join(scene_text(scene, areas, tracks)))


def refusals(document: Any) -> list[str]:
    """Return the sentences of the reader about a document."""
    text = json.dumps(document)
    try:
        if "scene" in document:
            read_scene(text, "stem")
        else:
            read_plans(text, Scene("s"))
    except InvalidInput as refused:
        return str(refused).split("\n")
    return []


def _within(value: Any) -> Iterator[Any]:
    if isinstance(value, dict | list):
        yield value
        for one in value.values() if isinstance(value, dict) else value[:3]:
            yield from _within(one)


def damaged(rng: random.Random, document: dict[str, Any]) -> dict[str, Any]:
    """Return a document with a member or two changed, added or removed."""
    document = json.loads(json.dumps(document))
    document["features"] = rng.sample(document["features"], min(2, len(document["features"])))
    if rng.random() < 0.3:
        del document["scene"]
    for _ in range(rng.choice((1, 1, 2))):
        place, value = rng.choice([*_within(document)]), json.loads(json.dumps(rng.choice(VALUES)))
        if isinstance(place, dict):
            name = rng.choice([*place] or NAMES) if rng.random() < 0.6 else rng.choice(NAMES)
            place.pop(name, None) if rng.random() < 0.25 else place.update({name: value})
        elif place and rng.random() < 0.8:
            i = rng.randrange(len(place))
            place[i : i + 1] = [] if rng.random() < 0.3 else [value]
        else:
            place.append(value)
    return document


def test_schema_is_a_schema_and_its_file_is_up_to_date() -> None:
    """Otherwise: ./run python docs/generate.py."""
    Draft202012Validator.check_schema(SCHEMA)
    assert (DOCS / "reference" / "plans.schema.json").read_text() == script("generate").plans_schema()


@draws("scenes", 30, 400)
def test_scenes_that_the_product_writes_are_valid(scenes: int) -> None:
    for seed in range(scenes):
        for document in written(seed):
            assert [one.message for one in VALID.iter_errors(document)] == [], seed


def test_every_field_of_a_plan_is_valid_in_a_request() -> None:
    for one in full_plans.specimens():
        document = json.loads(plans_text([one.plan]))
        assert document["version"] == 1
        assert [error.message for error in VALID.iter_errors(document)] == [], one.name


@draws("documents", 1_000, 40_000)
def test_what_the_reader_refuses_is_not_valid(documents: int) -> None:
    """Apart from DIFFERENCES. Most documents are damaged in form, and neither valid nor read."""
    rng = random.Random(documents)  # noqa: S311
    whole = [one for seed in range(25) for one in written(seed)]
    known = [part for parts in DIFFERENCES.values() for part in parts]
    count = {"valid": 0, "invalid": 0}
    for _ in range(documents):
        document = damaged(rng, rng.choice(whole))
        is_valid = VALID.is_valid(document)
        count["valid" if is_valid else "invalid"] += 1
        if is_valid:
            for sentence in refusals(document):
                assert any(part in sentence for part in known), (sentence, document)
    assert min(count.values()) > documents / 10


@pytest.mark.parametrize("version", [2, 1.5, "1", True, [1], 10**400])
@pytest.mark.parametrize("is_scene", [True, False])
def test_another_version_is_neither_valid_nor_read(version: Any, *, is_scene: bool) -> None:
    """It might mean something else; the function admit of SQL refuses it, too."""
    document = json.loads(plans_text([full_plans.track()]))
    if is_scene:
        document["scene"] = {}
    assert (VALID.is_valid(document), refusals(document)) == (True, [])
    document["version"] = version
    assert not VALID.is_valid(document)
    assert [one.split("; got")[0] for one in refusals(document)] == ["file: version: must be 1"]


@pytest.mark.parametrize("kind", ["area", "track"])
def test_every_member_of_a_plan_has_a_schema(kind: str) -> None:
    members = SCHEMA["$defs"][kind]["properties"]["properties"]["properties"]
    names = {name for one in columns_of(kind) for name in one.members} - {"geometry", "properties"}
    assert members.keys() == names | {"kind"}
