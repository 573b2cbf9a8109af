-- Position of havens on great circles, exact: the motion model of conflictdb.earth.gnomonic.
--
-- Places and headings are unit vectors, arrays of three. At an angle along a leg the reference point is at
-- cos(angle) start + sin(angle) heading. A vertex is one great-circle step ahead, then one to starboard.

CREATE OR REPLACE FUNCTION conflictdb_internal._mixed(
    p_one double precision[], p_share double precision, p_other double precision[], p_other_share double precision
) RETURNS double precision[]
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ARRAY[p_one[1] * p_share + p_other[1] * p_other_share, p_one[2] * p_share + p_other[2] * p_other_share,
                 p_one[3] * p_share + p_other[3] * p_other_share];
END;
COMMENT ON FUNCTION _mixed(double precision[], double precision, double precision[], double precision) IS
'Returns p_one * p_share + p_other * p_other_share, for vectors of three.';

CREATE OR REPLACE FUNCTION conflictdb_internal._circle_legs(
    p_path geometry, OUT leg integer, OUT starts_at timestamptz, OUT ends_at timestamptz,
    OUT start double precision[], OUT heading double precision[], OUT angle double precision
) RETURNS SETOF record
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_leg record;
    v_kept double precision[];
BEGIN
    FOR v_leg IN
        WITH waypoint AS (
            SELECT d.path[1] AS n, to_timestamp(ST_M(d.geom)) AS at,
                   _not_tiny(ST_X(d.geom)) AS lon, _not_tiny(ST_Y(d.geom)) AS lat
            FROM ST_DumpPoints(p_path) d
        ), step AS (
            SELECT w.*, lead(w.at) OVER o AS next_at, lead(w.lat) OVER o AS next_lat,
                   lead(w.lon) OVER o - w.lon AS turn
            FROM waypoint w WINDOW o AS (ORDER BY w.n)
        ), way AS (
            -- East and north components times the sine of the length, from differences: accurate for short legs.
            SELECT s.*, cosd(s.next_lat) * sind(s.turn) AS east,
                   sin(radians(s.next_lat - s.lat))
                   + 2 * sind(s.lat) * cosd(s.next_lat) * sin(radians(s.turn - 360 * round(s.turn / 360)) / 2) ^ 2
                       AS north,
                   sind(s.lat) * sind(s.next_lat) + cosd(s.lat) * cosd(s.next_lat) * cosd(s.turn) AS cosine,
                   ARRAY[-sind(s.lon), cosd(s.lon), 0] AS to_east,
                   ARRAY[-sind(s.lat) * cosd(s.lon), -sind(s.lat) * sind(s.lon), cosd(s.lat)] AS to_north
            FROM step s WHERE s.next_at IS NOT NULL
        ), leg AS (
            SELECT w.*, sqrt(w.east ^ 2 + w.north ^ 2) AS sine FROM way w
        )
        SELECT l.n, l.at, l.next_at, ARRAY[cosd(l.lat) * cosd(l.lon), cosd(l.lat) * sind(l.lon), sind(l.lat)] AS start,
               CASE WHEN l.sine > 0 THEN _mixed(l.to_east, l.east / l.sine, l.to_north, l.north / l.sine) END
                   AS heading,
               -- Loiters before the first moving leg have its heading.
               first_value(CASE WHEN l.sine > 0 THEN _mixed(l.to_east, l.east / l.sine, l.to_north, l.north / l.sine)
                           END) OVER (ORDER BY l.sine > 0 DESC, l.n) AS first_heading,
               l.to_north, CASE WHEN l.sine > 0 THEN atan2(l.sine, l.cosine) ELSE 0 END AS angle
        FROM leg l ORDER BY l.n
    LOOP
        leg := v_leg.n;
        starts_at := v_leg.at;
        ends_at := v_leg.next_at;
        start := v_leg.start;
        angle := v_leg.angle;
        -- A loiter has the final heading of the previous moving leg, else of the next one, else north.
        heading := coalesce(v_leg.heading, v_kept, v_leg.first_heading, v_leg.to_north);
        v_kept := CASE WHEN v_leg.heading IS NULL THEN v_kept
                       ELSE _mixed(heading, cos(angle), start, -sin(angle)) END;
        RETURN NEXT;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _circle_legs(geometry) IS
'Legs of a path on great circles: times, unit vectors of the start and of the heading there, length (radians).';

CREATE OR REPLACE FUNCTION conflictdb_internal._circle_vertices(
    p_start double precision[], p_heading double precision[], p_angle double precision, p_outline geometry
) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    WITH corner AS (
        SELECT d.path[2] AS n, _not_tiny(ST_X(d.geom)) / _sphere_m() AS across,
               _mixed(p_start, cos(p_angle + _not_tiny(ST_Y(d.geom)) / _sphere_m()),
                      p_heading, sin(p_angle + _not_tiny(ST_Y(d.geom)) / _sphere_m())) AS ahead
        FROM ST_DumpPoints(p_outline) d
    ), vertex AS (
        SELECT c.n, _mixed(c.ahead, cos(c.across), ARRAY[
                   p_heading[2] * p_start[3] - p_heading[3] * p_start[2],
                   p_heading[3] * p_start[1] - p_heading[1] * p_start[3],
                   p_heading[1] * p_start[2] - p_heading[2] * p_start[1]], sin(c.across)) AS place
        FROM corner c
    )
    SELECT ST_SetSRID(ST_MakeLine(ST_MakePoint(degrees(atan2(v.place[2], v.place[1])),
                                               degrees(atan2(v.place[3], sqrt(v.place[1] ^ 2 + v.place[2] ^ 2))))
                                  ORDER BY v.n), 4326)
    FROM vertex v;
END;
COMMENT ON FUNCTION _circle_vertices(double precision[], double precision[], double precision, geometry) IS
'Vertices of a haven (outline in metres) at an angle (radians) along a leg: longitude and latitude, degrees, each '
'within +-180.';

CREATE OR REPLACE FUNCTION conflictdb_internal._sag(
    p_angle double precision, p_first geometry, p_last geometry
) RETURNS double precision
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT max(2 * abs((p_angle + v.ahead) * v.across) * sin(v.widest) + v.across ^ 2) / 8
    FROM (SELECT _not_tiny(ST_Y(b.geom) - ST_Y(a.geom)) / _sphere_m() AS ahead,
                 _not_tiny(ST_X(b.geom) - ST_X(a.geom)) / _sphere_m() AS across,
                 _not_tiny(greatest(abs(ST_X(a.geom)), abs(ST_X(b.geom)))) / _sphere_m() AS widest
          FROM ST_DumpPoints(p_first) a JOIN ST_DumpPoints(p_last) b ON b.path = a.path) v;
END;
COMMENT ON FUNCTION _sag(double precision, geometry, geometry) IS
'Bound on the drop of the cosine of a vertex''s angle from the centre, within a leg (radians), below its values at '
'both ends, if the outline changes from p_first to p_last (metres).';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_haven_near_centre(
    p_who text, p_path geometry, p_outline geometry, p_centre_lon double precision, p_centre_lat double precision,
    p_grow_mps double precision, p_outlines geometry
) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_changes boolean := p_grow_mps > 0 OR p_outlines IS NOT NULL;
    v_widest geometry := coalesce(p_outlines, _outline_at(p_path, p_outline, p_grow_mps, NULL, ST_NPoints(p_path)));
    v_most_deg CONSTANT double precision := CASE WHEN v_changes THEN 30 ELSE 60 END;
    v_reach_deg double precision := degrees(ST_MaxDistance(ST_MakePoint(0, 0), v_widest) / _sphere_m());
BEGIN
    -- A vertex is at most sqrt(2) times the reach of the outline from its reference point, as it takes two steps.
    IF _from_centre_deg(p_path, p_centre_lon, p_centre_lat) + sqrt(2) * v_reach_deg <= 60 THEN
        RETURN;
    END IF;
    -- On a leg a vertex is farthest at one of the ends, except for the bound _sag if the outline changes.
    IF v_reach_deg > v_most_deg OR EXISTS (
        SELECT FROM _circle_legs(p_path) l
        CROSS JOIN LATERAL (SELECT _outline_at(p_path, p_outline, p_grow_mps, p_outlines, l.leg) AS first,
                                   _outline_at(p_path, p_outline, p_grow_mps, p_outlines, l.leg + 1) AS last
                            OFFSET 0) o
        CROSS JOIN LATERAL (VALUES (0.0, o.first), (l.angle, o.last)) e (angle, outline)
        WHERE _from_centre_deg(_circle_vertices(l.start, l.heading, e.angle, e.outline), p_centre_lon, p_centre_lat)
              > CASE WHEN v_changes THEN degrees(acos(least(0.5 + _sag(l.angle, o.first, o.last), 1))) ELSE 60 END
                + 1e-9) THEN
        FOUND := _raise('ZC005', p_who,
                        CASE WHEN p_outlines IS NOT NULL THEN 'outlines' WHEN p_grow_mps > 0 THEN 'grow_mps'
                             ELSE 'outline' END,
                        format('the haven reaches beyond 60 degrees from the scene''s centre (%s, %s) on one of '
                               'its legs',
                               p_centre_lon, p_centre_lat),
                        'haven_near_centre',
                        'Give the scene a centre in the middle of its objects, split it, or use motion ''rhumb''.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_haven_near_centre(text, geometry, geometry, double precision, double precision,
                                             double precision, geometry) IS
'Raises ZC005 for a haven (outline in metres) that leaves the gnomonic plane on its path, as check_plane of '
'conflictdb.core.pieces does.';
