-- Self-tests of boxes: a traffic light for each day.

-- A check cannot be changed in place: the table of jobs is made anew with one more kind of work, and what refers to it with it.
CREATE TABLE next_job (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- JobId
    kind           TEXT NOT NULL CHECK (kind IN ('track', 'calibrate', 'palette', 'self_test')), -- what kind of work
    input          TEXT NOT NULL CHECK (json_valid(input)),                  -- what it works on (JobInput)
    input_hash     TEXT NOT NULL CHECK (length(input_hash) = 64),            -- SHA-256 of `input`, hexadecimal
    versions       TEXT NOT NULL CHECK (length(versions) <= 200),            -- what else its result depends on
    session_id     TEXT REFERENCES session (id) ON DELETE CASCADE,           -- the session it is about
    box_id         TEXT REFERENCES training_box (id) ON DELETE CASCADE,      -- the box it is about
    state          TEXT NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed', 'quarantined')), -- how it stands
    attempt        INTEGER NOT NULL DEFAULT 0 CHECK (attempt BETWEEN 0 AND max_attempts), -- claims that ended in a crash, and this one
    max_attempts   INTEGER NOT NULL CHECK (max_attempts BETWEEN 1 AND 20),   -- crashes after which it is quarantined
    lease_token    TEXT CHECK (length(lease_token) = 36),                    -- whoever knows it holds the job
    lease_until_ms INTEGER,                                                  -- until then it is theirs, epoch ms
    worker         TEXT CHECK (length(worker) BETWEEN 1 AND 120),            -- who holds it, for people
    progress       REAL NOT NULL DEFAULT 0 CHECK (progress BETWEEN 0 AND 1), -- share done
    problem        TEXT CHECK (json_valid(problem)),                         -- why it failed or last crashed (Problem)
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when queued first, epoch ms
    queued_at_ms   INTEGER NOT NULL CHECK (queued_at_ms >= created_at_ms),   -- when queued last: its place, epoch ms
    started_at_ms  INTEGER,                                                  -- when claimed last, epoch ms
    ended_at_ms    INTEGER,                                                  -- when it ended, epoch ms
    UNIQUE (kind, input_hash, versions),
    CHECK ((session_id IS NULL) <> (box_id IS NULL)),
    CHECK ((kind = 'track') = (session_id IS NOT NULL)),
    CHECK ((state = 'running') = (lease_token IS NOT NULL)),
    CHECK ((state = 'running') = (lease_until_ms IS NOT NULL)),
    CHECK ((state = 'running') = (worker IS NOT NULL)),
    CHECK ((state IN ('done', 'failed', 'quarantined')) = (ended_at_ms IS NOT NULL)),
    CHECK (state NOT IN ('failed', 'quarantined') OR problem IS NOT NULL)
) STRICT;
INSERT INTO next_job SELECT * FROM job;

-- The files that a job reads.
CREATE TABLE next_job_file (
    job_id TEXT NOT NULL REFERENCES next_job (id) ON DELETE CASCADE,              -- the job
    blob   TEXT NOT NULL REFERENCES blob (hash) ON DELETE RESTRICT,          -- the file
    PRIMARY KEY (job_id, blob)
) STRICT, WITHOUT ROWID;
INSERT INTO next_job_file SELECT * FROM job_file;

DROP VIEW blob_reference;
DROP TABLE job_file;
DROP TABLE job;
ALTER TABLE next_job RENAME TO job; -- also where job_file refers to it
ALTER TABLE next_job_file RENAME TO job_file;

-- The queue in its order: work about boxes goes first, since sessions wait for it. Queries must spell the order alike.
CREATE INDEX job_waiting ON job (kind = 'track', queued_at_ms, id) WHERE state = 'queued';
CREATE INDEX job_quarantined ON job (id) WHERE state = 'quarantined';
CREATE INDEX job_lease ON job (lease_until_ms) WHERE state = 'running';
CREATE INDEX job_session ON job (session_id, created_at_ms);
CREATE INDEX job_box ON job (box_id, created_at_ms);
CREATE INDEX job_file_blob ON job_file (blob);

-- Every reference to a blob: what is not here may be forgotten.
CREATE VIEW blob_reference (hash) AS
    SELECT video FROM session WHERE video IS NOT NULL
    UNION ALL SELECT blob FROM job_file
    UNION ALL SELECT trajectory FROM result
    UNION ALL SELECT diagnostics FROM result
    UNION ALL SELECT preview FROM result WHERE preview IS NOT NULL;

-- What a self-test of a box found. Its recording is not kept.
CREATE TABLE self_test (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- SelfTestId
    box_id         TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- of which box
    calibration_id TEXT NOT NULL REFERENCES calibration (id) ON DELETE CASCADE, -- the camera that was tested
    palette_id     TEXT NOT NULL REFERENCES palette (id) ON DELETE CASCADE,  -- the colours that were tested
    person_id      TEXT REFERENCES person (id) ON DELETE SET NULL,           -- who tested it; NULL: the service, or gone
    pipeline       TEXT NOT NULL CHECK (length(pipeline) BETWEEN 1 AND 64),  -- PIPELINE_VERSION
    light          TEXT NOT NULL CHECK (light IN ('green', 'yellow', 'red', 'not_measured')), -- the worst of its parts
    report         TEXT NOT NULL CHECK (json_valid(report)),                 -- all figures (SelfTestReport)
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0)               -- when stored, epoch ms
) STRICT;
CREATE INDEX self_test_box ON self_test (box_id, id);
CREATE INDEX self_test_calibration ON self_test (calibration_id);
CREATE INDEX self_test_palette ON self_test (palette_id);
CREATE INDEX self_test_person ON self_test (person_id);
