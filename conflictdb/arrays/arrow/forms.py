"""Define Arrow forms: a schema with an edition, and one error for tables that do not fit it."""

import json
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import pyarrow as pa

from conflictdb.errors import InvalidInput

# Key of the schema metadata that name the form: JSON with `form` and `edition`.
METADATA_KEY: Final = b"conflictdb"

INSTANT: Final = pa.timestamp("us", "UTC")

Batch: TypeAlias = pa.RecordBatch | pa.Table
Array: TypeAlias = pa.Array


@dataclass(frozen=True)
class ArrowForm:
    """A named schema with an edition.

    schema : a nullable column may also be missing; then it is null throughout
    """

    name: str
    edition: int
    schema: "pa.Schema"

    @classmethod
    def of(cls, name: str, edition: int, fields: "list[pa.Field]") -> "ArrowForm":
        """Return a form whose schema metadata name it."""
        said = json.dumps({"form": name, "edition": edition}).encode()
        return cls(name, edition, pa.schema(fields, metadata={METADATA_KEY: said}))

    def batch(self, columns: "dict[str, Array]") -> "pa.RecordBatch":
        """Return columns as one batch of this form."""
        return pa.RecordBatch.from_arrays([columns[name] for name in self.schema.names], schema=self.schema)

    def columns(self, given: Batch, first_row: int = 0) -> "dict[str, Array]":
        """Return the columns of this form in a batch or table, unchunked and of the form's types; others are dropped.

        Raises InvalidInput for another form, a later edition, and for columns that are missing, of another type or null
        where they must not be. Metadata may be missing: engines drop them.

        first_row : number of its first row, for messages
        """
        self._check_edition(metadata_of(f"Arrow form {self.name!r}", given.schema))
        return {field.name: self._column(given, field, first_row) for field in self.schema}

    def _check_edition(self, said: dict[str, Any]) -> None:
        form, edition = said.get("form", self.name), said.get("edition", self.edition)
        if form != self.name:
            raise InvalidInput(f"Arrow form {self.name!r}", "metadata", f"says that this is {form!r:.60}")
        if not isinstance(edition, int) or edition > self.edition:
            rule = f"is of edition {edition!r:.20}; this version of conflictdb reads up to {self.edition}: upgrade it"
            raise InvalidInput(f"Arrow form {self.name!r}", "metadata", rule)

    def _column(self, given: Batch, field: "pa.Field", first_row: int) -> Array:
        who = f"Arrow form {self.name!r}"
        places = given.schema.get_all_field_indices(field.name)
        if len(places) > 1:
            raise InvalidInput(who, field.name, "is there more than once")
        if not places:
            if field.nullable:
                return pa.nulls(given.num_rows, field.type)
            known = ", ".join(str(name) for name in given.schema.names[:20])
            raise InvalidInput(who, field.name, f"is missing: it must be {field.type}; there are {known or 'none'}")
        column = given.column(places[0])
        if isinstance(column, pa.ChunkedArray):
            column = column.combine_chunks()
            if isinstance(column, pa.ChunkedArray):  # some versions return no chunks or one
                column = column.chunk(0) if column.num_chunks else pa.array([], column.type)
        column = converted(who, field.name, column, field.type)
        if not field.nullable and column.null_count:
            row = first_row + column.is_null().index(True).as_py()
            raise InvalidInput(who, field.name, f"must not be null; it is in row {row}, and {column.null_count} in all")
        return column


def metadata_of(who: str, schema: "pa.Schema") -> dict[str, Any]:
    """Return the form's metadata of a schema, empty if there are none; their values are not checked.

    Raises InvalidInput, naming `who`, if they are not a JSON object.
    """
    try:
        said = json.loads((schema.metadata or {}).get(METADATA_KEY, b"{}"))
    except (ValueError, RecursionError):
        said = None
    if not isinstance(said, dict):
        raise InvalidInput(who, "metadata conflictdb", "must be a JSON object")
    return said


def converted(who: str, name: str, column: Array, expected: "pa.DataType") -> Array:
    """Return a column as another type with the same values; raises InvalidInput if that is impossible."""
    if column.type == expected:
        return column
    if not _alike(column.type, expected):
        got = f"must be {expected}; got {column.type}"
        if pa.types.is_timestamp(_innermost(column.type)) and pa.types.is_timestamp(_innermost(expected)):
            got += ": instants need a time zone, and are kept in UTC"
        raise InvalidInput(who, name, got)
    try:
        return column.cast(expected)
    except pa.ArrowException as error:
        raise InvalidInput(who, name, f"must be {expected}; got {column.type}: {error}") from error


def _alike(one: Any, other: Any) -> bool:
    """Return whether values can be converted between two types, as between all kinds of lists, texts or integers."""
    types = pa.types
    if types.is_dictionary(one):
        return _alike(one.value_type, other)
    if _is_list(one) and _is_list(other):
        return _alike(one.value_type, other.value_type)
    if types.is_timestamp(one) and types.is_timestamp(other):
        return one.tz is not None
    if types.is_floating(one) and types.is_integer(other):  # pandas has integers with missing values as floats
        return True
    return types.is_null(one) or any(
        any(is_kind(one) for is_kind in kind) and any(is_kind(other) for is_kind in kind) for kind in _KINDS
    )


def _innermost(of: Any) -> Any:
    return _innermost(of.value_type) if _is_list(of) else of


def _is_list(one: Any) -> bool:
    return bool(pa.types.is_list(one) or pa.types.is_large_list(one) or pa.types.is_fixed_size_list(one))


_KINDS: Final = (
    (pa.types.is_integer,),
    (pa.types.is_floating,),
    (pa.types.is_boolean,),
    (pa.types.is_string, pa.types.is_large_string),
    (pa.types.is_binary, pa.types.is_large_binary),
)
