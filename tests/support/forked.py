"""Programs forked from one process that has imported conflictdb and its libraries, so that each starts in milliseconds.

They are processes of their own in all other respects: arguments, environment, directory, streams, exit code, signals.
`tests/unit/test_imports.py` shows that commands import what they need.

    python forked.py ADDRESS    forks programs until its standard input ends; run_forked.py runs one
"""

import atexit
import gc
import importlib
import os
import runpy
import shlex
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from select import select
from typing import Final, NoReturn

import conflictdb

_LIBRARIES: Final = (
    "alembic.command", "fpdf", "geoalchemy2", "geopandas", "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_svg", "matplotlib.pyplot", "pandas", "psycopg", "pyarrow.parquet", "pyogrio",
    "scipy.optimize", "shapely", "sqlalchemy.orm", "starlette.applications", "uvicorn",
)  # fmt: skip


@contextmanager
def forking(address: Path) -> Iterator[str]:
    """Fork programs until the end of the block; yield the words of a shell that come before one and its arguments."""
    command = [sys.executable, __file__, address]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline(), "nothing forks programs"
        yield shlex.join([sys.executable, "-I", "-S", str(Path(__file__).with_name("run_forked.py")), str(address)])


def _serve(address: str) -> None:
    for library in (*_LIBRARIES, *_modules()):
        importlib.import_module(library)
    gc.freeze()  # what all have in common is neither searched for garbage nor copied
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(address)
        listening.listen()
        os.write(1, b"ready\n")
        signal.signal(signal.SIGCHLD, _report)
        while listening in select([0, listening], [], [])[0]:
            connection, _ = listening.accept()
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])  # until it is known whose program may end
            _fork(connection, listening)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])


def _modules() -> Iterator[str]:
    """Yield the names of conflictdb's modules, without those that need Spark or are programs."""
    root = Path(conflictdb.__file__).parent
    for path in root.rglob("*.py"):
        parts = path.relative_to(root.parent).with_suffix("").parts
        if parts[1] != "spark" and parts[-1] not in ("__init__", "__main__"):
            yield ".".join(parts)


_RUNNING: Final[dict[int, socket.socket]] = {}  # who started the program of each process


def _report(*_: object) -> None:
    """Send the exit codes of programs that have ended to who started them."""
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            pid, status = ended
            with _RUNNING.pop(pid) as connection, suppress(OSError):
                connection.sendall(b"%d\n" % (os.waitstatus_to_exitcode(status) % 256))


def _fork(connection: socket.socket, listening: socket.socket) -> None:
    """Fork one program, and return its number to who started it. Once only: to copy this process takes 25 ms."""
    size, streams, _, _ = socket.recv_fds(connection, 4, 3)
    with connection.makefile("rb") as stream:
        message = stream.read(int.from_bytes(size, "big")).decode("utf-8", "surrogateescape")
    if pid := os.fork():
        for each in streams:
            os.close(each)
        _RUNNING[pid] = connection
        connection.sendall(b"%d\n" % pid)
        return
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
    for each in (listening, connection, *_RUNNING.values()):
        each.close()
    for number, stream_of in enumerate(streams):
        os.dup2(stream_of, number)
        os.close(stream_of)
    sys.stdin, sys.stdout = os.fdopen(0), os.fdopen(1, "w")
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace")
    directory, count, *rest = message.split("\0")
    words, environ = rest[: int(count)], rest[int(count) :]
    os.chdir(directory)
    os.environ.clear()
    os.environ.update(variable.split("=", 1) for variable in environ)
    _be(words)


def _be(words: list[str]) -> NoReturn:
    """Run the program that this process is."""
    sys.argv = words
    code = 0
    try:
        if words[0] == "conflictdb":
            from conflictdb.cli import main

            sys.exit(main())
        sys.path[0] = str(Path(words[0]).resolve().parent)
        runpy.run_path(words[0], run_name="__main__")
    except SystemExit as ended:
        code = int(ended.code or 0)
    except BaseException:
        traceback.print_exc()
        code = 1
    # As Python ends; but it would take all modules apart, which lasts longer than most programs.
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    _serve(sys.argv[1])
