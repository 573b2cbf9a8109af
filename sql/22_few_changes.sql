-- Detection of few changed objects: the same steps in one transaction with few calls. Plans are fixed to use indexes,
-- so that the cost depends neither on the size of the scene nor on dead rows, of which `change` has many after a full
-- detection.

CREATE OR REPLACE FUNCTION conflictdb_internal._parent_waits(p_scene_id bigint) RETURNS boolean
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_parent_id bigint := _parent_of(p_scene_id);
BEGIN
    RETURN v_parent_id IS NOT NULL AND (NOT _is_current(v_parent_id) OR _schedules_wait(v_parent_id)
                                       OR _is_behind_parent(p_scene_id));
END
$$;
COMMENT ON FUNCTION _parent_waits(bigint) IS
'Whether the parent of a branch waits for a detection, which then comes first, or the branch has to follow it '
'(_is_behind_parent). False for any other scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._parent_name(p_scene_id bigint) RETURNS text
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN (SELECT p.name FROM scene p WHERE p.scene_id = _parent_of(p_scene_id));
END
$$;
COMMENT ON FUNCTION _parent_name(bigint) IS 'Returns the name of the parent of a branch; null for any other scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._begin_detection(
    p_scene text, p_wait_s double precision, p_few integer, p_try_again boolean,
    OUT scene_id bigint, OUT taken bigint, OUT is_behind boolean, OUT settings jsonb, OUT srid integer,
    OUT area_ids bigint[], OUT track_ids bigint[], OUT known_objects bigint
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_marks tid[];
    v_numbers bigint[];
    v_are_new boolean;
BEGIN
    scene_id := _scene_or_branch(p_scene);
    taken := _take_scene(scene_id, p_wait_s);
    IF taken IS NULL THEN
        RETURN;
    END IF;
    is_behind := p_try_again IS NOT NULL
                 AND EXISTS (SELECT FROM attachment a WHERE a.scene_id = _begin_detection.scene_id)
                 AND EXISTS (SELECT FROM _attachments_to_follow(p_scene, p_try_again))
                 OR p_try_again IS NOT NULL AND _parent_waits(scene_id)
                 OR _schedules_wait(scene_id);
    SELECT _scene_settings(s.scene_id), _plane_srid(_plane(s.motion, s.earth, s.centre_lon, s.centre_lat))
        INTO settings, srid
        FROM scene s WHERE s.scene_id = _begin_detection.scene_id;
    IF is_behind OR p_few < 0 THEN
        RETURN;
    END IF;
    SELECT array_agg(m.place), array_agg(DISTINCT _object_number(m.object_kind, m.object_id)),
           NOT bool_or(m.is_covered)
        INTO v_marks, v_numbers, v_are_new
        FROM (SELECT c.ctid AS place, c.object_kind, c.object_id, c.is_covered FROM change c
              WHERE c.scene_id = _begin_detection.scene_id LIMIT p_few + 1) m;
    IF cardinality(v_marks) > p_few THEN
        RETURN;
    END IF;
    SELECT coalesce(array_agg(n) FILTER (WHERE n < 1::bigint << 62), '{}'),
           coalesce(array_agg(n & ((1::bigint << 62) - 1)) FILTER (WHERE n >= 1::bigint << 62), '{}')
        INTO area_ids, track_ids FROM unnest(v_numbers) n;
    -- Removal of the scene waits for this transaction, or came first.
    PERFORM FROM scene s WHERE s.scene_id = _begin_detection.scene_id FOR KEY SHARE;
    -- OFFSET 0 forces index lookups.
    WITH dropped AS (
        DELETE FROM piece p WHERE p.ctid = ANY (ARRAY(
            SELECT o.ctid FROM unnest(v_numbers) n
            CROSS JOIN LATERAL (SELECT o.ctid FROM piece o
                                WHERE o.object_kind = (n >> 62)::smallint AND o.object_id = n & ((1::bigint << 62) - 1)
                                  AND o.scene_id + 0 = _begin_detection.scene_id OFFSET 0) o))
            RETURNING p.object_kind, p.object_id
    )
    SELECT count(DISTINCT (d.object_kind, d.object_id)) INTO known_objects FROM dropped d;
    UPDATE change c SET is_covered = true WHERE c.ctid = ANY (v_marks) AND NOT c.is_covered;
    IF NOT v_are_new THEN
        known_objects := NULL;
    END IF;
END
$$;
COMMENT ON FUNCTION _begin_detection(text, double precision, integer, boolean) IS
'Takes the lock of a scene as _take_scene does (taken is null if that fails) and returns its settings. Stops there, '
'with null ids, if attached tables have pending changes (is_behind; p_try_again as in _attachments_to_follow, null: '
'not checked), if its parent waits (_parent_waits), '
'if schedules wait to be expanded (is_behind), or if the scene has more than p_few marks (negative: '
'always). Otherwise returns the ids of the changed objects, deletes their pieces and covers their marks; _put_pieces '
'must follow in the same transaction. known_objects: how many of them the last detection included; null if unknown.';

CREATE OR REPLACE FUNCTION conflictdb_internal._some_areas(
    p_scene_id bigint, p_area_ids bigint[],
    OUT area_id bigint, OUT version bigint, OUT span_start timestamptz, OUT span_end timestamptz,
    /* area measures: OUT NAME TYPE, */
    OUT floor_m double precision, OUT ceiling_m double precision,
    /* end */
    /* area numbered: OUT NAME_number bigint, */
    OUT class_number bigint, OUT owner_number bigint,
    /* end */
    /* area bytes: OUT NAME bytea */
    OUT footprint bytea, OUT activations bytea
    /* end */
) RETURNS SETOF record
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
BEGIN
    -- OFFSET 0 forces a lookup by id.
    RETURN QUERY SELECT a.* FROM unnest(p_area_ids) n
        CROSS JOIN LATERAL (SELECT r.* FROM _area_row(p_scene_id, n) r OFFSET 0) a ORDER BY n;
END
$$;
COMMENT ON FUNCTION _some_areas(bigint, bigint[]) IS
'Areas of a scene by id, ids not in the scene are skipped; columns of _area_row, ordered by id.';

CREATE OR REPLACE FUNCTION conflictdb_internal._some_tracks(
    p_scene_id bigint, p_track_ids bigint[],
    OUT track_id bigint, OUT version bigint,
    /* track measures: OUT NAME TYPE, */
    OUT floor_m double precision, OUT ceiling_m double precision, OUT grow_mps double precision,
    /* end */
    /* track numbered: OUT NAME_number bigint, */
    OUT class_number bigint, OUT owner_number bigint,
    /* end */
    /* track bytes: OUT NAME bytea, */
    OUT path bytea, OUT outline bytea, OUT outlines bytea, OUT floors_m bytea, OUT ceilings_m bytea,
    OUT departures bytea,
    /* end */
    OUT tolerances text
) RETURNS SETOF record
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
BEGIN
    -- OFFSET 0 forces a lookup by id.
    RETURN QUERY SELECT t.* FROM unnest(p_track_ids) n
        CROSS JOIN LATERAL (SELECT r.* FROM _track_row(p_scene_id, n) r OFFSET 0) t ORDER BY n;
END
$$;
COMMENT ON FUNCTION _some_tracks(bigint, bigint[]) IS
'Tracks of a scene by id, ids not in the scene are skipped; columns of _track_row, ordered by id.';

CREATE OR REPLACE FUNCTION conflictdb_internal._put_pieces(
    p_scene_id bigint, p_most bigint, p_most_compared bigint,
    /* piece scalars: p_NAME SENT_AS[], */
    p_object_kind smallint[], p_object_id bigint[], p_version bigint[], p_part integer[], p_turn smallint[],
    p_hull bytea[], p_span tstzrange[], p_floor_m double precision[], p_ceiling_m double precision[], p_shape bytea[],
    p_leg_start timestamptz[], p_leg_end timestamptz[], p_start_lon_deg double precision[],
    p_start_lat_deg double precision[], p_end_lon_deg double precision[], p_end_lat_deg double precision[],
    p_bearing_deg double precision[], p_shape_to bytea[], p_pieces integer[], p_class_number bigint[],
    p_owner_number bigint[],
    /* end */
    p_first integer[], p_hulls bytea[], p_shapes bytea[], p_parts integer[], p_starts timestamptz[],
    p_leg_times timestamptz[], p_legs double precision[], p_climbs boolean[], p_climb double precision[],
    OUT piece_id bigint, OUT rank bigint, OUT object_kind smallint, OUT object_id bigint, OUT version bigint,
    OUT pieces integer, OUT part integer, OUT turn smallint, OUT span_start timestamptz, OUT span_end timestamptz,
    OUT end_inclusive boolean, OUT floor_m double precision, OUT ceiling_m double precision,
    OUT leg_start timestamptz, OUT leg_end timestamptz, OUT start_lon_deg double precision,
    OUT start_lat_deg double precision, OUT end_lon_deg double precision, OUT end_lat_deg double precision,
    OUT bearing_deg double precision,
    /* piece numbers: OUT NAME TYPE, */
    OUT class_number bigint, OUT owner_number bigint,
    /* end */
    OUT hull bytea, OUT shape bytea, OUT shape_to bytea, OUT parts bytea,
    OUT cuts bytea, OUT leg_times bytea, OUT legs bytea, OUT climb bytea, OUT met bytea, OUT own_parts bytea,
    OUT met_parts bytea, OUT candidate_pairs bigint, OUT stage2_us bigint
) RETURNS SETOF record
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
#variable_conflict use_column
DECLARE
    v_made bigint[];
    v_numbers bigint[];
    v_a bigint[];
    v_b bigint[];
    v_a_parts integer[];
    v_b_parts integer[];
    v_met bigint[];
    v_compared bigint;
    v_candidates bigint := -1;
    v_began timestamptz;
    v_stage2_us bigint := 0;
    v_within_s double precision := _longest_time_s(p_scene_id);
    v_allowed jsonb := _allowed_types(p_scene_id);
    v_layers bigint[] := _layers(p_scene_id);
    v_hidden bigint[] := _hidden_numbers(p_scene_id);
BEGIN
    -- The arrays contain the pieces of a bundle from index p_first on; each slice ends where the next one starts.
    WITH made AS (
        INSERT INTO piece (scene_id,
                           /* piece scalars: NAME, */
                           object_kind, object_id, version, part, turn, hull, span, floor_m, ceiling_m, shape,
                           leg_start, leg_end, start_lon_deg, start_lat_deg, end_lon_deg, end_lat_deg, bearing_deg,
                           shape_to, pieces, class_number, owner_number,
                           /* end */
                           parts, hulls, shapes, cuts, leg_times, legs, climb)
            SELECT p_scene_id,
                   /* piece scalars: STORED(m), */
                   m.object_kind, m.object_id, m.version, m.part, m.turn, ST_GeomFromEWKB(m.hull), m.span, m.floor_m,
                   m.ceiling_m, ST_GeomFromEWKB(m.shape), m.leg_start, m.leg_end, m.start_lon_deg, m.start_lat_deg,
                   m.end_lon_deg, m.end_lat_deg, m.bearing_deg, ST_GeomFromEWKB(m.shape_to), m.pieces, m.class_number,
                   m.owner_number,
                   /* end */
                   CASE WHEN m.pieces > 1 THEN p_parts[m.first:m.first + m.pieces - 1] END,
                   ST_GeomFromEWKB(m.hulls), ST_GeomFromEWKB(m.shapes),
                   CASE WHEN m.has_slices THEN p_starts[m.first:m.first + m.pieces - 1] || upper(m.span) END,
                   CASE WHEN m.has_slices THEN p_leg_times[2 * m.first - 1:2 * (m.first + m.pieces - 1)] END,
                   CASE WHEN m.has_slices THEN p_legs[5 * m.first - 4:5 * (m.first + m.pieces - 1)] END,
                   CASE WHEN m.climbs THEN p_climb[4 * m.first - 3:4 * m.first] END
            FROM (SELECT u.*, u.pieces > 1 AND u.object_kind = 1 AS has_slices
                  FROM unnest(
                           /* piece scalars: p_NAME, */
                           p_object_kind, p_object_id, p_version, p_part, p_turn, p_hull, p_span, p_floor_m,
                           p_ceiling_m, p_shape, p_leg_start, p_leg_end, p_start_lon_deg, p_start_lat_deg,
                           p_end_lon_deg, p_end_lat_deg, p_bearing_deg, p_shape_to, p_pieces, p_class_number,
                           p_owner_number,
                           /* end */
                           p_first, p_hulls, p_shapes, p_climbs)
                       u (
                           /* piece scalars: NAME, */
                           object_kind, object_id, version, part, turn, hull, span, floor_m, ceiling_m, shape,
                           leg_start, leg_end, start_lon_deg, start_lat_deg, end_lon_deg, end_lat_deg, bearing_deg,
                           shape_to, pieces, class_number, owner_number,
                           /* end */
                           first, hulls, shapes, climbs)) m
            RETURNING piece_id, object_kind, object_id
    )
    SELECT array_agg(m.piece_id), array_agg(DISTINCT _object_number(m.object_kind, m.object_id))
        INTO v_made, v_numbers FROM made m;
    -- OFFSET 0 forces an index lookup per piece.
    SELECT array_agg(c.a), array_agg(c.b), coalesce(sum(c.pairs), 0) INTO v_a, v_b, v_compared
        FROM (SELECT a.piece_id AS a, b.piece_id AS b, a.pieces::bigint * b.pieces AS pairs
              FROM (SELECT p.* FROM piece p WHERE p.piece_id = ANY (v_made)) a
              CROSS JOIN unnest(v_layers) l (scene_id)
              CROSS JOIN LATERAL (SELECT p.* FROM piece p
                                  WHERE p.scene_id = l.scene_id
                                    AND _pieces_may_meet((a.*)::piece, p, v_within_s, v_allowed)
                                    AND (p.object_kind, p.object_id) <> (a.object_kind, a.object_id)
                                    AND (p.scene_id = a.scene_id
                                         OR _object_number(p.object_kind, p.object_id) <> ALL (v_hidden)) OFFSET 0) b
              -- A pair of two changed objects is found from both sides; keep it once.
              WHERE (a.object_kind, a.object_id) < (b.object_kind, b.object_id)
                 OR _object_number(b.object_kind, b.object_id) <> ALL (v_numbers)
              LIMIT p_most) c;
    v_met := ARRAY(SELECT unnest(v_a) UNION SELECT unnest(v_b));
    IF v_compared <= p_most_compared AND cardinality(coalesce(v_a, '{}')) < p_most THEN
        v_began := clock_timestamp();
        -- The rest of stage 1, for the pieces of bundles, and stage 2. Each row is unpacked once. The rule of a pair of
        -- rows has compared classes and owners.
        WITH one AS MATERIALIZED (
            SELECT u.*
            FROM unnest(v_met) n
            CROSS JOIN LATERAL (SELECT p.* FROM piece p WHERE p.piece_id = n OFFSET 0) p
            CROSS JOIN LATERAL _pieces_of((p.*)::piece) u
        )
        SELECT count(*), array_agg(m.a) FILTER (WHERE m.meets), array_agg(m.b) FILTER (WHERE m.meets),
               array_agg(m.a_part) FILTER (WHERE m.meets), array_agg(m.b_part) FILTER (WHERE m.meets)
            INTO v_candidates, v_a, v_b, v_a_parts, v_b_parts
            FROM (SELECT a.piece_id AS a, b.piece_id AS b, a.part AS a_part, b.part AS b_part,
                         _hulls_meet(a.hull, b.hull) AS meets
                  FROM unnest(v_a, v_b) c (a, b) JOIN one a ON a.piece_id = c.a
                  JOIN one b ON b.piece_id = c.b AND _pieces_may_meet((a.*)::piece, (b.*)::piece, v_within_s, NULL)
                                AND _boxes_meet(a.hull, b.hull) OFFSET 0) m;
        v_met := ARRAY(SELECT unnest(v_a) UNION SELECT unnest(v_b));
        v_stage2_us := 1e6 * extract(epoch FROM clock_timestamp() - v_began);
    END IF;
    -- The counts are returned even if no piece is.
    RETURN QUERY
        SELECT p.*, coalesce(array_send(m.b), ''), coalesce(array_send(m.a_parts), ''),
               coalesce(array_send(m.b_parts), ''), v_candidates, v_stage2_us
        FROM (SELECT) always
        LEFT JOIN _pieces(p_scene_id, v_met) p ON true
        LEFT JOIN (SELECT c.a, array_agg(c.b) AS b, array_agg(c.a_part) AS a_parts, array_agg(c.b_part) AS b_parts
                   FROM unnest(v_a, v_b, v_a_parts, v_b_parts) c (a, b, a_part, b_part) GROUP BY c.a) m
            ON m.a = p.piece_id
        ORDER BY p.rank;
END
$$;
COMMENT ON FUNCTION _put_pieces IS
'Stores the pieces of the objects from _begin_detection and runs stage 1 for them, at most p_most pairs of rows; also '
'stage 2 if they contain at most p_most_compared pairs of pieces. Returns all rows of pieces that are in a pair left, '
'with the columns of _pieces, in order of rank; one row without a piece if there is none. met: ids of the rows that a '
'stored row is paired with (array_send); a pair of two stored rows is listed once. own_parts, met_parts: the parts of '
'the two pieces of each pair; nulls if stage 2 has not run. candidate_pairs: pairs of pieces before stage 2; -1 if it '
'has not run. stage2_us: its microseconds, with the comparison of boxes inside bundles.';
