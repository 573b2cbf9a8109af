"""Scene files: GeoJSON (RFC 7946) with a foreign member `scene`, read and written.

OGC Moving Features JSON is read by the same walk: a feature with a `temporalGeometry` is a moving point.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields as members_of
from typing import Any, Final

import shapely

from conflictdb.errors import InvalidInput
from conflictdb.io import moving_features, objects
from conflictdb.io.contents import Contents
from conflictdb.io.fields import Fields
from conflictdb.io.fields import key as checked_key
from conflictdb.io.geometry import TRACK_TYPE, geometry_type
from conflictdb.io.json_text import parse
from conflictdb.model import Area, Scene, Track

_SETTINGS: Final = tuple(member.name for member in members_of(Scene))
# GeoJSON of 2008 named its reference system; what that may be is what RFC 7946 made the only one.
_LONGITUDE_LATITUDE: Final = ("CRS84", "EPSG:4326", "EPSG::4326")


def read_scene(text: str, stem: str) -> Contents:
    """Return what a scene file or an OGC Moving Features JSON file holds.

    Parameters
    ----------
    text : str
        The whole file.
    stem : str
        Name of the scene if the member `scene` has none.

    Raises
    ------
    InvalidInput
        Names the first object, field and rule that is broken, without the file.
    """
    document = parse(text)
    if not isinstance(document, dict):
        raise InvalidInput("file", "", "must be a GeoJSON FeatureCollection")
    if document.get("type") == "Feature" or moving_features.is_bare(document):
        document = {"type": "FeatureCollection", "features": [moving_features.as_feature(document, stem)]}
    if document.get("type") != "FeatureCollection":
        got = document.get("type")
        raise InvalidInput("file", "type", f"must be 'FeatureCollection' (GeoJSON, RFC 7946); got {got!r:.60}")
    _check_crs("file", document)
    moving_features.check_trs("file", document)
    scene = _scene(document["scene"], stem) if "scene" in document else None
    features = document.get("features")
    if not isinstance(features, list):
        raise InvalidInput("file", "features", "must be a list of features")
    items = [_object(i, feature) for i, feature in enumerate(features)]
    _check_unique(items)
    areas = [item for item in items if isinstance(item, Area)]
    at_speed = iter(
        objects.timed(
            [item for item in items if isinstance(item, objects.TrackAtSpeed)],
            scene or Scene(stem),
        )
    )
    tracks = [item if isinstance(item, Track) else next(at_speed) for item in items if not isinstance(item, Area)]
    return Contents(scene, areas, tracks, [])


def _check_unique(items: Sequence[Area | Track | objects.TrackAtSpeed]) -> None:
    seen: dict[str, int] = {}
    for i, item in enumerate(items):
        if item.key in seen:
            kind = "area" if isinstance(item, Area) else "track"
            rule = f"is given twice, by features[{seen[item.key]}] and features[{i}]; ids must be unique in the scene"
            raise InvalidInput(f"{kind} {item.key!r}", "id", rule)
        seen[item.key] = i


def scene_text(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Yield the lines of the scene file that `read_scene` reads back as exactly these objects, one line per feature."""
    settings = {name: getattr(scene, name) for name in _SETTINGS if getattr(scene, name) is not None}
    yield '{ "type": "FeatureCollection",\n'
    yield f'  "scene": {_dumped(settings)},\n'
    yield '  "features": ['
    separator = "\n"
    items: list[Area | Track] = [*areas, *tracks]
    for item in items:
        yield f"{separator}    {_dumped(_feature(item))}"
        separator = ",\n"
    yield " ] }\n"


def _dumped(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _feature(item: Area | Track) -> dict[str, Any]:
    if isinstance(item, Track):
        geometry: Mapping[str, Any] = {"type": TRACK_TYPE, "coordinates": item.positions_deg.tolist()}
        properties = objects.track_properties(item)
    else:
        parts = shapely.get_parts(item.footprint)
        geometry = shapely.geometry.mapping(parts[0] if len(parts) == 1 else item.footprint)
        properties = objects.area_properties(item)
    return {"type": "Feature", "id": item.key, "geometry": geometry, "properties": properties}


def _object(i: int, feature: Any) -> Area | Track | objects.TrackAtSpeed:
    who = f"features[{i}]"
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise InvalidInput(who, "type", "must be a GeoJSON Feature")
    key = feature.get("id")
    if key is None:
        raise InvalidInput(who, "id", "is missing: every feature needs an id, a string that is unique in the scene")
    key = checked_key(who, "id", key)
    properties = feature.get("properties")
    if properties is None:
        properties = {}
    if not isinstance(properties, dict):
        raise InvalidInput(f"feature {key!r}", "properties", f"must be an object; got {properties!r:.60}")
    _check_crs(f"feature {key!r}", feature)
    if feature.get("temporalGeometry") is not None:
        return moving_features.track(key, feature, properties)
    kind = geometry_type(f"feature {key!r}", feature.get("geometry"))
    geometry: dict[str, Any] = feature["geometry"]
    is_track = kind == TRACK_TYPE
    fields = Fields(f"{'track' if is_track else 'area'} {key!r}", properties)
    said = fields.text("kind")
    if said not in (None, "area", "track"):
        raise fields.refusal("kind", f"must be 'area' or 'track'; got {said!r:.60}")
    if said is not None and (said == "track") != is_track:
        raise fields.refusal(
            "kind", f"is {said!r}, but the geometry is a {kind}, which is {'a track' if is_track else 'an area'}"
        )
    _check_crs(fields.who, geometry)
    return objects.track(key, geometry, fields) if is_track else objects.area(key, geometry, fields)


def _scene(settings: Any, stem: str) -> Scene:
    if not isinstance(settings, dict):
        raise InvalidInput("scene", "", f"must be an object of settings; got {settings!r:.60}")
    unknown = [name for name in settings if name not in _SETTINGS]
    if unknown:
        raise InvalidInput("scene", unknown[0], f"is no setting of a scene; known are {', '.join(_SETTINGS)}")
    given = {name: value for name, value in settings.items() if value is not None}
    scene = Scene(**{"name": stem, **given})
    checked_key("scene", "name", scene.name)
    return scene


def _check_crs(who: str, holder: Mapping[str, Any]) -> None:
    """Refuse a reference system other than longitude and latitude on WGS84."""
    if "crs" not in holder:
        return
    crs = holder["crs"]
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str) or not name.upper().endswith(_LONGITUDE_LATITUDE):
        rule = "must be longitude and latitude on WGS84 (CRS84 or EPSG:4326), or be left out, as RFC 7946 says"
        raise InvalidInput(who, "crs", f"{rule}; got {name if name else crs!r:.60}")
