// The PIN that a trainee checks in with at a box's screen.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { date } from '../../format.js';
import { t } from '../../texts.js';
import { Form } from '../forms/form.js';
import { Loading, Notice, ProblemNotice } from '../page/notice.js';

const words = t.boxPin;

/** The card on the own account. @param {Props} props */
export function BoxPin({ trainee }) {
  const { data, problem, reload } = useData(signal => api.own.pin(signal), []);
  const [isChanged, setChanged] = useState(false);
  const save = async ({ pin }, form) => {
    await api.own.setPin(pin);
    form.reset();
    setChanged(true);
    reload();
  };
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <div class="body stack">
        <p>${words.lead(trainee.code)}</p>
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${!data && !problem && html`<${Loading} />`}
        ${isChanged && html`<${Notice} tone="good" title=${words.changed} />`}
        ${data?.set_at && html`<div class="row apart"><span>${words.since(date(data.set_at))}</span>
          <button class="button" type="button" onClick=${() => api.own.removePin().then(reload, reload)}>${words.remove}</button></div>`}
        <${Form} fields=${[{ name: 'pin', label: words.pin, hint: words.hint, type: 'password', required: true, inputmode: 'numeric', pattern: '[0-9]{4,8}', maxlength: 8, autocomplete: 'off' }]}
          onSave=${save} submit=${data?.set_at ? words.change : words.set} />
      </div>
    </section>`;
}
