// Server-sent events with two safety nets: reconnecting by ourselves when the browser gives up, and asking again at
// intervals for as long as the line is down. Pages reload on `resync`, since events may have been missed meanwhile.
import { useEffect, useRef, useState } from './parts/preact.js';
import { api } from './api.js';

const NAMES = ['session', 'job', 'queue'];
const POLL_MS = 5_000;
const RETRY_MS = { first: 1_000, most: 30_000 };

const hub = new EventTarget();
let source = null;
let state = 'closed';
let pollTimer = null;
let retryTimer = null;
let retryMs = RETRY_MS.first;

const emit = (name, detail) => hub.dispatchEvent(new CustomEvent(name, { detail }));

function become(next) {
  if (state === next) return;
  state = next;
  emit('state', next);
}

export function startLive() {
  stopLive();
  become('connecting');
  connect();
}

export function stopLive() {
  source?.close();
  source = null;
  clearInterval(pollTimer);
  clearTimeout(retryTimer);
  pollTimer = retryTimer = null;
  become('closed');
}

function opened() {
  const missed = pollTimer !== null;
  clearInterval(pollTimer);
  pollTimer = null;
  retryMs = RETRY_MS.first;
  become('open');
  if (missed) emit('resync');
}

function broke() {
  become('polling');
  pollTimer ??= setInterval(() => emit('resync'), POLL_MS);
  if (source.readyState !== EventSource.CLOSED) return; // The browser is already trying again.
  clearTimeout(retryTimer);
  retryTimer = setTimeout(connect, retryMs);
  retryMs = Math.min(retryMs * 2, RETRY_MS.most);
}

function connect() {
  source?.close();
  source = api.events();
  source.onopen = opened;
  source.onerror = broke;
  for (const name of NAMES) source.addEventListener(name, event => emit(name, JSON.parse(event.data)));
  source.addEventListener('missed', () => emit('resync')); // We were too slow, and the service dropped some.
}

/** Runs `handler(detail)` for every event of that name while the component is on the page. */
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
