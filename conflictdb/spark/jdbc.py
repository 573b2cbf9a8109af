"""Read a scene of a database on Spark: workers read parts of its objects through JDBC, all in one snapshot.

Each part has its own connection and transaction. They import the snapshot of one transaction of this process, which
stays open as long as Spark may read again. A row read in another state is an error.
"""

import logging
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial, reduce
from itertools import pairwise
from typing import Any, Final
from urllib.parse import quote

import psycopg
import pyarrow as pa
from pyspark.sql import DataFrame, SparkSession
from pyspark.sql.pandas.types import from_arrow_schema
from pyspark.storagelevel import StorageLevel

from conflictdb import store
from conflictdb.arrays.arrow.columns import numbers
from conflictdb.arrays.arrow.object_rows import OBJECTS, of_objects
from conflictdb.errors import StoreError
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind
from conflictdb.spark.engine import DRIVER, errors_in_one_line, with_driver
from conflictdb.spark.on_cluster import mapped

# Most connections at a time for areas, and for tracks, and least objects for each.
_MOST_PARTS: Final = 16
_LEAST_OBJECTS: Final = 20_000
# Rows fetched at a time.
_ROWS_AT_ONCE: Final = 1_000
# Options with the same name in libpq and the JDBC driver.
_ALIKE: Final = ("sslmode", "sslrootcert", "sslcert", "sslkey", "options")


def is_reached_by_network(conn: psycopg.Connection[Any]) -> bool:
    """Return whether Java can connect likewise: the JDBC driver has no Unix sockets."""
    host = conn.info.host
    return bool(conn.info.hostaddr or host) and not host.startswith(("/", "@"))


@contextmanager
def scene_objects(spark: SparkSession, conn: psycopg.Connection[Any], scene: str) -> Iterator[tuple[Scene, DataFrame]]:
    """Yield the settings and the objects of a scene of a database, in one snapshot.

    Objects are rows of the Arrow form OBJECTS, without names and properties, for `detect_on_spark`. They are read at
    once and cached by Spark until the block ends. Until then a transaction stays open on the connection.

    Parameters
    ----------
    conn : psycopg connection without an open transaction, over the network; executors connect likewise
    scene : a scene that its user may read

    Raises
    ------
    EngineMissing
        The JDBC driver is missing.
    InvalidInput
        The scene does not exist.
    StoreError
        Executors cannot read the database, or the connection uses a socket.
    """
    with_driver(spark)
    if not is_reached_by_network(conn):
        raise StoreError(f"database {conn.info.dbname!r} is reached by a socket, which Java does not know: name a host")
    with store.shared_snapshot(conn) as shared:
        number = store.scene_id(conn, scene)
        settings = store.read_settings(conn, number)
        of_kinds = [of for kind in Kind if (of := _objects(spark, conn, number, kind, shared)) is not None]
        none = spark.createDataFrame([], from_arrow_schema(OBJECTS.schema))
        objects = (reduce(DataFrame.unionAll, of_kinds) if of_kinds else none).persist(StorageLevel.MEMORY_AND_DISK)
        try:
            with _readable_errors(conn, scene):
                objects.count()
            yield settings, objects
        finally:
            objects.unpersist()


def _objects(
    spark: SparkSession, conn: psycopg.Connection[Any], scene_id: int, kind: Kind, shared: store.Shared
) -> DataFrame | None:
    """Return the objects of a kind, None if there are none."""
    first = store.firsts(conn, scene_id, kind, _LEAST_OBJECTS)
    if not first:
        return None
    first = first[:: -(-len(first) // _MOST_PARTS)]
    parts = [f"object_id >= {begin} AND object_id < {end}" for begin, end in pairwise(first)]
    parts.append(f"object_id >= {first[-1]}")
    url, properties = _as_java_connects(conn)
    properties |= {"sessionInitStatement": shared.begin, "fetchsize": str(_ROWS_AT_ONCE)}
    with _readable_errors(conn, f"number {scene_id}"), _unheard():
        rows = spark.read.jdbc(url, f"({store.query(scene_id, kind)}) objects", predicates=parts, properties=properties)
    return mapped(rows, partial(_read, kind=kind, shared=shared), OBJECTS.schema)


def _as_java_connects(conn: psycopg.Connection[Any]) -> tuple[str, dict[str, str]]:
    """Return the JDBC URL of a database, and the connection properties."""
    info, parameters = conn.info, conn.info.get_parameters()
    host = info.host or info.hostaddr
    host = f"[{host}]" if ":" in host else host
    properties = {"driver": DRIVER, "user": info.user, "ApplicationName": "conflictdb"}
    properties |= {"password": info.password} if info.password else {}
    properties |= {name: parameters[name] for name in _ALIKE if parameters.get(name)}
    return f"jdbc:postgresql://{host}:{info.port}/{quote(info.dbname, safe='')}", properties


def _read(batches: Iterable[pa.RecordBatch], kind: Kind, shared: store.Shared) -> Iterator[pa.RecordBatch]:
    for batch in batches:
        store.require_state(batch.column("state").unique().to_pylist(), shared)
        columns, strings = {}, {}
        for name in set(batch.schema.names) - {"state"}:
            column = batch.column(name)
            if pa.types.is_binary(column.type):
                strings[name] = column.to_pylist()
            else:
                columns[name] = numbers(column)
        of = store.numbered(kind, columns, strings)
        yield of_objects(of.areas, of.tracks, of.object_id, of.version)


@contextmanager
def _unheard() -> Iterator[None]:
    """Keep calls to Java, which contain a password, out of the log."""
    loggers = [logging.getLogger(name) for name in ("py4j", "py4j.clientserver", "py4j.java_gateway")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _readable_errors(conn: psycopg.Connection[Any], scene: str) -> AbstractContextManager[None]:
    """Convert errors of reading to one line."""
    where = f"{conn.info.dbname!r} on {conn.info.host}"
    return errors_in_one_line(StoreError, f"Spark cannot read scene {scene} of database {where}")
