-- What the page of `conflictdb map` asks beside tiles (82_tiles.sql): whole lists of a scene, each in one answer.

CREATE OR REPLACE FUNCTION _map_conflicts(p_scene text) RETURNS TABLE (
    conflict_id bigint, a_key text, b_key text, verdict text, starts_s double precision[], ends_s double precision[],
    time_error_s double precision, lon_deg double precision, lat_deg double precision, west_deg double precision,
    south_deg double precision, east_deg double precision, north_deg double precision, is_current boolean,
    acknowledged_by text, acknowledged_at timestamptz, acknowledged_for text, acknowledged_until timestamptz
)
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    SELECT c.conflict_id, c.a_key, c.b_key, c.verdict,
           ARRAY(SELECT extract(epoch FROM lower(p))::double precision FROM unnest(c.periods) p),
           ARRAY(SELECT extract(epoch FROM upper(p))::double precision FROM unnest(c.periods) p),
           c.time_error_s, ST_X(c.first_contact_point), ST_Y(c.first_contact_point),
           ST_XMin(c.region), ST_YMin(c.region), ST_XMax(c.region), ST_YMax(c.region), c.is_current,
           c.acknowledged_by, c.acknowledged_at, c.acknowledged_for, c.acknowledged_until
    FROM conflicts c WHERE c.scene = (SELECT s.name FROM scene s WHERE s.scene_id = _scene_id(p_scene))
    ORDER BY c.first_contact NULLS FIRST, c.a_key, c.b_key;
END;
COMMENT ON FUNCTION _map_conflicts(text) IS
'The conflicts of a scene for a list and a timeline, earliest first: starts and ends of periods in Unix seconds (null: '
'no limit), first contact and the box of the region in degrees.';

CREATE OR REPLACE FUNCTION _map_areas(p_scene text) RETURNS TABLE (
    area_id bigint, key text, name text, floor_m double precision, ceiling_m double precision,
    start_s double precision, end_s double precision,
    west_deg double precision, south_deg double precision, east_deg double precision, north_deg double precision
)
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    SELECT a.area_id, a.key, a.name, a.floor_m, a.ceiling_m,
           nullif(extract(epoch FROM lower(a.active_span)), '-infinity')::double precision,
           nullif(extract(epoch FROM upper(a.active_span)), 'infinity')::double precision,
           ST_XMin(a.footprint), ST_YMin(a.footprint), ST_XMax(a.footprint), ST_YMax(a.footprint)
    FROM area a WHERE a.scene_id = _scene_id(p_scene) ORDER BY a.area_id;
END;
COMMENT ON FUNCTION _map_areas(text) IS
'The areas of a scene: when (Unix seconds, null: no limit) and in what box (degrees, not wrapped) they are.';

CREATE OR REPLACE FUNCTION _map_overview(p_scene text) RETURNS bytea
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    -- Half a pixel where the areas are 16 times as high as a screen of 1,000 pixels. What is wider than plain_deg bends
    -- by more than that (_tile_measures has how).
    WITH place AS MATERIALIZED (
        SELECT s.scene_id, _plane(s.motion, s.earth, s.centre_lon, s.centre_lat) AS plane
        FROM scene s WHERE s.scene_id = _scene_id(p_scene)
    ), measure AS MATERIALIZED (
        SELECT p.scene_id, p.plane, m.unit_deg,
               CASE WHEN p.plane IN ('wgs84', 'sphere')
                    THEN least(20, sqrt(m.unit_deg * 111000 / 2)) ELSE least(5, sqrt(m.unit_deg * 111000 / 300)) END
                   AS plain_deg
        FROM place p CROSS JOIN LATERAL (
            SELECT greatest((max(ST_YMax(a.footprint)) - min(ST_YMin(a.footprint))) / 32768, 1e-7) AS unit_deg
            FROM area a WHERE a.scene_id = p.scene_id) m
    )
    SELECT string_agg(int8send(a.area_id) || ST_AsBinary(ST_Multi(CASE
               WHEN NOT _is_plain(Box2D(a.footprint)::box3d, m.plain_deg, 180)
                   THEN ST_Simplify(_drawn(a.footprint, m.plane), m.unit_deg, true)
               WHEN ST_NPoints(a.footprint) > 16 THEN ST_Simplify(a.footprint, m.unit_deg, true)
               ELSE a.footprint END), 'NDR'), ''::bytea)
    FROM measure m JOIN area a USING (scene_id);
END;
COMMENT ON FUNCTION _map_overview(text) IS
'The outlines of the areas of a scene as they are seen from afar: of each its number (eight bytes, the highest first) '
'and a multipolygon, longitude and latitude in degrees, not wrapped, as well-known binary (little-endian); null '
'without any.';

CREATE OR REPLACE FUNCTION _map_tracks(p_scene text) RETURNS TABLE (
    track_id bigint, key text, name text, floor_m double precision, ceiling_m double precision,
    path bytea, outline bytea, grow_mps double precision, outlines bytea
)
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    SELECT t.track_id, t.key, t.name, t.floor_m, t.ceiling_m, ST_AsBinary(t.path, 'NDR'), ST_AsBinary(t.outline, 'NDR'),
           t.grow_mps, ST_AsBinary(t.outlines, 'NDR')
    FROM track t WHERE t.scene_id = _scene_id(p_scene) ORDER BY t.track_id;
END;
COMMENT ON FUNCTION _map_tracks(text) IS
'The tracks of a scene: path (longitude, latitude, Unix seconds) and outlines (metres) as well-known binary.';

CREATE OR REPLACE FUNCTION _map_shapes(p_scene text, p_keys text[]) RETURNS TABLE (
    layer text, feature_id bigint, key text, shape text
)
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    SELECT 'areas', a.area_id, a.key, ST_AsGeoJSON(a.footprint, 6) FROM map_areas a
    WHERE a.scene = p_scene AND (p_keys IS NULL OR a.key = ANY (p_keys))
    UNION ALL
    SELECT 'tracks', t.track_id, t.key, ST_AsGeoJSON(t.path, 6) FROM map_tracks t
    WHERE t.scene = p_scene AND (p_keys IS NULL OR t.key = ANY (p_keys))
    UNION ALL
    SELECT 'conflicts', c.conflict_id, NULL, ST_AsGeoJSON(c.region, 6) FROM conflicts c
    WHERE c.scene = p_scene AND p_keys IS NULL AND NOT ST_IsEmpty(c.region);
END;
COMMENT ON FUNCTION _map_shapes(text, text[]) IS
'GeoJSON of areas, paths and conflict regions of a scene, as maps show them; or of its objects of some keys.';

CREATE OR REPLACE FUNCTION _map_may_acknowledge() RETURNS boolean
LANGUAGE sql STABLE
BEGIN ATOMIC
    SELECT has_function_privilege('acknowledge(text, text, text, text, timestamptz)'::regprocedure, 'EXECUTE')
           AND has_any_column_privilege('acknowledgement'::regclass, 'INSERT')
           AND NOT pg_is_in_recovery();
END;
COMMENT ON FUNCTION _map_may_acknowledge() IS 'Whether the current user may acknowledge conflicts.';
