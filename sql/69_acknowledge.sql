-- Acknowledgements: a user accepts a conflict as it is known. An acknowledgement ends when the conflict closes, when it
-- is withdrawn, or at its expiry. It does not hold while the conflict exceeds what was known (_has_grown). This is
-- evaluated on reading; growth writes nothing.

CREATE OR REPLACE FUNCTION conflictdb_internal._known_conflict(
    p_scene text, p_a_key text, p_b_key text
) RETURNS conflict
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
    v_conflict conflict;
BEGIN
    SELECT c.* INTO v_conflict FROM conflict c
        WHERE c.scene_id = v_scene_id AND c.verdict <> 'near'
          AND (c.a_key = p_a_key AND c.b_key = p_b_key OR c.a_key = p_b_key AND c.b_key = p_a_key);
    IF NOT FOUND THEN
        FOUND := _raise('ZC011', format('scene %L', p_scene), 'conflict',
                        format('between %s and %s is not known', quote_nullable(p_a_key), quote_nullable(p_b_key)),
                        'conflict_known', 'The view conflicts has those that are.');
    END IF;
    RETURN v_conflict;
END
$$;
COMMENT ON FUNCTION _known_conflict(text, text, text) IS
'Returns the conflict of two objects, in either order; raises ZC011 if there is none.';

-- Editors may insert and end acknowledgements, but not write what was known, nor in another's name: these columns are
-- not granted to them (90_grants.sql). Rows of a restored dump have all columns.
CREATE OR REPLACE FUNCTION conflictdb_internal._before_acknowledgement() RETURNS trigger
LANGUAGE plpgsql SET search_path FROM CURRENT AS $$
DECLARE
    v_who text := format('conflict of %L and %L', NEW.a_key, NEW.b_key);
    v_conflict conflict;
BEGIN
    IF TG_OP = 'UPDATE' THEN
        IF OLD.ended_at IS NOT NULL THEN
            FOUND := _raise('ZC013', v_who, 'ended_at', format('is ended since %s', OLD.ended_at),
                            'acknowledgement_ended_once');
        END IF;
        NEW.ended_at := now();
        NEW.ended_by := current_user;
    ELSIF NEW.periods IS NULL THEN
        -- Of this scene: an acknowledgement of another scene's conflict would block that of its own editors.
        SELECT c.* INTO v_conflict FROM conflict c
            WHERE c.scene_id = NEW.scene_id AND c.a_key = NEW.a_key AND c.b_key = NEW.b_key
                  AND c.conflict_id = NEW.conflict_id AND c.verdict <> 'near';
        IF NOT FOUND THEN
            FOUND := _raise('ZC011', v_who, 'conflict', 'is not known', 'conflict_known');
        END IF;
        NEW.periods := v_conflict.periods;
        NEW.verdict := v_conflict.verdict;
        NEW.time_error_s := v_conflict.time_error_s;
        NEW.closest_m := v_conflict.closest_m;
        NEW.closest_error_m := v_conflict.closest_error_m;
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_acknowledgement() IS
'Trigger: fills in the acknowledged conflict as it is known, and who ends an acknowledgement and when. Raises '
'ZC011 if the scene has no such conflict, ZC013 if the acknowledgement has ended.';

CREATE OR REPLACE TRIGGER acknowledgement_inserted BEFORE INSERT ON acknowledgement
    FOR EACH ROW EXECUTE FUNCTION conflictdb_internal._before_acknowledgement();
CREATE OR REPLACE TRIGGER acknowledgement_updated BEFORE UPDATE OF ended_at, ended_by ON acknowledgement
    FOR EACH ROW EXECUTE FUNCTION conflictdb_internal._before_acknowledgement();

CREATE OR REPLACE FUNCTION conflictdb_internal._notify_acknowledgement(
    p_scene text, p_conflict_id bigint, p_holds boolean
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    -- Any user may listen to notifications, so protected scenes are not named.
    PERFORM _notify('conflictdb_acknowledgement',
                    jsonb_build_object('scene', CASE WHEN NOT _is_protected() THEN p_scene END,
                                       'conflict', p_conflict_id, 'acknowledged', p_holds)::text);
END
$$;
COMMENT ON FUNCTION _notify_acknowledgement(text, bigint, boolean) IS
'Notifies channel conflictdb_acknowledgement of a new or ended acknowledgement; scene is null if scenes are protected.';

CREATE OR REPLACE FUNCTION conflictdb_internal._end_acknowledgement(p_conflict_id bigint) RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    UPDATE acknowledgement k SET ended_at = now() WHERE k.conflict_id = p_conflict_id AND k.ended_at IS NULL;
    RETURN FOUND;
END
$$;
COMMENT ON FUNCTION _end_acknowledgement(bigint) IS
'Ends the acknowledgement of a conflict; returns whether there was one.';

CREATE OR REPLACE FUNCTION conflictdb_internal._before_alarm_acknowledged() RETURNS trigger
LANGUAGE plpgsql SET search_path FROM CURRENT AS $$
DECLARE
    v_user text := current_user;
BEGIN
    IF num_nulls(NEW.acknowledged_by, NEW.acknowledged_for) > 0 THEN
        NEW.acknowledged_by := NULL;
        NEW.acknowledged_at := NULL;
        NEW.acknowledged_for := NULL;
        NEW.acknowledged_as := NULL;
    ELSE
        NEW.acknowledged_at := now();
        NEW.acknowledged_as := NEW.verdict;
        IF NEW.acknowledged_by <> v_user
           AND right(NEW.acknowledged_by, length(v_user) + 3) <> ' (' || v_user || ')' THEN
            NEW.acknowledged_by := v_user;
        END IF;
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _before_alarm_acknowledged() IS
'Trigger: fills in who acknowledges an alarm, with the name that is given, and when. Without a reason nobody does.';

-- Editors write in their own name only.
CREATE OR REPLACE TRIGGER live_conflict_updated
    BEFORE UPDATE OF acknowledged_by, acknowledged_at, acknowledged_for ON live_conflict
    FOR EACH ROW WHEN ((NEW.acknowledged_by, NEW.acknowledged_at, NEW.acknowledged_for)
                       IS DISTINCT FROM (OLD.acknowledged_by, OLD.acknowledged_at, OLD.acknowledged_for))
    EXECUTE FUNCTION conflictdb_internal._before_alarm_acknowledged();

CREATE OR REPLACE FUNCTION conflictdb_internal._acknowledge_alarm(
    p_scene_id bigint, p_a_key text, p_b_key text, p_reason text, p_by text
) RETURNS bigint
LANGUAGE plpgsql VOLATILE CALLED ON NULL INPUT SET search_path FROM CURRENT AS $$
DECLARE
    v_alarm_id bigint;
BEGIN
    UPDATE live_conflict c
        SET acknowledged_by = CASE WHEN p_reason IS NOT NULL THEN _acknowledger(current_user::text, p_by) END,
            acknowledged_at = CASE WHEN p_reason IS NOT NULL THEN now() END, acknowledged_for = p_reason
        WHERE c.scene_id = p_scene_id AND (c.key, c.other_key) IN ((p_a_key, p_b_key), (p_b_key, p_a_key))
          AND NOT EXISTS (SELECT FROM conflict k
                          WHERE k.scene_id = p_scene_id AND k.verdict <> 'near'
                            AND (k.a_key, k.b_key) IN ((p_a_key, p_b_key), (p_b_key, p_a_key)))
        RETURNING c.alarm_id INTO v_alarm_id;
    RETURN v_alarm_id;
END
$$;
COMMENT ON FUNCTION _acknowledge_alarm(bigint, text, text, text, text) IS
'Acknowledges the alarm of two objects that do not conflict as planned, without a reason withdraws that; returns its '
'number, null if there is none.';

CREATE OR REPLACE FUNCTION acknowledge(
    p_scene text, p_a_key text, p_b_key text, p_reason text, p_until timestamptz DEFAULT NULL, p_by text DEFAULT NULL
) RETURNS bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    c_longest CONSTANT integer := 10000;
    v_scene_id bigint := _scene_to_change(p_scene);
    v_conflict conflict;
    v_alarm_id bigint;
    v_who text := format('conflict of %L and %L', p_a_key, p_b_key);
BEGIN
    IF coalesce(btrim(p_reason), '') = '' OR octet_length(p_reason) > c_longest THEN
        FOUND := _raise('ZC009', v_who, 'reason', format('must be a text of 1 to %s bytes', c_longest),
                        'acknowledgement_reason_given');
    END IF;
    IF btrim(p_by) = '' OR octet_length(p_by) > 1000 THEN
        FOUND := _raise('ZC009', v_who, 'by', 'must be a text of 1 to 1000 bytes', 'acknowledgement_given_name_valid');
    END IF;
    IF p_until <= now() THEN
        FOUND := _raise('ZC003', v_who, 'until', format('must be later than now; got %s', p_until),
                        'acknowledgement_until_later');
    END IF;
    IF p_until IS NULL THEN
        v_alarm_id := _acknowledge_alarm(v_scene_id, p_a_key, p_b_key, p_reason, p_by);
        IF v_alarm_id IS NOT NULL THEN
            PERFORM _notify_acknowledgement(p_scene, v_alarm_id, true);
            RETURN v_alarm_id;
        END IF;
    END IF;
    v_conflict := _known_conflict(p_scene, p_a_key, p_b_key);
    -- A unique index allows one open row per conflict, so concurrent calls end each other's rows in turn.
    LOOP
        PERFORM _end_acknowledgement(v_conflict.conflict_id);
        INSERT INTO acknowledgement (scene_id, conflict_id, reason, until, a_key, b_key, given_name)
            VALUES (v_scene_id, v_conflict.conflict_id, p_reason, p_until, v_conflict.a_key, v_conflict.b_key, p_by)
            ON CONFLICT (conflict_id) WHERE ended_at IS NULL DO NOTHING;
        EXIT WHEN FOUND;
    END LOOP;
    PERFORM _notify_acknowledgement(p_scene, v_conflict.conflict_id, true);
    RETURN v_conflict.conflict_id;
END
$$;
COMMENT ON FUNCTION acknowledge(text, text, text, text, timestamptz, text) IS
'Acknowledges the conflict of two objects as it is known, with the current user, time, reason and expiry (null: valid '
'while the conflict lasts, and when it opens again with the same periods). p_by: a name shown '
'with the user, where several people share one. The '
'acknowledgement does not hold while the conflict exceeds what was known: times outside its periods, a worse verdict '
'(grazing, unresolved, conflict), or closer. '
'Replaces an earlier acknowledgement; returns conflict_id. Without a conflict, acknowledges the alarm of both (view '
'live_conflicts) until it gets worse, or ends, and returns alarm_id. Raises ZC011 if there is neither.';

CREATE OR REPLACE FUNCTION unacknowledge(p_scene text, p_a_key text, p_b_key text) RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_to_change(p_scene);
    v_conflict conflict;
    v_was boolean := (SELECT c.acknowledged_at IS NOT NULL FROM live_conflict c
                      WHERE c.scene_id = v_scene_id
                        AND (c.key, c.other_key) IN ((p_a_key, p_b_key), (p_b_key, p_a_key)));
    v_alarm_id bigint := _acknowledge_alarm(v_scene_id, p_a_key, p_b_key, NULL, NULL);
BEGIN
    IF v_alarm_id IS NOT NULL THEN
        IF v_was THEN
            PERFORM _notify_acknowledgement(p_scene, v_alarm_id, false);
        END IF;
        RETURN v_was;
    END IF;
    v_conflict := _known_conflict(p_scene, p_a_key, p_b_key);
    v_was := _end_acknowledgement(v_conflict.conflict_id);
    IF v_was THEN
        PERFORM _notify_acknowledgement(p_scene, v_conflict.conflict_id, false);
    END IF;
    RETURN v_was;
END
$$;
COMMENT ON FUNCTION unacknowledge(text, text, text) IS
'Withdraws the acknowledgement of a conflict, or of an alarm; returns whether there was one. Raises ZC011 if there is '
'neither.';

CREATE OR REPLACE FUNCTION conflictdb_internal._acknowledger(p_user text, p_given_name text) RETURNS text
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT coalesce(p_given_name || ' (' || p_user || ')', p_user);
END;
COMMENT ON FUNCTION _acknowledger(text, text) IS
'Who acknowledged: the given name with the database user in brackets, else the user.';

CREATE OR REPLACE FUNCTION conflictdb_internal._acknowledgements_ended(
    p_scene text, p_run_id bigint
) RETURNS TABLE (a_key text, b_key text, acknowledged_by text, reason text)
LANGUAGE sql STABLE
BEGIN ATOMIC
    SELECT k.a_key, k.b_key, _acknowledger(k.acknowledged_by, k.given_name), k.reason
    FROM conflict_event e
    JOIN acknowledgement k ON k.scene_id = e.scene_id AND k.conflict_id = e.conflict_id AND k.ended_at IS NULL
    WHERE e.scene_id = _scene_or_branch(p_scene) AND e.run_id = p_run_id AND e.kind = 'closed'
          AND e.at >= (SELECT r.started_at FROM run r WHERE r.run_id = p_run_id)
          AND coalesce(k.until > e.at, true)
    ORDER BY k.a_key, k.b_key;
END;
COMMENT ON FUNCTION _acknowledgements_ended(text, bigint) IS
'Acknowledgements that ended with the conflicts that a run closed.';

CREATE OR REPLACE VIEW acknowledgements WITH (security_invoker = true) AS
SELECT s.name AS scene, k.conflict_id, k.a_key, k.b_key,
       _acknowledger(k.acknowledged_by, k.given_name) AS acknowledged_by,
       k.acknowledged_at, k.reason, k.until,
       k.periods, k.verdict,
       CASE WHEN k.ended_at IS NOT NULL THEN 'ended' WHEN c.conflict_id IS NULL THEN 'closed'
            WHEN k.until <= now() THEN 'expired'
            WHEN _has_grown(c.periods, c.verdict, c.time_error_s, c.closest_m, c.closest_error_m, k.periods, k.verdict,
                            k.time_error_s, k.closest_m, k.closest_error_m, s.tolerance_m) THEN 'outgrown'
            ELSE 'holds' END AS state,
       k.ended_by, k.ended_at
FROM scene s JOIN acknowledgement k USING (scene_id)
LEFT JOIN conflict c ON c.scene_id = k.scene_id AND c.a_key = k.a_key AND c.b_key = k.b_key
                        AND c.conflict_id = k.conflict_id;

COMMENT ON VIEW acknowledgements IS 'Acknowledgements of conflicts and their state.';
COMMENT ON COLUMN acknowledgements.scene IS 'Name of the scene.';
COMMENT ON COLUMN acknowledgements.conflict_id IS 'Id of the conflict (see conflict_events).';
COMMENT ON COLUMN acknowledgements.a_key IS 'Key of the first object.';
COMMENT ON COLUMN acknowledgements.b_key IS 'Key of the second object.';
COMMENT ON COLUMN acknowledgements.acknowledged_by IS
'Database user who acknowledged it; in brackets after the name that was given, if any.';
COMMENT ON COLUMN acknowledgements.acknowledged_at IS 'When it was acknowledged.';
COMMENT ON COLUMN acknowledgements.reason IS 'Reason given by the user.';
COMMENT ON COLUMN acknowledgements.until IS 'Expiry; null: valid while the conflict lasts.';
COMMENT ON COLUMN acknowledgements.periods IS 'Acknowledged periods.';
COMMENT ON COLUMN acknowledgements.verdict IS 'Acknowledged verdict.';
COMMENT ON COLUMN acknowledgements.state IS
'holds; outgrown: the conflict has grown since; expired: past its expiry; closed: the conflict has closed; ended: '
'withdrawn or replaced.';
COMMENT ON COLUMN acknowledgements.ended_by IS 'User who withdrew or replaced it; null if nobody did.';
COMMENT ON COLUMN acknowledgements.ended_at IS 'When it was withdrawn or replaced; null if it was not.';
