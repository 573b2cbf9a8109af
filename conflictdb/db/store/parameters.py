"""Arrays that a statement takes in PostgreSQL's binary form, as `copy_binary.array` makes them."""

from dataclasses import dataclass

from psycopg.adapt import Dumper
from psycopg.pq import Format


@dataclass(frozen=True, slots=True)
class Array:
    """An array in binary form (array_recv)."""

    sent: bytes


class ArrayDumper(Dumper):
    """Hands arrays over as they are; their type follows from the parameter of the routine."""

    format = Format.BINARY

    def dump(self, obj: Array) -> bytes:
        """Return the array."""
        return obj.sent
