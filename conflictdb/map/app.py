"""Serve the page's requests as an ASGI application: it writes acknowledgements, moved plans and ends of branches."""

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from queue import LifoQueue
from typing import Any, Final

import psycopg
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from conflictdb import store
from conflictdb.errors import ConflictDBError, InvalidInput, NotPermitted
from conflictdb.map import content, editing, what_if
from conflictdb.map.content import Pair, to_json
from conflictdb.map.guard import Access, Guard
from conflictdb.map.views import SceneView, SceneViews
from conflictdb.model.margin import Margin
from conflictdb.plot import land

Connection = psycopg.Connection[Any]
Connect = Callable[[], Connection]

_ROOT: Final = Path(str(files("conflictdb") / "map"))
_TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".wasm": "application/wasm",
}
# Concurrent connections to the database; a browser requests six tiles at a time.
_CONNECTIONS: Final = 4
# Size limit of a writing request, bytes: a reason has at most 10,000.
_MOST_BYTES: Final = 65_536
# Longest change of a departure, seconds: a day.
_LONGEST_S: Final = 86_400
# Farthest from an object that the page looks for others, metres.
_FARTHEST_M: Final = 1_000_000
# Largest moves of a plan: a day, and any height on the earth.
_MOST_MOVED: Final = {
    "later_us": _LONGEST_S * 1e6,
    "up_m": 20_000.0,
    "starts_us": _LONGEST_S * 1e6,
    "ends_us": _LONGEST_S * 1e6,
}
# Number, longitude (it may run on across the date line) and latitude of a moved waypoint.
_MOST_WAYPOINT: Final = (2**31 - 1, 540, 90)
# Longitudes and latitudes of a place of an area, and of where it goes.
_MOST_SHIFT: Final = (540, 90, 540, 90)
# Limit on numbers of requests: the range of a database parameter.
_MOST_NUMBER: Final = 2**31 - 1
# Versions begin with milliseconds (`live.SceneChanges`); the page reads them as numbers.
_MOST_VERSION: Final = 2**53 - 1
# SQLSTATE of a scene that does not exist, or is not visible to the role (10_refusals.sql).
_SCENE_UNKNOWN: Final = "ZC010"


def assets() -> dict[str, tuple[str, bytes]]:
    """Return the files of the page: type and content by path."""
    found = {
        f"/{file.relative_to(_ROOT).as_posix()}": (_TYPES[file.suffix], file.read_bytes())
        for folder in ("page", "vendor")
        for file in (_ROOT / folder).iterdir()
        if file.suffix in _TYPES
    }
    return {**found, "/": found["/page/index.html"]}


class Connections:
    """A pool of read-only connections, opened on demand."""

    def __init__(self, connect: Connect) -> None:
        self._connect = connect
        self._free: LifoQueue[Connection | None] = LifoQueue()
        for _ in range(_CONNECTIONS):
            self._free.put(None)

    @contextmanager
    def one(self) -> Iterator[Connection]:
        """Borrow a connection, waiting for a free one; raises StoreError if it cannot connect."""
        connection = self._free.get()
        try:
            if connection is None or connection.closed:
                connection = self._connect()
                store.never_write(connection)
            yield connection
        finally:
            if connection is not None and connection.broken:
                connection.close()
                connection = None
            self._free.put(connection)

    def close(self) -> None:
        """Close all free connections."""
        while not self._free.empty():
            connection = self._free.get_nowait()
            if connection is not None:
                connection.close()


class Answers:
    """Request handlers for pages of the scenes of a database; they run in threads, except `events`.

    A request has its scene as parameter `scene`; without it the scene is `usual`.
    """

    def __init__(self, usual: str, connect: Connect, access: Access) -> None:
        self.views = SceneViews(connect)
        self.connections = Connections(connect)
        self._usual = usual
        self._connect = connect
        self._access = access

    def view(self, request: Request) -> SceneView:
        """Return the view of the scene of a request."""
        return self.views.of(self._name(request))

    def _name(self, request: Request) -> str:
        return _parameter(request, "scene") or self._usual

    def scenes(self, request: Request) -> Response:
        """Return the scenes that the user may see, and which one a page shows unless it is asked for another."""
        with self.connections.one() as connection:
            return _json({"usual": self._usual, "scenes": content.scenes(connection)})

    def known(self, request: Request) -> Response:
        """Return the conflicts of a scene as they were known at an instant, or why they are not known."""
        try:
            at = datetime.fromisoformat(_parameter(request, "at") or "")
        except ValueError:
            raise HTTPException(400, "at: must be an instant as 2026-06-01T09:30:00Z") from None
        with self.connections.one() as connection:
            return _json(content.known_at(connection, self._name(request), at if at.tzinfo else at.replace(tzinfo=UTC)))

    def scene(self, request: Request) -> Response:
        """Return name, settings and state of the scene, the page's rights, and the secret for its writing requests."""
        view = self.view(request)
        with self.connections.one() as connection:
            facts = content.settings(connection, view.name)
            may = {
                "may_acknowledge": store.may_acknowledge(connection),
                "may_edit": store.may_edit(connection, view.name),
            }
        return _json({**facts, **may, "version": view.changes.version, "secret": self._access.secret})

    def conflicts(self, request: Request) -> Response:
        """Return all conflicts, for the list and the timeline."""
        with self.connections.one() as connection:
            return Response(content.conflicts(connection, self._name(request)), media_type="application/octet-stream")

    def depths(self, request: Request) -> Response:
        """Return how deep conflicts undercut the required separation, for the order of the list."""
        with self.connections.one() as connection:
            return _json(content.depths(connection, self._name(request)))

    def live(self, request: Request) -> Response:
        """Return how tracks keep their plans by their positions, and the conflicts that follow."""
        with self.connections.one() as connection:
            return Response(store.map_live(connection, self._name(request)), media_type="application/json")

    def areas(self, request: Request) -> Response:
        """Return all areas without their shapes, which are in tiles."""
        with self.connections.one() as connection:
            return _json(content.areas(connection, self._name(request)))

    def overview(self, request: Request) -> Response:
        """Return the outlines of all areas, simplified for small scales."""
        with self.connections.one() as connection:
            return Response(store.map_overview(connection, self._name(request)), media_type="application/octet-stream")

    def shapes(self, request: Request) -> Response:
        """Return GeoJSON of all areas, paths, conflict regions and first contacts."""
        with self.connections.one() as connection, store.transaction(connection):
            known = content.listed(content.conflicts(connection, self._name(request)))
            return _json(content.shapes(connection, self._name(request), known))

    def tracks(self, request: Request) -> Response:
        """Return all tracks with the data for drawing their havens."""
        with self.connections.one() as connection:
            return Response(content.tracks(connection, self._name(request)), media_type="application/octet-stream")

    def table(self, request: Request) -> Response:
        """Return all conflicts as CSV, as the command line writes them."""
        with self.connections.one() as connection:
            return Response(content.table(connection, self._name(request)), media_type="text/csv; charset=utf-8")

    def heights(self, request: Request) -> Response:
        """Return the heights of tracks whose heights change."""
        with self.connections.one() as connection:
            return _json(content.heights(connection, self._name(request)))

    def pieces(self, request: Request) -> Response:
        """Return the pieces of a track and of what it may meet if it departs earlier or later.

        Or of any object, with `near_m`, and of what comes so near as it is planned.
        """
        key, near_m = _parameter(request, "key") or "", _parameter(request, "near_m")
        within_s = _number("within_s", _parameter(request, "within_s") or "0", what_if.LONGEST_S)
        margin_m = _number("margin_m", _parameter(request, "margin_m") or "0", _FARTHEST_M)
        with self.connections.one() as connection:
            if near_m is None:
                packed = what_if.packed_departing(connection, self._name(request), key, within_s, margin_m)
            else:
                within_m = _number("near_m", near_m, _FARTHEST_M)
                packed = what_if.packed_near(connection, self._name(request), key, within_m)
            return Response(packed, media_type="application/octet-stream")

    def pair(self, request: Request) -> Response:
        """Return why two objects are in conflict."""
        asked = Pair(_parameter(request, "a") or "", _parameter(request, "b") or "")
        with self.connections.one() as connection:
            return _json(content.pair(connection, self._name(request), asked))

    def plan(self, request: Request) -> Response:
        """Return an object as a feature of a scene file, and its digest, for moving it."""
        with self.connections.one() as connection:
            return _json(editing.described(connection, self._name(request), _parameter(request, "key") or ""))

    def owners(self, request: Request) -> Response:
        """Return who owns an object and those that it is in conflict with."""
        with self.connections.one() as connection:
            return _json(content.owners(connection, self._name(request), _parameter(request, "key") or ""))

    def tile(self, request: Request) -> Response:
        """Return a vector tile."""
        kind = request.path_params["kind"]
        if kind not in store.TILES:
            raise HTTPException(404, "no such tiles")
        z, x, y = (_number(name, request.path_params[name]) for name in "zxy")
        view = self.view(request)
        key = (view.changes.version, kind, z, x, y)
        with self.connections.one() as connection:
            if (tile := view.tile(key)) is not None:
                store.scene_or_branch_id(connection, view.name)  # raises if the scene is no longer shared
            else:
                tile = store.tile(connection, kind, z, x, y, view.name)
                view.keep(key, tile)
        return Response(tile, media_type="application/vnd.mapbox-vector-tile")

    def land(self, request: Request) -> Response:
        """Return land in a box, as GeoJSON."""
        detail = request.path_params["detail"]
        if detail not in (land.COARSE, land.FINE):
            raise HTTPException(404, "no such land")
        box, but = (None if (text := _parameter(request, name)) is None else _box(text) for name in ("box", "but"))
        return Response(land.geojson(detail, box or land.WORLD, but), media_type="application/geo+json")

    def acknowledge(self, request: Request, asked: Mapping[str, Any]) -> Response:
        """Acknowledge a conflict, or without a reason withdraw its acknowledgement."""
        pair, reason = Pair(*(_text(asked, name) for name in ("a", "b"))), asked.get("reason")
        if reason is not None and not isinstance(reason, str):
            raise HTTPException(400, "reason: must be a text, or null")
        # Needs a connection that may write.
        with self._connect() as connection:
            if reason is None:
                store.unacknowledge(connection, self._name(request), pair.a, pair.b)
            else:
                store.acknowledge(connection, self._name(request), pair.a, pair.b, reason, None)
        return _json({})

    def probe(self, request: Request, asked: Mapping[str, Any]) -> Response:
        """Return what a plan would meet as the page moved it, with a margin; stores nothing."""
        limits = {"margin_s": _LONGEST_S, "margin_m": _FARTHEST_M}
        margin = Margin.of("probe", *(_real(name, asked.get(name, 0), most) for name, most in limits.items()))
        with self.connections.one() as connection:
            return _json(editing.probed(connection, self._name(request), _move(asked), margin))

    def move(self, request: Request, asked: Mapping[str, Any]) -> Response:
        """Store a plan that the page moved, in the scene or in a new branch of it; return its digest."""
        with self._connect() as connection:
            return _json({"plan": editing.put(connection, self._name(request), _move(asked))})

    def branch(self, request: Request, asked: Mapping[str, Any]) -> Response:
        """Merge a branch into its parent, or drop it; return the name of the parent."""
        does = _text(asked, "does")
        if does not in editing.BRANCH_ENDS:
            raise HTTPException(400, f"does: must be {' or '.join(editing.BRANCH_ENDS)}")
        with self._connect() as connection:
            return _json({"parent": editing.end_branch(connection, self._name(request), does)})


def application(usual: str, connect: Connect, access: Access) -> Starlette:
    """Return the application that shows scenes of a database, `usual` first, to clients with access."""
    answers = Answers(usual, connect, access)
    known = assets()

    async def asset(request: Request) -> Response:
        kind, body = known[request.url.path]
        return Response(body, media_type=kind)

    async def places(request: Request) -> Response:
        return _json(land.places())

    async def events(request: Request) -> Response:
        version = _parameter(request, "version")
        known = None if version is None else _number("version", version, _MOST_VERSION)
        return StreamingResponse(answers.view(request).changes.each(known), media_type="text/event-stream")

    def writes(handler: Callable[[Request, Mapping[str, Any]], Response]) -> Callable[[Request], Awaitable[Response]]:
        async def handled(request: Request) -> Response:
            return await run_in_threadpool(handler, request, await _body(request))

        return handled

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        answers.views.start()
        yield
        answers.views.end()
        answers.connections.close()

    app = Starlette(
        routes=[
            *(Route(path, asset) for path in known),
            Route("/api/scenes", answers.scenes),
            Route("/api/scene", answers.scene),
            Route("/api/known", answers.known),
            Route("/api/conflicts", answers.conflicts),
            Route("/api/areas", answers.areas),
            Route("/api/live", answers.live),
            Route("/api/depths", answers.depths),
            Route("/api/overview", answers.overview),
            Route("/api/tracks", answers.tracks),
            Route("/api/shapes", answers.shapes),
            Route("/api/table", answers.table),
            Route("/api/heights", answers.heights),
            Route("/api/pair", answers.pair),
            Route("/api/pieces", answers.pieces),
            Route("/api/owners", answers.owners),
            Route("/api/plan", answers.plan),
            Route("/api/events", events),
            Route("/api/acknowledge", writes(answers.acknowledge), methods=["POST"]),
            Route("/api/probe", writes(answers.probe), methods=["POST"]),
            Route("/api/move", writes(answers.move), methods=["POST"]),
            Route("/api/branch", writes(answers.branch), methods=["POST"]),
            Route("/tiles/{kind}/{z}/{x}/{y}", answers.tile),
            Route("/places", places),
            Route("/land/{detail}", answers.land),
        ],
        middleware=[Middleware(Guard, access=access)],
        exception_handlers={ConflictDBError: _failed, psycopg.Error: _failed, HTTPException: _refused},
        lifespan=lifespan,
    )
    app.state.views = answers.views
    return app


def _parameter(request: Request, name: str) -> str | None:
    """Return a query parameter, None if it is absent."""
    given = request.query_params.getlist(name)
    if len(given) > 1:
        raise HTTPException(400, f"{name}: must be given once")
    return given[0] if given else None


def _number(name: str, text: str, most: int = _MOST_NUMBER) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= len(str(most)) and int(text) <= most):
        raise HTTPException(400, f"{name}: must be a whole number from 0 to {most}")
    return int(text)


def _box(text: str) -> land.Box:
    try:
        west, south, east, north = map(float, text.split(","))
    except ValueError:
        west, south, east, north = 0.0, 0.0, 0.0, 0.0
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise HTTPException(400, "a box must be west,south,east,north in degrees")
    return west, south, east, north


async def _body(request: Request) -> Mapping[str, Any]:
    body = b""
    try:
        async for part in request.stream():
            body += part
            if len(body) > _MOST_BYTES:
                raise HTTPException(413, "too long")
    except ClientDisconnect:
        raise HTTPException(400, "ended early") from None
    try:
        value = content.from_json(body)
    except ValueError:
        raise HTTPException(400, "must be JSON") from None
    if not isinstance(value, dict):
        raise HTTPException(400, "must be a JSON object")
    return value


def _text(asked: Mapping[str, Any], name: str) -> str:
    value = asked.get(name)
    if not isinstance(value, str):
        raise HTTPException(400, f"{name}: must be a text")
    return value


def _real(name: str, value: object, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not -most <= value <= most:
        raise HTTPException(400, f"{name}: must be a number from {-most:g} to {most:g}")
    return value


def _reals(name: str, value: object, most: Sequence[float], what: str) -> tuple[float, ...] | None:
    """Return numbers of a request, each between -most and most; None for null."""
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != len(most):
        raise HTTPException(400, f"{name}: must be {what}, or null")
    return tuple(_real(name, one, limit) for one, limit in zip(value, most, strict=True))


def _move(asked: Mapping[str, Any]) -> editing.PlanMove:
    branch = asked.get("branch")
    if branch is not None and not isinstance(branch, str):
        raise HTTPException(400, "branch: must be a text, or null")
    later_us, up_m, starts_us, ends_us = (_real(name, asked.get(name, 0), most) for name, most in _MOST_MOVED.items())
    place = _reals("waypoint", asked.get("waypoint"), _MOST_WAYPOINT, "number, longitude and latitude")
    waypoint = None if place is None else (abs(int(place[0])), place[1], place[2])
    shift_deg = _reals("shift_deg", asked.get("shift_deg"), _MOST_SHIFT, "longitude and latitude of two places")
    return editing.PlanMove(
        _text(asked, "key"), _text(asked, "plan"), round(later_us), up_m, waypoint, branch,
        shift_deg, round(starts_us), round(ends_us),
    )  # fmt: skip


async def _failed(request: Request, error: Exception) -> Response:
    if getattr(error.__cause__, "sqlstate", None) == _SCENE_UNKNOWN:  # its message names other scenes
        return _json({"error": "it was deleted, renamed or unshared"}, 410)
    status = 400 if isinstance(error, InvalidInput) else 403 if isinstance(error, NotPermitted) else 503
    return _json({"error": str(error)}, status)


async def _refused(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 (what it is registered for)
    return _json({"error": error.detail}, error.status_code)


def _json(value: object, status: int = 200) -> Response:
    return Response(to_json(value), status, media_type="application/json")
