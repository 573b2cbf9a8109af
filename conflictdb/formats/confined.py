"""Run readers of untrusted files in a confined process: see `confined_child`."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Timer
from typing import IO, Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import TOO_LARGE

_HERE: Final = Path(__file__).parent
# Bytes of answer per byte of file limit: geometries have two digits per byte, numbers up to 26 characters.
_ANSWER_BYTES: Final = 4
_LEAST_ANSWER: Final = 1 << 20
# Bytes of an error message that are read; honest messages are shorter.
_MOST_MESSAGE: Final = 1 << 16
# For all programs: extra threads would take address space.
_SETTINGS: Final = {"LC_ALL": "C.UTF-8", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass(frozen=True, slots=True)
class ConfinedProgram:
    """A reader of untrusted files, and its limits.

    file : its name, beside this module (`confined_child` describes its contents)
    cannot_read : beginning of the message if it refuses a file
    seconds_per_mb, memory_per_mb : processor seconds, and bytes, per MB of file limit
    settings : its environment
    least_seconds, least_memory : limits of small files, which Python and a library need to start
    """

    file: str
    cannot_read: str
    seconds_per_mb: float
    memory_per_mb: int
    settings: Mapping[str, str] = field(default_factory=dict)
    least_seconds: float = 30.0
    least_memory: int = 2 << 30

    @contextmanager
    def running(self, arguments: Sequence[str], max_file_mb: float) -> "Iterator[Running]":
        """Start the program with arguments, and kill it at the end of the block."""
        seconds = max(self.least_seconds, self.seconds_per_mb * max_file_mb)
        memory = max(self.least_memory, int(self.memory_per_mb * max_file_mb))
        limits = [str(int(most)) for most in (max_file_mb * 1e6, memory, seconds)]
        child = subprocess.Popen(
            # -P: do not import from the current directory
            [sys.executable, "-P", "-W", "ignore", _HERE / "confined_child.py", _HERE / self.file, *limits, *arguments],
            # Nothing of the caller's environment: no credentials, no library settings.
            env={"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **_SETTINGS, **self.settings},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        with child:
            try:
                yield Running(self, child, max_file_mb, 2.0 * seconds)
            finally:
                child.kill()


@dataclass(frozen=True, slots=True)
class Running:
    """A running program.

    max_file_mb : limit on the contents of the file
    longest_s : time limit
    """

    program: ConfinedProgram
    child: "subprocess.Popen[bytes]"
    max_file_mb: float
    longest_s: float

    @property
    def stream(self) -> IO[bytes]:
        """The program's output stream."""
        assert self.child.stdout is not None  # noqa: S101
        return self.child.stdout

    def answer(self) -> bytes:
        """Return the complete output; raises InvalidInput if the program refuses the file or exceeds a limit."""
        most = _LEAST_ANSWER + int(_ANSWER_BYTES * self.max_file_mb * 1e6)
        clock = Timer(self.longest_s, self.child.kill)
        clock.start()
        try:
            written = self.stream.read(most)
            if len(written) == most:
                raise self._refusal(b"")
            self.check_end()
        finally:
            clock.cancel()
        return written

    def check_end(self) -> None:
        """Wait for the program to end; raises InvalidInput if it refused the file or exceeded a limit."""
        if self.child.wait() != 0:
            raise self.refusal()

    def refusal(self) -> InvalidInput:
        """Return the reason for which the program ended early."""
        assert self.child.stderr is not None  # noqa: S101
        return self._refusal(self.child.stderr.read(_MOST_MESSAGE))

    def _refusal(self, message: bytes) -> InvalidInput:
        """Return the reason from the program's message; without one, a limit ended it, or it crashed."""
        try:
            wrong = json.loads((message.splitlines() or [b"{}"])[-1])
        except ValueError:
            wrong = {}
        if isinstance(wrong, dict) and "refused" in wrong:
            rule = " ".join(str(wrong["refused"]).split())
            return InvalidInput("file", "", f"{self.program.cannot_read}: {rule:.500}")
        rule = f"holds more than {self.max_file_mb:g} MB, or takes too much to read"
        return InvalidInput("file", "", f"{rule}{TOO_LARGE}")
