"""The published formulas of stage 3, in benchmarks/published.py: their errors are those described there."""

from pathlib import Path

import numpy as np
import pytest
import scenes
import shapely
from published import (
    CASES,
    MENDED,
    PRINTED,
    ROUNDING_S,
    STAGE_3,
    errors_of,
    one_pair_each,
    published_windows,
    whole_legs,
)
from tables import markdown, put_into

from conflictdb.earth.geodesy import earth_of
from conflictdb.model.plans import EarthModel


@pytest.mark.parametrize(("fore", "aft"), [(4000, 2000), (2000, 4000)])
def test_published_formulas_on_the_equator_where_havens_are_rigid(fore: int, aft: int) -> None:
    """Mended, they are the contact itself; as printed, the rear is taken off the start and the front off the end."""
    degree = scenes.parallel_m(EarthModel.SPHERE, 0.0)
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], fore=fore, aft=aft, port=500, starboard=500)
    with whole_legs():
        pieces, pairs = one_pair_each([scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))], [track])
    expected = {
        False: [(0.5 - aft / degree) * 3600, (0.6 - fore / degree) * 3600],
        True: [(0.5 - fore / degree) * 3600, (0.6 + aft / degree) * 3600],
    }
    for mended, window in expected.items():
        windows = published_windows(earth_of(EarthModel.SPHERE), pieces, pairs, mended=mended)
        assert np.allclose(np.concatenate(windows), window, rtol=0.0, atol=1e-3)


def test_published_windows_are_clamped_to_the_leg() -> None:
    """An area that covers the whole leg: both forms start no earlier than it, and end no later."""
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], fore=4000, aft=2000, port=500, starboard=500)
    with whole_legs():
        pieces, pairs = one_pair_each([scenes.area("A", shapely.box(-1.0, -1.0, 2.0, 1.0))], [track])
    for mended in (False, True):
        first, last = published_windows(earth_of(EarthModel.SPHERE), pieces, pairs, mended=mended)
        assert (first[0], last[0]) == (0.0, 3600.0)


def test_published_formulas_are_worse_than_mended_ones_and_stage_3_never_fails() -> None:
    """On few pairs of the worst row: printed starts and ends hours off, mended minutes, stage 3 not at all."""
    found = errors_of(CASES[-1], count=15, checked=3)
    printed, mended = found.early[PRINTED].max(), max(found.early[MENDED].max(), found.late[MENDED].max())
    assert printed > 120.0
    assert found.late[PRINTED].max() > 60.0
    assert 1.0 < mended < printed / 2.0
    assert max(found.early[STAGE_3].max(), found.late[STAGE_3].max()) <= ROUNDING_S / 60.0
    assert found.checked == 3


def test_table_replaces_what_stood_there_before(tmp_path: Path) -> None:
    """The rest of a document stays the same; a document without a place for the table is refused."""
    document = tmp_path / "page.md"
    document.write_text("above\n<!-- benchmark speed -->\nold\n<!-- end of speed -->\nbelow\n")
    for value in ("1", "2"):
        put_into(document, "speed", markdown(("a", "b"), [(value, "x")]))
    text = document.read_text()
    assert text.startswith("above\n")
    assert text.endswith("below\n")
    assert "| 2 | x |" in text
    assert "old" not in text
    assert "| 1 | x |" not in text
    with pytest.raises(ValueError, match="no place for weight"):
        put_into(document, "weight", "")
