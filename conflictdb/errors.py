"""All errors that this package raises on purpose.

ConflictDBError
|__ InvalidInput(ValueError)
|__ SchemaError
|   |__ SchemaMissing
|   |__ SchemaOutdated
|   |__ SchemaTooNew
|__ ServerError
|__ KernelMissing
|__ EngineMissing
|__ StoreError
    |__ NotPermitted
    |__ ReadOnlyDatabase
    |__ LockTimeout
    |__ NotCurrent

IncompleteWarning accompanies an answer that may lack conflicts, because changes wait for detection. A pair that the
solver could not decide is not an error: its verdict is `unresolved`.
"""

import re
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Final

# A message lists at most this many mistakes, a screen full, and counts the rest.
MOST_TOLD: Final = 20
# A reason of more objects is printed once, with this number of names.
_FEW: Final = 3
_MOST_NAMED: Final = 5
# Values in a message: quoted texts, and numbers.
_VALUES: Final = re.compile(r"'[^']{0,200}'|\d[\d.,]*")
# The kind of an object before its name, as in "track 'T'".
_KIND: Final = re.compile(r"^\w+ (?=')")
# Longest part of a message, in characters: longer than any real key or path, and still readable.
_LONGEST_PART: Final = 4_000


def printable(text: str, keep: str = "") -> str:
    r"""Return a text with every character that does not print as Python writes it, such as ``\x1b``.

    Keys and names may contain any Unicode: escape sequences that recolour, move the cursor or retitle a window, line
    breaks that forge a line, marks that reverse the direction of reading.

    keep : characters to leave as they are: a line break, where lines are meant
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else repr(c)[1:-1] for c in text)


def said_once(said: Sequence[tuple[str, str, str]], lead: str = "", most: int = MOST_TOLD) -> list[str]:
    """Return lines of some reasons, at most `most` and one that counts the rest.

    A reason of more than _FEW objects is said once, with their number and some of their names; so are reasons that
    differ in numbers and quoted texts only.

    said : the source of each reason, its object, and its text
    lead : text before the object
    """
    alike: dict[tuple[str, ...], list[int]] = {}
    for i, one in enumerate(said):
        alike.setdefault(tuple(_VALUES.sub("#", part) for part in one), []).append(i)
    groups = [group for one in alike.values() for group in ([one] if len(one) > _FEW else [[i] for i in one])]
    groups.sort()
    lines = []
    for group in groups[:most]:
        source, key, text = said[group[0]]
        line = ": ".join(_shown(part) for part in (source, f"{lead}{key}", text) if part)
        if len(group) > 1:
            names = [said[i][1] for i in group[1 : _MOST_NAMED + 1]]
            named = ", ".join(_shown(_KIND.sub("", name)) for name in names)
            more = ", …" if len(group) - 1 > len(names) else ""
            line += f" (and {len(group) - 1:,} more: {named}{more})"
        lines.append(line)
    if len(groups) > most:
        lines.append(f"and {sum(map(len, groups[most:])):,} more")
    return lines


class ConflictDBError(Exception):
    """Base of all errors of this package."""


class InvalidInput(ConflictDBError, ValueError):
    """An object or a setting is refused.

    Parameters
    ----------
    key : str
        The refused object, as the user knows it: ``track 'T1'``, ``scene 'exercise-7'``, ``feature 3``.
    field : str
        Its field, as in the file: ``times[2]``, ``geometry``.
    rule : str
        The broken rule and, if helpful, the value and the remedy.
    source : str
        File (or table) of the object, empty if none.
    also : sequence of InvalidInput
        Further mistakes of the same input. The message has one line for each, up to MOST_TOLD.
    """

    def __init__(self, key: str, field: str, rule: str, source: str = "", also: "Sequence[InvalidInput]" = ()) -> None:
        self.key = key
        self.field = field
        self.rule = rule
        self.source = source
        self.also = tuple(also)
        super().__init__(key, field, rule, source)

    def __str__(self) -> str:
        """Return the message, made when it is read."""
        said = ((one.source, one.key, ": ".join(filter(None, (one.field, one.rule)))) for one in self)
        return "\n".join(said_once(list(said)))

    def __iter__(self) -> "Iterator[InvalidInput]":
        """Yield each mistake as an error of its own."""
        yield InvalidInput(self.key, self.field, self.rule, self.source)
        yield from self.also

    def at(self, source: str) -> "InvalidInput":
        """Return the same error with its file."""
        return InvalidInput(self.key, self.field, self.rule, source, [other.at(source) for other in self.also])


class Refusals:
    """Collect refusals, to report all mistakes at once: errors raised ``with`` it are kept."""

    def __init__(self) -> None:
        self.found: list[InvalidInput] = []

    def __enter__(self) -> None:
        """Begin a step that may refuse something."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if isinstance(error, InvalidInput):
            self.found.extend(error)
            return True
        return False

    def raise_found(self) -> None:
        """Raise the collected errors as one, if there are any."""
        if self.found:
            first = self.found[0]
            raise InvalidInput(first.key, first.field, first.rule, first.source, self.found[1:])


class SchemaError(ConflictDBError):
    """The database has no usable conflictdb schema."""


class SchemaMissing(SchemaError):
    """The database has no conflictdb schema: run `conflictdb admin init`."""


class SchemaOutdated(SchemaError):
    """The schema is older than this program: run `conflictdb admin upgrade`."""


class SchemaTooNew(SchemaError):
    """The schema is newer than this program: install a newer conflictdb."""


class ServerError(ConflictDBError):
    """No PostgreSQL with PostGIS was found, or it does not start."""


class KernelMissing(ConflictDBError):
    """The compiled kernel is missing or of other sources."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what}: ./run builds it, or `python -m conflictdb.kernel.build`")


class EngineMissing(ConflictDBError):
    """Spark does not run here: Java, the extra `spark` or the jars of Sedona are missing."""


class StoreError(ConflictDBError):
    """Any other database error; the psycopg error is the cause."""


class NotPermitted(StoreError):
    """The user lacks a right; the message names the GRANT to run, if it is known.

    Parameters
    ----------
    routine : str, optional
        The called routine of schema conflictdb, from which the grant may follow; None if unknown.
    """

    def __init__(self, message: str, routine: str | None = None) -> None:
        super().__init__(message)
        self.routine = routine


class ReadOnlyDatabase(StoreError):
    """The database takes no changes: it is a hot standby, or its transactions are read-only by default."""


class LockTimeout(StoreError):
    """Another session kept a lock for longer than the timeout; the message names it, if visible."""


class NotCurrent(StoreError):
    """Changes of a scene still wait for detection after the timeout, or where none may wait."""


class IncompleteWarning(UserWarning):
    """An answer may lack conflicts: changes of its scene wait for detection."""


class UnknownScheduleWarning(IncompleteWarning):
    """The schedule of a stored object is not understood: its pairs are unresolved."""


def _shown(text: str) -> str:
    shown = printable(text[:_LONGEST_PART])
    return shown if len(text) <= _LONGEST_PART else f"{shown}…"
