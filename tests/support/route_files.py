"""Route plans as files: RTZ and S-421, after the public schemas."""


def waypoint(number: int, lon: float, lat: float, leg: str = "", **more: object) -> str:
    given = " ".join(f'{name}="{one}"' for name, one in more.items())
    return f'<waypoint id="{number}" {given}><position lat="{lat}" lon="{lon}"/><leg {leg}/></waypoint>'


THREE = waypoint(1, 4, 57) + waypoint(2, 5, 57) + waypoint(3, 5, 58)


def rtz(waypoints: str = THREE, schedules: str = "", version: str = "1.2", name: str = 'routeName="R"') -> str:
    space = f"http://www.cirm.org/RTZ/{version.replace('.', '/')}"
    every = f"<schedules>{schedules}</schedules>" if schedules else ""
    info = f'<routeInfo {name} vesselMMSI="265425000"/>'
    return f'<route xmlns="{space}" version="{version}">{info}<waypoints>{waypoints}</waypoints>{every}</route>'


def s421(*, namespace: str = "S421/gml/1.0", kind: str = "2", limit: str = "500", times: str = "") -> str:
    def point(number: int, lat: float, lon: float, leg: str = "") -> str:
        return (
            f'<member><S421:routeWaypoint gml:id="W{number}"><geometry><S100:pointProperty>'
            f'<S100:Point gml:id="P{number}">'
            f"<gml:pos>{lat} {lon}</gml:pos></S100:Point></S100:pointProperty></geometry>"
            f"<routeWaypointID>{number}</routeWaypointID>{leg}</S421:routeWaypoint></member>"
        )

    return (
        f'<S421:DataSet xmlns:S421="http://www.iho.int/{namespace}" xmlns:gml="http://www.opengis.net/gml/3.2" '
        'xmlns:S100="http://www.iho.int/s100gml/1.0" xmlns:xlink="http://www.w3.org/1999/xlink" gml:id="D">'
        '<imember><S421:routeInfo gml:id="I"><routeInfoName>R</routeInfoName></S421:routeInfo></imember>'
        '<member><S421:routeWaypoints gml:id="WS"><routeWaypoint xlink:href="#W1"/><routeWaypoint xlink:href="#W2"/>'
        "</S421:routeWaypoints></member>"
        + point(1, 57.0, 4.0)
        + point(2, 57.0, 9.0, '<routeWaypointLeg xlink:href="#L"/>')
        + f'<member><S421:routeWaypointLeg gml:id="L"><routeWaypointLegPortXTDL>{limit}</routeWaypointLegPortXTDL>'
        "<routeWaypointLegStarboardXTDL>0</routeWaypointLegStarboardXTDL>"
        f"<routeWaypointLegGeometryType>{kind}</routeWaypointLegGeometryType></S421:routeWaypointLeg></member>"
        '<imember><S421:routeSchedule gml:id="S"><routeScheduleManual xlink:href="#M"/></S421:routeSchedule></imember>'
        '<imember><S421:routeScheduleManual gml:id="M"><routeScheduleElement xlink:href="#E1"/>'
        '<routeScheduleElement xlink:href="#E2"/></S421:routeScheduleManual></imember>'
        '<imember><S421:routeScheduleElement gml:id="E1"><routeWaypointId>1</routeWaypointId>'
        "<routeScheduleElementETD>2026-03-01T06:00:00Z</routeScheduleElementETD></S421:routeScheduleElement></imember>"
        '<imember><S421:routeScheduleElement gml:id="E2"><routeWaypointId>2</routeWaypointId>'
        f"<routeScheduleElementPlanSOG>12</routeScheduleElementPlanSOG>{times}</S421:routeScheduleElement></imember>"
        "</S421:DataSet>"
    )
