"""Configure the embedded server and the connections of its clients."""

import os
from pathlib import Path
from typing import Final

from psycopg import conninfo, pq

_SHM_WANTED_BYTES: Final = 512 * 2**20

# Owner of the cluster, a superuser: creates and upgrades the schema.
ADMINISTRATOR: Final = "postgres"
# Everyday user: a worker of conflictdb who may create schemas, but no superuser.
PLANNER: Final = "planner"

# Connection options without a libpq default; an empty value counts as none.
_EMPTY_IS_NONE: Final = frozenset({"hostaddr", "options", "require_auth", "passfile", "password"})


def forced(socket_directory: Path) -> list[tuple[str, str]]:
    """Return the settings that every start passes on the command line."""
    quoted = str(socket_directory).replace('"', '""')
    forced = [
        ("listen_addresses", ""),
        ("unix_socket_directories", f'"{quoted}"'),
        ("unix_socket_permissions", "0700"),
        ("jit", "off"),
    ]
    try:
        shm = os.statvfs("/dev/shm")  # noqa: S108 (only its size is read)
    except OSError:
        return forced
    # Containers often have 64 MB there: too little for a parallel hash join.
    if 0 < shm.f_frsize * shm.f_blocks < _SHM_WANTED_BYTES:
        forced.append(("dynamic_shared_memory_type", "sysv"))
    return forced


def initial(*, durable: bool) -> str:
    """Return the settings file of a new data directory; ALTER SYSTEM overrides it."""
    memory_mib = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2**20
    # To drop or shorten a table, a server looks at all its buffers: each test does that, and 1 GB takes it 0.8 ms.
    buffers_mib = max(128, min(1024, memory_mib // 8)) if durable else 128
    lines = [
        "# Written by conflictdb when it made this data directory.",
        "timezone = 'UTC'",
        "log_timezone = 'UTC'",
        f"shared_buffers = '{buffers_mib}MB'",
        f"effective_cache_size = '{max(256, memory_mib // 2)}MB'",
        "work_mem = '64MB'",
        "maintenance_work_mem = '256MB'",
        "random_page_cost = 1.1",
        # For bulk loads by one user: no replication, rare checkpoints.
        "wal_level = minimal",
        "max_wal_senders = 0",
        "max_wal_size = '4GB'",
        "checkpoint_timeout = '15min'",
    ]
    if not durable:
        lines += ["# Made for tests: a crash of the machine may ruin these data.", "fsync = off"]
        lines += ["full_page_writes = off", "synchronous_commit = off"]
        # Thousands of short sessions: each would load PostGIS, which takes it 12 ms.
        lines += ["shared_preload_libraries = 'postgis-3'"]
        # An upgrade takes 2,200 locks, and a usual server has 7,000: workers of a test run upgrade at once.
        lines += ["max_locks_per_transaction = 512"]
    return "\n".join(lines) + "\n"


def dsn(socket_directory: str, user: str = PLANNER) -> str:
    """Return the connection string of a user, independent of PG* variables of the environment."""
    parts = {"host": socket_directory, "port": "5432", "user": user, "dbname": "conflictdb"}
    for option in pq.Conninfo.get_defaults():
        name = option.keyword.decode()
        if name not in parts and option.envvar and option.envvar.decode() in os.environ:
            if option.compiled:
                parts[name] = option.compiled.decode()
            elif name in _EMPTY_IS_NONE:
                parts[name] = ""
    return conninfo.make_conninfo("", **parts)
