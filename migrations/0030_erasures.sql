-- Ids of erased people and recordings: they are erased again after an older backup was restored. The ids are random and say nothing
-- about a person.
CREATE TABLE erasure (
    number INTEGER PRIMARY KEY AUTOINCREMENT,                                -- order of erasing
    kind   TEXT NOT NULL CHECK (kind IN ('trainee', 'session', 'person')),   -- what was erased
    id     TEXT NOT NULL CHECK (length(id) = 36),                            -- its id
    at_ms  INTEGER NOT NULL CHECK (at_ms >= 0)                               -- when, epoch ms
) STRICT;
INSERT INTO erasure (kind, id, at_ms)
    SELECT noun, subject, at_ms FROM audit
    WHERE length(subject) = 36 AND (action = 'erase' AND noun IN ('trainee', 'session') OR action = 'delete' AND noun = 'person')
    ORDER BY id;
CREATE TRIGGER trainee_erased AFTER DELETE ON trainee BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('trainee', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;
CREATE TRIGGER session_erased AFTER DELETE ON session BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('session', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;
CREATE TRIGGER person_erased AFTER DELETE ON person BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('person', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;
