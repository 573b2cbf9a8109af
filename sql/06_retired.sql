-- CREATE OR REPLACE cannot change a routine's name, parameters or results, and views of users may depend on the old
-- routine. So the routines of earlier releases that are listed here are renamed; 95_retired.sql drops them once all
-- views use the new ones.

DO $$
DECLARE
    -- Name, parameters and columns of the result, e.g. 'conflicts_of(p_scene, p_key, a_key, b_key)'.
    c_retired CONSTANT text[] := ARRAY[
        '_answer_probe(p_probe_id, p_error, p_found)',
        '_approaches(p_scene, p_only_near, p_keys, a_key, a_kind, b_key, b_kind, closest_at, closest_m, '
        'closest_error_m, a_lon_deg, a_lat_deg, b_lon_deg, b_lat_deg, verdict, is_current, run_id, '
        'found_at, scene_is_current, method, time_error_s, a_id, a_version, b_id, b_version)',
        '_area_row(p_scene_id, p_area_id, area_id, version, span_start, span_end, floor_m, ceiling_m, footprint)',
        '_attached_rows(p_attachment_id, p_change_ids, p_is_full, p_how)',
        '_begin_detection(p_scene, p_wait_s, p_few, p_try_again, scene_id, taken, is_behind, motion, '
        'earth, method, tolerance_m, separation_m, nearest_m, centre_lon, centre_lat, srid, area_ids, '
        'track_ids, known_objects)',
        '_changed_areas(p_scene_id, p_after, p_most, area_id, version, span_start, span_end, floor_m, ceiling_m, '
        'footprint)',
        '_changed_tracks(p_scene_id, p_after, p_most, track_id, version, floor_m, ceiling_m, grow_mps, path, outline, '
        'outlines, floors, ceilings)',
        '_check_common(p_who, p_key, p_floor_m, p_ceiling_m, p_properties)',
        '_conflict_events(p_scene, p_key, p_other_key, p_after, p_most, event, kind, at, run_id, conflict_id, a_key, '
        'a_kind, b_key, b_kind, periods, verdict, time_error_s, closest_at, closest_m, closest_error_m, opened_at, '
        'closed_at)',
        '_conflicts(p_scene, p_at, p_with_region, p_keys, a_key, a_kind, b_key, b_kind, periods, verdict, '
        'region, first_contact_lon_deg, first_contact_lat_deg, method, time_error_s, is_current, run_id, '
        'found_at, closest_at, closest_m, closest_error_m, closest_a_lon_deg, closest_a_lat_deg, '
        'closest_b_lon_deg, closest_b_lat_deg, scene_is_current, conflict_id, changed_at, '
        'acknowledged_by, acknowledged_at, acknowledged_for, acknowledged_until, a_id, a_version, b_id, '
        'b_version)',
        '_conflicts(p_scene, p_at, p_with_region, p_keys, p_key, p_from, p_to, p_since, p_verdict, '
        'p_acknowledged, a_key, a_kind, b_key, b_kind, periods, verdict, region, first_contact_lon_deg, '
        'first_contact_lat_deg, method, time_error_s, is_current, run_id, found_at, closest_at, closest_m, '
        'closest_error_m, closest_a_lon_deg, closest_a_lat_deg, closest_b_lon_deg, closest_b_lat_deg, '
        'scene_is_current, conflict_id, changed_at, acknowledged_by, acknowledged_at, acknowledged_for, '
        'acknowledged_until, a_name, b_name, a_id, a_version, b_id, b_version)',
        '_conflicts(p_scene, p_at, p_with_region, p_keys, p_key, p_from, p_to, p_since, p_verdict, '
        'p_acknowledged, a_key, a_kind, b_key, b_kind, periods, verdict, region, first_contact_lon_deg, '
        'first_contact_lat_deg, method, time_error_s, is_current, run_id, found_at, closest_at, closest_m, '
        'closest_error_m, closest_a_lon_deg, closest_a_lat_deg, closest_b_lon_deg, closest_b_lat_deg, '
        'scene_is_current, conflict_id, changed_at, acknowledged_by, acknowledged_at, acknowledged_for, '
        'acknowledged_until, a_name, b_name, lacking_s, a_id, a_version, b_id, b_version)',
        '_conflicts(p_scene, p_at, p_with_region, p_keys, p_key, p_from, p_to, p_since, p_verdict, '
        'p_acknowledged, p_class, a_key, a_kind, b_key, b_kind, periods, verdict, region, first_contact_lon_deg, '
        'first_contact_lat_deg, method, time_error_s, is_current, run_id, found_at, closest_at, closest_m, '
        'closest_error_m, closest_a_lon_deg, closest_a_lat_deg, closest_b_lon_deg, closest_b_lat_deg, '
        'scene_is_current, conflict_id, changed_at, acknowledged_by, acknowledged_at, acknowledged_for, '
        'acknowledged_until, a_name, b_name, lacking_s, a_id, a_version, b_id, b_version)',
        '_explained_as_json(p_key, p_kind, p_waits, p_pieces, p_span, p_floor_m, p_ceiling_m)',
        '_explained_object(p_scene_id, p_key, kind, id, key, name, waits, pieces, is_covered, span, low_m, high_m, '
        'box, floor_m, ceiling_m)',
        '_explained_object(p_scene_id, p_key, kind, id, key, waits, pieces, is_covered, span, floor_m, '
        'ceiling_m, box)',
        '_keys_of(p_scene_id, p_kinds, p_ids, kind, id, key)',
        '_leg_heights(p_floor_m, p_ceiling_m, p_floors_m, p_ceilings_m, p_first, p_last, floor_m, ceiling_m)',
        '_load(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat, p_merge, added, updated, removed, unchanged)',
        '_max_days_ahead()',
        '_max_speed_kn()',
        '_most_points(p_limit)',
        '_pieces(p_scene_id, p_piece_ids, piece_id, rank, object_kind, object_id, version, pieces, part, '
        'turn, span_start, span_end, end_inclusive, floor_m, ceiling_m, leg_start, leg_end, start_lon_deg, '
        'start_lat_deg, end_lon_deg, end_lat_deg, bearing_deg, hull, shape, shape_to, parts, cuts, leg_times, '
        'legs)',
        '_pieces_meeting(p_scene_id, p_key, p_hulls, p_starts_us, p_ends_us, p_inclusive, p_floors_m, '
        'p_ceilings_m, p_turns, n, piece_id, pieces, object_number)',
        '_probe_request(p_probe_id, object_kind, key, footprint, start_us, end_us, path, outline, '
        'grow_mps, floor_m, ceiling_m)',
        '_put_pieces(p_scene_id, p_most, p_object_kind, p_object_id, p_version, p_pieces, p_part, p_turn, '
        'p_hull, p_span, p_floor_m, p_ceiling_m, p_shape, p_shape_to, p_leg_start, p_leg_end, '
        'p_start_lon_deg, p_start_lat_deg, p_end_lon_deg, p_end_lat_deg, p_bearing_deg, p_first, p_hulls, '
        'p_shapes, p_parts, p_starts, p_leg_times, p_legs, piece_id, rank, object_kind, object_id, '
        'version, pieces, part, turn, span_start, span_end, end_inclusive, floor_m, ceiling_m, leg_start, '
        'leg_end, start_lon_deg, start_lat_deg, end_lon_deg, end_lat_deg, bearing_deg, hull, shape, '
        'shape_to, parts, cuts, leg_times, legs, met)',
        '_put_pieces(p_scene_id, p_most, p_most_compared, p_object_kind, p_object_id, p_version, p_pieces, '
        'p_part, p_turn, p_hull, p_span, p_floor_m, p_ceiling_m, p_shape, p_shape_to, p_leg_start, p_leg_end, '
        'p_start_lon_deg, p_start_lat_deg, p_end_lon_deg, p_end_lat_deg, p_bearing_deg, p_first, p_hulls, '
        'p_shapes, p_parts, p_starts, p_leg_times, p_legs, piece_id, rank, object_kind, object_id, version, '
        'pieces, part, turn, span_start, span_end, end_inclusive, floor_m, ceiling_m, leg_start, leg_end, '
        'start_lon_deg, start_lat_deg, end_lon_deg, end_lat_deg, bearing_deg, hull, shape, shape_to, parts, '
        'cuts, leg_times, legs, met, own_parts, met_parts, candidate_pairs, stage2_us)',
        '_read_areas(p_scene_id, p_keys, area_id, version, span_start, span_end, floor_m, ceiling_m, has_name, '
        'footprint, key, name, properties)',
        '_read_tracks(p_scene_id, p_keys, track_id, version, floor_m, ceiling_m, has_name, grow_mps, path, outline, '
        'outlines, floors, ceilings, key, name, properties)',
        '_refuse(p_state, p_who, p_field, p_rule, p_constraint, p_hint)',
        '_row_boxes(p_scene_id, p_most, piece_ids, pieces, objects, turns, low_xs, low_ys, high_xs, high_ys, floors_m, '
        'ceilings_m, span_starts, span_ends)',
        '_scene(p_scene_id, name, motion, earth, method, tolerance_m, separation_m, nearest_m, '
        'centre_lon, centre_lat)',
        '_scene_named(p_scene, name, motion, earth, method, tolerance_m, separation_m, nearest_m, '
        'centre_lon, centre_lat)',
        '_scenes(scene_id, name, motion, earth, method, tolerance_m, separation_m, nearest_m, centre_lon, '
        'centre_lat, areas, tracks, pending, conflicts, run_id, finished_at, error, is_current)',
        '_set_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat)',
        '_some_areas(p_scene_id, p_area_ids, area_id, version, span_start, span_end, floor_m, ceiling_m, footprint)',
        '_some_tracks(p_scene_id, p_track_ids, track_id, version, floor_m, ceiling_m, grow_mps, path, outline, '
        'outlines, floors, ceilings)',
        '_staged_tracks(p_is_waypoints, p_has_times, p_first, p_last, object_id, key, name, path, outline, outlines, '
        'grow_mps, floor_m, ceiling_m, floors_m, ceilings_m, properties)',
        '_track_row(p_scene_id, p_track_id, track_id, version, floor_m, ceiling_m, grow_mps, path, outline, outlines, '
        'floors, ceilings)',
        '_wait_for_probe(p_probe_id, p_timeout, key, kind, verdict, periods, time_error_s, lon_deg, '
        'lat_deg, closest_at, closest_m, closest_error_m)',
        '_wait_for_probe(p_probe_id, p_timeout, key, name, kind, verdict, periods, time_error_s, lon_deg, '
        'lat_deg, closest_at, closest_m, closest_error_m)',
        '_wait_for_probe(p_probe_id, p_timeout, key, name, kind, verdict, periods, time_error_s, lon_deg, '
        'lat_deg, closest_at, closest_m, closest_error_m, lacking_s)',
        '_write_run(p_scene_id, p_run_id, p_run, p_is_last, p_a_kind, p_a_id, p_a_version, p_b_kind, p_b_id, '
        'p_b_version, p_place, p_digest, p_verdict, p_periods, p_region, p_first_contact_point, '
        'p_time_error_s, p_closest_at, p_closest_m, p_closest_error_m, p_closest_a_point, p_closest_b_point, '
        'p_lacking_s, run_id, opened, changed, closed, conflicts, unresolved)',
        '_write_run(p_scene_id, p_run_id, p_run, p_is_last, p_a_kind, p_a_id, p_a_version, p_b_kind, p_b_id, '
        'p_b_version, p_place, p_digest, p_verdict, p_periods, p_region, p_first_contact_point, '
        'p_time_error_s, p_closest_at, p_closest_m, p_closest_error_m, p_closest_a_point, p_closest_b_point, '
        'run_id, opened, changed, closed, conflicts, unresolved)',
        'acknowledge(p_scene, p_a_key, p_b_key, p_reason, p_until)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat, p_vertical_separation_m)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat, p_vertical_separation_m, p_time_separation_s, p_delays_within_s)',
        'create_scene(p_name, p_motion, p_earth, p_method, p_tolerance_m, p_separation_m, p_nearest_m, '
        'p_centre_lon, p_centre_lat, p_vertical_separation_m, p_time_separation_s, p_delays_within_s, '
        'p_intervals, p_horizon_days)',
        'list_objects(p_scene, key, kind, name, start_at, end_at, floor_m, ceiling_m)',
        'put_area(p_scene, p_key, p_footprint, p_active_span, p_floor_m, p_ceiling_m, p_name, p_properties)',
        'put_track(p_scene, p_key, p_path, p_outline, p_floor_m, p_ceiling_m, p_name, p_properties, p_grow_mps, '
        'p_outlines, p_floors_m, p_ceilings_m)',
        'wait_for_probe(p_probe_id, p_timeout, key, kind, verdict, periods, first_contact, last_contact, '
        'time_error_s, first_contact_point, closest_at, closest_m, closest_error_m)',
        'wait_for_probe(p_probe_id, p_timeout, key, kind, verdict, periods, first_contact, last_contact, '
        'time_error_s, first_contact_point, closest_at, closest_m, closest_error_m, lacking_s)'];
    v_routine record;
BEGIN
    FOR v_routine IN
        SELECT p.oid::regprocedure AS header, p.proname FROM pg_catalog.pg_proc p
        WHERE p.pronamespace IN ('conflictdb'::regnamespace, 'conflictdb_internal'::regnamespace)
          AND format('%s(%s)', p.proname, array_to_string(p.proargnames, ', ')) = ANY (c_retired)
    LOOP
        EXECUTE format('ALTER FUNCTION %s RENAME TO %I', v_routine.header, '_retired_' || v_routine.proname);
    END LOOP;
END
$$;
