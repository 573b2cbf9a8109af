"""A mission's own transactions can be prepared, and its writes never fail because of conflictdb."""

import subprocess
import sys
import time
from collections.abc import Iterator

import psycopg
import pytest
from own_server import OwnServer, own_server
from patience import WAIT_S

from conflictdb import Area, LockTimeout, connect

AREA = "'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))'"
WRITES = {
    "area": f"SELECT conflictdb.put_area('s', 'B', {AREA})",
    "track": """SELECT conflictdb.put_track('s', 'T', 'SRID=4326;LINESTRING M (0 0.5 1772323200, 2 0.5 1772409600)',
                                            conflictdb.rectangle_outline(9, 9, 5, 5))""",
    "area, plainly": "UPDATE conflictdb.area SET floor_m = 1",
    "removal": "DELETE FROM conflictdb.area WHERE key = '1'",
    "settings": "UPDATE conflictdb.scene SET tolerance_m = 3",
    "attached table": f"INSERT INTO mission.ops VALUES (2, {AREA})",
    "attached table, all": "DELETE FROM mission.ops",
    "attached table, truncated": "TRUNCATE mission.ops",
    "request": "SELECT conflictdb.request_detection('s', true)",
    "probe": f"SELECT conflictdb.request_probe('s', {AREA})",
    "admission": """SELECT conflictdb.admit('s', '[{"key": "C", "footprint": "POLYGON((0 0, 1 0, 1 1, 0 0))"}]')""",
    "acknowledgement": "SELECT conflictdb.acknowledge('s', '1', 'A', 'seen')",
}


@pytest.fixture(scope="module")
def prepared() -> Iterator[OwnServer]:
    """Return a server that allows prepared transactions, with a scene and an attached table."""
    with own_server(max_prepared_transactions="5") as server:
        with psycopg.connect(server.dsn) as conn:
            conn.execute("CREATE SCHEMA mission; CREATE TABLE mission.ops (id integer, shape geometry)")
            conn.execute(f"INSERT INTO mission.ops VALUES (1, {AREA})".encode())
            conn.execute(f"SELECT conflictdb.create_scene('s'), conflictdb.put_area('s', 'A', {AREA})".encode())
        with connect(server.dsn) as db:
            db.scene("s").attach("area", "mission.ops", {"key": "id", "footprint": "shape"})
            assert db.scene("s").detect().conflicts == 1
        yield server


@pytest.mark.parametrize("write", WRITES)
def test_whatever_a_transaction_writes_it_can_be_prepared(prepared: OwnServer, write: str) -> None:
    with psycopg.connect(prepared.dsn) as conn:
        conn.tpc_begin(conn.xid(1, "mission", write))
        conn.execute(WRITES[write].encode())
        conn.tpc_prepare()
        conn.tpc_rollback()


def test_a_prepared_admission_keeps_others_waiting(prepared: OwnServer) -> None:
    """Until it is committed; then they see what it put."""
    far = Area("far", [(40.0, 0.0), (41.0, 0.0), (41.0, 1.0), (40.0, 1.0)])
    plan = '[{"key": "first", "footprint": "POLYGON((40 0, 41 0, 41 1, 40 0))"}]'
    with connect(prepared.dsn) as db, psycopg.connect(prepared.dsn) as conn:
        conn.tpc_begin(conn.xid(1, "mission", "admission"))
        assert conn.execute("SELECT admitted FROM conflictdb.admit('s', %s)", [plan]).fetchone() == (True,)
        conn.tpc_prepare()
        with pytest.raises(LockTimeout, match="or is a prepared transaction"):
            db.scene("s").admit(far, lock_timeout_s=0.1)
        conn.tpc_commit()
        assert [one.b_key for one in db.scene("s").admit(far).conflicts] == ["first"]
        db.scene("s").delete_objects("first")


def test_workers_find_changes_that_nobody_told_them_of(prepared: OwnServer) -> None:
    """Also those of a transaction that was prepared long before it is committed."""
    last = "SELECT max(run_id) FROM conflictdb.run"
    with connect(prepared.dsn) as db, psycopg.connect(prepared.dsn, autocommit=True) as other:
        db.scene("s").detect()
        before = other.execute(last.encode()).fetchone()
        with psycopg.connect(prepared.dsn) as conn:
            conn.tpc_begin(conn.xid(1, "mission", "later"))
            conn.execute(f"INSERT INTO mission.ops VALUES (3, {AREA})".encode())
            conn.tpc_prepare()
            worker = subprocess.Popen([sys.executable, "-m", "conflictdb", "--dsn", prepared.dsn, "worker"])
            try:
                time.sleep(2.0)
                assert other.execute(last.encode()).fetchone() == before
                conn.tpc_commit()
                committed_s = time.monotonic()
                while other.execute(last.encode()).fetchone() == before:
                    assert time.monotonic() - committed_s < WAIT_S, "nobody looked"
                    time.sleep(0.02)
            finally:
                worker.kill()
                worker.wait()
        assert {(c.a_key, c.b_key) for c in db.scene("s").conflicts()} == {("1", "3"), ("1", "A"), ("3", "A")}
