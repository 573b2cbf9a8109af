"""Build the wheels of a release: one for each platform, the kernel cross-compiled, into a directory.

    ./run wheels [DIRECTORY]     (default: dist)

Compiles by the pinned compiler of conflictdb/kernel/requirements.txt, which is fetched from PyPI (100 MB) and removed
after.
"""

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from conflictdb.kernel import build

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Target:
    """A platform, as the compiler, wheels and `uname -sm` call it."""

    compiler: str
    wheel: str
    uname: str


# The oldest C libraries and systems for which NumPy has wheels as well.
TARGETS = (
    Target("x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", "Linux x86_64"),
    Target("aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64", "Linux aarch64"),
    Target("x86_64-linux-musl", "musllinux_1_2_x86_64", "Linux x86_64"),
    Target("aarch64-linux-musl", "musllinux_1_2_aarch64", "Linux aarch64"),
    Target("x86_64-macos.11.0", "macosx_11_0_x86_64", "Darwin x86_64"),
    Target("aarch64-macos.11.0", "macosx_11_0_arm64", "Darwin arm64"),
)


def build_wheel(
    compiler: list[str], target: Target, directory: Path, tree: Path = ROOT, environ: Mapping[str, str] = os.environ
) -> None:
    """Build the wheel of a tree for a target into a directory, by zig's C compiler."""
    with tempfile.TemporaryDirectory() as made_in:
        library = Path(made_in) / build.LIBRARY
        of_tree = kernel_build_of(tree)
        flags = ["-target", target.compiler, "-mcpu=baseline", "-s"]
        if target.uname.startswith("Darwin"):  # else the library is named by the directory that it is made in
            flags.append(f"-Wl,-install_name,@rpath/{build.LIBRARY}")
        of_tree.compile_with(compiler, library, *flags, platform=target.uname)
        # As hatch_build.py takes them.
        given = {"CONFLICTDB_WHEEL_LIBRARY": str(library), "CONFLICTDB_WHEEL_PLATFORM": target.wheel}
        build_archive("wheel", directory, tree, {**environ, **given})


def build_archive(kind: str, directory: Path, tree: Path, environ: Mapping[str, str]) -> None:
    """Build the `wheel` or the `sdist` of a tree into a directory."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(directory)]
    subprocess.run(command, check=True, cwd=tree, env=environ)


def kernel_build_of(tree: Path) -> ModuleType:
    """Return conflictdb/kernel/build.py of a tree; another one is installed."""
    spec = importlib.util.spec_from_file_location("build_of_tree", tree / "conflictdb/kernel/build.py")
    if spec is None or spec.loader is None:
        raise ImportError(f"{tree}: no conflictdb/kernel/build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main() -> int:
    """Build all wheels into the directory that the command line names."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else "dist").resolve()
    with build.zig() as compiler:
        for target in TARGETS:
            build_wheel(compiler, target, directory)
    return 0


if __name__ == "__main__":
    sys.exit(main())
