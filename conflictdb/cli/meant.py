"""What was probably meant by a key that no object has, or by a command that does not exist."""

import argparse
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Final

from conflictdb.cli.output import program

if TYPE_CHECKING:
    from conflictdb.client.database import Database

# Words that people try first, and the command that does it.
COMMANDS: Final = {
    **dict.fromkeys(("late", "early", "shift", "retime", "what-if", "whatif", "try"), "probe --late KEY DURATION"),
    "delay": "probe --late KEY DURATION, or delays KEY",
    "move": "probe --move KEY DISTANCE BEARING",
    **dict.fromkeys(("swap", "exchange"), "probe --swap KEY KEY"),
    **dict.fromkeys(("brief", "print"), "report KEY FILE.pdf"),
    **dict.fromkeys(("slots", "slot", "windows", "departures", "when"), "delays KEY"),
    **dict.fromkeys(("undo", "revert"), "apply N --undo"),
    **dict.fromkeys(("import", "add", "put"), "load FILE"),
    **dict.fromkeys(("check", "run", "compare", "analyse", "analyze"), "detect FILE"),
    **dict.fromkeys(("remove", "rm", "drop"), "delete KEY"),
    **dict.fromkeys(("ack", "accept"), "acknowledge KEY KEY --reason TEXT"),
    **dict.fromkeys(("changes", "new", "since"), "conflicts --since 24h"),
    **dict.fromkeys(("list", "ls"), "scenes or objects"),
    **dict.fromkeys(("show", "view"), "conflicts or map"),
    **dict.fromkeys(("diff", "merge"), "branch diff BRANCH or branch merge BRANCH"),
    **dict.fromkeys(("calendar", "ics", "ical"), "conflicts --format ics"),
    **dict.fromkeys(("gpx", "csv", "json", "geojson"), "conflicts --format …"),
    **dict.fromkeys(("why", "reason"), "explain KEY KEY"),
    **dict.fromkeys(("clear", "solve", "fix", "deconflict"), "resolve"),
    **dict.fromkeys(("draw", "picture", "figure"), "plot FILE"),
    **dict.fromkeys(("log", "events"), "history"),
    "help": "--help, or COMMAND --help",
    "version": "--version",
}
# Options that people try first, and those that do it; a command may have one of these.
OPTIONS: Final = {
    **dict.fromkeys(("--delay", "--delays", "--shift", "--later", "--by"), ("--late", "--within")),
    **dict.fromkeys(("--exchange",), ("--swap",)),
    **dict.fromkeys(("--timezone", "--zone", "--utc"), ("--tz", "--time-zone")),
    **dict.fromkeys(("--out", "--output", "-o"), ("FILE",)),
    **dict.fromkeys(("--key", "--keys", "--track", "--area", "--object"), ("KEY", "--key")),
    **dict.fromkeys(("--file", "--files"), ("FILE",)),
}


def of_unknown_keys(db: "Database", args: argparse.Namespace) -> str:
    """Return a hint on the first key of a command that no object of its scene has; empty if all are known."""
    scene = getattr(args, "scene", None)
    given = [getattr(args, "key", None), *(getattr(args, "keys", None) or ()), *(getattr(args, "conflict", None) or ())]
    given += [key for option in ("late", "move") for key, *_ in getattr(args, option, None) or ()]
    given += [key for pair in getattr(args, "swap", None) or () for key in pair]
    given += getattr(args, "movable", None) or ()
    if scene is None or not any(given):
        return ""
    known = {one.key: one.name for one in db.scene(scene).objects()}
    unknown = [key for key in given if key is not None and key not in known]
    if not unknown:
        return ""
    key = unknown[0]
    if Path(key).is_file():
        return f"{key} is a file: `{program()} detect FILE` loads it and detects"
    if key in {one.scene.name for one in db.scenes()}:
        return f"{key!r} is a scene: --scene names it"
    names = {key.casefold(): key for key in known} | {name.casefold(): key for key, name in known.items() if name}
    alike = get_close_matches(key.casefold(), names, 1)
    return f"did you mean {names[alike[0]]!r}?" if alike else f"`{program()} objects --scene {scene!r}` lists all keys"
