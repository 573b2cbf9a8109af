"""Packages import their public names at first use."""

from pathlib import Path

import pytest

import conflictdb
from conflictdb import formats, store
from conflictdb.exports import exports, offered


@pytest.mark.parametrize("package", [conflictdb, store, formats])
def test_everything_offered_is_there_and_no_module_hides_it(package: object) -> None:
    """A module of the same name would replace what the package offers as soon as anybody imports it."""
    folder = Path(package.__file__)
    names = {name for name, _ in offered(folder.read_text())}
    assert all(getattr(package, name) is not None for name in names)
    assert names.isdisjoint(path.stem for path in folder.parent.iterdir())


def test_an_unknown_name_is_an_attribute_error() -> None:
    get = exports("conflictdb.store", store.__file__)
    with pytest.raises(AttributeError, match=r"module 'conflictdb\.store' has no attribute 'solve'"):
        get("solve")
