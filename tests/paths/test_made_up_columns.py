"""A column that is added to the table of columns of plans reaches every form and every way, with no other edit."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]


FILES = ("support/made_up_forms.py", "paths/test_borders.py", "paths/test_stored_borders.py")


def test_made_up_columns_reach_every_border(server_dsn: str) -> None:
    """Those of `made_up_columns.NOT_GENERIC` are left out, with their reasons."""
    here = {"PYTHONPATH": os.pathsep.join([str(TESTS / "support"), str(TESTS.parent / "docs")])}
    ran = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-n",
            "0",
            "-q",
            "-p",
            "made_up_columns",
            *(str(TESTS / one) for one in FILES),
        ],
        env={**os.environ, **here, "CONFLICTDB_TEST_DSN": server_dsn},
        cwd=TESTS.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout[-4000:] + ran.stderr[-2000:]
