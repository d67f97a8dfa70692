-- Times of recordings that are corrected: by the true frame rate or the true duration that a person gives with the recording or
-- afterwards, or by the rate at which the recorder says that it captured.

-- The true time as the sender gave it with an upload; at most one of the two.
ALTER TABLE upload ADD COLUMN true_frame_rate_hz REAL CHECK (true_frame_rate_hz BETWEEN 1 AND 1000); -- Hz; NULL: not given
ALTER TABLE upload ADD COLUMN true_duration_s REAL CHECK (true_duration_s BETWEEN 0.1 AND 86400); -- s; NULL: not given

-- How the times of a result were computed from the stamps of the file.
ALTER TABLE result ADD COLUMN clock TEXT CHECK (json_valid(clock)); -- ResultClock; NULL: imported, or an older program
-- Without it, a retimed result would be taken for one that exists, if a result with other times had the same edits.
ALTER TABLE result ADD COLUMN time_revision INTEGER NOT NULL DEFAULT 0 CHECK (time_revision >= 0); -- time corrections made and undone before it was tracked
DROP INDEX result_once;
CREATE UNIQUE INDEX result_once ON result (session_id, pipeline, coalesce(tracked_with, pipeline), coalesce(calibration_id, ''),
                                           coalesce(palette_id, ''), coalesce(model, ''), edits, time_revision);

-- The edits with a fourth kind, `retime`. The table is made again under its own name, so that no view has to be renamed.
CREATE TABLE session_edit_copy AS SELECT * FROM session_edit;
DROP TABLE session_edit;
CREATE TABLE session_edit (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- EditId
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- the session; erased with it
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the author; NULL: deleted, or an agent
    kind          TEXT NOT NULL CHECK (kind IN ('trim', 'swap', 'retime', 'set_aside')), -- what is changed
    from_s        REAL CHECK (from_s BETWEEN 0 AND 86400),                   -- first second of the stretch, s; NULL: whole recording
    to_s          REAL CHECK (to_s > from_s AND to_s <= 86400),              -- last second of the stretch, s
    tools         TEXT CHECK (json_valid(tools)),                            -- the two tools that exchange names ([String])
    true_frame_rate_hz REAL CHECK (true_frame_rate_hz BETWEEN 1 AND 1000),   -- the true frame rate, Hz
    true_duration_s REAL CHECK (true_duration_s BETWEEN 0.1 AND 86400),      -- the true time from the first frame to the last, s
    why           TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),      -- the reason, in the author's words
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when made, epoch ms
    undone_by     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the person who undid it; NULL: in force, or deleted
    undone_at_ms  INTEGER CHECK (undone_at_ms >= created_at_ms),             -- when undone, epoch ms; NULL: it is in force
    CHECK ((kind IN ('retime', 'set_aside')) = (from_s IS NULL)),
    CHECK ((from_s IS NULL) = (to_s IS NULL)),
    CHECK ((kind = 'swap') = (tools IS NOT NULL)),
    CHECK ((kind = 'retime') = (coalesce(true_frame_rate_hz, true_duration_s) IS NOT NULL)),
    CHECK (true_frame_rate_hz IS NULL OR true_duration_s IS NULL),
    CHECK (undone_by IS NULL OR undone_at_ms IS NOT NULL)
) STRICT;
INSERT INTO session_edit (id, session_id, person_id, kind, from_s, to_s, tools, why, created_at_ms, undone_by, undone_at_ms)
    SELECT id, session_id, person_id, kind, from_s, to_s, tools, why, created_at_ms, undone_by, undone_at_ms
    FROM session_edit_copy;
DROP TABLE session_edit_copy;
CREATE INDEX session_edit_session ON session_edit (session_id, created_at_ms);
CREATE INDEX session_edit_person ON session_edit (person_id);
CREATE INDEX session_edit_undone_by ON session_edit (undone_by);
-- A session is set aside once at a time. Queries ask this index whether it counts, and must spell the condition alike.
CREATE UNIQUE INDEX session_set_aside ON session_edit (session_id) WHERE kind = 'set_aside' AND undone_at_ms IS NULL;
