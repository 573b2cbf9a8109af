"""Read and write scene files: GeoJSON (RFC 7946) with a foreign member `scene`.

OGC Moving Features JSON uses the same reader: a feature with a `temporalGeometry` is a moving point.
"""

import gc
import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

import shapely

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats import dialects, file_objects, moving_features, names, plain_features, reference
from conflictdb.formats.contents import Contents, FileRefusals, Phase, given_twice, left_out, name_of, row_id, unwatched
from conflictdb.formats.fields import Fields, number_as_key
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.geometry import CUT_TRACK_TYPE, TRACK_TYPE, geometry_type, has_altitudes
from conflictdb.formats.hints import renamed
from conflictdb.formats.json_text import dumped, parse
from conflictdb.formats.rings import LongSides
from conflictdb.formats.standards import altitudes
from conflictdb.formats.track_times import TrackAtSpeed, timed
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.rules import Rule, check_count, members_of, rule_of
from conflictdb.model.settings import NAMES

_SETTINGS: Final = ("name", *NAMES, "rules")
# Rules for members at the wrong place.
_OF_SCENE: Final = dict.fromkeys(NAMES, 'is a setting: put it into the member "scene"')
_OF_FEATURE: Final = dict.fromkeys(
    (file_objects.AREA_MEMBERS | file_objects.TRACK_MEMBERS) - {"kind", "name"},
    "belongs into the properties of a feature",
)
# Features that are read at once.
_AT_ONCE: Final = 1_000
_FEATURE_MEMBERS: Final = ("properties", "geometry", "temporalGeometry", "crs", "trs")


def read_scene(
    text: str,
    stem: str,
    max_speed_kn: float = math.inf,
    *,
    source: str = "",
    skip_invalid: bool = False,
    phase: Phase = unwatched,
) -> Contents:
    """Return the contents of a scene file or an OGC Moving Features JSON file.

    Parameters
    ----------
    text : str
        The whole file.
    stem : str
        Name of the scene if the member `scene` has none.
    max_speed_kn : float
        Tracks that move faster on a leg are refused.
    source : str
        The file, for `Skipped`.
    skip_invalid : bool
        Leave out refused objects; other errors still refuse the file.
    phase : callable, optional
        Called with the name of each phase and the amounts done and to do.

    Raises
    ------
    InvalidInput
        Names every object, field and broken rule, without the file.
    """
    with _without_collector():
        return _read(text, stem, max_speed_kn, source, phase, skip_invalid=skip_invalid)


def read_plans(text: str, scene: Scene, max_speed_kn: float = math.inf) -> list[Area | Track]:
    """Return the plans of `plans_text`, areas first; raises InvalidInput as `read_scene` does.

    scene : that they are for
    """
    with _without_collector():
        found = _read(text, scene.name, max_speed_kn, "", unwatched, skip_invalid=False, settings=scene)
    return [*found.areas, *found.tracks]


@contextmanager
def _without_collector() -> Iterator[None]:
    """Switch off Python's garbage collector: it would visit millions of numbers again and again, and free none."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _read(
    text: str,
    stem: str,
    max_speed_kn: float,
    source: str,
    phase: Phase,
    *,
    skip_invalid: bool,
    settings: Scene | None = None,
) -> Contents:
    """Return the contents of a file; settings : of its objects if it has none."""
    size_mb = len(text) // 1_000_000
    document = parse(text, lambda at: phase("reading MB", at // 1_000_000, size_mb))
    # Requests carry properties of any source, which would name its format.
    if settings is None:
        contents = dialects.read_json(document, source, stem=stem, skip_invalid=skip_invalid)
        if contents is not None:
            return contents
    if not isinstance(document, dict):
        raise InvalidInput("file", "", "must be a GeoJSON FeatureCollection")
    if document.get("type") == "Feature" or moving_features.is_bare(document):
        document = {"type": "FeatureCollection", "features": [moving_features.as_feature(document, stem)]}
    if document.get("type") != "FeatureCollection":
        got = document.get("type")
        raise InvalidInput("file", "type", f"must be 'FeatureCollection' (GeoJSON, RFC 7946); got {got!r:.60}")
    refusals = FileRefusals()
    to_degrees: reference.ToDegrees = None
    systems: reference.Systems = {}
    with refusals:
        to_degrees = reference.of_member("file", document, None, systems)
    with refusals:
        moving_features.check_trs("file", document)
    foreign: Collection[str] = ()
    with refusals:
        foreign = _foreign(document.get("foreign"))
    known = ("scene", "features", "crs", "trs", "foreign", "version")
    refusals.extend(names.misnamed("file", document, known, _OF_SCENE | _OF_FEATURE, foreign))
    scene = None
    with refusals:
        scene = scene_of(document["scene"], stem) if "scene" in document else None
    features = document.get("features")
    if not isinstance(features, list):
        with refusals:
            raise InvalidInput("file", "features", "must be a list of features")
        refusals.raise_found()
        raise AssertionError
    is_foreign = scene is None and settings is None
    setting = file_objects.FileContext.of_settings(
        scene or settings,
        stem,
        foreign,
        to_degrees,
        systems=systems,
        row_ids=stem if is_foreign else "",
        long_sides=LongSides() if is_foreign else None,
    )
    of_objects = FileRefusals()
    items: dict[int, Area | Track | TrackAtSpeed] = {}
    derived: list[str] = []
    high, moving = 0, Counter[str]()
    for first in range(0, len(features), _AT_ONCE):
        some = features[first : first + _AT_ONCE]
        high += sum(map(_is_high, some))
        for feature in some:
            if isinstance(feature, dict) and "temporalGeometry" in feature:
                others = {name: value for name, value in feature.items() if name not in ("properties", "foreign")}
                moving.update(moving_features.STANDARD.of_json(others))
        features[first : first + _AT_ONCE] = [None] * len(some)  # frees each when it is an object
        for i, (feature, plain) in enumerate(zip(some, plain_features.objects(some, setting), strict=True), first):
            if plain is not None:
                items[i] = plain
                continue
            with of_objects:
                items[i] = _object(i, feature, setting, derived)
        phase("checking objects", first + len(some), len(features))
    _leave_unique(items, of_objects)
    areas, tracks = timed(list(items.values()), setting.scene, max_speed_kn, of_objects)
    if not skip_invalid:
        refusals.found += of_objects.found
    refusals.raise_found()
    contents = Contents(scene, areas, tracks, left_out(source, of_objects))
    contents.derived = derived
    contents.remarks = [] if setting.long_sides is None else list(setting.long_sides.remarks(source))
    contents.remarks = [*contents.remarks, *altitudes(source, high), *moving_features.STANDARD.remarks(source, moving)]
    return contents


def _is_high(feature: Any) -> bool:
    """Return whether a feature has altitudes."""
    names = ("geometry", "temporalGeometry")
    return isinstance(feature, dict) and any(has_altitudes(feature.get(name)) for name in names)


def _foreign(names_: Any) -> frozenset[str]:
    """Return the names of members to ignore, as declared by the file."""
    if names_ is None:
        return frozenset()
    if not isinstance(names_, list) or not all(isinstance(name, str) for name in names_):
        raise InvalidInput("file", "foreign", f"must be a list of names of members; got {names_!r:.60}")
    return frozenset(names_)


def _leave_unique(items: dict[int, Area | Track | TrackAtSpeed], refusals: Refusals) -> None:
    """Remove objects that have the id of an earlier one."""
    seen: dict[str, int] = {}
    for i, item in list(items.items()):
        first = seen.setdefault(item.key, i)
        if first != i:
            del items[i]
            with refusals:
                raise given_twice(name_of(item), f"features[{first}] and features[{i}]")


def scene_text(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Yield the lines of a scene file from which `read_scene` reads exactly these objects, one line per feature."""
    yield '{ "type": "FeatureCollection",\n'
    yield f'  "scene": {dumped(settings_of(scene))},\n'
    items: list[Area | Track] = [*areas, *tracks]
    foreign = sorted({name for item in items for name in file_objects.suspect_properties(item)})
    if foreign:  # set by SQL; the reader would take them for misspelt members
        yield f'  "foreign": {dumped(foreign)},\n'
    yield '  "features": ['
    separator = "\n"
    for item in items:
        yield f"{separator}    {dumped(feature_of(item))}"
        separator = ",\n"
    yield " ] }\n"


def plans_text(plans: Sequence[Area | Track]) -> str:
    """Return plans as a scene file without a scene, from which `read_plans` reads exactly these: the form of requests.

    It is a GeoJSON FeatureCollection with "version": 1. The lines that a track says its legs follow are left out.
    """
    foreign = sorted({name for one in plans for name in file_objects.suspect_properties(one)})
    features = [feature_of(one) for one in plans]
    return dumped({"type": "FeatureCollection", "version": 1, "foreign": foreign, "features": features})


def feature_of(item: Area | Track) -> dict[str, Any]:
    """Return an object as a feature of a scene file."""
    if isinstance(item, Track):
        geometry: Mapping[str, Any] = {"type": TRACK_TYPE, "coordinates": item.positions_deg.tolist()}
        properties = file_objects.track_properties(item)
    else:
        parts = shapely.get_parts(item.footprint)
        geometry = shapely.geometry.mapping(parts[0] if len(parts) == 1 else item.footprint)
        properties = file_objects.area_properties(item)
    return {"type": "Feature", "id": item.key, "geometry": geometry, "properties": properties}


def _object(i: int, feature: Any, setting: file_objects.FileContext, derived: list[str]) -> Area | Track | TrackAtSpeed:
    """Return the object of a feature; an id that is derived from its number is added to `derived`."""
    who = f"features[{i}]"
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise InvalidInput(who, "type", "must be a GeoJSON Feature")
    properties = feature.get("properties")
    if properties is None:
        properties = {}
    if isinstance(properties, dict):
        properties = dict(zip(renamed(list(properties)), properties.values(), strict=True))
    key = feature.get("id")
    if key is None and isinstance(properties, dict):  # as written by OGR and others
        named = next((name for name in properties if name.lower() == "id" and properties[name] is not None), "")
        key = properties.get(named)
        properties = {name: value for name, value in properties.items() if name != named}
    if key is None:
        if not setting.row_ids:
            raise InvalidInput(who, "id", "is missing: every feature needs an id, a string that is unique in the scene")
        key = row_id(setting.row_ids, i + 1)
        derived.append(key)
    key = checked_key(who, "id", number_as_key(key))
    if not isinstance(properties, dict):
        raise InvalidInput(f"feature {key!r}", "properties", f"must be an object; got {properties!r:.60}")
    refusals = FileRefusals()
    who = f"feature {key!r}"
    refusals.extend(names.misnamed(who, feature, _FEATURE_MEMBERS, _OF_SCENE | _OF_FEATURE, setting.foreign))
    item: Area | Track | TrackAtSpeed | None = None
    with refusals:
        to_degrees = reference.of_member(who, feature, setting.to_degrees, setting.systems)
        own = replace(setting, to_degrees=to_degrees)
        if feature.get("temporalGeometry") is not None:
            item = moving_features.track(key, feature, properties, own)
        else:
            item = _plain(key, feature.get("geometry"), properties, own)
    refusals.raise_found()
    assert item is not None  # noqa: S101
    return item


def _plain(
    key: str, geometry: Any, properties: dict[str, Any], setting: file_objects.FileContext
) -> Area | Track | TrackAtSpeed:
    """Return the object of a feature with a geometry of plain GeoJSON."""
    kind = geometry_type(f"feature {key!r}", geometry)
    if setting.row_ids and kind in (TRACK_TYPE, CUT_TRACK_TYPE):
        properties = file_objects.with_nested_times(properties)
    if kind == CUT_TRACK_TYPE:
        geometry, properties = file_objects.joined_track(f"track {key!r}", geometry, properties)
        kind = TRACK_TYPE
    is_track = kind == TRACK_TYPE
    fields = Fields(f"{'track' if is_track else 'area'} {key!r}", properties)
    with fields.refusals:
        given_kind = fields.text("kind")
        if given_kind not in (None, "area", "track"):
            raise fields.refusal("kind", f"must be 'area' or 'track'; got {given_kind!r:.60}")
        if given_kind is not None and (given_kind == "track") != is_track:
            rule = f"is {given_kind!r}, but the geometry is a {kind}, which is {'a track' if is_track else 'an area'}"
            raise fields.refusal("kind", rule)
    with fields.refusals:
        to_degrees = reference.of_member(fields.who, geometry, setting.to_degrees, setting.systems)
        setting = replace(setting, to_degrees=to_degrees)
    fields.refusals.extend(names.misnamed(fields.who, geometry, ("coordinates", "crs"), _OF_FEATURE, setting.foreign))
    return (
        file_objects.track(key, geometry, fields, setting)
        if is_track
        else file_objects.area(key, geometry, fields, setting)
    )


def settings_of(scene: Scene) -> dict[str, Any]:
    """Return the settings of a scene as files store them, for `scene_of`: its name, and all that are not None."""
    found = {name: getattr(scene, name) for name in _SETTINGS if getattr(scene, name) is not None}
    rules = [members_of(rule) for rule in found.pop("rules")]
    return found | ({"rules": rules} if rules else {})


def _rules(members: Any, refusals: FileRefusals) -> list[Rule]:
    """Return the separation rules of a file; errors are added to the refusals."""
    found = []
    with refusals:
        if not isinstance(members, list):
            raise InvalidInput("scene", "rules", f"must be a list of rules; got {members!r:.60}")
        check_count(len(members))
        for i, one in enumerate(members):
            with refusals:
                found.append(rule_of(one, f"scene, rules[{i}]"))
    return found


def scene_of(settings: Any, stem: str) -> Scene:
    """Build a scene from settings in a file; raises InvalidInput with all errors."""
    if not isinstance(settings, dict):
        raise InvalidInput("scene", "", f"must be an object of settings; got {settings!r:.60}")
    refusals = FileRefusals()
    for name in (name for name in settings if name not in _SETTINGS):
        meant = names.look_alike(name, _SETTINGS)
        hint = f"did you mean {meant}?" if meant else f"known are {', '.join(_SETTINGS)}"
        with refusals:
            raise InvalidInput("scene", name, f"is no setting of a scene; {hint}")
    refusals.raise_found()
    given = {name: value for name, value in settings.items() if value is not None}
    if "rules" in given:
        given["rules"] = _rules(given["rules"], refusals)
        refusals.raise_found()
    scene = Scene(**{"name": stem, **given})
    checked_key("scene", "name", scene.name)
    return scene
