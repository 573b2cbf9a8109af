-- Rough pieces: what the database knows of objects that no detection has cut yet, and of places that are asked about.
-- Each contains the pieces that a detection cuts, in place, time and height. So the rule of a pair (_pieces_may_meet)
-- and stage 2 miss nothing. Times and heights of areas without a schedule are exact.

CREATE OR REPLACE FUNCTION conflictdb_internal._rough_padding_m(
    p_out_m double precision, p_reach_m double precision, p_wanted_m double precision, p_plane text
) RETURNS double precision
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_spare CONSTANT double precision := 1.01;
    c_farthest CONSTANT double precision := radians(89);
    v_radius_m double precision := _radius_m(p_plane);
    v_reach double precision := c_spare * p_reach_m / v_radius_m;
    v_half double precision := p_wanted_m / v_radius_m / 2;
    v_out double precision := p_out_m / v_radius_m;
    v_far double precision := v_out;
    v_s double precision;
BEGIN
    IF p_plane NOT IN ('wgs84', 'sphere') THEN
        -- The scale grows outward: the outermost place moves most.
        v_far := atan(v_out) + v_reach + c_spare * v_half;
        RETURN CASE WHEN v_far < c_farthest THEN 1e-6 + v_radius_m * (tan(v_far) - v_out) ELSE 'infinity' END;
    END IF;
    IF v_reach > 0 THEN
        -- To the latitude, nearest to a pole, that the reach comes to.
        v_far := atan(sinh(v_out)) + v_reach;
        IF v_far >= c_farthest THEN
            RETURN 'infinity';
        END IF;
        v_far := asinh(tan(v_far));
    END IF;
    -- From there half of the wanted distance, with s as in span_m of the Mercator plane (conflictdb/earth/mercator.py).
    v_s := c_spare * sin(least(v_half, pi() / 2)) * cosh(v_far);
    RETURN 1e-6 + v_radius_m * (v_far - v_out + CASE WHEN v_s < 1 THEN v_s + (pi() / 2 - 1) * v_s ^ 3
                                                     ELSE pi() / 2 + (1.5 * pi() - 2) * ln(v_s) END);
END
$$;
COMMENT ON FUNCTION _rough_padding_m(double precision, double precision, double precision, text) IS
'By how much a rough piece reaches beyond a shape, metres of the plane: p_reach_m metres on the earth, and half of a '
'distance that two objects must keep, as pieces do; infinite near a pole, or near the end of a gnomonic plane. '
'p_out_m: how far the shape is from the equator, or from the centre of a gnomonic plane, at most.';

CREATE OR REPLACE FUNCTION conflictdb_internal._out_m(p_shape geometry, p_plane text) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    SELECT CASE WHEN p_plane IN ('wgs84', 'sphere') THEN greatest(abs(ST_YMin(p_shape)), abs(ST_YMax(p_shape)))
                ELSE ST_MaxDistance(ST_MakePoint(0, 0), p_shape) END;
END;
COMMENT ON FUNCTION _out_m(geometry, text) IS
'p_out_m of _rough_padding_m, of a shape in metres of the plane; null if it is empty. Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._wanted_m(p_scene_id bigint) RETURNS double precision
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    RETURN (SELECT s.tolerance_m + greatest(s.separation_m, (SELECT max(r.separation_m) FROM rule r
                                                             WHERE r.scene_id = p_scene_id))
            FROM scene s WHERE s.scene_id = p_scene_id);
END
$$;
COMMENT ON FUNCTION _wanted_m(bigint) IS
'Within which distance two objects of a scene may conflict: its tolerance, and the largest separation of any rule.';

CREATE OR REPLACE FUNCTION conflictdb_internal._half_vertical_m(p_scene_id bigint) RETURNS double precision
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    -- To the micrometre.
    RETURN (SELECT CASE WHEN v.apart_m > 0 THEN v.apart_m / 2 + 1e-6 ELSE 0 END
            FROM (SELECT greatest(s.vertical_separation_m, (SELECT max(r.vertical_m) FROM rule r
                                                            WHERE r.scene_id = p_scene_id)) AS apart_m
                  FROM scene s WHERE s.scene_id = p_scene_id) v);
END
$$;
COMMENT ON FUNCTION _half_vertical_m(bigint) IS
'By how much heights of rough pieces reach further: half of the largest vertical separation of any rule, metres.';

CREATE OR REPLACE FUNCTION conflictdb_internal._track_reach_m(p_track track) RETURNS double precision
LANGUAGE sql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- Corners of growing havens move at most 115 times as fast as sides (conflictdb.model.outlines.FASTEST_TIP).
    SELECT ST_MaxDistance(ST_MakePoint(0, 0), coalesce((p_track).outlines, (p_track).outline))
           + CASE WHEN (p_track).grow_mps <> 0
                  THEN 115 * (p_track).grow_mps
                       * (ST_M(ST_EndPoint((p_track).path)) - ST_M(ST_StartPoint((p_track).path))) ELSE 0 END;
END;
COMMENT ON FUNCTION _track_reach_m(track) IS
'How far the haven of a track without tolerances reaches from its path, metres, at most. Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._track_span(p_track track) RETURNS tstzrange
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    -- A second is more than instants of paths are rounded by. Pieces alone know how far voyages within tolerances, or
    -- of a schedule, differ in time.
    SELECT CASE WHEN num_nonnulls((p_track).tolerances, (p_track).schedule) > 0 THEN '(,)'
                ELSE tstzrange(
                    coalesce((p_track).departures[1], to_timestamp(ST_M(ST_StartPoint((p_track).path))))
                    - interval '1 s',
                    coalesce((p_track).departures[cardinality((p_track).departures)],
                             to_timestamp(ST_M(ST_StartPoint((p_track).path))))
                    + make_interval(secs => ST_M(ST_EndPoint((p_track).path))
                                            - ST_M(ST_StartPoint((p_track).path)) + 1),
                    '[]') END;
END;
COMMENT ON FUNCTION _track_span(track) IS 'A span that contains all voyages of a track. Inlined into expressions.';

CREATE OR REPLACE FUNCTION conflictdb_internal._uncut_hull(
    p_scene scene, p_place geometry, p_reach_m double precision, p_wanted_m double precision
) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE CALLED ON NULL INPUT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_everywhere CONSTANT double precision := 1e9;
    v_plane text := CASE p_scene.motion WHEN 'rhumb' THEN p_scene.earth ELSE 'gnomonic' END;
    v_radius_m double precision := _radius_m(v_plane);
    v_half_turn_m double precision := pi() * v_radius_m;
    v_oblate double precision := CASE v_plane WHEN 'wgs84' THEN 0.0818191908426 ELSE 0 END;
    v_west double precision := radians(ST_XMin(p_place));
    v_east double precision := radians(ST_XMax(p_place));
    v_south double precision := radians(ST_YMin(p_place));
    v_north double precision := radians(ST_YMax(p_place));
    v_lat double precision := (v_south + v_north) / 2;
    v_turn double precision := (v_west + v_east) / 2 - radians(p_scene.centre_lon);
    v_centre_lat double precision := radians(p_scene.centre_lat);
    v_out double precision;
    v_pad_m double precision;
    v_x_m double precision;
    v_y_m double precision;
BEGIN
    -- By formulas: PROJ prepares a projection about a centre at each call, which takes 100 times as long.
    IF v_plane = 'gnomonic' THEN
        -- All of it lies within a distance of the middle of its box: along a parallel, then along a meridian.
        v_out := sin(v_centre_lat) * sin(v_lat) + cos(v_centre_lat) * cos(v_lat) * cos(v_turn);
        IF v_out > 0.02 AND v_east - v_west < pi() THEN
            v_x_m := v_radius_m * cos(v_lat) * sin(v_turn) / v_out;
            v_y_m := v_radius_m * (cos(v_centre_lat) * sin(v_lat) - sin(v_centre_lat) * cos(v_lat) * cos(v_turn))
                     / v_out;
            v_pad_m := _rough_padding_m(
                sqrt(v_x_m ^ 2 + v_y_m ^ 2),
                p_reach_m + v_radius_m * ((v_east - v_west) * cos(v_lat) + (v_north - v_south)) / 2, p_wanted_m,
                v_plane);
            IF v_pad_m < 'infinity' THEN
                RETURN ST_MakeEnvelope(v_x_m - v_pad_m, v_y_m - v_pad_m, v_x_m + v_pad_m, v_y_m + v_pad_m, 0);
            END IF;
        END IF;
    ELSIF greatest(abs(v_south), abs(v_north)) < radians(89.9) THEN
        v_south := v_radius_m * (asinh(tan(v_south)) - v_oblate * atanh(v_oblate * sin(v_south)));
        v_north := v_radius_m * (asinh(tan(v_north)) - v_oblate * atanh(v_oblate * sin(v_north)));
        -- Rounded coordinates: a millimetre more.
        v_pad_m := _rough_padding_m(greatest(abs(v_south), abs(v_north)), p_reach_m, p_wanted_m, v_plane) + 0.001;
        IF v_pad_m < 'infinity' THEN
            v_west := v_radius_m * v_west - v_pad_m;
            v_east := v_radius_m * v_east + v_pad_m;
            v_x_m := 2 * v_half_turn_m * floor(v_west / v_half_turn_m / 2 + 0.5);
            -- Across longitude 180 it may be at any longitude: it needs no copy then. So may a path that takes the
            -- shorter way there.
            IF v_east - v_west >= v_half_turn_m OR v_east - v_x_m >= v_half_turn_m - 1 THEN
                v_west := -c_everywhere;
                v_east := c_everywhere;
                v_x_m := 0;
            END IF;
            RETURN ST_MakeEnvelope(v_west - v_x_m, v_south - v_pad_m, v_east - v_x_m, v_north + v_pad_m,
                                   _plane_srid(v_plane));
        END IF;
    END IF;
    RETURN ST_MakeEnvelope(-c_everywhere, -c_everywhere, c_everywhere, c_everywhere, _plane_srid(v_plane));
END
$$;
COMMENT ON FUNCTION _uncut_hull(scene, geometry, double precision, double precision) IS
'A box, metres of the plane, that contains the hulls of all pieces of a footprint or path (longitude and latitude, '
'degrees; null: anywhere), with a reach around it. p_wanted_m: as of _rough_padding_m.';

CREATE OR REPLACE FUNCTION conflictdb_internal._uncut_pieces(
    p_scene_id bigint, p_wanted_m double precision, p_with_schedules boolean, p_span tstzrange
) RETURNS SETOF piece
LANGUAGE sql STABLE CALLED ON NULL INPUT PARALLEL SAFE
BEGIN ATOMIC
    WITH scene AS MATERIALIZED (
        SELECT s AS row, _half_vertical_m(p_scene_id) AS half_m, s.intervals = 'closed' AS is_closed
        FROM scene s WHERE s.scene_id = p_scene_id
    ), uncut AS MATERIALIZED (
        SELECT c.object_kind, c.object_id FROM change c WHERE c.scene_id = p_scene_id AND NOT c.is_covered
        UNION
        SELECT 0::smallint, a.area_id FROM area a
        WHERE p_with_schedules AND a.scene_id = p_scene_id AND a.schedule IS NOT NULL
        UNION
        SELECT 1::smallint, t.track_id FROM track t
        WHERE p_with_schedules AND t.scene_id = p_scene_id AND t.schedule IS NOT NULL
    ), object AS (
        -- Only those that are there during p_span, as an index would tell: the rule of a pair comes after the box.
        SELECT 0::smallint AS kind, a.area_id AS id,
               ARRAY[
                   /* area pieces: NUMBER(a) */
                   _word_number(a.class), _word_number(a.owner)
                   /* end */
                   ] AS numbers,
               a.schedule IS NULL AS is_known,
               a.footprint::geometry AS place, 0::double precision AS reach_m,
               CASE WHEN a.schedule IS NULL THEN a.active_span ELSE '(,)' END AS span, a.floor_m, a.ceiling_m
        FROM uncut n JOIN area a ON a.area_id = n.object_id AND a.scene_id + 0 = p_scene_id
        WHERE n.object_kind = 0
          AND (a.schedule IS NOT NULL OR tstzrange(lower(a.active_span), upper(a.active_span), '[]') && p_span)
        UNION ALL
        SELECT 1::smallint, t.track_id,
               ARRAY[
                   /* track pieces: NUMBER(t) */
                   _word_number(t.class), _word_number(t.owner)
                   /* end */
                   ],
               num_nonnulls(t.tolerances, t.schedule) = 0,
               CASE WHEN t.tolerances IS NULL THEN t.path END, _track_reach_m(t), _track_span(t), t.floor_m,
               t.ceiling_m
        FROM uncut n JOIN track t ON t.track_id = n.object_id AND t.scene_id + 0 = p_scene_id
        WHERE n.object_kind = 1 AND _track_span(t) && p_span
    )
    SELECT p.*
    FROM scene s CROSS JOIN object o
    CROSS JOIN LATERAL _given_piece(
        NULL, o.kind, o.id, o.numbers, CASE WHEN o.is_known THEN 0 ELSE -1 END, 0,
        _uncut_hull(s.row, o.place, o.reach_m, p_wanted_m),
        CASE WHEN s.is_closed THEN tstzrange(lower(o.span), upper(o.span), '[]') ELSE o.span END,
        coalesce(o.floor_m, '-infinity') - s.half_m,
        coalesce(_ceiling_m(o.ceiling_m + s.half_m, s.is_closed), 'infinity')) p
    OFFSET 0;
END;
COMMENT ON FUNCTION _uncut_pieces(bigint, double precision, boolean, tstzrange) IS
'A rough piece of each object of a scene whose stored pieces do not show it during a span: of those that changed since '
'the last detection, and with p_with_schedules of those with a schedule, which may be there at any time. It is a box, '
'and contains all pieces. p_wanted_m: as of _rough_padding_m.';

CREATE OR REPLACE FUNCTION conflictdb_internal._leg(p_start geometry, p_end geometry) RETURNS geometry
LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    v_east_deg double precision := ST_X(p_end) - ST_X(p_start);
BEGIN
    -- The shorter way; of half a turn the place is not known.
    v_east_deg := v_east_deg - 360 * round(v_east_deg / 360);
    RETURN CASE WHEN abs(v_east_deg) < 179 THEN
        ST_SetSRID(ST_MakeLine(ST_MakePoint(ST_X(p_start), ST_Y(p_start)),
                               ST_MakePoint(ST_X(p_start) + v_east_deg, ST_Y(p_end))), 4326) END;
END
$$;
COMMENT ON FUNCTION _leg(geometry, geometry) IS
'The leg between two waypoints (longitude and latitude, degrees), straight in the plane, the shorter way around the '
'earth; null if that is not certain.';

CREATE OR REPLACE FUNCTION conflictdb_internal._rough_pieces_at(
    p_scene_id bigint, p_wanted_m double precision, p_kinds smallint[], p_ids bigint[], p_numbers bigint[],
    p_are_known boolean[], p_places geometry[], p_reaches_m double precision[], p_spans tstzmultirange[],
    p_floors_m double precision[], p_ceilings_m double precision[]
) RETURNS TABLE (rough piece, shape geometry, padding_m double precision)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    c_everywhere CONSTANT double precision := 1e9;
    v_plane text;
    v_turn_m double precision;
    v_is_closed boolean;
    v_half_m double precision := _half_vertical_m(p_scene_id);
BEGIN
    SELECT _plane(s.motion, s.earth, s.centre_lon, s.centre_lat),
           CASE s.motion WHEN 'rhumb' THEN 2 * pi() * _radius_m(s.earth) END, s.intervals = 'closed'
        INTO v_plane, v_turn_m, v_is_closed FROM scene s WHERE s.scene_id = p_scene_id;
    RETURN QUERY
        SELECT q, p.shape, p.padding_m
        FROM unnest(p_kinds, p_ids, p_are_known, p_reaches_m, p_spans, p_floors_m, p_ceilings_m,
                    _each_to_plane(ARRAY(SELECT coalesce(e.place, 'SRID=4326;POINT EMPTY')
                                         FROM unnest(p_places) WITH ORDINALITY e (place, n) ORDER BY e.n), v_plane))
             WITH ORDINALITY u (kind, id, is_known, reach_m, spans, floor_m, ceiling_m, shape, n)
        CROSS JOIN LATERAL (SELECT coalesce(_rough_padding_m(_out_m(u.shape, v_plane), u.reach_m, p_wanted_m, v_plane),
                                            'infinity') AS padding_m OFFSET 0) d
        CROSS JOIN LATERAL (
            -- With the west end at home, as pieces, and copies one turn west of those that reach +180 degrees.
            SELECT d.padding_m, turn, ST_Translate(u.shape, -(h.turns + turn) * v_turn_m, 0) AS shape
            FROM (SELECT floor((ST_XMin(u.shape) - d.padding_m) / v_turn_m + 0.5) AS turns
                  WHERE v_turn_m IS NOT NULL AND d.padding_m < 'infinity') h
            CROSS JOIN generate_series(
                0, floor((ST_XMax(u.shape) + d.padding_m + 1) / v_turn_m + 0.5 - h.turns)::integer) turn
            UNION ALL
            SELECT d.padding_m, 0, u.shape WHERE v_turn_m IS NULL AND d.padding_m < 'infinity'
            UNION ALL
            SELECT 0, 0, ST_MakeEnvelope(-c_everywhere, -c_everywhere, c_everywhere, c_everywhere,
                                         _plane_srid(v_plane)) WHERE d.padding_m = 'infinity') p
        CROSS JOIN LATERAL unnest(u.spans) s (span)
        CROSS JOIN LATERAL _given_piece(
            NULL, u.kind, u.id, _numbers_of(p_numbers, u.n),
            CASE WHEN u.is_known AND d.padding_m < 'infinity' THEN 0 ELSE -1 END, -p.turn,
            ST_Expand(p.shape, p.padding_m),
            CASE WHEN v_is_closed THEN tstzrange(lower(s.span), upper(s.span), '[]') ELSE s.span END,
            coalesce(u.floor_m, '-infinity') - v_half_m,
            coalesce(_ceiling_m(u.ceiling_m + v_half_m, v_is_closed), 'infinity')) q;
END
$$;
COMMENT ON FUNCTION _rough_pieces_at IS
'Rough pieces of places (longitude and latitude, degrees; null: anywhere) and all within a reach of them, for each '
'span. p_wanted_m: as of _rough_padding_m. rough: a row for _pieces_may_meet, with the box of the shape, in metres of '
'the plane, and the padding around it; part -1, as of pieces of objects that are not solved, unless p_are_known.';

CREATE OR REPLACE FUNCTION conflictdb_internal._rough_pieces(
    p_scene_id bigint, p_wanted_m double precision, p_area_ids bigint[], p_track_ids bigint[]
) RETURNS TABLE (rough piece, shape geometry, padding_m double precision)
LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
BEGIN
    -- One query each: most questions are about one kind.
    IF cardinality(p_area_ids) > 0 THEN
        RETURN QUERY
            SELECT r.*
            FROM (SELECT array_agg(0::smallint) AS kinds, array_agg(a.area_id) AS ids,
                         array_agg(ARRAY[
                             /* area pieces: NUMBER(a) */
                             _word_number(a.class), _word_number(a.owner)
                             /* end */
                             ]) AS numbers,
                         array_agg(a.schedule IS NULL) AS known, array_agg(a.footprint::geometry) AS places,
                         array_agg(0::double precision) AS reaches_m,
                         array_agg(CASE WHEN a.schedule IS NOT NULL THEN '{(,)}'
                                        ELSE coalesce(a.activations, tstzmultirange(a.active_span)) END) AS spans,
                         array_agg(a.floor_m) AS floors_m, array_agg(a.ceiling_m) AS ceilings_m
                  FROM unnest(p_area_ids) n JOIN area a ON a.area_id = n AND a.scene_id + 0 = p_scene_id) o
            CROSS JOIN LATERAL _rough_pieces_at(p_scene_id, p_wanted_m, o.kinds, o.ids, o.numbers, o.known, o.places,
                                                o.reaches_m, o.spans, o.floors_m, o.ceilings_m) r;
    END IF;
    IF cardinality(p_track_ids) > 0 THEN
        RETURN QUERY
            SELECT r.*
            FROM (SELECT array_agg(1::smallint) AS kinds, array_agg(t.track_id) AS ids,
                         array_agg(ARRAY[
                             /* track pieces: NUMBER(t) */
                             _word_number(t.class), _word_number(t.owner)
                             /* end */
                             ]) AS numbers,
                         array_agg(num_nonnulls(t.tolerances, t.schedule) = 0) AS known, array_agg(l.place) AS places,
                         array_agg(_track_reach_m(t)) AS reaches_m, array_agg(l.spans) AS spans,
                         array_agg(t.floor_m) AS floors_m, array_agg(t.ceiling_m) AS ceilings_m
                  FROM unnest(p_track_ids) n JOIN track t ON t.track_id = n AND t.scene_id + 0 = p_scene_id
                  CROSS JOIN LATERAL (
                      SELECT NULL::geometry AS place, '{(,)}'::tstzmultirange AS spans WHERE t.tolerances IS NOT NULL
                      UNION ALL
                      SELECT w.place,
                             CASE WHEN t.schedule IS NOT NULL THEN '{(,)}'
                                  WHEN t.departures IS NULL THEN tstzmultirange(
                                      tstzrange(to_timestamp(w.start_s - 1), to_timestamp(w.end_s + 1), '[]'))
                                  ELSE (SELECT range_agg(tstzrange(
                                                   v + make_interval(secs => w.start_s - w.first_s - 1),
                                                   v + make_interval(secs => w.end_s - w.first_s + 1), '[]'))
                                        FROM unnest(t.departures) v) END
                      FROM (SELECT ST_M(p.geom) AS start_s, lead(ST_M(p.geom)) OVER o AS end_s,
                                   first_value(ST_M(p.geom)) OVER o AS first_s,
                                   _leg(p.geom, lead(p.geom) OVER o) AS place
                            FROM ST_DumpPoints(t.path) p WINDOW o AS (ORDER BY p.path[1])) w
                      WHERE w.end_s IS NOT NULL AND t.tolerances IS NULL) l) o
            CROSS JOIN LATERAL _rough_pieces_at(p_scene_id, p_wanted_m, o.kinds, o.ids, o.numbers, o.known, o.places,
                                                o.reaches_m, o.spans, o.floors_m, o.ceilings_m) r;
    END IF;
END
$$;
COMMENT ON FUNCTION _rough_pieces(bigint, double precision, bigint[], bigint[]) IS
'Rough pieces (_rough_pieces_at) of objects of a scene, by id: one of each span of an area, one of each leg of a '
'track, which may be anywhere with tolerances, and at any time with a schedule.';
