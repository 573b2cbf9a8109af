"""The site of the documents from the disk, without a server: its search finds a page."""

import shutil
import subprocess
import sys
from pathlib import Path

from browsing import new_page
from playwright.sync_api import Browser, expect

ROOT = Path(__file__).resolve().parents[2]


def test_the_search_finds_a_page(browser: Browser, tmp_path: Path) -> None:
    docs, site = tmp_path / "docs", tmp_path / "site"
    shutil.copytree(ROOT / "docs" / "site", docs / "site")
    config = docs / "site" / "mkdocs.yml"
    settings = config.read_text()
    config.write_text(settings[: settings.index("nav:")])  # two pages are built in half the time of all
    (docs / "README.md").write_text("# Start\n")
    shutil.copy(ROOT / "docs" / "how-to" / "run-behind-pgbouncer.md", docs / "pooler.md")
    command = [sys.executable, "-m", "mkdocs", "build", "-q", "--no-strict", "-f", str(config), "-d", str(site)]
    subprocess.run(command, check=True, env={"NO_MKDOCS_2_WARNING": "1", "PATH": ""}, capture_output=True)
    with new_page(browser) as page:
        asked: list[str] = []
        page.on("request", lambda request: request.url.startswith(("file:", "data:")) or asked.append(request.url))
        page.goto((site / "index.html").as_uri())
        page.keyboard.press("/")
        page.keyboard.type("PgBouncer")
        expect(page.locator(".md-search-result__list")).to_contain_text("Run behind PgBouncer")
    assert asked == []
