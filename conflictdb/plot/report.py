"""A report of a scene, to file with a plan: objects, settings, conflicts and figures.

One list of sections, written as HTML (one file, figures within) or as PDF (by fpdf2).
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from conflictdb.core.depths import depths
from conflictdb.core.ranking import Known, facts_of, missing_text, worst_first
from conflictdb.errors import printable
from conflictdb.model.departure_text import departure_text
from conflictdb.model.methods import METHODS
from conflictdb.model.notebook import bound_text, distance_text, instant_text, text_of
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Motion, Scene, Track
from conflictdb.model.record import REMARKS
from conflictdb.model.results import Conflict, Delays, SceneState, Verdict
from conflictdb.model.settings import SETTINGS
from conflictdb.model.units import Units
from conflictdb.plot import departures, figures
from conflictdb.plot.pdf import document
from conflictdb.plot.section import Section, drawn
from conflictdb.plot.style import checked_name, instant, written_whole

# As many as a reader goes through; `conflictdb conflicts --format csv` has all.
_MOST_CONFLICTS: Final = 500
_MOST_PAIRS_DRAWN: Final = 6
# Tracks in conflict with a table of delays; the first of the others are named.
_MOST_DELAYS: Final = 50
# Depths of more conflicts take tens of seconds.
_MOST_DEPTHS: Final = 20_000
_MOST_LEFT_OUT: Final = 200
_FORMATS: Final = (".html", ".pdf")
_STAGES: Final = (
    ("candidate_pairs", "Pairs of pieces whose boxes meet (stage 1)", "stage1_s"),
    ("intersecting_pairs", "… whose hulls meet (stage 2)", "stage2_s"),
    ("window_pairs", "… not shown apart in closed form or by projection (stage 3)", "stage3_s"),
    ("solved_pairs", "… that stage 3 did not decide (stage 4)", "stage4_s"),
)
# Nothing is fetched, and nothing runs.
_POLICY: Final = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_CSS: Final = """\
:root { color-scheme: light }
body { font: 15px/1.5 system-ui, "Segoe UI", "Helvetica Neue", Arial, sans-serif; color: #2b333b; max-width: 62rem;
  margin: 2.5rem auto; padding: 0 1.25rem }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .25rem } h2 { font-size: 1.15rem; margin: 2.25rem 0 .5rem }
p { margin: .25rem 0 .75rem } .made { color: #5b6670 } .warning { border-left: 4px solid #d55e00; padding: .5rem .9rem;
  background: #fdf1ea; font-weight: 600 } .wide { overflow-x: auto }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums } th, td { text-align: left;
  padding: .3rem .9rem .3rem 0; border-bottom: 1px solid #e3e7ea; vertical-align: top } th { font-weight: 600 }
figure { margin: 1rem 0; break-inside: avoid } figure img { max-width: 100%; height: auto } tr { break-inside: avoid }
@media print { body { margin: 0; max-width: none; font-size: 10pt } }"""


@dataclass(frozen=True, slots=True)
class Checked:
    """What a report is of.

    conflicts, near : of the scene, with their regions; pairs without conflict that come near
    state : whether that is all
    server : versions of the database's server
    run : the columns of the last run; empty where there was none
    delays : of the tracks of `asked_about`
    units : of places and distances
    """

    scene: Scene
    areas: Sequence[Area]
    tracks: Sequence[Track]
    conflicts: Sequence[Conflict]
    near: Sequence[Conflict]
    state: SceneState
    server: str
    run: Mapping[str, Any]
    delays: Sequence[Delays] = ()
    units: Units = Units.NAUTICAL


def write(checked: Checked, file: str | Path, now: datetime | None = None) -> None:
    """Write a report, .html or .pdf; whole, or not at all.

    Raises InvalidInput for other names and for scenes without objects, ConflictDBError where matplotlib, or for PDF
    fpdf2, is not there, and OSError where the file cannot be written.
    """
    file = check_name(file)
    now = (now or datetime.now(UTC)).replace(microsecond=0)
    title = f"Interference report: {printable(checked.scene.name)}"
    made = f"Made {instant_text(now)} UTC by conflictdb {version('conflictdb')} on {checked.server}."
    warning = printable(checked.state.remark) if checked.state.remark else ""
    if not checked.state.is_current:
        warning = f"NOT COMPLETE: {warning or 'changes wait for detection'}. Conflicts may be missing."
    sections = _sections(checked)
    content = rendered(file, title, made, warning, sections)
    with written_whole(file) as part:
        part.write_bytes(content)


def rendered(file: Path, title: str, made: str, warning: str, sections: Sequence[Section]) -> bytes:
    """Return the content of a file, in the format that its name says."""
    render = _html if file.suffix.lower() == ".html" else document
    return render(title, made, warning, sections)


def asked_about(conflicts: Iterable[Conflict], most: int = _MOST_DELAYS) -> list[str]:
    """Return the keys of the tracks whose delays a report lists: the first ones in conflict."""
    return departures.tracks_in_conflict(conflicts)[:most]


def check_name(file: str | Path) -> Path:
    """Return the path of a report; raises InvalidInput if its name has no known format."""
    return checked_name("report", file, _FORMATS)


def _sections(checked: Checked) -> list[Section]:
    known = _depths(checked)
    conflicts = worst_first(checked.conflicts, known)
    overview = figures.plot_worst(checked.scene, checked.areas, checked.tracks, conflicts)
    return [
        _found(checked, conflicts),
        Section("Where and when", figures=[("All objects, and where and when they are in conflict.", overview)]),
        _listed(checked, conflicts, known),
        *_acknowledged(conflicts),
        *_delays(checked, conflicts),
        *_near(checked),
        _settings(checked.scene),
        _objects(checked),
        *_work(checked),
        *_pairs(checked, conflicts),
    ]


def _found(checked: Checked, conflicts: Sequence[Conflict]) -> Section:
    counts = Counter(one.verdict for one in conflicts)
    meaning = {
        Verdict.CONFLICT: "in conflict",
        Verdict.GRAZING: f"too close to call (within the tolerance of {checked.scene.tolerance_m:g} m)",
        Verdict.UNRESOLVED: "neither proven apart nor decided: the times are when they might meet",
    }
    rows = [[str(verdict), f"{counts[verdict]:,}", words] for verdict, words in meaning.items()]
    objects = len(checked.areas) + len(checked.tracks)
    pairs = objects * (objects - 1) // 2
    worst = max((one.time_error_s for one in conflicts), default=0.0)
    text = f"Of {pairs:,} pairs of {objects:,} objects {len(conflicts):,} are reported."
    if conflicts and math.isfinite(worst):
        text += f" Every time that is reported is right to {bound_text(worst)} or better, as the table says for each."
    elif conflicts:
        text += " Contacts lie in the times that are reported; how much shorter they are has no bound (see the method)."
    return Section("What was found", text, ["Verdict", "Pairs", "Meaning"], rows)


def _depths(checked: Checked) -> Known:
    """Return how deep pairs undercut their required separation; none in a scene of too many conflicts."""
    pairs = {(one.a_key, one.b_key) for one in checked.conflicts if one.is_current is not False}
    if not 0 < len(pairs) <= _MOST_DEPTHS:
        return {}
    keys = {key for pair in pairs for key in pair}
    areas = [one for one in checked.areas if one.key in keys]
    return depths(checked.scene, areas, [one for one in checked.tracks if one.key in keys], only=pairs)


def _missing(known: Known, one: Conflict, units: Units) -> str:
    """Return how much of the separation is missing, and when most; empty if that is not known."""
    found = known.get((one.a_key, one.b_key))
    words = missing_text(facts_of(one).moving, found, units)
    return words if found is None or found.at_us is None else f"{words} at {instant_text(instant(found.at_us))[11:]}"


def _listed(checked: Checked, conflicts: Sequence[Conflict], known: Known) -> Section:
    header = ["A", "B", "Verdict", "Periods (UTC)", "Known to", "First contact", "How close"]
    rows = [
        [
            *map(printable, one.labels),
            _verdict(one),
            "\n".join(_period(*period) for period in one.periods),
            bound_text(one.time_error_s),
            "" if one.first_contact_deg is None else checked.units.place(*one.first_contact_deg),
            _missing(known, one, checked.units),
        ]
        for one in conflicts[:_MOST_CONFLICTS]
    ]
    text = "The worst first: both move before one moves, certain before possible, then the soonest. Periods are rounded"
    text += " outward to the second. How close: how much of the required"
    text += " separation is missing at most, and when; of an area of several parts, at least."
    if len(conflicts) > _MOST_CONFLICTS:
        text += f" The first {_MOST_CONFLICTS} of {len(conflicts):,}; conflictdb conflicts --format csv has all."
    return Section("Conflicts", text if rows else "No conflict is known.", header if rows else (), rows)


def _verdict(one: Conflict) -> str:
    marks = ["outdated"] if one.is_current is False else []
    if one.acknowledged_by is not None:
        marks.append("acknowledged")
    remarks = ((column, getattr(one, column.field)) for column in REMARKS)
    marks += [column.remark.format(value) for column, value in remarks if value is not None]
    return f"{one.verdict} ({', '.join(marks)})" if marks else str(one.verdict)


def _acknowledged(conflicts: Sequence[Conflict]) -> list[Section]:
    """Return who acknowledged which conflicts, when, until when and why; empty if nobody did."""
    some = [one for one in conflicts if one.acknowledged_by is not None]
    if not some:
        return []
    rows = [
        [
            *map(printable, one.labels),
            printable(one.acknowledged_by or ""),
            instant_text(one.acknowledged_at),
            "it ends" if one.acknowledged_until is None else instant_text(one.acknowledged_until),
            printable(one.acknowledged_for or ""),
        ]
        for one in some[:_MOST_CONFLICTS]
    ]
    text = f"{len(some):,} of {len(conflicts):,} conflicts."
    if len(some) > _MOST_CONFLICTS:
        text += f" The first {_MOST_CONFLICTS}."
    return [Section("Acknowledged", text, ["A", "B", "By", "At (UTC)", "Until (UTC)", "Note"], rows)]


def _delays(checked: Checked, conflicts: Sequence[Conflict]) -> list[Section]:
    """Return when tracks in conflict could depart instead; empty without one."""
    by_key = {one.key: one for one in checked.delays}
    keys = departures.tracks_in_conflict(conflicts)
    rows = [[departure_text(by_key[key], checked.areas, printable)] for key in keys if key in by_key]
    if not rows:
        return []
    text = "Of each track in conflict, while everything else departs as planned. Times are rounded to stay clear."
    left_out = [printable(key) for key in keys if key not in by_key]
    if left_out:
        more = ", …" if len(left_out) > _MOST_LEFT_OUT else ""
        text += f" {len(left_out):,} of {len(keys):,} are left out: {', '.join(left_out[:_MOST_LEFT_OUT])}{more}."
    first = [by_key[key] for key in keys if key in by_key]
    names = {track.key: track.name for track in checked.tracks}
    figure = departures.plot_delays(first, left_out=len(left_out), names=names)
    caption = "Departures that are free and in conflict; the least delays are marked."
    return [Section("When they could depart instead", text, rows=rows, figures=[(caption, figure)])]


def _near(checked: Checked) -> list[Section]:
    if not checked.near:
        return []
    rows = [
        [
            *map(printable, one.labels),
            instant_text(one.closest_at),
            distance_text(one),
        ]
        for one in checked.near[:_MOST_CONFLICTS]
    ]
    text = f"No conflict, but within {checked.scene.nearest_m:g} m: {len(checked.near):,} pairs."
    if len(checked.near) > _MOST_CONFLICTS:
        text += f" The first {_MOST_CONFLICTS}."
    return [Section("Near", text, ["A", "B", "Closest (UTC)", "Least distance, m"], rows)]


def _settings(scene: Scene) -> Section:
    ways = {Motion.RHUMB: "rhumb lines (constant bearing)", Motion.GREAT_CIRCLE: "great circles (shortest way)"}
    rows = [
        ["Tracks and edges run along", ways[scene.motion]],
        ["Earth", str(scene.earth)],
        ["Method", f"{scene.method}: {METHODS[scene.method].promises.replace('`', '')}"],
    ]
    for setting in (one for one in SETTINGS if one.label):
        value = getattr(scene, setting.name)
        says = setting.says if value or not setting.says_zero else setting.says_zero
        rows.append([setting.label, says.format(value)])
    return Section("Settings", rows=rows)


def _objects(checked: Checked) -> Section:
    starts = [area.start_us for area in checked.areas] + [int(track.times_us[0]) for track in checked.tracks]
    ends = [area.end_us for area in checked.areas] + [int(track.times_us[-1]) for track in checked.tracks]
    bounded = [us for us in (*starts, *ends) if us is not None and us not in (MINUS_INFINITY_US, INFINITY_US)]
    always = sum(start is None or end is None for start, end in zip(starts, ends, strict=True))
    rows = [
        ["Areas", f"{len(checked.areas):,}"],
        ["Tracks", f"{len(checked.tracks):,}, of {sum(len(track.times_us) - 1 for track in checked.tracks):,} legs"],
        ["Without a start or an end", f"{always:,}"],
    ]
    if bounded:
        ends_text = [instant_text(instant(us)) for us in (min(bounded), max(bounded))]
        rows.append(["From, to (UTC)", f"{ends_text[0]} to {ends_text[1]}"])
    return Section("What was checked", rows=rows)


def _work(checked: Checked) -> list[Section]:
    if not checked.run:
        return []
    run = checked.run
    rows = [
        [words, "" if run[name] is None else f"{run[name]:,}", "" if run[took] is None else f"{run[took]:.3f}"]
        for name, words, took in _STAGES
    ]
    text = f"Run {run['run_id']}, {instant_text(run['finished_at'])} UTC, method {run['method']}."
    text += " A run looks at what changed since the one before, and keeps the rest."
    return [Section("The last run", text, ["", "Pairs", "Seconds"], rows)]


def _pairs(checked: Checked, conflicts: Sequence[Conflict]) -> list[Section]:
    objects: list[Area | Track] = [*checked.areas, *checked.tracks]
    by_key = {one.key: one for one in objects}
    drawn = []
    for one in conflicts[:_MOST_PAIRS_DRAWN]:
        if one.a_key in by_key and one.b_key in by_key:
            figure = figures.plot_pair(checked.scene, by_key[one.a_key], by_key[one.b_key], one, is_wide=True)
            drawn.append((printable(" and ".join(one.labels)), figure))
    if not drawn:
        return []
    more = len(conflicts) - len(drawn)
    text = f"The {len(drawn)} worst; conflictdb plot draws any of the other {more:,}." if more else ""
    return [Section("Pair by pair", text, figures=drawn)]


def _period(start: datetime | None, end: datetime | None) -> str:
    """Return a period, its day once, rounded outward to the second."""
    first, last = instant_text(start), instant_text(end, up=True)
    if start is None or end is None:
        return "always" if start is end else f"until {last}" if start is None else f"from {first} on"
    day, _, time = last.partition(" ")
    return f"{first} to {time if first.startswith(day) else last}"


def _html(title: str, made: str, warning: str, sections: Sequence[Section]) -> bytes:
    import base64

    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">',
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
        f"<title>{text_of(title)}</title><style>{_CSS}</style></head><body>",
        f'<h1>{text_of(title)}</h1><p class="made">{text_of(made)}</p>',
    ]
    if warning:
        parts.append(f'<p class="warning">{text_of(warning)}</p>')
    for section in sections:
        parts.append(f"<h2>{text_of(section.heading)}</h2>")
        if section.text:
            parts.append(f"<p>{text_of(section.text)}</p>")
        if section.rows:
            parts += ['<div class="wide"><table>', *_html_rows(section), "</table></div>"]
        for caption, figure in section.figures:
            image = base64.b64encode(drawn(figure, "svg")).decode()
            parts.append(f'<figure><img alt="{text_of(caption)}" src="data:image/svg+xml;base64,{image}"></figure>')
    return "\n".join([*parts, "</body></html>\n"]).encode()


def _html_rows(section: Section) -> Iterator[str]:
    if section.header:
        yield "<thead><tr>" + "".join(f"<th>{text_of(cell)}</th>" for cell in section.header) + "</tr></thead>"
    yield "<tbody>"
    for row in section.rows:
        yield "<tr>" + "".join(f"<td>{_lines(cell)}</td>" for cell in row) + "</tr>"
    yield "</tbody>"


def _lines(cell: str) -> str:
    return "<br>".join(text_of(line) for line in cell.split("\n"))
