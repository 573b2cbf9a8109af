"""Mark every object: answers of earlier releases may differ."""

revision = "0029"
down_revision = "0028"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "62779b4e1aa39643b22ddec87f54f1db3e236b2d01c60697aeeb92eca84134e0"


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
