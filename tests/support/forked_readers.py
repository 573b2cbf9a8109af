"""Confined readers of files, forked from a process that has loaded their library: each starts in milliseconds.

They have the environment, streams, limits and arguments of `ConfinedProgram.running`. Tests of hostile files start them
as users do.

    forked_readers.py PROGRAM SOCKET    forks readers of a program until the socket ends
"""

import io
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, NoReturn

_MOST_BYTES: Final = 1 << 20  # of a request
_PROGRAMS: Final = ("ogr_child.py", "parquet_child.py")


class ForkedReader:
    """A reader, with what `confined` uses of `subprocess.Popen`."""

    def __init__(self, server: socket.socket, arguments: Sequence[str]) -> None:
        ends = [os.pipe() for _ in range(3)]
        try:
            socket.send_fds(server, [json.dumps(arguments).encode()], [write for _, write in ends])
        finally:
            for _, write in ends:
                os.close(write)
        self.stdout, self.stderr, self._status = (os.fdopen(read, "rb") for read, _ in ends)
        self._pid = int(self._status.readline())
        self._code: int | None = None

    def wait(self) -> int:
        """Return its exit code; negative: the signal that ended it."""
        if self._code is None:
            self._code = int(self._status.readline())
        return self._code

    def kill(self) -> None:
        """End it."""
        if self._code is None:
            with suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)

    def __enter__(self) -> "ForkedReader":
        return self

    def __exit__(self, *_: object) -> None:
        self.stdout.close()
        self.stderr.close()
        self.wait()
        self._status.close()


class ReaderForks:
    """Processes that fork readers, one for each program and environment; they end with the block."""

    def __init__(self) -> None:
        self._servers: dict[str, tuple[socket.socket, subprocess.Popen[bytes]]] = {}

    def popen(self, command: Sequence[str | Path], *, env: Mapping[str, str], **streams: Any) -> Any:
        """Start a reader of a program of the package, else do what `subprocess.Popen` does."""
        *python, _, program = command[:6]
        arguments = [str(one) for one in command[5:]]
        is_listing = len(arguments) == 4  # of formats: without a file, and once
        if Path(program).name not in _PROGRAMS or is_listing:
            return subprocess.Popen(command, env=env, **streams)
        key = json.dumps([str(program), sorted(env.items())])
        if key not in self._servers:
            own, others = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with others:
                words = [*python, __file__, program, str(others.fileno())]
                process = subprocess.Popen(words, env=env, stdin=subprocess.DEVNULL, pass_fds=[others.fileno()])
            self._servers[key] = own, process
        return ForkedReader(self._servers[key][0], arguments)

    def end(self) -> None:
        """End all."""
        for own, process in self._servers.values():
            own.close()
            process.wait()


@contextmanager
def forked_readers() -> Iterator[Any]:
    """Return a replacement for the module `subprocess` in `conflictdb.formats.confined`."""
    forks = ReaderForks()
    try:
        yield SimpleNamespace(Popen=forks.popen, PIPE=subprocess.PIPE, DEVNULL=subprocess.DEVNULL)
    finally:
        forks.end()


def _serve(program: str, server: socket.socket) -> None:
    """Load the library of a program, and fork readers."""
    sys.dont_write_bytecode = True
    if program.endswith("parquet_child.py"):
        sys.modules["numpy"] = None  # type: ignore[assignment]  # as the program has it
        import pyarrow.parquet  # noqa: F401
    else:
        runpy.run_path(program)["main"](io.BytesIO(), _MOST_BYTES, [])
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        request, streams, _, _ = socket.recv_fds(server, _MOST_BYTES, 3)
        if not request:
            return
        if os.fork() == 0:
            server.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            _fork(json.loads(request), streams)
        for one in streams:
            os.close(one)


def _fork(arguments: list[str], streams: list[int]) -> NoReturn:
    """Fork one reader, and write its number and its exit code to the last stream."""
    *outputs, status = streams
    if pid := os.fork():
        for one in outputs:
            os.close(one)
        os.write(status, b"%d\n" % pid)
        _, code = os.waitpid(pid, 0)
        with suppress(BrokenPipeError):
            os.write(status, b"%d\n" % os.waitstatus_to_exitcode(code))
        os._exit(0)
    os.close(status)
    for number, one in enumerate(outputs, 1):
        os.dup2(one, number)
        os.close(one)
    child = Path(arguments[0]).with_name("confined_child.py")
    sys.argv = [str(child), *arguments]
    code = 0
    try:
        runpy.run_path(str(child), run_name="__main__")
        if not sys.stdout.closed:
            sys.stdout.flush()
    except SystemExit as ended:
        code = int(ended.code or 0)
    os._exit(code)


if __name__ == "__main__":
    _serve(sys.argv[1], socket.socket(fileno=int(sys.argv[2])))
