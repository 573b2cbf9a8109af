"""The figures of the paper and the trade are drawn with what `./run` installs, without the developers' tools."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def names(file: str) -> set[str]:
    """Return the packages that a file of requirements pins."""
    text = (ROOT / file).read_text()
    return {name.lower().replace("-", "_") for name in re.findall(r"^([A-Za-z0-9_.-]+)==", text, re.MULTILINE)}


@pytest.mark.parametrize("script", ["study", "trade"])
def test_a_study_imports_what_every_installation_has(script: str) -> None:
    lacking = sorted(names("requirements-dev.txt") - names("requirements.txt"))
    assert "mpmath" in lacking
    run = (
        f"import sys; sys.modules.update(dict.fromkeys({lacking!r})); sys.path.insert(0, 'benchmarks'); import {script}"
    )
    done = subprocess.run([sys.executable, "-c", run], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
