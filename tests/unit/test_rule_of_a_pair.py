"""The rule of a pair of pieces is stated once in SQL and once in C: no other file compares their columns.

`./run test -q tests/unit/test_rule_of_a_pair.py` counts: two statements and the oracle, which
tests/contract/test_may_meet.py compares.
"""

import re
from pathlib import Path
from typing import Final

import pytest

from conflictdb.kernel import build

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
        r"turn\[\w+\] *[!=]= *0", r"numbers\[\w+, *\w+\] *[!=]=", r"class_number\[\w+\] *[!=]= *\w+\.class_number",
        r"start_us\[(\w+)\] *<=? *\w*\.?\w*end_us\[(?!\1\])", r"\bowners?\[\w+\] *[!=]= *\w*\.?owners?\[",
        r"of_types\[[^\]]+\] *[!=]=",
    ),
    "c": (
        r"floor_m(\[\w+\])? *<=? *\w+(->|\.|_)ceiling_m", r"ceiling_m(\[\w+\])? *>=? *\w+(->|\.|_)floor_m",
        r"if .*is_copy(\[\w+\])? *&& *!?\w+(->|\.)is_copy", r"\[([A-Z]+)\] *[!=]= *\w+\[\1\]",
        r"of_types\[[^\]]*type", r"\b(times|heights)_meet\(",
    ),
    "js": (
        r"floor\w*\[(\w+)\] *<=? *\w*\.?ceiling\w*\[(?!\1\])", r"ceiling\w*\[(\w+)\] *>=? *\w*\.?floor\w*\[(?!\1\])",
        r"turn\[(\w+)\] *[!=]==? *0 *(&&|\|\|).*turn\[(?!\1\])", r"numbers\[.*\] *[!=]==? .*numbers\[",
        r"start\w*\[(\w+)\] *<=? *\w*\.?end\w*\[(?!\1\])", r"of_types\[.*\]\[.*\] *(<|>=|[!=]==?)",
    ),
}  # fmt: skip
FOLDERS: Final = {"sql": "sql", "py": "conflictdb", "js": "conflictdb/map/page"}
# Where the rule is; _are_compared of 12_rules.sql is its part about classes and owners.
HOMES: Final = {"20_stage1_broad_phase.sql", "12_rules.sql", "may_meet.h"}
# Comparisons as they were written once, which the patterns find.
FORMER: Final = {
    "py": (
        "found = (owners[0] == owners[1]) & (owners[0] != 0)", "meet = pieces.floor_m[a] < pieces.ceiling_m[b]",
        "both = pieces.start_us[a] <= pieces.end_us[b]", "keep = self.of_types[one, other] != NEVER",
    ),
    "js": (
        "floor[a] < ceiling[b]", "this.start[a] <= this.end[b]", "pack.numbers[a] === pack.numbers[b]",
        "turn[a] === 0 || turn[b] === 0", "pack.of_types[type[a]][type[b]] >= 0",
    ),
}  # fmt: skip


@pytest.mark.parametrize("language", COMPARISONS)
def test_no_other_file_compares_two_pieces(language: str) -> None:
    files = build.sources() if language == "c" else [*(ROOT / FOLDERS[language]).rglob(f"*.{language}")]
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
    rule = (ROOT / "sql/20_stage1_broad_phase.sql").read_text()
    assert any(re.search(pattern, rule) for pattern in COMPARISONS["sql"])
    rule = (ROOT / "conflictdb/kernel/broad/may_meet.h").read_text()
    assert [pattern for pattern in COMPARISONS["c"] if not re.search(pattern, rule)] == [COMPARISONS["c"][1]]
    for language, lines in FORMER.items():
        for line in lines:
            assert any(re.search(pattern, line) for pattern in COMPARISONS[language]), line
