-- Requests to workers, of the kinds probe, delays and admit (jobs/probes.py answers them), and the routines of probes.
-- Workers run stages 3 and 4, so a request is a row that must be committed first. The role that asked and workers see
-- request and reply.

CREATE OR REPLACE FUNCTION conflictdb_internal._instant_of(p_us bigint) RETURNS timestamptz
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- In two steps, because microseconds may have more digits than a double.
    SELECT CASE WHEN abs(p_us::numeric) < 9e18 THEN
        to_timestamp(0) + p_us / 1000000 * interval '1 second' + p_us % 1000000 * interval '1 microsecond' END;
END;
COMMENT ON FUNCTION _instant_of(bigint) IS
'Converts microseconds since 1970 to an instant; null (unbounded) from 9e18 on.';

CREATE OR REPLACE FUNCTION conflictdb_internal._pieces_meeting(
    p_scene_id bigint, p_most_compared bigint, p_key text, p_kinds smallint[], p_numbers bigint[], p_turns integer[],
    p_hulls bytea[], p_starts_us bigint[], p_ends_us bigint[], p_inclusive boolean[], p_floors_m double precision[],
    p_ceilings_m double precision[]
) RETURNS TABLE (n bigint, piece_id bigint, pieces integer, object_number bigint, part integer)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
-- Forces the index join, as in _candidates.
SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off SET enable_seqscan = off
SET jit = off AS $$
DECLARE
    v_allowed jsonb := _allowed_types(p_scene_id);
BEGIN
    RETURN QUERY
        WITH near AS MATERIALIZED (
            SELECT q.given, p.piece_id, p.pieces, p.object_kind, p.object_id
            FROM (SELECT g AS given
                  FROM _given_pieces(p_scene_id, p_kinds, p_numbers, p_turns, p_hulls, p_starts_us, p_ends_us,
                                     p_inclusive, p_floors_m, p_ceilings_m) g OFFSET 0) q
            JOIN piece p ON _pieces_may_meet(q.given, p, 0, v_allowed) AND p.scene_id = p_scene_id
            WHERE NOT EXISTS (SELECT FROM area a
                              WHERE p.object_kind = 0 AND a.area_id = p.object_id AND a.key = p_key)
              AND NOT EXISTS (SELECT FROM track t
                              WHERE p.object_kind = 1 AND t.track_id = p.object_id AND t.key = p_key)
        )
        SELECT (m.given).piece_id - 1, m.piece_id, m.pieces, _object_number(m.object_kind, m.object_id), u.part
        FROM near m
        CROSS JOIN (SELECT coalesce(sum(c.pieces), 0) <= p_most_compared AS is_few FROM near c) f
        LEFT JOIN LATERAL (SELECT u.part FROM piece p CROSS JOIN LATERAL _pieces_of(p) u
                           WHERE f.is_few AND p.piece_id = m.piece_id AND _pieces_may_meet(m.given, u, 0, NULL)
                             AND _boxes_meet(u.hull, (m.given).hull) AND _hulls_meet(u.hull, (m.given).hull)
                           OFFSET 0) u ON true
        WHERE NOT f.is_few OR u.part IS NOT NULL;
END
$$;
COMMENT ON FUNCTION _pieces_meeting IS
'Stages 1 and 2 for pieces that are not stored (_given_pieces): pairs of a given piece (n, from 0) and a piece (row '
'and part) of the scene, which overlap in time and height and whose hulls meet. If more than p_most_compared pairs of '
'pieces are to be compared, stage 1 only: pairs of a given piece and a row, without part. Skips the object p_key.';

CREATE OR REPLACE FUNCTION conflictdb_internal._keys_of(p_scene_id bigint, p_kinds smallint[], p_ids bigint[])
RETURNS TABLE (kind smallint, id bigint, key text, name text)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT u.kind, u.id, coalesce(a.key, t.key), coalesce(a.name, t.name)
    FROM unnest(p_kinds, p_ids) u (kind, id)
    LEFT JOIN area a ON u.kind = 0 AND a.area_id = u.id AND a.scene_id + 0 = p_scene_id
    LEFT JOIN track t ON u.kind = 1 AND t.track_id = u.id AND t.scene_id + 0 = p_scene_id
    WHERE coalesce(a.key, t.key) IS NOT NULL;
END;
COMMENT ON FUNCTION _keys_of(bigint, smallint[], bigint[]) IS 'Keys and names of objects of a scene, by kind and id.';

CREATE OR REPLACE FUNCTION conflictdb_internal._prune_probes() RETURNS void
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    -- Nobody waits for another who deletes them.
    DELETE FROM probe_request p
        USING (SELECT x.probe_id FROM probe_request x WHERE x.asked_at < now() - interval '1 hour'
               FOR UPDATE SKIP LOCKED) free
        WHERE p.probe_id = free.probe_id;
END
$$;
COMMENT ON FUNCTION _prune_probes() IS
'Deletes old requests and their replies. Runs as its owner: the right to delete rows would include locking the table. '
'Restricted to requests older than an hour.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_area_probe(
    p_footprint geometry, p_active_span tstzrange, p_floor_m double precision, p_ceiling_m double precision
) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'what is asked about';
BEGIN
    PERFORM _check_place(p_footprint, p_active_span, p_floor_m, p_ceiling_m);
    IF GeometryType(p_footprint) NOT IN ('POLYGON', 'MULTIPOLYGON') THEN
        FOUND := _raise('ZC001', c_who, 'footprint', format('must be a Polygon or MultiPolygon; got %s',
                        GeometryType(p_footprint)), 'footprint_polygon');
    END IF;
    IF lower(p_active_span) < '0001-01-01 00:00+00' AND isfinite(lower(p_active_span))
       OR upper(p_active_span) < '0001-01-01 00:00+00' AND isfinite(upper(p_active_span))
       OR lower(p_active_span) >= '10000-01-01 00:00+00' AND isfinite(lower(p_active_span))
       OR upper(p_active_span) >= '10000-01-01 00:00+00' AND isfinite(upper(p_active_span)) THEN
        FOUND := _raise('ZC003', c_who, 'span', format('must lie within the years 1 to 9999; got %s', p_active_span),
                        'span_years');
    END IF;
    -- Infinite instants cannot be converted to microseconds.
    IF lower(p_active_span) = 'infinity' OR upper(p_active_span) = '-infinity' THEN
        FOUND := _raise('ZC003', c_who, 'span', 'must not start at infinity or end at -infinity', 'span_finite');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_area_probe(geometry, tstzrange, double precision, double precision) IS
'Raises an error (class ZC) for an area that a worker could not probe.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_track_probe(
    p_scene_id bigint, p_path geometry, p_outline geometry, p_floor_m double precision, p_ceiling_m double precision,
    p_grow_mps double precision
) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'what is asked about';
BEGIN
    IF p_path IS NULL OR GeometryType(p_path) <> 'LINESTRINGM' OR ST_IsEmpty(p_path) THEN
        FOUND := _raise('ZC001', c_who, 'path', format('must be a LineStringM with Unix seconds for M; got %s',
                        coalesce(GeometryType(p_path), 'null')), 'path_trajectory', 'track_path() makes one.');
    END IF;
    IF ST_SRID(p_path) <> 4326 THEN
        FOUND := _raise('ZC001', c_who, 'path', format('must have SRID 4326; got %s', ST_SRID(p_path)), 'path_srid');
    END IF;
    IF p_outline IS NULL OR GeometryType(p_outline) <> 'POLYGON' OR ST_IsEmpty(p_outline) THEN
        FOUND := _raise('ZC006', c_who, 'outline', format('must be a Polygon in metres; got %s',
                        coalesce(GeometryType(p_outline), 'null')), 'outline_polygon',
                        'rectangle_outline() makes one.');
    END IF;
    PERFORM _check_size(c_who, 'path', ST_NPoints(p_path), 'max_waypoints');
    PERFORM _check_size(c_who, 'outline', ST_NPoints(p_outline), 'max_vertices');
    -- The worker checks the rest; it cannot receive times that are not finite.
    IF NOT ST_Length(ST_SwapOrdinates(p_path, 'xm')) < 'infinity' OR NOT ST_Length(p_path) < 'infinity' THEN
        FOUND := _raise('ZC001', c_who, 'path', 'coordinates and times must be finite numbers', 'coordinates_finite');
    END IF;
    PERFORM _check_coordinates(c_who, 'path', p_path, p_scene_id);
    PERFORM _check_times(c_who, p_path);
    PERFORM _check_speed(c_who, p_path);
    PERFORM _check_heights(c_who, p_floor_m, p_ceiling_m);
END
$$;
COMMENT ON FUNCTION _check_track_probe(bigint, geometry, geometry, double precision, double precision,
                                       double precision) IS
'Raises an error (class ZC) for a track that a worker could not probe.';

-- Requests carry plans in the form of scene files: GeoJSON features, "version": 1. Workers read them as files.

CREATE OR REPLACE FUNCTION conflictdb_internal._instant_text(p_at timestamptz) RETURNS text
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN isfinite(p_at) THEN to_char(p_at AT TIME ZONE 'UTC', 'YYYY-MM-DD"T"HH24:MI:SS.US"Z"') END;
END;
COMMENT ON FUNCTION _instant_text(timestamptz) IS 'An instant as in scene files; null for null and infinity.';

CREATE OR REPLACE FUNCTION conflictdb_internal._positions(p_geometry geometry, p_are_closed boolean) RETURNS jsonb
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT jsonb_agg(jsonb_build_array(ST_X(d.geom), ST_Y(d.geom)) ORDER BY d.path)
    FROM ST_DumpPoints(p_geometry) d
    WHERE p_are_closed OR d.path[cardinality(d.path)] < ST_NPoints(p_geometry);
END;
COMMENT ON FUNCTION _positions(geometry, boolean) IS
'The points of a line or of a polygon with one ring as a JSON array; without the last one unless p_are_closed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._open_outline(p_outline geometry) RETURNS jsonb
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_ring jsonb := _positions(p_outline, false);
BEGIN
    -- A ring has at least four points: points and lines repeat theirs.
    WHILE jsonb_array_length(v_ring) BETWEEN 2 AND 3 AND v_ring -> -1 = v_ring -> -2 LOOP
        v_ring := v_ring - -1;
    END LOOP;
    RETURN v_ring;
END
$$;
COMMENT ON FUNCTION _open_outline(geometry) IS 'The vertices of a haven as a JSON array, each once.';

CREATE OR REPLACE FUNCTION conflictdb_internal._members_of_plans() RETURNS text[]
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT ARRAY[
        'kind',
        /* plan columns: MEMBERS */
        'start', 'end', 'times', 'datetimes', 'speed_kn', 'speed_mps',
        'outline_m', 'fore_m', 'fore_nmi', 'aft_m', 'aft_nmi', 'port_m', 'port_nmi', 'starboard_m', 'starboard_nmi',
        'floor_m', 'ceiling_m', 'name', 'grow_mps', 'outlines_m', 'class', 'owner',
        'xtd_port_m', 'xtd_starboard_m', 'min_speed_kn', 'max_speed_kn', 'turn_radius_m', 'departure_window',
            'arrival_window', 'spans', 'departures', 'schedule'
        /* end */
    ];
END;
COMMENT ON FUNCTION _members_of_plans() IS 'Names of properties that have a meaning in scene files.';

CREATE OR REPLACE FUNCTION conflictdb_internal._feature(p_area area) RETURNS jsonb
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT SET extra_float_digits = 1 AS $$
BEGIN
    RETURN jsonb_build_object(
        'type', 'Feature', 'version', 1, 'id', p_area.key,
        'geometry', jsonb_build_object('type', 'MultiPolygon', 'coordinates', (
            SELECT jsonb_agg(r.rings ORDER BY r.n)
            FROM (SELECT p.path[1] AS n, jsonb_agg(_positions(ST_ExteriorRing(g.geom), true) ORDER BY g.path) AS rings
                  FROM ST_Dump(p_area.footprint::geometry) p CROSS JOIN ST_DumpRings(p.geom) g GROUP BY p.path) r)),
        'properties', (coalesce(p_area.properties, '{}') - _members_of_plans()) || jsonb_strip_nulls(jsonb_build_object(
            'kind', 'area',
            /* area values: MEMBER, PRESENT(p_area) */
            'floor_m', p_area.floor_m, 'ceiling_m', p_area.ceiling_m, 'name', p_area.name, 'class', p_area.class,
            'owner', p_area.owner
            /* end */
            ))
            || CASE WHEN p_area.schedule IS NULL AND p_area.activations IS NOT NULL
                    THEN jsonb_build_object('spans', (
                        SELECT coalesce(jsonb_agg(jsonb_build_array(_instant_text(lower(s)), _instant_text(upper(s)))
                                                  ORDER BY s), '[]') FROM unnest(p_area.activations) s))
                    ELSE jsonb_strip_nulls(jsonb_build_object(
                        'start', _instant_text(lower(p_area.active_span)),
                        'end', _instant_text(upper(p_area.active_span))))
                    END
            -- A document keeps its nulls.
            /* area documents: || CASE WHEN p_area.NAME IS NULL THEN '{}'
               ELSE jsonb_build_object(MEMBER, p_area.NAME) END */
            || CASE WHEN p_area.schedule IS NULL THEN '{}' ELSE jsonb_build_object('schedule', p_area.schedule) END
            /* end */
            );
END
$$;
COMMENT ON FUNCTION _feature(area) IS 'A row of area as a feature of a scene file, with all digits.';

CREATE OR REPLACE FUNCTION conflictdb_internal._feature(p_track track) RETURNS jsonb
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT SET extra_float_digits = 1 AS $$
BEGIN
    RETURN jsonb_build_object(
        'type', 'Feature', 'version', 1, 'id', p_track.key,
        'geometry', jsonb_build_object('type', 'LineString', 'coordinates', _positions(p_track.path, true)),
        'properties', (coalesce(p_track.properties, '{}') - _members_of_plans())
            || coalesce(p_track.tolerances, '{}') || jsonb_strip_nulls(jsonb_build_object(
            'kind', 'track',
            /* track values: MEMBER, PRESENT(p_track) */
            'floor_m', p_track.floor_m, 'ceiling_m', p_track.ceiling_m, 'name', p_track.name,
            'grow_mps', nullif(p_track.grow_mps, 0), 'class', p_track.class, 'owner', p_track.owner
            /* end */
            ))
            || jsonb_build_object('times', (
                SELECT jsonb_agg(_instant_text(_instant_of(round(ST_M(d.geom) * 1e6)::bigint)) ORDER BY d.path)
                FROM ST_DumpPoints(p_track.path) d))
            -- Null heights of a leg mean no limit.
            || CASE WHEN p_track.floors_m IS NULL THEN '{}' ELSE jsonb_build_object('floor_m', p_track.floors_m) END
            || CASE WHEN p_track.ceilings_m IS NULL THEN '{}'
                    ELSE jsonb_build_object('ceiling_m', p_track.ceilings_m) END
            || CASE WHEN p_track.outlines IS NULL
                    THEN jsonb_build_object('outline_m', _open_outline(p_track.outline))
                    ELSE jsonb_build_object('outlines_m', (
                        SELECT jsonb_agg(_positions(ST_ExteriorRing(d.geom), true) ORDER BY d.path)
                        FROM ST_Dump(p_track.outlines) d)) END
            || CASE WHEN p_track.departures IS NULL OR p_track.schedule IS NOT NULL THEN '{}'
                    ELSE jsonb_build_object('departures', (
                        SELECT coalesce(jsonb_agg(_instant_text(d) ORDER BY n), '[]')
                        FROM unnest(p_track.departures) WITH ORDINALITY u (d, n))) END
            /* track documents: || CASE WHEN p_track.NAME IS NULL THEN '{}'
               ELSE jsonb_build_object(MEMBER, p_track.NAME) END but tolerances = */
            || CASE WHEN p_track.schedule IS NULL THEN '{}' ELSE jsonb_build_object('schedule', p_track.schedule) END
            /* end */
            );
END
$$;
COMMENT ON FUNCTION _feature(track) IS 'A row of track as a feature of a scene file, with all digits.';

CREATE OR REPLACE FUNCTION conflictdb_internal._plans_given(p_plans jsonb) RETURNS jsonb
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_most CONSTANT integer := 1000;
    c_members CONSTANT text[] := ARRAY['type', 'version', 'features', 'foreign'];
    c_versions CONSTANT jsonb[] := ARRAY['1', 'null']::jsonb[];
    v_is_collection boolean := coalesce(p_plans ->> 'type' = 'FeatureCollection', false);
    v_features jsonb := CASE WHEN v_is_collection THEN p_plans -> 'features' ELSE p_plans END;
    v_feature jsonb;
    v_who text;
    v_points bigint;
    v_most_points double precision := least(_limit('max_vertices'), _limit('max_waypoints'));
    v_member text;
BEGIN
    IF (jsonb_typeof(v_features) = 'array' AND jsonb_array_length(v_features) BETWEEN 1 AND c_most) IS NOT TRUE THEN
        FOUND := _raise('ZC016', 'plans', 'plans', format('must be a JSON array of 1 to %s plans', c_most),
                        'plans_array', 'Plans are GeoJSON features as in scene files.');
    END IF;
    IF v_is_collection THEN
        SELECT k INTO v_member FROM jsonb_object_keys(p_plans) k WHERE k <> ALL (c_members) ORDER BY k LIMIT 1;
        IF FOUND THEN
            FOUND := _raise('ZC016', 'plans', v_member, 'is not a member of plans', 'plan_members',
                            format('Known: %s.', array_to_string(c_members, ', ')));
        END IF;
        IF coalesce(p_plans -> 'version', 'null') <> ALL (c_versions) THEN
            FOUND := _raise('ZC016', 'plans', 'version',
                            format('must be 1; got %s', left((p_plans -> 'version')::text, 60)), 'plan_version');
        END IF;
    END IF;
    FOR v_feature IN SELECT f FROM jsonb_array_elements(v_features) f LOOP
        IF jsonb_typeof(v_feature) <> 'object' OR v_feature ->> 'type' IS DISTINCT FROM 'Feature' THEN
            FOUND := _raise('ZC016', 'plans', 'type', format('must be a GeoJSON Feature; got %s',
                                                             left(v_feature::text, 60)), 'plan_object');
        END IF;
        IF jsonb_typeof(v_feature -> 'id') IS DISTINCT FROM 'string' OR v_feature ->> 'id' = '' THEN
            FOUND := _raise('ZC016', 'plans', 'id', format('must be text, the key of a plan; got %s',
                                                           coalesce(left((v_feature -> 'id')::text, 60), 'none')),
                            'plan_object');
        END IF;
        v_who := format('plan %L', left(v_feature ->> 'id', 100));
        IF coalesce(v_feature -> 'version', 'null') <> ALL (c_versions) THEN
            FOUND := _raise('ZC016', v_who, 'version',
                            format('must be 1; got %s', left((v_feature -> 'version')::text, 60)), 'plan_version');
        END IF;
        -- Workers check all else. A point takes six characters at least, such as [0,0].
        IF octet_length(v_feature::text) / 6 > v_most_points THEN
            SELECT coalesce(sum(jsonb_array_length(r)), 0) INTO v_points
                FROM jsonb_path_query(v_feature -> 'geometry', CASE v_feature #>> '{geometry,type}'
                                          WHEN 'Polygon' THEN '$.coordinates[*]' WHEN 'MultiPolygon' THEN
                                          '$.coordinates[*][*]' ELSE '$.coordinates' END::jsonpath) r
                WHERE jsonb_typeof(r) = 'array';
            PERFORM CASE WHEN v_feature #>> '{geometry,type}' IN ('Polygon', 'MultiPolygon')
                         THEN _check_size(v_who, 'geometry', v_points, 'max_vertices')
                         ELSE _check_size(v_who, 'geometry', v_points, 'max_waypoints') END;
            SELECT coalesce(sum(jsonb_array_length(r)), 0) INTO v_points
                FROM jsonb_path_query(v_feature, '$.temporalGeometry.coordinates') r WHERE jsonb_typeof(r) = 'array';
            PERFORM _check_size(v_who, 'temporalGeometry', v_points, 'max_waypoints');
            SELECT coalesce(sum(jsonb_array_length(r)), 0) INTO v_points
                FROM (SELECT jsonb_path_query(v_feature, '$.properties.outline_m') AS r
                      UNION ALL SELECT jsonb_path_query(v_feature, '$.properties.outlines_m[*]')) o
                WHERE jsonb_typeof(r) = 'array';
            PERFORM _check_size(v_who, 'outline_m', v_points, 'max_vertices');
        END IF;
    END LOOP;
    SELECT f ->> 'id' INTO v_member FROM jsonb_array_elements(v_features) f GROUP BY 1 HAVING count(*) > 1 LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC007', format('plan %L', v_member), 'key', 'occurs more than once: keys must be unique',
                        'plan_key_unique');
    END IF;
    RETURN jsonb_build_object('type', 'FeatureCollection', 'version', 1, 'features', (
               SELECT jsonb_agg(f - 'version' ORDER BY n)
               FROM jsonb_array_elements(v_features) WITH ORDINALITY u (f, n)))
           || CASE WHEN v_is_collection AND p_plans ? 'foreign' THEN jsonb_build_object('foreign', p_plans -> 'foreign')
                   ELSE '{}' END;
END
$$;
COMMENT ON FUNCTION _plans_given(jsonb) IS
'Plans as a FeatureCollection, from one or from an array of GeoJSON features as in scene files, version 1. Raises '
'ZC016, ZC007 or ZC017 for plans that no worker could read; workers check the members.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_options(p_kind text, p_options jsonb) RETURNS void
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'what is asked about';
    -- Microseconds of the years 1 to 9999.
    c_first_us CONSTANT numeric := -62135596800000000;
    c_last_us CONSTANT numeric := 253402300799999999;
    -- As of the settings of a scene.
    c_most_margin_s CONSTANT numeric := 2592000;
    c_most_margin_m CONSTANT numeric := 1000000;
    v_member text;
BEGIN
    IF jsonb_typeof(p_options) IS DISTINCT FROM 'object' THEN
        FOUND := _raise('ZC016', c_who, 'options', 'must be a JSON object', 'options_object');
    END IF;
    SELECT e.key INTO v_member FROM jsonb_each(p_options) e
        LEFT JOIN (VALUES ('delays', 'key', 'string'), ('delays', 'horizon_s', 'number'),
                          ('delays', 'now_us', 'number'), ('delays', 'margin_s', 'number'),
                          ('delays', 'margin_m', 'number'), ('delays', 'from_us', 'number'),
                          ('delays', 'to_us', 'number'), ('delays', 'best', 'number'),
                          ('admit', 'owner', 'string'), ('admit', 'allow_known', 'boolean'),
                          ('admit', 'replace', 'array')) o (kind, key, type) ON o.kind = p_kind AND o.key = e.key
        WHERE o.type IS NULL OR jsonb_typeof(e.value) NOT IN (o.type, 'null')
              OR e.key = 'replace' AND CASE jsonb_typeof(e.value) WHEN 'array' THEN
                     jsonb_path_exists(e.value, 'strict $[*] ? (@.type() <> "string")') ELSE false END
        LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC016', c_who, v_member, format('is no option of %s, or not of its type', p_kind),
                        'options_known');
    END IF;
    IF (p_options ->> 'horizon_s')::numeric NOT BETWEEN 0 AND _longest_horizon_s() THEN
        FOUND := _raise('ZC003', c_who, 'horizon_s', format('must be a number from 0 to %s; got %s',
                        _longest_horizon_s(), left(p_options ->> 'horizon_s', 60)), 'horizon_finite');
    END IF;
    SELECT i.name INTO v_member FROM unnest(ARRAY['now_us', 'from_us', 'to_us']) i (name)
        WHERE (p_options ->> i.name)::numeric NOT BETWEEN c_first_us AND c_last_us
              OR (p_options ->> i.name)::numeric % 1 <> 0
        LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC003', c_who, v_member, format('must be whole microseconds since 1970, in the years 1 to '
                        '9999; got %s', left(p_options ->> v_member, 60)), 'now_finite');
    END IF;
    IF (p_options ->> 'margin_s')::numeric NOT BETWEEN 0 AND c_most_margin_s THEN
        FOUND := _raise('ZC003', c_who, 'margin_s', format('must be a number from 0 to %s; got %s', c_most_margin_s,
                        left(p_options ->> 'margin_s', 60)), 'margin_finite');
    END IF;
    IF (p_options ->> 'margin_m')::numeric NOT BETWEEN 0 AND c_most_margin_m THEN
        FOUND := _raise('ZC003', c_who, 'margin_m', format('must be a number from 0 to %s; got %s', c_most_margin_m,
                        left(p_options ->> 'margin_m', 60)), 'margin_finite');
    END IF;
    IF (p_options ->> 'best')::numeric NOT BETWEEN 1 AND 1000000 OR (p_options ->> 'best')::numeric % 1 <> 0 THEN
        FOUND := _raise('ZC003', c_who, 'best', format('must be a whole number from 1 to 1000000; got %s',
                        left(p_options ->> 'best', 60)), 'best_positive');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_options(text, jsonb) IS
'Raises ZC016 for options that a request of that kind does not have, ZC003 for numbers out of their range.';

-- Readers may insert requests directly, so every row is checked.

CREATE OR REPLACE FUNCTION conflictdb_internal._before_probe_request() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'what is asked about';
    -- Per role: more would delay others and fill the table.
    c_most_waiting CONSTANT integer := 1000;
    -- More than any plan within the limits has.
    c_most_bytes CONSTANT integer := 100000000;
    -- Per role, of requests that wait: they would fill the disk, and a worker reads some 20 MB/s.
    c_most_waiting_bytes CONSTANT integer := 200000000;
    -- A worker takes some 70 bytes for each, also where no limit of points counts them.
    c_most_values CONSTANT integer := 8000000;
    v_plans jsonb;
    v_values integer;
    v_waiting record;
BEGIN
    IF num_nonnulls(NEW.answered_at, NEW.is_current, NEW.error, NEW.answer) > 0 OR NEW.attempts <> 0
       OR NEW.attempted_at IS NOT NULL THEN
        FOUND := _raise('ZC013', c_who, 'answered_at', 'can be set by workers only', 'probe_unanswered');
    END IF;
    IF (NEW.kind IN ('probe', 'delays', 'admit')) IS NOT TRUE THEN
        FOUND := _raise('ZC016', c_who, 'kind', format('must be probe, delays or admit; got %s',
                                                       quote_nullable(NEW.kind)), 'probe_kind');
    END IF;
    NEW.asked_at := now();
    IF NEW.kind = 'admit' AND NOT _may_admit(NEW.asked_by, NEW.scene_id) THEN
        -- A worker puts them.
        FOUND := _raise('42501', c_who, 'plans', format('role %I may not change this scene', NEW.asked_by),
                        'admission_permitted', 'GRANT conflictdb_editor, or share the scene for writing.');
    END IF;
    PERFORM _check_options(NEW.kind, NEW.options);
    IF NEW.kind = 'delays' THEN
        NEW.plans := NULL;
        PERFORM _check_delays_request(
            NEW.scene_id, NEW.options ->> 'key',
            round((NEW.options ->> 'horizon_s')::numeric, 6)::double precision * interval '1 s',
            _instant_of((NEW.options ->> 'now_us')::numeric::bigint));
    ELSE
        IF octet_length(NEW.plans::text) > c_most_bytes THEN
            FOUND := _raise('ZC017', c_who, 'plans', format('must have at most %s bytes; got %s', c_most_bytes,
                            octet_length(NEW.plans::text)), 'size_within_limit', 'Ask in several requests.');
        END IF;
        IF octet_length(NEW.plans::text) > c_most_values THEN
            v_values := octet_length(NEW.plans::text) - octet_length(translate(NEW.plans::text, ',[{', ''));
            IF v_values > c_most_values THEN
                FOUND := _raise('ZC017', c_who, 'plans', format('must have at most %s values and lists; got %s',
                                c_most_values, v_values), 'size_within_limit', 'Ask in several requests.');
            END IF;
        END IF;
        v_plans := _plans_given(NEW.plans::jsonb);
        -- As given: jsonb has no negative zero.
        NEW.plans := CASE WHEN json_typeof(NEW.plans) = 'object' THEN NEW.plans ELSE v_plans::json END;
        PERFORM _check_word(c_who, 'owner', NEW.options ->> 'owner');
    END IF;
    NEW.bytes := coalesce(octet_length(NEW.plans::text), 0);
    SELECT count(*) AS requests, coalesce(sum(w.bytes), 0) AS bytes INTO v_waiting
        FROM (SELECT p.bytes FROM probe_request p WHERE p.asked_by = NEW.asked_by AND p.answered_at IS NULL
              LIMIT c_most_waiting) w;
    IF v_waiting.requests >= c_most_waiting THEN
        FOUND := _raise('ZC017', c_who, 'probe_request',
                        format('%s questions of role %I wait already', c_most_waiting, NEW.asked_by),
                        'probe_request_few', 'Is a worker running? Wait for its answers.');
    END IF;
    IF v_waiting.bytes + NEW.bytes > c_most_waiting_bytes THEN
        FOUND := _raise('ZC017', c_who, 'plans',
                        format('must have at most %s bytes with all questions of role %I that wait; got %s',
                               c_most_waiting_bytes, NEW.asked_by, v_waiting.bytes + NEW.bytes),
                        'probe_request_few', 'Is a worker running? Wait for its answers.');
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_probe_request() IS
'Trigger: checks a request; refuses it if 1,000 requests or 200 MB of the same role are waiting.';
CREATE OR REPLACE TRIGGER probe_request_checked BEFORE INSERT ON probe_request
    FOR EACH ROW EXECUTE FUNCTION _before_probe_request();
ALTER TABLE probe_request ENABLE ALWAYS TRIGGER probe_request_checked;

CREATE OR REPLACE FUNCTION conflictdb_internal._request(
    p_scene_id bigint, p_kind text, p_plans json, p_options jsonb DEFAULT '{}'
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_probe_id bigint;
BEGIN
    PERFORM _prune_probes();
    INSERT INTO probe_request (scene_id, kind, plans, options) VALUES (p_scene_id, p_kind, p_plans, p_options)
        RETURNING probe_id INTO v_probe_id;
    -- Somebody waits, so also while another transaction is about to wake the workers (_wake_workers).
    PERFORM _notify('conflictdb_request', '');
    RETURN v_probe_id;
END
$$;
COMMENT ON FUNCTION _request(bigint, text, json, jsonb) IS
'Leaves a request for the workers, who see it once it is committed; returns its id.';

CREATE OR REPLACE FUNCTION conflictdb_internal._of_replaced(
    p_scene_id bigint, INOUT p_key text, INOUT p_class text, INOUT p_owner text
)
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_replaced record;
BEGIN
    PERFORM _check_common('what is asked about', coalesce(p_key, 'plan'), NULL, NULL, '{}', p_class),
            _check_word('what is asked about', 'class', p_class), _check_word('what is asked about', 'owner', p_owner);
    IF p_key IS NULL THEN
        -- Nothing is replaced.
        p_key := CASE WHEN _has_key(p_scene_id, 'plan') THEN 'plan ' || gen_random_uuid() ELSE 'plan' END;
        RETURN;
    END IF;
    SELECT a.class, a.owner INTO v_replaced FROM area a WHERE a.scene_id = p_scene_id AND a.key = p_key;
    IF NOT FOUND THEN
        SELECT t.class, t.owner INTO v_replaced FROM track t WHERE t.scene_id = p_scene_id AND t.key = p_key;
    END IF;
    IF FOUND THEN
        p_class := coalesce(p_class, v_replaced.class);
        p_owner := coalesce(p_owner, v_replaced.owner);
    END IF;
END
$$;
COMMENT ON FUNCTION _of_replaced(bigint, text, text, text) IS
'Key, class and owner of a plan: where they are null, class and owner of the stored object of that key, and a key that '
'the scene does not have.';

CREATE OR REPLACE FUNCTION request_probe(
    p_scene text, p_footprint geometry, p_active_span tstzrange DEFAULT NULL,
    p_floor_m double precision DEFAULT NULL, p_ceiling_m double precision DEFAULT NULL, p_key text DEFAULT NULL,
    p_class text DEFAULT NULL, p_owner text DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_area area;
BEGIN
    PERFORM _check_area_probe(p_footprint, p_active_span, p_floor_m, p_ceiling_m);
    SELECT r.p_key, r.p_class, r.p_owner INTO v_area.key, v_area.class, v_area.owner
        FROM _of_replaced(v_scene_id, p_key, p_class, p_owner) r;
    v_area.footprint := ST_Multi(ST_Force2D(p_footprint));
    v_area.active_span := _half_open(coalesce(p_active_span, tstzrange(NULL, NULL)), _is_closed(v_scene_id));
    v_area.floor_m := p_floor_m;
    v_area.ceiling_m := p_ceiling_m;
    RETURN _request(v_scene_id, 'probe', json_build_array(_feature(v_area)));
END
$$;
COMMENT ON FUNCTION request_probe(text, geometry, tstzrange, double precision, double precision, text, text, text) IS
'Asks the workers which objects an area (longitude and latitude, SRID 4326; [start, end); heights in metres; null: '
'unbounded) would conflict with, and when, to the scene''s tolerance; returns an id for wait_for_probe, to be called '
'after commit. p_key: object that the area would replace, which is ignored. p_class, p_owner: class and owner of the '
'area; null: those of that object, else none.';

CREATE OR REPLACE FUNCTION request_track_probe(
    p_scene text, p_path geometry, p_outline geometry, p_floor_m double precision DEFAULT NULL,
    p_ceiling_m double precision DEFAULT NULL, p_grow_mps double precision DEFAULT 0, p_key text DEFAULT NULL,
    p_class text DEFAULT NULL, p_owner text DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_track track;
BEGIN
    PERFORM _check_track_probe(v_scene_id, p_path, p_outline, p_floor_m, p_ceiling_m, p_grow_mps);
    SELECT r.p_key, r.p_class, r.p_owner INTO v_track.key, v_track.class, v_track.owner
        FROM _of_replaced(v_scene_id, p_key, p_class, p_owner) r;
    v_track.path := p_path;
    v_track.outline := ST_Force2D(p_outline);
    v_track.floor_m := p_floor_m;
    v_track.ceiling_m := p_ceiling_m;
    v_track.grow_mps := coalesce(p_grow_mps, 0);
    RETURN _request(v_scene_id, 'probe', json_build_array(_feature(v_track)));
END
$$;
COMMENT ON FUNCTION request_track_probe(text, geometry, geometry, double precision, double precision,
                                        double precision, text, text, text) IS
'Asks the workers which objects a track (path and outline as in put_track; heights in metres; null: unbounded) would '
'conflict with, and when, to the scene''s tolerance; returns an id for wait_for_probe, to be called after commit. '
'p_key: object that the track would replace, which is ignored. p_class, p_owner: class and owner of the track; null: '
'those of that object, else none.';

CREATE OR REPLACE FUNCTION request_plans_probe(p_scene text, p_plans jsonb) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN _request(_scene_id(p_scene), 'probe', p_plans::json);
END
$$;
COMMENT ON FUNCTION request_plans_probe(text, jsonb) IS
'Asks the workers which objects plans would conflict with, and when, and which of each other. p_plans: a JSON array of '
'GeoJSON features as in scene files, each with "version": 1, or a FeatureCollection of them. Plans replace the objects '
'of the same keys together. Returns an id for wait_for_plans_probe, to be called after commit.';

CREATE OR REPLACE FUNCTION conflictdb_internal._end_of_wait(p_timeout interval) RETURNS timestamptz
LANGUAGE sql VOLATILE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Longer ones would be no instant.
    SELECT CASE WHEN p_timeout < interval '1000 years' THEN clock_timestamp() + greatest(p_timeout, '0') END;
END;
COMMENT ON FUNCTION _end_of_wait(interval) IS 'When a wait of some time ends; null: never.';

CREATE OR REPLACE FUNCTION conflictdb_internal._await_answer(
    p_probe_id bigint, p_timeout interval, p_kind text
) RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    c_longest_pause_s CONSTANT double precision := 0.02;
    v_until timestamptz := _end_of_wait(p_timeout);
    v_began timestamptz := clock_timestamp();
    v_waited_s double precision;
    v_who text := format('probe %s', coalesce(p_probe_id::text, 'null'));
    v_request record;
BEGIN
    LOOP
        SELECT p.answered_at, p.asked_at, p.error, p.is_current INTO v_request
            FROM probe_request p WHERE p.probe_id = p_probe_id AND p.kind = p_kind;
        IF NOT FOUND THEN
            FOUND := _raise('ZC011', v_who, 'probe_id', 'is not a request of this kind and role within the last hour',
                            'probe_known');
        END IF;
        EXIT WHEN v_request.answered_at IS NOT NULL;
        IF current_setting('transaction_isolation') <> 'read committed' THEN
            FOUND := _raise('ZC013', v_who, 'transaction',
                            format('is %s: it sees one state of the database until it ends, and would wait in vain',
                                   upper(current_setting('transaction_isolation'))),
                            'wait_sees_others', 'Wait in a transaction that is READ COMMITTED.');
        END IF;
        IF pg_current_xact_id_if_assigned() IS NOT NULL AND v_request.asked_at = now() THEN
            FOUND := _raise('ZC013', v_who, 'transaction', 'has asked, which no worker sees until it is committed',
                            'wait_sees_committed', 'Commit first.');
        END IF;
        IF clock_timestamp() >= v_until THEN
            FOUND := _raise('ZC015', v_who, 'answered_at', format('is not answered after %s', p_timeout),
                            'probe_answered_in_time', 'Is a worker running, and not at work on a large detection?');
        END IF;
        -- The answer is found within a tenth of the time that it took.
        v_waited_s := extract(epoch FROM clock_timestamp() - v_began);
        PERFORM pg_sleep(least(greatest(0.1 * v_waited_s, 0.001), c_longest_pause_s,
                               extract(epoch FROM v_until - clock_timestamp())));
    END LOOP;
    IF v_request.error IS NOT NULL THEN
        FOUND := _raise('ZC016', v_who, 'plan', v_request.error, 'probe_can_be_answered');
    END IF;
    RETURN v_request.is_current;
END
$$;
COMMENT ON FUNCTION _await_answer(bigint, interval, text) IS
'Waits until a worker has replied to a request of a kind; returns whether the scene was current then. '
'Raises ZC015 after p_timeout (null: waits without limit), ZC016 with the reason of an invalid plan, and ZC013 in a '
'transaction that cannot see the reply.';

CREATE OR REPLACE FUNCTION wait_for_plans_probe(p_probe_id bigint, p_timeout interval DEFAULT interval '1 minute')
RETURNS TABLE (
    plan_key text, key text, kind text, verdict text, periods tstzmultirange, first_contact timestamptz,
    last_contact timestamptz, time_error_s double precision, first_contact_point geometry, closest_at timestamptz,
    closest_m double precision, closest_error_m double precision, lacking_s double precision, certainty text
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_beyond text;
BEGIN
    IF EXISTS (SELECT FROM probe_request p WHERE p.probe_id = p_probe_id AND p.kind = 'admit') THEN
        FOUND := _raise('ZC011', format('probe %s', p_probe_id), 'probe_id', 'is an admission', 'probe_known',
                        'Use wait_for_admission.');
    END IF;
    IF NOT _await_answer(p_probe_id, p_timeout, 'probe') THEN
        RAISE NOTICE 'probe %: the scene was not current: changes of attached tables may be missing', p_probe_id;
    END IF;
    SELECT p.answer ->> 'beyond' INTO v_beyond FROM probe_request p WHERE p.probe_id = p_probe_id;
    IF v_beyond <> '' THEN
        RAISE NOTICE 'probe %: %: the answer may not be complete', p_probe_id, v_beyond
            USING HINT = 'The view scenes says expanded_from and expanded_until.';
    END IF;
    RETURN QUERY
        SELECT r.plan_key, r.key, CASE r.object_kind WHEN 0 THEN 'area' ELSE 'track' END, r.verdict, r.periods,
               lower(r.periods), upper(r.periods), r.time_error_s, r.first_contact_point, r.closest_at, r.closest_m,
               r.closest_error_m, r.lacking_s, r.certainty
        FROM probe_reply r WHERE r.probe_id = p_probe_id
        ORDER BY lower(r.periods) NULLS FIRST, r.plan_key, r.key;
END
$$;
COMMENT ON FUNCTION wait_for_plans_probe(bigint, interval) IS
'As wait_for_probe, for a request about several plans. plan_key: the plan; of two plans that conflict, the first, and '
'key is the second.';

CREATE OR REPLACE FUNCTION wait_for_probe(p_probe_id bigint, p_timeout interval DEFAULT interval '1 minute')
RETURNS TABLE (
    key text, kind text, verdict text, periods tstzmultirange, first_contact timestamptz, last_contact timestamptz,
    time_error_s double precision, first_contact_point geometry, closest_at timestamptz, closest_m double precision,
    closest_error_m double precision, lacking_s double precision, certainty text
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN QUERY
        SELECT w.key, w.kind, w.verdict, w.periods, w.first_contact, w.last_contact, w.time_error_s,
               w.first_contact_point, w.closest_at, w.closest_m, w.closest_error_m, w.lacking_s, w.certainty
        FROM wait_for_plans_probe(p_probe_id, p_timeout) w;
END
$$;
COMMENT ON FUNCTION wait_for_probe(bigint, interval) IS
'Waits for the reply to a probe; returns the objects that the plan would conflict with, with columns as in the view '
'conflicts. Raises ZC015 after p_timeout (null: waits without limit), ZC016 with the reason for an invalid plan, and '
'ZC013 in a transaction that cannot see the reply. Replies are kept for an hour, for the role that asked.';

-- For Python.

CREATE OR REPLACE FUNCTION conflictdb_internal._request_probe(p_scene text, p_plans json) RETURNS bigint
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    SELECT _request(_scene_id(p_scene), 'probe', p_plans);
END;
COMMENT ON FUNCTION _request_probe(text, json) IS 'As request_plans_probe, with all digits.';

CREATE OR REPLACE FUNCTION conflictdb_internal._wait_for_probe(p_probe_id bigint, p_timeout interval)
RETURNS TABLE (
    plan_key text, kind smallint, key text, name text, verdict text, periods bytea, time_error_s double precision,
    first_contact_lon_deg double precision, first_contact_lat_deg double precision, closest_at timestamptz,
    closest_m double precision, closest_error_m double precision, closest_a_lon_deg double precision,
    closest_a_lat_deg double precision, closest_b_lon_deg double precision, closest_b_lat_deg double precision,
    lacking_s double precision, certainty text
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM _await_answer(p_probe_id, p_timeout, 'probe');
    RETURN QUERY
        SELECT r.plan_key, r.object_kind, r.key, r.name, r.verdict, multirange_send(r.periods), r.time_error_s,
               ST_X(r.first_contact_point), ST_Y(r.first_contact_point), r.closest_at, r.closest_m, r.closest_error_m,
               ST_X(r.closest_a_point), ST_Y(r.closest_a_point), ST_X(r.closest_b_point), ST_Y(r.closest_b_point),
               r.lacking_s, r.certainty
        FROM probe_reply r WHERE r.probe_id = p_probe_id;
END
$$;
COMMENT ON FUNCTION _wait_for_probe(bigint, interval) IS
'As wait_for_plans_probe, without notices, with the names of the objects and with periods in binary.';

-- For workers.

CREATE OR REPLACE FUNCTION conflictdb_internal._claim_probe(
    p_passed_over bigint[], OUT probe_id bigint, OUT attempt smallint
)
LANGUAGE plpgsql VOLATILE STRICT SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    c_most_attempts CONSTANT integer := 3;
    -- A worker that has claimed a request locks it sooner (_hold_probe): two workers never count for one attempt.
    c_claimed CONSTANT interval := '1 s';
    v_next record;
BEGIN
    LOOP
        SELECT p.probe_id, p.attempts INTO v_next FROM probe_request p
            WHERE p.answered_at IS NULL AND p.probe_id <> ALL (p_passed_over)
              AND (p.attempted_at > clock_timestamp() - c_claimed) IS NOT TRUE
              AND EXISTS (SELECT FROM scene s WHERE s.scene_id = p.scene_id)
            -- Requests that failed last; then the scene and the role that have waited longest for a reply.
            ORDER BY p.attempts,
                     (SELECT max(q.answered_at) FROM probe_request q WHERE q.scene_id = p.scene_id) NULLS FIRST,
                     (SELECT max(q.answered_at) FROM probe_request q WHERE q.asked_by = p.asked_by) NULLS FIRST,
                     p.probe_id
            LIMIT 1 FOR UPDATE SKIP LOCKED;
        EXIT WHEN NOT FOUND;
        IF v_next.attempts < c_most_attempts THEN
            UPDATE probe_request p SET attempts = p.attempts + 1, attempted_at = clock_timestamp()
                WHERE p.probe_id = v_next.probe_id RETURNING p.probe_id, p.attempts INTO _claim_probe.probe_id, attempt;
            EXIT;
        END IF;
        UPDATE probe_request p SET answered_at = clock_timestamp(), is_current = false,
                error = format('could not be answered: none of %s attempts ended, as when a worker runs out of memory '
                               'or is stopped', c_most_attempts)
            WHERE p.probe_id = v_next.probe_id;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _claim_probe(bigint[]) IS
'The next request that no other session works on, without some, and the number of this attempt, which it counts; nulls '
'if there is none. Commit, so that it counts whatever happens next. A request whose third attempt has not ended is '
'answered by an error.';

CREATE OR REPLACE FUNCTION conflictdb_internal._hold_probe(p_probe_id bigint, p_attempt integer) RETURNS boolean
LANGUAGE plpgsql VOLATILE STRICT SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM FROM probe_request p
        WHERE p.probe_id = p_probe_id AND p.attempts = p_attempt AND p.answered_at IS NULL FOR UPDATE SKIP LOCKED;
    RETURN FOUND;
END
$$;
COMMENT ON FUNCTION _hold_probe(bigint, integer) IS
'Locks a claimed request until the transaction ends; returns false if it is gone, or was claimed again.';

CREATE OR REPLACE FUNCTION conflictdb_internal._release_probe(p_probe_id bigint) RETURNS void
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    UPDATE probe_request p SET attempts = p.attempts - 1, attempted_at = NULL WHERE p.probe_id = p_probe_id;
END;
COMMENT ON FUNCTION _release_probe(bigint) IS
'Takes back an attempt at a request that this transaction holds: another session was in the way.';

CREATE OR REPLACE FUNCTION conflictdb_internal._requested(
    p_probe_id bigint, OUT kind text, OUT scene text, OUT plans text, OUT options jsonb,
    OUT max_speed_kn double precision
)
LANGUAGE plpgsql STABLE STRICT SET search_path FROM CURRENT AS $$
DECLARE
    v_request record;
BEGIN
    SELECT p.kind, s.name AS scene, p.plans, p.options, p.asked_by, p.scene_id INTO v_request
        FROM probe_request p JOIN scene s USING (scene_id) WHERE p.probe_id = p_probe_id;
    IF v_request.kind = 'admit' AND NOT _may_admit(v_request.asked_by, v_request.scene_id) THEN
        FOUND := _raise('ZC016', format('request %s', p_probe_id), 'asked_by',
                        format('is role %I, which may not change scene %L', v_request.asked_by, v_request.scene),
                        'admission_permitted');
    END IF;
    kind := v_request.kind;
    scene := v_request.scene;
    plans := v_request.plans::text;
    options := v_request.options;
    max_speed_kn := CASE v_request.kind WHEN 'admit' THEN _limit('max_speed_kn') ELSE 'infinity' END;
END
$$;
COMMENT ON FUNCTION _requested(bigint) IS
'A request: its plans as the text of a scene file without scene, null for delays. max_speed_kn: of tracks, at most. '
'Raises ZC016 for an admission if the role that asked may not change the scene any more.';

CREATE OR REPLACE FUNCTION conflictdb_internal._probe_failed(p_probe_id bigint, p_error text) RETURNS void
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    UPDATE probe_request p SET attempted_at = NULL,
        (answered_at, is_current, error) = (
            SELECT clock_timestamp(), false, 'could not be answered in three attempts: ' || p_error
            WHERE p.attempts >= 3)
    WHERE p.probe_id = p_probe_id;
END;
COMMENT ON FUNCTION _probe_failed(bigint, text) IS
'Ends a failed attempt to reply to a request; after the third, the error becomes the reply.';

CREATE OR REPLACE FUNCTION conflictdb_internal._answer_request(
    p_probe_id bigint, p_error text, p_found jsonb, p_answer jsonb
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    INSERT INTO probe_reply (probe_id, plan_key, object_kind, key, name, verdict, periods, time_error_s,
                             first_contact_point, closest_at, closest_m, closest_error_m, closest_a_point,
                             closest_b_point, lacking_s, certainty)
        SELECT p_probe_id, f.plan_key, f.kind, f.key, f.name, f.verdict,
               (SELECT coalesce(range_agg(tstzrange((d ->> 0)::timestamptz, (d ->> 1)::timestamptz, '[]')),
                                '{}') FROM jsonb_array_elements(f.periods) d),
               f.time_error_s, _point_of(f.first_contact_point), f.closest_at, f.closest_m, f.closest_error_m,
               _point_of(f.closest_a_point), _point_of(f.closest_b_point), f.lacking_s, f.certainty
        FROM jsonb_to_recordset(p_found) f (
            plan_key text, kind smallint, key text, name text, verdict text, periods jsonb,
            time_error_s double precision, first_contact_point double precision[], closest_at timestamptz,
            closest_m double precision, closest_error_m double precision, closest_a_point double precision[],
            closest_b_point double precision[], lacking_s double precision, certainty text);
    UPDATE probe_request p SET answered_at = clock_timestamp(), is_current = _is_current(p.scene_id), error = p_error,
                               answer = p_answer
        WHERE p.probe_id = p_probe_id;
    PERFORM _prune_probes();
END
$$;
COMMENT ON FUNCTION _answer_request(bigint, text, jsonb, jsonb) IS
'Writes the reply to a request: conflicts of a probe, with the columns of conflicts; the answer to other kinds; or the '
'reason why there is none. Deletes requests older than an hour.';

CREATE OR REPLACE FUNCTION conflictdb_internal._point_of(p_degrees double precision[]) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_SetSRID(ST_MakePoint(p_degrees[1], p_degrees[2]), 4326);
END;
COMMENT ON FUNCTION _point_of(double precision[]) IS 'The point at a longitude and latitude.';

-- Visible to the role that asked, while it may read the scene, and to workers.
ALTER TABLE probe_request ENABLE ROW LEVEL SECURITY;
ALTER TABLE probe_reply ENABLE ROW LEVEL SECURITY;
DROP POLICY IF EXISTS probe_request_own ON probe_request;
CREATE POLICY probe_request_own ON probe_request TO conflictdb_reader
    USING (asked_by = current_user AND scene_id IN (SELECT s.scene_id FROM scene s))
    WITH CHECK (asked_by = current_user AND scene_id IN (SELECT s.scene_id FROM scene s));
DROP POLICY IF EXISTS probe_request_worker ON probe_request;
CREATE POLICY probe_request_worker ON probe_request TO conflictdb_worker USING (true) WITH CHECK (true);
DROP POLICY IF EXISTS probe_reply_own ON probe_reply;
CREATE POLICY probe_reply_own ON probe_reply FOR SELECT TO conflictdb_reader
    USING (EXISTS (SELECT FROM probe_request p WHERE p.probe_id = probe_reply.probe_id AND p.asked_by = current_user));
DROP POLICY IF EXISTS probe_reply_worker ON probe_reply;
CREATE POLICY probe_reply_worker ON probe_reply TO conflictdb_worker USING (true) WITH CHECK (true);

COMMENT ON TABLE probe_request IS
'Requests to the workers: which conflicts plans would have (request_probe, request_track_probe, request_plans_probe), '
'the departures of a track (request_delays), or to admit plans (admit). Visible to the role that asked and to workers; '
'deleted after an hour.';
COMMENT ON COLUMN probe_request.probe_id IS 'Id of the request.';
COMMENT ON COLUMN probe_request.scene_id IS 'Scene.';
COMMENT ON COLUMN probe_request.asked_by IS 'Role that asked.';
COMMENT ON COLUMN probe_request.asked_at IS 'Start of its transaction.';
COMMENT ON COLUMN probe_request.kind IS 'probe, delays or admit.';
COMMENT ON COLUMN probe_request.plans IS
'The plans, as a scene file without scene: a GeoJSON FeatureCollection, version 1; null for delays.';
COMMENT ON COLUMN probe_request.options IS
'Delays: key, horizon_s and now_us (microseconds since 1970). Admission: owner, allow_known and replace.';
COMMENT ON COLUMN probe_request.answer IS
'The reply. Delays: as `conflictdb delays --format json` prints it. Admission: admitted and conflicts. Probe: beyond, '
'why schedules may be missing; its conflicts are in probe_reply. Null while it waits.';
COMMENT ON COLUMN probe_request.answered_at IS 'When a worker replied; null while it waits.';
COMMENT ON COLUMN probe_request.is_current IS
'Whether the scene was current at that time; null while it waits.';
COMMENT ON COLUMN probe_request.attempts IS
'Number of attempts, each counted before it begins; the third one that fails or does not end is reported as an error.';
COMMENT ON COLUMN probe_request.attempted_at IS 'When a worker claimed it; null if none has, or the attempt failed.';
COMMENT ON COLUMN probe_request.bytes IS 'Bytes of plans as text.';
COMMENT ON COLUMN probe_request.error IS 'Why there is no reply; null if there is one, or while it waits.';

COMMENT ON TABLE probe_reply IS
'Replies to probes: one row per plan and object that it would conflict with or come near.';
COMMENT ON COLUMN probe_reply.probe_id IS 'Request.';
COMMENT ON COLUMN probe_reply.plan_key IS 'Key of the plan.';
COMMENT ON COLUMN probe_reply.name IS 'Name of the object; null: none.';
COMMENT ON COLUMN probe_reply.object_kind IS 'Kind of the object: 0 area, 1 track.';
COMMENT ON COLUMN probe_reply.key IS 'Key of the object.';
COMMENT ON COLUMN probe_reply.verdict IS
'conflict, grazing or unresolved, as in the view conflicts; near: no conflict, within nearest_m.';
COMMENT ON COLUMN probe_reply.periods IS
'When they conflict; bounds inclusive, rounded outward to the microsecond; empty if only near.';
