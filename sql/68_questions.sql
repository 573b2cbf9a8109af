-- Checks of every query, so that an empty answer does not hide a mistake.
--
-- PostgreSQL evaluates them once per query, first, because they are conditions without columns. It skips them if no row
-- can match, as in a comparison with null; so queries replace nulls.

CREATE OR REPLACE FUNCTION conflictdb_internal._warn_if_incomplete(p_scene text) RETURNS boolean
LANGUAGE plpgsql STABLE PARALLEL RESTRICTED SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT _is_current(_scene_or_branch(p_scene)) THEN
        RAISE NOTICE 'scene %: %: the answer may not be complete', quote_literal(p_scene),
                     (SELECT s.remark FROM _scene_state(p_scene) s)
            USING HINT = 'The view scenes says is_current; wait_until_current(scene, timeout) waits for a detection.';
    END IF;
    RETURN true;
END
$$;
COMMENT ON FUNCTION _warn_if_incomplete(text) IS
'Raises a NOTICE if the conflicts of a scene are not complete; returns true. Raises ZC010 for an unknown name.';

CREATE OR REPLACE FUNCTION conflictdb_internal._beyond_horizon(p_scene text, p_span tstzrange) RETURNS text
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_expanded tstzrange := _expanded(_scene_or_branch(p_scene));
BEGIN
    -- An unbounded end means all that is known.
    IF lower(p_span) < lower(v_expanded) OR lower(p_span) >= upper(v_expanded)
       OR upper(p_span) > upper(v_expanded) OR upper(p_span) < lower(v_expanded)
       OR upper_inc(p_span) AND upper(p_span) = upper(v_expanded) THEN
        RETURN format('schedules are expanded from %s until %s only (setting horizon_days)', lower(v_expanded),
                      upper(v_expanded));
    END IF;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _beyond_horizon(text, tstzrange) IS
'How far the schedules of a scene are expanded, in words, if a bound of a span lies outside that time; null: inside, '
'or no schedules. Raises ZC010 for an unknown name.';

CREATE OR REPLACE FUNCTION conflictdb_internal._warn_if_beyond_horizon(p_scene text, p_span tstzrange) RETURNS boolean
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_remark text := _beyond_horizon(p_scene, p_span);
BEGIN
    IF v_remark IS NOT NULL THEN
        RAISE NOTICE 'scene %: %: the answer may not be complete', quote_literal(p_scene), v_remark
            USING HINT = 'The view scenes says expanded_from and expanded_until.';
    END IF;
    RETURN true;
END
$$;
COMMENT ON FUNCTION _warn_if_beyond_horizon(text, tstzrange) IS
'Raises a NOTICE if a bound of a span lies outside the time for which schedules of a scene are expanded; returns true. '
'Raises ZC010 for an unknown name.';

CREATE OR REPLACE FUNCTION conflictdb_internal._warn_if_no_object(p_scene text, p_key text) RETURNS boolean
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL RESTRICTED SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT _has_key(_scene_or_branch(p_scene), p_key) THEN
        RAISE NOTICE 'scene %: holds no object %', quote_literal(p_scene), quote_nullable(p_key);
    END IF;
    RETURN true;
END
$$;
COMMENT ON FUNCTION _warn_if_no_object(text, text) IS
'Raises a NOTICE if a scene has no object with that key (it may have been removed); returns true.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_key(p_scene text, p_key text) RETURNS boolean
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch(p_scene);
BEGIN
    -- A removed object still has its conflicts, until the next detection.
    IF NOT _has_key(v_scene_id, p_key)
       AND NOT EXISTS (SELECT FROM conflict c WHERE c.scene_id = v_scene_id AND c.a_key = p_key)
       AND NOT EXISTS (SELECT FROM conflict c WHERE c.scene_id = v_scene_id AND c.b_key = p_key) THEN
        FOUND := _raise('ZC011', format('object %L', p_key), 'key', format('is no object of scene %L', p_scene),
                        'object_known');
    END IF;
    RETURN true;
END
$$;
COMMENT ON FUNCTION _check_key(text, text) IS
'Raises ZC011 if a scene has neither an object nor a conflict with that key; returns true.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_place(
    p_geometry geometry, p_span tstzrange, p_floor_m double precision, p_ceiling_m double precision
) RETURNS boolean
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'what is asked about';
BEGIN
    IF p_geometry IS NULL OR ST_IsEmpty(p_geometry) THEN
        FOUND := _raise('ZC001', c_who, 'geometry', 'must not be null or empty', 'geometry_given');
    END IF;
    IF ST_SRID(p_geometry) <> 4326 THEN
        FOUND := _raise('ZC001', c_who, 'geometry', format('must have SRID 4326; got %s', ST_SRID(p_geometry)),
                        'geometry_srid', 'Use ST_Transform, or ST_SetSRID if it is longitude and latitude on WGS84.');
    END IF;
    PERFORM _check_size(c_who, 'geometry', ST_NPoints(p_geometry), 'max_vertices');
    PERFORM _check_coordinates(c_who, 'geometry', p_geometry, NULL);
    IF NOT (ST_IsValidDetail(p_geometry)).valid THEN
        FOUND := _raise('ZC001', c_who, 'geometry', 'must be valid: ' || ST_IsValidReason(p_geometry),
                        'geometry_valid', 'ST_MakeValid repairs it.');
    END IF;
    IF isempty(p_span) THEN
        FOUND := _raise('ZC003', c_who, 'span', 'must not be empty', 'span_not_empty');
    END IF;
    PERFORM _check_heights(c_who, p_floor_m, p_ceiling_m);
    RETURN true;
END
$$;
COMMENT ON FUNCTION _check_place(geometry, tstzrange, double precision, double precision) IS
'Raises ZC001, ZC003, ZC004, ZC005 or ZC017 for an invalid place: geometry (longitude and latitude, degrees), span, '
'heights in metres (null: unbounded); returns true. So an empty answer means that nothing is there.';
