"""Format results for a terminal: conflicts, runs, and the effects of loading."""

import argparse
import shlex
from collections import defaultdict
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from typing import TYPE_CHECKING, Any, Final, cast

from conflictdb.cli.codes import DONE, NOT_CURRENT
from conflictdb.cli.output import as_called, binary, coloured, data, out, remark, show_table, table
from conflictdb.errors import MOST_TOLD, NotCurrent
from conflictdb.formats import Skipped, conflict_text
from conflictdb.formats.conflict_gpx import as_gpx, position_of
from conflictdb.formats.conflict_ics import as_ics
from conflictdb.formats.contents import Remark
from conflictdb.model.results import Approach, Conflict, SceneState
from conflictdb.session.loading import Loaded

if TYPE_CHECKING:
    from conflictdb.db.detect import Run
    from conflictdb.db.store import SceneStatus

_SECOND = timedelta(seconds=1)
_NAMES: Final = ("A NAME", "B NAME")
_NAME: Final = 24  # characters of a name in a table; the other formats have all


@dataclass(frozen=True, slots=True)
class Shown:
    """How tables show conflicts.

    zone : time zone; times outside UTC show their offset
    more : of position (longitude and latitude of the first contact), microseconds, acknowledged (who, until when, why)
    """

    zone: tzinfo = UTC
    more: Collection[str] = ()

    def moment(self, moment: datetime | None, *, up: bool) -> str:
        """Return a moment to the second, rounded up or down, or to the microsecond; two dots for an unbounded end."""
        if moment is None:
            return ".."
        is_fine = "microseconds" in self.more
        if not is_fine and up and moment.microsecond and datetime.max.replace(tzinfo=UTC) - moment > _SECOND:
            moment += _SECOND
        moment = moment.astimezone(self.zone)
        moment = moment.replace(tzinfo=None) if self.zone is UTC else moment
        return moment.isoformat(" ", "microseconds" if is_fine else "seconds")

    def header(self, text: str) -> str:
        """Return the header of a column of times."""
        return f"{text} (UTC)" if self.zone is UTC else text


_PLAIN: Final = Shown()


def print_conflicts(
    conflicts: Iterable[Conflict],
    states: Sequence[SceneState],
    form: str,
    more: Sequence[conflict_text.MoreColumn] = (),
    *,
    shown: Shown = _PLAIN,
) -> None:
    """Print conflicts as a table, JSON, CSV, GeoJSON, GPX, iCalendar or GeoParquet, and remarks on incomplete scenes.

    All formats but the table, which needs its column widths, are printed as a stream.
    """
    remark_incomplete(states)
    if form == "table":
        complete = all(state.is_current for state in states)
        rows = list(conflicts)
        if rows:
            show_table(conflict_table(rows, more, shown=shown))
        else:
            out("no conflicts" if complete else "no conflict is known")
        return
    if form == "geoparquet":
        from conflictdb.arrays import arrow  # noqa: F401  names the extra where there is no pyarrow
        from conflictdb.formats.parquet_writing import write_conflicts  # needs pyarrow

        with binary() as stream:
            write_conflicts(stream, conflicts)
        return
    _write(conflicts, states, form, conflict_text.COLUMNS, more)


def print_approaches(approaches: Iterable[Approach], states: Sequence[SceneState], form: str) -> None:
    """Print closest approaches as `print_conflicts` prints conflicts."""
    remark_incomplete(states)
    if form == "table":
        rows = list(approaches)
        if rows:
            show_table(approach_table(rows))
        else:
            out("no closest approach is known")
        return
    _write(approaches, states, form, conflict_text.APPROACH_COLUMNS)


def remark_incomplete(states: Iterable[SceneState]) -> None:
    """Print which scenes are incomplete, and other remarks on their state."""
    for state in states:
        if state.remark:
            remark(f"{state.scene}: {state.remark if state.is_current else _incomplete(state)}")


def require_current(args: argparse.Namespace, state: SceneState) -> None:
    """Raise NotCurrent if `--require-current` is given and the scene is not current."""
    if args.require_current and not state.is_current:
        raise NotCurrent(f"{state.scene}: {_incomplete(state)}")


def listed(state: SceneState) -> int:
    """Return the exit code of a list of a scene; a scene without a detection does not count as empty."""
    return DONE if state.is_current or state.detected_at is not None else NOT_CURRENT


def _incomplete(state: SceneState) -> str:
    return f"not complete: {state.remark} (`conflictdb detect --scene {shlex.quote(state.scene)}` does it)"


def _write(
    pairs: Iterable[Conflict | Approach],
    states: Sequence[SceneState],
    form: str,
    columns: Sequence[str],
    more: Sequence[conflict_text.MoreColumn] = (),
) -> None:
    left_out: list[Conflict] = []
    if form in ("gpx", "ics"):
        as_lines = as_gpx if form == "gpx" else as_ics
        lines = as_lines(cast("Iterable[Conflict]", pairs), left_out.append)
    elif form == "csv":
        lines = conflict_text.as_csv(pairs, columns, more)
    elif form == "geojson":
        lines = conflict_text.as_geojson(pairs, states, more)
    else:
        lines = conflict_text.as_json(pairs, more)
    data(lines, is_json=form not in ("csv", "gpx", "ics"))
    if left_out:
        remark(f"left out {len(left_out)}: {'no position' if form == 'gpx' else 'no start or no end'}")


def conflict_table(
    conflicts: Sequence[Conflict], more: Sequence[conflict_text.MoreColumn] = (), *, shown: Shown = _PLAIN
) -> str:
    """Return a table of conflicts, one line per pair, times rounded outward to the second."""
    several = len({conflict.scene for conflict in conflicts}) > 1
    header = ["A", "B", "VERDICT", shown.header("FIRST CONTACT"), shown.header("LAST CONTACT"), "PERIODS"]
    rows: list[list[object]] = [
        [
            conflict.a_key,
            conflict.b_key,
            _verdict_text(conflict),
            shown.moment(conflict.first_contact, up=False),
            shown.moment(conflict.last_contact, up=True),
            len(conflict.periods),
        ]
        for conflict in conflicts
    ]
    if "position" in shown.more:
        header += ["LATITUDE", "LONGITUDE"]
        for row, conflict in zip(rows, conflicts, strict=True):
            lon_deg, lat_deg = position_of(conflict) or (None, None)
            row += [None if one is None else f"{one:.6f}" for one in (lat_deg, lon_deg)]
    if "acknowledged" in shown.more:
        header += ["ACKNOWLEDGED BY", shown.header("AT"), shown.header("UNTIL"), "REASON"]
        for row, conflict in zip(rows, conflicts, strict=True):
            if conflict.acknowledged_by is None:
                row += [None] * 4
                continue
            at, until = (shown.moment(one, up=False) for one in (conflict.acknowledged_at, conflict.acknowledged_until))
            row += [conflict.acknowledged_by, at, until, conflict.acknowledged_for]
    _add_columns(header, rows, conflicts, more)
    if several:
        header.insert(0, "SCENE")
        for row, conflict in zip(rows, conflicts, strict=True):
            row.insert(0, conflict.scene)
    extra = _add_names(header, rows, conflicts)
    return table(header, rows, right=["PERIODS", "LATITUDE", "LONGITUDE"], extra=extra)


def scene_table(scenes: Sequence["SceneStatus"]) -> str:
    """Return a table of scenes and their last detections."""
    if not scenes:
        return as_called("no scenes: `conflictdb demo` or `conflictdb load FILE` makes one")
    header = ["SCENE", "AREAS", "TRACKS", "PENDING", "CONFLICTS", "RUN", "FINISHED (UTC)", "RESULT"]
    rows = [
        [
            *(one.scene.name, one.areas, one.tracks, one.pending, one.conflicts, one.run_id),
            *(moment_text(one.finished_at, up=False) if one.finished_at else None, _result(one)),
        ]
        for one in scenes
    ]
    return table(header, rows, right=header[1:6])


def _result(scene: "SceneStatus") -> str:
    if scene.run_id is None:
        return "never detected"
    return f"failed: {scene.error}" if scene.error else "done"


def _add_columns(
    header: list[str],
    rows: list[list[Any]],
    conflicts: Sequence[Any],
    more: Sequence[conflict_text.MoreColumn],
) -> None:
    """Insert further columns before those of a table."""
    header[:0] = [column.name.upper() for column in more]
    for row, conflict in zip(rows, conflicts, strict=True):
        row[:0] = [column.text(conflict) for column in more]


def approach_table(approaches: Sequence[Approach | Conflict], more: Sequence[conflict_text.MoreColumn] = ()) -> str:
    """Return a table of closest approaches, one line per pair, times in UTC to the second."""
    several = len({approach.scene for approach in approaches}) > 1
    header = ["A", "B", "VERDICT", "CLOSEST (UTC)", "METRES"]
    rows: list[list[object]] = [
        [
            approach.a_key,
            approach.b_key,
            _verdict_text(approach),
            moment_text(approach.closest_at, up=False),
            None if approach.closest_m is None else f"{approach.closest_m:.1f}",
        ]
        for approach in approaches
    ]
    _add_columns(header, rows, approaches, more)
    if several:
        header.insert(0, "SCENE")
        for row, approach in zip(rows, approaches, strict=True):
            row.insert(0, approach.scene)
    extra = _add_names(header, rows, approaches)
    return table(header, rows, right=["METRES"], extra=extra)


def _add_names(header: list[str], rows: list[list[Any]], pairs: Sequence[Any]) -> Sequence[str]:
    """Add columns of the names of objects, cut where they are long, if some have names; return the columns added."""
    if not any(pair.a_name or pair.b_name for pair in pairs):
        return ()
    for row, pair in zip(rows, pairs, strict=True):
        row += [None if name is None else _shortened(name) for name in (pair.a_name, pair.b_name)]
    header += _NAMES
    return _NAMES


def _shortened(name: str) -> str:
    return name if len(name) <= _NAME else f"{name[: _NAME - 1]}…"


def _verdict_text(pair: Conflict | Approach) -> str:
    marks = ["outdated"] if pair.is_current is False else []
    if isinstance(pair, Conflict) and pair.acknowledged_by is not None:
        marks.append("acknowledged")
    return coloured(pair.verdict, f"{pair.verdict} ({', '.join(marks)})" if marks else str(pair.verdict))


def moment_text(moment: datetime | None, *, up: bool) -> str:
    """Return a moment in UTC to the second, rounded up or down; two dots for an unbounded end."""
    return _PLAIN.moment(moment, up=up)


def run_text(scene: str, run: "Run") -> str:
    """Return a line on the results of a detection."""
    parts = [f"{run.conflicts} conflict{'' if run.conflicts == 1 else 's'}"]
    if run.unresolved:
        parts.append(f"{run.unresolved} of them unresolved")
    changes = [f"{n} {what}" for n, what in ((run.opened, "new"), (run.changed, "changed"), (run.closed, "gone")) if n]
    parts.append(", ".join(changes) if changes else "nothing changed")
    return f"{scene}: {', '.join(parts)} (run {run.run_id}, {run.total_s:.2f} s)"


def loaded_text(loaded: Loaded) -> str:
    """Return a line on the effects of loading on a scene."""
    counts = loaded.counts
    changes = f"{counts.added} added, {counts.updated} updated, {counts.removed} removed, {counts.unchanged} unchanged"
    invalid = len({(one.source, one.key) for one in loaded.invalid})
    return f"{loaded.scene}: {changes}" + (f", {invalid} LEFT OUT" if invalid else "")


def remark_loaded(loaded: Iterable[Loaded]) -> None:
    """Print the objects left out of files with reasons, and remarks on unintended input."""
    for one in loaded:
        remark_read(one.skipped, one.remarks)


def remark_read(skipped: Iterable[Skipped], remarks: Sequence[Remark]) -> None:
    """Print what was left out of files, and remarks on unintended input."""
    for line in skipped_text(skipped):
        remark(line)
    for odd in remarks[:MOST_TOLD]:
        remark(str(odd))
    if len(remarks) > MOST_TOLD:
        remark(f"and {len(remarks) - MOST_TOLD:,} more remarks")


def skipped_text(skipped: Iterable[Skipped]) -> list[str]:
    """Return one line per file and reason, with the names of the objects and the number of rows of each."""
    groups: dict[tuple[str, str], list[Skipped]] = defaultdict(list)
    lines = []
    for one in skipped:
        if one.lines:
            groups[one.source, one.reason].append(one)
        else:
            lines.append(str(one))
    for (source, reason), members in groups.items():
        rows = sum(len(one.lines) for one in members)
        named = ", ".join(f"{one.key} ({'all' if one.is_whole else len(one.lines)})" for one in members)
        lines.append(f"{source}: left out {rows} row{'' if rows == 1 else 's'}, {reason}: {named}")
    return lines
