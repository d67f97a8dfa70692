// The list of uploads: which run, which stopped and why, and which need their file again after a reload.
import { html, useEffect, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { bytes, clock, percent } from '../../format.js';
import { useLive } from '../../live.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Announce, ProblemNotice } from '../page/notice.js';
import { isMoving, Outcome, outcomeOf, ProgressBar, StatusPill } from '../page/status.js';
import { cancel, forget, pause, resume, resumeWith } from './uploads.js';

const words = t.upload;
const TONES = { sending: 'busy', done: 'good', failed: 'bad', lost: 'warn', paused: 'warn', waiting: '' };

/** `namesOf(target)` gives the names of trainee, task and box. @param {Props} props */
export function UploadList({ items, namesOf }) {
  const [scoring, setScoring] = useState({}); // The scoring of uploads that have arrived, by session.
  const [ended, setEnded] = useState({}); // Those that are scored or failed, with all that their row says.
  const readEnded = async id => {
    const session = await api.sessions.get(id).catch(() => null);
    if (session && !isMoving(session)) setEnded(before => ({ ...before, [id]: session }));
  };
  useLive('session', event => {
    setScoring(before => ({ ...before, [event.id]: event }));
    if (!items.some(item => item.session === event.id)) return;
    if (isMoving(event)) setEnded(before => ({ ...before, [event.id]: undefined }));
    else readEnded(event.id);
  });
  const arrived = items.filter(item => item.state === 'done' && item.session).map(item => item.session);
  useEffect(() => {
    for (const id of arrived) if (!ended[id]) readEnded(id);
  }, [arrived.join()]);
  const state = item => {
    if (item.state !== 'done') return words.states[item.state];
    const session = ended[item.session];
    if (session) return t.status[outcomeOf(session)];
    return scoring[item.session] ? t.status[scoring[item.session].status] : words.states.done;
  };
  return html`
    <${Announce}>${items.map(item => words.announce(item.name, state(item))).join('. ')}<//>
    <ul class="sending">${items.map(item => html`<${Item} key=${item.key} item=${item} names=${namesOf(item.target)}
      scoring=${item.state === 'done' ? scoring[item.session] : null} ended=${ended[item.session]} />`)}</ul>`;
}

const Item = ({ item, names, scoring, ended }) => html`
  <li>
    <div>
      <div class="name">${item.name}</div>
      <div class="small muted">${names}</div>
    </div>
    ${ended ? html`<${Outcome} session=${ended} />` : scoring ? html`<${StatusPill} state=${scoring.status} />`
      : html`<span class=${`pill ${TONES[item.state]}`}>${words.states[item.state]}</span>`}
    ${!ended && scoring?.status === 'tracking' && html`<div class="wide"><${ProgressBar} value=${scoring.progress}
      name=${item.name} /></div>`}
    ${item.state !== 'done' && html`
      <div class="wide stack tight">
        <${ProgressBar} value=${item.size ? item.sent / item.size : 0} name=${words.progress(item.name)} />
        <span class="small muted">${percent(item.size ? item.sent / item.size
          : 0)} · ${words.sent(bytes(item.sent), bytes(item.size))}${timeLeft(item)}</span>
      </div>`}
    ${ended?.same_recording && html`<p class="wide small"><a href=${href(['sessions', ended.id])}>${
      ended.same_recording.sessions.length ? t.background.atUpload : t.background.look}</a></p>`}
    ${item.duplicate && html`<p class="wide small muted">${words.duplicate}</p>`}
    ${item.problem && html`<div class="wide"><${ProblemNotice} problem=${item.problem} /></div>`}
    ${item.state === 'lost' ? html`<${ChooseFileAgain} item=${item} />` : html`<${Buttons} item=${item} />`}
  </li>`;

const timeLeft = ({ state, rate, size, sent, isStalled }) => {
  if (state !== 'sending') return '';
  if (isStalled) return ` · ${words.stalled}`;
  return rate > 0 ? ` · ${words.left(clock((size - sent) / rate, 0))}` : '';
};

/** The file itself was refused: the service would refuse it again. */
const isRefused = problem => [400, 413, 415, 422].includes(problem?.status);

function Buttons({ item: { key, state, session, problem } }) {
  const button = (label, act, kind = '') =>
    html`<button class=${`button ${kind}`} type="button" onClick=${() => act(key)}>${label}</button>`;
  return html`
    <div class="wide row">
      ${(state === 'sending' || state === 'waiting') && button(words.pause, pause)}
      ${state === 'paused' && button(words.resume, resume, 'main')}
      ${state === 'failed' && !isRefused(problem) && button(words.retry, resume, 'main')}
      ${state === 'done' && session && html`<a class="button main" href=${href(['sessions', session])}>
        ${words.open}</a>`}
      ${state === 'done' || isRefused(problem) ? button(words.clear, forget) : button(words.cancel, cancel)}
    </div>`;
}

function ChooseFileAgain({ item }) {
  const input = useRef(null);
  const [other, setOther] = useState(false);
  const chosen = () => {
    const [file] = input.current.files;
    if (file) setOther(!resumeWith(item.key, file));
    input.current.value = '';
  };
  return html`
    <div class="wide stack tight">
      <p>${words.lost(item.name)}</p>
      ${other && html`<${ProblemNotice} problem=${{ title: words.wrongFile(item.name) }} />`}
      <div class="row drop-again">
        <label class="button main"><input ref=${input} class="unseen" type="file" onChange=${chosen} />
          ${words.again}</label>
        <button class="button" type="button" onClick=${() => cancel(item.key)}>${words.cancel}</button>
      </div>
    </div>`;
}
