"""Build the kernel: one shared library of all C files here, beside them.

    python conflictdb/kernel/build.py
    python conflictdb/kernel/build.py PREFIX     # the kernel alone, for C: PREFIX/lib, PREFIX/include/conflictdb

Uses the C compiler `cc`. Without one, or if it lacks the C library's headers, fetches the compiler of the PyPI package
`ziglang` into a temporary environment. Imports nothing of the package, so that it runs before anything is installed.
Does nothing if the library is up to date. Two builds by one compiler are equal to the bit, wherever the sources are.
"""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).resolve().parent
# No floating-point operation may be fused or reordered: the proofs rely on infinities, NaN and the last digit.
FLAGS = (
    "-std=c11",
    "-O2",
    "-ffp-contract=off",
    "-Wall",
    "-Wextra",
    "-Werror",
    f"-I{HERE}",
    f"-ffile-prefix-map={HERE}=.",
)
# Link-time optimization, as compilers spell it: a kernel call takes 10 to 20 % less, and no answer changes.
LINK_TIME = ("-flto=auto", "-flto")
# Only functions marked KERNEL_API are exported (kernel.h).
EXPORTS = "-fvisibility=hidden"
SHARED = ("-shared", "-fPIC", "-lm")
LIBRARY = "libkernel.so"
# The oldest processors of a machine's family, by `uname -m`; for other machines the default of `cc`.
BASELINE = {"x86_64": "-march=x86-64", "aarch64": "-march=armv8-a", "arm64": "-march=armv8-a"}
# The kernel alone, as C programs link it, and its description for pkg-config.
IS_MAC = sys.platform == "darwin"
ALONE = "libconflictdb-kernel"
PKG_CONFIG = """\
prefix={prefix}
Name: conflictdb-kernel
Description: Contacts, distances and candidate pairs of moving convex polygons, proven
Version: {abi}
Cflags: -I${{prefix}}/include
Libs: -L${{prefix}}/lib -lconflictdb-kernel -lm
"""


def sources() -> list[Path]:
    """Return the C files and headers: those beside this file, then those of its folders."""
    folders = (HERE, *sorted(path for path in HERE.iterdir() if path.is_dir() and path.name.isidentifier()))
    return [path for folder in folders for path in sorted(folder.glob("*.[ch]"))]


def source(name: str) -> Path:
    """Return the C file of a name."""
    [found] = (path for path in sources() if path.name == f"{name}.c")
    return found


def here() -> str:
    """Return the system and the machine, as `uname -sm` prints them."""
    system = os.uname()
    return f"{system.sysname} {system.machine}"


def fingerprint(platform: str | None = None) -> str:
    """Return a digest of the platform (default: `here`), the sources, and this file. ./run computes the same digest."""
    digest = hashlib.sha256(f"{platform or here()}\n".encode())
    for path in (*sources(), HERE / "build.py"):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def library() -> Path:
    """Return the path of the library, built or not."""
    return HERE / LIBRARY


def is_current() -> bool:
    """Return whether the library exists and contains the fingerprint of the sources."""
    return library().exists() and fingerprint().encode() in library().read_bytes()


def compile_with(compiler: list[str], output: Path, *flags: str, platform: str | None = None) -> None:
    """Compile all sources for a platform, with link-time optimization if the compiler has it there.

    Raises subprocess.CalledProcessError after the compiler's messages.
    """
    flags = (*flags, *[flag for flag in LINK_TIME if _links([*compiler, *flags, flag])][:1])
    files = [str(path) for path in sources() if path.suffix == ".c"]
    define = f'-DKERNEL_FINGERPRINT="{fingerprint(platform)}"'
    subprocess.run([*compiler, *FLAGS, EXPORTS, *flags, define, "-o", str(output), *files, *SHARED], check=True)


def build() -> Path:
    """Build the library unless it is current, replacing an older one atomically. Returns its path."""
    if is_current():
        return library()
    with tempfile.TemporaryDirectory(dir=HERE, prefix=".build-") as directory:
        made = Path(directory) / LIBRARY
        named = f"-Wl,-install_name,@rpath/{name_alone()}" if IS_MAC else f"-Wl,-soname,{name_alone()}"
        if shutil.which("cc") and _links(["cc"]):
            compile_with(["cc"], made, *filter(None, [BASELINE.get(os.uname().machine)]), named)
        else:
            sys.stderr.write("kernel: no C compiler (cc) that works here, fetching one from PyPI (100 MB)\n")
            with zig() as compiler:
                compile_with(compiler, made, "-mcpu=baseline", named)
        made.replace(library())
    return library()


def abi() -> str:
    """Return the number of the interface, KERNEL_ABI."""
    [found] = re.findall(r"^#define KERNEL_ABI (\d+)", (HERE / "kernel.h").read_text(), re.MULTILINE)
    return str(found)


def name_alone() -> str:
    """Return the file name of the library alone; a program that was linked with another ABI does not start with it."""
    return f"{ALONE}.{abi()}.dylib" if IS_MAC else f"{ALONE}.so.{abi()}"


def install(prefix: Path) -> None:
    """Install the kernel alone below a directory: library, header, and their description for pkg-config."""
    built = build()
    for folder in ("lib/pkgconfig", "include/conflictdb"):
        (prefix / folder).mkdir(parents=True, exist_ok=True)
    installed, link = prefix / "lib" / name_alone(), prefix / "lib" / f"{ALONE}{'.dylib' if IS_MAC else '.so'}"
    for path in (installed, link):
        path.unlink(missing_ok=True)  # programs that run with an earlier library keep it: writing into it ends them
    shutil.copyfile(built, installed)
    link.symlink_to(name_alone())
    shutil.copyfile(HERE / "kernel.h", prefix / "include/conflictdb" / "kernel.h")
    (prefix / "lib/pkgconfig/conflictdb-kernel.pc").write_text(PKG_CONFIG.format(prefix=prefix, abi=abi()))


def _links(command: list[str]) -> bool:
    """Return whether a compiler with these flags links a library against the C library and its headers."""
    with tempfile.TemporaryDirectory() as directory:
        program = Path(directory) / "try.c"
        program.write_text(
            "#include <math.h>\n#include <stdlib.h>\ndouble root(void) { return sqrt((double)rand()); }\n"
        )
        made = str(program.with_suffix(".so"))
        done = subprocess.run([*command, "-o", made, str(program), *SHARED], capture_output=True, check=False)
        return done.returncode == 0


@contextmanager
def zig() -> Iterator[list[str]]:
    """Yield the command of zig's C compiler, fetched into a temporary environment."""
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
    """Build, or install the kernel alone; print in one line what to do if that fails."""
    if len(sys.argv) > 2 or sys.argv[1:2] in (["-h"], ["--help"]):
        sys.stderr.write("kernel: give nothing, or the directory to install the kernel alone into\n")
        return 2
    try:
        if sys.argv[1:]:
            install(Path(sys.argv[1]).resolve())
        else:
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
