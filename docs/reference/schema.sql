-- The schema conflictdb as a fresh install makes it, described from the catalog. Generated: do not edit.
-- CONFLICTDB_UPDATE_SNAPSHOT=1 ./run test tests/migration writes it anew.

SEQUENCE acknowledgement_acknowledgement_id_seq;

SEQUENCE area_area_id_seq;

SEQUENCE attached_change_attached_change_id_seq;

SEQUENCE attachment_attachment_id_seq;

SEQUENCE change_change_id_seq;

SEQUENCE conflict_event_conflict_event_id_seq;

SEQUENCE conflict_seq;

SEQUENCE edit_edit_id_seq;

SEQUENCE live_event_live_event_id_seq;

SEQUENCE piece_piece_id_seq;

SEQUENCE probe_request_probe_id_seq;

SEQUENCE proposal_proposal_id_seq;

SEQUENCE rule_rule_id_seq;

SEQUENCE run_run_id_seq;

SEQUENCE scene_scene_id_seq;

SEQUENCE track_track_id_seq;

SEQUENCE version_seq;

TABLE position (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE acknowledgement (
    acknowledgement_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    conflict_id bigint NOT NULL,
    acknowledged_by text NOT NULL DEFAULT CURRENT_USER,
    acknowledged_at timestamp with time zone NOT NULL DEFAULT now(),
    reason text NOT NULL,
    until timestamp with time zone,
    a_key text COLLATE C NOT NULL,
    b_key text COLLATE C NOT NULL,
    periods tstzmultirange NOT NULL,
    verdict text NOT NULL,
    time_error_s double precision NOT NULL,
    closest_m double precision,
    closest_error_m double precision,
    ended_by text,
    ended_at timestamp with time zone,
    given_name text
);

TABLE admission_lock (
    scene_id bigint NOT NULL,
    taken bigint NOT NULL
);

TABLE alembic_version (
    version_num character varying(32) NOT NULL
);

TABLE area (
    area_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    key text COLLATE C NOT NULL,
    name text,
    footprint geometry(MultiPolygon,4326) NOT NULL,
    active_span tstzrange NOT NULL DEFAULT tstzrange(NULL::timestamp with time zone, NULL::timestamp with time zone),
    floor_m double precision,
    ceiling_m double precision,
    properties jsonb NOT NULL DEFAULT '{}'::jsonb,
    version bigint NOT NULL,
    first_version bigint NOT NULL DEFAULT 0,
    class text,
    owner text,
    activations tstzmultirange,
    schedule jsonb,
    schedule_error text
);

TABLE attached_change (
    attached_change_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    attachment_id bigint NOT NULL,
    identities text[],
    changed_at timestamp with time zone NOT NULL DEFAULT now()
);

TABLE attached_object (
    attachment_id bigint NOT NULL,
    identity text COLLATE C NOT NULL,
    hash bigint,
    key text COLLATE C,
    object_id bigint,
    version bigint,
    reason text,
    is_taken boolean NOT NULL DEFAULT false,
    since timestamp with time zone NOT NULL DEFAULT now(),
    identity_json jsonb
);

TABLE attached_relation (
    attachment_id bigint NOT NULL,
    relation regclass NOT NULL,
    is_root boolean NOT NULL
);

TABLE attachment (
    attachment_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    object_kind smallint NOT NULL,
    table_schema text NOT NULL,
    table_name text NOT NULL,
    map jsonb NOT NULL,
    identity_columns text[] NOT NULL,
    has_triggers boolean NOT NULL,
    every interval NOT NULL,
    attached_at timestamp with time zone NOT NULL DEFAULT now(),
    compared_at timestamp with time zone,
    failed_at timestamp with time zone,
    error text,
    comparison_s double precision
);

TABLE branch_edit (
    scene_id bigint NOT NULL,
    key text COLLATE C NOT NULL,
    object_kind smallint,
    object_id bigint,
    version bigint
);

TABLE change (
    change_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    object_kind smallint NOT NULL,
    object_id bigint NOT NULL,
    version bigint NOT NULL,
    changed_at timestamp with time zone NOT NULL DEFAULT now(),
    is_covered boolean NOT NULL DEFAULT false,
    with_number bigint
);

TABLE conflict (
    scene_id bigint NOT NULL,
    run_id bigint NOT NULL,
    a_kind smallint NOT NULL,
    a_id bigint NOT NULL,
    a_version bigint NOT NULL,
    a_key text COLLATE C NOT NULL,
    b_kind smallint NOT NULL,
    b_id bigint NOT NULL,
    b_version bigint NOT NULL,
    b_key text COLLATE C NOT NULL,
    periods tstzmultirange NOT NULL,
    verdict text NOT NULL,
    region geometry(Geometry,4326),
    first_contact_point geometry(Point,4326),
    method text NOT NULL,
    time_error_s double precision NOT NULL,
    found_at timestamp with time zone NOT NULL,
    closest_at timestamp with time zone,
    closest_m double precision,
    closest_error_m double precision,
    closest_a_point geometry(Point,4326),
    closest_b_point geometry(Point,4326),
    digest bigint NOT NULL DEFAULT 0,
    conflict_id bigint NOT NULL,
    changed_at timestamp with time zone,
    told_periods tstzmultirange,
    lacking_s double precision,
    certainty text
);

TABLE conflict_event (
    conflict_event_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    run_id bigint NOT NULL,
    conflict_id bigint NOT NULL,
    kind text NOT NULL,
    at timestamp with time zone NOT NULL,
    opened_at timestamp with time zone NOT NULL,
    a_kind smallint NOT NULL,
    a_key text COLLATE C NOT NULL,
    b_kind smallint NOT NULL,
    b_key text COLLATE C NOT NULL,
    periods tstzmultirange NOT NULL,
    verdict text NOT NULL,
    time_error_s double precision NOT NULL,
    closest_at timestamp with time zone,
    closest_m double precision,
    closest_error_m double precision,
    proposal_id bigint
);

TABLE difference (
    scene_id bigint NOT NULL,
    track_id bigint NOT NULL,
    other_kind smallint NOT NULL,
    other_id bigint NOT NULL,
    forbidden_us int8multirange NOT NULL,
    proven_us int8multirange NOT NULL
);

TABLE edit (
    edit_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    edited_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    scene_id bigint NOT NULL,
    scene text,
    kind text NOT NULL,
    action text NOT NULL,
    keys text[] NOT NULL,
    former_keys text[],
    role text NOT NULL DEFAULT COALESCE(NULLIF(current_setting('role'::text), 'none'::text), (SESSION_USER)::text),
    login text NOT NULL DEFAULT SESSION_USER,
    pid integer NOT NULL DEFAULT pg_backend_pid(),
    application text NOT NULL DEFAULT current_setting('application_name'::text),
    client text DEFAULT host(inet_client_addr())
);

TABLE edit_seal (
    seal_id bigint NOT NULL,
    edit_ids int8multirange NOT NULL,
    edits bigint NOT NULL,
    digest bytea NOT NULL,
    sealed_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    given_id bigint NOT NULL,
    next_transaction xid8 NOT NULL,
    settled_id bigint NOT NULL
);

TABLE history (
    scene_id bigint NOT NULL,
    first_run_id bigint,
    pruned_at timestamp with time zone NOT NULL
);

TABLE live_conflict (
    scene_id bigint NOT NULL,
    key text COLLATE C NOT NULL,
    other_key text COLLATE C NOT NULL,
    verdict text NOT NULL,
    reason text,
    first_contact timestamp with time zone,
    last_contact timestamp with time zone,
    place geometry(Point,4326),
    alarm_id bigint NOT NULL,
    opened_at timestamp with time zone NOT NULL,
    acknowledged_by text,
    acknowledged_at timestamp with time zone,
    acknowledged_for text,
    as_of timestamp with time zone NOT NULL,
    acknowledged_as text
);

TABLE live_event (
    live_event_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    kind text NOT NULL,
    at timestamp with time zone NOT NULL,
    alarm_id bigint NOT NULL,
    key text COLLATE C NOT NULL,
    other_key text COLLATE C NOT NULL,
    verdict text NOT NULL,
    reason text,
    first_contact timestamp with time zone,
    last_contact timestamp with time zone,
    place geometry(Point,4326)
);

TABLE live_state (
    scene_id bigint NOT NULL,
    key text COLLATE C NOT NULL,
    state text NOT NULL,
    late_from_s double precision,
    late_to_s double precision,
    off_m double precision,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL,
    seen_from_s double precision,
    seen_to_s double precision,
    slack_s double precision,
    as_of timestamp with time zone NOT NULL,
    version bigint NOT NULL,
    fastest_mps double precision
);

TABLE object_key (
    scene_id bigint NOT NULL,
    key text COLLATE C NOT NULL,
    object_kind smallint NOT NULL
);

TABLE piece (
    piece_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    object_kind smallint NOT NULL,
    object_id bigint NOT NULL,
    version bigint NOT NULL,
    part integer NOT NULL,
    turn smallint NOT NULL,
    hull geometry(Polygon) NOT NULL,
    span tstzrange NOT NULL,
    floor_m double precision NOT NULL,
    ceiling_m double precision NOT NULL,
    shape geometry(Polygon),
    leg_start timestamp with time zone,
    leg_end timestamp with time zone,
    start_lon_deg double precision,
    start_lat_deg double precision,
    end_lon_deg double precision,
    end_lat_deg double precision,
    bearing_deg double precision,
    shape_to geometry(Polygon),
    pieces integer NOT NULL DEFAULT 1,
    parts integer[],
    hulls geometry(MultiPolygon),
    shapes geometry(MultiPolygon),
    cuts timestamp with time zone[],
    leg_times timestamp with time zone[],
    legs double precision[],
    climb double precision[],
    class_number bigint NOT NULL DEFAULT 0,
    owner_number bigint NOT NULL DEFAULT 0
);

TABLE position_0 (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE position_1 (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE position_2 (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE position_3 (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE position_4 (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE position_5 (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE position_6 (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE position_7 (
    scene text NOT NULL,
    key text COLLATE C NOT NULL,
    instant timestamp with time zone NOT NULL,
    place geometry(Point,4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamp with time zone NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT ((floor((EXTRACT(epoch FROM clock_timestamp()) / (43200)::numeric)))::bigint % (8)::bigint)
);

TABLE position_look (
    is_only boolean NOT NULL,
    seen pg_snapshot NOT NULL,
    renamed pg_snapshot,
    transaction_id xid8,
    scene_id bigint,
    instant timestamp with time zone,
    key text COLLATE C,
    is_behind boolean NOT NULL DEFAULT false
);

TABLE probe_reply (
    probe_id bigint NOT NULL,
    object_kind smallint NOT NULL,
    key text COLLATE C NOT NULL,
    verdict text NOT NULL,
    periods tstzmultirange NOT NULL,
    time_error_s double precision NOT NULL,
    first_contact_point geometry(Point,4326),
    closest_at timestamp with time zone,
    closest_m double precision,
    closest_error_m double precision,
    lacking_s double precision,
    certainty text,
    plan_key text COLLATE C NOT NULL,
    name text,
    closest_a_point geometry(Point,4326),
    closest_b_point geometry(Point,4326)
);

TABLE probe_request (
    probe_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    asked_by name NOT NULL DEFAULT CURRENT_USER,
    asked_at timestamp with time zone NOT NULL DEFAULT now(),
    answered_at timestamp with time zone,
    is_current boolean,
    error text,
    attempts smallint NOT NULL DEFAULT 0,
    plans json,
    kind text NOT NULL,
    options jsonb NOT NULL DEFAULT '{}'::jsonb,
    answer jsonb,
    attempted_at timestamp with time zone,
    bytes bigint NOT NULL DEFAULT 0
);

TABLE proposal (
    proposal_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    made_at timestamp with time zone NOT NULL DEFAULT now(),
    made_by text NOT NULL DEFAULT CURRENT_USER,
    goal text NOT NULL,
    objective_s double precision NOT NULL,
    bound_s double precision NOT NULL,
    is_least boolean NOT NULL,
    settings jsonb NOT NULL,
    last_version bigint NOT NULL,
    objects_hash bigint NOT NULL,
    applied_at timestamp with time zone,
    applied_by text,
    undone_at timestamp with time zone,
    undone_by text
);

TABLE proposal_left (
    proposal_id bigint NOT NULL,
    scene_id bigint NOT NULL,
    key text COLLATE C NOT NULL,
    blocked_by text[] NOT NULL
);

TABLE proposal_move (
    proposal_id bigint NOT NULL,
    scene_id bigint NOT NULL,
    track_id bigint,
    key text COLLATE C NOT NULL,
    version bigint NOT NULL,
    planned geometry(LineStringM,4326),
    path geometry(LineStringM,4326),
    delay_s double precision NOT NULL,
    speed double precision NOT NULL,
    clears text[] NOT NULL,
    passes jsonb NOT NULL,
    detour jsonb,
    explanation text NOT NULL,
    version_after bigint,
    area_id bigint,
    planned_footprint geometry(MultiPolygon,4326),
    footprint geometry(MultiPolygon,4326),
    planned_span tstzrange,
    planned_activations tstzmultirange,
    place jsonb
);

TABLE rule (
    rule_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    a_class text,
    b_class text,
    separation_m double precision,
    vertical_m double precision,
    time_s double precision,
    allowed boolean NOT NULL DEFAULT false,
    yields text
);

TABLE run (
    run_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    started_at timestamp with time zone NOT NULL,
    finished_at timestamp with time zone NOT NULL,
    method text NOT NULL,
    settings jsonb NOT NULL,
    objects bigint NOT NULL,
    candidate_pairs bigint,
    intersecting_pairs bigint,
    window_pairs bigint,
    solved_pairs bigint,
    conflicts bigint,
    unresolved bigint,
    opened bigint,
    changed bigint,
    closed bigint,
    pieces_s double precision,
    stage1_s double precision,
    stage2_s double precision,
    stage3_s double precision,
    stage4_s double precision,
    write_s double precision,
    error text
);

TABLE scene (
    scene_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    name text COLLATE C NOT NULL,
    motion text NOT NULL DEFAULT 'rhumb'::text,
    earth text NOT NULL DEFAULT 'wgs84'::text,
    method text NOT NULL DEFAULT 'exact'::text,
    tolerance_m double precision NOT NULL DEFAULT 1.0,
    separation_m double precision NOT NULL DEFAULT 0.0,
    nearest_m double precision NOT NULL DEFAULT 0.0,
    centre_lon double precision,
    centre_lat double precision,
    history_kept interval,
    owner name DEFAULT CURRENT_USER,
    vertical_separation_m double precision NOT NULL DEFAULT 0.0,
    time_separation_s double precision NOT NULL DEFAULT 0.0,
    delays_within_s double precision NOT NULL DEFAULT 0.0,
    intervals text NOT NULL DEFAULT 'half_open'::text,
    horizon_days double precision NOT NULL DEFAULT 366.0,
    expanded tstzrange,
    parent_scene_id bigint,
    vertical_datum text NOT NULL DEFAULT 'msl'::text,
    regions text NOT NULL DEFAULT 'on'::text
);

TABLE scene_lock (
    scene_id bigint NOT NULL,
    taken bigint NOT NULL DEFAULT 0
);

TABLE scene_share (
    scene_id bigint NOT NULL,
    role name NOT NULL,
    may_write boolean NOT NULL,
    shared_by name NOT NULL DEFAULT CURRENT_USER,
    shared_at timestamp with time zone NOT NULL DEFAULT now()
);

TABLE track (
    track_id bigint NOT NULL GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    key text COLLATE C NOT NULL,
    name text,
    path geometry(LineStringM,4326) NOT NULL,
    outline geometry(Polygon) NOT NULL,
    floor_m double precision,
    ceiling_m double precision,
    properties jsonb NOT NULL DEFAULT '{}'::jsonb,
    version bigint NOT NULL,
    grow_mps double precision NOT NULL DEFAULT 0,
    outlines geometry(MultiPolygon),
    floors_m double precision[],
    ceilings_m double precision[],
    first_version bigint NOT NULL DEFAULT 0,
    tolerances jsonb,
    class text,
    owner text,
    departures timestamp with time zone[],
    schedule jsonb,
    schedule_error text
);

TABLE upper_limit (
    name text NOT NULL,
    value double precision NOT NULL
);

TABLE worker_stamp (
    worker_id uuid NOT NULL,
    pid integer,
    seen_at timestamp with time zone NOT NULL
);

VIEW _accessible (
    scene_id bigint,
    may_write boolean,
    is_owner boolean
);

VIEW _attached_table (
    attachment_id bigint,
    name text
);

VIEW _layer (
    seen_by bigint,
    scene_id bigint
);

VIEW _my_role (
    role name
);

VIEW _object_row (
    scene_id bigint,
    object_kind smallint,
    object_id bigint,
    table text,
    identity_json jsonb
);

VIEW acknowledgements (
    scene text COLLATE C,
    conflict_id bigint,
    a_key text COLLATE C,
    b_key text COLLATE C,
    acknowledged_by text,
    acknowledged_at timestamp with time zone,
    reason text,
    until timestamp with time zone,
    periods tstzmultirange,
    verdict text,
    state text,
    ended_by text,
    ended_at timestamp with time zone
);

VIEW approaches (
    scene text COLLATE C,
    a_key text COLLATE C,
    a_kind text,
    b_key text COLLATE C,
    b_kind text,
    closest_at timestamp with time zone,
    closest_m double precision,
    closest_error_m double precision,
    a_point geometry(Point,4326),
    b_point geometry(Point,4326),
    verdict text,
    is_current boolean,
    run_id bigint,
    found_at timestamp with time zone,
    scene_is_current boolean,
    method text,
    time_error_s double precision,
    a_name text,
    b_name text
);

VIEW attachments (
    scene text COLLATE C,
    attachment_id bigint,
    kind text,
    table text,
    map jsonb,
    role name,
    has_triggers boolean,
    every interval,
    objects bigint,
    unmapped bigint,
    is_waiting boolean,
    compared_at timestamp with time zone,
    failed_at timestamp with time zone,
    error text,
    remark text
);

VIEW conflict_events (
    scene text COLLATE C,
    event bigint,
    kind text,
    at timestamp with time zone,
    run_id bigint,
    conflict_id bigint,
    a_key text COLLATE C,
    a_kind text,
    b_key text COLLATE C,
    b_kind text,
    periods tstzmultirange,
    verdict text,
    time_error_s double precision,
    closest_at timestamp with time zone,
    closest_m double precision,
    closest_error_m double precision,
    opened_at timestamp with time zone,
    closed_at timestamp with time zone,
    proposal_id bigint
);

VIEW conflicts (
    scene text COLLATE C,
    a_key text COLLATE C,
    a_kind text,
    b_key text COLLATE C,
    b_kind text,
    periods tstzmultirange,
    first_contact timestamp with time zone,
    last_contact timestamp with time zone,
    verdict text,
    region geometry(Geometry,4326),
    first_contact_point geometry(Point,4326),
    method text,
    time_error_s double precision,
    is_current boolean,
    run_id bigint,
    found_at timestamp with time zone,
    closest_at timestamp with time zone,
    closest_m double precision,
    closest_error_m double precision,
    closest_a_point geometry(Point,4326),
    closest_b_point geometry(Point,4326),
    scene_is_current boolean,
    conflict_id bigint,
    opened_at timestamp with time zone,
    changed_at timestamp with time zone,
    acknowledged_by text,
    acknowledged_at timestamp with time zone,
    acknowledged_for text,
    acknowledged_until timestamp with time zone,
    first_contact_lon_deg double precision,
    first_contact_lat_deg double precision,
    a_name text,
    b_name text,
    lacking_s double precision,
    certainty text,
    a_table text,
    a_row jsonb,
    b_table text,
    b_row jsonb
);

VIEW edits (
    edit bigint,
    at timestamp with time zone,
    scene text,
    kind text,
    action text,
    key text,
    former_key text,
    role text,
    login text,
    application text,
    client text,
    pid integer,
    transaction_id xid8
);

VIEW limits (
    name text,
    value double precision,
    default_value double precision,
    unit text,
    doc text
);

VIEW live (
    scene text COLLATE C,
    key text COLLATE C,
    state text,
    late_from_s double precision,
    late_to_s double precision,
    off_m double precision,
    instant timestamp with time zone,
    place geometry(Point,4326),
    height_m double precision,
    error_m double precision,
    as_of timestamp with time zone,
    slack_s double precision,
    first_alarm timestamp with time zone
);

VIEW live_conflicts (
    scene text COLLATE C,
    alarm_id bigint,
    key text COLLATE C,
    other_key text COLLATE C,
    verdict text,
    reason text,
    first_contact timestamp with time zone,
    last_contact timestamp with time zone,
    place geometry(Point,4326),
    opened_at timestamp with time zone,
    as_of timestamp with time zone,
    acknowledged_by text,
    acknowledged_at timestamp with time zone,
    acknowledged_for text
);

VIEW live_events (
    scene text COLLATE C,
    event bigint,
    kind text,
    at timestamp with time zone,
    alarm_id bigint,
    key text COLLATE C,
    other_key text COLLATE C,
    verdict text,
    reason text,
    first_contact timestamp with time zone,
    last_contact timestamp with time zone,
    place geometry(Point,4326)
);

VIEW map_areas (
    area_id bigint,
    scene text COLLATE C,
    key text COLLATE C,
    name text,
    floor_m double precision,
    ceiling_m double precision,
    starts_at timestamp with time zone,
    ends_at timestamp with time zone,
    footprint geometry(MultiPolygon,4326)
);

VIEW map_conflicts (
    period_id bigint,
    conflict_id bigint,
    scene text COLLATE C,
    a_key text COLLATE C,
    a_kind text,
    b_key text COLLATE C,
    b_kind text,
    verdict text,
    starts_at timestamp with time zone,
    ends_at timestamp with time zone,
    time_error_s double precision,
    region geometry(MultiPolygon,4326),
    first_contact_point geometry(Point,4326)
);

VIEW map_tracks (
    track_id bigint,
    scene text COLLATE C,
    key text COLLATE C,
    name text,
    floor_m double precision,
    ceiling_m double precision,
    starts_at timestamp with time zone,
    ends_at timestamp with time zone,
    path geometry(MultiLineString,4326)
);

VIEW proposals (
    scene text COLLATE C,
    proposal_id bigint,
    made_at timestamp with time zone,
    made_by text,
    state text,
    goal text,
    objective_s double precision,
    bound_s double precision,
    is_least boolean,
    moves jsonb,
    left_as_planned jsonb,
    applied_at timestamp with time zone,
    applied_by text,
    undone_at timestamp with time zone,
    undone_by text
);

VIEW queue (
    scene text COLLATE C,
    waiting_since timestamp with time zone,
    changes bigint,
    attached_changes bigint,
    worker_pid integer,
    worker text,
    worker_role text,
    worked_on_since timestamp with time zone,
    last_error text
);

VIEW rules (
    scene text COLLATE C,
    a_class text,
    b_class text,
    separation_m double precision,
    vertical_m double precision,
    time_s double precision,
    allowed boolean,
    yields text
);

VIEW scenes (
    scene text COLLATE C,
    motion text,
    earth text,
    centre_lon double precision,
    centre_lat double precision,
    method text,
    tolerance_m double precision,
    separation_m double precision,
    nearest_m double precision,
    objects bigint,
    pending bigint,
    last_run_id bigint,
    last_run_at timestamp with time zone,
    last_error text,
    is_current boolean,
    unmapped bigint,
    vertical_separation_m double precision,
    time_separation_s double precision,
    delays_within_s double precision,
    intervals text,
    horizon_days double precision,
    expanded_from timestamp with time zone,
    expanded_until timestamp with time zone,
    branch_of text COLLATE C,
    vertical_datum text,
    compared_at timestamp with time zone,
    regions text
);

VIEW shares (
    scene text COLLATE C,
    role name,
    access text,
    shared_by name,
    shared_at timestamp with time zone
);

VIEW unmapped (
    scene text COLLATE C,
    attachment_id bigint,
    table text,
    identity_columns text[],
    identity text COLLATE C,
    key text COLLATE C,
    reason text,
    since timestamp with time zone,
    is_kept boolean
);

CONSTRAINT acknowledgement_end_told ON acknowledgement: CHECK (((ended_at IS NULL) = (ended_by IS NULL)));
CONSTRAINT acknowledgement_given_name_valid ON acknowledgement: CHECK (((btrim(given_name) <> ''::text) AND (octet_length(given_name) <= 1000)));
CONSTRAINT acknowledgement_pkey ON acknowledgement: PRIMARY KEY (acknowledgement_id);
CONSTRAINT acknowledgement_reason_given ON acknowledgement: CHECK ((btrim(reason) <> ''::text));
CONSTRAINT acknowledgement_scene_fkey ON acknowledgement: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT admission_lock_pkey ON admission_lock: PRIMARY KEY (scene_id);
CONSTRAINT alembic_version_pkc ON alembic_version: PRIMARY KEY (version_num);
CONSTRAINT area_area_id_in_range ON area: CHECK (((area_id >= 1) AND (area_id <= '4611686018427387903'::bigint)));
CONSTRAINT area_ceiling_above_floor ON area: CHECK ((ceiling_m > floor_m));
CONSTRAINT area_heights_finite ON area: CHECK (((((floor_m > '-Infinity'::double precision) AND (floor_m < 'Infinity'::double precision)) IS NOT FALSE) AND (((ceiling_m > '-Infinity'::double precision) AND (ceiling_m < 'Infinity'::double precision)) IS NOT FALSE)));
CONSTRAINT area_key_unique ON area: UNIQUE (scene_id, key);
CONSTRAINT area_key_valid ON area: CHECK (((key <> ''::text) AND (octet_length(key) <= 1000)));
CONSTRAINT area_pkey ON area: PRIMARY KEY (area_id);
CONSTRAINT area_properties_object ON area: CHECK ((jsonb_typeof(properties) = 'object'::text));
CONSTRAINT area_scene_fkey ON area: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT area_span_not_empty ON area: CHECK ((NOT isempty(active_span)));
CONSTRAINT attached_change_pkey ON attached_change: PRIMARY KEY (attached_change_id);
CONSTRAINT attached_object_attachment_fkey ON attached_object: FOREIGN KEY (attachment_id) REFERENCES attachment(attachment_id) ON DELETE CASCADE;
CONSTRAINT attached_object_mapped_or_told ON attached_object: CHECK ((num_nonnulls(object_id, reason) > 0));
CONSTRAINT attached_object_pkey ON attached_object: PRIMARY KEY (attachment_id, identity);
CONSTRAINT attached_relation_attachment_fkey ON attached_relation: FOREIGN KEY (attachment_id) REFERENCES attachment(attachment_id) ON DELETE CASCADE;
CONSTRAINT attached_relation_pkey ON attached_relation: PRIMARY KEY (attachment_id, relation);
CONSTRAINT attachment_every_positive ON attachment: CHECK ((every >= '00:00:01'::interval));
CONSTRAINT attachment_failure_told ON attachment: CHECK (((failed_at IS NULL) = (error IS NULL)));
CONSTRAINT attachment_kind_known ON attachment: CHECK ((object_kind = ANY (ARRAY[0, 1])));
CONSTRAINT attachment_pkey ON attachment: PRIMARY KEY (attachment_id);
CONSTRAINT attachment_scene_fkey ON attachment: FOREIGN KEY (scene_id) REFERENCES scene(scene_id);
CONSTRAINT branch_edit_pkey ON branch_edit: PRIMARY KEY (scene_id, key);
CONSTRAINT branch_edit_scene_fkey ON branch_edit: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT change_kind_known ON change: CHECK ((object_kind = ANY (ARRAY[0, 1])));
CONSTRAINT change_object_id_in_range ON change: CHECK (((object_id >= 1) AND (object_id <= '4611686018427387903'::bigint)));
CONSTRAINT conflict_certainty_known ON conflict: CHECK ((certainty = ANY (ARRAY['must'::text, 'may'::text])));
CONSTRAINT conflict_closest_complete ON conflict: CHECK (((num_nulls(closest_m, closest_error_m, closest_a_point, closest_b_point) = ANY (ARRAY[0, 4])) AND ((closest_at IS NULL) OR (closest_m IS NOT NULL)) AND ((verdict <> 'near'::text) OR (closest_m IS NOT NULL))));
CONSTRAINT conflict_closest_positive ON conflict: CHECK (((closest_m >= (0)::double precision) AND (closest_error_m >= (0)::double precision)));
CONSTRAINT conflict_kinds_known ON conflict: CHECK (((a_kind = ANY (ARRAY[0, 1])) AND (b_kind = ANY (ARRAY[0, 1]))));
CONSTRAINT conflict_lacking_positive ON conflict: CHECK ((lacking_s >= (0)::double precision));
CONSTRAINT conflict_members_ordered ON conflict: CHECK (((a_kind < b_kind) OR ((a_kind = b_kind) AND (a_key < b_key))));
CONSTRAINT conflict_periods_unless_near ON conflict: CHECK ((isempty(periods) = (verdict = 'near'::text)));
CONSTRAINT conflict_pkey ON conflict: PRIMARY KEY (a_kind, a_id, b_kind, b_id, scene_id);
CONSTRAINT conflict_time_error_positive ON conflict: CHECK ((time_error_s >= (0)::double precision));
CONSTRAINT conflict_verdict_known ON conflict: CHECK ((verdict = ANY (ARRAY['conflict'::text, 'grazing'::text, 'unresolved'::text, 'near'::text])));
CONSTRAINT conflict_event_kind_known ON conflict_event: CHECK ((kind = ANY (ARRAY['opened'::text, 'changed'::text, 'closed'::text])));
CONSTRAINT conflict_event_pkey ON conflict_event: PRIMARY KEY (scene_id, conflict_event_id);
CONSTRAINT edit_pkey ON edit: PRIMARY KEY (edit_id);
CONSTRAINT edit_seal_pkey ON edit_seal: PRIMARY KEY (seal_id);
CONSTRAINT history_pkey ON history: PRIMARY KEY (scene_id);
CONSTRAINT history_scene_fkey ON history: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT live_conflict_contacts_ordered ON live_conflict: CHECK ((first_contact <= last_contact));
CONSTRAINT live_conflict_pkey ON live_conflict: PRIMARY KEY (scene_id, key, other_key);
CONSTRAINT live_conflict_scene_fkey ON live_conflict: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT live_conflict_verdict_known ON live_conflict: CHECK ((verdict = ANY (ARRAY['now'::text, 'must'::text, 'may'::text])));
CONSTRAINT live_event_kind_known ON live_event: CHECK ((kind = ANY (ARRAY['begun'::text, 'ended'::text])));
CONSTRAINT live_event_pkey ON live_event: PRIMARY KEY (live_event_id);
CONSTRAINT live_event_scene_fkey ON live_event: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT live_state_known ON live_state: CHECK ((state = ANY (ARRAY['on plan'::text, 'late'::text, 'early'::text, 'off'::text, 'silent'::text, 'past its end'::text, 'not yet under way'::text])));
CONSTRAINT live_state_late_ordered ON live_state: CHECK (((late_from_s <= late_to_s) AND (seen_from_s <= seen_to_s)));
CONSTRAINT live_state_pkey ON live_state: PRIMARY KEY (scene_id, key);
CONSTRAINT live_state_scene_fkey ON live_state: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT object_key_kind_known ON object_key: CHECK ((object_kind = ANY (ARRAY[0, 1])));
CONSTRAINT object_key_pkey ON object_key: PRIMARY KEY (scene_id, key);
CONSTRAINT object_key_scene_fkey ON object_key: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT piece_bundle_complete ON piece: CHECK (
CASE
    WHEN (pieces = 1) THEN ((shape IS NOT NULL) AND (num_nonnulls(parts, hulls, shapes, cuts, leg_times, legs) = 0))
    WHEN (object_kind = 0) THEN ((num_nonnulls(parts, hulls, shapes) = 3) AND (num_nonnulls(shape, shape_to, cuts, leg_times, legs) = 0))
    ELSE ((num_nonnulls(parts, hulls, shape, cuts, leg_times, legs) = 6) AND (num_nonnulls(shapes, shape_to) = 0))
END);
CONSTRAINT piece_ceiling_above_floor ON piece: CHECK ((ceiling_m > floor_m));
CONSTRAINT piece_kind_known ON piece: CHECK ((object_kind = ANY (ARRAY[0, 1])));
CONSTRAINT piece_motion_of_tracks ON piece: CHECK ((num_nulls(leg_start, leg_end, start_lon_deg, start_lat_deg, end_lon_deg, end_lat_deg, bearing_deg) =
CASE
    WHEN ((object_kind = 1) AND (pieces = 1)) THEN 0
    ELSE 7
END));
CONSTRAINT piece_pkey ON piece: PRIMARY KEY (piece_id);
CONSTRAINT piece_span_not_empty ON piece: CHECK ((NOT isempty(span)));
CONSTRAINT position_look_one ON position_look: CHECK (is_only);
CONSTRAINT position_look_parts ON position_look: CHECK ((num_nulls(transaction_id, scene_id, instant, key) = ANY (ARRAY[0, 4])));
CONSTRAINT position_look_pkey ON position_look: PRIMARY KEY (is_only);
CONSTRAINT probe_reply_kind_known ON probe_reply: CHECK ((object_kind = ANY (ARRAY[0, 1])));
CONSTRAINT probe_reply_pkey ON probe_reply: PRIMARY KEY (probe_id, plan_key, key);
CONSTRAINT probe_reply_request_fkey ON probe_reply: FOREIGN KEY (probe_id) REFERENCES probe_request(probe_id) ON DELETE CASCADE;
CONSTRAINT probe_request_kind_known ON probe_request: CHECK ((kind = ANY (ARRAY['probe'::text, 'delays'::text, 'admit'::text])));
CONSTRAINT probe_request_pkey ON probe_request: PRIMARY KEY (probe_id);
CONSTRAINT probe_request_plans_given ON probe_request: CHECK (((plans IS NULL) = (kind = 'delays'::text)));
CONSTRAINT proposal_goal_known ON proposal: CHECK ((goal = ANY (ARRAY['total'::text, 'largest'::text])));
CONSTRAINT proposal_of_scene ON proposal: UNIQUE (proposal_id, scene_id);
CONSTRAINT proposal_pkey ON proposal: PRIMARY KEY (proposal_id);
CONSTRAINT proposal_scene_fkey ON proposal: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT proposal_left_pkey ON proposal_left: PRIMARY KEY (proposal_id, key);
CONSTRAINT proposal_left_proposal_fkey ON proposal_left: FOREIGN KEY (proposal_id, scene_id) REFERENCES proposal(proposal_id, scene_id) ON DELETE CASCADE;
CONSTRAINT proposal_move_of_one ON proposal_move: CHECK (((num_nulls(track_id, planned, path) =
CASE
    WHEN (area_id IS NULL) THEN 0
    ELSE 3
END) AND (num_nonnulls(planned_footprint, footprint) =
CASE
    WHEN (area_id IS NULL) THEN 0
    ELSE 2
END)));
CONSTRAINT proposal_move_pkey ON proposal_move: PRIMARY KEY (proposal_id, key);
CONSTRAINT proposal_move_proposal_fkey ON proposal_move: FOREIGN KEY (proposal_id, scene_id) REFERENCES proposal(proposal_id, scene_id) ON DELETE CASCADE;
CONSTRAINT rule_pkey ON rule: PRIMARY KEY (rule_id);
CONSTRAINT rule_scene_fkey ON rule: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT rule_separation_on_earth ON rule: CHECK (((separation_m >= (0)::double precision) AND (separation_m <= (20000000)::double precision)));
CONSTRAINT rule_side ON rule: CHECK ((num_nonnulls(a_class, b_class) > 0));
CONSTRAINT rule_time_known ON rule: CHECK (((time_s >= (0)::double precision) AND (time_s <= (2592000)::double precision)));
CONSTRAINT rule_vertical_on_earth ON rule: CHECK (((vertical_m >= (0)::double precision) AND (vertical_m <= (20000000)::double precision)));
CONSTRAINT rule_yields_known ON rule: CHECK ((yields = ANY (ARRAY['a'::text, 'b'::text])));
CONSTRAINT run_failed_or_counted ON run: CHECK (((error IS NULL) = (conflicts IS NOT NULL)));
CONSTRAINT run_pkey ON run: PRIMARY KEY (run_id);
CONSTRAINT run_scene_fkey ON run: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT run_scene_unique ON run: UNIQUE (scene_id, run_id);
CONSTRAINT scene_centre_of_circles ON scene: CHECK (((motion = 'great_circle'::text) OR (num_nulls(centre_lon, centre_lat) = 2)));
CONSTRAINT scene_centre_on_earth ON scene: CHECK (((num_nulls(centre_lon, centre_lat) = ANY (ARRAY[0, 2])) AND ((((centre_lon >= ('-180'::integer)::double precision) AND (centre_lon <= (180)::double precision)) AND ((centre_lat >= ('-90'::integer)::double precision) AND (centre_lat <= (90)::double precision))) IS NOT FALSE)));
CONSTRAINT scene_circles_on_sphere ON scene: CHECK (((motion = 'rhumb'::text) OR (earth = 'sphere'::text)));
CONSTRAINT scene_delays_within_known ON scene: CHECK (((delays_within_s >= (0)::double precision) AND (delays_within_s <= (2592000)::double precision)));
CONSTRAINT scene_earth_known ON scene: CHECK ((earth = ANY (ARRAY['wgs84'::text, 'sphere'::text])));
CONSTRAINT scene_history_kept_positive ON scene: CHECK ((history_kept >= '00:00:00'::interval));
CONSTRAINT scene_holds_objects ON scene: TRIGGER DEFERRABLE INITIALLY DEFERRED;
CONSTRAINT scene_horizon_days_known ON scene: CHECK (((horizon_days >= (0)::double precision) AND (horizon_days <= (36525)::double precision)));
CONSTRAINT scene_intervals_known ON scene: CHECK ((intervals = ANY (ARRAY['half_open'::text, 'closed'::text])));
CONSTRAINT scene_method_known ON scene: CHECK ((method = ANY (ARRAY['screen'::text, 'exact'::text, 'nlp'::text])));
CONSTRAINT scene_motion_known ON scene: CHECK ((motion = ANY (ARRAY['rhumb'::text, 'great_circle'::text])));
CONSTRAINT scene_name_unique ON scene: UNIQUE (name);
CONSTRAINT scene_name_valid ON scene: CHECK (((btrim(name) <> ''::text) AND (octet_length(name) <= 1000)));
CONSTRAINT scene_nearest_finite ON scene: CHECK (((nearest_m >= (0)::double precision) AND (nearest_m < 'Infinity'::double precision)));
CONSTRAINT scene_pkey ON scene: PRIMARY KEY (scene_id);
CONSTRAINT scene_regions_known ON scene: CHECK ((regions = ANY (ARRAY['on'::text, 'off'::text])));
CONSTRAINT scene_scene_id_in_range ON scene: CHECK (((scene_id >= 1) AND (scene_id <= '4611686018427387903'::bigint)));
CONSTRAINT scene_separation_finite ON scene: CHECK (((separation_m >= (0)::double precision) AND (separation_m < 'Infinity'::double precision)));
CONSTRAINT scene_time_separation_known ON scene: CHECK (((time_separation_s >= (0)::double precision) AND (time_separation_s <= (2592000)::double precision)));
CONSTRAINT scene_time_separation_solved ON scene: CHECK (((time_separation_s = (0)::double precision) OR (method <> 'nlp'::text)));
CONSTRAINT scene_tolerance_finite ON scene: CHECK (((tolerance_m >= (0)::double precision) AND (tolerance_m < 'Infinity'::double precision)));
CONSTRAINT scene_vertical_datum_known ON scene: CHECK ((vertical_datum = ANY (ARRAY['msl'::text, 'wgs84'::text, 'flight_level'::text])));
CONSTRAINT scene_vertical_separation_finite ON scene: CHECK (((vertical_separation_m >= (0)::double precision) AND (vertical_separation_m < 'Infinity'::double precision)));
CONSTRAINT scene_lock_pkey ON scene_lock: PRIMARY KEY (scene_id);
CONSTRAINT scene_share_pkey ON scene_share: PRIMARY KEY (scene_id, role);
CONSTRAINT scene_share_scene_fkey ON scene_share: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT track_ceiling_above_floor ON track: CHECK ((ceiling_m > floor_m));
CONSTRAINT track_growth_given_once ON track: CHECK (((grow_mps = (0)::double precision) OR (outlines IS NULL)));
CONSTRAINT track_growth_in_range ON track: CHECK (((grow_mps >= (0)::double precision) AND (grow_mps <= ('1000000'::numeric)::double precision)));
CONSTRAINT track_heights_finite ON track: CHECK (((((floor_m > '-Infinity'::double precision) AND (floor_m < 'Infinity'::double precision)) IS NOT FALSE) AND (((ceiling_m > '-Infinity'::double precision) AND (ceiling_m < 'Infinity'::double precision)) IS NOT FALSE)));
CONSTRAINT track_heights_in_a_row ON track: CHECK (((array_ndims(floors_m) = 1) AND (array_ndims(ceilings_m) = 1)));
CONSTRAINT track_key_unique ON track: UNIQUE (scene_id, key);
CONSTRAINT track_key_valid ON track: CHECK (((key <> ''::text) AND (octet_length(key) <= 1000)));
CONSTRAINT track_pkey ON track: PRIMARY KEY (track_id);
CONSTRAINT track_properties_object ON track: CHECK ((jsonb_typeof(properties) = 'object'::text));
CONSTRAINT track_scene_fkey ON track: FOREIGN KEY (scene_id) REFERENCES scene(scene_id) ON DELETE CASCADE;
CONSTRAINT track_track_id_in_range ON track: CHECK (((track_id >= 1) AND (track_id <= '4611686018427387903'::bigint)));
CONSTRAINT upper_limit_pkey ON upper_limit: PRIMARY KEY (name);
CONSTRAINT upper_limit_positive ON upper_limit: CHECK (((value >= (0)::double precision) AND (value <= 'Infinity'::double precision)));
CONSTRAINT worker_stamp_pkey ON worker_stamp: PRIMARY KEY (worker_id);

CREATE UNIQUE INDEX acknowledgement_conflict_id_btree ON conflictdb.acknowledgement USING btree (conflict_id) WHERE (ended_at IS NULL);
CREATE INDEX acknowledgement_scene_id_btree ON conflictdb.acknowledgement USING btree (scene_id);
CREATE INDEX area_scene_id_owner_btree ON conflictdb.area USING btree (scene_id, owner) WHERE (owner IS NOT NULL);
CREATE INDEX area_scene_id_scheduled_btree ON conflictdb.area USING btree (scene_id) WHERE (schedule IS NOT NULL);
CREATE INDEX attached_object_object_btree ON conflictdb.attached_object USING btree (attachment_id, object_id);
CREATE INDEX attached_object_reason_btree ON conflictdb.attached_object USING btree (attachment_id) WHERE (reason IS NOT NULL);
CREATE UNIQUE INDEX attached_relation_root_btree ON conflictdb.attached_relation USING btree (attachment_id) WHERE is_root;
CREATE INDEX attachment_scene_id_btree ON conflictdb.attachment USING btree (scene_id);
CREATE INDEX change_scene_id_object_btree ON conflictdb.change USING btree (scene_id, object_kind, object_id);
CREATE INDEX conflict_b_btree ON conflictdb.conflict USING btree (b_kind, b_id);
CREATE INDEX conflict_conflict_id_btree ON conflictdb.conflict USING btree (conflict_id) WHERE (verdict <> 'near'::text);
CREATE INDEX conflict_event_at_scene_id_btree ON conflictdb.conflict_event USING btree (at, scene_id);
CREATE INDEX conflict_placeless_btree ON conflictdb.conflict USING btree (scene_id) WHERE ((verdict <> 'near'::text) AND (region IS NULL));
CREATE INDEX conflict_region_spgist ON conflictdb.conflict USING spgist (region) WHERE ((verdict <> 'near'::text) AND (region IS NOT NULL));
CREATE INDEX conflict_scene_id_a_key_btree ON conflictdb.conflict USING btree (scene_id, a_key);
CREATE INDEX conflict_scene_id_b_key_btree ON conflictdb.conflict USING btree (scene_id, b_key);
CREATE INDEX difference_other_btree ON conflictdb.difference USING btree (other_kind, other_id);
CREATE INDEX difference_scene_id_track_btree ON conflictdb.difference USING btree (scene_id, track_id);
CREATE INDEX edit_renames_btree ON conflictdb.edit USING btree (transaction_id) WHERE (action = 'rename'::text);
CREATE INDEX edit_scene_btree ON conflictdb.edit USING btree (scene_id, edit_id);
CREATE INDEX live_conflict_other_btree ON conflictdb.live_conflict USING btree (scene_id, other_key);
CREATE INDEX live_event_scene_id_btree ON conflictdb.live_event USING btree (scene_id, live_event_id);
CREATE INDEX live_state_straying_btree ON conflictdb.live_state USING btree (scene_id) WHERE (state = ANY (ARRAY['late'::text, 'early'::text, 'off'::text, 'silent'::text]));
CREATE INDEX piece_object_btree ON conflictdb.piece USING btree (object_kind, object_id);
CREATE INDEX piece_scene_id_hull_span_gist ON conflictdb.piece USING gist (scene_id, hull, span);
CREATE INDEX position_0_scene_id_key_instant_idx ON conflictdb.position_0 USING btree (scene_id, key, instant);
CREATE INDEX position_0_transaction_id_scene_id_instant_key_idx ON conflictdb.position_0 USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX position_1_scene_id_key_instant_idx ON conflictdb.position_1 USING btree (scene_id, key, instant);
CREATE INDEX position_1_transaction_id_scene_id_instant_key_idx ON conflictdb.position_1 USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX position_2_scene_id_key_instant_idx ON conflictdb.position_2 USING btree (scene_id, key, instant);
CREATE INDEX position_2_transaction_id_scene_id_instant_key_idx ON conflictdb.position_2 USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX position_3_scene_id_key_instant_idx ON conflictdb.position_3 USING btree (scene_id, key, instant);
CREATE INDEX position_3_transaction_id_scene_id_instant_key_idx ON conflictdb.position_3 USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX position_4_scene_id_key_instant_idx ON conflictdb.position_4 USING btree (scene_id, key, instant);
CREATE INDEX position_4_transaction_id_scene_id_instant_key_idx ON conflictdb.position_4 USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX position_5_scene_id_key_instant_idx ON conflictdb.position_5 USING btree (scene_id, key, instant);
CREATE INDEX position_5_transaction_id_scene_id_instant_key_idx ON conflictdb.position_5 USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX position_6_scene_id_key_instant_idx ON conflictdb.position_6 USING btree (scene_id, key, instant);
CREATE INDEX position_6_transaction_id_scene_id_instant_key_idx ON conflictdb.position_6 USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX position_7_scene_id_key_instant_idx ON conflictdb.position_7 USING btree (scene_id, key, instant);
CREATE INDEX position_7_transaction_id_scene_id_instant_key_idx ON conflictdb.position_7 USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX position_scene_id_key_btree ON ONLY conflictdb."position" USING btree (scene_id, key, instant);
CREATE INDEX position_transaction_id_btree ON ONLY conflictdb."position" USING btree (transaction_id, scene_id, instant, key);
CREATE INDEX probe_request_scene_btree ON conflictdb.probe_request USING btree (scene_id, answered_at);
CREATE INDEX proposal_move_scene_id_btree ON conflictdb.proposal_move USING btree (scene_id);
CREATE INDEX proposal_scene_id_btree ON conflictdb.proposal USING btree (scene_id);
CREATE UNIQUE INDEX rule_sides_unique ON conflictdb.rule USING btree (scene_id, LEAST(COALESCE(a_class, ''::text), COALESCE(b_class, ''::text)), GREATEST(COALESCE(a_class, ''::text), COALESCE(b_class, ''::text)));
CREATE INDEX scene_parent_scene_id_btree ON conflictdb.scene USING btree (parent_scene_id) WHERE (parent_scene_id IS NOT NULL);
CREATE INDEX track_scene_id_owner_btree ON conflictdb.track USING btree (scene_id, owner) WHERE (owner IS NOT NULL);
CREATE INDEX track_scene_id_scheduled_btree ON conflictdb.track USING btree (scene_id) WHERE (schedule IS NOT NULL);

CREATE TRIGGER acknowledgement_inserted BEFORE INSERT ON conflictdb.acknowledgement FOR EACH ROW EXECUTE FUNCTION _before_acknowledgement();
CREATE TRIGGER acknowledgement_updated BEFORE UPDATE OF ended_at, ended_by ON conflictdb.acknowledgement FOR EACH ROW EXECUTE FUNCTION _before_acknowledgement();
CREATE TRIGGER area_before BEFORE INSERT OR UPDATE ON conflictdb.area FOR EACH ROW EXECUTE FUNCTION _area_before() -- always;
CREATE TRIGGER area_check_inserted AFTER INSERT ON conflictdb.area REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _areas_inserted();
CREATE TRIGGER area_deleted AFTER DELETE ON conflictdb.area REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change('0', 'area_id');
CREATE TRIGGER area_edits_deleted AFTER DELETE ON conflictdb.area REFERENCING OLD TABLE AS changed_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE TRIGGER area_edits_inserted AFTER INSERT ON conflictdb.area REFERENCING NEW TABLE AS changed_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE TRIGGER area_edits_updated AFTER UPDATE ON conflictdb.area REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE TRIGGER area_inserted AFTER INSERT ON conflictdb.area REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change('0', 'area_id');
CREATE TRIGGER area_not_truncated BEFORE TRUNCATE ON conflictdb.area FOR EACH STATEMENT EXECUTE FUNCTION _refuse_truncate() -- always;
CREATE TRIGGER area_replicated AFTER INSERT OR DELETE OR UPDATE ON conflictdb.area FOR EACH ROW EXECUTE FUNCTION _after_replicated_object('0', 'area_id') -- replicas;
CREATE TRIGGER area_updated AFTER UPDATE ON conflictdb.area REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change('0', 'area_id');
CREATE TRIGGER attached_change_deleted AFTER DELETE ON conflictdb.attached_change REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE TRIGGER attached_change_updated AFTER UPDATE ON conflictdb.attached_change REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE TRIGGER attached_object_deleted AFTER DELETE ON conflictdb.attached_object REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE TRIGGER attached_object_inserted AFTER INSERT ON conflictdb.attached_object REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE TRIGGER attached_object_updated AFTER UPDATE ON conflictdb.attached_object REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE TRIGGER attached_relation_deleted AFTER DELETE ON conflictdb.attached_relation REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE TRIGGER attached_relation_inserted AFTER INSERT ON conflictdb.attached_relation REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE TRIGGER attached_relation_updated AFTER UPDATE ON conflictdb.attached_relation REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_attached_written();
CREATE TRIGGER attachment_fixed BEFORE INSERT OR UPDATE ON conflictdb.attachment FOR EACH ROW EXECUTE FUNCTION _before_attachment() -- always;
CREATE TRIGGER attachment_removed AFTER DELETE ON conflictdb.attachment FOR EACH ROW EXECUTE FUNCTION _after_attachment_removal();
CREATE TRIGGER attachment_updated AFTER UPDATE ON conflictdb.attachment FOR EACH ROW WHEN (((new.identity_columns = '{}'::text[]) AND (old.identity_columns <> '{}'::text[]))) EXECUTE FUNCTION _after_attachment_opened();
CREATE TRIGGER branch_edit_before BEFORE INSERT ON conflictdb.branch_edit FOR EACH ROW EXECUTE FUNCTION _branch_edit_before() -- always;
CREATE TRIGGER branch_edit_edits_inserted AFTER INSERT ON conflictdb.branch_edit REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_branch_edits();
CREATE TRIGGER branch_edit_inserted AFTER INSERT ON conflictdb.branch_edit REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_branch_edit();
CREATE TRIGGER live_conflict_updated BEFORE UPDATE OF acknowledged_by, acknowledged_at, acknowledged_for ON conflictdb.live_conflict FOR EACH ROW WHEN ((((new.acknowledged_by IS DISTINCT FROM old.acknowledged_by) OR (new.acknowledged_at IS DISTINCT FROM old.acknowledged_at)) OR (new.acknowledged_for IS DISTINCT FROM old.acknowledged_for))) EXECUTE FUNCTION _before_alarm_acknowledged();
CREATE TRIGGER object_key_restored BEFORE INSERT ON conflictdb.object_key FOR EACH ROW WHEN ((pg_trigger_depth() = 0)) EXECUTE FUNCTION _keep_restored_key() -- always;
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb."position" FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER position_inserted AFTER INSERT ON conflictdb."position" REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_positions();
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb.position_0 FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb.position_1 FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb.position_2 FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb.position_3 FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb.position_4 FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb.position_5 FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb.position_6 FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER position_before BEFORE INSERT ON conflictdb.position_7 FOR EACH ROW EXECUTE FUNCTION _position_before() -- always;
CREATE TRIGGER probe_request_checked BEFORE INSERT ON conflictdb.probe_request FOR EACH ROW EXECUTE FUNCTION _before_probe_request() -- always;
CREATE TRIGGER proposal_updated BEFORE UPDATE OF applied_at, undone_at ON conflictdb.proposal FOR EACH ROW EXECUTE FUNCTION _before_proposal_update();
CREATE TRIGGER proposal_left_made BEFORE INSERT ON conflictdb.proposal_left FOR EACH ROW EXECUTE FUNCTION _before_proposal_part() -- always;
CREATE TRIGGER proposal_move_made BEFORE INSERT ON conflictdb.proposal_move FOR EACH ROW EXECUTE FUNCTION _before_proposal_part() -- always;
CREATE TRIGGER rule_before BEFORE INSERT OR UPDATE ON conflictdb.rule FOR EACH ROW EXECUTE FUNCTION _rule_before() -- always;
CREATE TRIGGER rule_deleted AFTER DELETE ON conflictdb.rule REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_rule_change();
CREATE TRIGGER rule_edits_deleted AFTER DELETE ON conflictdb.rule REFERENCING OLD TABLE AS changed_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_rule_edits();
CREATE TRIGGER rule_edits_inserted AFTER INSERT ON conflictdb.rule REFERENCING NEW TABLE AS changed_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_rule_edits();
CREATE TRIGGER rule_edits_updated AFTER UPDATE ON conflictdb.rule REFERENCING OLD TABLE AS old_rows NEW TABLE AS changed_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_rule_edits();
CREATE TRIGGER rule_inserted AFTER INSERT ON conflictdb.rule REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_rule_change();
CREATE TRIGGER rule_not_truncated BEFORE TRUNCATE ON conflictdb.rule FOR EACH STATEMENT EXECUTE FUNCTION _refuse_truncate() -- always;
CREATE TRIGGER rule_replicated AFTER INSERT OR DELETE OR UPDATE ON conflictdb.rule FOR EACH ROW EXECUTE FUNCTION _after_replicated_rule() -- replicas;
CREATE TRIGGER rule_updated AFTER UPDATE ON conflictdb.rule REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_rule_change();
CREATE TRIGGER branch_inserted AFTER INSERT ON conflictdb.scene FOR EACH ROW WHEN ((new.parent_scene_id IS NOT NULL)) EXECUTE FUNCTION _after_branch();
CREATE TRIGGER scene_before BEFORE INSERT OR UPDATE ON conflictdb.scene FOR EACH ROW EXECUTE FUNCTION _scene_before() -- always;
CREATE TRIGGER scene_changed AFTER UPDATE ON conflictdb.scene FOR EACH ROW WHEN (((_settings_of(old.*) - '{name,horizon_days}'::text[]) IS DISTINCT FROM (_settings_of(new.*) - '{name,horizon_days}'::text[]))) EXECUTE FUNCTION _after_scene_change() -- always;
CREATE TRIGGER scene_edits_inserted AFTER INSERT OR DELETE ON conflictdb.scene FOR EACH ROW EXECUTE FUNCTION _note_scene_edit();
CREATE TRIGGER scene_edits_updated AFTER UPDATE ON conflictdb.scene FOR EACH ROW WHEN ((((_settings_of(old.*) IS DISTINCT FROM _settings_of(new.*)) OR (old.owner IS DISTINCT FROM new.owner)) OR (old.history_kept IS DISTINCT FROM new.history_kept))) EXECUTE FUNCTION _note_scene_edit();
CREATE CONSTRAINT TRIGGER scene_holds_objects AFTER UPDATE ON conflictdb.scene DEFERRABLE INITIALLY DEFERRED FOR EACH ROW WHEN (((new.parent_scene_id IS NULL) AND (((old.motion IS DISTINCT FROM new.motion) OR (old.centre_lon IS DISTINCT FROM new.centre_lon)) OR (old.centre_lat IS DISTINCT FROM new.centre_lat)))) EXECUTE FUNCTION _scene_holds_objects();
CREATE TRIGGER scene_may_be_removed BEFORE DELETE ON conflictdb.scene FOR EACH ROW EXECUTE FUNCTION _before_scene_removal();
CREATE TRIGGER scene_name_freed BEFORE INSERT OR UPDATE OF name ON conflictdb.scene FOR EACH ROW EXECUTE FUNCTION _before_scene_name() -- always;
CREATE TRIGGER scene_removed AFTER DELETE ON conflictdb.scene FOR EACH ROW EXECUTE FUNCTION _after_scene_removal();
CREATE TRIGGER scene_replicated AFTER DELETE ON conflictdb.scene FOR EACH ROW EXECUTE FUNCTION _after_replicated_removal() -- replicas;
CREATE TRIGGER scene_resettled AFTER UPDATE ON conflictdb.scene FOR EACH ROW WHEN (((((old.motion IS DISTINCT FROM new.motion) OR (old.earth IS DISTINCT FROM new.earth)) OR (old.centre_lon IS DISTINCT FROM new.centre_lon)) OR (old.centre_lat IS DISTINCT FROM new.centre_lat))) EXECUTE FUNCTION _after_scene_resettled() -- always;
CREATE TRIGGER scene_with_positions_removed AFTER DELETE ON conflictdb.scene FOR EACH ROW EXECUTE FUNCTION _after_scene_with_positions();
CREATE TRIGGER track_before BEFORE INSERT OR UPDATE ON conflictdb.track FOR EACH ROW EXECUTE FUNCTION _track_before() -- always;
CREATE TRIGGER track_check_inserted AFTER INSERT ON conflictdb.track REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _tracks_inserted();
CREATE TRIGGER track_deleted AFTER DELETE ON conflictdb.track REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change('1', 'track_id');
CREATE TRIGGER track_edits_deleted AFTER DELETE ON conflictdb.track REFERENCING OLD TABLE AS changed_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE TRIGGER track_edits_inserted AFTER INSERT ON conflictdb.track REFERENCING NEW TABLE AS changed_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE TRIGGER track_edits_updated AFTER UPDATE ON conflictdb.track REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _note_edits();
CREATE TRIGGER track_inserted AFTER INSERT ON conflictdb.track REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change('1', 'track_id');
CREATE TRIGGER track_not_truncated BEFORE TRUNCATE ON conflictdb.track FOR EACH STATEMENT EXECUTE FUNCTION _refuse_truncate() -- always;
CREATE TRIGGER track_replicated AFTER INSERT OR DELETE OR UPDATE ON conflictdb.track FOR EACH ROW EXECUTE FUNCTION _after_replicated_object('1', 'track_id') -- replicas;
CREATE TRIGGER track_updated AFTER UPDATE ON conflictdb.track REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_object_change('1', 'track_id');
CREATE TRIGGER track_with_positions_updated AFTER UPDATE ON conflictdb.track REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows FOR EACH STATEMENT EXECUTE FUNCTION _after_track_with_positions();

FUNCTION _acknowledge_alarm(p_scene_id bigint, p_a_key text, p_b_key text, p_reason text, p_by text)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _acknowledgements_ended(p_scene text, p_run_id bigint)
    RETURNS TABLE(a_key text, b_key text, acknowledged_by text, reason text) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _acknowledger(p_user text, p_given_name text)
    RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _active_within(p_span tstzrange, p_activations tstzmultirange)
    RETURNS tstzrange LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _add_scene_lock(p_scene_id bigint)
    RETURNS boolean LANGUAGE sql VOLATILE STRICT PARALLEL UNSAFE;

FUNCTION _add_staged(p_scene_id bigint, p_first_page bigint, OUT added bigint, OUT next_page bigint)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET jit=off;

FUNCTION _admission_holders(p_scene_id bigint)
    RETURNS TABLE(pid integer, application text, role text, since timestamp with time zone) LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _admission_marker()
    RETURNS integer LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _after_attached_written()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_attachment_opened()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp SET client_min_messages=warning;

FUNCTION _after_attachment_removal()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp SET client_min_messages=warning;

FUNCTION _after_branch()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_branch_edit()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_object_change()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_positions()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_replicated_object()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_replicated_removal()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_replicated_rule()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_rule_change()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp SET extra_float_digits=1;

FUNCTION _after_scene_change()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_scene_removal()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_scene_resettled()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_scene_with_positions()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _after_track_with_positions()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _allowed_types(p_scene_id bigint)
    RETURNS jsonb LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _answer_request(p_probe_id bigint, p_error text, p_found jsonb, p_answer jsonb)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _approaches(p_scene text, p_only_near boolean, p_keys text[])
    RETURNS TABLE(a_key text, a_kind text, b_key text, b_kind text, closest_at timestamp with time zone, closest_m double precision, closest_error_m double precision, a_lon_deg double precision, a_lat_deg double precision, b_lon_deg double precision, b_lat_deg double precision, verdict text, is_current boolean, run_id bigint, found_at timestamp with time zone, scene_is_current boolean, method text, time_error_s double precision, a_name text, b_name text, a_id bigint, a_version bigint, b_id bigint, b_version bigint) LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _are_compared(p_a_kind smallint, p_a_class bigint, p_b_kind smallint, p_b_class bigint, p_rules jsonb)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _are_covered(p_scene_id bigint)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _are_features(p_plans jsonb)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _are_keys_stale()
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _area_before()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _area_row(p_scene_id bigint, p_area_id bigint)
    RETURNS TABLE(area_id bigint, version bigint, span_start timestamp with time zone, span_end timestamp with time zone, floor_m double precision, ceiling_m double precision, class_number bigint, owner_number bigint, footprint bytea, activations bytea) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _areas_inserted()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _areas_overlap(p_a geometry, p_b geometry, p_by_m double precision)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _as_branch(p_new scene, p_old scene)
    RETURNS scene LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _as_parameters(p_feature jsonb, p_foreign jsonb)
    RETURNS jsonb LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _at_once(p_branch_id bigint, p_is_removal boolean)
    RETURNS boolean LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _at_sea(p_path geometry, p_departures timestamp with time zone[])
    RETURNS tstzrange LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _attached_footprint(p_who text, p_shape geometry)
    RETURNS geometry LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _attached_name(p_attachment attachment)
    RETURNS text LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _attached_path(p_who text, p_shape geometry, p_times timestamp with time zone[], p_has_times boolean)
    RETURNS geometry LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _attached_problems(p_attachment attachment)
    RETURNS text[] LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _attached_root(p_attachment attachment)
    RETURNS oid LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _attached_rows(p_attachment_id bigint, p_change_ids bigint[], p_is_full boolean, p_reading text)
    RETURNS SETOF attached_plan LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _attached_span(p_who text, p_span tstzrange, p_start timestamp with time zone, p_end timestamp with time zone)
    RETURNS tstzrange LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _attached_tables(p_relation oid)
    RETURNS TABLE(relation oid, is_root boolean) LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _attached_waiting(p_scene_id bigint)
    RETURNS bigint LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _attaching_role(p_attachment_id bigint)
    RETURNS name LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _attachment_failed(p_attachment_id bigint, p_error text)
    RETURNS void LANGUAGE sql VOLATILE STRICT PARALLEL UNSAFE;

FUNCTION _attachment_remark(p_attachment attachment)
    RETURNS text LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _attachments(p_scene text)
    RETURNS SETOF attachments LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _attachments_to_follow(p_scene text, p_try_again boolean)
    RETURNS TABLE(attachment_id bigint, is_moved boolean) LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _await_answer(p_probe_id bigint, p_timeout interval, p_kind text)
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _before_acknowledgement()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _before_alarm_acknowledged()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _before_attachment()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _before_probe_request()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _before_proposal_part()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _before_proposal_update()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _before_scene_name()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _before_scene_removal()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _begin_admission(p_scene text, p_wait_s double precision, p_keys text[], p_owner text, OUT scene_id bigint, OUT settings jsonb, OUT max_vertices integer, OUT max_waypoints integer, OUT max_days_ahead double precision, OUT replaced jsonb)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _begin_attached()
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET client_min_messages=warning;

FUNCTION _begin_detection(p_scene text, p_wait_s double precision, p_few integer, p_try_again boolean, OUT scene_id bigint, OUT taken bigint, OUT is_behind boolean, OUT settings jsonb, OUT srid integer, OUT area_ids bigint[], OUT track_ids bigint[], OUT known_objects bigint)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _begin_load()
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET client_min_messages=warning;

FUNCTION _begin_new_rows(p_scene_id bigint, p_run_id bigint, p_run jsonb, p_count integer, p_numbers bigint[], OUT run_id bigint, OUT at_us bigint, OUT scene text, OUT conflict_ids bytea, OUT event_ids bytea, OUT keys text[], OUT first_versions bigint[])
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _begin_pieces(p_scene_id bigint, p_is_first boolean, p_is_full boolean, OUT srid integer, OUT is_compared boolean)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET client_min_messages=warning;

FUNCTION _begin_run(p_scene_id bigint, p_run jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _beyond_horizon(p_scene text, p_span tstzrange)
    RETURNS text LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _box_is_near_centre(p_geometry geometry, p_centre_lon double precision, p_centre_lat double precision)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _boxes_meet(p_a geometry, p_b geometry)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _branch_conflicts(p_branch text)
    RETURNS TABLE(change text, a_key text, b_key text, verdict text, verdict_before text, ends timestamp with time zone[], ends_before timestamp with time zone[]) LANGUAGE sql STABLE STRICT PARALLEL UNSAFE;

FUNCTION _branch_edit_before()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _branch_to_change(p_branch text)
    RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _candidates(p_scene_id bigint, p_at_once bigint, OUT a bytea, OUT b bytea, OUT a_pieces bytea, OUT b_pieces bytea, OUT ranks bytea)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_hashagg=off SET enable_nestloop=off SET jit=off;

FUNCTION _candidates_of_all(p_scene_id bigint, OUT a_piece_id bigint, OUT b_piece_id bigint, OUT a_pieces integer, OUT b_pieces integer, OUT a_object bigint, OUT b_object bigint)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_nestloop=on SET enable_hashjoin=off SET enable_mergejoin=off SET enable_material=off SET enable_seqscan=off SET jit=off;

FUNCTION _candidates_of_dirty(p_scene_id bigint, OUT a_piece_id bigint, OUT b_piece_id bigint, OUT a_pieces integer, OUT b_pieces integer, OUT a_object bigint, OUT b_object bigint)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_nestloop=on SET enable_hashjoin=off SET enable_mergejoin=off SET enable_material=off SET enable_seqscan=off SET jit=off;

FUNCTION _cast_to(p_type oid, p_wanted oid)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _ceiling_m(p_ceiling_m double precision, p_is_closed boolean)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _centre_of_objects(p_scene_id bigint, OUT centre_lon double precision, OUT centre_lat double precision)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _change_attachment(p_attachment attachment, p_changes jsonb, p_to regclass, p_every interval)
    RETURNS attachment LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _changed_areas(p_scene_id bigint, p_after bigint, p_most bigint, OUT area_id bigint, OUT version bigint, OUT span_start timestamp with time zone, OUT span_end timestamp with time zone, OUT floor_m double precision, OUT ceiling_m double precision, OUT class_number bigint, OUT owner_number bigint, OUT footprint bytea, OUT activations bytea)
    RETURNS SETOF record LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _changed_tracks(p_scene_id bigint, p_after bigint, p_most bigint, OUT track_id bigint, OUT version bigint, OUT floor_m double precision, OUT ceiling_m double precision, OUT grow_mps double precision, OUT class_number bigint, OUT owner_number bigint, OUT path bytea, OUT outline bytea, OUT outlines bytea, OUT floors_m bytea, OUT ceilings_m bytea, OUT departures bytea, OUT tolerances text)
    RETURNS SETOF record LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _check_area_probe(p_footprint geometry, p_active_span tstzrange, p_floor_m double precision, p_ceiling_m double precision)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_area_shape(p_who text, p_scene_id bigint, p_footprint geometry, p_max_vertices double precision)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_attachable(p_who text, p_table regclass, p_has_triggers boolean)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_attached_owner(p_who text, p_table regclass, p_has_triggers boolean)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_attached_rows(p_who text, p_since text, p_attachment attachment, p_identity text, p_key text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_attachment(p_who text, p_kind smallint, p_table regclass, p_map jsonb, p_every interval, p_has_triggers boolean)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_common(p_who text, p_key text, p_floor_m double precision, p_ceiling_m double precision, p_properties jsonb, p_class text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_coordinates(p_who text, p_field text, p_geometry geometry, p_scene_id bigint)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_datum(p_who text, p_scene_id bigint, p_stated text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_delays_request(p_scene_id bigint, p_key text, p_horizon interval, p_now timestamp with time zone)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_departures(p_who text, p_path geometry, p_departures timestamp with time zone[])
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_ends(p_scene_id bigint, p_keys text[])
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_growth(p_who text, p_path geometry, p_outline geometry, p_grow_mps double precision, p_outlines geometry)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_haven(p_who text, p_path geometry, p_outline geometry, p_earth text, p_grow_mps double precision, p_outlines geometry)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_haven_near_centre(p_who text, p_path geometry, p_outline geometry, p_centre_lon double precision, p_centre_lat double precision, p_grow_mps double precision, p_outlines geometry)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_heights(p_who text, p_floor_m double precision, p_ceiling_m double precision)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_instants(p_from timestamp with time zone, p_to timestamp with time zone, p_step interval)
    RETURNS timestamp with time zone[] LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_key(p_scene text, p_key text)
    RETURNS boolean LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_leg_heights(p_who text, p_path geometry, p_floor_m double precision, p_ceiling_m double precision, p_floors_m double precision[], p_ceilings_m double precision[])
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_map(p_who text, p_kind smallint, p_map jsonb)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_may_change(p_scene_id bigint, p_scene text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _check_may_prune(p_who text, p_owner name)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _check_near_centre(p_who text, p_field text, p_geometry geometry, p_centre_lon double precision, p_centre_lat double precision)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_options(p_kind text, p_options jsonb)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_outline(p_who text, p_outline geometry, p_field text DEFAULT 'outline'::text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_owner(p_who text, p_owner name, p_new_owner name, p_is_new boolean)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _check_place(p_geometry geometry, p_span tstzrange, p_floor_m double precision, p_ceiling_m double precision)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_planar(p_who text, p_footprint geometry, p_plane text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_plans(p_plans jsonb)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_replaced(p_scene_id bigint, p_plans jsonb, p_owner text, p_replace text[])
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_role(p_who text, p_role text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _check_rules(p_scene_id bigint)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET jit=off;

FUNCTION _check_size(p_who text, p_field text, p_points bigint, p_limit text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _check_speed(p_who text, p_path geometry)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_times(p_who text, p_path geometry)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_tolerances(p_who text, p_tolerances jsonb, p_path geometry)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_track_probe(p_scene_id bigint, p_path geometry, p_outline geometry, p_floor_m double precision, p_ceiling_m double precision, p_grow_mps double precision)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_track_shape(p_who text, p_track track, p_is_new boolean)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_unchanged(p_proposal_id bigint)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _check_word(p_who text, p_field text, p_word text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _circle_legs(p_path geometry, OUT leg integer, OUT starts_at timestamp with time zone, OUT ends_at timestamp with time zone, OUT start double precision[], OUT heading double precision[], OUT angle double precision)
    RETURNS SETOF record LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _circle_vertices(p_start double precision[], p_heading double precision[], p_angle double precision, p_outline geometry)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _claim_probe(p_passed_over bigint[], OUT probe_id bigint, OUT attempt smallint)
    RETURNS record LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _class_number(p_kind smallint, p_id bigint)
    RETURNS bigint LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _close_attached_schema()
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp SET lock_timeout=20ms;

FUNCTION _combined_hash(p_sum numeric)
    RETURNS bigint LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _compare_pieces(p_scene_id bigint)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _compared_early(p_scene_id bigint)
    RETURNS bigint[] LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _compared_every(p_every interval, p_has_triggers boolean)
    RETURNS interval LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _conflict_as_json(p_a_id bigint, p_b_id bigint, p_periods tstzmultirange)
    RETURNS jsonb LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _conflict_events(p_scene text, p_key text, p_other_key text, p_after bigint, p_most bigint, p_since timestamp with time zone)
    RETURNS TABLE(event bigint, kind text, at timestamp with time zone, run_id bigint, conflict_id bigint, a_key text, a_kind text, b_key text, b_kind text, periods bytea, verdict text, time_error_s double precision, closest_at timestamp with time zone, closest_m double precision, closest_error_m double precision, opened_at timestamp with time zone, closed_at timestamp with time zone, proposal_id bigint) LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _conflict_region(p_scene_id bigint, p_a_kind smallint, p_a_id bigint, p_a_version bigint, p_b_kind smallint, p_b_id bigint, p_b_version bigint, p_periods tstzmultirange, p_plane text)
    RETURNS geometry LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0;

FUNCTION _conflicts(p_scene text, p_at timestamp with time zone, p_with_region boolean, p_keys text[], p_key text, p_from timestamp with time zone, p_to timestamp with time zone, p_since timestamp with time zone, p_verdict text, p_acknowledged boolean, p_class text)
    RETURNS TABLE(a_key text, a_kind text, b_key text, b_kind text, periods bytea, verdict text, region text, first_contact_lon_deg double precision, first_contact_lat_deg double precision, method text, time_error_s double precision, is_current boolean, run_id bigint, found_at timestamp with time zone, closest_at timestamp with time zone, closest_m double precision, closest_error_m double precision, closest_a_lon_deg double precision, closest_a_lat_deg double precision, closest_b_lon_deg double precision, closest_b_lat_deg double precision, scene_is_current boolean, conflict_id bigint, changed_at timestamp with time zone, acknowledged_by text, acknowledged_at timestamp with time zone, acknowledged_for text, acknowledged_until timestamp with time zone, a_name text, b_name text, lacking_s double precision, certainty text, a_id bigint, a_version bigint, b_id bigint, b_version bigint) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _conflicts_known_at(p_scene text, p_instant timestamp with time zone)
    RETURNS TABLE(a_key text, a_kind text, b_key text, b_kind text, periods bytea, verdict text, method text, time_error_s double precision, run_id bigint, found_at timestamp with time zone, closest_at timestamp with time zone, closest_m double precision, closest_error_m double precision, conflict_id bigint, acknowledged_by text, acknowledged_at timestamp with time zone, acknowledged_for text, acknowledged_until timestamp with time zone) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _corners(p_outline geometry, OUT n bigint, OUT x double precision, OUT y double precision, OUT dx double precision, OUT dy double precision)
    RETURNS SETOF record LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _count_conflicts(p_scene_id bigint, OUT conflicts bigint, OUT unresolved bigint)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET enable_indexscan=off SET jit=off;

FUNCTION _count_inherited(p_scene_id bigint, OUT conflicts bigint, OUT unresolved bigint, OUT gone bigint, OUT gone_unresolved bigint)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _count_objects(p_scene_id bigint)
    RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _count_pending(p_scene_id bigint)
    RETURNS bigint LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _counted_conflicts()
    RETURNS TABLE(scene text, verdict text, is_acknowledged boolean, conflicts bigint) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _cover(p_scene_id bigint, p_kinds smallint[], p_ids bigint[])
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_nestloop=off SET jit=off;

FUNCTION _cover_all(p_scene_id bigint)
    RETURNS void LANGUAGE sql VOLATILE PARALLEL UNSAFE;

FUNCTION _covering(p_region geometry, p_place geometry)
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _create_attached_rows(p_who text, p_attachment_id bigint, p_kind smallint, p_table regclass, p_map jsonb, OUT identity_columns text[])
    RETURNS text[] LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _create_note(p_attachment_id bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _depends_on_settings_alone(p_name name, p_types oidvector)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _digest_of_batch(p_former_digest bytea, p_edit_ids int8multirange, OUT edits bigint, OUT digest bytea)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET jit=off;

FUNCTION _digest_of_edit(p_edit edit)
    RETURNS bytea LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _drawn(p_geometry geometry, p_plane text)
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _drawn_path(p_path geometry, p_plane text)
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _drifted_objects(p_attachment_id bigint)
    RETURNS SETOF text LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _drop_orphans()
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _each_to_plane(p_geometries geometry[], p_plane text)
    RETURNS geometry[] LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _end_acknowledgement(p_conflict_id bigint)
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _end_alarms(p_now_us bigint, p_ends_us bigint, p_off text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _end_new_rows(p_run_id bigint, p_opened bigint, p_unresolved bigint, p_notifications text[])
    RETURNS void LANGUAGE sql VOLATILE PARALLEL UNSAFE;

FUNCTION _end_of_wait(p_timeout interval)
    RETURNS timestamp with time zone LANGUAGE sql VOLATILE PARALLEL SAFE;

FUNCTION _end_pieces(p_scene_id bigint, p_changed bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _ends_of(p_spans tstzmultirange)
    RETURNS timestamp with time zone[] LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _ensure_centre(p_scene_id bigint, p_first geometry, OUT centre_lon double precision, OUT centre_lat double precision)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _exact_numeric(p_number double precision)
    RETURNS numeric LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _expanded(p_scene_id bigint)
    RETURNS tstzrange LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _expanded_us(p_scene_id bigint, OUT from_us bigint, OUT until_us bigint)
    RETURNS record LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _explained_as_json(p_key text, p_name text, p_kind smallint, p_waits boolean, p_pieces bigint, p_span tstzrange, p_floor_m double precision, p_ceiling_m double precision)
    RETURNS jsonb LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _explained_object(p_scene_id bigint, p_key text, OUT kind smallint, OUT id bigint, OUT key text, OUT name text, OUT class text, OUT owner text, OUT waits boolean, OUT pieces bigint, OUT is_covered boolean, OUT span tstzrange, OUT box geometry, OUT floor_m double precision, OUT ceiling_m double precision)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _explained_text(j jsonb)
    RETURNS text LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _faster_leg(p_path geometry, p_most_kn double precision, OUT leg integer, OUT kn double precision)
    RETURNS record LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _feature(p_area area)
    RETURNS jsonb LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET extra_float_digits=1;

FUNCTION _feature(p_track track)
    RETURNS jsonb LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET extra_float_digits=1;

FUNCTION _features_of(p_scene_id bigint, p_plans jsonb)
    RETURNS jsonb LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _find_attached(p_scene text, p_table text)
    RETURNS SETOF attachment LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _first_stop(p_path geometry, p_departures timestamp with time zone[], OUT starts_us bigint, OUT leaves_us bigint)
    RETURNS record LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _first_stops(p_scene_id bigint, p_numbers bigint[], OUT number bigint, OUT departs_us bigint[])
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET jit=off;

FUNCTION _first_version(p_kind smallint, p_id bigint)
    RETURNS bigint LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _follow(p_scene_id bigint, p_keys text[], OUT key text, OUT other_key text, OUT other_kind smallint, OUT verdict text, OUT slack_us bigint, OUT by_us bigint, OUT ends_us bigint[], OUT low_us bigint, OUT high_us bigint, OUT other_low_us bigint, OUT other_high_us bigint)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET enable_seqscan=off SET jit=off;

FUNCTION _follow_attachment(p_attachment_id bigint, p_waits boolean, OUT is_done boolean, OUT mapped bigint, OUT removed bigint, OUT unmapped bigint, OUT error text)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _follow_parent(p_branch_id bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _follow_renames(p_seen pg_snapshot, p_reading pg_snapshot)
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _footprints(p_area_ids bigint[])
    RETURNS TABLE(area_id bigint, footprint bytea) LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _forget_differences(p_scene_id bigint, p_numbers bigint[])
    RETURNS bytea LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET jit=off;

FUNCTION _former_name(p_scene_id bigint)
    RETURNS text LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _free_attached_name(p_attachment_id bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp SET client_min_messages=warning;

FUNCTION _free_orphan_name(p_name text)
    RETURNS void LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _from_centre_deg(p_geometry geometry, p_lon double precision, p_lat double precision)
    RETURNS double precision LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _from_gnomonic(p_geometry geometry, p_plane text)
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _from_plane(p_geometry geometry, p_plane text)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _given_piece(p_number bigint, p_kind smallint, p_object_id bigint, p_numbers bigint[], p_part integer, p_turn integer, p_hull geometry, p_span tstzrange, p_floor_m double precision, p_ceiling_m double precision)
    RETURNS SETOF piece LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _given_pieces(p_scene_id bigint, p_kinds smallint[], p_numbers bigint[], p_turns integer[], p_hulls bytea[], p_starts_us bigint[], p_ends_us bigint[], p_inclusive boolean[], p_floors_m double precision[], p_ceilings_m double precision[])
    RETURNS SETOF piece LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _globe()
    RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _grown(p_part geometry)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _grown_outline(p_outline geometry, p_by_m double precision)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _half_open(p_span tstzrange, p_is_closed boolean)
    RETURNS tstzrange LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _half_open(p_spans tstzmultirange, p_is_closed boolean)
    RETURNS tstzmultirange LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _half_vertical_m(p_scene_id bigint)
    RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _has_grown(p_periods tstzmultirange, p_verdict text, p_time_error_s double precision, p_closest_m double precision, p_closest_error_m double precision, p_known_periods tstzmultirange, p_known_verdict text, p_known_time_error_s double precision, p_known_closest_m double precision, p_known_closest_error_m double precision, p_tolerance_m double precision)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _has_just_failed(p_attachment attachment)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _has_key(p_scene_id bigint, p_key text)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _height_on(p_whole_m double precision, p_heights_m double precision[], p_path geometry, p_leg integer, p_instant timestamp with time zone)
    RETURNS double precision LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _heights_meet(p_a_floor_m double precision, p_a_ceiling_m double precision, p_b_floor_m double precision, p_b_ceiling_m double precision)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _heights_on(p_floor_m double precision, p_ceiling_m double precision, p_floors_m double precision[], p_ceilings_m double precision[], p_path geometry, p_first integer, p_last integer, p_instant timestamp with time zone, OUT floor_m double precision, OUT ceiling_m double precision)
    RETURNS record LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _hidden_numbers(p_scene_id bigint)
    RETURNS bigint[] LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _history_kept(p_scene_id bigint)
    RETURNS interval LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _hold_attached(p_who text, p_relation oid, p_has_triggers boolean)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _hold_attachment(p_scene text, p_table text)
    RETURNS attachment LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _hold_probe(p_probe_id bigint, p_attempt integer)
    RETURNS boolean LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _hold_proposal(p_proposal_id bigint)
    RETURNS proposal LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _horizon(p_scene_id bigint, p_is_asked boolean, OUT horizon_days double precision, OUT from_us bigint, OUT until_us bigint, OUT is_waiting boolean, OUT starts_us bigint, OUT ends_us bigint)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _hulls_meet(p_a geometry, p_b geometry, p_padding_m double precision DEFAULT 0)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _identity_condition(p_columns text[], p_identity text)
    RETURNS text LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _identity_json(p_columns text[], p_types oid[], p_identity text)
    RETURNS jsonb LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _identity_of(p_alias text, p_columns text[])
    RETURNS text LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _in_microseconds(p_path geometry)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _insert_positions(p_scene text, p_key text[], p_instant_us bigint[], p_lon double precision[], p_lat double precision[])
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _instant_of(p_us bigint)
    RETURNS timestamp with time zone LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _instant_text(p_at timestamp with time zone)
    RETURNS text LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _instants_of(p_instants jsonb)
    RETURNS timestamp with time zone[] LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _interval_set(p_name text, p_default interval, p_most interval)
    RETURNS interval LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _is_alike(p_some tstzmultirange, p_others tstzmultirange, p_within_s double precision)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _is_all_dirty(p_scene_id bigint)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _is_awaited(p_attachment attachment)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _is_behind()
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _is_behind_horizon(p_expanded tstzrange, p_horizon_days double precision)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _is_behind_parent(p_scene_id bigint)
    RETURNS boolean LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _is_closed(p_scene_id bigint)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _is_compared(p_attachment attachment)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _is_current(p_scene_id bigint)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET enable_bitmapscan=off SET jit=off;

FUNCTION _is_due(p_attachment attachment)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _is_edited(p_scene_id bigint, p_key text)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _is_mine(p_attachment_id bigint)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _is_moved(p_attachment attachment)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _is_moving(p_first geometry, p_last geometry, p_motion text, p_earth text)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _is_old_slot(p_slot integer, p_until timestamp with time zone)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _is_once(p_activations tstzmultirange, p_schedule jsonb)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _is_parent_wider(p_branch scene)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _is_plain(p_box box3d, p_size_deg double precision, p_edge_deg double precision)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _is_plain(p_properties jsonb)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _is_protected()
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _is_restoring()
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _is_same_area(p_a area, p_b area)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _is_same_track(p_a track, p_b track)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _is_steady(p_grow_mps double precision, p_outlines geometry, p_floors_m double precision[], p_ceilings_m double precision[], p_tolerances jsonb, p_departures timestamp with time zone[], p_schedule jsonb)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _is_usual_course(p_path geometry, p_outline geometry, p_motion text, p_max_waypoints double precision, p_max_speed_kn double precision)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _is_usual_footprint(p_footprint geometry, p_motion text, p_earth text, p_centre_lon double precision, p_centre_lat double precision, p_max_vertices double precision)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _is_with(p_kind smallint, p_class bigint, p_numbers bigint[])
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _joined_in_memory(p_scene_id bigint, p_most bigint, OUT rows bigint, OUT is_all boolean, OUT is_any boolean, OUT with_numbers bigint[])
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET jit=off;

FUNCTION _keep_restored_key()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _keys_of(p_scene_id bigint, p_kinds smallint[], p_ids bigint[])
    RETURNS TABLE(kind smallint, id bigint, key text, name text) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _keys_of_class(p_scene text, p_class text)
    RETURNS SETOF text LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _known_conflict(p_scene text, p_a_key text, p_b_key text)
    RETURNS conflict LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _known_conflicts(p_scene_id bigint, p_numbers bigint[], OUT a_kinds bytea, OUT a_ids bytea, OUT b_kinds bytea, OUT b_ids bytea, OUT digests bytea, OUT places bytea)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _known_conflicts_among(p_scene_id bigint, p_is_all boolean, OUT a_kinds bytea, OUT a_ids bytea, OUT b_kinds bytea, OUT b_ids bytea, OUT digests bytea, OUT places bytea)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET enable_indexscan=off SET enable_nestloop=off SET jit=off;

FUNCTION _known_conflicts_of(p_scene_id bigint, p_kinds smallint[], p_ids bigint[], OUT a_kinds bytea, OUT a_ids bytea, OUT b_kinds bytea, OUT b_ids bytea, OUT digests bytea, OUT places bytea)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET enable_sort=off SET jit=off;

FUNCTION _known_limits()
    RETURNS TABLE(name text, default_value double precision, most double precision, unit text, doc text) LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _last_run_s(p_scene_id bigint)
    RETURNS double precision LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _lateness(p_scene_id bigint, p_keys text[], OUT key text, OUT track_id bigint, OUT low_us bigint, OUT high_us bigint, OUT is_known boolean)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _latitude(p_rectifying double precision, p_earth text)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _layers(p_scene_id bigint)
    RETURNS bigint[] LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _leg(p_start geometry, p_end geometry)
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _leg_havens(p_motion text, p_earth text, p_plane text, p_path geometry, p_outline geometry, p_grow_mps double precision, p_outlines geometry, p_leg integer, p_instants timestamp with time zone[])
    RETURNS TABLE(at timestamp with time zone, haven geometry) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _leg_with_heading(p_path geometry, p_leg integer, p_motion text, p_earth text, OUT line geometry, OUT leg integer)
    RETURNS record LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _legs(p_path geometry, p_earth text, OUT leg integer, OUT starts_at timestamp with time zone, OUT ends_at timestamp with time zone, OUT lon_deg double precision, OUT lon_step_deg double precision, OUT mu double precision, OUT mu_step double precision, OUT bearing_deg double precision)
    RETURNS SETOF record LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _lift_limits(p_lock_timeout_s double precision)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _limit(p_limit text)
    RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _live(p_scene text, OUT key text, OUT state text, OUT late_from_s double precision, OUT late_to_s double precision, OUT off_m double precision, OUT instant timestamp with time zone, OUT lon_deg double precision, OUT lat_deg double precision, OUT height_m double precision, OUT error_m double precision, OUT as_of timestamp with time zone, OUT slack_s double precision, OUT first_alarm timestamp with time zone)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _live_conflicts(p_scene text, OUT alarm_id bigint, OUT key text, OUT other_key text, OUT verdict text, OUT reason text, OUT first_contact timestamp with time zone, OUT last_contact timestamp with time zone, OUT lon_deg double precision, OUT lat_deg double precision, OUT opened_at timestamp with time zone, OUT as_of timestamp with time zone)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _live_states(p_scene_id bigint, p_keys text[], OUT key text, OUT state text, OUT instant_us bigint, OUT lon double precision, OUT lat double precision, OUT height_m double precision, OUT error_m double precision, OUT seen_from_s double precision, OUT seen_to_s double precision, OUT off_m double precision)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _load(p_name text, p_settings jsonb, p_merge boolean, OUT added bigint, OUT updated bigint, OUT removed bigint, OUT unchanged bigint, OUT scene_id bigint, OUT stored bigint, OUT next_page bigint)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET jit=off;

FUNCTION _lock_looked_at()
    RETURNS SETOF bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _lon_lat(p_who text, p_field text, p_geometry geometry)
    RETURNS geometry LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _longest_horizon_s()
    RETURNS integer LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _longest_time_s(p_scene_id bigint)
    RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _longest_voyage_s(p_path geometry, p_tolerances jsonb)
    RETURNS double precision LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _lonlat(p_place geometry, OUT lon double precision, OUT lat double precision)
    RETURNS record LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _map_areas(p_scene text)
    RETURNS TABLE(area_id bigint, key text, name text, floor_m double precision, ceiling_m double precision, start_s double precision, end_s double precision, spans_s double precision[], west_deg double precision, south_deg double precision, east_deg double precision, north_deg double precision, inside_lon_deg double precision, inside_lat_deg double precision) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _map_conflicts(p_scene text)
    RETURNS TABLE(head text, numbers bytea) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _map_expression(p_who text, p_field text, p_relation regclass, p_text text, p_wanted oid, OUT expression text, OUT columns smallint[])
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _map_fields(p_kind smallint)
    RETURNS TABLE(field text, attribute text) LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _map_live(p_scene text)
    RETURNS text LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _map_may_acknowledge()
    RETURNS boolean LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _map_overview(p_scene text)
    RETURNS bytea LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _map_shapes(p_scene text, p_keys text[])
    RETURNS TABLE(layer text, feature_id bigint, key text, shape text) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _map_tracks(p_scene text)
    RETURNS TABLE(track_id bigint, key text, name text, floor_m double precision, ceiling_m double precision, path bytea, outline bytea, grow_mps double precision, outlines bytea, departures_s double precision[]) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _mark_all(p_scene_id bigint)
    RETURNS bigint LANGUAGE sql VOLATILE PARALLEL UNSAFE;

FUNCTION _mark_side(p_scene_id bigint, p_side text, p_other text)
    RETURNS void LANGUAGE sql VOLATILE PARALLEL UNSAFE;

FUNCTION _marked_objects(p_scene_id bigint, p_kind smallint)
    RETURNS SETOF bigint LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET enable_bitmapscan=off SET jit=off;

FUNCTION _may_admit(p_role name, p_scene_id bigint)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _may_change(p_scene_id bigint)
    RETURNS boolean LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET jit=off;

FUNCTION _may_expand()
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _may_have_triggers(p_table oid)
    RETURNS boolean LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _may_look()
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _meets(p_region geometry, p_geometry geometry, p_plane text)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _members_of_plans()
    RETURNS text[] LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _met_by_place(p_scene_id bigint, p_geometry geometry, p_span tstzrange, p_floor_m double precision, p_ceiling_m double precision, p_reach_m double precision)
    RETURNS TABLE(object_kind smallint, object_id bigint, version bigint, span tstzrange, region geometry) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_hashjoin=off SET enable_mergejoin=off SET enable_material=off SET enable_seqscan=off SET jit=off;

FUNCTION _met_by_plans(p_scene_id bigint, p_area_ids bigint[], p_track_ids bigint[], p_most integer)
    RETURNS TABLE(a_kind smallint, a_id bigint, b_kind smallint, b_id bigint, periods tstzmultirange) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_hashjoin=off SET enable_mergejoin=off SET enable_material=off SET enable_seqscan=off SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_bitmapscan=off SET jit=off;

FUNCTION _microseconds(p_at timestamp with time zone)
    RETURNS bigint LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _middle_of(p_geometry geometry)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _middle_x(p_geometry geometry, p_half_width double precision)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _missing_table(p_problems text[])
    RETURNS text LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _mixed(p_one double precision[], p_share double precision, p_other double precision[], p_other_share double precision)
    RETURNS double precision[] LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _most_havens()
    RETURNS integer LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _move_attached(p_proposal_id bigint, p_undo boolean, p_may boolean)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _my_roles()
    RETURNS SETOF name LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _names(p_scene text, p_keys text[])
    RETURNS TABLE(key text, name text) LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _near_centre(p_geometry geometry, p_centre_lon double precision, p_centre_lat double precision)
    RETURNS geometry LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _need_schedules(p_scene_id bigint, p_keys text[])
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _new_positions(p_most integer, OUT scene_id bigint, OUT key text, OUT track_id bigint, OUT version bigint, OUT instant_us bigint, OUT lon double precision, OUT lat double precision, OUT height_m double precision, OUT error_m double precision)
    RETURNS SETOF record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET enable_seqscan=off SET enable_bitmapscan=off SET jit=off;

FUNCTION _next_owner(p_kind smallint, p_id bigint, p_version bigint)
    RETURNS bigint LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _not_tiny(p_m double precision)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _note_alarm(p_kind text, p_at timestamp with time zone, p_alarm live_conflict)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _note_branch_edits()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _note_edits()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _note_rule_edits()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _note_scene_edit()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _notify(p_channel text, p_payload text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _notify_acknowledgement(p_scene text, p_conflict_id bigint, p_holds boolean)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _notify_events(p_scene_id bigint, p_scene text, p_run_id bigint, p_first bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _numbers_of(p_numbers bigint[], p_n bigint)
    RETURNS bigint[] LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _object_number(p_kind smallint, p_id bigint)
    RETURNS bigint LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _object_with(p_scene_id bigint, p_key text, OUT object_kind smallint, OUT object_id bigint, OUT version bigint)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _objects_hash(p_scene_id bigint, OUT last_version bigint, OUT objects_hash bigint)
    RETURNS record LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _objects_near(p_scene_id bigint, p_wanted_m double precision, p_from_us bigint, p_until_us bigint, p_kinds smallint[], p_numbers bigint[], p_turns integer[], p_hulls bytea[], p_starts_us bigint[], p_ends_us bigint[], p_inclusive boolean[], p_floors_m double precision[], p_ceilings_m double precision[])
    RETURNS TABLE(kind smallint, id bigint, key text, name text, owner text, is_stale boolean) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_hashjoin=off SET enable_mergejoin=off SET enable_material=off SET enable_seqscan=off SET enable_bitmapscan=off SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET jit=off;

FUNCTION _of_replaced(p_scene_id bigint, INOUT p_key text, INOUT p_class text, INOUT p_owner text)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _off_the_pole(p_part geometry)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _oldest_editor(p_snapshot pg_snapshot)
    RETURNS xid8 LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET jit=off;

FUNCTION _on_map(p_geometry geometry, p_plane text)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _open_alarms(p_scene_id bigint, p_keys text[], OUT key text, OUT other_key text, OUT verdict text, OUT reason text, OUT first_us bigint, OUT last_us bigint, OUT lon double precision, OUT lat double precision, OUT as_of_us bigint)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _open_attached_schema()
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp SET client_min_messages=warning;

FUNCTION _open_outline(p_outline geometry)
    RETURNS jsonb LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _order_of_all(p_scene_id bigint, p_objects bigint)
    RETURNS bytea LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET jit=off;

FUNCTION _order_reason(p_identity text)
    RETURNS text LANGUAGE plpgsql STABLE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _out_m(p_shape geometry, p_plane text)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _outline_at(p_path geometry, p_outline geometry, p_grow_mps double precision, p_outlines geometry, p_waypoint integer)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _outline_between(p_from geometry, p_to geometry, p_share double precision)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _own_scene_id(p_scene text)
    RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _own_scenes()
    RETURNS SETOF bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _owned_features(p_plans jsonb, p_owner text)
    RETURNS jsonb LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _parent_name(p_scene_id bigint)
    RETURNS text LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _parent_of(p_scene_id bigint)
    RETURNS bigint LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _parent_waits(p_scene_id bigint)
    RETURNS boolean LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _part_from_plane(p_geometry geometry, p_plane text)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _pending(p_scene_id bigint, OUT areas bigint, OUT tracks bigint)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET enable_bitmapscan=off SET jit=off;

FUNCTION _period_ends(p_periods tstzmultirange)
    RETURNS timestamp with time zone[] LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _pieces(p_scene_id bigint, p_piece_ids bigint[], OUT piece_id bigint, OUT rank bigint, OUT object_kind smallint, OUT object_id bigint, OUT version bigint, OUT pieces integer, OUT part integer, OUT turn smallint, OUT span_start timestamp with time zone, OUT span_end timestamp with time zone, OUT end_inclusive boolean, OUT floor_m double precision, OUT ceiling_m double precision, OUT leg_start timestamp with time zone, OUT leg_end timestamp with time zone, OUT start_lon_deg double precision, OUT start_lat_deg double precision, OUT end_lon_deg double precision, OUT end_lat_deg double precision, OUT bearing_deg double precision, OUT class_number bigint, OUT owner_number bigint, OUT hull bytea, OUT shape bytea, OUT shape_to bytea, OUT parts bytea, OUT cuts bytea, OUT leg_times bytea, OUT legs bytea, OUT climb bytea)
    RETURNS SETOF record LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _pieces_before(p_scene_id bigint, p_kind smallint, p_id bigint, p_until bigint)
    RETURNS SETOF piece LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _pieces_may_meet(p_a piece, p_b piece, p_within_s double precision, p_allowed jsonb)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _pieces_meeting(p_scene_id bigint, p_most_compared bigint, p_key text, p_kinds smallint[], p_numbers bigint[], p_turns integer[], p_hulls bytea[], p_starts_us bigint[], p_ends_us bigint[], p_inclusive boolean[], p_floors_m double precision[], p_ceilings_m double precision[])
    RETURNS TABLE(n bigint, piece_id bigint, pieces integer, object_number bigint, part integer) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_hashjoin=off SET enable_mergejoin=off SET enable_material=off SET enable_seqscan=off SET jit=off;

FUNCTION _pieces_of(p_row piece)
    RETURNS SETOF piece LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _placeless_within(p_scene text, p_geometry geometry)
    RETURNS SETOF bigint LANGUAGE plpgsql STABLE PARALLEL RESTRICTED SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _plane(p_motion text, p_earth text, p_centre_lon double precision, p_centre_lat double precision)
    RETURNS text LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _plane_srid(p_plane text)
    RETURNS integer LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _plans_given(p_plans jsonb)
    RETURNS jsonb LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _plans_of(p_plans jsonb)
    RETURNS TABLE(key text, times timestamp with time zone[], footprint geometry, active_span tstzrange, path geometry, outline geometry, floor_m double precision, ceiling_m double precision, name text, properties jsonb, grow_mps double precision, outlines geometry, floors_m double precision[], ceilings_m double precision[], class text, owner text, tolerances jsonb, activations tstzmultirange, departures timestamp with time zone[], schedule jsonb) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _point_of(p_degrees double precision[])
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _position_before()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _positions(p_geometry geometry, p_are_closed boolean)
    RETURNS jsonb LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _preview(p_attachment attachment, p_table regclass, p_former_columns text[], p_objects integer, OUT steps text[], OUT objects text[], OUT unmapped text[])
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _probe_failed(p_probe_id bigint, p_error text)
    RETURNS void LANGUAGE sql VOLATILE STRICT PARALLEL UNSAFE;

FUNCTION _proposal(p_proposal_id bigint)
    RETURNS proposal LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _proposal_basis(p_scene_id bigint, OUT settings jsonb, OUT last_version bigint, OUT objects_hash bigint)
    RETURNS record LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _proposal_of_pair(p_scene_id bigint, p_a_kind smallint, p_a_key text, p_b_kind smallint, p_b_key text)
    RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _proposed(p_scene text, p_key text)
    RETURNS TABLE(proposal_id bigint, state text, text text, delay_s double precision, changes text[]) LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION _protected_tables()
    RETURNS SETOF regclass LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _prune(p_scene_id bigint, p_kept interval)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_nestloop=off SET enable_seqscan=off SET jit=off;

FUNCTION _prune_positions()
    RETURNS integer LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _prune_probes()
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _prune_sometimes(p_scene_id bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _put_alarms(p_scene_id bigint, p_as_of_us bigint, p_key text[], p_other_key text[], p_verdict text[], p_reason text[], p_first_us bigint[], p_last_us bigint[], p_lon double precision[], p_lat double precision[], p_ended jsonb, p_slack jsonb)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _put_attached(p_attachment attachment, p_first bigint, p_last bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _put_attached_by_halves(p_attachment attachment, p_items bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _put_live(p_scene_id bigint, p_as_of_us bigint, p_key text[], p_state text[], p_late_from_s double precision[], p_late_to_s double precision[], p_off_m double precision[], p_instant_us bigint[], p_lon double precision[], p_lat double precision[], p_height_m double precision[], p_error_m double precision[], p_seen_from_s double precision[], p_seen_to_s double precision[], p_version bigint[], p_fastest_mps double precision[])
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _put_pieces(p_scene_id bigint, p_most bigint, p_most_compared bigint, p_object_kind smallint[], p_object_id bigint[], p_version bigint[], p_part integer[], p_turn smallint[], p_hull bytea[], p_span tstzrange[], p_floor_m double precision[], p_ceiling_m double precision[], p_shape bytea[], p_leg_start timestamp with time zone[], p_leg_end timestamp with time zone[], p_start_lon_deg double precision[], p_start_lat_deg double precision[], p_end_lon_deg double precision[], p_end_lat_deg double precision[], p_bearing_deg double precision[], p_shape_to bytea[], p_pieces integer[], p_class_number bigint[], p_owner_number bigint[], p_first integer[], p_hulls bytea[], p_shapes bytea[], p_parts integer[], p_starts timestamp with time zone[], p_leg_times timestamp with time zone[], p_legs double precision[], p_climbs boolean[], p_climb double precision[], OUT piece_id bigint, OUT rank bigint, OUT object_kind smallint, OUT object_id bigint, OUT version bigint, OUT pieces integer, OUT part integer, OUT turn smallint, OUT span_start timestamp with time zone, OUT span_end timestamp with time zone, OUT end_inclusive boolean, OUT floor_m double precision, OUT ceiling_m double precision, OUT leg_start timestamp with time zone, OUT leg_end timestamp with time zone, OUT start_lon_deg double precision, OUT start_lat_deg double precision, OUT end_lon_deg double precision, OUT end_lat_deg double precision, OUT bearing_deg double precision, OUT class_number bigint, OUT owner_number bigint, OUT hull bytea, OUT shape bytea, OUT shape_to bytea, OUT parts bytea, OUT cuts bytea, OUT leg_times bytea, OUT legs bytea, OUT climb bytea, OUT met bytea, OUT own_parts bytea, OUT met_parts bytea, OUT candidate_pairs bigint, OUT stage2_us bigint)
    RETURNS SETOF record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _put_plans(p_scene text, p_removed text[], p_plans jsonb, p_are_checked boolean, p_known text[])
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET jit=off;

FUNCTION _put_proposal(p_scene_id bigint, p_basis jsonb, p_goal text, p_objective_s double precision, p_bound_s double precision, p_is_least boolean, p_moves jsonb, p_left jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _put_rules(p_scene_id bigint, p_rules jsonb, p_is_all boolean)
    RETURNS void LANGUAGE sql VOLATILE PARALLEL UNSAFE;

FUNCTION _put_scene(p_name text, p_settings jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _radius_m(p_plane text)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _raise(p_state text, p_who text, p_field text, p_rule text, p_constraint text, p_hint text DEFAULT ''::text)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _read_areas(p_scene_id bigint, p_keys text[], OUT area_id bigint, OUT version bigint, OUT span_start timestamp with time zone, OUT span_end timestamp with time zone, OUT floor_m double precision, OUT ceiling_m double precision, OUT footprint bytea, OUT activations bytea, OUT key text, OUT properties text, OUT name text, OUT class text, OUT owner text, OUT schedule text)
    RETURNS SETOF record LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _read_tracks(p_scene_id bigint, p_keys text[], OUT track_id bigint, OUT version bigint, OUT floor_m double precision, OUT ceiling_m double precision, OUT grow_mps double precision, OUT path bytea, OUT outline bytea, OUT outlines bytea, OUT floors_m bytea, OUT ceilings_m bytea, OUT departures bytea, OUT key text, OUT properties text, OUT name text, OUT class text, OUT owner text, OUT tolerances text, OUT schedule text)
    RETURNS SETOF record LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _readable_scenes()
    RETURNS SETOF bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _record_failure(p_scene_id bigint, p_run jsonb, p_error text)
    RETURNS bigint LANGUAGE sql VOLATILE PARALLEL UNSAFE;

FUNCTION _rectifying(p_latitude double precision, p_earth text)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _rectifying_m(p_earth text)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _refuse_taken(p_name text)
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _refuse_truncate()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _register_attachment(p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval, p_again boolean)
    RETURNS attachment LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _release_probe(p_probe_id bigint)
    RETURNS void LANGUAGE sql VOLATILE STRICT PARALLEL UNSAFE;

FUNCTION _remove_stamp(p_worker_id uuid)
    RETURNS void LANGUAGE sql VOLATILE STRICT PARALLEL UNSAFE;

FUNCTION _renames_since(p_seen pg_snapshot, OUT edit_id bigint, OUT transaction_id xid8, OUT scene_id bigint, OUT keys text[], OUT former_keys text[])
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan;

FUNCTION _renew_acknowledgements(p_scene_id bigint, p_first_event bigint)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _replaced_objects(p_scene_id bigint, p_keys text[], p_owner text)
    RETURNS TABLE(kind smallint, id bigint, key text, name text, owner text) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET jit=off;

FUNCTION _replanned(OUT scene_id bigint, OUT key text, OUT track_id bigint, OUT version bigint, OUT instant_us bigint, OUT lon double precision, OUT lat double precision, OUT height_m double precision, OUT error_m double precision)
    RETURNS SETOF record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _request(p_scene_id bigint, p_kind text, p_plans json, p_options jsonb DEFAULT '{}'::jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _request_probe(p_scene text, p_plans json)
    RETURNS bigint LANGUAGE sql VOLATILE STRICT PARALLEL UNSAFE;

FUNCTION _requested(p_probe_id bigint, OUT kind text, OUT scene text, OUT plans text, OUT options jsonb, OUT max_speed_kn double precision)
    RETURNS record LANGUAGE plpgsql STABLE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _require_snapshot()
    RETURNS void LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _retimed(p_path geometry, p_times_us bigint[], p_detour jsonb)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _rewatch_attached(p_attachment_id bigint)
    RETURNS text LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET lock_timeout=100ms;

FUNCTION _rhumb_vertices(p_lon_deg double precision, p_mu double precision, p_bearing_deg double precision, p_outline geometry, p_earth text)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _rough_padding_m(p_out_m double precision, p_reach_m double precision, p_wanted_m double precision, p_plane text)
    RETURNS double precision LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _rough_pieces(p_scene_id bigint, p_wanted_m double precision, p_area_ids bigint[], p_track_ids bigint[])
    RETURNS TABLE(rough piece, shape geometry, padding_m double precision) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _rough_pieces_at(p_scene_id bigint, p_wanted_m double precision, p_kinds smallint[], p_ids bigint[], p_numbers bigint[], p_are_known boolean[], p_places geometry[], p_reaches_m double precision[], p_spans tstzmultirange[], p_floors_m double precision[], p_ceilings_m double precision[])
    RETURNS TABLE(rough piece, shape geometry, padding_m double precision) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _row_boxes(p_scene_id bigint, p_is_all boolean, p_is_any boolean, p_with bigint[])
    RETURNS TABLE(piece_id bigint, pieces integer, object bigint, turn smallint, low_x double precision, low_y double precision, high_x double precision, high_y double precision, floor_m double precision, ceiling_m double precision, span_start timestamp with time zone, span_end timestamp with time zone, class_number bigint, owner_number bigint, marks bigint) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _rows_to_compare(p_scene_id bigint, p_numbers bigint[], p_horizon_us bigint, OUT piece_ids bytea, OUT pieces bigint, OUT compared bigint)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET enable_material=off SET jit=off;

FUNCTION _rule_before()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _rule_between(p_scene_id bigint, p_a_kind smallint, p_a_class text, p_b_kind smallint, p_b_class text, p_above integer DEFAULT 0, OUT rule_id bigint, OUT a_class text, OUT b_class text, OUT separation_m double precision, OUT vertical_m double precision, OUT time_s double precision, OUT allowed boolean, OUT yields text)
    RETURNS record LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _rule_names(p_scene_id bigint)
    RETURNS jsonb LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET jit=off;

FUNCTION _rules_of(p_scene_id bigint)
    RETURNS jsonb LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET extra_float_digits=1;

FUNCTION _runs(p_scene text, p_limit integer)
    RETURNS SETOF run LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _sag(p_angle double precision, p_first geometry, p_last geometry)
    RETURNS double precision LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _sampled_keys(p_scene_id bigint, p_most integer)
    RETURNS text[] LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _scene(p_scene_id bigint)
    RETURNS TABLE(settings jsonb) LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _scene_alarms()
    RETURNS TABLE(scene text, is_current boolean, waiting_since timestamp with time zone, unmapped bigint, last_error text, tables jsonb) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _scene_before()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _scene_holders(p_scene_id bigint)
    RETURNS TABLE(pid integer, application text, role text, since timestamp with time zone) LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _scene_holds_objects()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _scene_id(p_scene text)
    RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _scene_named(p_scene text)
    RETURNS TABLE(settings jsonb) LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _scene_or_branch(p_scene text)
    RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _scene_or_branch_to_change(p_scene text)
    RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _scene_settings(p_scene_id bigint)
    RETURNS jsonb LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _scene_state(p_scene text, OUT objects bigint, OUT pending bigint, OUT last_run_at timestamp with time zone, OUT last_error text, OUT is_current boolean, OUT remark text, OUT detected_at timestamp with time zone, OUT compared_at timestamp with time zone, OUT detection_helps boolean)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _scene_to_change(p_scene text)
    RETURNS bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _scenes()
    RETURNS TABLE(scene_id bigint, settings jsonb, areas bigint, tracks bigint, pending bigint, conflicts bigint, run_id bigint, finished_at timestamp with time zone, error text, is_current boolean, branch_of text) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _scheduled(p_scene_id bigint, p_only_waiting boolean, p_area_ids bigint[], p_track_ids bigint[])
    RETURNS TABLE(object_kind smallint, object_id bigint, version bigint, key text, schedule text, starts_us bigint, ends_us bigint, box bytea) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _scheduled_near(p_scene_id bigint, p_kinds smallint[], p_numbers bigint[], p_turns integer[], p_hulls bytea[], p_starts_us bigint[], p_ends_us bigint[], p_inclusive boolean[], p_floors_m double precision[], p_ceilings_m double precision[])
    RETURNS TABLE(key text) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _schedules_wait(p_scene_id bigint)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _schedules_within_s(p_scene_id bigint)
    RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _seal_batch(p_most integer, OUT edits bigint)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SECURITY DEFINER SET search_path=conflictdb, conflictdb_internal, pg_temp SET jit=off;

FUNCTION _seconds_to_comparison()
    RETURNS double precision LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _seen_areas(p_scene_id bigint)
    RETURNS SETOF area LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _seen_tracks(p_scene_id bigint)
    RETURNS SETOF track LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _series(p_angle double precision, p_coefficients double precision[])
    RETURNS double precision LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _service(OUT postgis_version text, OUT worker_count bigint)
    RETURNS record LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION _set_activations(p_scene_id bigint, p_kinds smallint[], p_ids bigint[], p_versions bigint[], p_spans tstzmultirange[], p_departures timestamp with time zone[], p_counts integer[], p_errors text[])
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _set_columns(p_name text, p_settings jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _set_expanded(p_scene_id bigint, p_from_us bigint, p_until_us bigint)
    RETURNS void LANGUAGE sql VOLATILE PARALLEL UNSAFE;

FUNCTION _set_scene(p_name text, p_settings jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _settings_of(p_scene anyelement)
    RETURNS jsonb LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET extra_float_digits=1;

FUNCTION _settle_branches(p_parent_id bigint, p_is_removal boolean)
    RETURNS void LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _shared_span(p_a tstzrange, p_b tstzrange, p_within_s double precision)
    RETURNS tstzrange LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _shares(p_scene text)
    RETURNS SETOF shares LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _shift(p_path geometry, p_departures timestamp with time zone[], p_at timestamp with time zone)
    RETURNS interval LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _short_identity(p_identity text)
    RETURNS text LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _shown(p_geometry geometry, p_plane text)
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _shown(p_instant timestamp with time zone)
    RETURNS text LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _shown(p_span tstzrange)
    RETURNS text LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _shown_heights(p_floor_m double precision, p_ceiling_m double precision)
    RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _shown_lack(p_within_s double precision, p_lacking_s double precision)
    RETURNS text LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _shown_rule(p_a_class text, p_b_class text)
    RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _shown_seconds(p_s double precision)
    RETURNS text LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _side_fits(p_side text, p_kind smallint, p_class text)
    RETURNS boolean LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _side_name(p_side text)
    RETURNS text LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _side_rank(p_side text)
    RETURNS integer LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _sides(p_a_class text, p_b_class text, OUT rank integer, OUT first text, OUT other text, OUT name text)
    RETURNS record LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _silent_after_s()
    RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _snapshot_of(p_xmax xid8, p_running xid8[])
    RETURNS pg_snapshot LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _some_areas(p_scene_id bigint, p_area_ids bigint[], OUT area_id bigint, OUT version bigint, OUT span_start timestamp with time zone, OUT span_end timestamp with time zone, OUT floor_m double precision, OUT ceiling_m double precision, OUT class_number bigint, OUT owner_number bigint, OUT footprint bytea, OUT activations bytea)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _some_tracks(p_scene_id bigint, p_track_ids bigint[], OUT track_id bigint, OUT version bigint, OUT floor_m double precision, OUT ceiling_m double precision, OUT grow_mps double precision, OUT class_number bigint, OUT owner_number bigint, OUT path bytea, OUT outline bytea, OUT outlines bytea, OUT floors_m bytea, OUT ceilings_m bytea, OUT departures bytea, OUT tolerances text)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _span_later(p_span tstzrange, p_by_s double precision)
    RETURNS tstzrange LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _span_of(p_text text)
    RETURNS tstzrange LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _spans_later(p_spans tstzmultirange, p_by_s double precision)
    RETURNS tstzmultirange LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _spans_of(p_text text)
    RETURNS tstzmultirange LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _sphere_m()
    RETURNS numeric LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _stage_attached(p_attachment attachment, p_problems text[], p_change_ids bigint[], p_is_full boolean, p_how text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET lock_timeout=10s;

FUNCTION _staged_tracks(p_is_waypoints boolean, p_has_times boolean, p_first bigint, p_last bigint)
    RETURNS TABLE(object_id bigint, key text, path geometry, outline geometry, floor_m double precision, ceiling_m double precision, name text, properties jsonb, grow_mps double precision, outlines geometry, floors_m double precision[], ceilings_m double precision[], class text, owner text, tolerances jsonb, departures timestamp with time zone[], schedule jsonb) LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _stamp_worker(p_worker_id uuid, p_pid integer)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _stays_simple(p_footprint geometry)
    RETURNS boolean LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _stored_differences(p_scene_id bigint, p_key text, p_horizon_us bigint, OUT key text, OUT starts_us bigint, OUT leaves_us bigint, OUT others text[], OUT low_us bigint[], OUT high_us bigint[], OUT is_proven boolean[])
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET jit=off;

FUNCTION _stored_horizon_us(p_scene_id bigint)
    RETURNS bigint LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _straying(p_scene_id bigint, OUT key text, OUT is_off boolean, OUT low_us bigint, OUT high_us bigint, OUT instant_us bigint, OUT lon double precision, OUT lat double precision, OUT height_m double precision, OUT error_m double precision, OUT fastest_mps double precision, OUT class text, OUT owner text)
    RETURNS SETOF record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan;

FUNCTION _stretch(p_from double precision, p_to double precision, p_earth text)
    RETURNS double precision LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _take_over_attached(p_attachment attachment, p_change_ids bigint[], OUT mapped bigint, OUT removed bigint, OUT unmapped bigint)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_nestloop=on SET jit=off;

FUNCTION _take_scene(p_scene_id bigint, p_wait_s double precision)
    RETURNS bigint LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _tile_bounds(p_z integer, p_x integer, p_y integer)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _tile_degrees(p_z integer, p_x integer, p_y integer)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _tile_height(p_params json, p_name text)
    RETURNS double precision LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _tile_measures(p_z integer, p_x integer, p_y integer, p_plane text, OUT bounds geometry, OUT shown geometry, OUT unit_m double precision, OUT unit_deg double precision, OUT plain_deg double precision, OUT large_deg double precision, OUT edge_deg double precision)
    RETURNS record LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _tile_objects(p_scene_id bigint, p_kind smallint, p_plane text, p_z integer, p_x integer, p_y integer, p_span tstzrange)
    RETURNS SETOF bigint LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION _tile_params(p_z integer, p_x integer, p_y integer, p_params json, OUT scene_id bigint, OUT scene text, OUT motion text, OUT earth text, OUT plane text, OUT span tstzrange, OUT instant timestamp with time zone, OUT verdicts text[], OUT floor_m double precision, OUT ceiling_m double precision)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _tile_plain(p_geometry geometry, p_box box3d, p_bounds geometry, p_unit_m double precision, p_unit_deg double precision)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _tile_shape(p_geometry geometry, p_z integer, p_x integer, p_y integer)
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _tile_time(p_params json, p_name text)
    RETURNS timestamp with time zone LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _tile_windows(p_z integer, p_x integer, p_y integer, p_plane text)
    RETURNS SETOF geometry LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _timed_path(p_who text, p_waypoints geometry, p_times timestamp with time zone[])
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _times_meet(p_a tstzrange, p_b tstzrange, p_within_s double precision)
    RETURNS boolean LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _to_micrometres(p_height_m double precision, p_more_m double precision)
    RETURNS double precision LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _to_plane(p_geometry geometry, p_plane text)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _track_before()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _track_reach_m(p_track track)
    RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _track_row(p_scene_id bigint, p_track_id bigint)
    RETURNS TABLE(track_id bigint, version bigint, floor_m double precision, ceiling_m double precision, grow_mps double precision, class_number bigint, owner_number bigint, path bytea, outline bytea, outlines bytea, floors_m bytea, ceilings_m bytea, departures bytea, tolerances text) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _track_span(p_track track)
    RETURNS tstzrange LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _tracks_inserted()
    RETURNS trigger LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _uncut_hull(p_scene scene, p_place geometry, p_reach_m double precision, p_wanted_m double precision)
    RETURNS geometry LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _uncut_pieces(p_scene_id bigint, p_wanted_m double precision, p_with_schedules boolean, p_span tstzrange)
    RETURNS SETOF piece LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _under_way(p_path geometry, p_departures timestamp with time zone[], p_tolerances jsonb, p_within_s double precision)
    RETURNS tstzrange LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _unheard(p_now_us bigint, p_step_us bigint, OUT scene_id bigint, OUT key text, OUT track_id bigint, OUT version bigint)
    RETURNS SETOF record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _unknown_tracks(p_scene text, p_keys text[])
    RETURNS SETOF text LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _unmapped(p_scene text)
    RETURNS SETOF unmapped LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _unseen_hidden(p_branch_id bigint, p_parent_id bigint)
    RETURNS TABLE(object_kind smallint, object_id bigint) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION _views_compared_at(p_scene_id bigint)
    RETURNS timestamp with time zone LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _voyages(p_path geometry, p_departures timestamp with time zone[])
    RETURNS TABLE(later interval) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _wait_class()
    RETURNS integer LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _wait_for_probe(p_probe_id bigint, p_timeout interval)
    RETURNS TABLE(plan_key text, kind smallint, key text, name text, verdict text, periods bytea, time_error_s double precision, first_contact_lon_deg double precision, first_contact_lat_deg double precision, closest_at timestamp with time zone, closest_m double precision, closest_error_m double precision, closest_a_lon_deg double precision, closest_a_lat_deg double precision, closest_b_lon_deg double precision, closest_b_lat_deg double precision, lacking_s double precision, certainty text) LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _wait_number(p_scene_id bigint)
    RETURNS integer LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION _waiting_scenes()
    RETURNS TABLE(scene text, waited_s double precision) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _wake_workers()
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _wanted_m(p_scene_id bigint)
    RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _warn_if_beyond_horizon(p_scene text, p_span tstzrange)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _warn_if_incomplete(p_scene text)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL RESTRICTED SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _warn_if_no_object(p_scene text, p_key text)
    RETURNS boolean LANGUAGE plpgsql STABLE PARALLEL RESTRICTED SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _watch_attached(p_attachment attachment, p_root oid, p_enables boolean)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _were_objects(p_kind smallint, p_ids bigint[], p_versions bigint[])
    RETURNS boolean LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET plan_cache_mode=force_generic_plan SET enable_hashjoin=off SET enable_mergejoin=off SET enable_seqscan=off SET jit=off;

FUNCTION _wgs84_m()
    RETURNS numeric LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _whole_height(p_who text, p_field text, p_given_m double precision, p_whole_m double precision, p_known_m double precision, p_is_changed boolean)
    RETURNS double precision LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION _widened(p_periods tstzmultirange, p_by_s double precision)
    RETURNS tstzmultirange LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _widened(p_span tstzrange, p_by_s double precision)
    RETURNS tstzrange LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _window(p_geometry geometry, p_plane text)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _windows_later(p_tolerances jsonb, p_delay_s double precision)
    RETURNS jsonb LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION _word_number(p_word text)
    RETURNS bigint LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _worker_count()
    RETURNS bigint LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION _wrapped(p_geometry geometry)
    RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE;

FUNCTION _writable_scenes()
    RETURNS SETOF bigint LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION _write_differences(p_scene_id bigint, p_track_id bigint[], p_other_kind smallint[], p_other_id bigint[], p_forbidden_us int8multirange[], p_proven_us int8multirange[])
    RETURNS void LANGUAGE sql VOLATILE PARALLEL UNSAFE;

FUNCTION _write_run(p_scene_id bigint, p_run_id bigint, p_run jsonb, p_is_last boolean, p_a_kind smallint[], p_a_id bigint[], p_a_version bigint[], p_b_kind smallint[], p_b_id bigint[], p_b_version bigint[], p_place tid[], p_digest bigint[], p_verdict text[], p_periods tstzmultirange[], p_region bytea[], p_first_contact_point bytea[], p_time_error_s double precision[], p_closest_at timestamp with time zone[], p_closest_m double precision[], p_closest_error_m double precision[], p_closest_a_point bytea[], p_closest_b_point bytea[], p_lacking_s double precision[], p_certainty text[], OUT run_id bigint, OUT opened bigint, OUT changed bigint, OUT closed bigint, OUT conflicts bigint, OUT unresolved bigint)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET enable_nestloop=off SET jit=off;

FUNCTION acknowledge(p_scene text, p_a_key text, p_b_key text, p_reason text, p_until timestamp with time zone DEFAULT NULL::timestamp with time zone, p_by text DEFAULT NULL::text)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION admit(p_scene text, p_plans jsonb, p_owner text DEFAULT NULL::text, p_allow_known boolean DEFAULT false, p_replace text[] DEFAULT '{}'::text[], OUT admitted boolean, OUT conflicts jsonb, OUT request_id bigint)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET plan_cache_mode=force_generic_plan SET max_parallel_workers_per_gather=0 SET enable_seqscan=off SET jit=off;

FUNCTION apply_proposal(p_proposal_id bigint, p_attached boolean DEFAULT false)
    RETURNS bigint LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION approaches_of(p_scene text, p_key text)
    RETURNS SETOF approaches LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION attach(p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval DEFAULT NULL::interval, p_again boolean DEFAULT false)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET lock_timeout=10s;

FUNCTION branch_conflicts(p_branch text)
    RETURNS TABLE(change text, a_key text, a_kind text, b_key text, b_kind text, verdict text, periods tstzmultirange, verdict_before text, periods_before tstzmultirange) LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION branch_objects(p_branch text)
    RETURNS TABLE(change text, key text, kind text, name text) LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET enable_seqscan=off SET jit=off;

FUNCTION candidates(p_scene text)
    RETURNS TABLE(a_key text, a_kind text, b_key text, b_kind text, spans tstzmultirange, region geometry) LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION circle(p_scene text, p_lon double precision, p_lat double precision, p_radius_m double precision)
    RETURNS geometry LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION conflict_history(p_scene text, p_key text, p_other_key text DEFAULT NULL::text)
    RETURNS SETOF conflict_events LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION conflicts_at(p_scene text, p_instant timestamp with time zone)
    RETURNS SETOF conflicts LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION conflicts_known_at(p_scene text, p_instant timestamp with time zone)
    RETURNS TABLE(conflict_id bigint, a_key text, a_kind text, b_key text, b_kind text, periods tstzmultirange, verdict text, time_error_s double precision, closest_at timestamp with time zone, closest_m double precision, closest_error_m double precision, opened_at timestamp with time zone, run_id bigint, acknowledged_by text, acknowledged_at timestamp with time zone, acknowledged_for text, acknowledged_until timestamp with time zone) LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION conflicts_of(p_scene text, p_key text)
    RETURNS SETOF conflicts LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION conflicts_of_class(p_scene text, p_class text)
    RETURNS SETOF conflicts LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION conflicts_within(p_scene text, p_geometry geometry, p_span tstzrange)
    RETURNS SETOF conflicts LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION copy_scene(p_scene text, p_name text)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION create_branch(p_scene text, p_name text, p_proposal_id bigint DEFAULT NULL::bigint)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION create_scene(p_name text, p_motion text DEFAULT NULL::text, p_earth text DEFAULT NULL::text, p_method text DEFAULT NULL::text, p_tolerance_m double precision DEFAULT NULL::double precision, p_separation_m double precision DEFAULT NULL::double precision, p_nearest_m double precision DEFAULT NULL::double precision, p_centre_lon double precision DEFAULT NULL::double precision, p_centre_lat double precision DEFAULT NULL::double precision, p_vertical_separation_m double precision DEFAULT NULL::double precision, p_time_separation_s double precision DEFAULT NULL::double precision, p_delays_within_s double precision DEFAULT NULL::double precision, p_intervals text DEFAULT NULL::text, p_horizon_days double precision DEFAULT NULL::double precision, p_vertical_datum text DEFAULT NULL::text, p_regions text DEFAULT NULL::text)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET extra_float_digits=1;

FUNCTION detach(p_scene text, p_table text, p_keep boolean DEFAULT false)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET lock_timeout=10s;

FUNCTION drop_branch(p_branch text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION explain_conflict(p_scene text, p_a text, p_b text)
    RETURNS jsonb LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION explain_conflict_text(p_scene text, p_a text, p_b text)
    RETURNS text LANGUAGE sql STABLE PARALLEL UNSAFE;

FUNCTION follow_attached(p_scene text)
    RETURNS TABLE("table" text, mapped bigint, removed bigint, unmapped bigint, error text) LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION give_scene(p_scene text, p_role text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION haven_at(p_scene text, p_key text, p_instant timestamp with time zone)
    RETURNS geometry LANGUAGE plpgsql STABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION havens(p_scene text, p_from timestamp with time zone, p_to timestamp with time zone, p_step interval)
    RETURNS TABLE(key text, at timestamp with time zone, haven geometry, floor_m double precision, ceiling_m double precision) LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION heights_at(p_scene text, p_key text, p_instant timestamp with time zone, OUT floor_m double precision, OUT ceiling_m double precision)
    RETURNS record LANGUAGE sql STABLE STRICT PARALLEL SAFE;

FUNCTION instant(p_text text)
    RETURNS timestamp with time zone LANGUAGE plpgsql IMMUTABLE STRICT PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION list_objects(p_scene text)
    RETURNS TABLE(key text, kind text, name text, start_at timestamp with time zone, end_at timestamp with time zone, floor_m double precision, ceiling_m double precision, class text, owner text, schedule jsonb) LANGUAGE sql STABLE PARALLEL SAFE;

FUNCTION merge_branch(p_branch text)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET jit=off;

FUNCTION preview_attachment(p_scene text, p_kind text, p_table regclass, p_map jsonb, p_every interval DEFAULT NULL::interval, p_objects integer DEFAULT 5, p_again boolean DEFAULT false)
    RETURNS TABLE(part text, what text) LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION preview_reattachment(p_scene text, p_table text, p_changes jsonb DEFAULT NULL::jsonb, p_to regclass DEFAULT NULL::regclass, p_every interval DEFAULT NULL::interval, p_objects integer DEFAULT 5)
    RETURNS TABLE(part text, what text) LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION probe(p_scene text, p_geometry geometry, p_span tstzrange DEFAULT tstzrange(NULL::timestamp with time zone, NULL::timestamp with time zone), p_floor_m double precision DEFAULT NULL::double precision, p_ceiling_m double precision DEFAULT NULL::double precision)
    RETURNS TABLE(key text, kind text, spans tstzmultirange, region geometry) LANGUAGE sql STABLE PARALLEL RESTRICTED;

FUNCTION proposal_changes(p_proposal_id bigint)
    RETURNS text[] LANGUAGE plpgsql STABLE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION proposal_statements(p_proposal_id bigint, p_undo boolean DEFAULT false)
    RETURNS TABLE(key text, attachment_id bigint, statement text) LANGUAGE plpgsql STABLE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION protect_scenes(p_on boolean DEFAULT true)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET lock_timeout=10s;

FUNCTION prune_edits(p_kept interval)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION prune_history(p_scene text, p_kept interval DEFAULT NULL::interval)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION put_area(p_scene text, p_key text, p_footprint geometry, p_active_span tstzrange DEFAULT NULL::tstzrange, p_floor_m double precision DEFAULT NULL::double precision, p_ceiling_m double precision DEFAULT NULL::double precision, p_name text DEFAULT NULL::text, p_properties jsonb DEFAULT '{}'::jsonb, p_class text DEFAULT NULL::text, p_owner text DEFAULT NULL::text, p_activations tstzmultirange DEFAULT NULL::tstzmultirange, p_schedule jsonb DEFAULT NULL::jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION put_rule(p_scene text, p_a_class text, p_b_class text, p_separation_m double precision DEFAULT NULL::double precision, p_vertical_m double precision DEFAULT NULL::double precision, p_time_s double precision DEFAULT NULL::double precision, p_allowed boolean DEFAULT false, p_yields text DEFAULT NULL::text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET extra_float_digits=1;

FUNCTION put_track(p_scene text, p_key text, p_path geometry, p_outline geometry, p_floor_m double precision DEFAULT NULL::double precision, p_ceiling_m double precision DEFAULT NULL::double precision, p_name text DEFAULT NULL::text, p_properties jsonb DEFAULT '{}'::jsonb, p_grow_mps double precision DEFAULT 0, p_outlines geometry DEFAULT NULL::geometry, p_floors_m double precision[] DEFAULT NULL::double precision[], p_ceilings_m double precision[] DEFAULT NULL::double precision[], p_class text DEFAULT NULL::text, p_owner text DEFAULT NULL::text, p_tolerances jsonb DEFAULT NULL::jsonb, p_departures timestamp with time zone[] DEFAULT NULL::timestamp with time zone[], p_schedule jsonb DEFAULT NULL::jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION reattach(p_scene text, p_table text, p_changes jsonb DEFAULT NULL::jsonb, p_to regclass DEFAULT NULL::regclass, p_every interval DEFAULT NULL::interval)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp SET lock_timeout=10s;

FUNCTION rectangle_outline(p_fore_m double precision, p_aft_m double precision, p_port_m double precision, p_starboard_m double precision)
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION remove_object(p_scene text, p_key text)
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION remove_rule(p_scene text, p_a_class text, p_b_class text)
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION remove_scene(p_scene text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION rename_object(p_scene text, p_key text, p_new_key text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION rename_scene(p_scene text, p_name text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION request_delays(p_scene text, p_key text, p_horizon interval DEFAULT '02:00:00'::interval, p_now timestamp with time zone DEFAULT NULL::timestamp with time zone, p_margin interval DEFAULT '00:00:00'::interval, p_margin_m double precision DEFAULT 0, p_from timestamp with time zone DEFAULT NULL::timestamp with time zone, p_to timestamp with time zone DEFAULT NULL::timestamp with time zone, p_best integer DEFAULT NULL::integer)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION request_detection(p_scene text, p_full boolean DEFAULT false)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION request_plans_probe(p_scene text, p_plans jsonb)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION request_probe(p_scene text, p_footprint geometry, p_active_span tstzrange DEFAULT NULL::tstzrange, p_floor_m double precision DEFAULT NULL::double precision, p_ceiling_m double precision DEFAULT NULL::double precision, p_key text DEFAULT NULL::text, p_class text DEFAULT NULL::text, p_owner text DEFAULT NULL::text)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION request_track_probe(p_scene text, p_path geometry, p_outline geometry, p_floor_m double precision DEFAULT NULL::double precision, p_ceiling_m double precision DEFAULT NULL::double precision, p_grow_mps double precision DEFAULT 0, p_key text DEFAULT NULL::text, p_class text DEFAULT NULL::text, p_owner text DEFAULT NULL::text)
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION seal_edits()
    RETURNS bigint LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION set_limit(p_name text, p_value double precision)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION share_scene(p_scene text, p_role text, p_access text DEFAULT 'read'::text)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION tile_areas(z integer, x integer, y integer, query_params json DEFAULT '{}'::json)
    RETURNS bytea LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION tile_conflicts(z integer, x integer, y integer, query_params json DEFAULT '{}'::json)
    RETURNS bytea LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION tile_havens(z integer, x integer, y integer, query_params json DEFAULT '{}'::json)
    RETURNS bytea LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION tile_tracks(z integer, x integer, y integer, query_params json DEFAULT '{}'::json)
    RETURNS bytea LANGUAGE plpgsql STABLE PARALLEL SAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION track_path(p_waypoints geometry, p_times timestamp with time zone[])
    RETURNS geometry LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE;

FUNCTION unacknowledge(p_scene text, p_a_key text, p_b_key text)
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION undo_proposal(p_proposal_id bigint, p_attached boolean DEFAULT false)
    RETURNS bigint LANGUAGE plpgsql VOLATILE STRICT PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION unshare_scene(p_scene text, p_role text)
    RETURNS boolean LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp;

FUNCTION verify_edits(OUT anchor bigint, OUT batches bigint, OUT edits bigint, OUT unsealed bigint, OUT first_wrong bigint, OUT reason text, OUT last_batch bigint, OUT last_digest text)
    RETURNS record LANGUAGE plpgsql STABLE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, pg_temp SET jit=off;

FUNCTION wait_for_admission(p_request_id bigint, p_timeout interval DEFAULT '00:01:00'::interval, OUT admitted boolean, OUT conflicts jsonb)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION wait_for_delays(p_probe_id bigint, p_timeout interval DEFAULT '00:01:00'::interval, OUT key text, OUT least_later_s double precision, OUT least_earlier_s double precision, OUT blocked_by text[], OUT forbidden jsonb, OUT waits boolean, OUT has_departed boolean, OUT earliest_s double precision, OUT latest_s double precision, OUT departs_at timestamp with time zone, OUT margin_s double precision, OUT margin_m double precision, OUT slots jsonb, OUT closed jsonb)
    RETURNS record LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION wait_for_plans_probe(p_probe_id bigint, p_timeout interval DEFAULT '00:01:00'::interval)
    RETURNS TABLE(plan_key text, key text, kind text, verdict text, periods tstzmultirange, first_contact timestamp with time zone, last_contact timestamp with time zone, time_error_s double precision, first_contact_point geometry, closest_at timestamp with time zone, closest_m double precision, closest_error_m double precision, lacking_s double precision, certainty text) LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION wait_for_probe(p_probe_id bigint, p_timeout interval DEFAULT '00:01:00'::interval)
    RETURNS TABLE(key text, kind text, verdict text, periods tstzmultirange, first_contact timestamp with time zone, last_contact timestamp with time zone, time_error_s double precision, first_contact_point geometry, closest_at timestamp with time zone, closest_m double precision, closest_error_m double precision, lacking_s double precision, certainty text) LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;

FUNCTION wait_until_current(p_scene text, p_timeout interval DEFAULT '00:01:00'::interval)
    RETURNS void LANGUAGE plpgsql VOLATILE PARALLEL UNSAFE SET search_path=conflictdb, conflictdb_internal, public, pg_temp;
