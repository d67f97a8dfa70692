// Changes of sessions, jobs and the queue, reported to all pages as they happen; watch.js has the live view of one
// session. While the connection is down, pages poll. Pages reload on `resync`, since events may have been missed. A
// hidden tab, or one in the back/forward cache, takes no part: it reloads when it is shown again.
import { useEffect, useRef, useState } from './preact.js';
import { EventStream } from './event_stream.js';

const POLL_MS = 5_000;

const hub = new EventTarget();
/** @type {EventStream | null} */
let stream = null;
/** The id of the signed-in person, whose events are wanted; null before a sign-in. */
let wanted = null;
let state = 'closed';
let pollTimer = null;
let hasMissed = false;
/** The newest counts of the queue: a stream sends them when it begins, maybe before a page asks for them. */
let queueCounts = null;

function emit(name, detail = null) {
  if (name === 'queue') queueCounts = detail;
  hub.dispatchEvent(new CustomEvent(name, { detail }));
}

function changeState(next) {
  if (state === next) return;
  state = next;
  emit('state', next);
}

/** Starts for this person, and for as long as the page is shown. */
export function startLive(person) {
  stopLive();
  wanted = person;
  hasMissed = false;
  follow();
}

export function stopLive() {
  wanted = null;
  unfollow();
}

function follow() {
  if (wanted === null || stream || document.hidden) return;
  changeState('connecting');
  stream = new EventStream(wanted, { onEvent: emit, onState: handleState });
  stream.join();
}

function unfollow() {
  stream?.leave();
  stream = null;
  queueCounts = null;
  clearInterval(pollTimer);
  pollTimer = null;
  changeState('closed');
}

function handleState(next) {
  if (next === 'open') {
    clearInterval(pollTimer);
    pollTimer = null;
    changeState('open');
    if (hasMissed) emit('resync');
    hasMissed = true; // A later opening follows a gap.
    return;
  }
  if (next !== 'broken') return;
  hasMissed = true;
  changeState('polling');
  pollTimer ??= setInterval(() => emit('resync'), POLL_MS);
}

/** A page that was hidden, or left and shown again, has missed events. */
function handleVisibility() {
  if (document.hidden) return unfollow();
  if (wanted === null || stream) return;
  hasMissed = true;
  follow();
}

document.addEventListener('visibilitychange', handleVisibility);
addEventListener('pagehide', unfollow);
addEventListener('pageshow', handleVisibility);

/**
 * Runs `handler(detail)` for every event of that name while the component is mounted.
 *
 * @template {keyof LiveEvents} N
 * @param {N} name
 * @param {(detail: LiveEvents[N]) => unknown} handler
 */
export function useLive(name, handler) {
  const latest = useRef(handler);
  latest.current = handler;
  useEffect(() => {
    const listen = event => latest.current(event.detail);
    hub.addEventListener(name, listen);
    return () => hub.removeEventListener(name, listen);
  }, [name]);
}

/**
 * A value of this module and its changes. It may change between the first render and the subscription to its changes,
 * so it is read once more after that.
 *
 * @template V
 * @param {'state' | 'queue'} name
 * @param {() => V} read
 */
function useKept(name, read) {
  const [value, setValue] = useState(read);
  useLive(name, () => setValue(read));
  useEffect(() => setValue(read), [name]);
  return value;
}

/** `'connecting' | 'open' | 'polling' | 'closed'`, kept up to date. */
export const useLiveState = () => useKept('state', () => state);

/** The service's own counts of the queue, kept up to date; null while none has arrived. */
export const useQueueCounts = () => useKept('queue', () => queueCounts);
