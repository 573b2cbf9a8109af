"""Format results for a notebook as HTML tables, with all keys escaped."""

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from html import escape
from typing import TYPE_CHECKING, Final

from conflictdb.errors import printable

if TYPE_CHECKING:
    from conflictdb.model.results import Approach, Conflict, PairRecord, SceneState

# More rows make a long page that is slow to show.
_MOST_ROWS: Final = 50
_SECOND: Final = timedelta(seconds=1)
_UNITS: Final = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def conflicts_html(conflicts: "Sequence[Conflict]") -> str:
    """Return conflicts as a table, times in UTC, rounded outward to the second; only the first of many.

    Least distances are left out where all pairs touch.
    """
    shown = conflicts[:_MOST_ROWS]
    has_distances = any(one.closest_m for one in shown)
    header = ["A", "B", "verdict", "first contact (UTC)", "last contact (UTC)", "periods", "known to"]
    rows = (
        [
            *one.labels,
            one.verdict,
            instant_text(one.first_contact),
            instant_text(one.last_contact, up=True),
            str(len(one.periods)),
            bound_text(one.time_error_s),
            *([distance_text(one)] if has_distances else []),
        ]
        for one in shown
    )
    return _table([*header, *(["closest, m"] if has_distances else [])], rows, len(conflicts), "no conflicts")


def approaches_html(approaches: "Sequence[Approach]") -> str:
    """Return closest approaches as a table, times in UTC; only the first of many."""
    header = ["A", "B", "verdict", "closest (UTC)", "metres"]
    rows = (
        [
            *one.labels,
            one.verdict,
            instant_text(one.closest_at),
            distance_text(one),
        ]
        for one in approaches[:_MOST_ROWS]
    )
    return _table(header, rows, len(approaches), "no closest approaches")


def facts_html(rows: Iterable[tuple[str, str]]) -> str:
    """Return names and values as a table of two columns."""
    body = "".join(f"<tr><th>{text_of(name)}</th><td>{text_of(value)}</td></tr>" for name, value in rows)
    return f"<table><tbody>{body}</tbody></table>"


def rows_html(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows of text as a table; only the first of many."""
    return _table(header, rows[:_MOST_ROWS], len(rows), "")


def state_html(state: "SceneState") -> str:
    """Return whether the conflicts of a scene are complete."""
    rows = [
        ("scene", state.scene),
        ("complete", "yes" if state.is_current else "no"),
        ("objects", f"{state.objects:,}"),
        ("pending", f"{state.pending:,}"),
        ("last run (UTC)", "none" if state.last_run_at is None else instant_text(state.last_run_at, up=True)),
    ]
    return remark_html(state.remark) + facts_html(rows)


def remark_html(remark: str | None) -> str:
    """Return the remark on a list as HTML, empty if there is none."""
    return f"<p><strong>{text_of(remark)}</strong></p>" if remark else ""


def text_html(text: str) -> str:
    """Return preformatted text of several lines."""
    return f"<pre>{escape(printable(text, keep=chr(10)))}</pre>"


def text_of(text: str) -> str:
    """Escape untrusted text for HTML."""
    return escape(printable(text))


def whole_second(moment: datetime, *, up: bool) -> datetime:
    """Return a moment rounded to the second, up or down; the last second of the calendar is rounded down."""
    if up and moment.microsecond and datetime.max.replace(tzinfo=UTC) - moment > _SECOND:
        moment += _SECOND
    return moment.replace(microsecond=0)


def instant_text(instant: datetime | None, *, up: bool = False) -> str:
    """Return an instant in UTC, rounded to the second, up or down; two dots for an unbounded end."""
    if instant is None:
        return ".."
    return whole_second(instant, up=up).astimezone(UTC).replace(tzinfo=None).isoformat(" ")


def distance_text(pair: "PairRecord") -> str:
    """Return the least distance in metres and its error bound, or nothing where that is not known."""
    if pair.closest_m is None or pair.closest_error_m is None:
        return ""
    return f"{pair.closest_m:.3f} ± {pair.closest_error_m:.1g}"


def bound_text(seconds: float) -> str:
    """Return a bound on the error of times, rounded up to a digit; times have microseconds."""
    if not seconds < float("inf"):
        return "no bound"
    unit, name = next((row for row in _UNITS if seconds >= row[0]), _UNITS[-1])
    return f"{max(1, -int(-seconds // unit))} {name}"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], of: int, none: str) -> str:
    if not of:
        return f"<p>{none}</p>"
    head = "".join(f"<th>{text_of(cell)}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{text_of(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    more = f"<p>the first {_MOST_ROWS} of {of:,}</p>" if of > _MOST_ROWS else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"
