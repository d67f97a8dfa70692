-- Two records of one person, or of one box, are merged: what belongs to one record follows the other. The merged record stays, hidden,
-- with what clashes, and the rows that were taken from it are on a list, so that the two can be separated again.

-- A merge of two records. One row for each, also after they were separated.
CREATE TABLE record_merge (
    id                TEXT PRIMARY KEY CHECK (length(id) = 36),               -- MergeId
    kept_trainee_id   TEXT REFERENCES trainee (id) ON DELETE CASCADE,         -- the record that stays; NULL: of a box
    merged_trainee_id TEXT REFERENCES trainee (id) ON DELETE CASCADE,         -- the record that is hidden; NULL: of a box
    kept_box_id       TEXT REFERENCES training_box (id) ON DELETE CASCADE,    -- the record that stays; NULL: of a person
    merged_box_id     TEXT REFERENCES training_box (id) ON DELETE CASCADE,    -- the record that is hidden; NULL: of a person
    person_id         TEXT REFERENCES person (id) ON DELETE SET NULL,         -- who merged them; NULL: deleted, or the service
    why               TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),   -- the reason, in the person's words
    taken_level       TEXT CHECK (taken_level IN ('novice', 'intermediate', 'expert')), -- level that the kept record lacked and took over; NULL: none
    taken_handedness  TEXT CHECK (taken_handedness IN ('left', 'right', 'both')), -- hand that the kept record lacked and took over; NULL: none
    kept_retention    TEXT CHECK (json_valid(kept_retention)),                -- months that the kept record had before a shorter time replaced them (row of trainee_retention); NULL: they stayed
    created_at_ms     INTEGER NOT NULL CHECK (created_at_ms >= 0),            -- when, epoch ms
    separated_by      TEXT REFERENCES person (id) ON DELETE SET NULL,         -- who separated them; NULL: merged, deleted, or the service
    separated_why     TEXT CHECK (length(separated_why) BETWEEN 1 AND 2000),  -- the reason; NULL: merged
    separated_at_ms   INTEGER CHECK (separated_at_ms >= created_at_ms),       -- when, epoch ms; NULL: merged
    CHECK ((kept_trainee_id IS NULL) = (merged_trainee_id IS NULL)),
    CHECK ((kept_box_id IS NULL) = (merged_box_id IS NULL)),
    CHECK ((kept_trainee_id IS NULL) <> (kept_box_id IS NULL)),
    CHECK (kept_trainee_id <> merged_trainee_id),
    CHECK (kept_box_id <> merged_box_id),
    CHECK ((separated_why IS NULL) = (separated_at_ms IS NULL))
) STRICT;
CREATE INDEX record_merge_kept_trainee ON record_merge (kept_trainee_id) WHERE kept_trainee_id IS NOT NULL;
CREATE INDEX record_merge_of_trainee ON record_merge (merged_trainee_id) WHERE merged_trainee_id IS NOT NULL;
CREATE INDEX record_merge_kept_box ON record_merge (kept_box_id) WHERE kept_box_id IS NOT NULL;
CREATE INDEX record_merge_of_box ON record_merge (merged_box_id) WHERE merged_box_id IS NOT NULL;
CREATE INDEX record_merge_person ON record_merge (person_id);
CREATE INDEX record_merge_separated_by ON record_merge (separated_by);
CREATE UNIQUE INDEX record_merge_trainee ON record_merge (merged_trainee_id) WHERE merged_trainee_id IS NOT NULL AND separated_at_ms IS NULL;
CREATE UNIQUE INDEX record_merge_box ON record_merge (merged_box_id) WHERE merged_box_id IS NOT NULL AND separated_at_ms IS NULL;

-- A row that follows the kept record. The list is emptied when the records are separated.
CREATE TABLE record_merge_row (
    merge_id TEXT NOT NULL REFERENCES record_merge (id) ON DELETE CASCADE,    -- the merge
    part     TEXT NOT NULL CHECK (length(part) BETWEEN 1 AND 32),             -- what the row is (MergedPart)
    row_key  TEXT NOT NULL CHECK (length(row_key) >= 1),                      -- which row: its id, or the rest of its key
    version  INTEGER,                                                         -- its version before, of a calibration or of colours; NULL: of other parts
    PRIMARY KEY (merge_id, part, row_key)
) STRICT, WITHOUT ROWID;

-- The merged trainees, each with the record that is shown in its place. A kept record may have been merged itself.
CREATE VIEW merged_trainee (trainee_id, kept_id) AS
    WITH RECURSIVE followed (trainee_id, kept_id) AS
        (SELECT merged_trainee_id, kept_trainee_id FROM record_merge
         WHERE merged_trainee_id IS NOT NULL AND separated_at_ms IS NULL
         UNION ALL
         SELECT followed.trainee_id, later.kept_trainee_id FROM followed
         JOIN record_merge AS later ON later.merged_trainee_id = followed.kept_id AND later.separated_at_ms IS NULL)
    SELECT trainee_id, kept_id FROM followed
    WHERE NOT EXISTS (SELECT 1 FROM record_merge AS later
                      WHERE later.merged_trainee_id = followed.kept_id AND later.separated_at_ms IS NULL);

-- The merged boxes, likewise.
CREATE VIEW merged_box (box_id, kept_id) AS
    WITH RECURSIVE followed (box_id, kept_id) AS
        (SELECT merged_box_id, kept_box_id FROM record_merge
         WHERE merged_box_id IS NOT NULL AND separated_at_ms IS NULL
         UNION ALL
         SELECT followed.box_id, later.kept_box_id FROM followed
         JOIN record_merge AS later ON later.merged_box_id = followed.kept_id AND later.separated_at_ms IS NULL)
    SELECT box_id, kept_id FROM followed
    WHERE NOT EXISTS (SELECT 1 FROM record_merge AS later
                      WHERE later.merged_box_id = followed.kept_id AND later.separated_at_ms IS NULL);

-- Trainees who are hidden from all people: they wait for their erasure, or another record of the same person is shown.
CREATE VIEW hidden_trainee (trainee_id) AS
    SELECT trainee_id FROM pending_erasure
    UNION ALL
    SELECT merged_trainee_id FROM record_merge WHERE merged_trainee_id IS NOT NULL AND separated_at_ms IS NULL;

-- The sessions that do not count: set aside, of a box that is in question, or of a hidden trainee.
DROP VIEW uncounted_session;
CREATE VIEW uncounted_session (session_id) AS
    SELECT session_id FROM session_edit WHERE kind = 'set_aside' AND undone_at_ms IS NULL
    UNION ALL
    SELECT id FROM session WHERE box_question IN ('asked', 'other_box')
    UNION ALL
    SELECT session.id FROM pending_erasure JOIN session ON session.trainee_id = pending_erasure.trainee_id
    UNION ALL
    SELECT session.id FROM record_merge JOIN session ON session.trainee_id = record_merge.merged_trainee_id
    WHERE record_merge.separated_at_ms IS NULL;
