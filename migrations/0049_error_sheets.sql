-- Errors that count: a task's error items and its score formula, both in versions, and the sheets on which raters count errors.

-- A version of a task's list of error items. Never changed; the highest version is the one in use.
CREATE TABLE error_list (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- ErrorListId
    task_id       TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,      -- the task
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the task
    items         TEXT NOT NULL CHECK (json_valid(items)),                   -- the items in their order ([ErrorItem])
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who set it; NULL: the service, or deleted
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when set, epoch ms
    UNIQUE (task_id, version)
) STRICT;
CREATE INDEX error_list_person ON error_list (person_id);

-- A version of a task's score formula. Never changed. A session is scored by the highest version that is valid on its day.
CREATE TABLE score_formula (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- ScoreFormulaId
    task_id       TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,      -- the task
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the task
    definition    TEXT NOT NULL CHECK (json_valid(definition)),              -- cut-off, time, weights and scale (ScoreFormula)
    valid_from    TEXT CHECK (length(valid_from) = 10),                      -- first day of the sessions that it scores, such as 2026-11-21; NULL: all
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who set it; NULL: the service, or deleted
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when set, epoch ms
    UNIQUE (task_id, version)
) STRICT;
CREATE INDEX score_formula_person ON score_formula (person_id);

-- A rater's sheet of one session. While it is open, only its rater reads and changes it. A finished one never changes: a correction
-- is a new sheet, which replaces it when it is finished. A sheet counts while the session is filed under the task of its list.
CREATE TABLE error_sheet (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- ErrorSheetId
    session_id     TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,  -- the session; erased with it
    list_id        TEXT NOT NULL REFERENCES error_list (id) ON DELETE CASCADE, -- the version of the list that it is filled in with
    person_id      TEXT REFERENCES person (id) ON DELETE SET NULL,           -- the rater; NULL: deleted
    time_s         REAL CHECK (time_s > 0 AND time_s <= 86400),              -- time that the rater measured, s; NULL: none was typed
    is_blind       INTEGER CHECK (is_blind IN (0, 1)),                       -- 1: the rater could not see the sheets of others before; NULL: open
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when begun, epoch ms
    finished_at_ms INTEGER CHECK (finished_at_ms >= created_at_ms),          -- when finished, epoch ms; NULL: open
    replaced_at_ms INTEGER CHECK (replaced_at_ms >= finished_at_ms),         -- when a correction replaced it, epoch ms; NULL: it was not
    CHECK ((finished_at_ms IS NULL) = (is_blind IS NULL)),
    CHECK (finished_at_ms IS NOT NULL OR replaced_at_ms IS NULL)
) STRICT;
CREATE UNIQUE INDEX error_sheet_open ON error_sheet (session_id, person_id) WHERE finished_at_ms IS NULL;
CREATE INDEX error_sheet_session ON error_sheet (session_id, finished_at_ms);
CREATE INDEX error_sheet_list ON error_sheet (list_id);
CREATE INDEX error_sheet_person ON error_sheet (person_id);

-- An error that a rater marked on a sheet: one of the counted ones, the yes of an item, or its amount.
CREATE TABLE error_mark (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- ErrorMarkId
    sheet_id      TEXT NOT NULL REFERENCES error_sheet (id) ON DELETE CASCADE, -- the sheet
    item          TEXT NOT NULL CHECK (length(item) BETWEEN 1 AND 64),       -- the item's short name in the sheet's list
    at_s          REAL CHECK (at_s BETWEEN 0 AND 86400),                     -- second of the recording, s; NULL: not at one moment
    amount        REAL CHECK (amount BETWEEN 0 AND 1000000),                 -- in the item's unit; NULL: the item is counted, or yes or no
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when marked, epoch ms
) STRICT;
CREATE INDEX error_mark_sheet ON error_mark (sheet_id, at_s);

-- An open sheet is of use to its rater only.
CREATE TRIGGER rater_leaves_no_open_sheet BEFORE DELETE ON person BEGIN
    DELETE FROM error_sheet WHERE person_id = OLD.id AND finished_at_ms IS NULL;
END;
