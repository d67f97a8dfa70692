-- What is newest is what was stored last. Times do not decide: a clock that was set back would hide all later results. The number
-- of a row grows with each one that is stored.

DROP VIEW assessed_session;
DROP VIEW session_record;
DROP VIEW practised_session;
DROP VIEW current_result;
DROP VIEW tracking_job;
DROP INDEX result_latest;
CREATE INDEX result_latest ON result (session_id); -- its entries of one session are in the order of their rows
DROP INDEX job_session;
CREATE INDEX job_session ON job (session_id); -- likewise

-- The current result of each session: the latest.
CREATE VIEW current_result AS
    SELECT result.*, json_extract(result.quality, '$.verdict') AS verdict FROM result
    WHERE result.rowid = (SELECT max(latest.rowid) FROM result AS latest WHERE latest.session_id = result.session_id);

-- The job that determines each session's status: the latest that tracks or imports it. A job that only scores again (`turn` 2) does not
-- count, since the session keeps its result even if that job fails.
CREATE VIEW tracking_job AS
    SELECT job.* FROM job
    WHERE job.rowid = (SELECT max(latest.rowid) FROM job AS latest WHERE latest.session_id = job.session_id AND latest.turn < 2);

-- The sessions that count and have a result, with what statistics need of it.
CREATE VIEW assessed_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.tracker, session.recorded_at_ms, session.created_at_ms,
           result.id AS result_id, result.pipeline, result.calibration_id, result.tools, result.verdict
    FROM session JOIN current_result AS result ON result.session_id = session.id
    WHERE NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id);

-- The sessions with all that a list of sessions shows.
CREATE VIEW session_record AS
    SELECT session.id, session.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           trainee.handedness AS trainee_handedness,
           session.task_id, task.name AS task_name, task.code AS task_code,
           session.box_id, training_box.name AS box_name, training_box.code AS box_code,
           session.filename, session.media_type, session.video, blob.bytes AS video_bytes, session.tracker,
           session.recorded_at_ms, session.created_at_ms,
           job.id AS job_id, job.state AS job_state, job.progress AS job_progress, job.problem AS job_problem,
           EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) AS is_set_aside,
           session.box_question,
           EXISTS (SELECT 1 FROM calibration WHERE calibration.box_id = session.box_id) AS box_has_camera,
           EXISTS (SELECT 1 FROM palette WHERE palette.box_id = session.box_id) AS box_has_palette
    FROM session
    JOIN trainee ON trainee.id = session.trainee_id
    JOIN task ON task.id = session.task_id
    JOIN training_box ON training_box.id = session.box_id
    LEFT JOIN blob ON blob.hash = session.video
    LEFT JOIN tracking_job AS job ON job.session_id = session.id;

-- The sessions with what a trainee's progress shows of them. `arrival` grows with each session that arrives.
CREATE VIEW practised_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.recorded_at_ms, session.rowid AS arrival,
           session.video IS NOT NULL AS is_whole,
           NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id) AS counts,
           session.box_question, job.state AS job_state, result.id AS result_id, result.pipeline, result.calibration_id,
           result.verdict = 'refused' AS refused
    FROM session
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN current_result AS result ON result.session_id = session.id;
