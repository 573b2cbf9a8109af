"""Format results for a terminal: conflicts, runs, and the effects of loading."""

import argparse
import shlex
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime, tzinfo
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from conflictdb.cli.codes import DONE, NOT_CURRENT
from conflictdb.cli.output import as_called, binary, data, note, out, remark
from conflictdb.cli.tables import coloured, show_table, table
from conflictdb.cli.values import chosen_units, chosen_zone
from conflictdb.core.ranking import Known, facts_of, missing_text, worst_first
from conflictdb.errors import NotCurrent, said_once
from conflictdb.model.notebook import whole_second
from conflictdb.model.record import REMARKS, Column
from conflictdb.model.results import Approach, Conflict, SceneState, format_moment, labelled, position_of
from conflictdb.model.units import Units

if TYPE_CHECKING:
    from conflictdb.client.loading import Loaded
    from conflictdb.formats.conflict_ics import Activation
    from conflictdb.formats.conflict_text import MoreColumn
    from conflictdb.formats.contents import Remark, Skipped
    from conflictdb.jobs.detect import Run
    from conflictdb.store import SceneStatus


@dataclass(frozen=True, slots=True)
class Shown:
    """How tables show conflicts.

    zone : time zone, by default that of CONFLICTDB_TZ; times outside UTC show their offset
    more : of position (longitude and latitude of the first contact), microseconds, acknowledged (who, until when, why)
    """

    zone: tzinfo = field(default_factory=chosen_zone)
    more: Collection[str] = ()

    def moment(self, moment: datetime | None, *, up: bool) -> str:
        """Return a moment to the second, rounded up or down, or to the microsecond; two dots for an unbounded end."""
        if moment is None:
            return ".."
        is_fine = "microseconds" in self.more
        moment = (moment if is_fine else whole_second(moment, up=up)).astimezone(self.zone)
        moment = moment.replace(tzinfo=None) if self.zone is UTC else moment
        return moment.isoformat(" ", "microseconds" if is_fine else "seconds")

    def header(self, text: str) -> str:
        """Return the header of a column of times."""
        return f"{text} (UTC)" if self.zone is UTC else text


_NO_DEPTHS: Final[Known] = {}


def print_conflicts(
    conflicts: Iterable[Conflict],
    states: Sequence[SceneState],
    form: str,
    more: "Sequence[MoreColumn]" = (),
    *,
    shown: Shown | None = None,
    known_depths: Callable[[Sequence[Conflict]], Known] = lambda _: {},
    activations: "Sequence[Activation]" = (),
) -> None:
    """Print conflicts as a table, JSON, CSV, GeoJSON, GPX, iCalendar or GeoParquet, and remarks on incomplete scenes.

    known_depths : returns how deep conflicts are, for the table
    activations : of an area, for iCalendar
    """
    remark_incomplete(states)
    if form == "geoparquet":
        from conflictdb.formats.writing import write_geoparquet  # tables need none

        with binary() as stream:
            write_geoparquet(stream, conflicts)
    elif form != "table":
        from conflictdb.formats.writing import lines_of  # the same

        left_out: list[Conflict] = []
        lines = lines_of(conflicts, form, Conflict, states, more, left_out.append, activations)
        data(lines, is_json=form in ("json", "geojson"))
        if left_out:
            remark(f"left out {len(left_out)}: {'no position' if form == 'gpx' else 'no start or no end'}")
    elif rows := list(conflicts):
        known = known_depths(rows)
        show_table(conflict_table(worst_first(rows, known), more, shown=shown, known=known))
    else:
        out("no conflicts" if all(state.is_current for state in states) else "no conflict is known")


def print_approaches(
    approaches: Iterable[Approach], states: Sequence[SceneState], form: str, shown: Shown | None = None
) -> None:
    """Print closest approaches as `print_conflicts` prints conflicts."""
    remark_incomplete(states)
    if form != "table":
        from conflictdb.formats.writing import lines_of  # tables need none

        data(lines_of(approaches, form, Approach, states), is_json=form != "csv")
    elif rows := list(approaches):
        show_table(approach_table(rows, shown=shown))
    else:
        out("no closest approach is known")


def remark_incomplete(states: Iterable[SceneState]) -> None:
    """Print which scenes are incomplete, and other remarks on their state."""
    for state in states:
        if state.remark:
            remark(f"{state.scene}: {state.remark if state.is_current else _incomplete(state)}")
        elif state.compared_at is not None:
            at = moment_text(state.compared_at, up=False)
            note(f"{state.scene}: views as of {at}{' UTC' if Shown().zone is UTC else ''}")


def require_current(args: argparse.Namespace, state: SceneState) -> None:
    """Raise NotCurrent if `--require-current` is given and the scene is not current."""
    if args.require_current and not state.is_current:
        raise NotCurrent(f"{state.scene}: {_incomplete(state)}")


def listed(state: SceneState) -> int:
    """Return the exit code of a list of a scene; a scene without a detection does not count as empty."""
    return DONE if state.is_current or state.detected_at is not None else NOT_CURRENT


def _incomplete(state: SceneState) -> str:
    if not state.detection_helps:
        return f"not complete: {state.remark}"
    return f"not complete: {state.remark} (`conflictdb detect --scene {shlex.quote(state.scene)}` does it)"


# A column of a table of pairs: its header, and the cell of a pair.
_Column = tuple[str, Callable[[Any], object]]


def conflict_table(
    conflicts: Sequence[Conflict],
    more: "Sequence[MoreColumn]" = (),
    *,
    shown: Shown | None = None,
    known: Known = _NO_DEPTHS,
) -> str:
    """Return a table of conflicts, one line per pair, times rounded outward to the second.

    known : depths, for a column in words
    """
    shown = shown or Shown()
    times = [shown.header(text) for text in ("FIRST CONTACT", "LAST CONTACT", "AT", "UNTIL")]
    columns: list[_Column] = [
        *_PAIR,
        (times[0], lambda one: shown.moment(one.first_contact, up=False)),
        (times[1], lambda one: shown.moment(one.last_contact, up=True)),
        ("PERIODS", lambda one: len(one.periods)),
    ]
    if known:
        units = chosen_units()
        columns.append(
            ("HOW CLOSE", lambda one: missing_text(facts_of(one).moving, known.get((one.a_key, one.b_key)), units))
        )
    remarks = [one for one in REMARKS if any(getattr(conflict, one.field) is not None for conflict in conflicts)]
    columns += [(_header(one), partial(_remark, one)) for one in remarks]
    if "position" in shown.more:
        columns += [("LATITUDE", lambda one: _degrees(one, 1)), ("LONGITUDE", lambda one: _degrees(one, 0))]
    if "acknowledged" in shown.more:
        columns += [
            ("ACKNOWLEDGED BY", lambda one: one.acknowledged_by),
            (times[2], lambda one: one.acknowledged_by and shown.moment(one.acknowledged_at, up=False)),
            (times[3], lambda one: one.acknowledged_by and shown.moment(one.acknowledged_until, up=False)),
            ("REASON", lambda one: one.acknowledged_for),
        ]
    right = ["PERIODS", *(_header(one) for one in remarks if one.unit), "LATITUDE", "LONGITUDE"]
    return _pair_table(conflicts, columns, more, right=right, whole=times)


def _header(column: Column) -> str:
    return column.name.upper().replace("_", " ")


def _remark(column: Column, one: Conflict) -> object:
    value = getattr(one, column.field)
    return f"{value:.1f}" if isinstance(value, float) else value


def approach_table(
    approaches: Sequence[Approach | Conflict], more: "Sequence[MoreColumn]" = (), *, shown: Shown | None = None
) -> str:
    """Return a table of closest approaches, one line per pair, times to the second."""
    shown, units = shown or Shown(), chosen_units()
    closest = shown.header("CLOSEST")
    columns: list[_Column] = [
        *_PAIR,
        (closest, lambda one: shown.moment(one.closest_at, up=False)),
        ("HOW FAR", lambda one: None if one.closest_m is None else _apart(one.closest_m, units)),
        ("METRES", lambda one: None if one.closest_m is None else f"{one.closest_m:.1f}"),
    ]
    return _pair_table(approaches, columns, more, right=["METRES"], whole=[closest])


def _apart(closest_m: float, units: Units) -> str:
    """Return a least distance in words, rounded down."""
    return f"{units.least_distance(closest_m)} apart" if closest_m >= 0.05 else "they meet"


def _pair_table(
    pairs: Sequence[Approach | Conflict],
    columns: list[_Column],
    more: "Sequence[MoreColumn]",
    right: Sequence[str],
    whole: Sequence[str],
) -> str:
    """Return a table with further columns before its own, before these the scene if there are several, names last."""
    first, last = (
        [(one.name.upper(), one.text) for one in more if one.is_last == is_last] for is_last in (False, True)
    )
    columns = [*first, *columns, *last]
    if len({pair.scene for pair in pairs}) > 1:
        columns.insert(0, ("SCENE", lambda one: one.scene))
    rows = [[cell(pair) for _, cell in columns] for pair in pairs]
    names = [(pair.a_name, pair.b_name) for pair in pairs]
    return table_with_names([name for name, _ in columns], rows, names, right, whole)


def table_with_names(
    header: Sequence[str],
    rows: Iterable[Sequence[object]],
    names: Sequence[tuple[str | None, str | None]],
    right: Sequence[str],
    whole: Sequence[str],
) -> str:
    """Return a table of pairs; if they have names, these are the last columns, which a narrow table can do without."""
    if not any(one for row in names for one in row):
        return table(header, rows, right=right, whole=whole)
    shown = ([*row, *some] for row, some in zip(rows, names, strict=True))
    titles = ["A NAME", "B NAME"]
    return table([*header, *titles], shown, right=right, whole=whole, extra=titles)


def labels(names: Mapping[str, str], keys: Iterable[str]) -> str:
    """Return objects in a message or a cell: their keys, each with its name, if it has one."""
    return ", ".join(labelled(key, names.get(key)) for key in keys)


def _verdict_text(pair: Conflict | Approach) -> str:
    marks = ["outdated"] if pair.is_current is False else []
    if isinstance(pair, Conflict) and pair.acknowledged_by is not None:
        marks.append("acknowledged")
    return coloured(pair.verdict, f"{pair.verdict} ({', '.join(marks)})" if marks else str(pair.verdict))


_PAIR: Final[list[_Column]] = [("A", lambda one: one.a_key), ("B", lambda one: one.b_key), ("VERDICT", _verdict_text)]


def _degrees(conflict: Conflict, axis: int) -> str | None:
    position = position_of(conflict)
    return None if position is None else f"{position[axis]:.6f}"


def scene_table(scenes: Sequence["SceneStatus"]) -> str:
    """Return a table of scenes and their last detections."""
    if not scenes:
        return as_called("no scenes: `conflictdb demo` or `conflictdb load FILE` makes one")
    finished = Shown().header("FINISHED")
    header = ["SCENE", "AREAS", "TRACKS", "PENDING", "CONFLICTS", "RUN", finished, "RESULT"]
    has_branches = any(one.branch_of is not None for one in scenes)
    if has_branches:
        header.append("BRANCH OF")
    rows = [
        [
            *(one.scene.name, one.areas, one.tracks, one.pending, one.conflicts, one.run_id),
            *(moment_text(one.finished_at, up=False) if one.finished_at else None, _result(one)),
            *([one.branch_of] if has_branches else []),
        ]
        for one in scenes
    ]
    return table(header, rows, right=header[1:6], whole=[finished], extra=["RUN", finished])


def _result(scene: "SceneStatus") -> str:
    if scene.run_id is None:
        return "never detected"
    return f"failed: {scene.error}" if scene.error else "done"


def moment_text(moment: datetime | None, *, up: bool) -> str:
    """Return a moment to the second, rounded up or down; two dots for an unbounded end."""
    return Shown().moment(moment, up=up)


def json_row(one: Any) -> dict[str, object]:
    """Return a dataclass as JSON shows it: moments and periods as text."""
    return {member.name: _json_value(getattr(one, member.name)) for member in fields(one)}


def _json_value(value: Any) -> object:
    if isinstance(value, tuple):
        return [[format_moment(start), format_moment(end)] for start, end in value]
    return format_moment(value) if isinstance(value, datetime) else value


def span_text(start: datetime | None, end: datetime | None) -> str:
    """Return from when to when, rounded outward to the second; the day once, if it is one."""
    first, last = moment_text(start, up=False), moment_text(end, up=True)
    day, _, time = last.partition(" ")
    return f"{first} to {time if time and first.startswith(day) else last}"


def run_text(scene: str, run: "Run") -> str:
    """Return a line on the results of a detection."""
    parts = [f"{run.conflicts} conflict{'' if run.conflicts == 1 else 's'}"]
    if run.unresolved:
        parts.append(f"{run.unresolved} of them unresolved")
    changes = [f"{n} {what}" for n, what in ((run.opened, "new"), (run.changed, "changed"), (run.closed, "gone")) if n]
    parts.append(", ".join(changes) if changes else "nothing changed")
    return f"{scene}: {', '.join(parts)} (run {run.run_id}, {run.total_s:.2f} s)"


def loaded_text(loaded: "Loaded") -> str:
    """Return a line on the effects of loading on a scene."""
    counts = loaded.counts
    changes = f"{counts.added} added, {counts.updated} updated, {counts.removed} removed, {counts.unchanged} unchanged"
    invalid = len({(one.source, one.key) for one in loaded.invalid})
    return f"{loaded.scene}: {changes}" + (f", {invalid} LEFT OUT" if invalid else "")


def remark_loaded(loaded: "Iterable[Loaded]") -> None:
    """Print the objects left out of files with reasons, remarks on unintended input, and what came, in one line."""
    for one in loaded:
        remark_read(one.skipped, one.remarks)
        if one.came:
            remark(f"{one.scene}: {one.came.text(chosen_units(), chosen_zone())}")


def remark_read(skipped: "Iterable[Skipped]", remarks: "Sequence[Remark]") -> None:
    """Print what was left out of files, and remarks on unintended input."""
    for line in skipped_text(skipped):
        remark(line)
    for line in said_once([(one.source, one.key, one.text) for one in remarks]):
        remark(line)


def skipped_text(skipped: "Iterable[Skipped]") -> list[str]:
    """Return one line per file and reason, with the names of the objects and the number of rows of each."""
    groups: dict[tuple[str, str], list[Skipped]] = defaultdict(list)
    whole = []
    for one in skipped:
        if one.lines:
            groups[one.source, one.reason].append(one)
        else:
            whole.append((one.source, one.key, one.reason))
    lines = said_once(whole, "left out ", len(whole))
    for (source, reason), members in groups.items():
        rows = sum(len(one.lines) for one in members)
        named = ", ".join(f"{one.key} ({'all' if one.is_whole else len(one.lines)})" for one in members)
        lines.append(f"{source}: left out {rows} row{'' if rows == 1 else 's'}, {reason}: {named}")
    return lines
