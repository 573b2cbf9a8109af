"""Takes pictures of the page of `conflictdb map`, of the shipped scene: docs/map.png and docs/map-phone.png.

    ./run python docs/map_pictures.py

Needs Chromium, the developers' tools and the embedded database.
"""

import sys
import tempfile
from pathlib import Path
from typing import Final

from playwright.sync_api import sync_playwright

import conflictdb
from conflictdb.map.html import page as page_of

DOCS: Final = Path(__file__).resolve().parent
sys.path.append(str(DOCS.parent / "tests" / "support"))
from browsing import ARGUMENTS, chromium  # noqa: E402 (it is among the tests)

PICTURES: Final = (("map.png", (1280, 720), "light"), ("map-phone.png", (390, 780), "dark"))


def main() -> None:
    """Write the files."""
    with tempfile.TemporaryDirectory() as folder, conflictdb.connect() as db:
        db.load_demo()
        db.scene("strait").detect()
        file = Path(folder) / "strait.html"
        file.write_text(page_of(db.connection, "strait")[0])
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
            for name, (width, height), scheme in PICTURES:
                viewport = {"width": width, "height": height}
                page = browser.new_page(viewport=viewport, color_scheme=scheme, reduced_motion="reduce")
                page.goto(file.as_uri())
                page.wait_for_selector("html[data-ready=true]", state="attached", timeout=120_000)
                if name == "map.png":
                    page.get_by_role("button", name="FERRY and TOW").click()
                    page.evaluate("void conflictdbPage.view.map.jumpTo({center: [8.66, 57.97], zoom: 10.8})")
                else:
                    page.locator("#slider").press("PageUp")
                page.wait_for_timeout(1500)
                page.screenshot(path=DOCS / name)
            browser.close()


if __name__ == "__main__":
    main()
