"""Scene files, the command line and their pages have the settings of the table `conflictdb.model.settings`."""

from pathlib import Path

import pytest

from conflictdb import Scene
from conflictdb.cli.commands import build
from conflictdb.errors import InvalidInput
from conflictdb.formats.scene_file import scene_of, settings_of
from conflictdb.model.settings import METRES, NAMES, NUMBERS, SETTINGS, STORED_BY_DETECT, given

FILES = Path(__file__).resolve().parents[2] / "docs/reference/files.md"


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda one: one.name)
def test_the_page_about_files_has_each_setting(setting: object) -> None:
    assert f"| `{setting.name}` |" in FILES.read_text()


def test_files_keep_every_setting() -> None:
    scene = Scene(
        "s",
        "great_circle",
        "sphere",
        "screen",
        centre=(3.0, 4.0),
        intervals="closed",
        vertical_datum="wgs84",
        regions="off",
        **dict.fromkeys(NUMBERS, 12.5),
    )  # type: ignore[arg-type]
    assert set(settings_of(scene)) == {"name", *NAMES}
    assert scene_of(settings_of(scene), "") == scene
    assert sorted(scene.differing(Scene("s"))) == sorted(NAMES)


def test_options_set_what_they_name() -> None:
    typed = [text for name in NUMBERS for text in (f"--{name.replace('_', '-')}", "7")]
    args = build().parse_args(["spark", "detect", "--output", "o", "--centre", "3,4", *typed])
    assert given(args) == {"centre": (3.0, 4.0), **dict.fromkeys(NUMBERS, 7.0)}
    args = build().parse_args(["detect", "--scene", "s", "--method", "screen", *typed])
    assert given(args, STORED_BY_DETECT) == {"method": "screen", **dict.fromkeys(NUMBERS, 7.0)}


@pytest.mark.parametrize("name", METRES)
@pytest.mark.parametrize("wrong", [-1.0, float("nan"), float("inf"), 2.1e7, True, "5", None])
def test_distances_are_checked_by_one_rule(name: str, wrong: object) -> None:
    with pytest.raises(InvalidInput, match=f"scene 's': {name}: must be (a finite number|at most 20000000)"):
        Scene("s", **{name: wrong})  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [-1.0, float("nan"), float("inf"), 3.2e11, 2_592_001.0, 1e-7, True, "5", None])
def test_the_horizon_of_stored_delays_is_checked(wrong: object) -> None:
    rule = "must be (a finite number of seconds|at most 2592000 seconds|whole microseconds)"
    with pytest.raises(InvalidInput, match=f"scene 's': delays_within_s: {rule}"):
        Scene("s", delays_within_s=wrong)  # type: ignore[arg-type]


def test_options_take_durations_and_none() -> None:
    for text, value_s in (("2h", 7200.0), ("0", 0.0)):
        assert build().parse_args(["detect", "--delays-within-s", text]).delays_within_s == value_s
