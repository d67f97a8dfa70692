// The state of a session or job: a word with a colour, and a bar while it is running.
import { html } from '../../preact.js';
import { t } from '../../texts.js';
import { percent } from '../../format.js';

const TONES = {
  receiving: 'busy',
  interrupted: 'warn',
  queued: '',
  tracking: 'busy',
  running: 'busy',
  done: 'good',
  failed: 'bad',
  quarantined: 'warn',
  refused: 'bad',
  box_asked: 'warn',
  other_box: 'bad',
};

/**
 * One word for a session's state. A recording without a sender is `receiving` in the API. A quarantined session is `failed` in the API; one that the quality gate refused, or that
 * may show another box, is `done` in the API.
 *
 * @param {Pick<Schemas['SessionResponse'], 'status' | 'quarantined' | 'quality'> & Partial<Pick<Schemas['SessionResponse'], 'box_question' | 'interruption'>>} session
 */
export function stateOf({ status, interruption, quarantined, quality, box_question: question }) {
  if (status === 'receiving' && interruption) return 'interrupted';
  if (quarantined) return 'quarantined';
  if (status === 'done' && question === 'asked') return 'box_asked';
  if (status === 'done' && question === 'other_box') return 'other_box';
  return status === 'done' && quality?.verdict === 'refused' ? 'refused' : status;
}

export const StatusPill = ({ state }) =>
  html`<span class=${`pill ${TONES[state] ?? ''}`}>${t.status[state] ?? t.jobStates[state] ?? state}</span>`;

export const ProgressBar = ({ value, name }) => html`
  <progress class="bar" max="1" value=${value ?? 0} aria-label=${name}
    aria-valuetext=${percent(value ?? 0)}></progress>`;

export const isMoving = session => ['receiving', 'queued', 'tracking'].includes(session.status);
