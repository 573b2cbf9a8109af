"""Releases: the bill of materials, the notes, what is still lacking, and that two builds are equal to the bit."""

import contextlib
import hashlib
import json
import re
from pathlib import Path

import pytest

import release
import sbom

ROOT = Path(__file__).parents[2]


def test_the_bill_names_every_pin_and_no_address() -> None:
    """Each package once, with the digests of its files; those of run time are required."""
    text = sbom.text()
    bill = json.loads(text)
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    components = {one["bom-ref"]: one for one in bill["components"]}
    assert len(components) == len(bill["components"])
    for file, scopes in (("requirements.txt", {"required"}), ("requirements-extras.txt", {"required", "optional"})):
        pinned = re.findall(r"^([\w.-]+)==([^\s;]+)", (ROOT / file).read_text(), re.MULTILINE)
        assert len(pinned) > 20
        for name, version in pinned:
            assert components[f"pkg:pypi/{name.lower()}@{version}"]["scope"] in scopes
    for digest in re.findall(r"sha256:(\w+)", (ROOT / "requirements.txt").read_text()):
        assert digest in text
    assert "://" not in text
    assert {f"pkg:npm/{name}@" for name in json.loads(sbom.VENDORED.read_text())} == {
        re.sub("@.*", "@", name) for name in components if name.startswith("pkg:npm/")
    }
    [whole] = bill["dependencies"]
    assert set(whole["dependsOn"]) == set(components)
    assert text == sbom.text(), "the same files give the same bytes"


def test_notes_are_the_section_of_the_version() -> None:
    changelog = "# Changelog\n\n## 0.2.0 (unreleased)\n\n- more\n\n## 0.1.0 (2026-12-01)\n\n- first\n"
    assert release.notes(changelog, "0.2.0") == ("unreleased", "- more\n")
    assert release.notes(changelog, "0.1.0") == ("2026-12-01", "- first\n")
    with pytest.raises(release.Refused, match=r"no section 0\.3\.0"):
        release.notes(changelog, "0.3.0")
    assert release.notes((ROOT / "CHANGELOG.md").read_text(), release.version())[1]


def test_what_is_lacking_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """A date, a commit and a tag; with all of them nothing."""
    monkeypatch.setattr(release, "_git", lambda *words: {"status": " M a", "tag": "v0.0.9"}[words[0]])
    assert len(release.lacking("0.1.0", "unreleased")) == 3
    monkeypatch.setattr(release, "_git", lambda *words: {"status": "", "tag": "v0.0.9\nv0.1.0"}[words[0]])
    assert release.lacking("0.1.0", "2026-12-01") == []


def test_a_dry_run_makes_all_files_but_wheels_of_other_platforms(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Built twice from the last commit, with equal bytes; it uploads nothing. Wheels: test_wheels.py."""
    if not (ROOT / ".git").exists():
        pytest.skip("a release is made from a commit, and this is no clone")
    monkeypatch.setattr(release, "TARGETS", ())
    monkeypatch.setattr(release.build, "zig", lambda: contextlib.nullcontext(["none"]))
    monkeypatch.setattr("sys.argv", ["release", "--dry-run", str(tmp_path / "dist")])
    trees, export = [], release._export

    def exported(tree: Path, commit: str) -> None:
        trees.append(commit)
        export(tree, commit)

    monkeypatch.setattr(release, "_export", exported)
    assert release.main() == 0
    # Whatever is committed meanwhile.
    assert len(trees) == 2
    assert len(set(trees)) == 1
    assert re.fullmatch("[0-9a-f]{40,}", trees[0])
    of = release.version()
    made = {f"conflictdb-{of}.tar.gz", f"conflictdb-{of}.cdx.json", "notes.txt"}
    sums = (tmp_path / "dist/SHA256SUMS").read_text().splitlines()
    assert {line.partition("  ")[2] for line in sums} == made
    for line in sums:
        digest, _, name = line.partition("  ")
        assert digest == hashlib.sha256((tmp_path / "dist" / name).read_bytes()).hexdigest()
    assert "before the upload: " in capsys.readouterr().out
    assert release.main() == 1
    assert "is not empty" in capsys.readouterr().err


def test_without_tag_nothing_is_built_or_uploaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(release, "lacking", lambda of, date: ["tag the commit"])
    monkeypatch.setattr("sys.argv", ["release", str(tmp_path / "dist")])
    assert release.main() == 1
    assert capsys.readouterr().err == "release: tag the commit\n"
    assert not (tmp_path / "dist").exists()
