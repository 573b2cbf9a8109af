"""Branches: scenes that store their edits only, and answer as full copies do."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from commands import runner
from layouts import ARCTIC, LOW_LATITUDE, Workload
from mixed_scenes import plain_scene
from psycopg import sql
from tiles import decode

from conflictdb import Area, InvalidInput, Rule, Scene, Track, connect, rectangle_outline_m, solve, store
from conflictdb.cli.codes import DONE, INPUT_REFUSED
from conflictdb.client.database import Database
from conflictdb.client.stored_scene import StoredScene
from conflictdb.jobs.plans_near import read_departing
from conflictdb.model.results import Certainty, Kind

WORKLOAD = replace(LOW_LATITUDE, window=1.5, around_haven=(8.0, 20.0), around_area=(5.0, 15.0))


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with connect(dsn) as database:
        yield database


def stored(db: Database, seed: int, areas: int, tracks: int, workload: Workload = WORKLOAD) -> StoredScene:
    settings, *objects = plain_scene(workload, seed, areas, tracks)
    store.replace_scene(db.connection, settings, *objects, merge=False)
    scene = db.scene(settings.name)
    scene.detect()
    return scene


@pytest.fixture
def scene(db: Database) -> StoredScene:
    """A detected scene with conflicts."""
    return stored(db, 3, 4, 14)


def found(scene: StoredScene) -> dict[tuple[str, str], Any]:
    """Conflicts by keys, without what tells one database row from another."""
    return {
        tuple(sorted((one.a_key, one.b_key))): (one.verdict, one.periods, one.closest_m, one.first_contact)
        for one in scene.conflicts()
    }


def objects_of(scene: StoredScene) -> dict[str, str]:
    _, areas, tracks = store.read_scene(scene.connection, scene.name)
    return {one.key: repr(one) for one in (*areas, *tracks)}


def drawn(scene: StoredScene) -> list[Any]:
    """All that tiles, the map and its views show, without ids."""
    conn = scene.connection
    tiles = [
        sorted((repr(fields | {"mvt_id": None}), shape.wkb) for fields, shape in layer)
        for kind in ("areas", "tracks", "conflicts")
        for layer in decode(store.tile(conn, kind, 0, 0, 0, scene.name)).values()
    ]
    areas, tracks = store.map_areas(conn, scene.name), store.map_tracks(conn, scene.name)
    return [tiles, *(sorted(repr(row[1:]) for row in rows) for rows in (areas, tracks))]


def asked(scene: StoredScene) -> list[Any]:
    """Delays, speeds and explanations of some objects, and all havens, without what differs between scenes."""
    keys = [one.key for one in scene.objects()]
    tracks = [key for key in keys if isinstance(scene.delayed(key, timedelta()), Track)]
    said = []
    for key in keys[1:]:
        facts = scene.explain(keys[0], key).facts
        said.append({name: facts[name] for name in facts.keys() - {"scene", "run", "settings", "a", "b"}})
    conn, at = scene.connection, "2026-03-01 03:00Z"
    with conn.transaction():
        havens = conn.execute(
            "SELECT * FROM conflictdb.havens(%s, %s, %s::timestamptz + interval '5 h', '1 h')", [scene.name, at, at]
        ).fetchall()
        tile = conn.execute(
            "SELECT conflictdb.tile_havens(0, 0, 0, json_build_object('scene', %s::text, 'at', %s::text))",
            [scene.name, at.replace(" ", "T")],
        ).fetchone()
    shapes = sorted((repr(one | {"mvt_id": None}), shape.wkb) for one, shape in decode(tile[0]).get("havens", []))
    return [*((scene.delays(key), scene.speeds(key)) for key in tracks[:3]), said, havens, shapes]


def near(scene: StoredScene, key: str) -> set[str]:
    """Return the keys of what the page compares a track with that departs earlier or later."""
    _, areas, tracks = read_departing(scene.connection, scene.name, key, 3600.0, at_any_height=True)
    return {one.key for one in (*areas, *tracks)}


def assert_same(branch: StoredScene, copy: StoredScene) -> None:
    assert drawn(branch) == drawn(copy)
    assert objects_of(branch) == objects_of(copy)
    assert branch.objects() == copy.objects()
    assert found(branch) == found(copy)
    assert {(one.a_key, one.b_key): one.closest_m for one in branch.approaches()} == {
        (one.a_key, one.b_key): one.closest_m for one in copy.approaches()
    }
    for key in [one.key for one in copy.objects() if one.kind == Kind.TRACK][:3]:
        assert near(copy, key) <= near(branch, key)


def edit(target: StoredScene, others: list[StoredScene], rng: np.random.Generator, pool: list[Area | Track]) -> None:
    """Put, change, turn into another kind or remove a random object, in the scene and in others alike."""
    keys = [one.key for one in target.objects()]
    chosen = str(rng.choice(keys)) if keys else "none"
    way = rng.integers(5)
    new = pool[int(rng.integers(len(pool)))]
    for one in [target, *others]:
        if way == 0 and len(keys) > 4:
            one.delete_objects(chosen)
        elif way == 1:
            one.put(replace(new, key=f"NEW {new.key}"))
        else:
            one.put(replace(new, key=chosen))


@pytest.mark.parametrize("workload", [WORKLOAD, ARCTIC], ids=["rhumb", "great_circle"])
def test_edited_branch_equals_copy(db: Database, workload: Workload) -> None:
    """After random edits, of the branch and of its parent, a branch answers as a full copy; so does what is merged."""
    rng = np.random.default_rng(7)
    scene = stored(db, 3, 5, 16, workload)
    _, more_areas, more_tracks = plain_scene(workload, 4, 6, 14)
    pool = [*more_areas, *more_tracks]
    branch, copy, edited = scene.branch("branch"), scene.copy("copy"), set[str]()
    copy.detect()
    assert_same(branch, copy)
    for step in range(16):
        if step % 4 == 3:
            # The parent changes: a copy would not follow, so it is edited alike, where the branch is not.
            key = str(rng.choice([one.key for one in scene.objects()]))
            new = replace(pool[int(rng.integers(len(pool)))], key=key)
            scene.put(new)
            if key not in edited:
                copy.put(new)
        else:
            before = objects_of(branch)
            edit(branch, [copy], rng, pool)
            after = objects_of(branch)
            edited |= {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}
        if step % 5 == 0:
            run, of_copy = branch.detect(full=step % 2 == 0), copy.detect()
            assert (run.conflicts, run.unresolved) == (of_copy.conflicts, of_copy.unresolved)
            assert_same(branch, copy)
    branch.detect(), copy.detect()
    assert_same(branch, copy)
    answers = asked(copy)
    assert all(answers)
    assert asked(branch) == answers
    diff = branch.diff()
    before, after = objects_of(scene), objects_of(branch)
    assert {one.key for one in diff.objects} == {
        key for key in before.keys() | after.keys() if before.get(key) != after.get(key)
    }
    was, now = found(scene), found(branch)
    assert {tuple(sorted((one.a_key, one.b_key))) for one in diff.conflicts if one.change == "gone"} == (
        was.keys() - now.keys()
    )
    assert {tuple(sorted((one.a_key, one.b_key))) for one in diff.conflicts if one.change == "new"} == (
        now.keys() - was.keys()
    )


def test_life_of_branches_equals_copy(db: Database) -> None:
    """Conflicts after random edits, deletions and detections, and events of merges, are those of full copies."""
    assert live(db, seed=0, steps=32) == 2


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 9))
def test_long_life_of_branches_equals_copy(db: Database, seed: int) -> None:
    """The same for a hundred steps, and on great circles."""
    live(db, seed, 100, ARCTIC if seed % 3 == 0 else WORKLOAD)


def live(db: Database, seed: int, steps: int, workload: Workload = WORKLOAD) -> int:
    """Change a branch, its parent and a copy alike at random, compare them, and return the number of merges."""
    rng = np.random.default_rng(seed)
    scene = stored(db, seed, 5, 12, workload)
    _, more_areas, more_tracks = plain_scene(workload, seed + 100, 6, 12)
    pool: list[Area | Track] = [*more_areas, *more_tracks]
    branch, copy, edited, merges = scene.branch("branch 0"), scene.copy("copy"), set[str](), 0
    copy.detect()
    for step in range(steps):
        draw = 1.0 if step % 15 == 14 else rng.random()
        if draw < 0.6:
            before = objects_of(branch)
            edit(branch, [copy], rng, pool)
            after = objects_of(branch)
            edited |= {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}
        elif draw < 0.75:
            # The copy does not follow the parent: it is edited alike where the branch is not.
            key = str(rng.choice([one.key for one in scene.objects()]))
            if key in edited:
                continue
            for one in (scene, copy):
                if draw < 0.65:
                    one.delete_objects(key)
                else:
                    one.put(replace(pool[step % len(pool)], key=key))
        elif draw < 1.0:
            branch.detect(full=draw > 0.92), copy.detect()
            assert found(branch) == found(copy)
        else:
            merge_as_copy(db, scene, branch)
            copy.detect()
            assert (objects_of(scene), found(scene)) == (objects_of(copy), found(copy))
            merges += 1
            branch, edited = scene.branch(f"branch {merges}"), set()
            assert branch.detect().conflicts == len(found(scene))
            diff = branch.diff()
            assert diff.objects == diff.conflicts == []
    branch.detect(), copy.detect()
    assert_same(branch, copy)
    return merges


def merge_as_copy(db: Database, scene: StoredScene, branch: StoredScene) -> None:
    """Merge a branch; the events are those of a copy whose objects are edited alike."""
    twin = scene.copy("twin")
    scene.detect(), twin.detect(), branch.detect()
    [(last,)] = ask(db, "SELECT coalesce(max(event), 0) FROM conflictdb.conflict_events")
    _, areas, tracks = store.read_scene(db.connection, branch.name)
    objects = {one.key: one for one in (*areas, *tracks)}
    for one in branch.diff().objects:
        if one.change == "removed":
            twin.delete_objects(one.key)
        else:
            twin.put(objects[one.key])
    branch.merge()
    scene.detect(), twin.detect()
    assert events(db, scene, last) == events(db, twin, last)
    twin.delete()


def events(db: Database, scene: StoredScene, since: int) -> list[Any]:
    """Kinds, keys and verdicts of events, without their order."""
    query = """SELECT kind, least(a_key, b_key), greatest(a_key, b_key), verdict FROM conflictdb.conflict_events
               WHERE scene = %s AND event > %s ORDER BY 1, 2, 3, 4"""
    return ask(db, query, scene.name, since)


def test_merged_scene_equals_branch(db: Database, scene: StoredScene) -> None:
    """A merge leaves the scene as the branch was, keeps the numbers of its objects, and removes the branch."""
    rng = np.random.default_rng(5)
    _, more_areas, more_tracks = plain_scene(WORKLOAD, 4, 6, 14)
    branch = scene.branch("branch")
    ids = dict(ask(db, "SELECT key, track_id FROM conflictdb.track ORDER BY key"))
    for _ in range(12):
        edit(branch, [], rng, [*more_areas, *more_tracks])
    branch.detect()
    objects, conflicts, changed = objects_of(branch), found(branch), {one.key for one in branch.diff().objects}
    assert branch.merge() == len(changed) > 3
    scene.detect()
    assert (objects_of(scene), found(scene)) == (objects, conflicts)
    assert [one.scene.name for one in db.scenes()] == [scene.name]
    now = dict(ask(db, "SELECT key, track_id FROM conflictdb.track ORDER BY key"))
    assert {key for key in ids.keys() & now.keys() if ids[key] != now[key]} == set()
    assert ask(db, "SELECT count(*) FROM conflictdb.branch_edit") == [(0,)]


@pytest.mark.parametrize("change", ["edited", "removed", "added"])
def test_merge_refuses_what_changed_on_both_sides(db: Database, scene: StoredScene, change: str) -> None:
    """A merge names the objects that the scene changed too, and changes nothing."""
    _, _, (new, *_) = plain_scene(WORKLOAD, 4, 6, 14)
    branch, key = scene.branch("branch"), "BOTH" if change == "added" else "T0"
    branch.put(replace(new, key=key))
    branch.delete_objects("T1")
    if change == "removed":
        scene.delete_objects(key)
    else:
        scene.put(replace(new, key=key, name="other"))
    before = objects_of(scene), objects_of(branch)
    with pytest.raises(InvalidInput, match=f"were changed in .* too.*'{key}'$|'{key}';|'{key}'") as refused:
        branch.merge()
    assert "T1" not in str(refused.value)
    assert (objects_of(scene), objects_of(branch)) == before


def test_removal_on_both_sides_is_merged(scene: StoredScene) -> None:
    """An object that both removed is no reason to refuse."""
    branch = scene.branch("branch")
    for one in (branch, scene):
        one.delete_objects("T0")
    assert branch.merge() == 0


def test_a_load_counts_what_it_changes_for_the_branch(db: Database, scene: StoredScene) -> None:
    """Objects of the parent are updated or unchanged, not added; unchanged ones still follow the parent."""
    settings, areas, tracks = store.read_scene(scene.connection, scene.name)
    branch = scene.branch("trial")
    branch.delete_objects(areas[1].key)
    here = replace(settings, name="trial")
    changed = [replace(areas[0], name="another"), *areas[1:]]
    new = replace(tracks[0], key="new")
    as_area = replace(areas[0], key=tracks[1].key)  # a key passes from a track to an area
    given = [*changed, as_area], [tracks[0], *tracks[2:], new]
    count = len(areas) + len(tracks)
    expected = store.stored_objects.LoadCounts(2, 2, 0, count - 3)
    assert store.replace_scene(scene.connection, here, *given, merge=True) == expected
    expected = store.stored_objects.LoadCounts(0, 0, 0, count + 1)
    assert store.replace_scene(scene.connection, here, *given, merge=True) == expected
    store.replace_scene(scene.connection, settings, [], [replace(tracks[0], name="renamed")], merge=True)
    [seen] = [one for one in store.read_scene(scene.connection, "trial")[2] if one.key == tracks[0].key]
    assert seen.name == "renamed"


def test_two_sessions_merge_once(db: Database, scene: StoredScene, dsn: str) -> None:
    """Of two merges of one branch, one succeeds and the other finds no branch."""
    branch = scene.branch("branch")
    branch.delete_objects("T0")
    outcomes: list[str] = []

    def merge() -> None:
        with connect(dsn) as other:
            try:
                other.scene("branch").merge()
                outcomes.append("merged")
            except InvalidInput as error:
                outcomes.append(str(error))

    sessions = [threading.Thread(target=merge) for _ in range(2)]
    with db.connection.transaction():
        db.connection.execute("SELECT FROM conflictdb.scene FOR UPDATE")
        for session in sessions:
            session.start()
    for session in sessions:
        session.join()
    refusal, done = sorted(outcomes, key="merged".__eq__)
    assert done == "merged"
    assert "scene 'branch': name: is not in this database" in refusal


def test_branches_that_go_during_a_detection_of_the_scene(
    db: Database, scene: StoredScene, dsn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A detection of the scene succeeds if a branch is dropped or merged meanwhile, and marks the others."""
    for name in ("dropped", "merged", "kept"):
        scene.branch(name).put(Area(name, [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]]))
        db.scene(name).detect()
    begin = store.begin_write

    def late(*values: Any) -> Any:
        monkeypatch.undo()
        with connect(dsn) as other:
            other.scene("dropped").drop()
            other.scene("merged").merge()
        return begin(*values)

    monkeypatch.setattr(store, "begin_write", late)
    scene.delete_objects("T0")
    scene.detect()
    assert not db.scene("kept").state().is_current
    scene.detect(), db.scene("kept").detect()
    assert db.scene("kept").state().is_current
    copy = db.scene("kept").copy("copy")
    copy.detect()
    assert_same(db.scene("kept"), copy)


def test_branch_follows_settings_and_rules(scene: StoredScene) -> None:
    """Settings and rules of the parent are those of its branches, which refuse others."""
    branch = scene.branch("branch")
    scene.detect(separation_m=20_000.0)
    scene.put_rule(Rule("ferry", "area", separation_m=1.0))
    copy = scene.copy("copy")
    branch.detect(), copy.detect()
    assert replace(branch.settings(), name="copy") == copy.settings()
    assert_same(branch, copy)
    for change in (
        lambda: branch.detect(separation_m=0.0),
        lambda: branch.put_rule(Rule("ferry", "area", separation_m=2.0)),
        lambda: branch.branch("twig"),
        lambda: scene.merge(),
        lambda: scene.drop(),
        lambda: scene.diff(),
    ):
        with pytest.raises(InvalidInput, match=r"branch|parent"):
            change()


def test_other_questions_refuse_branches(db: Database, scene: StoredScene) -> None:
    """A question that does not read the parent refuses a branch, and never answers from its own rows."""
    branch = scene.branch("branch")
    area = Area("P", [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]])
    questions = [
        lambda: branch.resolve(),
        lambda: branch.probe(area),
        lambda: branch.conflicts_known_at(datetime(2026, 3, 1, tzinfo=UTC)),
        lambda: branch.acknowledge("T0", "T1", "known"),
        lambda: branch.admit([area]),
        lambda: branch.share("public"),
    ]
    for question in questions:
        with pytest.raises(InvalidInput, match="is a branch of"):
            question()


def test_map_of_branch(
    db: Database, scene: StoredScene, dsn: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command writes the page of a branch, and of a scene whose conflicts have objects that are gone."""
    branch, one = scene.branch("branch"), scene.conflicts()[0]
    branch.delete_objects(one.a_key)
    scene.delete_objects(one.b_key)
    for name in ("branch", scene.name):
        file = tmp_path / f"{name}.html"
        done = runner(dsn, capsys)("map", "--scene", name, "--html", file)
        assert done.code == DONE, done.err
        assert file.stat().st_size > 100_000


def test_removed_scene_takes_its_branches(db: Database, scene: StoredScene) -> None:
    """A branch goes with its parent, and nothing of it stays."""
    branch = scene.branch("branch")
    branch.delete_objects("T0")
    branch.detect()
    scene.delete()
    assert db.scenes() == []
    for table in ("branch_edit", "change", "conflict", "piece", "track"):
        query = sql.SQL("SELECT count(*) FROM conflictdb.{}").format(sql.Identifier(table)).as_string()
        assert ask(db, query) == [(0,)], table


def ask(db: Database, query: str, *values: object) -> list[Any]:
    with db.connection.transaction():
        return db.connection.execute(query.encode(), values).fetchall()


@pytest.mark.parametrize("full", [False, True])
def test_certainty_of_inherited_tracks(db: Database, full: bool) -> None:
    """Tracks with tolerances that the branch did not edit are read from its parent, those that it did from itself."""
    window = ["2026-06-01T11:55:00Z", "2026-06-01T12:05:00Z"]
    times = np.array([0, 4 * 3600]) * 1_000_000 + 1_780_300_800_000_000
    outline = rectangle_outline_m(90, 60, 12, 12)
    ferry, tender = (
        Track(key, [(4, lat), (5, lat)], times, outline, tolerances={"arrival_window": window})
        for key, lat in (("ferry", 57.0), ("tender", 57.05))
    )
    barge = Track("barge", [(4.5, 57.0), (4.5001, 57.0)], times, rectangle_outline_m(9_000, 9_000, 9_000, 9_000))
    area = Area("area", shapely.box(4.4, 56.9, 4.6, 57.1))
    settings = Scene("certain")
    store.replace_scene(db.connection, settings, [area], [ferry, tender, barge], merge=False)
    scene = db.scene("certain")
    scene.detect()
    branch = scene.branch("branch")
    edits = [replace(area, ceiling_m=100.0), replace(barge, name="moved"), replace(tender, name="other")]
    for edit_of in edits:
        branch.put(edit_of)
        branch.detect(full=full)
    [area, barge, tender] = edits
    expected = {
        tuple(sorted((row.a_key, row.b_key))): row.certainty for row in solve([ferry, tender, barge], [area], settings)
    }
    assert expected["area", "ferry"] == expected["area", "tender"] == Certainty.MUST
    assert {tuple(sorted((row.a_key, row.b_key))): row.certainty for row in branch.conflicts()} == expected


def test_a_name_that_reads_like_the_path_of_a_branch_is_refused(
    db: Database, scene: StoredScene, dsn: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A load makes no scene of that name; a scene that has such a name is loaded into."""
    run, path = runner(dsn, capsys), f"{scene.name}/trial"
    file = tmp_path / "one.geojson"
    scene.export(file, [scene.objects()[0].key])
    refused = run("load", file, "--scene", path)
    assert refused.code == INPUT_REFUSED
    says = f"scene '{path}': name: reads like a branch of '{scene.name}', which has a name of its own: "
    assert f"{says}`conflictdb branch create trial --scene '{scene.name}'`, then --scene trial" in refused.err
    scene.branch("trial")
    assert f"{says}--scene trial" in run("load", file, "--scene", path).err
    assert path not in [one.scene.name for one in db.scenes()]
    assert run("load", file, "--scene", "else/trial").code == DONE


def test_an_object_that_a_branch_edits_waits_once(scene: StoredScene) -> None:
    """The edit marks the object of the parent and its copy."""
    branch = scene.branch("trial")
    (area, *_), tracks = branch._read()[1:]
    branch.put([replace(area, name="changed")])
    assert (branch.state().pending, branch.state().remark) == (1, "1 object waits for detection")
    with pytest.raises(InvalidInput, match="1 object waits for detection"):
        branch.diff()
    branch.put([replace(area, key="new"), replace(tracks[0], name="changed")])
    branch.delete_objects(tracks[1].key)
    assert branch.state().pending == 4
    branch.detect()
    assert branch.state().pending == 0
