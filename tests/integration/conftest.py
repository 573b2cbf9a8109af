"""Fixtures of integration tests: one Spark, which starts in some ten seconds."""

from collections.abc import Iterator

import pytest
from spark_answers import Spark, running_spark


@pytest.fixture(scope="session")
def spark() -> Iterator[Spark]:
    """Return Spark; its tests are of group `spark`, so that one worker runs it."""
    with running_spark() as found:
        yield found
