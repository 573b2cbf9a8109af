-- The scene's plane: Mercator, on WGS84 (EPSG:3395) or on the sphere of mean radius, or gnomonic about the scene's
-- centre on the sphere. p_plane names it, as _plane makes it of a scene: 'wgs84' and 'sphere' are the Mercator planes,
-- anything else is what PROJ makes a gnomonic one of. p_earth is only ever a figure of the earth: 'wgs84' or 'sphere'.
--
-- ST_Transform wraps longitudes into +-180; objects across the seam must not be. Shifting longitude by c shifts x by
-- a * c exactly, so geometries are centred before and moved back after.
--
-- All are single expressions, and not STRICT, so that they are inlined: a SQL function that is not inlined is set up
-- anew at every call, and one that is STRICT is not when it holds a CASE. Null gives null all the same.

CREATE OR REPLACE FUNCTION _not_tiny(p_m double precision) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN abs(p_m) < 1e-30 THEN 0 ELSE p_m END;
END;
COMMENT ON FUNCTION _not_tiny(double precision) IS
'A number of metres or degrees, 0 below 1e-30: products of smaller ones may underflow, which PostgreSQL refuses.';

CREATE OR REPLACE FUNCTION _exact_numeric(p_number double precision) RETURNS numeric
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- A cast takes 15 digits; what it leaves is another number of 15 digits. Through text, extra_float_digits decides.
    SELECT p_number::numeric + (p_number - p_number::numeric::double precision)::numeric;
END;
COMMENT ON FUNCTION _exact_numeric(double precision) IS
'The number with all its digits: cast back it is the same number, whatever the session''s extra_float_digits.';

-- The size of the earth stands once in SQL: here (in Python: conflictdb/earth/geodesy.py). Numeric: its text is exact.

CREATE OR REPLACE FUNCTION _sphere_m() RETURNS numeric
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT 6371008.771415;
END;
COMMENT ON FUNCTION _sphere_m() IS 'Radius of the sphere, metres: the mean radius of WGS84, (2a + b) / 3.';

CREATE OR REPLACE FUNCTION _wgs84_m() RETURNS numeric
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT 6378137.0;
END;
COMMENT ON FUNCTION _wgs84_m() IS 'Equatorial radius of WGS84, metres.';

CREATE OR REPLACE FUNCTION _globe() RETURNS text
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT '+proj=longlat +R=' || _sphere_m()::text || ' +no_defs';
END;
COMMENT ON FUNCTION _globe() IS 'What PROJ makes longitude and latitude on the sphere of.';

CREATE OR REPLACE FUNCTION _plane(
    p_motion text, p_earth text, p_centre_lon double precision, p_centre_lat double precision
) RETURNS text
-- Not in SQL: format, which is only stable, keeps that from becoming a part of queries, and it is planned at each call.
LANGUAGE plpgsql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF p_motion = 'great_circle' THEN
        -- Without exponents, which PROJ takes for "east". A scene without objects has no centre yet.
        RETURN format('+proj=gnom +lon_0=%s +lat_0=%s +R=%s +no_defs', _exact_numeric(coalesce(p_centre_lon, 0)),
                      _exact_numeric(coalesce(p_centre_lat, 0)), _sphere_m());
    END IF;
    RETURN p_earth;
END
$$;
COMMENT ON FUNCTION _plane(text, text, double precision, double precision) IS
'The plane of a scene, where its tracks and edges are straight: the earth of a Mercator plane, or what PROJ makes a '
'gnomonic one of.';

CREATE OR REPLACE FUNCTION _radius_m(p_plane text) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_plane WHEN 'wgs84' THEN _wgs84_m() ELSE _sphere_m() END::double precision;
END;
COMMENT ON FUNCTION _radius_m(text) IS
'Equatorial radius of the earth of a plane, metres: of a Mercator plane, x per radian.';

CREATE OR REPLACE FUNCTION _plane_srid(p_plane text) RETURNS integer
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_plane WHEN 'wgs84' THEN 3395 ELSE 0 END;
END;
COMMENT ON FUNCTION _plane_srid(text) IS 'SRID of a plane: EPSG:3395 on WGS84, none on the sphere.';

CREATE OR REPLACE FUNCTION _middle_x(p_geometry geometry, p_half_width double precision) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN ST_XMin(p_geometry) >= -p_half_width AND ST_XMax(p_geometry) <= p_half_width THEN 0.0
                ELSE (ST_XMin(p_geometry) + ST_XMax(p_geometry)) / 2 END;
END;
COMMENT ON FUNCTION _middle_x(geometry, double precision) IS
'By how much to shift a geometry west so that it lies within +-p_half_width: 0 if it does already.';

-- EPSG:3857 is the Mercator plane of a sphere that has the radius of the WGS84 equator; ours has another size.

CREATE OR REPLACE FUNCTION _to_plane(p_geometry geometry, p_plane text) RETURNS geometry
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
'Longitude and latitude (degrees, not wrapped, SRID 4326) to the plane of a scene (metres).';

CREATE OR REPLACE FUNCTION _off_the_pole(p_part geometry) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- At a pole every longitude is right: there the ring runs along it from the meridian it comes on to the one it
    -- leaves on. Meridians of the cut get their own number again. PROJ takes an arc sine, which knows a pole to 0.1 m
    -- only.
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
'A polygon in longitude and latitude (degrees) whose ring touches a pole, with a side along it.';

CREATE OR REPLACE FUNCTION _from_gnomonic(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_globe CONSTANT text := _globe();
    -- Sides are great circles, which longitude and latitude bend: 25 km of one leave the line by 50 m at 60 degrees.
    c_side_m CONSTANT double precision := 25000;
    v_lat double precision := substring(p_plane from 'lat_0=([-0-9.]+)')::double precision;
    v_pole geometry := ST_MakePoint(0, _sphere_m() * sign(v_lat) / greatest(tand(abs(v_lat)), 1e-3));
    v_middle double precision;
BEGIN
    IF ST_IsEmpty(p_geometry) THEN
        RETURN ST_SetSRID(p_geometry, 4326);
    END IF;
    IF ST_Dimension(p_geometry) < 2 OR v_lat = 0 OR NOT ST_DWithin(ST_ConvexHull(p_geometry), v_pole, 1e-6) THEN
        -- It spans less than half a turn: longitudes run on from that of its middle.
        v_middle := ST_X(ST_Transform(ST_Centroid(p_geometry), p_plane, c_globe));
        RETURN ST_SetSRID(ST_Transform(ST_Segmentize(p_geometry, c_side_m), p_plane,
                                       c_globe || format(' +lon_wrap=%s', v_middle::numeric)), 4326);
    END IF;
    -- Around a pole: by quarters, so that the pole is a corner.
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
'A gnomonic plane (metres, see _plane) to longitude and latitude (degrees, not wrapped, SRID 4326), with points put on '
'long sides; around a pole it runs along latitude 90.';

CREATE OR REPLACE FUNCTION _from_plane(p_geometry geometry, p_plane text) RETURNS geometry
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
'The plane of a scene (metres) to longitude and latitude (degrees, not wrapped, SRID 4326).';

CREATE OR REPLACE FUNCTION _wrapped(p_geometry geometry) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN ST_XMin(p_geometry) >= -180.0 AND ST_XMax(p_geometry) <= 180.0 THEN p_geometry
                ELSE ST_WrapX(ST_WrapX(p_geometry, 180.0, -360.0), -180.0, 360.0) END;
END;
COMMENT ON FUNCTION _wrapped(geometry) IS
'A geometry with longitudes within +-180 degrees, cut at the seam where it crosses it (RFC 7946).';

CREATE OR REPLACE FUNCTION _part_from_plane(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Edges that all but touch may cross when they are rounded; a union of such parts would be refused by GEOS.
    SELECT CASE WHEN ST_IsValidReason(d.part) = 'Valid Geometry' THEN d.part ELSE ST_MakeValid(d.part) END
    FROM (SELECT _wrapped(_from_plane(p_geometry, p_plane)) AS part OFFSET 0) d;
END;
COMMENT ON FUNCTION _part_from_plane(geometry, text) IS
'A part of a region (metres in the plane of a scene) to longitude and latitude, wrapped, valid: fit for a union.';

CREATE OR REPLACE FUNCTION _meets(p_region geometry, p_geometry geometry, p_plane text) RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Not in degrees, where the edges run elsewhere. By distance, which parts cut at the seam do not disturb; a
    -- millimetre is more than going there and back rounds.
    SELECT EXISTS (SELECT FROM generate_series(-1, 1) turn
                   WHERE ST_DWithin(_to_plane(p_region, p_plane),
                                    ST_Translate(_to_plane(p_geometry, p_plane),
                                                 turn * 2 * pi() * _radius_m(p_plane), 0), 0.001)
                     AND (turn = 0 OR p_plane IN ('wgs84', 'sphere')));
END;
COMMENT ON FUNCTION _meets(geometry, geometry, text) IS
'Whether a region (within +-180 degrees) meets a geometry (longitude and latitude) where both have straight edges.';
