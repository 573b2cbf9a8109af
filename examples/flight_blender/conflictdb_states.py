"""States of ASTM F3548 for flights of Flight Blender under way, by the positions that the server receives.

python conflictdb_states.py, with CONFLICTDB_DSN and the settings of the server; beside it, `conflictdb worker`
"""

import asyncio
import json
import logging
import math
import os
import time
from collections import defaultdict
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from typing import Any

from conflictdb_engine import SCENE, area
from flight_blender.clients.dss_scd_client import SCDOperations
from flight_blender.domain_types.common import OperationStateCode
from flight_blender.repositories.flight_declarations_repo import SQLAlchemyFlightDeclarationRepository
from flight_blender.repositories.flight_feed_repo import SQLAlchemyFlightFeedRepository
from flight_blender.services.conformance_svc import FlightOperationConformanceHelper, cast_to_volume4d

from conflictdb import Area, Database, Scene, Track, circle, connect

log = logging.getLogger(__name__)

# A scene of its own: volumes are areas in the scene of admissions, and only tracks have positions.
FLOWN = Scene("flown", motion="great_circle", vertical_datum="wgs84")
CONTINGENT_AFTER_S = 60.0
# A flight outside its volumes keeps others out of this circle, metres, for so long.
REACH_M, LASTS = 500.0, timedelta(minutes=5)
SENT_EVERY = timedelta(minutes=1)

ACTIVATED, NONCONFORMING = OperationStateCode.Activated, OperationStateCode.Nonconforming
CONTINGENT = OperationStateCode.Contingent
# Of a state and how a flight keeps its volumes: the next state, and the event of the server's conformance service.
NEXT = {
    (ACTIVATED, "outside"): (NONCONFORMING, "ua_exits_coordinated_op_intent"),
    (ACTIVATED, "early or late"): (NONCONFORMING, "ua_departs_early_late"),
    (ACTIVATED, "silent"): (CONTINGENT, "flight_blender_confirms_contingent"),
    (NONCONFORMING, "inside"): (ACTIVATED, "operator_return_to_coordinated_op_intent"),
    (NONCONFORMING, "outside for long"): (CONTINGENT, "timeout"),
    (NONCONFORMING, "silent"): (CONTINGENT, "timeout"),
}


def standing(volume: Area) -> Track:
    """Return a track that stands in the middle of a volume from its begin to its end; its haven is the volume."""
    ring = volume.footprint.convex_hull.exterior.coords[:-1]
    lon, lat = (sum(place) / len(ring) for place in zip(*ring, strict=True))
    # Metres of a degree on WGS84; a volume is some kilometres wide.
    w = math.sqrt(1 - 0.00669438 * math.sin(math.radians(lat)) ** 2)
    east = math.radians(6378137.0) * math.cos(math.radians(lat)) / w
    north = math.radians(6378137.0 * (1 - 0.00669438)) / w**3
    outline = [((x - lon) * east, (y - lat) * north) for x, y in ring]
    times = [volume.start_us, volume.end_us]
    return Track(
        volume.key, [(lon, lat)] * 2, times, outline, None, volume.floor_m, volume.ceiling_m, owner=volume.owner
    )


def kept(states: Iterable[str]) -> str | None:
    """Return how a flight keeps its volumes, of which each has a state of the view live; None: not known yet."""
    found = set(states)
    if "on plan" in found:
        return "inside"
    if "silent" in found:
        return "silent"
    return "outside" if "off" in found else "early or late" if found else None


def around(last: Any) -> dict[str, Any]:
    """Return the volume of F3548 in which a flight that left its volumes may be, after its last position."""
    centre = {"lng": last.longitude_dd, "lat": last.latitude_dd}
    space: dict[str, Any] = {"outline_circle": {"center": centre, "radius": {"value": REACH_M, "units": "M"}}}
    for name, by_m in (("altitude_lower", -REACH_M), ("altitude_upper", REACH_M)):
        space[name] = {"value": last.altitude_mm + by_m, "reference": "W84", "units": "M"}
    times = {"time_start": last.created_at, "time_end": last.created_at + LASTS}
    return {"volume": space, **{name: {"value": at.isoformat(), "format": "RFC3339"} for name, at in times.items()}}


def intent_of(intent: dict[str, Any], state: OperationStateCode, last: Any) -> dict[str, Any]:
    """Return an operational intent in a state; unless it is activated, with where the flight may be."""
    volumes = [] if state == ACTIVATED or last is None else [around(last)]
    return {**intent, "state": state.name, "off_nominal_volumes": volumes}


def as_volume(volume: dict[str, Any]) -> Any:
    """Return a volume as the server's type, whose reader drops the last vertex of a polygon."""
    space = volume["volume"]
    if outline := space.get("outline_polygon"):
        ring = outline["vertices"]
        closed = ring if ring[0] == ring[-1] else [*ring, ring[0]]
        volume = {**volume, "volume": {**space, "outline_polygon": {**outline, "vertices": closed}}}
    return cast_to_volume4d(volume)


async def update_dss(
    session: Any, flight_id: Any, before: OperationStateCode, state: OperationStateCode, intent: dict[str, Any]
) -> None:
    """Send the state and volumes of a flight to the DSS, if it is known there, and keep what peers ask for."""
    flights = SQLAlchemyFlightDeclarationRepository(session)
    reference = await flights.get_opint_reference_by_declaration_id(flight_id)
    if reference is None:
        return
    details = await flights.get_opint_detail_by_declaration_id(flight_id)
    details.off_nominal_volumes = json.dumps(intent["off_nominal_volumes"])
    volumes = [*intent["volumes"], *intent["off_nominal_volumes"]]
    try:
        answer = await SCDOperations().update_specified_operational_intent_reference(
            operational_intent_ref_id=str(reference.id),
            extents=[as_volume(one) for one in volumes],
            current_state=before.name,
            new_state=state.name,
            subscription_id=str(reference.subscription_id),
            ovn=reference.ovn,
        )
    except Exception:  # the state holds, whether or not the DSS answers
        log.exception("flight %s: the DSS did not get its state %s", flight_id, state.name)
        return
    if answer.status != 200:
        log.error("flight %s: the DSS refused that it is %s: %s", flight_id, state.name, answer.message)
        return
    reference.ovn, reference.state = answer.dss_response.operational_intent_reference.ovn, state.name
    await session.flush()


class States:
    """What was done for flights until now."""

    def __init__(self, db: Database) -> None:
        self.db = db
        self.volumes, self.heard, self.outside_s = dict[str, list[str]](), dict[str, datetime](), dict[str, float]()
        self.sent = defaultdict[str, datetime](lambda: datetime.min.replace(tzinfo=UTC))

    async def step(self, session: Any) -> None:
        """Pass on new positions, and change the states of flights by what a worker found."""
        flights, feed = SQLAlchemyFlightDeclarationRepository(session), SQLAlchemyFlightFeedRepository(session)
        now = datetime.now(UTC)
        for flight in await flights.get_active_declarations_overlapping_time_window(now - LASTS, now):
            if (state := OperationStateCode(flight.state)) not in (ACTIVATED, NONCONFORMING, CONTINGENT):
                continue
            key = str(flight.id)
            last = await feed.get_latest_flight_observation_by_session(flight.id)
            how = await asyncio.to_thread(self.report, key, json.loads(flight.operational_intent)["volumes"], last)
            before, event = state, ""
            if (state, how) in NEXT:
                state, event = NEXT[state, how]
                await flights.add_state_history_entry(flight.id, int(before), int(state), f"{how} (conflictdb)")
                await flights.update(flight.id, state=int(state))
            # A flight that left its volumes moves, and so does where it may be.
            if event or (state != ACTIVATED and last is not None and last.created_at >= self.sent[key] + SENT_EVERY):
                self.sent[key] = datetime.min.replace(tzinfo=UTC) if last is None else last.created_at
                intent = intent_of(json.loads(flight.operational_intent), state, last)
                await flights.update(flight.id, operational_intent=json.dumps(intent))
                await update_dss(session, flight.id, before, state, intent)
            if event:
                helper = FlightOperationConformanceHelper(flight.id, session)
                await helper.manage_operation_state_transition(int(before), int(state), event)
            await asyncio.to_thread(self.keep_out, key, None if state == ACTIVATED else last)

    def report(self, key: str, volumes: list[dict[str, Any]], last: Any) -> str | None:
        """Insert the last position of a flight, for each of its volumes; return how it keeps them."""
        scene = self.db.scene(FLOWN.name)
        if key not in self.volumes:
            tracks = [standing(area(f"{key}#{i}", one, key)) for i, one in enumerate(volumes)]
            scene.put(tracks, FLOWN)
            self.volumes[key] = [one.key for one in tracks]
        if last is not None and last.created_at != self.heard.get(key):
            with self.db.connection.transaction():
                self.db.connection.execute(
                    "INSERT INTO conflictdb.position (scene, key, instant, place, height_m, error_m) "
                    "SELECT %s, k, %s, ST_SetSRID(ST_MakePoint(%s, %s), 4326), %s, 0 FROM unnest(%s::text[]) k",
                    # Height in metres, and no error, as in the server's own check of conformance.
                    [FLOWN.name, last.created_at, last.longitude_dd, last.latitude_dd, last.altitude_mm,
                     self.volumes[key]],
                )  # fmt: skip
            self.heard[key] = last.created_at
        how = kept(one.state for one in scene.live() if one.key in self.volumes[key])
        if how != "outside":
            self.outside_s.pop(key, None)
        elif time.monotonic() - self.outside_s.setdefault(key, time.monotonic()) >= CONTINGENT_AFTER_S:
            return "outside for long"
        return how

    def keep_out(self, key: str, last: Any) -> None:
        """Keep others from where a flight that left its volumes may be: they are not admitted there."""
        scene, name = self.db.scene(SCENE.name), f"{key}#now"
        if last is None:
            with self.db.connection.transaction():
                self.db.connection.execute("SELECT conflictdb.remove_object(%s, %s)", [SCENE.name, name])
            return
        ring, now = circle((last.longitude_dd, last.latitude_dd), REACH_M, SCENE), datetime.now(UTC)
        scene.put(Area(name, ring, None, now, now + LASTS, properties={"vertical_datum": "wgs84"}, owner=key))


async def main() -> None:
    """Look every two seconds."""
    from flight_blender.db.session import async_task_session

    with connect(os.environ["CONFLICTDB_DSN"]) as db:
        states = States(db)
        while True:
            async with async_task_session() as session:
                await states.step(session)
            await asyncio.sleep(2.0)


if __name__ == "__main__":
    asyncio.run(main())
