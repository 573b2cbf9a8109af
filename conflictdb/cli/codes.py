"""Exit codes of the command line."""

from typing import Final

DONE: Final = 0
FAILED: Final = 1
USAGE: Final = 2
SCHEMA_MISMATCH: Final = 3
INPUT_REFUSED: Final = 4
NO_SERVER: Final = 5
LEFT_OUT: Final = 6
NOT_CURRENT: Final = 7
CONFLICTS_FOUND: Final = 10
INTERRUPTED: Final = 130  # as shells report a program ended by SIGINT
TERMINATED: Final = 143  # the same for SIGTERM

MEANING: Final = {
    DONE: "done",
    FAILED: "failed",
    USAGE: "usage: an option or argument is wrong, or Spark, which was asked for, does not run here",
    SCHEMA_MISMATCH: "the schema is missing, older or newer than the program",
    INPUT_REFUSED: "input refused; nothing was changed",
    NO_SERVER: "no usable PostgreSQL with PostGIS",
    LEFT_OUT: "done, but objects were left out (--skip-invalid)",
    NOT_CURRENT: "the answer may lack conflicts: the scene was never detected, or changed since, or "
    "schedules are not expanded so far (--require-current, --wait); or no worker answered in time",
    CONFLICTS_FOUND: "there are conflicts (--fail-on-conflict)",
    INTERRUPTED: "interrupted (Ctrl-C, SIGINT)",
    TERMINATED: "terminated (SIGTERM)",
}
