"""Changes one thing in the kernel at a time, and sees which tests notice: `mutate.py` for C.

    ./run python tests/acceptance/mutate_kernel.py --seed 1 --count 300 [--keep DIRECTORY] [FOLDER or FILE ...]
    ./run python tests/acceptance/mutate_kernel.py --at narrow/zone.c:117 --at planes/rhumb.c:264

Works on a copy of the tree. All changes that were drawn are compiled into one library, and a variable chooses one:
`a < b` becomes `(MUTANT(7) ? (a <= b) : (a < b))`. The tests run once with none chosen, and the library notes which
changes each test reaches. Then each change is chosen in a fork, in which the tests that reach it run until one fails,
the most specific first. Programs that tests compile from the sources have the change, too. Slow tests and tests that
need a database are left out. It prints each change and a table by file, and exits 1 if one survived that mutants.toml
does not list.

Changes are: comparisons (their boundary, their sense), arithmetic and logic swapped, signs and negations dropped,
constants changed, conditions negated, functions swapped (`most` for `least`) or dropped (`fabs`), statements removed.
Changes that do not compile are left out. Tests that fail on the copy without a change are left out, and listed.
"""

import argparse
import ctypes
import functools
import gc
import hashlib
import json
import os
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parent)]

import mutate
import pytest
from mutate import LONGER_S, PYTEST, TESTS, TIMES, Bench, Mutant, copied, fails, run, tell

FOLDERS: Final = ("narrow", "broad", "planes")
# Their flags: what a change leaves unused is no error.
STRICT: Final = ('    "-Wall",\n', '    "-Wextra",\n', '    "-Werror",\n')
HEADER: Final = """\
#ifndef MUTANTS_H
#define MUTANTS_H
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#define _SHOWN __attribute__((weak, visibility("default")))
_SHOWN int _kernel_mutant = -1;
_SHOWN unsigned char _kernel_unnoted[{count}];
_SHOWN unsigned char *_kernel_reached = _kernel_unnoted;
#define MUTANT(k) (_kernel_reached[k] = 1, _kernel_mutant == (k))
/* All libraries and programs note what they reach in one file. */
__attribute__((weak, constructor)) void _kernel_choose(void) {{
    const char *chosen = getenv("KERNEL_MUTANT"), *name = getenv("KERNEL_REACHED");
    if (chosen) _kernel_mutant = atoi(chosen);
    int file = name ? open(name, O_RDWR) : -1;
    void *noted = file < 0 ? MAP_FAILED : mmap(NULL, {count}, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (noted != MAP_FAILED) _kernel_reached = noted;
}}
#endif
"""

TOKEN: Final = re.compile(
    r"""(?P<skip>\s+|/\*.*?\*/|//[^\n]*|^[ \t]*\#(?:\\\n|[^\n])*)
    |(?P<number>0[xX][0-9a-fA-F.]+(?:[pP][+-]?\d+)?[uUlL]*|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?[uUlLfF]*)
    |(?P<name>[A-Za-z_]\w*)
    |(?P<text>"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*')
    |(?P<sign>->|\+\+|--|<<=|>>=|[-+*/%&|^]=|<=|>=|==|!=|&&|\|\||<<|>>|\.\.\.|[-+*/%&|^<>=!~?:;,.(){}\[\]])""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)
RANKS: Final = MappingProxyType(
    {
        sign: rank
        for rank, signs in enumerate(("||", "&&", "|", "^", "&", "== !=", "< > <= >=", "<< >>", "+ -", "* / %"))
        for sign in signs.split()
    }
)
OTHERS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        sign: tuple(others.split())
        for sign, others in (
            *(("<", "<= >"), ("<=", "< >"), (">", ">= <"), (">=", "> <"), ("==", "!="), ("!=", "=="), ("&&", "||")),
            *(("||", "&&"), ("+", "-"), ("-", "+"), ("*", "/"), ("/", "*"), ("%", "*"), ("&", "|"), ("|", "&")),
            *(("<<", ">>"), (">>", "<<")),
        )
    }
)
ASSIGNED: Final = MappingProxyType({"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "|=": "&=", "&=": "|="})
SWAPPED: Final = MappingProxyType(
    {
        name: other
        for pair in (("least", "most"), ("fmin", "fmax"), ("floor", "ceil"), ("sin", "cos"), ("sinh", "cosh"))
        for name, other in (pair, pair[::-1])
    }
)
DROPPED: Final = ("fabs", "sqrt", "norm")
TYPES: Final = frozenset(
    (
        "double",
        "float",
        "int",
        "char",
        "bool",
        "void",
        "size_t",
        "unsigned",
        "long",
        "const",
        "struct",
        "enum",
        "static",
    )
)
HEADED: Final = frozenset(("if", "for", "while", "switch"))
KEYWORDS: Final = HEADED | {"else", "do", "case", "default", "return", "break", "continue", "goto", "sizeof"}
BRACKETS: Final = MappingProxyType({")": "(", "]": "[", "}": "{"})
STOPS: Final = frozenset(["(", "[", "{", "}", ")", "]", ",", ";", "?", ":", "=", *ASSIGNED, "%=", "^=", "<<=", ">>="])


ASSIGNS: Final = re.compile(r"(?<![=!<>])=(?!=)|\+\+|--")


class Token(NamedTuple):
    kind: str
    text: str
    start: int
    end: int


class Sites:
    """All that can be changed in one file of C, as it is formatted here."""

    def __init__(self, module: str, source: str) -> None:
        self._module, self._source = module, source
        found = TOKEN.finditer(source)
        self._tokens = [Token(str(one.lastgroup), one[0], *one.span()) for one in found if one.lastgroup != "skip"]
        self._partner: dict[int, int] = {}
        opened: list[int] = []
        for k, token in enumerate(self._tokens):
            if token.text in ("(", "[", "{"):
                opened.append(k)
            elif token.text in BRACKETS:
                self._partner[k] = opened.pop()
                self._partner[self._partner[k]] = k
        self.found: list[Mutant] = []
        self._within, k = "", 0
        while k < len(self._tokens):
            is_body = self._tokens[k].text == "{" and k > 0 and self._tokens[k - 1].text == ")"
            if is_body:
                self._within = self._tokens[self._partner[k - 1] - 1].text
                self._body(k, self._partner[k])
            k = self._partner[k] + 1 if self._tokens[k].text in ("(", "[", "{") else k + 1

    def _body(self, first: int, last: int) -> None:
        k = first + 1
        while k < last:
            token = self._tokens[k]
            if token.text in ("static", "REQUIRE") or (token.text == "case"):
                end = ":" if token.text == "case" else ";"
                while self._tokens[k].text != end:
                    k += 1
            elif self._is_binary(k):
                self._binary(k)
            elif token.text in ("-", "!") and self._tokens[k - 1].text != "sizeof":
                end = self._unary_end(k)
                self._add(k, end, self._text(k + 1, end))
            elif token.kind == "number":
                self._constant(k)
            elif token.kind == "name" and self._tokens[k + 1].text == "(":
                self._call(k)
            if self._begins(k):
                self._statement(k)
            k += 1

    def _add(self, first: int, last: int, *changed: str) -> None:
        """Note other texts of the tokens [first, last]."""
        start, end = self._tokens[first].start, self._tokens[last].end
        line = self._source.rfind("\n", 0, start) + 1
        after = self._source[end:].split("\n", 1)[0]
        number = 1 + self._source.count("\n", 0, start)
        given = self._source[line:start], after, self._source[start:end]
        for new in changed:
            self.found.append(Mutant(self._module, number, start, end, self._within, *given, new))

    def _text(self, first: int, last: int) -> str:
        """Return the text of the tokens [first, last] in one line, without comments."""
        words, tokens = "", self._tokens[first : last + 1]
        for before, token in zip([None, *tokens], tokens, strict=False):
            words += " " * (before is not None and before.end < token.start) + token.text
        return words

    def _is_type(self, k: int) -> bool:
        text = self._tokens[k].text
        return text in TYPES or text.endswith("_t") or (text[0].isupper() and any(one.islower() for one in text))

    def _is_operand(self, k: int) -> bool:
        """Return whether an operand ends with a token."""
        token = self._tokens[k]
        if token.kind in ("number", "text"):
            return True
        if token.kind == "name":
            return token.text not in KEYWORDS and not self._is_type(k)
        if token.text == "]":
            return True
        if token.text != ")":
            return False
        first = self._partner[k]
        inside = range(first + 1, k)
        is_cast = all(self._tokens[i].text == "*" or self._is_type(i) for i in inside) and k > first + 1
        return not is_cast and self._tokens[first - 1].text not in HEADED

    def _is_binary(self, k: int) -> bool:
        return self._tokens[k].text in RANKS and self._is_operand(k - 1)

    def _binary(self, k: int) -> None:
        sign = self._tokens[k].text
        rank, first, last = RANKS[sign], k - 1, k + 1
        while True:  # the left operand
            if self._tokens[first].text in BRACKETS and self._tokens[first].text != "}":
                first = self._partner[first]
            before = self._tokens[first - 1]
            ends = before.text in STOPS - set(BRACKETS) or before.text in KEYWORDS - {"sizeof"}
            headed = before.text == ")" and self._tokens[self._partner[first - 1] - 1].text in HEADED
            if ends or headed or before.text == "}" or (self._is_binary(first - 1) and RANKS[before.text] < rank):
                break
            first -= 1
        while True:  # the right one
            if self._tokens[last].text in ("(", "[", "{"):
                last = self._partner[last]
            after = self._tokens[last + 1]
            is_literal = after.text == "{" and self._tokens[last].text == ")"
            if (after.text in STOPS and after.text not in ("(", "[") and not is_literal) or (
                self._is_binary(last + 1) and RANKS[after.text] <= rank
            ):
                break
            last += 1
        left, right = self._text(first, k - 1), self._text(k + 1, last)
        self._add(first, last, *(f"{left} {other} {right}" for other in OTHERS.get(sign, ())))

    def _unary_end(self, k: int) -> int:
        """Return the last token of a sign and its operand."""
        k += 1
        while self._tokens[k].text in ("-", "!", "*", "&", "~") or (
            self._tokens[k].text == "(" and not self._is_operand(self._partner[k])
        ):
            k = self._partner[k] + 1 if self._tokens[k].text == "(" else k + 1
        k = self._partner[k] if self._tokens[k].text == "(" else k
        while self._tokens[k + 1].text in ("(", "[", ".", "->"):
            k = self._partner[k + 1] if self._tokens[k + 1].text in ("(", "[") else k + 2
        return k

    def _constant(self, k: int) -> None:
        text, around = self._tokens[k].text, (self._tokens[k - 1].text, self._tokens[k + 1].text)
        is_alone = around in (("[", "]"), ("{", "}")) or self._tokens[k - 2].text == "INT64_C"
        if is_alone or text[:2].lower() == "0x" or not text[-1].isdigit():
            return
        if re.fullmatch(r"\d+", text):
            self._add(k, k, str(int(text) + 1))
        else:
            value = float(text)
            self._add(k, k, repr(1.0 if value == 0.0 else 2.0 * value))

    def _call(self, k: int) -> None:
        name, last = self._tokens[k].text, self._partner[k + 1]
        if name in SWAPPED:
            self._add(k, last, SWAPPED[name] + self._text(k + 1, last))
        elif name in DROPPED:
            self._add(k, last, self._text(k + 1, last))
        elif name == "if":
            self._add(k + 2, last - 1, f"!({self._text(k + 2, last - 1)})")

    def _begins(self, k: int) -> bool:
        """Return whether a statement that is an expression begins with a token."""
        token, before = self._tokens[k], self._tokens[k - 1]
        if token.kind != "name" or token.text in KEYWORDS or self._is_type(k) or token.text == "REQUIRE":
            return token.text == "*" and before.text in (";", "{", "}")
        if before.text == ")":
            return self._tokens[self._partner[k - 1] - 1].text in HEADED
        return before.text in ("{", "}", "else", "do") or (before.text == ";" and self._is_in_block(k))

    def _is_in_block(self, k: int) -> bool:
        """Return whether the innermost open bracket is a brace."""
        k -= 1
        while self._tokens[k].text not in ("(", "[", "{"):
            k = self._partner[k] - 1 if self._tokens[k].text in BRACKETS else k - 1
        return self._tokens[k].text == "{"

    def _statement(self, k: int) -> None:
        last, assigned = k, None
        while self._tokens[last].text not in (";", "}", ":"):
            if self._tokens[last].text in ASSIGNED and assigned is None:
                assigned = last
            last = self._partner[last] + 1 if self._tokens[last].text in ("(", "[", "{") else last + 1
        if self._tokens[last].text != ";" or last == k + 1:
            return
        self._add(k, last - 1, "(void)0")
        if assigned is not None:
            sign = ASSIGNED[self._tokens[assigned].text]
            self._add(k, last - 1, f"{self._text(k, assigned - 1)} {sign} {self._text(assigned + 1, last - 1)}")


def sites(root: Path, where: Sequence[str]) -> list[Mutant]:
    """Return all changes of the files and folders of the kernel."""
    kernel = root / "conflictdb" / "kernel"
    files = [
        path for one in where for path in ([kernel / one] if "." in one else sorted((kernel / one).glob("*.[ch]")))
    ]
    return [one for path in files for one in Sites(f"kernel/{path.relative_to(kernel)}", path.read_text()).found]


def rendered(source: str, mutants: Sequence[tuple[int, Mutant]]) -> str:
    """Return a file in which each change can be chosen by its number; its lines stay where they are."""

    def within(start: int, end: int, left: list[tuple[int, Mutant]]) -> str:
        text, at = "", start
        while left:
            first = min(left, key=lambda one: (one[1].start, -one[1].end))[1]
            same = [one for one in left if (one[1].start, one[1].end) == (first.start, first.end)]
            inner = [one for one in left if one not in same and one[1].start < first.end]
            left = [one for one in left if one[1].start >= first.end]
            told = within(first.start, first.end, [one for one in inner if one[1].end <= first.end])
            for number, mutant in same:
                # A statement may have no value.
                is_statement = mutant.new == "(void)0" or ASSIGNS.search(mutant.old)
                void = "(void)" * bool(is_statement)
                told = f"(MUTANT({number}) ? {void}({mutant.new}) : {void}({told}))"
            text += source[at : first.start] + told
            at = first.end
        return text + source[at:end]

    return within(0, len(source), list(mutants))


def compiled(root: Path, mutants: Sequence[Mutant]) -> list[Mutant]:
    """Compile a copy of the tree with changes, and return those that compile; numbers are places in the result."""
    kernel, left = root / "conflictdb" / "kernel", list(mutants)
    build = kernel / "build.py"
    build.write_text(functools.reduce(lambda text, flag: text.replace(flag, ""), STRICT, build.read_text()))
    sources = {module: (root / "conflictdb" / module).read_text() for module in {one.module for one in mutants}}
    while True:
        (kernel / "mutants.h").write_text(HEADER.format(count=max(len(left), 1)))
        for module, source in sources.items():
            mine = [(k, one) for k, one in enumerate(left) if one.module == module]
            (root / "conflictdb" / module).write_text(f'#include "mutants.h"\n#line 1\n{rendered(source, mine)}')
        done = subprocess.run([sys.executable, build], capture_output=True, text=True, check=False)
        found = re.findall(r"(\w+\.[ch]):(\d+):\d+: (?:error|warning: pointer/integer type mismatch)", done.stderr)
        if done.returncode == 0 and not found:
            return left
        wrong = {(file, int(line)) for file, line in found}
        before = len(left)
        left = [one for one in left if not any((Path(one.module).name, line) in wrong for line in _lines(one))]
        if len(left) == before:
            sys.exit(done.stderr[-3000:])
        tell(f"{before - len(left)} changes do not compile")


def _lines(mutant: Mutant) -> range:
    return range(mutant.line, mutant.line + mutant.old.count("\n") + 1)


def _empty_caches() -> None:
    """Answers of the kernel without a change may be kept."""
    for one in gc.get_objects():
        if isinstance(one, functools._lru_cache_wrapper):
            one.cache_clear()


def _libraries() -> list[Any]:
    """Return the loaded libraries of the kernel."""
    from conflictdb.kernel import build, library

    paths = [build.library(), Path(os.environ.get("XDG_STATE_HOME", ".")).parent / "kernel" / "internals.so"]
    library.library()
    return [ctypes.CDLL(str(path)) for path in paths if path.exists()]


class KernelBench(Bench):
    """A plugin of pytest that runs tests on changes of the kernel."""

    def __init__(self, root: Path, mutants: Sequence[Mutant]) -> None:
        self.mutants, self.survivors, self._numbers = (
            mutants,
            list[Mutant](),
            {m.name: k for k, m in enumerate(mutants)},
        )
        # Before the library is loaded.
        self._noted = root / "reached"
        self._noted.write_bytes(bytes(len(mutants)))
        os.environ["KERNEL_REACHED"] = str(self._noted)
        super().__init__(root, self._all)

    def _all(self, _: Bench) -> None:
        self.survivors = run(self, self.mutants)

    def _reach(self) -> None:
        digest = hashlib.sha256("".join(one.name for one in self.mutants).encode()).hexdigest()[:16]
        record = self.root / f"reach-{digest}.json"
        known: dict[str, Any] = json.loads(record.read_text()) if record.exists() else {}
        started = time.perf_counter()
        for k, (name, test) in enumerate(sorted(self._tests.items()), 1):
            if name not in known:
                known[name] = self._of(test)
            if k % 100 == 0 or k == len(self._tests):
                tell(f"reach: {k} of {len(self._tests)} tests, {time.perf_counter() - started:.0f} s")
                record.write_text(json.dumps(known))
        for name in sorted(name for name in self._tests if known[name]["fails"]):
            tell(f"left out, fails without a change: {name}")
        for name in self._tests:
            self._seconds[name], self._reached[name] = known[name]["seconds"], len(known[name]["reached"])
            for number in () if known[name]["fails"] else known[name]["reached"]:
                self._by_line[self.mutants[number].name].append(name)

    def _of(self, test: pytest.Item) -> dict[str, Any]:
        _empty_caches()
        with self._noted.open("r+b") as file:
            file.write(bytes(len(self.mutants)))
        began = time.process_time()
        failed = fails(test)
        seconds = time.process_time() - began
        found = {k for k, value in enumerate(self._noted.read_bytes()) if value}
        return {"seconds": seconds, "reached": sorted(found), "fails": failed}

    def tests_of(self, mutant: Mutant) -> list[str]:
        chosen, total_s = [], 0.0
        for test in sorted(self._by_line.get(mutant.name, ()), key=self._rank):
            total_s += self._seconds[test]
            if total_s > mutate.ENOUGH_S and chosen:
                break
            chosen.append(test)
        return chosen

    def fate(self, mutant: Mutant) -> str:
        tests = self.tests_of(mutant)
        limit_s = LONGER_S + int(TIMES * sum(self._seconds[test] for test in tests))
        ended = self.root / "ended.txt"
        ended.unlink(missing_ok=True)
        child = os.fork()
        if child == 0:
            try:
                resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 1))
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, 1)
                os.dup2(nowhere, 2)
                _empty_caches()
                os.environ["KERNEL_MUTANT"] = str(self._numbers[mutant.name])
                for library in _libraries():
                    ctypes.c_int.in_dll(library, "_kernel_mutant").value = self._numbers[mutant.name]
                failed = next((k for k, test in enumerate(tests) if fails(self._tests[test])), len(tests))
                ended.write_text(str(failed))
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        killer = [*tests, ""][int(ended.read_text())] if ended.exists() else "ends the program, or does not end"
        self._killers[killer] += 1
        return killer


def main() -> int:
    """Change the kernel as the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="directory of the copy and what was found (default: new)")
    parser.add_argument("--at", action="append", default=[], metavar="FILE:LINE", help="all changes of a line instead")
    parser.add_argument("--tests", nargs="+", default=TESTS, help="(default: unit, contract and acceptance)")
    parser.add_argument("where", nargs="*", default=FOLDERS, help="files and folders of the kernel")
    options = parser.parse_args()
    keep = (options.keep or Path(tempfile.mkdtemp(prefix="mutants-"))).resolve()
    keep.mkdir(parents=True, exist_ok=True)
    copied(keep)
    if options.at:
        every = sites(keep, [one.split(":")[0] for one in options.at])
        some = [one for one in every if f"{one.module.removeprefix('kernel/')}:{one.line}" in options.at]
    else:
        every = sites(keep, options.where)
        some = random.Random(options.seed).sample(every, min(options.count, len(every)))  # noqa: S311 - chance
    # Two changes of one name are one.
    some = compiled(keep, list({one.name: one for one in some}.values()))
    tell(f"{len(some)} of {len(every)} changes")
    os.chdir(keep)
    sys.path.insert(0, str(keep))
    bench = KernelBench(keep, some)
    code = pytest.main([*PYTEST, "-s", "-m", "not slow and not db", *options.tests], plugins=[bench])
    if code:
        return int(code)
    (keep / "survivors.json").write_text(json.dumps([mutant.name for mutant in bench.survivors], indent=1))
    for mutant in bench.survivors:
        tell(f"\nconflictdb/{mutant.module}:{mutant.line}\n- {mutant.old}\n+ {mutant.new}")
    return int(bool(bench.survivors))


if __name__ == "__main__":
    sys.exit(main())
