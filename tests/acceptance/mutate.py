"""Changes one thing in the numeric modules at a time, and sees which tests notice: a test of the tests.

    python tests/acceptance/mutate.py --seed 1 --count 200 [--keep DIRECTORY] [MODULE ...]
    python tests/acceptance/mutate.py --again DIRECTORY/survivors.json

Works on a copy of the tree. First it runs the tests once and records which lines they reach, and their times. Then it
draws changes by the seed. For each it runs the tests that reach its line, the most specific first, until one fails: the
mutant is killed. Each mutant runs in a fork that has everything loaded, where one function has other code. Slow tests,
tests that need a database, and code run by other processes are left out. It prints each mutant, the survivors with
their source, and a table by module. It exits 1 if any survived that mutants.toml does not list; that file lists mutants
that change no answer, with the reasons.

A module's mutants are: comparisons (their boundary, their sense), arithmetic swapped, signs and negations dropped,
constants changed, conditions negated, minimum and maximum (and their like) swapped, the branches of `where` swapped,
clips and absolute values dropped, statements removed. Messages, annotations and decorators are not changed.
"""

import argparse
import ast
import copy
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any, Final

import pytest
from _pytest.runner import runtestprotocol

ROOT: Final = Path(__file__).resolve().parents[2]
# fmt: off
MODULES: Final = (
    "earth.geodesy", "earth.mercator", "earth.gnomonic",
    "earth.plane", "core.published.encounters", "earth.rhumb_distance", "core.pieces.cutting",
    "core.pieces.convex_parts", "model.outlines", "arrays.ragged", "arrays.objects", "arrays.pieces", "arrays.pairs",
    "arrays.answers", "core.run", "core.merge", "core.whole_areas",
    "core.closest_approaches", "core.object_pairs", "core.published.stage3_projection",
    "core.stage4.contact_search",
    "core.stage4.closest_approach", "core.published.linear_program", "core.published.nonlinear_program",
    "client.estimates",
)
# fmt: on
TESTS: Final = ("tests/unit", "tests/contract", "tests/acceptance")
# Hypothesis' own profile for servers: the same examples each time, without a deadline.
PYTEST: Final = (
    *("-q", "--tb=no", "-n", "0", "-p", "no:randomly", "-p", "no:cacheprovider"),
    "--hypothesis-profile=ci",
)
# A mutant counts as killed (it hangs) after TIMES times the seconds of its tests, plus LONGER_S.
TIMES: Final = 5.0
LONGER_S: Final = 20
# Budget of tests on lines that nearly all of them reach, seconds; the most specific run first.
ENOUGH_S: Final = 20.0
# A test that reaches this many lines computes whole scenes.
SCENE_LINES: Final = 500
# Lines that fewer tests than this reach may have been reached before, on import or by a test whose result is kept.
FEW: Final = 3

COMPARED: Final[dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATED: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
SWAPPED: Final = {
    name: other
    for pair in (
        ("minimum", "maximum"),
        ("min", "max"),
        ("fmin", "fmax"),
        ("argmin", "argmax"),
        ("floor", "ceil"),
        ("any", "all"),
        ("sin", "cos"),
        ("sinh", "cosh"),
        ("zeros", "ones"),
        ("zeros_like", "ones_like"),
    )
    for name, other in (pair, pair[::-1])
}
DROPPED: Final = ("clip", "abs", "sqrt", "degrees", "radians", "nan_to_num", "nextafter")  # f(x, ...) becomes x


@dataclass(frozen=True)
class Mutant:
    """One change: `old` at a place of a module becomes `new`.

    line : of the module, from 1; tests must reach it
    start, end : position of `old` in the text, in bytes
    within : its function
    before, after : the text around it in its line
    """

    module: str
    line: int
    start: int
    end: int
    within: str
    before: str
    after: str
    old: str
    new: str

    @property
    def name(self) -> str:
        """The change as mutants.toml and people know it, wherever its lines have moved."""
        text = f"{self.before}[{self.old} -> {self.new}]{self.after}"
        return f"{self.module}.{self.within}: {' '.join(text.split())}"


class Sites(ast.NodeVisitor):
    """All that can be changed in one module."""

    def __init__(self, module: str, source: str) -> None:
        self._module, self._source = module, source.encode()
        self._starts = [0, *(i + 1 for i, byte in enumerate(self._source) if byte == 10)]
        self._within: list[str] = []
        self.found: list[Mutant] = []
        self.visit(ast.parse(source))

    def _add(self, node: Any, *mutated: Any) -> None:
        start = self._starts[node.lineno - 1] + node.col_offset
        end = self._starts[node.end_lineno - 1] + node.end_col_offset
        old = self._source[start:end].decode()
        before = self._source[self._starts[node.lineno - 1] : start].decode()
        after = self._source[end:].split(b"\n", 1)[0].decode()
        within = ".".join(self._within) or "module"
        for other in mutated:
            new = ast.unparse(other)
            if isinstance(node, ast.expr) and not isinstance(node, ast.Constant | ast.Call):
                new = f"({new})"
            self.found.append(Mutant(self._module, node.lineno, start, end, within, before, after, old, new))

    def _scope(self, node: ast.FunctionDef | ast.ClassDef) -> None:
        self._within.append(node.name)
        for child in node.body:
            self.visit(child)
        self._within.pop()

    visit_FunctionDef = visit_ClassDef = _scope  # noqa: N815 - the names that NodeVisitor looks for

    def visit_Raise(self, node: ast.Raise) -> None:
        """Messages are not changed."""

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Nor are f-strings, which messages are made of."""

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_Compare(self, node: ast.Compare) -> None:
        for k, op in enumerate(node.ops):
            for other in COMPARED[type(op)]:
                changed = copy.deepcopy(node)
                changed.ops[k] = other()
                self._add(node, changed)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        is_type = any(isinstance(side, ast.Constant) and side.value is None for side in (node.left, node.right))
        if type(node.op) in OPERATED and not is_type:
            self._add(node, ast.BinOp(node.left, OPERATED[type(node.op)](), node.right))
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        self._add(node, node.operand)
        if not isinstance(node.operand, ast.Constant):
            self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        self._add(node, ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values))
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._add(node, ast.Constant(not value))
        elif isinstance(value, int):
            self._add(node, ast.Constant(value + 1))
        elif isinstance(value, float):
            self._add(node, ast.Constant(1.0 if value == 0.0 else 2.0 * value))

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in SWAPPED:
            changed = copy.deepcopy(node)
            if isinstance(changed.func, ast.Attribute):
                changed.func.attr = SWAPPED[name]
            elif isinstance(changed.func, ast.Name):
                changed.func.id = SWAPPED[name]
            self._add(node, changed)
        elif name in DROPPED and node.args:
            self._add(node, node.args[0])
        elif name == "where" and len(node.args) == 3:
            self._add(node, ast.Call(node.func, [node.args[0], node.args[2], node.args[1]], []))
        self.visit(node.func)
        for argument in node.args:
            self.visit(argument)
        for keyword in node.keywords:
            if keyword.arg != "strict":
                self.visit(keyword.value)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._add(node, ast.IfExp(node.test, node.orelse, node.body))
        self.generic_visit(node)

    def visit_If(self, node: ast.If | ast.While) -> None:
        if not isinstance(node.test, ast.Compare | ast.UnaryOp):
            self._add(node.test, ast.UnaryOp(ast.Not(), node.test))
        self.generic_visit(node)

    visit_While = visit_If  # noqa: N815

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring
            self._add(node, ast.Pass())
            self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._add(node, ast.Pass())
        if type(node.op) in OPERATED:
            self._add(node, ast.AugAssign(node.target, OPERATED[type(node.op)](), node.value))
        self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        if isinstance(node.targets[0], ast.Subscript):
            self._add(node, ast.Pass())
        if getattr(node.targets[0], "id", "") != "__all__":
            self.generic_visit(node)


def file_of(module: str) -> str:
    """Return where in the package a module is."""
    return module if module.endswith((".c", ".h")) else module.replace(".", "/") + ".py"


def sites(root: Path, module: str) -> list[Mutant]:
    """Return all mutants of a module."""
    return Sites(module, (root / "conflictdb" / file_of(module)).read_text()).found


class Reach:
    """Notes which lines of the modules a test reaches, and its seconds."""

    def __init__(self, package: Path, modules: Sequence[str]) -> None:
        self._files = {str(package / file_of(module)): module for module in modules}
        self._left: dict[CodeType, set[int]] = {}

    def _enter(self, frame: FrameType, event: str, _: Any) -> Any:
        code = frame.f_code
        if code.co_filename not in self._files:
            return None
        # Tracing is slow: a function is not traced again once all its lines were reached.
        left = self._left.get(code)
        if left is None:
            left = self._left[code] = {line for *_, line in code.co_lines() if line}
        return self._line if left else None

    def _line(self, frame: FrameType, event: str, _: Any) -> Any:
        if event == "line":
            self._left[frame.f_code].discard(frame.f_lineno)
        return self._line

    def of(self, test: pytest.Item) -> dict[str, Any]:
        """Return the lines that a test reaches and the seconds it takes."""
        self._left.clear()
        started = time.process_time()
        sys.settrace(self._enter)
        try:
            failed = fails(test)
        finally:
            sys.settrace(None)
        if failed:
            sys.exit(f"{test.nodeid} fails without any change")
        lines = [
            f"{self._files[code.co_filename]}:{line}"
            for code, left in self._left.items()
            for line in {line for *_, line in code.co_lines() if line} - left
        ]
        return {"seconds": time.process_time() - started, "lines": sorted(lines)}


def fails(test: pytest.Item) -> bool:
    """Run a test, and return whether it fails."""
    return any(report.failed for report in runtestprotocol(test, log=False, nextitem=None))


class Bench:
    """A plugin of pytest that has it collect the tests of a copy of the tree, and then runs them on mutants."""

    def __init__(self, root: Path, work: Callable[["Bench"], None]) -> None:
        self.root, self._work = root, work
        self._tests: dict[str, pytest.Item] = {}
        self._seconds: dict[str, float] = {}
        self._reached: dict[str, int] = {}
        self._by_line: dict[str, list[str]] = defaultdict(list)
        self._killers: Counter[str] = Counter()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run mutants instead of tests."""
        self._tests = {test.nodeid: test for test in session.items}
        self._reach()
        self._work(self)
        return True

    def _reach(self) -> None:
        """Read the lines that each test reaches; run new tests."""
        record = self.root / "reach.json"
        known: dict[str, Any] = json.loads(record.read_text()) if record.exists() else {}
        new = self._tests.keys() - known.keys()
        tracer = Reach(self.root / "conflictdb", MODULES)
        for k, name in enumerate(sorted(new), 1):
            known[name] = tracer.of(self._tests[name])
            if k % 50 == 0 or k == len(new):
                tell(f"reach: {k} of {len(new)} tests")
                record.write_text(json.dumps(known))
        for name in self._tests:
            self._seconds[name], self._reached[name] = known[name]["seconds"], len(known[name]["lines"])
            for line in known[name]["lines"]:
                self._by_line[line].append(name)

    def tests_of(self, mutant: Mutant) -> list[str]:
        """Return the tests that reach a mutant, the most specific first: those that reach the fewest other lines.

        A test of one function is the most likely to notice a change of it. Tests of whole scenes come last: the most
        successful first, then the quickest. Constants are computed on import, and caches are filled by the first test
        that runs: if few tests reach a line, all tests that reach its module count.
        """
        found = set(self._by_line.get(f"{mutant.module}:{mutant.line}", ()))
        if self._needs_import(mutant):
            lines = (tests for line, tests in self._by_line.items() if line.startswith(f"{mutant.module}:"))
            found |= {test for tests in lines for test in tests}
        chosen, total_s = [], 0.0
        for test in sorted(found, key=self._rank):
            total_s += self._seconds[test]
            if total_s > ENOUGH_S and chosen:
                break
            chosen.append(test)
        return chosen

    def _rank(self, test: str) -> tuple[int, int, float, str]:
        return min(self._reached[test], SCENE_LINES), -self._killers[test], self._seconds[test], test

    def _needs_import(self, mutant: Mutant) -> bool:
        reached = len(self._by_line.get(f"{mutant.module}:{mutant.line}", ()))
        return reached < FEW or function_of(mutant) is None

    def fate(self, mutant: Mutant) -> str:
        """Return which test fails (or that they do not end); nothing if none does."""
        tests = self.tests_of(mutant)
        file = self.root / "conflictdb" / file_of(mutant.module)
        source = file.read_bytes()
        assert source[mutant.start : mutant.end].decode() == mutant.old, "the tree has changed since"
        changed = source[: mutant.start] + mutant.new.encode() + source[mutant.end :]
        limit_s = LONGER_S + int(TIMES * sum(self._seconds[test] for test in tests))
        if self._needs_import(mutant):
            file.write_bytes(changed)
            try:
                killer = self._imported(tests, limit_s)
            finally:
                file.write_bytes(source)
        else:
            killer = self._swapped(mutant, changed, tests, limit_s)
        self._killers[killer] += 1
        return killer

    def _imported(self, tests: list[str], limit_s: int) -> str:
        """Run tests in a fresh process, on the modules as they are in the files."""
        (self.root / "tests.txt").write_text("".join(f"{test}\n" for test in tests))
        # Two mutants in the same second would share the compiled file of the first.
        environment = {**os.environ, "PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *PYTEST, "-x", "-m", "", "@tests.txt"],
            cwd=self.root,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 1)),
        )
        failed = [line.split()[1] for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        if not failed and done.returncode > 0:
            sys.exit(f"pytest ended with {done.returncode}, and no test had failed:\n{done.stdout[-3000:]}")
        return failed[0] if failed else "does not end" * bool(done.returncode)

    def _swapped(self, mutant: Mutant, changed: bytes, tests: list[str], limit_s: int) -> str:
        """Run tests in a fork, where the function has the code of the mutant: nothing has to be loaded again."""
        function, code = function_of(mutant), code_of(mutant, changed)
        child = os.fork()
        if child == 0:
            ended = len(tests) + 1
            try:
                resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 1))
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, 1)
                os.dup2(nowhere, 2)
                function.__code__ = code
                ended = next((k for k, test in enumerate(tests) if fails(self._tests[test])), len(tests))
            finally:
                (self.root / "ended.txt").write_text(str(ended))
                os._exit(0)
        (self.root / "ended.txt").unlink(missing_ok=True)
        if os.waitpid(child, 0)[1]:
            return "does not end"
        ended = int((self.root / "ended.txt").read_text())
        if ended > len(tests):
            sys.exit(f"{mutant.name} could not be run")
        return [*tests, ""][ended]


def function_of(mutant: Mutant) -> Any:
    """Return the loaded function that contains a mutant; None for code that runs on import."""
    found: Any = sys.modules[f"conflictdb.{mutant.module}"]
    for name in mutant.within.split("."):
        found = vars(found).get(name)
        if not isinstance(found, type):
            break
    for wrapper in ("fget", "__func__", "func", "__wrapped__"):
        found = getattr(found, wrapper, found)
    return found if isinstance(found, FunctionType) else None


def code_of(mutant: Mutant, changed: bytes) -> CodeType:
    """Return the code of that function in the changed source."""
    name, file = function_of(mutant).__qualname__, str(sys.modules[f"conflictdb.{mutant.module}"].__file__)
    left = [compile(changed, file, "exec")]
    while left:
        code = left.pop()
        if code.co_qualname == name:
            return code
        left += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    raise LookupError(name)


def copied(root: Path) -> None:
    """Copy the files of the tree, also those that are new."""
    git = ("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "--deduplicate")
    for name in subprocess.run(git, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0"):
        if (ROOT / name).is_file():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, root / name)


def tell(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def known() -> dict[str, str]:
    """Return the mutants that change no answer, and why."""
    entries = tomllib.loads(Path(__file__).with_name("mutants.toml").read_text())["equivalent"]
    return {entry["mutant"]: entry["reason"] for entry in entries}


def drawn(root: Path, modules: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Return at most `count` mutants, drawn with equal probability."""
    found = [mutant for module in modules for mutant in sites(root, module)]
    return random.Random(seed).sample(found, min(count, len(found)))  # noqa: S311 - chance, not secrecy


def again(root: Path, file: Path) -> list[Mutant]:
    """Return the mutants of an earlier run that still exist, wherever their lines have moved."""
    names = Counter(json.loads(file.read_text()))
    every = [mutant for module in MODULES for mutant in sites(root, module)]
    return [mutant for mutant in every if mutant.name in names]


def run(bench: Bench, mutants: Sequence[Mutant]) -> list[Mutant]:
    """Return the mutants that no test notices and mutants.toml does not list; print all."""
    reasons, survivors, record = known(), [], bench.root / "killed.json"
    dead: dict[str, str] = json.loads(record.read_text()) if record.exists() else {}
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for k, mutant in enumerate(mutants, 1):
        started = time.perf_counter()
        killer = "" if mutant.name in reasons else dead.get(mutant.name) or bench.fate(mutant)
        kind = "killed" if killer else "equivalent" if mutant.name in reasons else "survived"
        counts[mutant.module][kind] += 1
        if killer:
            dead[mutant.name] = killer
            record.write_text(json.dumps(dead, indent=1))
        if kind == "survived":
            survivors.append(mutant)
            killer = f"{len(bench.tests_of(mutant))} tests reach it"
        took_s = time.perf_counter() - started
        where = f"{file_of(mutant.module)}:{mutant.line}"
        tell(f"{k}/{len(mutants)} {kind:10} {took_s:5.1f} s  {where}  {mutant.name}  {killer}")
    tell("\n| module | mutants | killed | equivalent | survived |\n|---|---|---|---|---|")
    for module, count in sorted(counts.items()):
        kinds = " | ".join(str(count[kind]) for kind in ("killed", "equivalent", "survived"))
        tell(f"| `{module}` | {count.total()} | {kinds} |")
    return survivors


def main() -> int:
    """Mutate as the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="directory of the copy, the reach and the survivors (default: new)")
    parser.add_argument("--again", type=Path, help="the survivors of an earlier run instead of new mutants")
    parser.add_argument("module", nargs="*", default=MODULES)
    options = parser.parse_args()
    keep = (options.keep or Path(tempfile.mkdtemp(prefix="mutants-"))).resolve()
    keep.mkdir(parents=True, exist_ok=True)
    copied(keep)
    os.chdir(keep)
    sys.path.insert(0, str(keep))
    survivors: list[Mutant] = []

    def work(bench: Bench) -> None:
        some = again(keep, options.again) if options.again else drawn(keep, options.module, options.count, options.seed)
        survivors.extend(run(bench, some))

    code = pytest.main([*PYTEST, "-s", "-m", "not slow and not db", *TESTS], plugins=[Bench(keep, work)])
    if code:
        return int(code)
    (keep / "survivors.json").write_text(json.dumps([mutant.name for mutant in survivors], indent=1))
    own = {name for name in known() if not name.startswith("kernel/")}
    for name in sorted(own - {mutant.name for module in MODULES for mutant in sites(keep, module)}):
        tell(f"mutants.toml explains what is no longer there: {name}")
    for mutant in survivors:
        tell(f"\nconflictdb/{file_of(mutant.module)}:{mutant.line}\n- {mutant.old}\n+ {mutant.new}")
    return int(bool(survivors))


if __name__ == "__main__":
    sys.exit(main())
