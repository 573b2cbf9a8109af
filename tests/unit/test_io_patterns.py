"""Every pattern of every reader takes time in proportion to its text, whatever that repeats."""

import ast
import contextlib
import importlib
import pkgutil
import re
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import conflictdb.cli
import conflictdb.exchange
import conflictdb.formats
import conflictdb.model
from conflictdb import InvalidInput
from conflictdb.exchange.notam import read_notam
from conflictdb.exchange.openair import is_openair, read_openair
from conflictdb.formats import scene_file

# Each kind of character, and pairs that patterns alternate; with another one before and after.
SINGLE = [*" \t\n\r0A-/:.,()'°_+;=<\"", "é", "\u2003"]
KINDS = [*SINGLE, "1 ", "A ", "1,", "1.", "\r\n", "A1", "A-", "1\n", " \n", "A,", "1A"]
ENDS = [("", ""), ("", "!"), ("A1", "!"), ("(", "x")]
KB = 1024
_SCANS = ("search", "finditer", "findall", "sub", "subn", "split")


def modules() -> Iterator[ModuleType]:
    for package in (conflictdb.formats, conflictdb.exchange, conflictdb.model, conflictdb.cli):
        for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            with contextlib.suppress(ImportError):  # an extra that is not installed
                yield importlib.import_module(found.name)


def patterns() -> dict[str, tuple[re.Pattern[str], str]]:
    """Each pattern with each method that its module calls, by name; those without a name by their text."""
    found = {}
    for module in modules():
        source = Path(str(module.__file__)).read_text()
        for method, pattern in written_in_place(source):
            name = "search" if method in _SCANS else method
            found[f"{module.__name__}.{pattern.pattern}.{name}"] = pattern, method
        for name, value in vars(module).items():
            if not isinstance(value, re.Pattern) or not isinstance(value.pattern, str):
                continue
            methods = set(re.findall(rf"\b{name}\.(\w+)", source)) & {*_SCANS, "match", "fullmatch"}
            for method in sorted({"search" if one in _SCANS else one for one in methods}):
                found[f"{module.__name__}.{name}.{method}"] = value, method
    return found


def written_in_place(source: str) -> Iterator[tuple[str, re.Pattern[str]]]:
    """Each pattern that a call such as re.sub contains, with the method."""
    if not re.search(rf"\bre\.({'|'.join((*_SCANS, 'match', 'fullmatch'))})\(", source):
        return
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        method = node.func.attr
        if ast.unparse(node.func.value) != "re" or method not in (*_SCANS, "match", "fullmatch"):
            continue
        given = node.args[0]
        choices = [given.body, given.orelse] if isinstance(given, ast.IfExp) else [given]
        before_flags = {"sub": 4, "subn": 4, "split": 3}.get(method, 2)
        flags = [*node.args[before_flags:], *(one.value for one in node.keywords if one.arg == "flags")]
        value = re.NOFLAG
        for name in " ".join(map(ast.unparse, flags)).replace("|", " ").split():
            value |= re.RegexFlag[name.removeprefix("re.")]
        for choice in choices:
            assert isinstance(choice, ast.Constant), f"the pattern is not constant: {ast.unparse(node)}"
            yield method, re.compile(choice.value, value)


def taken_s(pattern: re.Pattern[str], method: str, text: str) -> float:
    began = time.process_time()
    if method in _SCANS:
        for _ in pattern.finditer(text):
            pass
    else:
        getattr(pattern, method)(text)
    return time.process_time() - began


EVERY = patterns()


@pytest.mark.parametrize("name", EVERY)
def test_a_pattern_takes_linear_time(name: str) -> None:
    """Eight times the text takes less than thirty times as long; with the square it would take sixty-four times."""
    pattern, method = EVERY[name]
    for kind in KINDS:
        for before, after in ENDS:
            short, longer = (before + kind * (size // len(kind)) + after for size in (8 * KB, 64 * KB))
            short_s, longer_s = taken_s(pattern, method, short), 0.0
            assert short_s < 0.2, (short_s, before, kind, after)  # linear ones take a thousandth of it
            if short_s > 0.02:
                longer_s = min(taken_s(pattern, method, longer) for _ in range(2))
            assert longer_s < 30 * max(short_s, 0.01), (
                f"{longer_s} s after {short_s} s: {before!r}, {kind!r}, {after!r}"
            )


def test_there_are_patterns_of_all_readers() -> None:
    assert len(EVERY) > 75
    assert "conflictdb.model.schedules.recurrences.\\r?\\n[ \\t].search" in EVERY


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
def test_a_pattern_takes_linear_time_on_half_a_megabyte(name: str) -> None:
    pattern, method = EVERY[name]
    for kind in KINDS:
        for before, after in ENDS:
            shorter, longer = (before + kind * (size // len(kind)) + after for size in (64 * KB, 512 * KB))
            shorter_s = max(taken_s(pattern, method, shorter), 0.01)
            assert taken_s(pattern, method, longer) < 30 * shorter_s, (before, kind, after)


@pytest.mark.parametrize(
    "body",
    [
        " " * 400_000,
        "(" * 100_000 + " " * 100_000,
        "\r\n" * 200_000,
        "A0123/26 " * 50_000,
        "A0123/26 NOTAMN " * 20_000,
    ],
    ids=["blanks", "brackets", "lines", "numbers", "heads"],
)
def test_a_notam_of_half_a_megabyte_is_refused_or_read_soon(body: str) -> None:
    """A thousandth of the steps that the square of its length would take."""
    began = time.process_time()
    with pytest.raises(InvalidInput):
        read_notam(body, "half a megabyte", skip_invalid=False)
    assert time.process_time() - began < 60.0


@pytest.mark.parametrize("lines", ["AC R\n", "AC R\n*x\n", "AC R\nZZ z\n", "AC R\n\n", "AC \n"])
def test_half_a_megabyte_of_classes_is_no_openair_soon(lines: str) -> None:
    """A thousandth of the steps that the square of its length would take."""
    began = time.process_time()
    assert not is_openair(lines * (512 * KB // len(lines)))
    assert time.process_time() - began < 20.0


ZIGZAG = "".join(f"DP 50:{k * 37 % 60}:{k * 17 % 59} N 008:{k * 23 % 60}:{k * 41 % 59} E\n" for k in range(10_000))


@pytest.mark.parametrize(
    "shape", [ZIGZAG, "V X=50:00:00 N 008:00:00 E\n" + "DA 10,0,359\n" * 1000], ids=["zigzag", "arcs"]
)
def test_an_outline_that_crosses_itself_too_often_is_refused_soon(shape: str) -> None:
    """All that it encloses would take gigabytes: as many parts as the square of its points."""
    began = time.process_time()
    with pytest.raises(InvalidInput, match="crosses itself more than 10,000 times"):
        read_openair(f"AC R\nAN North\nAL GND\nAH 5000FT\n{shape}", "twisted", stem="twisted", skip_invalid=False)
    assert time.process_time() - began < 20.0


def test_an_airspace_begins_with_the_last_of_several_classes() -> None:
    assert is_openair("AC R\nAC D\n\n*x\nAY TMA\nAN North\n")


def test_the_bracket_and_the_blanks_before_a_number_belong_to_that_notam() -> None:
    one = (
        "(A0{n}/26 NOTAMN\nQ) EDGG/QRTCA/IV/BO/W/000/999/5005N00830E005\nA) EDGG B) 2601010000 C) 2601020000\nE) AREA)"
    )
    found = read_notam("\n".join(one.replace("{n}", str(n)) for n in (123, 124)), "two", skip_invalid=False)
    assert [area.properties["text"] for area in found.areas] == ["AREA", "AREA"]


def test_a_million_rules_are_counted_before_they_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    def read(*_: object) -> None:
        raise AssertionError("a rule was read")

    monkeypatch.setattr(scene_file, "rule_of", read)
    with pytest.raises(InvalidInput, match="must be at most 1,000; got 1,000,000"):
        scene_file.scene_of({"rules": [{"a_class": "x"}] * 1_000_000}, "s")
