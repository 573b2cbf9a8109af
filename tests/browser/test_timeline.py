"""The timeline of the page of `conflictdb map`: rows with names, many conflicts, the calendar, filtering by time."""

import re
import time
from typing import Any

import numpy as np
import psycopg
import shapely
from browsing import Open, rows, time_of, wait_until
from map_page import Serve
from piecework import load
from playwright.sync_api import Page, expect

from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Scene

Conn = psycopg.Connection[Any]
T0_S = 1_780_272_000  # 2026-06-01 00:00 UTC
HOUR_US = 3_600_000_000
SHIPS = 50

WRITTEN = """(of) => {
    const {timeline} = conflictdbPage, written = [], context = timeline[of].getContext('2d');
    context.fillText = (text) => written.push(text);
    timeline.draw();
    delete context.fillText;
    return written;
}"""


def dragged(page: Page, from_s: float, to_s: float) -> None:
    """Draw over the calendar from one instant to another."""
    box = page.locator("#axis").bounding_box()
    assert box is not None
    x = [box["x"] + page.evaluate(f"conflictdbPage.timeline.x({at})") for at in (from_s, to_s)]
    page.mouse.move(x[0], box["y"] + 8)
    page.mouse.down()
    page.mouse.move(sum(x) / 2, box["y"] + 8)
    page.mouse.move(x[1], box["y"] + 8)
    page.mouse.up()


def test_rows_have_names_and_the_calendar_filters(open_strait: Open) -> None:
    """By conflict and by object; a hint on a bar; a drag over the calendar, which Back takes back; keys do the same."""
    page = open_strait((1280, 900))
    written = page.evaluate(WRITTEN, "picture")
    names = page.evaluate("conflictdbPage.timeline.rows.map(({texts}) => texts)")
    assert len(set(written)) == len(written)
    assert names[1] == ["Firing practice", "Ferry"]
    for shown, pair in zip(written, names, strict=True):
        for cut, name in zip(shown.split(" · "), pair, strict=True):
            assert name.startswith(cut.split("…")[0])
            assert name.endswith(cut.split("…")[-1])
    assert len(written) == len(rows(page))
    assert "08:00" in page.evaluate(WRITTEN, "axis")
    box = page.locator("#bars").bounding_box()
    assert box is not None
    middle = "(({pieces: [[from, to]]}) => (from + to) / 2)(conflictdbPage.timeline.bars[1])"
    page.mouse.move(box["x"] + page.evaluate(middle), box["y"] + 4 + 1.5 * 16)
    expect(page.get_by_role("tooltip")).to_have_text(
        "Firing practice and Ferry1 Jun 2026 08:11:17 \N{EN DASH} 09:07:24 · 56 min 06 s · conflict"
    )
    page.mouse.move(box["x"] + 20, box["y"] - 60)
    expect(page.get_by_role("tooltip")).to_be_hidden()

    page.get_by_label("Rows of the timeline").select_option("object")
    written = page.evaluate(WRITTEN, "picture")
    assert written[2:5] == ["Firing practice", "Ferry", "Diving on a wreck"]
    assert len(written) == 8
    wait_until(page, "location.hash.includes('rows=object')")
    page.mouse.click(box["x"] + 130, box["y"] + 4 + 6.5 * 16)  # its name
    expect(page.locator("#detail").get_by_role("heading")).to_have_text("FERRY and TOW")
    page.keyboard.press("Escape")

    at = time_of(page)
    dragged(page, T0_S + 9.5 * 3600, T0_S + 10.25 * 3600)
    expect(page.locator("#count")).to_have_text("4 of 7 conflicts")
    assert "FIRING and FERRY" not in rows(page)
    assert time_of(page) == at
    assert page.locator("#from").input_value()[:14] == "2026-06-01 09:"
    wait_until(page, "location.hash.includes('from=2026-06-01+09') && location.hash.includes('to=2026-06-01+10')")
    page.go_back()
    expect(page.locator("#count")).to_have_text("7 conflicts")
    page.go_forward()
    expect(page.locator("#count")).to_have_text("4 of 7 conflicts")
    page.evaluate("document.getElementById('filter').reset()")
    expect(page.locator("#count")).to_have_text("7 conflicts")
    page.get_by_role("slider", name="Time shown").press("End")
    page.keyboard.press("[")
    expect(page.locator("#count")).to_have_text("0 of 7 conflicts")


def test_fingers_and_keys_have_hints_too(open_strait: Open) -> None:
    """A finger that stays reads, one that is lifted at once chooses; keys say what is on, also to screen readers."""
    page = open_strait((390, 844))
    tip = page.get_by_role("tooltip")
    box = page.locator("#bars").bounding_box()
    assert box is not None
    x = box["x"] + page.evaluate("(({pieces: [[from, to]]}) => (from + to) / 2)(conflictdbPage.timeline.bars[1])")
    point = {"x": x, "y": box["y"] + 4 + 1.5 * 16}
    touch = page.context.new_cdp_session(page)

    def finger(kind: str, at_s: float, *points: dict[str, float]) -> None:
        """Say when that was: how long a finger stays does not depend on the machine."""
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points, "timestamp": now_s + at_s})

    now_s = time.time()
    finger("touchStart", 0.0, point)
    expect(tip).to_contain_text("Firing practice and Ferry")
    above = tip.bounding_box()
    assert above is not None
    assert above["y"] + above["height"] <= point["y"] - 30
    assert above["x"] >= 0
    assert above["x"] + above["width"] <= 390
    finger("touchEnd", 0.6)
    expect(tip).to_be_hidden()
    expect(page.locator("#detail")).to_be_hidden()
    finger("touchStart", 2.0, point)
    finger("touchEnd", 2.05)
    expect(page.locator("#detail").get_by_role("heading")).to_have_text("FIRING and FERRY")
    expect(tip).to_be_hidden()
    page.keyboard.press("Escape")

    slider = page.get_by_role("slider", name="Time shown")
    slider.press("Home")
    expect(tip).to_be_hidden()
    expect(slider).to_have_attribute("aria-valuetext", "1 Jun 2026 06:00:00 UTC, nothing is on")
    page.evaluate(f"conflictdbPage.moveTo({T0_S} + 9.03 * 3600)")
    slider.press("ArrowRight")
    expect(tip).to_contain_text("5 at once")
    expect(tip).to_contain_text("; 2 more")
    expect(slider).to_have_attribute("aria-valuetext", re.compile("UTC, 5 at once, .* and .*; 2 more"))
    slider.press("Escape")
    expect(tip).to_be_hidden()
    slider.press("ArrowRight")
    expect(tip).to_be_visible()
    page.keyboard.press("Tab")
    expect(tip).to_be_hidden()


def test_conflicts_one_after_the_other_are_not_at_once(conn: Conn, dsn: str, serve: Serve, open_page: Open) -> None:
    """Sixty of a minute each, on a phone some in one pixel: one at a time, as on a wide page."""
    box, minute = shapely.box(9.0, 57.0, 9.1, 57.1), HOUR_US // 60
    starts = [T0_S * 1_000_000 + n * 2 * minute for n in range(60)]
    areas = [Area(f"EXERCISE-{n}", box, start_us=start, end_us=start + minute) for n, start in enumerate(starts)]
    port = Area("PORT", box, start_us=starts[0] - 24 * HOUR_US, end_us=starts[0] + 24 * HOUR_US)
    load(conn, Scene("s"), [port, *areas], [])
    detect(conn, "s", jobs=1)
    page = open_page(serve(dsn, "s"), size=(390, 844))
    said = "60 conflicts over time; at most 1 at once"
    expect(page.locator("#bars")).to_have_attribute("aria-label", said)
    page.set_viewport_size({"width": 1440, "height": 900})
    wait_until(page, "conflictdbPage.timeline.width() > 500")
    page.get_by_role("combobox", name="Object").fill("port")  # all of them, laid out for this width
    expect(page.locator("#count")).to_have_text("60 of 60 conflicts")
    expect(page.locator("#bars")).to_have_attribute("aria-label", said)


def test_many_conflicts_are_counted_in_months(conn: Conn, dsn: str, serve: Serve, open_page: Open) -> None:
    """A strip with an axis; fewer, by a filter or when less time is shown, are rows that scroll."""
    box = shapely.box(9.0, 57.0, 9.1, 57.1)
    week = 7 * 24 * HOUR_US
    areas = [Area("PORT", box)]
    areas += [
        Area(f"A{n}", box, start_us=T0_S * 1_000_000 + n * week, end_us=T0_S * 1_000_000 + n * week + HOUR_US)
        for n in range(SHIPS)
    ]
    areas.append(Area("LAST", box, start_us=T0_S * 1_000_000 + HOUR_US // 2, end_us=T0_S * 1_000_000 + HOUR_US))
    load(conn, Scene("s"), areas, [])
    detect(conn, "s", jobs=1)
    page = open_page(serve(dsn, "s"), size=(1280, 800))
    assert page.evaluate("conflictdbPage.timeline.isDense")
    assert page.evaluate(WRITTEN, "picture") == ["0", "3 at once"]
    months = page.evaluate(WRITTEN, "axis")
    assert months[:3] == ["Jun 2026", "Jul", "Aug"]
    assert "2027" in months
    expect(page.locator("#bars")).to_have_attribute("aria-label", "52 conflicts over time; at most 3 at once")
    bounds = page.locator("#bars").bounding_box()
    assert bounds is not None
    page.mouse.move(bounds["x"] + page.evaluate("conflictdbPage.timeline.left") + 1, bounds["y"] + 60)
    expect(page.get_by_role("tooltip")).to_contain_text("at once1 Jun 2026 ")
    page.get_by_role("combobox", name="Object").fill("A1")
    assert len(page.evaluate(WRITTEN, "picture")) == len(rows(page)) == 11
    assert page.evaluate(
        "(({scrollHeight, clientHeight}) => scrollHeight > clientHeight)(document.getElementById('rows'))"
    )
    top = "document.getElementById('rows').scrollTop"
    assert page.evaluate(top) == 0
    page.locator(".row").nth(10).click()
    assert page.evaluate(top) > 0


def test_ticks_are_those_of_the_calendar(open_strait: Open) -> None:
    """A year shows months, a day hours; at every length they are in range, in order, and not too many."""
    page = open_strait()
    script = "async ([from, to, most]) => (await import('/page/calendar.js')).ticks([from, to], most)"

    def texts(length_s: float, most: float = 12, at_s: float = T0_S) -> list[str]:
        found = page.evaluate(script, [at_s, at_s + length_s, most])
        times = [tick["t"] for tick in found]
        assert times == sorted(set(times))
        assert all(at_s <= t <= at_s + length_s for t in times)
        return [tick["text"] for tick in found]

    assert texts(365 * 86400) == [
        *("Jun 2026", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec", "2027", "Feb", "Mar", "Apr", "May", "Jun"),
    ]
    assert texts(86400)[:3] == ["00:00", "02:00", "04:00"]
    assert texts(86400)[-1] == "2 Jun"
    assert texts(30) == ["00:00:00", "00:00:05", "00:00:10", "00:00:15", "00:00:20", "00:00:25", "00:00:30"]
    assert texts(60 * 86400, 9)[:2] == ["1 Jun", "8 Jun"]  # Mondays
    assert texts(86400 * 365 * 900, 10)[0] == "2100"
    assert texts(86400 * 365 * 4, 5, -2e10) != []
    for length in np.geomspace(3, 3e10, 60):
        assert 2 <= len(texts(length)) <= 25
