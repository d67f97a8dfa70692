-- Erasures that can be taken back for some days, and recordings whose video is deleted after some months.

-- The trainees who wait for their erasure. They are in no list and cannot sign in. At `due_at_ms` the service erases them.
CREATE TABLE pending_erasure (
    trainee_id      TEXT PRIMARY KEY REFERENCES trainee (id) ON DELETE CASCADE, -- the trainee
    requested_at_ms INTEGER NOT NULL CHECK (requested_at_ms >= 0),           -- when it was requested, epoch ms
    due_at_ms       INTEGER NOT NULL CHECK (due_at_ms >= 0),                 -- when they are erased for good, epoch ms
    person_id       TEXT REFERENCES person (id) ON DELETE SET NULL           -- who requested it; NULL: the service, or deleted
) STRICT, WITHOUT ROWID;
CREATE INDEX pending_erasure_due ON pending_erasure (due_at_ms);
CREATE INDEX pending_erasure_person ON pending_erasure (person_id);

DROP TRIGGER trainee_erased;
DROP TRIGGER session_erased;
DROP TRIGGER person_erased;

-- Ids of erased people and recordings, as before, and also of requested erasures: `pending` with the time at which it is due,
-- `taken_back` with the time at which it was taken back.
CREATE TABLE erasure_with_requests (
    number INTEGER PRIMARY KEY AUTOINCREMENT,                                -- order of erasing
    kind   TEXT NOT NULL CHECK (kind IN ('trainee', 'session', 'person', 'pending', 'taken_back')), -- what happened to it
    id     TEXT NOT NULL CHECK (length(id) = 36),                            -- id of the trainee, session or account
    at_ms  INTEGER NOT NULL CHECK (at_ms >= 0)                               -- when; of `pending` when it is due, epoch ms
) STRICT;
INSERT INTO erasure_with_requests (number, kind, id, at_ms) SELECT number, kind, id, at_ms FROM erasure ORDER BY number;
DROP TABLE erasure;
ALTER TABLE erasure_with_requests RENAME TO erasure;
CREATE TRIGGER trainee_erased AFTER DELETE ON trainee BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('trainee', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;
CREATE TRIGGER session_erased AFTER DELETE ON session BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('session', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;
CREATE TRIGGER person_erased AFTER DELETE ON person BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('person', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;

-- The sessions that count nowhere: set aside, of a box that is asked about or of another one, or of a trainee who waits for their
-- erasure.
DROP VIEW uncounted_session;
CREATE VIEW uncounted_session (session_id) AS
    SELECT session_id FROM session_edit WHERE kind = 'set_aside' AND undone_at_ms IS NULL
    UNION ALL
    SELECT id FROM session WHERE box_question IN ('asked', 'other_box')
    UNION ALL
    SELECT session.id FROM pending_erasure JOIN session ON session.trainee_id = pending_erasure.trainee_id;

-- When the file was deleted because its recordings were older than the centre keeps videos, epoch ms; NULL: it is there. The row
-- stays, so that the sessions keep the hash and size of their recordings, and the same recording is recognised.
ALTER TABLE blob ADD COLUMN dropped_at_ms INTEGER CHECK (dropped_at_ms >= 0);
