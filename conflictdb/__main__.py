"""`python -m conflictdb` is the command `conflictdb`."""

import sys

from conflictdb.cli import main

if __name__ == "__main__":
    sys.exit(main())
