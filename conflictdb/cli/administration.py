"""Commands of `conflictdb admin`, other than `certify` and `service`."""

import argparse
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from conflictdb import store
from conflictdb.cli.codes import DONE, FAILED
from conflictdb.cli.load_report import Shown, moment_text, remark_incomplete
from conflictdb.cli.output import line, note, out, remark, warnings_as_remarks
from conflictdb.cli.parser import check
from conflictdb.cli.session import database
from conflictdb.cli.tables import table
from conflictdb.client.database import Database, connect
from conflictdb.jobs import schema
from conflictdb.model.plans import Scene
from conflictdb.model.rules import rule_of

# Rows listed: a screen full.
_MOST_ROWS: Final = 20


def upgrade(args: argparse.Namespace) -> int:
    """Create the schema, or upgrade it to this program's revision."""
    with connect(args.dsn, create=True, say=note) as db:
        state = db.status()
        missing = schema.missing_grants(db.connection)
        ungrantable = None if args.dsn is None else schema.ungrantable_roles(db.connection)
        waiting = [db.scene(one.scene.name).state() for one in state.scenes if not one.is_current]
    if missing:
        remark(f"the roles of conflictdb cannot read yet; let an administrator run: {missing}")
    if ungrantable:
        remark(ungrantable)
    out(f"database {state.database}: schema conflictdb is at revision {state.revision}")
    # An upgrade that changes answers marks every object.
    remark_incomplete(waiting)
    return DONE


def extension(args: argparse.Namespace) -> int:
    """Write the files of conflictdb as an extension of a server."""
    from conflictdb.jobs import extension as files

    for path in files.build(args.directory or files.install_directory(args.pg_config)):
        out(str(path))
    return DONE


def attach(args: argparse.Namespace) -> int:
    """Attach a table, or describe the effect."""
    given = (args.kind, args.table, _mapped(args))
    with database(args) as db:
        with db.connection.transaction(force_rollback=args.dry_run), warnings_as_remarks():
            if all(status.scene.name != args.scene for status in db.scenes()):
                store.set_scene(db.connection, Scene(args.scene))
            scene = db.scene(args.scene)
            if args.dry_run:
                _show_preview(scene.preview_attachment(*given, every_s=args.every, again=args.again))
                return DONE
            number = scene.attach(*given, every_s=args.every, again=args.again)
        scene.follow()
        _report_attachment(db, args.scene, number)
    return DONE


def reattach(args: argparse.Namespace) -> int:
    """Change how a table is attached, or describe the effect."""
    changes = _mapped(args) | dict.fromkeys(args.without)
    with database(args) as db:
        scene = db.scene(args.scene)
        with warnings_as_remarks():
            if args.dry_run:
                _show_preview(scene.preview_reattachment(args.table, changes, to=args.to, every_s=args.every))
                return DONE
            number = scene.reattach(args.table, changes, to=args.to, every_s=args.every)
        scene.follow()
        _report_attachment(db, args.scene, number)
    return DONE


def _mapped(args: argparse.Namespace) -> dict[str, str]:
    """Return the fields of all --map, and of --where."""
    mapped: dict[str, str] = {}
    for one in args.map:
        check(args, [(field in mapped, f"--map gives {field} twice") for field in one])
        mapped |= one
    if args.where is not None:
        check(args, [("where" in mapped, "--map gives where, and so does --where")])
        mapped["where"] = args.where
    return mapped


def _show_preview(preview: store.AttachmentPreview) -> None:
    for step in preview.steps:
        out(f"would {step}")
    for one in preview.objects:
        out(one)
    for one in preview.unmapped:
        remark(f"left out: {one}")


def _report_attachment(db: Database, scene: str, number: int) -> None:
    one = next(one for one in db.scene(scene).attachments() if one.attachment_id == number)
    if one.error:
        remark(f"{one.table} cannot be read: {one.error}")
    left_out = f", {one.unmapped} left out" if one.unmapped else ""
    how = "triggers tell of changes" if one.has_triggers else f"changes are looked for every {one.every}"
    line(f"{scene}: {_counted(one.objects, one.kind)} of {one.table}{left_out}; {how}")
    for row in db.scene(scene).unmapped()[:_MOST_ROWS]:
        if row.attachment_id == number:
            remark(f"left out: {row.identity}: {row.reason}")


def _counted(number: int, what: str, many: str | None = None) -> str:
    return f"{number:,} {what}" if number == 1 else f"{number:,} {many or what + 's'}"


def detach(args: argparse.Namespace) -> int:
    """Detach a table."""
    with database(args) as db:
        removed = db.scene(args.scene).detach(args.table, keep=args.keep)
    line(f"{args.scene}: {args.table} is detached, {_counted(removed, 'object')} removed")
    return DONE


def attachments(args: argparse.Namespace) -> int:
    """Show attached tables."""
    with database(args) as db:
        found = db.scene(args.scene).attachments()
        rows = [row for scene in sorted({one.scene for one in found}) for row in db.scene(scene).unmapped()]
    header = ["SCENE", "NUMBER", "TABLE", "KIND", "OBJECTS", "LEFT OUT", "CHANGES BY", "REMARK"]
    lines = [
        [
            *(one.scene, one.attachment_id, one.table, one.kind, one.objects, one.unmapped),
            *("triggers" if one.has_triggers else f"every {one.every}", one.error or one.remark),
        ]
        for one in found
    ]
    out(table(header, lines, right=["NUMBER", *header[4:6]]) if found else "nothing is attached")
    for row in rows[:_MOST_ROWS]:
        line(f"{row.table}: {row.identity}: {row.reason}{' (kept as it was)' if row.is_kept else ''}")
    if len(rows) > _MOST_ROWS:
        out(f"and {len(rows) - _MOST_ROWS:,} more in the view conflictdb.unmapped")
    return DONE


def share(args: argparse.Namespace) -> int:
    """Share a scene with a role, withdraw a share, or list the shares."""
    check(args, [(args.role is None and args.access is not None, "--access goes with a role")])
    with _with_notices(args) as db:
        if args.role is None:
            found = db.scene(args.scene).shares()
            out(_share_table(found) if found else "belongs to nobody, and is shared with nobody")
        elif args.access == "none":
            out("taken back" if db.scene(args.scene).unshare(args.role) else "was not shared with it")
        else:
            db.scene(args.scene).share(args.role, args.access or "read")
            line(f"{args.scene}: {args.role} may {args.access or 'read'} it")
    return DONE


def protect(args: argparse.Namespace) -> int:
    """Restrict scenes to their owners and shares, or show all scenes to all again."""
    with _with_notices(args) as db:
        db.protect_scenes(on=not args.off)
    out("all scenes are open to all roles" if args.off else "scenes are protected")
    return DONE


def verify_audit(args: argparse.Namespace) -> int:
    """Verify the seals of the audit of edits."""
    with database(args) as db:
        found = store.verify_edits(db.connection)
    if found.first_wrong is not None:
        out(f"batch {found.first_wrong} is not as it was sealed: {found.reason}")
    before = "" if found.first_wrong is None else " before it"
    out(f"as sealed{before}: {_counted(found.edits, 'edit')} in {_counted(found.batches, 'batch', 'batches')}")
    if found.anchor:
        out(f"pruned: the edits of batches up to {found.anchor}")
    out(f"not sealed yet: {_counted(found.unsealed, 'edit')}")
    if found.last_batch is not None:
        out(f"last batch: {found.last_batch}, SHA-256 {found.last_digest}")
    return DONE if found.first_wrong is None else FAILED


def _share_table(shares: list[store.Share]) -> str:
    rows = [
        [one.role, one.access, one.shared_by or "", moment_text(one.shared_at, up=False) if one.shared_at else ""]
        for one in shares
    ]
    at = Shown().header("AT")
    return table(["ROLE", "ACCESS", "SHARED BY", at], rows, whole=[at])


@contextmanager
def _with_notices(args: argparse.Namespace) -> Iterator[Database]:
    """Open the database of a command, and print its notices."""
    with database(args) as db:
        db.connection.add_notice_handler(lambda notice: remark(store.with_remedy(notice)))
        yield db


def rules(args: argparse.Namespace) -> int:
    """List the separation rules of a scene, or change one."""
    problems = [
        (len(args.sides) not in (0, 2), "give no side, or two"),
        (bool(args.sides) != (args.remove or args.set is not None), "two sides go with --set or --remove"),
        (args.remove and args.set is not None, "--set and --remove exclude each other"),
    ]
    check(args, problems)
    with database(args) as db:
        scene = db.scene(args.scene)
        if args.sides:
            a, b = (None if side == "any" else side for side in args.sides)
            if args.remove:
                done = "removed" if scene.remove_rule(a, b) else "is not there"
            else:
                scene.put_rule(rule_of({"a_class": a, "b_class": b} | _values(args.set), "--set"))
                done = "entered"
            line(f"{args.scene}: rule of {args.sides[0]} with {args.sides[1]} {done}")
            return DONE
        found = scene.rules()
    header = ["A", "B", "SEPARATION M", "VERTICAL M", "TIME S", "ALLOWED", "YIELDS"]
    rows = [
        [
            *(side or "any" for side in (rule.a_class, rule.b_class)),
            *(None if one is None else f"{one:g}" for one in (rule.separation_m, rule.vertical_m, rule.time_s)),
            "yes" if rule.allowed else None,
            {"a": rule.a_class or "any", "b": rule.b_class or "any"}.get(rule.yields or ""),
        ]
        for rule in found
    ]
    out(table(header, rows, right=header[2:5]) if found else "no rules: the settings of the scene apply to all")
    return DONE


def _values(given: Mapping[str, str]) -> dict[str, Any]:
    """Return the values of a rule as in scene files; texts that are no JSON stay texts."""
    found: dict[str, Any] = {}
    for name, text in given.items():
        try:
            found[name] = json.loads(text)
        except ValueError:
            found[name] = text
    return found
