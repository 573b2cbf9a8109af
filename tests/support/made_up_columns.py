"""A plugin of pytest that adds columns of each plain form to the table of columns of plans, and nothing else.

    PYTHONPATH=tests/support pytest -p made_up_columns tests/paths/test_borders.py tests/paths/test_stored_borders.py

The borders then carry plans with these columns. A process of its own: modules read the table when they are imported.
"""

import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from conflictdb.model import plan_columns
from conflictdb.model.plan_columns import TRACK, Form, PlanColumn
from conflictdb.model.rules import KINDS

_BOTH: Final = frozenset(KINDS)
MADE_UP: Final = (
    PlanColumn("cargo", _BOTH, Form.WORD, "text", "What it carries; null: nothing."),
    PlanColumn("draught_m", frozenset({TRACK}), Form.NUMBER, "double precision", "Depth below the water.", "m"),
    PlanColumn("remark_of_pilot", _BOTH, Form.TEXT, "text", "For people; null: none.", changes_answers=False),
    PlanColumn("papers", _BOTH, Form.DOCUMENT, "jsonb", "The papers of the ship; null: none.", changes_answers=False),
)
VALUES: Final[dict[str, Any]] = {
    "cargo": "gas & <oil>",
    "draught_m": 7.1,
    "remark_of_pilot": "Ümlaut",
    "papers": {"flag": "NO", "crew": [1, None, {"deep": "x"}]},
}
# Borders that hold what a standard, or a row for each position, has a place for, by name of the test or its parameter.
NOT_GENERIC: Final = {
    "positions": "columns of rows for each position: new words only",
    "test_field_that_no_border_knows_is_lost": "is about a field without a column",
}
plan_columns.PLAN_COLUMNS = (*plan_columns.PLAN_COLUMNS, *MADE_UP)  # type: ignore[misc]  # the one place

# The revision that a developer writes, before the routines of sql/.
_REVISION: Final = """
ALTER TABLE conflictdb.area {area};
ALTER TABLE conflictdb.track {track};
ALTER TYPE conflictdb.attached_plan {plan};
"""


def _made_sql(folder: Path) -> Path:
    """Write sql/ with the lists that `docs/plan_sql.py` makes of the table."""
    import plan_sql

    for file in plan_sql.SQL.glob("*.sql"):
        (folder / file.name).write_text(plan_sql.filled(file.read_text()))
    added = {
        kind: ", ".join(f"ADD COLUMN {one.name} {one.sql}" for one in MADE_UP if kind in one.kinds) for kind in KINDS
    }
    plan = ", ".join(f"ADD ATTRIBUTE {one.name} {one.sql}" for one in MADE_UP)
    (folder / "00_revision.sql").write_text(_REVISION.format(**added, plan=plan))
    return folder


@pytest.hookimpl(wrapper=True)
def pytest_sessionstart() -> Iterator[None]:
    """Let the borders know the values, and the schema the lists."""
    root = Path(__file__).parents[2]
    sys.path.insert(0, str(root / "docs"))
    import full_plans

    from conflictdb.jobs import schema
    from conflictdb.model.plans import Area

    made, former, specimens = _made_sql(Path(tempfile.mkdtemp())), schema._folder, full_plans.specimens
    schema._folder = lambda name: made if name == "sql" else former(name)
    for one in MADE_UP:
        for kind, values in zip(KINDS, (full_plans._AREA, full_plans._TRACK), strict=True):
            if kind in one.kinds:
                values[one.name] = VALUES[one.name]  # type: ignore[index]
    full_plans.specimens = lambda: [one for one in specimens() if VALUES.keys() & {*one.fields}]
    all_faults = full_plans.Border.faults
    # Fields that no such plan has are neither refused nor changed.
    full_plans.Border.faults = lambda self: (  # type: ignore[method-assign]
        one for one in all_faults(self) if not re.search("is listed, and kept$", one)
    )
    assert full_plans.values_of(Area)["cargo"] == VALUES["cargo"]
    return (yield)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out what is not generic."""
    items[:] = [one for one in items if not any(name in one.name for name in NOT_GENERIC)]
