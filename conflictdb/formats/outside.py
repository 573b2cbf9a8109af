"""Find the readers and writers of the outer room `exchange` by name, when a file needs one: no import leads there."""

from importlib import import_module
from typing import Any


def of_exchange(module: str, name: str) -> Any:
    """Return an object of a module of `exchange`."""
    return getattr(import_module(f"conflictdb.exchange.{module}"), name)
