// The standard of a task: its targets, each with its source, the pass rule and the chart's design.
import { html } from '../../preact.js';
import { date, number, percent, unit } from '../../format.js';
import { t } from '../../texts.js';
import { featureWithTool } from '../../translate.js';
import { Empty } from '../page/notice.js';

const words = t.task;

/** The limit as text: `at most 50 s`. */
export const limitText = target => words.limits[target.better](`${number(target.limit)} ${unit(target.unit)}`.trim());

/** Of a task's versions, newest first, the one that judges recordings that arrive now. */
export const standardInUse = standards => standards.find(one => !isAhead(one));

const isAhead = ({ valid_from: from }) => from !== null && Date.parse(from) > Date.now();

/** When a version was set and which recordings it judges. */
const versionText = one => {
  const from = one.valid_from === null ? words.validFromBeginning : words.validFrom(date(one.valid_from));
  return `${words.version(one.version)}, ${words.setBy(date(one.created_at), one.who)}; ${from}`;
};

/** @param {Props} props */
export function Standard({ standard, onSet }) {
  return html`
    <section class="card">
      <header>
        <h2 id="standard-in-use" tabindex="-1">${words.inUse}</h2>
        ${onSet && html`<button class="button main" type="button" onClick=${onSet}>
          ${standard ? words.changeOne : words.setOne}</button>`}
      </header>
      ${standard ? html`<div class="body stack">
        <p class="muted">${versionText(standard)}</p>
        <${Targets} targets=${standard.targets} />
        <${RuleAndChart} standard=${standard} />
      </div>` : html`<${Empty} title=${words.noStandard} body=${onSet ? words.noStandardBody : words.noStandardYet} />`}
    </section>`;
}

/** @param {Props} props */
export const Targets = ({ targets }) => html`
  <div class="scroll">
    <table class="table dense">
      <thead><tr><th scope="col">${words.target}</th><th scope="col">${words.limit}</th><th scope="col">${words.madeFrom}</th></tr></thead>
      <tbody>${targets.map(target => html`
        <tr key=${featureWithTool(target)}>
          <th scope="row">${featureWithTool(target)}${target.tool && html`<small class="muted">${words.onlyThisTool}</small>`}</th>
          <td><strong>${limitText(target)}</strong>${target.low !== null && html`<small class="muted">
            ${words.between(number(target.low), number(target.high))}</small>`}</td>
          <td>${basisText(target)}${wrongText(target.basis)}<small class="muted">${madeFromText(target.made_from)}</small></td>
        </tr>`)}</tbody>
    </table>
  </div>`;

const basisText = ({ basis }) => {
  const share = basis.share === undefined ? undefined : percent(basis.share);
  return words.basis[basis.method]({ ...basis, percent: share });
};

/** A share of people that a limit judges wrongly, with its interval. */
export const shareText = share => words.share(percent(share.seen), percent(share.low), percent(share.high));

const wrongText = basis => basis.false_pass && html`<small>
  ${words.wrong(shareText(basis.false_pass), shareText(basis.false_fail))}</small>`;

const madeFromText = from => from && [words.ofVersion(from.pipeline), from.handedness &&
  words.ofHand(t.trainees.hands[from.handedness].toLowerCase())].filter(Boolean).join(', ');

/** `3 in a row and 2 more`, or that there is none. */
export const ruleText = rule => (rule ? t.trainee.rule(rule.in_a_row, rule.then_more, rule.at_most) : words.noRule);

/** @param {Props} props */
export const RuleAndChart = ({ standard: { rule, charts } }) => html`
  <dl class="facts">
    <dt>${words.rule}</dt><dd>${ruleText(rule)}</dd>
    <dt>${words.charts}</dt><dd>${words.design({
      inadequate: percent(charts.inadequate), adequate: percent(charts.adequate), within: charts.declare_within,
      wrong: percent(charts.false_declaration) })}</dd>
  </dl>`;

/** @param {Props} props */
export const StandardHistory = ({ standards }) => html`
  <section class="card wide">
    <header><h2>${words.history}</h2></header>
    ${standards.length ? html`<ul class="queue history">${standards.map(standard => html`
      <li key=${standard.id}><details>
        <summary>${versionText(standard)}</summary>
        <div class="stack"><${Targets} targets=${standard.targets} /><${RuleAndChart} standard=${standard} /></div>
      </details></li>`)}</ul>` : html`<p class="body muted">${words.historyNone}</p>`}
  </section>`;
