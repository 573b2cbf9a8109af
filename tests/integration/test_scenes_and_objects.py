"""List, rename, copy and delete scenes and objects: on the command line, in Python and in SQL."""

from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from commands import STRAIT, Run, runner
from psycopg import conninfo, sql

import conflictdb
from conflictdb import InvalidInput


def names(run: Run) -> list[str]:
    return [line.split()[0] for line in run("scenes").out.splitlines()[1:]]


def test_scenes_and_objects_are_listed(run: Run) -> None:
    assert "no scenes" in run("scenes").out
    run("load", STRAIT)
    assert run("scenes").out.splitlines()[1].split()[:5] == ["strait", "4", "7", "11", "0"]
    table = run("objects", "--scene", "strait").out.splitlines()
    assert table[0].split() == ["KEY", "KIND", "NAME", "FROM", "(UTC)", "TO", "(UTC)", "FLOOR", "M", "CEILING", "M"]
    keys = [line.split()[0] for line in table[1:]]
    assert keys == sorted(keys)
    assert len(keys) == 11
    rows = {row["key"]: row for row in run("objects", "--scene", "strait", "--format", "json").json}
    assert rows["FERRY"]["kind"] == "track"
    assert rows["FERRY"]["start_at"] == "2026-06-01T07:15:00.000000Z"
    assert "2026-06-01 09:15:00+02:00" in run("objects", "--scene", "strait", "--tz", "Europe/Copenhagen").out
    assert run("objects", "--scene", "nowhere").code == 4


def test_a_scene_is_renamed_with_its_conflicts(run: Run) -> None:
    run("detect", STRAIT)
    before = run("conflicts", "--scene", "strait", "--format", "json").json
    assert run("rename", "sound", "--scene", "strait").out == "strait is now sound\n"
    after = run("conflicts", "--format", "json").json  # the renamed scene is the last used
    assert [row | {"scene": "strait"} for row in after] == before
    assert {row["scene"] for row in after} == {"sound"}
    assert len(run("history", "--scene", "sound", "--format", "json").json) == len(before)
    run("load", STRAIT)
    taken = run("rename", "sound", "--scene", "strait")
    assert (taken.code, "is taken by another scene" in taken.err) == (4, True)
    assert run("rename", " ", "--scene", "strait").code == 4


def test_an_object_is_renamed_and_waits_for_detection(run: Run) -> None:
    run("detect", STRAIT)
    assert run("rename", "FERRY", "STENA", "--scene", "strait").out == "strait: FERRY (Ferry) is now STENA\n"
    outdated = run("conflicts", "FERRY", "--scene", "strait").out
    assert outdated.count("conflict (outdated)") == 3
    run("detect", "--scene", "strait")
    assert run("conflicts", "FERRY", "--scene", "strait").code == 4
    assert run("conflicts", "STENA", "--scene", "strait").out.count("\n") == 4
    for wrong, message in (
        (("STENA", "TOW"), "is taken by another object"),
        (("nobody", "X"), "is no object of scene"),
    ):
        done = run("rename", *wrong, "--scene", "strait")
        assert (done.code, message in done.err) == (4, True), done.err
    assert run("rename", "STENA", "DIVING", "--scene", "strait").code == 4  # taken by an object of the other kind


def test_a_copy_finds_the_same_and_is_its_own(run: Run) -> None:
    run("detect", STRAIT, "--separation-m", "400")
    assert run("copy", "trial", "--scene", "strait").out == "trial: 11 objects of strait, to be detected\n"
    copied = run("detect", "--scene", "trial", "--format", "json").json
    original = run("conflicts", "--scene", "strait", "--format", "json").json
    assert [(row["a_key"], row["b_key"], row["periods"]) for row in copied] == [
        (row["a_key"], row["b_key"], row["periods"]) for row in original
    ]
    run("delete", "FERRY", "--scene", "trial")
    assert "FERRY" in run("objects", "--scene", "strait").out
    assert run("copy", "trial", "--scene", "strait").code == 4
    exported = [run("export", "--scene", scene, "-").json["scene"] for scene in ("strait", "trial")]
    assert exported[0] | {"name": "trial"} == exported[1]


def test_objects_are_deleted_all_or_none_and_scenes_only_by_name(run: Run) -> None:
    run("detect", STRAIT)
    assert run("delete", "FERRY", "nobody", "--scene", "strait").code == 4
    assert "FERRY" in run("objects", "--scene", "strait").out
    assert run("delete", "FERRY", "TOW", "--scene", "strait").out == (
        "strait: 2 deleted: FERRY (Ferry), TOW (Tug with a barge on a l…)\n"
    )
    assert "conflict (outdated)" in run("conflicts", "FERRY", "--scene", "strait").out
    for unclear in (("delete",), ("delete", "--all"), ("delete", "--scene", "strait"), ("delete", "X", "--all")):
        assert run(*unclear).code == 2
    assert names(run) == ["strait"]
    assert run("delete", "--scene", "strait", "--all").out == "strait: deleted\n"
    assert run("delete", "--scene", "strait", "--all").code == 4
    assert "no scenes" in run("scenes").out


def test_python_does_the_same(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        scene = db.load(STRAIT)
        assert next(iter(scene.objects())).key == "CABLE"
        scene.rename("sound")
        assert scene.name == "sound"
        copied = scene.copy("trial")
        copied.rename_object("FERRY", "STENA")
        copied.delete_objects("TOW", "CABLE")
        with pytest.raises(InvalidInput, match="is no object"):
            copied.delete_objects("SURVEY", "CABLE")
        assert {one.key for one in scene.objects()} - {one.key for one in copied.objects()} == {"FERRY", "TOW", "CABLE"}
        scene.delete()
        assert [status.scene.name for status in db.scenes()] == ["trial"]


def test_hostile_names_are_shown_escaped(run: Run) -> None:
    run("load", STRAIT, "--scene", "b\x1b[2J")
    for words in (
        ("scenes",),
        ("copy", "c\x1b]0;", "--scene", "b\x1b[2J"),
        ("rename", "d\x1b[m", "--scene", "b\x1b[2J"),
    ):
        done = run(*words)
        assert done.code == 0
        assert "\x1b" not in done.out


@pytest.fixture
def stranger(dsn: str) -> Iterator[str]:
    """Return a connection string of an editor who owns nothing."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        name = f"stranger_{conn.info.backend_pid}"
        conn.execute(sql.SQL("CREATE ROLE {0}; GRANT conflictdb_editor TO {0}").format(sql.Identifier(name)))
        yield conninfo.make_conninfo(dsn, options=f"-c role={name}")
        conn.execute(sql.SQL("DROP OWNED BY {0}; DROP ROLE {0}").format(sql.Identifier(name)))


def test_protected_scenes_stay_with_their_owner(
    run: Run, stranger: str, dsn: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Readers may copy; writers may rename, and rename and delete objects; the owner may delete."""
    run("load", STRAIT)
    run("admin", "protect")
    theirs = runner(stranger, capsys)
    edits: tuple[tuple[Any, ...], ...] = (("rename", "x"), ("rename", "FERRY", "x"), ("delete", "FERRY"))
    for words in (*edits, ("copy", "x"), ("objects",), ("delete", "--all")):
        assert theirs(*words, "--scene", "strait").code == 4  # not even there
    run("admin", "share", "public", "--scene", "strait")
    for words in (*edits, ("delete", "--all")):
        assert theirs(*words, "--scene", "strait").code == 1
    assert theirs("copy", "mine", "--scene", "strait").code == 0
    assert theirs("copy", "mine", "--scene", "strait").code == 4
    run("admin", "share", "public", "--scene", "strait", "--access", "write")
    refused = theirs("delete", "--scene", "strait", "--all")
    assert (refused.code, "Only the owner of a protected scene" in refused.err) == (1, True), refused.err
    for words in (("delete", "FERRY"), ("rename", "TOW", "y"), ("rename", "ours")):
        assert theirs(*words, "--scene", "strait").code == 0
    assert theirs("delete", "--scene", "mine", "--all").code == 0
    assert names(run) == ["ours"]
