-- Explains why two objects are or are not in conflict, stage by stage.
--
-- Stages 1 and 2 are evaluated again on the pieces of the last detection; the results of stages 3 and 4 are stored in
-- the conflict. A pair without a stored row was proven apart by the first stage that leaves no pieces. After a change
-- of either object the verdict is unknown.

CREATE OR REPLACE FUNCTION conflictdb_internal._explained_object(
    p_scene_id bigint, p_key text, OUT kind smallint, OUT id bigint, OUT key text, OUT name text, OUT class text,
    OUT owner text, OUT waits boolean, OUT pieces bigint, OUT is_covered boolean, OUT span tstzrange, OUT box geometry,
    OUT floor_m double precision, OUT ceiling_m double precision
)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_layers bigint[] := _layers(p_scene_id);
BEGIN
    SELECT o.kind, o.id, o.key, o.name, o.class, o.owner, coalesce(o.floor_m, '-infinity'),
           coalesce(o.ceiling_m, 'infinity')
        INTO kind, id, key, name, class, owner, floor_m, ceiling_m
        FROM (SELECT 0::smallint AS kind, a.area_id AS id, a.key, a.name, a.class, a.owner, a.floor_m, a.ceiling_m
              FROM _seen_areas(p_scene_id) a WHERE a.key = p_key
              UNION ALL
              SELECT 1::smallint, t.track_id, t.key, t.name, t.class, t.owner, t.floor_m, t.ceiling_m
              FROM _seen_tracks(p_scene_id) t WHERE t.key = p_key) o;
    IF NOT FOUND THEN
        FOUND := _raise('ZC011', format('object %s', quote_nullable(p_key)), 'key',
                        format('is no object of scene %L', (SELECT s.name FROM scene s WHERE s.scene_id = p_scene_id)),
                        'object_known');
    END IF;
    waits := EXISTS (SELECT FROM change m WHERE m.scene_id = ANY (v_layers) AND m.object_kind = _explained_object.kind
                     AND m.object_id = _explained_object.id);
    SELECT sum(p.pieces), bool_or(p.part < 0), range_merge(range_agg(p.span)), ST_Extent(p.hull)
        INTO pieces, is_covered, span, box
        FROM piece p WHERE p.object_kind = _explained_object.kind AND p.object_id = _explained_object.id
                       AND p.scene_id + 0 = ANY (v_layers);
END
$$;
COMMENT ON FUNCTION _explained_object(bigint, text) IS
'An object of a scene, whether it waits for detection, and the extent of its pieces; raises ZC011 for an unknown key.';

CREATE OR REPLACE FUNCTION conflictdb_internal._to_micrometres(
    p_height_m double precision, p_more_m double precision
) RETURNS double precision
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- As in conflictdb.core.pieces.covers.
    SELECT CASE WHEN p_more_m = 0 OR NOT abs(p_height_m) < 1e9 THEN p_height_m + p_more_m
                ELSE round((p_height_m + p_more_m)::numeric, 6)::double precision END;
END;
COMMENT ON FUNCTION _to_micrometres(double precision, double precision) IS
'A height with half of a vertical separation, metres, as pieces have it: rounded to the micrometre.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shown_rule(p_a_class text, p_b_class text) RETURNS text
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT format('of %s with %s', coalesce(to_json(p_a_class)::text, 'any'),
                  coalesce(to_json(p_b_class)::text, 'any'));
END;
COMMENT ON FUNCTION _shown_rule(text, text) IS 'Text of a rule for explanations; classes as JSON strings.';

CREATE OR REPLACE FUNCTION conflictdb_internal._explained_as_json(
    p_key text, p_name text, p_kind smallint, p_waits boolean, p_pieces bigint, p_span tstzrange,
    p_floor_m double precision, p_ceiling_m double precision
) RETURNS jsonb
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- JSON does not allow infinite numbers.
    SELECT jsonb_build_object(
        'key', p_key, 'name', p_name, 'kind', CASE p_kind WHEN 0 THEN 'area' ELSE 'track' END, 'waits', p_waits,
        'pieces', p_pieces, 'from', nullif(lower(p_span), '-infinity'), 'to', nullif(upper(p_span), 'infinity'),
        'floor_m', nullif(p_floor_m, '-infinity'), 'ceiling_m', nullif(p_ceiling_m, 'infinity'));
END;
COMMENT ON FUNCTION _explained_as_json(text, text, smallint, boolean, bigint, tstzrange, double precision,
                                       double precision) IS
'One object in the result of explain_conflict.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shown(p_instant timestamptz) RETURNS text
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Independent of the session's settings.
    SELECT rtrim(rtrim(to_char(p_instant AT TIME ZONE 'UTC', 'YYYY-MM-DD HH24:MI:SS.US'), '0'), '.') || 'Z';
END;
COMMENT ON FUNCTION _shown(timestamptz) IS 'An instant as text in UTC, independent of the session''s settings.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shown(p_span tstzrange) RETURNS text
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN lower_inf(p_span) AND upper_inf(p_span) THEN 'for ever'
                ELSE concat_ws(' ', 'from ' || _shown(lower(p_span)), 'to ' || _shown(upper(p_span))) END;
END;
COMMENT ON FUNCTION _shown(tstzrange) IS 'A span as text in UTC, independent of the session''s settings.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shown_heights(
    p_floor_m double precision, p_ceiling_m double precision
) RETURNS text
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_floor_m = '-infinity' AND p_ceiling_m = 'infinity' THEN 'at all heights'
                WHEN p_floor_m = '-infinity' THEN 'below ' || p_ceiling_m || ' m'
                WHEN p_ceiling_m = 'infinity' THEN 'from ' || p_floor_m || ' m upward'
                ELSE 'between ' || p_floor_m || ' and ' || p_ceiling_m || ' m' END;
END;
COMMENT ON FUNCTION _shown_heights(double precision, double precision) IS
'A height band (metres; infinite: no limit) as text.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shown_seconds(p_s double precision) RETURNS text
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT concat_ws(' ', nullif(t.us / 3600000000 || ' h', '0 h'), nullif(t.us / 60000000 % 60 || ' min', '0 min'),
                     CASE WHEN t.us % 60000000 > 0 OR t.us = 0 THEN trim_scale(t.us % 60000000 / 1e6) || ' s' END)
    FROM (SELECT (1e6 * p_s)::bigint AS us) t;
END;
COMMENT ON FUNCTION _shown_seconds(double precision) IS 'A number of seconds as text: 4 min 10 s.';

CREATE OR REPLACE FUNCTION conflictdb_internal._shown_lack(
    p_within_s double precision, p_lacking_s double precision
) RETURNS text
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_lacking_s >= p_within_s THEN 'they use a place at the same time'
                ELSE format('one uses a place %s after the other', _shown_seconds(p_within_s - p_lacking_s)) END
           || format('; %s are required', _shown_seconds(p_within_s));
END;
COMMENT ON FUNCTION _shown_lack(double precision, double precision) IS
'How late a second use of a place is, and how late it must be, as text; seconds required, and seconds that are '
'lacking.';

CREATE OR REPLACE FUNCTION explain_conflict(p_scene text, p_a text, p_b text) RETURNS jsonb
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    c_most_pieces CONSTANT integer := 20;
    v_scene scene%ROWTYPE;
    v_layers bigint[];
    v_run run%ROWTYPE;
    v_conflict conflict%ROWTYPE;
    v_swapped record;
    a record;
    b record;
    v_left record;
    v_is_current boolean;
    v_is_found boolean;
    v_verdict text;
    v_stage integer;
    v_by text;
    v_why text;
    v_waiting text;
    v_method text;
    v_is_static boolean;
    v_last_stage integer;
    v_further_than_m double precision;
    v_within_s double precision;
    v_half_m double precision;
    v_rule record;
    v_settings jsonb;
BEGIN
    SELECT * INTO v_scene FROM scene s WHERE s.scene_id = _scene_or_branch(p_scene);
    v_layers := _layers(v_scene.scene_id);
    v_settings := _settings_of(v_scene) - '{name,centre_lon,centre_lat,delays_within_s,horizon_days,regions}'::text[];
    SELECT * INTO a FROM _explained_object(v_scene.scene_id, p_a);
    SELECT * INTO b FROM _explained_object(v_scene.scene_id, p_b);
    IF p_a = p_b THEN
        FOUND := _raise('ZC008', format('object %L', p_a), 'key', 'is given twice: a conflict is of two objects',
                        'explained_objects_differ');
    END IF;
    IF (b.kind, b.key COLLATE "C") < (a.kind, a.key COLLATE "C") THEN
        v_swapped := a;
        a := b;
        b := v_swapped;
    END IF;
    SELECT r.* INTO v_rule FROM _rule_between(v_scene.scene_id, a.kind, a.class, b.kind, b.class) r;
    -- Those of the pair.
    v_scene.separation_m := coalesce(v_rule.separation_m, v_scene.separation_m);
    v_scene.vertical_separation_m := coalesce(v_rule.vertical_m, v_scene.vertical_separation_m);
    v_scene.time_separation_s := coalesce(v_rule.time_s, v_scene.time_separation_s);
    v_within_s := v_scene.time_separation_s;
    v_half_m := v_scene.vertical_separation_m / 2;
    SELECT c.* INTO v_conflict FROM conflict c
        WHERE c.scene_id = ANY (v_layers) AND c.a_kind = a.kind AND c.a_id = a.id AND c.b_kind = b.kind
          AND c.b_id = b.id;
    v_is_found := FOUND;
    SELECT r.* INTO v_run FROM run r
        WHERE r.scene_id = ANY (v_layers) AND r.error IS NULL ORDER BY r.run_id DESC LIMIT 1;
    v_waiting := CASE
        WHEN NOT FOUND THEN 'the scene was never detected'
        WHEN a.waits OR b.waits THEN concat_ws(' and ', CASE WHEN a.waits THEN to_json(a.key)::text END,
                                               CASE WHEN b.waits THEN to_json(b.key)::text END)
                                     || ' changed, or the settings did, and no detection has seen that yet'
        WHEN EXISTS (SELECT FROM attachment t JOIN attached_change q USING (attachment_id)
                     WHERE t.scene_id = ANY (v_layers)) THEN
            'changes of an attached table wait to be taken over' END;
    v_is_current := v_waiting IS NULL;
    v_method := coalesce(v_conflict.method, v_run.method, v_scene.method);
    -- Two areas are decided by their shapes, with every method.
    v_is_static := a.kind = 0 AND b.kind = 0;
    v_last_stage := CASE WHEN v_method = 'screen' AND NOT v_is_static THEN 2 ELSE 4 END;

    SELECT count(*) AS in_boxes, count(*) FILTER (WHERE m.meets) AS in_hulls,
           (jsonb_agg(jsonb_build_object('a', m.a_part, 'b', m.b_part, 'from', lower(m.span), 'to', upper(m.span))
                      ORDER BY m.span, m.a_part, m.b_part) FILTER (WHERE m.meets)) AS pieces,
           coalesce(bool_or(m.climbs), false) AS climb
        INTO v_left
        -- Pieces of tracks with tolerances count from 2^30.
        FROM (SELECT m.part % (1 << 30) AS a_part, n.part % (1 << 30) AS b_part,
                     _shared_span(m.span, n.span, v_within_s) AS span,
                     _hulls_meet(m.hull, n.hull) AS meets, num_nonnulls(o.climb, p.climb) > 0 AS climbs
              FROM piece o JOIN piece p ON _pieces_may_meet(o, p, v_within_s, NULL)
              CROSS JOIN LATERAL _pieces_of(o) m
              JOIN LATERAL _pieces_of(p) n
                  ON _pieces_may_meet(m, n, v_within_s, NULL) AND _boxes_meet(n.hull, m.hull)
              WHERE o.scene_id + 0 = ANY (v_layers) AND o.object_kind = a.kind AND o.object_id = a.id
                AND p.scene_id + 0 = ANY (v_layers) AND p.object_kind = b.kind AND p.object_id = b.id) m;

    IF v_is_found THEN
        v_verdict := v_conflict.verdict;
        v_stage := v_last_stage;
        v_by := CASE WHEN v_is_static THEN 'their shapes, while both are there' ELSE 'their motion' END;
        v_why := CASE v_conflict.verdict
            WHEN 'conflict' THEN CASE WHEN v_within_s > 0 THEN _shown_lack(v_within_s, v_conflict.lacking_s)
                                      WHEN v_scene.separation_m > 0
                                      THEN format('they come closer than the required %s m', v_scene.separation_m)
                                      ELSE 'they meet' END
                 || CASE v_conflict.certainty WHEN 'must' THEN ', on every voyage within the tolerances'
                                              WHEN 'may' THEN ', perhaps not on every voyage within the tolerances'
                                              ELSE '' END
            WHEN 'grazing' THEN 'they are within the tolerance of the limit: too close to call'
            WHEN 'near' THEN 'they do not meet, but come within nearest_m'
            ELSE CASE WHEN a.is_covered OR b.is_covered
                      THEN coalesce((SELECT format('the schedule of %s is not understood: %s', to_json(o.key), o.error)
                                     FROM (SELECT s.key, s.schedule_error AS error
                                           FROM _seen_areas(v_scene.scene_id) s WHERE s.key IN (a.key, b.key)
                                           UNION ALL
                                           SELECT s.key, s.schedule_error
                                           FROM _seen_tracks(v_scene.scene_id) s WHERE s.key IN (a.key, b.key)) o
                                     WHERE o.error IS NOT NULL ORDER BY o.key LIMIT 1),
                                    'one of them could not be cut into pieces: only its times and heights are known')
                      WHEN v_stage < 4 THEN format('method %s ends with stage %s, which cannot decide', v_method,
                                                   v_stage)
                      ELSE 'neither a contact nor a distance could be proven' END
        END;
    ELSIF NOT v_is_current THEN
        v_verdict := 'unknown';
        v_why := v_waiting;
    ELSE
        v_verdict := 'apart';
        IF a.owner = b.owner THEN
            v_stage := 1;
            v_by := 'owner';
            v_why := format('not compared: both are of owner %s', to_json(a.owner));
            v_left.in_boxes := 0;
            v_left.in_hulls := 0;
        ELSIF v_rule.allowed THEN
            v_stage := 1;
            v_by := 'rule';
            v_why := format('not compared: the rule %s allows it',
                            _shown_rule(v_rule.a_class, v_rule.b_class));
            v_left.in_boxes := 0;
            v_left.in_hulls := 0;
        ELSIF NOT _times_meet(a.span, b.span, v_within_s) THEN
            v_stage := 1;
            v_by := 'time';
            v_why := format('one is there %s, the other %s', _shown(a.span), _shown(b.span))
                     || CASE WHEN v_within_s > 0 THEN format(': %s or more apart', _shown_seconds(v_within_s))
                             ELSE '' END;
        ELSIF NOT _heights_meet(
                _to_micrometres(a.floor_m, -v_half_m),
                _ceiling_m(_to_micrometres(a.ceiling_m, v_half_m), v_scene.intervals = 'closed'),
                _to_micrometres(b.floor_m, -v_half_m),
                _ceiling_m(_to_micrometres(b.ceiling_m, v_half_m), v_scene.intervals = 'closed')) THEN
            v_stage := 1;
            v_by := 'height';
            v_why := format('one is %s, the other %s', _shown_heights(a.floor_m, a.ceiling_m),
                            _shown_heights(b.floor_m, b.ceiling_m))
                     || CASE WHEN v_scene.vertical_separation_m > 0
                             THEN format(': %s m or more apart', v_scene.vertical_separation_m) ELSE '' END;
        ELSIF NOT a.box && b.box THEN
            v_stage := 1;
            v_by := 'space';
            v_why := 'the bounding boxes of all that they ever cover do not overlap';
        ELSIF v_left.in_boxes = 0 THEN
            v_stage := 1;
            v_by := 'space, time and height together';
            v_why := 'they are never in the same box at the same time and height';
        ELSIF v_left.in_hulls = 0 THEN
            v_stage := 2;
            v_by := 'space';
            v_why := 'boxes of their pieces overlap, but no hulls that they sweep at the same time';
        ELSE
            v_stage := v_last_stage;
            v_by := CASE WHEN v_is_static THEN 'their shapes' ELSE 'their motion' END;
            v_why := CASE WHEN v_within_s > 0
                          THEN format('they are proven to use no place within %s of each other',
                                      _shown_seconds(v_within_s))
                          ELSE 'they are proven to stay further apart than the limit of a conflict' END
                     || CASE WHEN v_left.climb THEN ' while their heights overlap' ELSE '' END;
        END IF;
        -- Only exact and nlp prove distances, and only for pairs that share time and heights.
        IF v_by NOT IN ('time', 'height', 'owner', 'rule') AND v_method <> 'screen' AND _times_meet(a.span, b.span, 0)
           AND NOT v_left.climb THEN
            v_further_than_m := greatest(v_scene.separation_m, v_scene.nearest_m);
        END IF;
    END IF;

    RETURN jsonb_build_object(
        'scene', v_scene.name,
        'a', _explained_as_json(a.key, a.name, a.kind, a.waits, a.pieces, a.span, a.floor_m, a.ceiling_m),
        'b', _explained_as_json(b.key, b.name, b.kind, b.waits, b.pieces, b.span, b.floor_m, b.ceiling_m),
        'verdict', v_verdict,
        'is_current', v_is_current,
        'is_scene_current', _is_current(v_scene.scene_id),
        'waiting', v_waiting,
        'decided_by', CASE WHEN v_stage IS NOT NULL THEN jsonb_build_object('stage', v_stage, 'by', v_by) END,
        'why', v_why,
        'periods', CASE WHEN v_is_found THEN
            (SELECT coalesce(jsonb_agg(jsonb_build_object('from', lower(r), 'to', upper(r)) ORDER BY r), '[]')
             FROM unnest(v_conflict.periods) r) END,
        'time_error_s', v_conflict.time_error_s,
        'lacking_s', v_conflict.lacking_s,
        'certainty', v_conflict.certainty,
        'closest', CASE WHEN v_conflict.closest_m IS NOT NULL THEN jsonb_build_object(
            'at', v_conflict.closest_at, 'm', v_conflict.closest_m, 'error_m', v_conflict.closest_error_m,
            'a', ST_AsGeoJSON(v_conflict.closest_a_point, 9)::jsonb -> 'coordinates',
            'b', ST_AsGeoJSON(v_conflict.closest_b_point, 9)::jsonb -> 'coordinates') END,
        'further_than_m', nullif(v_further_than_m, 0),
        'rule', CASE WHEN v_rule.rule_id IS NOT NULL AND (a.owner = b.owner) IS NOT TRUE
                     THEN jsonb_strip_nulls(jsonb_build_object(
            'a_class', v_rule.a_class, 'b_class', v_rule.b_class, 'separation_m', v_rule.separation_m,
            'vertical_m', v_rule.vertical_m, 'time_s', v_rule.time_s, 'allowed', nullif(v_rule.allowed, false),
            'yields', CASE v_rule.yields WHEN 'a' THEN a.key WHEN 'b' THEN b.key END,
            'text', _shown_rule(v_rule.a_class, v_rule.b_class))) END,
        'are_never_together', coalesce(v_by IN ('time', 'height'), false)
                              OR v_verdict <> 'unknown' AND v_within_s > 0 AND NOT _times_meet(a.span, b.span, 0),
        'stages', CASE WHEN v_verdict <> 'unknown' THEN jsonb_build_array(
            jsonb_build_object('stage', 1, 'asks', 'do boxes of pieces meet in space, time and height?',
                               'pairs', a.pieces * b.pieces, 'left', v_left.in_boxes),
            jsonb_build_object('stage', 2, 'asks', 'does what the pieces sweep meet?',
                               'pairs', v_left.in_boxes, 'left', v_left.in_hulls),
            jsonb_build_object('stage', 3, 'asks', 'in which time can they meet?', 'pairs', v_left.in_hulls, 'says',
                CASE WHEN v_left.in_hulls = 0 THEN 'not asked: nothing was left'
                     WHEN v_is_static THEN 'not asked: neither of them moves'
                     WHEN v_method = 'screen' THEN
                         'not asked: method screen ends before'
                     WHEN v_method = 'exact' AND v_within_s > 0 THEN
                         'left to stage 4: with a separation in time pairs of tracks are not decided in closed form'
                     WHEN v_method = 'exact' AND v_scene.separation_m > 0 THEN
                         'left to stage 4: with a separation nothing is decided in closed form'
                     WHEN v_method = 'exact' THEN
                         'asked of pieces that move evenly, in closed form; the others are left to stage 4'
                     ELSE 'done; results of single pairs of pieces are not stored' END),
            jsonb_build_object('stage', 4, 'asks', 'exactly when do they meet?', 'says',
                CASE WHEN v_left.in_hulls = 0 THEN 'not asked: nothing was left'
                     WHEN v_last_stage < 4 THEN
                         format('not asked: method %s ends before', v_method)
                     ELSE v_verdict END)) END,
        'pieces', (SELECT coalesce(jsonb_agg(p.pair ORDER BY p.n), '[]')
                   FROM jsonb_array_elements(v_left.pieces) WITH ORDINALITY p (pair, n) WHERE p.n <= c_most_pieces),
        'pieces_not_listed', greatest(v_left.in_hulls - c_most_pieces, 0),
        'settings', v_settings,
        'run', CASE WHEN v_is_found THEN jsonb_build_object('run_id', v_conflict.run_id, 'method', v_conflict.method)
                    WHEN v_run.run_id IS NOT NULL THEN
                        jsonb_build_object('run_id', v_run.run_id, 'method', v_run.method) END
    );
END
$$;
COMMENT ON FUNCTION explain_conflict(text, text, text) IS
'Explains why two objects of a scene are or are not in conflict, as JSON: verdict (as in the view conflicts; near; '
'apart; unknown while a change waits for detection), the stage that decided and why, pairs left by each stage, pieces, '
'periods, closest approach if stored, otherwise a distance that they exceed (further_than_m, metres; null if unknown), '
'settings, the separation rule that applies (null: none), run, and whether this is current. explain_conflict_text '
'returns it as text.';

CREATE OR REPLACE FUNCTION conflictdb_internal._explained_text(j jsonb) RETURNS text
LANGUAGE sql STABLE STRICT PARALLEL SAFE
BEGIN ATOMIC
    -- Keys and names as JSON strings, so that line breaks are escaped.
    SELECT concat_ws(E'\n',
        format('%s (%s) and %s (%s): %s', j #> '{a,key}',
               concat_ws(', ', j #>> '{a,kind}', nullif(j #> '{a,name}', 'null')), j #> '{b,key}',
               concat_ws(', ', j #>> '{b,kind}', nullif(j #> '{b,name}', 'null')), j ->> 'verdict'),
        '  ' || (j ->> 'why'),
        '  rule ' || (j #>> '{rule,text}')
            || CASE WHEN (j #> '{rule,allowed}')::boolean THEN ': allowed' ELSE ':' END
            || coalesce(' separation ' || (j #>> '{rule,separation_m}') || ' m', '')
            || coalesce(' vertical ' || (j #>> '{rule,vertical_m}') || ' m', '')
            || coalesce(' time ' || (j #>> '{rule,time_s}') || ' s', '')
            || coalesce(', ' || (j #> '{rule,yields}')::text || ' yields', ''),
        (SELECT string_agg('  ' || _shown(tstzrange((p ->> 'from')::timestamptz, (p ->> 'to')::timestamptz)), E'\n'
                           ORDER BY n)
                || CASE WHEN (j ->> 'time_error_s')::double precision > 0
                        THEN format(', ends good to %s s',
                                    trim(to_char((j ->> 'time_error_s')::double precision, '9.9EEEE'))) ELSE '' END
         FROM jsonb_array_elements(CASE jsonb_typeof(j -> 'periods') WHEN 'array' THEN j -> 'periods' ELSE '[]' END)
              WITH ORDINALITY r (p, n)),
        '  closest: ' || coalesce(
            round((j #>> '{closest,m}')::numeric, 3) || ' m, within ' || round((j #>> '{closest,error_m}')::numeric, 3)
            || ' m'
            || coalesce(', at ' || _shown((j #>> '{closest,at}')::timestamptz), ''),
            CASE WHEN (j ->> 'are_never_together')::boolean THEN 'never there at the same time and height' END,
            'further apart than ' || (j ->> 'further_than_m') || ' m',
            'not stored; `conflictdb explain` computes it, a detection with nearest_m stores it'),
        '  decided by stage ' || (j #>> '{decided_by,stage}') || ': ' || (j #>> '{decided_by,by}'),
        (SELECT string_agg(format('  stage %s: %s %s', s ->> 'stage', s ->> 'asks',
                                  coalesce(s ->> 'says', format('%s of %s pairs of pieces', s ->> 'left',
                                                                s ->> 'pairs'))), E'\n' ORDER BY n)
         FROM jsonb_array_elements(CASE jsonb_typeof(j -> 'stages') WHEN 'array' THEN j -> 'stages' ELSE '[]' END)
              WITH ORDINALITY t (s, n)),
        '  run ' || (j #>> '{run,run_id}') || ', method ' || (j #>> '{run,method}'),
        (SELECT '  settings: ' || string_agg(s.key || ' ' || s.value, ', ' ORDER BY s.key)
         FROM jsonb_each_text(j -> 'settings') s),
        CASE WHEN (j ->> 'is_current')::boolean THEN '  current: neither has changed since'
             ELSE '  not current: ' || (j ->> 'waiting') END);
END;
COMMENT ON FUNCTION _explained_text(jsonb) IS 'The result of explain_conflict as text.';

CREATE OR REPLACE FUNCTION explain_conflict_text(p_scene text, p_a text, p_b text) RETURNS text
LANGUAGE sql STABLE
BEGIN ATOMIC
    SELECT _explained_text(explain_conflict(p_scene, p_a, p_b));
END;
COMMENT ON FUNCTION explain_conflict_text(text, text, text) IS 'The result of explain_conflict as text.';

