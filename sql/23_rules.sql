-- Separation rules: adding, replacing and removing them; refusing ambiguous ones; marking the pairs that they concern.

-- Also run by _after_rule_change, as the owner, for branches.
CREATE OR REPLACE FUNCTION conflictdb_internal._rule_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    v_who text := format('rule %L with %L', coalesce(NEW.a_class, 'any'), coalesce(NEW.b_class, 'any'));
    v_bad record;
BEGIN
    NEW.allowed := coalesce(NEW.allowed, false);
    PERFORM _check_word(v_who, 'a_class', NEW.a_class), _check_word(v_who, 'b_class', NEW.b_class);
    IF num_nonnulls(NEW.a_class, NEW.b_class) = 0 THEN
        FOUND := _raise('ZC019', v_who, 'a_class',
                        'must name a class: the scene''s settings are the rule for any with any', 'rule_side');
    END IF;
    SELECT v.name, v.value INTO v_bad FROM (VALUES ('separation_m', NEW.separation_m), ('vertical_m', NEW.vertical_m))
        v (name, value) WHERE NOT v.value BETWEEN 0 AND 20000000 LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC019', v_who, v_bad.name,
                        format('must be from 0 to 20000000 metres, or null; got %s', v_bad.value), 'rule_distance');
    END IF;
    IF NOT NEW.time_s BETWEEN 0 AND 2592000 OR abs(1e6 * NEW.time_s - round(1e6 * NEW.time_s)) > 1e-3 THEN
        FOUND := _raise('ZC019', v_who, 'time_s',
                        format('must be whole microseconds, 0 to 2592000 seconds (30 days), or null; got %s',
                               NEW.time_s), 'rule_time');
    END IF;
    IF NOT NEW.yields IN ('a', 'b') OR NEW.yields IS NOT NULL AND NEW.a_class IS NOT DISTINCT FROM NEW.b_class THEN
        FOUND := _raise('ZC019', v_who, 'yields',
                        format('must be ''a'' or ''b'', of two different sides, or null; got %L', NEW.yields),
                        'rule_yields');
    END IF;
    IF NEW.allowed AND num_nonnulls(NEW.separation_m, NEW.vertical_m, NEW.time_s, NEW.yields) > 0 THEN
        FOUND := _raise('ZC019', v_who, 'allowed', 'leaves no meaning to distances, times and yields', 'rule_allowed',
                        'Pairs that are allowed are not compared: leave the others null.');
    END IF;
    IF NEW.time_s > 0 AND EXISTS (SELECT FROM scene s WHERE s.scene_id = NEW.scene_id AND s.method = 'nlp') THEN
        FOUND := _raise('ZC019', v_who, 'time_s', 'is not known to method ''nlp'', whose program knows one time only',
                        'rule_time_solved', 'Use method exact, or 0.');
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _rule_before() IS 'Trigger: checks a separation rule (ZC019).';

CREATE OR REPLACE FUNCTION conflictdb_internal._sides(
    p_a_class text, p_b_class text, OUT rank integer, OUT first text, OUT other text, OUT name text
)
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT _side_rank(p_a_class) + _side_rank(p_b_class), s.first, s.other, _side_name(s.first)
    FROM (SELECT CASE WHEN _side_rank(p_a_class) >= _side_rank(p_b_class) THEN p_a_class ELSE p_b_class END AS first,
                 CASE WHEN _side_rank(p_a_class) >= _side_rank(p_b_class) THEN p_b_class ELSE p_a_class END AS other) s;
END;
COMMENT ON FUNCTION _sides(text, text) IS
'How specific a rule is, its more specific side and the other one; _side_name of the first.';

CREATE OR REPLACE FUNCTION conflictdb_internal._check_rules(p_scene_id bigint) RETURNS void
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp SET jit = off AS $$
DECLARE
    c_most CONSTANT bigint := 1000;
    v_rule record;
    v_tie record;
    v_rules rule[];
    v_names jsonb;
    v_is_tied boolean := false;
BEGIN
    IF (SELECT count(*) FROM (SELECT FROM rule r WHERE r.scene_id = p_scene_id LIMIT c_most + 1) n) > c_most THEN
        FOUND := _raise('ZC017', 'rules', 'count', format('must be at most %s', c_most), 'rules_few');
    END IF;
    -- Rules of one rank overlap only if each names one class, or if they are of areas and of tracks with any.
    v_rules := ARRAY(SELECT r FROM rule r WHERE r.scene_id = p_scene_id
                     AND _side_rank(r.a_class) + _side_rank(r.b_class) IN (1, 3, 4));
    v_names := _rule_names(p_scene_id);
    FOR v_rule IN SELECT r.*, s.* FROM unnest(v_rules) r CROSS JOIN LATERAL _sides(r.a_class, r.b_class) s
                  ORDER BY r.rule_id LOOP
        SELECT v_rule.a_class AS a, v_rule.b_class AS b, q.a_class AS c, q.b_class AS d, k.a_kind, k.b_kind,
               v_rule.first, s.first AS other INTO v_tie
            FROM unnest(v_rules) q CROSS JOIN LATERAL _sides(q.a_class, q.b_class) s
            CROSS JOIN (VALUES (0::smallint, 0::smallint), (0::smallint, 1::smallint), (1::smallint, 0::smallint),
                               (1::smallint, 1::smallint)) k (a_kind, b_kind)
            WHERE q.rule_id > v_rule.rule_id AND s.rank = v_rule.rank
              AND ((v_rule.separation_m, v_rule.vertical_m, v_rule.time_s, v_rule.allowed)
                   IS DISTINCT FROM (q.separation_m, q.vertical_m, q.time_s, q.allowed)
                   OR num_nonnulls(v_rule.yields, q.yields) > 0)
              AND CASE s.rank
                  WHEN 1 THEN _side_fits(v_rule.first, k.a_kind, NULL) AND _side_fits(s.first, k.b_kind, NULL)
                              AND NOT v_names ? format('k%s/k%s', k.a_kind, k.b_kind)
                  -- Two areas keep the larger distances of both rules (_rule_between).
                  ELSE (s.rank <> 4 OR k.a_kind + k.b_kind > 0)
                       AND _side_fits(v_rule.other, k.b_kind, NULL) AND _side_fits(s.other, k.a_kind, NULL)
                       AND NOT v_names ? format('%s/%s', v_rule.name, s.name)
                       AND (s.rank = 4 OR NOT v_names ?| ARRAY[format('%s/k%s', v_rule.name, k.b_kind),
                                                               format('%s/k%s', s.name, k.a_kind)]) END
            ORDER BY q.rule_id LIMIT 1;
        v_is_tied := FOUND;
        EXIT WHEN v_is_tied;
    END LOOP;
    IF v_is_tied THEN
        FOUND := _raise('ZC019', format('rule %L with %L', coalesce(v_tie.c, 'any'), coalesce(v_tie.d, 'any')),
                        'classes',
                        format('applies to a pair of %L (%s) and %L (%s) alike with rule %L with %L', v_tie.first,
                               CASE v_tie.a_kind WHEN 0 THEN 'area' ELSE 'track' END, v_tie.other,
                               CASE v_tie.b_kind WHEN 0 THEN 'area' ELSE 'track' END, coalesce(v_tie.a, 'any'),
                               coalesce(v_tie.b, 'any')), 'rules_unambiguous',
                        format('Enter a rule for %L with %L first; it comes before both.', v_tie.first, v_tie.other));
    END IF;
END
$$;
COMMENT ON FUNCTION _check_rules(bigint) IS
'Raises ZC019 if two rules of a scene are equally specific for a pair for which no rule is more specific, ZC017 for '
'too many rules.';

CREATE OR REPLACE FUNCTION conflictdb_internal._mark_side(
    p_scene_id bigint, p_side text, p_other text
) RETURNS void
LANGUAGE sql VOLATILE PARALLEL UNSAFE
BEGIN ATOMIC
    INSERT INTO change (scene_id, object_kind, object_id, version, with_number)
        SELECT p_scene_id, o.kind, o.id, nextval('version_seq'), nullif(_word_number(p_other), 0)
        FROM (SELECT 0::smallint AS kind, a.area_id AS id FROM area a
              WHERE a.scene_id = p_scene_id AND _side_fits(p_side, 0::smallint, a.class)
              UNION ALL
              SELECT 1::smallint, t.track_id FROM track t
              WHERE t.scene_id = p_scene_id AND _side_fits(p_side, 1::smallint, t.class)) o;
END;
COMMENT ON FUNCTION _mark_side(bigint, text, text) IS
'Marks the objects of one side of a rule, for their pairs with the other side; null: any.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_rule_change() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp
-- JSON keeps all digits.
SET extra_float_digits = 1 AS $$
DECLARE
    v_rules rule[] := '{}';
    v_more rule[];
    v_scene_id bigint;
    v_parent_id bigint;
    v_all jsonb;
BEGIN
    IF TG_OP <> 'DELETE' THEN
        EXECUTE 'SELECT array_agg(n::rule) FROM new_rows n' INTO v_more;
        v_rules := v_rules || coalesce(v_more, '{}');
    END IF;
    IF TG_OP <> 'INSERT' THEN
        -- Not of a scene that was removed.
        EXECUTE 'SELECT array_agg(o::rule) FROM old_rows o JOIN scene s ON s.scene_id = o.scene_id' INTO v_more;
        v_rules := v_rules || coalesce(v_more, '{}');
    END IF;
    IF cardinality(v_rules) = 0 THEN
        RETURN NULL;
    END IF;
    FOR v_scene_id IN SELECT DISTINCT r.scene_id FROM unnest(v_rules) r ORDER BY 1 LOOP
        -- The check sees rules of other sessions, and a proposal is applied under the rules that it was computed with.
        -- An update, so that sessions with older snapshots fail. Of a column without a unique index: the name would
        -- exclude foreign keys.
        UPDATE scene s SET motion = s.motion WHERE s.scene_id = v_scene_id;
        PERFORM _check_rules(v_scene_id);
        SELECT coalesce(jsonb_agg(to_jsonb(r) - '{rule_id,scene_id}'::text[]), '[]') INTO v_all
            FROM rule r WHERE r.scene_id = v_scene_id;
        v_parent_id := _parent_of(v_scene_id);
        -- Rules that a trigger puts are those of the parent, as it was.
        IF v_parent_id IS NOT NULL AND pg_trigger_depth() = 1 AND NOT (
            v_all @> (SELECT coalesce(jsonb_agg(to_jsonb(r) - '{rule_id,scene_id}'::text[]), '[]')
                      FROM rule r WHERE r.scene_id = v_parent_id)
            AND jsonb_array_length(v_all) = (SELECT count(*) FROM rule r WHERE r.scene_id = v_parent_id))
        THEN
            FOUND := _raise('ZC020', format('scene %L', (SELECT s.name FROM scene s WHERE s.scene_id = v_scene_id)),
                            'rules', 'are those of its parent', 'branch_rules', 'Change those: its branches follow.');
        END IF;
        PERFORM _settle_branches(v_scene_id, false);
    END LOOP;
    PERFORM _mark_side(m.scene_id, m.side, m.other)
        FROM (SELECT r.scene_id, r.a_class AS side, r.b_class AS other FROM unnest(v_rules) r
              UNION SELECT r.scene_id, r.b_class, r.a_class FROM unnest(v_rules) r) m;
    PERFORM _wake_workers();
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_rule_change() IS
'Trigger, once per statement: refuses ambiguous rules, and marks the pairs that changed rules concern. Runs as its '
'owner: editors cannot write marks of pairs. Restricted to the rules that the statement changed.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_replicated_rule() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    PERFORM _mark_all(r.scene_id) FROM (VALUES (OLD.scene_id), (NEW.scene_id)) r (scene_id)
        WHERE r.scene_id IS NOT NULL GROUP BY r.scene_id;
    PERFORM _wake_workers();
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_replicated_rule() IS
'Trigger, once per replicated row: marks all objects of the scene of a rule, and of its scene before. Restricted to '
'these scenes.';

CREATE OR REPLACE TRIGGER rule_before BEFORE INSERT OR UPDATE ON rule
    FOR EACH ROW EXECUTE FUNCTION _rule_before();
ALTER TABLE rule ENABLE ALWAYS TRIGGER rule_before;
CREATE OR REPLACE TRIGGER rule_inserted AFTER INSERT ON rule REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_rule_change();
CREATE OR REPLACE TRIGGER rule_updated AFTER UPDATE ON rule REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_rule_change();
CREATE OR REPLACE TRIGGER rule_deleted AFTER DELETE ON rule REFERENCING OLD TABLE AS old_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_rule_change();
CREATE OR REPLACE TRIGGER rule_replicated AFTER INSERT OR UPDATE OR DELETE ON rule
    FOR EACH ROW EXECUTE FUNCTION _after_replicated_rule();
ALTER TABLE rule ENABLE REPLICA TRIGGER rule_replicated;
CREATE OR REPLACE TRIGGER rule_not_truncated BEFORE TRUNCATE ON rule
    FOR EACH STATEMENT EXECUTE FUNCTION _refuse_truncate();
ALTER TABLE rule ENABLE ALWAYS TRIGGER rule_not_truncated;

CREATE OR REPLACE FUNCTION conflictdb_internal._put_rules(
    p_scene_id bigint, p_rules jsonb, p_is_all boolean
) RETURNS void
LANGUAGE sql VOLATILE
BEGIN ATOMIC
    -- One statement: rules are checked together, after it.
    WITH given AS (
        SELECT g.* FROM jsonb_to_recordset(p_rules) g (
            a_class text, b_class text, separation_m double precision, vertical_m double precision,
            time_s double precision, allowed boolean, yields text)
    ), gone AS (
        DELETE FROM rule r
        WHERE p_is_all AND r.scene_id = p_scene_id
          AND NOT EXISTS (SELECT FROM given g
                          WHERE least(coalesce(g.a_class, ''), coalesce(g.b_class, ''))
                                = least(coalesce(r.a_class, ''), coalesce(r.b_class, ''))
                            AND greatest(coalesce(g.a_class, ''), coalesce(g.b_class, ''))
                                = greatest(coalesce(r.a_class, ''), coalesce(r.b_class, '')))
    )
    INSERT INTO rule AS r (scene_id, a_class, b_class, separation_m, vertical_m, time_s, allowed, yields)
        SELECT p_scene_id, g.a_class, g.b_class, g.separation_m, g.vertical_m, g.time_s, coalesce(g.allowed, false),
               g.yields FROM given g
        ON CONFLICT (scene_id, least(coalesce(a_class, ''), coalesce(b_class, '')),
                     greatest(coalesce(a_class, ''), coalesce(b_class, ''))) DO UPDATE
            SET a_class = excluded.a_class, b_class = excluded.b_class, separation_m = excluded.separation_m,
                vertical_m = excluded.vertical_m, time_s = excluded.time_s, allowed = excluded.allowed,
                yields = excluded.yields
            WHERE (r.a_class, r.b_class, r.separation_m, r.vertical_m, r.time_s, r.allowed, r.yields)
                  IS DISTINCT FROM
                  (excluded.a_class, excluded.b_class, excluded.separation_m, excluded.vertical_m, excluded.time_s,
                   excluded.allowed, excluded.yields);
END;
COMMENT ON FUNCTION _put_rules(bigint, jsonb, boolean) IS
'Adds rules to a scene, in place of those of the same sides. p_rules: as _rules_of returns them; p_is_all: all others '
'are removed. Equal rules stay, and mark nothing.';

-- A branch has the settings and rules of its parent, also if another session changes them as it is made.

CREATE OR REPLACE FUNCTION conflictdb_internal._after_branch() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    -- Each detection of the parent starts one of each branch.
    c_most CONSTANT integer := 20;
BEGIN
    IF (SELECT count(*) FROM scene b WHERE b.parent_scene_id = NEW.parent_scene_id
                                       AND b.owner IS NOT DISTINCT FROM NEW.owner) > c_most THEN
        FOUND := _raise('ZC017', format('scene %L', NEW.name), 'branches',
                        format('of one role are at most %s of each scene', c_most), 'branches_few',
                        'Drop or merge one.');
    END IF;
    -- Without a lock of the parent: a change that commits meanwhile leaves the branch behind (_is_behind_parent).
    PERFORM _put_rules(NEW.scene_id, _rules_of(NEW.parent_scene_id), true);
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_branch() IS
'Trigger: gives a new branch the settings and rules of its parent. Runs as its owner: the role may be one that only '
'reads the parent. Restricted to the branch.';
CREATE OR REPLACE TRIGGER branch_inserted AFTER INSERT ON scene
    FOR EACH ROW WHEN (NEW.parent_scene_id IS NOT NULL) EXECUTE FUNCTION _after_branch();

CREATE OR REPLACE FUNCTION put_rule(
    p_scene text, p_a_class text, p_b_class text, p_separation_m double precision DEFAULT NULL,
    p_vertical_m double precision DEFAULT NULL, p_time_s double precision DEFAULT NULL, p_allowed boolean DEFAULT false,
    p_yields text DEFAULT NULL
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET extra_float_digits = 1 AS $$
DECLARE
    v_scene_id bigint := _scene_to_change(p_scene);
    v_bad text;
BEGIN
    -- JSON has no such numbers.
    SELECT v.name INTO v_bad FROM (VALUES ('separation_m', p_separation_m), ('vertical_m', p_vertical_m),
                                          ('time_s', p_time_s)) v (name, value)
        WHERE v.value IN ('NaN', 'infinity', '-infinity') LIMIT 1;
    IF FOUND THEN
        FOUND := _raise('ZC019', format('rule %L with %L', coalesce(p_a_class, 'any'), coalesce(p_b_class, 'any')),
                        v_bad, 'must be a finite number, or null', 'rule_number');
    END IF;
    PERFORM _put_rules(v_scene_id, jsonb_build_array(jsonb_build_object(
        'a_class', p_a_class, 'b_class', p_b_class, 'separation_m', p_separation_m, 'vertical_m', p_vertical_m,
        'time_s', p_time_s, 'allowed', p_allowed, 'yields', p_yields)), false);
END
$$;
COMMENT ON FUNCTION put_rule(text, text, text, double precision, double precision, double precision, boolean, text) IS
'Adds a separation rule for two classes, in either order, or replaces their rule. A class, ''area'' or ''track'' '
'for all of a kind, null for any object. Of several rules the most specific applies: two '
'classes, a class and a kind, a class and any, two kinds, a kind and any. Two rules of a class with ''area'' both '
'apply to two areas: the larger values count. Metres and seconds; null: as in the scene. '
'p_allowed: the pairs are not compared. p_yields: ''a'' or ''b'', the side that yields. Raises ZC019 for a rule that '
'is as specific as another for some pair.';

CREATE OR REPLACE FUNCTION remove_rule(p_scene text, p_a_class text, p_b_class text) RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_to_change(p_scene);
BEGIN
    DELETE FROM rule r
    WHERE r.scene_id = v_scene_id
      AND (r.a_class IS NOT DISTINCT FROM p_a_class AND r.b_class IS NOT DISTINCT FROM p_b_class
           OR r.a_class IS NOT DISTINCT FROM p_b_class AND r.b_class IS NOT DISTINCT FROM p_a_class);
    RETURN FOUND;
END
$$;
COMMENT ON FUNCTION remove_rule(text, text, text) IS
'Removes the separation rule of two classes, in either order; returns whether there was one. Raises ZC019 if two '
'others would then be equally specific for some pair.';

CREATE OR REPLACE VIEW rules WITH (security_invoker = true) AS
    SELECT s.name AS scene, r.a_class, r.b_class, r.separation_m, r.vertical_m, r.time_s, r.allowed, r.yields
    FROM rule r JOIN scene s USING (scene_id);
COMMENT ON VIEW rules IS 'Separation rules by class. Change them with put_rule and remove_rule.';
COMMENT ON COLUMN rules.scene IS 'Name of the scene.';
COMMENT ON COLUMN rules.a_class IS 'First side: a class, area or track; null: any object.';
COMMENT ON COLUMN rules.b_class IS 'Second side: a class, area or track; null: any object.';
COMMENT ON COLUMN rules.separation_m IS 'Required separation, metres; null: as in the scene.';
COMMENT ON COLUMN rules.vertical_m IS 'Required vertical separation, metres; null: as in the scene.';
COMMENT ON COLUMN rules.time_s IS 'Required separation in time, seconds; null: as in the scene.';
COMMENT ON COLUMN rules.allowed IS 'Whether the pairs may overlap, and are not compared.';
COMMENT ON COLUMN rules.yields IS 'Which side yields, a or b; null: not said.';
COMMENT ON TABLE rule IS 'Separation rules by class; see the view rules.';
COMMENT ON COLUMN rule.rule_id IS 'Id within this database.';
COMMENT ON COLUMN rule.scene_id IS 'Scene of the rule.';
COMMENT ON COLUMN rule.a_class IS 'First side: a class, area or track; null: any object.';
COMMENT ON COLUMN rule.b_class IS 'Second side: a class, area or track; null: any object.';
COMMENT ON COLUMN rule.separation_m IS 'Required separation, metres; null: as in the scene.';
COMMENT ON COLUMN rule.vertical_m IS 'Required vertical separation, metres; null: as in the scene.';
COMMENT ON COLUMN rule.time_s IS 'Required separation in time, seconds; null: as in the scene.';
COMMENT ON COLUMN rule.allowed IS 'Whether the pairs may overlap, and are not compared.';
COMMENT ON COLUMN rule.yields IS 'Which side yields, a or b; null: not said.';
