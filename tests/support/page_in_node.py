"""The modules of the page that compute what a moved track meets, run by node."""

import base64
import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import conflictdb

PAGE: Final = Path(conflictdb.__file__).parent / "map" / "page"
MODULES: Final = (
    "kernel", "near", "nearest", "pair_distance", "what_if", "moved_waypoint", "motion", "world", "moved_plan",
)  # fmt: skip
HORIZON_US: Final = 3_600_000_000
# Reads scenes: [pack, [[key, moves], …]] each; prints the conflicts of each move, and what is forbidden to each key.
DRIVER: Final = """
import { readFileSync } from "node:fs";
import { Kernel } from "./kernel.mjs";
import { PairDistance } from "./pair_distance.mjs";
import { withWaypoint } from "./moved_waypoint.mjs";
import { unpackPieces } from "./near.mjs";
import { WhatIf } from "./what_if.mjs";
const kernel = await Kernel.of(readFileSync("kernel.wasm"));
const { horizon, scenes } = JSON.parse(readFileSync(0));
const answers = scenes.map(([text, asked]) => {
  const pack = unpackPieces(new Uint8Array(Buffer.from(text, "base64")).buffer);
  const elsewhere = (key, place) => {
    try {
      return new WhatIf(kernel, withWaypoint(kernel, pack, key, place), key);
    } catch (error) {
      return { refusal: error.message };
    }
  };
  if (asked[0].length === 3) {
    return asked.map(([key, place, us]) => {
      const one = elsewhere(key, place);
      return one.refusal !== null ? { refusal: one.refusal } : { conflicts: [one.conflicts(us)], base: pack.base_us };
    });
  }
  return asked.map(([key, delays]) => {
    const one = new WhatIf(kernel, pack, key);
    if (one.refusal !== null) return { refusal: one.refusal };
    const conflicts = delays.map(([us, up]) => one.conflicts(us, up));
    for (const conflict of conflicts[0]) {
      const pair = new PairDistance(kernel, pack, [key, conflict.other]);
      const [start, end] = [conflict.periods[0][0], conflict.periods.at(-1)[1]];
      conflict.inside_m = pair.at(conflict.periods.map(([from, to]) => (from + to) / 2));
      conflict.least_m = pair.around({ start, end, periods: conflict.periods })?.least[1] ?? null;
    }
    const ups = [...new Set(delays.map(([, up]) => up))];
    const forbidden = ups.map((up) => [up, [...one.forbidden(horizon, up)]]);
    return { conflicts, forbidden, mayRise: one.mayRise, base: pack.base_us };
  });
});
console.log(JSON.stringify(answers));
"""


def run_page(folder: Path, driver: str, given: Any) -> Any:
    """Return what a driver prints, JSON, that imports modules of the page and reads JSON."""
    for name in MODULES:
        text = re.sub(r'"\./(\w+)\.js"', r'"./\1.mjs"', (PAGE / f"{name}.js").read_text())
        (folder / f"{name}.mjs").write_text(text)
    shutil.copy(PAGE / "kernel.wasm", folder)
    (folder / "driver.mjs").write_text(driver)
    command = [str(shutil.which("node")), "driver.mjs"]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def answers_of_page(folder: Path, scenes: Sequence[tuple[Any, ...]]) -> Any:
    """The answers of the page on packs, with what is asked of each."""
    packs = [[base64.b64encode(pack).decode(), *asked] for pack, *asked in scenes]
    return run_page(folder, DRIVER, {"horizon": HORIZON_US, "scenes": packs})
