"""Promises of the tree: names that describe the content, SQL in one place, and a command line that starts at once."""

import re
import subprocess
import sys
from pathlib import Path

import conflictdb

PACKAGE = Path(conflictdb.__file__).parent
SOURCES = sorted(PACKAGE.rglob("*.py"))
# The only places that talk to a database. The server's own programs are run there too.
WITH_SQL = ("db/store/", "db/schema.py", "server/")


def test_no_module_is_named_after_nothing() -> None:
    """A module called utils collects code without a better place."""
    vague = re.compile(r"util|helper|common|misc", re.IGNORECASE)
    assert [path for path in SOURCES if vague.search(str(path.relative_to(PACKAGE)))] == []


def test_sql_is_run_only_by_store_schema_and_server() -> None:
    offenders = [
        str(path.relative_to(PACKAGE))
        for path in SOURCES
        if not path.relative_to(PACKAGE).as_posix().startswith(WITH_SQL)
        and re.search(r"\.(execute|executemany|exec_driver_sql)\(", path.read_text())
    ]
    assert offenders == []


def test_only_the_command_line_and_the_server_settings_read_the_environment() -> None:
    readers = {
        path.relative_to(PACKAGE).parts[0] for path in SOURCES if re.search(r"os\.(environ|getenv)\b", path.read_text())
    }
    assert readers <= {"cli", "server"}


def test_help_waits_for_no_library() -> None:
    script = (
        "import sys\nfrom conflictdb.cli import main\n"
        "try:\n    main(['detect', '--help'])\nexcept SystemExit:\n    pass\n"
        "print(sorted({'numpy', 'scipy', 'shapely', 'psycopg', 'alembic', 'sqlalchemy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "[]"


def test_everything_public_can_be_imported() -> None:
    for name in conflictdb.__all__:
        assert getattr(conflictdb, name) is not None
    assert set(conflictdb.__all__) <= set(dir(conflictdb))
