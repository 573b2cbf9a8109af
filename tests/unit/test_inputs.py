"""Valid input of programs keeps its meaning; invalid input is refused with key, field and rule."""

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from verdicts import periods_us

import conflictdb
from conflictdb import Area, InvalidInput, Rule, Scene, Track, rectangle_outline_m, solve
from conflictdb.memory.index import Index

START = datetime(2026, 6, 1, 8, tzinfo=UTC)
END = START + timedelta(hours=2)
START_US, END_US = 1_780_300_800_000_000, 1_780_308_000_000_000
LINE = [[9.0, 57.0], [10.0, 57.5]]
HAVEN = [[0.0, 100.0], [50.0, -50.0], [-50.0, -50.0]]
SQUARE = shapely.box(9.0, 57.0, 10.0, 58.0)


class Timestamp(datetime):
    """A subclass of datetime whose difference is of another class too, as those of pandas are."""

    def __sub__(self, other: Any) -> Any:
        return Timedelta(super().__sub__(other))


class Timedelta:
    def __init__(self, value: timedelta) -> None:
        self.value = value

    def __floordiv__(self, other: timedelta) -> np.int64:
        return np.int64(self.value // other)


class Series:
    """Knows how to become an array, as a Series of pandas does."""

    def __init__(self, values: Any) -> None:
        self.values = values

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.asarray(self.values)


def track(times: Any = (START, END), positions: Any = LINE, outline: Any = HAVEN, **more: Any) -> Track:
    return Track("T", positions, times, outline, **more)


@pytest.mark.parametrize(
    "times",
    [
        [START, END],
        (START.astimezone(timezone(timedelta(hours=2))), END),
        [Timestamp(2026, 6, 1, 8, tzinfo=UTC), END],
        [np.datetime64("2026-06-01T08:00"), np.datetime64("2026-06-01T10", "h")],
        np.array(["2026-06-01T08:00:00.000000999", "2026-06-01T10:00"], "datetime64[ns]"),
        np.array([START_US, END_US]),
        np.array([START_US, END_US], dtype=np.uint64),
        [START_US, np.int64(END_US)],
        Series(np.array([START, END], dtype=object)),
        Series(np.array([START_US, END_US])),
    ],
)
def test_instants_of_all_usual_types(times: Any) -> None:
    made = track(times)
    assert made.times_us.dtype == np.int64
    assert made.times_us.tolist() == [START_US, END_US]
    area = Area("A", SQUARE, start_us=next(iter(np.asarray(times))), end_us=END)
    assert (area.start_us, area.end_us) == (START_US, END_US)
    assert type(area.start_us) is int


@pytest.mark.parametrize(
    ("positions", "outline"),
    [
        (np.array(LINE), np.array(HAVEN)),
        (tuple(map(tuple, LINE)), tuple(map(tuple, HAVEN))),
        (shapely.LineString(LINE), shapely.Polygon(HAVEN)),
        (shapely.LineString([[*position, 300.0] for position in LINE]), [np.array(vertex) for vertex in HAVEN]),
        (np.array(LINE, dtype=np.float32), np.array(HAVEN, dtype=int)),
        (Series(LINE), Series(HAVEN)),
    ],
)
def test_geometries_of_all_usual_types(positions: Any, outline: Any) -> None:
    made = track(positions=positions, outline=outline)
    assert (made.positions_deg.dtype, made.outline_m.dtype) == (np.float64, np.float64)
    assert (made.positions_deg.tolist(), made.outline_m.tolist()) == (LINE, HAVEN)
    changing = track(outline=HAVEN, outlines_m=[outline, shapely.Polygon(HAVEN)])
    assert changing.outlines_m is not None
    assert changing.outlines_m.tolist() == [HAVEN, HAVEN]


def test_footprints_of_all_usual_types() -> None:
    ring = shapely.get_coordinates(SQUARE)
    for given in (SQUARE, shapely.MultiPolygon([SQUARE]), ring, ring[:-1].tolist()):
        footprint = Area("A", given).footprint
        assert isinstance(footprint, shapely.MultiPolygon)
        assert footprint.equals(SQUARE)


def test_objects_of_usual_types_are_solved() -> None:
    (found,) = solve([track()], [Area("A", SQUARE, start_us=START)], Scene("s", method="exact"))
    assert (found.a_key, found.b_key) == ("A", "T")
    assert periods_us(found) == ((START_US, END_US),)


REFUSED: list[tuple[Callable[[], object], str, str, str]] = [
    (lambda: track([START.replace(tzinfo=None), END]), "track 'T'", "times[0]", "offset from UTC"),
    (lambda: track([START, "2026-06-01T10:00Z"]), "track 'T'", "times[1]", "aware datetime"),
    (lambda: track(np.array([1.5e15, 1.6e15])), "track 'T'", "times[0]", "whole number"),
    (lambda: track([True, False]), "track 'T'", "times[0]", "whole number"),
    (lambda: track(np.array(["2026-06-01", "NaT"], "datetime64[us]")), "track 'T'", "times[1]", "NaT"),
    (lambda: track([START, np.datetime64("NaT")]), "track 'T'", "times[1]", "NaT"),
    (lambda: track(START), "track 'T'", "times", "list or an array"),
    (lambda: track("noon"), "track 'T'", "times", "list or an array"),
    (lambda: track([[START, END]]), "track 'T'", "times[0]", "aware datetime"),
    (
        lambda: track([START_US // 10**6, END_US // 10**6]),
        "track 'T'",
        "times",
        "if these are seconds, multiply by 1,000,000",
    ),
    (lambda: track(np.array([START_US, END_US]) // 10**3), "track 'T'", "times", "milliseconds, multiply by 1,000;"),
    (lambda: track(positions=[9.0, 57.0]), "track 'T'", "geometry", "pairs of longitude and latitude"),
    (lambda: track(positions=[[9.0, 57.0], [10.0]]), "track 'T'", "geometry", "pairs of longitude and latitude"),
    (lambda: track(positions=[["9", "57"], ["10", "58"]]), "track 'T'", "geometry", "pairs of longitude and latitude"),
    (lambda: track(positions=SQUARE), "track 'T'", "geometry", "LineString"),
    (lambda: track(positions=None), "track 'T'", "geometry", "LineString"),
    (lambda: track(outline=5.0), "track 'T'", "outline_m", "[starboard, forward]"),
    (lambda: track(outline=SQUARE.difference(SQUARE.buffer(-0.1))), "track 'T'", "outline_m", "no holes"),
    (lambda: track(outlines_m=[HAVEN, HAVEN[:2]]), "track 'T'", "outlines_m", "equal vertex counts"),
    (lambda: track(floor_m="10"), "track 'T'", "floor_m", "finite number of metres"),
    (lambda: Area("A", SQUARE, ceiling_m=True), "area 'A'", "ceiling_m", "finite number of metres"),
    (lambda: Area("A", shapely.LineString(LINE)), "area 'A'", "geometry", "Polygon or MultiPolygon"),
    (lambda: Area("A", LINE), "area 'A'", "geometry", "three at least"),
    (lambda: Area("A", b"\x01"), "area 'A'", "geometry", "Polygon"),
    (lambda: Area(SQUARE, "A"), "area", "id", "non-empty string"),  # type: ignore[arg-type]
    (lambda: Area("A", SQUARE, start_us=START.replace(tzinfo=None)), "area 'A'", "start", "offset from UTC"),
    (lambda: Area("A", SQUARE, start_us=START_US // 10**6), "area 'A'", "start", "if these are seconds"),
    (lambda: Area("A", SQUARE, end_us="noon"), "area 'A'", "end", "aware datetime"),  # type: ignore[arg-type]
    (lambda: Area("A", SQUARE, start_us=START.date()), "area 'A'", "start", "aware datetime"),  # type: ignore[arg-type]
    (lambda: solve([Area("A", SQUARE)], [track()]), "solve", "tracks[0]", "swapped"),  # type: ignore[list-item]
    (lambda: solve([], [track()]), "solve", "areas[0]", "swapped"),  # type: ignore[list-item]
    (lambda: solve(track(), []), "solve", "tracks", "in a list"),  # type: ignore[arg-type]
    (lambda: solve([], None), "solve", "areas", "in a list"),  # type: ignore[arg-type]
    (lambda: solve([], ["A"]), "solve", "areas[0]", "got str"),  # type: ignore[list-item]
    (lambda: solve([], [Area("A\ud800", SQUARE)]), "object 'A\\ud800'", "key", "half of a surrogate pair"),
    (lambda: solve([], [], "exact"), "solve", "scene", "must be a Scene"),  # type: ignore[arg-type]
    (lambda: Scene("s", method="exakt"), "scene 's'", "method", "screen, exact, nlp"),  # type: ignore[arg-type]
    (lambda: Scene("s", earth="globe"), "scene 's'", "earth", "wgs84, sphere"),  # type: ignore[arg-type]
    (lambda: Scene("s", motion="straight"), "scene 's'", "motion", "rhumb, great_circle"),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("make", "key", "field", "rule"), REFUSED)
def test_what_cannot_be_meant_is_refused(make: Callable[[], object], key: str, field: str, rule: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        make()
    assert (refused.value.key, refused.value.field) == (key, field)
    assert rule in refused.value.rule


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"tolerances": {"xtd_port_m": 5.0, "turn_radius_m": [5.0]}},
        {"tolerances": {"departure_window": [START, END]}},
        {"floors_m": []},
        {"outlines_m": np.zeros((0, 1, 2))},
        {"grow_mps": 1.0, "departures_us": [START]},
    ],
    ids=lambda more: "-".join(more),
)
def test_too_few_waypoints_are_refused_whatever_legs_have(more: dict[str, Any]) -> None:
    for waypoints, times in ((0, 0), (0, 2), (1, 1), (2, 0), (2, 1), (1, 2)):
        with pytest.raises(InvalidInput, match=r"needs at least two waypoints|must be one per waypoint"):
            Track("T", np.array(LINE[:waypoints]).reshape(-1, 2), [START, END][:times], [[0.0, 0.0]], **more)


def test_instants_of_1970_are_taken_where_they_are_meant() -> None:
    """As datetimes, or in a span that is too long for seconds."""
    early = datetime(1970, 1, 1, 0, 30, tzinfo=UTC)
    assert track([early, early + timedelta(minutes=10)]).times_us.tolist() == [1_800_000_000, 2_400_000_000]
    assert track([0, 3_600_000_000]).times_us.tolist() == [0, 3_600_000_000]
    assert Area("A", SQUARE, start_us=0, end_us=3_600_000_000).end_us == 3_600_000_000


def test_instants_of_1970_in_files_are_what_they_are(tmp_path: Path) -> None:
    """A file says its instants in full, so that nothing is to be guessed."""
    file = tmp_path / "early.csv"
    file.write_text("id,time,lon,lat\nT,1970-01-01T00:30:00Z,9,57\nT,1970-01-01T00:50:00Z,9.1,57\n")
    (found,) = conflictdb.read(file).tracks
    assert found.times_us.tolist() == [1_800_000_000, 3_000_000_000]
    for kind, geometry, more in (
        ("area", SQUARE, {"start": "1970-01-01T00:30:00Z"}),
        (
            "track",
            shapely.LineString(LINE),
            {"times": ["1970-01-01T00:30:00Z", "1970-01-01T00:50:00Z"], "outline_m": [[0, 0]]},
        ),
    ):
        feature = {"type": "Feature", "id": "X", "geometry": json.loads(shapely.to_geojson(geometry))}
        feature["properties"] = {"kind": kind, **more}
        scene = tmp_path / f"{kind}.geojson"
        scene.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
        contents = conflictdb.read(scene)
        assert [area.start_us for area in contents.areas] + [t.times_us[0] for t in contents.tracks] == [1_800_000_000]


def test_version_is_that_of_the_metadata() -> None:
    assert conflictdb.__version__.count(".") == 2


WRONG: dict[str, Any] = {"number": 1.5, "bytes": b"x", "object": object(), "nan": float("nan"), "truth": True}
HUGE = {"huge": 10**400, "minus huge": -(10**400)}
MEMBERS = ("name", "properties", "object_class", "owner", "start_us", "spans_us", "schedule", "floor_m", "ceiling_m")


@pytest.mark.parametrize("member", MEMBERS)
@pytest.mark.parametrize("kind", [*WRONG, *HUGE])
def test_a_member_of_another_type_is_refused_by_name(member: str, kind: str) -> None:
    given = 1.5j if member.endswith("_m") and kind == "number" else {**WRONG, **HUGE}[kind]
    with pytest.raises(InvalidInput, match="area 'A'"):
        Area("A", SQUARE, **{member: given})


@pytest.mark.parametrize("kind", ["bytes", "object", "nan", "truth", "huge", "minus huge"])
def test_a_speed_limit_of_another_type_is_refused(kind: str) -> None:
    with pytest.raises(InvalidInput, match="max_speed_kn: must be a number of knots above 0"):
        Track("T", LINE, [START_US, END_US], HAVEN, max_speed_kn={**WRONG, **HUGE}[kind])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Track("T", [(0.0, 0.0), (1.0, 1.0)], [10**400, 0], HAVEN), "years 1 to 9999"),
        (lambda: Scene("s", rules=5), "must be a list of Rule; got 5"),
        (lambda: rectangle_outline_m("x", 1.0, 1.0, 1.0), "fore_m: must be a number; got x"),
        (lambda: rectangle_outline_m(1.0, 10**400, 1.0, 1.0), "aft_m: must be a number; got 1000"),
        (lambda: Area("A", [(float("nan"), 0.0), (1.0, 0.0), (1.0, 1.0)]), "of finite numbers"),
        (lambda: Area("A", SQUARE, owner="\ud800"), "owner: contains half of a surrogate pair"),
        (lambda: Index().put(Area("A", SQUARE), "\ud800"), "owner: contains half of a surrogate pair"),
        (lambda: Rule("\ud800", "x", 5.0), "contains half of a surrogate pair"),
        (
            lambda: Track("T", [(0.0, 0.0), (1.0, 1.0)], [START, END], HAVEN, tolerances={"turn_radius_m": "x"}),
            "turn_radius_m: must be a finite number, 0 or more; got 'x'",
        ),
        (
            lambda: Track("T", [(0.0, 0.0), (1.0, 1.0)], [START, END], HAVEN, tolerances={"xtd_port_m": 10**400}),
            "xtd_port_m: must be at most 18520; got 1000",
        ),
        (
            lambda: Track(
                "T", [(0.0, 0.0), (1.0, 1.0)], [START, END], HAVEN, tolerances={"departure_window": [0, 10**400]}
            ),
            "departure_window: must be of the years 1 to 9999; got 1000",
        ),
    ],
)
def test_what_is_no_number_or_text_is_refused_in_a_sentence(make: Callable[[], object], words: str) -> None:
    """Not by an error of Python or numpy."""
    with pytest.raises(InvalidInput) as found:
        make()
    assert words in str(found.value)
    assert len(str(found.value)) < 300
