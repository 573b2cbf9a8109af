-- Updating pieces. Detection (conflictdb.store) reads marked objects, cuts them and COPYs the pieces in, all in one
-- REPEATABLE READ transaction, so that marks and objects are consistent.

CREATE OR REPLACE FUNCTION conflictdb_internal._pending(p_scene_id bigint, OUT areas bigint, OUT tracks bigint)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
SET enable_seqscan = off SET enable_bitmapscan = off SET jit = off -- see _is_current
AS $$
BEGIN
    areas := (SELECT count(*) FROM (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.object_kind = 0
                                    LIMIT 1000) m);
    tracks := (SELECT count(*) FROM (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.object_kind = 1
                                     LIMIT 1000) m);
END
$$;
COMMENT ON FUNCTION _pending(bigint) IS
'Number of marks of areas and of tracks of a scene, counted up to 1,000 each.';

CREATE OR REPLACE FUNCTION conflictdb_internal._area_row(p_scene_id bigint, p_area_id bigint) RETURNS TABLE (
    area_id bigint, version bigint, span_start timestamptz, span_end timestamptz,
    /* area measures: NAME TYPE, */
    floor_m double precision, ceiling_m double precision,
    /* end */
    /* area numbered: NAME_number bigint, */
    class_number bigint, owner_number bigint,
    /* end */
    /* area bytes: NAME bytea */
    footprint bytea, activations bytea
    /* end */
)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- "+ 0" prevents use of the index on scene_id, which would read all objects of the scene.
    SELECT a.area_id, a.version, coalesce(lower(a.active_span), '-infinity'),
           coalesce(upper(a.active_span), 'infinity'),
           /* area measures: SENT(a), */
           coalesce(a.floor_m, 'NaN'), coalesce(a.ceiling_m, 'NaN'),
           /* end */
           /* area numbered: NUMBER(a), */
           _word_number(a.class), _word_number(a.owner),
           /* end */
           /* area bytes: SENT(a) but activations = EXPANDED(a) */
           ST_AsBinary(a.footprint, 'NDR'),
           CASE WHEN a.schedule_error IS NULL AND a.activations IS NOT NULL THEN array_send(_ends_of(a.activations))
               WHEN a.schedule IS NULL THEN '' ELSE '\x00' END
           /* end */
    FROM area a WHERE a.area_id = p_area_id AND a.scene_id + 0 = p_scene_id;
END;
COMMENT ON FUNCTION _area_row(bigint, bigint) IS
'One area of a scene without nulls: infinite instants and NaN heights (metres) mean unbounded, activations '
'(array_send, starts and ends in turn) are empty for one span only, and a zero byte if a schedule is not expanded. '
'Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._changed_areas(
    p_scene_id bigint, p_after bigint, p_most bigint,
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
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- OFFSET 0 forces the order: marks first, then their objects.
    SELECT a.*
    FROM (SELECT DISTINCT c.object_id FROM change c
          WHERE c.scene_id = p_scene_id AND c.object_kind = 0 AND c.object_id > p_after
          ORDER BY c.object_id OFFSET 0) c
    CROSS JOIN LATERAL _area_row(p_scene_id, c.object_id) a
    ORDER BY c.object_id LIMIT p_most;
END;
COMMENT ON FUNCTION _changed_areas(bigint, bigint, bigint) IS
'Marked areas with an id above p_after, at most p_most, in order of id; columns of _area_row, for COPY.';

CREATE OR REPLACE FUNCTION conflictdb_internal._footprints(
    p_area_ids bigint[]
) RETURNS TABLE (area_id bigint, footprint bytea)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT a.area_id, ST_AsBinary(a.footprint, 'NDR') FROM area a WHERE a.area_id = ANY (p_area_ids);
END;
COMMENT ON FUNCTION _footprints(bigint[]) IS 'Footprints of areas as WKB, longitude and latitude, degrees.';

CREATE OR REPLACE FUNCTION conflictdb_internal._track_row(p_scene_id bigint, p_track_id bigint) RETURNS TABLE (
    track_id bigint, version bigint,
    /* track measures: NAME TYPE, */
    floor_m double precision, ceiling_m double precision, grow_mps double precision,
    /* end */
    /* track numbered: NAME_number bigint, */
    class_number bigint, owner_number bigint,
    /* end */
    /* track bytes: NAME bytea, */
    path bytea, outline bytea, outlines bytea, floors_m bytea, ceilings_m bytea, departures bytea,
    /* end */
    tolerances text
)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT t.track_id, t.version,
           /* track measures: SENT(t), */
           coalesce(t.floor_m, 'NaN'), coalesce(t.ceiling_m, 'NaN'), coalesce(t.grow_mps, 'NaN'),
           /* end */
           /* track numbered: NUMBER(t), */
           _word_number(t.class), _word_number(t.owner),
           /* end */
           /* track bytes: SENT(t), but departures = EXPANDED(t), */
           ST_AsBinary(t.path, 'NDR'), ST_AsBinary(t.outline, 'NDR'), coalesce(ST_AsBinary(t.outlines, 'NDR'), ''),
           coalesce(array_send(t.floors_m), ''), coalesce(array_send(t.ceilings_m), ''),
           CASE WHEN t.schedule_error IS NULL AND t.departures IS NOT NULL THEN array_send(t.departures) WHEN t.schedule
               IS NULL THEN '' ELSE '\x00' END,
           /* end */
           coalesce(t.tolerances::text, '')
    FROM track t WHERE t.track_id = p_track_id AND t.scene_id + 0 = p_scene_id;
END;
COMMENT ON FUNCTION _track_row(bigint, bigint) IS
'One track of a scene without nulls: NaN heights (metres) mean unbounded. Empty: outlines if not per waypoint; '
'floors_m and ceilings_m (array_send) if not per leg; departures (array_send) if it is one voyage. '
'departures are a zero byte if the schedule is not expanded; tolerances. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._changed_tracks(
    p_scene_id bigint, p_after bigint, p_most bigint,
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
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    -- As in _changed_areas.
    SELECT t.*
    FROM (SELECT DISTINCT c.object_id FROM change c
          WHERE c.scene_id = p_scene_id AND c.object_kind = 1 AND c.object_id > p_after
          ORDER BY c.object_id OFFSET 0) c
    CROSS JOIN LATERAL _track_row(p_scene_id, c.object_id) t
    ORDER BY c.object_id LIMIT p_most;
END;
COMMENT ON FUNCTION _changed_tracks(bigint, bigint, bigint) IS
'Marked tracks with an id above p_after, at most p_most, in order of id; columns of _track_row, for COPY.';

CREATE OR REPLACE FUNCTION conflictdb_internal._begin_pieces(
    p_scene_id bigint, p_is_first boolean, p_is_full boolean, OUT srid integer, OUT is_compared boolean
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
BEGIN
    PERFORM _require_snapshot();
    IF p_is_first THEN
        -- The commit of the second transaction flushes this one to disk too. After a crash in between neither has
        -- happened, and the marks remain.
        PERFORM set_config('synchronous_commit', 'off', true);
    END IF;
    -- COPY cannot write to a table whose row-level security applies to the caller (93_row_security.sql).
    is_compared := p_is_full AND EXISTS (SELECT FROM piece p WHERE p.scene_id = p_scene_id)
                   OR row_security_active('piece');
    IF is_compared THEN
        DROP TABLE IF EXISTS pg_temp.made_piece;
        CREATE TEMPORARY TABLE made_piece ON COMMIT DROP AS SELECT p.* FROM piece p WITH NO DATA;
    ELSE
        -- "+ 0" prevents use of the index on scene_id: for a new scene the planner expects few pieces and would compare
        -- every mark with every piece.
        DELETE FROM piece p
            USING (SELECT DISTINCT c.scene_id, c.object_kind, c.object_id FROM change c
                   WHERE c.scene_id = p_scene_id) marked
            WHERE p.object_kind = marked.object_kind AND p.object_id = marked.object_id
              AND p.scene_id + 0 = marked.scene_id;
    END IF;
    UPDATE change c SET is_covered = true WHERE c.scene_id = p_scene_id AND NOT c.is_covered;
    SELECT _plane_srid(_plane(s.motion, s.earth, s.centre_lon, s.centre_lat)) INTO srid
        FROM scene s WHERE s.scene_id = p_scene_id;
END
$$;
COMMENT ON FUNCTION _begin_pieces(bigint, boolean, boolean) IS
'Deletes the pieces of all marked objects of a scene and covers the marks; returns the SRID of the plane. The new '
'pieces must follow in the same transaction. p_is_first: this is the first of two transactions. If is_compared is '
'returned (all pieces are recomputed, or row-level security is active), it deletes none: copy the new pieces into the '
'temporary table made_piece and call _compare_pieces.';

CREATE OR REPLACE FUNCTION conflictdb_internal._pieces_of(p_row piece) RETURNS SETOF piece
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Without the arrays of bundles, which a CTE would copy.
    SELECT
        /* piece columns: (p_row).NAME but part = n.part but hull = n.hull
           but span = CASE WHEN (p_row).cuts IS NULL THEN (p_row).span
                           ELSE tstzrange((p_row).cuts[n.nr], (p_row).cuts[n.nr + 1],
                                          CASE WHEN n.nr < cardinality((p_row).parts) OR upper_inc((p_row).span)
                                               THEN '[]' ELSE '[)' END) END
           but shape = coalesce(n.shape, (p_row).shape) but pieces = 1 but parts = NULL::TYPE but hulls = NULL::TYPE
           but shapes = NULL::TYPE but cuts = NULL::TYPE but leg_times = NULL::TYPE but legs = NULL::TYPE */
        (p_row).piece_id, (p_row).scene_id, (p_row).object_kind, (p_row).object_id, (p_row).version, n.part,
        (p_row).turn, n.hull,
        CASE WHEN (p_row).cuts IS NULL THEN (p_row).span ELSE tstzrange((p_row).cuts[n.nr], (p_row).cuts[n.nr + 1], CASE
            WHEN n.nr < cardinality((p_row).parts) OR upper_inc((p_row).span) THEN '[]' ELSE '[)' END) END,
        (p_row).floor_m, (p_row).ceiling_m, coalesce(n.shape, (p_row).shape), (p_row).leg_start, (p_row).leg_end,
        (p_row).start_lon_deg, (p_row).start_lat_deg, (p_row).end_lon_deg, (p_row).end_lat_deg, (p_row).bearing_deg,
        (p_row).shape_to, 1, NULL::integer[], NULL::geometry, NULL::geometry, NULL::timestamptz[], NULL::timestamptz[],
        NULL::double precision[], (p_row).climb, (p_row).class_number, (p_row).owner_number
        /* end */
    FROM ROWS FROM (unnest(coalesce((p_row).parts, ARRAY[(p_row).part])),
                    ST_Dump(coalesce((p_row).hulls, (p_row).hull)), ST_Dump((p_row).shapes))
         WITH ORDINALITY n (part, hull_path, hull, shape_path, shape, nr);
END;
COMMENT ON FUNCTION _pieces_of(piece) IS
'Returns the pieces of a row of table piece, without their motion: itself, or all pieces of a bundle. Inlined into '
'queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._widened(p_span tstzrange, p_by_s double precision) RETURNS tstzrange
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_by_s = 0 OR isempty(p_span) THEN p_span
                ELSE tstzrange(lower(p_span) - make_interval(secs => p_by_s),
                               upper(p_span) + make_interval(secs => p_by_s),
                               CASE WHEN upper_inc(p_span) THEN '[]' ELSE '[)' END) END;
END;
COMMENT ON FUNCTION _widened(tstzrange, double precision) IS
'A span of a piece, so many seconds longer at both ends: another span meets it exactly if the two have instants that '
'close. Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shared_span(
    p_a tstzrange, p_b tstzrange, p_within_s double precision
) RETURNS tstzrange
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT range_merge(p_a * _widened(p_b, p_within_s), p_b * _widened(p_a, p_within_s));
END;
COMMENT ON FUNCTION _shared_span(tstzrange, tstzrange, double precision) IS
'The time of two pieces: from the first to the last instant of either that is within so many seconds of the other; '
'with 0 the instants of both.';

CREATE OR REPLACE FUNCTION conflictdb_internal._compare_pieces(p_scene_id bigint) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_changed bigint;
BEGIN
    -- A full join cannot become a nested loop. Geometries are compared by their exact coordinates.
    WITH known AS (
        SELECT p.* FROM (SELECT DISTINCT c.object_kind, c.object_id FROM change c WHERE c.scene_id = p_scene_id) d
        CROSS JOIN LATERAL (SELECT p.* FROM piece p
                            WHERE p.object_kind = d.object_kind AND p.object_id = d.object_id
                              AND p.scene_id + 0 = p_scene_id OFFSET 0) p
    ), difference AS MATERIALIZED (
        SELECT k.piece_id, m.place
        FROM known k FULL JOIN (SELECT m.ctid AS place, m.* FROM pg_temp.made_piece m) m
            USING (object_kind, object_id, part, turn)
        WHERE (
            /* piece content: k.NAME */
            k.object_kind, k.object_id, k.version, k.part, k.turn, k.hull, k.span, k.floor_m, k.ceiling_m, k.shape,
            k.leg_start, k.leg_end, k.start_lon_deg, k.start_lat_deg, k.end_lon_deg, k.end_lat_deg, k.bearing_deg,
            k.shape_to, k.pieces, k.parts, k.hulls, k.shapes, k.cuts, k.leg_times, k.legs, k.climb, k.class_number,
            k.owner_number
            /* end */
            ) IS DISTINCT FROM (
            /* piece content: m.NAME */
            m.object_kind, m.object_id, m.version, m.part, m.turn, m.hull, m.span, m.floor_m, m.ceiling_m, m.shape,
            m.leg_start, m.leg_end, m.start_lon_deg, m.start_lat_deg, m.end_lon_deg, m.end_lat_deg, m.bearing_deg,
            m.shape_to, m.pieces, m.parts, m.hulls, m.shapes, m.cuts, m.leg_times, m.legs, m.climb, m.class_number,
            m.owner_number
            /* end */
            )
    ), removed AS (
        DELETE FROM piece p USING difference d WHERE p.piece_id = d.piece_id
    ), added AS (
        -- Gives new ids: the table has the columns of piece.
        INSERT INTO piece OVERRIDING USER VALUE
            SELECT m.*
            FROM difference d JOIN pg_temp.made_piece m ON m.ctid = d.place
    )
    SELECT count(*) INTO v_changed FROM difference;
    RETURN v_changed;
END
$$;
COMMENT ON FUNCTION _compare_pieces(bigint) IS
'Replaces the pieces of marked objects that differ from made_piece and keeps equal ones; returns the number of rows '
'that differ.';

CREATE OR REPLACE FUNCTION conflictdb_internal._end_pieces(p_scene_id bigint, p_changed bigint) RETURNS void
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    -- Replaces a foreign key, which would double the cost of writing a piece: removal of the scene waits for this
    -- transaction, or came first.
    PERFORM FROM scene s WHERE s.scene_id = p_scene_id FOR KEY SHARE;
    -- Outdated statistics could plan the next joins for an empty table.
    IF p_changed > (SELECT 0.1 * c.reltuples FROM pg_class c WHERE c.oid = 'piece'::regclass) THEN
        ANALYZE piece;
    END IF;
END
$$;
COMMENT ON FUNCTION _end_pieces(bigint, bigint) IS
'Locks the scene against removal until the transaction ends, and runs ANALYZE after many pieces changed. Runs as its '
'owner, because both need its rights. Restricted to the given scene, which it does not change.';
