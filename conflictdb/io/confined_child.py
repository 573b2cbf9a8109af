"""Runs a program that reads files of others, as a process that can do little else.

Files refer to others and to addresses, what is compressed or coded may unpack to any size, and the libraries that
read them are in C and C++. So this process has an environment of its own, cannot write files, and may
use only so much memory and time; `confined` starts it, gives it its limits and reads what it says. It imports nothing
of the package, which takes longer than reading a file.

    confined_child.py PROGRAM MOST_BYTES MOST_MEMORY_BYTES MOST_SECONDS [ARGUMENT...]

The program is a file with a function ``main(stream, most_bytes, arguments)``. It writes what it read to the stream,
which is stdout, and raises MemoryError where that is more than so many bytes. What is wrong is told in the last line of
stderr as JSON: ``too_large`` or ``refused``. Nothing else is there: whoever reads stdout as it comes reads stderr after
it, and a pipe that is full would let both wait for ever.
"""

import json
import os
import resource
import runpy
import sys

# Characters of what is wrong: a pipe holds as many.
_MOST_SAID = 2_000


def main(program: str, most_bytes: int, most_memory_bytes: int, most_seconds: int, arguments: list[str]) -> str:
    """Run a program; return what is wrong, empty if nothing is."""
    for what, most in (
        (resource.RLIMIT_AS, most_memory_bytes),
        (resource.RLIMIT_CPU, most_seconds),
        (resource.RLIMIT_FSIZE, 0),  # of regular files; a pipe is none
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    try:
        runpy.run_path(program)["main"](sys.stdout.buffer, most_bytes, arguments)
    except MemoryError:
        return json.dumps({"too_large": True})
    except Exception as error:  # whatever it is, this file cannot be read
        return json.dumps({"refused": str(error)[:_MOST_SAID]})
    return ""


if __name__ == "__main__":
    program, most_bytes, most_memory_bytes, most_seconds, *arguments = sys.argv[1:]
    said = os.dup(2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what libraries say
    wrong = main(program, int(most_bytes), int(most_memory_bytes), int(most_seconds), arguments)
    if wrong:
        os.write(said, f"\n{wrong}".encode())
        sys.exit(1)
