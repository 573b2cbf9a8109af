"""The engine for Flight Blender admits flights that meet nobody; the server's types are stand-ins."""

import asyncio
import importlib
import json
import sys
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from enum import IntEnum
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from conflictdb import Area, InvalidInput, connect, store

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "flight_blender"
BEGIN = datetime(2030, 6, 1, 6, tzinfo=UTC)


@dataclass
class Result:
    all_relevant_fences: list[str]
    all_relevant_declarations: list[str]
    is_approved: bool
    declaration_state: int


class State(IntEnum):
    NotSubmitted = 0
    Accepted = 1
    Rejected = 8


@pytest.fixture
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    names = "domain_types.common", "domain_types.flight_declarations", "models.flight_declarations_orm"
    types = [
        {"OperationStateCode": State},
        {"DeconflictionRequest": SimpleNamespace, "DeconflictionResult": Result},
        {"FlightDeclarationORM": SimpleNamespace},
    ]
    for name, content in zip(("", "domain_types", "models", *names), [{}, {}, {}, *types], strict=True):
        module = ModuleType(f"flight_blender.{name}".rstrip("."))
        vars(module).update(content, __path__=[])
        monkeypatch.setitem(sys.modules, module.__name__, module)


@pytest.fixture
def engine(dsn: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("CONFLICTDB_DSN", dsn)
    monkeypatch.syspath_prepend(str(EXAMPLE))
    monkeypatch.delitem(sys.modules, "conflictdb_engine", raising=False)
    engine = importlib.import_module("conflictdb_engine")
    with connect(dsn) as db:
        store.set_scene(db.connection, engine.SCENE)
    yield engine
    sys.modules.pop("conflictdb_engine", None)


def volume(
    lng: float, minutes: int, low_m: float = 50.0, radius_m: float = 0.0, reference: str = "W84"
) -> dict[str, Any]:
    ring = [(lng, 47.0), (lng + 0.001, 47.0), (lng + 0.001, 47.001), (lng, 47.001)]
    space: dict[str, Any] = {"outline_polygon": {"vertices": [{"lng": x, "lat": y} for x, y in ring]}}
    if radius_m:
        space = {"outline_circle": {"center": {"lng": lng, "lat": 47.0}, "radius": {"value": radius_m, "units": "M"}}}
    for name, height in (("altitude_lower", low_m), ("altitude_upper", low_m + 20.0)):
        space[name] = {"value": height, "reference": reference, "units": "M"}
    times = {
        name: {"value": (BEGIN + timedelta(minutes=m)).isoformat(), "format": "RFC3339"}
        for name, m in (("time_start", minutes), ("time_end", minutes + 10))
    }
    return {"volume": space, **times}


def asked(engine: Any, number: int, volumes: Any, network: int = 0) -> Any:
    key = uuid.UUID(int=number)

    async def get(_: object, wanted: uuid.UUID) -> Any:
        return SimpleNamespace(id=key, operational_intent=json.dumps(volumes)) if wanted == key else None

    request = SimpleNamespace(declaration_id=str(key), ussp_network_enabled=network)
    checked = engine.ConflictdbEngine().check_deconfliction(request, SimpleNamespace(get=get))
    with ThreadPoolExecutor(1) as thread:  # browser tests leave a running event loop in this one
        return thread.submit(asyncio.run, checked).result()


@pytest.mark.usefixtures("stand_ins")
def test_flights_are_admitted_one_after_the_other(engine: Any) -> None:
    first = [volume(8.0, 0), volume(8.0005, 5)]  # volumes of one flight overlap
    assert asked(engine, 1, first) == Result([], [], True, 1)
    assert asked(engine, 2, [volume(8.1, 0), volume(8.001, 0)]) == Result([], [str(uuid.UUID(int=1))], False, 8)
    assert asked(engine, 2, [volume(8.1, 0)], network=1) == Result([], [], True, 0)
    # Closed intervals: the instant and the height that two volumes share count.
    assert not asked(engine, 3, [volume(8.1, 10)]).is_approved
    assert not asked(engine, 3, [volume(8.1, 0, 70.0)]).is_approved
    assert asked(engine, 3, [volume(8.1, 11), volume(8.1, 0, 70.1)]).is_approved
    assert asked(engine, 1, [volume(8.2, 0)]).is_approved  # the flight moves
    assert not asked(engine, 4, [volume(8.2, 0, radius_m=30.0)]).is_approved


@pytest.mark.usefixtures("stand_ins")
def test_what_cannot_be_read_is_refused_and_stops_nobody(engine: Any) -> None:
    for volumes in (None, [], [{}], [volume(8.0, 0, reference="AGL")], [volume(8.0, 0, radius_m=-1.0)], "{"):
        assert asked(engine, 5, volumes) == Result([], [], False, 8)
    assert asked(engine, 6, [volume(8.0, 0)]).is_approved


@pytest.mark.usefixtures("stand_ins")
def test_a_fence_above_sea_level_is_not_mixed_with_flights(engine: Any, dsn: str) -> None:
    ring = [(8.0, 47.0), (8.1, 47.0), (8.1, 47.1)]
    with connect(dsn) as db, pytest.raises(InvalidInput, match="vertical_datum"):
        db.scene("flights").put(Area("fence", ring, floor_m=0.0, properties={"vertical_datum": "msl"}))


@pytest.mark.usefixtures("stand_ins")
def test_units_are_feet_or_metres(engine: Any) -> None:
    def with_units(units: str, radius_m: float = 0.0) -> dict[str, Any]:
        one = volume(8.0, 0, 100.0, radius_m)
        for name in ("altitude_lower", "altitude_upper", *(["outline_circle"] if radius_m else [])):
            of = one["volume"][name]
            (of["radius"] if name == "outline_circle" else of)["units"] = units
        return one

    assert asked(engine, 1, [with_units("FT", 300.0)]).is_approved  # 30.48 to 36.576 m, within 91 m
    assert not asked(engine, 2, [volume(8.0, 0, 36.0)]).is_approved
    assert asked(engine, 2, [volume(8.0, 0, 100.0), volume(8.0013, 0, 30.0)]).is_approved
    for wrong in (with_units("YD"), with_units("YD", 30.0)):
        assert asked(engine, 3, [wrong]) == Result([], [], False, 8)


@pytest.mark.usefixtures("stand_ins")
def test_a_scene_above_sea_level_takes_no_flights(engine: Any, dsn: str) -> None:
    with connect(dsn) as db:
        store.set_scene(db.connection, replace(engine.SCENE, vertical_datum="msl"))
    assert asked(engine, 1, [volume(8.0, 0)]) == Result([], [], False, 8)


def test_the_types_of_the_server(engine_of_server: Any) -> None:
    from flight_blender.domain_types.plugin_protocols import DeconflictionEngineProtocol  # type: ignore[import-not-found]

    assert isinstance(engine_of_server.ConflictdbEngine(), DeconflictionEngineProtocol)
    assert asked(engine_of_server, 1, [volume(8.0, 0)]).is_approved
    assert not asked(engine_of_server, 2, [volume(8.0, 0)]).is_approved


@pytest.fixture
def engine_of_server(request: pytest.FixtureRequest) -> Any:
    pytest.importorskip("flight_blender", reason="flight_blender is not installed (it needs Python 3.14)")
    return request.getfixturevalue("engine")
