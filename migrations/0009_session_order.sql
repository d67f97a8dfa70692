-- A box's sessions in the order in which they came: each is held against those before it.
CREATE INDEX session_box_order ON session (box_id, created_at_ms, id);
DROP INDEX session_box; -- the new one begins alike
