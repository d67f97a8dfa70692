// Feedback that is new to a trainee: comments and ratings on own sessions, until the session is opened. One request
// serves the navigation and the page.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useThrottled } from '../../data.js';
import { useLive } from '../../live.js';
import { t } from '../../texts.js';

const RELOAD_MS = 2_000;

/** @typedef {Schemas['FeedbackResponse']} NewFeedback */

/** @type {NewFeedback | null} */
let known = null;
/** @type {string | null} */
let knownFor = null;
/** @type {Promise<void> | null} */
let loading = null;
const listeners = new Set();

/** @param {NewFeedback | null} feedback */
function set(feedback) {
  known = feedback;
  listeners.forEach(listener => listener());
}

/** Loads it again; a failure keeps what is known, since the page works without it. */
export function reloadFeedback() {
  loading ??= api.feedback().then(set, () => {}).finally(() => (loading = null));
  return loading;
}

/** Marks everything that the page has shown as seen. @param {NewFeedback} shown */
export const markSeen = shown => api.feedbackSeen(shown.items[0].latest_at).then(set);

/** A trainee's new feedback; `null` while it is not known, and for other people. @param {Schemas['Me']} person */
export function useNewFeedback(person) {
  const [, render] = useState(0);
  const isTrainee = person.role === 'trainee';
  useEffect(() => {
    if (!isTrainee) return undefined;
    if (knownFor !== person.id) set(null);
    knownFor = person.id ?? null;
    const listener = () => render(count => count + 1);
    listeners.add(listener);
    reloadFeedback();
    return () => void listeners.delete(listener);
  }, [person.id, isTrainee]);
  const reloadSoon = useThrottled(() => isTrainee && reloadFeedback(), RELOAD_MS);
  useLive('session', event => event.status === 'done' && reloadSoon());
  useLive('resync', reloadSoon);
  return isTrainee && knownFor === person.id ? known : null;
}

/** Reports to the service that the trainee opens this session: its feedback is no longer new. @param {Schemas['Me']} person */
export function useOpening(id, person) {
  useEffect(() => {
    if (person.role === 'trainee') api.sessions.open(id).then(reloadFeedback, () => {});
  }, [id, person.id]);
}

/** The number of sessions with new feedback, beside a name in the navigation. @param {Props} props */
export function FeedbackMark({ person }) {
  const sessions = useNewFeedback(person)?.sessions ?? 0;
  return sessions > 0 && html` <span class="count" title=${t.feedback.mark(sessions)}><span aria-hidden="true">${sessions}</span><span
    class="unseen">${t.feedback.mark(sessions)}</span></span>`;
}
