"""The address of the page of `conflictdb map`: it says what is shown, and shows it again."""

import re
from urllib.parse import urlsplit

import pytest
from browsing import Open, rows, time_of, wait_until
from map_page import served_page
from playwright.sync_api import Page, expect

PLACE = "conflictdbPage.view.place()"


def ready(page: Page) -> None:
    page.wait_for_selector("html[data-ready=true]", state="attached")


def test_below_a_token_all_requests_find_their_way(demo_dsn: str, open_page: Open) -> None:
    """Modules, styles, data, tiles and land, or the page would log an error; the link contains the token, no cookie."""
    with served_page(demo_dsn, "strait", host="0.0.0.0") as address:  # noqa: S104
        address = address.replace(str(urlsplit(address).hostname), "127.0.0.1")  # whose headers browsers trust
        page = open_page(address)
        assert len(rows(page)) == 7
        page.get_by_role("combobox", name="Object").fill("ferry")
        page.get_by_role("button", name="FERRY and TOW").click()
        expect(page.locator("#detail").get_by_role("heading")).to_have_text("FERRY and TOW")
        asked = page.evaluate("performance.getEntriesByType('resource').map((one) => one.name)")
        assert [one for one in asked if not one.startswith((address, "blob:", "data:"))] == []
        assert [part for part in ("page", "vendor", "api") if not any(f"/{part}/" in one for one in asked)] == []
        assert page.url.startswith(address)
        assert page.context.cookies() == []
        page.context.close()


def test_back_reload_and_a_copied_link_show_it_again(open_strait: Open, open_page: Open) -> None:
    """Time, view, filter, the chosen conflict, and a track that departs at another time."""
    page = open_strait()
    page.get_by_role("combobox", name="Object").fill("ferry")
    page.get_by_role("button", name="FERRY and TOW").click()
    page.get_by_role("slider", name="Time shown").press("PageUp")
    page.evaluate("void conflictdbPage.view.map.jumpTo({center: [8.5, 57.9], zoom: 9.5})")
    wait_until(page, "location.hash.includes('view=8.5%2C57.9%2C9.5')")
    shown = time_of(page), page.evaluate(PLACE)
    page.reload()
    ready(page)
    expect(page.locator("#detail").get_by_role("heading")).to_have_text("FERRY and TOW")
    assert (round(time_of(page)), page.evaluate(PLACE)) == (round(shown[0]), shown[1])
    page.go_back()
    expect(page.locator("#detail")).to_be_hidden()
    expect(page.locator(".row")).to_have_count(3)
    page.go_forward()
    expect(page.locator("#detail").get_by_role("heading")).to_have_text("FERRY and TOW")

    page.get_by_role("button", name="What if FERRY departs earlier or later").click()
    said = page.locator(".what-if .said")
    expect(said).to_have_text("As planned: 3 conflicts.")
    page.get_by_role("slider", name="Departure").press("End")
    text = said.text_content()
    assert text is not None
    assert text.startswith("Departs 10:15, 3 h later")
    page.get_by_role("button", name="Copy link").click()
    expect(page.locator("#link")).to_have_text("Copied")
    link = page.evaluate("navigator.clipboard.readText()")
    other = open_page(link)
    expect(other.locator(".what-if .said")).to_have_text(text)
    assert rows(other) == rows(page)
    assert round(time_of(other)) == round(time_of(page))


def test_units_and_times_are_chosen_and_kept_in_the_address(open_strait: Open) -> None:
    """Nautical miles, degrees and minutes, and UTC; or kilometres, decimals, and the zone of the browser."""
    page = open_strait((1280, 900))
    page.get_by_role("button", name="FERRY and TOW").click()
    card = page.locator(".card")
    expect(card).to_contain_text(
        re.compile(r"09:48:51 UTC, first at 57°\d\d\.\d. N 008°\d\d\.\d. E, too close by 0.6 nmi")
    )
    page.get_by_text("More", exact=True).click()
    page.get_by_label("Units").select_option("metric")
    page.get_by_label("Times").select_option("America/New_York")
    expect(card).to_contain_text(re.compile(r"05:48:51 UTC-4, first at 57\.\d{4}° N 8\.\d{4}° E, too close by \d+ m"))
    expect(page.locator("#day")).to_have_text("UTC-4, 1 Jun 2026")
    expect(page.locator(".maplibregl-ctrl-scale")).to_contain_text("m")
    wait_until(page, "location.hash.includes('units=metric') && location.hash.includes('zone=America%2FNew_York')")
    page.get_by_text("All conflicts").click()
    page.get_by_text("Filter", exact=True).click()
    page.get_by_label("From (UTC-4)").fill("2026-06-01 05:47")
    assert page.evaluate("conflictdbPage.filter.from") == 1780307220
    page.get_by_text("More", exact=True).click()
    page.get_by_label("Times").select_option("UTC")
    expect(page.get_by_label("From (UTC)")).to_have_value("2026-06-01 09:47:00")


def test_the_list_dates_conflicts_by_days_of_the_zone(open_strait: Open) -> None:
    """Midnight in Anchorage is between two conflicts of one day in UTC."""
    page = open_strait((1280, 900))
    when = page.locator(".row .when")
    expect(when.first).to_have_text(re.compile(r"^\d\d:\d\d:\d\d$"))
    page.evaluate("location.hash = '#zone=America/Anchorage'")
    expect(when.first).to_have_text("1 Jun 01:45:43")
    expect(when.nth(1)).to_have_text("31 May 23:41:56")


@pytest.mark.parametrize(
    "hash_",
    [
        "scene=strait&t=NaN&view=1,2&a=x&b=<b>&verdicts=none&departs=FIRING&later=1e99&from=never&floor=deep",
        "%F0%28&=&&a&t=2026-99-99 00:00&view=1e999,91,5&later=NaN&departs=",
    ],
)
def test_an_address_that_is_not_understood_changes_nothing(open_strait: Open, hash_: str) -> None:
    page = open_strait()
    shown = time_of(page), page.evaluate(PLACE)
    page.goto(f"{page.url.split('#')[0]}#{hash_}")
    expect(page.locator("#what-if")).to_be_hidden()
    expect(page.locator("#detail")).to_be_hidden()
    assert page.locator("#from").input_value() == ""
    assert page.locator("#floor").input_value() == ""
    assert (time_of(page), page.evaluate(PLACE)) == shown


def test_a_file_has_an_address_too(open_strait: Open) -> None:
    page = open_strait(of="file")
    page.get_by_role("button", name="FERRY and TOW").click()
    expect(page.locator(".card")).to_contain_text("too close by 0.6 nmi at 09:4")
    expect(page.locator("svg.chart")).to_be_visible()
    wait_until(page, "location.hash.includes('b=TOW')")
    page.reload()
    ready(page)
    expect(page.locator("#detail").get_by_role("heading")).to_have_text("FERRY and TOW")
    page.go_back()
    expect(page.locator("#detail")).to_be_hidden()
