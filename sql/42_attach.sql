-- Attaching a table to a scene: its rows become objects of the scene and stay in step until it is detached.
--
-- The map becomes one function, conflictdb_attached.rows_N, owned and run only by the attaching role
-- (43_attached_rows.sql). Editors may create functions in the schema conflictdb_attached, which exists while something
-- is attached, but not in conflictdb, where names are looked up.

CREATE OR REPLACE FUNCTION conflictdb_internal._open_attached_schema() RETURNS void
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp
SET client_min_messages = warning AS $$
DECLARE
    v_owner regrole;
    v_ours regrole;
BEGIN
    BEGIN
        IF to_regnamespace('conflictdb_attached') IS NULL THEN
            CREATE SCHEMA conflictdb_attached;
            COMMENT ON SCHEMA conflictdb_attached IS
                'One function per table attached to a scene of conflictdb, owned by the role that attached it.';
            GRANT USAGE, CREATE ON SCHEMA conflictdb_attached TO conflictdb_editor;
        END IF;
    EXCEPTION WHEN duplicate_schema THEN
        NULL; -- Another session has just created it.
    END;
    SELECT a.nspowner, n.nspowner INTO v_owner, v_ours FROM pg_catalog.pg_namespace a, pg_catalog.pg_namespace n
        WHERE a.nspname = 'conflictdb_attached' AND n.nspname = 'conflictdb';
    IF v_owner NOT IN (v_ours, current_user::regrole) THEN
        FOUND := _raise('42501', 'schema conflictdb_attached', 'owner',
                        format('must be role %s, the owner of schema conflictdb; got role %s', v_ours, v_owner),
                        'attached_schema_owned', format('Let an administrator remove it, or run: '
                        'ALTER SCHEMA conflictdb_attached OWNER TO %s', v_ours));
    ELSIF v_owner IS NULL THEN
        RAISE EXCEPTION 'schema conflictdb_attached has just been created by another session'
            USING ERRCODE = 'serialization_failure', HINT = 'Try again.';
    END IF;
END
$$;
COMMENT ON FUNCTION _open_attached_schema() IS
'Creates the schema conflictdb_attached if it is missing. Raises insufficient_privilege if another role owns it. Runs '
'as the owner of conflictdb, who will own the schema. Restricted to this one schema.';

CREATE OR REPLACE FUNCTION conflictdb_internal._close_attached_schema() RETURNS void
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp
-- Who attaches a table meanwhile locks the schema.
SET lock_timeout = '20ms' AS $$
BEGIN
    -- Keep a schema that another role owns.
    IF EXISTS (SELECT FROM pg_catalog.pg_namespace a, pg_catalog.pg_namespace n
               WHERE a.nspname = 'conflictdb_attached' AND n.nspname = 'conflictdb'
                     AND a.nspowner IN (n.nspowner, current_user::regrole)) THEN
        DROP SCHEMA conflictdb_attached;
    END IF;
EXCEPTION WHEN dependent_objects_still_exist OR invalid_schema_name OR lock_not_available THEN
    NULL; -- Other tables are attached, or just being.
END
$$;
COMMENT ON FUNCTION _close_attached_schema() IS
'Removes the schema conflictdb_attached. Runs as its owner. Restricted to a schema without objects.';

CREATE OR REPLACE FUNCTION conflictdb_internal._free_attached_name(p_attachment_id bigint) RETURNS void
LANGUAGE plpgsql VOLATILE STRICT SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp
SET client_min_messages = warning AS $$
DECLARE
    v_routine regprocedure;
BEGIN
    IF p_attachment_id IS DISTINCT FROM currval('attachment_attachment_id_seq')
       OR NOT EXISTS (SELECT FROM attachment a
                      WHERE a.attachment_id = p_attachment_id AND a.identity_columns = '{}') THEN
        RETURN;
    END IF;
    FOR v_routine IN SELECT p.oid FROM pg_catalog.pg_proc p JOIN pg_catalog.pg_namespace n ON n.oid = p.pronamespace
                     WHERE n.nspname = 'conflictdb_attached'
                           AND p.proname = format('rows_%s', p_attachment_id)::name LOOP
        EXECUTE format('DROP ROUTINE %s CASCADE', v_routine);
    END LOOP;
END
$$;
COMMENT ON FUNCTION _free_attached_name(bigint) IS
'Drops routines that another editor created under the name of the function of a new attachment, before that function '
'is. Runs as its owner, who owns the schema. Restricted to the attachment that the session has just inserted.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_attached_owner(
    p_who text, p_table regclass, p_has_triggers boolean
) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_other regclass;
BEGIN
    -- Reading a table or view runs code of its owner with the reader's rights: view functions, row-level security,
    -- index expressions. A superuser could run code as anybody.
    SELECT t.relation INTO v_other FROM _attached_tables(p_table) t
        LEFT JOIN pg_catalog.pg_class c ON c.oid = t.relation LEFT JOIN pg_catalog.pg_roles r ON r.oid = c.relowner
        WHERE (pg_has_role(r.oid, 'USAGE') OR NOT p_has_triggers AND r.rolsuper) IS NOT TRUE LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC009', p_who, 'table',
                        format('must belong to the role that attaches it: role %I does not own %s', current_user,
                               v_other), 'attached_owned', 'Attach it as its owner.');
    END IF;
END
$$;
COMMENT ON FUNCTION _check_attached_owner(text, regclass, boolean) IS
'Raises ZC009 for a table with another owner: reading it could run that owner''s code.';

CREATE OR REPLACE FUNCTION conflictdb_internal._hold_attached(
    p_who text, p_relation oid, p_has_triggers boolean
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_name text := (SELECT format('%I.%I', n.nspname, c.relname) FROM pg_catalog.pg_class c
                    JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace WHERE c.oid = p_relation);
BEGIN
    IF v_name IS NULL THEN
        FOUND := _raise('ZC009', p_who, 'table', 'was dropped', 'attached_there');
    END IF;
    -- PREPARE takes a reader's lock on any relation, until the transaction ends, without planning or running anything.
    EXECUTE format('PREPARE conflictdb_hold_attached AS SELECT FROM %s', v_name);
    DEALLOCATE conflictdb_hold_attached;
    IF v_name::regclass <> p_relation THEN
        RAISE EXCEPTION '%: was renamed meanwhile', p_who USING ERRCODE = 'serialization_failure', HINT = 'Try again.';
    END IF;
    PERFORM _check_attached_owner(p_who, p_relation::regclass, p_has_triggers);
END
$$;
COMMENT ON FUNCTION _hold_attached(text, oid, boolean) IS
'Locks a table against renaming and replacement before it is read; raises ZC009 if it now has another owner.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_attachable(
    p_who text, p_table regclass, p_has_triggers boolean
) RETURNS void
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_table record;
    v_other regclass;
BEGIN
    SELECT c.relkind, c.relpersistence, n.nspname INTO v_table
        FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace WHERE c.oid = p_table;
    IF v_table.relkind NOT IN ('r', 'p', 'v', 'm', 'f') THEN
        FOUND := _raise('ZC009', p_who, 'table', 'must be a table or a view', 'attached_is_table');
    END IF;
    IF v_table.relpersistence = 't' THEN
        FOUND := _raise('ZC009', p_who, 'table', 'is temporary: no other session can read it', 'attached_is_lasting');
    END IF;
    IF v_table.nspname IN ('conflictdb', 'conflictdb_internal', 'pg_catalog', 'information_schema') THEN
        FOUND := _raise('ZC009', p_who, 'table', 'must be neither a system table nor one of conflictdb',
                        'attached_is_foreign');
    END IF;
    IF NOT has_table_privilege(p_table, 'SELECT') THEN
        FOUND := _raise('ZC009', p_who, 'table', format('cannot be read by role %I', current_user), 'attached_readable',
                        format('GRANT SELECT ON %s TO %I lets it.', p_table, current_user));
    END IF;
    IF row_security_active(p_table) THEN
        FOUND := _raise('ZC009', p_who, 'table',
                        format('hides rows from role %I by row-level security',
                               current_user), 'attached_whole',
                        'Attach it as its owner, as a role with BYPASSRLS, or attach a view of a role that sees all.');
    END IF;
    IF p_has_triggers THEN
        SELECT c.oid INTO v_other FROM _attached_tables(p_table) t JOIN pg_catalog.pg_class c ON c.oid = t.relation
            WHERE c.relkind = 'f' LIMIT 1;
        IF FOUND THEN
            FOUND := _raise('ZC009', p_who, 'table',
                            format('has a foreign partition, %s, whose changes no trigger sees', v_other),
                            'attached_watchable',
                            'Give every, the interval at which to compare all rows instead.');
        END IF;
    END IF;
    PERFORM _check_attached_owner(p_who, p_table, p_has_triggers);
END
$$;
COMMENT ON FUNCTION _check_attachable(text, regclass, boolean) IS
'Raises ZC009 for a table that the current role cannot attach, or not with triggers.';

CREATE OR REPLACE FUNCTION conflictdb_internal._create_attached_rows(
    p_who text, p_attachment_id bigint, p_kind smallint, p_table regclass, p_map jsonb, OUT identity_columns text[]
)
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_path text := current_setting('search_path');
    v_expressions jsonb := '{}';
    v_columns smallint[] := '{}';
    v_table text;
    v_identity text;
    v_hash text;
    v_list text;
    v_marks text;
    v_decoded text;
    v_joined text;
    v_null text;
    v_where text := 'true';
    v_seed bigint;
    v_one record;
BEGIN
    IF p_map ? 'where' THEN
        v_where := (_map_expression(p_who, 'where', p_table, p_map ->> 'where', 'boolean'::regtype)).expression;
    END IF;
    FOR v_one IN
        SELECT f.field, f.attribute, m.value AS given,
               CASE f.field WHEN 'order' THEN 'double precision'::regtype::oid ELSE a.atttypid END AS wanted,
               CASE f.field WHEN 'order' THEN 'ARRAY[%s]' ELSE '%s' END AS form
        FROM jsonb_each_text(p_map) m JOIN _map_fields(p_kind) f ON f.field = m.key
        JOIN pg_catalog.pg_attribute a ON a.attrelid = 'attached_plan'::regclass AND a.attname = f.attribute
        ORDER BY f.field LOOP
        SELECT v_expressions || jsonb_build_object(v_one.attribute, format(v_one.form, x.expression)),
               v_columns || x.columns,
               CASE v_one.field WHEN 'key' THEN ARRAY(
                   SELECT a.attname::text FROM unnest(x.columns) n
                   LEFT JOIN pg_catalog.pg_attribute a ON a.attrelid = p_table AND a.attnum = n AND n > 0 ORDER BY n)
                   ELSE identity_columns END
            INTO v_expressions, v_columns, identity_columns
            FROM _map_expression(p_who, v_one.field, p_table, v_one.given, v_one.wanted) x;
    END LOOP;
    IF cardinality(identity_columns) = 0 OR array_position(identity_columns, NULL) IS NOT NULL THEN
        FOUND := _raise('ZC009', p_who, 'key', 'must be an expression of columns of the table', 'map_key');
    END IF;
    v_identity := _identity_of('t', identity_columns);
    -- Rows hash differently under another map: all of them are read again.
    v_seed := hashtextextended(p_map::text, 0);
    -- All names written out from here on are qualified.
    PERFORM set_config('search_path', '', true);
    v_table := p_table::text;
    SELECT format('hashtextextended(%s::text, %s)',
                  CASE WHEN 0 = ANY (v_columns) THEN '(t.*)'
                  ELSE format('ROW(%s)', string_agg(format('t.%I', a.attname), ', ' ORDER BY a.attnum)) END, v_seed)
        INTO v_hash FROM pg_catalog.pg_attribute a WHERE a.attrelid = p_table AND a.attnum = ANY (v_columns);
    v_expressions := v_expressions || jsonb_build_object('identity', v_identity, 'hash', v_hash, 'is_asked', 'false');
    SELECT string_agg(coalesce(v_expressions ->> a.attname, 'NULL::' || format_type(a.atttypid, -1)), ', '
                      ORDER BY a.attnum),
           string_agg(CASE WHEN a.attname IN ('identity', 'hash', 'is_asked') THEN v_expressions ->> a.attname
                           WHEN a.attname = 'error' THEN 'this_read.failure'
                           ELSE 'NULL::' || format_type(a.atttypid, -1) END, ', ' ORDER BY a.attnum)
        INTO v_list, v_marks
        FROM pg_catalog.pg_attribute a
        WHERE a.attrelid = 'conflictdb.attached_plan'::regclass AND a.attnum > 0 AND NOT a.attisdropped;
    -- Typed, so that indexes on these columns can be used.
    SELECT string_agg(format('((i.i)::text[])[%s]::%s AS c%1$s', c.n, format_type(a.atttypid, -1)), ', ' ORDER BY c.n),
           string_agg(format('t.%I = i.c%s', c.name, c.n), ' AND ' ORDER BY c.n),
           string_agg(format('t.%I IS NULL', c.name), ' OR ' ORDER BY c.n)
        INTO v_decoded, v_joined, v_null
        FROM unnest(identity_columns) WITH ORDINALITY c (name, n)
        JOIN pg_catalog.pg_attribute a ON a.attrelid = p_table AND a.attname = c.name;
    -- Those of earlier releases return another type.
    IF (SELECT p.prorettype <> 'conflictdb.attached_plan'::regtype FROM pg_catalog.pg_proc p
        WHERE p.oid = to_regprocedure(format('conflictdb_attached.rows_%s(text[], text)', p_attachment_id))) THEN
        EXECUTE format('DROP FUNCTION conflictdb_attached.rows_%s(text[], text)', p_attachment_id);
    END IF;
    -- A text body has no dependencies: the table can still be altered and dropped.
    EXECUTE format('CREATE OR REPLACE FUNCTION conflictdb_attached.rows_%s(text[], text) '
                   'RETURNS SETOF conflictdb.attached_plan '
                   'LANGUAGE plpgsql STABLE SET search_path = pg_catalog, pg_temp '
                   'SET row_security = off SET "TimeZone" = ''UTC'' SET "DateStyle" = ''ISO, YMD'' '
                   'SET "IntervalStyle" = ''postgres'' SET extra_float_digits = 1 SET bytea_output = ''hex'' AS %L',
                   p_attachment_id,
                   format($body$
#variable_conflict use_column
<<this_read>>
DECLARE
    failure text;
BEGIN
    -- $1: identities, null: all. $2: hashes (only hashes), rows, or carefully (row by row, with the error of each).
    IF $2 = 'hashes' THEN
        RETURN QUERY SELECT %1$s FROM %2$s AS t WHERE %8$s;
    ELSIF $2 = 'rows' AND $1 IS NULL THEN
        RETURN QUERY SELECT %3$s FROM %2$s AS t WHERE %8$s;
    ELSIF $2 = 'rows' THEN
        RETURN QUERY SELECT %3$s FROM (SELECT DISTINCT %4$s FROM unnest($1) i (i)) i JOIN %2$s AS t ON %5$s
            WHERE %8$s;
        IF EXISTS (SELECT FROM unnest($1) i (i) WHERE array_position((i.i)::text[], NULL) IS NOT NULL) THEN
            RETURN QUERY SELECT %3$s FROM %2$s AS t WHERE (%6$s) AND %8$s;
        END IF;
    ELSE
        DECLARE
            t record;
            v_row conflictdb.attached_plan;
        BEGIN
            FOR t IN SELECT t.* FROM %2$s AS t WHERE ($1 IS NULL OR %7$s = ANY ($1)) AND %8$s LOOP
                BEGIN
                    SELECT %3$s INTO v_row;
                EXCEPTION WHEN OTHERS THEN
                    failure := SQLERRM;
                    SELECT %1$s INTO v_row;
                END;
                RETURN NEXT v_row;
            END LOOP;
        END;
    END IF;
END
$body$, v_marks, v_table, v_list, v_decoded, v_joined, v_null, v_identity, v_where));
    EXECUTE format('REVOKE ALL ON FUNCTION conflictdb_attached.rows_%s(text[], text) FROM PUBLIC', p_attachment_id);
    EXECUTE format('COMMENT ON FUNCTION conflictdb_attached.rows_%s(text[], text) IS %L', p_attachment_id,
                   format('Rows of %s as conflictdb reads them; conflictdb.detach removes it.', v_table));
    PERFORM set_config('search_path', v_path, true);
    BEGIN
        EXECUTE format('SELECT count(*) FROM conflictdb_attached.rows_%s(''{}''::text[], ''rows''::text)',
                       p_attachment_id);
    EXCEPTION WHEN OTHERS THEN
        IF SQLSTATE !~ '^42' THEN
            RAISE;
        END IF;
        FOUND := _raise('ZC009', p_who, 'map', 'cannot be used: ' || SQLERRM, 'map_usable');
    END;
END
$$;
COMMENT ON FUNCTION _create_attached_rows(text, bigint, smallint, regclass, jsonb) IS
'Creates or replaces the function that reads an attached table, as the current role; returns the columns of which the '
'key consists.';

CREATE OR REPLACE FUNCTION conflictdb_internal._watch_attached(
    p_attachment attachment, p_root oid, p_enables boolean
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_who text := format('attachment of %s', p_root::regclass);
    v_one record;
BEGIN
    IF p_attachment.has_triggers THEN
        PERFORM _create_note(p_attachment.attachment_id);
        FOR v_one IN
            SELECT t.relation::regclass AS relation, g.name, g.event, g.level,
                   format('conflictdb_%s_%s', p_attachment.attachment_id, g.name) AS trigger, e.tgenabled, g.enabled
            FROM _attached_tables(p_root) t
            CROSS JOIN (VALUES
                ('inserted', 'INSERT', 'REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT', ''),
                ('updated', 'UPDATE', 'REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT', ''),
                ('deleted', 'DELETE', 'REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT', ''),
                ('truncated', 'TRUNCATE', 'FOR EACH STATEMENT', 'ALWAYS'),
                -- Replicated rows do not fire statement triggers. Partitions inherit this one.
                ('replicated', 'INSERT OR UPDATE OR DELETE', 'FOR EACH ROW', 'REPLICA')
            ) g (name, event, level, enabled)
            LEFT JOIN pg_catalog.pg_trigger e
                ON e.tgrelid = t.relation AND e.tgname = format('conflictdb_%s_%s', p_attachment.attachment_id, g.name)
            WHERE CASE WHEN e.oid IS NOT NULL THEN p_enables AND e.tgenabled = 'D'
                       ELSE t.is_root OR g.name <> 'replicated' OR NOT EXISTS (
                           SELECT FROM pg_catalog.pg_class c WHERE c.oid = t.relation AND c.relispartition) END
            -- Like any statement that names the table.
            ORDER BY NOT t.is_root, t.relation LOOP
            PERFORM _hold_attached(v_who, v_one.relation, true);
            IF v_one.tgenabled IS NULL THEN
                EXECUTE format('CREATE TRIGGER %I AFTER %s ON %s %s EXECUTE FUNCTION conflictdb_internal._note_%s()',
                               v_one.trigger, v_one.event, v_one.relation, v_one.level, p_attachment.attachment_id);
            END IF;
            IF v_one.tgenabled IS NOT NULL OR v_one.enabled <> '' THEN
                EXECUTE format('ALTER TABLE %s ENABLE %s TRIGGER %I', v_one.relation, v_one.enabled, v_one.trigger);
            END IF;
        END LOOP;
        -- A partition that was detached keeps its triggers; another owner may have it now.
        FOR v_one IN
            SELECT r.relation, e.tgname FROM attached_relation r
            JOIN pg_catalog.pg_class c ON c.oid = r.relation AND pg_has_role(c.relowner, 'USAGE')
            JOIN pg_catalog.pg_trigger e ON e.tgrelid = r.relation AND e.tgparentid = 0
                 AND e.tgname LIKE format('conflictdb\_%s\_%%', p_attachment.attachment_id)
            WHERE r.attachment_id = p_attachment.attachment_id
              AND r.relation NOT IN (SELECT t.relation FROM _attached_tables(p_root) t) LOOP
            BEGIN
                EXECUTE format('DROP TRIGGER %I ON %s', v_one.tgname, v_one.relation);
            EXCEPTION WHEN lock_not_available OR undefined_object OR undefined_table THEN
                NULL; -- They do no harm: rows that are not there are not taken over.
            END;
        END LOOP;
    END IF;
    DELETE FROM attached_relation r WHERE r.attachment_id = p_attachment.attachment_id;
    INSERT INTO attached_relation (attachment_id, relation, is_root)
        SELECT p_attachment.attachment_id, t.relation::regclass, t.is_root FROM _attached_tables(p_root) t
        WHERE t.is_root OR p_attachment.has_triggers;
END
$$;
COMMENT ON FUNCTION _watch_attached(attachment, oid, boolean) IS
'Creates the missing triggers that record changes, on an attached table, its partitions and children, and records '
'which tables these are. p_enables: enables disabled ones, too.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_attachment(
    p_who text, p_kind smallint, p_table regclass, p_map jsonb, p_every interval, p_has_triggers boolean
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_times text;
    v_unread name;
BEGIN
    IF p_every < interval '1 second' THEN
        FOUND := _raise('ZC009', p_who, 'every', format('must be a second at least; got %s', p_every),
                        'attachment_every_positive');
    END IF;
    PERFORM _check_attachable(p_who, p_table, p_has_triggers);
    PERFORM _hold_attached(p_who, p_table, p_has_triggers);
    PERFORM _check_map(p_who, p_kind, p_map);
    SELECT a.attname INTO v_unread FROM pg_catalog.pg_attribute a
        WHERE a.attrelid = p_table AND a.attnum > 0 AND NOT a.attisdropped AND NOT p_map ? a.attname
          AND CASE a.attname WHEN 'activations' THEN p_kind = 0 AND a.atttypid = 'tstzmultirange'::regtype
                             WHEN 'departures' THEN p_kind = 1 AND a.atttypid = 'timestamptz[]'::regtype
                             WHEN 'schedule' THEN a.atttypid IN ('json'::regtype, 'jsonb'::regtype)
                             WHEN 'tolerances' THEN p_kind = 1 AND a.atttypid IN ('json'::regtype, 'jsonb'::regtype) END
        ORDER BY a.attnum LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC009', p_who, v_unread, 'is a column that the map does not read: objects would lack it',
                        'attached_column_read',
                        format('Map it, such as %1$s=%1$s; or rename it, or select the other columns in a view.',
                               v_unread));
    END IF;
    IF p_kind = 0 AND NOT p_map ?| '{span,start,end,activations,schedule}' THEN
        SELECT string_agg(quote_ident(a.attname), ', ' ORDER BY a.attnum) INTO v_times FROM pg_catalog.pg_attribute a
            WHERE a.attrelid = p_table AND a.attnum > 0 AND NOT a.attisdropped
              AND (a.atttypid IN ('timestamptz'::regtype, 'timestamp'::regtype, 'date'::regtype, 'tstzrange'::regtype,
                                  'tsrange'::regtype, 'daterange'::regtype)
                   OR a.attname ~* '(^|_)(start|begin|end|from|to|until|since|valid|time|date)(_|$)');
        IF v_times IS NOT NULL THEN
            RAISE NOTICE '%: areas are there at all times: the map gives no start, end or span; % look like times and '
                         'are not read', p_who, v_times;
        END IF;
    END IF;
END
$$;
COMMENT ON FUNCTION _check_attachment(text, smallint, regclass, jsonb, interval, boolean) IS
'Raises ZC009 for a table or a map that cannot be used; locks the table against renaming and replacement.';

CREATE OR REPLACE FUNCTION conflictdb_internal._compared_every(
    p_every interval, p_has_triggers boolean
) RETURNS interval
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- With triggers, comparisons only find what triggers miss: those that were disabled for a while.
    SELECT coalesce(p_every, CASE WHEN p_has_triggers THEN interval '1 hour' ELSE interval '1 minute' END);
END;
COMMENT ON FUNCTION _compared_every(interval, boolean) IS
'Interval between comparisons of all rows: the given one, else an hour with triggers, a minute without.';

CREATE OR REPLACE FUNCTION conflictdb_internal._may_have_triggers(p_table oid) RETURNS boolean
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT EXISTS (SELECT FROM pg_catalog.pg_class c WHERE c.oid = p_table AND c.relkind IN ('r', 'p'));
END;
COMMENT ON FUNCTION _may_have_triggers(oid) IS 'Whether a relation is a table, which can have the triggers.';

CREATE OR REPLACE FUNCTION conflictdb_internal._register_attachment(
    p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval, p_again boolean
) RETURNS attachment
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_to_change(p_scene);
    v_who text := format('attachment of %s', p_table);
    v_kind smallint := CASE p_kind WHEN 'area' THEN 0 WHEN 'track' THEN 1 END;
    v_has_triggers boolean := p_every IS NULL AND _may_have_triggers(p_table);
    v_attachment attachment%ROWTYPE;
    v_former bigint;
BEGIN
    IF v_kind IS NULL THEN
        FOUND := _raise('ZC009', v_who, 'kind', format('must be area or track; got %L', p_kind), 'attached_kind');
    END IF;
    PERFORM _check_attachment(v_who, v_kind, p_table, p_map, p_every, v_has_triggers);
    v_former := (SELECT min(a.attachment_id) FROM attachment a
                 WHERE a.scene_id = v_scene_id AND a.object_kind = v_kind AND _attached_root(a) = p_table);
    IF v_former IS NOT NULL AND NOT p_again THEN
        FOUND := _raise('ZC009', v_who, 'table', format('is attached to scene %L already, as attachment %s', p_scene,
                                                        v_former), 'attached_once',
                        'reattach(scene, table) gives it another map; p_again => true attaches it once more.');
    END IF;
    PERFORM _open_attached_schema();
    INSERT INTO attachment (scene_id, object_kind, table_schema, table_name, map, identity_columns, has_triggers, every)
        SELECT v_scene_id, v_kind, n.nspname, c.relname, p_map, '{}', v_has_triggers,
               _compared_every(p_every, v_has_triggers)
        FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace WHERE c.oid = p_table
        RETURNING * INTO v_attachment;
    PERFORM _free_attached_name(v_attachment.attachment_id);
    v_attachment.identity_columns := _create_attached_rows(v_who, v_attachment.attachment_id, v_kind, p_table, p_map);
    UPDATE attachment a SET identity_columns = v_attachment.identity_columns
        WHERE a.attachment_id = v_attachment.attachment_id;
    RETURN v_attachment;
END
$$;
COMMENT ON FUNCTION _register_attachment(text, text, regclass, jsonb, interval, boolean) IS
'Attaches a table without its triggers: checks it, records the attachment, creates the function that reads it. Raises '
'ZC009 for a table that is attached to the scene already, unless p_again.';

CREATE OR REPLACE FUNCTION attach(
    p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval DEFAULT NULL,
    p_again boolean DEFAULT false
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- CREATE TRIGGER waits for writers of the table, and other sessions queue behind it.
SET lock_timeout = '10s' AS $$
DECLARE
    v_attachment attachment := _register_attachment(p_scene, p_kind, p_table, p_map, p_every, p_again);
BEGIN
    -- All rows are new. They are taken over after commit, so that the table is not locked meanwhile.
    INSERT INTO attached_change (attachment_id) VALUES (v_attachment.attachment_id);
    PERFORM _watch_attached(v_attachment, p_table, false);
    PERFORM _wake_workers();
    RETURN v_attachment.attachment_id;
END
$$;
COMMENT ON FUNCTION attach(text, text, regclass, jsonb, interval, boolean) IS
'Attaches a table, view or foreign table to a scene: its rows become areas or tracks and follow later changes. p_map '
'gives a column or SQL expression of one row for each field; field where selects rows. The caller must own the table, '
'directly or through a role; of a superuser''s table that has no triggers (p_every, or a view) SELECT is enough. '
'Only sessions of the calling role evaluate the map: follow_attached, and detections and workers of that role. '
'Triggers record changes; with p_every, and for views and foreign tables (every minute), all rows are compared '
'instead. A table that the scene has already is refused, unless p_again. Returns the id of the attachment.';

CREATE OR REPLACE FUNCTION conflictdb_internal._find_attached(p_scene text, p_table text) RETURNS SETOF attachment
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    -- An unquoted name does not begin with a digit.
    v_number numeric := CASE WHEN p_table ~ '^[0-9]{1,18}$' THEN p_table::numeric END;
    v_name text[] := CASE WHEN v_number IS NULL THEN parse_ident(p_table) END;
    v_tables text;
BEGIN
    RETURN QUERY SELECT a.* FROM attachment a CROSS JOIN LATERAL (SELECT parse_ident(_attached_name(a)) AS name) n
        WHERE a.scene_id = v_scene_id
          AND CASE WHEN v_number IS NOT NULL THEN a.attachment_id = v_number
                   ELSE n.name[2] = v_name[cardinality(v_name)]
                        AND (cardinality(v_name) = 1 OR n.name[1] = v_name[cardinality(v_name) - 1]) END;
    IF NOT FOUND THEN
        SELECT string_agg(DISTINCT _attached_name(a), ', ') INTO v_tables FROM attachment a
            WHERE a.scene_id = v_scene_id;
        FOUND := _raise('ZC011', format('scene %L', p_scene), 'table',
                        format('%s is not attached to it; attached: %s', p_table, coalesce(v_tables, 'none')),
                        'table_attached');
    END IF;
END
$$;
COMMENT ON FUNCTION _find_attached(text, text) IS
'Attachments of a table (TABLE or SCHEMA.TABLE) to a scene, or the one with a number; raises ZC011 if there is none.';

CREATE OR REPLACE FUNCTION conflictdb_internal._hold_attachment(p_scene text, p_table text) RETURNS attachment
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_ids bigint[];
    v_attachment attachment%ROWTYPE;
    v_role name;
BEGIN
    PERFORM _scene_to_change(p_scene);
    v_ids := ARRAY(SELECT f.attachment_id FROM _find_attached(p_scene, p_table) f ORDER BY 1);
    IF cardinality(v_ids) > 1 THEN
        FOUND := _raise('ZC009', format('scene %L', p_scene), 'table',
                        format('%s is attached to it %s times: give the number of one: %s', p_table, cardinality(v_ids),
                               array_to_string(v_ids, ', ')), 'attached_one');
    END IF;
    SELECT a.* INTO v_attachment FROM attachment a WHERE a.attachment_id = v_ids[1] FOR NO KEY UPDATE;
    v_role := _attaching_role(v_ids[1]);
    IF v_role <> current_user THEN
        FOUND := _raise('42501', format('attachment of %s', _attached_name(v_attachment)), 'role',
                        format('is %I, which attached the table: no other role may do this', v_role),
                        'attached_given_away',
                        format('That role, or a superuser, gives it away: '
                               'ALTER FUNCTION conflictdb_attached.rows_%s(text[], text) OWNER TO %I', v_ids[1],
                               current_user));
    END IF;
    RETURN v_attachment;
END
$$;
COMMENT ON FUNCTION _hold_attachment(text, text) IS
'Locks and returns the one attachment of a table (TABLE or SCHEMA.TABLE, or a number) to a scene. Raises '
'insufficient_privilege unless the current role attached it, or its function is gone.';

CREATE OR REPLACE FUNCTION conflictdb_internal._change_attachment(
    p_attachment attachment, p_changes jsonb, p_to regclass, p_every interval
) RETURNS attachment
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_former oid := _attached_root(p_attachment);
    v_is_there boolean := EXISTS (SELECT FROM pg_catalog.pg_class c WHERE c.oid = v_former);
    v_table regclass := coalesce(p_to, CASE WHEN v_is_there THEN v_former ELSE (
        SELECT c.oid FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
        WHERE n.nspname = p_attachment.table_schema AND c.relname = p_attachment.table_name) END);
    v_who text := format('attachment of %s', coalesce(v_table::text, _attached_name(p_attachment)));
    v_map jsonb;
    v_may boolean := _may_have_triggers(v_table);
    v_attachment attachment := p_attachment;
    v_columns text[];
BEGIN
    IF jsonb_typeof(p_changes) <> 'object' THEN
        FOUND := _raise('ZC009', v_who, 'map', 'must be a JSON object of fields and expressions', 'map_object');
    END IF;
    IF v_table IS NULL THEN
        FOUND := _raise('ZC009', v_who, 'table', 'no longer exists', 'attached_there',
                        'Give another table, or detach it.');
    END IF;
    v_map := jsonb_strip_nulls(p_attachment.map || coalesce(p_changes, '{}'));
    IF p_every IS NOT NULL OR p_attachment.has_triggers AND NOT v_may THEN
        v_attachment.has_triggers := p_every = interval '0' AND v_may;
        v_attachment.every := _compared_every(nullif(p_every, interval '0'), v_attachment.has_triggers);
    END IF;
    PERFORM _check_attachment(v_who, p_attachment.object_kind, v_table, v_map, v_attachment.every,
                              v_attachment.has_triggers);
    PERFORM _open_attached_schema();
    v_columns := _create_attached_rows(v_who, p_attachment.attachment_id, p_attachment.object_kind, v_table, v_map);
    IF v_table IS DISTINCT FROM v_former OR v_columns <> p_attachment.identity_columns
       OR p_attachment.has_triggers <> v_attachment.has_triggers THEN
        -- Drops the triggers and their function: it notes the former columns, and the former table may be another's.
        UPDATE attachment a SET identity_columns = '{}' WHERE a.attachment_id = p_attachment.attachment_id;
        DELETE FROM attached_change q WHERE q.attachment_id = p_attachment.attachment_id;
    END IF;
    UPDATE attachment a
        SET (table_schema, table_name) = (SELECT n.nspname, c.relname FROM pg_catalog.pg_class c
                                          JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
                                          WHERE c.oid = v_table),
            map = v_map, identity_columns = v_columns, has_triggers = v_attachment.has_triggers,
            every = v_attachment.every, compared_at = NULL, failed_at = NULL, error = NULL
        WHERE a.attachment_id = p_attachment.attachment_id
        RETURNING a.* INTO v_attachment;
    DELETE FROM attached_relation r WHERE r.attachment_id = p_attachment.attachment_id;
    INSERT INTO attached_relation (attachment_id, relation, is_root)
        VALUES (p_attachment.attachment_id, v_table, true);
    RETURN v_attachment;
END
$$;
COMMENT ON FUNCTION _change_attachment(attachment, jsonb, regclass, interval) IS
'Gives an attachment another map, table or interval (null: the present one; of a table that was dropped, another of '
'its name), as _register_attachment makes one: without its triggers.';

CREATE OR REPLACE FUNCTION reattach(
    p_scene text, p_table text, p_changes jsonb DEFAULT NULL, p_to regclass DEFAULT NULL, p_every interval DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET lock_timeout = '10s' AS $$
DECLARE
    v_attachment attachment := _change_attachment(_hold_attachment(p_scene, p_table), p_changes, p_to, p_every);
BEGIN
    INSERT INTO attached_change (attachment_id) VALUES (v_attachment.attachment_id);
    PERFORM _watch_attached(v_attachment, _attached_root(v_attachment), true);
    PERFORM _wake_workers();
    RETURN v_attachment.attachment_id;
END
$$;
COMMENT ON FUNCTION reattach(text, text, jsonb, regclass, interval) IS
'Changes fields of the map of an attached table (TABLE or SCHEMA.TABLE, or the number of the attachment; a null in '
'p_changes removes a field), or gives it another table or interval (null keeps the present one; 0 means triggers). '
'Objects, conflicts and acknowledgements stay: a row with the same key, or the same columns of the key, is the same '
'object. A table that was dropped and made again is taken by its name. Creates missing triggers, and enables disabled '
'ones. Only for the role that attached it. Returns the id of the attachment.';

CREATE OR REPLACE FUNCTION detach(p_scene text, p_table text, p_keep boolean DEFAULT false) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET lock_timeout = '10s' AS $$
DECLARE
    v_one attachment%ROWTYPE;
    v_objects bigint := 0;
    v_rows bigint;
BEGIN
    PERFORM _scene_to_change(p_scene);
    FOR v_one IN SELECT * FROM _find_attached(p_scene, p_table) LOOP
        IF NOT p_keep THEN
            DELETE FROM area a USING attached_object o
                WHERE v_one.object_kind = 0 AND o.attachment_id = v_one.attachment_id AND a.area_id = o.object_id
                  AND a.scene_id = v_one.scene_id;
            GET DIAGNOSTICS v_rows = ROW_COUNT;
            v_objects := v_objects + v_rows;
            DELETE FROM track t USING attached_object o
                WHERE v_one.object_kind = 1 AND o.attachment_id = v_one.attachment_id AND t.track_id = o.object_id
                  AND t.scene_id = v_one.scene_id;
            GET DIAGNOSTICS v_rows = ROW_COUNT;
            v_objects := v_objects + v_rows;
        END IF;
        -- Last, because dropping the triggers locks the table.
        DELETE FROM attachment a WHERE a.attachment_id = v_one.attachment_id;
        DELETE FROM attached_change q WHERE q.attachment_id = v_one.attachment_id;
    END LOOP;
    PERFORM _close_attached_schema();
    RETURN v_objects;
END
$$;
COMMENT ON FUNCTION detach(text, text, boolean) IS
'Detaches a table (TABLE or SCHEMA.TABLE, or the number of an attachment) from a scene: drops its triggers, and '
'removes the objects made from its rows unless p_keep. Returns the number of removed objects. Requires the right to '
'change the scene.';

-- A scene with attached tables cannot be removed: that would leave their triggers behind.

CREATE OR REPLACE FUNCTION conflictdb_internal._before_scene_removal() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_tables text := (SELECT string_agg(DISTINCT _attached_name(a), ', ')
                      FROM attachment a WHERE a.scene_id = OLD.scene_id);
BEGIN
    IF v_tables IS NOT NULL THEN
        FOUND := _raise('ZC009', format('scene %L', OLD.name), 'tables', 'are attached to it: ' || v_tables,
                        'scene_without_attachments', 'detach(scene, table) detaches each.');
    END IF;
    RETURN OLD;
END
$$;
COMMENT ON FUNCTION _before_scene_removal() IS 'Trigger: raises ZC009 on removal of a scene with attached tables.';
CREATE OR REPLACE TRIGGER scene_may_be_removed BEFORE DELETE ON scene
    FOR EACH ROW EXECUTE FUNCTION _before_scene_removal();

-- Only the attaching role changes an attachment. The trigger function notes the identity columns of every table that
-- has its triggers, also of one that has another owner by now: so these columns change only without that function.

CREATE OR REPLACE FUNCTION conflictdb_internal._before_attachment() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF pg_has_role((SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = TG_RELID), 'USAGE') THEN
        RETURN NEW; -- The owner of the tables may do everything, including restores.
    END IF;
    IF TG_OP = 'UPDATE' AND _attaching_role(OLD.attachment_id) <> current_user THEN
        FOUND := _raise('42501', format('attachment %s', OLD.attachment_id), 'attachment',
                        format('is written by role %I alone, which attached the table',
                               _attaching_role(OLD.attachment_id)), 'attached_by_role');
    END IF;
    IF TG_OP = 'INSERT' AND NEW.attachment_id <> currval('attachment_attachment_id_seq')
       OR _parent_of(NEW.scene_id) IS NOT NULL
       OR TG_OP = 'UPDATE' AND ((OLD.attachment_id, OLD.scene_id, OLD.object_kind)
                                IS DISTINCT FROM (NEW.attachment_id, NEW.scene_id, NEW.object_kind)
                                OR cardinality(OLD.identity_columns) > 0 AND cardinality(NEW.identity_columns) > 0
                                   AND OLD.identity_columns <> NEW.identity_columns
                                OR OLD.identity_columns <> NEW.identity_columns
                                   AND cardinality(NEW.identity_columns) > 0 AND to_regprocedure(
                                       format('conflictdb_internal._note_%s()', OLD.attachment_id)) IS NOT NULL) THEN
        FOUND := _raise('ZC009', format('attachment %s', NEW.attachment_id), 'table', 'cannot be changed',
                        'attachment_fixed', 'reattach(scene, table) changes it.');
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_attachment() IS
'Trigger: raises ZC009 for a given id of an attachment, and for identity columns that change beside the function that '
'notes them; insufficient_privilege for changes by other roles than the one that attached the table.';
CREATE OR REPLACE TRIGGER attachment_fixed BEFORE INSERT OR UPDATE ON attachment
    FOR EACH ROW EXECUTE FUNCTION _before_attachment();
ALTER TABLE attachment ENABLE ALWAYS TRIGGER attachment_fixed;

CREATE OR REPLACE FUNCTION conflictdb_internal._after_attachment_opened() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp
SET client_min_messages = warning AS $$
BEGIN
    EXECUTE format('DROP FUNCTION IF EXISTS conflictdb_internal._note_%s() CASCADE', NEW.attachment_id);
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_attachment_opened() IS
'Trigger: drops the trigger function of an attachment whose identity columns are taken away, and with it its triggers, '
'also those on tables of another owner. Runs as its owner. Restricted to the attachment that changed.';
CREATE OR REPLACE TRIGGER attachment_updated AFTER UPDATE ON attachment
    FOR EACH ROW WHEN (NEW.identity_columns = '{}' AND OLD.identity_columns <> '{}')
    EXECUTE FUNCTION _after_attachment_opened();
