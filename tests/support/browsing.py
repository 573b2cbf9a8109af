"""Chromium of this machine, for the tests of the page."""

import os
import shutil
import time
from collections.abc import Callable

from playwright.sync_api import Page

Open = Callable[..., Page]

_NAMES = ("chromium", "chromium-browser", "google-chrome")
# As root there is no sandbox. Without a graphics card Chromium renders in software, and WebGL if that is allowed.
ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader"]


def chromium() -> str | None:
    """Return the path of the browser: CONFLICTDB_TEST_BROWSER, else the first installed one; None if there is none."""
    return os.environ.get("CONFLICTDB_TEST_BROWSER") or next(filter(None, map(shutil.which, _NAMES)), None)


def rows(page: Page) -> list[str]:
    """Return the pairs in the list, in its order."""
    return page.locator(".row .keys").all_text_contents()


def time_of(page: Page) -> float:
    """Return the instant that is shown, Unix seconds."""
    return float(page.evaluate("conflictdbPage.t"))


def wait_until(page: Page, expression: str) -> None:
    """Wait until an expression is true; Playwright's own way evaluates texts in the page, which its policy forbids."""
    until_s = time.monotonic() + 20
    while not page.evaluate(expression):
        assert time.monotonic() < until_s, expression
        page.wait_for_timeout(50)
