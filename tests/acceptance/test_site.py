"""The documents as a site: built without a warning, complete, and without resources of other sites."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Resources that a page loads by itself; links for the reader to follow do not count.
LOADED = re.compile(
    r"""<(?:script|img|iframe|source)[^>]*\ssrc=["']?(?:https?:)?//|<link[^>]*\shref=["']?(?:https?:)?//"""
)


def build(config: Path, site: Path) -> subprocess.CompletedProcess[str]:
    """Build the site as `./run docs` does."""
    command = [sys.executable, "-m", "mkdocs", "build", "-f", str(config), "-d", str(site)]
    environment = {"NO_MKDOCS_2_WARNING": "1", "PATH": ""}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


@pytest.fixture
def docs(tmp_path: Path) -> Path:
    """Return a copy of some of the documents, with a menu of them."""
    docs = tmp_path / "docs"
    shutil.copytree(ROOT / "docs" / "site", docs / "site")
    (docs / "README.md").write_text("# Start\n\n[there](other.md#there)\n")
    (docs / "other.md").write_text("# Other\n\n## There\n")
    config = (docs / "site" / "mkdocs.yml").read_text()
    menu = "nav:\n  - README.md\n  - other.md\n"
    (docs / "site" / "mkdocs.yml").write_text(config[: config.index("nav:")] + menu)
    return docs


def test_the_site_is_built_of_all_documents_and_fetches_nothing(tmp_path: Path) -> None:
    done = build(ROOT / "docs" / "site" / "mkdocs.yml", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    pages = {page.relative_to(tmp_path).with_suffix("").as_posix() for page in tmp_path.rglob("*.html")}
    documents = {page.relative_to(ROOT / "docs").with_suffix("").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    assert pages == (documents - {"README"}) | {"index", "404", "CHANGELOG"}
    for page in tmp_path.rglob("*.html"):
        assert not LOADED.search(page.read_text()), page
    assert (tmp_path / "strait.svg").exists()


def test_broken_links_and_pages_that_no_menu_has_fail(docs: Path, tmp_path: Path) -> None:
    """Each is a warning of its own, and one is enough."""
    config = docs / "site" / "mkdocs.yml"
    assert build(config, tmp_path / "site").returncode == 0
    broken = {
        "gone.md": "[gone](gone.md)",
        "nowhere": "[no place](other.md#nowhere)",
        "gone.svg": "![no](gone.svg)",
    }
    (docs / "README.md").write_text("\n\n".join(["# Start", *broken.values()]))
    (docs / "forgotten.md").write_text("# Forgotten\n")
    done = build(config, tmp_path / "site")
    assert done.returncode == 1
    _, *warnings = done.stderr.split("WARNING")
    for says in (*broken, "forgotten.md"):
        assert len([warning for warning in warnings if says in warning]) == 1, done.stderr
    assert len(warnings) == len(broken) + 1
    (docs / "forgotten.md").unlink()
    (docs / "README.md").write_text(f"# Start\n\n{broken['nowhere']}\n")
    done = build(config, tmp_path / "site")
    assert (done.returncode, done.stderr.count("WARNING")) == (1, 1), done.stderr
