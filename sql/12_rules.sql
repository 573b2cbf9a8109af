-- Separation rules by class, and owners: which rule applies to a pair. conflictdb.model.rules does the same in memory.

CREATE OR REPLACE FUNCTION conflictdb_internal._word_number(p_word text) RETURNS bigint
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(('x' || left(md5(p_word), 16))::bit(64)::bigint, 0);
END;
COMMENT ON FUNCTION _word_number(text) IS
'A 64-bit digest of a class or an owner, 0 for null (conflictdb/arrays/column_numbers.py). Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._side_rank(p_side text) RETURNS integer
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_side IS NULL THEN 0 WHEN p_side IN ('area', 'track') THEN 1 ELSE 3 END;
END;
COMMENT ON FUNCTION _side_rank(text) IS 'How specific a side of a rule is: any 0, a kind 1, a class 3.';

CREATE OR REPLACE FUNCTION conflictdb_internal._side_fits(p_side text, p_kind smallint, p_class text) RETURNS boolean
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT p_side IS NULL OR p_side IS NOT DISTINCT FROM p_class
           OR p_side = CASE p_kind WHEN 0 THEN 'area' ELSE 'track' END;
END;
COMMENT ON FUNCTION _side_fits(text, smallint, text) IS
'Whether a side of a rule names an object (kind 0 area, 1 track). Inlined into queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._rule_between(
    p_scene_id bigint, p_a_kind smallint, p_a_class text, p_b_kind smallint, p_b_class text, p_above integer DEFAULT 0,
    OUT rule_id bigint, OUT a_class text, OUT b_class text, OUT separation_m double precision,
    OUT vertical_m double precision, OUT time_s double precision, OUT allowed boolean, OUT yields text
)
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT f.rule_id, f.a_class, f.b_class,
           -- Two rules of a class with 'area' both apply to two areas: the larger distances and time count.
           CASE WHEN count(*) OVER alike = 1 THEN f.separation_m
                ELSE max(coalesce(f.separation_m, s.separation_m)) FILTER (WHERE NOT f.allowed) OVER alike END,
           CASE WHEN count(*) OVER alike = 1 THEN f.vertical_m
                ELSE max(coalesce(f.vertical_m, s.vertical_separation_m)) FILTER (WHERE NOT f.allowed) OVER alike END,
           CASE WHEN count(*) OVER alike = 1 THEN f.time_s
                ELSE max(coalesce(f.time_s, s.time_separation_s)) FILTER (WHERE NOT f.allowed) OVER alike END,
           f.allowed,
           -- Which of the two objects yields: neither if the rule fits in both orders.
           CASE WHEN NOT f.is_turned THEN f.yields
                WHEN NOT f.is_straight THEN CASE f.yields WHEN 'a' THEN 'b' WHEN 'b' THEN 'a' END END
    FROM (SELECT r.*, o.*, _side_rank(r.a_class) + _side_rank(r.b_class) AS rank
          FROM rule r
          CROSS JOIN LATERAL (SELECT _side_fits(r.a_class, p_a_kind, p_a_class)
                                     AND _side_fits(r.b_class, p_b_kind, p_b_class) AS is_straight,
                                     _side_fits(r.a_class, p_b_kind, p_b_class)
                                     AND _side_fits(r.b_class, p_a_kind, p_a_class) AS is_turned) o
          WHERE r.scene_id = p_scene_id AND _side_rank(r.a_class) + _side_rank(r.b_class) > p_above
            AND (o.is_straight OR o.is_turned)) f
    JOIN scene s ON s.scene_id = p_scene_id
    WINDOW alike AS (PARTITION BY f.rank)
    ORDER BY f.rank DESC, f.allowed, f.separation_m DESC NULLS LAST, f.rule_id LIMIT 1;
END;
COMMENT ON FUNCTION _rule_between(bigint, smallint, text, smallint, text, integer) IS
'The most specific separation rule of a scene for two objects (kind 0 area, 1 track; class), with the distances and '
'times as the rule gives them, and which of the two yields; nulls without a rule. p_above: only rules that are more '
'specific.';

CREATE OR REPLACE FUNCTION conflictdb_internal._rules_of(p_scene_id bigint) RETURNS jsonb
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp
SET extra_float_digits = 1 AS $$
BEGIN
    RETURN (SELECT coalesce(jsonb_agg(jsonb_strip_nulls(jsonb_build_object(
                'a_class', r.a_class, 'b_class', r.b_class, 'separation_m', r.separation_m, 'vertical_m', r.vertical_m,
                'time_s', r.time_s, 'allowed', nullif(r.allowed, false), 'yields', r.yields)) ORDER BY r.rule_id), '[]')
            FROM rule r WHERE r.scene_id = p_scene_id);
END
$$;
COMMENT ON FUNCTION _rules_of(bigint) IS 'The separation rules of a scene, as in scene files.';

CREATE OR REPLACE FUNCTION conflictdb_internal._longest_time_s(p_scene_id bigint) RETURNS double precision
-- Not LANGUAGE sql, which would be planned at each call.
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN (SELECT greatest(s.time_separation_s, (SELECT max(r.time_s) FROM rule r WHERE r.scene_id = p_scene_id))
            FROM scene s WHERE s.scene_id = p_scene_id);
END
$$;
COMMENT ON FUNCTION _longest_time_s(bigint) IS
'The largest separation in time of any pair of a scene, by its setting and its rules, seconds.';

CREATE OR REPLACE FUNCTION conflictdb_internal._schedules_within_s(p_scene_id bigint) RETURNS double precision
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN (SELECT _longest_time_s(p_scene_id) + s.delays_within_s FROM scene s WHERE s.scene_id = p_scene_id);
END
$$;
COMMENT ON FUNCTION _schedules_within_s(bigint) IS
'How long before and after its voyages a detection of a scene needs schedules, seconds.';

CREATE OR REPLACE FUNCTION conflictdb_internal._side_name(p_side text) RETURNS text
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_side IS NULL THEN '' WHEN p_side = 'area' THEN 'k0' WHEN p_side = 'track' THEN 'k1'
                ELSE _word_number(p_side)::text END;
END;
COMMENT ON FUNCTION _side_name(text) IS
'A side of a rule in _rule_names: k and the number of a kind, the number of a class, nothing for any.';

CREATE OR REPLACE FUNCTION conflictdb_internal._rule_names(p_scene_id bigint) RETURNS jsonb
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path = conflictdb, conflictdb_internal, pg_temp SET jit = off AS $$
BEGIN
    RETURN (SELECT coalesce(jsonb_object_agg(n.pair, n.allowed), '{}')
            FROM (SELECT o.pair, bool_and(r.allowed) AS allowed
                  FROM rule r CROSS JOIN LATERAL (SELECT _side_name(r.a_class) AS a, _side_name(r.b_class) AS b) n
                  CROSS JOIN LATERAL (VALUES (n.a || '/' || n.b), (n.b || '/' || n.a)) o (pair)
                  WHERE r.scene_id = p_scene_id GROUP BY o.pair) n);
END
$$;
COMMENT ON FUNCTION _rule_names(bigint) IS
'Whether each rule of a scene allows its pairs, by its sides in both orders: names of both (_side_name) with a slash.';

CREATE OR REPLACE FUNCTION conflictdb_internal._allowed_types(p_scene_id bigint) RETURNS jsonb
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN CASE WHEN EXISTS (SELECT FROM rule r WHERE r.scene_id = p_scene_id AND r.allowed)
                THEN _rule_names(p_scene_id) END;
END
$$;
COMMENT ON FUNCTION _allowed_types(bigint) IS
'_rule_names of a scene for _are_compared; null if no rule allows any pair.';

CREATE OR REPLACE FUNCTION conflictdb_internal._are_compared(
    p_a_kind smallint, p_a_class bigint, p_b_kind smallint, p_b_class bigint, p_rules jsonb
) RETURNS boolean
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- The most specific rule applies; of two that are as specific, one that does not allow (_rule_between).
    SELECT p_rules IS NULL OR NOT coalesce(
               CASE WHEN p_a_class <> 0 AND p_b_class <> 0
                    THEN (p_rules -> (p_a_class || '/' || p_b_class))::boolean END,
               least(CASE WHEN p_a_class <> 0 THEN (p_rules -> (p_a_class || '/k' || p_b_kind))::boolean END,
                     CASE WHEN p_b_class <> 0 THEN (p_rules -> (p_b_class || '/k' || p_a_kind))::boolean END),
               least(CASE WHEN p_a_class <> 0 THEN (p_rules -> (p_a_class || '/'))::boolean END,
                     CASE WHEN p_b_class <> 0 THEN (p_rules -> (p_b_class || '/'))::boolean END),
               (p_rules -> ('k' || p_a_kind || '/k' || p_b_kind))::boolean,
               least((p_rules -> ('k' || p_a_kind || '/'))::boolean,
                     (p_rules -> ('k' || p_b_kind || '/'))::boolean),
               false);
END;
COMMENT ON FUNCTION _are_compared(smallint, bigint, smallint, bigint, jsonb) IS
'Whether rules do not allow (_allowed_types) two objects, by the numbers of their classes (0: none). Inlined into '
'queries.';

CREATE OR REPLACE FUNCTION conflictdb_internal._scene_settings(p_scene_id bigint) RETURNS jsonb
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT _settings_of(s) || jsonb_build_object('rules', _rules_of(p_scene_id))
    FROM scene s WHERE s.scene_id = p_scene_id;
END;
COMMENT ON FUNCTION _scene_settings(bigint) IS 'Name, settings (_settings_of) and rules (_rules_of) of a scene.';
