-- Jobs of pg_cron that ask for detections; a worker does them. To be run in the database of pg_cron (cron.database_name),
-- which conflictdb is in.

-- Whatever waits, every minute: also where a notification was lost.
SELECT cron.schedule('conflictdb: what waits', '* * * * *',
                     'SELECT conflictdb.request_detection(scene) FROM conflictdb.queue');

-- Everything again, at night.
SELECT cron.schedule('conflictdb: everything', '30 3 * * *',
                     'SELECT conflictdb.request_detection(scene, true) FROM conflictdb.scenes');
