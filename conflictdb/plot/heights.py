"""Heights of a pair: objects that cross are in no conflict while their height bands are apart."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.model.plans import Area, Track
from conflictdb.plot.sketch import Sketch
from conflictdb.plot.style import FIRST, SECOND

# Room above and below the bounded heights, as a share of them; and at least this, metres.
_ROOM: Final = 0.3
_LEAST_ROOM_M: Final = 1.0
_ROUNDING_M: Final = 1e-6  # of heights, where a vertical separation counts
_ALL: Final = "all"


def overlap_at(sketch: Sketch, a: int, b: int, at_us: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (n,) whether the heights of two objects overlap, or are closer than the scene's vertical separation.

    True at instants where an object is not there.
    """
    (floor_a, ceiling_a), (floor_b, ceiling_b) = (sketch.heights_m(number, at_us) for number in (a, b))
    return ~((ceiling_a <= floor_b) | (ceiling_b <= floor_a))


def apart_text(a: Area | Track, b: Area | Track, separation_m: float) -> str:
    """Return that heights keep two objects apart whatever the time; an empty text if they do not."""
    (floor_a, ceiling_a), (floor_b, ceiling_b) = _bands(a), _bands(b)
    gap_m = np.maximum(floor_a[:, None] - ceiling_b, floor_b - ceiling_a[:, None])
    if (gap_m - separation_m < -_ROUNDING_M).any() if separation_m else (gap_m < 0.0).any():
        return ""
    return "their heights " + (f"are always {_metres(separation_m)} m apart" if separation_m else "never overlap")


def line(a: Area | Track, b: Area | Track, start: str) -> str:
    """Return the heights of two objects as a line that begins with some words; empty where neither has a limit."""
    first, second = (_text(one.floor_m, one.ceiling_m) for one in (a, b))
    return "" if first == second == _ALL else f"{start}: {first}, and {second}"


def draw(panel: Any, sketch: Sketch, at_us: NDArray[np.int64], times: list[Any], names: list[str]) -> None:
    """Draw the height bands of the first two objects over time; unbounded ones reach the edge of the panel."""
    half_m = 0.5 * sketch.setup.scene.vertical_separation_m  # of their pieces
    bands = [
        (floor + half_m, ceiling - half_m) for floor, ceiling in (sketch.heights_m(number, at_us) for number in (0, 1))
    ]
    limits = np.concatenate([limit for band in bands for limit in band])
    limits = limits[np.isfinite(limits)]
    room = max(_ROOM * float(np.ptp(limits)), _LEAST_ROOM_M)
    low, high = float(limits.min()) - room, float(limits.max()) + room
    for (floor, ceiling), colour, name in zip(bands, (FIRST, SECOND), names, strict=True):
        floor, ceiling = np.clip(floor, low, high), np.clip(ceiling, low, high)
        panel.fill_between(times, floor, ceiling, color=colour, alpha=0.3, linewidth=0, step="post", label=name)
    panel.set_ylim(low, high)
    panel.set_ylabel("height, metres")
    panel.set_title("Heights; above, the separation is dashed where they are apart", fontsize=9)
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=7, frameon=False)


def _bands(one: Area | Track) -> tuple[Floats, Floats]:
    if isinstance(one, Track):
        floors_m, ceilings_m = one.heights_m()
        return floors_m.min(axis=1), ceilings_m.max(axis=1)
    floor_m = -np.inf if one.floor_m is None else one.floor_m
    ceiling_m = np.inf if one.ceiling_m is None else one.ceiling_m
    return np.array([floor_m]), np.array([ceiling_m])


def _text(floor_m: float | None, ceiling_m: float | None) -> str:
    low, high = (None if limit is None or np.isinf(limit) else _metres(limit) for limit in (floor_m, ceiling_m))
    if low is None:
        return _ALL if high is None else f"up to {high} m"
    return f"from {low} m up" if high is None else f"{low} to {high} m"


def _metres(height: float) -> str:
    return f"{height:,.10g}".replace("-", "\N{MINUS SIGN}")
