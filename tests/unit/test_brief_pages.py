"""Briefs of areas without a start or an end: read as they are meant, also beside times of a zone."""

from datetime import UTC, datetime, timedelta, tzinfo
from typing import Any
from zoneinfo import ZoneInfo

import pytest
import shapely

import conflictdb
from conflictdb.client.briefing import activations_of
from conflictdb.model.brief import Brief
from conflictdb.model.plans import Area, Scene
from conflictdb.plot import brief_pages
from conflictdb.plot.section import Section

NOW = datetime(2026, 12, 1, tzinfo=UTC)
FIRST, LAST = "2026-12-02T08:00:00Z", "2026-12-03T08:00:00Z"
SCENE = Scene("range")


def sections(zone: tzinfo, **times: Any) -> dict[str, Section]:
    """Return the sections of a brief of an area that overlaps one without times."""
    area, other = Area("A", shapely.box(0, 0, 1, 1), **times), Area("B", shapely.box(0, 0, 1, 1))
    conflicts = conflictdb.solve([], [area, other], SCENE)
    [delays] = conflictdb.delays([], [area, other], SCENE, "A", 43_200.0)
    state: Any = None
    brief = Brief(SCENE, area, activations_of(area, SCENE), {"B": other}, conflicts, state, delays, None, zone)
    found = [brief_pages._when(brief, NOW), *brief_pages._meets(brief), *brief_pages._remedies(brief)]
    return {one.heading: one for one in found}


@pytest.mark.parametrize("zone", [UTC, ZoneInfo("Europe/Copenhagen")])
def test_an_area_without_times_is_always_active(zone: tzinfo) -> None:
    found = sections(zone)
    assert found["Where and when"].rows == [["always"]]
    assert found["Conflicts"].rows[0][2] == "always"
    assert found["What clears it"].rows == [["Alone", "It is always active: no other time clears it"]]


@pytest.mark.parametrize(
    ("times", "local", "utc"),
    [
        ({"start_us": FIRST}, "from 2026-12-02 09:00:00 CET on", "from 2026-12-02 08:00:00 UTC on"),
        ({"end_us": LAST}, "until 2026-12-03 09:00:00 CET", "until 2026-12-03 08:00:00 UTC"),
    ],
)
def test_a_time_without_a_start_or_an_end_has_both_columns(times: dict[str, str], local: str, utc: str) -> None:
    given = {name: datetime.fromisoformat(at) for name, at in times.items()}
    us: Any = {name: (at - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) for name, at in given.items()}
    found = sections(ZoneInfo("Europe/Copenhagen"), **us)
    assert (found["Where and when"].header, found["Where and when"].rows) == (["Active", "in UTC"], [[local, utc]])
    assert found["Conflicts"].rows[0][2] == f"{local}\n{utc}"
    assert sections(UTC, **us)["Where and when"].rows == [[utc]]


def test_times_that_are_over_are_not_the_next_ones() -> None:
    us: Any = int(NOW.timestamp() * 1e6)
    found = sections(
        UTC, spans_us=[[us - 2_000_000 * (k + 1), us - 2_000_000 * k - 1_000_000] for k in range(20)][::-1]
    )
    text = found["Where and when"].text
    assert text.endswith("All its times are over.")
    assert "next" not in text
    assert len(found["Where and when"].rows) == 16
