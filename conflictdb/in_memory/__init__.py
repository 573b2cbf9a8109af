"""Questions about objects in memory, without a database: the same answers."""
