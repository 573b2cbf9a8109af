-- Triggers on attached tables: they record the identities of changed rows in attached_change and wake the workers. They
-- neither map nor check rows, so writers pay for one row per statement and cannot fail on rows that cannot be mapped.
--
-- Each attachment has its own trigger function, so that statements with its column names are planned once per session.
--
-- The function runs as the owner of conflictdb. CREATE TRIGGER, also on a new partition, requires EXECUTE on it. Only
-- the attaching role and the owner of the table have it, as others could record changes in scenes that they may not
-- change. These two could use it in triggers on any table of their own. So it evaluates only output functions, and
-- reads transition tables only if the trigger declares them: otherwise the name could refer to a temporary view.

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_tables(
    p_relation oid
) RETURNS TABLE (relation oid, is_root boolean)
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    WITH RECURSIVE tree AS (
        SELECT p_relation AS relation, true AS is_root
        UNION
        -- DETACH PARTITION CONCURRENTLY hides a partition first, and removes it later.
        SELECT i.inhrelid, false FROM tree JOIN pg_catalog.pg_inherits i ON i.inhparent = tree.relation
            WHERE NOT i.inhdetachpending
    )
    SELECT tree.relation, tree.is_root FROM tree;
END;
COMMENT ON FUNCTION _attached_tables(oid) IS
'A table with its partitions and children: a statement fires only the triggers of the table that it names.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_root(p_attachment attachment) RETURNS oid
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Without a row the name counts: a restore into a database without the table has none. A table that was dropped
    -- leaves a row. By the catalogue: to_regclass raises an error for a schema that the role may not use.
    SELECT coalesce((SELECT r.relation::oid FROM attached_relation r
                     WHERE r.attachment_id = p_attachment.attachment_id AND r.is_root),
                    (SELECT c.oid FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
                     WHERE n.nspname = p_attachment.table_schema AND c.relname = p_attachment.table_name));
END;
COMMENT ON FUNCTION _attached_root(attachment) IS
'The table of an attachment, whatever its name is now. It may have been dropped; null: none has its name.';

CREATE OR REPLACE VIEW conflictdb_internal._attached_table WITH (security_invoker = true) AS
SELECT a.attachment_id,
       coalesce((SELECT format('%I.%I', n.nspname::text COLLATE "default", c.relname::text COLLATE "default")
                 FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
                 WHERE c.oid = r.relation), format('%I.%I', a.table_schema, a.table_name)) AS name
FROM attachment a LEFT JOIN attached_relation r ON r.attachment_id = a.attachment_id AND r.is_root;
COMMENT ON VIEW _attached_table IS 'Present names of attached tables; the last one of a table that was dropped.';
COMMENT ON COLUMN _attached_table.attachment_id IS 'Attachment.';
COMMENT ON COLUMN _attached_table.name IS 'Name, as SCHEMA.TABLE.';

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_name(p_attachment attachment) RETURNS text
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT t.name FROM _attached_table t WHERE t.attachment_id = p_attachment.attachment_id;
END;
COMMENT ON FUNCTION _attached_name(attachment) IS 'Present name of an attached table (_attached_table).';

CREATE OR REPLACE FUNCTION conflictdb_internal._attached_problems(p_attachment attachment) RETURNS text[]
LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_root CONSTANT oid := _attached_root(p_attachment);
    c_names CONSTANT name[] := ARRAY(SELECT format('conflictdb_%s_%s', p_attachment.attachment_id, e)
                                     FROM unnest('{inserted,updated,deleted,truncated,replicated}'::text[]) e);
    v_found text[] := '{}';
    v_is_missing boolean;
    v_is_disabled boolean;
BEGIN
    IF NOT EXISTS (SELECT FROM pg_catalog.pg_class c WHERE c.oid = v_root) THEN
        RETURN ARRAY[CASE WHEN EXISTS (
            SELECT FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
            WHERE n.nspname = p_attachment.table_schema AND c.relname = p_attachment.table_name)
            THEN 'remade' ELSE 'gone' END];
    END IF;
    IF NOT EXISTS (
        SELECT FROM attached_relation r JOIN pg_catalog.pg_class c ON c.oid = r.relation
        JOIN pg_catalog.pg_namespace n ON n.oid = c.relnamespace
        WHERE r.attachment_id = p_attachment.attachment_id AND r.is_root
          AND n.nspname = p_attachment.table_schema AND c.relname = p_attachment.table_name) THEN
        v_found := v_found || 'moved'::text;
    END IF;
    IF p_attachment.has_triggers THEN
        IF EXISTS (SELECT FROM (SELECT r.relation::oid FROM attached_relation r
                                WHERE r.attachment_id = p_attachment.attachment_id) k
                   FULL JOIN _attached_tables(v_root) t USING (relation)
                   WHERE k.relation IS NULL OR t.relation IS NULL) THEN
            v_found := v_found || 'parts'::text;
        END IF;
        SELECT bool_or(x.present < cardinality(c_names)), bool_or(x.is_disabled) INTO v_is_missing, v_is_disabled FROM (
            SELECT count(g.tgname) AS present,
                   bool_or(g.tgenabled NOT IN ('O', 'A') AND g.tgname NOT LIKE '%replicated') IS TRUE AS is_disabled
            FROM _attached_tables(v_root) t
            LEFT JOIN pg_catalog.pg_trigger g ON g.tgrelid = t.relation AND g.tgname = ANY (c_names)
            GROUP BY t.relation) x;
        v_found := v_found || CASE WHEN v_is_missing THEN '{unwatched}'::text[] ELSE '{}' END
                   || CASE WHEN v_is_disabled THEN '{disabled}'::text[] ELSE '{}' END;
    END IF;
    RETURN v_found;
END
$$;
COMMENT ON FUNCTION _attached_problems(attachment) IS
'What changed about an attached table that no trigger records: gone, remade (gone, and another has its name), moved '
'(renamed, or restored), parts (its partitions and children are others), unwatched (triggers are missing), disabled '
'(triggers are); empty: nothing.';

CREATE OR REPLACE FUNCTION conflictdb_internal._identity_of(p_alias text, p_columns text[]) RETURNS text
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Output functions only: users can define casts.
    SELECT format('concat(ARRAY[%s])',
                  string_agg(format('CASE WHEN %1$s.%2$I IS NOT NULL THEN concat(%1$s.%2$I) END', p_alias, c.name), ', '
                             ORDER BY c.n))
    FROM unnest(p_columns) WITH ORDINALITY c (name, n);
END;
COMMENT ON FUNCTION _identity_of(text, text[]) IS
'Returns the SQL of a row''s identity: the texts of the identity columns, as an array in text form.';

CREATE OR REPLACE FUNCTION conflictdb_internal._create_note(p_attachment_id bigint) RETURNS void
LANGUAGE plpgsql VOLATILE STRICT SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    -- Larger statements, and identities too long to be mapped (44_attached_objects.sql), cause a comparison of the
    -- whole table: collecting more would slow writers down.
    c_most CONSTANT integer := 100;
    c_longest CONSTANT integer := 1000;
    v_columns text[] := (SELECT a.identity_columns FROM attachment a WHERE a.attachment_id = p_attachment_id);
    v_role name;
BEGIN
    -- A caller with a snapshot older than the attachment would create a broken function.
    IF coalesce(cardinality(v_columns), 0) = 0 THEN
        FOUND := _raise('ZC011', format('attachment %s', p_attachment_id), 'attachment_id', 'is not known',
                        'attachment_known');
    END IF;
    EXECUTE format('CREATE OR REPLACE FUNCTION conflictdb_internal._note_%s() RETURNS trigger '
                   'LANGUAGE plpgsql VOLATILE SECURITY DEFINER '
                   -- The same settings as in the function that reads rows (42_attach.sql), so that texts are equal.
                   'SET search_path FROM CURRENT SET "TimeZone" = ''UTC'' SET "DateStyle" = ''ISO, YMD'' '
                   'SET "IntervalStyle" = ''postgres'' SET extra_float_digits = 1 SET bytea_output = ''hex'' AS %L',
                   p_attachment_id, format($body$
DECLARE
    v_rows bigint := 1;
    v_identities text[];
BEGIN
    IF to_regclass('conflictdb.attached_change') IS NULL THEN
        RETURN NULL; -- The schema was dropped without that of this function: writers go on.
    END IF;
    -- A column may have been renamed.
    IF TG_OP <> 'TRUNCATE' AND (SELECT count(*) FROM pg_catalog.pg_attribute a WHERE a.attrelid = TG_RELID
                                AND a.attname = ANY (%2$L::name[]) AND NOT a.attisdropped) = %3$s
       AND (TG_LEVEL = 'ROW' OR EXISTS (
           SELECT FROM pg_catalog.pg_trigger g WHERE g.tgrelid = TG_RELID AND g.tgname = TG_NAME
           AND (TG_OP = 'INSERT' OR g.tgoldtable = 'old_rows')
           AND (TG_OP = 'DELETE' OR g.tgnewtable = 'new_rows'))) THEN
        BEGIN
            IF TG_LEVEL = 'ROW' THEN
                v_identities := '{}';
                IF TG_OP <> 'INSERT' THEN
                    v_identities := v_identities || %4$s;
                END IF;
                IF TG_OP <> 'DELETE' THEN
                    v_identities := v_identities || %5$s;
                END IF;
                IF octet_length(v_identities[1]) > %8$s OR octet_length(v_identities[2]) > %8$s THEN
                    v_identities := NULL;
                END IF;
            ELSIF TG_OP = 'DELETE' THEN
                SELECT count(*), CASE WHEN count(*) <= %6$s AND max(octet_length(x.identity)) <= %8$s
                                      THEN array_agg(left(x.identity, %8$s)) END
                    INTO v_rows, v_identities
                    FROM (SELECT %7$s AS identity FROM (SELECT * FROM old_rows LIMIT %6$s + 1) r OFFSET 0) x;
            ELSIF TG_OP = 'INSERT' THEN
                SELECT count(*), CASE WHEN count(*) <= %6$s AND max(octet_length(x.identity)) <= %8$s
                                      THEN array_agg(left(x.identity, %8$s)) END
                    INTO v_rows, v_identities
                    FROM (SELECT %7$s AS identity FROM (SELECT * FROM new_rows LIMIT %6$s + 1) r OFFSET 0) x;
            ELSE
                SELECT count(*), CASE WHEN count(*) <= 2 * %6$s AND max(octet_length(x.identity)) <= %8$s
                                      THEN array_agg(left(x.identity, %8$s)) END
                    INTO v_rows, v_identities
                    FROM (SELECT %7$s AS identity
                          FROM (SELECT * FROM (SELECT * FROM new_rows LIMIT %6$s + 1) n
                                UNION ALL SELECT * FROM (SELECT * FROM old_rows LIMIT %6$s + 1) o) r OFFSET 0) x;
            END IF;
        EXCEPTION WHEN OTHERS THEN
            v_identities := NULL; -- For example if a text would exceed 1 GB.
        END;
    END IF;
    IF v_rows > 0 THEN
        INSERT INTO attached_change (attachment_id, identities) VALUES (%1$s, v_identities);
        PERFORM _wake_workers();
    END IF;
    RETURN NULL;
END
$body$, p_attachment_id, v_columns, cardinality(v_columns), _identity_of('OLD', v_columns),
        _identity_of('NEW', v_columns), c_most, _identity_of('r', v_columns), c_longest));
    EXECUTE format('REVOKE ALL ON FUNCTION conflictdb_internal._note_%s() FROM PUBLIC, conflictdb_editor',
                   p_attachment_id);
    FOR v_role IN
        SELECT pg_get_userbyid(p.proowner) FROM pg_catalog.pg_proc p
            WHERE p.oid = to_regprocedure(format('conflictdb_attached.rows_%s(text[], text)', p_attachment_id))
        UNION
        SELECT pg_get_userbyid(c.relowner) FROM attachment a
            JOIN pg_catalog.pg_class c ON c.oid = _attached_root(a)
            WHERE a.attachment_id = p_attachment_id LOOP
        EXECUTE format('GRANT EXECUTE ON FUNCTION conflictdb_internal._note_%s() TO %I', p_attachment_id, v_role);
    END LOOP;
    EXECUTE format('COMMENT ON FUNCTION conflictdb_internal._note_%s() IS %L', p_attachment_id,
                   'Trigger on an attached table: records which rows changed. Runs as its owner: writers of the table '
                   'need no rights here. Restricted to changes of its own attachment.');
END
$$;
COMMENT ON FUNCTION _create_note(bigint) IS
'Creates the trigger function of an attachment. Runs as its owner: editors cannot create functions in this schema. '
'Restricted to the columns of the attachment, which are quoted.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_attachment_removal() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp
SET client_min_messages = warning AS $$
BEGIN
    -- CASCADE also drops triggers on tables with another owner, and dependent views of users.
    EXECUTE format('DROP FUNCTION IF EXISTS conflictdb_attached.rows_%s(text[], text) CASCADE', OLD.attachment_id);
    EXECUTE format('DROP FUNCTION IF EXISTS conflictdb_internal._note_%s() CASCADE', OLD.attachment_id);
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_attachment_removal() IS
'Trigger: drops the functions and triggers of a removed attachment. Runs as its owner: the table may now have another '
'owner. Restricted to the attachment that was removed.';
CREATE OR REPLACE TRIGGER attachment_removed AFTER DELETE ON attachment
    FOR EACH ROW EXECUTE FUNCTION _after_attachment_removal();

-- Recreate the functions of existing attachments.
DO $$
BEGIN
    PERFORM _create_note(a.attachment_id) FROM attachment a WHERE a.has_triggers;
END
$$;
