// The agent that stands by at a box: what it reports, and start and stop of its recordings.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { bytes, clock, date, dateTime, number, percent } from '../../format.js';
import { may } from '../../roles.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Field } from '../forms/form.js';
import { Notice, ProblemNotice } from '../page/notice.js';
import { traineeId } from '../page/shell.js';

const words = t.boxAgent;
/** Boxes report every two seconds; a page shows the truth within ten. */
const POLL_MS = 2_000;

/** Calls `reload` every two seconds while the page is visible. @param {() => void} reload */
export function usePolling(reload) {
  useEffect(() => {
    const timer = setInterval(() => document.visibilityState === 'visible' && reload(), POLL_MS);
    return () => clearInterval(timer);
  }, [reload]);
}

/** The agents of all boxes, by box. An answer that fails shows no agent as live. */
export function useAgents() {
  const { data, problem, reload } = useData(async signal => {
    const { items } = await api.boxes.agents(signal);
    return new Map(items.map(agent => [agent.box, agent]));
  }, []);
  usePolling(reload);
  return problem ? new Map() : data;
}

/** Whether a box stands by, or since when it is silent. @param {Props} props */
export function AgentPill({ agent }) {
  if (!agent || agent.presence === 'never') return html`<span class="pill">${words.never}</span>`;
  if (agent.presence === 'silent')
    return html`<span class="pill bad">${words.silentSince(sinceText(agent.last_seen_at))}</span>`;
  if (agent.recording) return html`<span class="pill busy">${words.recording(clock(agent.recording.recorded_s, 0))}</span>`;
  if (agent.awaited_start) return html`<span class="pill busy">${words.awaitsShort}</span>`;
  const fault = faultOf(agent);
  return fault ? html`<span class="pill warn">${fault}</span>` : html`<span class="pill good">${words.live}</span>`;
}

/** Today without the day. */
const sinceText = when => (date(when) === date(new Date().toISOString()) ? dateTime(when).split(', ').pop() : dateTime(when));

/** What keeps a live box from working, in a few words; null if nothing does. */
function faultOf(agent) {
  if (agent.camera && !agent.camera.is_open) return words.cameraMissing;
  if (agent.clock?.is_wrong) return words.clockWrong;
  if (agent.spool?.is_full) return words.isFull;
  if (agent.spool?.refused) return words.refused;
  return null;
}

/** Why a box needs a self-test before the next exam. @param {Props} props */
export const SelfTestNeed = ({ reasons }) =>
  reasons.length > 0 && html`<${Notice} tone="warn" title=${words.selfTest}>${reasons.map(reason => words.reasons[reason]).join(' ')}<//>`;

/** The card on the page of a box. @param {Props} props */
export function AgentCard({ box, person }) {
  const { data: agent, problem, reload } = useData(signal => api.boxes.agent(box.id, signal), [box.id]);
  usePolling(reload);
  return html`
    <section class="card">
      <header><h2>${words.title}</h2>${agent && !problem && html`<${AgentPill} agent=${agent} />`}</header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${agent && !problem && (agent.presence === 'live' ? html`<${LiveAgent} box=${box} agent=${agent} person=${person} onChange=${reload} />`
          : html`<p>${agent.presence === 'never' ? words.neverBody : words.silentBody}</p>`)}
        ${agent?.presence === 'never' && may(person, 'people') && html`<p><a class="button" href=${href(['boxes', box.id, 'setup'], { step: 'agent' })}>${words.install}</a></p>`}
      </div>
    </section>`;
}

/** @param {Props} props */
function LiveAgent({ box, agent, person, onChange }) {
  return html`
    ${agent.camera && !agent.camera.is_open && html`<${Notice} tone="bad" title=${words.missingFor(clock(agent.camera.missing_s ?? 0, 0))}>${words.missingBody}<//>`}
    ${agent.clock?.is_wrong && html`<${Notice} tone="warn" title=${words.offBy(offsetText(agent.clock.offset_ms))}>${words.offByBody}<//>`}
    ${agent.spool?.is_full && html`<${Notice} tone="bad" title=${words.isFullTitle}>${words.isFullBody}<//>`}
    ${agent.unreachable_server && may(person, 'upload') && html`<${Notice} tone="warn" title=${words.noPhone}>${words.noPhoneBody(agent.unreachable_server)}<//>`}
    ${agent.spool?.refused && html`<${Notice} tone="bad" title=${words.refused}>${agent.spool.refused}<//>`}
    <${AgentCommands} box=${box} agent=${agent} person=${person} onChange=${onChange} />
    <dl class="facts">
      <dt>${words.camera}</dt><dd>${cameraText(agent.camera)}</dd>
      <dt>${words.light}</dt><dd>${lightText(agent.light)}</dd>
      <dt>${words.spool}</dt><dd>${spoolText(agent.spool)}</dd>
      <dt>${words.clock}</dt><dd>${agent.clock ? words.clockOf(offsetText(agent.clock.offset_ms)) : words.notYet}</dd>
      <dt>${words.checkedIn}</dt><dd>${agent.checked_in ? (agent.checked_in.trainee?.name ?? words.another) : words.nobodyIn}</dd>
      <dt>${words.program}</dt><dd>${agent.program}</dd>
    </dl>`;
}

function cameraText(camera) {
  if (!camera) return words.notYet;
  if (!camera.is_open) return words.cameraMissing;
  const rate = camera.frame_rate_hz === null || camera.frame_rate_hz === undefined ? '' : words.rate(number(camera.frame_rate_hz));
  return [`${camera.width} × ${camera.height}`, rate, camera.is_exposure_held ? words.held : ''].filter(Boolean).join(' · ');
}

function lightText(light) {
  if (!light) return words.notYet;
  if (light.ratio === null || light.ratio === undefined) return words.noReference;
  const change = light.ratio - 1;
  if (Math.abs(change) < 0.05) return words.lightSame;
  return (change > 0 ? words.brighter : words.darker)(percent(Math.abs(change)));
}

function spoolText(spool) {
  if (!spool || spool.recordings === 0) return words.nothingWaits;
  const all = words.waits(spool.recordings, spool.frames, bytes(spool.bytes));
  return spool.unnamed ? `${all} · ${words.unnamedOf(spool.unnamed)}` : all;
}

function offsetText(ms) {
  const seconds = Math.abs(ms) / 1000;
  if (seconds < 120) return words.seconds(number(seconds));
  if (seconds < 7200) return words.minutes(Math.round(seconds / 60));
  return words.hours(Math.round(seconds / 3600));
}

/** @param {Props} props */
function AgentCommands({ box, agent, person, onChange }) {
  const [problem, setProblem] = useState(null);
  const [busy, setBusy] = useState(false);
  const send = async command => {
    setBusy(true);
    setProblem(null);
    await command().catch(error => setProblem(asProblem(error)));
    setBusy(false);
    onChange();
  };
  const running = agent.recording;
  return html`
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
    ${running ? html`
      <div class="row apart">
        <strong>${recordsText(running)}</strong>
        <span class="row">
          ${running.session && html`<a class="button" href=${href(['sessions', running.session])}>${words.watch}</a>`}
          ${(running.trainee || (running.is_unnamed && may(person, 'upload'))) && html`<button class="button main" type="button" disabled=${busy}
            onClick=${() => send(() => api.boxes.stop(box.id))}>${words.stop}</button>`}
        </span>
      </div>
      ${running.is_unnamed && may(person, 'upload') && html`<p class="muted">${words.unnamedBody} <a
        href=${href(['waiting'])}>${t.waiting.title}</a>.</p>`}`
      : html`${agent.awaited_start && html`<${AwaitedStart} awaited=${agent.awaited_start} busy=${busy} onStop=${() => send(() => api.boxes.stop(box.id))} />`}
        <${StartForm} person=${person} agent=${agent} busy=${busy}
          onStart=${target => send(() => api.boxes.start(box.id, target))} />`}`;
}

/** The recording that begins with the first movement. @param {Props} props */
const AwaitedStart = ({ awaited, busy, onStop }) => html`
  <${Notice} tone="busy" title=${awaited.trainee ? words.awaits(awaited.trainee.name, awaited.task?.name ?? '') : words.awaitsAnother}>
    <p>${awaited.is_picture_still ? words.awaitsMovement : words.awaitsRest}</p>
    ${awaited.trainee && html`<p><button class="button" type="button" disabled=${busy} onClick=${onStop}>${words.endWait}</button></p>`}
  <//>`;

function recordsText(running) {
  if (running.is_unnamed) return words.recordsUnnamed;
  return running.trainee ? words.records(running.trainee.name, running.task?.name ?? '') : words.recordsAnother;
}

/** The choice of no trainee. */
const UNNAMED = 'unnamed';

/** @param {Props} props */
function StartForm({ person, agent, busy, onStart }) {
  const own = may(person, 'upload') ? null : traineeId(person);
  const { data: lists } = useData(async () => {
    const [trainees, tasks] = await Promise.all([own ? [] : api.trainees.all(), api.tasks.all()]);
    return { trainees, tasks };
  }, [own]);
  const [trainee, setTrainee] = useState(own ?? '');
  const [task, setTask] = useState('');
  const [onMovement, setOnMovement] = useState(false);
  if (!lists || (!own && !may(person, 'upload'))) return null;
  const options = (label, items) => [['', label], ...items.map(item => [item.id, item.name])];
  const isUnnamed = trainee === UNNAMED;
  const canAwait = agent.can_start_on_movement && !isUnnamed;
  const target = isUnnamed ? { without_name: true, task: task || undefined } : { trainee, task, on_movement: canAwait && onMovement };
  const trainees = [...options(t.target.choose, lists.trainees), [UNNAMED, words.unnamed]];
  return html`
    <form class="fields" onSubmit=${event => (event.preventDefault(), onStart(target))}>
      ${!own && html`<${Field} type="select" required label=${t.target.trainee} value=${trainee} options=${trainees}
        onInput=${event => setTrainee(event.target.value)} />`}
      <${Field} type="select" required=${!isUnnamed} label=${t.target.task} value=${task} options=${options(t.target.choose, lists.tasks)}
        onInput=${event => setTask(event.target.value)} />
      ${canAwait && html`<label class="check wide"><input type="checkbox" checked=${onMovement}
        onChange=${event => setOnMovement(event.target.checked)} /><span>${words.onMovement} <small class="muted">${words.onMovementHint}</small></span></label>`}
      <div class="wide"><button class="button main" disabled=${busy || !agent.camera?.is_open}>${words.start}</button></div>
    </form>`;
}
