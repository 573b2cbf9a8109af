"""The shipped files that keep scenes current work: units of systemd, a line for cron, jobs of pg_cron."""

import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import psycopg
import pytest
from commands import STRAIT, runner
from own_server import own_server
from patience import WAIT_S

import conflictdb
from conflictdb import connect, store
from conflictdb.cli import service_units
from conflictdb.cli.commands import build

FILES = Path(conflictdb.__file__).parent / "services"
PROGRAM = "/opt/conflictdb/bin/conflictdb"


def pending(dsn: str) -> int:
    with connect(dsn) as db:
        return sum(scene.pending for scene in db.scenes())


@pytest.mark.parametrize("name", ["conflictdb-worker.service", "conflictdb-detect.service"])
def test_a_unit_starts_what_there_is(name: str) -> None:
    """And its own file is named in its first line."""
    text = (FILES / name).read_text()
    (command,) = re.findall(r"^ExecStart=(.*)$", text, re.MULTILINE)
    program, *words = shlex.split(command)
    args = build().parse_args(words)
    assert (program, args.command, args.log, args.once) == (PROGRAM, "worker", "json", "detect" in name)
    assert text.startswith(f"# /etc/systemd/system/{name}: ")


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="units were not verified: no systemd-analyze")
def test_systemd_has_nothing_against_the_units(tmp_path: Path) -> None:
    units = []
    for file in (*FILES.glob("*.service"), *FILES.glob("*.timer")):
        units.append(tmp_path / file.name)
        units[-1].write_text(file.read_text().replace(PROGRAM, "/bin/true"))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", *units], capture_output=True, text=True, check=False
    )
    assert (len(units), done.returncode, done.stdout, done.stderr) == (3, 0, "", "")
    (calendar,) = re.findall(r"^OnCalendar=(.*)$", (FILES / "conflictdb-detect.timer").read_text(), re.MULTILINE)
    subprocess.run(["systemd-analyze", "calendar", calendar], capture_output=True, check=True)


def test_the_line_for_cron_detects_what_waits(dsn: str) -> None:
    with connect(dsn) as db:
        db.load(STRAIT, "strait")
    *remarks, line = (FILES / "crontab").read_text().splitlines()
    assert all(remark.startswith("#") for remark in remarks)
    *schedule, command = line.split(None, 5)
    assert schedule == ["*/5", "*", "*", "*", "*"]
    assert "%" not in command, "which cron takes for the end of a line"
    command = command.replace("service=missions", shlex.quote(dsn)).replace(PROGRAM, f"{sys.executable} -m conflictdb")
    # As cron does: little is in the environment.
    done = subprocess.run(
        ["/bin/sh", "-c", command],
        env={"PATH": "/usr/bin:/bin", "HOME": "/"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("strait: 7 conflicts, 7 new ")
    assert pending(dsn) == 0


def jobs() -> dict[str, tuple[str, str]]:
    """Return the jobs of pg_cron by name: schedule and command."""
    found = re.findall(r"cron\.schedule\('([^']*)', '([^']*)',\s*'([^']*)'\)", (FILES / "pg_cron.sql").read_text())
    return {name: (schedule, statement) for name, schedule, statement in found}


def test_jobs_of_pg_cron_ask_for_detections(dsn: str) -> None:
    """As a role that may no more than edit."""
    with connect(dsn) as db:
        db.load(STRAIT, "strait")
        db.scene("strait").detect()
    waiting, everything = (statement for _, statement in jobs().values())
    with psycopg.connect(dsn) as conn:
        conn.execute("SET ROLE conflictdb_editor")
        assert conn.execute(waiting.encode()).fetchall() == []
        assert conn.execute(everything.encode()).fetchall() == [(11,)]
        assert conn.execute(waiting.encode()).fetchall() == [(11,)]


@pytest.mark.slow
def test_pg_cron_asks_and_a_worker_does(server_dsn: str) -> None:
    """The file creates the jobs; the nightly job runs every minute here, and it alone wakes the worker."""
    settings = {"shared_preload_libraries": "pg_cron", "cron.database_name": "conflictdb",
                "cron.use_background_workers": "on"}  # fmt: skip
    with own_server() as server:
        with psycopg.connect(server.dsn, autocommit=True) as conn:
            if not conn.execute("SELECT FROM pg_available_extensions WHERE name = 'pg_cron'").rowcount:
                pytest.skip("pg_cron did not run: not with this server (Debian package postgresql-15-cron)")
        server.stop()
        server.settings.update(settings)
        server.start()
        with connect(server.dsn) as db:
            db.load(STRAIT, "strait")
        worker = subprocess.Popen([sys.executable, "-m", "conflictdb", "--dsn", server.dsn, "worker", "--every", "1h"])
        try:
            with psycopg.connect(server.dsn, autocommit=True) as conn:
                conn.execute("SELECT conflictdb.wait_until_current('strait')")
                conn.execute("CREATE EXTENSION pg_cron")
                conn.execute((FILES / "pg_cron.sql").read_text().encode())
                made = dict(conn.execute("SELECT jobname, command FROM cron.job").fetchall())
                assert made == {name: statement for name, (_, statement) in jobs().items()}
                everything = "conflictdb: everything"
                conn.execute("SELECT cron.schedule(%s, '* * * * *', %s)", [everything, made[everything]])
                end = time.monotonic() + WAIT_S
                while len(runs := store.runs(conn, "strait", 9)) < 2:
                    assert time.monotonic() < end
                    time.sleep(0.2)
                assert all(run.error is None for run in runs)
                statuses = conn.execute("SELECT DISTINCT status FROM cron.job_run_details WHERE end_time IS NOT NULL")
                assert statuses.fetchall() == [("succeeded",)]
        finally:
            worker.terminate()
            worker.wait(WAIT_S)


def test_the_command_prints_them_for_this_program(
    dsn: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = runner(dsn, capsys)
    monkeypatch.setenv("CONFLICTDB_PROGRAM", "/srv/plans/run")
    printed = {
        name: run("admin", "service", name).out
        for name in ("systemd", "systemd-once", "systemd-timer", "cron", "pg_cron")
    }
    assert "ExecStart=/srv/plans/run worker --log json\n" in printed["systemd"]
    assert "ExecStart=/srv/plans/run worker --once --log json\n" in printed["systemd-once"]
    assert " /srv/plans/run worker --once\n" in printed["cron"]
    assert PROGRAM not in "".join(printed.values())
    shipped = sorted(file.read_text() for file in FILES.iterdir() if file.is_file())
    assert sorted(text.replace("/srv/plans/run", PROGRAM) for text in printed.values()) == shipped
    monkeypatch.setenv("CONFLICTDB_PROGRAM", "/srv/all plans/run")
    assert run("admin", "service", "systemd").out == (FILES / "conflictdb-worker.service").read_text()


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/home/ann/plans/run", [("/home/ann/plans/run", "ProtectHome=yes", "/home")]),
        ("/root/.local/bin/conflictdb", [("/root/.local/bin/conflictdb", "ProtectHome=yes", "/root")]),
        ("/run/user/1000/conflictdb", [("/run/user/1000/conflictdb", "ProtectHome=yes", "/run/user")]),
        ("/tmp/venv/bin/../bin/conflictdb", [("/tmp/venv/bin/conflictdb", "PrivateTmp=yes", "/tmp")]),  # noqa: S108
        ("/var/tmp/run", [("/var/tmp/run", "PrivateTmp=yes", "/var/tmp")]),  # noqa: S108
        ("/opt/conflictdb/bin/conflictdb", []),
        ("/homeless/run", []),
        ("/srv/home/run", []),
    ],
)
def test_directories_that_units_hide_are_known(path: str, said: list[tuple[str, str, str]]) -> None:
    assert service_units.hidden([path]) == said


def test_links_into_hidden_directories_are_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both the link and its target must be visible to the unit."""
    (tmp_path / "home").mkdir()
    (tmp_path / "home/run").touch()
    (tmp_path / "link").symlink_to("home/run")
    real = tmp_path.resolve()
    monkeypatch.setattr(service_units, "_HIDDEN", {"ProtectHome=yes": (str(real / "home"),)})
    assert service_units.hidden([str(real / "link")]) == [
        (str(real / "home/run"), "ProtectHome=yes", str(real / "home"))
    ]
    monkeypatch.setattr(service_units, "_HIDDEN", {"ProtectHome=yes": (str(real / "link"),)})
    assert service_units.hidden([str(real / "link")]) == [(str(real / "link"), "ProtectHome=yes", str(real / "link"))]


def test_settings_that_hide_directories_are_those_of_the_units() -> None:
    for file in FILES.glob("*.service"):
        assert set(service_units._HIDDEN) <= set(file.read_text().splitlines())


@pytest.mark.parametrize("needed", ["program", "interpreter"])
def test_a_unit_that_cannot_start_the_program_is_remarked(
    dsn: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, needed: str
) -> None:
    """In two lines on standard error; cron hides nothing."""
    run = runner(dsn, capsys)
    monkeypatch.setattr(service_units, "_HIDDEN", {"ProtectHome=yes": ("/hidden",)})
    monkeypatch.setenv("CONFLICTDB_PROGRAM", "/srv/plans/run")
    assert run("admin", "service", "systemd").err == ""
    path = "/hidden/ann/plans/run"
    if needed == "program":
        monkeypatch.setenv("CONFLICTDB_PROGRAM", path)
    else:
        monkeypatch.setattr(sys, "executable", path)
    for what in ("systemd", "systemd-once"):
        first, second = run("admin", "service", what).err.splitlines()
        assert first == (
            f"conflictdb: the printed unit cannot start this program: it needs {path}, "
            "and ProtectHome=yes hides /hidden."
        )
        assert second.endswith("and print the unit there.")
    assert [run("admin", "service", what).err for what in ("systemd-timer", "cron", "pg_cron")] == ["", "", ""]
