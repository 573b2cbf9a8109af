"""Use conflictdb on one database connection: load, detect, read, export.

`connect` is the entry point. The command line uses this module only; other programs can do the same.
"""

import logging
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self, Unpack

import psycopg

from conflictdb import store
from conflictdb.client.lending import Borrowed, borrow
from conflictdb.client.stored_scene import StoredScene
from conflictdb.errors import (
    NotPermitted,
    SchemaMissing,
    SchemaOutdated,
    ServerError,
    StoreError,
    said_once,
)
from conflictdb.jobs import schema

if TYPE_CHECKING:
    from sqlalchemy import Connection, Engine
    from sqlalchemy.orm import Session

    from conflictdb.client.loading import Loaded
    from conflictdb.formats.contents import Phase
    from conflictdb.formats.hints import FileHints
    from conflictdb.formats.reading import ReadOptions

_log = logging.getLogger(__name__)

DEMO_SCENE: Final = "strait"


@dataclass(frozen=True, slots=True)
class Status:
    """State of a database.

    database : its name and host
    server : versions of PostgreSQL and PostGIS
    revision : of the schema
    worker_count : connected workers
    scenes : all scenes, by name
    """

    database: str
    server: str
    revision: str
    worker_count: int
    scenes: "tuple[store.SceneStatus, ...]"


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
        Connection string or URI of PostgreSQL with PostGIS; or a connection, engine or session, which `Database.close`
        does not close, and whose schema is checked once a minute at most, so that pools may lend it for each request;
        None is the embedded database, started if needed. Calls within the caller's transaction become
        part of it, with a session always; a detection needs a connection without a transaction.
    create : bool, optional
        Create or upgrade the schema if needed. Default: only in the embedded database.
    say : callable
        Called with a line before slow steps: starting a server, creating the schema.

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
        from conflictdb import embedded as server

        embedded = server.embedded(say=say)
        try:
            return _opened(embedded.dsn, [embedded.stop], create is not False, say, embedded.admin_dsn)
        except BaseException:
            embedded.stop()
            raise
    if isinstance(target, str):
        return _opened(target, [], bool(create), say)
    return _borrowed(target)


def _opened(
    dsn: str, release: list[Callable[[], None]], create: bool, say: Callable[[str], None], admin_dsn: str | None = None
) -> "Database":
    """Open a database; with `admin_dsn`, the embedded one, whose everyday user may not create the schema."""
    try:
        connection = store.connect(dsn)
    except StoreError as error:
        if admin_dsn is None or not create:
            raise ServerError(f"cannot connect: {error}") from error.__cause__
        schema.admit(admin_dsn, dsn)  # a cluster created before that user existed
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
    return Database(lambda: connection, [connection.close, *release])


def _borrowed(target: "psycopg.Connection[Any] | Engine | Connection | Session") -> "Database":
    database = Database(*borrow(target))
    try:
        connection = database.connection
        if not store.is_fit(connection):
            _check(connection)
            store.note_fit(connection)
    except BaseException:
        database.close()
        raise
    return database


def _check(connection: "psycopg.Connection[Any]") -> None:
    with store.transaction(connection):
        schema.check(connection)


class Database:
    """A database of scenes; created by `connect`, closed by `close` or at the end of a ``with``.

    Not thread-safe: open one per thread.
    """

    def __init__(self, connected: Borrowed, release: Sequence[Callable[[], None]] = ()) -> None:
        self._connected = connected
        self._release = list(release)

    @property
    def connection(self) -> "psycopg.Connection[Any]":
        """The psycopg connection in use."""
        return self._connected()

    def close(self) -> None:
        """Close a connection that `connect` opened, and stop the embedded database after its last user.

        A connection, engine or session passed to `connect` stays open. May be called again.
        """
        while self._release:
            self._release.pop(0)()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def scene(self, name: str) -> StoredScene:
        """Return a scene by its name; a scene that does not exist is an error of the first call that needs it."""
        return StoredScene(name, self._connected)

    def load(
        self,
        path: str | Path,
        scene: str | None = None,
        *,
        replace: bool = False,
        max_speed_kn: float | None = None,
        layers: Sequence[str] = (),
        skip_invalid: bool = False,
        max_file_mb: float | None = None,
        hints: "FileHints | None" = None,
    ) -> StoredScene:
        """Load one file, all or nothing, and return its scene.

        Parameters
        ----------
        path : path
            Any file that `conflictdb.formats.read` reads.
        scene : str, optional
            Scene to load into; default is the scene that the file names, else the name of the file.
        replace : bool
            Remove the objects of the scene that the file does not contain; by default objects are only added and
            updated. With this, a file of settings without objects empties its scene.
        max_speed_kn : float, optional
            Tracks that are faster on a leg are refused, see `conflictdb.formats.read`.
        layers : sequence of str
            The layers to read of a file that OGR opens; by default all.
        skip_invalid : bool
            Skip refused objects and load the others, see `conflictdb.formats.read`.
        max_file_mb : float, optional
            Limit on the unpacked size of the file, in millions of bytes, see `conflictdb.formats.read`; by default
            4,000 for scene files and GeoParquet, whose size memory does not depend on.
        hints : FileHints, optional
            Names of columns, time zone and havens that the file does not say.

        Raises
        ------
        InvalidInput
            Names the file and, for each mistake, the object, the field and the rule; nothing has been changed. A file
            without objects is refused too.

        Warns
        -----
        UserWarning
            For each remark (valid input that is probably unintended) and each object that was left out; for more than
            three of one reason once.
        """
        loaded = self.load_files(
            [path],
            scene,
            replace=replace,
            max_speed_kn=max_speed_kn,
            layers=layers,
            skip_invalid=skip_invalid,
            max_file_mb=max_file_mb,
            hints=hints,
        )[0]
        remarks = [(one.source, one.key, one.text) for one in loaded.remarks]
        left_out = [(one.source, one.key, one.reason) for one in loaded.invalid]
        for text in (*said_once(remarks), *said_once(left_out, "left out ")):
            warnings.warn(text, UserWarning, stacklevel=2)
        return self.scene(loaded.scene)

    def load_files(
        self,
        paths: Sequence[str | Path],
        scene: str | None = None,
        *,
        replace: bool = False,
        phase: "Phase | None" = None,
        **options: "Unpack[ReadOptions]",
    ) -> "list[Loaded]":
        """Load files as `load` does, files of one scene as if they were one; return the result for each scene.

        All files are read and checked before the first scene is changed; each scene is changed in one transaction. A
        single scene file or GeoParquet file is read and sent in batches within that transaction, unless objects may be
        skipped or hints are given: memory does not grow with its size. `phase` is called with the name of each phase
        and the amounts done and to do (0: unknown); the other options are those of `conflictdb.formats.read`.
        """
        from conflictdb.client import loading
        from conflictdb.formats.contents import unwatched

        return loading.load_files(self.connection, paths, scene, replace=replace, phase=phase or unwatched, **options)

    def attachments(self) -> "list[store.Attachment]":
        """Return the tables attached to any scene, and their state."""
        return store.attachments(self.connection, None)

    def apply_proposal(self, proposal_id: int, *, attached: bool = False) -> int:
        """Move the plans of a proposal, all or none, and return their number; the scene then waits for detection.

        attached : also change the rows of attached tables, if the connection's role attached them

        Raises InvalidInput, naming what changed, if anything in its scene changed since it was computed, and if it
        moves tracks of attached tables without `attached`; StoreError if it was applied before.
        """
        return store.apply_proposal(self.connection, proposal_id, attached=attached)

    def undo_proposal(self, proposal_id: int, *, attached: bool = False) -> int:
        """Give the plans of an applied proposal their exact former times, all or none, and return their number.

        Raises InvalidInput, naming them, if any of these tracks changed since; StoreError if it is not applied.
        """
        return store.undo_proposal(self.connection, proposal_id, attached=attached)

    def protect_scenes(self, *, on: bool = True) -> None:
        """Show each scene only to its owner, the roles it is shared with and workers, or show all scenes to all again.

        Only for the owner of schema conflictdb; raises StoreError for others.
        """
        store.protect_scenes(self.connection, on=on)

    def scenes(self) -> "list[store.SceneStatus]":
        """Return all scenes with their objects, pending changes and last run."""
        return store.list_scenes(self.connection)

    def status(self) -> Status:
        """Return the state of the database and of all scenes."""
        with store.transaction(self.connection):
            service = store.service(self.connection)
            revision = schema.revision(self.connection)
        info = self.connection.info
        return Status(
            database=f"{info.dbname} on {info.host}",
            server=str(service),
            revision=str(revision),
            worker_count=service.worker_count,
            scenes=tuple(self.scenes()),
        )

    def load_demo(self) -> "Loaded":
        """Load the scene that comes with the package: a strait with closed areas, ships, submarines, an aircraft.

        It replaces the objects of the scene of that name.
        """
        return self.load_files([Path(str(files("conflictdb") / "scenes" / f"{DEMO_SCENE}.geojson"))], replace=True)[0]
