"""Common parts of all figures: import of matplotlib, and a style with small files that change with the data only."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

try:
    import matplotlib as mpl
except ImportError:
    sys.exit(
        "not drawn: the figure needs matplotlib, which is no part of the default installation:\n"
        "    .venv/bin/python -m pip install matplotlib      (uv pip install --python .venv/bin/python matplotlib)"
    )
mpl.use("svg")

from matplotlib import pyplot as plt
from matplotlib.ticker import FuncFormatter, LogLocator

GREY, BLUE, ORANGE, GREEN, PINK = "#999999", "#0072b2", "#d55e00", "#009e73", "#cc79a7"
# Text stays text, and nothing depends on the day or the run.
_STYLE: Final = {"svg.fonttype": "none", "svg.hashsalt": "conflictdb", "font.size": 9.0, "font.family": "sans-serif"}


@contextmanager
def figure(path: Path, rows: int, columns: int, size: tuple[float, float], **more: Any) -> Iterator[tuple[Any, Any]]:
    """Yield a figure and its panels (rows, columns); it is written when all is drawn."""
    with plt.rc_context(_STYLE):
        drawn, panels = plt.subplots(rows, columns, figsize=size, squeeze=False, **more)
        yield drawn, panels
        drawn.savefig(path, metadata={"Date": None})
        plt.close(drawn)


def both_logarithmic(panel: Any, title: str, across: str, up: str) -> None:
    """Make both axes of a panel logarithmic and label them; call it after drawing."""
    panel.set_xscale("log")
    panel.set_yscale("log")
    for axis in (panel.xaxis, panel.yaxis):
        low, high = axis.get_view_interval()
        if high < 300.0 * low:  # so narrow that powers of ten alone say little
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.set_title(title, fontsize=9.0)
    panel.set_xlabel(across)
    panel.set_ylabel(up)
    panel.grid(alpha=0.25, linewidth=0.5)
    panel.minorticks_off()
