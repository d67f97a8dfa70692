-- What tells novices, intermediates and experts apart.

-- A version of a task's model of skill. Never changed, but withdrawn when somebody of whom it was made is erased; the highest
-- version is the one in use. It names nobody.
CREATE TABLE skill_model (
    id              TEXT PRIMARY KEY CHECK (length(id) = 36),                -- ModelId
    task_id         TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,    -- of which task
    version         INTEGER NOT NULL CHECK (version >= 1),                   -- 1, 2, … within the task
    pipeline        TEXT NOT NULL CHECK (length(pipeline) >= 1),             -- version of the program that measured its sessions
    fingerprint     TEXT NOT NULL CHECK (length(fingerprint) = 64),          -- SHA-256 of the values that it was made of
    definition      TEXT CHECK (json_valid(definition)),                     -- the model itself (Definition); NULL: withdrawn
    report          TEXT NOT NULL CHECK (json_valid(report)),                -- how well it does on people left out (Report)
    person_id       TEXT REFERENCES person (id) ON DELETE SET NULL,          -- who made it; NULL: the service, or gone
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0),             -- when made, epoch ms
    withdrawn_at_ms INTEGER CHECK (withdrawn_at_ms >= 0),                    -- when somebody of whom it was made was erased
    UNIQUE (task_id, version),
    CHECK ((definition IS NULL) = (withdrawn_at_ms IS NOT NULL))
) STRICT;
CREATE INDEX skill_model_person_id ON skill_model (person_id);

-- Of whose sessions a model was made: so that it goes when they are erased.
CREATE TABLE skill_model_trainee (
    model_id   TEXT NOT NULL REFERENCES skill_model (id) ON DELETE CASCADE,  -- the model
    trainee_id TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,      -- whose sessions are in it
    PRIMARY KEY (model_id, trainee_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX skill_model_trainee_of ON skill_model_trainee (trainee_id);
