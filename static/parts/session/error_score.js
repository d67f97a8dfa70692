// The error score of a session with all of its parts, so that it can be computed again by hand; or why there is none.
import { html } from '../../preact.js';
import { calendarDay, number } from '../../format.js';
import { t } from '../../texts.js';
import { noErrorScoreText } from '../../translate.js';
import { withError } from '../../with_error.js';

const words = t.errors;

/** The error bar of a value as text: ` (43.8 to 44.1)`; empty without one. */
const barText = (low, high) => (low === null || high === null ? '' : ` (${words.between(number(low), number(high))})`);

/** `2 × 10`, `1.5 mm × 2`, `yes: 50`; a mean of several sheets with its range. @param {Schemas['ScorePart']} part */
function partText(part) {
  const amount = [number(part.mean), part.unit].filter(Boolean).join(' ');
  const range = part.lowest === part.highest ? '' : ` (${words.between(number(part.lowest), number(part.highest))})`;
  return `${amount}${range} × ${number(part.weight)}`;
}

/** How points become the score. @param {Schemas['ScoreFormulaResponse'] | Schemas['NewScoreFormula']} formula */
export function scaleText({ scale, not_below_zero: floor }) {
  const parts = [scale ? words.scaled(number(scale.norm), number(scale.maximum)) : words.notScaled, floor && words.notBelowZero,
    scale?.not_above && words.notAbove(number(scale.maximum))];
  return parts.filter(Boolean).join('; ');
}

/**
 * `formula` is the formula that was tried; without it, the version of the task that is in the answer.
 *
 * @param {Props} props
 */
export function ErrorScore({ answer, tried }) {
  const { score, none } = answer;
  const formula = tried ?? answer.formula;
  if (!score || !formula) return none && none.reason !== 'no_formula' ? html`<p class="muted">${noErrorScoreText(none)}</p>` : null;
  return html`
    <div class="stack tight">
      <table class="table dense score-parts">
        <caption class="unseen">${words.score}</caption>
        <tbody>
          <tr><th scope="row">${words.cutOff}</th><td class="number">${number(score.cut_off_s)}</td></tr>
          <tr><th scope="row">${words.times[formula.time]}</th><td class="number">− ${timeText(score)}</td></tr>
          ${score.parts.map(part => html`<tr key=${part.item}><th scope="row">${part.name}<small>${partText(part)}</small></th>
            <td class="number">− ${number(part.mean * part.weight)}</td></tr>`)}
          <tr><th scope="row">${words.points}</th><td class="number">${number(score.points)}</td></tr>
          <tr class="total"><th scope="row">${words.score}<small>${scaleText(formula)}</small></th>
            <td class="number"><strong>${number(score.value)}</strong>${barText(score.low, score.high)}</td></tr>
        </tbody>
      </table>
      <p class="small muted">${words.madeOf(score.sheets, score.left_out)} ${score.low === null ? words.noBar : words.bar(score.sheets)}</p>
      ${answer.formula && html`<p class="small muted">${words.byVersion(answer.formula.version, answer.formula.valid_from && calendarDay(answer.formula.valid_from))}${
        answer.formula.note && ` ${answer.formula.note}`}</p>`}
    </div>`;
}

/** The subtracted time with its error. @param {Schemas['ErrorScore']} score */
function timeText({ time_s: time, time_low_s: low, time_high_s: high }) {
  if (low === null || low === undefined || high === null || high === undefined || low === high) return number(time);
  return withError(time, { low, high }).join(' ± ');
}
