"""Figures are true: separations between their bounds, shapes in their places, names unchanged."""

import gzip
import json
import logging
import pickle
import re
import warnings
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.figure
import numpy as np
import pytest
import shapely
from matplotlib.patches import Rectangle
from pyproj import Geod

import conflictdb
from conflictdb import (
    Area,
    Conflict,
    InvalidInput,
    Motion,
    Scene,
    Track,
    Verdict,
    delays,
    plot_coordination,
    plot_delays,
    plot_pair,
    plot_scene,
    plot_timeline,
    solve,
)
from conflictdb.client.advise import advise
from conflictdb.jobs.detect import Run
from conflictdb.model.results import Approach, Explanation, Listing, Results, SceneState
from conflictdb.plot import figures, land, report
from conflictdb.plot.separation import separation
from conflictdb.plot.sketch import Sketch

START = datetime(2026, 6, 1, 6, tzinfo=UTC)
SQUARE = [(-500.0, -500.0), (500.0, -500.0), (500.0, 500.0), (-500.0, 500.0)]
HOSTILE = '<script>alert("$x_1$")</script>\x1b[31m'


def track(key: str, *way: tuple[float, float], outline: Any = SQUARE, hours: float = 2.0) -> Track:
    times = [START + k * timedelta(hours=hours) / (len(way) - 1) for k in range(len(way))]
    return Track(key, way, times, outline)


def area(key: str, west: float, south: float, east: float, north: float, **more: Any) -> Area:
    return Area(key, shapely.box(west, south, east, north), **more)


def microseconds(instant: datetime) -> int:
    return (instant - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1)


@pytest.fixture(scope="module")
def strait() -> tuple[Scene, list[Area], list[Track], Results[Conflict]]:
    scene, areas, tracks, _ = conflictdb.read(files("conflictdb") / "scenes" / "strait.geojson")  # type: ignore[arg-type]
    return scene, areas, tracks, solve(tracks, areas, scene)


def texts(figure: Any) -> list[str]:
    from matplotlib.text import Text

    return [one.get_text() for one in figure.findobj(Text) if one.get_text()]


@pytest.mark.parametrize("lat", [0.0, 60.0, -80.0])
@pytest.mark.parametrize("lon", [10.0, 179.99])
def test_separation_of_points_is_their_distance(lon: float, lat: float) -> None:
    """Also across the date line, against geodesics."""
    still = track("still", (lon, lat), (lon, lat), outline=[(0.0, 0.0)])
    moving = track("moving", (lon - 1.0, lat), (lon + 1.0, lat), outline=[(0.0, 0.0)])
    at_us = np.linspace(microseconds(START), microseconds(START + timedelta(hours=2)), 9).astype(np.int64)
    found = separation(Sketch(Scene("s"), [], [still, moving]), 0, 1, at_us)
    places = lon - 1.0 + 2.0 * np.linspace(0.0, 1.0, 9)
    _, _, true = Geod(ellps="WGS84").inv(places, np.full(9, lat), np.full(9, lon), np.full(9, lat))
    assert (found.low_m <= true + 1e-3).all()
    assert (true - 1e-3 <= found.high_m).all()
    assert (found.high_m - found.low_m < 10.0).all()


@pytest.mark.parametrize("deep_m", [1.0, 300.0, 999.0])
def test_separation_of_what_overlaps_is_the_least_way_out(deep_m: float) -> None:
    """Two squares of 1,000 m on the equator, one east of the other by 1,000 m less the depth."""
    east = np.degrees((1000.0 - deep_m) / 6378137.0)
    pair = [track("a", (0.0, -0.01), (0.0, 0.01)), track("b", (east, -0.01), (east, 0.01))]
    found = separation(Sketch(Scene("s"), [], pair), 0, 1, np.array([microseconds(START + timedelta(hours=1))]))
    assert found.low_m[0] - 0.01 <= -deep_m <= found.high_m[0] + 0.01
    assert found.high_m[0] - found.low_m[0] < 1e-3 * deep_m + 0.01


def test_separation_is_below_zero_during_the_periods_and_above_before_and_after(strait: Any) -> None:
    scene, areas, tracks, found = strait
    sketch = Sketch(scene, areas, tracks)
    aside = timedelta(seconds=5)
    for conflict in found:
        a, b = (sketch.keys.index(key) for key in (conflict.a_key, conflict.b_key))
        shared = [max(sketch.span_us(a)[0], sketch.span_us(b)[0]), min(sketch.span_us(a)[1], sketch.span_us(b)[1])]
        for start, end in conflict.periods:
            inside = [microseconds(start + aside), microseconds(end - aside)]
            assert (separation(sketch, a, b, np.array(inside)).high_m < 0.0).all()
            outside = [
                at for at in (microseconds(start - aside), microseconds(end + aside)) if shared[0] < at < shared[1]
            ]
            if outside:
                assert (separation(sketch, a, b, np.array(outside)).low_m > 0.0).all()


def test_what_stages_2_and_3_leave_holds_the_first_contact(strait: Any) -> None:
    scene, areas, tracks, found = strait
    sketch = Sketch(scene, areas, tracks)
    seen = 0
    for conflict in found:
        a, b = (sketch.keys.index(key) for key in (conflict.a_key, conflict.b_key))
        regions, lines = sketch.meetings(a, b)
        if sketch.is_track(b):
            point = sketch.on_page(shapely.Point(conflict.first_contact_deg), a)
            assert shapely.distance(regions, point).min() < 1.0
            assert len(lines) >= 2
            assert all(ends.shape == (2, 2) for _, ends in lines)
            seen += 1
    assert seen == 6


@pytest.mark.parametrize("west", [178.5, -181.5, 358.5 - 360.0])
def test_objects_at_the_date_line_are_near_on_the_page(west: float) -> None:
    """However their longitudes are written."""
    zone = area("zone", west, 10.0, west + 2.0, 11.0)
    wrapped = (west + 1.6 + 180.0) % 360.0 - 180.0
    ship = track("ship", (wrapped, 9.5), (wrapped, 11.5))
    sketch = Sketch(Scene("s"), [zone], [ship])
    distance = shapely.distance(sketch.outline(0), shapely.LineString(sketch.way(1)))
    assert distance == 0.0
    haven = sketch.shape_at(1, microseconds(START + timedelta(hours=1)))
    assert haven is not None
    assert sketch.outline(0).contains(haven.centroid)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_scene_at_the_date_line_is_one_piece(sign: float) -> None:
    """Its map is as wide as the scene, with ways, hulls, havens and the results of stages on the same side of it."""
    at = [sign * lon for lon in (176.0, 183.0)]
    wrapped = [(lon + 180.0) % 360.0 - 180.0 for lon in at]
    east = track("EAST", (wrapped[0], 4.0), (wrapped[1], 8.5), hours=12.0)
    west = track("WEST", (wrapped[1], 4.0), (sign * 179.5, 6.25), (wrapped[0], 8.5), hours=12.0)
    cut = shapely.MultiPolygon([shapely.box(179.5, 5.0, 180.0, 5.4), shapely.box(-180.0, 5.0, -179.5, 5.4)])
    scene, areas, tracks = Scene("s"), [Area("SEAM", cut)], [east, west]
    found = solve(tracks, areas, scene)
    sketch = Sketch(scene, areas, tracks)
    turn_m = sketch.setup.plane.turn_m
    box = shapely.total_bounds([sketch.outline(0), *(shapely.LineString(sketch.way(n)) for n in (1, 2))])
    assert (box[2] - box[0]) / turn_m * 360.0 == pytest.approx(7.0)
    for number in (1, 2):
        way = shapely.LineString(sketch.way(number))
        hulls = shapely.union_all(sketch.hulls(number))
        assert hulls.covers(way)
        assert hulls.bounds[2] - hulls.bounds[0] < 0.03 * turn_m
        for hours in (1, 6, 11):
            haven = sketch.shape_at(number, microseconds(START + timedelta(hours=hours)))
            assert shapely.distance(haven, way) == 0.0
    (conflict,) = [one for one in found if (one.a_key, one.b_key) == ("EAST", "WEST")]
    regions, lines = sketch.meetings(1, 2)
    first = sketch.on_page(shapely.Point(conflict.first_contact_deg), 1)
    assert shapely.distance(regions, first).min() < 1.0
    assert all(box[0] <= ends[:, 0].min() <= ends[:, 0].max() <= box[2] for _, ends in lines)
    assert conflict.plot().axes


def test_what_is_not_decided_is_not_called_a_conflict(strait: Any) -> None:
    scene, areas, tracks, found = strait
    by_key = {one.key: one for one in (*areas, *tracks)}
    for verdict, says in [(Verdict.UNRESOLVED, "not proven apart"), (Verdict.GRAZING, "too close to call")]:
        one = replace(found[0], verdict=verdict)
        said = " ".join(texts(plot_pair(scene, by_key[one.a_key], by_key[one.b_key], one)))
        assert f"shaded: {says}" in said
        assert "in conflict" not in said


def test_names_from_right_to_left_stand_in_their_place() -> None:
    """Neighbouring text keeps its own direction: marks enclose the name."""
    ships = [track("\N{HEBREW LETTER ALEF}1", (0.0, 0.0), (0.1, 0.0)), track("<b>", (0.1, 0.0), (0.0, 0.0))]
    said = texts(plot_timeline(solve(ships, [], Scene("s"))))
    mark = "\N{LEFT-TO-RIGHT MARK}"
    assert f"<b> and {mark}\N{HEBREW LETTER ALEF}1{mark}" in said


def test_a_haven_is_drawn_where_it_is_and_only_while_it_is_there(strait: Any) -> None:
    scene, areas, tracks, found = strait
    sketch = Sketch(scene, areas, tracks)
    conflict = next(one for one in found if (one.a_key, one.b_key) == ("FERRY", "TOW"))
    numbers = [sketch.keys.index(key) for key in ("FERRY", "TOW")]
    shapes = [sketch.shape_at(number, microseconds(conflict.periods[0][0])) for number in numbers]
    assert shapely.distance(*shapes) < 1.0
    assert shapely.area(shapely.intersection(*shapes)) < 1e3
    assert sketch.shape_at(numbers[0], sketch.span_us(numbers[0])[0] - 1) is None


def test_a_scene_shows_all_objects_by_name_and_a_bar_for_each_period(strait: Any) -> None:
    scene, areas, tracks, found = strait
    figure = plot_scene(scene, areas, tracks, found, remark="NOT COMPLETE: 3 objects wait")
    said = texts(figure)
    names = {one.name for one in (*areas, *tracks) if len(one.name) <= 28}
    assert len(names) == 8
    assert names <= set(said)
    assert "strait: 4 areas, 7 tracks, 7 conflicts" in said
    assert "NOT COMPLETE: 3 objects wait" in said
    assert "Cable works on the sea bed and Submarine haven, deep" in said
    bars = figure.axes[1].patches
    assert len(bars) == sum(len(one.periods) for one in found)
    assert len(plot_timeline(found).axes[0].patches) == len(bars)


def test_a_scene_is_drawn_wide_and_pale_below_its_conflicts(strait: Any) -> None:
    """Long names of rows take no width of the map; paths do not darken where they cross."""
    from matplotlib.collections import LineCollection

    scene, areas, tracks, found = strait
    figure = plot_scene(scene, areas, tracks, found)
    above, below = figure.axes
    assert above.get_position().width > 0.85
    assert below.get_position().width < 0.7
    [paths] = [one for one in above.collections if isinstance(one, LineCollection) and len(one.get_segments()) == 7]
    [colour] = paths.get_colors()
    assert colour[3] == 1.0
    assert colour[:3].min() > 0.4
    contacts = [one for one in above.lines if one.get_marker() == "o"]
    assert len(contacts) == len(found)
    assert all(one.get_zorder() > paths.get_zorder() for one in contacts)


def test_a_report_has_the_worst_conflicts_on_its_timeline(strait: Any) -> None:
    """The timeline is in the order of time, and short enough for the first page."""
    scene, areas, tracks, found = strait
    many = [replace(one, a_name=f"{n:02} of", b_name="many") for n, one in enumerate([*found] * 3)]
    figure = figures.plot_worst(scene, areas, tracks, many)
    rows = [one.get_text() for one in figure.axes[1].get_yticklabels()]
    assert len(rows) == 10
    assert figure.axes[1].get_title(loc="left") == "When, UTC (the 10 worst of 21)"
    first = [bar.get_x() for bar in figure.axes[1].patches]
    assert first[0] == min(first)


def test_times_have_two_labels_or_more(strait: Any) -> None:
    """At every length from seconds to weeks."""
    *_, found = strait
    for seconds in (5, 20, 45, 100, 250, 416, 1000, 3000, 9000, 40_000, 100_000, 400_000, 1_500_000):
        period = START, START + timedelta(seconds=seconds)
        [panel] = plot_timeline([replace(found[0], periods=[period])]).axes
        low, high = panel.get_xlim()
        assert 2 <= sum(low <= at <= high for at in panel.get_xticks()) <= 9, seconds


def test_a_figure_tells_two_objects_of_one_name_apart_by_their_keys(strait: Any) -> None:
    scene, areas, tracks, found = strait
    alike = {"FERRY": "Ferry", "TOW": "Ferry", "DIVING": "FIRING"}
    some = [replace(one, name=alike.get(one.key)) for one in (*areas, *tracks)]
    named = [replace(one, a_name=alike.get(one.a_key), b_name=alike.get(one.b_key)) for one in found]
    said = texts(plot_scene(scene, some[: len(areas)], some[len(areas) :], named))
    assert {"FERRY (Ferry)", "TOW (Ferry)", "FIRING", "DIVING (FIRING)", "FERRY (Ferry) and TOW (Ferry)"} <= set(said)


def test_a_pair_shows_what_is_known_of_it(strait: Any, tmp_path: Path) -> None:
    *_, found = strait
    conflict = next(one for one in found if (one.a_key, one.b_key) == ("FIRING", "SURVEY"))
    figure = conflict.plot()
    said = " ".join(texts(figure))
    assert "Firing practice and Survey aircraft: conflict" in said
    assert "projected onto the way (stage 3)" in said
    assert "1 µs" in said
    # Three periods are shaded, apart from the band of the bounds.
    assert len(figure.axes[1].patches) == len(conflict.periods) == 3
    figures.save(figure, tmp_path / "pair.png")
    assert (tmp_path / "pair.png").read_bytes().startswith(b"\x89PNG")


def named(strait: Any, *keys: str) -> list[Any]:
    _, areas, tracks, _ = strait
    by_key = {one.key: one for one in (*areas, *tracks)}
    return [by_key[key] for key in keys]


def solid_m(figure: Any) -> Any:
    """Return the solid curve of the separation panel, metres, NaN where it is not drawn."""
    (line,) = [one for one in figure.axes[1].get_lines() if one.get_linewidth() == 1.2]
    return np.asarray(line.get_ydata(), dtype=float)


def test_a_pair_that_heights_keep_apart_says_so_and_shows_them(strait: Any) -> None:
    """The submarines cross: the separation goes below zero, but is dashed, with a panel of heights below it."""
    figure = plot_pair(strait[0], *named(strait, "SUB-1", "SUB-2"))
    said = " ".join(texts(figure))
    assert "Submarine haven, deep and Submarine haven, shallow: no conflict is known" in said
    assert "their heights never overlap: -300 to -100 m, and -100 to -20 m" in said.replace("\N{MINUS SIGN}", "-")
    assert np.isnan(solid_m(figure)).all()
    lines = [np.asarray(one.get_ydata(), dtype=float) for one in figure.axes[1].get_lines()]
    assert np.fmin.reduce(np.concatenate(lines)) < 0.0
    low, high = figure.axes[2].get_ylim()
    assert low < -300.0
    assert high > -20.0
    assert figure.axes[2].get_xlim() == figure.axes[1].get_xlim()


def test_heights_of_each_leg_count_at_their_time() -> None:
    """A climb from below an area to above it: the curve is solid only while the heights overlap."""
    way = [(-1.0, 0.5), (0.5, 0.5), (2.0, 0.5)]
    times = [START, START + timedelta(hours=1), START + timedelta(hours=2)]
    ship = Track("b", way, times, SQUARE, floors_m=[0.0, 500.0], ceilings_m=[100.0, 600.0])
    zone = area("a", 0.0, 0.0, 1.0, 1.0, floor_m=100.0)
    figure = plot_pair(Scene("s"), zone, ship)
    solid = np.isfinite(solid_m(figure))
    assert not solid[: len(solid) // 2 - 1].any()
    assert solid[len(solid) // 2 + 1 :].all()
    said = " ".join(texts(figure))
    assert "heights: from 100 m up, and 0 to 600 m" in said
    assert "never overlap" not in said
    low = Track("b", way, times, SQUARE, floors_m=[500.0, 0.0], ceilings_m=[600.0, 100.0])
    late = area("a", 1.5, 0.0, 1.6, 1.0, floor_m=100.0)
    assert "their heights are apart while they cross" in " ".join(texts(plot_pair(Scene("s"), late, low)))


def test_heights_without_limits_are_not_mentioned() -> None:
    figure = plot_pair(Scene("s"), area("a", 0, 0, 1, 1), track("b", (-1.0, 0.5), (2.0, 0.5)))
    assert "heights" not in " ".join(texts(figure))
    assert len(figure.axes) == 2
    assert not np.isnan(solid_m(figure)).any()


def shown_m(figure: Any) -> float:
    """Return the height of the map, plane metres."""
    south, north = figure.axes[0].get_ylim()
    return float(north - south)


def test_two_areas_show_what_they_have_in_common(strait: Any) -> None:
    """The map is as large as that, not as the point of first contact; also of the pair in a report."""
    *_, found = strait
    conflict = next(one for one in found if (one.a_key, one.b_key) == ("DIVING", "FIRING"))
    figure = conflict.plot()
    assert "where both are" in texts(figure)
    common = shapely.intersection(*(one.footprint for one in named(strait, "DIVING", "FIRING")))
    _, south, _, north = common.bounds
    assert 1.5 < shown_m(figure) / ((north - south) * 111_000 / np.cos(np.radians(57.9))) < 4.0


@pytest.mark.parametrize("gap_deg", [0.0, 0.001])
def test_areas_that_have_nothing_in_common_are_shown_whole(gap_deg: float) -> None:
    """Areas that touch, and areas nearer than the required separation."""
    scene = Scene("s", separation_m=200.0)
    a, b = area("a", 0.0, 0.0, 1.0, 1.0), area("b", 1.0 + gap_deg, 1.0, 2.0, 2.0)
    (found,) = solve([], [a, b], scene)
    figure = plot_pair(scene, a, b, found)
    assert shown_m(figure) > 200_000.0
    assert "where both are" not in texts(figure)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (area("a", 0, 0, 1, 1), area("b", 0.5, 0.5, 2, 2)),
        (area("a", 0, 0, 1, 1, end_us=START), area("b", 0.5, 0.5, 2, 2, start_us=START)),
        (area("a", 0, 0, 1, 1, start_us=START), area("b", 0.5, 0.5, 2, 2)),
        (area("a", 0, 0, 1, 1), track("b", (-1.0, 0.5), (2.0, 0.5))),
        (track("a", (0.0, 0.0), (0.0, 0.0), outline=[(0.0, 0.0)]), track("b", (0.0, 0.0), (0.0, 0.0))),
    ],
)
@pytest.mark.parametrize("motion", list(Motion))
def test_any_pair_can_be_drawn(a: Area | Track, b: Area | Track, motion: Motion) -> None:
    """Objects without time limits, never together, without size, or without motion."""
    scene = Scene("s", motion=motion)
    areas, tracks = ([one for one in (a, b) if isinstance(one, kind)] for kind in (Area, Track))
    found = solve(tracks, areas, scene)
    assert plot_pair(scene, a, b, found[0] if found else None).axes
    assert plot_scene(scene, areas, tracks, found).axes


@pytest.mark.parametrize("form", ["svg", "pdf", "png"])
def test_the_same_figure_is_the_same_file(strait: Any, tmp_path: Path, form: str) -> None:
    *_, found = strait
    both = [figures.save(found[0].plot(), tmp_path / f"{n}.{form}").read_bytes() for n in range(2)]
    assert both[0] == both[1]
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"0.{form}", f"1.{form}"]


def test_a_figure_is_drawn_once_whatever_layout_is_usual_here(
    strait: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    *_, found = strait
    drawn, draw = [], mpl.figure.Figure.draw
    monkeypatch.setattr(mpl.figure.Figure, "draw", lambda *args: (drawn.append(args), draw(*args)))
    usual = figures.save(found[0].plot(), tmp_path / "usual.svg").read_bytes()
    assert len(drawn) == 1
    with mpl.rc_context({"figure.constrained_layout.use": True}):
        assert figures.save(found[0].plot(), tmp_path / "own.svg").read_bytes() == usual
    assert len(drawn) == 2


def test_other_files_are_refused_and_what_cannot_be_written_leaves_nothing(strait: Any, tmp_path: Path) -> None:
    *_, found = strait
    with pytest.raises(InvalidInput, match=r"plot: file: must end in \.png, \.svg, \.pdf; got 'x\.jpg'"):
        figures.save(found[0].plot(), "x.jpg")
    (tmp_path / "taken.svg").mkdir()
    with pytest.raises(OSError, match="taken"):
        figures.save(found[0].plot(), tmp_path / "taken.svg")
    assert [path.name for path in tmp_path.iterdir()] == ["taken.svg"]


def test_a_scene_without_objects_is_refused() -> None:
    with pytest.raises(InvalidInput, match="scene 's': objects: there are none"):
        plot_scene(Scene("s"), [], [], [])
    with pytest.raises(InvalidInput, match="timeline: conflicts: there are none"):
        plot_timeline([])


def test_keys_are_text_and_nothing_else(tmp_path: Path) -> None:
    """No formulas, no markup, no control characters; characters that no font has do no harm."""
    ships = [track(HOSTILE, (0.0, 0.0), (0.1, 0.0)), track("船-1", (0.1, 0.0), (0.0, 0.0))]
    scene = Scene(f"s {HOSTILE}")
    found = solve(ships, [], scene)
    figure = plot_scene(scene, [], ships, found)
    figures.save(figure, tmp_path / "x.svg")
    drawn = (tmp_path / "x.svg").read_text()
    assert "<script" not in drawn
    assert "$x_1$" in drawn
    assert "\x1b" not in drawn
    shown = found._repr_html_() + found[0]._repr_html_()
    assert "<script" not in shown
    assert "&lt;script" in shown
    assert "\x1b" not in shown
    state = SceneState("s", 2, 1, None, None, False, HOSTILE)
    checked = report.Checked(scene, [], ships, found, [], state, "PostgreSQL", {})
    report.write(checked, tmp_path / "x.html")
    page = (tmp_path / "x.html").read_text()
    assert "<script" not in page
    assert "\x1b" not in page
    assert "NOT COMPLETE" in page
    assert "船-1" in page
    assert not re.search(r"""(src|href)=["'](?!data:)""", page)
    report.write(checked, tmp_path / "x.pdf")
    assert (tmp_path / "x.pdf").read_bytes().startswith(b"%PDF-")


def test_a_report_says_what_was_found_and_with_which_settings(strait: Any, tmp_path: Path) -> None:
    scene, areas, tracks, found = strait
    state = SceneState("strait", 11, 0, None, None, True, None)
    near = replace(found[0], verdict=conflictdb.Verdict.NEAR, periods=(), closest_m=120.0, closest_error_m=0.5)
    scene = replace(scene, nearest_m=1000.0, separation_m=250.0)
    checked = report.Checked(scene, areas, tracks, found, [near], state, "PostgreSQL 15", {})
    report.write(checked, tmp_path / "x.html", now=datetime(2026, 6, 1, tzinfo=UTC))
    page = (tmp_path / "x.html").read_text()
    assert "Of 55 pairs of 11 objects 7 are reported. Every time that is reported is right to 1 µs or better" in page
    assert "NOT COMPLETE" not in page
    assert "Made 2026-06-01 00:00:00 UTC" in page
    assert "<td>250 m</td>" in page
    assert "120.000 ± 0.5" in page
    assert ">0.000 ±" not in page
    assert "no conflict is missed" in page
    assert "2026-06-01 09:45:43 to 09:48:51" in page
    assert page.count("<img ") == 7
    listed = re.findall(
        r"<tr><td>([A-Z0-9-]+)[^<]*</td><td>([A-Z0-9-]+)[^<]*</td><td>conflict</td>.*?<td>([^<]*)</td></tr>", page
    )
    assert [one[:2] for one in listed] == [
        *[("FERRY", "TOW"), ("CABLE", "SUB-1"), ("FIRING", "FERRY"), ("DIVING", "SUB-2"), ("DIVING", "FERRY")],
        *[("FIRING", "SURVEY"), ("DIVING", "FIRING")],
    ]
    assert listed[0][2] == "too close by 0.7 nmi at 09:47:16"
    assert page.index('alt="FERRY (') < page.index('alt="CABLE (')
    assert "When they could depart instead" not in page
    with pytest.raises(InvalidInput, match=r"report: file: must end in \.html or \.pdf; got 'x\.txt'"):
        report.write(checked, tmp_path / "x.txt")


def test_bars_are_as_long_as_departures_are_forbidden(strait: Any) -> None:
    """Each least delay has its mark, and its time as words."""
    scene, areas, tracks, _ = strait
    found = delays(tracks, areas, scene)
    figure = plot_delays(found, left_out=3)
    [panel] = figure.axes
    bars = {(round(bar.get_x(), 6), round(bar.get_width(), 6)) for bar in panel.patches if isinstance(bar, Rectangle)}
    assert bars >= {(-7200.0, 14_400.0)}
    for one in found:
        for each in one.forbidden:
            assert (round(each.from_s, 6), round(each.to_s - each.from_s, 6)) in bars
    marks = [line.get_xdata()[0] for line in panel.lines if line.get_marker() == "D" and len(line.get_xdata())]
    ends = [end for one in found for end in (one.least_later_s, -(one.least_earlier_s or 0.0)) if end]
    assert sorted(marks) == pytest.approx(sorted(ends))
    said = texts(figure)
    assert {"TOW", "51 min", "11 min 18 s", "as planned", "+2 h"} <= set(said)
    assert "Departures, earlier and later than planned (the first 7 of 10)" in said
    names = {track.key: track.name for track in tracks}
    figure = plot_delays(found, names=names)
    assert {"Ferry", "Tug with a barge on a long …", "Survey aircraft"} <= set(texts(figure))
    figure.draw_without_rendering()
    title, legend = figure._suptitle.get_window_extent(), figure.axes[0].get_legend().get_window_extent()
    assert not title.overlaps(legend)
    with pytest.raises(InvalidInput, match="there are none"):
        plot_delays([])


def test_departures_that_are_not_possible_are_not_drawn_as_free(strait: Any) -> None:
    scene, areas, tracks, _ = strait
    [tow] = delays(tracks, areas, scene, "TOW", now=datetime(2026, 6, 1, 6, 40, tzinfo=UTC))
    [panel] = plot_delays([tow]).axes
    bar = panel.patches[0]
    assert isinstance(bar, Rectangle)
    assert (bar.get_x(), bar.get_width()) == (-300.0, 7500.0)


def test_a_coordination_diagram_has_the_diagonals_that_touch_the_contact_set(strait: Any) -> None:
    scene, areas, tracks, _ = strait
    by_key = {one.key: one for one in [*areas, *tracks]}
    said = texts(plot_coordination(scene, by_key["FERRY"], by_key["TOW"]))
    assert {"FERRY 7 min 59 s later", "FERRY 11 min 18 s earlier", "both as planned"} <= set(said)
    assert {"planned time of FERRY (UTC)", "planned time of TOW (UTC)"} <= set(said)
    said = texts(plot_coordination(scene, by_key["DIVING"], by_key["FERRY"]))
    assert {"FERRY 17 min 26 s earlier", "planned time of FERRY (UTC)", "time of DIVING (UTC)"} <= set(said)
    said = texts(plot_coordination(scene, by_key["SUB-1"], by_key["SUB-2"]))
    assert "SUB-1 and SUB-2: no delay within 2 h brings them into contact" in said
    with pytest.raises(InvalidInput, match="or b must be a Track"):
        plot_coordination(scene, by_key["DIVING"], by_key["CABLE"])
    with pytest.raises(InvalidInput, match="within_s"):
        plot_coordination(scene, by_key["FERRY"], by_key["TOW"], -1.0)


def test_figures_of_the_documents_are_small() -> None:
    for name in ("departures.svg", "coordination.svg"):
        assert (Path(__file__).parents[2] / "docs" / name).stat().st_size < 100_000


def test_a_report_says_when_tracks_in_conflict_could_depart_instead(strait: Any, tmp_path: Path) -> None:
    """Of the first ones; the others are named."""
    scene, areas, tracks, found = strait
    state = SceneState("strait", 11, 0, None, None, True, None)
    every = report.asked_about(found)
    assert every == ["SUB-1", "FERRY", "SUB-2", "TOW", "SURVEY"]
    asked = report.asked_about(found, most=3)
    assert asked == every[:3]
    later = delays(tracks, areas, scene, asked)
    report.write(
        report.Checked(scene, areas, tracks, found, [], state, "PostgreSQL 15", {}, later), tmp_path / "x.html"
    )
    page = (tmp_path / "x.html").read_text()
    assert "<td>no delay within 2 h clears SUB-1: it meets CABLE</td>" in page
    assert "<td>FERRY must leave 1 h 7 min 24 s earlier to clear DIVING, FIRING and TOW; no later" in page
    assert "2 of 5 are left out: TOW, SURVEY.</p>" in page
    assert page.count("<img ") == 8
    assert [one.key for one in later] == sorted(asked)


def test_a_page_of_pdf_has_headings_with_what_they_are_of(
    strait: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No heading ends a page, columns are as wide as numbers need, and letters stand in the order that is seen."""
    import fpdf

    pages: dict[str, list[int]] = {"headings": [], "figures": []}
    said, widths = [], []

    class Page(fpdf.FPDF):
        def multi_cell(self, w: Any, h: Any = None, text: str = "", **more: Any) -> Any:
            said.append((text, more.get("align")))
            if text in ("Where and when", "Pair by pair"):
                pages["headings"].append(self.page_no())
            return super().multi_cell(w, h, text, **more)

        def image(self, *content: Any, **more: Any) -> Any:
            pages["figures"].append(self.page_no())
            return super().image(*content, **more)

        def table(self, *rows: Any, **more: Any) -> Any:
            widths.append((more["col_widths"], self.epw))
            return super().table(*rows, **more)

    monkeypatch.setattr(fpdf, "FPDF", Page)
    scene, areas, tracks, found = strait
    # Hebrew is read from the right: of PDF, which writes from the left, the last letter comes first.
    hebrew = "\N{HEBREW LETTER ALEF}\N{HEBREW LETTER BET}-1"
    keys = {"CABLE": "a long name " * 12, "FERRY": hebrew}
    renamed = [
        replace(one, a_key=keys.get(one.a_key, one.a_key), b_key=keys.get(one.b_key, one.b_key)) for one in found
    ]
    tracks = [replace(one, key=keys.get(one.key, one.key)) for one in tracks]
    areas = [replace(one, key=keys.get(one.key, one.key)) for one in areas]
    scene = replace(scene, name=f"{hebrew} {'and further ' * 20}")
    state = SceneState("strait", 11, 0, None, None, True, None)
    report.write(report.Checked(scene, areas, tracks, renamed, [], state, "PostgreSQL 15", {}), tmp_path / "x.pdf")
    assert len(pages["headings"]) == 2
    assert pages["headings"] == pages["figures"][:2]
    assert all(align == "L" for text, align in said if text.startswith(("Of ", "Interference")))
    assert said[0][0].startswith("Interference report: 1-\N{HEBREW LETTER BET}\N{HEBREW LETTER ALEF} and")
    # In the table of conflicts, the longest column leaves the others enough width.
    columns, across = next((columns, across) for columns, across in widths if len(columns) == 7)
    assert sum(columns) == pytest.approx(across, rel=1e-6)
    assert columns[5] > 22.0  # "57.95000, 8.40711", millimetres


def test_periods_without_an_end_are_told_in_words() -> None:
    period = report._period
    assert period(None, None) == "always"
    assert period(START, None) == "from 2026-06-01 06:00:00 on"
    assert period(None, START) == "until 2026-06-01 06:00:00"
    assert period(START, START + timedelta(hours=1)) == "2026-06-01 06:00:00 to 07:00:00"


def test_letters_of_other_scripts_are_drawn_where_a_font_has_them(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """By one of the requested fonts, if it is installed; and without warnings."""
    from fontTools.fontBuilder import FontBuilder
    from fontTools.pens.ttGlyphPen import TTGlyphPen
    from matplotlib import font_manager
    from matplotlib.text import Text

    pen = TTGlyphPen(None)
    for n, corner in enumerate([(50, 0), (50, 900), (950, 900), (950, 0)]):
        (pen.lineTo if n else pen.moveTo)(corner)
    pen.closePath()
    square = pen.glyph()
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder([".notdef", "ship"])
    builder.setupCharacterMap({ord("船"): "ship"})
    builder.setupGlyf({".notdef": TTGlyphPen(None).glyph(), "ship": square})
    builder.setupHorizontalMetrics({".notdef": (1000, 0), "ship": (1000, 50)})
    builder.setupHorizontalHeader(ascent=900, descent=-100)
    builder.setupNameTable({"familyName": "Noto Sans CJK JP", "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    builder.save(tmp_path / "font.ttf")
    ships = [track("船", (0.0, 0.0), (0.1, 0.0)), track("B", (0.1, 0.0), (0.0, 0.0))]
    known = list(font_manager.fontManager.ttflist)
    others = [font for font in known if not font.name.startswith("Noto Sans CJK")]
    try:
        font_manager.fontManager.ttflist[:] = others
        without = plot_scene(Scene("s"), [], ships, [])
        font_manager.fontManager.addfont(tmp_path / "font.ttf")
        figure = plot_scene(Scene("船"), [], ships, [])
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            figure.canvas.draw()
        assert [str(one.message) for one in said if "missing from font" in str(one.message)] == []
        figures.save(figure, tmp_path / "x.png")
    finally:
        font_manager.fontManager.ttflist[:] = known
        font_manager.fontManager._findfont_cached.cache_clear()
    for drawn, is_there in ((figure, True), (without, False)):
        (title,) = [one for one in drawn.findobj(Text) if one.get_text().endswith("0 conflicts")]
        assert ("Noto Sans CJK JP" in title.get_fontfamily()) == is_there
    said_of_fonts = [record for record in caplog.records if record.name.startswith("matplotlib.font_manager")]
    assert [record.getMessage() for record in said_of_fonts if record.levelno >= logging.WARNING] == []


def test_a_copy_made_elsewhere_has_no_objects_to_draw(strait: Any) -> None:
    *_, found = strait
    copied = pickle.loads(pickle.dumps(found[0]))  # noqa: S301
    assert copied == found[0]
    with pytest.raises(InvalidInput, match="conflict: plot: has no objects to draw"):
        copied.plot()


def test_notebooks_show_tables(strait: Any) -> None:
    *_, found = strait
    shown = found._repr_html_()
    assert shown.count("<tr>") == 8
    assert "2026-06-01 09:45:43<" in shown
    many = Results(list(found) * 20, Conflict)
    assert "closest, m" not in shown  # a column of zeros
    assert "closest, m" in replace(found[0], closest_m=12.5, closest_error_m=0.1)._repr_html_()
    assert "the first 50 of 140" in many._repr_html_()
    assert many._repr_html_().count("<tr>") == 51
    state = SceneState("s", 1, 1, None, None, False, "1 object waits for detection")
    assert "1 object waits" in Listing(state, [], Conflict)._repr_html_()
    assert "no conflicts" in Listing(state, [], Conflict)._repr_html_()
    assert Explanation({}, "a < b\nc")._repr_html_() == "<pre>a &lt; b\nc</pre>"
    near = Results([one.approach for one in found if one.approach], Approach)
    assert near._repr_html_().count("<tr>") == len(near) + 1


def test_a_vertical_separation_counts_and_is_not_drawn_as_height(strait: Any) -> None:
    """The submarines' bands touch: closer than any vertical separation. Bands further apart state their distance."""
    scene = replace(strait[0], vertical_separation_m=10.0)
    figure = plot_pair(scene, *named(strait, "SUB-1", "SUB-2"))
    assert "apart" not in figure.get_suptitle()
    assert np.isfinite(solid_m(figure)).all()
    zone, ship = area("a", 0, 0, 1, 1, ceiling_m=50.0), track("b", (-1.0, 0.5), (2.0, 0.5))
    ship = replace(ship, floor_m=60.0, ceiling_m=70.0)
    figure = plot_pair(replace(scene, vertical_separation_m=10.0), zone, ship)
    assert "their heights are always 10 m apart: up to 50 m, and 60 to 70 m" in figure.get_suptitle()
    assert figure.axes[2].get_ylim() == (44.0, 76.0)


def test_figures_show_land_near_the_objects_only() -> None:
    """A coast in the plane of the scene; none on the high seas, across the date line and about a pole."""

    def land_of(scene: Scene, west: float, south: float) -> float:
        zone = area("a", west, south, west + 0.5, south + 0.5)
        panel = plot_scene(scene, [zone], [], []).axes[0]
        shown = [one for one in panel.collections if one.get_zorder() == -1]
        return sum(len(one.get_paths()) for one in shown)

    for motion in Motion:
        assert land_of(Scene("s", motion=motion), 10.0, 57.0) > 0
        assert land_of(Scene("s", motion=motion), -40.0, 45.0) == 0
    assert land_of(Scene("s"), 179.8, 66.0) == 0


def test_two_pairs_fit_on_a_page_of_a_report(strait: Any, tmp_path: Path) -> None:
    scene, areas, tracks, found = strait
    state = SceneState("strait", 11, 0, None, None, True, None)
    sections = report._sections(report.Checked(scene, areas, tracks, found, [], state, "PostgreSQL 15", {}))
    sizes = [figure.get_size_inches() for _, figure in sections[-1].figures]
    assert len(sizes) == 6
    # A4 within its margins: 178 by 263 mm, with a heading.
    assert all(2 * 178.0 * high / wide <= 263.0 - 25.0 for wide, high in sizes)


def test_results_show_themselves_in_notebooks(strait: Any) -> None:
    scene, areas, tracks, _ = strait
    state = SceneState(HOSTILE, 11, 2, datetime(2026, 6, 1, tzinfo=UTC), None, False, "2 objects wait")
    shown = state._repr_html_()
    assert "2 objects wait" in shown
    assert "2026-06-01 00:00:00" in shown
    assert "<script" not in shown
    advice = advise(scene, areas, tracks, sample=20)
    assert "<th>tolerance</th>" in advice._repr_html_()
    assert advice.recommendation[:20] in advice._repr_html_()
    run = Run(**dict.fromkeys((field.name for field in fields(Run)), 3))
    assert "<th>conflicts</th><td>3</td>" in run._repr_html_()


@pytest.mark.parametrize("detail", [land.COARSE, land.FINE])
def test_coastlines_are_parsed_as_json(detail: str) -> None:
    text = gzip.decompress((files("conflictdb") / "map" / "vendor" / f"land-{detail}.json.gz").read_bytes()).decode()
    expected = json.loads(text)
    topology, arcs = land._topology(text)
    assert [arc.tolist() for arc in arcs] == expected["arcs"]
    assert topology == expected | {"arcs": []}
