"""Over TLS, with a certificate that the client checks: every command works, or ends with the error."""

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psycopg
import pytest
from commands import STRAIT, STRAIT_CAME, runner
from databases import server_directory
from installations import local_server
from patience import WAIT_S
from ports import free_port

from conflictdb.cli.codes import DONE, NO_SERVER
from conflictdb.embedded.account import account_for

OPENSSL = shutil.which("openssl")
KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")

pytestmark = pytest.mark.skipif(OPENSSL is None, reason="TLS did not run: no openssl here to make certificates")


def openssl(directory: Path, *words: str) -> None:
    subprocess.run([str(OPENSSL), *words], cwd=directory, check=True, capture_output=True)


def make_certificates(directory: Path) -> None:
    """Make an authority, a certificate of it for localhost alone, and an authority that knows nothing of that."""
    for name in ("ca", "stranger"):
        openssl(
            directory, "req", "-x509", *KEY, "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.crt"
        )
    openssl(directory, "req", *KEY, "-subj", "/CN=localhost", "-keyout", "server.key", "-out", "server.csr")
    (directory / "names").write_text("subjectAltName=DNS:localhost")
    made = ("-in", "server.csr", "-CA", "ca.crt", "-CAkey", "ca.key", "-CAcreateserial", "-extfile", "names")
    openssl(directory, "x509", "-req", *made, "-out", "server.crt")


@pytest.fixture(scope="module")
def secured() -> Iterator[tuple[Path, int]]:
    """A server that refuses connections without TLS: the directory of certificates, and its port."""
    home = Path(tempfile.mkdtemp(prefix="conflictdb-tls-", dir=server_directory()))
    home.chmod(0o755)
    account, programs = account_for(home), local_server()
    make_certificates(home)
    (home / "server.key").chmod(0o600)
    data = home / "data"
    data.mkdir()
    for path in (data, home / "server.key"):
        os.chown(path, account.switch.get("user", -1), account.switch.get("group", -1))
    made = account.run([programs.bin / "initdb", "-D", data, "-U", "postgres", "-N"], programs.environ, WAIT_S)
    assert made.returncode == 0, made.stderr
    (data / "pg_hba.conf").write_text("hostssl all all 127.0.0.1/32 trust\nhostssl all all ::1/128 trust\n")
    port = free_port()
    settings = {"port": port, "ssl": "on", "ssl_cert_file": home / "server.crt", "ssl_key_file": home / "server.key"}
    settings |= {"unix_socket_directories": "", "listen_addresses": "localhost", "fsync": "off"}
    words = [word for name, value in settings.items() for word in ("-c", f"{name}={value}")]
    with (home / "log").open("w") as log:
        process = subprocess.Popen(
            [programs.bin / "postgres", "-D", data, *words],
            env={**programs.environ, "HOME": str(home)},
            stdout=log,
            stderr=log,
            **account.switch,
        )
    try:
        end = time.monotonic() + WAIT_S
        while True:
            assert process.poll() is None, (home / "log").read_text()
            assert time.monotonic() < end
            with suppress(psycopg.OperationalError):
                psycopg.connect(f"{verified(home, port)} dbname=postgres").close()
                break
            time.sleep(0.05)
        yield home, port
    finally:
        process.terminate()
        process.wait(WAIT_S)
        shutil.rmtree(home, ignore_errors=True)


def verified(home: Path, port: int, host: str = "localhost", authority: str = "ca") -> str:
    return f"host={host} port={port} user=postgres sslmode=verify-full sslrootcert={home / authority}.crt"


def test_all_commands_work(secured: tuple[Path, int], capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    run = runner(f"{verified(*secured)} dbname=postgres", capsys)
    for words in (
        ["admin", "init"],
        ["load", STRAIT],
        ["detect", "--scene", "strait"],
        ["conflicts", "--scene", "strait"],
        ["export", "--scene", "strait", tmp_path / "strait.geojson"],
        ["worker", "--once"],
        ["status"],
    ):
        done = run(*words)
        assert (done.code, done.err.replace(STRAIT_CAME, "")) == (DONE, ""), (words, done.err)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"authority": "stranger"}, "certificate verify failed"),
        ({"host": "127.0.0.1"}, 'does not match host name "127.0.0.1"'),
        ({"authority": "nothing"}, "does not exist"),
    ],
)
def test_who_cannot_verify_is_told_why(
    secured: tuple[Path, int], capsys: pytest.CaptureFixture[str], change: dict[str, str], message: str
) -> None:
    done = runner(f"{verified(*secured, **change)} dbname=postgres", capsys)("status")
    assert (done.code, done.out) == (NO_SERVER, "")
    assert message in done.err


def test_without_tls_the_server_lets_nobody_in(secured: tuple[Path, int], capsys: pytest.CaptureFixture[str]) -> None:
    done = runner(f"host=127.0.0.1 port={secured[1]} user=postgres dbname=postgres sslmode=disable", capsys)("status")
    assert (done.code, done.out) == (NO_SERVER, "")
    assert "no encryption" in done.err
    assert done.err.count("\n") == 1
