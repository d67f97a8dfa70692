// Who needs attention: sessions that may show another box, relapses, refreshers that are due, refused sessions, sessions that wait for a rating.
import { html, useEffect } from '../../preact.js';
import { api } from '../../api.js';
import { useData, useThrottled } from '../../data.js';
import { date, dateTime } from '../../format.js';
import { useLive } from '../../live.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Empty, Loading, ProblemNotice } from '../page/notice.js';

const words = t.attention;
const RELOAD_MS = 30_000; // The service looks through many sessions, and the list is not urgent.
const TONES = { box_asked: 'warn', relapsed: 'bad', due: 'warn', refused: 'bad', unrated: '' };

/**
 * `own`: the page of a trainee, which shows no other people. `onLoaded()`: the list has its final length, so that
 * nothing below it moves any more.
 */
export function Attention({ own, onLoaded }) {
  const { data, problem, reload } = useData(signal => api.attention(signal), []);
  const reloadSoon = useThrottled(reload, RELOAD_MS);
  const isLoaded = Boolean(data ?? problem);
  useEffect(() => void (isLoaded && onLoaded()), [isLoaded]);
  useLive('session', event => event.status === 'done' && reloadSoon());
  useLive('resync', reloadSoon);
  const items = data ? [...sessionItems('box_asked', data.box_asked), ...data.alarms.map(alarmItem), ...sessionItems('refused', data.refused),
    ...sessionItems('unrated', data.unrated)] : [];
  return html`
    <section class="card wide">
      <header><h2>${own ? words.own : words.title}</h2></header>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      ${data && items.length === 0 && html`<${Empty} title=${own ? words.noneOwn : words.none} body=${own ? words.noneOwnBody : words.noneBody} />`}
      ${items.length > 0 && html`<ul class="queue">${items.map(one => html`<${Item} key=${one.key} item=${one} />`)}</ul>`}
      ${data?.more && html`<p class="body small muted">${words.more}</p>`}
    </section>`;
}

/** @param {Schemas['Attention']['alarms'][number]} alarm */
const alarmItem = ({ kind, trainee, trainee_name, task, task_name, session, since }) => ({
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
    key, kind, name: `${first.trainee.name} · ${first.task.name}`, to: href(['sessions', first.session]), when: dateTime(first.recorded_at), others,
  }));
}

const Item = ({ item }) => html`
  <li>
    <div><a href=${item.to}>${item.name}</a><span class="small muted">${item.when}</span>
      ${item.session && html`<a class="small" href=${href(['sessions', item.session])}>${words.session}</a>`}
      ${item.others?.length > 0 && html`<details class="small"><summary>${words.others(item.others.length)}</summary>
        <ul>${item.others.map(one => html`<li key=${one.session}><a href=${href(['sessions', one.session])}>${dateTime(one.recorded_at)}</a></li>`)}</ul>
      </details>`}</div>
    <span class=${`pill ${TONES[item.kind]}`}>${words[item.kind]}</span>
  </li>`;
