-- Lists of sessions by recording time, and what stands behind a session: whether staff saw it, whether its date is known,
-- and whether the same recording is filed under another trainee.

ALTER TABLE session ADD COLUMN supervision TEXT CHECK (supervision IN ('sent_by_staff', 'marked', 'none')); -- whether staff saw the attempt ([Supervision]); NULL: from before this was recorded
ALTER TABLE session ADD COLUMN supervised_by TEXT REFERENCES person (id) ON DELETE SET NULL; -- who saw it, or who took the mark back; NULL: no person, or deleted
ALTER TABLE session ADD COLUMN supervised_at_ms INTEGER CHECK (supervised_at_ms >= 0);       -- when that was recorded, epoch ms; NULL: never
ALTER TABLE session ADD COLUMN date_known INTEGER NOT NULL DEFAULT 0 CHECK (date_known IN (0, 1)); -- 0: `recorded_at_ms` rests only on a trainee's word or file

-- Earlier sessions: the service noted an arrival itself, and a live recording arrived while it was made. Who sent the others is not kept.
UPDATE session SET date_known = 1
WHERE recorded_at_source = 'arrival' OR id IN (SELECT session_id FROM feed);

CREATE INDEX session_recorded ON session (recorded_at_ms, id);
CREATE INDEX session_path ON session (path_hash) WHERE path_hash IS NOT NULL;
CREATE INDEX session_supervised_by ON session (supervised_by) WHERE supervised_by IS NOT NULL;

-- What stands behind each session, beside `session_record`.
CREATE VIEW session_background (session_id, recorded_at_source, date_known, supervision, supervised_at_ms, supervisor) AS
    SELECT session.id, session.recorded_at_source, session.date_known, session.supervision, session.supervised_at_ms, person.name
    FROM session LEFT JOIN person ON person.id = session.supervised_by;
