-- What many statements share. A statement that reads one of these views is as fast as one that repeats its text: SQLite
-- merges the view into the statement, which then uses the indexes of the tables.

-- The trainees that an instructor or a trainee sees: those of the instructor's groups, and oneself. Administrators see
-- all and agents none, so neither has a row here. Statements on trainees and their sessions have the condition
-- `($1 = 'administrator' OR … IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))`.
CREATE VIEW visible_trainee (role, subject, trainee_id) AS
    SELECT 'trainee', id, id FROM trainee
    UNION ALL
    SELECT 'instructor', group_instructor.person_id, group_trainee.trainee_id
    FROM group_instructor JOIN group_trainee ON group_trainee.group_id = group_instructor.group_id;

-- The current result of each session: the latest.
CREATE VIEW current_result AS
    SELECT result.*, json_extract(result.quality, '$.verdict') AS verdict FROM result
    WHERE result.id = (SELECT latest.id FROM result AS latest WHERE latest.session_id = result.session_id
                       ORDER BY latest.created_at_ms DESC, latest.id DESC LIMIT 1);

-- The job that determines each session's status: the latest that tracks or imports it. A job that only scores again (`turn` 2) does not
-- count, since the session keeps its result even if that job fails.
CREATE VIEW tracking_job AS
    SELECT job.* FROM job
    WHERE job.id = (SELECT latest.id FROM job AS latest WHERE latest.session_id = job.session_id AND latest.turn < 2
                    ORDER BY latest.created_at_ms DESC, latest.id DESC LIMIT 1);

-- The sessions that staff set aside, so that they count nowhere.
CREATE VIEW set_aside_session (session_id) AS
    SELECT session_id FROM session_edit WHERE kind = 'set_aside' AND undone_at_ms IS NULL;

-- The sessions that count and have a result, with what statistics need of it.
CREATE VIEW assessed_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.tracker, session.recorded_at_ms, session.created_at_ms,
           result.id AS result_id, result.pipeline, result.calibration_id, result.tools, result.verdict
    FROM session JOIN current_result AS result ON result.session_id = session.id
    WHERE NOT EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id);

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
           EXISTS (SELECT 1 FROM calibration WHERE calibration.box_id = session.box_id) AS box_has_camera,
           EXISTS (SELECT 1 FROM palette WHERE palette.box_id = session.box_id) AS box_has_palette
    FROM session
    JOIN trainee ON trainee.id = session.trainee_id
    JOIN task ON task.id = session.task_id
    JOIN training_box ON training_box.id = session.box_id
    LEFT JOIN blob ON blob.hash = session.video
    LEFT JOIN tracking_job AS job ON job.session_id = session.id;

-- The sessions with what a trainee's progress shows of them.
CREATE VIEW practised_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.recorded_at_ms, session.video IS NOT NULL AS is_whole,
           NOT EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) AS counts,
           job.state AS job_state, result.id AS result_id, result.pipeline, result.calibration_id,
           result.verdict = 'refused' AS refused
    FROM session
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN current_result AS result ON result.session_id = session.id;

-- The members of each cohort: those in its list, or those with its level, hand and group.
CREATE VIEW cohort_person (cohort_id, trainee_id, handedness) AS
    SELECT cohort.id, member.id, member.handedness FROM cohort CROSS JOIN trainee AS member
    WHERE CASE WHEN cohort.is_list
               THEN EXISTS (SELECT 1 FROM cohort_member
                            WHERE cohort_member.cohort_id = cohort.id AND cohort_member.trainee_id = member.id)
               ELSE (cohort.level IS NULL OR cohort.level = member.level)
                    AND (cohort.handedness IS NULL OR cohort.handedness = member.handedness)
                    AND (cohort.group_id IS NULL
                         OR EXISTS (SELECT 1 FROM group_trainee WHERE group_trainee.group_id = cohort.group_id
                                    AND group_trainee.trainee_id = member.id)) END;

-- The versions of the tasks' standards, with the name of the person who set each.
CREATE VIEW standard_record AS
    SELECT standard.id, standard.task_id, standard.version, standard.definition, person.name AS who, standard.created_at_ms
    FROM standard LEFT JOIN person ON person.id = standard.person_id;

-- The training groups with the course plan that each follows.
CREATE VIEW group_record AS
    SELECT training_group.id, training_group.name, training_group.created_at_ms,
           group_course.course_id, course.name AS course_name, group_course.begins
    FROM training_group
    LEFT JOIN group_course ON group_course.group_id = training_group.id
    LEFT JOIN course ON course.id = group_course.course_id;

-- The recordings that arrive frame by frame, with the trainee and the task of their sessions.
CREATE VIEW feed_record AS
    SELECT feed.*, session.trainee_id, session.task_id
    FROM feed JOIN session ON session.id = feed.session_id;

-- The comments with their authors. Comments of deleted accounts count as those of staff.
CREATE VIEW comment_record AS
    SELECT comment.id, comment.session_id, comment.person_id, person.name AS who, comment.from_s, comment.to_s, comment.text,
           comment.created_at_ms, coalesce(person.role = 'trainee', FALSE) AS is_by_trainee
    FROM comment LEFT JOIN person ON person.id = comment.person_id;

-- The open rescoring orders without open sessions.
CREATE VIEW completed_rescoring (id) AS
    SELECT id FROM rescoring
    WHERE ended_at_ms IS NULL AND NOT EXISTS
        (SELECT 1 FROM rescoring_item WHERE rescoring_id = rescoring.id AND state IN ('waiting', 'working'));
