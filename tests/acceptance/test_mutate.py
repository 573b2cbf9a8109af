"""The mutants themselves: the changed text, and that each still compiles."""

import ctypes
import subprocess
from pathlib import Path

import mutate
import mutate_kernel
import pytest
from mutate import MODULES, ROOT, Mutant, Sites
from patience import WAIT_S

SOURCE = '''
LIMIT = 2.0


def least(x: float | None, y: int = 3) -> float:
    """Return 5.0, as a message says."""
    if x is None or x < 0.5:
        raise ValueError(f"{x:.3f} is below {0.5}")
    x *= 2
    return min(-x, y) if y else x + 1
'''


def test_what_is_changed() -> None:
    found = [(m.within, f"{m.old} -> {m.new}") for m in Sites("some", SOURCE).found]
    assert found == [
        ("module", "2.0 -> 4.0"),
        ("least", "x is None or x < 0.5 -> (not (x is None or x < 0.5))"),
        ("least", "x is None or x < 0.5 -> (x is None and x < 0.5)"),
        ("least", "x is None -> (x is not None)"),
        ("least", "x < 0.5 -> (x <= 0.5)"),
        ("least", "x < 0.5 -> (x > 0.5)"),
        ("least", "0.5 -> 1.0"),
        ("least", "x *= 2 -> pass"),
        ("least", "x *= 2 -> x /= 2"),
        ("least", "2 -> 3"),
        ("least", "min(-x, y) if y else x + 1 -> (x + 1 if y else min(-x, y))"),
        ("least", "min(-x, y) -> max(-x, y)"),
        ("least", "-x -> (x)"),
        ("least", "x + 1 -> (x - 1)"),
        ("least", "1 -> 2"),
    ]


def changed(mutant: Mutant) -> str:
    source = (ROOT / "conflictdb" / mutate.file_of(mutant.module)).read_bytes()
    return (source[: mutant.start] + mutant.new.encode() + source[mutant.end :]).decode()


def test_mutants_are_drawn_by_the_seed_and_compile() -> None:
    drawn = mutate.drawn(ROOT, MODULES, 100, 7)
    assert drawn == mutate.drawn(ROOT, MODULES, 100, 7)
    assert drawn != mutate.drawn(ROOT, MODULES, 100, 8)
    assert len({mutant.module for mutant in drawn}) > 10
    for mutant in drawn:
        compile(changed(mutant), mutant.module, "exec")


KERNEL = """\
static double least_m(const Box *box, int64_t n) {
    static const double LIMITS[] = {1.0, 2.0};
    double found = 0.5, *x = box->x; /* 3 < 4 */
    for (int64_t i = 0; i < n; i++)
        if (x[i] * -2.0 < found && !box->is_empty) found += (double)i - fabs(x[i]);
    return found;
}
"""


def test_what_is_changed_in_the_kernel() -> None:
    found = [f"{m.old} -> {m.new}" for m in mutate_kernel.Sites("some.c", KERNEL).found]
    assert found == [
        "0.5 -> 1.0",
        "0 -> 1",
        "i < n -> i <= n",
        "i < n -> i > n",
        "x[i] * -2.0 < found && !box->is_empty -> !(x[i] * -2.0 < found && !box->is_empty)",
        "x[i] * -2.0 -> x[i] / -2.0",
        "-2.0 -> 2.0",
        "2.0 -> 4.0",
        "x[i] * -2.0 < found -> x[i] * -2.0 <= found",
        "x[i] * -2.0 < found -> x[i] * -2.0 > found",
        "x[i] * -2.0 < found && !box->is_empty -> x[i] * -2.0 < found || !box->is_empty",
        "!box->is_empty -> box->is_empty",
        "found += (double)i - fabs(x[i]) -> (void)0",
        "found += (double)i - fabs(x[i]) -> found -= (double)i - fabs(x[i])",
        "(double)i - fabs(x[i]) -> (double)i + fabs(x[i])",
        "fabs(x[i]) -> (x[i])",
    ]


def test_changes_of_the_kernel_are_chosen_by_a_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nested ones, too; none is chosen at first, and the library notes which were reached."""
    source = "int sum(int a, int b) { int c = 2; c += a * b + 3; return c; }\n"
    mutants = mutate_kernel.Sites("some.c", source).found
    (tmp_path / "mutants.h").write_text(mutate_kernel.HEADER.format(count=len(mutants)))
    text = '#include "mutants.h"\n' + mutate_kernel.rendered(source, list(enumerate(mutants)))
    (tmp_path / "some.c").write_text(text)
    made = tmp_path / "some.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", made, tmp_path / "some.c"], check=True, timeout=WAIT_S)
    (tmp_path / "reached").write_bytes(bytes(len(mutants)))
    monkeypatch.setenv("KERNEL_REACHED", str(tmp_path / "reached"))
    library = ctypes.CDLL(str(made))
    assert library.sum(5, 7) == 2 + 5 * 7 + 3
    assert (tmp_path / "reached").read_bytes() == bytes([1] * len(mutants))
    expected = {
        "2 -> 3": 3 + 35 + 3,
        "c += a * b + 3 -> (void)0": 2,
        "c += a * b + 3 -> c -= a * b + 3": 2 - 38,
        "a * b -> a / b": 2 + 0 + 3,
        "a * b + 3 -> a * b - 3": 2 + 35 - 3,
        "3 -> 4": 2 + 35 + 4,
    }
    got = {}
    for k, mutant in enumerate(mutants):
        ctypes.c_int.in_dll(library, "_kernel_mutant").value = k
        got[f"{mutant.old} -> {mutant.new}"] = library.sum(5, 7)
    assert got == expected


def test_all_of_the_kernel_is_read() -> None:
    """Each file of the folders has changes, and names of them are texts of one line."""
    every = mutate_kernel.sites(ROOT, mutate_kernel.FOLDERS)
    assert len({mutant.module for mutant in every}) > 25
    assert len(every) > 8_000
    assert all("\n" not in mutant.new for mutant in every)


def test_explained_changes_of_the_kernel_are_there() -> None:
    """A reason for a change that is no longer there misleads."""
    folders = sorted(path.name for path in (ROOT / "conflictdb/kernel").iterdir() if path.is_dir())
    every = {one.name for one in mutate_kernel.sites(ROOT, folders)}
    assert {name for name in mutate.known() if name.startswith("kernel/")} <= every
