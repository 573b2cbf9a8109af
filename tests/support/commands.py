"""Runs commands in this process, as a user would type them."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psycopg
import pytest

import conflictdb
from conflictdb.cli import main
from conflictdb.store import connection

# Columns that are equal for a detection and for conflicts computed by another program.
KEPT = (
    "a_key", "a_kind", "b_key", "b_kind", "verdict", "periods", "region", "first_contact_point", "method",
    "time_error_s", "closest_at", "closest_m", "closest_error_m", "closest_a_point", "closest_b_point",
)  # fmt: skip
STRAIT = Path(conflictdb.__file__).parent / "scenes" / "strait.geojson"
# A load of it prints this on stderr.
STRAIT_CAME = (
    "conflictdb: strait: 4 areas and 7 tracks, 57°18'N to 58°21'N, 008°00'E to 010°36'E, 2026-05-20 00:00 to "
    "2026-06-01 16:00 UTC, 6 to 140 kn, -700 to 3,000 m high\n"
)


@dataclass(frozen=True, slots=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Run = Callable[..., Outcome]


def runner(
    dsn: str, capsys: pytest.CaptureFixture[str], connect: Callable[..., psycopg.Connection[Any]] | None = None
) -> Run:
    """Return a function that runs one command on a database; `connect` opens its sessions in place of psycopg's."""
    driver = SimpleNamespace(**{**vars(psycopg), "connect": connect})

    def run(*words: str | Path) -> Outcome:
        capsys.readouterr()
        try:
            with pytest.MonkeyPatch.context() as patch:
                if connect is not None:
                    patch.setattr(connection, "psycopg", driver)
                code = main(["--dsn", dsn, *map(str, words)])
        except SystemExit as ended:
            code = int(ended.code or 0)
        return Outcome(code, *capsys.readouterr())

    return run


def known(run: Run, scene: str) -> list[dict[str, Any]]:
    """Return the conflicts of a scene, without run and time of detection."""
    rows = json.loads(run("conflicts", "--scene", scene, "--format", "json").out)
    return [{name: row[name] for name in KEPT} for row in rows]
