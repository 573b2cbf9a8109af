"""Write the page of a scene as one file that needs no server, database or network."""

import base64
import gzip
import hashlib
import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import psycopg

from conflictdb import store
from conflictdb.errors import InvalidInput
from conflictdb.map import content, what_if
from conflictdb.map.content import to_json
from conflictdb.plot import land

_ROOT: Final = Path(str(files("conflictdb") / "map"))
# Pairs with explanations: one query each, some seconds in all.
MOST_EXPLAINED: Final = 1_000
# Limits of a file that browsers open and mail carries: some tens of megabytes, built in a minute.
MOST_OBJECTS: Final = 5_000
MOST_CONFLICTS: Final = 20_000
# Smaller scenes, with a margin of _MARGIN_DEG, get detailed coastlines.
_SMALL_DEG: Final = 30.0
_MARGIN_DEG: Final = 5.0

_IMPORT: Final = re.compile(r'^import (\{.*?\}|\* as \w+) from "(.*?)";\n', re.MULTILINE | re.DOTALL)
_EXPORT: Final = re.compile(r"^export (?=(?:async )?(?:function|const|class) (\w+))", re.MULTILINE)
_VENDOR: Final = "../vendor/maplibre-gl.mjs"
_PACKED: Final = ("vendor/maplibre-gl.mjs", "vendor/maplibre-gl-worker.mjs", "page/kernel.wasm")
# Level 9 takes 0.5 s, more than all else here, for 0.3 % of the file.
_LEVEL: Final = 6

# MapLibre and its workers are modules, which need URLs: of the unpacked blobs.
_BEGIN: Final = """\
const addressOf = async (id) => URL.createObjectURL(
  new Blob([await (await $embedded.unpacked(id)).arrayBuffer()], { type: "text/javascript" }));
const maplibregl = await import(await addressOf("maplibre-gl.mjs"));
maplibregl.setWorkerUrl(await addressOf("maplibre-gl-worker.mjs"));
"""


def page(conn: psycopg.Connection[Any], scene: str) -> tuple[str, str]:
    """Return the file of a scene, and a text on what it leaves out.

    Raises InvalidInput if the scene does not exist, or has more than MOST_OBJECTS or MOST_CONFLICTS.
    """
    with store.transaction(conn):
        facts, left_out = _facts(conn, scene)
    return "".join(_parts(facts)), left_out


def _facts(conn: psycopg.Connection[Any], scene: str) -> tuple[dict[str, Any], str]:
    """Return all data that the page requests."""
    settings = content.settings(conn, scene)
    _check(scene, settings["objects"], "objects", MOST_OBJECTS)
    conflicts = content.conflicts(conn, scene)
    listed = content.listed(conflicts)
    _check(scene, len(listed), "conflicts", MOST_CONFLICTS)
    areas, tracks = content.areas(conn, scene), content.tracks(conn, scene)
    shapes = content.shapes(conn, scene, listed)
    # A conflict stays listed until a detection sees that one of its objects was removed.
    known = {one.key for one in store.list_objects(conn, scene)}
    explained = [one.pair for one in listed[:MOST_EXPLAINED] if {one.pair.a, one.pair.b} <= known]
    pairs = [(pair.a, pair.b, content.pair(conn, scene, pair)["explanation"]) for pair in explained]
    read = store.read_scene(conn, scene)
    now = datetime.now(UTC)
    left_out = "changes since, and acknowledging"
    if len(listed) > MOST_EXPLAINED:
        left_out += f", and why of all but the first {MOST_EXPLAINED:,} conflicts"
    near = _near(shapes)
    return {
        "scene": {
            **settings,
            "version": 0,
            "may_acknowledge": False,
            "may_edit": False,
            "copied": f"{now:%Y-%m-%d %H:%M} UTC",
        },
        "depths": content.depths(conn, scene),
        "conflicts": base64.b64encode(conflicts).decode(),
        "areas": areas,
        "tracks": base64.b64encode(tracks).decode(),
        "shapes": shapes,
        "places": land.places(),
        "table": content.table(conn, scene),
        "heights": content.heights(conn, scene),
        "pairs": pairs,
        "pieces": base64.b64encode(what_if.packed_whole(*read)).decode(),
        "owners": content.owned(*read[1:]),
        "land": json.loads(land.geojson(land.COARSE, land.WORLD, near)),
        "near_land": near and json.loads(land.geojson(land.FINE, near)),
    }, left_out


def _check(scene: str, count: int, what: str, most: int) -> None:
    if count > most:
        raise InvalidInput(
            f"scene {scene!r}",
            what,
            f"must be at most {most:,} for a file; got {count:,} (without --html the page shows all)",
        )


def _near(shapes: dict[str, Any]) -> land.Box | None:
    """Return a box around all objects, None if it is large or reaches the edge of the map."""
    places = [place for layer in ("areas", "tracks") for one in shapes[layer]["features"] for place in _places(one)]
    if not places:
        return None
    lons, lats = zip(*places, strict=True)
    west, east = min(lons) - _MARGIN_DEG, max(lons) + _MARGIN_DEG
    south, north = min(lats) - _MARGIN_DEG, max(lats) + _MARGIN_DEG
    is_small = east - west < _SMALL_DEG and north - south < _SMALL_DEG
    is_inside = min(west + 180.0, south + 90.0, 180.0 - east, 90.0 - north) > 0.0
    return (west, south, east, north) if is_small and is_inside else None


def _places(feature: dict[str, Any]) -> Iterator[tuple[float, float]]:
    def each(coordinates: Any) -> Iterator[tuple[float, float]]:
        if coordinates and isinstance(coordinates[0], list):
            for part in coordinates:
                yield from each(part)
        elif coordinates:
            yield coordinates[0], coordinates[1]

    yield from each(feature["geometry"]["coordinates"])


def _parts(facts: dict[str, Any]) -> Iterator[str]:
    """Yield the file in parts, with all scripts and styles of the served page inline."""
    script, style = _script(), "\n".join(_text(name) for name in ("vendor/maplibre-gl.css", "page/style.css"))
    policy = (
        f"default-src 'none'; script-src '{_hash(script)}' 'wasm-unsafe-eval' blob:; style-src '{_hash(style)}'; "
        "worker-src blob: data:; connect-src blob:; img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    icon = base64.b64encode(_text("page/icon.svg").encode()).decode()
    html = _text("page/index.html")
    head, rest = html.split('<link rel="icon"', 1)
    _, body = rest.split("</head>", 1)
    before, after = body.rsplit("</body>", 1)
    yield head
    yield f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
    yield f'<link rel="icon" href="data:image/svg+xml;base64,{icon}">\n'
    yield f"<style>{style}</style>\n</head>{before}"
    for name in _PACKED:
        yield _packed(name.rsplit("/", 1)[1], (_ROOT / name).read_bytes())
    yield _packed("scene-data", to_json(facts))
    notices = "\n\n".join(_text(f"vendor/{name}") for name in ("maplibre-gl.LICENSE.txt", "world-atlas.LICENSE.txt"))
    notices = notices.replace("--", "- -")
    yield f"<!-- This file holds MapLibre GL JS and Natural Earth (world-atlas).\n\n{notices}\n-->\n"
    yield f'<script type="module">{script}</script>\n</body>{after}'


def _packed(name: str, data: bytes) -> str:
    text = base64.b64encode(gzip.compress(data, _LEVEL, mtime=0)).decode()
    return f'<script type="text/plain" id="{name}">{text}</script>\n'


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _text(name: str) -> str:
    return (_ROOT / name).read_text(encoding="utf-8")


def _script() -> str:
    """Return all modules of the page as one script: a function each, after the modules that it imports."""
    done: dict[str, str] = {}

    def take(name: str) -> None:
        text = _text(f"page/{name}.js")
        for _, path in _IMPORT.findall(text):
            if path != _VENDOR and (needed := _name(path)) not in done:
                take(needed)
        exported = ", ".join(_EXPORT.findall(text))
        body = _EXPORT.sub("", _IMPORT.sub(_imported, text))
        done[name] = f"const ${name} = (() => {{\n{body}\nreturn {{ {exported} }};\n}})();\n"

    take("embedded")
    begun = "".join(done.values()) + _BEGIN
    before = set(done)
    take("app")
    return begun + "".join(text for name, text in done.items() if name not in before)


def _imported(match: re.Match[str]) -> str:
    names, path = match.groups()
    return "" if path == _VENDOR else f"const {names.replace(' as ', ': ')} = ${_name(path)};\n"


def _name(path: str) -> str:
    return path.removeprefix("./").removesuffix(".js")
