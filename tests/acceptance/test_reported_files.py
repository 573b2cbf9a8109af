"""Files as people have them, after reports to other programs: right values, or a sentence that names the way out.

`reports/cases.json` lists them. A case is right if one of its `accept` fits: the conflicts (`only`: and no others),
their number, periods at some instants, or words of a refusal (`rc`) or a remark, apart from names of files.
"""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from commands import Outcome, runner

REPORTS = Path(__file__).parent / "reports"
CASES = json.loads((REPORTS / "cases.json").read_text())


def us(text: str) -> float:
    return datetime.fromisoformat(text).astimezone(UTC).timestamp()


def is_right(accept: dict[str, Any], found: list[dict[str, Any]], last: Outcome, said: str) -> bool:
    """Return whether conflicts, or what the commands said, are acceptable."""
    if "says" in accept:
        return last.code == accept.get("rc", last.code) and any(word in said for word in accept["says"])
    if last.code != 0:
        return False
    if "count" in accept:
        return len(found) == accept["count"]
    if "period_at" in accept:
        spans = [(us(start), us(end)) for one in found for start, end in one["periods"]]
        return all(any(start <= us(at) <= end for start, end in spans) for at in accept["period_at"])
    rows = {frozenset((one["a_key"], one["b_key"])): one["periods"] for one in found}
    wanted = {frozenset((one["a"], one["b"])): one for one in accept["conflicts"]}
    if accept.get("only") and rows.keys() != wanted.keys():
        return False
    return all(
        pair in rows
        and abs(us(rows[pair][0][0]) - us(one["first"])) <= one["tol_s"]
        and abs(us(rows[pair][-1][1]) - us(one["last"])) <= one["tol_s"]
        for pair, one in wanted.items()
    )


@pytest.mark.parametrize("case", CASES, ids=[case["name"] for case in CASES])
def test_a_reported_file_is_right_or_says_why_not(
    case: dict[str, Any], dsn: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = runner(dsn, capsys)
    steps = case.get("steps") or [["detect", *case["files"], *case["options"]]]
    said = ""
    for step in steps:
        words = [REPORTS / word if (REPORTS / word).exists() else word for word in step]
        last = run(*words, "--scene", "S")
        said += last.out + last.err
    found = run("conflicts", "--scene", "S", "--format", "json")
    rows = found.json if found.code == 0 else []
    for path in REPORTS.iterdir():
        said = said.replace(str(path), "FILE").replace(path.name, "FILE")
    assert any(is_right(accept, rows, last, said) for accept in case["accept"]), (said, rows)
