"""Work in several processes: every answer comes, errors are those of the work, nothing lives on."""

import math
import os
import time
from contextlib import closing

import pytest

from conflictdb.pipeline.processes import computed


def test_every_job_is_answered() -> None:
    """More jobs than processes, and more processes than jobs."""
    for jobs, count in ((7, 2), (1, 2), (0, 2)):
        with closing(computed(math.factorial, ((n,) for n in range(jobs)), count)) as answers:
            assert sorted(answers) == [(n, math.factorial(n)) for n in range(jobs)]


def test_an_error_is_that_of_the_work_and_says_where() -> None:
    answers = computed(math.sqrt, [(-1.0,)], 1)
    with pytest.raises(ValueError, match="math domain error") as raised:
        next(answers)
    assert "work(*job)" in raised.value.__notes__[0]


def test_a_killed_process_is_an_error() -> None:
    answers = computed(os._exit, [(9,)], 1)
    with pytest.raises(ChildProcessError, match="code 9"):
        next(answers)


def test_closing_ends_what_is_under_way() -> None:
    start = time.monotonic()
    with closing(computed(time.sleep, [(0.0,), (600.0,)], 2)) as answers:
        assert next(answers) == (0, None)
    assert time.monotonic() - start < 60.0
