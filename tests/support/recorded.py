"""Recorded answers of the oracle: computing them again would take more time than all other tests.

The key of an answer is a digest of all its inputs: the sources of the oracle, both objects, the settings it reads. The
oracle computes missing answers, and one answer in `FRESH`, others every day, which takes seconds per run.

    ./run python tests/support/recorded.py     computes all answers of the suite and records them (ten minutes)
"""

import gzip
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

HERE: Final = Path(__file__).resolve().parent
RECORD: Final = HERE / "recorded.jsonl.gz"
FOLDER: Final = "CONFLICTDB_RECORD_ORACLE"  # where everything that is computed is written
FRESH: Final = 200
ASKING: Final = (
    "unit/test_oracle", "unit/test_stage4_approach", "acceptance/test_adversary", "acceptance/test_command_line",
    "acceptance/test_extremes", "acceptance/test_grazing", "acceptance/test_never_misses", "acceptance/test_regions",
    "acceptance/test_separation_on_earth", "acceptance/test_shallow", "paths/test_against_oracle",
)  # fmt: skip
NOT_READ: Final = ("key", "name", "properties")  # of an object: they change no answer


def recorded(question: tuple[Any, ...], compute: Callable[[], Any]) -> Any:
    """Return the answer to a question of dataclasses and plain values, numbers and lists of them."""
    digest = hashlib.blake2b(_oracle(), digest_size=10)
    for part in question:
        _add(digest, part)
    key = digest.hexdigest()
    if FOLDER not in os.environ:
        known = _answers().get(key)
        is_fresh = (int(key, 16) + datetime.now(UTC).toordinal()) % FRESH == 0
        return compute() if known is None or is_fresh else known
    answer = compute()
    with Path(os.environ[FOLDER], f"{os.getpid()}.jsonl").open("a") as stream:
        stream.write(json.dumps([key, answer]) + "\n")
    return answer


def _add(digest: Any, part: Any) -> None:
    if is_dataclass(part):
        for field in fields(part):
            value = getattr(part, field.name)
            if field.name not in NOT_READ and value is not None:
                digest.update(field.name.encode())
                _add(digest, value)
    elif isinstance(part, np.ndarray):
        digest.update(f"{part.dtype}{part.shape}".encode() + part.tobytes())
    elif isinstance(part, shapely.Geometry):
        digest.update(shapely.to_wkb(part, byte_order=1))
    else:
        digest.update(f"{part!r};".encode())


@cache
def _oracle() -> bytes:
    return hashlib.blake2b(b"".join(path.read_bytes() for path in sorted(HERE.glob("oracle*.py")))).digest()


def is_current() -> bool:
    """Return whether the recorded answers are of the oracle as it is."""
    return bool(_answers().get("oracle") == _oracle().hex())


@cache
def _answers() -> dict[str, Any]:
    return dict(map(json.loads, gzip.decompress(RECORD.read_bytes()).splitlines())) if RECORD.exists() else {}


def main() -> int:
    """Run the tests that ask the oracle, and write its answers."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-n",
            "2",
            "-k",
            "not recorded_answers_are_of_this_oracle",  # they are not, until this has ended
            *(str(HERE.parent / f"{name}.py") for name in ASKING),
        ]
        done = subprocess.run(command, env={**os.environ, FOLDER: folder}, check=False)
        lines = {json.dumps(["oracle", _oracle().hex()])}
        lines |= {line for path in Path(folder).glob("*.jsonl") for line in path.read_text().splitlines()}
    if done.returncode == 0:
        RECORD.write_bytes(gzip.compress("\n".join(sorted(lines)).encode(), mtime=0))
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
