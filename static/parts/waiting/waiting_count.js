// How many recordings wait for a name, in the navigation of staff. One request serves all who ask.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useThrottled } from '../../data.js';
import { useLive } from '../../live.js';
import { may } from '../../roles.js';
import { t } from '../../texts.js';

/** Recordings arrive without an event. */
const RELOAD_MS = 60_000;

/** @type {Schemas['WaitingRecordingCount'] | null} */
let known = null;
/** @type {string | null} */
let knownFor = null;
/** @type {Promise<void> | null} */
let loading = null;
const listeners = new Set();

/** @param {Schemas['WaitingRecordingCount'] | null} count */
function set(count) {
  known = count;
  listeners.forEach(listener => listener());
}

/** Loads it again; a failure keeps what is known, since the page works without it. */
export function reloadWaitingCount() {
  loading ??= api.waiting.count().then(set, () => {}).finally(() => (loading = null));
  return loading;
}

/** The count for staff; 0 while it is not known, and for other people. @param {Schemas['Me']} person */
export function useWaitingCount(person) {
  const [, render] = useState(0);
  const isStaff = may(person, 'see_trainees');
  useEffect(() => {
    if (!isStaff) return undefined;
    if (knownFor !== person.id) set(null);
    knownFor = person.id ?? null;
    const listener = () => render(count => count + 1);
    listeners.add(listener);
    reloadWaitingCount();
    const timer = setInterval(reloadWaitingCount, RELOAD_MS);
    return () => {
      listeners.delete(listener);
      clearInterval(timer);
    };
  }, [person.id, isStaff]);
  const reloadSoon = useThrottled(() => isStaff && reloadWaitingCount(), RELOAD_MS);
  useLive('resync', reloadSoon);
  return isStaff && knownFor === person.id ? (known?.count ?? 0) : 0;
}

/** The number beside the name in the navigation. @param {Props} props */
export const WaitingMark = ({ count }) => html` <span class="count" title=${t.waiting.mark(count)}><span
  aria-hidden="true">${count}</span><span class="unseen">${t.waiting.mark(count)}</span></span>`;
