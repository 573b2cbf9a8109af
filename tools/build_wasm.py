"""Compile the kernel for the page of `conflictdb map`: conflictdb/map/page/kernel.wasm, which is committed.

    ./run wasm

Compiles by the pinned compiler of conflictdb/kernel/requirements.txt, which is fetched from PyPI (100 MB) and removed
after. The same sources give the same bytes, so that a test can compare them.
"""

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Final

from conflictdb.kernel import build

OUTPUT: Final = Path(__file__).resolve().parents[1] / "conflictdb" / "map" / "page" / "kernel.wasm"
# The functions that the page calls.
EXPORTS: Final = (
    "kernel_abi", "kernel_fingerprint", "kernel_free", "kernel_scene_make", "kernel_scene_free", "kernel_contacts",
    "kernel_differences", "kernel_difference_parts", "kernel_height_overlaps", "kernel_level_shifts", "kernel_hulls",
    "kernel_apart", "kernel_distances", "kernel_positions", "kernel_references", "kernel_headings", "kernel_degrees",
    "kernel_mitred", "kernel_may_meet", "kernel_box_pairs", "kernel_uses", "kernel_use_times", "kernel_merge",
    "kernel_approaches", "kernel_deepest", "kernel_whole_depths",
    "malloc", "free",
)  # fmt: skip


# No floating-point operation is fused or reordered, as in the library.
FLAGS: Final = ("-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-target", "wasm32-wasi")
LINKED: Final = ("-mexec-model=reactor", "-s", "-Wl,--gc-sections", *(f"-Wl,--export={name}" for name in EXPORTS))


def fingerprint() -> str:
    """Return a digest of the sources and of this file, which kernel.wasm contains."""
    digest = hashlib.sha256()
    for path in (*build.sources(), Path(__file__)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def compile_wasm(compiler: list[str], output: Path) -> None:
    """Compile the kernel as WebAssembly, by zig's C compiler."""
    files = [str(path.relative_to(build.HERE)) for path in build.sources() if path.suffix == ".c"]
    # In the kernel's folder: no path of this machine is in the output.
    define = f'-DKERNEL_FINGERPRINT="{fingerprint()}"'
    command = [*compiler, *FLAGS, "-I.", define, *LINKED, "-o", str(output), *files]
    subprocess.run(command, check=True, cwd=build.HERE)


def main() -> int:
    """Compile."""
    with build.zig() as compiler:
        compile_wasm(compiler, OUTPUT)
    OUTPUT.chmod(0o644)
    return 0


if __name__ == "__main__":
    sys.exit(main())
