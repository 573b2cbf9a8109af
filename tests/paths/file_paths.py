"""Paths through files: a stored scene is exported, read, and solved.

No writer of objects exists for CSV, GPX and Moving Features JSON. RTZ holds one track, and ED-318 only areas: the other
objects of the scene are those that were written.
"""

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

from case import Case, Finding, NotApplicable, Rows, same, solved
from database_paths import StoredCase

from conflictdb import read
from conflictdb.formats import write_scene_file
from conflictdb.model.plans import Area, Track, VerticalDatum
from conflictdb.model.results import Conflict, Verdict

_ORDER: Final = (Verdict.NEAR, Verdict.GRAZING, Verdict.UNRESOLVED, Verdict.CONFLICT)


def scene_file(case: Case) -> Finding:
    """A scene file, GeoJSON, with its settings."""
    return _whole(case, "scene.geojson")


def geoparquet(case: Case) -> Finding:
    """GeoParquet, with its settings."""
    return _whole(case, "scene.parquet")


def _whole(case: Case, name: str) -> Finding:
    path = case.folder / name
    write_scene_file(case.mixed.objects, path, case.scene)
    contents = read(path)
    assert contents.scene == case.scene
    return same(case.rows, solved(contents.tracks, contents.areas, contents.scene).values())


def geojson_of_stored(case: StoredCase) -> Finding:
    """A scene file that a stored scene is exported to, loaded into another scene and detected."""
    path = case.folder / "stored.geojson"
    with _remarks():
        case.stored.export(path)
        scene = case.db.load(path, "loaded")
    try:
        case.detect(scene)
        rows = [*scene.conflicts(), *(one.as_near() for one in scene.approaches() if one.verdict is Verdict.NEAR)]
        return same(case.rows, rows)
    finally:
        case.db.connection.rollback()
        scene.delete()


def kml(case: StoredCase) -> Finding:
    """KML: an area for each of its spans, a track for each of its voyages."""
    areas, tracks = _exported(case, "stored.kml", None)
    return _parts(case, areas, tracks)


def rtz(case: StoredCase) -> Finding:
    """RTZ, a file for each track."""
    tracks: list[Track] = []
    for one in case.mixed.tracks:
        _, found = _exported(case, f"{one.key}.rtz", [one.key])
        tracks += found
    return _parts(case, case.mixed.areas, tracks)


def ed318(case: StoredCase) -> Finding:
    """ED-318, the areas."""
    areas, _ = _exported(case, "stored.ed318.json", [one.key for one in case.mixed.areas])
    return _parts(case, areas, case.mixed.tracks)


def f3548(case: StoredCase) -> Finding:
    """F3548: volumes that contain the plans, loaded and detected; each conflict of the plans is one of the volumes.

    Its heights are above the ellipsoid, as those of the scenes are here.
    """
    ends = [
        end
        for one in case.mixed.areas
        if one.schedule is None
        for span in one.spans_us or ((one.start_us, one.end_us),)
        for end in span
    ]
    if None in ends:
        raise NotApplicable("an operational intent has a start and an end")
    # Volumes are areas: rules for all tracks do not apply to them.
    rules = tuple(rule for rule in case.scene.rules if "track" not in rule.sides)
    expected = solved(case.mixed.tracks, case.mixed.areas, replace(case.scene, rules=rules))
    path, datum = case.folder / "stored.f3548.json", VerticalDatum.WGS84
    finding = Finding()
    with (
        case.passing("plans", case.mixed.objects, vertical_datum=datum, rules=rules) as plans,
        case.passing("volumes", [], detect=False, vertical_datum=datum, rules=rules) as volumes,
        _remarks(),
    ):
        plans.export(path)
        case.db.load(path, volumes.name)
        case.detect(volumes)
        rows = _joined(volumes.conflicts())
    for pair, row in expected.items():
        if row.verdict is Verdict.CONFLICT:
            is_there = pair in rows or pair[::-1] in rows
            finding.check(is_there, f"{pair} is missing: {row.verdict}, {row.periods}")
    return finding


def _exported(case: StoredCase, name: str, keys: Sequence[str] | None) -> tuple[list[Area], list[Track]]:
    path = case.folder / name
    with _remarks():
        case.stored.export(path, keys)
        contents = read(path)
    return contents.areas, contents.tracks


@contextmanager
def _remarks() -> Iterator[None]:
    """Allow remarks, such as settings that a file does not hold."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def _parts(case: Case, areas: Sequence[Area], tracks: Sequence[Track]) -> Finding:
    """Compare the verdicts and periods of objects whose parts have keys of their own."""
    found = _joined(solved(tracks, areas, case.scene).values())
    expected = _joined(case.rows.values())
    without = frozenset({"closest_at", "closest_m", "closest_error_m", "first_contact_deg", "lacking_s", "certainty"})
    without |= {"closest_a_deg", "closest_b_deg"}
    return same(expected, found.values(), without=without, is_exact=False)


def _joined(rows: Iterable[Conflict]) -> Rows:
    """Return the rows of objects, from those of their parts KEY/NUMBER."""
    of_pair: dict[tuple[str, str], list[Conflict]] = {}
    for row in rows:
        a, b = (key.rpartition("/")[0] if "/" in key else key for key in (row.a_key, row.b_key))
        of_pair.setdefault((a, b), []).append(row)
    return {pair: _one(pair, some) for pair, some in of_pair.items()}


def _one(pair: tuple[str, str], rows: Sequence[Conflict]) -> Conflict:
    periods = sorted((p for row in rows for p in row.periods), key=lambda p: (p[0] is not None, p[0]))
    joined: list[Any] = []
    for start, end in periods:
        if joined and (joined[-1][1] is None or (start is not None and start <= joined[-1][1])):
            last = joined[-1][1]
            joined[-1] = (joined[-1][0], None if None in (last, end) else max(last, end))
        else:
            joined.append((start, end))
    verdict = max((row.verdict for row in rows), key=_ORDER.index)
    error_s = max(row.time_error_s for row in rows)
    return replace(rows[0], a_key=pair[0], b_key=pair[1], periods=tuple(joined), verdict=verdict, time_error_s=error_s)


FILE_PATHS: Final = {
    "scene file": scene_file,
    "GeoParquet": geoparquet,
    "scene file of a stored scene": geojson_of_stored,
    "KML": kml,
    "RTZ": rtz,
    "ED-318": ed318,
    "F3548": f3548,
}
