-- How fast a pushed stream arrived: its time stamps may run at another pace.
ALTER TABLE feed ADD COLUMN arrived_s REAL CHECK (arrived_s >= 0); -- time between the arrivals of two of its frames, s; NULL: not a push, or too short
ALTER TABLE feed ADD COLUMN stamped_s REAL CHECK (stamped_s >= 0); -- time between the same frames by their stamps, s
