"""Fuzz the kernel and the readers of files, guided by coverage.

    ./run fuzz                                # ten minutes each for eight groups
    ./run fuzz narrow xml --minutes 2         # some groups

Groups of the kernel: planes, broad, narrow, bytes. libFuzzer chooses the numbers that `support/hostile_kernel.c` draws,
under address and undefined-behaviour sanitizers. It needs clang with its runtime (Debian: clang libclang-rt-dev).

Groups of readers: json, xml, text, tables. Files of each format (`support/whole_files.py`, and the corpus) are changed:
a token, some bytes, a part of another file. Files that reach new lines are changed further. A reader must return, or
raise a ConflictDBError, within some seconds of processor time.

Prints for each group how many inputs were tried, and what was found. Inputs that reach something new are kept in
--keep; inputs that fail are written there, too, and the exit status is 1. An input that shows a fault goes into
tests/fuzz/corpus, with the mend: tests/fuzz/test_corpus.py plays all of it in each run of the tests.
"""

import argparse
import hashlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support"), str(Path(__file__).resolve().parents[2])]

from whole_files import WHOLE

from conflictdb import ConflictDBError, read
from conflictdb.formats import FileHints
from conflictdb.kernel import build

HERE: Final = Path(__file__).resolve().parent
SUPPORT: Final = HERE.parent / "support"
CORPUS: Final = HERE / "corpus"
# As `about` of hostile_kernel.c.
KERNEL: Final = {"planes": 1, "broad": 2, "narrow": 4, "bytes": 8}
# By the endings of their files.
READERS: Final = {
    "json": (".geojson", ".mfjson", ".json"),
    "xml": (".gpx", ".rtz", ".s421", ".gml", ".xml", ".kml"),
    "text": (".notam", ".openair"),
    "tables": (".csv",),
}
GROUPS: Final = (*KERNEL, *READERS)
SANITIZERS: Final = ("-DKERNEL_DEBUG", "-g", "-O1", "-fno-sanitize-recover=all")
LONGEST_BYTES: Final = 4096
# Longer for one file of some kilobytes is a fault; seconds of a processor.
SLOW_S: Final = 10.0
# Of an input of the kernel under sanitizers, on a machine that has other work, seconds: libFuzzer calls it slow.
TIMEOUT_S: Final = 300
TOKEN: Final = re.compile(rb"[A-Za-z_]+|-?\d+(?:\.\d+)?|[<>/=\"':.{}\[\],]")
ODD: Final = (
    *(b"", b"-1", b"1e999", b"nan", b"999999999999999999999", b"x", "é".encode(), b"0", b"<a/>", b"2026", b"-"),
    *(b"null", b"[]", b"{}", b'"', b"\x00", b"1e-320", b"180", b"-90.0000001", b"2026-13-45T25:61:61Z", b"\xff"),
)
HINTS: Final = FileHints(unbounded_heights=True)


def tell(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def compiled(group: str, folder: Path, compiler: str, *flags: str) -> Path:
    """Return a program of the target of a group of the kernel."""
    program = folder / f"{group}-{Path(compiler).name}"
    files = [str(path) for path in build.sources() if path.suffix == ".c"]
    usual = [flag for flag in build.FLAGS if not flag.startswith("-O")]
    target = [f"-I{SUPPORT}", f"-DABOUT={KERNEL[group]}", "-o", str(program), str(HERE / "kernel_target.c")]
    subprocess.run([compiler, *usual, *SANITIZERS, *flags, *target, *files, "-lm"], check=True)
    return program


def clang() -> str | None:
    """Return a compiler that has libFuzzer."""
    names = ["clang", *(f"clang-{version}" for version in range(22, 13, -1))]
    return next(filter(None, map(shutil.which, names)), None)


def corpus_of(group: str) -> list[Path]:
    """Return the files of the corpus, in order."""
    return sorted((CORPUS / group).glob("*"))


def fuzz_kernel(group: str, minutes: float, keep: Path) -> list[str]:
    """Fuzz a group of the kernel; return what was found."""
    compiler = clang()
    if compiler is None:
        sys.exit("fuzz: the groups of the kernel need clang with libFuzzer (Debian: clang libclang-rt-dev)")
    program = compiled(group, keep, compiler, "-fsanitize=fuzzer,address,undefined")
    own, found = keep / group, keep / f"{group}-found"
    own.mkdir(exist_ok=True)
    found.mkdir(exist_ok=True)
    options = [f"-max_total_time={round(60 * minutes)}", f"-max_len={LONGEST_BYTES}", f"-timeout={TIMEOUT_S}"]
    options += ["-len_control=0", "-report_slow_units=60", "-print_final_stats=1", f"-artifact_prefix={found}/"]
    done = subprocess.run(
        [program, *options, own, *([CORPUS / group] if (CORPUS / group).is_dir() else [])],
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        check=False,
    )
    tried = re.findall(r"number_of_executed_units: (\d+)", done.stderr)
    reached = re.findall(r"cov: (\d+)", done.stderr)
    tell(f"{group}: {int(tried[-1]) if tried else 0:,} inputs, {reached[-1] if reached else 0} branches")
    failed = [f"{group}: {path}" for path in sorted(found.glob("[!s]*"))]
    return failed + ([] if done.returncode == 0 or failed else [f"{group}: {done.stderr[-2000:]}"])


class Lines:
    """The lines of the readers that a call reaches."""

    def __init__(self) -> None:
        package = HERE.parents[1] / "conflictdb"
        self._folders = tuple(str(package / name) for name in ("formats", "exchange", "model"))
        self._left: dict[CodeType, set[int]] = {}
        self.count = 0

    def _enter(self, frame: FrameType, event: str, _: Any) -> Any:
        code = frame.f_code
        if not code.co_filename.startswith(self._folders):
            return None
        if code not in self._left:
            self._left[code] = {line for *_, line in code.co_lines() if line}
        return self._line if self._left[code] else None

    def _line(self, frame: FrameType, event: str, _: Any) -> Any:
        left = self._left[frame.f_code]
        if event == "line" and frame.f_lineno in left:
            left.discard(frame.f_lineno)
            self.count += 1
        return self._line if left else None

    def new(self, path: Path) -> tuple[int, str]:
        """Read a file; return how many lines it is the first to reach, and what is wrong."""
        before, began = self.count, time.process_time()
        sys.settrace(self._enter)
        try:
            wrong = fault(path)
        finally:
            sys.settrace(None)
        if time.process_time() - began > SLOW_S:
            wrong = wrong or f"took {time.process_time() - began:.0f} s"
        return self.count - before, wrong


def fault(path: Path) -> str:
    """Return what is wrong with how a file is read; empty: nothing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path, hints=HINTS)
    except ConflictDBError:
        return ""
    except Exception:
        return traceback.format_exc(limit=-3)
    return ""


def whole(group: str) -> dict[str, bytes]:
    """Return the files of the formats of a group, by name."""
    found = {name: text.encode() for name, text in WHOLE.items() if name.endswith(READERS[group])}
    return found | {path.name: path.read_bytes() for path in corpus_of(group)}


def changed(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Return a file with some changes: of tokens, of bytes, of parts."""
    for _ in range(1 + int(rng.expovariate(1.0))):
        way, at = rng.random(), rng.randrange(len(data) + 1)
        until = min(len(data), at + int(rng.expovariate(1.0 / 20.0)))
        if way < 0.6 and (tokens := list(TOKEN.finditer(data))):
            token = rng.choice(tokens)
            new = rng.choice((rng.choice(ODD), token[0] * 2, rng.choice(tokens)[0]))
            data = data[: token.start()] + new + data[token.end() :]
        elif way < 0.7:
            data = data[:at] + data[until:]
        elif way < 0.8:
            data = data[:until] + data[at:until] * rng.choice((1, 1, 2, 40)) + data[until:]
        elif way < 0.9:
            other = rng.choice(others)
            start = rng.randrange(len(other) + 1)
            data = data[:at] + other[start : start + int(rng.expovariate(1.0 / 60.0))] + data[until:]
        else:
            data = data[:at] + bytes([rng.randrange(256)]) + data[min(at + 1, len(data)) :]
    return data[: 8 * LONGEST_BYTES]


def fuzz_readers(group: str, minutes: float, keep: Path, seed: int) -> list[str]:
    """Fuzz the readers of a group; return what was found."""
    rng, lines, wrong = random.Random(seed), Lines(), dict[str, str]()  # noqa: S311 - chance, not secrecy
    pool = list(whole(group).items())
    for folder in (own := keep / group, bad := keep / f"{group}-found"):
        folder.mkdir(exist_ok=True)
    tried, ends = 0, time.monotonic() + 60.0 * minutes
    with tempfile.TemporaryDirectory() as scratch:
        first = iter(list(pool))
        while time.monotonic() < ends:
            name, data = next(first, None) or rng.choice(pool)
            if tried >= len(pool):
                data = changed(rng, data, [other for _, other in pool])
            ending = "".join(Path(name).suffixes[-1:])
            path = Path(scratch, f"a{ending}")
            path.write_bytes(data)
            more, said = lines.new(path)
            tried += 1
            new_name = f"{hashlib.sha256(data).hexdigest()[:10]}{ending}"
            if said and (last := said.strip().splitlines()[-1] + said.strip().splitlines()[-3:][0]) not in wrong:
                wrong[last] = f"{bad / new_name}\n{said}"
                (bad / new_name).write_bytes(data)
            elif more:
                pool.append((new_name, data))
                (own / new_name).write_bytes(data)
    tell(f"{group}: {tried:,} files, {lines.count:,} lines reached")
    return list(wrong.values())


def main() -> int:
    """Fuzz as the command line asks."""
    parser = argparse.ArgumentParser(
        prog="run fuzz", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("group", nargs="*", help=", ".join(GROUPS))
    parser.add_argument("--minutes", type=float, default=10.0, help="for each group")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="directory of programs and inputs (default: new)")
    args = parser.parse_args()
    if unknown := set(args.group) - set(GROUPS):
        parser.error(f"no group is called {', '.join(sorted(unknown))}; there are {', '.join(GROUPS)}")
    keep = args.keep or Path(tempfile.mkdtemp(prefix="fuzz-"))
    keep.mkdir(parents=True, exist_ok=True)
    wrong = []
    for group in args.group or GROUPS:
        if group in KERNEL:
            wrong += fuzz_kernel(group, args.minutes, keep)
        else:
            wrong += fuzz_readers(group, args.minutes, keep, args.seed)
    tell(f"inputs are in {keep}")
    tell("\n".join(wrong) if wrong else "nothing was found")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
