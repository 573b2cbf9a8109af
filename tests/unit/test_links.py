"""Targets of documents exist: linked pages and headings, and files that they name."""

import re
import unicodedata
from collections import Counter
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
FOLDERS = ("benchmarks", "conflictdb", "docs", "migrations", "sql", "tests")


def prose(path: Path) -> str:
    """Return a document without its blocks of code."""
    return re.sub(r"^ *```.*?^ *```$", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)


def anchors(path: Path) -> set[str]:
    """Return the anchors that GitHub makes of a document's headings."""
    seen: Counter[str] = Counter()
    found = set()
    for title in re.findall(r"^#{1,6} +(.+?)\s*$", prose(path), flags=re.MULTILINE):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).replace("`", "").lower()
        kept = (c for c in text if c in " -_" or unicodedata.category(c)[0] in "LN")
        slug = "".join(kept).replace(" ", "-")
        found.add(f"{slug}-{seen[slug]}" if seen[slug] else slug)
        seen[slug] += 1
    return found


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(document: Path) -> None:
    """Every relative link leads to an existing file, and to a heading of it."""
    for target, anchor in re.findall(r"\]\((?!\w+:)([^)#]*)#?([^)]*)\)", prose(document)):
        path = (document.parent / target).resolve() if target else document
        assert path.exists(), target
        if anchor:
            assert anchor in anchors(path), f"{target}#{anchor}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_are_named_are_there(document: Path) -> None:
    """A path in code style, or in a command, exists if it begins with a folder of the tree."""
    for folder in FOLDERS:
        for path in re.findall(rf"(?<![\w/.$~-]){folder}/[\w./-]*\w", document.read_text()):
            is_start = path.endswith("_")  # of a name, as sql/20_ is
            assert (ROOT / path).exists() or (is_start and list(ROOT.glob(f"{path}*"))) or "NNNN" in path, path


def is_python(name: str) -> bool:
    """Return whether a dotted name is a module, a thing in one, or a name that a package gives."""
    place = ROOT
    for part in name.split("."):
        if (place / f"{part}.py").exists():
            return True
        if not (place / part).is_dir():
            return hasattr(import_module(".".join(place.relative_to(ROOT).parts)), part)
        place /= part
    return True


def test_modules_and_files_that_sources_name_are_there() -> None:
    """Comments, docstrings and strings follow when a module moves."""
    files = [f"/{path.relative_to(ROOT)}" for folder in FOLDERS for path in (ROOT / folder).rglob("*.*")]
    known = [*files, *(f"/{path.relative_to(ROOT)}" for path in (ROOT / "examples").rglob("*.*"))]
    rooms = {path.name for path in (ROOT / "conflictdb").iterdir() if (path / "__init__.py").exists()}
    wrong = []
    for path in (ROOT / file[1:] for file in files if file.endswith((".py", ".c", ".h", ".sql"))):
        text = path.read_text()
        names = re.findall(r"(?<![\w./-])conflictdb(?:\.[A-Za-z_][A-Za-z_0-9]*)+", text)
        lost = [name for name in names if name.split(".")[1] in rooms and not is_python(name)]
        paths = re.findall(r"(?<![\w./{}*<-])(?:[a-z_0-9]+/)+[a-z_0-9]+\.(?:py|c|h|sql)\b", text)
        lost += [name for name in paths if not any(file.endswith(f"/{name}") for file in known)]
        wrong += [f"{path.relative_to(ROOT)}: {name}" for name in lost]
    assert wrong == []
