-- Comments of tables and columns. Heights are metres above the vertical datum; longitude and latitude are degrees.

COMMENT ON SCHEMA conflictdb IS
'Detects when and where moving and static areas conflict: scenes, areas, tracks and their conflicts.';
COMMENT ON SCHEMA conflictdb_internal IS 'Private routines of conflictdb; other releases have other ones.';
COMMENT ON SEQUENCE version_seq IS 'Versions of objects and of marks; never reused.';

COMMENT ON TABLE scene IS 'Objects that are detected together, and their settings. Input.';
COMMENT ON COLUMN scene.scene_id IS 'Id within this database.';
COMMENT ON COLUMN scene.name IS 'Unique name.';
-- Comments of the settings: sql/65_scenes.sql.

COMMENT ON TABLE area IS 'Polygons that are closed for a time. Input.';
COMMENT ON COLUMN area.area_id IS 'Id within this database.';
COMMENT ON COLUMN area.scene_id IS 'Scene of the area.';
COMMENT ON COLUMN area.key IS 'Id, unique among the areas and tracks of the scene.';
/* area plain: COMMENT ON COLUMN area.NAME IS DOC; but floor_m = but ceiling_m = but schedule = */
COMMENT ON COLUMN area.name IS 'Display name; null: none.';
COMMENT ON COLUMN area.class IS 'Class that separation rules name; null: none.';
COMMENT ON COLUMN area.owner IS 'Owner, whose objects are not compared with each other; null: none.';
/* end */
COMMENT ON COLUMN area.footprint IS
'Longitude and latitude, degrees; longitudes may exceed 180. Edges are straight in the scene''s plane.';
COMMENT ON COLUMN area.activations IS
'When it is closed, if several times: spans [start, end) within active_span. With a schedule: its expansion, null '
'until a detection makes it. Null without a schedule: active_span alone.';
COMMENT ON COLUMN area.schedule IS
'When it is closed within active_span, as written (JSON as in scene files); null: none.';
COMMENT ON COLUMN track.departures IS
'When its voyages depart, if several: the path, moved so that it begins then. With a schedule: its expansion, null '
'until a detection makes it. Null without a schedule: one voyage, at the times of the path.';
COMMENT ON COLUMN track.schedule IS 'When it departs: the starts of a schedule (JSON as in scene files); null: none.';
COMMENT ON COLUMN area.schedule_error IS
'Why its schedule is not understood, as the last detection says: its pairs are unresolved; null: it is, or there is '
'none.';
COMMENT ON COLUMN track.schedule_error IS
'Why its schedule is not understood, as the last detection says: its pairs are unresolved; null: it is, or there is '
'none.';
COMMENT ON COLUMN scene.expanded IS 'The time for which schedules are expanded; null: none is.';
COMMENT ON COLUMN area.active_span IS 
'When it is closed: [start, end); a missing bound is unbounded. With activations it holds all of them.';
COMMENT ON COLUMN area.floor_m IS 'Lowest height, metres above the vertical datum, inclusive; null: no limit.';
COMMENT ON COLUMN area.ceiling_m IS 'Highest height, metres above the vertical datum, exclusive; null: no limit.';
COMMENT ON COLUMN area.properties IS 'Additional data of its source, a JSON object.';
COMMENT ON COLUMN area.version IS 'Increases whenever key, footprint, span, heights, class or owner change.';
COMMENT ON COLUMN area.first_version IS
'Version at insertion. Pieces and conflicts of lower versions belong to a former area with the same area_id.';

COMMENT ON TABLE track IS 'Havens carried along waypoints at constant speed on each leg. Input.';
COMMENT ON COLUMN track.track_id IS 'Id within this database.';
COMMENT ON COLUMN track.scene_id IS 'Scene of the track.';
COMMENT ON COLUMN track.key IS 'Id, unique among the areas and tracks of the scene.';
/* track plain: COMMENT ON COLUMN track.NAME IS DOC; but floor_m = but ceiling_m = but grow_mps =
   but tolerances = but schedule = */
COMMENT ON COLUMN track.name IS 'Display name; null: none.';
COMMENT ON COLUMN track.class IS 'Class that separation rules name; null: none.';
COMMENT ON COLUMN track.owner IS 'Owner, whose objects are not compared with each other; null: none.';
/* end */
COMMENT ON COLUMN track.path IS
'Waypoints: longitude and latitude in degrees, M in Unix seconds, precise to the microsecond.';
COMMENT ON COLUMN track.outline IS
'The haven at the first waypoint: a convex ring about the reference point, x metres to starboard, y metres ahead. '
'One vertex repeated is a point, two are a line.';
COMMENT ON COLUMN track.floor_m IS
'Lowest height, metres above the vertical datum, inclusive; null: no limit. With floors_m their least.';
COMMENT ON COLUMN track.ceiling_m IS
'Highest height, metres above the vertical datum, exclusive; null: no limit. With ceilings_m their greatest.';
COMMENT ON COLUMN track.floors_m IS
'Lowest heights, metres, inclusive: one per leg, or one per waypoint, linear in between; a null element: no limit. '
'Null: floor_m applies to all legs.';
COMMENT ON COLUMN track.tolerances IS
'How far voyages may differ from the plan, members as in scene files; null: not at all. Detections protect a haven '
'that contains every such voyage; haven_at, tiles and the map show the plan and the ship.';
COMMENT ON COLUMN track.ceilings_m IS
'Highest heights, metres, exclusive: one per leg, or one per waypoint, linear in between; a null element: no limit. '
'Null: ceiling_m applies to all legs.';
COMMENT ON COLUMN track.properties IS 'Additional data of its source, a JSON object.';
COMMENT ON COLUMN track.version IS 'Increases whenever key, path, outline, growth, heights, class or owner change.';
COMMENT ON COLUMN track.first_version IS
'Version at insertion. Pieces and conflicts of lower versions belong to a former track with the same track_id.';
COMMENT ON COLUMN track.grow_mps IS
'Speed at which every side of the outline moves outward from the first waypoint''s time on, metres per second, with '
'mitred corners; 0: no growth.';
COMMENT ON COLUMN track.outlines IS
'One outline per waypoint, each with the same number of vertices; vertices move linearly along a leg. Null: outline '
'applies to all waypoints, with grow_mps.';

COMMENT ON TABLE object_key IS 'Keys in use, unique within a scene across areas and tracks. Maintained by triggers.';
COMMENT ON COLUMN object_key.scene_id IS 'Scene.';
COMMENT ON COLUMN object_key.key IS 'Key of an area or track of the scene.';
COMMENT ON COLUMN object_key.object_kind IS '0 area, 1 track.';

COMMENT ON TABLE change IS
'Marks: objects changed or removed since the last detection. Triggers insert them, detection deletes them.';
COMMENT ON COLUMN change.change_id IS 'Number of the mark, in order of insertion; may repeat after a restore.';
COMMENT ON COLUMN change.scene_id IS 'Scene of the object.';
COMMENT ON COLUMN change.with_number IS
'Only pairs with objects of this class or kind (_word_number) changed, by a separation rule; null: all pairs.';
COMMENT ON COLUMN change.object_kind IS '0 area, 1 track.';
COMMENT ON COLUMN change.object_id IS 'area_id or track_id.';
COMMENT ON COLUMN change.version IS
'The object''s version after the change; a new number if it was removed or the scene''s settings changed.';
COMMENT ON COLUMN change.changed_at IS 'When the change was made.';
COMMENT ON COLUMN change.is_covered IS 'Whether the pieces include the change; its conflicts may not yet.';

COMMENT ON TABLE piece IS
'Convex parts of objects, each with a time span, height band and motion. A row is one piece, or a bundle: nearby '
'pieces of one object, with arrays of the attributes that differ. Derived; do not edit.';
COMMENT ON COLUMN piece.piece_id IS 'Id; new whenever the row is replaced.';
COMMENT ON COLUMN piece.scene_id IS 'Scene of the object.';
COMMENT ON COLUMN piece.object_kind IS '0 area, 1 track.';
COMMENT ON COLUMN piece.object_id IS 'area_id or track_id.';
COMMENT ON COLUMN piece.version IS 'Version of the object from which it was computed.';
COMMENT ON COLUMN piece.pieces IS 'Number of pieces in the row; 1 unless it is a bundle.';
COMMENT ON COLUMN piece.part IS
'Number of the first piece within the object, from 0; a copy across the antimeridian has the same number.';
COMMENT ON COLUMN piece.turn IS '0; -1 for a copy, one turn to the west, of a piece that crosses longitude 180.';
COMMENT ON COLUMN piece.hull IS
'Convex hull swept during the span, padded by tolerance and separation: metres of the scene''s plane (EPSG:3395 for '
'rhumb on wgs84, else no SRID), shifted by turn. For a bundle: bounding box of all hulls.';
/* plan pieces: COMMENT ON COLUMN piece.NAME_number IS 'Number of the NAME of the object (_word_number), 0 without.'; */
COMMENT ON COLUMN piece.class_number IS 'Number of the class of the object (_word_number), 0 without.';
COMMENT ON COLUMN piece.owner_number IS 'Number of the owner of the object (_word_number), 0 without.';
/* end */
COMMENT ON COLUMN piece.span IS 'Time span; the end is inclusive between slices of a track.';
COMMENT ON COLUMN piece.floor_m IS 'Lowest height, metres; -infinity: no limit.';
COMMENT ON COLUMN piece.ceiling_m IS 'Highest height, metres, exclusive; infinity: no limit.';
COMMENT ON COLUMN piece.shape IS
'Areas: the exact convex part, metres of the plane, not shifted; null for bundles. Tracks: the outline at the start of '
'the leg, metres to starboard and ahead.';
COMMENT ON COLUMN piece.shape_to IS 'Tracks: the outline at the end of the leg, same vertices; null if it is constant.';
COMMENT ON COLUMN piece.leg_start IS 'Tracks: start of the leg; null for areas and bundles.';
COMMENT ON COLUMN piece.leg_end IS 'Tracks: end of the leg; null for areas and bundles.';
COMMENT ON COLUMN piece.start_lon_deg IS
'Tracks: longitude at the start of the leg, degrees, not shifted; null for areas and bundles.';
COMMENT ON COLUMN piece.start_lat_deg IS
'Tracks: latitude at the start of the leg, degrees; null for areas and bundles.';
COMMENT ON COLUMN piece.end_lon_deg IS
'Tracks: longitude at the end of the leg, degrees, not wrapped relative to the start; null for areas and bundles.';
COMMENT ON COLUMN piece.end_lat_deg IS 'Tracks: latitude at the end of the leg, degrees; null for areas and bundles.';
COMMENT ON COLUMN piece.bearing_deg IS
'Tracks: heading of the haven, degrees clockwise from north; null for areas and bundles.';
COMMENT ON COLUMN piece.parts IS
'Bundles: numbers of the pieces, in the order of the other arrays; null for one piece.';
COMMENT ON COLUMN piece.hulls IS 'Bundles: hull of each piece; null for one piece.';
COMMENT ON COLUMN piece.shapes IS 'Bundles of areas: shape of each piece; null for tracks and for one piece.';
COMMENT ON COLUMN piece.cuts IS
'Bundles of tracks: start of each slice, then the end of the last; a slice ends, inclusive, when the next starts. Null '
'for areas and for one piece.';
COMMENT ON COLUMN piece.leg_times IS
'Bundles of tracks: start and end of each slice''s leg; null for areas and for one piece.';
COMMENT ON COLUMN piece.climb IS
'Floor at the start and the end of the leg, then the ceilings, metres; linear in between. Null: heights are constant.';
COMMENT ON COLUMN piece.legs IS
'Bundles of tracks: for each slice, longitude and latitude at the start and at the end of its leg, and the bearing, '
'degrees; null for areas and for one piece.';
COMMENT ON TABLE run IS
'Detections, with settings, pairs left after each stage, and seconds of each stage.';
COMMENT ON COLUMN run.run_id IS 'Id of the run.';
COMMENT ON COLUMN run.scene_id IS 'Scene.';
COMMENT ON COLUMN run.started_at IS 'When it started.';
COMMENT ON COLUMN run.finished_at IS 'When it wrote its results, or failed.';
COMMENT ON COLUMN run.method IS 'Method (see scene.method).';
COMMENT ON COLUMN run.settings IS
'All settings of the run, and the work done: projected_pairs counts the pairs of pieces in stage 3.';
COMMENT ON COLUMN run.objects IS 'Number of areas and tracks of the scene.';
COMMENT ON COLUMN run.candidate_pairs IS 'Pairs of pieces after stage 1; null if the run failed.';
COMMENT ON COLUMN run.intersecting_pairs IS 'Pairs of pieces after stage 2; null if the run failed.';
COMMENT ON COLUMN run.window_pairs IS
'Pairs of pieces that stage 3 leaves, which shows the others apart, and pairs of areas; null if the run failed.';
COMMENT ON COLUMN run.solved_pairs IS 'Pairs of pieces that stage 4 decided; null if the run failed.';
COMMENT ON COLUMN run.conflicts IS 'Conflicts of the scene after the run; null if it failed.';
COMMENT ON COLUMN run.unresolved IS
'Unresolved pairs among the conflicts of the scene after the run; null if the run failed.';
COMMENT ON COLUMN run.opened IS 'New conflicts; null if the run failed.';
COMMENT ON COLUMN run.changed IS
'Conflicts whose verdict or a key changed, or whose periods changed by more than their error; null if the run failed.';
COMMENT ON COLUMN run.closed IS 'Conflicts that ended; null if the run failed.';
COMMENT ON COLUMN run.pieces_s IS 'Seconds spent on pieces; null if the run failed.';
COMMENT ON COLUMN run.stage1_s IS 'Seconds spent in stage 1, broad phase; null if the run failed.';
COMMENT ON COLUMN run.stage2_s IS 'Seconds spent in stage 2, intersection; null if the run failed.';
COMMENT ON COLUMN run.stage3_s IS
'Seconds spent in stage 3: in closed form (exact), or projecting regions (nlp); null if the run failed.';
COMMENT ON COLUMN run.stage4_s IS 'Seconds spent in stage 4, solver; null if the run failed.';
COMMENT ON COLUMN run.write_s IS 'Seconds spent writing results; null if the run failed.';
COMMENT ON COLUMN run.error IS 'Why it failed; null if it succeeded.';

COMMENT ON TABLE conflict IS
'Pairs that conflict or come near, from the last detection. Derived; query the views conflicts and approaches.';
COMMENT ON COLUMN conflict.scene_id IS 'Scene of both objects.';
COMMENT ON COLUMN conflict.a_kind IS 'First object: 0 area, 1 track. The area is first, else the smaller key.';
COMMENT ON COLUMN conflict.a_id IS 'First object: area_id or track_id; may have been removed since.';
COMMENT ON COLUMN conflict.a_version IS 'First object: version used by the detection.';
COMMENT ON COLUMN conflict.b_kind IS 'Second object: 0 area, 1 track.';
COMMENT ON COLUMN conflict.b_id IS 'Second object: area_id or track_id; may have been removed since.';
COMMENT ON COLUMN conflict.b_version IS 'Second object: version used by the detection.';
COMMENT ON COLUMN conflict.periods IS 'When they conflict, bounds inclusive; empty for pairs that are only near.';
COMMENT ON COLUMN conflict.verdict IS
'conflict: they meet; grazing: within the tolerance of the limit; unresolved: neither proven apart nor decided; '
'near: no conflict, but within the scene''s nearest_m. Every detection of the pair decides afresh.';
COMMENT ON COLUMN conflict.region IS
'Where, longitude and latitude: see the view conflicts; null for pairs that are only near.';
COMMENT ON COLUMN conflict.method IS 'Method that found it (see scene.method).';
COMMENT ON COLUMN conflict.found_at IS 'When the pair was first found in conflict or near.';
COMMENT ON COLUMN conflict.digest IS
'Digest of the row without region, and of the settings; 0: unknown. Detection does not rewrite a row with an equal '
'digest.';

COMMENT ON COLUMN conflict.conflict_id IS
'Id from opening to closing; a pair that is only near has its own.';
COMMENT ON COLUMN conflict.changed_at IS 'Time of its last change event (conflict_event); null if it never changed.';
COMMENT ON COLUMN conflict.told_periods IS
'Periods of its last event, if those of the row differ by less than their error; else null.';

COMMENT ON SEQUENCE conflict_seq IS 'Ids of conflicts; never reused.';
COMMENT ON TABLE conflict_event IS
'History of conflicts, written by detections and pruned by prune_history. Query the view conflict_events.';
COMMENT ON COLUMN conflict_event.conflict_event_id IS 'Id; events of a scene become visible in this order.';
COMMENT ON COLUMN conflict_event.scene_id IS 'Scene.';
COMMENT ON COLUMN conflict_event.conflict_id IS 'Id of the conflict.';
COMMENT ON COLUMN conflict_event.kind IS 'opened, changed or closed.';
COMMENT ON COLUMN conflict_event.at IS 'When the run started to write; equal for all its events.';
COMMENT ON COLUMN conflict_event.opened_at IS 'When the conflict opened.';
COMMENT ON COLUMN conflict_event.a_kind IS 'First object: 0 area, 1 track.';
COMMENT ON COLUMN conflict_event.b_kind IS 'Second object: 0 area, 1 track.';
COMMENT ON COLUMN conflict_event.periods IS 'When they conflict; for a closed conflict the last known periods.';
COMMENT ON COLUMN conflict_event.verdict IS 'Verdict; for a closed conflict the last known one.';
COMMENT ON COLUMN conflict_event.proposal_id IS
'The proposal whose application, or its undoing, caused the event; else null.';

COMMENT ON TABLE history IS 'Start of the stored history of each scene.';
COMMENT ON COLUMN history.scene_id IS 'Scene.';
COMMENT ON COLUMN history.first_run_id IS
'First run of the stored history; earlier answers were pruned. Null: nothing was pruned.';
COMMENT ON COLUMN history.pruned_at IS 'When history was last pruned.';
COMMENT ON COLUMN scene.owner IS
'Role that owns the scene, initially its creator; null in databases older than this column. Used once scenes are '
'protected (protect_scenes).';

COMMENT ON TABLE scene_share IS 'Roles with access to shared scenes. Query the view shares.';
COMMENT ON COLUMN scene_share.scene_id IS 'Scene.';
COMMENT ON COLUMN scene_share.role IS 'Name of the role; public: every role.';
COMMENT ON COLUMN scene_share.may_write IS 'Whether the role may change the scene; otherwise it may only read.';
COMMENT ON COLUMN scene_share.shared_by IS 'Role that shared it.';
COMMENT ON COLUMN scene_share.shared_at IS 'When it was shared.';

COMMENT ON COLUMN scene.history_kept IS
'How long the history of conflicts is kept; null: the setting conflictdb.history_kept, default 30 days.';

COMMENT ON TABLE acknowledgement IS 'Acknowledgements of conflicts. Query the view acknowledgements.';
COMMENT ON COLUMN acknowledgement.acknowledgement_id IS 'Id.';
COMMENT ON COLUMN acknowledgement.scene_id IS 'Scene.';
COMMENT ON COLUMN acknowledgement.conflict_id IS 'Id of the conflict, which may have closed.';
COMMENT ON COLUMN acknowledgement.acknowledged_by IS 'Database user who acknowledged it.';
COMMENT ON COLUMN acknowledgement.given_name IS
'Name given with it, where several people share a user; null: none. Not verified.';
COMMENT ON COLUMN acknowledgement.acknowledged_at IS 'When it was acknowledged.';
COMMENT ON COLUMN acknowledgement.reason IS 'Reason given by the user.';
COMMENT ON COLUMN acknowledgement.until IS 'Expiry; null: valid while the conflict lasts.';
COMMENT ON COLUMN acknowledgement.a_key IS 'Key of the first object at that time.';
COMMENT ON COLUMN acknowledgement.b_key IS 'Key of the second object at that time.';
COMMENT ON COLUMN acknowledgement.periods IS 'Acknowledged periods.';
COMMENT ON COLUMN acknowledgement.verdict IS 'Acknowledged verdict.';
COMMENT ON COLUMN acknowledgement.time_error_s IS 'Error bound of the acknowledged periods, seconds.';
COMMENT ON COLUMN acknowledgement.closest_m IS 'Acknowledged least distance, metres; null if not computed.';
COMMENT ON COLUMN acknowledgement.closest_error_m IS
'Error bound of the acknowledged least distance, metres; null if not computed.';
COMMENT ON COLUMN acknowledgement.ended_by IS 'User who withdrew or replaced it; null while in force.';
COMMENT ON COLUMN acknowledgement.ended_at IS 'When it was withdrawn or replaced; null if it was not.';

COMMENT ON TABLE admission_lock IS
'One row per scene with admissions: an admission locks it until its transaction ends.';
COMMENT ON COLUMN admission_lock.scene_id IS 'Scene.';
COMMENT ON COLUMN admission_lock.taken IS 'Number of transactions that took the lock and committed.';
COMMENT ON TABLE scene_lock IS
'One row per scene that was ever detected: a detection locks it for its transaction. Only workers may lock it.';
COMMENT ON COLUMN scene_lock.scene_id IS 'Scene.';
COMMENT ON COLUMN scene_lock.taken IS 'Number of transactions that took the lock and committed.';

COMMENT ON TABLE attachment IS 'Tables attached to scenes. Query the view attachments.';
COMMENT ON COLUMN attachment.attachment_id IS 'Id, part of the names of its triggers and function.';
COMMENT ON COLUMN attachment.scene_id IS 'Scene; it cannot be removed while the table is attached.';
COMMENT ON COLUMN attachment.object_kind IS 'Kind of the objects made from its rows: 0 area, 1 track.';
COMMENT ON COLUMN attachment.table_schema IS 'Schema of the table when it was last followed (attached_relation).';
COMMENT ON COLUMN attachment.table_name IS 'Name of the table when it was last followed (attached_relation).';
COMMENT ON COLUMN attachment.map IS 'The column or expression of each field, as given.';
COMMENT ON COLUMN attachment.identity_columns IS
'Columns that the key is computed from; rows with equal values form one object.';
COMMENT ON COLUMN attachment.has_triggers IS 'Whether triggers record changes of the table.';
COMMENT ON COLUMN attachment.every IS 'Interval between comparisons of all rows.';
COMMENT ON COLUMN attachment.attached_at IS 'When it was attached.';
COMMENT ON COLUMN attachment.compared_at IS 'When all rows were last compared; null: never.';
COMMENT ON COLUMN attachment.comparison_s IS 'Seconds that the last comparison of all rows took; null: never.';
COMMENT ON COLUMN attachment.failed_at IS 'When reading it last failed; null if the last attempt succeeded.';
COMMENT ON COLUMN attachment.error IS 'Why reading it failed; null if the last attempt succeeded.';

COMMENT ON TABLE attached_relation IS
'The table of each attachment, whatever its name, and with triggers its partitions and children. Dumps write names.';
COMMENT ON COLUMN attached_relation.attachment_id IS 'Attachment.';
COMMENT ON COLUMN attached_relation.relation IS 'Table, partition or child; it may have been dropped since.';
COMMENT ON COLUMN attached_relation.is_root IS 'Whether it is the attached table itself.';

COMMENT ON TABLE attached_change IS
'Changes of attached tables, recorded by triggers; deleted when the rows are taken over.';
COMMENT ON COLUMN attached_change.attached_change_id IS 'Id.';
COMMENT ON COLUMN attached_change.attachment_id IS 'Attachment; may have been removed.';
COMMENT ON COLUMN attached_change.identities IS
'Values of the identity columns of the changed rows, before and after, as texts of arrays; null: any row may have '
'changed.';
COMMENT ON COLUMN attached_change.changed_at IS 'When the change was made.';

COMMENT ON TABLE attached_object IS
'Result of each group of attached rows: an object, or the reason why there is none (view unmapped).';
COMMENT ON COLUMN attached_object.attachment_id IS 'Attachment.';
COMMENT ON COLUMN attached_object.identity IS 'Values of the identity columns, as the text of an array.';
COMMENT ON COLUMN attached_object.identity_json IS
'The same by name of the column, as JSON: numbers and truth values as such, all others as text; null if there was '
'never an object.';
COMMENT ON COLUMN attached_object.hash IS
'Hash of the mapped columns of its rows; null if there are no rows.';
COMMENT ON COLUMN attached_object.key IS 'Key computed from the rows; null if there is none.';
COMMENT ON COLUMN attached_object.object_id IS 'area_id or track_id of the object; null if there never was one.';
COMMENT ON COLUMN attached_object.version IS
'Version of the object when it was made from its rows; null if there is none.';
COMMENT ON COLUMN attached_object.reason IS
'Why the current rows do not make an object; null if they do.';
COMMENT ON COLUMN attached_object.is_taken IS
'Whether another object has its key; it is retried when the key is free.';
COMMENT ON COLUMN attached_object.since IS 'When the object was last made, or since when it cannot be made.';
