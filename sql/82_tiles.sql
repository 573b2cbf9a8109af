-- Vector tiles (Mapbox Vector Tile 2.1) in Web Mercator (EPSG:3857), for pg_tileserv and martin.
--
-- The index of pieces finds the objects of a tile, as their hulls contain what they sweep, with copies across the
-- antimeridian. Objects that wait for detection have no pieces, or old ones, and are all checked by their boxes. Shapes
-- come from the tables area and track.

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_time(p_params json, p_name text) RETURNS timestamptz
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_text text := p_params ->> p_name;
BEGIN
    -- Independent of the session's DateStyle and TimeZone.
    IF v_text !~ '^\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d{1,6})?)?(Z|[+-]\d\d(:?\d\d)?)$' THEN
        FOUND := _raise('ZC003', 'query_params', p_name,
                        format('must be an instant like 2026-06-01T10:00:00Z; got %L', v_text), 'tile_instant',
                        'In an address, write Z, or + as %2B.');
    END IF;
    RETURN v_text::timestamptz;
END
$$;
COMMENT ON FUNCTION _tile_time(json, text) IS
'Reads an instant from the parameters of a tile; null if absent. Raises ZC003 unless it is ISO 8601 with an offset.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_height(p_params json, p_name text) RETURNS double precision
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_text text := p_params ->> p_name;
BEGIN
    IF v_text !~ '^[+-]?\d{1,15}(\.\d{1,15})?(e[+-]?\d{1,2})?$' THEN
        FOUND := _raise('ZC004', 'query_params', p_name, format('must be a number of metres; got %L', v_text),
                        'tile_height');
    END IF;
    RETURN v_text::double precision;
END
$$;
COMMENT ON FUNCTION _tile_height(json, text) IS
'Reads a height (metres) from the parameters of a tile; null if absent. Raises ZC004 unless it is a number.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_params(
    p_z integer, p_x integer, p_y integer, p_params json,
    OUT scene_id bigint, OUT scene text, OUT motion text, OUT earth text, OUT plane text, OUT span tstzrange,
    OUT instant timestamptz, OUT verdicts text[], OUT floor_m double precision, OUT ceiling_m double precision
)
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'query_params';
    c_zoom_max CONSTANT integer := 30;
    v_name text;
    v_from timestamptz;
    v_to timestamptz;
BEGIN
    IF (p_z BETWEEN 0 AND c_zoom_max) IS NOT TRUE THEN
        FOUND := _raise('ZC005', 'tile', 'z', format('must be from 0 to %s; got %s', c_zoom_max,
                                                     coalesce(p_z::text, 'null')), 'tile_known');
    END IF;
    IF (p_x BETWEEN 0 AND (1 << p_z) - 1 AND p_y BETWEEN 0 AND (1 << p_z) - 1) IS NOT TRUE THEN
        FOUND := _raise('ZC005', 'tile', 'x, y',
                        format('must be from 0 to %s at zoom %s; got %s, %s', (1 << p_z) - 1, p_z,
                               coalesce(p_x::text, 'null'), coalesce(p_y::text, 'null')), 'tile_known');
    END IF;
    IF json_typeof(p_params) IS DISTINCT FROM 'object' THEN
        FOUND := _raise('ZC009', c_who, 'scene', 'must be given, in a JSON object', 'tile_scene_given');
    END IF;
    SELECT k INTO v_name FROM json_object_keys(p_params) k
        WHERE k <> ALL (ARRAY['scene', 'at', 'from', 'to', 'verdict', 'floor_m', 'ceiling_m']) LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC009', c_who, v_name,
                        'is not known; known: scene, at, from, to, verdict, floor_m, ceiling_m', 'tile_param_known');
    END IF;
    scene := p_params ->> 'scene';
    IF scene IS NULL THEN
        FOUND := _raise('ZC009', c_who, 'scene', 'must be given', 'tile_scene_given');
    END IF;
    scene_id := _scene_or_branch(scene);
    SELECT s.motion, s.earth, _plane(s.motion, s.earth, s.centre_lon, s.centre_lat) INTO motion, earth, plane
        FROM scene s WHERE s.scene_id = _tile_params.scene_id;
    instant := _tile_time(p_params, 'at');
    v_from := _tile_time(p_params, 'from');
    v_to := _tile_time(p_params, 'to');
    IF instant IS NOT NULL AND num_nonnulls(v_from, v_to) > 0 OR v_to < v_from THEN
        FOUND := _raise('ZC003', c_who, 'at, from, to', 'must be one instant, or two in order', 'tile_span');
    END IF;
    span := tstzrange(coalesce(instant, v_from), coalesce(instant, v_to), '[]');
    PERFORM _warn_if_beyond_horizon(scene, span);
    verdicts := string_to_array(p_params ->> 'verdict', ',');
    SELECT v INTO v_name FROM unnest(verdicts) v WHERE v <> ALL (ARRAY['conflict', 'grazing', 'unresolved']) LIMIT 1;
    IF FOUND OR verdicts = '{}' THEN
        FOUND := _raise('ZC009', c_who, 'verdict',
                        format('must be of conflict, grazing, unresolved, with commas between; got %L',
                               p_params ->> 'verdict'), 'tile_verdict_known');
    END IF;
    floor_m := _tile_height(p_params, 'floor_m');
    ceiling_m := _tile_height(p_params, 'ceiling_m');
    PERFORM _check_heights(c_who, floor_m, ceiling_m);
END
$$;
COMMENT ON FUNCTION _tile_params(integer, integer, integer, json) IS
'Reads the parameters of a tile. Raises ZC005 for a tile that does not exist, and ZC003, ZC004, ZC009 or ZC010 for '
'missing, unknown or invalid parameters.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_bounds(p_z integer, p_x integer, p_y integer) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- With a margin of 64 of 4096 units, as in ST_AsMVTGeom below.
    SELECT ST_Expand(b.bounds, (ST_XMax(b.bounds) - ST_XMin(b.bounds)) * 64 / 4096)
    FROM (SELECT ST_TileEnvelope(p_z, p_x, p_y) AS bounds OFFSET 0) b;
END;
COMMENT ON FUNCTION _tile_bounds(integer, integer, integer) IS
'Bounds of a tile with its margin (metres, EPSG:3857); may extend across the antimeridian.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_degrees(p_z integer, p_x integer, p_y integer) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_MakeEnvelope(
        degrees(ST_XMin(b.bounds) / _wgs84_m()::double precision),
        degrees(atan(sinh(ST_YMin(b.bounds) / _wgs84_m()::double precision))),
        degrees(ST_XMax(b.bounds) / _wgs84_m()::double precision),
        degrees(atan(sinh(ST_YMax(b.bounds) / _wgs84_m()::double precision))), 4326)
    FROM (SELECT _tile_bounds(p_z, p_x, p_y) AS bounds OFFSET 0) b;
END;
COMMENT ON FUNCTION _tile_degrees(integer, integer, integer) IS
'Bounds of a tile with its margin, longitude and latitude (degrees, not wrapped).';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_windows(
    p_z integer, p_x integer, p_y integer, p_plane text
) RETURNS SETOF geometry
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE ROWS 3 SET search_path FROM CURRENT AS $$
DECLARE
    -- Farther from the centre the gnomonic plane stretches without limit; its horizon is at 90.
    c_far_deg CONSTANT double precision := 80;
    v_box geometry := _tile_degrees(p_z, p_x, p_y);
    v_edge geometry;
    v_south double precision;
    v_north double precision;
    v_turn_m double precision := 2 * pi() * _radius_m(p_plane);
BEGIN
    IF p_plane IN ('wgs84', 'sphere') THEN
        v_south := ST_Y(_to_plane(ST_SetSRID(ST_MakePoint(0, ST_YMin(v_box)), 4326), p_plane));
        v_north := ST_Y(_to_plane(ST_SetSRID(ST_MakePoint(0, ST_YMax(v_box)), 4326), p_plane));
        RETURN QUERY
            SELECT ST_MakeEnvelope((ST_XMin(v_box) / 360 + turn) * v_turn_m - 1, v_south - 1,
                                   (ST_XMax(v_box) / 360 + turn) * v_turn_m + 1, v_north + 1, _plane_srid(p_plane))
            FROM generate_series(-1, 1) turn;
        RETURN;
    END IF;
    -- The image of a box without a pole lies within the image of its edge.
    v_edge := ST_Segmentize(ST_ExteriorRing(v_box), greatest(ST_XMax(v_box) - ST_XMin(v_box), 1e-9) / 64);
    IF p_z > 1 AND _from_centre_deg(v_edge, substring(p_plane FROM 'lon_0=([-0-9.]+)')::double precision,
                                    substring(p_plane FROM 'lat_0=([-0-9.]+)')::double precision) < c_far_deg THEN
        v_edge := ST_Envelope(_to_plane(v_edge, p_plane));
        -- Between points of the edge its image bends by less than this fraction of its size.
        RETURN NEXT ST_Expand(v_edge, 1 + 0.05 * greatest(ST_XMax(v_edge) - ST_XMin(v_edge),
                                                          ST_YMax(v_edge) - ST_YMin(v_edge)));
    ELSE
        RETURN NEXT ST_MakeEnvelope(-1e9, -1e9, 1e9, 1e9);
    END IF;
END
$$;
COMMENT ON FUNCTION _tile_windows(integer, integer, integer, text) IS
'Boxes in the plane of a scene (metres) that contain what a tile shows; the whole plane for a tile outside of it.';

CREATE OR REPLACE FUNCTION conflictdb_internal._marked_objects(p_scene_id bigint, p_kind smallint) RETURNS SETOF bigint
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT
SET enable_seqscan = off SET enable_bitmapscan = off SET jit = off -- see _is_current
AS $$
BEGIN
    RETURN QUERY SELECT m.object_id FROM change m WHERE m.scene_id = p_scene_id AND m.object_kind = p_kind;
END
$$;
COMMENT ON FUNCTION _marked_objects(bigint, smallint) IS
'Ids of objects of a kind that wait for detection, once per mark.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_objects(
    p_scene_id bigint, p_kind smallint, p_plane text, p_z integer, p_x integer, p_y integer, p_span tstzrange
) RETURNS SETOF bigint
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- OFFSET 0 forces one index search per window.
    SELECT n.object_id FROM _tile_windows(p_z, p_x, p_y, p_plane) w (box)
    CROSS JOIN unnest(_layers(p_scene_id)) l (scene_id)
    CROSS JOIN LATERAL (SELECT p.object_id FROM piece p
                        WHERE p.scene_id = l.scene_id AND p.hull && w.box AND p.span && p_span
                          AND p.object_kind = p_kind OFFSET 0) n
    UNION
    SELECT m FROM unnest(_layers(p_scene_id)) l (scene_id) CROSS JOIN LATERAL _marked_objects(l.scene_id, p_kind) m;
END;
COMMENT ON FUNCTION _tile_objects(bigint, smallint, text, integer, integer, integer, tstzrange) IS
'Ids of objects of a kind that a tile may show: a superset of those active during a span, with those of its parent '
'that a branch has edited.';

CREATE OR REPLACE FUNCTION conflictdb_internal._drawn(p_geometry geometry, p_plane text) RETURNS geometry
-- Not LANGUAGE sql, nor the next two: inlining would evaluate each step as often as later steps mention it.
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_shape geometry := _to_plane(p_geometry, p_plane);
BEGIN
    -- Edges are straight in the scene's plane. With points 100 km apart another plane deviates by less than a metre.
    IF p_plane IN ('wgs84', 'sphere') THEN
        v_shape := ST_Segmentize(v_shape, 100000);
    END IF;
    RETURN _from_plane(v_shape, p_plane);
END
$$;
COMMENT ON FUNCTION _drawn(geometry, text) IS
'Adds points to long edges of a geometry (longitude and latitude, edges straight in the scene''s plane), so that any '
'map draws it correctly: degrees, not wrapped.';

CREATE OR REPLACE FUNCTION conflictdb_internal._drawn_path(p_path geometry, p_plane text) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF p_plane NOT IN ('wgs84', 'sphere') OR ST_XMax(p_path) - ST_XMin(p_path) <= 180 THEN
        RETURN ST_Multi(_drawn(ST_Force2D(p_path), p_plane));
    END IF;
    -- Each leg goes the shorter way around.
    RETURN (SELECT ST_Multi(ST_CollectionHomogenize(ST_Collect(_wrapped(l.leg))))
            FROM (SELECT _drawn(ST_MakeLine(n.first, ST_Translate(
                             n.last, -360 * (abs(n.turn) > 180)::integer * round(n.turn / 360), 0)), p_plane) AS leg
                  FROM (SELECT ST_Force2D(d.geom) AS first, ST_Force2D(lead(d.geom) OVER o) AS last,
                               ST_X(lead(d.geom) OVER o) - ST_X(d.geom) AS turn
                        FROM ST_DumpPoints(p_path) d WINDOW o AS (ORDER BY d.path[1])) n
                  WHERE n.last IS NOT NULL OFFSET 0) l);
END
$$;
COMMENT ON FUNCTION _drawn_path(geometry, text) IS
'Adds points to long legs of a path, as _drawn does, and splits it at the antimeridian.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shown(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    -- Needs no points near the middle of a gnomonic plane, and fewer elsewhere.
    c_latitude_deg CONSTANT double precision := 75;
    -- The same spacing as in _from_gnomonic.
    c_side_m CONSTANT double precision := 25000;
    v_shape geometry;
BEGIN
    -- Great circles computed on the sphere, without PROJ, which takes milliseconds to parse its string. A geometry
    -- narrower than half a turn does not cross the antimeridian and contains no pole.
    IF p_plane NOT IN ('wgs84', 'sphere') AND ST_XMin(p_geometry) >= -180 AND ST_XMax(p_geometry) <= 180
       AND ST_YMin(p_geometry) >= -c_latitude_deg AND ST_YMax(p_geometry) <= c_latitude_deg
       AND ST_XMax(p_geometry) - ST_XMin(p_geometry) <= 170 THEN
        RETURN ST_Segmentize(ST_Force2D(p_geometry)::geography, c_side_m)::geometry;
    END IF;
    IF ST_Dimension(p_geometry) = 1 THEN
        v_shape := _drawn_path(p_geometry, p_plane);
    ELSE
        v_shape := _drawn(p_geometry, p_plane);
    END IF;
    -- Splitting returns a collection, also for multilines.
    RETURN ST_CollectionExtract(_wrapped(v_shape), ST_Dimension(v_shape) + 1);
END
$$;
COMMENT ON FUNCTION _shown(geometry, text) IS
'A footprint or path (longitude and latitude, straight in the scene''s plane) as a map layer: points on long edges, '
'within +-180 degrees, split at the antimeridian.';

CREATE OR REPLACE FUNCTION conflictdb_internal._on_map(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Inlined: a box of a map program compares all objects of the scene. Edges of up to 0.2 degrees (22 km along a
    -- meridian) at lower latitudes get no point from _drawn near the middle of its plane, and need none farther from
    -- the middle of a gnomonic plane.
    SELECT CASE WHEN p_geometry @ ST_MakeEnvelope(-180, -75, 180, 75, 4326)
                     AND ST_NPoints(ST_Segmentize(p_geometry, 0.2)) = ST_NPoints(p_geometry)
                THEN ST_Force2D(p_geometry) ELSE _shown(p_geometry, p_plane) END;
END;
COMMENT ON FUNCTION _on_map(geometry, text) IS
'As _shown, which a geometry with short edges, away from poles and antimeridian, does not need.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_shape(
    p_geometry geometry, p_z integer, p_x integer, p_y integer
) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_size CONSTANT double precision := _wgs84_m() / _sphere_m();
    v_tile geometry := ST_TileEnvelope(p_z, p_x, p_y);
    v_unit_m double precision := (ST_XMax(v_tile) - ST_XMin(v_tile)) / 4096;
    v_clipped geometry := p_geometry;
    v_shape geometry;
BEGIN
    -- Web Mercator ends at 85.06 degrees of latitude.
    IF ST_YMin(p_geometry) < -85.5 OR ST_YMax(p_geometry) > 85.5 THEN
        v_clipped := ST_ClipByBox2D(p_geometry, ST_MakeEnvelope(-720, -85.5, 720, 85.5, 4326));
    END IF;
    IF ST_IsEmpty(v_clipped) THEN
        RETURN NULL;
    END IF;
    -- Mercator on the sphere, rescaled.
    v_shape := ST_SetSRID(ST_Scale(_to_plane(v_clipped, 'sphere'), c_size, c_size), 3857);
    v_shape := (SELECT CASE count(*) WHEN 1 THEN ST_GeometryN(ST_Collect(t.shape), 1)
                                     ELSE ST_CollectionHomogenize(ST_Collect(t.shape)) END
                FROM (SELECT ST_Translate(v_shape, turn * 2 * pi() * _wgs84_m()::double precision, 0) AS shape
                      FROM generate_series(-1, 1) turn) t
                WHERE t.shape && _tile_bounds(p_z, p_x, p_y));
    IF v_shape IS NULL THEN
        RETURN NULL;
    END IF;
    v_shape := ST_Simplify(v_shape, v_unit_m / 2, true);
    -- A polygon thinner than a unit becomes a line, a smaller one a point, so that nothing vanishes.
    RETURN coalesce(
        ST_AsMVTGeom(v_shape, v_tile, 4096, 64, true),
        -- A ring that runs back on itself would vanish; its halves do not.
        CASE WHEN ST_Dimension(v_shape) = 2 THEN ST_AsMVTGeom(
            (SELECT ST_Collect(ST_LineSubstring(ST_ExteriorRing(d.geom), half, half + 0.5))
             FROM ST_Dump(v_shape) d CROSS JOIN (VALUES (0.0), (0.5)) t (half) WHERE ST_Dimension(d.geom) = 2),
            v_tile, 4096, 64, true) END,
        CASE WHEN greatest(ST_XMax(v_shape) - ST_XMin(v_shape), ST_YMax(v_shape) - ST_YMin(v_shape)) < 2 * v_unit_m
             THEN ST_AsMVTGeom(ST_Centroid(ST_Envelope(v_shape)), v_tile, 4096, 64, true) END);
END
$$;
COMMENT ON FUNCTION _tile_shape(geometry, integer, integer, integer) IS
'The part of a geometry (longitude and latitude, degrees) that a tile shows, in tile units (4096, margin 64), '
'simplified by at most half a unit; null if there is none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_measures(
    p_z integer, p_x integer, p_y integer, p_plane text,
    OUT bounds geometry, OUT shown geometry, OUT unit_m double precision, OUT unit_deg double precision,
    OUT plain_deg double precision, OUT large_deg double precision, OUT edge_deg double precision
)
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    -- Greatest deviation, metres on the map, between a line straight in the plane and one straight in Web Mercator, per
    -- squared degree of length: e^2 a (1 degree)^2 / 8 for a rhumb line, a (1 degree)^2 / 8 for a great circle, plus a
    -- fifth for terms of higher order.
    c_rhumb_m CONSTANT double precision := 2;
    c_circle_m CONSTANT double precision := 300;
    v_is_rhumb boolean := p_plane IN ('wgs84', 'sphere');
    v_bend_m double precision := CASE WHEN v_is_rhumb THEN c_rhumb_m ELSE c_circle_m END;
BEGIN
    bounds := ST_TileEnvelope(p_z, p_x, p_y);
    unit_m := (ST_XMax(bounds) - ST_XMin(bounds)) / 4096;
    unit_deg := 360.0 / 4096 / (1 << p_z);
    large_deg := CASE WHEN v_is_rhumb THEN 20 ELSE 5 END;
    plain_deg := least(large_deg, sqrt(unit_m / 2 / v_bend_m));
    shown := ST_Expand(_tile_degrees(p_z, p_x, p_y), v_bend_m * large_deg ^ 2 / (radians(1) * _sphere_m()));
    edge_deg := 180 - 2 * 64 * unit_deg;
END
$$;
COMMENT ON FUNCTION _tile_measures(integer, integer, integer, text) IS
'Constants of a tile. bounds: EPSG:3857. shown: box (degrees) that meets the corners of all smaller objects shown. '
'unit_m, unit_deg: size of a unit. plain_deg: size (degrees at the equator) up to which edges may be drawn straight, '
'to half a unit. large_deg: size above which objects are checked without shown. edge_deg: longitude of the margin '
'before the antimeridian.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_plain(
    p_box box3d, p_size_deg double precision, p_edge_deg double precision
)
RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_XMin(p_box) > -p_edge_deg AND ST_XMax(p_box) < p_edge_deg
           AND ST_YMin(p_box) > -85 AND ST_YMax(p_box) < 85
           AND ST_XMax(p_box) - ST_XMin(p_box) <= p_size_deg
           AND ST_YMax(p_box) - ST_YMin(p_box)
               <= p_size_deg * cosd(greatest(abs(ST_YMin(p_box)), abs(ST_YMax(p_box))));
END;
COMMENT ON FUNCTION _is_plain(box3d, double precision, double precision) IS
'Whether objects in a box (degrees) can be drawn from their corners alone: small, no pole, no antimeridian.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tile_plain(
    p_geometry geometry, p_box box3d, p_bounds geometry, p_unit_m double precision, p_unit_deg double precision
) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_AsMVTGeom(
        CASE WHEN ST_XMax(p_box) - ST_XMin(p_box) < p_unit_deg
                  AND ST_YMax(p_box) - ST_YMin(p_box) < p_unit_deg * cosd(ST_YMax(p_box))
             THEN ST_Transform(ST_SetSRID(ST_MakePoint((ST_XMin(p_box) + ST_XMax(p_box)) / 2,
                                                       (ST_YMin(p_box) + ST_YMax(p_box)) / 2), 4326), 3857)
             ELSE ST_Simplify(ST_Transform(ST_Force2D(p_geometry), 3857), p_unit_m / 2, true) END,
        p_bounds, 4096, 64, true);
END;
COMMENT ON FUNCTION _tile_plain(geometry, box3d, geometry, double precision, double precision) IS
'As _tile_shape, for objects that are _is_plain, twenty times as fast; null also for an area thinner than a unit.';

CREATE OR REPLACE FUNCTION tile_areas(z integer, x integer, y integer, query_params json DEFAULT '{}') RETURNS bytea
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v record := _tile_params(z, x, y, query_params);
    w record := _tile_measures(z, x, y, v.plane);
BEGIN
    RETURN (
        SELECT ST_AsMVT(f, 'areas', 4096, 'shape', 'area_id')
        FROM (SELECT a.area_id, a.key, a.name, a.floor_m, a.ceiling_m,
                     nullif(extract(epoch FROM lower(_active_within(a.active_span, a.activations))), '-infinity')
                         ::double precision AS start_s,
                     nullif(extract(epoch FROM upper(_active_within(a.active_span, a.activations))), 'infinity')
                         ::double precision AS end_s,
                     CASE WHEN b.is_plain
                          THEN coalesce(_tile_plain(a.footprint, b.box, w.bounds, w.unit_m, w.unit_deg),
                                        _tile_shape(a.footprint, z, x, y))
                          ELSE _tile_shape(_drawn(a.footprint, v.plane), z, x, y) END AS shape
              -- OFFSET 0 forces lookups by id, as the number of objects is unknown to the planner.
              FROM _tile_objects(v.scene_id, 0::smallint, v.plane, z, x, y, v.span) o (area_id)
              CROSS JOIN LATERAL (SELECT n.* FROM area n WHERE n.area_id = o.area_id OFFSET 0) a
              CROSS JOIN LATERAL (SELECT n.box, _is_plain(n.box, w.plain_deg, w.edge_deg) AS is_plain,
                                         _is_plain(n.box, w.large_deg, w.edge_deg) AS is_small
                                  FROM (SELECT Box2D(a.footprint)::box3d AS box OFFSET 0) n OFFSET 0) b
              WHERE (a.scene_id = v.scene_id OR NOT _is_edited(v.scene_id, a.key))
                AND coalesce(a.activations, tstzmultirange(a.active_span)) && v.span
                AND (a.footprint && w.shown OR NOT b.is_small)
                AND coalesce(a.floor_m, '-infinity') < coalesce(v.ceiling_m, 'infinity')
                AND coalesce(v.floor_m, '-infinity') < coalesce(a.ceiling_m, 'infinity')
              OFFSET 0) f
        WHERE f.shape IS NOT NULL);
END
$$;
COMMENT ON FUNCTION tile_areas(integer, integer, integer, json) IS
'Vector tile of the areas of a scene, for pg_tileserv and martin: layer areas (key, name, floor_m, ceiling_m, start_s '
'and end_s in Unix seconds, absent if unbounded). query_params: scene; optional: at, or from and to (ISO 8601 with '
'offset), floor_m, ceiling_m.';

CREATE OR REPLACE FUNCTION tile_tracks(z integer, x integer, y integer, query_params json DEFAULT '{}') RETURNS bytea
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v record := _tile_params(z, x, y, query_params);
    w record := _tile_measures(z, x, y, v.plane);
BEGIN
    RETURN (
        SELECT ST_AsMVT(f, 'tracks', 4096, 'shape', 'track_id')
        FROM (SELECT t.track_id, t.key, t.name, t.floor_m, t.ceiling_m, 
                     extract(epoch FROM lower(_at_sea(t.path, t.departures)))::double precision AS start_s,
                     extract(epoch FROM upper(_at_sea(t.path, t.departures)))::double precision AS end_s,
                     CASE WHEN b.is_plain
                          THEN _tile_plain(t.path, b.box, w.bounds, w.unit_m, w.unit_deg)
                          ELSE _tile_shape(_drawn_path(t.path, v.plane), z, x, y) END AS shape
              FROM _tile_objects(v.scene_id, 1::smallint, v.plane, z, x, y, '(,)') o (track_id)
              CROSS JOIN LATERAL (SELECT n.* FROM track n WHERE n.track_id = o.track_id OFFSET 0) t
              CROSS JOIN LATERAL (SELECT n.box, _is_plain(n.box, w.plain_deg, w.edge_deg) AS is_plain,
                                         _is_plain(n.box, w.large_deg, w.edge_deg) AS is_small
                                  FROM (SELECT Box2D(t.path)::box3d AS box OFFSET 0) n OFFSET 0) b
              WHERE (t.scene_id = v.scene_id OR NOT _is_edited(v.scene_id, t.key))
                AND (t.path && w.shown OR NOT b.is_small)
                AND _at_sea(t.path, t.departures)
                    && v.span
                AND coalesce(t.floor_m, '-infinity') < coalesce(v.ceiling_m, 'infinity')
                AND coalesce(v.floor_m, '-infinity') < coalesce(t.ceiling_m, 'infinity')
              OFFSET 0) f
        WHERE f.shape IS NOT NULL);
END
$$;
COMMENT ON FUNCTION tile_tracks(integer, integer, integer, json) IS
'Vector tile of the paths of tracks: layer tracks, attributes and query_params as in tile_areas. A track under way '
'during the requested time shows its whole path; its heights include all legs.';

CREATE OR REPLACE FUNCTION tile_havens(z integer, x integer, y integer, query_params json DEFAULT '{}') RETURNS bytea
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v record := _tile_params(z, x, y, query_params);
BEGIN
    IF v.instant IS NULL THEN
        FOUND := _raise('ZC003', 'query_params', 'at', 'must be given: havens move', 'tile_instant');
    END IF;
    RETURN (
        SELECT ST_AsMVT(f, 'havens', 4096, 'shape', 'track_id')
        FROM (SELECT t.track_id, t.key, t.name, h.floor_m, h.ceiling_m,
                     _tile_shape(haven_at(v.scene, t.key, v.instant), z, x, y) AS shape
              FROM _tile_objects(v.scene_id, 1::smallint, v.plane, z, x, y, v.span) o (track_id)
              CROSS JOIN LATERAL (SELECT n.* FROM track n WHERE n.track_id = o.track_id OFFSET 0) t
              CROSS JOIN LATERAL heights_at(v.scene, t.key, v.instant) h
              WHERE (t.scene_id = v.scene_id OR NOT _is_edited(v.scene_id, t.key))
                AND coalesce(h.floor_m, '-infinity') < coalesce(v.ceiling_m, 'infinity')
                AND coalesce(v.floor_m, '-infinity') < coalesce(h.ceiling_m, 'infinity')
              OFFSET 0) f
        WHERE f.shape IS NOT NULL);
END
$$;
COMMENT ON FUNCTION tile_havens(integer, integer, integer, json) IS
'Vector tile of havens at an instant: layer havens (key, name, floor_m and ceiling_m at that instant). query_params as '
'in tile_areas; at is required.';

CREATE OR REPLACE FUNCTION tile_conflicts(z integer, x integer, y integer, query_params json DEFAULT '{}') RETURNS bytea
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v record := _tile_params(z, x, y, query_params);
    w record := _tile_measures(z, x, y, v.plane);
    v_tile bytea;
BEGIN
    WITH place AS MATERIALIZED (
        -- Regions lie within +-180 degrees and contain the first contact points, up to the tolerance.
        SELECT ST_Expand(ST_Translate(_tile_degrees(z, x, y), 360 * turn, 0), 1e-4) AS box
        FROM generate_series(-1, 1) turn
    ), shown AS MATERIALIZED (
        SELECT DISTINCT ON (c.conflict_id) c.*
        FROM place p
        -- OFFSET 0 forces one index search per place, as in _tile_objects.
        -- Only these columns: names, acknowledgements and others cost a lookup each.
        CROSS JOIN LATERAL (SELECT f.conflict_id, f.a_key, f.a_kind, f.b_key, f.b_kind, f.verdict, f.is_current,
                                   f.first_contact, f.last_contact, f.region, f.first_contact_point
                            FROM conflicts f
                            WHERE f.scene = v.scene AND f.region && p.box AND f.periods && v.span
                            UNION ALL
                            SELECT f.conflict_id, f.a_key, f.a_kind, f.b_key, f.b_kind, f.verdict, f.is_current,
                                   f.first_contact, f.last_contact, f.region, f.first_contact_point
                            FROM conflicts f
                            WHERE f.scene = v.scene AND f.region IS NULL AND f.first_contact_point && p.box
                              AND f.periods && v.span OFFSET 0) c
        WHERE (v.verdicts IS NULL OR c.verdict = ANY (v.verdicts))
          AND (num_nonnulls(v.floor_m, v.ceiling_m) = 0 OR (
              SELECT coalesce(greatest(max(h.floor_m), v.floor_m), '-infinity')
                     < coalesce(least(min(h.ceiling_m), v.ceiling_m), 'infinity')
              FROM (SELECT a.floor_m, a.ceiling_m FROM _seen_areas(v.scene_id) a WHERE a.key IN (c.a_key, c.b_key)
                    UNION ALL
                    SELECT t.floor_m, t.ceiling_m FROM _seen_tracks(v.scene_id) t
                    WHERE t.key IN (c.a_key, c.b_key)) h))
    ), field AS MATERIALIZED (
        SELECT s.conflict_id, s.a_key, s.a_kind, s.b_key, s.b_kind, s.verdict, s.is_current,
               extract(epoch FROM s.first_contact)::double precision AS start_s,
               extract(epoch FROM s.last_contact)::double precision AS end_s,
               CASE WHEN s.region IS NULL THEN NULL
                    WHEN b.is_plain
                    THEN coalesce(_tile_plain(s.region, b.box, w.bounds, w.unit_m, w.unit_deg),
                                  _tile_shape(s.region, z, x, y))
                    ELSE _tile_shape(s.region, z, x, y) END AS region,
               CASE WHEN b.is_plain
                    THEN ST_AsMVTGeom(ST_Transform(s.first_contact_point, 3857), w.bounds, 4096, 64, true)
                    ELSE _tile_shape(s.first_contact_point, z, x, y) END AS point
        FROM shown s
        CROSS JOIN LATERAL (SELECT n.box, _is_plain(n.box, w.plain_deg, w.edge_deg) AS is_plain
                            FROM (SELECT Box2D(coalesce(s.region, s.first_contact_point))::box3d AS box OFFSET 0) n
                            OFFSET 0) b
    )
    SELECT coalesce((
               SELECT ST_AsMVT(f, 'conflicts', 4096, 'region', 'conflict_id')
               FROM (SELECT d.conflict_id, d.a_key, d.a_kind, d.b_key, d.b_kind, d.verdict, d.is_current, d.start_s,
                            d.end_s, d.region
                     FROM field d WHERE d.region IS NOT NULL) f), '')
           || coalesce((
               SELECT ST_AsMVT(f, 'first_contacts', 4096, 'point', 'conflict_id')
               FROM (SELECT d.conflict_id, d.a_key, d.a_kind, d.b_key, d.b_kind, d.verdict, d.is_current, d.start_s,
                            d.end_s, d.point
                     FROM field d WHERE d.point IS NOT NULL) f), '')
        INTO v_tile;
    RETURN v_tile;
END
$$;
COMMENT ON FUNCTION tile_conflicts(integer, integer, integer, json) IS
'Vector tile of the conflicts of a scene: layers conflicts (regions) and first_contacts (points), both with '
'conflict_id as feature id, a_key, a_kind, b_key, b_kind, verdict, is_current, start_s and end_s (of all periods, Unix '
'seconds, absent if unbounded). query_params as in tile_areas, and verdict: a comma-separated list of conflict, '
'grazing, unresolved. Heights apply to those that both objects share. Conflicts without a region are in first_contacts '
'only; without a first contact, too, they are in no tile.';

CREATE OR REPLACE VIEW map_areas WITH (security_invoker = true) AS
SELECT a.area_id, s.name AS scene, a.key, a.name, a.floor_m, a.ceiling_m,
       CASE WHEN isfinite(lower(_active_within(a.active_span, a.activations)))
            THEN lower(_active_within(a.active_span, a.activations)) END AS starts_at,
       CASE WHEN isfinite(upper(_active_within(a.active_span, a.activations)))
            THEN upper(_active_within(a.active_span, a.activations)) END AS ends_at,
       ST_Multi(_on_map(
           a.footprint, _plane(s.motion, s.earth, s.centre_lon, s.centre_lat)))::geometry(MultiPolygon, 4326)
           AS footprint
FROM area a JOIN _layer l USING (scene_id) JOIN scene s ON s.scene_id = l.seen_by
WHERE a.scene_id = s.scene_id OR NOT _is_edited(s.scene_id, a.key);

COMMENT ON VIEW map_areas IS 'Areas as a layer of map programs such as QGIS.';
COMMENT ON COLUMN map_areas.area_id IS 'Unique key of the layer.';
COMMENT ON COLUMN map_areas.scene IS 'Name of the scene.';
COMMENT ON COLUMN map_areas.key IS 'Key of the area.';
COMMENT ON COLUMN map_areas.name IS 'Display name; null: none.';
COMMENT ON COLUMN map_areas.floor_m IS 'Lowest height, metres, inclusive; null: no limit.';
COMMENT ON COLUMN map_areas.ceiling_m IS 'Highest height, metres, exclusive; null: no limit.';
COMMENT ON COLUMN map_areas.starts_at IS 'Start of its activity; null: unbounded.';
COMMENT ON COLUMN map_areas.ends_at IS 'End of its activity, exclusive; null: unbounded.';
COMMENT ON COLUMN map_areas.footprint IS
'Longitude and latitude in degrees, split at the antimeridian, with points on long edges so that they curve correctly.';

CREATE OR REPLACE VIEW map_tracks WITH (security_invoker = true) AS
SELECT t.track_id, s.name AS scene, t.key, t.name, t.floor_m, t.ceiling_m,
       lower(_at_sea(t.path, t.departures)) AS starts_at, upper(_at_sea(t.path, t.departures)) AS ends_at,
       ST_Multi(_on_map(
           t.path, _plane(s.motion, s.earth, s.centre_lon, s.centre_lat)))::geometry(MultiLineString, 4326) AS path
FROM track t JOIN _layer l USING (scene_id) JOIN scene s ON s.scene_id = l.seen_by
WHERE t.scene_id = s.scene_id OR NOT _is_edited(s.scene_id, t.key);

COMMENT ON VIEW map_tracks IS 'Paths of tracks as a layer of map programs such as QGIS.';
COMMENT ON COLUMN map_tracks.track_id IS 'Unique key of the layer.';
COMMENT ON COLUMN map_tracks.scene IS 'Name of the scene.';
COMMENT ON COLUMN map_tracks.key IS 'Key of the track.';
COMMENT ON COLUMN map_tracks.name IS 'Display name; null: none.';
COMMENT ON COLUMN map_tracks.floor_m IS 'Lowest height of all legs, metres, inclusive; null: no limit.';
COMMENT ON COLUMN map_tracks.ceiling_m IS 'Highest height of all legs, metres, exclusive; null: no limit.';
COMMENT ON COLUMN map_tracks.starts_at IS 'Time of the first waypoint.';
COMMENT ON COLUMN map_tracks.ends_at IS 'Time of the last waypoint.';
COMMENT ON COLUMN map_tracks.path IS
'Longitude and latitude in degrees, split at the antimeridian, with points on long legs so that they curve correctly.';

CREATE OR REPLACE VIEW map_conflicts WITH (security_invoker = true) AS
SELECT (c.conflict_id << 20) + p.n AS period_id, c.conflict_id,
       s.name AS scene, c.a_key, CASE c.a_kind WHEN 0 THEN 'area' ELSE 'track' END AS a_kind,
       c.b_key, CASE c.b_kind WHEN 0 THEN 'area' ELSE 'track' END AS b_kind, c.verdict,
       lower(p.period) AS starts_at, upper(p.period) AS ends_at, c.time_error_s,
       ST_Multi(ST_CollectionExtract(c.region, 3))::geometry(MultiPolygon, 4326) AS region, c.first_contact_point
FROM scene s JOIN _layer l ON l.seen_by = s.scene_id JOIN conflict c ON c.scene_id = l.scene_id
CROSS JOIN LATERAL unnest(c.periods) WITH ORDINALITY p (period, n)
WHERE c.verdict <> 'near'
  AND (c.scene_id = s.scene_id OR NOT _is_edited(s.scene_id, c.a_key) AND NOT _is_edited(s.scene_id, c.b_key));

COMMENT ON VIEW map_conflicts IS
'Conflicts as layers of map programs such as QGIS, by regions or first contact points: one row per period.';
COMMENT ON COLUMN map_conflicts.period_id IS
'Unique key of the layer: 2^20 times conflict_id plus the number of the period, from 1.';
COMMENT ON COLUMN map_conflicts.conflict_id IS 'Id of the conflict, as in the view conflicts.';
COMMENT ON COLUMN map_conflicts.scene IS 'Name of the scene.';
COMMENT ON COLUMN map_conflicts.a_key IS 'Key of the first object.';
COMMENT ON COLUMN map_conflicts.a_kind IS 'area or track.';
COMMENT ON COLUMN map_conflicts.b_key IS 'Key of the second object.';
COMMENT ON COLUMN map_conflicts.b_kind IS 'area or track.';
COMMENT ON COLUMN map_conflicts.verdict IS 'conflict, grazing or unresolved, as in the view conflicts.';
COMMENT ON COLUMN map_conflicts.starts_at IS 'Start of the period; null: unbounded.';
COMMENT ON COLUMN map_conflicts.ends_at IS 'End of the period, inclusive; null: unbounded.';
COMMENT ON COLUMN map_conflicts.time_error_s IS 'Error bound of both, seconds.';
COMMENT ON COLUMN map_conflicts.region IS
'Region during all periods: longitude and latitude in degrees, split at the antimeridian; empty if it is a line or '
'point; null if not computed, as by method screen and in scenes with the setting regions '
'off: show first_contact_point.';
COMMENT ON COLUMN map_conflicts.first_contact_point IS
'First contact, in the first period: longitude and latitude in degrees; null if not computed.';
