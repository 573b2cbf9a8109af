"""The roles of deploy/compose.yaml: made in a new volume, and in one of an older release."""

import os
import subprocess
import textwrap
from pathlib import Path
from typing import Any

import psycopg
import pytest
from patience import WAIT_S
from psycopg import conninfo

from conflictdb.embedded import find_psql

COMPOSE = Path(__file__).resolve().parents[2] / "deploy" / "compose.yaml"
Conn = psycopg.Connection[Any]


def test_each_start_gives_the_worker_its_role_and_password(conn: Conn, dsn: str, tmp_path: Path) -> None:
    """The script of the service `roles` as the shell gets it, with another name for the worker, and this server."""
    psql = find_psql()
    if psql is None:
        pytest.skip("did not run: no psql on this machine (Debian package postgresql-client)")
    text = COMPOSE.read_text(encoding="utf-8").split("    content: |\n", 1)[1].split("\n\nvolumes:", 1)[0]
    worker = f"worker_{conn.info.dbname}"
    given = "--host database --username conflictdb --dbname missions"
    script = (
        textwrap.dedent(text).replace("$$", "$").replace("'worker'", f"'{worker}'").replace(" worker", f" {worker}")
    )
    assert given in script
    file = tmp_path / "roles.sh"
    file.write_text(script.replace(given, f"--dbname '{dsn}'"))
    of = conninfo.conninfo_to_dict(dsn)
    environ = {**os.environ, **psql.environ, "PATH": f"{psql.path.parent}:{os.environ['PATH']}"}
    stored = "SELECT rolpassword FROM pg_authid WHERE rolname = %s AND rolcanlogin AND NOT rolsuper"
    found = []
    try:
        for password in ("it's", "another"):
            subprocess.run(["sh", file], env={**environ, "WORKER_PASSWORD": password}, check=True, timeout=WAIT_S)
            found.append(conn.execute(stored, [worker]).fetchone())
            conn.rollback()
            with psycopg.connect(conninfo.make_conninfo(**{**of, "user": worker, "password": password})) as one:
                assert one.execute("SELECT pg_has_role('conflictdb_worker', 'USAGE')").fetchone() == (True,)
        assert None not in found
        assert found[0] != found[1]
    finally:
        conn.rollback()
        conn.execute(f"DROP ROLE IF EXISTS {worker}".encode())
        conn.commit()
