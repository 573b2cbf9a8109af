"""The page of `conflictdb map` in a browser: its content, and its reactions to the user."""

import gzip
import math
import re
import time
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import psycopg
import pytest
import shapely
from browsing import Open, await_drawn, new_page, rows, states, time_of, wait_until
from commands import Run, runner
from map_page import Serve
from patience import until
from piecework import load
from playwright.sync_api import Browser, Locator, Page, Route, expect

import conflictdb
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track, rectangle_outline_m

AXE = Path(__file__).parent / "axe-core-4.14.1.min.js.gz"
Conn = psycopg.Connection[Any]
HOUR_US = 3_600_000_000
T0_US = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC
T0_S = T0_US / 1e6
HOSTILE = "<img src=x onerror=\"document.title='taken'\">"


def shown(page: Page, layer: str, where: str = "true") -> int:
    """Number of features with a given state in a layer of the map. The map takes states up with its next picture."""
    script = f"conflictdbPage.view.map.queryRenderedFeatures({{layers: ['{layer}']}})"
    return int(page.evaluate(f"new Set({script}.filter(({{state: s}}) => {where}).map(({{id}}) => id)).size"))


# Both move, then one, the soonest first.
ORDER = ["FERRY and TOW", "CABLE and SUB-1", "FIRING and FERRY", "DIVING and SUB-2", "DIVING and FERRY"]
ORDER += ["FIRING and SURVEY", "DIVING and FIRING"]


def test_scene_is_shown_and_explored(open_strait: Open) -> None:
    """The list, the map, the slider and play, a conflict from the list, the map and the timeline."""
    page = open_strait()
    expect(page).to_have_title("strait · conflictdb")
    assert rows(page) == ORDER
    assert (shown(page, "areas"), shown(page, "tracks")) == (4, 7)
    until(lambda: shown(page, "conflicts") >= 6)
    wait_until(page, "conflictdbPage.havens.shown.length >= 5")
    # It begins where the first conflict of the list is at its worst.
    expect(page.locator("#order")).to_have_text("Worst first")
    expect(page.locator("#clock")).to_have_text(re.compile("^09:4[5-8]:"))
    expect(page.locator("li.on .keys").first).to_have_text("FERRY and TOW")
    expect(page.locator("li.on .facts").first).to_contain_text("too close by 0.6 nmi")
    expect(page.locator("li.on .names").nth(1)).to_have_text("Cable works on the sea bed and Submarine haven, deep")

    slider = page.get_by_role("slider")
    places = "conflictdbPage.havens.shown.map(({track, x, y}) => [track.key, Math.round(x), Math.round(y)]).sort()"
    before = page.evaluate(places)
    slider.focus()
    for _ in range(10):
        slider.press("ArrowRight")
    wait_until(page, lambda: page.evaluate(places) != before)
    assert time_of(page) > T0_S + 7 * 3600 + 41 * 60
    slider.press("End")
    expect(page.locator("li.on")).to_have_count(0)
    await_drawn(page)
    until(lambda: shown(page, "conflicts", "s.on") == 0)
    slider.press("Home")
    start = time_of(page)
    page.locator("body").press("Space")
    wait_until(page, f"conflictdbPage.t > {start} + 60")
    expect(page.get_by_label("Pause")).to_be_visible()
    page.locator("body").press("Space")
    expect(page.get_by_label("Play")).to_be_visible()

    waiting: list[Route] = []
    page.route("**/api/pair*", lambda route: waiting.append(route))
    page.get_by_role("button", name="FERRY and TOW").click()
    detail = page.locator("#detail")
    expect(detail.get_by_role("heading")).to_have_text("FERRY and TOW")
    buttons = detail.locator("button")
    wait_until(page, "document.querySelectorAll('#detail dl').length === 1")
    at_once = [one.bounding_box() for one in buttons.all()]
    until(lambda: bool(waiting))
    waiting[0].continue_()
    page.unroute("**/api/pair*")
    expect(detail.locator("details")).to_contain_text("Decided by stage 4: their motion.")
    expect(detail.get_by_text("Decided by stage")).to_be_hidden()
    # What comes later moves nothing that may be pressed.
    assert len(at_once) >= 5
    assert [one.bounding_box() for one in buttons.all()] == at_once
    expect(detail).to_contain_text("1 Jun 2026 09:45:43 \N{EN DASH} 09:48:51")
    expect(detail).to_contain_text("Each end is right to within 0.019 µs.")
    expect(detail.locator(".card")).not_to_contain_text("within 0.019")
    expect(detail.locator("svg.plan path.plan-a, svg.plan path.plan-b")).to_have_count(2)
    expect(page.locator("#clock")).to_have_text("09:45:43")
    # The map is loaded: both havens are in view, and touch.
    rings = page.evaluate(
        "['FERRY', 'TOW'].map((key) => conflictdbPage.model.objects.get(key).motion.haven(conflictdbPage.t))"
    )
    assert shapely.distance(*map(shapely.Polygon, rings)) < 1e-6
    seen = "conflictdbPage.havens.shown.map(({track}) => track.key)"
    wait_until(page, lambda: {"FERRY", "TOW"} <= set(page.evaluate(seen)))
    assert page.evaluate("conflictdbPage.view.map.getZoom()") > 9
    await_drawn(page)
    until(lambda: shown(page, "conflicts", "s.chosen") == 1)
    page.keyboard.press("j")
    expect(detail.get_by_role("heading")).to_have_text("FIRING and SURVEY")
    expect(detail.get_by_role("table")).to_contain_text("3 periods")
    page.keyboard.press("Escape")
    expect(detail).to_be_hidden()
    expect(page.get_by_role("button", name="FIRING and SURVEY")).to_be_focused()

    bar = page.evaluate(
        "(() => { const box = document.getElementById('bars').getBoundingClientRect(); return [box.x, box.y]; })()"
    )
    page.mouse.click(bar[0] + page.evaluate("conflictdbPage.timeline.x(1780303200)"), bar[1] + 6)  # 08:40
    expect(detail.get_by_role("heading")).to_have_text("CABLE and SUB-1")
    page.keyboard.press("Escape")
    point = page.evaluate("""(() => {
        const map = conflictdbPage.view.map, box = map.getContainer().getBoundingClientRect();
        map.jumpTo({center: [9.5, 57.7512], zoom: 12});
        const {x, y} = map.project([9.5, 57.7512]);
        return [box.x + x, box.y + y];
    })()""")
    await_drawn(page)
    page.mouse.click(*point)
    expect(detail.get_by_role("heading")).to_have_text("FIRING and FERRY")


def test_filters_leave_what_they_say(open_strait: Open) -> None:
    page = open_strait()
    words = page.get_by_role("combobox", name="Object")
    words.fill("ferry")
    assert rows(page) == ["FERRY and TOW", "FIRING and FERRY", "DIVING and FERRY"]
    expect(page.locator("#headline")).to_have_text("3 of 7 conflicts, 1 now, none later")
    await_drawn(page)
    until(lambda: shown(page, "conflicts", "!s.hidden") == 3)
    page.get_by_text("Filter", exact=True).click()
    page.get_by_label("Above, m").fill("-5")
    page.get_by_label("Below, m").fill("0")
    assert rows(page) == ["FERRY and TOW", "FIRING and FERRY", "DIVING and FERRY"]
    page.get_by_label("Below, m").fill("-6")
    page.get_by_label("Above, m").fill("-1000")
    words.fill("")
    deep = rows(page)
    assert "CABLE and SUB-1" in deep
    page.get_by_label("Above, m").fill("1000")
    page.get_by_label("Below, m").fill("")
    assert "CABLE and SUB-1" not in rows(page)
    page.get_by_role("button", name="Clear").click()
    expect(page.locator(".row")).to_have_count(7)
    page.get_by_label("From (UTC)").fill("2026-06-01T09:30:00")
    assert "FIRING and FERRY" not in rows(page)
    assert "FERRY and TOW" in rows(page)
    page.get_by_label("To (UTC)").fill("2026-06-01T10:00:00")
    assert "FIRING and SURVEY" not in rows(page)
    page.get_by_role("button", name="Clear").click()
    page.get_by_label("conflict", exact=True).uncheck()
    expect(page.locator(".row")).to_have_count(0)
    page.get_by_role("button", name="Clear").click()
    page.get_by_label("at the time shown").check()
    assert rows(page) == ["FERRY and TOW", "CABLE and SUB-1", "DIVING and SUB-2", "DIVING and FIRING"]


def test_changes_and_acknowledgements_show_without_reload(
    strait: str, open_page: Open, conn: Conn, dsn: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    page = open_page(strait, size=(900, 1000))
    page.evaluate("globalThis.isSame = true")
    assert_regions_of_changed_objects_look_stale(page, conn, runner(dsn, capsys), open_page, tmp_path / "strait.html")
    page.get_by_role("button", name="Dismiss").click()
    conn.execute(
        "SELECT conflictdb.put_area('strait', %s, ST_MakeEnvelope(8.5, 57.7, 9.6, 58.0, 4326), '(,)')", [HOSTILE]
    )
    conn.commit()
    expect(page.locator("#state")).to_contain_text("5 areas")
    expect(page.locator("#state")).to_contain_text("waits")
    assert runner(dsn, capsys)("detect", "--scene", "strait").code == 0
    expect(page.locator("#count")).not_to_have_text("7 conflicts")
    expect(page.locator("#state")).not_to_contain_text("waits")
    # Keys are texts, whatever they say.
    row = page.locator(".row", has_text=f"{HOSTILE} and SURVEY")
    expect(row).to_be_visible()
    row.click()
    expect(page.locator("#detail").get_by_role("heading")).to_have_text(f"{HOSTILE} and SURVEY")
    assert page.locator("img[src=x]").count() == 0
    expect(page).to_have_title("strait · conflictdb")

    page.get_by_label("Acknowledge, because").fill(HOSTILE)
    page.get_by_role("button", name="Acknowledge").click()
    expect(page.locator("#detail")).to_contain_text(f": {HOSTILE}")
    query = "SELECT acknowledged_for FROM conflictdb.conflicts WHERE acknowledged_by IS NOT NULL"
    known = conn.execute(query).fetchall()
    assert known == [(HOSTILE,)]
    page.get_by_role("button", name="All conflicts").click()
    expect(page.locator(".tag", has_text="acknowledged")).to_have_count(1)
    row.click()
    page.get_by_role("button", name="Take back").click()
    expect(page.get_by_label("Acknowledge, because")).to_be_visible()
    page.get_by_role("button", name="All conflicts").click()
    expect(page.locator(".tag", has_text="acknowledged")).to_have_count(0)
    # By another user, in another session.
    conn.execute("SELECT conflictdb.acknowledge('strait', 'FERRY', 'TOW', 'seen')")
    conn.commit()
    expect(page.locator(".tag", has_text="acknowledged")).to_have_count(1)
    # In a narrow list tags have a line of their own: names keep theirs.
    was = page.viewport_size
    page.set_viewport_size({"width": 820, "height": 900})
    apart = """() => [...document.querySelectorAll('.row:has(.tag)')].map((row) => {
        const boxOf = (what) => row.querySelector(what).getBoundingClientRect();
        const [names, tags] = ['.names', '.tags'].map(boxOf);
        return tags.top >= names.bottom - 1 && names.right > row.getBoundingClientRect().right - 20;
    })"""
    wait_until(page, f"JSON.stringify(({apart})()) === '[true]'")
    assert was is not None
    page.set_viewport_size(was)
    conn.execute("SELECT conflictdb.unacknowledge('strait', 'FERRY', 'TOW')")
    conn.commit()
    expect(page.locator(".tag", has_text="acknowledged")).to_have_count(0)
    assert page.locator("img[src=x]").count() == 0
    page.get_by_role("button", name="Dismiss").click()
    assert_a_bar_says_what_changed(page, conn, dsn)
    assert page.evaluate("isSame") is True


def assert_regions_of_changed_objects_look_stale(page: Page, conn: Conn, run: Run, open_page: Open, file: Path) -> None:
    """Hatched, with a note, until they are detected again, in a file too; others look as before."""
    note = page.locator("#stale")
    expect(note).to_be_hidden()
    assert states(page, "stale-conflicts") == {}
    moved = "SELECT conflictdb.put_area('strait', 'DIVING', footprint, '(,)') FROM conflictdb.area WHERE key = 'DIVING'"
    conn.execute(moved.encode())
    conn.commit()
    expect(note).to_contain_text("3 conflicts (hatched) are of objects that changed since")
    stale = {"DIVING and FERRY", "DIVING and FIRING", "DIVING and SUB-2"}
    wait_until(page, lambda: set(states(page, "stale-conflicts")) == stale)  # the note comes before the new tiles
    assert set(states(page, "stale-conflicts-edge")) == stale
    assert set(states(page, "stale-first-contacts")) == stale
    assert not stale & set(states(page, "conflicts", "conflicts-edge", "first-contacts"))
    assert "CABLE and SUB-1" in states(page, "conflicts")
    page.get_by_role("button", name="DIVING and SUB-2").click()
    expect(page.locator("#detail")).to_contain_text("one of them has changed since")
    assert states(page, "stale-conflicts")["DIVING and SUB-2"]["chosen"]
    page.keyboard.press("Escape")
    assert run("map", "--html", file).code == 0
    assert_a_file_shows_what_is_stale(open_page(file.as_uri(), offline=True))
    assert run("detect", "--scene", "strait").code == 0
    expect(note).to_be_hidden()
    wait_until(page, lambda: states(page, "stale-conflicts") == {})


def assert_a_file_shows_what_is_stale(page: Page) -> None:
    expect(page.locator("#stale")).to_contain_text("3 conflicts")
    await_drawn(page)
    count = (
        "(layer) => new Set(conflictdbPage.view.map.queryRenderedFeatures({layers: [layer]}).map(({id}) => id)).size"
    )
    assert page.evaluate(count, "stale-conflicts") == 3
    assert page.evaluate(count, "conflicts") >= 3
    assert page.evaluate("conflictdbPage.model.conflicts.filter((c) => !c.is_current).length") == 3


def assert_a_bar_says_what_changed(page: Page, conn: Conn, dsn: str) -> None:
    """Since the page was opened, or since that was dismissed; it shows the changes alone."""
    bar = page.locator("#changes")
    expect(bar).to_be_hidden()
    conn.execute("SELECT conflictdb.remove_object('strait', 'CABLE')")
    conn.commit()
    expect(page.locator("#state")).to_contain_text("4 areas")
    expect(bar).to_be_hidden()  # until a detection knows
    another = "SELECT conflictdb.put_area('strait', 'ANOTHER', ST_MakeEnvelope(8.5, 57.7, 9.6, 58.0, 4326), '(,)')"
    conn.execute(another)
    conn.commit()
    expect(page.locator("#state")).to_contain_text("5 areas")
    with conflictdb.connect(dsn) as db:
        db.scene("strait").detect()
    expect(page.locator("#changed")).to_contain_text(re.compile(r"^2 objects changed: [1-9]\d* new, 3 gone$"))
    page.get_by_role("button", name="Show", exact=True).click()
    assert page.locator(".tag.gone").all_inner_texts() == ["gone"] * 3
    assert "CABLE and SUB-1" in rows(page)
    assert len(rows(page)) == page.locator(".tag.new").count() + 3
    expect(page.locator("#count")).to_have_text(f"{len(rows(page))} changes")
    page.locator(".row", has_text="CABLE and SUB-1").click()  # its place in time; nothing more is known
    expect(page.locator("#detail")).to_be_hidden()
    expect(page.locator("#clock")).to_have_text("07:41:56")
    page.locator(".row", has=page.locator(".new")).first.click()
    expect(page.locator("#detail")).to_contain_text("Decided by stage")
    page.get_by_role("button", name="Show all", exact=True).click()
    expect(page.locator("#detail")).to_be_hidden()
    expect(page.locator(".tag.new, .tag.gone")).to_have_count(0)
    page.get_by_role("button", name="Dismiss").click()
    expect(bar).to_be_hidden()
    conn.execute("SELECT conflictdb.acknowledge('strait', 'FIRING', 'SURVEY', 'seen')")
    conn.commit()
    expect(page.locator(".tag", has_text="acknowledged")).to_have_count(1)
    expect(bar).to_be_hidden()
    conn.execute(
        """UPDATE conflictdb.track AS t SET path = (
               SELECT ST_MakeLine(
                   ST_SetSRID(ST_MakePointM(ST_X(p.geom), ST_Y(p.geom), ST_M(p.geom) + 600), 4326) ORDER BY p.path)
               FROM ST_DumpPoints(t.path) AS p
           ) WHERE key = 'FERRY'"""
    )
    conn.commit()
    expect(page.locator("#state")).to_contain_text("waits")
    with conflictdb.connect(dsn) as db:
        db.scene("strait").detect()
    expect(page.locator("#changed")).to_contain_text(re.compile(r"^FERRY moved: 0 new, \d gone, \d at another time$"))


def test_a_change_while_the_page_opens_is_seen_and_the_end_of_the_scene(
    strait: str, browser: Browser, conn: Conn, dsn: str
) -> None:
    """The scene changes after the page has read it and before it listens; the page makes each first request once.

    What nobody refuses is kept. A scene that is deleted is one sentence, without the names of other scenes.
    """
    load(conn, Scene("confidential"), [], [])
    conn.commit()
    asked: list[str] = []

    def changed(route: Route) -> None:
        with conflictdb.connect(dsn) as db:
            db.scene("strait").delete_objects("TOW")
        time.sleep(1.0)  # the server has heard of it
        asked.append("events")
        route.continue_()

    with new_page(browser) as page:
        page.on("request", lambda request: asked.append(urlsplit(request.url).path))
        page.route("**/api/events*", changed)
        page.goto(strait)
        expect(page.locator("#state")).to_contain_text("4 areas · 6 tracks")
        first = asked[: asked.index("events")]
        for path in ("/api/scene", "/api/conflicts", "/api/areas", "/api/tracks", "/page/kernel.wasm"):
            assert first.count(path) == 1
        assert first.index("/api/tracks") < first.index("/api/depths")
        page.wait_for_selector("html[data-ready=true]", state="attached")
        brief = brief_that_follows_the_scene(page, conn)
        assert_kept_where_nobody_refuses_the_scene(page, conn)
        expect(brief).to_be_hidden()
        expect(brief).to_be_empty()
        conn.execute("DELETE FROM conflictdb.scene WHERE name = 'strait'")
        conn.commit()
        expect(page.locator("#list p")).to_have_text(
            "The scene is no longer shown: it was deleted, renamed or unshared."
        )
        expect(page.locator("#state")).to_have_text("it was deleted, renamed or unshared")
        page.evaluate("document.getElementById('scenes').remove()")  # where the reader's scenes are chosen
        assert "confidential" not in page.content()


def brief_that_follows_the_scene(page: Page, conn: Conn) -> Locator:
    """Open the brief of an object; somebody else acknowledges one of its conflicts."""
    page.locator(".row", has_text="SUB-1").first.click()
    page.get_by_role("button", name="Brief of SUB-1").click()
    brief = page.locator("#brief")
    expect(brief).to_contain_text("not acknowledged")
    pairs = page.evaluate("conflictdbPage.model.conflicts.map(({a, b}) => [a, b])")
    for pair in (pair for pair in pairs if "SUB-1" in pair):
        conn.execute("SELECT conflictdb.acknowledge('strait', %s, %s, 'agreed by radio')", pair)
    conn.commit()
    expect(brief).to_contain_text("agreed by radio")
    expect(brief).not_to_contain_text("not acknowledged")
    page.locator(".back").click()
    return brief


def assert_kept_where_nobody_refuses_the_scene(page: Page, conn: Conn) -> None:
    """A server, or a proxy before it, that has had too much says so, and the scene is still there."""
    for status, key, left in [(429, "CABLE", 7), (503, "DIVING", 7), (400, "FIRING", 0)]:
        body = f'{{"error": "answer {status}"}}'
        page.route("**/api/conflicts", partial(Route.fulfill, status=status, body=body))
        conn.execute("SELECT conflictdb.remove_object('strait', %s)", [key])
        conn.commit()
        expect(page.locator("#state")).to_have_text(f"answer {status}")
        expect(page.locator(".row")).to_have_count(left)
    page.unroute("**/api/conflicts")


def test_times_are_written_with_24_hours_wherever_one_is(open_strait: Open) -> None:
    """In UTC, as everything else that the page says: not with am and pm in the time of the browser's own country."""
    page = open_strait()
    assert page.evaluate("[navigator.language, new Date(0).getHours()]") == ["en-US", 19]
    page.get_by_text("Filter", exact=True).click()
    since, until = page.get_by_label("From (UTC)"), page.get_by_label("To (UTC)")
    since.press_sequentially("2026-06-01 09:30")
    until.fill("2026-06-01 13:00:30")
    page.keyboard.press("Tab")
    span = page.evaluate("[document.getElementById('from'), document.getElementById('to')].map(({value}) => value)")
    assert span == ["2026-06-01 09:30", "2026-06-01 13:00:30"]
    found = page.evaluate("conflictdbPage.filter.from"), page.evaluate("conflictdbPage.filter.to")
    assert found == (T0_S + 9.5 * 3600, T0_S + 13 * 3600 + 30)
    left = rows(page)
    assert 0 < len(left) < 7
    said = page.locator("body").inner_text()
    assert not re.search(r"\b\d{1,2}(:\d\d)+ ?[AP]M\b", said, re.IGNORECASE)
    # An invalid entry is reported when it was typed, and sets no limit.
    since.fill("06/01/2026 1:30 PM")
    page.keyboard.press("Tab")
    expect(page.get_by_role("alert").filter(has_text="A time is written as 2026-06-01 09:30")).to_be_visible()
    expect(since).to_have_attribute("aria-invalid", "true")
    for none in ["2026-02-30 10:00", "2026-06-01 24:30", "2026-06-01 10:60", "2026-06-01"]:
        since.fill(none)
        assert page.evaluate("conflictdbPage.filter.from") == -math.inf, none
    since.fill("2026-06-01T09:30:00Z")
    page.keyboard.press("Tab")
    expect(since).to_have_attribute("aria-invalid", "false")
    expect(page.locator("#instants")).to_have_text("")
    assert rows(page) == left


def test_a_scene_that_is_no_longer_shared_goes_from_the_page(
    conn: Conn, dsn: str, serve: Serve, browser: Browser
) -> None:
    """Soon, without another change: objects, conflicts and the open conflict; it is back when shared again."""
    guest = f"guest_{conn.info.dbname}"
    with conflictdb.connect(dsn) as db:
        db.load_demo()
        db.scene("strait").detect()
    conn.execute(f"CREATE ROLE {guest} LOGIN IN ROLE conflictdb_reader".encode())
    conn.execute("SELECT conflictdb.protect_scenes()")
    conn.execute("SELECT conflictdb.share_scene('strait', %s)", [guest])
    conn.commit()
    try:
        page = new_page(browser)
        page.goto(serve(psycopg.conninfo.make_conninfo(dsn, options=f"-c role={guest}"), "strait"))
        page.wait_for_selector("html[data-ready=true]", state="attached")
        page.get_by_role("button", name="FERRY and TOW").click()
        expect(page.locator("#detail")).to_contain_text("Decided by stage 4: their motion.")
        wait_until(page, "conflictdbPage.havens.shown.length > 0")
        await_drawn(page)
        before = [shown(page, layer) for layer in ("areas", "tracks", "conflicts")]
        assert min(before) > 0
        conn.execute("SELECT conflictdb.unshare_scene('strait', %s)", [guest])
        conn.commit()
        expect(page.locator("#list")).to_contain_text("The scene is no longer shown: ")
        expect(page.locator("#state")).to_have_class(re.compile("lost"))
        await_drawn(page)
        assert [shown(page, layer) for layer in ("areas", "tracks", "conflicts", "first-contacts")] == [0, 0, 0, 0]
        assert page.evaluate("conflictdbPage.havens.shown.length") == 0
        assert page.evaluate("conflictdbPage.timeline.bars.length") == 0
        left = page.evaluate("document.body.textContent")
        assert [key for key in ("FERRY", "TOW", "CABLE", "SURVEY") if key in left] == []
        conn.execute("SELECT conflictdb.share_scene('strait', %s)", [guest])
        conn.commit()
        expect(page.locator(".row")).to_have_count(7)
        until(lambda: [shown(page, layer) for layer in ("areas", "tracks", "conflicts")] == before)
        expect(page.locator("#state")).to_contain_text("4 areas")
    finally:
        page.close()
        conn.rollback()
        conn.execute("SELECT conflictdb.protect_scenes(false)")
        conn.execute(f"DROP OWNED BY {guest}".encode())
        conn.commit()


def tracks_of_all_kinds() -> list[Track]:
    """A track for each way in which a haven moves and changes; on rhumb lines and on great circles."""
    box = rectangle_outline_m(3000, 1000, 500, 800)
    wide = rectangle_outline_m(9000, 8000, 7000, 6000)

    def hours(*at: float) -> np.ndarray:
        return np.array([T0_US + int(h * HOUR_US) for h in at])

    loiter = [(10.0, 50.0), (10.0, 50.0), (11.0, 50.5), (11.0, 50.5)]
    return [
        Track("STRAIGHT", [(0.0, 40.0), (8.0, 48.0)], hours(0, 20), box),
        Track("EAST", [(0.0, 45.0), (9.0, 45.0)], hours(1, 9), box),
        Track("LOITER", loiter, hours(0, 5, 10, 20), box),
        Track("GROWS", [(5.0, 44.0), (6.0, 46.0)], hours(0, 20), box, grow_mps=0.05),
        Track("CHANGES", [(5.0, 50.0), (6.0, 51.0), (4.0, 52.0)], hours(0, 10, 20), box, outlines_m=[box, wide, box]),
    ]


def test_havens_are_where_the_database_has_them(conn: Conn, dsn: str, serve: Serve, browser: Browser) -> None:
    """The page computes them itself, so that any instant is shown at once: within a millimetre of conflictdb.havens."""
    scenes = [
        Scene("rhumb"),
        Scene("sphere", earth=EarthModel.SPHERE),
        Scene("great circle", motion=Motion.GREAT_CIRCLE, earth=EarthModel.SPHERE, centre=(5.0, 47.0)),
    ]
    for scene in scenes:
        tracks = tracks_of_all_kinds()
        if scene.motion == Motion.RHUMB:
            tracks.append(Track("SEAM", [(179.0, 10.0), (-179.0, 12.0)], tracks[0].times_us, tracks[0].outline_m))
            tracks.append(Track("POLE", [(20.0, 86.0), (80.0, 88.5)], tracks[0].times_us, tracks[0].outline_m))
        load(conn, scene, [], tracks)
    conn.commit()
    query = (
        "SELECT key, extract(epoch FROM at)::double precision, ST_AsText(haven, 12) "
        "FROM conflictdb.havens(%s, to_timestamp(%s), to_timestamp(%s), '97 minutes')"
    )
    # Each scene as the page reads another one, to compare with it; its modules alone, without the page.
    script = """async ([name, all]) => {
        const modules = ['source', 'model', 'motion', 'pair_distance'].map((one) => import(`/page/${one}.js`));
        const [{ServerSource}, {Model}, {Ground}, {kernelOf}] = await Promise.all(modules);
        const source = new ServerSource(name), scene = await source.scene();
        const model = new Model({...scene, ground: Ground.of(await kernelOf(source)(), scene.plane)});
        model.takeObjects(await source.areas(), await source.tracks(), null);
        return all.map(([key, t]) => model.objects.get(key).motion.haven(t));
    }"""
    answers = [conn.execute(query.encode(), [one.name, T0_S, T0_S + 20 * 3600]).fetchall() for one in scenes]
    with new_page(browser) as page:
        page.goto(f"{serve(dsn, 'rhumb')}nothing")
        asked = [[scene.name, [one[:2] for one in known]] for scene, known in zip(scenes, answers, strict=True)]
        rings = [page.evaluate(script, one) for one in asked]
    for scene, known, found in zip(scenes, answers, rings, strict=True):
        assert len(known) > 50
        for (key, t, text), ring in zip(known, found, strict=True):
            there = shapely.from_wkt(text)
            places = shapely.get_coordinates(there)
            here = np.array(ring)
            if key == "SEAM" and there.geom_type == "MultiPolygon":
                continue  # cut there, so that it has other corners
            turned = (here[:, 0] - places[0, 0] + 180) % 360 - 180 + places[0, 0]
            far = np.hypot((turned - places[:, 0]) * math.cos(math.radians(here[0, 1])), here[:, 1] - places[:, 1])
            assert np.max(far) * 111_000 < 1e-3, (scene.name, key, t)


def test_plans_that_recur_are_there_each_time(conn: Conn, dsn: str, serve: Serve, open_page: Open) -> None:
    """All voyages move, all activations are named, and nothing is there between two of them."""
    day_us = 24 * HOUR_US
    at_us = [T0_US + days * day_us for days in (0, 1, 4)]
    box = rectangle_outline_m(3000, 3000, 1000, 1000)
    ferry = Track(
        "FERRY", [(8.0, 40.0), (8.0, 40.5)], np.array([T0_US, T0_US + 2 * HOUR_US]), box, grow_mps=0.05,
        departures_us=np.array(at_us, "datetime64[us]"),
    )  # fmt: skip
    spans = [(us + HOUR_US, us + 3 * HOUR_US) for us in at_us[:2]]
    load(conn, Scene("s"), [Area("RANGE", shapely.box(7.9, 40.2, 8.1, 40.4), spans_us=spans)], [ferry])
    detect(conn, "s", jobs=1)
    query = "SELECT ST_AsText(haven, 12) FROM conflictdb.haven_at('s', 'FERRY', to_timestamp(%s)) haven"
    page = open_page(serve(dsn, "s"))
    expect(page.locator("#count")).to_have_text("1 conflict")
    for hours, ferry_is_there, range_is_there in [
        (0.5, True, False), (1.5, True, True), (2.5, False, True), (12.0, False, False), (25.5, True, True),
        (29.0, False, False), (96.5, True, False), (97.5, True, False),
    ]:  # fmt: skip
        t = T0_S + 3600 * hours
        page.evaluate(f"conflictdbPage.moveTo({t})")
        ((text,),) = conn.execute(query, [t]).fetchall() or [(None,)]
        ring = page.evaluate(f"conflictdbPage.model.objects.get('FERRY').motion.haven({t})")
        assert (ring is not None, text is not None) == (ferry_is_there, ferry_is_there), hours
        if text is not None:
            assert np.array(ring) == pytest.approx(shapely.get_coordinates(shapely.from_wkt(text)), abs=1e-8)
        page.wait_for_function("conflictdbPage.havens.t === conflictdbPage.t")
        seen = page.evaluate("(conflictdbPage.havens.draw(), conflictdbPage.havens.shown.map(({track}) => track.key))")
        assert seen == ["FERRY"] * ferry_is_there, hours
        there = page.evaluate(
            "['RANGE', 'FERRY'].map((key) => conflictdbPage.flags()(conflictdbPage.model.objects.get(key)).on)"
        )
        assert there == [range_is_there, ferry_is_there], hours
    # A filter by time leaves what is there then.
    page.evaluate(f"conflictdbPage.filter.to = conflictdbPage.filter.from = {T0_S + 12 * 3600}")
    leaves = page.evaluate(
        "[...conflictdbPage.model.objects.values()].map((one) => conflictdbPage.filter.leavesObject(one))"
    )
    assert leaves == [False, False]


SIZES = [(1440, 900, "light"), (820, 1180, "light"), (768, 1024, "dark"), (390, 844, "light")]


@pytest.mark.slow
def test_nothing_overlaps_and_nobody_is_left_out(strait: str, open_page: Open) -> None:
    """At three sizes, in both colours: nothing is cut off, controls are apart, and axe finds nothing serious."""
    axe = gzip.decompress(AXE.read_bytes()).decode()
    for *size, scheme in SIZES:
        page = open_page(strait, size=tuple(size), color_scheme=scheme)
        for step in ("list", "detail"):
            if step == "detail":
                page.locator(".row").nth(1).click()
                expect(page.locator("svg.plan")).to_be_visible()
            assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
            assert page.evaluate("document.documentElement.scrollHeight") <= size[1]
            boxes = page.evaluate("""[...document.querySelectorAll(
                'h1, #headline, #state, .actions > *, #words, #more > summary, .controls > *, #rows, #slider, #map,'
                + ' .detail > *, .side li'
            )].filter((one) => one.checkVisibility() && !one.closest('[hidden]')).map((one) => {
                const {x, y, width, height} = one.getBoundingClientRect();
                return [one.id || one.className || one.tagName, x, y, x + width, y + height];
            })""")
            inside = [box for box in boxes if box[0] not in ("map",)]
            for n, (name, x0, y0, x1, y1) in enumerate(inside):
                assert x0 >= -0.5, name
                assert x1 <= size[0] + 0.5, (name, size)
                for other, u0, v0, u1, v1 in inside[:n]:
                    is_apart = x1 <= u0 + 0.5 or u1 <= x0 + 0.5 or y1 <= v0 + 0.5 or v1 <= y0 + 0.5
                    is_scrolled = "LI" in (name, other) or min(y1, v1) > size[1]
                    assert is_apart or is_scrolled, (size, step, name, other)
            page.evaluate(axe)
            found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
            serious = [one for one in found if one["impact"] in ("serious", "critical")]
            assert [(one["id"], [node["html"][:120] for node in one["nodes"]]) for one in serious] == []


def test_file_needs_nothing_else(open_strait: Open) -> None:
    """The page in one file, without a server and without the network."""
    page = open_strait(of="file")
    assert Path(urlsplit(page.url).path).stat().st_size < 3e6
    assert rows(page) == ORDER
    expect(page.locator("#state")).to_contain_text("changes since are not in this file")
    await_drawn(page)
    assert (shown(page, "areas"), shown(page, "tracks")) == (4, 7)
    until(lambda: shown(page, "conflicts") >= 6)
    until(lambda: shown(page, "near-land") >= 1)
    expect(page.locator("#coming")).to_be_hidden()
    page.get_by_role("button", name="FIRING and FERRY").click()
    expect(page.locator("#detail details")).to_contain_text("Decided by stage 4: their motion.")
    expect(page.locator("svg.plan path.plan-a")).to_have_count(1)
    expect(page.locator("#detail .acknowledge")).to_have_count(0)
    await_drawn(page)
    until(lambda: shown(page, "conflicts", "s.chosen") == 1)
    until(lambda: shown(page, "first-contacts", "s.chosen") == 1)
