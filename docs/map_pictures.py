"""Takes pictures of the page of `conflictdb map`, of the strait: map.png, map-phone.png, and map.webp, which plays.

    ./run python docs/map_pictures.py

Needs Chromium, the developers' tools and the embedded database.
"""

import io
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal

from PIL import Image
from playwright.sync_api import Page, ViewportSize, sync_playwright

import conflictdb
from conflictdb.map.html import page as page_of

DOCS: Final = Path(__file__).resolve().parent
sys.path.append(str(DOCS.parent / "tests" / "support"))
from browsing import ARGUMENTS, chromium  # noqa: E402 (it is among the tests)

_Scheme = Literal["light", "dark"]
PICTURES: Final[tuple[tuple[str, tuple[int, int], _Scheme], ...]] = (
    ("map.png", (1280, 720), "light"),
    ("map-phone.png", (390, 780), "dark"),
)
FRAME_MS: Final = 125
FRAMES: Final = 48  # six seconds
DELAYS: Final = 14  # minutes


def main() -> None:
    """Write the files."""
    with tempfile.TemporaryDirectory() as folder, conflictdb.connect() as db:
        db.load_demo()
        db.scene("strait").detect()
        file = Path(folder) / "strait.html"
        file.write_text(page_of(db.connection, "strait")[0])
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)

            def opened(width: int, height: int, scheme: _Scheme) -> Page:
                viewport: ViewportSize = {"width": width, "height": height}
                page = browser.new_page(viewport=viewport, color_scheme=scheme, reduced_motion="reduce")
                page.goto(file.as_uri())
                page.wait_for_selector("html[data-ready=true]", state="attached", timeout=120_000)
                return page

            for name, size, scheme in PICTURES:
                page = opened(*size, scheme)
                if name == "map.png":
                    page.get_by_role("button", name="FERRY and TOW").click()
                    page.evaluate("void conflictdbPage.view.map.jumpTo({center: [8.66, 57.97], zoom: 10.8})")
                else:
                    page.locator("#slider").press("PageUp")
                page.wait_for_timeout(1500)
                page.screenshot(path=DOCS / name)
            first, *others = (Image.open(io.BytesIO(frame)) for frame in frames(opened(1280, 720, "light")))
            first.save(
                DOCS / "map.webp", save_all=True, append_images=others, duration=FRAME_MS, loop=0, quality=40, method=6
            )
            browser.close()


def frames(page: Page) -> Iterator[bytes]:
    """Yield pictures: the scene plays, a conflict is chosen, and its ferry departs later until the conflict is gone."""
    move = "(one, at) => { one.value = at; one.dispatchEvent(new Event('input', {bubbles: true})); }"
    slider, plays = page.locator("#slider"), FRAMES - DELAYS - 6
    low, high = (float(slider.get_attribute(end) or 0) for end in ("min", "max"))
    for n in range(plays):
        slider.evaluate(move, low + (high - low) * (0.15 + 0.5 * n / plays))
        yield shown(page)
    page.get_by_role("button", name="FERRY and TOW").click()
    page.get_by_role("button", name="What if FERRY departs earlier or later").click()
    page.locator(".what-if .said", has_text="As planned").wait_for()
    page.evaluate("void conflictdbPage.view.map.jumpTo({center: [8.7, 57.95], zoom: 9.8})")
    departure = page.get_by_role("slider", name="Departure")
    for _ in range(3):
        yield shown(page)
    for n in range(1, DELAYS + 1):
        departure.evaluate(move, 60 * n)
        yield shown(page)
    for _ in range(3):
        yield shown(page)


def shown(page: Page) -> bytes:
    """Return a picture of the page when its map is drawn."""
    page.wait_for_timeout(150)
    return page.screenshot()


if __name__ == "__main__":
    main()
