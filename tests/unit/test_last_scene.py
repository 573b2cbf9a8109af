"""The scene that was last used in each database is remembered in one file for all databases."""

import json
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import pytest
from patience import WAIT_S

from conflictdb.cli import last_scene


def test_commands_at_once_remember_both_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One may begin while the other has read the file, and has not written it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    other, text_of = Thread(target=last_scene.remember, args=("b", "second")), json.dumps

    def meanwhile(known: dict[str, object], **options: Any) -> str:
        if not other.ident:
            other.start()
            other.join(0.5)
        return text_of(known, **options)

    with monkeypatch.context() as patched:
        patched.setattr(last_scene, "json", SimpleNamespace(loads=json.loads, dumps=meanwhile))
        last_scene.remember("a", "first")
        other.join(WAIT_S)
    assert [last_scene.recall(name) for name in "ab"] == ["first", "second"]
