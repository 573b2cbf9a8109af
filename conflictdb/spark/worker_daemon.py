"""Fork Spark's Python workers on this machine from one process that has imported what their tasks need.

Spark runs it as a module (option ``spark.python.daemon.module``).
"""

import gc
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Final

# Beginnings of the names of archives that Spark adds to the path.
_ARCHIVES: Final = ("pyspark.zip", "py4j-", "spark-core_")


def _prefer_installed_packages() -> None:
    """Remove Spark's archives from the path of modules, if pyspark is installed as well."""
    path = list(sys.path)
    sys.path[:] = [one for one in path if not Path(one).name.startswith(_ARCHIVES)]
    if find_spec("pyspark") is None or find_spec("py4j") is None:
        sys.path[:] = path
    for one in set(sys.path_importer_cache).difference(sys.path):
        if Path(one).name.startswith(_ARCHIVES):
            del sys.path_importer_cache[one]


def _main() -> None:
    _prefer_installed_packages()
    from pyspark import daemon
    from pyspark.sql.pandas.utils import require_minimum_pandas_version, require_minimum_pyarrow_version

    import conflictdb.spark.on_cluster  # noqa: F401  # all that tasks need

    # Each worker calls them before its first task; they import a hundred modules to compare versions.
    require_minimum_pandas_version()
    require_minimum_pyarrow_version()
    gc.freeze()  # shared by the workers: neither searched for garbage nor copied
    serve: Callable[[], None] = daemon.manager
    serve()


if __name__ == "__main__":
    _main()
