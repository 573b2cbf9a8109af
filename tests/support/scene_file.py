"""Writes scene files, from the words of the interface alone: independent of the package's own writer."""

import json
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import shapely

from conflictdb.model.plans import Area, Scene, Track


def iso(instant: int) -> str:
    """An instant in microseconds since 1970 as ISO 8601."""
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=instant)
    return moment.isoformat(timespec="microseconds").replace("+00:00", "Z")


def scene_document(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> dict[str, object]:
    """A scene as a GeoJSON scene file."""
    features = []
    for x in areas:
        properties: dict[str, object] = {"kind": "area"}
        if x.start_us is not None:
            properties["start"] = iso(x.start_us)
        if x.end_us is not None:
            properties["end"] = iso(x.end_us)
        features.append(_feature(x, shapely.geometry.mapping(x.footprint), properties))
    for t in tracks:
        line = {"type": "LineString", "coordinates": t.positions_deg.tolist()}
        haven: dict[str, object] = {"outline_m": t.outline_m.tolist(), "grow_mps": t.grow_mps}
        if t.outlines_m is not None:
            haven = {"outlines_m": t.outlines_m.tolist()}
        times = [iso(int(u)) for u in t.times_us]
        features.append(_feature(t, line, {"kind": "track", **haven, "times": times}))
    settings = {
        "name": scene.name,
        "motion": scene.motion.value,
        "earth": scene.earth.value,
        "method": scene.method.value,
        "tolerance_m": scene.tolerance_m,
        "separation_m": scene.separation_m,
    }
    if scene.centre is not None:
        settings["centre"] = list(scene.centre)
    return {"type": "FeatureCollection", "scene": settings, "features": features}


def write_scene(path: Path, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Path:
    """Write a scene file and return its path."""
    path.write_text(json.dumps(scene_document(scene, areas, tracks)), encoding="utf-8")
    return path


def _feature(thing: Area | Track, geometry: object, properties: dict[str, object]) -> dict[str, object]:
    for name in ("name", "floor_m", "ceiling_m"):
        if getattr(thing, name) is not None:
            properties[name] = getattr(thing, name)
    return {"type": "Feature", "id": thing.key, "geometry": geometry, "properties": {**thing.properties, **properties}}
