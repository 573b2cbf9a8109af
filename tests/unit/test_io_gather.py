"""Files of one scene are taken as if they were one."""

from pathlib import Path
from typing import Any

import pytest
from plan_files import area, write

from conflictdb.errors import InvalidInput
from conflictdb.formats.gather import gather
from conflictdb.model.plans import Scene


def scene_file(folder: Path, file: str, ids: list[str], **scene: Any) -> Path:
    return write(folder, *map(area, ids), file=file, **({"scene": scene} if scene else {}))


def test_files_of_one_scene_come_together(tmp_path: Path) -> None:
    one = scene_file(tmp_path, "one.geojson", ["a"], name="s", tolerance_m=5)
    two = scene_file(tmp_path, "two.geojson", ["b", "c"])
    other = scene_file(tmp_path, "other.geojson", ["a"], name="t")
    (plan,) = gather([one, two], "s")
    assert (plan.name, plan.settings) == ("s", Scene("s", tolerance_m=5.0))
    assert [area.key for area in plan.areas] == ["a", "b", "c"]
    assert plan.source_of == {"a": str(one), "b": str(two), "c": str(two)}
    assert [(plan.name, len(plan.areas)) for plan in gather([one, two, other])] == [("s", 1), ("two", 2), ("t", 1)]


def test_given_name_goes_before_the_files_own(tmp_path: Path) -> None:
    (plan,) = gather([scene_file(tmp_path, "one.geojson", [], name="s", separation_m=7)], "mine")
    assert plan.settings == Scene("mine", separation_m=7.0)


def test_an_id_in_two_files_of_a_scene_is_refused(tmp_path: Path) -> None:
    one, two = (scene_file(tmp_path, f"{name}.geojson", ["a"]) for name in ("one", "two"))
    with pytest.raises(InvalidInput, match=r"area 'a': id: is also in .*one\.geojson") as caught:
        gather([one, two], "s")
    assert caught.value.source == str(two)


def test_files_that_disagree_about_the_scene_are_refused(tmp_path: Path) -> None:
    one = scene_file(tmp_path, "one.geojson", ["a"], tolerance_m=5)
    two = scene_file(tmp_path, "two.geojson", ["b"], tolerance_m=6)
    with pytest.raises(InvalidInput, match="tolerance_m: differs from that in"):
        gather([one, two], "s")


def test_a_file_given_twice_is_refused(tmp_path: Path) -> None:
    one = scene_file(tmp_path, "one.geojson", ["a"])
    with pytest.raises(InvalidInput, match="is given twice"):
        gather([one, one])


@pytest.mark.parametrize("name", ["", "a\0", "x" * 1001])
def test_a_scene_name_must_be_storable(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidInput, match="scene: name"):
        gather([scene_file(tmp_path, "one.geojson", [])], name)
