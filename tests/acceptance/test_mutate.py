"""The mutants themselves: the changed text, and that each still compiles."""

import mutate
from mutate import MODULES, ROOT, Mutant, Sites

SOURCE = '''
LIMIT = 2.0


def least(x: float | None, y: int = 3) -> float:
    """Return 5.0, as a message says."""
    if x is None or x < 0.5:
        raise ValueError(f"{x:.3f} is below {0.5}")
    x *= 2
    return min(-x, y) if y else x + 1
'''


def test_what_is_changed() -> None:
    found = [(m.within, f"{m.old} -> {m.new}") for m in Sites("some", SOURCE).found]
    assert found == [
        ("module", "2.0 -> 4.0"),
        ("least", "x is None or x < 0.5 -> (not (x is None or x < 0.5))"),
        ("least", "x is None or x < 0.5 -> (x is None and x < 0.5)"),
        ("least", "x is None -> (x is not None)"),
        ("least", "x < 0.5 -> (x <= 0.5)"),
        ("least", "x < 0.5 -> (x > 0.5)"),
        ("least", "0.5 -> 1.0"),
        ("least", "x *= 2 -> pass"),
        ("least", "x *= 2 -> x /= 2"),
        ("least", "2 -> 3"),
        ("least", "min(-x, y) if y else x + 1 -> (x + 1 if y else min(-x, y))"),
        ("least", "min(-x, y) -> max(-x, y)"),
        ("least", "-x -> (x)"),
        ("least", "x + 1 -> (x - 1)"),
        ("least", "1 -> 2"),
    ]


def changed(mutant: Mutant) -> str:
    source = (ROOT / "conflictdb" / mutate.file_of(mutant.module)).read_bytes()
    return (source[: mutant.start] + mutant.new.encode() + source[mutant.end :]).decode()


def test_mutants_are_drawn_by_the_seed_and_compile() -> None:
    drawn = mutate.drawn(ROOT, MODULES, 100, 7)
    assert drawn == mutate.drawn(ROOT, MODULES, 100, 7)
    assert drawn != mutate.drawn(ROOT, MODULES, 100, 8)
    assert len({mutant.module for mutant in drawn}) > 10
    for mutant in drawn:
        compile(changed(mutant), mutant.module, "exec")
