-- Conflicts that were found before regions were stored say where they are after the next detection, which finds that
-- out thousands at a time. Until then their scenes wait for it, and say so: a null does not pass for no region.

SELECT _mark_all(s.scene_id) FROM scene s
WHERE EXISTS (SELECT FROM conflict c WHERE c.scene_id = s.scene_id AND c.region IS NULL AND c.verdict <> 'near');
