-- What people change about a session once it is scored: cut off its ends, exchange its tools' names, or let it not count. Nothing of
-- what was measured is touched: results are made anew from the stored path, and whatever is undone here is as if it had never been.

-- One such change. It is never deleted: undone, it stays and says by whom and when.
CREATE TABLE session_edit (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- EditId
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- of which session; erased with it
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who made it; NULL: here no more
    kind          TEXT NOT NULL CHECK (kind IN ('trim', 'swap', 'set_aside')), -- what is changed
    from_s        REAL CHECK (from_s BETWEEN 0 AND 86400),                   -- from which second of the recording, s; NULL: all of it
    to_s          REAL CHECK (to_s > from_s AND to_s <= 86400),              -- to which, s
    tools         TEXT CHECK (json_valid(tools)),                            -- the two tools that change names ([String])
    why           TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),      -- why, in their words
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when made, epoch ms
    undone_by     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who undid it; NULL: nobody, or here no more
    undone_at_ms  INTEGER CHECK (undone_at_ms >= created_at_ms),             -- when undone, epoch ms; NULL: it is in force
    CHECK ((kind = 'set_aside') = (from_s IS NULL)),
    CHECK ((from_s IS NULL) = (to_s IS NULL)),
    CHECK ((kind = 'swap') = (tools IS NOT NULL)),
    CHECK (undone_by IS NULL OR undone_at_ms IS NOT NULL)
) STRICT;
CREATE INDEX session_edit_session ON session_edit (session_id, created_at_ms);
CREATE INDEX session_edit_person ON session_edit (person_id);
CREATE INDEX session_edit_undone_by ON session_edit (undone_by);
-- A session is set aside once at a time. Queries ask this index whether it counts, and must spell the condition alike.
CREATE UNIQUE INDEX session_set_aside ON session_edit (session_id) WHERE kind = 'set_aside' AND undone_at_ms IS NULL;

-- Which state of its session's cuts and exchanges a result was made in: each one that is made or undone is the next. A result that
-- is made after an edit is another one than that from before, though nothing else about it has changed.
ALTER TABLE result ADD COLUMN edits INTEGER NOT NULL DEFAULT 0 CHECK (edits >= 0); -- trims and swaps made and undone by then
DROP INDEX result_once;
CREATE UNIQUE INDEX result_once ON result (session_id, pipeline, coalesce(tracked_with, pipeline), coalesce(calibration_id, ''),
                                           coalesce(palette_id, ''), coalesce(model, ''), edits);
