-- Where conflicts are that were found before regions were stored.

UPDATE conflict c
    SET region = _conflict_region(c.scene_id, c.a_kind, c.a_id, c.a_version, c.b_kind, c.b_id, c.b_version, c.periods,
                                  _plane(s.motion, s.earth, s.centre_lon, s.centre_lat))
    FROM scene s
    WHERE s.scene_id = c.scene_id AND c.region IS NULL AND c.verdict <> 'near';
