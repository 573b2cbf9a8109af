"""Directory of the real input of benchmarks and acceptance runs: CONFLICTDB_DATA, else next to the checkout."""

import os
import sys
from pathlib import Path


def real_input(*parts: str) -> Path:
    """Return the path of a file or folder of real input; ends the program, saying so, where it is not there."""
    folder = Path(os.environ.get("CONFLICTDB_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    path = folder.joinpath(*parts)
    if not path.exists():
        sys.exit(f"not run: {'/'.join(parts)} is not in {folder}; set CONFLICTDB_DATA to the folder that holds it")
    return path
