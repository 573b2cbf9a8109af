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
from conflictdb.jobs.looks import Looks

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
    Activated = 2
    Nonconforming = 3
    Contingent = 4
    Rejected = 8


class Server:
    """The tables of the server, its repositories over them, and its reactions."""

    def __init__(self) -> None:
        self.flight = SimpleNamespace(id=uuid.UUID(int=1), state=2, operational_intent="")
        self.last: Any = None
        self.history: list[tuple[int, int]] = []
        self.reactions: list[tuple[int, int, str]] = []
        self.intents: list[dict[str, Any]] = []
        self.reference: Any = None
        self.details = SimpleNamespace(off_nominal_volumes="")
        self.dss: list[dict[str, Any]] = []
        self.is_dss_down = False

    def repository(self, _: object) -> Any:
        async def overlapping(start: datetime, end: datetime) -> list[Any]:
            return [self.flight]

        async def note(_: uuid.UUID, original_state: int, new_state: int, notes: str) -> None:
            self.history.append((original_state, new_state))

        async def update(_: uuid.UUID, **fields: Any) -> None:
            vars(self.flight).update(fields)

        async def reference(_: uuid.UUID) -> Any:
            return self.reference

        async def details(_: uuid.UUID) -> Any:
            return self.details

        async def latest(session_id: uuid.UUID) -> Any:
            return self.last

        return SimpleNamespace(
            get_active_declarations_overlapping_time_window=overlapping,
            add_state_history_entry=note,
            update=update,
            get_opint_reference_by_declaration_id=reference,
            get_opint_detail_by_declaration_id=details,
            get_latest_flight_observation_by_session=latest,
        )

    def dss_client(self) -> Any:
        async def put(**message: Any) -> Any:
            self.dss.append(message)
            if self.is_dss_down:
                raise ConnectionError("no DSS")
            new = SimpleNamespace(operational_intent_reference=SimpleNamespace(ovn=f"ovn {len(self.dss)}"))
            return SimpleNamespace(status=200, message="", dss_response=new)

        return SimpleNamespace(update_specified_operational_intent_reference=put)

    def helper(self, _: uuid.UUID, session: object) -> Any:
        async def react(original_state: int, new_state: int, event: str) -> None:
            self.reactions.append((original_state, new_state, event))
            self.intents.append(json.loads(self.flight.operational_intent))

        return SimpleNamespace(manage_operation_state_transition=react)


@pytest.fixture
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> Server:
    server = Server()
    types: dict[str, dict[str, Any]] = {
        "domain_types.common": {"OperationStateCode": State},
        "domain_types.flight_declarations": {"DeconflictionRequest": SimpleNamespace, "DeconflictionResult": Result},
        "models.flight_declarations_orm": {"FlightDeclarationORM": SimpleNamespace},
        "repositories.flight_declarations_repo": {"SQLAlchemyFlightDeclarationRepository": server.repository},
        "repositories.flight_feed_repo": {"SQLAlchemyFlightFeedRepository": server.repository},
        "services.conformance_svc": {
            "FlightOperationConformanceHelper": server.helper,
            "cast_to_volume4d": lambda volume: volume,
        },
        "clients.dss_scd_client": {"SCDOperations": server.dss_client},
    }
    for name in ["", *sorted({name.partition(".")[0] for name in types}), *types]:
        content = types.get(name, {})
        module = ModuleType(f"flight_blender.{name}".rstrip("."))
        vars(module).update(content, __path__=[])
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return server


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


def test_states_follow_from_positions(
    stand_ins: Server, engine: Any, dsn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Outside its volumes a flight is nonconforming, and for long contingent; inside again, activated."""
    monkeypatch.delitem(sys.modules, "conflictdb_states", raising=False)
    module = importlib.import_module("conflictdb_states")
    now = datetime.now(UTC).replace(microsecond=0)
    monkeypatch.setattr(sys.modules[__name__], "BEGIN", now - timedelta(minutes=12))
    # Volumes one after the other: it is in the second one now.
    stand_ins.flight.operational_intent = json.dumps({"volumes": [volume(8.0, 0), volume(8.0008, 9)]})
    with connect(dsn) as db:
        states, looks = module.States(db), Looks()

        def heard(seconds: int, lng: float, height_m: float = 60.0, *, later_s: int = 0) -> int:
            """Report a position, look as a worker does, and step again; return the state of the flight."""
            at = now - timedelta(seconds=100 - seconds)
            stand_ins.last = SimpleNamespace(created_at=at, longitude_dd=lng, latitude_dd=47.0005, altitude_mm=height_m)
            step()
            looks.look(db.connection, round(1e6 * (at.timestamp() + later_s)), is_silence_due=True)
            step()
            return int(stand_ins.flight.state)

        def step() -> None:
            with ThreadPoolExecutor(1) as thread:
                thread.submit(asyncio.run, states.step(None)).result()

        assert heard(0, 8.0015) == State.Activated
        assert heard(1, 8.0005) == State.Nonconforming  # in the first volume, which is over
        assert not asked(engine, 2, [volume(8.005, 9)]).is_approved  # 350 m away, where it may be
        assert heard(2, 8.0015) == State.Activated
        assert asked(engine, 2, [volume(8.005, 9)]).is_approved
        assert heard(3, 8.0015, 100.0) == State.Nonconforming  # too high
        assert heard(4, 8.0015) == State.Activated
        assert heard(5, 8.0019) == State.Nonconforming
        monkeypatch.setattr(module, "CONTINGENT_AFTER_S", 0.0)
        assert heard(6, 8.0019) == State.Contingent
        assert heard(7, 8.0015) == State.Contingent  # only its operator ends that
        stand_ins.flight.state = State.Activated
        db.connection.execute("SET conflictdb.silent_after = '15 seconds'")
        db.connection.commit()
        assert heard(8, 8.0015) == State.Activated
        assert heard(9, 8.0015, later_s=20) == State.Contingent  # silent
    assert [event for _, _, event in stand_ins.reactions] == [
        "ua_exits_coordinated_op_intent", "operator_return_to_coordinated_op_intent",
        "ua_exits_coordinated_op_intent", "operator_return_to_coordinated_op_intent",
        "ua_exits_coordinated_op_intent", "timeout", "flight_blender_confirms_contingent",
    ]  # fmt: skip
    # At each reaction the stored intent has its new state, and where the flight may be.
    assert [one["state"] for one in stand_ins.intents] == [
        "Nonconforming", "Activated", "Nonconforming", "Activated", "Nonconforming", "Contingent", "Contingent",
    ]  # fmt: skip
    places = [[one["volume"]["outline_circle"]["center"]["lng"] for one in intent["off_nominal_volumes"]]
              for intent in stand_ins.intents]  # fmt: skip
    assert places == [[8.0005], [], [8.0015], [], [8.0019], [8.0019], [8.0015]]
    assert {len(one["volumes"]) for one in stand_ins.intents} == {2}
    off = stand_ins.intents[2]["off_nominal_volumes"][0]["volume"]
    assert (off["altitude_lower"]["value"], off["altitude_upper"]["value"]) == (-400.0, 600.0)
    assert [pair for *pair, _ in stand_ins.reactions] == [list(pair) for pair in stand_ins.history]


def test_the_dss_learns_of_states_and_of_where_a_flight_may_be(
    stand_ins: Server, engine: Any, dsn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With each change, and each minute while it is outside; if there is no DSS, the state changes all the same."""
    monkeypatch.delitem(sys.modules, "conflictdb_states", raising=False)
    module = importlib.import_module("conflictdb_states")
    now = datetime.now(UTC).replace(microsecond=0)
    monkeypatch.setattr(sys.modules[__name__], "BEGIN", now - timedelta(minutes=6))
    stand_ins.flight.operational_intent = json.dumps({"volumes": [volume(8.0, 0)], "priority": 0})
    stand_ins.reference = SimpleNamespace(id=uuid.UUID(int=7), ovn="ovn 0", state="Activated", subscription_id="sub")
    flushed: list[str] = []

    async def flush() -> None:
        flushed.append(stand_ins.reference.ovn)

    with connect(dsn) as db:
        states, looks = module.States(db), Looks()
        for seconds, lng, is_down in ((0, 8.0005, False), (1, 8.01, False), (30, 8.011, False), (62, 8.012, True),
                                      (130, 8.0005, False)):  # fmt: skip
            at, stand_ins.is_dss_down = now - timedelta(seconds=200 - seconds), is_down
            stand_ins.last = SimpleNamespace(created_at=at, longitude_dd=lng, latitude_dd=47.0005, altitude_mm=60.0)
            for turn in range(2):
                with ThreadPoolExecutor(1) as thread:
                    thread.submit(asyncio.run, states.step(SimpleNamespace(flush=flush))).result()
                if not turn:
                    looks.look(db.connection, round(1e6 * at.timestamp()), is_silence_due=True)
    told = [(one["current_state"], one["new_state"], one["ovn"], len(one["extents"])) for one in stand_ins.dss]
    assert told == [
        ("Activated", "Nonconforming", "ovn 0", 2),
        ("Nonconforming", "Nonconforming", "ovn 1", 2),  # no answer
        ("Nonconforming", "Nonconforming", "ovn 1", 2),
        ("Nonconforming", "Activated", "ovn 3", 1),
    ]
    assert [one["operational_intent_ref_id"] for one in stand_ins.dss] == [str(uuid.UUID(int=7))] * 4
    ring = stand_ins.dss[0]["extents"][0]["volume"]["outline_polygon"]["vertices"]
    assert (len(ring), ring[0]) == (5, ring[-1])
    assert (stand_ins.reference.ovn, stand_ins.reference.state) == ("ovn 4", "Activated")
    assert flushed == ["ovn 1", "ovn 3", "ovn 4"]
    assert stand_ins.details.off_nominal_volumes == "[]"
    assert stand_ins.flight.state == State.Activated


def test_the_types_of_the_server(engine_of_server: Any) -> None:
    from flight_blender.domain_types.plugin_protocols import DeconflictionEngineProtocol  # type: ignore[import-not-found]

    assert isinstance(engine_of_server.ConflictdbEngine(), DeconflictionEngineProtocol)
    assert asked(engine_of_server, 1, [volume(8.0, 0)]).is_approved
    assert not asked(engine_of_server, 2, [volume(8.0, 0)]).is_approved


@pytest.fixture
def engine_of_server(request: pytest.FixtureRequest) -> Any:
    pytest.importorskip("flight_blender", reason="flight_blender is not installed (it needs Python 3.14)")
    return request.getfixturevalue("engine")
