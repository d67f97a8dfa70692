// Server-sent events, which report changes of sessions, jobs and the queue to all pages; watch.js has the live view of
// one session. Two safety nets: reconnecting when the browser gives up, and polling while the connection is down. Pages
// reload on `resync`, since events may have been missed.
import { useEffect, useRef, useState } from './preact.js';
import { api } from './api.js';

const EVENT_NAMES = ['session', 'job', 'queue'];
const POLL_MS = 5_000;
const RETRY_MS = { first: 1_000, max: 30_000 };

const hub = new EventTarget();
let source = null;
let state = 'closed';
let pollTimer = null;
let retryTimer = null;
let retryMs = RETRY_MS.first;

const emit = (name, detail) => hub.dispatchEvent(new CustomEvent(name, { detail }));

function changeState(next) {
  if (state === next) return;
  state = next;
  emit('state', next);
}

export function startLive() {
  stopLive();
  changeState('connecting');
  connect();
}

export function stopLive() {
  source?.close();
  source = null;
  clearInterval(pollTimer);
  clearTimeout(retryTimer);
  pollTimer = retryTimer = null;
  changeState('closed');
}

function handleOpen() {
  const missed = pollTimer !== null;
  clearInterval(pollTimer);
  pollTimer = null;
  retryMs = RETRY_MS.first;
  changeState('open');
  if (missed) emit('resync');
}

function handleError() {
  changeState('polling');
  pollTimer ??= setInterval(() => emit('resync'), POLL_MS);
  if (source.readyState !== EventSource.CLOSED) return; // The browser is already reconnecting.
  clearTimeout(retryTimer);
  retryTimer = setTimeout(connect, retryMs);
  retryMs = Math.min(retryMs * 2, RETRY_MS.max);
}

function connect() {
  source?.close();
  source = api.events();
  source.onopen = handleOpen;
  source.onerror = handleError;
  for (const name of EVENT_NAMES) source.addEventListener(name, event => emit(name, JSON.parse(event.data)));
  source.addEventListener('missed', () => emit('resync')); // This page was too slow, and the service dropped events.
}

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

/** `'connecting' | 'open' | 'polling' | 'closed'`, kept up to date. */
export function useLiveState() {
  const [now, setNow] = useState(state);
  useLive('state', setNow);
  return now;
}
