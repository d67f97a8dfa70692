// The errors of a task: its error items and its score formula with their versions, and whether raters agree on the items.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { calendarDay, date, fixed, number } from '../../format.js';
import { t } from '../../texts.js';
import { reasonText } from '../../translate.js';
import { focusSoon } from '../forms/focus.js';
import { Notice, ProblemNotice } from '../page/notice.js';
import { scaleText } from '../session/error_score.js';
import { ErrorListForm } from './error_list_form.js';
import { ScoreFormulaForm } from './score_formula_form.js';

const words = t.errors;
const TITLE = 'errors-of-task'; // Gets the focus when a form closes.

/** @param {Props} props */
export function ErrorsOfTask({ task, person }) {
  const { data, problem, reload } = useData(async signal => {
    const [lists, formulas] = await Promise.all([api.tasks.errorLists(task.id, signal), api.tasks.scoreFormulas(task.id, signal)]);
    return { lists, formulas };
  }, [task.id]);
  const [open, setOpen] = useState(null); // 'items', or 'formula'
  const [example, setExample] = useState(null); // Its formula goes into the form of the formula.
  const [saved, setSaved] = useState(null);
  if (!data) return html`<${ProblemNotice} problem=${problem} onRetry=${reload} />`;
  const [list] = data.lists;
  const items = list?.items ?? [];
  const close = text => (setOpen(null), setExample(null), setSaved(text ?? null), focusSoon(TITLE), reload());
  const showForm = which => (setSaved(null), setOpen(which));
  const takeItems = (made, taken) => (close(words.listIsSet(made.version)), taken && (setExample(taken), setOpen('formula')));
  return html`
    <section class="card errors-of-task">
      <header>
        <h2 id=${TITLE} tabindex="-1">${words.ofTaskTitle}</h2>
        ${task.may_change && !open && html`<div class="row">
          <button class="button" type="button" onClick=${() => showForm('items')}>${list ? words.changeItems : words.setItems}</button>
          ${items.length > 0 && html`<button class="button" type="button" onClick=${() => showForm('formula')}>${
            data.formulas.length ? words.changeFormula : words.setFormula}</button>`}
        </div>`}
      </header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${saved && html`<${Notice} tone="good" quiet title=${saved} />`}
        ${open === 'items' && html`<${ErrorListForm} task=${task} items=${items} onSet=${takeItems} onCancel=${() => close()} />`}
        ${open === 'formula' && html`<${ScoreFormulaForm} task=${task} items=${example?.items ?? items} first=${example?.formula ?? data.formulas[0]}
          isExample=${Boolean(example)} isFirst=${!data.formulas.length} onSet=${made => close(words.formulaIsSet(made.version))} onCancel=${() => close()} />`}
        ${!open && (list ? html`<${Lists} lists=${data.lists} />` : html`<p class="muted">${task.may_change ? words.noItemsBody : words.noItems}</p>`)}
        ${!open && items.length > 0 && html`<${Formulas} formulas=${data.formulas} items=${data.lists.flatMap(one => one.items)} />`}
        ${!open && items.length > 0 && person.role !== 'trainee' && html`<${ErrorAgreement} task=${task} version=${list.version} />`}
      </div>
    </section>`;
}

const setBy = ({ version, created_at: at, who }) => `${t.task.version(version)}, ${t.task.setBy(date(at), who)}`;

/** How an item is judged, with the unit of an amount. */
export const kindText = ({ kind, unit }) => [words.kinds[kind], unit && `(${unit})`].filter(Boolean).join(' ');

/** The list in use, and the earlier versions. @param {Props} props */
const Lists = ({ lists: [inUse, ...earlier] }) => html`
  <p class="muted">${words.listInUse}: ${setBy(inUse)}</p>
  ${inUse.items.length ? html`<${Items} items=${inUse.items} />` : html`<p class="muted">${words.emptyList}</p>`}
  <${Earlier} versions=${earlier} title=${words.earlierLists} show=${one => html`<${Items} items=${one.items} />`} />`;

const Items = ({ items }) => html`
  <div class="scroll">
    <table class="table dense">
      <thead><tr><th scope="col">${words.key}</th><th scope="col">${words.item}</th><th scope="col">${words.kind}</th></tr></thead>
      <tbody>${items.map((item, index) => html`<tr key=${item.item}><td>${index < 9 ? index + 1 : '–'}</td>
        <th scope="row">${item.name}${item.hint && html`<small>${item.hint}</small>`}</th><td>${kindText(item)}</td></tr>`)}</tbody>
    </table>
  </div>`;

/** @param {Props} props */
const Formulas = ({ formulas: [newest, ...earlier], items }) => html`
  <h3>${words.formula}</h3>
  ${newest ? html`<p class="muted">${setBy(newest)}; ${words.validFrom(newest.valid_from && calendarDay(newest.valid_from))}</p>
    <${Formula} formula=${newest} items=${items} />
    <${Earlier} versions=${earlier} title=${words.earlierFormulas} show=${one => html`
      <p class="muted">${words.validFrom(one.valid_from && calendarDay(one.valid_from))}</p><${Formula} formula=${one} items=${items} />`} />`
    : html`<p class="muted">${words.noFormula}</p>`}`;

/** The formula in one line, and what people should know of it. */
const Formula = ({ formula, items }) => {
  const nameOf = key => items.find(item => item.item === key)?.name ?? key;
  const parts = [number(formula.cut_off_s), words.times[formula.time], ...formula.weights.map(({ item, weight }) => `${number(weight)} × ${nameOf(item)}`)];
  return html`<p><strong>${parts.join(' − ')}</strong></p><p class="small muted">${scaleText(formula)}. ${items.length > 0 && formula.weights.length === 0 && `${words.noErrorCounts} `}${formula.note ?? ''}</p>`;
};

const Earlier = ({ versions, title, show }) => versions.length > 0 && html`
  <details><summary>${title(versions.length)}</summary>
    <ul class="queue history">${versions.map(one => html`<li key=${one.id}><p class="small muted">${setBy(one)}</p>${show(one)}</li>`)}</ul>
  </details>`;

const estimate = value => (value ? t.raters.estimate(fixed(value.value, 2), fixed(value.low, 2), fixed(value.high, 2)) : '–');

/** Whether the raters agree on each item. @param {Props} props */
function ErrorAgreement({ task, version }) {
  const { data } = useData(signal => api.tasks.errorAgreement(task.id, signal).catch(() => null), [task.id, version]);
  if (!data) return null;
  const isEmpty = data.items.every(item => !item.single && !item.same);
  return html`
    <h3>${words.agreement}</h3>
    ${isEmpty ? html`<p class="muted">${words.tooFew(Math.max(0, ...data.items.map(item => item.people)), data.sessions)}</p>` : html`
      <div class="scroll" tabindex="0" role="region" aria-label=${words.agreement}>
        <table class="table dense">
          <thead><tr><th scope="col">${words.item}</th><th scope="col" class="number">${words.icc}</th><th scope="col" class="number">${words.same}</th>
            <th scope="col" class="number">${words.people}</th></tr></thead>
          <tbody>${data.items.map(item => html`<tr key=${item.item}><th scope="row">${item.name}${item.withheld && html`<small>${reasonText(item.withheld)}</small>`}</th>
            <td class="number">${estimate(item.single)}</td><td class="number">${estimate(item.same)}</td><td class="number">${item.people}</td></tr>`)}</tbody>
        </table>
      </div>
      <p class="small muted">${words.agreementHow}</p>`}`;
}
