"""Hostile XML: refused in time and memory that the file's size bounds."""

import time
from pathlib import Path

import pytest

from conflictdb import InvalidInput, read
from conflictdb.formats.xml_text import MAX_DEPTH, MAX_NODES, parsed, written

LAUGHS = '<!DOCTYPE r [<!ENTITY a "ha">' + "".join(
    f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
HOSTILE = {
    "entities in entities": (LAUGHS + "]><r>&i;</r>", "declares a document type"),
    "an entity of a file": ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><r>&a;</r>', "document type"),
    "a parameter entity": ('<!DOCTYPE r [<!ENTITY % a SYSTEM "http://localhost:1/">%a;]><r/>', "document type"),
    "an external document type": ('<!DOCTYPE r SYSTEM "http://localhost:1/r.dtd"><r/>', "document type"),
    "an undeclared entity": ("<r>&a;</r>", "line 1: undefined entity"),
    "deep nesting": ("<r>" * (MAX_DEPTH + 1), f"is nested more than {MAX_DEPTH} deep"),
    "an open element": ("<r><a></r>", "line 1: mismatched tag"),
    "no element": ("", "line 1: no element found"),
    "two roots": ("<r/><r/>", "line 1: junk after document element"),
    "an attribute twice": ('<r a="1" a="2"/>', "line 1: duplicate attribute"),
    "a lone surrogate": ("<r>\ud800</r>", "characters that are no text"),
    "NUL": ("<r>\0</r>", "line 1: not well-formed"),
    "an unknown format": ('<route xmlns="http://example.com/"/>', "XML of a format that is not read: .*'route'"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_xml_is_refused(case: str, tmp_path: Path) -> None:
    text, rule = HOSTILE[case]
    path = tmp_path / "a.xml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(InvalidInput, match=rule if "surrogate" not in case else "must be UTF-8 text"):
        read(path)
    if "format" not in case:
        with pytest.raises(InvalidInput, match=rule):
            parsed(text)


@pytest.mark.slow
def test_many_elements_are_refused_within_their_limit() -> None:
    """64 MB of empty elements would take gigabytes."""
    began = time.process_time()
    with pytest.raises(InvalidInput, match=f"more than {MAX_NODES:,} elements"):
        parsed("<r>" + "<a/>" * (MAX_NODES + 1))
    assert time.process_time() - began < 120.0


def test_a_file_above_the_limit_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "a.rtz"
    path.write_text("<r>" + " " * 1_000_001)
    with pytest.raises(InvalidInput, match="holds more than 1 MB"):
        read(path, max_file_mb=1)


def test_what_is_written_is_read_again() -> None:
    text = 'a < b & "c"'
    root = parsed(written("r", {"a": text, "b": None}, written("c", text=text), written("d")))
    assert root.get("a") == text
    assert root.get("b") is None
    assert root.value("c") == text
    assert root.value("d") is None
    assert [one.name for one in root.all("c", "d")] == ["c", "d"]
