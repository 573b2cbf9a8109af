"""What the page says comes nearest to an object: nothing that may be anywhere is left out of it."""

import base64
import shutil
import warnings
from pathlib import Path
from typing import Any

import pytest
import shapely
from page_in_node import run_page

from conflictdb.errors import IncompleteWarning
from conflictdb.map import what_if
from conflictdb.model.plans import Area, Scene, StoredArea

DRIVER = """
import { readFileSync } from "node:fs";
import { Kernel } from "./kernel.mjs";
import { unpackPieces } from "./near.mjs";
import { nearestIn } from "./nearest.mjs";
const kernel = await Kernel.of(readFileSync("kernel.wasm"));
const pack = unpackPieces(new Uint8Array(Buffer.from(JSON.parse(readFileSync(0)), "base64")).buffer);
let found;
try {
  found = nearestIn(kernel, pack, "A", 10_000);
} catch (error) {
  found = { error: error.message };
}
console.log(JSON.stringify(found));
"""

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="did not run: no node here")


def nearest(folder: Path, *others: Area) -> Any:
    areas = [Area("A", shapely.box(9.0, 57.0, 9.1, 57.1), owner="me"), *others]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        pack = what_if.packed(Scene("s"), areas, [], ())
    return run_page(folder, DRIVER, base64.b64encode(pack).decode())


def test_an_object_that_may_be_anywhere_is_named(tmp_path: Path) -> None:
    """It has the owner of A, so that no conflict says it; without it nothing is near."""
    assert nearest(tmp_path, Area("FAR", shapely.box(12.0, 57.0, 12.1, 57.1))) is None
    unknown = StoredArea("LOST", shapely.box(9.2, 57.0, 9.3, 57.1), owner="me", schedule={"strange": 1})
    assert nearest(tmp_path, unknown) == {"error": "where LOST is, and when, cannot be computed"}
