-- State of scenes: whether the list of conflicts is complete.

CREATE OR REPLACE FUNCTION conflictdb_internal._is_current(p_scene_id bigint) RETURNS boolean
LANGUAGE plpgsql STABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT
-- Forces a plain index scan: after many marks were deleted the statistics are outdated, and only this scan flags dead
-- index entries, so that the next scan skips them. Without jit, as the forced plan has an inflated cost.
SET enable_seqscan = off SET enable_bitmapscan = off SET jit = off AS $$
BEGIN
    IF p_scene_id IS NULL THEN
        RETURN NULL;
    END IF;
    -- Every change, also of settings, leaves marks until a detection succeeds.
    RETURN NOT EXISTS (SELECT FROM change m WHERE m.scene_id = p_scene_id)
           AND NOT EXISTS (SELECT FROM attachment a JOIN attached_change q USING (attachment_id)
                           WHERE a.scene_id = p_scene_id)
           AND NOT EXISTS (SELECT FROM attachment a
                           WHERE a.scene_id = p_scene_id AND _attachment_remark(a) IS NOT NULL)
           -- A branch reads its parent.
           AND coalesce(_is_current(_parent_of(p_scene_id)), true)
           AND NOT _is_behind_parent(p_scene_id)
           AND (EXISTS (SELECT FROM run r WHERE r.scene_id = p_scene_id AND r.error IS NULL)
                OR NOT EXISTS (SELECT FROM area a WHERE a.scene_id = p_scene_id)
                   AND NOT EXISTS (SELECT FROM track t WHERE t.scene_id = p_scene_id));
END
$$;
COMMENT ON FUNCTION _is_current(bigint) IS
'Whether no object, setting or attached table of a scene changed since its last successful detection. False also if '
'changes of an attached table may be missed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_waiting(p_scene_id bigint) RETURNS bigint
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Count a row once, even if it changed twice or was recorded before and after the change.
    SELECT count(DISTINCT (q.attachment_id, i.identity))
    FROM attachment a JOIN attached_change q USING (attachment_id)
    LEFT JOIN LATERAL unnest(q.identities) i (identity) ON true
    WHERE a.scene_id = p_scene_id;
END;
COMMENT ON FUNCTION _attached_waiting(bigint) IS
'Number of rows of attached tables of a scene whose changes are not applied yet; a change of a whole table counts as '
'one.';

CREATE OR REPLACE FUNCTION conflictdb_internal._views_compared_at(p_scene_id bigint) RETURNS timestamptz
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN (SELECT min(coalesce(a.compared_at, '-infinity')) FROM attachment a
            WHERE NOT a.has_triggers AND a.scene_id = ANY (_layers(p_scene_id)));
END
$$;
COMMENT ON FUNCTION _views_compared_at(bigint) IS
'Earliest last comparison of the attachments of a scene, and of its parent, that have no triggers: -infinity if one '
'was never compared; null if there is none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._count_pending(p_scene_id bigint) RETURNS bigint
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT count(*)
    FROM (SELECT DISTINCT coalesce(o.kind, m.object_kind), coalesce(o.id, m.object_id)
          FROM _layer l JOIN change m ON m.scene_id = l.scene_id
          -- An edit marks the object of the parent and its copy, which people count as one.
          LEFT JOIN (SELECT e.object_kind, e.object_id, c.kind, c.id
                     FROM branch_edit e
                     CROSS JOIN LATERAL (SELECT 0::smallint AS kind, a.area_id AS id
                                         FROM area a WHERE a.scene_id = e.scene_id AND a.key = e.key
                                         UNION ALL
                                         SELECT 1::smallint, t.track_id
                                         FROM track t WHERE t.scene_id = e.scene_id AND t.key = e.key) c
                     WHERE e.scene_id = p_scene_id) o ON o.object_kind = m.object_kind AND o.object_id = m.object_id
          WHERE l.seen_by = p_scene_id) d;
END;
COMMENT ON FUNCTION _count_pending(bigint) IS
'Number of objects of a scene that wait for detection, of a branch also those of its parent; an object that a branch '
'edited counts as one.';

CREATE OR REPLACE VIEW scenes WITH (security_invoker = true) AS
SELECT s.name AS scene, s.motion, s.earth, s.centre_lon, s.centre_lat, s.method, s.tolerance_m, s.separation_m,
       s.nearest_m,
       (SELECT count(*) FROM _seen_areas(s.scene_id) a) + (SELECT count(*) FROM _seen_tracks(s.scene_id) t) AS objects,
       _count_pending(s.scene_id) + _attached_waiting(s.scene_id) + coalesce(_attached_waiting(s.parent_scene_id), 0)
           AS pending,
       r.run_id AS last_run_id, r.finished_at AS last_run_at, r.error AS last_error,
       _is_current(s.scene_id) AS is_current,
       (SELECT count(*) FROM attachment a JOIN attached_object o USING (attachment_id)
        WHERE a.scene_id = s.scene_id AND o.reason IS NOT NULL) AS unmapped,
       s.vertical_separation_m, s.time_separation_s, s.delays_within_s, s.intervals, s.horizon_days,
       lower(_expanded(s.scene_id)) AS expanded_from, upper(_expanded(s.scene_id)) AS expanded_until,
       p.name AS branch_of, s.vertical_datum, nullif(_views_compared_at(s.scene_id), '-infinity') AS compared_at,
       s.regions
FROM scene s
LEFT JOIN scene p ON p.scene_id = s.parent_scene_id
LEFT JOIN LATERAL (SELECT x.run_id, x.finished_at, x.error FROM run x WHERE x.scene_id = s.scene_id
                   ORDER BY x.run_id DESC LIMIT 1) r ON true;

COMMENT ON COLUMN scenes.compared_at IS
'Up to when its attached views, and other tables without triggers, were compared (the earliest of them): is_current '
'says nothing about later changes behind them. Null: it has none, or one was never compared.';
COMMENT ON COLUMN scenes.branch_of IS
'Name of the scene that this one is a branch of: it has the objects of that scene, but for those it has edited; null: '
'it is no branch.';
COMMENT ON VIEW scenes IS 'Scenes with their settings, contents and state.';
COMMENT ON COLUMN scenes.scene IS 'Name of the scene.';
COMMENT ON COLUMN scenes.motion IS 'Shape of tracks and edges between their points: rhumb or great_circle.';
COMMENT ON COLUMN scenes.earth IS 'Figure of the earth: wgs84, or sphere (mean radius 6371008.771415 m).';
COMMENT ON COLUMN scenes.centre_lon IS
'great_circle: longitude of the gnomonic plane''s centre, degrees; all objects lie within 60 degrees of it. Null for '
'rhumb, and until it is given or the first object sets it.';
COMMENT ON COLUMN scenes.centre_lat IS
'great_circle: latitude of the centre, degrees. Null for rhumb, and until it is given or the first object sets it.';
COMMENT ON COLUMN scenes.method IS
'Where a detection stops: screen (who might meet), exact (certified times), '
'nlp (certified times, found by the published program).';
COMMENT ON COLUMN scenes.tolerance_m IS
'Tolerance, metres: pairs whose clearance is within it may be reported as grazing.';
COMMENT ON COLUMN scenes.separation_m IS
'Required separation between polygons, metres; 0: they conflict if they touch.';
COMMENT ON COLUMN scenes.nearest_m IS
'Pairs without conflict that come within this distance (metres) are stored with their closest approach; 0: none.';
COMMENT ON COLUMN scenes.objects IS 'Number of areas and tracks.';
COMMENT ON COLUMN scenes.pending IS
'Number of objects that wait for detection: changed, removed, or all after a change of settings. Includes rows of '
'attached tables whose changes are not applied yet; a change of a whole table counts as one.';
COMMENT ON COLUMN scenes.last_run_id IS 'Last detection, also if it failed; null if there was none.';
COMMENT ON COLUMN scenes.last_run_at IS 'When it ended; null if there was none.';
COMMENT ON COLUMN scenes.last_error IS 'Why it failed; null if it succeeded, or if there was none.';
COMMENT ON COLUMN scenes.is_current IS
'Whether its conflicts are complete: nothing changed since the last successful detection, and changes of attached '
'tables are recorded (tables without triggers: up to their last comparison). Rows in unmapped are not included.';
COMMENT ON COLUMN scenes.unmapped IS
'Number of rows of attached tables whose current values do not make an object (view unmapped).';

COMMENT ON COLUMN scenes.vertical_separation_m IS
'Required vertical separation, metres to the micrometre: objects whose heights are that far apart do not conflict; '
'0: height bands that touch are apart.';
COMMENT ON COLUMN scenes.time_separation_s IS
'Required separation in time, whole microseconds in seconds: two objects conflict if they use one place within so many '
'seconds; 0: at the same time.';

COMMENT ON COLUMN scenes.delays_within_s IS
'Detections store which delays of each track, up to this many seconds either way, are in conflict; 0: none.';
COMMENT ON COLUMN scenes.intervals IS
'Whether spans and height bands contain their upper ends: half_open (they do not) or closed (they do, as volumes of '
'ASTM F3548).';

COMMENT ON COLUMN scenes.horizon_days IS
'How many days ahead of today schedules are expanded; they are over all voyages, too.';
COMMENT ON COLUMN scenes.vertical_datum IS
'What heights are above: msl (mean sea level), wgs84 (the ellipsoid) or flight_level (the surface of 1013.25 hPa, in '
'metres of the standard atmosphere).';
COMMENT ON COLUMN scenes.regions IS
'Whether detections store the region of each conflict: on, or off (quicker and smaller; queries by place then compare '
'swept hulls).';
COMMENT ON COLUMN scenes.expanded_from IS
'Schedules are expanded from here; null: none is. Before it, activations of schedules are not known.';
COMMENT ON COLUMN scenes.expanded_until IS
'Schedules are expanded up to here; null: none is. After it, activations of schedules are not known yet.';

-- The settings in the table have the comments of the view.
DO $$
DECLARE
    v_column record;
BEGIN
    FOR v_column IN
        SELECT t.attname, col_description('scenes'::regclass, v.attnum) AS said
        FROM pg_catalog.pg_attribute v JOIN pg_catalog.pg_attribute t USING (attname)
        WHERE v.attrelid = 'scenes'::regclass AND v.attnum > 0 AND t.attrelid = 'scene'::regclass
    LOOP
        EXECUTE format('COMMENT ON COLUMN scene.%I IS %L', v_column.attname, v_column.said);
    END LOOP;
END
$$;

CREATE OR REPLACE VIEW queue WITH (security_invoker = true) AS
SELECT s.name AS scene, w.waiting_since, w.changes, w.attached_changes, h.pid AS worker_pid, h.application AS worker,
       h.role AS worker_role, h.since AS worked_on_since, r.error AS last_error
FROM (
    SELECT m.scene_id, min(m.changed_at) AS waiting_since, count(*) FILTER (WHERE NOT m.is_attached) AS changes,
           count(*) FILTER (WHERE m.is_attached) AS attached_changes
    FROM (SELECT c.scene_id, min(c.changed_at) AS changed_at, false AS is_attached
          FROM change c GROUP BY c.scene_id, c.object_kind, c.object_id
          UNION ALL
          SELECT a.scene_id, q.changed_at, true FROM attachment a JOIN attached_change q USING (attachment_id)) m
    GROUP BY m.scene_id
) w
JOIN scene s USING (scene_id)
LEFT JOIN LATERAL (SELECT x.error FROM run x WHERE x.scene_id = s.scene_id ORDER BY x.run_id DESC LIMIT 1) r ON true
LEFT JOIN LATERAL (SELECT x.* FROM _scene_holders(s.scene_id) x LIMIT 1) h ON true;

COMMENT ON VIEW queue IS
'Scenes that wait for detection, and the workers that detect them. Workers take the longest waiting first.';
COMMENT ON COLUMN queue.scene IS 'Name of the scene.';
COMMENT ON COLUMN queue.waiting_since IS 'Time of the first waiting change.';
COMMENT ON COLUMN queue.changes IS
'Number of objects that were changed or removed, or are affected by a change of settings.';
COMMENT ON COLUMN queue.attached_changes IS
'Number of changes of attached tables that are not applied yet, one per statement.';
COMMENT ON COLUMN queue.worker_pid IS 'Server process that detects the scene; null if there is none at the moment.';
COMMENT ON COLUMN queue.worker IS
'Its application_name, for example conflictdb worker; null if worker_pid is null.';
COMMENT ON COLUMN queue.worker_role IS 'Its database user; null if worker_pid is null.';
COMMENT ON COLUMN queue.worked_on_since IS 'Start of its transaction; null if worker_pid is null.';
COMMENT ON COLUMN queue.last_error IS
'Why the last detection of the scene failed; null if it succeeded, or if there was none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_state(
    p_scene text, OUT objects bigint, OUT pending bigint, OUT last_run_at timestamptz, OUT last_error text,
    OUT is_current boolean, OUT remark text, OUT detected_at timestamptz, OUT compared_at timestamptz,
    OUT detection_helps boolean
)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_or_branch(p_scene);
    v_attached bigint := _attached_waiting(coalesce(_parent_of(v_scene_id), v_scene_id));
    v_waiting bigint;
    v_unmapped bigint;
BEGIN
    SELECT v.pending, v.last_run_at, v.last_error, v.is_current, v.unmapped, v.compared_at
        INTO pending, last_run_at, last_error, is_current, v_unmapped, compared_at FROM scenes v
        WHERE v.scene = p_scene;
    SELECT r.finished_at, r.objects INTO detected_at, objects FROM run r
        WHERE r.scene_id = v_scene_id AND r.error IS NULL ORDER BY r.run_id DESC LIMIT 1;
    -- Counting takes 0.4 s in a scene of a million objects; no object changed since the last run of a current scene.
    IF objects IS NULL OR NOT is_current THEN
        objects := _count_objects(v_scene_id);
    END IF;
    v_waiting := pending - v_attached;
    remark := nullif(concat_ws('; ',
        CASE WHEN NOT is_current THEN
            CASE WHEN detected_at IS NULL AND _parent_of(v_scene_id) IS NULL THEN 'never detected: ' ELSE '' END
            || v_waiting
            || CASE v_waiting WHEN 1 THEN ' object waits' ELSE ' objects wait' END || ' for detection' END,
        CASE WHEN v_attached > 0 THEN 'changes of an attached table wait to be taken over' END,
        (SELECT string_agg(format('%s: %s', _attached_name(a), _attachment_remark(a)), '; '
                           ORDER BY a.attachment_id)
         FROM attachment a
         WHERE a.scene_id = ANY ((SELECT _layers(v_scene_id))::bigint[]) AND _attachment_remark(a) IS NOT NULL),
        CASE WHEN v_unmapped > 0 THEN v_unmapped || CASE v_unmapped WHEN 1 THEN ' row of an attached table is' ELSE
            ' rows of attached tables are' END || ' left out (view unmapped)' END,
        'an attached table cannot be read: ' || (SELECT a.error FROM attachment a WHERE a.scene_id = v_scene_id
                                                 AND a.error IS NOT NULL ORDER BY a.failed_at DESC LIMIT 1),
        'the last detection failed: ' || last_error), '');
    -- A detection follows only tables of its own role.
    detection_helps := NOT is_current
        AND (v_waiting > 0 OR detected_at IS NULL OR v_attached = 0 AND NOT EXISTS (
                 SELECT FROM attachment a
                 WHERE a.scene_id = ANY (_layers(v_scene_id)) AND _attachment_remark(a) IS NOT NULL)
             OR EXISTS (SELECT FROM attachment a
                        WHERE a.scene_id = ANY (_layers(v_scene_id)) AND _is_mine(a.attachment_id)
                          AND (_is_due(a) OR _is_moved(a)
                               OR EXISTS (SELECT FROM attached_change q WHERE q.attachment_id = a.attachment_id))));
END
$$;
COMMENT ON FUNCTION _scene_state(text) IS
'State of a scene as in the view scenes; remark: what is wrong in words (null: nothing); detected_at: end of the last '
'successful detection (null: none); detection_helps: whether a detection by the current role makes it more current. '
'Raises ZC010 for an unknown name.';

CREATE OR REPLACE FUNCTION wait_until_current(p_scene text, p_timeout interval DEFAULT interval '1 minute')
RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    c_pause_s CONSTANT double precision := 0.1;
    v_called_at timestamptz := clock_timestamp();
    v_until timestamptz := _end_of_wait(p_timeout);
    v_who text := format('scene %L', p_scene);
    v_scene_id bigint := _scene_or_branch(p_scene);
BEGIN
    BEGIN
        -- Asks for comparisons (_is_awaited). The lock is given back with the block.
        PERFORM pg_advisory_xact_lock_shared(_wait_class(), _wait_number(l.scene_id))
            FROM unnest(_layers(v_scene_id)) l (scene_id)
            WHERE EXISTS (SELECT FROM attachment a WHERE a.scene_id = l.scene_id AND NOT a.has_triggers);
        -- Each turn sees what other sessions have committed, including removal of the scene.
        WHILE NOT _is_current(_scene_or_branch(p_scene))
              OR _views_compared_at(v_scene_id) NOT BETWEEN v_called_at AND clock_timestamp() LOOP
            IF current_setting('transaction_isolation') <> 'read committed' THEN
                FOUND := _raise('ZC013', v_who, 'transaction',
                                format('is %s: it sees one state of the database until it ends, and would wait in vain',
                                       upper(current_setting('transaction_isolation'))),
                                'wait_sees_others', 'Wait in a transaction that is READ COMMITTED.');
            END IF;
            IF pg_current_xact_id_if_assigned() IS NOT NULL
               AND EXISTS (SELECT FROM change m JOIN scene s USING (scene_id)
                           WHERE s.name = p_scene AND m.changed_at = now()
                           UNION ALL
                           SELECT FROM attached_change q JOIN attachment a USING (attachment_id)
                           JOIN scene s USING (scene_id)
                           WHERE s.name = p_scene AND q.changed_at = now()) THEN
                FOUND := _raise('ZC013', v_who, 'transaction', 'has changed the scene itself, which no detection sees '
                                'until it is committed', 'wait_sees_committed', 'Commit first.');
            END IF;
            IF clock_timestamp() >= v_until THEN
                FOUND := _raise('ZC014', v_who, 'is_current', format('is not current after %s: %s', p_timeout, coalesce(
                                (SELECT s.remark FROM _scene_state(p_scene) s),
                                format('its views were compared last at %s, before the call',
                                       _views_compared_at(v_scene_id)))), 'scene_current_in_time',
                                'Is a worker running? Did the last run of the scene fail?');
            END IF;
            PERFORM pg_sleep(least(c_pause_s, extract(epoch FROM v_until - clock_timestamp())));
        END LOOP;
        RAISE EXCEPTION USING ERRCODE = 'ZC999';
    EXCEPTION WHEN SQLSTATE 'ZC999' THEN
        NULL;
    END;
END
$$;
COMMENT ON FUNCTION wait_until_current(text, interval) IS
'Waits until nothing of a scene waits for detection, and its views have been compared since the call: workers compare '
'them at once. Raises ZC014 after p_timeout (null: waits without limit), and ZC013 in a transaction that cannot see '
'the result.';
