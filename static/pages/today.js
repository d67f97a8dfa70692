// Today: the queue, what needs a person's attention, and new results.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData, useThrottled } from '../data.js';
import { dateTime } from '../format.js';
import { useLive, useLiveState, useQueueCounts } from '../live.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { problemTitle } from '../translate.js';
import { FirstSteps } from '../parts/guide/first_steps.js';
import { useHidden } from '../parts/guide/followed.js';
import { useFirstSteps } from '../parts/guide/guide_state.js';
import { Attention } from '../parts/people/attention.js';
import { ConsentAsked } from '../parts/people/consent.js';
import { icons } from '../parts/page/icons.js';
import { Announce, Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { OwnCourses } from '../parts/courses/own_courses.js';
import { TraineeHome } from '../parts/people/trainee_home.js';
import { traineeId } from '../parts/page/shell.js';
import { isMoving, Outcome, ProgressBar, stateOf, StatusPill } from '../parts/page/status.js';
import { ProblemDetail } from '../parts/page/prose.js';

const words = t.today;
const DAY_MS = 86_400_000;
const MAX_SHOWN = 8;
const PAGE_SIZE = 50;
const RELOAD_MS = 5_000;

/** One request per state: in a busy centre the newest sessions alone would hide those that still wait. */
async function load(signal) {
  const pageOf = status => api.sessions.page({ status, limit: PAGE_SIZE }, signal);
  const [receiving, queued, tracking, failed] = await Promise.all(['receiving', 'queued', 'tracking', 'failed'].map(pageOf));
  return {
    moving: [...tracking.items, ...queued.items, ...receiving.items],
    failed: failed.items,
    moreFailed: failed.next !== null,
  };
}

/**
 * The newest scored sessions, and how many of them are of the last 24 h. They come with all their features, so nothing
 * else waits for them, and they are not loaded again with every step of the queue.
 */
function useScored() {
  const { data, problem, reload } = useData(signal => api.sessions.page({ status: 'done', limit: PAGE_SIZE }, signal), []);
  const reloadSoon = useThrottled(reload, RELOAD_MS);
  useLive('session', event => event.status === 'done' && reloadSoon());
  useLive('resync', reloadSoon);
  if (!data) return { items: null, count: '…', problem, reload };
  const recent = data.items.filter(session => Date.now() - Date.parse(session.created_at) < DAY_MS).length;
  const isMore = data.next && recent === data.items.length; // Sessions beyond this page may be of the same day.
  return { items: data.items.slice(0, MAX_SHOWN), count: `${recent}${isMore ? '+' : ''}`, problem, reload };
}

/** @param {Props} props */
export default function Today({ person }) {
  return may(person, 'see_trainees') ? html`<${StaffToday} person=${person} />` : html`<${Overview} person=${person} />`;
}

/** While the centre has no recording, the way through the first steps. @param {Props} props */
function StaffToday({ person }) {
  const { data: guide, reload } = useFirstSteps([]);
  const [isHidden, hide] = useHidden(person);
  const reloadSoon = useThrottled(() => guide?.is_empty && reload(), RELOAD_MS);
  useLive('queue', reloadSoon);
  useLive('session', reloadSoon);
  if (!guide?.is_empty || isHidden) return html`<${Overview} person=${person} hiddenGuide=${guide?.is_empty} />`;
  return html`<${PageHead} title=${words.title} lead=${t.firstSteps.lead} /><${FirstSteps} guide=${guide} onHide=${() => hide(true)} />`;
}

/** @param {Props} props */
function Overview({ person, hiddenGuide }) {
  const { data, problem, reload } = useData(load, []);
  const [progress, setProgress] = useState({});
  const [announcement, setAnnouncement] = useState('');
  const [queueCounts, liveState] = [useQueueCounts(), useLiveState()];
  const reloadSoon = useThrottled(reload, 700);
  const scored = useScored();
  const trainee = traineeId(person);
  const own = useData(async signal => {
    if (!trainee) return { courses: [], consent: null };
    const [courses, consent] = await Promise.all([api.trainees.courses(trainee, signal), api.trainees.consent(trainee, signal)]);
    return { courses, consent };
  }, []);
  const [isAttentionLoaded, setAttentionLoaded] = useState(false);

  useLive('resync', () => {
    reload();
    if (!own.data) own.reload(); // Once loaded, the courses reload by themselves.
  });
  useLive('queue', reloadSoon);
  useLive('session', event => {
    setProgress(before => ({ ...before, [event.id]: event }));
    const known = data?.moving.find(session => session.id === event.id);
    // Only the progress changed: the bar alone moves. A recording that arrives has none; its sender came or went.
    if (known?.status === event.status && event.status !== 'receiving') return;
    if (known && known.status !== event.status) setAnnouncement(words.announce(known.filename, t.status[event.status] ?? event.status));
    reloadSoon();
  });

  const isHomeLoaded = !trainee || scored.items || scored.problem;
  if (!data || !(own.data ?? own.problem) || !isHomeLoaded) // Everything appears at once, so that nothing is pushed aside later.
    return html`<${PageHead} title=${words.title} lead=${trainee ? t.home.lead : words.lead} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const moving = data.moving.map(session => ({ ...session, ...progress[session.id] })).filter(isMoving);
  const count = status => moving.filter(session => session.status === status).length;
  // The service's own counts include sessions beyond the first page. Without its events, the sessions shown are counted.
  const isFollowed = ['connecting', 'open'].includes(liveState);
  const shownCounts = queueCounts ?? (isFollowed ? { queued: '…', running: '…' } : { queued: count('queued'), running: count('tracking') });
  const failed = [{ problem, reload }, scored, own].find(one => one.problem);
  const mayUpload = may(person, 'upload') || may(person, 'upload_own');
  return html`
    <${PageHead} title=${words.title} lead=${trainee ? t.home.lead : words.lead}>
      <${LiveState} />
      ${hiddenGuide && html`<a class="button" href=${href(['first-steps'])}>${t.firstSteps.title}</a>`}
      ${mayUpload && html`<a class="button main" href=${href(['upload'])}><${icons.upload} />${words.upload}</a>`}
    <//>
    <${ProblemNotice} problem=${failed?.problem} onRetry=${failed?.reload} />
    <${Announce}>${announcement}<//>
    <${ConsentAsked} consent=${own.data?.consent} />
    ${trainee && own.data && html`<div class="stack own-courses"><${OwnCourses} trainee=${trainee} first=${own.data.courses} brief /></div>`}
    ${trainee && html`<${TraineeHome} person=${person} session=${scored.items?.[0]} />`}
    ${!trainee && html`<dl class="figures">
      <${Figure} name=${words.queued} value=${shownCounts.queued} />
      <${Figure} name=${words.running} value=${shownCounts.running} />
      <${Figure} name=${words.finished} value=${scored.count} />
      <${Figure} name=${words.attention} value=${`${data.failed.length}${data.moreFailed ? '+' : ''}`} />
    </dl>`}
    <div class="columns">
      ${(!trainee || moving.length > 0) && html`<${List} title=${words.moving} items=${moving} row=${Moving} empty=${words.emptyQueue}
        emptyBody=${words.emptyQueueBody} more=${may(person, 'watch') && count('receiving') > 0 && href(['live'])}
        moreWords=${words.watch} />`}
      ${(!trainee || data.failed.length > 0) && html`<${List} title=${words.attentionTitle} items=${data.failed} row=${Failed}
        empty=${words.emptyAttention} emptyBody=${words.emptyAttentionBody} />`}
      <${Attention} own=${!may(person, 'see_trainees')} person=${person} onLoaded=${() => setAttentionLoaded(true)} />
      ${isAttentionLoaded && html`<${List} title=${words.recent} items=${scored.items} row=${Done} empty=${words.emptyRecent}
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

/** @param {Props} props */
const Name = ({ session }) => html`
  <div>
    <a href=${href(['sessions', session.id])}>${session.trainee?.name} · ${session.task?.name}</a>
    <span class="small muted">${session.filename} · ${dateTime(session.recorded_at ?? session.created_at)}</span>
  </div>`;

/** @param {Props} props */
const Moving = ({ session }) => html`
  <li>
    <${Name} session=${session} />
    <${StatusPill} state=${stateOf(session)} />
    ${session.status === 'queued'
      ? session.queue_position !== undefined && session.queue_position !== null && html`<p class="why">
      ${words.position(session.queue_position)}</p>`
      : session.status === 'tracking' && html`<${ProgressBar} value=${session.progress} name=${session.filename} />`}
  </li>`;

/** @param {Props} props */
const Failed = ({ session }) => html`
  <li>
    <${Name} session=${session} />
    <${StatusPill} state=${stateOf(session)} />
    ${session.error && html`<p class="why">${problemTitle(session.error)}. <${ProblemDetail} problem=${session.error} /></p>`}
  </li>`;

/** @param {Props} props */
const Done = ({ session }) => html`<li><${Name} session=${session} /><${Outcome} session=${session} /></li>`;
