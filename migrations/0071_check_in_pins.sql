-- The PINs that trainees check in with at boxes. A PIN opens nothing else.
CREATE TABLE check_in_pin (
    person_id TEXT PRIMARY KEY REFERENCES person (id) ON DELETE CASCADE,         -- whose; deleted with the account
    pin_hash  TEXT NOT NULL CHECK (pin_hash LIKE '$argon2id$%'),                    -- argon2id, like a password's
    set_at_ms INTEGER NOT NULL CHECK (set_at_ms >= 0)                            -- when it was set, epoch ms
) STRICT;
