"""Wheels: each for one platform, and complete. A wheel is installed into an empty environment and solves a scene."""

import re
import shutil
import struct
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from patience import WAIT_S

from build_wheels import TARGETS

ROOT = Path(__file__).parents[2]
LIBRARY = "conflictdb/kernel/libkernel.so"
# Files of the page of `conflictdb map`.
PAGE = ("conflictdb/map/page/index.html", "conflictdb/map/vendor/maplibre-gl.mjs", "conflictdb/map/vendor/vendor.json")
# Licences of third-party code, as pyproject.toml declares them.
LICENCES = (
    *(f"conflictdb/map/vendor/{name}.LICENSE.txt" for name in ("maplibre-gl", "world-atlas")),
    "docs/site/iframe-worker.LICENSE.txt",
)
# As ELF and Mach-O number them.
MACHINES = {"x86_64": (62, 0x01000007), "aarch64": (183, 0x0100000C), "arm64": (183, 0x0100000C)}
SCENE = """
import conflictdb, datetime, shapely
from pathlib import Path
assert Path(conflictdb.__file__).is_relative_to(Path({venv!r})), conflictdb.__file__
from conflictdb.model.plans import Area, Track, rectangle_outline_m
import numpy as np
zone = Area("zone", shapely.box(0, 0, 1, 1))
track = Track("T", np.array([(-1.0, 0.5), (2.0, 0.5)]), np.array([0, 3_600_000_000]), rectangle_outline_m(10, 10, 5, 5))
found = conflictdb.solve([track], [zone])
print(len(found), found[0].verdict.name)
"""

# Rooms that the core does not import, and libraries of extras, which only they and other formats use.
OUTER = {"map", "spark", "plot", "embedded", "exchange"}
EXTRAS = (
    "matplotlib", "fpdf", "starlette", "uvicorn", "pyspark", "sedona", "pandas", "geopandas", "pyarrow", "pyogrio",
    "pyproj", "geoalchemy2", "prometheus_client",
)  # fmt: skip
CORE = """
import sys
for name in {extras!r}:
    sys.modules[name] = None
import conflictdb
from conflictdb.formats.reading import read
assert conflictdb.__file__.startswith({venv!r}), conflictdb.__file__
demo = read(conflictdb.__path__[0] + "/scenes/strait.geojson")
found = conflictdb.solve(demo.tracks, demo.areas, scene=demo.scene)
with conflictdb.connect({dsn!r}) as db:
    db.load_demo()
    scene = db.scene("strait")
    scene.detect()
    print(len(scene.conflicts()) == len(found) > 0, len(scene.probe(demo.tracks[0])) > 0)
    print(scene.resolve(keys=[demo.tracks[0].key], limit_s=1) is not None)
print(sorted({outer!r} & {{name.split(".")[1] for name in sys.modules if name.startswith("conflictdb.")}}))
"""


def built(tmp_path: Path, kind: str = "wheel", root: Path = ROOT, umask: int = 0o022) -> Path:
    """The wheel of this platform, or the sdist."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(tmp_path / "dist")]
    subprocess.run(command, cwd=root, check=True, capture_output=True, timeout=300, umask=umask)
    (found,) = (tmp_path / "dist").glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return found


def check(wheel: Path, platform: str) -> bytes:
    """Check the content and metadata of a wheel; return its library."""
    tag = f"py3-none-{platform}"
    assert wheel.name.endswith(f"-{tag}.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        assert len(names) == len(set(names))
        assert [name for name in names if name.endswith((".so", ".dylib", ".from", ".pyc"))] == [LIBRARY]
        for name in ("conflictdb/__init__.py", "conflictdb/py.typed", "conflictdb/kernel/kernel.h", *PAGE):
            assert name in names
        assert any(name.startswith("conflictdb/_sql/") for name in names)
        assert any(name.startswith("conflictdb/_migrations/versions/") for name in names)
        assert not any(name.startswith(("tests/", "docs/", "hatch_build")) for name in names)
        about = archive.read(next(name for name in names if name.endswith(".dist-info/WHEEL"))).decode()
        assert f"Tag: {tag}\n" in about
        assert "Root-Is-Purelib: false" in about
        licences = {name.partition(".dist-info/licenses/")[2] for name in names if ".dist-info/licenses/" in name}
        assert licences == {"LICENSE", *LICENCES}
        return archive.read(LIBRARY)


def solves_a_scene(wheel: Path, tmp_path: Path) -> Path:
    """In an environment with the wheel only, which is returned; its dependencies are on PYTHONPATH."""
    venv = tmp_path / "venv"
    # The pip of this environment, if it has one (uv makes none): unpacking another takes longer than all else here.
    has_pip = find_spec("pip") is not None
    bare = ["--without-pip"] if has_pip else []
    subprocess.run([sys.executable, "-m", "venv", *bare, str(venv)], check=True, timeout=WAIT_S)
    pip = [sys.executable, "-m", "pip", "--python", str(venv)] if has_pip else [str(venv / "bin/python"), "-m", "pip"]
    install = [*pip, "install", "-q", "--disable-pip-version-check", "--no-index", "--no-compile"]
    subprocess.run([*install, "--no-deps", str(wheel)], check=True, timeout=WAIT_S)
    environ = {"PATH": "/usr/bin:/bin", "PYTHONPATH": sysconfig.get_path("purelib")}
    done = subprocess.run(
        [str(venv / "bin/python"), "-c", SCENE.format(venv=str(venv))],
        env=environ,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("1 CONFLICT\n", "")
    version = [str(venv / "bin/conflictdb"), "--version"]
    printed = subprocess.run(
        version, env=environ, cwd=tmp_path, capture_output=True, text=True, timeout=WAIT_S, check=True
    )
    assert printed.stdout.split() == ["conflictdb", wheel.name.split("-")[1]]
    return venv


def runs_without_outer_rooms(venv: Path, dsn: str) -> None:
    """The core reads, solves, loads, detects, probes and resolves where nothing of the outer rooms is installed."""
    (package,) = venv.glob("lib/*/site-packages/conflictdb")
    for room in OUTER:
        shutil.rmtree(package / room)
    done = subprocess.run(
        [str(venv / "bin/python"), "-c", CORE.format(venv=str(venv), dsn=dsn, extras=EXTRAS, outer=OUTER)],
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": sysconfig.get_path("purelib")},
        cwd=venv,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("True True\nTrue\n[]\n", "")


def test_the_wheel_of_the_sdist_solves_a_scene(tmp_path: Path, dsn: str) -> None:
    """It is built without the source tree, by the compiler of this machine, and equals that of the tree to the bit.

    The kernel is compiled anew in another directory, and files of the archive have other times and permissions.
    """
    with tarfile.open(built(tmp_path, "sdist")) as archive:
        archive.extractall(tmp_path, filter="data")
    (root,) = tmp_path.glob("conflictdb-*")
    names = ["LICENSE", *LICENCES, "SECURITY.md", "run", "requirements.txt", "requirements-dev.txt"]
    for name in (*names, "examples/kernel/two_ships.c", "tests/acceptance", "sql"):
        assert (root / name).exists(), name
    assert [path for path in root.rglob("*") if path.suffix in (".so", ".pyc", ".dylib")] == []
    wheel = built(tmp_path, root=root)
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    assert check(wheel, platform) == (ROOT / LIBRARY).read_bytes()
    again = built(tmp_path / "of the tree", umask=0o077)
    assert files_of(wheel) == files_of(again)
    assert wheel.read_bytes() == again.read_bytes()
    assert str(root).encode() not in (root / LIBRARY).read_bytes()
    runs_without_outer_rooms(solves_a_scene(wheel, tmp_path), dsn)


def files_of(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.mark.slow
def test_all_wheels_of_a_release(tmp_path: Path) -> None:
    """Cross-compiled by the pinned compiler (100 MB from PyPI); that of this platform solves a scene."""
    subprocess.run([ROOT / "run", "wheels", str(tmp_path / "dist")], check=True, timeout=1800)
    wheels = sorted((tmp_path / "dist").iterdir())
    assert len(wheels) == len(TARGETS) == 6
    for target in TARGETS:
        (wheel,) = (one for one in wheels if one.name.endswith(f"-{target.wheel}.whl"))
        library = check(wheel, target.wheel)
        system, machine = target.uname.split()
        elf, mach = MACHINES[machine]
        if system == "Darwin":
            assert struct.unpack("<2I", library[:8]) == (0xFEEDFACF, mach)
        else:
            assert library[:4] == b"\x7fELF"
            assert struct.unpack("<H", library[18:20])[0] == elf
            # No newer version of the C library than the tag's, or musl, which has no versions.
            needs = {tuple(map(int, found)) for found in re.findall(rb"GLIBC_(\d+)\.(\d+)", library)}
            assert bool(needs) == target.wheel.startswith("manylinux")
            assert max(needs, default=(0, 0)) <= (2, 17)
    here = sysconfig.get_platform().replace("linux-", "manylinux_2_17_")
    (own,) = (one for one in wheels if one.name.endswith(f"-{here}.whl"))
    solves_a_scene(own, tmp_path)
