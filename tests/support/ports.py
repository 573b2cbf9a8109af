"""Ports of servers that cannot choose one themselves."""

import socket
from pathlib import Path
from random import SystemRandom

_FIRST = 10_240
_CHOSEN_BY_SYSTEM = Path("/proc/sys/net/ipv4/ip_local_port_range")


def free_port() -> int:
    """Return a port of 127.0.0.1 in which nobody listens, and which the system gives to nobody.

    The system gives a port that was bound to 0 and closed to the next program that asks for one. Tests draw from the
    other ports, each time anew: `random` has the same seed in all workers of a test run.
    """
    end = int(_CHOSEN_BY_SYSTEM.read_text().split()[0]) if _CHOSEN_BY_SYSTEM.exists() else 32_768
    ports = range(_FIRST, max(end, _FIRST + 10_000))
    while True:
        port = SystemRandom().choice(ports)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
