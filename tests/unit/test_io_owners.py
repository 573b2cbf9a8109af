"""Owners that several objects of a file share are remarked on: their objects are not compared."""

import json
from pathlib import Path

import pytest
from scenes import box

from conflictdb.formats.owners import Owners
from conflictdb.formats.reading import read


@pytest.mark.parametrize(
    ("owners", "text"),
    [
        (("Crown", "Crown", None), "not compared with each other: 'Crown' (2); 1 without owner is compared with all; "),
        (("a", "a", "b", "b", "b"), "not compared with each other: 'b' (3), 'a' (2); if `owner` means"),
        (("a", "b", None), None),
        ((None, None), None),
    ],
)
def test_shared_owners_of_a_file_are_remarked_on(
    tmp_path: Path, owners: tuple[str | None, ...], text: str | None
) -> None:
    features = [
        {
            "type": "Feature",
            "id": f"A{k}",
            "geometry": {"type": "Polygon", "coordinates": [[[k, 0], [k + 2, 0], [k + 2, 1], [k, 0]]]},
            "properties": {} if owner is None else {"owner": owner},
        }
        for k, owner in enumerate(owners)
    ]
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    remarks = [one.text for one in read(tmp_path / "a.geojson").remarks if "long sides" not in one.text]
    assert [text in one for one in remarks if text is not None] == ([] if text is None else [True])
    assert len(remarks) == (text is not None)


def test_volumes_of_one_plan_are_not_remarked_on() -> None:
    owners = Owners()
    owners.add([box(f"zone {k}", 0.0, 0.0, 1.0, 1.0, owner="zone") for k in range(3)])
    assert list(owners.remarks("file")) == []
