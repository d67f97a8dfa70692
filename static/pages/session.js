// One session: how it stands while it is being scored, and what came out of it.
import { html, useEffect, useRef, useState } from '../parts/preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { dateTime } from '../format.js';
import { useLive } from '../live.js';
import { may } from '../roles.js';
import { go, href } from '../router.js';
import { t } from '../texts.js';
import { Confirm } from '../parts/dialog.js';
import { SetAside } from '../parts/edits.js';
import { LiveFeatures, LiveView } from '../parts/live_view.js';
import { Announce, Loading, Notice, PageHead, ProblemNotice } from '../parts/notice.js';
import { Review } from '../parts/review.js';
import { Skill } from '../parts/skill.js';
import { isMoving, ProgressBar, StatusPill, stateOf } from '../parts/status.js';
import { Prose } from '../parts/prose.js';
import { Verdict } from '../parts/verdict.js';

const words = t.session;

export default function Session({ person, route }) {
  const id = route.path[1];
  const { data: session, problem, reload } = useData(signal => api.sessions.get(id, signal), [id]);
  const [moved, setMoved] = useState(null);
  const { edits, reload: readEdits } = useEdits(id, Boolean(session) && session.status !== 'receiving', reload);

  useLive('resync', () => (!session || isMoving(session)) && reload());
  useLive('session', event => {
    if (event.id !== session?.id) return;
    setMoved(event);
    if (event.status !== session.status) reload();
    else readEdits();
  });

  // One that was erased, or was the same recording as another, is no more.
  if (problem && (!session || problem.status === 404))
    return html`<${PageHead} title=${t.nav.sessions} /><${ProblemNotice} problem=${problem} onRetry=${reload} />`;
  if (!session) return html`<${PageHead} title=${t.nav.sessions} /><${Loading} />`;
  const progress = moved?.status === session.status ? moved.progress : session.progress;
  return html`
    <${PageHead} title=${words.title(session.trainee?.name, session.task?.name)} lead=${html`<${Lead} session=${session}
      person=${person} />`}>
      <${Actions} session=${session} person=${person} onChange=${reload} />
    <//>
    <div class="stack">
      <${Announce}>${t.status[stateOf(session)]}<//>
      ${session.status === 'receiving' && html`<${LiveView} session=${session} onClosed=${reload} />`}
      ${isScored(session) && html`<${Waiting} session=${session} progress=${progress} />`}
      ${isScored(session) && session.live_features && html`<${ToldLive} features=${session.live_features} />`}
      ${session.status === 'failed' && html`<${ProblemNotice}
        problem=${session.error ?? { title: t.status[stateOf(session)], detail: '' }} />`}
      <${SetAside} session=${session} edits=${edits} />
      ${session.status === 'done' && html`<${Verdict} quality=${session.quality} /><${Skill} verdict=${session.verdict} />`}
      ${session.status !== 'receiving' && html`<${Loaded} key=${`${session.id} ${session.status}`} session=${session}
        person=${person} edits=${edits} start=${Number(route.query.get('t')) || 0} onEdited=${() => (readEdits(), reload())} />`}
    </div>`;
}

/** Is it on its way to a score? */
const isScored = session => ['queued', 'tracking'].includes(session.status);

const Lead = ({ session, person }) => html`
  ${dateTime(session.recorded_at ?? session.created_at)} · ${session.box?.name} · ${session.filename}
  ${session.source?.kind === 'import' && ` · ${words.imported(session.source.tracker)}`}
  ${' '}${(may(person, 'see_trainees') || person.trainee) && session.trainee &&
    html`· <a href=${href(['trainees', session.trainee.id])}>${t.trainee.progress}</a>`}`;

/** A recording may wait for something that a person must do, such as calibrating its box: then that is said. */
const Waiting = ({ session, progress }) => html`
  <section class="card">
    <div class="body stack tight">
      ${session.error && html`<${Notice} tone="warn" title=${session.error.title}><span lang=${session.error.lang}>${session.error.detail}</span><//>`}
      <${Notice}
        title=${{ queued: words.waiting, tracking: words.tracking }[session.status]}>
        ${session.status === 'queued' && Number.isFinite(session.queue_position)
          ? `${t.today.position(session.queue_position)}. ` : ''}${words.waitingBody}
      <//>
      ${session.status === 'tracking' && html`<${ProgressBar} value=${progress} name=${session.filename} />`}
    </div>
  </section>`;

/** Until the final features are there, those that were told live. */
const ToldLive = ({ features }) => html`
  <section class="card">
    <header><h2>${words.live}</h2></header>
    <${LiveFeatures} features=${features} />
    <p class="small muted keys">${words.liveDiffers}</p>
  </section>`;

function Actions({ session, person, onChange }) {
  const [asking, setAsking] = useState(false);
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState(null);
  const retry = async () => {
    setBusy(true);
    await api.sessions.retry(session.id).then(onChange, error => setProblem(asProblem(error)));
    setBusy(false);
  };
  const remove = () => api.sessions.remove(session.id).then(() => go(['sessions']));
  return html`
    <${StatusPill} state=${stateOf(session)} />
    ${session.status === 'done' && html`<a class="button" href=${href(['sessions', session.id, 'report'])}>${t.report.open}</a>`}
    ${!isMoving(session) && session.source?.kind !== 'import' && may(person, 'retry') && html`<button class=${`button ${session.status === 'failed' ? 'main'
      : ''}`} type="button" title=${words.again} disabled=${busy} onClick=${retry}>${busy ? words.retryBusy
      : words.retry}</button>`}
    ${may(person, 'delete') && !isMoving(session) && html`<button class="button" type="button"
      onClick=${() => setAsking(true)}>${words.remove}</button>`}
    ${asking && html`<${Confirm} title=${words.removeTitle} body=${words.removeBody} yes=${words.removeYes}
      no=${words.keep} onYes=${remove} onClose=${() => setAsking(false)} />`}
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />`;
}

/** Rows of a tool that the page begins with; of a shorter recording these are all. */
const POINTS = 4000;

/** The path is asked for only when there is one; a recording that failed can still be looked at. */
function Loaded({ session, person, edits, start, onEdited }) {
  const done = session.status === 'done';
  const { data, problem, reload } = useData(
    signal => (done ? api.sessions.trajectory(session.id, { points: POINTS, trimmed: false }, signal) : null),
    [session.id, done, useSwaps(edits)],
  );
  if (!done && !session.video) return null;
  return html`
    ${problem && html`<${ProblemNotice}
      problem=${{ title: words.noPath, detail: html`${problem.title}. <${Prose} text=${problem.detail} lang=${problem.lang} />` }} onRetry=${reload} />`}
    ${data !== undefined || problem ? html`<${Review} session=${session} person=${person} trajectory=${data}
      edits=${edits} start=${start} onEdited=${onEdited} />` : html`<${Loading} />`}`;
}

/** Counts up when other tools' names are exchanged than when the page began: its path then goes by other names. */
function useSwaps(edits) {
  const swaps = edits && edits.items.filter(edit => edit.kind === 'swap' && !edit.undone).map(edit => edit.id).join();
  const known = useRef({ swaps: null, count: 0 });
  if (edits && known.current.swaps !== null && known.current.swaps !== swaps) known.current.count++;
  if (edits) known.current.swaps = swaps;
  return known.current.count;
}

const LOOK_MS = 2_000;

/** A session's edits; `onScored` when a score has been made with them. */
function useEdits(id, isThere, onScored) {
  const { data, reload } = useData(signal => (isThere ? api.sessions.edits(id, signal) : null), [id, isThere]);
  const isMaking = ['waiting', 'working'].includes(data?.score);
  const wasMaking = useRef(false);
  useEffect(() => {
    if (wasMaking.current && data?.score === 'current') onScored();
    wasMaking.current = isMaking;
    if (!isMaking) return undefined;
    const timer = setInterval(reload, LOOK_MS); // Events tell at once, where they come through.
    return () => clearInterval(timer);
  }, [data?.score, data?.revision]);
  return { edits: data ?? null, reload };
}
