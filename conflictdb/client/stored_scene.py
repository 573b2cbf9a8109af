"""One scene of a database: detect, read, ask, draw, attach, share."""

import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta, tzinfo
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, Unpack

import psycopg

from conflictdb import store
from conflictdb.core.memory_budget import LEAST_MEMORY_MB, MEMORY_MB
from conflictdb.errors import IncompleteWarning, InvalidInput
from conflictdb.jobs import follow_attached
from conflictdb.model.results import (
    Admission,
    Approach,
    Certified,
    Conflict,
    ConflictEvent,
    Delays,
    Explanation,
    Kind,
    Listing,
    SceneState,
    Speeds,
    Stream,
    Verdict,
)
from conflictdb.model.settings import STORED_BY_DETECT, Changes

# Methods import what needs numpy and scipy: a list of conflicts starts in a third of the time.
if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from conflictdb.client.advise import Advice
    from conflictdb.client.loading import LoadedPositions
    from conflictdb.core.depths import DeepestContact
    from conflictdb.core.funnel import Progress
    from conflictdb.formats.hints import FileHints
    from conflictdb.jobs.detect import Phase, Run
    from conflictdb.jobs.import_computed import WrittenBack
    from conflictdb.memory.area_places import FreePlace
    from conflictdb.model import inputs
    from conflictdb.model.plans import Area, Scene, Track
    from conflictdb.model.proposals import Detour, Goal, Proposal
    from conflictdb.model.rules import Rule

_log = logging.getLogger(__name__)

# Verdicts of conflicts; near is none.
_SELECTED: Final = (Verdict.CONFLICT, Verdict.GRAZING, Verdict.UNRESOLVED)


class StoredScene:
    """A scene of a database, made by `Database.scene` and `Database.load`; it holds no state but the name.

    Every method raises InvalidInput, naming the known scenes, if the scene does not exist.
    """

    def __init__(self, name: str, connection: "Callable[[], psycopg.Connection[Any]]") -> None:
        self.name = name
        self._connected = connection

    def __repr__(self) -> str:
        return f"StoredScene({self.name!r})"

    @property
    def connection(self) -> "psycopg.Connection[Any]":
        """The psycopg connection in use."""
        return self._connected()

    def settings(self) -> "Scene":
        """Return the settings of the scene."""
        with store.transaction(self.connection):
            return store.read_settings(self.connection, store.scene_or_branch_id(self.connection, self.name))

    def detect(
        self,
        *,
        full: bool = False,
        jobs: int | None = 1,
        memory_mb: int = MEMORY_MB,
        progress: "Progress | None" = None,
        phase: "Phase | None" = None,
        lock_timeout_s: float | None = None,
        say: Callable[[str], object] = _log.warning,
        **settings: Unpack[Changes],
    ) -> "Run":
        """Update the conflicts and return the run.

        Parameters
        ----------
        full : bool
            Recompute everything, also unchanged objects.
        jobs : int, optional
            Threads to solve in; None is one per processor. Does not change the answer. Method ``nlp`` uses one.
        memory_mb : int
            Memory limit of the process, megabytes, at least 256; a smaller limit means smaller chunks. Does not change
            the answer.
        progress : callable, optional
            Called now and then with the numbers of pairs solved and to solve.
        phase : callable, optional
            Called with the name of each phase and the amounts done and to do (0: unknown), and again as it advances.
        lock_timeout_s : float, optional
            Longest wait, seconds, for another detection of the scene or for any other lock; then `LockTimeout` is
            raised. By default there is no limit for another detection.
        say : callable
            Called with the holder of the lock after 5 s of waiting for another detection.
        **settings : optional
            New settings of the scene, by their names in a `Scene`: method and distances. They are stored, and changed
            settings recompute everything.
        """
        from conflictdb.model import inputs

        for name in settings.keys() - {setting.name for setting in STORED_BY_DETECT}:
            raise TypeError(f"detect() got an unexpected keyword argument {name!r}")
        if lock_timeout_s is not None:
            inputs.seconds("detect", "lock_timeout_s", lock_timeout_s)
        if jobs is not None:
            inputs.count("detect", "jobs", jobs, 1)
        inputs.count("detect", "memory_mb", memory_mb, LEAST_MEMORY_MB)
        changes: dict[str, Any] = {name: value for name, value in settings.items() if value is not None}
        if changes:
            store.set_scene(self.connection, replace(self.settings(), **changes))
        from conflictdb.jobs import detect

        return detect.detect(
            self.connection,
            self.name,
            full=full,
            jobs=jobs,
            memory_mb=memory_mb,
            progress=progress,
            phase=phase,
            lock_timeout_s=lock_timeout_s,
            say=say,
        )

    def write_back(
        self,
        path: str | Path,
        *,
        lock_timeout_s: float | None = None,
        say: Callable[[str], object] = _log.warning,
    ) -> "WrittenBack":
        """Write conflicts that Spark computed, with the routine of `detect`, in one transaction.

        Writing them again changes nothing. Objects that changed since the export, or are new or removed, keep their
        conflicts and wait for a detection.

        Parameters
        ----------
        path : path
            The directory that ``conflictdb spark detect --output`` wrote, computed from objects that `export` wrote.
        lock_timeout_s, say
            See `detect`.

        Raises
        ------
        InvalidInput
            The conflicts have other or unknown settings, belong to another scene, or a file is missing; nothing was
            written.
        LockTimeout
            A lock was not free within `lock_timeout_s`; nothing was written.
        """
        from conflictdb.arrays import arrow  # noqa: F401  without pyarrow, names the extra to install
        from conflictdb.formats.computed import read_computed, read_conflicts  # needs pyarrow
        from conflictdb.jobs.import_computed import write_back

        of = read_computed(Path(path))
        states = store.ObjectStates.of(of.kind, of.object_id, of.version, of.digest, of.key)
        found = read_conflicts(Path(path), of.pairs)
        return write_back(
            self.connection, self.name, of.settings, states, found, lock_timeout_s=lock_timeout_s, say=say
        )

    def conflicts(
        self,
        at: "inputs.Instant | None" = None,
        *,
        key: str | None = None,
        from_: "inputs.Instant | None" = None,
        to: "inputs.Instant | None" = None,
        since: "inputs.Instant | None" = None,
        verdict: Verdict | str | None = None,
        acknowledged: bool | None = None,
        object_class: str | None = None,
        with_region: bool = False,
    ) -> Listing[Conflict]:
        """Return the known conflicts, earliest first, by default all.

        The list says whether it is complete (`is_current`, `state`); while changes of the scene wait for detection an
        IncompleteWarning is issued.

        Parameters
        ----------
        at : instant, optional
            Only conflicts at that instant.
        key : str, optional
            Only conflicts of that object.
        from_, to : instant, optional
            Only conflicts with a period in this span; `to` is exclusive.
        since : instant, optional
            Only conflicts that opened or changed since then.
        verdict : str, optional
            Only ``conflict``, ``grazing`` or ``unresolved``.
        acknowledged : bool, optional
            Only conflicts that are acknowledged, or that are not.
        object_class : str, optional
            Only conflicts with an object of this class.
        with_region : bool
            Read the regions (`region`), too.

        Raises
        ------
        InvalidInput
            The scene or the object does not exist, or a span or verdict is none.
        """
        which = _selection("conflicts", at, key, from_, to, since, verdict, acknowledged, object_class)
        found = store.conflicts(self.connection, self.name, which, with_region=with_region)
        _warn_if_incomplete(found.state)
        for conflict in found:
            conflict.found_by(self)
        return found

    def depths(self, conflicts: "Sequence[Conflict]") -> "dict[tuple[str, str], DeepestContact]":
        """Return by how much conflicts undercut their separation at most, metres, and when, by their keys.

        Outdated conflicts are left out, and all of them if there are more than 2,000: it would take seconds.
        """
        from conflictdb.core.ranking import MOST_DEPTHS

        pairs = {(one.a_key, one.b_key) for one in conflicts if one.is_current is not False}
        if not 0 < len(pairs) <= MOST_DEPTHS:
            return {}
        # Imported here, so that lists without depths start without numpy.
        from conflictdb.core.depths import depths

        return depths(*self._read(sorted({key for pair in pairs for key in pair})), only=pairs)

    def approaches(self) -> Listing[Approach]:
        """Return the closest approaches: of conflicts, and of pairs within the scene's `nearest_m`.

        The list says whether it is complete, as that of `conflicts` does.
        """
        found = store.approaches(self.connection, self.name)
        _warn_if_incomplete(found.state)
        return found

    def stream_conflicts(
        self,
        at: "inputs.Instant | None" = None,
        *,
        key: str | None = None,
        from_: "inputs.Instant | None" = None,
        to: "inputs.Instant | None" = None,
        since: "inputs.Instant | None" = None,
        verdict: Verdict | str | None = None,
        acknowledged: bool | None = None,
        object_class: str | None = None,
        with_region: bool = False,
    ) -> Stream[Conflict]:
        """Return the conflicts of `conflicts` as a stream: little memory, however many there are.

        A transaction stays open on the connection until the stream is exhausted or closed.
        """
        which = _selection("stream_conflicts", at, key, from_, to, since, verdict, acknowledged, object_class)
        state = self._state(which)
        return Stream(state, store.each_conflict(self.connection, self.name, which, with_region=with_region), Conflict)

    def stream_approaches(self, *, only_near: bool = False) -> Stream[Approach]:
        """Return the closest approaches of `approaches` as a stream; `only_near` leaves out pairs in conflict.

        A transaction stays open on the connection until the stream is exhausted or closed.
        """
        return Stream(self._state(), store.each_approach(self.connection, self.name, only_near=only_near), Approach)

    def state(self) -> SceneState:
        """Return whether the answers are complete."""
        return store.scene_state(self.connection, self.name)

    def _state(self, which: store.Selection | None = None) -> SceneState:
        """Return the state; warns the caller's caller if answers are incomplete."""
        state = store.state_within(self.connection, self.state(), which.spans if which else ())
        _warn_if_incomplete(state, 4)
        return state

    def conflicts_known_at(self, at: "inputs.Instant") -> list[Conflict]:
        """Return the conflicts that had been detected by an instant.

        Regions and closest points are not kept. Raises InvalidInput also for an instant before the first detection of
        the scene, or before its history begins.
        """
        from conflictdb.model import inputs

        instant = inputs.moment("conflicts_known_at", "at", at)
        return store.conflicts_known_at(self.connection, self.name, instant)

    def conflict_events(
        self,
        key: str | None = None,
        other_key: str | None = None,
        *,
        after: int = 0,
        most: int | None = None,
        since: "inputs.Instant | None" = None,
    ) -> list[ConflictEvent]:
        """Return the history of all conflicts, of an object's or of two objects', oldest first.

        Parameters
        ----------
        after : int
            Only events with a greater number; pass the last number seen to miss nothing.
        most : int, optional
            Maximal number of events.
        since : instant, optional
            Only events from then on.
        """
        begin = _moment("conflict_events", "since", since)
        return store.conflict_events(self.connection, self.name, key, other_key, after, most, begin)

    def acknowledge(
        self, a_key: str, b_key: str, reason: str, until: "inputs.Instant | None" = None, *, by: str | None = None
    ) -> int:
        """Acknowledge the conflict of two objects, as it is known, and return its number.

        The acknowledgement lasts while the conflict gets no worse (no other times, no worse verdict, no closer), and at
        most until `until`. `by` is a name shown with the database user, where several people share one.

        Raises InvalidInput if no such conflict is known, the reason is missing, or `until` is past.
        """
        instant = _moment("acknowledge", "until", until)
        return store.acknowledge(self.connection, self.name, a_key, b_key, reason, instant, by)

    def acknowledgements_ended(self, run_id: int) -> "list[store.EndedAcknowledgement]":
        """Return the acknowledgements that ended with the conflicts that a run closed, by key."""
        return store.acknowledgements_ended(self.connection, self.name, run_id)

    def unacknowledge(self, a_key: str, b_key: str) -> bool:
        """Withdraw the acknowledgement of the conflict of two objects; return whether it was acknowledged.

        Raises InvalidInput if no such conflict is known.
        """
        return store.unacknowledge(self.connection, self.name, a_key, b_key)

    def explain(self, a_key: str, b_key: str) -> Explanation:
        """Return why two objects are in conflict or not, as of the last detection.

        Includes their closest approach, also where the scene does not store it. Raises InvalidInput if the scene or one
        of the objects does not exist.
        """
        from conflictdb.jobs import explanations

        with store.transaction(self.connection):
            return explanations.explain(self.connection, self.name, a_key, b_key)

    def certify(self, file: str | Path | IO[str], *, jobs: int = 1, delays: "Sequence[str]" = ()) -> Certified:
        """Write a file that proves what the last detection found, and that there is nothing else; return what it holds.

        `check_proof.py` checks the file without this package. Whoever may read the scene may certify it.

        Parameters
        ----------
        file : str, Path or a text stream
            The file, compressed if its name ends in .gz; it appears when it is complete.
        jobs : int
            Threads to compute in. Does not change the proofs.
        delays : sequence of str
            Keys of tracks whose least later departures are proven, too, as of `conflictdb.certify`.

        Raises
        ------
        InvalidInput
            One of the tracks does not exist, or `conflictdb.certify` refuses its delays.
        NotCurrent
            Changes wait for a detection.
        StoreError
            A transaction is open: objects and conflicts must be of one state of the database.
        """
        from conflictdb.formats import write_lines
        from conflictdb.jobs.certification import proof_of_stored
        from conflictdb.memory.certifying import certified
        from conflictdb.model import inputs

        inputs.count("certify", "jobs", jobs, 1)
        keys = inputs.keys("certify", "delays", delays)
        lines, occupied, counts = proof_of_stored(self.connection, self.name, jobs=jobs, delays=keys)
        if isinstance(file, str | Path):
            write_lines(file, lines)
        else:
            file.writelines(lines)
        return certified(occupied, counts)

    def probe(
        self,
        plan: "Area | Track | Sequence[Area | Track]",
        *,
        jobs: int = 1,
        worker_timeout_s: float | None = None,
    ) -> Listing[Conflict]:
        """Return the conflicts that a plan would have, and when, without writing.

        Runs the stages of a detection, with the scene's settings, on all objects as they are stored, detected or not.
        If the scene has `nearest_m`, near pairs are returned too. An object with the key of the plan is left out, since
        the plan would replace it. Several plans replace their namesakes together, and are checked against each other.
        If the scene is not current, an IncompleteWarning is issued: changes of attached tables may be missing.

        Parameters
        ----------
        plan : Area or Track, or a sequence of them
            The planned objects.
        jobs : int
            Threads to solve in. Does not change the answer.
        worker_timeout_s : float, optional
            Ask the workers, and wait at most this long, seconds; by default this process computes the answer.

        Raises
        ------
        InvalidInput
            The scene does not exist, its plane cannot contain the plan, or the plans have more than 50,000 conflicts.
        NotCurrent
            No worker answered in time.
        StoreError
            A transaction is open: the answer must come from one state of the database, and workers see a question only
            once it is committed.
        """
        from conflictdb.model import inputs

        plans = _plans("probe", plan)
        inputs.count("probe", "jobs", jobs, 1)
        from conflictdb.jobs import probes

        if worker_timeout_s is None:
            found = probes.probe(self.connection, self.name, plans, jobs=jobs)
        else:
            timeout = timedelta(seconds=inputs.seconds("probe", "worker_timeout_s", worker_timeout_s))
            found = probes.ask(self.connection, self.name, plans, timeout)
        _warn_if_incomplete(found.state)
        return found

    def put(self, plan: "Area | Track | Sequence[Area | Track]", settings: "Scene | None" = None) -> "store.LoadCounts":
        """Add plans to the scene, or replace the objects of the same keys, all or none; return what changed.

        They wait for a detection, and may conflict: `admit` puts only plans that do not.

        settings : create the scene, or change its settings; the name is this scene's. None: the scene must exist

        Raises InvalidInput, and changes nothing, for keys that occur twice and plans that do not fit the scene's plane.
        """
        from conflictdb.model.plans import Scene

        if not isinstance(settings, Scene | None):
            raise InvalidInput("put", "settings", f"must be a Scene, or absent; got {settings!r:.60}")
        from conflictdb.client import loading

        return loading.put(self.connection, self.name, _plans("put", plan), settings)

    def load_positions(
        self, path: str | Path, *, max_file_mb: float | None = None, hints: "FileHints | None" = None
    ) -> "LoadedPositions":
        """Insert the observed positions of a file (CSV, as of AIS, or tracks of GPX), all or none.

        Positions of ids that are no tracks of the scene are left out, and counted. Workers compare the others with the
        plans. Raises InvalidInput as `read`, and for positions in the future.
        """
        from conflictdb.client.loading import load_positions

        return load_positions(self.connection, self.name, path, max_file_mb, hints)

    def live(self) -> "list[store.LiveTrack]":
        """Return how tracks with positions keep their plans, as workers found it; those that do not first."""
        return store.live(self.connection, self.name)

    def live_conflicts(self) -> "list[store.LiveConflict]":
        """Return the conflicts that follow if tracks keep the lateness that their positions show."""
        return store.live_conflicts(self.connection, self.name)

    def admit(
        self,
        plan: "Area | Track | Sequence[Area | Track]",
        owner: str | None = None,
        *,
        allow_known: bool = False,
        replace: Sequence[str] = (),
        lock_timeout_s: float | None = None,
    ) -> Admission:
        """Put plans into the scene only if they conflict with nobody; return whether they were put, and the conflicts.

        Of several sessions that admit plans which exclude each other, exactly one succeeds: admissions of a scene take
        turns, until their transactions end. Plans are compared with all objects as they are committed, detected or not.
        Grazing and unresolved pairs count as conflicts.

        Parameters
        ----------
        plan : Area or Track, or a sequence of them
            The plans, all or none of which are put. They are compared with each other, too, unless they have an owner.
        owner : str, optional
            The owner of the plans. They take the place of all objects that it has in the scene, and are compared with
            those of others only.
        replace : sequence of str
            Keys of stored objects that plans of the same key may replace. Objects of `owner` need not be named.
        allow_known : bool
            Put plans in spite of conflicts that the objects they replace had before: with the same objects, at least
            as long and as severe.
        lock_timeout_s : float, optional
            Longest wait for another admission, seconds; then `LockTimeout` is raised. By default the wait is that for
            any other lock.

        Raises
        ------
        InvalidInput
            The scene does not exist, its plane cannot contain a plan, a plan is beyond a limit of the database, or a
            key belongs to another owner, or to an object that `replace` does not name.
        LockTimeout
            Another admission did not end in time.
        """
        from conflictdb.model import inputs

        plans = _plans("admit", plan)
        if owner is not None and (not isinstance(owner, str) or not owner):
            raise InvalidInput("admit", "owner", f"must be a non-empty string, or absent; got {owner!r:.60}")
        named = inputs.keys("admit", "replace", replace)
        if lock_timeout_s is not None:
            inputs.seconds("admit", "lock_timeout_s", lock_timeout_s)
        from conflictdb.jobs import admission

        return admission.admit(
            self.connection,
            self.name,
            plans,
            owner,
            allow_known=allow_known,
            replace=named,
            lock_timeout_s=lock_timeout_s,
        )

    def delays(
        self,
        key: str | None = None,
        within_s: float = 7200.0,
        now: "inputs.Instant | None" = None,
        clear_within_m: float | None = None,
        waypoint: int | None = None,
        *,
        margin_s: float = 0.0,
        margin_m: float = 0.0,
        start: "inputs.Instant | None" = None,
        end: "inputs.Instant | None" = None,
        best: int | None = None,
    ) -> list[Delays]:
        """Return when each track could depart instead: the departures in conflict, and the least that is not.

        Looked up if the scene is current and stores them (`delays_within_s`); else computed from the stored objects,
        detected or not: the same answer. Delays are of one object at a time: everything else departs as planned.

        The parameters are those of `conflictdb.delays`.

        Raises InvalidInput for an unknown scene or object.
        """
        from conflictdb.jobs import track_delays
        from conflictdb.memory.delay_options import DelayOptions

        options = DelayOptions.of(within_s, now, clear_within_m, waypoint, margin_s, margin_m, start, end, best)
        return track_delays.delays(self.connection, self.name, key, options)

    def places(
        self,
        key: str,
        aside_m: float,
        bearings_deg: Sequence[float] | None = None,
        *,
        margin_s: float = 0.0,
        margin_m: float = 0.0,
        units: str = "nautical",
    ) -> "list[FreePlace]":
        """Return the least shift of an area along each bearing with which it meets nothing; nothing is stored.

        Computed from the stored objects, detected or not. The area moves at its true size, by whole tenths of a unit; a
        detection of the moved copy has checked each place.

        aside_m : the farthest shift, metres
        bearings_deg : degrees clockwise from north; by default eight of them
        margin_s, margin_m : wanted on top of the required separations in time and in distance
        units : ``nautical`` or ``metric``: shifts are whole tenths of a nautical mile, or of a kilometre

        Raises InvalidInput for an unknown scene or area, for an area that does not fit the scene's plane, and for
        limits that are none.
        """
        from conflictdb.memory.area_places import places
        from conflictdb.model.units import Units

        if units not in list(Units):
            raise InvalidInput("places", "units", f"must be one of {', '.join(Units)}; got {units!r:.60}")
        settings, areas, tracks = self._read()
        margins = {"margin_s": margin_s, "margin_m": margin_m}
        return places(tracks, areas, settings, key, aside_m, bearings_deg, **margins, units=Units(units))

    def speeds(
        self, key: str | None = None, slowest: float = 0.5, fastest: float = 2.0, leg: int | None = None
    ) -> list[Speeds]:
        """Return at which speeds each track could go instead: those in conflict, and the nearest that are not.

        Computed from the stored objects, detected or not. One track at a time has another speed, on all legs; it
        departs as planned, and everything else stays as planned.

        The parameters are those of `conflictdb.speeds`; `slowest` is at least 1/100, `fastest` at most 100.

        Raises InvalidInput for an unknown scene, track or leg.
        """
        from conflictdb.jobs import track_delays

        return track_delays.speeds(self.connection, self.name, key, slowest, fastest, leg)

    def resolve(
        self,
        *,
        keys: Sequence[str] | None = None,
        keep: Sequence[str] = (),
        weights: Mapping[str, float] | None = None,
        levels: Mapping[str, int] | None = None,
        within_s: float = 7200.0,
        now: "inputs.Instant | None" = None,
        slowest: float = 1.0,
        fastest: float = 1.0,
        aside_m: float = 0.0,
        goal: "Goal | str" = "total",
        limit_s: float = 30.0,
        movable: Sequence[str] = (),
        margin_s: float = 0.0,
        margin_m: float = 0.0,
        round_s: float = 0.0,
        time_zone: tzinfo = UTC,
        units: str = "nautical",
    ) -> "Proposal":
        """Return the least changes of departures that clear the scene, and store them as a proposal.

        Computed from the stored objects, detected or not; verified by a detection of the whole changed scene. Nothing
        moves until `Database.apply_proposal` is called with its `proposal_id`. The parameters are those of
        `conflictdb.resolve`.

        Raises InvalidInput for unknown keys, for limits that are none, and if the scene changes meanwhile.
        """
        from conflictdb.jobs import clearing
        from conflictdb.memory.resolve import resolve

        compute = partial(
            resolve,
            keys=keys,
            keep=keep,
            weights=weights,
            levels=levels,
            within_s=within_s,
            now=now,
            slowest=slowest,
            fastest=fastest,
            aside_m=aside_m,
            goal=goal,
            limit_s=limit_s,
            movable=movable,
            margin_s=margin_s,
            margin_m=margin_m,
            round_s=round_s,
            time_zone=time_zone,
            units=units,
        )
        return clearing.resolve(self.connection, self.name, compute)

    def detours(self, key: str, most_m: float = 20_000.0, later_s: float = 7200.0) -> "list[Detour]":
        """Return ways on which a track meets nothing, shortest first; nothing is stored.

        Computed from the stored objects, detected or not. The parameters are those of `conflictdb.detours`. Raises
        InvalidInput for an unknown track, and for limits that are none.
        """
        from conflictdb.memory.detours import detours

        settings, areas, tracks = self._read()
        return detours(tracks, areas, settings, key=key, most_m=most_m, later_s=later_s)

    def wait_until_current(self, timeout_s: float = 60.0) -> None:
        """Wait until no change waits for detection; a worker or another program has to detect.

        Raises
        ------
        InvalidInput
            The scene does not exist.
        NotCurrent
            It takes longer than `timeout_s`; the message says what waits.
        StoreError
            The connection is in a transaction that cannot see others' changes, or has changed the scene itself.
        """
        from conflictdb.model import inputs

        timeout = timedelta(seconds=inputs.seconds("wait_until_current", "timeout_s", timeout_s))
        store.wait_until_current(self.connection, self.name, timeout)

    def attach(
        self,
        kind: Kind | str,
        table: str,
        mapped: Mapping[str, str],
        *,
        every_s: float | None = None,
        again: bool = False,
    ) -> int:
        """Attach a table of this database, and return the number of the attachment.

        Its rows become objects of the scene with the next `follow`, or detection by the same role, and follow the table
        from then on. Only sessions of the attaching role run the map; that role must own the table.

        Parameters
        ----------
        kind : str
            The kind of the objects: ``area`` or ``track``.
        table : str
            Name of a table, view or foreign table, as in SQL: ``mission.ops``.
        mapped : mapping of str to str
            For each field, a column or an SQL expression of the columns of a row; ``where`` is a condition that selects
            rows, by default all.
        every_s : float, optional
            How often to compare all rows, seconds. By default triggers note changes; views and foreign tables, which
            have no triggers, are compared every minute.
        again : bool, default False
            Whether the scene may have the table already, as with another ``where``.

        Raises
        ------
        InvalidInput
            The scene does not exist, it has the table already, or the table or the map cannot be used; nothing has been
            changed.

        Warns
        -----
        UserWarning
            The map gives areas no times, but the table has columns that look like times.
        """
        with _notices_as_warnings(self.connection):
            given = store.Attaching(str(kind), table, mapped, _interval("attach", every_s), again)
            return store.attach(self.connection, self.name, given)

    def reattach(
        self,
        table: str,
        changes: Mapping[str, str | None] | None = None,
        *,
        to: str | None = None,
        every_s: float | None = None,
    ) -> int:
        """Give an attached table another table, map or interval, and return the number of the attachment.

        Objects, conflicts and acknowledgements stay: a row with the same key, or the same columns of the key, is the
        same object. A table that was dropped and made again is taken by its name. Missing triggers are created, and
        disabled ones enabled. Only for the role that attached it. The next `follow` or detection reads the rows.

        Parameters
        ----------
        table : str
            Name of the table that is attached, or the number of the attachment.
        changes : mapping of str to str or None, optional
            Fields of the map that change, as for `attach`; None removes a field.
        to : str, optional
            Another table, view or foreign table; by default the same.
        every_s : float, optional
            As for `attach`; by default as it is. An interval of 0 means triggers.

        Raises
        ------
        InvalidInput
            The table is not attached, several times, or it or the map cannot be used; nothing has been changed.
        NotPermitted
            Another role attached it.
        """
        with _notices_as_warnings(self.connection):
            given = store.Reattaching(table, changes or {}, to, _interval("reattach", every_s))
            return store.attach(self.connection, self.name, given)

    def preview_attachment(
        self,
        kind: Kind | str,
        table: str,
        mapped: Mapping[str, str],
        *,
        every_s: float | None = None,
        again: bool = False,
    ) -> "store.AttachmentPreview":
        """Return what `attach` would do, and the first objects; changes nothing, and raises the errors of `attach`."""
        given = store.Attaching(str(kind), table, mapped, _interval("preview_attachment", every_s), again)
        with _notices_as_warnings(self.connection):
            return store.preview_attachment(self.connection, self.name, given)

    def preview_reattachment(
        self,
        table: str,
        changes: Mapping[str, str | None] | None = None,
        *,
        to: str | None = None,
        every_s: float | None = None,
    ) -> "store.AttachmentPreview":
        """Return what `reattach` would do, and the first objects; changes nothing."""
        given = store.Reattaching(table, changes or {}, to, _interval("preview_reattachment", every_s))
        with _notices_as_warnings(self.connection):
            return store.preview_attachment(self.connection, self.name, given)

    def detach(self, table: str, *, keep: bool = False) -> int:
        """Detach a table, and return how many objects were removed with it.

        keep : leave the objects in the scene, as if they had been added one by one
        """
        return store.detach(self.connection, self.name, table, keep=keep)

    def attachments(self) -> "list[store.Attachment]":
        """Return the attached tables, and their state."""
        return store.attachments(self.connection, self.name)

    def unmapped(self) -> "list[store.Unmapped]":
        """Return the rows of attached tables without an up-to-date object, and why."""
        return store.unmapped(self.connection, self.name)

    def follow(self) -> None:
        """Update the scene from the tables that this connection's role attached, as its detections do first."""
        follow_attached.follow(self.connection, self.name, again=True)

    def objects(self) -> "list[store.ObjectSummary]":
        """Return the areas and tracks, by key: kind, name, times and heights."""
        return store.list_objects(self.connection, self.name)

    def rules(self) -> "list[Rule]":
        """Return the separation rules, in the order of their sides."""
        return list(self.settings().rules)

    def put_rule(self, rule: "Rule") -> None:
        """Add a separation rule, or replace the one of the same two sides; its pairs wait for a detection.

        Raises InvalidInput if another rule is as specific for some pair.
        """
        store.put_rule(self.connection, self.name, rule)

    def remove_rule(self, a_class: str | None, b_class: str | None) -> bool:
        """Remove the separation rule of two sides, in either order; return whether there was one."""
        return store.remove_rule(self.connection, self.name, a_class, b_class)

    def names(self, *keys: str) -> dict[str, str]:
        """Return the names of objects, by key; objects without a name are left out."""
        return store.names(self.connection, self.name, keys)

    def plan(self, key: str) -> "Area | Track":
        """Return an object of the scene; raises InvalidInput if it does not exist."""
        _, areas, tracks = self._read([key])
        if areas or tracks:
            return areas[0] if areas else tracks[0]
        raise InvalidInput(f"object {key!r}", "key", f"is no object of scene {self.name!r}")

    def activations(self, key: str) -> list[tuple[datetime, datetime]]:
        """Return the spans [start, end) at which an area is active, in UTC; none that is unbounded, none of a track.

        Of a schedule all of them, if it says its first and last dates; else as far as the scene's horizon.

        Raises InvalidInput if it does not exist.
        """
        from conflictdb.client.briefing import activations_of

        found = activations_of(self.plan(key), self.settings())
        return [(start, end) for start, end in found if start is not None and end is not None]

    def delayed(self, key: str, delay: timedelta) -> "Area | Track":
        """Return an object of the scene, later by `delay` (negative: earlier), for `probe`; changes nothing.

        Raises InvalidInput if it does not exist.
        """
        from conflictdb.core.moving_plans import delayed
        from conflictdb.model import inputs

        return delayed(self.plan(key), round(delay / inputs.MICROSECOND))

    def rename(self, name: str) -> None:
        """Rename the scene; conflicts and history stay. Raises InvalidInput if the name is taken."""
        store.rename_scene(self.connection, self.name, name)
        self.name = name

    def copy(self, name: str) -> "StoredScene":
        """Copy settings and objects into a new scene, and return it; it waits for a detection.

        Raises InvalidInput if the name is taken.
        """
        store.copy_scene(self.connection, self.name, name)
        return StoredScene(name, self._connected)

    def branch(self, name: str, proposal_id: int | None = None) -> "StoredScene":
        """Make a branch of the scene, and return it: a scene with the same objects, which stores only its edits.

        Objects that the branch has not edited follow the scene. `merge` takes its edits over, `drop` forgets them.

        proposal_id : of a proposal (`resolve`), whose moves are the first edits of the branch

        Raises InvalidInput if the name is taken, this is a branch, or the proposal is out of date.
        """
        store.create_branch(self.connection, self.name, name, proposal_id)
        return StoredScene(name, self._connected)

    def branch_of(self) -> str | None:
        """Return the name of the scene that this one is a branch of; None: it is no branch."""
        with store.transaction(self.connection):
            return store.parent_name(self.connection, store.scene_or_branch_id(self.connection, self.name))

    def drop(self) -> None:
        """Remove this branch with its edits; raises InvalidInput if it is no branch."""
        store.drop_branch(self.connection, self.name)

    def diff(self) -> "store.BranchDiff":
        """Return the objects and conflicts in which this branch differs from its parent.

        Raises InvalidInput if the branch or its parent waits for a detection, or this is no branch.
        """
        return store.diff_branch(self.connection, self.name)

    def merge(self) -> int:
        """Take the edits of this branch over into its parent, remove it, and return the number of changed objects.

        Raises InvalidInput, naming them, if objects were changed on both sides; nothing is changed then.
        """
        return store.merge_branch(self.connection, self.name)

    def delete(self) -> None:
        """Remove the scene with its objects, conflicts and history.

        Raises StoreError if the scene is protected and belongs to another role.
        """
        store.remove_scene(self.connection, self.name)

    def rename_object(self, key: str, new_key: str) -> None:
        """Give an object another key; raises InvalidInput if it does not exist, or the new key is taken."""
        store.rename_object(self.connection, self.name, key, new_key)

    def delete_objects(self, *keys: str) -> None:
        """Remove objects, all or none; raises InvalidInput if one does not exist."""
        store.remove_objects(self.connection, self.name, keys)

    def share(self, role: str, access: str = "read") -> None:
        """Let a role of the database see the scene, once scenes are protected; only for the scene's owner.

        Parameters
        ----------
        role : str
            Name of the role, which includes its members; ``public`` is every role.
        access : str
            ``read``, ``write``, or ``own``, which makes it the owner in place of the present one.

        Raises
        ------
        InvalidInput
            The scene or role does not exist, or the access is another word.
        StoreError
            The connection's role does not own the scene.
        """
        store.share_scene(self.connection, self.name, role, access)

    def unshare(self, role: str) -> bool:
        """Revoke what `share` granted a role, and return whether it had anything."""
        return store.unshare_scene(self.connection, self.name, role)

    def shares(self) -> "list[store.Share]":
        """Return the owner and the roles the scene is shared with, as far as the connection's role sees them."""
        return store.shares(self.connection, self.name)

    def advise(self, *, sample: int | None = None, seed: int = 0) -> "Advice":
        """Return the cost and the error of each setting, estimated from a sample; changes nothing.

        Parameters
        ----------
        sample : int, optional
            Pairs of objects to try the settings on; by default as many as take seconds.
        seed : int
            Seed of the sample: the same seed draws the same sample.
        """
        settings, areas, tracks = self._read()
        from conflictdb.client import advise

        return advise.advise(settings, areas, tracks, sample=advise.SAMPLE if sample is None else sample, seed=seed)

    def plot(self, a_key: str | None = None, b_key: str | None = None) -> "Figure":
        """Return a matplotlib figure of the conflicts in place and time, or of two of its objects.

        For two objects it shows their swept areas, the times at which the stages let them meet, and their separation
        over time, also without a conflict. While changes of the scene wait for detection an IncompleteWarning is
        issued.

        Raises InvalidInput for unknown scenes and objects, and ConflictDBError, naming the extra to install, without
        matplotlib.
        """
        from conflictdb.plot import figures

        keys = _both("plot", a_key, b_key)
        with store.transaction(self.connection):
            settings, areas, tracks = self._read(keys)
            found = store.conflicts(self.connection, self.name, store.Selection(keys=keys), with_region=keys is None)
            known = list(found)
            if keys is not None and not known:
                near = store.each_approach(self.connection, self.name, only_near=True, keys=keys)
                known = [one.as_near() for one in near]
        _warn_if_incomplete(found.state)
        if keys is None:
            return figures.plot_scene(settings, areas, tracks, known, remark=_incomplete(found.state))
        a, b = _pair_of(self.name, [*areas, *tracks], *keys)
        return figures.plot_pair(settings, a, b, next(iter(known), None), remark=_incomplete(found.state))

    def plot_delays(self, a_key: str | None = None, b_key: str | None = None, within_s: float = 7200.0) -> "Figure":
        """Return a figure of the free and forbidden departures of tracks, or the coordination diagram of a pair.

        Bars are of the first 40 tracks, those in conflict before the others. The diagram shows which times of the pair
        bring it into contact. While changes of the scene wait for detection an IncompleteWarning is issued.

        Parameters
        ----------
        a_key, b_key : str, optional
            A track and any other object.
        within_s : float
            The horizon: delays of up to this many seconds, either way.

        Raises InvalidInput for unknown objects, two areas and a scene without tracks, and ConflictDBError, naming the
        extra to install, without matplotlib.
        """
        from conflictdb.memory import questions
        from conflictdb.model import inputs
        from conflictdb.plot import departures, figures

        keys = _both("plot_delays", a_key, b_key)
        inputs.seconds("plot_delays", "within_s", within_s)
        with store.transaction(self.connection):
            settings, areas, tracks = self._read(keys)
            found = store.conflicts(self.connection, self.name, store.Selection(keys=keys))
        _warn_if_incomplete(found.state)
        remark = _incomplete(found.state)
        if keys is not None:
            a, b = _pair_of(self.name, [*areas, *tracks], *keys)
            return departures.plot_coordination(settings, a, b, within_s, remark=remark)
        every = {track.key for track in tracks}
        asked = [key for key in departures.tracks_in_conflict(found) if key in every]
        asked = list(dict.fromkeys([*asked, *sorted(every, key=str.encode)]))[: figures.MOST_ROWS]
        of_key = {one.key: one for one in questions.delays(tracks, areas, settings, asked, within_s)}
        left_out = len(tracks) - len(asked)
        names = {track.key: track.name for track in tracks}
        return departures.plot_delays([of_key[key] for key in asked], remark=remark, left_out=left_out, names=names)

    def plot_conflict(self, conflict: Conflict) -> "Figure":
        """Return the figure of a conflict of the scene; `conflict.plot()` calls this."""
        from conflictdb.plot import figures

        with store.transaction(self.connection):
            settings, areas, tracks = self._read((conflict.a_key, conflict.b_key))
            state = store.scene_state(self.connection, self.name)
        a, b = _pair_of(self.name, [*areas, *tracks], conflict.a_key, conflict.b_key)
        return figures.plot_pair(settings, a, b, conflict, remark=_incomplete(state))

    def report(
        self, file: str | Path, key: str | None = None, *, time_zone: tzinfo = UTC, units: str = "nautical"
    ) -> None:
        """Write a report, .html or .pdf: the objects and settings checked, the conflicts, and figures.

        key : write a brief of this plan instead, for its captain or range officer: times, places, whom it meets, the
            owners to call, what is acknowledged, and the proposal
        time_zone : of the brief's local times; UTC: these alone
        units : ``nautical`` (nautical miles, degrees and minutes) or ``metric`` (kilometres, decimal degrees)

        While changes of the scene wait for detection the report says so at its top, and an IncompleteWarning is issued.

        Raises InvalidInput for an empty scene, an unknown key, and other file names and units; ConflictDBError,
        naming the extra to install, if a package is missing.
        """
        from conflictdb.memory import questions
        from conflictdb.model.units import Units
        from conflictdb.plot import brief_pages, report

        report.check_name(file)
        if units not in list(Units):
            raise InvalidInput("report", "units", f"must be one of {', '.join(Units)}; got {units!r:.60}")
        if key is not None:
            from conflictdb.client.briefing import brief_of

            checked_brief = brief_of(self, key, time_zone, Units(units))
            _warn_if_incomplete(checked_brief.state)
            brief_pages.write(checked_brief, file)
            return
        with store.transaction(self.connection):
            settings, areas, tracks = self._read()
            found = store.conflicts(self.connection, self.name, with_region=True)
            near = [one.as_near() for one in store.each_approach(self.connection, self.name, only_near=True)]
            run = next(iter(store.runs(self.connection, self.name)), None)
            server = str(store.service(self.connection))
        _warn_if_incomplete(found.state)
        columns = {name: getattr(run, name) for name in run.__slots__} if run else {}
        known = {track.key for track in tracks}
        asked = [key for key in report.asked_about(found) if key in known]
        later = questions.delays(tracks, areas, settings, asked) if asked else []
        scene = (settings, areas, tracks, found, near, found.state, server, columns, later)
        checked = report.Checked(*scene, units=Units(units))
        report.write(checked, file)

    def export(self, path: str | Path, keys: Sequence[str] | None = None) -> None:
        """Write a scene file that loads as exactly the same objects: GeoParquet if its name ends in .parquet.

        Names that end in .rtz (one track), .gpx (tracks as routes), .kml, .ed318.json (areas only) or .f3548.json are
        written in these formats, all others as GeoJSON; compressed if they end in .gz. A UserWarning says what a format
        does not hold. The file appears when it is complete; if writing fails, an older file stays.

        keys : of the objects to write; None: all. GeoParquet holds all
        """
        from conflictdb.formats import object_lines, unwritten, write_lines
        from conflictdb.formats.reading import is_parquet
        from conflictdb.formats.writing import whole_file

        if is_parquet(path):
            if keys is not None:
                raise InvalidInput("export", "keys", "GeoParquet holds the whole scene", str(path))
            with whole_file(path) as stream:
                self.write_geoparquet(stream)
        else:
            scene, areas, tracks = self._read(keys)
            known = {area.key for area in areas} | {track.key for track in tracks}
            for key in keys or ():
                if key not in known:
                    raise InvalidInput(f"scene {self.name!r}", "keys", f"has no object {key!r:.60}", str(path))
            write_lines(path, object_lines(path, scene, areas, tracks))
            for lost in unwritten(path, scene, areas, tracks):
                warnings.warn(str(lost), UserWarning, stacklevel=2)

    def export_routes(self, folder: str | Path, keys: Sequence[str] | None = None) -> list[Path]:
        """Write each track to a route of its own in a folder, KEY.rtz, and return the files; areas are left out.

        Signs that names of files should not have are written as `_`. A UserWarning says what RTZ does not hold.

        keys : of the tracks to write; None: all
        """
        from conflictdb.formats import object_lines, unwritten, write_lines
        from conflictdb.formats.rtz_writing import file_names

        scene, _, tracks = self._read(keys)
        known = {track.key for track in tracks}
        for key in keys or ():
            if key not in known:
                raise InvalidInput(f"scene {self.name!r}", "keys", f"has no track {key!r:.60}", str(folder))
        if not tracks:
            raise InvalidInput(f"scene {self.name!r}", "tracks", "has none, and RTZ holds routes", str(folder))
        files = {track.key: Path(folder) / name for track, name in zip(tracks, file_names(tracks), strict=True)}
        texts = {track.key: list(object_lines(files[track.key], scene, [], [track])) for track in tracks}
        Path(folder).mkdir(parents=True, exist_ok=True)
        for key, lines in texts.items():
            write_lines(files[key], lines)
        for lost in unwritten(files[tracks[0].key], scene, [], tracks[:1]):
            warnings.warn(str(lost), UserWarning, stacklevel=2)
        return list(files.values())

    def write_geoparquet(self, stream: IO[bytes]) -> None:
        """Write the scene as GeoParquet that loads as exactly the same objects, in batches, however many there are.

        Raises ConflictDBError, naming the extra to install, without pyarrow.
        """
        from conflictdb.arrays.arrow.object_rows import of_objects  # needs pyarrow
        from conflictdb.formats.parquet_writing import write_objects

        with store.snapshot(self.connection):
            number = store.scene_or_branch_id(self.connection, self.name)
            settings = store.read_settings(self.connection, number)
            objects = store.each_object(self.connection, number)
            write_objects(
                stream, settings, (of_objects(one.areas, one.tracks, one.object_id, one.version) for one in objects)
            )

    def text(self) -> str:
        """Return the scene as the text of the file that `export` writes."""
        from conflictdb.formats import scene_text

        return "".join(scene_text(*self._read()))

    def _read(self, keys: Sequence[str] | None = None) -> "tuple[Scene, list[Area], list[Track]]":
        return store.read_scene(self.connection, self.name, keys)


def _selection(
    who: str,
    at: "inputs.Instant | None",
    key: str | None,
    from_: "inputs.Instant | None",
    to: "inputs.Instant | None",
    since: "inputs.Instant | None",
    verdict: Verdict | str | None,
    acknowledged: bool | None,
    object_class: str | None,
) -> store.Selection:
    """Return what to select; raises InvalidInput for a span that ends before it begins, and unknown verdicts."""
    given = {"at": at, "from_": from_, "to": to, "since": since}
    when = {field: _moment(who, field, one) for field, one in given.items()}
    start, end = when["from_"], when["to"]
    if start is not None and end is not None and end <= start:
        raise InvalidInput(who, "to", f"must be after from_; got {start} and {end}")
    if verdict is not None and verdict not in _SELECTED:
        raise InvalidInput(who, "verdict", f"must be one of {', '.join(_SELECTED)}; got {verdict!r}")
    chosen = None if verdict is None else Verdict(verdict)
    return store.Selection(when["at"], key, start, end, when["since"], chosen, acknowledged, None, object_class)


def _moment(who: str, field: str, given: "inputs.Instant | None") -> datetime | None:
    if given is None:
        return None
    from conflictdb.model import inputs

    return inputs.moment(who, field, given)


def _plans(who: str, given: Any) -> "list[Area | Track]":
    """Return a plan, or several, as a list; raises InvalidInput for anything else, and for keys that occur twice."""
    from conflictdb.model.plans import Area, Track

    plans = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    seen: set[str] = set()
    for plan in plans:
        if not isinstance(plan, Area | Track):
            raise InvalidInput(who, "plan", f"must be an Area or a Track, or several; got {type(plan).__name__}")
        if plan.key in seen:
            raise InvalidInput(f"plan {plan.key!r}", "key", "occurs more than once: keys must be unique")
        seen.add(plan.key)
    if not plans:
        raise InvalidInput(who, "plan", "must be an Area or a Track, or several; got none")
    return plans


@contextmanager
def _notices_as_warnings(connection: "psycopg.Connection[Any]") -> Iterator[None]:
    """Warn the caller of the method that uses this of notices from the database."""
    remarks: list[str] = []

    def keep(notice: psycopg.errors.Diagnostic) -> None:
        remarks.append(notice.message_primary or "")

    connection.add_notice_handler(keep)
    try:
        yield
    finally:
        connection.remove_notice_handler(keep)
    for one in remarks:
        warnings.warn(one, UserWarning, stacklevel=4)


def _interval(who: str, every_s: float | None) -> timedelta | None:
    from conflictdb.model import inputs

    return None if every_s is None else timedelta(seconds=inputs.seconds(who, "every_s", every_s))


def _incomplete(state: SceneState) -> str | None:
    """Return the remark for figures of a scene whose answers are incomplete."""
    return None if state.is_current else f"NOT COMPLETE: {state.remark or 'changes wait for detection'}"


def _both(who: str, a_key: str | None, b_key: str | None) -> tuple[str, str] | None:
    """Return the keys of a pair, None for a whole scene; raises InvalidInput for one key."""
    if a_key is not None and b_key is not None:
        return a_key, b_key
    if a_key is not None or b_key is not None:
        raise InvalidInput(who, "b_key", "is needed with a_key, and the other way round: a figure is of a pair")
    return None


def _pair_of(scene: str, objects: "Sequence[Area | Track]", *keys: str) -> "list[Area | Track]":
    """Return the objects of two keys; raises InvalidInput if a key does not exist or both are the same."""
    by_key = {one.key: one for one in objects}
    for key in keys:
        if key not in by_key:
            raise InvalidInput(f"scene {scene!r}", "object", f"{key!r} is not known")
    if len(set(keys)) < len(keys):
        raise InvalidInput("plot", "keys", f"must be of two objects; got {keys[0]!r} twice")
    return [by_key[key] for key in keys]


def _warn_if_incomplete(state: SceneState, stacklevel: int = 3) -> None:
    """Warn the caller of the method that calls this, or a caller further up (`stacklevel`)."""
    if not state.is_current:
        warnings.warn(f"scene {state.scene!r}: {state.remark}", IncompleteWarning, stacklevel=stacklevel)
