-- Recordings that are pushed in one request: nobody can go on with one once that request is over.
ALTER TABLE feed ADD COLUMN is_push INTEGER NOT NULL DEFAULT 0 CHECK (is_push IN (0, 1)); -- 1: pushed in one request
