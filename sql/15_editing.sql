-- Adding, replacing and removing scenes, areas and tracks. All are upserts by scene and key; without a change they
-- leave no mark. The triggers of 13_validation.sql check the rows.

CREATE OR REPLACE FUNCTION conflictdb_internal._set_columns(p_name text, p_settings jsonb) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- Great circles are defined on the sphere only.
    v_settings jsonb := CASE p_settings ->> 'motion' WHEN 'great_circle' THEN '{"earth": "sphere"}' ELSE '{}' END::jsonb
                        || jsonb_strip_nulls(p_settings);
    v_columns text;
    v_values text;
    v_scene_id bigint;
    v_turns integer := 0;
BEGIN
    SELECT string_agg(format('%I', k.key), ', '), string_agg(format('(n.given).%I', k.key), ', ')
        INTO v_columns, v_values FROM jsonb_object_keys(v_settings) k (key);
    -- A branch that has lost its parent would take the objects with it (_drop_orphans).
    PERFORM _free_orphan_name(p_name);
    LOOP
        IF v_columns IS NOT NULL THEN
            EXECUTE format('UPDATE scene s SET (%s) = ROW (%s)
                            FROM (SELECT o.scene_id, jsonb_populate_record(o, $2) AS given
                                  FROM scene o WHERE o.name = $1) n
                            WHERE s.scene_id = n.scene_id AND s.* IS DISTINCT FROM n.given', v_columns, v_values)
                USING p_name, v_settings;
        END IF;
        SELECT s.scene_id INTO v_scene_id FROM scene s WHERE s.name = p_name;
        IF FOUND THEN
            -- Under row-level security UPDATE silently skips a scene that is only readable.
            PERFORM _check_may_change(v_scene_id, p_name);
            RETURN v_scene_id;
        END IF;
        IF v_turns > 1 THEN
            FOUND := _raise('42501', format('scene %L', p_name), 'name',
                            format('is used by a scene that role %I may not read', current_user), 'scene_name_unique');
        END IF;
        v_turns := v_turns + 1;
        -- Settings that are not given get the defaults of the table.
        EXECUTE format('INSERT INTO scene (%s)
                        SELECT %s FROM (SELECT jsonb_populate_record(NULL::scene, $2) AS given) n
                        ON CONFLICT (name) DO NOTHING RETURNING scene_id',
                       concat_ws(', ', 'name', v_columns), concat_ws(', ', '$1', v_values))
            INTO v_scene_id USING p_name, v_settings;
        IF v_scene_id IS NOT NULL THEN
            RETURN v_scene_id;
        END IF;
        -- Another session has just created it; the next turn finds it.
    END LOOP;
END
$$;
COMMENT ON FUNCTION _set_columns(text, jsonb) IS 'As _set_scene, without rules.';

CREATE OR REPLACE FUNCTION conflictdb_internal._set_scene(p_name text, p_settings jsonb) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _set_columns(p_name, p_settings - 'rules');
BEGIN
    IF p_settings ? 'rules' THEN
        PERFORM _put_rules(v_scene_id, p_settings -> 'rules', true);
    END IF;
    RETURN v_scene_id;
END
$$;
COMMENT ON FUNCTION _set_scene(text, jsonb) IS
'As _put_scene, but checks only at commit whether objects fit the settings, so that objects may be changed too.';

CREATE OR REPLACE FUNCTION conflictdb_internal._put_scene(p_name text, p_settings jsonb) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _set_scene(p_name, p_settings);
BEGIN
    SET CONSTRAINTS scene_holds_objects IMMEDIATE;
    SET CONSTRAINTS scene_holds_objects DEFERRED;
    RETURN v_scene_id;
END
$$;
COMMENT ON FUNCTION _put_scene(text, jsonb) IS
'As create_scene. p_settings: by the columns of the table scene, and rules, all of them; null, and what is left out: '
'as it is, or the default.';

CREATE OR REPLACE FUNCTION create_scene(
    p_name text, p_motion text DEFAULT NULL, p_earth text DEFAULT NULL, p_method text DEFAULT NULL,
    p_tolerance_m double precision DEFAULT NULL, p_separation_m double precision DEFAULT NULL,
    p_nearest_m double precision DEFAULT NULL, p_centre_lon double precision DEFAULT NULL,
    p_centre_lat double precision DEFAULT NULL, p_vertical_separation_m double precision DEFAULT NULL,
    p_time_separation_s double precision DEFAULT NULL, p_delays_within_s double precision DEFAULT NULL,
    p_intervals text DEFAULT NULL, p_horizon_days double precision DEFAULT NULL, p_vertical_datum text DEFAULT NULL,
    p_regions text DEFAULT NULL
) RETURNS bigint
-- With extra_float_digits, numbers keep all digits.
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET extra_float_digits = 1 AS $$
BEGIN
    RETURN _put_scene(p_name, jsonb_build_object(
        'motion', p_motion, 'earth', p_earth, 'method', p_method, 'tolerance_m', p_tolerance_m,
        'separation_m', p_separation_m, 'nearest_m', p_nearest_m, 'centre_lon', p_centre_lon,
        'centre_lat', p_centre_lat, 'vertical_separation_m', p_vertical_separation_m,
        'time_separation_s', p_time_separation_s, 'delays_within_s', p_delays_within_s,
        'intervals', p_intervals, 'horizon_days', p_horizon_days, 'vertical_datum', p_vertical_datum,
        'regions', p_regions));
END
$$;
COMMENT ON FUNCTION create_scene(text, text, text, text, double precision, double precision, double precision,
                                 double precision, double precision, double precision, double precision,
                                 double precision, text, double precision, text, text) IS
'Creates a scene, or changes the given settings of an existing one; returns its id. Defaults of a new scene: motion '
'rhumb, earth wgs84 (great_circle: sphere), method exact, tolerance 1 m, separation 0 m, nearest 0 m (none), '
'vertical separation 0 m, separation in time 0 s, delays within 0 s (none stored), intervals '
'half_open, schedules expanded 366 days ahead, vertical datum msl, regions on. Default centre (degrees) of a '
'great_circle scene: the middle of its first object.';

CREATE OR REPLACE FUNCTION put_area(
    p_scene text, p_key text,
    /* area columns: PARAMETER */
    p_footprint geometry, p_active_span tstzrange DEFAULT NULL, p_floor_m double precision DEFAULT NULL,
    p_ceiling_m double precision DEFAULT NULL, p_name text DEFAULT NULL, p_properties jsonb DEFAULT '{}',
    p_class text DEFAULT NULL, p_owner text DEFAULT NULL, p_activations tstzmultirange DEFAULT NULL,
    p_schedule jsonb DEFAULT NULL
    /* end */
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch_to_change(p_scene);
    v_who text := format('area %L', p_key);
    v_area_id bigint;
BEGIN
    IF ST_SRID(p_footprint) <> 4326 THEN
        FOUND := _raise('ZC001', v_who, 'footprint', format('must have SRID 4326; got %s', ST_SRID(p_footprint)),
                        'footprint_srid', 'Use ST_Transform, or ST_SetSRID if it is longitude and latitude on WGS84.');
    END IF;
    IF GeometryType(p_footprint) NOT IN ('POLYGON', 'MULTIPOLYGON') THEN
        FOUND := _raise('ZC001', v_who, 'footprint', format('must be a Polygon or MultiPolygon; got %s',
                        GeometryType(p_footprint)), 'footprint_polygon');
    END IF;
    IF num_nonnulls(p_activations, p_schedule) = 2 OR num_nonnulls(p_activations, p_active_span) = 2 THEN
        FOUND := _raise('ZC003', v_who, 'activations', 'must not be given together with active_span or schedule',
                        'activations_once');
    END IF;
    INSERT INTO area AS a (
        scene_id, key,
        /* area columns: NAME */
        footprint, active_span, floor_m, ceiling_m, name, properties, class, owner, activations, schedule
        /* end */
    ) VALUES (
        v_scene_id, p_key,
        /* area columns: p_NAME but footprint = ST_Multi(ST_Force2D(p_footprint))
           but active_span = coalesce(p_active_span,
                                      CASE WHEN NOT isempty(p_activations) THEN range_merge(p_activations) END) */
        ST_Multi(ST_Force2D(p_footprint)),
        coalesce(p_active_span, CASE WHEN NOT isempty(p_activations) THEN range_merge(p_activations) END), p_floor_m,
        p_ceiling_m, p_name, p_properties, p_class, p_owner, p_activations, p_schedule
        /* end */
    ) ON CONFLICT (scene_id, key) DO UPDATE SET
        /* area columns: NAME = excluded.NAME */
        footprint = excluded.footprint, active_span = excluded.active_span, floor_m = excluded.floor_m,
        ceiling_m = excluded.ceiling_m, name = excluded.name, properties = excluded.properties, class = excluded.class,
        owner = excluded.owner, activations = excluded.activations, schedule = excluded.schedule
        /* end */
        WHERE (
            /* area columns: WRITTEN(a) */
            a.footprint, a.active_span, a.floor_m, a.ceiling_m, a.name, a.properties, a.class, a.owner,
            CASE WHEN a.schedule IS NULL THEN a.activations END, a.schedule
            /* end */
        ) IS DISTINCT FROM (
            /* area columns: excluded.NAME */
            excluded.footprint, excluded.active_span, excluded.floor_m, excluded.ceiling_m, excluded.name,
            excluded.properties, excluded.class, excluded.owner, excluded.activations, excluded.schedule
            /* end */
        )
        RETURNING a.area_id INTO v_area_id;
    RETURN coalesce(v_area_id, (SELECT a.area_id FROM area a WHERE a.scene_id = v_scene_id AND a.key = p_key));
END
$$;
COMMENT ON FUNCTION put_area(
    text, text,
    /* area columns: TYPE */
    geometry, tstzrange, double precision, double precision, text, jsonb, text, text, tstzmultirange, jsonb
    /* end */
) IS
'Adds an area to a scene, or replaces the one with that key; returns its id. '
'Longitude and latitude in degrees (SRID 4326), heights in metres above the vertical datum of the scene, active '
'during [start, end); null is unbounded. Objects of one owner are not compared with each other. It is active during '
'p_activations instead, or by p_schedule (JSON as in scene files), which the next detection expands and checks.';

CREATE OR REPLACE FUNCTION put_track(
    p_scene text, p_key text,
    /* track columns: PARAMETER */
    p_path geometry, p_outline geometry, p_floor_m double precision DEFAULT NULL,
    p_ceiling_m double precision DEFAULT NULL, p_name text DEFAULT NULL, p_properties jsonb DEFAULT '{}',
    p_grow_mps double precision DEFAULT 0, p_outlines geometry DEFAULT NULL, p_floors_m double precision[] DEFAULT NULL,
    p_ceilings_m double precision[] DEFAULT NULL, p_class text DEFAULT NULL, p_owner text DEFAULT NULL,
    p_tolerances jsonb DEFAULT NULL, p_departures timestamptz[] DEFAULT NULL, p_schedule jsonb DEFAULT NULL
    /* end */
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch_to_change(p_scene);
    v_who text := format('track %L', p_key);
    v_track_id bigint;
BEGIN
    IF ST_SRID(p_path) <> 4326 THEN
        FOUND := _raise('ZC001', v_who, 'path', format('must have SRID 4326; got %s', ST_SRID(p_path)), 'path_srid',
                        'Use ST_Transform, or ST_SetSRID if it is longitude and latitude on WGS84.');
    END IF;
    IF GeometryType(p_path) <> 'LINESTRINGM' THEN
        FOUND := _raise('ZC001', v_who, 'path', format('must be a LineStringM; got %s', GeometryType(p_path)),
                        'path_linestring_m', 'track_path(waypoints, times) makes one.');
    END IF;
    IF GeometryType(p_outline) NOT IN ('POLYGON') THEN
        FOUND := _raise('ZC006', v_who, 'outline', format('must be a Polygon; got %s', GeometryType(p_outline)),
                        'outline_ring', 'rectangle_outline(fore_m, aft_m, port_m, starboard_m) makes one.');
    END IF;
    IF GeometryType(p_outlines) NOT IN ('MULTIPOLYGON') THEN
        FOUND := _raise('ZC006', v_who, 'outlines', format('must be a MultiPolygon; got %s', GeometryType(p_outlines)),
                        'outlines_multipolygon', 'ST_Collect(ARRAY[...]) of outlines, one per waypoint, makes one.');
    END IF;
    IF num_nonnulls(p_departures, p_schedule) = 2 THEN
        FOUND := _raise('ZC003', v_who, 'departures', 'must not be given together with schedule', 'departures_once');
    END IF;
    INSERT INTO track AS t (
        scene_id, key,
        /* track columns: NAME */
        path, outline, floor_m, ceiling_m, name, properties, grow_mps, outlines, floors_m, ceilings_m, class, owner,
        tolerances, departures, schedule
        /* end */
    ) VALUES (
        v_scene_id, p_key,
        /* track columns: p_NAME but outline = ST_Force2D(p_outline) but outlines = ST_Force2D(p_outlines) */
        p_path, ST_Force2D(p_outline), p_floor_m, p_ceiling_m, p_name, p_properties, p_grow_mps, ST_Force2D(p_outlines),
        p_floors_m, p_ceilings_m, p_class, p_owner, p_tolerances, p_departures, p_schedule
        /* end */
    ) ON CONFLICT (scene_id, key) DO UPDATE SET
        /* track columns: NAME = excluded.NAME */
        path = excluded.path, outline = excluded.outline, floor_m = excluded.floor_m, ceiling_m = excluded.ceiling_m,
        name = excluded.name, properties = excluded.properties, grow_mps = excluded.grow_mps,
        outlines = excluded.outlines, floors_m = excluded.floors_m, ceilings_m = excluded.ceilings_m,
        class = excluded.class, owner = excluded.owner, tolerances = excluded.tolerances,
        departures = excluded.departures, schedule = excluded.schedule
        /* end */
        WHERE (
            /* track columns: WRITTEN(t) */
            t.path, t.outline, t.floor_m, t.ceiling_m, t.name, t.properties, t.grow_mps, t.outlines, t.floors_m,
            t.ceilings_m, t.class, t.owner, t.tolerances, CASE WHEN t.schedule IS NULL THEN t.departures END, t.schedule
            /* end */
        ) IS DISTINCT FROM (
            /* track columns: excluded.NAME */
            excluded.path, excluded.outline, excluded.floor_m, excluded.ceiling_m, excluded.name, excluded.properties,
            excluded.grow_mps, excluded.outlines, excluded.floors_m, excluded.ceilings_m, excluded.class,
            excluded.owner, excluded.tolerances, excluded.departures, excluded.schedule
            /* end */
        )
        RETURNING t.track_id INTO v_track_id;
    RETURN coalesce(v_track_id, (SELECT t.track_id FROM track t WHERE t.scene_id = v_scene_id AND t.key = p_key));
END
$$;
COMMENT ON FUNCTION put_track(
    text, text,
    /* track columns: TYPE */
    geometry, geometry, double precision, double precision, text, jsonb, double precision, geometry, double precision[],
    double precision[], text, text, jsonb, timestamptz[], jsonb
    /* end */
) IS
'Adds a track to a scene, or replaces the one with that key; returns its id. '
'p_path: LineStringM, longitude and latitude in degrees (SRID 4326), M in Unix seconds. '
'p_outline: the haven, a convex ring of (starboard, ahead) metres about the reference point. '
'The haven may change: p_grow_mps moves every side outward (metres per second) from the first waypoint''s time on, or '
'p_outlines gives a MultiPolygon with one outline per waypoint (p_outline may then be null). '
'Heights (metres above the vertical datum, null: no limit) apply to the whole track; p_floors_m and p_ceilings_m '
'instead give one per leg, or one per waypoint, between which it changes linearly (p_floor_m and p_ceiling_m must then '
'be null or agree). '
'Objects of one owner are not compared with each other. '
'p_tolerances: how far voyages may differ from the plan, e.g. {"xtd_port_m": 500, "max_speed_kn": 12}; members as in '
'scene files. Detections then protect a haven that contains every such voyage. '
'The voyage departs at p_departures instead of at its first '
'time, or at each start of p_schedule (JSON as in scene files), which the next detection expands and checks.';

CREATE OR REPLACE FUNCTION remove_object(p_scene text, p_key text) RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch_to_change(p_scene);
BEGIN
    DELETE FROM area a WHERE a.scene_id = v_scene_id AND a.key = p_key;
    IF FOUND THEN
        RETURN true;
    END IF;
    DELETE FROM track t WHERE t.scene_id = v_scene_id AND t.key = p_key;
    IF NOT FOUND AND _parent_of(v_scene_id) IS NOT NULL AND _has_key(v_scene_id, p_key) THEN
        INSERT INTO branch_edit (scene_id, key) VALUES (v_scene_id, p_key);
        RETURN true;
    END IF;
    RETURN FOUND;
END
$$;
COMMENT ON FUNCTION remove_object(text, text) IS
'Removes the area or track with that key from a scene; returns whether there was one. '
'Until the next detection its conflicts are shown as not current.';

CREATE OR REPLACE FUNCTION rectangle_outline(
    p_fore_m double precision, p_aft_m double precision, p_port_m double precision, p_starboard_m double precision
) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_MakePolygon(ST_MakeLine(ARRAY[
        ST_MakePoint(p_starboard_m, p_fore_m), ST_MakePoint(p_starboard_m, -p_aft_m),
        ST_MakePoint(-p_port_m, -p_aft_m), ST_MakePoint(-p_port_m, p_fore_m), ST_MakePoint(p_starboard_m, p_fore_m)]));
END;
COMMENT ON FUNCTION rectangle_outline(double precision, double precision, double precision, double precision) IS
'Returns the outline of a rectangular haven: metres ahead, astern, to port and to starboard of the reference point.';

CREATE OR REPLACE FUNCTION conflictdb_internal._timed_path(
    p_who text, p_waypoints geometry, p_times timestamptz[]
) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_lost bigint;
BEGIN
    IF GeometryType(p_waypoints) <> 'LINESTRING' OR ST_NPoints(p_waypoints) <> cardinality(p_times) THEN
        FOUND := _raise('ZC002', p_who, 'times',
                        format('must be one per waypoint of a LineString: %s waypoints, %s times',
                               ST_NPoints(p_waypoints), cardinality(p_times)), 'path_time_per_waypoint');
    END IF;
    SELECT min(t.n) - 1 INTO v_lost FROM unnest(p_times) WITH ORDINALITY t (at, n)
        WHERE isfinite(t.at)
          AND round(extract(epoch FROM t.at)::double precision * 1e6)::bigint <> extract(epoch FROM t.at) * 1000000;
    IF v_lost IS NOT NULL THEN
        FOUND := _raise('ZC003', p_who, format('times[%s]', v_lost),
                        'cannot be kept to the microsecond: '
                        'before November 1833 and after February 2106 it must be a whole second',
                        'path_time_kept', 'M is Unix seconds in double precision.');
    END IF;
    RETURN (SELECT ST_SetSRID(ST_MakeLine(ST_MakePointM(ST_X(d.geom), ST_Y(d.geom),
                                                        extract(epoch FROM p_times[d.path[1]])::double precision)
                                          ORDER BY d.path[1]), ST_SRID(p_waypoints))
            FROM ST_DumpPoints(p_waypoints) d);
END
$$;
COMMENT ON FUNCTION _timed_path(text, geometry, timestamptz[]) IS
'The path of a track, as track_path returns it; p_who names it in errors.';

CREATE OR REPLACE FUNCTION track_path(p_waypoints geometry, p_times timestamptz[]) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT _timed_path('track path', p_waypoints, p_times);
END;
COMMENT ON FUNCTION track_path(geometry, timestamptz[]) IS
'Returns the path of a track: a LineStringM of the waypoints, with their times as M (Unix seconds).';

CREATE OR REPLACE FUNCTION request_detection(p_scene text, p_full boolean DEFAULT false) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch_to_change(p_scene);
BEGIN
    IF p_full THEN
        PERFORM _mark_all(v_scene_id);
    END IF;
    PERFORM _wake_workers();
    RETURN _count_pending(v_scene_id);
END
$$;
COMMENT ON FUNCTION request_detection(text, boolean) IS
'Wakes the workers (channel conflictdb_request); returns how many objects of the scene wait for detection. '
'p_full: marks all objects first.';
