-- A recording with two attempts is cut into two sessions. Both have the same file; a trim limits each to its part.

-- A session that is a part of a cut recording has no file of its own: the rule that a trainee, task and box have a recording once holds for
-- `whole_video`, which such a part lacks.
DROP VIEW blob_reference;
DROP VIEW practised_session;
DROP VIEW session_outcome;
DROP VIEW session_record;
DROP INDEX session_video;
DROP TRIGGER session_leaves_no_waiting_recording;
ALTER TABLE session RENAME COLUMN video TO whole_video;
ALTER TABLE session ADD COLUMN video TEXT REFERENCES blob (hash) ON DELETE RESTRICT; -- the recording; NULL: it is still arriving
ALTER TABLE session ADD COLUMN is_part INTEGER NOT NULL DEFAULT 0 CHECK (is_part IN (0, 1)); -- 1: made by a cut, with the video of another session
ALTER TABLE session ADD COLUMN cut_of TEXT CHECK (length(cut_of) = 36); -- SessionId that the recording arrived as, also once that session was erased; NULL: this one
UPDATE session SET video = whole_video;
CREATE INDEX session_video ON session (video);
CREATE INDEX session_whole_video ON session (whole_video);
CREATE INDEX session_cut_of ON session (cut_of) WHERE cut_of IS NOT NULL;
CREATE TRIGGER session_has_whole_video AFTER INSERT ON session WHEN NEW.is_part = 0 AND NEW.video IS NOT NULL BEGIN
    UPDATE session SET whole_video = NEW.video WHERE id = NEW.id;
END;
CREATE TRIGGER session_gets_whole_video AFTER UPDATE OF video ON session WHEN NEW.is_part = 0 BEGIN
    UPDATE session SET whole_video = NEW.video WHERE id = NEW.id;
END;

-- A session that is erased does not leave its recording without a name.
CREATE TRIGGER session_leaves_no_waiting_recording AFTER DELETE ON session WHEN OLD.video IS NOT NULL BEGIN
    DELETE FROM waiting_recording WHERE video = OLD.video;
END;

-- A cut of a recording. One row for each, also after the parts were joined.
CREATE TABLE session_cut (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                    -- CutId
    first_id       TEXT REFERENCES session (id) ON DELETE SET NULL,             -- the session with the part before the cut; NULL: erased
    second_id      TEXT REFERENCES session (id) ON DELETE SET NULL,             -- the session with the part after it; NULL: erased, or joined
    first_edit_id  TEXT REFERENCES session_edit (id) ON DELETE SET NULL,        -- the trim of the first part
    second_edit_id TEXT REFERENCES session_edit (id) ON DELETE SET NULL,        -- the trim of the second part
    at_s           REAL NOT NULL CHECK (at_s > 0 AND at_s < 86400),             -- where it was cut, s of the recording
    person_id      TEXT REFERENCES person (id) ON DELETE SET NULL,              -- who cut it; NULL: deleted, or the service
    why            TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),        -- the reason, in the person's words
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),                 -- when, epoch ms
    joined_by      TEXT REFERENCES person (id) ON DELETE SET NULL,              -- who joined the parts; NULL: cut, deleted, or the service
    joined_at_ms   INTEGER CHECK (joined_at_ms >= created_at_ms)                -- when, epoch ms; NULL: it is cut
) STRICT;
CREATE INDEX session_cut_first ON session_cut (first_id);
CREATE INDEX session_cut_second ON session_cut (second_id);
CREATE INDEX session_cut_first_edit ON session_cut (first_edit_id);
CREATE INDEX session_cut_second_edit ON session_cut (second_edit_id);
CREATE INDEX session_cut_person ON session_cut (person_id);
CREATE INDEX session_cut_joined_by ON session_cut (joined_by);

-- The reason of a cut may contain names, and nothing is left of a cut without its parts.
CREATE TRIGGER trainee_leaves_no_reasons BEFORE DELETE ON trainee BEGIN
    UPDATE session_cut SET why = '–'
    WHERE EXISTS (SELECT 1 FROM session WHERE session.trainee_id = OLD.id AND session.id IN (first_id, second_id));
END;
CREATE TRIGGER session_leaves_no_cut BEFORE DELETE ON session BEGIN
    DELETE FROM session_cut
    WHERE first_id = OLD.id AND second_id IS NULL OR second_id = OLD.id AND first_id IS NULL;
END;

-- The files that rows refer to.
CREATE VIEW blob_reference (hash) AS
    SELECT video FROM session WHERE video IS NOT NULL
    UNION ALL SELECT blob FROM job_file
    UNION ALL SELECT trajectory FROM result
    UNION ALL SELECT diagnostics FROM result WHERE diagnostics IS NOT NULL
    UNION ALL SELECT preview FROM result WHERE preview IS NOT NULL
    UNION ALL SELECT video FROM waiting_recording
    UNION ALL SELECT preview FROM waiting_recording WHERE preview IS NOT NULL;

-- The sessions with what a trainee's progress shows of them. `arrival` grows with each recording that arrives; the parts of one have the same.
CREATE VIEW practised_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.recorded_at_ms,
           coalesce((SELECT whole.rowid FROM session AS whole WHERE whole.id = session.cut_of), session.rowid) AS arrival,
           session.video IS NOT NULL AS is_whole,
           NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id) AS counts,
           session.box_question, job.state AS job_state, result.id AS result_id, result.pipeline, result.calibration_id,
           result.verdict = 'refused' AS refused
    FROM session
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN current_result AS result ON result.session_id = session.id;

-- The outcome of each session: refused, asked about, passed or missed by the standard of its day.
CREATE VIEW session_outcome (session_id, verdict, outcome) AS
    SELECT session.id, result.verdict,
           CASE
               WHEN session.video IS NULL THEN 'receiving'
               WHEN job.state IN ('quarantined', 'failed') THEN job.state
               WHEN job.state = 'running' THEN 'tracking'
               WHEN job.state IS NULL
                    AND EXISTS (SELECT 1 FROM blob WHERE hash = session.video AND dropped_at_ms IS NOT NULL) THEN 'failed'
               WHEN job.state IS NOT 'done' THEN 'queued'
               WHEN session.box_question = 'asked' THEN 'box_asked'
               WHEN session.box_question = 'other_box' THEN 'other_box'
               WHEN result.verdict = 'refused' THEN 'refused'
               WHEN EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) THEN 'done'
               ELSE coalesce(
                   (SELECT (SELECT CASE WHEN min(met) = 0 THEN 'missed'
                                        WHEN count(*) > 0 AND count(met) = count(*) THEN 'passed'
                                        ELSE 'undecided' END
                            FROM (SELECT CASE
                                             WHEN target.value ->> '$.made_from.pipeline' <> result.pipeline THEN NULL
                                             WHEN target.value ->> '$.made_from.handedness' IS NOT NULL
                                                  AND target.value ->> '$.made_from.handedness' IS NOT trainee.handedness THEN NULL
                                             WHEN low IS NOT NULL AND high IS NULL THEN
                                                 CASE target.value ->> 'better'
                                                     WHEN 'higher' THEN iif(feature.value >= target.value ->> 'limit', 1, NULL)
                                                     ELSE iif(feature.value > target.value ->> 'limit', 0, NULL) END
                                             WHEN feature.value BETWEEN low AND high THEN
                                                 CASE target.value ->> 'better'
                                                     WHEN 'higher' THEN iif(low >= target.value ->> 'limit', 1,
                                                                            iif(high < target.value ->> 'limit', 0, NULL))
                                                     ELSE iif(high <= target.value ->> 'limit', 1,
                                                              iif(low > target.value ->> 'limit', 0, NULL)) END
                                         END AS met
                                  FROM json_each(standard.definition, '$.targets') AS target
                                  LEFT JOIN feature ON feature.result_id = result.id
                                       AND feature.name = target.value ->> 'feature'
                                       AND CASE target.value ->> 'in_hand' || coalesce(trainee.handedness, '')
                                               WHEN 'dominantleft' THEN feature.tool = result.left_tool
                                               WHEN 'otherright' THEN feature.tool = result.left_tool
                                               WHEN 'dominantright' THEN feature.tool = result.right_tool
                                               WHEN 'otherleft' THEN feature.tool = result.right_tool
                                               ELSE CASE target.value ->> 'in_hand'
                                                   WHEN 'left' THEN feature.tool = result.left_tool
                                                   WHEN 'right' THEN feature.tool = result.right_tool
                                                   ELSE target.value ->> 'in_hand' IS NULL AND feature.tool IS target.value ->> 'tool' END
                                           END
                                       AND feature.space = target.value ->> 'space'))
                    FROM standard
                    WHERE standard.task_id = session.task_id AND standard.valid_from_ms <= session.created_at_ms
                          AND result.id IS NOT NULL
                    ORDER BY standard.version DESC LIMIT 1), 'done')
           END
    FROM session
    JOIN trainee ON trainee.id = session.trainee_id
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN current_result AS result ON result.session_id = session.id;

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
