"""Run a reader of untrusted files in a process with restricted rights.

Files may refer to other files and addresses, compressed data may unpack to any size, and the parsing libraries are in C
and C++. This process therefore has its own environment, cannot write files, and has limits on memory and processor
time. `confined` starts it, sets the limits and reads its messages.

    confined_child.py PROGRAM MOST_BYTES MOST_MEMORY_BYTES MOST_SECONDS [ARGUMENT...]

The program is a file with a function ``main(stream, most_bytes, arguments)``. It writes its result to the stream, which
is stdout, and raises MemoryError above `most_bytes`. The last line of stderr reports an error as JSON: ``too_large`` or
``refused``. Nothing else is written to stderr: the parent reads stderr after stdout, so a full pipe would deadlock
both.
"""

import json
import os
import resource
import runpy
import sys

# Characters of an error message: fewer than a pipe buffers.
_MOST_MESSAGE = 2_000


def main(program: str, most_bytes: int, most_memory_bytes: int, most_seconds: int, arguments: list[str]) -> str:
    """Run a program; return the error as JSON, empty if there is none."""
    for what, most in (
        (resource.RLIMIT_AS, most_memory_bytes),
        (resource.RLIMIT_CPU, most_seconds),
        (resource.RLIMIT_FSIZE, 0),  # regular files only, pipes are not limited
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    try:
        runpy.run_path(program)["main"](sys.stdout.buffer, most_bytes, arguments)
    except MemoryError:
        return json.dumps({"too_large": True})
    except Exception as error:  # any error means that the file cannot be read
        return json.dumps({"refused": str(error)[:_MOST_MESSAGE]})
    return ""


if __name__ == "__main__":
    program, most_bytes, most_memory_bytes, most_seconds, *arguments = sys.argv[1:]
    stderr = os.dup(2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # discard output of libraries
    wrong = main(program, int(most_bytes), int(most_memory_bytes), int(most_seconds), arguments)
    if wrong:
        os.write(stderr, f"\n{wrong}".encode())
        sys.exit(1)
