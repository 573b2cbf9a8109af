"""Revisions change structure only, are numbered and named, and never change once another follows."""

import hashlib
import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from conflictdb.jobs import schema

VERSIONS = Path(schema.__file__).resolve().parents[2] / "migrations" / "versions"
FILES = sorted(VERSIONS.glob("*.py"))

# SHA-256 of every revision but the newest: databases have run them, so none ever changes. The newest may change until
# its release.
FROZEN: dict[str, str] = {
    "0001_create_conflictdb.py": "8ead14b7b5e7824f607a8be8c874224301d419332e27ca30f2451ca360959c16",
    "0002_doubt_old_answers.py": "fdb22e6c3d278546efda1a57219b635953bc512249e3418dbeb1d3291cd1a05d",
    "0003_add_heights_and_delays.py": "b0da0eb890f392c016f28c019bd47f1000ce044d757f41af6f56694b19f633f8",
    "0004_separate_in_time.py": "bb7a7914c3beb2c4232ec914d8e10853901d101f1dc11e83cb1dcb6cdccb97bc",
    "0005_keep_plans_as_written.py": "992d0e2126bcbc33f6ff7890da5da4f67840482bfb29906d9ba60451d8ff7267",
    "0006_replace_private_routines.py": "19adccc923c7de73e95b266535764d67e026d9d5c0561779aaf5fe8b05543041",
    "0007_carry_plans_in_requests.py": "384e6cc3eb9233a48b2338168041b3cdd1fdea5874a724fe71d595ae271e7089",
    "0008_count_attempts.py": "94feceb1e0750ffc3442472fda165ed26d8b4723c5df43da661219e6ee0ee86b",
    "0009_keep_edits.py": "ea779852d1bdbdaf0421313836315949dae3e35326096e6fa66e28117cc1b0d2",
    "0010_audit_edits.py": "28b0b70447c8bc4a9e998d2c557effaf35ed55a42f0747a9e2b5d2a4da9951d5",
    "0011_live_positions.py": "900fd7e4be6a22e2405fbcddd69ed992d012dcab77c6e1ff5439121372e8989c",
}


def module(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_name_is_number_verb_and_object(file: Path) -> None:
    assert re.fullmatch(r"\d{4}_[a-z]+(_[a-z0-9]+)+\.py", file.name)
    assert module(file).revision == file.name[:4]


def test_revisions_follow_one_another() -> None:
    modules = [module(file) for file in FILES]
    assert [m.revision for m in modules] == [f"{n:04}" for n in range(1, len(FILES) + 1)]
    assert [m.down_revision for m in modules] == [None, *(m.revision for m in modules[:-1])]
    assert schema.head() == modules[-1].revision


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_no_routine_view_or_trigger_is_made_by_a_revision(file: Path) -> None:
    """They have one source, sql/."""
    made = re.search(r"\b(CREATE|ALTER)\b[^;]*?\b(FUNCTION|PROCEDURE|VIEW|TRIGGER)\b", file.read_text(), re.IGNORECASE)
    assert made is None


def test_head_carries_the_hash_of_the_routines() -> None:
    """Whoever changes sql/ after a release adds a revision, so that databases in the field get the change."""
    assert module(FILES[-1]).routines_sha256 == schema.routines_sha256(), (
        f"sql/ changed: add a revision (or, before its release, mend {FILES[-1].name}) with "
        f'routines_sha256 = "{schema.routines_sha256()}"'
    )


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_a_revision_says_whether_answers_change(file: Path) -> None:
    """By a line of its own, which the upgrade reads: then every object is marked, else nothing is."""
    said = getattr(module(file), "changes_answers", None)
    assert isinstance(said, bool), (
        f"{file.name}: say changes_answers = True if a detection by this release (sql/, kernel, stages, reading) may "
        "find other conflicts, periods or points than one by the release before it, else changes_answers = False"
    )
    assert f"\nchanges_answers = {said}\n" in file.read_text()


def test_all_revisions_but_the_newest_are_frozen() -> None:
    assert {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in FILES[:-1]} == FROZEN


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_there_is_no_way_back(file: Path) -> None:
    with pytest.raises(NotImplementedError, match="DROP SCHEMA"):
        module(file).downgrade()


def test_files_of_sql_are_numbered_and_may_be_run_again() -> None:
    for file in schema.routine_files():
        assert re.fullmatch(r"\d\d_[a-z0-9_]+\.sql", file.name)
        code = re.sub(r"--.*", "", file.read_text())
        assert not re.search(r"^CREATE (FUNCTION|VIEW|TRIGGER|PROCEDURE|TABLE|SCHEMA)\b", code, re.MULTILINE)
        assert max(map(len, file.read_text().splitlines())) <= 120
    assert [f.name for f in schema.routine_files()] == sorted(
        f.name for f in (VERSIONS.parent.parent / "sql").iterdir()
    )
