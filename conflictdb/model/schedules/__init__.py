"""Schedules: when an area is active, or a track departs, again and again.

A reader of files calls one of four functions. Each returns a `Schedule`, or raises InvalidInput that names the object:

- `schedule_of(who, source)`: the JSON language of scene files, which also wraps the other three notations
- `rrule_schedule(who, text, duration)`: RFC 5545
- `item_d_schedule(who, text, valid_us)`: item D of a NOTAM, within its items B and C
- `ed318_schedule(who, periods, zone)`: `schedule` of ED-318 and ED-269

An area or track stores the source (JSON) and not the Schedule: `{"notam": text, "from": B, "until": C}`,
`{"ed318": periods}`, `{"rrule": text}`. `Schedule.expand(start_us, end_us, places)` returns the spans of an area,
`Schedule.departures(start_us, end_us, places)` the departures of a track.
"""

from conflictdb.model.schedules.ed318_schedule import ed318_schedule
from conflictdb.model.schedules.item_d import item_d_schedule
from conflictdb.model.schedules.language import schedule_of
from conflictdb.model.schedules.recurrences import rrule_schedule
from conflictdb.model.schedules.schedule import MOST_SPANS, Schedule

__all__ = ["MOST_SPANS", "Schedule", "ed318_schedule", "item_d_schedule", "rrule_schedule", "schedule_of"]
