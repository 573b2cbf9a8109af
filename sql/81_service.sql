-- The server's part of `conflictdb status`. Workers are recognised by their application_name.

CREATE OR REPLACE FUNCTION conflictdb_internal._worker_count() RETURNS bigint
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    -- Every role sees the names of all sessions.
    SELECT count(*) FROM pg_catalog.pg_stat_activity a
    WHERE a.datname = current_database() AND a.application_name = 'conflictdb worker';
END;
COMMENT ON FUNCTION _worker_count() IS 'Number of workers connected to this database, by their application_name.';

CREATE OR REPLACE FUNCTION conflictdb_internal._service(OUT postgis_version text, OUT worker_count bigint)
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    SELECT PostGIS_Lib_Version(), _worker_count();
END;
COMMENT ON FUNCTION _service() IS
'Version of PostGIS, and number of workers connected to this database.';
