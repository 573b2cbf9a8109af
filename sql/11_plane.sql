-- Projection to and from the scene's plane. p_plane is the result of _plane(): 'wgs84' (Mercator, EPSG:3395), 'sphere'
-- (Mercator on the sphere of mean radius), or the PROJ string of a gnomonic plane about the scene's centre.
-- p_earth is 'wgs84' or 'sphere'.
--
-- ST_Transform wraps longitudes into +-180, which would break objects across the seam. So geometries are shifted to the
-- middle first and back afterwards: shifting longitude by c shifts Mercator x by exactly a * c.
--
-- Most functions are single expressions and not STRICT, so that PostgreSQL inlines them. Null input gives null.

CREATE OR REPLACE FUNCTION conflictdb_internal._not_tiny(p_m double precision) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN abs(p_m) < 1e-30 THEN 0 ELSE p_m END;
END;
COMMENT ON FUNCTION _not_tiny(double precision) IS
'Returns metres or degrees, but 0 below 1e-30: PostgreSQL raises an error if a product underflows.';

CREATE OR REPLACE FUNCTION conflictdb_internal._exact_numeric(p_number double precision) RETURNS numeric
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- A cast to numeric keeps 15 digits; the cast of the remainder adds the rest. Text would need extra_float_digits.
    SELECT p_number::numeric + (p_number - p_number::numeric::double precision)::numeric;
END;
COMMENT ON FUNCTION _exact_numeric(double precision) IS
'Returns the number with all digits, whatever extra_float_digits is: cast back it is identical.';

-- The only definition of the earth's size in SQL (in Python: conflictdb/earth/geodesy.py). Numeric keeps its text
-- exact.

CREATE OR REPLACE FUNCTION conflictdb_internal._sphere_m() RETURNS numeric
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT 6371008.771415;
END;
COMMENT ON FUNCTION _sphere_m() IS 'Radius of the sphere, metres: the mean radius of WGS84, (2a + b) / 3.';

CREATE OR REPLACE FUNCTION conflictdb_internal._wgs84_m() RETURNS numeric
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT 6378137.0;
END;
COMMENT ON FUNCTION _wgs84_m() IS 'Equatorial radius of WGS84, metres.';

CREATE OR REPLACE FUNCTION conflictdb_internal._globe() RETURNS text
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT '+proj=longlat +R=' || _sphere_m()::text || ' +no_defs';
END;
COMMENT ON FUNCTION _globe() IS 'Returns the PROJ string of longitude and latitude on the sphere.';

CREATE OR REPLACE FUNCTION conflictdb_internal._plane(
    p_motion text, p_earth text, p_centre_lon double precision, p_centre_lat double precision
) RETURNS text
-- Not LANGUAGE sql: format is STABLE, which prevents inlining, and the function would be planned at each call.
LANGUAGE plpgsql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF p_motion = 'great_circle' THEN
        -- No exponents: PROJ reads an "e" as "east". A scene without objects has no centre yet.
        RETURN format('+proj=gnom +lon_0=%s +lat_0=%s +R=%s +no_defs', _exact_numeric(coalesce(p_centre_lon, 0)),
                      _exact_numeric(coalesce(p_centre_lat, 0)), _sphere_m());
    END IF;
    RETURN p_earth;
END
$$;
COMMENT ON FUNCTION _plane(text, text, double precision, double precision) IS
'Returns the plane in which tracks and edges of a scene are straight: wgs84 or sphere for Mercator, else a PROJ string '
'of a gnomonic projection.';

CREATE OR REPLACE FUNCTION conflictdb_internal._radius_m(p_plane text) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_plane WHEN 'wgs84' THEN _wgs84_m() ELSE _sphere_m() END::double precision;
END;
COMMENT ON FUNCTION _radius_m(text) IS
'Equatorial radius of the plane''s earth, metres. On a Mercator plane this is x per radian of longitude.';

CREATE OR REPLACE FUNCTION conflictdb_internal._plane_srid(p_plane text) RETURNS integer
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_plane WHEN 'wgs84' THEN 3395 ELSE 0 END;
END;
COMMENT ON FUNCTION _plane_srid(text) IS 'SRID of a plane: 3395 for wgs84, else 0 (none).';

CREATE OR REPLACE FUNCTION conflictdb_internal._middle_x(
    p_geometry geometry, p_half_width double precision
) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN ST_XMin(p_geometry) >= -p_half_width AND ST_XMax(p_geometry) <= p_half_width THEN 0.0
                ELSE (ST_XMin(p_geometry) + ST_XMax(p_geometry)) / 2 END;
END;
COMMENT ON FUNCTION _middle_x(geometry, double precision) IS
'Returns how far to shift a geometry west so that it lies within +-p_half_width (in its units); 0 if it already does.';

-- EPSG:3857 is Mercator on a sphere with the equatorial radius of WGS84; scaling changes it to the mean radius.

CREATE OR REPLACE FUNCTION conflictdb_internal._to_plane(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_plane WHEN 'wgs84' THEN
        ST_Translate(ST_Transform(ST_Translate(p_geometry, -_middle_x(p_geometry, 180.0), 0), 3395),
                     radians(_middle_x(p_geometry, 180.0)) * _wgs84_m(), 0)
    WHEN 'sphere' THEN
        ST_SetSRID(ST_Translate(
            ST_Scale(ST_Transform(ST_Translate(p_geometry, -_middle_x(p_geometry, 180.0), 0), 3857),
                     _sphere_m() / _wgs84_m(), _sphere_m() / _wgs84_m()),
            radians(_middle_x(p_geometry, 180.0)) * _sphere_m(), 0), 0)
    ELSE
        ST_Transform(p_geometry, _globe(), p_plane)
    END;
END;
COMMENT ON FUNCTION _to_plane(geometry, text) IS
'Projects longitude and latitude (degrees, not wrapped, SRID 4326) to the scene''s plane (metres).';

CREATE OR REPLACE FUNCTION conflictdb_internal._each_to_plane(p_geometries geometry[], p_plane text)
RETURNS geometry[]
-- Not LANGUAGE sql, which would be planned at each call.
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF p_plane IN ('wgs84', 'sphere') THEN
        RETURN (SELECT array_agg(_to_plane(u.geometry, p_plane) ORDER BY u.n)
                FROM unnest(p_geometries) WITH ORDINALITY u (geometry, n));
    END IF;
    -- PROJ prepares a projection about a centre for every call, which takes 100 times as long as a polygon.
    RETURN (WITH chunk AS MATERIALIZED (
                SELECT (u.n - 1) / 64 AS number, count(*) AS size,
                       ST_Transform(ST_Collect(array_agg(u.geometry ORDER BY u.n)), _globe(), p_plane) AS shapes
                FROM unnest(p_geometries) WITH ORDINALITY u (geometry, n) GROUP BY (u.n - 1) / 64
            )
            SELECT array_agg(ST_GeometryN(c.shapes, k::integer) ORDER BY c.number, k)
            FROM chunk c CROSS JOIN generate_series(1, c.size) k);
END
$$;
COMMENT ON FUNCTION _each_to_plane(geometry[], text) IS
'Projects geometries, none of them null, as _to_plane does.';

CREATE OR REPLACE FUNCTION conflictdb_internal._off_the_pole(p_part geometry) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Longitude is arbitrary at a pole: the ring gets two vertices there, with the longitudes of its neighbours.
    -- Longitudes within 1e-9 degrees of a cut meridian are rounded to it. PROJ knows a pole to 0.1 m (2e-6 degrees).
    WITH point AS (
        SELECT d.path[1] AS n, ST_Y(d.geom) AS lat,
               CASE WHEN abs(ST_X(d.geom) - 90 * round(ST_X(d.geom) / 90)) < 1e-9 THEN 90 * round(ST_X(d.geom) / 90)
                    ELSE ST_X(d.geom) END AS lon
        FROM ST_DumpPoints(ST_ExteriorRing(p_part)) d WHERE d.path[1] < ST_NPoints(ST_ExteriorRing(p_part))
    ), beside AS (
        SELECT p.*, coalesce(lag(p.lon) OVER o, last_value(p.lon) OVER w) AS before,
               coalesce(lead(p.lon) OVER o, first_value(p.lon) OVER w) AS after
        FROM point p WINDOW o AS (ORDER BY p.n),
                            w AS (ORDER BY p.n ROWS BETWEEN UNBOUNDED PRECEDING AND UNBOUNDED FOLLOWING)
    ), ring AS (
        SELECT ST_MakeLine(ST_MakePoint(v.lon, CASE WHEN v.is_pole THEN 90 * sign(b.lat) ELSE b.lat END)
                           ORDER BY b.n, v.n) AS line
        FROM beside b CROSS JOIN LATERAL (
            SELECT 1 AS n, b.before AS lon, true AS is_pole WHERE abs(b.lat) > 90 - 2e-6
            UNION ALL SELECT 2, b.after, true WHERE abs(b.lat) > 90 - 2e-6
            UNION ALL SELECT 1, b.lon, false WHERE abs(b.lat) <= 90 - 2e-6) v
    )
    SELECT ST_SetSRID(ST_MakePolygon(ST_AddPoint(r.line, ST_StartPoint(r.line)),
                                     ARRAY(SELECT ST_ExteriorRing(h.geom) FROM ST_DumpRings(p_part) h
                                           WHERE h.path[1] > 0)), 4326)
    FROM ring r;
END;
COMMENT ON FUNCTION _off_the_pole(geometry) IS
'Replaces each pole vertex of a polygon (longitude and latitude, degrees) by a side along the pole.';

CREATE OR REPLACE FUNCTION conflictdb_internal._from_gnomonic(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_globe CONSTANT text := _globe();
    -- Straight sides become curves in longitude and latitude: 25 km deviate by 50 m at 60 degrees latitude.
    c_side_m CONSTANT double precision := 25000;
    v_lat double precision := substring(p_plane from 'lat_0=([-0-9.]+)')::double precision;
    v_pole geometry := ST_MakePoint(0, _sphere_m() * sign(v_lat) / greatest(tand(abs(v_lat)), 1e-3));
    v_middle double precision;
BEGIN
    IF ST_IsEmpty(p_geometry) THEN
        RETURN ST_SetSRID(p_geometry, 4326);
    END IF;
    IF ST_Dimension(p_geometry) < 2 OR v_lat = 0 OR NOT ST_DWithin(ST_ConvexHull(p_geometry), v_pole, 1e-6) THEN
        -- It spans less than half a turn, so longitudes are wrapped about that of its centroid.
        v_middle := ST_X(ST_Transform(ST_Centroid(p_geometry), p_plane, c_globe));
        RETURN ST_SetSRID(ST_Transform(ST_Segmentize(p_geometry, c_side_m), p_plane,
                                       c_globe || format(' +lon_wrap=%s', v_middle::numeric)), 4326);
    END IF;
    -- It contains a pole: cut it into quarters that have the pole as a corner.
    RETURN (
        WITH ray AS (
            SELECT lon, ST_Transform(ST_MakePoint(lon, sign(v_lat) * 89), c_globe, p_plane) AS point
            FROM generate_series(-180, 180, 90) lon
        ), far AS (
            SELECT r.lon, ST_MakePoint(
                       (ST_X(r.point) - ST_X(v_pole)) * 1e8 / ST_Distance(r.point, v_pole) + ST_X(v_pole),
                       (ST_Y(r.point) - ST_Y(v_pole)) * 1e8 / ST_Distance(r.point, v_pole) + ST_Y(v_pole)) AS point
            FROM ray r
        ), quarter AS (
            SELECT w.lon, ST_MakePolygon(ST_MakeLine(ARRAY[v_pole, w.point, e.point, v_pole])) AS wedge
            FROM far w JOIN far e ON e.lon = w.lon + 90
        ), part AS (
            SELECT ST_Transform(ST_Segmentize(d.geom, c_side_m), p_plane,
                                c_globe || format(' +lon_wrap=%s', q.lon + 45)) AS part
            FROM quarter q
            CROSS JOIN LATERAL ST_Dump(ST_CollectionExtract(ST_Intersection(ST_SetSRID(p_geometry, 0), q.wedge), 3)) d
        )
        SELECT ST_SetSRID(ST_UnaryUnion(ST_Collect(ST_MakeValid(_off_the_pole(p.part))), 1e-11), 4326) FROM part p
    );
END
$$;
COMMENT ON FUNCTION _from_gnomonic(geometry, text) IS
'Projects a gnomonic plane (metres, see _plane) to longitude and latitude (degrees, not wrapped, SRID 4326). Long '
'sides get additional points; around a pole the result runs along latitude 90.';

CREATE OR REPLACE FUNCTION conflictdb_internal._from_plane(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_plane WHEN 'wgs84' THEN
        ST_Translate(
            ST_Transform(
                ST_SetSRID(ST_Translate(p_geometry, -_middle_x(p_geometry, pi() * _wgs84_m()), 0), 3395), 4326),
            degrees(_middle_x(p_geometry, pi() * _wgs84_m()) / _wgs84_m()), 0)
    WHEN 'sphere' THEN
        ST_Translate(ST_Transform(ST_SetSRID(
            ST_Scale(ST_Translate(p_geometry, -_middle_x(p_geometry, pi() * _sphere_m()), 0),
                     _wgs84_m() / _sphere_m(), _wgs84_m() / _sphere_m()), 3857), 4326),
            degrees(_middle_x(p_geometry, pi() * _sphere_m()) / _sphere_m()), 0)
    ELSE
        _from_gnomonic(p_geometry, p_plane)
    END;
END;
COMMENT ON FUNCTION _from_plane(geometry, text) IS
'Projects the scene''s plane (metres) to longitude and latitude (degrees, not wrapped, SRID 4326).';

CREATE OR REPLACE FUNCTION conflictdb_internal._wrapped(p_geometry geometry) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN ST_XMin(p_geometry) >= -180.0 AND ST_XMax(p_geometry) <= 180.0 THEN p_geometry
                ELSE ST_WrapX(ST_WrapX(p_geometry, 180.0, -360.0), -180.0, 360.0) END;
END;
COMMENT ON FUNCTION _wrapped(geometry) IS
'Returns a geometry with longitudes within +-180 degrees, split at the antimeridian (RFC 7946).';

CREATE OR REPLACE FUNCTION conflictdb_internal._part_from_plane(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Rounding may make nearly touching edges cross; GEOS cannot unite invalid parts.
    SELECT CASE WHEN ST_IsValidReason(d.part) = 'Valid Geometry' THEN d.part ELSE ST_MakeValid(d.part) END
    FROM (SELECT _wrapped(_from_plane(p_geometry, p_plane)) AS part OFFSET 0) d;
END;
COMMENT ON FUNCTION _part_from_plane(geometry, text) IS
'Projects part of a region (metres in the scene''s plane) to longitude and latitude, wrapped and valid for a union.';

CREATE OR REPLACE FUNCTION conflictdb_internal._meets(
    p_region geometry, p_geometry geometry, p_plane text
) RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Compared in the plane, where edges are straight. A distance, not ST_Intersects, because parts split at the
    -- antimeridian have a gap of rounding errors, less than a millimetre.
    SELECT EXISTS (SELECT FROM generate_series(-1, 1) turn
                   WHERE ST_DWithin(_to_plane(p_region, p_plane),
                                    ST_Translate(_to_plane(p_geometry, p_plane),
                                                 turn * 2 * pi() * _radius_m(p_plane), 0), 0.001)
                     AND (turn = 0 OR p_plane IN ('wgs84', 'sphere')));
END;
COMMENT ON FUNCTION _meets(geometry, geometry, text) IS
'Whether a region (longitudes within +-180 degrees) meets a geometry (longitude and latitude) in the scene''s plane.';
