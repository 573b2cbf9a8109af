"""Real reference data outside the repository: tests that need it skip with a message if it is missing."""

import os
from pathlib import Path

import pytest

DEFAULT = Path(__file__).resolve().parents[3] / "shared" / "data"


def data(*parts: str) -> Path:
    """Path of a file or folder of the reference data (CONFLICTDB_DATA, else ../shared/data next to the repository)."""
    path = Path(os.environ.get("CONFLICTDB_DATA", DEFAULT)).joinpath(*parts)
    if not path.exists():
        pytest.skip(f"did not run: no reference data at {path} (set CONFLICTDB_DATA)")
    return path
