// The only module that calls the REST API. Pages use the same routes as other programs.
import { t } from './texts.js';

const ROOT = '/api/v1';
const signedOutCallbacks = new Set();

/**
 * An RFC 9457 problem with all of its members: `title` says what happened, `detail` what to do. translate.js has both
 * in the page's language.
 */
export class Problem extends Error {
  constructor({ type, title, status, detail, ...more }) {
    super(title);
    Object.assign(this, more, { type: type ?? 'about:blank', title, status, detail: detail ?? '' });
  }

  /** Parses the body of a response. A proxy may have replaced the service's JSON with something else. */
  static fromText(status, text) {
    try {
      const body = JSON.parse(text);
      if (body?.title) return new Problem({ status, ...body });
    } catch {
      // Not JSON: the general text below applies.
    }
    return new Problem({ status, title: t.problems.answered(status), detail: t.problems.answeredDetail });
  }

  static offline() {
    return new Problem({ type: 'offline', title: t.problems.offline, status: 0, detail: t.problems.offlineDetail });
  }
}

/** Calls back when a response says that no user is signed in, or no longer. */
export function onSignedOut(callback) {
  signedOutCallbacks.add(callback);
  return () => signedOutCallbacks.delete(callback);
}

function address(path, query = {}) {
  const url = `${ROOT}/${path.map(encodeURIComponent).join('/')}`;
  const params = Object.entries(query).filter(([, value]) => value !== undefined && value !== null && value !== '');
  return params.length ? `${url}?${new URLSearchParams(params)}` : url;
}

/** The URL of a WebSocket. */
const socketAddress = (path, query) => `${location.origin.replace(/^http/, 'ws')}${address(path, query)}`;

async function request(method, path, { query, json, form, table, signal } = {}) {
  const headers = { accept: 'application/json' };
  if (json !== undefined) headers['content-type'] = 'application/json';
  if (table !== undefined) headers['content-type'] = 'text/csv';
  const body = json !== undefined ? JSON.stringify(json) : (table ?? form);
  let answer, text;
  try {
    answer = await fetch(address(path, query), { method, headers, body, signal, credentials: 'same-origin' });
    text = await answer.text(); // A response that breaks off in its body counts as offline, too.
  } catch (error) {
    throw error.name === 'AbortError' ? error : Problem.offline();
  }
  if (answer.ok) return parse(text);
  const problem = Problem.fromText(answer.status, text);
  if (answer.status === 401 && path[0] !== 'sign-in') signedOutCallbacks.forEach(callback => callback());
  throw problem;
}

/** The parsed JSON, or null for an empty body (a 201 or 202 may have one). */
const parse = text => (text ? JSON.parse(text) : null);

/** Loads a list page by page until it is complete or has `limit` items. For selects, which must offer all items. */
async function fetchAll(path, query = {}, limit = 1000) {
  const items = [];
  let cursor;
  do {
    const page = await request('GET', path, { query: { ...query, limit: 200, cursor } });
    items.push(...page.items);
    cursor = page.next;
  } while (cursor && items.length < limit);
  return items;
}

/** The usual operations on a resource: list, get, create, change, delete. */
const resource = name => ({
  all: query => fetchAll([name], query),
  page: (query, signal) => request('GET', [name], { query, signal }),
  get: (id, signal) => request('GET', [name, id], { signal }),
  create: json => request('POST', [name], { json }),
  change: (id, json) => request('PATCH', [name, id], { json }),
  remove: id => request('DELETE', [name, id]),
});

export const api = {
  me: () => request('GET', ['me']),
  signIn: (login, password) => request('POST', ['sign-in'], { json: { login, password } }),
  signOut: () => request('POST', ['sign-out']),
  changePassword: (old, fresh) => request('POST', ['me', 'password'], { json: { old, new: fresh } }),

  people: resource('people'),
  groups: {
    ...resource('groups'),
    /** `query`: task, feature, tool, space. */
    progress: (id, query, signal) => request('GET', ['groups', id, 'progress'], { query, signal }),
    setMembers: (id, json) => request('PUT', ['groups', id, 'members'], { json }),
    /** The group's trainees against the steps of the course plan that it follows. */
    course: (id, signal) => request('GET', ['groups', id, 'course'], { signal }),
    follow: (id, json) => request('PUT', ['groups', id, 'course'], { json }),
    unfollow: id => request('DELETE', ['groups', id, 'course']),
  },
  tokens: resource('tokens'),
  tasks: {
    ...resource('tasks'),
    models: (id, signal) => request('GET', ['tasks', id, 'models'], { signal }),
    train: id => request('POST', ['tasks', id, 'models']),
    /** Newest first; the first is the one in use. */
    standards: (id, signal) => request('GET', ['tasks', id, 'standards'], { signal }).then(page => page.items),
    presets: (id, signal) => request('GET', ['tasks', id, 'standards', 'presets'], { signal }).then(page => page.items),
    propose: (id, json) => request('POST', ['tasks', id, 'standards', 'proposals'], { json }),
    setStandard: (id, json) => request('POST', ['tasks', id, 'standards'], { json }),
    /** `query`: feature, tool, space, cohorts, hand, limit. */
    distribution: (id, query, signal) => request('GET', ['tasks', id, 'distribution'], { query, signal }),
    rescore: (id, json) => request('POST', ['tasks', id, 'rescorings'], { json }),
  },
  cohorts: {
    ...resource('cohorts'),
    members: id => fetchAll(['cohorts', id, 'members']),
    replace: (id, json) => request('PUT', ['cohorts', id], { json }),
  },
  courses: {
    ...resource('courses'),
    replace: (id, json) => request('PUT', ['courses', id], { json }),
  },
  rescorings: {
    ...resource('rescorings'),
    trainees: (id, query, signal) => request('GET', ['rescorings', id, 'trainees'], { query, signal }),
    sessions: (id, query, signal) => request('GET', ['rescorings', id, 'sessions'], { query, signal }),
    cancel: id => request('POST', ['rescorings', id, 'cancel']),
  },
  /** Enrols many trainees at once: all or none. */
  enrol: (rows, onlyCheck) => request('POST', ['enrolments'], { json: { rows, only_check: onlyCheck } }),
  attention: signal => request('GET', ['attention'], { signal }),
  service: signal => request('GET', ['service'], { signal }),
  audit: (query, signal) => request('GET', ['audit-entries'], { query, signal }),
  /** The catalogue of features that can be measured. */
  features: signal => request('GET', ['features'], { signal }).then(page => page.items),
  /** The forms for rating sessions. */
  ratingForms: signal => request('GET', ['rating-forms'], { signal }).then(page => page.items),
  /** `agreement`: whether a task's raters agree. `correlations`: which features correlate with their ratings. */
  agreement: (task, form, signal) => request('GET', ['tasks', task, 'agreement'], { query: { form }, signal }),
  correlations: (task, form, signal) => request('GET', ['tasks', task, 'correlations'], { query: { form }, signal }),
  jobs: { ...resource('jobs'), retry: id => request('POST', ['jobs', id, 'retry']) },
  trainees: {
    ...resource('trainees'),
    /** `query`: task, feature, tool, space, cohort. */
    progress: (id, query, signal) => request('GET', ['trainees', id, 'progress'], { query, signal }),
    /** The courses of the trainee's groups, latest first. */
    courses: (id, signal) => request('GET', ['trainees', id, 'courses'], { signal }).then(page => page.items),
  },
  boxes: {
    ...resource('boxes'),
    camera: id => request('GET', ['boxes', id, 'camera']),
    putCamera: (id, json) => request('PUT', ['boxes', id, 'camera'], { json }),
    calibrations: id => fetchAll(['boxes', id, 'calibrations']),
    calibrate: (id, form) => request('POST', ['boxes', id, 'calibrations'], { form }),
    /** Checks one photo of the board immediately. */
    checkPhoto: (id, form) => request('POST', ['boxes', id, 'calibrations', 'check'], { form }),
    /** The versions of the palette, newest first. */
    palettes: id => fetchAll(['boxes', id, 'palettes']),
    learnPalette: (id, form) => request('POST', ['boxes', id, 'palettes'], { form }),
    /** Shows what the marks would classify as tape on a few frames, immediately; nothing is learned. */
    previewPalette: (id, form, signal) => request('POST', ['boxes', id, 'palettes', 'preview'], { form, signal }),
    /** Asks which tapes suit the box in a picture: starts a job, which holds the advice when it is done. */
    advise: (id, form) => request('POST', ['boxes', id, 'palettes', 'advice'], { form }),
    /** The latest 100, newest first. */
    selfTests: id => fetchAll(['boxes', id, 'self-tests'], {}, 100),
    selfTest: (id, form) => request('POST', ['boxes', id, 'self-tests'], { form }),
    /** The address that takes frames while they are recorded; record/feed.js implements the protocol. */
    feedAddress: id => socketAddress(['boxes', id, 'feed']),
  },
  sessions: {
    ...resource('sessions'),
    /** `query`: trainee, task, box, tracker, filename, recorded_at. */
    importTable: (query, table) => request('POST', ['sessions', 'import'], { query, table }),
    retry: id => request('POST', ['sessions', id, 'retry']),
    /** `query`: kind, trimmed, from_frame, to_frame, points. */
    trajectory: (id, query, signal) =>
      request('GET', ['sessions', id, 'trajectory'], { query: { format: 'json', ...query }, signal }),
    /** `query`: from_frame, to_frame. */
    diagnostics: (id, query, signal) => request('GET', ['sessions', id, 'diagnostics'], { query, signal }),
    /** The session's edits: trims, swapped tool names, set aside. */
    edits: (id, signal) => request('GET', ['sessions', id, 'edits'], { signal }),
    edit: (id, json) => request('POST', ['sessions', id, 'edits'], { json }),
    undo: (id, edit) => request('POST', ['sessions', id, 'edits', edit, 'undo']),
    /** `evidence`: which stretches of the recording produced the features. `advice`: what to work on next. */
    evidence: (id, signal) => request('GET', ['sessions', id, 'evidence'], { signal }),
    advice: (id, signal) => request('GET', ['sessions', id, 'advice'], { signal }),
    comments: (id, signal) => request('GET', ['sessions', id, 'comments'], { signal }),
    comment: (id, json) => request('POST', ['sessions', id, 'comments'], { json }),
    withdraw: (id, comment) => request('DELETE', ['sessions', id, 'comments', comment]),
    ratings: (id, signal) => request('GET', ['sessions', id, 'ratings'], { signal }),
    rate: (id, json) => request('POST', ['sessions', id, 'ratings'], { json }),
    /** Opens the live stream of a session that is arriving. */
    watch: (id, query) => new WebSocket(socketAddress(['sessions', id, 'live'], query)),
    videoAddress: id => address(['sessions', id, 'video']),
    featuresAddress: (id, format) => address(['sessions', id, 'features'], { format }),
    trajectoryAddress: (id, format) => address(['sessions', id, 'trajectory'], { format, kind: 'smoothed' }),
  },
  /** tus 1.0.0; tus-js-client implements the protocol. */
  uploadsAddress: () => address(['uploads']),
  events: () => new EventSource(address(['events'])),
};
