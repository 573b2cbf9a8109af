"""All contacts of pairs of pieces, with their verdicts, from the kernel."""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from threading import Event
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Contacts
from conflictdb.kernel.header import record, structure
from conflictdb.kernel.kernel_scene import HeldPairs, HeldWork, KernelScene, Work
from conflictdb.kernel.library import address, check, library, shared, taken
from conflictdb.kernel.waiting import ThreadWork

# Returns where the last (or first) contact of a pair may be: (pair, low_s, high_s, is_last), seconds; NaN: unknown.
Guess = Callable[[int, float, float, bool], float]

# KernelContact.
CONTACT: Final = record("KernelContact")
_GUESS: Final = ctypes.CFUNCTYPE(
    ctypes.c_double, ctypes.c_void_p, ctypes.c_int64, ctypes.c_double, ctypes.c_double, ctypes.c_int32
)


@dataclass(frozen=True, slots=True)
class Questions:
    """Queries for the contacts of n pairs of pieces.

    a, b : (n,) indices of pieces
    zero_us : (n,) the instant that the pair's seconds count from
    low_s, high_s : (n,) the pair's time, within the slices of both pieces
    beyond_s : (n,) first instant after the pair's span, which excludes it; infinite: the span includes its last instant
    pairs_of_objects : (n,) divides the work budget of two objects among their pairs; None: 1 each
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    zero_us: NDArray[np.int64]
    low_s: Floats
    high_s: Floats
    beyond_s: Floats
    pairs_of_objects: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: NDArray[np.int64]) -> "Questions":
        """Return the queries of some pairs."""
        times = self.zero_us[rows], self.low_s[rows], self.high_s[rows], self.beyond_s[rows]
        counts = None if self.pairs_of_objects is None else self.pairs_of_objects[rows]
        return Questions(self.a[rows], self.b[rows], *times, counts)


def contacts(
    scene: KernelScene,
    questions: Questions,
    separation_m: float,
    tolerance_m: float,
    work: Work,
    threads: int = 1,
    guess: Guess | None = None,
) -> Contacts:
    """Return when pairs lose separation; with separation_m 0, when they touch.

    tolerance_m : clearances within this of zero are too close to call
    work : work counters, increased
    guess : callback for where contacts may be; changes the work, not the answer
    """
    n = len(questions)
    pairs = HeldPairs.arrays(questions.a, questions.b, questions.zero_us, questions.low_s, questions.high_s)
    beyond_s = np.ascontiguousarray(questions.beyond_s, np.float64)
    counts = None
    if questions.pairs_of_objects is not None:
        counts = np.ascontiguousarray(questions.pairs_of_objects, np.int64)
    if len(beyond_s) != n or (counts is not None and len(counts) != n):
        raise ValueError("kernel: the columns of pairs are not of one length")

    is_over = Event()

    def solve(rows: slice) -> tuple[NDArray[Any], HeldWork]:
        asked = _Asked(guess, rows.start, is_over)
        question = _Question(separation_m, tolerance_m, address(beyond_s[rows]))
        question.pairs_of_objects = None if counts is None else address(counts[rows])
        question.guess = None if guess is None else ctypes.cast(asked.callback, ctypes.c_void_p)
        held, found, count, done = HeldPairs.of(pairs, rows), ctypes.c_void_p(), ctypes.c_int64(), HeldWork()
        check(
            library().kernel_contacts(
                scene.handle,
                *(ctypes.byref(given) for given in (held, question, found, count, done)),
            )
        )
        items = taken(found, count, CONTACT)
        asked.raise_what_failed()
        items["pair"] += rows.start
        return items, done

    def every(threads: int) -> list[tuple[NDArray[Any], HeldWork]]:
        return shared(solve, n, threads, vertices=scene.vertices(questions.a, questions.b))

    if guess is None:
        parts = every(threads)
    else:
        # In another thread: Python handles signals in the main thread, before the first step of a callback from C. An
        # exception raised there would precede every `try`, and be lost.
        searched = ThreadWork(lambda: every(1))
        try:
            parts = searched.result()
        finally:
            is_over.set()
            searched.wait()
    for _, done in parts:
        for name in Work.__slots__:
            setattr(work, name, getattr(work, name) + getattr(done, name))
    items = np.concatenate([items for items, _ in parts])
    pair, start_s, end_s, error_s = (items[name].copy() for name in ("pair", "start_s", "end_s", "error_s"))
    return Contacts(pair, start_s, end_s, error_s, items["verdict"].astype(np.int8), items["touches"] != 0)


class _Asked:
    """C callback for a guess. Exceptions cannot pass through C: the first one is stored for `raise_what_failed`."""

    def __init__(self, guess: Guess | None, first: int, is_over: Event) -> None:
        self._failed: BaseException | None = None

        def ask(_of: object, pair: int, low_s: float, high_s: float, is_last: int) -> float:
            if guess is None or self._failed is not None or is_over.is_set():
                return float("nan")
            try:
                return guess(first + pair, low_s, high_s, bool(is_last))
            except BaseException as error:
                self._failed = error
                return float("nan")

        self.callback = _GUESS(ask)

    def raise_what_failed(self) -> None:
        if self._failed is not None:
            raise self._failed


class _Question(ctypes.Structure):
    """KernelQuestion."""

    _fields_ = structure("KernelQuestion")[0]
