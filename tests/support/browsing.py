"""Chromium of this machine, for the tests of the page."""

import os
import shutil
import time
from collections.abc import Callable

from patience import WAIT_S
from playwright.sync_api import Browser, Page

Open = Callable[..., Page]

# The first one is the same without windows, whose pictures would take a sixth of the work of a page.
_NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
# As root there is no sandbox. Without a graphics card Chromium renders in software, and WebGL if that is allowed.
# Each new window would render two pages of its address bar: a third of the work for a test. The last such list replaces
# the one of Playwright, so its features follow too.
_NEVER = (
    "WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "WebUIOmniboxFullPopup", "PaintHolding", "HttpsUpgrades",
    "HttpsFirstBalancedModeAutoEnable", "AvoidUnnecessaryBeforeUnloadCheckSync", "DestroyProfileOnBrowserClose",
    "AvoidCorsURLLoaderRestartOnRedirect", "ThirdPartyStoragePartitioning", "MediaRouter", "LensOverlay",
    "OptimizationHints", "NetworkTimeServiceQuerying", "AimEnabled", "PreconnectToSearch",
)  # fmt: skip
ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader", f"--disable-features={','.join(_NEVER)}"]
# Without a graphics card, drawing the map takes a third of the work of a page. MapLibre does everything else: it loads
# tiles, places features and answers where they are. Tests of the picture set `drawsMap`.
DRAWS_NO_MAP = """{
    const draw = WebGL2RenderingContext.prototype.drawElements;
    WebGL2RenderingContext.prototype.drawElements = function (...given) {
        if (globalThis.drawsMap) draw.apply(this, given);
    };
}"""
_DRAWN_MS = 30_000  # a map that never rests is looked at all the same


def chromium() -> str | None:
    """Return the path of the browser: CONFLICTDB_TEST_BROWSER, else the first installed one; None if there is none."""
    return os.environ.get("CONFLICTDB_TEST_BROWSER") or next(filter(None, map(shutil.which, _NAMES)), None)


def new_page(browser: Browser) -> Page:
    """Return a page that waits as long as tests do, and draws no map."""
    page = browser.new_page()
    page.add_init_script(DRAWS_NO_MAP)
    page.set_default_timeout(1000 * WAIT_S)
    return page


def rows(page: Page) -> list[str]:
    """Return the pairs in the list, in its order."""
    return page.locator(".row .keys").all_text_contents()


def time_of(page: Page) -> float:
    """Return the instant that is shown, Unix seconds."""
    return float(page.evaluate("conflictdbPage.t"))


def wait_until(page: Page, holds: str | Callable[[], object]) -> None:
    """Wait until an expression of the page, or of the test, is true.

    Playwright's own way evaluates texts in the page, which its policy forbids.
    """
    until_s = time.monotonic() + WAIT_S
    while not (page.evaluate(holds) if isinstance(holds, str) else holds()):
        assert time.monotonic() < until_s, holds
        page.wait_for_timeout(50)


def go_to(page: Page, place: str) -> None:
    """Move the map to a centre and zoom, as JavaScript; the map itself, which is returned there, is not read out."""
    page.evaluate(f"void conflictdbPage.view.map.jumpTo({place})")


def await_drawn(page: Page) -> None:
    """Wait until the map has all its tiles and nothing more to draw, and what lies above it is drawn too."""
    page.evaluate(
        """async (longest_ms) => {
            const {map} = conflictdbPage.view, next = () => new Promise((shown) => requestAnimationFrame(shown));
            await next(); // what was just changed asks for its drawing
            const idle = new Promise((reached) => map.once('idle', () => reached()));
            map.triggerRepaint();
            await Promise.race([idle, new Promise((reached) => setTimeout(reached, longest_ms))]);
            await next();
            await next();
        }""",
        _DRAWN_MS,
    )


def states(page: Page, *layers: str) -> dict[str, dict[str, bool]]:
    """Return the state of each feature that layers of the map show, by the keys of its objects."""
    await_drawn(page)
    found = page.evaluate(
        """(layers) => conflictdbPage.view.map.queryRenderedFeatures({layers}).map(({properties: p, state}) => (
            [p.key ?? `${p.a_key} and ${p.b_key}`, state]))""",
        list(layers),
    )
    return dict(found)
