"""Build the kernel: one shared library of all C files here, beside them.

    python conflictdb/kernel/build.py

By the C compiler `cc`; where there is none, or it lacks the C library's headers, by that of the PyPI package `ziglang`,
in an environment of its own that is removed after. Knows nothing of the package, so that it runs before anything is
installed. Prints nothing where the library is already that of the sources.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).resolve().parent
# No step may be fused or reordered: infinities, NaN and the last digit carry the proofs.
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=default", "-Wall", "-Wextra", "-Werror")
SHARED = ("-shared", "-fPIC", "-lm")
LIBRARY = "libkernel.so"
# What the oldest processors of a machine's family understand, as `uname -m` calls it; other machines: what `cc` takes.
BASELINE = {"x86_64": "-march=x86-64", "aarch64": "-march=armv8-a", "arm64": "-march=armv8-a"}


def sources() -> list[Path]:
    """Return the C files and headers."""
    return sorted(path for path in HERE.iterdir() if path.suffix in (".c", ".h"))


def here() -> str:
    """Return the system and the machine, as `uname -sm` says them."""
    system = os.uname()
    return f"{system.sysname} {system.machine}"


def fingerprint(platform: str | None = None) -> str:
    """Return what tells these sources, how they are compiled and for which platform (`here`) from others.

    ./run has the same: the digest of the platform's line, the sources, and this file.
    """
    digest = hashlib.sha256(f"{platform or here()}\n".encode())
    for path in (*sources(), HERE / "build.py"):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def library() -> Path:
    """Return where the library is, or would be."""
    return HERE / LIBRARY


def is_current() -> bool:
    """Return whether the library is there, and that of the sources, which left their fingerprint in it."""
    return library().exists() and fingerprint().encode() in library().read_bytes()


def compile_with(compiler: list[str], output: Path, *flags: str, platform: str | None = None) -> None:
    """Compile all sources for a platform; raises subprocess.CalledProcessError after the compiler's words."""
    files = [str(path) for path in sources() if path.suffix == ".c"]
    define = f'-DKERNEL_FINGERPRINT="{fingerprint(platform)}"'
    subprocess.run([*compiler, *FLAGS, *flags, define, "-o", str(output), *files, *SHARED], check=True)


def build() -> Path:
    """Build the library if it is not current, and return it; it takes the place of an older one at once, complete."""
    if is_current():
        return library()
    with tempfile.TemporaryDirectory(dir=HERE, prefix=".build-") as directory:
        made = Path(directory) / LIBRARY
        if _has_compiler(Path(directory)):
            compile_with(["cc"], made, *filter(None, [BASELINE.get(os.uname().machine)]))
        else:
            sys.stderr.write("kernel: no C compiler (cc) that works here, fetching one from PyPI (100 MB)\n")
            with zig() as compiler:
                compile_with(compiler, made, "-mcpu=baseline")
        made.replace(library())
    return library()


def _has_compiler(directory: Path) -> bool:
    """Return whether `cc` is there and makes a library of what needs the C library and its headers."""
    if not shutil.which("cc"):
        return False
    program = directory / "try.c"
    program.write_text("#include <math.h>\n#include <stdlib.h>\ndouble root(void) { return sqrt((double)rand()); }\n")
    done = subprocess.run(["cc", "-o", directory / "try.so", program, *SHARED], capture_output=True, check=False)
    return done.returncode == 0


@contextmanager
def zig() -> Iterator[list[str]]:
    """Yield the command of zig's C compiler, fetched into a new environment that is removed after."""
    with tempfile.TemporaryDirectory(dir=HERE, prefix=".build-") as directory:
        environment, pins = Path(directory) / "zig", str(HERE / "requirements.txt")
        python = str(environment / "bin" / "python")
        if shutil.which("uv"):
            install = ["uv", "pip", "install", "-q", "--python", python]
            subprocess.run(["uv", "venv", "-q", "--python", sys.executable, str(environment)], check=True)
        else:
            install = [python, "-m", "pip", "install", "-q", "--no-compile", "--disable-pip-version-check"]
            subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
        subprocess.run([*install, "--require-hashes", "-r", pins], check=True)
        caches = (f"ZIG_{which}_CACHE_DIR={directory}/cache" for which in ("GLOBAL", "LOCAL"))
        yield ["env", *caches, python, "-m", "ziglang", "cc"]


def main() -> int:
    """Build, and say in one line what to do where that cannot be."""
    try:
        build()
    except subprocess.CalledProcessError as error:
        sys.stderr.write(
            f"kernel: cannot be built, for `{Path(error.cmd[0]).name}` failed (see above): install a C compiler (on "
            "Debian and Ubuntu: sudo apt-get install gcc libc6-dev), or let PyPI be reached; then run this again\n"
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
