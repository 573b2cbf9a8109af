"""Heights above one datum are never compared with those above another."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb import Index, solve
from conflictdb.errors import InvalidInput
from conflictdb.formats.gather import gather
from conflictdb.formats.hints import FileHints
from conflictdb.formats.objects_writing import object_lines
from conflictdb.formats.reading import read
from conflictdb.formats.scene_file import read_scene, scene_text
from conflictdb.model.plans import Area, Scene, VerticalDatum

BOX = shapely.MultiPolygon([shapely.box(8.0, 47.0, 8.1, 47.1)])
BY_DATUM = {"msl": ("AMSL", "M", 3048.0), "wgs84": ("W84", "M", 3048.0), "flight_level": ("STD", "FL", 100.0)}
AT = np.array(["2026-06-01T08:00", "2026-06-01T09:00"], "datetime64[us]").astype(np.int64)


def area(**more: Any) -> Area:
    return Area("A", BOX, None, *AT.tolist(), 100.0, 3048.0, **more)


def intent(reference: str, units: str, value: float) -> str:
    corners = [{"lng": x, "lat": y} for x, y in ((8.0, 47.0), (8.1, 47.0), (8.1, 47.1))]
    times = {
        f"time_{name}": {"value": f"2026-06-01T{hour}:00:00Z", "format": "RFC3339"}
        for name, hour in (("start", "08"), ("end", "09"))
    }
    upper = {"value": value, "reference": reference, "units": units}
    volume = {"volume": {"outline_polygon": {"vertices": corners}, "altitude_upper": upper}, **times}
    details = {"volumes": [volume], "off_nominal_volumes": [], "priority": 0}
    return json.dumps([{"reference": {"id": "A"}, "details": details}])


@pytest.mark.parametrize("datum", list(VerticalDatum))
@pytest.mark.parametrize("stated", list(BY_DATUM))
def test_files_are_read_for_the_datum_of_the_scene(tmp_path: Path, datum: VerticalDatum, stated: str) -> None:
    """Heights of that datum are taken; of another they are refused by name, or unbounded, and never compared."""
    path = tmp_path / "plan.json"
    path.write_text(intent(*BY_DATUM[stated]))
    hints = FileHints(vertical_datum=datum.value)
    if stated == datum:
        (one,) = read(path, hints=hints).areas
        assert one.ceiling_m == pytest.approx(3048.0)
        return
    with pytest.raises(InvalidInput, match=f"a scene with vertical_datum {stated} at its own"):
        read(path, hints=hints)
    (one,) = read(path, hints=replace(hints, unbounded_heights=True)).areas
    assert one.ceiling_m is None


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("datum", list(VerticalDatum))
def test_settings_in_one_file_are_the_datum_of_the_others(tmp_path: Path, datum: VerticalDatum, first: bool) -> None:
    """Heights above mean sea level were taken into a scene of the ellipsoid, in silence, if its settings came along."""
    settings = tmp_path / "scene.geojson"
    settings.write_text("".join(scene_text(Scene("plans", vertical_datum=datum), [], [])))
    files = []
    for stated, of in BY_DATUM.items():
        files.append(tmp_path / f"{stated}.json")
        files[-1].write_text(intent(*of).replace('"A"', f'"{stated}"'))
    own = next(path for path in files if path.stem == datum)
    for path in files:
        paths = [settings, path] if first else [path, settings]
        if path is own:
            ((one,),) = (plan.areas for plan in gather(paths, "plans", settings_of=Scene))
            assert one.ceiling_m == pytest.approx(3048.0)
        else:
            with pytest.raises(InvalidInput, match=f"intent {path.stem!r}") as refused:
                gather(
                    paths, "plans", settings_of=lambda name, of=path.stem: Scene(name, vertical_datum=VerticalDatum(of))
                )
            assert f"a scene with vertical_datum {path.stem} at its own" in str(refused.value)


def test_the_ground_is_no_datum(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(intent("AGL", "M", 50.0))
    for datum in VerticalDatum:
        with pytest.raises(
            InvalidInput, match="is measured from the ground, and cannot be compared with heights above"
        ):
            read(path, hints=FileHints(vertical_datum=datum))
    with pytest.raises(InvalidInput, match="must be one of msl, wgs84, flight_level"):
        FileHints(vertical_datum="agl")


@pytest.mark.parametrize("datum", list(VerticalDatum))
def test_objects_that_name_another_datum_are_refused_everywhere(datum: VerticalDatum) -> None:
    scene = Scene("s", vertical_datum=datum)
    for stated, own in (
        ("MSL", "msl"),
        (" amsl", "msl"),
        ("W84", "wgs84"),
        ("std", "flight_level"),
        ("AGL", None),
        (5, None),
    ):
        one = area(properties={"vertical_datum": stated})
        if own == datum:
            assert solve([], [one], scene) == []
            assert read_scene("".join(scene_text(scene, [one], [])), "s").areas == [one]
            continue
        rule = f"vertical_datum: must be '{datum}', the scene's, for an object with heights: convert them"
        index = Index(scene)
        for use in (lambda: solve([], [one], scene), lambda: index.put(one), lambda: index.probe(one)):  # noqa: B023
            with pytest.raises(InvalidInput, match=rule):
                use()
        with pytest.raises(InvalidInput, match=rule):
            read_scene("".join(scene_text(scene, [one], [])), "s")
        unbounded = replace(one, floor_m=None, ceiling_m=None)
        assert solve([], [unbounded], scene) == []


@pytest.mark.parametrize("ending", ["f3548.json", "ed318.json", "kml"])
@pytest.mark.parametrize("datum", list(VerticalDatum))
def test_written_files_say_what_their_heights_are_above(tmp_path: Path, ending: str, datum: VerticalDatum) -> None:
    """A file that is read again for its datum has at least its heights, and is refused for another."""
    scene, path = Scene("s", vertical_datum=datum), tmp_path / f"s.{ending}"
    if datum is VerticalDatum.FLIGHT_LEVEL and ending != "kml":
        with pytest.raises(InvalidInput, match="is flight_level, and "):
            list(object_lines(path, scene, [area()], []))
        return
    path.write_text("".join(object_lines(path, scene, [area()], [])))
    if ending == "f3548.json" and datum is VerticalDatum.MSL:
        own: VerticalDatum = VerticalDatum.WGS84  # the only reference of the standard
    else:
        own = datum
    (one,) = read(path, hints=FileHints(vertical_datum=own)).areas
    assert one.floor_m is not None
    assert one.ceiling_m is not None
    assert one.floor_m <= 100.0
    assert one.ceiling_m >= 3048.0
    if ending == "kml":
        assert (one.floor_m, one.ceiling_m) == (100.0, 3048.0)
    for other in set(VerticalDatum) - {own}:
        with pytest.raises(InvalidInput):
            read(path, hints=FileHints(vertical_datum=other))
        (one,) = read(path, hints=FileHints(vertical_datum=other, unbounded_heights=True)).areas
        assert (one.floor_m, one.ceiling_m) == (None, None)


@pytest.mark.parametrize("mode", ["absolute", "relativeToGround", "clampToGround", "relativeToSeaFloor"])
@pytest.mark.parametrize("datum", list(VerticalDatum))
def test_altitude_modes_of_kml_are_read(tmp_path: Path, mode: str, datum: VerticalDatum) -> None:
    """Altitudes that are not used say nothing of the heights in the data of an object."""
    text = "".join(object_lines(tmp_path / "s.kml", Scene("s"), [area()], []))
    path = tmp_path / "s.kml"
    gx = "gx:" if mode.endswith("SeaFloor") else ""
    text = text.replace('<Data name="vertical_datum"><value>msl</value></Data>', "")
    path.write_text(text.replace("<Polygon>", f"<Polygon><{gx}altitudeMode>{mode}</{gx}altitudeMode>"))
    hints = FileHints(vertical_datum=datum)
    if mode == "clampToGround" or (mode == "absolute" and datum is VerticalDatum.MSL):
        (one,) = read(path, hints=hints).areas
        assert (one.floor_m, one.ceiling_m) == (100.0, 3048.0)
        return
    with pytest.raises(InvalidInput, match=f"vertical_datum: must be '{datum}', the scene's"):
        read(path, hints=hints)
    (one,) = read(path, hints=replace(hints, unbounded_heights=True)).areas
    assert (one.floor_m, one.ceiling_m) == (None, None)
