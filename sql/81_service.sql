-- What `conflictdb status` tells of the server. Workers are told apart by their application_name.

CREATE OR REPLACE FUNCTION _service(OUT postgis_version text, OUT worker_count bigint)
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    SELECT PostGIS_Lib_Version(),
           (SELECT count(*) FROM pg_catalog.pg_stat_activity a
            WHERE a.datname = current_database() AND a.application_name = 'conflictdb worker');
END;
COMMENT ON FUNCTION _service() IS
'The version of PostGIS, and how many workers are connected to this database (of other users only those that the '
'caller may see).';
