// Exams in a list, and as a card on the page of a trainee.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { calendarDay, date } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { usedText } from './attempts.js';

const words = t.exams;
const TONES = { planned: '', running: 'busy', closed: '', cancelled: '' };
const RESULT_TONES = { passed: 'good', not_passed: 'bad', undecided: 'warn' };

/** The result, or the state before there is one. @param {Props} props */
export const ExamPill = ({ exam: { state, result } }) => (result
  ? html`<span class=${`pill ${RESULT_TONES[result]}`}>${words.results[result]}</span>`
  : html`<span class=${`pill ${TONES[state]}`}>${words.states[state]}</span>`);

/** `withNames`: also says whose each is. @param {Props} props */
export const ExamList = ({ exams, withNames = false }) => html`
  <ul class="queue">${exams.map(exam => html`
    <li key=${exam.id}><div>
      <a href=${href(['exams', exam.id])}>${withNames ? `${exam.trainee.name}, ` : ''}${exam.task.name}</a>
      <p class="small muted">${[whenOf(exam), exam.box.name, usedText(exam)].join(' · ')}</p></div>
      <${ExamPill} exam=${exam} /></li>`)}</ul>`;

/** @param {Schemas['ExamResponse']} exam */
function whenOf({ state, day, started_at: started, ended_at: ended, planned_at: planned }) {
  if (state === 'closed') return words.closedOn(date(ended));
  if (state === 'cancelled') return words.cancelledOn(date(ended));
  if (state === 'running') return words.startedOn(date(started));
  return day ? words.plannedFor(calendarDay(day)) : words.plannedOn(date(planned));
}

/** The exams of one trainee; nothing for a trainee who has none. @param {Props} props */
export function ExamsCard({ trainee }) {
  const { data } = useData(signal => api.exams.page({ trainee, limit: 200 }, signal), [trainee]);
  if (!data?.items.length) return null;
  return html`
    <section class="card list"><header><h2>${words.title}</h2></header><${ExamList} exams=${data.items} /></section>`;
}
