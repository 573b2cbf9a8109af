"""Promises of the tree: names that describe the content, SQL in one place, and a command line that starts at once."""

import re
import subprocess
import sys
from pathlib import Path

from patience import WAIT_S

import conflictdb

PACKAGE = Path(conflictdb.__file__).parent
SOURCES = sorted(PACKAGE.rglob("*.py"))
# The only places that talk to a database. The server's own programs are run there too.
WITH_SQL = ("store/", "jobs/schema.py", "embedded/")


def test_no_module_is_named_after_nothing() -> None:
    """A module called utils collects code without a better place."""
    vague = re.compile(r"util|helper|common|misc", re.IGNORECASE)
    assert [path for path in SOURCES if vague.search(str(path.relative_to(PACKAGE)))] == []


def test_sql_is_run_only_by_store_schema_and_embedded() -> None:
    offenders = [
        str(path.relative_to(PACKAGE))
        for path in SOURCES
        if not path.relative_to(PACKAGE).as_posix().startswith(WITH_SQL)
        and re.search(r"(?<!layout_engine\(\))\.(execute|executemany|exec_driver_sql)\(", path.read_text())
    ]
    assert offenders == []


def test_only_the_command_line_and_the_server_settings_read_the_environment() -> None:
    readers = {
        path.relative_to(PACKAGE).parts[0] for path in SOURCES if re.search(r"os\.(environ|getenv)\b", path.read_text())
    }
    assert readers <= {"cli", "embedded"}


# Libraries, and modules of Python that take as long to import as all of the help.
_NOT_FOR_HELP = {"numpy", "scipy", "shapely", "psycopg", "alembic", "sqlalchemy"} | {
    *("dataclasses", "email", "importlib.metadata", "inspect", "logging", "sysconfig", "zoneinfo"),
}


def test_help_waits_for_no_library() -> None:
    script = (
        "import sys\nfrom conflictdb.cli import main\n"
        "try:\n    main(['detect', '--help'])\nexcept SystemExit:\n    pass\n"
        f"print(sorted({_NOT_FOR_HELP!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=WAIT_S)
    assert done.stdout.splitlines()[-1] == "[]"


def test_commands_import_what_they_need() -> None:
    """Each module with commands may be the first, in a program that has no other module of conflictdb."""
    texts = [path.read_text() for path in (PACKAGE / "cli" / "commands").glob("*.py")]
    modules = sorted({name for text in texts for name in re.findall(r'"(\w+):\w+"', text)})
    assert "detecting" in modules
    script = (
        "import importlib, os, sys\n"
        "import alembic, numpy, psycopg, pyarrow.parquet, scipy, shapely, sqlalchemy\n"  # once for all
        "failed = 0\n"
        "for name in sys.argv[1:]:\n"
        "    if os.fork() == 0:\n"
        "        importlib.import_module(name)\n"
        "        os._exit(0)\n"
        "    failed |= os.wait()[1]\n"
        "sys.exit(failed != 0)"
    )
    command = [sys.executable, "-c", script, *(f"conflictdb.cli.{name}" for name in modules)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")


def test_everything_public_can_be_imported() -> None:
    for name in conflictdb.__all__:
        assert getattr(conflictdb, name) is not None
    assert set(conflictdb.__all__) <= set(dir(conflictdb))
