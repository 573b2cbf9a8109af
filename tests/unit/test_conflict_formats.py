"""Conflicts as GPX and iCalendar: hostile keys, long lines, missing places and unbounded periods."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

import conflictdb
from conflictdb import Approach, Conflict, InvalidInput
from conflictdb.formats.conflict_gpx import as_gpx
from conflictdb.formats.conflict_ics import as_ics
from conflictdb.model.methods import Method
from conflictdb.model.results import Kind, Period, Verdict

START = datetime(2026, 6, 1, 9, 0, 0, 500_000, tzinfo=UTC)
HOSTILE = "<&\"'>]]>;,\\\n\x1b[2J\u202e"


def conflict(
    a_key: str = "A", b_key: str = "B", *periods: Period, place: tuple[float, float] | None = (9.5, 57.25)
) -> Conflict:
    return Conflict(
        scene="bay",
        a_key=a_key,
        a_kind=Kind.AREA,
        b_key=b_key,
        b_kind=Kind.TRACK,
        periods=periods or ((START, START + timedelta(hours=1)),),
        verdict=Verdict.CONFLICT,
        first_contact_deg=place,
        method=Method.EXACT,
        time_error_s=0.0,
        found_at=START,
    )


def test_a_waypoint_has_place_time_and_names() -> None:
    (point,) = ET.fromstring("".join(as_gpx([conflict()])))  # noqa: S314
    assert (float(point.attrib["lat"]), float(point.attrib["lon"])) == (57.25, 9.5)
    assert [one.text for one in point] == [
        "2026-06-01T09:00:00.500000Z",
        "A / B",
        "bay conflict 2026-06-01T09:00:00.500000Z/2026-06-01T10:00:00.500000Z",
        "conflict",
    ]


def test_hostile_keys_stay_text() -> None:
    """No tag, no property and no line of their own."""
    given = [conflict(HOSTILE, "B")]
    (point,) = ET.fromstring("".join(as_gpx(given)).encode())  # noqa: S314
    assert point[1].text is not None
    assert point[1].text.startswith("<&\"'>]]>;,\\\\n\\x1b[2J\\u202e") or "\\n" in point[1].text
    lines = "".join(as_ics(given)).split("\r\n")
    assert all(len(line.encode()) <= 75 for line in lines)
    assert all(line[:1] == " " or line[:1].isupper() for line in lines if line)
    text = "".join(as_ics(given)).replace("\r\n ", "")
    (summary,) = [line for line in text.split("\r\n") if line.startswith("SUMMARY:")]
    assert "\\;\\," in summary
    assert summary.endswith(" / B: conflict")
    assert summary.isprintable()


def test_long_lines_are_folded_between_characters() -> None:
    text = "".join(as_ics([conflict("å" * 300, "B")]))
    assert max(len(line.encode()) for line in text.split("\r\n")) <= 75
    assert f"SUMMARY:{'å' * 300} / B" in text.replace("\r\n ", "")


def test_events_are_rounded_outward_and_keep_their_identity() -> None:
    moment = START.replace(microsecond=0)
    first, second = (moment, moment), (START + timedelta(hours=2), START + timedelta(hours=3))
    lines = "".join(as_ics([conflict("A", "B", first, second)])).split("\r\n")
    ends = [line for line in lines if line.startswith(("DTSTART", "DTEND"))]
    assert ends == [
        "DTSTART:20260601T090000Z",
        "DTEND:20260601T090001Z",
        "DTSTART:20260601T110000Z",
        "DTEND:20260601T120001Z",
    ]
    identities = [line for line in lines if line.startswith("UID:")]
    assert len(set(identities)) == 2
    assert identities == [
        line for line in "".join(as_ics([conflict("A", "B", first, second)])).split("\r\n") if line in identities
    ]


def test_what_cannot_be_shown_is_reported() -> None:
    nowhere, always = conflict(place=None), conflict("A", "B", (None, START))
    left: list[Conflict] = []
    assert "wpt" not in "".join(as_gpx([nowhere], left.append))
    assert "VEVENT" not in "".join(as_ics([always], left.append))
    assert left == [nowhere, always]


def test_files_are_written_by_their_ending(tmp_path: Path) -> None:
    for name, begin in (("c.gpx", "<?xml"), ("c.ics", "BEGIN:VCALENDAR")):
        conflictdb.write([conflict()], tmp_path / name)
        assert (tmp_path / name).read_text().startswith(begin)
    near = Approach(
        scene="bay", a_key="A", a_kind=Kind.AREA, b_key="B", b_kind=Kind.TRACK, verdict=Verdict.NEAR, time_error_s=0.0,
        method=Method.EXACT, closest_at=START, closest_m=1.0, closest_error_m=0.0, closest_a_deg=(0.0, 0.0),
        closest_b_deg=(0.0, 0.0),
    )  # fmt: skip
    with pytest.raises(InvalidInput, match="only conflicts are written as iCalendar"):
        conflictdb.write([near], tmp_path / "n.ics")
