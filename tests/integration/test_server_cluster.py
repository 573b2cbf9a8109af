"""The private cluster for real: the processes that keep it running, its end, and crashes that it survives.

Users are processes of their own, so that they can be killed. Each test gets a copy of one initialised home.
"""

import errno
import fcntl
import os
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import psycopg
import pytest
from commands import STRAIT
from databases import server_directory
from patience import WAIT_S, killed_after, patient_command

from conflictdb import connect
from conflictdb import embedded as server
from conflictdb.embedded.account import account_for, is_safe_program
from conflictdb.embedded.cluster import Cluster
from conflictdb.errors import ServerError

#: Seconds for something that takes milliseconds on an idle machine.
PATIENCE_S = WAIT_S

USER = """
import sys
from pathlib import Path
from conflictdb import embedded as server
with server.embedded(Path(sys.argv[1]), durable=False) as embedded:
    print(embedded.status().pid, flush=True)
    sys.stdin.readline()
"""


class User:
    """A process that uses a server until it gets a line to leave, or is killed."""

    def __init__(self, home: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", USER, str(home)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def server_pid(self) -> int:
        """Wait until it has joined; return the process of the server it got."""
        assert self.process.stdout is not None
        with killed_after(self.process, PATIENCE_S):
            return int(self.process.stdout.readline())

    def leave(self) -> None:
        """End it the ordinary way."""
        self.process.communicate("\n", timeout=PATIENCE_S)
        assert self.process.returncode == 0

    def kill(self) -> None:
        """End it with kill -9."""
        self.process.kill()
        self.process.communicate(timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def places() -> Iterator[Path]:
    """Return a directory for homes."""
    # Not tmp_path: that is closed to the account that runs the server of root.
    root = Path(tempfile.mkdtemp(prefix="conflictdb-", dir=server_directory()))
    root.chmod(0o755)
    yield root
    shutil.rmtree(root)


@pytest.fixture(scope="module")
def initialised(places: Path) -> Path:
    """Return the home of a cluster to copy."""
    home = places / "initialised"
    server.embedded(home, durable=False).stop()
    await_stop(home)
    return home


@pytest.fixture
def new_home(places: Path) -> Iterator[Path]:
    """Return a directory that is not there yet; whatever runs in it in the end must have stopped."""
    home = Path(tempfile.mkdtemp(dir=places))
    home.rmdir()
    yield home
    await_stop(home)
    shutil.rmtree(home, ignore_errors=True)


@pytest.fixture
def home(initialised: Path, new_home: Path) -> Path:
    """Return the home of a cluster that does not run."""
    copy(initialised, new_home)
    return new_home


@pytest.fixture
def user(home: Path) -> Iterator[Callable[[], User]]:
    """Return a function that starts users of the home; those that are left in the end are killed."""
    with ExitStack() as stack:

        def start() -> User:
            started = User(home)
            stack.callback(started.kill)
            return started

        yield start


def copy(home: Path, to: Path) -> None:
    """Copy a home with the owners of its files."""
    subprocess.run(["cp", "-a", home, to], check=True)


def await_stop(home: Path) -> None:
    """Wait until neither the server nor its supervisor runs."""
    await_that(lambda: server.status(home).pid is None, "the server stops")
    await_that(lambda: not has_reader(home / "alive"), "the supervisor ends")


def has_reader(fifo: Path) -> bool:
    """Return whether a process has the read end open."""
    try:
        os.close(os.open(fifo, os.O_WRONLY | os.O_NONBLOCK))
    except OSError as error:
        if error.errno not in (errno.ENXIO, errno.ENOENT):
            raise
        return False
    return True


def await_that(reached: Callable[[], bool], what: str) -> None:
    """Wait until something is so."""
    end = time.monotonic() + PATIENCE_S
    while not reached():
        assert time.monotonic() < end, f"{what}: not within {PATIENCE_S} s"
        time.sleep(0.01)


def query(dsn: str, statement: str) -> Any:
    """Return the one value that a statement gives."""
    with psycopg.connect(dsn) as conn:
        row = conn.execute(statement.encode()).fetchone()
        return row[0] if row else None


def test_new_home_is_private_and_serves_its_database(new_home: Path) -> None:
    """A new cluster has its database, takes connections on its socket alone, and no other user can enter."""
    said: list[str] = []
    with server.embedded(new_home, say=said.append) as embedded:
        assert query(embedded.dsn, "SELECT current_database()") == "conflictdb"
        expected = {"listen_addresses": "", "jit": "off", "fsync": "on", "TimeZone": "UTC", "server_encoding": "UTF8"}
        assert {name: query(embedded.dsn, f"SHOW {name}") for name in expected} == expected
        assert query(embedded.admin_dsn, "SHOW unix_socket_directories").strip('"') == str(new_home)
        assert query(embedded.dsn, "SELECT count(*) FROM pg_available_extensions WHERE name = 'postgis'") == 1
        with server.embedded(new_home, say=said.append):  # it runs already: nothing to say
            pass
    assert stat.S_IMODE(new_home.stat().st_mode) == 0o700
    assert len([line for line in said if "PostgreSQL" in line and "PostGIS" in line and str(new_home) in line]) == 1
    owners = {path.lstat().st_uid for path in new_home.iterdir()}
    assert owners == {account_for(new_home).uid}
    assert owners != {0}


def test_simultaneous_first_starts_give_one_server(new_home: Path) -> None:
    """Processes that start at once on a home that is not there yet share one data directory and one server."""
    users = [User(new_home) for _ in range(4)]
    try:
        assert len({user.server_pid() for user in users}) == 1
    finally:
        for user in users:
            user.kill()


def test_kill_of_the_only_user_leaves_nothing(home: Path, user: Callable[[], User]) -> None:
    """The server stops although its user had no chance to say goodbye."""
    only = user()
    pid = only.server_pid()
    only.kill()
    await_stop(home)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_server_stays_until_the_last_user_leaves(home: Path, user: Callable[[], User]) -> None:
    """The process that started the server does not matter, nor how its users end."""
    first, second, third = user(), user(), user()
    pid = first.server_pid()
    assert (second.server_pid(), third.server_pid()) == (pid, pid)
    first.kill()
    second.leave()
    time.sleep(0.2)
    assert server.status(home).pid == pid
    third.leave()
    await_stop(home)


def test_kill_while_it_starts_leaves_nothing(home: Path, user: Callable[[], User]) -> None:
    """Whenever a starting process is killed, the server stops or was never started."""
    for delay_s in (0.2, 0.25, 0.3):
        starting = user()
        time.sleep(delay_s)
        starting.kill()
        await_stop(home)
    with server.embedded(home) as embedded:
        assert query(embedded.dsn, "SELECT 1") == 1


DEAF_AT_FIRST = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
time.sleep(0.5)
signal.signal(signal.SIGINT, lambda *_: sys.exit())
while True:
    time.sleep(0.01)
"""


@pytest.mark.parametrize("start", ["", "sleep 0.5; "], ids=["deaf", "not there yet"])
def test_server_that_does_not_hear_yet_is_told_again_to_stop(tmp_path: Path, start: str) -> None:
    """The last user may leave before the server runs or has set up its signals: the supervisor ends all the same."""
    os.mkfifo(tmp_path / "alive")
    reading = os.open(tmp_path / "alive", os.O_RDONLY | os.O_NONBLOCK)
    writing = os.open(tmp_path / "alive", os.O_WRONLY)
    os.set_blocking(reading, True)
    script = Path(server.__file__).with_name("supervise.sh").read_text()
    assert '    "$@" &' in script
    script = script.replace('    "$@" &', f'    {start}"$@" &')
    supervisor = subprocess.Popen(
        ["/bin/sh", "-c", script, "supervise", tmp_path, tmp_path, "test", sys.executable, "-c", DEAF_AT_FIRST],
        stdin=reading,
    )
    os.close(reading)
    os.close(writing)
    try:
        assert supervisor.wait(PATIENCE_S) == 0
    finally:
        supervisor.kill()


def test_joining_a_server_that_stops_gives_a_working_one(home: Path) -> None:
    """A user that comes just when the last one leaves gets a server that stays."""
    for _ in range(5):
        server.embedded(home).stop()
        with server.embedded(home) as embedded:
            assert query(embedded.dsn, "SELECT 1") == 1


def test_stop_may_be_called_twice(home: Path) -> None:
    """The second call does nothing."""
    embedded = server.embedded(home)
    embedded.stop()
    embedded.stop()
    await_stop(home)
    assert embedded.status().dsn is None


def test_held_server_runs_without_users_until_released(home: Path) -> None:
    """`start_holder` keeps the server, users come and go, `stop_holder` waits until it is down."""
    held = server.start_holder(home)
    assert (held.running, held.held) == (True, True)
    assert held.dsn is not None
    assert query(held.dsn, "SELECT 1") == 1
    server.embedded(home).stop()
    assert server.start_holder(home) == held
    assert server.status(home) == held
    stopped = server.stop_holder(home)
    assert (stopped.running, stopped.held, stopped.pid, stopped.dsn) == (False, False, None, None)
    assert server.stop_holder(home) == stopped


def test_release_while_used_stops_later(home: Path) -> None:
    """A server whose holder has stopped runs on for its users."""
    server.start_holder(home)
    with server.embedded(home) as embedded:
        left = server.stop_holder(home)
        assert (left.running, left.held) == (True, False)
        assert query(embedded.dsn, "SELECT 1") == 1
    await_stop(home)


def test_status_and_stop_of_a_home_that_is_not_there(new_home: Path) -> None:
    """Asking makes nothing."""
    assert server.status(new_home).running is False
    assert server.stop_holder(new_home).running is False
    assert not new_home.exists()


def test_crashed_server_is_replaced(home: Path, user: Callable[[], User]) -> None:
    """After the server was killed the next user gets another one, with the data, while an old user is still there."""
    old = user()
    pid = old.server_pid()
    os.kill(pid, signal.SIGKILL)
    await_that(lambda: server.status(home).pid is None, "the server ends")
    with server.embedded(home) as embedded:
        assert embedded.status().pid != pid
        assert query(embedded.dsn, "SELECT 1") == 1


def test_server_without_supervisor_is_replaced(home: Path, user: Callable[[], User]) -> None:
    """A server whose supervisor was killed would never stop: the next user gets a supervised one."""
    old = user()
    pid = old.server_pid()
    supervisor = parent_of(parent_of(pid))
    os.kill(supervisor, signal.SIGKILL)
    await_that(lambda: not has_reader(home / "alive"), "the supervisor ends")
    old.kill()
    with server.embedded(home) as embedded:
        assert embedded.status().pid != pid
        assert query(embedded.dsn, "SELECT 1") == 1


def parent_of(pid: int) -> int:
    """Return the parent of a process."""
    process = Path("/proc", str(pid), "stat")
    if process.exists():  # minimal systems lack ps
        return int(process.read_text().rpartition(")")[2].split()[1])
    answer = subprocess.run(["ps", "-o", "ppid=", "-p", str(pid)], capture_output=True, text=True, check=True)
    return int(answer.stdout)


def test_number_of_a_dead_server_may_be_taken(home: Path) -> None:
    """A lock file left by a crash names a process that is another one by now; the server starts all the same."""
    (home / "data/postmaster.pid").write_text(f"{os.getppid()}\n{home}/data\n1700000000\n5432\n{home}\n\n\nready\n")
    with server.embedded(home) as embedded:
        assert query(embedded.dsn, "SELECT 1") == 1


def test_interrupted_initialisation_is_repeated(home: Path) -> None:
    """A half-made data directory has another name; the next start begins afresh."""
    (home / "data").rename(home / "data.new")
    with server.embedded(home, durable=False) as embedded:
        assert query(embedded.dsn, "SHOW fsync") == "off"
    assert not (home / "data.new").exists()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_stopped_while_initialising_leaves_nothing_broken(new_home: Path, number: signal.Signals) -> None:
    """An interrupt ends initdb too; after kill -9 the next user waits until initdb is done, and goes on from there."""
    command = patient_command("status")
    heeded = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(
        command, env={**os.environ, "CONFLICTDB_HOME": str(new_home)}, stderr=subprocess.PIPE, text=True
    )
    signal.signal(signal.SIGINT, heeded)
    await_that(lambda: (new_home / "data.new/base").exists() or process.poll() is not None, "initdb works")
    process.send_signal(number)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode != 0
    assert "Traceback" not in err
    if number != signal.SIGKILL:
        assert is_free(new_home / "lock"), "nothing of initdb is left, for that holds the lock"
    with server.embedded(new_home, durable=False) as embedded:
        assert query(embedded.dsn, "SELECT current_database()") == "conflictdb"
    assert not (new_home / "data.new").exists()


def is_free(lock: Path) -> bool:
    """Return whether no process has locked a file."""
    with lock.open("r+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


@pytest.mark.parametrize(("name", "is_short"), [("deep" * 40, False), ("a,b", False), ("ä 'b' \"c\" $d", True)])
def test_any_path_will_do(initialised: Path, new_home: Path, name: str, is_short: bool) -> None:
    """A path that is unsuitable for a socket gets a short private directory, gone afterwards."""
    new_home.mkdir(mode=0o755)
    new_home.chmod(0o755)
    home = new_home / name
    copy(initialised, home)
    with server.embedded(home) as embedded:
        assert query(embedded.dsn, "SELECT 1") == 1
        socket_directory = Path(psycopg.conninfo.conninfo_to_dict(embedded.dsn)["host"])
        assert stat.S_IMODE(socket_directory.stat().st_mode) == 0o700
        assert (socket_directory == home) == is_short
    await_stop(home)
    assert socket_directory.exists() == is_short


def test_variables_of_the_user_change_nothing(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """PG* variables lead neither the server nor the connection astray."""
    odd = {"PGHOST": "192.0.2.1", "PGHOSTADDR": "192.0.2.1", "PGPORT": "1", "PGUSER": "nobody", "PGDATA": "/nowhere"}
    odd |= {"PGOPTIONS": "-c jit=on", "PGCHANNELBINDING": "require", "PGTARGETSESSIONATTRS": "standby"}
    odd |= {"PGDATABASE": "other", "PGREQUIREAUTH": "scram-sha-256", "LC_ALL": "xx_XX", "PROJ_LIB": "/nowhere"}
    for name, value in odd.items():
        monkeypatch.setenv(name, value)
    with server.embedded(home) as embedded:
        assert query(embedded.dsn, "SELECT current_database() || ' ' || current_user") == "conflictdb planner"
        assert query(embedded.dsn, "SHOW jit") == "off"


def test_data_of_another_major_version_ask_for_their_own_server(home: Path) -> None:
    """The server that made the data is missing: the error says which it is and how to start afresh."""
    (home / "data/PG_VERSION").write_text("99\n")
    settings = server.Settings(home, home.parent / "empty-cache", download=False)
    with pytest.raises(ServerError, match=r"are of PostgreSQL 99, .*\n.*CONFLICTDB_HOME"):
        server.embedded(settings=settings)


def test_data_directory_of_something_else_is_refused(new_home: Path) -> None:
    """A directory called data that PostgreSQL did not make is left alone."""
    (new_home / "data").mkdir(parents=True)
    with pytest.raises(ServerError, match="is no PostgreSQL data directory"):
        server.embedded(new_home)


def test_home_with_other_files_is_refused(new_home: Path) -> None:
    """CONFLICTDB_HOME at a directory that is in use for something else changes nothing there."""
    new_home.mkdir(mode=0o755)
    (new_home / "letter.txt").write_text("dear")
    before = new_home.stat()
    with pytest.raises(ServerError, match="must be a new or an empty directory"):
        server.embedded(new_home)
    after = new_home.stat()
    # It was read, so not its time of access.
    assert (after.st_mode, after.st_uid, after.st_mtime_ns) == (before.st_mode, before.st_uid, before.st_mtime_ns)
    assert [one.name for one in new_home.iterdir()] == ["letter.txt"]


def test_server_that_does_not_start_says_why(home: Path) -> None:
    """The error carries the end of the server's log, and nothing is left running."""
    with (home / "data/conflictdb.conf").open("a") as file:
        file.write("shared_buffers = 'lots'\n")
    with pytest.raises(ServerError, match=r"does not start; the end of (?s:.*)shared_buffers"):
        server.embedded(home)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can put a directory where others cannot reach it")
def test_home_out_of_reach_of_its_account_is_said() -> None:
    """As root, a home below a private directory is refused with the reason."""
    with tempfile.TemporaryDirectory() as private, pytest.raises(ServerError, match=r"cannot reach .* CONFLICTDB_HOME"):
        server.embedded(Path(private, "home"))


as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root serves another account")


def foreign(path: Path, text: str = "", *, like: Path) -> Path:
    """Write a file of the account that owns another path."""
    path.write_text(text)
    path.chmod(0o755)
    os.chown(path, like.stat().st_uid, like.stat().st_gid)
    return path


@as_root
def test_root_runs_no_program_that_the_account_names(home: Path, places: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The server's notes are files of its account, and so may be programs on the search path."""
    evil = places / "evil"
    evil.mkdir(exist_ok=True)
    foreign(evil / "psql", "#!/bin/sh\n", like=home)
    monkeypatch.setenv("PATH", f"{evil}:{os.environ['PATH']}")
    with server.embedded(home) as embedded:
        foreign(home / "data/postmaster.opts", f'{evil}/postgres "-D" "{home}/data"\n', like=home)
        found = server.find_psql(embedded)
    assert found is not None
    assert found.path.resolve().stat().st_uid == 0
    assert evil not in found.path.parents
    shutil.rmtree(evil)


@as_root
@pytest.mark.parametrize("kind", ["file", "directory", "above", "link"])
def test_root_runs_only_programs_of_root(places: Path, kind: str) -> None:
    """A program, a directory on its path and a link to it may each belong to another account."""
    account = account_for(places / "new")
    folder = places / f"programs-{kind}" / "bin"
    folder.mkdir(parents=True)
    program = folder / "psql"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    assert is_safe_program(program)
    if kind == "link":
        other = places / "programs-other"
        other.mkdir(mode=0o755)
        (other / "psql").symlink_to(program)
        os.chown(other, account.uid, account.gid)
        program = other / "psql"
    else:
        os.chown({"file": program, "directory": folder, "above": folder.parent}[kind], account.uid, account.gid)
    assert not is_safe_program(program)


@as_root
@pytest.mark.parametrize("kind", ["link", "fifo", "root"])
def test_root_reads_only_files_of_the_account(home: Path, places: Path, kind: str) -> None:
    """A link would show a file of root, and a FIFO would stop it for ever."""
    secret = places / f"secret-{kind}"
    secret.write_text("hidden\n")
    with server.embedded(home) as embedded:
        file = home / "description"
        file.unlink()
        if kind == "link":
            file.symlink_to(secret)
        elif kind == "fifo":
            os.mkfifo(file)
        else:
            shutil.copy(secret, file)
        assert embedded.status().description == "PostgreSQL"


@as_root
def test_root_asks_no_host_that_the_account_names(home: Path) -> None:
    """The directory of the socket comes from a file of the account; the name of a host would reach the network."""
    with server.embedded(home) as embedded:
        lines = (home / "data/postmaster.pid").read_text().splitlines()
        for place in ("elsewhere.example", "/var/run", "@abstract"):
            foreign(home / "data/postmaster.pid", "\n".join([*lines[:4], place, *lines[5:]]) + "\n", like=home)
            with pytest.raises(ServerError, match=f"names {place}, no directory of"):
                embedded.status()
        foreign(home / "data/postmaster.pid", "\n".join(lines) + "\n", like=home)


@as_root
def test_root_interrupts_only_processes_of_the_account(home: Path) -> None:
    """The file that names the server's process may name one of root whose arguments have the data directory."""
    data = str((home / "data").resolve())
    with subprocess.Popen(["/bin/sh", "-c", "sleep 60 & wait", data]) as mine:
        text = f"{mine.pid}\n{data}\n1700000000\n5432\n{home}\n\n\nready\n"
        foreign(home / "data/postmaster.pid", text, like=home)
        Cluster(server.Settings(home, home), durable=False, say=print)._interrupt(mine.pid)
        with pytest.raises(subprocess.TimeoutExpired):
            mine.wait(0.5)
        mine.kill()


@as_root
def test_root_gives_no_file_away(home: Path, places: Path) -> None:
    """The lock of a home may be a file of root that the account put there by a name: it keeps its owner."""
    lock = home / "lock"
    lock.unlink(missing_ok=True)
    lock.touch()
    with server.embedded(home) as embedded:
        assert query(embedded.dsn, "SELECT 1") == 1
    assert lock.stat().st_uid == 0


def test_its_everyday_user_is_no_superuser(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in a cluster from before there was one, and it may do whatever commands do."""
    monkeypatch.setenv("CONFLICTDB_HOME", str(home))
    with server.embedded(home, durable=False) as embedded:
        with psycopg.connect(embedded.admin_dsn, autocommit=True) as conn:
            conn.execute("DROP ROLE planner")
        for _ in range(2):
            with connect() as db:
                db.load(STRAIT)
                assert db.scene("strait").detect().conflicts == 7
        with psycopg.connect(embedded.dsn) as conn:
            query = (
                "SELECT rolname, rolsuper OR rolcreaterole OR rolbypassrls FROM pg_roles WHERE rolname = current_user"
            )
            assert conn.execute(query.encode()).fetchone() == ("planner", False)
            conn.execute("CREATE TABLE mine (id integer)")
            assert conn.execute("SELECT 'planner.mine'::regclass").fetchone() is not None
