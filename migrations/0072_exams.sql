-- Exams: a task taken under supervision, judged once by a version of the standard that was fixed before.

-- An exam. It keeps what was fixed when it was planned, and its result for ever.
CREATE TABLE exam (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- ExamId
    trainee_id    TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,   -- the candidate
    task_id       TEXT NOT NULL REFERENCES task (id) ON DELETE RESTRICT,     -- the task
    box_id        TEXT NOT NULL REFERENCES training_box (id) ON DELETE RESTRICT, -- the box
    standard_id   TEXT NOT NULL REFERENCES standard (id) ON DELETE RESTRICT, -- the version of the standard that judges it
    attempts      INTEGER NOT NULL CHECK (attempts BETWEEN 1 AND 3),         -- how many attempts the candidate has
    day           TEXT CHECK (length(day) = 10),                             -- note of the day on which it is to be held, YYYY-MM-DD; NULL: none
    state         TEXT NOT NULL CHECK (state IN ('planned', 'running', 'closed', 'cancelled')), -- ExamState
    planned_by    TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who planned it; NULL: deleted, or the service
    planned_at_ms INTEGER NOT NULL CHECK (planned_at_ms >= 0),               -- when, epoch ms
    identity      TEXT CHECK (identity IN ('badge', 'document', 'known')),   -- IdentityCheck: how the examiner confirmed who it is; NULL: not started
    examiner_id   TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the examiner; NULL: not started, or the account was deleted
    examiner      TEXT CHECK (length(examiner) BETWEEN 1 AND 120),           -- name of the examiner at the start; stays when the account is deleted
    handedness    TEXT CHECK (handedness IN ('left', 'right', 'both')),      -- preferred hand of the candidate at the start; NULL: not said, or not started
    self_test_id  TEXT REFERENCES self_test (id) ON DELETE SET NULL,         -- the self-test of the box at the start
    started_at_ms INTEGER CHECK (started_at_ms >= planned_at_ms),            -- when it was started, epoch ms
    result        TEXT CHECK (result IN ('passed', 'not_passed', 'undecided')), -- ExamResult; NULL: not closed
    ended_by      TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who closed or cancelled it; NULL: deleted, or neither
    ended_at_ms   INTEGER CHECK (ended_at_ms >= planned_at_ms),              -- when, epoch ms
    CHECK ((started_at_ms IS NULL) = (identity IS NULL) AND (identity IS NULL) = (examiner IS NULL)),
    CHECK (state <> 'planned' OR started_at_ms IS NULL),
    CHECK (state NOT IN ('running', 'closed') OR started_at_ms IS NOT NULL),
    CHECK ((state = 'closed') = (result IS NOT NULL)),
    CHECK ((state IN ('closed', 'cancelled')) = (ended_at_ms IS NOT NULL))
) STRICT;
CREATE UNIQUE INDEX exam_running_trainee ON exam (trainee_id) WHERE state = 'running';
CREATE UNIQUE INDEX exam_running_box ON exam (box_id) WHERE state = 'running';
CREATE INDEX exam_trainee ON exam (trainee_id);
CREATE INDEX exam_task ON exam (task_id);
CREATE INDEX exam_box ON exam (box_id);
CREATE INDEX exam_standard ON exam (standard_id);
CREATE INDEX exam_self_test ON exam (self_test_id);
CREATE INDEX exam_planned_by ON exam (planned_by);
CREATE INDEX exam_examiner ON exam (examiner_id);
CREATE INDEX exam_ended_by ON exam (ended_by);

-- What was fixed before an exam, and its result, never change. Only merged records of a person or box change whose it is.
CREATE TRIGGER exam_stays BEFORE UPDATE OF task_id, standard_id, attempts, planned_at_ms ON exam BEGIN
    SELECT RAISE(ABORT, 'what was fixed for an exam never changes');
END;
CREATE TRIGGER exam_is_started_once BEFORE UPDATE OF identity, examiner, handedness, started_at_ms ON exam
WHEN OLD.state <> 'planned' BEGIN
    SELECT RAISE(ABORT, 'what was fixed at the start of an exam never changes');
END;
CREATE TRIGGER exam_ends_once BEFORE UPDATE OF state, result, ended_at_ms ON exam WHEN OLD.state IN ('closed', 'cancelled') BEGIN
    SELECT RAISE(ABORT, 'an exam that has ended never changes');
END;

-- A recording that was ordered for an exam. It is an attempt from the moment when it begins to arrive.
CREATE TABLE exam_attempt (
    recording_id  TEXT PRIMARY KEY CHECK (length(recording_id) = 36),        -- FeedId that the service gave to the recording
    exam_id       TEXT NOT NULL REFERENCES exam (id) ON DELETE CASCADE,      -- the exam
    ordered_by    TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who ordered it; NULL: deleted
    ordered_at_ms INTEGER NOT NULL CHECK (ordered_at_ms >= 0),               -- when, epoch ms
    self_test_id  TEXT REFERENCES self_test (id) ON DELETE SET NULL,         -- the self-test of the box that held when it was ordered
    number        INTEGER CHECK (number >= 1),                               -- 1, 2, … in the order of beginning; NULL: it has not begun
    began_at_ms   INTEGER CHECK (began_at_ms >= 0),                          -- when its first frames were announced, epoch ms
    session_id    TEXT REFERENCES session (id) ON DELETE SET NULL,           -- its session; NULL: not begun, or nothing could be kept
    outcome       TEXT CHECK (outcome IN ('passed', 'not_passed', 'undecided', 'refused', 'failed')), -- AttemptOutcome; NULL: not judged yet
    cause         TEXT CHECK (cause IN ('error_bar', 'not_measured', 'other_box', 'set_up', 'interrupted', 'not_live')), -- AttemptCause: why it is undecided
    pipeline      TEXT CHECK (length(pipeline) >= 1),                        -- version of the measurement that was judged
    figures       TEXT CHECK (json_valid(figures)),                          -- the values and limits that were judged (JudgedFigure)
    judged_at_ms  INTEGER CHECK (judged_at_ms >= 0),                         -- when, epoch ms
    completion    TEXT CHECK (completion IN ('completed', 'broken_off')),    -- AttemptCompletion: what the examiner says; NULL: not said
    voided_by     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who voided it; NULL: not voided, or deleted
    void_reason   TEXT CHECK (length(void_reason) BETWEEN 1 AND 2000),       -- why
    voided_at_ms  INTEGER CHECK (voided_at_ms >= 0),                         -- when, epoch ms; NULL: it counts
    UNIQUE (exam_id, number),
    CHECK ((number IS NULL) = (began_at_ms IS NULL)),
    CHECK (number IS NOT NULL OR (session_id IS NULL AND outcome IS NULL AND completion IS NULL AND voided_at_ms IS NULL)),
    CHECK ((outcome IS NULL) = (judged_at_ms IS NULL)),
    CHECK ((cause IS NULL) = (outcome IS NOT 'undecided')),
    CHECK ((voided_at_ms IS NULL) = (void_reason IS NULL))
) STRICT;
CREATE INDEX exam_attempt_session ON exam_attempt (session_id) WHERE session_id IS NOT NULL;
CREATE INDEX exam_attempt_self_test ON exam_attempt (self_test_id);
CREATE INDEX exam_attempt_ordered_by ON exam_attempt (ordered_by);
CREATE INDEX exam_attempt_voided_by ON exam_attempt (voided_by);

CREATE TRIGGER exam_attempt_is_judged_once BEFORE UPDATE OF outcome, cause, figures, pipeline ON exam_attempt
WHEN OLD.outcome IS NOT NULL BEGIN
    SELECT RAISE(ABORT, 'an attempt is judged once');
END;

CREATE TRIGGER exam_attempt_is_completed_before_the_end BEFORE UPDATE OF completion ON exam_attempt
WHEN (SELECT state FROM exam WHERE exam.id = OLD.exam_id) <> 'running' BEGIN
    SELECT RAISE(ABORT, 'what the examiner said of an attempt never changes after the exam');
END;

-- A certificate of an exam that was passed. NULL: it is of the progress, or the person was erased.
ALTER TABLE certificate ADD COLUMN exam_id TEXT REFERENCES exam (id) ON DELETE SET NULL;
CREATE INDEX certificate_exam ON certificate (exam_id) WHERE exam_id IS NOT NULL;

-- The sessions of exams that are not closed. Trainees see nothing of them (`src/store/visibility.rs`), and they count nowhere.
CREATE VIEW sealed_session (session_id) AS
    SELECT attempt.session_id FROM exam CROSS JOIN exam_attempt AS attempt ON attempt.exam_id = exam.id
    WHERE exam.state = 'running' AND attempt.session_id IS NOT NULL;

-- The sessions that count nowhere. A voided attempt of an exam never counts.
DROP VIEW uncounted_session;
CREATE VIEW uncounted_session (session_id) AS
    SELECT session_id FROM session_edit WHERE kind = 'set_aside' AND undone_at_ms IS NULL
    UNION ALL
    SELECT id FROM session WHERE box_question IN ('asked', 'other_box')
    UNION ALL
    SELECT session.id FROM pending_erasure JOIN session ON session.trainee_id = pending_erasure.trainee_id
    UNION ALL
    SELECT session.id FROM record_merge JOIN session ON session.trainee_id = record_merge.merged_trainee_id
    WHERE record_merge.separated_at_ms IS NULL
    UNION ALL
    SELECT attempt.session_id FROM exam_attempt AS attempt JOIN exam ON exam.id = attempt.exam_id
    WHERE attempt.session_id IS NOT NULL AND (attempt.voided_at_ms IS NOT NULL OR exam.state = 'running');

-- The jobs that each role sees. Trainees see none of an exam that is not closed.
DROP VIEW visible_job;
CREATE VIEW visible_job (role, subject, job_id) AS
    SELECT 'administrator', CAST(NULL AS TEXT), id FROM job
    UNION ALL
    SELECT 'instructor', person.id, job.id FROM job CROSS JOIN person WHERE job.box_id IS NOT NULL
    UNION ALL
    SELECT 'instructor', group_instructor.person_id, job.id FROM job
    JOIN session ON session.id = job.session_id
    JOIN group_trainee ON group_trainee.trainee_id = session.trainee_id
    JOIN group_instructor ON group_instructor.group_id = group_trainee.group_id
    UNION ALL
    SELECT 'trainee', session.trainee_id, job.id FROM job JOIN session ON session.id = job.session_id
    WHERE session.id NOT IN (SELECT session_id FROM sealed_session);
