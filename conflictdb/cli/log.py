"""Log a worker: one line for each detection, failure and remark, as text or JSON."""

import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from conflictdb.cli.load_report import run_text
from conflictdb.cli.output import data, out, remark
from conflictdb.formats.instants import format_moment
from conflictdb.formats.json_text import dumped

if TYPE_CHECKING:
    from conflictdb.db.detect import Run


@dataclass(frozen=True, slots=True)
class Log:
    """The log of a worker: as text, with failures and remarks on stderr; as JSON, all on stdout.

    report : called after each detection with the scene, the run or the error, and the waiting time of its changes,
        seconds
    say : called with any other remark
    """

    report: "Callable[[str, Run | Exception, float], None]"
    say: Callable[[str], None]


def _text_report(scene: str, outcome: "Run | Exception", waited_s: float) -> None:
    if isinstance(outcome, Exception):
        remark(f"{scene}: failed: {outcome}")
    else:
        out(run_text(scene, outcome), flush=True)


def _json_report(scene: str, outcome: "Run | Exception", waited_s: float) -> None:
    if isinstance(outcome, Exception):
        _json("failed", scene=scene, waited_s=waited_s, error=str(outcome))
    else:
        _json("run", scene=scene, waited_s=waited_s, **asdict(outcome))


def _json_say(text: str) -> None:
    _json("remark", text=text)


def _json(event: str, **members: object) -> None:
    line = dumped({"at": format_moment(datetime.now(UTC)), "event": event, **members})
    data([line, "\n"], is_json=True)
    sys.stdout.flush()


TEXT_LOG: Final = Log(_text_report, remark)
JSON_LOG: Final = Log(_json_report, _json_say)
