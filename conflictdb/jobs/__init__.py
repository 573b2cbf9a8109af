"""Work on the database: schema, reading and writing, detection, worker."""
