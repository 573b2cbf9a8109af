-- CREATE OR REPLACE cannot change a routine's name, parameters or results, and views of users may depend on the old
-- routine. So it is renamed here; 95_retired.sql drops it once all views use the new one.

DO $$
DECLARE
    v_routine regprocedure;
BEGIN
    FOR v_routine IN
        SELECT p.oid FROM pg_catalog.pg_proc p
        WHERE p.pronamespace = 'conflictdb'::regnamespace
          AND ('p_earth' = ANY (p.proargnames)
               AND p.proname IN ('_radius_m', '_plane_srid', '_to_plane', '_from_plane', '_check_planar',
                                 '_conflict_region')
               OR NOT 'p_scene_id' = ANY (p.proargnames) AND p.proname = '_conflict_region'
               OR NOT 'version' = ANY (p.proargnames) AND p.proname = '_pieces_near'
               OR NOT 'p_keys' = ANY (p.proargnames) AND p.proname IN ('_conflicts', '_approaches')
               OR NOT 'acknowledged_at' = ANY (p.proargnames)
                  AND p.proname IN ('_conflicts_known_at', 'conflicts_known_at')
               OR NOT 'version' = ANY (p.proargnames) AND p.proname IN ('_read_areas', '_read_tracks')
               OR p.pronargs = 2 AND p.proname = '_begin_pieces'
               OR NOT 'p_numbers' = ANY (p.proargnames) AND p.proname = '_known_conflicts'
               OR 'p_first' = ANY (p.proargnames) AND p.proname = '_candidates'
               OR NOT 'head' = ANY (p.proargnames) AND p.proname = '_map_conflicts'
               OR NOT 'inside_lon_deg' = ANY (p.proargnames) AND p.proname = '_map_areas'
               OR p.proname IN ('_settle_centre', '_circle_haven_at', '_pending_scenes', '_dirty_objects',
                                '_object_states'))
    LOOP
        EXECUTE format('ALTER FUNCTION %s RENAME TO %I', v_routine,
                       '_retired' || (SELECT p.proname FROM pg_catalog.pg_proc p WHERE p.oid = v_routine));
    END LOOP;
END
$$;
