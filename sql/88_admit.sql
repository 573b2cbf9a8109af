-- Admission in SQL: stages 1 and 2 decide most requests. Workers answer the others, if the role that asked may.

CREATE OR REPLACE FUNCTION conflictdb_internal._check_plans(p_plans jsonb) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_most CONSTANT integer := 1000;
    c_members CONSTANT text[] := ARRAY[
        'key', 'times',
        /* plan columns: 'NAME' but schedule = */
        'footprint', 'active_span', 'path', 'outline', 'floor_m', 'ceiling_m', 'name', 'properties', 'grow_mps',
        'outlines', 'floors_m', 'ceilings_m', 'class', 'owner', 'tolerances', 'activations', 'departures'
        /* end */
    ];
    v_plan jsonb;
    v_who text;
    v_member text;
BEGIN
    IF (jsonb_typeof(p_plans) = 'array' AND jsonb_array_length(p_plans) BETWEEN 1 AND c_most) IS NOT TRUE THEN
        FOUND := _raise('ZC016', 'plans', 'plans', format('must be a JSON array of 1 to %s plans', c_most),
                        'plans_array');
    END IF;
    FOR v_plan IN SELECT p FROM jsonb_array_elements(p_plans) p LOOP
        IF jsonb_typeof(v_plan) <> 'object' OR jsonb_typeof(v_plan -> 'key') IS DISTINCT FROM 'string' THEN
            FOUND := _raise('ZC016', 'plans', 'key', format('must be text, in a JSON object; got %s',
                                                            left(v_plan::text, 60)), 'plan_object');
        END IF;
        v_who := format('plan %L', v_plan ->> 'key');
        -- Null is as if absent.
        IF num_nonnulls(v_plan ->> 'footprint', v_plan ->> 'path') <> 1 THEN
            FOUND := _raise('ZC016', v_who, 'footprint', 'must be given, or path, and not both', 'plan_kind');
        END IF;
        SELECT k INTO v_member FROM unnest(ARRAY[
            /* plan texts: 'NAME' */
            'name', 'class', 'owner'
            /* end */
            ]) k
            WHERE jsonb_typeof(v_plan -> k) NOT IN ('string', 'null') LIMIT 1;
        IF FOUND THEN
            FOUND := _raise('ZC016', v_who, v_member,
                            format('must be text; got %s', left((v_plan -> v_member)::text, 60)), 'plan_texts');
        END IF;
        -- A misspelt member would be ignored, and conflicts missed.
        SELECT k INTO v_member FROM jsonb_object_keys(v_plan) k WHERE k <> ALL (c_members) LIMIT 1;
        IF FOUND THEN
            FOUND := _raise('ZC016', v_who, v_member, 'is not a member of a plan', 'plan_members',
                            format('Known: %s.', array_to_string(c_members, ', ')));
        END IF;
        SELECT k INTO v_member FROM jsonb_object_keys(v_plan) k
            WHERE jsonb_typeof(v_plan -> k) <> 'null'
              AND k = ANY (CASE WHEN v_plan ->> 'footprint' IS NULL THEN ARRAY[
                    /* area alone: 'NAME' but footprint = */
                    'active_span', 'activations'
                    /* end */
                ] ELSE ARRAY[
                    'times',
                    /* track alone: 'NAME' but path = */
                    'outline', 'grow_mps', 'outlines', 'floors_m', 'ceilings_m', 'tolerances', 'departures'
                    /* end */
                ] END) LIMIT 1;
        IF FOUND THEN
            FOUND := _raise('ZC016', v_who, v_member,
                            format('is not a member of %s', CASE WHEN v_plan ->> 'footprint' IS NULL THEN 'a track'
                                                                 ELSE 'an area' END), 'plan_members');
        END IF;
    END LOOP;
    SELECT p ->> 'key' INTO v_member FROM jsonb_array_elements(p_plans) p
        GROUP BY p ->> 'key' HAVING count(*) > 1 LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC007', format('plan %L', v_member), 'key', 'occurs more than once: keys must be unique',
                        'plan_key_unique');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_plans(jsonb) IS 'Raises ZC016 or ZC007 for plans that admit could not read.';

CREATE OR REPLACE FUNCTION conflictdb_internal._met_by_plans(
    p_scene_id bigint, p_area_ids bigint[], p_track_ids bigint[], p_most integer
) RETURNS TABLE (a_kind smallint, a_id bigint, b_kind smallint, b_id bigint, periods tstzmultirange)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off SET enable_seqscan = off
-- Planning takes as long as the rest: once per session. No bitmaps, as in _objects_near.
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_bitmapscan = off SET jit = off AS $$
DECLARE
    v_within_s double precision := _longest_time_s(p_scene_id);
    v_wanted_m double precision := _wanted_m(p_scene_id);
    v_apart_m double precision := 2 * _half_vertical_m(p_scene_id);
    v_allowed jsonb := _allowed_types(p_scene_id);
    v_scene record;
BEGIN
    SELECT s.method = 'exact' AND v_within_s = 0 AS may_decide, s.tolerance_m,
           _plane(s.motion, s.earth, s.centre_lon, s.centre_lat) AS plane, 2 * pi() * _radius_m(s.earth) AS turn_m
        INTO v_scene FROM scene s WHERE s.scene_id = p_scene_id;
    RETURN QUERY
        WITH given AS MATERIALIZED (
            SELECT r.*, (r.rough).object_kind AS kind, (r.rough).object_id AS id
            FROM _rough_pieces(p_scene_id, v_wanted_m, p_area_ids, p_track_ids) r
        ), uncut AS MATERIALIZED (
            SELECT r.*
            FROM (SELECT array_agg(DISTINCT u.object_id) FILTER (WHERE u.object_kind = 0) AS area_ids,
                         array_agg(DISTINCT u.object_id) FILTER (WHERE u.object_kind = 1) AS track_ids
                  FROM (SELECT range_merge(range_agg((g.rough).span)) AS span FROM given g) w
                  CROSS JOIN LATERAL _uncut_pieces(p_scene_id, v_wanted_m, false, _widened(w.span, v_within_s)) u
                  JOIN given g ON _pieces_may_meet(g.rough, u, v_within_s, v_allowed)
                  WHERE u.object_id <> ALL (CASE u.object_kind WHEN 0 THEN p_area_ids ELSE p_track_ids END)) o
            CROSS JOIN LATERAL _rough_pieces(p_scene_id, v_wanted_m, o.area_ids, o.track_ids) r
        )
        -- One object after the other, so that the limit ends the comparison.
        SELECT o.kind, o.id, m.b_kind, m.b_id, m.periods
        FROM (SELECT DISTINCT g.kind, g.id FROM given g) o
        CROSS JOIN LATERAL (
            WITH mine AS (
                SELECT g.* FROM given g WHERE (g.kind, g.id) = (o.kind, o.id)
            ), near AS (
                SELECT g.rough, g.shape, u AS other,
                       ST_SetSRID(ST_Translate(u.shape, u.turn * v_scene.turn_m, 0), ST_SRID(g.shape)) AS other_shape
                FROM mine g
                JOIN piece p ON _pieces_may_meet(g.rough, p, v_within_s, v_allowed) AND p.scene_id = p_scene_id
                CROSS JOIN LATERAL _pieces_of(p) u
                WHERE _pieces_may_meet(g.rough, u, v_within_s, v_allowed) AND _hulls_meet(u.hull, g.shape, g.padding_m)
                  -- Of most objects the last detection knows the present pieces.
                  AND NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.object_kind = p.object_kind
                                  AND c.object_id = p.object_id AND NOT c.is_covered)
                UNION ALL
                SELECT g.rough, g.shape, u.rough, u.shape
                FROM mine g
                JOIN uncut u ON _pieces_may_meet(g.rough, u.rough, v_within_s, v_allowed)
                                AND _hulls_meet(u.shape, g.shape, u.padding_m + g.padding_m)
                UNION ALL
                SELECT g.rough, g.shape, h.rough, h.shape
                FROM mine g
                JOIN given h ON (g.kind, g.id) < (h.kind, h.id)
                                AND _pieces_may_meet(g.rough, h.rough, v_within_s, v_allowed)
                                AND _hulls_meet(h.shape, g.shape, h.padding_m + g.padding_m)
            )
            SELECT n.b_kind, n.b_id,
                   range_agg(tstzrange(lower(n.span), upper(n.span), '[]')) FILTER (WHERE n.is_certain) AS periods
            FROM (SELECT (m.other).object_kind AS b_kind, (m.other).object_id AS b_id,
                         (m.rough).span * (m.other).span AS span,
                         v_scene.may_decide AND (m.rough).object_kind + (m.other).object_kind = 0
                         AND (m.rough).part >= 0 AND (m.other).part >= 0
                         AND _pieces_may_meet(i, m.other, 0, NULL)
                         AND _areas_overlap(m.shape, m.other_shape,
                                            2 * _rough_padding_m(_out_m(m.shape, v_scene.plane), 0, v_scene.tolerance_m,
                                                                 v_scene.plane) + 1e-5)
                         AS is_certain
                  FROM near m
                  -- Heights that overlap without any vertical separation.
                  CROSS JOIN LATERAL _given_piece(
                      NULL, (m.rough).object_kind, (m.rough).object_id, '{}', (m.rough).part, (m.rough).turn,
                      (m.rough).hull, (m.rough).span, (m.rough).floor_m + v_apart_m,
                      (m.rough).ceiling_m - v_apart_m) i) n
            GROUP BY n.b_kind, n.b_id
        ) m
        LIMIT p_most;
END
$$;
COMMENT ON FUNCTION _met_by_plans(bigint, bigint[], bigint[], integer) IS
'Stages 1 and 2 of objects of a scene with all others, as they are stored, detected or not: pairs that may conflict. '
'periods: of areas that overlap, when they conflict; null: stages 3 and 4 must decide. Stops after p_most pairs.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_replaced(
    p_scene_id bigint, p_plans jsonb, p_owner text, p_replace text[]
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_taken record;
BEGIN
    SELECT r.key, r.owner, p.owner AS given, coalesce(r.owner <> p.owner, r.owner IS NOT NULL) AS is_of_another
        INTO v_taken
        FROM (SELECT g ->> 'key' AS key, coalesce(p_owner, g ->> 'owner') AS owner
              FROM jsonb_array_elements(p_plans) g) p
        JOIN _replaced_objects(p_scene_id, ARRAY(SELECT g ->> 'key' FROM jsonb_array_elements(p_plans) g), NULL) r
            ON r.key = p.key
        WHERE CASE WHEN r.owner IS DISTINCT FROM p.owner AND r.owner IS NOT NULL THEN true
                   ELSE (r.key = ANY (p_replace) OR r.owner = p_owner) IS NOT TRUE END
        ORDER BY is_of_another DESC, r.key LIMIT 1;
    IF FOUND AND v_taken.is_of_another THEN
        FOUND := _raise('ZC007', format('plan %L', v_taken.key), 'key',
                        format('belongs to owner %L; got owner %s', v_taken.owner, quote_nullable(v_taken.given)),
                        'plan_key_owned', 'Choose another key.');
    ELSIF FOUND THEN
        FOUND := _raise('ZC007', format('plan %L', v_taken.key), 'key', 'belongs to an object of the scene',
                        'plan_key_taken', format('p_replace => ARRAY[%L] puts the plan in its place.', v_taken.key));
    END IF;
END
$$;
COMMENT ON FUNCTION _check_replaced(bigint, jsonb, text, text[]) IS
'Raises ZC007 for a plan with the key of a stored object that it may not replace: of another owner, or neither of '
'p_owner nor in p_replace.';

CREATE OR REPLACE FUNCTION conflictdb_internal._are_features(p_plans jsonb) RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(p_plans ->> 'type' = 'FeatureCollection'
                    OR jsonb_typeof(p_plans) = 'array' AND jsonb_path_exists(p_plans, '$[*] ? (exists (@.type))'),
                    false);
END;
COMMENT ON FUNCTION _are_features(jsonb) IS
'Whether plans are GeoJSON features; else they are objects with the parameters of put_area and put_track.';

CREATE OR REPLACE FUNCTION conflictdb_internal._owned_features(p_plans jsonb, p_owner text) RETURNS jsonb
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_owner IS NULL THEN p_plans
                ELSE p_plans || jsonb_build_object('features', (
                         SELECT jsonb_agg(CASE WHEN jsonb_typeof(f -> 'properties') = 'object'
                                               THEN f || jsonb_build_object('properties', f -> 'properties' || o.owner)
                                               WHEN coalesce(f -> 'properties', 'null') = 'null'
                                               THEN f || jsonb_build_object('properties', o.owner) ELSE f END
                                          ORDER BY n)
                         FROM jsonb_array_elements(p_plans -> 'features') WITH ORDINALITY u (f, n)
                         CROSS JOIN jsonb_build_object('owner', p_owner) o (owner))) END;
END;
COMMENT ON FUNCTION _owned_features(jsonb, text) IS
'A FeatureCollection whose features have an owner; null: their own.';

CREATE OR REPLACE FUNCTION conflictdb_internal._as_parameters(p_feature jsonb, p_foreign jsonb) RETURNS jsonb
LANGUAGE plpgsql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_tolerances CONSTANT text[] := ARRAY['xtd_port_m', 'xtd_starboard_m', 'min_speed_kn', 'max_speed_kn',
                                          'turn_radius_m', 'departure_window', 'arrival_window'];
    -- Texts that have a meaning in ranges only; workers refuse them.
    c_of_ranges CONSTANT text := '^$|infinity|["(),[\]]';
    c_of_areas CONSTANT jsonb := jsonb_build_object(
        'kind', 'string', 'start', 'string', 'end', 'string', 'spans', 'array',
        /* area values: MEMBER, JSON */
        'floor_m', 'number', 'ceiling_m', 'number', 'name', 'string', 'class', 'string', 'owner', 'string'
        /* end */
    );
    c_of_tracks CONSTANT jsonb := jsonb_build_object(
        'kind', 'string', 'times', 'array', 'outline_m', 'array', 'fore_m', 'number', 'aft_m', 'number',
        'port_m', 'number', 'starboard_m', 'number', 'departures', 'array',
        /* track values: MEMBER, JSON */
        'floor_m', 'number', 'ceiling_m', 'number', 'name', 'string', 'grow_mps', 'number', 'class', 'string',
        'owner', 'string'
        /* end */
    );
    v_geometry jsonb := p_feature -> 'geometry';
    v_type text := v_geometry ->> 'type';
    v_is_area boolean := v_type IN ('Polygon', 'MultiPolygon');
    v_given jsonb := coalesce(nullif(p_feature -> 'properties', 'null'), '{}');
    v_known jsonb;
    v_rest jsonb;
    v_outline text[];
    v_plan jsonb;
BEGIN
    IF (v_is_area OR v_type = 'LineString') IS NOT TRUE OR jsonb_typeof(v_given) <> 'object'
       OR p_feature - ARRAY['type', 'id', 'geometry', 'properties'] <> '{}'
       OR v_geometry - ARRAY['type', 'coordinates'] <> '{}' THEN
        RETURN NULL;
    END IF;
    SELECT coalesce(jsonb_object_agg(e.key, e.value) FILTER (WHERE NOT m.is_rest AND e.value <> 'null'), '{}'),
           coalesce(jsonb_object_agg(e.key, e.value) FILTER (WHERE m.is_rest), '{}')
        INTO v_known, v_rest
        FROM jsonb_each(v_given) e
        CROSS JOIN LATERAL (SELECT e.key = 'vertical_datum'
                                   OR coalesce(p_foreign ? e.key, false) AND e.key <> ALL (_members_of_plans())
                                   AS is_rest) m;
    IF EXISTS (SELECT FROM jsonb_each(v_known) e
               WHERE (jsonb_typeof(e.value) = CASE WHEN v_is_area THEN c_of_areas ELSE c_of_tracks END ->> e.key
                      OR NOT v_is_area AND (e.key = ANY (c_tolerances) OR e.key IN ('floor_m', 'ceiling_m')
                                                                          AND jsonb_typeof(e.value) = 'array'))
                     IS NOT TRUE)
       OR coalesce(v_known ->> 'kind' <> CASE WHEN v_is_area THEN 'area' ELSE 'track' END, false) THEN
        RETURN NULL;
    END IF;
    v_plan := jsonb_build_object('key', p_feature -> 'id', 'properties', v_rest)
              || (v_known - ARRAY['kind', 'start', 'end', 'spans', 'times', 'outline_m', 'fore_m', 'aft_m', 'port_m',
                                  'starboard_m'] - c_tolerances);
    IF v_is_area THEN
        IF v_known ? 'spans' THEN
            IF v_known ?| ARRAY['start', 'end'] OR jsonb_path_exists(v_known, 'strict $.spans[*] ? (@.type() <> "array"
                    || @.size() <> 2 || exists (@[*] ? (@.type() <> "string" && @.type() <> "null")))')
               OR EXISTS (SELECT FROM jsonb_path_query(v_known, '$.spans[*][*]') e
                          WHERE e #>> '{}' ~ c_of_ranges) THEN
                RETURN NULL;
            END IF;
            v_plan := v_plan || jsonb_build_object('activations', (
                SELECT '{' || coalesce(string_agg(format('[%s,%s)', s ->> 0, s ->> 1), ',' ORDER BY n), '') || '}'
                FROM jsonb_array_elements(v_known -> 'spans') WITH ORDINALITY u (s, n)));
        ELSIF v_known ?| ARRAY['start', 'end'] THEN
            IF v_known ->> 'start' ~ c_of_ranges OR v_known ->> 'end' ~ c_of_ranges THEN
                RETURN NULL;
            END IF;
            v_plan := v_plan || jsonb_build_object('active_span',
                                                   format('[%s,%s)', v_known ->> 'start', v_known ->> 'end'));
        END IF;
        RETURN v_plan || jsonb_build_object('footprint', v_geometry);
    END IF;
    -- Altitudes are ignored.
    IF NOT v_known ? 'times' OR jsonb_path_exists(v_geometry, 'strict $.coordinates[*] ? (@.size() <> 2)') THEN
        RETURN NULL;
    END IF;
    IF v_known ?& ARRAY['fore_m', 'aft_m', 'port_m', 'starboard_m'] AND NOT v_known ? 'outline_m'
       AND least((v_known ->> 'fore_m')::numeric, (v_known ->> 'aft_m')::numeric, (v_known ->> 'port_m')::numeric,
                 (v_known ->> 'starboard_m')::numeric) >= 0
       AND greatest((v_known ->> 'fore_m')::numeric, (v_known ->> 'aft_m')::numeric, (v_known ->> 'port_m')::numeric,
                    (v_known ->> 'starboard_m')::numeric) < 1e300 THEN
        -- Smaller numbers are no doubles.
        v_plan := v_plan || jsonb_build_object('outline', encode(ST_AsBinary((
            SELECT rectangle_outline(d.sides[1], d.sides[2], d.sides[3], d.sides[4])
            FROM (SELECT ARRAY(SELECT CASE WHEN (v_known ->> m)::numeric > 1e-300
                                           THEN (v_known ->> m)::double precision ELSE 0 END
                               FROM unnest(ARRAY['fore_m', 'aft_m', 'port_m', 'starboard_m']) WITH ORDINALITY u (m, n)
                               ORDER BY n) AS sides) d)), 'hex'));
    ELSIF v_known ? 'outline_m' AND NOT v_known ?| ARRAY['fore_m', 'aft_m', 'port_m', 'starboard_m']
          AND NOT jsonb_path_exists(v_known, 'strict $.outline_m[*] ? (@.type() <> "array" || @.size() <> 2
                                              || exists (@[*] ? (@.type() <> "number")))') THEN
        v_outline := ARRAY(SELECT (p ->> 0) || ' ' || (p ->> 1)
                           FROM jsonb_array_elements(v_known -> 'outline_m') WITH ORDINALITY u (p, n) ORDER BY n);
        IF cardinality(v_outline) > 1 AND v_outline[1] = v_outline[cardinality(v_outline)] THEN
            v_outline := trim_array(v_outline, 1);
        END IF;
        IF cardinality(v_outline) = 0 THEN
            RETURN NULL;
        END IF;
        -- A ring has at least four points.
        WHILE cardinality(v_outline) < 3 LOOP
            v_outline := v_outline || v_outline[cardinality(v_outline)];
        END LOOP;
        v_plan := v_plan || jsonb_build_object('outline', format('POLYGON((%s,%s))', array_to_string(v_outline, ','),
                                                                 v_outline[1]));
    ELSE
        RETURN NULL;
    END IF;
    IF v_known ?| c_tolerances THEN
        v_plan := v_plan || jsonb_build_object('tolerances', (
            SELECT jsonb_object_agg(e.key, e.value) FROM jsonb_each(v_known) e WHERE e.key = ANY (c_tolerances)));
    END IF;
    IF jsonb_typeof(v_known -> 'floor_m') = 'array' THEN
        v_plan := v_plan - 'floor_m' || jsonb_build_object('floors_m', v_known -> 'floor_m');
    END IF;
    IF jsonb_typeof(v_known -> 'ceiling_m') = 'array' THEN
        v_plan := v_plan - 'ceiling_m' || jsonb_build_object('ceilings_m', v_known -> 'ceiling_m');
    END IF;
    RETURN v_plan || jsonb_build_object('path', v_geometry, 'times', v_known -> 'times');
END
$$;
COMMENT ON FUNCTION _as_parameters(jsonb, jsonb) IS
'A feature of a scene file as parameters of put_area or put_track (_plans_of); null if it has members that only '
'workers read. p_foreign: names of properties without a meaning.';

CREATE OR REPLACE FUNCTION conflictdb_internal._features_of(p_scene_id bigint, p_plans jsonb) RETURNS jsonb
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_is_closed boolean := _is_closed(p_scene_id);
    v_plan record;
    v_area area;
    v_track track;
    v_features jsonb[] := '{}';
    v_foreign text[] := '{}';
BEGIN
    FOR v_plan IN SELECT p.* FROM _plans_of(p_plans) p LOOP
        IF jsonb_typeof(v_plan.properties) = 'object' THEN
            v_foreign := v_foreign || ARRAY(SELECT jsonb_object_keys(v_plan.properties));
        END IF;
        IF v_plan.footprint IS NOT NULL THEN
            v_area := NULL;
            v_area.key := v_plan.key;
            /* area columns: v_area.NAME := TAKEN(v_plan);
               but footprint = v_area.footprint := ST_Multi(ST_Force2D(v_plan.footprint));
               but active_span = v_area.active_span := _half_open(v_plan.active_span, v_is_closed);
               but activations = v_area.activations := _half_open(v_plan.activations, v_is_closed);
               but schedule = */
            v_area.footprint := ST_Multi(ST_Force2D(v_plan.footprint));
            v_area.active_span := _half_open(v_plan.active_span, v_is_closed);
            v_area.floor_m := v_plan.floor_m;
            v_area.ceiling_m := v_plan.ceiling_m;
            v_area.name := v_plan.name;
            v_area.properties := coalesce(v_plan.properties, '{}');
            v_area.class := v_plan.class;
            v_area.owner := v_plan.owner;
            v_area.activations := _half_open(v_plan.activations, v_is_closed);
            /* end */
            v_features := v_features || _feature(v_area);
        ELSE
            v_track := NULL;
            v_track.key := v_plan.key;
            /* track columns: v_track.NAME := TAKEN(v_plan); but schedule = */
            v_track.path := v_plan.path;
            v_track.outline := v_plan.outline;
            v_track.floor_m := v_plan.floor_m;
            v_track.ceiling_m := v_plan.ceiling_m;
            v_track.name := v_plan.name;
            v_track.properties := coalesce(v_plan.properties, '{}');
            v_track.grow_mps := coalesce(v_plan.grow_mps, 0);
            v_track.outlines := v_plan.outlines;
            v_track.floors_m := v_plan.floors_m;
            v_track.ceilings_m := v_plan.ceilings_m;
            v_track.class := v_plan.class;
            v_track.owner := v_plan.owner;
            v_track.tolerances := nullif(v_plan.tolerances, 'null');
            v_track.departures := v_plan.departures;
            /* end */
            v_features := v_features || _feature(v_track);
        END IF;
    END LOOP;
    RETURN jsonb_build_object('type', 'FeatureCollection', 'version', 1, 'features', to_jsonb(v_features))
           || CASE WHEN v_foreign = '{}' THEN '{}' ELSE jsonb_build_object('foreign', to_jsonb(v_foreign)) END;
END
$$;
COMMENT ON FUNCTION _features_of(bigint, jsonb) IS
'Plans with the parameters of put_area and put_track (_plans_of) as a FeatureCollection.';

CREATE OR REPLACE FUNCTION admit(
    p_scene text, p_plans jsonb, p_owner text DEFAULT NULL, p_allow_known boolean DEFAULT false,
    p_replace text[] DEFAULT '{}', OUT admitted boolean, OUT conflicts jsonb, OUT request_id bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- Planning takes as long as the rest: once per session.
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    c_refused CONSTANT text := 'ZCR00';
    -- As of answers from Python and from workers (MOST_REPLIES).
    c_most CONSTANT integer := 50000;
    v_count integer;
    v_scene_id bigint;
    v_keys text[];
    v_replaced jsonb;
    v_features jsonb;
    v_owners jsonb;
    v_plans jsonb;
    v_are_known boolean := false;
BEGIN
    PERFORM _check_word('plans', 'owner', p_owner);
    IF _are_features(p_plans) THEN
        v_features := _owned_features(_plans_given(p_plans), p_owner);
        SELECT jsonb_agg(_as_parameters(f, v_features -> 'foreign') ORDER BY n),
               jsonb_agg(jsonb_build_object('key', f -> 'id', 'owner', f #> '{properties,owner}')),
               array_agg(f ->> 'id')
            INTO v_plans, v_owners, v_keys
            FROM jsonb_array_elements(v_features -> 'features') WITH ORDINALITY u (f, n);
    ELSE
        PERFORM _check_plans(p_plans);
        RAISE NOTICE 'plans: the members footprint, path, active_span and others are read until the next release'
            USING HINT = 'Give features as in scene files, with "version": 1.';
        SELECT jsonb_agg(CASE WHEN p_owner IS NULL THEN g ELSE g || jsonb_build_object('owner', p_owner) END
                         ORDER BY n), array_agg(g ->> 'key')
            INTO v_plans, v_keys FROM jsonb_array_elements(p_plans) WITH ORDINALITY p (g, n);
        v_owners := v_plans;
    END IF;
    -- Plans are read before the lock is taken: other admissions do not wait for that.
    SELECT b.scene_id, b.replaced INTO v_scene_id, v_replaced FROM _begin_admission(p_scene, NULL, v_keys, p_owner) b;
    IF v_replaced <> '[]' THEN
        PERFORM _check_replaced(v_scene_id, v_owners, p_owner, p_replace);
    END IF;
    admitted := false;
    -- Workers read plans with other members than the most usual ones.
    IF v_plans @> 'null' THEN
        v_plans := NULL;
    END IF;
    BEGIN
        IF v_plans IS NULL THEN
            RAISE EXCEPTION USING ERRCODE = c_refused;
        END IF;
        -- Put first, so that rows are checked and compared as they are stored. An object that stays of its kind is
        -- updated in place.
        PERFORM _put_plans(p_scene, ARRAY(
            SELECT r ->> 2 FROM jsonb_array_elements(v_replaced) r
            WHERE NOT EXISTS (SELECT FROM jsonb_array_elements(v_plans) g
                              WHERE g ->> 'key' = r ->> 2 AND (g ->> 'path' IS NOT NULL) = (r ->> 0 = '1'))),
                           v_plans, false,
                           ARRAY(SELECT r ->> 2 FROM jsonb_array_elements(v_replaced) r));
        PERFORM _check_ends(v_scene_id, v_keys);
        WITH met AS MATERIALIZED (
            SELECT m.*
            FROM _met_by_plans(
                v_scene_id,
                ARRAY(SELECT a.area_id FROM area a WHERE a.scene_id = v_scene_id AND a.key = ANY (v_keys)),
                ARRAY(SELECT t.track_id FROM track t WHERE t.scene_id = v_scene_id AND t.key = ANY (v_keys)),
                c_most + 1) m
        )
        SELECT n.are_known, n.pairs,
               (SELECT coalesce(jsonb_agg(_conflict_as_json(m.a_id, m.b_id, m.periods)), '[]')
                FROM met m WHERE m.periods IS NOT NULL AND n.pairs <= c_most)
            INTO v_are_known, v_count, conflicts
            FROM (SELECT bool_and(m.periods IS NOT NULL) AS are_known, count(*) AS pairs FROM met m) n;
        -- A worker counts the conflicts of pairs that stages 3 and 4 must decide.
        IF v_are_known AND v_count > c_most THEN
            FOUND := _raise('ZC016', 'plans', 'plans', format('have more than %s conflicts, the most that one answer '
                            'may have: ask about fewer plans at once', c_most), 'answer_within_limit');
        END IF;
        IF _need_schedules(v_scene_id, v_keys) THEN
            v_are_known := false;
        END IF;
        admitted := v_are_known IS NULL;
        IF NOT admitted THEN
            RAISE EXCEPTION USING ERRCODE = c_refused;
        END IF;
    EXCEPTION WHEN SQLSTATE 'ZCR00' THEN
        NULL; -- What was put is undone.
    END;
    -- What the objects in their place had before takes stages 3 and 4, too.
    IF NOT admitted AND (NOT v_are_known OR p_allow_known AND v_replaced <> '[]') THEN
        IF _worker_count() = 0 THEN
            FOUND := _raise('ZC015', 'plans', 'worker', 'must be connected: only one can decide about these plans',
                            'admission_has_worker', 'Start one: conflictdb worker');
        END IF;
        admitted := NULL;
        conflicts := '[]';
        request_id := _request(
            v_scene_id, 'admit', coalesce(v_features, _features_of(v_scene_id, v_plans))::json,
            jsonb_build_object('owner', p_owner, 'allow_known', p_allow_known, 'replace', coalesce(p_replace, '{}')));
    END IF;
END
$$;
COMMENT ON FUNCTION admit(text, jsonb, text, boolean, text[]) IS
'Puts plans into a scene only if they conflict with nobody, detected or not; admissions of a scene take turns until '
'their transactions end. p_plans: a JSON array of GeoJSON features as in scene files, each with "version": 1, or a '
'FeatureCollection of them. p_owner: the plans belong to it, take the place of all that it has, and are not compared '
'with each other. p_replace: keys of other stored objects that plans of the same key may replace (else ZC007). '
'p_allow_known: as in Python. admitted: whether they were put; null: stages 3 and 4 must decide. Then commit, and '
'call wait_for_admission(request_id): a worker admits them. Without a connected one, it raises ZC015. '
'conflicts: of plans that were not put, a JSON array with members as of the view conflicts.';

CREATE OR REPLACE FUNCTION conflictdb_internal._conflict_as_json(
    p_a_id bigint, p_b_id bigint, p_periods tstzmultirange
) RETURNS jsonb
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT jsonb_build_object(
        'a_key', least(a.key, b.key), 'a_kind', 'area', 'b_key', greatest(a.key, b.key), 'b_kind', 'area',
        'verdict', 'conflict', 'periods', (SELECT jsonb_agg(jsonb_build_array(lower(p), upper(p)) ORDER BY p)
                                           FROM unnest(p_periods) p),
        'time_error_s', 0, 'is_new', true)
    FROM area a CROSS JOIN area b WHERE a.area_id = p_a_id AND b.area_id = p_b_id;
END;
COMMENT ON FUNCTION _conflict_as_json(bigint, bigint, tstzmultirange) IS
'A certain conflict of two areas, as the function admit returns it.';

CREATE OR REPLACE FUNCTION wait_for_admission(
    p_request_id bigint, p_timeout interval DEFAULT interval '1 minute', OUT admitted boolean, OUT conflicts jsonb
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM probe_request p WHERE p.probe_id = p_request_id AND p.kind = 'admit') THEN
        FOUND := _raise('ZC011', format('request %s', coalesce(p_request_id::text, 'null')), 'request_id',
                        'is not an admission of this role within the last hour', 'admission_known');
    END IF;
    PERFORM _await_answer(p_request_id, p_timeout, 'admit');
    SELECT (p.answer ->> 'admitted')::boolean, p.answer -> 'conflicts' INTO admitted, conflicts
        FROM probe_request p WHERE p.probe_id = p_request_id;
END
$$;
COMMENT ON FUNCTION wait_for_admission(bigint, interval) IS
'Waits until a worker has admitted plans of the function admit, or refused them; returns whether, and the conflicts. '
'Raises ZC015 after p_timeout (null: waits without limit), ZC016 with the reason for invalid plans, and ZC013 in a '
'transaction that cannot see the reply. The request stays: if nobody waits, it is answered all the same.';

-- For workers.

CREATE OR REPLACE FUNCTION conflictdb_internal._may_admit(p_role name, p_scene_id bigint) RETURNS boolean
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- As _may_change, of another role.
    SELECT EXISTS (
        SELECT FROM pg_catalog.pg_roles r
        WHERE r.rolname = p_role AND has_column_privilege(r.oid, 'admission_lock'::regclass::oid, 'taken', 'UPDATE')
          AND (NOT _is_protected() OR r.rolsuper OR r.rolbypassrls OR pg_has_role(r.oid, 'conflictdb_worker', 'USAGE')
               OR pg_has_role(r.oid, (SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = 'scene'::regclass),
                              'USAGE')
               OR EXISTS (SELECT FROM scene s JOIN pg_catalog.pg_roles o ON o.rolname = s.owner
                          WHERE s.scene_id = p_scene_id AND pg_has_role(r.oid, o.oid, 'USAGE'))
               OR EXISTS (SELECT FROM scene_share h LEFT JOIN pg_catalog.pg_roles o ON o.rolname = h.role
                          WHERE h.scene_id = p_scene_id AND h.may_write
                            AND (h.role = 'public' OR pg_has_role(r.oid, o.oid, 'USAGE')))));
END;
COMMENT ON FUNCTION _may_admit(name, bigint) IS 'Whether a role may change a scene, at this time.';
