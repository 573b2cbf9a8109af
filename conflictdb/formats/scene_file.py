"""Read and write scene files: GeoJSON (RFC 7946) with a foreign member `scene`.

OGC Moving Features JSON uses the same reader: a feature with a `temporalGeometry` is a moving point.
"""

import gc
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any, Final, NamedTuple, TypeAlias

import shapely

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats import dialects, file_objects, moving_features, names, plain_features, reference
from conflictdb.formats.contents import (
    Contents,
    FileRefusals,
    Parts,
    Phase,
    Remark,
    given_twice,
    left_out,
    name_of,
    row_id,
    unwatched,
)
from conflictdb.formats.fields import Fields, number_as_key
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.geometry import CUT_TRACK_TYPE, TRACK_TYPE, geometry_type, has_altitudes
from conflictdb.formats.hints import renamed
from conflictdb.formats.json_stream import NoObjectError, joined, members
from conflictdb.formats.json_text import dumped, parse
from conflictdb.formats.rings import LongSides
from conflictdb.formats.standards import altitudes
from conflictdb.formats.summary import Summary
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
_AT_ONCE: Final = 2_000
_MEMBERS: Final = ("scene", "features", "crs", "trs", "foreign", "version")
# Members that decide how features are read.
_DECIDING: Final = frozenset({"scene", "crs", "foreign"})
_FEATURE_MEMBERS: Final = ("properties", "geometry", "temporalGeometry", "crs", "trs")


# Opens the text of a file, in parts; may be called again.
Chunks: TypeAlias = Callable[[], Iterator[str]]


class LateMembersError(Exception):
    """A file has members that decide how its features are read after these: it is to be read again.

    members : all of the file but its features
    """

    def __init__(self, members: Mapping[str, Any]) -> None:
        super().__init__()
        self.members = members


def read_scene(
    text: str | Chunks,
    stem: str,
    max_speed_kn: float = math.inf,
    *,
    source: str = "",
    skip_invalid: bool = False,
    phase: Phase = unwatched,
    size_mb: int = 0,
) -> Contents:
    """Return the contents of a scene file or an OGC Moving Features JSON file.

    Parameters
    ----------
    text : str, or a function that returns its parts
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
    size_mb : int
        Millions of characters of the text, for `phase`; 0: unknown.

    Raises
    ------
    InvalidInput
        Names every object, field and broken rule, without the file.
    """
    chunks = (lambda: iter([text])) if isinstance(text, str) else text
    opened = partial(
        _opened, chunks, _ReadOptions(stem, max_speed_kn, source, phase, size_mb), skip_invalid=skip_invalid
    )
    with without_collector():
        return _contents(opened, skip_invalid=skip_invalid)


def read_plans(text: str, scene: Scene, max_speed_kn: float = math.inf) -> list[Area | Track]:
    """Return the plans of `plans_text`, areas first; raises InvalidInput as `read_scene` does.

    scene : that they are for
    """
    opened = partial(_opened, lambda: iter([text]), _ReadOptions(scene.name, max_speed_kn, settings=scene))
    with without_collector():
        found = _contents(opened, skip_invalid=False)
    return [*found.areas, *found.tracks]


def scene_parts(
    chunks: Chunks,
    stem: str,
    max_speed_kn: float,
    summary: Summary,
    *,
    source: str,
    phase: Phase,
    size_mb: int,
    most: float,
    late: Mapping[str, Any] | None,
) -> Parts:
    """Return the result of `read_scene` in parts, to bound memory; a file of another program is one part.

    summary : of the objects that are read
    most : characters that may be kept: of members but the features, of a feature, and of a file of another program
    late : of a LateMembersError of the same file

    Reading the parts raises a LateMembersError if the file is to be read again.
    """
    summary.apart = _features_apart
    reading = _opened(chunks, _ReadOptions(stem, max_speed_kn, source, phase, size_mb, most), late)
    if isinstance(reading, Contents):
        parts = Parts(reading.scene, iter([(reading.areas, reading.tracks)]))
        parts.skipped += reading.skipped
        parts.remarks += reading.remarks
        parts.derived += reading.derived
        return parts
    parts = Parts(reading.scene, iter(()), derived=reading.derived)
    parts.each = _each_part(reading, parts, summary)
    return parts


def _each_part(reading: "_Features", parts: Parts, summary: Summary) -> Iterator[tuple[list[Area], list[Track]]]:
    slow, twice = FileRefusals(), FileRefusals()
    for some in reading.items():
        unique: dict[int, Area | Track | TrackAtSpeed] = {}
        for i, item in some.items():
            first = summary.first(item.key, i)
            if first == i:
                unique[i] = item
            else:
                twice.extend([given_twice(name_of(item), _features_apart(first, i))])
        found = timed(list(unique.values()), reading.setting.scene, reading.options.max_speed_kn, slow)
        parts.refusals.found[:] = [*reading.refused(), *twice.found, *slow.found]
        del parts.derived[1:]
        yield found
    parts.refusals.found[:] = [*reading.refused(), *twice.found, *slow.found]
    parts.remarks += reading.remarks()


@contextmanager
def without_collector() -> Iterator[None]:
    """Switch off Python's garbage collector: it would visit millions of numbers again and again, and free none."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


class _ReadOptions(NamedTuple):
    """How a file is read.

    most : characters of its members but the features, of one of these, and of a file of another program
    settings : of its objects if it has none
    """

    stem: str
    max_speed_kn: float
    source: str = ""
    phase: Phase = unwatched
    size_mb: int = 0
    most: float = math.inf
    settings: Scene | None = None


def _opened(
    chunks: Chunks, options: _ReadOptions, late: Mapping[str, Any] | None = None, *, skip_invalid: bool = False
) -> "_Features | Contents":
    """Return a file whose features are read in parts, or the contents of a file of another program."""
    document: dict[str, Any] = {}
    events = members(
        chunks(), _AT_ONCE, options.most, lambda at: options.phase("reading MB", at // 1_000_000, options.size_mb)
    )
    try:
        for name, value, is_part in events:
            document[name] = value
            if is_part:
                # Requests carry properties of any source, which would name its format.
                if options.settings is None and dialects.is_known({**(late or {}), **document}):
                    raise NoObjectError
                if "type" in document:
                    _require_collection(document)
                features = chain([document.pop("features")], _parts_of(document, events))
                return _Features(dict(document) if late is None else late, features, options, document)
        whole: Any = document
    except NoObjectError:
        whole = parse(joined(chunks(), options.most))
    if options.settings is None:
        contents = dialects.read_json(whole, options.source, stem=options.stem, skip_invalid=skip_invalid)
        if contents is not None:
            return contents
    if not isinstance(whole, dict):
        raise InvalidInput("file", "", "must be a GeoJSON FeatureCollection")
    if whole.get("type") == "Feature" or moving_features.is_bare(whole):
        whole = {"type": "FeatureCollection", "features": [moving_features.as_feature(whole, options.stem)]}
    _require_collection(whole)
    listed = whole.pop("features", None)
    return _Features(whole, iter([listed] if isinstance(listed, list) else []), options, whole, listed)


def _parts_of(document: dict[str, Any], events: Iterator[tuple[str, Any, bool]]) -> Iterator[list[Any]]:
    """Yield the rest of the features of a file, then add its other members to `document`."""
    for name, value, is_part in events:
        if is_part:
            yield value
        else:
            document[name] = value


def _require_collection(document: Mapping[str, Any]) -> None:
    if document.get("type") != "FeatureCollection":
        got = document.get("type")
        raise InvalidInput("file", "type", f"must be 'FeatureCollection' (GeoJSON, RFC 7946); got {got!r:.60}")


def _require_version(version: Any) -> None:
    if version is not None and (isinstance(version, bool) or version != 1):
        raise InvalidInput("file", "version", f"must be 1; got {version!r:.60}")


class _Features:
    """The features of a file and what decides how they are read; its errors are collected until `refused`.

    known : members of the file but its features, as far as they are known
    features : lists of features
    document : members of the file; those after the features are there once these were read
    listed : its features, if they are no list
    """

    def __init__(
        self,
        known: Mapping[str, Any],
        features: Iterator[list[Any]],
        options: _ReadOptions,
        document: Mapping[str, Any],
        listed: Any = (),
    ) -> None:
        self.options = options
        self._known, self._features, self._document, self._listed = known, features, document, listed
        self._of_file, self._of_members, self._of_scene = FileRefusals(), FileRefusals(), FileRefusals()
        self.of_objects = FileRefusals()
        self.derived: list[str] = []
        self._high, self._moving = 0, Counter[str]()
        systems: reference.Systems = {}
        to_degrees: reference.ToDegrees = None
        with self._of_file:
            to_degrees = reference.of_member("file", known, None, systems)
        foreign: Collection[str] = ()
        with self._of_file:
            foreign = _foreign(known.get("foreign"))
        self.scene: Scene | None = None
        with self._of_scene:
            self.scene = scene_of(known["scene"], options.stem) if "scene" in known else None
        is_foreign = self.scene is None and options.settings is None
        self.setting = file_objects.FileContext.of_settings(
            self.scene or options.settings,
            options.stem,
            foreign,
            to_degrees,
            systems=systems,
            row_ids=options.stem if is_foreign else "",
            long_sides=LongSides() if is_foreign else None,
        )

    def items(self) -> Iterator[dict[int, Area | Track | TrackAtSpeed]]:
        """Yield the objects of each list of features, by their places in the file.

        Raises LateMembersError, after the last list, if the file is to be read again.
        """
        first = 0
        for some in self._features:
            items: dict[int, Area | Track | TrackAtSpeed] = {}
            self._high += sum(map(_is_high, some))
            for feature in some:
                if isinstance(feature, dict) and "temporalGeometry" in feature:
                    others = {name: value for name, value in feature.items() if name not in ("properties", "foreign")}
                    self._moving.update(moving_features.STANDARD.of_json(others))
            for i, plain in enumerate(plain_features.objects(some, self.setting, first, self.derived)):
                feature, some[i] = some[i], None  # frees each when it is an object
                if plain is not None:
                    items[first + i] = plain
                    continue
                with self.of_objects:
                    items[first + i] = _object(first + i, feature, self.setting, self.derived)
            first += len(some)
            yield items
        self._end()

    def _end(self) -> None:
        """Check what is known at the end of the file only."""
        document = self._document
        late = document.keys() - self._known.keys()
        if late & _DECIDING or (late and self.options.settings is None and dialects.is_known(document)):
            raise LateMembersError(document)
        _require_collection(document)
        foreign, values = self.setting.foreign, {"features": self._listed, **document}
        with self._of_file:
            moving_features.check_trs("file", document)
        # Files of other programs may have versions of their own.
        if self.scene is not None or self.options.settings is not None:
            with self._of_file:
                _require_version(document.get("version"))
        self._of_members.extend(names.misnamed("file", values, _MEMBERS, _OF_SCENE | _OF_FEATURE, foreign))
        if not isinstance(self._listed, list | tuple):
            with self._of_scene:
                raise InvalidInput("file", "features", "must be a list of features")

    def refused(self) -> list[InvalidInput]:
        """Return the errors so far: of the file, then of its objects."""
        return [*self.of_the_file(), *self.of_objects.found]

    def of_the_file(self) -> list[InvalidInput]:
        """Return the errors so far of the file as a whole."""
        return [*self._of_file.found, *self._of_members.found, *self._of_scene.found]

    def remarks(self) -> Iterator[Remark]:
        """Yield remarks on what was read."""
        source = self.options.source
        if self.setting.long_sides is not None:
            yield from self.setting.long_sides.remarks(source)
        yield from altitudes(source, self._high)
        yield from moving_features.STANDARD.remarks(source, self._moving)


def _contents(opened: "Callable[..., _Features | Contents]", *, skip_invalid: bool) -> Contents:
    late: Mapping[str, Any] | None = None
    while True:
        reading = opened(late)
        if isinstance(reading, Contents):
            return reading
        items: dict[int, Area | Track | TrackAtSpeed] = {}
        try:
            for some in reading.items():
                items |= some
        except LateMembersError as found:
            late = found.members
        else:
            break
    options, of_objects = reading.options, reading.of_objects
    _leave_unique(items, of_objects)
    areas, tracks = timed(list(items.values()), reading.setting.scene, options.max_speed_kn, of_objects)
    refusals = FileRefusals()
    refusals.found = reading.of_the_file() if skip_invalid else reading.refused()
    refusals.raise_found()
    contents = Contents(reading.scene, areas, tracks, left_out(options.source, of_objects))
    contents.derived = reading.derived
    contents.remarks = list(reading.remarks())
    return contents


def _features_apart(first: int, i: int) -> str:
    """Return the places of two features that have the same id."""
    return f"features[{first}] and features[{i}]"


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
                raise given_twice(name_of(item), _features_apart(first, i))


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
        named = next((name for name in properties if name.lower() == "id" and properties[name] is not None), None)
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
