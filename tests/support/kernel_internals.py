"""The kernel's sources in a library that exports internal functions, too, for tests of single steps."""

import ctypes
import fcntl
import os
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

from conflictdb.kernel import build


@cache
def internals() -> Any:
    """Return the library: all files of the kernel, and floors.c. Its functions take pointers of the usual one.

    The first worker of a run compiles it, the other ones wait for it.
    """
    folder = Path(os.environ["XDG_STATE_HOME"], "kernel")
    folder.mkdir(parents=True, exist_ok=True)
    made, part = folder / "internals.so", folder / "part.so"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            files = [Path(__file__).with_name("floors.c"), *(path for path in build.sources() if path.suffix == ".c")]
            command = ["cc", *build.FLAGS, "-O1", "-o", part, *files, *build.SHARED]
            # Without the library of sanitizers, if this program runs with it: it would slow the compiler down.
            subprocess.run(command, env={**os.environ, "LD_PRELOAD": ""}, check=True, timeout=600)
            part.rename(made)
    return ctypes.CDLL(str(made))
