-- What came lately and wants somebody is looked for at each opening of the first page: along this index, and not through all sessions.
CREATE INDEX session_came ON session (created_at_ms, id);

-- The last backup is found without reading all that was ever changed.
CREATE INDEX audit_backup ON audit (id) WHERE action = 'create' AND noun = 'backup';
