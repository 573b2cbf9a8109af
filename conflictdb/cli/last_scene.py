"""Remember the scene that was last used in each database, in a file of the user's state directory."""

import fcntl
import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Final

# Databases remembered, the latest: a small file.
_MOST: Final = 200


def recall(database: str) -> str | None:
    """Return the scene last used in a database; None if it is unknown."""
    scene = _read().get(database)
    return scene if isinstance(scene, str) else None


def remember(database: str, scene: str) -> None:
    """Store the scene last used in a database; does nothing where the directory cannot be written."""
    if recall(database) == scene:
        return
    with suppress(OSError, RuntimeError):
        path = _path()
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with path.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # another command, in another database, keeps its scene
            known = _read()
            known.pop(database, None)
            latest = dict([*known.items(), (database, scene)][-_MOST:])
            new = path.with_suffix(".new")
            new.write_text(json.dumps(latest, indent=1), encoding="utf-8")
            new.replace(path)


def _path() -> Path:
    """Return the file, where the XDG base directory specification has it."""
    state = os.environ.get("XDG_STATE_HOME") or ""
    base = Path(state) if Path(state).is_absolute() else Path.home() / ".local" / "state"
    return base / "conflictdb" / "last-scene.json"


def _read() -> dict[str, object]:
    with suppress(OSError, ValueError, RuntimeError):  # unreadable, damaged, or a user without a home
        found = json.loads(_path().read_text(encoding="utf-8"))
        if isinstance(found, dict):
            return found
    return {}
