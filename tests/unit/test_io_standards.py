"""What formats say of times, heights, speeds, sizes and limits is read, or remarked by name and count.

Each reader declares its names once (`conflictdb.formats.standards`); `whole_files` has a file of each format with all
of them. A name counts as read if the file without it gives other objects, or is refused.
"""

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import geopandas
import pytest
import shapely
from docs_scripts import script
from whole_files import WHOLE

from conflictdb import InvalidInput, read
from conflictdb.formats import Contents, FileHints
from conflictdb.formats.standards import Standard, quantity_of

STANDARDS: dict[str, Standard] = script("generate").STANDARDS
# Words of messages that refuse a file, or an object: what is read is not lost in silence.
REFUSED = "refused"


ET.register_namespace("gx", "http://www.google.com/kml/ext/2.2")
ET.register_namespace("", "http://www.opengis.net/kml/2.2")


def local(name: str) -> str:
    return name.rpartition("}")[2]


def without_xml(text: str, names: set[str]) -> str:
    root = ET.fromstring(text)  # noqa: S314  made by the tests
    outer_of = {child: element for element in root.iter() for child in element}
    for element in list(root.iter()):
        outer = outer_of.get(element)
        if outer is not None and {local(element.tag), f"{local(outer.tag)}/{local(element.tag)}"} & names:
            outer.remove(element)
        for name in list(element.attrib):
            if {local(name), f"{local(element.tag)}/{local(name)}"} & names:
                del element.attrib[name]
    return ET.tostring(root, encoding="unicode")


def without_json(text: str, names: set[str]) -> str:
    def kept(outer: str, value: Any) -> Any:
        if isinstance(value, dict):
            return {k: kept(k, one) for k, one in value.items() if not {k, f"{outer}/{k}"} & names}
        return [kept(outer, one) for one in value] if isinstance(value, list) else value

    return json.dumps(kept("", json.loads(text)))


def without_columns(text: str, names: set[str]) -> str:
    rows = list(csv.reader(io.StringIO(text)))
    at = [i for i, name in enumerate(rows[0]) if name not in names]
    return "".join(",".join(row[i] for i in at) + "\n" for row in rows)


def without_records(text: str, names: set[str]) -> str:
    return "".join(line + "\n" for line in text.splitlines() if line.split()[0] not in names)


def without_items(text: str, names: set[str]) -> str:
    for name in names:
        text = re.sub(rf" {re.escape(name)} .*?(?= [A-G]\)|\)$)", "", text)
    return text


def without(file: str, names: set[str]) -> str:
    """Return a file without all values of some names."""
    changed: Callable[[str, set[str]], str] = without_xml
    if file.endswith("json"):
        changed = without_json
    changed = {"a.csv": without_columns, "a.openair": without_records, "a.notam": without_items}.get(file, changed)
    return changed(WHOLE[file], names)


def loaded(folder: Path, file: str, text: str) -> Contents:
    (folder / file).write_text(text)
    datum = "wgs84" if file == "i.json" else None
    return read(folder / file, hints=FileHints(vertical_datum=datum, unbounded_heights=True))


def objects(contents: Contents) -> list[Any]:
    """Return all values of objects but their properties."""
    found = []
    for item in [*contents.areas, *contents.tracks]:
        values = {name: getattr(item, name) for name in item.__dataclass_fields__ if name != "properties"}
        shape = values.pop("footprint", None)
        arrays = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in values.items()}
        found.append((None if shape is None else shape.wkb, arrays))
    return found


def counts(contents: Contents) -> Counter[str]:
    """Return names that remarks say are not read, and how often they occur."""
    found = [re.findall(r"([*\w]+) \(([\d,]+)\)", one.text) for one in contents.remarks if "not read: " in one.text]
    return Counter({name: int(count) for some in found for name, count in some})


GROUPS = [
    (file, group) for file, standard in STANDARDS.items() for group in standard.read if standard.read[group] != REFUSED
]


@pytest.mark.parametrize(("file", "group"), GROUPS, ids=[f"{file}: {group[:40]}" for file, group in GROUPS])
def test_what_is_read_decides_objects(file: str, group: str, tmp_path: Path) -> None:
    """Without it objects differ, or the file is refused."""
    names = set(group.split())
    whole = loaded(tmp_path, file, WHOLE[file])
    if STANDARDS[file].read[group].startswith(REFUSED):
        return
    assert without(file, names) != without(file, set()), "the file has none of these"
    try:
        changed = loaded(tmp_path, file, without(file, names))
    except InvalidInput:
        return
    assert objects(changed) != objects(whole)


@pytest.mark.parametrize("file", [file for file, standard in STANDARDS.items() if standard.unread])
def test_what_is_not_read_is_remarked_by_name_and_count(file: str, tmp_path: Path) -> None:
    standard = STANDARDS[file]
    whole = loaded(tmp_path, file, WHOLE[file])
    found = counts(whole)
    for name in standard.names("unread"):
        own = name.rpartition("/")[2]
        if file == "a.geojson":  # properties: the remark counts their objects
            assert any(f": {own} look like" in one.text for one in whole.remarks), name
        else:
            assert found[own] >= 1, name
            spelt = WHOLE[file].count(f"<{own}") + len(re.findall(rf'[ "\n]{re.escape(own)}[=": ]', WHOLE[file]))
            assert found[own] == 1 or found[own] <= spelt, name
        changed = loaded(tmp_path, file, without(file, {name}))
        assert objects(changed) == objects(whole), name
        assert counts(changed)[own] == 0, name
    assert {name for name in found if standard.kind(name) in ("read", "aside")} <= {
        name.rpartition("/")[2] for name in standard.names("unread")
    }


@pytest.mark.parametrize("file", ["a.gpkg", "a.parquet", "a.shp"])
def test_columns_of_tables_that_are_not_read_are_remarked_as_those_of_scene_files(file: str, tmp_path: Path) -> None:
    """GeoPackage, GeoParquet and Shapefile have the declaration of scene files."""
    values = {"valid_from": "2026-06-01T10:00:00Z", "lowerLimit": 7.0}
    assert values.keys() <= set(STANDARDS["a.geojson"].names("unread"))
    columns = {"id": ["A"], **{name: [value] for name, value in values.items()}}
    frame = geopandas.GeoDataFrame(columns, geometry=[shapely.box(9.0, 57.0, 9.2, 57.2)], crs="EPSG:4326")
    frame.to_parquet(tmp_path / file) if file.endswith("parquet") else frame.to_file(tmp_path / file)
    whole = read(tmp_path / file, hints=FileHints(unbounded_heights=True))
    for name in values:
        assert any(f": {name} look like" in one.text for one in whole.remarks), (name, whole.remarks)


@pytest.mark.parametrize("file", STANDARDS)
def test_a_name_of_no_standard_that_looks_like_a_quantity_is_remarked(file: str, tmp_path: Path) -> None:
    """As a property, a record or an element beside those that are read."""
    if file in ("a.notam", "a.geojson", "a.kml"):
        pytest.skip("items have letters; properties are remarked if their object has none of the quantity")
    text = WHOLE[file]
    if file == "a.csv":
        text = (
            text.replace("eta", "eta,cruise_speed", 1).replace("06-01\n", "06-01,5\n").replace("06-02\n", "06-02,6\n")
        )
        assert counts(loaded(tmp_path, file, text))["cruise_speed"] == 1
        return
    if file == "a.openair":
        assert counts(loaded(tmp_path, file, text.replace("AU 1", "AU 1\nAQ 300")))["AQ"] == 1
        return
    if file.endswith("json"):
        document = json.loads(text)
        holder = document
        for name in ("features", "operational_intent", "reference", "properties"):
            if file != "m.mfjson" and isinstance(holder, dict) and name in holder:
                holder = holder[name][0] if isinstance(holder[name], list) else holder[name]
        holder["cruiseSpeed"] = 7
        assert counts(loaded(tmp_path, file, json.dumps(document)))["cruiseSpeed"] == 1
        return
    element = {"a.xml": "<designator>", "w.gml": "<geometry>", "a.rtz": "<schedules>"}.get(file, "")
    at = text.index(element) if element else text.index("<", text.rindex("</") - 1)
    changed = f"{text[:at]}<cruiseSpeed>7</cruiseSpeed>{text[at:]}"
    assert counts(loaded(tmp_path, file, changed))["cruiseSpeed"] == 1


@pytest.mark.parametrize("file", STANDARDS)
def test_no_name_is_declared_twice(file: str) -> None:
    standard = STANDARDS[file]
    names = [
        name for kind in (standard.read, standard.unread, standard.aside) for group in kind for name in group.split()
    ]
    assert [name for name, count in Counter(names).items() if count > 1] == []


def test_names_look_like_quantities() -> None:
    names = (
        "validFrom",
        "startAltitude",
        "speedMax",
        "draughtAft",
        "vesselLength",
        "maximumLimit",
        "colour",
        "restart",
    )
    assert [quantity_of(name) for name in names] == [
        "times",
        "times",
        "speeds",
        "heights",
        "sizes",
        "limits",
        None,
        None,
    ]
