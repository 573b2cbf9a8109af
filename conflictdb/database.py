"""The whole product on one database connection: load, detect, read, export.

`connect` is the way in. The command line is written against this module; so can be any other program.
"""

import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any, Final, Self

import psycopg

from conflictdb import inputs, loading
from conflictdb.db import attached, schema, store
from conflictdb.errors import (
    IncompleteWarning,
    InvalidInput,
    NotPermitted,
    SchemaMissing,
    SchemaOutdated,
    ServerError,
    StoreError,
)
from conflictdb.io import scene_text, write_lines
from conflictdb.io.reading import is_parquet
from conflictdb.io.whole_files import whole_file
from conflictdb.lending import Lent, lend
from conflictdb.loading import Loaded
from conflictdb.methods import Method
from conflictdb.model import Area, Scene, Track
from conflictdb.pipeline.memory import LEAST_MEMORY_MB, MEMORY_MB
from conflictdb.results import Approach, Conflict, ConflictEvent, Explanation, Kind, Listing, SceneState, Stream

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from sqlalchemy import Connection, Engine
    from sqlalchemy.orm import Session

    from conflictdb.advice.advise import Advice
    from conflictdb.db.detect import Progress, Run
    from conflictdb.db.write_back import WrittenBack

_log = logging.getLogger(__name__)

DEMO_SCENE: Final = "strait"


@dataclass(frozen=True, slots=True)
class Status:
    """State of a database.

    database : its name and where it is
    server : versions of PostgreSQL and PostGIS
    revision : of the schema
    worker_count : workers that are connected to it
    scenes : all scenes, by name
    """

    database: str
    server: str
    revision: str
    worker_count: int
    scenes: tuple[store.SceneStatus, ...]


def connect(
    target: "str | psycopg.Connection[Any] | Engine | Connection | Session | None" = None,
    *,
    create: bool | None = None,
    say: Callable[[str], None] = _log.info,
) -> "Database":
    """Return a database to work with.

    Parameters
    ----------
    target : str, psycopg connection, SQLAlchemy engine, connection or session (driver psycopg), or None
        Connection string or URI of PostgreSQL with PostGIS; a connection, engine or session of the caller's, which
        stays open when the database is closed; None is the embedded database, which is started when needed. What is
        done within a transaction of the caller's is a part of it, and of a session's always; a detection needs a
        connection without one.
    create : bool, optional
        Create or upgrade the schema if need be. By default that is done in the embedded database only.
    say : callable
        Told in a line what takes a while: starting a server, creating the schema.

    Raises
    ------
    SchemaError
        The database has no schema of conflictdb, or one of another version.
    ServerError
        No usable PostgreSQL with PostGIS.
    StoreError
        Any other error of the database.
    """
    if target is None:
        from conflictdb import server

        embedded = server.embedded(say=say)
        try:
            return _opened(embedded.dsn, embedded.stop, create is not False, say, embedded.admin_dsn)
        except BaseException:
            embedded.stop()
            raise
    if isinstance(target, str):
        return _opened(target, _nothing, bool(create), say)
    return _borrowed(target)


def _opened(
    dsn: str, release: Callable[[], None], create: bool, say: Callable[[str], None], admin_dsn: str | None = None
) -> "Database":
    """Open a database; with `admin_dsn`, the embedded one, whose everyday user has no right to make the schema."""
    try:
        connection = store.connect(dsn)
    except StoreError as error:
        if admin_dsn is None or not create:
            raise ServerError(f"cannot connect: {error}") from error.__cause__
        schema.admit(admin_dsn, dsn)  # a cluster from before there was such a user
        connection = store.connect(dsn)
    try:
        try:
            _check(connection)
        except (SchemaMissing, SchemaOutdated, NotPermitted) as unfit:
            if not create or (isinstance(unfit, NotPermitted) and admin_dsn is None):
                raise
            say("creating the schema" if isinstance(unfit, SchemaMissing) else "upgrading the schema")
            schema.upgrade(admin_dsn or dsn)
            if admin_dsn is not None:
                schema.admit(admin_dsn, dsn)
            _check(connection)
    except BaseException:
        connection.close()
        raise
    return Database(connection, [connection.close, release])


def _borrowed(target: "psycopg.Connection[Any] | Engine | Connection | Session") -> "Database":
    if isinstance(target, psycopg.Connection):
        _check(target)
        return Database(target)
    lent, release = lend(target)
    database = Database(lent, release)
    try:
        _check(database.connection)
    except BaseException:
        database.close()
        raise
    return database


def _check(connection: "psycopg.Connection[Any]") -> None:
    with store.transaction(connection):
        schema.check(connection)


def _nothing() -> None:
    """Release nothing: it belongs to the caller."""


class Database:
    """A database of scenes; made by `connect`, closed by `close` or at the end of a ``with``.

    Not for several threads at once: open one each.
    """

    def __init__(
        self, connection: "psycopg.Connection[Any] | Lent", release: Sequence[Callable[[], None]] = ()
    ) -> None:
        self._connection = connection
        self._release = list(release)

    @property
    def connection(self) -> "psycopg.Connection[Any]":
        """The psycopg connection that all is done on."""
        return self._connection.connection() if isinstance(self._connection, Lent) else self._connection

    def close(self) -> None:
        """Close the connection, and stop the embedded database if nobody else uses it. May be called again."""
        while self._release:
            self._release.pop(0)()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def load(
        self,
        path: str | Path,
        scene: str | None = None,
        *,
        replace: bool = False,
        max_speed_kn: float | None = None,
        layers: Sequence[str] = (),
        skip_invalid: bool = False,
    ) -> str:
        """Load one file, all or nothing, and return the name of its scene.

        Parameters
        ----------
        path : path
            Any file that `conflictdb.io.read` reads.
        scene : str, optional
            Scene to load into; default is the one that the file names, else the name of the file.
        replace : bool
            Remove the objects of the scene that the file does not contain; by default objects are only added and
            updated. A file of settings without objects empties its scene then.
        max_speed_kn : float, optional
            Tracks that are faster on a leg are refused, see `conflictdb.io.read`.
        layers : sequence of str
            Of files that OGR opens, the layers to read; by default all.
        skip_invalid : bool
            Load the rest where objects are refused, see `conflictdb.io.read`.

        Raises
        ------
        InvalidInput
            Names the file and, for each mistake, the object, the field and the rule; nothing has been changed. A file
            without objects is refused, too.

        Warns
        -----
        UserWarning
            For each remark: what breaks no rule, but may not be meant; and for each object that was left out.
        """
        loaded = self.load_files(
            [path], scene, replace=replace, max_speed_kn=max_speed_kn, layers=layers, skip_invalid=skip_invalid
        )[0]
        for one in (*loaded.remarks, *loaded.invalid):
            warnings.warn(str(one), UserWarning, stacklevel=2)
        return loaded.scene

    def load_files(
        self,
        paths: Sequence[str | Path],
        scene: str | None = None,
        *,
        replace: bool = False,
        max_speed_kn: float | None = None,
        layers: Sequence[str] = (),
        skip_invalid: bool = False,
        max_file_mb: float | None = None,
    ) -> list[Loaded]:
        """Load some files as `load` does, files of one scene as if they were one; return what it did to each scene.

        All files are read and checked before the first scene is changed; each scene is changed in one transaction.
        One file of GeoParquet is read and sent some objects at a time, in that transaction, unless some may be left
        out: memory does not grow with it.
        """
        return loading.load_files(
            self.connection,
            paths,
            scene,
            replace=replace,
            max_speed_kn=max_speed_kn,
            layers=layers,
            skip_invalid=skip_invalid,
            max_file_mb=max_file_mb,
        )

    def _settings(self, scene: str) -> Scene:
        """Return the settings of a scene; raises InvalidInput, naming the known ones, if there is none."""
        with self._transaction():
            return store.read_settings(self.connection, store.scene_id(self.connection, scene))

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Read or write in one transaction; within one of the caller's, as a part of it."""
        with store.transaction(self.connection):
            yield

    def detect(
        self,
        scene: str,
        *,
        method: Method | str | None = None,
        tolerance_m: float | None = None,
        separation_m: float | None = None,
        nearest_m: float | None = None,
        full: bool = False,
        jobs: int | None = 1,
        memory_mb: int = MEMORY_MB,
        progress: "Progress | None" = None,
        lock_timeout_s: float | None = None,
        say: Callable[[str], object] = _log.warning,
    ) -> "Run":
        """Bring the conflicts of a scene up to date and return what was done.

        Parameters
        ----------
        method, tolerance_m, separation_m, nearest_m : optional
            New settings of the scene; they stay, and other settings mean that everything is computed again.
        full : bool
            Compute everything again, also what did not change.
        jobs : int, optional
            Threads to solve in; None is one per processor. The answer does not depend on it. Method ``nlp`` solves in
            one.
        memory_mb : int
            Megabytes that the process keeps below, 256 at least; with less, work is done in smaller parts. The answer
            does not depend on it.
        progress : callable, optional
            Called now and then with what is done and how much there is.
        lock_timeout_s : float, optional
            Wait no longer than this, in seconds, for another detection of the scene or for any other lock; then
            `LockTimeout` is raised. By default it waits for as long as it takes.
        say : callable
            Told after 5 s of waiting for another detection who that is.
        """
        given: dict[str, Any] = {
            "method": method,
            "tolerance_m": tolerance_m,
            "separation_m": separation_m,
            "nearest_m": nearest_m,
        }
        if lock_timeout_s is not None:
            inputs.seconds("detect", "lock_timeout_s", lock_timeout_s)
        if jobs is not None:
            inputs.count("detect", "jobs", jobs, 1)
        inputs.count("detect", "memory_mb", memory_mb, LEAST_MEMORY_MB)
        changes = {name: value for name, value in given.items() if value is not None}
        if changes:
            store.set_scene(self.connection, replace(self._settings(scene), **changes))
        # Not above: the solvers bring scipy, which takes longer to import than everything else.
        from conflictdb.db import detect

        return detect.detect(
            self.connection,
            scene,
            full=full,
            jobs=jobs,
            memory_mb=memory_mb,
            progress=progress,
            lock_timeout_s=lock_timeout_s,
            say=say,
        )

    def write_back(
        self,
        scene: str,
        path: str | Path,
        *,
        lock_timeout_s: float | None = None,
        say: Callable[[str], object] = _log.warning,
    ) -> "WrittenBack":
        """Write conflicts that Spark computed into a scene, by the routine of `detect` and in one transaction.

        Written again, they change nothing. Objects that have changed since they were exported, that are new or gone,
        keep their conflicts and wait for a detection.

        Parameters
        ----------
        path : path
            The directory that ``conflictdb spark detect --output`` wrote, of objects that `export` did.
        lock_timeout_s, say
            See `detect`.

        Raises
        ------
        InvalidInput
            What was computed was of other settings, of another scene, or does not say, or a file of it is missing;
            nothing was written.
        LockTimeout
            Somebody else kept a lock for `lock_timeout_s`; nothing was written.
        """
        from conflictdb.arrays import arrow  # noqa: F401  names the extra where there is no pyarrow
        from conflictdb.db.write_back import write_back
        from conflictdb.io.computed import read_computed, read_conflicts  # needs pyarrow

        of = read_computed(Path(path))
        states = store.ObjectStates.of(of.kind, of.object_id, of.version, of.digest, of.key)
        found = read_conflicts(Path(path), of.pairs)
        return write_back(self.connection, scene, of.settings, states, found, lock_timeout_s=lock_timeout_s, say=say)

    def conflicts(
        self, scene: str, at: inputs.Instant | None = None, *, with_region: bool = False
    ) -> Listing[Conflict]:
        """Return the conflicts of a scene that are known, with `at` only those at that instant.

        Where each conflict is (`region`) is read only `with_region`. The list says whether
        it is complete (`is_current`, `state`); while changes of the scene wait for detection it comes with an
        IncompleteWarning.
        """
        instant = None if at is None else inputs.moment("conflicts", "at", at)
        with self._transaction():
            found = store.conflicts(self.connection, scene, instant, with_region=with_region)
        _warn_if_incomplete(found.state)
        for conflict in found:
            conflict.found_by(self)
        return found

    def approaches(self, scene: str) -> Listing[Approach]:
        """Return how close objects of a scene come: conflicts, and pairs that come within its `nearest_m`.

        The list says whether it is complete, as that of `conflicts` does.
        """
        with self._transaction():
            found = store.approaches(self.connection, scene)
        _warn_if_incomplete(found.state)
        return found

    def stream_conflicts(
        self, scene: str, at: inputs.Instant | None = None, *, with_region: bool = False
    ) -> Stream[Conflict]:
        """Return what `conflicts` returns, read as it is asked for: in little memory, however many there are.

        Until its last row is read, or it is closed, a transaction is open on the connection.
        """
        instant = None if at is None else inputs.moment("stream_conflicts", "at", at)
        state = self._state(scene)
        return Stream(state, store.each_conflict(self.connection, scene, instant, with_region=with_region), Conflict)

    def stream_approaches(self, scene: str, *, only_near: bool = False) -> Stream[Approach]:
        """Return what `approaches` returns, read as it is asked for; `only_near` leaves out those of conflicts.

        Until its last row is read, or it is closed, a transaction is open on the connection.
        """
        return Stream(self._state(scene), store.each_approach(self.connection, scene, only_near=only_near), Approach)

    def state(self, scene: str) -> SceneState:
        """Return whether what is known of a scene is complete; raises InvalidInput if the scene is not known."""
        with self._transaction():
            return store.scene_state(self.connection, scene)

    def _state(self, scene: str) -> SceneState:
        """Return whether what is known of a scene is complete; warns the caller's caller if it is not."""
        state = self.state(scene)
        _warn_if_incomplete(state, 4)
        return state

    def conflicts_known_at(self, scene: str, at: inputs.Instant) -> list[Conflict]:
        """Return the conflicts of a scene as they were known at an instant: what had been detected by then.

        Where they are, and their nearest points, is not kept. Raises InvalidInput also for an instant before the first
        detection of the scene, and if its history does not reach back so far.
        """
        instant = inputs.moment("conflicts_known_at", "at", at)
        with self._transaction():
            return store.conflicts_known_at(self.connection, scene, instant)

    def conflict_events(
        self,
        scene: str,
        key: str | None = None,
        other_key: str | None = None,
        *,
        after: int = 0,
        most: int | None = None,
    ) -> list[ConflictEvent]:
        """Return what became of the conflicts of a scene, of an object or of two objects, oldest first.

        Parameters
        ----------
        after : int
            Only events with a greater number: of the last one that was seen, nothing is missed.
        most : int, optional
            How many at most.
        """
        with self._transaction():
            return store.conflict_events(self.connection, scene, key, other_key, after, most)

    def acknowledge(self, scene: str, a_key: str, b_key: str, reason: str, until: inputs.Instant | None = None) -> int:
        """Take note of the conflict of two objects, as it is known, and return its number.

        It holds while the conflict is no more than that: at no other times, with no worse verdict, no closer; and until
        an instant, if one is given.

        Raises InvalidInput if no such conflict is known, a reason is not given, or `until` is past.
        """
        instant = None if until is None else inputs.moment("acknowledge", "until", until)
        with self._transaction():
            return store.acknowledge(self.connection, scene, a_key, b_key, reason, instant)

    def unacknowledge(self, scene: str, a_key: str, b_key: str) -> bool:
        """Take back that the conflict of two objects was acknowledged, and return whether it was.

        Raises InvalidInput if no such conflict is known.
        """
        with self._transaction():
            return store.unacknowledge(self.connection, scene, a_key, b_key)

    def explain(self, scene: str, a_key: str, b_key: str) -> Explanation:
        """Return why two objects of a scene are in conflict, or are not, as of the last detection.

        With how close they come, also where the scene does not keep that. Raises InvalidInput if the scene or one of
        the objects is not known.
        """
        # Not above: the stages take longer to import than everything else.
        from conflictdb.db import explanations

        with self._transaction():
            return explanations.explain(self.connection, scene, a_key, b_key)

    def probe(
        self,
        scene: str,
        plan: Area | Track | Sequence[Area | Track],
        *,
        jobs: int = 1,
        worker_timeout_s: float | None = None,
    ) -> Listing[Conflict]:
        """Return what a plan would be in conflict with, and when, without writing anything.

        By the stages that a detection runs, with the scene's settings, on the objects that the last detection saw. With
        the scene's `nearest_m` also what it would come near. An object that has the key of the plan is left out: the
        plan would replace it. Several plans replace their namesakes together, and are checked against each other, too.

        Parameters
        ----------
        plan : Area or Track, or a sequence of them
            What is planned.
        jobs : int
            Threads to solve in. The answer does not depend on it.
        worker_timeout_s : float, optional
            Ask the workers, and wait so long at most; by default this program does what they would do. Their answer
            lacks the nearest points.

        Raises
        ------
        InvalidInput
            There is no such scene, or its plane cannot hold the plan; or workers cannot be asked about one like it: a
            track whose haven changes its shape, or with heights of its legs.
        NotCurrent
            No worker has answered in time.
        StoreError
            A transaction is open: the answer must come from one state of the database, and workers see a question when
            it is committed.
        """
        plans = _plans(plan)
        inputs.count("probe", "jobs", jobs, 1)
        # Not above: the stages take longer to import than everything else.
        from conflictdb.db import probes

        if worker_timeout_s is None:
            found = probes.probe(self.connection, scene, plans, jobs=jobs)
        else:
            timeout = timedelta(seconds=inputs.seconds("probe", "worker_timeout_s", worker_timeout_s))
            found = probes.ask(self.connection, scene, plans, timeout)
        _warn_if_incomplete(found.state)
        return found

    def wait_until_current(self, scene: str, timeout_s: float = 60.0) -> None:
        """Wait until nothing of a scene waits for detection, which a worker has to do, or another program.

        Raises
        ------
        InvalidInput
            There is no such scene.
        NotCurrent
            It takes longer than `timeout_s`; the message says what waits.
        StoreError
            The connection is in a transaction that cannot see others' changes, or has changed the scene itself.
        """
        timeout = timedelta(seconds=inputs.seconds("wait_until_current", "timeout_s", timeout_s))
        with self._transaction():
            store.wait_until_current(self.connection, scene, timeout)

    def attach(
        self,
        scene: str,
        kind: Kind | str,
        table: str,
        mapped: Mapping[str, str],
        *,
        every_s: float | None = None,
    ) -> int:
        """Attach a table of this database to a scene, and return the number of the attachment.

        Its rows become objects of the scene with the next `follow`, or detection by the same role, and follow the table
        from then on. Only sessions of the role that attaches ever run the map; it must own the table.

        Parameters
        ----------
        kind : str
            What the rows become: ``area`` or ``track``.
        table : str
            Name of a table, view or foreign table, as in SQL: ``mission.ops``.
        mapped : mapping of str to str
            For each field, a column or an SQL expression of the columns of a row; as ``where`` one that is true of the
            rows that count, all if it is not given.
        every_s : float, optional
            How often to compare all rows, seconds. By default triggers note changes; views and foreign tables, which
            have none, are compared every minute.

        Raises
        ------
        InvalidInput
            The scene is not known, or the table or the map cannot be used; nothing has been changed.

        Warns
        -----
        UserWarning
            The map gives areas no times, but the table has columns that look like times.
        """
        with self._transaction(), _notices_as_warnings(self.connection):
            return store.attach(self.connection, scene, str(kind), table, mapped, _interval("attach", every_s))

    def preview_attachment(
        self,
        scene: str,
        kind: Kind | str,
        table: str,
        mapped: Mapping[str, str],
        *,
        every_s: float | None = None,
    ) -> store.AttachmentPreview:
        """Return what `attach` would do, and the first objects; changes nothing, and raises what `attach` raises."""
        every = _interval("preview_attachment", every_s)
        with self._transaction(), _notices_as_warnings(self.connection):
            return store.preview_attachment(self.connection, scene, str(kind), table, mapped, every)

    def detach(self, scene: str, table: str, *, keep: bool = False) -> int:
        """Detach a table from a scene, and return how many objects were removed with it.

        keep : leave the objects in the scene, as if they had been put in one by one
        """
        with self._transaction():
            return store.detach(self.connection, scene, table, keep=keep)

    def attachments(self, scene: str | None = None) -> list[store.Attachment]:
        """Return the tables that are attached to a scene, or to any, and how that goes."""
        with self._transaction():
            return store.attachments(self.connection, scene)

    def unmapped(self, scene: str) -> list[store.Unmapped]:
        """Return the rows of attached tables that are no objects of a scene, or not as they are now, and why."""
        with self._transaction():
            return store.unmapped(self.connection, scene)

    def follow(self, scene: str) -> None:
        """Bring a scene in step with the tables that this connection's role attached, as its detections do first."""
        attached.follow(self.connection, scene, again=True)

    def share_scene(self, scene: str, role: str, access: str = "read") -> None:
        """Let a role of the database see a scene, once scenes are protected; for who owns it.

        Parameters
        ----------
        role : str
            Name of the role, which stands for its members too; ``public`` is every role.
        access : str
            ``read``, ``write``, or ``own``: it owns the scene then, in place of who does.

        Raises
        ------
        InvalidInput
            There is no such scene or role, or the access is another one.
        StoreError
            The scene is not that of the connection's role.
        """
        with self._transaction():
            store.share_scene(self.connection, scene, role, access)

    def unshare_scene(self, scene: str, role: str) -> bool:
        """Take back what `share_scene` gave a role, and return whether it had anything."""
        with self._transaction():
            return store.unshare_scene(self.connection, scene, role)

    def shares(self, scene: str) -> list[store.Share]:
        """Return whose a scene is, and the roles that it is shared with, as far as the connection's role may know."""
        with self._transaction():
            return store.shares(self.connection, scene)

    def protect_scenes(self, *, on: bool = True) -> None:
        """Have each scene seen by its owner, by those it is shared with and by workers alone, or by all again.

        For who owns the schema conflictdb. Raises StoreError for others.
        """
        with self._transaction():
            store.protect_scenes(self.connection, on=on)

    def advise(
        self, scene: str, *, sample: int | None = None, seed: int = 0, progress: "Progress | None" = None
    ) -> "Advice":
        """Return what each setting would cost for a scene and how wrong it would be, from a sample; changes nothing.

        Parameters
        ----------
        sample : int, optional
            Pairs of objects to try the settings on; by default as many as take seconds.
        seed : int
            Of the draw: the same seed draws the same sample.
        progress : callable, optional
            Called with how many settings are measured, and of how many.
        """
        settings, areas, tracks = self._read(scene)
        # Not above: the solvers bring scipy, as they do for `detect`.
        from conflictdb.advice import advise

        return advise.advise(
            settings, areas, tracks, sample=advise.SAMPLE if sample is None else sample, seed=seed, progress=progress
        )

    def plot(self, scene: str, a_key: str | None = None, b_key: str | None = None) -> "Figure":
        """Return a figure of matplotlib: of a scene where and when its plans are in conflict, or of two of its objects.

        Of two objects it shows what they sweep, where the stages let them meet, and their separation over time, also
        where they are in no conflict. While changes of the scene wait for detection it comes with an
        IncompleteWarning.

        Raises InvalidInput for what the scene does not hold, and ConflictDBError, naming the extra to install, where
        there is no matplotlib.
        """
        from conflictdb.drawing import figures

        if (a_key is None) != (b_key is None):
            raise InvalidInput("plot", "b_key", "is needed with a_key, and the other way round: a figure is of a pair")
        keys = None if a_key is None or b_key is None else (a_key, b_key)
        with self._transaction():
            settings, areas, tracks = self._read(scene, keys)
            found = store.conflicts(self.connection, scene, with_region=keys is None, keys=keys)
            known = list(found)
            if keys is not None and not known:
                near = store.each_approach(self.connection, scene, only_near=True, keys=keys)
                known = [one.as_near() for one in near]
        _warn_if_incomplete(found.state)
        if keys is None:
            return figures.plot_scene(settings, areas, tracks, known, remark=_incomplete(found.state))
        a, b = _pair_of(scene, [*areas, *tracks], *keys)
        return figures.plot_pair(settings, a, b, next(iter(known), None), remark=_incomplete(found.state))

    def plot_conflict(self, conflict: Conflict) -> "Figure":
        """Return the figure of a conflict that this database holds: `conflict.plot()` asks for it."""
        from conflictdb.drawing import figures

        with self._transaction():
            settings, areas, tracks = self._read(conflict.scene, (conflict.a_key, conflict.b_key))
            state = store.scene_state(self.connection, conflict.scene)
        a, b = _pair_of(conflict.scene, [*areas, *tracks], conflict.a_key, conflict.b_key)
        return figures.plot_pair(settings, a, b, conflict, remark=_incomplete(state))

    def report(self, scene: str, file: str | Path) -> None:
        """Write a report of a scene, .html or .pdf: what was checked and how, what was found, with figures.

        While changes of the scene wait for detection it says so at its top, and comes with an IncompleteWarning.

        Raises InvalidInput for a scene that is not known, or without objects, and for other file names;
        ConflictDBError, naming the extra to install, where what it needs is not there.
        """
        from conflictdb.drawing import report

        report.check_name(file)
        with self._transaction():
            settings, areas, tracks = self._read(scene)
            found = store.conflicts(self.connection, scene, with_region=True)
            near = [one.as_near() for one in store.each_approach(self.connection, scene, only_near=True)]
            run = next(iter(store.runs(self.connection, scene)), None)
        _warn_if_incomplete(found.state)
        columns = {name: getattr(run, name) for name in run.__slots__} if run else {}
        checked = report.Checked(settings, areas, tracks, found, near, found.state, self.status().server, columns)
        report.write(checked, file)

    def export(self, scene: str, path: str | Path) -> None:
        """Write a scene file that loads as exactly the same objects: GeoParquet if its name ends in .parquet.

        Else it is GeoJSON, compressed if its name ends in .gz. The file appears when it is complete; if it cannot be
        written, an older one stays.
        """
        if is_parquet(path):
            with whole_file(path) as stream:
                self.write_geoparquet(scene, stream)
        else:
            write_lines(path, scene_text(*self._read(scene)))

    def write_geoparquet(self, scene: str, stream: IO[bytes]) -> None:
        """Write a scene as GeoParquet that loads as exactly the same objects, some at a time, however many there are.

        Raises ConflictDBError, naming the extra to install, where there is no pyarrow.
        """
        from conflictdb.arrays.arrow.objects import of_objects  # needs pyarrow
        from conflictdb.io.parquet_writing import write_objects

        with store.snapshot(self.connection):
            number = store.scene_id(self.connection, scene)
            settings = store.read_settings(self.connection, number)
            objects = store.each_object(self.connection, number)
            write_objects(
                stream, settings, (of_objects(one.areas, one.tracks, one.object_id, one.version) for one in objects)
            )

    def scene_text(self, scene: str) -> str:
        """Return a scene as the text of the file that `export` writes."""
        return "".join(scene_text(*self._read(scene)))

    def _read(self, scene: str, keys: Sequence[str] | None = None) -> tuple[Scene, list[Area], list[Track]]:
        with self._transaction():
            return store.read_scene(self.connection, scene, keys)

    def scenes(self) -> list[store.SceneStatus]:
        """Return all scenes with their objects, pending changes and last run."""
        with self._transaction():
            return store.list_scenes(self.connection)

    def status(self) -> Status:
        """Return the state of the database and of all scenes."""
        with self._transaction():
            service = store.service(self.connection)
            revision = schema.revision(self.connection)
        info = self.connection.info
        return Status(
            database=f"{info.dbname} on {info.host}",
            server=f"PostgreSQL {service.server_version}, PostGIS {service.postgis_version}",
            revision=str(revision),
            worker_count=service.worker_count,
            scenes=tuple(self.scenes()),
        )

    def load_demo(self) -> Loaded:
        """Load the scene that comes with the package: a strait with closed areas, ships, submarines, an aircraft.

        It replaces the objects of the scene of that name.
        """
        return self.load_files([Path(str(files("conflictdb") / "scenes" / f"{DEMO_SCENE}.geojson"))], replace=True)[0]


def _plans(given: Any) -> list[Area | Track]:
    """Return a plan, or several, as a list; raises InvalidInput for anything else, and for keys that occur twice."""
    plans = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    seen: set[str] = set()
    for plan in plans:
        if not isinstance(plan, Area | Track):
            raise InvalidInput("probe", "plan", f"must be an Area or a Track, or several; got {type(plan).__name__}")
        if plan.key in seen:
            raise InvalidInput(f"plan {plan.key!r}", "key", "occurs more than once: keys must be unique")
        seen.add(plan.key)
    if not plans:
        raise InvalidInput("probe", "plan", "must be an Area or a Track, or several; got none")
    return plans


@contextmanager
def _notices_as_warnings(connection: "psycopg.Connection[Any]") -> Iterator[None]:
    """Warn the caller of the method that uses this of what the database remarks meanwhile."""
    remarks: list[str] = []

    def keep(told: psycopg.errors.Diagnostic) -> None:
        remarks.append(told.message_primary or "")

    connection.add_notice_handler(keep)
    try:
        yield
    finally:
        connection.remove_notice_handler(keep)
    for one in remarks:
        warnings.warn(one, UserWarning, stacklevel=4)


def _interval(who: str, every_s: float | None) -> timedelta | None:
    return None if every_s is None else timedelta(seconds=inputs.seconds(who, "every_s", every_s))


def _incomplete(state: SceneState) -> str | None:
    """Return what must be said of figures of a scene that is not complete."""
    return None if state.is_current else f"NOT COMPLETE: {state.remark or 'changes wait for detection'}"


def _pair_of(scene: str, objects: Sequence[Area | Track], *keys: str) -> list[Area | Track]:
    """Return the objects of some keys; raises InvalidInput where the scene has none of a key, or they are one."""
    by_key = {one.key: one for one in objects}
    for key in keys:
        if key not in by_key:
            raise InvalidInput(f"scene {scene!r}", "object", f"{key!r} is not known")
    if len(set(keys)) < len(keys):
        raise InvalidInput("plot", "keys", f"must be of two objects; got {keys[0]!r} twice")
    return [by_key[key] for key in keys]


def _warn_if_incomplete(state: SceneState, stacklevel: int = 3) -> None:
    """Warn the caller of the method that calls this, or who that many calls above."""
    if not state.is_current:
        warnings.warn(f"scene {state.scene!r}: {state.remark}", IncompleteWarning, stacklevel=stacklevel)
