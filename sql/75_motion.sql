-- Where a haven is on a rhumb line: the motion model of conflictdb.mercator, exact, for SQL users.
--
-- On the meridian distance is proportional to the rectifying latitude mu; the conformal latitude chi turns the
-- ellipsoid's Mercator ordinate into the sphere's, psi = asinh(tan chi). A rhumb line is straight in (longitude, psi)
-- and its length linear in mu, so a step needs one quantity: (psi2 - psi1) / (mu2 - mu1), written so that it loses no
-- digits on an east-west line.
--
-- Series of order 6 in the third flattening of WGS84: C. F. F. Karney, J. Geodesy 85 (2011),
-- doi:10.1007/s00190-011-0445-3, eq. 36 (chi of mu); J. P. Snyder, Map Projections (1987), eqs. 3-20, 3-26
-- (mu and latitude), carried to order 6.
-- What is left out is below 1e-17 radians.

CREATE OR REPLACE FUNCTION _series(p_angle double precision, p_coefficients double precision[]) RETURNS double precision
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_sum double precision := 0;
BEGIN
    -- The smallest terms first.
    FOR j IN REVERSE cardinality(p_coefficients)..1 LOOP
        v_sum := v_sum + p_coefficients[j] * sin(2 * j * p_angle);
    END LOOP;
    RETURN p_angle + v_sum;
END
$$;
COMMENT ON FUNCTION _series(double precision, double precision[]) IS
'An angle (radians) plus the sum of coefficient j times sin(2 j angle).';

CREATE OR REPLACE FUNCTION _rectifying_m(p_earth text) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_earth WHEN 'sphere' THEN 6371008.771415 ELSE 6367449.1458234153 END::double precision;
END;
COMMENT ON FUNCTION _rectifying_m(text) IS 'Metres of meridian per radian of rectifying latitude.';

CREATE OR REPLACE FUNCTION _rectifying(p_latitude double precision, p_earth text) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_earth WHEN 'sphere' THEN p_latitude ELSE _series(p_latitude, ARRAY[
        -0.0025188279161202296627, 2.6435410598113799292e-6, -3.4526234225354141111e-9, 4.8918220519771715152e-12,
        -7.2287258683472357452e-15, 1.0958479860708544708e-17]::double precision[]) END;
END;
COMMENT ON FUNCTION _rectifying(double precision, text) IS 'Rectifying latitude of a geographic latitude, radians.';

CREATE OR REPLACE FUNCTION _latitude(p_rectifying double precision, p_earth text) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_earth WHEN 'sphere' THEN p_rectifying ELSE _series(p_rectifying, ARRAY[
        0.0025188265843977032707, 3.700949035657531109e-6, 7.4477702699759963203e-9, 1.7035857112600327458e-11,
        4.178161827657265913e-14, 1.0706431174734805386e-16]::double precision[]) END;
END;
COMMENT ON FUNCTION _latitude(double precision, text) IS 'Geographic latitude of a rectifying latitude, radians.';

CREATE OR REPLACE FUNCTION _stretch(p_from double precision, p_to double precision, p_earth text)
RETURNS double precision
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_conformal CONSTANT double precision[] := CASE p_earth WHEN 'sphere' THEN ARRAY[]::double precision[] ELSE ARRAY[
        -0.00083773216405794868232, -5.9058701522202033771e-8, -1.6734826652839967562e-10, -2.1647980400627058961e-13,
        -3.7879780461686052188e-16, -7.2487488906941543992e-19] END;
    v_way CONSTANT double precision := p_to - p_from;
    v_ratio double precision := 0;  -- (chi2 - chi1) / (mu2 - mu1)
    v_half double precision;
    v_sine double precision;
    v_cosine double precision;
BEGIN
    FOR j IN REVERSE cardinality(c_conformal)..1 LOOP
        v_ratio := v_ratio + 2 * c_conformal[j] * cos(j * (p_from + p_to))
                             * CASE WHEN v_way = 0 THEN j ELSE sin(j * v_way) / v_way END;
    END LOOP;
    v_ratio := 1 + v_ratio;
    -- psi2 - psi1 = 2 atanh(sin((chi2 - chi1) / 2) / cos((chi1 + chi2) / 2))
    v_half := v_ratio * v_way / 2;
    v_cosine := cos((_series(p_from, c_conformal) + _series(p_to, c_conformal)) / 2);
    v_sine := sin(v_half) / v_cosine;
    RETURN CASE WHEN v_sine = 0 THEN v_ratio / v_cosine ELSE 2 * atanh(v_sine) / v_way END;
END
$$;
COMMENT ON FUNCTION _stretch(double precision, double precision, text) IS
'(psi2 - psi1) / (mu2 - mu1) between two rectifying latitudes (radians), also where they are equal.';

CREATE OR REPLACE FUNCTION _legs(
    p_path geometry, p_earth text, OUT leg integer, OUT starts_at timestamptz, OUT ends_at timestamptz,
    OUT lon_deg double precision, OUT lon_step_deg double precision,
    OUT mu double precision, OUT mu_step double precision, OUT bearing_deg double precision
) RETURNS SETOF record
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    WITH waypoint AS (
        SELECT d.path[1] AS n, to_timestamp(ST_M(d.geom)) AS at, ST_X(d.geom) AS lon_deg,
               _rectifying(radians(ST_Y(d.geom)), p_earth) AS mu
        FROM ST_DumpPoints(p_path) d
    ), step AS (
        SELECT w.n, w.at AS starts_at, lead(w.at) OVER o AS ends_at,
               w.lon_deg, lead(w.lon_deg) OVER o - w.lon_deg AS turn, w.mu, lead(w.mu) OVER o AS next_mu
        FROM waypoint w WINDOW o AS (ORDER BY w.n)
    ), leg AS (
        SELECT s.n, s.starts_at, s.ends_at, s.lon_deg, s.mu, s.next_mu - s.mu AS mu_step, s.next_mu,
               -- The shorter way round; exactly half a turn keeps its sign.
               CASE WHEN abs(s.turn) > 180 THEN s.turn - 360 * round(s.turn / 360) ELSE s.turn END AS lon_step_deg
        FROM step s WHERE s.ends_at IS NOT NULL
    ), moving AS (
        SELECT l.*, CASE WHEN l.lon_step_deg <> 0 OR l.mu_step <> 0 THEN degrees(atan2(
                   radians(l.lon_step_deg) / _stretch(l.mu, l.next_mu, p_earth), l.mu_step)) END AS bearing_deg
        FROM leg l
    )
    -- A loiter keeps the heading of the leg before it, else of the next moving leg, else north.
    SELECT m.n, m.starts_at, m.ends_at, m.lon_deg, m.lon_step_deg, m.mu, m.mu_step,
           coalesce(m.bearing_deg,
                    (SELECT b.bearing_deg FROM moving b WHERE b.n < m.n AND b.bearing_deg IS NOT NULL
                     ORDER BY b.n DESC LIMIT 1),
                    (SELECT b.bearing_deg FROM moving b WHERE b.n > m.n AND b.bearing_deg IS NOT NULL
                     ORDER BY b.n LIMIT 1),
                    0)
    FROM moving m ORDER BY m.n;
END;
COMMENT ON FUNCTION _legs(geometry, text) IS
'The legs of a path: instants, start and change of longitude (degrees) and rectifying latitude (radians), heading.';

CREATE OR REPLACE FUNCTION haven_at(p_scene text, p_key text, p_instant timestamptz) RETURNS geometry
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene scene%ROWTYPE;
    v_track track%ROWTYPE;
    v_plane text;
    v_nr integer;
    v_leg record;
    v_progress double precision;
    v_mu double precision;
    v_lon_deg double precision;
    v_ring geometry;
BEGIN
    SELECT * INTO v_scene FROM scene s WHERE s.scene_id = _scene_id(p_scene);
    SELECT * INTO v_track FROM track t WHERE t.scene_id = v_scene.scene_id AND t.key = p_key;
    IF NOT FOUND THEN
        PERFORM _refuse('ZC011', format('track %L', p_key), 'key', format('is no track of scene %L', p_scene),
                        'object_known');
    END IF;
    IF v_scene.motion = 'great_circle' THEN
        v_ring := _circle_haven_at(v_track.path, v_track.outline, p_instant);
        v_ring := CASE ST_Dimension(ST_ConvexHull(v_track.outline))
                      WHEN 0 THEN ST_StartPoint(v_ring) WHEN 1 THEN ST_RemoveRepeatedPoints(v_ring) ELSE v_ring END;
        v_plane := _plane(v_scene.motion, v_scene.earth, v_scene.centre_lon, v_scene.centre_lat);
        v_ring := _to_plane(v_ring, v_plane);
        RETURN _wrapped(_from_plane(CASE WHEN ST_Dimension(ST_ConvexHull(v_track.outline)) = 2
                                         THEN ST_MakePolygon(v_ring) ELSE v_ring END, v_plane));
    END IF;
    -- At a waypoint the leg that starts there counts; the last instant belongs to none.
    SELECT max(d.path[1]) INTO v_nr FROM ST_DumpPoints(v_track.path) d WHERE to_timestamp(ST_M(d.geom)) <= p_instant;
    IF v_nr IS NULL OR v_nr = ST_NPoints(v_track.path) THEN
        RETURN NULL;
    END IF;
    SELECT * INTO v_leg
        FROM _legs(ST_MakeLine(ST_PointN(v_track.path, v_nr), ST_PointN(v_track.path, v_nr + 1)), v_scene.earth);
    IF v_leg.lon_step_deg = 0 AND v_leg.mu_step = 0 THEN
        -- Only a loiter's heading depends on the other legs.
        SELECT l.bearing_deg INTO v_leg.bearing_deg FROM _legs(v_track.path, v_scene.earth) l WHERE l.leg = v_nr;
    END IF;
    v_progress := extract(epoch FROM p_instant - v_leg.starts_at) / extract(epoch FROM v_leg.ends_at - v_leg.starts_at);
    v_mu := v_leg.mu + v_progress * v_leg.mu_step;
    v_lon_deg := v_leg.lon_deg + v_leg.lon_step_deg * v_progress * _stretch(v_leg.mu, v_mu, v_scene.earth)
                                 / _stretch(v_leg.mu, v_leg.mu + v_leg.mu_step, v_scene.earth);
    -- Each vertex by two rhumb steps: ahead along the heading, then to starboard across it.
    SELECT ST_MakeLine(ST_MakePoint(
               v_lon_deg + degrees(p.ahead * sind(v_leg.bearing_deg) * _stretch(v_mu, p.mu1, v_scene.earth)
                                   + p.across * cosd(v_leg.bearing_deg) * _stretch(p.mu1, p.mu2, v_scene.earth)),
               degrees(_latitude(p.mu2, v_scene.earth))) ORDER BY p.n)
        INTO v_ring
        FROM (SELECT q.*, q.mu1 - q.across * sind(v_leg.bearing_deg) AS mu2
              FROM (SELECT d.path[2] AS n, ST_Y(d.geom) / _rectifying_m(v_scene.earth) AS ahead,
                           ST_X(d.geom) / _rectifying_m(v_scene.earth) AS across,
                           v_mu + ST_Y(d.geom) / _rectifying_m(v_scene.earth) * cosd(v_leg.bearing_deg) AS mu1
                    FROM ST_DumpPoints(v_track.outline) d) q) p;
    -- A haven may be a point or a line: its outline then repeats vertices.
    v_ring := CASE ST_Dimension(ST_ConvexHull(v_track.outline))
                  WHEN 0 THEN ST_StartPoint(v_ring) WHEN 1 THEN ST_RemoveRepeatedPoints(v_ring)
                  ELSE ST_MakePolygon(v_ring) END;
    v_ring := ST_SetSRID(v_ring, 4326);
    RETURN _wrapped(v_ring);
END
$$;
COMMENT ON FUNCTION haven_at(text, text, timestamptz) IS
'Where the haven of a track is at an instant: longitude and latitude in degrees, exact on the scene''s earth, cut '
'at the seam; null before its first and from its last waypoint on. A haven without size is a point, without width '
'a line.';

CREATE OR REPLACE FUNCTION _check_haven(p_who text, p_path geometry, p_outline geometry, p_earth text) RETURNS void
LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF (SELECT max(greatest(abs(e.mu + v.ahead), abs(e.mu + v.ahead - v.across)))
        FROM _legs(p_path, p_earth) l
        CROSS JOIN LATERAL (VALUES (l.mu), (l.mu + l.mu_step)) e (mu)
        CROSS JOIN LATERAL (SELECT ST_Y(d.geom) / _rectifying_m(p_earth) * cosd(l.bearing_deg) AS ahead,
                                   ST_X(d.geom) / _rectifying_m(p_earth) * sind(l.bearing_deg) AS across
                            FROM ST_DumpPoints(p_outline) d) v) > radians(89.5) THEN
        PERFORM _refuse('ZC005', p_who, 'outline',
                        'the haven reaches beyond 89.5 degrees of latitude on one of its legs',
                        'haven_in_plane', 'The Mercator plane stretches without limit towards the poles.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_haven(text, geometry, geometry, text) IS
'Refuses a haven (metres) that leaves the Mercator plane on its path, as conflictdb.pieces.check_plane does.';
