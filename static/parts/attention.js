// Who needs somebody: relapses, refreshers that are due, sessions that were refused, sessions that wait for a rating.
import { html, useEffect } from './preact.js';
import { api } from '../api.js';
import { useData, useThrottled } from '../data.js';
import { date, dateTime } from '../format.js';
import { useLive } from '../live.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Empty, Loading, ProblemNotice } from './notice.js';

const words = t.attention;
const AGAIN_MS = 30_000; // It looks through many sessions; a minute's delay hurts nobody.
const TONES = { relapsed: 'bad', due: 'warn', refused: 'bad', unrated: '' };

/** `own`: the page is a trainee's, who is told of nobody else. `onTold()`: the list is as long as it is, nothing below it moves any more. */
export function Attention({ own, onTold }) {
  const { data, problem, reload } = useData(signal => api.attention(signal), []);
  const soon = useThrottled(reload, AGAIN_MS);
  const isTold = Boolean(data ?? problem);
  useEffect(() => void (isTold && onTold()), [isTold]);
  useLive('session', event => event.status === 'done' && soon());
  useLive('resync', soon);
  const items = data ? [...data.alarms.map(alarm), ...data.refused.map(of('refused')), ...data.unrated.map(of('unrated'))] : [];
  return html`
    <section class="card wide">
      <header><h2>${own ? words.own : words.title}</h2></header>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      ${data && items.length === 0 && html`<${Empty} title=${own ? words.noneOwn : words.none} body=${own ? words.noneOwnBody : words.noneBody} />`}
      ${items.length > 0 && html`<ul class="queue">${items.map(one => html`<${Item} key=${one.key} one=${one} />`)}</ul>`}
      ${data?.more && html`<p class="body small muted">${words.more}</p>`}
    </section>`;
}

const alarm = ({ kind, trainee, trainee_name, task, task_name, session, since }) => ({
  key: `${kind} ${trainee} ${task}`, kind, session, name: `${trainee_name} · ${task_name}`,
  to: href(['trainees', trainee], { task }), when: words.since(date(since)),
});

const of = kind => ({ session, trainee, task, recorded_at }) => ({
  key: `${kind} ${session}`, kind, name: `${trainee.name} · ${task.name}`, to: href(['sessions', session]), when: dateTime(recorded_at),
});

const Item = ({ one }) => html`
  <li>
    <div><a href=${one.to}>${one.name}</a><span class="small muted">${one.when}</span>
      ${one.session && html`<a class="small" href=${href(['sessions', one.session])}>${words.session}</a>`}</div>
    <span class=${`pill ${TONES[one.kind]}`}>${words[one.kind]}</span>
  </li>`;
