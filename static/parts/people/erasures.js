// Erasing a trainee: what is deleted, a copy first, the name to confirm; and the trainees who wait for their erasure.
import { html, useState } from '../../preact.js';
import { api, Problem } from '../../api.js';
import { useData } from '../../data.js';
import { bytes, dateTime } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Confirm, Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Loading, ProblemNotice } from '../page/notice.js';
import { DataLinks } from './own_data.js';

const words = t.erasures;

/** Asks for the trainee's name before they are erased. @param {Props} props */
export function EraseDialog({ trainee, onErased, onClose }) {
  const { data, problem, reload } = useData(signal => api.trainees.erasure(trainee.id, signal), [trainee.id]);
  const erase = async ({ name }) => {
    if (name?.trim() !== trainee.name) throw new Problem({ title: words.otherName(trainee.name), status: 0 });
    await api.trainees.erase(trainee.id, true);
    onErased();
    onClose();
  };
  return html`
    <${Dialog} title=${t.people.removeTitle(trainee.name)} onClose=${onClose}>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      ${data && html`
        <p>${words.extent(data.sessions, bytes(data.bytes))} ${data.days ? words.wait(data.days) : words.atOnce}</p>
        ${data.hidden_copies > 0 && html`<p>${words.hiddenCopies(data.hidden_copies)}</p>`}
        ${data.staying_count > 0 && html`<div class="staying"><p>${words.staying(data.staying_count)}</p>
          <ul>${data.staying.map(one => html`<li key=${one.session}>
            <a href=${href(['sessions', one.session])}>${one.task}, ${dateTime(one.recorded_at)}</a></li>`)}</ul>
          ${data.staying_count > data.staying.length && html`<p>${words.stayingMore(data.staying_count - data.staying.length)}</p>`}</div>`}
        <p>${words.copy}</p>
        <${DataLinks} trainee=${trainee.id} />
        <${Form} fields=${[{ name: 'name', label: words.typeName(trainee.name), required: true, autocomplete: 'off' }]}
          onSave=${erase} onCancel=${onClose} submit=${t.form.remove} danger />`}
    <//>`;
}

/** The trainees who wait for their erasure; nothing without any. @param {Props} props */
export function PendingErasures({ pending, onChange }) {
  const [now, setNow] = useState(null);
  const [problem, setProblem] = useState(null);
  if (!pending.length) return null;
  const restore = one => api.trainees.restore(one.id).then(onChange, setProblem);
  return html`
    <section class="card list">
      <header><h2>${words.title}</h2></header>
      <p class="body small muted">${words.body}</p>
      <${ProblemNotice} problem=${problem} />
      <ul class="queue">
        ${pending.map(one => html`
          <li key=${one.id}>
            <div><strong>${one.name}</strong><span class="small muted">
              ${words.due(dateTime(one.erased_at), one.sessions)}${one.who && ` · ${words.by(one.who)}`}</span></div>
            <div class="row ends">
              <button class="button" type="button" aria-label=${`${words.restore}: ${one.name}`} onClick=${() => restore(one)}>
                ${words.restore}</button>
              <button class="button bare" type="button" aria-label=${`${words.now}: ${one.name}`} onClick=${() => setNow(one)}>
                ${words.now}</button>
            </div>
          </li>`)}
      </ul>
      ${now && html`<${Confirm} title=${t.people.removeTitle(now.name)} body=${words.nowBody} yes=${words.now}
        onYes=${() => api.trainees.erase(now.id, false).then(onChange)} onClose=${() => setNow(null)} />`}
    </section>`;
}
