// What a step of a course asks for, by when, and how it stands: in words, never by colour alone.
import { html } from './preact.js';
import { calendarDay, date } from '../format.js';
import { t } from '../texts.js';

const words = t.courses;
const TONES = { passed: 'good', in_work: 'busy', not_begun: '' };

export const askedWords = ({ sessions }) => (sessions === null ? words.standard : words.sessionsOf(sessions));

export const dueWords = ({ due }) => (due === null ? words.anyTime : words.until(calendarDay(due)));

/** What there is to say beyond the state: since when, or how far. */
function detailOf({ sessions: asked }, { state, sessions, missing, passed, rule, standing }) {
  if (passed) return date(passed.at);
  if (state === 'not_begun') return '';
  if (asked !== null) return words.soFar(sessions, asked);
  if (standing === 'relapsed') return t.groups.standing.relapsed;
  if (rule?.state === 'out_of_reach') return t.groups.outOfReach;
  return missing === null ? words.sessionsOf(sessions) : words.passesMissing(missing);
}

/** The spaces between are for whoever hears it. */
export const StepState = ({ step, progress }) => html`
  <span class="step-state">
    <span class=${`pill ${TONES[progress.state]}`}>${words.state[progress.state]}</span>${' '}
    ${progress.overdue && html`<span class="pill bad">${words.overdue}</span>${' '}`}
    <span class="small muted">${detailOf(step, progress)}</span>
  </span>`;
