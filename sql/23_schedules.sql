-- Schedules: a detection expands them to activations of areas and departures of tracks, before it looks for changes.
-- conflictdb.model.schedules reads them; SQL stores them as they are written.

CREATE OR REPLACE FUNCTION conflictdb_internal._microseconds(p_at timestamptz) RETURNS bigint
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN isfinite(p_at) THEN (1000000 * extract(epoch FROM p_at))::bigint END;
END;
COMMENT ON FUNCTION _microseconds(timestamptz) IS
'Microseconds since 1970, null for infinity: instants that Python has no type for are numbers there.';

CREATE OR REPLACE FUNCTION conflictdb_internal._horizon(
    p_scene_id bigint, p_is_asked boolean, OUT horizon_days double precision, OUT from_us bigint, OUT until_us bigint,
    OUT is_waiting boolean, OUT starts_us bigint, OUT ends_us bigint
)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_parent scene%ROWTYPE;
BEGIN
    SELECT p.* INTO v_parent FROM scene p WHERE p.scene_id = _parent_of(p_scene_id);
    SELECT s.horizon_days, _microseconds(lower(s.expanded)), _microseconds(upper(s.expanded))
        INTO horizon_days, from_us, until_us
        FROM scene s WHERE s.scene_id = p_scene_id;
    SELECT bool_or(n.waits) INTO is_waiting
        FROM (SELECT a.activations IS NULL AS waits FROM area a
              WHERE a.scene_id = p_scene_id AND a.schedule IS NOT NULL
              UNION ALL
              SELECT t.departures IS NULL FROM track t WHERE t.scene_id = p_scene_id AND t.schedule IS NOT NULL) n;
    IF is_waiting IS NULL AND NOT p_is_asked THEN
        RETURN;
    END IF;
    -- Once the window is known, only voyages that changed can leave it, and those of the parent of a branch.
    SELECT _microseconds(min(lower(v.span))), _microseconds(max(upper(v.span))) INTO starts_us, ends_us
        FROM (SELECT _under_way(t.path, t.departures, t.tolerances, _schedules_within_s(p_scene_id)) AS span
              FROM track t
              WHERE t.scene_id IN (SELECT l.seen_by FROM _layer l WHERE l.scene_id = p_scene_id)
                AND t.schedule IS NULL
                AND (from_us IS NULL
                     OR t.track_id IN (SELECT c.object_id FROM change c
                                       WHERE c.scene_id = t.scene_id AND c.object_kind = 1))
              UNION ALL
              SELECT _under_way(t.path, t.departures, t.tolerances, _schedules_within_s(p_scene_id))
              FROM track t WHERE t.scene_id = v_parent.scene_id AND t.schedule IS NULL
              UNION ALL
              SELECT tstzrange(lower(v_parent.expanded), upper(v_parent.expanded) - interval '1 microsecond', '[]')
              WHERE v_parent.expanded IS NOT NULL) v;
END
$$;
COMMENT ON FUNCTION _horizon(bigint, boolean) IS
'How far the schedules of a scene are expanded, and how far the voyages reach that may have changed since. is_waiting: '
'whether a schedule is not expanded at all; null: there are no schedules, and voyages are null unless p_is_asked. '
'Of a branch, voyages include those of its parent, and how far its parent expands schedules. '
'Instants are microseconds since 1970.';

CREATE OR REPLACE FUNCTION conflictdb_internal._expanded_us(
    p_scene_id bigint, OUT from_us bigint, OUT until_us bigint
)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT _microseconds(lower(e)), _microseconds(upper(e)) FROM _expanded(p_scene_id) e;
END;
COMMENT ON FUNCTION _expanded_us(bigint) IS '_expanded, in microseconds since 1970.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scheduled(
    p_scene_id bigint, p_only_waiting boolean, p_area_ids bigint[], p_track_ids bigint[]
) RETURNS TABLE (
    object_kind smallint, object_id bigint, version bigint, key text, schedule text, starts_us bigint, ends_us bigint,
    box bytea
)
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT 0, a.area_id, a.version, a.key, a.schedule::text, _microseconds(lower(a.active_span)),
           _microseconds(upper(a.active_span)),
           ST_AsBinary(ST_Envelope(a.footprint), 'NDR')
    FROM area a WHERE a.scene_id = p_scene_id AND a.schedule IS NOT NULL
                  AND (a.activations IS NULL OR NOT p_only_waiting)
                  AND (p_area_ids IS NULL OR a.area_id = ANY (p_area_ids))
    UNION ALL
    SELECT 1, t.track_id, t.version, t.key, t.schedule::text, _microseconds(to_timestamp(ST_M(ST_StartPoint(t.path)))),
           _microseconds(to_timestamp(ST_M(ST_EndPoint(t.path)))), ST_AsBinary(ST_Force2D(ST_StartPoint(t.path)), 'NDR')
    FROM track t WHERE t.scene_id = p_scene_id AND t.schedule IS NOT NULL
                   AND (t.departures IS NULL OR NOT p_only_waiting)
                   AND (p_track_ids IS NULL OR t.track_id = ANY (p_track_ids));
END;
COMMENT ON FUNCTION _scheduled(bigint, boolean, bigint[], bigint[]) IS
'Objects of a scene with schedules, by their ids (null: all). starts_us, ends_us: the span of an area, the times of a '
'track, microseconds since 1970; null: unbounded. box: of an area, or the first waypoint of a track.';

CREATE OR REPLACE FUNCTION conflictdb_internal._set_activations(
    p_scene_id bigint, p_kinds smallint[], p_ids bigint[], p_versions bigint[], p_spans tstzmultirange[],
    p_departures timestamptz[], p_counts integer[], p_errors text[]
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_changed bigint;
    v_rows bigint;
BEGIN
    CREATE TEMPORARY TABLE IF NOT EXISTS expanded_schedule (
        kind smallint, id bigint, version bigint, spans tstzmultirange, departures timestamptz[], error text
    ) ON COMMIT DROP;
    TRUNCATE pg_temp.expanded_schedule;
    INSERT INTO pg_temp.expanded_schedule
        SELECT o.kind, o.id, o.version, o.spans, p_departures[o.first:o.last], o.error
        FROM (SELECT n.*, sum(n.count) OVER w - n.count + 1 AS first, sum(n.count) OVER w AS last
              FROM ROWS FROM (unnest(p_kinds), unnest(p_ids), unnest(p_versions), unnest(p_spans), unnest(p_counts),
                              unnest(p_errors))
                   WITH ORDINALITY n (kind, id, version, spans, count, error, nr)
              WINDOW w AS (ORDER BY n.nr)) o;
    -- Whenever it may be.
    UPDATE area a SET activations = coalesce(n.spans, tstzmultirange(a.active_span)), schedule_error = n.error
        FROM pg_temp.expanded_schedule n
        WHERE n.kind = 0 AND a.area_id = n.id AND a.scene_id = p_scene_id AND a.version = n.version
          AND (a.activations, a.schedule_error)
              IS DISTINCT FROM (coalesce(n.spans, tstzmultirange(a.active_span)), n.error);
    GET DIAGNOSTICS v_changed = ROW_COUNT;
    UPDATE track t SET departures = n.departures, schedule_error = n.error
        FROM pg_temp.expanded_schedule n
        WHERE n.kind = 1 AND t.track_id = n.id AND t.scene_id = p_scene_id AND t.version = n.version
          AND (t.departures, t.schedule_error) IS DISTINCT FROM (n.departures, n.error);
    GET DIAGNOSTICS v_rows = ROW_COUNT;
    -- An expansion is no edit, which a merge would refuse. Nobody waits for a branch: the merge refuses one in use.
    UPDATE branch_edit e SET version = n.now
        FROM (SELECT o.ctid AS place, n.version, coalesce(a.version, t.version) AS now
              FROM pg_temp.expanded_schedule n
              LEFT JOIN area a ON n.kind = 0 AND a.area_id = n.id AND a.scene_id = p_scene_id
              LEFT JOIN track t ON n.kind = 1 AND t.track_id = n.id AND t.scene_id = p_scene_id
              JOIN branch_edit o ON o.object_kind = n.kind AND o.object_id = n.id AND o.version = n.version
              WHERE o.scene_id IN (SELECT b.scene_id FROM scene b WHERE b.parent_scene_id = p_scene_id)
                AND coalesce(a.version, t.version) > n.version
              FOR UPDATE OF o SKIP LOCKED) n
        WHERE e.ctid = n.place AND e.version = n.version;
    RETURN v_changed + v_rows;
END
$$;
COMMENT ON FUNCTION _set_activations(
    bigint, smallint[], bigint[], bigint[], tstzmultirange[], timestamptz[], integer[], text[]
) IS
'Stores expanded schedules of objects that still have the given versions, and so marks those that changed; returns '
'their number. Edits of branches then refer to the new versions. p_spans: of each area; null for tracks, and where '
'there is an error. p_departures: of all tracks. '
'p_counts: how many departures each object has. p_errors: why its schedule is not understood; null: it is.';

CREATE OR REPLACE FUNCTION conflictdb_internal._set_expanded(p_scene_id bigint, p_from_us bigint, p_until_us bigint)
RETURNS void
LANGUAGE sql VOLATILE
BEGIN ATOMIC
    UPDATE scene s SET expanded = CASE WHEN p_from_us IS NOT NULL THEN
            -- Seconds and the rest: a product with an interval is a double, which has no microseconds after 2255.
            tstzrange(timestamptz 'epoch' + make_interval(secs => p_from_us / 1000000)
                          + p_from_us % 1000000 * interval '1 microsecond',
                      timestamptz 'epoch' + make_interval(secs => p_until_us / 1000000)
                          + p_until_us % 1000000 * interval '1 microsecond') END
        WHERE s.scene_id = p_scene_id;
END;
COMMENT ON FUNCTION _set_expanded(bigint, bigint, bigint) IS
'Stores how far the schedules of a scene are expanded, microseconds since 1970; null: it has none.';
