"""Run SQL. No other module does: each statement calls one routine of sql/, or is a COPY to or from one."""

from typing import TYPE_CHECKING

from conflictdb.exports import exports

if TYPE_CHECKING:
    from conflictdb.store.acknowledging import (
        EndedAcknowledgement,
        acknowledge,
        acknowledgements_ended,
        counted_conflicts,
        unacknowledge,
    )
    from conflictdb.store.admissions import (
        StoredObject,
        admission,
        objects_near,
        read_objects,
        replaced_objects,
        scheduled_keys_near,
        settings_of_last_admission,
    )
    from conflictdb.store.attached import (
        READ_WITHIN_S,
        Attaching,
        Attachment,
        AttachmentPreview,
        Reattaching,
        Unmapped,
        attach,
        attachment_failed,
        attachments,
        attachments_to_follow,
        detach,
        follow_attachment,
        preview_attachment,
        rewatch_attachment,
        seconds_to_comparison,
        unmapped,
    )
    from conflictdb.store.branches import (
        BranchDiff,
        ConflictChange,
        ObjectChange,
        create_branch,
        diff_branch,
        drop_branch,
        drop_orphans,
        follow_parent,
        merge_branch,
        parent_name,
    )
    from conflictdb.store.connection import (
        LOCK_WAIT_S,
        ON_OUR_TABLE,
        begin_snapshot,
        connect,
        join,
        lock_holders,
        naming_grants,
        require_detecting,
        require_idle,
        require_writable,
        snapshot,
        transaction,
        translated,
        waiting_at_most,
    )
    from conflictdb.store.detections import (
        Pending,
        are_covered,
        changed_areas,
        changed_tracks,
        cover_all,
        footprints,
        order_of_all,
        pending,
        replace_pieces,
    )
    from conflictdb.store.edits import Audit, seal_edits, seal_some_edits, verify_edits
    from conflictdb.store.few import Begun, Few, begin_detection, put_pieces, seen_tracks, some_areas, some_tracks
    from conflictdb.store.fit_connections import forget_fit, is_fit, note_fit
    from conflictdb.store.listing import (
        RunStatus,
        Selection,
        approaches,
        conflict_events,
        conflicts,
        conflicts_known_at,
        each_approach,
        each_conflict,
        explain_conflict,
        explained_text,
        names,
        runs,
        scene_state,
        state_within,
        wait_until_current,
    )
    from conflictdb.store.live_rows import (
        Alarm,
        Following,
        Heard,
        LiveConflict,
        LiveTrack,
        Straying,
        Unheard,
        are_keys_stale,
        end_alarms,
        following,
        insert_positions,
        is_behind,
        live,
        live_conflicts,
        live_states,
        new_positions,
        open_alarms,
        prune_positions,
        put_alarms,
        put_live,
        replanned,
        silent_after_s,
        straying,
        unheard,
        unknown_tracks,
    )
    from conflictdb.store.locking import SAY_AFTER_S, Say, begin_locked, longest_wait_s
    from conflictdb.store.map_rows import (
        TILES,
        changes,
        hear_changes,
        map_areas,
        map_conflicts,
        map_live,
        map_overview,
        map_shapes,
        map_tracks,
        may_acknowledge,
        may_edit,
        never_write,
        tile,
    )
    from conflictdb.store.object_state_rows import ObjectStates, cover, object_states
    from conflictdb.store.proposal_rows import (
        apply_proposal,
        proposal_basis,
        proposed,
        put_proposal,
        undo_proposal,
    )
    from conflictdb.store.remedies import with_remedy
    from conflictdb.store.scenes import (
        ObjectSummary,
        SceneStatus,
        copy_scene,
        is_scene,
        list_objects,
        list_scenes,
        put_rule,
        read_settings,
        remove_objects,
        remove_rule,
        remove_scene,
        rename_object,
        rename_scene,
        scene_id,
        scene_or_branch_id,
        scene_settings,
        set_scene,
        waiting_scenes,
    )
    from conflictdb.store.service_rows import (
        HEARD_WITHIN_S,
        WORKER_NAME,
        SceneAlarm,
        Service,
        WorkerStamp,
        listen,
        map_dsn,
        scene_alarms,
        service,
        wait_for_change,
        worker_dsn,
        writers_notify,
    )
    from conflictdb.store.sharing import Share, protect_scenes, share_scene, shares, unshare_scene
    from conflictdb.store.snapshot_readers import Shared, firsts, numbered, query, require_state, shared_snapshot
    from conflictdb.store.stored_differences import (
        first_stops,
        forget_differences,
        rows_to_compare,
        stored_delays,
        write_differences,
    )
    from conflictdb.store.stored_objects import (
        LoadCounts,
        Numbered,
        changing_heights,
        each_object,
        plan_rows,
        put_plans,
        put_rows,
        read_sample,
        read_scene,
        replace_scene,
        replace_scene_by_parts,
    )
    from conflictdb.store.stored_pairs import Candidates, Marks, Parts, boxes, bundles, candidates
    from conflictdb.store.stored_probes import (
        Request,
        answer_admission,
        answer_delays,
        answer_probe,
        claim_probe,
        hold_probe,
        keys_meeting,
        names_of,
        pieces_meeting,
        probe_failed,
        read_request,
        refuse_probe,
        release_probe,
        request_probe,
        wait_for_probe,
    )
    from conflictdb.store.stored_schedules import (
        Scheduled,
        horizon,
        scheduled,
        store_activations,
        store_window,
        stored_window,
    )
    from conflictdb.store.write_rows import (
        RunOutcome,
        RunRecord,
        Staged,
        begin_write,
        differing,
        end_write,
        record_failure,
        stage,
    )

__getattr__ = exports(__name__, __file__)
