"""Scenes with anything valid in them, for properties of files and of the database."""

import numpy as np
import shapely
from hypothesis import strategies as st

from conflictdb.formats.file_objects import AREA_MEMBERS, TRACK_MEMBERS
from conflictdb.model.inputs import certain
from conflictdb.model.methods import Method
from conflictdb.model.plans import (
    MAX_INSTANT_US,
    MIN_INSTANT_US,
    Area,
    EarthModel,
    Scene,
    Track,
    rectangle_outline_m,
)
from conflictdb.model.rules import KINDS

TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
KEY = TEXT.filter(bool)
CLASS, OWNER = st.none() | KEY.filter(lambda word: word not in KINDS), st.none() | KEY
INSTANT = st.integers(MIN_INSTANT_US, MAX_INSTANT_US)
# In this range the M of a database's path, float64 Unix seconds, resolves microseconds.
STORABLE_INSTANT = st.integers(-8_000_000_000_000_000, 8_000_000_000_000_000)
SIZE = st.floats(0.0, 1e5)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(-(2.0**53), 2.0**53) | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=6,
)
TAKEN = AREA_MEMBERS | TRACK_MEMBERS
PROPERTIES = st.dictionaries(TEXT.filter(lambda name: name not in TAKEN), JSON, max_size=3)


@st.composite
def heights(draw: st.DrawFn) -> tuple[float | None, float | None]:
    low, high = sorted(draw(st.lists(st.floats(-1e5, 1e5), min_size=2, max_size=2, unique=True)))
    return draw(st.sampled_from([(None, None), (low, None), (None, high), (low, high)]))


@st.composite
def areas(draw: st.DrawFn) -> Area:
    """Boxes, one with a hole; the model's whole range."""
    west, south = draw(st.floats(-180, 170)), draw(st.floats(-80, 80))
    boxes = [shapely.box(west, south, west + draw(st.floats(1e-6, 4)), south + draw(st.floats(1e-6, 4)))]
    if draw(st.booleans()):
        boxes.append(shapely.box(west + 5, south, west + 6, south + 1))
    if draw(st.booleans()):
        outer = shapely.box(west + 5, south + 5, west + 8, south + 8)
        boxes.append(outer.difference(shapely.box(west + 6, south + 6, west + 7, south + 7)))
    start, end = sorted(draw(st.lists(INSTANT, min_size=2, max_size=2, unique=True)))
    span = draw(st.sampled_from([(None, None), (start, None), (None, end), (start, end)]))
    return Area(
        draw(KEY),
        shapely.MultiPolygon(boxes),
        draw(st.none() | TEXT),
        *map(certain, span),
        *draw(heights()),
        draw(PROPERTIES),
        draw(CLASS),
        draw(OWNER),
    )


@st.composite
def tracks(draw: st.DrawFn, instant: st.SearchStrategy[int], north: float) -> Track:
    """Any waypoints up to a latitude, with rectangular and other havens, points and lines among them."""
    times = sorted(draw(st.lists(instant, min_size=2, max_size=5, unique=True)))
    position = st.tuples(st.floats(-360, 360), st.floats(-north, north))
    positions = draw(st.lists(position, min_size=len(times), max_size=len(times)))
    outline = draw(
        st.builds(rectangle_outline_m, SIZE, SIZE, SIZE, SIZE)
        | st.sampled_from([[[3.0, 4.0]], [[0.0, 1.0], [2.0, 3.0]], [[0.0, 1.0], [1.0, -1.0], [-1.5, 0.1]]]).map(
            np.array
        )
    )
    name, band, properties = draw(st.none() | TEXT), draw(heights()), draw(PROPERTIES)
    # By up to 200 km, so that they fit a plane.
    growth, outlines = draw(st.sampled_from([0.0, 0.1, 2.0])) * 1e5 / max((times[-1] - times[0]) / 1e6, 1.0), None
    if not growth and draw(st.booleans()):
        outlines = np.array([outline * draw(st.floats(0.0, 2.0)) for _ in times])
        outline = outlines[0]
    per_leg = None, None
    if band == (None, None) and draw(st.booleans()):
        each = [draw(heights()) for _ in times[1:]]
        per_leg = (
            np.array([-np.inf if floor_m is None else floor_m for floor_m, _ in each]),
            np.array([np.inf if ceiling_m is None else ceiling_m for _, ceiling_m in each]),
        )
    havens, when = (growth, outlines), np.array(times, dtype="datetime64[us]")
    rest = name, *band, properties, *havens, *per_leg, draw(CLASS), draw(OWNER)
    return Track(draw(KEY), np.array(positions), when, outline, *rest, max_speed_kn=np.inf)


@st.composite
def scenes(
    draw: st.DrawFn, instant: st.SearchStrategy[int] = INSTANT, north: float = 90.0
) -> tuple[Scene, list[Area], list[Track]]:
    """A scene with a few objects; the instants of its tracks, and their latitudes, can be limited."""
    scene = Scene(
        draw(TEXT.filter(str.strip)),
        earth=draw(st.sampled_from(EarthModel)),
        method=draw(st.sampled_from(Method)),
        tolerance_m=draw(SIZE),
        separation_m=draw(SIZE),
    )
    items = draw(st.lists(areas() | tracks(instant, north), max_size=4, unique_by=lambda item: item.key))
    return scene, [i for i in items if isinstance(i, Area)], [i for i in items if isinstance(i, Track)]


def assert_same(one: Area | Track, other: Area | Track) -> None:
    """Compare two objects to the last bit."""
    assert type(one) is type(other)
    for name in ("key", "name", "floor_m", "ceiling_m", "properties", "object_class", "owner"):
        assert getattr(one, name) == getattr(other, name), name
    if isinstance(one, Area) and isinstance(other, Area):
        assert (one.start_us, one.end_us) == (other.start_us, other.end_us)
        assert shapely.equals_exact(one.footprint, other.footprint, 0.0)
        assert np.array_equal(shapely.get_coordinates(one.footprint), shapely.get_coordinates(other.footprint))
    elif isinstance(one, Track) and isinstance(other, Track):
        assert one.grow_mps == other.grow_mps
        for name in ("positions_deg", "times_us", "outline_m", "outlines_m", "floors_m", "ceilings_m"):
            a, b = getattr(one, name), getattr(other, name)
            assert (a is None) == (b is None), name
            assert a is None or (a.shape, a.tobytes()) == (b.shape, b.tobytes()), name
