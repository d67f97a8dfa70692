-- Consent to recordings, how long the videos of one trainee are kept, and who looked at whose recordings.

-- A text that trainees consent to. A published text never changes; a new version is a new row.
CREATE TABLE consent_text (
    id               TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- ConsentTextId
    version          INTEGER NOT NULL UNIQUE CHECK (version >= 1),              -- 1, 2, 3, … in the order of publishing
    title_en         TEXT CHECK (length(title_en) BETWEEN 1 AND 120),           -- English title; NULL: there is no English text
    body_en          TEXT CHECK (length(body_en) BETWEEN 1 AND 10000),          -- English text
    title_de         TEXT CHECK (length(title_de) BETWEEN 1 AND 120),           -- German title; NULL: there is no German text
    body_de          TEXT CHECK (length(body_de) BETWEEN 1 AND 10000),          -- German text
    required_from_ms INTEGER CHECK (required_from_ms >= 0),                     -- from when on new recordings need consent to this version or a later one, epoch ms; NULL: they do not
    person_id        TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who published it; NULL: deleted
    published_at_ms  INTEGER NOT NULL CHECK (published_at_ms >= 0),             -- when, epoch ms
    CHECK ((title_en IS NULL) = (body_en IS NULL) AND (title_de IS NULL) = (body_de IS NULL)),
    CHECK (title_en IS NOT NULL OR title_de IS NOT NULL)
) STRICT;
CREATE INDEX consent_text_person ON consent_text (person_id);

CREATE TRIGGER consent_text_stays BEFORE UPDATE OF version, title_en, body_en, title_de, body_de, published_at_ms ON consent_text BEGIN
    SELECT RAISE(ABORT, 'a published consent text never changes');
END;

-- A decision about recordings of a trainee. The latest counts; the earlier ones stay.
CREATE TABLE consent (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                     -- ConsentId
    trainee_id    TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,      -- whose; erased with the trainee
    text_id       TEXT NOT NULL REFERENCES consent_text (id),                   -- the version that was decided about
    decision      TEXT NOT NULL CHECK (decision IN ('given', 'refused', 'withdrawn')), -- ConsentDecision
    how           TEXT NOT NULL CHECK (how IN ('signed_in', 'paper', 'staff')), -- ConsentMeans: by the trainee, or recorded by staff, from paper or without
    signed_on     TEXT CHECK (length(signed_on) = 10),                          -- the day on the paper (Day); NULL: not on paper
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,               -- who recorded it; NULL: deleted
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),                  -- when it was recorded, epoch ms
    CHECK ((how = 'paper') = (signed_on IS NOT NULL))
) STRICT;
CREATE INDEX consent_trainee ON consent (trainee_id);
CREATE INDEX consent_of_text ON consent (text_id);
CREATE INDEX consent_person ON consent (person_id);

-- The decision of each trainee that counts, with the version that it is about.
CREATE VIEW latest_consent AS
    SELECT consent.trainee_id, consent.decision, consent.signed_on, consent.created_at_ms, consent_text.version
    FROM consent JOIN consent_text ON consent_text.id = consent.text_id
    WHERE consent.rowid =
        (SELECT max(latest.rowid) FROM consent AS latest WHERE latest.trainee_id = consent.trainee_id);

-- How long the videos of one trainee are kept, if other than the centre's.
CREATE TABLE trainee_retention (
    trainee_id    TEXT PRIMARY KEY REFERENCES trainee (id) ON DELETE CASCADE,   -- whose
    months        INTEGER NOT NULL CHECK (months BETWEEN 0 AND 1200),           -- months after the arrival of a session; 0: videos are kept
    reason        TEXT CHECK (length(reason) BETWEEN 1 AND 2000),               -- why longer than the centre keeps videos; NULL: the shorter of both counts
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,               -- who set it; NULL: deleted
    changed_at_ms INTEGER NOT NULL CHECK (changed_at_ms >= 0)                   -- when, epoch ms
) STRICT;
CREATE INDEX trainee_retention_person ON trainee_retention (person_id);

-- A person other than the trainee opened a session, or exported recordings: one row for each viewer, session and hour.
CREATE TABLE access_entry (
    id         INTEGER PRIMARY KEY,                                             -- order of writing
    trainee_id TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,         -- whose recordings; follows the session
    session_id TEXT REFERENCES session (id) ON DELETE SET NULL,                 -- NULL: an export of all, or the session was erased
    person_id  TEXT REFERENCES person (id) ON DELETE SET NULL,                  -- who; NULL: the account was deleted
    role       TEXT NOT NULL CHECK (role IN ('administrator', 'instructor')),   -- the role that it was opened with
    program    TEXT NOT NULL,                                                   -- name of the token that a program used; empty: a browser
    hour       INTEGER NOT NULL CHECK (hour >= 0),                              -- hours since 1970-01-01 UTC
    at_ms      INTEGER NOT NULL CHECK (at_ms >= 0),                             -- first time in this hour, epoch ms
    parts      INTEGER NOT NULL CHECK (parts BETWEEN 1 AND 31)                  -- what was opened: sum of the numbers of AccessedPart
) STRICT;
CREATE UNIQUE INDEX access_entry_once ON access_entry (session_id, person_id, program, hour);
CREATE INDEX access_entry_trainee ON access_entry (trainee_id, id);
CREATE INDEX access_entry_person ON access_entry (person_id);
CREATE INDEX access_entry_at ON access_entry (at_ms);

CREATE TRIGGER access_entry_follows_session AFTER UPDATE OF trainee_id ON session WHEN OLD.trainee_id <> NEW.trainee_id BEGIN
    UPDATE access_entry SET trainee_id = NEW.trainee_id WHERE session_id = NEW.id;
END;

-- The name of a token was chosen by its person.
CREATE TRIGGER access_entry_forgets_viewer BEFORE DELETE ON person BEGIN
    UPDATE access_entry SET person_id = NULL, program = CASE program WHEN '' THEN '' ELSE '–' END WHERE person_id = OLD.id;
END;
