"""What is made by scripts in docs/ is up to date: pages of the reference, and the picture of the README."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


def script(name: str) -> ModuleType:
    """Return a script of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["cli", "python", "arrow"])
def test_page_is_up_to_date(name: str) -> None:
    """Otherwise: ./run python docs/generate.py."""
    assert (DOCS / "reference" / f"{name}.md").read_text() == getattr(script("generate"), name)()


def test_picture_is_up_to_date() -> None:
    """Otherwise: ./run python docs/picture.py."""
    assert (DOCS / "strait.svg").read_text() == script("picture").picture()


def test_every_public_name_has_a_section_and_a_docstring() -> None:
    text = (DOCS / "reference" / "python.md").read_text()
    import conflictdb

    for name in conflictdb.__all__:
        if name != "__version__":
            assert f"\n### {name}\n" in text
            assert getattr(conflictdb, name).__doc__
