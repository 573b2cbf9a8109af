"""Five tasks of a planner on the page of `conflictdb map`, counted in clicks and keys; a typed word counts once."""

import psycopg
from browsing import Open, rows, wait_until
from playwright.sync_api import Locator, Page, expect

import conflictdb


class Hands:
    """Clicks and presses, and counts them."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.count = 0

    def click(self, target: Locator) -> None:
        self.count += 1
        target.click()

    def press(self, key: str) -> None:
        self.count += 1
        self.page.keyboard.press(key)

    def type(self, word: str) -> None:
        self.count += 1
        self.page.keyboard.type(word)

    def choose(self, choice: Locator, label: str) -> None:
        """Open a list, and choose."""
        self.count += 2
        choice.select_option(label=label)


def test_what_does_my_ferry_meet_in_three(open_strait: Open) -> None:
    hands = Hands(open_strait((1280, 900)))
    hands.press("/")
    hands.type("ferry")
    hands.press("Enter")
    expect(hands.page.locator("#count")).to_have_text("3 of 7 conflicts")
    assert rows(hands.page) == ["FERRY and TOW", "FIRING and FERRY", "DIVING and FERRY"]
    assert hands.count <= 3


def test_clear_it_in_four_and_what_changed_since_the_hour_in_two(
    strait: str, open_page: Open, conn: psycopg.Connection[None], dsn: str
) -> None:
    page = open_page(strait, size=(1440, 900))
    assert_cleared_in_four(page, dsn)
    page.keyboard.press("Escape")
    page.get_by_role("combobox", name="Object").fill("")
    assert_changes_since_the_hour_in_two(page, conn, dsn)


def assert_cleared_in_four(page: Page, dsn: str) -> None:
    hands = Hands(page)
    hands.click(page.get_by_role("button", name="FERRY and TOW"))
    hands.click(page.get_by_role("button", name="What if FERRY departs earlier or later"))
    hands.click(page.get_by_role("button", name="Clear 1 h 8 min earlier"))
    hands.click(page.get_by_role("button", name="Apply"))
    expect(page.locator(".what-if")).to_contain_text("Applied: ")
    expect(page.locator(".what-if .said")).to_have_text("As planned: clear by 36 s.")
    with conflictdb.connect(dsn) as db:
        assert not [one for one in db.scene("strait").conflicts() if "FERRY" in (one.a_key, one.b_key)]
    assert hands.count <= 4


def assert_changes_since_the_hour_in_two(page: Page, conn: psycopg.Connection[None], dsn: str) -> None:
    """The detections so far become those of five hours ago."""
    for column, table in (("finished_at", "run"), ("at", "conflict_event")):
        conn.execute(f"UPDATE conflictdb.{table} SET {column} = {column} - interval '5 hours'".encode())
    conn.commit()
    with conflictdb.connect(dsn) as db:
        db.scene("strait").delete_objects("CABLE")
        db.scene("strait").detect()
    expect(page.locator("#count")).to_have_text("3 conflicts")
    hands = Hands(page)
    since = page.get_by_label("Changes since")
    hour = since.locator("option").nth(1).text_content()  # the last full hour
    assert hour is not None
    hands.choose(since, hour)
    expect(page.locator("#changed")).to_have_text(f"Since {hour}: 0 new, 1 gone")
    assert rows(page) == ["CABLE and SUB-1"]
    expect(page.locator("li.gone .keys")).to_have_text("CABLE and SUB-1")
    assert hands.count <= 2
    since.select_option(label="a week ago")
    expect(page.locator("#state")).to_contain_text("The instant is before the first detection of the scene")


def test_tell_a_colleague_in_two(open_strait: Open) -> None:
    page = open_strait((1280, 900))
    hands = Hands(page)
    hands.click(page.get_by_role("button", name="FERRY and TOW"))
    hands.click(page.get_by_role("button", name="Copy link"))
    expect(page.locator("#link")).to_have_text("Copied")
    link = page.evaluate("navigator.clipboard.readText()")
    other = open_strait()
    other.goto(link)
    expect(other.locator("#detail").get_by_role("heading")).to_have_text("FERRY and TOW")
    assert hands.count <= 2


def test_print_in_two(open_strait: Open) -> None:
    """The browser prints by Ctrl+P: one page with the chosen conflict."""
    page = open_strait((1280, 900))
    hands = Hands(page)
    hands.click(page.get_by_role("button", name="FERRY and TOW"))
    expect(page.locator("svg.plan")).to_be_visible()
    expect(page.locator("svg.chart")).to_be_visible()
    page.evaluate("window.print = () => { window.isPrinted = true; }")
    hands.press("Control+p")
    wait_until(page, "window.isPrinted")
    page.evaluate("delete window.print, delete window.isPrinted")
    assert page.pdf(format="A4").count(b"/Type /Page\n") == 1
    assert hands.count <= 2
