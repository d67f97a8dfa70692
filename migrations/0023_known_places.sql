-- The places that have signed in to an account before: guesses from elsewhere do not lock them out.
CREATE TABLE known_place (
    person_id       TEXT NOT NULL REFERENCES person (id) ON DELETE CASCADE,  -- whose account
    place_hash      BLOB NOT NULL CHECK (length(place_hash) = 32),           -- SHA-256 of a browser's secret, or of account and address
    last_used_at_ms INTEGER NOT NULL CHECK (last_used_at_ms >= 0),           -- the last sign-in from there, epoch ms
    PRIMARY KEY (person_id, place_hash)
) STRICT, WITHOUT ROWID;
CREATE INDEX known_place_age ON known_place (last_used_at_ms);
