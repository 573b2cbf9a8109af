"""./run: its message when it cannot create its environment, and that it leaves a complete one alone."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from patience import WAIT_S

ROOT = Path(__file__).parents[2]
# Each contains the one before.
PINS = ("requirements.txt", "requirements-plot.txt", "requirements-extras.txt", "requirements-dev.txt")


def run(path: Path, venv: Path, *arguments: str, called: Path = ROOT / "run") -> "subprocess.CompletedProcess[str]":
    """Run ./run, or a link to it, with only the directory `path` on PATH."""
    environ = {"PATH": str(path), "CONFLICTDB_VENV": str(venv)}
    return subprocess.run(
        [called, *arguments], env=environ, capture_output=True, text=True, timeout=WAIT_S, check=False
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a PATH with the system's programs that ./run needs, and without any Python."""
    system = "dirname cat cmp head rm rmdir mkdir echo sh uname sha256sum cut grep readlink"
    for name in system.split():
        (tmp_path / "bin").mkdir(exist_ok=True)
        (tmp_path / "bin" / name).symlink_to(str(shutil.which(name)))
    return tmp_path / "bin"


def program(path: Path, script: str) -> None:
    """Write an executable shell script."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


@pytest.mark.parametrize("found", ["Python 3.9.2", None])
def test_old_python_is_said(tmp_path: Path, path: Path, found: str | None) -> None:
    """A Python that is too old, or missing, ends in one line that states the needed version and how to name another."""
    if found:
        program(path / "python3", f'[ "$1" = --version ] && echo {found}; exit 1')
    answer = run(path, tmp_path / "venv", "demo")
    assert answer.returncode == 1
    assert "needs Python 3.11 or newer" in answer.stderr
    assert (found or "none") in answer.stderr
    assert "PYTHON=" in answer.stderr


def test_python_without_venv_names_the_package(tmp_path: Path, path: Path) -> None:
    """Debian's Python without its venv package gets the one command that brings it, and nothing half-made stays."""
    program(path / "python3", 'case "$2" in *ensurepip*) exit 1 ;; esac')
    answer = run(path, tmp_path / "venv", "demo")
    assert answer.returncode == 1
    assert "sudo apt-get install python3-venv" in answer.stderr
    assert not (tmp_path / "venv").exists()


def test_complete_environment_is_used_as_it_is(tmp_path: Path, path: Path) -> None:
    """Nothing is created, nothing is printed, and the command gets its arguments unchanged."""
    venv = tmp_path / "venv"
    shows = 'for a in "$@"; do echo "<$a>"; done; exit 7'
    program(venv / "bin/python", shows)
    program(venv / "bin/conflictdb", f'echo "$CONFLICTDB_PROGRAM"; {shows}')
    for pins in PINS:
        made(venv, pins)
        answer = run(path, venv, "detect", "two words", "")
        printed = f"{ROOT / 'run'}\n<detect>\n<two words>\n<>\n"
        assert (answer.returncode, answer.stdout, answer.stderr) == (7, printed, "")
        answer = run(path, venv, "python", "-c", "print()")
        assert (answer.returncode, answer.stdout, answer.stderr) == (7, "<-c>\n<print()>\n", "")
    answer = run(path, venv, "test", "-k", "words")
    assert answer.stdout == "<-m>\n<pytest>\n<-n>\n<3>\n<--dist>\n<loadgroup>\n<-k>\n<words>\n"
    assert answer.stderr == ""
    assert "about ten minutes" in run(path, venv, "test").stderr


@pytest.mark.parametrize("absolute", [True, False])
def test_link_to_it_runs_what_it_points_to(tmp_path: Path, path: Path, absolute: bool) -> None:
    """By links, also relative ones and links to links, its environment is that of the file; messages name the link."""
    venv = tmp_path / "venv"
    program(venv / "bin/conflictdb", 'echo "$CONFLICTDB_PROGRAM" "$@"')
    program(venv / "bin/python", "exit 0")
    made(venv, "requirements.txt")
    link, second = tmp_path / "a b" / "link", tmp_path / "conflicts"
    link.parent.mkdir()
    link.symlink_to(ROOT / "run" if absolute else os.path.relpath(ROOT / "run", link.parent))
    second.symlink_to(link.relative_to(tmp_path))
    for called in (link, second):
        answer = run(path, venv, "status", called=called)
        assert (answer.returncode, answer.stdout, answer.stderr) == (0, f"{called} status\n", "")


@pytest.mark.parametrize(
    ("word", "what", "needed"),
    [
        ("plot", "the libraries for figures", 1),
        ("report", "the libraries for figures", 1),
        ("extras", "the libraries of the extras", 2),
        ("test", "the developers' tools", 3),
    ],
)
def test_packages_are_added_when_they_are_first_asked_for(
    tmp_path: Path, path: Path, word: str, what: str, needed: int
) -> None:
    """An environment with fewer packages gets the pins that the command needs; an environment with more stays."""
    venv, calls = tmp_path / "venv", tmp_path / "calls"
    program(path / "python3", "exit 0")
    for program_name in ("python", "conflictdb"):
        program(venv / "bin" / program_name, f'[ "$2" != pip ] || echo "$@" >>{calls}')
    for i, pins in enumerate(PINS):
        made(venv, pins)
        calls.write_text("")
        answer = run(path, venv, word, "-k", "words")
        assert answer.returncode == 0
        assert (f"adding {what} to" in answer.stderr) == (i < needed)
        assert [
            line.endswith(f"--require-hashes -r {ROOT / PINS[needed]}") for line in calls.read_text().splitlines()
        ] == ([True] if i < needed else [])
        assert "adding" not in run(path, venv, word).stderr


def test_interrupted_environment_is_made_anew(tmp_path: Path, path: Path) -> None:
    """A package that was half installed when Ctrl-C came is not taken for a whole one."""
    venv = tmp_path / "venv"
    (venv / "half").mkdir(parents=True)
    (venv / "pyvenv.cfg").touch()
    (venv / "made-from").touch()
    program(venv / "bin/python", "exit 0")
    made = f"{shutil.which('mkdir')} -p {venv}/bin; echo new >{venv}/new"
    program(path / "python3", f'case "$*" in "-m venv"*) {made} ;; esac')
    assert run(path, venv, "python").returncode != 0, "the stand-in makes no programs"
    assert not (venv / "half").exists()
    assert (venv / "new").exists()


@pytest.mark.parametrize("maker", ["python3", "uv"])
@pytest.mark.parametrize(
    "left",
    [
        'mkdir -p "$venv/bin"',
        'mkdir -p "$venv/bin"; ln -s "$shared" "$venv/bin/python"',  # uv says last that this is an environment
        'mkdir -p "$venv/bin"; ln -s "$shared" "$venv/bin/python"; : >"$venv/pyvenv.cfg"',
    ],
)
def test_environment_whose_making_was_killed_is_made_anew(tmp_path: Path, path: Path, maker: str, left: str) -> None:
    """Wherever that was; nothing is installed into the Python that it was made with."""
    venv, shared, whole, calls = (tmp_path / name for name in ("venv", "shared", "whole", "calls"))
    program(shared, f'echo "$@" >>{tmp_path}/shared-calls')
    program(whole / "bin/python", f'echo "$@" >>{calls}')
    (whole / "pyvenv.cfg").touch()
    for name in ("ln", "cp"):
        (path / name).symlink_to(str(shutil.which(name)))
    program(path / "python3", "exit 0")
    for makes, code in ((f"{left}; kill -9 $PPID", -9), (f'cp -r {whole} "$venv"', 0)):
        case = f'case "$*" in *"venv "*"$venv") {makes} ;; *) echo "$@" >>{calls} ;; esac'
        program(path / maker, f"venv={venv} shared={shared}\n{case}")
        assert run(path, venv, "python").returncode == code
    assert "pip install" in calls.read_text()
    assert not (tmp_path / "shared-calls").exists()
    assert (venv / "made-from").read_text().startswith(f"{venv}\n")
    assert sorted(one.name for one in tmp_path.iterdir() if one.name.startswith("venv")) == ["venv", "venv.lock"]


def test_environment_whose_update_was_killed_is_made_anew(tmp_path: Path, path: Path) -> None:
    """Also when the pins are again those that it was made from before."""
    venv = tmp_path / "venv"
    (venv / "half").mkdir(parents=True)
    (venv / "pyvenv.cfg").touch()
    made(venv, "requirements.txt")
    pins_then = (venv / "made-from").read_text()
    (venv / "made-from").write_text(f"{pins_then}\n")
    program(venv / "bin/python", 'case "$*" in *"pip install"*) kill -9 $PPID ;; esac')
    program(path / "python3", "exit 0")
    assert run(path, venv, "python").returncode == -9
    (venv / "made-from").write_text(pins_then)
    assert run(path, venv, "python").returncode != 0, "the stand-in makes no programs"
    assert not (venv / "half").exists()


def test_environment_whose_removal_was_killed_is_made_anew(tmp_path: Path, path: Path) -> None:
    """The file that marks an environment may be removed first."""
    venv = tmp_path / "venv"
    program(venv / "bin/python", "exit 0")
    (venv / "pyvenv.cfg").touch()
    (venv / "made-from").touch()
    rm = (path / "rm").readlink()
    (path / "rm").unlink()
    program(path / "rm", f"{rm} {venv}/pyvenv.cfg; kill -9 $PPID")
    made = f"{shutil.which('mkdir')} -p {venv}/bin; echo new >{venv}/new"
    program(path / "python3", f'case "$*" in "-m venv"*) {made} ;; esac')
    assert run(path, venv, "python").returncode == -9
    (path / "rm").unlink()
    (path / "rm").symlink_to(rm)
    assert run(path, venv, "python").returncode != 0, "the stand-in makes no programs"
    assert (venv / "new").exists()


def test_environment_is_made_in_a_directory_that_is_not_there_yet(tmp_path: Path, path: Path) -> None:
    venv = tmp_path / "new" / "folder" / "venv"
    (path / "chmod").symlink_to(str(shutil.which("chmod")))
    made = 'mkdir -p "$4/bin"; echo "exit 0" >"$4/bin/python"; chmod +x "$4/bin/python"'
    program(path / "python3", f'case "$*" in "-m venv"*) {made} ;; esac')
    assert run(path, venv, "python").returncode == 0
    assert (venv / "made-from").read_text().startswith(f"{venv}\n")


@pytest.mark.parametrize("file", ["letter", "bin/python"])
def test_a_directory_that_is_no_environment_is_left_alone(tmp_path: Path, path: Path, file: str) -> None:
    """A CONFLICTDB_VENV with foreign files is refused, not emptied, and nothing is installed into it."""
    program(path / "python3", "exit 0")
    program(tmp_path / "letters" / file, f'echo "$@" >>{tmp_path}/calls')
    answer = run(path, tmp_path / "letters", "demo")
    assert answer.returncode == 1
    assert "is no virtual environment" in answer.stderr
    assert (tmp_path / "letters" / file).exists()
    assert not (tmp_path / "calls").exists()


def made(venv: Path, pins: str) -> None:
    """Say that an environment was made from a file of pins."""
    venv.mkdir(exist_ok=True)
    (venv / "made-from").write_text(f"{venv}\n{(ROOT / pins).read_text()}{(ROOT / 'pyproject.toml').read_text()}")


@pytest.mark.parametrize("file", PINS)
def test_pins_carry_hashes_and_no_addresses(file: str) -> None:
    """Every requirement has a version and hashes; where packages come from is the machine's business."""
    lines = (ROOT / file).read_text().splitlines()
    pinned = [line for line in lines if line and not line.startswith(("#", " "))]
    assert all("==" in line and line.endswith("\\") for line in pinned)
    assert all(line.lstrip().startswith("--hash=sha256:") for line in lines if line.startswith(" "))
    assert not any("://" in line for line in lines)
    assert os.access(ROOT / "run", os.X_OK)


def test_there_is_one_set_of_versions() -> None:
    """Each file has the pins of the one before, perhaps on more systems; developers' tools are only in the last."""
    run_time, plot, extras, development = (pins(ROOT / file) for file in PINS)
    assert run_time < plot < extras < development
    names = {pin.partition("==")[0] for pin in extras}
    assert {"numpy", "psycopg-binary", "pyogrio", "hatchling", "pyarrow", "geopandas", "matplotlib"} <= names
    assert not names & {"pytest", "mypy", "ruff", "hypothesis", "testcontainers"}
    assert {"matplotlib", "fpdf2"} <= {pin.partition("==")[0] for pin in plot}
    assert not {"pandas", "pyarrow", "matplotlib"} & {pin.partition("==")[0] for pin in run_time}


def pins(file: Path) -> set[str]:
    """Return the pins of a file with their hashes, whatever systems they are for."""
    lines = [re.sub(r" ; [^\\]*", " ", line) for line in file.read_text().splitlines() if not line.startswith("#")]
    return set("\n".join(lines).replace("\n    ", " ").splitlines())
