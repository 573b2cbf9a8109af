-- CREATE OR REPLACE cannot change a routine's name, parameters or results. So private routines, and the public ones of
-- earlier releases that are listed here, are renamed; 95_retired.sql drops them once all views use the new ones.
-- Private routines keep their names where a trigger, a policy, a constraint or an object of a user depends on them.

DO $$
DECLARE
    -- Name, parameters and columns of the result of public routines, e.g. 'conflicts_of(p_scene, p_key, a_key, b_key)'.
    c_retired CONSTANT text[] := ARRAY[
        'acknowledge(p_scene, p_a_key, p_b_key, p_reason, p_until)',
        'admit(p_scene, p_plans, p_owner, p_allow_known, admitted, conflicts, request_id)',
        'attach(p_scene, p_kind, p_table, p_map, p_every)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat, p_vertical_separation_m)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat, p_vertical_separation_m, p_time_separation_s, p_delays_within_s)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat, p_vertical_separation_m, p_time_separation_s, p_delays_within_s, '
        'p_intervals, p_horizon_days)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat, p_vertical_separation_m, p_time_separation_s, p_delays_within_s, '
        'p_intervals, p_horizon_days, p_vertical_datum)',
        'delays_of(p_scene, p_key, p_horizon, p_now, key, least_later_s, least_earlier_s, blocked_by, forbidden, '
        'waits, has_departed, earliest_s, latest_s)',
        'list_objects(p_scene, key, kind, name, start_at, end_at, floor_m, ceiling_m)',
        'list_objects(p_scene, key, kind, name, start_at, end_at, floor_m, ceiling_m, class, owner)',
        'preview_attachment(p_scene, p_kind, p_table, p_map, p_every, p_objects, part, what)',
        'put_area(p_scene, p_key, p_footprint, p_active_span, p_floor_m, p_ceiling_m, p_name, p_properties)',
        'put_track(p_scene, p_key, p_path, p_outline, p_floor_m, p_ceiling_m, p_name, p_properties, p_grow_mps, '
        'p_outlines, p_floors_m, p_ceilings_m)',
        'request_delays(p_scene, p_key, p_horizon, p_now)',
        'request_probe(p_scene, p_footprint, p_active_span, p_floor_m, p_ceiling_m, p_key)',
        'request_track_probe(p_scene, p_path, p_outline, p_floor_m, p_ceiling_m, p_grow_mps, p_key)',
        'wait_for_delays(p_probe_id, p_timeout, key, least_later_s, least_earlier_s, blocked_by, forbidden, waits, '
        'has_departed, earliest_s, latest_s)',
        'wait_for_probe(p_probe_id, p_timeout, key, kind, verdict, periods, first_contact, last_contact, '
        'time_error_s, first_contact_point, closest_at, closest_m, closest_error_m)',
        'wait_for_probe(p_probe_id, p_timeout, key, kind, verdict, periods, first_contact, last_contact, '
        'time_error_s, first_contact_point, closest_at, closest_m, closest_error_m, lacking_s)'];
    v_ours CONSTANT oid[] := ARRAY['conflictdb'::regnamespace, 'conflictdb_internal'::regnamespace];
    v_routine record;
BEGIN
    FOR v_routine IN
        SELECT p.oid::regprocedure AS header, p.proname FROM pg_catalog.pg_proc p
        WHERE p.pronamespace = 'conflictdb'::regnamespace
              AND format('%s(%s)', p.proname, array_to_string(p.proargnames, ', ')) = ANY (c_retired)
        UNION ALL
        SELECT p.oid::regprocedure, p.proname FROM pg_catalog.pg_proc p
        WHERE p.pronamespace = 'conflictdb_internal'::regnamespace AND NOT EXISTS (
            SELECT FROM pg_catalog.pg_depend d
            LEFT JOIN pg_catalog.pg_proc f ON d.classid = 'pg_catalog.pg_proc'::regclass AND f.oid = d.objid
            LEFT JOIN pg_catalog.pg_rewrite r ON d.classid = 'pg_catalog.pg_rewrite'::regclass AND r.oid = d.objid
            LEFT JOIN pg_catalog.pg_class c ON c.oid = r.ev_class
            WHERE d.refclassid = 'pg_catalog.pg_proc'::regclass AND d.refobjid = p.oid
                  AND (coalesce(f.pronamespace, c.relnamespace) = ANY (v_ours)) IS NOT TRUE)
    LOOP
        EXECUTE format('ALTER ROUTINE %s RENAME TO %I', v_routine.header, '_retired_' || v_routine.proname);
    END LOOP;
END
$$;
