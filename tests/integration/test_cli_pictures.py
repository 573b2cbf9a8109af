"""`plot` and `report`, on a real database."""

import re
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import psycopg
import pytest
from commands import STRAIT, Run, runner
from matplotlib.text import Text

import conflictdb
from conflictdb import store
from conflictdb.store import listing


@pytest.fixture
def run(dsn: str, capsys: pytest.CaptureFixture[str]) -> Run:
    run = runner(dsn, capsys)
    assert run("detect", STRAIT).code == 0
    return run


def test_a_scene_and_a_pair_are_drawn(run: Run, tmp_path: Path) -> None:
    for name, more in (
        ("scene.svg", ()),
        ("pair.svg", ("--conflict", "TOW", "FERRY")),
        ("none.svg", ("--conflict", "FERRY", "RESERVE")),
        ("bars.svg", ("--delays",)),
        ("times.svg", ("--delays", "--conflict", "DIVING", "FERRY")),
    ):
        done = run("plot", "--scene", "strait", *more, str(tmp_path / name))
        assert (done.code, done.out, done.err) == (0, "", "")
    [pair] = [one for one in run("conflicts", "TOW", "--format", "json").json if one["a_key"] == "FERRY"]
    first, last = (datetime.fromisoformat(pair[name]) for name in ("first_contact", "last_contact"))
    contacts = [f"{one:%H:%M:%S}" for one in (first, last + timedelta(seconds=1, microseconds=-1))]
    drawn = {path.stem: path.read_text() for path in tmp_path.iterdir()}
    assert "strait: 4 areas, 7 tracks, 7 conflicts" in drawn["scene"]
    assert "Tug with a barge on a long … and Ferry: conflict" in drawn["pair"]
    assert re.findall(r"(?:first|last) contact \d\d:\d\d:\d\d", drawn["pair"]) == [
        f"{which} contact {clock}" for which, clock in zip(("first", "last"), contacts, strict=True)
    ], "filled, and an empty outline"
    assert "Nature reserve, always clos… and Ferry: no conflict is known" in drawn["none"]
    names = [
        "Submarine haven, deep",
        "Ferry",
        "Submarine haven, shallow",
        "Tug with a barge on a long …",
        "Survey aircraft",
    ]
    names += ["First ship of a convoy", "Second ship, 1 nautical mil…"]
    assert [text for text in re.findall(r">([^<>]+)</text>", drawn["bars"]) if text in names] == names
    assert "FERRY 17 min 26 s earlier" in drawn["times"]


def test_without_regions_first_contacts_are_drawn_and_the_report_says_so(run: Run, tmp_path: Path) -> None:
    assert run("detect", "--scene", "strait", "--regions", "off").code == 0
    for name in ("scene.svg", "x.html"):
        done = run("plot" if name == "scene.svg" else "report", "--scene", "strait", str(tmp_path / name))
        assert (done.code, done.err) == (0, "")
    assert "strait: 4 areas, 7 tracks, 7 conflicts" in (tmp_path / "scene.svg").read_text()
    assert re.search(r"Regions</t[dh]>\s*<td[^>]*>off<", (tmp_path / "x.html").read_text())


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (("x.jpg",), "plot: file: must end in .png, .svg, .pdf"),
        (("--conflict", "TOW", "NOBODY", "x.svg"), "scene 'strait': object: 'NOBODY' is not known"),
        (("--conflict", "TOW", "TOW", "x.svg"), "plot: keys: must be of two objects; got 'TOW' twice"),
        (("--delays", "--conflict", "CABLE", "DIVING", "x.svg"), "plot: a: or b must be a Track"),
    ],
)
def test_what_cannot_be_drawn_is_refused(run: Run, more: tuple[str, ...], says: str) -> None:
    done = run("plot", "--scene", "strait", *more)
    assert done.code == 4
    assert says in done.err
    assert run("report", "--scene", "strait", "x.txt").code == 4
    assert run("report", "--scene", "nowhere", "x.html").code == 4


def test_what_is_not_complete_says_so_in_the_picture_too(run: Run, dsn: str, tmp_path: Path) -> None:
    with psycopg.connect(dsn) as conn:
        conn.execute("SELECT conflictdb.put_area('strait', 'LATE', ST_SetSRID(ST_MakeEnvelope(8, 57, 9, 58), 4326))")
    for name, more in (("scene.svg", ()), ("pair.svg", ("--conflict", "LATE", "FERRY"))):
        done = run("plot", "--scene", "strait", *more, str(tmp_path / name))
        assert done.code == 0
        assert "strait: not complete" in done.err
        assert "NOT COMPLETE" in (tmp_path / name).read_text()
    done = run("report", "--scene", "strait", str(tmp_path / "x.html"))
    assert done.code == 0
    assert "not complete" in done.err
    assert "NOT COMPLETE" in (tmp_path / "x.html").read_text()


def test_a_report_names_objects_and_says_who_acknowledged(run: Run, dsn: str, tmp_path: Path) -> None:
    """When, until when and why; without an acknowledgement there is no such section. It tells of the last run."""
    path = tmp_path / "x.html"
    assert run("report", "--scene", "strait", str(path)).code == 0
    page = path.read_text()
    assert "Run 1, " in page
    assert "whose boxes meet (stage 1)" in page
    assert "<td>TOW must leave 11 min 18 s later or 7 min 59 s earlier to clear FERRY</td>" in page
    assert "PostgreSQL " in page
    assert "<td>FIRING (Firing practice)</td><td>FERRY (Ferry)</td>" in page
    assert "Acknowledged" not in page
    reason = ("--reason", "seen <by> me", "--by", "Ada", "--until", "2100-01-01T00:00Z")
    assert run("acknowledge", "--scene", "strait", "FIRING", "FERRY", *reason).code == 0
    assert run("report", "--scene", "strait", str(path)).code == 0
    with conflictdb.connect(dsn) as db:
        (one,) = db.scene("strait").conflicts(acknowledged=True)
    assert one.acknowledged_at is not None
    told = path.read_text()
    assert "1 of 7 conflicts." in told
    assert "<td>conflict (acknowledged)</td>" in told
    (row,) = re.findall("<td>FIRING .*", told.partition("<h2>Acknowledged</h2>")[2].partition("</table>")[0])
    at = one.acknowledged_at.strftime("%Y-%m-%d %H:%M:%S")
    assert one.acknowledged_by is not None
    assert row.startswith(f"<td>FIRING (Firing practice)</td><td>FERRY (Ferry)</td><td>{one.acknowledged_by}</td>")
    assert "Ada" in one.acknowledged_by
    assert f"<td>{at}</td><td>2100-01-01 00:00:00</td><td>seen &lt;by&gt; me</td>" in row


def test_conflicts_of_a_database_draw_themselves(run: Run, dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        conflict = db.scene("strait").conflicts()[0]
        assert conflict.plot().axes
        # The objects are drawn as they are now.
        db.connection.execute("SELECT conflictdb.remove_object('strait', 'RESERVE')")
        texts = [one.get_text() for one in conflict.plot().findobj(Text)]
        assert any("NOT COMPLETE" in text for text in texts)
        with pytest.raises(conflictdb.InvalidInput, match="b_key: is needed with a_key"):
            db.scene("strait").plot("TOW")
        with pytest.raises(conflictdb.InvalidInput, match="plot_delays: b_key: is needed with a_key"):
            db.scene("strait").plot_delays("TOW")


def test_a_figure_of_a_pair_reads_the_pair_alone(run: Run, dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many objects and conflicts the scene has."""
    read: list[Any] = []
    read_scene, call_each = store.read_scene, listing.call_each_by_name

    def objects(*asked: Any) -> Any:
        found = read_scene(*asked)
        read.extend([*found[1], *found[2]])
        return found

    def rows(*asked: Any) -> Iterator[Any]:
        for row in call_each(*asked):
            read.append(row)
            yield row

    monkeypatch.setattr(store, "read_scene", objects)
    monkeypatch.setattr(listing, "call_each_by_name", rows)
    with conflictdb.connect(dsn) as db:
        db.scene("strait").detect(nearest_m=100_000.0)
        (conflict,) = [one for one in db.scene("strait").conflicts() if (one.a_key, one.b_key) == ("FERRY", "TOW")]
        for draw, count in [
            (lambda: db.scene("strait").plot("TOW", "FERRY"), 3),
            (lambda: db.scene("strait").plot("RESERVE", "FERRY"), 3),
            (conflict.plot, 2),
        ]:
            read.clear()
            assert draw().axes
            assert len(read) == count
