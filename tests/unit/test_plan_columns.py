"""The table of the columns of a plan, and what is made from it."""

from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import pytest
from docs_scripts import script

from conflictdb.arrays.column_numbers import IN_PIECES, NUMBERED, number_of
from conflictdb.kernel.header import constant
from conflictdb.model import plan_columns
from conflictdb.model.plan_columns import Form, columns_of
from conflictdb.model.plans import Area, Track
from conflictdb.model.rules import KINDS

plan_sql = script("plan_sql")


@pytest.mark.parametrize("path", sorted(plan_sql.SQL.glob("*.sql")), ids=lambda path: path.name)
def test_lists_in_sql_are_those_of_the_table(path: Path) -> None:
    text = path.read_text()
    assert plan_sql.filled(text) == text, "run docs/plan_sql.py"


@pytest.mark.parametrize(("kind", "of"), [(plan_columns.AREA, Area), (plan_columns.TRACK, Track)])
def test_each_field_of_a_plan_is_of_one_column(kind: str, of: type) -> None:
    named = [name for column in columns_of(kind) for name in column.python]
    assert sorted(named) == sorted({field.name for field in fields(of)} - {"key", "legs"})
    # Type checkers know them all.
    assert set(named) <= get_type_hints(of).keys()


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_of_pieces_are_the_first_of_both_kinds(kind: str) -> None:
    """`piece_numbers` finds them by their places, and the kernel knows how many there are."""
    assert tuple(f"{one.name}_number" for one in NUMBERED[kind])[: len(IN_PIECES)] == IN_PIECES
    assert constant("KERNEL_NUMBERS") == len(IN_PIECES)


def test_numbers_of_numbers_have_their_order() -> None:
    """The rule of a pair may compare them."""
    values = [0.0, 5e-324, 1.0, 7.1, 1e300, None]
    numbers = [number_of(value, Form.NUMBER) for value in values]
    assert numbers == sorted(set(numbers))
    assert number_of(-0.0, Form.NUMBER) == numbers[0]


def test_each_plain_value_has_a_rule() -> None:
    for column in plan_columns.PLAN_COLUMNS:
        assert column.rules([None]) == {}
        if column.check is not plan_columns.in_its_plan:
            assert column.form is not Form.OWN
            assert "got" in str(column.rules([object()])) or "JSON" in str(column.rules([object()]))
