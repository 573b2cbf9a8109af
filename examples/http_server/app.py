"""A small HTTP server over conflictdb: put, probe and admit plans, read conflicts and their events.

    CONFLICTDB_DSN="host=localhost dbname=exercise user=desk" uvicorn --factory app:application

Its OpenAPI is at /openapi.json. An error of conflictdb is a 4xx with its sentence, never a 5xx.
"""

import json
import os
import warnings
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import asdict
from itertools import islice
from typing import Any, Final

import psycopg
from psycopg_pool import ConnectionPool, PoolTimeout
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from conflictdb import (
    ConflictDBError,
    IncompleteWarning,
    InvalidInput,
    NotPermitted,
    Scene,
    StoredScene,
    connect,
    plans_schema,
)
from conflictdb.formats import read_plans
from conflictdb.formats.conflict_text import as_json

MOST_BYTES: Final = 1_000_000
MOST_PLANS: Final = 100
MOST_ROWS: Final = 10_000
LARGEST: Final = 2**63 - 1
# Of a statement, of waiting for a lock, and of waiting for a connection.
SECONDS, LOCK_SECONDS, POOL_SECONDS = 10, 2, 5
CONNECTIONS: Final = 8

Answer = dict[str, Any]


class RefusedError(Exception):
    """A request that this server refuses: status, and a sentence."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


def application() -> Starlette:
    """Return the application for the database of CONFLICTDB_DSN."""
    # Answers say themselves whether they are complete.
    warnings.simplefilter("ignore", IncompleteWarning)
    limits = f"-c statement_timeout={SECONDS}s -c lock_timeout={LOCK_SECONDS}s"
    pool = ConnectionPool(
        os.environ["CONFLICTDB_DSN"],
        min_size=1,
        max_size=CONNECTIONS,
        timeout=POOL_SECONDS,
        open=False,
        kwargs={"options": limits, "prepare_threshold": None},
    )

    @asynccontextmanager
    async def opened(_: Starlette) -> AsyncIterator[None]:
        with pool:
            await run_in_threadpool(pool.wait)
            yield

    app = Starlette(routes=[Route("/openapi.json", described), *map(_route, OPERATIONS)], lifespan=opened)
    app.state.pool = pool
    return app


async def described(_: Request) -> Response:
    """Return the OpenAPI document."""
    return JSONResponse(openapi())


def put(scene: StoredScene, settings: Scene, request: Request, text: str) -> Answer:
    """Put plans, also if they conflict."""
    counts = scene.put(_plans(settings, text))
    return {"added": counts.added, "updated": counts.updated, "unchanged": counts.unchanged}


def probe(scene: StoredScene, settings: Scene, request: Request, text: str) -> Answer:
    """Return the conflicts that plans would have, without storing them."""
    found = scene.probe(_plans(settings, text))
    return {"is_current": found.is_current, "remark": found.state.remark, "conflicts": _rows(found)}


def admit(scene: StoredScene, settings: Scene, request: Request, text: str) -> Answer:
    """Put plans only if they conflict with nobody."""
    query = request.query_params
    found = scene.admit(_plans(settings, text), query.get("owner"), replace=query.getlist("replace"))
    return {"admitted": found.is_admitted, "conflicts": _rows(found.conflicts)}


def conflicts(scene: StoredScene, settings: Scene, request: Request, text: str) -> Answer:
    """Return the known conflicts, earliest first."""
    found = scene.stream_conflicts()
    rows = _rows(islice(found, _number(request, "most", MOST_ROWS, MOST_ROWS)))
    return {"is_current": found.state.is_current, "remark": found.state.remark, "conflicts": rows}


def events(scene: StoredScene, settings: Scene, request: Request, text: str) -> Answer:
    """Return what happened to conflicts after an event, oldest first."""
    most = _number(request, "most", MOST_ROWS, MOST_ROWS)
    found = scene.conflict_events(after=_number(request, "after", 0, LARGEST), most=most)
    return {"events": [asdict(one) for one in found]}


def _plans(settings: Scene, text: str) -> list[Any]:
    plans = read_plans(text, settings)
    if not 1 <= len(plans) <= MOST_PLANS:
        raise RefusedError(422, f"plans: must be 1 to {MOST_PLANS} in a request; got {len(plans)}")
    return plans


def _rows(found: Iterable[Any]) -> Any:
    return json.loads("".join(as_json(found)))


def _number(request: Request, name: str, default: int, most: int) -> int:
    given = request.query_params.get(name)
    if given is None:
        return default
    if not (given.isascii() and given.isdigit() and len(given) <= len(str(most)) and int(given) <= most):
        raise RefusedError(422, f"{name}: must be a whole number from 0 to {most}; got {given[:60]!r}")
    return int(given)


Work = Callable[[StoredScene, Scene, Request, str], Answer]
OPERATIONS: Final[tuple[tuple[str, str, Work], ...]] = (
    ("PUT", "plans", put),
    ("POST", "probe", probe),
    ("POST", "admit", admit),
    ("GET", "conflicts", conflicts),
    ("GET", "events", events),
)


def _route(operation: tuple[str, str, Work]) -> Route:
    method, name, work = operation

    async def respond(request: Request) -> Response:
        try:
            text = "" if method == "GET" else await _body(request)
            content = await run_in_threadpool(_worked, work, request, text)
        except RefusedError as refused:
            return JSONResponse({"error": str(refused)}, refused.status)
        return Response(json.dumps(content, default=str), media_type="application/json")

    return Route(f"/scenes/{{scene}}/{name}", respond, methods=[method])


async def _body(request: Request) -> str:
    """Return the text of a request; raises RefusedError for more than MOST_BYTES, or a client that left."""
    parts, size = [], 0
    try:
        async for part in request.stream():
            size += len(part)
            if size > MOST_BYTES:
                raise RefusedError(413, f"request: must have at most {MOST_BYTES:,} bytes")
            parts.append(part)
    except ClientDisconnect:
        raise RefusedError(400, "request: ended before its body") from None
    try:
        return b"".join(parts).decode()
    except UnicodeDecodeError:
        raise RefusedError(400, "request: must be UTF-8") from None


def _worked(work: Work, request: Request, text: str) -> Answer:
    """Return the answer of an operation, on a connection of the pool; raises RefusedError for all its errors."""
    try:
        with request.app.state.pool.connection() as connection, connect(connection) as db:
            scene = db.scene(request.path_params["scene"])
            return work(scene, _settings(scene), request, text)
    except PoolTimeout:
        raise RefusedError(429, "too many requests at a time: try again") from None
    except ConflictDBError as error:
        raise RefusedError(_status(error), str(error)) from error


def _settings(scene: StoredScene) -> Scene:
    try:
        return scene.settings()
    except InvalidInput as error:
        raise RefusedError(404, str(error)) from error


def _status(error: ConflictDBError) -> int:
    if isinstance(error.__cause__, psycopg.errors.QueryCanceled):
        return 408
    return 422 if isinstance(error, InvalidInput) else 403 if isinstance(error, NotPermitted) else 409


def openapi() -> Answer:
    """Return the OpenAPI document; the form of plans is that of scene files."""
    schema = json.loads(json.dumps(plans_schema()).replace("#/$defs/", "#/components/schemas/"))
    forms = schema.pop("$defs")
    for name in ("$schema", "$id"):
        del schema[name]
    del schema["properties"]["scene"], forms["scene"]
    schema["properties"]["features"] |= {"minItems": 1, "maxItems": MOST_PLANS}
    refusals = {400: "Not UTF-8", 403: "Not permitted", 404: "No such scene", 408: "Out of time"}
    refusals |= {409: "Not possible now", 413: "Too large", 422: "Refused, with the rule", 429: "Too many requests"}
    sentence = {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}}
    paths: Answer = {}
    for method, name, work in OPERATIONS:
        responses = {"200": _response("The answer", {"type": "object"})}
        responses |= {str(code): _response(text, sentence) for code, text in refusals.items()}
        operation: Answer = {"summary": work.__doc__, "operationId": work.__name__, "responses": responses}
        operation["parameters"] = [
            {"name": "scene", "in": "path", "required": True, "schema": {"type": "string", "minLength": 1}},
            *PARAMETERS.get(name, ()),
        ]
        if method != "GET":
            content = {"application/json": {"schema": {"$ref": "#/components/schemas/plans"}}}
            operation["requestBody"] = {"required": True, "content": content}
        paths[f"/scenes/{{scene}}/{name}"] = {method.lower(): operation}
    about = {"title": "conflictdb", "version": "1"}
    return {"openapi": "3.1.0", "info": about, "paths": paths, "components": {"schemas": {"plans": schema, **forms}}}


def _response(text: str, schema: Answer) -> Answer:
    return {"description": text, "content": {"application/json": {"schema": schema}}}


def _query(name: str, schema: Answer) -> Answer:
    return {"name": name, "in": "query", "schema": schema}


_ROWS: Final = _query("most", {"type": "integer", "minimum": 0, "maximum": MOST_ROWS})
PARAMETERS: Final[dict[str, list[Answer]]] = {
    "admit": [
        _query("owner", {"type": "string", "minLength": 1, "maxLength": 200}),
        _query("replace", {"type": "array", "items": {"type": "string"}}),
    ],
    "conflicts": [_ROWS],
    "events": [_ROWS, _query("after", {"type": "integer", "minimum": 0, "maximum": LARGEST})],
}
