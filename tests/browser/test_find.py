"""Finding on the page of `conflictdb map`: objects, places and positions, chips of the filter, and the table."""

import csv
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from browsing import Open, rows, wait_until
from commands import runner
from map_page import Serve
from piecework import load
from playwright.sync_api import Page, expect

from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
HOUR_US = 3_600_000_000
T0_US = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC
FORMULA = '=HYPERLINK("http://x")'
HOSTILE = "<img src=x onerror=alert(1)>"


def place(page: Page) -> list[float]:
    return list(page.evaluate("conflictdbPage.view.place()"))


def test_objects_places_and_positions_are_found(open_strait: Open) -> None:
    """By the keyboard alone; the card of an object without a conflict names its nearest approach."""
    page = open_strait((1280, 900))
    words = page.get_by_role("combobox", name="Object")
    words.fill("convoy")
    expect(words).to_have_attribute("aria-expanded", "true")
    options = page.locator("#found").get_by_role("option")
    expect(options).to_have_count(2)
    words.press("ArrowDown")
    words.press("ArrowDown")
    expect(options.nth(1)).to_have_attribute("aria-selected", "true")
    words.press("Enter")
    card = page.locator("#object")
    expect(card.get_by_role("heading")).to_have_text("CONVOY-2")
    expect(options).to_have_count(0)
    # The other ship of the convoy, 2.1 km ahead.
    expect(card.locator(".said")).to_contain_text(
        "No conflict. Nearest at its heights: CONVOY-1, 185 m (within 0.00025 m)"
    )
    wait_until(page, "conflictdbPage.havens.shown.some(({track}) => track.key === 'CONVOY-2')")
    wait_until(page, "location.hash.includes('selected=CONVOY-2')")
    card.get_by_role("button", name="Deselect").click()
    expect(card).to_be_hidden()
    expect(page.locator("#count")).to_have_text("7 conflicts")

    words.fill("ferry")
    words.press("Enter")
    expect(card.locator(".said")).to_have_text("3 conflicts, in the list below.")
    wait_until(page, lambda: sorted(rows(page)) == ["DIVING and FERRY", "FERRY and TOW", "FIRING and FERRY"])
    page.go_back()
    expect(card).to_be_hidden()

    words.fill("stockh")
    expect(options).to_have_text(["Stockholm town"])
    options.click()
    wait_until(page, "Math.abs(conflictdbPage.view.place()[0] - 18.07) < 0.1")
    expect(page.locator("#count")).to_have_text("7 conflicts")
    words.fill("57.5 N, 9.25 E")
    words.press("Enter")
    wait_until(page, "Math.abs(conflictdbPage.view.place()[1] - 57.5) < 0.01")


def test_the_nearest_approach_is_that_of_the_polygons(conn: Conn, dsn: str, serve: Serve, open_page: Open) -> None:
    """In time, not along the paths; not of what is at other heights; of areas as well."""
    outline = rectangle_outline_m(500, 500, 500, 500)

    def ship(key: str, way: list[tuple[float, float]], hours: list[float], **more: Any) -> Track:
        times = T0_US + (np.array(hours) * HOUR_US).astype(np.int64)
        return Track(key, way, times, outline, **more)

    tracks = [
        ship("EAST", [(10.0, 57.0), (11.0, 57.0)], [0, 4], floor_m=0, ceiling_m=10),
        ship("NORTH", [(10.5, 56.7), (10.5, 57.3)], [0.5, 3.5], floor_m=0, ceiling_m=10),  # at the crossing with EAST
        ship("LATE", [(10.5, 56.7), (10.5, 57.3)], [1.0, 4.0], floor_m=0, ceiling_m=10),
        ship("DEEP", [(10.0, 57.0), (11.0, 57.0)], [0, 4], floor_m=-90, ceiling_m=-50),
        ship("ALONE", [(10.0, 57.0), (11.0, 57.0)], [40, 44], floor_m=500),
    ]
    areas = [Area("FAR", shapely.box(12.0, 56.0, 13.0, 58.0), floor_m=-100, ceiling_m=-40)]
    load(conn, Scene("s"), areas, tracks[2:3] + tracks[:1] + tracks[3:])
    detect(conn, "s", jobs=1)
    page = open_page(serve(dsn, "s"))
    found = page.evaluate(
        """async () => {
            const keys = ['EAST', 'LATE', 'DEEP', 'ALONE', 'FAR'];
            const found = await Promise.all(keys.map((key) => conflictdbPage.nearest(key)));
            return found.map((one) => one && [one.other, one.m, one.t, one.error]);
        }"""
    )
    exact = page.evaluate(
        """() => {
            const {objects} = conflictdbPage.model, [a, b] = [objects.get('EAST').motion, objects.get('LATE').motion];
            return Array.from({length: 1080}, (_, n) => 1780275600 + 10 * n)
                .map((t) => [a.haven(t), b.haven(t)]);
        }"""
    )
    flat = [
        [shapely.transform(shapely.Polygon(one), lambda p: p * [60_700, 111_350]) for one in pair] for pair in exact
    ]
    least = min(shapely.distance(a, b) for a, b in flat)
    assert [found[0][0], found[1][0]] == ["LATE", "EAST"]
    assert found[0][1] == pytest.approx(found[1][1], abs=3) == pytest.approx(least, rel=0.01)
    assert found[2][0] == "FAR"
    assert found[2][1] == pytest.approx(60_700 - 500, rel=0.01)
    assert found[3] is None
    assert found[4][0] == "DEEP"
    assert found[4][1] == pytest.approx(found[2][1], abs=1e-3)
    assert max(one[3] for one in found if one) < 1e-3
    page.get_by_role("combobox", name="Object").fill("alone")
    page.get_by_role("combobox", name="Object").press("Enter")
    said = page.locator("#object .said")
    expect(said).to_have_text("No conflict. Nothing comes within 539.9 nmi at its time and heights.")
    page.get_by_text("More", exact=True).click()
    page.get_by_label("Units").select_option("metric")
    expect(said).to_have_text("No conflict. Nothing comes within 1000.0 km at its time and heights.")


def test_chips_take_one_limit_away_each(open_strait: Open) -> None:
    page = open_strait((390, 844))
    page.evaluate(
        "location.hash = '#object=ferry&verdicts=conflict&from=2026-06-01+08:00&floor=-5&layers=surface,air&now=1'"
    )
    chips = page.get_by_role("group", name="Active filters").get_by_role("button")
    texts = ["“ferry”", "conflict", "from 1 Jun 2026 08:00:00", "above -5 m", "surface, air", "at the time shown"]
    expect(chips).to_have_text([f"{text} ✕" for text in texts])
    for left in range(len(texts) - 1, -1, -1):
        chips.first.click()
        expect(chips).to_have_count(left)
    expect(page.locator("#count")).to_have_text("7 conflicts")
    expect(page.get_by_role("combobox", name="Object")).to_be_focused()
    page.go_back()
    expect(chips).to_have_text(["at the time shown ✕"])
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_table_is_that_of_the_command_line(
    conn: Conn,
    dsn: str,
    serve: Serve,
    open_page: Open,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Served and in a file."""
    box = shapely.box(9.0, 57.0, 9.1, 57.1)
    spans = {FORMULA: 3, HOSTILE: 1, "LINE\nBREAK": 2, 'QUOTE", "': 5}
    areas = [Area("PORT", box, name="+1")]
    areas += [
        Area(key, shapely.box(9.05, 57.0, 9.2, 57.1), start_us=T0_US + n * HOUR_US, end_us=T0_US + (n + 1) * HOUR_US)
        for key, n in spans.items()
    ]
    load(conn, Scene("s"), areas, [])
    detect(conn, "s", jobs=1)
    expected = runner(dsn, capsys)("conflicts", "--scene", "s", "--format", "csv").out
    assert runner(dsn, capsys)("map", "--scene", "s", "--html", tmp_path / "s.html").code == 0
    assert_table_is(open_page(serve(dsn, "s")), expected)
    assert_table_is(open_page((tmp_path / "s.html").as_uri()), expected)


def assert_table_is(page: Page, expected: str) -> None:
    """The same text; sorted by each column; only what the filter leaves; names that are formulas are texts."""

    def saved() -> str:
        with page.expect_download() as saving:
            page.get_by_role("button", name="Save as CSV").click()
        assert saving.value.suggested_filename == "s.csv"
        return Path(saving.value.path()).read_bytes().decode()

    page.get_by_role("button", name="Table", exact=True).click()
    table = page.locator("#table table")
    expect(table.locator("tbody tr")).to_have_count(4)
    assert saved() == expected
    header, *lines = csv.reader(io.StringIO(expected, newline=""))
    assert f"'{FORMULA}" in [line[header.index("a_key")] for line in lines]
    assert page.locator("img[src=x]").count() == 0
    orders = table.locator("thead th").evaluate_all(
        """(all) => all.map(({dataset: {column}}) => [1, 2, 3].map(() => {
            const header = () => document.querySelector(`#table th[data-column="${column}"]`);
            header().querySelector('button').click();
            return header().ariaSort;
        }))"""
    )
    assert len(orders) > 20
    assert orders == [["ascending", "descending", "none"]] * len(orders)
    table.locator('th[data-column="first_contact"] button').click()
    table.locator('th[data-column="first_contact"] button').click()
    _, *sorted_ = csv.reader(io.StringIO(saved(), newline=""))
    firsts = [line[header.index("first_contact")] for line in sorted_]
    assert firsts == sorted(firsts, reverse=True)
    page.get_by_role("combobox", name="Object").fill("quote")
    expect(table.locator("tbody tr")).to_have_count(1)
    assert len(list(csv.reader(io.StringIO(saved(), newline="")))) == 2
    page.get_by_role("combobox", name="Object").fill("nobody")
    expect(page.locator("#table")).to_contain_text("No conflict is left to show.")
    page.get_by_role("combobox", name="Object").fill("")
    wait_until(page, "location.hash.includes('table=1')")
    table.get_by_role("button", name=re.compile("HYPERLINK")).click()
    expect(page.locator("#table")).to_be_hidden()
    expect(page.locator("#detail").get_by_role("heading")).to_contain_text(FORMULA)
