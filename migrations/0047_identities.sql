-- Single sign-on: accounts at an OpenID Connect provider that sign people in.

-- An account at a provider, and the person that it signs in.
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

-- Sign-ins with a provider end with the link to it. The token goes back to the provider at the sign-out, to end its sign-in, too.
ALTER TABLE cookie_session ADD COLUMN identity_id TEXT REFERENCES identity (id) ON DELETE CASCADE; -- the provider's account that signed in; NULL: login and password
ALTER TABLE cookie_session ADD COLUMN id_token TEXT CHECK (id_token IS NULL OR length(id_token) <= 8192); -- the provider's ID token of this sign-in; NULL: none, or too long
CREATE INDEX cookie_session_identity ON cookie_session (identity_id) WHERE identity_id IS NOT NULL;
