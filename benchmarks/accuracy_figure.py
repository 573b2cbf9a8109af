"""The figure of benchmarks/accuracy.py: cost per pair against the error of the ends."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from figures import GREEN, GREY, ORANGE, both_logarithmic, figure
from matplotlib.lines import Line2D

if TYPE_CHECKING:
    from accuracy import Row

# Periods are whole microseconds, rounded outward: no error below this is measured.
LEAST_S: Final = 2e-6
COLOURS: Final = {
    "screen": GREY,
    "nlp": ORANGE,
    "exact": GREEN,
    "published": "#000000",
}
MARKERS: Final = {1000.0: "v", 10.0: "s", 1.0: "D", 0.0: "o", None: "X"}
TICKS: Final = {LEAST_S: "0", 1e-5: "10 us", 1e-3: "1 ms", 1.0: "1 s", 60.0: "1 min", 3600.0: "1 h", 36000.0: "10 h"}


def draw(rows: Sequence["Row"], path: Path) -> None:
    """Draw one panel per workload: a marker at the 95 % error, a line up to the worst; WGS84 filled, sphere hollow."""
    workloads = list(dict.fromkeys(row.workload for row in rows))
    shared = {"sharex": True, "sharey": True}
    with figure(path, 1, len(workloads), (11.0, 4.2), **shared) as (drawn, panels):
        for panel, workload in zip(panels[0], workloads, strict=True):
            for row in (row for row in rows if row.workload == workload):
                common, worst = (max(seconds, LEAST_S) for seconds in row.end_s)
                colour = COLOURS[row.method]
                face = colour if row.earth == "wgs84" or row.tolerance_m is None else "white"
                marker = MARKERS[row.tolerance_m]
                panel.plot([row.pair_us] * 2, [common, worst], color=colour, linewidth=0.8, zorder=1)
                panel.plot(row.pair_us, common, marker, color=colour, markerfacecolor=face, markersize=6, zorder=2)
                if row.missed or row.false:
                    note = f"{row.missed} missed, {row.false} false"
                    below = {"xytext": (4, -22), "textcoords": "offset points", "va": "top", "ha": "center"}
                    panel.annotate(note, (row.pair_us, common), color=colour, fontsize=7, **below)
            both_logarithmic(panel, workload, "cost, microseconds a pair of pieces", "")
            panel.set_ylim(LEAST_S / 2.0, 2e5)
        panels[0][0].set_yticks(list(TICKS), list(TICKS.values()))
        panels[0][0].set_ylabel("error of an end: marker 95 %, line to the worst")
        seen = dict.fromkeys(row.method for row in rows)
        keys = [Line2D([], [], color=COLOURS[method], linewidth=3.0, label=method) for method in seen]
        keys += [
            Line2D([], [], color="grey", marker=marker, linestyle="", label=f"tolerance {tolerance_m:g} m")
            for tolerance_m, marker in MARKERS.items()
            if tolerance_m is not None
        ]
        hollow = Line2D([], [], color="grey", marker="o", markerfacecolor="white", linestyle="", label="hollow: sphere")
        drawn.legend(handles=[*keys, hollow], loc="lower center", ncols=len(keys) + 1, fontsize=7.5, frameon=False)
        drawn.tight_layout(rect=(0.0, 0.07, 1.0, 1.0))
