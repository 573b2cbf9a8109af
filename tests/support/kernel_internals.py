"""The kernel's sources in a library that exports internal functions, too, for tests of single steps."""

import ctypes
import fcntl
import os
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from databases import shared_directory

from conflictdb.kernel import build

SANITIZERS = ("-DKERNEL_DEBUG", "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
_USUAL = [flag for flag in build.FLAGS if not flag.startswith("-O")]


def _built(name: str, *given: object) -> Path:
    """Return a library of all files of the kernel. The first worker of a run compiles it, the others wait for it.

    Raises subprocess.CalledProcessError with the compiler's messages.
    """
    folder = shared_directory() / "kernel"
    folder.mkdir(parents=True, exist_ok=True)
    made, part = folder / f"{name}.so", folder / f"{name}.part"
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            files = [path for path in build.sources() if path.suffix == ".c"]
            command = ["cc", *_USUAL, *given, "-o", part, *files, *build.SHARED]
            # Without the library of sanitizers, if this program runs with it: it would slow the compiler down.
            environment = {**os.environ, "LD_PRELOAD": ""}
            subprocess.run(command, env=environment, check=True, timeout=600, capture_output=True, text=True)
            part.rename(made)
    return made


@cache
def internals() -> Any:
    """Return the library with floors.c. Its functions take pointers of the usual one."""
    return ctypes.CDLL(str(_built("internals", "-O1", Path(__file__).with_name("floors.c"))))


def sanitized_program(program: Path, driver: Path, *flags: str) -> Path:
    """Link a program of C with the kernel, both under sanitizers; skip the test if the compiler here has none."""
    try:
        library = build.library()
        if b"__asan_init" not in library.read_bytes():
            define = f'-DKERNEL_FINGERPRINT="{build.fingerprint()}"'
            library = _built("sanitized", *SANITIZERS, define)
        subprocess.run(
            ["cc", *_USUAL, *SANITIZERS, *flags, "-o", program, driver, library, f"-Wl,-rpath,{library.parent}", "-lm"],
            env={**os.environ, "LD_PRELOAD": ""},
            capture_output=True,
            text=True,
            timeout=600,
            check=True,
        )
    except subprocess.CalledProcessError as error:
        if "asan" not in error.stderr and "ubsan" not in error.stderr:
            pytest.fail(error.stderr)
        pytest.skip("the compiler here has no sanitizers")
    return program
