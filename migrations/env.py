"""Alembic environment: structure from versions/, routines from sql/ at head, all in one transaction.

`conflictdb.jobs.schema.upgrade` passes its connection in the config's attributes; the alembic command line passes
`-x dsn=…`. Without a connection (`--sql`) the structure alone is written. The version table lives in the schema
conflictdb, beside nobody else's.
"""

import psycopg
import sqlalchemy
from alembic import context
from alembic.runtime.migration import MigrationContext, MigrationInfo

from conflictdb.jobs import schema


def _after_step(*, ctx: MigrationContext, step: MigrationInfo, heads: set[str], run_args: object) -> None:
    """Apply the routines once the structure is at head; older revisions never meet newer routines."""
    if step.is_stamp or ctx.connection is None or set(heads) != set(context.script.get_heads()):
        return
    driver = ctx.connection.connection.driver_connection
    schema.apply_routines(driver)
    # The revision that this upgrade began at.
    if marking := schema.marking_sql(context.config.attributes.get("upgraded_from")):
        driver.execute(marking.encode())


def _migrate(connection: sqlalchemy.Connection) -> None:
    driver = connection.connection.driver_connection
    with connection.begin():
        schema.prepare(driver)
        if schema.revision(driver) == schema.FORMER:
            driver.execute(schema.RESTAMP.encode())
        context.config.attributes["upgraded_from"] = schema.revision(driver)
        context.configure(
            connection=connection,
            version_table="alembic_version",
            version_table_schema=schema.SCHEMA,
            transactional_ddl=True,
            transaction_per_migration=False,
            on_version_apply=_after_step,
        )
        with context.begin_transaction():
            context.run_migrations()


def _write() -> None:
    """Write the structure as one script, which a transaction of the caller runs; the routines are files already."""
    context.configure(
        dialect_name="postgresql",
        dialect_opts={"paramstyle": "named"},  # a % is a %
        version_table="alembic_version",
        version_table_schema=schema.SCHEMA,
        transactional_ddl=False,
    )
    context.run_migrations()


def _run() -> None:
    given = context.config.attributes.get("connection")
    if given is not None:
        _migrate(given)
        return
    if context.is_offline_mode():
        _write()
        return
    dsn = context.get_x_argument(as_dictionary=True).get("dsn", "")
    engine = sqlalchemy.create_engine("postgresql+psycopg://", creator=lambda: psycopg.connect(dsn))
    with engine.connect() as connection:
        _migrate(connection)
    engine.dispose()


_run()
