"""The tasks of a planner's morning: each is one or few commands, with the right answer.

The plans are in `tasks/`: a morning in the Skagerrak, 1 December 2026. Times of `DAY` were compared with samples of the
motion, every 2 s, by separate formulas.
"""

import html
import json
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from commands import Outcome, Run

TASKS = Path(__file__).with_name("tasks")
# A route of an ECDIS, which has no size, and an area that is closed on Tuesdays.
TUESDAY = (TASKS / "firing.geojson", TASKS / "ferry.rtz", "--scene", "tuesday", "--haven", "150,50,20,20")
# The conflicts of day.geojson: from, to, to the second, outward.
DAY = {
    ("SURVEY-7", "SUB EAST"): ("06:01:00", "07:35:37"),
    ("SURVEY-7", "TANKER"): ("06:28:54", "06:53:39"),
    ("EK D 382", "FERRY NORTH"): ("07:17:49", "08:06:39"),
    ("SURVEY-7", "FERRY SOUTH"): ("07:26:28", "07:40:41"),
    ("EK D 382", "TANKER"): ("08:18:29", "09:24:44"),
    ("FERRY NORTH", "FERRY SOUTH"): ("08:19:32", "08:21:53"),
    ("EK D 382", "FERRY SOUTH"): ("08:34:47", "09:23:37"),
}


def times(found: Outcome) -> dict[tuple[str, str], tuple[str, str]]:
    """Return from when to when pairs conflict, outward to the second, as JSON has them."""
    assert found.code == 0, found.err
    return {(row["a_key"], row["b_key"]): outward(row) for row in found.json}


def outward(row: dict[str, Any]) -> tuple[str, str]:
    first, last = (datetime.fromisoformat(row[name]) for name in ("first_contact", "last_contact"))
    last += timedelta(seconds=1, microseconds=-1)
    return f"{first:%H:%M:%S}", f"{last:%H:%M:%S}"


def rewritten(path: Path, **changes: dict[str, Any]) -> Path:
    """Write day.geojson with other properties of some objects."""
    scene = json.loads((TASKS / "day.geojson").read_text())
    for feature in scene["features"]:
        feature["properties"] |= changes.get(feature["id"].replace(" ", "_"), {})
    path.write_text(json.dumps(scene))
    return path


@pytest.fixture
def day(run: Run) -> Run:
    """Run commands on the scene of day.geojson, detected."""
    assert times(run("detect", TASKS / "day.geojson", "--format", "json")) == DAY
    return run


def test_1_a_route_and_a_weekly_firing_area(run: Run) -> None:
    """Next Tuesday they meet, whatever the ferry's tolerances allow."""
    found = run("detect", *TUESDAY, "--format", "json")
    [(pair, when)] = times(found).items()
    assert pair[0] == "EK D 382"
    assert when == ("12:32:33", "13:20:34")
    assert found.json[0]["certainty"] == "must"


def test_2_what_changes_if_the_ferry_is_late(day: Run) -> None:
    """Two conflicts move, and nothing is stored."""
    changed = day("probe", "--late", "FERRY NORTH", "20m", "--diff", "--format", "json")
    assert {row["change"] for row in changed.json} == {"changed"}
    assert times(changed) == {
        ("EK D 382", "FERRY NORTH"): ("07:37:49", "08:26:39"),
        ("FERRY NORTH", "FERRY SOUTH"): ("08:29:32", "08:31:53"),
    }
    assert times(day("conflicts", "--format", "json")) == DAY


def test_3_what_changes_if_the_survey_moves_west(day: Run) -> None:
    """Exactly its three conflicts change."""
    changed = day("probe", "--move", "SURVEY-7", "2nmi", "270", "--diff", "--format", "json")
    assert set(times(changed)) == {pair for pair in DAY if "SURVEY-7" in pair}
    assert {row["change"] for row in changed.json} == {"changed"}


def test_4_a_lane_with_a_separation_and_a_submarine_below(run: Run) -> None:
    found = run("detect", TASKS / "lane2.geojson", "--format", "json")
    assert list(times(found)) == [("SHIP-2", "SHIP-3")]


def test_5_plans_of_one_owner_are_not_compared(run: Run, tmp_path: Path) -> None:
    """`explain` gives the reason; an area of the other agency is compared."""
    owned = {"FERRY_NORTH": {"owner": "A"}, "EK_D_382": {"owner": "A"}, "FERRY_SOUTH": {"owner": "B"}}
    file = rewritten(tmp_path / "owned.geojson", **owned)
    assert set(times(run("detect", file, "--format", "json"))) == set(DAY) - {("EK D 382", "FERRY NORTH")}
    assert "owner" in run("explain", "EK D 382", "FERRY NORTH").out


def test_6_a_notam_from_text(run: Run) -> None:
    """Each day from 07 to 15, from 1 to 4 December, from the surface to 5,000 ft."""
    assert run("load", TASKS / "notam.txt", "--scene", "notam").code == 0
    [area] = run("objects", "--scene", "notam", "--format", "json").json
    assert (area["start_at"][:16], area["end_at"][:16]) == ("2026-12-01T07:00", "2026-12-04T15:00")
    assert area["ceiling_m"] == pytest.approx(1524.0)
    for hour, is_active in (("06:59", False), ("07:01", True), ("14:59", True), ("15:01", False)):
        for date in range(1, 5):
            at = f"2026-12-0{date}T{hour}Z"
            path = "LINESTRING(9 57.9, 9.1 57.9)"
            later = f"{(datetime.fromisoformat(at) + timedelta(seconds=30)).isoformat()}"
            found = run("probe", "--scene", "notam", "--path", path, "--times", f"{at},{later}", "--format", "json")
            assert bool(found.json) == is_active, at


def test_7_who_acknowledged_what_and_why(day: Run) -> None:
    assert day("acknowledge", "FERRY SOUTH", "FERRY NORTH", "--reason", "they see each other", "--by", "Anna").code == 0
    [known] = day("conflicts", "--acknowledged", "yes", "--format", "json").json
    assert (known["a_key"], known["b_key"]) == ("FERRY NORTH", "FERRY SOUTH")
    assert known["acknowledged_for"] == "they see each other"
    assert "Anna" in known["acknowledged_by"]
    assert "they see each other" in day("conflicts", "--show", "acknowledged").out
    assert len(day("conflicts", "--acknowledged", "no", "--format", "json").json) == 6


def test_7_acknowledgements_return_with_their_conflicts(day: Run, tmp_path: Path) -> None:
    """After apply and undo; what ends is named. A withdrawn one, and one of another conflict, do not return."""
    for key in ("FERRY NORTH", "EK D 382"):
        day("acknowledge", "FERRY SOUTH", key, "--reason", f"reason {key}", "--by", "Anna")
    number = str(day("resolve", "--within", "12h", "--format", "json").json["proposal_id"])
    day("apply", number)
    ended = day("detect").err
    assert "the acknowledgement of FERRY NORTH and FERRY SOUTH by Anna (" in ended
    assert ended.count("has ended with the conflict") == 2
    day("apply", number, "--undo")
    assert times(day("detect", "--format", "json")) == DAY

    def known() -> dict[str, str]:
        rows = day("conflicts", "--acknowledged", "yes", "--format", "json").json
        return {row["a_key"]: row["acknowledged_for"] for row in rows}

    assert known() == {"EK D 382": "reason EK D 382", "FERRY NORTH": "reason FERRY NORTH"}
    day("acknowledge", "FERRY SOUTH", "FERRY NORTH", "--undo")
    gone = rewritten(tmp_path / "gone.geojson", FERRY_SOUTH={"start": "2026-12-01T20:00:00Z"})
    later = rewritten(tmp_path / "later.geojson", FERRY_SOUTH={"start": "2026-12-01T07:00:05Z"})
    for file in (gone, later):
        day("detect", file)
    assert known() == {}, "five seconds later: another conflict"
    for file in (gone, TASKS / "day.geojson"):
        day("detect", file)
    assert known() == {"EK D 382": "reason EK D 382"}, "the other one was withdrawn"


def test_8_one_page_for_the_captain(day: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Times local and in UTC, places in degrees and minutes, the owner to call, what is acknowledged, the proposal."""
    day("load", rewritten(tmp_path / "owned.geojson", EK_D_382={"owner": "Range office, +45 99 00 00 00"}))
    day("detect")
    day("acknowledge", "FERRY SOUTH", "FERRY NORTH", "--reason", "they see each other", "--by", "Anna")
    proposed = day("resolve", "--within", "12h").out
    number = re.search(r"proposal (\d+)", proposed)
    assert number is not None
    for ending in ("html", "pdf"):
        done = day("report", "FERRY NORTH", tmp_path / f"brief.{ending}", "--tz", "Europe/Copenhagen")
        assert (done.code, done.out) == (0, "")
        assert "glyphs" not in done.err
    text = plain(tmp_path / "brief.html")
    for words in (
        "Brief: FERRY NORTH (Morning ferry northbound)",
        "1 57°37.200'N 009°57.000'E 2026-12-01 07:00:00 CET 2026-12-01 06:00:00 UTC",
        "2026-12-01 09:19:32 to 09:21:53 CET 2026-12-01 08:19:32 to 08:21:53 UTC too close by 0.5 nmi",
        "EK D 382 (Firing area) Range office, +45 99 00 00 00 2026-12-01 08:17:49 to 09:06:39 CET",
        "they see each other",
        f"Proposal {number[1]}, open: FERRY NORTH departs",
        "It begins at 2026-12-01 11:43:00 CET = 2026-12-01 10:43:00 UTC (4 h 43 min later)",
    ):
        assert words in text, words
    assert (tmp_path / "brief.pdf").read_bytes().count(b"/Type /Page\n") == 1, "one page"
    day("delete", "SUB EAST")
    day("report", "FERRY NORTH", tmp_path / "brief.html")
    assert "OUT OF DATE, the scene has changed: objects that were removed" in plain(tmp_path / "brief.html")
    monkeypatch.setenv("CONFLICTDB_UNITS", "metric")
    day("report", tmp_path / "area.html", "EK D 382")  # the key after the file
    text = plain(tmp_path / "area.html")
    assert "57.80000 N 8.90000 E" in text
    assert re.search(r"inside by 8\.\d km", text)
    assert "inside by 8" in day("conflicts").out
    refused = day("report", "FERRY NORTH")
    assert (refused.code, "report 'FERRY NORTH' FILE.pdf" in refused.err) == (4, True)
    assert "did you mean 'FERRY NORTH'?" in day("report", "Ferry nort", tmp_path / "x.html").err
    monkeypatch.setenv("CONFLICTDB_UNITS", "miles")
    assert "must be nautical or metric; got 'miles'" in day("conflicts").err


def plain(page: Path) -> str:
    """Return the text of a page, its cells and lines parted by blanks."""
    body = re.sub(r"<style>.*?</style>", "", page.read_text(), flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", body)))


def test_9_conflicts_as_a_calendar(run: Run) -> None:
    """For a program of calendars, in UTC."""
    run("load", *TUESDAY)
    done = run("detect", "--scene", "tuesday", "--format", "ics")
    assert done.code == 0, done.err
    assert re.findall(r"^DT(?:START|END)[:;].*?(\d{8}T\d{6}Z)", done.out, re.MULTILINE) == [
        "20261201T123233Z",
        "20261201T132034Z",
    ]


def test_9_a_calendar_of_the_area_and_its_conflicts(run: Run) -> None:
    """Every Tuesday from 08 to 16 Danish time but on 22 December; in UTC, which jumps with the Danish clocks."""
    run("detect", *TUESDAY)
    done = run("conflicts", "EK D 382", "--format", "ics")
    assert done.code == 0, done.err
    starts = re.findall(r"^DTSTART:(\d{8}T\d{6}Z)", done.out, re.MULTILINE)
    ends = re.findall(r"^DTEND:(\d{8}T\d{6}Z)", done.out, re.MULTILINE)
    assert len(starts) == 21 + 1
    tuesday, expected = datetime(2026, 11, 3), []
    while tuesday < datetime(2027, 4, 1):
        if tuesday != datetime(2026, 12, 22):
            clock = 6 if tuesday >= datetime(2027, 3, 28) else 7
            expected.append((f"{tuesday:%Y%m%d}T0{clock}0000Z", f"{tuesday:%Y%m%d}T{clock + 8}0000Z"))
        tuesday += timedelta(days=7)
    assert list(zip(starts, ends, strict=True))[:-1] == expected
    assert done.out.count("SUMMARY:EK D 382 (Firing area\\, Tuesdays): active") == 21
    assert "with the 21 times" in done.err
    some = run("conflicts", "EK D 382", "--format", "ics", "--from", "2026-12-02T00:00Z", "--to", "2026-12-30T00:00Z")
    assert some.out.count("BEGIN:VEVENT") == 3, "8, 15 and 29 December"


def test_10_meeting_places_for_a_plotter(day: Run) -> None:
    done = day("conflicts", "--format", "gpx")
    assert done.code == 0, done.err
    assert done.out.count("<wpt ") == len(DAY)


def test_10_routes_for_a_plotter(day: Run, tmp_path: Path) -> None:
    """As GPX in one file, which is read back, and as RTZ, one file a track, which says all of it."""
    gpx = tmp_path / "routes.gpx"
    done = day("export", gpx)
    assert done.code == 0, done.err
    assert "2 areas are left out: 'EK D 382', 'SURVEY-7'" in done.err
    assert "sizes, heights and tolerances are not in the file" in done.err
    assert gpx.read_text().count("<rte>") == 4
    assert day("load", gpx, "--scene", "plotter", "--haven", "100,100,20,20").code == 0
    times_of = {
        scene: {
            row["key"].removeprefix("routes "): (row["start_at"], row["end_at"])
            for row in day("objects", "--scene", scene, "--format", "json").json
            if row["kind"] == "track"
        }
        for scene in ("skagerrak", "plotter")
    }
    assert sorted(times_of["plotter"].values()) == sorted(times_of["skagerrak"].values())
    assert len(times_of["plotter"]) == 4
    folder = tmp_path / "routes"
    done = day("export", folder, "--format", "rtz", "--scene", "skagerrak")
    assert done.out == f"4 routes in {folder}\n"
    names = {"FERRY NORTH.rtz", "FERRY SOUTH.rtz", "SUB EAST.rtz", "TANKER.rtz"}
    assert {one.name for one in folder.iterdir()} == names
    assert day("load", *sorted(folder.iterdir()), "--scene", "again").code == 0
    again = day("detect", "--scene", "again", "--format", "json").json
    assert [(row["a_key"], row["b_key"]) for row in again] == [("FERRY NORTH", "FERRY SOUTH")]
    assert outward(again[0]) == DAY["FERRY NORTH", "FERRY SOUTH"]
    assert "write a folder by --format rtz" in day("export", tmp_path / "all.rtz", "--scene", "skagerrak").err
    refused = day("export", tmp_path / "none", "EK D 382", "--format", "rtz", "--scene", "skagerrak")
    assert (refused.code, "has no track 'EK D 382'" in refused.err) == (4, True)
    assert not (tmp_path / "none").exists()


def test_11_the_first_free_departure(day: Run) -> None:
    """Without a margin it is 10:42:26, planned at 06:00."""
    [free] = day("delays", "FERRY NORTH", "--within", "6h", "--format", "json").json
    assert free["least_later_s"] == pytest.approx(4 * 3600 + 42 * 60 + 25.784, abs=1e-3)


def test_11_the_best_departures_of_a_morning_with_a_margin(day: Run) -> None:
    """Windows in clock times, and who closes each gap; the first one opens five minutes later than without a margin.

    Until then FERRY SOUTH alone is in the way.
    """
    between = ("--from", "2026-12-01T06:00Z", "--to", "2026-12-01T12:00Z", "--best", "3")
    found = day("delays", "FERRY NORTH", *between, "--margin", "5m")
    assert found.code == 0, found.err
    assert "clear by 5 min" in found.out
    assert re.findall(r"^free +(\S+)", found.out, re.MULTILINE) == ["10:48-12:00"]
    closed = re.findall(r"^closed +(\S+), by (.*)", found.out, re.MULTILINE)
    assert closed[0][0].startswith("06:00-")
    assert closed[-1] == ("08:17-10:48", "FERRY SOUTH (Morning ferry southbound)")
    assert re.findall(r"^free +(\S+)", day("delays", "FERRY NORTH", *between).out, re.MULTILINE)[-1] == "10:43-12:00"


def test_12_two_ferries_exchange_their_times(day: Run, tmp_path: Path) -> None:
    """By one command, with the answer of a detection of the changed file."""
    probed = times(day("probe", "--swap", "FERRY NORTH", "FERRY SOUTH", "--format", "json"))
    late = ("--late", "FERRY NORTH", "1h", "--late", "FERRY SOUTH", "-1h")
    assert times(day("probe", *late, "--format", "json")) == probed
    starts = {"FERRY_NORTH": {"start": "2026-12-01T07:00:00Z"}, "FERRY_SOUTH": {"start": "2026-12-01T06:00:00Z"}}
    file = rewritten(tmp_path / "exchanged.geojson", **starts)
    detected = times(day("detect", file, "--scene", "exchanged", "--format", "json"))
    of_ferries = {pair: when for pair, when in detected.items() if any(key.startswith("FERRY") for key in pair)}
    assert probed == of_ferries
    assert probed != {pair: DAY.get(pair) for pair in probed}


def test_13_what_changed_since_yesterday(day: Run, tmp_path: Path) -> None:
    """The lists contain conflicts that are gone."""
    before = day("history", "--format", "json").json[-1]["event"]
    file = rewritten(tmp_path / "late.geojson", FERRY_NORTH={"start": "2026-12-01T06:20:00Z"})
    day("detect", file)
    day("delete", "SURVEY-7")
    day("detect")
    events = day("history", "--after", str(before), "--format", "json").json
    assert sorted(one["kind"] for one in events) == ["changed"] * 2 + ["closed"] * 3
    assert len(day("history", "--since", "24h", "--format", "json").json) == len(events) + 7
    printed = day("conflicts", "--since", "24h").out
    assert "SUB EAST" in printed, "a conflict that is gone"


def test_14_and_15_clear_the_scene_and_undo_it(day: Run) -> None:
    """After the proposal nothing conflicts; after its undoing the same conflicts return, to the second."""
    proposed = day("resolve", "--within", "12h", "--limit", "10m", "--format", "json")
    assert proposed.code == 0, proposed.err
    number = str(proposed.json["proposal_id"])
    left = {one["key"] for one in proposed.json["left"]}
    assert day("apply", number).code == 0
    after = times(day("detect", "--format", "json"))
    assert all(left & set(pair) for pair in after), "only tracks that nothing helps still conflict"
    assert day("apply", number, "--undo").code == 0
    assert times(day("detect", "--format", "json")) == DAY


def test_13_what_is_in_conflict_again_has_not_ended(day: Run) -> None:
    """A conflict that closes and opens again has another number."""
    number = str(day("resolve", "--within", "12h", "--format", "json").json["proposal_id"])
    day("apply", number)
    day("detect")
    assert "7 conflicts have ended since" in day("conflicts", "--since", "1h").out
    day("apply", number, "--undo")
    day("detect")
    assert "ended since" not in day("conflicts", "--since", "1h").out


def test_16_try_a_change_in_a_branch_compare_and_merge(day: Run, tmp_path: Path) -> None:
    assert day("branch", "create", "trial", "--scene", "skagerrak").code == 0
    file = rewritten(tmp_path / "late.geojson", FERRY_NORTH={"start": "2026-12-01T06:20:00Z"})
    assert "trial: 0 added, 1 updated, 0 removed, 5 unchanged" in day("load", file, "--scene", "trial").out
    assert day("detect", "--scene", "trial").code == 0
    difference = day("branch", "diff", "trial", "--format", "json").json
    assert [one["key"] for one in difference["objects"]] == ["FERRY NORTH"]
    assert {(one["a_key"], one["b_key"]) for one in difference["conflicts"]} == {
        ("EK D 382", "FERRY NORTH"),
        ("FERRY NORTH", "FERRY SOUTH"),
    }
    for clock in ("07:17:49", "07:37:49"):
        assert clock in day("branch", "diff", "trial").out, "old and new times are side by side"
    assert day("branch", "merge", "trial").code == 0
    merged = times(day("detect", "--scene", "skagerrak", "--format", "json"))
    assert merged["FERRY NORTH", "FERRY SOUTH"] == ("08:29:32", "08:31:53")


def test_17_a_missing_time_is_refused(run: Run, tmp_path: Path) -> None:
    """In one line that names the object and what it lacks; nothing is stored."""
    scene = json.loads((TASKS / "day.geojson").read_text())
    del scene["features"][2]["properties"]["start"]
    (tmp_path / "mistake.geojson").write_text(json.dumps(scene))
    done = run("load", tmp_path / "mistake.geojson")
    assert done.code == 4
    [line] = done.err.strip().splitlines()
    assert "FERRY NORTH" in line
    assert "start" in line
    assert "no scenes" in run("scenes").out


@pytest.mark.parametrize(
    ("mistake", "remark"),
    [
        ({"swapped": True}, "'FERRY NORTH': lies "),
        ({"speed_kn": 180}, "'FERRY NORTH': travels at "),
        ({"start": "2062-12-01T06:00:00Z"}, "'FERRY NORTH': begins on 2062-12-01"),
    ],
)
def test_17_mistakes_load_with_a_remark(run: Run, tmp_path: Path, mistake: dict[str, Any], remark: str) -> None:
    """One line names the object and how far it is from the rest; another says what came."""
    scene = json.loads((TASKS / "day.geojson").read_text())
    ferry = scene["features"][2]
    if "swapped" in mistake:
        ferry["geometry"]["coordinates"] = [[y, x] for x, y in ferry["geometry"]["coordinates"]]
    else:
        ferry["properties"] |= mistake
    (tmp_path / "mistake.geojson").write_text(json.dumps(scene))
    done = run("load", tmp_path / "mistake.geojson")
    assert done.code == 0
    assert len([line for line in done.err.splitlines() if remark in line]) == 1, done.err
    assert "2 areas" in done.out + done.err
    assert "4 tracks" in done.out + done.err


@pytest.mark.parametrize(
    ("changes", "code", "says"),
    [
        ({"start": "2026-12-01T06:00:00"}, 4, "--time-zone ZONE says where they are local"),
        ({"speed_kn": None, "speed_mps": 16.0}, 0, "6 to 31 kn"),
        ({"start": "2026-12-01T06:00:00+09:00"}, 0, "2026-11-30 21:00 to 2026-12-01 11:54 UTC"),
    ],
)
def test_17_units_and_zones_that_are_others(
    run: Run, tmp_path: Path, changes: dict[str, Any], code: int, says: str
) -> None:
    """Refused with the option that helps; or the line on what came shows the odd number."""
    scene = json.loads((TASKS / "day.geojson").read_text())
    properties = scene["features"][2]["properties"] | changes
    scene["features"][2]["properties"] = {name: value for name, value in properties.items() if value is not None}
    (tmp_path / "mistake.geojson").write_text(json.dumps(scene))
    done = run("load", tmp_path / "mistake.geojson")
    assert done.code == code
    assert says in done.err, done.err


def test_17_a_depth_with_the_wrong_sign(run: Run, tmp_path: Path) -> None:
    """A remark names what is above the sea where others are below."""
    file = rewritten(tmp_path / "mistake.geojson", SUB_EAST={"floor_m": 100, "ceiling_m": 250})
    done = run("load", file)
    assert done.code == 0
    assert done.err.count("'SUB EAST': is 100 m above the sea") == 1, done.err


def test_18_which_vessels_pass_through_closed_boxes(run: Run, tmp_path: Path) -> None:
    """From AIS positions; a vessel without a size takes --haven."""
    rows = ["mmsi,time,lon,lat,length,width"]
    for minute in range(0, 31, 5):
        rows += [
            f"1,2022-11-01T09:{minute + 25:02d}:00Z,{6.4 + 0.01 * minute},55.5,100,20",  # into BOX
            f"2,2022-11-01T09:{minute + 25:02d}:00Z,{7.4 + 0.01 * minute},56.9,,",  # into BOX2, without a size
            f"3,2022-11-01T09:{minute + 25:02d}:00Z,{6.4 + 0.01 * minute},54.0,100,20",  # south of both
        ]
    (tmp_path / "ais.csv").write_text("\n".join(rows) + "\n")
    files = (TASKS / "boxes.geojson", tmp_path / "ais.csv", "--scene", "ais")
    found = run("detect", *files, "--haven", "50m,50m,0.01nmi,0.01nmi", "--format", "json")
    assert set(times(found)) == {("BOX", "1"), ("BOX2", "2")}


def test_19_what_cannot_be_loaded_is_counted_by_reason(run: Run, tmp_path: Path) -> None:
    """Many objects with one mistake are one line, not one line each."""
    square = [[8.0, 57.0], [8.1, 57.0], [8.1, 57.1], [8.0, 57.1], [8.0, 57.0]]
    crossed = [[8.0, 57.0], [8.1, 57.1], [8.1, 57.0], [8.0, 57.1], [8.0, 57.0]]
    features = [
        {
            "type": "Feature",
            "id": f"Z{k}",
            "geometry": {"type": "Polygon", "coordinates": [crossed if k % 2 else square]},
            "properties": {"floor_m": 100 if k else 0, "ceiling_m": 50 if k % 2 == 0 and k else 200},
        }
        for k in range(41)
    ]
    (tmp_path / "zones.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    done = run("load", tmp_path / "zones.geojson", "--skip-invalid", "--scene", "zones")
    assert done.code == 6
    assert done.err.count("left out ") == 2, done.err
    assert done.err.count("(and 19 more: ") == 2
    assert len(done.err.splitlines()) <= 5
    assert "40 LEFT OUT" in done.out


def test_20_what_would_my_route_meet(day: Run, tmp_path: Path) -> None:
    """A route of a plotter without times, sizes and speeds: `probe FILE` takes the options of `load`.

    On the way of FERRY NORTH, 20 minutes behind it, with its size and speed: the answer of task 2.
    """
    day("export", tmp_path / "timed.gpx", "FERRY NORTH")
    route = tmp_path / "mine.gpx"
    route.write_text(re.sub(r"<time>.*?</time>", "", (tmp_path / "timed.gpx").read_text()))
    refused = day("probe", route)
    assert refused.code == 4
    assert "--departure" in refused.err
    options = ("--departure", "2026-12-01T06:20Z", "--speed-kn", "18", "--haven", "0.5nmi,0.2nmi,0.2nmi,0.2nmi")
    found = set(times(day("probe", route, *options, "--format", "json")).items())
    met = {(key, when) for pair, when in found for key in pair if key in {"EK D 382", "FERRY SOUTH"}}
    assert met == {("EK D 382", ("07:37:49", "08:26:39")), ("FERRY SOUTH", ("08:29:32", "08:31:53"))}


def test_a_key_that_no_object_has_gets_a_hint(day: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is tried first need not work, but the error names what does."""
    monkeypatch.chdir(TASKS)
    for words, hint in (
        (["conflicts", "ferry nort"], "did you mean 'FERRY NORTH'?"),
        (["probe", "--late", "Loaded tanker", "20m"], "did you mean 'TANKER'?"),
        (["probe", "--move", "Tankr", "2nmi", "270"], "did you mean 'TANKER'?"),
        (["probe", "--swap", "TANKER", "Ferry norht"], "did you mean 'FERRY NORTH'?"),
        (["delays", "TANKR"], "did you mean 'TANKER'?"),
        (["conflicts", "day.geojson"], "detect FILE` loads it and detects"),
        (["delete", "skagerrak"], "'skagerrak' is a scene: --scene names it"),
        (["explain", "TANKER", "zzz"], "lists all keys"),
    ):
        done = day(*words)
        assert done.code == 4, words
        assert hint in done.err, words


def test_words_that_belong_to_no_option_are_explained(day: Run, tmp_path: Path) -> None:
    """A key with a blank, or a distance in two words, splits in the shell."""
    for words in (["--late", "FERRY", "NORTH", "20m"], ["--move", "SURVEY-7", "2", "nmi", "270"]):
        done = day("probe", *words)
        assert (done.code, f"{words[-1]!r} is of no option: quote a key that has blanks" in done.err) == (2, True)
    done = day("conflicts", "FERRY", "NORTH")
    assert (done.code, "unrecognized arguments: NORTH; quote a key that has blanks" in done.err) == (2, True)
    done = day("probe", TASKS / "ferry.rtz", "--late", "TANKER", "20m")
    assert (done.code, "files go without --late" in done.err) == (2, True)


def test_units_and_zone_are_those_of_the_user_everywhere(
    day: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line after a load, tables, margins and history."""
    arrived = day("load", TASKS / "day.geojson").err
    assert "57°37'N to 58°06'N, 008°00'E to 009°57'E, 2026-12-01 05:30 to 2026-12-01 11:54 UTC, 6 to 18 kn" in arrived
    margin = ("delays", "FERRY NORTH", "--within", "6h", "--margin", "2km")
    assert "clear by 2000 m" in day(*margin).out
    day("detect", "--nearest-m", "5NM")
    assert "2.1 nmi apart" in day("approaches").out
    monkeypatch.setenv("CONFLICTDB_UNITS", "metric")
    monkeypatch.setenv("CONFLICTDB_TZ", "Europe/Copenhagen")
    line = "57.62 N to 58.10 N, 8.00 E to 9.95 E, 2026-12-01 06:30 to 2026-12-01 12:54 Europe/Copenhagen, 3 to 9 m/s"
    assert line in day("load", TASKS / "day.geojson").err
    assert "clear by 2 km" in day(*margin).out
    assert "clear by 2 km" in day("resolve", *margin[2:]).out
    for words in (
        ["detect", "--nearest-m", "5NM"],
        ["approaches"],
        ["history"],
        ["probe", "--late", "FERRY NORTH", "20m"],
    ):
        out = day(*words).out
        assert "+01:00" in out, words
        assert "UTC" not in out, words
    assert "4.0 km apart" in day("approaches").out
    monkeypatch.delenv("CONFLICTDB_TZ")
    done = day("history", "--since", "2026-11-01", "--tz", "Europe/Copenhagen")
    assert "+01:00" in done.out, "its errors name --tz"


def test_one_plan_is_not_exchanged_with_itself(day: Run) -> None:
    done = day("probe", "--swap", "TANKER", "TANKER")
    assert done.code == 2
    assert "--swap needs two keys; got 'TANKER' twice" in done.err


def test_a_conflict_that_is_gone_shows_its_times_once(day: Run) -> None:
    gone = day("probe", "--late", "TANKER", "5h", "--diff")
    assert gone.out.count("06:28:54") == 1, gone.out


def test_the_list_of_objects_shows_the_rule_of_a_weekly_area(run: Run) -> None:
    """Not as if it was closed for four months; times are from the first to the last activation."""
    run("load", TASKS / "firing.geojson")
    listed = run("objects", "--scene", "firing").out
    assert "Tue 08:00-16:00 Europe/Copenhagen except 2026-12-22, 21 times" in listed
    assert "2026-11-03 07:00:00  2027-03-30 14:00:00" in listed
    [row] = run("objects", "--scene", "firing", "--format", "json").json
    assert row["schedule"]["days"] == ["TUE"]


def test_files_of_several_scenes_are_not_compared_silently(run: Run) -> None:
    done = run("detect", TASKS / "firing.geojson", TASKS / "ferry.rtz")
    assert done.code == 0
    assert "scenes 'firing', 'ferry' are not compared with each other: --scene NAME" in done.err
    assert "not compared" not in run("detect", *TUESDAY).err
