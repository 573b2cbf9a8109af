"""The scenes of a database in one page: which one is shown, and since when or from which other one changes count."""

import gzip
from pathlib import Path

import pytest
from browsing import Open, new_page, rows, wait_until
from map_page import Client, Serve
from playwright.sync_api import Browser, Page, Route, expect

import conflictdb

AXE = Path(__file__).parent / "axe-core-4.14.1.min.js.gz"
HOSTILE = "<img src=x onerror=\"document.title='taken'\"> & co."


@pytest.fixture
def several(dsn: str, serve: Serve) -> str:
    """Serve a strait, a branch of it without the ferry, and a scene with a hostile name."""
    with conflictdb.connect(dsn) as db:
        db.load_demo()
        strait = db.scene("strait")
        strait.detect()
        branch = strait.branch("no ferry")
        branch.delete_objects("FERRY")
        branch.detect()
        strait.copy(HOSTILE)
    return serve(dsn, "strait")


def opened(page: Page, scene: str) -> None:
    expect(page.locator("#title")).to_have_text(scene)  # not that of the page before
    page.wait_for_selector("html[data-ready=true]", state="attached")


def assert_accessible(page: Page) -> None:
    page.evaluate(gzip.decompress(AXE.read_bytes()).decode())
    violations = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
    assert [(one["id"], one["nodes"][0]["html"]) for one in violations] == []


def test_one_page_shows_all_scenes(several: str, browser: Browser, open_page: Open, dsn: str) -> None:
    """The picker opens another scene; the address carries it, Back returns, and a scene that is gone is named."""
    with new_page(browser) as gone:
        assert_a_scene_that_is_gone_is_named(gone, f"{several}#scene=gone&a=FERRY&b=TOW")
        assert_scenes_are_shown(open_page(several), dsn, gone)


def assert_a_scene_that_is_gone_is_named(gone: Page, address: str) -> None:
    """Also when the page hears of changes late, as on a busy machine."""
    waiting: list[Route] = []
    gone.route("**/api/events*", lambda route: waiting.append(route))
    gone.goto(address)
    named = "The scene gone was deleted, renamed or unshared: this is another one."
    expect(gone.locator("#state")).to_have_text(named)
    wait_until(gone, lambda: waiting)  # the page may show its state before it asks
    with gone.expect_response("**/api/events*"):
        waiting[0].continue_()
    gone.wait_for_timeout(500)
    expect(gone.locator("#state")).to_have_text(named)
    expect(gone.locator("#detail")).to_be_hidden()
    expect(gone.locator("#what-if")).to_be_hidden()
    assert len(rows(gone)) == 7


def assert_scenes_are_shown(page: Page, dsn: str, gone: Page) -> None:
    picker = page.get_by_label("Scene")
    expect(picker.locator("option")).to_have_text(
        [f"{HOSTILE}: never detected", "no ferry: 4 conflicts, branch of strait", "strait: 7 conflicts"]
    )
    picker.select_option("no ferry")
    opened(page, "no ferry")
    assert len(rows(page)) == 4
    read = "performance.getEntriesByType('resource').filter(({name}) => name.endsWith('/api/scenes')).length"
    assert page.evaluate(read) == 1
    expect(page.get_by_label("Scene")).to_have_value("no ferry")
    page.get_by_role("button", name="CABLE and SUB-1").click()
    expect(page.locator(".card")).to_contain_text("inside by 7.3 nmi at")  # of pieces of the branch
    page.go_back()
    assert_a_branch_is_compared_with_its_parent(page, dsn)
    # A change of the branch reaches its page, and not that of the parent.
    expect(page.locator("#state")).to_contain_text("5 tracks")
    assert gone.evaluate("conflictdbPage.model.tracks.length") == 7
    page.go_back()
    opened(page, "strait")
    assert len(rows(page)) == 7
    assert_branches_are_dropped_and_merged(page, dsn, gone)
    page.get_by_label("Scene").select_option(HOSTILE)
    opened(page, HOSTILE)
    expect(page).to_have_title(f"{HOSTILE} · conflictdb")


def assert_branches_are_dropped_and_merged(page: Page, dsn: str, gone: Page) -> None:
    """Each by two clicks; then the page shows the parent. A change by others in between asks again."""
    with conflictdb.connect(dsn) as db:
        for name in ("without cable", "dropped by others"):
            branch = db.scene("strait").branch(name)
            branch.delete_objects("CABLE")
            branch.detect()
        kept = sorted(one.key for one in db.scene("strait").objects())
    drop, sure = (page.get_by_role("button", name=name, exact=True) for name in ("Drop", "Drop: sure?"))
    expect(drop).to_be_hidden()
    before = rows(page)
    page.get_by_label("Scene").select_option("no ferry")
    opened(page, "no ferry")
    drop.click()
    expect(sure).to_be_visible()
    with conflictdb.connect(dsn) as db:
        db.scene("no ferry").delete_objects("CABLE")
    expect(drop).to_be_visible()
    drop.click()
    sure.click()
    opened(page, "strait")
    assert rows(page) == before
    with conflictdb.connect(dsn) as db:
        assert sorted(one.key for one in db.scene("strait").objects()) == kept
        assert "no ferry" not in {one.scene.name for one in db.scenes()}
    assert_a_branch_that_others_dropped_is_not_dropped_again(gone, dsn)
    page.get_by_label("Scene").focus()
    page.get_by_label("Scene").select_option("without cable")
    opened(page, "without cable")
    page.get_by_role("button", name="Merge into strait", exact=True).click()
    page.get_by_role("button", name="Merge into strait: sure?").click()
    opened(page, "strait")
    expect(page.locator("#count")).to_have_text("6 conflicts")
    with conflictdb.connect(dsn) as db:
        assert {one.branch_of for one in db.scenes()} == {None}


def assert_a_branch_that_others_dropped_is_not_dropped_again(page: Page, dsn: str) -> None:
    """On a page that may report a refused request."""
    page.unroute_all()
    page.get_by_label("Scene").focus()
    page.get_by_label("Scene").select_option("dropped by others")
    opened(page, "dropped by others")
    drop = page.get_by_role("button", name="Drop", exact=True)
    expect(drop).to_be_visible()
    with conflictdb.connect(dsn) as db:
        db.scene("dropped by others").drop()
    expect(page.locator("#state")).to_have_text("it was deleted, renamed or unshared")
    expect(drop).to_be_hidden()


def assert_a_branch_is_compared_with_its_parent(page: Page, dsn: str) -> None:
    """The comparison says what the diff says."""
    page.get_by_label("Changes since").select_option(label="scene strait, its parent")
    said = page.locator("#changed")
    expect(said).to_have_text("Compared with scene strait, its parent: FERRY is gone, 0 new, 3 gone")
    with conflictdb.connect(dsn) as db:
        diff = db.scene("no ferry").diff()
    gone = sorted(f"{one.a_key} and {one.b_key}" for one in diff.conflicts if one.change == "gone")
    wait_until(page, lambda: sorted(rows(page)) == gone)
    assert len(gone) == len(diff.conflicts)
    assert_accessible(page)
    page.get_by_role("button", name="Dismiss").click()
    expect(page.locator("#changes")).to_be_hidden()
    expect(page.get_by_label("Changes since")).to_have_value("0")
    expect(page.locator(".row")).to_have_count(4)
    with conflictdb.connect(dsn) as db:
        db.scene("no ferry").delete_objects("TOW")


def test_scenes_of_others_are_not_named(several: str) -> None:
    """The list has what the role may see; another scene is refused like one that is not there."""
    client = Client(several)
    assert [one["scene"] for one in client.read("/api/scenes")["scenes"]] == [HOSTILE, "no ferry", "strait"]
    assert client.ask("GET", "/api/scene?scene=secret")[0] == 410
    assert client.ask("GET", "/api/conflicts?scene=secret")[0] == 410
    assert client.ask("GET", "/api/known?scene=secret&at=2026-06-01T00:00:00Z")[0] == 410
    assert client.ask("GET", "/api/known?at=never")[0] == 400
