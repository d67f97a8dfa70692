// A trainee's home: new feedback, the last result with its limits, the way to the standard, and what to work on next.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { dateTime, number, unit } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { adviceText } from '../../translate.js';
import { withError } from '../../with_error.js';
import { ProblemNotice } from '../page/notice.js';
import { recordedAtText } from '../page/recorded_at.js';
import { Outcome } from '../page/status.js';
import { OutcomeCard } from '../session/outcome_card.js';
import { markSeen, useNewFeedback } from './new_feedback.js';

const words = t.home;

/** `session`: the newest scored one, if there is any. @param {Props} props */
export function TraineeHome({ person, session }) {
  const feedback = useNewFeedback(person);
  return html`
    <div class="stack home">
      ${feedback && feedback.items.length > 0 && html`<${NewFeedback} feedback=${feedback} />`}
      ${session && html`<${LastResult} session=${session} isNew=${feedback?.new_results.includes(session.id)} />`}
    </div>`;
}

/** @param {Props} props */
function NewFeedback({ feedback }) {
  const [problem, setProblem] = useState(null);
  const more = feedback.sessions - feedback.items.length;
  return html`
    <section class="card" aria-label=${t.feedback.title}>
      <header><h2>${t.feedback.title}</h2><button class="button" type="button"
        onClick=${() => markSeen(feedback).catch(error => setProblem(asProblem(error)))}>${t.feedback.markAll}</button></header>
      <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
      <ul class="queue">${feedback.items.map(item => html`<li key=${item.session}>
        <div><a href=${href(['sessions', item.session])}>${t.feedback.on(item.task.name, dateTime(item.recorded_at))}</a>
          <span class="small muted">${[givenText(item), t.feedback.by(item.who), dateTime(item.latest_at)].filter(Boolean).join(' · ')}</span></div>
        <span class="pill busy">${t.feedback.new}</span></li>`)}</ul>
      ${more > 0 && html`<p class="body small muted">${t.feedback.more(more)}</p>`}
    </section>`;
}

/** `2 ratings, 1 comment`. @param {Schemas['SessionFeedback']} item */
const givenText = ({ ratings, comments }) =>
  [ratings > 0 && t.feedback.ratings(ratings), comments > 0 && t.feedback.comments(comments)].filter(Boolean).join(', ');

/** @param {Props} props */
function LastResult({ session, isNew }) {
  const { current: progress } = useData(
    signal => (session.trainee ? api.trainees.progress(session.trainee.id, { task: session.task.id }, signal).catch(() => null) : null),
    [session.id, session.result]);
  const { current: advice } = useData(signal => api.sessions.advice(session.id, signal).catch(() => null), [session.id, session.result]);
  return html`
    <section class="card" aria-label=${words.last}>
      <header><h2>${words.last}</h2><a href=${href(['sessions', session.id])}>${words.open}</a></header>
      <div class="body stack tight">
        <div class="row"><strong>${session.task.name}</strong><${Outcome} session=${session} />${isNew && html`<span class="pill busy">${
          t.feedback.new}</span>`}</div>
        <p class="small muted">${[recordedAtText(session), timeText(session)].filter(Boolean).join(' · ')}</p>
        <${WayToStandard} progress=${progress} />
        ${advice && advice.items.length > 0 && html`<div><h3>${t.session.advice.title}</h3>
          <ul class="plain-list">${advice.items.map(item => html`<li key=${`${item.feature} ${item.tool} ${item.space}`}>${adviceText(item)}</li>`)}</ul></div>`}
      </div>
    </section>
    <${OutcomeCard} session=${session} />`;
}

/** The duration of the session; empty if it was refused or has none. @param {Schemas['SessionResponse']} session */
function timeText(session) {
  const one = session.features.find(({ name, tool = null }) => name === 'duration' && tool === null);
  if (!one || one.value === null || session.quality?.verdict === 'refused') return '';
  const text = one.error ? withError(one.value, one.error).join(' ± ') : number(one.value);
  return words.time(`${text} ${unit(one.unit)}`);
}

/** How many passes in a row are there, and how many the standard asks for. @param {Props} props */
function WayToStandard({ progress }) {
  const rule = progress?.rule;
  if (!rule) return null;
  const { in_a_row: row, then_more: more = 0, have_in_a_row: haveRow, have_more: haveMore } = rule;
  if (rule.state !== 'open' || typeof haveRow !== 'number') return html`<p>${t.trainee.ruleName}: ${rule.state === 'met'
    ? t.trainee.ruleMet(rule.met_at) : t.trainee.ruleOutOfReach}</p>`;
  const inPhaseTwo = haveRow >= row && more > 0;
  const [have, of] = inPhaseTwo ? [haveMore ?? 0, more] : [haveRow, row];
  const said = (inPhaseTwo ? words.more : words.inARow)(have, of);
  return html`<div class="way"><progress class="bar" max=${of} value=${have} aria-label=${said}></progress><p>${said}</p></div>`;
}
