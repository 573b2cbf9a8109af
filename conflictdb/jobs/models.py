"""The tables of inputs and the views of answers as models of SQLAlchemy 2, geometries by GeoAlchemy2.

Needs the extra `sqlalchemy`: ``pip install 'conflictdb[sqlalchemy]'``. A class is named for its rows: `ConflictRow` of
the view `conflicts`, beside `conflictdb.Conflict`, the record of an answer. The columns are as docs/reference/sql.md
says: tests keep names, types and nullability equal to the database. Rows of the tables `scene`, `area` and `track` can
be added, changed and deleted; the others are answers. Functions need no model: ``func.conflictdb.put_area(...)``.
"""

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any, Final

from sqlalchemy import ARRAY, BigInteger, DateTime, Double, FetchedValue, ForeignKey, Identity, Integer, MetaData, Text
from sqlalchemy.dialects.postgresql import INTERVAL, JSONB, TSTZMULTIRANGE, TSTZRANGE, Range
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

try:
    from geoalchemy2 import Geometry, WKBElement
except ImportError as error:
    raise ImportError("conflictdb.models needs geoalchemy2: pip install 'conflictdb[sqlalchemy]'") from error

_DEGREES: Final = 4326  # longitude and latitude on WGS84
_METRES: Final = -1  # to starboard and forward of a reference point: no place on the earth


def _geometry(kind: str, srid: int = _DEGREES) -> Geometry:
    """Return the type of a column."""
    return Geometry(kind, srid=srid, dimension=3 if kind.endswith("M") else 2, spatial_index=False)


class Base(DeclarativeBase):
    """Of all models; `conflictdb admin init` makes the tables, not ``metadata.create_all``."""

    metadata = MetaData(schema="conflictdb")
    type_annotation_map = {  # noqa: RUF012  as SQLAlchemy wants it
        int: BigInteger,
        str: Text,
        float: Double,
        datetime: DateTime(timezone=True),
        timedelta: INTERVAL,
        dict[str, Any]: JSONB,
        list[dict[str, Any]]: JSONB,
        list[str]: ARRAY(Text),
        list[float | None]: ARRAY(Double),
        list[datetime]: ARRAY(DateTime(timezone=True)),
        Range[datetime]: TSTZRANGE,
        Sequence[Range[datetime]]: TSTZMULTIRANGE,
    }


class SceneRow(Base):
    """Settings that objects share: a row of the table `scene`."""

    __tablename__ = "scene"

    scene_id: Mapped[int] = mapped_column(Identity(always=True), primary_key=True)
    name: Mapped[str]
    history_kept: Mapped[timedelta | None]
    owner: Mapped[str | None] = mapped_column(server_default=FetchedValue())
    expanded: Mapped[Range[datetime] | None]
    parent_scene_id: Mapped[int | None]
    # Made by docs/generate.py.
    motion: Mapped[str] = mapped_column(server_default=FetchedValue())
    earth: Mapped[str] = mapped_column(server_default=FetchedValue())
    method: Mapped[str] = mapped_column(server_default=FetchedValue())
    tolerance_m: Mapped[float] = mapped_column(server_default=FetchedValue())
    separation_m: Mapped[float] = mapped_column(server_default=FetchedValue())
    nearest_m: Mapped[float] = mapped_column(server_default=FetchedValue())
    centre_lon: Mapped[float | None]
    centre_lat: Mapped[float | None]
    vertical_separation_m: Mapped[float] = mapped_column(server_default=FetchedValue())
    time_separation_s: Mapped[float] = mapped_column(server_default=FetchedValue())
    delays_within_s: Mapped[float] = mapped_column(server_default=FetchedValue())
    intervals: Mapped[str] = mapped_column(server_default=FetchedValue())
    horizon_days: Mapped[float] = mapped_column(server_default=FetchedValue())
    vertical_datum: Mapped[str] = mapped_column(server_default=FetchedValue())
    regions: Mapped[str] = mapped_column(server_default=FetchedValue())


class AreaRow(Base):
    """A polygon that is closed for a time: a row of the table `area`."""

    __tablename__ = "area"

    area_id: Mapped[int] = mapped_column(Identity(always=True), primary_key=True)
    scene_id: Mapped[int] = mapped_column(ForeignKey(SceneRow.scene_id))
    key: Mapped[str]
    version: Mapped[int] = mapped_column(server_default=FetchedValue(), server_onupdate=FetchedValue())
    first_version: Mapped[int] = mapped_column(server_default=FetchedValue())
    schedule_error: Mapped[str | None]
    # Made by docs/generate.py.
    footprint: Mapped[WKBElement] = mapped_column(_geometry("MULTIPOLYGON"))
    active_span: Mapped[Range[datetime]] = mapped_column(server_default=FetchedValue())
    floor_m: Mapped[float | None]
    ceiling_m: Mapped[float | None]
    name: Mapped[str | None]
    properties: Mapped[dict[str, Any]] = mapped_column(server_default=FetchedValue())
    object_class: Mapped[str | None] = mapped_column("class")
    owner: Mapped[str | None]
    activations: Mapped[Sequence[Range[datetime]] | None]
    schedule: Mapped[dict[str, Any] | None]


class TrackRow(Base):
    """A polygon carried along waypoints: a row of the table `track`."""

    __tablename__ = "track"

    track_id: Mapped[int] = mapped_column(Identity(always=True), primary_key=True)
    scene_id: Mapped[int] = mapped_column(ForeignKey(SceneRow.scene_id))
    key: Mapped[str]
    version: Mapped[int] = mapped_column(server_default=FetchedValue(), server_onupdate=FetchedValue())
    first_version: Mapped[int] = mapped_column(server_default=FetchedValue())
    schedule_error: Mapped[str | None]
    # Made by docs/generate.py.
    path: Mapped[WKBElement] = mapped_column(_geometry("LINESTRINGM"))
    outline: Mapped[WKBElement] = mapped_column(_geometry("POLYGON", srid=_METRES))
    floor_m: Mapped[float | None]
    ceiling_m: Mapped[float | None]
    name: Mapped[str | None]
    properties: Mapped[dict[str, Any]] = mapped_column(server_default=FetchedValue())
    grow_mps: Mapped[float] = mapped_column(server_default=FetchedValue())
    outlines: Mapped[WKBElement | None] = mapped_column(_geometry("MULTIPOLYGON", srid=_METRES))
    floors_m: Mapped[list[float | None] | None]
    ceilings_m: Mapped[list[float | None] | None]
    object_class: Mapped[str | None] = mapped_column("class")
    owner: Mapped[str | None]
    tolerances: Mapped[dict[str, Any] | None]
    departures: Mapped[list[datetime] | None]
    schedule: Mapped[dict[str, Any] | None]


class ConflictRow(Base):
    """A pair that interferes: a row of the view `conflicts`."""

    __tablename__ = "conflicts"

    scene: Mapped[str] = mapped_column(primary_key=True)
    a_key: Mapped[str] = mapped_column(primary_key=True)
    a_kind: Mapped[str]
    b_key: Mapped[str] = mapped_column(primary_key=True)
    b_kind: Mapped[str]
    periods: Mapped[Sequence[Range[datetime]]]
    first_contact: Mapped[datetime | None]
    last_contact: Mapped[datetime | None]
    verdict: Mapped[str]
    region: Mapped[WKBElement | None] = mapped_column(_geometry("GEOMETRY"), deferred=True)  # it takes long
    first_contact_point: Mapped[WKBElement | None] = mapped_column(_geometry("POINT"))
    method: Mapped[str]
    time_error_s: Mapped[float]
    is_current: Mapped[bool]
    run_id: Mapped[int]
    found_at: Mapped[datetime]
    closest_at: Mapped[datetime | None]
    closest_m: Mapped[float | None]
    closest_error_m: Mapped[float | None]
    closest_a_point: Mapped[WKBElement | None] = mapped_column(_geometry("POINT"))
    closest_b_point: Mapped[WKBElement | None] = mapped_column(_geometry("POINT"))
    scene_is_current: Mapped[bool]
    conflict_id: Mapped[int]
    opened_at: Mapped[datetime]
    changed_at: Mapped[datetime | None]
    acknowledged_by: Mapped[str | None]
    acknowledged_at: Mapped[datetime | None]
    acknowledged_for: Mapped[str | None]
    acknowledged_until: Mapped[datetime | None]
    first_contact_lon_deg: Mapped[float | None]
    first_contact_lat_deg: Mapped[float | None]
    a_name: Mapped[str | None]
    b_name: Mapped[str | None]
    lacking_s: Mapped[float | None]
    certainty: Mapped[str | None]
    a_table: Mapped[str | None]
    a_row: Mapped[dict[str, Any] | None]
    b_table: Mapped[str | None]
    b_row: Mapped[dict[str, Any] | None]


class ApproachRow(Base):
    """How close a pair comes: a row of the view `approaches`."""

    __tablename__ = "approaches"

    scene: Mapped[str] = mapped_column(primary_key=True)
    a_key: Mapped[str] = mapped_column(primary_key=True)
    a_kind: Mapped[str]
    b_key: Mapped[str] = mapped_column(primary_key=True)
    b_kind: Mapped[str]
    closest_at: Mapped[datetime | None]
    closest_m: Mapped[float]
    closest_error_m: Mapped[float]
    a_point: Mapped[WKBElement] = mapped_column(_geometry("POINT"))
    b_point: Mapped[WKBElement] = mapped_column(_geometry("POINT"))
    verdict: Mapped[str]
    is_current: Mapped[bool]
    run_id: Mapped[int]
    found_at: Mapped[datetime]
    scene_is_current: Mapped[bool]
    method: Mapped[str]
    time_error_s: Mapped[float]
    a_name: Mapped[str | None]
    b_name: Mapped[str | None]


class SceneStateRow(Base):
    """A scene, and whether what is known of it is complete: a row of the view `scenes`."""

    __tablename__ = "scenes"

    scene: Mapped[str] = mapped_column(primary_key=True)
    objects: Mapped[int]
    pending: Mapped[int]
    last_run_id: Mapped[int | None]
    last_run_at: Mapped[datetime | None]
    last_error: Mapped[str | None]
    is_current: Mapped[bool]
    unmapped: Mapped[int]
    expanded_from: Mapped[datetime | None]
    expanded_until: Mapped[datetime | None]
    branch_of: Mapped[str | None]
    compared_at: Mapped[datetime | None]
    # Made by docs/generate.py.
    motion: Mapped[str]
    earth: Mapped[str]
    method: Mapped[str]
    tolerance_m: Mapped[float]
    separation_m: Mapped[float]
    nearest_m: Mapped[float]
    centre_lon: Mapped[float | None]
    centre_lat: Mapped[float | None]
    vertical_separation_m: Mapped[float]
    time_separation_s: Mapped[float]
    delays_within_s: Mapped[float]
    intervals: Mapped[str]
    horizon_days: Mapped[float]
    vertical_datum: Mapped[str]
    regions: Mapped[str]


class ConflictEventRow(Base):
    """What became of a conflict: a row of the view `conflict_events`."""

    __tablename__ = "conflict_events"

    scene: Mapped[str]
    event: Mapped[int] = mapped_column(primary_key=True)
    kind: Mapped[str]
    at: Mapped[datetime]
    run_id: Mapped[int]
    conflict_id: Mapped[int]
    a_key: Mapped[str]
    a_kind: Mapped[str]
    b_key: Mapped[str]
    b_kind: Mapped[str]
    periods: Mapped[Sequence[Range[datetime]]]
    verdict: Mapped[str]
    time_error_s: Mapped[float]
    closest_at: Mapped[datetime | None]
    closest_m: Mapped[float | None]
    closest_error_m: Mapped[float | None]
    opened_at: Mapped[datetime]
    closed_at: Mapped[datetime | None]
    proposal_id: Mapped[int | None]


class ProposalRow(Base):
    """Changes of tracks that clear a scene: a row of the view `proposals`."""

    __tablename__ = "proposals"

    scene: Mapped[str]
    proposal_id: Mapped[int] = mapped_column(primary_key=True)
    made_at: Mapped[datetime]
    made_by: Mapped[str]
    state: Mapped[str]
    goal: Mapped[str]
    objective_s: Mapped[float]
    bound_s: Mapped[float]
    is_least: Mapped[bool]
    moves: Mapped[list[dict[str, Any]]]
    left_as_planned: Mapped[list[dict[str, Any]]]
    applied_at: Mapped[datetime | None]
    applied_by: Mapped[str | None]
    undone_at: Mapped[datetime | None]
    undone_by: Mapped[str | None]


class SeparationRuleRow(Base):
    """A separation rule: a row of the view `rules`."""

    __tablename__ = "rules"

    scene: Mapped[str] = mapped_column(primary_key=True)
    a_class: Mapped[str | None] = mapped_column(primary_key=True, nullable=True)
    b_class: Mapped[str | None] = mapped_column(primary_key=True, nullable=True)
    separation_m: Mapped[float | None]
    vertical_m: Mapped[float | None]
    time_s: Mapped[float | None]
    allowed: Mapped[bool]
    yields: Mapped[str | None]


class AcknowledgementRow(Base):
    """What was acknowledged: a row of the view `acknowledgements`."""

    __tablename__ = "acknowledgements"

    scene: Mapped[str]
    conflict_id: Mapped[int] = mapped_column(primary_key=True)
    a_key: Mapped[str]
    b_key: Mapped[str]
    acknowledged_by: Mapped[str]
    acknowledged_at: Mapped[datetime] = mapped_column(primary_key=True)
    reason: Mapped[str]
    until: Mapped[datetime | None]
    periods: Mapped[Sequence[Range[datetime]]]
    verdict: Mapped[str]
    state: Mapped[str]
    ended_by: Mapped[str | None]
    ended_at: Mapped[datetime | None]


class ShareRow(Base):
    """Whose a scene is, or a role that it is shared with: a row of the view `shares`."""

    __tablename__ = "shares"

    scene: Mapped[str] = mapped_column(primary_key=True)
    role: Mapped[str] = mapped_column(primary_key=True)
    access: Mapped[str] = mapped_column(primary_key=True)
    shared_by: Mapped[str | None]
    shared_at: Mapped[datetime | None]


class LiveRow(Base):
    """How a track with positions keeps its plan: a row of the view `live`."""

    __tablename__ = "live"

    scene: Mapped[str] = mapped_column(primary_key=True)
    key: Mapped[str] = mapped_column(primary_key=True)
    state: Mapped[str]
    late_from_s: Mapped[float | None]
    late_to_s: Mapped[float | None]
    off_m: Mapped[float | None]
    instant: Mapped[datetime]
    place: Mapped[WKBElement] = mapped_column(_geometry("POINT"))
    height_m: Mapped[float | None]
    error_m: Mapped[float]
    as_of: Mapped[datetime]
    slack_s: Mapped[float | None]
    first_alarm: Mapped[datetime | None]


class LiveConflictRow(Base):
    """A conflict that follows if tracks keep their lateness: a row of the view `live_conflicts`."""

    __tablename__ = "live_conflicts"

    scene: Mapped[str]
    alarm_id: Mapped[int] = mapped_column(primary_key=True)
    key: Mapped[str]
    other_key: Mapped[str | None]
    verdict: Mapped[str]
    reason: Mapped[str | None]
    first_contact: Mapped[datetime | None]
    last_contact: Mapped[datetime | None]
    place: Mapped[WKBElement | None] = mapped_column(_geometry("POINT"))
    opened_at: Mapped[datetime]
    as_of: Mapped[datetime]
    acknowledged_by: Mapped[str | None]
    acknowledged_at: Mapped[datetime | None]
    acknowledged_for: Mapped[str | None]


class LiveEventRow(Base):
    """An alarm that began or ended: a row of the view `live_events`."""

    __tablename__ = "live_events"

    scene: Mapped[str]
    event: Mapped[int] = mapped_column(primary_key=True)
    kind: Mapped[str]
    at: Mapped[datetime]
    alarm_id: Mapped[int]
    key: Mapped[str]
    other_key: Mapped[str | None]
    verdict: Mapped[str]
    reason: Mapped[str | None]
    first_contact: Mapped[datetime | None]
    last_contact: Mapped[datetime | None]
    place: Mapped[WKBElement | None] = mapped_column(_geometry("POINT"))


class EditRow(Base):
    """An edit of a plan, rule or scene: a row of the view `edits`."""

    __tablename__ = "edits"

    edit: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[datetime]
    scene: Mapped[str | None]
    kind: Mapped[str]
    action: Mapped[str]
    key: Mapped[str] = mapped_column(primary_key=True)
    former_key: Mapped[str | None]
    role: Mapped[str]
    login: Mapped[str]
    application: Mapped[str | None]
    client: Mapped[str | None]
    pid: Mapped[int] = mapped_column(Integer)
    transaction_id: Mapped[str]


class LimitRow(Base):
    """A limit, which administrators set: a row of the view `limits`."""

    __tablename__ = "limits"

    name: Mapped[str] = mapped_column(primary_key=True)
    value: Mapped[float | None]
    default_value: Mapped[float | None]
    unit: Mapped[str]
    doc: Mapped[str]


class QueuedRow(Base):
    """A scene that waits for detection: a row of the view `queue`."""

    __tablename__ = "queue"

    scene: Mapped[str] = mapped_column(primary_key=True)
    waiting_since: Mapped[datetime | None]
    changes: Mapped[int]
    attached_changes: Mapped[int]
    worker_pid: Mapped[int | None] = mapped_column(Integer)
    worker: Mapped[str | None]
    worker_role: Mapped[str | None]
    worked_on_since: Mapped[datetime | None]
    last_error: Mapped[str | None]


class AttachmentRow(Base):
    """A table that is attached: a row of the view `attachments`."""

    __tablename__ = "attachments"

    scene: Mapped[str]
    attachment_id: Mapped[int] = mapped_column(primary_key=True)
    kind: Mapped[str]
    table: Mapped[str]
    map: Mapped[dict[str, Any]]
    role: Mapped[str | None] = mapped_column(Text)
    has_triggers: Mapped[bool]
    every: Mapped[timedelta]
    objects: Mapped[int]
    unmapped: Mapped[int]
    is_waiting: Mapped[bool]
    compared_at: Mapped[datetime | None]
    failed_at: Mapped[datetime | None]
    error: Mapped[str | None]
    remark: Mapped[str | None]


class UnmappedRow(Base):
    """A row of an attached table that is no object: a row of the view `unmapped`."""

    __tablename__ = "unmapped"

    scene: Mapped[str]
    attachment_id: Mapped[int] = mapped_column(primary_key=True)
    table: Mapped[str]
    identity_columns: Mapped[list[str]]
    identity: Mapped[str] = mapped_column(primary_key=True)
    key: Mapped[str | None]
    reason: Mapped[str]
    since: Mapped[datetime]
    is_kept: Mapped[bool]
