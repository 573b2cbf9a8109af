"""Manage one private PostgreSQL cluster: its data directory, its server, and its users.

Files in the home directory (mode 700, of the account that runs the server):

data           the data directory; named data.new until initdb has finished
lock           locked by a process that checks, initialises, starts or joins
alive          FIFO that every user keeps open for writing; supervise.sh stops the server at end-of-file
joined         token of the last user admitted by supervise.sh
held           exists while the server is kept running without users (`conflictdb server start`)
description    the running server as text; server.pid: its process; server.log: its log
"""

import errno
import fcntl
import os
import secrets
import select
import signal
import stat
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from conflictdb.embedded import configuration
from conflictdb.embedded.account import account_for
from conflictdb.embedded.discovery import Server, find_server
from conflictdb.embedded.options import Settings
from conflictdb.errors import ServerError

#: Seconds to wait for a server that recovers after a crash, or for one that writes its last checkpoint.
START_TIMEOUT_S: Final = 600.0
#: Seconds between two looks at a file that another process is about to write.
_POLL_S: Final = 0.01
#: Characters of a socket's path: the limit is 108 on Linux and 104 on macOS, PostgreSQL appends to it for its lock.
_LONGEST_SOCKET_PATH: Final = 80
#: A longer log is put aside at the next start.
_LARGEST_LOG_BYTES: Final = 10_000_000
_SOCKET_NAME: Final = ".s.PGSQL.5432"


@dataclass(frozen=True, slots=True)
class ServerStatus:
    """State of the embedded server.

    home : its directory
    running : whether it accepts connections
    held : whether it stays after its last user (`server start`)
    dsn : connection string while it runs, else None
    description : server and versions, empty when it does not run
    pid : of the server's first process, else None
    """

    home: Path
    running: bool
    held: bool = False
    dsn: str | None = None
    description: str = ""
    pid: int | None = None


class Cluster:
    """The cluster in a home directory; each process that uses it creates its own object.

    Parameters
    ----------
    settings : Settings
        Its directory, and where its programs may come from.
    durable : bool
        Whether a new data directory survives a crash of the machine. An existing one keeps its setting.
    say : callable
        Called with messages for the user, a line at a time.
    """

    def __init__(self, settings: Settings, *, durable: bool, say: Callable[[str], None]) -> None:
        self.settings = settings
        self.home = settings.home
        self.data = settings.home / "data"
        self._durable = durable
        self._say = say
        self._account = account_for(settings.home)

    def join(self, command: str = "join") -> int:
        """Become a user of the server, starting it if needed; return the file descriptor of this use.

        Closing the descriptor, or the end of the process, ends the use. `command` is a command of supervise.sh.

        Raises
        ------
        ServerError
            The home cannot be used, no server was found, or it does not start (with the end of its log).
        """
        try:
            self._prepare_home()
            with self._locked() as lock:
                alive = self._joined_running(command)
                if alive is not None:
                    return alive
                return self._start(command, lock)
        except OSError as error:
            hint = "; set CONFLICTDB_HOME to a directory of your own" if isinstance(error, PermissionError) else ""
            raise ServerError(f"the embedded database in {self.home} cannot be used: {error}{hint}") from error

    def leave_held(self) -> bool:
        """Undo `join("hold")`; return False if no server runs."""
        if not self.status().running:
            return False
        with self._locked():
            alive = self._joined_running("release")
        if alive is None:
            return False
        os.close(alive)
        return True

    def status(self) -> ServerStatus:
        """Return the state of the server, without starting or joining it."""
        try:
            pid, state, socket_directory = self._postmaster()
            held = (self.home / "held").exists()
        except PermissionError:
            raise ServerError(
                f"{self.home} belongs to another user; set CONFLICTDB_HOME to a directory of your own"
            ) from None
        if pid is None or state != "ready":
            return ServerStatus(self.home, running=False, pid=pid)
        return ServerStatus(self.home, True, held, configuration.dsn(socket_directory), self._described(), pid)

    def dsn(self, user: str = configuration.PLANNER) -> str:
        """Return the connection string of a user of the running server."""
        return configuration.dsn(self._postmaster()[2], user)

    def programs(self) -> Path:
        """Return the directory of programs for the data, as a start finds it: files of the account do not name it."""
        settings = replace(self.settings, download=False)
        return find_server(settings, self._account, self._data_major(), self._say).bin

    def _prepare_home(self) -> None:
        """Create the home of a new cluster; refuse a directory with other files."""
        home, account = self.home, self._account
        try:
            _make_parents(home)
            home.mkdir(mode=0o700)
        except FileExistsError:
            ours = {"data", "data.new", "lock"}
            names = {entry.name for entry in os.scandir(home)}
            if names and not names & ours:
                raise ServerError(
                    f"{home} holds other files: CONFLICTDB_HOME must be a new or an empty directory"
                ) from None
            foreign = home.stat().st_uid not in (0, account.uid)
            if foreign:
                raise ServerError(f"{home} does not belong to user {account.name}, who runs the server") from None
        opened = os.open(home.resolve(), os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            state = os.fstat(opened)
            if state.st_uid != account.uid:
                os.fchown(opened, account.uid, account.gid)
            if stat.S_IMODE(state.st_mode) != 0o700:
                os.fchmod(opened, 0o700)
        finally:
            os.close(opened)

    @contextmanager
    def _locked(self) -> Iterator[int]:
        path, create = self.home / "lock", os.O_CREAT
        if self._account.switch:  # root neither creates files in a directory of another account nor gives them away
            create = 0
            if not path.exists():
                self._account.run(["/bin/sh", "-c", 'umask 077 && : >>"$1"', "sh", path], os.environ)
                if not path.exists():
                    raise self._out_of_reach()
        lock = os.open(path, os.O_RDWR | create | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield lock
        finally:
            os.close(lock)

    def _joined_running(self, command: str) -> int | None:
        """Join the running server; return None if none runs, after waiting for a stopping one."""
        alive = self._opened_alive()
        if alive is not None and self._entered(alive, command):
            return alive
        pid = self._postmaster()[0]
        if pid is not None:
            # Its supervisor was killed: nothing would stop it, and its users are unknown.
            self._interrupt(pid)
            self._wait(lambda: self._postmaster()[0] is None, "the old server does not stop")
        return None

    def _interrupt(self, pid: int) -> None:
        """Send SIGINT as the account."""
        if self._account.switch:
            self._account.run(["/bin/sh", "-c", 'kill -INT "$1"', "sh", str(pid)], os.environ)
        else:
            os.kill(pid, signal.SIGINT)

    def _opened_alive(self) -> int | None:
        try:
            alive = os.open(self.home / "alive", os.O_WRONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        except OSError as error:
            if error.errno in (errno.ENOENT, errno.ENXIO):
                return None
            raise
        if not stat.S_ISFIFO(os.fstat(alive).st_mode):
            os.close(alive)
            raise ServerError(f"{self.home / 'alive'} is no FIFO: remove it")
        return alive

    def _entered(self, alive: int, command: str) -> bool:
        """Return whether this process has joined a ready server; if not, close `alive`."""
        entered = False
        try:
            entered = self._let_in(alive, command) and self._ready(alive)
        finally:
            if not entered:
                os.close(alive)
        return entered

    def _let_in(self, alive: int, command: str) -> bool:
        """Return whether the supervisor admitted this process; False if it has ended."""
        token = secrets.token_hex(8)
        try:
            os.write(alive, f"{command} {token}\n".encode())
        except BrokenPipeError:
            return False
        return self._wait(lambda: self._read("joined") == token, "its supervisor does not answer", alive)

    def _ready(self, alive: int) -> bool:
        """Return whether the server is ready; False if it has ended."""
        return self._wait(lambda: self._postmaster()[1] == "ready", "the server is not ready", alive)

    def _wait(self, reached: Callable[[], bool], complaint: str, alive: int | None = None) -> bool:
        """Wait until `reached` is true; return False if the other end of `alive` closes first."""
        began = time.monotonic()
        is_said = False
        while not reached():
            if alive is not None and _other_end_closed(alive):
                return False
            waited_s = time.monotonic() - began
            if waited_s > START_TIMEOUT_S:
                raise ServerError(f"{complaint} after {waited_s:.0f} s; see {self.home / 'server.log'}")
            if waited_s > 5.0 and not is_said:
                is_said = True
                self._say(f"waiting for the embedded database (it may be recovering); see {self.home / 'server.log'}")
            time.sleep(_POLL_S)
        return True

    def _start(self, command: str, lock: int) -> int:
        account = self._account
        if account.switch and account.run(["/bin/sh", "-c", 'cd "$1"', "sh", self.home], os.environ).returncode:
            raise self._out_of_reach()
        server = find_server(self.settings, account, self._data_major(), self._say)
        self._say(f"embedded database: {server}, data in {self.home}")
        if not self.data.exists():
            self._initialise(server, lock)
        log = self.home / "server.log"
        log_from = log.lstat().st_size if os.path.lexists(log) else 0
        if log_from > _LARGEST_LOG_BYTES:
            log.replace(self.home / "server.log.old")
            log_from = 0
        alive = self._launch(server)
        if self._entered(alive, command):
            return alive
        said = self._read("server.log", log_from).splitlines()
        raise ServerError("\n".join([f"{server} does not start; the end of {log}:", *said[-15:]]))

    def _out_of_reach(self) -> ServerError:
        return ServerError(
            f"user {self._account.name}, who runs the server, cannot reach {self.home}: set CONFLICTDB_HOME to a"
            " directory that others may pass through, such as one below /var/lib"
        )

    def _data_major(self) -> int | None:
        """Return the major version of the data directory, None if there is none yet."""
        if not self.data.exists():
            return None
        try:
            return int(self._account.text_of(self.data / "PG_VERSION"))
        except (FileNotFoundError, ValueError):
            raise ServerError(f"{self.data} is no PostgreSQL data directory: move it away") from None

    def _initialise(self, server: Server, lock: int) -> None:
        """Create the data directory."""
        script = Path(__file__).with_name("initialise.sh").read_text()
        durable = "yes" if self._durable else "no"
        command = ["/bin/sh", "-c", script, "initialise", str(self.home), str(server.bin), durable]
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env={**server.environ, "HOME": str(self.home)},
            start_new_session=True,
            pass_fds=[lock],  # held until the last of its processes ends
            **self._account.switch,
        ) as process:
            try:
                said, _ = process.communicate(configuration.initial(durable=self._durable))
            except BaseException:
                os.killpg(process.pid, signal.SIGKILL)
                raise
        if process.returncode:
            last = said.strip().splitlines()[-15:]
            raise ServerError("\n".join([f"{server} could not make a data directory in {self.home}:", *last]))

    def _launch(self, server: Server) -> int:
        """Start the server under its supervisor; return the write end of the FIFO, open from the beginning."""
        reading, alive = self._made_alive()
        try:
            self._supervise(server, reading)
        except BaseException:
            os.close(alive)
            raise
        finally:
            os.close(reading)
        return alive

    def _made_alive(self) -> tuple[int, int]:
        """Create a FIFO for a new server and return its read and write end."""
        fresh = self.home / "alive.new"
        fresh.unlink(missing_ok=True)
        os.mkfifo(fresh, 0o600)
        # A FIFO opens for writing only if it has a reader, and for reading without delay only if non-blocking.
        reading = os.open(fresh, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            if not stat.S_ISFIFO(os.fstat(reading).st_mode):
                raise ServerError(f"{fresh} was replaced while the server started")
            os.fchown(reading, self._account.uid, self._account.gid)
            alive = os.open(fresh, os.O_WRONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        except BaseException:
            os.close(reading)
            raise
        fresh.rename(self.home / "alive")
        os.set_blocking(reading, True)
        return reading, alive

    def _supervise(self, server: Server, reading: int) -> None:
        socket_directory = self._socket_directory()
        script = Path(__file__).with_name("supervise.sh").read_text()
        arguments = [script, "supervise", str(self.home), str(socket_directory), str(server)]
        arguments += [str(server.bin / "postgres"), "-D", str(self.data.resolve()), "-p", "5432"]
        for name, value in configuration.forced(socket_directory):
            arguments += ["-c", f"{name}={value}"]
        # The outer shell ends at once, so that no process has to wait for the supervisor as its child.
        detach = 'exec 3<&0; /bin/sh -c "$@" <&3 3<&- >/dev/null 2>&1 &'
        subprocess.run(
            ["/bin/sh", "-c", detach, "detach", *arguments],
            stdin=reading,
            env={**server.environ, "HOME": str(self.home)},
            start_new_session=True,
            check=True,
            **self._account.switch,
        )

    def _socket_directory(self) -> Path:
        # libpq reads a comma as a separator of hosts.
        if len(os.fsencode(self.home / _SOCKET_NAME)) <= _LONGEST_SOCKET_PATH and "," not in str(self.home):
            return self.home
        shortest = min(tempfile.gettempdir(), "/tmp", key=len)  # noqa: S108 (mkdtemp makes it private)
        short = Path(tempfile.mkdtemp(prefix="conflictdb-", dir=shortest))
        os.chown(short, self._account.uid, self._account.gid)
        return short

    def _postmaster(self) -> tuple[int | None, str, str]:
        """Return process, state and socket directory of the server, (None, "", "") if none runs."""
        try:
            lines = self._account.text_of(self.data / "postmaster.pid").splitlines()
            pid = int(lines[0])
        except (FileNotFoundError, ValueError, IndexError):
            return None, "", ""
        if pid <= 0 or not _is_server_of(pid, self.data):
            return None, "", ""
        sockets = lines[4] if len(lines) > 4 else ""
        if sockets and not self._is_socket_directory(Path(sockets)):
            raise ServerError(f"{self.data / 'postmaster.pid'} names {sockets}, no directory of {self._account.name}")
        return pid, lines[7].strip() if len(lines) > 7 else "starting", sockets

    def _is_socket_directory(self, place: Path) -> bool:
        """Return whether clients may look for the socket there."""
        try:
            state = place.lstat()
        except OSError:
            return False
        return place.is_absolute() and stat.S_ISDIR(state.st_mode) and state.st_uid == self._account.uid

    def _described(self) -> str:
        return self._read("description") or "PostgreSQL"

    def _read(self, name: str, start: int = 0) -> str:
        try:
            return self._account.text_of(self.home / name, start).strip()
        except FileNotFoundError:
            return ""


def _make_parents(home: Path) -> None:
    """Create the directories above a home; those created by root are open to the account that runs the server."""
    for parent in [*reversed(home.parent.parents), home.parent]:
        if not parent.exists():
            parent.mkdir(exist_ok=True)
            if os.geteuid() == 0:
                parent.chmod(0o755)


def _other_end_closed(writing: int) -> bool:
    poll = select.poll()
    poll.register(writing, 0)
    return any(event & (select.POLLERR | select.POLLHUP | select.POLLNVAL) for _, event in poll.poll(0))


def _is_server_of(pid: int, data: Path) -> bool:
    """Return whether a process is the server of a data directory."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, PermissionError):  # our own server never refuses the signal
        return False
    try:
        arguments = Path("/proc", str(pid), "cmdline").read_bytes().split(b"\0")
    except OSError:  # the system hides it: trust the number
        return True
    return os.fsencode(data.resolve()) in arguments
