// The only module that calls the REST API. Pages use the same routes as other programs.
import { basePath } from './base_path.js';
import { t } from './texts.js';

const ROOT = `${basePath}/api/v1`;
/** @type {Set<() => void>} */
const signedOutCallbacks = new Set();
/** @type {Set<() => void>} */
const changedCallbacks = new Set();

/**
 * An RFC 9457 problem with all of its members: `title` says what happened, `detail` what to do. translate.js has both
 * in the page's language.
 */
export class Problem extends Error {
  status = 0;
  title = '';
  detail = '';
  type = 'about:blank';
  /** The address that a certificate would have, if only this computer or network can open it. @type {string | undefined} */
  local_address;

  /** @param {{ type?: string, title: string, status: number, detail?: string, [member: string]: unknown }} members */
  constructor({ type, title, status, detail, ...more }) {
    super(title);
    Object.assign(this, more, { type: type ?? 'about:blank', title, status, detail: detail ?? '' });
  }

  /**
   * Parses the body of a response. A proxy may have replaced the service's JSON with something else.
   *
   * @param {number} status
   * @param {string} text
   */
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

/**
 * Calls back when a response says that no user is signed in, or no longer.
 *
 * @param {() => void} callback
 */
export function onSignedOut(callback) {
  signedOutCallbacks.add(callback);
  return () => signedOutCallbacks.delete(callback);
}

/**
 * Calls back after each change that this page made: by a request, or by a job that it started and that is done.
 *
 * @param {() => void} callback
 */
export function onChanged(callback) {
  changedCallbacks.add(callback);
  return () => void changedCallbacks.delete(callback);
}

/** Calls back all that asked for it with `onChanged`. */
export const reportChange = () => changedCallbacks.forEach(callback => callback());

/**
 * @param {ApiPath} path
 * @param {ApiQuery} [query]
 */
function address(path, query = {}) {
  const url = `${ROOT}/${path.map(encodeURIComponent).join('/')}`;
  const params = Object.entries(query).filter(([, value]) => value !== undefined && value !== null && value !== '');
  return params.length ? `${url}?${new URLSearchParams(/** @type {[string, string][]} */ (params))}` : url;
}

/**
 * The URL of a WebSocket.
 *
 * @param {ApiPath} path
 * @param {ApiQuery} [query]
 */
const socketAddress = (path, query) => `${location.origin.replace(/^http/, 'ws')}${address(path, query)}`;

/**
 * @template {ApiMethod} M
 * @template {ApiPath} const P
 * @param {M} method
 * @param {KnownPath<M, P>} path
 * @param {{ query?: ApiQueryOf<M, P>, json?: ApiBody<M, P>, form?: FormData, table?: string,
 *   picture?: Blob, signal?: AbortSignal }} [options]
 * @returns {Promise<ApiAnswer<M, P>>}
 */
async function request(method, path, { query, json, form, table, picture, signal } = {}) {
  const headers = { accept: 'application/json' };
  if (json !== undefined) headers['content-type'] = 'application/json';
  if (table !== undefined) headers['content-type'] = 'text/csv';
  if (picture) headers['content-type'] = picture.type;
  const body = json !== undefined ? JSON.stringify(json) : (table ?? picture ?? form);
  let answer, text;
  try {
    const url = address(path, /** @type {ApiQuery} */ (query));
    answer = await fetch(url, { method, headers, body, signal, credentials: 'same-origin' });
    text = await answer.text(); // A response that breaks off in its body counts as offline, too.
  } catch (error) {
    throw error.name === 'AbortError' ? error : Problem.offline();
  }
  if (answer.ok) {
    if (method !== 'GET') reportChange();
    return parse(text);
  }
  const problem = Problem.fromText(answer.status, text);
  // A wrong password is refused with 401, too, and ends no sign-in.
  if (answer.status === 401 && problem.type.endsWith('not-signed-in')) signedOutCallbacks.forEach(callback => callback());
  throw problem;
}

/**
 * The parsed JSON, or null for an empty body (a 201 or 202 may have one).
 *
 * @param {string} text
 */
const parse = text => (text ? JSON.parse(text) : null);

/**
 * `request` for a path that is a parameter itself: the types of `fetchAll` and `resource` then say what is answered.
 *
 * @type {(method: ApiMethod, path: ApiPath, options?: object) => Promise<any>}
 */
const requestAny = /** @type {any} */ (request);

/**
 * Loads a list page by page until it is complete or has `limit` items. For selects, which must offer all items.
 *
 * @template {ApiPath} const P
 * @param {P} path
 * @param {ApiQuery} [query]
 * @param {number} [limit]
 * @returns {Promise<ApiItem<P>[]>}
 */
async function fetchAll(path, query = {}, limit = 1000) {
  /** @type {ApiItem<P>[]} */
  const items = [];
  let cursor;
  do {
    const page = await requestAny('GET', path, { query: { ...query, limit: 200, cursor } });
    items.push(...page.items);
    cursor = page.next;
  } while (cursor && items.length < limit);
  return items;
}

/**
 * The usual operations on a resource: list, get, create, change, delete.
 *
 * @template {string} N
 * @param {N} name
 * @returns {ApiResource<N>}
 */
const resource = name => ({
  all: query => fetchAll([name], /** @type {ApiQuery} */ (query)),
  page: (query, signal) => requestAny('GET', [name], { query, signal }),
  get: (id, signal) => requestAny('GET', [name, id], { signal }),
  create: json => requestAny('POST', [name], { json }),
  change: (id, json) => requestAny('PATCH', [name, id], { json }),
  remove: id => requestAny('DELETE', [name, id]),
});

export const api = {
  me: () => request('GET', ['me']),
  /** @param {string} login @param {string} password */
  signIn: (login, password) => request('POST', ['sign-in'], { json: { login, password } }),
  signOut: () => request('POST', ['sign-out']),
  /** @param {string} old @param {string} fresh @param {boolean} keepTokens */
  changePassword: (old, fresh, keepTokens) =>
    request('POST', ['me', 'password'], { json: { old, new: fresh, keep_tokens: keepTokens } }),
  /** The own account's sign-ins and tokens. */
  own: {
    /** @param {AbortSignal} [signal] */
    signIns: signal => request('GET', ['me', 'sign-ins'], { signal }),
    /** The PIN for boxes. @param {AbortSignal} [signal] */
    pin: signal => request('GET', ['me', 'pin'], { signal }),
    /** @param {string} pin */
    setPin: pin => request('PUT', ['me', 'pin'], { json: { pin } }),
    removePin: () => request('DELETE', ['me', 'pin']),
    /** @param {string} id */
    endSignIn: id => request('DELETE', ['me', 'sign-ins', id]),
    /** @param {AbortSignal} [signal] */
    tokens: signal => request('GET', ['me', 'tokens'], { signal }),
    /** @param {string} id */
    removeToken: id => request('DELETE', ['me', 'tokens', id]),
  },

  /** Signing in with a provider, and the links between accounts here and there. */
  singleSignOn: {
    describe: () => request('GET', ['single-sign-on']),
    /** `next`: the page to show afterwards. @param {string} next */
    start: next => request('POST', ['single-sign-on', 'start'], { json: { next } }),
    /** @param {string} [password] */
    startLink: password => request('POST', ['me', 'identities'], { json: { password } }),
    /** @param {ApiBody<'POST', ['single-sign-on', 'finish']>} json */
    finish: json => request('POST', ['single-sign-on', 'finish'], { json }),
    signOut: () => request('POST', ['single-sign-on', 'sign-out']),
    /** @param {AbortSignal} [signal] */
    own: signal => request('GET', ['me', 'identities'], { signal }),
    /** @param {string} id */
    removeOwn: id => request('DELETE', ['me', 'identities', id]),
    all: () => fetchAll(['identities']),
    /** @param {string} id */
    remove: id => request('DELETE', ['identities', id]),
  },

  people: resource('people'),
  /** Links for choosing a password without the old one. */
  passwordLinks: {
    all: () => fetchAll(['password-links']),
    /** @param {string} person */
    create: person => request('POST', ['password-links'], { json: { person } }),
    /** @param {string} id */
    withdraw: id => request('DELETE', ['password-links', id]),
    /** Whose password the link sets. @param {string} secret @param {AbortSignal} [signal] */
    open: (secret, signal) => request('POST', ['password-links', 'open'], { json: { secret }, signal }),
    /** @param {string} secret @param {string} fresh */
    use: (secret, fresh) => request('POST', ['password-links', 'use'], { json: { secret, new: fresh } }),
  },
  groups: {
    ...resource('groups'),
    /**
     * @param {string} id @param {ApiQueryOf<'GET', ['groups', string, 'progress']>} [query]
     * @param {AbortSignal} [signal]
     */
    progress: (id, query, signal) => request('GET', ['groups', id, 'progress'], { query, signal }),
    /** @param {string} id @param {ApiBody<'PUT', ['groups', string, 'members']>} json */
    setMembers: (id, json) => request('PUT', ['groups', id, 'members'], { json }),
    /**
     * The group's trainees against the steps of the course plan that it follows.
     * @param {string} id @param {AbortSignal} [signal]
     */
    course: (id, signal) => request('GET', ['groups', id, 'course'], { signal }),
    /** @param {string} id @param {ApiBody<'PUT', ['groups', string, 'course']>} json */
    follow: (id, json) => request('PUT', ['groups', id, 'course'], { json }),
    /** @param {string} id */
    unfollow: id => request('DELETE', ['groups', id, 'course']),
  },
  tokens: resource('tokens'),
  tasks: {
    ...resource('tasks'),
    /** @param {string} id @param {AbortSignal} [signal] */
    models: (id, signal) => request('GET', ['tasks', id, 'models'], { signal }),
    /** @param {string} id */
    train: id => request('POST', ['tasks', id, 'models']),
    /** Newest first; the first is the one in use. @param {string} id @param {AbortSignal} [signal] */
    standards: (id, signal) => request('GET', ['tasks', id, 'standards'], { signal }).then(page => page.items),
    /** @param {string} id @param {AbortSignal} [signal] */
    presets: (id, signal) => request('GET', ['tasks', id, 'standards', 'presets'], { signal }).then(page => page.items),
    /** @param {string} id @param {ApiBody<'POST', ['tasks', string, 'standards', 'proposals']>} json */
    propose: (id, json) => request('POST', ['tasks', id, 'standards', 'proposals'], { json }),
    /** @param {string} id @param {ApiBody<'POST', ['tasks', string, 'standards']>} json */
    setStandard: (id, json) => request('POST', ['tasks', id, 'standards'], { json }),
    /**
     * @param {string} id @param {ApiQueryOf<'GET', ['tasks', string, 'distribution']>} [query]
     * @param {AbortSignal} [signal]
     */
    distribution: (id, query, signal) => request('GET', ['tasks', id, 'distribution'], { query, signal }),
    /** Newest first; the first is the one in use. @param {string} id @param {AbortSignal} [signal] */
    errorLists: (id, signal) => request('GET', ['tasks', id, 'error-lists'], { signal }).then(page => page.items),
    /** @param {string} id @param {ApiBody<'POST', ['tasks', string, 'error-lists']>} json */
    setErrorList: (id, json) => request('POST', ['tasks', id, 'error-lists'], { json }),
    /** Newest first. @param {string} id @param {AbortSignal} [signal] */
    scoreFormulas: (id, signal) => request('GET', ['tasks', id, 'score-formulas'], { signal }).then(page => page.items),
    /** @param {string} id @param {ApiBody<'POST', ['tasks', string, 'score-formulas']>} json */
    setScoreFormula: (id, json) => request('POST', ['tasks', id, 'score-formulas'], { json }),
    /** @param {string} id @param {ApiBody<'POST', ['tasks', string, 'score-formulas', 'previews']>} json */
    tryScoreFormula: (id, json) => request('POST', ['tasks', id, 'score-formulas', 'previews'], { json }),
    /** Whether raters agree on the error items. @param {string} id @param {AbortSignal} [signal] */
    errorAgreement: (id, signal) => request('GET', ['tasks', id, 'error-agreement'], { signal }),
    /** @param {string} id @param {ApiBody<'POST', ['tasks', string, 'rescorings']>} json */
    rescore: (id, json) => request('POST', ['tasks', id, 'rescorings'], { json }),
  },
  cohorts: {
    ...resource('cohorts'),
    /** @param {string} id */
    members: id => fetchAll(['cohorts', id, 'members']),
    /** @param {string} id @param {ApiBody<'PUT', ['cohorts', string]>} json */
    replace: (id, json) => request('PUT', ['cohorts', id], { json }),
  },
  courses: {
    ...resource('courses'),
    /** @param {string} id @param {ApiBody<'PUT', ['courses', string]>} json */
    replace: (id, json) => request('PUT', ['courses', id], { json }),
  },
  rescorings: {
    ...resource('rescorings'),
    /**
     * @param {string} id @param {ApiQueryOf<'GET', ['rescorings', string, 'trainees']>} [query]
     * @param {AbortSignal} [signal]
     */
    trainees: (id, query, signal) => request('GET', ['rescorings', id, 'trainees'], { query, signal }),
    /**
     * @param {string} id @param {ApiQueryOf<'GET', ['rescorings', string, 'sessions']>} [query]
     * @param {AbortSignal} [signal]
     */
    sessions: (id, query, signal) => request('GET', ['rescorings', id, 'sessions'], { query, signal }),
    /** @param {string} id */
    cancel: id => request('POST', ['rescorings', id, 'cancel']),
  },
  /**
   * Enrols many trainees at once: all or none. The options say whether groups and accounts are made.
   * @param {Schemas['NewEnrolment']['rows']} rows @param {Omit<Schemas['NewEnrolment'], 'rows'>} options
   */
  enrol: (rows, options) => request('POST', ['enrolments'], { json: { rows, ...options } }),
  invitations: {
    /** How the trainees sign in; with a group only its trainees. @param {string} [group] @param {AbortSignal} [signal] */
    accounts: (group, signal) => request('GET', ['trainee-accounts'], { query: { group }, signal }).then(page => page.items),
    /** @param {Schemas['NewInvitation'][]} invitations @param {boolean} alsoWithPassword */
    create: (invitations, alsoWithPassword) =>
      request('POST', ['invitations'], { json: { invitations, also_with_password: alsoWithPassword } }),
  },
  /** The centre's name and logo, which need no sign-in to be read. */
  centre: {
    get: () => request('GET', ['centre']),
    /** @param {string | null} name */
    setName: name => request('PUT', ['centre'], { json: { name } }),
    /** @param {Blob} picture */
    setLogo: picture => request('PUT', ['centre', 'logo'], { picture }),
    removeLogo: () => request('DELETE', ['centre', 'logo']),
    /** @param {string} version */
    logoAddress: version => address(['centre', 'logo'], { version }),
  },
  /** Which first steps of a new centre are done. @param {AbortSignal} [signal] */
  firstSteps: signal => request('GET', ['first-steps'], { signal }),
  /** @param {AbortSignal} [signal] */
  attention: signal => request('GET', ['attention'], { signal }),
  /** What the caller has dismissed from that list. @param {AbortSignal} [signal] */
  dismissals: signal => request('GET', ['attention', 'dismissals'], { signal }).then(page => page.items),
  /** @param {ApiBody<'POST', ['attention', 'dismissals']>} json */
  dismiss: json => request('POST', ['attention', 'dismissals'], { json }),
  /** @param {string} id */
  undoDismissal: id => request('DELETE', ['attention', 'dismissals', id]),
  /** What is new to the calling trainee. @param {AbortSignal} [signal] */
  feedback: signal => request('GET', ['feedback'], { signal }),
  /** @param {string} until */
  feedbackSeen: until => request('POST', ['feedback', 'seen'], { json: { until } }),
  /** @param {AbortSignal} [signal] */
  service: signal => request('GET', ['service'], { signal }),
  /** Everything that is stored in the centre. @param {boolean} videos */
  dataAddress: videos => address(['data.zip'], { videos: String(videos) }),
  /** @param {ApiQueryOf<'GET', ['audit-entries']>} [query] @param {AbortSignal} [signal] */
  audit: (query, signal) => request('GET', ['audit-entries'], { query, signal }),
  /** The catalogue of features that can be measured. @param {AbortSignal} [signal] */
  features: signal => request('GET', ['features'], { signal }).then(page => page.items),
  /** Lists of error items with formulas, to start from. @param {AbortSignal} [signal] */
  errorExamples: signal => request('GET', ['error-examples'], { signal }).then(page => page.items),
  /** The forms for rating sessions. @param {AbortSignal} [signal] */
  ratingForms: signal => request('GET', ['rating-forms'], { signal }).then(page => page.items),
  /**
   * `agreement`: whether a task's raters agree. `correlations`: which features correlate with their ratings.
   * @param {string} task @param {Schemas['RatingForm']} form @param {AbortSignal} [signal]
   */
  agreement: (task, form, signal) => request('GET', ['tasks', task, 'agreement'], { query: { form }, signal }),
  /** @param {string} task @param {Schemas['RatingForm']} form @param {AbortSignal} [signal] */
  correlations: (task, form, signal) => request('GET', ['tasks', task, 'correlations'], { query: { form }, signal }),
  jobs: { ...resource('jobs'), /** @param {string} id */ retry: id => request('POST', ['jobs', id, 'retry']) },
  trainees: {
    ...resource('trainees'),
    /**
     * @param {string} id @param {ApiQueryOf<'GET', ['trainees', string, 'progress']>} [query]
     * @param {AbortSignal} [signal]
     */
    progress: (id, query, signal) => request('GET', ['trainees', id, 'progress'], { query, signal }),
    /** The courses of the trainee's groups, latest first. @param {string} id @param {AbortSignal} [signal] */
    courses: (id, signal) => request('GET', ['trainees', id, 'courses'], { signal }).then(page => page.items),
    /** The records that were merged into this one. @param {string} id @param {AbortSignal} [signal] */
    merges: (id, signal) => request('GET', ['trainees', id, 'merges'], { signal }),
    /** What merging another record would do. @param {string} id @param {ApiBody<'POST', ['trainees', string, 'merges', 'preview']>} json */
    previewMerge: (id, json) => request('POST', ['trainees', id, 'merges', 'preview'], { json }),
    /** @param {string} id @param {ApiBody<'POST', ['trainees', string, 'merges']>} json */
    merge: (id, json) => request('POST', ['trainees', id, 'merges'], { json }),
    /** @param {string} id @param {string} merge @param {ApiBody<'POST', ['trainees', string, 'merges', string, 'separate']>} json */
    separate: (id, merge, json) => request('POST', ['trainees', id, 'merges', merge, 'separate'], { json }),
    /** What erasing the trainee deletes. @param {string} id @param {AbortSignal} [signal] */
    erasure: (id, signal) => request('GET', ['trainees', id, 'erasure'], { signal }),
    /** @param {string} id @param {boolean} canBeTakenBack */
    erase: (id, canBeTakenBack) => request('DELETE', ['trainees', id], { query: { can_be_taken_back: canBeTakenBack } }),
    /** The trainees who wait for their erasure. @param {AbortSignal} [signal] */
    pending: signal => request('GET', ['pending-erasures'], { signal }).then(page => page.items),
    /** Takes an erasure back. @param {string} id */
    restore: id => request('POST', ['trainees', id, 'restore']),
    /** Whether the trainee consents to recordings, with all decisions. @param {string} id @param {AbortSignal} [signal] */
    consent: (id, signal) => request('GET', ['trainees', id, 'consent'], { signal }),
    /** @param {string} id @param {ApiBody<'POST', ['trainees', string, 'consents']>} json */
    recordConsent: (id, json) => request('POST', ['trainees', id, 'consents'], { json }),
    /** How long the trainee's videos are kept. @param {string} id @param {AbortSignal} [signal] */
    retention: (id, signal) => request('GET', ['trainees', id, 'retention'], { signal }),
    /** What another time would delete at once. @param {string} id @param {ApiBody<'POST', ['trainees', string, 'retention', 'preview']>} json */
    previewRetention: (id, json) => request('POST', ['trainees', id, 'retention', 'preview'], { json }),
    /** @param {string} id @param {ApiBody<'PUT', ['trainees', string, 'retention']>} json */
    setRetention: (id, json) => request('PUT', ['trainees', id, 'retention'], { json }),
    /**
     * Who looked at the trainee's recordings.
     * @param {string} id @param {ApiQueryOf<'GET', ['trainees', string, 'access-entries']>} [query] @param {AbortSignal} [signal]
     */
    accessEntries: (id, query, signal) => request('GET', ['trainees', id, 'access-entries'], { query, signal }),
    /** @param {string} id @param {boolean} videos */
    dataAddress: (id, videos) => address(['trainees', id, 'data.zip'], { videos: String(videos) }),
  },
  exams: {
    /** @param {ApiQueryOf<'GET', ['exams']>} [query] @param {AbortSignal} [signal] */
    page: (query, signal) => request('GET', ['exams'], { query, signal }),
    /** @param {string} id @param {AbortSignal} [signal] */
    get: (id, signal) => request('GET', ['exams', id], { signal }),
    /** @param {ApiBody<'POST', ['exams']>} json */
    plan: json => request('POST', ['exams'], { json }),
    /** @param {string} id */
    cancel: id => request('POST', ['exams', id, 'cancel']),
    /** @param {string} id @param {ApiBody<'POST', ['exams', string, 'start']>} json */
    start: (id, json) => request('POST', ['exams', id, 'start'], { json }),
    /** Orders the recording of the next attempt. @param {string} id @param {ApiBody<'POST', ['exams', string, 'attempts']>} json */
    record: (id, json) => request('POST', ['exams', id, 'attempts'], { json }),
    /** @param {string} id @param {number} number @param {ApiBody<'PUT', ['exams', string, 'attempts', string, 'completion']>} json */
    setCompletion: (id, number, json) => request('PUT', ['exams', id, 'attempts', String(number), 'completion'], { json }),
    /** @param {string} id @param {number} number @param {ApiBody<'POST', ['exams', string, 'attempts', string, 'void']>} json */
    void: (id, number, json) => request('POST', ['exams', id, 'attempts', String(number), 'void'], { json }),
    /** @param {string} id @param {Schemas['ExamResult'] | null} [result] the one that the page shows */
    close: (id, result) => request('POST', ['exams', id, 'close'], { query: { expected_result: result } }),
    /** @param {string} id @param {ApiBody<'POST', ['exams', string, 'certificates']>} json */
    certify: (id, json) => request('POST', ['exams', id, 'certificates'], { json }),
  },
  certificates: {
    /** @param {ApiQueryOf<'GET', ['certificates']>} [query] @param {AbortSignal} [signal] */
    page: (query, signal) => request('GET', ['certificates'], { query, signal }),
    /** With what happened to it. @param {string} id @param {AbortSignal} [signal] */
    get: (id, signal) => request('GET', ['certificates', id], { signal }),
    /** @param {string} trainee @param {ApiBody<'POST', ['trainees', string, 'certificates']>} json */
    issue: (trainee, json) => request('POST', ['trainees', trainee, 'certificates'], { json }),
    /** @param {string} id @param {string} reason */
    keep: (id, reason) => request('POST', ['certificates', id, 'keep'], { json: { reason } }),
    /** @param {string} id @param {string} reason */
    withdraw: (id, reason) => request('POST', ['certificates', id, 'withdraw'], { json: { reason } }),
    /** @param {string} id @param {string} reason */
    reinstate: (id, reason) => request('POST', ['certificates', id, 'reinstate'], { json: { reason } }),
    /** @param {string} id */
    pdfAddress: id => address(['certificates', id, 'pdf']),
    /** What anyone may know of the certificate with this code. @param {string} code @param {AbortSignal} [signal] */
    check: (code, signal) => request('GET', ['certificate-checks', code], { signal }),
    /** @param {Blob} picture */
    checkFile: picture => request('POST', ['certificate-checks'], { picture }),
    /** The public keys, newest first. @param {AbortSignal} [signal] */
    keys: signal => request('GET', ['certificate-keys'], { signal }).then(page => page.items),
    replaceKey: () => request('POST', ['certificate-keys']),
    /** @param {string} id */
    keyAddress: id => address(['certificate-keys', id]),
  },
  consentTexts: {
    /** The published versions, newest first. @param {AbortSignal} [signal] */
    all: signal => request('GET', ['consent-texts'], { signal }).then(page => page.items),
    /** @param {ApiBody<'POST', ['consent-texts']>} json */
    publish: json => request('POST', ['consent-texts'], { json }),
    /** @param {string} id @param {ApiBody<'PATCH', ['consent-texts', string]>} json */
    change: (id, json) => request('PATCH', ['consent-texts', id], { json }),
    /** The trainees that requiring a version would touch; without `text`, one that is not published yet. @param {string} [text] */
    effect: text => request('GET', ['consent-texts', 'effect'], { query: { text } }),
  },
  boxes: {
    ...resource('boxes'),
    /** The records that were merged into this one. @param {string} id @param {AbortSignal} [signal] */
    merges: (id, signal) => request('GET', ['boxes', id, 'merges'], { signal }),
    /** What merging another record would do. @param {string} id @param {ApiBody<'POST', ['boxes', string, 'merges', 'preview']>} json */
    previewMerge: (id, json) => request('POST', ['boxes', id, 'merges', 'preview'], { json }),
    /** @param {string} id @param {ApiBody<'POST', ['boxes', string, 'merges']>} json */
    merge: (id, json) => request('POST', ['boxes', id, 'merges'], { json }),
    /** @param {string} id @param {string} merge @param {ApiBody<'POST', ['boxes', string, 'merges', string, 'separate']>} json */
    separate: (id, merge, json) => request('POST', ['boxes', id, 'merges', merge, 'separate'], { json }),
    /** The agents of all boxes that ever had one. @param {AbortSignal} [signal] */
    agents: signal => request('GET', ['agents'], { signal }),
    /** @param {string} id @param {AbortSignal} [signal] */
    agent: (id, signal) => request('GET', ['boxes', id, 'agent'], { signal }),
    /** @param {string} id @param {ApiBody<'POST', ['boxes', string, 'agent', 'start']>} json */
    start: (id, json) => request('POST', ['boxes', id, 'agent', 'start'], { json }),
    /** @param {string} id */
    stop: id => request('POST', ['boxes', id, 'agent', 'stop']),
    /** @param {string} id @param {ApiBody<'PUT', ['boxes', string, 'check-in']>} json */
    checkIn: (id, json) => request('PUT', ['boxes', id, 'check-in'], { json }),
    /** @param {string} id */
    checkOut: id => request('DELETE', ['boxes', id, 'check-in']),
    /** @param {string} id */
    camera: id => request('GET', ['boxes', id, 'camera']),
    /**
     * `from`: since when it is valid, if not from now on.
     * @param {string} id @param {ApiBody<'PUT', ['boxes', string, 'camera']>} json @param {string} [from]
     */
    putCamera: (id, json, from) => request('PUT', ['boxes', id, 'camera'], { json, query: { valid_from: from } }),
    /** @param {string} id */
    calibrations: id => fetchAll(['boxes', id, 'calibrations']),
    /** @param {string} id @param {FormData} form */
    calibrate: (id, form) => request('POST', ['boxes', id, 'calibrations'], { form }),
    /**
     * Sets since when a version is valid; the answer has all versions.
     * @param {string} id @param {string} version @param {ApiBody<'PATCH', ['boxes', string, 'calibrations', string]>} json
     */
    dateCalibration: (id, version, json) => request('PATCH', ['boxes', id, 'calibrations', version], { json }),
    /** Checks one photo of the board immediately. @param {string} id @param {FormData} form */
    checkPhoto: (id, form) => request('POST', ['boxes', id, 'calibrations', 'check'], { form }),
    /** The versions of the palette, newest first. @param {string} id */
    palettes: id => fetchAll(['boxes', id, 'palettes']),
    /**
     * The same for a version of the palette.
     * @param {string} id @param {string} version @param {ApiBody<'PATCH', ['boxes', string, 'palettes', string]>} json
     */
    datePalette: (id, version, json) => request('PATCH', ['boxes', id, 'palettes', version], { json }),
    /** @param {string} id @param {FormData} form */
    learnPalette: (id, form) => request('POST', ['boxes', id, 'palettes'], { form }),
    /**
     * Shows what the marks would classify as tape on a few frames, immediately; nothing is learned.
     * @param {string} id @param {FormData} form @param {AbortSignal} [signal]
     */
    previewPalette: (id, form, signal) => request('POST', ['boxes', id, 'palettes', 'preview'], { form, signal }),
    /**
     * Asks which tapes suit the box in a picture: starts a job, which holds the advice when it is done.
     * @param {string} id @param {FormData} form
     */
    advise: (id, form) => request('POST', ['boxes', id, 'palettes', 'advice'], { form }),
    /** The latest 100, newest first. @param {string} id */
    selfTests: id => fetchAll(['boxes', id, 'self-tests'], {}, 100),
    /** @param {string} id @param {ApiBody<'PUT', ['boxes', string, 'tool-sizes']>} json */
    resizeTools: (id, json) => request('PUT', ['boxes', id, 'tool-sizes'], { json }),
    /** @param {string} id @param {FormData} form */
    selfTest: (id, form) => request('POST', ['boxes', id, 'self-tests'], { form }),
    /**
     * The address that takes frames while they are recorded; record/feed.js implements the protocol.
     * @param {string} id
     */
    feedAddress: id => socketAddress(['boxes', id, 'feed']),
  },
  sessions: {
    ...resource('sessions'),
    /** @param {ApiQueryOf<'GET', ['session-count']>} query @param {AbortSignal} [signal] */
    count: (query, signal) => request('GET', ['session-count'], { query, signal }),
    /** @param {string} id @param {ApiBody<'PUT', ['sessions', string, 'supervision']>} json */
    supervise: (id, json) => request('PUT', ['sessions', id, 'supervision'], { json }),
    /** @param {ApiQueryOf<'POST', ['sessions', 'import']>} query @param {string} table */
    importTable: (query, table) => request('POST', ['sessions', 'import'], { query, table }),
    /** @param {string} id */
    retry: id => request('POST', ['sessions', id, 'retry']),
    /** @param {string} id */
    end: id => request('POST', ['sessions', id, 'end']),
    /**
     * @param {string} id @param {ApiQueryOf<'GET', ['sessions', string, 'trajectory']>} [query]
     * @param {AbortSignal} [signal]
     */
    trajectory: (id, query, signal) =>
      request('GET', ['sessions', id, 'trajectory'], { query: { format: 'json', ...query }, signal }),
    /**
     * @param {string} id @param {ApiQueryOf<'GET', ['sessions', string, 'diagnostics']>} [query]
     * @param {AbortSignal} [signal]
     */
    diagnostics: (id, query, signal) => request('GET', ['sessions', id, 'diagnostics'], { query, signal }),
    /** The session's edits: trims, swapped tool names, set aside. @param {string} id @param {AbortSignal} [signal] */
    edits: (id, signal) => request('GET', ['sessions', id, 'edits'], { signal }),
    /** @param {string} id @param {ApiBody<'POST', ['sessions', string, 'edits']>} json */
    edit: (id, json) => request('POST', ['sessions', id, 'edits'], { json }),
    /** @param {string} id @param {string} edit */
    undo: (id, edit) => request('POST', ['sessions', id, 'edits', edit, 'undo']),
    /** The session's moves to another trainee, task or box. @param {string} id @param {AbortSignal} [signal] */
    moves: (id, signal) => request('GET', ['sessions', id, 'moves'], { signal }),
    /** The cuts that the session is a part of. @param {string} id @param {AbortSignal} [signal] */
    cuts: (id, signal) => request('GET', ['sessions', id, 'cuts'], { signal }),
    /** @param {string} id @param {ApiBody<'POST', ['sessions', string, 'cuts']>} json */
    cut: (id, json) => request('POST', ['sessions', id, 'cuts'], { json }),
    /** @param {string} id @param {string} cut */
    join: (id, cut) => request('POST', ['sessions', id, 'cuts', cut, 'undo']),
    /** @param {string} id @param {ApiBody<'POST', ['sessions', string, 'moves']>} json */
    move: (id, json) => request('POST', ['sessions', id, 'moves'], { json }),
    /**
     * `evidence`: which stretches of the recording produced the features. `advice`: what to work on next.
     * @param {string} id @param {AbortSignal} [signal]
     */
    evidence: (id, signal) => request('GET', ['sessions', id, 'evidence'], { signal }),
    /** @param {string} id @param {AbortSignal} [signal] */
    advice: (id, signal) => request('GET', ['sessions', id, 'advice'], { signal }),
    /** @param {string} id @param {AbortSignal} [signal] */
    comments: (id, signal) => request('GET', ['sessions', id, 'comments'], { signal }),
    /** @param {string} id @param {ApiBody<'POST', ['sessions', string, 'comments']>} json */
    comment: (id, json) => request('POST', ['sessions', id, 'comments'], { json }),
    /** @param {string} id @param {string} comment */
    withdraw: (id, comment) => request('DELETE', ['sessions', id, 'comments', comment]),
    /** Says that the calling trainee opens the session now. @param {string} id */
    open: id => request('PUT', ['sessions', id, 'opening']),
    /** @param {string} id @param {AbortSignal} [signal] */
    ratings: (id, signal) => request('GET', ['sessions', id, 'ratings'], { signal }),
    /** @param {string} id @param {ApiBody<'POST', ['sessions', string, 'ratings']>} json */
    rate: (id, json) => request('POST', ['sessions', id, 'ratings'], { json }),
    /** The error sheets of a session, and the score that they give. @param {string} id @param {AbortSignal} [signal] */
    errorSheets: (id, signal) => request('GET', ['sessions', id, 'error-sheets'], { signal }),
    /** Begins the own sheet, or a correction of it. @param {string} id */
    beginErrorSheet: id => request('POST', ['sessions', id, 'error-sheets']),
    /** @param {string} id @param {ApiBody<'PUT', ['sessions', string, 'error-sheet']>} json */
    setErrorValues: (id, json) => request('PUT', ['sessions', id, 'error-sheet'], { json }),
    /** @param {string} id */
    finishErrorSheet: id => request('POST', ['sessions', id, 'error-sheet', 'finish']),
    /** @param {string} id */
    discardErrorSheet: id => request('DELETE', ['sessions', id, 'error-sheet']),
    /** @param {string} id @param {ApiBody<'POST', ['sessions', string, 'error-marks']>} json */
    markError: (id, json) => request('POST', ['sessions', id, 'error-marks'], { json }),
    /** @param {string} id @param {string} mark */
    unmarkError: (id, mark) => request('DELETE', ['sessions', id, 'error-marks', mark]),
    /** Opens the live stream of a session that is arriving. @param {string} id @param {ApiQuery} [query] */
    watch: (id, query) => new WebSocket(socketAddress(['sessions', id, 'live'], query)),
    /** @param {string} id */
    videoAddress: id => address(['sessions', id, 'video']),
    /** @param {string} id @param {string} format */
    featuresAddress: (id, format) => address(['sessions', id, 'features'], { format }),
    /** @param {string} id @param {string} format */
    trajectoryAddress: (id, format) => address(['sessions', id, 'trajectory'], { format, kind: 'smoothed' }),
  },
  /** Recordings that wait for a name. */
  waiting: {
    /** @param {ApiQueryOf<'GET', ['waiting-recordings']>} [query] @param {AbortSignal} [signal] */
    page: (query, signal) => request('GET', ['waiting-recordings'], { query, signal }),
    /** @param {AbortSignal} [signal] */
    count: signal => request('GET', ['waiting-recording-count'], { signal }),
    /** @param {Schemas['RecordingAssignment'][]} items */
    assign: items => request('POST', ['waiting-recordings', 'assign'], { json: { items } }),
    /** @param {string} id */
    discard: id => request('DELETE', ['waiting-recordings', id]),
    /** @param {string} id */
    videoAddress: id => address(['waiting-recordings', id, 'video']),
    /** @param {string} id */
    pictureAddress: id => address(['waiting-recordings', id, 'preview.jpg']),
  },
  /** tus 1.0.0; tus-js-client implements the protocol. */
  uploadsAddress: () => address(['uploads']),
  events: () => new EventSource(address(['events'])),
};
