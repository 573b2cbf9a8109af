-- Positions of tracks, as feeds report them: checked when they are inserted, kept for a time, and read by looks of
-- workers, which compare them with plans (74_live.sql).

CREATE OR REPLACE FUNCTION conflictdb_internal._position_before() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    -- Before the index, which a longer one may not fit into.
    IF octet_length(NEW.key) > 1000 THEN
        FOUND := _raise('ZC011', 'position', 'key',
                        format('is not a track: it has %s bytes, and keys at most 1000', octet_length(NEW.key)),
                        'object_known');
    END IF;
    -- 0: unknown. The policy refuses it first: who may not see a scene does not learn whether it exists. A restore, and
    -- nobody else, gives the number.
    IF NEW.scene_id IS NULL THEN
        NEW.scene_id := coalesce((SELECT s.scene_id FROM scene s WHERE s.name = NEW.scene), 0);
    END IF;
    RETURN NEW;
END
$$;
COMMENT ON FUNCTION _position_before() IS
'Trigger: fills in the scene of a position, and refuses a key that is too long. Runs as its owner: trackers read no '
'scenes. Restricted to the row.';
CREATE OR REPLACE TRIGGER position_before BEFORE INSERT ON position
    FOR EACH ROW EXECUTE FUNCTION _position_before();
ALTER TABLE position ENABLE ALWAYS TRIGGER position_before;

CREATE OR REPLACE FUNCTION conflictdb_internal._lonlat(
    p_place geometry, OUT lon double precision, OUT lat double precision
)
-- Bound to PostGIS here, for functions that find no names of other schemas.
LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
    SELECT ST_X(p_place), ST_Y(p_place);
END;
COMMENT ON FUNCTION _lonlat(geometry) IS 'Longitude and latitude of a point, degrees.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_positions() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
DECLARE
    -- Clocks of feeds differ by less.
    c_ahead CONSTANT interval := '1 minute';
    -- Less exact, it says nothing about a plan.
    c_most_error_m CONSTANT double precision := 100000;
    c_most_m CONSTANT double precision := 1e7;
    v_bad record;
    v_who text;
BEGIN
    SELECT n.scene, n.key, n.instant, n.height_m, n.error_m, o.lon, o.lat,
           s.scene_id, s.parent_scene_id, s.motion, t.track_id
        INTO v_bad
        FROM new_rows n
        CROSS JOIN LATERAL _lonlat(n.place) o
        LEFT JOIN scene s ON s.scene_id = n.scene_id
        LEFT JOIN track t ON t.scene_id = n.scene_id AND t.key = n.key
        WHERE t.track_id IS NULL OR s.parent_scene_id IS NOT NULL
           OR NOT (n.instant >= '0001-01-01 00:00+00' AND n.instant <= now() + c_ahead)
           OR (abs(o.lon) <= 360 AND abs(o.lat) <= CASE s.motion WHEN 'rhumb' THEN 89 ELSE 90 END) IS NOT TRUE
           OR NOT (n.error_m >= 0 AND n.error_m <= c_most_error_m) OR NOT abs(n.height_m) <= c_most_m
        LIMIT 1;
    IF FOUND THEN
        v_who := format('position of %L', v_bad.key);
        IF v_bad.scene_id IS NULL THEN
            FOUND := _raise('ZC010', format('scene %L', v_bad.scene), 'name', 'is not in this database', 'scene_known');
        ELSIF v_bad.parent_scene_id IS NOT NULL THEN
            FOUND := _raise('ZC020', format('scene %L', v_bad.scene), 'name',
                            'is a branch, which has no positions: give them to its parent', 'scene_whole');
        ELSIF v_bad.track_id IS NULL THEN
            FOUND := _raise('ZC011', v_who, 'key', format('is not a track of scene %L', v_bad.scene), 'object_known',
                            'Put its plan first, or leave its positions out.');
        ELSIF NOT (v_bad.instant >= '0001-01-01 00:00+00' AND v_bad.instant <= now() + c_ahead) THEN
            FOUND := _raise('ZC003', v_who, 'instant',
                            format('must not be in the future, nor before the year 1; got %s', v_bad.instant),
                            'instant_not_ahead', 'Set the clock of the feed.');
        ELSIF NOT (v_bad.error_m >= 0 AND v_bad.error_m <= c_most_error_m) THEN
            FOUND := _raise('ZC005', v_who, 'error_m',
                            format('must be from 0 to %s m; got %s', c_most_error_m, v_bad.error_m), 'error_in_range');
        ELSIF NOT abs(v_bad.height_m) <= c_most_m THEN
            FOUND := _raise('ZC004', v_who, 'height_m', format('must be a finite number of metres; got %s',
                            v_bad.height_m), 'heights_finite');
        END IF;
        FOUND := _raise('ZC005', v_who, 'place',
                        format('must have a longitude within +-360 and a latitude within +-%s degrees; got %s, %s',
                               CASE v_bad.motion WHEN 'rhumb' THEN 89 ELSE 90 END, coalesce(v_bad.lon::text, 'none'),
                               coalesce(v_bad.lat::text, 'none')),
                        'place_in_range');
    END IF;
    PERFORM _wake_workers();
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_positions() IS
'Trigger: refuses positions of unknown tracks, in the future, or out of range, and wakes the workers. Runs as its '
'owner: trackers read no plans. Restricted to the new rows.';
CREATE OR REPLACE TRIGGER position_inserted AFTER INSERT ON position REFERENCING NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_positions();

CREATE OR REPLACE FUNCTION conflictdb_internal._insert_positions(
    p_scene text, p_key text[], p_instant_us bigint[], p_lon double precision[], p_lat double precision[]
) RETURNS void
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    INSERT INTO position (scene, key, instant, place)
        SELECT p_scene, u.key, timestamptz 'epoch' + u.instant_us * interval '1 microsecond',
               ST_SetSRID(ST_MakePoint(u.lon, u.lat), 4326)
        FROM unnest(p_key, p_instant_us, p_lon, p_lat) u (key, instant_us, lon, lat);
END
$$;
COMMENT ON FUNCTION _insert_positions(text, text[], bigint[], double precision[], double precision[]) IS
'Inserts positions of tracks of a scene: PostgreSQL refuses COPY into tables with row-level security.';

CREATE OR REPLACE FUNCTION conflictdb_internal._after_track_with_positions() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    IF EXISTS (SELECT FROM position) THEN
        -- Those that no look has seen are read after the states have got the new key.
        UPDATE position p
            SET key = r.key,
                transaction_id = CASE WHEN pg_visible_in_snapshot(p.transaction_id, l.seen) THEN p.transaction_id
                                      ELSE pg_current_xact_id() END
            FROM (SELECT o.scene_id, o.key AS former_key, n.key FROM old_rows o JOIN new_rows n USING (track_id)
                  WHERE o.key <> n.key) r
            LEFT JOIN position_look l ON true
            WHERE p.scene_id = r.scene_id AND p.key = r.former_key;
    END IF;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_track_with_positions() IS
'Trigger, once per statement: gives the positions of renamed tracks their new keys. Runs as its owner: nobody else '
'changes positions. Restricted to the rows that the statement changed.';
CREATE OR REPLACE TRIGGER track_with_positions_updated AFTER UPDATE ON track
    REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows
    FOR EACH STATEMENT EXECUTE FUNCTION _after_track_with_positions();

CREATE OR REPLACE FUNCTION conflictdb_internal._after_scene_with_positions() RETURNS trigger
LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path = conflictdb, conflictdb_internal, pg_temp AS $$
BEGIN
    -- What feeds insert meanwhile is pruned with its partition.
    DELETE FROM position p WHERE p.scene_id = OLD.scene_id;
    RETURN NULL;
END
$$;
COMMENT ON FUNCTION _after_scene_with_positions() IS
'Trigger: removes the positions of a removed scene. Runs as its owner: nobody else deletes positions. Restricted to '
'that scene.';
CREATE OR REPLACE TRIGGER scene_with_positions_removed AFTER DELETE ON scene
    FOR EACH ROW EXECUTE FUNCTION _after_scene_with_positions();

CREATE OR REPLACE FUNCTION conflictdb_internal._unknown_tracks(p_scene text, p_keys text[]) RETURNS SETOF text
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_scene_id bigint := _scene_id(p_scene);
BEGIN
    RETURN QUERY SELECT k FROM unnest(p_keys) k
        WHERE NOT EXISTS (SELECT FROM track t WHERE t.scene_id = v_scene_id AND t.key = k);
END
$$;
COMMENT ON FUNCTION _unknown_tracks(text, text[]) IS
'Keys that no track of a scene has; raises ZC010 for an unknown scene.';

CREATE OR REPLACE FUNCTION conflictdb_internal._interval_set(
    p_name text, p_default interval, p_most interval
) RETURNS interval
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_setting text := nullif(current_setting('conflictdb.' || p_name, true), '');
    v_given interval := p_default;
BEGIN
    IF v_setting IS NOT NULL THEN
        BEGIN
            v_given := v_setting;
        EXCEPTION WHEN data_exception THEN
            v_given := '-1 s';
        END;
        IF NOT v_given BETWEEN interval '1 s' AND p_most THEN
            -- Looks must not fail because of it.
            RAISE WARNING 'conflictdb.%: must be an interval from 1 second to %; got %; taken as %', p_name, p_most,
                          quote_literal(v_setting), p_default;
            v_given := p_default;
        END IF;
    END IF;
    RETURN v_given;
END
$$;
COMMENT ON FUNCTION _interval_set(text, interval, interval) IS
'A setting conflictdb.<name> of the database or role that is an interval; p_default if it is not set, or not from a '
'second to p_most.';

CREATE OR REPLACE FUNCTION conflictdb_internal._may_look() RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    -- Locking writes, and most databases have no positions.
    IF NOT EXISTS (SELECT FROM position) AND NOT EXISTS (SELECT FROM live_state)
       AND NOT EXISTS (SELECT FROM live_conflict) THEN
        RETURN false;
    END IF;
    -- A row, which only workers may lock: any role could hold an advisory lock, and stop all looks. A restored database
    -- may lack the row; it says that nothing was seen.
    INSERT INTO position_look (is_only, seen) VALUES (true, '1:1:') ON CONFLICT (is_only) DO NOTHING;
    PERFORM FROM position_look FOR UPDATE SKIP LOCKED;
    RETURN FOUND;
END
$$;
COMMENT ON FUNCTION _may_look() IS
'Whether there is something to look at, and the transaction may: from now to its end no other one may.';

CREATE OR REPLACE FUNCTION conflictdb_internal._lock_looked_at() RETURNS SETOF bigint
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN QUERY
        SELECT s.scene_id FROM scene s
        WHERE EXISTS (SELECT FROM live_state l WHERE l.scene_id = s.scene_id)
           OR EXISTS (SELECT FROM live_conflict c WHERE c.scene_id = s.scene_id)
        FOR KEY SHARE SKIP LOCKED;
END
$$;
COMMENT ON FUNCTION _lock_looked_at() IS
'Keeps the scenes that have states or alarms until the transaction ends, and returns their ids; without those that '
'another session removes or renames.';

CREATE OR REPLACE FUNCTION conflictdb_internal._renames_since(
    p_seen pg_snapshot, OUT edit_id bigint, OUT transaction_id xid8, OUT scene_id bigint, OUT keys text[],
    OUT former_keys text[]
) RETURNS SETOF record
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT SET plan_cache_mode = force_generic_plan AS $$
#variable_conflict use_column
BEGIN
    RETURN QUERY
        SELECT e.edit_id, e.transaction_id, e.scene_id, e.keys, e.former_keys FROM edit e
        WHERE e.action = 'rename' AND e.kind IN ('area', 'track')
          AND e.transaction_id >= pg_snapshot_xmin(p_seen) AND NOT pg_visible_in_snapshot(e.transaction_id, p_seen)
          -- A restored database may have later ones.
          AND e.transaction_id < pg_snapshot_xmax(pg_current_snapshot());
END
$$;
COMMENT ON FUNCTION _renames_since(pg_snapshot) IS
'Edits that gave objects other keys, of transactions that a snapshot does not contain.';

CREATE OR REPLACE FUNCTION conflictdb_internal._are_keys_stale() RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN EXISTS (SELECT FROM position_look l CROSS JOIN LATERAL _renames_since(coalesce(l.renamed, l.seen)) r);
END
$$;
COMMENT ON FUNCTION _are_keys_stale() IS
'Whether objects got other keys since the look of this transaction began, so that it should be done again.';

CREATE OR REPLACE FUNCTION conflictdb_internal._snapshot_of(p_xmax xid8, p_running xid8[]) RETURNS pg_snapshot
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_running xid8[] := ARRAY(SELECT DISTINCT x FROM unnest(p_running) x WHERE x < p_xmax ORDER BY x);
BEGIN
    RETURN format('%s:%s:%s', coalesce(v_running[1], p_xmax), p_xmax, array_to_string(v_running, ','))::pg_snapshot;
END
$$;
COMMENT ON FUNCTION _snapshot_of(xid8, xid8[]) IS
'Snapshot of all transactions before p_xmax but those in p_running.';

CREATE OR REPLACE FUNCTION conflictdb_internal._new_positions(
    p_most integer,
    OUT scene_id bigint, OUT key text, OUT track_id bigint, OUT version bigint, OUT instant_us bigint,
    OUT lon double precision, OUT lat double precision, OUT height_m double precision, OUT error_m double precision
) RETURNS SETOF record
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT SET plan_cache_mode = force_generic_plan
SET enable_seqscan = off SET enable_bitmapscan = off SET jit = off AS $$
#variable_conflict use_column
DECLARE
    v_look position_look;
    v_now pg_snapshot;
    v_from xid8;
    v_until xid8;
    -- Transactions that the last look saw running, and that have committed.
    v_late xid8[];
    v_waiting xid8[];
    v_large xid8;
    v_last position_look;
    v_one record;
    v_scene_id bigint;
    v_is_there boolean;
    v_is_renamed boolean := false;
BEGIN
    IF NOT _may_look() THEN
        RETURN;
    END IF;
    SELECT l.* INTO v_look FROM position_look l;
    v_now := pg_current_snapshot();
    -- The first look, and the first of a restored database, which counts its transactions from 1: it reads all
    -- positions again, which changes nothing. Those of later transactions than there are become those of the first:
    -- else no look would read them.
    IF v_look.transaction_id IS NULL AND pg_snapshot_xmax(v_look.seen) = '1'
       OR greatest(pg_snapshot_xmax(v_look.seen), v_look.transaction_id) > pg_snapshot_xmax(v_now) THEN
        v_look := (true, '1:1:', NULL, NULL, NULL, NULL, NULL, false);
        UPDATE position SET transaction_id = '1' WHERE transaction_id > pg_current_xact_id();
    ELSE
        -- Before positions that came under the new keys.
        v_is_renamed := _follow_renames(coalesce(v_look.renamed, v_look.seen), v_now);
    END IF;
    v_large := v_look.transaction_id;
    IF v_large IS NULL THEN
        v_from := pg_snapshot_xmax(v_look.seen);
        v_late := ARRAY(SELECT x FROM pg_snapshot_xip(v_look.seen) x WHERE pg_visible_in_snapshot(x, v_now));
        -- Reads at most p_most + 1 rows of each, without a sort: a look costs the same, however many wait.
        v_waiting := ARRAY(
            SELECT w.transaction_id
            FROM (SELECT o.transaction_id FROM unnest(v_late) x
                  CROSS JOIN LATERAL (SELECT p.transaction_id FROM position p WHERE p.transaction_id = x
                                      LIMIT p_most + 1) o
                  UNION ALL
                  (SELECT p.transaction_id FROM position p
                   WHERE p.transaction_id >= v_from AND pg_visible_in_snapshot(p.transaction_id, v_now)
                   ORDER BY p.transaction_id LIMIT p_most + 1)) w
            ORDER BY w.transaction_id LIMIT p_most + 1);
        v_until := coalesce(v_waiting[p_most + 1], pg_snapshot_xmax(v_now));
        IF cardinality(v_waiting) > p_most THEN
            v_look.is_behind := true;
            IF v_until = v_waiting[1] THEN
                v_large := v_until;
            END IF;
            v_look.seen := _snapshot_of(greatest(v_from, v_until), ARRAY(
                SELECT x FROM pg_snapshot_xip(v_look.seen) x WHERE x >= v_until OR NOT pg_visible_in_snapshot(x, v_now)
                UNION ALL SELECT pg_snapshot_xip(v_now)));
        ELSE
            -- While there are no positions, an older snapshot serves as well; but it must not become costly to compare
            -- with, nor must each look pass over the rows of a transaction that is running.
            IF cardinality(v_waiting) > 0 OR v_is_renamed OR v_look.is_behind OR EXISTS (SELECT pg_snapshot_xip(v_now))
               OR pg_snapshot_xmax(v_now)::text::numeric - v_from::text::numeric > 10000 THEN
                v_look.seen := v_now;
            END IF;
            v_look.is_behind := false;
        END IF;
    END IF;
    IF v_large IS NOT NULL THEN
        -- A transaction that is larger than a look: by scenes and instants.
        SELECT o.scene_id, o.instant, o.key INTO v_last.scene_id, v_last.instant, v_last.key
            FROM position o
            WHERE o.transaction_id = v_large
              AND (o.scene_id, o.instant, o.key)
                  > (coalesce(v_look.scene_id, 0), coalesce(v_look.instant, '-infinity'), coalesce(v_look.key, ''))
            ORDER BY o.scene_id, o.instant, o.key OFFSET p_most - 1 LIMIT 1;
        v_from := NULL;
        v_late := NULL;
    END IF;
    FOR v_one IN
        SELECT p.scene_id, p.key, t.track_id, t.version, p.instant, ST_X(p.place) AS lon, ST_Y(p.place) AS lat,
               p.height_m, p.error_m
        FROM (SELECT o.* FROM position o
              WHERE o.transaction_id >= v_from AND o.transaction_id < v_until
                AND pg_visible_in_snapshot(o.transaction_id, v_now)
              UNION ALL
              SELECT o.* FROM position o WHERE o.transaction_id = ANY (v_late) AND o.transaction_id < v_until
              UNION ALL
              SELECT o.* FROM position o
              WHERE o.transaction_id = v_large
                AND (o.scene_id, o.instant, o.key)
                    > (coalesce(v_look.scene_id, 0), coalesce(v_look.instant, '-infinity'), coalesce(v_look.key, ''))
                AND (o.scene_id, o.instant, o.key)
                    <= (coalesce(v_last.scene_id, 9223372036854775807), coalesce(v_last.instant, 'infinity'),
                        coalesce(v_last.key, '')) OFFSET 0) p
        JOIN scene s ON s.scene_id = p.scene_id
        JOIN track t ON t.scene_id = p.scene_id AND t.key = p.key
        ORDER BY p.scene_id, p.instant, p.key LOOP
        IF v_one.scene_id IS DISTINCT FROM v_scene_id THEN
            -- Whoever removes a scene locks it first, and then what the look writes.
            PERFORM FROM scene s WHERE s.scene_id = v_one.scene_id FOR KEY SHARE;
            v_is_there := FOUND;
            v_scene_id := v_one.scene_id;
        END IF;
        CONTINUE WHEN NOT v_is_there;
        scene_id := v_one.scene_id;
        key := v_one.key;
        track_id := v_one.track_id;
        version := v_one.version;
        instant_us := (extract(epoch FROM v_one.instant) * 1000000)::bigint;
        lon := v_one.lon;
        lat := v_one.lat;
        height_m := v_one.height_m;
        error_m := v_one.error_m;
        RETURN NEXT;
    END LOOP;
    IF v_large IS NULL THEN
        v_look.transaction_id := NULL;
    ELSIF v_last.scene_id IS NULL THEN
        v_look.seen := _snapshot_of(
            greatest(pg_snapshot_xmax(v_look.seen), (v_large::text::numeric + 1)::text::xid8),
            array_remove(ARRAY(SELECT pg_snapshot_xip(v_look.seen)), v_large));
        v_look.transaction_id := NULL;
        v_look.scene_id := NULL;
        v_look.instant := NULL;
        v_look.key := NULL;
    ELSE
        v_look.transaction_id := v_large;
        v_look.scene_id := v_last.scene_id;
        v_look.instant := v_last.instant;
        v_look.key := v_last.key;
    END IF;
    v_look.renamed := CASE WHEN v_look.is_behind THEN v_now END;
    UPDATE position_look l
        SET seen = v_look.seen, renamed = v_look.renamed, transaction_id = v_look.transaction_id,
            scene_id = v_look.scene_id, instant = v_look.instant, key = v_look.key, is_behind = v_look.is_behind
        WHERE v_look.is_behind OR (l.seen::text, l.is_behind) IS DISTINCT FROM (v_look.seen::text, v_look.is_behind);
END
$$;
COMMENT ON FUNCTION _new_positions(integer) IS
'Positions committed since the last look, at most p_most, in the order of scenes and instants, with the track that has '
'their key. If more wait, those of the earliest transactions, or a part of one; the next look reads the others. None '
'while another session looks. The transaction must end after what follows from them is stored.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_behind() RETURNS boolean
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN _may_look() AND (SELECT l.is_behind FROM position_look l);
END
$$;
COMMENT ON FUNCTION _is_behind() IS
'Whether positions may wait that the last look did not read; false while another session looks.';

CREATE OR REPLACE FUNCTION conflictdb_internal._is_old_slot(p_slot integer, p_until timestamptz) RETURNS boolean
LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    v_is_old boolean;
BEGIN
    EXECUTE format('SELECT EXISTS (SELECT FROM position_%1$s) '
                   'AND NOT EXISTS (SELECT FROM position_%1$s p CROSS JOIN position_look l '
                   'WHERE p.transaction_id >= pg_snapshot_xmin(l.seen) '
                   'AND NOT pg_visible_in_snapshot(p.transaction_id, l.seen)) '
                   'AND NOT EXISTS (SELECT FROM position_%1$s WHERE received_at > $1)', p_slot)
        INTO v_is_old USING p_until;
    RETURN v_is_old;
END
$$;
COMMENT ON FUNCTION _is_old_slot(integer, timestamptz) IS
'Whether a partition of positions has some, all received until an instant, and read by looks.';

CREATE OR REPLACE FUNCTION conflictdb_internal._prune_positions() RETURNS integer
LANGUAGE plpgsql VOLATILE SET search_path FROM CURRENT AS $$
DECLARE
    v_until timestamptz := clock_timestamp() - _interval_set('positions_kept', '24 hours', '72 hours');
    v_slot integer;
    v_emptied integer := 0;
BEGIN
    FOR v_slot IN 0..7 LOOP
        CONTINUE WHEN NOT _is_old_slot(v_slot, v_until);
        BEGIN
            -- A backup may read a partition for hours: looks must not wait for it.
            EXECUTE format('LOCK TABLE position_%s IN ACCESS EXCLUSIVE MODE NOWAIT', v_slot);
        EXCEPTION WHEN lock_not_available THEN
            CONTINUE;
        END;
        -- Its half day may have come round again just now.
        IF _is_old_slot(v_slot, v_until) THEN
            EXECUTE format('TRUNCATE position_%s', v_slot);
            v_emptied := v_emptied + 1;
        END IF;
    END LOOP;
    RETURN v_emptied;
END
$$;
COMMENT ON FUNCTION _prune_positions() IS
'Empties the partitions of positions that were all received longer ago than the setting conflictdb.positions_kept says '
'(24 hours), and read by looks; returns their number. One that a session reads or writes waits for the next time. '
'Workers do this every ten minutes.';

COMMENT ON TABLE position IS
'Positions of tracks, as feeds report them: insert or copy rows of scene, key, instant, place, and, each where known, '
'height_m and error_m. They are kept for a day (setting conflictdb.positions_kept); the view live has the last '
'position of each key.';
DO $$
DECLARE
    v_table text;
BEGIN
    FOREACH v_table IN ARRAY ARRAY['position', 'position_0', 'position_1', 'position_2', 'position_3', 'position_4',
                                   'position_5', 'position_6', 'position_7'] LOOP
        IF v_table <> 'position' THEN
            EXECUTE format('COMMENT ON TABLE %I IS ''Partition of position: half a day, used in turn.''', v_table);
        END IF;
        EXECUTE format('COMMENT ON COLUMN %I.scene IS ''Name of the scene, when the position came.''', v_table);
        EXECUTE format('COMMENT ON COLUMN %I.key IS ''Key of a track.''', v_table);
        EXECUTE format('COMMENT ON COLUMN %I.instant IS ''When the track was there.''', v_table);
        EXECUTE format('COMMENT ON COLUMN %I.place IS ''Where it was.''', v_table);
        EXECUTE format('COMMENT ON COLUMN %I.height_m IS ''At which height, as heights of plans; null: unknown.''',
                       v_table);
        EXECUTE format('COMMENT ON COLUMN %I.error_m IS ''How far off the place may be, metres.''', v_table);
        EXECUTE format('COMMENT ON COLUMN %I.scene_id IS ''Scene.''', v_table);
        EXECUTE format('COMMENT ON COLUMN %I.received_at IS ''When it came.''', v_table);
        EXECUTE format('COMMENT ON COLUMN %I.transaction_id IS ''Transaction that inserted it.''', v_table);
        EXECUTE format('COMMENT ON COLUMN %I.slot IS ''Partition.''', v_table);
    END LOOP;
END
$$;
COMMENT ON TABLE position_look IS 'What the last look at positions saw: one row.';
COMMENT ON COLUMN position_look.is_only IS 'True.';
COMMENT ON COLUMN position_look.seen IS 'Transactions whose positions were all seen.';
COMMENT ON COLUMN position_look.renamed IS 'Transactions whose renames looks have followed; null: as seen.';
COMMENT ON COLUMN position_look.transaction_id IS 'Transaction that looks read in parts; null: none.';
COMMENT ON COLUMN position_look.scene_id IS 'Scene of its last position that was seen; null as transaction_id.';
COMMENT ON COLUMN position_look.instant IS 'Instant of that position; null as transaction_id.';
COMMENT ON COLUMN position_look.key IS 'Key of that position; null as transaction_id.';
COMMENT ON COLUMN position_look.is_behind IS 'Whether more positions waited than the last look read.';
