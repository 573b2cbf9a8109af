"""Routes of files say how their legs run; a scene of great circles does not take rhumb lines for them."""

from pathlib import Path
from typing import Any

import psycopg
import pytest
import shapely
from route_files import rtz, s421, waypoint

import conflictdb
from conflictdb.cli import main
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import Motion, Scene

SCHEDULE = (
    '<schedule id="1"><manual><scheduleElement waypointId="1" etd="2026-03-01T06:00:00Z"/>'
    '<scheduleElement waypointId="2" eta="2026-03-01T18:00:00Z"/></manual></schedule>'
)


def route(kind: str, lon: float = 9.0) -> str:
    return rtz(waypoint(1, 4, 57) + waypoint(2, lon, 58, f'geometryType="{kind}"'), SCHEDULE)


def test_rhumb_legs_are_refused_by_name_in_a_scene_of_great_circles(
    conn: psycopg.Connection[Any], dsn: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with conflictdb.connect(conn) as db:
        area = conflictdb.Area("A", shapely.box(3, 56, 10, 59))
        db.scene("circles").put(area, Scene("circles", motion=Motion.GREAT_CIRCLE))
        db.scene("rhumb").put(area, Scene("rhumb"))
        for name, text in (("r.rtz", route("Loxodrome")), ("s.s421", s421(kind="1"))):
            file = tmp_path / name
            file.write_text(text)
            with pytest.raises(InvalidInput, match=rf"{name}: track 'R': legs: are rhumb lines, .* motion rhumb"):
                db.load_files([file], "circles")
            with pytest.raises(InvalidInput, match=r"holds no area and no track[^\n]*\n.*track 'R': legs: are rhumb"):
                db.load_files([file], "circles", skip_invalid=True)
            [track] = conflictdb.read(file).tracks
            for refuses in (
                lambda track=track: conflictdb.solve([track], [area], Scene("s", motion=Motion.GREAT_CIRCLE)),
                lambda track=track: db.scene("circles").put(track),
                lambda track=track: db.scene("circles").admit(track),
                lambda track=track: db.scene("circles").probe(track),
                lambda track=track: conflictdb.Index(Scene("s", motion=Motion.GREAT_CIRCLE)).put(track),
            ):
                with pytest.raises(InvalidInput, match=r"track 'R': legs: are rhumb lines, .* motion rhumb"):
                    refuses()
            db.load_files([file], "rhumb")
            assert main(["--dsn", dsn, "probe", str(file), "--scene", "circles"]) == 4
            assert "track 'R': legs: are rhumb lines" in capsys.readouterr().err
        # Shortest lines, and meridians, which are both, are read; an export says how the legs run.
        for text in (route("Orthodrome"), route("Loxodrome", 4.0)):
            (tmp_path / "r.rtz").write_text(text)
            db.load_files([tmp_path / "r.rtz"], "circles")
            db.scene("circles").export(tmp_path / "again.rtz", keys=["R"])
            assert 'geometryType="Orthodrome"' in (tmp_path / "again.rtz").read_text()
            db.load_files([tmp_path / "again.rtz"], "circles")
