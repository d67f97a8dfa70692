-- Sessions show that they are voided attempts of exams, and entries of the audit trail the number of the attempt. The
-- database refuses what never happens to an exam that has begun.

-- The sessions that are voided attempts of exams. They count nowhere, and no standard judges them.
CREATE VIEW voided_session (session_id) AS
    SELECT session_id FROM exam_attempt WHERE session_id IS NOT NULL AND voided_at_ms IS NOT NULL;

DROP VIEW session_outcome;
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
               WHEN EXISTS (SELECT 1 FROM voided_session WHERE voided_session.session_id = session.id) THEN 'done'
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

DROP VIEW session_record;
CREATE VIEW session_record AS
    SELECT session.id, session.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           trainee.handedness AS trainee_handedness,
           session.task_id, task.name AS task_name, task.code AS task_code,
           session.box_id, training_box.name AS box_name, training_box.code AS box_code,
           session.filename, session.media_type, session.video, blob.bytes AS video_bytes, session.tracker,
           session.recorded_at_ms, session.created_at_ms,
           job.id AS job_id, job.state AS job_state, job.progress AS job_progress, job.problem AS job_problem,
           EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) AS is_set_aside,
           EXISTS (SELECT 1 FROM voided_session WHERE voided_session.session_id = session.id) AS is_voided,
           session.box_question,
           EXISTS (SELECT 1 FROM calibration WHERE calibration.box_id = session.box_id) AS box_has_camera,
           EXISTS (SELECT 1 FROM palette WHERE palette.box_id = session.box_id) AS box_has_palette
    FROM session
    JOIN trainee ON trainee.id = session.trainee_id
    JOIN task ON task.id = session.task_id
    JOIN training_box ON training_box.id = session.box_id
    LEFT JOIN blob ON blob.hash = session.video
    LEFT JOIN tracking_job AS job ON job.session_id = session.id;

ALTER TABLE audit ADD COLUMN attempt INTEGER CHECK (attempt >= 1);           -- number of the changed attempt of an exam; NULL: another change, or an older one

-- The number of an attempt is the order of beginning, for ever: a voided one keeps it.
CREATE TRIGGER exam_attempt_is_numbered_once BEFORE UPDATE OF exam_id, recording_id, number, began_at_ms ON exam_attempt
WHEN OLD.number IS NOT NULL
     AND (OLD.exam_id, OLD.recording_id, OLD.number, OLD.began_at_ms)
         IS NOT (NEW.exam_id, NEW.recording_id, NEW.number, NEW.began_at_ms) BEGIN
    SELECT RAISE(ABORT, 'the number of an attempt never changes');
END;
CREATE TRIGGER exam_attempt_keeps_its_session BEFORE UPDATE OF session_id ON exam_attempt
WHEN OLD.session_id <> NEW.session_id BEGIN
    SELECT RAISE(ABORT, 'the session of an attempt never changes');
END;
CREATE TRIGGER exam_attempt_is_voided_before_the_end BEFORE UPDATE OF void_reason, voided_at_ms ON exam_attempt
WHEN OLD.voided_at_ms IS NOT NULL OR (SELECT state FROM exam WHERE exam.id = OLD.exam_id) <> 'running' BEGIN
    SELECT RAISE(ABORT, 'an attempt is voided once, before the end of the exam');
END;
CREATE TRIGGER exam_attempt_stays BEFORE DELETE ON exam_attempt
WHEN OLD.number IS NOT NULL AND EXISTS (SELECT 1 FROM exam WHERE exam.id = OLD.exam_id) BEGIN
    SELECT RAISE(ABORT, 'an attempt is erased only with its exam');
END;
CREATE TRIGGER exam_is_erased_with_the_person BEFORE DELETE ON exam
WHEN EXISTS (SELECT 1 FROM trainee WHERE trainee.id = OLD.trainee_id) BEGIN
    SELECT RAISE(ABORT, 'an exam is erased only with the person');
END;
