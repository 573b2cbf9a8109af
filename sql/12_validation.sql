-- Rules that rows of scene, area and track must keep, whoever writes them; the same as those of conflictdb.model.
-- Rows are also brought into one form: spans half-open and unbounded rather than infinite.

CREATE OR REPLACE FUNCTION _half_open(p_span tstzrange) RETURNS tstzrange
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Instants are whole microseconds, so that an inclusive end is an exclusive one a microsecond later.
    SELECT CASE WHEN isempty(p_span) THEN p_span ELSE tstzrange(
        CASE WHEN lower(p_span) = '-infinity' THEN NULL
             WHEN lower_inc(p_span) OR lower_inf(p_span) THEN lower(p_span)
             ELSE lower(p_span) + interval '1 microsecond' END,
        CASE WHEN upper(p_span) = 'infinity' THEN NULL
             WHEN upper_inc(p_span) THEN upper(p_span) + interval '1 microsecond'
             ELSE upper(p_span) END) END;
END;
COMMENT ON FUNCTION _half_open(tstzrange) IS
'The same instants as [start, end); an infinite end becomes no end.';

CREATE OR REPLACE FUNCTION _check_common(p_who text, p_key text, p_floor_m double precision,
                                         p_ceiling_m double precision, p_properties jsonb) RETURNS void
LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    IF p_key IS NULL OR p_key = '' OR octet_length(p_key) > 1000 THEN
        PERFORM _refuse('ZC008', left(p_who, 100), 'key', 'must be a text of 1 to 1000 bytes', 'key_speakable');
    END IF;
    IF NOT (p_floor_m > '-infinity' AND p_floor_m < 'infinity') THEN
        PERFORM _refuse('ZC004', p_who, 'floor_m', 'must be a finite number of metres, or absent', 'heights_finite');
    END IF;
    IF NOT (p_ceiling_m > '-infinity' AND p_ceiling_m < 'infinity') THEN
        PERFORM _refuse('ZC004', p_who, 'ceiling_m', 'must be a finite number of metres, or absent', 'heights_finite');
    END IF;
    IF p_ceiling_m <= p_floor_m THEN
        PERFORM _refuse('ZC004', p_who, 'ceiling_m',
                        format('must be above floor_m (%s); got %s', p_floor_m, p_ceiling_m), 'ceiling_above_floor');
    END IF;
    IF jsonb_typeof(p_properties) IS DISTINCT FROM 'object' THEN
        PERFORM _refuse('ZC012', p_who, 'properties', 'must be a JSON object', 'properties_object');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_common(text, text, double precision, double precision, jsonb) IS
'Refuses what is wrong with the key, heights (metres) or properties of an object.';

CREATE OR REPLACE FUNCTION _check_coordinates(p_who text, p_field text, p_geometry geometry, p_scene_id bigint)
RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_latitude double precision := greatest(ST_YMax(p_geometry), -ST_YMin(p_geometry));
    v_longitude double precision := greatest(ST_XMax(p_geometry), -ST_XMin(p_geometry));
BEGIN
    -- The length of a line through a coordinate that is not finite is not finite either.
    IF NOT ST_Length(ST_MakeLine(ARRAY(SELECT d.geom FROM ST_DumpPoints(p_geometry) d))) < 'infinity' THEN
        PERFORM _refuse('ZC001', p_who, p_field, 'coordinates must be finite numbers', 'coordinates_finite');
    END IF;
    IF v_latitude > 90 THEN
        PERFORM _refuse('ZC005', p_who, p_field,
                        format('latitude must lie within +-90 degrees; got %s (is it longitude first?)', v_latitude),
                        'latitude_in_range');
    END IF;
    IF v_longitude > 360 THEN
        PERFORM _refuse('ZC005', p_who, p_field,
                        format('longitude must lie within +-360 degrees; got %s', v_longitude), 'longitude_in_range');
    END IF;
    IF v_latitude > 89 AND EXISTS (SELECT FROM scene s WHERE s.scene_id = p_scene_id AND s.motion = 'rhumb') THEN
        PERFORM _refuse('ZC005', p_who, p_field,
                        format('latitude beyond 89 degrees has no place in a scene with motion ''rhumb''; got %s',
                               v_latitude),
                        'latitude_in_plane', 'The Mercator plane stretches without limit towards the poles.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_coordinates(text, text, geometry, bigint) IS
'Refuses longitudes and latitudes (degrees) that are not finite, out of range or beyond the scene''s plane.';

CREATE OR REPLACE FUNCTION _area_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text := format('area %L', NEW.key);
    v_reason text;
BEGIN
    NEW.active_span := _half_open(coalesce(NEW.active_span, tstzrange(NULL, NULL)));
    NEW.properties := coalesce(NEW.properties, '{}');
    IF TG_OP = 'UPDATE' THEN
        IF NEW.scene_id <> OLD.scene_id OR NEW.area_id <> OLD.area_id THEN
            PERFORM _refuse('ZC008', v_who, 'scene_id', 'cannot change; remove the object and put it anew', 'object_stays');
        END IF;
        NEW.version := OLD.version;
        IF (NEW.key, NEW.footprint, NEW.active_span, NEW.floor_m, NEW.ceiling_m)
           IS NOT DISTINCT FROM (OLD.key, OLD.footprint, OLD.active_span, OLD.floor_m, OLD.ceiling_m)
           AND jsonb_typeof(NEW.properties) = 'object' THEN
            RETURN NEW;
        END IF;
    END IF;
    -- One test for the good row; only a bad one pays for finding out why.
    IF (NEW.key <> '' AND octet_length(NEW.key) <= 1000 AND jsonb_typeof(NEW.properties) = 'object'
        AND (NEW.floor_m > '-infinity' AND NEW.floor_m < 'infinity') IS NOT FALSE
        AND (NEW.ceiling_m > '-infinity' AND NEW.ceiling_m < 'infinity') IS NOT FALSE
        AND (NEW.ceiling_m > NEW.floor_m) IS NOT FALSE) IS NOT TRUE THEN
        PERFORM _check_common(v_who, NEW.key, NEW.floor_m, NEW.ceiling_m, NEW.properties);
    END IF;
    IF NEW.footprint IS NULL OR ST_IsEmpty(NEW.footprint) THEN
        PERFORM _refuse('ZC001', v_who, 'footprint', 'must be a non-empty MultiPolygon', 'footprint_not_empty');
    END IF;
    v_reason := ST_IsValidReason(NEW.footprint);
    IF NOT (v_reason = 'Valid Geometry' AND ST_YMax(NEW.footprint) <= 89 AND ST_YMin(NEW.footprint) >= -89
            AND ST_XMax(NEW.footprint) <= 360 AND ST_XMin(NEW.footprint) >= -360) THEN
        PERFORM _check_coordinates(v_who, 'footprint', NEW.footprint, NEW.scene_id);
        IF v_reason <> 'Valid Geometry' THEN
            PERFORM _refuse('ZC001', v_who, 'footprint', 'must be a valid polygon: ' || v_reason, 'footprint_valid',
                            'ST_MakeValid mends many polygons.');
        END IF;
    END IF;
    IF ST_XMax(NEW.footprint) - ST_XMin(NEW.footprint) > 360 THEN
        PERFORM _refuse('ZC005', v_who, 'footprint', 'must not be wider than 360 degrees', 'footprint_within_a_turn');
    END IF;
    IF isempty(NEW.active_span) THEN
        PERFORM _refuse('ZC003', v_who, 'active_span', 'must hold at least one instant: end must be later than start',
                        'span_not_empty');
    END IF;
    IF lower(NEW.active_span) < '0001-01-01 00:00+00' OR upper(NEW.active_span) >= '10000-01-01 00:00+00' THEN
        PERFORM _refuse('ZC003', v_who, 'active_span', 'must lie in the years 1 to 9999', 'span_in_calendar',
                        'Leave an end out where there is none.');
    END IF;
    NEW.version := nextval('version_seq');
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _area_before() IS
'Trigger: refuses a bad area (SQLSTATE class ZC), brings its span into one form, gives changed content a new version.';

CREATE OR REPLACE FUNCTION _check_times(p_who text, p_path geometry) RETURNS void
LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_bad record;
BEGIN
    SELECT p.n, p.m, p.m <= p.before AND p.moved AS at_two_places INTO v_bad
    FROM (SELECT d.path[1] - 1 AS n, round(ST_M(d.geom) * 1e6) AS m,
                 lag(round(ST_M(d.geom) * 1e6)) OVER w AS before,
                 NOT ST_Equals(d.geom, lag(d.geom) OVER w) AND round(ST_M(d.geom) * 1e6) = lag(round(ST_M(d.geom) * 1e6)) OVER w
                     AS moved
          FROM ST_DumpPoints(p_path) d WINDOW w AS (ORDER BY d.path[1])) p
    WHERE NOT (p.m >= -62135596800e6 AND p.m < 253402300800e6) OR p.m <= p.before
    ORDER BY p.n LIMIT 1;
    IF FOUND AND NOT (v_bad.m >= -62135596800e6 AND v_bad.m < 253402300800e6) THEN
        PERFORM _refuse('ZC003', p_who, 'path', format('times[%s] must lie in the years 1 to 9999 (M is Unix seconds)', v_bad.n),
                        'path_in_calendar');
    ELSIF FOUND THEN
        PERFORM _refuse('ZC002', p_who, 'path',
                        format('times[%s] %s', v_bad.n, CASE WHEN v_bad.at_two_places THEN 'is at two places at the same time'
                               ELSE 'must be later than the time before it' END),
                        'path_time_increasing', 'M is Unix seconds, told apart to the microsecond.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_times(text, geometry) IS
'Refuses a path whose M (Unix seconds) is outside the years 1 to 9999 or does not increase by a microsecond at least.';

CREATE OR REPLACE FUNCTION _check_outline(p_who text, p_outline geometry) RETURNS void
LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_left boolean;
    v_right boolean;
    v_turns double precision;
BEGIN
    -- Corners as in conflictdb.model: rounding of the coordinates turns a straight one by the slack at most.
    WITH vertex AS (
        SELECT d.path[2] AS n, ST_X(d.geom) AS x, ST_Y(d.geom) AS y
        FROM ST_DumpPoints(p_outline) d WHERE d.path[2] < ST_NPoints(p_outline)
    ), edge AS (
        SELECT v.n, coalesce(lead(v.x) OVER w, first_value(v.x) OVER w) - v.x AS dx,
               coalesce(lead(v.y) OVER w, first_value(v.y) OVER w) - v.y AS dy,
               8 * 2.220446049250313e-16 * max(greatest(abs(v.x), abs(v.y))) OVER () ^ 2 AS slack
        FROM vertex v WINDOW w AS (ORDER BY v.n)
    ), corner AS (
        SELECT e.dx * coalesce(lead(e.dy) OVER w, first_value(e.dy) OVER w)
               - e.dy * coalesce(lead(e.dx) OVER w, first_value(e.dx) OVER w) AS turn, e.slack
        FROM edge e WINDOW w AS (ORDER BY e.n)
    ), heading AS (
        SELECT e.n, atan2(e.dy, e.dx) - lag(atan2(e.dy, e.dx)) OVER (ORDER BY e.n) AS step
        FROM edge e WHERE e.dx <> 0 OR e.dy <> 0
    )
    SELECT bool_or(c.turn > c.slack), bool_or(c.turn < -c.slack),
           (SELECT abs(sum(h.step - 2 * pi() * round((h.step / (2 * pi()))::numeric)::double precision)) FROM heading h)
        INTO v_left, v_right, v_turns FROM corner c;
    IF (v_left AND v_right) OR v_turns > 2 * pi() + 1e-9 THEN
        PERFORM _refuse('ZC006', p_who, 'outline', 'must be a convex ring', 'outline_convex',
                        'Split it into several tracks, or use ST_ConvexHull.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_outline(text, geometry) IS
'Refuses an outline (starboard and forward metres) that turns both ways or more than once round.';

CREATE OR REPLACE FUNCTION _track_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text := format('track %L', NEW.key);
    v_times geometry;
BEGIN
    NEW.properties := coalesce(NEW.properties, '{}');
    IF TG_OP = 'UPDATE' THEN
        IF NEW.scene_id <> OLD.scene_id OR NEW.track_id <> OLD.track_id THEN
            PERFORM _refuse('ZC008', v_who, 'scene_id', 'cannot change; remove the object and put it anew', 'object_stays');
        END IF;
        NEW.version := OLD.version;
        IF (NEW.key, NEW.path, NEW.outline, NEW.floor_m, NEW.ceiling_m)
           IS NOT DISTINCT FROM (OLD.key, OLD.path, OLD.outline, OLD.floor_m, OLD.ceiling_m)
           AND jsonb_typeof(NEW.properties) = 'object' THEN
            RETURN NEW;
        END IF;
    END IF;
    IF (NEW.key <> '' AND octet_length(NEW.key) <= 1000 AND jsonb_typeof(NEW.properties) = 'object'
        AND (NEW.floor_m > '-infinity' AND NEW.floor_m < 'infinity') IS NOT FALSE
        AND (NEW.ceiling_m > '-infinity' AND NEW.ceiling_m < 'infinity') IS NOT FALSE
        AND (NEW.ceiling_m > NEW.floor_m) IS NOT FALSE) IS NOT TRUE THEN
        PERFORM _check_common(v_who, NEW.key, NEW.floor_m, NEW.ceiling_m, NEW.properties);
    END IF;
    IF NEW.path IS NULL OR ST_NPoints(NEW.path) < 2 THEN
        PERFORM _refuse('ZC001', v_who, 'path', 'needs at least two waypoints', 'path_of_two');
    END IF;
    -- X and M change places: the length of a line through a coordinate that is not finite is not finite either.
    IF NOT (ST_Length(NEW.path) < 'infinity' AND ST_Length(ST_SwapOrdinates(NEW.path, 'xm')) < 'infinity') THEN
        PERFORM _refuse('ZC001', v_who, 'path', 'coordinates and times must be finite numbers', 'coordinates_finite');
    END IF;
    IF NOT (ST_YMax(NEW.path) <= 89 AND ST_YMin(NEW.path) >= -89
            AND ST_XMax(NEW.path) <= 360 AND ST_XMin(NEW.path) >= -360) THEN
        PERFORM _check_coordinates(v_who, 'path', NEW.path, NEW.scene_id);
    END IF;
    -- Snapped to microseconds, waypoints that fall on one instant either vanish or stop M from increasing.
    v_times := ST_SnapToGrid(NEW.path, ST_MakePoint(0, 0), 0, 0, 0, 1e-6);
    IF ST_NPoints(v_times) < ST_NPoints(NEW.path) OR NOT ST_IsValidTrajectory(v_times)
       OR ST_M(ST_StartPoint(NEW.path)) < -62135596800 OR ST_M(ST_EndPoint(NEW.path)) >= 253402300800 THEN
        PERFORM _check_times(v_who, NEW.path);
    END IF;
    IF NEW.outline IS NULL OR ST_IsEmpty(NEW.outline) OR ST_NumInteriorRings(NEW.outline) > 0
       OR NOT ST_Length(ST_ExteriorRing(NEW.outline)) < 'infinity' OR ST_SRID(NEW.outline) <> 0 THEN
        PERFORM _refuse('ZC006', v_who, 'outline',
                        'must be one ring of finite [starboard, forward] metres, without SRID', 'outline_ring');
    END IF;
    IF abs(ST_Area(ST_ConvexHull(NEW.outline)) - ST_Area(NEW.outline)) > 1e-12 * ST_Area(NEW.outline) THEN
        PERFORM _check_outline(v_who, NEW.outline);
    END IF;
    -- A degree of latitude has 110,574 m at least.
    IF greatest(ST_YMax(NEW.path), -ST_YMin(NEW.path))
       + ST_MaxDistance(ST_MakePoint(0, 0), NEW.outline) / 110574 > 89.5 THEN
        PERFORM _check_haven(v_who, NEW.path, NEW.outline, s.earth)
            FROM scene s WHERE s.scene_id = NEW.scene_id AND s.motion = 'rhumb';
    END IF;
    NEW.version := nextval('version_seq');
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _track_before() IS
'Trigger: refuses a bad track (SQLSTATE class ZC) and gives changed content a new version.';

CREATE OR REPLACE FUNCTION _scene_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text := format('scene %L', NEW.name);
BEGIN
    IF NEW.name IS NULL OR btrim(NEW.name) = '' OR octet_length(NEW.name) > 1000 THEN
        PERFORM _refuse('ZC008', 'scene', 'name', 'must be a non-empty text of at most 1000 bytes', 'scene_name_speakable');
    END IF;
    IF (NEW.motion IN ('rhumb')) IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'motion', format('must be one of rhumb; got %L', NEW.motion), 'scene_motion_known');
    END IF;
    IF (NEW.earth IN ('wgs84', 'sphere')) IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'earth', format('must be one of wgs84, sphere; got %L', NEW.earth), 'scene_earth_known');
    END IF;
    IF (NEW.method IN ('screen', 'window', 'nlp')) IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'method', format('must be one of screen, window, nlp; got %L', NEW.method),
                        'scene_method_known');
    END IF;
    IF (NEW.tolerance_m >= 0 AND NEW.tolerance_m < 'infinity') IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'tolerance_m', 'must be a finite number of metres, 0 or more', 'scene_tolerance_finite');
    END IF;
    IF (NEW.separation_m >= 0 AND NEW.separation_m < 'infinity') IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'separation_m', 'must be a finite number of metres, 0 or more', 'scene_separation_finite');
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _scene_before() IS 'Trigger: refuses bad settings of a scene (SQLSTATE class ZC).';

CREATE OR REPLACE TRIGGER scene_before BEFORE INSERT OR UPDATE ON scene
    FOR EACH ROW EXECUTE FUNCTION _scene_before();
CREATE OR REPLACE TRIGGER area_before BEFORE INSERT OR UPDATE ON area
    FOR EACH ROW EXECUTE FUNCTION _area_before();
CREATE OR REPLACE TRIGGER track_before BEFORE INSERT OR UPDATE ON track
    FOR EACH ROW EXECUTE FUNCTION _track_before();
