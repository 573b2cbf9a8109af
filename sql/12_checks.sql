-- Rules of single objects, identical to conflictdb.model.plans and conflictdb.core.pieces.cutting. 13_validation.sql
-- calls them.

-- Its parameter is no scene, nor is it LANGUAGE sql: either would keep revisions from adding columns. With
-- extra_float_digits, numbers keep all digits whatever the session's own setting is.
CREATE OR REPLACE FUNCTION conflictdb_internal._settings_of(p_scene anyelement) RETURNS jsonb
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp
SET extra_float_digits = 1 AS $$
BEGIN
    RETURN to_jsonb(p_scene) - '{scene_id,history_kept,owner,expanded,parent_scene_id}'::text[];
END
$$;
COMMENT ON FUNCTION _settings_of(anyelement) IS
'Name and settings of a scene by the columns of its row: all but its id, the age of its history, its '
'owner, its parent, and how far schedules are expanded.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_closed(p_scene_id bigint) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT EXISTS (SELECT FROM scene s WHERE s.scene_id = p_scene_id AND s.intervals = 'closed');
END;
COMMENT ON FUNCTION _is_closed(bigint) IS 'Whether spans and height bands of a scene contain their upper ends.';

CREATE OR REPLACE FUNCTION conflictdb_internal._half_open(p_span tstzrange, p_is_closed boolean) RETURNS tstzrange
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Instants are whole microseconds: an inclusive end equals an exclusive end one microsecond later. In a scene of
    -- closed intervals [start, end) contains its end; but it cannot be empty.
    SELECT CASE WHEN isempty(p_span) THEN p_span ELSE tstzrange(
        CASE WHEN lower(p_span) = '-infinity' THEN NULL
             WHEN lower_inc(p_span) OR lower_inf(p_span) THEN lower(p_span)
             ELSE lower(p_span) + interval '1 microsecond' END,
        CASE WHEN upper(p_span) = 'infinity' THEN NULL
             WHEN upper_inc(p_span) AND (NOT p_is_closed OR lower(p_span) = upper(p_span))
                 THEN upper(p_span) + interval '1 microsecond'
             ELSE upper(p_span) END) END;
END;
COMMENT ON FUNCTION _half_open(tstzrange, boolean) IS
'Returns the same instants as [start, end): an inclusive end becomes an exclusive end one microsecond later, unless '
'the scene''s intervals are closed. An instant lasts a microsecond. An infinite bound becomes no bound.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_plain(p_properties jsonb) RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- jsonb accepts numbers outside the range of a double, and thousands of levels; many programs do not.
    SELECT jsonb_typeof(p_properties) = 'object'
           AND (p_properties = '{}' OR NOT jsonb_path_exists(p_properties, 'strict $.**{101 to last}')
                AND NOT jsonb_path_exists(p_properties, 'strict $.** ? (@.type() == "number"
                    && (@ > 1.7976931348623157e308 || @ < -1.7976931348623157e308))'));
END;
COMMENT ON FUNCTION _is_plain(jsonb) IS
'Whether properties are a JSON object with at most 100 levels and only numbers in the range of a double.';

CREATE OR REPLACE FUNCTION conflictdb_internal._known_limits()
RETURNS TABLE (name text, default_value double precision, most double precision, unit text, doc text)
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    -- The most is MAX_POINTS in conflictdb.model.
    VALUES ('max_vertices', 1000000::double precision, 1000000::double precision, 'vertices',
            'Vertices of an area, or of a track''s outlines together.'),
           ('max_waypoints', 1000000, 1000000, 'waypoints', 'Waypoints of a track.'),
           ('max_days_ahead', NULL, 999999, 'days', 'Days from now until which a plan that is admitted must end.'),
           ('max_speed_kn', 'infinity', 'infinity', 'knots',
            'Speed of a leg on the shortest way. A session accepts 2000 unless its setting is another number.');
END;
COMMENT ON FUNCTION _known_limits() IS
'Limits by name: default (null: none), greatest possible value, unit, and meaning.';

CREATE OR REPLACE FUNCTION conflictdb_internal._limit(p_limit text) RETURNS double precision
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    -- As in _known_limits.
    c_most CONSTANT integer := 1000000;
    -- Faster than any aircraft in service; MAX_SPEED_KN in conflictdb.model.speed_limits.
    c_usual_kn CONSTANT double precision := 2000;
    v_chosen double precision := (SELECT l.value FROM upper_limit l WHERE l.name = p_limit);
    v_name text := 'conflictdb.' || p_limit;
    v_given text := nullif(current_setting(v_name, true), '');
    v_form text := CASE p_limit WHEN 'max_speed_kn' THEN '^([0-9]{1,9}([.][0-9]{1,9})?|infinity)$'
                                WHEN 'max_days_ahead' THEN '^[0-9]{1,6}([.][0-9]{1,9})?$'
                                ELSE '^[0-9]{1,9}$' END;
BEGIN
    IF v_given !~ v_form THEN
        FOUND := _raise('ZC009', 'setting ' || v_name, p_limit,
                        format('must be a %s; got %L',
                               CASE p_limit WHEN 'max_speed_kn' THEN 'number of knots, or infinity'
                                            WHEN 'max_days_ahead' THEN 'number of days'
                                            ELSE format('whole number from 0 to %s', c_most) END, v_given),
                        'limit_is_number', format('RESET %s', v_name));
    END IF;
    -- A setting only lowers the limit, because any role may set it.
    RETURN CASE p_limit WHEN 'max_speed_kn' THEN least(coalesce(v_given::double precision, c_usual_kn), v_chosen)
                        WHEN 'max_days_ahead' THEN least(v_given::double precision, v_chosen)
                        ELSE least(v_given::double precision, v_chosen, c_most) END;
END
$$;
COMMENT ON FUNCTION _limit(text) IS
'A limit of this session, by its name: the row of upper_limit, or a lower setting conflictdb.<name>. max_vertices and '
'max_waypoints are at most 1,000,000; max_speed_kn is 2,000 without a setting; max_days_ahead may be null: no limit.';

CREATE OR REPLACE FUNCTION set_limit(p_name text, p_value double precision) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_known record;
BEGIN
    SELECT k.* INTO v_known FROM _known_limits() k WHERE k.name = p_name;
    IF NOT FOUND THEN
        FOUND := _raise('ZC009', 'limit', 'name', format('%s is not known', quote_nullable(p_name)), 'limit_known',
                        format('Known: %s.', (SELECT string_agg(k.name, ', ') FROM _known_limits() k)));
    END IF;
    IF NOT (p_value >= 0 AND p_value <= v_known.most)
       OR v_known.unit IN ('vertices', 'waypoints') AND p_value <> trunc(p_value) THEN
        FOUND := _raise('ZC009', format('limit %L', p_name), 'value',
                        format('must be a number of %s from 0 to %s; got %s', v_known.unit, v_known.most, p_value),
                        'limit_is_number');
    END IF;
    IF p_value IS NULL THEN
        DELETE FROM upper_limit l WHERE l.name = p_name;
    ELSE
        INSERT INTO upper_limit (name, value) VALUES (p_name, p_value)
            ON CONFLICT (name) DO UPDATE SET value = excluded.value;
    END IF;
END
$$;
COMMENT ON FUNCTION set_limit(text, double precision) IS
'Sets a limit of the database (view limits); null restores its default. Statements that begin after the commit use it. '
'Only the owner of schema conflictdb may call this.';

CREATE OR REPLACE VIEW limits WITH (security_invoker = true) AS
SELECT k.name, coalesce(l.value, k.default_value) AS value, k.default_value, k.unit, k.doc
FROM conflictdb_internal._known_limits() k LEFT JOIN upper_limit l ON l.name = k.name;

COMMENT ON VIEW limits IS
'Limits of the database, which set_limit changes. A setting conflictdb.<name> of a session, role or database lowers a '
'limit, and never raises it.';
COMMENT ON COLUMN limits.name IS 'Name, also of the setting, there with the prefix conflictdb.';
COMMENT ON COLUMN limits.value IS 'Value in force; null: no limit.';
COMMENT ON COLUMN limits.default_value IS 'Value without a call of set_limit; null: no limit.';
COMMENT ON COLUMN limits.unit IS 'Unit of the value.';
COMMENT ON COLUMN limits.doc IS 'What it limits.';
COMMENT ON TABLE upper_limit IS
'Limits that differ from their defaults; set_limit writes them, the view limits lists all. Only the owner of schema '
'conflictdb may change them.';
COMMENT ON COLUMN upper_limit.name IS 'Name of the limit.';
COMMENT ON COLUMN upper_limit.value IS 'Value, in the unit of the view limits.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_size(
    p_who text, p_field text, p_points bigint, p_limit text
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_most integer := _limit(p_limit);
BEGIN
    IF p_points > v_most THEN
        FOUND := _raise('ZC017', p_who, p_field,
                        format('must have at most %s %s; got %s', v_most, replace(p_limit, 'max_', ''), p_points),
                        'size_within_limit',
                        format('Simplify it, or split it into several objects; conflictdb.%s is the limit, as the view '
                               'conflictdb.limits says.', p_limit));
    END IF;
END
$$;
COMMENT ON FUNCTION _check_size(text, text, bigint, text) IS
'Raises ZC017 for more points than the limit max_vertices or max_waypoints (p_limit) allows.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_heights(
    p_who text, p_floor_m double precision, p_ceiling_m double precision
)
RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT (p_floor_m > '-infinity' AND p_floor_m < 'infinity') THEN
        FOUND := _raise('ZC004', p_who, 'floor_m', 'must be a finite number of metres, or absent', 'heights_finite');
    END IF;
    IF NOT (p_ceiling_m > '-infinity' AND p_ceiling_m < 'infinity') THEN
        FOUND := _raise('ZC004', p_who, 'ceiling_m', 'must be a finite number of metres, or absent', 'heights_finite');
    END IF;
    IF p_ceiling_m <= p_floor_m THEN
        FOUND := _raise('ZC004', p_who, 'ceiling_m',
                        format('must be above floor_m (%s); got %s', p_floor_m, p_ceiling_m), 'ceiling_above_floor');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_heights(text, double precision, double precision) IS
'Raises ZC004 unless heights (metres; null: no limit) are finite and the ceiling is above the floor.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_word(p_who text, p_field text, p_word text) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF NOT octet_length(p_word) BETWEEN 1 AND 200 THEN
        FOUND := _raise('ZC008', p_who, p_field, 'must be a text of 1 to 200 bytes, or null', 'word_valid');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_word(text, text, text) IS
'Raises ZC008 unless a class or an owner is null or a text of 1 to 200 bytes.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_common(
    p_who text, p_key text, p_floor_m double precision, p_ceiling_m double precision, p_properties jsonb, p_class text
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF p_key IS NULL OR p_key = '' OR octet_length(p_key) > 1000 THEN
        FOUND := _raise('ZC008', left(p_who, 100), 'key', 'must be a text of 1 to 1000 bytes', 'key_valid');
    END IF;
    IF p_class IN ('area', 'track') THEN
        FOUND := _raise('ZC008', p_who, 'class',
                        format('must not be %L, which separation rules use for all %ss', p_class, p_class),
                        'class_no_kind', 'Choose another name.');
    END IF;
    PERFORM _check_heights(p_who, p_floor_m, p_ceiling_m);
    IF jsonb_typeof(p_properties) IS DISTINCT FROM 'object' THEN
        FOUND := _raise('ZC012', p_who, 'properties', 'must be a JSON object', 'properties_object');
    END IF;
    IF NOT _is_plain(p_properties) THEN
        FOUND := _raise('ZC012', p_who, 'properties', 'must be nested at most 100 deep, with numbers up to 1.8e308',
                        'properties_plain');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_common(text, text, double precision, double precision, jsonb, text) IS
'Raises ZC004, ZC008 or ZC012 for an invalid key, heights (metres) or properties of an object, and for a class that is '
'a kind.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_datum(p_who text, p_scene_id bigint, p_stated text) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    -- How formats name them; as in conflictdb/model/settings.py.
    v_known text := CASE WHEN upper(btrim(p_stated)) IN ('MSL', 'AMSL') THEN 'msl'
                         WHEN upper(btrim(p_stated)) IN ('WGS84', 'W84') THEN 'wgs84'
                         WHEN upper(btrim(p_stated)) IN ('FLIGHT_LEVEL', 'FL', 'STD') THEN 'flight_level' END;
    v_own text;
BEGIN
    SELECT s.vertical_datum INTO v_own FROM scene s WHERE s.scene_id = p_scene_id;
    IF p_stated IS NOT NULL AND v_own <> coalesce(v_known, '') THEN
        FOUND := _raise('ZC004', p_who, 'vertical_datum',
                        format('must be %L, the scene''s, for an object with heights; got %L', v_own, p_stated),
                        'datum_of_scene', 'Convert the heights'
                        || coalesce(format(', or use a scene with vertical_datum %s.', v_known), '.'));
    END IF;
END
$$;
COMMENT ON FUNCTION _check_datum(text, bigint, text) IS
'Raises ZC004 if the heights of an object are said to be above another vertical datum than the scene''s.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_leg_heights(
    p_who text, p_path geometry, p_floor_m double precision, p_ceiling_m double precision,
    p_floors_m double precision[], p_ceilings_m double precision[]
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_legs integer := ST_NPoints(p_path) - 1;
    v_bad record;
BEGIN
    SELECT h.* INTO v_bad FROM (VALUES ('floors_m', p_floors_m), ('ceilings_m', p_ceilings_m)) h (field, heights)
        WHERE array_ndims(h.heights) IS DISTINCT FROM 1 AND h.heights IS NOT NULL OR array_lower(h.heights, 1) <> 1
           OR cardinality(h.heights) NOT IN (v_legs, v_legs + 1) LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC004', p_who, v_bad.field,
                        format('must be one per leg (%s) or one per waypoint (%s); got %s heights', v_legs, v_legs + 1,
                               cardinality(v_bad.heights)), 'height_per_leg', 'Null is no limit.');
    END IF;
    SELECT format('%s[%s]', h.field, u.nr) AS field, u.height INTO v_bad
        FROM (VALUES ('floors_m', p_floors_m), ('ceilings_m', p_ceilings_m)) h (field, heights)
        CROSS JOIN LATERAL unnest(h.heights) WITH ORDINALITY u (height, nr)
        WHERE NOT (u.height > '-infinity' AND u.height < 'infinity') LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC004', p_who, v_bad.field, format('heights must be finite, or null; got %s', v_bad.height),
                        'heights_finite');
    END IF;
    -- At both ends of each leg: with one height per waypoint, these are of two waypoints, and null if one of them is.
    SELECT n.leg, f.floor_m, c.ceiling_m INTO v_bad
        FROM generate_series(1, v_legs) n (leg) CROSS JOIN generate_series(0, 1) e (after)
        CROSS JOIN LATERAL (SELECT CASE WHEN p_floors_m IS NULL THEN p_floor_m
                                        WHEN cardinality(p_floors_m) = v_legs THEN p_floors_m[n.leg]
                                        WHEN p_floors_m[n.leg + 1 - e.after] IS NOT NULL
                                        THEN p_floors_m[n.leg + e.after] END AS floor_m) f
        CROSS JOIN LATERAL (SELECT CASE WHEN p_ceilings_m IS NULL THEN p_ceiling_m
                                        WHEN cardinality(p_ceilings_m) = v_legs THEN p_ceilings_m[n.leg]
                                        WHEN p_ceilings_m[n.leg + 1 - e.after] IS NOT NULL
                                        THEN p_ceilings_m[n.leg + e.after] END AS ceiling_m) c
        WHERE c.ceiling_m <= f.floor_m
        ORDER BY n.leg, e.after LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC004', p_who, format('leg %s', v_bad.leg),
                        format('must have the ceiling above the floor; got %s to %s', v_bad.floor_m, v_bad.ceiling_m),
                        'ceiling_above_floor');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_leg_heights(text, geometry, double precision, double precision, double precision[],
                                       double precision[]) IS
'Raises ZC004 unless there is one height (metres) per leg or per waypoint, heights are finite or null, and ceilings '
'are above floors. Legs count from 1. A null array means that the height of the whole track applies.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_tolerances(
    p_who text, p_tolerances jsonb, p_path geometry
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_legs integer := ST_NPoints(p_path) - 1;
    v_one record;
    v_count integer;
    v_most double precision;
    v_number jsonb;
    v_window timestamptz[];
    v_planned timestamptz;
BEGIN
    IF jsonb_typeof(p_tolerances) <> 'object' THEN
        FOUND := _raise('ZC007', p_who, 'tolerances', 'must be a JSON object', 'tolerances_object');
    END IF;
    FOR v_one IN SELECT t.key, t.value FROM jsonb_each(p_tolerances) t WHERE t.value <> 'null' LOOP
        v_most := CASE WHEN v_one.key IN ('xtd_port_m', 'xtd_starboard_m', 'turn_radius_m') THEN 18520
                       WHEN v_one.key IN ('min_speed_kn', 'max_speed_kn') THEN 100000
                       WHEN v_one.key NOT IN ('departure_window', 'arrival_window') THEN -1 END;
        IF v_most = -1 THEN
            FOUND := _raise('ZC007', p_who, 'tolerances', format('%L is not known', v_one.key), 'tolerances_known',
                            'Known: xtd_port_m, xtd_starboard_m, min_speed_kn, max_speed_kn, turn_radius_m, '
                            'departure_window, arrival_window.');
        END IF;
        v_count := v_legs - (v_one.key = 'turn_radius_m')::integer;
        IF v_most IS NULL THEN
            v_planned := to_timestamp(ST_M(CASE v_one.key WHEN 'departure_window' THEN ST_StartPoint(p_path)
                                                          ELSE ST_EndPoint(p_path) END));
            v_count := 2;
        END IF;
        IF jsonb_typeof(v_one.value) = 'array' AND jsonb_array_length(v_one.value) <> v_count
           OR v_most IS NULL AND jsonb_typeof(v_one.value) <> 'array' THEN
            FOUND := _raise('ZC007', p_who, v_one.key, CASE WHEN v_most IS NULL THEN 'must be [earliest, latest]'
                            ELSE format('must be one number, or %s', v_count) END, 'tolerances_count');
        END IF;
        IF v_most IS NULL THEN
            BEGIN
                v_window := ARRAY[instant(v_one.value ->> 0), instant(v_one.value ->> 1)];
            EXCEPTION WHEN data_exception OR SQLSTATE 'ZC003' THEN
                v_window := NULL;
            END;
            IF (v_window[1] <= v_planned AND v_planned <= v_window[2]
                AND v_window[2] - v_window[1] <= interval '366 days') IS NOT TRUE THEN
                FOUND := _raise('ZC007', p_who, v_one.key,
                                'must be two instants, at most a year apart, with the planned time of its waypoint '
                                'between them', 'tolerances_window');
            END IF;
        ELSE
            FOR v_number IN SELECT n FROM jsonb_array_elements(
                CASE jsonb_typeof(v_one.value) WHEN 'array' THEN v_one.value ELSE jsonb_build_array(v_one.value) END
            ) n LOOP
                -- As numeric: not every number of JSON is a double.
                IF (jsonb_typeof(v_number) = 'number' AND v_number::numeric BETWEEN 0 AND v_most::numeric
                    AND NOT (v_number::numeric > 0 AND v_number::numeric < 1e-300)
                    AND NOT (v_one.key = 'max_speed_kn' AND v_number::numeric = 0)) IS NOT TRUE THEN
                    FOUND := _raise('ZC007', p_who, v_one.key,
                                    format('must be a number from 0 to %s; got %s', v_most, left(v_number::text, 60)),
                                    'tolerances_number',
                                    CASE WHEN v_one.key LIKE 'xtd%' THEN 'In metres.' ELSE 'See put_track.' END);
                END IF;
            END LOOP;
        END IF;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _check_tolerances(text, jsonb, geometry) IS
'Raises ZC007 unless the tolerances of a track are known members with valid values, one or one per leg.';

CREATE OR REPLACE FUNCTION conflictdb_internal._whole_height(
    p_who text, p_field text, p_given_m double precision, p_whole_m double precision, p_known_m double precision,
    p_is_changed boolean
) RETURNS double precision
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    -- A value left from before the heights of legs changed is not a contradiction.
    IF p_given_m IS DISTINCT FROM p_whole_m AND p_given_m IS NOT NULL
       AND NOT (p_is_changed AND p_given_m IS NOT DISTINCT FROM p_known_m) THEN
        FOUND := _raise('ZC004', p_who, p_field,
                        format('must be that of all legs (%s), or null; got %s', p_whole_m, p_given_m),
                        'height_of_all_legs');
    END IF;
    RETURN p_whole_m;
END
$$;
COMMENT ON FUNCTION _whole_height(text, text, double precision, double precision, double precision, boolean) IS
'Returns p_whole_m, the height (metres) of a whole track derived from its legs; raises ZC004 if another one was given.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_coordinates(
    p_who text, p_field text, p_geometry geometry, p_scene_id bigint
)
RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_latitude double precision := greatest(ST_YMax(p_geometry), -ST_YMin(p_geometry));
    v_longitude double precision := greatest(ST_XMax(p_geometry), -ST_XMin(p_geometry));
BEGIN
    -- A line through a non-finite coordinate has a non-finite length.
    IF NOT ST_Length(ST_MakeLine(ARRAY(SELECT d.geom FROM ST_DumpPoints(p_geometry) d))) < 'infinity' THEN
        FOUND := _raise('ZC001', p_who, p_field, 'coordinates must be finite numbers', 'coordinates_finite');
    END IF;
    IF v_latitude > 90 THEN
        FOUND := _raise('ZC005', p_who, p_field,
                        format('latitude must lie within +-90 degrees; got %s (is it longitude first?)', v_latitude),
                        'latitude_in_range');
    END IF;
    IF v_longitude > 360 THEN
        FOUND := _raise('ZC005', p_who, p_field,
                        format('longitude must lie within +-360 degrees; got %s', v_longitude), 'longitude_in_range');
    END IF;
    IF v_latitude > 89 AND EXISTS (SELECT FROM scene s WHERE s.scene_id = p_scene_id AND s.motion = 'rhumb') THEN
        FOUND := _raise('ZC005', p_who, p_field,
                        format('latitude beyond 89 degrees has no place in a scene with motion ''rhumb''; got %s',
                               v_latitude),
                        'latitude_in_plane',
                        'The Mercator plane stretches without limit towards the poles; that of motion '
                        '''great_circle'' does not.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_coordinates(text, text, geometry, bigint) IS
'Raises ZC001 or ZC005 for longitudes or latitudes (degrees) that are not finite, out of range or outside the plane.';

CREATE OR REPLACE FUNCTION conflictdb_internal._stays_simple(p_footprint geometry) RETURNS boolean
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_wide double precision := radians(ST_XMax(p_footprint) - ST_XMin(p_footprint));
    v_high double precision := radians(ST_YMax(p_footprint) - ST_YMin(p_footprint));
    v_lat double precision := radians(greatest(ST_YMax(p_footprint), -ST_YMin(p_footprint)));
BEGIN
    IF (v_wide <= 0.17 AND v_high <= 0.17 AND v_lat <= 1.5 AND ST_NPoints(p_footprint) <= 100
        AND ST_NRings(p_footprint) = 1) IS NOT TRUE THEN
        RETURN false;
    END IF;
    -- An edge that is straight in degrees has the distance s(t) from the great circle of its ends (as a sine, t from 0
    -- to 1), s(0) = s(1) = 0, and |s''| <= sin(lat) (wide^2 + 2 wide high) + (wide^2 + high^2) |s|, so that
    -- |s| <= sin(lat) (wide^2 + 2 wide high) / 7.9. Edges c apart in degrees are 0.99 cos(lat) c apart on the sphere.
    -- Two edges move by s each, and PROJ rounds by far less than 2e-8 (0.1 m).
    RETURN cos(v_lat) * radians(ST_MinimumClearance(p_footprint))
           > 0.27 * sin(v_lat) * (v_wide * v_wide + 2 * v_wide * v_high) + 2e-8;
END
$$;
COMMENT ON FUNCTION _stays_simple(geometry) IS
'Whether a footprint that is valid in degrees is certainly valid, too, if its edges are great circles; without a '
'projection.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_planar(
    p_who text, p_footprint geometry, p_plane text
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_planar geometry;
    v_reason text;
BEGIN
    IF p_plane LIKE '+proj=gnom%' AND (ST_XMax(p_footprint) >= 180 OR ST_XMin(p_footprint) <= -180
                                       OR greatest(ST_YMax(p_footprint), -ST_YMin(p_footprint)) >= 90
                                       OR _stays_simple(p_footprint)) THEN
        -- It was split at the antimeridian or runs along a pole, and is whole in the gnomonic plane; or edges are far
        -- enough apart. PROJ prepares the projection at each call.
        RETURN;
    END IF;
    v_planar := _to_plane(p_footprint, p_plane);
    v_reason := ST_IsValidReason(v_planar);
    -- Ignore polygons narrower than the plane's rounding error (metres): they may only look invalid.
    IF v_reason <> 'Valid Geometry'
       AND ST_Area(ST_OrientedEnvelope(v_planar)) > 1e-6 * greatest(ST_Perimeter(v_planar), 1) THEN
        FOUND := _raise('ZC001', p_who, 'footprint',
                        format('crosses itself when its edges are %s (%s)',
                               CASE WHEN p_plane LIKE '+proj=gnom%' THEN 'great circles' ELSE 'rhumb lines' END,
                               split_part(v_reason, '[', 1)),
                        'footprint_valid_in_plane', 'Add points to the long edges.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_planar(text, geometry, text) IS
'Raises ZC001 for a footprint that is valid in degrees but not in the scene''s plane, where its edges are straight.';

CREATE OR REPLACE FUNCTION conflictdb_internal._middle_of(p_geometry geometry) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- The mean in space. If it is near zero (points all around the earth), use the first point.
    WITH mean AS (
        SELECT avg(cosd(d.lat) * cosd(d.lon)) AS x, avg(cosd(d.lat) * sind(d.lon)) AS y, avg(sind(d.lat)) AS z
        FROM (SELECT _not_tiny(ST_X(v.geom)) AS lon, _not_tiny(ST_Y(v.geom)) AS lat
              FROM ST_DumpPoints(p_geometry) v OFFSET 0) d
    ), place AS (
        SELECT CASE WHEN m.x ^ 2 + m.y ^ 2 + m.z ^ 2 < 1e-12 THEN _wrapped(ST_GeometryN(ST_Points(p_geometry), 1))
                    ELSE ST_MakePoint(atan2d(m.y, m.x), atan2d(m.z, sqrt(m.x ^ 2 + m.y ^ 2))) END AS place
        FROM mean m
    )
    SELECT ST_SetSRID(ST_SnapToGrid(ST_Force2D(p.place), 1e-6), 4326) FROM place p;
END;
COMMENT ON FUNCTION _middle_of(geometry) IS
'Returns the mean of the points of a geometry (longitude and latitude) on the sphere, rounded to 1e-6 degrees.';

CREATE OR REPLACE FUNCTION conflictdb_internal._from_centre_deg(
    p_geometry geometry, p_lon double precision, p_lat double precision
)
RETURNS double precision
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT degrees(2 * asin(least(1.0, sqrt(max(
               sin(radians(_not_tiny(ST_Y(d.geom) - p_lat)) / 2) ^ 2
               + cosd(p_lat) * cosd(ST_Y(d.geom)) * sin(radians(_not_tiny(ST_X(d.geom) - p_lon)) / 2) ^ 2)))))
    FROM ST_DumpPoints(p_geometry) d;
END;
COMMENT ON FUNCTION _from_centre_deg(geometry, double precision, double precision) IS
'Greatest distance of a geometry''s points (longitude and latitude) from a place, degrees along a great circle.';

CREATE OR REPLACE FUNCTION conflictdb_internal._box_is_near_centre(
    p_geometry geometry, p_centre_lon double precision, p_centre_lat double precision
) RETURNS boolean
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    -- Along a meridian, then along a parallel: no shorter way.
    SELECT greatest(ST_XMax(p_geometry) - p_centre_lon, p_centre_lon - ST_XMin(p_geometry))
           + greatest(ST_YMax(p_geometry) - p_centre_lat, p_centre_lat - ST_YMin(p_geometry)) <= 60;
END;
COMMENT ON FUNCTION _box_is_near_centre(geometry, double precision, double precision) IS
'Whether the box of a geometry is certainly within 60 degrees of a centre; null without a centre. A box lacks points '
'that are no numbers. Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_near_centre(
    p_who text, p_field text, p_geometry geometry, p_centre_lon double precision, p_centre_lat double precision
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_far double precision;
BEGIN
    IF GeometryType(p_geometry) IN ('POLYGON', 'MULTIPOLYGON') AND ST_Perimeter(p_geometry) < 'infinity'
       AND _box_is_near_centre(p_geometry, p_centre_lon, p_centre_lat) THEN
        RETURN;
    END IF;
    v_far := _from_centre_deg(p_geometry, p_centre_lon, p_centre_lat);
    IF v_far > 60 + 1e-9 THEN
        FOUND := _raise('ZC005', p_who, p_field,
                        format('reaches %s degrees from the scene''s centre (%s, %s); with motion ''great_circle'' all '
                               'must lie within 60', round(v_far::numeric, 1), p_centre_lon,
                               p_centre_lat),
                        'object_near_centre',
                        'Give the scene a centre in the middle of its objects, split it, or use motion ''rhumb''.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_near_centre(text, text, geometry, double precision, double precision) IS
'Raises ZC005 for a geometry beyond 60 degrees from the centre of a great-circle scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._near_centre(
    p_geometry geometry, p_centre_lon double precision, p_centre_lat double precision
) RETURNS geometry
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _check_near_centre('what is asked about', 'geometry', p_geometry, p_centre_lon, p_centre_lat);
    RETURN p_geometry;
END
$$;
COMMENT ON FUNCTION _near_centre(geometry, double precision, double precision) IS
'Returns a geometry (longitude and latitude); raises ZC005 if it leaves the plane of a great-circle scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_times(p_who text, p_path geometry) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_bad record;
BEGIN
    WITH waypoint AS (
        SELECT d.path[1] - 1 AS n, round(ST_M(d.geom) * 1e6) AS us, ST_X(d.geom) AS lon, ST_Y(d.geom) AS lat
        FROM ST_DumpPoints(p_path) d
    ), step AS (
        SELECT w.n, w.us >= -62135596800e6 AND w.us < 253402300800e6 AS is_in_calendar, w.us - lag(w.us) OVER o AS us,
               (w.lon, w.lat) <> (lag(w.lon) OVER o, lag(w.lat) OVER o) AS moves
        FROM waypoint w WINDOW o AS (ORDER BY w.n)
    )
    SELECT s.*, CASE WHEN s.us = 0 AND s.moves THEN 'is at two places at the same time'
                     ELSE 'must be later than the time before it' END AS rule
        INTO v_bad FROM step s WHERE NOT s.is_in_calendar OR s.us <= 0 ORDER BY s.n LIMIT 1;
    IF FOUND AND NOT v_bad.is_in_calendar THEN
        FOUND := _raise('ZC003', p_who, 'path', format('times[%s] must lie in the years 1 to 9999', v_bad.n),
                        'path_in_calendar', 'M is Unix seconds.');
    ELSIF FOUND THEN
        FOUND := _raise('ZC002', p_who, 'path', format('times[%s] %s', v_bad.n, v_bad.rule),
                        'path_time_increasing', 'M is Unix seconds, precise to the microsecond.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_times(text, geometry) IS
'Raises ZC003 or ZC002 unless M (Unix seconds) lies in the years 1 to 9999 and increases by at least a microsecond.';

CREATE OR REPLACE FUNCTION conflictdb_internal._faster_leg(
    p_path geometry, p_most_kn double precision, OUT leg integer, OUT kn double precision
)
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    -- Relative slack; SPEED_SLACK in conflictdb.speeds.
    c_slack CONSTANT double precision := 0.01;
    -- Of the mean sphere, nautical miles, and seconds an hour.
    c_diameter_nmi CONSTANT double precision := 2 * _sphere_m()::double precision / 1852;
    c_hour_s CONSTANT double precision := 3600;
BEGIN
    -- ST_DistanceSphere opens the database of PROJ: 4 MB in each backend that writes a track.
    SELECT l.n, l.kn INTO leg, kn
        FROM (SELECT s.n, c_diameter_nmi * c_hour_s / s.took_s * asin(least(1, sqrt(
                         sin((s.lat - s.lat_before) / 2) ^ 2
                         + cos(s.lat_before) * cos(s.lat) * sin((s.lon - s.lon_before) / 2) ^ 2))) AS kn
              FROM (SELECT w.n, w.lon, w.lat, lag(w.lon) OVER o AS lon_before, lag(w.lat) OVER o AS lat_before,
                           w.s - lag(w.s) OVER o AS took_s
                    FROM (SELECT d.path[1] - 1 AS n, radians(_not_tiny(ST_X(d.geom))) AS lon,
                                 radians(_not_tiny(ST_Y(d.geom))) AS lat, ST_M(d.geom) AS s
                          FROM ST_DumpPoints(p_path) d) w
                    WINDOW o AS (ORDER BY w.n)) s) l
        WHERE l.kn > p_most_kn * (1 + c_slack) ORDER BY l.n LIMIT 1;
END
$$;
COMMENT ON FUNCTION _faster_leg(geometry, double precision) IS
'The first leg of a path (M: Unix seconds, increasing) that is faster than p_most_kn along its great circle, by the '
'number of its end from 0; null: none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_speed(p_who text, p_path geometry) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_most_kn double precision := _limit('max_speed_kn');
    v_bad record;
BEGIN
    IF v_most_kn = 'infinity' THEN
        RETURN;
    END IF;
    SELECT f.* INTO v_bad FROM _faster_leg(p_path, v_most_kn) f;
    IF v_bad.leg IS NOT NULL THEN
        FOUND := _raise('ZC002', p_who, 'path',
                        format('the leg to times[%s] is travelled at %s kn, beyond %s kn', v_bad.leg,
                               round(v_bad.kn::numeric), v_most_kn), 'path_speed_possible',
                        'If it is intended, raise the setting conflictdb.max_speed_kn, at most to its value in the '
                        'view conflictdb.limits.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_speed(text, geometry) IS
'Raises ZC002 for a path (M: Unix seconds) with a leg faster than _limit(''max_speed_kn'') along its great circle.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_outline(
    p_who text, p_outline geometry, p_field text DEFAULT 'outline'
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_left boolean;
    v_right boolean;
    v_turns double precision;
BEGIN
    -- As in conflictdb.model: rounding of the coordinates bends a straight corner by at most the slack.
    WITH vertex AS (
        SELECT d.path[2] AS n, _not_tiny(ST_X(d.geom)) AS x, _not_tiny(ST_Y(d.geom)) AS y
        FROM ST_DumpPoints(p_outline) d WHERE d.path[2] < ST_NPoints(p_outline)
    ), edge AS (
        SELECT v.n, coalesce(lead(v.x) OVER w, first_value(v.x) OVER w) - v.x AS dx,
               coalesce(lead(v.y) OVER w, first_value(v.y) OVER w) - v.y AS dy,
               8 * 2.220446049250313e-16 * max(greatest(abs(v.x), abs(v.y))) OVER () ^ 2 AS slack
        FROM vertex v WINDOW w AS (ORDER BY v.n)
    ), corner AS (
        SELECT e.dx * coalesce(lead(e.dy) OVER w, first_value(e.dy) OVER w)
               - e.dy * coalesce(lead(e.dx) OVER w, first_value(e.dx) OVER w) AS turn, e.slack
        FROM edge e WINDOW w AS (ORDER BY e.n)
    ), heading AS (
        SELECT e.n, atan2(e.dy, e.dx) - lag(atan2(e.dy, e.dx)) OVER (ORDER BY e.n) AS step
        FROM edge e WHERE e.dx <> 0 OR e.dy <> 0
    )
    SELECT bool_or(c.turn > c.slack), bool_or(c.turn < -c.slack),
           (SELECT abs(sum(h.step - 2 * pi() * round((h.step / (2 * pi()))::numeric)::double precision)) FROM heading h)
        INTO v_left, v_right, v_turns FROM corner c;
    IF (v_left AND v_right) OR v_turns > 2 * pi() + 1e-9 THEN
        FOUND := _raise('ZC006', p_who, p_field, 'must be a convex ring', 'outline_convex',
                        'Split it into several tracks, or use ST_ConvexHull.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_outline(text, geometry, text) IS
'Raises ZC006 for an outline (metres to starboard and ahead) that is not convex or winds more than once.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_growth(
    p_who text, p_path geometry, p_outline geometry, p_grow_mps double precision, p_outlines geometry
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_nr integer;
BEGIN
    IF (p_grow_mps BETWEEN 0 AND 1e6) IS NOT TRUE THEN
        FOUND := _raise('ZC006', p_who, 'grow_mps',
                        format('must be a number of metres per second from 0 to 1e6; got %s', p_grow_mps),
                        'track_growth_in_range', 'Use outlines for a shrinking haven.');
    END IF;
    IF p_grow_mps > 0 AND p_outlines IS NOT NULL THEN
        FOUND := _raise('ZC006', p_who, 'grow_mps', 'must not be given together with outlines',
                        'track_growth_given_once');
    END IF;
    -- A mitred corner of angle a moves 1 / sin(a / 2) times as fast as its sides; the limit is one degree.
    IF p_grow_mps > 0 AND (SELECT bool_or((c.dx ^ 2 + c.dy ^ 2 <= 1 / sind(0.5) ^ 2) IS NOT TRUE)
                           FROM _corners(p_outline) c) THEN
        FOUND := _raise('ZC006', p_who, 'outline', 'has a corner sharper than 1 degree, which would grow into a spike',
                        'outline_not_sharp', 'Cut off the corner, or give outlines instead of grow_mps.');
    END IF;
    IF p_outlines IS NULL THEN
        RETURN;
    END IF;
    IF ST_NumGeometries(p_outlines) <> ST_NPoints(p_path) THEN
        FOUND := _raise('ZC006', p_who, 'outlines',
                        format('must be one per waypoint: %s waypoints, %s outlines', ST_NPoints(p_path),
                               ST_NumGeometries(p_outlines)), 'outline_per_waypoint');
    END IF;
    SELECT min(d.path[1]) INTO v_nr FROM ST_Dump(p_outlines) d
        WHERE ST_IsEmpty(d.geom) OR ST_NumInteriorRings(d.geom) > 0 OR ST_SRID(d.geom) <> 0
           OR NOT ST_Length(ST_ExteriorRing(d.geom)) < 'infinity';
    IF v_nr IS NOT NULL THEN
        FOUND := _raise('ZC006', p_who, format('outlines[%s]', v_nr),
                        'must be one ring of finite [starboard, forward] metres, without SRID', 'outline_ring');
    END IF;
    SELECT min(d.path[1]) INTO v_nr FROM ST_Dump(p_outlines) d
        WHERE ST_NPoints(d.geom) <> ST_NPoints(ST_GeometryN(p_outlines, 1));
    IF v_nr IS NOT NULL THEN
        FOUND := _raise('ZC006', p_who, format('outlines[%s]', v_nr), 'must have as many vertices as the first',
                        'outlines_alike', 'A vertex may be given twice.');
    END IF;
    IF p_outline IS DISTINCT FROM ST_GeometryN(p_outlines, 1) THEN
        FOUND := _raise('ZC006', p_who, 'outline', 'must be the first of outlines, or null', 'outline_is_first');
    END IF;
    PERFORM _check_outline(p_who, d.geom, format('outlines[%s]', d.path[1])) FROM ST_Dump(p_outlines) d
        WHERE 1e12 * abs(ST_Area(ST_ConvexHull(d.geom)) - ST_Area(d.geom)) > ST_Area(d.geom);
    -- As in conflictdb.model.outlines.stays_convex: the turn at a corner is a quadratic in time; its Bernstein
    -- coefficients bound it.
    WITH vertex AS (
        SELECT o.path[1] AS leg, v.path[2] AS n, _not_tiny(ST_X(v.geom)) AS x, _not_tiny(ST_Y(v.geom)) AS y
        FROM ST_Dump(p_outlines) o CROSS JOIN LATERAL ST_DumpPoints(o.geom) v
    ), edge AS (
        SELECT v.leg, v.n, lead(v.x) OVER w - v.x AS dx, lead(v.y) OVER w - v.y AS dy,
               greatest(abs(v.x), abs(v.y)) AS size
        FROM vertex v WINDOW w AS (PARTITION BY v.leg ORDER BY v.n)
    ), pair AS (
        SELECT a.leg, a.n, a.dx AS ax, a.dy AS ay, b.dx AS bx, b.dy AS by,
               max(greatest(a.size, b.size)) OVER (PARTITION BY a.leg) AS size
        FROM edge a JOIN edge b ON b.leg = a.leg + 1 AND b.n = a.n
        WHERE a.dx <> 0 OR a.dy <> 0 OR b.dx <> 0 OR b.dy <> 0
    ), next AS (
        SELECT p.*, coalesce(lead(p.ax) OVER w, first_value(p.ax) OVER w) AS ax2,
               coalesce(lead(p.ay) OVER w, first_value(p.ay) OVER w) AS ay2,
               coalesce(lead(p.bx) OVER w, first_value(p.bx) OVER w) AS bx2,
               coalesce(lead(p.by) OVER w, first_value(p.by) OVER w) AS by2,
               count(*) OVER (PARTITION BY p.leg) AS edges
        FROM pair p WINDOW w AS (PARTITION BY p.leg ORDER BY p.n)
    ), turn AS (
        SELECT n.leg, n.size, n.ax * n.ay2 - n.ay * n.ax2 AS first, n.bx * n.by2 - n.by * n.bx2 AS last,
               n.ax * n.by2 - n.ay * n.bx2 + n.bx * n.ay2 - n.by * n.ax2 AS middle
        FROM next n WHERE n.edges > 2
    ), corner AS (
        SELECT t.leg, t.first * s.way AS first, t.middle * s.way AS middle, t.last * s.way AS last,
               32 * 2.220446049250313e-16 * t.size ^ 2 AS slack
        FROM turn t
        JOIN (SELECT u.leg, CASE WHEN sum(5 * u.first + u.middle + 5 * u.last) < 0 THEN -1 ELSE 1 END AS way
              FROM turn u GROUP BY u.leg) s USING (leg)
    )
    SELECT min(c.leg) INTO v_nr FROM corner c
        WHERE c.first < -c.slack OR c.last < -c.slack
           OR c.middle < -2 * sqrt(greatest(c.first, 0)) * sqrt(greatest(c.last, 0)) - c.slack;
    IF v_nr IS NOT NULL THEN
        FOUND := _raise('ZC006', p_who, format('outlines[%s]', v_nr + 1),
                        format('does not stay convex on the way from outlines[%s]', v_nr), 'outlines_stay_convex',
                        'Each vertex moves straight to its like: order them alike, or add a waypoint.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_growth(text, geometry, geometry, double precision, geometry) IS
'Raises ZC006 for an outward speed (m/s) that is out of range or makes spikes, and for outlines per waypoint that are '
'not rings, differ in their number of vertices, or are not convex at all times. Outlines count from 1.';

CREATE OR REPLACE FUNCTION conflictdb_internal._half_open(
    p_spans tstzmultirange, p_is_closed boolean
) RETURNS tstzmultirange
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Subqueries, because aggregates of one query are computed whatever CASE says. Expansions are half-open.
    SELECT CASE WHEN (SELECT bool_and(lower_inc(s.span) AND NOT upper_inc(s.span)
                                      AND isfinite(lower(s.span)) AND isfinite(upper(s.span)))
                      FROM unnest(p_spans) s (span))
                THEN p_spans
                ELSE (SELECT coalesce(range_agg(_half_open(s.span, p_is_closed)), '{}')
                      FROM unnest(p_spans) s (span)) END;
END;
COMMENT ON FUNCTION _half_open(tstzmultirange, boolean) IS
'Returns the same instants as spans [start, end), joined where they touch.';

CREATE OR REPLACE FUNCTION conflictdb_internal._ends_of(p_spans tstzmultirange) RETURNS timestamptz[]
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(array_agg(e.at ORDER BY r.n, e.is_end), '{}')
    FROM unnest(p_spans) WITH ORDINALITY r (span, n)
    CROSS JOIN LATERAL (VALUES (0, coalesce(lower(r.span), '-infinity')),
                               (1, coalesce(upper(r.span), 'infinity'))) e (is_end, at);
END;
COMMENT ON FUNCTION _ends_of(tstzmultirange) IS 'Starts and ends of spans in turn; -infinity and infinity: unbounded.';

CREATE OR REPLACE FUNCTION conflictdb_internal._voyages(p_path geometry, p_departures timestamptz[]) RETURNS TABLE (
    later interval
)
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT d.at - to_timestamp(ST_M(ST_StartPoint(p_path))) FROM unnest(p_departures) d (at)
    UNION ALL
    SELECT interval '0' WHERE p_departures IS NULL;
END;
COMMENT ON FUNCTION _voyages(geometry, timestamptz[]) IS
'The voyages of a track: by how much each is later than the path says.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shift(
    p_path geometry, p_departures timestamptz[], p_at timestamptz
) RETURNS interval
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce((SELECT d.at - to_timestamp(ST_M(ST_StartPoint(p_path))) FROM unnest(p_departures) d (at)
                     WHERE d.at <= p_at ORDER BY d.at DESC LIMIT 1), '0');
END;
COMMENT ON FUNCTION _shift(geometry, timestamptz[], timestamptz) IS
'By how much the last voyage that departs by an instant is later than the path says; 0 if none departs.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_departures(
    p_who text, p_path geometry, p_departures timestamptz[]
) RETURNS void
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_lasts interval := to_timestamp(ST_M(ST_EndPoint(p_path))) - to_timestamp(ST_M(ST_StartPoint(p_path)));
    v_wrong integer;
BEGIN
    IF array_ndims(p_departures) > 1 OR cardinality(p_departures) > 105120 THEN
        FOUND := _raise('ZC002', p_who, 'departures', 'must be one list of at most 105120 instants',
                        'departures_listed');
    END IF;
    SELECT min(d.n) INTO v_wrong FROM unnest(p_departures) WITH ORDINALITY d (at, n)
        WHERE (d.at >= '0001-01-01 00:00+00' AND d.at < timestamptz '10000-01-01 00:00+00' - v_lasts) IS NOT TRUE;
    IF v_wrong IS NOT NULL THEN
        FOUND := _raise('ZC003', p_who, format('departures[%s]', v_wrong), 'must have a voyage in the years 1 to 9999',
                        'departures_in_calendar');
    END IF;
    SELECT min(d.n) INTO v_wrong
        FROM (SELECT u.n, u.at, lag(u.at) OVER (ORDER BY u.n) AS before
              FROM unnest(p_departures) WITH ORDINALITY u (at, n)) d
        WHERE d.at <= d.before OR d.at < d.before + v_lasts;
    IF v_wrong IS NOT NULL THEN
        FOUND := _raise('ZC003', p_who, format('departures[%s]', v_wrong),
                        format('is before the voyage before it has ended: a voyage takes %s', v_lasts),
                        'departures_apart', 'One object is in one place: use two tracks.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_departures(text, geometry, timestamptz[]) IS
'Raises SQLSTATE class ZC for departures that are not increasing, or before the voyage before them ended.';

CREATE OR REPLACE FUNCTION conflictdb_internal._active_within(p_span tstzrange, p_activations tstzmultirange)
RETURNS tstzrange
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_activations IS NULL THEN p_span ELSE range_merge(p_activations) END;
END;
COMMENT ON FUNCTION _active_within(tstzrange, tstzmultirange) IS
'From the first to the last activation of an area; empty if there is none. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._at_sea(p_path geometry, p_departures timestamptz[]) RETURNS tstzrange
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_departures IS NULL THEN tstzrange(p.first, p.last, '[]')
                WHEN cardinality(p_departures) = 0 THEN 'empty'
                ELSE tstzrange(p_departures[1], p_departures[cardinality(p_departures)] + (p.last - p.first), '[]') END
    FROM (SELECT to_timestamp(ST_M(ST_StartPoint(p_path))) AS first,
                 to_timestamp(ST_M(ST_EndPoint(p_path))) AS last) p;
END;
COMMENT ON FUNCTION _at_sea(geometry, timestamptz[]) IS
'From the first departure of a track to the end of its last voyage; empty if there is none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._longest_voyage_s(p_path geometry, p_tolerances jsonb)
RETURNS double precision
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- No leg is longer than the way along a meridian and a parallel, or shorter than 0.99 of that on the sphere.
    SELECT least(sum(greatest(l.planned_s, l.most_m / l.slowest)
                     + CASE WHEN p_tolerances ? 'turn_radius_m' AND l.slowest + l.after > 0
                            THEN least(l.most_m, l.next_m) / least(l.slowest, l.after) ELSE 0 END), 3.2e9)
    FROM (SELECT s.*, lead(s.most_m) OVER (ORDER BY s.n) AS next_m, lead(s.slowest) OVER (ORDER BY s.n) AS after
          FROM (SELECT v.n, v.planned_s, 111800 * (abs(v.lat) + abs(v.lon) * v.widest) AS most_m,
                       nullif(least(0.99 * v.sphere_m / v.planned_s,
                                    1852.0 / 3600.0 * CASE jsonb_typeof(p_tolerances -> 'min_speed_kn')
                                        WHEN 'array' THEN (p_tolerances -> 'min_speed_kn' ->> (v.n - 1))
                                        ELSE p_tolerances ->> 'min_speed_kn' END::double precision), 0) AS slowest
                FROM (SELECT g.n, ST_M(g.b) - ST_M(g.a) AS planned_s, ST_DistanceSphere(g.a, g.b) AS sphere_m,
                             ST_Y(g.b) - ST_Y(g.a) AS lat,
                             ST_X(g.b) - ST_X(g.a) - 360 * round((ST_X(g.b) - ST_X(g.a)) / 360) AS lon,
                             CASE WHEN ST_Y(g.a) * ST_Y(g.b) <= 0 THEN 1
                                  ELSE greatest(cosd(ST_Y(g.a)), cosd(ST_Y(g.b))) END AS widest
                      FROM (SELECT d.path[1] AS n, d.geom AS a, lead(d.geom) OVER (ORDER BY d.path) AS b
                            FROM ST_DumpPoints(p_path) d) g
                      WHERE g.b IS NOT NULL) v) s) l;
END;
COMMENT ON FUNCTION _longest_voyage_s(geometry, jsonb) IS
'No voyage of a track takes longer, seconds, if only its speeds and turns limit it. An arc is no longer than either of '
'its legs, and may be sailed as slowly as the slower one. At most a hundred years.';

CREATE OR REPLACE FUNCTION conflictdb_internal._under_way(
    p_path geometry, p_departures timestamptz[], p_tolerances jsonb, p_within_s double precision
) RETURNS tstzrange
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_sea tstzrange := _at_sea(p_path, p_departures);
    v_first timestamptz := lower(v_sea);
    v_last timestamptz := upper(v_sea);
    v_within interval := make_interval(secs => p_within_s);
BEGIN
    IF isempty(v_sea) THEN
        RETURN v_sea;
    END IF;
    IF p_tolerances ?| '{departure_window,arrival_window,min_speed_kn,turn_radius_m}' THEN
        v_last := coalesce((p_tolerances #>> '{arrival_window,1}')::timestamptz,
                           coalesce((p_tolerances #>> '{departure_window,1}')::timestamptz, v_first)
                           + make_interval(secs => _longest_voyage_s(p_path, p_tolerances)));
        v_first := least(v_first, (p_tolerances #>> '{departure_window,0}')::timestamptz);
    END IF;
    -- Within the years that schedules are expanded for.
    RETURN tstzrange(greatest(v_first - v_within, '0001-01-01 00:00+00'),
                     least(greatest(v_last, upper(v_sea)) + v_within, '9999-12-31 23:59:59.999998+00'), '[]');
END
$$;
COMMENT ON FUNCTION _under_way(geometry, timestamptz[], jsonb, double precision) IS
'When a voyage within its tolerances may be under way, or within so many seconds of that; empty if there is none.';
