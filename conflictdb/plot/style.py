"""How figures look, how files of them are named and written, and matplotlib, or how to get it."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, Final
from unicodedata import bidirectional

from conflictdb.errors import ConflictDBError, InvalidInput, printable
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.results import Verdict

# Distinguishable with colour blindness (Okabe and Ito), and by lightness.
FIRST, SECOND, CONFLICT, QUIET, INK = "#0072b2", "#009e73", "#d55e00", "#8a949e", "#2b333b"
# Colour of paths on a map of many: conflicts stand out where paths cross, too.
PALE: Final = "#7fb8d8"
LAND, COAST = "#efede6", "#c3c4bf"
OF_VERDICT: Final = {Verdict.CONFLICT: CONFLICT, Verdict.GRAZING: "#e69f00", Verdict.UNRESOLVED: "#8a949e"}
HATCH: Final = {Verdict.CONFLICT: "", Verdict.GRAZING: "////", Verdict.UNRESOLVED: "xxxx"}
_LONGEST_NAME: Final = 28
_LEFT_TO_RIGHT: Final = "\N{LEFT-TO-RIGHT MARK}"
# Asked in their order, as far as they are installed, for a letter that matplotlib's own font has not. None is of
# coloured pictures, which it cannot draw.
_FURTHER_FONTS: Final = (
    *(f"Noto Sans CJK {name}" for name in ("SC", "JP", "TC", "KR")),
    *("WenQuanYi Micro Hei", "WenQuanYi Zen Hei", "Droid Sans Fallback"),
    *("Microsoft YaHei", "Yu Gothic", "Malgun Gothic", "PingFang SC", "Hiragino Sans", "Arial Unicode MS"),
    *(f"Noto Sans {name}" for name in ("Devanagari", "Bengali", "Tamil", "Telugu", "Thai", "Ethiopic")),
    *("Noto Emoji", "Symbola", "Segoe UI Symbol"),
)
_STYLE: Final[Any] = {
    # A figure lays itself out by the engine that it names, or not at all.
    "figure.autolayout": False,
    "figure.constrained_layout.use": False,
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "grid.color": "#dde1e5",
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.5,
    "timezone": "UTC",
    # Files depend only on their content, not on the day or the run; text can be searched.
    "svg.hashsalt": "conflictdb",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    # A key is no formula.
    "text.parse_math": False,
}


@contextmanager
def styled() -> Iterator[Any]:
    """Yield `matplotlib`, in the style of these figures; raises ConflictDBError where there is none."""
    try:
        import matplotlib as mpl
        import matplotlib.dates
        import matplotlib.figure
        import matplotlib.font_manager
    except ImportError:
        raise ConflictDBError(
            "matplotlib is not installed: figures are drawn by it; install conflictdb[plot]"
        ) from None
    installed = {font.name for font in mpl.font_manager.fontManager.ttflist}
    fonts = ["sans-serif", *(name for name in _FURTHER_FONTS if name in installed)]
    with _without_advice(), mpl.rc_context({**_STYLE, "font.family": fonts}), warnings.catch_warnings():
        # Keys may be in any script: missing glyphs are drawn as boxes.
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        yield mpl


@contextmanager
def _without_advice() -> Iterator[None]:
    """Let matplotlib not say of each further font that there is no bold one."""
    log = logging.getLogger("matplotlib.font_manager")

    def is_wanted(record: logging.LogRecord) -> bool:
        return not record.getMessage().startswith("findfont: Failed to find font weight")

    log.addFilter(is_wanted)
    try:
        yield
    finally:
        log.removeFilter(is_wanted)


def name_of(key: str) -> str:
    """Return a key as figures show it: short, and so that its neighbours keep their places."""
    text = printable(key)
    text = text if len(text) <= _LONGEST_NAME else text[: _LONGEST_NAME - 1] + "…"
    # Isolate text from right to left.
    is_leftward = any(bidirectional(sign) in ("R", "AL") for sign in text)
    return f"{_LEFT_TO_RIGHT}{text}{_LEFT_TO_RIGHT}" if is_leftward else text


def instant(us: int) -> datetime:
    """Return the instant of microseconds since 1970."""
    return EPOCH + us * MICROSECOND


def time_axis(mpl: Any, panel: Any, first: datetime, last: datetime) -> None:
    """Make the axis across one of time, UTC."""
    locator = mpl.dates.AutoDateLocator(minticks=3, maxticks=7)
    # Without steps of two, spans of eight minutes have one label.
    for unit in (mpl.dates.MINUTELY, mpl.dates.SECONDLY):
        locator.intervald[unit] = [1, 2, 5, 10, 15, 30]
    panel.xaxis.set_major_locator(locator)
    panel.xaxis.set_major_formatter(mpl.dates.ConciseDateFormatter(locator))
    panel.set_xlim(first, last)
    panel.grid(visible=True, axis="x")
    panel.set_axisbelow(True)


def checked_name(who: str, file: str | Path, formats: tuple[str, ...]) -> Path:
    """Return the path of a file; raises InvalidInput if its name has no known format."""
    file = Path(file)
    if file.suffix.lower() not in formats:
        either = ", ".join(formats) if len(formats) > 2 else " or ".join(formats)
        raise InvalidInput(who, "file", f"must end in {either}; got {file.name!r}")
    return file


@contextmanager
def written_whole(file: Path) -> Iterator[Path]:
    """Yield where to write a file, so that it appears when it is complete, or not at all."""
    part = file.with_name(f".{file.name}.part")
    try:
        yield part
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)
