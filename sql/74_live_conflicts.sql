-- Conflicts that follow from lateness: a lookup in the stored differences. If a track is late by a, and another by b,
-- and both keep it, they meet if and only if a - b is a forbidden delay of the first.

CREATE OR REPLACE FUNCTION conflictdb_internal._lateness(
    p_scene_id bigint, p_keys text[], OUT key text, OUT track_id bigint, OUT low_us bigint, OUT high_us bigint,
    OUT is_known boolean
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
BEGIN
    -- A track on its plan, or that has not begun it, is late by nothing: its haven contains it.
    RETURN QUERY
        SELECT l.key, t.track_id,
               CASE WHEN l.state IN ('on plan', 'not yet under way') THEN 0 ELSE round(l.late_from_s * 1e6)::bigint END,
               CASE WHEN l.state IN ('on plan', 'not yet under way') THEN 0 ELSE round(l.late_to_s * 1e6)::bigint END,
               l.state IN ('on plan', 'not yet under way') OR l.late_from_s IS NOT NULL
        FROM live_state l JOIN track t ON t.scene_id = l.scene_id AND t.key = l.key
        WHERE l.scene_id = p_scene_id AND l.key = ANY (p_keys) AND l.state <> 'past its end';
END
$$;
COMMENT ON FUNCTION _lateness(bigint, text[]) IS
'Least and greatest lateness of tracks of a scene with positions, microseconds; null, and not known, of a track that '
'is off. Without those whose plans are over.';

CREATE OR REPLACE FUNCTION conflictdb_internal._follow(
    p_scene_id bigint, p_keys text[], OUT key text, OUT other_key text, OUT other_kind smallint, OUT verdict text,
    OUT slack_us bigint, OUT by_us bigint, OUT ends_us bigint[], OUT low_us bigint, OUT high_us bigint,
    OUT other_low_us bigint, OUT other_high_us bigint
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET plan_cache_mode = force_generic_plan
SET enable_seqscan = off SET jit = off AS $$
#variable_conflict use_column
BEGIN
    RETURN QUERY
    WITH mine AS MATERIALIZED (SELECT l.* FROM _lateness(p_scene_id, p_keys) l WHERE l.is_known),
    pair AS MATERIALIZED (
        SELECT m.key, m.low_us, m.high_us, d.other_kind, d.other_id, d.forbidden_us, d.proven_us,
               coalesce(o.key, a.key) AS other_key
        FROM mine m
        JOIN difference d ON d.scene_id = p_scene_id AND d.track_id = m.track_id
        LEFT JOIN track o ON d.other_kind = 1 AND o.track_id = d.other_id AND o.scene_id = p_scene_id
        LEFT JOIN area a ON d.other_kind = 0 AND a.area_id = d.other_id AND a.scene_id = p_scene_id
    ),
    theirs AS MATERIALIZED (
        SELECT l.* FROM _lateness(p_scene_id, ARRAY(SELECT DISTINCT p.other_key FROM pair p WHERE p.other_kind = 1)) l
    )
    SELECT f.key, f.other_key, f.other_kind,
           CASE WHEN g.slack > 0 THEN NULL
                WHEN f.low = 0 AND f.high = 0 THEN 'planned'
                -- They are stored a microsecond longer.
                WHEN int8range(f.low - 1, f.high + 1, '[]') <@ f.proven_us THEN 'must' ELSE 'may' END,
           g.slack, g.by,
           ARRAY(SELECT DISTINCT e.by_us FROM unnest(f.forbidden_us) r
                 CROSS JOIN LATERAL (VALUES (greatest(lower(r), f.low)), (least(upper(r) - 1, f.high))) e (by_us)
                 WHERE lower(r) <= f.high AND upper(r) > f.low ORDER BY e.by_us DESC LIMIT 16),
           f.low_us, f.high_us, f.other_low, f.other_high
    FROM (SELECT p.*, coalesce(t.low_us, 0) AS other_low, coalesce(t.high_us, 0) AS other_high,
                 p.low_us - coalesce(t.high_us, 0) AS low, p.high_us - coalesce(t.low_us, 0) AS high
          FROM pair p LEFT JOIN theirs t ON t.key = p.other_key AND p.other_kind = 1
          WHERE p.other_key IS NOT NULL
            AND coalesce(t.is_known, true)
            -- The other plan is over.
            AND NOT (t.key IS NULL AND p.other_kind = 1
                     AND EXISTS (SELECT FROM live_state l WHERE l.scene_id = p_scene_id AND l.key = p.other_key))) f
    CROSS JOIN LATERAL (
        -- The forbidden interval that is nearest to the middle of what is possible, and its delay that is nearest.
        SELECT greatest(lower(r) - f.high, f.low - (upper(r) - 1), 0) AS slack,
               least(greatest((f.low + f.high) / 2, lower(r), f.low), upper(r) - 1, f.high) AS by
        FROM unnest(f.forbidden_us) r
        ORDER BY 1, abs(least(greatest((f.low + f.high) / 2, lower(r)), upper(r) - 1) - (f.low + f.high) / 2)
        LIMIT 1) g;
END
$$;
COMMENT ON FUNCTION _follow(bigint, text[]) IS
'What the latenesses of tracks of a scene come to, for each pair with a track or area that some delay brings it into '
'conflict with. verdict: must, if all of the possible differences are proven to conflict; may; planned, if both are as '
'planned, and conflict; null: no conflict, and slack_us is left. by_us: a difference in conflict, or the nearest; '
'ends_us: the ends of those in conflict, the greatest first; and the latenesses that are possible.';

CREATE OR REPLACE FUNCTION conflictdb_internal._note_alarm(
    p_kind text, p_at timestamptz, p_alarm live_conflict
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    -- A payload must be shorter than 8,000 bytes, as JSON: control characters in keys are six each.
    c_most CONSTANT integer := 7900;
    v_names jsonb := (SELECT jsonb_build_object('scene', s.name, 'keys',
                                                jsonb_build_array(p_alarm.key, nullif(p_alarm.other_key, '')))
                      FROM scene s WHERE s.scene_id = p_alarm.scene_id AND NOT _is_protected());
    v_payload jsonb := jsonb_build_object('scene', NULL, 'kind', p_kind, 'alarm', p_alarm.alarm_id,
                                          'verdict', p_alarm.verdict, 'keys', NULL);
BEGIN
    INSERT INTO live_event (scene_id, kind, at, alarm_id, key, other_key, verdict, reason, first_contact, last_contact,
                            place)
        VALUES (p_alarm.scene_id, p_kind, p_at, p_alarm.alarm_id, p_alarm.key, p_alarm.other_key, p_alarm.verdict,
                p_alarm.reason, p_alarm.first_contact, p_alarm.last_contact, p_alarm.place);
    IF octet_length((v_payload || v_names)::text) < c_most THEN
        v_payload := v_payload || v_names;
    END IF;
    PERFORM _notify('conflictdb_alarm', v_payload::text);
END
$$;
COMMENT ON FUNCTION _note_alarm(text, timestamptz, live_conflict) IS
'Records that an alarm has begun or ended, and notifies channel conflictdb_alarm; scene and keys are null if scenes '
'are protected, or the names too long.';

CREATE OR REPLACE FUNCTION conflictdb_internal._follow_renames(
    p_seen pg_snapshot, p_reading pg_snapshot
) RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_edit record;
    v_states live_state[];
    v_alarms live_conflict[];
    v_one live_conflict;
    v_is_any boolean := false;
BEGIN
    FOR v_edit IN SELECT r.scene_id, r.keys, r.former_keys FROM _renames_since(p_seen) r
                  JOIN scene s ON s.scene_id = r.scene_id
                  WHERE pg_visible_in_snapshot(r.transaction_id, p_reading) ORDER BY r.edit_id LOOP
        v_is_any := true;
        PERFORM FROM scene s WHERE s.scene_id = v_edit.scene_id FOR KEY SHARE;
        CONTINUE WHEN NOT FOUND;
        v_states := ARRAY(SELECT l FROM live_state l
                          WHERE l.scene_id = v_edit.scene_id AND l.key = ANY (v_edit.former_keys));
        v_alarms := ARRAY(SELECT c FROM live_conflict c
                          WHERE c.scene_id = v_edit.scene_id
                            AND (c.key = ANY (v_edit.former_keys) OR c.other_key = ANY (v_edit.former_keys)));
        CONTINUE WHEN v_states = '{}' AND v_alarms = '{}';
        -- What is left of objects that had these keys before.
        DELETE FROM live_state l WHERE l.scene_id = v_edit.scene_id AND l.key = ANY (v_edit.keys || v_edit.former_keys);
        FOR v_one IN
            DELETE FROM live_conflict c
                WHERE c.scene_id = v_edit.scene_id
                  AND (c.key = ANY (v_edit.keys || v_edit.former_keys)
                       OR c.other_key = ANY (v_edit.keys || v_edit.former_keys))
                RETURNING c.* LOOP
            IF NOT v_one.key = ANY (v_edit.former_keys) AND NOT v_one.other_key = ANY (v_edit.former_keys) THEN
                PERFORM _note_alarm('ended', clock_timestamp(), v_one);
            END IF;
        END LOOP;
        INSERT INTO live_state
            SELECT (jsonb_populate_record(l, jsonb_build_object('key', r.key))).*
            FROM unnest(v_states) l JOIN unnest(v_edit.keys, v_edit.former_keys) r (key, former_key)
                 ON r.former_key = l.key;
        INSERT INTO live_conflict
            SELECT (jsonb_populate_record(c, jsonb_build_object(
                       'key', CASE WHEN n.is_turned THEN n.other_key ELSE n.key END,
                       'other_key', CASE WHEN n.is_turned THEN n.key ELSE n.other_key END))).*
            FROM unnest(v_alarms) c
            LEFT JOIN unnest(v_edit.keys, v_edit.former_keys) a (key, former_key) ON a.former_key = c.key
            LEFT JOIN unnest(v_edit.keys, v_edit.former_keys) b (key, former_key) ON b.former_key = c.other_key
            CROSS JOIN LATERAL (
                SELECT coalesce(a.key, c.key) AS key, coalesce(b.key, c.other_key) AS other_key,
                       -- Two tracks are in the order of their keys.
                       coalesce(b.key, c.other_key) <> ''
                       AND coalesce(b.key, c.other_key) COLLATE "C" < coalesce(a.key, c.key) COLLATE "C"
                       AND EXISTS (SELECT FROM object_key k WHERE k.scene_id = c.scene_id AND k.object_kind = 1
                                   AND k.key = coalesce(b.key, c.other_key)) AS is_turned) n;
    END LOOP;
    RETURN v_is_any;
END
$$;
COMMENT ON FUNCTION _follow_renames(pg_snapshot, pg_snapshot) IS
'Gives the states and alarms of objects that got other keys since p_seen, and until p_reading, these keys; returns '
'whether there were such objects.';

CREATE OR REPLACE FUNCTION conflictdb_internal._open_alarms(
    p_scene_id bigint, p_keys text[], OUT key text, OUT other_key text, OUT verdict text, OUT reason text,
    OUT first_us bigint, OUT last_us bigint, OUT lon double precision, OUT lat double precision, OUT as_of_us bigint
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
BEGIN
    RETURN QUERY
        SELECT c.key, c.other_key, c.verdict, c.reason, (extract(epoch FROM c.first_contact) * 1000000)::bigint,
               (extract(epoch FROM c.last_contact) * 1000000)::bigint, ST_X(c.place), ST_Y(c.place),
               (extract(epoch FROM c.as_of) * 1000000)::bigint
        FROM live_conflict c
        WHERE c.scene_id = p_scene_id AND (c.key = ANY (p_keys) OR c.other_key = ANY (p_keys))
          AND NOT EXISTS (SELECT FROM live_state l
                          WHERE l.scene_id = p_scene_id AND l.key IN (c.key, c.other_key) AND l.key <> ALL (p_keys)
                            AND l.state = 'off');
END
$$;
COMMENT ON FUNCTION _open_alarms(bigint, text[]) IS
'Alarms of tracks with some keys, without those whose other track is off: only a look at that track finds what it may '
'meet.';

CREATE OR REPLACE FUNCTION conflictdb_internal._end_alarms(
    p_now_us bigint, p_ends_us bigint, p_off text
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_now timestamptz := timestamptz 'epoch' + p_now_us * interval '1 microsecond';
    v_over timestamptz := v_now - p_ends_us * interval '1 microsecond';
    v_scene_ids bigint[];
    v_one live_conflict;
BEGIN
    IF NOT _may_look() THEN
        RETURN;
    END IF;
    v_scene_ids := ARRAY(SELECT _lock_looked_at());
    FOR v_one IN
        DELETE FROM live_conflict c
            WHERE c.scene_id = ANY (v_scene_ids)
              AND (c.last_contact < v_over
                   OR (c.reason = p_off AND c.as_of < v_over
                       AND NOT EXISTS (SELECT FROM live_state l
                                       WHERE l.scene_id = c.scene_id AND l.key IN (c.key, c.other_key)
                                         AND l.state = 'off'))
                   -- An area may have the key of a removed track.
                   OR NOT EXISTS (SELECT FROM live_state l
                                  WHERE l.scene_id = c.scene_id AND l.key IN (c.key, c.other_key))
                   OR EXISTS (SELECT FROM unnest(ARRAY[c.key, c.other_key]) k
                              WHERE k <> ''
                                AND NOT EXISTS (SELECT FROM object_key o WHERE o.scene_id = c.scene_id AND o.key = k)))
            RETURNING c.* LOOP
        PERFORM _note_alarm('ended', v_now, v_one);
    END LOOP;
END
$$;
COMMENT ON FUNCTION _end_alarms(bigint, bigint, text) IS
'Ends the alarms whose contact is over for p_ends_us at an instant (microseconds), those for the reason p_off whose '
'tracks are on their plans again for as long, those of removed objects, and those of no track '
'with positions. None while another session looks.';

CREATE OR REPLACE FUNCTION conflictdb_internal._put_alarms(
    p_scene_id bigint, p_as_of_us bigint, p_key text[], p_other_key text[], p_verdict text[], p_reason text[],
    p_first_us bigint[], p_last_us bigint[], p_lon double precision[], p_lat double precision[], p_ended jsonb,
    p_slack jsonb
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    c_instant CONSTANT timestamptz := 'epoch';
    c_us CONSTANT interval := '1 microsecond';
    v_as_of timestamptz := c_instant + p_as_of_us * c_us;
    v_one live_conflict;
BEGIN
    UPDATE live_state l SET slack_s = (s.value)::double precision
        FROM jsonb_each_text(p_slack) s WHERE l.scene_id = p_scene_id AND l.key = s.key
             AND l.slack_s IS DISTINCT FROM (s.value)::double precision;
    FOR v_one IN
        DELETE FROM live_conflict c USING jsonb_array_elements(p_ended) e
            WHERE c.scene_id = p_scene_id AND c.key = e ->> 0 AND c.other_key = e ->> 1
            RETURNING c.* LOOP
        PERFORM _note_alarm('ended', v_as_of, v_one);
    END LOOP;
    FOR v_one IN
        INSERT INTO live_conflict AS c (scene_id, key, other_key, verdict, reason, first_contact, last_contact, place,
                                        alarm_id, opened_at, as_of)
            SELECT p_scene_id, u.key, u.other_key, u.verdict, u.reason, c_instant + u.first_us * c_us,
                   c_instant + u.last_us * c_us, ST_SetSRID(ST_MakePoint(u.lon, u.lat), 4326), 0, v_as_of, v_as_of
            FROM unnest(p_key, p_other_key, p_verdict, p_reason, p_first_us, p_last_us, p_lon, p_lat)
                 u (key, other_key, verdict, reason, first_us, last_us, lon, lat)
            ON CONFLICT (scene_id, key, other_key) DO UPDATE
                SET verdict = excluded.verdict, reason = excluded.reason, first_contact = excluded.first_contact,
                    last_contact = excluded.last_contact, place = excluded.place, as_of = excluded.as_of,
                    -- An acknowledgement as may ends at must; one as must holds also at may, since latenesses waver.
                    acknowledged_by = CASE WHEN c.acknowledged_as <> 'may' OR excluded.verdict = 'may'
                                           THEN c.acknowledged_by END,
                    acknowledged_at = CASE WHEN c.acknowledged_as <> 'may' OR excluded.verdict = 'may'
                                           THEN c.acknowledged_at END,
                    acknowledged_for = CASE WHEN c.acknowledged_as <> 'may' OR excluded.verdict = 'may'
                                            THEN c.acknowledged_for END
            RETURNING c.* LOOP
        IF v_one.alarm_id = 0 THEN
            v_one.alarm_id := nextval('conflict_seq');
            UPDATE live_conflict c SET alarm_id = v_one.alarm_id
                WHERE c.scene_id = p_scene_id AND c.key = v_one.key AND c.other_key = v_one.other_key;
            PERFORM _note_alarm('begun', v_as_of, v_one);
        END IF;
    END LOOP;
END
$$;
COMMENT ON FUNCTION _put_alarms(bigint, bigint, text[], text[], text[], text[], bigint[], bigint[], double precision[],
                                double precision[], jsonb, jsonb) IS
'Stores the alarms of a scene that a look found, ends others (pairs of keys), and notifies of those that begin and '
'end. p_slack: seconds that are left by key.';

CREATE OR REPLACE VIEW live_conflicts WITH (security_invoker = true) AS
SELECT s.name AS scene, c.alarm_id, c.key, nullif(c.other_key, '') AS other_key, c.verdict, c.reason, c.first_contact,
       c.last_contact, c.place, c.opened_at, c.as_of, c.acknowledged_by, c.acknowledged_at, c.acknowledged_for
FROM scene s JOIN live_conflict c USING (scene_id);

COMMENT ON VIEW live_conflicts IS
'Conflicts that follow if tracks keep the lateness that their positions show, and that are none as planned: alarms, '
'one for each pair, from when its slack is used up until it has some again or the contact is over.';
COMMENT ON COLUMN live_conflicts.scene IS 'Name of the scene.';
COMMENT ON COLUMN live_conflicts.alarm_id IS 'Number of the alarm, one for each excursion of a pair.';
COMMENT ON COLUMN live_conflicts.key IS 'Key of the track that is late, early, off or silent, or of the first of two.';
COMMENT ON COLUMN live_conflicts.other_key IS 'Key of the other track or area; null: whatever is near, see reason.';
COMMENT ON COLUMN live_conflicts.verdict IS
'must: at all latenesses that are possible; may: at some, or at some that differ from these by less than a minute (see '
'reason); now: must, and it has begun and is not over.';
COMMENT ON COLUMN live_conflicts.reason IS
'Why nothing better is known: off its plan, a lateness that exceeds delays_within_s, no stored delays; or slack '
'again; else null.';
COMMENT ON COLUMN live_conflicts.first_contact IS
'When, at the likeliest lateness that conflicts: the planned contact shifted; null: unknown.';
COMMENT ON COLUMN live_conflicts.last_contact IS 'When it is over, at the latest; null: unknown.';
COMMENT ON COLUMN live_conflicts.place IS 'Where the first contact is; null: unknown.';
COMMENT ON COLUMN live_conflicts.opened_at IS 'When its slack was used up.';
COMMENT ON COLUMN live_conflicts.as_of IS 'When a worker looked last.';
CREATE OR REPLACE FUNCTION conflictdb_internal._live_conflicts(
    p_scene text, OUT alarm_id bigint, OUT key text, OUT other_key text, OUT verdict text, OUT reason text,
    OUT first_contact timestamptz, OUT last_contact timestamptz, OUT lon_deg double precision,
    OUT lat_deg double precision, OUT opened_at timestamptz, OUT as_of timestamptz
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
BEGIN
    PERFORM _scene_id(p_scene);
    RETURN QUERY
        SELECT c.alarm_id, c.key, c.other_key, c.verdict, c.reason, c.first_contact, c.last_contact, ST_X(c.place),
               ST_Y(c.place), c.opened_at, c.as_of
        FROM live_conflicts c WHERE c.scene = p_scene
        ORDER BY c.first_contact, c.key, c.other_key;
END
$$;
COMMENT ON FUNCTION _live_conflicts(text) IS
'The view live_conflicts of a scene, the first contact first; raises ZC010 for an unknown name.';

COMMENT ON COLUMN live_conflicts.acknowledged_by IS 'Who acknowledged it; null: nobody, or it got worse since.';
COMMENT ON COLUMN live_conflicts.acknowledged_at IS 'When it was acknowledged; null: it is not.';
COMMENT ON COLUMN live_conflicts.acknowledged_for IS 'Why; null: it is not.';
CREATE OR REPLACE VIEW live_events WITH (security_invoker = true) AS
SELECT s.name AS scene, e.live_event_id AS event, e.kind, e.at, e.alarm_id, e.key,
       nullif(e.other_key, '') AS other_key, e.verdict, e.reason, e.first_contact, e.last_contact, e.place
FROM scene s JOIN live_event e USING (scene_id);

COMMENT ON VIEW live_events IS
'History of alarms, one row when one begins and one when it ends; kept as long as conflict_events. Also an outbox to '
'poll: WHERE event > the last one read.';
COMMENT ON COLUMN live_events.scene IS 'Name of the scene.';
COMMENT ON COLUMN live_events.event IS 'Id. Events become visible in order of their ids; ids may be skipped.';
COMMENT ON COLUMN live_events.kind IS 'begun or ended.';
COMMENT ON COLUMN live_events.at IS 'When a worker found it.';
COMMENT ON COLUMN live_events.alarm_id IS 'Number of the alarm, as in live_conflicts.';
COMMENT ON COLUMN live_events.key IS 'Key of a track.';
COMMENT ON COLUMN live_events.other_key IS 'Key of the other one; null: whatever is near.';
COMMENT ON COLUMN live_events.verdict IS 'must, may or now, at that time.';
COMMENT ON COLUMN live_events.reason IS 'Why nothing better was known; null: it was.';
COMMENT ON COLUMN live_events.first_contact IS 'When, as it was known; null: unknown.';
COMMENT ON COLUMN live_events.last_contact IS 'When it would be over; null: unknown.';
COMMENT ON COLUMN live_events.place IS 'Where; null: unknown.';
COMMENT ON TABLE live_event IS 'Alarms that began and ended; the view live_events shows them.';
COMMENT ON COLUMN live_event.live_event_id IS 'Id.';
COMMENT ON COLUMN live_event.scene_id IS 'Scene.';
COMMENT ON COLUMN live_event.kind IS 'begun or ended.';
COMMENT ON COLUMN live_event.at IS 'When.';
COMMENT ON COLUMN live_event.alarm_id IS 'Number of the alarm.';
COMMENT ON COLUMN live_event.key IS 'Key of a track.';
COMMENT ON COLUMN live_event.other_key IS 'Key of the other one; empty: whatever is near.';
COMMENT ON COLUMN live_event.verdict IS 'now, must or may.';
COMMENT ON COLUMN live_event.reason IS 'Why nothing better was known; null: it was.';
COMMENT ON COLUMN live_event.first_contact IS 'When; null: unknown.';
COMMENT ON COLUMN live_event.last_contact IS 'When it would be over; null: unknown.';
COMMENT ON COLUMN live_event.place IS 'Where; null: unknown.';
COMMENT ON TABLE live_conflict IS 'Alarms; the view live_conflicts shows them.';
COMMENT ON COLUMN live_conflict.scene_id IS 'Scene.';
COMMENT ON COLUMN live_conflict.key IS 'Key of a track.';
COMMENT ON COLUMN live_conflict.other_key IS 'Key of the other one; empty: whatever is near.';
COMMENT ON COLUMN live_conflict.verdict IS 'now, must or may.';
COMMENT ON COLUMN live_conflict.reason IS 'Why nothing better is known; null: it is.';
COMMENT ON COLUMN live_conflict.first_contact IS 'When; null: unknown.';
COMMENT ON COLUMN live_conflict.last_contact IS 'When it is over; null: unknown.';
COMMENT ON COLUMN live_conflict.place IS 'Where; null: unknown.';
COMMENT ON COLUMN live_conflict.alarm_id IS 'Number.';
COMMENT ON COLUMN live_conflict.opened_at IS 'When the alarm began.';
COMMENT ON COLUMN live_conflict.acknowledged_by IS 'Who acknowledged it; null: nobody.';
COMMENT ON COLUMN live_conflict.acknowledged_at IS 'When; null: it is not.';
COMMENT ON COLUMN live_conflict.acknowledged_for IS 'Why; null: it is not.';
COMMENT ON COLUMN live_conflict.acknowledged_as IS 'The verdict then; null: it is not.';
COMMENT ON COLUMN live_conflict.as_of IS 'When the look was.';
COMMENT ON COLUMN live_state.slack_s IS 'Seconds until a conflict follows; null: none within what is stored.';
