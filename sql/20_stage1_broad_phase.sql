-- Stage 1, broad phase: do the boxes of the swept pieces meet in space, time and height? May over-report, never misses:
-- hulls hold all that a piece covers, padded for the scene's tolerance and separation, and spans all of its time.
--
-- One self-join on the GiST index piece_scene_id_hull_span_gist. Indexed columns stand bare on their side of &&.

CREATE OR REPLACE FUNCTION _find_candidates(p_scene_id bigint) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- Index or nothing: a wrong guess of the planner would compare every piece with every other.
SET enable_seqscan = off SET enable_material = off SET enable_mergejoin = off AS $$
DECLARE
    v_candidates bigint;
    v_dirty bigint;
    v_objects bigint;
BEGIN
    PERFORM _require_snapshot();
    DROP TABLE IF EXISTS pg_temp.dirty, pg_temp.candidate;
    CREATE TEMPORARY TABLE dirty ON COMMIT DROP AS
        SELECT DISTINCT c.object_kind, c.object_id FROM change c WHERE c.scene_id = p_scene_id AND c.is_covered;
    ANALYZE pg_temp.dirty;
    SELECT count(*) INTO v_dirty FROM pg_temp.dirty;
    SELECT (SELECT count(*) FROM area a WHERE a.scene_id = p_scene_id)
         + (SELECT count(*) FROM track t WHERE t.scene_id = p_scene_id) INTO v_objects;
    IF v_dirty >= v_objects AND NOT EXISTS (
        SELECT FROM piece p WHERE p.scene_id = p_scene_id
            AND NOT EXISTS (SELECT FROM pg_temp.dirty d WHERE d.object_kind = p.object_kind AND d.object_id = p.object_id)
    ) THEN
        -- Everything is dirty: every pair, ordered once.
        EXECUTE format($q$
            CREATE TEMPORARY TABLE candidate ON COMMIT DROP AS
            SELECT a.piece_id AS a_piece_id, b.piece_id AS b_piece_id
            FROM piece a JOIN piece b ON b.hull && a.hull AND b.span && a.span
            WHERE a.scene_id = %1$s AND b.scene_id = %1$s
              AND a.floor_m < b.ceiling_m AND b.floor_m < a.ceiling_m
              AND (a.object_kind, a.object_id) < (b.object_kind, b.object_id)
              AND (a.turn = 0 OR b.turn = 0)$q$, p_scene_id);
    ELSE
        -- Dirty pieces against all; where both are dirty the pair is taken from one side only.
        EXECUTE format($q$
            CREATE TEMPORARY TABLE dirty_piece ON COMMIT DROP AS
            SELECT p.* FROM pg_temp.dirty d JOIN piece p USING (object_kind, object_id) WHERE p.scene_id = %1$s$q$,
            p_scene_id);
        ANALYZE pg_temp.dirty_piece;
        EXECUTE format($q$
            CREATE TEMPORARY TABLE candidate ON COMMIT DROP AS
            SELECT CASE WHEN o.first THEN a.piece_id ELSE b.piece_id END AS a_piece_id,
                   CASE WHEN o.first THEN b.piece_id ELSE a.piece_id END AS b_piece_id
            FROM pg_temp.dirty_piece a JOIN piece b ON b.hull && a.hull AND b.span && a.span
            CROSS JOIN LATERAL (SELECT (a.object_kind, a.object_id) < (b.object_kind, b.object_id) AS first) o
            WHERE b.scene_id = %1$s
              AND a.floor_m < b.ceiling_m AND b.floor_m < a.ceiling_m
              AND (a.turn = 0 OR b.turn = 0)
              AND (a.object_kind, a.object_id) <> (b.object_kind, b.object_id)
              AND (o.first OR NOT EXISTS (SELECT FROM pg_temp.dirty d
                                          WHERE d.object_kind = b.object_kind AND d.object_id = b.object_id))$q$,
            p_scene_id);
        DROP TABLE pg_temp.dirty_piece;
    END IF;
    GET DIAGNOSTICS v_candidates = ROW_COUNT;
    SELECT count(*) INTO v_candidates FROM pg_temp.candidate;
    RETURN v_candidates;
END
$$;
COMMENT ON FUNCTION _find_candidates(bigint) IS
'Stage 1: fills the temporary table candidate with the pairs of pieces, one of a changed object at least, whose boxes '
'meet in space, time and height; returns how many.';
