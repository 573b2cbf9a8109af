"""Commands on Apache Spark."""

from typing import Any

from conflictdb.cli.parser import Parser, add_options, add_settings, command
from conflictdb.cli.values import count, name, option, speed_kn
from conflictdb.model.settings import SETTINGS


def add(commands: Any) -> None:
    """Add `spark` with its own commands."""
    about = "The same stages on Apache Spark. Needs Java 17 and the extra `spark`."
    parser: Parser = commands.add_parser("spark", help="detect on Apache Spark", description=about)
    on_spark = parser.add_subparsers(title="commands", dest="spark_command", required=True, metavar="COMMAND")

    parser = command(on_spark, "detect", "on_spark:detect", "detect, and write the conflicts to files")
    about = "GeoParquet that `export` wrote (default: the database)"
    parser.add_argument("--input", nargs="+", metavar="PATH", help=about)
    parser.add_argument("--output", required=True, metavar="PATH", help="new directory of GeoParquet")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier output")
    _add_engine(parser)
    parser.add_argument("--max-speed-kn", type=speed_kn, metavar="SPEED", help="refuse faster tracks (default 2000)")
    parser.add_argument("--scene", type=name, metavar="NAME", help="scene to detect (default: named by the file)")
    add_settings(parser, SETTINGS)
    parser.add_argument("--partitions", type=count, metavar="N", help="parts of the work (default: four per processor)")
    add_options(parser, "--memory-mb")

    about = "write conflicts that Spark found into their scene"
    more = "In one transaction. Objects changed since wait for a detection."
    parser = command(on_spark, "write-back", "on_spark:write_back", about, more)
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="name of the scene")
    parser.add_argument("file", metavar="PATH", help="directory that `spark detect` wrote")
    add_options(parser, "--lock-timeout")

    parser = command(on_spark, "demo", "on_spark:demo", "compare Spark with one machine on a small scene")
    _add_engine(parser)


def _add_engine(parser: Parser) -> None:
    parser.add_argument(
        "--master", metavar="URL", help="Spark master: local[4], spark://host:7077, … (default: this machine)"
    )
    parser.add_argument("--conf", action="append", type=option, metavar="KEY=VALUE", help="Spark setting; repeatable")
