// Today: the queue moving, what needs a person, and what is new.
import { html, useState } from '../parts/preact.js';
import { api } from '../api.js';
import { useData, useThrottled } from '../data.js';
import { dateTime } from '../format.js';
import { useLive, useLiveState } from '../live.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Attention } from '../parts/attention.js';
import { icons } from '../parts/icons.js';
import { Announce, Empty, Loading, PageHead, ProblemNotice } from '../parts/notice.js';
import { OwnCourses } from '../parts/own_courses.js';
import { traineeId } from '../parts/shell.js';
import { isMoving, ProgressBar, StatusPill, stateOf } from '../parts/status.js';
import { Prose } from '../parts/prose.js';

const words = t.today;
const DAY_MS = 86_400_000;
const SHOWN = 8;
const COUNTED = 50;
const AGAIN_MS = 5_000;

/** One request per state: a busy centre's newest page alone would hide what still waits below it. */
async function load(signal) {
  const ask = status => api.sessions.page({ status, limit: COUNTED }, signal);
  const [receiving, queued, tracking, failed] = await Promise.all(['receiving', 'queued', 'tracking', 'failed'].map(ask));
  return {
    moving: [...tracking.items, ...queued.items, ...receiving.items],
    failed: failed.items,
    moreFailed: failed.next !== null,
  };
}

/** The newest scored sessions, and how many are of the last day. They come with all their features: nothing else waits for them, and
 *  they are not read anew with every step of the queue. */
function useScored() {
  const { data, problem, reload } = useData(signal => api.sessions.page({ status: 'done', limit: COUNTED }, signal), []);
  const soon = useThrottled(reload, AGAIN_MS);
  useLive('session', event => event.status === 'done' && soon());
  useLive('resync', soon);
  if (!data) return { items: null, count: '…', problem, reload };
  const recent = data.items.filter(session => Date.now() - Date.parse(session.created_at) < DAY_MS).length;
  const isMore = data.next && recent === data.items.length; // Those that are not read may be of the same day.
  return { items: data.items.slice(0, SHOWN), count: `${recent}${isMore ? '+' : ''}`, problem, reload };
}

export default function Today({ person }) {
  const { data, problem, reload } = useData(load, []);
  const [progress, setProgress] = useState({});
  const [said, setSaid] = useState('');
  const [counted, setCounted] = useState(null); // The service's own count, also of what is below the first page.
  const soon = useThrottled(reload, 700);
  const scored = useScored();
  const trainee = traineeId(person);
  const own = useData(async signal => (trainee ? api.trainees.courses(trainee, signal) : []), []);
  const [isTold, setTold] = useState(false);

  useLive('resync', () => {
    reload();
    if (!own.data) own.reload(); // Once they are told, their own part asks again.
  });
  useLive('queue', counts => {
    setCounted(counts);
    soon();
  });
  useLive('session', event => {
    setProgress(before => ({ ...before, [event.id]: event }));
    const known = data?.moving.find(session => session.id === event.id);
    if (known?.status === event.status) return; // Only progress: the bar alone moves.
    if (known) setSaid(words.announce(known.filename, t.status[event.status] ?? event.status));
    soon();
  });

  if (!data || !(own.data ?? own.problem)) // All at once: nothing that comes later pushes it aside.
    return html`<${PageHead} title=${words.title} lead=${words.lead} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const moving = data.moving.map(session => ({ ...session, ...progress[session.id] })).filter(isMoving);
  const count = status => moving.filter(session => session.status === status).length;
  const whole = may(person, 'retry') ? counted : null; // A trainee is shown their own recordings only.
  const failed = [{ problem, reload }, scored, own].find(one => one.problem);
  const mayUpload = may(person, 'upload') || may(person, 'upload_own');
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>
      <${LiveState} />
      ${mayUpload && html`<a class="button main" href=${href(['upload'])}><${icons.upload} />${words.upload}</a>`}
    <//>
    <${ProblemNotice} problem=${failed?.problem} onRetry=${failed?.reload} />
    <${Announce}>${said}<//>
    ${trainee && own.data && html`<div class="stack own-courses"><${OwnCourses} trainee=${trainee} first=${own.data} brief /></div>`}
    <dl class="figures">
      <${Figure} name=${words.queued} value=${whole?.queued ?? count('queued')} />
      <${Figure} name=${words.running} value=${whole?.running ?? count('tracking')} />
      <${Figure} name=${words.finished} value=${scored.count} />
      <${Figure} name=${words.attention} value=${`${data.failed.length}${data.moreFailed ? '+' : ''}`} />
    </dl>
    <div class="columns">
      <${List} title=${words.moving} items=${moving} row=${Moving} empty=${words.emptyQueue}
        emptyBody=${words.emptyQueueBody} more=${may(person, 'watch') && count('receiving') > 0 && href(['live'])}
        moreWords=${words.watch} />
      <${List} title=${words.attentionTitle} items=${data.failed} row=${Failed} empty=${words.emptyAttention}
        emptyBody=${words.emptyAttentionBody} />
      <${Attention} own=${!may(person, 'see_trainees')} onTold=${() => setTold(true)} />
      ${isTold && html`<${List} title=${words.recent} items=${scored.items} row=${Done} empty=${words.emptyRecent}
        emptyBody=${words.emptyRecentBody} more=${href(['sessions'])} moreWords=${words.all} wide />`}
    </div>`;
}

const TONES = { open: 'good', connecting: '', polling: 'warn', closed: 'warn' };

function LiveState() {
  const state = useLiveState();
  return html`<span class=${`pill ${TONES[state]}`} role="status">${t.live[state]}</span>`;
}

const Figure = ({ name, value }) => html`<div class="card figure"><dt>${name}</dt><dd>${value}</dd></div>`;

const List = ({ title, items, row: Row, empty, emptyBody, more, moreWords, wide }) => html`
  <section class=${`card ${wide ? 'wide' : ''}`}>
    <header><h2>${title}</h2>${more && html`<a href=${more}>${moreWords}</a>`}</header>
    ${!items ? html`<${Loading} />` : items.length ? html`<ul class="queue">${items.map(session => html`<${Row} key=${session.id}
      session=${session} />`)}</ul>` : html`<${Empty} title=${empty} body=${emptyBody} />`}
  </section>`;

const Name = ({ session }) => html`
  <div>
    <a href=${href(['sessions', session.id])}>${session.trainee?.name} · ${session.task?.name}</a>
    <span class="small muted">${session.filename} · ${dateTime(session.recorded_at ?? session.created_at)}</span>
  </div>`;

const Moving = ({ session }) => html`
  <li>
    <${Name} session=${session} />
    <${StatusPill} state=${session.status} />
    ${session.status === 'queued'
      ? session.queue_position !== undefined && session.queue_position !== null && html`<p class="why">
      ${words.position(session.queue_position)}</p>`
      : session.status === 'tracking' && html`<${ProgressBar} value=${session.progress} name=${session.filename} />`}
  </li>`;

const Failed = ({ session }) => html`
  <li>
    <${Name} session=${session} />
    <${StatusPill} state=${stateOf(session)} />
    ${session.error && html`<p class="why">${session.error.title}. <${Prose} text=${session.error.detail} lang=${session.error.lang} /></p>`}
  </li>`;

const Done = ({ session }) => html`<li><${Name} session=${session} /><${StatusPill} state=${stateOf(session)} /></li>`;
