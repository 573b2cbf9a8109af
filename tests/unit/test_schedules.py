"""Schedules expand to the spans that independent readings of the same rules give."""

import random
from datetime import UTC, date, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from dateutil import rrule

from conflictdb.errors import InvalidInput
from conflictdb.model.schedules import MOST_SPANS, ed318_schedule, item_d_schedule, rrule_schedule, schedule_of

MINUTE_US = 60_000_000
DAYS = ("MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN")
MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")


def us(text: str) -> int:
    return int(datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()) * 1_000_000


def shown(spans: np.ndarray) -> list[str]:
    """Return spans as text, in UTC."""
    of = [[datetime.fromtimestamp(at / 1e6, UTC).strftime("%m-%dT%H:%M") for at in span] for span in spans.tolist()]
    return [f"{start}/{end}" for start, end in of]


def expanded(source: object, start: str, end: str, *place: float) -> list[str]:
    places = np.array([place]) if place else None
    return shown(schedule_of("area 'A'", source).expand(us(start), us(end), places))


def test_periods_days_and_exceptions() -> None:
    """Tuesdays 08 to 10 from June, not on the 23rd, in a zone that is two hours ahead."""
    tuesdays = {"days": ["TUE"], "periods": [["08:00", "10:00"]], "timezone": "Europe/Zurich", "from": "2026-06-01"}
    found = expanded(tuesdays | {"except": ["2026-06-23"], "until": "2026-06-30"}, "2026-01-01", "2027-01-01")
    assert found == [f"06-{day:02}T06:00/06-{day:02}T08:00" for day in (2, 9, 16, 30)]


def test_a_period_belongs_to_the_day_on_which_it_starts() -> None:
    source = {"days": ["SUN"], "periods": [["22:00", "06:00"]]}
    assert expanded(source, "2026-06-02", "2026-06-15") == ["06-07T22:00/06-08T06:00", "06-14T22:00/06-15T00:00"]
    assert expanded(source | {"until": "2026-06-07"}, "2026-06-02", "2026-06-30") == ["06-07T22:00/06-08T06:00"]
    assert expanded(source | {"except": ["2026-06-08"]}, "2026-06-02", "2026-06-10") == ["06-07T22:00/06-08T06:00"]
    assert expanded(source | {"except": ["SUN"]}, "2026-06-02", "2026-06-10") == []


def test_clocks_that_change_lengthen_a_period() -> None:
    """Europe/Zurich skips 02:00 to 03:00 on 29 March and repeats it on 25 October: the longer reading counts."""
    source = {"periods": [["02:30", "03:30"]], "timezone": "Europe/Zurich"}
    assert expanded(source, "2026-03-28", "2026-03-31") == [
        "03-28T01:30/03-28T02:30",
        "03-29T00:30/03-29T01:30",
        "03-30T00:30/03-30T01:30",
    ]
    assert expanded(source, "2026-10-24T12:00", "2026-10-25T12:00") == ["10-25T00:30/10-25T02:30"]
    until = {"periods": [["01:00", "02:30"]], "timezone": "Europe/Zurich"}
    assert expanded(until, "2026-10-24T12:00", "2026-10-25T12:00") == ["10-24T23:00/10-25T01:30"]
    whole = {"timezone": "Europe/Zurich", "dates": ["2026-10-25"]}
    assert expanded(whole, "2026-10-01", "2026-11-01") == ["10-24T22:00/10-25T23:00"]


@pytest.mark.parametrize("zone", ["Europe/Zurich", "America/St_Johns", "Australia/Lord_Howe", "UTC", "Asia/Kathmandu"])
def test_local_times_equal_a_search_minute_by_minute(zone: str) -> None:
    """Over a year, both changes of clocks, a leap day and week 53: away from the changes no minute differs."""
    source = {"days": ["MON", "THU"], "periods": [["21:15", "04:45"], ["12:00", "12:30"]], "timezone": zone}
    spans = schedule_of("area 'A'", source).expand(us("2020-01-01"), us("2021-01-10"))
    at = np.arange(us("2020-01-01"), us("2021-01-10"), 15 * MINUTE_US)
    active = np.zeros(len(at), bool)
    for start, end in spans:
        active |= (at >= start) & (at < end)
    tz = ZoneInfo(zone)
    wanted = []
    for instant in at.tolist():
        local = datetime.fromtimestamp(instant / 1e6, tz)
        minute, today = 60 * local.hour + local.minute, DAYS[local.weekday()]
        yesterday = DAYS[(local.date() - timedelta(days=1)).weekday()]
        noon = 720 <= minute < 750 and today in ("MON", "THU")
        night = (minute >= 1275 and today in ("MON", "THU")) or (minute < 285 and yesterday in ("MON", "THU"))
        wanted.append(noon or night)
    assert (active == np.array(wanted)).all()
    assert active.any()


def test_rules_of_calendars_equal_their_library() -> None:
    """Lines of RFC 5545 give the starts of dateutil, in a local zone across both changes of clocks."""
    rules = [
        "FREQ=WEEKLY;BYDAY=TU,TH;INTERVAL=2",
        "FREQ=MONTHLY;BYDAY=-1FR",
        "FREQ=YEARLY;BYWEEKNO=53;BYDAY=MO",
        "FREQ=YEARLY;BYMONTH=2;BYMONTHDAY=29",
        "FREQ=DAILY;COUNT=700",
        "FREQ=MONTHLY;BYMONTHDAY=-1,1;BYSETPOS=-1",
        "FREQ=DAILY;INTERVAL=10;UNTIL=20280101T000000Z",
    ]
    zone = ZoneInfo("America/New_York")
    for rule in rules:
        text = (
            f"DTSTART;TZID=America/New_York:20240229T023000\nRRULE:{rule}\nEXDATE;TZID=America/New_York:20240331T023000"
        )
        found = rrule_schedule("area 'A'", text, "PT90M").departures(us("2024-01-01"), us("2030-01-01"))
        endless, _, most = rule.partition(";COUNT=")
        local = rrule.rrulestr(endless.replace("T000000Z", "T000000"), dtstart=datetime(2024, 2, 29, 2, 30))
        days = local.between(datetime(2024, 1, 1), datetime(2030, 1, 1), inc=True)
        # A time in the gap of the clocks is ignored, and does not count.
        days = [day for day in days if not (day.month == 3 and day.weekday() == 6 and 8 <= day.day <= 14)]
        days = days[: int(most or len(days))]
        starts = {datetime(2024, 2, 29, 2, 30), *days} - {datetime(2024, 3, 31, 2, 30)}
        wanted = sorted(int(day.replace(tzinfo=zone).timestamp()) * 1_000_000 for day in starts)
        assert found.tolist() == wanted, rule


@pytest.mark.parametrize("start", [datetime(1, 1, 1, 3, 30), datetime(1999, 12, 31, 3, 30), datetime(2027, 6, 1, 3)])
def test_rules_that_began_long_ago_are_found_at_once(start: datetime) -> None:
    """The library would look at every hour since, and for a rule that never matches until the year 9999."""
    for rule in ("FREQ=HOURLY;INTERVAL=7", "FREQ=DAILY;INTERVAL=11", "FREQ=WEEKLY;INTERVAL=3;BYDAY=MO,FR;WKST=SU"):
        text = f"DTSTART:{start.year:04}{start:%m%dT%H%M%SZ}\nRRULE:{rule}"
        found = rrule_schedule("area 'A'", text, "PT1H")
        starts = found.departures(us("2027-01-01"), us("2027-12-01"))
        recent = start + timedelta(days=7 * 11 * 3 * (max((datetime(2026, 12, 1) - start).days, 0) // (7 * 11 * 3)))
        every = rrule.rrulestr(rule, dtstart=recent).between(datetime(2027, 1, 1), datetime(2027, 12, 1))
        wanted = {int(at.replace(tzinfo=UTC).timestamp()) * 1_000_000 for at in every}
        # DTSTART is an occurrence, whatever the rule says.
        assert set(starts.tolist()) - {us(start.isoformat())} == wanted - {us(start.isoformat())}, rule
    for never in ("FREQ=MONTHLY;BYDAY=MO;BYSETPOS=31", "FREQ=YEARLY;BYWEEKNO=53;BYMONTH=6"):
        schedule = rrule_schedule("area 'A'", f"DTSTART:20200101T080000Z\nRRULE:{never}", "PT1H")
        assert not len(schedule.departures(us("2027-01-01"), us("2028-01-01")))


def test_rdate_exdate_and_dtend() -> None:
    text = "DTSTART:20260601T080000Z\nDTEND:20260601T093000Z\n"
    text += "RDATE:20260603T080000Z,20260605T080000Z\nEXDATE:20260605T080000Z"
    assert expanded({"rrule": text}, "2026-01-01", "2027-01-01") == [
        "06-01T08:00/06-01T09:30",
        "06-03T08:00/06-03T09:30",
    ]
    days = {"rrule": "DTSTART;VALUE=DATE;TZID=Europe/Zurich:20261024\nRRULE:FREQ=DAILY;COUNT=2"}
    assert expanded(days, "2026-01-01", "2027-01-01") == ["10-23T22:00/10-25T23:00"]


def test_dates_in_the_hour_that_exists_twice() -> None:
    """RDATE and EXDATE of another zone mean the second hour, if they say so; DTEND is after all hours in between."""
    start = "DTSTART;TZID=Europe/Zurich:20261020T023000\nDURATION:PT30M\n"
    second = {"rrule": f"{start}RDATE:20261025T013000Z"}
    assert expanded(second, "2026-10-21", "2026-11-01") == ["10-25T01:30/10-25T02:00"]
    both = {"rrule": f"{start}RDATE:20261025T003000Z,20261025T013000Z"}
    assert expanded(both, "2026-10-21", "2026-11-01") == ["10-25T00:30/10-25T01:00", "10-25T01:30/10-25T02:00"]
    rule = "RRULE:FREQ=DAILY;COUNT=6\nEXDATE:20261025T"
    assert expanded({"rrule": f"{start}{rule}003000Z"}, "2026-10-25", "2026-11-01") == []
    assert expanded({"rrule": f"{start}{rule}013000Z"}, "2026-10-25", "2026-11-01") == ["10-25T00:30/10-25T01:00"]
    # Five hours in autumn; in spring four by the clock, though three pass.
    for day, wanted in (("20261025", "10-24T22:00/10-25T03:00"), ("20260329", "03-28T23:00/03-29T03:00")):
        lines = f"DTSTART;TZID=Europe/Zurich:{day}T000000\nDTEND;TZID=Europe/Zurich:{day}T040000"
        assert expanded({"rrule": lines}, "2026-01-01", "2027-01-01") == [wanted]


@pytest.mark.parametrize("name", ["Europe/Zurich", "Australia/Lord_Howe", "Africa/Casablanca", "America/St_Johns"])
def test_days_in_zones_equal_clock_by_clock(name: str) -> None:
    """Periods of many days at once have the instants of `zoneinfo`; outward on days on which clocks change."""
    zone = ZoneInfo(name)
    for start, end in (("00:00", "24:00"), ("01:45", "02:15"), ("02:30", "03:30"), ("23:30", "00:30")):
        source = {"periods": [[start, end]], "timezone": name}
        found = schedule_of("area 'A'", source).departures(us("2025-01-02"), us("2027-12-30")).tolist()
        wanted = set()
        for day in range(date(2025, 1, 1).toordinal(), date(2028, 1, 1).toordinal()):
            hour, minute = map(int, start.split(":"))
            local = datetime.combine(date.fromordinal(day), datetime.min.time().replace(hour, minute), zone)
            wanted.add(min(int(local.replace(fold=fold).timestamp()) for fold in (0, 1)) * 1_000_000)
        assert found == sorted(at for at in wanted if us("2025-01-02") <= at < us("2027-12-30"))


def test_daily_periods_of_zones() -> None:
    """ED-318: any day from midnight to midnight, in the offset of its times, is without a gap."""
    every = [{"day": ["ANY"], "startTime": "00:00:00.00+01:00", "endTime": "00:00:00.00+01:00"}]
    assert shown(ed318_schedule("zone 'A'", every).expand(us("2026-06-01"), us("2026-06-09"))) == [
        "06-01T00:00/06-09T00:00"
    ]
    night = {"day": ["SAT"], "startEvent": "EECT", "endTime": "06:00:00Z", "startTime": None}
    assert expanded({"ed318": [night]}, "2026-06-01", "2026-06-09", 8.0, 47.0) == ["06-06T19:58/06-07T06:00"]


# --- NOTAM item D


class DrawnItemD:
    """A text of item D and its meaning, from one random choice."""

    def __init__(self, dice: random.Random) -> None:
        self.start = date(2026, dice.choice([1, 2, 6, 12]), dice.randint(1, 20))
        self.end = self.start + timedelta(days=dice.randint(5, 45))
        self.kind = dice.choice(["daily", "weekdays", "range", "dates"])
        groups = 2 if self.kind in ("weekdays", "dates") and dice.random() < 0.3 else 1
        self.groups = [self._group(dice) for _ in range(groups)]
        self.text = ", ".join(text for text, _, _, _ in self.groups)

    def _group(self, dice: random.Random) -> tuple[str, set[date], list[tuple[int, int]], set[date]]:
        every = [self.start + timedelta(days=i) for i in range((self.end - self.start).days + 1)]
        if self.kind == "daily":
            text, days = dice.choice(["DAILY ", ""]), set(every)
        elif self.kind == "weekdays":
            first, last = dice.randrange(7), dice.randrange(7)
            text = f"{DAYS[first]}-{DAYS[last]} " if dice.random() < 0.5 else f"{DAYS[first]} {DAYS[last]} "
            between = {(first + i) % 7 for i in range((last - first) % 7 + 1)} if "-" in text else {first, last}
            days = {day for day in every if day.weekday() in between}
            days |= {self.start - timedelta(days=1)} if (self.start - timedelta(days=1)).weekday() in between else set()
        elif self.kind == "range":
            first, last = sorted(dice.sample(every, 2))
            month = "" if first.month == last.month else f"{MONTHS[last.month - 1]} "
            text = f"{MONTHS[first.month - 1]} {first.day:02}-{month}{last.day:02} "
            days = {day for day in every if first <= day <= last}
        else:
            days = set(dice.sample(every, 3))
            text, month = "", 0
            for day in sorted(days):
                text += f"{MONTHS[day.month - 1]} {day.day:02} " if day.month != month else f"{day.day:02} "
                month = day.month
        if self.kind == "daily":
            days.add(self.start - timedelta(days=1))
        periods, texts = [], []
        for _ in range(dice.choice([1, 1, 2])):
            first, last = 15 * dice.randrange(96), 15 * dice.randrange(96)
            end = "2359" if dice.random() < 0.1 else f"{last // 60:02}{last % 60:02}"
            last = 1440 if end == "2359" else last
            texts.append(f"{first // 60:02}{first % 60:02}-{end}")
            periods.append((first, last if last > first else last + 1440))
        if dice.random() < 0.1:
            texts, periods = ["H24"], [(0, 1440)]
        text += " ".join(texts)
        out: set[date] = set()
        if dice.random() < 0.4:
            inside = sorted(dice.sample(every, 2))
            text += " EXC " + " ".join(f"{MONTHS[day.month - 1]} {day.day:02}" for day in inside)
            out = set(inside)
        elif dice.random() < 0.2:
            weekday = dice.randrange(7)
            text += f" EXC {DAYS[weekday]}"
            out = {day for day in [self.start - timedelta(days=1), *every] if day.weekday() == weekday}
        return text, days, periods, out

    def active(self, minutes: np.ndarray) -> np.ndarray:
        """Return whether each minute since 1970 is active: periods laid on the days, one by one."""
        found = np.zeros(len(minutes), bool)
        for _, days, periods, out in self.groups:
            for day in days - out:
                midnight = (day - date(1970, 1, 1)).days * 1440
                for first, last in periods:
                    found |= (minutes >= midnight + first) & (minutes < midnight + last)
        low, high = ((day - date(1970, 1, 1)).days * 1440 for day in (self.start, self.end))
        return found & (minutes >= low) & (minutes < high + 1440)


def test_500_texts_of_item_d_equal_a_search_minute_by_minute() -> None:
    dice = random.Random(20260601)  # noqa: S311
    for _ in range(500):
        item = DrawnItemD(dice)
        valid = us(item.start.isoformat()), us((item.end + timedelta(days=1)).isoformat())
        spans = item_d_schedule("area 'A'", item.text, valid).expand(valid[0] - 10 * MINUTE_US, valid[1] + 10**12)
        minutes = np.arange(valid[0] // MINUTE_US - 60, valid[1] // MINUTE_US + 3 * 1440)
        at = minutes * MINUTE_US
        place = np.searchsorted(spans[:, 0], at, side="right") - 1
        found = (place >= 0) & (at < np.append(spans[:, 1], 0)[place])
        assert (found == item.active(minutes)).all(), (item.text, item.start, item.end)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("JUN 08-10 SR-SS EXC 09", ["06-08T03:33/06-08T19:22", "06-10T03:32/06-10T19:23"]),
        ("12 0700-1500, 18 0900-1100", ["06-12T07:00/06-12T15:00", "06-18T09:00/06-18T11:00"]),
        ("MON 0800-WED 1700 EXC 08 15 22", ["06-01T08:00/06-03T17:00", "06-29T08:00/06-30T00:00"]),
        ("08 1000-12 1200", ["06-08T10:00/06-12T12:00"]),
        ("30 2200-0600", ["06-29T22:00/06-30T00:00"]),
        ("DAILY EXC SUN 0000-2400 EXC 01-27", ["06-29T00:00/06-30T00:00"]),
        ("SAT SS MINUS30-SS PLUS90 EXC 06 13 20", ["06-27T18:57/06-27T20:58"]),
    ],
)  # fmt: skip
def test_item_d_as_in_the_manuals(text: str, wanted: list[str]) -> None:
    text = text.replace("30 2200", "29 2200")
    schedule = item_d_schedule("area 'A'", text, (us("2026-06-01"), us("2026-06-30")))
    assert shown(schedule.expand(us("2026-01-01"), us("2027-01-01"), np.array([[8.0, 47.0]]))) == wanted


@pytest.mark.parametrize(
    "text",
    ["", "HO", "MON-FRI 0700-1000 EXC HOL", "MON 0900", "0900-1700 MON SOMETIMES", "JUN 31 0800-0900", "JUL 02 H24",
     "JUN 08 MON 0800-1000", "JUN 12-08 H24", "0860-0900", "2400-0100", "MON", "DAILY 08-10", "MON-FRI 0800-1000 EXC",
     "DAILY 0800-1000 EXC 14 16 0700-0900", "DAILY MON 0800-1000", "0800-1700 LOCAL", "PERM", "08:00-10:00",
     "MON TUE 0800-FRI 1700", "SR PLUS-SS"],
)  # fmt: skip
def test_item_d_that_is_not_understood_is_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match=r"area 'A': schedule\.notam: "):
        item_d_schedule("area 'A'", text, (us("2026-06-01"), us("2026-06-30")))


# --- the sun


def altitude_deg(at_s: np.ndarray, lon: float, lat: float) -> np.ndarray:
    """Return the sun's altitude by the Astronomical Almanac's low-precision formula and sidereal time."""
    n = at_s / 86400.0 + 2440587.5 - 2451545.0
    g = np.radians(357.528 + 0.9856003 * n)
    ecliptic = np.radians(280.460 + 0.9856474 * n + 1.915 * np.sin(g) + 0.020 * np.sin(2 * g))
    tilt = np.radians(23.439 - 4e-7 * n)
    ascension = np.arctan2(np.cos(tilt) * np.sin(ecliptic), np.cos(ecliptic))
    declination = np.arcsin(np.sin(tilt) * np.sin(ecliptic))
    hour = np.radians((18.697374558 + 24.06570982441908 * n) * 15.0 + lon) - ascension
    phi = np.radians(lat)
    return np.degrees(np.arcsin(np.sin(phi) * np.sin(declination) + np.cos(phi) * np.cos(declination) * np.cos(hour)))


@pytest.mark.parametrize(
    ("lon", "lat"),
    [(-179.0, -78.0), (-100.0, -45.0), (0.0, 0.0), (8.0, 47.0), (20.0, 65.7), (179.9, 66.5), (20.0, 70.0), (0.0, 89.0)],
)
def test_times_of_the_sun_hold_all_of_its_time_and_little_more(lon: float, lat: float) -> None:
    """Every minute with the sun up is in sunrise to sunset, and every one with the sun down in sunset to sunrise."""
    at_s = np.arange(us("2026-05-15") // 10**6, us("2026-08-01") // 10**6, 60)
    at_s = np.concatenate([at_s, at_s + 193 * 86400])
    altitude = altitude_deg(at_s.astype(float), lon, lat)
    for names, edge, sign in (
        (["sunrise", "sunset"], -0.8333, 1.0),
        (["sunset", "sunrise"], -0.8333, -1.0),
        (["civil_dawn", "civil_dusk"], -6.0, 1.0),
    ):
        spans = schedule_of("area 'A'", {"periods": [names]}).expand(
            us("2026-05-01"), us("2027-03-01"), np.array([[lon, lat]])
        )
        place = np.searchsorted(spans[:, 0], at_s * 10**6, side="right") - 1
        active = (place >= 0) & (at_s * 10**6 < np.append(spans[:, 1], 0)[place])
        up = sign * (altitude - edge)
        assert active[up > 0.01].all()
        # A minute of rounding is up to a quarter of a degree.
        assert not active[up < -0.35].any()


def test_the_sun_at_70_degrees_in_june_and_december() -> None:
    """The polar day is one long day, without night; the polar night has no day, and its civil twilight remains."""
    june, december = ("2026-06-10", "2026-06-13"), ("2026-12-10", "2026-12-12")
    day, night, twilight = (
        {"periods": [names]} for names in (["sunrise", "sunset"], ["sunset", "sunrise"], ["civil_dawn", "civil_dusk"])
    )
    assert expanded(day, *june, 20.0, 70.0) == ["06-10T00:00/06-13T00:00"]
    assert expanded(night, *june, 20.0, 70.0) == []
    assert expanded(day, *december, 20.0, 70.0) == []
    assert expanded(night, *december, 20.0, 70.0) == ["12-10T00:00/12-12T00:00"]
    assert expanded(twilight, *december, 20.0, 70.0) == ["12-10T08:16/12-10T12:49", "12-11T08:18/12-11T12:48"]


def test_a_wide_area_has_no_day_in_the_polar_night() -> None:
    """Noons of its corners are minutes apart: the day that does not happen was active between them."""
    corners = np.array([[lon, lat] for lon in (14.0, 16.0) for lat in (78.0, 78.5)])
    window = us("2026-12-20"), us("2026-12-22")
    for names, spans in (
        (["sunrise", "sunset"], 0),
        (["sunrise-30min", "sunset+30min"], 0),
        (["sunset", "sunrise"], 1),
    ):
        schedule = schedule_of("area 'A'", {"periods": [names]})
        assert len(schedule.expand(*window, corners)) == spans, names
    half = np.array([[14.0, 66.0], [14.0, 78.0]])  # one corner has a day
    assert len(schedule_of("area 'A'", {"periods": [["sunrise", "sunset"]]}).expand(*window, half)) == 2


def test_a_wide_area_is_active_from_its_first_sunrise_to_its_last_sunset() -> None:
    source = {"periods": [["sunrise", "sunset"]]}
    schedule = schedule_of("area 'A'", source)
    window = us("2026-06-01"), us("2026-06-02")
    east, west = (schedule.expand(*window, np.array([[lon, 50.0]]))[0] for lon in (9.0, 1.0))
    both = schedule.expand(*window, np.array([[1.0, 50.0], [9.0, 50.0]]))[0]
    assert both.tolist() == [min(east[0], west[0]), max(east[1], west[1])]
    assert expanded(source | {"place": [1.0, 50.0]}, "2026-06-01", "2026-06-02", 100.0, 0.0) == shown(west[None])


# --- refusals and limits


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ([], "schedule: must be a schedule, or a list"),
        ("MON-FRI", "schedule: must be an object"),
        ({"day": ["MON"]}, "schedule.day: is not understood"),
        ({"days": ["MONDAY"]}, r"schedule.days\[0\]: must be a day of"),
        ({"periods": [["8:00", "10:00"]]}, r"schedule.periods\[0\]\[0\]: must be a time of day"),
        ({"periods": []}, "schedule.periods: must be a list"),
        ({"periods": [["08:00", "dusk"]]}, r"schedule.periods\[0\]\[1\]: must be a time of day"),
        ({"timezone": "Mars/Olympus"}, "schedule.timezone: must be a time zone"),
        ({"timezone": "../../etc/passwd"}, "schedule.timezone: must be a time zone"),
        ({"from": "2026-06-31"}, "schedule.from: must be a date"),
        ({"from": "2026-06-02", "until": "2026-06-01"}, "schedule.until: must be after"),
        ({"from": "2026-06-01T00:00:00"}, "schedule.from: must be an instant with its offset"),
        ({"place": [0, 91]}, "schedule.place: must be"),
        ([{}, {"days": "MON"}], r"schedule\[1\].days: must be a list"),
        ({"rrule": "RRULE:FREQ=DAILY"}, "needs one line DTSTART"),
        ({"rrule": "DTSTART:20260601T080000Z\nRRULE:FREQ=DAILY"}, "needs how long it lasts"),
        ({"rrule": "DTSTART:20260601T080000\nDURATION:PT1H"}, "needs TZID, or Z"),
        ({"rrule": "DTSTART:20260601T080000Z\nDURATION:PT1H\nRRULE:FREQ=SECONDLY"}, "FREQ must be HOURLY or rarer"),
        (
            {"rrule": "DTSTART:20260601T080000Z\nDURATION:PT1H\nRRULE:FREQ=DAILY;BYMONTH=2;BYMONTHDAY=30"},
            "never happens",
        ),
        ({"rrule": "DTSTART:20260601T080000Z\nDURATION:PT1H\nRRULE:FREQ=DAILY;BYDAY=XX"}, "RRULE is not understood"),
        ({"rrule": "DTSTART:20260601T080000Z\nDURATION:PT1H\nEXRULE:FREQ=DAILY"}, "has lines of"),
        ({"rrule": "DTSTART:20260601T080000Z", "duration": "2 hours"}, "DURATION must be as"),
        ({"ed318": [{"day": ["ANY"], "startTime": "08:00", "endTime": "10:00"}]}, "needs an offset from UTC"),
        ({"ed318": [{"day": ["HOL"], "startEvent": "SR", "endEvent": "SS"}]}, "must be days of"),
        ({"ed318": [{"day": ["ANY"], "startEvent": "SR", "startTime": "08:00Z", "endEvent": "SS"}]}, "needs either"),
        ({"ed318": [{"startEvent": "SR", "endEvent": "NOON"}]}, "must be one of BMCT"),
        ({"ed318": [{"startEvent": "SR", "endEvent": "SS", "period": 1}]}, "is not understood"),
    ],
)
def test_a_schedule_that_is_not_understood_is_refused(source: object, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        schedule_of("area 'A'", source)


def test_too_many_activations_and_a_missing_place_are_refused() -> None:
    dense = {"periods": [[f"{m // 60:02}:{m % 60:02}", f"{m // 60:02}:{m % 60 + 1:02}"] for m in range(0, 1440, 4)]}
    with pytest.raises(InvalidInput, match=f"more than {MOST_SPANS:,} activations in 365 days"):
        schedule_of("area 'A'", dense).expand(us("2026-01-01"), us("2027-01-01"))
    with pytest.raises(InvalidInput, match="needs a place"):
        schedule_of("area 'A'", {"periods": [["sunrise", "10:00"]]}).expand(us("2026-01-01"), us("2027-01-01"))


def test_the_first_and_last_days_of_the_calendar_are_no_error() -> None:
    source = {"periods": [["22:00", "06:00"]], "from": "9999-12-30"}
    schedule = schedule_of("area 'A'", source)
    assert len(schedule.expand(us("9999-12-01"), 253_402_300_799_999_999)) <= 3
    assert len(schedule_of("area 'A'", {}).expand(-62_135_596_800_000_000, us("0001-02-01"))) == 1


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("periods", {"periods": [["00:00", "00:01"]] * 10_001}),
        ("dates", {"dates": ["2026-03-01"] * 10_001}),
        ("ed318", {"ed318": [{"day": ["MON"], "startTime": "08:00:00Z", "endTime": "09:00:00Z"}] * 10_001}),
    ],
)
def test_lists_without_end_are_refused_at_once(name: str, more: dict[str, object]) -> None:
    with pytest.raises(InvalidInput, match=f"schedule.{name}: must have at most 10,000 entries; got 10,001"):
        schedule_of("area 'A'", more)


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("DAILY 0800/1000", "DAILY 0800-1000"),
        ("2230/0100", "2230-0100"),
        ("0800-1000 1200-1300 DLY", "DAILY 0800-1000 1200-1300"),
        ("DAILY 0000-0600 UTC", "DAILY 0000-0600"),
        ("2606051000 TO 2606051400 2606062200 TO 2606070359", "JUN 05 1000-1400, JUN 06 2200-0359"),
        ("2606051000 TO 2606072400,2606091000 TO 2606091100", "JUN 05 1000-JUN 07 2400, JUN 09 1000-1100"),
    ],
)
def test_item_d_beside_its_grammar(text: str, same: str) -> None:
    """Forms that public NOTAM have, and that have one reading."""
    valid = us("2026-06-05"), us("2026-06-12")
    spans = item_d_schedule("area 'A'", text, valid).expand(*valid)
    assert len(spans)
    assert spans.tolist() == item_d_schedule("area 'A'", same, valid).expand(*valid).tolist()


@pytest.mark.parametrize(
    "text",
    [
        "0800-1000 05 1200-1300 06",
        "MON 0800-1000 DAILY",
        "0800-1000 DAILY MON",
        "2606051000 TO 2606051000",
        "2606311000 TO 2607011000",
        "2605011000 TO 2605011400",
        "2606051060 TO 2606051400",
        "2606051000 TO 2606051400 DAILY",
        "2606051000 TO 26060514000",
        "SR/SS",
        "0800/10",
    ],
)
def test_item_d_that_has_another_reading_is_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match=r"area 'A': schedule\.notam: "):
        item_d_schedule("area 'A'", text, (us("2026-06-05"), us("2026-06-12")))


def test_lists_of_many_schedules_are_limited_together() -> None:
    """Each list was within the limit, and all took minutes to refuse."""
    parts = [{"periods": [["00:00", "01:00"]] * 5_001}] * 2
    with pytest.raises(InvalidInput, match="lists of at most 10,000 entries in all; got 10,002"):
        schedule_of("area 'A'", parts)
