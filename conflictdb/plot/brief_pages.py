"""One plan for its captain or range officer: when and where it is, whom it meets, whom to call, what is proposed."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import shapely

from conflictdb.core.depths import depths
from conflictdb.core.ranking import facts_of, missing_text, worst_first
from conflictdb.errors import InvalidInput, printable
from conflictdb.model.activations import INFINITY_US, MINUS_INFINITY_US
from conflictdb.model.brief import Brief
from conflictdb.model.clock import Clock, rounded_delay_us
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.notebook import whole_second
from conflictdb.model.plans import Area, Track
from conflictdb.model.proposals import duration_text
from conflictdb.model.recurring_plans import spans_of
from conflictdb.model.results import Conflict, Verdict, labelled
from conflictdb.model.schedules import schedule_of
from conflictdb.model.schedules.words import schedule_text
from conflictdb.plot.report import check_name, rendered
from conflictdb.plot.section import Section
from conflictdb.plot.style import written_whole

# Rows that fit on a page; further rows are counted.
_MOST_PLACES: Final = 24
_MOST_TIMES: Final = 16
_MOST_CONFLICTS: Final = 12


def write(brief: Brief, file: str | Path, now: datetime | None = None) -> None:
    """Write a brief, .html or .pdf; whole, or not at all. Raises as `report.write`."""
    file = check_name(file)
    now = (now or datetime.now(UTC)).replace(microsecond=0)
    title = f"Brief: {printable(labelled(brief.plan.key, brief.plan.name))}"
    made = f"Made {_line(_moment(brief, now, up=False))} by conflictdb {version('conflictdb')}."
    warning = ""
    if not brief.state.is_current:
        remark = printable(brief.state.remark or "changes wait for detection")
        warning = f"NOT COMPLETE: {remark}. Conflicts may be missing."
    content = rendered(
        file, title, made, warning, [_facts(brief), _when(brief, now), *_meets(brief), *_remedies(brief)]
    )
    with written_whole(file) as part:
        part.write_bytes(content)


def _facts(brief: Brief) -> Section:
    plan = brief.plan
    facts = [
        ("Scene", brief.scene.name),
        ("Owner", plan.owner),
        ("Class", plan.object_class),
        ("Heights", _heights(plan)),
        ("Schedule", _rule(plan)),
    ]
    return Section("The plan", rows=[[name, printable(str(value))] for name, value in facts if value])


def _heights(plan: Area | Track) -> str:
    if isinstance(plan, Track) and (plan.floors_m is not None or plan.ceilings_m is not None):
        return "change on the way"
    if plan.floor_m is None and plan.ceiling_m is None:
        return "all"
    low = "the ground or sea bed" if plan.floor_m is None else f"{plan.floor_m:g} m"
    high = "no limit" if plan.ceiling_m is None else f"{plan.ceiling_m:g} m"
    return f"{low} to {high}"


def _rule(plan: Area | Track) -> str | None:
    if plan.schedule is None:
        return None
    try:
        return schedule_text(schedule_of(f"plan {plan.key!r}", plan.schedule))
    except InvalidInput:
        return "not understood"


def _when(brief: Brief, now: datetime) -> Section:
    """Return where and when the plan is."""
    plan, place = brief.plan, brief.units.place
    if isinstance(plan, Area):
        coming = [span for span in brief.activations if span[1] is None or span[1] > now]
        shown = coming or brief.activations[-_MOST_TIMES:]
        rows = [_period(brief, *span).split("\n") for span in shown[:_MOST_TIMES]]
        columns = max(map(len, rows), default=0)
        parts = [shapely.get_coordinates(part.exterior)[:-1].tolist() for part in shapely.get_parts(plan.footprint)]
        corners = [place(lon, lat) for part in parts for lon, lat in part]
        text = f"Corners: {'; '.join(corners[:_MOST_PLACES])}{_more(corners, _MOST_PLACES)}."
        text += f" The next {_MOST_TIMES} of {len(coming):,} times." if len(coming) > _MOST_TIMES else ""
        text += " All its times are over." if rows and not coming else ""
        text += "" if rows else " It has no times: its schedule has none, or is not understood."
        rows = [[*row, ""][:columns] for row in rows]
        return Section("Where and when", text, ["Active", "in UTC"][:columns], rows)
    places = plan.positions_deg.tolist()
    rows = [
        [str(n), place(*where), *_instant(brief, int(at)).split("\n")]
        for n, (where, at) in enumerate(zip(places, plan.times_us, strict=True), 1)
    ]
    if len(rows) > _MOST_PLACES:  # the last one is the port
        rows = [*rows[: _MOST_PLACES - 1], ["…", *("" for _ in rows[0][1:])], rows[-1]]
    departures = () if plan.departures_us is None else plan.departures_us
    text = ""
    if len(departures):
        some = ", ".join(_line(_instant(brief, int(at))) for at in departures[:_MOST_TIMES])
        text = f"Departs {len(departures):,} times: {some}{_more(departures, _MOST_TIMES)}. The first voyage:"
    return Section("Where and when", text, ["", "Place", "Time", "UTC"][: len(rows[0])], rows)


def _meets(brief: Brief) -> Iterator[Section]:
    """Yield the conflicts of the plan, the worst first."""
    if not brief.conflicts:
        yield Section("Conflicts", "No conflict is known.")
        return
    plans = [brief.plan, *brief.others.values()]
    areas = [one for one in plans if isinstance(one, Area)]
    tracks = [one for one in plans if isinstance(one, Track)]
    pairs = {(one.a_key, one.b_key) for one in brief.conflicts if one.is_current is not False}
    known = depths(brief.scene, areas, tracks, only=pairs) if pairs else {}
    rows = []
    for one in worst_first(brief.conflicts, known)[:_MOST_CONFLICTS]:
        is_a = one.a_key == brief.plan.key
        key, name = (one.b_key, one.b_name) if is_a else (one.a_key, one.a_name)
        other = brief.others.get(key)
        place = one.first_contact_deg
        facts = [None if one.verdict is Verdict.CONFLICT else str(one.verdict)]
        facts += [missing_text(facts_of(one).moving, known.get((one.a_key, one.b_key)), brief.units)]
        facts += [None if place is None else f"first at {brief.units.place(*place)}"]
        rows.append(
            [
                printable(labelled(key, name)),
                printable((other.owner if other is not None else None) or "not known"),
                "\n".join(_period(brief, *period) for period in one.periods),
                "\n".join(filter(None, facts)),
                _acknowledged(brief, one),
            ]
        )
    text = "The worst first. Times are rounded outward to the second."
    if len(brief.conflicts) > _MOST_CONFLICTS:
        text += f" The first {_MOST_CONFLICTS} of {len(brief.conflicts):,}."
    yield Section("Conflicts", text, ["With", "Call", "When", "How close, where", "Acknowledged"], rows)


def _acknowledged(brief: Brief, one: Conflict) -> str:
    if one.acknowledged_by is None:
        return "no"
    until = (
        "" if one.acknowledged_until is None else f"\nuntil {_line(_moment(brief, one.acknowledged_until, up=False))}"
    )
    return f"by {printable(one.acknowledged_by)}: {printable(one.acknowledged_for or '')}{until}"


def _remedies(brief: Brief) -> Iterator[Section]:
    """Yield the proposal, and the least delays that clear the plan alone."""
    rows = [*_proposal(brief), *_alone(brief)]
    if rows:
        yield Section("What clears it", rows=rows)


def _proposal(brief: Brief) -> Iterator[list[str]]:
    one, departs_us = brief.proposed, _departs_us(brief.plan)
    if one is None:
        return
    text = f"Proposal {one.proposal_id}, {one.state}: {printable(one.text)}"
    if one.state == "open" and one.changes:
        text += f". OUT OF DATE, the scene has changed: {printable(', '.join(one.changes[:3]))}"
    elif one.delay_s and departs_us is not None:
        then_us = departs_us + (round(1e6 * one.delay_s) if one.state == "open" else 0)
        text += f". Then it begins at {_line(_instant(brief, then_us))}"
    yield ["With the others", text]


def _alone(brief: Brief) -> Iterator[list[str]]:
    found = brief.delays
    if found is None or found.clear_by_s != 0.0:
        return
    ways = []
    clock = Clock(brief.zone)
    for later in (True, False):
        least_s = found.least_later_s if later else found.least_earlier_s
        if least_s is None:
            continue
        delay_us = rounded_delay_us(found, round(1e6 * least_s) * (1 if later else -1), clock, later=later)
        way = f"{duration_text(abs(delay_us) / 1e6)} {'later' if later else 'earlier'}"
        if found.departs_at is not None:
            begins = _line(_instant(brief, (found.departs_at - EPOCH) // MICROSECOND + delay_us))
            way = f"{begins} ({way})"
        ways.append(way)
    if ways:
        text = f"It begins at {' or at '.join(ways)}" if found.departs_at else f"All its times are {' or '.join(ways)}"
    elif isinstance(brief.plan, Area) and brief.plan.schedule is None and spans_of(brief.plan) == ((None, None),):
        text = "It is always active: no other time clears it"
    else:
        text = f"No delay within {duration_text(max(found.latest_s, -found.earliest_s))} clears it alone"
    yield ["Alone", text]


def _departs_us(plan: Area | Track) -> int | None:
    if isinstance(plan, Track):
        return int(plan.times_us[0])
    return spans_of(plan)[0][0] if spans_of(plan) else None


def _instant(brief: Brief, at_us: int | None, *, up: bool = False) -> str:
    if at_us is None or at_us in (MINUS_INFINITY_US, INFINITY_US):
        return "no limit"
    return _moment(brief, EPOCH + at_us * MICROSECOND, up=up)


def _moment(brief: Brief, moment: datetime, *, up: bool) -> str:
    """Return a moment in the zone, and below it in UTC, if that is another time; to the second, rounded up or down."""
    moment = whole_second(moment, up=up)
    utc = f"{moment.astimezone(UTC).replace(tzinfo=None).isoformat(' ')} UTC"
    local = moment.astimezone(brief.zone)
    if local.utcoffset() == timedelta(0):
        return utc
    return f"{local.replace(tzinfo=None).isoformat(' ')} {local.tzname() or local.strftime('%z')}\n{utc}"


def _line(moment: str) -> str:
    """Return a moment in both zones in one line."""
    return moment.replace("\n", " = ")


def _period(brief: Brief, start: datetime | None, end: datetime | None) -> str:
    """Return a period in the zone and, if that is another time, in UTC on a line of its own."""
    if start is None:
        if end is None:
            return "always"
        return "\n".join(f"until {one}" for one in _moment(brief, end, up=True).split("\n"))
    if end is None:
        return "\n".join(f"from {one} on" for one in _moment(brief, start, up=False).split("\n"))
    begins, ends = _moment(brief, start, up=False).split("\n"), _moment(brief, end, up=True).split("\n")
    if len(begins) != len(ends):
        return f"{' = '.join(begins)} to {' = '.join(ends)}"
    return "\n".join(_span(first, last) for first, last in zip(begins, ends, strict=True))


def _span(first: str, last: str) -> str:
    """Return from when to when, the day and the zone once if they are the same."""
    day, _, rest = first.partition(" ")
    clock, _, zone = rest.partition(" ")
    last_day, _, last_rest = last.partition(" ")
    if day == last_day and zone and last_rest.endswith(f" {zone}"):
        return f"{day} {clock} to {last_rest}"
    return f"{first} to {last}"


def _more(some: Sequence[Any], most: int) -> str:
    return f" and {len(some) - most:,} more" if len(some) > most else ""
