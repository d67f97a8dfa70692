-- What a task asks for, and who is compared with whom.

-- A version of a task's standard. Never changed; the highest version is the one in use. It holds limits and how many people they
-- were made from, and nobody's own value.
CREATE TABLE standard (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- StandardId
    task_id       TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,      -- of which task
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the task
    definition    TEXT NOT NULL CHECK (json_valid(definition)),              -- targets, pass rule and charts (Definition)
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who set it; NULL: the service, or gone
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when set, epoch ms
    UNIQUE (task_id, version)
) STRICT;
CREATE INDEX standard_person ON standard (person_id);

-- A reference group: people that others are compared with. Either its members are listed, or it is everybody whom level, hand and
-- training group describe.
CREATE TABLE cohort (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- CohortId
    code          TEXT NOT NULL UNIQUE CHECK (length(code) BETWEEN 1 AND 64), -- short unique name, a-z 0-9 -
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call it
    is_list       INTEGER NOT NULL CHECK (is_list IN (0, 1)),                -- 1: who is in it stands in cohort_member
    level         TEXT CHECK (level IN ('novice', 'intermediate', 'expert')), -- only people of this level; NULL: of any
    handedness    TEXT CHECK (handedness IN ('left', 'right', 'both')),      -- only who prefers this hand; NULL: either
    group_id      TEXT REFERENCES training_group (id) ON DELETE RESTRICT,    -- only people of this group; NULL: of any
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when made, epoch ms
    CHECK (is_list = 0 OR (level IS NULL AND handedness IS NULL AND group_id IS NULL))
) STRICT;
CREATE INDEX cohort_group ON cohort (group_id);

-- Who is in a cohort whose members are listed.
CREATE TABLE cohort_member (
    cohort_id  TEXT NOT NULL REFERENCES cohort (id) ON DELETE CASCADE,       -- the cohort
    trainee_id TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,      -- who is in it; erased, they are in it no more
    PRIMARY KEY (cohort_id, trainee_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX cohort_member_trainee ON cohort_member (trainee_id);

-- A trainee's sessions of a task in the order in which they were recorded: progress reads all, a cohort each person's last ones.
CREATE INDEX session_practised ON session (trainee_id, task_id, recorded_at_ms, id);

-- One feature of many results: what progress and cohorts read, whole in the index. A third of the file, and a third of their time.
CREATE INDEX feature_named ON feature (name, result_id, tool, space, value, low, high);
