-- Where features come from in a session, and what people say of it.

-- The seconds that made each feature of a result: read by who looks at one session, and by no list. A result without a row is
-- of a program that did not keep them yet.
CREATE TABLE evidence (
    result_id TEXT PRIMARY KEY REFERENCES result (id) ON DELETE CASCADE,     -- of which result
    rows      TEXT NOT NULL CHECK (json_valid(rows) AND length(rows) <= 1048576) -- one row a feature ([EvidenceRow])
) STRICT, WITHOUT ROWID;

-- What a rater gave a session on a form. Never changed: a newer one of the same rater, session and form takes its place, and the
-- older stays.
CREATE TABLE rating (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- RatingId
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- which session; erased with it
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the rater; NULL: here no more
    form          TEXT NOT NULL CHECK (form IN ('osats', 'goals')),          -- which form
    form_version  INTEGER NOT NULL CHECK (form_version >= 1),                -- which wording of it
    items         TEXT NOT NULL CHECK (json_valid(items)),                   -- a mark from 1 to 5 or null for each item ([Mark])
    is_blind      INTEGER NOT NULL CHECK (is_blind IN (0, 1)),               -- 1: nobody else's of this form could be seen before
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when given, epoch ms
) STRICT;
CREATE INDEX rating_session ON rating (session_id, form, created_at_ms);
CREATE INDEX rating_person ON rating (person_id);

-- What somebody says about a second of a session, or about a stretch of it.
CREATE TABLE comment (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- CommentId
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- about which session; erased with it
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who says it; NULL: here no more
    from_s        REAL NOT NULL CHECK (from_s BETWEEN 0 AND 86400),          -- about which second of the recording, s
    to_s          REAL NOT NULL CHECK (to_s BETWEEN from_s AND 86400),       -- end of the stretch, s; from_s: one moment
    text          TEXT NOT NULL CHECK (length(text) BETWEEN 1 AND 2000),     -- what they say
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when, epoch ms
) STRICT;
CREATE INDEX comment_session ON comment (session_id, from_s);
CREATE INDEX comment_person ON comment (person_id);
