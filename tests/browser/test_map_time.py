"""The page of `conflictdb map` in a browser: shorter time ranges, lines of the map, and messages of empty scenes."""

import math
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from browsing import Open, await_drawn, go_to, rows, time_of, wait_until
from map_page import Serve
from piecework import load
from playwright.sync_api import Page, expect

from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
HOUR_US = 3_600_000_000
DAY_US = 24 * HOUR_US
T0_US = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC
JETS = 30


@pytest.fixture
def seconds_in_days(conn: Conn, dsn: str, serve: Serve) -> str:
    """Conflicts of some seconds, every 20 seconds, in a scene of ten days."""
    small = rectangle_outline_m(30, 30, 30, 30)
    still = Track("BUOY", [(10.0, 50.0), (10.0, 50.0)], np.array([T0_US, T0_US + 10 * DAY_US]), small)
    jets = [
        Track(
            f"JET-{n:02}",
            [(10.0, 49.5), (10.0, 50.5)],
            np.array([0, DAY_US // 144]) + T0_US + 4 * DAY_US + 20_000_000 * n,
            small,
        )
        for n in range(JETS)
    ]
    load(conn, Scene("s"), [], [still, *jets])
    detect(conn, "s", jobs=1)
    return serve(dsn, "s")


def shown_s(page: Page) -> float:
    """Return the length of the timeline's range, seconds."""
    return float(page.evaluate("conflictdbPage.timeline.shown[1] - conflictdbPage.timeline.shown[0]"))


def bars(page: Page) -> list[tuple[str, float, float]]:
    """Return the bars of the timeline that a pointer can meet: first key, and a place in the page."""
    return [
        tuple(bar)
        for bar in page.evaluate("""(() => {
            const line = conflictdbPage.timeline, box = line.canvas.getBoundingClientRect();
            const seen = line.isDense ? [] : line.bars.filter(({pieces: [[x]]}) => x > 0 && x < box.width - 4);
            return seen.map(({conflict, pieces: [[from, to]], lane}) =>
                [conflict.b, box.x + (from + to) / 2, box.y + 4 + (lane + 0.5) * line.lane]);
        })()""")
    ]


def test_conflicts_of_seconds_in_days_are_seen_and_chosen(seconds_in_days: str, open_page: Open) -> None:
    """Seconds of ten days are a hairline; the wheel, buttons and keys zoom in, around the instant under the pointer."""
    page = open_page(seconds_in_days, has_touch=True)
    expect(page.locator("#count")).to_have_text(f"{JETS} conflicts")
    whole = shown_s(page)
    assert whole == pytest.approx(10 * 86400)
    expect(page.get_by_label("Show all time")).to_be_disabled()
    places = [x for _, x, _ in bars(page)]
    assert max(places, default=0) - min(places, default=0) < 4  # all at one place
    # The wheel: the instant under the pointer stays there.
    box = page.locator("#bars").bounding_box()
    assert box is not None
    x = page.evaluate("conflictdbPage.timeline.x(conflictdbPage.t)")
    page.mouse.move(box["x"] + x, box["y"] + 50)
    for _ in range(10):
        page.mouse.wheel(0, -300)
    wait_until(page, "conflictdbPage.timeline.shown[1] - conflictdbPage.timeline.shown[0] < 3600")
    assert page.evaluate("conflictdbPage.timeline.x(conflictdbPage.t)") == pytest.approx(x, abs=2)
    found = bars(page)
    assert len({round(place) for _, place, _ in found}) == len(found) > 3
    key, at_x, at_y = found[2]
    page.mouse.click(at_x, at_y)
    expect(page.locator("#detail").get_by_role("heading")).to_contain_text(key)
    # The next conflict is brought into view.
    before = shown_s(page)
    for _ in range(JETS):
        page.keyboard.press("j")
    expect(page.locator("#detail").get_by_role("heading")).to_contain_text(f"JET-{JETS - 1}")
    assert shown_s(page) == before
    assert 0 < page.evaluate("conflictdbPage.timeline.x(conflictdbPage.t)") < box["width"]
    # Turning the wheel sideways moves the time range, not the current time.
    at, start = time_of(page), page.evaluate("conflictdbPage.timeline.shown[0]")
    page.mouse.wheel(-400, 0)
    wait_until(page, f"conflictdbPage.timeline.shown[0] < {start}")
    assert (time_of(page), shown_s(page)) == (at, pytest.approx(before))
    page.keyboard.press("Escape")
    page.locator("body").press("+")
    assert shown_s(page) == pytest.approx(before / 2)
    page.locator("body").press("-")
    page.locator("body").press("-")
    assert shown_s(page) == pytest.approx(before * 2)
    page.get_by_label("Show less time").click()
    assert shown_s(page) == pytest.approx(before)
    page.get_by_label("Show more time").click()
    assert shown_s(page) == pytest.approx(before * 2)
    for _ in range(30):
        page.locator("body").press("+")
    assert shown_s(page) == pytest.approx(2)
    expect(page.get_by_label("Show less time")).to_be_disabled()
    page.get_by_label("Show all time").click()
    assert shown_s(page) == whole
    # The slider is within the shown range; its ends are those of all time.
    page.get_by_label("Show less time").click()
    page.get_by_role("slider").press("End")
    assert time_of(page) == pytest.approx(T0_US / 1e6 + 10 * 86400)
    assert shown_s(page) == pytest.approx(whole / 2)
    # A filter, which redraws the bars, keeps the time range.
    page.get_by_role("combobox", name="Object").fill("JET-07")
    assert shown_s(page) == pytest.approx(whole / 2)
    page.get_by_role("combobox", name="Object").fill("")
    page.get_by_label("Show all time").click()
    page.set_viewport_size({"width": 390, "height": 844})
    wait_until(page, "conflictdbPage.timeline.width() < 390")
    assert_two_fingers_show_less_time(page)


def assert_two_fingers_show_less_time(page: Page) -> None:
    """The times under both fingers stay there; the current time does not change."""
    box = page.locator("#bars").bounding_box()
    assert box is not None
    touch = page.context.new_cdp_session(page)
    at, whole = time_of(page), shown_s(page)
    beside = "(y) => [200, 240].every((x) => conflictdbPage.timeline.barAt({ offsetX: x, offsetY: y }) === null)"
    free_y = next(y for y in range(1, int(box["height"])) if page.evaluate(beside, y))

    def fingers(kind: str, *places: float) -> None:
        points = [{"x": box["x"] + x, "y": box["y"] + free_y, "id": n} for n, x in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    fingers("touchStart", 200)
    first = time_of(page)
    fingers("touchStart", 200, 240)
    under = page.evaluate("conflictdbPage.timeline.timeAt(200)")
    for more in range(10, 81, 10):
        fingers("touchMove", 200 - more / 2, 240 + more / 2)
    fingers("touchEnd")
    wait_until(page, f"conflictdbPage.timeline.shown[1] - conflictdbPage.timeline.shown[0] < {whole / 2}")
    assert shown_s(page) == pytest.approx(whole / 3, rel=0.05)
    assert page.evaluate("conflictdbPage.timeline.timeAt(160)") == pytest.approx(under, abs=whole / 100)
    # The first finger alone moved the time, before the second one came.
    assert time_of(page) == first != at


def lines(page: Page, lon: float, lat: float, zoom: float) -> dict[str, list[dict[str, Any]]]:
    """Return the lines of a map of 900 by 600 pixels about a place."""
    size = 512.0 * 2.0**zoom
    y = 0.5 - math.asinh(math.tan(math.radians(lat))) / (2 * math.pi)
    frame = {"size": size, "width": 900, "height": 600, "left": lon / 360 + 0.5 - 450 / size, "top": y - 300 / size}
    script = "async (frame) => (await import('/page/graticule.js')).graticule(frame)"
    return dict(page.evaluate(script, frame))


def test_date_line_and_poles_are_true(conn: Conn, dsn: str, serve: Serve, open_page: Open) -> None:
    """A scene on both sides of the date line is one piece; objects off the map are reported, listed and drawn."""
    times = np.array([T0_US, T0_US + 10 * HOUR_US])
    outline = rectangle_outline_m(5000, 5000, 5000, 5000)
    tracks = [
        Track("EAST", [(178.0, 10.0), (-178.0, 10.0)], times, outline),
        Track("WEST", [(-178.0, 10.0), (178.0, 10.0)], times, outline),
        Track("POLE-1", [(178.0, 86.0), (-178.0, 86.0)], times, outline),
        Track("POLE-2", [(-178.0, 86.0), (178.0, 86.0)], times, outline),
    ]
    load(conn, Scene("s"), [Area("SEAM", shapely.box(179.5, 5.0, 180.5, 8.0))], tracks)
    detect(conn, "s", jobs=1)
    page = open_page(serve(dsn, "s"))
    assert sorted(rows(page)) == ["EAST and WEST", "POLE-1 and POLE-2"]
    west, south, east, north = page.evaluate("conflictdbPage.model.box()")
    assert (west, east) == (pytest.approx(178.0), pytest.approx(182.0))
    assert (south, north) == (pytest.approx(5.0), pytest.approx(86.0))
    expect(page.locator("#beyond")).to_contain_text("2 objects reach beyond")
    expect(page.locator(".row", has_text="POLE-1")).to_contain_text("near the pole")
    page.get_by_role("button", name="EAST and WEST").click()
    await_drawn(page)
    seen = page.evaluate("conflictdbPage.havens.shown.map(({track, x}) => [track.key, x])")
    width = page.evaluate("document.getElementById('map').clientWidth")
    at = dict(seen)
    assert len(seen) == 2
    assert abs(at["EAST"] - at["WEST"]) < width / 2
    page.keyboard.press("Escape")
    assert_lines_of_the_map_are_where_they_say(page)
    page.get_by_role("button", name="POLE-1 and POLE-2").click()
    # The other figure, of the distance over time, comes when the kernel is there.
    expect(page.locator("figcaption", has_text="At first contact")).to_contain_text(
        "beyond 85.05°, where only the polar view shows it"
    )
    expect(page.locator("svg.plan path.plan-a")).to_have_count(1)


def assert_lines_of_the_map_are_where_they_say(page: Page) -> None:
    """On both sides of the date line, at the equator, and as far north as the map goes."""
    go_to(page, "{center: [180, 60], zoom: 6}")
    await_drawn(page)
    # As the map has them, and drawn: the canvas is not empty where one runs.
    shown, places, drawn = page.evaluate("""(() => {
        const {graticule: {canvas, shown}, view: {map}} = conflictdbPage, pixels = canvas.getContext("2d");
        const beside = (degrees) => (degrees < 0 ? degrees + 360 : degrees); // the turn that is in view
        return [shown, [
            ...shown.meridians.map(({degrees, x}) => [map.project([beside(degrees), 60]).x, x]),
            ...shown.parallels.map(({degrees, y}) => [map.project([180, degrees]).y, y]),
        ], pixels.getImageData(Math.round(shown.meridians[0].x), 200, 1, 1).data[3]];
    })()""")
    assert len(places) >= 4
    assert all(line == pytest.approx(place, abs=0.5) for place, line in places)
    assert drawn > 0
    names = [line["name"] for line in shown["meridians"]]
    middle = names.index("180°")
    assert (names[middle - 1][-1], names[middle + 1][-1]) == ("E", "W")
    for lon, lat, zoom, east, north in [
        (180.2, 61.0, 7, ["179°", "180°", "179°"], None),
        (0.0, 0.0, 3, ["20° W", "0°", "20° E"], ["20° N", "0°", "20° S"]),
        (30.0, 83.0, 5, None, ["83°20\N{PRIME} N", "83° N", "82°40\N{PRIME} N"]),
        (30.0, -84.9, 8, None, ["84°54\N{PRIME} S"]),
        (359.9, 10.001, 14, ["0°06.0\N{PRIME} W"], ["10° N"]),
    ]:
        found = lines(page, lon, lat, zoom)
        size = 512.0 * 2.0**zoom
        for line in found["meridians"]:
            turned = (line["degrees"] - lon + 180) % 360 - 180
            assert line["x"] == pytest.approx(450 + turned / 360 * size, abs=1e-3)
        for line in found["parallels"]:
            away = [math.asinh(math.tan(math.radians(at))) for at in (lat, line["degrees"])]
            assert line["y"] == pytest.approx(300 + (away[0] - away[1]) / (2 * math.pi) * size, abs=1e-3)
            assert abs(line["degrees"]) <= 85.06
        for wanted, lies in ((east, found["meridians"]), (north, found["parallels"])):
            said = [line["name"] for line in lies]
            assert all(any(name.startswith(one) for name in said) for one in wanted or ()), said


def test_what_is_not_there_is_told(conn: Conn, dsn: str, serve: Serve, open_page: Open) -> None:
    """A scene without objects, also in the table and from the side; not detected; without conflicts; with none left."""
    load(conn, Scene("s"), [], [])
    page = open_page(serve(dsn, "s"))
    nothing, count = page.locator("#list p"), page.locator("#count")
    expect(nothing).to_contain_text("conflictdb load FILE --scene")
    page.set_viewport_size({"width": 390, "height": 844})
    page.get_by_role("button", name="Table", exact=True).click()
    expect(page.locator("#table")).to_contain_text("No conflict is left to show.")
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Table", exact=True)).to_be_focused()
    page.get_by_role("button", name="Side view").click()
    expect(page.locator("#heights .said")).to_have_text("No object is left to show.")
    await_drawn(page)
    assert time_of(page) > 0
    page.set_viewport_size({"width": 900, "height": 600})
    load(conn, Scene("s"), [Area("A", shapely.box(0, 0, 1, 1)), Area("B", shapely.box(2, 0, 3, 1))], [])
    conn.commit()
    expect(nothing).to_contain_text("No conflict is known yet (never detected: 2 objects wait for detection)")
    expect(count).to_be_empty()
    detect(conn, "s", jobs=1)
    conn.commit()
    expect(nothing).to_have_text("No two objects are in conflict.")
    expect(count).to_have_text("0 conflicts")
    load(conn, Scene("s"), [Area("A", shapely.box(0, 0, 1, 1)), Area("B", shapely.box(0, 0, 3, 1))], [])
    detect(conn, "s", jobs=1)
    conn.commit()
    expect(count).to_have_text("1 conflict")
    expect(nothing).to_be_hidden()
    page.get_by_role("combobox", name="Object").fill("C")
    expect(nothing).to_have_text("The filter leaves no conflict.")
