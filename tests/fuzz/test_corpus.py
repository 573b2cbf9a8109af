"""Inputs that fuzzing found are played again: the kernel under sanitizers, and readers of files."""

import random
import subprocess
from pathlib import Path

import fuzz
import pytest
from kernel_internals import sanitized_program
from patience import WAIT_S


@pytest.mark.parametrize("group", fuzz.KERNEL)
def test_inputs_of_the_kernel(group: str, tmp_path: Path) -> None:
    """No access outside an array, undefined operation or broken precondition."""
    files = fuzz.corpus_of(group)
    assert files
    program = sanitized_program(tmp_path / "target", fuzz.HERE / "kernel_target.c", f"-I{fuzz.SUPPORT}", "-DREPLAYS")
    command = [program, str(fuzz.KERNEL[group]), *files]
    done = subprocess.run(command, stderr=subprocess.PIPE, timeout=WAIT_S, check=False)
    assert done.returncode == 0, done.stderr.decode(errors="replace")[-3000:]


@pytest.mark.parametrize("group", fuzz.READERS)
def test_inputs_of_readers(group: str) -> None:
    """Each file is read, or refused by an error of this package."""
    files = fuzz.corpus_of(group)
    assert files
    wrong = [f"{path.name}: {said}" for path in files if (said := fuzz.fault(path))]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("group", fuzz.READERS)
def test_files_are_changed_by_the_seed(group: str) -> None:
    """The same seed gives the same files, and most differ from what they were made of."""
    pool = list(fuzz.whole(group).values())

    def made(seed: int) -> list[bytes]:
        rng = random.Random(seed)  # noqa: S311 - chance, not secrecy
        return [fuzz.changed(rng, rng.choice(pool), pool) for _ in range(50)]

    assert made(1) == made(1) != made(2)
    assert sum(one not in pool for one in made(1)) > 30


def test_an_error_of_another_kind_is_a_fault(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A file that is refused is none; an error that a reader does not expect is one."""
    path = tmp_path / "a.gpx"
    path.write_text("<gpx>")
    assert not fuzz.fault(path)

    def fails(*_: object, **__: object) -> None:
        raise KeyError("lat")

    monkeypatch.setattr(fuzz, "read", fails)
    assert "KeyError: 'lat'" in fuzz.fault(path)
