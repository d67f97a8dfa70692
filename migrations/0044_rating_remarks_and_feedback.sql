-- Ratings with an overall remark and with items that do not apply, a form for box trainers, the forms that a task uses,
-- when people opened a session, and what they dismissed from the list of what needs attention.

-- Ratings as before, also on the form for box trainers. An item that does not apply has no mark and says so; older marks without
-- a value were not judged. Row numbers stay: they decide which of two ratings of the same moment is the later one.
CREATE TABLE rating_with_remark (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- RatingId
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- the session; erased with it
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the rater; NULL: deleted
    form          TEXT NOT NULL CHECK (form IN ('osats', 'goals', 'box_trainer')), -- the form
    form_version  INTEGER NOT NULL CHECK (form_version >= 1),                -- version of its wording
    items         TEXT NOT NULL CHECK (json_valid(items)),                   -- the mark of each item, or why it has none ([ItemMark])
    remark        TEXT CHECK (length(remark) BETWEEN 1 AND 2000),            -- on the whole session; NULL: none
    is_blind      INTEGER NOT NULL CHECK (is_blind IN (0, 1)),               -- 1: ratings of others on this form could not be seen before
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when given, epoch ms
) STRICT;
INSERT INTO rating_with_remark (rowid, id, session_id, person_id, form, form_version, items, is_blind, created_at_ms)
SELECT rowid, id, session_id, person_id, form, form_version, items, is_blind, created_at_ms FROM rating ORDER BY rowid;
DROP TABLE rating;
ALTER TABLE rating_with_remark RENAME TO rating;
CREATE INDEX rating_session ON rating (session_id, form, created_at_ms);
CREATE INDEX rating_person ON rating (person_id);

ALTER TABLE task ADD COLUMN rating_forms TEXT CHECK (json_valid(rating_forms)); -- the forms that its sessions are rated on ([RatingForm]); NULL: all

-- When a person last opened a session: what others wrote later is new to them.
CREATE TABLE session_opening (
    person_id    TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,     -- the person
    session_id   TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,    -- the session
    opened_at_ms INTEGER NOT NULL CHECK (opened_at_ms >= 0),                 -- when it was opened last, epoch ms
    PRIMARY KEY (person_id, session_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX session_opening_session ON session_opening (session_id);

-- What a person no longer wants to see in their own list of what needs attention: of one kind, about a trainee at a task. It
-- covers the sessions listed in `attention_dismissal_session`, or the alarm that began at `since_ms`; later ones are shown.
CREATE TABLE attention_dismissal (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- DismissalId
    person_id     TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,    -- whose list
    kind          TEXT NOT NULL CHECK (kind IN ('box_asked', 'refused', 'unrated', 'relapsed', 'due')), -- what is dismissed
    trainee_id    TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,   -- the trainee
    task_id       TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,      -- the task
    since_ms      INTEGER,                                                   -- of an alarm: when it began, epoch ms; NULL: sessions are dismissed
    until_ms      INTEGER CHECK (until_ms > created_at_ms),                  -- shown again from then on, epoch ms; NULL: stays dismissed
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when dismissed, epoch ms
    CHECK ((kind IN ('relapsed', 'due')) = (since_ms IS NOT NULL))
) STRICT;
CREATE INDEX attention_dismissal_person ON attention_dismissal (person_id, kind, trainee_id, task_id);
CREATE INDEX attention_dismissal_trainee ON attention_dismissal (trainee_id);
CREATE INDEX attention_dismissal_task ON attention_dismissal (task_id);

CREATE TABLE attention_dismissal_session (
    dismissal_id TEXT NOT NULL REFERENCES attention_dismissal (id) ON DELETE CASCADE, -- the dismissal
    session_id   TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,    -- a session that it covers
    PRIMARY KEY (dismissal_id, session_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX attention_dismissal_session_session ON attention_dismissal_session (session_id);

-- The sessions that a person has dismissed. One that was moved to another trainee or task since is shown again.
CREATE VIEW dismissed_session (person_id, kind, session_id, until_ms) AS
    SELECT dismissal.person_id, dismissal.kind, session.id, dismissal.until_ms
    FROM attention_dismissal AS dismissal
    JOIN attention_dismissal_session AS covered ON covered.dismissal_id = dismissal.id
    JOIN session ON session.id = covered.session_id
         AND session.trainee_id = dismissal.trainee_id AND session.task_id = dismissal.task_id;
