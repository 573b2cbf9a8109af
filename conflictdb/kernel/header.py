"""Read kernel.h: the layouts of its structures, the arguments of its functions, and its constants."""

import ctypes
import re
from functools import cache
from typing import Any, Final

import numpy as np

from conflictdb.kernel import build

_NUMBERS: Final[dict[str, Any]] = {
    "double": ctypes.c_double,
    **{f"{sign}int{bits}_t": getattr(ctypes, f"c_{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
_FUNCTION: Final = re.compile(r"KERNEL_API ([\w ]+) \*?(kernel_\w+)\(([^)]*)\);")
# All other functions return a KernelStatus.
_RETURNS: Final[dict[str, Any]] = {"void": None, "const char": ctypes.c_char_p}


@cache
def _text() -> str:
    return re.sub(r"/\*.*?\*/", "", (build.HERE / "kernel.h").read_text(encoding="utf-8"), flags=re.DOTALL)


@cache
def _structures() -> dict[str, str]:
    return {name: members for members, name in re.findall(r"typedef struct \{([^}]*)\} (\w+);", _text())}


def constant(name: str) -> int:
    """Return the value of a constant, a whole number."""
    found = re.search(rf"^#define {name} (\d+)$", _text(), re.MULTILINE)
    assert found is not None, name  # noqa: S101
    return int(found[1])


def structure(name: str) -> tuple[tuple[tuple[str, Any], ...], dict[str, Any]]:
    """Return the fields of a structure for ctypes, and the element types of the arrays that it points to.

    Pointers are c_void_p, also to other structures and functions, which have no element type.
    """
    fields: list[tuple[str, Any]] = []
    elements: dict[str, Any] = {}
    for line in filter(str.strip, _structures()[name].split(";")):
        kind, _, members = line.strip().removeprefix("const ").partition(" ")
        for member in members.split(","):
            field, _, size = member.strip(" *]").partition("[")
            if "*" in member:
                fields.append((field, ctypes.c_void_p))
                if kind in _NUMBERS:
                    elements[field] = np.dtype(_NUMBERS[kind])
            else:
                of = _NUMBERS[kind] if kind in _NUMBERS else _structure_of(kind)
                fields.append((field, of * constant(size) if size else of))
    return tuple(fields), elements


def _structure_of(name: str) -> Any:
    return type(name, (ctypes.Structure,), {"_fields_": structure(name)[0]})


def record(name: str) -> np.dtype[Any]:
    """Return a structure of numbers as the type of an array's elements."""
    return np.dtype(_structure_of(name))


@cache
def functions() -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Return the result type and the argument types of each function."""
    found: dict[str, tuple[Any, tuple[Any, ...]]] = {}
    for result, name, given in _FUNCTION.findall(_text()):
        takes = [] if given == "void" else given.split(",")
        types = (ctypes.c_void_p if "*" in one else _NUMBERS[one.split()[0]] for one in takes)
        found[name] = _RETURNS.get(result, ctypes.c_int), tuple(types)
    return found
