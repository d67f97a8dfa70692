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
  const items = data ? [...data.box_asked.map(sessionItem('box_asked')), ...data.alarms.map(alarmItem), ...data.refused.map(sessionItem('refused')), ...data.unrated.map(sessionItem('unrated'))] : [];
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

const sessionItem = kind => ({ session, trainee, task, recorded_at }) => ({
  key: `${kind} ${session}`, kind, name: `${trainee.name} · ${task.name}`, to: href(['sessions', session]), when: dateTime(recorded_at),
});

const Item = ({ item }) => html`
  <li>
    <div><a href=${item.to}>${item.name}</a><span class="small muted">${item.when}</span>
      ${item.session && html`<a class="small" href=${href(['sessions', item.session])}>${words.session}</a>`}</div>
    <span class=${`pill ${TONES[item.kind]}`}>${words[item.kind]}</span>
  </li>`;
