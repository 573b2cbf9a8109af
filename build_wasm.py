"""Compile the kernel for the page of `conflictdb map`: conflictdb/map/page/kernel.wasm, which is committed.

    ./run wasm

Compiles by the pinned compiler of conflictdb/kernel/requirements.txt, which is fetched from PyPI (100 MB) and removed
after. The same sources give the same bytes, so that a test can compare them.
"""

import subprocess
import sys
from pathlib import Path
from typing import Final

from conflictdb.kernel import build

OUTPUT: Final = Path(__file__).resolve().parent / "conflictdb" / "map" / "page" / "kernel.wasm"
PLATFORM: Final = "wasm32"
# The functions that the page calls.
EXPORTS: Final = (
    "kernel_fingerprint", "kernel_scene_make", "kernel_scene_free", "kernel_contacts", "kernel_contacts_free",
    "kernel_differences", "kernel_hulls", "kernel_apart", "malloc", "free",
)  # fmt: skip


def compile_wasm(compiler: list[str], output: Path) -> None:
    """Compile the kernel as WebAssembly, by zig's C compiler."""
    files = [path.relative_to(build.HERE) for path in build.sources() if path.suffix == ".c"]
    exports = [f"-Wl,--export={name}" for name in EXPORTS]
    flags = ["-target", "wasm32-wasi", "-mexec-model=reactor", "-s", "-Wl,--gc-sections", *exports]
    define = f'-DKERNEL_FINGERPRINT="{build.fingerprint(PLATFORM)}"'
    # In the kernel's folder: no path of this machine is in the output.
    options = [flag for flag in build.FLAGS if not flag.startswith("-I")]
    command = [*compiler, *options, "-I.", build.EXPORTS, define, *flags, "-o", str(output), *map(str, files)]
    subprocess.run(command, check=True, cwd=build.HERE)


def main() -> int:
    """Compile."""
    with build.zig() as compiler:
        compile_wasm(compiler, OUTPUT)
    OUTPUT.chmod(0o644)
    return 0


if __name__ == "__main__":
    sys.exit(main())
