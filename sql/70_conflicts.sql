-- Queries for users. The functions are not STRICT: a strict set-returning function is not inlined, so the planner could
-- not use indexes or drop unused columns. A NOTICE says if changes wait for detection, as do scenes.is_current and
-- scene_is_current.

CREATE OR REPLACE VIEW conflictdb_internal._object_row WITH (security_invoker = true) AS
SELECT a.scene_id, a.object_kind, o.object_id, t.name AS "table", o.identity_json
FROM attachment a JOIN _attached_table t USING (attachment_id) JOIN attached_object o USING (attachment_id);
COMMENT ON VIEW _object_row IS
'Attached table, and identity of the row, of each object that comes from one. A view, because a function would not be '
'inlined.';
COMMENT ON COLUMN _object_row.scene_id IS 'Scene.';
COMMENT ON COLUMN _object_row.object_kind IS 'Kind of the object: 0 area, 1 track.';
COMMENT ON COLUMN _object_row.object_id IS 'area_id or track_id of the object.';
COMMENT ON COLUMN _object_row."table" IS 'Present name of the table, as SCHEMA.TABLE.';
COMMENT ON COLUMN _object_row.identity_json IS 'Values of the identity columns by name.';

CREATE OR REPLACE VIEW conflicts WITH (security_invoker = true) AS
SELECT s.name AS scene,
       c.a_key, CASE c.a_kind WHEN 0 THEN 'area' ELSE 'track' END AS a_kind,
       c.b_key, CASE c.b_kind WHEN 0 THEN 'area' ELSE 'track' END AS b_kind,
       c.periods, lower(c.periods) AS first_contact, upper(c.periods) AS last_contact, c.verdict,
       c.region, c.first_contact_point, c.method, c.time_error_s,
       -- Two simple EXISTS: for many rows the planner can hash the marks.
       NOT EXISTS (SELECT FROM change m
                   WHERE m.scene_id = c.scene_id AND m.object_kind = c.a_kind AND m.object_id = c.a_id)
           AND NOT EXISTS (SELECT FROM change m
                           WHERE m.scene_id = c.scene_id AND m.object_kind = c.b_kind AND m.object_id = c.b_id)
           -- The parent of a branch must be current, too.
           AND (s.parent_scene_id IS NULL OR n.scene_is_current
                OR NOT EXISTS (SELECT FROM change m
                               WHERE m.scene_id = s.parent_scene_id
                                 AND (m.object_kind, m.object_id) IN ((c.a_kind, c.a_id), (c.b_kind, c.b_id))))
           AS is_current,
       c.run_id, c.found_at, c.closest_at, c.closest_m, c.closest_error_m, c.closest_a_point, c.closest_b_point,
       n.scene_is_current, c.conflict_id, c.found_at AS opened_at, c.changed_at,
       _acknowledger(k.acknowledged_by, k.given_name) AS acknowledged_by, k.acknowledged_at,
       k.reason AS acknowledged_for, k.until AS acknowledged_until,
       ST_X(c.first_contact_point) AS first_contact_lon_deg, ST_Y(c.first_contact_point) AS first_contact_lat_deg,
       -- Read only where they are selected.
       CASE c.a_kind WHEN 0 THEN (SELECT o.name FROM area o WHERE o.area_id = c.a_id)
                     ELSE (SELECT o.name FROM track o WHERE o.track_id = c.a_id) END AS a_name,
       CASE c.b_kind WHEN 0 THEN (SELECT o.name FROM area o WHERE o.area_id = c.b_id)
                     ELSE (SELECT o.name FROM track o WHERE o.track_id = c.b_id) END AS b_name,
       c.lacking_s, c.certainty,
       (SELECT r."table" FROM _object_row r
        WHERE r.scene_id = c.scene_id AND r.object_kind = c.a_kind AND r.object_id = c.a_id LIMIT 1) AS a_table,
       (SELECT r.identity_json FROM _object_row r
        WHERE r.scene_id = c.scene_id AND r.object_kind = c.a_kind AND r.object_id = c.a_id LIMIT 1) AS a_row,
       (SELECT r."table" FROM _object_row r
        WHERE r.scene_id = c.scene_id AND r.object_kind = c.b_kind AND r.object_id = c.b_id LIMIT 1) AS b_table,
       (SELECT r.identity_json FROM _object_row r
        WHERE r.scene_id = c.scene_id AND r.object_kind = c.b_kind AND r.object_id = c.b_id LIMIT 1) AS b_row
-- OFFSET 0: evaluate once per scene, not per conflict.
FROM scene s CROSS JOIN LATERAL (SELECT _is_current(s.scene_id) AS scene_is_current OFFSET 0) n
-- A branch also has the conflicts of its parent's objects that it has not edited.
JOIN _layer l ON l.seen_by = s.scene_id
JOIN conflict c ON c.scene_id = l.scene_id
                   AND (c.scene_id = s.scene_id
                        OR NOT _is_edited(s.scene_id, c.a_key) AND NOT _is_edited(s.scene_id, c.b_key))
-- Only acknowledgements that hold.
LEFT JOIN acknowledgement k
    ON k.conflict_id = c.conflict_id AND k.scene_id = c.scene_id AND k.ended_at IS NULL
       AND coalesce(k.until > now(), true)
       AND NOT _has_grown(c.periods, c.verdict, c.time_error_s, c.closest_m, c.closest_error_m, k.periods, k.verdict,
                          k.time_error_s, k.closest_m, k.closest_error_m, s.tolerance_m)
WHERE c.verdict <> 'near';

COMMENT ON VIEW conflicts IS
'Conflicts: one row per pair of objects, as of the last detection of the scene. a is the area if there is one, else '
'the object with the smaller key in byte order.';
COMMENT ON COLUMN conflicts.scene IS 'Name of the scene.';
COMMENT ON COLUMN conflicts.a_key IS 'Key of the first object.';
COMMENT ON COLUMN conflicts.a_kind IS 'area or track.';
COMMENT ON COLUMN conflicts.b_key IS 'Key of the second object.';
COMMENT ON COLUMN conflicts.b_kind IS 'area or track.';
COMMENT ON COLUMN conflicts.periods IS
'When they conflict: bounds inclusive, rounded outward to the microsecond; a missing bound is unbounded.';
COMMENT ON COLUMN conflicts.first_contact IS 'Start of the first period; null if unbounded.';
COMMENT ON COLUMN conflicts.last_contact IS 'End of the last period; null if unbounded.';
COMMENT ON COLUMN conflicts.verdict IS
'conflict: they meet; grazing: within the tolerance of the limit; unresolved: neither proven apart nor decided, '
'periods then say when they might meet. Treat unresolved as a conflict; after screen, detect with exact.';
COMMENT ON COLUMN conflicts.region IS
'Region of the conflict, longitude and latitude in degrees, split at the antimeridian. Contains every place where both '
'meet. Two overlapping areas: their intersection. Otherwise the intersection of the places swept during the contacts, '
'extended by tolerance and separation. Reaches beyond that by at most 1 m, or the tolerance if larger. Null: not '
'computed, as by method screen and in scenes with the setting regions off; where they meet is unknown, not nowhere.';
COMMENT ON COLUMN conflicts.first_contact_point IS
'First contact, longitude and latitude in degrees; null if not computed.';
COMMENT ON COLUMN conflicts.method IS 'Method of the detection that found it.';
COMMENT ON COLUMN conflicts.time_error_s IS 'Error bound of every period''s start and end, seconds.';
COMMENT ON COLUMN conflicts.is_current IS
'Whether neither object nor the scene''s settings changed since; scene_is_current says whether pairs may be missing.';
COMMENT ON COLUMN conflicts.run_id IS 'Run that found it; later runs confirmed it unchanged.';
COMMENT ON COLUMN conflicts.found_at IS 'When the pair was first found in conflict.';
COMMENT ON COLUMN conflicts.closest_at IS
'Closest approach: its time, the first if several; null if not computed, or for areas that are always active.';
COMMENT ON COLUMN conflicts.closest_m IS
'Closest approach: least distance of the polygons, metres on the earth, 0 if they touch; null if not computed.';
COMMENT ON COLUMN conflicts.closest_error_m IS
'Closest approach: error bound of closest_m, metres; null if not computed.';
COMMENT ON COLUMN conflicts.closest_a_point IS
'Closest approach: nearest point of the first object, longitude and latitude in degrees; null if not computed.';
COMMENT ON COLUMN conflicts.closest_b_point IS
'Closest approach: nearest point of the second object, longitude and latitude in degrees; null if not computed.';
COMMENT ON COLUMN conflicts.scene_is_current IS
'Whether the conflicts of the scene are complete: nothing waits for detection (see the view scenes).';
COMMENT ON COLUMN conflicts.conflict_id IS
'Id of the conflict, the same from opening to closing (see conflict_events).';
COMMENT ON COLUMN conflicts.opened_at IS 'When it opened; equal to found_at.';
COMMENT ON COLUMN conflicts.changed_at IS
'When its verdict or a key last changed, or its periods by more than their error; null if they never did.';
COMMENT ON COLUMN conflicts.acknowledged_by IS
'User whose acknowledgement holds; null if there is none, or if it has ended, expired or been outgrown. NAME (user) if '
'the user gave a name; nothing checks it.';
COMMENT ON COLUMN conflicts.acknowledged_at IS 'When it was acknowledged; null if acknowledged_by is null.';
COMMENT ON COLUMN conflicts.acknowledged_for IS 'Reason given; null if acknowledged_by is null.';
COMMENT ON COLUMN conflicts.acknowledged_until IS
'Expiry of the acknowledgement; null: valid while the conflict lasts, or acknowledged_by is null.';
COMMENT ON COLUMN conflicts.first_contact_lon_deg IS
'First contact: longitude, degrees; null if not computed.';
COMMENT ON COLUMN conflicts.first_contact_lat_deg IS
'First contact: latitude, degrees; null if not computed.';
COMMENT ON COLUMN conflicts.a_name IS 'Name of the first object; null if it has none, or it is not known.';
COMMENT ON COLUMN conflicts.b_name IS 'Name of the second object; null if it has none, or it is not known.';
COMMENT ON COLUMN conflicts.a_table IS
'Attached table that the first object comes from, as SCHEMA.TABLE; null if it comes from none.';
COMMENT ON COLUMN conflicts.a_row IS
'Values of the columns of its key there, by name, such as {"nr": 7}; null if a_table is null. Equal to '
'jsonb_build_object(''nr'', nr) for numbers, truth values and texts.';
COMMENT ON COLUMN conflicts.b_table IS
'Attached table that the second object comes from, as SCHEMA.TABLE; null if it comes from none.';
COMMENT ON COLUMN conflicts.b_row IS
'Values of the columns of its key there, by name, such as {"nr": 7}; null if b_table is null.';
COMMENT ON COLUMN conflicts.lacking_s IS
'Separation in time: seconds by which it is missed, within time_error_s; null if none is required, or if the verdict '
'is unresolved.';
COMMENT ON COLUMN conflicts.certainty IS
'must: all voyages within the tolerances of both objects conflict; may: it is not proven that all do; null if neither '
'has tolerances, or if the verdict is unresolved.';

-- Tables with these columns have these comments, unless a later file says more.
DO $$
DECLARE
    v_column record;
BEGIN
    FOR v_column IN
        SELECT t.attrelid::regclass AS of_table, t.attname, col_description(v.attrelid, v.attnum) AS said
        FROM pg_attribute v JOIN pg_attribute t USING (attname)
        WHERE v.attrelid = 'conflicts'::regclass
          AND t.attrelid IN ('conflict'::regclass, 'conflict_event'::regclass, 'probe_reply'::regclass)
    LOOP
        EXECUTE format('COMMENT ON COLUMN %s.%I IS %L', v_column.of_table, v_column.attname, v_column.said);
    END LOOP;
END
$$;

CREATE OR REPLACE VIEW approaches WITH (security_invoker = true) AS
SELECT s.name AS scene,
       c.a_key, CASE c.a_kind WHEN 0 THEN 'area' ELSE 'track' END AS a_kind,
       c.b_key, CASE c.b_kind WHEN 0 THEN 'area' ELSE 'track' END AS b_kind,
       c.closest_at, c.closest_m, c.closest_error_m, c.closest_a_point AS a_point, c.closest_b_point AS b_point,
       c.verdict,
       -- Two simple EXISTS: for many rows the planner can hash the marks.
       NOT EXISTS (SELECT FROM change m
                   WHERE m.scene_id = c.scene_id AND m.object_kind = c.a_kind AND m.object_id = c.a_id)
           AND NOT EXISTS (SELECT FROM change m
                           WHERE m.scene_id = c.scene_id AND m.object_kind = c.b_kind AND m.object_id = c.b_id)
           -- The parent of a branch must be current, too.
           AND (s.parent_scene_id IS NULL OR n.scene_is_current
                OR NOT EXISTS (SELECT FROM change m
                               WHERE m.scene_id = s.parent_scene_id
                                 AND (m.object_kind, m.object_id) IN ((c.a_kind, c.a_id), (c.b_kind, c.b_id))))
           AS is_current,
       c.run_id, c.found_at, n.scene_is_current, c.method, c.time_error_s,
       CASE c.a_kind WHEN 0 THEN (SELECT o.name FROM area o WHERE o.area_id = c.a_id)
                     ELSE (SELECT o.name FROM track o WHERE o.track_id = c.a_id) END AS a_name,
       CASE c.b_kind WHEN 0 THEN (SELECT o.name FROM area o WHERE o.area_id = c.b_id)
                     ELSE (SELECT o.name FROM track o WHERE o.track_id = c.b_id) END AS b_name
FROM scene s CROSS JOIN LATERAL (SELECT _is_current(s.scene_id) AS scene_is_current OFFSET 0) n
-- A branch also has the conflicts of its parent's objects that it has not edited.
JOIN _layer l ON l.seen_by = s.scene_id
JOIN conflict c ON c.scene_id = l.scene_id
                   AND (c.scene_id = s.scene_id
                        OR NOT _is_edited(s.scene_id, c.a_key) AND NOT _is_edited(s.scene_id, c.b_key))
WHERE c.closest_m IS NOT NULL;

COMMENT ON VIEW approaches IS
'Closest approaches of pairs of objects: conflicts, and pairs without conflict within the scene''s nearest_m. One row '
'per pair, as of the last detection. a is the area if there is one, else the smaller key in byte order.';
COMMENT ON COLUMN approaches.scene IS 'Name of the scene.';
COMMENT ON COLUMN approaches.a_key IS 'Key of the first object.';
COMMENT ON COLUMN approaches.a_kind IS 'area or track.';
COMMENT ON COLUMN approaches.b_key IS 'Key of the second object.';
COMMENT ON COLUMN approaches.b_kind IS 'area or track.';
COMMENT ON COLUMN approaches.closest_at IS
'When they are closest, the first time if several; null for areas that are always active.';
COMMENT ON COLUMN approaches.closest_m IS
'Least distance of the polygons, metres on the earth; 0 if they touch.';
COMMENT ON COLUMN approaches.closest_error_m IS 'Error bound of closest_m, metres.';
COMMENT ON COLUMN approaches.a_point IS 'Nearest point of the first object then, longitude and latitude in degrees.';
COMMENT ON COLUMN approaches.b_point IS 'Nearest point of the second object then, longitude and latitude in degrees.';
COMMENT ON COLUMN approaches.verdict IS
'near: no conflict; conflict, grazing, unresolved: as in the view conflicts.';
COMMENT ON COLUMN approaches.is_current IS
'Whether neither object nor the scene''s settings changed since; scene_is_current says whether pairs may be missing.';
COMMENT ON COLUMN approaches.run_id IS 'Run that found it; later runs confirmed it unchanged.';
COMMENT ON COLUMN approaches.found_at IS 'When the pair was first found in conflict or near.';
COMMENT ON COLUMN approaches.scene_is_current IS
'Whether the closest approaches of the scene are complete: nothing waits for detection (see the view scenes).';
COMMENT ON COLUMN approaches.method IS 'Method of the detection that found it.';
COMMENT ON COLUMN approaches.time_error_s IS
'Error bound of every period''s start and end, seconds; 0 for a pair that is only near.';
COMMENT ON COLUMN approaches.a_name IS 'Name of the first object; null if it has none, or it is not known.';
COMMENT ON COLUMN approaches.b_name IS 'Name of the second object; null if it has none, or it is not known.';

CREATE OR REPLACE FUNCTION conflicts_at(p_scene text, p_instant timestamptz) RETURNS SETOF conflicts
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    SELECT c.* FROM conflicts c
    WHERE c.scene = coalesce(p_scene, '') AND _warn_if_incomplete(p_scene)
      AND _warn_if_beyond_horizon(p_scene, tstzrange(p_instant, p_instant, '[]')) AND c.periods @> p_instant;
END;
COMMENT ON FUNCTION conflicts_at(text, timestamptz) IS 'Conflicts of a scene with a period that contains an instant.';

CREATE OR REPLACE FUNCTION conflicts_of(p_scene text, p_key text) RETURNS SETOF conflicts
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    -- One branch per index; no pair is in both.
    SELECT c.* FROM conflicts c
    WHERE c.scene = coalesce(p_scene, '') AND _warn_if_incomplete(p_scene) AND _warn_if_no_object(p_scene, p_key)
      AND c.a_key = coalesce(p_key, '')
    UNION ALL
    SELECT c.* FROM conflicts c WHERE c.scene = coalesce(p_scene, '') AND c.b_key = coalesce(p_key, '');
END;
COMMENT ON FUNCTION conflicts_of(text, text) IS 'Conflicts of one object of a scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._keys_of_class(p_scene text, p_class text) RETURNS SETOF text
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT a.key FROM _seen_areas(_scene_or_branch(p_scene)) a WHERE a.class = p_class
    UNION ALL
    SELECT t.key FROM _seen_tracks(_scene_or_branch(p_scene)) t WHERE t.class = p_class;
END;
COMMENT ON FUNCTION _keys_of_class(text, text) IS 'Keys of the objects of a class.';

CREATE OR REPLACE FUNCTION conflictdb_internal._conflicts(
    p_scene text, p_at timestamptz, p_with_region boolean, p_keys text[], p_key text, p_from timestamptz,
    p_to timestamptz, p_since timestamptz, p_verdict text, p_acknowledged boolean, p_class text
) RETURNS TABLE (
    a_key text, a_kind text, b_key text, b_kind text, periods bytea, verdict text, region text,
    first_contact_lon_deg double precision, first_contact_lat_deg double precision, method text,
    time_error_s double precision, is_current boolean, run_id bigint, found_at timestamptz, closest_at timestamptz,
    closest_m double precision, closest_error_m double precision, closest_a_lon_deg double precision,
    closest_a_lat_deg double precision, closest_b_lon_deg double precision, closest_b_lat_deg double precision,
    scene_is_current boolean, conflict_id bigint, changed_at timestamptz, acknowledged_by text,
    acknowledged_at timestamptz, acknowledged_for text, acknowledged_until timestamptz, a_name text, b_name text,
    lacking_s double precision, certainty text, a_id bigint, a_version bigint, b_id bigint, b_version bigint
)
LANGUAGE sql STABLE
BEGIN ATOMIC
    -- Inlined, so that a cursor streams rows instead of storing the result first.
    -- 25 decimals give all digits of a double; PostGIS writes values below 1e-8 with an exponent.
    SELECT c.a_key, c.a_kind, c.b_key, c.b_kind, multirange_send(c.periods), c.verdict,
           CASE WHEN p_with_region THEN ST_AsGeoJSON(c.region, 25) END,
           ST_X(c.first_contact_point), ST_Y(c.first_contact_point), c.method, c.time_error_s, c.is_current,
           c.run_id, c.found_at, c.closest_at, c.closest_m, c.closest_error_m, ST_X(c.closest_a_point),
           ST_Y(c.closest_a_point), ST_X(c.closest_b_point), ST_Y(c.closest_b_point), c.scene_is_current,
           c.conflict_id, c.changed_at, c.acknowledged_by, c.acknowledged_at, c.acknowledged_for,
           c.acknowledged_until, c.a_name, c.b_name, c.lacking_s, c.certainty, k.a_id, k.a_version, k.b_id,
           k.b_version
    FROM conflicts c
    LEFT JOIN conflict k ON p_with_region AND k.scene_id = ANY ((SELECT _layers(_scene_or_branch(p_scene)))::bigint[])
                            AND k.conflict_id = c.conflict_id
                            AND k.a_key = c.a_key AND k.b_key = c.b_key
    WHERE c.scene = p_scene AND _scene_or_branch(p_scene) IS NOT NULL AND (p_at IS NULL OR c.periods @> p_at)
      AND (p_keys IS NULL OR c.a_key = ANY (p_keys) AND c.b_key = ANY (p_keys))
      AND (p_key IS NULL OR _check_key(p_scene, p_key) AND p_key IN (c.a_key, c.b_key))
      -- Conflicts of one object are looked up by their numbers: the planner does not know that a conflict has one of
      -- the scenes, and would read the indexes of keys, which begin with the scene, in full.
      AND (p_key IS NULL OR c.conflict_id = ANY (ARRAY(
              SELECT o.conflict_id FROM conflict o
              WHERE o.scene_id = ANY ((SELECT _layers(_scene_or_branch(p_scene)))::bigint[]) AND o.a_key = p_key
              UNION ALL
              SELECT o.conflict_id FROM conflict o
              WHERE o.scene_id = ANY ((SELECT _layers(_scene_or_branch(p_scene)))::bigint[]) AND o.b_key = p_key)))
      AND (num_nulls(p_from, p_to) = 2 OR c.periods && tstzrange(p_from, p_to))
      AND (p_since IS NULL OR greatest(c.found_at, c.changed_at) >= p_since)
      AND (p_verdict IS NULL OR c.verdict = p_verdict)
      AND (p_acknowledged IS NULL OR p_acknowledged = (c.acknowledged_by IS NOT NULL))
      AND (p_class IS NULL OR c.a_key IN (SELECT _keys_of_class(p_scene, p_class))
           OR c.b_key IN (SELECT _keys_of_class(p_scene, p_class)))
    ORDER BY lower(c.periods) NULLS FIRST, c.a_key, c.b_key;
END;
COMMENT ON FUNCTION _conflicts(text, timestamptz, boolean, text[], text, timestamptz, timestamptz, timestamptz, text,
                               boolean, text) IS
'Conflicts of a scene, earliest first. Only those at p_at, among p_keys, of p_key, in [p_from, p_to), opened or '
'changed since p_since, with a verdict, acknowledged or not, of an object of a class; null: all. Periods in binary. '
'Ids and versions of objects only p_with_region. Raises ZC011 for an unknown p_key.';

CREATE OR REPLACE FUNCTION conflicts_of_class(p_scene text, p_class text) RETURNS SETOF conflicts
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    SELECT c.* FROM conflicts c
    WHERE c.scene = coalesce(p_scene, '') AND _warn_if_incomplete(p_scene)
      AND (c.a_key IN (SELECT _keys_of_class(p_scene, p_class))
           OR c.b_key IN (SELECT _keys_of_class(p_scene, p_class)));
END;
COMMENT ON FUNCTION conflicts_of_class(text, text) IS
'Conflicts of a scene with an object of a class; none for a class without objects.';

CREATE OR REPLACE FUNCTION approaches_of(p_scene text, p_key text) RETURNS SETOF approaches
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    -- As in conflicts_of.
    SELECT c.* FROM approaches c
    WHERE c.scene = coalesce(p_scene, '') AND _warn_if_incomplete(p_scene) AND _warn_if_no_object(p_scene, p_key)
      AND c.a_key = coalesce(p_key, '')
    UNION ALL
    SELECT c.* FROM approaches c WHERE c.scene = coalesce(p_scene, '') AND c.b_key = coalesce(p_key, '');
END;
COMMENT ON FUNCTION approaches_of(text, text) IS 'Closest approaches of one object of a scene to others.';

CREATE OR REPLACE FUNCTION conflictdb_internal._window(p_geometry geometry, p_plane text) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Margins: a millimetre (_meets); on great circles up to 0.1 degrees of latitude, next to a pole, by which sides of
    -- 25 km (_from_gnomonic) leave the box.
    WITH shown AS MATERIALIZED (
        SELECT CASE WHEN p_plane IN ('wgs84', 'sphere') THEN ST_Expand(p_geometry, 1e-7)
                    ELSE ST_Expand(_wrapped(_from_plane(_to_plane(p_geometry, p_plane), p_plane)), 1e-7, 0.2) END AS box
    )
    -- At the antimeridian regions may lie on both sides.
    SELECT CASE WHEN ST_XMin(s.box) > -180 AND ST_XMax(s.box) < 180 THEN ST_Envelope(s.box)
                ELSE ST_MakeEnvelope(-180, ST_YMin(s.box), 180, ST_YMax(s.box), 4326) END
    FROM shown s;
END;
COMMENT ON FUNCTION _window(geometry, text) IS
'Bounding box (degrees, within +-180) for an index search: all regions that meet a geometry (longitude and latitude) '
'in the plane touch it.';

CREATE OR REPLACE FUNCTION conflictdb_internal._met_by_place(
    p_scene_id bigint, p_geometry geometry, p_span tstzrange, p_floor_m double precision, p_ceiling_m double precision,
    p_reach_m double precision
) RETURNS TABLE (object_kind smallint, object_id bigint, version bigint, span tstzrange, region geometry)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT
SET enable_hashjoin = off SET enable_mergejoin = off SET enable_material = off SET enable_seqscan = off
SET jit = off AS $$
DECLARE
    v_within_s double precision := _longest_time_s(p_scene_id);
    v_wanted_m double precision := _wanted_m(p_scene_id);
    v_place geometry := p_geometry;
BEGIN
    SELECT _near_centre(p_geometry, s.centre_lon, s.centre_lat) INTO v_place
        FROM scene s WHERE s.scene_id = p_scene_id AND s.motion = 'great_circle';
    RETURN QUERY
        WITH given AS MATERIALIZED (
            -- Of no class: compared with all.
            SELECT r.*, (r.rough).span FROM _rough_pieces_at(
                p_scene_id, v_wanted_m, ARRAY[0::smallint], ARRAY[NULL::bigint], '{}', ARRAY[true],
                ARRAY[coalesce(v_place, p_geometry)], ARRAY[p_reach_m],
                ARRAY[tstzmultirange(p_span)], ARRAY[p_floor_m], ARRAY[p_ceiling_m]) r
        )
        SELECT p.object_kind, p.object_id, p.version, _shared_span(u.span, g.span, v_within_s),
               ST_Intersection(u.hull, ST_Buffer(g.shape, 1.01 * g.padding_m))
        FROM given g
        JOIN piece p ON _pieces_may_meet(g.rough, p, v_within_s, NULL) AND p.scene_id = p_scene_id
        CROSS JOIN LATERAL _pieces_of(p) u
        WHERE _pieces_may_meet(g.rough, u, v_within_s, NULL) AND _hulls_meet(u.hull, g.shape, g.padding_m)
          AND NOT EXISTS (SELECT FROM change c WHERE c.scene_id = p_scene_id AND c.object_kind = p.object_kind
                          AND c.object_id = p.object_id AND NOT c.is_covered)
        UNION ALL
        SELECT u.object_kind, u.object_id, 9223372036854775807, _shared_span(u.span, g.span, v_within_s), NULL
        FROM _uncut_pieces(p_scene_id, v_wanted_m, false,
                           _widened(tstzrange(lower(p_span), upper(p_span), '[]'), v_within_s)) u
        JOIN given g ON _pieces_may_meet(g.rough, u, v_within_s, NULL);
END
$$;
COMMENT ON FUNCTION _met_by_place(
    bigint, geometry, tstzrange, double precision, double precision, double precision) IS
'Stages 1 and 2: pieces of a scene that meet a geometry (longitude and latitude, degrees), or all within a reach of it '
'(metres), during a span and between two heights (metres; null: unbounded), and rough pieces of objects that changed '
'since, without region.';

CREATE OR REPLACE FUNCTION conflictdb_internal._placeless_within(p_scene text, p_geometry geometry)
RETURNS SETOF bigint
-- One lookup in the index of conflicts without a region says that there are none, whatever the statistics.
LANGUAGE plpgsql STABLE PARALLEL RESTRICTED ROWS 10 SET search_path FROM CURRENT
SET enable_seqscan = off SET jit = off AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_within_s double precision := _longest_time_s(v_scene_id);
    -- Regions reach beyond swept hulls by this or the tolerance, metres; first contacts are rounded.
    c_slack_m CONSTANT double precision := 1;
BEGIN
    IF NOT EXISTS (SELECT FROM conflict c
                   WHERE c.scene_id = v_scene_id AND c.verdict <> 'near' AND c.region IS NULL) THEN
        RETURN;
    END IF;
    RAISE NOTICE 'scene %: has conflicts without regions: those whose swept hulls meet the place are in the answer',
                 quote_literal(p_scene)
        USING HINT = 'With method exact and the setting regions on, the next detection computes regions.';
    RETURN QUERY
        WITH near AS MATERIALIZED (
            -- At all times: a region is of all periods.
            SELECT m.object_kind, m.object_id, range_agg(_widened(m.span, v_within_s)) AS spans
            FROM _met_by_place(v_scene_id, p_geometry, tstzrange(NULL, NULL), NULL, NULL,
                               (SELECT greatest(s.tolerance_m, c_slack_m) FROM scene s
                                WHERE s.scene_id = v_scene_id)) m
            GROUP BY m.object_kind, m.object_id
        )
        SELECT c.conflict_id FROM conflict c
        LEFT JOIN near a ON a.object_kind = c.a_kind AND a.object_id = c.a_id
        LEFT JOIN near b ON b.object_kind = c.b_kind AND b.object_id = c.b_id
        WHERE c.scene_id = v_scene_id AND c.verdict <> 'near' AND c.region IS NULL
          AND (a.spans && c.periods AND b.spans && c.periods
               -- Pieces of changed objects are not those of the conflict.
               OR EXISTS (SELECT FROM change m WHERE m.scene_id = v_scene_id
                          AND (m.object_kind, m.object_id) IN ((c.a_kind, c.a_id), (c.b_kind, c.b_id))));
END
$$;
COMMENT ON FUNCTION _placeless_within(text, geometry) IS
'Ids of the conflicts of a scene without a region that may be at a geometry (longitude and latitude, degrees): stages '
'1 and 2 on the geometry and both objects, a superset of the truth. Raises a NOTICE if there are conflicts without a '
'region.';

CREATE OR REPLACE FUNCTION conflicts_within(p_scene text, p_geometry geometry, p_span tstzrange)
RETURNS SETOF conflicts
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    SELECT c.* FROM conflicts c
    WHERE c.scene = coalesce(p_scene, '') AND _warn_if_incomplete(p_scene)
      AND _check_place(p_geometry, p_span, NULL, NULL) AND _warn_if_beyond_horizon(p_scene, p_span)
      AND c.periods && coalesce(p_span, tstzrange(NULL, NULL))
      AND c.region && (SELECT _window(p_geometry, _plane(o.motion, o.earth, o.centre_lon, o.centre_lat))
                       FROM scene o WHERE o.scene_id = _scene_id(p_scene))
      AND _meets(c.region, p_geometry, (SELECT _plane(o.motion, o.earth, o.centre_lon, o.centre_lat)
                                        FROM scene o WHERE o.scene_id = _scene_id(p_scene)))
    UNION ALL
    SELECT c.* FROM conflicts c
    WHERE c.scene = coalesce(p_scene, '') AND _check_place(p_geometry, p_span, NULL, NULL)
      AND c.conflict_id IN (SELECT w.id FROM _placeless_within(p_scene, p_geometry) w (id))
      AND c.periods && coalesce(p_span, tstzrange(NULL, NULL));
END;
COMMENT ON FUNCTION conflicts_within(text, geometry, tstzrange) IS
'Conflicts of a scene whose region meets a geometry (longitude and latitude, SRID 4326) and whose periods overlap a '
'span (null: unbounded). Of conflicts without a region: those whose objects'' swept hulls meet the geometry, a '
'superset, and a NOTICE.';

CREATE OR REPLACE FUNCTION probe(
    p_scene text, p_geometry geometry, p_span tstzrange DEFAULT tstzrange(NULL, NULL),
    p_floor_m double precision DEFAULT NULL, p_ceiling_m double precision DEFAULT NULL
) RETURNS TABLE (key text, kind text, spans tstzmultirange, region geometry)
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    SELECT coalesce(a.key, t.key), CASE n.object_kind WHEN 0 THEN 'area' ELSE 'track' END, n.spans, n.region
    FROM (SELECT x.object_kind, x.object_id, x.version, range_agg(x.span) AS spans,
                 ST_Union(_part_from_plane(x.region, s.plane)) AS region
          FROM _met_by_place(_scene_id(p_scene), p_geometry, coalesce(p_span, tstzrange(NULL, NULL)), p_floor_m,
                             p_ceiling_m, 0) x
          CROSS JOIN (SELECT _plane(o.motion, o.earth, o.centre_lon, o.centre_lat) AS plane FROM scene o
                      WHERE o.scene_id = _scene_id(p_scene) OFFSET 0) s
          GROUP BY x.object_kind, x.object_id, x.version) n
    LEFT JOIN area a ON n.object_kind = 0 AND a.area_id = n.object_id AND a.first_version <= n.version
    LEFT JOIN track t ON n.object_kind = 1 AND t.track_id = n.object_id AND t.first_version <= n.version
    WHERE coalesce(a.scene_id, t.scene_id) = (SELECT s.scene_id FROM scene s WHERE s.name = p_scene)
      AND _warn_if_incomplete(p_scene) AND _check_place(p_geometry, p_span, p_floor_m, p_ceiling_m)
      AND _warn_if_beyond_horizon(p_scene, _widened(p_span, _longest_time_s(_scene_id(p_scene))));
END;
COMMENT ON FUNCTION probe(text, geometry, tstzrange, double precision, double precision) IS
'Objects that an area (longitude and latitude, SRID 4326; heights in metres; null: unbounded) might conflict with: '
'stages 1 and 2, a superset of the truth. spans: when; region: longitude and latitude in degrees; null for '
'objects that no detection has seen as they are, which are compared by their boxes. Writes nothing.';

CREATE OR REPLACE FUNCTION candidates(p_scene text)
RETURNS TABLE (a_key text, a_kind text, b_key text, b_kind text, spans tstzmultirange, region geometry)
LANGUAGE sql STABLE PARALLEL RESTRICTED
BEGIN ATOMIC
    SELECT CASE WHEN c.a_kind = c.b_kind THEN least(k.a, k.b) ELSE k.a END,
           CASE c.a_kind WHEN 0 THEN 'area' ELSE 'track' END,
           CASE WHEN c.a_kind = c.b_kind THEN greatest(k.a, k.b) ELSE k.b END,
           CASE c.b_kind WHEN 0 THEN 'area' ELSE 'track' END, c.spans, c.region
    FROM (SELECT a.object_kind AS a_kind, a.object_id AS a_id, a.version AS a_version,
                 b.object_kind AS b_kind, b.object_id AS b_id, b.version AS b_version,
                 range_agg(m.span) AS spans, ST_Union(_part_from_plane(m.part, s.plane)) AS region
          FROM (SELECT o.scene_id, _plane(o.motion, o.earth, o.centre_lon, o.centre_lat) AS plane,
                       _longest_time_s(o.scene_id) AS within_s, _allowed_types(o.scene_id) AS rules
                FROM scene o
                WHERE o.scene_id = _scene_id(p_scene) OFFSET 0) s
          CROSS JOIN LATERAL (SELECT o.* FROM piece o WHERE o.scene_id = s.scene_id OFFSET 0) a
          -- OFFSET 0: the index looks up the wide span, too.
          CROSS JOIN LATERAL (SELECT o.* FROM piece o
                              WHERE o.scene_id = a.scene_id
                                AND _pieces_may_meet((a.*)::piece, o, s.within_s, s.rules) OFFSET 0) b
          -- MATERIALIZED: unpack each row once per pair of rows, not once per piece of the other.
          CROSS JOIN LATERAL (WITH m AS MATERIALIZED (
                                  SELECT o.* FROM _pieces_of((a.*)::piece) o
                                  WHERE _pieces_may_meet(o, (b.*)::piece, s.within_s, NULL)
                              ), n AS MATERIALIZED (
                                  SELECT o.* FROM _pieces_of((b.*)::piece) o
                                  WHERE _pieces_may_meet(o, (a.*)::piece, s.within_s, NULL)
                              )
                              SELECT _shared_span(m.span, n.span, s.within_s) AS span,
                                     ST_Intersection(m.hull, n.hull) AS part
                              FROM m JOIN n ON _pieces_may_meet((m.*)::piece, (n.*)::piece, s.within_s, NULL)
                                               AND _hulls_meet(m.hull, n.hull)
                              OFFSET 0) m
          WHERE (a.object_kind, a.object_id) < (b.object_kind, b.object_id)
          GROUP BY a.object_kind, a.object_id, a.version, b.object_kind, b.object_id, b.version) c
    LEFT JOIN area aa ON c.a_kind = 0 AND aa.area_id = c.a_id AND aa.first_version <= c.a_version
    LEFT JOIN track ta ON c.a_kind = 1 AND ta.track_id = c.a_id AND ta.first_version <= c.a_version
    LEFT JOIN area ab ON c.b_kind = 0 AND ab.area_id = c.b_id AND ab.first_version <= c.b_version
    LEFT JOIN track tb ON c.b_kind = 1 AND tb.track_id = c.b_id AND tb.first_version <= c.b_version
    CROSS JOIN LATERAL (SELECT coalesce(aa.key, ta.key) AS a, coalesce(ab.key, tb.key) AS b) k
    WHERE coalesce(aa.scene_id, ta.scene_id) = (SELECT s.scene_id FROM scene s WHERE s.name = p_scene)
      AND coalesce(ab.scene_id, tb.scene_id) = (SELECT s.scene_id FROM scene s WHERE s.name = p_scene)
      AND _warn_if_incomplete(p_scene);
END;
COMMENT ON FUNCTION candidates(text) IS
'Pairs of objects of a scene that might conflict: stages 1 and 2 on the pieces of the last detection, a superset of '
'the truth. a and b as in the view conflicts. spans: when pieces that meet both exist; region: intersection of their '
'hulls, longitude and latitude in degrees; null if they only come within a micrometre.';
