-- Whether the recording of a finished upload was a session already. Uploads that were finished before are taken as new.
ALTER TABLE upload ADD COLUMN is_duplicate INTEGER NOT NULL DEFAULT 0 CHECK (is_duplicate IN (0, 1)); -- the session existed before this upload
