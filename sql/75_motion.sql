-- Position of havens on rhumb lines, exact: the motion model of conflictdb.earth.mercator.
--
-- Distance along a meridian is proportional to the rectifying latitude mu; the conformal latitude chi gives the
-- Mercator ordinate psi = asinh(tan chi). A rhumb line is straight in (longitude, psi) and its length is linear in mu.
-- So each step needs one quantity, (psi2 - psi1) / (mu2 - mu1), computed without cancellation on east-west lines.
--
-- Series of order 6 in the third flattening of WGS84: C. F. F. Karney, J. Geodesy 85 (2011),
-- doi:10.1007/s00190-011-0445-3, eq. 36 (chi of mu); J. P. Snyder, Map Projections (1987), eqs. 3-20, 3-26
-- (mu and latitude), carried to order 6.
-- Omitted terms are below 1e-17 radians.

CREATE OR REPLACE FUNCTION conflictdb_internal._series(
    p_angle double precision, p_coefficients double precision[]
) RETURNS double precision
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_sum double precision := 0;
BEGIN
    -- Smallest terms first, for accuracy.
    FOR j IN REVERSE cardinality(p_coefficients)..1 LOOP
        v_sum := v_sum + p_coefficients[j] * sin(2 * j * p_angle);
    END LOOP;
    RETURN p_angle + v_sum;
END
$$;
COMMENT ON FUNCTION _series(double precision, double precision[]) IS
'Returns the angle (radians) plus the sum over j of p_coefficients[j] * sin(2 j angle).';

CREATE OR REPLACE FUNCTION conflictdb_internal._rectifying_m(p_earth text) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_earth WHEN 'sphere' THEN _sphere_m() ELSE 6367449.1458234153 END::double precision;
END;
COMMENT ON FUNCTION _rectifying_m(text) IS 'Metres of meridian per radian of rectifying latitude.';

CREATE OR REPLACE FUNCTION conflictdb_internal._rectifying(
    p_latitude double precision, p_earth text
) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_earth WHEN 'sphere' THEN p_latitude ELSE _series(p_latitude, ARRAY[
        -0.0025188279161202296627, 2.6435410598113799292e-6, -3.4526234225354141111e-9, 4.8918220519771715152e-12,
        -7.2287258683472357452e-15, 1.0958479860708544708e-17]::double precision[]) END;
END;
COMMENT ON FUNCTION _rectifying(double precision, text) IS 'Rectifying latitude from geographic latitude, radians.';

CREATE OR REPLACE FUNCTION conflictdb_internal._latitude(
    p_rectifying double precision, p_earth text
) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE p_earth WHEN 'sphere' THEN p_rectifying ELSE _series(p_rectifying, ARRAY[
        0.0025188265843977032707, 3.700949035657531109e-6, 7.4477702699759963203e-9, 1.7035857112600327458e-11,
        4.178161827657265913e-14, 1.0706431174734805386e-16]::double precision[]) END;
END;
COMMENT ON FUNCTION _latitude(double precision, text) IS 'Geographic latitude from rectifying latitude, radians.';

CREATE OR REPLACE FUNCTION conflictdb_internal._stretch(p_from double precision, p_to double precision, p_earth text)
RETURNS double precision
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_conformal CONSTANT double precision[] := CASE p_earth WHEN 'sphere' THEN ARRAY[]::double precision[] ELSE ARRAY[
        -0.00083773216405794868232, -5.9058701522202033771e-8, -1.6734826652839967562e-10, -2.1647980400627058961e-13,
        -3.7879780461686052188e-16, -7.2487488906941543992e-19] END;
    v_way CONSTANT double precision := p_to - p_from;
    v_ratio double precision := 0;  -- (chi2 - chi1) / (mu2 - mu1)
    v_from CONSTANT double precision := _series(p_from, c_conformal);
    v_to CONSTANT double precision := _series(p_to, c_conformal);
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
    v_cosine := cos((v_from + v_to) / 2);
    v_sine := sin(v_half) / v_cosine;
    RETURN CASE WHEN v_sine = 0 THEN v_ratio / v_cosine
                -- Long lines: nothing cancels here, while v_sine approaches 1 between points near both poles.
                WHEN abs(v_way) > 0.5 THEN (asinh(tan(v_to)) - asinh(tan(v_from))) / v_way
                ELSE 2 * atanh(v_sine) / v_way END;
END
$$;
COMMENT ON FUNCTION _stretch(double precision, double precision, text) IS
'(psi2 - psi1) / (mu2 - mu1) between two rectifying latitudes (radians); the limit if they are equal.';

CREATE OR REPLACE FUNCTION conflictdb_internal._legs(
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
    -- A loiter has the heading of the previous moving leg, else of the next one, else north.
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
'Legs of a path: times, start and change of longitude (degrees) and of rectifying latitude (radians), heading '
'(degrees).';

CREATE OR REPLACE FUNCTION conflictdb_internal._corners(
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
    -- A corner moves along the sum of its sides' normals. A point or line is a rectangle of size or width 0.
    SELECT c.n, c.x, c.y, (c.u + b.u) / nullif(1 + c.u * b.u + c.v * b.v, 0),
           (c.v + b.v) / nullif(1 + c.u * b.u + c.v * b.v, 0)
    FROM normal c JOIN normal b ON b.n = (c.n + c.size - 2) % c.size + 1
    UNION ALL
    SELECT s.n, CASE s.along WHEN -1 THEN t.x ELSE t.x2 END, CASE s.along WHEN -1 THEN t.y ELSE t.y2 END,
           s.along * t.u + s.side * t.v, s.along * t.v - s.side * t.u
    FROM thin t CROSS JOIN (VALUES (1, -1, 1), (2, 1, 1), (3, 1, -1), (4, -1, -1)) s (n, along, side);
END;
COMMENT ON FUNCTION _corners(geometry) IS
'Corners of an outline (metres) in order, and their displacement (metres) per metre that every side moves outward; '
'null at a corner without angle. Repeated vertices count once; a point is a square of size 0, a line a rectangle of '
'width 0.';

CREATE OR REPLACE FUNCTION conflictdb_internal._grown_outline(
    p_outline geometry, p_by_m double precision
) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_MakePolygon(ST_AddPoint(g.line, ST_StartPoint(g.line)))
    FROM (SELECT ST_MakeLine(ST_MakePoint(c.x + c.dx * p_by_m, c.y + c.dy * p_by_m) ORDER BY c.n) AS line
          FROM _corners(p_outline) c) g;
END;
COMMENT ON FUNCTION _grown_outline(geometry, double precision) IS
'Returns an outline with all sides moved outward by p_by_m metres, corners mitred.';

CREATE OR REPLACE FUNCTION conflictdb_internal._outline_at(
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
'Returns the outline of a haven (metres) at a waypoint, counted from 1.';

CREATE OR REPLACE FUNCTION conflictdb_internal._outline_between(
    p_from geometry, p_to geometry, p_share double precision
) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_MakePolygon(ST_MakeLine(ST_MakePoint(ST_X(a.geom) + p_share * (ST_X(b.geom) - ST_X(a.geom)),
                                                   ST_Y(a.geom) + p_share * (ST_Y(b.geom) - ST_Y(a.geom)))
                                      ORDER BY a.path[2]))
    FROM ST_DumpPoints(p_from) a JOIN ST_DumpPoints(p_to) b ON b.path = a.path;
END;
COMMENT ON FUNCTION _outline_between(geometry, geometry, double precision) IS
'Interpolates vertices linearly between two outlines with equal numbers of vertices; p_share from 0 to 1.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_moving(
    p_first geometry, p_last geometry, p_motion text, p_earth text
) RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- As in _legs and _circle_legs: a full turn around the earth, or any turn at a pole, is not movement.
    SELECT w.lon_deg - 360 * round(w.lon_deg / 360) <> 0 AND (p_motion = 'rhumb' OR abs(w.lat_deg) < 90)
           OR w.lat_deg <> w.next_lat_deg
              AND _rectifying(radians(w.lat_deg), p_earth) <> _rectifying(radians(w.next_lat_deg), p_earth)
    FROM (SELECT _not_tiny(ST_X(p_last)) - _not_tiny(ST_X(p_first)) AS lon_deg, _not_tiny(ST_Y(p_first)) AS lat_deg,
                 _not_tiny(ST_Y(p_last)) AS next_lat_deg) w;
END;
COMMENT ON FUNCTION _is_moving(geometry, geometry, text, text) IS
'Whether a leg between two points (longitude and latitude, degrees) moves; otherwise it is a loiter.';

CREATE OR REPLACE FUNCTION conflictdb_internal._rhumb_vertices(
    p_lon_deg double precision, p_mu double precision, p_bearing_deg double precision, p_outline geometry, p_earth text
) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Two rhumb steps per vertex: ahead along the heading, then to starboard.
    SELECT ST_SetSRID(ST_MakeLine(ST_MakePoint(
               p_lon_deg + degrees(p.ahead * sind(p_bearing_deg) * _stretch(p_mu, p.mu1, p_earth)
                                   + p.across * cosd(p_bearing_deg) * _stretch(p.mu1, p.mu2, p_earth)),
               degrees(_latitude(p.mu2, p_earth))) ORDER BY p.n), 4326)
    FROM (SELECT q.*, q.mu1 - q.across * sind(p_bearing_deg) AS mu2
          FROM (SELECT d.path[2] AS n, _not_tiny(ST_Y(d.geom)) / _rectifying_m(p_earth) AS ahead,
                       _not_tiny(ST_X(d.geom)) / _rectifying_m(p_earth) AS across,
                       p_mu + _not_tiny(ST_Y(d.geom)) / _rectifying_m(p_earth) * cosd(p_bearing_deg) AS mu1
                FROM ST_DumpPoints(p_outline) d) q) p;
END;
COMMENT ON FUNCTION _rhumb_vertices(double precision, double precision, double precision, geometry, text) IS
'Vertices of a haven (outline in metres) with its reference point at a longitude (degrees) and a rectifying latitude '
'(radians) and a heading (degrees): longitude and latitude, degrees, not wrapped.';

CREATE OR REPLACE FUNCTION conflictdb_internal._height_on(
    p_whole_m double precision, p_heights_m double precision[], p_path geometry, p_leg integer, p_instant timestamptz
) RETURNS double precision
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Exact at both ends of the leg.
    SELECT CASE WHEN p_heights_m IS NULL THEN p_whole_m
                WHEN cardinality(p_heights_m) < ST_NPoints(p_path) OR p_heights_m[p_leg] = p_heights_m[p_leg + 1]
                THEN p_heights_m[p_leg]
                ELSE (1 - s.share) * p_heights_m[p_leg] + s.share * p_heights_m[p_leg + 1] END
    FROM (SELECT least(greatest(extract(epoch FROM p_instant - to_timestamp(ST_M(ST_PointN(p_path, p_leg))))
                                / extract(epoch FROM to_timestamp(ST_M(ST_PointN(p_path, p_leg + 1)))
                                                     - to_timestamp(ST_M(ST_PointN(p_path, p_leg)))), 0), 1
                 )::double precision AS share) s;
END;
COMMENT ON FUNCTION _height_on(double precision, double precision[], geometry, integer, timestamptz) IS
'Height (metres; null: no limit) on a leg at an instant, from that of the track, of its legs, or of its waypoints.';

CREATE OR REPLACE FUNCTION conflictdb_internal._heights_on(
    p_floor_m double precision, p_ceiling_m double precision, p_floors_m double precision[],
    p_ceilings_m double precision[], p_path geometry, p_first integer, p_last integer, p_instant timestamptz,
    OUT floor_m double precision, OUT ceiling_m double precision
)
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT nullif(min(coalesce(_height_on(p_floor_m, p_floors_m, p_path, n.leg, p_instant), '-infinity')), '-infinity'),
           nullif(max(coalesce(_height_on(p_ceiling_m, p_ceilings_m, p_path, n.leg, p_instant), 'infinity')),
                  'infinity')
    FROM generate_series(p_first, p_last) n (leg);
END;
COMMENT ON FUNCTION _heights_on(double precision, double precision, double precision[], double precision[], geometry,
                                integer, integer, timestamptz) IS
'Height band (metres; null: no limit) of legs p_first to p_last of a track at an instant.';

CREATE OR REPLACE FUNCTION heights_at(
    p_scene text, p_key text, p_instant timestamptz, OUT floor_m double precision, OUT ceiling_m double precision
)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT h.floor_m, h.ceiling_m
    FROM _seen_tracks(_scene_or_branch(p_scene)) t
    -- As on the voyage that the path describes.
    CROSS JOIN LATERAL (SELECT p_instant - _shift(t.path, t.departures, p_instant) AS at) v
    CROSS JOIN LATERAL (SELECT min(n.leg) AS first, max(n.leg) AS last
                        FROM generate_series(1, ST_NPoints(t.path) - 1) n (leg)
                        WHERE v.at BETWEEN to_timestamp(ST_M(ST_PointN(t.path, n.leg)))
                                   AND to_timestamp(ST_M(ST_PointN(t.path, n.leg + 1)))
                          AND (t.departures IS NULL OR p_instant >= t.departures[1])) l
    CROSS JOIN LATERAL _heights_on(t.floor_m, t.ceiling_m, t.floors_m, t.ceilings_m, t.path, l.first, l.last, v.at) h
    WHERE t.key = p_key;
END;
COMMENT ON FUNCTION heights_at(text, text, timestamptz) IS
'Height band of a track at an instant, metres above the vertical datum; null: no limit. At a waypoint it includes the '
'bands of both legs. Both are also null before the first and after the last waypoint.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_haven(
    p_who text, p_path geometry, p_outline geometry, p_earth text, p_grow_mps double precision, p_outlines geometry
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF (SELECT max(greatest(abs(e.mu + v.ahead), abs(e.mu + v.ahead - v.across)))
        FROM _legs(p_path, p_earth) l
        -- Latitudes are linear in time, also of a growing haven.
        CROSS JOIN LATERAL (VALUES (l.mu, l.leg), (l.mu + l.mu_step, l.leg + 1)) e (mu, waypoint)
        CROSS JOIN LATERAL (SELECT _outline_at(p_path, p_outline, p_grow_mps, p_outlines, e.waypoint) AS outline
                            OFFSET 0) o
        CROSS JOIN LATERAL (SELECT _not_tiny(ST_Y(d.geom)) / _rectifying_m(p_earth) * cosd(l.bearing_deg) AS ahead,
                                   _not_tiny(ST_X(d.geom)) / _rectifying_m(p_earth) * sind(l.bearing_deg) AS across
                            FROM ST_DumpPoints(o.outline) d) v) > radians(89.5) THEN
        FOUND := _raise('ZC005', p_who,
                        CASE WHEN p_outlines IS NOT NULL THEN 'outlines' WHEN p_grow_mps > 0 THEN 'grow_mps'
                             ELSE 'outline' END,
                        'the haven reaches beyond 89.5 degrees of latitude on one of its legs',
                        'haven_in_plane', 'The Mercator plane stretches without limit towards the poles.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_haven(text, geometry, geometry, text, double precision, geometry) IS
'Raises ZC005 for a haven (outline in metres) that leaves the Mercator plane on its path, as check_plane of '
'conflictdb.core.pieces does.';
