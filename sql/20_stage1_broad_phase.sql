-- Stage 1, broad phase: do the boxes of the swept pieces meet in space, time and height? May over-report, never misses:
-- hulls hold all that a piece covers, padded for the scene's tolerance and separation, and spans all of its time.
--
-- One self-join on the GiST index piece_scene_id_hull_span_gist. Indexed columns stand bare on their side of &&.

CREATE OR REPLACE FUNCTION _join_all(p_scene_id bigint) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- Comparing every piece with every other is never right, whatever the planner believes of their number.
SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off AS $$
BEGIN
    -- Every pair, ordered once. As one statement on tables that are not temporary it may use several processes. Adding
    -- 0 keeps the scene a condition of the join: known beforehand, it would offer itself as the only one of the index.
    EXECUTE format($q$
        CREATE TEMPORARY TABLE candidate ON COMMIT DROP AS
        SELECT a.piece_id AS a_piece_id, b.piece_id AS b_piece_id
        FROM piece a JOIN piece b ON b.hull && a.hull AND b.span && a.span
        WHERE a.scene_id = %1$s AND b.scene_id = a.scene_id + 0
          AND a.floor_m < b.ceiling_m AND b.floor_m < a.ceiling_m
          AND (a.object_kind, a.object_id) < (b.object_kind, b.object_id)
          AND (a.turn = 0 OR b.turn = 0)$q$, p_scene_id);
END
$$;
COMMENT ON FUNCTION _join_all(bigint) IS 'Stage 1 for a scene whose objects all changed; see _find_candidates.';

CREATE OR REPLACE FUNCTION _join_dirty(p_scene_id bigint) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- A few pieces against all: by the index, also while the statistics know nothing of them yet.
SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off SET enable_seqscan = off AS $$
BEGIN
    CREATE TEMPORARY TABLE dirty_piece ON COMMIT DROP AS
        SELECT p.* FROM pg_temp.dirty d
        JOIN piece p ON p.object_kind = d.object_kind AND p.object_id = d.object_id AND p.scene_id + 0 = d.scene_id;
    ANALYZE pg_temp.dirty_piece;
    -- Where both pieces are dirty the pair is taken from one side only.
    CREATE TEMPORARY TABLE candidate ON COMMIT DROP AS
        SELECT CASE WHEN o.is_first THEN a.piece_id ELSE b.piece_id END AS a_piece_id,
               CASE WHEN o.is_first THEN b.piece_id ELSE a.piece_id END AS b_piece_id
        FROM pg_temp.dirty_piece a JOIN piece b ON b.hull && a.hull AND b.span && a.span
        CROSS JOIN LATERAL (SELECT (a.object_kind, a.object_id) < (b.object_kind, b.object_id) AS is_first) o
        WHERE b.scene_id = a.scene_id
          AND a.floor_m < b.ceiling_m AND b.floor_m < a.ceiling_m
          AND (a.turn = 0 OR b.turn = 0)
          AND (a.object_kind, a.object_id) <> (b.object_kind, b.object_id)
          AND (o.is_first
               OR (b.object_kind, b.object_id) NOT IN (SELECT d.object_kind, d.object_id FROM pg_temp.dirty d));
    DROP TABLE pg_temp.dirty_piece;
END
$$;
COMMENT ON FUNCTION _join_dirty(bigint) IS 'Stage 1 for a scene some of whose objects changed; see _find_candidates.';

CREATE OR REPLACE FUNCTION _find_candidates(p_scene_id bigint) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
BEGIN
    PERFORM _require_snapshot();
    DROP TABLE IF EXISTS pg_temp.dirty, pg_temp.candidate;
    CREATE TEMPORARY TABLE dirty ON COMMIT DROP AS
        SELECT DISTINCT c.scene_id, c.object_kind, c.object_id FROM change c
        WHERE c.scene_id = p_scene_id AND c.is_covered;
    ANALYZE pg_temp.dirty;
    IF EXISTS (SELECT FROM piece p WHERE p.scene_id = p_scene_id
               AND (p.object_kind, p.object_id) NOT IN (SELECT d.object_kind, d.object_id FROM pg_temp.dirty d)) THEN
        PERFORM _join_dirty(p_scene_id);
    ELSE
        PERFORM _join_all(p_scene_id);
    END IF;
    RETURN (SELECT count(*) FROM pg_temp.candidate);
END
$$;
COMMENT ON FUNCTION _find_candidates(bigint) IS
'Stage 1: fills the temporary table candidate with the pairs of pieces, one of a changed object at least, whose boxes '
'meet in space, time and height; returns how many.';
