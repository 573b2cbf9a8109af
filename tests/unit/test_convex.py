"""Triangles joined to convex parts by the kernel: they fill the polygon, none is dented, and they are few."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from conflictdb import kernel
from conflictdb.core.pieces.convex_parts import convex_parts


def star(count: int, seed: int, middle: tuple[float, float] = (0.0, 0.0)) -> shapely.Polygon:
    rng = np.random.default_rng(seed)
    angle, radius = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False), rng.uniform(1e3, 3e3, count)
    return shapely.Polygon(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1) + np.array(middle))


def parts_of(polygons: list[shapely.Polygon]) -> list[list[shapely.Polygon]]:
    owner, xy, offset = convex_parts(np.array(polygons, dtype=object))
    assert (np.diff(owner) >= 0).all()
    rings = [shapely.Polygon(ring) for ring in np.split(xy, offset[1:-1])]
    return [[ring for ring, of in zip(rings, owner, strict=True) if of == k] for k in range(len(polygons))]


@settings(max_examples=50)
@given(st.integers(3, 40), st.integers(0, 10_000), st.booleans())
def test_parts_fill_polygons_and_are_convex_and_few(count: int, seed: int, has_hole: bool) -> None:
    """Also of polygons with holes, and of the same polygon twice: their sides do not mix."""
    polygon = star(count, seed)
    if has_hole:
        polygon = polygon.difference(star(5, seed + 1).buffer(0).intersection(polygon).buffer(-400.0))
    for parts in parts_of([polygon, polygon]) if polygon.geom_type == "Polygon" else []:
        assert sum(part.area for part in parts) == pytest.approx(polygon.area, rel=1e-9)
        assert all(part.exterior.is_ccw for part in parts)
        assert all(part.convex_hull.area == pytest.approx(part.area, rel=1e-9) for part in parts)
        dents = len(polygon.exterior.coords) + sum(len(ring.coords) for ring in polygon.interiors)
        assert len(parts) < dents
        if polygon.convex_hull.area > polygon.area * 1.01:
            assert len(parts) > 1


def test_a_square_of_two_triangles_is_one_part() -> None:
    """Also where a corner is at -0; two squares that share a side are cut alone, for they are two polygons."""
    square = np.array([[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], [(1.0, 1.0), (0.0, 1.0), (-0.0, -0.0)]])
    corner, offset = kernel.convex_parts(
        np.concatenate([square, square + np.array([1.0, 0.0])]), np.array([0, 0, 1, 1])
    )
    assert offset.tolist() == [0, 4, 8]
    assert len(set(corner.tolist())) == 8
    assert (corner[:4] < 6).all()


def test_nothing_has_no_parts() -> None:
    corner, offset = kernel.convex_parts(np.empty((0, 3, 2)), np.empty(0, np.int64))
    assert (corner.tolist(), offset.tolist()) == ([], [0])
