"""A browser for the tests of the page: Chromium of this machine, else they say that they did not run."""

from collections.abc import Iterator
from contextlib import ExitStack, redirect_stdout
from io import StringIO
from typing import Any

import pytest
from browsing import ARGUMENTS, DRAWS_NO_MAP, Open, await_drawn, chromium, wait_until
from databases import TestServer
from map_page import Serve, page_program, served_page
from patience import WAIT_S
from playwright.sync_api import Browser, ConsoleMessage, Page, expect, sync_playwright

import conflictdb
from conflictdb.cli import main

_MOST_MS = 1000 * WAIT_S
NARROW = (390, 844)
# A page waits 1.5 s for depths and then begins at the first conflict, not at the worst. Here it waits until they come.
# A button says for 2 s that a link was copied. Here it says so until a slow machine has looked.
_IS_PATIENT = """{
    const after = globalThis.setTimeout;
    globalThis.setTimeout = (done, ms, ...rest) => after(done, ms === 1500 || ms === 2000 ? 180_000 : ms, ...rest);
}"""
expect.set_options(timeout=_MOST_MS)


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


class OpenPages:
    """Pages of the demo that stay open, for tests that leave the scene as it is: one each for mice and for fingers."""

    def __init__(self, browser: Browser, dsn: str, addresses: dict[str, str], pages: ExitStack) -> None:
        self.dsn = dsn
        self._browser = browser
        self._addresses = addresses
        self._pages = pages
        self._open: dict[tuple[str, bool], tuple[Page, list[Any]]] = {}
        self.said: list[str] = []  # what they must not say

    def get(self, size: tuple[int, int] = (900, 600), *, scheme: str = "light", of: str = "served") -> Page:
        """Return a page as it was when it opened, but for its size and colours; `of`: "served" or "file"."""
        which = of, size == NARROW
        if which not in self._open:
            self._open[which] = self._opened(of, size)
        page, first = self._open[which]
        page.unroute_all()
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.emulate_media(media="null", color_scheme=scheme, reduced_motion="reduce")
        page.mouse.move(0, 0)
        page.evaluate(_AS_OPENED, first)
        await_drawn(page)
        return page

    def _opened(self, of: str, size: tuple[int, int]) -> tuple[Page, list[Any]]:
        options: dict[str, Any] = {"has_touch": size == NARROW, "locale": "en-US", "timezone_id": "America/New_York"}
        options["permissions"] = ["clipboard-read", "clipboard-write"]
        page = _open(self._browser, self._addresses[of], self.said, self._pages, size, offline=of == "file", **options)
        wait_until(page, "location.hash.length > 1")
        return page, list(page.evaluate("[location.hash, conflictdbPage.t]"))


# Goes back to the first address of the page, and undoes what addresses do not have.
_AS_OPENED = """([address, t]) => {
    if (document.querySelector('#changes:not([hidden])')) document.getElementById('dismiss-changes').click();
    history.pushState(null, '', address);
    dispatchEvent(new PopStateEvent('popstate'));
    conflictdbPage.moveTo(t);
    document.getElementById('whole').click();
    document.getElementById('link').textContent = 'Copy link'; // which a patient page says three minutes later
    for (const one of document.querySelectorAll('details')) one.open = one.id === 'legend' && innerWidth > 900;
    for (const one of document.querySelectorAll('*')) one.scrollTop = 0;
    document.activeElement.blur();
}"""


@pytest.fixture(scope="session")
def _open_pages(
    browser: Browser, _server: TestServer, template: str, tmp_path_factory: pytest.TempPathFactory, worker_id: str
) -> Iterator[OpenPages]:
    name, file = f"{_server.prefix}_{worker_id}_strait", tmp_path_factory.mktemp("page") / "strait.html"
    with ExitStack() as stack:
        stack.callback(_server.drop, name)
        dsn = _server.clone(template, name)
        with conflictdb.connect(dsn) as db:
            db.load_demo()
            db.scene("strait").detect()
        with redirect_stdout(StringIO()) as out:
            code = main(["--dsn", dsn, "map", "--html", str(file)])
        assert (code, out.getvalue()) == (0, "")
        address = stack.enter_context(page_program(dsn, "strait"))
        yield OpenPages(browser, dsn, {"served": address, "file": file.as_uri()}, stack)


@pytest.fixture
def open_strait(_open_pages: OpenPages) -> Iterator[Open]:
    """Return a function that gives an open page of the demo, for tests that leave the scene as it is."""
    _open_pages.said.clear()
    yield _open_pages.get
    assert _open_pages.said == []


@pytest.fixture
def demo_dsn(_open_pages: OpenPages) -> str:
    """Return how to connect to the demo of the open pages, for tests that leave it as it is."""
    return _open_pages.dsn


@pytest.fixture
def open_page(browser: Browser, serve: Serve) -> Iterator[Open]:
    """Return a function that opens an address and waits until it is shown; no console error, no request to other sites.

    Pages are closed before the servers end: a page whose server is gone reports failed requests a second later.
    """
    said: list[str] = []
    with ExitStack() as contexts:

        def opened(address: str, *, size: tuple[int, int] = (900, 600), **options: Any) -> Page:
            return _open(browser, address, said, contexts, size, **options)

        yield opened
    assert said == []


def _open(
    browser: Browser,
    address: str,
    said: list[str],
    contexts: ExitStack,
    size: tuple[int, int],
    draws_map: bool = False,
    **options: Any,
) -> Page:
    """Open a page that says what it must not; `draws_map`: its pace and its picture are those that users have."""
    viewport = {"width": size[0], "height": size[1]}
    context = contexts.enter_context(browser.new_context(viewport=viewport, reduced_motion="reduce", **options))
    context.set_default_timeout(_MOST_MS)
    context.add_init_script(_IS_PATIENT)
    if not draws_map:
        context.add_init_script(DRAWS_NO_MAP)
    page = context.new_page()
    page.on("console", lambda message: _is_of_the_page(message) and said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    site = address.split("/", 3)[2]
    page.on("request", lambda request: _is_within(request.url, site) or said.append(f"asked {request.url}"))
    page.goto(address)
    page.wait_for_selector("html[data-ready=true]", state="attached", timeout=_MOST_MS)
    return page


def _is_of_the_page(message: ConsoleMessage) -> bool:
    """Whether a message is an error or a warning, other than the browser's note that it renders in software."""
    return message.type in ("error", "warning") and "GL Driver Message" not in message.text


def _is_within(url: str, site: str) -> bool:
    return url.startswith(("blob:", "data:")) or url.split("/", 3)[2] == site
