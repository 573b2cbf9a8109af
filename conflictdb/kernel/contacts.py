"""All contacts of pairs of pieces, with their verdicts, from the kernel."""

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Contacts
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.library import check, library, shared
from conflictdb.kernel.scene import HeldPairs, HeldWork, Scene, Work
from conflictdb.waiting import answer_of

# Tells where the last (or first) contact of a pair may be: (pair, low_s, high_s, is_last), seconds, NaN if not known.
Guess = Callable[[int, float, float, bool], float]

# KernelContact.
CONTACT: Final = np.dtype(
    [
        ("pair", np.int64),
        *((name, np.float64) for name in ("start_s", "end_s", "error_s")),
        ("verdict", np.int32),
        ("touches", np.int32),
    ]
)
_GUESS: Final = ctypes.CFUNCTYPE(
    ctypes.c_double, ctypes.c_void_p, ctypes.c_int64, ctypes.c_double, ctypes.c_double, ctypes.c_int32
)


@dataclass(frozen=True, slots=True)
class Questions:
    """What is asked about n pairs of pieces.

    a, b : (n,) numbers of pieces
    zero_us : (n,) what each pair's seconds count from
    low_s, high_s : (n,) each pair's time, within what both pieces have
    beyond_s : (n,) the first instant that is no longer in the pair's span; infinite where the last one is
    company : (n,) with how many pairs each shares the work that may be done for two objects; None: each has its own
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    zero_us: NDArray[np.int64]
    low_s: Floats
    high_s: Floats
    beyond_s: Floats
    company: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: NDArray[np.int64]) -> "Questions":
        """Return some of the questions."""
        times = self.zero_us[rows], self.low_s[rows], self.high_s[rows], self.beyond_s[rows]
        company = None if self.company is None else self.company[rows]
        return Questions(self.a[rows], self.b[rows], *times, company)


def contacts(
    scene: Scene,
    questions: Questions,
    separation_m: float,
    tolerance_m: float,
    work: Work,
    threads: int = 1,
    guess: Guess | None = None,
) -> Contacts:
    """Return when pairs are nearer than a separation; where that is 0, when they touch.

    tolerance_m : closeness that is too close to call
    work : counts what is done
    guess : is asked where contacts may be; what it answers decides the work alone
    """
    n = len(questions)
    pairs = HeldPairs.arrays(questions.a, questions.b, questions.zero_us, questions.low_s, questions.high_s)
    beyond_s = np.ascontiguousarray(questions.beyond_s, np.float64)
    company = None if questions.company is None else np.ascontiguousarray(questions.company, np.int64)
    if len(beyond_s) != n or (company is not None and len(company) != n):
        raise ValueError("kernel: the columns of pairs are not of one length")

    is_over = Event()

    def solve(rows: slice) -> tuple[NDArray[Any], HeldWork]:
        asked = _Asked(guess, rows.start, is_over)
        question = _Question(separation_m, tolerance_m, beyond_s[rows].ctypes.data)
        question.company = None if company is None else company[rows].ctypes.data
        question.guess = _GUESS() if guess is None else asked.callback
        held, found, count, done = HeldPairs.of(pairs, rows), ctypes.c_void_p(), ctypes.c_int64(), HeldWork()
        check(
            library().kernel_contacts(
                scene.handle,
                *(ctypes.byref(given) for given in (held, question, found, count, done)),
            )
        )
        try:
            size = count.value * CONTACT.itemsize
            items = np.frombuffer(ctypes.string_at(found, size) if size else b"", CONTACT).copy()
        finally:
            library().kernel_contacts_free(found)
        asked.raise_what_failed()
        items["pair"] += rows.start
        return items, done

    def every(threads: int) -> list[tuple[NDArray[Any], HeldWork]]:
        return shared(solve, n, threads, vertices=scene.vertices(questions.a, questions.b))

    if guess is None:
        parts = every(threads)
    else:
        # Aside, for Python handles signals in the main thread, before the first step of a function that C calls: an
        # exception would be raised there in front of every `try`, and lost.
        with ThreadPoolExecutor(1) as pool:
            try:
                parts = answer_of(pool.submit(every, 1))
            finally:
                is_over.set()
    for _, done in parts:
        for name in Work.__slots__:
            setattr(work, name, getattr(work, name) + getattr(done, name))
    items = np.concatenate([items for items, _ in parts])
    pair, start_s, end_s, error_s = (items[name].copy() for name in ("pair", "start_s", "end_s", "error_s"))
    return Contacts(pair, start_s, end_s, error_s, items["verdict"].astype(np.int8), items["touches"] != 0)


class _Asked:
    """A guess as the library calls it, until it is over; what it raises is kept, for no exception goes through C."""

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

    _fields_ = (
        ("separation_m", ctypes.c_double),
        ("tolerance_m", ctypes.c_double),
        ("beyond_s", ctypes.c_void_p),
        ("company", ctypes.c_void_p),
        ("guess", _GUESS),
        ("guess_of", ctypes.c_void_p),
    )
