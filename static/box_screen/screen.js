// The page on the box's own screen: who trains, what runs, the last result, start and stop. The agent on this computer
// serves it, and it speaks to nothing else.
import { html, render, useEffect, useRef, useState } from '../preact.js';
import { clock, number } from '../format.js';
import { serviceLang, t } from '../texts.js';
import { QrCode } from '../setup/qr.js';

const words = t.boxScreen;
/** Pause before the agent is asked again after a failure, ms. */
const RETRY_MS = 1_000;
/** A second press within this time hits a button that has just changed its meaning, and is ignored: a pedal bounces. */
const DOUBLE_PRESS_MS = 1_000;

/** The agent's state, as soon as it changes; undefined until it is known, null while the agent does not answer. */
function useAgentState() {
  const [state, setState] = useState(undefined);
  useEffect(() => {
    const ending = new AbortController();
    (async () => {
      let version;
      while (!ending.signal.aborted) {
        try {
          const after = version === undefined ? '' : `?after=${version}`;
          const answer = await fetch(`/state${after}`, { signal: ending.signal });
          const next = await answer.json();
          version = next.version;
          setState({ ...next, readAt: performance.now() });
        } catch {
          if (ending.signal.aborted) return;
          version = undefined;
          setState(null);
          await new Promise(done => setTimeout(done, RETRY_MS));
        }
      }
    })();
    return () => ending.abort();
  }, []);
  return state;
}

/**
 * Asks the agent for a change. Returns why it refused, in the page's language, with a technical detail if there is one; or
 * null.
 */
async function ask(path, body = {}) {
  try {
    const answer = await fetch(path, { method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body) });
    if (answer.ok) return null;
    const { kind, detail } = await answer.json().catch(() => ({}));
    return { text: words.refusedFor[kind] ?? words.refused, detail };
  } catch {
    return { text: words.noAgent };
  }
}

function Screen() {
  const state = useAgentState();
  const [why, setWhy] = useState(null);
  const pressedAt = useRef(-Infinity);
  const running = state?.state.recording ?? null;
  const awaited = running ? null : (state?.state.awaited_start ?? null);
  const isUnnamed = Boolean(running && running.trainee === null);
  const hasWho = state?.checked_in ? Boolean(state.checked_in.task) : !state?.requires_check_in;
  const mayStart = Boolean((hasWho || awaited) && state?.state.camera.is_open);
  // While a movement is awaited, key and pedal start at once; otherwise they do what the large button says.
  const isMovementUsual = Boolean(state?.starts_on_movement && state.checked_in && !awaited);
  const press = async ({ withoutName = false, onMovement = isMovementUsual } = {}) => {
    if (!state || performance.now() - pressedAt.current < DOUBLE_PRESS_MS) return;
    pressedAt.current = performance.now();
    const body = running ? {} : { without_name: withoutName, on_movement: onMovement && !withoutName };
    const refused = await ask(running ? '/stop' : '/start', body);
    const needsButton = !running && !state.checked_in && !state.requires_check_in && !withoutName && state.needs_unnamed_button;
    setWhy(refused && needsButton ? { text: words.needsButton } : refused);
  };
  const trainee = state?.checked_in?.trainee.id;
  useEffect(() => setWhy(null), [trainee]); // the refusal was about the person before
  const latest = useRef(press);
  latest.current = press;
  const key = state?.key;
  useEffect(() => {
    const onKey = event => {
      const isTyping = /** @type {Element} */ (event.target).closest?.('input');
      if (event.code !== key || event.repeat || isTyping) return;
      event.preventDefault(); // the key would press the focused button as well
      latest.current();
    };
    addEventListener('keydown', onKey);
    return () => removeEventListener('keydown', onKey);
  }, [key]);
  if (state === undefined) return html`<main class="screen"><p>${t.loading}</p></main>`;
  if (state === null) return html`<main class="screen"><p class="notice bad" role="alert"><strong>${words.noAgent}</strong></p></main>`;
  return html`
    <main class="screen">
      <div class="row apart"><h1>${state.box_name || t.product}</h1>
        <span class=${`pill ${state.is_connected ? 'good' : 'warn'}`}>${state.is_connected ? words.connected : words.away}</span></div>
      <${Warnings} state=${state} />
      ${running && html`
        <section class="stack tight" aria-live="polite">
          <p class="who">${isUnnamed ? words.unnamed : state.recorded}</p>
          <p>${isUnnamed ? words.unnamedRuns : state.recorded_task}</p>
          <${Elapsed} from=${running.recorded_s} readAt=${state.readAt} />
          <p>${words.frames(number(running.frames))}</p>
        </section>`}
      ${awaited && html`<${Awaited} state=${state} />`}
      ${!running && state.checked_in && html`<${CheckedIn} state=${state} />`}
      ${!running && !state.checked_in && html`<${CheckInWays} state=${state} />`}
      <${Refusal} refusal=${why} />
      ${state.start_failed && !running && html`<div class="notice warn" role="alert"><div><strong>${words.startFailed}</strong>
        <p>${words.refusedFor[state.start_failed.kind]}</p><${Detail} text=${state.start_failed.detail} /></div></div>`}
      ${(running || awaited || state.checked_in) && html`<button class=${`press ${running ? 'stop' : ''}`} type="button"
        disabled=${!running && !mayStart} onClick=${() => press()}>${pressText(running, awaited, isMovementUsual)}</button>
        <div class="row apart"><span class="muted">${words.keyHint(keyName(key))}</span>
          ${!running && !awaited && html`<button class="button" type="button" disabled=${!mayStart}
            onClick=${() => press({ onMovement: !isMovementUsual })}>${isMovementUsual ? words.startNow : words.startOnMovement}</button>`}
        </div>`}
      ${!running && !awaited && !state.checked_in && !state.requires_check_in && html`
        <section class="stack tight">
          <p class="row"><button class="button" type="button" disabled=${!mayStart}
            onClick=${() => press({ withoutName: true })}>${words.unnamedStart}</button>
            ${!state.needs_unnamed_button && html`<span class="muted">${words.keyHint(keyName(key))}</span>`}</p>
          <p class="muted">${words.unnamedHint}</p>
        </section>`}
    </main>`;
}

/** What the large button does. */
function pressText(running, awaited, isMovementUsual) {
  if (running) return words.stop;
  if (awaited) return words.startNow;
  return isMovementUsual ? words.startOnMovement : words.start;
}

/** The recording that begins with the first movement. Staff may have asked for it on another page: its trainee is named
 * then. @param {Props} props */
const Awaited = ({ state }) => html`
  ${!state.checked_in && html`<p class="who">${state.awaited}</p>`}
  <div class=${`notice ${state.state.awaited_start.is_picture_still ? 'good' : 'busy'}`} role="status">
    <div class="row apart"><strong>${state.state.awaited_start.is_picture_still ? words.awaitsMovement : words.awaitsRest}</strong>
      <button class="button" type="button" onClick=${() => ask('/stop')}>${words.endWait}</button></div>
  </div>`;

const keyName = key => words.keys[key] ?? key.replace(/^Key|^Digit/, '');

/** @param {Props} props */
function Elapsed({ from, readAt }) {
  const [now, setNow] = useState(performance.now());
  useEffect(() => {
    const timer = setInterval(() => setNow(performance.now()), 200);
    return () => clearInterval(timer);
  }, []);
  return html`<p class="elapsed" role="timer">${clock(from + Math.max(0, now - readAt) / 1000, 0)}</p>`;
}

/** Why something was refused. @param {Props} props */
const Refusal = ({ refusal }) =>
  refusal && html`<div class="notice warn" role="alert"><div><strong>${refusal.text}</strong><${Detail} text=${refusal.detail} /></div></div>`;

/** What the server, FFmpeg or the system says: in English, and for people who look into it. @param {Props} props */
const Detail = ({ text }) => text && html`<p class="small">${words.details}: <span lang=${serviceLang}>${text}</span></p>`;

/** @param {Props} props */
const Warnings = ({ state }) => html`
  ${!state.is_connected && html`<div class="notice warn"><div><strong>${state.is_refused ? words.refusedByServer : words.awayBody}</strong>
    <${Detail} text=${state.trouble} /></div></div>`}
  ${!state.state.camera.is_open && html`<div class="notice bad" role="alert"><div><strong>${words.cameraFaults[state.camera_fault] ?? words.cameraMissing}</strong>
    <${Detail} text=${state.state.camera.why} /></div></div>`}
  ${state.state.spool.is_full && html`<p class="notice bad" role="alert"><strong>${words.isFull}</strong></p>`}
  ${state.reached_limit && html`<p class="notice bad" role="alert"><strong>${words.reachedLimits[state.reached_limit]}</strong></p>`}
  ${state.state.spool.refused && html`<div class="notice warn"><div><strong>${words.recordingKept}</strong>
    <${Detail} text=${state.state.spool.refused} /></div></div>`}
  ${state.is_clock_wrong && html`<p class="notice warn"><strong>${words.clockWrong}</strong></p>`}`;

/** @param {Props} props */
function CheckedIn({ state: { checked_in: { trainee, task, tasks, last } } }) {
  return html`
    <section class="stack">
      <div class="row apart"><p class="who">${trainee.name}</p>
        <button class="button" type="button" onClick=${() => ask('/check-out')}>${words.leave}</button></div>
      ${last && html`<p class="notice busy" role="status"><strong>${words.last(last.task)} ${resultText(last)}</strong></p>`}
      <div role="group" aria-label=${words.task} class="choices">
        ${tasks.map(one => html`<button key=${one.id} class="button" type="button" aria-pressed=${task?.id === one.id ? 'true' : 'false'}
          onClick=${() => ask('/task', { task: one.id })}>${one.name}</button>`)}
      </div>
      ${!task && html`<p>${words.chooseTask}</p>`}
    </section>`;
}

/** The result in words. A recording of poor quality has no numbers, and none are shown here. */
function resultText(last) {
  if (last.status === 'failed') return words.results.failed;
  if (last.status !== 'done') return words.results.waits;
  if (last.quality === 'refused') return words.results.refused;
  return words.results[last.judgement] ?? words.results.done;
}

/** @param {Props} props */
function CheckInWays({ state }) {
  const [typed, setTyped] = useState(null);
  const send = event => {
    event.preventDefault();
    const form = event.target;
    ask('/check-in', { trainee: form.elements.trainee.value, pin: form.elements.pin.value }).then(setTyped);
    form.elements.pin.value = '';
  };
  const refusal = typed ?? (state.refusal && { text: words.refusals[state.refusal[0]](Math.ceil(state.refusal[1] / 60)) });
  return html`
    <section class="stack">
      <p class="who">${words.whoTrains}</p>
      ${state.check_in_end && html`<p class="notice warn" role="alert"><strong>${words.ends[state.check_in_end]}</strong></p>`}
      ${state.is_phone_refused && html`<p class="notice warn" role="alert"><strong>${words.phoneRefused}</strong></p>`}
      ${state.last_unnamed && html`<p class="notice busy" role="status"><strong>${words.unnamedStates[state.last_unnamed]}</strong></p>`}
      <div class="ways">
        ${state.unreachable_server && html`<div class="stack tight"><h2>${words.byPhone}</h2>
          <div class="notice warn"><div><strong>${words.noPhone}</strong><p class="small">${words.noPhoneBody(state.unreachable_server)}</p></div></div></div>`}
        ${state.check_in_address && html`<div class="stack tight"><h2>${words.byPhone}</h2>
          <${QrCode} text=${state.check_in_address} name=${words.byPhone} /><p>${words.byPhoneBody}</p></div>`}
        <form class="stack tight" onSubmit=${send}>
          <h2>${words.byPin}</h2>
          <div class="field"><label for="trainee">${words.code}</label><input id="trainee" name="trainee" required maxlength="64" autocomplete="off" autocapitalize="none" /></div>
          <div class="field"><label for="pin">${words.pin}</label><input id="pin" name="pin" type="password" required maxlength="8" inputmode="numeric" autocomplete="off" /></div>
          <${Refusal} refusal=${refusal} />
          <p><button class="button main">${words.checkIn}</button></p>
          <p class="muted">${words.pinHint}</p>
        </form>
      </div>
    </section>`;
}

document.title = t.product;
render(html`<${Screen} />`, document.body);
