"""The kernel of the page, conflictdb/map/page/kernel.wasm, is that of these sources."""

import shutil
import subprocess
from pathlib import Path

import pytest

import build_wasm
from conflictdb.kernel import build
from conflictdb.kernel.header import constant

AGAIN = "the kernel has changed: ./run wasm"
PRINT_EXPORTS = """
const module = new WebAssembly.Module(require("fs").readFileSync(process.argv[1]));
const names = (some) => some.map(({ module, name }) => name).join();
console.log(names(WebAssembly.Module.imports(module)) + ";" + names(WebAssembly.Module.exports(module)));
"""


def test_kernel_of_the_page_is_of_these_sources() -> None:
    assert build_wasm.fingerprint().encode() in build_wasm.OUTPUT.read_bytes(), AGAIN


def test_page_has_the_structures_of_this_kernel() -> None:
    page = (build_wasm.OUTPUT.parent / "kernel.js").read_text()
    assert f"const ABI = {constant('KERNEL_ABI')};" in page, "structures of the kernel have changed: adapt kernel.js"


@pytest.mark.skipif(not shutil.which("node"), reason="did not run: no node here")
def test_kernel_of_the_page_has_what_the_page_calls() -> None:
    """It may ask the page for the time of day, and for nothing else."""
    command = [str(shutil.which("node")), "-e", PRINT_EXPORTS, str(build_wasm.OUTPUT)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    imports, exports = said.split(";")
    assert imports == "clock_time_get"
    assert set(exports.split(",")) == {"memory", "_initialize", *build_wasm.EXPORTS}


@pytest.mark.slow
def test_kernel_of_the_page_is_built_to_the_same_bytes(tmp_path: Path) -> None:
    with build.zig() as compiler:
        build_wasm.compile_wasm(compiler, tmp_path / "kernel.wasm")
    assert (tmp_path / "kernel.wasm").read_bytes() == build_wasm.OUTPUT.read_bytes(), AGAIN
