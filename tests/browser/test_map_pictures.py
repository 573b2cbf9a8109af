"""The drawings of the page of `conflictdb map` are true: on paper, over time, of a chosen pair, and of changes."""

from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from browsing import Open, await_drawn, go_to, rows, states, wait_until
from commands import runner
from map_page import Serve
from piecework import load
from PIL import Image
from playwright.sync_api import Page, expect

from conflictdb.errors import printable
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
HOUR_US = 3_600_000_000
T0_US = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC
T0_S = T0_US / 1e6


def show_time(page: Page, t: float) -> None:
    script = """(t) => { const slider = document.getElementById('slider'); slider.value = t;
        slider.dispatchEvent(new Event('input', {bubbles: true})); }"""
    page.evaluate(script, t)
    await_drawn(page)


def pixel(page: Page, lon: float, lat: float, of: str) -> list[int]:
    """Return red, green, blue and opacity of a canvas above the map at a place."""
    script = """([lon, lat, of]) => {
        const {view} = conflictdbPage, {x, y} = view.map.project([lon, lat]), canvas = document.getElementById(of);
        return [...canvas.getContext('2d').getImageData(Math.round(x), Math.round(y), 1, 1).data];
    }"""
    return list(page.evaluate(script, [lon, lat, of]))


@pytest.mark.parametrize("size", [(1280, 900), (390, 844)], ids=["wide", "narrow"])
def test_havens_are_printed_where_they_are(open_strait: Open, size: tuple[int, int]) -> None:
    """The page has another width on paper and is not drawn again: all canvases of the map keep one shape."""
    page = open_strait(size)
    # As while it is printed: no frame is drawn between the screen and the paper.
    page.evaluate("""(() => {
        const {view: {map}, havens} = conflictdbPage;
        map.resize = map.redraw = map.triggerRepaint = () => map;
        havens.draw = () => {};
    })()""")
    try:
        assert_printed_as_one(page)
    finally:
        page.evaluate("""(() => {
            const {view: {map}, havens} = conflictdbPage;
            for (const one of ['resize', 'redraw', 'triggerRepaint']) delete map[one];
            delete havens.draw;
        })()""")


def assert_printed_as_one(page: Page) -> None:
    script = """['.maplibregl-canvas', '#graticule', '#overview', '#havens'].map((one) => {
        const canvas = document.querySelector(one), {x, y, width, height} = canvas.getBoundingClientRect();
        return [x, y, width, height];
    })"""
    screen = page.evaluate(script)
    scale = page.evaluate("document.querySelector('.maplibregl-ctrl-scale').getBoundingClientRect().width")
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 700, "height": 1000})
    paper = page.evaluate(script)
    x, y, width, height = paper[0]
    assert width != pytest.approx(screen[0][2], rel=0.1)
    for box in paper:
        assert box == pytest.approx([x, y, width, height], abs=0.6)
    assert width / height == pytest.approx(screen[0][2] / screen[0][3], rel=0.005)
    printed = page.evaluate("document.querySelector('.maplibregl-ctrl-scale').getBoundingClientRect().width")
    assert printed / width == pytest.approx(scale / screen[0][2], rel=0.01)


def test_printing_has_all_rows_and_marks_without_backgrounds(open_strait: Open) -> None:
    """A print without backgrounds distinguishes a conflict from grazing; the page is as before afterwards."""
    page = open_strait((1280, 900))
    page.set_viewport_size({"width": 1280, "height": 400})
    page.evaluate("""window.addEventListener('beforeprint', () => {
        window.printed = {rows: document.querySelectorAll('.row').length, isStill: conflictdbPage.havens.isStill};
    })""")
    assert page.pdf(print_background=False).startswith(b"%PDF")
    assert page.evaluate("window.printed") == {"rows": 7, "isStill": True}
    assert page.evaluate("conflictdbPage.havens.isStill") is False
    borders = page.evaluate("""['conflict', 'grazing'].map((verdict) => {
        const mark = document.createElement('span');
        mark.className = `mark ${verdict}`;
        document.body.append(mark);
        const {borderLeftWidth, width} = getComputedStyle(mark);
        return 2 * parseFloat(borderLeftWidth) / parseFloat(width);
    })""")
    assert borders[0] == 1
    assert borders[1] < 0.5


def test_a_conflict_is_printed_on_one_page(open_strait: Open) -> None:
    """Headline, map, legend and card, on A4."""
    page = open_strait((1280, 900))
    page.get_by_role("button", name="FERRY and TOW").click()
    expect(page.locator("svg.plan")).to_be_visible()
    expect(page.locator("svg.chart")).to_be_visible()
    page.emulate_media(media="print")
    for shown in ("#headline", "#map", "#legend", ".card", "svg.plan"):
        expect(page.locator(shown)).to_be_visible()
    expect(page.locator("#scenes")).to_be_hidden()  # lists to choose from
    assert page.pdf(format="A4").count(b"/Type /Page\n") == 1


def test_a_plan_that_may_move_is_printed_when_it_is_drawn_for_paper(open_strait: Open) -> None:
    """From a dark screen: in the colours of paper, without handles and sliders; dark again afterwards."""
    page = open_strait((1280, 900), scheme="dark")
    page.get_by_role("button", name="FERRY and TOW").click()
    page.get_by_role("button", name="What if FERRY departs earlier or later").click()
    wait_until(page, "!conflictdbPage.departure.isProbing")
    sliders = page.locator(".what-if input")
    expect(page.locator(".handle")).to_have_count(3)
    expect(sliders.first).to_be_visible()
    page.evaluate("""window.print = () => {
        const {map} = conflictdbPage.view;
        window.printed = [document.documentElement.dataset.theme, map.loaded() && map.areTilesLoaded()];
    }""")
    prints = page.get_by_role("button", name="Print", exact=True)
    words = page.get_by_role("combobox", name="Object")

    def print_beside_another() -> None:
        """Another print ends while the map is drawn for this one."""
        page.evaluate("document.getElementById('print').click(), dispatchEvent(new Event('afterprint'))")

    for begin in (prints.click, lambda: prints.press("Meta+P"), lambda: words.press("Control+p"), print_beside_another):
        begin()
        wait_until(page, "'printed' in window")
        assert page.evaluate("window.printed") == ["light", True]
        wait_until(page, "document.documentElement.dataset.theme === 'dark'")
        page.evaluate("delete window.printed")
    page.evaluate("delete window.print")
    page.emulate_media(media="print", color_scheme="dark")
    expect(page.locator(".what-if .said")).to_be_visible()
    for gone in (*page.locator(".handle").all(), *sliders.all(), page.locator(".what-if .heights")):
        expect(gone).to_be_hidden()


def test_a_brief_is_printed_alone_on_one_page(open_strait: Open) -> None:
    """Headings, times and conflicts, and no more text than that."""
    page = open_strait((1280, 900))
    page.get_by_role("button", name="FERRY and TOW").click()
    page.get_by_role("button", name="Brief of FERRY").click()
    brief = page.locator("#brief")
    expect(brief.get_by_role("listitem")).to_have_count(3)
    last = brief.evaluate("(one) => [...one.childNodes].map((child) => child.nodeName)")
    assert last == ["HEADER", "DL", "H3", "TABLE", "H3", "OL"]
    page.emulate_media(media="print")
    expect(brief.get_by_role("listitem").first).to_be_visible()
    expect(brief.get_by_role("button", name="Print the brief")).to_be_hidden()
    for gone in ("#map", ".side", ".head"):
        expect(page.locator(gone)).to_be_hidden()
    assert page.pdf(format="A4").count(b"/Type /Page\n") == 1
    page.keyboard.press("Escape")
    expect(brief).to_be_hidden()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_chosen_pair_stands_out(open_strait: Open, scheme: str) -> None:
    """Its objects have two hues, all else is dimmed, and regions at heights where they are not are hidden."""
    page = open_strait(scheme=scheme)
    page.get_by_role("button", name="FERRY and TOW").click()
    go_to(page, "{center: [9.0, 57.93], zoom: 8}")
    seen = states(page, "conflicts")
    assert seen["FERRY and TOW"]["chosen"]
    assert not seen["FERRY and TOW"]["dim"]
    assert not seen["FERRY and TOW"]["hidden"]
    # Under water, where neither can be.
    assert seen["CABLE and SUB-1"]["hidden"]
    assert not seen["FIRING and FERRY"]["hidden"]
    assert seen["FIRING and FERRY"]["dim"]
    objects = states(page, "areas", "tracks")
    assert [key for key, state in objects.items() if state["a"]] == ["FERRY"]
    assert [key for key, state in objects.items() if state["b"]] == ["TOW"]
    assert all(state["dim"] for key, state in objects.items() if key not in ("FERRY", "TOW"))
    hues = page.evaluate(
        """['a', 'b'].map((one) => getComputedStyle(document.documentElement).getPropertyValue(`--${one}`).trim())"""
    )
    assert len({*hues, "#d1490b", "#ff8a47"}) == 4
    plan = page.evaluate("['a', 'b'].map((one) => getComputedStyle(document.querySelector(`.plan-${one}`)).stroke)")
    assert len(set(plan)) == 2
    # Havens too, on the canvas.
    go_to(page, "{center: [8.6, 57.985], zoom: 12}")
    await_drawn(page)
    middle = (
        "(key) => { const {motion} = conflictdbPage.model.objects.get(key); return motion.place(conflictdbPage.t); }"
    )
    blue, green = (pixel(page, *page.evaluate(middle, key), "havens") for key in ("FERRY", "TOW"))
    assert blue[2] > blue[1] > blue[0]
    assert green[1] > green[2] > green[0]
    page.keyboard.press("Escape")
    seen = states(page, "conflicts", "tracks")
    assert not any(state["dim"] or state["hidden"] or state["a"] or state["b"] for state in seen.values())


WRITTEN = """() => {
    const { havens } = conflictdbPage, { context } = havens, written = [];
    context.fillText = (text, x, y) => {
        const half = context.measureText(text).width / 2;
        written.push([text, x - half, y - 6, x + half, y + 6]);
    };
    havens.draw();
    delete context.fillText;
    return [...written, ...havens.names.map(({ text, box }) => [text, ...box])];
}"""


def test_a_chosen_pair_is_named_and_its_overlap_filled(open_strait: Open) -> None:
    """Now, not where they meet at another time; both names are in view wherever the map goes, and apart."""
    page = open_strait()
    page.get_by_role("button", name="FIRING and FERRY").click()
    expect(page.locator("svg.plan")).to_be_visible()
    go_to(page, "{center: [9.2, 57.85], zoom: 9}")
    start = page.evaluate("conflictdbPage.t")
    assert {"first 08:11:17", "last 09:07:24"} <= {text for text, *_ in page.evaluate(WRITTEN)}
    place = "conflictdbPage.model.objects.get('FERRY').motion.place(conflictdbPage.t)"
    show_time(page, start + 1500)
    red, green, blue, _ = pixel(page, *page.evaluate(place), "havens")
    assert red > green > blue
    show_time(page, start - 600)
    red, green, blue, _ = pixel(page, *page.evaluate(place), "havens")
    assert green > red
    for view in ("{center: [9.2, 57.85], zoom: 9}", "{center: [9.2, 57.85], zoom: 3}", "{center: [-170, 0], zoom: 8}"):
        go_to(page, view)
        names = [one for one in page.evaluate(WRITTEN) if one[0].startswith(("A · ", "B · "))]
        assert [text for text, *_ in names] == ["A · Firing practice", "B · Ferry"]
        width, height = page.evaluate("(({width, height}) => [width, height])(conflictdbPage.view.frame())")
        assert all(x0 >= 0 and y0 >= 0 and x1 <= width and y1 <= height for _, x0, y0, x1, y1 in names)
        (_, u0, v0, u1, v1), (_, x0, y0, x1, y1) = names
        assert u1 <= x0 or x1 <= u0 or v1 <= y0 or y1 <= v0
    page.keyboard.press("Escape")
    assert not any(text.startswith(("A · ", "B · ")) for text, *_ in page.evaluate(WRITTEN))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_map_is_saved_as_a_picture(open_strait: Open, tmp_path: Path, scheme: str) -> None:
    """With the map itself, and what is drawn above it."""
    page = open_strait(scheme=scheme)
    page.get_by_role("button", name="FIRING and FERRY").click()
    expect(page.locator("svg.plan")).to_be_visible()
    page.get_by_role("slider", name="Time shown").press("ArrowRight")
    page.evaluate("globalThis.drawsMap = true")
    await_drawn(page)
    with page.expect_download() as saving:
        page.get_by_text("More", exact=True).click()
        page.get_by_role("button", name="Save the map as PNG").click()
    page.evaluate("globalThis.drawsMap = false")
    assert saving.value.suggested_filename == "strait.png"
    saving.value.save_as(file := tmp_path / "strait.png")
    with Image.open(file) as image:
        picture = np.asarray(image.convert("RGB")).astype(int)
    height, width = page.evaluate("(({width, height}) => [height, width])(conflictdbPage.view.frame())")
    assert picture.shape == (height + 56, width, 3)
    place = "conflictdbPage.view.map.project(conflictdbPage.model.objects.get('FERRY').motion.place(conflictdbPage.t))"
    x, y = (round(page.evaluate(place)[one]) for one in "xy")
    red, green, blue = picture[y + 56, x]
    assert red > green > blue  # of the overlap
    sea = page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--sea').trim()")
    assert (picture[56:] == [int(sea[n : n + 2], 16) for n in (1, 3, 5)]).all(axis=2).mean() > 0.05  # by WebGL
    assert len(np.unique(picture[:56].reshape(-1, 3), axis=0)) > 5  # the headline


CORNER = shapely.Polygon([(5.9, 57.0), (7.9, 57.0), (7.9, 57.25), (6.4, 57.25), (6.4, 58.0), (5.9, 58.0)])
SPOOFED = "\N{RIGHT-TO-LEFT OVERRIDE}1-BUS\N{POP DIRECTIONAL FORMATTING}"


def test_signs_that_turn_a_key_round_are_shown_as_numbers(
    conn: Conn, dsn: str, serve: Serve, open_page: Open, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the page, on its canvases and in tables: a key cannot look like another one."""
    areas = [
        Area(SPOOFED, shapely.box(8.0, 57.0, 9.0, 58.0), name="A\N{RIGHT-TO-LEFT ISOLATE}B"),
        Area("SUB-1", shapely.box(8.5, 57.0, 9.5, 58.0)),
        Area("CORNER", CORNER, name="Corner of all the world's ends"),
    ]
    load(conn, Scene("s"), areas, [])
    detect(conn, "s", jobs=1)
    conn.execute("SELECT conflictdb.acknowledge('s', %s, 'SUB-1', %s)", [SPOOFED, SPOOFED])
    conn.commit()
    page = open_page(serve(dsn, "s"))
    known = "\\u202e1-BUS\\u202c"
    assert printable(SPOOFED) == known
    assert sorted(rows(page)[0].split(" and ")) == sorted([known, "SUB-1"])
    written = page.evaluate("conflictdbPage.havens.names.map(({text}) => text)")
    assert "A\\u2067B" in written  # its name
    expect(page.locator(".row .names")).to_contain_text("A\\u2067B")
    page.locator(".row").click()
    expect(page.locator("#detail")).to_contain_text(f": {known}")
    expect(page.locator("#detail")).to_contain_text("A\\u2067B")
    expect(page.locator("#detail")).to_contain_text("Decided by")
    said = page.evaluate("document.body.textContent + document.title")
    assert [
        sign for sign in said if sign in "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\u200e\u200f\u061c"
    ] == []
    page.keyboard.press("Escape")
    for text in (known, SPOOFED):
        page.get_by_role("combobox", name="Object").fill(text)
        expect(page.locator(".row")).to_have_count(1)
    page.get_by_role("combobox", name="Object").fill("")
    assert_names_are_written_within_areas(page)
    table = runner(dsn, capsys)("conflicts", "--scene", "s")
    assert "\u202e" not in table.out
    assert known in table.out


def assert_names_are_written_within_areas(page: Page) -> None:
    """Cut, if they are longer."""
    page.evaluate("conflictdbPage.view.goTo([5.9, 57, 7.9, 58], 100)")
    await_drawn(page)
    ((name, lon, lat),) = page.evaluate("""conflictdbPage.havens.names.map(({text, box: [x0, y0, x1, y1]}) => {
        const { lng, lat } = conflictdbPage.view.map.unproject([(x0 + x1) / 2, (y0 + y1) / 2]);
        return [text, lng, lat];
    }).filter(([text]) => text.startsWith("Corner"))""")
    assert name.endswith("…")
    assert "Corner of all the world's ends".startswith(name[:-1])
    assert shapely.contains_xy(CORNER, lon, lat)


def test_the_page_shows_signs_as_tables_do(open_strait: Open) -> None:
    page = open_strait()
    signs = [
        *map(chr, range(0x300)),
        "\u061c",
        "\u200b",
        "\u200d",
        "\u2028",
        "\u3000",
        "\ufeff",
        "\U000e0001",
        "\U0001f389",
    ]
    script = "async (signs) => { const m = await import('/page/format.js'); return signs.map(m.printable); }"
    assert page.evaluate(script, signs) == [printable(sign) for sign in signs]
    counts = [0, 7, 999, 1000, 20_000, 999_999, 1_234_567]
    script = "async (counts) => { const m = await import('/page/format.js'); return counts.map(m.grouped); }"
    assert page.evaluate(script, counts) == [f"{count:,}" for count in counts]


def polar_pixel(page: Page, lon: float, lat: float) -> list[int]:
    """Return red, green and blue of the polar view at a place."""
    script = """(place) => {
        const {polar} = conflictdbPage, [x, y] = polar.project(place);
        return [...polar.context.getImageData(Math.round(x), Math.round(y), 1, 1).data].slice(0, 3);
    }"""
    return list(page.evaluate(script, [lon, lat]))


def differs(one: list[int], other: list[int]) -> bool:
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) > 8


@pytest.fixture
def about_the_pole(conn: Conn, dsn: str, serve: Serve) -> str:
    """Great circles: an area around the pole, and two ships that meet in it, north of the end of Web Mercator."""
    times = np.array([T0_US, T0_US + 10 * HOUR_US])
    outline = rectangle_outline_m(9000, 9000, 9000, 9000)
    around = [(lon, 87.0) for lon in range(-180, 180, 30)]
    tracks = [
        Track("OVER", [(10.0, 84.0), (-170.0, 84.0)], times, outline),
        Track("ACROSS", [(100.0, 84.0), (-80.0, 84.0)], times, outline),
    ]
    scene = Scene("s", motion=Motion.GREAT_CIRCLE, earth=EarthModel.SPHERE, centre=(0.0, 89.0))
    load(conn, scene, [Area("CAP", polar_cap(around), start_us=T0_US)], tracks)
    detect(conn, "s", jobs=1)
    conn.commit()
    return serve(dsn, "s")


def polar_cap(around: list[tuple[float, float]]) -> shapely.Polygon:
    """Return a polygon that runs along latitude 90, as footprints around a pole do."""
    (west, lat), *_ = around
    return shapely.Polygon([*around, (west + 360.0, lat), (west + 360.0, 90.0), (west, 90.0)])


def test_scenes_about_a_pole_are_shown_true(about_the_pole: str, conn: Conn, open_page: Open) -> None:
    """Land, areas with the pole in them, paths, havens and regions, each where the sphere has it; and a conflict."""
    page = open_page(about_the_pole)
    expect(page.locator("#polar")).to_be_visible()
    expect(page.locator("#beyond")).to_contain_text("the polar view shows what lies there")
    wait_until(page, "conflictdbPage.polar.paths !== null")
    # Stereographic: radii by the tangent of half the distance from the pole, angles as they are.
    places = [(10.0, 89.0), (-120.0, 85.0), (179.9, 80.0), (0.0, 90.0)]
    x0, y0 = page.evaluate("conflictdbPage.polar.project([0, 90])")
    scale = page.evaluate("conflictdbPage.polar.scale")
    for lon, lat in places:
        r = 2 * np.tan(np.radians(90 - lat) / 2) * scale
        x, y = page.evaluate("(place) => conflictdbPage.polar.project(place)", [lon, lat])
        assert (x - x0, y - y0) == pytest.approx((r * np.sin(np.radians(lon)), r * np.cos(np.radians(lon))), abs=1e-6)
    # The metres of its scale.
    length = """(() => {
        const [[x, y], [u, v]] = [[0, 90], [0, 89.99]].map((place) => conflictdbPage.polar.project(place));
        return Math.hypot(x - u, y - v);
    })()"""
    far = page.evaluate(length)
    page.evaluate("conflictdbPage.polar.goTo([[0, 89.9], [180, 89.9]])")
    zoomed = page.evaluate("conflictdbPage.polar.scale") / scale
    assert page.evaluate("conflictdbPage.polar.metresPerPixel()") * far * zoomed == pytest.approx(
        6371008.77 * np.radians(0.01), rel=1e-3
    )

    page.evaluate("conflictdbPage.polar.goTo([[-45, 70], [135, 70]])")
    show_time(page, T0_S + 2 * 3600)
    sea = polar_pixel(page, 55.0, 86.2)
    cap = polar_pixel(page, 55.0, 88.3)
    assert differs(sea, cap)
    # At the cut of the area's ring there is no edge, and nothing is left out.
    assert not differs(polar_pixel(page, -135.0, 88.3), cap)
    seam = [polar_pixel(page, lon, 88.3) for lon in (177.0, 179.6, -179.6, -177.0)]
    assert not any(differs(one, cap) for one in seam)
    assert differs(polar_pixel(page, -40.0, 78.0), sea)  # Greenland
    # A great circle over the pole goes straight through it.
    assert differs(polar_pixel(page, 10.0, 86.0), sea)
    assert differs(polar_pixel(page, -170.0, 86.0), sea)
    # Havens as the database has them.
    row = conn.execute(
        "SELECT ST_AsText(conflictdb.haven_at('s', 'OVER', to_timestamp(%s)))", [T0_S + 2 * 3600]
    ).fetchone()
    assert row is not None
    middle = shapely.from_wkt(row[0]).centroid
    seen = dict(
        page.evaluate("conflictdbPage.polar.names.filter(({at}) => at).map(({object, at}) => [object.key, at])")
    )
    x, y = page.evaluate("(place) => conflictdbPage.polar.project(place)", [middle.x, middle.y])
    assert seen["OVER"] == pytest.approx([x, y], abs=2)
    assert_chosen_about_the_pole(page)


def assert_chosen_about_the_pole(page: Page) -> None:
    """A conflict is chosen in the list, and clicked there; the button goes to the map without it, and back."""
    page.get_by_role("button", name="Polar view").click()
    expect(page.locator("#polar")).to_be_hidden()
    assert len(rows(page)) == 3
    page.locator(".row", has_text="OVER").filter(has_text="ACROSS").click()
    expect(page.locator("#polar")).to_be_visible()
    wait_until(page, "conflictdbPage.polar.paths !== null")
    await_drawn(page)
    lon, lat = page.evaluate("""(() => {
        const pair = new Set(["OVER", "ACROSS"]), {conflicts} = conflictdbPage.model;
        const {lon, lat} = conflicts.find(({a, b}) => pair.has(a) && pair.has(b));
        return [lon, lat];
    })()""")
    assert lat > 85.06
    red, _, blue = polar_pixel(page, lon, lat)
    assert red > blue + 50
    x, y = page.evaluate("(place) => conflictdbPage.polar.project(place)", [lon, lat])
    page.keyboard.press("Escape")
    box = page.locator("#polar").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + x, box["y"] + y)
    expect(page.locator("#detail").get_by_role("heading")).to_contain_text("OVER")
    before = page.evaluate("conflictdbPage.polar.scale")
    page.get_by_label("Zoom in about the pole").click()
    assert page.evaluate("conflictdbPage.polar.scale") == pytest.approx(2 * before)


def test_scenes_far_from_the_poles_have_no_polar_view(open_strait: Open) -> None:
    page = open_strait()
    expect(page.locator("#pole")).to_be_hidden()
    expect(page.locator("#polar")).to_be_hidden()
