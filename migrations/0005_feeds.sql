-- Recordings that arrive frame by frame. The frames lie in a log of the vault; this row says whose they are.
CREATE TABLE feed (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- FeedId, made by the sender; its log has the same name
    session_id    TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,   -- the session that it is
    box_id        TEXT NOT NULL REFERENCES training_box (id) ON DELETE CASCADE, -- where
    codec         TEXT NOT NULL CHECK (codec IN ('jpeg', 'h264')),           -- how frames are coded
    width         INTEGER NOT NULL CHECK (width BETWEEN 1 AND 65535),        -- picture width, pixels
    height        INTEGER NOT NULL CHECK (height BETWEEN 1 AND 65535),       -- picture height, pixels
    tick_num      INTEGER NOT NULL CHECK (tick_num >= 1),                    -- a tick of its clock: tick_num / tick_den seconds
    tick_den      INTEGER NOT NULL CHECK (tick_den >= 1),                    -- see tick_num
    sender        TEXT NOT NULL CHECK (length(sender) <= 120),               -- the sender's program, for people
    epoch         INTEGER NOT NULL CHECK (epoch >= 1),                       -- connections so far; only the last may send
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0),               -- when first heard of, epoch ms
    ended_at_ms   INTEGER CHECK (ended_at_ms >= created_at_ms),              -- when its recording was stored, epoch ms
    live_features TEXT CHECK (json_valid(live_features))                     -- at its end, by the causal filter: [LiveFeature]
) STRICT;
CREATE INDEX feed_session ON feed (session_id);
CREATE INDEX feed_box ON feed (box_id);
CREATE INDEX feed_unfinished ON feed (id) WHERE ended_at_ms IS NULL;

-- Feeds that were erased: their sender is told, and cannot bring them back.
CREATE TABLE erased_feed (
    id TEXT PRIMARY KEY CHECK (length(id) = 36)                              -- FeedId
) STRICT, WITHOUT ROWID;
CREATE TRIGGER feed_erased AFTER DELETE ON feed BEGIN
    INSERT INTO erased_feed (id) VALUES (OLD.id) ON CONFLICT DO NOTHING;
END;
