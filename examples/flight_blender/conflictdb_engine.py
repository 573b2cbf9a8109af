"""A deconfliction engine for Flight Blender that admits flights to a scene of conflictdb.

FLIGHT_BLENDER_PLUGIN_DECONFLICTION_ENGINE=conflictdb_engine.ConflictdbEngine, and CONFLICTDB_DSN
"""

import asyncio
import json
import os
import uuid
from datetime import datetime
from typing import Any

from flight_blender.domain_types.common import OperationStateCode
from flight_blender.domain_types.flight_declarations import DeconflictionRequest, DeconflictionResult
from flight_blender.models.flight_declarations_orm import FlightDeclarationORM

from conflictdb import Area, InvalidInput, Scene, circle, connect

SCENE = Scene("flights", motion="great_circle", tolerance_m=0.005, intervals="closed", vertical_datum="wgs84")


METRES_OF = {"M": 1.0, "FT": 0.3048}


def metres(value: dict[str, Any]) -> float:
    """Return an altitude or a radius; KeyError for another unit."""
    return float(value["value"]) * METRES_OF[str(value.get("units", "M"))]


def height_m(value: dict[str, Any] | None) -> float | None:
    """Return a height above the ellipsoid."""
    if value and str(value["reference"]) != "W84":  # the datum of the scene
        raise InvalidInput("volume", "altitude", f"must have the reference W84; got {value['reference']}")
    return metres(value) if value else None


def area(key: str, volume: dict[str, Any], owner: str) -> Area:
    """Return a volume of F3548 as an area."""
    space = volume["volume"]
    if outline := space.get("outline_polygon"):
        shape = [(one["lng"], one["lat"]) for one in outline["vertices"]]
    else:
        centre, radius = space["outline_circle"]["center"], space["outline_circle"]["radius"]
        shape = circle((centre["lng"], centre["lat"]), metres(radius), SCENE)
    span = (datetime.fromisoformat(volume[name]["value"]) for name in ("time_start", "time_end"))
    heights = (height_m(space.get(name)) for name in ("altitude_lower", "altitude_upper"))
    # A scene with another datum refuses what says its own.
    return Area(key, shape, None, *span, *heights, {"vertical_datum": SCENE.vertical_datum.value}, owner=owner)


def admitted(owner: str, volumes: list[dict[str, Any]]) -> tuple[bool, set[str]]:
    """Return whether volumes were admitted, and the owners of what they meet."""
    with connect(os.environ["CONFLICTDB_DSN"]) as db:
        found = db.scene(SCENE.name).admit([area(f"{owner}#{i}", one, owner) for i, one in enumerate(volumes)], owner)
    return bool(found), {key.rpartition("#")[0] for one in found.conflicts for key in (one.a_key, one.b_key)} - {owner}


class ConflictdbEngine:
    """Flight Blender makes one for each request."""

    async def check_deconfliction(self, request: DeconflictionRequest, db: Any) -> DeconflictionResult:
        """Return whether a declaration is accepted; if so, its volumes are in the scene."""
        state, others = OperationStateCode.Rejected, set[str]()
        row = await db.get(FlightDeclarationORM, uuid.UUID(str(request.declaration_id)))
        try:
            is_admitted, others = await asyncio.to_thread(admitted, str(row.id), json.loads(row.operational_intent))
        except (AttributeError, KeyError, TypeError, ValueError):  # InvalidInput is a ValueError: refused, not passed
            is_admitted = False
        if is_admitted:
            state = OperationStateCode.NotSubmitted if request.ussp_network_enabled else OperationStateCode.Accepted
        return DeconflictionResult([], sorted(others), is_admitted, int(state))
