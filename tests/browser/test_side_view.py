"""The side view of the page of `conflictdb map`: heights over time and along a track."""

import json
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from browsing import Open, rows, time_of, wait_until
from map_page import Serve
from piecework import load
from playwright.sync_api import Page, expect

from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
HOUR_US = 3_600_000_000
T0_US = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC
T0_S = T0_US / 1e6
SAID = (
    "FERRY: SUB-2 13 m below, 08:56 \N{EN DASH} 09:20; SUB-1 93 m below, 09:41; "
    "CABLE 113 m below, 09:30 \N{EN DASH} 10:17."
)


def colour_at(page: Page, hours: float, height_m: float) -> list[int]:
    """Return red, green, blue and opacity of the side view at a time and a height."""
    return list(
        page.evaluate(
            """([t, m]) => {
                const {side} = conflictdbPage, at = [side.x(t), side.y(m)].map((one) => Math.round(one));
                return [...side.picture.getContext('2d').getImageData(...at, 1, 1).data];
            }""",
            [T0_S + 3600 * hours, height_m],
        )
    )


def said(page: Page) -> str:
    return page.locator("#heights .said").inner_text()


@pytest.mark.parametrize("of", ["served", "file"])
def test_a_submarine_under_a_ferry_is_seen(open_strait: Open, of: str) -> None:
    """In words and as a band below that of the ferry, while it is below it."""
    page = open_strait((1280, 900), of=of)
    button = page.get_by_role("button", name="Side view")
    expect(button).to_have_attribute("aria-expanded", "false")
    page.keyboard.press("h")
    expect(button).to_have_attribute("aria-expanded", "true")
    expect(page.locator("#heights .said")).to_contain_text("Select an object")
    page.get_by_role("button", name="FERRY and TOW").click()
    expect(page.locator("#heights .said")).to_contain_text("SUB-2")
    assert said(page) == SAID
    below, beside = colour_at(page, 9.13, -85.0), colour_at(page, 10.6, -85.0)
    assert sum(below[:3]) < sum(beside[:3]) - 60  # SUB-2 stands out while the ferry is above it, and only then
    assert colour_at(page, 9.13, -85.0) != colour_at(page, 9.13, -10.0)
    red, green, blue, _ = colour_at(page, 9.784, 20.0)
    assert red > green > blue  # the conflict
    page.get_by_label("Side view along").select_option("track")
    wait_until(page, "conflictdbPage.side.isAlong")
    at = page.evaluate(
        "conflictdbPage.side.x(conflictdbPage.model.objects.get('FERRY').end) - conflictdbPage.side.x(0)"
    )
    assert at == pytest.approx(page.evaluate("conflictdbPage.timeline.width()"))
    assert sum(colour_at(page, 9.13, -85.0)[:3]) < sum(colour_at(page, 10.6, -85.0)[:3]) - 60
    box = page.locator("#heights canvas").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + page.evaluate("conflictdbPage.side.x(1780305600)"), box["y"] + 40)
    assert time_of(page) == pytest.approx(1780305600, abs=120)
    wait_until(page, "location.hash.includes('side=track')")
    if of == "file":
        return  # test_a_file_has_an_address_too reloads it
    page.reload()
    page.wait_for_selector("html[data-ready=true]", state="attached")
    wait_until(page, "conflictdbPage.side.isAlong")
    expect(page.locator("#heights .said")).to_contain_text("SUB-2 13 m below")


def test_chips_leave_what_is_below_at_the_surface_or_in_the_air(open_strait: Open) -> None:
    page = open_strait((390, 844))
    page.get_by_role("button", name="Side view").click()
    chips = {name: page.get_by_role("button", name=name, exact=True) for name in ("below", "surface", "air")}
    chips["surface"].click()
    chips["air"].click()
    assert rows(page) == ["CABLE and SUB-1"]
    expect(chips["surface"]).to_have_attribute("aria-pressed", "false")
    wait_until(page, "location.hash.includes('layers=below')")
    keys = page.evaluate("conflictdbPage.side.scene.objects.map(({key}) => key)")
    assert sorted(keys) == ["CABLE", "RESERVE", "SUB-1", "SUB-2"]  # RESERVE has no floor
    page.go_back()
    expect(chips["air"]).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#count")).to_contain_text("of 7 conflicts")
    page.go_back()
    expect(page.locator("#count")).to_have_text("7 conflicts")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_heights_change_along_legs(conn: Conn, dsn: str, serve: Serve, open_page: Open) -> None:
    """A climb is a slope, heights by leg are steps, and passes name the least distance at these heights."""
    times = np.array([T0_US, T0_US + HOUR_US, T0_US + 2 * HOUR_US])
    outline = rectangle_outline_m(500, 500, 500, 500)
    way = [(10.0, 50.0), (10.5, 50.0), (11.0, 50.0)]
    climb = Track("CLIMB", way, times, outline, floors_m=[0.0, 1000.0, 1000.0], ceilings_m=[100.0, 1100.0, 1100.0])
    steps = Track("STEPS", way, times, outline, floors_m=[2000.0, -200.0], ceilings_m=[2100.0, -100.0])
    jets = [
        Track("JET", [(10.75, 49.0), (10.75, 51.0)], np.array([T0_US + 84 * HOUR_US // 60, T0_US + 96 * HOUR_US // 60]),
              rectangle_outline_m(20, 20, 20, 20), floor_m=3000.0, ceiling_m=3100.0),
    ]  # fmt: skip
    load(conn, Scene("s"), [Area("FLAT", shapely.box(10.1, 49.9, 10.2, 50.1))], [climb, steps, *jets])
    page = open_page(serve(dsn, "s"))
    page.keyboard.press("h")
    expect(page.locator("#heights .said")).to_contain_text("Select an object")
    assert page.evaluate(
        """async (t0) => {
            const {bandAt, layersOf} = await import('/page/heights.js'), {objects} = conflictdbPage.model;
            const bands = (key) => [0.5, 1.5].map((hour) => bandAt(objects.get(key), t0 + 3600 * hour));
            return [bands('CLIMB'), bands('STEPS'), layersOf(objects.get('FLAT'))];
        }""",
        T0_S,
    ) == [[[500, 600], [1000, 1100]], [[2000, 2100], [-200, -100]], ["below", "surface", "air"]]
    page.evaluate("location.hash = '#selected=CLIMB&side=time'")
    # The jet needs 12 seconds for the haven's width: it is not missed.
    expect(page.locator("#heights .said")).to_contain_text("JET 1900 m above, 01:")
    expect(page.locator("#heights .said")).to_contain_text("STEPS")


def test_passes_are_those_of_polygons(open_strait: Open) -> None:
    """Brute force in the plane: every half minute."""
    page = open_strait()
    found = page.evaluate(
        """async () => {
            const {tracks} = conflictdbPage.model, found = [];
            for (const one of tracks) {
                const passed = await conflictdbPage.passes(one);
                for (const other of tracks) {
                    if (one.key >= other.key) continue;
                    const [from, to] = [Math.max(one.start, other.start), Math.min(one.end, other.end)], times = [];
                    for (let t = from; t < to; t += 30) times.push(t);
                    const havens = times.map((t) => [one.motion.haven(t), other.motion.haven(t)]);
                    found.push([passed.get(other.key) ?? [], times, havens]);
                }
            }
            return JSON.stringify(found);
        }"""
    )
    checked = 0
    for spans, times, pairs in json.loads(found):
        for t, (a, b) in zip(times, pairs, strict=True):
            if min((abs(t - end) for span in spans for end in span), default=99) > 1:
                overlaps = shapely.intersects(shapely.Polygon(a), shapely.Polygon(b))
                assert overlaps == any(low <= t <= high for low, high in spans)
                checked += overlaps
    assert checked > 100
