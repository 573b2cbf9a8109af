"""Modules and classes of the package have names of their own, so that a name alone says where to look."""

import ast
from collections import Counter
from pathlib import Path

import conflictdb

FILES = sorted(Path(conflictdb.__file__).parent.rglob("*.py"))


def test_no_two_modules_have_one_name() -> None:
    counts = Counter(file.stem for file in FILES if file.name != "__init__.py")
    assert [name for name, count in counts.items() if count > 1] == []


def test_no_two_classes_have_one_name() -> None:
    counts = Counter(
        node.name for file in FILES for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in counts.items() if count > 1] == []
