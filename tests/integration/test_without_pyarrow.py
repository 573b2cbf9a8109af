"""Commands where the extra `parquet` is not installed."""

import json
import os
import subprocess
import sys
from pathlib import Path

from patience import WAIT_S

from conflictdb import connect

# Runs commands in a process without pyarrow, and prints the exit code and the messages of each.
SCRIPT = """
import contextlib, io, json, os, sys
sys.modules["pyarrow"] = None
from conflictdb.cli import main

done = []
for words, more in json.loads(sys.argv[1]):
    os.environ.pop("CONFLICTDB_PROGRAM", None)
    os.environ.update(more)
    with contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            code = main(words)
        except SystemExit as ended:
            code = ended.code
    done.append([code, err.getvalue().splitlines()])
print(json.dumps(done))
"""


def test_without_pyarrow_every_command_that_needs_it_names_the_extra(dsn: str, tmp_path: Path) -> None:
    """Reading, writing and writing back of Parquet end with the one command that installs the missing package."""
    for name in ("file.parquet", "file.geoparquet"):
        (tmp_path / name).write_bytes(b"PAR1")
    with connect(dsn) as db:
        db.load_demo()
        db.scene("strait").detect()
    commands = (
        "load file.parquet",
        "load file.geoparquet file.parquet",
        "detect file.parquet --scene strait",
        "export --scene strait out.parquet",
        "conflicts --scene strait --format geoparquet",
        "spark write-back --scene strait file.parquet",
    )
    remedies: tuple[tuple[dict[str, str], str], ...] = (
        ({}, "pip install 'conflictdb[parquet]'"),
        ({"CONFLICTDB_PROGRAM": "./run"}, "./run extras"),
    )
    cases = [(command, more, remedy) for command in commands for more, remedy in remedies]
    runs = json.dumps([(["--dsn", dsn, *command.split()], more) for command, more, _ in cases])
    found = subprocess.run(
        [sys.executable, "-c", SCRIPT, runs],
        env=os.environ,
        stdout=subprocess.PIPE,
        check=True,
        timeout=WAIT_S,
        cwd=tmp_path,
    )
    for (command, _, remedy), done in zip(cases, json.loads(found.stdout), strict=True):
        message = f"conflictdb: Arrow and Parquet need pyarrow: {remedy}"
        assert done == [1, [message]], command
