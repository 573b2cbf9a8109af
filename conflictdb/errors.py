"""Every error this package raises on purpose.

ConflictDBError
|__ InvalidInput(ValueError)   an object or setting is refused; says which object, which field, which rule
|__ SchemaError                the database holds no usable conflictdb schema
|   |__ SchemaMissing          run `conflictdb init`
|   |__ SchemaOutdated         database older than this package: run `conflictdb upgrade`
|   |__ SchemaTooNew           database newer than this package: refuse to start
|__ ServerError                no PostgreSQL with PostGIS was found, or it does not start
|__ KernelMissing              the compiled kernel is not there, or not that of these sources: `./run` builds it
|__ EngineMissing              Spark does not run here: Java, its packages or jars are missing; says what to install
|__ StoreError                 any other database error; psycopg.Error in __cause__
    |__ NotPermitted           the user has no right to do this: names the GRANT to run, where that is known
    |__ ReadOnlyDatabase       it takes no changes: a hot standby, or transactions that are read-only by default
    |__ LockTimeout            somebody else kept a lock for longer than was to be waited
    |__ NotCurrent             a scene did not become current, or a probe was not answered, in the time to wait

IncompleteWarning is given with an answer that may lack something, because changes wait for detection.
What a solver could not decide is not an error: it is a verdict (`unresolved`) in the result.
"""

from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Final

from conflictdb.printable import printable

# Of many mistakes so many are told, a screen full; the rest is counted.
MOST_TOLD: Final = 20
# Characters of each part of a message: more than any honest key or path has, and little enough to read.
_LONGEST_PART: Final = 4_000


class ConflictDBError(Exception):
    """Base of all errors of this package."""


class InvalidInput(ConflictDBError, ValueError):
    """An object or a setting is refused.

    Parameters
    ----------
    key : str
        What is refused, as the user knows it: ``track 'T1'``, ``scene 'exercise-7'``, ``feature 3``.
    field : str
        Field of it, as in the file: ``times[2]``, ``geometry``.
    rule : str
        The rule that is broken and, where it helps, the value found and what to do.
    source : str
        File (or table) that it came from, empty if none.
    also : sequence of InvalidInput
        Further mistakes of the same input. The message has one line for each, up to MOST_TOLD.
    """

    def __init__(self, key: str, field: str, rule: str, source: str = "", also: "Sequence[InvalidInput]" = ()) -> None:
        self.key = key
        self.field = field
        self.rule = rule
        self.source = source
        self.also = tuple(also)
        lines = [": ".join(_shown(part) for part in (source, key, field, rule) if part)]
        lines += [str(other) for other in self.also[: MOST_TOLD - 1]]
        if len(self.also) >= MOST_TOLD:
            lines.append(f"and {len(self.also) - MOST_TOLD + 1:,} more")
        super().__init__("\n".join(lines))

    def __iter__(self) -> "Iterator[InvalidInput]":
        """Yield every mistake, each alone."""
        yield InvalidInput(self.key, self.field, self.rule, self.source)
        yield from self.also

    def at(self, source: str) -> "InvalidInput":
        """Return the same refusal, naming the file it came from."""
        return InvalidInput(self.key, self.field, self.rule, source, [other.at(source) for other in self.also])


class Refusals:
    """Collects refusals, so that all mistakes are told in one go: each is raised ``with`` it, and kept."""

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
        """Raise what was found, if anything was."""
        if self.found:
            first = self.found[0]
            raise InvalidInput(first.key, first.field, first.rule, first.source, self.found[1:])


class SchemaError(ConflictDBError):
    """The database holds no usable conflictdb schema."""


class SchemaMissing(SchemaError):
    """The database has no conflictdb schema: run `conflictdb init`."""


class SchemaOutdated(SchemaError):
    """The schema is older than this program: run `conflictdb upgrade`."""


class SchemaTooNew(SchemaError):
    """The schema is newer than this program: install a newer conflictdb."""


class ServerError(ConflictDBError):
    """No PostgreSQL with PostGIS was found, or it does not start."""


class KernelMissing(ConflictDBError):
    """The compiled kernel is not there, or not that of these sources."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what}: ./run builds it, or `python -m conflictdb.kernel.build`")


class EngineMissing(ConflictDBError):
    """Spark does not run here: Java, the extra `spark` or the jars of Sedona are missing."""


class StoreError(ConflictDBError):
    """Any other database error; the psycopg error is the cause."""


class NotPermitted(StoreError):
    """The database refuses something to a user who has no right to it; names the grant to run, where that is known.

    Parameters
    ----------
    routine : str, optional
        Of the schema conflictdb, that was called: by it the grant may be found. None if there is nothing to find.
    """

    def __init__(self, message: str, routine: str | None = None) -> None:
        super().__init__(message)
        self.routine = routine


class ReadOnlyDatabase(StoreError):
    """The database takes no changes: it is a hot standby, or its transactions are read-only by default."""


class LockTimeout(StoreError):
    """Somebody else, whom it names where that can be seen, kept a lock for longer than was to be waited."""


class NotCurrent(StoreError):
    """Changes of a scene wait for detection: at the end of the time to wait, or where none may wait."""


class IncompleteWarning(UserWarning):
    """An answer may lack conflicts: changes of its scene wait for detection."""


def _shown(text: str) -> str:
    shown = printable(text[:_LONGEST_PART])
    return shown if len(text) <= _LONGEST_PART else f"{shown}…"
