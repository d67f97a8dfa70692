-- Sessions are moved to the right trainee, task or box. A result, a job and an answer to the question for the box belong to one box:
-- while a session is filed under another box, they do not count, and they count again when it is moved back.

-- A session that was moved. One that is moved back has two rows.
CREATE TABLE session_move (
    id              TEXT PRIMARY KEY CHECK (length(id) = 36),                -- MoveId
    session_id      TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE, -- the session; erased with it
    person_id       TEXT REFERENCES person (id) ON DELETE SET NULL,          -- who moved it; NULL: deleted, or the service
    from_trainee_id TEXT REFERENCES trainee (id) ON DELETE SET NULL,         -- the trainee before; NULL: erased
    to_trainee_id   TEXT REFERENCES trainee (id) ON DELETE SET NULL,         -- the trainee after; NULL: erased
    from_task_id    TEXT REFERENCES task (id) ON DELETE SET NULL,            -- the task before; NULL: deleted
    to_task_id      TEXT REFERENCES task (id) ON DELETE SET NULL,            -- the task after; NULL: deleted
    from_box_id     TEXT REFERENCES training_box (id) ON DELETE SET NULL,    -- the box before; NULL: deleted
    to_box_id       TEXT REFERENCES training_box (id) ON DELETE SET NULL,    -- the box after; NULL: deleted
    changes         TEXT NOT NULL CHECK (json_valid(changes)),               -- what was changed: of `trainee`, `task`, `box` ([String])
    why             TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),    -- the reason, in the person's words
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0)              -- when, epoch ms
) STRICT;
CREATE INDEX session_move_session ON session_move (session_id);
CREATE INDEX session_move_person ON session_move (person_id);
CREATE INDEX session_move_from_trainee ON session_move (from_trainee_id);
CREATE INDEX session_move_to_trainee ON session_move (to_trainee_id);
CREATE INDEX session_move_from_task ON session_move (from_task_id);
CREATE INDEX session_move_to_task ON session_move (to_task_id);
CREATE INDEX session_move_from_box ON session_move (from_box_id);
CREATE INDEX session_move_to_box ON session_move (to_box_id);

-- The reason of a move may contain names, and a session that was moved keeps the comments of the trainee before.
CREATE TRIGGER trainee_leaves_no_words BEFORE DELETE ON trainee BEGIN
    UPDATE session_move SET why = '–' WHERE OLD.id IN (from_trainee_id, to_trainee_id);
    DELETE FROM comment WHERE person_id IN (SELECT person.id FROM person WHERE person.trainee_id = OLD.id);
END;

-- The question for the box has one answer at a time for each box.
ALTER TABLE session_edit ADD COLUMN box_id TEXT REFERENCES training_box (id) ON DELETE SET NULL; -- of `this_box` and `other_box`: for which box; NULL: of another kind, or the box was deleted
UPDATE session_edit SET box_id = (SELECT box_id FROM session WHERE session.id = session_edit.session_id)
WHERE kind IN ('this_box', 'other_box');
CREATE INDEX session_edit_box ON session_edit (box_id) WHERE box_id IS NOT NULL;
DROP INDEX session_box_answer;
CREATE UNIQUE INDEX session_box_answer ON session_edit (session_id, box_id) WHERE kind IN ('this_box', 'other_box') AND undone_at_ms IS NULL;

-- The camera that a job measures with, from its input.
ALTER TABLE job ADD COLUMN calibration_id TEXT AS (iif(json_valid(input), json_extract(input, '$.calibration'), NULL));

DROP VIEW assessed_session;
DROP VIEW session_record;
DROP VIEW practised_session;
DROP VIEW current_result;
DROP VIEW tracking_job;

-- The current result of each session: the latest that was measured with a camera of its box, or by another program.
CREATE VIEW current_result AS
    SELECT result.*, json_extract(result.quality, '$.verdict') AS verdict FROM result
    WHERE result.rowid =
        (SELECT max(latest.rowid) FROM result AS latest
         WHERE latest.session_id = result.session_id
           AND (latest.calibration_id IS NULL
                OR (SELECT box_id FROM calibration WHERE calibration.id = latest.calibration_id)
                   = (SELECT box_id FROM session WHERE session.id = result.session_id)));

-- The job that determines each session's status: the latest that tracks it with a camera of its box, or imports it. A job that only
-- scores again (`turn` 2) does not count, since the session keeps its result even if that job fails.
CREATE VIEW tracking_job AS
    SELECT job.* FROM job
    WHERE job.rowid =
        (SELECT max(latest.rowid) FROM job AS latest
         WHERE latest.session_id = job.session_id AND latest.turn < 2
           AND (latest.calibration_id IS NULL
                OR (SELECT box_id FROM calibration WHERE calibration.id = latest.calibration_id)
                   = (SELECT box_id FROM session WHERE session.id = job.session_id)));

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
