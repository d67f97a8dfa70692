// The only file that talks to REST. Everything a page shows comes through here, from the same routes other programs use.
import { inOurWords } from './said.js';
import { t } from './texts.js';

const ROOT = '/api/v1';
const signedOut = new Set();

/** An RFC 9457 problem: `title` says what, `detail` says what to do, `lang` in which language if not the page's. */
export class Problem extends Error {
  constructor({ type, title, status, detail, lang, ...more }) {
    super(title);
    Object.assign(this, { type: type ?? 'about:blank', title, status, detail: detail ?? '', lang, more });
  }

  /** From an answer's text, which a proxy may have replaced by something that is not JSON. */
  static fromText(status, text) {
    try {
      const body = inOurWords(JSON.parse(text));
      if (body?.title) return new Problem({ status, ...body });
    } catch {
      // Falls through to the general words.
    }
    return new Problem({ status, title: t.problems.answered(status), detail: t.problems.answeredDetail });
  }

  static offline() {
    return new Problem({ type: 'offline', title: t.problems.offline, status: 0, detail: t.problems.offlineDetail });
  }
}

/** Calls back when an answer says that nobody is signed in (any more). */
export function onSignedOut(callback) {
  signedOut.add(callback);
  return () => signedOut.delete(callback);
}

function address(path, query = {}) {
  const url = `${ROOT}/${path.map(encodeURIComponent).join('/')}`;
  const kept = Object.entries(query).filter(([, value]) => value !== undefined && value !== null && value !== '');
  return kept.length ? `${url}?${new URLSearchParams(kept)}` : url;
}

/** The address of a WebSocket. */
const socketAddress = (path, query) => `${location.origin.replace(/^http/, 'ws')}${address(path, query)}`;

async function call(method, path, { query, json, form, table, signal } = {}) {
  const headers = { accept: 'application/json' };
  if (json !== undefined) headers['content-type'] = 'application/json';
  if (table !== undefined) headers['content-type'] = 'text/csv';
  const body = json !== undefined ? JSON.stringify(json) : (table ?? form);
  let answer, text;
  try {
    answer = await fetch(address(path, query), { method, headers, body, signal, credentials: 'same-origin' });
    text = await answer.text(); // cut within its body it is as far away as one that never came
  } catch (error) {
    throw error.name === 'AbortError' ? error : Problem.offline();
  }
  if (answer.ok) return parse(text);
  const problem = Problem.fromText(answer.status, text);
  if (answer.status === 401 && path[0] !== 'sign-in') signedOut.forEach(tell => tell());
  throw problem;
}

/** JSON, or null for an empty body (a 201 or 202 may have one). */
const parse = text => (text ? inOurWords(JSON.parse(text)) : null);

/** All items of a list up to `limit`, page by page: for choosers, which must not silently lack the 51st name. */
async function everything(path, query = {}, limit = 1000) {
  const items = [];
  let cursor;
  do {
    const page = await call('GET', path, { query: { ...query, limit: 200, cursor } });
    items.push(...page.items);
    cursor = page.next;
  } while (cursor && items.length < limit);
  return items;
}

/** The usual verbs of a noun that is listed, made, changed and deleted. */
const noun = name => ({
  all: query => everything([name], query),
  page: (query, signal) => call('GET', [name], { query, signal }),
  get: (id, signal) => call('GET', [name, id], { signal }),
  create: json => call('POST', [name], { json }),
  change: (id, json) => call('PATCH', [name, id], { json }),
  remove: id => call('DELETE', [name, id]),
});

export const api = {
  me: () => call('GET', ['me']),
  signIn: (login, password) => call('POST', ['sign-in'], { json: { login, password } }),
  signOut: () => call('POST', ['sign-out']),
  changePassword: (old, fresh) => call('POST', ['me', 'password'], { json: { old, new: fresh } }),

  people: noun('people'),
  groups: {
    ...noun('groups'),
    /** `query`: task, feature, tool, space. */
    progress: (id, query, signal) => call('GET', ['groups', id, 'progress'], { query, signal }),
    setMembers: (id, json) => call('PUT', ['groups', id, 'members'], { json }),
    /** Its trainees against the steps of the plan that it follows. */
    course: (id, signal) => call('GET', ['groups', id, 'course'], { signal }),
    follow: (id, json) => call('PUT', ['groups', id, 'course'], { json }),
    unfollow: id => call('DELETE', ['groups', id, 'course']),
  },
  tokens: noun('tokens'),
  tasks: {
    ...noun('tasks'),
    models: (id, signal) => call('GET', ['tasks', id, 'models'], { signal }),
    train: id => call('POST', ['tasks', id, 'models']),
    /** Newest first; the first is the one in use. */
    standards: (id, signal) => call('GET', ['tasks', id, 'standards'], { signal }).then(page => page.items),
    presets: (id, signal) => call('GET', ['tasks', id, 'standards', 'presets'], { signal }).then(page => page.items),
    propose: (id, json) => call('POST', ['tasks', id, 'standards', 'proposals'], { json }),
    setStandard: (id, json) => call('POST', ['tasks', id, 'standards'], { json }),
    /** `query`: feature, tool, space, cohorts, hand, limit. */
    distribution: (id, query, signal) => call('GET', ['tasks', id, 'distribution'], { query, signal }),
    rescore: (id, json) => call('POST', ['tasks', id, 'rescorings'], { json }),
  },
  cohorts: {
    ...noun('cohorts'),
    members: id => everything(['cohorts', id, 'members']),
    replace: (id, json) => call('PUT', ['cohorts', id], { json }),
  },
  courses: {
    ...noun('courses'),
    replace: (id, json) => call('PUT', ['courses', id], { json }),
  },
  rescorings: {
    ...noun('rescorings'),
    trainees: (id, query, signal) => call('GET', ['rescorings', id, 'trainees'], { query, signal }),
    sessions: (id, query, signal) => call('GET', ['rescorings', id, 'sessions'], { query, signal }),
  },
  /** Many trainees at once: all, or nobody. */
  enrol: (rows, onlyCheck) => call('POST', ['enrolments'], { json: { rows, only_check: onlyCheck } }),
  attention: signal => call('GET', ['attention'], { signal }),
  service: signal => call('GET', ['service'], { signal }),
  audit: (query, signal) => call('GET', ['audit'], { query, signal }),
  /** What can be measured. */
  features: signal => call('GET', ['features'], { signal }).then(page => page.items),
  /** On which forms sessions are rated. */
  ratingForms: signal => call('GET', ['rating-forms'], { signal }).then(page => page.items),
  /** Whether a task's raters agree, and with which features their ratings go. */
  agreement: (task, form, signal) => call('GET', ['tasks', task, 'agreement'], { query: { form }, signal }),
  correlations: (task, form, signal) => call('GET', ['tasks', task, 'correlations'], { query: { form }, signal }),
  jobs: { ...noun('jobs'), retry: id => call('POST', ['jobs', id, 'retry']) },
  trainees: {
    ...noun('trainees'),
    /** `query`: task, feature, tool, space, cohort. */
    progress: (id, query, signal) => call('GET', ['trainees', id, 'progress'], { query, signal }),
    /** The courses of their groups, the latest first. */
    courses: (id, signal) => call('GET', ['trainees', id, 'course'], { signal }).then(page => page.items),
  },
  boxes: {
    ...noun('boxes'),
    camera: id => call('GET', ['boxes', id, 'camera']),
    putCamera: (id, json) => call('PUT', ['boxes', id, 'camera'], { json }),
    calibrations: id => everything(['boxes', id, 'calibrations']),
    calibrate: (id, form) => call('POST', ['boxes', id, 'calibrations'], { form }),
    /** One photo of the board, looked at at once. */
    checkPhoto: (id, form) => call('POST', ['boxes', id, 'calibrations', 'check'], { form }),
    /** The versions of the colours, newest first. */
    palettes: id => everything(['boxes', id, 'palette']),
    putPalette: (id, form) => call('PUT', ['boxes', id, 'palette'], { form }),
    /** What marks would take for tape on a few frames, at once; nothing is learned. */
    previewPalette: (id, form, signal) => call('POST', ['boxes', id, 'palette', 'preview'], { form, signal }),
    /** Which tapes suit the box, by a picture of it: a job, which has the advice once it is done. */
    advise: (id, form) => call('POST', ['boxes', id, 'palette', 'advice'], { form }),
    /** The latest hundred, newest first. */
    selfTests: id => everything(['boxes', id, 'self-tests'], {}, 100),
    selfTest: (id, form) => call('POST', ['boxes', id, 'self-tests'], { form }),
    /** Where frames go while they are recorded; record/feed.js speaks the protocol. */
    feedAddress: id => socketAddress(['boxes', id, 'feed']),
  },
  sessions: {
    ...noun('sessions'),
    /** `query`: trainee, task, box, tracker, filename, recorded_at. */
    importTable: (query, table) => call('POST', ['sessions', 'import'], { query, table }),
    retry: id => call('POST', ['sessions', id, 'retry']),
    /** `query`: kind, trimmed, from_frame, to_frame, points. */
    trajectory: (id, query, signal) =>
      call('GET', ['sessions', id, 'trajectory'], { query: { format: 'json', ...query }, signal }),
    /** `query`: from_frame, to_frame. */
    diagnostics: (id, query, signal) => call('GET', ['sessions', id, 'diagnostics'], { query, signal }),
    /** What was changed about it: trims, exchanged names, set aside. */
    edits: (id, signal) => call('GET', ['sessions', id, 'edits'], { signal }),
    edit: (id, json) => call('POST', ['sessions', id, 'edits'], { json }),
    undo: (id, edit) => call('DELETE', ['sessions', id, 'edits', edit]),
    /** Which seconds made its features, and what to work on next. */
    evidence: (id, signal) => call('GET', ['sessions', id, 'evidence'], { signal }),
    advice: (id, signal) => call('GET', ['sessions', id, 'advice'], { signal }),
    comments: (id, signal) => call('GET', ['sessions', id, 'comments'], { signal }),
    comment: (id, json) => call('POST', ['sessions', id, 'comments'], { json }),
    withdraw: (id, comment) => call('DELETE', ['sessions', id, 'comments', comment]),
    ratings: (id, signal) => call('GET', ['sessions', id, 'ratings'], { signal }),
    rate: (id, json) => call('POST', ['sessions', id, 'ratings'], { json }),
    /** What its frames show while it arrives. */
    watch: (id, query) => new WebSocket(socketAddress(['sessions', id, 'live'], query)),
    videoAddress: id => address(['sessions', id, 'video']),
    featuresAddress: (id, format) => address(['sessions', id, 'features'], { format }),
    trajectoryAddress: (id, format) => address(['sessions', id, 'trajectory'], { format, kind: 'smoothed' }),
  },
  /** tus 1.0.0; the protocol itself is tus-js-client's. */
  uploadsAddress: () => address(['uploads']),
  events: () => new EventSource(address(['events'])),
};
