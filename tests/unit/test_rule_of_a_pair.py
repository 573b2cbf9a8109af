"""The rule of a pair of pieces is stated once in SQL and once in C: no other file compares their columns."""

import re
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[2]
# Heights, spans, turn copies, classes and owners of two pieces, as one would compare them.
COMPARISONS: Final = {
    "sql": (
        r"\w+\.span\)? *&& *(_widened|\w+\.span)", r"_widened\([^)]*\) *&&",
        r"(\w+)\.floor_m\)? *<=? *\(?(?!\1)\w+\.ceiling_m", r"\b(\w+)\.ceiling_m\)? *>=? *\(?(?!\1\b)\w+\.floor_m",
        r"\w\.turn\)? *= *0 +OR", r"_are_compared\((?!smallint)", r"\w\.owner_number *(=|<>|!=) *\w+\.owner_number",
    ),
    "py": (
        r"floor_m\[\w+\] *<=? *\w*\.?\w*ceiling_m\[", r"ceiling_m\[\w+\] *>=? *\w*\.?\w*floor_m\[",
        r"turn\[\w+\] *[!=]= *0", r"owner_number\[\w+\] *[!=]=", r"class_number\[\w+\] *[!=]= *\w+\.class_number",
    ),
    "c": (
        r"floor_m\[\w+\] *<=? *\w+->ceiling_m\[", r"ceiling_m\[\w+\] *>=? *\w+->floor_m\[", r"is_copy\[\w+\] *&&",
        r"owner\[\w+\] *[!=]= *\w+->owner\[",
    ),
}  # fmt: skip
FOLDERS: Final = {"sql": "sql", "py": "conflictdb", "c": "conflictdb/kernel"}
# Where the rule is; _are_compared of 12_rules.sql is its part about classes and owners.
HOMES: Final = {"20_stage1_broad_phase.sql", "12_rules.sql", "may_meet.h"}


@pytest.mark.parametrize("language", COMPARISONS)
def test_no_other_file_compares_two_pieces(language: str) -> None:
    endings = {".c", ".h"} if language == "c" else {f".{language}"}
    files = [one for one in (ROOT / FOLDERS[language]).rglob("*") if one.suffix in endings]
    found = [
        f"{one.relative_to(ROOT)}:{number}: {line.strip()}"
        for one in files
        if one.name not in HOMES
        for number, line in enumerate(one.read_text().splitlines(), 1)
        for pattern in COMPARISONS[language]
        if re.search(pattern, line) and "COMMENT ON FUNCTION" not in line
    ]
    assert len(files) > 20
    assert found == []


def test_the_rule_itself_is_found() -> None:
    """By the same patterns, else they would find nothing."""
    rule = (
        (ROOT / "sql/20_stage1_broad_phase.sql").read_text(),
        (ROOT / "conflictdb/kernel/broad/may_meet.h").read_text(),
    )
    for language, text in zip(("sql", "c"), rule, strict=True):
        assert any(re.search(pattern, text) for pattern in COMPARISONS[language])
