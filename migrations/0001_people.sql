-- Who trains, who teaches, who may come in.

-- Somebody who trains. Deleting a row erases the trainee: account, sessions, uploads and jobs go with it.
CREATE TABLE trainee (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- TraineeId
    code          TEXT NOT NULL UNIQUE CHECK (length(code) BETWEEN 1 AND 64), -- short unique name, a-z 0-9 -
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call them
    level         TEXT CHECK (level IN ('novice', 'intermediate', 'expert')), -- said experience; NULL: not said
    handedness    TEXT CHECK (handedness IN ('left', 'right', 'both')),      -- preferred hand; NULL: not said
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when registered, epoch ms
) STRICT;

-- Somebody who can sign in.
CREATE TABLE person (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- PersonId
    login         TEXT NOT NULL UNIQUE CHECK (length(login) BETWEEN 1 AND 64 AND login = lower(login)), -- typed to sign in
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call them
    role          TEXT NOT NULL CHECK (role IN ('administrator', 'instructor', 'trainee')), -- what they may see
    password_hash TEXT NOT NULL CHECK (password_hash LIKE '$argon2id$%'),    -- argon2id in PHC form, with salt and costs
    trainee_id    TEXT UNIQUE REFERENCES trainee (id) ON DELETE CASCADE,     -- the trainee that a trainee's account is of
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when made, epoch ms
    CHECK ((role = 'trainee') = (trainee_id IS NOT NULL))
) STRICT;

-- A training group. An instructor sees the trainees of the groups that they are in.
CREATE TABLE training_group (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- GroupId
    name          TEXT NOT NULL UNIQUE CHECK (length(name) BETWEEN 1 AND 120), -- what people call it
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when made, epoch ms
) STRICT;

-- Which instructors teach a group.
CREATE TABLE group_instructor (
    group_id  TEXT NOT NULL REFERENCES training_group (id) ON DELETE CASCADE, -- the group
    person_id TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,         -- the instructor
    PRIMARY KEY (group_id, person_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX group_instructor_person ON group_instructor (person_id);

-- Which trainees are in a group.
CREATE TABLE group_trainee (
    group_id   TEXT NOT NULL REFERENCES training_group (id) ON DELETE CASCADE, -- the group
    trainee_id TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,        -- the trainee
    PRIMARY KEY (group_id, trainee_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX group_trainee_trainee ON group_trainee (trainee_id);

-- A browser that is signed in. The cookie itself is nowhere stored.
CREATE TABLE cookie_session (
    secret_hash     BLOB PRIMARY KEY CHECK (length(secret_hash) = 32),       -- SHA-256 of the cookie's 32 bytes
    person_id       TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,  -- who is signed in
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0),             -- when they signed in, epoch ms
    last_seen_at_ms INTEGER NOT NULL CHECK (last_seen_at_ms >= created_at_ms), -- last request, to a minute, epoch ms
    expires_at_ms   INTEGER NOT NULL CHECK (expires_at_ms > created_at_ms)   -- the end even for the busy, epoch ms
) STRICT, WITHOUT ROWID;
CREATE INDEX cookie_session_person ON cookie_session (person_id);

-- The schema of boxes is in the next file; tokens name them, so tokens are there too.

-- Who changed what of people's data. Ids only, never names: an erased trainee leaves no name behind.
CREATE TABLE audit (
    id      INTEGER PRIMARY KEY AUTOINCREMENT,                               -- order of writing, never used again
    at_ms   INTEGER NOT NULL CHECK (at_ms >= 0),                             -- when, epoch ms
    actor   TEXT NOT NULL CHECK (length(actor) BETWEEN 1 AND 64),            -- person:ID, agent:BOX or service
    action  TEXT NOT NULL CHECK (length(action) BETWEEN 1 AND 32),           -- create, change, erase, retry, …
    noun    TEXT NOT NULL CHECK (length(noun) BETWEEN 1 AND 32),             -- trainee, person, session, …
    subject TEXT NOT NULL CHECK (length(subject) BETWEEN 1 AND 64)           -- the id of what was changed
) STRICT;
