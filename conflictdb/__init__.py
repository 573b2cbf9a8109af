"""Which plans interfere, where, and exactly when: inside PostGIS.

>>> import conflictdb
>>> with conflictdb.connect() as db:
...     scene = db.load("exercise-7.geojson")
...     run = scene.detect(tolerance_m=1.0)
...     for conflict in scene.conflicts():
...         print(conflict.a_key, conflict.b_key, conflict.first_contact, conflict.periods)

Without a database, `read` gives the objects of a file and `solve` runs the same stages on objects in memory. `write`
makes GeoJSON, CSV or JSON of the conflicts of either.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from conflictdb.errors import (
    ConflictDBError,
    IncompleteWarning,
    InvalidInput,
    LockTimeout,
    NotCurrent,
    NotPermitted,
    ReadOnlyDatabase,
    SchemaError,
    SchemaMissing,
    SchemaOutdated,
    SchemaTooNew,
    ServerError,
    StoreError,
)
from conflictdb.exports import exports

if TYPE_CHECKING:
    __version__: str

    from conflictdb.client.advise import Advice
    from conflictdb.client.database import Database, connect
    from conflictdb.client.loading import Loaded
    from conflictdb.client.stored_scene import StoredScene
    from conflictdb.formats import (
        Contents,
        FileHints,
        Remark,
        Skipped,
        circle,
        plans_schema,
        read,
        write,
        write_scene_file,
    )
    from conflictdb.jobs import models as models
    from conflictdb.jobs.detect import Run
    from conflictdb.memory.certifying import certify
    from conflictdb.memory.detours import detours
    from conflictdb.memory.index import Index
    from conflictdb.memory.questions import chances, delays, solve, speeds
    from conflictdb.memory.resolve import resolve
    from conflictdb.model.methods import Method
    from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track, rectangle_outline_m
    from conflictdb.model.proposals import Detour, Goal, Left, Move, NewWaypoints, Passing, Proposal, Side
    from conflictdb.model.results import (
        Admission,
        Approach,
        Certified,
        Chances,
        Conflict,
        ConflictEvent,
        Delays,
        Explanation,
        Forbidden,
        ForbiddenSpeeds,
        Kind,
        Listing,
        Results,
        SceneState,
        Speeds,
        Stream,
        Verdict,
    )
    from conflictdb.model.rules import Rule
    from conflictdb.plot.departures import plot_coordination, plot_delays
    from conflictdb.plot.figures import plot_pair, plot_scene, plot_timeline

__all__ = [
    "Admission",
    "Advice",
    "Approach",
    "Area",
    "Certified",
    "Chances",
    "Conflict",
    "ConflictDBError",
    "ConflictEvent",
    "Contents",
    "Database",
    "Delays",
    "Detour",
    "EarthModel",
    "Explanation",
    "FileHints",
    "Forbidden",
    "ForbiddenSpeeds",
    "Goal",
    "IncompleteWarning",
    "Index",
    "InvalidInput",
    "Kind",
    "Left",
    "Listing",
    "Loaded",
    "LockTimeout",
    "Method",
    "Motion",
    "Move",
    "NewWaypoints",
    "NotCurrent",
    "NotPermitted",
    "Passing",
    "Proposal",
    "ReadOnlyDatabase",
    "Remark",
    "Results",
    "Rule",
    "Run",
    "Scene",
    "SceneState",
    "SchemaError",
    "SchemaMissing",
    "SchemaOutdated",
    "SchemaTooNew",
    "ServerError",
    "Side",
    "Skipped",
    "Speeds",
    "StoreError",
    "StoredScene",
    "Stream",
    "Track",
    "Verdict",
    "__version__",
    "certify",
    "chances",
    "circle",
    "connect",
    "delays",
    "detours",
    "plans_schema",
    "plot_coordination",
    "plot_delays",
    "plot_pair",
    "plot_scene",
    "plot_timeline",
    "read",
    "rectangle_outline_m",
    "resolve",
    "solve",
    "speeds",
    "write",
    "write_scene_file",
]

_offered = exports(__name__, __file__)  # `conflictdb --help` need not wait for numpy, shapely and the database driver


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name == "models":  # the classes of SQLAlchemy
        return import_module("conflictdb.jobs.models")
    return _offered(name)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(__name__)
    except PackageNotFoundError:  # run from a source tree that was never installed
        return "unknown"


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
