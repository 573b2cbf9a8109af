-- Conflicts from before regions were stored get their region in the next detection. Marking their scenes makes them
-- pending, so that a null region is not mistaken for none.

SELECT _mark_all(s.scene_id) FROM scene s
WHERE EXISTS (SELECT FROM conflict c WHERE c.scene_id = s.scene_id AND c.region IS NULL AND c.verdict <> 'near');
