"""Read what a brief of one plan, or a calendar of it, says."""

from datetime import datetime, tzinfo
from typing import TYPE_CHECKING, Final

from conflictdb import store
from conflictdb.core.world import World
from conflictdb.errors import InvalidInput
from conflictdb.model.brief import Brief, Proposed
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.recurring_plans import spans_of
from conflictdb.model.results import Delays
from conflictdb.model.units import Units

if TYPE_CHECKING:
    from conflictdb.client.stored_scene import StoredScene

# How much later or earlier a plan may begin, at most: of a day's work.
_WITHIN_S: Final = 43_200.0


def activations_of(plan: Area | Track, settings: Scene) -> list[tuple[datetime | None, datetime | None]]:
    """Return when an area is active, its schedule as far as its own dates, else as far as the horizon from today.

    None: unbounded. A track has none.
    """
    from conflictdb.model.schedules import schedule_of
    from conflictdb.model.schedules.words import known_spans

    if isinstance(plan, Track):
        return []
    spans = spans_of(plan)
    if plan.schedule is not None:
        try:
            known = known_spans(schedule_of(f"area {plan.key!r}", plan.schedule), plan.start_us, plan.end_us)
            if known is None:
                spans = spans_of(World.of(settings, [plan], []).expanded([plan], [])[0][0])
            else:
                spans = tuple((start, end) for start, end in known.tolist())
        except InvalidInput:  # a schedule that is not understood
            return []
    return [(_moment(start), _moment(end)) for start, end in spans]


def _moment(at_us: int | None) -> datetime | None:
    return None if at_us is None else EPOCH + at_us * MICROSECOND


def brief_of(scene: "StoredScene", key: str, zone: tzinfo, units: Units) -> "Brief":
    """Return the brief of a plan as it is stored; raises InvalidInput if it is not known."""
    with store.transaction(scene.connection):
        plan = scene.plan(key)
        found = store.conflicts(scene.connection, scene.name, store.Selection(key=key))
        keys = {one.b_key if one.a_key == key else one.a_key for one in found}
        settings, areas, tracks = store.read_scene(scene.connection, scene.name, sorted(keys))
        proposed = store.proposed(scene.connection, scene.name, key)
    others: dict[str, Area | Track] = {area.key: area for area in areas}
    others |= {track.key: track for track in tracks}
    active = activations_of(plan, settings)
    move = None if proposed is None else Proposed(*proposed)
    return Brief(settings, plan, active, others, list(found), found.state, _delays(scene, key), move, zone, units)


def _delays(scene: "StoredScene", key: str) -> Delays | None:
    """Return when a plan could begin instead; None for one that begins several times."""
    try:
        return scene.delays(key, _WITHIN_S)[0]
    except InvalidInput:
        return None
