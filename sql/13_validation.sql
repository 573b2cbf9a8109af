-- Triggers that check rows of scene, area and track, whoever writes them, and normalise them: spans become half-open,
-- infinite bounds become unbounded. Shapes of usual new rows are checked once per statement, all others row by row.

CREATE OR REPLACE FUNCTION conflictdb_internal._ensure_centre(
    p_scene_id bigint, p_first geometry, OUT centre_lon double precision, OUT centre_lat double precision
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
BEGIN
    UPDATE scene s SET (centre_lon, centre_lat) = (SELECT ST_X(m.place), ST_Y(m.place)
                                                   FROM _middle_of(p_first) AS m (place))
        WHERE s.scene_id = p_scene_id AND s.centre_lon IS NULL;
    SELECT s.centre_lon, s.centre_lat INTO centre_lon, centre_lat FROM scene s WHERE s.scene_id = p_scene_id;
END
$$;
COMMENT ON FUNCTION _ensure_centre(bigint, geometry) IS
'Sets the centre of a great-circle scene without one to the middle of its first object; returns the centre (degrees).';

CREATE OR REPLACE FUNCTION conflictdb_internal._first_version(p_kind smallint, p_id bigint) RETURNS bigint
LANGUAGE plpgsql VOLATILE STRICT SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_former bigint;
BEGIN
    -- One query: it runs for each new object.
    SELECT max(f.version) INTO v_former
        FROM (SELECT p.version FROM piece p WHERE p.object_kind = p_kind AND p.object_id = p_id
              UNION ALL
              SELECT c.a_version FROM conflict c WHERE c.a_kind = p_kind AND c.a_id = p_id
              UNION ALL
              SELECT c.b_version FROM conflict c WHERE c.b_kind = p_kind AND c.b_id = p_id) f;
    -- The sequence alone is not enough: a restore may set it back.
    RETURN greatest(nextval('version_seq'), 1 + v_former);
END
$$;
COMMENT ON FUNCTION _first_version(smallint, bigint) IS
'Returns the version of a new object: greater than all stored versions of a former object with the same id. Runs as '
'its owner, because the former object may belong to a scene that the caller cannot read. Restricted to the versions of '
'one id; returns only a number.';

CREATE OR REPLACE FUNCTION conflictdb_internal._may_expand() RETURNS boolean
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT has_column_privilege('scene'::regclass::oid, 'expanded', 'UPDATE');
END;
COMMENT ON FUNCTION _may_expand() IS 'Whether the current role may say when schedules are active: workers, restores.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_once(p_activations tstzmultirange, p_schedule jsonb)
RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT p_activations IS NULL AND p_schedule IS NULL;
END;
COMMENT ON FUNCTION _is_once(tstzmultirange, jsonb) IS
'Whether an area has one span, so that _areas_inserted checks its footprint. Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_usual_footprint(
    p_footprint geometry, p_motion text, p_earth text, p_centre_lon double precision, p_centre_lat double precision,
    p_max_vertices double precision
) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Operator @ compares bounding boxes.
    SELECT ST_NumGeometries(p_footprint) = 1 AND ST_NPoints(p_footprint) BETWEEN 1 AND p_max_vertices
           AND p_footprint @ ST_MakeEnvelope(-180, -89, 180, 89, 4326)
           AND ST_IsValidReason(p_footprint) = 'Valid Geometry'
           AND CASE p_motion
                   -- Within 180 degrees _to_plane does only this.
                   WHEN 'rhumb' THEN p_earth = 'wgs84'
                                     AND ST_IsValidReason(ST_Transform(p_footprint, 3395)) = 'Valid Geometry'
                   ELSE p_centre_lon IS NOT NULL
                        AND _box_is_near_centre(p_footprint, p_centre_lon, p_centre_lat)
                        AND _stays_simple(p_footprint) END;
END;
COMMENT ON FUNCTION _is_usual_footprint(geometry, text, text, double precision, double precision, double precision) IS
'Whether a footprint certainly has no error in a scene of these settings; most have none. Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_area_shape(
    p_who text, p_scene_id bigint, p_footprint geometry, p_max_vertices double precision
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_reason text;
    v_scene record;
BEGIN
    SELECT s.motion, s.earth, s.centre_lon, s.centre_lat INTO v_scene FROM scene s WHERE s.scene_id = p_scene_id;
    IF _is_usual_footprint(p_footprint, v_scene.motion, v_scene.earth, v_scene.centre_lon, v_scene.centre_lat,
                           p_max_vertices) THEN
        RETURN;
    END IF;
    -- PostGIS does not report a ring without points as empty, but does not dump it either.
    IF p_footprint IS NULL OR ST_IsEmpty(p_footprint) OR ST_NPoints(p_footprint) = 0
       OR (SELECT count(*) FROM ST_Dump(p_footprint) d WHERE ST_NPoints(d.geom) > 0) < ST_NumGeometries(p_footprint)
    THEN
        FOUND := _raise('ZC001', p_who, 'footprint', 'must be a MultiPolygon without empty parts',
                        'footprint_not_empty');
    END IF;
    IF ST_NPoints(p_footprint) > p_max_vertices THEN
        PERFORM _check_size(p_who, 'footprint', ST_NPoints(p_footprint), 'max_vertices');
    END IF;
    v_reason := ST_IsValidReason(p_footprint);
    IF NOT (v_reason = 'Valid Geometry' AND ST_YMax(p_footprint) <= 89 AND ST_YMin(p_footprint) >= -89
            AND ST_XMax(p_footprint) <= 360 AND ST_XMin(p_footprint) >= -360) THEN
        PERFORM _check_coordinates(p_who, 'footprint', p_footprint, p_scene_id);
        IF v_reason <> 'Valid Geometry' THEN
            FOUND := _raise('ZC001', p_who, 'footprint', 'must be a valid polygon: ' || v_reason, 'footprint_valid',
                            'ST_MakeValid mends many polygons.');
        END IF;
    END IF;
    IF ST_XMax(p_footprint) - ST_XMin(p_footprint) > 360 THEN
        FOUND := _raise('ZC005', p_who, 'footprint', 'must not be wider than 360 degrees', 'footprint_within_a_turn');
    END IF;
    IF v_scene.motion = 'great_circle' THEN
        IF v_scene.centre_lon IS NULL THEN
            SELECT c.* INTO v_scene.centre_lon, v_scene.centre_lat FROM _ensure_centre(p_scene_id, p_footprint) c;
        END IF;
        PERFORM _check_near_centre(p_who, 'footprint', p_footprint, v_scene.centre_lon, v_scene.centre_lat);
    END IF;
    PERFORM _check_planar(p_who, p_footprint, _plane(v_scene.motion, v_scene.earth, v_scene.centre_lon,
                                                     v_scene.centre_lat));
END
$$;
COMMENT ON FUNCTION _check_area_shape(text, bigint, geometry, double precision) IS
'Raises SQLSTATE class ZC for a footprint that is invalid, outside the plane of its scene, or of more than '
'p_max_vertices vertices, the limit of this session. Gives a great-circle scene without a centre one.';

CREATE OR REPLACE FUNCTION conflictdb_internal._area_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text;
BEGIN
    -- One expression accepts usual new rows; all others pay for the checks one by one. _areas_inserted checks their
    -- footprints, all at once; not of replicated rows, for which no trigger of a statement runs.
    IF TG_OP = 'INSERT' AND NEW.first_version = 0 AND current_setting('session_replication_role') <> 'replica'
       AND _is_once(NEW.activations, NEW.schedule) AND NEW.schedule_error IS NULL AND NEW.footprint IS NOT NULL
       AND NEW.key <> '' AND octet_length(NEW.key) <= 1000 AND _is_plain(NEW.properties)
       AND (NEW.class NOT IN ('area', 'track')) IS NOT FALSE
       /* area checked: AND VALID(NEW) */
       AND (octet_length(NEW.class) BETWEEN 1 AND 200) IS NOT FALSE
       AND (octet_length(NEW.owner) BETWEEN 1 AND 200) IS NOT FALSE
       /* end */
       AND NOT (NEW.properties ? 'vertical_datum')
       AND (NEW.floor_m > '-infinity' AND NEW.floor_m < 'infinity') IS NOT FALSE
       AND (NEW.ceiling_m > '-infinity' AND NEW.ceiling_m < 'infinity') IS NOT FALSE
       AND (NEW.ceiling_m > NEW.floor_m) IS NOT FALSE
       AND NOT isempty(NEW.active_span) AND (lower_inc(NEW.active_span) OR lower_inf(NEW.active_span))
       AND NOT upper_inc(NEW.active_span)
       AND (lower(NEW.active_span) >= '0001-01-01 00:00+00' AND lower(NEW.active_span) < '10000-01-01 00:00+00')
           IS NOT FALSE
       AND (upper(NEW.active_span) > '0001-01-01 00:00+00' AND upper(NEW.active_span) < '10000-01-01 00:00+00')
           IS NOT FALSE
    THEN
        NEW.version := nextval('version_seq');
        NEW.first_version := NEW.version;
        RETURN NEW;
    END IF;
    v_who := format('area %L', NEW.key);
    NEW.active_span := coalesce(NEW.active_span, tstzrange(NULL, NULL));
    IF upper_inc(NEW.active_span) OR NOT (lower_inc(NEW.active_span) OR lower_inf(NEW.active_span))
       OR lower(NEW.active_span) = '-infinity' OR upper(NEW.active_span) = 'infinity' THEN
        NEW.active_span := _half_open(NEW.active_span, _is_closed(NEW.scene_id));
    END IF;
    NEW.properties := coalesce(NEW.properties, '{}');
    -- As object-relational mappers write None.
    /* area documents: NEW.NAME := nullif(NEW.NAME, 'null'); */
    NEW.schedule := nullif(NEW.schedule, 'null');
    /* end */
    IF NEW.schedule IS NOT NULL AND NOT _may_expand() THEN
        -- Only a detection expands it: other activations would hide conflicts.
        NEW.activations := CASE WHEN TG_OP = 'UPDATE' AND OLD.schedule IS NOT NULL THEN OLD.activations END;
        NEW.schedule_error := CASE TG_OP WHEN 'UPDATE' THEN OLD.schedule_error END;
    END IF;
    NEW.schedule_error := CASE WHEN NEW.schedule IS NOT NULL THEN NEW.schedule_error END;
    IF NOT _is_plain(jsonb_build_object('', NEW.schedule)) THEN
        FOUND := _raise('ZC012', v_who, 'schedule', 'must be nested at most 99 deep, with numbers up to 1.8e308',
                        'schedule_plain');
    END IF;
    IF TG_OP = 'UPDATE' THEN
        IF NEW.schedule IS NOT NULL THEN
            -- Its expansion stays until a detection replaces it, unless it depends on something else now.
            NEW.activations := CASE WHEN (NEW.schedule, NEW.active_span, NEW.footprint)
                                         IS NOT DISTINCT FROM (OLD.schedule, OLD.active_span, OLD.footprint)
                                    THEN coalesce(NEW.activations, OLD.activations) END;
            NEW.schedule_error := CASE WHEN NEW.activations IS NOT NULL THEN NEW.schedule_error END;
        ELSIF NEW.active_span IS DISTINCT FROM OLD.active_span
              AND NEW.active_span IS DISTINCT FROM range_merge(NEW.activations) THEN
            -- Another span, unless there are other activations, too.
            NEW.activations := nullif(NEW.activations, OLD.activations);
        END IF;
    END IF;
    IF NEW.activations IS NOT NULL THEN
        NEW.activations := _half_open(NEW.activations, _is_closed(NEW.scene_id));
        IF NEW.schedule IS NULL AND NOT isempty(NEW.activations) THEN
            NEW.active_span := range_merge(NEW.activations);
        END IF;
    END IF;
    IF NEW.properties ? 'vertical_datum' AND num_nonnulls(NEW.floor_m, NEW.ceiling_m) > 0 THEN
        PERFORM _check_datum(v_who, NEW.scene_id, NEW.properties ->> 'vertical_datum');
    END IF;
    IF TG_OP = 'UPDATE' THEN
        IF NEW.scene_id <> OLD.scene_id OR NEW.area_id <> OLD.area_id THEN
            FOUND := _raise('ZC008', v_who, 'scene_id', 'cannot change: remove the object and add it again',
                            'object_stays');
        END IF;
        -- Only _after_object_change raises them, of a new object.
        IF (NEW.version > OLD.version AND NEW.first_version = NEW.version AND _may_expand()) IS NOT TRUE THEN
            NEW.version := OLD.version;
            NEW.first_version := OLD.first_version;
        END IF;
        IF (
            NEW.key,
            /* area answers: NEW.NAME */
            NEW.footprint, NEW.active_span, NEW.floor_m, NEW.ceiling_m, NEW.class, NEW.owner, NEW.schedule
            /* end */
        ) IS NOT DISTINCT FROM (
            OLD.key,
            /* area answers: OLD.NAME */
            OLD.footprint, OLD.active_span, OLD.floor_m, OLD.ceiling_m, OLD.class, OLD.owner, OLD.schedule
            /* end */
        )
           /* area checked: AND VALID(NEW) */
           AND (octet_length(NEW.class) BETWEEN 1 AND 200) IS NOT FALSE
           AND (octet_length(NEW.owner) BETWEEN 1 AND 200) IS NOT FALSE
           /* end */
           AND _is_plain(NEW.properties) THEN
            -- Activations need no check of the footprint, which takes longer than all else when schedules are expanded.
            IF (NEW.activations, NEW.schedule_error) IS DISTINCT FROM (OLD.activations, OLD.schedule_error) THEN
                NEW.version := greatest(nextval('version_seq'), OLD.version + 1);
            END IF;
            RETURN NEW;
        END IF;
    END IF;
    PERFORM _check_common(v_who, NEW.key, NEW.floor_m, NEW.ceiling_m, NEW.properties, NEW.class);
    /* area checked: CHECK(NEW) */
    PERFORM _check_word(v_who, 'class', NEW.class);
    PERFORM _check_word(v_who, 'owner', NEW.owner);
    /* end */
    -- A restore or replica brings areas accepted elsewhere under another limit; only they provide first_version.
    PERFORM _check_area_shape(v_who, NEW.scene_id, NEW.footprint, CASE
        WHEN TG_OP = 'INSERT' AND NEW.first_version > 0 OR current_setting('session_replication_role') = 'replica'
        THEN 1000000 ELSE _limit('max_vertices') END);
    IF isempty(NEW.active_span) THEN
        FOUND := _raise('ZC003', v_who, 'active_span',
                        'must hold at least one instant: end must be later than start', 'span_not_empty');
    END IF;
    -- A present bound is checked on both sides: without the other bound it could lie beyond the calendar.
    IF lower(NEW.active_span) < '0001-01-01 00:00+00' OR lower(NEW.active_span) >= '10000-01-01 00:00+00'
       OR upper(NEW.active_span) <= '0001-01-01 00:00+00' OR upper(NEW.active_span) >= '10000-01-01 00:00+00' THEN
        FOUND := _raise('ZC003', v_who, 'active_span', 'must lie in the years 1 to 9999', 'span_in_calendar',
                        'Leave out a bound if there is none.');
    END IF;
    IF TG_OP = 'UPDATE' THEN
        -- Greater than the previous version, even if a restore set the sequence back.
        NEW.version := greatest(nextval('version_seq'), OLD.version + 1);
        RETURN NEW;
    END IF;
    NEW.version := _first_version(0::smallint, NEW.area_id);
    -- A restore provides first_version, so that restored conflicts keep referring to this object.
    IF (NEW.first_version BETWEEN 1 AND NEW.version) IS NOT TRUE THEN
        NEW.first_version := NEW.version;
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _area_before() IS
'Trigger: checks an area (SQLSTATE class ZC), normalises its span, and sets a new version if its content changed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._in_microseconds(p_path geometry) RETURNS geometry
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_SnapToGrid(p_path, ST_MakePoint(0, 0), 0, 0, 0, 1e-6);
END;
COMMENT ON FUNCTION _in_microseconds(geometry) IS
'A path whose times are whole microseconds: simultaneous waypoints are removed, or their times do not increase. '
'Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_steady(
    /* track few: p_NAME TYPE */
    p_grow_mps double precision, p_outlines geometry, p_floors_m double precision[], p_ceilings_m double precision[],
    p_tolerances jsonb, p_departures timestamptz[], p_schedule jsonb
    /* end */
) RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT true
           /* track few: AND p_NAME ABSENT */
           AND p_grow_mps = 0 AND p_outlines IS NULL AND p_floors_m IS NULL AND p_ceilings_m IS NULL
           AND p_tolerances IS NULL AND p_departures IS NULL AND p_schedule IS NULL
           /* end */
    ;
END;
COMMENT ON FUNCTION _is_steady(
    /* track few: TYPE */
    double precision, geometry, double precision[], double precision[], jsonb, timestamptz[], jsonb
    /* end */
) IS
'Whether a track makes one voyage as planned, with one haven between two heights, so that _tracks_inserted checks it. '
'Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_usual_course(
    p_path geometry, p_outline geometry, p_motion text, p_max_waypoints double precision,
    p_max_speed_kn double precision
) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- A haven of 500 km does not reach a pole from 80 degrees.
    SELECT p_motion = 'rhumb' AND ST_NPoints(p_path) BETWEEN 2 AND p_max_waypoints
           AND p_path @ ST_MakeEnvelope(-360, -80, 360, 80, 4326)
           -- Swapping X and M includes M in the check: a line through a non-finite coordinate has a non-finite length.
           AND ST_Length(p_path) < 'infinity' AND ST_Length(ST_SwapOrdinates(p_path, 'xm')) < 'infinity'
           AND ST_M(ST_StartPoint(p_path)) >= -62135596800 AND ST_M(ST_EndPoint(p_path)) < 253402300800
           AND ST_NPoints(_in_microseconds(p_path)) = ST_NPoints(p_path)
           AND ST_IsValidTrajectory(_in_microseconds(p_path))
           AND (p_max_speed_kn = 'infinity' OR (_faster_leg(p_path, p_max_speed_kn)).leg IS NULL)
           AND NOT ST_IsEmpty(p_outline) AND ST_NumInteriorRings(p_outline) = 0 AND ST_SRID(p_outline) = 0
           AND ST_NPoints(p_outline) <= 10001 AND p_outline @ ST_MakeEnvelope(-500000, -500000, 500000, 500000)
           AND ST_Length(ST_ExteriorRing(p_outline)) < 'infinity'
           AND 1e12 * abs(ST_Area(ST_ConvexHull(p_outline)) - ST_Area(p_outline)) <= ST_Area(p_outline);
END;
COMMENT ON FUNCTION _is_usual_course(geometry, geometry, text, double precision, double precision) IS
'Whether the path of a track and its haven, which stays as it is, certainly have no error in a scene of this motion; '
'most have none. Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_track_shape(
    p_who text, p_track track, p_is_new boolean
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_times geometry;
    v_scene record;
    v_widest geometry;
BEGIN
    SELECT s.motion, s.earth, s.centre_lon, s.centre_lat INTO v_scene FROM scene s WHERE s.scene_id = p_track.scene_id;
    IF _is_steady(
           /* track few: p_track.NAME */
           p_track.grow_mps, p_track.outlines, p_track.floors_m, p_track.ceilings_m, p_track.tolerances,
           p_track.departures, p_track.schedule
           /* end */
       )
       AND _is_usual_course(p_track.path, p_track.outline, v_scene.motion, _limit('max_waypoints'),
                            _limit('max_speed_kn')) THEN
        RETURN;
    END IF;
    v_times := _in_microseconds(p_track.path);
    IF p_track.path IS NULL OR ST_NPoints(p_track.path) < 2 THEN
        FOUND := _raise('ZC001', p_who, 'path', 'needs at least two waypoints', 'path_of_two',
                        'track_path(waypoints, times) makes a path; it is null without times.');
    END IF;
    IF p_is_new THEN
        PERFORM _check_size(p_who, 'path', ST_NPoints(p_track.path), 'max_waypoints');
    END IF;
    IF p_track.tolerances IS NOT NULL AND num_nonnulls(p_track.departures, p_track.schedule) > 0 THEN
        FOUND := _raise('ZC003', p_who, 'tolerances', 'must not be given for a voyage that is repeated',
                        'tolerances_of_one_voyage', 'Give each voyage as a track.');
    END IF;
    IF p_track.departures IS NOT NULL THEN
        PERFORM _check_departures(p_who, p_track.path, p_track.departures);
    END IF;
    IF p_track.outlines IS NOT NULL THEN
        PERFORM _check_size(p_who, 'outlines', ST_NPoints(p_track.outlines), 'max_vertices');
    END IF;
    IF p_track.tolerances IS NOT NULL THEN
        PERFORM _check_tolerances(p_who, p_track.tolerances, p_track.path);
        IF p_track.outlines IS NOT NULL OR p_track.grow_mps > 0 THEN
            FOUND := _raise('ZC007', p_who, 'tolerances', 'must not be given for a haven that changes',
                            'tolerances_of_ships', 'Give the outline of the ship.');
        END IF;
    END IF;
    IF num_nonnulls(p_track.floors_m, p_track.ceilings_m) > 0 THEN
        PERFORM _check_leg_heights(p_who, p_track.path, p_track.floor_m, p_track.ceiling_m, p_track.floors_m,
                                   p_track.ceilings_m);
    END IF;
    -- Swapping X and M includes M in the check: a line through a non-finite coordinate has a non-finite length.
    IF NOT (ST_Length(p_track.path) < 'infinity' AND ST_Length(ST_SwapOrdinates(p_track.path, 'xm')) < 'infinity') THEN
        FOUND := _raise('ZC001', p_who, 'path', 'coordinates and times must be finite numbers',
                        'coordinates_finite');
    END IF;
    IF NOT (ST_YMax(p_track.path) <= 89 AND ST_YMin(p_track.path) >= -89
            AND ST_XMax(p_track.path) <= 360 AND ST_XMin(p_track.path) >= -360) THEN
        PERFORM _check_coordinates(p_who, 'path', p_track.path, p_track.scene_id);
    END IF;
    IF ST_NPoints(v_times) < ST_NPoints(p_track.path) OR NOT ST_IsValidTrajectory(v_times)
       OR ST_M(ST_StartPoint(p_track.path)) < -62135596800 OR ST_M(ST_EndPoint(p_track.path)) >= 253402300800 THEN
        PERFORM _check_times(p_who, p_track.path);
    END IF;
    IF p_is_new THEN
        PERFORM _check_speed(p_who, p_track.path);
    END IF;
    IF p_track.outline IS NULL OR ST_IsEmpty(p_track.outline) OR ST_NumInteriorRings(p_track.outline) > 0
       OR NOT ST_Length(ST_ExteriorRing(p_track.outline)) < 'infinity' OR ST_SRID(p_track.outline) <> 0 THEN
        FOUND := _raise('ZC006', p_who, 'outline',
                        'must be one ring of finite [starboard, forward] metres, without SRID', 'outline_ring');
    END IF;
    -- The kernel's limit; the ring repeats its first vertex.
    IF ST_NPoints(p_track.outline) > 10001 THEN
        FOUND := _raise('ZC006', p_who, 'outline',
                        format('must have at most 10000 corners; got %s', ST_NPoints(p_track.outline) - 1),
                        'outline_corners', 'ST_Simplify leaves fewer.');
    END IF;
    v_widest := coalesce(p_track.outlines, p_track.outline);
    IF greatest(ST_XMax(v_widest), -ST_XMin(v_widest), ST_YMax(v_widest), -ST_YMin(v_widest)) > 20037508
       OR greatest(ST_XMax(p_track.outline), -ST_XMin(p_track.outline), ST_YMax(p_track.outline),
                   -ST_YMin(p_track.outline)) > 20037508
    THEN
        FOUND := _raise('ZC006', p_who, 'outline',
                        'must lie within 20037508 m of the reference point: half round the earth',
                        'outline_on_earth');
    END IF;
    -- Not as a fraction of the area: PostgreSQL raises an error if a product underflows.
    IF 1e12 * abs(ST_Area(ST_ConvexHull(p_track.outline)) - ST_Area(p_track.outline)) > ST_Area(p_track.outline) THEN
        PERFORM _check_outline(p_who, p_track.outline);
    END IF;
    v_widest := p_track.outline;
    IF p_track.grow_mps <> 0 OR p_track.outlines IS NOT NULL THEN
        PERFORM _check_growth(p_who, p_track.path, p_track.outline, p_track.grow_mps, p_track.outlines);
        v_widest := coalesce(p_track.outlines, _grown_outline(
            p_track.outline, p_track.grow_mps * (ST_M(ST_EndPoint(p_track.path)) - ST_M(ST_StartPoint(p_track.path)))));
    END IF;
    IF v_scene.motion = 'great_circle' THEN
        IF v_scene.centre_lon IS NULL THEN
            SELECT c.* INTO v_scene.centre_lon, v_scene.centre_lat
                FROM _ensure_centre(p_track.scene_id, p_track.path) c;
        END IF;
        PERFORM _check_near_centre(p_who, 'path', p_track.path, v_scene.centre_lon, v_scene.centre_lat);
        PERFORM _check_haven_near_centre(p_who, p_track.path, p_track.outline, v_scene.centre_lon, v_scene.centre_lat,
                                         p_track.grow_mps, p_track.outlines);
    -- A degree of latitude is at least 110,574 m.
    ELSIF greatest(ST_YMax(p_track.path), -ST_YMin(p_track.path))
       + ST_MaxDistance(ST_MakePoint(0, 0), v_widest) / 110574 > 89.5 THEN
        PERFORM _check_haven(p_who, p_track.path, p_track.outline, v_scene.earth, p_track.grow_mps, p_track.outlines);
    END IF;
END
$$;
COMMENT ON FUNCTION _check_track_shape(text, track, boolean) IS
'Raises SQLSTATE class ZC for a path, a haven, heights of legs, tolerances or departures that are invalid, or outside '
'the plane of its scene, and for waypoints and speeds beyond the limit if p_is_new. Gives a great-circle scene '
'without a centre one.';

CREATE OR REPLACE FUNCTION conflictdb_internal._track_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text;
BEGIN
    -- As in _area_before; _tracks_inserted checks paths and havens.
    IF TG_OP = 'INSERT' AND NEW.first_version = 0 AND current_setting('session_replication_role') <> 'replica'
       AND _is_steady(
           /* track few: NEW.NAME */
           NEW.grow_mps, NEW.outlines, NEW.floors_m, NEW.ceilings_m, NEW.tolerances, NEW.departures, NEW.schedule
           /* end */
       )
       AND NEW.schedule_error IS NULL AND NEW.path IS NOT NULL AND NEW.outline IS NOT NULL
       AND NEW.key <> '' AND octet_length(NEW.key) <= 1000 AND _is_plain(NEW.properties)
       AND (NEW.class NOT IN ('area', 'track')) IS NOT FALSE
       /* track checked: AND VALID(NEW) */
       AND (octet_length(NEW.class) BETWEEN 1 AND 200) IS NOT FALSE
       AND (octet_length(NEW.owner) BETWEEN 1 AND 200) IS NOT FALSE
       /* end */
       AND NOT (NEW.properties ? 'vertical_datum')
       AND (NEW.floor_m > '-infinity' AND NEW.floor_m < 'infinity') IS NOT FALSE
       AND (NEW.ceiling_m > '-infinity' AND NEW.ceiling_m < 'infinity') IS NOT FALSE
       AND (NEW.ceiling_m > NEW.floor_m) IS NOT FALSE
    THEN
        NEW.version := nextval('version_seq');
        NEW.first_version := NEW.version;
        RETURN NEW;
    END IF;
    v_who := format('track %L', NEW.key);
    NEW.properties := coalesce(NEW.properties, '{}');
    /* track documents: NEW.NAME := nullif(NEW.NAME, 'null'); */
    NEW.tolerances := nullif(NEW.tolerances, 'null');
    NEW.schedule := nullif(NEW.schedule, 'null');
    /* end */
    IF NEW.schedule IS NOT NULL AND NOT _may_expand() THEN
        -- As the expansion of an area.
        NEW.departures := CASE WHEN TG_OP = 'UPDATE' AND OLD.schedule IS NOT NULL THEN OLD.departures END;
        NEW.schedule_error := CASE TG_OP WHEN 'UPDATE' THEN OLD.schedule_error END;
    END IF;
    NEW.schedule_error := CASE WHEN NEW.schedule IS NOT NULL THEN NEW.schedule_error END;
    IF NOT _is_plain(jsonb_build_object('', NEW.schedule)) THEN
        FOUND := _raise('ZC012', v_who, 'schedule', 'must be nested at most 99 deep, with numbers up to 1.8e308',
                        'schedule_plain');
    END IF;
    NEW.grow_mps := coalesce(NEW.grow_mps, 0);
    NEW.outline := coalesce(NEW.outline, ST_GeometryN(NEW.outlines, 1));
    IF NEW.floors_m IS NOT NULL THEN
        NEW.floor_m := _whole_height(
            v_who, 'floor_m', NEW.floor_m,
            (SELECT CASE WHEN count(h) = count(*) THEN min(h) END FROM unnest(NEW.floors_m) h),
            CASE TG_OP WHEN 'UPDATE' THEN OLD.floor_m END,
            TG_OP = 'UPDATE' AND NEW.floors_m IS DISTINCT FROM OLD.floors_m);
    END IF;
    IF NEW.ceilings_m IS NOT NULL THEN
        NEW.ceiling_m := _whole_height(
            v_who, 'ceiling_m', NEW.ceiling_m,
            (SELECT CASE WHEN count(h) = count(*) THEN max(h) END FROM unnest(NEW.ceilings_m) h),
            CASE TG_OP WHEN 'UPDATE' THEN OLD.ceiling_m END,
            TG_OP = 'UPDATE' AND NEW.ceilings_m IS DISTINCT FROM OLD.ceilings_m);
    END IF;
    IF NEW.properties ? 'vertical_datum'
       AND num_nonnulls(NEW.floor_m, NEW.ceiling_m, NEW.floors_m, NEW.ceilings_m) > 0 THEN
        PERFORM _check_datum(v_who, NEW.scene_id, NEW.properties ->> 'vertical_datum');
    END IF;
    IF TG_OP = 'UPDATE' THEN
        IF NEW.scene_id <> OLD.scene_id OR NEW.track_id <> OLD.track_id THEN
            FOUND := _raise('ZC008', v_who, 'scene_id', 'cannot change: remove the object and add it again',
                            'object_stays');
        END IF;
        -- Only _after_object_change raises them, of a new object.
        IF (NEW.version > OLD.version AND NEW.first_version = NEW.version AND _may_expand()) IS NOT TRUE THEN
            NEW.version := OLD.version;
            NEW.first_version := OLD.first_version;
        END IF;
        NEW.departures := CASE
            -- Those of a schedule that is taken away stay: nobody can tell them from departures that are written again.
            WHEN NEW.schedule IS NULL THEN NEW.departures
            -- As the expansion of an area.
            WHEN (NEW.schedule, NEW.path) IS NOT DISTINCT FROM (OLD.schedule, OLD.path)
                THEN coalesce(NEW.departures, OLD.departures) END;
        NEW.schedule_error := CASE WHEN NEW.departures IS NOT NULL THEN NEW.schedule_error END;
        IF (
            NEW.key,
            /* track answers: NEW.NAME */
            NEW.path, NEW.outline, NEW.floor_m, NEW.ceiling_m, NEW.grow_mps, NEW.outlines, NEW.floors_m, NEW.ceilings_m,
            NEW.class, NEW.owner, NEW.tolerances, NEW.schedule
            /* end */
        ) IS NOT DISTINCT FROM (
            OLD.key,
            /* track answers: OLD.NAME */
            OLD.path, OLD.outline, OLD.floor_m, OLD.ceiling_m, OLD.grow_mps, OLD.outlines, OLD.floors_m, OLD.ceilings_m,
            OLD.class, OLD.owner, OLD.tolerances, OLD.schedule
            /* end */
        )
           /* track checked: AND VALID(NEW) */
           AND (octet_length(NEW.class) BETWEEN 1 AND 200) IS NOT FALSE
           AND (octet_length(NEW.owner) BETWEEN 1 AND 200) IS NOT FALSE
           /* end */
           AND _is_plain(NEW.properties) THEN
            IF (NEW.departures, NEW.schedule_error) IS NOT DISTINCT FROM (OLD.departures, OLD.schedule_error) THEN
                RETURN NEW;
            END IF;
            -- Departures need no check of the path and its outline.
            IF NEW.tolerances IS NULL THEN
                IF NEW.departures IS NOT NULL THEN
                    PERFORM _check_departures(v_who, NEW.path, NEW.departures);
                END IF;
                NEW.version := greatest(nextval('version_seq'), OLD.version + 1);
                RETURN NEW;
            END IF;
        END IF;
    END IF;
    PERFORM _check_common(v_who, NEW.key, NEW.floor_m, NEW.ceiling_m, NEW.properties, NEW.class);
    /* track checked: CHECK(NEW) */
    PERFORM _check_word(v_who, 'class', NEW.class);
    PERFORM _check_word(v_who, 'owner', NEW.owner);
    /* end */
    -- A restore or replica brings tracks accepted elsewhere under another limit; only they provide first_version.
    PERFORM _check_track_shape(v_who, NEW, current_setting('session_replication_role') <> 'replica'
        AND (CASE TG_OP WHEN 'INSERT' THEN coalesce(NEW.first_version, 0) = 0
                        ELSE NEW.path IS DISTINCT FROM OLD.path END));
    IF TG_OP = 'UPDATE' THEN
        -- Greater than the previous version, even if a restore set the sequence back.
        NEW.version := greatest(nextval('version_seq'), OLD.version + 1);
        RETURN NEW;
    END IF;
    NEW.version := _first_version(1::smallint, NEW.track_id);
    -- A restore provides first_version, so that restored conflicts keep referring to this object.
    IF (NEW.first_version BETWEEN 1 AND NEW.version) IS NOT TRUE THEN
        NEW.first_version := NEW.version;
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _track_before() IS
'Trigger: checks a track (SQLSTATE class ZC) and sets a new version if its content changed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._areas_inserted() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_max_vertices double precision := _limit('max_vertices');
BEGIN
    PERFORM _check_area_shape(format('area %L', n.key), n.scene_id, n.footprint, v_max_vertices)
        FROM (SELECT r.area_id, r.key, r.scene_id, r.footprint
              FROM new_rows r LEFT JOIN scene s ON s.scene_id = r.scene_id
              -- A restored one may have been accepted under another limit (_area_before).
              WHERE _is_once(r.activations, r.schedule) AND r.first_version = r.version
                AND _is_usual_footprint(r.footprint, s.motion, s.earth, s.centre_lon, s.centre_lat,
                                        v_max_vertices) IS NOT TRUE
              ORDER BY r.area_id OFFSET 0) n;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _areas_inserted() IS
'Trigger, once per statement: checks the footprints of new areas (SQLSTATE class ZC) that _area_before has accepted.';

CREATE OR REPLACE FUNCTION conflictdb_internal._tracks_inserted() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_track track%ROWTYPE;
    v_max_waypoints double precision := _limit('max_waypoints');
    v_max_speed_kn double precision := _limit('max_speed_kn');
BEGIN
    FOR v_track IN
        SELECT r.* FROM new_rows r LEFT JOIN scene s ON s.scene_id = r.scene_id
        WHERE _is_steady(
                  /* track few: r.NAME */
                  r.grow_mps, r.outlines, r.floors_m, r.ceilings_m, r.tolerances, r.departures, r.schedule
                  /* end */
              )
          AND r.first_version = r.version
          AND _is_usual_course(r.path, r.outline, s.motion, v_max_waypoints, v_max_speed_kn) IS NOT TRUE
        ORDER BY r.track_id
    LOOP
        PERFORM _check_track_shape(format('track %L', v_track.key), v_track, true);
    END LOOP;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _tracks_inserted() IS
'Trigger, once per statement: checks paths and havens of new tracks (SQLSTATE class ZC) that _track_before accepted.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_may_prune(p_who text, p_owner name) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF row_security_active('scene'::regclass::oid) AND NOT pg_has_role('conflictdb_worker', 'USAGE')
       AND (p_owner IN (SELECT m.role FROM _my_role m WHERE m.role <> 'public')) IS NOT TRUE THEN
        FOUND := _raise('42501', p_who, 'history_kept',
                        format('can be changed by the owner of the scene only, not by role %I', current_user),
                        'history_owned', 'A shorter time would remove history, also for other roles.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_may_prune(text, name) IS
'Raises insufficient_privilege unless the current role owns the protected scene, or is a worker: only they may change '
'how long its history is kept.';

CREATE OR REPLACE FUNCTION conflictdb_internal._as_branch(p_new scene, p_old scene) RETURNS scene
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    c_own CONSTANT text[] := '{name,delays_within_s}';
    v_who text := format('scene %L', p_new.name);
    v_parent scene%ROWTYPE;
    v_is_new boolean := p_old.scene_id IS NULL;
BEGIN
    IF NOT v_is_new AND p_new.parent_scene_id IS DISTINCT FROM p_old.parent_scene_id THEN
        FOUND := _raise('ZC020', v_who, 'parent_scene_id', 'cannot change', 'branch_stays');
    END IF;
    IF p_new.parent_scene_id IS NULL THEN
        RETURN p_new;
    END IF;
    SELECT * INTO v_parent FROM scene s WHERE s.scene_id = p_new.parent_scene_id;
    IF NOT FOUND THEN
        -- Restores and replicas may bring a branch before its parent.
        IF v_is_new AND pg_has_role((SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = 'scene'::regclass),
                                    'USAGE') THEN
            RETURN p_new;
        END IF;
        FOUND := _raise('ZC020', v_who, 'parent_scene_id', 'is no scene that the role may read', 'branch_of_scene');
    END IF;
    IF v_parent.parent_scene_id IS NOT NULL THEN
        FOUND := _raise('ZC020', v_who, 'parent_scene_id', format('is the branch %L, and branches have none',
                        v_parent.name), 'branch_of_whole');
    END IF;
    IF NOT v_is_new AND _settings_of(p_new) - c_own <> _settings_of(v_parent) - c_own
       AND _settings_of(p_new) - c_own <> _settings_of(p_old) - c_own OR p_new.delays_within_s <> 0 AND NOT v_is_new
    THEN
        FOUND := _raise('ZC020', v_who, 'settings', format('are those of %L, of which it is a branch', v_parent.name),
                        'branch_settings', 'Change those of the parent: its branches follow.');
    END IF;
    RETURN jsonb_populate_record(p_new, _settings_of(v_parent) - c_own || '{"delays_within_s": 0}');
END
$$;
COMMENT ON FUNCTION _as_branch(scene, scene) IS
'A row of scene as it is stored: a branch with the settings of its parent, and no stored delays. Raises ZC020 for '
'other settings, another parent, or a branch of a branch.';

CREATE OR REPLACE FUNCTION conflictdb_internal._centre_of_objects(
    p_scene_id bigint, OUT centre_lon double precision, OUT centre_lat double precision
)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    SELECT ST_X(m.place), ST_Y(m.place) INTO centre_lon, centre_lat
        FROM _middle_of((SELECT ST_Collect(o.place)
                         FROM (SELECT ST_Points(a.footprint) FROM area a WHERE a.scene_id = p_scene_id
                               UNION ALL
                               SELECT ST_Points(ST_Force2D(t.path)) FROM track t WHERE t.scene_id = p_scene_id)
                              AS o (place))) AS m (place);
END
$$;
COMMENT ON FUNCTION _centre_of_objects(bigint) IS
'The middle of all objects of a scene, degrees; nulls without objects.';

-- Also run by _after_scene_change, as the owner, for branches: PostGIS's schema is not on the search path.
CREATE OR REPLACE FUNCTION conflictdb_internal._scene_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_who text := format('scene %L', NEW.name);
    v_name text;
    v_metres double precision;
    v_s double precision;
BEGIN
    IF NEW.name IS NULL OR btrim(NEW.name) = '' OR octet_length(NEW.name) > 1000 THEN
        FOUND := _raise('ZC008', 'scene', 'name', 'must be a non-empty text of at most 1000 bytes',
                        'scene_name_valid');
    END IF;
    IF TG_OP = 'UPDATE' AND NEW.scene_id <> OLD.scene_id THEN
        FOUND := _raise('ZC008', v_who, 'scene_id', 'cannot change: remove the scene and create it again',
                        'scene_stays');
    END IF;
    NEW := _as_branch(NEW, CASE TG_OP WHEN 'UPDATE' THEN OLD END);
    PERFORM _check_owner(v_who, CASE TG_OP WHEN 'UPDATE' THEN OLD.owner ELSE NEW.owner END, NEW.owner,
                         TG_OP = 'INSERT');
    IF TG_OP = 'UPDATE' AND NEW.history_kept IS DISTINCT FROM OLD.history_kept THEN
        PERFORM _check_may_prune(v_who, OLD.owner);
    END IF;
    IF (NEW.motion IN ('rhumb', 'great_circle')) IS NOT TRUE THEN
        FOUND := _raise('ZC009', v_who, 'motion', format('must be one of rhumb, great_circle; got %L', NEW.motion),
                        'scene_motion_known');
    END IF;
    IF (NEW.earth IN ('wgs84', 'sphere')) IS NOT TRUE THEN
        FOUND := _raise('ZC009', v_who, 'earth', format('must be one of wgs84, sphere; got %L', NEW.earth),
                        'scene_earth_known');
    END IF;
    IF NEW.motion = 'great_circle' AND NEW.earth <> 'sphere' THEN
        FOUND := _raise('ZC009', v_who, 'earth', format('must be sphere with motion great_circle; got %L', NEW.earth),
                        'scene_circles_on_sphere');
    END IF;
    IF TG_OP = 'UPDATE' AND NEW.motion = 'rhumb' AND OLD.motion = 'great_circle' THEN
        NEW.centre_lon := nullif(NEW.centre_lon, OLD.centre_lon);
        NEW.centre_lat := nullif(NEW.centre_lat, OLD.centre_lat);
    ELSIF TG_OP = 'UPDATE' AND NEW.motion = 'great_circle' AND NEW.centre_lon IS NULL AND NEW.centre_lat IS NULL
          -- That of a branch is its parent's.
          AND NEW.parent_scene_id IS NULL THEN
        SELECT c.* INTO NEW.centre_lon, NEW.centre_lat FROM _centre_of_objects(NEW.scene_id) c;
    END IF;
    IF NEW.motion = 'rhumb' AND num_nonnulls(NEW.centre_lon, NEW.centre_lat) > 0 THEN
        FOUND := _raise('ZC009', v_who, 'centre', 'has a meaning with motion great_circle only',
                        'scene_centre_of_circles');
    END IF;
    IF num_nonnulls(NEW.centre_lon, NEW.centre_lat) > 0
       AND (NEW.centre_lon BETWEEN -180 AND 180 AND NEW.centre_lat BETWEEN -90 AND 90) IS NOT TRUE THEN
        FOUND := _raise('ZC009', v_who, 'centre', format('must be longitude and latitude in degrees, within +-180 and '
                        '+-90; got %s, %s', NEW.centre_lon, NEW.centre_lat), 'scene_centre_on_earth');
    END IF;
    IF (NEW.method IN ('screen', 'exact', 'nlp')) IS NOT TRUE THEN
        FOUND := _raise('ZC009', v_who, 'method',
                        format('must be one of screen, exact, nlp; got %L%s', NEW.method,
                               CASE NEW.method WHEN 'window' THEN
                                   ', which was removed: use exact, which is quicker and decides' ELSE '' END),
                        'scene_method_known');
    END IF;
    -- Settings whose names end in _m are distances.
    FOR v_name, v_metres IN
        SELECT j.key, j.value FROM jsonb_each_text(_settings_of(NEW)) j WHERE right(j.key, 2) = '_m'
    LOOP
        IF (v_metres >= 0 AND v_metres < 'infinity') IS NOT TRUE THEN
            FOUND := _raise('ZC009', v_who, v_name, 'must be a finite number of metres, 0 or more',
                            format('scene_%s_finite', left(v_name, -2)));
        END IF;
        IF v_metres > 20000000 THEN
            FOUND := _raise('ZC009', v_who, v_name,
                            format('must be at most 20000000 metres, half the way around the earth; got %s '
                                   '(is it in metres?)', v_metres), format('scene_%s_on_earth', left(v_name, -2)));
        END IF;
    END LOOP;
    -- Those in _s are times. Read by name: revisions add columns.
    FOR v_name, v_s IN
        SELECT j.key, j.value FROM jsonb_each_text(_settings_of(NEW)) j WHERE right(j.key, 2) = '_s'
    LOOP
        IF (v_s BETWEEN 0 AND 2592000) IS NOT TRUE OR abs(1e6 * v_s - round(1e6 * v_s)) > 1e-3 THEN
            FOUND := _raise('ZC009', v_who, v_name,
                            format('must be whole microseconds, 0 to 2592000 seconds (30 days); got %s', v_s),
                            format('scene_%s_known', left(v_name, -2)));
        END IF;
        IF v_name = 'time_separation_s' AND NEW.method = 'nlp'
           AND (v_s > 0 OR EXISTS (SELECT FROM rule r WHERE r.scene_id = NEW.scene_id AND r.time_s > 0)) THEN
            FOUND := _raise('ZC009', v_who, v_name,
                            format('is not known to method ''nlp'', whose program knows one time only: use exact, or '
                                   '0; got %s', v_s), format('scene_%s_solved', left(v_name, -2)));
        END IF;
    END LOOP;
    IF (NEW.horizon_days BETWEEN 0 AND 36525) IS NOT TRUE THEN
        FOUND := _raise('ZC009', v_who, 'horizon_days', format('must be 0 to 36525 days, a century; got %s',
                        NEW.horizon_days), 'scene_horizon_days_known');
    END IF;
    IF (NEW.vertical_datum IN ('msl', 'wgs84', 'flight_level')) IS NOT TRUE THEN
        FOUND := _raise('ZC009', v_who, 'vertical_datum', format('must be one of msl, wgs84, flight_level; got %L',
                        NEW.vertical_datum), 'scene_vertical_datum_known');
    END IF;
    IF (NEW.regions IN ('on', 'off')) IS NOT TRUE THEN
        FOUND := _raise('ZC009', v_who, 'regions', format('must be one of on, off; got %L', NEW.regions),
                        'scene_regions_known');
    END IF;
    IF TG_OP = 'UPDATE' AND NEW.vertical_datum <> OLD.vertical_datum
       AND (EXISTS (SELECT FROM area a WHERE a.scene_id = NEW.scene_id AND num_nonnulls(a.floor_m, a.ceiling_m) > 0)
            OR EXISTS (SELECT FROM track t
                       WHERE t.scene_id = NEW.scene_id AND num_nonnulls(t.floor_m, t.ceiling_m) > 0)) THEN
        FOUND := _raise('ZC009', v_who, 'vertical_datum', format('must stay %L while objects have heights, which are '
                        'not converted; got %L', OLD.vertical_datum, NEW.vertical_datum), 'scene_vertical_datum_kept',
                        'Load them into another scene, or delete them first.');
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _scene_before() IS 'Trigger: checks the settings of a scene (SQLSTATE class ZC).';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_holds_objects() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene scene%ROWTYPE;
BEGIN
    SELECT * INTO v_scene FROM scene s WHERE s.scene_id = NEW.scene_id;
    IF v_scene.motion = 'great_circle' THEN
        PERFORM _check_near_centre(format('area %L', a.key), 'footprint', a.footprint, v_scene.centre_lon,
                                   v_scene.centre_lat)
            FROM area a WHERE a.scene_id = v_scene.scene_id;
        PERFORM _check_near_centre(format('track %L', t.key), 'path', t.path, v_scene.centre_lon, v_scene.centre_lat),
                _check_haven_near_centre(format('track %L', t.key), t.path, t.outline, v_scene.centre_lon,
                                         v_scene.centre_lat, t.grow_mps, t.outlines)
            FROM track t WHERE t.scene_id = v_scene.scene_id;
    ELSE
        PERFORM _check_coordinates(format('area %L', a.key), 'footprint', a.footprint, v_scene.scene_id)
            FROM area a WHERE a.scene_id = v_scene.scene_id;
        PERFORM _check_coordinates(format('track %L', t.key), 'path', t.path, v_scene.scene_id),
                _check_haven(format('track %L', t.key), t.path, t.outline, v_scene.earth, t.grow_mps, t.outlines)
            FROM track t WHERE t.scene_id = v_scene.scene_id;
    END IF;
    PERFORM _check_planar(format('area %L', a.key), a.footprint,
                          _plane(v_scene.motion, v_scene.earth, v_scene.centre_lon, v_scene.centre_lat))
        FROM area a WHERE a.scene_id = v_scene.scene_id;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _scene_holds_objects() IS
'Trigger: refuses another motion or centre if an object of the scene would lie outside the new plane.';

CREATE OR REPLACE TRIGGER scene_before BEFORE INSERT OR UPDATE ON scene
    FOR EACH ROW EXECUTE FUNCTION _scene_before();
CREATE OR REPLACE TRIGGER area_before BEFORE INSERT OR UPDATE ON area
    FOR EACH ROW EXECUTE FUNCTION _area_before();
CREATE OR REPLACE TRIGGER track_before BEFORE INSERT OR UPDATE ON track
    FOR EACH ROW EXECUTE FUNCTION _track_before();
CREATE OR REPLACE TRIGGER area_check_inserted AFTER INSERT ON area REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _areas_inserted();
CREATE OR REPLACE TRIGGER track_check_inserted AFTER INSERT ON track REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _tracks_inserted();
-- Also for replicated rows: detection could not process an invalid row.
ALTER TABLE scene ENABLE ALWAYS TRIGGER scene_before;
ALTER TABLE area ENABLE ALWAYS TRIGGER area_before;
ALTER TABLE track ENABLE ALWAYS TRIGGER track_before;

-- Checked at the end of the transaction, or of _load and create_scene: objects may change together with the settings.
-- Not of branches: their roles, who may only read the parent, would keep it from a change. A detection covers what does
-- not fit, and no merge takes it over.
DROP TRIGGER IF EXISTS scene_holds_objects ON scene;
CREATE CONSTRAINT TRIGGER scene_holds_objects AFTER UPDATE ON scene DEFERRABLE INITIALLY DEFERRED
    FOR EACH ROW
    WHEN (NEW.parent_scene_id IS NULL
          AND (OLD.motion, OLD.centre_lon, OLD.centre_lat)
              IS DISTINCT FROM (NEW.motion, NEW.centre_lon, NEW.centre_lat))
    EXECUTE FUNCTION _scene_holds_objects();
