"""The look of the page of `conflictdb map`: one type scale, places, and names that do not cover each other."""

import re
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
from browsing import Open, await_drawn, go_to, wait_until
from map_page import Serve
from piecework import load
from playwright.sync_api import Page

import conflictdb
from conflictdb.model.plans import Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
PAGE = Path(conflictdb.__file__).parent / "map" / "page"
HOUR_US = 3_600_000_000
T0_US = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC


def test_fonts_are_of_one_type_scale() -> None:
    """Sizes are custom properties of style.css, on canvases too."""
    for file in [*PAGE.glob("*.js"), PAGE / "style.css"]:
        for line in file.read_text(encoding="utf-8").splitlines():
            sized = re.search(r"font(-size)?\s*[:=]\s*[`\"']?(\d{3} )?\d+px", line)
            assert sized is None, f"{file.name}: {line}"


def test_facts_of_the_list_are_whole_or_not_there(open_strait: Open) -> None:
    """No row ends in "3 mi...", which reads as miles: facts without room are left out, the last ones first."""
    seen = """[...document.querySelectorAll('.row .facts')].map((facts) => [...facts.children]
        .filter((one) => one.offsetTop < facts.offsetTop + facts.clientHeight)
        .map((one) => [one.textContent, one.scrollWidth - one.clientWidth]))"""
    counts = []
    for size in ((820, 1180), (1440, 900)):
        found = open_strait(size).evaluate(seen)
        assert len(found) == 7
        assert [text for row in found for text, cut in row if cut > 0] == []
        counts.append([len(row) for row in found])
    assert min(counts[0]) >= 1
    assert min(counts[1]) >= 2


def boxes(page: Page, of: str) -> list[tuple[str, list[float], bool]]:
    found = page.evaluate(f"conflictdbPage.{of}.map(({{text, box, isLed}}) => [text, box, isLed])")
    return [(text, box, is_led) for text, box, is_led in found]


def assert_apart(names: list[tuple[str, list[float], bool]]) -> None:
    for (one, a, _), (other, b, _) in combinations(names, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (one, other)


def test_names_of_a_crowd_are_apart_and_lead_to_their_ships(
    conn: Conn, dsn: str, serve: Serve, open_page: Open
) -> None:
    """Places keep theirs while ships move; countries and towns are below."""
    rng = np.random.default_rng(1)
    times = np.array([T0_US, T0_US + 4 * HOUR_US])
    tracks = [
        Track(
            f"SHIP-{n}", rng.uniform((10.68, 59.18), (10.72, 59.22), (2, 2)), times, rectangle_outline_m(50, 50, 10, 10)
        )
        for n in range(60)
    ]
    load(conn, Scene("s"), [], tracks)
    page = open_page(serve(dsn, "s"), size=(1280, 900))
    page.get_by_role("slider", name="Time shown").press("PageUp")
    await_drawn(page)
    names = boxes(page, "havens.names")
    assert_apart(names)
    assert len(names) > 45
    assert any(is_led for *_, is_led in names)
    places = "Object.fromEntries(conflictdbPage.havens.namePlaces)"
    before = page.evaluate(places)
    page.get_by_role("slider", name="Time shown").press("ArrowRight")
    after = page.evaluate(places)
    assert sum(before[key] == after.get(key) for key in before) > 0.7 * len(before)

    go_to(page, "{center: [12, 59], zoom: 5}")
    wait_until(page, "conflictdbPage.placeNames.shown.length > 0")
    shown = boxes(page, "placeNames.shown")
    assert {"DENMARK", "Stockholm"} <= {text for text, *_ in shown}
    assert_apart(shown + boxes(page, "havens.names"))
    drawn = "document.getElementById('place-names').getContext('2d')"
    x0, y0, x1, y1 = next(box for text, box, _ in shown if text == "Stockholm")
    pixels = page.evaluate(f"Array.from({drawn}.getImageData({x0}, {y0}, {x1 - x0}, {y1 - y0}).data)")
    assert any(pixels[3::4])
    assert_land_comes_where_it_is_seen(page)


def assert_land_comes_where_it_is_seen(page: Page) -> None:
    """That of the world, which takes a second, when the map reaches there, and once."""
    asked: list[str] = []
    page.on("request", lambda request: "/land/" in request.url and asked.append(request.url))
    seen = "(({{map}}) => map.queryRenderedFeatures(map.project({}), {{layers: ['{}']}}).length)(conflictdbPage.view)"
    go_to(page, "{center: [10.7, 59.2], zoom: 8}")
    go_to(page, "{center: [11, 60], zoom: 7}")
    await_drawn(page)
    assert [page.evaluate(seen.format("[11.2, 60]", layer)) for layer in ("land", "near-land")] == [0, 1]
    assert asked == []
    go_to(page, "{center: [-55, -10], zoom: 4}")
    wait_until(page, seen.format("[-55, -10]", "land"))
    go_to(page, "{center: [25, 0], zoom: 3}")
    wait_until(page, seen.format("[25, 0]", "land"))
    assert len(asked) == 1
