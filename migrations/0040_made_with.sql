-- What made a token, who made a link for a password, and which path was imported.

-- A token that another token made is withdrawn together with it.
ALTER TABLE token ADD COLUMN made_with TEXT REFERENCES token (id) ON DELETE CASCADE; -- the token that made it; NULL: a person who was signed in, or a command
CREATE INDEX token_made_with ON token (made_with) WHERE made_with IS NOT NULL;

-- Tokens that exceed the role of their person did not work, and would have worked again with the old role.
DELETE FROM token
WHERE role <> 'agent'
  AND person_id IN (SELECT person.id FROM person WHERE person.role NOT IN (token.role, 'administrator'));

-- A link is withdrawn when its maker is no administrator any more.
ALTER TABLE password_link ADD COLUMN made_by TEXT REFERENCES person (id) ON DELETE CASCADE; -- who made it; NULL: the service, or made before this was noted
CREATE INDEX password_link_made_by ON password_link (made_by) WHERE made_by IS NOT NULL;

-- The same path of a trainee and a task is imported once, even if the bytes of its tables differ. Sessions that were
-- imported before get the hash of the path that they store. It has the tools in the order of their first appearance,
-- and the check of a new import has them in alphabetical order: a path whose tools appeared in another order can be
-- imported once more.
ALTER TABLE session ADD COLUMN path_hash TEXT CHECK (length(path_hash) = 64); -- SHA-256 of the imported path, hexadecimal; NULL: not imported
UPDATE session
SET path_hash = (SELECT trajectory FROM result WHERE session_id = session.id ORDER BY created_at_ms, id LIMIT 1)
WHERE tracker IS NOT NULL;
