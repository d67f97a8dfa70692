// What a course step requires, its due date, and its state: in words, never by colour alone.
import { html } from '../../preact.js';
import { calendarDay, date } from '../../format.js';
import { t } from '../../texts.js';

const words = t.courses;
const TONES = { passed: 'good', in_work: 'busy', not_begun: '' };

export const requirementText = ({ sessions }) => (sessions === null ? words.standard : words.sessionsOf(sessions));

export const dueText = ({ due }) => (due === null ? words.anyTime : words.until(calendarDay(due)));

/** What to add to the state: since when, or how far. */
function detailOf({ sessions: required }, { state, sessions, missing, passed, rule, standing }) {
  if (passed) return date(passed.at);
  if (state === 'not_begun') return '';
  if (required !== null) return words.soFar(sessions, required);
  if (standing === 'relapsed') return t.groups.standing.relapsed;
  if (rule?.state === 'out_of_reach') return t.groups.outOfReach;
  return missing === null ? words.sessionsOf(sessions) : words.passesMissing(missing);
}

/** The same as {@link StepState}, as text. */
export const stepText = (step, progress) =>
  [words.state[progress.state], progress.overdue && words.overdue, detailOf(step, progress)].filter(Boolean).join(', ');

/** The spaces between the parts are for screen readers. */
export const StepState = ({ step, progress }) => html`
  <span class="step-state">
    <span class=${`pill ${TONES[progress.state]}`}>${words.state[progress.state]}</span>${' '}
    ${progress.overdue && html`<span class="pill bad">${words.overdue}</span>${' '}`}
    <span class="small muted">${detailOf(step, progress)}</span>
  </span>`;
