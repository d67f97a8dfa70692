// Every page of the dashboard: its address and the module that shows it.

/**
 * `:name` in a pattern matches any one part of an address, which the page receives as `route.params.name`. `nav` is
 * the entry of the navigation that the page belongs to, `needs` the permission for it. A module is loaded on first use.
 */
const PAGES = [
  { pattern: '/', nav: 'today', load: () => import('./pages/today.js') },
  { pattern: '/sessions', nav: 'sessions', load: () => import('./pages/sessions.js') },
  { pattern: '/sessions/:id', nav: 'sessions', load: () => import('./pages/session.js') },
  { pattern: '/sessions/:id/report', nav: 'sessions', load: () => import('./pages/session_report.js') },
  { pattern: '/live', nav: 'wall', needs: 'watch', load: () => import('./pages/live_overview.js') },
  { pattern: '/upload', nav: 'upload', load: () => import('./pages/upload.js') },
  { pattern: '/waiting', nav: 'waiting', needs: 'see_trainees', load: () => import('./pages/waiting.js') },
  { pattern: '/record', nav: 'record', load: () => import('./pages/record.js') },
  { pattern: '/trainees', nav: 'trainees', needs: 'see_trainees', load: () => import('./pages/trainees.js') },
  { pattern: '/trainees/:id', nav: 'trainees', load: () => import('./pages/trainee.js') },
  { pattern: '/trainees/:id/report', nav: 'trainees', load: () => import('./pages/trainee_report.js') },
  { pattern: '/trainees/:id/certificate', nav: 'trainees', load: () => import('./pages/certificate.js') },
  { pattern: '/certificates', nav: 'trainees', needs: 'see_trainees', load: () => import('./pages/certificates.js') },
  { pattern: '/exams', nav: 'trainees', load: () => import('./pages/exams.js') },
  { pattern: '/exams/:id', nav: 'trainees', load: () => import('./pages/exam.js') },
  { pattern: '/tasks', nav: 'tasks', needs: 'edit_tasks', load: () => import('./pages/tasks.js') },
  { pattern: '/tasks/:id', nav: 'tasks', needs: 'edit_tasks', load: () => import('./pages/task.js') },
  { pattern: '/groups', nav: 'groups', needs: 'see_trainees', load: () => import('./pages/groups.js') },
  { pattern: '/groups/:id', nav: 'groups', needs: 'see_trainees', load: () => import('./pages/group.js') },
  { pattern: '/enrol', nav: 'groups', needs: 'edit_trainees', load: () => import('./pages/enrol.js') },
  { pattern: '/courses', nav: 'groups', needs: 'edit_courses', load: () => import('./pages/courses.js') },
  { pattern: '/courses/:id', nav: 'groups', needs: 'edit_courses', load: () => import('./pages/course.js') },
  { pattern: '/check-in', nav: 'record', load: () => import('./pages/check_in.js') },
  { pattern: '/boxes', nav: 'boxes', needs: 'see_boxes', load: () => import('./pages/boxes.js') },
  { pattern: '/boxes/:id', nav: 'boxes', needs: 'see_boxes', load: () => import('./pages/box.js') },
  { pattern: '/boxes/:id/setup', nav: 'boxes', needs: 'edit_boxes', load: () => import('./pages/setup.js') },
  { pattern: '/people', nav: 'people', needs: 'people', load: () => import('./pages/people.js') },
  { pattern: '/consent', nav: 'people', needs: 'people', load: () => import('./pages/consent_texts.js') },
  { pattern: '/service', nav: 'people', needs: 'people', load: () => import('./pages/service.js') },
  { pattern: '/centre', nav: 'people', needs: 'people', load: () => import('./pages/centre.js') },
  { pattern: '/first-steps', nav: 'today', needs: 'see_trainees', load: () => import('./pages/first_steps.js') },
  { pattern: '/invite', nav: 'trainees', needs: 'edit_trainees', load: () => import('./pages/invite.js') },
  { pattern: '/account', nav: 'account', load: () => import('./pages/account.js') },
];

/** The page at the parts of an address, with its parameters: `{ page, params }`; null if there is none. */
export function matchPage(path) {
  for (const page of PAGES) {
    const params = matchPattern(page.pattern, path);
    if (params) return { page, params };
  }
  return null;
}

function matchPattern(pattern, path) {
  const parts = pattern.split('/').filter(Boolean);
  const isMatch = parts.length === path.length && parts.every((part, at) => part.startsWith(':') || part === path[at]);
  if (!isMatch) return null;
  return Object.fromEntries(parts.flatMap((part, at) => (part.startsWith(':') ? [[part.slice(1), path[at]]] : [])));
}
