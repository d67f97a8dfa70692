-- Who chose an account's password. Until a person has chosen one, they can do nothing else.
ALTER TABLE person ADD COLUMN password_state TEXT NOT NULL DEFAULT 'own'
    CHECK (password_state IN ('missing', 'own', 'change_in_browser', 'change_required')); -- whether the person has a password, and must change it
ALTER TABLE cookie_session ADD COLUMN must_change_password INTEGER NOT NULL DEFAULT 0 CHECK (must_change_password IN (0, 1)); -- 1: the browser may only change the password

-- Links for choosing a password without the old one. The secret in a link is stored nowhere.
CREATE TABLE password_link (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                         -- PasswordLinkId
    person_id     TEXT NOT NULL UNIQUE REFERENCES person (id) ON DELETE CASCADE,    -- whose password it sets; a new link replaces the one before
    secret_hash   BLOB NOT NULL UNIQUE CHECK (length(secret_hash) = 32),            -- SHA-256 of the secret's 32 bytes
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),                      -- when it was made, epoch ms
    expires_at_ms INTEGER NOT NULL CHECK (expires_at_ms > created_at_ms)            -- when it expires, epoch ms
) STRICT;
