"""Build the kernel: one shared library of all C files here, beside them.

    python conflictdb/kernel/build.py

By the C compiler `cc`, else by that of the PyPI package `ziglang`, in an environment of its own that is removed after.
Knows nothing of the package, so that it runs before anything is installed. Prints nothing where the library is already
that of the sources.
"""

import hashlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
# No step may be fused or reordered: infinities, NaN and the last digit carry the proofs.
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=default", "-Wall", "-Wextra", "-Werror")
SHARED = ("-shared", "-fPIC", "-lm")
LIBRARY = "libkernel.so"


def sources() -> list[Path]:
    """Return the C files and headers."""
    return sorted(path for path in HERE.iterdir() if path.suffix in (".c", ".h"))


def fingerprint() -> str:
    """Return what tells these sources, and how they are compiled, from others."""
    digest = hashlib.sha256(" ".join((*FLAGS, *SHARED)).encode())
    for path in sources():
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def library() -> Path:
    """Return where the library is, or would be."""
    return HERE / LIBRARY


def is_current() -> bool:
    """Return whether the library is there, and that of the sources, which left their fingerprint in it."""
    return library().exists() and fingerprint().encode() in library().read_bytes()


def compile_with(compiler: list[str], output: Path, *flags: str) -> None:
    """Compile all sources; raises subprocess.CalledProcessError with the compiler's words."""
    files = [str(path) for path in sources() if path.suffix == ".c"]
    define = f'-DKERNEL_FINGERPRINT="{fingerprint()}"'
    subprocess.run([*compiler, *FLAGS, *flags, define, "-o", str(output), *files, *SHARED], check=True)


def build() -> Path:
    """Build the library if it is not current, and return it; it takes the place of an older one at once, complete."""
    if is_current():
        return library()
    with tempfile.TemporaryDirectory(dir=HERE, prefix=".build-") as directory:
        made = Path(directory) / LIBRARY
        if shutil.which("cc"):
            compile_with(["cc"], made)
        else:
            compile_with(_zig(Path(directory)), made, "-mcpu=baseline")
        made.replace(library())
    return library()


def _zig(directory: Path) -> list[str]:
    """Return the command of zig's C compiler, fetched into a new environment in a directory."""
    sys.stderr.write("kernel: no C compiler (cc) here, fetching one from PyPI (100 MB)\n")
    environment, pins = directory / "zig", str(HERE / "requirements.txt")
    python = str(environment / "bin" / "python")
    if shutil.which("uv"):
        subprocess.run(["uv", "venv", "-q", "--python", sys.executable, str(environment)], check=True)
        subprocess.run(["uv", "pip", "install", "-q", "--python", python, "--require-hashes", "-r", pins], check=True)
    else:
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
        quiet = ("-q", "--no-compile", "--disable-pip-version-check")
        subprocess.run([python, "-m", "pip", "install", *quiet, "--require-hashes", "-r", pins], check=True)
    caches = (f"ZIG_{which}_CACHE_DIR={directory / 'cache'}" for which in ("GLOBAL", "LOCAL"))
    return ["env", *caches, python, "-m", "ziglang", "cc"]


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
