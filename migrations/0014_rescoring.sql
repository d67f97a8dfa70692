-- Paths that other trackers measured, and scoring again what is stored.

-- A check cannot be changed in place: the table of jobs is made anew with two more kinds of work, and what refers to it with it.
CREATE TABLE next_job (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- JobId
    kind           TEXT NOT NULL CHECK (kind IN ('track', 'import', 'rescore', 'calibrate', 'palette', 'self_test')), -- what kind of work
    input          TEXT NOT NULL CHECK (json_valid(input)),                  -- what it works on (JobInput)
    input_hash     TEXT NOT NULL CHECK (length(input_hash) = 64),            -- SHA-256 of `input`, hexadecimal
    versions       TEXT NOT NULL CHECK (length(versions) <= 200),            -- what else its result depends on
    session_id     TEXT REFERENCES session (id) ON DELETE CASCADE,           -- the session it is about
    box_id         TEXT REFERENCES training_box (id) ON DELETE CASCADE,      -- the box it is about
    turn           INTEGER NOT NULL CHECK (turn IN (0, 1, 2)),               -- goes before higher ones: boxes, new sessions, rescorings
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
    advice         TEXT CHECK (advice IS NULL OR json_valid(advice)),        -- PaletteAdvice; NULL: the job is about something else, or not done
    UNIQUE (kind, input_hash, versions),
    CHECK ((session_id IS NULL) <> (box_id IS NULL)),
    CHECK ((kind IN ('track', 'import', 'rescore')) = (session_id IS NOT NULL)),
    CHECK ((turn = 0) = (box_id IS NOT NULL)),
    CHECK ((state = 'running') = (lease_token IS NOT NULL)),
    CHECK ((state = 'running') = (lease_until_ms IS NOT NULL)),
    CHECK ((state = 'running') = (worker IS NOT NULL)),
    CHECK ((state IN ('done', 'failed', 'quarantined')) = (ended_at_ms IS NOT NULL)),
    CHECK (state NOT IN ('failed', 'quarantined') OR problem IS NOT NULL)
) STRICT;
INSERT INTO next_job (id, kind, input, input_hash, versions, session_id, box_id, turn, state, attempt, max_attempts, lease_token,
                      lease_until_ms, worker, progress, problem, created_at_ms, queued_at_ms, started_at_ms, ended_at_ms, advice)
    SELECT id, kind, input, input_hash, versions, session_id, box_id, session_id IS NOT NULL, state, attempt, max_attempts, lease_token,
           lease_until_ms, worker, progress, problem, created_at_ms, queued_at_ms, started_at_ms, ended_at_ms, advice FROM job;

-- The files that a job reads.
CREATE TABLE next_job_file (
    job_id TEXT NOT NULL REFERENCES next_job (id) ON DELETE CASCADE,         -- the job
    blob   TEXT NOT NULL REFERENCES blob (hash) ON DELETE RESTRICT,          -- the file
    PRIMARY KEY (job_id, blob)
) STRICT, WITHOUT ROWID;
INSERT INTO next_job_file SELECT * FROM job_file;

DROP VIEW blob_reference;
DROP TABLE job_file;
DROP TABLE job;
ALTER TABLE next_job RENAME TO job; -- also where job_file refers to it
ALTER TABLE next_job_file RENAME TO job_file;

-- The queue in its order: work about boxes goes first, since sessions wait for it, and what was scored before goes last. Queries must
-- spell the order alike.
CREATE INDEX job_waiting ON job (turn, queued_at_ms, id) WHERE state = 'queued';
CREATE INDEX job_quarantined ON job (id) WHERE state = 'quarantined';
CREATE INDEX job_lease ON job (lease_until_ms) WHERE state = 'running';
CREATE INDEX job_session ON job (session_id, created_at_ms);
CREATE INDEX job_box ON job (box_id, created_at_ms);
CREATE INDEX job_file_blob ON job_file (blob);

-- Whose rows a session is. Its `video` is then the table as it was sent.
ALTER TABLE session ADD COLUMN tracker TEXT CHECK (length(tracker) BETWEEN 1 AND 40); -- the tracker that measured it; NULL: a recording, tracked here

-- A result of rows that came alone has no camera, no colours and no picture. A column cannot be made optional in place: its content
-- moves to a new one that takes the name. The rest of the table stays as it is, whatever columns it has.
DROP INDEX result_once;
DROP INDEX result_calibration;
DROP INDEX result_palette;
DROP INDEX result_diagnostics;
ALTER TABLE result ADD COLUMN next_calibration TEXT REFERENCES calibration (id) ON DELETE RESTRICT; -- the camera it was made with; NULL: not measured here
ALTER TABLE result ADD COLUMN next_palette TEXT REFERENCES palette (id) ON DELETE RESTRICT; -- the colours it was made with; NULL: not measured here
ALTER TABLE result ADD COLUMN next_width INTEGER CHECK (next_width BETWEEN 1 AND 65535); -- width as displayed, pixels; NULL: no picture
ALTER TABLE result ADD COLUMN next_height INTEGER CHECK (next_height BETWEEN 1 AND 65535); -- height as displayed, pixels; NULL: no picture
ALTER TABLE result ADD COLUMN next_diagnostics TEXT REFERENCES blob (hash) ON DELETE RESTRICT; -- what the tracker saw, frame by frame; NULL: not tracked here
ALTER TABLE result ADD COLUMN tracked_with TEXT CHECK (length(tracked_with) BETWEEN 1 AND 64); -- PIPELINE_VERSION that made the path; NULL: `pipeline`
UPDATE result SET next_calibration = calibration_id, next_palette = palette_id, next_width = width, next_height = height,
                  next_diagnostics = diagnostics;
ALTER TABLE result DROP COLUMN calibration_id;
ALTER TABLE result DROP COLUMN palette_id;
ALTER TABLE result DROP COLUMN width;
ALTER TABLE result DROP COLUMN height;
ALTER TABLE result DROP COLUMN diagnostics;
ALTER TABLE result RENAME COLUMN next_calibration TO calibration_id;
ALTER TABLE result RENAME COLUMN next_palette TO palette_id;
ALTER TABLE result RENAME COLUMN next_width TO width;
ALTER TABLE result RENAME COLUMN next_height TO height;
ALTER TABLE result RENAME COLUMN next_diagnostics TO diagnostics;

-- One result for each session and versions. An index, for NULL is not equal to NULL in a UNIQUE constraint.
CREATE UNIQUE INDEX result_once ON result (session_id, pipeline, coalesce(tracked_with, pipeline), coalesce(calibration_id, ''),
                                           coalesce(palette_id, ''), coalesce(model, ''));
CREATE INDEX result_calibration ON result (calibration_id);
CREATE INDEX result_palette ON result (palette_id);
CREATE INDEX result_diagnostics ON result (diagnostics);

-- Every reference to a blob: what is not here may be forgotten.
CREATE VIEW blob_reference (hash) AS
    SELECT video FROM session WHERE video IS NOT NULL
    UNION ALL SELECT blob FROM job_file
    UNION ALL SELECT trajectory FROM result
    UNION ALL SELECT diagnostics FROM result WHERE diagnostics IS NOT NULL
    UNION ALL SELECT preview FROM result WHERE preview IS NOT NULL;

-- An order to score a task's sessions again. It stays as a record of what changed for whom.
CREATE TABLE rescoring (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- RescoringId
    task_id        TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,     -- whose sessions
    source         TEXT NOT NULL CHECK (source IN ('trajectory', 'recording')), -- what is read again
    only_older     INTEGER NOT NULL CHECK (only_older IN (0, 1)),            -- 1: sessions whose result is of another version; 0: all
    pipeline       TEXT NOT NULL CHECK (length(pipeline) BETWEEN 1 AND 64),  -- PIPELINE_VERSION when it was ordered
    standard_id    TEXT REFERENCES standard (id) ON DELETE SET NULL,         -- what old and new are judged by; NULL: the task had none
    person_id      TEXT REFERENCES person (id) ON DELETE SET NULL,           -- who ordered it; NULL for the service
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when ordered, epoch ms
    cancelled_at_ms INTEGER,                                                 -- when called off, epoch ms
    ended_at_ms    INTEGER                                                   -- when its last session had ended, epoch ms
) STRICT;
CREATE INDEX rescoring_task ON rescoring (task_id);
CREATE INDEX rescoring_standard ON rescoring (standard_id);
CREATE INDEX rescoring_person ON rescoring (person_id);
CREATE INDEX rescoring_open ON rescoring (id) WHERE ended_at_ms IS NULL;

-- One session of such an order.
CREATE TABLE rescoring_item (
    rescoring_id   TEXT NOT NULL REFERENCES rescoring (id) ON DELETE CASCADE, -- the order
    session_id     TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,  -- the session
    old_result_id  TEXT NOT NULL REFERENCES result (id) ON DELETE CASCADE,   -- what counted when it was ordered
    new_result_id  TEXT REFERENCES result (id) ON DELETE CASCADE,            -- what came of it
    job_id         TEXT REFERENCES job (id) ON DELETE SET NULL,              -- its work, once its turn has come
    state          TEXT NOT NULL CHECK (state IN ('waiting', 'working', 'done', 'failed', 'cancelled')), -- how it stands
    problem        TEXT CHECK (json_valid(problem)),                         -- why it failed (Problem)
    judged_before  TEXT CHECK (judged_before IN ('pass', 'fail', 'unknown')), -- by the standard; NULL: no standard, or not compared yet
    judged_after   TEXT CHECK (judged_after IN ('pass', 'fail', 'unknown')), -- the same of the new result
    judgement_changed INTEGER NOT NULL DEFAULT 0 CHECK (judgement_changed IN (0, 1)), -- 1: not what it was
    features_apart INTEGER NOT NULL DEFAULT 0 CHECK (features_apart >= 0),   -- features whose old and new error bars do not overlap
    features_changed INTEGER NOT NULL DEFAULT 0 CHECK (features_changed >= features_apart), -- features that differ beyond rounding, or that one result lacks
    PRIMARY KEY (rescoring_id, session_id),
    CHECK (state <> 'done' OR new_result_id IS NOT NULL),
    CHECK (state <> 'failed' OR problem IS NOT NULL)
) STRICT, WITHOUT ROWID;
-- The order in which the report lists them, and the one in which they are worked on.
CREATE INDEX rescoring_item_report ON rescoring_item (rescoring_id, judgement_changed DESC, features_apart DESC, features_changed DESC, session_id);
CREATE INDEX rescoring_item_state ON rescoring_item (rescoring_id, state, session_id);
CREATE INDEX rescoring_item_session ON rescoring_item (session_id);
CREATE INDEX rescoring_item_job ON rescoring_item (job_id);
CREATE INDEX rescoring_item_old ON rescoring_item (old_result_id);
CREATE INDEX rescoring_item_new ON rescoring_item (new_result_id);
