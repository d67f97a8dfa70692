// The attempts of an exam: what each was judged as, and the values that decided.
import { html } from '../../preact.js';
import { dateTime, number, unit } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { featureWithTool } from '../../translate.js';

const words = t.exams;
const TONES = { passed: 'good', not_passed: 'bad', undecided: 'warn', refused: 'warn', failed: 'warn' };

/** How many attempts are used, and which were declared void. @param {{ attempts_used: number, attempts_allowed: number, attempts: { number: number, voided_at?: string | null }[] }} exam */
export const usedText = ({ attempts_used: used, attempts_allowed: allowed, attempts }) =>
  words.used(used, allowed, attempts.filter(one => one.voided_at).map(one => one.number));

/** `onVoid`: for administrators, while an attempt can be voided. `withAdvice`: says what the examiner can do. @param {Props} props */
export const Attempts = ({ exam, onVoid = null, withAdvice = false }) => html`
  <section class="card">
    <header><h2>${words.attempts}</h2><span class="muted">${usedText(exam)}</span></header>
    <div class="body stack">
      ${!exam.attempts.length && html`<p class="muted">${words.noAttempts}</p>`}
      ${exam.attempts.map(attempt => html`<${Attempt} key=${attempt.number} attempt=${attempt} onVoid=${onVoid} withAdvice=${withAdvice} />`)}
    </div>
  </section>`;

/** @param {Props} props */
function Attempt({ attempt, onVoid, withAdvice }) {
  const { number: at, state, outcome, cause, completion, session, voided_at: voided, void_reason: why, voided_by: who } = attempt;
  const advice = words.advice[cause ?? outcome ?? ''];
  return html`
    <article class="stack tight">
      <h3>${words.attempt(at, Boolean(voided))} ${voided ? html`<span class="pill">${words.countsNowhere}</span>` : completion === 'broken_off' ? html`<span class="pill bad">${words.notCompleted}</span>`
        : outcome ? html`<span class=${`pill ${TONES[outcome]}`}>${words.outcomes[outcome]}</span>` : html`<span class="pill">${words.attemptStates[state]}</span>`}</h3>
      <p class="small muted">${dateTime(attempt.began_at)}${session && html` · <a href=${href(['sessions', session])}>${words.session}</a>`}</p>
      ${voided && html`<p class="small">${words.voidedOn(dateTime(voided), who)} ${why && html`<span class="said">${why}</span>`}</p>`}
      ${voided && outcome && html`<p class="small">${words.wasJudged(words.outcomes[outcome])}</p>`}
      ${completion && html`<p class="small">${completion === 'broken_off' ? words.brokenOff : words.isCompleted}</p>`}
      ${cause && html`<p class="small">${words.causes[cause]}</p>`}
      ${!cause && outcome && words.outcomeBodies[outcome] && html`<p class="small">${words.outcomeBodies[outcome]}</p>`}
      ${withAdvice && !voided && completion !== 'broken_off' && advice && html`<p class="small">${advice}</p>`}
      ${attempt.figures.length > 0 && html`<${Figures} figures=${attempt.figures} />`}
      ${onVoid && !voided && state !== 'recording' && html`<p><button class="button" type="button" onClick=${() => onVoid(attempt)}>${words.void}</button></p>`}
    </article>`;
}

/** The judgement stands beside the feature: on a phone, the columns on the right are scrolled to. @param {Props} props */
const Figures = ({ figures }) => html`
  <div class="scroll"><table class="table dense">
    <thead><tr><th scope="col">${words.feature}</th><th scope="col">${words.judgement}</th><th scope="col">${words.value}</th><th scope="col">${words.limit}</th><th scope="col">${words.range}</th></tr></thead>
    <tbody>${figures.map(figure => html`<tr key=${featureWithTool(figure)}><th scope="row">${featureWithTool(figure)}</th>
      <td>${words.judgements[figure.judgement]}</td><td>${withUnit(figure.value, figure)}</td>
      <td>${words.limits[figure.better](withUnit(figure.limit, figure))}</td><td>${rangeOf(figure)}</td></tr>`)}</tbody></table></div>`;

const withUnit = (value, { unit: of }) => (typeof value === 'number' ? [number(value), unit(of)].filter(Boolean).join('\u00a0') : '–');

/** A value without an upper end is a lower bound. */
function rangeOf({ low, high }) {
  if (typeof low !== 'number') return '–';
  return typeof high === 'number' ? `${number(low)}\u00a0–\u00a0${number(high)}` : words.atLeast(number(low));
}
