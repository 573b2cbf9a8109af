-- Position of havens: of one track at an instant, and of all tracks at many instants.

CREATE OR REPLACE FUNCTION conflictdb_internal._leg_with_heading(
    p_path geometry, p_leg integer, p_motion text, p_earth text, OUT line geometry, OUT leg integer
)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- A loiter has the heading of the previous moving leg, else of the next one.
    WITH end_of AS MATERIALIZED (
        SELECT ST_PointN(p_path, p_leg) AS first, ST_PointN(p_path, p_leg + 1) AS last
    ), loiter AS MATERIALIZED (
        SELECT e.* FROM end_of e WHERE NOT _is_moving(e.first, e.last, p_motion, p_earth)
    ), step AS (
        SELECT d.path[1] AS n, d.geom AS first, lead(d.geom) OVER (ORDER BY d.path[1]) AS last
        FROM loiter l CROSS JOIN LATERAL ST_DumpPoints(p_path) d
    ), moving AS (
        SELECT s.* FROM step s
        WHERE s.last IS NOT NULL AND _is_moving(s.first, s.last, p_motion, p_earth)
        ORDER BY s.n > p_leg, abs(s.n - p_leg) LIMIT 1
    )
    SELECT CASE WHEN m.n < p_leg THEN ST_MakeLine(ARRAY[m.first, e.first, e.last])
                WHEN m.n > p_leg THEN ST_MakeLine(ARRAY[e.first, e.last, m.last])
                ELSE ST_MakeLine(e.first, e.last) END,
           CASE WHEN m.n < p_leg THEN 2 ELSE 1 END
    FROM end_of e LEFT JOIN moving m ON true;
END;
COMMENT ON FUNCTION _leg_with_heading(geometry, integer, text, text) IS
'One leg of a path, counted from 1, as a line; for a loiter with the moving leg that gives its heading. leg: number of '
'the leg in this line.';

CREATE OR REPLACE FUNCTION conflictdb_internal._leg_havens(
    p_motion text, p_earth text, p_plane text, p_path geometry, p_outline geometry, p_grow_mps double precision,
    p_outlines geometry, p_leg integer, p_instants timestamptz[]
) RETURNS TABLE (at timestamptz, haven geometry)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_part record;
    v_leg record;
    v_begins_at timestamptz := to_timestamp(ST_M(ST_StartPoint(p_path)));
    v_from geometry;
    v_to geometry;
    v_progress double precision;
    v_mu double precision;
    v_outline geometry := p_outline;
    v_ring geometry;
BEGIN
    SELECT * INTO v_part FROM _leg_with_heading(p_path, p_leg, p_motion, p_earth);
    IF p_motion = 'great_circle' THEN
        SELECT * INTO v_leg FROM _circle_legs(v_part.line) l WHERE l.leg = v_part.leg;
    ELSE
        SELECT * INTO v_leg FROM _legs(v_part.line, p_earth) l WHERE l.leg = v_part.leg;
    END IF;
    v_from := ST_GeometryN(p_outlines, p_leg);
    v_to := ST_GeometryN(p_outlines, p_leg + 1);
    FOREACH at IN ARRAY p_instants LOOP
        v_progress := extract(epoch FROM at - v_leg.starts_at) / extract(epoch FROM v_leg.ends_at - v_leg.starts_at);
        IF p_outlines IS NOT NULL THEN
            v_outline := _outline_between(v_from, v_to, v_progress);
        ELSIF p_grow_mps > 0 THEN
            v_outline := _grown_outline(
                p_outline, p_grow_mps * extract(epoch FROM at - v_begins_at)::double precision);
        END IF;
        IF p_motion = 'great_circle' THEN
            v_ring := _circle_vertices(v_leg.start, v_leg.heading, v_leg.angle * v_progress, v_outline);
            v_ring := _to_plane(v_ring, p_plane);
        ELSE
            v_mu := v_leg.mu + v_progress * v_leg.mu_step;
            v_ring := _rhumb_vertices(
                v_leg.lon_deg + v_leg.lon_step_deg * v_progress * _stretch(v_leg.mu, v_mu, p_earth)
                                / _stretch(v_leg.mu, v_leg.mu + v_leg.mu_step, p_earth),
                v_mu, v_leg.bearing_deg, v_outline, p_earth);
        END IF;
        -- The outline of a point or line repeats vertices.
        haven := CASE ST_Dimension(ST_ConvexHull(v_outline))
                     WHEN 0 THEN ST_StartPoint(v_ring) WHEN 1 THEN ST_RemoveRepeatedPoints(v_ring)
                     ELSE ST_MakePolygon(v_ring) END;
        IF p_motion = 'great_circle' THEN
            haven := _from_plane(haven, p_plane);
        END IF;
        haven := _wrapped(haven);
        RETURN NEXT;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _leg_havens(text, text, text, geometry, geometry, double precision, geometry, integer,
                                timestamptz[]) IS
'Havens (outlines in metres) at instants on one leg of a path, counted from 1: longitude and latitude, degrees, '
'wrapped.';

CREATE OR REPLACE FUNCTION haven_at(p_scene text, p_key text, p_instant timestamptz) RETURNS geometry
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene scene%ROWTYPE;
    v_track track%ROWTYPE;
    v_leg integer;
BEGIN
    SELECT * INTO v_scene FROM scene s WHERE s.scene_id = _scene_or_branch(p_scene);
    SELECT * INTO v_track FROM _seen_tracks(v_scene.scene_id) t WHERE t.key = p_key;
    IF NOT FOUND THEN
        FOUND := _raise('ZC011', format('track %L', p_key), 'key', format('is not a track of scene %L', p_scene),
                        'object_known');
    END IF;
    IF v_track.schedule IS NOT NULL THEN
        PERFORM _warn_if_beyond_horizon(p_scene, tstzrange(p_instant, p_instant, '[]'));
    END IF;
    IF v_track.departures IS NOT NULL THEN
        -- As on the voyage that the path describes; before the first departure there is none.
        IF cardinality(v_track.departures) = 0 OR p_instant < v_track.departures[1] THEN
            RETURN NULL;
        END IF;
        p_instant := p_instant - _shift(v_track.path, v_track.departures, p_instant);
    END IF;
    -- A waypoint belongs to the leg that starts there; the last waypoint to none.
    SELECT max(d.path[1]) INTO v_leg FROM ST_DumpPoints(v_track.path) d WHERE to_timestamp(ST_M(d.geom)) <= p_instant;
    IF v_leg IS NULL OR v_leg = ST_NPoints(v_track.path) THEN
        RETURN NULL;
    END IF;
    RETURN (SELECT h.haven FROM _leg_havens(
        v_scene.motion, v_scene.earth,
        _plane(v_scene.motion, v_scene.earth, v_scene.centre_lon, v_scene.centre_lat), v_track.path, v_track.outline,
        v_track.grow_mps, v_track.outlines, v_leg, ARRAY[p_instant]) h);
END
$$;
COMMENT ON FUNCTION haven_at(text, text, timestamptz) IS
'The haven of a track at an instant: longitude and latitude in degrees, exact on the scene''s earth, split at the '
'antimeridian; null before the first waypoint and from the last one on. A haven without size is a point, without width '
'a line. Raises ZC010 or ZC011 for an unknown scene or track.';

CREATE OR REPLACE FUNCTION conflictdb_internal._most_havens() RETURNS integer
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT 100000;
END;
COMMENT ON FUNCTION _most_havens() IS
'Greatest number of rows that havens returns, and of instants: about a minute''s work.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_instants(
    p_from timestamptz, p_to timestamptz, p_step interval
) RETURNS timestamptz[]
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_who CONSTANT text := 'havens';
    v_instants timestamptz[];
BEGIN
    IF (p_from >= '0001-01-01 00:00+00' AND p_to < '10000-01-01 00:00+00' AND p_from <= p_to) IS NOT TRUE THEN
        FOUND := _raise('ZC003', c_who, 'p_from, p_to',
                        format('must be two instants in order, in the years 1 to 9999; got %s to %s',
                               coalesce(p_from::text, 'null'), coalesce(p_to::text, 'null')), 'havens_span');
    END IF;
    IF (p_step > interval '0' AND p_step <= interval '10000 years') IS NOT TRUE THEN
        FOUND := _raise('ZC003', c_who, 'p_step',
                        format('must be positive, and at most 10000 years; got %s', coalesce(p_step::text, 'null')),
                        'havens_step_positive');
    END IF;
    -- In the SELECT list, where LIMIT stops the series; in FROM all rows would be computed first.
    v_instants := ARRAY(SELECT generate_series(p_from, p_to, p_step) LIMIT _most_havens() + 1);
    IF cardinality(v_instants) > _most_havens() THEN
        FOUND := _raise('ZC003', c_who, 'p_step',
                        format('%s gives more than %s instants from %s to %s', p_step, _most_havens(), p_from, p_to),
                        'havens_at_most', 'Take a longer step, or a shorter time.');
    END IF;
    RETURN v_instants;
END
$$;
COMMENT ON FUNCTION _check_instants(timestamptz, timestamptz, interval) IS
'Instants from p_from to p_to by p_step; raises ZC003 if there are none, or more than _most_havens().';

CREATE OR REPLACE FUNCTION havens(p_scene text, p_from timestamptz, p_to timestamptz, p_step interval)
RETURNS TABLE (
    key text, at timestamptz, haven geometry, floor_m double precision, ceiling_m double precision
)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_before CONSTANT interval := interval '1 microsecond';
    v_scene scene%ROWTYPE;
    v_plane text;
    v_instants timestamptz[];
    v_rows bigint;
    v_track track%ROWTYPE;
    v_leg record;
BEGIN
    SELECT * INTO v_scene FROM scene s WHERE s.scene_id = _scene_or_branch(p_scene);
    v_plane := _plane(v_scene.motion, v_scene.earth, v_scene.centre_lon, v_scene.centre_lat);
    v_instants := _check_instants(p_from, p_to, p_step);
    PERFORM _warn_if_beyond_horizon(p_scene, tstzrange(p_from, p_to, '[]'));
    -- width_bucket counts the instants before a waypoint.
    SELECT sum(width_bucket(to_timestamp(ST_M(ST_EndPoint(t.path))) + v.later - c_before, v_instants)
               - width_bucket(to_timestamp(ST_M(ST_StartPoint(t.path))) + v.later - c_before, v_instants)) INTO v_rows
        FROM _seen_tracks(v_scene.scene_id) t CROSS JOIN LATERAL _voyages(t.path, t.departures) v;
    IF v_rows > _most_havens() THEN
        FOUND := _raise('ZC003', 'havens', 'p_step',
                        format('%s gives %s havens from %s to %s: more than %s', p_step, v_rows, p_from, p_to,
                               _most_havens()), 'havens_at_most', 'Take a longer step, or a shorter time.');
    END IF;
    FOR v_track IN
        SELECT t.* FROM _seen_tracks(v_scene.scene_id) t
        WHERE _at_sea(t.path, t.departures) && tstzrange(p_from, p_to, '[]')
        ORDER BY t.key LOOP
        -- Copied into memory: otherwise every leg would read the stored path again.
        v_track.path := ST_SetSRID(v_track.path, 4326);
        FOR v_leg IN
            SELECT d.n, v_instants[b.first + 1:b.last] AS instants, d.starts_at, d.later
            FROM (SELECT p.path[1] AS n, to_timestamp(ST_M(p.geom)) + v.later AS starts_at,
                         lead(to_timestamp(ST_M(p.geom)) + v.later) OVER (PARTITION BY v.later ORDER BY p.path[1])
                             AS ends_at, v.later
                  FROM _voyages(v_track.path, v_track.departures) v
                  CROSS JOIN LATERAL ST_DumpPoints(v_track.path) p) d
            CROSS JOIN LATERAL (SELECT width_bucket(d.starts_at - c_before, v_instants) AS first,
                                       width_bucket(d.ends_at - c_before, v_instants) AS last) b
            WHERE d.ends_at IS NOT NULL AND b.first < b.last ORDER BY d.later, d.n LOOP
            RETURN QUERY
                SELECT v_track.key, h.at + v_leg.later, h.haven, b.floor_m, b.ceiling_m
                FROM _leg_havens(v_scene.motion, v_scene.earth, v_plane, v_track.path, v_track.outline,
                                 v_track.grow_mps, v_track.outlines, v_leg.n,
                                 ARRAY(SELECT u.at - v_leg.later FROM unnest(v_leg.instants) u (at))) h
                -- At a waypoint, the heights of both legs.
                CROSS JOIN LATERAL _heights_on(
                    v_track.floor_m, v_track.ceiling_m, v_track.floors_m, v_track.ceilings_m, v_track.path,
                    v_leg.n - (v_leg.n > 1 AND h.at + v_leg.later = v_leg.starts_at)::integer, v_leg.n, h.at) b;
        END LOOP;
    END LOOP;
END
$$;
COMMENT ON FUNCTION havens(text, timestamptz, timestamptz, interval) IS
'Havens of all tracks of a scene at the instants from p_from to p_to by p_step: one row per track and instant while it '
'is under way, ordered by key, then instant. haven as from haven_at; floor_m and ceiling_m as from heights_at. Areas '
'are not included: they do not move (table area). Raises ZC003 for a step that is not positive, or for more than '
'100,000 havens.';
