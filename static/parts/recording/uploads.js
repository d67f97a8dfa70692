// The uploads of this browser, outside any page: they continue while people look at other pages. Unfinished ones are
// stored for the person who sends them, without names of people, so that after a reload the page can ask for the right
// file. tus-js-client implements the protocol.
import { Upload } from '../../vendor/tus-js-client/tus.module.js';
import { api, Problem } from '../../api.js';
import { setSending } from '../../shared_device.js';

const PREFIX = 'trocar.uploads.';
/** The service deletes an unfinished upload after this time, ms; the list of a browser forgets it, too. */
const KEPT_MS = 48 * 3_600_000;
const MAX_PARALLEL = 2;
/** After a broken connection, at most one chunk is sent again. */
const CHUNK_BYTES = 8 * 1024 * 1024;
const RETRY_MS = [0, 1_000, 3_000, 5_000, 10_000, 20_000, 30_000];
/** Answers that do not change on a retry. 409 and 423 (another request holds the upload) and 429 do. */
const isFinal = status => status >= 400 && status < 500 && ![409, 423, 429].includes(status);

const watchers = new Set();
const running = new Map();
/** Whose uploads these are: the id of the signed-in person. */
let owner = null;
let items = [];

/** Entries: `{ key, name, size, modified, target, url, sent, state, problem, session, rate }`. */
export const uploads = () => items;

/** Shows the uploads of this person. Those of the person before stop, and the next person does not see them. */
export function setUploader(person) {
  if (owner === person) return;
  for (const { upload } of running.values()) upload?.abort();
  running.clear();
  owner = person;
  forgetOld();
  items = owner === null ? [] : restore();
  setSending(false);
  watchers.forEach(callback => callback());
}

/** Forgets the uploads of this person: at signing out, since others may use this computer, too. */
export function forgetUploads(person) {
  setUploader(null);
  removeStored(PREFIX + person);
}

export function onUploads(callback) {
  watchers.add(callback);
  return () => watchers.delete(callback);
}

/** Queues files for one trainee, task and box; a file that was interrupted continues where it stopped. */
export function addFiles(files, target) {
  for (const file of files) {
    const interrupted = items.find(
      item =>
        item.state === 'lost' &&
        isSame(item, file) &&
        item.target.trainee === target.trainee &&
        item.target.task === target.task &&
        item.target.box === target.box,
    );
    if (interrupted) resumeWith(interrupted.key, file);
    else add(file, target);
  }
}

function add(file, target) {
  const key = crypto.randomUUID?.() ?? `${Date.now()}-${Math.random()}`; // randomUUID is missing on plain http.
  const recorded_at = target.recorded_at || new Date(file.lastModified).toISOString();
  const item = {
    key,
    name: file.name,
    size: file.size,
    modified: file.lastModified,
    target: { ...target, recorded_at },
    sent: 0,
    state: 'waiting',
  };
  items = [item, ...items];
  running.set(key, { file });
  changed();
  next();
}

const isSame = (item, file) =>
  item.name === file.name && item.size === file.size && item.modified === file.lastModified;

/** After a reload, the person has chosen the file again. Returns false if it is another file. */
export function resumeWith(key, file) {
  const item = find(key);
  if (!item || item.name !== file.name || item.size !== file.size) return false;
  running.set(key, { file });
  change(key, { state: 'waiting', problem: null });
  next();
  return true;
}

export function pause(key) {
  running.get(key)?.upload?.abort();
  change(key, { state: 'paused' });
  next();
}

export function resume(key) {
  change(key, { state: running.has(key) ? 'waiting' : 'lost', problem: null });
  next();
}

/** Ends an upload for good: the service deletes the bytes, too. */
export function cancel(key) {
  const item = find(key);
  running.get(key)?.upload?.abort();
  // Without this request, it expires there by itself.
  if (item?.url && item.state !== 'done') Upload.terminate(item.url).catch(() => {});
  forget(key);
}

export function forget(key) {
  running.delete(key);
  items = items.filter(item => item.key !== key);
  changed();
  next();
}

const find = key => items.find(item => item.key === key);

function change(key, more) {
  items = items.map(item => (item.key === key ? { ...item, ...more } : item));
  changed();
}

function changed() {
  save();
  setSending(items.some(({ state }) => state === 'sending' || state === 'waiting'));
  watchers.forEach(callback => callback());
}

function next() {
  const busy = items.filter(item => item.state === 'sending').length;
  // Oldest first; the list shows the newest on top.
  const waiting = items.filter(item => item.state === 'waiting').reverse();
  waiting.slice(0, Math.max(0, MAX_PARALLEL - busy)).forEach(send);
}

function send(item) {
  const { key, name, target } = item;
  const handle = running.get(key);
  /** @type {{ at: number, sent: any }} */
  const started = { at: performance.now(), sent: null };
  const upload = new Upload(handle.file, {
    endpoint: api.uploadsAddress(),
    uploadUrl: item.url,
    chunkSize: CHUNK_BYTES,
    retryDelays: RETRY_MS,
    storeFingerprintForResuming: false, // The list above stores the address itself, with the texts for people.
    metadata: { filename: name, filetype: handle.file.type, ...target },
    onUploadUrlAvailable: () => change(key, { url: upload.url }),
    onProgress: sent => {
      started.sent ??= sent;
      waitForProgress(key, handle);
      const seconds = (performance.now() - started.at) / 1000;
      change(key, { sent, rate: seconds > 1 ? (sent - started.sent) / seconds : 0 });
    },
    onAfterResponse: (_, answer) => {
      const session = answer.getHeader('Trocar-Session');
      if (session) change(key, { session, duplicate: answer.getHeader('Trocar-Duplicate') === 'true' });
    },
    onShouldRetry: error => stall(key) && !isFinal(error.originalResponse?.getStatus() ?? 0),
    onSuccess: () => finish(key, { state: 'done', sent: item.size }),
    onError: error =>
      finish(key, {
        state: 'failed',
        problem: problemOf(error),
        ...(isGone(error) ? { url: undefined, sent: 0 } : {}),
      }),
  });
  handle.upload = upload;
  change(key, { state: 'sending', problem: null });
  upload.start();
}

/** Without progress for this time, ms, the time left is not known: the network is gone or very slow. */
const STALLED_MS = 3_000;

function waitForProgress(key, handle) {
  clearTimeout(handle.stalled);
  handle.stalled = setTimeout(() => stall(key), STALLED_MS);
  if (find(key)?.isStalled) change(key, { isStalled: false });
}

function stall(key) {
  if (find(key)?.state === 'sending') change(key, { isStalled: true, rate: 0 });
  return true;
}

addEventListener('offline', () => items.filter(({ state }) => state === 'sending').forEach(({ key }) => stall(key)));

function finish(key, more) {
  clearTimeout(running.get(key)?.stalled);
  change(key, more);
  next();
}

/** An upload that the service no longer knows starts from the beginning when it is retried. */
const isGone = error => [404, 410].includes(error.originalResponse?.getStatus());

function problemOf(error) {
  const answer = error.originalResponse;
  return answer ? Problem.fromText(answer.getStatus(), answer.getBody()) : Problem.offline();
}

function save() {
  const kept = items
    .filter(item => item.state !== 'done' && (item.url || item.state !== 'failed'))
    .map(({ problem, rate, isStalled, ...item }) => item);
  try {
    localStorage.setItem(PREFIX + owner, JSON.stringify({ at: Date.now(), kept }));
  } catch {
    // Storage is refused or full: uploads run, but are not remembered after a reload.
  }
}

/** Uploads that were not finished when the page was closed: the file is gone with the page, the bytes sent are not. */
function restore() {
  try {
    const { kept = [] } = JSON.parse(localStorage.getItem(PREFIX + owner) ?? '{}');
    return kept.map(item => ({ ...item, state: 'lost' }));
  } catch {
    return [];
  }
}

/** Removes the lists that are too old to be continued, and the one list of all people that earlier versions kept. */
function forgetOld() {
  removeStored('trocar.uploads');
  for (const key of storedKeys()) if (key.startsWith(PREFIX) && !(storedAt(key) > Date.now() - KEPT_MS)) removeStored(key);
}

function storedKeys() {
  try {
    return Object.keys(localStorage);
  } catch {
    return []; // Storage is refused.
  }
}

function storedAt(key) {
  try {
    return JSON.parse(localStorage.getItem(key) ?? '{}').at;
  } catch {
    return 0;
  }
}

function removeStored(key) {
  try {
    localStorage.removeItem(key);
  } catch {
    // Storage is refused: nothing is stored.
  }
}
