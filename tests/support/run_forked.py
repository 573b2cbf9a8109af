"""Runs a program by what forks programs (forked.py), and ends as it does; imports little, as it starts each time.

python -I -S run_forked.py ADDRESS PROGRAM ARGUMENT…    PROGRAM is `conflictdb` or a script of Python
"""

import os
import signal
import socket
import sys


def main(address: str, *words: str) -> int:
    """Have a program forked, pass on signals, and return its exit code."""
    environ = [f"{name}={value}" for name, value in os.environ.items()]
    message = "\0".join([os.getcwd(), str(len(words)), *words, *environ]).encode("utf-8", "surrogateescape")  # noqa: PTH109
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(address)
        socket.send_fds(connection, [len(message).to_bytes(4, "big")], [0, 1, 2])
        connection.sendall(message)
        with connection.makefile("r") as answers:
            pid = int(answers.readline())
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda number, _: os.kill(pid, number))
            return int(answers.readline())


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
