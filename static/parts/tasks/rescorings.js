// Rescoring a task's sessions: order it, watch it, cancel it, and see what it changed for each trainee.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData, usePages, useThrottled } from '../../data.js';
import { dateTime, number, unit } from '../../format.js';
import { useLive } from '../../live.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { featureWithTool } from '../../translate.js';
import { Confirm, Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Empty, Loading, ProblemNotice } from '../page/notice.js';
import { ProgressBar } from '../page/status.js';

const words = t.rescoring;
const POLL_MS = 3_000; // While one is running; events of the queue are faster.
/** Items per page of the lists of changes. */
const [TRAINEES_PAGE, SESSIONS_PAGE] = [50, 20];
const CHANGES = ['no_longer_passed', 'now_passed', 'apart', 'changed'];

/** @param {Props} props */
export function Rescorings({ task }) {
  const { data, problem, reload } = useData(async () => {
    const all = await api.rescorings.all();
    return all.filter(order => order.task.id === task.id);
  }, [task.id]);
  const [open, setOpen] = useState(null);
  const reloadSoon = useThrottled(reload, 1500);
  const isRunning = data?.some(order => !order.ended_at);
  useLive('queue', () => isRunning && reloadSoon());
  useEffect(() => {
    if (!isRunning) return undefined;
    const timer = setInterval(reloadSoon, POLL_MS);
    return () => clearInterval(timer);
  }, [isRunning]);
  const close = () => setOpen(null);
  const submitOrder = values => api.tasks.rescore(task.id, values).then(() => (close(), reload()));
  return html`
    <section class="card">
      <header><h2>${words.title}</h2><button class="button" type="button" onClick=${() => setOpen('new')}>${words.start}</button></header>
      <p class="body muted">${words.lead}</p>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      ${data?.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
      ${data && data.length > 0 && html`<ul class="queue history">${data.map(one => html`
        <${Order} key=${one.id} order=${one} onCancel=${() => setOpen(one)} />`)}</ul>`}
      ${open === 'new' && html`<${Dialog} title=${words.start} onClose=${close}>
        <${Form} fields=${FIELDS} onSave=${submitOrder} onCancel=${close} submit=${words.order} busyWords=${words.ordering} /><//>`}
      ${open?.id && html`<${Confirm} title=${words.cancelTitle} body=${words.cancelBody} yes=${words.cancel}
        onYes=${() => api.rescorings.cancel(open.id).then(reload)} onClose=${close} />`}
    </section>`;
}

const FIELDS = [
  { name: 'from', label: words.from, type: 'select', options: Object.entries(words.sources), value: 'trajectory', wide: true },
  { name: 'which', label: words.which, type: 'select', options: Object.entries(words.whiches), value: 'older', wide: true },
];

function Order({ order, onCancel }) {
  const { sessions, changes } = order;
  const [isOpen, setOpen] = useState(false);
  const isRunning = !order.ended_at && !order.cancelled_at;
  const name = words.orderOf(dateTime(order.created_at), order.who);
  return html`
    <li>
      <div class="row apart">
        <strong>${name}</strong>
        <span class="row">
          <span class="small muted">${words.progress(sessions.done, sessions.all)}${sessions.failed ? `; ${words.failed(sessions.failed)}` : ''}${
            order.cancelled_at ? `; ${words.called}` : ''}</span>
          ${isRunning && html`<button class="button danger" type="button" aria-label=${`${words.cancel}: ${name}`} onClick=${onCancel}>
            ${words.cancel}</button>`}
          <button class="button" type="button" aria-expanded=${isOpen} aria-label=${`${words.report}: ${name}`}
            onClick=${() => setOpen(!isOpen)}>${isOpen ? words.hide : words.report}</button>
        </span>
      </div>
      ${isRunning && html`<${ProgressBar} value=${order.progress} name=${name} />`}
      <p class="small">${changedWords(changes, sessions.done)}</p>
      ${isOpen && html`<${Report} order=${order} />`}
    </li>`;
}

const changedWords = (changes, done) => {
  if (!done) return words.notYet;
  const parts = CHANGES.filter(name => changes[name] > 0).map(name => `${changes[name]} ${words.changes[name]}`);
  return parts.length ? `${parts.join('; ')}.` : words.nothing;
};

function Report({ order }) {
  const now = [order.id, order.sessions.done];
  const trainees = usePages((cursor, signal) => api.rescorings.trainees(order.id, { limit: TRAINEES_PAGE, cursor }, signal), now);
  const sessions = usePages((cursor, signal) => api.rescorings.sessions(order.id, { limit: SESSIONS_PAGE, cursor }, signal), now);
  return html`
    <${ChangedTrainees} pages=${trainees} />
    <${ChangedSessions} pages=${sessions} />`;
}

/** What is loading, what failed, and the button for the next page. */
const PageFooter = ({ pages: { items, next, problem, busy, more }, name }) => html`
  <${ProblemNotice} problem=${problem} onRetry=${more} />
  ${!items && !problem && html`<${Loading} />`}
  ${next && !problem && html`<div class="pager"><button class="button" type="button" aria-disabled=${busy} onClick=${more}>
    ${busy ? t.loading : name}</button></div>`}`;

function ChangedTrainees({ pages }) {
  const { items } = pages;
  if (items?.length === 0) return html`<p class="muted">${words.noTrainees}</p>`;
  return html`
    ${items && html`<div class="scroll"><table class="table dense">
      <thead><tr><th scope="col">${words.trainee}</th><th scope="col" class="number">${words.sessions}</th><th scope="col">${words.report}</th></tr></thead>
      <tbody>${items.map(one => html`<tr key=${one.trainee.id}>
        <th scope="row"><a href=${href(['trainees', one.trainee.id])}>${one.trainee.name}</a></th>
        <td class="number">${words.progress(one.done, one.sessions)}</td><td>${changedWords(one.changes, one.done)}</td></tr>`)}</tbody>
    </table></div>`}
    <${PageFooter} pages=${pages} name=${words.moreTrainees} />`;
}

/** The service lists the most changed sessions first: after one without a change, no session has changed. */
function ChangedSessions({ pages }) {
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
        <td class="small">${one.features.filter(feature => feature.change === 'apart').slice(0, 4).map(feature => html`<div key=${`${feature.feature} ${feature.tool} ${feature.space}`}>
          ${words.was(featureWithTool(feature), valueOf(feature.old, feature.unit), valueOf(feature.new, feature.unit))}</div>`)}</td></tr>`)}</tbody>
    </table></div>`}
    <${PageFooter} pages=${isAll ? { ...pages, next: null } : pages} name=${words.moreSessions} />`;
}

const valueOf = (feature, name) => (feature ? `${number(feature.value)} ${unit(name)}`.trim() : '–');
