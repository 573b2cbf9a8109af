"""Results: conflicts and closest approaches, with or without a database, and whether they are complete.

Verdicts and kinds are names here and in files, codes in arrays. Instants are aware datetimes in UTC, to the
microsecond; None where a period is unbounded. Positions are (longitude, latitude) in degrees.
"""

from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Final, Protocol, Self, TypeAlias, TypeVar, cast

from conflictdb.errors import InvalidInput
from conflictdb.model.methods import Method

if TYPE_CHECKING:
    import geopandas
    import pandas as pd
    from matplotlib.figure import Figure

Period: TypeAlias = tuple[datetime | None, datetime | None]
Position: TypeAlias = tuple[float, float]
_Row = TypeVar("_Row")


def format_moment(moment: datetime | None) -> str | None:
    """Return a moment as ISO 8601 UTC with microseconds, None for an unbounded end."""
    if moment is None:
        return None
    if moment.tzinfo is not UTC:
        moment = moment.astimezone(UTC)
    return f"{moment.isoformat(timespec='microseconds')[:-6]}Z"


def interval_text(periods: Sequence[Period]) -> str:
    """Return periods as ISO 8601 intervals, separated by spaces; an unbounded end is two dots."""
    return " ".join("/".join(format_moment(end) or ".." for end in period) for period in periods)


class Verdict(StrEnum):
    """The verdict on a reported pair."""

    CONFLICT = "conflict"  # the polygons meet, deeper than the tolerance
    GRAZING = "grazing"  # the least separation is within the tolerance of zero: too close to call
    UNRESOLVED = "unresolved"  # neither proven apart nor decided: they might meet during the period
    NEAR = "near"  # no conflict: they come within the scene's nearest_m, and no closer than the separation

    @property
    def code(self) -> int:
        """Its code in arrays; the database has names only."""
        return _VERDICT_CODES[self]

    @classmethod
    def of_code(cls, code: int) -> "Verdict":
        """Return the verdict of a code."""
        return _VERDICTS[code]


class Certainty(StrEnum):
    """Whether all voyages within the tolerances of two plans conflict."""

    MUST = "must"  # they do
    MAY = "may"  # some do, or might; it is not proven that all do

    @property
    def code(self) -> int:
        """Its code in arrays, where -1 is none."""
        return _CERTAINTY_CODES[self]

    @classmethod
    def of_code(cls, code: int) -> "Certainty | None":
        """Return the certainty of a code."""
        return _CERTAINTIES.get(code)


class Kind(StrEnum):
    """Kind of an object."""

    AREA = "area"
    TRACK = "track"

    @property
    def code(self) -> int:
        """Its code in arrays and in tables of the database."""
        return _KIND_CODES[self]

    @classmethod
    def of_code(cls, code: int) -> "Kind":
        """Return the kind of a code."""
        return _KINDS[code]


# Explicit, so that codes do not depend on the order of the names.
_VERDICT_CODES: Final = {Verdict.CONFLICT: 0, Verdict.GRAZING: 1, Verdict.UNRESOLVED: 2, Verdict.NEAR: 3}
_VERDICTS: Final = {code: verdict for verdict, code in _VERDICT_CODES.items()}
_CERTAINTY_CODES: Final = {Certainty.MAY: 0, Certainty.MUST: 1}
_CERTAINTIES: Final = {code: certainty for certainty, code in _CERTAINTY_CODES.items()}
_KIND_CODES: Final = {Kind.AREA: 0, Kind.TRACK: 1}  # areas come first in a pair
_KINDS: Final = {code: kind for kind, code in _KIND_CODES.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class PairRecord:
    """The shared fields of conflicts and closest approaches: the columns `record.APPROACH_COLUMNS`, and `STATES`."""

    scene: str
    a_key: str
    a_kind: Kind
    b_key: str
    b_kind: Kind
    verdict: Verdict
    time_error_s: float
    method: Method
    closest_at: datetime | None = None
    closest_m: float | None = None
    closest_error_m: float | None = None
    closest_a_deg: Position | None = None
    closest_b_deg: Position | None = None
    is_current: bool | None = None
    scene_is_current: bool | None = None
    run_id: int | None = None
    found_at: datetime | None = None
    a_name: str | None = None
    b_name: str | None = None
    a_id: int | None = field(default=None, repr=False, compare=False)
    a_version: int | None = field(default=None, repr=False, compare=False)
    b_id: int | None = field(default=None, repr=False, compare=False)
    b_version: int | None = field(default=None, repr=False, compare=False)

    @property
    def labels(self) -> tuple[str, str]:
        """What people read of the two objects: see `labelled`."""
        return labelled(self.a_key, self.a_name), labelled(self.b_key, self.b_name)


def labelled(key: str, name: str | None) -> str:
    """Return what people read of an object: its key, and in parentheses its name, if it has one that differs."""
    return key if name is None or name in ("", key) else f"{key} ({name})"


def distinct_labels(objects: Mapping[str, str | None]) -> dict[str, str]:
    """Return short labels of objects, by key: the name if no other object has it as name or key, else `labelled`.

    objects : their names, by key; None if they have none
    """
    times = Counter(objects.keys())
    times.update(name for key, name in objects.items() if name and name != key)
    return {key: name if name and times[name] == 1 else labelled(key, name) for key, name in objects.items()}


_SHARED: Final = tuple(one.name for one in fields(PairRecord))


class Drawable(PairRecord):
    """A row that can be drawn if it has an origin; copies made elsewhere have none."""

    __slots__ = ("_origin",)
    _origin: "Origin"

    def found_by(self, origin: "Origin") -> Self:
        """Set the origin, once; return the row itself."""
        object.__setattr__(self, "_origin", origin)
        return self

    def plot(self) -> "Figure":
        """Return a figure of matplotlib: the pair on a map, its swept areas, and its separation over time.

        Raises InvalidInput for a conflict that neither `solve` nor `conflicts` of a database returned, and
        ConflictDBError, naming the extra to install, without matplotlib.
        """
        origin = getattr(self, "_origin", None)
        if origin is None:
            rule = "has no objects to draw: take it from `solve` or `StoredScene.conflicts`, or use `plot_pair`"
            raise InvalidInput("conflict", "plot", rule)
        return origin.plot_conflict(cast(Conflict, self))


@dataclass(frozen=True, slots=True, kw_only=True)
class Conflict(Drawable):
    """Two objects that interfere or might interfere: a result of `solve`, a row of the view `conflicts`.

    Objects with the verdict near only come near each other, and have no periods.

    a_key, b_key : the area first if there is one, else the smaller key in byte order
    a_name, b_name : their names (today, in `conflicts_known_at`); None if they have none, and if Spark found it
    periods : when, (start, end) inclusive, rounded outward to the microsecond, in order; None where unbounded
    time_error_s : bound on the error of every end of every period, seconds
    first_contact_deg : where they first touch; None if the method does not compute it
    closest_at : the first instant at which they are closest; None if the method does not compute it, and for areas
        that are always there
    closest_m, closest_error_m : distance then, metres on the earth, and the bound on its error; None if the method does
        not compute it
    closest_a_deg, closest_b_deg : the nearest points then
    lacking_s : seconds by which the scene's separation in time is missed, within time_error_s; None if the scene wants
        none, if the verdict is unresolved, and for near pairs
    certainty : whether all voyages within the tolerances of both conflict; None if neither has tolerances, if the
        verdict is unresolved, and for near pairs

    Without a database these are None:

    region : where, a GeoJSON geometry; None also unless requested
    is_current : whether neither object changed since
    scene_is_current : whether the conflicts of the scene are complete
    run_id : the run that found it; later runs confirmed it unchanged
    found_at : when it was first found
    conflict_id : its number, the same from opening to closing; None for near pairs
    changed_at : when its periods, verdict or a key last changed; None if they never did
    acknowledged_by, acknowledged_at, acknowledged_for, acknowledged_until : user, time, reason and expiry of its
        acknowledgement (expiry None: while the conflict lasts); all None if there is none, or if it has ended
    a_id, a_version, b_id, b_version : numbers of the two objects and of their versions that it was computed from; None
        also unless the region is requested
    """

    periods: tuple[Period, ...]
    first_contact_deg: Position | None = None
    region: str | None = None
    conflict_id: int | None = None
    changed_at: datetime | None = None
    acknowledged_by: str | None = None
    acknowledged_at: datetime | None = None
    acknowledged_for: str | None = None
    acknowledged_until: datetime | None = None
    lacking_s: float | None = None
    certainty: Certainty | None = None

    @property
    def opened_at(self) -> datetime | None:
        """When it opened: `found_at`, as histories call it; None for near pairs."""
        return None if self.verdict is Verdict.NEAR else self.found_at

    def _repr_html_(self) -> str:
        from conflictdb.model import notebook

        return notebook.conflicts_html([self])

    @property
    def first_contact(self) -> datetime | None:
        """Start of the first period; None if unbounded or without periods."""
        return self.periods[0][0] if self.periods else None

    @property
    def first_contact_lon_deg(self) -> float | None:
        """Longitude of `first_contact_deg`; None where the method does not tell."""
        return None if self.first_contact_deg is None else self.first_contact_deg[0]

    @property
    def first_contact_lat_deg(self) -> float | None:
        """Latitude of `first_contact_deg`; None where the method does not tell."""
        return None if self.first_contact_deg is None else self.first_contact_deg[1]

    @property
    def last_contact(self) -> datetime | None:
        """End of the last period; None if unbounded or without periods."""
        return self.periods[-1][1] if self.periods else None

    @property
    def approach(self) -> "Approach | None":
        """The closest approach of the two; None if the method does not compute it."""
        if self.closest_m is None or self.closest_error_m is None or not self.closest_a_deg or not self.closest_b_deg:
            return None
        return Approach(**_shared(self))


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach(PairRecord):
    """The closest approach of two objects: `Conflict.approach`, a row of the view `approaches`. It has no periods.

    closest_at : the first instant at which they are closest; None for areas that are always there
    closest_m, closest_error_m : distance then, metres on the earth, and the bound on its error
    closest_a_deg, closest_b_deg : the nearest points then; also called `a_deg` and `b_deg`
    verdict : near (no conflict), or that of the conflict
    method, time_error_s : of the detection that found it, and as of the conflict
    a_name, b_name : names of the two; None if they have none
    is_current, scene_is_current, run_id, found_at : as of a `Conflict`
    a_id, a_version, b_id, b_version : as of a `Conflict`; None unless only near pairs are requested
    """

    closest_at: datetime | None
    closest_m: float
    closest_error_m: float
    closest_a_deg: Position
    closest_b_deg: Position

    @property
    def a_deg(self) -> Position:
        """The nearest point of the first object."""
        return self.closest_a_deg

    @property
    def b_deg(self) -> Position:
        """The nearest point of the second object."""
        return self.closest_b_deg

    def as_near(self) -> Conflict:
        """Return a near pair as a conflict without periods.

        Raises InvalidInput for other verdicts: the row of such a pair is the conflict.
        """
        if self.verdict is not Verdict.NEAR:
            who = f"approach of {self.a_key!r} and {self.b_key!r}"
            raise InvalidInput(who, "verdict", f"must be near: else its row is the conflict; got {self.verdict}")
        return Conflict(periods=(), **_shared(self))


def _shared(pair: PairRecord) -> dict[str, Any]:
    return {name: getattr(pair, name) for name in _SHARED}


def position_of(one: Conflict) -> Position | None:
    """Return where two objects first touch, else the nearest point of the first one; None if neither is known."""
    return one.first_contact_deg or one.closest_a_deg


@dataclass(frozen=True, slots=True)
class ConflictEvent:
    """An event of a conflict: a row of the view `conflict_events`.

    event : number; in a scene, events become visible in the order of their numbers
    kind : opened, changed or closed
    at : when a detection wrote it
    run_id : the detection
    conflict_id : the conflict, the same number from opening to closing
    verdict, periods, time_error_s, closest_at, closest_m, closest_error_m : as of a `Conflict`, from then on;
        before the event if the conflict closed
    opened_at, closed_at : when the conflict opened, and closed; None unless it did
    proposal_id : the proposal whose application, or its undoing, caused the event; else None
    """

    scene: str
    event: int
    kind: str
    at: datetime
    run_id: int
    conflict_id: int
    a_key: str
    a_kind: Kind
    b_key: str
    b_kind: Kind
    periods: tuple[Period, ...]
    verdict: Verdict
    time_error_s: float
    closest_at: datetime | None
    closest_m: float | None
    closest_error_m: float | None
    opened_at: datetime
    closed_at: datetime | None
    proposal_id: int | None = None


@dataclass(frozen=True, slots=True)
class SceneState:
    """Whether the conflicts of a scene are complete: a row of the view `scenes`.

    objects : number of areas and tracks
    pending : objects that wait for detection, and changes of attached tables that wait to be read
    last_run_at, last_error : end of its last detection, and why it failed; None if there was none, or no failure
    is_current : whether nothing changed since the last detection that succeeded
    remark : the problem in words; None if there is none
    detected_at : end of its last successful detection; None: it was never detected
    is_beyond_horizon : whether the answer concerns times for which schedules are not expanded; then it is not current
    compared_at : up to when attached views, and other tables without triggers, were compared; None: it has none
    detection_helps : whether a detection by this role makes it more current
    """

    scene: str
    objects: int
    pending: int
    last_run_at: datetime | None
    last_error: str | None
    is_current: bool
    remark: str | None
    detected_at: datetime | None = None
    is_beyond_horizon: bool = False
    compared_at: datetime | None = None
    detection_helps: bool = True

    def _repr_html_(self) -> str:
        from conflictdb.model import notebook

        return notebook.state_html(self)


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why two objects are or are not in conflict: the result of the SQL function `explain_conflict`.

    facts : the JSON object, with ``verdict``, ``why``, ``decided_by``, ``stages``, ``pieces``, ``is_current`` and more;
        in ``delays`` the `Delays` of both tracks, each within two hours and with the other object alone
    text : the same in words, some lines
    """

    facts: dict[str, Any]
    text: str

    def __str__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        from conflictdb.model import notebook

        return notebook.text_html(self.text)


@dataclass(frozen=True, slots=True)
class Forbidden:
    """Departures of a track that are in conflict: delays in [from_s, to_s], seconds, negative for earlier ones.

    from_s, to_s : whole microseconds, rounded outward and cut off at the horizon; all other delays are proven free
    from_error_s, to_error_s : how far outside of a delay that is proven forbidden each end lies
    is_proven : whether each delay between these is proven forbidden; else some of them may be free
    by : the keys of the objects that the track would meet
    """

    from_s: float
    to_s: float
    from_error_s: float
    to_error_s: float
    is_proven: bool
    by: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Slot:
    """A window of departures that meet nothing: delays in [from_s, to_s], seconds, whole microseconds.

    from_at, to_at : these departures
    """

    from_s: float
    to_s: float
    from_at: datetime
    to_at: datetime


@dataclass(frozen=True, slots=True)
class Opening:
    """A change of an area with one span: it ends, or starts, at another time in this span; the other one is None."""

    key: str
    ends_at: datetime | None
    starts_at: datetime | None


@dataclass(frozen=True, slots=True)
class Closed:
    """Departures that the same objects close: delays in [from_s, to_s], seconds, whole microseconds.

    from_at, to_at : these departures
    by : the keys of all objects that close some of them
    opened_by : the departures are free if each of these areas, all of `by`, changes; empty if that is not enough, as
        for a track
    """

    from_s: float
    to_s: float
    from_at: datetime
    to_at: datetime
    by: tuple[str, ...]
    opened_by: tuple[Opening, ...] = ()


@dataclass(frozen=True, slots=True)
class Delays:
    """When a track could depart instead, if everything else stays as planned: what `delays` returns.

    forbidden : the departures within the horizon that are in conflict, also if only grazing, in order
    least_later_s, least_earlier_s : how much later, or earlier, it must depart at least to meet nothing, seconds, in
        whole microseconds and rounded away from the conflict: 0 without a conflict, None if no possible delay is enough
    blocked_by : the keys of the objects that forbid every possible delay, such as a permanent area
    waits : whether its first leg stands still, so that it occupies its first waypoint until it departs
    has_departed : whether it left its first waypoint before `now`, so that nothing can be shifted
    earliest_s, latest_s : the delays that are possible: within the horizon, and not before `now`; 0 and 0 if it has
        departed. `forbidden` has the whole horizon.
    clear_within_m : the range of `clear_by_m`; None: not asked for
    clear_by_m, clear_error_m : how much farther than the required separation it stays, as planned, from everything that
        shares its heights and, within the separation in time, its time, metres, and the error: 0 if it is in conflict,
        None beyond the range. Where it could not be computed it is 0, and the error None
    departs_at : when it departs as planned, or leaves the waypoint of the question; None: unknown, or unbounded
    margin_s, margin_m : wanted on top of the required separations in time and distance: forbidden are all departures
        that come nearer
    slots : free windows of departures, best first: nearest to the planned departure; None: not asked for
    closed : what closes the other departures, in order; None: not asked for
    """

    key: str
    forbidden: tuple[Forbidden, ...]
    least_later_s: float | None
    least_earlier_s: float | None
    blocked_by: tuple[str, ...]
    waits: bool
    has_departed: bool
    earliest_s: float
    latest_s: float
    clear_within_m: float | None = None
    clear_by_m: float | None = None
    clear_error_m: float | None = None
    departs_at: datetime | None = None
    margin_s: float = 0.0
    margin_m: float = 0.0
    slots: tuple[Slot, ...] | None = None
    closed: tuple[Closed, ...] | None = None

    @property
    def clear_by_s(self) -> float | None:
        """How much later or earlier the track may depart without a conflict, seconds: 0 if it is in conflict.

        None if no departure within the horizon is in conflict. Earlier departures may lie before `now`.
        """
        least_s = [max(one.from_s, -one.to_s, 0.0) for one in self.forbidden]
        return min(least_s, default=None)

    def as_json(self) -> dict[str, Any]:
        """Return this as an object of JSON."""
        found = asdict(self)
        closed = found["closed"] or ()
        openings = (each for one in closed for each in one["opened_by"])
        for one in (found, *(found["slots"] or ()), *closed, *openings):
            one |= {name: format_moment(value) for name, value in one.items() if name.endswith("_at")}
        return found


@dataclass(frozen=True, slots=True)
class ForbiddenSpeeds:
    """Speeds of a track that are in conflict: in [from_factor, to_factor], by the planned one.

    from_factor, to_factor : whole trillionths, rounded outward and cut off at the limits; all other speeds are free
    from_error, to_error : how far outside of a speed that is proven forbidden each end lies
    is_proven : whether each speed between these is proven forbidden; else some of them may be free
    by : the keys of the objects that the track would meet
    """

    from_factor: float
    to_factor: float
    from_error: float
    to_error: float
    is_proven: bool
    by: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Speeds:
    """At which speed a track could go instead, if everything else stays as planned: what `speeds` returns.

    leg : the leg that has another speed, 1 the first; None: all of them
    forbidden : the speeds within the limits that are in conflict, also if only grazing, in order
    slower, faster : the nearest speed that meets nothing, by the planned one: 1 without a conflict, None if none within
        the limits does
    blocked_by : the keys of the objects that forbid every speed within the limits, such as a permanent area
    """

    key: str
    leg: int | None
    forbidden: tuple[ForbiddenSpeeds, ...]
    slower: float | None
    faster: float | None
    blocked_by: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return this as an object of JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Chances:
    """How likely conflicts are if plans are uncertain: what `chances` returns. All are (at least, at most).

    pairs : probability of each conflict, by the keys of a track and of what it meets; all other pairs together add less
        than 1e-12 for each normal distribution, times the objects
    expected : the expected number of conflicts of tracks
    tracks : the probability that each track is in any conflict
    """

    pairs: dict[tuple[str, str], tuple[float, float]]
    expected: tuple[float, float]
    tracks: dict[str, tuple[float, float]]


class Origin(Protocol):
    """The origin of conflicts, which has their objects."""

    def plot_conflict(self, conflict: Conflict) -> "Figure":
        """Return the figure of one of its conflicts."""


class Results(list[_Row]):
    """A list of conflicts or closest approaches, convertible to a data frame.

    kind : class of its rows, Conflict or Approach, also if it is empty
    """

    def __init__(self, rows: Iterable[_Row], kind: type[_Row]) -> None:
        super().__init__(rows)
        self.kind = kind

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a DataFrame of pandas with the columns of the view `conflicts`, or `approaches`.

        Instants are to the microsecond in UTC, NaT where a period is unbounded; `periods` are as in a `Conflict`.
        Geometries are of shapely, in longitude and latitude. `geometry` is the conflict's region if that was read, else
        its first contact; for a closest approach, the line between the nearest points.

        Raises ConflictDBError, naming the extra to install, without pandas.
        """
        from conflictdb.model import frames  # not above: it brings numpy and shapely

        if issubclass(self.kind, Approach):
            return frames.approach_frame(cast("list[Approach]", self))
        return frames.conflict_frame(cast("list[Conflict]", self))

    def to_geodataframe(self) -> "geopandas.GeoDataFrame":
        """Return `to_dataframe` as a GeoDataFrame of geopandas, in EPSG:4326, for maps and for `to_file`.

        `geometry` is its only geometry column, because most file formats store only one. Other points are columns of
        degrees: `first_contact_lon_deg` and `first_contact_lat_deg` instead of `first_contact_point`. `periods` are
        text: ISO 8601 intervals, separated by spaces; an unbounded end is two dots.

        Raises ConflictDBError, naming the extra to install, without geopandas.
        """
        from conflictdb.model import frames

        return frames.with_geometry(self.to_dataframe())

    def _repr_html_(self) -> str:
        from conflictdb.model import notebook

        if issubclass(self.kind, Approach):
            return notebook.approaches_html(cast("list[Approach]", self))
        return notebook.conflicts_html(cast("list[Conflict]", self))


@dataclass(frozen=True, slots=True)
class Admission:
    """Whether plans were admitted to a scene; true if they were.

    conflicts : of the plans, as far as they were computed; near pairs are left out
    new : those of them that the plans in their place did not have, or not as long or as severe
    """

    is_admitted: bool
    conflicts: Results[Conflict]
    new: Results[Conflict]

    def __bool__(self) -> bool:
        return self.is_admitted


@dataclass(frozen=True, slots=True)
class Certified:
    """What a proof holds, which `certify` wrote; true if nothing that it is about lacks a proof.

    objects : of the scene
    pairs : pairs of pieces of objects that are near each other; directions : that prove them apart
    conflicts : whose periods and depth are proven, or should be
    unproven_pairs, unproven_conflicts : of these, without proof
    delays, unproven_delays : least delays that were asked for, and those without proof
    """

    objects: int
    pairs: int
    directions: int
    conflicts: int
    unproven_pairs: int
    unproven_conflicts: int
    delays: int = 0
    unproven_delays: int = 0

    def __bool__(self) -> bool:
        return not (self.unproven_pairs or self.unproven_conflicts or self.unproven_delays)


class Listing(Results[_Row]):
    """A list of conflicts or closest approaches of a stored scene that says whether it is complete.

    state : of the scene, read before the list: if it is current, the list is complete
    """

    def __init__(self, state: SceneState, rows: Iterable[_Row], kind: type[_Row]) -> None:
        super().__init__(rows, kind)
        self.state = state

    @property
    def is_current(self) -> bool:
        """Whether it is complete: nothing in the scene waited for detection when it was read."""
        return self.state.is_current

    def _repr_html_(self) -> str:
        from conflictdb.model import notebook

        return notebook.remark_html(self.state.remark) + super()._repr_html_()


class Stream(Iterator[_Row]):
    """An iterator over conflicts or closest approaches of a stored scene, fetched in batches.

    The connection's transaction stays open until the iterator ends or is closed.

    state, kind : as of a `Listing`
    """

    def __init__(self, state: SceneState, rows: Generator[_Row, None, None], kind: type[_Row]) -> None:
        self.state = state
        self.kind = kind
        self._rows = rows

    def __next__(self) -> _Row:
        return next(self._rows)

    def close(self) -> None:
        """Stop reading and end the transaction."""
        self._rows.close()

    @property
    def is_current(self) -> bool:
        """Whether it is complete: nothing in the scene waited for detection when it began."""
        return self.state.is_current
