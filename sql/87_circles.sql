-- Circles on the earth as footprints.

CREATE OR REPLACE FUNCTION circle(
    p_scene text, p_lon double precision, p_lat double precision, p_radius_m double precision
) RETURNS geometry
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'circle';
    c_corners CONSTANT integer := 128;
    v_scene scene;
    v_lat double precision := radians(p_lat);
    -- Sides come nearest half-way between corners, on the sphere at tan(r) = tan(R) cos(pi / corners). Rhumb lines: a
    -- side deviates from the wider circle by at most 1.02 (1 + 2 R tan(lat) / 6335 km) R (2 pi / corners)^2 / 8 (as
    -- conflictdb/formats/discs.py), below 4e-4 R within the limits.
    v_wider_m double precision;
    v_points geometry[];
BEGIN
    SELECT s.* INTO v_scene FROM scene s WHERE s.scene_id = _scene_or_branch(p_scene);
    -- Smaller numbers underflow.
    p_lon := CASE WHEN abs(p_lon) < 1e-100 THEN 0 ELSE p_lon END;
    p_radius_m := CASE WHEN abs(p_radius_m) < 1e-100 THEN 0 ELSE p_radius_m END;
    IF (p_radius_m > 0 AND p_radius_m <= CASE v_scene.motion WHEN 'rhumb' THEN 50000 ELSE 5000000 END) IS NOT TRUE THEN
        FOUND := _raise('ZC001', c_who, 'radius_m',
                        format('must be a number of metres, more than 0 and at most 5000000, for rhumb lines 50000; '
                               'got %s', p_radius_m), 'radius_known', 'Draw a polygon, or use circle() of Python.');
    END IF;
    IF (abs(p_lon) <= 360 AND abs(p_lat) <= 90) IS NOT TRUE
       OR abs(p_lat) + p_radius_m / 110000 > (CASE v_scene.motion WHEN 'rhumb' THEN 80 ELSE 90 END) THEN
        FOUND := _raise('ZC005', c_who, 'centre',
                        format('must be longitude and latitude in degrees, the circle within +-90, for rhumb lines 80 '
                               'degrees of latitude; got %s, %s', p_lon, p_lat), 'centre_known');
    END IF;
    v_wider_m := CASE v_scene.motion
        WHEN 'great_circle' THEN
            _radius_m('sphere') * atan(tan(p_radius_m / _radius_m('sphere')) / cos(pi() / c_corners))
        ELSE 1.0005 * p_radius_m END + 1e-6;
    IF v_scene.earth = 'sphere' THEN
        SELECT array_agg(ST_MakePoint(
                   p_lon + degrees(atan2(sin(a.azimuth) * sin(d.angle) * cos(v_lat),
                                         cos(d.angle) - sin(v_lat) * d.sine)), degrees(asin(d.sine)))
                   ORDER BY a.azimuth) INTO v_points
            FROM (SELECT 2 * pi() * k / c_corners AS azimuth FROM generate_series(0, c_corners - 1) k) a
            CROSS JOIN LATERAL (SELECT v_wider_m / _radius_m('sphere') AS angle,
                                       sin(v_lat) * cos(v_wider_m / _radius_m('sphere'))
                                       + cos(v_lat) * sin(v_wider_m / _radius_m('sphere')) * cos(a.azimuth) AS sine) d;
    ELSE
        SELECT array_agg(ST_MakePoint(
                   -- The nearest turn: geography wraps longitudes.
                   p_lon + (ST_X(g.place) - p_lon) - 360 * round((ST_X(g.place) - p_lon) / 360), ST_Y(g.place))
                   ORDER BY g.azimuth) INTO v_points
            FROM (SELECT a.azimuth, ST_Project(ST_SetSRID(ST_MakePoint(p_lon - 360 * round(p_lon / 360), p_lat), 4326)
                                               ::geography, v_wider_m, a.azimuth)::geometry AS place
                  FROM (SELECT 2 * pi() * k / c_corners AS azimuth FROM generate_series(0, c_corners - 1) k) a) g;
    END IF;
    RETURN ST_Multi(ST_SetSRID(ST_MakePolygon(ST_MakeLine(v_points || v_points[1])), 4326));
END
$$;
COMMENT ON FUNCTION circle(text, double precision, double precision, double precision) IS
'Footprint (for put_area) of a circle: the places within p_radius_m metres of a centre in degrees, along the shortest '
'way. Contains the circle and exceeds its radius by at most a thousandth, in a scene of this motion and earth. Raises '
'ZC001 or ZC005 for circles that are too large, or too near a pole.';
