"""The page of `conflictdb map` in a browser: what a track would meet that departs at another time."""

import gzip
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
from browsing import Open, rows, wait_until
from layouts import HARBOUR
from map_page import Serve
from mixed_scenes import plain_scene
from piecework import load
from playwright.sync_api import Page, Route, expect

import conflictdb
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Scene, Track, rectangle_outline_m

AXE = Path(__file__).parent / "axe-core-4.14.1.min.js.gz"
Conn = psycopg.Connection[Any]
COPIES = {"permissions": ["clipboard-read", "clipboard-write"]}
HOUR_US = 3_600_000_000
T0_US = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC
LEAST_PICTURES_PER_S = 30.0
# Drags for two seconds, a step with each picture, and counts pictures.
PACE = """async () => {
    const slider = document.querySelector('.what-if input');
    const next = () => new Promise((shown) => requestAnimationFrame(shown));
    await next();
    const begun = performance.now();
    let [n, worked] = [0, 0];
    for (; performance.now() - begun < 2000; n += 1) {
        slider.value = Math.sin(n / 20) * 1800;
        const before = performance.now();
        slider.dispatchEvent(new Event('input', {bubbles: true}));
        worked += performance.now() - before;
        await next();
    }
    return [1000 * n / (performance.now() - begun), worked / n];
}"""


def ask(page: Page, conflict: str, key: str) -> None:
    page.get_by_role("button", name=conflict).click()
    page.get_by_role("button", name=f"What if {key} departs earlier or later").click()


def said(page: Page, text: str) -> None:
    """Wait for the text; answers about earlier places of a waypoint, which may read the same, have come.

    The text of a plan that departs at another time follows its clock time.
    """
    wait_until(page, "!conflictdbPage.departure.isProbing && !conflictdbPage.areaMove.isProbing")
    expect(page.locator(".what-if .said")).to_have_text(re.compile(f"^(Departs [0-9:]+, )?{re.escape(text)}$"))


def copied(page: Page, what: str) -> str:
    page.get_by_role("button", name=f"Copy as {what}").click()
    expect(page.locator(".what-if")).to_contain_text(f"Copied as {what}")
    return str(page.evaluate("navigator.clipboard.readText()"))


def test_plans_are_moved_in_height_elsewhere_and_in_time(strait: str, conn: Conn, dsn: str, open_page: Open) -> None:
    """One after the other on one page: those before the last one leave the scene as it was."""
    with conflictdb.connect(dsn) as db:
        branch = db.scene("strait").branch("less")
        branch.delete_objects("DIVING")
        branch.detect()
    page = open_page(f"{strait}#scene=less", size=(1440, 900), **COPIES)
    assert_a_waypoint_is_dragged_in_a_branch(page, dsn)
    page.goto(strait)
    page.wait_for_selector("html[data-ready=true]", state="attached")
    assert_a_plan_is_moved_in_height_proposed_applied_and_undone(page, conn, dsn)
    leave(page)
    assert_a_waypoint_is_dragged_with_its_conflicts_at_once(page, conn, dsn)
    leave(page)
    assert_an_area_is_moved_and_ends_sooner(page, dsn)
    leave(page)
    assert_a_moved_track_shows_what_goes_and_what_comes(page, conn, dsn)


def leave(page: Page) -> None:
    page.keyboard.press("Escape")
    page.get_by_role("combobox", name="Object").fill("")


def assert_a_moved_track_shows_what_goes_and_what_comes(page: Page, conn: Conn, dsn: str) -> None:
    """By keys and by the strip; the copied SQL moves the track, and a detection finds what the page showed."""
    ask(page, "FERRY and TOW", "FERRY")
    said(page, "As planned: 3 conflicts.")
    range_ = page.get_by_role("combobox", name="Range")
    expect(range_).to_have_value("10800")  # within an hour no departure is clear
    range_.select_option("3600")
    expect(page.get_by_role("button", name="none earlier")).to_be_disabled()
    slider = page.get_by_role("slider", name="Departure")
    for _ in range(4):
        slider.press("PageUp")
    said(page, "10 min later: 1 fewer, none new; 2 in all.")
    expect(page.locator(".what-if .said")).to_contain_text("Departs 07:25, ")
    expect(page.locator("li.gone .keys")).to_have_text("FERRY and TOW")
    moved = page.locator("li", has_text="FIRING and FERRY").locator(".facts")
    expect(moved).to_contain_text("08:21:17 \N{EN DASH} 09:17:24, was 08:11:17 \N{EN DASH} 09:07:24")
    # Both keep the colours that they had as a pair, and the map shows where the ferry would be.
    assert page.evaluate("conflictdbPage.havens.marks.pair") == ["FERRY", "TOW"]
    ghost = "conflictdbPage.model.objects.get('FERRY').motion.haven(conflictdbPage.t - 600)"
    wait_until(page, f"conflictdbPage.view.holds({ghost})")
    assert page.evaluate("conflictdbPage.havens.plan.laterUs") == 600_000_000
    range_.select_option("10800")
    said(page, "10 min later: 1 fewer, none new; 2 in all.")
    page.get_by_text("What forbids which departures").click()
    expect(page.locator(".what-if ol")).to_contain_text("DIVING, FIRING")
    # Departures that are clear are those of `delays` (docs/how-to/find-a-free-departure.md).
    # They are at whole minutes of the clock, outward, and say their margin; one may be asked for.
    page.get_by_role("button", name="Clear 1 h 8 min earlier: departs 06:07").click()
    expect(page.locator(".what-if .said")).to_have_text(
        "Departs 06:07, 1 h 8 min earlier: 3 fewer, none new; clear by 36 s."
    )
    margin = page.get_by_label("Margin")
    margin.select_option(label="margin 5 min")
    page.get_by_role("button", name="Clear 1 h 13 min earlier: departs 06:02").click()
    said(page, "1 h 13 min earlier: 3 fewer, none new; clear by 5 min 36 s.")
    assert_a_margin_in_distance_is_that_of_delays(page, dsn)
    margin.select_option(label="no margin")
    page.get_by_role("button", name="Clear 1 h 8 min earlier: departs 06:07").click()
    assert page.evaluate("conflictdbPage.havens.plan.laterUs") == -4_080_000_000
    page.locator(".what-if canvas").scroll_into_view_if_needed()
    box = page.locator(".what-if canvas").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 10 + (box["width"] - 20) * 0.75, box["y"] + 10)
    by_us = int(page.evaluate("conflictdbPage.havens.plan.laterUs"))
    assert abs(by_us - 1.5 * HOUR_US) < 0.02 * HOUR_US
    shown = dict(zip(rows(page), page.locator(".row .when").all_text_contents(), strict=True))
    gone = page.locator("li.gone .keys").all_text_contents()
    feature = json.loads(copied(page, "GeoJSON"))
    assert feature["id"] == "FERRY"
    conn.execute(copied(page, "SQL").encode())
    conn.commit()
    with conflictdb.connect(dsn) as db:
        scene = db.scene("strait")
        scene.detect()
        found = {f"{one.a_key} and {one.b_key}": one for one in scene.conflicts() if "FERRY" in (one.a_key, one.b_key)}
        _, _, [track] = scene._read(["FERRY"])
    assert set(found) == set(shown) - set(gone)
    for pair, one in found.items():
        assert one.periods[0][0] is not None
        assert f"{one.periods[0][0]:%H:%M:%S}" == shown[pair]
    times = [at.removesuffix("Z") for at in feature["properties"]["times"]]
    moved_us = np.array(times, "datetime64[us]").astype(np.int64)
    assert np.abs(moved_us - track.times_us).max() <= 1  # the database has seconds, as doubles


def assert_a_margin_in_distance_is_that_of_delays(page: Page, dsn: str) -> None:
    """Pieces are read again, which reach farther; the chosen margin stays in other units."""
    with conflictdb.connect(dsn) as db:
        [found] = db.scene("strait").delays("FERRY", within_s=10_800.0, margin_m=1852.0)
    assert found.least_earlier_s is not None
    assert 70 * 60 < found.least_earlier_s < 71 * 60
    margin = page.get_by_label("Margin")
    margin.select_option(label="margin 1 nmi")
    button = page.get_by_role("button", name="Clear 1 h 11 min earlier: departs 06:04")
    page.get_by_role("slider", name="Departure").fill(str(-70 * 60))
    said(page, "1 h 10 min earlier: 3 fewer, none new; clear, not by 1 nmi (FIRING).")
    page.locator("#menu summary").click()
    page.get_by_label("Units").select_option("metric")
    said(page, "1 h 10 min earlier: 3 fewer, none new; clear, not by 1852 m (FIRING).")
    expect(margin.locator("option:checked")).to_have_text("margin 1852 m")
    page.get_by_label("Units").select_option("nautical")
    button.click()
    said(page, "1 h 11 min earlier: 3 fewer, none new; clear by 1 nmi.")


def conflicts_of(dsn: str, scene: str, key: str) -> list[str]:
    with conflictdb.connect(dsn) as db:
        db.scene(scene).detect()
        every = db.scene(scene).conflicts()
    return sorted(f"{one.a_key} and {one.b_key}" for one in every if key in (one.a_key, one.b_key))


def assert_a_plan_is_moved_in_height_proposed_applied_and_undone(page: Page, conn: Conn, dsn: str) -> None:
    """In a branch, in the scene, and back to the bit; what is stored has the conflicts that the page showed."""
    shape = "SELECT encode(ST_AsBinary(path), 'hex'), floor_m, ceiling_m FROM conflictdb.track WHERE key = 'SUB-2'"
    before = conn.execute(shape).fetchall()
    conn.rollback()
    ask(page, "DIVING and SUB-2", "SUB-2")
    said(page, "As planned: 1 conflict.")
    expect(page.get_by_role("button", name="Apply")).to_be_hidden()
    height = page.get_by_role("slider", name="Height")
    height.fill("-20")
    said(page, "20 m lower: none fewer, 1 new; 2 in all.")
    height.fill("-40")
    said(page, "40 m lower: 1 fewer, 2 new; 2 in all.")
    page.get_by_role("slider", name="Departure").press("ArrowRight")
    expect(page.locator(".what-if .said")).to_contain_text("45 s later, 40 m lower: 1 fewer, 2 new")
    page.evaluate(gzip.decompress(AXE.read_bytes()).decode())
    violations = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
    assert [(one["id"], one["nodes"][0]["html"]) for one in violations] == []
    shown = sorted(set(rows(page)) - set(page.locator("li.gone .keys").all_text_contents()))
    assert shown == ["CABLE and SUB-2", "SUB-1 and SUB-2"]
    assert "floor_m = floor_m + -40" in copied(page, "SQL")
    page.get_by_role("button", name="Propose").click()
    branch = "strait: SUB-2 45 s later, 40 m lower"
    expect(page.locator(".what-if")).to_contain_text(f"Proposed as the branch {branch}.")
    assert conflicts_of(dsn, branch, "SUB-2") == shown
    page.get_by_role("button", name="Apply").click()
    expect(page.locator(".what-if")).to_contain_text("Applied: 45 s later, 40 m lower.")
    said(page, "As planned: 2 conflicts.")
    assert conflicts_of(dsn, "strait", "SUB-2") == shown
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".what-if")).to_contain_text("Undone.")
    said(page, "As planned: 1 conflict.")
    own = f"{shape} AND scene_id = (SELECT scene_id FROM conflictdb.scene WHERE name = 'strait')"
    assert conn.execute(own.encode()).fetchall() == before
    conn.rollback()


def assert_a_waypoint_is_dragged_with_its_conflicts_at_once(page: Page, conn: Conn, dsn: str) -> None:
    """By keys and by the pointer; the page shows what a detection finds of the plan that it stores."""
    ask(page, "FERRY and TOW", "FERRY")
    said(page, "As planned: 3 conflicts.")
    page.evaluate("void conflictdbPage.view.map.jumpTo({center: [9.2, 57.8], zoom: 8})")
    expect(page.get_by_role("button", name="Waypoint")).to_have_count(3)
    second = page.get_by_role("button", name="Waypoint 2")
    for _ in range(2):
        page.get_by_role("button", name="Waypoint 2").press("ArrowDown")
    expect(page.locator(".what-if .said")).to_contain_text("Waypoint 2 elsewhere")
    box = second.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 12, box["y"] + 12)
    page.mouse.down()
    page.mouse.move(box["x"] + 12, box["y"] + 120, steps=6)
    page.mouse.up()
    said(page, "Waypoint 2 elsewhere: 2 fewer, none new; 1 in all.")
    shown = sorted(set(rows(page)) - set(page.locator("li.gone .keys").all_text_contents()))
    n, lon, lat = page.evaluate("conflictdbPage.havens.plan.waypoint")
    assert n == 1
    feature = json.loads(copied(page, "GeoJSON"))
    assert feature["geometry"]["coordinates"][1] == [lon, lat]
    conn.execute("BEGIN")
    conn.execute(copied(page, "SQL").encode())
    point = """SELECT ST_X(p), ST_Y(p) FROM conflictdb.track t JOIN conflictdb.scene s USING (scene_id),
        ST_PointN(path, 2) p WHERE t.key = 'FERRY' AND s.name = 'strait'"""
    assert conn.execute(point).fetchall() == [(lon, lat)]
    conn.rollback()
    page.get_by_role("button", name="Apply").click()
    expect(page.locator(".what-if")).to_contain_text("Applied: waypoint 2 elsewhere.")
    said(page, "As planned: 1 conflict.")
    assert conflicts_of(dsn, "strait", "FERRY") == shown
    page.get_by_role("button", name="Undo").click()
    said(page, "As planned: 3 conflicts.")
    assert conn.execute(point).fetchall() == [(9.4, 57.79)]
    conn.rollback()
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Waypoint")).to_have_count(0)


def assert_an_area_is_moved_and_ends_sooner(page: Page, dsn: str) -> None:
    """By its handle and by sliders; the page shows what a detection finds of the area that it stores."""
    page.get_by_role("combobox", name="Object").fill("DIVING")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="What if it moves?").click()
    said(page, "As planned: 3 conflicts.")
    page.get_by_role("slider", name="Ends").fill("-3600")
    said(page, "Until 1 Jun 2026 15:00:00 UTC: none fewer, none new; 3 in all.")
    page.evaluate("void conflictdbPage.view.map.jumpTo({center: [9.2, 57.8], zoom: 8})")
    for _ in range(6):
        page.get_by_role("button", name="Area").press("ArrowUp")
    expect(page.locator(".what-if .said")).to_contain_text(" nmi 000°, until 1 Jun 2026 15:00:00 UTC: ")
    wait_until(page, "!conflictdbPage.areaMove.isProbing")
    shown = sorted(set(rows(page)) - set(page.locator("li.gone .keys").all_text_contents()))
    assert len(shown) != 3
    page.get_by_role("button", name="Apply").click()
    expect(page.locator(".what-if")).to_contain_text("Applied: ")
    said(page, f"As planned: {len(shown)} conflict{'' if len(shown) == 1 else 's'}." if shown else "As planned: clear.")
    assert conflicts_of(dsn, "strait", "DIVING") == shown
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".what-if")).to_contain_text("Undone.")
    said(page, "As planned: 3 conflicts.")
    with conflictdb.connect(dsn) as db:
        _, [area], _ = db.scene("strait")._read(["DIVING"])
    assert area.end_us == T0_US + 16 * HOUR_US


def test_a_late_answer_leaves_the_copy_that_was_said(open_strait: Open, open_page: Open) -> None:
    """The server answers about a moved waypoint after the plan was copied. A new page asks it; later, none may."""
    page = open_page(open_strait().url.split("#")[0], size=(1280, 900), **COPIES)
    ask(page, "FERRY and TOW", "FERRY")
    said(page, "As planned: 3 conflicts.")
    asked: list[Route] = []
    page.route("**/api/probe", lambda route: asked.append(route))
    page.get_by_role("button", name="Waypoint 2").press("ArrowDown")
    wait_until(page, lambda: asked)
    copied(page, "GeoJSON")
    asked[0].continue_()
    expect(page.locator(".what-if .said")).to_contain_text("Waypoint 2 elsewhere")
    expect(page.locator(".what-if")).to_contain_text("Copied as GeoJSON")
    page.unroute("**/api/probe")
    assert_a_key_counts_while_pieces_are_read(page)
    assert_a_moved_plan_is_asked_again_after_pieces_are_read(page)


def assert_a_key_counts_while_pieces_are_read(page: Page) -> None:
    """The handles stay, with the focus, and the waypoint where the key moved it."""
    reading: list[Route] = []
    page.route("**/api/pieces*", lambda route: reading.append(route))
    page.get_by_role("combobox", name="Range").select_option("3600")
    wait_until(page, lambda: reading)
    handle = page.get_by_role("button", name="Waypoint 2")
    handle.press("ArrowDown")
    place = page.evaluate("conflictdbPage.departure.waypoint")
    reading[0].continue_()
    wait_until(page, "conflictdbPage.departure.slider.max === '3600'")
    assert page.evaluate("conflictdbPage.departure.waypoint") == place
    expect(handle).to_be_focused()


def assert_a_moved_plan_is_asked_again_after_pieces_are_read(page: Page) -> None:
    """The answer on the plan before that comes late."""
    page.unroute("**/api/pieces*")
    wait_until(page, "!conflictdbPage.departure.isProbing")
    late: list[Route] = []
    page.route("**/api/probe", lambda route: route.continue_() if late else late.append(route))
    page.get_by_role("button", name="Waypoint 2").press("ArrowDown")
    wait_until(page, lambda: late)
    page.get_by_role("combobox", name="Range").select_option("10800")
    wait_until(page, "conflictdbPage.departure.slider.max === '10800'")
    late[0].continue_()
    expect(page.locator(".what-if .said")).to_contain_text("Waypoint 2 elsewhere")


def drag_second_waypoint(page: Page, key: str, conflict: str) -> None:
    """Drag it south by 120 pixels of the same map."""
    leave(page)
    ask(page, conflict, key)
    said(page, "As planned: 3 conflicts.")
    page.evaluate("void conflictdbPage.view.map.jumpTo({center: [9.2, 57.8], zoom: 8})")
    box = page.get_by_role("button", name="Waypoint 2").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 12, box["y"] + 12)
    page.mouse.down()
    page.mouse.move(box["x"] + 12, box["y"] + 140, steps=6)
    page.mouse.up()


def periods_elsewhere(dsn: str, scene: str, key: str, waypoint: list[float]) -> list[Any]:
    """The conflicts of a copy, in which a track has a waypoint elsewhere: other keys, and ends of periods."""
    with conflictdb.connect(dsn) as db:
        settings, areas, tracks = db.scene(scene)._read(None)
    n, *place = waypoint
    places = {track.key: np.array(track.positions_deg) for track in tracks}
    places[key][int(n)] = place
    moved = [replace(track, positions_deg=places[track.key], max_speed_kn=np.inf) for track in tracks]
    found = [one for one in conflictdb.solve(moved, areas, settings) if key in (one.a_key, one.b_key)]
    return [
        [
            one.b_key if one.a_key == key else one.a_key,
            *(pytest.approx(end.timestamp(), abs=2e-6) for period in one.periods for end in period if end),
        ]
        for one in found
    ]


def assert_a_waypoint_is_dragged_in_a_branch(page: Page, dsn: str) -> None:
    """The page shows what a detection of the branch finds, with its own edits."""
    ask(page, "FERRY and TOW", "FERRY")
    said(page, "As planned: 2 conflicts.")
    page.evaluate("void conflictdbPage.view.map.jumpTo({center: [9.2, 57.8], zoom: 8})")
    for _ in range(3):
        page.get_by_role("button", name="Waypoint 2").press("ArrowDown")
    said(page, "Waypoint 2 elsewhere: 1 fewer, none new; 1 in all.")
    shown = page.evaluate("conflictdbPage.havens.plan.conflicts.map(({other, periods}) => [other, ...periods.flat()])")
    waypoint = page.evaluate("conflictdbPage.havens.plan.waypoint")
    assert sorted(shown) == periods_elsewhere(dsn, "less", "FERRY", waypoint)
    page.get_by_role("button", name="Apply").click()
    expect(page.locator(".what-if")).to_contain_text("Applied: waypoint 2 elsewhere.")
    assert len(conflicts_of(dsn, "less", "FERRY")) == len(shown)
    assert len(conflicts_of(dsn, "strait", "FERRY")) == 3


def test_a_file_computes_it_without_a_server(demo_dsn: str, open_strait: Open) -> None:
    """Also the keyboard closes it, and the scene is as it was."""
    page = open_strait(of="file")
    before = page.locator("#list").text_content()
    ask(page, "FERRY and TOW", "TOW")
    said(page, "As planned: 1 conflict.")
    page.get_by_role("slider", name="Departure").press("End")
    expect(page.locator(".what-if .said")).to_contain_text("1 h later: 1 fewer, none new; clear by ")
    expect(page.locator("li.gone .keys")).to_have_text("FERRY and TOW")
    drag_second_waypoint(page, "FERRY", "DIVING and FERRY")
    said(page, "Waypoint 2 elsewhere: 2 fewer, none new; 1 in all.")
    shown = page.evaluate("conflictdbPage.havens.plan.conflicts.map(({other, periods}) => [other, ...periods.flat()])")
    assert shown == periods_elsewhere(demo_dsn, "strait", "FERRY", page.evaluate("conflictdbPage.havens.plan.waypoint"))
    page.get_by_role("slider", name="Departure").press("PageUp")
    expect(page.locator(".what-if .said")).to_contain_text("later, waypoint 2 elsewhere: ")
    page.evaluate(gzip.decompress(AXE.read_bytes()).decode())
    violations = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
    assert [one["id"] for one in violations if one["impact"] in ("serious", "critical")] == []
    page.keyboard.press("Escape")
    expect(page.locator("#what-if")).to_be_hidden()
    page.get_by_role("combobox", name="Object").fill("")
    expect(page.locator("li.gone")).to_have_count(0)
    assert page.locator("#list").text_content() == before


def test_a_track_that_follows_within_the_separation_in_time_is_shown(
    conn: Conn, dsn: str, serve: Serve, open_page: Open
) -> None:
    """B crosses the way of A twenty minutes after it, C two hours after it."""
    times = np.array([T0_US, T0_US + 10 * HOUR_US])
    outline = rectangle_outline_m(500, 500, 500, 500)
    ways = {"A": [(9.0, 57.0), (10.0, 58.0)], "B": [(9.0, 58.0), (10.0, 57.0)], "C": [(9.0, 58.0), (10.0, 57.0)]}
    after_us = {"A": 0, "B": HOUR_US // 3, "C": 2 * HOUR_US}
    tracks = [Track(key, way, times + after_us[key], outline) for key, way in ways.items()]
    settings = Scene("s", time_separation_s=1800.0)
    load(conn, settings, [], tracks)
    detect(conn, "s", jobs=1)
    page = open_page(serve(dsn, "s"))
    ask(page, "A and B", "A")
    said(page, "As planned: 1 conflict.")
    page.get_by_role("slider", name="Departure").press("End")
    expect(page.locator(".what-if .said")).to_contain_text("1 h later: 1 fewer, none new; clear by ")
    page.get_by_role("combobox", name="Range").select_option("10800")
    page.get_by_role("slider", name="Departure").press("End")
    expect(page.locator(".what-if .said")).to_contain_text("3 h later: 1 fewer, none new; clear by ")
    page.get_by_role("slider", name="Departure").press("PageDown")
    page.get_by_role("slider", name="Departure").press("PageDown")
    page.get_by_role("slider", name="Departure").press("PageDown")
    page.get_by_role("slider", name="Departure").press("PageDown")
    said(page, "2 h 30 min later: 1 fewer, 1 new; 1 in all.")
    shown = page.evaluate("conflictdbPage.havens.plan.conflicts.map(({other, periods}) => [other, ...periods.flat()])")
    copies = [replace(one, times_us=one.times_us + (9 * HOUR_US // 4 if one.key == "A" else 0)) for one in tracks]
    assert len(shown) == len([one for one in conflictdb.solve(copies, [], settings) if one.a_key == "A"]) == 1


@pytest.mark.slow
def test_the_page_follows_the_pointer_among_300_objects(conn: Conn, dsn: str, serve: Serve, open_page: Open) -> None:
    """On a quiet machine."""
    scene, areas, tracks = plain_scene(HARBOUR, 3, 100, 200)
    load(conn, scene, areas, tracks)
    detect(conn, scene.name, jobs=1)
    page = open_page(serve(dsn, scene.name), size=(1440, 900), draws_map=True)
    page.get_by_role("combobox", name="Object").fill("T5")
    page.locator(".row", has_text="T5").first.click()
    page.get_by_role("button", name="departs earlier or later").first.click()
    expect(page.locator(".what-if .said")).to_contain_text("As planned")
    rate, step_ms = page.evaluate(PACE)
    print(f"{rate:.0f} pictures a second, {step_ms:.1f} ms of work for each")  # noqa: T201
    assert rate >= LEAST_PICTURES_PER_S
