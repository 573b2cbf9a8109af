-- Plans against what happens: the state of each track that has positions, as the last look of a worker found it.

CREATE OR REPLACE FUNCTION conflictdb_internal._live_states(
    p_scene_id bigint, p_keys text[], OUT key text, OUT state text, OUT instant_us bigint, OUT lon double precision,
    OUT lat double precision, OUT height_m double precision, OUT error_m double precision,
    OUT seen_from_s double precision, OUT seen_to_s double precision, OUT off_m double precision
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
BEGIN
    RETURN QUERY
        SELECT l.key, l.state, (extract(epoch FROM l.instant) * 1000000)::bigint, ST_X(l.place), ST_Y(l.place),
               l.height_m, l.error_m, l.seen_from_s, l.seen_to_s, l.off_m
        FROM live_state l WHERE l.scene_id = p_scene_id AND l.key = ANY (p_keys);
END
$$;
COMMENT ON FUNCTION _live_states(bigint, text[]) IS 'States of some keys of a scene, as the last look found them.';

CREATE OR REPLACE FUNCTION conflictdb_internal._silent_after_s() RETURNS double precision
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN extract(epoch FROM _interval_set('silent_after', '10 minutes', '7 days'));
END
$$;
COMMENT ON FUNCTION _silent_after_s() IS
'After how many seconds without a position a track is silent: the setting conflictdb.silent_after, else 10 minutes.';

CREATE OR REPLACE FUNCTION conflictdb_internal._unheard(
    p_now_us bigint, p_step_us bigint, OUT scene_id bigint, OUT key text, OUT track_id bigint, OUT version bigint
) RETURNS SETOF record
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    v_now timestamptz := to_timestamp(p_now_us / 1e6);
    v_heard_until timestamptz := v_now - make_interval(secs => _silent_after_s());
    v_step interval := p_step_us * interval '1 microsecond';
    v_scene_ids bigint[];
BEGIN
    IF NOT _may_look() THEN
        RETURN;
    END IF;
    v_scene_ids := ARRAY(SELECT _lock_looked_at());
    DELETE FROM live_state l
        WHERE l.scene_id = ANY (v_scene_ids)
          AND NOT EXISTS (SELECT FROM track t WHERE t.scene_id = l.scene_id AND t.key = l.key);
    RETURN QUERY
        SELECT l.scene_id, l.key, t.track_id, t.version
        FROM live_state l JOIN track t ON t.scene_id = l.scene_id AND t.key = l.key
        WHERE l.scene_id = ANY (v_scene_ids) AND l.state <> 'past its end' AND l.instant < v_heard_until
          AND NOT (l.state = 'silent'
                   AND ceil(extract(epoch FROM l.as_of - l.instant) / extract(epoch FROM v_step))
                       = ceil(extract(epoch FROM v_now - l.instant) / extract(epoch FROM v_step)));
END
$$;
COMMENT ON FUNCTION _unheard(bigint, bigint) IS
'Tracks under way that are silent at an instant (microseconds): without a position for a time. Without those whose '
'silence has begun no other step since the last look. Forgets the states of removed tracks. None while another session '
'looks.';

CREATE OR REPLACE FUNCTION conflictdb_internal._replanned(
    OUT scene_id bigint, OUT key text, OUT track_id bigint, OUT version bigint, OUT instant_us bigint,
    OUT lon double precision, OUT lat double precision, OUT height_m double precision, OUT error_m double precision
) RETURNS SETOF record
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    v_scene_ids bigint[];
BEGIN
    IF NOT _may_look() THEN
        RETURN;
    END IF;
    v_scene_ids := ARRAY(SELECT _lock_looked_at());
    RETURN QUERY
        SELECT l.scene_id, l.key, t.track_id, t.version, (extract(epoch FROM l.instant) * 1000000)::bigint,
               ST_X(l.place), ST_Y(l.place), l.height_m, l.error_m
        FROM live_state l JOIN track t ON t.scene_id = l.scene_id AND t.key = l.key
        WHERE l.scene_id = ANY (v_scene_ids) AND t.version <> l.version ORDER BY l.scene_id, l.instant;
END
$$;
COMMENT ON FUNCTION _replanned() IS
'The last positions of tracks that changed since their states were found, with the columns of _new_positions. None '
'while another session looks.';

CREATE OR REPLACE FUNCTION conflictdb_internal._put_live(
    p_scene_id bigint, p_as_of_us bigint, p_key text[], p_state text[], p_late_from_s double precision[],
    p_late_to_s double precision[], p_off_m double precision[], p_instant_us bigint[], p_lon double precision[],
    p_lat double precision[], p_height_m double precision[], p_error_m double precision[],
    p_seen_from_s double precision[], p_seen_to_s double precision[], p_version bigint[],
    p_fastest_mps double precision[]
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    INSERT INTO live_state AS l (scene_id, key, state, late_from_s, late_to_s, off_m, instant, place, height_m, error_m,
                                 seen_from_s, seen_to_s, as_of, version, fastest_mps)
        SELECT p_scene_id, u.key, u.state, u.late_from_s, u.late_to_s, u.off_m,
               timestamptz 'epoch' + u.instant_us * interval '1 microsecond',
               ST_SetSRID(ST_MakePoint(u.lon, u.lat), 4326), u.height_m, u.error_m, u.seen_from_s, u.seen_to_s,
               timestamptz 'epoch' + p_as_of_us * interval '1 microsecond', u.version, u.fastest_mps
        FROM unnest(p_key, p_state, p_late_from_s, p_late_to_s, p_off_m, p_instant_us, p_lon, p_lat, p_height_m,
                    p_error_m, p_seen_from_s, p_seen_to_s, p_version, p_fastest_mps)
             u (key, state, late_from_s, late_to_s, off_m, instant_us, lon, lat, height_m, error_m, seen_from_s,
                seen_to_s, version, fastest_mps)
        ON CONFLICT (scene_id, key) DO UPDATE
            SET state = excluded.state, late_from_s = excluded.late_from_s, late_to_s = excluded.late_to_s,
                off_m = excluded.off_m, instant = excluded.instant, place = excluded.place,
                height_m = excluded.height_m, error_m = excluded.error_m, seen_from_s = excluded.seen_from_s,
                seen_to_s = excluded.seen_to_s, as_of = excluded.as_of, version = excluded.version,
                fastest_mps = excluded.fastest_mps;
END
$$;
COMMENT ON FUNCTION _put_live(bigint, bigint, text[], text[], double precision[], double precision[],
                              double precision[], bigint[], double precision[], double precision[], double precision[],
                              double precision[], double precision[], double precision[], bigint[],
                              double precision[]) IS
'Stores states of tracks of a scene, one for each key, as a look found them.';

CREATE OR REPLACE FUNCTION conflictdb_internal._straying(
    p_scene_id bigint, OUT key text, OUT is_off boolean, OUT low_us bigint, OUT high_us bigint, OUT instant_us bigint,
    OUT lon double precision, OUT lat double precision, OUT height_m double precision, OUT error_m double precision,
    OUT fastest_mps double precision, OUT class text, OUT owner text
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET plan_cache_mode = force_generic_plan AS $$
#variable_conflict use_column
BEGIN
    RETURN QUERY
        SELECT l.key, l.state = 'off', round(l.late_from_s * 1e6)::bigint, round(l.late_to_s * 1e6)::bigint,
               (extract(epoch FROM l.instant) * 1000000)::bigint, ST_X(l.place), ST_Y(l.place), l.height_m, l.error_m,
               coalesce(l.fastest_mps, 0), t.class, t.owner
        FROM live_state l JOIN track t ON t.scene_id = l.scene_id AND t.key = l.key
        WHERE l.scene_id = p_scene_id AND l.state IN ('late', 'early', 'off', 'silent')
          AND (l.state = 'off' OR l.late_from_s IS NOT NULL);
END
$$;
COMMENT ON FUNCTION _straying(bigint) IS
'Tracks of a scene that do not keep their plans: those off with their last positions, and those late, early or silent '
'with their latenesses, microseconds.';

CREATE OR REPLACE VIEW live WITH (security_invoker = true) AS
SELECT s.name AS scene, l.key, l.state, l.late_from_s, l.late_to_s, l.off_m, l.instant, l.place, l.height_m, l.error_m,
       l.as_of, l.slack_s,
       (SELECT min(c.first_contact) FROM live_conflict c
        WHERE c.scene_id = l.scene_id AND l.key IN (c.key, c.other_key)) AS first_alarm
FROM scene s JOIN live_state l USING (scene_id);

COMMENT ON VIEW live IS
'Plans against what happens: each track with positions, and how it keeps its plan. Workers compare each new position '
'with its plan, and look every 10 seconds which tracks are silent.';
COMMENT ON COLUMN live.scene IS 'Name of the scene.';
COMMENT ON COLUMN live.key IS 'Key of the track.';
COMMENT ON COLUMN live.state IS
'on plan: its haven contains the position within a minute of now; late, early: at another time; off: at no time; '
'silent: no position for conflictdb.silent_after (10 minutes); past its end; not yet under way.';
COMMENT ON COLUMN live.late_from_s IS
'Least lateness at which the haven contains the position, seconds; negative: early. Null: unknown, as where it is off.';
COMMENT ON COLUMN live.late_to_s IS 'Greatest such lateness, seconds. While a track is silent, both grow apart.';
COMMENT ON COLUMN live.off_m IS
'How far the position, with its error, is from all places of the haven, metres on the map; null unless it is off.';
COMMENT ON COLUMN live.instant IS 'When the last position was taken.';
COMMENT ON COLUMN live.place IS 'Last position.';
COMMENT ON COLUMN live.height_m IS 'Height of the last position, metres; null: unknown.';
COMMENT ON COLUMN live.error_m IS 'How far off the last position may be, metres.';
COMMENT ON COLUMN live.as_of IS 'When a worker looked last.';
COMMENT ON COLUMN live.slack_s IS
'By how much its lateness may change before a conflict follows, seconds; 0: one follows (view live_conflicts). '
'Null: none within what is stored, or unknown.';
COMMENT ON COLUMN live.first_alarm IS 'First contact of the conflicts that follow; null: none, or unknown.';

CREATE OR REPLACE FUNCTION conflictdb_internal._live(
    p_scene text, OUT key text, OUT state text, OUT late_from_s double precision, OUT late_to_s double precision,
    OUT off_m double precision, OUT instant timestamptz, OUT lon_deg double precision, OUT lat_deg double precision,
    OUT height_m double precision, OUT error_m double precision, OUT as_of timestamptz, OUT slack_s double precision,
    OUT first_alarm timestamptz
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
#variable_conflict use_column
DECLARE
    c_worst CONSTANT text[] := ARRAY['off', 'silent', 'late', 'early', 'not yet under way', 'on plan', 'past its end'];
BEGIN
    PERFORM _scene_id(p_scene);
    RETURN QUERY
        SELECT l.key, l.state, l.late_from_s, l.late_to_s, l.off_m, l.instant, ST_X(l.place), ST_Y(l.place),
               l.height_m, l.error_m, l.as_of, l.slack_s, l.first_alarm
        FROM live l WHERE l.scene = p_scene
        ORDER BY l.first_alarm, array_position(c_worst, l.state),
                 greatest(abs(l.late_from_s), abs(l.late_to_s)) DESC, l.key;
END
$$;
COMMENT ON FUNCTION _live(text) IS
'The view live of a scene, tracks that do not keep their plans first; raises ZC010 for an unknown name.';

COMMENT ON TABLE live_state IS 'How tracks with positions keep their plans; the view live shows it.';
COMMENT ON COLUMN live_state.scene_id IS 'Scene.';
COMMENT ON COLUMN live_state.key IS 'Key of the track.';
COMMENT ON COLUMN live_state.state IS 'As in the view live.';
COMMENT ON COLUMN live_state.late_from_s IS 'Least lateness at as_of, seconds; null: unknown.';
COMMENT ON COLUMN live_state.late_to_s IS 'Greatest lateness at as_of, seconds; null: unknown.';
COMMENT ON COLUMN live_state.off_m IS 'Distance from all places of the haven, metres; null unless off.';
COMMENT ON COLUMN live_state.instant IS 'When the last position was taken.';
COMMENT ON COLUMN live_state.place IS 'Last position.';
COMMENT ON COLUMN live_state.height_m IS 'Its height; null: unknown.';
COMMENT ON COLUMN live_state.error_m IS 'Its error, metres.';
COMMENT ON COLUMN live_state.seen_from_s IS
'Least lateness at the last position that the haven contained; null: none yet.';
COMMENT ON COLUMN live_state.seen_to_s IS 'Greatest lateness there; null: none yet.';
COMMENT ON COLUMN live_state.version IS 'Version of the track that it was compared with.';
COMMENT ON COLUMN live_state.fastest_mps IS 'How fast the track may be, metres per second; null: unknown.';
COMMENT ON COLUMN live_state.as_of IS 'When the look was.';
