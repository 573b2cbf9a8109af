"""Run the page's server until it is interrupted."""

import asyncio
import errno
import ipaddress
import secrets
import socket
from collections.abc import Callable
from types import FrameType
from typing import TYPE_CHECKING, Any, Final, Self

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from conflictdb.errors import ConflictDBError
from conflictdb.map.app import application
from conflictdb.map.guard import Access, local_hosts

if TYPE_CHECKING:
    import psycopg

# The usual ports, tried in this order: one server each for the scenes that a planner has open.
USUAL_PORTS: Final = range(8620, 8630)


# Longest time until the head of a request is complete, seconds: whoever reaches the port could use up its connections.
_HEAD_S: Final = 10.0


class Connection(H11Protocol):
    """A connection to a client that ends if the head of a request does not arrive in time."""

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for a head."""
        super().connection_made(transport)
        self._watch()

    def data_received(self, data: bytes) -> None:
        """Wait for the rest of a head."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        super().connection_lost(exc)
        if self._late is not None:
            self._late.cancel()

    def _watch(self) -> None:
        waits = self.conn.their_state is h11.IDLE
        if waits and self._late is None:
            self._late = self.loop.call_later(_HEAD_S, self.transport.close)
        elif not waits and self._late is not None:
            self._late.cancel()
            self._late = None


class PageServer(uvicorn.Server):
    """Shows the scenes of a database, `scene` first, at an address.

    Only to this machine, or to clients with the token in `address`.

    port : None is the first free one of `USUAL_PORTS`, 0 any free one

    Raises ConflictDBError if it cannot listen there.
    """

    def __init__(
        self, scene: str, connect: "Callable[[], psycopg.Connection[Any]]", host: str, port: int | None
    ) -> None:
        self._listener = _listening(host, USUAL_PORTS if port is None else range(port, port + 1))
        bound, port = self._listener.getsockname()[:2]
        host = host or bound
        token = None if _is_local(bound) else secrets.token_urlsafe(24)
        reached = _outward(bound) or host
        shown = f"[{reached}]" if ":" in reached else reached
        access = Access(local_hosts(port, host, bound), token)
        self.address = f"http://{shown}:{port}{access.root}"
        app = application(scene, connect, access)
        self._end_streams = app.state.views.end
        super().__init__(
            uvicorn.Config(
                app,
                http=Connection,
                ws="none",
                loop="asyncio",
                log_config=None,
                access_log=False,
                server_header=False,
                timeout_graceful_shutdown=1,
            )
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._listener.close()

    def serve_until_interrupted(self) -> None:
        """Serve until SIGINT or SIGTERM, which is raised again, or until `end`."""
        self.run(sockets=[self._listener])

    def end(self) -> None:
        """Request the end; from any thread."""
        # End the event streams first: the server would wait for them.
        self._end_streams()
        self.should_exit = True

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End on a signal."""
        self._end_streams()
        super().handle_exit(sig, frame)


def _is_local(bound: str) -> bool:
    """Return whether an address is a loopback address; IPv4-mapped IPv6 addresses do not count."""
    address = ipaddress.ip_address(bound)
    return address.is_loopback and getattr(address, "ipv4_mapped", None) is None


def _outward(bound: str) -> str | None:
    """Return where other machines reach a server that listens at all addresses; None for one that does not."""
    address = ipaddress.ip_address(bound)
    if not address.is_unspecified:
        return None
    family, somewhere = (socket.AF_INET, "192.0.2.1") if address.version == 4 else (socket.AF_INET6, "2001:db8::1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((somewhere, 9))  # sends nothing: the system chooses the address
            found = str(probe.getsockname()[0])
        except OSError:
            found = ""
    return found if found and not ipaddress.ip_address(found).is_loopback else socket.gethostname()


def _listening(host: str, ports: range) -> socket.socket:
    for port in ports:
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            listener = socket.socket(family, kind)
            try:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                listener.bind(address)
                listener.listen()  # accept connections before the address is printed
            except OSError:
                listener.close()
                raise
        except (OSError, UnicodeError) as error:  # UnicodeError: a label of the name is empty or too long
            if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
                continue
            raise ConflictDBError(f"cannot listen on {host}, port {port}: {error}") from error
        return listener
    which = f"port {ports[0]} is" if len(ports) == 1 else f"ports {ports[0]} to {ports[-1]} are"
    raise ConflictDBError(f"cannot listen on {host}: {which} in use; choose another one: --port N, or --port 0 for any")
