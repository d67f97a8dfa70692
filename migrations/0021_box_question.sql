-- Is the recording of the box that it is filed under? The still surroundings of recordings and boxes, the question to a person, and
-- the answer as an edit. A session whose question is open, or was answered with no, counts nowhere.

-- What stands still in the pictures on which a box's tapes were marked.
CREATE TABLE palette_surroundings (
    palette_id TEXT PRIMARY KEY REFERENCES palette (id) ON DELETE CASCADE,   -- the colours that were marked on these pictures
    picture    BLOB NOT NULL CHECK (length(picture) BETWEEN 3 AND 16386)     -- a small grey picture (Surroundings)
) STRICT, WITHOUT ROWID;

-- What stands still in a recording. It depends on the recording alone, so a session has one, however many results it has.
CREATE TABLE session_surroundings (
    session_id TEXT PRIMARY KEY REFERENCES session (id) ON DELETE CASCADE,   -- the session
    picture    BLOB NOT NULL CHECK (length(picture) BETWEEN 3 AND 16386)     -- a small grey picture (Surroundings)
) STRICT, WITHOUT ROWID;

-- Follows from the current result and the edits in force; set with each of them.
ALTER TABLE session ADD COLUMN box_question TEXT CHECK (box_question IN ('asked', 'this_box', 'other_box')); -- NULL: nothing speaks against its box
CREATE INDEX session_box_asked ON session (created_at_ms, id) WHERE box_question = 'asked';
-- The earlier sessions of a box count for its trocars only if they show the box.
DROP INDEX session_box_order;
CREATE INDEX session_box_order ON session (box_id, created_at_ms, id, box_question);

-- The edits with two more kinds, `this_box` and `other_box`. The table is made again under its own name, so that no view has to be
-- renamed.
CREATE TABLE session_edit_copy AS SELECT * FROM session_edit;
DROP TABLE session_edit;
-- An edit of a session, or an answer to the question for its box. Undone, it stays, with the person and the time.
CREATE TABLE session_edit (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- EditId
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- the session; erased with it
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the author; NULL: deleted, or an agent
    kind          TEXT NOT NULL CHECK (kind IN ('trim', 'swap', 'retime', 'set_aside', 'this_box', 'other_box')), -- what is changed or answered
    from_s        REAL CHECK (from_s BETWEEN 0 AND 86400),                   -- first second of the stretch, s; NULL: whole recording
    to_s          REAL CHECK (to_s > from_s AND to_s <= 86400),              -- last second of the stretch, s
    tools         TEXT CHECK (json_valid(tools)),                            -- the two tools that exchange names ([String])
    true_frame_rate_hz REAL CHECK (true_frame_rate_hz BETWEEN 1 AND 1000),   -- the true frame rate, Hz
    true_duration_s REAL CHECK (true_duration_s BETWEEN 0.1 AND 86400),      -- the true time from the first frame to the last, s
    why           TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),      -- the reason, in the author's words
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when made, epoch ms
    undone_by     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the person who undid it; NULL: in force, or deleted
    undone_at_ms  INTEGER CHECK (undone_at_ms >= created_at_ms),             -- when undone, epoch ms; NULL: it is in force
    CHECK ((kind IN ('trim', 'swap')) = (from_s IS NOT NULL)),
    CHECK ((from_s IS NULL) = (to_s IS NULL)),
    CHECK ((kind = 'swap') = (tools IS NOT NULL)),
    CHECK ((kind = 'retime') = (coalesce(true_frame_rate_hz, true_duration_s) IS NOT NULL)),
    CHECK (true_frame_rate_hz IS NULL OR true_duration_s IS NULL),
    CHECK (undone_by IS NULL OR undone_at_ms IS NOT NULL)
) STRICT;
INSERT INTO session_edit (id, session_id, person_id, kind, from_s, to_s, tools, true_frame_rate_hz, true_duration_s, why,
                          created_at_ms, undone_by, undone_at_ms)
    SELECT id, session_id, person_id, kind, from_s, to_s, tools, true_frame_rate_hz, true_duration_s, why,
           created_at_ms, undone_by, undone_at_ms
    FROM session_edit_copy;
DROP TABLE session_edit_copy;
CREATE INDEX session_edit_session ON session_edit (session_id, created_at_ms);
CREATE INDEX session_edit_person ON session_edit (person_id);
CREATE INDEX session_edit_undone_by ON session_edit (undone_by);
-- A session is set aside once at a time. Queries ask this index whether it counts, and must spell the condition alike.
CREATE UNIQUE INDEX session_set_aside ON session_edit (session_id) WHERE kind = 'set_aside' AND undone_at_ms IS NULL;
-- The question for the box has one answer at a time.
CREATE UNIQUE INDEX session_box_answer ON session_edit (session_id) WHERE kind IN ('this_box', 'other_box') AND undone_at_ms IS NULL;

-- The sessions that count nowhere: set aside by staff, asked about, or of another box.
CREATE VIEW uncounted_session (session_id) AS
    SELECT session_id FROM session_edit WHERE kind = 'set_aside' AND undone_at_ms IS NULL
    UNION ALL
    SELECT id FROM session WHERE box_question IN ('asked', 'other_box');

DROP VIEW assessed_session;
-- The sessions that count and have a result, with what statistics need of it.
CREATE VIEW assessed_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.tracker, session.recorded_at_ms, session.created_at_ms,
           result.id AS result_id, result.pipeline, result.calibration_id, result.tools, result.verdict
    FROM session JOIN current_result AS result ON result.session_id = session.id
    WHERE NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id);

DROP VIEW session_record;
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

DROP VIEW practised_session;
-- The sessions with what a trainee's progress shows of them.
CREATE VIEW practised_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.recorded_at_ms, session.video IS NOT NULL AS is_whole,
           NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id) AS counts,
           session.box_question, job.state AS job_state, result.id AS result_id, result.pipeline, result.calibration_id,
           result.verdict = 'refused' AS refused
    FROM session
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN current_result AS result ON result.session_id = session.id;
