-- Stored differences: which delays of a track bring it into contact with another object. A detection of a scene that
-- asks for them (scene.delays_within_s) replaces those of the changed objects, in the transaction that replaces their
-- conflicts and deletes their marks. So they are complete whenever the scene is current.

CREATE OR REPLACE FUNCTION conflictdb_internal._forget_differences(p_scene_id bigint, p_numbers bigint[]) RETURNS bytea
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_numbers bigint[] := p_numbers;
BEGIN
    PERFORM _require_snapshot();
    IF p_numbers IS NULL THEN
        -- Pieces are stored in the order of places, so that neighbours come together.
        SELECT coalesce(array_agg(_object_number(m.object_kind, m.object_id) ORDER BY o.first), '{}') INTO v_numbers
            FROM (SELECT DISTINCT c.object_kind, c.object_id FROM change c
                  WHERE c.scene_id = p_scene_id AND c.is_covered) m
            CROSS JOIN LATERAL (SELECT min(p.piece_id) AS first FROM piece p
                                WHERE p.object_kind = m.object_kind AND p.object_id = m.object_id
                                  AND p.scene_id + 0 = p_scene_id OFFSET 0) o;
        IF _is_all_dirty(p_scene_id) THEN
            DELETE FROM difference d WHERE d.scene_id = p_scene_id;
            RETURN array_send(v_numbers);
        END IF;
    END IF;
    -- OFFSET 0 forces index lookups.
    DELETE FROM difference d WHERE d.ctid = ANY (ARRAY(
        SELECT o.place FROM unnest(v_numbers) n
        CROSS JOIN LATERAL (SELECT d.ctid AS place FROM difference d
                            WHERE n >> 62 = 1 AND d.scene_id = p_scene_id AND d.track_id = n & ((1::bigint << 62) - 1)
                            UNION ALL
                            SELECT d.ctid FROM difference d
                            WHERE d.other_kind = (n >> 62)::smallint AND d.other_id = n & ((1::bigint << 62) - 1)
                              AND d.scene_id + 0 = p_scene_id OFFSET 0) o));
    RETURN array_send(v_numbers);
END
$$;
COMMENT ON FUNCTION _forget_differences(bigint, bigint[]) IS
'Deletes the stored differences of objects of a scene; null: of those with a covered mark. Returns their numbers '
'(array_send), neighbours together.';

CREATE OR REPLACE FUNCTION conflictdb_internal._rows_to_compare(
    p_scene_id bigint, p_numbers bigint[], p_horizon_us bigint,
    OUT piece_ids bytea, OUT pieces bigint, OUT compared bigint
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
-- Forces the index join, as in _candidates.
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET enable_material = off SET jit = off AS $$
DECLARE
    -- A microsecond more: the client also compares pieces that touch.
    v_within_s double precision := (p_horizon_us + 1) / 1e6;
    v_allowed jsonb := _allowed_types(p_scene_id);
    v_near bigint[];
BEGIN
    -- OFFSET 0 forces an index lookup per object, and per row of pieces.
    SELECT array_agg(DISTINCT f.number), coalesce(sum(f.pieces), 0) INTO v_near, compared
        FROM (SELECT _object_number(b.object_kind, b.object_id) AS number, a.pieces::bigint * b.pieces AS pieces
              FROM (SELECT p.* FROM unnest(p_numbers) n
                    CROSS JOIN LATERAL (SELECT p.* FROM piece p
                                        WHERE p.object_kind = (n >> 62)::smallint
                                          AND p.object_id = n & ((1::bigint << 62) - 1)
                                          AND p.scene_id + 0 = p_scene_id OFFSET 0) p
                    OFFSET 0) a
              CROSS JOIN LATERAL (SELECT p.* FROM piece p
                                  WHERE p.scene_id = p_scene_id
                                    AND _pieces_may_meet((a.*)::piece, p, v_within_s, v_allowed)
                                    AND (a.object_kind = 1 OR p.object_kind = 1)
                                    AND (p.object_kind, p.object_id) <> (a.object_kind, a.object_id) OFFSET 0) b
              OFFSET 0) f;
    SELECT array_send(coalesce(array_agg(o.piece_id), '{}')), coalesce(sum(o.pieces), 0) INTO piece_ids, pieces
        FROM (SELECT unnest(v_near) UNION SELECT unnest(p_numbers)) n (number)
        CROSS JOIN LATERAL (SELECT p.piece_id, p.pieces FROM piece p
                            WHERE p.object_kind = (n.number >> 62)::smallint
                              AND p.object_id = n.number & ((1::bigint << 62) - 1)
                              AND p.scene_id + 0 = p_scene_id OFFSET 0) o;
END
$$;
COMMENT ON FUNCTION _rows_to_compare(bigint, bigint[], bigint) IS
'All rows of pieces of objects of a scene, and of those that they may meet if one of both is a track that is up to '
'p_horizon_us earlier or later: ids (array_send), number of pieces, and of pairs of pieces whose rows meet.';

CREATE OR REPLACE FUNCTION conflictdb_internal._first_stops(
    p_scene_id bigint, p_numbers bigint[], OUT number bigint, OUT departs_us bigint[]
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT
SET plan_cache_mode = force_generic_plan SET max_parallel_workers_per_gather = 0
SET enable_seqscan = off SET jit = off AS $$
BEGIN
    -- OFFSET 0 forces an index lookup per track.
    RETURN QUERY
    SELECT n, CASE WHEN t.departures IS NULL THEN ARRAY[round(ST_M(ST_StartPoint(t.path)) * 1000000)::bigint]
                   ELSE ARRAY(SELECT round(extract(epoch FROM d) * 1000000)::bigint FROM unnest(t.departures) d) END
    FROM unnest(p_numbers) n
    CROSS JOIN LATERAL (SELECT t.path, t.departures FROM track t
                        WHERE n >> 62 = 1 AND t.track_id = n & ((1::bigint << 62) - 1)
                          AND t.scene_id + 0 = p_scene_id OFFSET 0) t
    WHERE NOT _is_moving(ST_StartPoint(t.path), ST_PointN(t.path, 2), 'great_circle', 'wgs84');
END
$$;
COMMENT ON FUNCTION _first_stops(bigint, bigint[]) IS
'The tracks, of some objects of a scene, whose first leg stands still, and when their voyages begin, microseconds.';

CREATE OR REPLACE FUNCTION conflictdb_internal._write_differences(
    p_scene_id bigint, p_track_id bigint[], p_other_kind smallint[], p_other_id bigint[],
    p_forbidden_us int8multirange[], p_proven_us int8multirange[]
) RETURNS void
LANGUAGE sql VOLATILE
BEGIN ATOMIC
    INSERT INTO difference (scene_id, track_id, other_kind, other_id, forbidden_us, proven_us)
        SELECT p_scene_id, u.* FROM unnest(p_track_id, p_other_kind, p_other_id, p_forbidden_us, p_proven_us) u;
END;
COMMENT ON FUNCTION _write_differences(bigint, bigint[], smallint[], bigint[], int8multirange[], int8multirange[]) IS
'Stores differences; those of the same objects were deleted before (_forget_differences).';

COMMENT ON TABLE difference IS
'Which delays of a track bring it into contact with another object, which stays as planned; for scenes with '
'delays_within_s. Complete while the scene is current. Workers read it for '
'request_delays.';
COMMENT ON COLUMN difference.scene_id IS 'Scene.';
COMMENT ON COLUMN difference.track_id IS 'Track.';
COMMENT ON COLUMN difference.other_kind IS 'Kind of the other object: 0 area, 1 track.';
COMMENT ON COLUMN difference.other_id IS 'Id of the other object.';
COMMENT ON COLUMN difference.forbidden_us IS
'All delays in conflict, within delays_within_s either way, microseconds; negative: earlier. All others are free.';
COMMENT ON COLUMN difference.proven_us IS
'Delays that are proven to be in conflict, extended by a microsecond on both sides.';
