// A task's sessions scored again: ordered here, watched, called off, and what it changed for whom.
import { html, useEffect, useState } from './preact.js';
import { api } from '../api.js';
import { useData, usePages, useThrottled } from '../data.js';
import { dateTime, number, unit } from '../format.js';
import { useLive } from '../live.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Confirm, Dialog } from './dialog.js';
import { Form } from './form.js';
import { Empty, Loading, ProblemNotice } from './notice.js';
import { ProgressBar } from './status.js';

const words = t.rescoring;
const LOOK_MS = 3_000; // While one goes on; events of the queue tell sooner.
/** So many at once of what changed. */
const [TRAINEES, SESSIONS] = [50, 20];
const CHANGES = ['no_longer_passed', 'now_passed', 'apart', 'changed'];

export function Rescorings({ task }) {
  const { data, problem, reload } = useData(async () => {
    const all = await api.rescorings.all();
    return all.filter(order => order.task.id === task.id);
  }, [task.id]);
  const [open, setOpen] = useState(null);
  const soon = useThrottled(reload, 1500);
  const runs = data?.some(order => !order.ended_at);
  useLive('queue', () => runs && soon());
  useEffect(() => {
    if (!runs) return undefined;
    const timer = setInterval(soon, LOOK_MS);
    return () => clearInterval(timer);
  }, [runs]);
  const close = () => setOpen(null);
  const order = values => api.tasks.rescore(task.id, values).then(() => (close(), reload()));
  return html`
    <section class="card">
      <header><h2>${words.title}</h2><button class="button" type="button" onClick=${() => setOpen('new')}>${words.start}</button></header>
      <p class="body muted">${words.lead}</p>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      ${data?.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
      ${data?.length > 0 && html`<ul class="queue history">${data.map(one => html`
        <${Order} key=${one.id} order=${one} onCancel=${() => setOpen(one)} />`)}</ul>`}
      ${open === 'new' && html`<${Dialog} title=${words.start} onClose=${close}>
        <${Form} fields=${FIELDS} onSave=${order} onCancel=${close} submit=${words.order} busyWords=${words.ordering} /><//>`}
      ${open?.id && html`<${Confirm} title=${words.cancelTitle} body=${words.cancelBody} yes=${words.cancel}
        onYes=${() => api.rescorings.remove(open.id).then(reload)} onClose=${close} />`}
    </section>`;
}

const FIELDS = [
  { name: 'from', label: words.from, type: 'select', options: Object.entries(words.sources), value: 'trajectory', wide: true },
  { name: 'which', label: words.which, type: 'select', options: Object.entries(words.whiches), value: 'older', wide: true },
];

function Order({ order, onCancel }) {
  const { sessions, changes } = order;
  const [shows, setShows] = useState(false);
  const goesOn = !order.ended_at && !order.cancelled_at;
  const name = words.orderOf(dateTime(order.created_at), order.who);
  return html`
    <li>
      <div class="row apart">
        <strong>${name}</strong>
        <span class="row">
          <span class="small muted">${words.progress(sessions.done, sessions.all)}${sessions.failed ? `; ${words.failed(sessions.failed)}` : ''}${
            order.cancelled_at ? `; ${words.called}` : ''}</span>
          ${goesOn && html`<button class="button danger" type="button" aria-label=${`${words.cancel}: ${name}`} onClick=${onCancel}>
            ${words.cancel}</button>`}
          <button class="button" type="button" aria-expanded=${shows} aria-label=${`${words.report}: ${name}`}
            onClick=${() => setShows(!shows)}>${shows ? words.hide : words.report}</button>
        </span>
      </div>
      ${goesOn && html`<${ProgressBar} value=${order.progress} name=${name} />`}
      <p class="small">${changedWords(changes, sessions.done)}</p>
      ${shows && html`<${Report} order=${order} />`}
    </li>`;
}

const changedWords = (changes, done) => {
  if (!done) return words.notYet;
  const said = CHANGES.filter(name => changes[name] > 0).map(name => `${changes[name]} ${words.changes[name]}`);
  return said.length ? `${said.join('; ')}.` : words.nothing;
};

function Report({ order }) {
  const now = [order.id, order.sessions.done];
  const trainees = usePages((cursor, signal) => api.rescorings.trainees(order.id, { limit: TRAINEES, cursor }, signal), now);
  const sessions = usePages((cursor, signal) => api.rescorings.sessions(order.id, { limit: SESSIONS, cursor }, signal), now);
  return html`
    <${OfTrainees} pages=${trainees} />
    <${OfSessions} pages=${sessions} />`;
}

/** What is under way, what failed, and the way to the next page. */
const Rest = ({ pages: { items, next, problem, busy, more }, name }) => html`
  <${ProblemNotice} problem=${problem} onRetry=${more} />
  ${!items && !problem && html`<${Loading} />`}
  ${next && !problem && html`<div class="pager"><button class="button" type="button" aria-disabled=${busy} onClick=${more}>
    ${busy ? t.loading : name}</button></div>`}`;

function OfTrainees({ pages }) {
  const { items } = pages;
  if (items?.length === 0) return html`<p class="muted">${words.noTrainees}</p>`;
  return html`
    ${items && html`<div class="scroll"><table class="table dense">
      <thead><tr><th scope="col">${words.trainee}</th><th scope="col" class="number">${words.sessions}</th><th scope="col">${words.report}</th></tr></thead>
      <tbody>${items.map(one => html`<tr key=${one.trainee.id}>
        <th scope="row"><a href=${href(['trainees', one.trainee.id])}>${one.trainee.name}</a></th>
        <td class="number">${words.progress(one.done, one.sessions)}</td><td>${changedWords(one.changes, one.done)}</td></tr>`)}</tbody>
    </table></div>`}
    <${Rest} pages=${pages} name=${words.moreTrainees} />`;
}

/** The service tells those that changed most first: after one that did not change none did. */
function OfSessions({ pages }) {
  const isChanged = one => one.new && (one.changed > 0 || one.old.judgement !== one.new.judgement);
  const changed = pages.items?.filter(isChanged) ?? [];
  const isAll = pages.items && changed.length < pages.items.length;
  return html`
    ${changed.length > 0 && html`<h3>${words.changedSessions}</h3><div class="scroll"><table class="table dense">
      <thead><tr><th scope="col">${words.session}</th><th scope="col">${words.before}</th><th scope="col">${words.after}</th>
        <th scope="col">${words.feature}</th></tr></thead>
      <tbody>${changed.map(one => html`<tr key=${one.session}>
        <th scope="row"><a href=${href(['sessions', one.session])}>${one.trainee.name}, ${dateTime(one.recorded_at)}</a></th>
        <td>${words.judgements[one.old.judgement] ?? '–'}</td><td>${words.judgements[one.new.judgement] ?? '–'}</td>
        <td class="small">${one.features.filter(of => of.change === 'apart').slice(0, 4).map(of => html`<div key=${`${of.feature} ${of.tool}`}>
          ${words.was([of.title, of.tool].filter(Boolean).join(', '), valueOf(of.old, of.unit), valueOf(of.new, of.unit))}</div>`)}</td></tr>`)}</tbody>
    </table></div>`}
    <${Rest} pages=${isAll ? { ...pages, next: null } : pages} name=${words.moreSessions} />`;
}

const valueOf = (of, name) => (of ? `${number(of.value)} ${unit(name)}`.trim() : '–');
