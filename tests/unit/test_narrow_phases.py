"""The kernel has three narrow phases; all other questions are put to one of them.

    grep -lE "work->\\w+\\+\\+" conflictdb/kernel/narrow/*.c

lists the files that count work, so that search: those of `PHASES`, and encounter.c, which all share.
"""

import re
from typing import Final

from conflictdb.kernel import build

PHASES: Final = {
    "contacts": {"certain.c", "proofs.c", "search.c", "zone.c"},
    "differences": {"differences.c", "shift.c"},
    "approaches": {"approach.c", "approach_bounds.c"},
}
SHARED: Final = {"encounter.c"}
# Files whose questions are about two times, and what they ask.
ASKERS: Final = {
    "kernel/narrow/uses.c": "differences_begin(",
    "core/factors_within.py": "difference_parts(",
    "core/delays.py": "difference_parts(",
    "core/speeds.py": "difference_parts(",
    "core/uses_of_tracks.py": "near_in_time(",
}


def test_three_narrow_phases_search() -> None:
    found = {one.name for one in build.sources() if re.search(r"\bwork->\w+\+\+", one.read_text())}
    assert found == SHARED.union(*PHASES.values())


def test_questions_about_two_times_are_put_to_differences() -> None:
    room = build.HERE.parent
    for file, asked in ASKERS.items():
        assert asked in (room / file).read_text(), file
