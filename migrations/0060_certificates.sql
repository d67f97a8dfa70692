-- Certificates: what was issued stays as it was issued, with the file that was handed out and its signature.

-- The keys that sign certificates. One is in use; earlier ones only verify what they signed.
CREATE TABLE certificate_key (
    id            TEXT PRIMARY KEY CHECK (length(id) = 16),                  -- CertificateKeyId: the first 16 hexadecimal digits of the SHA-256 of the public key
    public_key    BLOB NOT NULL CHECK (length(public_key) = 32),             -- Ed25519
    secret_key    BLOB CHECK (length(secret_key) = 32),                      -- its seed; NULL: retired, and deleted then
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when it was made, epoch ms
    retired_at_ms INTEGER CHECK (retired_at_ms >= created_at_ms),            -- when another key replaced it, epoch ms; NULL: it is in use
    CHECK ((secret_key IS NULL) = (retired_at_ms IS NOT NULL))
) STRICT;
CREATE UNIQUE INDEX certificate_key_in_use ON certificate_key (retired_at_ms IS NULL) WHERE retired_at_ms IS NULL;

-- A certificate. It never changes except for its state. If the person is erased, the row stays without personal data, so that
-- its public address can say so.
CREATE TABLE certificate (
    id               TEXT PRIMARY KEY CHECK (length(id) = 36),               -- CertificateId
    code             TEXT NOT NULL UNIQUE CHECK (length(code) = 26),         -- CertificateCode: the secret part of its public address
    trainee_id       TEXT REFERENCES trainee (id) ON DELETE SET NULL,        -- the trainee; NULL: erased
    task_id          TEXT REFERENCES task (id) ON DELETE SET NULL,           -- the task; NULL: it was deleted
    standard_version INTEGER NOT NULL CHECK (standard_version >= 1),         -- the version of the task's standard that was met
    language         TEXT NOT NULL CHECK (language IN ('en', 'de')),         -- CertificateLanguage
    content          TEXT CHECK (json_valid(content)),                       -- all that it says (CertificateContent); NULL: the person was erased
    pdf              BLOB CHECK (length(pdf) BETWEEN 1 AND 2097152),         -- the signed file; NULL: the person was erased
    key_id           TEXT NOT NULL REFERENCES certificate_key (id),          -- the key that signed it
    person_id        TEXT REFERENCES person (id) ON DELETE SET NULL,         -- who issued it; NULL: deleted
    issued_at_ms     INTEGER NOT NULL CHECK (issued_at_ms >= 0),             -- when, epoch ms
    state            TEXT NOT NULL CHECK (state IN ('valid', 'under_review', 'withdrawn', 'erased')), -- CertificateState
    state_at_ms      INTEGER NOT NULL CHECK (state_at_ms >= 0),              -- since when, epoch ms
    reason           TEXT CHECK (length(reason) BETWEEN 1 AND 2000),         -- why it was withdrawn, for the public; NULL: it was not
    CHECK ((state = 'erased') = (content IS NULL) AND (content IS NULL) = (pdf IS NULL)),
    CHECK ((state = 'withdrawn') = (reason IS NOT NULL))
) STRICT;
CREATE INDEX certificate_trainee ON certificate (trainee_id);
CREATE INDEX certificate_task ON certificate (task_id);
CREATE INDEX certificate_key_of ON certificate (key_id);
CREATE INDEX certificate_person ON certificate (person_id);
CREATE INDEX certificate_state ON certificate (state);

CREATE TRIGGER certificate_stays BEFORE UPDATE OF code, standard_version, language, content, pdf, key_id, issued_at_ms ON certificate
WHEN NEW.state <> 'erased' BEGIN
    SELECT RAISE(ABORT, 'an issued certificate never changes');
END;

-- The sessions that a certificate relies on.
CREATE TABLE certificate_session (
    certificate_id TEXT NOT NULL REFERENCES certificate (id) ON DELETE CASCADE, -- the certificate
    number         INTEGER NOT NULL CHECK (number >= 1),                     -- the session's number on the certificate
    session_id     TEXT REFERENCES session (id) ON DELETE SET NULL,          -- the session; NULL: erased
    PRIMARY KEY (certificate_id, number)
) STRICT;
CREATE INDEX certificate_session_of ON certificate_session (session_id);

-- What happened to a certificate.
CREATE TABLE certificate_event (
    number         INTEGER PRIMARY KEY,                                      -- in the order of events
    certificate_id TEXT NOT NULL REFERENCES certificate (id) ON DELETE CASCADE, -- the certificate
    kind           TEXT NOT NULL CHECK (kind IN ('issued', 'moved_to_person', 'moved_to_task', 'moved_to_box', 'session_erased',
                                                 'session_changed', 'kept', 'withdrawn', 'reinstated')), -- CertificateEventKind
    session_number INTEGER CHECK (session_number >= 1),                      -- which of its sessions; NULL: it is about the certificate
    person_id      TEXT REFERENCES person (id) ON DELETE SET NULL,           -- who; NULL: deleted, or the service
    reason         TEXT CHECK (length(reason) BETWEEN 1 AND 2000),           -- in the person's words; NULL: none was asked for
    at_ms          INTEGER NOT NULL CHECK (at_ms >= 0)                       -- when, epoch ms
) STRICT;
CREATE INDEX certificate_event_of ON certificate_event (certificate_id);
CREATE INDEX certificate_event_person ON certificate_event (person_id);

-- Erasing a person takes all personal data out of their certificates. Reasons may contain names.
CREATE TRIGGER trainee_leaves_certificates BEFORE DELETE ON trainee BEGIN
    DELETE FROM certificate_event WHERE certificate_id IN (SELECT id FROM certificate WHERE trainee_id = OLD.id);
    DELETE FROM certificate_session WHERE certificate_id IN (SELECT id FROM certificate WHERE trainee_id = OLD.id);
    UPDATE certificate
    SET state = 'erased', state_at_ms = CAST(unixepoch('subsec') * 1000 AS INTEGER), content = NULL, pdf = NULL, reason = NULL,
        person_id = NULL, trainee_id = NULL
    WHERE trainee_id = OLD.id;
END;
