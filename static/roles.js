// The actions that each role is offered. The server decides; hiding only spares people buttons that would be refused.
const ALLOWED = {
  administrator: [
    'upload',
    'retry',
    'edit_sessions',
    'rate',
    'delete',
    'see_trainees',
    'edit_trainees',
    'edit_tasks',
    'edit_courses',
    'see_boxes',
    'edit_boxes',
    'people',
    'watch',
  ],
  instructor: [
    'upload',
    'retry',
    'edit_sessions',
    'rate',
    'delete',
    'see_trainees',
    'edit_trainees',
    'edit_tasks',
    'edit_courses',
    'see_boxes',
    'edit_boxes',
    'watch',
  ],
  trainee: ['upload_own'],
};

export function may(person, action) {
  return ALLOWED[person?.role]?.includes(action) ?? false;
}
