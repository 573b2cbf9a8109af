-- Lists for the page of `conflictdb map`, besides its tiles (82_tiles.sql): each a whole scene in one answer.

CREATE OR REPLACE FUNCTION conflictdb_internal._map_conflicts(p_scene text) RETURNS TABLE (head text, numbers bytea)
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    -- The aggregates receive the rows in order, directly from the subquery with ORDER BY.
    SELECT json_build_object(
               'a', coalesce(json_agg(c.a_key), '[]'), 'b', coalesce(json_agg(c.b_key), '[]'),
               'moving', coalesce(string_agg(c.moving, ''), ''),
               'possible', coalesce(json_agg(c.nth) FILTER (WHERE c.certainty = 'may'), '[]'),
               'acknowledged', coalesce(
                   json_agg(json_build_array(c.nth, c.acknowledged_by, c.acknowledged_for, c.acknowledged_until))
                   FILTER (WHERE c.acknowledged_by IS NOT NULL), '[]'))::text,
           coalesce(string_agg(c.numbers, ''::bytea), '')
    FROM (SELECT row_number() OVER (ORDER BY f.first_contact NULLS FIRST, f.a_key, f.b_key) - 1 AS nth,
                 f.a_key, f.b_key, f.acknowledged_by, f.acknowledged_for, f.acknowledged_until, f.certainty,
                 ((f.a_kind = 'track')::integer + (f.b_kind = 'track')::integer)::text AS moving,
                 int8send(f.conflict_id)
                 || int2send((CASE f.verdict WHEN 'conflict' THEN 0 WHEN 'grazing' THEN 1 ELSE 2 END)::smallint)
                 || int2send(f.is_current::integer::smallint) || float8send(f.time_error_s)
                 || float8send(coalesce(ST_X(f.first_contact_point), 'NaN'))
                 || float8send(coalesce(ST_Y(f.first_contact_point), 'NaN'))
                 || float4send(coalesce(ST_XMin(r.box), 'NaN')::real)
                 || float4send(coalesce(ST_YMin(r.box), 'NaN')::real)
                 || float4send(coalesce(ST_XMax(r.box), 'NaN')::real)
                 || float4send(coalesce(ST_YMax(r.box), 'NaN')::real)
                 || (SELECT int4send(count(*)::integer) || string_agg(
                                float8send(coalesce(date_part('epoch', lower(p)), '-infinity'))
                                || float8send(coalesce(date_part('epoch', upper(p)), 'infinity')), ''::bytea)
                     FROM unnest(f.periods) p) AS numbers
          FROM conflicts f CROSS JOIN LATERAL (SELECT Box2D(f.region)::box3d AS box) r
          WHERE f.scene = (SELECT s.name FROM scene s WHERE s.scene_id = _scene_or_branch(p_scene))
          ORDER BY nth) c;
END;
COMMENT ON FUNCTION _map_conflicts(text) IS
'Conflicts of a scene for a list and a timeline, earliest first. head: JSON with keys a and b, how many of both '
'are tracks (moving, a digit each), the indexes of those that tolerances make possible and, for acknowledged '
'conflicts, [index from 0, user, reason, expiry]. numbers, big-endian, for each conflict: conflict_id (8 bytes), '
'verdict (2: 0 conflict, 1 grazing, 2 unresolved), is_current (2), time error in seconds (8), first contact in degrees '
'(2 x 8, NaN: not computed), west, south, east, north of the region (4 each), number of periods (4), and their starts '
'and ends in Unix seconds (8 each).';

CREATE OR REPLACE FUNCTION conflictdb_internal._map_areas(p_scene text) RETURNS TABLE (
    area_id bigint, key text, name text, floor_m double precision, ceiling_m double precision,
    start_s double precision, end_s double precision, spans_s double precision[],
    west_deg double precision, south_deg double precision, east_deg double precision, north_deg double precision,
    inside_lon_deg double precision, inside_lat_deg double precision
)
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    WITH place AS MATERIALIZED (
        SELECT s.scene_id, _plane(s.motion, s.earth, s.centre_lon, s.centre_lat) AS plane
        FROM scene s WHERE s.scene_id = _scene_or_branch(p_scene)
    )
    SELECT a.area_id, a.key, a.name, a.floor_m, a.ceiling_m,
           nullif(extract(epoch FROM lower(_active_within(a.active_span, a.activations))), '-infinity')
               ::double precision,
           nullif(extract(epoch FROM upper(_active_within(a.active_span, a.activations))), 'infinity')
               ::double precision,
           (SELECT array_agg(nullif(nullif(extract(epoch FROM e.at), '-infinity'), 'infinity')::double precision
                             ORDER BY lower(s.span) NULLS FIRST, e.nth)
            FROM unnest(a.activations) s (span)
            CROSS JOIN LATERAL (VALUES (1, lower(s.span)), (2, upper(s.span))) e (nth, at)),
           ST_XMin(a.footprint), ST_YMin(a.footprint), ST_XMax(a.footprint), ST_YMax(a.footprint),
           ST_X(i.place), ST_Y(i.place)
    FROM place p CROSS JOIN LATERAL _seen_areas(p.scene_id) a
    -- As drawn: edges of a wide area curve.
    CROSS JOIN LATERAL (
        SELECT CASE WHEN greatest(ST_XMax(a.footprint) - ST_XMin(a.footprint),
                                  ST_YMax(a.footprint) - ST_YMin(a.footprint)) <= 1 THEN a.footprint
                    ELSE _drawn(a.footprint, p.plane) END AS shape
        OFFSET 0) d
    CROSS JOIN LATERAL (
        SELECT CASE WHEN NOT ST_Intersects(d.shape, ST_SetSRID(ST_Point(
                        (ST_XMin(a.footprint) + ST_XMax(a.footprint)) / 2,
                        (ST_YMin(a.footprint) + ST_YMax(a.footprint)) / 2), ST_SRID(d.shape)))
                    THEN ST_PointOnSurface(d.shape) END AS place
        OFFSET 0) i
    ORDER BY a.area_id;
END;
COMMENT ON FUNCTION _map_areas(text) IS
'Areas of a scene: span (Unix seconds, null: no limit), starts and ends of activations in turn (null: active for the '
'whole span), bounding box (degrees, not wrapped) and, if its middle is '
'outside the area, a point inside.';

CREATE OR REPLACE FUNCTION conflictdb_internal._map_live(p_scene text) RETURNS text
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    -- A branch has no positions.
    SELECT json_build_object(
        'tracks', (SELECT coalesce(json_agg(json_build_object(
                              'key', l.key, 'state', l.state, 'late_from_s', l.late_from_s, 'late_to_s', l.late_to_s,
                              'off_m', l.off_m, 't', extract(epoch FROM l.instant), 'lon', ST_X(l.place),
                              'lat', ST_Y(l.place)) ORDER BY l.key), '[]')
                   FROM live_state l WHERE l.scene_id = s.scene_id),
        'alarms', (SELECT coalesce(json_agg(json_build_object(
                              'alarm_id', c.alarm_id, 'key', c.key, 'other_key', nullif(c.other_key, ''),
                              'verdict', c.verdict, 'reason', c.reason, 'first', extract(epoch FROM c.first_contact),
                              'lon', ST_X(c.place), 'lat', ST_Y(c.place), 'acknowledged_by', c.acknowledged_by)
                              ORDER BY c.acknowledged_by IS NOT NULL, c.verdict = 'may', c.first_contact, c.key),
                              '[]')
                   FROM live_conflict c WHERE c.scene_id = s.scene_id))::text
    FROM (SELECT _scene_or_branch(p_scene) AS scene_id) s;
END;
COMMENT ON FUNCTION _map_live(text) IS
'JSON of the tracks of a scene with positions and of its alarms, as in the views live and live_conflicts; times in '
'Unix seconds. Alarms that are acknowledged, and those that are only possible, come last.';

CREATE OR REPLACE FUNCTION conflictdb_internal._map_overview(p_scene text) RETURNS bytea
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    -- unit_deg: half a pixel if the areas are 16 times as high as a screen of 1,000 pixels. Areas wider than plain_deg
    -- curve by more than that (see _tile_measures).
    WITH place AS MATERIALIZED (
        SELECT s.scene_id, _plane(s.motion, s.earth, s.centre_lon, s.centre_lat) AS plane
        FROM scene s WHERE s.scene_id = _scene_or_branch(p_scene)
    ), measure AS MATERIALIZED (
        SELECT p.scene_id, p.plane, m.unit_deg,
               CASE WHEN p.plane IN ('wgs84', 'sphere')
                    THEN least(20, sqrt(m.unit_deg * 111000 / 2)) ELSE least(5, sqrt(m.unit_deg * 111000 / 300)) END
                   AS plain_deg
        FROM place p CROSS JOIN LATERAL (
            SELECT greatest((max(ST_YMax(a.footprint)) - min(ST_YMin(a.footprint))) / 32768, 1e-7) AS unit_deg
            FROM _seen_areas(p.scene_id) a) m
    )
    SELECT string_agg(int8send(a.area_id) || ST_AsBinary(ST_Multi(CASE
               WHEN NOT _is_plain(Box2D(a.footprint)::box3d, m.plain_deg, 180)
                   THEN ST_Simplify(_drawn(a.footprint, m.plane), m.unit_deg, true)
               WHEN ST_NPoints(a.footprint) > 16 THEN ST_Simplify(a.footprint, m.unit_deg, true)
               ELSE a.footprint END), 'NDR'), ''::bytea)
    FROM measure m CROSS JOIN LATERAL _seen_areas(m.scene_id) a;
END;
COMMENT ON FUNCTION _map_overview(text) IS
'Simplified outlines of all areas of a scene: for each area_id (8 bytes, big-endian) and a multipolygon, longitude and '
'latitude in degrees, not wrapped, as WKB (little-endian); null if there are no areas.';

CREATE OR REPLACE FUNCTION conflictdb_internal._map_tracks(p_scene text) RETURNS TABLE (
    track_id bigint, key text, name text, floor_m double precision, ceiling_m double precision,
    path bytea, outline bytea, grow_mps double precision, outlines bytea, departures_s double precision[]
)
LANGUAGE sql STABLE CALLED ON NULL INPUT
BEGIN ATOMIC
    SELECT t.track_id, t.key, t.name, t.floor_m, t.ceiling_m, ST_AsBinary(t.path, 'NDR'), ST_AsBinary(t.outline, 'NDR'),
           t.grow_mps, ST_AsBinary(t.outlines, 'NDR'),
           -- No voyages are an empty array.
           CASE WHEN t.departures IS NOT NULL
                THEN ARRAY(SELECT extract(epoch FROM d.at)::double precision FROM unnest(t.departures) d (at)) END
    FROM _seen_tracks(_scene_or_branch(p_scene)) t ORDER BY t.track_id;
END;
COMMENT ON FUNCTION _map_tracks(text) IS
'Tracks of a scene: path (longitude, latitude, Unix seconds) and outlines (metres) as WKB (little-endian), and the '
'departures of its voyages (Unix seconds, in order; null: one voyage, as the path says).';

CREATE OR REPLACE FUNCTION conflictdb_internal._map_shapes(p_scene text, p_keys text[]) RETURNS TABLE (
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
'GeoJSON of areas, paths and conflict regions of a scene as drawn on maps; p_keys: only these objects, no regions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._map_may_acknowledge() RETURNS boolean
LANGUAGE sql STABLE
BEGIN ATOMIC
    SELECT has_function_privilege('acknowledge(text, text, text, text, timestamptz, text)'::regprocedure, 'EXECUTE')
           AND has_any_column_privilege('acknowledgement'::regclass, 'INSERT')
           AND NOT pg_is_in_recovery();
END;
COMMENT ON FUNCTION _map_may_acknowledge() IS 'Whether the current user may acknowledge conflicts.';
