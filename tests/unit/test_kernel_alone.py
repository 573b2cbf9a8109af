"""The kernel without Python: installed below a directory, and linked by the program of examples/kernel."""

import math
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from patience import WAIT_S

from conflictdb.kernel import build

EXAMPLE = Path(__file__).parents[2] / "examples/kernel/two_ships.c"


def test_a_program_in_c_links_the_kernel_alone(tmp_path: Path) -> None:
    """By the header and what pkg-config says; its answer is that of the closed form, within its error bound."""
    prefix, program = tmp_path / "kernel", tmp_path / "two_ships"
    script = [sys.executable, "-I", str(build.HERE / "build.py")]
    subprocess.run([*script, str(prefix)], check=True, timeout=WAIT_S)
    with (prefix / "lib" / build.name_alone()).open("rb") as used:
        subprocess.run([*script, str(prefix)], check=True, timeout=WAIT_S)  # again, over the first
        assert os.fstat(used.fileno()).st_nlink == 0, "a program that runs with the first keeps it"
    said = (prefix / "lib/pkgconfig/conflictdb-kernel.pc").read_text()
    flags = {name: value.replace("${prefix}", str(prefix)).split() for name, value in re.findall(r"(\w+): (.*)", said)}
    strict = ["-std=c11", "-pedantic", "-Wall", "-Wextra", "-Werror"]
    command = ["cc", *strict, *flags["Cflags"], str(EXAMPLE), *flags["Libs"], "-o", str(program)]
    subprocess.run(command, check=True, timeout=WAIT_S)
    printed = subprocess.run(
        [program],
        env={"LD_LIBRARY_PATH": str(prefix / "lib"), "DYLD_LIBRARY_PATH": str(prefix / "lib")},
        capture_output=True,
        text=True,
        check=True,
        timeout=WAIT_S,
    ).stdout
    found = re.fullmatch(r"conflict from (\S+) s to (\S+) s, each to (\S+) s\n", printed)
    assert found is not None, printed
    way_m = 6371008.771415 * math.radians(0.1)
    closing_mps = 2.0 * way_m / 3600.0
    for k, apart_m in ((1, 200.0), (2, -100.0)):  # ahead of both; astern of both
        assert abs(float(found[k]) - (way_m - apart_m) / closing_mps) <= 0.0005 + float(found[3])  # printed to 1 ms


def test_its_directory_is_the_only_argument(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-I", str(build.HERE / "build.py"), "--help"],
        capture_output=True,
        text=True,
        check=False,
        timeout=WAIT_S,
    )
    assert done.returncode == 2
    assert "the directory to install the kernel alone into" in done.stderr


def test_the_build_is_read_where_the_system_has_no_uname(monkeypatch: pytest.MonkeyPatch) -> None:
    """It asks when it builds, not when it is imported."""
    monkeypatch.delattr(os, "uname")
    assert runpy.run_path(str(build.HERE / "build.py"))["LIBRARY"] == build.LIBRARY
