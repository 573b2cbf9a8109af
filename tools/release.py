"""Make the files of a release from the last commit, build them twice and compare, and upload them.

    ./run release --dry-run [DIRECTORY]    # all but the upload, into DIRECTORY (default: dist)
    ./run release [DIRECTORY]              # the commit has its tag: all, and the upload by `twine`, which you install

Makes the source archive, the wheels, the bill of materials, the notes and the digests. Archive and wheels are built
twice, in two directories, and have to be equal to the bit.
"""

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from build_wheels import TARGETS, build_archive, build_wheel
from conflictdb.kernel import build
from sbom import text

ROOT = Path(__file__).resolve().parents[1]


class Refused(Exception):
    """A release is not ready; the message says what to do."""


def version() -> str:
    """Return the version of pyproject.toml."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        return str(tomllib.load(file)["project"]["version"])


def notes(changelog: str, of: str) -> tuple[str, str]:
    """Return the date of a version, or `unreleased`, and its section of the changelog."""
    found = re.search(rf"^## {re.escape(of)} \(([^)]*)\)\n(.*?)(?=^## |\Z)", changelog, re.DOTALL | re.MULTILINE)
    if found is None:
        raise Refused(f"CHANGELOG.md has no section {of}: add `## {of} (DATE)`")
    return found[1], found[2].strip() + "\n"


def lacking(of: str, date: str) -> list[str]:
    """Return what a person still has to do before the upload."""
    found = []
    if not re.fullmatch(r"\d{4}-\d\d-\d\d", date):
        found.append(f"CHANGELOG.md: write the date in place of {date!r}")
    if _git("status", "--porcelain"):
        found.append("commit what differs from the last commit (git status)")
    if f"v{of}" not in _git("tag", "--points-at", "HEAD").split():
        found.append(f"tag the commit: git tag -a v{of} -F notes.txt")
    return found


def make(directory: Path, of: str, said: str) -> list[Path]:
    """Make all files of a release of the last commit in a directory, and return them."""
    directory.mkdir(parents=True, exist_ok=True)
    if any(directory.iterdir()):
        raise Refused(f"{directory} is not empty: name another directory, or empty it")
    # A commit that is made meanwhile must not get into the second build.
    commit = _git("rev-parse", "HEAD")
    environ = {**os.environ, "SOURCE_DATE_EPOCH": _git("log", "-1", "--format=%ct", commit)}
    with tempfile.TemporaryDirectory() as name, build.zig() as compiler:
        again = Path(name, "again")
        for made_in, tree in ((directory, Path(name, "tree")), (again, Path(name, "another directory"))):
            _export(tree, commit)
            build_archive("sdist", made_in, tree, environ)
            for target in TARGETS:
                build_wheel(compiler, target, made_in, tree, environ)
        files = sorted(directory.iterdir())
        differ = [one.name for one in files if digest(one) != digest(again / one.name)]
        if differ:
            raise Refused(f"two builds differ: {', '.join(differ)}")
    (directory / f"conflictdb-{of}.cdx.json").write_text(text())
    (directory / "notes.txt").write_text(said)
    files = sorted(directory.iterdir())
    (directory / "SHA256SUMS").write_text("".join(f"{digest(one)}  {one.name}\n" for one in files))
    return [*files, directory / "SHA256SUMS"]


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _export(tree: Path, commit: str) -> None:
    tree.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
    subprocess.run(["tar", "-x"], cwd=tree, input=archive, check=True)


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def main() -> int:
    """Make a release; upload it unless --dry-run is given."""
    parser = argparse.ArgumentParser(prog="./run release", description="Make the files of a release.")
    parser.add_argument("--dry-run", action="store_true", help="all but the upload")
    parser.add_argument("directory", nargs="?", type=Path, default=Path("dist"), help="default: dist")
    args = parser.parse_args()
    of = version()
    try:
        date, said = notes((ROOT / "CHANGELOG.md").read_text(), of)
        still = lacking(of, date)
        if not args.dry_run:
            if still:
                raise Refused("; ".join(still))
            if shutil.which("twine") is None:
                raise Refused("install twine, which uploads: pip install twine")
        files = make(args.directory.resolve(), of, said)
    except Refused as error:
        sys.stderr.write(f"release: {error}\n")
        return 1
    for one in files:
        sys.stdout.write(f"{one}\n")
    for line in still:
        sys.stdout.write(f"before the upload: {line}\n")
    if args.dry_run:
        return 0
    built = [str(one) for one in files if one.name.endswith((".whl", ".tar.gz"))]
    return subprocess.run(["twine", "upload", *built], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
