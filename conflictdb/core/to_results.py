"""Convert conflicts of numbered objects to results for users."""

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from math import isnan
from typing import Any, Final

import numpy as np

from conflictdb.arrays.answers import Conflicts
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Scene
from conflictdb.model.record import MEASURED, ColumnType
from conflictdb.model.results import Certainty, Conflict, Kind, Position, Verdict


def to_results(
    scene: Scene, named: Mapping[tuple[int, int], tuple[str, str | None]], conflicts: Conflicts
) -> list[Conflict]:
    """Return conflicts and near pairs in the order of their keys, areas first.

    named : keys and names of objects, by the code of their kind and their number
    """
    members = [
        [(kind, *named[kind, number]) for kind, number in zip(kinds.tolist(), numbers.tolist(), strict=True)]
        for kinds, numbers in ((conflicts.a_kind, conflicts.a_id), (conflicts.b_kind, conflicts.b_id))
    ]
    is_swapped = [_rank(*b[:2]) < _rank(*a[:2]) for a, b in zip(*members, strict=True)]
    conflicts = conflicts.turned(np.array(is_swapped, np.bool_))
    answer = []
    measured = [
        (one.field, [_VALUE[one.type](value) for value in getattr(conflicts, one.array).tolist()]) for one in MEASURED
    ]
    for k, pair in enumerate(zip(*members, strict=True)):
        (a_kind, a_key, a_name), (b_kind, b_key, b_name) = reversed(pair) if is_swapped[k] else pair
        periods = conflicts.period_us[conflicts.period_offset[k] : conflicts.period_offset[k + 1]].tolist()
        of_row: dict[str, Any] = {name: values[k] for name, values in measured}
        answer.append(
            Conflict(
                scene=scene.name,
                a_key=a_key,
                a_kind=Kind.of_code(a_kind),
                b_key=b_key,
                b_kind=Kind.of_code(b_kind),
                verdict=Verdict.of_code(int(conflicts.verdict[k])),
                periods=tuple((moment_of(start), moment_of(end)) for start, end in periods),
                method=scene.method,
                a_name=a_name,
                b_name=b_name,
                **of_row,
            )
        )
    return sorted(answer, key=lambda one: (one.a_kind.code, one.a_key.encode(), one.b_key.encode()))


def _rank(kind: int, key: str) -> tuple[int, bytes]:
    return kind, key.encode()


def moment_of(us: int) -> datetime | None:
    """Return an instant; None for those that are unbounded."""
    return None if us in (MINUS_INFINITY_US, INFINITY_US) else EPOCH + us * MICROSECOND


def _number(value: float) -> float | None:
    return None if isnan(value) else value


def _position(position_deg: Sequence[float]) -> Position | None:
    lon, lat = position_deg
    return None if isnan(lon) else (lon, lat)


# How a value of an array becomes that of a `Conflict`.
_VALUE: Final[dict[ColumnType, Callable[[Any], Any]]] = {
    ColumnType.INSTANT: moment_of,
    ColumnType.NUMBER: _number,
    ColumnType.POINT: _position,
    ColumnType.NAME: Certainty.of_code,
}
