"""Rights of programs that read foreign files, and the messages about their failures."""

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from conflictdb.errors import InvalidInput
from conflictdb.formats.confined import ConfinedProgram


def written(folder: Path, body: str) -> ConfinedProgram:
    """A program with this body."""
    lines = "".join(f"    {line}\n" for line in body.splitlines())
    path = folder / "program.py"
    path.write_text(f"import os, sys, time\ndef main(stream, most_bytes, arguments):\n{lines}")
    return ConfinedProgram(str(path), "cannot be read", 0.001, 1, {"OWN": "setting"})


def test_a_program_has_limits_arguments_and_an_environment_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PGPASSWORD", "secret")
    body = """import json, resource
limits = [resource.getrlimit(what)[0] for what in (resource.RLIMIT_AS, resource.RLIMIT_CPU, resource.RLIMIT_FSIZE)]
stream.write(json.dumps([most_bytes, limits, arguments, dict(os.environ)]).encode())"""
    with written(tmp_path, body).running(["a", "b"], 3.0) as running:
        most_bytes, limits, arguments, environment = json.loads(running.answer())
    assert (most_bytes, limits, arguments) == (3_000_000, [2 << 30, 30, 0], ["a", "b"])
    assert environment.pop("PYTHONPATH").split(os.pathsep) == [one for one in sys.path if one]
    environment.pop("LC_CTYPE", None)
    assert environment == {"OWN": "setting", "LC_ALL": "C.UTF-8", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@pytest.mark.parametrize(
    ("body", "rule"),
    [
        ("raise ValueError('no\\nlayers')", "cannot be read: no layers"),
        ("os.write(2, b'warning: {}'); raise ValueError('x' * 1000)", f"cannot be read: {'x' * 500}"),
        # More than a pipe's buffer, which nobody reads meanwhile.
        ("raise ValueError('x' * 1_000_000)", f"cannot be read: {'x' * 500}"),
        ("os.write(2, b'x' * 1_000_000); raise ValueError('no')", "cannot be read: no"),
        ("raise MemoryError", "holds more than 3 MB"),
        ("bytes(3 << 30)", "holds more than 3 MB"),
        ("os.write(2, b'terminate called'); os.abort()", "holds more than 3 MB"),
        ("os.write(2, b'5'); os.abort()", "holds more than 3 MB"),
        ("os.write(os.open(__file__ + '.new', os.O_WRONLY | os.O_CREAT), b'x')", "cannot be read: [Errno 27] File too"),
    ],
)
def test_why_nothing_was_read_is_told_in_one_line(tmp_path: Path, body: str, rule: str) -> None:
    """Whether its output is read at once or as it comes."""
    program = written(tmp_path, body)
    with program.running([], 3.0) as running, pytest.raises(InvalidInput) as by_answer:
        running.answer()
    with program.running([], 3.0) as running:
        assert running.stream.read() == b""
        with pytest.raises(InvalidInput) as by_end:
            running.check_end()
    for refused in (by_answer, by_end):
        assert rule in str(refused.value)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("body", ["while True: pass", "time.sleep(60)"])
def test_a_program_ends_in_the_end(tmp_path: Path, body: str) -> None:
    program = replace(written(tmp_path, body), least_seconds=1.0)
    with program.running([], 3.0) as running, pytest.raises(InvalidInput, match="takes too much to read"):
        running.answer()
    assert running.child.returncode is not None


@pytest.mark.parametrize(
    "body", ["while True: stream.write(bytes(1 << 20))", "while True: os.write(2, bytes(1 << 20))"]
)
def test_an_answer_without_end_is_not_kept(tmp_path: Path, body: str) -> None:
    program = replace(written(tmp_path, body), least_seconds=1.0)
    with program.running([], 3.0) as running, pytest.raises(InvalidInput, match="holds more than 3 MB"):
        running.answer()
