"""Files of others, read by a program of its own that can do little else: see `confined_child`."""

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
from conflictdb.io.contents import TOO_LARGE

_HERE: Final = Path(__file__).parent
# What Python and a library need to be there at all.
_LEAST_SECONDS: Final = 30.0
_LEAST_MEMORY: Final = 2 << 30
# Bytes of an answer for each byte that a file may hold: a geometry is two digits a byte, a number up to 26 characters.
_ANSWER_BYTES: Final = 4
_LEAST_ANSWER: Final = 1 << 20
# Bytes of what a program says of a mistake that are read; an honest one says less.
_MOST_SAID: Final = 1 << 16
# Of all programs; threads of their own take address space each.
_SETTINGS: Final = {"LC_ALL": "C.UTF-8", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass(frozen=True, slots=True)
class Program:
    """What reads files of others, and what it may use.

    file : its name, beside this module (`confined_child` says what is in it)
    cannot_read : begins what is said where it refuses a file
    seconds_per_mb, memory_per_mb : processor time, and bytes, for each MB that the file may hold
    settings : its environment
    """

    file: str
    cannot_read: str
    seconds_per_mb: float
    memory_per_mb: int
    settings: Mapping[str, str] = field(default_factory=dict)

    @contextmanager
    def running(self, arguments: Sequence[str], max_file_mb: float) -> "Iterator[Running]":
        """Start it with arguments, and end it in the end, whatever it does then."""
        seconds = max(_LEAST_SECONDS, self.seconds_per_mb * max_file_mb)
        memory = max(_LEAST_MEMORY, int(self.memory_per_mb * max_file_mb))
        limits = [str(int(most)) for most in (max_file_mb * 1e6, memory, seconds)]
        child = subprocess.Popen(
            # -P: what lies in the current directory is not imported
            [sys.executable, "-P", "-W", "ignore", _HERE / "confined_child.py", _HERE / self.file, *limits, *arguments],
            # Nothing of the caller's: no credentials, and no settings of the library's.
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
    """A program that reads a file.

    max_file_mb : it may hold
    longest_s : it may take
    """

    program: Program
    child: "subprocess.Popen[bytes]"
    max_file_mb: float
    longest_s: float

    @property
    def stream(self) -> IO[bytes]:
        """What it writes, as it does."""
        assert self.child.stdout is not None  # noqa: S101
        return self.child.stdout

    def answer(self) -> bytes:
        """Return all that it writes; raises InvalidInput where it refuses the file, or takes too much or too long."""
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
        """Wait for its end when all is read; raises InvalidInput where it refuses the file, or took too much."""
        if self.child.wait() != 0:
            raise self.refusal()

    def refusal(self) -> InvalidInput:
        """Return why it ended before all was written."""
        assert self.child.stderr is not None  # noqa: S101
        return self._refusal(self.child.stderr.read(_MOST_SAID))

    def _refusal(self, said: bytes) -> InvalidInput:
        """Return why a file cannot be read, from what the program said: nothing if a limit ended it, or it crashed."""
        try:
            wrong = json.loads((said.splitlines() or [b"{}"])[-1])
        except ValueError:
            wrong = {}
        if isinstance(wrong, dict) and "refused" in wrong:
            rule = " ".join(str(wrong["refused"]).split())
            return InvalidInput("file", "", f"{self.program.cannot_read}: {rule:.500}")
        rule = f"holds more than {self.max_file_mb:g} MB, or takes too much to read"
        return InvalidInput("file", "", f"{rule}{TOO_LARGE}")
