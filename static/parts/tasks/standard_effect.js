// The trainees whose state a new standard would change, before it is set.
import { html } from '../../preact.js';
import { date } from '../../format.js';
import { t } from '../../texts.js';

const words = t.standardEffect;

/** @param {{ effect: Schemas['StandardEffect'] }} props */
export const Effect = ({ effect }) => html`
  <div class="stack tight">
    <h4>${words.title}</h4>
    <p class="small muted">${effect.valid_from ? words.from(date(effect.valid_from)) : words.fromBeginning}</p>
    ${effect.trainees.length > 0 ? html`<div class="scroll"><table class="table dense">
      <thead><tr><th scope="col">${words.trainee}</th><th scope="col">${words.before}</th><th scope="col">${words.after}</th></tr></thead>
      <tbody>${effect.trainees.map(one => html`<tr key=${one.trainee}>
        <th scope="row">${one.name}</th><td>${stateText(one.before)}</td>
        <td>${stateText(one.after)}${one.judged_anew > 0 && html`<small class="muted">${words.judgedAnew(one.judged_anew)}</small>`}</td>
      </tr>`)}</tbody></table></div>` : html`<p>${words.none}</p>`}
    ${effect.trainees.length > 0 && effect.unchanged > 0 && html`<p class="small muted">${words.unchanged(effect.unchanged)}</p>`}
    ${effect.more && html`<p class="small muted">${words.more}</p>`}
  </div>`;

/** @param {Schemas['TaskState']} state */
function stateText({ passed, rule, standing }) {
  const own = rule ? ruleStateText(rule) : standing ? words.standing[standing] : words.noStandard;
  return [passed !== null && words.passed(passed), own].filter(Boolean).join(' · ');
}

/** @param {Schemas['RuleState']} rule */
function ruleStateText({ state, have_in_a_row: row, in_a_row: ofRow, have_more: more, then_more: ofMore }) {
  if (state !== 'open') return words.rule[state];
  return words.open(row, ofRow, more, ofMore);
}
