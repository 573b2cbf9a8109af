"""`detect`, `conflicts`, `approaches` and `explain`."""

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Final

from conflictdb.cli.codes import CONFLICTS_FOUND, DONE, LEFT_OUT
from conflictdb.cli.history import events_table
from conflictdb.cli.load_report import (
    Shown,
    approach_table,
    json_row,
    listed,
    loaded_text,
    print_approaches,
    print_conflicts,
    remark_incomplete,
    remark_loaded,
    require_current,
    run_text,
)
from conflictdb.cli.meter import shown_phases
from conflictdb.cli.output import data, note, out, print_json, remark
from conflictdb.cli.parser import check, resolve_times
from conflictdb.cli.session import database, load_files, wait
from conflictdb.cli.tables import show_table, table, wrapped
from conflictdb.cli.values import chosen_units, chosen_zone
from conflictdb.errors import InvalidInput
from conflictdb.model.settings import STORED_BY_DETECT, Regions, given

if TYPE_CHECKING:
    from conflictdb.client.stored_scene import StoredScene
    from conflictdb.formats.conflict_ics import Activation
    from conflictdb.store import LiveConflict, LiveTrack

# Acknowledgements that a remark names.
_MOST_NAMED: Final = 10
# Options that need files.
_FOR_FILES: Final = (
    *("replace", "max_speed_kn", "layer", "skip_invalid", "max_file_mb", "haven", "time_zone", "map"),
    *("departure", "speed_kn", "unbounded_heights", "max_gap"),
)


def detect(args: argparse.Namespace) -> int:
    """Load files, detect, and print the conflicts."""
    given_for_files = [one for one in _FOR_FILES if getattr(args, one) not in (None, False)]
    check(args, [(not args.files, f"--{one.replace('_', '-')} is for files") for one in given_for_files])
    args.needs_scene = not args.files
    with database(args) as db:
        scenes = [args.scene]
        is_complete = True
        if args.files:
            loaded = load_files(db, args)
            remark_loaded(loaded)
            for one in loaded:
                remark(loaded_text(one))
            scenes = [one.scene for one in loaded]
            is_complete = not any(one.invalid for one in loaded)
        runs = []
        for scene in scenes:
            state = db.scene(scene).state()
            sizes = {"preparing objects": state.objects if args.full else state.pending}
            with shown_phases(sizes) as phase:
                run = db.scene(scene).detect(
                    full=args.full,
                    jobs=args.jobs,
                    memory_mb=args.memory_mb,
                    phase=phase,
                    lock_timeout_s=args.lock_timeout,
                    say=remark,
                    **given(args, STORED_BY_DETECT),
                )
            note(run_text(scene, run))
            if run.closed:
                _remark_ended(db.scene(scene), run.run_id)
            runs.append(run)
        found = [one.stream_conflicts(with_region=_wants_region(args, one)) for one in map(db.scene, scenes)]
        near = [db.scene(scene).stream_approaches(only_near=True) for scene in scenes]
        states = [one.state for one in found]
        if args.format == "table":
            depths = db.scene(scenes[0]).depths if len(scenes) == 1 else (lambda _: {})
            print_conflicts(chain.from_iterable(found), states, args.format, known_depths=depths)
            if rows := list(chain.from_iterable(near)):
                out("\nno conflict, but near:")
                show_table(approach_table(rows))
        else:
            near_rows = (approach.as_near() for approach in chain.from_iterable(near))
            print_conflicts(chain(chain.from_iterable(found), near_rows), states, args.format)
    if args.fail_on_conflict and any(run.conflicts for run in runs):
        return CONFLICTS_FOUND
    return DONE if is_complete else LEFT_OUT


def _remark_ended(scene: "StoredScene", run_id: int) -> None:
    """Name the acknowledgements that ended with the conflicts that a detection closed."""
    ended = scene.acknowledgements_ended(run_id)
    for one in ended[:_MOST_NAMED]:
        pair = f"{one.a_key} and {one.b_key}"
        remark(f"{scene.name}: the acknowledgement of {pair} by {one.acknowledged_by} has ended with the conflict")
    if len(ended) > _MOST_NAMED:
        remark(f"{scene.name}: {len(ended) - _MOST_NAMED:,} more acknowledgements have ended with their conflicts")


def conflicts(args: argparse.Namespace) -> int:
    """Print the known conflicts, all or selected ones, or those known at an instant."""
    resolve_times(args, "at", "start", "end", "since", "known_at")
    shown = Shown(args.tz or chosen_zone(), args.show)
    which = {"key": args.key, "from_": args.start, "to": args.end, "since": args.since, "verdict": args.verdict}
    which["object_class"] = args.object_class
    if args.acknowledged is not None:
        which["acknowledged"] = args.acknowledged == "yes"
    if args.known_at is not None:
        selected = args.at is not None or any(one is not None for one in which.values())
        others = selected or args.wait is not None or args.require_current
        check(args, [(others, "--known-at goes without other selections, --wait and --require-current")])
        with database(args) as db:
            print_conflicts(db.scene(args.scene).conflicts_known_at(args.known_at), [], args.format, shown=shown)
        return DONE
    if args.live:
        selected = args.at is not None or any(one is not None for one in which.values())
        others = selected or args.wait is not None or args.require_current or args.format not in ("table", "json")
        check(args, [(others, "--live goes with --format table or json, --scene and --tz alone")])
        with database(args) as db:
            scene = db.scene(args.scene)
            state = scene.state()
            # Alarms of late tracks come from the differences that the last detection stored.
            remark_incomplete([state])
            _print_live(scene.live(), scene.live_conflicts(), args)
        return listed(state)
    with database(args) as db:
        wait(db, args)
        scene = db.scene(args.scene)
        found = scene.stream_conflicts(args.at, with_region=_wants_region(args, scene), **which)
        require_current(args, found.state)
        depths = db.scene(args.scene).depths
        active = _activations(db.scene(args.scene), args)
        states = [found.state]
        print_conflicts(found, states, args.format, shown=shown, known_depths=depths, activations=active)
        if args.since is not None:
            _print_gone(db.scene(args.scene), args)
    return listed(found.state)


def _activations(scene: "StoredScene", args: argparse.Namespace) -> "list[Activation]":
    """Return when the area whose conflicts are asked about is active, for a calendar."""
    if args.format != "ics" or args.key is None:
        return []
    from conflictdb.formats.conflict_ics import Activation

    name = scene.names(args.key).get(args.key)
    found = [
        Activation(scene.name, args.key, name, start, end)
        for start, end in scene.activations(args.key)
        if (args.end is None or start < args.end) and (args.start is None or end > args.start)
    ]
    if found:
        remark(f"with the {len(found):,} times at which {args.key} is active")
    return found


def _print_live(found: "Sequence[LiveTrack]", alarms: "Sequence[LiveConflict]", args: argparse.Namespace) -> None:
    """Print the conflicts that follow, and how tracks keep their plans."""
    if args.format == "json":
        print_json({"conflicts": [json_row(one) for one in alarms], "tracks": [json_row(one) for one in found]})
        return
    shown = Shown(args.tz or chosen_zone())
    states = {one.key: one for one in found}
    for alarm in alarms:
        out(_alarm_text(alarm, states, shown))
    if alarms:
        out()
    units = chosen_units()
    header = ["KEY", "STATE", "LATE", "OFF", "SLACK", shown.header("LAST POSITION")]
    lines = [
        [
            one.key,
            one.state,
            _lateness(one),
            None if one.off_m is None else units.least_distance(one.off_m),
            None if one.slack_s is None else f"{one.slack_s / 60.0:,.0f} min",
            shown.moment(one.instant, up=False),
        ]
        for one in found
    ]
    out(table(header, lines, right=header[2:5], whole=header[5:]) if found else "no positions")


def _alarm_text(alarm: "LiveConflict", states: "Mapping[str, LiveTrack]", shown: Shown) -> str:
    """Return an alarm as a sentence, such as: FERRY 12 to 13 min late: meets TOW at 09:58:20 (slack used up)."""
    first = _named(alarm.key, states)
    if alarm.other_key is None:
        return f"{first}: may meet anything near ({alarm.reason})"
    other = _named(alarm.other_key, states)
    verb, when = {"must": ("meets", "at"), "may": ("may meet", "at"), "now": ("is in conflict with", "since")}[
        alarm.verdict
    ]
    at = "" if alarm.first_contact is None else f" {when} {shown.moment(alarm.first_contact, up=False)}"
    return f"{first}: {verb} {other}{at} ({alarm.reason or 'slack used up'})"


def _named(key: str, states: "Mapping[str, LiveTrack]") -> str:
    """Return a key, and the state and lateness of its track unless it is on plan."""
    one = states.get(key)
    if one is None or one.state == "on plan":
        return key
    late = _lateness_words(one)
    if late is None:
        return f"{key} {one.state}"
    return f"{key} {late}" if one.state in ("late", "early") else f"{key} {one.state}, {late}"


def _lateness_words(one: "LiveTrack") -> str | None:
    """Return the latenesses of a track as the page does: `11 to 14 min late`, `2 min early to 5 min late`."""
    ends = _lateness_minutes(one)
    if ends is None:
        return None
    least, most = ends
    if least >= 0:
        return f"{_range(least, most)} late"
    return f"{_range(-most, -least)} early" if most <= 0 else f"{-least} min early to {most} min late"


def _range(least: int, most: int) -> str:
    return f"{least} min" if least == most else f"{least} to {most} min"


def _lateness(one: "LiveTrack") -> str | None:
    """Return the interval of latenesses of a track in minutes, negative: early."""
    ends = _lateness_minutes(one)
    if ends is None:
        return None
    least, most = ends
    return f"{least:+d} to {most:+d} min" if least != most else f"{least:+d} min"


def _lateness_minutes(one: "LiveTrack") -> tuple[int, int] | None:
    """Return the least and the greatest lateness of a track in minutes, rounded outward; None: not known."""
    if one.late_from_s is None or one.late_to_s is None:
        return None
    return math.floor(one.late_from_s / 60.0), math.ceil(one.late_to_s / 60.0)


def _print_gone(scene: "StoredScene", args: argparse.Namespace) -> None:
    """Print the conflicts that have closed since a time, of one object or all, and are not in conflict again."""
    try:
        found = scene.conflict_events(*([] if args.key is None else [args.key]), since=args.since)
    except InvalidInput:  # a branch has no history
        return
    last = {(one.a_key, one.b_key): one for one in found}
    gone = [one for one in last.values() if one.kind == "closed"]
    if not gone:
        return
    count = f"{len(gone):,} {'conflict has' if len(gone) == 1 else 'conflicts have'} ended since"
    if args.format != "table":
        remark(f"{count}: history --since lists them")
        return
    out(f"\n{count}:")
    names = scene.names(*(key for one in gone for key in (one.a_key, one.b_key)))
    out(events_table(gone, names, Shown(args.tz or chosen_zone())))


def approaches(args: argparse.Namespace) -> int:
    """Print the known closest approaches."""
    with database(args) as db:
        wait(db, args)
        found = db.scene(args.scene).stream_approaches()
        require_current(args, found.state)
        print_approaches(found, [found.state], args.format, Shown(args.tz or chosen_zone()))
    return listed(found.state)


def explain(args: argparse.Namespace) -> int:
    """Print why two objects are in conflict or not."""
    with database(args) as db:
        wait(db, args)
        require_current(args, db.scene(args.scene).state())
        found = db.scene(args.scene).explain(*args.keys)
    if args.format == "json":
        data([json.dumps(found.facts, indent=2), "\n"], is_json=True)
    else:
        out(wrapped(found.text))
    return DONE


def _wants_region(args: argparse.Namespace, scene: "StoredScene") -> bool:
    """Return whether to read regions; remark if the scene stores none."""
    is_wanted = args.format in ("json", "geojson", "geoparquet") and not args.no_region
    if is_wanted and not (settings := scene.settings()).has_regions:
        why = "setting regions is off" if settings.regions is Regions.OFF else f"method {settings.method}"
        remark(f"scene {scene.name!r} stores no regions ({why}): the place of a conflict is its first contact")
    return is_wanted
