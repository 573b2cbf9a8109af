"""Few places spell out a plan: all others loop over the table of its columns (model/plan_columns.py).

`./run python tests/support/spellings.py` prints the places. Their number may only fall: a new column of a plain form
needs none of them (tests/paths/test_made_up_columns.py), one of the form OWN a codec in each of FORMS.
"""

from pathlib import Path
from typing import Final

from spellings import AT_LEAST, blocks, blocks_of_python, columns_named, spellings

from conflictdb.model.plan_columns import PLAN_COLUMNS

# Where a column is defined, checked and held.
HOMES: Final = {
    "conflictdb/model/plan_columns.py PLAN_COLUMNS": "the table",
    "conflictdb/model/plans.py Area": "fields for type checkers, and their documentation",
    "conflictdb/model/plans.py Track": "fields for type checkers, and their documentation",
    "conflictdb/arrays/objects.py TrackBatch": "columns of arrays",
}
# One codec for each column of the form OWN: shapes, times and heights of legs have another notation in each form.
FORMS: Final = {
    "conflictdb/formats/file_objects.py SCENE": "scene files: words about groups of members",
    "sql/44_attached_objects.sql _staged_tracks": "rows of attached tables, one for each waypoint",
    "sql/79_requests.sql _feature": "JSON of SQL, written",
    "sql/88_admit.sql _as_parameters": "JSON of SQL, read",
    "sql/84_map_page.sql _map_tracks": "the page draws these columns",
}
# These act on the columns that they name.
RULES: Final = {
    "conflictdb/core/pieces/ribbons.py with_ribbons": "tracks that contain all voyages within tolerances",
    "sql/13_validation.sql _area_before": "checks of a row",
    "sql/13_validation.sql _track_before": "checks of a row",
    "sql/13_validation.sql _check_track_shape": "checks of a row",
    "sql/24_rough_pieces.sql _rough_pieces": "pieces of plans that are not cut",
    "sql/40_attachment_map.sql _check_map": "which fields of a map exclude each other",
    "sql/77_havens.sql havens": "motion",
}
# Parameters and results of public routines, which do not change with the table.
PUBLIC: Final = {
    "sql/67_scenes_and_objects.sql list_objects": "what people look for in a list",
    "sql/79_requests.sql request_track_probe": "a track of few columns; request_plans_probe takes all",
}
# The same names in signatures of former releases.
NOT_PLANS: Final = {
    "sql/06_retired.sql acknowledge": "signatures of routines of former releases",
}
PLACES: Final = HOMES | FORMS | RULES | PUBLIC | NOT_PLANS
MOST: Final = 19


def test_no_other_place_spells_out_a_plan() -> None:
    found = list(spellings())
    new = [f"{one.file}:{one.line} {one.block}: {', '.join(one.columns)}" for one in found if one.place not in PLACES]
    assert new == [], "loop over model/plan_columns.py"
    gone = PLACES.keys() - {one.place for one in found}
    assert gone == set(), "take these from the list, and lower MOST"
    assert len(found) <= MOST == len(PLACES)


def test_a_spelling_is_found() -> None:
    """In code, and neither in documentation nor in what is made from the table."""
    fields = [one.field for one in PLAN_COLUMNS if one.name != "name"][:-1]
    code = "def of(track):\n" + "".join(f"    use(track.{name})\n" for name in fields)
    text = '"""' + " ".join(fields) + '"""\n' + code
    documentation, of = blocks_of_python(text)
    assert (of[0], of[1], documentation[1]) == ("of", 2, 1)
    assert columns_named(documentation[2], in_python=True) == ()
    assert len(columns_named(of[2], in_python=True)) >= AT_LEAST


def test_routines_and_the_search_path_are_no_columns(tmp_path: Path) -> None:
    file = tmp_path / "a.sql"
    file.write_text("CREATE FUNCTION f() SET search_path FROM CURRENT AS $$\n    SELECT outlines(t), t.shape, owner\n")
    one = {block: text for block, _, text in blocks(file)}["f"]
    assert columns_named(one, in_python=False) == ("owner", "shape")
