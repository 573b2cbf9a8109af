-- Reading attached tables.
--
-- The function conflictdb_attached.rows_N, and the views and functions that it calls, are code of the attaching role.
-- So only sessions of that role run it, never a worker or superuser of another role. Other sessions skip the
-- attachment; the scene is not current until its role has followed the table. Calls name all parameter types: otherwise
-- a function of another editor could match unknown types better.

CREATE OR REPLACE FUNCTION conflictdb_internal._attaching_role(p_attachment_id bigint) RETURNS name
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- By full signature, as in the calls.
    SELECT pg_get_userbyid(p.proowner) FROM pg_catalog.pg_proc p
    JOIN pg_catalog.pg_namespace n ON n.oid = p.pronamespace
    WHERE n.nspname = 'conflictdb_attached' AND p.proname = format('rows_%s', p_attachment_id)::name
          AND p.pronargs = 2 AND p.proargtypes[0] = 'text[]'::regtype AND p.proargtypes[1] = 'text'::regtype;
END;
COMMENT ON FUNCTION _attaching_role(bigint) IS
'The role that attached a table, owner of the function that reads it; null if that function is missing.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_mine(p_attachment_id bigint) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(_attaching_role(p_attachment_id) = current_user, false);
END;
COMMENT ON FUNCTION _is_mine(bigint) IS
'Whether the current role owns the function that reads an attached table, and so may run it.';

-- What the attaching role has read decides which rows a proposal moves, and whether a scene is current.

CREATE OR REPLACE FUNCTION conflictdb_internal._after_attached_written() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_attachment_id bigint;
BEGIN
    IF pg_has_role((SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = TG_RELID), 'USAGE') THEN
        RETURN NULL; -- The owner of the tables may do everything, including restores and cascades.
    END IF;
    IF TG_OP <> 'DELETE' THEN
        SELECT n.attachment_id INTO v_attachment_id FROM (SELECT DISTINCT x.attachment_id FROM new_rows x) n
            WHERE NOT _is_mine(n.attachment_id) LIMIT 1;
    END IF;
    IF v_attachment_id IS NULL AND TG_OP <> 'INSERT' THEN
        SELECT o.attachment_id INTO v_attachment_id FROM (SELECT DISTINCT x.attachment_id FROM old_rows x) o
            JOIN attachment a USING (attachment_id) WHERE NOT _is_mine(o.attachment_id) LIMIT 1;
    END IF;
    IF v_attachment_id IS NOT NULL THEN
        FOUND := _raise('42501', format('attachment %s', v_attachment_id), TG_TABLE_NAME,
                        format('is written by role %I alone, which attached the table',
                               _attaching_role(v_attachment_id)), 'attached_by_role');
    END IF;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_attached_written() IS
'Trigger, once per statement: raises insufficient_privilege unless the current role attached the table of each row.';

CREATE OR REPLACE TRIGGER attached_relation_inserted AFTER INSERT ON attached_relation REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE OR REPLACE TRIGGER attached_relation_updated AFTER UPDATE ON attached_relation
    REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE OR REPLACE TRIGGER attached_relation_deleted AFTER DELETE ON attached_relation REFERENCING OLD TABLE AS old_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE OR REPLACE TRIGGER attached_object_inserted AFTER INSERT ON attached_object REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE OR REPLACE TRIGGER attached_object_updated AFTER UPDATE ON attached_object
    REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE OR REPLACE TRIGGER attached_object_deleted AFTER DELETE ON attached_object REFERENCING OLD TABLE AS old_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
-- Another role may add a note: the table is only read once more.
CREATE OR REPLACE TRIGGER attached_change_updated AFTER UPDATE ON attached_change
    REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE OR REPLACE TRIGGER attached_change_deleted AFTER DELETE ON attached_change REFERENCING OLD TABLE AS old_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();

CREATE OR REPLACE FUNCTION conflictdb_internal._short_identity(p_identity text) RETURNS text
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN octet_length(p_identity) <= 1000 THEN p_identity ELSE left(p_identity, 100) || md5(p_identity) END;
END;
COMMENT ON FUNCTION _short_identity(text) IS 'An identity shortened to fit an index entry: at most 1,000 bytes.';

CREATE OR REPLACE FUNCTION conflictdb_internal._drifted_objects(p_attachment_id bigint) RETURNS SETOF text
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Every change of an object leaves a mark; marks are few, so they come first.
    WITH marked AS MATERIALIZED (
        SELECT DISTINCT m.object_kind, m.object_id
        FROM attachment a JOIN change m ON m.scene_id = a.scene_id AND m.object_kind = a.object_kind
        WHERE a.attachment_id = p_attachment_id
    )
    SELECT o.identity
    FROM marked m JOIN attached_object o ON o.attachment_id = p_attachment_id AND o.object_id = m.object_id
    WHERE o.version IS DISTINCT FROM CASE m.object_kind
          WHEN 0 THEN (SELECT x.version FROM area x WHERE x.area_id = o.object_id)
          ELSE (SELECT x.version FROM track x WHERE x.track_id = o.object_id) END
    UNION ALL
    SELECT o.identity FROM attachment a JOIN attached_object o USING (attachment_id)
    WHERE a.attachment_id = p_attachment_id AND o.reason IS NOT NULL AND o.is_taken
      AND NOT EXISTS (SELECT FROM object_key k WHERE k.scene_id = a.scene_id AND k.key = o.key);
END;
COMMENT ON FUNCTION _drifted_objects(bigint) IS
'Identities of an attachment whose objects were changed or removed by others, or whose key has become free.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_compared(p_attachment attachment) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- A time in the future means that the clock was set back, and is ignored.
    SELECT coalesce(p_attachment.compared_at > now() - p_attachment.every
                    AND p_attachment.compared_at < now() + p_attachment.every, false);
END;
COMMENT ON FUNCTION _is_compared(attachment) IS 'Whether all rows of an attachment were compared within its interval.';

-- A reader that waits for a scene (wait_until_current) asks for a comparison of its views. It can write nothing that
-- another session sees before it has waited, so it takes an advisory lock, which nobody waits for.

CREATE OR REPLACE FUNCTION conflictdb_internal._wait_class() RETURNS integer
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT 1668244323; -- arbitrary
END;
COMMENT ON FUNCTION _wait_class() IS 'First key of the advisory locks of sessions that wait for a scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._wait_number(p_scene_id bigint) RETURNS integer
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Two scenes of one number: one is compared more often.
    SELECT (p_scene_id % 2147483647)::integer;
END;
COMMENT ON FUNCTION _wait_number(bigint) IS 'Second key of the advisory locks of sessions that wait for a scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_awaited(p_attachment attachment) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- At most once a second, and for half of the time.
    SELECT NOT p_attachment.has_triggers
           AND coalesce(p_attachment.compared_at
                        < now() - make_interval(secs => greatest(1, 2 * p_attachment.comparison_s)), true)
           AND EXISTS (SELECT FROM pg_catalog.pg_locks l
                       WHERE l.locktype = 'advisory' AND l.classid = _wait_class()::oid
                         AND l.objid = _wait_number(p_attachment.scene_id)::oid AND l.objsubid = 2
                         AND l.database = (SELECT d.oid FROM pg_catalog.pg_database d
                                           WHERE d.datname = current_database()));
END;
COMMENT ON FUNCTION _is_awaited(attachment) IS
'Whether a session waits for the scene of an attachment without triggers, whose last comparison is not quite new.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_due(p_attachment attachment) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT NOT _is_compared(p_attachment) OR _is_awaited(p_attachment);
END;
COMMENT ON FUNCTION _is_due(attachment) IS 'Whether all rows of an attachment are to be compared.';

CREATE OR REPLACE FUNCTION conflictdb_internal._has_just_failed(p_attachment attachment) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(p_attachment.failed_at > now() - interval '1 minute'
                    AND p_attachment.failed_at < now() + interval '1 minute', false);
END;
COMMENT ON FUNCTION _has_just_failed(attachment) IS
'Whether reading an attachment failed within the last minute, so that it is not retried yet.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_moved(p_attachment attachment) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT _attached_problems(p_attachment) && '{moved,parts,unwatched}'::text[];
END;
COMMENT ON FUNCTION _is_moved(attachment) IS
'Whether _rewatch_attached has something to do: the table was renamed, or lacks triggers.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attachments_to_follow(
    p_scene text, p_try_again boolean
) RETURNS TABLE (attachment_id bigint, is_moved boolean)
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN QUERY SELECT a.attachment_id, m.is_moved
        FROM attachment a CROSS JOIN LATERAL (SELECT _is_moved(a) AS is_moved OFFSET 0) m
        WHERE a.scene_id = _scene_id(p_scene) AND _is_mine(a.attachment_id)
          AND (p_try_again OR NOT _has_just_failed(a))
          AND (_is_due(a) OR m.is_moved
               OR EXISTS (SELECT FROM attached_change q WHERE q.attachment_id = a.attachment_id)
               OR EXISTS (SELECT FROM _drifted_objects(a.attachment_id)))
        ORDER BY a.attachment_id;
END
$$;
COMMENT ON FUNCTION _attachments_to_follow(text, boolean) IS
'Ids of the attachments of a scene, made by the current role, that have changes or are due for comparison, and whether '
'_rewatch_attached comes first. Those that failed within the last minute only with p_try_again.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_rows(
    p_attachment_id bigint, p_change_ids bigint[], p_is_full boolean, p_reading text
) RETURNS SETOF attached_plan
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- Above this number, one scan of the table costs less than lookups.
    c_most_lookups CONSTANT integer := 10000;
    v_asked text[];
    v_compared text[] := '{}';
    v_gone text[] := '{}';
    -- Tables that an earlier release attached: their functions return the first columns only.
    v_columns CONSTANT text := 'r.*' || (
        SELECT coalesce(string_agg(', NULL::' || format_type(a.atttypid, -1), '' ORDER BY a.attnum), '')
        FROM pg_catalog.pg_attribute a
        WHERE a.attrelid = 'attached_plan'::regclass
              AND a.attnum > (SELECT c.relnatts FROM pg_catalog.pg_proc p
                              JOIN pg_catalog.pg_class c ON c.reltype = p.prorettype
                              WHERE p.oid = to_regprocedure(format('conflictdb_attached.rows_%s(text[], text)',
                                                                   p_attachment_id))));
BEGIN
    SELECT array_agg(DISTINCT x.identity) INTO v_asked FROM (
        SELECT unnest(q.identities) FROM attached_change q WHERE q.attached_change_id = ANY (p_change_ids)
        UNION ALL SELECT d FROM _drifted_objects(p_attachment_id) d) x (identity) WHERE x.identity IS NOT NULL;
    IF p_is_full THEN
        EXECUTE format('
            SELECT array_agg(c.identity) FILTER (WHERE NOT c.is_gone), array_agg(c.identity) FILTER (WHERE c.is_gone)
            FROM (SELECT coalesce(h.identity, o.identity) AS identity, h.identity IS NULL AS is_gone
                  FROM (SELECT r.identity, _short_identity(r.identity) AS short, _combined_hash(sum(r.hash)) AS hash
                        FROM conflictdb_attached.rows_%s(NULL::text[], ''hashes''::text) r GROUP BY r.identity) h
                  FULL JOIN (SELECT x.identity, x.hash, x.object_id IS NOT NULL AND x.identity_json IS NULL AS is_old
                             FROM attached_object x WHERE x.attachment_id = $1) o
                      ON o.identity = h.short
                  -- Those that an earlier release took over have no identity_json.
                  WHERE h.identity IS NULL OR o.hash IS DISTINCT FROM h.hash OR o.is_old) c', p_attachment_id)
            INTO v_compared, v_gone USING p_attachment_id;
    END IF;
    v_asked := ARRAY(SELECT DISTINCT x FROM unnest(v_asked || v_compared) x);
    RETURN QUERY SELECT r.* FROM unnest(v_asked || v_gone) x CROSS JOIN LATERAL jsonb_populate_record(
        NULL::attached_plan, jsonb_build_object('identity', x, 'is_asked', true)) r;
    IF cardinality(v_asked) > c_most_lookups THEN
        RETURN QUERY EXECUTE format('SELECT %s FROM conflictdb_attached.rows_%s(NULL::text[], $2::text) r
                                     WHERE r.identity IN (SELECT unnest($1))', v_columns,
                                    p_attachment_id) USING v_asked, p_reading;
    ELSIF cardinality(v_asked) > 0 THEN
        RETURN QUERY EXECUTE format('SELECT %s FROM conflictdb_attached.rows_%s($1::text[], $2::text) r',
                                    v_columns, p_attachment_id)
            USING v_asked, p_reading;
    END IF;
END
$$;
COMMENT ON FUNCTION _attached_rows(bigint, bigint[], boolean, text) IS
'Changed rows of an attached table, from the given changes or by comparing all rows, plus one row with is_asked per '
'identity: an identity without other rows is gone. p_reading: rows, or carefully (row by row, with the error of each).';

CREATE OR REPLACE FUNCTION conflictdb_internal._combined_hash(p_sum numeric) RETURNS bigint
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT mod(p_sum, 9223372036854775807)::bigint;
END;
COMMENT ON FUNCTION _combined_hash(numeric) IS 'One hash from the sum of row hashes; independent of their order.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attachment_failed(p_attachment_id bigint, p_error text) RETURNS void
LANGUAGE sql VOLATILE STRICT
BEGIN ATOMIC
    UPDATE attachment a SET failed_at = now(), error = p_error WHERE a.attachment_id = p_attachment_id;
END;
COMMENT ON FUNCTION _attachment_failed(bigint, text) IS 'Records why an attached table cannot be read.';

CREATE OR REPLACE FUNCTION conflictdb_internal._seconds_to_comparison() RETURNS double precision
LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT extract(epoch FROM min(greatest(a.compared_at + a.every, a.failed_at + interval '1 minute')) - now())
           ::double precision
    FROM attachment a WHERE _is_mine(a.attachment_id);
END;
COMMENT ON FUNCTION _seconds_to_comparison() IS
'Seconds until the next comparison of a table that the current role attached; null if there is none.';
