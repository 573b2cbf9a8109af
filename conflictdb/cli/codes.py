"""Exit codes of the command line."""

from typing import Final

DONE: Final = 0
FAILED: Final = 1
USAGE: Final = 2
SCHEMA_UNFIT: Final = 3
INPUT_REFUSED: Final = 4
NO_SERVER: Final = 5
LEFT_OUT: Final = 6
CONFLICTS_FOUND: Final = 10
INTERRUPTED: Final = 130  # as shells report a program that SIGINT ended
TERMINATED: Final = 143  # the same for SIGTERM
