"""Sessions with a database, and its scenes."""
