// The state of a session or job: a word with a colour, and a bar while it is running.
import { html } from '../../preact.js';
import { t } from '../../texts.js';
import { percent } from '../../format.js';
import { featureWithTool, findingText, problemTitle } from '../../translate.js';

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
  passed: 'good',
  missed: 'bad',
  undecided: 'warn',
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

const JUDGED = { pass: 'passed', fail: 'missed', unknown: 'undecided' };

/**
 * One word for a session's outcome, the same in every list: its state until it is done, then whether it met the standard
 * of its task, if there is one.
 *
 * @param {Schemas['SessionResponse']} session
 */
export function outcomeOf(session) {
  const state = stateOf(session);
  return (state === 'done' && JUDGED[session.judgement ?? '']) || state;
}

/** Why a session failed, was refused or missed the standard, in a few words; '' for every other. @param {Schemas['SessionResponse']} session */
export function outcomeReason(session) {
  const outcome = outcomeOf(session);
  if (outcome === 'failed' || outcome === 'quarantined') return session.error ? problemTitle(session.error) : '';
  if (outcome === 'refused') {
    const reasons = session.quality?.reasons ?? [];
    const first = reasons.find(one => one.severity === 'refuse') ?? reasons[0];
    return first ? findingText(first) : '';
  }
  if (outcome === 'missed') return session.features.filter(one => one.judgement === 'fail').map(featureWithTool).join(' · ');
  return '';
}

/** The outcome with its reason. @param {Props} props */
export function Outcome({ session }) {
  const reason = outcomeReason(session);
  const withCare = stateOf(session) === 'done' && session.quality?.verdict === 'usable_with_care';
  return html`<span class="outcome"><${StatusPill} state=${outcomeOf(session)} />${
    withCare && html` <span class="small muted">${t.outcome.withCare}</span>`}${
    session.set_aside && html` <span class="small muted">${t.sessions.aside}</span>`}${
    session.voided && html` <span class="small muted">${t.sessions.voided}</span>`}${
    reason && html`<span class="small muted why">${reason}</span>`}</span>`;
}

export const StatusPill = ({ state }) =>
  html`<span class=${`pill ${TONES[state] ?? ''}`}>${t.status[state] ?? t.jobStates[state] ?? state}</span>`;

export const ProgressBar = ({ value, name }) => html`
  <progress class="bar" max="1" value=${value ?? 0} aria-label=${name}
    aria-valuetext=${percent(value ?? 0)}></progress>`;

export const isMoving = session => ['receiving', 'queued', 'tracking'].includes(session.status);
