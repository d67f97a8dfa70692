// Sets a task's error items: its own, or an example to start from.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { t } from '../../texts.js';
import { exampleItemText, exampleNote, exerciseTitle } from '../../translate.js';
import { Field } from '../forms/form.js';
import { ProblemNotice } from '../page/notice.js';

const words = t.errors;
const KINDS = ['count', 'amount', 'yes_no'];
const MAX_ITEMS = 12;
let rows = 0;
const row = item => ({ key: rows++, item: null, name: '', kind: 'count', unit: '', hint: '', ...item });

/** `onSet(list, example)`: the list that was set, and the example that it began with. @param {Props} props */
export function ErrorListForm({ task, items: present, onSet, onCancel }) {
  const { data: examples } = useData(signal => api.errorExamples(signal), []);
  const [items, setItems] = useState(() => (present.length ? present.map(item => row({ ...item, unit: item.unit ?? '', hint: item.hint ?? '' })) : [row({})]));
  const [example, setExample] = useState(null);
  const [problem, setProblem] = useState(null);
  const [busy, setBusy] = useState(false);
  const change = (at, more) => setItems(before => before.map((item, index) => (index === at ? { ...item, ...more } : item)));
  const up = at => setItems(before => [...before.slice(0, at - 1), before[at], before[at - 1], ...before.slice(at + 1)]);
  const take = event => {
    const chosen = examples?.find(one => one.example === event.target.value);
    if (!chosen) return;
    const named = chosen.items.map(item => {
      const [name, hint] = exampleItemText(item);
      return { ...item, name, hint };
    });
    setExample({ name: chosen.example, items: named, formula: { ...chosen.formula, note: exampleNote(chosen.formula.note) } });
    setItems(named.map(item => row({ ...item, unit: item.unit ?? '' })));
  };
  const save = async event => {
    event.preventDefault();
    setBusy(true);
    setProblem(null);
    try {
      const list = await api.tasks.setErrorList(task.id, { items: items.map(request) });
      const kept = key => list.items.some(item => item.item === key);
      return onSet(list, example && example.formula.weights.every(({ item }) => kept(item)) ? { ...example, items: list.items } : null);
    } catch (error) {
      setProblem(asProblem(error));
    }
    return setBusy(false);
  };
  return html`
    <form class="stack" onSubmit=${save}>
      <p class="muted">${words.itemsLead}</p>
      ${examples && html`<${Field} type="select" name="example" label=${words.example} hint=${words.exampleHint} value=${example?.name ?? ''} onInput=${take}
        options=${[['', words.noExample], ...examples.map(one => [one.example, exerciseTitle({ preset: one.example, title: one.title })])]} />`}
      ${example && html`<p class="small muted">${example.formula.note}</p>`}
      ${items.map((item, at) => html`<${ItemFields} key=${item.key} item=${item} at=${at} onChange=${more => change(at, more)} onUp=${() => up(at)}
        onRemove=${() => setItems(before => before.filter(one => one !== item))} />`)}
      ${items.length < MAX_ITEMS && html`<div><button class="button" type="button" onClick=${() => setItems(before => [...before, row({})])}>${words.addItem}</button></div>`}
      <${ProblemNotice} problem=${problem} />
      <div class="row">
        <button class="button main" type="submit" disabled=${busy}>${busy ? t.form.saving : words.saveItems}</button>
        <button class="button" type="button" onClick=${onCancel}>${t.form.cancel}</button>
      </div>
    </form>`;
}

/** The item for the service. An item that is kept has its short name, unless its kind or unit was changed. */
function request({ item, name, kind, unit, hint, was }) {
  const isAmount = kind === 'amount';
  const goesOn = item && (!was || (was.kind === kind && was.unit === unit));
  return { item: goesOn ? item : undefined, name, kind, unit: isAmount ? unit : undefined, hint: hint || undefined };
}

/** @param {Props} props */
function ItemFields({ item, at, onChange, onUp, onRemove }) {
  const input = name => event => onChange({ [name]: event.target.value, was: item.was ?? { kind: item.kind, unit: item.unit } });
  return html`
    <fieldset class="plain target stack tight">
      <legend class="label">${words.itemNumber(at + 1)}</legend>
      <div class="fields">
        <${Field} name=${`name ${item.key}`} label=${words.name} value=${item.name} required maxlength="120" onInput=${input('name')} />
        <${Field} type="select" name=${`kind ${item.key}`} label=${words.kind} value=${item.kind} options=${KINDS.map(kind => [kind, words.kinds[kind]])} onInput=${input('kind')} />
        ${item.kind === 'amount' && html`<${Field} name=${`unit ${item.key}`} label=${words.unit} hint=${words.unitHint} value=${item.unit} required maxlength="12" onInput=${input('unit')} />`}
        <${Field} name=${`hint ${item.key}`} label=${words.hint} value=${item.hint} optional wide maxlength="120" onInput=${input('hint')} />
      </div>
      <div class="row">
        ${at > 0 && html`<button class="button bare" type="button" aria-label=${words.upThis(at + 1)} onClick=${onUp}>${words.up}</button>`}
        <button class="button bare" type="button" aria-label=${words.removeThis(at + 1)} onClick=${onRemove}>${t.form.remove}</button>
      </div>
    </fieldset>`;
}
