-- A lost lease says nothing about its job: power failed, or the service was killed. So it is counted apart from the attempts
-- whose child process crashed, and many more are allowed.
ALTER TABLE job ADD COLUMN lost_leases INTEGER NOT NULL DEFAULT 0 CHECK (lost_leases >= 0); -- leases that ran out or ended with the service
