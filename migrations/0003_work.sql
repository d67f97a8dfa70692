-- Recordings, what is done with them, and what came of it.

-- One recording of one trainee doing one task in one box. The same recording twice is one session.
CREATE TABLE session (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- SessionId
    trainee_id     TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,  -- who trained
    task_id        TEXT NOT NULL REFERENCES task (id) ON DELETE RESTRICT,    -- what they did
    box_id         TEXT NOT NULL REFERENCES training_box (id) ON DELETE RESTRICT, -- where
    filename       TEXT NOT NULL CHECK (length(filename) BETWEEN 1 AND 255), -- the recording's name as it was sent
    media_type     TEXT NOT NULL CHECK (length(media_type) BETWEEN 3 AND 127), -- the recording's type, as video/mp4
    video          TEXT REFERENCES blob (hash) ON DELETE RESTRICT,           -- the recording; NULL: it is still arriving
    recorded_at_ms INTEGER NOT NULL,                                         -- when it was recorded, epoch ms
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when it was whole here, epoch ms
    UNIQUE (trainee_id, task_id, box_id, video)
) STRICT;
CREATE INDEX session_task ON session (task_id);
CREATE INDEX session_box ON session (box_id);
CREATE INDEX session_video ON session (video);

-- A resumable upload. Bytes first, then this row: `received` never exceeds what is safe on the disk.
CREATE TABLE upload (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- UploadId; its file has the same name
    person_id      TEXT REFERENCES person (id) ON DELETE CASCADE,            -- who sends; NULL for an agent or the service
    trainee_id     TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,  -- who trained
    task_id        TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,     -- what they did
    box_id         TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- where
    filename       TEXT NOT NULL CHECK (length(filename) BETWEEN 1 AND 255), -- the recording's name at the sender's
    metadata       TEXT NOT NULL CHECK (length(metadata) <= 8192),           -- Upload-Metadata as it was sent, to be sent back
    recorded_at_ms INTEGER,                                                  -- when it was recorded, epoch ms; NULL: not said
    length         INTEGER NOT NULL CHECK (length >= 0),                     -- bytes to come in all
    received       INTEGER NOT NULL DEFAULT 0 CHECK (received BETWEEN 0 AND length), -- bytes that are durable
    session_id     TEXT REFERENCES session (id) ON DELETE CASCADE,           -- the session that it became
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when begun, epoch ms
    expires_at_ms  INTEGER NOT NULL CHECK (expires_at_ms > created_at_ms),   -- when it is forgotten unless it goes on, epoch ms
    CHECK (session_id IS NULL OR received = length)
) STRICT;
CREATE INDEX upload_expires ON upload (expires_at_ms);
CREATE INDEX upload_session ON upload (session_id);
CREATE INDEX upload_trainee ON upload (trainee_id);

-- A piece of work. The diagram of its states stands in src/domain/job.rs.
CREATE TABLE job (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- JobId
    kind           TEXT NOT NULL CHECK (kind IN ('track', 'calibrate', 'palette')), -- what kind of work
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
-- The queue in its order: work about boxes goes first, since sessions wait for it. Queries must spell the order alike.
CREATE INDEX job_waiting ON job (kind = 'track', queued_at_ms, id) WHERE state = 'queued';
CREATE INDEX job_quarantined ON job (id) WHERE state = 'quarantined';
CREATE INDEX job_lease ON job (lease_until_ms) WHERE state = 'running';
CREATE INDEX job_session ON job (session_id, created_at_ms);
CREATE INDEX job_box ON job (box_id, created_at_ms);

-- The files that a job reads.
CREATE TABLE job_file (
    job_id TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,              -- the job
    blob   TEXT NOT NULL REFERENCES blob (hash) ON DELETE RESTRICT,          -- the file
    PRIMARY KEY (job_id, blob)
) STRICT, WITHOUT ROWID;
CREATE INDEX job_file_blob ON job_file (blob);

-- What one version of the program made of a session: one row per session and versions, whoever computed it how often.
CREATE TABLE result (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- ResultId
    session_id     TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,  -- of which session
    pipeline       TEXT NOT NULL CHECK (length(pipeline) BETWEEN 1 AND 64),  -- PIPELINE_VERSION
    calibration_id TEXT NOT NULL REFERENCES calibration (id) ON DELETE RESTRICT, -- the camera it was made with
    palette_id     TEXT NOT NULL REFERENCES palette (id) ON DELETE RESTRICT, -- the colours it was made with
    model          TEXT CHECK (length(model) BETWEEN 1 AND 120),             -- the model that scored it; NULL: none
    width          INTEGER NOT NULL CHECK (width BETWEEN 1 AND 65535),       -- width as displayed, pixels
    height         INTEGER NOT NULL CHECK (height BETWEEN 1 AND 65535),      -- height as displayed, pixels
    frames         INTEGER NOT NULL CHECK (frames >= 1),                     -- decoded frames
    duration_s     REAL NOT NULL CHECK (duration_s >= 0),                    -- from the first frame to the last, s
    tools          TEXT NOT NULL CHECK (json_valid(tools)),                  -- names of the tools ([String])
    quality        TEXT NOT NULL CHECK (json_valid(quality)),                -- counts and reasons per tool (object)
    score          TEXT CHECK (json_valid(score)),                           -- place in a cohort (object); NULL: none
    trajectory     TEXT NOT NULL REFERENCES blob (hash) ON DELETE RESTRICT,  -- raw, filtered and smoothed paths
    diagnostics    TEXT NOT NULL REFERENCES blob (hash) ON DELETE RESTRICT,  -- what the tracker saw, frame by frame
    preview        TEXT REFERENCES blob (hash) ON DELETE RESTRICT,           -- a JPEG of one frame
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0)               -- when stored, epoch ms
) STRICT;
-- An index, for NULL is not equal to NULL in a UNIQUE constraint.
CREATE UNIQUE INDEX result_once ON result (session_id, pipeline, calibration_id, palette_id, coalesce(model, ''));
CREATE INDEX result_latest ON result (session_id, created_at_ms);
CREATE INDEX result_calibration ON result (calibration_id);
CREATE INDEX result_palette ON result (palette_id);
CREATE INDEX result_trajectory ON result (trajectory);
CREATE INDEX result_diagnostics ON result (diagnostics);
CREATE INDEX result_preview ON result (preview);

-- One feature of one result.
CREATE TABLE feature (
    result_id  TEXT NOT NULL REFERENCES result (id) ON DELETE CASCADE,       -- of which result
    position   INTEGER NOT NULL CHECK (position >= 0),                       -- order in which people read them
    name       TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 64),          -- stable name, as path_length
    title      TEXT NOT NULL CHECK (length(title) BETWEEN 1 AND 200),        -- title for people
    unit       TEXT NOT NULL CHECK (length(unit) <= 32),                     -- unit, as mm; empty: a pure number
    tool       TEXT CHECK (length(tool) BETWEEN 1 AND 64),                   -- marker of the tool; NULL: of the session
    space      TEXT NOT NULL CHECK (space IN ('3d', 'image')),               -- where it was measured
    value      REAL,                                                         -- the value, in `unit`
    not_enough TEXT CHECK (length(not_enough) BETWEEN 1 AND 200),            -- why there is no value
    PRIMARY KEY (result_id, position),
    CHECK ((value IS NULL) <> (not_enough IS NULL))
) STRICT, WITHOUT ROWID;
CREATE UNIQUE INDEX feature_once ON feature (result_id, name, coalesce(tool, ''), space);

-- Every reference to a blob: what is not here may be forgotten.
CREATE VIEW blob_reference (hash) AS
    SELECT video FROM session WHERE video IS NOT NULL
    UNION ALL SELECT blob FROM job_file
    UNION ALL SELECT trajectory FROM result
    UNION ALL SELECT diagnostics FROM result
    UNION ALL SELECT preview FROM result WHERE preview IS NOT NULL;
