"""Takes pictures of the page of `conflictdb map` in all its states, for a human reader: four sizes, both colours.

    ./run python tests/browser/look.py FOLDER [STATE…]

Without states it takes those of SCENES, one of each scene, in light colours; `all` takes all.

Needs Chromium, the developers' tools and the embedded database.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from playwright.sync_api import Page, sync_playwright

import conflictdb
from conflictdb import Area, Database, Scene, Track, store

sys.path.append(str(Path(__file__).parents[1] / "support"))
from browsing import ARGUMENTS, chromium
from large_scenes import drones, many
from map_page import served_page

SIZES: Final = ((1440, 900), (1024, 768), (820, 1180), (390, 844))
SCHEMES: Final = ("light", "dark")
START: Final = datetime(2026, 6, 1, tzinfo=UTC)
BOX: Final = [(-800.0, -1500.0), (800.0, -1500.0), (800.0, 3000.0), (-800.0, 3000.0)]
DRAWN_MS: Final = 1200
_MOST_MS: Final = 180_000


def main(folder: Path, states: list[str]) -> None:
    """Write the pictures of some states, of SCENES without any, as STATE-WIDTH-SCHEME.png."""
    schemes = SCHEMES if states else SCHEMES[:1]
    folder.mkdir(parents=True, exist_ok=True)
    with conflictdb.connect() as db, sync_playwright() as playwright:
        prepare(db)
        browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        for state in list(STATES) if states == ["all"] else states or SCENES:
            scene, reach = STATES[state]
            for width, height in SIZES:
                for scheme in schemes:
                    with served(db, scene) as (address, stop):
                        viewport = {"width": width, "height": height}
                        page = browser.new_page(viewport=viewport, color_scheme=scheme, reduced_motion="reduce")
                        page.goto(address)
                        page.set_default_timeout(_MOST_MS)
                        page.wait_for_selector("html[data-ready=true], #problem:not([hidden])", state="attached")
                        reach(page, stop)
                        page.wait_for_timeout(DRAWN_MS)
                        page.screenshot(path=folder / f"{state}-{width}-{scheme}.png")
                        page.close()
            print(state, flush=True)  # noqa: T201 (a script)
        browser.close()


@contextmanager
def served(db: Database, scene: str) -> Iterator[tuple[str, Callable[[], None]]]:
    """Serve the page of a scene: return its address, and a function that ends the server early."""
    serving = served_page(db.connection.info.dsn, scene)
    ended: list[bool] = []

    def stop() -> None:
        if not ended:
            ended.append(True)
            serving.__exit__(None, None, None)

    try:
        yield serving.__enter__(), stop
    finally:
        stop()


def prepare(db: Database) -> None:
    """Load the scenes."""

    def load(scene: Scene, areas: list[Area] = [], tracks: list[Track] = [], is_merged: bool = False) -> None:  # noqa: B006
        store.replace_scene(db.connection, scene, areas, tracks, merge=is_merged)

    db.load_demo()
    db.scene("strait").detect()
    load(Scene("empty"))
    load(Scene("not detected"), areas=[square("ZONE", 9.0, 57.0)], tracks=[ship("SHIP", (8.5, 57.0), (10.0, 57.2))])
    load(Scene("behind"), areas=[square("ZONE", 9.0, 57.0)], tracks=[ship("SHIP", (8.5, 57.0), (10.0, 57.2))])
    db.scene("behind").detect()
    load(Scene("behind"), areas=[square("LATE", 9.5, 57.0)], is_merged=True)
    load(Scene("changing"), areas=[square("ZONE", 9.0, 57.0)], tracks=[ship("SHIP", (8.5, 57.0), (10.0, 57.2))])
    db.scene("changing").detect()
    random = np.random.default_rng(1)
    ways = [(random.uniform((-6.0, 48.0), (4.0, 56.0)), random.uniform((-6.0, 48.0), (4.0, 56.0))) for _ in range(400)]
    load(Scene("many"), tracks=[ship(f"SHIP-{n}", *way, hours=60.0) for n, way in enumerate(ways)])
    db.scene("many").detect()
    load(
        Scene("date line"),
        areas=[square("SEAM", 179.5, 5.0), square("LAGOON", -178.5, 7.0)],
        tracks=[
            ship("EAST", (176.0, 4.0), (-177.0, 8.5)),
            ship("WEST", (-177.0, 4.0), (176.0, 8.5)),
            ship("NORTH", (179.9, 3.0), (179.9, 9.0)),
        ],
    )
    db.scene("date line").detect()
    load(
        Scene("near pole"),
        areas=[square("ICE", 20.0, 83.5)],
        tracks=[
            ship("LANCE", (0.0, 82.0), (60.0, 84.5)),
            ship("POLE-1", (0.0, 86.0), (80.0, 87.5)),
            ship("POLE-2", (80.0, 86.0), (0.0, 87.5)),
        ],
    )
    db.scene("near pole").detect()
    long = "A very long key of an object that somebody wrote who wanted to say everything at once, " * 2
    arabic = "\N{ARABIC LETTER SEEN}\N{ARABIC LETTER FEH}\N{ARABIC LETTER YEH}\N{ARABIC LETTER NOON}" * 3
    load(
        Scene("strange names " * 4),
        areas=[square(long.strip(), 9.0, 57.0), square(f"{arabic} \N{PARTY POPPER}", 9.3, 57.1)],
        tracks=[ship("<b>SHIP</b> & co.", (8.5, 57.0), (10.0, 57.2)), ship("船-1", (10.0, 57.0), (8.5, 57.2))],
    )
    db.scene("strange names " * 4).detect()
    days = START + 3 * timedelta(days=1)
    load(
        Scene("seconds in days"),
        tracks=[
            Track("LONG", [(0.0, 50.0), (40.0, 50.0)], [START, START + timedelta(days=8)], BOX),
            *(
                Track(
                    f"JET-{n}",
                    [(15.02, 49.0), (15.02, 51.0)],
                    [days + n * timedelta(seconds=20), days + timedelta(hours=0.3, seconds=20 * n)],
                    [(-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)],
                )
                for n in range(40)
            ),
        ],
    )
    db.scene("seconds in days").detect()
    load(Scene("harbour"), tracks=drones(300))
    load(Scene("5,000 objects"), *many(5_000))
    load(Scene("20,000 objects"), *many(20_000))
    load(
        Scene("heights"),
        areas=[replace(square("FIRING", 9.0, 57.0), floor_m=0.0, ceiling_m=12_000.0)],
        tracks=[
            ship("FERRY", (8.5, 57.2), (10.0, 57.2), heights=(-8.0, 40.0)),
            ship("SUBMARINE", (9.2, 56.9), (9.2, 57.6), heights=(-250.0, -60.0)),
            ship("SHALLOW", (9.4, 56.9), (9.4, 57.6), heights=(-40.0, 5.0)),
            ship("PATROL", (10.0, 57.1), (8.5, 57.3), hours=3.0, heights=(900.0, 1200.0)),
        ],
    )
    year = [START + timedelta(days=n) for n in range(0, 365, 5)]
    load(
        Scene("one year"),
        areas=[
            Area(
                f"EXERCISE-{n}", shapely.box(8.0 + n, 57.0, 8.8 + n, 57.5), start_us=day, end_us=day + timedelta(days=2)
            )
            for n, day in enumerate(year[::20])
        ],
        tracks=[ship(f"CRUISE-{n}", (7.5, 57.2), (12.0, 57.3), starting=day, hours=40.0) for n, day in enumerate(year)],
    )
    for scene in ("harbour", "5,000 objects", "20,000 objects", "heights", "one year"):
        db.scene(scene).detect()


def square(key: str, west: float, south: float) -> Area:
    """Return an area of 0.6 by 0.4 degrees."""
    return Area(key, shapely.box(west, south, west + 0.6, south + 0.4))


def ship(
    key: str,
    start: object,
    end: object,
    hours: float = 12.0,
    heights: tuple[float, float] | tuple[None, None] = (None, None),
    starting: datetime = START,
) -> Track:
    """Return a ship with a haven of some kilometres."""
    path, (floor, ceiling) = [tuple(start), tuple(end)], heights  # type: ignore[call-overload]
    return Track(key, path, [starting, starting + timedelta(hours=hours)], BOX, floor_m=floor, ceiling_m=ceiling)


def _first(page: Page, stop: Callable[[], None]) -> None:
    pass


def _conflict(page: Page, stop: Callable[[], None]) -> None:
    page.locator(".row").nth(min(1, page.locator(".row").count() - 1)).click()


def _overlap(page: Page, stop: Callable[[], None]) -> None:
    _conflict(page, stop)
    for _ in range(3):
        page.get_by_role("slider", name="Time shown").press("ArrowRight")


def _filters(page: Page, stop: Callable[[], None]) -> None:
    page.get_by_text("Filter", exact=True).click()


def _object(page: Page, stop: Callable[[], None]) -> None:
    page.get_by_role("combobox", name="Object").fill("ferry")


def _gone(page: Page, stop: Callable[[], None]) -> None:
    stop()
    page.wait_for_timeout(1500)


def _gone_and_asked(page: Page, stop: Callable[[], None]) -> None:
    _gone(page, stop)
    _conflict(page, stop)


def _changed(page: Page, stop: Callable[[], None]) -> None:
    with conflictdb.connect() as db:
        put = "SELECT conflictdb.put_area('changing', %s, ST_MakeEnvelope(8.0, 56.9, 9.0, 57.1, 4326), '(,)')"
        db.connection.execute(put, [f"ZONE-{datetime.now(UTC):%H%M%S}"])
        db.connection.commit()
        db.scene("changing").detect()
    page.get_by_role("button", name="Show", exact=True).click()


def _what_if(page: Page, stop: Callable[[], None]) -> None:
    page.get_by_role("button", name="FERRY and TOW").click()
    page.get_by_role("button", name="What if FERRY departs earlier or later").click()
    for _ in range(4):
        page.get_by_role("slider", name="Departure").press("PageUp")


STATES: Final[dict[str, tuple[str, Callable[[Page, Callable[[], None]], None]]]] = {
    "first": ("strait", _first),
    "conflict": ("strait", _conflict),
    "overlap": ("strait", _overlap),
    "filters": ("strait", _filters),
    "object": ("strait", _object),
    "changed": ("changing", _changed),
    "what-if": ("strait", _what_if),
    "empty": ("empty", _first),
    "not-detected": ("not detected", _first),
    "behind": ("behind", _first),
    "many": ("many", _first),
    "many-conflict": ("many", _conflict),
    "date-line": ("date line", _first),
    "date-line-conflict": ("date line", _conflict),
    "near-pole": ("near pole", _first),
    "near-pole-conflict": ("near pole", _conflict),
    "names": ("strange names " * 4, _first),
    "names-conflict": ("strange names " * 4, _conflict),
    "seconds": ("seconds in days", _first),
    "harbour": ("harbour", _first),
    "harbour-conflict": ("harbour", _conflict),
    "5000": ("5,000 objects", _first),
    "5000-conflict": ("5,000 objects", _conflict),
    "20000": ("20,000 objects", _first),
    "heights": ("heights", _first),
    "heights-conflict": ("heights", _conflict),
    "year": ("one year", _first),
    "year-conflict": ("one year", _conflict),
    "gone": ("strait", _gone),
    "gone-and-asked": ("strait", _gone_and_asked),
}
SCENES: Final = (
    "what-if", "heights-conflict", "many", "harbour", "date-line-conflict", "near-pole", "names", "year", "empty",
)  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
