-- The scene's plane: Mercator, on WGS84 (EPSG:3395) or on the sphere of mean radius.
--
-- ST_Transform wraps longitudes into +-180; objects across the seam must not be. Shifting longitude by c shifts x by
-- a * c exactly, so geometries are centred before and moved back after.
--
-- All are single expressions, and not STRICT, so that they are inlined: a SQL function that is not inlined is set up
-- anew at every call, and one that is STRICT is not when it holds a CASE. Null gives null all the same.

CREATE OR REPLACE FUNCTION _radius_m(p_earth text) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_earth WHEN 'sphere' THEN 6371008.771415 ELSE 6378137.0 END::double precision;
END;
COMMENT ON FUNCTION _radius_m(text) IS 'Equatorial radius of the figure of the earth, metres: plane x per radian.';

CREATE OR REPLACE FUNCTION _plane_srid(p_earth text) RETURNS integer
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_earth WHEN 'wgs84' THEN 3395 ELSE 0 END;
END;
COMMENT ON FUNCTION _plane_srid(text) IS 'SRID of the plane of a scene: EPSG:3395 on WGS84, none on the sphere.';

CREATE OR REPLACE FUNCTION _middle_x(p_geometry geometry, p_half_width double precision) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN ST_XMin(p_geometry) >= -p_half_width AND ST_XMax(p_geometry) <= p_half_width THEN 0.0
                ELSE (ST_XMin(p_geometry) + ST_XMax(p_geometry)) / 2 END;
END;
COMMENT ON FUNCTION _middle_x(geometry, double precision) IS
'By how much to shift a geometry west so that it lies within +-p_half_width: 0 if it does already.';

-- EPSG:3857 is the Mercator plane of a sphere that has the radius of the WGS84 equator; ours has another size.

CREATE OR REPLACE FUNCTION _to_plane(p_geometry geometry, p_earth text) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_earth = 'wgs84' THEN
        ST_Translate(ST_Transform(ST_Translate(p_geometry, -_middle_x(p_geometry, 180.0), 0), 3395),
                     radians(_middle_x(p_geometry, 180.0)) * 6378137.0, 0)
    ELSE
        ST_SetSRID(ST_Translate(
            ST_Scale(ST_Transform(ST_Translate(p_geometry, -_middle_x(p_geometry, 180.0), 0), 3857),
                     6371008.771415 / 6378137.0, 6371008.771415 / 6378137.0),
            radians(_middle_x(p_geometry, 180.0)) * 6371008.771415, 0), 0)
    END;
END;
COMMENT ON FUNCTION _to_plane(geometry, text) IS
'Longitude and latitude (degrees, not wrapped, SRID 4326) to the Mercator plane of the earth (metres).';

CREATE OR REPLACE FUNCTION _from_plane(p_geometry geometry, p_earth text) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_earth = 'wgs84' THEN
        ST_Translate(
            ST_Transform(ST_SetSRID(ST_Translate(p_geometry, -_middle_x(p_geometry, pi() * 6378137.0), 0), 3395), 4326),
            degrees(_middle_x(p_geometry, pi() * 6378137.0) / 6378137.0), 0)
    ELSE
        ST_Translate(ST_Transform(ST_SetSRID(
            ST_Scale(ST_Translate(p_geometry, -_middle_x(p_geometry, pi() * 6371008.771415), 0),
                     6378137.0 / 6371008.771415, 6378137.0 / 6371008.771415), 3857), 4326),
            degrees(_middle_x(p_geometry, pi() * 6371008.771415) / 6371008.771415), 0)
    END;
END;
COMMENT ON FUNCTION _from_plane(geometry, text) IS
'The Mercator plane of the earth (metres) to longitude and latitude (degrees, not wrapped, SRID 4326).';

CREATE OR REPLACE FUNCTION _wrapped(p_geometry geometry) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN ST_XMin(p_geometry) >= -180.0 AND ST_XMax(p_geometry) <= 180.0 THEN p_geometry
                ELSE ST_WrapX(ST_WrapX(p_geometry, 180.0, -360.0), -180.0, 360.0) END;
END;
COMMENT ON FUNCTION _wrapped(geometry) IS
'A geometry with longitudes within +-180 degrees, cut at the seam where it crosses it (RFC 7946).';
