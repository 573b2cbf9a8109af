"""Figures of departures: bars of the free and the forbidden ones, and the coordination diagram of a pair."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.objects import TrackBatch
from conflictdb.core.coordination import contact_set
from conflictdb.core.delays import FirstStops, Leeway, differences_of
from conflictdb.core.forbidden import delays_of
from conflictdb.core.near import Memory
from conflictdb.core.separations import Separations
from conflictdb.errors import InvalidInput
from conflictdb.model import inputs
from conflictdb.model.departure_text import duration_text, least_text
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Conflict, Delays, Kind, distinct_labels
from conflictdb.plot import map_panel
from conflictdb.plot.figures import MOST_ROWS, draw_remark, first_contact_order
from conflictdb.plot.sketch import Sketch
from conflictdb.plot.style import CONFLICT, FIRST, INK, SECOND, instant, name_of, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Steps between labels of an axis of delays, seconds: the shortest that gives few enough labels.
_STEPS_S: Final = (1, 5, 10, 30, 60, 300, 600, 900, 1800, 3600, 7200, 14_400, 43_200, 86_400)
_MOST_STEPS: Final = 9
_MINUS: Final = "\N{MINUS SIGN}"
_DAY_S: Final = 86_400.0
# Room around a contact set, as a share of its size; and the least size, seconds.
_ROOM: Final = 0.25
_LEAST_S: Final = 60.0
# Parts of a track's time in contact; the contact set is bounded in each.
_SLICES: Final = 100


def plot_delays(
    found: Sequence[Delays],
    *,
    remark: str | None = None,
    left_out: int = 0,
    names: Mapping[str, str | None] | None = None,
) -> "Figure":
    """Return a figure of free and forbidden departures: a bar for each track, its least delays marked.

    found : from `delays`; the first 40 are drawn
    remark : a warning to print on the figure
    left_out : how many tracks were not asked about
    names : names of the tracks, by key; bars show the keys of others

    Raises InvalidInput where there are none, and ConflictDBError where there is no matplotlib.
    """
    if not found:
        raise InvalidInput("plot", "delays", "there are none: there is nothing to draw")
    shown = found[:MOST_ROWS]
    ends_s = [abs(end) for one in shown for each in one.forbidden for end in (each.from_s, each.to_s)]
    horizon_s = max([1.0, *ends_s, *(max(one.latest_s, -one.earliest_s) for one in shown)])
    with styled() as mpl:
        figure = mpl.figure.Figure(figsize=(9.0, 1.3 + 0.26 * len(shown)), layout="constrained")
        panel = figure.subplots()
        for row, one in enumerate(shown):
            _draw_bar(panel, row, one)
        panel.axvline(0.0, color=INK, linewidth=0.8, zorder=4)
        labels = distinct_labels({one.key: (names or {}).get(one.key) for one in shown})
        panel.set_yticks(range(len(shown)), [name_of(labels[one.key]) for one in shown])
        panel.set_ylim(len(shown) - 0.4, -0.6)
        panel.tick_params(axis="y", length=0)
        _delay_axis(panel, horizon_s)
        of = len(found) + left_out
        more = f" (the first {len(shown)} of {of:,})" if of > len(shown) else ""
        title = f"Departures, earlier and later than planned{more}"
        figure.suptitle(title, x=0.01, ha="left", fontsize=10, fontweight="bold")
        looks = (
            ("free", {"facecolor": FIRST + "50"}),
            ("in conflict", {"facecolor": CONFLICT}),
            ("not proven free", {"facecolor": CONFLICT + "50", "hatch": "////", "edgecolor": "white"}),
        )
        for label, look in looks:
            panel.fill([], [], label=label, linewidth=0, **look)
        panel.plot([], [], "D", color=INK, markersize=4, label="least delay")
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize=7, frameon=False)
        draw_remark(figure, remark)
        return figure


def plot_coordination(
    scene: Scene, a: Area | Track, b: Area | Track, within_s: float = 7200.0, *, remark: str | None = None
) -> "Figure":
    """Return the coordination diagram of a pair: at which two times a track and another object are in contact.

    A delay of the track is a diagonal: it is free if it misses the contact set. If both are tracks, a is delayed.

    within_s : the largest delay to draw, seconds
    remark : a warning to print on the figure

    Raises InvalidInput for two areas, and ConflictDBError where there is no matplotlib.
    """
    if isinstance(a, Area):
        a, b = b, a
    if isinstance(a, Area):
        raise InvalidInput("plot", "a", "or b must be a Track: an area does not depart")
    horizon_us = round(1e6 * inputs.seconds("plot", "within_s", within_s))
    areas, tracks = ([b], [a]) if isinstance(b, Area) else ([], [a, b])
    with styled() as mpl:
        scene = Separations.of(scene).of_two(a, b) or replace(scene, rules=())
        sketch = Sketch(scene, areas, tracks)
        number = int(numbers_of(np.array([Kind.TRACK.code]), np.array([0]))[0])
        origin_us = int(a.times_us[0])
        outer, inner = contact_set(sketch.setup, sketch.pieces, number, horizon_us, origin_us, _SLICES)
        placed, stops = Memory(sketch.pieces), FirstStops.of(TrackBatch.of(tracks))
        every = differences_of(sketch.setup, placed, np.array([number]), horizon_us, waits=stops)
        others = dict.fromkeys(np.unique(every.other).tolist(), b.key)
        found = delays_of(a.key, others, every, horizon_us, Leeway.of(a, horizon_us))
        figure = mpl.figure.Figure(figsize=(7.0, 6.4), layout="constrained")
        panel = figure.subplots()
        names = name_of(a.key), name_of(b.key)
        says = "which of their times bring them into contact"
        if outer.is_empty:
            says = f"no delay within {duration_text(horizon_us)} brings them into contact"
        panel.set_title(f"{names[0]} and {names[1]}: {says}")
        origin = float(mpl.dates.date2num(instant(origin_us)))
        _draw_contact_set(panel, outer, inner, origin)
        whole_s = (int(a.times_us[-1]) - origin_us) / 1e6
        west, south, east, north = (0.0, 0.0, whole_s, whole_s) if outer.is_empty else outer.bounds
        room = _ROOM * max(east - west, north - south, _LEAST_S)
        west, east = west - room, east + room
        # With the diagonal of what is planned.
        south, north = min(south - room, west), max(north + room, east)
        _draw_diagonals(panel, found, names, np.array([west, east]), origin)
        panel.set_xlim(*(origin + np.array([west, east]) / _DAY_S))
        panel.set_ylim(*(origin + np.array([south, north]) / _DAY_S))
        ways = [f"planned time of {names[0]}", f"{'' if isinstance(b, Area) else 'planned '}time of {names[1]}"]
        for axis, label in zip((panel.xaxis, panel.yaxis), ways, strict=True):
            locator = mpl.dates.AutoDateLocator(minticks=3, maxticks=8)
            axis.set_major_locator(locator)
            axis.set_major_formatter(mpl.dates.ConciseDateFormatter(locator))
            axis.set_label_text(f"{label} (UTC)")
        panel.grid(visible=True)
        panel.set_axisbelow(True)
        panel.legend(loc="upper left", fontsize=7, framealpha=0.9, edgecolor="none")
        draw_remark(figure, remark)
        return figure


def tracks_in_conflict(conflicts: Iterable[Conflict]) -> list[str]:
    """Return the keys of the tracks among conflicts, by first contact."""
    rows = sorted(conflicts, key=first_contact_order)
    members = ((key, kind) for one in rows for key, kind in ((one.a_key, one.a_kind), (one.b_key, one.b_kind)))
    return list(dict.fromkeys(key for key, kind in members if kind is Kind.TRACK))


def _draw_bar(panel: Any, row: int, one: Delays) -> None:
    """Draw the possible delays of a track, those that are forbidden, and the least ones."""
    panel.barh(row, one.latest_s - one.earliest_s, left=one.earliest_s, height=0.62, color=FIRST + "50", linewidth=0)
    for each in one.forbidden:
        look = {"height": 0.62, "color": CONFLICT + "50", "hatch": "////", "edgecolor": "white", "linewidth": 0}
        panel.barh(row, each.to_s - each.from_s, left=each.from_s, zorder=2, **look)
        if each.is_proven:
            low, high = each.from_s + each.from_error_s, each.to_s - each.to_error_s
            panel.barh(row, high - low, left=low, height=0.62, color=CONFLICT, linewidth=0, zorder=3)
    for least_s, sign, side in ((one.least_later_s, 1, "left"), (one.least_earlier_s, -1, "right")):
        if least_s:
            panel.plot(sign * least_s, row, "D", color=INK, markersize=4, zorder=5)
            text = least_text(one, is_later=sign > 0)
            place = (sign * least_s, row), (5 * sign, 0)
            panel.annotate(text, *place, textcoords="offset points", ha=side, va="center", fontsize=7, zorder=5)


def _delay_axis(panel: Any, horizon_s: float) -> None:
    step_s = next((step_s for step_s in _STEPS_S if 2.0 * horizon_s / step_s <= _MOST_STEPS), horizon_s)
    ticks = np.arange(-np.floor(horizon_s / step_s), np.floor(horizon_s / step_s) + 1) * step_s
    panel.set_xticks(ticks, [_signed(delay_s) for delay_s in ticks.tolist()])
    panel.set_xlim(-horizon_s, horizon_s)
    panel.grid(visible=True, axis="x")
    panel.set_axisbelow(True)


def _signed(delay_s: float) -> str:
    if delay_s == 0.0:
        return "as planned"
    return f"{_MINUS if delay_s < 0.0 else '+'}{duration_text(round(1e6 * abs(delay_s)))}"


def _draw_contact_set(panel: Any, outer: shapely.Geometry, inner: shapely.Geometry, origin: float) -> None:
    for shape, colour, label in ((outer, CONFLICT + "50", "may be in contact"), (inner, CONFLICT, "in contact")):
        on_page = shapely.transform(shape, lambda times: origin + times / _DAY_S)
        map_panel.polygons(panel, np.array([on_page], dtype=object), facecolors=colour, edgecolors="none", zorder=2)
        panel.fill([], [], facecolor=colour, linewidth=0, label=label)


def _draw_diagonals(panel: Any, found: Delays, names: Sequence[str], across: Any, origin: float) -> None:
    """Draw the times that meet as planned, and with the least delays of the first object."""
    lines = [(0.0, "both as planned", INK, "solid")]
    for least_s, sign, word in ((found.least_later_s, 1, "later"), (found.least_earlier_s, -1, "earlier")):
        if least_s:
            text = least_text(found, is_later=sign > 0)
            lines.append((sign * least_s, f"{names[0]} {text} {word}", FIRST if sign > 0 else SECOND, "dashed"))
    for delay_s, label, colour, style in lines:
        times = origin + across / _DAY_S, origin + (across + delay_s) / _DAY_S
        panel.plot(*times, color=colour, linewidth=1.0, linestyle=style, label=label, zorder=3)
