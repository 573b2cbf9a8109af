"""The figures: a pair as in the paper's figures 2 to 4, with its separation over time; a scene, and its timeline.

Reference: Bienkowski, Sidoti, Pattipati, IEEE Access 2021, figures 2 to 4 (swept polygons, boxes, their intersection,
and its projection onto the way of the track).
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from textwrap import fill as wrap
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.core.separations import Separations
from conflictdb.errors import InvalidInput, printable
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.notebook import bound_text, instant_text
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track
from conflictdb.model.results import Conflict, Verdict, distinct_labels
from conflictdb.plot import heights, map_panel
from conflictdb.plot.separation import Separation, separation
from conflictdb.plot.sketch import Sketch
from conflictdb.plot.style import (
    CONFLICT,
    FIRST,
    HATCH,
    INK,
    OF_VERDICT,
    PALE,
    QUIET,
    SECOND,
    checked_name,
    instant,
    name_of,
    styled,
    time_axis,
    written_whole,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Rows that fit on a page and can be read; and on the first page of a report, below its counts.
MOST_ROWS: Final = 40
_MOST_WORST: Final = 10
_MOST_NAMES: Final = 30
_INSTANTS: Final = 301
_FORMATS: Final = (".png", ".svg", ".pdf")
_DPI: Final = 150
# Time shown before and after a pair's periods, as a share of these; and at least this share of the whole.
_BEFORE_AND_AFTER: Final = 0.6
_LEAST_SHARE: Final = 0.02
# A map of less shows nothing of the objects: a point of contact alone has no size.
_LEAST_FOCUS_M: Final = 1.0
# Two of these fit on a page.
_WIDE_IN: Final = (9.0, 5.8)
# Letters of a line of a title above half of it.
_WIDE_TITLE: Final = 48


def plot_scene(
    scene: Scene,
    areas: Sequence[Area],
    tracks: Sequence[Track],
    conflicts: Iterable[Conflict],
    *,
    remark: str | None = None,
) -> "Figure":
    """Return a figure of a scene: all objects on a map, where they are in conflict, and when.

    conflicts : of the scene; where a region is known it is drawn, else the first contact
    remark : a warning to print on the figure

    Raises InvalidInput for a scene without objects, and ConflictDBError where there is no matplotlib.
    """
    rows = sorted((one for one in conflicts if one.periods), key=first_contact_order)
    return _scene_figure(scene, areas, tracks, rows, rows[:MOST_ROWS], f"the first {MOST_ROWS}", remark)


def plot_worst(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], conflicts: Sequence[Conflict]) -> "Figure":
    """Return the figure of `plot_scene` for the first page of a report: the timeline has the worst conflicts.

    conflicts : the worst first
    """
    rows = [one for one in conflicts if one.periods]
    shown = sorted(rows[:_MOST_WORST], key=first_contact_order)
    return _scene_figure(scene, areas, tracks, rows, shown, f"the {_MOST_WORST} worst")


def _scene_figure(
    scene: Scene,
    areas: Sequence[Area],
    tracks: Sequence[Track],
    rows: Sequence[Conflict],
    shown: Sequence[Conflict],
    which: str,
    remark: str | None = None,
) -> "Figure":
    """Return a figure of a scene with all conflicts on the map, and some on the timeline.

    which : words for these, where there are more
    """
    if not (areas or tracks):
        raise InvalidInput(f"scene {scene.name!r}", "objects", "there are none: there is nothing to draw")
    with styled() as mpl:
        sketch = Sketch(scene, areas, tracks)
        bars = 0.7 + 0.22 * max(len(shown), 1)
        figure = mpl.figure.Figure(figsize=(9.0, 6.0 + bars), layout="constrained")
        # Grids of their own: names of rows do not make the map narrow.
        grid = figure.add_gridspec(2, 1, height_ratios=(6.0, bars))
        above, below = (figure.add_subplot(grid[row].subgridspec(1, 1)[0]) for row in (0, 1))
        above.set_title(_title(scene, areas, tracks, rows))
        draw_remark(figure, remark)
        _draw_timeline(mpl, below, shown)
        below.set_title(f"When, UTC{_left_out(shown, rows, which)}")
        _draw_scene(above, sketch, rows)
        return figure


def plot_timeline(conflicts: Iterable[Conflict]) -> "Figure":
    """Return a figure of conflicts as bars over time, by first contact; raises InvalidInput where there are none."""
    rows = sorted((one for one in conflicts if one.periods), key=first_contact_order)
    if not rows:
        raise InvalidInput("timeline", "conflicts", "there are none: there is nothing to draw")
    with styled() as mpl:
        shown = rows[:MOST_ROWS]
        figure = mpl.figure.Figure(figsize=(9.0, 1.0 + 0.22 * len(shown)), layout="constrained")
        panel = figure.subplots()
        _draw_timeline(mpl, panel, shown)
        panel.set_title(f"When plans are in conflict, UTC{_left_out(shown, rows, f'the first {MOST_ROWS}')}")
        return figure


def plot_pair(
    scene: Scene,
    a: Area | Track,
    b: Area | Track,
    conflict: Conflict | None = None,
    *,
    remark: str | None = None,
    is_wide: bool = False,
) -> "Figure":
    """Return a figure of two objects: swept areas, where the stages let them meet, and their separation over time.

    conflict : their conflict; None: unknown
    remark : a warning to print on the figure
    is_wide : the separation is beside the map, not below: half as high

    Raises ConflictDBError where there is no matplotlib.
    """
    areas = [one for one in (a, b) if isinstance(one, Area)]
    tracks = [one for one in (a, b) if isinstance(one, Track)]
    scene = Separations.of(scene).of_two(a, b) or replace(scene, rules=())
    with styled() as mpl:
        sketch = Sketch(scene, areas, tracks)
        span = _time_that_matters(sketch, conflict)
        found = None if span is None else separation(sketch, 0, 1, _instants(span, conflict))
        overlap = None if found is None else heights.overlap_at(sketch, 0, 1, found.at_us)
        is_height_drawn = overlap is not None and not overlap.all()
        ratios = (6.0, 3.0, 1.5) if is_height_drawn else (6.0, 3.0)
        figure = mpl.figure.Figure(figsize=_WIDE_IN if is_wide else (9.0, sum(ratios)), layout="constrained")
        if is_wide:
            grid = figure.add_gridspec(len(ratios) - 1, 2, height_ratios=ratios[1:])
            above = figure.add_subplot(grid[:, 0])
            below, *lowest = (figure.add_subplot(grid[row, 1]) for row in range(len(ratios) - 1))
        else:
            above, below, *lowest = figure.subplots(len(ratios), 1, height_ratios=ratios)
        names = [name_of(label) for label in sketch.labels]
        objects: list[Area | Track] = [*areas, *tracks]
        first, second = objects
        verdict = "no conflict is known" if conflict is None else str(conflict.verdict)
        reason = _height_reason(scene, first, second, found, overlap) if conflict is None else ""
        lines = [f"{names[0]} and {names[1]}: {verdict}", heights.line(first, second, reason or "heights")]
        title = "\n".join(line for line in lines if line)
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
        draw_remark(figure, remark)
        if found is None or overlap is None:
            _draw_no_separation(below, sketch)
        else:
            _draw_separation(mpl, below, sketch, conflict, found, overlap)
        if found is not None and lowest:
            times = [instant(int(us)) for us in found.at_us]
            heights.draw(lowest[0], sketch, found.at_us, times, names)
            time_axis(mpl, lowest[0], times[0], times[-1])
        if is_wide:
            for panel in (below, *lowest):
                panel.set_title(wrap(panel.get_title(loc="left"), _WIDE_TITLE), fontsize=9)
        _draw_pair(above, sketch, conflict, columns=1 if is_wide else 3)
        return figure


def _height_reason(
    scene: Scene,
    a: Area | Track,
    b: Area | Track,
    found: Separation | None,
    overlap: NDArray[np.bool_] | None,
) -> str:
    """Return that heights keep two objects in no known conflict apart; an empty text if that is not so."""
    if always := heights.apart_text(a, b, scene.vertical_separation_m):
        return always
    if found is None or overlap is None:
        return ""
    crossing = found.low_m <= scene.separation_m
    return "their heights are apart while they cross" if crossing.any() and not overlap[crossing].any() else ""


def save(figure: "Figure", file: str | Path) -> Path:
    """Write a figure as its file's name ends: .png, .svg or .pdf; whole, or not at all.

    Raises InvalidInput for other names, and OSError where it cannot be written.
    """
    file = check_name(file)
    with styled():
        metadata: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(file.suffix.lower(), {})
        with written_whole(file) as part:
            figure.savefig(part, format=file.suffix[1:].lower(), dpi=_DPI, metadata=metadata, facecolor="white")
    return file


def check_name(file: str | Path) -> Path:
    """Return the path of a figure's file; raises InvalidInput if its name has no known format."""
    return checked_name("plot", file, _FORMATS)


def first_contact_order(conflict: Conflict) -> tuple[bool, datetime, str, str]:
    """Return the sort key of a conflict: first contact (unbounded first), then keys."""
    start = conflict.first_contact
    return start is not None, start or EPOCH, conflict.a_key, conflict.b_key


def draw_remark(figure: "Figure", remark: str | None) -> None:
    """Print a warning below a figure, if there is one."""
    if remark:
        figure.supxlabel(printable(remark), color=CONFLICT, fontsize=9, fontweight="bold")


def _draw_scene(panel: Any, sketch: Sketch, conflicts: Sequence[Conflict]) -> None:
    from matplotlib.collections import LineCollection

    numbers = range(len(sketch.keys))
    areas = {n: sketch.outline(n) for n in numbers if not sketch.is_track(n)}
    ways = {n: way for n in numbers if sketch.is_track(n) and len(way := sketch.way(n))}
    shapes = [*areas.values(), *(shapely.LineString(way) for way in ways.values())]
    map_panel.polygons(
        panel, np.array(list(areas.values()), dtype=object), facecolors="#8a949e2e", edgecolors=QUIET, linewidths=0.7
    )
    is_image = len(ways) > map_panel.MOST_VECTORS
    panel.add_collection(
        LineCollection(list(ways.values()), colors=PALE, linewidths=0.8, rasterized=is_image), autolim=False
    )
    for conflict in conflicts:
        _draw_place(panel, sketch, conflict)
    if not shapes:
        return
    map_panel.show(panel, sketch.setup.plane, tuple(shapely.total_bounds(shapes)))
    if len(sketch.keys) <= _MOST_NAMES:
        places = {number: tuple(way[0]) for number, way in ways.items()}
        places |= {number: area.representative_point().coords[0] for number, area in areas.items()}
        map_panel.names(panel, [(name_of(sketch.labels[number]), place) for number, place in sorted(places.items())])


def _draw_place(panel: Any, sketch: Sketch, conflict: Conflict) -> None:
    """Draw the region of a conflict, on the turn of its first object."""
    number = sketch.keys.index(conflict.a_key)
    colour = OF_VERDICT.get(conflict.verdict, QUIET)
    if conflict.region is not None:
        where = shapely.from_geojson(conflict.region)
        map_panel.polygons(
            panel,
            np.array([sketch.on_page(where, number)], dtype=object),
            facecolors=colour + "b0",
            edgecolors=colour,
            linewidths=0.7,
            zorder=3,
        )
    elif conflict.first_contact_deg is not None:
        x, y = sketch.on_page(shapely.Point(conflict.first_contact_deg), number).coords[0]
        panel.plot(x, y, "o", color=colour, markersize=4.0, zorder=3, scalex=False, scaley=False)


def _draw_pair(panel: Any, sketch: Sketch, conflict: Conflict | None, columns: int) -> None:
    regions, lines = sketch.meetings(0, 1)
    seen: list[Any] = []
    for number, colour in ((0, FIRST), (1, SECOND)):
        hulls = sketch.hulls(number)
        seen += list(hulls)
        if sketch.is_track(number):
            map_panel.polygons(panel, hulls, facecolors=colour + "18", edgecolors=colour + "60", linewidths=0.5)
            way = sketch.way(number)
            panel.plot(
                *way.T,
                color=colour,
                linewidth=1.0,
                marker=".",
                markersize=3,
                scalex=False,
                scaley=False,
                label=f"{name_of(sketch.labels[number])}: way and sweep of its haven",
            )
        else:
            map_panel.polygons(
                panel,
                np.array([sketch.outline(number)], dtype=object),
                facecolors=colour + "24",
                edgecolors=colour,
                linewidths=1.0,
            )
            panel.fill([], [], facecolor=colour + "24", edgecolor=colour, label=name_of(sketch.labels[number]))
    if len(regions):
        map_panel.polygons(
            panel,
            shapely.box(*shapely.bounds(regions).T),
            facecolors="none",
            edgecolors=QUIET,
            linewidths=0.7,
            linestyles="dotted",
        )
        map_panel.polygons(panel, regions, facecolors=CONFLICT + "30", edgecolors=CONFLICT + "90", linewidths=0.7)
        panel.fill(
            [], [], facecolor=CONFLICT + "30", edgecolor=CONFLICT, label="where hulls meet (stage 2), and its box"
        )
    for number, ends in lines:
        colour = SECOND if number else FIRST
        panel.plot(*ends.T, color=colour, linewidth=0.8, linestyle="dashed", scalex=False, scaley=False)
    if lines:
        panel.plot([], [], color=INK, linewidth=0.8, linestyle="dashed", label="projected onto the way (stage 3)")
    contacts = _draw_contacts(panel, sketch, conflict)
    closeup = _draw_common(panel, sketch) or contacts
    panel.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, fontsize=7, frameon=False, borderaxespad=0.3
    )
    # Near the contacts, where there are some: whole ways may be an ocean long.
    focus = next((shapes for shapes in (closeup, list(regions), seen) if _extent_m(shapes) > _LEAST_FOCUS_M), seen)
    if focus:
        map_panel.show(panel, sketch.setup.plane, _room(tuple(shapely.total_bounds(focus))))


def _extent_m(shapes: Sequence[shapely.Geometry]) -> float:
    """Return the larger side of the box around shapes; 0 without any."""
    if not shapes:
        return 0.0
    west, south, east, north = shapely.total_bounds(shapes)
    return float(max(east - west, north - south))


def _draw_common(panel: Any, sketch: Sketch) -> list[Any]:
    """Draw the intersection of two areas; return it, empty if one object is a track or they only touch."""
    if sketch.is_track(0) or sketch.is_track(1):
        return []
    common = shapely.intersection(*(shapely.make_valid(sketch.outline(number)) for number in (0, 1)))
    if common.area == 0.0:
        return []
    map_panel.polygons(
        panel,
        np.array([common], dtype=object),
        facecolors=CONFLICT + "30",
        edgecolors=CONFLICT + "90",
        linewidths=0.7,
    )
    panel.fill([], [], facecolor=CONFLICT + "30", edgecolor=CONFLICT, label="where both are")
    return [common]


def _room(bounds: tuple[float, ...]) -> tuple[float, float, float, float]:
    """Return bounds with half as much again around them."""
    west, south, east, north = bounds
    room = 0.5 * max(east - west, north - south)
    return west - room, south - room, east + room, north + room


def _draw_contacts(panel: Any, sketch: Sketch, conflict: Conflict | None) -> list[Any]:
    """Draw both objects at the first and the last contact, or where they are closest; return the drawn shapes."""
    if conflict is None:
        return []
    instants = [("first contact", conflict.first_contact), ("last contact", conflict.last_contact)]
    if not conflict.periods:
        instants = [("closest", conflict.closest_at)]
    drawn = []
    for nth, (words, at) in enumerate(instants):
        if at is None:
            continue
        at_us = (at - EPOCH) // MICROSECOND
        # The first is filled, the last an empty outline.
        fill, line = ("70", "solid") if nth == 0 else ("00", (0, (3, 1.5)))
        shapes = []
        for number, colour in ((0, FIRST), (1, SECOND)):
            shape = sketch.shape_at(number, at_us) if sketch.is_track(number) else None
            if shape is not None:
                look = {"facecolors": colour + fill, "edgecolors": colour, "linewidths": 1.2, "linestyles": [line]}
                map_panel.polygons(panel, np.array([shape], dtype=object), zorder=4, **look)
                shapes.append(shape)
        if shapes:
            clock = instant_text(at, up=nth == 1)
            label = f"havens at {words} {clock[-8:]}"
            panel.fill([], [], facecolor=QUIET + fill, edgecolor=INK, linestyle=line, label=label)
        drawn += shapes
    if conflict.first_contact_deg is not None:
        number = sketch.keys.index(conflict.a_key)
        point = sketch.on_page(shapely.Point(conflict.first_contact_deg), number)
        panel.plot(
            point.x,
            point.y,
            "o",
            color=CONFLICT,
            markeredgecolor="white",
            markersize=7,
            zorder=5,
            scalex=False,
            scaley=False,
            label="where they first touch",
        )
        drawn.append(point)
    return drawn


def _draw_no_separation(panel: Any, sketch: Sketch) -> None:
    """Say why two objects have no separation over time: they share all time, or none."""
    panel.set_axis_off()
    never = sketch.span_us(0)[0] < sketch.span_us(1)[1] and sketch.span_us(1)[0] < sketch.span_us(0)[1]
    text = "Both are always there: nothing changes." if never else "They are never there at the same time."
    panel.text(0.0, 0.9, text, transform=panel.transAxes)


def _draw_separation(
    mpl: Any,
    panel: Any,
    sketch: Sketch,
    conflict: Conflict | None,
    found: Separation,
    overlap: NDArray[np.bool_],
) -> None:
    """Draw the horizontal separation of both objects over the time that matters, its bounds, and the periods.

    overlap : (n,) whether their heights overlap at the instants of the separation; dashed where they do not
    """
    times = [instant(int(us)) for us in found.at_us]
    wanted_m = sketch.setup.scene.separation_m
    middle = 0.5 * (found.low_m + found.high_m)
    panel.fill_between(times, found.low_m, found.high_m, color=FIRST, alpha=0.25, linewidth=0)
    if not overlap.all():
        panel.plot(times, middle, color=QUIET, linewidth=0.9, linestyle="dashed")
    panel.plot(times, np.where(overlap, middle, np.nan), color=FIRST, linewidth=1.2)
    panel.axhline(wanted_m, color=INK, linewidth=0.8, label="apart" if wanted_m else None)
    verdict = Verdict.CONFLICT if conflict is None else conflict.verdict
    for start, end in conflict.periods if conflict else ():
        ends = [times[0] if start is None else start, times[-1] if end is None else end]
        panel.axvspan(ends[0], ends[1], color=OF_VERDICT.get(verdict, QUIET), alpha=0.2, linewidth=0)
    panel.set_ylabel("horizontal separation, metres")
    time_axis(mpl, panel, times[0], times[-1])
    bound = "" if conflict is None else f", each end to {bound_text(conflict.time_error_s)}"
    shaded = {Verdict.GRAZING: "too close to call", Verdict.UNRESOLVED: "not proven apart"}.get(verdict, "in conflict")
    periods = f"; shaded: {shaded}{bound}" if conflict and conflict.periods else ""
    least = f" (wanted: {wanted_m:g} m)" if wanted_m else ""
    panel.set_title(f"How far apart, UTC{least}; below zero: how deep in each other{periods}", fontsize=9)


def _instants(span: tuple[int, int], conflict: Conflict | None) -> NDArray[np.int64]:
    """Return the instants to measure: regular ones, and the ends of periods and the closest approach."""
    steady = np.linspace(0.0, float(span[1] - span[0]), _INSTANTS).astype(np.int64) + span[0]
    special: list[datetime | None] = [end for period in conflict.periods for end in period] if conflict else []
    special += [conflict.closest_at] if conflict else []
    known = np.array([(at - EPOCH) // MICROSECOND for at in special if at is not None], dtype=np.int64)
    return np.unique(np.concatenate([steady, np.clip(known, *span)]))


def _time_that_matters(sketch: Sketch, conflict: Conflict | None) -> tuple[int, int] | None:
    """Return from when to when the figure of a pair tells of it; None where they share no time, or all time."""
    spans = [sketch.span_us(number) for number in (0, 1)]
    start, end = max(span[0] for span in spans), min(span[1] for span in spans)
    if (start == MINUS_INFINITY_US and end == INFINITY_US) or start >= end:
        return None
    day_us = timedelta(days=1) // MICROSECOND
    start = end - day_us if start == MINUS_INFINITY_US else start
    end = start + day_us if end == INFINITY_US else end
    instants = [at for at in (conflict.first_contact, conflict.last_contact) if at] if conflict else []
    if conflict and not instants and conflict.closest_at:
        instants = [conflict.closest_at]
    if not instants:
        return start, end
    first, last = ((at - EPOCH) // MICROSECOND for at in (instants[0], instants[-1]))
    room = int(max(_BEFORE_AND_AFTER * (last - first), _LEAST_SHARE * (end - start)))
    return max(start, first - room), min(end, last + room)


def _draw_timeline(mpl: Any, panel: Any, conflicts: Sequence[Conflict]) -> None:
    """Draw a bar for each period, a row for each conflict, the first one above."""
    if not conflicts:
        panel.set_axis_off()
        panel.text(0.0, 0.5, "No conflict is known.", transform=panel.transAxes)
        return
    ends = [end for one in conflicts for period in one.periods for end in period if end is not None]
    if not ends:
        panel.set_axis_off()
        panel.text(0.0, 0.5, f"{len(conflicts)} conflicts at all times.", transform=panel.transAxes)
        return
    room = max(0.04 * (max(ends) - min(ends)), timedelta(seconds=1))
    first, last = min(ends) - room, max(ends) + room
    # Minimum width of a bar: one hairline.
    hair = (last - first) / 400
    for row, one in enumerate(conflicts):
        for start, end in one.periods:
            start, end = first if start is None else start, last if end is None else end
            panel.barh(
                row,
                max(end - start, hair),
                left=start,
                height=0.62,
                color=OF_VERDICT.get(one.verdict, QUIET),
                hatch=HATCH.get(one.verdict, ""),
                edgecolor="white",
                linewidth=0,
            )
    names = {one.a_key: one.a_name for one in conflicts} | {one.b_key: one.b_name for one in conflicts}
    labels = {key: name_of(label) for key, label in distinct_labels(names).items()}
    panel.set_yticks(range(len(conflicts)), [f"{labels[one.a_key]} and {labels[one.b_key]}" for one in conflicts])
    panel.set_ylim(len(conflicts) - 0.4, -0.6)
    panel.tick_params(axis="y", length=0)
    time_axis(mpl, panel, first, last)
    verdicts = [verdict for verdict in OF_VERDICT if any(one.verdict is verdict for one in conflicts)]
    if verdicts != [Verdict.CONFLICT]:
        for verdict in verdicts:
            panel.barh(
                -9,
                hair,
                left=first,
                color=OF_VERDICT[verdict],
                hatch=HATCH[verdict],
                edgecolor="white",
                linewidth=0,
                label=str(verdict),
            )
        # Beside the title, where no bar is.
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(verdicts), fontsize=7, frameon=False)


def _title(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], conflicts: Sequence[Conflict]) -> str:
    counts = ((len(areas), "area"), (len(tracks), "track"), (len(conflicts), "conflict"))
    words = ", ".join(f"{n:,} {what}{'' if n == 1 else 's'}" for n, what in counts)
    return f"{name_of(scene.name)}: {words}"


def _left_out(shown: Sequence[Conflict], rows: Sequence[Conflict], which: str) -> str:
    return f" ({which} of {len(rows):,})" if len(rows) > len(shown) else ""
