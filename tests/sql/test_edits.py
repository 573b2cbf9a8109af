"""The audit: who edited what, append-only, sealed in batches that nobody can change unnoticed."""

import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import psycopg
import pytest
from commands import Run
from databases import TestServer, client_programs
from measured import backend_clock, server_pid
from patience import until
from psycopg import conninfo, pq

Conn = psycopg.Connection[Any]
SQUARE = "SRID=4326;POLYGON((0 0, 0 1, 1 1, 1 0, 0 0))"
TRACK = "ST_GeomFromEWKT('SRID=4326;LINESTRINGM(0 0 0, 1 1 6000, 2 2 12000)')"
POINT = "ST_MakePolygon(ST_GeomFromText('LINESTRING(0 0, 0 0, 0 0, 0 0)'))"


def edits(conn: Conn, columns: str = "kind, action, key") -> list[Any]:
    return conn.execute(f"SELECT {columns} FROM conflictdb.edits ORDER BY edit, key".encode()).fetchall()


def put(conn: Conn, key: str, scene: str = "s") -> None:
    conn.execute("SELECT conflictdb.put_area(%s, %s, %s)", [scene, key, SQUARE])


def verified(conn: Conn) -> tuple[Any, ...]:
    """Return batches, edits, unsealed, first_wrong, reason."""
    row = conn.execute("SELECT batches, edits, unsealed, first_wrong, reason FROM conflictdb.verify_edits()").fetchone()
    assert row is not None
    return row


def sealed(conn: Conn) -> int:
    row = conn.execute("SELECT conflictdb.seal_edits()").fetchone()
    assert row is not None
    return int(row[0])


@pytest.fixture
def open_conn(dsn: str) -> Iterator[Callable[..., Conn]]:
    """Return a function that opens a connection, in autocommit."""
    opened: list[Conn] = []

    def connect(**options: Any) -> Conn:
        opened.append(psycopg.connect(dsn, autocommit=True, **options))
        return opened[-1]

    yield connect
    for one in opened:
        one.close()


@pytest.fixture
def admin(open_conn: Callable[..., Conn]) -> Conn:
    conn = open_conn()
    conn.execute("SELECT conflictdb.create_scene('s')")
    return conn


@pytest.fixture
def roles(dsn: str) -> Iterator[dict[str, str]]:
    """Return a role that logs in for each group."""
    names = {group: f"audit_{group}_{os.getpid()}" for group in ("reader", "editor", "worker")}
    with psycopg.connect(dsn, autocommit=True) as conn:
        for group, name in names.items():
            conn.execute(f"CREATE ROLE {name} LOGIN IN ROLE conflictdb_{group}".encode())
        try:
            yield names
        finally:
            for name in names.values():
                conn.execute(f"DROP OWNED BY {name}; DROP ROLE {name}".encode())


def test_each_edit_is_noted(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    put(conn, "A")
    put(conn, "A")  # as it is: no edit
    conn.execute(f"SELECT conflictdb.put_track('s', 'T', {TRACK}, {POINT})".encode())
    conn.execute("UPDATE conflictdb.area SET name = 'Alpha'")
    conn.execute("UPDATE conflictdb.track SET floor_m = 7")
    conn.execute("SELECT conflictdb.rename_object('s', 'A', 'B')")
    conn.execute("SELECT conflictdb.put_rule('s', 'ferry', 'area', 500)")
    conn.execute("SELECT conflictdb.remove_rule('s', 'ferry', 'area')")
    conn.execute("SELECT conflictdb.rename_scene('s', 'z')")
    conn.execute("UPDATE conflictdb.scene SET separation_m = 9")
    conn.execute("SELECT conflictdb.remove_object('z', 'B')")
    conn.execute("SELECT conflictdb.remove_scene('z')")
    assert edits(conn, "scene, kind, action, key, former_key") == [
        ("s", "scene", "put", "s", None),
        ("s", "area", "put", "A", None),
        ("s", "track", "put", "T", None),
        ("s", "area", "change", "A", None),
        ("s", "track", "change", "T", None),
        ("s", "area", "rename", "B", "A"),
        ("s", "rule", "put", "ferry / area", None),
        ("s", "rule", "delete", "ferry / area", None),
        ("z", "scene", "rename", "z", "s"),
        ("z", "scene", "change", "z", None),
        ("z", "area", "delete", "B", None),
        ("z", "scene", "delete", "z", None),
        ("z", "track", "delete", "T", None),
    ]


def test_a_changed_rule_leaves_no_former_rule_unmentioned(conn: Conn) -> None:
    """Whether its sides change, or its scene; a rule written as it is is no edit."""
    conn.execute("SELECT conflictdb.create_scene('s'), conflictdb.create_scene('z')")
    conn.execute("SELECT conflictdb.put_rule('s', 'ferry', 'area', 500)")
    conn.execute("UPDATE conflictdb.rule SET a_class = a_class")
    conn.execute("UPDATE conflictdb.rule SET separation_m = 400")
    conn.execute("UPDATE conflictdb.rule SET a_class = 'tug'")
    conn.execute(
        "UPDATE conflictdb.rule SET b_class = 'pier', "
        "scene_id = (SELECT s.scene_id FROM conflictdb.scene s WHERE s.name = 'z')"
    )
    found = edits(conn, "scene, action, key, former_key")[2:]
    assert found[:3] == [
        ("s", "put", "ferry / area", None),
        ("s", "change", "ferry / area", None),
        ("s", "rename", "tug / area", "ferry / area"),
    ]
    assert sorted(found[3:]) == [("s", "delete", "tug / area", None), ("z", "put", "tug / pier", None)]


def test_an_edit_names_its_session(admin: Conn, roles: dict[str, str], open_conn: Callable[..., Conn]) -> None:
    """Also one that acts as another role, as poolers do."""
    session = open_conn(user=roles["editor"], application_name="bridge")
    put(session, "A")
    admin.execute(f"SET ROLE {roles['worker']}".encode())
    put(admin, "B")
    admin.execute("RESET ROLE")
    assert edits(admin, "key, role, login = session_user, application, pid")[1:] == [
        ("A", roles["editor"], False, "bridge", session.info.backend_pid),
        ("B", roles["worker"], True, "", admin.info.backend_pid),
    ]


def test_a_load_is_one_row_per_statement(conn: Conn) -> None:
    """Of at most 10,000 keys."""
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute(
        "INSERT INTO conflictdb.area (scene_id, key, footprint) SELECT s.scene_id, n::text, ST_Multi(%s) "
        "FROM conflictdb.scene s, generate_series(1, 25000) n",
        [SQUARE],
    )
    rows = "SELECT max(cardinality(keys)), count(*) FROM conflictdb.edit WHERE kind = 'area'"
    assert conn.execute(rows.encode()).fetchone() == (10_000, 3)
    found = "SELECT count(*), count(DISTINCT key) FROM conflictdb.edits WHERE kind = 'area'"
    assert conn.execute(found.encode()).fetchone() == (25_000, 25_000)


def test_an_expanded_schedule_is_no_edit(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    put(conn, "A")
    conn.execute("""UPDATE conflictdb.area SET schedule = '{"days": "daily"}'""")
    before = edits(conn)
    conn.execute("UPDATE conflictdb.area SET activations = '{[2026-03-01, 2026-03-02)}'")
    conn.execute("UPDATE conflictdb.scene SET expanded = '[2026-03-01, 2026-03-02)'")
    assert edits(conn) == before


def test_branches_and_merges(conn: Conn) -> None:
    """Edits of a branch are noted as of the branch; a merge edits the parent."""
    conn.execute("SELECT conflictdb.create_scene('s')")
    for key in "AB":
        put(conn, key)
    conn.execute("SELECT conflictdb.create_branch('s', 'b')")
    conn.execute("SELECT conflictdb.remove_object('b', 'A')")
    put(conn, "C", "b")
    conn.execute("SELECT conflictdb.merge_branch('b')")
    found = [row for row in edits(conn, "scene, kind, action, key") if row[1] == "area"]
    assert found[2:4] == [("b", "area", "delete", "A"), ("b", "area", "put", "C")]
    assert {("s", "area", "delete", "A"), ("s", "area", "put", "C")} <= set(found[4:])


def test_two_editors_of_one_scene_do_not_wait(
    admin: Conn, roles: dict[str, str], open_conn: Callable[..., Conn]
) -> None:
    first, second = open_conn(user=roles["editor"]), open_conn(user=roles["editor"])
    second.execute("SET lock_timeout = '1ms'")
    with first.transaction():
        put(first, "A")
        put(second, "B")
        assert [key for _, _, key in edits(admin)] == ["s", "B"]
    assert [key for _, _, key in edits(admin)] == ["s", "A", "B"]


@pytest.mark.parametrize("group", ["reader", "editor", "worker"])
def test_nobody_else_changes_edits(
    admin: Conn, roles: dict[str, str], open_conn: Callable[..., Conn], group: str
) -> None:
    put(admin, "A")
    sealed(admin)
    session = open_conn(user=roles[group])
    assert session.execute("SELECT count(*) FROM conflictdb.edit").fetchone() == (2,)
    for attempt in (
        "INSERT INTO conflictdb.edit (scene_id, kind, action, keys) VALUES (1, 'area', 'put', '{A}')",
        (
            "INSERT INTO conflictdb.edit (edit_id, scene_id, kind, action, keys) OVERRIDING SYSTEM VALUE "
            "VALUES (9, 1, 'area', 'put', '{A}')"
        ),
        "UPDATE conflictdb.edit SET role = 'somebody'",
        "DELETE FROM conflictdb.edit",
        "TRUNCATE conflictdb.edit",
        "SELECT nextval('conflictdb.edit_edit_id_seq')",
        "SELECT setval('conflictdb.edit_edit_id_seq', 1)",
        "INSERT INTO conflictdb.edit_seal SELECT * FROM conflictdb.edit_seal",
        "UPDATE conflictdb.edit_seal SET digest = ''",
        "DELETE FROM conflictdb.edit_seal",
        "TRUNCATE conflictdb.edit_seal",
        "ALTER TABLE conflictdb.area DISABLE TRIGGER area_edits_inserted",
        "SET session_replication_role = replica",
        "SELECT conflictdb.prune_edits('0')",
        (
            "CREATE TRIGGER mine AFTER INSERT ON conflictdb.edit FOR EACH ROW "
            "EXECUTE FUNCTION conflictdb_internal._note_edits()"
        ),
    ):
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            session.execute(attempt.encode())
    # Only the owner's restores bring their own edits.
    session.execute("SET row_security = off")
    if group != "reader":
        put(session, "B")
        assert edits(admin)[-1] == ("area", "put", "B")


def test_protected_edits_are_seen_with_their_scene(
    admin: Conn, roles: dict[str, str], open_conn: Callable[..., Conn]
) -> None:
    admin.execute("SELECT conflictdb.protect_scenes()")
    hers = open_conn(user=roles["editor"])
    hers.execute("SELECT conflictdb.create_scene('hers')")
    put(hers, "A", "hers")
    reader = open_conn(user=roles["reader"])
    assert edits(hers) == [("scene", "put", "hers"), ("area", "put", "A")]
    assert edits(reader) == []
    hers.execute("SELECT conflictdb.share_scene('hers', %s)", [roles["reader"]])
    assert edits(reader) == edits(hers)
    hers.execute("SELECT conflictdb.remove_scene('hers')")
    assert edits(reader) == edits(hers) == []
    for who in (admin, open_conn(user=roles["worker"])):
        assert set(edits(who)[-2:]) == {("area", "delete", "A"), ("scene", "delete", "hers")}


def test_seals_hold_every_edit(admin: Conn) -> None:
    put(admin, "A")
    assert verified(admin) == (0, 0, 2, None, None)
    assert sealed(admin) == 2
    put(admin, "B")
    assert verified(admin) == (1, 2, 1, None, None)
    assert (sealed(admin), sealed(admin)) == (1, 0)
    assert verified(admin) == (2, 3, 0, None, None)


def test_large_backlogs_are_sealed_in_batches(admin: Conn) -> None:
    put(admin, "A")
    for number in range(5):
        admin.execute("UPDATE conflictdb.area SET name = %s", [str(number)])
    counts = [admin.execute("SELECT conflictdb_internal._seal_batch(2)").fetchone() for _ in range(5)]
    assert counts == [(2,), (2,), (2,), (1,), (0,)]
    assert verified(admin) == (4, 7, 0, None, None)


def settled(conn: Conn) -> int:
    row = conn.execute("SELECT max(settled_id) FROM conflictdb.edit_seal").fetchone()
    assert row is not None
    return int(row[0])


def wait_until_settled(conn: Conn, edit: int) -> None:
    """Edit and seal until a number is settled: a transaction of another database that just ended delays it."""

    def reached() -> bool:
        put(conn, f"wait {time.monotonic_ns()}")
        assert sealed(conn) > 0
        return settled(conn) >= edit

    until(reached)


def test_transactions_without_edits_delay_nothing(admin: Conn, dsn: str, open_conn: Callable[..., Conn]) -> None:
    """Those of other databases, and those of this one that write other tables."""
    elsewhere = psycopg.connect(conninfo.make_conninfo(dsn, dbname="postgres"))
    idle = open_conn()
    with elsewhere, idle.transaction():
        for one in (elsewhere, idle):
            one.execute("SELECT pg_current_xact_id()")
        wait_until_settled(admin, 3)
        assert elsewhere.info.transaction_status == idle.info.transaction_status == pq.TransactionStatus.INTRANS
    elsewhere.close()


@pytest.mark.parametrize("commits", [True, False])
def test_an_open_transaction_is_not_skipped(admin: Conn, open_conn: Callable[..., Conn], commits: bool) -> None:
    """Its edit has a lower number than edits that are committed and sealed before."""
    sealed(admin)
    late, other = open_conn(), open_conn()
    with late.transaction(force_rollback=not commits):
        put(late, "late")
        for key in "ABC":
            put(other, key)
            assert sealed(admin) == 1
            assert verified(admin)[2:] == (0, None, None)
        # Numbers from that of the open transaction on are looked at again.
        assert settled(admin) < 2
    assert sealed(admin) == (1 if commits else 0)
    for key in "DEF":
        put(other, key)
        assert sealed(admin) == 1
    numbers = admin.execute("SELECT edit_id FROM conflictdb.edit ORDER BY 1").fetchall()
    assert [n for (n,) in numbers] == [1, *([2] if commits else []), *range(3, 9)]
    assert verified(admin)[1:] == (len(numbers), 0, None, None)
    wait_until_settled(admin, 8)


def test_a_backlog_is_sealed_in_the_transaction_of_its_edits(admin: Conn, open_conn: Callable[..., Conn]) -> None:
    """A transaction that has a number already cannot know which numbers younger ones were given."""
    sealed(admin)
    late = open_conn()
    with admin.transaction():
        put(admin, "A")
        with late.transaction():
            put(late, "B")
            assert sealed(admin) == 1
            put(admin, "C")
            assert sealed(admin) == 1
            assert settled(admin) < 3
    assert sealed(admin) == 1
    assert verified(admin)[1:] == (4, 0, None, None)


@pytest.mark.parametrize(
    ("attempt", "batch", "reason"),
    [
        ("UPDATE conflictdb.edit SET role = 'somebody' WHERE keys = '{B}'", 2, "an edit, or the seal, differs"),
        ("UPDATE conflictdb.edit SET keys = '{X}' WHERE keys = '{A}'", 1, "an edit, or the seal, differs"),
        ("UPDATE conflictdb.edit SET edited_at = edited_at - interval '1 us' WHERE keys = '{C}'", 3, "an edit, or"),
        ("DELETE FROM conflictdb.edit WHERE keys = '{B}'", 2, "it had 1 edits, and has 0"),
        ("DELETE FROM conflictdb.edit_seal WHERE seal_id = 2", 3, "batch 2 is missing"),
        ("UPDATE conflictdb.edit_seal SET digest = sha256('') WHERE seal_id = 2", 2, "an edit, or the seal, differs"),
        (
            (
                "INSERT INTO conflictdb.edit (edit_id, scene_id, kind, action, keys) OVERRIDING SYSTEM VALUE "
                "VALUES (-1, 1, 'area', 'put', '{Z}')"
            ),
            0,
            "an edit was added behind it",
        ),
    ],
)
def test_verification_names_the_first_batch_that_differs(admin: Conn, attempt: str, batch: int, reason: str) -> None:
    for key in "ABCD":
        put(admin, key)
        sealed(admin)
    assert verified(admin)[3] is None
    admin.execute(attempt.encode())
    *_, first_wrong, said = verified(admin)
    assert first_wrong == batch
    assert reason in said


def test_pruning_keeps_the_last_seal_as_anchor(admin: Conn) -> None:
    for key in "ABC":
        put(admin, key)
        sealed(admin)
    row = admin.execute("SELECT sealed_at FROM conflictdb.edit_seal WHERE seal_id = 2").fetchone()
    assert row is not None
    assert admin.execute("SELECT conflictdb.prune_edits(now() - %s::timestamptz)", row).fetchone() == (3,)
    anchor = admin.execute("SELECT anchor, batches, edits, unsealed, first_wrong FROM conflictdb.verify_edits()")
    assert anchor.fetchone() == (2, 1, 1, 1, None)
    assert sealed(admin) == 1
    assert edits(admin) == [("area", "put", "C"), ("audit", "delete", "batch 2")]
    assert admin.execute("SELECT conflictdb.prune_edits('0')").fetchone() == (2,)
    assert verified(admin) == (0, 0, 1, None, None)
    put(admin, "D")
    sealed(admin)
    assert verified(admin) == (1, 2, 0, None, None)
    with pytest.raises(psycopg.Error, match="must be 0 or longer"):
        admin.execute("SELECT conflictdb.prune_edits('-1 s')")


def test_edits_pruned_during_a_verification_are_not_missing(
    admin: Conn, open_conn: Callable[..., Conn], roles: dict[str, str]
) -> None:
    for key in "ABC":
        put(admin, key)
        sealed(admin)
    auditor = open_conn(user=roles["worker"])
    found: list[tuple[Any, ...]] = []
    verifying = threading.Thread(target=lambda: found.append(verified(auditor)))
    waits = "SELECT cardinality(pg_blocking_pids(%s))"
    with admin.transaction():
        admin.execute("LOCK TABLE conflictdb.edit IN ACCESS EXCLUSIVE MODE")
        verifying.start()
        # It has read the seals, and waits for the edits of the first batch.
        until(lambda: admin.execute(waits.encode(), [auditor.info.backend_pid]).fetchone() != (0,))
        assert admin.execute("SELECT conflictdb.prune_edits('0')").fetchone() == (4,)
    verifying.join()
    assert found == [(3, 4, 0, None, None)]


def test_gaps_between_batches_do_not_slow_verification(conn: Conn) -> None:
    """Transactions that are rolled back leave gaps in the numbers, perhaps one a minute for years."""
    batches = (
        "INSERT INTO conflictdb.edit_seal SELECT n, int8multirange(int8range(%s * n, %s * n + 1)), 1, '', now(), 0, "
        "'3', 0 FROM generate_series(0, 9999) n"
    )
    clock = backend_clock(conn) if server_pid(conn) else time.monotonic
    took_s = []
    for step in (1, 2):
        conn.execute("DELETE FROM conflictdb.edit_seal")
        conn.execute(batches.encode(), [step, step])
        start = clock()
        assert verified(conn)[3:] == (1, "it had 1 edits, and has 0")
        took_s.append(clock() - start)
    # A hundred times as long if the numbers were added batch by batch.
    assert took_s[1] < 10 * took_s[0] + 1


def test_seals_of_another_server_go_on(admin: Conn) -> None:
    """A restored database has transaction ids of the server that made the dump, perhaps from the future of this one."""
    for key in "AB":
        put(admin, key)
        sealed(admin)
    admin.execute("UPDATE conflictdb.edit_seal SET next_transaction = '900000000000' WHERE seal_id > 0")
    for key in "CDE":
        put(admin, key)
        assert sealed(admin) == 1
    assert verified(admin)[1:] == (6, 0, None, None)
    wait_until_settled(admin, 6)


def test_one_session_seals_at_a_time(admin: Conn, open_conn: Callable[..., Conn]) -> None:
    other = open_conn()
    put(admin, "A")
    with other.transaction():
        assert sealed(other) == 2
        assert sealed(admin) == 0
    assert verified(admin) == (1, 2, 0, None, None)


def test_editors_and_a_sealing_worker_together(admin: Conn, open_conn: Callable[..., Conn]) -> None:
    """Every edit is in exactly one batch, whatever is committed, or rolled back, meanwhile."""

    def edit(conn: Conn, name: str) -> None:
        for number in range(30):
            with conn.transaction(force_rollback=number % 5 == 0):
                put(conn, f"{name} {number}")

    editors = [threading.Thread(target=edit, args=(open_conn(), name)) for name in "abc"]
    for one in editors:
        one.start()
    while any(one.is_alive() for one in editors):
        sealed(admin)
        assert verified(admin)[3] is None
    sealed(admin)
    assert verified(admin)[1:] == (1 + 3 * 24, 0, None, None)


def test_the_owner_restores_edits_as_they_were(admin: Conn, dsn: str) -> None:
    """As the data of a dump, into tables with triggers."""
    put(admin, "A")
    sealed(admin)
    admin.execute("CREATE TABLE a AS TABLE conflictdb.area")
    before = edits(admin, "*")
    with psycopg.connect(conninfo.make_conninfo(dsn, options="-c row_security=off"), autocommit=True) as restoring:
        restoring.execute("DELETE FROM conflictdb.area")
        restoring.execute("INSERT INTO conflictdb.area OVERRIDING SYSTEM VALUE TABLE a")
    assert edits(admin, "*") == before


def test_the_command_verifies(run: Run, dsn: str) -> None:
    """Workers have sealed; the last digest can be kept elsewhere."""
    assert run("admin", "verify-audit").out == "as sealed: 0 edits in 0 batches\nnot sealed yet: 0 edits\n"
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute("SELECT conflictdb.create_scene('s')")
        put(conn, "A")
        assert run("worker", "--once").code == 0
        put(conn, "B")
        row = conn.execute("SELECT encode(digest, 'hex') FROM conflictdb.edit_seal WHERE seal_id = 1").fetchone()
        assert row is not None
        found = run("admin", "verify-audit")
        lines = ["as sealed: 2 edits in 1 batch", "not sealed yet: 1 edit", f"last batch: 1, SHA-256 {row[0]}"]
        assert (found.code, found.out.splitlines()) == (0, lines)
        conn.execute("UPDATE conflictdb.edit SET role = 'somebody' WHERE keys = '{A}'")
        found = run("admin", "verify-audit")
        assert (found.code, found.out.splitlines()[:2]) == (
            1,
            [
                "batch 1 is not as it was sealed: an edit, or the seal, differs",
                "as sealed before it: 0 edits in 0 batches",
            ],
        )
        conn.execute(
            "UPDATE conflictdb.edit_seal SET digest = (conflictdb_internal._digest_of_batch(sha256(''), "
            "edit_ids)).digest WHERE seal_id = 1"
        )
        run("worker", "--once")
        conn.execute("SELECT conflictdb.prune_edits('0')")
        assert "pruned: the edits of batches up to 2" in run("admin", "verify-audit").out


@pytest.mark.parametrize("kind", ["whole", "data"])
def test_a_dump_brings_its_edits(admin: Conn, dsn: str, _server: TestServer, template: str, kind: str) -> None:  # noqa: PT019
    """Into an empty database, or as data alone into one with the schema: the same edits, seals and numbers go on."""
    put(admin, "A")
    sealed(admin)
    admin.execute(f"SELECT conflictdb.put_track('s', 'T', {TRACK}, {POINT})".encode())
    admin.execute("SELECT conflictdb.set_limit('max_vertices', 4), conflictdb.set_limit('max_waypoints', 2)")
    programs, environ = client_programs(admin)
    name = f"{admin.info.dbname}_restored"
    target = _server.clone("template0" if kind == "whole" else template, name)
    try:
        alone = ["--data-only", "--exclude-table-data=conflictdb.alembic_version"] if kind == "data" else []
        archive = subprocess.run(
            [programs / "pg_dump", "-Fc", "-d", dsn, *alone], env=environ, check=True, stdout=subprocess.PIPE
        ).stdout
        subprocess.run([programs / "pg_restore", "-e", "-d", target], env=environ, check=True, input=archive)
        with psycopg.connect(target, autocommit=True) as conn:
            assert edits(conn, "*") == edits(admin, "*")
            assert verified(conn) == verified(admin) == (1, 2, 1, None, None)
            assert limits_of(conn) == limits_of(admin)
            conn.execute("SELECT conflictdb.set_limit('max_vertices', NULL)")
            put(conn, "B")
            assert sealed(conn) == 2
            assert verified(conn)[1:] == (4, 0, None, None)
    finally:
        _server.drop(name)


def limits_of(conn: Conn) -> list[Any]:
    return conn.execute("SELECT name, value FROM conflictdb.limits ORDER BY name").fetchall()
