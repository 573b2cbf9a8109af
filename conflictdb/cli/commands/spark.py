"""Commands on Apache Spark."""

from typing import Any

from conflictdb.cli.parser import Parser, add_lock_timeout, add_memory, add_settings, command
from conflictdb.cli.values import count, name, option, speed_kn
from conflictdb.model.settings import SETTINGS


def add(commands: Any) -> None:
    """Add `spark` with its own commands."""
    parser: Parser = commands.add_parser(
        "spark",
        help="detect scenes that outgrow one machine, on Apache Spark",
        description="Scenes that outgrow one machine, by the same stages on Apache Spark with Apache Sedona. Needs "
        "Java 17 and the extra `spark`.",
        allow_abbrev=False,
    )
    on_spark = parser.add_subparsers(title="commands", dest="spark_command", required=True, metavar="COMMAND")
    parser = command(
        on_spark,
        "detect",
        "on_spark:detect",
        "find the conflicts of a scene of the database, or of objects in GeoParquet files, and write them to files",
        "The rows are those of `conflictdb detect` on the same objects and settings.",
    )
    parser.add_argument(
        "--input",
        nargs="+",
        metavar="PATH",
        help="GeoParquet files of objects, as `conflictdb export` writes them, or directories of them: any path, URI "
        "or glob that Spark can read (default: the scene of the database)",
    )
    parser.add_argument("--output", required=True, metavar="PATH", help="directory of GeoParquet to write, a new one")
    parser.add_argument("--overwrite", action="store_true", help="replace the output of an earlier `spark detect`")
    _add_spark(parser)
    parser.add_argument(
        "--max-speed-kn", type=speed_kn, metavar="KN", help="of files: faster tracks are refused (default 2000)"
    )
    parser.add_argument(
        "--scene",
        type=name,
        metavar="NAME",
        help="scene of the database, whose settings it has unless others are given; of files the name (default: as "
        "the first file says, as it says all settings if it was exported)",
    )
    add_settings(parser, SETTINGS)
    parser.add_argument(
        "--partitions", type=count, metavar="N", help="of pieces and of pairs (default: four per processor)"
    )
    add_memory(parser)
    parser = command(
        on_spark,
        "write-back",
        "on_spark:write_back",
        "write the conflicts that Spark found into the scene that its objects were exported from",
        "In one transaction; again, it changes nothing. Objects that have changed since wait for a detection. Needs no "
        "Spark.",
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to write into")
    parser.add_argument("file", metavar="PATH", help="what `conflictdb spark detect --output PATH` wrote")
    add_lock_timeout(parser, "wait no longer for a detection of the scene, or any other lock")
    parser = command(
        on_spark,
        "demo",
        "on_spark:demo",
        "take the scene that comes with the program through Spark, and compare",
        "Compares the answer with that of one machine; needs no database.",
    )
    _add_spark(parser)


def _add_spark(parser: Parser) -> None:
    parser.add_argument(
        "--master",
        metavar="URL",
        help="where Spark runs: local[4], spark://host:7077, … (default: all processors of this machine, or what "
        "spark-submit says)",
    )
    parser.add_argument(
        "--conf",
        action="append",
        type=option,
        metavar="KEY=VALUE",
        help="a setting of Spark, such as spark.driver.memory=8g; repeat it for more",
    )
