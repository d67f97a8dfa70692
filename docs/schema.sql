-- The schema of a fresh database, as SQLite stores it once all files of migrations/ were applied: tables, indexes,
-- triggers, views. `make schema` writes this file and a test compares it. migrations/README.md has the conventions.

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

CREATE TABLE attention_dismissal_session (
    dismissal_id TEXT NOT NULL REFERENCES attention_dismissal (id) ON DELETE CASCADE, -- the dismissal
    session_id   TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,    -- a session that it covers
    PRIMARY KEY (dismissal_id, session_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE audit (
    id      INTEGER PRIMARY KEY AUTOINCREMENT,                               -- order of writing, never used again
    at_ms   INTEGER NOT NULL CHECK (at_ms >= 0),                             -- when, epoch ms
    actor   TEXT NOT NULL CHECK (length(actor) BETWEEN 1 AND 64),            -- person:ID, agent:BOX or service
    action  TEXT NOT NULL CHECK (length(action) BETWEEN 1 AND 32),           -- create, change, erase, retry, …
    noun    TEXT NOT NULL CHECK (length(noun) BETWEEN 1 AND 32),             -- trainee, person, session, …
    subject TEXT NOT NULL CHECK (length(subject) BETWEEN 1 AND 64)           -- the id of what was changed
, address TEXT CHECK (length(address) BETWEEN 2 AND 45), attempt INTEGER CHECK (attempt >= 1)) STRICT;

CREATE TABLE blob (
    hash          TEXT PRIMARY KEY CHECK (length(hash) = 64),                -- SHA-256 of the bytes, hexadecimal
    bytes         INTEGER NOT NULL CHECK (bytes >= 0),                       -- length, bytes
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when first stored, epoch ms
, dropped_at_ms INTEGER CHECK (dropped_at_ms >= 0)) STRICT;

CREATE TABLE box_agent (
    box_id       TEXT PRIMARY KEY REFERENCES training_box (id) ON DELETE CASCADE, -- whose
    program      TEXT NOT NULL CHECK (length(program) <= 120),                   -- program and version, for people
    last_seen_ms INTEGER NOT NULL CHECK (last_seen_ms >= 0)                      -- when its last state arrived, precise to a minute, epoch ms
) STRICT;

CREATE TABLE calibration (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- CalibrationId
    box_id        TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- whose camera
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the box
    source        TEXT NOT NULL CHECK (source IN ('file', 'photos', 'video')), -- where it came from
    camera        TEXT NOT NULL CHECK (json_valid(camera)),                  -- camera.json, whole (CameraFile)
    width         INTEGER NOT NULL CHECK (width BETWEEN 1 AND 65535),        -- picture width, pixels
    height        INTEGER NOT NULL CHECK (height BETWEEN 1 AND 65535),       -- picture height, pixels
    rms_px        REAL CHECK (rms_px >= 0),                                  -- reprojection error, pixels; NULL: not said
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0), valid_from_ms INTEGER CHECK (valid_from_ms >= 0),               -- when stored, epoch ms
    UNIQUE (box_id, version)
) STRICT;

CREATE TABLE centre (
    number    INTEGER PRIMARY KEY CHECK (number = 1),                        -- there is one row
    name      TEXT CHECK (length(name) BETWEEN 1 AND 120),                   -- what people call the centre; NULL: not set
    logo      BLOB CHECK (length(logo) BETWEEN 1 AND 524288),                -- the picture's file as it was sent; NULL: none
    logo_type TEXT CHECK (logo_type IN ('image/png', 'image/jpeg')),         -- its media type
    logo_hash TEXT CHECK (length(logo_hash) = 64),                           -- SHA-256 of the file, hexadecimal
    CHECK ((logo IS NULL) = (logo_type IS NULL) AND (logo IS NULL) = (logo_hash IS NULL))
) STRICT;

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
    reason           TEXT CHECK (length(reason) BETWEEN 1 AND 2000), exam_id TEXT REFERENCES exam (id) ON DELETE SET NULL,         -- why it was withdrawn, for the public; NULL: it was not
    CHECK ((state = 'erased') = (content IS NULL) AND (content IS NULL) = (pdf IS NULL)),
    CHECK ((state = 'withdrawn') = (reason IS NOT NULL))
) STRICT;

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

CREATE TABLE certificate_key (
    id            TEXT PRIMARY KEY CHECK (length(id) = 16),                  -- CertificateKeyId: the first 16 hexadecimal digits of the SHA-256 of the public key
    public_key    BLOB NOT NULL CHECK (length(public_key) = 32),             -- Ed25519
    secret_key    BLOB CHECK (length(secret_key) = 32),                      -- its seed; NULL: retired, and deleted then
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when it was made, epoch ms
    retired_at_ms INTEGER CHECK (retired_at_ms >= created_at_ms),            -- when another key replaced it, epoch ms; NULL: it is in use
    CHECK ((secret_key IS NULL) = (retired_at_ms IS NOT NULL))
) STRICT;

CREATE TABLE certificate_session (
    certificate_id TEXT NOT NULL REFERENCES certificate (id) ON DELETE CASCADE, -- the certificate
    number         INTEGER NOT NULL CHECK (number >= 1),                     -- the session's number on the certificate
    session_id     TEXT REFERENCES session (id) ON DELETE SET NULL,          -- the session; NULL: erased
    PRIMARY KEY (certificate_id, number)
) STRICT;

CREATE TABLE check_in_pin (
    person_id TEXT PRIMARY KEY REFERENCES person (id) ON DELETE CASCADE,         -- whose; deleted with the account
    pin_hash  TEXT NOT NULL CHECK (pin_hash LIKE '$argon2id$%'),                    -- argon2id, like a password's
    set_at_ms INTEGER NOT NULL CHECK (set_at_ms >= 0)                            -- when it was set, epoch ms
) STRICT;

CREATE TABLE cohort (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- CohortId
    code          TEXT NOT NULL UNIQUE CHECK (length(code) BETWEEN 1 AND 64), -- short unique name, a-z 0-9 -
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call it
    is_list       INTEGER NOT NULL CHECK (is_list IN (0, 1)),                -- 1: who is in it stands in cohort_member
    level         TEXT CHECK (level IN ('novice', 'intermediate', 'expert')), -- only people of this level; NULL: of any
    handedness    TEXT CHECK (handedness IN ('left', 'right', 'both')),      -- only who prefers this hand; NULL: either
    group_id      TEXT REFERENCES training_group (id) ON DELETE RESTRICT,    -- only people of this group; NULL: of any
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when made, epoch ms
    CHECK (is_list = 0 OR (level IS NULL AND handedness IS NULL AND group_id IS NULL))
) STRICT;

CREATE TABLE cohort_member (
    cohort_id  TEXT NOT NULL REFERENCES cohort (id) ON DELETE CASCADE,       -- the cohort
    trainee_id TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,      -- who is in it; erased, they are in it no more
    PRIMARY KEY (cohort_id, trainee_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE comment (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- CommentId
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- about which session; erased with it
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who says it; NULL: here no more
    from_s        REAL NOT NULL CHECK (from_s BETWEEN 0 AND 86400),          -- about which second of the recording, s
    to_s          REAL NOT NULL CHECK (to_s BETWEEN from_s AND 86400),       -- end of the stretch, s; from_s: one moment
    text          TEXT NOT NULL CHECK (length(text) BETWEEN 1 AND 2000),     -- what they say
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when, epoch ms
) STRICT;

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

CREATE TABLE cookie_session (
    secret_hash     BLOB PRIMARY KEY CHECK (length(secret_hash) = 32),       -- SHA-256 of the cookie's 32 bytes
    person_id       TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,  -- who is signed in
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0),             -- when they signed in, epoch ms
    last_seen_at_ms INTEGER NOT NULL CHECK (last_seen_at_ms >= created_at_ms), -- last request, to a minute, epoch ms
    expires_at_ms   INTEGER NOT NULL CHECK (expires_at_ms > created_at_ms)   -- the end even for the busy, epoch ms
, browser TEXT NOT NULL DEFAULT '' CHECK (length(browser) <= 200), address TEXT NOT NULL DEFAULT '' CHECK (length(address) <= 64), must_change_password INTEGER NOT NULL DEFAULT 0 CHECK (must_change_password IN (0, 1)), identity_id TEXT REFERENCES identity (id) ON DELETE CASCADE, id_token TEXT CHECK (id_token IS NULL OR length(id_token) <= 8192)) STRICT, WITHOUT ROWID;

CREATE TABLE course (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- CourseId
    name          TEXT NOT NULL UNIQUE CHECK (length(name) BETWEEN 1 AND 120), -- what people call it
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when made, epoch ms
) STRICT;

CREATE TABLE course_step (
    course_id   TEXT NOT NULL REFERENCES course (id) ON DELETE CASCADE,      -- of which plan
    position    INTEGER NOT NULL CHECK (position >= 0),                      -- its place in the plan's order
    task_id     TEXT NOT NULL REFERENCES task (id) ON DELETE RESTRICT,       -- what to train
    within_days INTEGER CHECK (within_days BETWEEN 0 AND 3650),              -- due so many days after the beginning; NULL: at any time
    sessions    INTEGER CHECK (sessions BETWEEN 1 AND 200),                  -- so many sessions; NULL: the task's standard, passed
    PRIMARY KEY (course_id, position)
) STRICT, WITHOUT ROWID;

CREATE TABLE erased_feed (
    id TEXT PRIMARY KEY CHECK (length(id) = 36)                              -- FeedId
) STRICT, WITHOUT ROWID;

CREATE TABLE "erasure" (
    number INTEGER PRIMARY KEY AUTOINCREMENT,                                -- order of erasing
    kind   TEXT NOT NULL CHECK (kind IN ('trainee', 'session', 'person', 'pending', 'taken_back')), -- what happened to it
    id     TEXT NOT NULL CHECK (length(id) = 36),                            -- id of the trainee, session or account
    at_ms  INTEGER NOT NULL CHECK (at_ms >= 0)                               -- when; of `pending` when it is due, epoch ms
) STRICT;

CREATE TABLE error_list (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- ErrorListId
    task_id       TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,      -- the task
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the task
    items         TEXT NOT NULL CHECK (json_valid(items)),                   -- the items in their order ([ErrorItem])
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who set it; NULL: the service, or deleted
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when set, epoch ms
    UNIQUE (task_id, version)
) STRICT;

CREATE TABLE error_mark (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- ErrorMarkId
    sheet_id      TEXT NOT NULL REFERENCES error_sheet (id) ON DELETE CASCADE, -- the sheet
    item          TEXT NOT NULL CHECK (length(item) BETWEEN 1 AND 64),       -- the item's short name in the sheet's list
    at_s          REAL CHECK (at_s BETWEEN 0 AND 86400),                     -- second of the recording, s; NULL: not at one moment
    amount        REAL CHECK (amount BETWEEN 0 AND 1000000),                 -- in the item's unit; NULL: the item is counted, or yes or no
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when marked, epoch ms
) STRICT;

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

CREATE TABLE evidence (
    result_id TEXT PRIMARY KEY REFERENCES result (id) ON DELETE CASCADE,     -- of which result
    rows      TEXT NOT NULL CHECK (json_valid(rows) AND length(rows) <= 1048576) -- one row a feature ([EvidenceRow])
) STRICT, WITHOUT ROWID;

CREATE TABLE exam (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- ExamId
    trainee_id    TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,   -- the candidate
    task_id       TEXT NOT NULL REFERENCES task (id) ON DELETE RESTRICT,     -- the task
    box_id        TEXT NOT NULL REFERENCES training_box (id) ON DELETE RESTRICT, -- the box
    standard_id   TEXT NOT NULL REFERENCES standard (id) ON DELETE RESTRICT, -- the version of the standard that judges it
    attempts      INTEGER NOT NULL CHECK (attempts BETWEEN 1 AND 3),         -- how many attempts the candidate has
    day           TEXT CHECK (length(day) = 10),                             -- note of the day on which it is to be held, YYYY-MM-DD; NULL: none
    state         TEXT NOT NULL CHECK (state IN ('planned', 'running', 'closed', 'cancelled')), -- ExamState
    planned_by    TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who planned it; NULL: deleted, or the service
    planned_at_ms INTEGER NOT NULL CHECK (planned_at_ms >= 0),               -- when, epoch ms
    identity      TEXT CHECK (identity IN ('badge', 'document', 'known')),   -- IdentityCheck: how the examiner confirmed who it is; NULL: not started
    examiner_id   TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the examiner; NULL: not started, or the account was deleted
    examiner      TEXT CHECK (length(examiner) BETWEEN 1 AND 120),           -- name of the examiner at the start; stays when the account is deleted
    handedness    TEXT CHECK (handedness IN ('left', 'right', 'both')),      -- preferred hand of the candidate at the start; NULL: not said, or not started
    self_test_id  TEXT REFERENCES self_test (id) ON DELETE SET NULL,         -- the self-test of the box at the start
    started_at_ms INTEGER CHECK (started_at_ms >= planned_at_ms),            -- when it was started, epoch ms
    result        TEXT CHECK (result IN ('passed', 'not_passed', 'undecided')), -- ExamResult; NULL: not closed
    ended_by      TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who closed or cancelled it; NULL: deleted, or neither
    ended_at_ms   INTEGER CHECK (ended_at_ms >= planned_at_ms),              -- when, epoch ms
    CHECK ((started_at_ms IS NULL) = (identity IS NULL) AND (identity IS NULL) = (examiner IS NULL)),
    CHECK (state <> 'planned' OR started_at_ms IS NULL),
    CHECK (state NOT IN ('running', 'closed') OR started_at_ms IS NOT NULL),
    CHECK ((state = 'closed') = (result IS NOT NULL)),
    CHECK ((state IN ('closed', 'cancelled')) = (ended_at_ms IS NOT NULL))
) STRICT;

CREATE TABLE exam_attempt (
    recording_id  TEXT PRIMARY KEY CHECK (length(recording_id) = 36),        -- FeedId that the service gave to the recording
    exam_id       TEXT NOT NULL REFERENCES exam (id) ON DELETE CASCADE,      -- the exam
    ordered_by    TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who ordered it; NULL: deleted
    ordered_at_ms INTEGER NOT NULL CHECK (ordered_at_ms >= 0),               -- when, epoch ms
    self_test_id  TEXT REFERENCES self_test (id) ON DELETE SET NULL,         -- the self-test of the box that held when it was ordered
    number        INTEGER CHECK (number >= 1),                               -- 1, 2, … in the order of beginning; NULL: it has not begun
    began_at_ms   INTEGER CHECK (began_at_ms >= 0),                          -- when its first frames were announced, epoch ms
    session_id    TEXT REFERENCES session (id) ON DELETE SET NULL,           -- its session; NULL: not begun, or nothing could be kept
    outcome       TEXT CHECK (outcome IN ('passed', 'not_passed', 'undecided', 'refused', 'failed')), -- AttemptOutcome; NULL: not judged yet
    cause         TEXT CHECK (cause IN ('error_bar', 'not_measured', 'other_box', 'set_up', 'interrupted', 'not_live')), -- AttemptCause: why it is undecided
    pipeline      TEXT CHECK (length(pipeline) >= 1),                        -- version of the measurement that was judged
    figures       TEXT CHECK (json_valid(figures)),                          -- the values and limits that were judged (JudgedFigure)
    judged_at_ms  INTEGER CHECK (judged_at_ms >= 0),                         -- when, epoch ms
    completion    TEXT CHECK (completion IN ('completed', 'broken_off')),    -- AttemptCompletion: what the examiner says; NULL: not said
    voided_by     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who voided it; NULL: not voided, or deleted
    void_reason   TEXT CHECK (length(void_reason) BETWEEN 1 AND 2000),       -- why
    voided_at_ms  INTEGER CHECK (voided_at_ms >= 0),                         -- when, epoch ms; NULL: it counts
    UNIQUE (exam_id, number),
    CHECK ((number IS NULL) = (began_at_ms IS NULL)),
    CHECK (number IS NOT NULL OR (session_id IS NULL AND outcome IS NULL AND completion IS NULL AND voided_at_ms IS NULL)),
    CHECK ((outcome IS NULL) = (judged_at_ms IS NULL)),
    CHECK ((cause IS NULL) = (outcome IS NOT 'undecided')),
    CHECK ((voided_at_ms IS NULL) = (void_reason IS NULL))
) STRICT;

CREATE TABLE feature (
    result_id  TEXT NOT NULL REFERENCES result (id) ON DELETE CASCADE,       -- of which result
    position   INTEGER NOT NULL CHECK (position >= 0),                       -- order in which people read them
    name       TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 64),          -- stable name, as path_length
    title      TEXT NOT NULL CHECK (length(title) BETWEEN 1 AND 200),        -- title for people
    unit       TEXT NOT NULL CHECK (length(unit) <= 32),                     -- unit, as mm; empty: a pure number
    tool       TEXT CHECK (length(tool) BETWEEN 1 AND 64),                   -- marker of the tool; NULL: of the session
    space      TEXT NOT NULL CHECK (space IN ('3d', 'image')),               -- where it was measured
    value      REAL,                                                         -- the value, in `unit`
    not_enough TEXT CHECK (length(not_enough) BETWEEN 1 AND 200), as_measured REAL, sigma REAL CHECK (sigma >= 0), low REAL, high REAL CHECK (high >= low), no_error TEXT CHECK (length(no_error) BETWEEN 1 AND 200),            -- why there is no value
    PRIMARY KEY (result_id, position),
    CHECK ((value IS NULL) <> (not_enough IS NULL))
) STRICT, WITHOUT ROWID;

CREATE TABLE feed (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- FeedId, made by the sender; its log has the same name
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- the session that it is
    box_id        TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- where
    codec         TEXT NOT NULL CHECK (codec IN ('jpeg', 'h264')),           -- how frames are coded
    width         INTEGER NOT NULL CHECK (width BETWEEN 1 AND 65535),        -- picture width, pixels
    height        INTEGER NOT NULL CHECK (height BETWEEN 1 AND 65535),       -- picture height, pixels
    tick_num      INTEGER NOT NULL CHECK (tick_num >= 1),                    -- a tick of its clock: tick_num / tick_den seconds
    tick_den      INTEGER NOT NULL CHECK (tick_den >= 1),                    -- see tick_num
    sender        TEXT NOT NULL CHECK (length(sender) <= 120),               -- the sender's program, for people
    epoch         INTEGER NOT NULL CHECK (epoch >= 1),                       -- connections so far; only the last may send
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when first heard of, epoch ms
    ended_at_ms   INTEGER CHECK (ended_at_ms >= created_at_ms),              -- when its recording was stored, epoch ms
    live_features TEXT CHECK (json_valid(live_features))                     -- at its end, by the causal filter: [LiveFeature]
, is_push INTEGER NOT NULL DEFAULT 0 CHECK (is_push IN (0, 1)), arrived_s REAL CHECK (arrived_s >= 0), stamped_s REAL CHECK (stamped_s >= 0), actor TEXT CHECK (length(actor) BETWEEN 1 AND 64), resumes INTEGER NOT NULL DEFAULT 1 CHECK (resumes IN (0, 1)), early_end TEXT CHECK (early_end IN ('source_lost', 'sender_gone', 'by_person')), early_end_detail TEXT CHECK (length(early_end_detail) BETWEEN 1 AND 200)) STRICT;

CREATE TABLE group_course (
    group_id  TEXT PRIMARY KEY REFERENCES training_group (id) ON DELETE CASCADE, -- the group
    course_id TEXT NOT NULL REFERENCES course (id) ON DELETE RESTRICT,       -- the plan
    begins    TEXT NOT NULL CHECK (begins GLOB '[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]') -- first day, as 2026-01-05
) STRICT, WITHOUT ROWID;

CREATE TABLE group_instructor (
    group_id  TEXT NOT NULL REFERENCES training_group (id) ON DELETE CASCADE, -- the group
    person_id TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,         -- the instructor
    PRIMARY KEY (group_id, person_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE group_trainee (
    group_id   TEXT NOT NULL REFERENCES training_group (id) ON DELETE CASCADE, -- the group
    trainee_id TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,        -- the trainee
    PRIMARY KEY (group_id, trainee_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE identity (
    id              TEXT PRIMARY KEY CHECK (length(id) = 36),                -- IdentityId
    issuer          TEXT NOT NULL CHECK (length(issuer) BETWEEN 1 AND 1000), -- address of the provider, as its tokens state it
    subject         TEXT NOT NULL CHECK (length(subject) BETWEEN 1 AND 255), -- the account's id there
    person_id       TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,  -- who signs in with it
    label           TEXT NOT NULL CHECK (length(label) BETWEEN 1 AND 120),   -- the account's name there at its last use, for people
    follows_groups  INTEGER NOT NULL CHECK (follows_groups IN (0, 1)),       -- 1: it made the account here, whose role follows its groups; 0: it was linked to an account of this centre
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0),             -- when it was linked, epoch ms
    last_used_at_ms INTEGER CHECK (last_used_at_ms >= 0),                    -- when it last signed in, epoch ms; NULL: never
    UNIQUE (issuer, subject),
    UNIQUE (person_id, issuer)
) STRICT;

CREATE TABLE installation (
    number        INTEGER PRIMARY KEY CHECK (number = 1),                    -- there is one row
    id            TEXT NOT NULL CHECK (length(id) = 36),                     -- InstallationId
    backup_folder TEXT CHECK (length(backup_folder) >= 1)                    -- of the scheduled backups, when last seen; NULL: none
) STRICT;

CREATE TABLE "job" (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- JobId
    kind           TEXT NOT NULL,                                            -- JobKind
    input          TEXT NOT NULL CHECK (json_valid(input)),                  -- JobInput
    input_hash     TEXT NOT NULL CHECK (length(input_hash) = 64),            -- SHA-256 of `input`, hexadecimal
    versions       TEXT NOT NULL CHECK (length(versions) <= 200),            -- what else its result depends on
    session_id     TEXT REFERENCES session (id) ON DELETE CASCADE,           -- the session that it works on; NULL: none
    box_id         TEXT REFERENCES training_box (id) ON DELETE CASCADE,      -- the box that it works on; NULL: none
    subject        TEXT NOT NULL AS (iif(session_id IS NULL, 'box', 'session')), -- which of the two it works on
    turn           INTEGER NOT NULL CHECK (turn IN (0, 1, 2)),               -- JobPriority: lower numbers run first
    state          TEXT NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed', 'quarantined')), -- JobState
    attempt        INTEGER NOT NULL DEFAULT 0 CHECK (attempt BETWEEN 0 AND max_attempts), -- crashes, and this attempt
    max_attempts   INTEGER NOT NULL CHECK (max_attempts BETWEEN 1 AND 20),   -- crashes after which it is quarantined
    lease_token    TEXT CHECK (length(lease_token) = 36),                    -- LeaseToken; NULL: no worker has it
    lease_until_ms INTEGER,                                                  -- end of the lease, epoch ms
    worker         TEXT CHECK (length(worker) BETWEEN 1 AND 120),            -- worker that has the lease, for people
    progress       REAL NOT NULL DEFAULT 0 CHECK (progress BETWEEN 0 AND 1), -- share done
    problem        TEXT CHECK (json_valid(problem)),                         -- why it failed or last crashed (Problem)
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when it was first queued, epoch ms
    queued_at_ms   INTEGER NOT NULL CHECK (queued_at_ms >= created_at_ms),   -- when it was last queued, epoch ms
    started_at_ms  INTEGER,                                                  -- when it was last claimed, epoch ms
    ended_at_ms    INTEGER,                                                  -- when it ended, epoch ms
    advice         TEXT CHECK (json_valid(advice)), lost_leases INTEGER NOT NULL DEFAULT 0 CHECK (lost_leases >= 0), calibration_id TEXT AS (iif(json_valid(input), json_extract(input, '$.calibration'), NULL)),                          -- PaletteAdvice; NULL: none (yet)
    UNIQUE (kind, input_hash, versions),
    FOREIGN KEY (kind, subject) REFERENCES job_kind (name, subject) ON DELETE RESTRICT, -- a known kind, on its subject
    CHECK ((session_id IS NULL) <> (box_id IS NULL)),
    CHECK ((turn = 0) = (box_id IS NOT NULL)),
    CHECK ((state = 'running') = (lease_token IS NOT NULL)),
    CHECK ((state = 'running') = (lease_until_ms IS NOT NULL)),
    CHECK ((state = 'running') = (worker IS NOT NULL)),
    CHECK ((state IN ('done', 'failed', 'quarantined')) = (ended_at_ms IS NOT NULL)),
    CHECK (state NOT IN ('failed', 'quarantined') OR problem IS NOT NULL)
) STRICT;

CREATE TABLE "job_file" (
    job_id TEXT NOT NULL REFERENCES "job" (id) ON DELETE CASCADE,         -- the job
    blob   TEXT NOT NULL REFERENCES blob (hash) ON DELETE RESTRICT,          -- the file
    PRIMARY KEY (job_id, blob)
) STRICT, WITHOUT ROWID;

CREATE TABLE job_kind (
    name    TEXT PRIMARY KEY CHECK (length(name) BETWEEN 1 AND 32),          -- JobKind
    subject TEXT NOT NULL CHECK (subject IN ('session', 'box')),             -- what its jobs work on
    UNIQUE (name, subject)
) STRICT, WITHOUT ROWID;

CREATE TABLE known_place (
    person_id       TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,  -- whose account
    place_hash      BLOB NOT NULL CHECK (length(place_hash) = 32),           -- SHA-256 of a browser's secret, or of account and address
    last_used_at_ms INTEGER NOT NULL CHECK (last_used_at_ms >= 0),           -- the last sign-in from there, epoch ms
    PRIMARY KEY (person_id, place_hash)
) STRICT, WITHOUT ROWID;

CREATE TABLE ownership (
    group_id  TEXT NOT NULL REFERENCES training_group (id) ON DELETE CASCADE, -- the group
    box_id    TEXT REFERENCES training_box (id) ON DELETE CASCADE,           -- the box that it owns; NULL: something else
    task_id   TEXT REFERENCES task (id) ON DELETE CASCADE,                   -- the task that it owns; NULL: something else
    course_id TEXT REFERENCES course (id) ON DELETE CASCADE,                 -- the course plan that it owns; NULL: something else
    thing_id  TEXT NOT NULL AS (coalesce(box_id, task_id, course_id)),       -- id of the box, task or plan
    UNIQUE (thing_id, group_id),
    CHECK ((box_id IS NOT NULL) + (task_id IS NOT NULL) + (course_id IS NOT NULL) = 1)
) STRICT;

CREATE TABLE palette (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- PaletteId
    box_id        TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- whose colours
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the box
    annotations   TEXT NOT NULL CHECK (json_valid(annotations)),             -- annotations.json, whole (AnnotationsFile)
    tools         TEXT NOT NULL CHECK (json_valid(tools)),                   -- tools and sizes, mm ([BoxTool])
    counts        TEXT NOT NULL CHECK (json_valid(counts)),                  -- samples of each label ([LabelCount])
    samples       BLOB NOT NULL CHECK (length(samples) BETWEEN 1 AND 16777216), -- the samples, in the tracker's own form
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0), report TEXT CHECK (report IS NULL OR json_valid(report)), valid_from_ms INTEGER CHECK (valid_from_ms >= 0),               -- when stored, epoch ms
    UNIQUE (box_id, version)
) STRICT;

CREATE TABLE palette_surroundings (
    palette_id TEXT PRIMARY KEY REFERENCES palette (id) ON DELETE CASCADE,   -- the colours that were marked on these pictures
    picture    BLOB NOT NULL CHECK (length(picture) BETWEEN 3 AND 16386)     -- a small grey picture (Surroundings)
) STRICT, WITHOUT ROWID;

CREATE TABLE password_link (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                         -- PasswordLinkId
    person_id     TEXT NOT NULL UNIQUE REFERENCES person (id) ON DELETE CASCADE,    -- whose password it sets; a new link replaces the one before
    secret_hash   BLOB NOT NULL UNIQUE CHECK (length(secret_hash) = 32),            -- SHA-256 of the secret's 32 bytes
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),                      -- when it was made, epoch ms
    expires_at_ms INTEGER NOT NULL CHECK (expires_at_ms > created_at_ms)            -- when it expires, epoch ms
, made_by TEXT REFERENCES person (id) ON DELETE CASCADE) STRICT;

CREATE TABLE pending_erasure (
    trainee_id      TEXT PRIMARY KEY REFERENCES trainee (id) ON DELETE CASCADE, -- the trainee
    requested_at_ms INTEGER NOT NULL CHECK (requested_at_ms >= 0),           -- when it was requested, epoch ms
    due_at_ms       INTEGER NOT NULL CHECK (due_at_ms >= 0),                 -- when they are erased for good, epoch ms
    person_id       TEXT REFERENCES person (id) ON DELETE SET NULL           -- who requested it; NULL: the service, or deleted
) STRICT, WITHOUT ROWID;

CREATE TABLE person (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- PersonId
    login         TEXT NOT NULL UNIQUE CHECK (length(login) BETWEEN 1 AND 64 AND login = lower(login)), -- typed to sign in
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call them
    role          TEXT NOT NULL CHECK (role IN ('administrator', 'instructor', 'trainee')), -- what they may see
    password_hash TEXT NOT NULL CHECK (password_hash LIKE '$argon2id$%'),    -- argon2id in PHC form, with salt and costs
    trainee_id    TEXT UNIQUE REFERENCES trainee (id) ON DELETE CASCADE,     -- the trainee that a trainee's account is of
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0), password_state TEXT NOT NULL DEFAULT 'own'
    CHECK (password_state IN ('missing', 'own', 'change_in_browser', 'change_required')),               -- when made, epoch ms
    CHECK ((role = 'trainee') = (trainee_id IS NOT NULL))
) STRICT;

CREATE TABLE "rating" (
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
    separated_at_ms   INTEGER CHECK (separated_at_ms >= created_at_ms), retention_after TEXT CHECK (json_valid(retention_after)),       -- when, epoch ms; NULL: merged
    CHECK ((kept_trainee_id IS NULL) = (merged_trainee_id IS NULL)),
    CHECK ((kept_box_id IS NULL) = (merged_box_id IS NULL)),
    CHECK ((kept_trainee_id IS NULL) <> (kept_box_id IS NULL)),
    CHECK (kept_trainee_id <> merged_trainee_id),
    CHECK (kept_box_id <> merged_box_id),
    CHECK ((separated_why IS NULL) = (separated_at_ms IS NULL))
) STRICT;

CREATE TABLE record_merge_row (
    merge_id TEXT NOT NULL REFERENCES record_merge (id) ON DELETE CASCADE,    -- the merge
    part     TEXT NOT NULL CHECK (length(part) BETWEEN 1 AND 32),             -- what the row is (MergedPart)
    row_key  TEXT NOT NULL CHECK (length(row_key) >= 1),                      -- which row: its id, or the rest of its key
    version  INTEGER,                                                         -- its version before, of a calibration or of colours; NULL: of other parts
    PRIMARY KEY (merge_id, part, row_key)
) STRICT, WITHOUT ROWID;

CREATE TABLE rescoring (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- RescoringId
    task_id        TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,     -- whose sessions
    source         TEXT NOT NULL CHECK (source IN ('trajectory', 'recording')), -- what is read again
    only_older     INTEGER NOT NULL CHECK (only_older IN (0, 1)),            -- 1: sessions whose result is of another version; 0: all
    pipeline       TEXT NOT NULL CHECK (length(pipeline) BETWEEN 1 AND 64),  -- PIPELINE_VERSION when it was ordered
    standard_id    TEXT REFERENCES standard (id) ON DELETE SET NULL,         -- what old and new are judged by; NULL: the task had none
    person_id      TEXT REFERENCES person (id) ON DELETE SET NULL,           -- who ordered it; NULL for the service
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when ordered, epoch ms
    cancelled_at_ms INTEGER,                                                 -- when called off, epoch ms
    ended_at_ms    INTEGER                                                   -- when its last session had ended, epoch ms
) STRICT;

CREATE TABLE rescoring_item (
    rescoring_id   TEXT NOT NULL REFERENCES rescoring (id) ON DELETE CASCADE, -- the order
    session_id     TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,  -- the session
    old_result_id  TEXT NOT NULL REFERENCES result (id) ON DELETE CASCADE,   -- what counted when it was ordered
    new_result_id  TEXT REFERENCES result (id) ON DELETE CASCADE,            -- what came of it
    job_id         TEXT REFERENCES job (id) ON DELETE SET NULL,              -- its work, once its turn has come
    state          TEXT NOT NULL CHECK (state IN ('waiting', 'working', 'done', 'failed', 'cancelled')), -- how it stands
    problem        TEXT CHECK (json_valid(problem)),                         -- why it failed (Problem)
    judged_before  TEXT CHECK (judged_before IN ('pass', 'fail', 'unknown')), -- by the standard; NULL: no standard, or not compared yet
    judged_after   TEXT CHECK (judged_after IN ('pass', 'fail', 'unknown')), -- the same of the new result
    judgement_changed INTEGER NOT NULL DEFAULT 0 CHECK (judgement_changed IN (0, 1)), -- 1: not what it was
    features_apart INTEGER NOT NULL DEFAULT 0 CHECK (features_apart >= 0),   -- features whose old and new error bars do not overlap
    features_changed INTEGER NOT NULL DEFAULT 0 CHECK (features_changed >= features_apart), -- features that differ beyond rounding, or that one result lacks
    PRIMARY KEY (rescoring_id, session_id),
    CHECK (state <> 'done' OR new_result_id IS NOT NULL),
    CHECK (state <> 'failed' OR problem IS NOT NULL)
) STRICT, WITHOUT ROWID;

CREATE TABLE result (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- ResultId
    session_id     TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,  -- of which session
    pipeline       TEXT NOT NULL CHECK (length(pipeline) BETWEEN 1 AND 64),  -- PIPELINE_VERSION
    model          TEXT CHECK (length(model) BETWEEN 1 AND 120),             -- the model that scored it; NULL: none
    frames         INTEGER NOT NULL CHECK (frames >= 1),                     -- decoded frames
    duration_s     REAL NOT NULL CHECK (duration_s >= 0),                    -- from the first frame to the last, s
    tools          TEXT NOT NULL CHECK (json_valid(tools)),                  -- names of the tools ([String])
    quality        TEXT NOT NULL CHECK (json_valid(quality)),                -- counts and reasons per tool (object)
    score          TEXT CHECK (json_valid(score)),                           -- place in a cohort (object); NULL: none
    trajectory     TEXT NOT NULL REFERENCES blob (hash) ON DELETE RESTRICT,  -- raw, filtered and smoothed paths
    preview        TEXT REFERENCES blob (hash) ON DELETE RESTRICT,           -- a JPEG of one frame
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0)               -- when stored, epoch ms
, calibration_id TEXT REFERENCES calibration (id) ON DELETE RESTRICT, palette_id TEXT REFERENCES palette (id) ON DELETE RESTRICT, width INTEGER CHECK (width BETWEEN 1 AND 65535), height INTEGER CHECK (height BETWEEN 1 AND 65535), diagnostics TEXT REFERENCES blob (hash) ON DELETE RESTRICT, tracked_with TEXT CHECK (length(tracked_with) BETWEEN 1 AND 64), edits INTEGER NOT NULL DEFAULT 0 CHECK (edits >= 0), clock TEXT CHECK (json_valid(clock)), time_revision INTEGER NOT NULL DEFAULT 0 CHECK (time_revision >= 0), left_tool TEXT CHECK (length(left_tool) BETWEEN 1 AND 64), right_tool TEXT CHECK (length(right_tool) BETWEEN 1 AND 64), trocar_middle_mm REAL) STRICT;

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

CREATE TABLE self_test (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- SelfTestId
    box_id         TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- of which box
    calibration_id TEXT NOT NULL REFERENCES calibration (id) ON DELETE CASCADE, -- the camera that was tested
    palette_id     TEXT NOT NULL REFERENCES palette (id) ON DELETE CASCADE,  -- the colours that were tested
    person_id      TEXT REFERENCES person (id) ON DELETE SET NULL,           -- who tested it; NULL: the service, or gone
    pipeline       TEXT NOT NULL CHECK (length(pipeline) BETWEEN 1 AND 64),  -- PIPELINE_VERSION
    light          TEXT NOT NULL CHECK (light IN ('green', 'yellow', 'red', 'not_measured')), -- the worst of its parts
    report         TEXT NOT NULL CHECK (json_valid(report)),                 -- all figures (SelfTestReport)
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0)               -- when stored, epoch ms
) STRICT;

CREATE TABLE session (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- SessionId
    trainee_id     TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,  -- who trained
    task_id        TEXT NOT NULL REFERENCES task (id) ON DELETE RESTRICT,    -- what they did
    box_id         TEXT NOT NULL REFERENCES training_box (id) ON DELETE RESTRICT, -- where
    filename       TEXT NOT NULL CHECK (length(filename) BETWEEN 1 AND 255), -- the recording's name as it was sent
    media_type     TEXT NOT NULL CHECK (length(media_type) BETWEEN 3 AND 127), -- the recording's type, as video/mp4
    whole_video          TEXT REFERENCES blob (hash) ON DELETE RESTRICT,           -- the recording; NULL: it is still arriving
    recorded_at_ms INTEGER NOT NULL,                                         -- when it was recorded, epoch ms
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0), tracker TEXT CHECK (length(tracker) BETWEEN 1 AND 40), box_question TEXT CHECK (box_question IN ('asked', 'this_box', 'other_box')), recorded_at_source TEXT NOT NULL DEFAULT 'claimed' CHECK (recorded_at_source IN ('claimed', 'arrival')), path_hash TEXT CHECK (length(path_hash) = 64), supervision TEXT CHECK (supervision IN ('sent_by_staff', 'marked', 'none')), supervised_by TEXT REFERENCES person (id) ON DELETE SET NULL, supervised_at_ms INTEGER CHECK (supervised_at_ms >= 0), date_known INTEGER NOT NULL DEFAULT 0 CHECK (date_known IN (0, 1)), video TEXT REFERENCES blob (hash) ON DELETE RESTRICT, is_part INTEGER NOT NULL DEFAULT 0 CHECK (is_part IN (0, 1)), cut_of TEXT CHECK (length(cut_of) = 36),              -- when it was whole here, epoch ms
    UNIQUE (trainee_id, task_id, box_id, whole_video)
) STRICT;

CREATE TABLE session_cut (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                    -- CutId
    first_id       TEXT REFERENCES session (id) ON DELETE SET NULL,             -- the session with the part before the cut; NULL: erased
    second_id      TEXT REFERENCES session (id) ON DELETE SET NULL,             -- the session with the part after it; NULL: erased, or joined
    first_edit_id  TEXT REFERENCES session_edit (id) ON DELETE SET NULL,        -- the trim of the first part
    second_edit_id TEXT REFERENCES session_edit (id) ON DELETE SET NULL,        -- the trim of the second part
    at_s           REAL NOT NULL CHECK (at_s > 0 AND at_s < 86400),             -- where it was cut, s of the recording
    person_id      TEXT REFERENCES person (id) ON DELETE SET NULL,              -- who cut it; NULL: deleted, or the service
    why            TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),        -- the reason, in the person's words
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),                 -- when, epoch ms
    joined_by      TEXT REFERENCES person (id) ON DELETE SET NULL,              -- who joined the parts; NULL: cut, deleted, or the service
    joined_at_ms   INTEGER CHECK (joined_at_ms >= created_at_ms)                -- when, epoch ms; NULL: it is cut
) STRICT;

CREATE TABLE session_edit (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- EditId
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- the session; erased with it
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the author; NULL: deleted, or an agent
    kind          TEXT NOT NULL CHECK (kind IN ('trim', 'swap', 'retime', 'set_aside', 'this_box', 'other_box')), -- what is changed or answered
    from_s        REAL CHECK (from_s BETWEEN 0 AND 86400),                   -- first second of the stretch, s; NULL: whole recording
    to_s          REAL CHECK (to_s > from_s AND to_s <= 86400),              -- last second of the stretch, s
    tools         TEXT CHECK (json_valid(tools)),                            -- the two tools that exchange names ([String])
    true_frame_rate_hz REAL CHECK (true_frame_rate_hz BETWEEN 1 AND 1000),   -- the true frame rate, Hz
    true_duration_s REAL CHECK (true_duration_s BETWEEN 0.1 AND 86400),      -- the true time from the first frame to the last, s
    why           TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),      -- the reason, in the author's words
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when made, epoch ms
    undone_by     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- the person who undid it; NULL: in force, or deleted
    undone_at_ms  INTEGER CHECK (undone_at_ms >= created_at_ms), box_id TEXT REFERENCES training_box (id) ON DELETE SET NULL,             -- when undone, epoch ms; NULL: it is in force
    CHECK ((kind IN ('trim', 'swap')) = (from_s IS NOT NULL)),
    CHECK ((from_s IS NULL) = (to_s IS NULL)),
    CHECK ((kind = 'swap') = (tools IS NOT NULL)),
    CHECK ((kind = 'retime') = (coalesce(true_frame_rate_hz, true_duration_s) IS NOT NULL)),
    CHECK (true_frame_rate_hz IS NULL OR true_duration_s IS NULL),
    CHECK (undone_by IS NULL OR undone_at_ms IS NOT NULL)
) STRICT;

CREATE TABLE session_move (
    id              TEXT PRIMARY KEY CHECK (length(id) = 36),                -- MoveId
    session_id      TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE, -- the session; erased with it
    person_id       TEXT REFERENCES person (id) ON DELETE SET NULL,          -- who moved it; NULL: deleted, or the service
    from_trainee_id TEXT REFERENCES trainee (id) ON DELETE SET NULL,         -- the trainee before; NULL: erased
    to_trainee_id   TEXT REFERENCES trainee (id) ON DELETE SET NULL,         -- the trainee after; NULL: erased
    from_task_id    TEXT REFERENCES task (id) ON DELETE SET NULL,            -- the task before; NULL: deleted
    to_task_id      TEXT REFERENCES task (id) ON DELETE SET NULL,            -- the task after; NULL: deleted
    from_box_id     TEXT REFERENCES training_box (id) ON DELETE SET NULL,    -- the box before; NULL: deleted
    to_box_id       TEXT REFERENCES training_box (id) ON DELETE SET NULL,    -- the box after; NULL: deleted
    changes         TEXT NOT NULL CHECK (json_valid(changes)),               -- what was changed: of `trainee`, `task`, `box` ([String])
    why             TEXT NOT NULL CHECK (length(why) BETWEEN 1 AND 2000),    -- the reason, in the person's words
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0)              -- when, epoch ms
) STRICT;

CREATE TABLE session_opening (
    person_id    TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,     -- the person
    session_id   TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,    -- the session
    opened_at_ms INTEGER NOT NULL CHECK (opened_at_ms >= 0),                 -- when it was opened last, epoch ms
    PRIMARY KEY (person_id, session_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE session_surroundings (
    session_id TEXT PRIMARY KEY REFERENCES session (id) ON DELETE CASCADE,   -- the session
    picture    BLOB NOT NULL CHECK (length(picture) BETWEEN 3 AND 16386)     -- a small grey picture (Surroundings)
) STRICT, WITHOUT ROWID;

CREATE TABLE skill_model (
    id              TEXT PRIMARY KEY CHECK (length(id) = 36),                -- ModelId
    task_id         TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,    -- of which task
    version         INTEGER NOT NULL CHECK (version >= 1),                   -- 1, 2, … within the task
    pipeline        TEXT NOT NULL CHECK (length(pipeline) >= 1),             -- version of the program that measured its sessions
    fingerprint     TEXT NOT NULL CHECK (length(fingerprint) = 64),          -- SHA-256 of the values that it was made of
    definition      TEXT CHECK (json_valid(definition)),                     -- the model itself (Definition); NULL: withdrawn
    report          TEXT NOT NULL CHECK (json_valid(report)),                -- how well it does on people left out (Report)
    person_id       TEXT REFERENCES person (id) ON DELETE SET NULL,          -- who made it; NULL: the service, or gone
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0),             -- when made, epoch ms
    withdrawn_at_ms INTEGER CHECK (withdrawn_at_ms >= 0),                    -- when somebody of whom it was made was erased
    UNIQUE (task_id, version),
    CHECK ((definition IS NULL) = (withdrawn_at_ms IS NOT NULL))
) STRICT;

CREATE TABLE skill_model_trainee (
    model_id   TEXT NOT NULL REFERENCES skill_model (id) ON DELETE CASCADE,  -- the model
    trainee_id TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,      -- whose sessions are in it
    PRIMARY KEY (model_id, trainee_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE standard (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- StandardId
    task_id       TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,      -- of which task
    version       INTEGER NOT NULL CHECK (version >= 1),                     -- 1, 2, … within the task
    definition    TEXT NOT NULL CHECK (json_valid(definition)),              -- targets, pass rule and charts (Definition)
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who set it; NULL: the service, or gone
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0), valid_from_ms INTEGER NOT NULL DEFAULT 0 CHECK (valid_from_ms >= 0),               -- when set, epoch ms
    UNIQUE (task_id, version)
) STRICT;

CREATE TABLE task (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- TaskId
    code          TEXT NOT NULL UNIQUE CHECK (length(code) BETWEEN 1 AND 64), -- short unique name, a-z 0-9 -
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call it
    description   TEXT NOT NULL DEFAULT '' CHECK (length(description) <= 10000), -- what to do
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when registered, epoch ms
, rating_forms TEXT CHECK (json_valid(rating_forms))) STRICT;

CREATE TABLE token (
    id              TEXT PRIMARY KEY CHECK (length(id) = 36),                -- TokenId
    secret_hash     BLOB NOT NULL UNIQUE CHECK (length(secret_hash) = 32),   -- SHA-256 of the token's 32 bytes
    name            TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),    -- what it is for
    role            TEXT NOT NULL CHECK (role IN ('administrator', 'instructor', 'trainee', 'agent')), -- its rights
    person_id       TEXT REFERENCES person (id) ON DELETE CASCADE,           -- as whom it acts; NULL for an agent
    box_id          TEXT REFERENCES training_box (id) ON DELETE CASCADE,     -- the agent's box; NULL for people's programs
    created_at_ms   INTEGER NOT NULL CHECK (created_at_ms >= 0),             -- when made, epoch ms
    expires_at_ms   INTEGER CHECK (expires_at_ms > created_at_ms),           -- its end, epoch ms; NULL: none
    last_used_at_ms INTEGER CHECK (last_used_at_ms >= created_at_ms), made_with TEXT REFERENCES token (id) ON DELETE CASCADE,        -- last request, to a minute, epoch ms
    CHECK ((role = 'agent') = (box_id IS NOT NULL)),
    CHECK ((role = 'agent') = (person_id IS NULL))
) STRICT;

CREATE TABLE trainee (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- TraineeId
    code          TEXT NOT NULL UNIQUE CHECK (length(code) BETWEEN 1 AND 64), -- short unique name, a-z 0-9 -
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call them
    level         TEXT CHECK (level IN ('novice', 'intermediate', 'expert')), -- said experience; NULL: not said
    handedness    TEXT CHECK (handedness IN ('left', 'right', 'both')),      -- preferred hand; NULL: not said
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when registered, epoch ms
) STRICT;

CREATE TABLE trainee_retention (
    trainee_id    TEXT PRIMARY KEY REFERENCES trainee (id) ON DELETE CASCADE,   -- whose
    months        INTEGER NOT NULL CHECK (months BETWEEN 0 AND 1200),           -- months after the arrival of a session; 0: videos are kept
    reason        TEXT CHECK (length(reason) BETWEEN 1 AND 2000),               -- why longer than the centre keeps videos; NULL: the shorter of both counts
    person_id     TEXT REFERENCES person (id) ON DELETE SET NULL,               -- who set it; NULL: deleted
    changed_at_ms INTEGER NOT NULL CHECK (changed_at_ms >= 0)                   -- when, epoch ms
) STRICT;

CREATE TABLE training_box (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- BoxId
    code          TEXT NOT NULL UNIQUE CHECK (length(code) BETWEEN 1 AND 64), -- short unique name, a-z 0-9 -
    name          TEXT NOT NULL CHECK (length(name) BETWEEN 1 AND 120),      -- what people call it
    view          TEXT CHECK (view IN ('top', 'side')),                      -- from where the camera looks; NULL: not said
    notes         TEXT NOT NULL DEFAULT '' CHECK (length(notes) <= 10000),   -- anything worth knowing
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when registered, epoch ms
) STRICT;

CREATE TABLE training_group (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- GroupId
    name          TEXT NOT NULL UNIQUE CHECK (length(name) BETWEEN 1 AND 120), -- what people call it
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when made, epoch ms
) STRICT;

CREATE TABLE upload (
    id             TEXT PRIMARY KEY CHECK (length(id) = 36),                 -- UploadId; its file has the same name
    person_id      TEXT REFERENCES person (id) ON DELETE CASCADE,            -- who sends; NULL for an agent or the service
    trainee_id     TEXT NOT NULL REFERENCES trainee (id) ON DELETE CASCADE,  -- who trained
    task_id        TEXT NOT NULL REFERENCES task (id) ON DELETE CASCADE,     -- what they did
    box_id         TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- where
    filename       TEXT NOT NULL CHECK (length(filename) BETWEEN 1 AND 255), -- the recording's name at the sender's
    metadata       TEXT NOT NULL CHECK (length(metadata) <= 8192),           -- Upload-Metadata as it was sent, to be sent back
    recorded_at_ms INTEGER,                                                  -- when it was recorded, epoch ms; NULL: not said
    length         INTEGER NOT NULL CHECK (length >= 0),                     -- bytes to come in all
    received       INTEGER NOT NULL DEFAULT 0 CHECK (received BETWEEN 0 AND length), -- bytes that are durable
    session_id     TEXT REFERENCES session (id) ON DELETE CASCADE,           -- the session that it became
    created_at_ms  INTEGER NOT NULL CHECK (created_at_ms >= 0),              -- when begun, epoch ms
    expires_at_ms  INTEGER NOT NULL CHECK (expires_at_ms > created_at_ms), true_frame_rate_hz REAL CHECK (true_frame_rate_hz BETWEEN 1 AND 1000), true_duration_s REAL CHECK (true_duration_s BETWEEN 0.1 AND 86400), is_duplicate INTEGER NOT NULL DEFAULT 0 CHECK (is_duplicate IN (0, 1)),   -- when it is forgotten unless it goes on, epoch ms
    CHECK (session_id IS NULL OR received = length)
) STRICT;

CREATE TABLE waiting_recording (
    id                 TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- WaitingRecordingId; of the later session, too
    video              TEXT NOT NULL UNIQUE REFERENCES blob (hash) ON DELETE RESTRICT, -- the recording
    media_type         TEXT NOT NULL,                                             -- media type of the recording, such as video/mp4
    filename           TEXT NOT NULL CHECK (length(filename) BETWEEN 1 AND 255),  -- its file's name as it was sent
    folder             TEXT CHECK (length(folder) BETWEEN 1 AND 1000),            -- folder below the watched folder, with slashes; NULL: none
    source             TEXT NOT NULL CHECK (source IN ('inbox', 'agent', 'upload')), -- RecordingSource: how it came
    box_id             TEXT REFERENCES training_box (id) ON DELETE SET NULL,      -- the box; NULL: not known
    task_id            TEXT REFERENCES task (id) ON DELETE SET NULL,              -- the task; NULL: not known
    trainee_id         TEXT REFERENCES trainee (id) ON DELETE CASCADE,            -- whose it is by the folder's list; erased with the trainee; NULL: no list says it
    remark             TEXT CHECK (length(remark) BETWEEN 1 AND 2000),            -- why it was not assigned as the folder's list says; NULL: no list, or nothing against it
    recorded_at_ms     INTEGER CHECK (recorded_at_ms >= 0),                       -- when it was recorded by its sender, epoch ms; NULL: not stated
    true_frame_rate_hz REAL CHECK (true_frame_rate_hz > 0),                       -- true frame rate, Hz, if the sender gave it
    true_duration_s    REAL CHECK (true_duration_s > 0),                          -- true duration, s, if the sender gave it
    person_id          TEXT REFERENCES person (id) ON DELETE SET NULL,            -- who sent it; NULL: a program without a person, or deleted
    arrived_at_ms      INTEGER NOT NULL CHECK (arrived_at_ms >= 0),               -- when it arrived, epoch ms
    preview            TEXT REFERENCES blob (hash) ON DELETE RESTRICT,            -- a JPEG of one frame; NULL: none yet, or not readable
    unreadable         TEXT CHECK (length(unreadable) BETWEEN 1 AND 5000)         -- why it has no picture; NULL: it has one, or was not looked at yet
) STRICT;

CREATE INDEX access_entry_at ON access_entry (at_ms);

CREATE UNIQUE INDEX access_entry_once ON access_entry (session_id, person_id, program, hour);

CREATE INDEX access_entry_person ON access_entry (person_id);

CREATE INDEX access_entry_trainee ON access_entry (trainee_id, id);

CREATE INDEX attention_dismissal_person ON attention_dismissal (person_id, kind, trainee_id, task_id);

CREATE INDEX attention_dismissal_task ON attention_dismissal (task_id);

CREATE INDEX attention_dismissal_trainee ON attention_dismissal (trainee_id);

CREATE INDEX attention_dismissal_session_session ON attention_dismissal_session (session_id);

CREATE INDEX audit_address ON audit (actor) WHERE address IS NOT NULL;

CREATE INDEX audit_backup ON audit (id) WHERE action = 'create' AND noun = 'backup';

CREATE INDEX audit_recordings ON audit (actor, at_ms) WHERE noun = 'session' AND action IN ('create', 'import');

CREATE INDEX certificate_exam ON certificate (exam_id) WHERE exam_id IS NOT NULL;

CREATE INDEX certificate_key_of ON certificate (key_id);

CREATE INDEX certificate_person ON certificate (person_id);

CREATE INDEX certificate_state ON certificate (state);

CREATE INDEX certificate_task ON certificate (task_id);

CREATE INDEX certificate_trainee ON certificate (trainee_id);

CREATE INDEX certificate_event_of ON certificate_event (certificate_id);

CREATE INDEX certificate_event_person ON certificate_event (person_id);

CREATE UNIQUE INDEX certificate_key_in_use ON certificate_key (retired_at_ms IS NULL) WHERE retired_at_ms IS NULL;

CREATE INDEX certificate_session_of ON certificate_session (session_id);

CREATE INDEX cohort_group ON cohort (group_id);

CREATE INDEX cohort_member_trainee ON cohort_member (trainee_id);

CREATE INDEX comment_person ON comment (person_id);

CREATE INDEX comment_session ON comment (session_id, from_s);

CREATE INDEX consent_of_text ON consent (text_id);

CREATE INDEX consent_person ON consent (person_id);

CREATE INDEX consent_trainee ON consent (trainee_id);

CREATE INDEX consent_text_person ON consent_text (person_id);

CREATE INDEX cookie_session_identity ON cookie_session (identity_id) WHERE identity_id IS NOT NULL;

CREATE INDEX cookie_session_person ON cookie_session (person_id);

CREATE UNIQUE INDEX course_step_once ON course_step (course_id, task_id, coalesce(sessions, 0));

CREATE INDEX course_step_task ON course_step (task_id);

CREATE INDEX error_list_person ON error_list (person_id);

CREATE INDEX error_mark_sheet ON error_mark (sheet_id, at_s);

CREATE INDEX error_sheet_list ON error_sheet (list_id);

CREATE UNIQUE INDEX error_sheet_open ON error_sheet (session_id, person_id) WHERE finished_at_ms IS NULL;

CREATE INDEX error_sheet_person ON error_sheet (person_id);

CREATE INDEX error_sheet_session ON error_sheet (session_id, finished_at_ms);

CREATE INDEX exam_box ON exam (box_id);

CREATE INDEX exam_ended_by ON exam (ended_by);

CREATE INDEX exam_examiner ON exam (examiner_id);

CREATE INDEX exam_planned_by ON exam (planned_by);

CREATE UNIQUE INDEX exam_running_box ON exam (box_id) WHERE state = 'running';

CREATE UNIQUE INDEX exam_running_trainee ON exam (trainee_id) WHERE state = 'running';

CREATE INDEX exam_self_test ON exam (self_test_id);

CREATE INDEX exam_standard ON exam (standard_id);

CREATE INDEX exam_task ON exam (task_id);

CREATE INDEX exam_trainee ON exam (trainee_id);

CREATE INDEX exam_attempt_ordered_by ON exam_attempt (ordered_by);

CREATE INDEX exam_attempt_self_test ON exam_attempt (self_test_id);

CREATE INDEX exam_attempt_session ON exam_attempt (session_id) WHERE session_id IS NOT NULL;

CREATE INDEX exam_attempt_voided_by ON exam_attempt (voided_by);

CREATE INDEX feature_named ON feature (name, result_id, tool, space, value, low, high);

CREATE UNIQUE INDEX feature_once ON feature (result_id, name, coalesce(tool, ''), space);

CREATE INDEX feed_box ON feed (box_id);

CREATE INDEX feed_session ON feed (session_id);

CREATE INDEX feed_unfinished ON feed (id) WHERE ended_at_ms IS NULL;

CREATE INDEX group_course_course ON group_course (course_id);

CREATE INDEX group_instructor_person ON group_instructor (person_id);

CREATE INDEX group_trainee_trainee ON group_trainee (trainee_id);

CREATE INDEX job_box ON job (box_id, created_at_ms);

CREATE INDEX job_lease ON job (lease_until_ms) WHERE state = 'running';

CREATE INDEX job_quarantined ON job (id) WHERE state = 'quarantined';

CREATE INDEX job_session ON job (session_id);

CREATE INDEX job_waiting ON job (turn, queued_at_ms, id) WHERE state = 'queued';

CREATE INDEX job_file_blob ON job_file (blob);

CREATE INDEX known_place_age ON known_place (last_used_at_ms);

CREATE INDEX ownership_box ON ownership (box_id) WHERE box_id IS NOT NULL;

CREATE INDEX ownership_course ON ownership (course_id) WHERE course_id IS NOT NULL;

CREATE INDEX ownership_group ON ownership (group_id);

CREATE INDEX ownership_task ON ownership (task_id) WHERE task_id IS NOT NULL;

CREATE INDEX password_link_made_by ON password_link (made_by) WHERE made_by IS NOT NULL;

CREATE INDEX pending_erasure_due ON pending_erasure (due_at_ms);

CREATE INDEX pending_erasure_person ON pending_erasure (person_id);

CREATE INDEX rating_person ON rating (person_id);

CREATE INDEX rating_session ON rating (session_id, form, created_at_ms);

CREATE UNIQUE INDEX record_merge_box ON record_merge (merged_box_id) WHERE merged_box_id IS NOT NULL AND separated_at_ms IS NULL;

CREATE INDEX record_merge_kept_box ON record_merge (kept_box_id) WHERE kept_box_id IS NOT NULL;

CREATE INDEX record_merge_kept_trainee ON record_merge (kept_trainee_id) WHERE kept_trainee_id IS NOT NULL;

CREATE INDEX record_merge_of_box ON record_merge (merged_box_id) WHERE merged_box_id IS NOT NULL;

CREATE INDEX record_merge_of_trainee ON record_merge (merged_trainee_id) WHERE merged_trainee_id IS NOT NULL;

CREATE INDEX record_merge_person ON record_merge (person_id);

CREATE INDEX record_merge_separated_by ON record_merge (separated_by);

CREATE UNIQUE INDEX record_merge_trainee ON record_merge (merged_trainee_id) WHERE merged_trainee_id IS NOT NULL AND separated_at_ms IS NULL;

CREATE INDEX rescoring_open ON rescoring (id) WHERE ended_at_ms IS NULL;

CREATE INDEX rescoring_person ON rescoring (person_id);

CREATE INDEX rescoring_standard ON rescoring (standard_id);

CREATE INDEX rescoring_task ON rescoring (task_id);

CREATE INDEX rescoring_item_job ON rescoring_item (job_id);

CREATE INDEX rescoring_item_new ON rescoring_item (new_result_id);

CREATE INDEX rescoring_item_old ON rescoring_item (old_result_id);

CREATE INDEX rescoring_item_report ON rescoring_item (rescoring_id, judgement_changed DESC, features_apart DESC, features_changed DESC, session_id);

CREATE INDEX rescoring_item_session ON rescoring_item (session_id);

CREATE INDEX rescoring_item_state ON rescoring_item (rescoring_id, state, session_id);

CREATE INDEX result_calibration ON result (calibration_id);

CREATE INDEX result_diagnostics ON result (diagnostics);

CREATE INDEX result_latest ON result (session_id);

CREATE UNIQUE INDEX result_once ON result (session_id, pipeline, coalesce(tracked_with, pipeline), coalesce(calibration_id, ''),
                                           coalesce(palette_id, ''), coalesce(model, ''), edits, time_revision);

CREATE INDEX result_palette ON result (palette_id);

CREATE INDEX result_preview ON result (preview);

CREATE INDEX result_trajectory ON result (trajectory);

CREATE INDEX result_trocar_middle ON result (calibration_id) WHERE trocar_middle_mm IS NOT NULL;

CREATE INDEX score_formula_person ON score_formula (person_id);

CREATE INDEX self_test_box ON self_test (box_id, id);

CREATE INDEX self_test_calibration ON self_test (calibration_id);

CREATE INDEX self_test_palette ON self_test (palette_id);

CREATE INDEX self_test_person ON self_test (person_id);

CREATE INDEX session_box_asked ON session (created_at_ms, id) WHERE box_question = 'asked';

CREATE INDEX session_box_order ON session (box_id, created_at_ms, id, box_question);

CREATE INDEX session_came ON session (created_at_ms, id);

CREATE INDEX session_cut_of ON session (cut_of) WHERE cut_of IS NOT NULL;

CREATE INDEX session_path ON session (path_hash) WHERE path_hash IS NOT NULL;

CREATE INDEX session_practised ON session (trainee_id, task_id, recorded_at_ms, id);

CREATE INDEX session_recorded ON session (recorded_at_ms, id);

CREATE INDEX session_supervised_by ON session (supervised_by) WHERE supervised_by IS NOT NULL;

CREATE INDEX session_task ON session (task_id);

CREATE INDEX session_video ON session (video);

CREATE INDEX session_whole_video ON session (whole_video);

CREATE INDEX session_cut_first ON session_cut (first_id);

CREATE INDEX session_cut_first_edit ON session_cut (first_edit_id);

CREATE INDEX session_cut_joined_by ON session_cut (joined_by);

CREATE INDEX session_cut_person ON session_cut (person_id);

CREATE INDEX session_cut_second ON session_cut (second_id);

CREATE INDEX session_cut_second_edit ON session_cut (second_edit_id);

CREATE UNIQUE INDEX session_box_answer ON session_edit (session_id, box_id) WHERE kind IN ('this_box', 'other_box') AND undone_at_ms IS NULL;

CREATE INDEX session_edit_box ON session_edit (box_id) WHERE box_id IS NOT NULL;

CREATE INDEX session_edit_person ON session_edit (person_id);

CREATE INDEX session_edit_session ON session_edit (session_id, created_at_ms);

CREATE INDEX session_edit_undone_by ON session_edit (undone_by);

CREATE UNIQUE INDEX session_set_aside ON session_edit (session_id) WHERE kind = 'set_aside' AND undone_at_ms IS NULL;

CREATE INDEX session_move_from_box ON session_move (from_box_id);

CREATE INDEX session_move_from_task ON session_move (from_task_id);

CREATE INDEX session_move_from_trainee ON session_move (from_trainee_id);

CREATE INDEX session_move_person ON session_move (person_id);

CREATE INDEX session_move_session ON session_move (session_id);

CREATE INDEX session_move_to_box ON session_move (to_box_id);

CREATE INDEX session_move_to_task ON session_move (to_task_id);

CREATE INDEX session_move_to_trainee ON session_move (to_trainee_id);

CREATE INDEX session_opening_session ON session_opening (session_id);

CREATE INDEX skill_model_person_id ON skill_model (person_id);

CREATE INDEX skill_model_trainee_of ON skill_model_trainee (trainee_id);

CREATE INDEX standard_person ON standard (person_id);

CREATE INDEX token_made_with ON token (made_with) WHERE made_with IS NOT NULL;

CREATE INDEX trainee_retention_person ON trainee_retention (person_id);

CREATE INDEX upload_expires ON upload (expires_at_ms);

CREATE INDEX upload_session ON upload (session_id);

CREATE INDEX upload_trainee ON upload (trainee_id);

CREATE INDEX waiting_recording_arrived ON waiting_recording (arrived_at_ms);

CREATE INDEX waiting_recording_box ON waiting_recording (box_id);

CREATE INDEX waiting_recording_person ON waiting_recording (person_id);

CREATE INDEX waiting_recording_preview ON waiting_recording (preview) WHERE preview IS NOT NULL;

CREATE INDEX waiting_recording_task ON waiting_recording (task_id);

CREATE INDEX waiting_recording_trainee ON waiting_recording (trainee_id);

CREATE TRIGGER certificate_stays BEFORE UPDATE OF code, standard_version, language, content, pdf, key_id, issued_at_ms ON certificate
WHEN NEW.state <> 'erased' BEGIN
    SELECT RAISE(ABORT, 'an issued certificate never changes');
END;

CREATE TRIGGER consent_text_stays BEFORE UPDATE OF version, title_en, body_en, title_de, body_de, published_at_ms ON consent_text BEGIN
    SELECT RAISE(ABORT, 'a published consent text never changes');
END;

CREATE TRIGGER exam_ends_once BEFORE UPDATE OF state, result, ended_at_ms ON exam WHEN OLD.state IN ('closed', 'cancelled') BEGIN
    SELECT RAISE(ABORT, 'an exam that has ended never changes');
END;

CREATE TRIGGER exam_is_erased_with_the_person BEFORE DELETE ON exam
WHEN EXISTS (SELECT 1 FROM trainee WHERE trainee.id = OLD.trainee_id) BEGIN
    SELECT RAISE(ABORT, 'an exam is erased only with the person');
END;

CREATE TRIGGER exam_is_started_once BEFORE UPDATE OF identity, examiner, handedness, started_at_ms ON exam
WHEN OLD.state <> 'planned' BEGIN
    SELECT RAISE(ABORT, 'what was fixed at the start of an exam never changes');
END;

CREATE TRIGGER exam_stays BEFORE UPDATE OF task_id, standard_id, attempts, planned_at_ms ON exam BEGIN
    SELECT RAISE(ABORT, 'what was fixed for an exam never changes');
END;

CREATE TRIGGER exam_attempt_is_completed_before_the_end BEFORE UPDATE OF completion ON exam_attempt
WHEN (SELECT state FROM exam WHERE exam.id = OLD.exam_id) <> 'running' BEGIN
    SELECT RAISE(ABORT, 'what the examiner said of an attempt never changes after the exam');
END;

CREATE TRIGGER exam_attempt_is_judged_once BEFORE UPDATE OF outcome, cause, figures, pipeline ON exam_attempt
WHEN OLD.outcome IS NOT NULL BEGIN
    SELECT RAISE(ABORT, 'an attempt is judged once');
END;

CREATE TRIGGER exam_attempt_is_numbered_once BEFORE UPDATE OF exam_id, recording_id, number, began_at_ms ON exam_attempt
WHEN OLD.number IS NOT NULL
     AND (OLD.exam_id, OLD.recording_id, OLD.number, OLD.began_at_ms)
         IS NOT (NEW.exam_id, NEW.recording_id, NEW.number, NEW.began_at_ms) BEGIN
    SELECT RAISE(ABORT, 'the number of an attempt never changes');
END;

CREATE TRIGGER exam_attempt_is_voided_before_the_end BEFORE UPDATE OF void_reason, voided_at_ms ON exam_attempt
WHEN OLD.voided_at_ms IS NOT NULL OR (SELECT state FROM exam WHERE exam.id = OLD.exam_id) <> 'running' BEGIN
    SELECT RAISE(ABORT, 'an attempt is voided once, before the end of the exam');
END;

CREATE TRIGGER exam_attempt_keeps_its_session BEFORE UPDATE OF session_id ON exam_attempt
WHEN OLD.session_id <> NEW.session_id BEGIN
    SELECT RAISE(ABORT, 'the session of an attempt never changes');
END;

CREATE TRIGGER exam_attempt_stays BEFORE DELETE ON exam_attempt
WHEN OLD.number IS NOT NULL AND EXISTS (SELECT 1 FROM exam WHERE exam.id = OLD.exam_id) BEGIN
    SELECT RAISE(ABORT, 'an attempt is erased only with its exam');
END;

CREATE TRIGGER feed_erased AFTER DELETE ON feed BEGIN
    INSERT INTO erased_feed (id) VALUES (OLD.id) ON CONFLICT DO NOTHING;
END;

CREATE TRIGGER access_entry_forgets_viewer BEFORE DELETE ON person BEGIN
    UPDATE access_entry SET person_id = NULL, program = CASE program WHEN '' THEN '' ELSE '–' END WHERE person_id = OLD.id;
END;

CREATE TRIGGER person_address_erased AFTER DELETE ON person BEGIN
    UPDATE audit SET address = NULL WHERE actor = 'person:' || OLD.id AND address IS NOT NULL;
END;

CREATE TRIGGER person_erased AFTER DELETE ON person BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('person', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;

CREATE TRIGGER rater_leaves_no_open_sheet BEFORE DELETE ON person BEGIN
    DELETE FROM error_sheet WHERE person_id = OLD.id AND finished_at_ms IS NULL;
END;

CREATE TRIGGER result_has_hands AFTER INSERT ON result BEGIN
    UPDATE result SET (left_tool, right_tool, trocar_middle_mm) =
        (SELECT left_tool, right_tool, trocar_middle_mm FROM tool_hand WHERE tool_hand.result_id = NEW.id)
    WHERE id = NEW.id;
END;

CREATE TRIGGER access_entry_follows_session AFTER UPDATE OF trainee_id ON session WHEN OLD.trainee_id <> NEW.trainee_id BEGIN
    UPDATE access_entry SET trainee_id = NEW.trainee_id WHERE session_id = NEW.id;
END;

CREATE TRIGGER session_erased AFTER DELETE ON session BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('session', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;

CREATE TRIGGER session_gets_whole_video AFTER UPDATE OF video ON session WHEN NEW.is_part = 0 BEGIN
    UPDATE session SET whole_video = NEW.video WHERE id = NEW.id;
END;

CREATE TRIGGER session_has_whole_video AFTER INSERT ON session WHEN NEW.is_part = 0 AND NEW.video IS NOT NULL BEGIN
    UPDATE session SET whole_video = NEW.video WHERE id = NEW.id;
END;

CREATE TRIGGER session_leaves_no_cut BEFORE DELETE ON session BEGIN
    DELETE FROM session_cut
    WHERE first_id = OLD.id AND second_id IS NULL OR second_id = OLD.id AND first_id IS NULL;
END;

CREATE TRIGGER session_leaves_no_waiting_recording AFTER DELETE ON session WHEN OLD.video IS NOT NULL BEGIN
    DELETE FROM waiting_recording WHERE video = OLD.video;
END;

CREATE TRIGGER trainee_erased AFTER DELETE ON trainee BEGIN
    INSERT INTO erasure (kind, id, at_ms) VALUES ('trainee', OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER));
END;

CREATE TRIGGER trainee_leaves_certificates BEFORE DELETE ON trainee BEGIN
    DELETE FROM certificate_event WHERE certificate_id IN (SELECT id FROM certificate WHERE trainee_id = OLD.id);
    DELETE FROM certificate_session WHERE certificate_id IN (SELECT id FROM certificate WHERE trainee_id = OLD.id);
    UPDATE certificate
    SET state = 'erased', state_at_ms = CAST(unixepoch('subsec') * 1000 AS INTEGER), content = NULL, pdf = NULL, reason = NULL,
        person_id = NULL, trainee_id = NULL
    WHERE trainee_id = OLD.id;
END;

CREATE TRIGGER trainee_leaves_no_reasons BEFORE DELETE ON trainee BEGIN
    UPDATE session_cut SET why = '–'
    WHERE EXISTS (SELECT 1 FROM session WHERE session.trainee_id = OLD.id AND session.id IN (first_id, second_id));
END;

CREATE TRIGGER trainee_leaves_no_words BEFORE DELETE ON trainee BEGIN
    UPDATE session_move SET why = '–' WHERE OLD.id IN (from_trainee_id, to_trainee_id);
    DELETE FROM comment WHERE person_id IN (SELECT person.id FROM person WHERE person.trainee_id = OLD.id);
END;

CREATE VIEW assessed_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.tracker, session.recorded_at_ms, session.created_at_ms,
           result.id AS result_id, result.pipeline, result.calibration_id, result.tools, result.verdict
    FROM session JOIN current_result AS result ON result.session_id = session.id
    WHERE NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id);

CREATE VIEW blob_reference (hash) AS
    SELECT video FROM session WHERE video IS NOT NULL
    UNION ALL SELECT blob FROM job_file
    UNION ALL SELECT trajectory FROM result
    UNION ALL SELECT diagnostics FROM result WHERE diagnostics IS NOT NULL
    UNION ALL SELECT preview FROM result WHERE preview IS NOT NULL
    UNION ALL SELECT video FROM waiting_recording
    UNION ALL SELECT preview FROM waiting_recording WHERE preview IS NOT NULL;

CREATE VIEW cohort_person (cohort_id, trainee_id, handedness) AS
    SELECT cohort.id, member.id, member.handedness FROM cohort CROSS JOIN trainee AS member
    WHERE CASE WHEN cohort.is_list
               THEN EXISTS (SELECT 1 FROM cohort_member
                            WHERE cohort_member.cohort_id = cohort.id AND cohort_member.trainee_id = member.id)
               ELSE (cohort.level IS NULL OR cohort.level = member.level)
                    AND (cohort.handedness IS NULL OR cohort.handedness = member.handedness)
                    AND (cohort.group_id IS NULL
                         OR EXISTS (SELECT 1 FROM group_trainee WHERE group_trainee.group_id = cohort.group_id
                                    AND group_trainee.trainee_id = member.id)) END;

CREATE VIEW comment_record AS
    SELECT comment.id, comment.session_id, comment.person_id, person.name AS who, comment.from_s, comment.to_s, comment.text,
           comment.created_at_ms, coalesce(person.role = 'trainee', FALSE) AS is_by_trainee
    FROM comment LEFT JOIN person ON person.id = comment.person_id;

CREATE VIEW completed_rescoring (id) AS
    SELECT id FROM rescoring
    WHERE ended_at_ms IS NULL AND NOT EXISTS
        (SELECT 1 FROM rescoring_item WHERE rescoring_id = rescoring.id AND state IN ('waiting', 'working'));

CREATE VIEW current_result AS
    SELECT result.*, json_extract(result.quality, '$.verdict') AS verdict FROM result
    WHERE result.rowid =
        (SELECT max(latest.rowid) FROM result AS latest
         WHERE latest.session_id = result.session_id
           AND (latest.calibration_id IS NULL
                OR (SELECT box_id FROM calibration WHERE calibration.id = latest.calibration_id)
                   = (SELECT box_id FROM session WHERE session.id = result.session_id)));

CREATE VIEW dismissed_session (person_id, kind, session_id, until_ms) AS
    SELECT dismissal.person_id, dismissal.kind, session.id, dismissal.until_ms
    FROM attention_dismissal AS dismissal
    JOIN attention_dismissal_session AS covered ON covered.dismissal_id = dismissal.id
    JOIN session ON session.id = covered.session_id
         AND session.trainee_id = dismissal.trainee_id AND session.task_id = dismissal.task_id;

CREATE VIEW feed_record AS
    SELECT feed.*, session.trainee_id, session.task_id
    FROM feed JOIN session ON session.id = feed.session_id;

CREATE VIEW group_record AS
    SELECT training_group.id, training_group.name, training_group.created_at_ms,
           group_course.course_id, course.name AS course_name, group_course.begins
    FROM training_group
    LEFT JOIN group_course ON group_course.group_id = training_group.id
    LEFT JOIN course ON course.id = group_course.course_id;

CREATE VIEW hidden_trainee (trainee_id) AS
    SELECT trainee_id FROM pending_erasure
    UNION ALL
    SELECT merged_trainee_id FROM record_merge WHERE merged_trainee_id IS NOT NULL AND separated_at_ms IS NULL;

CREATE VIEW latest_consent AS
    SELECT consent.trainee_id, consent.decision, consent.signed_on, consent.created_at_ms, consent_text.version
    FROM consent JOIN consent_text ON consent_text.id = consent.text_id
    WHERE consent.rowid =
        (SELECT max(latest.rowid) FROM consent AS latest WHERE latest.trainee_id = consent.trainee_id);

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

CREATE VIEW practised_session AS
    SELECT session.id, session.trainee_id, session.task_id, session.recorded_at_ms,
           coalesce((SELECT whole.rowid FROM session AS whole WHERE whole.id = session.cut_of), session.rowid) AS arrival,
           session.video IS NOT NULL AS is_whole,
           NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id) AS counts,
           session.box_question, job.state AS job_state, result.id AS result_id, result.pipeline, result.calibration_id,
           result.verdict = 'refused' AS refused
    FROM session
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN current_result AS result ON result.session_id = session.id;

CREATE VIEW sealed_session (session_id) AS
    SELECT attempt.session_id FROM exam CROSS JOIN exam_attempt AS attempt ON attempt.exam_id = exam.id
    WHERE exam.state = 'running' AND attempt.session_id IS NOT NULL;

CREATE VIEW session_background (session_id, recorded_at_source, date_known, supervision, supervised_at_ms, supervisor) AS
    SELECT session.id, session.recorded_at_source, session.date_known, session.supervision, session.supervised_at_ms, person.name
    FROM session LEFT JOIN person ON person.id = session.supervised_by;

CREATE VIEW session_outcome (session_id, verdict, outcome) AS
    SELECT session.id, result.verdict,
           CASE
               WHEN session.video IS NULL THEN 'receiving'
               WHEN job.state IN ('quarantined', 'failed') THEN job.state
               WHEN job.state = 'running' THEN 'tracking'
               WHEN job.state IS NULL
                    AND EXISTS (SELECT 1 FROM blob WHERE hash = session.video AND dropped_at_ms IS NOT NULL) THEN 'failed'
               WHEN job.state IS NOT 'done' THEN 'queued'
               WHEN session.box_question = 'asked' THEN 'box_asked'
               WHEN session.box_question = 'other_box' THEN 'other_box'
               WHEN result.verdict = 'refused' THEN 'refused'
               WHEN EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) THEN 'done'
               WHEN EXISTS (SELECT 1 FROM voided_session WHERE voided_session.session_id = session.id) THEN 'done'
               ELSE coalesce(
                   (SELECT (SELECT CASE WHEN min(met) = 0 THEN 'missed'
                                        WHEN count(*) > 0 AND count(met) = count(*) THEN 'passed'
                                        ELSE 'undecided' END
                            FROM (SELECT CASE
                                             WHEN target.value ->> '$.made_from.pipeline' <> result.pipeline THEN NULL
                                             WHEN target.value ->> '$.made_from.handedness' IS NOT NULL
                                                  AND target.value ->> '$.made_from.handedness' IS NOT trainee.handedness THEN NULL
                                             WHEN low IS NOT NULL AND high IS NULL THEN
                                                 CASE target.value ->> 'better'
                                                     WHEN 'higher' THEN iif(feature.value >= target.value ->> 'limit', 1, NULL)
                                                     ELSE iif(feature.value > target.value ->> 'limit', 0, NULL) END
                                             WHEN feature.value BETWEEN low AND high THEN
                                                 CASE target.value ->> 'better'
                                                     WHEN 'higher' THEN iif(low >= target.value ->> 'limit', 1,
                                                                            iif(high < target.value ->> 'limit', 0, NULL))
                                                     ELSE iif(high <= target.value ->> 'limit', 1,
                                                              iif(low > target.value ->> 'limit', 0, NULL)) END
                                         END AS met
                                  FROM json_each(standard.definition, '$.targets') AS target
                                  LEFT JOIN feature ON feature.result_id = result.id
                                       AND feature.name = target.value ->> 'feature'
                                       AND CASE target.value ->> 'in_hand' || coalesce(trainee.handedness, '')
                                               WHEN 'dominantleft' THEN feature.tool = result.left_tool
                                               WHEN 'otherright' THEN feature.tool = result.left_tool
                                               WHEN 'dominantright' THEN feature.tool = result.right_tool
                                               WHEN 'otherleft' THEN feature.tool = result.right_tool
                                               ELSE CASE target.value ->> 'in_hand'
                                                   WHEN 'left' THEN feature.tool = result.left_tool
                                                   WHEN 'right' THEN feature.tool = result.right_tool
                                                   ELSE target.value ->> 'in_hand' IS NULL AND feature.tool IS target.value ->> 'tool' END
                                           END
                                       AND feature.space = target.value ->> 'space'))
                    FROM standard
                    WHERE standard.task_id = session.task_id AND standard.valid_from_ms <= session.created_at_ms
                          AND result.id IS NOT NULL
                    ORDER BY standard.version DESC LIMIT 1), 'done')
           END
    FROM session
    JOIN trainee ON trainee.id = session.trainee_id
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN current_result AS result ON result.session_id = session.id;

CREATE VIEW session_record AS
    SELECT session.id, session.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           trainee.handedness AS trainee_handedness,
           session.task_id, task.name AS task_name, task.code AS task_code,
           session.box_id, training_box.name AS box_name, training_box.code AS box_code,
           session.filename, session.media_type, session.video, blob.bytes AS video_bytes, session.tracker,
           session.recorded_at_ms, session.created_at_ms,
           job.id AS job_id, job.state AS job_state, job.progress AS job_progress, job.problem AS job_problem,
           EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) AS is_set_aside,
           EXISTS (SELECT 1 FROM voided_session WHERE voided_session.session_id = session.id) AS is_voided,
           session.box_question,
           EXISTS (SELECT 1 FROM calibration WHERE calibration.box_id = session.box_id) AS box_has_camera,
           EXISTS (SELECT 1 FROM palette WHERE palette.box_id = session.box_id) AS box_has_palette
    FROM session
    JOIN trainee ON trainee.id = session.trainee_id
    JOIN task ON task.id = session.task_id
    JOIN training_box ON training_box.id = session.box_id
    LEFT JOIN blob ON blob.hash = session.video
    LEFT JOIN tracking_job AS job ON job.session_id = session.id;

CREATE VIEW session_time AS
    SELECT session.id AS session_id, session.box_id,
           coalesce((SELECT feed.created_at_ms FROM feed
                     WHERE feed.session_id = session.id AND abs(feed.created_at_ms - session.recorded_at_ms) <= 600000),
                    session.recorded_at_ms) AS made_at_ms
    FROM session;

CREATE VIEW set_aside_session (session_id) AS
    SELECT session_id FROM session_edit WHERE kind = 'set_aside' AND undone_at_ms IS NULL;

CREATE VIEW standard_record AS
    SELECT standard.id, standard.task_id, standard.version, standard.definition, person.name AS who, standard.created_at_ms,
           standard.valid_from_ms
    FROM standard LEFT JOIN person ON person.id = standard.person_id;

CREATE VIEW tool_hand AS
    SELECT placed.id AS result_id,
           CASE WHEN placed.by_both IS NOT NULL THEN placed.by_both ->> '$[0]'
                WHEN placed.offset_mm * placed.offset_mm > 9 * (placed.variance_mm2 + 64)
                THEN iif(placed.offset_mm < 0, placed.known_tool, placed.other_tool)
                ELSE placed.stated_left END AS left_tool,
           CASE WHEN placed.by_both IS NOT NULL THEN placed.by_both ->> '$[1]'
                WHEN placed.offset_mm * placed.offset_mm > 9 * (placed.variance_mm2 + 64)
                THEN iif(placed.offset_mm < 0, placed.other_tool, placed.known_tool)
                ELSE placed.stated_right END AS right_tool,
           placed.by_both ->> '$[2]' AS trocar_middle_mm
    FROM
        (SELECT result.id,
                (SELECT json_array(one.value ->> '$.tool', other.value ->> '$.tool',
                                   ((one.value ->> '$.fulcrum.at_mm[0]') + (other.value ->> '$.fulcrum.at_mm[0]')) / 2)
                 FROM json_each(result.quality, '$.tools') AS one, json_each(result.quality, '$.tools') AS other
                 WHERE json_array_length(result.tools) = 2
                   AND (other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]')
                       > abs((other.value ->> '$.fulcrum.at_mm[1]') - (one.value ->> '$.fulcrum.at_mm[1]'))
                   AND ((other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]'))
                       * ((other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]'))
                       > 9 * ((one.value ->> '$.fulcrum.covariance_mm2[0]') + (other.value ->> '$.fulcrum.covariance_mm2[0]'))
                ) AS by_both,
                alone.trocar ->> '$[0]' AS known_tool, alone.trocar ->> '$[2]' AS variance_mm2,
                (SELECT value FROM json_each(result.tools) WHERE value <> alone.trocar ->> '$[0]') AS other_tool,
                (alone.trocar ->> '$[1]')
                - (SELECT seen.trocar_middle_mm FROM result AS seen
                   WHERE seen.calibration_id = result.calibration_id AND seen.trocar_middle_mm IS NOT NULL
                     AND seen.quality ->> '$.verdict' IS NOT 'refused'
                     AND NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = seen.session_id)
                   ORDER BY seen.rowid DESC LIMIT 1) AS offset_mm,
                (SELECT iif(count(*) = 1, min(tool.value ->> '$.name'), NULL) FROM palette, json_each(palette.tools) AS tool
                 WHERE palette.id = result.palette_id AND tool.value ->> '$.side' = 'left'
                   AND tool.value ->> '$.name' IN (SELECT value FROM json_each(result.tools))) AS stated_left,
                (SELECT iif(count(*) = 1, min(tool.value ->> '$.name'), NULL) FROM palette, json_each(palette.tools) AS tool
                 WHERE palette.id = result.palette_id AND tool.value ->> '$.side' = 'right'
                   AND tool.value ->> '$.name' IN (SELECT value FROM json_each(result.tools))) AS stated_right
         FROM
             (SELECT result.id AS result_id,
                     (SELECT iif(count(*) = 1, json_array(min(tool.value ->> '$.tool'), min(tool.value ->> '$.fulcrum.at_mm[0]'),
                                                          min(tool.value ->> '$.fulcrum.covariance_mm2[0]')), NULL)
                      FROM json_each(result.quality, '$.tools') AS tool
                      WHERE json_array_length(result.tools) = 2 AND tool.value ->> '$.fulcrum.at_mm[0]' IS NOT NULL) AS trocar
              FROM result) AS alone
         JOIN result ON result.id = alone.result_id) AS placed;

CREATE VIEW tracking_job AS
    SELECT job.* FROM job
    WHERE job.rowid =
        (SELECT max(latest.rowid) FROM job AS latest
         WHERE latest.session_id = job.session_id AND latest.turn < 2
           AND (latest.calibration_id IS NULL
                OR (SELECT box_id FROM calibration WHERE calibration.id = latest.calibration_id)
                   = (SELECT box_id FROM session WHERE session.id = job.session_id)));

CREATE VIEW uncounted_session (session_id) AS
    SELECT session_id FROM session_edit WHERE kind = 'set_aside' AND undone_at_ms IS NULL
    UNION ALL
    SELECT id FROM session WHERE box_question IN ('asked', 'other_box')
    UNION ALL
    SELECT session.id FROM pending_erasure JOIN session ON session.trainee_id = pending_erasure.trainee_id
    UNION ALL
    SELECT session.id FROM record_merge JOIN session ON session.trainee_id = record_merge.merged_trainee_id
    WHERE record_merge.separated_at_ms IS NULL
    UNION ALL
    SELECT attempt.session_id FROM exam_attempt AS attempt JOIN exam ON exam.id = attempt.exam_id
    WHERE attempt.session_id IS NOT NULL AND (attempt.voided_at_ms IS NOT NULL OR exam.state = 'running');

CREATE VIEW valid_setup AS
    SELECT made.session_id, made.made_at_ms,
           coalesce((SELECT calibration.id FROM calibration
                     WHERE calibration.box_id = made.box_id
                       AND coalesce(calibration.valid_from_ms, calibration.created_at_ms) <= made.made_at_ms
                     ORDER BY coalesce(calibration.valid_from_ms, calibration.created_at_ms) DESC, calibration.version DESC LIMIT 1),
                    (SELECT calibration.id FROM calibration WHERE calibration.box_id = made.box_id
                     ORDER BY coalesce(calibration.valid_from_ms, calibration.created_at_ms), calibration.version DESC LIMIT 1))
               AS calibration_id,
           coalesce((SELECT palette.id FROM palette
                     WHERE palette.box_id = made.box_id
                       AND coalesce(palette.valid_from_ms, palette.created_at_ms) <= made.made_at_ms
                     ORDER BY coalesce(palette.valid_from_ms, palette.created_at_ms) DESC, palette.version DESC LIMIT 1),
                    (SELECT palette.id FROM palette WHERE palette.box_id = made.box_id
                     ORDER BY coalesce(palette.valid_from_ms, palette.created_at_ms), palette.version DESC LIMIT 1))
               AS palette_id
    FROM session_time AS made;

CREATE VIEW visible_job (role, subject, job_id) AS
    SELECT 'administrator', CAST(NULL AS TEXT), id FROM job
    UNION ALL
    SELECT 'instructor', person.id, job.id FROM job CROSS JOIN person WHERE job.box_id IS NOT NULL
    UNION ALL
    SELECT 'instructor', group_instructor.person_id, job.id FROM job
    JOIN session ON session.id = job.session_id
    JOIN group_trainee ON group_trainee.trainee_id = session.trainee_id
    JOIN group_instructor ON group_instructor.group_id = group_trainee.group_id
    UNION ALL
    SELECT 'trainee', session.trainee_id, job.id FROM job JOIN session ON session.id = job.session_id
    WHERE session.id NOT IN (SELECT session_id FROM sealed_session);

CREATE VIEW visible_trainee (role, subject, trainee_id) AS
    SELECT 'trainee', id, id FROM trainee
    UNION ALL
    SELECT 'instructor', group_instructor.person_id, group_trainee.trainee_id
    FROM group_instructor JOIN group_trainee ON group_trainee.group_id = group_instructor.group_id;

CREATE VIEW voided_session (session_id) AS
    SELECT session_id FROM exam_attempt WHERE session_id IS NOT NULL AND voided_at_ms IS NOT NULL;
