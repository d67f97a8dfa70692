-- Who says when a session was recorded: its sender, or the service, which knows the arrival.
ALTER TABLE session ADD COLUMN recorded_at_source TEXT NOT NULL DEFAULT 'claimed' CHECK (recorded_at_source IN ('claimed', 'arrival')); -- where recorded_at_ms comes from: RecordedAtSource

-- Before, a session without a stated time got that of its arrival, and a push that of its beginning.
UPDATE session SET recorded_at_source = 'arrival'
WHERE recorded_at_ms = created_at_ms OR id IN (SELECT session_id FROM feed WHERE is_push);

-- Why a live recording ended before its sender meant it to; NULL: it did not, or it is not known.
ALTER TABLE feed ADD COLUMN early_end TEXT CHECK (early_end IN ('source_lost', 'sender_gone', 'by_person')); -- EarlyEndCause
ALTER TABLE feed ADD COLUMN early_end_detail TEXT CHECK (length(early_end_detail) BETWEEN 1 AND 200); -- what happened, for people
