"""Log a worker: one line for each detection, failure and remark, as text or JSON."""

import sys
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from conflictdb.cli.load_report import run_text
from conflictdb.cli.output import data, out, remark
from conflictdb.formats.instants import format_moment
from conflictdb.formats.json_text import dumped

if TYPE_CHECKING:
    from conflictdb.db.detect import Run


@dataclass(frozen=True, slots=True)
class Log:
    """The log of a worker: as text, with failures and remarks on stderr; as JSON, all on stdout."""

    is_json: bool

    def report(self, scene: str, outcome: "Run | Exception", waited_s: float) -> None:
        """Log a detection or its failure; `waited_s` is the waiting time of its changes."""
        if isinstance(outcome, Exception):
            if self.is_json:
                _print("failed", scene=scene, waited_s=waited_s, error=str(outcome))
            else:
                remark(f"{scene}: failed: {outcome}")
        elif self.is_json:
            _print("run", scene=scene, waited_s=waited_s, **asdict(outcome))
        else:
            out(run_text(scene, outcome), flush=True)

    def say(self, text: str) -> None:
        """Log a remark."""
        if self.is_json:
            _print("remark", text=text)
        else:
            remark(text)


def _print(event: str, **members: object) -> None:
    data([dumped({"at": format_moment(datetime.now(UTC)), "event": event, **members}), "\n"], is_json=True)
    sys.stdout.flush()
