"""Positions on the page: alarms above the list, last positions on the map, and lateness in labels."""

import gzip
import re
from datetime import UTC, datetime
from pathlib import Path

import psycopg
from browsing import Open, await_drawn
from map_page import Serve
from playwright.sync_api import expect

import conflictdb
from conflictdb.jobs.looks import Looks

AXE = Path(__file__).parent / "axe-core-4.14.1.min.js.gz"
PUT = """
INSERT INTO conflictdb.position (scene, key, instant, place)
VALUES ('strait', 'FERRY', %s, ST_SetSRID(ST_MakePoint(%s, %s), 4326))
"""

FIRST = "Ferry 11 to 14 min late: is in conflict with Firing practice"


def look(dsn: str, text: str, lon: float, lat: float) -> None:
    """Store a position of the ferry, and look at that instant as a worker does."""
    at = datetime.fromisoformat(text).replace(tzinfo=UTC)
    with psycopg.connect(dsn) as conn:
        conn.execute(PUT, [at, lon, lat])
        conn.commit()
        Looks().look(conn, int(at.timestamp() * 1e6), is_silence_due=True)


def test_a_late_ship_has_its_alarm_on_top_and_its_place_on_the_map(dsn: str, serve: Serve, open_page: Open) -> None:
    """As docs/how-to/compare-plans-with-positions.md says it: the ferry is 12 minutes late at its second waypoint."""
    with conflictdb.connect(dsn) as db:
        db.load_demo()
        with psycopg.connect(dsn) as conn:
            conn.execute("SELECT conflictdb.create_scene('strait', p_delays_within_s => 7200)")
        db.scene("strait").detect()
    page = open_page(serve(dsn, "strait"))
    expect(page.locator("#live")).to_be_hidden()
    expect(page.locator("#ships")).to_be_hidden()
    look(dsn, "2026-06-01T08:38:09", 9.4, 57.79)
    alarms = page.locator("#live li button")
    expect(alarms).to_have_text([
        re.compile(rf"^{FIRST} since 08:2\d:\d\d \(slack used up\)$"),
        "Ferry 11 to 14 min late: meets Diving on a wreck at 09:11:02 (slack used up)",
    ])  # fmt: skip
    expect(page.locator("#alarm")).to_have_text(
        re.compile("^Ferry 11 to 14 min late: is in conflict with Firing practice")
    )
    expect(page.locator("#live p")).to_have_text("1 position, the last at 08:38:09: 1 late")
    page.get_by_role("button", name="the last at 08:38:09").click()
    expect(page.locator("#clock")).to_have_text("08:38:09")
    await_drawn(page)
    names = page.evaluate("conflictdbPage.havens.names.map(({text}) => text)")
    assert [one for one in names if "late" in one] == ["Ferry, 11 to 14 min late"], names
    # Where its last position is, the canvas has its mark.
    marked = """(() => {
        const {havens, view} = conflictdbPage, {x, y} = view.map.project([9.4, 57.79]);
        const ratio = window.devicePixelRatio;
        return havens.context.getImageData(Math.round(x * ratio), Math.round(y * ratio), 1, 1).data[3];
    })()"""
    assert page.evaluate(marked) > 200
    # Where the ship was planned then is found once, however often the map is drawn.
    asked = """(() => {
        const {havens} = conflictdbPage, {places} = havens, {t} = [...havens.live.values()][0];
        let asked = 0;
        havens.t = t + 1;
        havens.places = (tracks, at, pixel) => { asked += at === t; return places.call(havens, tracks, at, pixel); };
        for (let k = 0; k < 5; k += 1) havens.draw();
        havens.take(havens.tracks, havens.areas);
        for (let k = 0; k < 5; k += 1) havens.draw();
        havens.places = places;
        return asked;
    })()"""
    assert page.evaluate(asked) == 1, "once more for another plan"
    page.evaluate(gzip.decompress(AXE.read_bytes()).decode())
    assert page.evaluate("axe.run(document.getElementById('live'), {resultTypes: ['violations']})")["violations"] == []
    alarms.nth(1).click()
    expect(page.locator("#object h2")).to_have_text("FERRY")
    expect(page.locator("#clock")).to_have_text("09:11:02")
    # It catches up, and both contacts are over: alarms end by themselves.
    with psycopg.connect(dsn) as conn:
        place = "SELECT ST_X(p), ST_Y(p) FROM ST_Centroid(conflictdb.haven_at('strait', 'FERRY', %s)) p"
        row = conn.execute(place, ["2026-06-01 09:25+00"]).fetchone()
    assert row is not None
    look(dsn, "2026-06-01T09:25:00", *row)
    expect(page.locator("#live p")).to_have_text("1 position, the last at 09:25:00: 1 on plan")
    expect(alarms).to_have_count(0)
