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
    p_who text, p_table text, p_has_triggers boolean
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    -- PREPARE takes a reader's lock on any relation, until the transaction ends, without planning or running anything.
    EXECUTE format('PREPARE conflictdb_hold_attached AS SELECT FROM %s', p_table);
    DEALLOCATE conflictdb_hold_attached;
    PERFORM _check_attached_owner(p_who, p_table::regclass, p_has_triggers);
END
$$;
COMMENT ON FUNCTION _hold_attached(text, text, boolean) IS
'Locks a table against replacement before it is read; raises ZC009 if it now has another owner.';

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
    -- All names written out from here on are qualified.
    PERFORM set_config('search_path', '', true);
    v_table := p_table::text;
    SELECT CASE WHEN 0 = ANY (v_columns) THEN 'hashtextextended((t.*)::text, 0)'
                ELSE format('hashtextextended(ROW(%s)::text, 0)',
                            string_agg(format('t.%I', a.attname), ', ' ORDER BY a.attnum)) END
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
    -- A text body has no dependencies: the table can still be altered and dropped.
    EXECUTE format('CREATE FUNCTION conflictdb_attached.rows_%s(text[], text) RETURNS SETOF conflictdb.attached_plan '
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
'Creates the function that reads an attached table, as the current role; returns the columns of which the key '
'consists.';

CREATE OR REPLACE FUNCTION conflictdb_internal._create_attached_triggers(
    p_attachment_id bigint, p_table regclass
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_one record;
BEGIN
    PERFORM _create_note(p_attachment_id);
    FOR v_one IN
        SELECT t.relation::regclass AS relation, t.is_root, g.name, g.event, g.level
        FROM _attached_tables(p_table) t
        CROSS JOIN (VALUES
            ('inserted', 'INSERT', 'REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT'),
            ('updated', 'UPDATE', 'REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT'),
            ('deleted', 'DELETE', 'REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT'),
            ('truncated', 'TRUNCATE', 'FOR EACH STATEMENT'),
            -- Replicated rows do not fire statement triggers. Partitions inherit this one.
            ('replicated', 'INSERT OR UPDATE OR DELETE', 'FOR EACH ROW')) g (name, event, level)
        WHERE t.is_root OR g.name <> 'replicated' OR NOT EXISTS (
            SELECT FROM pg_catalog.pg_class c WHERE c.oid = t.relation AND c.relispartition) LOOP
        EXECUTE format('CREATE TRIGGER conflictdb_%s_%s AFTER %s ON %s %s '
                       'EXECUTE FUNCTION conflictdb_internal._note_%1$s()',
                       p_attachment_id, v_one.name, v_one.event, v_one.relation, v_one.level);
        IF v_one.name IN ('truncated', 'replicated') THEN
            EXECUTE format('ALTER TABLE %s ENABLE %s TRIGGER conflictdb_%s_%s', v_one.relation,
                           CASE v_one.name WHEN 'truncated' THEN 'ALWAYS' ELSE 'REPLICA' END, p_attachment_id,
                           v_one.name);
        END IF;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _create_attached_triggers(bigint, regclass) IS
'Creates the triggers that record changes, on an attached table, its partitions and children.';

CREATE OR REPLACE FUNCTION conflictdb_internal._register_attachment(
    p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval
) RETURNS attachment
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- With triggers, comparisons only find what triggers miss: new partitions, disabled triggers.
    c_with_triggers CONSTANT interval := '1 hour';
    c_without CONSTANT interval := '1 minute';
    v_scene_id bigint := _scene_to_change(p_scene);
    v_who text := format('attachment of %s', p_table);
    v_kind smallint := CASE p_kind WHEN 'area' THEN 0 WHEN 'track' THEN 1 END;
    v_has_triggers boolean := p_every IS NULL AND EXISTS (
        SELECT FROM pg_catalog.pg_class c WHERE c.oid = p_table AND c.relkind IN ('r', 'p'));
    v_attachment attachment%ROWTYPE;
    v_times text;
    v_unread name;
BEGIN
    IF v_kind IS NULL THEN
        FOUND := _raise('ZC009', v_who, 'kind', format('must be area or track; got %L', p_kind), 'attached_kind');
    END IF;
    IF p_every < interval '1 second' THEN
        FOUND := _raise('ZC009', v_who, 'every', format('must be a second at least; got %s', p_every),
                        'attachment_every_positive');
    END IF;
    PERFORM _check_attachable(v_who, p_table, v_has_triggers);
    PERFORM _hold_attached(v_who, p_table::text, v_has_triggers);
    PERFORM _check_map(v_who, v_kind, p_map);
    SELECT a.attname INTO v_unread FROM pg_catalog.pg_attribute a
        WHERE a.attrelid = p_table AND a.attnum > 0 AND NOT a.attisdropped AND NOT p_map ? a.attname
          AND CASE a.attname WHEN 'activations' THEN v_kind = 0 AND a.atttypid = 'tstzmultirange'::regtype
                             WHEN 'departures' THEN v_kind = 1 AND a.atttypid = 'timestamptz[]'::regtype
                             WHEN 'schedule' THEN a.atttypid IN ('json'::regtype, 'jsonb'::regtype)
                             WHEN 'tolerances' THEN v_kind = 1 AND a.atttypid IN ('json'::regtype, 'jsonb'::regtype) END
        ORDER BY a.attnum LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC009', v_who, v_unread, 'is a column that the map does not read: objects would lack it',
                        'attached_column_read',
                        format('Map it, such as %1$s=%1$s; or rename it, or select the other columns in a view.',
                               v_unread));
    END IF;
    IF v_kind = 0 AND NOT p_map ?| '{span,start,end,activations,schedule}' THEN
        SELECT string_agg(quote_ident(a.attname), ', ' ORDER BY a.attnum) INTO v_times FROM pg_catalog.pg_attribute a
            WHERE a.attrelid = p_table AND a.attnum > 0 AND NOT a.attisdropped
              AND (a.atttypid IN ('timestamptz'::regtype, 'timestamp'::regtype, 'date'::regtype, 'tstzrange'::regtype,
                                  'tsrange'::regtype, 'daterange'::regtype)
                   OR a.attname ~* '(^|_)(start|begin|end|from|to|until|since|valid|time|date)(_|$)');
        IF v_times IS NOT NULL THEN
            RAISE NOTICE '%: areas are there at all times: the map gives no start, end or span; % look like times and '
                         'are not read', v_who, v_times;
        END IF;
    END IF;
    PERFORM _open_attached_schema();
    INSERT INTO attachment (scene_id, object_kind, table_schema, table_name, map, identity_columns, has_triggers, every)
        SELECT v_scene_id, v_kind, n.nspname, c.relname, p_map, '{}', v_has_triggers,
               coalesce(p_every, CASE WHEN v_has_triggers THEN c_with_triggers ELSE c_without END)
        FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace WHERE c.oid = p_table
        RETURNING * INTO v_attachment;
    PERFORM _free_attached_name(v_attachment.attachment_id);
    v_attachment.identity_columns := _create_attached_rows(v_who, v_attachment.attachment_id, v_kind, p_table, p_map);
    UPDATE attachment a SET identity_columns = v_attachment.identity_columns
        WHERE a.attachment_id = v_attachment.attachment_id;
    RETURN v_attachment;
END
$$;
COMMENT ON FUNCTION _register_attachment(text, text, regclass, jsonb, interval) IS
'Attaches a table without its triggers: checks it, records the attachment, creates the function that reads it.';

CREATE OR REPLACE FUNCTION attach(
    p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT
-- CREATE TRIGGER waits for writers of the table, and other sessions queue behind it.
SET lock_timeout = '10s' AS $$
DECLARE
    v_attachment attachment := _register_attachment(p_scene, p_kind, p_table, p_map, p_every);
BEGIN
    -- All rows are new. They are taken over after commit, so that the table is not locked meanwhile.
    INSERT INTO attached_change (attachment_id) VALUES (v_attachment.attachment_id);
    IF v_attachment.has_triggers THEN
        PERFORM _create_attached_triggers(v_attachment.attachment_id, p_table);
    END IF;
    PERFORM _wake_workers();
    RETURN v_attachment.attachment_id;
END
$$;
COMMENT ON FUNCTION attach(text, text, regclass, jsonb, interval) IS
'Attaches a table, view or foreign table to a scene: its rows become areas or tracks and follow later changes. p_map '
'gives a column or SQL expression of one row for each field; field where selects rows. The caller must own the table, '
'directly or through a role; of a superuser''s table that has no triggers (p_every, or a view) SELECT is enough. '
'Only sessions of the calling role evaluate the map: follow_attached, and detections and workers of that role. '
'Triggers record changes; with p_every, and for views and foreign tables (every minute), all rows are compared '
'instead. Returns the id of the attachment.';

CREATE OR REPLACE FUNCTION conflictdb_internal._find_attached(p_scene text, p_table text) RETURNS SETOF attachment
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_name text[] := parse_ident(p_table);
    v_tables text;
BEGIN
    RETURN QUERY SELECT a.* FROM attachment a
        WHERE a.scene_id = v_scene_id AND a.table_name = v_name[cardinality(v_name)]
          AND (cardinality(v_name) = 1 OR a.table_schema = v_name[cardinality(v_name) - 1]);
    IF NOT FOUND THEN
        SELECT string_agg(DISTINCT format('%I.%I', a.table_schema, a.table_name), ', ') INTO v_tables
            FROM attachment a WHERE a.scene_id = v_scene_id;
        FOUND := _raise('ZC011', format('scene %L', p_scene), 'table',
                        format('%s is not attached to it; attached: %s', p_table, coalesce(v_tables, 'none')),
                        'table_attached');
    END IF;
END
$$;
COMMENT ON FUNCTION _find_attached(text, text) IS
'Attachments of a table (TABLE or SCHEMA.TABLE) to a scene; raises ZC011 if there is none.';

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
'Detaches a table (TABLE or SCHEMA.TABLE) from a scene: drops its triggers, and removes the objects made from its rows '
'unless p_keep. Returns the number of removed objects. Requires the right to change the scene.';

-- A scene with attached tables cannot be removed: that would leave their triggers behind.

CREATE OR REPLACE FUNCTION conflictdb_internal._before_scene_removal() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_tables text := (SELECT string_agg(DISTINCT format('%I.%I', a.table_schema, a.table_name), ', ')
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

-- An attachment cannot be changed: otherwise an editor could make its triggers record other columns of the table, or
-- use the id of another attachment.

CREATE OR REPLACE FUNCTION conflictdb_internal._before_attachment() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF pg_has_role((SELECT c.relowner FROM pg_catalog.pg_class c WHERE c.oid = TG_RELID), 'USAGE') THEN
        RETURN NEW; -- The owner of the tables may do everything, including restores.
    END IF;
    IF TG_OP = 'INSERT' AND NEW.attachment_id <> currval('attachment_attachment_id_seq')
       OR TG_OP = 'UPDATE' AND (OLD.attachment_id, OLD.scene_id, OLD.object_kind, OLD.table_schema, OLD.table_name,
                                OLD.map, OLD.has_triggers)
                               IS DISTINCT FROM
                               (NEW.attachment_id, NEW.scene_id, NEW.object_kind, NEW.table_schema, NEW.table_name,
                                NEW.map, NEW.has_triggers)
       OR TG_OP = 'UPDATE' AND OLD.every <> NEW.every
       OR _parent_of(NEW.scene_id) IS NOT NULL
       OR TG_OP = 'UPDATE' AND cardinality(OLD.identity_columns) > 0
          AND OLD.identity_columns <> NEW.identity_columns THEN
        FOUND := _raise('ZC009', format('attachment %s', NEW.attachment_id), 'table', 'cannot be changed',
                        'attachment_fixed', 'Detach it, and attach it again.');
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_attachment() IS
'Trigger: raises ZC009 for a given id of an attachment, and for changes of what attach() has set.';
CREATE OR REPLACE TRIGGER attachment_fixed BEFORE INSERT OR UPDATE ON attachment
    FOR EACH ROW EXECUTE FUNCTION _before_attachment();
ALTER TABLE attachment ENABLE ALWAYS TRIGGER attachment_fixed;
