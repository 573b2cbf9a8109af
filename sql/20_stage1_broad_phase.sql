-- Stage 1, broad phase: do the boxes of the swept pieces meet in space, time and height? May over-report, never misses:
-- hulls hold all that a piece covers, padded for the scene's tolerance and separation, and spans all of its time.
--
-- A row holds a piece, or a bundle of some that lie near each other: here pairs of rows are found, at the client the
-- pairs of their pieces, by comparing boxes in memory.
--
-- One self-join on the GiST index piece_scene_id_hull_span_gist. Indexed columns stand bare on their side of &&. The
-- stages that follow run at the client, which reads what it can hold: some of the pairs, then their pieces. Of a whole
-- scene whose boxes it can hold it reads these and joins them itself: in a tenth of the time, by the same comparisons.
--
-- An object goes by one number: its kind above its id, so that numbers are in the order of (object_kind, object_id).

CREATE OR REPLACE FUNCTION _object_number(p_kind smallint, p_id bigint) RETURNS bigint
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT (p_kind::bigint << 62) | p_id;
END;
COMMENT ON FUNCTION _object_number(smallint, bigint) IS
'One number for an object of any kind; in the order of kinds, then ids.';

CREATE OR REPLACE FUNCTION _is_all_dirty(p_scene_id bigint) RETURNS boolean
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- OFFSET 0: each is looked up in the index of the marks, which a table of hashes may have no room for.
    SELECT NOT EXISTS (SELECT FROM area a WHERE a.scene_id = p_scene_id
                       AND NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.object_kind = 0
                                       AND c.object_id = a.area_id AND c.is_covered OFFSET 0))
       AND NOT EXISTS (SELECT FROM track t WHERE t.scene_id = p_scene_id
                       AND NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.object_kind = 1
                                       AND c.object_id = t.track_id AND c.is_covered OFFSET 0));
END;
COMMENT ON FUNCTION _is_all_dirty(bigint) IS 'Whether every object of a scene changed, and its pieces are made.';

CREATE OR REPLACE FUNCTION _candidates_of_all(
    p_scene_id bigint, OUT a_piece_id bigint, OUT b_piece_id bigint, OUT a_pieces integer, OUT b_pieces integer,
    OUT a_object bigint, OUT b_object bigint
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
-- Comparing every piece with every other is never right, whatever the planner believes of their number: by the index,
-- also while the statistics know nothing of the pieces yet.
SET enable_nestloop = on SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_is_most boolean := 2 * (SELECT count(*) FROM piece p WHERE p.scene_id = p_scene_id)
                         > (SELECT c.reltuples FROM pg_class c WHERE c.oid = 'piece'::regclass);
BEGIN
    -- Every pair, ordered once, in the order in which pieces are stored: those near each other. By several processes
    -- where the server has them to spare. Adding 0 keeps the scene from the index.
    IF v_is_most THEN
        -- Without the scene, which takes a third of the time to look at, and there is little else in its place.
        RETURN QUERY
            SELECT a.piece_id, b.piece_id, a.pieces, b.pieces, _object_number(a.object_kind, a.object_id),
                   _object_number(b.object_kind, b.object_id)
            FROM piece a JOIN piece b ON b.hull && a.hull AND b.span && a.span
            WHERE a.scene_id = p_scene_id AND b.scene_id + 0 = p_scene_id
              AND a.floor_m < b.ceiling_m AND b.floor_m < a.ceiling_m
              AND (a.object_kind, a.object_id) < (b.object_kind, b.object_id)
              AND (a.turn = 0 OR b.turn = 0);
    ELSE
        -- OFFSET 0: the scene is no constant of the join, which would offer itself as the only condition of the index.
        RETURN QUERY
            SELECT a.piece_id, b.piece_id, a.pieces, b.pieces, _object_number(a.object_kind, a.object_id),
                   _object_number(b.object_kind, b.object_id)
            FROM (SELECT p.* FROM piece p WHERE p.scene_id = p_scene_id OFFSET 0) a
            JOIN piece b ON b.hull && a.hull AND b.span && a.span AND b.scene_id = a.scene_id
            WHERE a.floor_m < b.ceiling_m AND b.floor_m < a.ceiling_m
              AND (a.object_kind, a.object_id) < (b.object_kind, b.object_id)
              AND (a.turn = 0 OR b.turn = 0);
    END IF;
END
$$;
COMMENT ON FUNCTION _candidates_of_all(bigint) IS
'Stage 1 of a whole scene: the pairs of pieces whose boxes meet in space, time and height.';

CREATE OR REPLACE FUNCTION _candidates_of_dirty(
    p_scene_id bigint, OUT a_piece_id bigint, OUT b_piece_id bigint, OUT a_pieces integer, OUT b_pieces integer,
    OUT a_object bigint, OUT b_object bigint
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
-- As above.
SET enable_nestloop = on SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off
SET enable_seqscan = off SET jit = off AS $$
BEGIN
    -- Where both objects are dirty the pair is taken from the side of the first. OFFSET 0: from the dirty objects to
    -- their pieces, however many the planner believes there are, and not from all pairs of pieces to those.
    RETURN QUERY
        SELECT a.piece_id, b.piece_id, a.pieces, b.pieces, _object_number(a.object_kind, a.object_id),
               _object_number(b.object_kind, b.object_id)
        FROM (SELECT DISTINCT c.object_kind, c.object_id FROM change c
              WHERE c.scene_id = p_scene_id AND c.is_covered) d
        CROSS JOIN LATERAL (SELECT p.* FROM piece p
                            WHERE p.object_kind = d.object_kind AND p.object_id = d.object_id
                              AND p.scene_id + 0 = p_scene_id OFFSET 0) a
        JOIN piece b ON b.hull && a.hull AND b.span && a.span AND b.scene_id = a.scene_id + 0
        WHERE a.floor_m < b.ceiling_m AND b.floor_m < a.ceiling_m
          AND (a.turn = 0 OR b.turn = 0)
          AND ((a.object_kind, a.object_id) < (b.object_kind, b.object_id)
               OR (a.object_kind, a.object_id) > (b.object_kind, b.object_id)
               AND NOT EXISTS (SELECT FROM change m WHERE m.scene_id = p_scene_id AND m.is_covered
                               AND m.object_kind = b.object_kind AND m.object_id = b.object_id));
END
$$;
COMMENT ON FUNCTION _candidates_of_dirty(bigint) IS
'Stage 1 of what changed: the pairs of pieces of dirty objects, and of what they meet, whose boxes meet in space, time '
'and height, each pair with the first of its dirty objects.';

CREATE OR REPLACE FUNCTION _candidates(
    p_scene_id bigint, p_at_once bigint, OUT a bytea, OUT b bytea, OUT a_pieces bytea, OUT b_pieces bytea,
    OUT ranks bytea
) RETURNS SETOF record
-- Hashes would hold all of them in memory; sorts go to the disk. No object is compared with all pairs, whatever the
-- statistics know.
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
SET enable_hashagg = off SET enable_nestloop = off SET jit = off AS $$
BEGIN
    PERFORM _require_snapshot();
    -- The rank of a pair of objects is how many pairs of pieces come before it.
    IF _is_all_dirty(p_scene_id) THEN
        -- By where the first of them is (geometries are in the order of a curve): pairs of a chunk share pieces.
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
'Stage 1: the pairs of rows of pieces whose boxes meet in space, time and height, of dirty objects and of what they '
'meet, so many pairs to a row, those of the same two objects in one: ids of the rows, how many pieces each holds, and '
'how many pairs of other objects come before, as arrays without nulls (array_send). Refuses (ZC013) outside of a '
'snapshot.';

CREATE OR REPLACE FUNCTION _row_boxes(
    p_scene_id bigint, p_most bigint, OUT piece_ids bytea, OUT pieces bytea, OUT objects bytea, OUT turns bytea,
    OUT low_xs bytea, OUT low_ys bytea, OUT high_xs bytea, OUT high_ys bytea, OUT floors_m bytea, OUT ceilings_m bytea,
    OUT span_starts bytea, OUT span_ends bytea
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET jit = off AS $$
DECLARE
    -- Of a scene that is detected in parts, and of one too large, there is nothing to be read.
    v_is_asked boolean := (SELECT count(*) FROM (SELECT FROM piece p WHERE p.scene_id = p_scene_id LIMIT p_most + 1) n)
                          <= p_most AND _is_all_dirty(p_scene_id);
BEGIN
    PERFORM _require_snapshot();
    SELECT array_send(coalesce(array_agg(r.piece_id), '{}')), array_send(coalesce(array_agg(r.pieces), '{}')),
           array_send(coalesce(array_agg(r.object), '{}')), array_send(coalesce(array_agg(r.turn), '{}')),
           array_send(coalesce(array_agg(ST_XMin(r.box)), '{}')), array_send(coalesce(array_agg(ST_YMin(r.box)), '{}')),
           array_send(coalesce(array_agg(ST_XMax(r.box)), '{}')), array_send(coalesce(array_agg(ST_YMax(r.box)), '{}')),
           array_send(coalesce(array_agg(r.floor_m), '{}')), array_send(coalesce(array_agg(r.ceiling_m), '{}')),
           array_send(coalesce(array_agg(r.span_start), '{}')), array_send(coalesce(array_agg(r.span_end), '{}'))
        INTO piece_ids, pieces, objects, turns, low_xs, low_ys, high_xs, high_ys, floors_m, ceilings_m, span_starts,
             span_ends
        -- OFFSET 0: each box is made once.
        FROM (SELECT p.piece_id, p.pieces, _object_number(p.object_kind, p.object_id) AS object, p.turn,
                     p.hull::box3d AS box, p.floor_m, p.ceiling_m, coalesce(lower(p.span), '-infinity') AS span_start,
                     coalesce(upper(p.span), 'infinity') AS span_end
              FROM piece p WHERE v_is_asked AND p.scene_id = p_scene_id AND NOT isempty(p.span) OFFSET 0) r;
END
$$;
COMMENT ON FUNCTION _row_boxes(bigint, bigint) IS
'What the rows of pieces of a scene take up, each column as an array without nulls (array_send), for who joins them in '
'memory: what _candidates answers, from the same comparisons. None where only some objects are dirty, or there are '
'more rows than p_most. Refuses (ZC013) outside of a snapshot.';

CREATE OR REPLACE FUNCTION _pieces(
    p_scene_id bigint, p_piece_ids bigint[], OUT piece_id bigint, OUT rank bigint, OUT object_kind smallint,
    OUT object_id bigint, OUT version bigint, OUT pieces integer, OUT part integer, OUT turn smallint,
    OUT span_start timestamptz, OUT span_end timestamptz, OUT end_inclusive boolean, OUT floor_m double precision,
    OUT ceiling_m double precision, OUT leg_start timestamptz, OUT leg_end timestamptz,
    OUT start_lon_deg double precision, OUT start_lat_deg double precision, OUT end_lon_deg double precision,
    OUT end_lat_deg double precision, OUT bearing_deg double precision, OUT hull bytea, OUT shape bytea,
    OUT shape_to bytea, OUT parts bytea, OUT cuts bytea, OUT leg_times bytea, OUT legs bytea
) RETURNS SETOF record
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT p.piece_id, dense_rank() OVER (ORDER BY p.object_kind, coalesce(a.key, t.key) COLLATE "C"),
           p.object_kind, p.object_id, p.version, p.pieces, p.part, p.turn,
           coalesce(lower(p.span), '-infinity'), coalesce(upper(p.span), 'infinity'), upper_inc(p.span),
           p.floor_m, p.ceiling_m, coalesce(p.leg_start, '1970-01-01 00:00+00'),
           coalesce(p.leg_end, '1970-01-01 00:00+00'), coalesce(p.start_lon_deg, 0), coalesce(p.start_lat_deg, 0),
           coalesce(p.end_lon_deg, 0), coalesce(p.end_lat_deg, 0), coalesce(p.bearing_deg, 0),
           ST_AsBinary(coalesce(p.hulls, p.hull), 'NDR'), ST_AsBinary(coalesce(p.shapes, p.shape), 'NDR'),
           coalesce(ST_AsBinary(p.shape_to, 'NDR'), ''), coalesce(array_send(p.parts), ''),
           coalesce(array_send(p.cuts), ''), coalesce(array_send(p.leg_times), ''), coalesce(array_send(p.legs), '')
    -- OFFSET 0: each is looked up; of a large scene the planner would read all pieces, time and again.
    FROM unnest(p_piece_ids) wanted (piece_id)
    CROSS JOIN LATERAL (SELECT m.* FROM piece m WHERE m.piece_id = wanted.piece_id OFFSET 0) p
    LEFT JOIN LATERAL (SELECT m.key FROM area m
                       WHERE p.object_kind = 0 AND m.area_id = p.object_id AND m.scene_id + 0 = p_scene_id
                         AND m.first_version <= p.version OFFSET 0) a ON true
    LEFT JOIN LATERAL (SELECT m.key FROM track m
                       WHERE p.object_kind = 1 AND m.track_id = p.object_id AND m.scene_id + 0 = p_scene_id
                         AND m.first_version <= p.version OFFSET 0) t ON true;
END;
COMMENT ON FUNCTION _pieces(bigint, bigint[]) IS
'Rows of pieces of a scene, without nulls, for COPY. Rank orders objects by kind and key, so that results do not '
'depend on ids. Areas and bundles have no motion: epoch and 0. Of bundles hull has those of all pieces, and so has '
'shape where they differ. Empty where there is none: shape_to, and the arrays of bundles (array_send).';
