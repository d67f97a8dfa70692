// The quality of a task's ratings: whether raters agree, and which features correlate with their ratings.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { fixed } from '../../format.js';
import { t } from '../../texts.js';
import { featureTitle, formTitle, ratingItemTitle, reasonText } from '../../translate.js';
import { Dialog } from '../forms/dialog.js';
import { Loading, ProblemNotice } from '../page/notice.js';

const words = t.raters;

/** @param {Props} props */
export function RatersDialog({ task, onClose }) {
  const [form, setForm] = useState(/** @type {Schemas['RatingForm']} */ ('goals'));
  const { data: forms } = useData(signal => api.ratingForms(signal), []);
  const { data, problem, reload } = useData(
    signal => Promise.all([api.agreement(task.id, form, signal), api.correlations(task.id, form, signal)]),
    [task.id, form],
  );
  const answers = data?.[0].form === form ? data : null;
  const chosen = forms?.find(one => one.form === form);
  return html`
    <${Dialog} title=${words.title(task.name)} onClose=${onClose}>
      <div class="row" role="group" aria-label=${words.form}>
        ${(forms ?? []).map(choice => html`<button key=${choice.form} class="button" type="button"
          aria-pressed=${choice.form === form} onClick=${() => setForm(choice.form)}>${formTitle(choice)}</button>`)}
      </div>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${answers && chosen ? html`<${Agreement} agreement=${answers[0]} form=${chosen} /><${Correlations}
        correlations=${answers[1]} form=${chosen} />` : !problem && html`<${Loading} />`}
      <div class="actions"><button class="button" type="button" onClick=${onClose}>${words.close}</button></div>
    <//>`;
}

const estimate = value => words.estimate(fixed(value.value, 2), fixed(value.low, 2), fixed(value.high, 2));

/** @param {Props} props */
const Agreement = ({ agreement, form }) => html`
  <section class="stack tight">
    <h3>${words.agreement}</h3>
    ${agreement.withheld ? html`<p class="muted">${words.notEnough(reasonText(agreement.withheld))}</p>` : html`
      <dl class="facts">
        <dt>${words.single}</dt><dd>${estimate(agreement.single)}</dd>
        <dt>${words.mean(agreement.raters)}</dt><dd>${agreement.mean ? estimate(agreement.mean) : words.none}</dd>
      </dl>
      <p class="small muted">${words.madeOf(agreement.people, agreement.raters, agreement.left_out)}</p>`}
    <${SameItems} form=${form} items=${agreement.items} others=${agreement.other_items} />
  </section>`;

/** @param {Props} props */
const Correlations = ({ correlations, form }) => html`
  <section class="stack tight">
    <h3>${words.correlations}</h3>
    ${correlations.withheld ? html`<p class="muted">${words.notEnough(reasonText(correlations.withheld))}</p>` : html`
      <p class="small muted">${words.adjusted(correlations.people, correlations.asked)}</p>
      <div class="scroll correlations" tabindex="0" role="region" aria-label=${words.correlations}>
        <table class="table dense">
          <thead><tr><th scope="col">${t.session.feature}</th><th scope="col" class="number">ρ</th><th scope="col">${
            words.found}</th></tr></thead>
          <tbody>
            ${correlations.items.filter(row => row.rho).map(row => html`
              <tr key=${`${row.feature} ${row.tool} ${row.space}`}>
                <th scope="row">${featureTitle(row)}<small>${[row.tool, row.space === 'image' && t.session.image]
                  .filter(Boolean).join(', ')}</small></th>
                <td class="number">${estimate(row.rho)}</td>
                <td>${row.found ? words.yes : words.no}</td>
              </tr>`)}
          </tbody>
        </table>
      </div>`}
    <${SameItems} form=${form} items=${correlations.rated_items} others=${correlations.other_items} />
  </section>`;

/** Which items the compared ratings judged, where that is not the whole form. @param {Props} props */
const SameItems = ({ form, items, others }) => {
  const isPart = items.length > 0 && (others > 0 || items.length < form.items.length);
  const titles = form.items.filter(item => items.includes(item.name)).map(ratingItemTitle).join(', ');
  return isPart && html`<p class="small muted">${words.sameItems(titles)}${others > 0 && ` ${words.otherItems(others)}`}</p>`;
};
