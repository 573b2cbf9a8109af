"""All that knows the database: the schema, reading and writing, detection, the worker."""
