"""Runs commands in this process, as a user would type them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

import conflictdb
from conflictdb.cli import main

STRAIT = Path(conflictdb.__file__).parent / "scenes" / "strait.geojson"


@dataclass(frozen=True, slots=True)
class Outcome:
    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


def runner(dsn: str, capsys: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs one command on a database."""

    def run(*words: str | Path) -> Outcome:
        capsys.readouterr()
        try:
            code = main(["--dsn", dsn, *map(str, words)])
        except SystemExit as ended:
            code = int(ended.code or 0)
        return Outcome(code, *capsys.readouterr())

    return run
