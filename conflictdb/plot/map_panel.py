"""A map as a panel of a figure: the scene's own plane, so that its tracks and edges are straight; degrees around it."""

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.earth.plane import Plane
from conflictdb.plot import land
from conflictdb.plot.style import COAST, INK, LAND, QUIET

_WIDEST_LABEL: Final = "88°88\N{PRIME}W"
# Steps between the lines of a graticule, degrees; and how many lines there are about.
_STEPS: Final = np.array([*(np.array([30, 20, 10, 5, 2, 1, 0.5]) / 3600), *(np.array([30, 20, 10, 5, 2, 1]) / 60)])
_WHOLE_STEPS: Final = np.array([1, 2, 5, 10, 20, 30, 45])
_LINES: Final = 4
_POINTS: Final = 65
# Land is drawn of at most so wide a part of the world, in detail of smaller ones, and not near the poles, degrees.
_WIDEST_LAND_DEG: Final = 120.0
_FINE_DEG: Final = 15.0
_LAST_LAND_DEG: Final = 84.0
_TURN_DEG: Final = 360.0
# Room around the content, as a share of it; and the least size of a map, plane metres.
_ROOM: Final = 0.06
_LEAST_M: Final = 1.0
# No label is this near to the end of an edge, as a share of it: it would be cut off.
_EDGE: Final = 0.02
# Room of a name, points.
_NAME_WIDTH: Final = 40.0
_NAME_HEIGHT: Final = 8.5
_SIGN_WIDTH: Final = 4.5
# Below a name, so that lines do not cross its letters.
_PLATE: Final[Any] = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.6}
# Layers of more objects are drawn as an image within the figure: vectors would make files of megabytes.
MOST_VECTORS: Final = 2_000


def show(panel: Any, plane: Plane, bounds: tuple[float, float, float, float]) -> None:
    """Show a part of the plane (west, south, east, north), plane metres, with its graticule and a scale bar.

    When all else of the figure is drawn: it keeps its places from then on.
    """
    west, south, east, north = bounds
    room = max(_ROOM * max(east - west, north - south), _LEAST_M)
    # As much room for labels as they will take; then the panel keeps its place, and the map is as wide as that.
    panel.set_xticks([0.5], [_WIDEST_LABEL])
    panel.set_yticks([0.5], [_WIDEST_LABEL], rotation=90, va="center")
    panel.figure.get_layout_engine().execute(panel.figure)
    panel.figure.set_layout_engine(None)
    box = panel.get_window_extent()
    across_m, up_m = east - west + 2.0 * room, north - south + 2.0 * room
    pixel_m = max(across_m / box.width, up_m / box.height)
    middle_x, middle_y = 0.5 * (west + east), 0.5 * (south + north)
    west, east = middle_x - 0.5 * pixel_m * box.width, middle_x + 0.5 * pixel_m * box.width
    south, north = middle_y - 0.5 * pixel_m * box.height, middle_y + 0.5 * pixel_m * box.height
    frame = np.array([(west, south), (east, south), (east, north), (west, north), (west, south)])
    border = shapely.get_coordinates(
        shapely.segmentize(shapely.LineString(frame), max(east - west, north - south) / 50)
    )
    lon, lat = plane.from_plane(border[:, 0], border[:, 1])
    lon = np.degrees(np.unwrap(np.radians(lon)))
    ticks = []
    for values, others, is_meridian in ((lon, lat, True), (lat, lon, False)):
        low, high = float(values.min()), float(values.max())
        step = _step(high - low)
        labels = []
        for value in np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step:
            along = np.linspace(others.min(), others.max(), _POINTS)
            x, y = plane.to_plane(
                *((np.full(_POINTS, value), along) if is_meridian else (along, np.full(_POINTS, value)))
            )
            panel.plot(x, y, color="#dde1e5", linewidth=0.6, zorder=0, scalex=False, scaley=False)
            place = _crossing(x, y, south) if is_meridian else _crossing(y, x, west)
            low_m, high_m = (west, east) if is_meridian else (south, north)
            if place is not None and min(place - low_m, high_m - place) > _EDGE * (high_m - low_m):
                labels.append((place, _degrees(float(value), "EW" if is_meridian else "NS", step)))
        ticks.append(labels)
    panel.set_xticks([at for at, _ in ticks[0]], [text for _, text in ticks[0]])
    panel.set_yticks([at for at, _ in ticks[1]], [text for _, text in ticks[1]], rotation=90, va="center")
    panel.set_xlim(west, east)
    panel.set_ylim(south, north)
    _land(panel, plane, (west, south, east, north))
    _scale_bar(panel, plane, (west, south, east, north))


def _land(panel: Any, plane: Plane, bounds: tuple[float, float, float, float]) -> None:
    """Draw the land in a part of the plane (west, south, east, north); none across the date line and near the poles."""
    frame = shapely.segmentize(shapely.box(*bounds), max(bounds[2] - bounds[0], bounds[3] - bounds[1]) / 20)
    lon, lat = plane.from_plane(*shapely.get_coordinates(frame).T)
    box = float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max())
    is_whole = box[0] >= -_TURN_DEG / 2 and box[2] <= _TURN_DEG / 2 and box[2] - box[0] <= _WIDEST_LAND_DEG
    if not is_whole or box[1] < -_LAST_LAND_DEG or box[3] > _LAST_LAND_DEG:
        return
    detail = land.FINE if box[2] - box[0] < _FINE_DEG else land.COARSE
    shapes = shapely.segmentize(land.polygons(detail, box), (box[2] - box[0]) / 100)
    if not len(shapes):
        return
    seen = shapely.transform(shapes, lambda deg: np.stack(plane.to_plane(deg[:, 0], deg[:, 1]), axis=1))
    polygons(panel, seen, facecolors=LAND, edgecolors=COAST, linewidths=0.4, zorder=-1)


def polygons(panel: Any, shapes: NDArray[np.object_], **look: Any) -> None:
    """Draw polygons, lines and points; look: options of a patch of matplotlib."""
    from matplotlib.collections import LineCollection, PathCollection

    parts = shapely.get_parts(np.asarray(shapes, dtype=object))
    parts = parts[~shapely.is_empty(parts)]
    kind = shapely.get_type_id(parts)
    is_image = len(parts) > MOST_VECTORS
    solid = parts[kind == shapely.GeometryType.POLYGON]
    if len(solid):
        paths = [_path(polygon) for polygon in solid]
        panel.add_collection(PathCollection(paths, rasterized=is_image, **look), autolim=False)
    edge = {"colors": look.get("edgecolors", INK), "linewidths": max(look.get("linewidths", 1.0), 1.0)}
    if (lines := parts[kind == shapely.GeometryType.LINESTRING]).size:
        segments = [shapely.get_coordinates(line) for line in lines]
        panel.add_collection(LineCollection(segments, rasterized=is_image, **edge), autolim=False)
    if (points := parts[kind == shapely.GeometryType.POINT]).size:
        panel.plot(*shapely.get_coordinates(points).T, ".", color=edge["colors"], scalex=False, scaley=False)


def names(panel: Any, places: Iterable[tuple[str, tuple[float, float]]]) -> None:
    """Write names next to places on the map; names that would overlap are stacked."""
    taken: list[tuple[float, float]] = []
    right = panel.get_window_extent().x1 * 72.0 / panel.figure.dpi
    for name, place in places:
        x, above = panel.transData.transform(place) * 72.0 / panel.figure.dpi
        y = above
        while any(abs(x - left) < _NAME_WIDTH and abs(y - low) < _NAME_HEIGHT for left, low in taken):
            y -= _NAME_HEIGHT
        taken.append((x, y))
        # To the left of its place where it would leave the map.
        aside, side = (-3, "right") if x + _SIGN_WIDTH * len(name) > right else (3, "left")
        at = {"xytext": (aside, 3 + y - above), "textcoords": "offset points", "ha": side}
        panel.annotate(name, place, **at, fontsize=7, color=INK, bbox=_PLATE)


def _path(polygon: shapely.Polygon) -> Any:
    from matplotlib.path import Path

    rings = [shapely.get_coordinates(ring) for ring in (polygon.exterior, *polygon.interiors)]
    return Path.make_compound_path(*(Path(ring, closed=True) for ring in rings))


def _step(span: float) -> float:
    steps = np.concatenate([_STEPS, _WHOLE_STEPS.astype(float)])
    return float(steps[np.argmin(np.abs(np.log(steps * _LINES / max(span, 1e-6))))])


def _crossing(across: Floats, along: Floats, level: float) -> float | None:
    """Return where a line (across, along) crosses along = level; None where it does not."""
    above = along >= level
    for k in np.flatnonzero(above[1:] != above[:-1])[:1]:
        share = (level - along[k]) / (along[k + 1] - along[k])
        return float(across[k] + share * (across[k + 1] - across[k]))
    # The line begins on the edge itself.
    k = int(np.argmin(np.abs(along - level)))
    return float(across[k]) if abs(along[k] - level) <= 1e-6 * (1.0 + abs(level)) else None


def _degrees(value: float, names: str, step: float) -> str:
    """Return a longitude or latitude as people read it: degrees, and minutes and seconds if the step needs them."""
    if names == "EW":
        value = (value + 180.0) % 360.0 - 180.0
    seconds = round(abs(value) * 3600.0, 1)
    degrees, rest = divmod(seconds, 3600.0)
    minutes, rest = divmod(rest, 60.0)
    text = f"{degrees:.0f}°"
    if step < 1.0:
        text += f"{minutes:02.0f}\N{PRIME}"
    if step < 1.0 / 60.0:
        text += f"{rest:02.0f}\N{DOUBLE PRIME}"
    has_no_side = seconds == 0.0 or (names == "EW" and abs(value) == 180.0)
    return text + ("" if has_no_side else names[0] if value > 0.0 else names[1])


def _scale_bar(panel: Any, plane: Plane, bounds: tuple[float, float, float, float]) -> None:
    west, south, east, north = bounds
    middle = np.array([0.5 * (west + east), 0.5 * (south + north)]).reshape(2, 1, 1)
    scale = float(np.ravel(plane.largest_scale(middle))[0])
    most = 0.25 * (east - west) / scale
    length = 10.0 ** np.floor(np.log10(most))
    length *= max(k for k in (1, 2, 5) if k * length <= most)
    left, low = west + 0.03 * (east - west), south + 0.04 * (north - south)
    panel.plot([left, left + length * scale], [low, low], color=INK, linewidth=2.0, solid_capstyle="butt", zorder=9)
    text = f"{length / 1000:g} km" if length >= 1000.0 else f"{length:g} m"
    panel.annotate(text, (left, low), (0, 3), textcoords="offset points", fontsize=8, color=INK, zorder=9)
    panel.annotate(
        "in the scene's plane: its lines are straight",
        (1.0, 0.0),
        (-4, 4),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="right",
        fontsize=7,
        color=QUIET,
    )
