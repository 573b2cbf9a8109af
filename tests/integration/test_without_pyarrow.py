"""Commands where the extra `parquet` is not installed."""

import os
import subprocess
import sys
from pathlib import Path

from conflictdb import connect


def test_without_pyarrow_every_command_that_needs_it_names_the_extra(dsn: str, tmp_path: Path) -> None:
    """Reading, writing and writing back of Parquet end with the one command that brings what is missing."""
    script = "import sys; sys.modules['pyarrow'] = None\nfrom conflictdb.cli import main\nsys.exit(main(sys.argv[1:]))"
    for name in ("file.parquet", "file.geoparquet"):
        (tmp_path / name).write_bytes(b"PAR1")
    with connect(dsn) as db:
        db.load_demo()
        db.scene("strait").detect()
    environ = {name: value for name, value in os.environ.items() if name != "CONFLICTDB_PROGRAM"}
    for command in (
        "load file.parquet",
        "load file.geoparquet file.parquet",
        "detect file.parquet --scene strait",
        "export --scene strait out.parquet",
        "conflicts --scene strait --format geoparquet",
        "spark write-back --scene strait file.parquet",
    ):
        for more, remedy in (
            ({}, "pip install 'conflictdb[parquet]'"),
            ({"CONFLICTDB_PROGRAM": "./run"}, "./run extras"),
        ):
            done = subprocess.run(
                [sys.executable, "-c", script, "--dsn", dsn, *command.split()],
                env=environ | more,
                capture_output=True,
                text=True,
                check=False,
                timeout=60,
                cwd=tmp_path,
            )
            told = f"conflictdb: Arrow and Parquet need pyarrow: {remedy}"
            assert (done.returncode, done.stderr.splitlines()) == (1, [told]), command
