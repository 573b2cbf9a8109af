-- Stage 2, intersection: do the swept pieces meet in space, and where? May over-report, never misses (see stage 1).

CREATE OR REPLACE FUNCTION _find_intersections(p_scene_id bigint, p_regions boolean) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET client_min_messages = warning AS $$
BEGIN
    DROP TABLE IF EXISTS pg_temp.intersecting;
    ANALYZE pg_temp.candidate;
    -- Regions cost ten times the test: only for pairs that move, and only if a later stage asks.
    EXECUTE format($q$
        CREATE TEMPORARY TABLE intersecting ON COMMIT DROP AS
        SELECT c.a_piece_id, c.b_piece_id,
               CASE WHEN %L AND c.moves
                    -- In an order of the hulls' own: the last digits must not depend on the database's numbering.
                    THEN ST_Intersection(least(c.a_hull, c.b_hull), greatest(c.a_hull, c.b_hull)) END AS region
        FROM (
            SELECT c.a_piece_id, c.b_piece_id, a.hull AS a_hull, b.hull AS b_hull,
                   a.object_kind = 1 OR b.object_kind = 1 AS moves
            FROM pg_temp.candidate c
            JOIN piece a ON a.piece_id = c.a_piece_id
            JOIN piece b ON b.piece_id = c.b_piece_id
            -- Candidates first: ST_Intersects brings an index condition of its own, by which the planner would join the
            -- pieces of all scenes, in planes that cannot be compared.
            OFFSET 0
        ) c
        WHERE ST_Intersects(c.a_hull, c.b_hull)$q$, p_regions);
    RETURN (SELECT count(*) FROM pg_temp.intersecting);
END
$$;
COMMENT ON FUNCTION _find_intersections(bigint, boolean) IS
'Stage 2: fills the temporary table intersecting with the candidates whose hulls meet, and with the region (plane) '
'where they do if p_regions and one of them moves; returns how many.';

CREATE OR REPLACE FUNCTION _intersecting_pieces(
    p_scene_id bigint, OUT piece_id bigint, OUT rank bigint, OUT object_kind smallint, OUT object_id bigint,
    OUT version bigint, OUT part integer, OUT turn smallint, OUT span_start timestamptz, OUT span_end timestamptz,
    OUT end_inclusive boolean, OUT floor_m double precision, OUT ceiling_m double precision, OUT leg_start timestamptz,
    OUT leg_end timestamptz, OUT start_lon_deg double precision, OUT start_lat_deg double precision,
    OUT end_lon_deg double precision, OUT end_lat_deg double precision, OUT bearing_deg double precision,
    OUT shape bytea, OUT shape_to bytea
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN QUERY
        SELECT p.piece_id,
               row_number() OVER (ORDER BY p.object_kind, coalesce(a.key, t.key) COLLATE "C", p.part, p.turn DESC),
               p.object_kind, p.object_id, p.version, p.part, p.turn,
               coalesce(lower(p.span), '-infinity'), coalesce(upper(p.span), 'infinity'), upper_inc(p.span),
               p.floor_m, p.ceiling_m, coalesce(p.leg_start, '1970-01-01 00:00+00'),
               coalesce(p.leg_end, '1970-01-01 00:00+00'), coalesce(p.start_lon_deg, 0), coalesce(p.start_lat_deg, 0),
               coalesce(p.end_lon_deg, 0), coalesce(p.end_lat_deg, 0), coalesce(p.bearing_deg, 0),
               ST_AsBinary(p.shape, 'NDR'), coalesce(ST_AsBinary(p.shape_to, 'NDR'), '')
        FROM (SELECT i.a_piece_id AS piece_id FROM pg_temp.intersecting i
              UNION SELECT i.b_piece_id FROM pg_temp.intersecting i) used
        JOIN piece p USING (piece_id)
        LEFT JOIN area a ON p.object_kind = 0 AND a.area_id = p.object_id AND a.scene_id = p.scene_id
                        AND a.first_version <= p.version
        LEFT JOIN track t ON p.object_kind = 1 AND t.track_id = p.object_id AND t.scene_id = p.scene_id
                         AND t.first_version <= p.version;
END
$$;
COMMENT ON FUNCTION _intersecting_pieces(bigint) IS
'The pieces of the intersecting pairs, without nulls, for COPY. Rank orders them by kind, key, part and turn, so that '
'results do not depend on ids. Areas have no motion: epoch and 0. shape_to is empty where nothing changes.';

CREATE OR REPLACE FUNCTION _intersecting_pairs(OUT a_piece_id bigint, OUT b_piece_id bigint) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN QUERY SELECT i.a_piece_id, i.b_piece_id FROM pg_temp.intersecting i;
END
$$;
COMMENT ON FUNCTION _intersecting_pairs() IS 'The intersecting pairs of pieces, for COPY.';

CREATE OR REPLACE FUNCTION _intersecting_regions(OUT a_piece_id bigint, OUT b_piece_id bigint, OUT region bytea)
RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN QUERY SELECT i.a_piece_id, i.b_piece_id, coalesce(ST_AsBinary(i.region, 'NDR'), ''::bytea)
                 FROM pg_temp.intersecting i;
END
$$;
COMMENT ON FUNCTION _intersecting_regions() IS
'The intersecting pairs of pieces with their region as WKB (plane), empty where it was not computed, for COPY.';
