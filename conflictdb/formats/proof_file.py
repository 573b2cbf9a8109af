"""Write proofs: objects as written, settings, verdicts and what proves them, as docs/reference/proof.md says."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any, Final

import conflictdb
from conflictdb.core.proofs import Apart, Delayed, Proofs, ProvenContacts, Reported
from conflictdb.core.world import Occupied
from conflictdb.formats.instants import format_instant
from conflictdb.formats.scene_file import feature_of, settings_of
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track

VERSION: Final = 1


def proof_lines(
    scene: Scene,
    occupied: Occupied,
    reported: Sequence[Reported],
    proofs: Proofs,
    about: dict[str, Any],
    delays: Sequence[Delayed] = (),
) -> Iterator[str]:
    """Yield the lines of a proof.

    scene : settings, with a centre
    about : further members of the first line
    delays : the last tracks of `occupied` are these, delayed
    """
    every = occupied.plans()
    objects = every[: len(every) - len(delays)]
    yield _line({"conflictdb_proof": VERSION, "made_by": f"conflictdb {conflictdb.__version__}", **about})
    parts = {
        "settings": iter([_text(settings_of(scene))]),
        "objects": (_text(feature_of(one)) for one in objects),
        "pieces": _pieces(every, proofs),
        "verdicts": chain(_verdicts(objects, reported), (_text(_delay(objects, one)) for one in delays)),
        "proofs": _proofs(proofs),
    }
    digests = {}
    for name, lines in parts.items():
        yield _line({"part": name})
        digest = hashlib.sha256()
        for line in lines:
            text = f"{line}\n"
            digest.update(text.encode())
            yield text
        digests[name] = digest.hexdigest()
    yield _line({"sha256": digests})


def _line(value: Any) -> str:
    return f"{_text(value)}\n"


def _text(value: Any) -> str:
    """Return JSON in ASCII."""
    return json.dumps(value, allow_nan=False)


def _pieces(objects: Sequence[Area | Track], proofs: Proofs) -> Iterator[str]:
    """Yield how objects are cut, and the activations that schedules became."""
    cuts = proofs.cuts
    unproven = set(cuts.unproven)
    for k, one in enumerate(objects):
        members: dict[str, Any] = {}
        if one.schedule is not None and isinstance(one, Track):
            members["departures"] = [int(at) for at in one.departures_us or ()]
        elif one.schedule is not None and isinstance(one, Area):
            members["spans"] = [[start, end] for start, end in one.spans_us or ()]
        if k in cuts.cuts_us:
            members["cuts"] = cuts.cuts_us[k]
        if k in cuts.parts:
            members["parts"] = cuts.parts[k]
        if k in unproven:
            members["unproven"] = True
        if members:
            yield _text({"object": k, **members})


def _verdicts(objects: Sequence[Area | Track], reported: Sequence[Reported]) -> Iterator[str]:
    keys = [_text(one.key) for one in objects]
    for one in reported:
        periods = ", ".join(f"[{_instant(start)}, {_instant(end)}]" for start, end in one.periods_us)
        pair = f'"a": {keys[one.a]}, "b": {keys[one.b]}, "verdict": "{one.verdict.value}"'
        yield f'{{{pair}, "periods": [{periods}], "time_error_s": {_text(one.time_error_s)}}}'


def _delay(objects: Sequence[Area | Track], one: Delayed) -> dict[str, Any]:
    return {"delay": objects[one.of].key, "least_us": one.least_us, "error_us": one.error_us}


def _instant(at_us: int) -> str:
    return "null" if at_us in (MINUS_INFINITY_US, INFINITY_US) else f'"{format_instant(at_us)}"'


def _proofs(proofs: Proofs) -> Iterator[str]:
    for apart, contacts in proofs.chunks:
        yield from _apart(apart)
        for one in contacts:
            yield from _contacts(one)


def _apart(apart: Apart) -> Iterator[str]:
    """Yield for each pair its pieces, and angles with the seconds until which they hold; the last holds to the end."""
    columns = (column.tolist() for column in (apart.a, apart.b, apart.turns, apart.offset[:-1], apart.offset[1:]))
    until, angle = apart.until_s.tolist(), [None if one != one else one for one in apart.angle.tolist()]
    for a, b, turns, first, end in zip(*columns, strict=True):
        if end - first == 1:
            yield f"[{a},{b},{turns},{'null' if angle[first] is None else repr(angle[first])}]"
        else:
            steps = [one for k in range(first, end) for one in (angle[k], until[k])]
            yield json.dumps([a, b, turns, *steps[:-1]], separators=(",", ":"))


def _contacts(contacts: ProvenContacts) -> Iterator[str]:
    columns = (
        column.tolist() for column in (contacts.a, contacts.b, contacts.turns, contacts.at_s, contacts.points_deg)
    )
    for a, b, turns, at_s, points in zip(*columns, strict=True):
        yield f'["{contacts.kind}", {", ".join(map(repr, (a, b, turns, at_s, *points)))}]'
