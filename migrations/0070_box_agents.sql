-- The agents that stand by at boxes. Their state itself is in memory: it changes every two seconds.
CREATE TABLE box_agent (
    box_id       TEXT PRIMARY KEY REFERENCES training_box (id) ON DELETE CASCADE, -- whose
    program      TEXT NOT NULL CHECK (length(program) <= 120),                   -- program and version, for people
    last_seen_ms INTEGER NOT NULL CHECK (last_seen_ms >= 0)                      -- when its last state arrived, precise to a minute, epoch ms
) STRICT;
