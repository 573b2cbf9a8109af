"""Conflicts of numbered objects as users see them."""

from collections.abc import Mapping
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.inputs import EPOCH, MICROSECOND
from conflictdb.model import FOR_EVER_US, SINCE_EVER_US, Scene
from conflictdb.results import Conflict, Kind, Position, Verdict


def told(scene: Scene, keys: Mapping[tuple[int, int], str], conflicts: Conflicts) -> list[Conflict]:
    """Return conflicts, and pairs that are only near, in the order of their keys, areas first.

    keys : of objects, by the code of their kind and their number
    """
    answer = []
    for k in range(len(conflicts)):
        pair = [
            (Kind.of_code(int(kind[k])), keys[int(kind[k]), int(number[k])])
            for kind, number in ((conflicts.a_kind, conflicts.a_id), (conflicts.b_kind, conflicts.b_id))
        ]
        (a_kind, a_key), (b_kind, b_key) = sorted(pair, key=lambda member: (member[0].code, member[1].encode()))
        ends_deg = [conflicts.closest_a_deg[k], conflicts.closest_b_deg[k]]
        if (a_kind, a_key) != pair[0]:
            ends_deg.reverse()
        periods = conflicts.period_us[conflicts.period_offset[k] : conflicts.period_offset[k + 1]].tolist()
        answer.append(
            Conflict(
                scene=scene.name,
                a_key=a_key,
                a_kind=a_kind,
                b_key=b_key,
                b_kind=b_kind,
                verdict=Verdict.of_code(int(conflicts.verdict[k])),
                periods=tuple((_instant(start), _instant(end)) for start, end in periods),
                time_error_s=float(conflicts.time_error_s[k]),
                method=scene.method,
                first_contact_deg=_position(conflicts.first_contact_deg[k]),
                closest_at=_instant(int(conflicts.closest_us[k])),
                closest_m=_number(conflicts.closest_m[k]),
                closest_error_m=_number(conflicts.closest_error_m[k]),
                closest_a_deg=_position(ends_deg[0]),
                closest_b_deg=_position(ends_deg[1]),
            )
        )
    return sorted(answer, key=lambda one: (one.a_kind.code, one.a_key.encode(), one.b_key.encode()))


def _instant(us: int) -> datetime | None:
    return None if us in (SINCE_EVER_US, FOR_EVER_US) else EPOCH + us * MICROSECOND


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _position(position_deg: NDArray[np.float64]) -> Position | None:
    lon, lat = position_deg.tolist()
    return None if np.isnan(lon) else (lon, lat)
