-- Rows of scene, area and track must keep the rules, whoever writes them.
-- Rows are also brought into one form: spans half-open and unbounded rather than infinite.

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
            PERFORM _refuse('ZC008', v_who, 'scene_id', 'cannot change; remove the object and put it anew',
                            'object_stays');
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
    PERFORM _check_planar(v_who, NEW.footprint, s.earth) FROM scene s WHERE s.scene_id = NEW.scene_id;
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

CREATE OR REPLACE FUNCTION _track_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text := format('track %L', NEW.key);
    v_times geometry;
    v_widest geometry;
BEGIN
    NEW.properties := coalesce(NEW.properties, '{}');
    NEW.grow_mps := coalesce(NEW.grow_mps, 0);
    NEW.outline := coalesce(NEW.outline, ST_GeometryN(NEW.outlines, 1));
    IF TG_OP = 'UPDATE' THEN
        IF NEW.scene_id <> OLD.scene_id OR NEW.track_id <> OLD.track_id THEN
            PERFORM _refuse('ZC008', v_who, 'scene_id', 'cannot change; remove the object and put it anew',
                            'object_stays');
        END IF;
        NEW.version := OLD.version;
        IF (NEW.key, NEW.path, NEW.outline, NEW.floor_m, NEW.ceiling_m, NEW.grow_mps, NEW.outlines)
           IS NOT DISTINCT FROM (OLD.key, OLD.path, OLD.outline, OLD.floor_m, OLD.ceiling_m, OLD.grow_mps, OLD.outlines)
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
    v_widest := NEW.outline;
    IF NEW.grow_mps <> 0 OR NEW.outlines IS NOT NULL THEN
        PERFORM _check_growth(v_who, NEW.path, NEW.outline, NEW.grow_mps, NEW.outlines);
        v_widest := coalesce(NEW.outlines, _grown_outline(
            NEW.outline, NEW.grow_mps * (ST_M(ST_EndPoint(NEW.path)) - ST_M(ST_StartPoint(NEW.path)))));
    END IF;
    -- A degree of latitude has 110,574 m at least.
    IF greatest(ST_YMax(NEW.path), -ST_YMin(NEW.path))
       + ST_MaxDistance(ST_MakePoint(0, 0), v_widest) / 110574 > 89.5 THEN
        PERFORM _check_haven(v_who, NEW.path, NEW.outline, s.earth, NEW.grow_mps, NEW.outlines)
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
        PERFORM _refuse('ZC008', 'scene', 'name', 'must be a non-empty text of at most 1000 bytes',
                        'scene_name_speakable');
    END IF;
    IF (NEW.motion IN ('rhumb')) IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'motion', format('must be one of rhumb; got %L', NEW.motion),
                        'scene_motion_known');
    END IF;
    IF (NEW.earth IN ('wgs84', 'sphere')) IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'earth', format('must be one of wgs84, sphere; got %L', NEW.earth),
                        'scene_earth_known');
    END IF;
    IF (NEW.method IN ('screen', 'window', 'exact', 'nlp')) IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'method',
                        format('must be one of screen, window, exact, nlp; got %L', NEW.method), 'scene_method_known');
    END IF;
    IF (NEW.tolerance_m >= 0 AND NEW.tolerance_m < 'infinity') IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'tolerance_m', 'must be a finite number of metres, 0 or more',
                        'scene_tolerance_finite');
    END IF;
    IF (NEW.separation_m >= 0 AND NEW.separation_m < 'infinity') IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'separation_m', 'must be a finite number of metres, 0 or more',
                        'scene_separation_finite');
    END IF;
    IF (NEW.nearest_m >= 0 AND NEW.nearest_m < 'infinity') IS NOT TRUE THEN
        PERFORM _refuse('ZC009', v_who, 'nearest_m', 'must be a finite number of metres, 0 or more',
                        'scene_nearest_finite');
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
