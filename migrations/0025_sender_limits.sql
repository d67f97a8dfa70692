-- Who sends a recording frame by frame, since limits count by sender, and whether the sender can continue it later.
ALTER TABLE feed ADD COLUMN actor TEXT CHECK (length(actor) BETWEEN 1 AND 64); -- person:ID, agent:BOX or service; NULL: begun before this column existed
ALTER TABLE feed ADD COLUMN resumes INTEGER NOT NULL DEFAULT 1 CHECK (resumes IN (0, 1)); -- whether its sender keeps what it has not sent, to continue later
CREATE INDEX audit_recordings ON audit (actor, at_ms) WHERE noun = 'session' AND action IN ('create', 'import');
