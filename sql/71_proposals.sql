-- Proposals: changes of tracks that clear a scene, computed and verified by a client. Applying one is a single
-- transaction. It refuses if anything in the scene changed since, because the proof is of the scene as it was.

CREATE OR REPLACE FUNCTION conflictdb_internal._objects_hash(
    p_scene_id bigint, OUT last_version bigint, OUT objects_hash bigint
)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(max(o.version), 0),
           mod(coalesce(sum(hashtextextended(o.kind || ':' || o.id || ':' || o.version, 0)), 0), 9223372036854775807)
               ::bigint
    FROM (SELECT 0 AS kind, a.area_id AS id, a.version FROM area a WHERE a.scene_id = p_scene_id
          UNION ALL
          SELECT 1, t.track_id, t.version FROM track t WHERE t.scene_id = p_scene_id) o;
END;
COMMENT ON FUNCTION _objects_hash(bigint) IS
'The greatest version of the objects of a scene, and a hash of all their ids and versions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._proposal_basis(
    p_scene_id bigint, OUT settings jsonb, OUT last_version bigint, OUT objects_hash bigint
)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT _scene_settings(s.scene_id) - 'name', h.last_version, h.objects_hash
    FROM scene s CROSS JOIN LATERAL _objects_hash(s.scene_id) h WHERE s.scene_id = p_scene_id;
END;
COMMENT ON FUNCTION _proposal_basis(bigint) IS
'What a proposal depends on: the settings and rules of a scene, and the versions of its objects.';

CREATE OR REPLACE FUNCTION conflictdb_internal._put_proposal(
    p_scene_id bigint, p_basis jsonb, p_goal text, p_objective_s double precision, p_bound_s double precision,
    p_is_least boolean, p_moves jsonb, p_left jsonb
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_proposal_id bigint;
    v_basis record;
BEGIN
    PERFORM _check_may_change(p_scene_id, (SELECT s.name FROM scene s WHERE s.scene_id = p_scene_id));
    SELECT * INTO v_basis FROM jsonb_to_record(p_basis) b (settings jsonb, last_version bigint, objects_hash bigint);
    INSERT INTO proposal (scene_id, goal, objective_s, bound_s, is_least, settings, last_version, objects_hash)
        VALUES (p_scene_id, p_goal, p_objective_s, p_bound_s, p_is_least, v_basis.settings, v_basis.last_version,
                v_basis.objects_hash)
        RETURNING proposal_id INTO v_proposal_id;
    INSERT INTO proposal_move (proposal_id, scene_id, track_id, key, version, planned, path, delay_s, speed, clears,
                               passes, detour, explanation)
        SELECT v_proposal_id, p_scene_id, t.track_id, t.key, t.version, t.path,
               _retimed(t.path, m.times_us, m.detour), m.delay_s, m.speed, m.clears, m.passes,
               m.detour, m.text
        FROM jsonb_to_recordset(p_moves) m (key text, times_us bigint[], delay_s double precision,
                                            speed double precision, clears text[], passes jsonb, detour jsonb,
                                            text text)
        JOIN track t ON t.scene_id = p_scene_id AND t.key = m.key;
    INSERT INTO proposal_move (proposal_id, scene_id, area_id, key, version, planned_footprint, footprint,
                               planned_span, planned_activations, delay_s, speed, clears, passes, place, explanation)
        SELECT v_proposal_id, p_scene_id, a.area_id, a.key, a.version, a.footprint,
               coalesce(ST_SetSRID(ST_GeomFromWKB(decode(m.footprint, 'hex')), 4326), a.footprint),
               a.active_span, a.activations, m.delay_s, m.speed, m.clears, m.passes, m.place, m.text
        FROM jsonb_to_recordset(p_moves) m (key text, footprint text, delay_s double precision,
                                            speed double precision, clears text[], passes jsonb, place jsonb,
                                            text text)
        JOIN area a ON a.scene_id = p_scene_id AND a.key = m.key;
    INSERT INTO proposal_left (proposal_id, scene_id, key, blocked_by)
        SELECT v_proposal_id, p_scene_id, l.key, l.blocked_by
        FROM jsonb_to_recordset(p_left) l (key text, blocked_by text[]);
    -- A plan that is gone or has other waypoints has no move.
    PERFORM _check_unchanged(v_proposal_id);
    RETURN v_proposal_id;
END
$$;
COMMENT ON FUNCTION _put_proposal(
    bigint, jsonb, text, double precision, double precision, boolean, jsonb, jsonb) IS
'Stores a proposal and returns its id; raises ZC018 if the scene has changed since p_basis (_proposal_basis) was read.';

CREATE OR REPLACE FUNCTION conflictdb_internal._retimed(
    p_path geometry, p_times_us bigint[], p_detour jsonb
) RETURNS geometry
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- M is Unix seconds, as loading divides them.
    SELECT ST_SetSRID(ST_MakeLine(ST_MakePointM(o.x, o.y, p_times_us[o.n]::double precision / 1e6::double precision)
                                  ORDER BY o.n), ST_SRID(p_path))
    FROM (SELECT row_number() OVER (ORDER BY w.leg, w.place) AS n, w.x, w.y
          FROM (SELECT d.path[1] AS leg, 0 AS place, ST_X(d.geom) AS x, ST_Y(d.geom) AS y
                FROM ST_DumpPoints(p_path) d
                UNION ALL
                SELECT (p_detour ->> 'leg')::integer, v.n, (v.at ->> 0)::double precision,
                       (v.at ->> 1)::double precision
                FROM jsonb_array_elements(p_detour -> 'waypoints_deg') WITH ORDINALITY v (at, n)) w) o;
END;
COMMENT ON FUNCTION _retimed(geometry, bigint[], jsonb) IS
'A path with other times at its waypoints, microseconds since 1970, and with new waypoints of a detour (null: none); '
'equal to the one that a load stores.';

CREATE OR REPLACE FUNCTION conflictdb_internal._windows_later(p_tolerances jsonb, p_delay_s double precision)
RETURNS jsonb
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_delay_s = 0 OR NOT p_tolerances ?| '{departure_window,arrival_window}' THEN p_tolerances
                ELSE p_tolerances || (
        SELECT coalesce(jsonb_object_agg(w.name, w.later), '{}')
        FROM (SELECT m.key AS name,
                     jsonb_agg((to_jsonb((i.at::timestamptz + round((p_delay_s * 1e6)::numeric)::bigint
                                          * interval '1 microsecond') AT TIME ZONE 'UTC') #>> '{}') || 'Z'
                               ORDER BY i.n) AS later
              FROM jsonb_each(p_tolerances) m
              CROSS JOIN LATERAL jsonb_array_elements_text(m.value) WITH ORDINALITY i (at, n)
              WHERE m.key IN ('departure_window', 'arrival_window') AND jsonb_typeof(m.value) = 'array'
              GROUP BY m.key) w) END;
END;
COMMENT ON FUNCTION _windows_later(jsonb, double precision) IS
'Tolerances whose windows are later by a delay, to the microsecond.';

CREATE OR REPLACE FUNCTION conflictdb_internal._span_later(p_span tstzrange, p_by_s double precision) RETURNS tstzrange
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT tstzrange(lower(p_span) + x.by, upper(p_span) + x.by)
    FROM (SELECT round((p_by_s * 1e6)::numeric)::bigint * interval '1 microsecond' AS by) x;
END;
COMMENT ON FUNCTION _span_later(tstzrange, double precision) IS
'A span [start, end) that is later by a delay, to the microsecond.';

CREATE OR REPLACE FUNCTION conflictdb_internal._spans_later(
    p_spans tstzmultirange, p_by_s double precision
) RETURNS tstzmultirange
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_spans IS NULL THEN NULL ELSE
        coalesce((SELECT range_agg(_span_later(r, p_by_s)) FROM unnest(p_spans) r), '{}'::tstzmultirange) END;
END;
COMMENT ON FUNCTION _spans_later(tstzmultirange, double precision) IS
'Activations [start, end) that are later by a delay, to the microsecond.';

CREATE OR REPLACE FUNCTION proposal_changes(p_proposal_id bigint) RETURNS text[]
LANGUAGE plpgsql STABLE STRICT SET search_path FROM CURRENT AS $$
DECLARE
    v_proposal proposal := _proposal(p_proposal_id);
    v_found text[] := '{}';
BEGIN
    IF v_proposal.settings IS DISTINCT FROM _scene_settings(v_proposal.scene_id) - 'name' THEN
        v_found := ARRAY['settings of the scene'];
    END IF;
    IF (SELECT (h.last_version, h.objects_hash) IS DISTINCT FROM (v_proposal.last_version, v_proposal.objects_hash)
        FROM _objects_hash(v_proposal.scene_id) h) THEN
        v_found := v_found || ARRAY(
            SELECT o.what FROM (
                SELECT format('area %L', a.key) AS what FROM area a
                WHERE a.scene_id = v_proposal.scene_id AND a.version > v_proposal.last_version
                UNION ALL
                SELECT format('track %L', t.key) FROM track t
                WHERE t.scene_id = v_proposal.scene_id AND t.version > v_proposal.last_version) o ORDER BY o.what);
        IF cardinality(v_found) = 0 THEN
            v_found := ARRAY['objects that were removed'];
        END IF;
    END IF;
    RETURN v_found || ARRAY(
        SELECT format('rows of %s, which a detection has not read yet', _attached_name(a))
        FROM attachment a
        WHERE a.scene_id = v_proposal.scene_id
          AND EXISTS (SELECT FROM attached_change q WHERE q.attachment_id = a.attachment_id)
        ORDER BY a.attachment_id);
END
$$;
COMMENT ON FUNCTION proposal_changes(bigint) IS
'What changed in the scene since a proposal was computed, which prevents applying it; also after it was applied. '
'Empty: nothing.';

CREATE OR REPLACE FUNCTION conflictdb_internal._proposal(p_proposal_id bigint) RETURNS proposal
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_proposal proposal;
BEGIN
    SELECT p.* INTO v_proposal FROM proposal p WHERE p.proposal_id = p_proposal_id;
    IF NOT FOUND THEN
        FOUND := _raise('ZC011', format('proposal %s', coalesce(p_proposal_id::text, 'null')), 'id', 'is not known',
                        'proposal_known', 'The view proposals has those that are.');
    END IF;
    RETURN v_proposal;
END
$$;
COMMENT ON FUNCTION _proposal(bigint) IS 'Returns a proposal; raises ZC011 if there is none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_unchanged(p_proposal_id bigint) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    c_most CONSTANT integer := 20;
    v_changes text[] := proposal_changes(p_proposal_id);
    v_count integer := cardinality(v_changes);
BEGIN
    IF v_count > 0 THEN
        FOUND := _raise('ZC018', format('proposal %s', p_proposal_id), 'scene',
                        format('has changed since it was computed: %s%s', array_to_string(v_changes[:c_most], ', '),
                               CASE WHEN v_count > c_most THEN format(', and %s more', v_count - c_most) ELSE '' END),
                        'proposal_current', 'Compute another one: conflictdb resolve.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_unchanged(bigint) IS
'Raises ZC018, naming what changed, if a proposal is out of date.';

CREATE OR REPLACE FUNCTION conflictdb_internal._before_proposal_update() RETURNS trigger
LANGUAGE plpgsql SET search_path FROM CURRENT AS $$
BEGIN
    IF NEW.applied_at IS DISTINCT FROM OLD.applied_at THEN
        NEW.applied_at := now();
        NEW.applied_by := current_user;
    END IF;
    IF NEW.undone_at IS DISTINCT FROM OLD.undone_at THEN
        NEW.undone_at := now();
        NEW.undone_by := current_user;
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_proposal_update() IS
'Trigger: fills in who applies or undoes a proposal and when.';

-- Editors write in their own name only.
CREATE OR REPLACE TRIGGER proposal_updated BEFORE UPDATE OF applied_at, undone_at ON proposal
    FOR EACH ROW EXECUTE FUNCTION conflictdb_internal._before_proposal_update();

CREATE OR REPLACE FUNCTION conflictdb_internal._before_proposal_part() RETURNS trigger
LANGUAGE plpgsql SET search_path FROM CURRENT AS $$
BEGIN
    -- The owner of the tables may do everything, including restores.
    IF NOT EXISTS (SELECT FROM proposal p WHERE p.proposal_id = NEW.proposal_id AND p.made_by = current_user
                   AND p.made_at = now())
       AND NOT pg_has_role((SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = TG_RELID), 'USAGE') THEN
        FOUND := _raise('42501', format('proposal %s', NEW.proposal_id), 'moves',
                        'can be added only by the transaction that makes it', 'proposal_whole');
    END IF;
    -- Who applies it reads the key, and the plan or the rows of its attached table move.
    IF TG_TABLE_NAME = 'proposal_move'
       AND NOT pg_has_role((SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = TG_RELID), 'USAGE')
       AND NOT EXISTS (SELECT FROM jsonb_populate_record(NULL::proposal_move,
                                                         to_jsonb(NEW) - '{path,planned,footprint,planned_footprint}'
                                                                             ::text[]) m
                       LEFT JOIN track t ON t.track_id = m.track_id AND t.scene_id = m.scene_id AND t.key = m.key
                       LEFT JOIN area a ON a.area_id = m.area_id AND a.scene_id = m.scene_id AND a.key = m.key
                       WHERE num_nonnulls(t.track_id, a.area_id) = 1) THEN
        FOUND := _raise('ZC011', format('proposal %s', NEW.proposal_id), 'moves',
                        format('name plan %L, which has another number', to_jsonb(NEW) ->> 'key'),
                        'proposal_of_track');
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_proposal_part() IS
'Trigger: raises insufficient_privilege for a move of a proposal that another role or transaction has made, ZC011 '
'for a move whose number and key are of two plans.';
CREATE OR REPLACE TRIGGER proposal_move_made BEFORE INSERT ON proposal_move
    FOR EACH ROW EXECUTE FUNCTION conflictdb_internal._before_proposal_part();
ALTER TABLE proposal_move ENABLE ALWAYS TRIGGER proposal_move_made;
CREATE OR REPLACE TRIGGER proposal_left_made BEFORE INSERT ON proposal_left
    FOR EACH ROW EXECUTE FUNCTION conflictdb_internal._before_proposal_part();
ALTER TABLE proposal_left ENABLE ALWAYS TRIGGER proposal_left_made;

CREATE OR REPLACE FUNCTION conflictdb_internal._hold_proposal(p_proposal_id bigint) RETURNS proposal
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_proposal proposal := _proposal(p_proposal_id);
BEGIN
    PERFORM _check_may_change(v_proposal.scene_id,
                              (SELECT s.name FROM scene s WHERE s.scene_id = v_proposal.scene_id));
    IF current_setting('transaction_isolation') <> 'read committed' THEN
        FOUND := _raise('ZC013', format('proposal %s', p_proposal_id), 'transaction',
                        'must see what others change meanwhile: READ COMMITTED', 'proposal_in_read_committed');
    END IF;
    -- Proposals of a scene are applied one after the other; new objects of it need not wait.
    PERFORM FROM scene s WHERE s.scene_id = v_proposal.scene_id FOR NO KEY UPDATE;
    SELECT p.* INTO v_proposal FROM proposal p WHERE p.proposal_id = p_proposal_id FOR UPDATE;
    RETURN v_proposal;
END
$$;
COMMENT ON FUNCTION _hold_proposal(bigint) IS
'Locks a proposal and its scene until the transaction ends, and returns it. Raises insufficient_privilege for a scene '
'that the current role may not change.';

CREATE OR REPLACE FUNCTION conflictdb_internal._identity_condition(p_columns text[], p_identity text) RETURNS text
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT string_agg(CASE WHEN v.value IS NULL THEN format('t.%I IS NULL', v.name)
                           ELSE format('t.%I = %L', v.name, v.value) END, ' AND ' ORDER BY v.n)
    FROM unnest(p_columns, p_identity::text[]) WITH ORDINALITY v (name, value, n);
END;
COMMENT ON FUNCTION _identity_condition(text[], text) IS
'The SQL condition of the rows of an identity, in a table t.';

CREATE OR REPLACE FUNCTION proposal_statements(
    p_proposal_id bigint, p_undo boolean DEFAULT false
) RETURNS TABLE (key text, attachment_id bigint, statement text)
LANGUAGE plpgsql STABLE STRICT SET search_path FROM CURRENT AS $$
#variable_conflict use_column
BEGIN
    PERFORM _proposal(p_proposal_id);
    RETURN QUERY
    SELECT m.key::text, a.attachment_id,
           -- Names and literals only: expressions of a map may run code of the role that attached the table.
           CASE WHEN m.speed = 1 AND m.detour IS NULL AND c.attname IS NOT NULL AND NOT a.map ? 'where'
                     AND octet_length(o.identity) < 1000
                     AND NOT EXISTS (SELECT FROM track t WHERE t.track_id = m.track_id
                                     AND t.tolerances ?| '{departure_window,arrival_window}') THEN
                    format('UPDATE %s AS t SET %I = %s WHERE %s', _attached_name(a), c.attname,
                           CASE WHEN c.attndims > 0 THEN
                                    format('(SELECT array_agg(u.at %s ORDER BY u.n) '
                                           'FROM unnest(t.%I) WITH ORDINALITY AS u (at, n))', x.later, c.attname)
                                ELSE format('t.%I %s', c.attname, x.later) END,
                           _identity_condition(a.identity_columns, o.identity))
                END
    FROM proposal_move m
    JOIN attached_object o ON o.object_id = m.track_id
    JOIN attachment a ON a.attachment_id = o.attachment_id AND a.scene_id = m.scene_id AND a.object_kind = 1
    CROSS JOIN LATERAL (SELECT format('+ interval %L', round((m.delay_s * 1e6)::numeric)::bigint
                                      * CASE WHEN p_undo THEN -1 ELSE 1 END || ' microseconds') AS later) x
    LEFT JOIN pg_catalog.pg_attribute c
        ON c.attrelid = _attached_root(a) AND c.attnum > 0 AND NOT c.attisdropped
           AND a.map ->> CASE WHEN a.map ? 'times' THEN 'times' ELSE 'time' END IN (c.attname, quote_ident(c.attname))
    WHERE m.proposal_id = p_proposal_id
    ORDER BY m.key;
END
$$;
COMMENT ON FUNCTION proposal_statements(bigint, boolean) IS
'For each move of a proposal whose track comes from an attached table: the statement that shifts its rows by the '
'delay, or undoes that. Null if the map computes the times or selects rows, if the track has windows, or if speed or '
'way change.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_attached_rows(
    p_who text, p_since text, p_attachment attachment, p_identity text, p_key text
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_hash bigint;
BEGIN
    IF _attached_problems(p_attachment) && '{gone,remade,moved}' THEN
        FOUND := _raise('ZC018', p_who, 'scene',
                        format('has changed since it was %s: table %s was renamed or dropped', p_since,
                               _attached_name(p_attachment)), 'proposal_current');
    END IF;
    EXECUTE format('SELECT conflictdb_internal._combined_hash(sum(r.hash)) '
                   'FROM conflictdb_attached.rows_%s($1::text[], ''rows''::text) r', p_attachment.attachment_id)
        INTO v_hash USING ARRAY[p_identity];
    IF v_hash IS DISTINCT FROM (SELECT o.hash FROM attached_object o
                                WHERE o.attachment_id = p_attachment.attachment_id AND o.identity = p_identity) THEN
        FOUND := _raise('ZC018', p_who, 'scene',
                        format('has changed since it was %s: rows of track %L in %s', p_since, p_key,
                               _attached_name(p_attachment)), 'proposal_current');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_attached_rows(text, text, attachment, text, text) IS
'Raises ZC018 if the rows of a track differ from those that its attachment has read last. Only for the role that '
'attached the table.';

CREATE OR REPLACE FUNCTION conflictdb_internal._move_attached(
    p_proposal_id bigint, p_undo boolean, p_may boolean
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text := format('proposal %s', p_proposal_id);
    v_since text := CASE WHEN p_undo THEN 'applied' ELSE 'computed' END;
    v_path text := current_setting('search_path');
    v_moved bigint := 0;
    v_attachment attachment;
    v_one record;
    v_key text;
BEGIN
    SELECT m.key INTO v_key FROM proposal_move m JOIN attached_object o ON o.object_id = m.area_id
        JOIN attachment a ON a.attachment_id = o.attachment_id AND a.scene_id = m.scene_id AND a.object_kind = 0
        WHERE m.proposal_id = p_proposal_id ORDER BY m.key LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC009', v_who, 'attached', format('moves area %L of an attached table', v_key),
                        'proposal_attached', 'Change its rows yourself; the scene follows.');
    END IF;
    FOR v_one IN
        SELECT s.*, o.identity, t.version = m.version AS is_as_planned
        FROM proposal_statements(p_proposal_id, p_undo) s
        JOIN proposal_move m ON m.proposal_id = p_proposal_id AND m.key = s.key
        JOIN attached_object o ON o.attachment_id = s.attachment_id AND o.object_id = m.track_id
        LEFT JOIN track t ON t.track_id = m.track_id ORDER BY s.key LOOP
        IF v_one.statement IS NULL THEN
            FOUND := _raise('ZC009', v_who, 'attached',
                            format('moves track %L of an attached table, whose times no statement shifts', v_one.key),
                            'proposal_attached', 'Change its rows yourself; the scene follows.');
        END IF;
        IF NOT (p_may AND _is_mine(v_one.attachment_id)) THEN
            FOUND := _raise('ZC009', v_who, 'attached',
                            format('moves track %L of an attached table, whose rows belong to role %I', v_one.key,
                                   _attaching_role(v_one.attachment_id)),
                            'proposal_attached',
                            format('As that role, give --attached (p_attached => true), or run: %s', v_one.statement));
        END IF;
        SELECT a.* INTO v_attachment FROM attachment a WHERE a.attachment_id = v_one.attachment_id;
        PERFORM set_config('search_path', 'pg_catalog, pg_temp', true);
        IF EXISTS (SELECT FROM pg_catalog.pg_class c
                   WHERE c.oid = conflictdb_internal._attached_root(v_attachment) AND c.relkind IN ('r', 'p')) THEN
            EXECUTE format('SELECT FROM %s AS t WHERE %s FOR UPDATE', conflictdb_internal._attached_name(v_attachment),
                           conflictdb_internal._identity_condition(v_attachment.identity_columns, v_one.identity));
        END IF;
        PERFORM set_config('search_path', v_path, true);
        -- Undone before a detection has read the moved rows, they are compared with the planned ones, below.
        IF NOT (p_undo AND v_one.is_as_planned) THEN
            PERFORM _check_attached_rows(v_who, v_since, v_attachment, v_one.identity, v_one.key);
        END IF;
        PERFORM set_config('search_path', 'pg_catalog, pg_temp', true);
        EXECUTE v_one.statement;
        GET DIAGNOSTICS v_moved = ROW_COUNT;
        PERFORM set_config('search_path', v_path, true);
        IF v_moved = 0 THEN
            FOUND := _raise('ZC009', v_who, 'attached', format('found no row of track %L', v_one.key),
                            'proposal_attached', v_one.statement);
        END IF;
        IF p_undo AND v_one.is_as_planned THEN
            PERFORM _check_attached_rows(v_who, v_since, v_attachment, v_one.identity, v_one.key);
        END IF;
    END LOOP;
    RETURN v_moved;
END
$$;
COMMENT ON FUNCTION _move_attached(bigint, boolean, boolean) IS
'Shifts the rows of attached tables that a proposal moves. Raises ZC009 unless p_may, and the current role attached '
'the table; ZC018 if the rows of a track are not those that the proposal was computed from, or that it moved.';

CREATE OR REPLACE FUNCTION apply_proposal(p_proposal_id bigint, p_attached boolean DEFAULT false) RETURNS bigint
LANGUAGE plpgsql VOLATILE STRICT SET search_path FROM CURRENT AS $$
DECLARE
    v_proposal proposal := _hold_proposal(p_proposal_id);
    v_moves bigint := (SELECT count(*) FROM proposal_move m WHERE m.proposal_id = p_proposal_id);
    v_moved bigint;
    v_attached bigint;
BEGIN
    IF v_proposal.applied_at IS NOT NULL AND v_proposal.undone_at IS NULL THEN
        FOUND := _raise('ZC013', format('proposal %s', p_proposal_id), 'applied_at',
                        format('was applied at %s by %I', v_proposal.applied_at, v_proposal.applied_by),
                        'proposal_applied_once',
                        format('SELECT conflictdb.undo_proposal(%s) undoes it.', p_proposal_id));
    END IF;
    IF v_proposal.undone_at IS NOT NULL THEN
        FOUND := _raise('ZC013', format('proposal %s', p_proposal_id), 'undone_at',
                        format('was undone at %s by %I', v_proposal.undone_at, v_proposal.undone_by),
                        'proposal_applied_once', 'Compute another one: conflictdb resolve.');
    END IF;
    PERFORM _check_unchanged(p_proposal_id);
    PERFORM _move_attached(p_proposal_id, false, p_attached);
    SELECT count(*) INTO v_attached FROM proposal_statements(p_proposal_id, false);
    WITH moved AS (
        UPDATE track t SET path = m.path, tolerances = _windows_later(t.tolerances, m.delay_s) FROM proposal_move m
            WHERE m.proposal_id = p_proposal_id AND t.track_id = m.track_id AND t.version = m.version
              AND t.scene_id = m.scene_id
              AND NOT EXISTS (SELECT FROM attached_object o JOIN attachment a USING (attachment_id)
                              WHERE o.object_id = t.track_id AND a.object_kind = 1)
            RETURNING t.track_id, t.version
    ), kept AS (
        UPDATE proposal_move m SET version_after = d.version
            FROM moved d WHERE m.proposal_id = p_proposal_id AND m.track_id = d.track_id
    ), moved_area AS (
        UPDATE area a SET footprint = m.footprint, active_span = _span_later(m.planned_span, m.delay_s),
                          activations = _spans_later(m.planned_activations, m.delay_s)
            FROM proposal_move m
            WHERE m.proposal_id = p_proposal_id AND a.area_id = m.area_id AND a.version = m.version
              AND a.scene_id = m.scene_id
            RETURNING a.area_id, a.version
    ), kept_area AS (
        UPDATE proposal_move m SET version_after = d.version
            FROM moved_area d WHERE m.proposal_id = p_proposal_id AND m.area_id = d.area_id
    )
    SELECT (SELECT count(*) FROM moved) + (SELECT count(*) FROM moved_area) INTO v_moved;
    IF v_moved + v_attached < v_moves THEN
        -- A plan was changed between the check and the update, by a transaction that has just committed.
        PERFORM _check_unchanged(p_proposal_id);
        RAISE EXCEPTION 'proposal %: a plan changed while it was applied', p_proposal_id
            USING ERRCODE = 'serialization_failure', HINT = 'Try again.';
    END IF;
    UPDATE proposal p SET applied_at = now() WHERE p.proposal_id = p_proposal_id;
    RETURN v_moves;
END
$$;
COMMENT ON FUNCTION apply_proposal(bigint, boolean) IS
'Moves the plans of a proposal, all or none, and returns their number. Raises ZC018, naming what changed, if anything '
'in the scene changed since it was computed; ZC013 if it was applied before. Tracks of attached tables: ZC009 with the '
'statement to run, or with p_attached runs it with the rights of the current role.';

CREATE OR REPLACE FUNCTION undo_proposal(p_proposal_id bigint, p_attached boolean DEFAULT false) RETURNS bigint
LANGUAGE plpgsql VOLATILE STRICT SET search_path FROM CURRENT AS $$
DECLARE
    v_proposal proposal := _hold_proposal(p_proposal_id);
    v_changed text;
    v_moves bigint := (SELECT count(*) FROM proposal_move m WHERE m.proposal_id = p_proposal_id);
    v_moved bigint;
BEGIN
    IF v_proposal.applied_at IS NULL OR v_proposal.undone_at IS NOT NULL THEN
        FOUND := _raise('ZC013', format('proposal %s', p_proposal_id), 'applied_at',
                        CASE WHEN v_proposal.applied_at IS NULL THEN 'was not applied' ELSE 'was undone before' END,
                        'proposal_undone_once');
    END IF;
    PERFORM FROM track t JOIN proposal_move m USING (track_id) WHERE m.proposal_id = p_proposal_id
        ORDER BY t.track_id FOR UPDATE OF t;
    PERFORM FROM area a JOIN proposal_move m USING (area_id) WHERE m.proposal_id = p_proposal_id
        ORDER BY a.area_id FOR UPDATE OF a;
    SELECT string_agg(format('%s %L', CASE WHEN m.area_id IS NULL THEN 'track' ELSE 'area' END, m.key), ', '
                      ORDER BY m.key) INTO v_changed
        FROM proposal_move m LEFT JOIN track t USING (track_id) LEFT JOIN area a ON a.area_id = m.area_id
        -- Rows of attached tables may not have been read since; a detection expands schedules, which is a new version.
        -- An area that moved in time had no schedule then.
        WHERE m.proposal_id = p_proposal_id
          AND CASE WHEN a.schedule IS NOT NULL AND m.delay_s = 0
                   THEN a.footprint::bytea IS DISTINCT FROM m.footprint::bytea
                   WHEN m.area_id IS NOT NULL THEN a.version IS DISTINCT FROM m.version_after
                   WHEN m.version_after IS NULL
                   THEN t.path::bytea IS DISTINCT FROM m.path::bytea AND t.version IS DISTINCT FROM m.version
                   ELSE t.version IS DISTINCT FROM m.version_after END;
    IF v_changed IS NOT NULL THEN
        FOUND := _raise('ZC018', format('proposal %s', p_proposal_id), 'scene',
                        format('has changed since it was applied: %s', v_changed), 'proposal_current');
    END IF;
    PERFORM _move_attached(p_proposal_id, true, p_attached);
    WITH moved AS (
        UPDATE track t SET path = m.planned, tolerances = _windows_later(t.tolerances, -m.delay_s)
            FROM proposal_move m
            WHERE m.proposal_id = p_proposal_id AND t.track_id = m.track_id AND t.scene_id = m.scene_id
                  AND m.version_after IS NOT NULL
            RETURNING t.track_id, t.version
    )
    UPDATE proposal_move m SET version_after = d.version
        FROM moved d WHERE m.proposal_id = p_proposal_id AND m.track_id = d.track_id;
    WITH moved AS (
        UPDATE area a SET footprint = m.planned_footprint,
                          active_span = CASE WHEN a.schedule IS NULL THEN m.planned_span ELSE a.active_span END,
                          activations = CASE WHEN a.schedule IS NULL THEN m.planned_activations ELSE a.activations END
            FROM proposal_move m
            WHERE m.proposal_id = p_proposal_id AND a.area_id = m.area_id AND a.scene_id = m.scene_id
                  AND m.version_after IS NOT NULL
            RETURNING a.area_id, a.version
    )
    UPDATE proposal_move m SET version_after = d.version
        FROM moved d WHERE m.proposal_id = p_proposal_id AND m.area_id = d.area_id;
    UPDATE proposal p SET undone_at = now() WHERE p.proposal_id = p_proposal_id;
    RETURN v_moves;
END
$$;
COMMENT ON FUNCTION undo_proposal(bigint, boolean) IS
'Gives the plans of an applied proposal their exact former times and places, all or none, and returns their number. '
'Raises '
'ZC018, naming them, if any of them changed since; other objects may have. p_attached: as for apply_proposal.';

CREATE OR REPLACE FUNCTION conflictdb_internal._proposed(p_scene text, p_key text) RETURNS TABLE (
    proposal_id bigint, state text, text text, delay_s double precision, changes text[]
)
LANGUAGE sql STABLE
BEGIN ATOMIC
    SELECT p.proposal_id, CASE WHEN p.applied_at IS NULL THEN 'open' ELSE 'applied' END, m.explanation, m.delay_s,
           proposal_changes(p.proposal_id)
    FROM proposal p JOIN proposal_move m USING (proposal_id)
    WHERE p.scene_id = _scene_or_branch(p_scene) AND m.key = p_key AND p.undone_at IS NULL
    ORDER BY p.proposal_id DESC LIMIT 1;
END;
COMMENT ON FUNCTION _proposed(text, text) IS
'How the last proposal that moves an object, open or applied, moves it, and what changed in the scene since; no row '
'without one.';

CREATE OR REPLACE VIEW proposals WITH (security_invoker = true) AS
SELECT s.name AS scene, p.proposal_id, p.made_at, p.made_by,
       CASE WHEN p.undone_at IS NOT NULL THEN 'undone' WHEN p.applied_at IS NOT NULL THEN 'applied'
            ELSE 'open' END AS state,
       p.goal, p.objective_s, p.bound_s, p.is_least,
       (SELECT coalesce(jsonb_agg(jsonb_build_object('key', m.key, 'delay_s', m.delay_s, 'speed', m.speed, 'clears',
                                                     m.clears, 'passes', m.passes, 'detour', m.detour, 'text',
                                                     m.explanation, 'is_area', m.area_id IS NOT NULL, 'place',
                                                     m.place)
                                  ORDER BY m.key), '[]')
        FROM proposal_move m WHERE m.proposal_id = p.proposal_id) AS moves,
       (SELECT coalesce(jsonb_agg(jsonb_build_object('key', l.key, 'blocked_by', l.blocked_by) ORDER BY l.key), '[]')
        FROM proposal_left l WHERE l.proposal_id = p.proposal_id) AS left_as_planned,
       p.applied_at, p.applied_by, p.undone_at, p.undone_by
FROM scene s JOIN proposal p USING (scene_id);

COMMENT ON VIEW proposals IS
'Changes of tracks and areas that clear a scene. apply_proposal applies one, undo_proposal undoes it, '
'proposal_changes says whether it is out of date.';
COMMENT ON COLUMN proposals.scene IS 'Name of the scene.';
COMMENT ON COLUMN proposals.proposal_id IS 'Id.';
COMMENT ON COLUMN proposals.made_at IS 'When it was computed.';
COMMENT ON COLUMN proposals.made_by IS 'User who had it computed.';
COMMENT ON COLUMN proposals.state IS 'open, applied or undone.';
COMMENT ON COLUMN proposals.goal IS 'total: the sum of all delays was made least; largest: the largest of them.';
COMMENT ON COLUMN proposals.objective_s IS 'That sum or largest delay, each times its weight, seconds.';
COMMENT ON COLUMN proposals.bound_s IS 'No other choice that leaves so few tracks has a lower one.';
COMMENT ON COLUMN proposals.is_least IS
'Whether it is proven that no other choice leaves fewer tracks, or as many for less, to a millisecond.';
COMMENT ON COLUMN proposals.moves IS
'Plans that move: {"key", "delay_s", "speed", "clears", "passes", "detour", "text", "is_area", "place"}; negative '
'delays: earlier; place: of an area that moves aside, {"distance_m", "bearing_deg"}.';
COMMENT ON COLUMN proposals.left_as_planned IS
'Tracks that stay in conflict: {"key", "blocked_by"}, the keys of objects that forbid every change.';
COMMENT ON COLUMN proposals.applied_at IS 'When it was applied; null: never.';
COMMENT ON COLUMN proposals.applied_by IS 'User who applied it, or null.';
COMMENT ON COLUMN proposals.undone_at IS 'When it was undone; null: never.';
COMMENT ON COLUMN proposals.undone_by IS 'User who undid it, or null.';

COMMENT ON TABLE proposal IS 'Proposals; see the view proposals.';
COMMENT ON COLUMN proposal.proposal_id IS 'Id.';
COMMENT ON COLUMN proposal.scene_id IS 'Scene.';
COMMENT ON COLUMN proposal.made_at IS 'When it was computed.';
COMMENT ON COLUMN proposal.made_by IS 'User who had it computed.';
COMMENT ON COLUMN proposal.goal IS 'total or largest.';
COMMENT ON COLUMN proposal.objective_s IS 'As in the view.';
COMMENT ON COLUMN proposal.bound_s IS 'As in the view.';
COMMENT ON COLUMN proposal.is_least IS 'As in the view.';
COMMENT ON COLUMN proposal.settings IS 'Settings of the scene that it was computed with.';
COMMENT ON COLUMN proposal.last_version IS 'The greatest version of the objects that it was computed from.';
COMMENT ON COLUMN proposal.objects_hash IS 'A hash of the ids and versions of all these objects.';
COMMENT ON COLUMN proposal.applied_at IS 'When it was applied; null: never.';
COMMENT ON COLUMN proposal.applied_by IS 'User who applied it, or null.';
COMMENT ON COLUMN proposal.undone_at IS 'When it was undone; null: never.';
COMMENT ON COLUMN proposal.undone_by IS 'User who undid it, or null.';
COMMENT ON TABLE proposal_move IS 'Moves of proposals.';
COMMENT ON COLUMN proposal_move.proposal_id IS 'Proposal.';
COMMENT ON COLUMN proposal_move.scene_id IS 'Scene of the proposal.';
COMMENT ON COLUMN proposal_move.track_id IS 'Track that moves; null: an area moves.';
COMMENT ON COLUMN proposal_move.area_id IS 'Area that moves; null: a track moves.';
COMMENT ON COLUMN proposal_move.planned_footprint IS 'Footprint of the area as planned; null: a track moves.';
COMMENT ON COLUMN proposal_move.footprint IS 'Its footprint if the proposal is applied; null: a track moves.';
COMMENT ON COLUMN proposal_move.planned_span IS 'When the area is active as planned; null: activations only.';
COMMENT ON COLUMN proposal_move.planned_activations IS 'Its several times as planned; null: one.';
COMMENT ON COLUMN proposal_move.place IS
'How far the area moves: {"distance_m", "bearing_deg"}; null: it stays where it is, or a track moves.';
COMMENT ON COLUMN proposal_move.key IS 'Its key.';
COMMENT ON COLUMN proposal_move.version IS 'Its version that the move was computed from.';
COMMENT ON COLUMN proposal_move.planned IS 'Path of the track as planned; null: an area moves.';
COMMENT ON COLUMN proposal_move.path IS 'Its path if the proposal is applied; null: an area moves.';
COMMENT ON COLUMN proposal_move.delay_s IS 'How much later all of its times are, seconds; negative: earlier.';
COMMENT ON COLUMN proposal_move.speed IS 'Factor of its planned speed.';
COMMENT ON COLUMN proposal_move.clears IS 'Keys of the objects with which it is no longer in conflict.';
COMMENT ON COLUMN proposal_move.passes IS 'How it passes others: {"key", "side", "closest_m", "closest_at"}.';
COMMENT ON COLUMN proposal_move.detour IS
'Its new waypoints: {"leg", "waypoints_deg", "longer_m", "later_s"}; null: none.';
COMMENT ON COLUMN proposal_move.explanation IS 'The move in one sentence.';
COMMENT ON COLUMN proposal_move.version_after IS
'Its version since the proposal was applied, or undone; null before, and for tracks of attached tables.';
COMMENT ON TABLE proposal_left IS 'Plans that proposals leave in conflict.';
COMMENT ON COLUMN proposal_left.proposal_id IS 'Proposal.';
COMMENT ON COLUMN proposal_left.scene_id IS 'Scene of the proposal.';
COMMENT ON COLUMN proposal_left.key IS 'Key of the plan.';
COMMENT ON COLUMN proposal_left.blocked_by IS 'Keys of the objects that forbid every change.';
