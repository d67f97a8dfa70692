-- The groups that own a box, a task or a course plan: their instructors may change it. Without such a group only administrators may.
CREATE TABLE ownership (
    group_id  TEXT NOT NULL REFERENCES training_group (id) ON DELETE CASCADE, -- the group
    box_id    TEXT REFERENCES training_box (id) ON DELETE CASCADE,           -- the box that it owns; NULL: something else
    task_id   TEXT REFERENCES task (id) ON DELETE CASCADE,                   -- the task that it owns; NULL: something else
    course_id TEXT REFERENCES course (id) ON DELETE CASCADE,                 -- the course plan that it owns; NULL: something else
    thing_id  TEXT NOT NULL AS (coalesce(box_id, task_id, course_id)),       -- id of the box, task or plan
    UNIQUE (thing_id, group_id),
    CHECK ((box_id IS NOT NULL) + (task_id IS NOT NULL) + (course_id IS NOT NULL) = 1)
) STRICT;
CREATE INDEX ownership_group ON ownership (group_id);
CREATE INDEX ownership_box ON ownership (box_id) WHERE box_id IS NOT NULL;
CREATE INDEX ownership_task ON ownership (task_id) WHERE task_id IS NOT NULL;
CREATE INDEX ownership_course ON ownership (course_id) WHERE course_id IS NOT NULL;

-- What exists already belongs to the groups that have used it, and to the groups of the instructor who made it.
INSERT INTO ownership (group_id, box_id)
    SELECT group_id, box_id FROM session JOIN group_trainee ON group_trainee.trainee_id = session.trainee_id
    UNION
    SELECT group_id, training_box.id FROM audit
    JOIN training_box ON training_box.id = subject
    JOIN group_instructor ON 'person:' || person_id = actor
    WHERE action = 'create' AND noun = 'box';
INSERT INTO ownership (group_id, task_id)
    SELECT group_id, task_id FROM session JOIN group_trainee ON group_trainee.trainee_id = session.trainee_id
    UNION
    SELECT group_id, task_id FROM group_course JOIN course_step ON course_step.course_id = group_course.course_id
    UNION
    SELECT group_id, task.id FROM audit
    JOIN task ON task.id = subject
    JOIN group_instructor ON 'person:' || person_id = actor
    WHERE action = 'create' AND noun = 'task';
INSERT INTO ownership (group_id, course_id)
    SELECT group_id, course_id FROM group_course
    UNION
    SELECT group_id, course.id FROM audit
    JOIN course ON course.id = subject
    JOIN group_instructor ON 'person:' || person_id = actor
    WHERE action = 'create' AND noun = 'course';

-- What no group has used yet belongs to all groups, so that the people who prepare it can continue.
INSERT INTO ownership (group_id, box_id)
    SELECT training_group.id, training_box.id FROM training_group, training_box
    WHERE training_box.id NOT IN (SELECT thing_id FROM ownership);
INSERT INTO ownership (group_id, task_id)
    SELECT training_group.id, task.id FROM training_group, task
    WHERE task.id NOT IN (SELECT thing_id FROM ownership);
INSERT INTO ownership (group_id, course_id)
    SELECT training_group.id, course.id FROM training_group, course
    WHERE course.id NOT IN (SELECT thing_id FROM ownership);
