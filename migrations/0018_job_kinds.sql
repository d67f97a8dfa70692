-- Kinds of jobs as rows, so that a new kind is a row in a migration and the table of jobs is not made again. Advice on
-- tapes has its own kind: until now it was a job of the kind `palette` with another input.

-- What a job can do.
CREATE TABLE job_kind (
    name    TEXT PRIMARY KEY CHECK (length(name) BETWEEN 1 AND 32),          -- JobKind
    subject TEXT NOT NULL CHECK (subject IN ('session', 'box')),             -- what its jobs work on
    UNIQUE (name, subject)
) STRICT, WITHOUT ROWID;
INSERT INTO job_kind (name, subject) VALUES
    ('track', 'session'), ('import', 'session'), ('rescore', 'session'),
    ('calibrate', 'box'), ('palette', 'box'), ('advise', 'box'), ('self_test', 'box');

-- One unit of background work. src/domain/job.rs has the diagram of its states.
CREATE TABLE next_job (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- JobId
    kind           TEXT NOT NULL,                                            -- JobKind
    input          TEXT NOT NULL CHECK (json_valid(input)),                  -- JobInput
    input_hash     TEXT NOT NULL CHECK (length(input_hash) = 64),            -- SHA-256 of `input`, hexadecimal
    versions       TEXT NOT NULL CHECK (length(versions) <= 200),            -- what else its result depends on
    session_id     TEXT REFERENCES session (id) ON DELETE CASCADE,           -- the session that it works on; NULL: none
    box_id         TEXT REFERENCES training_box (id) ON DELETE CASCADE,      -- the box that it works on; NULL: none
    subject        TEXT NOT NULL AS (iif(session_id IS NULL, 'box', 'session')), -- which of the two it works on
    turn           INTEGER NOT NULL CHECK (turn IN (0, 1, 2)),               -- JobPriority: lower numbers run first
    state          TEXT NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed', 'quarantined')), -- JobState
    attempt        INTEGER NOT NULL DEFAULT 0 CHECK (attempt BETWEEN 0 AND max_attempts), -- crashes, and this attempt
    max_attempts   INTEGER NOT NULL CHECK (max_attempts BETWEEN 1 AND 20),   -- crashes after which it is quarantined
    lease_token    TEXT CHECK (length(lease_token) = 36),                    -- LeaseToken; NULL: no worker has it
    lease_until_ms INTEGER,                                                  -- end of the lease, epoch ms
    worker         TEXT CHECK (length(worker) BETWEEN 1 AND 120),            -- worker that has the lease, for people
    progress       REAL NOT NULL DEFAULT 0 CHECK (progress BETWEEN 0 AND 1), -- share done
    problem        TEXT CHECK (json_valid(problem)),                         -- why it failed or last crashed (Problem)
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when it was first queued, epoch ms
    queued_at_ms   INTEGER NOT NULL CHECK (queued_at_ms >= created_at_ms),   -- when it was last queued, epoch ms
    started_at_ms  INTEGER,                                                  -- when it was last claimed, epoch ms
    ended_at_ms    INTEGER,                                                  -- when it ended, epoch ms
    advice         TEXT CHECK (json_valid(advice)),                          -- PaletteAdvice; NULL: none (yet)
    UNIQUE (kind, input_hash, versions),
    FOREIGN KEY (kind, subject) REFERENCES job_kind (name, subject) ON DELETE RESTRICT, -- a known kind, on its subject
    CHECK ((session_id IS NULL) <> (box_id IS NULL)),
    CHECK ((turn = 0) = (box_id IS NOT NULL)),
    CHECK ((state = 'running') = (lease_token IS NOT NULL)),
    CHECK ((state = 'running') = (lease_until_ms IS NOT NULL)),
    CHECK ((state = 'running') = (worker IS NOT NULL)),
    CHECK ((state IN ('done', 'failed', 'quarantined')) = (ended_at_ms IS NOT NULL)),
    CHECK (state NOT IN ('failed', 'quarantined') OR problem IS NOT NULL)
) STRICT;
-- Input, hash and versions stay as they are, so that the same advice requested again finds its earlier job.
INSERT INTO next_job (id, kind, input, input_hash, versions, session_id, box_id, turn, state, attempt, max_attempts,
                      lease_token, lease_until_ms, worker, progress, problem, created_at_ms, queued_at_ms,
                      started_at_ms, ended_at_ms, advice)
    SELECT id, iif(input ->> 'kind' = 'advice', 'advise', kind), input, input_hash, versions, session_id, box_id, turn,
           state, attempt, max_attempts, lease_token, lease_until_ms, worker, progress, problem, created_at_ms,
           queued_at_ms, started_at_ms, ended_at_ms, advice FROM job;

-- Dropping the table deletes its rows, so the foreign keys of two other tables delete or clear theirs: both are written
-- again afterwards.
CREATE TEMPORARY TABLE kept_job_file AS SELECT job_id, blob FROM job_file;
CREATE TEMPORARY TABLE kept_rescoring_job AS
    SELECT rescoring_id, session_id, job_id FROM rescoring_item WHERE job_id IS NOT NULL;
DROP TABLE job;
ALTER TABLE next_job RENAME TO job;
INSERT INTO job_file (job_id, blob) SELECT job_id, blob FROM kept_job_file;
UPDATE rescoring_item SET job_id = kept.job_id FROM kept_rescoring_job AS kept
    WHERE rescoring_item.rescoring_id = kept.rescoring_id AND rescoring_item.session_id = kept.session_id;
DROP TABLE kept_job_file;
DROP TABLE kept_rescoring_job;

-- The queue in its order. Queries must spell the order alike.
CREATE INDEX job_waiting ON job (turn, queued_at_ms, id) WHERE state = 'queued';
CREATE INDEX job_quarantined ON job (id) WHERE state = 'quarantined';
CREATE INDEX job_lease ON job (lease_until_ms) WHERE state = 'running';
CREATE INDEX job_session ON job (session_id, created_at_ms);
CREATE INDEX job_box ON job (box_id, created_at_ms);

-- The jobs that a scope sees: an administrator all, an instructor those on boxes and on sessions of their trainees, a
-- trainee those on their own sessions. An agent sees none. A statement has the condition
-- `EXISTS (SELECT 1 FROM visible_job WHERE role = $1 AND subject IS $2 AND job_id = job.id)`.
-- Each column has one type in all branches, so that SQLite merges the view into the statement and finds a job by id.
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
    SELECT 'trainee', session.trainee_id, job.id FROM job JOIN session ON session.id = job.session_id;
