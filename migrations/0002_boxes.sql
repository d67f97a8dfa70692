-- Where people train and what they do there.

-- A file in the vault, by its content. A row exists as long as something refers to it, and the file as long as the row.
CREATE TABLE blob (
    hash          TEXT PRIMARY KEY CHECK (length(hash) = 64),                -- SHA-256 of the bytes, hexadecimal
    bytes         INTEGER NOT NULL CHECK (bytes >= 0),                       -- length, bytes
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when first stored, epoch ms
) STRICT;

-- A box trainer with its camera. `training_box`, because `box` is a type elsewhere.
CREATE TABLE training_box (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- BoxId
    code          TEXT NOT NULL UNIQUE CHECK (length(code) BETWEEN 1 AND 64), -- short unique name, a-z 0-9 -
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call it
    view          TEXT CHECK (view IN ('top', 'side')),                      -- from where the camera looks; NULL: not said
    notes         TEXT NOT NULL DEFAULT '' CHECK (length(notes) <= 10000),   -- anything worth knowing
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when registered, epoch ms
) STRICT;

-- A version of a box's camera. Never changed; the highest version is the one in use.
CREATE TABLE calibration (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- CalibrationId
    box_id        TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- whose camera
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the box
    source        TEXT NOT NULL CHECK (source IN ('file', 'photos', 'video')), -- where it came from
    camera        TEXT NOT NULL CHECK (json_valid(camera)),                  -- camera.json, whole (CameraFile)
    width         INTEGER NOT NULL CHECK (width BETWEEN 1 AND 65535),        -- picture width, pixels
    height        INTEGER NOT NULL CHECK (height BETWEEN 1 AND 65535),       -- picture height, pixels
    rms_px        REAL CHECK (rms_px >= 0),                                  -- reprojection error, pixels; NULL: not said
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when stored, epoch ms
    UNIQUE (box_id, version)
) STRICT;

-- A version of a box's colour samples. Never changed; the highest version is the one in use.
CREATE TABLE palette (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- PaletteId
    box_id        TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- whose colours
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the box
    annotations   TEXT NOT NULL CHECK (json_valid(annotations)),             -- annotations.json, whole (AnnotationsFile)
    tools         TEXT NOT NULL CHECK (json_valid(tools)),                   -- tools and sizes, mm ([BoxTool])
    counts        TEXT NOT NULL CHECK (json_valid(counts)),                  -- samples of each label ([LabelCount])
    samples       BLOB NOT NULL CHECK (length(samples) BETWEEN 1 AND 16777216), -- the samples, in the tracker's own form
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when stored, epoch ms
    UNIQUE (box_id, version)
) STRICT;

-- An exercise.
CREATE TABLE task (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- TaskId
    code          TEXT NOT NULL UNIQUE CHECK (length(code) BETWEEN 1 AND 64), -- short unique name, a-z 0-9 -
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call it
    description   TEXT NOT NULL DEFAULT '' CHECK (length(description) <= 10000), -- what to do
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when registered, epoch ms
) STRICT;

-- A program's way in. The token itself is shown once and nowhere stored.
CREATE TABLE token (
    id              TEXT PRIMARY KEY CHECK (length(id) = 36),                -- TokenId
    secret_hash     BLOB NOT NULL UNIQUE CHECK (length(secret_hash) = 32),   -- SHA-256 of the token's 32 bytes
    name            TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),    -- what it is for
    role            TEXT NOT NULL CHECK (role IN ('administrator', 'instructor', 'trainee', 'agent')), -- its rights
    person_id       TEXT REFERENCES person (id) ON DELETE CASCADE,           -- as whom it acts; NULL for an agent
    box_id          TEXT REFERENCES training_box (id) ON DELETE CASCADE,     -- the agent's box; NULL for people's programs
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0),             -- when made, epoch ms
    expires_at_ms   INTEGER CHECK (expires_at_ms > created_at_ms),           -- its end, epoch ms; NULL: none
    last_used_at_ms INTEGER CHECK (last_used_at_ms >= created_at_ms),        -- last request, to a minute, epoch ms
    CHECK ((role = 'agent') = (box_id IS NOT NULL)),
    CHECK ((role = 'agent') = (person_id IS NULL))
) STRICT;
