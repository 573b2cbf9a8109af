"""`share` and `protect`."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import moment_text
from conflictdb.cli.output import out, remark, table
from conflictdb.cli.parser import check
from conflictdb.cli.session import database
from conflictdb.db import store
from conflictdb.session.database import Database


def share(args: argparse.Namespace) -> int:
    """Share a scene with a role, withdraw a share, or list the shares."""
    check(args, [(args.role is None and args.access is not None, "--access goes with a role")])
    with _with_notices(args) as db:
        if args.role is None:
            found = db.scene(args.scene).shares()
            out(_table(found) if found else "belongs to nobody, and is shared with nobody")
        elif args.access == "none":
            out("taken back" if db.scene(args.scene).unshare(args.role) else "was not shared with it")
        else:
            db.scene(args.scene).share(args.role, args.access or "read")
            out(f"{args.scene}: {args.role} may {args.access or 'read'} it")
    return DONE


def protect(args: argparse.Namespace) -> int:
    """Restrict scenes to their owners and shares, or show all scenes to all again."""
    with _with_notices(args) as db:
        db.protect_scenes(on=not args.off)
    out("all scenes are open to all roles" if args.off else "scenes are protected")
    return DONE


def _table(shares: list[store.Share]) -> str:
    rows = [
        [one.role, one.access, one.shared_by or "", moment_text(one.shared_at, up=False) if one.shared_at else ""]
        for one in shares
    ]
    return table(["ROLE", "ACCESS", "SHARED BY", "AT (UTC)"], rows)


@contextmanager
def _with_notices(args: argparse.Namespace) -> Iterator[Database]:
    """Open the database of a command, and print its notices."""
    with database(args) as db:
        db.connection.add_notice_handler(
            lambda notice: remark("; ".join(filter(None, (notice.message_primary, notice.message_hint))))
        )
        yield db
