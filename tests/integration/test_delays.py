"""Delays of a stored scene: those in memory, whether it was detected or not."""

from dataclasses import replace

import pytest
from layouts import GROWING_CIRCLES, HARBOUR, LOW_LATITUDE, SEAM, Workload
from mixed_scenes import plain_scene

from conflictdb import InvalidInput, Scene, Track, connect, delays, speeds, store
from conflictdb.model.rules import Rule


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, HARBOUR, GROWING_CIRCLES], ids=lambda workload: workload.name)
def test_a_stored_scene_has_the_delays_of_its_objects(dsn: str, workload: Workload) -> None:
    """For one track, a current scene reads only the objects that the track may meet: the answer is the same."""
    scene, areas, tracks = plain_scene(workload, 4, 10, 12, separation_m=500.0)
    within_s = 600.0 if workload is HARBOUR else 7200.0
    with connect(dsn) as db:
        store.replace_scene(db.connection, scene, areas, tracks, merge=False)
        stored = db.scene(scene.name)
        expected = delays(tracks, areas, stored.settings(), within_s=within_s)
        assert any(one.forbidden for one in expected)
        for _ in ("marked", "current"):
            assert stored.delays(within_s=within_s) == expected
            assert [stored.delays(one.key, within_s)[0] for one in expected] == expected
            far_m = 2000.0 if workload is HARBOUR else 100_000.0
            for one in delays(tracks, areas, stored.settings(), within_s=0.0, clear_within_m=far_m):
                [alone] = stored.delays(one.key, 0.0, clear_within_m=far_m)
                assert alone.clear_by_m == pytest.approx(one.clear_by_m, abs=0.01)
            stored.detect()
        moved = replace(tracks[0], times_us=tracks[0].times_us + 60_000_000)
        store.replace_scene(db.connection, scene, [], [moved], merge=True)
        again = delays([moved, *tracks[1:]], areas, stored.settings(), within_s=within_s)
        assert [stored.delays(one.key, within_s)[0] for one in again] == again


def test_a_stored_scene_has_the_speeds_and_waits_of_its_objects(dsn: str) -> None:
    """For one track, a current scene reads only the objects that the track may meet: the answer is the same."""
    scene, areas, tracks = plain_scene(SEAM, 4, 10, 12, separation_m=500.0)
    key = tracks[0].key
    with connect(dsn) as db:
        store.replace_scene(db.connection, scene, areas, tracks, merge=False)
        stored = db.scene(scene.name)
        settings = stored.settings()
        for _ in ("marked", "current"):
            assert stored.speeds() == speeds(tracks, areas, settings)
            for one in tracks:
                assert stored.speeds(one.key, 0.7, 1.5) == speeds(tracks, areas, settings, one.key, 0.7, 1.5)
            assert stored.speeds(key, leg=1) == speeds(tracks, areas, settings, key, leg=1)
            assert stored.delays(key, waypoint=1) == delays(tracks, areas, settings, key, waypoint=1)
            stored.detect()
        with pytest.raises(InvalidInput, match="'nobody' is not known"):
            stored.speeds("nobody")
        with pytest.raises(InvalidInput, match="slowest, fastest"):
            stored.speeds(slowest=0.0)
        with pytest.raises(InvalidInput, match="nowhere"):
            db.scene("nowhere").speeds()


def test_unknown_names_and_horizons_are_refused(dsn: str) -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 4, 2, 2)
    with connect(dsn) as db:
        store.replace_scene(db.connection, scene, areas, tracks, merge=False)
        stored = db.scene(scene.name)
        for _ in ("marked", "current"):
            with pytest.raises(InvalidInput, match="is not known"):
                stored.delays("nobody")
            stored.detect()
        with pytest.raises(InvalidInput, match="within_s"):
            stored.delays(within_s=-1.0)
        with pytest.raises(InvalidInput, match="clear_within_m"):
            stored.delays(clear_within_m=-1.0)
        with pytest.raises(InvalidInput, match="nowhere"):
            db.scene("nowhere").delays()


def test_margins_are_read_as_far_as_the_largest_separation(dsn: str) -> None:
    """The ship meets nobody; a tanker 3.3 km away, whose separation is 3 km, is the nearest to a conflict.

    A wanted margin is on top of the separation, and the distance on top of both.
    """
    at_us = [1_780_000_000_000_000, 1_780_010_000_000_000]
    ship = Track("ship", [(0.0, 0.0), (1.0, 0.0)], at_us, [(0.0, 0.0)])
    tanker = Track("tanker", [(0.0, 0.03), (1.0, 0.03)], at_us, [(0.0, 0.0)], object_class="tanker")
    rules = (Rule("tanker", None, separation_m=3000.0),)
    by_class = Scene("by class", separation_m=100.0, rules=rules), 1000.0, 0.0, 317.2
    wanted = Scene("wanted", separation_m=100.0), 500.0, 3000.0, 217.2
    with connect(dsn) as db:
        for scene, within_m, margin_m, clear_m in (by_class, wanted):
            given = {"clear_within_m": within_m, "margin_m": margin_m}
            [expected] = delays([ship, tanker], [], scene, "ship", 0.0, **given)  # type: ignore[arg-type]
            assert expected.clear_by_m == pytest.approx(clear_m, abs=0.1)
            store.replace_scene(db.connection, scene, [], [ship, tanker], merge=False)
            stored = db.scene(scene.name)
            stored.detect()
            assert stored.delays("ship", 0.0, **given) == [expected]  # type: ignore[arg-type]
