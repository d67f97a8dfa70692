// Who needs attention: sessions that may show another box, relapses, refreshers that are due, refused sessions, sessions that wait for a rating.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData, useThrottled } from '../../data.js';
import { date, dateTime } from '../../format.js';
import { useLive } from '../../live.js';
import { may } from '../../roles.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Empty, Loading, ProblemNotice } from '../page/notice.js';

const words = t.attention;
const RELOAD_MS = 30_000; // The service looks through many sessions, and the list is not urgent.
/** After so many days, what was put off is listed again. */
const LATER_DAYS = 7;
const TONES = { box_asked: 'warn', relapsed: 'bad', due: 'warn', refused: 'bad', unrated: '' };

/**
 * `own`: the page of a trainee, which shows no other people. `onLoaded()`: the list has its final length, so that
 * nothing below it moves any more.
 */
export function Attention({ own, person, onLoaded }) {
  const { data, problem, reload } = useData(async signal => {
    const [attention, waiting] = await Promise.all([api.attention(signal), may(person, 'see_trainees') ? api.waiting.count(signal) : null]);
    return { ...attention, waiting: waiting?.count ?? 0 };
  }, []);
  const reloadSoon = useThrottled(reload, RELOAD_MS);
  const isLoaded = Boolean(data ?? problem);
  useEffect(() => void (isLoaded && onLoaded()), [isLoaded]);
  useLive('session', event => event.status === 'done' && reloadSoon());
  useLive('resync', reloadSoon);
  const items = data ? [...sessionItems('box_asked', data.box_asked), ...data.alarms.map(alarmItem), ...sessionItems('refused', data.refused),
    ...sessionItems('unrated', data.unrated)] : [];
  const dismissals = useDismissals(reload);
  const mayDismiss = may(person, 'rate');
  return html`
    <section class="card wide">
      <header><h2>${own ? words.own : words.title}</h2></header>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      <${ProblemNotice} problem=${dismissals.problem} onDismiss=${dismissals.forgetProblem} />
      <${LastDismissal} last=${dismissals.last} undo=${dismissals.undo} />
      ${!data && !problem && html`<${Loading} />`}
      ${data && data.waiting > 0 && html`<ul class="queue"><li><div><a href=${href(['waiting'])}>${t.waiting.mark(data.waiting)}</a></div>
        <span class="pill warn">${t.nav.waiting}</span></li></ul>`}
      ${data && items.length === 0 && data.waiting === 0 && html`<${Empty} title=${own ? words.noneOwn : words.none} body=${own ? words.noneOwnBody : words.noneBody} />`}
      ${items.length > 0 && html`<ul class="queue">${items.map(one => html`<${Item} key=${one.key} item=${one}
        dismiss=${mayDismiss && dismissals.dismiss} />`)}</ul>`}
      ${data && data.dismissed > 0 && html`<${Dismissed} count=${data.dismissed} undo=${dismissals.undo} />`}
      ${data?.more && html`<p class="body small muted">${words.more}</p>`}
    </section>`;
}

/** Dismissing entries, with the last one for taking it back. @param {() => void} reload */
function useDismissals(reload) {
  const [last, setLast] = useState(/** @type {{ id: string, name: string } | null} */ (null));
  const [problem, setProblem] = useState(/** @type {import('../../api.js').Problem | null} */ (null));
  const run = work => {
    setProblem(null);
    return work().then(reload, error => setProblem(asProblem(error)));
  };
  const dismiss = (item, days) =>
    run(async () => {
      const { id } = await api.dismiss({ ...item.dismissal, ...(days ? { days } : {}) });
      setLast({ id, name: item.name });
    });
  const undo = id =>
    run(async () => {
      await api.undoDismissal(id);
      setLast(null);
    });
  return { last, problem, forgetProblem: () => setProblem(null), dismiss, undo };
}

/** @param {Props} props */
const LastDismissal = ({ last, undo }) => last && html`<p class="body row small" role="status">${words.dismissed(last.name)}
  <button class="button" type="button" onClick=${() => undo(last.id)}>${words.undo}</button></p>`;

/** What the person has dismissed, loaded when it is opened. @param {Props} props */
function Dismissed({ count, undo }) {
  const [open, setOpen] = useState(false);
  const { data, problem, reload } = useData(signal => (open ? api.dismissals(signal) : null), [open, count]);
  return html`
    <details class="body small" onToggle=${event => setOpen(event.currentTarget.open)}>
      <summary>${words.dismissedBefore(count)}</summary>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${data && html`<ul class="queue">${data.map(one => html`<li key=${one.id}>
        <div><span>${one.trainee.name} · ${one.task.name}</span><span class="small muted">${words[one.kind]} · ${one.until
          ? words.until(date(one.until)) : words.since(date(one.created_at))}</span></div>
        <button class="button" type="button" aria-label=${words.undoThis(`${one.trainee.name} · ${one.task.name}`)}
          onClick=${() => undo(one.id)}>${words.undo}</button></li>`)}</ul>`}
    </details>`;
}

/** @param {Schemas['Attention']['alarms'][number]} alarm */
const alarmItem = ({ kind, trainee, trainee_name, task, task_name, session, since }) => ({
  dismissal: { kind, trainee, task, since },
  key: `${kind} ${trainee} ${task}`, kind, session, name: `${trainee_name} · ${task_name}`,
  to: href(['trainees', trainee], { task }), when: words.since(date(since)),
});

/**
 * One item for all the sessions of a trainee at a task, in the order of the first.
 *
 * @param {string} kind
 * @param {Schemas['SessionToReview'][]} sessions
 */
function sessionItems(kind, sessions) {
  const groups = new Map();
  for (const one of sessions) {
    const key = `${kind} ${one.trainee.id} ${one.task.id}`;
    groups.set(key, [...(groups.get(key) ?? []), one]);
  }
  return [...groups].map(([key, [first, ...others]]) => ({
    dismissal: { kind, trainee: first.trainee.id, task: first.task.id, sessions: [first, ...others].map(one => one.session) },
    key, kind, name: `${first.trainee.name} · ${first.task.name}`, to: href(['sessions', first.session]), when: dateTime(first.recorded_at), others,
  }));
}

/** @param {Props} props */
const Item = ({ item, dismiss }) => html`
  <li>
    <div><a href=${item.to}>${item.name}</a><span class="small muted">${item.when}</span>
      ${item.session && html`<a class="small" href=${href(['sessions', item.session])}>${words.session}</a>`}
      ${item.others?.length > 0 && html`<details class="small"><summary>${words.others(item.others.length)}</summary>
        <ul>${item.others.map(one => html`<li key=${one.session}><a href=${href(['sessions', one.session])}>${dateTime(one.recorded_at)}</a></li>`)}</ul>
      </details>`}</div>
    <span class="row ends"><span class=${`pill ${TONES[item.kind]}`}>${words[item.kind]}</span>
      ${dismiss && html`<button class="button bare" type="button" aria-label=${words.laterThis(item.name)}
        title=${words.laterTitle} onClick=${() => dismiss(item, LATER_DAYS)}>${words.later}</button>`}
      ${dismiss && item.kind !== 'box_asked' && html`<button class="button bare" type="button" aria-label=${words.dismissThis(item.name)}
        title=${words.dismissTitle} onClick=${() => dismiss(item)}>${words.dismiss}</button>`}</span>
  </li>`;
