-- Stage 1 (broad phase): candidate pairs whose bounding boxes overlap in space, time and height. No false negatives:
-- hulls contain the swept piece, padded by tolerance and separation. Stage 2 removes false positives.
--
-- _pieces_may_meet is the rule of a pair. One self-join on the GiST index piece_scene_id_hull_span_gist; its columns
-- must stand alone on one side of &&. A row may bundle several pieces; the client then compares the boxes of the pieces
-- inside. The client also runs the later stages (stage 2 of few pieces: 21_stage2_intersection.sql). If all boxes of a
-- scene fit its memory, it reads them (_row_boxes) and makes the same join in a tenth of the time.
--
-- An object number is the kind above the id, so that numbers sort like (object_kind, object_id).

CREATE OR REPLACE FUNCTION conflictdb_internal._times_meet(
    p_a tstzrange, p_b tstzrange, p_within_s double precision
) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT p_b && _widened(p_a, p_within_s);
END;
COMMENT ON FUNCTION _times_meet(tstzrange, tstzrange, double precision) IS
'Whether two spans have instants that are at most p_within_s apart. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._heights_meet(
    p_a_floor_m double precision, p_a_ceiling_m double precision, p_b_floor_m double precision,
    p_b_ceiling_m double precision
) RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT p_a_floor_m < p_b_ceiling_m AND p_b_floor_m < p_a_ceiling_m;
END;
COMMENT ON FUNCTION _heights_meet(double precision, double precision, double precision, double precision) IS
'Whether two height bands overlap, as pieces have them: without their ceilings. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._ceiling_m(
    p_ceiling_m double precision, p_is_closed boolean
) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- The next number.
    SELECT CASE WHEN p_is_closed THEN p_ceiling_m + 1.2e-16 * greatest(abs(p_ceiling_m), 1e-100) ELSE p_ceiling_m END;
END;
COMMENT ON FUNCTION _ceiling_m(double precision, boolean) IS
'The ceiling of a piece: of closed intervals it belongs to the band. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._pieces_may_meet(
    p_a piece, p_b piece, p_within_s double precision, p_allowed jsonb
) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT (p_b).hull && (p_a).hull AND _times_meet((p_a).span, (p_b).span, p_within_s)
           AND _heights_meet((p_a).floor_m, (p_a).ceiling_m, (p_b).floor_m, (p_b).ceiling_m)
           -- Of two seam copies the originals meet, too.
           AND ((p_a).turn = 0 OR (p_b).turn = 0)
           -- Numbers are 0 of objects without.
           AND ((p_a).owner_number <> (p_b).owner_number OR (p_a).owner_number = 0)
           AND _are_compared((p_a).object_kind, (p_a).class_number, (p_b).object_kind, (p_b).class_number, p_allowed);
END;
COMMENT ON FUNCTION _pieces_may_meet(piece, piece, double precision, jsonb) IS
'Stage 1: whether two rows of pieces, of different objects, may meet: boxes, times within p_within_s, and heights '
'overlap, and the objects are compared (p_allowed: _allowed_types). Inlined into queries, where p_b is looked up in '
'the index piece_scene_id_hull_span_gist. Cast the row of a subquery: (a.*)::piece. One column that carries a whole '
'row costs more.';

CREATE OR REPLACE FUNCTION conflictdb_internal._given_piece(
    p_number bigint, p_kind smallint, p_object_id bigint, p_numbers bigint[], p_part integer, p_turn integer,
    p_hull geometry, p_span tstzrange, p_floor_m double precision, p_ceiling_m double precision
) RETURNS SETOF piece
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE ROWS 1
BEGIN ATOMIC
    SELECT
        /* piece columns: GIVEN but piece_id = p_number but object_kind = p_kind but object_id = p_object_id
           but part = p_part but turn = p_turn::smallint but hull = p_hull but span = p_span but floor_m = p_floor_m
           but ceiling_m = p_ceiling_m but pieces = 1 */
        p_number, NULL::bigint, p_kind, p_object_id, NULL::bigint, p_part, p_turn::smallint, p_hull, p_span, p_floor_m,
        p_ceiling_m, NULL::geometry, NULL::timestamptz, NULL::timestamptz, NULL::double precision,
        NULL::double precision, NULL::double precision, NULL::double precision, NULL::double precision, NULL::geometry,
        1, NULL::integer[], NULL::geometry, NULL::geometry, NULL::timestamptz[], NULL::timestamptz[],
        NULL::double precision[], NULL::double precision[], coalesce(p_numbers[1], 0), coalesce(p_numbers[2], 0)
        /* end */
        ;
END;
COMMENT ON FUNCTION _given_piece IS
'A piece that is not stored, as a row for _pieces_may_meet; piece_id: p_number; p_numbers: of the columns that plans '
'give numbers, 0 where there is none. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._numbers_of(p_numbers bigint[], p_n bigint) RETURNS bigint[]
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ARRAY[
        /* piece numbers: p_numbers[p_n][PLACE] */
        p_numbers[p_n][1], p_numbers[p_n][2]
        /* end */
        ];
END;
COMMENT ON FUNCTION _numbers_of(bigint[], bigint) IS 'A row of an array of two dimensions. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._given_pieces(
    p_scene_id bigint, p_kinds smallint[], p_numbers bigint[], p_turns integer[], p_hulls bytea[], p_starts_us bigint[],
    p_ends_us bigint[], p_inclusive boolean[], p_floors_m double precision[], p_ceilings_m double precision[]
) RETURNS SETOF piece
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_srid integer := (SELECT _plane_srid(_plane(s.motion, s.earth, s.centre_lon, s.centre_lat))
                       FROM scene s WHERE s.scene_id = p_scene_id);
BEGIN
    RETURN QUERY
        SELECT f.*
        FROM unnest(p_kinds, p_turns, p_hulls, p_starts_us, p_ends_us, p_inclusive, p_floors_m, p_ceilings_m)
             WITH ORDINALITY u (kind, turn, hull, start_us, end_us, is_inclusive, floor_m, ceiling_m, n)
        CROSS JOIN LATERAL _given_piece(
            u.n, u.kind, NULL, _numbers_of(p_numbers, u.n), NULL, u.turn, ST_GeomFromWKB(u.hull, v_srid),
            tstzrange(_instant_of(u.start_us), _instant_of(u.end_us), CASE WHEN u.is_inclusive THEN '[]' ELSE '[)' END),
            u.floor_m, u.ceiling_m) f;
END
$$;
COMMENT ON FUNCTION _given_pieces IS
'Pieces of plans that the client has cut, as rows for _pieces_may_meet; piece_id counts them from 1. p_numbers: a row '
'of numbers for each.';

CREATE OR REPLACE FUNCTION conflictdb_internal._object_number(p_kind smallint, p_id bigint) RETURNS bigint
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT (p_kind::bigint << 62) | p_id;
END;
COMMENT ON FUNCTION _object_number(smallint, bigint) IS
'Returns one number per object, kind above id: numbers sort by kind, then id.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_all_dirty(p_scene_id bigint) RETURNS boolean
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- OFFSET 0 forces index lookups; a hash table of all marks may exceed the memory.
    SELECT _parent_of(p_scene_id) IS NULL
       AND NOT EXISTS (SELECT FROM area a WHERE a.scene_id = p_scene_id
                       AND NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.object_kind = 0
                                       AND c.object_id = a.area_id AND c.is_covered AND c.with_number IS NULL
                                       OFFSET 0))
       AND NOT EXISTS (SELECT FROM track t WHERE t.scene_id = p_scene_id
                       AND NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.object_kind = 1
                                       AND c.object_id = t.track_id AND c.is_covered AND c.with_number IS NULL
                                       OFFSET 0));
END;
COMMENT ON FUNCTION _is_all_dirty(bigint) IS
'Whether every object of a scene has a covered mark for all of its pairs: changed, new pieces stored. False for a '
'branch, whose pairs are with its parent.';

CREATE OR REPLACE FUNCTION conflictdb_internal._order_of_all(p_scene_id bigint, p_objects bigint) RETURNS bytea
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT SET jit = off AS $$
DECLARE
    v_objects bytea;
    v_is_all boolean := _parent_of(p_scene_id) IS NULL
        AND p_objects >= (SELECT count(*) FROM (SELECT FROM area a WHERE a.scene_id = p_scene_id
                                                UNION ALL SELECT FROM track t WHERE t.scene_id = p_scene_id
                                                LIMIT p_objects + 1) o);
BEGIN
    IF v_is_all THEN
        -- The marks are aggregated once. A lookup for each object costs as much as its key.
        SELECT array_send(coalesce(array_agg(o.number ORDER BY o.kind, o.key COLLATE "C"), '{}')),
               coalesce(bool_and(c.number IS NOT NULL), true)
            INTO v_objects, v_is_all
            FROM (SELECT 0 AS kind, _object_number(0::smallint, a.area_id) AS number, a.key
                  FROM area a WHERE a.scene_id = p_scene_id
                  UNION ALL
                  SELECT 1, _object_number(1::smallint, t.track_id), t.key
                  FROM track t WHERE t.scene_id = p_scene_id) o
            LEFT JOIN (SELECT DISTINCT _object_number(m.object_kind, m.object_id) AS number
                       FROM change m WHERE m.scene_id = p_scene_id AND m.with_number IS NULL) c USING (number);
    END IF;
    RETURN CASE WHEN v_is_all THEN v_objects END;
END
$$;
COMMENT ON FUNCTION _order_of_all(bigint, bigint) IS
'The numbers of all objects of a scene in the order of kind and key (array_send), if it has at most p_objects, and '
'each has a mark for all of its pairs, covered or not. Otherwise, and for a branch, null.';

CREATE OR REPLACE FUNCTION conflictdb_internal._are_covered(p_scene_id bigint) RETURNS boolean
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id AND NOT c.is_covered);
END;
COMMENT ON FUNCTION _are_covered(bigint) IS
'Whether every mark of a scene is covered: its pieces are those of its objects as the snapshot sees them.';

CREATE OR REPLACE FUNCTION conflictdb_internal._candidates_of_all(
    p_scene_id bigint, OUT a_piece_id bigint, OUT b_piece_id bigint, OUT a_pieces integer, OUT b_pieces integer,
    OUT a_object bigint, OUT b_object bigint
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
-- Forces the index join, also while the statistics do not know the pieces yet.
SET enable_nestloop = on SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_is_most boolean := 2 * (SELECT count(*) FROM piece p WHERE p.scene_id = p_scene_id)
                         > (SELECT c.reltuples FROM pg_class c WHERE c.oid = 'piece'::regclass);
    v_within_s double precision := _longest_time_s(p_scene_id);
    v_allowed jsonb := _allowed_types(p_scene_id);
BEGIN
    -- Each pair once, in storage order, so that neighbours are close together. Parallel if the server has workers.
    -- "+ 0" prevents use of scene_id in the index.
    IF v_is_most THEN
        -- Without scene_id in the index condition, which would take a third of the time: most pieces match anyway.
        RETURN QUERY
            SELECT a.piece_id, b.piece_id, a.pieces, b.pieces, _object_number(a.object_kind, a.object_id),
                   _object_number(b.object_kind, b.object_id)
            FROM piece a JOIN piece b ON _pieces_may_meet(a, b, v_within_s, v_allowed)
            WHERE a.scene_id = p_scene_id AND b.scene_id + 0 = p_scene_id
              AND (a.object_kind, a.object_id) < (b.object_kind, b.object_id);
    ELSE
        -- OFFSET 0 hides that the scene is constant; otherwise it could become the only index condition.
        RETURN QUERY
            SELECT a.piece_id, b.piece_id, a.pieces, b.pieces, _object_number(a.object_kind, a.object_id),
                   _object_number(b.object_kind, b.object_id)
            FROM (SELECT p.* FROM piece p WHERE p.scene_id = p_scene_id OFFSET 0) a
            JOIN piece b ON _pieces_may_meet((a.*)::piece, b, v_within_s, v_allowed) AND b.scene_id = a.scene_id
            WHERE (a.object_kind, a.object_id) < (b.object_kind, b.object_id);
    END IF;
END
$$;
COMMENT ON FUNCTION _candidates_of_all(bigint) IS
'Stage 1 of a whole scene: pairs of rows of pieces whose boxes overlap in space, height, and time, as far as the '
'scene''s separation in time asks for.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_with(
    p_kind smallint, p_class bigint, p_numbers bigint[]
) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT p_class = ANY (p_numbers) OR _word_number(CASE p_kind WHEN 0 THEN 'area' ELSE 'track' END) = ANY (p_numbers);
END;
COMMENT ON FUNCTION _is_with(smallint, bigint, bigint[]) IS
'Whether marks for pairs with some classes and kinds (change.with_number) concern an object. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._class_number(p_kind smallint, p_id bigint) RETURNS bigint
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_kind WHEN 0 THEN (SELECT _word_number(a.class) FROM area a WHERE a.area_id = p_id)
                       ELSE (SELECT _word_number(t.class) FROM track t WHERE t.track_id = p_id) END;
END;
COMMENT ON FUNCTION _class_number(smallint, bigint) IS 'Number of the class of an object; null if it was removed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._candidates_of_dirty(
    p_scene_id bigint, OUT a_piece_id bigint, OUT b_piece_id bigint, OUT a_pieces integer, OUT b_pieces integer,
    OUT a_object bigint, OUT b_object bigint
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
-- As in _candidates_of_all.
SET enable_nestloop = on SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_within_s double precision := _longest_time_s(p_scene_id);
    v_allowed jsonb := _allowed_types(p_scene_id);
    v_layers bigint[] := _layers(p_scene_id);
    v_hidden bigint[] := _hidden_numbers(p_scene_id);
BEGIN
    -- If both objects are dirty, the pair is found from the first. OFFSET 0 forces the join order: dirty objects, their
    -- pieces, then the index.
    RETURN QUERY
        SELECT a.piece_id, b.piece_id, a.pieces, b.pieces, _object_number(a.object_kind, a.object_id),
               _object_number(b.object_kind, b.object_id)
        FROM (SELECT c.object_kind, c.object_id,
                     CASE WHEN count(*) = count(c.with_number) THEN array_agg(DISTINCT c.with_number) END AS with
              FROM change c WHERE c.scene_id = p_scene_id AND c.is_covered GROUP BY c.object_kind, c.object_id) d
        CROSS JOIN LATERAL (SELECT p.* FROM piece p
                            WHERE p.object_kind = d.object_kind AND p.object_id = d.object_id
                              AND p.scene_id + 0 = p_scene_id OFFSET 0) a
        CROSS JOIN unnest(v_layers) l (scene_id)
        JOIN piece b ON _pieces_may_meet((a.*)::piece, b, v_within_s, v_allowed) AND b.scene_id = l.scene_id
        WHERE (b.scene_id = a.scene_id OR _object_number(b.object_kind, b.object_id) <> ALL (v_hidden))
          -- Marks of rules concern the pairs with some classes only.
          AND (d.with IS NULL OR _is_with(b.object_kind, b.class_number, d.with)
               OR EXISTS (SELECT FROM change m WHERE m.scene_id = p_scene_id AND m.is_covered
                          AND m.object_kind = b.object_kind AND m.object_id = b.object_id
                          AND (m.with_number IS NULL
                               OR _is_with(a.object_kind, a.class_number, ARRAY[m.with_number]))))
          AND ((a.object_kind, a.object_id) < (b.object_kind, b.object_id)
               OR (a.object_kind, a.object_id) > (b.object_kind, b.object_id)
               AND NOT EXISTS (SELECT FROM change m WHERE m.scene_id = p_scene_id AND m.is_covered
                               AND m.object_kind = b.object_kind AND m.object_id = b.object_id));
END
$$;
COMMENT ON FUNCTION _candidates_of_dirty(bigint) IS
'Stage 1 of changed objects: as _candidates_of_all, pairs with at least one row of a dirty object. If both are dirty, '
'the pair is returned once.';

CREATE OR REPLACE FUNCTION conflictdb_internal._candidates(
    p_scene_id bigint, p_at_once bigint, OUT a bytea, OUT b bytea, OUT a_pieces bytea, OUT b_pieces bytea,
    OUT ranks bytea
) RETURNS SETOF record
-- No hash aggregation: it would need memory for all pairs, while sorts can spill to disk. No nested loops.
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
SET enable_hashagg = off SET enable_nestloop = off SET jit = off AS $$
BEGIN
    PERFORM _require_snapshot();
    -- Rank of a pair of objects: the number of pairs of pieces before it.
    IF _is_all_dirty(p_scene_id) THEN
        -- Order objects along the space-filling curve of their first pieces, so that pairs of a chunk share pieces.
        RETURN QUERY
            WITH objects AS MATERIALIZED (
                SELECT p.number, row_number() OVER (ORDER BY p.hull) AS place
                FROM (SELECT DISTINCT ON (_object_number(o.object_kind, o.object_id))
                             _object_number(o.object_kind, o.object_id) AS number, o.hull
                      FROM piece o WHERE o.scene_id = p_scene_id
                      ORDER BY _object_number(o.object_kind, o.object_id), o.part, o.turn) p
            )
            SELECT array_send(array_agg(c.a_piece_id)), array_send(array_agg(c.b_piece_id)),
                   array_send(array_agg(c.a_pieces)), array_send(array_agg(c.b_pieces)),
                   array_send(array_agg(c.before))
            FROM (SELECT m.*, rank() OVER (ORDER BY o.place, m.b_object) - 1 AS before
                  FROM _candidates_of_all(p_scene_id) m JOIN objects o ON o.number = m.a_object) c
            GROUP BY c.before / p_at_once;
    ELSE
        RETURN QUERY
            SELECT array_send(array_agg(c.a_piece_id)), array_send(array_agg(c.b_piece_id)),
                   array_send(array_agg(c.a_pieces)), array_send(array_agg(c.b_pieces)),
                   array_send(array_agg(c.before))
            FROM (SELECT m.*, rank() OVER (ORDER BY m.a_object, m.b_object) - 1 AS before
                  FROM _candidates_of_dirty(p_scene_id) m) c
            GROUP BY c.before / p_at_once;
    END IF;
END
$$;
COMMENT ON FUNCTION _candidates(bigint, bigint) IS
'Stage 1: candidate pairs of rows of pieces with at least one dirty object, in chunks of about p_at_once pairs; pairs '
'of the same two objects are in one chunk. Arrays without nulls (array_send): ids of the rows, numbers of pieces in '
'them, and rank of the pair of objects (number of pairs before it). Raises ZC013 in READ COMMITTED.';

CREATE OR REPLACE FUNCTION conflictdb_internal._joined_in_memory(
    p_scene_id bigint, p_most bigint, OUT rows bigint, OUT is_all boolean, OUT is_any boolean,
    OUT with_numbers bigint[]
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET jit = off AS $$
DECLARE
    -- Looking up the neighbours of a dirty object takes as long as reading the boxes of some twenty rows.
    c_rows_for_object CONSTANT bigint := 15;
    -- The bits of a mark.
    c_most_numbers CONSTANT integer := 62;
    v_is_asked boolean;
BEGIN
    PERFORM _require_snapshot();
    rows := (SELECT count(*) FROM (SELECT FROM piece p WHERE p.scene_id = p_scene_id LIMIT p_most + 1) n);
    is_all := rows <= p_most AND _is_all_dirty(p_scene_id);
    is_any := true;
    with_numbers := '{}';
    v_is_asked := is_all;
    IF NOT is_all AND rows <= p_most AND _parent_of(p_scene_id) IS NULL THEN
        SELECT coalesce(array_agg(DISTINCT c.with_number) FILTER (WHERE c.with_number IS NOT NULL), '{}'),
               coalesce(bool_or(c.with_number IS NULL), false),
               count(DISTINCT _object_number(c.object_kind, c.object_id)) * c_rows_for_object >= rows
            INTO with_numbers, is_any, v_is_asked
            FROM change c WHERE c.scene_id = p_scene_id AND c.is_covered;
        v_is_asked := v_is_asked AND cardinality(with_numbers) <= c_most_numbers;
    END IF;
    IF NOT v_is_asked THEN
        rows := 0;
    END IF;
END
$$;
COMMENT ON FUNCTION _joined_in_memory(bigint, bigint) IS
'How to join the rows of pieces of a scene in memory. rows: at most as many are to be joined; 0 if few objects are '
'dirty, for a branch, or if the scene has more than p_most rows. The others are parameters of _row_boxes. Raises ZC013 '
'in READ COMMITTED.';

CREATE OR REPLACE FUNCTION conflictdb_internal._row_boxes(
    p_scene_id bigint, p_is_all boolean, p_is_any boolean, p_with bigint[]
) RETURNS TABLE (
    piece_id bigint, pieces integer, object bigint, turn smallint, low_x double precision, low_y double precision,
    high_x double precision, high_y double precision, floor_m double precision, ceiling_m double precision,
    span_start timestamptz, span_end timestamptz,
    /* piece numbers: NAME TYPE, */
    class_number bigint, owner_number bigint,
    /* end */
    marks bigint
)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    WITH marked AS (
        SELECT c.object_kind, c.object_id,
               bit_or(1::bigint << coalesce(array_position(p_with, c.with_number), 0)) AS marks
        FROM change c WHERE NOT p_is_all AND c.scene_id = p_scene_id AND c.is_covered
        GROUP BY c.object_kind, c.object_id
    )
    SELECT r.piece_id, r.pieces, r.object, r.turn, ST_XMin(r.box), ST_YMin(r.box), ST_XMax(r.box), ST_YMax(r.box),
           r.floor_m, r.ceiling_m, r.span_start, r.span_end,
           /* piece numbers: r.NAME, */
           r.class_number, r.owner_number,
           /* end */
           r.marks
    -- OFFSET 0: compute each box once.
    FROM (SELECT p.piece_id, p.pieces, _object_number(p.object_kind, p.object_id) AS object, p.turn,
                 p.hull::box3d AS box, p.floor_m, p.ceiling_m,
                 /* piece numbers: p.NAME, */
                 p.class_number, p.owner_number,
                 /* end */
                 coalesce(lower(p.span), '-infinity') AS span_start,
                 coalesce(upper(p.span), 'infinity') AS span_end,
                 CASE WHEN p_is_all THEN 1 ELSE coalesce(m.marks, 0) END AS marks
          FROM piece p
          LEFT JOIN marked m ON m.object_kind = p.object_kind AND m.object_id = p.object_id
          WHERE p.scene_id = p_scene_id AND NOT isempty(p.span)
            AND (p_is_any OR m.marks IS NOT NULL OR _is_with(p.object_kind, p.class_number, p_with)) OFFSET 0) r;
END;
COMMENT ON FUNCTION _row_boxes(bigint, boolean, boolean, bigint[]) IS
'Bounding boxes of the rows of pieces of a scene that may be in a pair that marks concern, for joining them in memory '
'as _candidates does: for COPY, no nulls, metres of the plane. marks: bit 0 for all pairs of the object, bit n for '
'its pairs with the nth of p_with (_is_with). p_is_all: all objects have marks for all pairs; p_is_any: some have.';

CREATE OR REPLACE FUNCTION conflictdb_internal._pieces(
    p_scene_id bigint, p_piece_ids bigint[], OUT piece_id bigint, OUT rank bigint, OUT object_kind smallint,
    OUT object_id bigint, OUT version bigint, OUT pieces integer, OUT part integer, OUT turn smallint,
    OUT span_start timestamptz, OUT span_end timestamptz, OUT end_inclusive boolean, OUT floor_m double precision,
    OUT ceiling_m double precision, OUT leg_start timestamptz, OUT leg_end timestamptz,
    OUT start_lon_deg double precision, OUT start_lat_deg double precision, OUT end_lon_deg double precision,
    OUT end_lat_deg double precision, OUT bearing_deg double precision,
    /* piece numbers: OUT NAME TYPE, */
    OUT class_number bigint, OUT owner_number bigint,
    /* end */
    OUT hull bytea, OUT shape bytea, OUT shape_to bytea, OUT parts bytea, OUT cuts bytea, OUT leg_times bytea,
    OUT legs bytea, OUT climb bytea
) RETURNS SETOF record
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT p.piece_id, dense_rank() OVER (ORDER BY p.object_kind, coalesce(a.key, t.key) COLLATE "C"),
           p.object_kind, p.object_id, p.version, p.pieces, p.part, p.turn,
           coalesce(lower(p.span), '-infinity'), coalesce(upper(p.span), 'infinity'), upper_inc(p.span),
           p.floor_m, p.ceiling_m, coalesce(p.leg_start, '1970-01-01 00:00+00'),
           coalesce(p.leg_end, '1970-01-01 00:00+00'), coalesce(p.start_lon_deg, 0), coalesce(p.start_lat_deg, 0),
           coalesce(p.end_lon_deg, 0), coalesce(p.end_lat_deg, 0), coalesce(p.bearing_deg, 0),
           /* piece numbers: p.NAME, */
           p.class_number, p.owner_number,
           /* end */
           ST_AsBinary(coalesce(p.hulls, p.hull), 'NDR'), ST_AsBinary(coalesce(p.shapes, p.shape), 'NDR'),
           coalesce(ST_AsBinary(p.shape_to, 'NDR'), ''), coalesce(array_send(p.parts), ''),
           coalesce(array_send(p.cuts), ''), coalesce(array_send(p.leg_times), ''), coalesce(array_send(p.legs), ''),
           coalesce(array_send(p.climb), '')
    -- OFFSET 0 forces lookups; for a large scene the planner would scan all pieces.
    FROM unnest(p_piece_ids) wanted (piece_id)
    CROSS JOIN LATERAL (SELECT m.* FROM piece m WHERE m.piece_id = wanted.piece_id OFFSET 0) p
    LEFT JOIN LATERAL (SELECT m.key FROM area m
                       WHERE p.object_kind = 0 AND m.area_id = p.object_id
                         AND m.scene_id + 0 = ANY ((SELECT _layers(p_scene_id))::bigint[])
                         AND m.first_version <= p.version OFFSET 0) a ON true
    LEFT JOIN LATERAL (SELECT m.key FROM track m
                       WHERE p.object_kind = 1 AND m.track_id = p.object_id
                         AND m.scene_id + 0 = ANY ((SELECT _layers(p_scene_id))::bigint[])
                         AND m.first_version <= p.version OFFSET 0) t ON true;
END;
COMMENT ON FUNCTION _pieces(bigint, bigint[]) IS
'Rows of pieces by id, without nulls, for COPY. rank orders objects by kind and key, so that results do not depend on '
'ids. Areas and bundles have no motion: epoch and 0. For bundles, hull and shape hold those of all pieces (shape only '
'if they differ). shape_to, climb and the arrays of bundles (array_send) may be empty.';
