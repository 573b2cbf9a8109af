"""Fixtures of the tests of the command line."""

import pytest
from commands import Run, runner


@pytest.fixture
def run(dsn: str, capsys: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs one command on a database of its own."""
    return runner(dsn, capsys)
