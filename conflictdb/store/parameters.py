"""Pass arrays to statements in PostgreSQL's binary form, as `copy_binary.array` encodes them."""

from dataclasses import dataclass

from psycopg.adapt import Dumper
from psycopg.pq import Format


@dataclass(frozen=True, slots=True)
class Array:
    """An array in binary form (array_recv)."""

    sent: bytes


class ArrayDumper(Dumper):
    """Pass encoded arrays through; their type follows from the routine's parameter."""

    format = Format.BINARY

    def dump(self, obj: Array) -> bytes:
        """Return the array."""
        return obj.sent
