"""UAS zones (ED-269, ED-318) and operational intents (ASTM F3548): what each field becomes, and one message a mistake.

The files are made here, after the public schemas. `docs/how-to/read-a-feed-of-uas-zones.md` says which public files
were read, with what result.
"""

import copy
import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely

from conflictdb import Area, InvalidInput, read
from conflictdb.formats import FileHints

GEOD = pyproj.Geod(ellps="WGS84")
RING = [[7.0, 47.0], [7.1, 47.0], [7.1, 47.1], [7.0, 47.0]]
AT_ALL_HEIGHTS = FileHints(unbounded_heights=True)


def layered(upper: float = 500, reference: str = "AMSL", lower: float = 0, lower_reference: str = "AGL") -> Any:
    layer = {
        "upper": upper,
        "upperReference": reference,
        "lower": lower,
        "lowerReference": lower_reference,
        "uom": "m",
    }
    return {"type": "Polygon", "coordinates": [RING], "layer": layer}


def ed318(geometry: Any = None, **properties: Any) -> Any:
    own = {
        "identifier": "ZH001",
        "country": "CHE",
        "name": [{"text": "Zone eins", "lang": "de-CH"}, {"text": "Zone one", "lang": "en-GB"}],
        "type": "PROHIBITED",
        "variant": "COMMON",
        "zoneAuthority": [],
    }
    feature = {"type": "Feature", "geometry": geometry or layered(), "properties": own | properties}
    return {"type": "FeatureCollection", "features": [feature]}


def ed269(**members: Any) -> Any:
    volume = {
        "uomDimensions": "FT",
        "lowerLimit": "100",
        "lowerVerticalReference": "AMSL",
        "upperLimit": 1000,
        "upperVerticalReference": "AMSL",
        "horizontalProjection": {"type": "Circle", "center": [7.0, 47.0], "radius": 3280.84},
    }
    zone = {
        "identifier": "ZH001",
        "country": "CHE",
        "name": "Zone one",
        "type": "COMMON",
        "restriction": "PROHIBITED",
        "applicability": [{"permanent": "YES", "dailyPeriod": [{"day": [], "startTime": None, "endTime": None}]}],
        "geometry": [volume],
    }
    return {"title": "t", "features": [zone | members]}


def intent(**volume: Any) -> Any:
    vertices = [{"lng": lon, "lat": lat} for lon, lat in RING[:-1]]
    shape = {
        "outline_polygon": {"vertices": vertices},
        "altitude_lower": {"value": 0, "reference": "W84", "units": "M"},
        "altitude_upper": {"value": 100, "reference": "W84", "units": "M"},
    }
    at = {"time_start": {"value": "2026-03-01T06:00:00Z", "format": "RFC3339"}, "time_end": None}
    details = {"volumes": [{"volume": shape, **at} | volume], "priority": 0}
    return {"operational_intent": {"reference": {"id": "op-1", "manager": "uss1"}, "details": details}}


def found(tmp_path: Path, document: Any, hints: FileHints | None = None) -> list[Area]:
    path = tmp_path / "feed.json"
    path.write_text(json.dumps(document))
    return read(path, hints=hints).areas


def test_a_zone_of_ed318_becomes_an_area(tmp_path: Path) -> None:
    (area,) = found(tmp_path, ed318(region=3))
    assert (area.key, area.name, area.floor_m, area.ceiling_m) == ("ZH001", "Zone one", None, 500.0)
    assert shapely.equals(area.footprint, shapely.Polygon(RING))
    assert area.properties == {
        "country": "CHE", "type": "PROHIBITED", "variant": "COMMON", "zoneAuthority": [], "region": 3
    }  # fmt: skip


def test_a_collection_becomes_an_area_for_each_layer(tmp_path: Path) -> None:
    layers = [layered(100), layered(99999, "AGL", 200, "AMSL")]
    low, high = found(tmp_path, ed318({"type": "GeometryCollection", "geometries": layers}))
    assert [(one.key, one.floor_m, one.ceiling_m) for one in (low, high)] == [
        ("ZH001/1", None, 100.0),
        ("ZH001/2", 200.0, None),
    ]


def test_heights_above_ground_need_a_decision(tmp_path: Path) -> None:
    for geometry in (layered(120, "AGL"), layered(lower=30), layered(120, "WGS84")):
        with pytest.raises(InvalidInput, match=r"zone 'ZH001': geometry.layer.(upper|lower): is measured from"):
            found(tmp_path, ed318(geometry))
    (area,) = found(tmp_path, ed318(layered(120, "AGL", 30)), AT_ALL_HEIGHTS)
    assert (area.floor_m, area.ceiling_m) == (None, None)


def test_a_circle_contains_what_it_says(tmp_path: Path) -> None:
    circle = {"type": "Point", "coordinates": [7.0, 47.0], "extent": {"subType": "Circle", "radius": 1000}}
    for document in (ed318(circle), ed269()):
        (area,) = found(tmp_path, document)
        away_m = [
            GEOD.inv(7.0, 47.0, *corner)[2]
            for corner in shapely.get_coordinates(area.footprint.segmentize(1e-4)).tolist()
        ]
        assert 999.99 < min(away_m) < max(away_m) < 1001.1
    assert (area.floor_m, area.ceiling_m) == (pytest.approx(30.48), pytest.approx(304.8))


def test_one_period_is_the_span_of_the_area(tmp_path: Path) -> None:
    period = {"startDateTime": "2026-03-01T00:00:00+01:00", "endDateTime": "2026-04-01T00:00:00+02:00"}
    (area,) = found(tmp_path, ed318(limitedApplicability=[period]))
    assert np.datetime64(area.start_us, "us") == np.datetime64("2026-02-28T23:00")
    assert np.datetime64(area.end_us, "us") == np.datetime64("2026-03-31T22:00")
    (area,) = found(tmp_path, ed269())
    assert (area.start_us, area.end_us) == (None, None)


def test_an_operational_intent_becomes_an_area_for_each_volume(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"volume\.altitude_lower: is measured from the ellipsoid"):
        found(tmp_path, intent())
    (area,) = found(tmp_path, intent(), AT_ALL_HEIGHTS)
    assert (area.key, area.end_us) == ("op-1/1", None)
    assert area.properties == {"manager": "uss1", "priority": 0, "list": "volumes"}
    assert np.datetime64(area.start_us, "us") == np.datetime64("2026-03-01T06:00")


def test_edges_of_operational_intents_are_shortest_lines(tmp_path: Path) -> None:
    ring = [(0.0, 60.0), (20.0, 60.0), (10.0, 61.5)]
    polygon = {"outline_polygon": {"vertices": [{"lng": lon, "lat": lat} for lon, lat in ring]}}
    (area,) = found(tmp_path, intent(volume=polygon))
    middle = GEOD.npts(*ring[0], *ring[1], 1)[0]
    assert middle[1] > 60.1
    edge = shapely.get_coordinates(area.footprint)
    nearest = edge[np.abs(edge[:, 0] - middle[0]).argsort()[:8]]
    assert np.abs(nearest[:, 1] - middle[1]).min() < 1e-4


MISTAKES: dict[str, tuple[Callable[[], Any], str]] = {
    "no identifier": (lambda: ed318(identifier=""), r"features\[0\]: identifier: must be a non-empty string"),
    "a line": (lambda: ed318({"type": "LineString", "coordinates": RING}), "'ZH001': geometry: must be one of"),
    "a point": (
        lambda: ed318({"type": "Point", "coordinates": [7, 47]}),
        "'ZH001': geometry.extent: must be an object",
    ),
    "an ellipse": (
        lambda: ed318({"type": "Point", "coordinates": [7, 47], "extent": {"subType": "Ellipse", "radius": 1}}),
        "geometry.extent: must be of subType Circle; got 'Ellipse'",
    ),
    "an unknown unit": (
        lambda: ed318({**layered(), "layer": {"upper": 1, "upperReference": "AMSL", "uom": "yd"}}),
        r"'ZH001': geometry.layer.upper: has the unit 'yd'",
    ),
    "an unknown reference": (lambda: ed318(layered(1, "QFE")), "geometry.layer.upper: has the reference 'QFE'"),
    "no reference": (lambda: ed318({**layered(), "layer": {"upper": 1}}), "upper: needs a unit and a reference"),
    "an unknown member of a layer": (
        lambda: ed318({**layered(), "layer": {"uper": 5}}),
        "'ZH001': geometry.layer.uper: is not known here",
    ),
    "an unknown member of a period": (
        lambda: ed318(limitedApplicability=[{"except": []}]),
        r"'ZH001': limitedApplicability\[0\].except: is not known here",
    ),
    "a time without offset": (
        lambda: ed318(limitedApplicability=[{"startDateTime": "2026-03-01T00:00:00"}]),
        r"'ZH001': limitedApplicability\[0\].startDateTime: needs an offset",
    ),
    "the same id": (
        lambda: {"type": "FeatureCollection", "features": ed318()["features"] * 2},
        r"area 'ZH001': id: is given twice, by features\[0\] and features\[1\]",
    ),
    "ED-269 in yards": (
        lambda: ed269(geometry=[{**ed269()["features"][0]["geometry"][0], "uomDimensions": "YD"}]),
        r"'ZH001': geometry\[0\].uomDimensions: must be M or FT; got 'YD'",
    ),
    "ED-269 permanent": (lambda: ed269(applicability=[{"permanent": True}]), "permanent: must be YES or NO"),
    "no outline": (lambda: intent(volume={}), r"volumes\[0\] of intent 'op-1': volume: needs exactly one of"),
    "a circle in feet": (
        lambda: intent(
            volume={"outline_circle": {"center": {"lng": 7, "lat": 47}, "radius": {"value": 5, "units": "FT"}}}
        ),
        "volume.outline_circle.radius: must be an object of value and units, M",
    ),
    "another format of time": (
        lambda: intent(time_start={"value": "2026-03-01T00:00:00Z", "format": "UNIX"}),
        "time_start: must be an object of value and format, RFC3339",
    ),
    "an unknown member of a volume": (lambda: intent(time_stop=None), "time_stop: is not known to ASTM F3548"),
    "two vertices": (
        lambda: intent(volume={"outline_polygon": {"vertices": [{"lng": 7, "lat": 47}] * 2}}),
        "vertices: must be a list of at least three vertices",
    ),
}


def changed(document: Any, where: str, value: Any) -> Any:
    """Return a feed, in which the member at a path of its only zone has another value, or another name ("=name")."""
    *path, last = [int(step) if step.isdigit() else step for step in where.split(".")]
    holder = document["features"][0]
    for step in path:
        holder = holder[step]
    if isinstance(value, str) and value.startswith("="):
        holder[value[1:]] = holder.pop(last)
    elif value is ABSENT:
        del holder[last]
    else:
        holder[last] = value
    return document


def several(**second: Any) -> Any:
    """Return two intents, of which the second has other details."""
    intents = [intent()["operational_intent"] for _ in range(2)]
    intents[1]["reference"]["id"] = "op-2"
    intents[1]["details"] = second
    return {"operational_intents": intents}


@pytest.mark.parametrize("is_list", [True, False])
@pytest.mark.parametrize(
    ("second", "rule"),
    [
        ({"Volumes": [{}]}, "intent 'op-2': Volumes: is not known to ASTM F3548; did you mean volumes?"),
        ({"volumes": [], "offNominalVolumes": [{}]}, "intent 'op-2': offNominalVolumes: .* mean off_nominal_volumes?"),
        ({"volumes": [{"volume": None}]}, r"volumes\[0\] of intent 'op-2': must be an object with a volume"),
        ({"volumes": [None]}, r"volumes\[0\] of intent 'op-2': must be an object with a volume; got None"),
        ({"volumes": {"volume": {}}}, "intent 'op-2': volumes: is missing: give a list of volumes"),
        ({"volumes": [], "extents": {}}, "intent 'op-2': extents: must be a list of volumes"),
        ({}, "intent 'op-2': volumes: is missing: give a list of volumes"),
    ],
)
def test_no_intent_of_several_is_lost(second: Any, rule: str, is_list: bool, tmp_path: Path) -> None:
    """An intent whose volumes were not recognized was left out in silence, beside others."""
    document = several(**second)
    with pytest.raises(InvalidInput, match=rule) as refused:
        found(tmp_path, document["operational_intents"] if is_list else document, AT_ALL_HEIGHTS)
    assert str(refused.value).count("\n") == 0
    assert len(found(tmp_path, several(volumes=[]), AT_ALL_HEIGHTS)) == 1
    alone = {"operational_intent": document["operational_intents"][1]}
    with pytest.raises(InvalidInput, match=rule):
        found(tmp_path, alone, AT_ALL_HEIGHTS)


ABSENT = object()
DAILY = {"day": ["MON"], "startTime": "08:00:00Z", "endTime": "10:00:00Z"}
PERIOD = {"startDateTime": "2026-03-01T00:00:00Z", "endDateTime": "2026-06-01T00:00:00Z"}
CIRCLE = {"type": "Point", "coordinates": [7.0, 47.0], "extent": {"subType": "Circle", "radius": 1000}}
OPEN, LATITUDE = [[*RING[:3], [7.0, 47.01]]], [[[7, 147], [7.1, 147], [7.1, 147.1], [7, 147]]]
DAY = "must be days of MON, TUE, WED, THU, FRI, SAT, SUN or ANY"

# Of the only zone of a feed: the member, what it becomes, and the message.
CHANGES: list[tuple[str, Any, str]] = [
    ("properties.identifier", ABSENT, r"features\[0\]: identifier: must be a non-empty string; got None"),
    ("properties.identifier", "=Identifier", r"features\[0\]: identifier: must be a non-empty string; got None"),
    ("properties.type", ABSENT, "'ZH001': type: must be a non-empty string"),
    ("properties.type", "prohibited", "'ZH001': type: must be in upper case: PROHIBITED; got 'prohibited'"),
    ("geometry.type", "polygon", "'ZH001': geometry: must be one of Polygon"),
    ("geometry.coordinates", OPEN, r"'ZH001': geometry.coordinates\[0\]: a ring must be closed"),
    ("geometry.coordinates", LATITUDE, "'ZH001': geometry: latitude must lie within .* longitude first"),
    ("geometry.coordinates.0.1.0", float("nan"), r"coordinates\[0\]\[1\]\[0\]: must be a finite number"),
    ("geometry.coordinates.0.1.0", "7.1", r"coordinates\[0\]\[1\]\[0\]: must be a number; got '7.1'"),
    ("geometry.layer", "=Layer", "geometry.Layer: is not known here"),
    ("geometry.layer.upper", "500", "geometry.layer.upper: must be a number; got '500'"),
    ("geometry.layer.upper", 50, r"ceiling_m: must be above floor_m \(100\); got 50"),
    ("geometry.layer.upperReference", ABSENT, "geometry.layer.upper: needs a unit and a reference"),
    ("geometry.layer.uom", "feet", "geometry.layer.lower: has the unit 'feet'"),
    ("geometry", {**CIRCLE, "extent": {"subType": "Circle"}}, "geometry.extent.radius: must be a number; got None"),
    (
        "geometry",
        {**CIRCLE, "extent": {"subType": "Circle", "radius": 0}},
        "geometry.extent.radius: must be a number of",
    ),
    (
        "geometry",
        {**CIRCLE, "extent": {"subType": "Circle", "radius": 1, "uom": "km"}},
        "geometry.extent.uom: is not known",
    ),
    (
        "geometry",
        {**CIRCLE, "coordinates": [47.0, 97.0]},
        "'ZH001': geometry: latitude must lie within .* longitude first",
    ),
    ("properties.limitedApplicability", "=LimitedApplicability", "did you mean limitedApplicability?"),
    ("properties.limitedApplicability", "=limitedApplicabilty", "did you mean limitedApplicability?"),
    ("properties.limitedApplicability", "=applicability", "did you mean limitedApplicability?"),
    ("properties.limitedApplicability.0.endDateTime", "2026-02-01T00:00:00Z", "end: must be later than start"),
    (
        "properties.limitedApplicability.0.startDateTime",
        "2026-02-29T00:00:00Z",
        "startDateTime: must be a date and time",
    ),
    ("properties.limitedApplicability.0.schedule", DAILY, r"limitedApplicability\[0\].schedule: must be a list"),
    ("properties.limitedApplicability.0.dailyPeriod", [DAILY], "dailyPeriod: must not be given together with schedule"),
    ("properties.limitedApplicability.0.schedule.0.day", ["Monday"], DAY),
    ("properties.limitedApplicability.0.schedule.0.endTime", "24:01:00Z", "endTime: must be a time of day"),
    ("properties.limitedApplicability.0.schedule.0.endTime", "10:00:00", "endTime: needs an offset from UTC"),
    ("properties.limitedApplicability.0.schedule.0.startEvent", "SR", "needs either startTime or startEvent"),
    ("restriction", ABSENT, "'ZH001': restriction: must be a non-empty string"),
    ("identifier", ABSENT, r"features\[0\]: identifier: must be a non-empty string"),
    ("geometry", ABSENT, "'ZH001': geometry: must be a list; got None"),
    ("geometry.0.lowerLimit", "--5", r"geometry\[0\].lowerLimit: must be a number; got '--5'"),
    ("geometry.0.lowerLimit", "²", r"geometry\[0\].lowerLimit: must be a number; got '²'"),
    ("geometry.0.upperLimit", "=UpperLimit", r"geometry\[0\].UpperLimit: is not known here"),
    (
        "geometry.0.horizontalProjection.radius",
        0,
        r"geometry\[0\].horizontalProjection.radius: must be a number of metres",
    ),
    (
        "geometry.0.horizontalProjection.center",
        [47.0],
        r"geometry\[0\].horizontalProjection.center: must be a position",
    ),
    ("geometry.0.horizontalProjection.center", "=centre", "horizontalProjection.centre: is not known here"),
    ("geometry.0.horizontalProjection.type", "Polygon", "horizontalProjection.center: is not known here"),
    ("applicability", "=limitedApplicability", "limitedApplicability: is not known here; did you mean applicability?"),
    ("applicability.0", {**PERIOD, "permanent": "YES"}, "permanent: is YES, but a start or an end is given"),
    ("applicability.0", {"schedule": [DAILY], "dailyPeriod": [DAILY]}, "dailyPeriod: must not be given together"),
]


@pytest.mark.parametrize(("where", "value", "rule"), CHANGES)
def test_a_changed_member_has_one_message_that_names_it(where: str, value: Any, rule: str, tmp_path: Path) -> None:
    """A first zone without an identifier does not change the format of a feed."""
    is_318 = (where.startswith(("properties", "geometry.")) and not where.startswith("geometry.0")) or value == CIRCLE
    is_318 |= isinstance(value, dict) and "extent" in value
    limited = [PERIOD | {"schedule": [DAILY]}]
    document = ed318(layered(lower=100, lower_reference="AMSL"), limitedApplicability=limited) if is_318 else ed269()
    with pytest.raises(InvalidInput, match=rule) as refused:
        found(tmp_path, changed(copy.deepcopy(document), where, value))
    assert str(refused.value).count("\n") == 0


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_has_one_message_that_names_it(mistake: str, tmp_path: Path) -> None:
    made, rule = MISTAKES[mistake]
    with pytest.raises(InvalidInput, match=rule) as refused:
        found(tmp_path, made(), None if "reference" in mistake or "unit" in mistake else AT_ALL_HEIGHTS)
    assert str(refused.value).count("\n") == 0


def test_any_member_of_a_wrong_type_is_refused_as_input(tmp_path: Path) -> None:
    """Replacing any one value of a file never ends in another error than InvalidInput."""

    def places(value: Any, path: tuple[Any, ...] = ()) -> Any:
        yield path
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for name, member in items:
            yield from places(member, (*path, name))

    period = {"startDateTime": "2026-03-01T00:00:00Z", "endDateTime": None, "schedule": []}
    for document in (ed318(limitedApplicability=[period]), ed269(), intent()):
        for path in list(places(document))[1:]:
            for value in (None, "x", [5], {"x": 5}):
                changed = copy.deepcopy(document)
                holder = changed
                for name in path[:-1]:
                    holder = holder[name]
                holder[path[-1]] = value
                with suppress(InvalidInput):
                    found(tmp_path, changed, AT_ALL_HEIGHTS)


def test_periods_become_spans_and_schedules(tmp_path: Path) -> None:
    """Several periods are spans; daily periods stay as they are, each within its own dates."""
    march = {"startDateTime": "2026-03-01T00:00:00Z", "endDateTime": "2026-04-01T00:00:00Z"}
    may = {"startDateTime": "2026-05-01T00:00:00Z", "endDateTime": "2026-06-01T00:00:00Z"}
    (area,) = found(tmp_path, ed318(limitedApplicability=[may, march]))
    assert area.spans_us is not None
    assert [str(np.datetime64(start, "us"))[:10] for start, _ in area.spans_us] == ["2026-03-01", "2026-05-01"]
    daily = {"schedule": [{"day": ["MON"], "startTime": "08:00:00Z", "endTime": "10:00:00Z"}]}
    (area,) = found(tmp_path, ed318(limitedApplicability=[march | daily]))
    assert area.schedule == {"ed318": daily["schedule"]}
    (area,) = found(tmp_path, ed318(limitedApplicability=[march | daily, may]))
    assert [sorted(rule) for rule in area.schedule] == [["ed318", "from", "until"], ["from", "until"]]
    with pytest.raises(InvalidInput, match=r"zone 'ZH001': schedule\.ed318|area 'ZH001': schedule"):
        found(tmp_path, ed318(limitedApplicability=[{"schedule": [{"day": ["HOL"], "startTime": "08:00:00Z"}]}]))


def test_a_zone_has_a_class_and_its_volumes_one_owner(tmp_path: Path) -> None:
    low, high = found(tmp_path, ed318({"type": "GeometryCollection", "geometries": [layered(100), layered(200)]}))
    assert {(one.object_class, one.owner) for one in (low, high)} == {("PROHIBITED", "ZH001")}
    assert [one.owner for one in found(tmp_path, ed318())] == [None]
    assert [one.owner for one in found(tmp_path, intent(), AT_ALL_HEIGHTS)] == ["op-1"]
