"""A browser for the tests of the page: Chromium of this machine, else they say that they did not run."""

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from browsing import ARGUMENTS, Open, chromium
from map_page import Serve, served_page
from playwright.sync_api import Browser, ConsoleMessage, Page, expect, sync_playwright

import conflictdb

_READY_MS = 60_000
expect.set_options(timeout=20_000)  # a busy machine draws maps in software


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    program = chromium()
    if program is None:
        pytest.skip("did not run: no Chromium on this machine (Debian package chromium)")
    with sync_playwright() as playwright, playwright.chromium.launch(executable_path=program, args=ARGUMENTS) as found:
        yield found


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Return a function that serves pages until the end of the test."""
    with ExitStack() as servers:
        yield lambda dsn, scene: servers.enter_context(served_page(dsn, scene))


@pytest.fixture
def strait(dsn: str, serve: Serve) -> str:
    """Return the address of a page of the demo, detected."""
    with conflictdb.connect(dsn) as db:
        db.load_demo()
        db.scene("strait").detect()
    return serve(dsn, "strait")


@pytest.fixture
def open_page(browser: Browser, serve: Serve) -> Iterator[Open]:
    """Return a function that opens an address and waits until it is shown; no console error, no request to other sites.

    Pages are closed before the servers end: a page whose server is gone reports failed requests a second later.
    """
    said: list[str] = []
    with ExitStack() as contexts:

        def opened(address: str, *, size: tuple[int, int] = (900, 600), **options: Any) -> Page:
            viewport = {"width": size[0], "height": size[1]}
            context = contexts.enter_context(browser.new_context(viewport=viewport, reduced_motion="reduce", **options))
            page = context.new_page()
            page.on("console", lambda message: _is_of_the_page(message) and said.append(message.text))
            page.on("pageerror", lambda error: said.append(str(error)))
            site = address.split("/", 3)[2]
            page.on("request", lambda request: _is_within(request.url, site) or said.append(f"asked {request.url}"))
            page.goto(address)
            page.wait_for_selector("html[data-ready=true]", state="attached", timeout=_READY_MS)
            return page

        yield opened
    assert said == []


def _is_of_the_page(message: ConsoleMessage) -> bool:
    """Whether a message is an error or a warning, other than the browser's note that it renders in software."""
    return message.type in ("error", "warning") and "GL Driver Message" not in message.text


def _is_within(url: str, site: str) -> bool:
    return url.startswith(("blob:", "data:")) or url.split("/", 3)[2] == site
