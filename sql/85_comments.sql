-- What tables and columns mean. Units: metres, degrees of longitude and latitude; heights above mean sea level.

COMMENT ON SCHEMA conflictdb IS
'Finds when and where moving and static areas interfere: scenes, areas, tracks and their conflicts.';
COMMENT ON SEQUENCE version_seq IS 'Versions of objects and numbers of marks: never the same twice.';

COMMENT ON TABLE scene IS 'Objects that are detected together, and the settings they share. Input.';
COMMENT ON COLUMN scene.scene_id IS 'Number within this database.';
COMMENT ON COLUMN scene.name IS 'Name, by which everybody refers to it.';
COMMENT ON COLUMN scene.motion IS 'How tracks and edges run between their points: rhumb, or great_circle.';
COMMENT ON COLUMN scene.earth IS 'Figure of the earth: wgs84, or sphere (mean radius 6371008.771415 m).';
COMMENT ON COLUMN scene.centre_lon IS
'great_circle: longitude of the place that all objects lie within 60 degrees of; null until there is one.';
COMMENT ON COLUMN scene.centre_lat IS 'great_circle: latitude of that place, degrees; null until there is one.';
COMMENT ON COLUMN scene.method IS
'Where a detection stops: screen (who might meet), exact (certified times), '
'nlp (certified times, found by the published program).';
COMMENT ON COLUMN scene.tolerance_m IS 'Closeness that is too close to call, metres.';
COMMENT ON COLUMN scene.separation_m IS
'Minimum distance wanted between polygons, metres; 0: they must touch to conflict.';

COMMENT ON COLUMN scene.nearest_m IS
'Pairs without conflict that come within this are kept with their closest approach, metres; 0: they are not.';

COMMENT ON TABLE area IS 'Polygons that are closed for a time. Input.';
COMMENT ON COLUMN area.area_id IS 'Number within this database.';
COMMENT ON COLUMN area.scene_id IS 'Scene it belongs to.';
COMMENT ON COLUMN area.key IS 'Id, unique among the areas and tracks of the scene.';
COMMENT ON COLUMN area.name IS 'What people call it; null if it has no name.';
COMMENT ON COLUMN area.footprint IS
'Longitude and latitude in degrees, longitudes may run on beyond 180; edges are straight in the scene''s plane.';
COMMENT ON COLUMN area.active_span IS 'When it is closed: [start, end), no bound where it has none.';
COMMENT ON COLUMN area.floor_m IS 'Lowest height, metres above mean sea level; null: no limit.';
COMMENT ON COLUMN area.ceiling_m IS 'First height above it, metres above mean sea level; null: no limit.';
COMMENT ON COLUMN area.properties IS 'What its source said beyond these.';
COMMENT ON COLUMN area.version IS 'A greater number whenever key, footprint, span or heights change.';
COMMENT ON COLUMN area.first_version IS
'The version it began with: pieces and conflicts of earlier ones are those of another area that had its number.';

COMMENT ON TABLE track IS 'Polygons carried along waypoints at constant speed on each leg. Input.';
COMMENT ON COLUMN track.track_id IS 'Number within this database.';
COMMENT ON COLUMN track.scene_id IS 'Scene it belongs to.';
COMMENT ON COLUMN track.key IS 'Id, unique among the areas and tracks of the scene.';
COMMENT ON COLUMN track.name IS 'What people call it; null if it has no name.';
COMMENT ON COLUMN track.path IS
'Waypoints: longitude and latitude in degrees, M the instant in Unix seconds, told apart to the microsecond.';
COMMENT ON COLUMN track.outline IS
'The haven: a convex ring about the reference point, x metres to starboard, y metres ahead. '
'One vertex repeated is a point, two a line.';
COMMENT ON COLUMN track.floor_m IS 'Lowest height, metres above mean sea level; null: no limit.';
COMMENT ON COLUMN track.ceiling_m IS 'First height above it, metres above mean sea level; null: no limit.';
COMMENT ON COLUMN track.floors_m IS
'Instead: the lowest height on each leg, metres; a null among them is no limit. floor_m is then the lowest of all.';
COMMENT ON COLUMN track.ceilings_m IS
'Instead: the first height above it on each leg, metres; a null among them is no limit. ceiling_m is then the highest.';
COMMENT ON COLUMN track.properties IS 'What its source said beyond these.';
COMMENT ON COLUMN track.version IS 'A greater number whenever key, path, outline, growth or heights change.';
COMMENT ON COLUMN track.first_version IS
'The version it began with: pieces and conflicts of earlier ones are those of another track that had its number.';
COMMENT ON COLUMN track.grow_mps IS
'Metres per second at which every side of the outline moves outward from the first waypoint''s time on; corners are '
'mitred. 0: it does not.';
COMMENT ON COLUMN track.outlines IS
'Instead: one outline per waypoint, of equally many vertices; on a leg each vertex moves straight and steadily. Null: '
'the outline stays, or grows.';

COMMENT ON TABLE object_key IS 'Keys in use: one key names one object of a scene, area or track. Kept by triggers.';
COMMENT ON COLUMN object_key.scene_id IS 'Scene.';
COMMENT ON COLUMN object_key.key IS 'Key of an area or track of it.';
COMMENT ON COLUMN object_key.object_kind IS '0 area, 1 track.';

COMMENT ON TABLE change IS
'Marks: objects that changed (or were removed) since the last detection. Made by triggers, deleted by detection.';
COMMENT ON COLUMN change.change_id IS 'Number of the mark, in the order they were made; after a restore some repeat.';
COMMENT ON COLUMN change.scene_id IS 'Scene of the object.';
COMMENT ON COLUMN change.object_kind IS '0 area, 1 track.';
COMMENT ON COLUMN change.object_id IS 'area_id or track_id.';
COMMENT ON COLUMN change.version IS 'Version the object got; of its own where it was removed or the settings changed.';
COMMENT ON COLUMN change.changed_at IS 'When the change was made.';
COMMENT ON COLUMN change.is_covered IS 'Whether the pieces reflect the change; its conflicts follow.';

COMMENT ON TABLE piece IS
'What objects are cut into for detection: a convex polygon, a time, heights, and a motion; or a bundle of such pieces '
'that lie near each other, with what they differ in as arrays. Derived; nobody edits it.';
COMMENT ON COLUMN piece.piece_id IS 'Number; a new one whenever the piece is another.';
COMMENT ON COLUMN piece.scene_id IS 'Scene of the object.';
COMMENT ON COLUMN piece.object_kind IS '0 area, 1 track.';
COMMENT ON COLUMN piece.object_id IS 'area_id or track_id.';
COMMENT ON COLUMN piece.version IS 'Version of the object it was made from.';
COMMENT ON COLUMN piece.pieces IS 'How many pieces it is; 1 unless it is a bundle.';
COMMENT ON COLUMN piece.part IS
'Number within the object, from 0, of the first of its pieces; a copy at the seam shares it.';
COMMENT ON COLUMN piece.turn IS '0; -1 for a copy one turn west, of a piece that reaches over longitude 180.';
COMMENT ON COLUMN piece.hull IS
'Convex hull of all the piece covers during its span, padded for what is too close: metres of the scene''s '
'plane (EPSG:3395 for rhumb on wgs84, else no SRID), shifted by turn. Of a bundle the box of all its hulls.';
COMMENT ON COLUMN piece.span IS 'When it is there; the end is inclusive between slices of a track.';
COMMENT ON COLUMN piece.floor_m IS 'Lowest height, metres; -infinity: no limit.';
COMMENT ON COLUMN piece.ceiling_m IS 'First height above it, metres; infinity: no limit.';
COMMENT ON COLUMN piece.shape IS
'Areas: the exact convex part, metres of the plane, not shifted. Tracks: the outline at the start '
'of the leg, metres to starboard and ahead. Null of bundles of areas.';
COMMENT ON COLUMN piece.shape_to IS 'Tracks: the same vertices at the end of the leg; null where they stay.';
COMMENT ON COLUMN piece.leg_start IS 'Tracks: start of the leg it is a slice of; null of areas and bundles.';
COMMENT ON COLUMN piece.leg_end IS 'Tracks: end of the leg; null of areas and bundles.';
COMMENT ON COLUMN piece.start_lon_deg IS
'Tracks: longitude at the start of the leg, degrees, not shifted; null of areas and bundles.';
COMMENT ON COLUMN piece.start_lat_deg IS
'Tracks: latitude at the start of the leg, degrees; null of areas and bundles.';
COMMENT ON COLUMN piece.end_lon_deg IS
'Tracks: longitude at the end of the leg, degrees, running on from its start; null of areas and bundles.';
COMMENT ON COLUMN piece.end_lat_deg IS 'Tracks: latitude at the end of the leg, degrees; null of areas and bundles.';
COMMENT ON COLUMN piece.bearing_deg IS
'Tracks: heading of the haven, degrees clockwise from north; null of areas and bundles.';
COMMENT ON COLUMN piece.parts IS
'Numbers of the pieces of a bundle, in the order in which it has them; null of one piece.';
COMMENT ON COLUMN piece.hulls IS 'Hulls of the pieces of a bundle; null of one piece.';
COMMENT ON COLUMN piece.shapes IS 'Shapes of the parts of a bundle; null of one piece and of slices, which share one.';
COMMENT ON COLUMN piece.cuts IS
'When the slices of a bundle begin, and the last ends; each ends, inclusive, when the next begins. Null of one piece '
'and of areas.';
COMMENT ON COLUMN piece.leg_times IS
'Start and end of the leg of each slice of a bundle; null of one piece and of areas.';
COMMENT ON COLUMN piece.legs IS
'Of each slice of a bundle longitude and latitude at the start and at the end of its leg, and the bearing; null of one '
'piece and of areas.';
COMMENT ON TABLE run IS
'Detections that were done, with settings, pairs left after each stage, and seconds each stage took.';
COMMENT ON COLUMN run.run_id IS 'Number of the run.';
COMMENT ON COLUMN run.scene_id IS 'Scene.';
COMMENT ON COLUMN run.started_at IS 'When it began.';
COMMENT ON COLUMN run.finished_at IS 'When it had written its results, or failed.';
COMMENT ON COLUMN run.method IS 'Method (see scene.method).';
COMMENT ON COLUMN run.settings IS
'All settings it worked with, and counts of its work: projected_pairs is the pairs of pieces that stage 3 worked on.';
COMMENT ON COLUMN run.objects IS 'Areas and tracks of the scene.';
COMMENT ON COLUMN run.candidate_pairs IS 'Pairs of pieces after stage 1; null if the run failed.';
COMMENT ON COLUMN run.intersecting_pairs IS 'Pairs of pieces after stage 2; null if the run failed.';
COMMENT ON COLUMN run.window_pairs IS
'Pairs of pieces that stage 3 leaves, which shows the others apart, and pairs of areas; null if the run failed.';
COMMENT ON COLUMN run.solved_pairs IS 'Pairs of pieces that stage 4 decided; null if the run failed.';
COMMENT ON COLUMN run.conflicts IS 'Conflicts of the scene after the run; null if it failed.';
COMMENT ON COLUMN run.unresolved IS 'Of these, how many are unresolved; null if the run failed.';
COMMENT ON COLUMN run.opened IS 'Conflicts that were not there before; null if the run failed.';
COMMENT ON COLUMN run.changed IS
'Conflicts with other periods, by more than they are uncertain by, another verdict or another key than before; null if '
'the run failed.';
COMMENT ON COLUMN run.closed IS 'Conflicts that are no more; null if the run failed.';
COMMENT ON COLUMN run.pieces_s IS 'Seconds spent on pieces; null if the run failed.';
COMMENT ON COLUMN run.stage1_s IS 'Seconds spent in stage 1, broad phase; null if the run failed.';
COMMENT ON COLUMN run.stage2_s IS 'Seconds spent in stage 2, intersection; null if the run failed.';
COMMENT ON COLUMN run.stage3_s IS
'Seconds spent in stage 3: in closed form (exact), or projecting regions (nlp); null if the run failed.';
COMMENT ON COLUMN run.stage4_s IS 'Seconds spent in stage 4, solver; null if the run failed.';
COMMENT ON COLUMN run.write_s IS 'Seconds spent writing results; null if the run failed.';
COMMENT ON COLUMN run.error IS 'Why it failed; null if it did not.';

COMMENT ON TABLE conflict IS
'Pairs that interfere or come near, as the last detection found them. Derived; query the views conflicts, approaches.';
COMMENT ON COLUMN conflict.scene_id IS 'Scene of both objects.';
COMMENT ON COLUMN conflict.run_id IS 'Run that wrote the row: later ones found the same.';
COMMENT ON COLUMN conflict.a_kind IS 'First object: 0 area, 1 track. The area comes first, else the smaller key.';
COMMENT ON COLUMN conflict.a_id IS 'First object: area_id or track_id; it may have been removed since.';
COMMENT ON COLUMN conflict.a_version IS 'First object: version that was detected.';
COMMENT ON COLUMN conflict.a_key IS 'First object: key.';
COMMENT ON COLUMN conflict.b_kind IS 'Second object: 0 area, 1 track.';
COMMENT ON COLUMN conflict.b_id IS 'Second object: area_id or track_id; it may have been removed since.';
COMMENT ON COLUMN conflict.b_version IS 'Second object: version that was detected.';
COMMENT ON COLUMN conflict.b_key IS 'Second object: key.';
COMMENT ON COLUMN conflict.periods IS 'When they interfere, bounds inclusive; empty for pairs that are only near.';
COMMENT ON COLUMN conflict.verdict IS
'conflict: they meet; grazing: too close to call within the tolerance; unresolved: neither proven apart nor decided; '
'near: no conflict, but within the scene''s nearest_m. Each detection of the pair decides anew.';
COMMENT ON COLUMN conflict.region IS
'Where, longitude and latitude: see the view conflicts; null for pairs that are only near.';
COMMENT ON COLUMN conflict.first_contact_point IS
'Where they first touch, longitude and latitude; null if not computed.';
COMMENT ON COLUMN conflict.method IS 'Method that found it.';
COMMENT ON COLUMN conflict.time_error_s IS 'Bound on the error of every end of every period, seconds.';
COMMENT ON COLUMN conflict.found_at IS 'When the pair was first found to interfere, or to come near.';
COMMENT ON COLUMN conflict.closest_at IS
'Closest approach: when, the first time if more than once; null if not computed, or for areas that are always there.';
COMMENT ON COLUMN conflict.closest_m IS
'Closest approach: least distance, metres on the earth, 0 if they touch; null if not computed.';
COMMENT ON COLUMN conflict.closest_error_m IS
'Closest approach: how far from closest_m the least distance may be, metres; null if not computed.';
COMMENT ON COLUMN conflict.closest_a_point IS
'Closest approach: nearest point of the first object, longitude and latitude; null if not computed.';
COMMENT ON COLUMN conflict.closest_b_point IS
'Closest approach: nearest point of the second object, longitude and latitude; null if not computed.';
COMMENT ON COLUMN conflict.digest IS
'Digest of the row without its region, and of the settings that it was found under; 0 where that is not known. Found '
'again with the same digest, a row is not written again.';

COMMENT ON COLUMN conflict.conflict_id IS
'Number of the conflict from opening to closing; a pair that is only near has one of its own.';
COMMENT ON COLUMN conflict.changed_at IS 'When it last changed (conflict_event); null if it never did.';
COMMENT ON COLUMN conflict.told_periods IS
'The periods that its last event told, where those of the row differ by less than they are uncertain by; else null.';

COMMENT ON SEQUENCE conflict_seq IS 'Numbers of conflicts: never the same twice.';
COMMENT ON TABLE conflict_event IS
'What became of conflicts: written by detections, pruned by prune_history. Query the view conflict_events.';
COMMENT ON COLUMN conflict_event.conflict_event_id IS 'Number of the event; in a scene they become visible in order.';
COMMENT ON COLUMN conflict_event.scene_id IS 'Scene.';
COMMENT ON COLUMN conflict_event.run_id IS 'Run that found it.';
COMMENT ON COLUMN conflict_event.conflict_id IS 'Number of the conflict.';
COMMENT ON COLUMN conflict_event.kind IS 'opened, changed or closed.';
COMMENT ON COLUMN conflict_event.at IS 'When the run began to write, one instant for all its events.';
COMMENT ON COLUMN conflict_event.opened_at IS 'When the conflict opened.';
COMMENT ON COLUMN conflict_event.a_kind IS 'First object: 0 area, 1 track.';
COMMENT ON COLUMN conflict_event.a_key IS 'First object: key.';
COMMENT ON COLUMN conflict_event.b_kind IS 'Second object: 0 area, 1 track.';
COMMENT ON COLUMN conflict_event.b_key IS 'Second object: key.';
COMMENT ON COLUMN conflict_event.periods IS 'When they interfere; of a conflict that closed, as known before.';
COMMENT ON COLUMN conflict_event.verdict IS 'Verdict; of a conflict that closed, as known before.';
COMMENT ON COLUMN conflict_event.time_error_s IS 'Bound on the error of every end of every period, seconds.';
COMMENT ON COLUMN conflict_event.closest_at IS 'Closest approach: when; null if not computed, or always so.';
COMMENT ON COLUMN conflict_event.closest_m IS 'Closest approach: least distance, metres; null if not computed.';
COMMENT ON COLUMN conflict_event.closest_error_m IS
'Closest approach: bound on its error, metres; null if not computed.';

COMMENT ON TABLE history IS 'How far back what was known of a scene is kept.';
COMMENT ON COLUMN history.scene_id IS 'Scene.';
COMMENT ON COLUMN history.first_run_id IS
'What was known before this run had finished is not kept; null: all of it is.';
COMMENT ON COLUMN history.pruned_at IS 'When what is too old was last removed.';
COMMENT ON COLUMN scene.owner IS
'The role that it belongs to: at first that which made it; null in a database from before this was kept. It matters '
'once scenes are protected (protect_scenes).';

COMMENT ON TABLE scene_share IS 'The roles that scenes are shared with. The view shares shows them.';
COMMENT ON COLUMN scene_share.scene_id IS 'Scene.';
COMMENT ON COLUMN scene_share.role IS 'Name of the role; public is every role.';
COMMENT ON COLUMN scene_share.may_write IS 'Whether it may change the scene, not only read it.';
COMMENT ON COLUMN scene_share.shared_by IS 'Who shared it.';
COMMENT ON COLUMN scene_share.shared_at IS 'When that was.';

COMMENT ON COLUMN scene.history_kept IS
'How long history of its conflicts is kept; null: as the setting conflictdb.history_kept says, else 30 days.';

COMMENT ON TABLE acknowledgement IS 'What of conflicts was acknowledged. Query the view acknowledgements.';
COMMENT ON COLUMN acknowledgement.acknowledgement_id IS 'Number.';
COMMENT ON COLUMN acknowledgement.scene_id IS 'Scene.';
COMMENT ON COLUMN acknowledgement.conflict_id IS 'Number of the conflict, which may have closed.';
COMMENT ON COLUMN acknowledgement.acknowledged_by IS 'User of the database who did.';
COMMENT ON COLUMN acknowledgement.acknowledged_at IS 'When.';
COMMENT ON COLUMN acknowledgement.reason IS 'Why.';
COMMENT ON COLUMN acknowledgement.until IS 'Until when it holds; null: while the conflict lasts.';
COMMENT ON COLUMN acknowledgement.a_key IS 'First object: key then.';
COMMENT ON COLUMN acknowledgement.b_key IS 'Second object: key then.';
COMMENT ON COLUMN acknowledgement.periods IS 'What was acknowledged: periods.';
COMMENT ON COLUMN acknowledgement.verdict IS 'What was acknowledged: verdict.';
COMMENT ON COLUMN acknowledgement.time_error_s IS 'What was acknowledged: bound on the error of periods, seconds.';
COMMENT ON COLUMN acknowledgement.closest_m IS 'What was acknowledged: least distance, metres; null if not computed.';
COMMENT ON COLUMN acknowledgement.closest_error_m IS
'What was acknowledged: bound on its error, metres; null if not computed.';
COMMENT ON COLUMN acknowledgement.ended_by IS 'Who took it back, or replaced it; null if nobody did.';
COMMENT ON COLUMN acknowledgement.ended_at IS 'When; null if nobody took it back or replaced it.';

COMMENT ON TABLE scene_lock IS
'One row per scene that was ever detected: a detection locks it until its transaction ends. Only workers can.';
COMMENT ON COLUMN scene_lock.scene_id IS 'The scene.';
COMMENT ON COLUMN scene_lock.taken IS 'How often the lock was taken and work was done under it.';

COMMENT ON TABLE attachment IS 'Tables of others that are attached to scenes. The view attachments shows them.';
COMMENT ON COLUMN attachment.attachment_id IS 'Number; names of triggers and of the function have it.';
COMMENT ON COLUMN attachment.scene_id IS 'Scene, which cannot be removed before.';
COMMENT ON COLUMN attachment.object_kind IS 'What its rows become: 0 area, 1 track.';
COMMENT ON COLUMN attachment.table_schema IS 'Schema of the table.';
COMMENT ON COLUMN attachment.table_name IS 'Name of the table.';
COMMENT ON COLUMN attachment.map IS 'For each field, the column or expression as it was given.';
COMMENT ON COLUMN attachment.identity_columns IS
'The columns that the key is made of: they tell the rows of its objects apart.';
COMMENT ON COLUMN attachment.has_triggers IS 'Whether triggers note its changes.';
COMMENT ON COLUMN attachment.every IS 'How often all its rows are compared.';
COMMENT ON COLUMN attachment.attached_at IS 'When it was attached.';
COMMENT ON COLUMN attachment.compared_at IS 'When all its rows were last compared; null if they never were.';
COMMENT ON COLUMN attachment.failed_at IS 'When it could not be read, last; null if it could.';
COMMENT ON COLUMN attachment.error IS 'Why it could not be read; null if it could.';

COMMENT ON TABLE attached_change IS
'Notes of changes of attached tables, made by triggers on them, deleted when their rows are taken over.';
COMMENT ON COLUMN attached_change.attached_change_id IS 'Number of the note.';
COMMENT ON COLUMN attached_change.attachment_id IS 'Attachment; it may be gone.';
COMMENT ON COLUMN attached_change.identities IS
'Of the rows that changed, before and after, the columns that tell them apart, as texts of an array; null: of any.';
COMMENT ON COLUMN attached_change.changed_at IS 'When the change was made.';

COMMENT ON TABLE attached_object IS
'What was made of the rows of attached tables: an object, or a reason why there is none (view unmapped).';
COMMENT ON COLUMN attached_object.attachment_id IS 'Attachment.';
COMMENT ON COLUMN attached_object.identity IS 'What the columns that tell rows apart hold, as texts of an array.';
COMMENT ON COLUMN attached_object.hash IS
'Of the columns of its rows that the map uses: other rows have another one; null if there is none.';
COMMENT ON COLUMN attached_object.key IS 'Key that the rows give; null if there is none.';
COMMENT ON COLUMN attached_object.object_id IS 'area_id or track_id of the object; null if there never was one.';
COMMENT ON COLUMN attached_object.version IS
'Version of the object when it was made of its rows; null if there is none.';
COMMENT ON COLUMN attached_object.reason IS
'Why the rows as they are now could not be made an object; null if they were.';
COMMENT ON COLUMN attached_object.is_taken IS
'Whether that is because its key is taken: it is tried again when the key is free.';
COMMENT ON COLUMN attached_object.since IS 'Since when that is so.';
