"""Where the largest measured scenes spend their time, and the least that the indispensable part of each takes.

    ./.venv/bin/python benchmarks/profiles.py [--folder docs/explanation/performance]
        [--document docs/explanation/performance.md]

Measures nothing: it takes the first detections of growth.csv, and the limits of a unit of unit-costs.csv, both made by
growth.py and unit_costs.py. A limit is that of the scene of the same series, so it is an estimate for a larger one.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from measured import read_csv
from tables import markdown, show

MOST: Final = 4
FOLDER: Final = Path(__file__).parents[1] / "docs/explanation/performance"
# Columns of growth.csv whose seconds a part has; its units, by a column of growth.csv, and the limits of one. While
# stage 4 solves, the server writes.
PARTS: Final = {
    "pieces": (("pieces_s",), {"pieces": ("COPY alone", "arithmetic alone")}),
    "stage 1": (("stage1_s",), {}),
    "stages 2 and 3": (("stage2_s", "stage3_s"), {}),
    "stage 4 and writing": (
        ("stage4_s", "write_s"),
        {"solved_pairs": ("kernel alone",), "conflicts": ("COPY, indexes, event",)},
    ),
}

Row = dict[str, Any]


def parts(scene: Row, costs: Sequence[Row]) -> list[Row]:
    """Return seconds, share and limit of each part of a detection; without a limit where none was measured."""
    limit_us = {row["limit"]: row["limit_us"] for row in costs if row["scene"].split()[0] == scene["series"]}
    found = []
    for part, (columns, units) in PARTS.items():
        seconds = sum(scene[column] for column in columns)
        limit_s = sum(scene[unit] * limit_us[limit] / 1e6 for unit, limits in units.items() for limit in limits)
        found.append({"part": part, "s": seconds, "share": seconds / scene["cpu_s"], "limit_s": limit_s or None})
    return found


def table(scenes: Sequence[Row], costs: Sequence[Row]) -> str:
    """Return the table in Markdown of the scenes that took longest."""
    lines = []
    for scene in sorted(scenes, key=lambda row: -row["cpu_s"])[:MOST]:
        lines.append([f"**{scene['series']} {scene['objects']:,}**", "all", f"{scene['cpu_s']:.3g}", "", "", ""])
        for part in parts(scene, costs):
            limit_s = part["limit_s"]
            left = ["", ""] if limit_s is None else [f"{limit_s:.3g}", f"{part['s'] - limit_s:.3g}"]
            lines.append(["", part["part"], f"{part['s']:.3g}", f"{part['share']:.0%}", *left])
    return markdown(("scene", "part", "processor, s", "share", "limit, s", "beyond it, s"), lines)


def main() -> None:
    """Print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of growth.csv and unit-costs.csv")
    parser.add_argument("--document", type=Path, help="put the table there")
    args = parser.parse_args()
    show(
        table(read_csv(args.folder / "growth.csv"), read_csv(args.folder / "unit-costs.csv")), "profiles", args.document
    )


if __name__ == "__main__":
    main()
