-- Recordings that wait for a name: a box, a folder or a member of staff sent them, and no person has said whose they are.

-- A recording without a name. It is not tracked. Once a person has assigned it, its row is replaced by a session with the same id.
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
CREATE INDEX waiting_recording_preview ON waiting_recording (preview) WHERE preview IS NOT NULL;
CREATE INDEX waiting_recording_box ON waiting_recording (box_id);
CREATE INDEX waiting_recording_task ON waiting_recording (task_id);
CREATE INDEX waiting_recording_trainee ON waiting_recording (trainee_id);
CREATE INDEX waiting_recording_person ON waiting_recording (person_id);
CREATE INDEX waiting_recording_arrived ON waiting_recording (arrived_at_ms);

-- A session that is erased does not leave its recording without a name.
CREATE TRIGGER session_leaves_no_waiting_recording AFTER DELETE ON session WHEN OLD.video IS NOT NULL BEGIN
    DELETE FROM waiting_recording WHERE video = OLD.video;
END;

DROP VIEW blob_reference;
CREATE VIEW blob_reference (hash) AS
    SELECT video FROM session WHERE video IS NOT NULL
    UNION ALL SELECT blob FROM job_file
    UNION ALL SELECT trajectory FROM result
    UNION ALL SELECT diagnostics FROM result WHERE diagnostics IS NOT NULL
    UNION ALL SELECT preview FROM result WHERE preview IS NOT NULL
    UNION ALL SELECT video FROM waiting_recording
    UNION ALL SELECT preview FROM waiting_recording WHERE preview IS NOT NULL;
