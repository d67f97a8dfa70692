// Forms from a list of fields: labels, hints, the server's problem inside the form, and no double submission.
import { html, useId, useRef, useState } from '../../preact.js';
import { asProblem } from '../../data.js';
import { t } from '../../texts.js';
import { fieldErrorText } from '../../translate.js';
import { ProblemNotice } from '../page/notice.js';

/** One labelled input. `type`: text, password, number, date…, file, select (`options: [value, text][]`), textarea, checks. */
export function Field({
  name,
  label,
  hint,
  type = 'text',
  value,
  options,
  required,
  optional,
  wide,
  onInput,
  inputRef,
  error,
  ...more
}) {
  const id = useId();
  const shared = {
    id,
    name,
    required,
    'aria-describedby': [hint && `${id}-hint`, error && `${id}-error`].filter(Boolean).join(' ') || undefined,
    'aria-invalid': error ? 'true' : undefined,
    onInput,
    ref: inputRef,
    ...more,
  };
  if (type === 'checks')
    return html`<${Checks} name=${name} label=${label} hint=${hint} options=${options} value=${value} />`;
  return html`
    <div class=${`field ${wide ? 'wide' : ''}`}>
      <label for=${id}>${label}${optional && html` <span class="muted">(${t.form.optional})</span>`}</label>
      ${type === 'select' && html`<select ...${shared} value=${value ?? ''}>
        ${options.map(([key, words]) => html`<option value=${key} selected=${key === (value ?? '')}>
        ${words}</option>`)}</select>`}
      ${type === 'textarea' && html`<textarea ...${shared} defaultValue=${value ?? ''}></textarea>`}
      ${type !== 'select' && type !== 'textarea' && html`<input type=${type} ...${shared} ...${type === 'file' ? {}
        : { defaultValue: value ?? '' }} />`}
      ${error && html`<p class="hint wrong" id=${`${id}-error`} lang=${error.lang}>${error.text}</p>`}
      ${hint && html`<p class="hint" id=${`${id}-hint`}>${hint}</p>`}
    </div>`;
}

const Checks = ({ name, label, hint, options, value = [] }) => html`
  <fieldset class="field plain">
    <legend>${label}</legend>
    ${hint && html`<p class="hint">${hint}</p>`}
    ${options.map(([key, words]) => html`<label class="check"><input type="checkbox" name=${name} value=${key}
      defaultChecked=${value.includes(key)} />${words}</label>`)}
  </fieldset>`;

/**
 * Calls `onSave(values, form)` and shows the problem if the service refuses. A field with `when(chosen)` is shown only
 * while that holds; `chosen` has the value of every select.
 */
export function Form({ fields, onSave, onCancel, cancel = t.form.cancel, submit = t.form.save, busyWords = t.form.saving, danger, children }) {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState(null);
  const [chosen, setChosen] = useState(() => Object.fromEntries(fields.map(field => [field.name, field.value])));
  const form = useRef(null);
  const choose = event =>
    event.target.tagName === 'SELECT' && setChosen(before => ({ ...before, [event.target.name]: event.target.value }));
  const shown = fields.filter(field => !field.when || field.when(chosen));
  /** What is wrong with a field, as the service says. */
  const errorOf = name => {
    const error = problem?.errors?.find(one => one.field === name);
    return error && fieldErrorText(error);
  };
  const save = async event => {
    event.preventDefault();
    setBusy(true);
    setProblem(null);
    try {
      await onSave(valuesOf(form.current, shown), form.current);
    } catch (error) {
      setProblem(asProblem(error));
    }
    setBusy(false);
  };
  return html`
    <form class="stack" ref=${form} onSubmit=${save} onInput=${choose}>
      <${ProblemNotice} problem=${problem} />
      <div class="fields">
        ${shown.map(field => html`<${Field} key=${field.name} optional=${isOptional(field)} error=${errorOf(field.name)} ...${field}
          value=${field.type === 'select' ? chosen[field.name] : field.value} />`)}
      </div>
      ${children}
      <div class="actions row">
        ${onCancel && html`<button class="button" type="button" onClick=${onCancel}>${cancel}</button>`}
        <button class=${`button ${danger ? 'danger' : 'main'}`} type="submit" disabled=${busy}>${busy ? busyWords
          : submit}</button>
      </div>
    </form>`;
}

/** Most fields are required, so the few optional ones are marked. A select shows it by its first option. */
const isOptional = ({ required, type }) => !required && type !== 'select' && type !== 'checks';

/** The form's values: empty optional fields are left out, numbers are numbers, files are files. */
function valuesOf(form, fields) {
  const data = new FormData(form);
  const values = {};
  for (const { name, type, clears } of fields) {
    if (type === 'checks') values[name] = data.getAll(name);
    else if (type === 'file') values[name] = data.getAll(name).filter(file => file instanceof File && file.size > 0);
    else if (type === 'number') values[name] = data.get(name) === '' ? undefined : Number(data.get(name));
    else values[name] = data.get(name) || (clears ? null : undefined);
  }
  return values;
}
