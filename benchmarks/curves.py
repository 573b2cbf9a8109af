"""Figures of curves as SVG, on logarithmic axes: for benchmarks that need nothing but the default installation.

Text stays text, and nothing depends on the day or the run. `figures.py` draws all other figures with matplotlib.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Final

GREY, BLUE, ORANGE, GREEN, PINK = "#999999", "#0072b2", "#d55e00", "#009e73", "#cc79a7"
WIDTH: Final = 300
HEIGHT: Final = 230
# Room beside the axes of a panel, pixels: left, top, right, bottom.
_LEFT, _TOP, _RIGHT, _BOTTOM = 52, 24, 12, 40
_LEGEND: Final = 18  # height of a line of the legend
_LEGEND_COLUMN: Final = 170

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Curve:
    """Points with a line through them. dash: of the line, empty for a whole one."""

    points: Points
    label: str
    colour: str
    dash: str = ""


@dataclass(frozen=True)
class Panel:
    """Curves, and bands between two of them, on axes with titles."""

    title: str
    across: str
    up: str
    curves: list[Curve] = field(default_factory=list)
    bands: list[tuple[Points, Points, str]] = field(default_factory=list)

    def ends(self, axis: int) -> tuple[float, float]:
        """Return the decades, or parts of one, that contain all points: exponents of ten."""
        values = [point[axis] for curve in self.curves for point in curve.points]
        values += [point[axis] for low, high, _ in self.bands for point in (*low, *high)]
        if not values:
            return 0.0, 1.0
        low, high = math.log10(min(values)), math.log10(max(values))
        space = max(0.05 * (high - low), 0.02)
        return low - space, high + space


@contextmanager
def figure(path: Path, columns: int) -> Iterator[list[Panel]]:
    """Yield a list for panels; they are written in rows when all are drawn, with one legend below."""
    panels: list[Panel] = []
    yield panels
    rows = math.ceil(len(panels) / columns)
    known = {curve.label: curve for panel in panels for curve in panel.curves}
    width = columns * WIDTH
    beside = max(width // _LEGEND_COLUMN, 1)
    height = rows * HEIGHT + _LEGEND * math.ceil(len(known) / beside) + 8
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"',
        ' font-family="sans-serif" font-size="10">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    for k, panel in enumerate(panels):
        lines.append(f'<g transform="translate({k % columns * WIDTH},{k // columns * HEIGHT})">')
        lines += [*_panel(panel), "</g>"]
    for k, curve in enumerate(known.values()):
        x, y = 10 + k % beside * _LEGEND_COLUMN, rows * HEIGHT + _LEGEND * (k // beside) + 10
        lines.append(_line([(x, y), (x + 24, y)], curve))
        lines.append(f'<text x="{x + 30}" y="{y + 3}">{escape(curve.label)}</text>')
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, "</svg>\n"]), encoding="utf-8")


def _line(points: Points, curve: Curve) -> str:
    dash = f' stroke-dasharray="{curve.dash}"' if curve.dash else ""
    at = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.8" fill="{curve.colour}"/>' for x, y in points)
    return f'<polyline points="{at}" fill="none" stroke="{curve.colour}" stroke-width="1.3"{dash}/>{dots}'


def _ticks(low: float, high: float) -> list[float]:
    """Return values for the ticks of an axis: powers of ten, also their doubles and fives on a short one."""
    heads = (1.0,) if high - low > 2.5 else (1.0, 2.0, 5.0)
    every = [head * 10.0**power for power in range(math.floor(low), math.ceil(high) + 1) for head in heads]
    return [value for value in every if low <= math.log10(value) <= high]


def _panel(panel: Panel) -> Iterator[str]:
    (west, east), (south, north) = panel.ends(0), panel.ends(1)
    wide, tall = WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM

    def place(point: tuple[float, float]) -> tuple[float, float]:
        x, y = math.log10(point[0]), math.log10(point[1])
        return _LEFT + wide * (x - west) / (east - west), _TOP + tall * (north - y) / (north - south)

    for value in _ticks(west, east):
        x, _ = place((value, 10.0**south))
        yield f'<path d="M{x:.1f},{_TOP}v{tall}" stroke="#dddddd" stroke-width="0.6"/>'
        yield f'<text x="{x:.1f}" y="{_TOP + tall + 12}" text-anchor="middle">{value:,.10g}</text>'
    for value in _ticks(south, north):
        _, y = place((10.0**west, value))
        yield f'<path d="M{_LEFT},{y:.1f}h{wide}" stroke="#dddddd" stroke-width="0.6"/>'
        yield f'<text x="{_LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{value:,.10g}</text>'
    yield f'<path d="M{_LEFT},{_TOP}v{tall}h{wide}v{-tall}z" fill="none" stroke="#555555" stroke-width="0.8"/>'
    middle = _LEFT + wide / 2
    yield f'<text x="{middle:.1f}" y="14" text-anchor="middle" font-weight="bold">{escape(panel.title)}</text>'
    yield f'<text x="{middle:.1f}" y="{HEIGHT - 12}" text-anchor="middle">{escape(panel.across)}</text>'
    at = f"{10:.1f} {_TOP + tall / 2:.1f}"
    yield f'<text transform="translate({at}) rotate(-90)" text-anchor="middle">{escape(panel.up)}</text>'
    for low, high, colour in panel.bands:
        around = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(place, [*low, *reversed(high)]))
        yield f'<polygon points="{around}" fill="{colour}" fill-opacity="0.2"/>'
    for curve in panel.curves:
        yield _line([place(point) for point in curve.points], curve)
