"""The rule of a pair of pieces, in SQL, in C, in C as WebAssembly, and as the oracle has it, of the same 10,000 pairs.

Numbers are whole, and few: ends coincide often, and an index that rounds boxes changes none.
"""

import base64
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any, Final

import numpy as np
import psycopg
import pytest
import shapely

from conflictdb.arrays.column_numbers import numbers_of_words
from conflictdb.core.separations import NEVER, Separations
from conflictdb.kernel.boxes import RowBoxes, may_meet
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Scene
from conflictdb.model.rules import Rule

Conn = psycopg.Connection[Any]

PAIRS: Final = 10_000
PAGE: Final = Path(__file__).resolve().parents[2] / "conflictdb" / "map" / "page"
CLASSES: Final = (None, "ferry", "drone", "tug")
OWNERS: Final = (None, None, None, "us", "them")
RULES: Final = (
    Rule("ferry", "ferry", allowed=True), Rule("ferry", "drone", time_s=2.0), Rule("drone", "track", allowed=True),
    Rule("tug", None, allowed=True), Rule("tug", "ferry", separation_m=5.0),
)  # fmt: skip
Piece = dict[str, Any]


def thrown(rng: np.random.Generator) -> Piece:
    """Return a random piece: a box, a span, heights, a turn, a kind, a class and an owner."""
    x, y, start = (int(one) for one in rng.integers(0, 6, 3))
    floor, ceiling = sorted(rng.choice(7, 2, replace=False).tolist())
    return {
        "box": [x, y, x + int(rng.integers(1, 5)), y + int(rng.integers(1, 5))],
        "start_us": MINUS_INFINITY_US if rng.random() < 0.05 else 1_000_000 * start,
        "end_us": INFINITY_US if rng.random() < 0.05 else 1_000_000 * (start + int(rng.integers(1, 4))),
        "inclusive": bool(rng.random() < 0.5),
        "floor_m": -np.inf if rng.random() < 0.1 else float(floor),
        "ceiling_m": np.inf if rng.random() < 0.1 else float(ceiling),
        "turn": int(rng.choice([0, 0, 0, -1, -2])),
        "kind": int(rng.integers(2)),
        "class": CLASSES[rng.integers(len(CLASSES))],
        "owner": OWNERS[rng.integers(len(OWNERS))],
    }


def oracle(scene: Scene, a: Piece, b: Piece, within_us: int) -> bool:
    """Whether two pieces may meet, as one would say it."""
    if any(a["box"][k] > b["box"][k + 2] or b["box"][k] > a["box"][k + 2] for k in (0, 1)):
        return False
    for first, second in ((a, b), (b, a)):
        ended_us, begins_us = first["end_us"], second["start_us"]
        if ended_us < INFINITY_US and begins_us > MINUS_INFINITY_US:
            gap_us = begins_us - ended_us
            if gap_us > within_us or (gap_us == within_us and not first["inclusive"]):
                return False
        if first["floor_m"] >= second["ceiling_m"]:
            return False
    if a["turn"] != 0 and b["turn"] != 0:
        return False
    if a["owner"] is not None and a["owner"] == b["owner"]:
        return False
    rule = rule_between(scene.rules, a, b)
    return rule is None or not rule.allowed


def rule_between(rules: tuple[Rule, ...], a: Piece, b: Piece) -> Rule | None:
    """The most specific rule of two objects, of two the one that does not allow."""

    def rank(side: str | None, one: Piece) -> int | None:
        kind = ("area", "track")[one["kind"]]
        return 0 if side is None else 1 if side == kind else 3 if side == one["class"] else None

    found: list[tuple[int, bool, Rule]] = []
    for rule in rules:
        for one, other in ((a, b), (b, a)):
            ranks = rank(rule.a_class, one), rank(rule.b_class, other)
            if None not in ranks:
                found.append((sum(n for n in ranks if n is not None), not rule.allowed, rule))
    return max(found, key=lambda one: one[:2])[2] if found else None


@pytest.fixture(scope="module")
def pairs() -> tuple[list[Piece], list[Piece]]:
    """Two lists of as many pieces."""
    rng = np.random.default_rng(44)
    return [thrown(rng) for _ in range(PAIRS)], [thrown(rng) for _ in range(PAIRS)]


def rows_of(separations: Separations, pieces: list[Piece]) -> RowBoxes:
    column = {name: [one[name] for one in pieces] for name in pieces[0]}
    kind, number = np.array(column["kind"], np.int8), numbers_of_words(column["class"])
    return RowBoxes(
        np.array(column["box"], float),
        np.array(column["floor_m"]), np.array(column["ceiling_m"]),
        np.array(column["start_us"], np.int64), np.array(column["end_us"], np.int64),
        np.arange(len(pieces)),
        np.array(column["turn"]) != 0,
        np.array(column["inclusive"]),
        np.stack([number, numbers_of_words(column["owner"])], axis=1),
        separations.types(kind, number),
    )  # fmt: skip


def in_sql(conn: Conn, pieces: tuple[list[Piece], list[Piece]], within_us: int, scene_id: int) -> list[bool]:
    """What the function says of rows of pieces."""
    found = conn.execute(
        """WITH a AS MATERIALIZED (SELECT n, jsonb_populate_record(NULL::conflictdb.piece, j) AS p
                                   FROM jsonb_array_elements(%s::jsonb) WITH ORDINALITY u (j, n)),
                b AS MATERIALIZED (SELECT n, jsonb_populate_record(NULL::conflictdb.piece, j) AS p
                                   FROM jsonb_array_elements(%s::jsonb) WITH ORDINALITY u (j, n))
           SELECT conflictdb_internal._pieces_may_meet(a.p, b.p, %s, conflictdb_internal._allowed_types(%s::bigint))
           FROM a JOIN b USING (n) ORDER BY n""",
        [*(json.dumps(as_columns(some)) for some in pieces), within_us / 1e6, scene_id],
    ).fetchall()
    return [one for (one,) in found]


def as_columns(pieces: list[Piece]) -> list[dict[str, Any]]:
    """Return pieces as columns of the table piece."""
    classes, owners = (numbers_of_words([one[name] for one in pieces]).tolist() for name in ("class", "owner"))
    return [
        {
            "hull": shapely.box(*one["box"]).wkt,
            "span": f"[{instant(one['start_us'])},{instant(one['end_us'])}{']' if one['inclusive'] else ')'}",
            "floor_m": str(one["floor_m"]),
            "ceiling_m": str(one["ceiling_m"]),
            "turn": one["turn"],
            "object_kind": one["kind"],
            "class_number": class_number,
            "owner_number": owner_number,
        }
        for one, class_number, owner_number in zip(pieces, classes, owners, strict=True)
    ]


def instant(at_us: int) -> str:
    return "" if at_us in (MINUS_INFINITY_US, INFINITY_US) else f"1970-01-01 00:00:{at_us // 1_000_000:02}+00"


def in_wasm(rows: RowBoxes, others: RowBoxes, within_us: int, compared: np.ndarray[Any, Any]) -> list[bool]:
    """What the kernel of the page says, run by node."""

    def column(values: Any, kind: str) -> list[str]:
        array = np.ascontiguousarray(values, {"f": "<f8", "i": "<i8", "u": "u1"}[kind])
        return [kind, base64.b64encode(array.tobytes()).decode()]

    given = [
        [
            column(one.boxes, "f"), column(one.floor_m, "f"), column(one.ceiling_m, "f"), column(one.start_us, "i"),
            column(one.end_us, "i"), column(one.object, "i"), column(one.is_copy, "u"), column(one.end_inclusive, "u"),
            column(one.numbers, "i"), column(one.type, "i"),
        ]
        for one in (rows, others)
    ]  # fmt: skip
    asked = {"rows": given, "within": str(within_us), "types": len(compared), "compared": column(compared, "u")}
    script = """
        import { readFileSync } from "node:fs";
        const page = process.argv[1];
        const { Kernel } = await import(`${page}/kernel.js`);
        const kernel = await Kernel.of(readFileSync(`${page}/kernel.wasm`));
        const asked = JSON.parse(readFileSync(0));
        const types = { f: Float64Array, i: BigInt64Array, u: Uint8Array };
        const array = ([type, text]) => new types[type](Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer);
        const [rows, others] = asked.rows.map((columns) => columns.map(array));
        const n = BigInt64Array.from(rows[1], (_, i) => BigInt(i));
        const which = { within: BigInt(asked.within), types: BigInt(asked.types), compared: array(asked.compared) };
        console.log(JSON.stringify(Array.from(kernel.mayMeet(rows, others, which, n, n))));
    """
    node = shutil.which("node")
    if node is None:
        pytest.skip("did not run: no node")
    command = [node, "--input-type=module", "-e", script, str(PAGE)]
    done = subprocess.run(command, input=json.dumps(asked), capture_output=True, text=True, check=True)
    return [bool(one) for one in json.loads(done.stdout)]


@pytest.mark.parametrize("within_us", [0, 1_000_000])
@pytest.mark.parametrize("rules", [(), RULES])
def test_all_statements_of_the_rule_agree(
    conn: Conn, pairs: tuple[list[Piece], list[Piece]], within_us: int, rules: tuple[Rule, ...]
) -> None:
    scene = Scene("s", rules=rules)
    must = [oracle(scene, a, b, within_us) for a, b in zip(*pairs, strict=True)]
    assert 500 < sum(must) < PAIRS // 2
    separations = Separations.of(scene)
    compared = separations.of_types != NEVER
    rows, others = (rows_of(separations, some) for some in pairs)
    every = np.arange(PAIRS)
    assert may_meet(rows, every, every, within_us, compared, others=others).tolist() == must
    assert in_wasm(rows, others, within_us, compared) == must
    conn.execute("SELECT conflictdb.create_scene('s')")
    for rule in rules:
        conn.execute(
            "SELECT conflictdb.put_rule('s', %s, %s, p_separation_m => %s, p_time_s => %s, p_allowed => %s)",
            [rule.a_class, rule.b_class, rule.separation_m, rule.time_s, rule.allowed],
        )
    row = conn.execute("SELECT scene_id FROM conflictdb.scene").fetchone()
    assert row is not None
    assert in_sql(conn, pairs, within_us, row[0]) == must
