"""A file of each format with every name of its standard that is a time, height, speed, size or limit.

`WHOLE` has the text of a file, by its name.
"""

import json
from typing import Any

RING = [[9.0, 57.0], [9.2, 57.0], [9.2, 57.2], [9.0, 57.2], [9.0, 57.0]]
T = [f"2026-06-01T{hour:02}:00:00Z" for hour in range(10, 15)]
HAVEN = {"fore_m": 5.0, "aft_m": 5.0, "port_m": 2.0, "starboard_m": 2.0}


def feature(key: str, kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "id": key, "geometry": geometry, "properties": properties}


def scene() -> str:
    """Objects that together have every member, and properties that are not read of objects without a quantity."""
    line = [[9.0, 57.0], [9.5, 57.2], [10.0, 57.1]]
    limits = {"xtd_port_m": 50, "xtd_starboard_m": 50, "turn_radius_m": 300, "min_speed_kn": 1, "max_speed_kn": 40}
    windows = {"departure_window": [T[0], T[1]], "arrival_window": [T[3], T[4]]}
    square = [[-5, 5], [5, 5], [5, -5], [-5, -5]]
    features = [
        feature("A", "Polygon", [RING], start=T[0], end=T[1], floor_m=0, ceiling_m=900, vertical_datum="msl"),
        feature("B", "Polygon", [RING], spans=[[T[0], T[1]], [T[2], T[3]]]),
        feature("C", "Polygon", [RING], schedule={"days": ["TUE"]}),
        feature("D", "Point", [9.0, 57.0], radius_m=500, valid_from="2026-06-01T08:00:00Z", lowerLimit=100),
        feature("T", "LineString", line, times=T[:3], **HAVEN, grow_mps=0.1, departures=[T[0], T[3]]),
        feature("U", "LineString", line, datetimes=T[:3], outline_m=square),
        feature("V", "LineString", line, times=T[:3], outlines_m=[square, square, square]),
        feature("W", "LineString", line, start=T[0], speed_kn=12, fore_nmi=1, aft_nmi=1, port_nmi=1, starboard_nmi=1),
        feature("X", "LineString", line, start=T[0], speed_mps=5, **HAVEN),
        feature("Y", "LineString", line, times=[T[0], T[1], T[3]], **HAVEN, **limits, **windows),
        feature("Z", "LineString", line, times=T[:3], fore_m=0, aft_m=0, port_m=0, starboard_m=0, length=12),
    ]
    return json.dumps({"type": "FeatureCollection", "features": features})


def ed269() -> str:
    volume = {
        "uomDimensions": "M",
        "lowerLimit": 50,
        "lowerVerticalReference": "AMSL",
        "upperLimit": 120,
        "upperVerticalReference": "AMSL",
        "horizontalProjection": {"type": "Circle", "center": [9.0, 57.0], "radius": 1000},
    }
    daily = {"day": ["MON"], "startTime": "08:00:00Z", "endTime": "10:00:00Z"}
    zone = {
        "identifier": "Z",
        "country": "DNK",
        "name": "Z",
        "type": "COMMON",
        "restriction": "PROHIBITED",
        "applicability": [
            {"startDateTime": T[0], "endDateTime": "2026-07-01T00:00:00Z", "permanent": "NO", "schedule": [daily]},
            {"startDateTime": T[0], "endDateTime": "2026-07-01T00:00:00Z", "dailyPeriod": [daily]},
        ],
        "zoneAuthority": [{"name": "A", "purpose": "AUTHORIZATION", "intervalBefore": "P3D"}],
        "geometry": [volume],
        "dataSource": {"creationDateTime": T[0], "updateDateTime": T[0]},
    }
    return json.dumps({"title": "t", "validFrom": T[0], "validTo": T[4], "features": [zone]})


def ed318() -> str:
    layer = {"upper": 500, "upperReference": "AMSL", "lower": 10, "lowerReference": "AMSL", "uom": "m"}
    circle = {
        "type": "Point",
        "coordinates": [9.0, 57.0],
        "extent": {"subType": "Circle", "radius": 800},
        "layer": layer,
    }
    daily = {"day": ["MON"], "startTime": "08:00:00Z", "endTime": "10:00:00Z"}
    own = {
        "identifier": "Z",
        "country": "DNK",
        "type": "PROHIBITED",
        "variant": "COMMON",
        "limitedApplicability": [
            {"startDateTime": T[0], "endDateTime": "2026-07-01T00:00:00Z", "schedule": [daily]},
        ],
        "zoneAuthority": [{"name": "A", "purpose": "AUTHORIZATION", "intervalBefore": "P3D"}],
        "dataSource": {"creationDateTime": T[0], "updateDateTime": T[0]},
    }
    zone = {"type": "Feature", "geometry": circle, "properties": own}
    metadata = {"validFrom": T[0], "validTo": T[4], "issued": T[0]}
    return json.dumps({"type": "FeatureCollection", "metadata": metadata, "features": [zone]})


def f3548() -> str:
    def at(text: str) -> dict[str, str]:
        return {"value": text, "format": "RFC3339"}

    def height(metres: float) -> dict[str, Any]:
        return {"value": metres, "units": "M", "reference": "W84"}

    circle = {"center": {"lng": 9.0, "lat": 57.0}, "radius": {"value": 500, "units": "M"}}
    volume = {"outline_circle": circle, "altitude_lower": height(10), "altitude_upper": height(90)}
    reference = {"id": "I", "version": 1, "time_start": at(T[0]), "time_end": at(T[1])}
    details = {"volumes": [{"volume": volume, "time_start": at(T[0]), "time_end": at(T[1])}], "priority": 0}
    return json.dumps({"operational_intent": {"reference": reference, "details": details}})


MFJSON = json.dumps(
    {
        "type": "Feature",
        "id": "M",
        "temporalGeometry": {
            "type": "MovingPoint",
            "datetimes": T[:2],
            "coordinates": [[9.0, 57.0, 300.0], [9.5, 57.1, 300.0]],
            "interpolation": "Linear",
        },
        "temporalProperties": [{"datetimes": T[:2], "speed": {"values": [5, 6], "interpolation": "Linear"}}],
        "time": T[:2],
        "properties": {"floor_m": 1.0, "ceiling_m": 2.0, **HAVEN},
    }
)
POINT = '<{0} lat="{1}" lon="{2}"><ele>10</ele><time>{3}</time><geoidheight>40</geoidheight><hdop>1</hdop>'
POINT += "<vdop>1</vdop><pdop>1</pdop><ageofdgpsdata>1</ageofdgpsdata><extensions><speed>5</speed><depth>3</depth>"
POINT += "<Depth>3</Depth><Proximity>20</Proximity>{4}</extensions></{0}>"
GPX = (
    '<gpx version="1.1"><metadata><time>2026-06-01T00:00:00Z</time></metadata>'
    '<wpt lat="57" lon="9"><ele>1</ele></wpt><rte><name>R</name><extensions>'
    f"<planned_departure>{T[0]}</planned_departure><planned_speed>9</planned_speed><start>A</start><end>B</end>"
    "<style><width>2</width></style><line><width>2</width></line></extensions>"
    + POINT.format("rtept", 57, 9, T[0], '<waypoint_range_rings number="1"/>')
    + POINT.format("rtept", 57.1, 9.1, T[1], f'<rte_properties arrival_radius="0.1" etd="{T[2]}"/>')
    + POINT.format("rtept", 57.2, 9.3, T[2], "")
    + "</rte><rte><name>G</name>"
    + POINT.format("rtept", 57, 9, T[0], f"<ViaPoint><DepartureTime>{T[0]}</DepartureTime></ViaPoint>")
    + POINT.format("rtept", 57.1, 9.1, T[1], f"<ViaPoint><ArrivalTime>{T[1]}</ArrivalTime></ViaPoint>")
    + "</rte><trk><name>T</name><trkseg>"
    + POINT.format("trkpt", 57, 9, T[0], "")
    + POINT.format("trkpt", 57.1, 9.1, T[1], "")
    + "</trkseg></trk></gpx>"
)
LEG = 'portsideXTD="0.1" starboardXTD="0.2" speedMin="3" speedMax="20" draughtForward="4" draughtAft="4" '
LEG += 'staticUKC="2" dynamicUKC="2" masthead="30" safetyContour="10" safetyDepth="12"'
RTZ = (
    '<route xmlns="http://www.cirm.org/RTZ/1/2" version="1.2"><routeInfo routeName="R" '
    f'validityPeriodStart="{T[0]}" validityPeriodStop="{T[4]}" vesselSpeedMax="20" vesselSpeedMin="2" '
    'vesselServiceMin="1" vesselServiceMax="2" vesselMaxRoll="10" vesselMaxWave="3" vesselMaxWind="20"/><waypoints>'
    + "".join(
        f'<waypoint id="{i}" radius="0.3"><position lat="{lat}" lon="{lon}"/><leg {LEG}/></waypoint>'
        for i, lat, lon in ((1, 57.0, 9.0), (2, 57.1, 9.4), (3, 57.4, 9.5), (4, 57.5, 9.9))
    )
    + '</waypoints><schedules><schedule id="1"><manual>'
    + f'<scheduleElement waypointId="1" etd="{T[0]}" etdWindowBefore="PT10M" etdWindowAfter="PT10M" windSpeed="5" '
    'windDirection="1" currentSpeed="1" currentDirection="1" windLoss="1" waveLoss="1"/>'
    '<scheduleElement waypointId="2" speed="12" speedWindow="1" stay="PT1H"/>'
    f'<scheduleElement waypointId="3" speed="11"/>'
    f'<scheduleElement waypointId="4" eta="{T[4]}" etaWindowBefore="PT10M" etaWindowAfter="PT10M"/></manual>'
    '</schedule></schedules><actionPoints><actionPoint radius="0.1" timeToAct="1" minutesToAct="5"/></actionPoints>'
    '<extensions><extension manufacturer="x" name="y" version="1" maxSpeed="3"/></extensions></route>'
)


def s421() -> str:
    def ref(name: str, to: str) -> str:
        return f'<{name} xlink:href="#{to}"/>'

    def point(number: int, lat: float, lon: float) -> str:
        leg = ref("routeWaypointLeg", "L") if number > 1 else ""
        return (
            f'<member><S421:routeWaypoint gml:id="W{number}"><Point><gml:pos>{lat} {lon}</gml:pos></Point>'
            f"<routeWaypointID>{number}</routeWaypointID><routeWaypointTurnRadius>0.3</routeWaypointTurnRadius>{leg}"
            "</S421:routeWaypoint></member>"
        )

    def element(number: int, **values: str) -> str:
        inside = "".join(
            f"<routeScheduleElement{name}>{text}</routeScheduleElement{name}>" for name, text in values.items()
        )
        return (
            f'<member><S421:routeScheduleElement gml:id="E{number}"><routeWaypointId>{number}</routeWaypointId>'
            f"{inside}</S421:routeScheduleElement></member>"
        )

    names = "SpeedMin SpeedMax DraughtForward DraughtAft StaticUKC DynamicUKC Masthead SafetyContour SafetyDepth"
    unread = "".join(f"<routeWaypointLeg{one}>3</routeWaypointLeg{one}>" for one in names.split())
    windows = {"ETDWindowBefore": "5", "ETDWindowAfter": "5"}
    return (
        '<S421:DataSet xmlns:S421="http://www.iho.int/S421/gml/1.0" xmlns:gml="http://www.opengis.net/gml/3.2" '
        'xmlns:xlink="http://www.w3.org/1999/xlink" gml:id="D"><gml:boundedBy><gml:lower>1</gml:lower></gml:boundedBy>'
        "<DataSetIdentificationInformation><date>2026-06-01</date></DataSetIdentificationInformation>"
        '<member><S421:routeInfo gml:id="I"><routeInfoName>R</routeInfoName>'
        f"<routeInfoValidityPeriodStart>{T[0]}</routeInfoValidityPeriodStart>"
        f"<routeInfoValidityPeriodStop>{T[4]}</routeInfoValidityPeriodStop>"
        "<routeInfoVesselSpeedMin>1</routeInfoVesselSpeedMin><routeInfoVesselSpeedMax>9</routeInfoVesselSpeedMax>"
        '</S421:routeInfo></member><member><S421:routeWaypoints gml:id="WS">'
        + "".join(ref("routeWaypoint", f"W{i}") for i in (1, 2, 3))
        + "</S421:routeWaypoints></member>"
        + point(1, 57.0, 9.0)
        + point(2, 57.1, 9.4)
        + point(3, 57.4, 9.5)
        + '<member><S421:routeWaypointLeg gml:id="L"><routeWaypointLegPortXTDL>100</routeWaypointLegPortXTDL>'
        "<routeWaypointLegStarboardXTDL>100</routeWaypointLegStarboardXTDL>"
        f"{unread}</S421:routeWaypointLeg></member>"
        '<member><S421:routeActionPoint gml:id="P"><routeWaypointActionPointRadius>1</routeWaypointActionPointRadius>'
        "</S421:routeActionPoint></member>"
        '<member><S421:routeSchedule gml:id="S">' + ref("routeScheduleManual", "M") + "</S421:routeSchedule></member>"
        '<member><S421:routeScheduleManual gml:id="M">'
        + "".join(ref("routeScheduleElement", f"E{i}") for i in (1, 2, 3))
        + "</S421:routeScheduleManual></member>"
        + element(1, ETD=T[0], **windows)
        + element(2, PlanSOG="12", Stay="PT1H", SpeedWindow="1", PlanSTW="11")
        + element(3, ETA=T[4], ETAWindowBefore="5", ETAWindowAfter="5")
        + "</S421:DataSet>"
    )


SURFACE = (
    "<Surface><patches><PolygonPatch><exterior><LinearRing><posList>57 4 57 5 58 5 57 4</posList></LinearRing>"
    "</exterior></PolygonPatch></patches></Surface>"
)
S124 = (
    '<Dataset xmlns="http://www.iho.int/S124/gml/2.0"><boundedBy><lower>1</lower></boundedBy>'
    "<DatasetIdentificationInformation><date>2026-06-01</date></DatasetIdentificationInformation><members>"
    "<NavwarnPreamble><publicationTime>2026-06-01T00:00:00Z</publicationTime><sourceDate>2026-06-01</sourceDate>"
    "<reportedDate>2026-06-01</reportedDate><cancellationDate>2026-06-09</cancellationDate></NavwarnPreamble>"
    '<NavwarnPart id="W"><fixedDateRange><dateStart><date>2026-06-01</date></dateStart><dateEnd>'
    "<date>2026-06-02</date></dateEnd><timeOfDayStart>100000Z</timeOfDayStart><timeOfDayEnd>120000Z</timeOfDayEnd>"
    "</fixedDateRange><verticalClearanceValue>3</verticalClearanceValue><depthMinimum>3</depthMinimum>"
    "<depthMaximum>9</depthMaximum><horizontalWidth>3</horizontalWidth>"
    f"<geometry><surfaceProperty>{SURFACE}</surfaceProperty></geometry></NavwarnPart></members></Dataset>"
)
AIXM = (
    '<m:AIXMBasicMessage xmlns:m="http://www.aixm.aero/schema/5.1.1/message"><m:hasMember><Airspace id="A"><timeSlice>'
    f"<AirspaceTimeSlice><validTime><TimePeriod><beginPosition>{T[0]}</beginPosition><endPosition>2026-07-01T00:00:00Z"
    "</endPosition></TimePeriod></validTime><interpretation>BASELINE</interpretation><featureLifetime><TimePeriod>"
    f"<beginPosition>{T[0]}</beginPosition></TimePeriod></featureLifetime><designator>A</designator>"
    "<annotation><Note><hours>x</hours></Note></annotation><geometryComponent>"
    '<AirspaceGeometryComponent><theAirspaceVolume><AirspaceVolume><upperLimit uom="M">900</upperLimit>'
    '<upperLimitReference>MSL</upperLimitReference><maximumLimit uom="M">1</maximumLimit>'
    "<maximumLimitReference>MSL</maximumLimitReference>"
    '<lowerLimit uom="M">10</lowerLimit><lowerLimitReference>MSL</lowerLimitReference><minimumLimit uom="M">1'
    "</minimumLimit><minimumLimitReference>MSL</minimumLimitReference><width>5</width>"
    '<horizontalProjection><Surface srsName="urn:ogc:def:crs:EPSG::4326"><patches><PolygonPatch><exterior><Ring>'
    "<curveMember><Curve><segments><LineStringSegment><pos>55 10</pos>"
    "<pos>55.4 10</pos></LineStringSegment><ArcByCenterPoint><pos>55 10</pos>"
    '<radius uom="NM">24.06</radius><startAngle uom="deg">0</startAngle><endAngle uom="deg">90</endAngle>'
    "</ArcByCenterPoint><LineStringSegment><pos>54.998 10.697</pos><pos>55 10</pos></LineStringSegment></segments>"
    "</Curve></curveMember></Ring></exterior></PolygonPatch></patches></Surface></horizontalProjection>"
    "</AirspaceVolume></theAirspaceVolume></AirspaceGeometryComponent></geometryComponent><activation>"
    "<AirspaceActivation><timeInterval><Timesheet><timeReference>UTC</timeReference><startDate>01-06</startDate>"
    "<endDate>30-06</endDate><day>MON</day><dayTil>MON</dayTil>"
    "<startTime>08:00</startTime><endEvent>SS</endEvent>"
    '<endTimeRelativeEvent uom="MIN">30</endTimeRelativeEvent>'
    "<daylightSavingAdjust>NO</daylightSavingAdjust><excluded>NO</excluded></Timesheet></timeInterval>"
    "<status>ACTIVE</status><levels><AirspaceLayer><upperLimit>5</upperLimit></AirspaceLayer></levels>"
    "</AirspaceActivation></activation></AirspaceTimeSlice></timeSlice></Airspace></m:hasMember></m:AIXMBasicMessage>"
)
NOTAM = (
    "(A1485/26 NOTAMN Q) EDWW/QWMLW/IV/BO/W/000/100/5405N01030E010 A) EDWW B) 2606010600 C) 2606301800 "
    "D) 0800-1000 E) WI 5NM RADIUS OF 540000N 0102000E F) 500M AMSL G) 3000M AMSL)"
)
OPENAIR = """AC R
AY TRA
AN EDR 1
AI 1
AF 123.3
AR 123.3
AG Radar
AX 7000
TP 7000
AA 2026-06-01T10:00Z/2026-06-01T12:00Z
AL 500ft AMSL
AH 9500ft AMSL
AT 57:00:00 N 010:00:00 E
SP 0,1,0,0,0
SB 0,0,0
TB 1
AU 1
AM 1
*AActiv [HX]
*ATimes x
*AExSAT x
*AExSUN x
*AExHOL x
*ASeeNOTAM x
V X=57:00:00 N 010:00:00 E
V D=-
DA 5, 185, 155
DP 56:50:00 N 010:05:00 E
DB 57:06:00 N 010:00:00 E, 57:00:00 N 010:11:00 E
DC 2.5
"""
CSV = (
    "mmsi,basedatetime,lon,lat,length,width,to_bow,to_stern,to_port,to_starboard,floor_m,ceiling_m,sog,speed,draught,"
    "draft,altitude,eta\n"
    f"219000001,{T[0]},9,57,90,14,40,50,7,7,0,30,12,12,7,7,1,06-01\n"
    f"219000001,{T[1]},9.2,57.1,90,14,40,50,7,7,0,30,13,13,8,8,2,06-02\n"
)
PLACEMARK = "<Placemark><name>{}</name>{}</Placemark>"
BOX = (
    "<Polygon><altitudeMode>absolute</altitudeMode><altitudeOffset>3</altitudeOffset><outerBoundaryIs><LinearRing>"
    "<coordinates>9,57 9.2,57 9.2,57.2 9,57.2 9,57</coordinates></LinearRing></outerBoundaryIs></Polygon>"
)
KML = (
    '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>'
    "<Region><LatLonAltBox><minAltitude>1</minAltitude></LatLonAltBox></Region>"
    "<Style><LineStyle><width>2</width></LineStyle></Style><LookAt><altitude>1</altitude></LookAt>"
    + PLACEMARK.format(
        "A",
        f"<description>start 10:00</description><TimeSpan><begin>{T[0]}</begin><end>{T[1]}</end></TimeSpan>"
        '<ExtendedData><Data name="floor_m"><value>5</value></Data></ExtendedData>' + BOX,
    )
    + PLACEMARK.format(
        "T",
        f"<gx:Track><when>{T[0]}</when><when>{T[1]}</when><gx:coord>9 57 0</gx:coord><gx:coord>9.2 57.1 0</gx:coord>"
        "</gx:Track>",
    )
    + "</Document></kml>"
)
WHOLE = {
    "a.geojson": scene(),
    "m.mfjson": MFJSON,
    "a.gpx": GPX,
    "a.rtz": RTZ,
    "a.s421": s421(),
    "w.gml": S124,
    "a.xml": AIXM,
    "z269.json": ed269(),
    "z318.geojson": ed318(),
    "i.json": f3548(),
    "a.notam": NOTAM,
    "a.openair": OPENAIR,
    "a.csv": CSV,
    "a.kml": KML,
}
