// One session: its state while it is being scored, and then its results.
import { html, useEffect, useRef, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { useLive } from '../live.js';
import { may } from '../roles.js';
import { go, href } from '../router.js';
import { serviceLang, t } from '../texts.js';
import { problemTitle } from '../translate.js';
import { Confirm } from '../parts/forms/dialog.js';
import { SameRecording, Supervision } from '../parts/session/background.js';
import { BoxQuestion } from '../parts/session/box_question.js';
import { Retimed, SetAside } from '../parts/session/edits.js';
import { LiveErrors } from '../parts/session/error_sheets.js';
import { LiveFeatures, LiveView } from '../parts/live/live_view.js';
import { Cuts } from '../parts/session/cuts.js';
import { MoveButton, Moves } from '../parts/session/moves.js';
import { Announce, Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { OutcomeCard } from '../parts/session/outcome_card.js';
import { Review } from '../parts/session/review.js';
import { SetupWarnings } from '../parts/session/setup_versions.js';
import { Skill } from '../parts/session/skill.js';
import { useOpening } from '../parts/people/new_feedback.js';
import { recordedAtText } from '../parts/page/recorded_at.js';
import { isMoving, outcomeOf, ProgressBar, stateOf, StatusPill } from '../parts/page/status.js';
import { ProblemDetail } from '../parts/page/prose.js';
import { Verdict } from '../parts/session/verdict.js';

const words = t.session;

/** @param {Props} props */
export default function Session({ person, route }) {
  const { id } = route.params;
  const { data: session, problem, reload } = useData(signal => api.sessions.get(id, signal), [id]);
  const [lastEvent, setLastEvent] = useState(null);
  useOpening(id, person);
  const { edits, reload: readEdits } = useEdits(id, Boolean(session && session.status !== 'receiving'), reload);

  useLive('resync', () => (!session || isMoving(session)) && reload());
  useLive('session', event => {
    if (!session || event.id !== session.id) return;
    setLastEvent(event);
    if (event.status !== session.status) reload();
    else readEdits();
  });

  // The session may be gone: erased, or found to be the same recording as another one.
  if (problem && (!session || problem.status === 404))
    return html`<${PageHead} title=${t.nav.sessions} /><${ProblemNotice} problem=${problem} onRetry=${reload} />`;
  if (!session) return html`<${PageHead} title=${t.nav.sessions} /><${Loading} />`;
  const progress = lastEvent?.status === session.status ? lastEvent.progress : session.progress;
  return html`
    <${PageHead} title=${words.title(session.trainee?.name, session.task?.name)} lead=${html`<${Lead} session=${session}
      person=${person} />`}>
      <${Actions} session=${session} person=${person} onChange=${() => (readEdits(), reload())} />
    <//>
    <div class="stack">
      <${Announce}>${t.status[stateOf(session)]}<//>
      ${session.status === 'receiving' && html`<${LiveView} session=${session} onClosed=${reload}
        under=${watch => html`<${LiveErrors} session=${session} person=${person} watch=${watch} />`} />`}
      ${isBeingScored(session) && html`<${Waiting} session=${session} person=${person} progress=${progress} />`}
      ${isBeingScored(session) && session.live_features && html`<${InterimFeatures} features=${session.live_features} />`}
      ${session.status === 'failed' && html`<${ProblemNotice}
        problem=${session.error ?? { title: t.status[stateOf(session)], detail: '' }} />
        ${session.retry_can_help && may(person, 'see_boxes') && html`<p><a href=${href(['boxes', session.box.id])}>${
          words.toBox(session.box.name)}</a></p>`}`}
      ${session.exam && html`<${Notice} tone="busy" title=${t.exams.ofExam}>${t.exams.ofExamBody(session.exam.attempt, session.exam.is_voided)}
        <span class="row after"><a class="button" href=${href(['exams', session.exam.id])}>${t.exams.toExam}</a></span><//>`}
      <${SameRecording} session=${session} person=${person} />
      ${edits?.items.some(edit => edit.of_cut) && html`<${Cuts} key=${edits.revision} session=${session} person=${person}
        onChange=${cut => (cut.first === session.id ? (readEdits(), reload()) : go(['sessions', cut.first]))} />`}
      <${BoxQuestion} session=${session} person=${person} edits=${edits} onChange=${() => (readEdits(), reload())} />
      <${EarlyEnd} session=${session} />
      <${SetAside} session=${session} edits=${edits} />
      <${SetupWarnings} session=${session} person=${person} />
      <${Retimed} session=${session} edits=${edits} />
      ${session.status === 'done' && html`<${OutcomeCard} session=${session} />`}
      ${session.status === 'done' && !isValid(session) && html`<${Verdict} quality=${session.quality} />`}
      ${!session.exam && html`<${Supervision} session=${session} person=${person} onChange=${reload} />`}
      ${session.status !== 'receiving' && html`<${ReviewLoader} key=${`${session.id} ${session.status}`} session=${session}
        person=${person} edits=${edits} start=${Number(route.query.get('t')) || 0} onEdited=${() => (readEdits(), reload())} />`}
      ${session.status === 'done' && html`${isValid(session) && html`<${Verdict} quality=${session.quality} />`}<${Skill}
        verdict=${session.verdict} />`}
      <${Moves} session=${session} />
    </div>`;
}

/** Whether the numbers are reliable without any doubt. Only doubts precede the video. */
const isValid = session => session.quality?.verdict === 'valid';

/** Why a live recording ended before its sender meant it to. @param {Props} props */
const EarlyEnd = ({ session: { early_end: early } }) => early && html`
  <${Notice} tone="warn" title=${words.earlyEnd.title}>${words.earlyEnd.causes[early.cause]}
    ${early.detail && html` <span lang=${serviceLang}>(${early.detail})</span>`}<//>`;

/** Whether the session waits because its box is not set up. */
const isOfBox = session => session.error?.type === '/problems/box-not-ready';

/** Whether the session is waiting for its score. */
const isBeingScored = session => ['queued', 'tracking'].includes(session.status);

/** @param {Props} props */
const Lead = ({ session, person }) => html`
  ${recordedAtText(session)} · ${may(person, 'see_boxes') && session.box
    ? html`<a href=${href(['boxes', session.box.id])}>${session.box.name}</a>` : session.box?.name} · ${session.filename}
  ${session.source?.kind === 'import' && ` · ${words.imported(session.source.tracker)}`}
  ${' '}${(may(person, 'see_trainees') || person.trainee) && session.trainee &&
    html`· <a href=${href(['trainees', session.trainee.id])}>${t.trainee.progress}</a>`}`;

/**
 * A recording may wait for something that a person must do, such as calibrating its box; the notice then says so.
 *
 * @param {Props} props
 */
const Waiting = ({ session, person, progress }) => html`
  <section class="card">
    <div class="body stack tight">
      ${session.error && html`<${Notice} tone="warn" title=${problemTitle(session.error)}><${ProblemDetail} problem=${session.error} />
        ${isOfBox(session) && may(person, 'edit_boxes') && html` <a href=${href(['boxes', session.box.id, 'setup'])}>${words.toSetup(session.box.name)}</a>`}<//>`}
      <${Notice}
        title=${{ queued: words.waiting, tracking: words.tracking }[session.status]}>
        ${session.status === 'queued' && Number.isFinite(session.queue_position)
          ? `${t.today.position(session.queue_position)}. ` : ''}${words.waitingBody}
      <//>
      ${session.status === 'tracking' && html`<${ProgressBar} value=${progress} name=${session.filename} />`}
    </div>
  </section>`;

/** The live features, shown until the final features are there. */
const InterimFeatures = ({ features }) => html`
  <section class="card">
    <header><h2>${words.live}</h2></header>
    <${LiveFeatures} features=${features} />
    <p class="small muted keys">${words.liveDiffers}</p>
  </section>`;

/** @param {Props} props */
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
    <${StatusPill} state=${outcomeOf(session)} />
    ${session.status === 'done' && html`<a class="button" href=${href(['sessions', session.id, 'report'])}>${t.report.open}</a>`}
    ${!isMoving(session) && session.retry_can_help && may(person, 'retry') && html`<button class=${`button ${session.status === 'failed' ? 'main'
      : ''}`} type="button" title=${words.again} disabled=${busy} onClick=${retry}>${busy ? words.retryBusy
      : words.retry}</button>`}
    ${may(person, 'edit_sessions') && !session.exam && session.status !== 'receiving' && html`<${MoveButton} session=${session} onMoved=${onChange} />`}
    ${may(person, 'delete') && !session.exam && !isMoving(session) && html`<button class="button" type="button"
      onClick=${() => setAsking(true)}>${words.remove}</button>`}
    ${asking && html`<${Confirm} title=${words.removeTitle} body=${words.removeBody} yes=${words.removeYes}
      no=${words.keep} onYes=${remove} onClose=${() => setAsking(false)} />`}
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />`;
}

/** Rows per tool in the page's first request; a shorter recording has fewer in total. */
const POINTS = 4000;

/**
 * Requests the path only of a scored session. The video of a failed session can still be played.
 *
 * @param {Props} props
 */
function ReviewLoader({ session, person, edits, start, onEdited }) {
  const done = session.status === 'done';
  const { data, problem, reload } = useData(
    signal => (done ? api.sessions.trajectory(session.id, { points: POINTS, trimmed: false }, signal) : null),
    [session.id, done, useSwapCount(edits), session.box.id],
  );
  if (!done && !session.video) return null;
  return html`
    ${problem && html`<${ProblemNotice}
      problem=${{ title: words.noPath, detail: html`${problemTitle(problem)}. <${ProblemDetail} problem=${problem} />` }} onRetry=${reload} />`}
    ${data !== undefined || problem ? html`<${Review} session=${session} person=${person} trajectory=${data}
      edits=${edits} start=${start} onEdited=${onEdited} />` : html`<${Loading} />`}`;
}

/** Counts the changes of swapped tool names since the page was opened: each one changes the names in the path. */
function useSwapCount(edits) {
  const swaps = edits && edits.items.filter(edit => edit.kind === 'swap' && !edit.undone).map(edit => edit.id).join();
  const known = useRef({ swaps: null, count: 0 });
  if (edits && known.current.swaps !== null && known.current.swaps !== swaps) known.current.count++;
  if (edits) known.current.swaps = swaps;
  return known.current.count;
}

const POLL_MS = 2_000;

/** A session's edits. Calls `onScored` when a score has been made with them. */
function useEdits(id, isEnabled, onScored) {
  const { data, reload } = useData(signal => (isEnabled ? api.sessions.edits(id, signal) : null), [id, isEnabled]);
  const isScoring = data?.score === 'waiting' || data?.score === 'working';
  const wasScoring = useRef(false);
  useEffect(() => {
    if (wasScoring.current && data?.score === 'current') onScored();
    wasScoring.current = isScoring;
    if (!isScoring) return undefined;
    const timer = setInterval(reload, POLL_MS); // Events are faster, where they get through.
    return () => clearInterval(timer);
  }, [data?.score, data?.revision]);
  return { edits: data ?? null, reload };
}
