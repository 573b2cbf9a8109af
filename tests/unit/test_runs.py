"""Large polygons in runs of sides: the same results as from all sides and vertices, in fewer steps."""

import ctypes
import subprocess
from pathlib import Path

import numpy as np
import pytest
from kernel_planes import Polygon, Vector
from patience import WAIT_S

from conflictdb.kernel import build
from conflictdb.kernel.library import shared

SUPPORT = Path(__file__).parents[1] / "support"
SOURCES = [build.source("polygon"), build.source("runs")]


@pytest.mark.parametrize("sanitizers", [(), ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")])
def test_runs_find_what_all_sides_and_vertices_show(tmp_path: Path, sanitizers: tuple[str, ...]) -> None:
    """For ellipses, slivers, sides of many vertices, hulls, dents, repeated vertices, lines and points, moved."""
    program = tmp_path / "compare_runs"
    command = ["cc", *build.FLAGS, "-g", *sanitizers, "-o", program, SUPPORT / "compare_runs.c"]
    compiled = subprocess.run([*command, *SOURCES, "-lm"], capture_output=True, text=True, timeout=WAIT_S, check=False)
    if compiled.returncode and sanitizers:
        pytest.skip("the compiler here has no sanitizers")
    assert compiled.returncode == 0, compiled.stderr
    done = subprocess.run([program, "60", "1"], capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert done.returncode == 0, done.stderr
    measures, same, worst = done.stdout.split()
    assert int(same) > 0.95 * int(measures) > 100
    assert float.fromhex(worst) < 2.0**-50


class Gap(ctypes.Structure):
    """Gap of polygon.h."""

    _fields_ = (("gap", ctypes.c_double), ("axis", Vector))


def test_steps_grow_as_the_number_of_vertices_does(tmp_path: Path) -> None:
    """Two circles, apart: blocks of the program that are run, which are the same on every machine."""
    counter, counted = tmp_path / "counter.c", tmp_path / "counted.so"
    counter.write_text(
        """#include "geometry/polygon.h"
           long long steps, sizes[] = {sizeof(Polygon), sizeof(Gap)};
           void __sanitizer_cov_trace_pc(void) { steps++; }"""
    )
    flags = [flag for flag in build.FLAGS if not flag.startswith("-O")]
    subprocess.run(
        ["cc", "-fPIC", f"-I{build.HERE}", "-c", counter, "-o", tmp_path / "counter.o"], check=True, timeout=WAIT_S
    )
    command = ["cc", *flags, "-O1", "-fPIC", "-shared", "-fsanitize-coverage=trace-pc", *SOURCES]
    subprocess.run([*command, tmp_path / "counter.o", "-o", counted, "-lm"], check=True, timeout=WAIT_S)
    library = ctypes.CDLL(str(counted))
    library.polygon_nearest.restype, library.polygon_separation.restype = ctypes.c_double, Gap
    sizes = (ctypes.c_longlong * 2).in_dll(library, "sizes")
    assert list(sizes) == [ctypes.sizeof(Polygon), ctypes.sizeof(Gap)]
    taken = []
    for count in (2000, 8000):
        angle = 2.0 * np.pi * np.arange(count) / count
        columns = [np.cos(angle), np.sin(angle), np.cos(angle) + 2.5, np.sin(angle), np.empty(count), np.empty(count)]
        x, y, x2, y2, bends, bends2 = (column.ctypes.data for column in columns)
        a, b = Polygon(x, y, count, False, bends), Polygon(x2, y2, count, False, bends2)
        steps = ctypes.c_longlong.in_dll(library, "steps")
        steps.value = 0
        library.runs_make(ctypes.byref(a), ctypes.byref(b))
        points = (ctypes.c_double * 4)()
        found = library.polygon_nearest(ctypes.byref(a), ctypes.byref(b), points, ctypes.byref(points, 16))
        assert found == pytest.approx(0.5, abs=1e-6)
        gap = library.polygon_separation(ctypes.byref(a), ctypes.byref(b))
        assert gap.gap == pytest.approx(0.5, abs=1e-6)
        taken.append(steps.value)
    assert taken[1] < 6 * taken[0]
    assert taken[1] < 100 * 8000
    # Along a direction a few runs are looked at, also if all vertices of a long side differ by rounding only.
    library.runs_least_along.restype = ctypes.c_double
    share = np.concatenate([np.linspace(0.0, 1.0, 4000), np.linspace(1.0, 0.0, 4000)])
    slab = np.array([[0.8, -0.6], [0.6, 0.8]]) @ np.stack([share, np.repeat([0.0, 0.1], 4000)])
    for xy, least in ((np.stack([np.cos(angle), np.sin(angle)]), -1.0), (np.ascontiguousarray(slab), 0.0)):
        a = Polygon(xy[0].ctypes.data, xy[1].ctypes.data, count, False, bends)
        library.runs_make(ctypes.byref(a), ctypes.byref(b))
        assert a.is_in_runs
        steps.value, vertex = 0, ctypes.c_int64()
        given = ctypes.c_double(-0.6), ctypes.c_double(0.8), ctypes.byref(a), ctypes.byref(vertex)
        along = -0.6 * xy[0] + 0.8 * xy[1]
        assert library.runs_least_along(*given) == pytest.approx(along.min(), abs=1e-14)
        assert along[vertex.value] == pytest.approx(least, abs=1e-6)
        assert steps.value < 3000  # all vertices take more than 8,000


def test_shares_are_counted_in_vertices() -> None:
    """Large pairs are taken one by one, small ones thousands at once; none is left out."""
    vertices = np.array([8] * 3000 + [10**6] * 3 + [8] * 10)
    slices = shared(lambda rows: rows, len(vertices), 1, vertices=vertices)
    assert [(rows.start, rows.stop) for rows in slices] == [
        (0, 2048), (2048, 3000), (3000, 3001), (3001, 3002), (3002, 3003), (3003, 3013),
    ]  # fmt: skip
    assert shared(lambda rows: rows, 0, 1) == []
