"""The kernel's sources in a library that exports internal functions, too, for tests of single steps."""

import ctypes
import os
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from conflictdb.kernel import build


@cache
def internals() -> Any:
    """Return the library: all files of the kernel, and floors.c. Its functions take pointers of the usual one."""
    with TemporaryDirectory() as directory:
        made = Path(directory) / "internals.so"
        files = [Path(__file__).with_name("floors.c"), *(path for path in build.sources() if path.suffix == ".c")]
        command = ["cc", *build.FLAGS, "-o", made, *files, *build.SHARED]
        # Without the library of sanitizers, if this program runs with it: it would slow the compiler down.
        subprocess.run(command, env={**os.environ, "LD_PRELOAD": ""}, check=True, timeout=600)
        return ctypes.CDLL(str(made))
