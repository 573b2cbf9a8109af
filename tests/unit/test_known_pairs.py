"""Which pairs are known, by numbers of objects and digests."""

import numpy as np
from numpy.typing import NDArray

from conflictdb.store import copy_binary
from conflictdb.store.known_pairs import KnownPairs, digests

TRACK = 1 << 62  # above the numbers of areas


def find(known: KnownPairs, *pairs: tuple[int, int, int, int, int]) -> tuple[list[int], list[bool]]:
    """Ask for pairs: kind and number of both members, digest."""
    a_kind, a_id, b_kind, b_id, digest = np.array(pairs, dtype=np.int64).reshape(-1, 5).T
    how, is_same = known.find(a_kind, a_id, b_kind, b_id, digest)
    return how.tolist(), is_same.tolist()


def ints(*values: int) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)


def places(count: int) -> NDArray[np.uint8]:
    return np.repeat(np.arange(1, count + 1, dtype=np.uint8)[:, None], 6, axis=1)


def test_pairs_are_found_whichever_member_their_row_has_first() -> None:
    known = KnownPairs(ints(1, 7, 5), ints(TRACK | 1, 3, TRACK | 7), ints(10, 20, 30), places(3))
    asked = [(0, 1, 1, 1, 10), (0, 3, 0, 7, 21), (0, 1, 1, 7, 30), (0, 3, 1, 3, 30), (0, 9, 0, 10, 0)]
    rows, is_same = find(known, *asked)
    assert is_same == [True, False, False, False, False]
    column = known.places(np.array(rows))
    assert column.is_null is not None
    assert column.is_null.tolist() == [False, False, True, True, True]
    assert column.data.tolist() == 6 * [1] + 6 * [2]
    gone = known.gone()
    assert [part.tolist() for member in known.members(gone) for part in member] == [[0], [5], [1], [7]]
    assert known.places(gone).data.tolist() == 6 * [3]


def test_a_row_that_comes_twice_goes_once() -> None:
    """It does where both of its members changed."""
    known = KnownPairs(ints(4, 4), ints(2, 2), ints(1, 1), places(1).repeat(2, axis=0))
    assert known.gone().tolist() == [0]
    assert [part.tolist() for member in known.members(known.gone()) for part in member] == [[0], [2], [0], [4]]


def test_nothing_is_known_of_an_empty_scene() -> None:
    known = KnownPairs(ints(), ints(), ints(), places(0))
    assert find(known, (0, 1, 0, 2, 0)) == ([-1], [False])
    assert len(known.gone()) == 0


def test_digests_are_those_of_the_published_hash() -> None:
    """SipHash-2-4 of the bytes 0 to 14 under a key of 0 to 15: appendix A of its paper; however they are cut."""
    key, row = bytes(range(16)), np.arange(15, dtype=np.uint8)[None]
    for cuts in ([], [8], [3], [1, 2, 11], [7, 7, 15]):
        assert digests(np.split(row, cuts, axis=1), key).view(np.uint64).tolist() == [0xA129CA6149BE45E5]


def test_digests_tell_rows_and_keys_apart() -> None:
    texts = copy_binary.Ragged.of([b"ab", b"a", b"", b"ab"])
    numbers = copy_binary.fixed([1, 1, 1, 1], "i8")
    first = digests([numbers, texts], bytes(16)).tolist()
    assert first[0] == first[3]
    assert len(set(first)) == 3
    assert 0 not in first
    assert not set(first) & set(digests([numbers, texts], bytes(15) + b"k").tolist())
