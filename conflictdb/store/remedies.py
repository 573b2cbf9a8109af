"""What to do about an error or notice of the database, for callers who do not write SQL."""

from typing import Final

from psycopg.errors import Diagnostic

# The hints of sql/ name routines, views and functions of SQL. These replace them, by constraint.
REMEDIES: Final = {
    "attached_once": "`conflictdb admin reattach --scene NAME --table TABLE` changes it; --again attaches it twice.",
    "attached_there": "`conflictdb admin reattach --scene NAME --table TABLE --to ANOTHER` takes another one.",
    "attachment_fixed": "`conflictdb admin reattach --scene NAME --table TABLE` changes it.",
    "attached_watchable": "Give --every (every in Python), the interval at which to compare all rows instead.",
    "branch_current": "`conflictdb detect --scene BRANCH` does it.",
    "conflict_known": "`conflictdb conflicts` lists those that are.",
    "footprint_valid": "shapely.make_valid and most GIS programs repair it.",
    "outline_convex": "Split it into several tracks, or give its convex hull.",
    "outline_corners": "Simplify it.",
    "path_of_two": "Give two or more waypoints, and a time for each.",
    "proposal_applied_once": "`conflictdb resolve` computes another one.",
    "proposal_known": "`conflictdb resolve` computes one.",
    "radius_known": "Draw a polygon instead.",
    "scene_changeable": "Its owner may run `conflictdb admin share ROLE --scene NAME --access write`.",
    "scene_branch": "`conflictdb branch create BRANCH --scene NAME` makes one.",
    "scene_known": "`conflictdb load FILE --scene NAME` creates one.",
    "scene_whole": "`conflictdb copy NEW --scene BRANCH` makes one; or merge it: `conflictdb branch merge BRANCH`.",
    "scene_without_attachments": "`conflictdb admin detach --scene NAME --table TABLE` detaches each.",
    "scenes_owned": "`conflictdb admin share ROLE --scene NAME --access own` gives one to a role.",
    "scenes_protected": "The owner of schema conflictdb may run `conflictdb admin protect`.",
}


def remedy(diagnostic: Diagnostic) -> str | None:
    """Return what to do, None if nothing is known."""
    return REMEDIES.get(diagnostic.constraint_name or "", diagnostic.message_hint)


def with_remedy(diagnostic: Diagnostic, message: str | None = None) -> str:
    """Return a message (by default that of the server), its detail and what to do in one line, without its CONTEXT."""
    text = message if message is not None else diagnostic.message_primary or ""
    more = "; ".join(filter(None, (diagnostic.message_detail, remedy(diagnostic))))
    return f"{text} ({more})" if more else text
