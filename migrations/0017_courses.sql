-- What a course asks for, and which groups follow one. How far somebody has come is worked out from their sessions and stands nowhere
-- here: nothing in these tables is about a person.

-- A course plan: the centre's, like a task. Its steps stand below.
CREATE TABLE course (
    id            TEXT PRIMARY KEY CHECK (length(id) = 36),                  -- CourseId
    name          TEXT NOT NULL UNIQUE CHECK (length(name) BETWEEN 1 AND 120), -- what people call it
    created_at_ms INTEGER NOT NULL CHECK (created_at_ms >= 0)                -- when made, epoch ms
) STRICT;

-- A step of a plan. A plan that is changed has new steps; what was asked before is not kept.
CREATE TABLE course_step (
    course_id   TEXT NOT NULL REFERENCES course (id) ON DELETE CASCADE,      -- of which plan
    position    INTEGER NOT NULL CHECK (position >= 0),                      -- its place in the plan's order
    task_id     TEXT NOT NULL REFERENCES task (id) ON DELETE RESTRICT,       -- what to train
    within_days INTEGER CHECK (within_days BETWEEN 0 AND 3650),              -- due so many days after the beginning; NULL: at any time
    sessions    INTEGER CHECK (sessions BETWEEN 1 AND 200),                  -- so many sessions; NULL: the task's standard, passed
    PRIMARY KEY (course_id, position)
) STRICT, WITHOUT ROWID;
CREATE INDEX course_step_task ON course_step (task_id);
-- An index, for NULL is not equal to NULL in a UNIQUE constraint.
CREATE UNIQUE INDEX course_step_once ON course_step (course_id, task_id, coalesce(sessions, 0));

-- Which plan a group follows, from which day on.
CREATE TABLE group_course (
    group_id  TEXT PRIMARY KEY REFERENCES training_group (id) ON DELETE CASCADE, -- the group
    course_id TEXT NOT NULL REFERENCES course (id) ON DELETE RESTRICT,       -- the plan
    begins    TEXT NOT NULL CHECK (begins GLOB '[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]') -- first day, as 2026-01-05
) STRICT, WITHOUT ROWID;
CREATE INDEX group_course_course ON group_course (course_id);
