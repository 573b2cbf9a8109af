-- Where a haven is on a rhumb line: the motion model of conflictdb.motion.mercator, exact, for SQL users.
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
    SELECT CASE p_earth WHEN 'sphere' THEN _sphere_m() ELSE 6367449.1458234153 END::double precision;
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
        SELECT d.path[1] AS n, to_timestamp(ST_M(d.geom)) AS at, _not_tiny(ST_X(d.geom)) AS lon_deg,
               _rectifying(radians(_not_tiny(ST_Y(d.geom))), p_earth) AS mu
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

CREATE OR REPLACE FUNCTION _corners(
    p_outline geometry, OUT n bigint, OUT x double precision, OUT y double precision,
    OUT dx double precision, OUT dy double precision
) RETURNS SETOF record
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    WITH vertex AS (
        SELECT d.path[2] AS n, _not_tiny(ST_X(d.geom)) AS x, _not_tiny(ST_Y(d.geom)) AS y
        FROM ST_DumpPoints(p_outline) d WHERE d.path[2] < ST_NPoints(p_outline)
    ), other AS (
        SELECT v.n, v.x, v.y, coalesce(lag(v.x) OVER w, last_value(v.x) OVER whole) AS x_before,
               coalesce(lag(v.y) OVER w, last_value(v.y) OVER whole) AS y_before,
               count(*) FILTER (WHERE (v.x, v.y) <> (f.x, f.y)) OVER () AS different
        FROM vertex v CROSS JOIN (SELECT u.x, u.y FROM vertex u WHERE u.n = 1) f
        WINDOW w AS (ORDER BY v.n), whole AS (ORDER BY v.n ROWS BETWEEN UNBOUNDED PRECEDING AND UNBOUNDED FOLLOWING)
    ), corner AS (
        SELECT row_number() OVER (ORDER BY o.n) AS n, o.x, o.y, count(*) OVER () AS size
        FROM other o WHERE (o.x, o.y) <> (o.x_before, o.y_before) OR (o.different = 0 AND o.n = 1)
    ), thin AS (
        SELECT a.x, a.y, b.x AS x2, b.y AS y2, coalesce((b.x - a.x) / l.m, 0) AS u, coalesce((b.y - a.y) / l.m, 1) AS v
        FROM corner a JOIN corner b ON b.n = b.size
        CROSS JOIN LATERAL (SELECT nullif(sqrt((b.x - a.x) ^ 2 + (b.y - a.y) ^ 2), 0) AS m) l
        WHERE a.n = 1 AND a.size <= 2
    ), edge AS (
        SELECT c.n, c.x, c.y, c.size, b.x - c.x AS u, b.y - c.y AS v, c.x * b.y - c.y * b.x AS doubled
        FROM corner c JOIN corner b ON b.n = c.n % c.size + 1 WHERE c.size > 2
    ), normal AS (
        SELECT e.n, e.x, e.y, e.size, w.way * e.v / sqrt(e.u ^ 2 + e.v ^ 2) AS u,
               -w.way * e.u / sqrt(e.u ^ 2 + e.v ^ 2) AS v
        FROM edge e CROSS JOIN (SELECT CASE WHEN sum(f.doubled) < 0 THEN -1 ELSE 1 END AS way FROM edge f) w
    )
    -- Where two sides meet: along the sum of their normals. A point or a line is a rectangle without size.
    SELECT c.n, c.x, c.y, (c.u + b.u) / nullif(1 + c.u * b.u + c.v * b.v, 0),
           (c.v + b.v) / nullif(1 + c.u * b.u + c.v * b.v, 0)
    FROM normal c JOIN normal b ON b.n = (c.n + c.size - 2) % c.size + 1
    UNION ALL
    SELECT s.n, CASE s.along WHEN -1 THEN t.x ELSE t.x2 END, CASE s.along WHEN -1 THEN t.y ELSE t.y2 END,
           s.along * t.u + s.side * t.v, s.along * t.v - s.side * t.u
    FROM thin t CROSS JOIN (VALUES (1, -1, 1), (2, 1, 1), (3, 1, -1), (4, -1, -1)) s (n, along, side);
END;
COMMENT ON FUNCTION _corners(geometry) IS
'The corners of an outline (metres), in turn, and how they move (metres per metre) when every side moves outward; null '
'at a corner without angle. Repeated vertices are one corner; a point is a square of size 0, a line a rectangle.';

CREATE OR REPLACE FUNCTION _grown_outline(p_outline geometry, p_by_m double precision) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_MakePolygon(ST_AddPoint(g.line, ST_StartPoint(g.line)))
    FROM (SELECT ST_MakeLine(ST_MakePoint(c.x + c.dx * p_by_m, c.y + c.dy * p_by_m) ORDER BY c.n) AS line
          FROM _corners(p_outline) c) g;
END;
COMMENT ON FUNCTION _grown_outline(geometry, double precision) IS
'An outline whose sides all moved outward by so many metres, corners mitred.';

CREATE OR REPLACE FUNCTION _outline_at(
    p_path geometry, p_outline geometry, p_grow_mps double precision, p_outlines geometry, p_waypoint integer
) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE
        WHEN p_outlines IS NOT NULL THEN ST_GeometryN(p_outlines, p_waypoint)
        WHEN p_grow_mps > 0 THEN _grown_outline(p_outline, p_grow_mps * (
            ST_M(ST_PointN(p_path, p_waypoint)) - ST_M(ST_StartPoint(p_path))))
        ELSE p_outline END;
END;
COMMENT ON FUNCTION _outline_at(geometry, geometry, double precision, geometry, integer) IS
'The outline of a haven (metres) at a waypoint of its path, counted from 1.';

CREATE OR REPLACE FUNCTION _outline_between(p_from geometry, p_to geometry, p_share double precision) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_MakePolygon(ST_MakeLine(ST_MakePoint(ST_X(a.geom) + p_share * (ST_X(b.geom) - ST_X(a.geom)),
                                                   ST_Y(a.geom) + p_share * (ST_Y(b.geom) - ST_Y(a.geom)))
                                      ORDER BY a.path[2]))
    FROM ST_DumpPoints(p_from) a JOIN ST_DumpPoints(p_to) b ON b.path = a.path;
END;
COMMENT ON FUNCTION _outline_between(geometry, geometry, double precision) IS
'The outline on the way from one to another of as many vertices, p_share from 0 to 1: each vertex moves straight.';

CREATE OR REPLACE FUNCTION haven_at(p_scene text, p_key text, p_instant timestamptz) RETURNS geometry
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene scene%ROWTYPE;
    v_track track%ROWTYPE;
    v_plane text;
    v_nr integer;
    v_leg record;
    v_starts_at timestamptz;
    v_progress double precision;
    v_mu double precision;
    v_lon_deg double precision;
    v_outline geometry;
    v_ring geometry;
BEGIN
    SELECT * INTO v_scene FROM scene s WHERE s.scene_id = _scene_id(p_scene);
    SELECT * INTO v_track FROM track t WHERE t.scene_id = v_scene.scene_id AND t.key = p_key;
    IF NOT FOUND THEN
        PERFORM _refuse('ZC011', format('track %L', p_key), 'key', format('is no track of scene %L', p_scene),
                        'object_known');
    END IF;
    -- At a waypoint the leg that starts there counts; the last instant belongs to none.
    SELECT max(d.path[1]) INTO v_nr FROM ST_DumpPoints(v_track.path) d WHERE to_timestamp(ST_M(d.geom)) <= p_instant;
    IF v_nr IS NULL OR v_nr = ST_NPoints(v_track.path) THEN
        RETURN NULL;
    END IF;
    v_starts_at := to_timestamp(ST_M(ST_PointN(v_track.path, v_nr)));
    v_progress := extract(epoch FROM p_instant - v_starts_at)
                  / extract(epoch FROM to_timestamp(ST_M(ST_PointN(v_track.path, v_nr + 1))) - v_starts_at);
    v_outline := CASE
        WHEN v_track.outlines IS NOT NULL THEN
            _outline_between(ST_GeometryN(v_track.outlines, v_nr), ST_GeometryN(v_track.outlines, v_nr + 1), v_progress)
        WHEN v_track.grow_mps > 0 THEN
            _grown_outline(v_track.outline, v_track.grow_mps * extract(
                epoch FROM p_instant - to_timestamp(ST_M(ST_StartPoint(v_track.path))))::double precision)
        ELSE v_track.outline END;
    IF v_scene.motion = 'great_circle' THEN
        v_ring := _circle_haven_at(v_track.path, v_outline, p_instant);
        v_ring := CASE ST_Dimension(ST_ConvexHull(v_outline))
                      WHEN 0 THEN ST_StartPoint(v_ring) WHEN 1 THEN ST_RemoveRepeatedPoints(v_ring) ELSE v_ring END;
        v_plane := _plane(v_scene.motion, v_scene.earth, v_scene.centre_lon, v_scene.centre_lat);
        v_ring := _to_plane(v_ring, v_plane);
        RETURN _wrapped(_from_plane(CASE WHEN ST_Dimension(ST_ConvexHull(v_outline)) = 2
                                         THEN ST_MakePolygon(v_ring) ELSE v_ring END, v_plane));
    END IF;
    SELECT * INTO v_leg
        FROM _legs(ST_MakeLine(ST_PointN(v_track.path, v_nr), ST_PointN(v_track.path, v_nr + 1)), v_scene.earth);
    IF v_leg.lon_step_deg = 0 AND v_leg.mu_step = 0 THEN
        -- Only a loiter's heading depends on the other legs.
        SELECT l.bearing_deg INTO v_leg.bearing_deg FROM _legs(v_track.path, v_scene.earth) l WHERE l.leg = v_nr;
    END IF;
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
              FROM (SELECT d.path[2] AS n, _not_tiny(ST_Y(d.geom)) / _rectifying_m(v_scene.earth) AS ahead,
                           _not_tiny(ST_X(d.geom)) / _rectifying_m(v_scene.earth) AS across,
                           v_mu + _not_tiny(ST_Y(d.geom)) / _rectifying_m(v_scene.earth) * cosd(v_leg.bearing_deg)
                               AS mu1
                    FROM ST_DumpPoints(v_outline) d) q) p;
    -- A haven may be a point or a line: its outline then repeats vertices.
    v_ring := CASE ST_Dimension(ST_ConvexHull(v_outline))
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

CREATE OR REPLACE FUNCTION heights_at(
    p_scene text, p_key text, p_instant timestamptz, OUT floor_m double precision, OUT ceiling_m double precision
)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT nullif(min(h.floor_m), '-infinity'), nullif(max(h.ceiling_m), 'infinity')
    FROM (SELECT CASE WHEN t.floors_m IS NULL THEN coalesce(t.floor_m, '-infinity')
                      ELSE coalesce(t.floors_m[n.leg], '-infinity') END AS floor_m,
                 CASE WHEN t.ceilings_m IS NULL THEN coalesce(t.ceiling_m, 'infinity')
                      ELSE coalesce(t.ceilings_m[n.leg], 'infinity') END AS ceiling_m
          FROM track t CROSS JOIN LATERAL generate_series(1, ST_NPoints(t.path) - 1) n (leg)
          WHERE t.scene_id = _scene_id(p_scene) AND t.key = p_key
            AND p_instant BETWEEN to_timestamp(ST_M(ST_PointN(t.path, n.leg)))
                              AND to_timestamp(ST_M(ST_PointN(t.path, n.leg + 1)))) h;
END;
COMMENT ON FUNCTION heights_at(text, text, timestamptz) IS
'The height band of a track at an instant, metres above mean sea level, null where there is no limit; at a waypoint it '
'holds the bands of both legs. Both are null, too, while the track is not under way.';

CREATE OR REPLACE FUNCTION _check_haven(
    p_who text, p_path geometry, p_outline geometry, p_earth text, p_grow_mps double precision, p_outlines geometry
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF (SELECT max(greatest(abs(e.mu + v.ahead), abs(e.mu + v.ahead - v.across)))
        FROM _legs(p_path, p_earth) l
        -- Latitudes are linear in time, also of a haven that grows.
        CROSS JOIN LATERAL (VALUES (l.mu, l.leg), (l.mu + l.mu_step, l.leg + 1)) e (mu, waypoint)
        CROSS JOIN LATERAL (SELECT _outline_at(p_path, p_outline, p_grow_mps, p_outlines, e.waypoint) AS outline
                            OFFSET 0) o
        CROSS JOIN LATERAL (SELECT _not_tiny(ST_Y(d.geom)) / _rectifying_m(p_earth) * cosd(l.bearing_deg) AS ahead,
                                   _not_tiny(ST_X(d.geom)) / _rectifying_m(p_earth) * sind(l.bearing_deg) AS across
                            FROM ST_DumpPoints(o.outline) d) v) > radians(89.5) THEN
        PERFORM _refuse('ZC005', p_who,
                        CASE WHEN p_outlines IS NOT NULL THEN 'outlines' WHEN p_grow_mps > 0 THEN 'grow_mps'
                             ELSE 'outline' END,
                        'the haven reaches beyond 89.5 degrees of latitude on one of its legs',
                        'haven_in_plane', 'The Mercator plane stretches without limit towards the poles.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_haven(text, geometry, geometry, text, double precision, geometry) IS
'Refuses a haven (metres) that leaves the Mercator plane on its path, as conflictdb.pieces.cutting.check_plane does.';
