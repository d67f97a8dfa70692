// Where frames come from: this device's camera, a recording of the box, or picture files.
import { html, useEffect, useRef, useState } from '../parts/preact.js';
import { clock } from '../format.js';
import { t } from '../texts.js';
import { Field } from '../parts/form.js';
import { Notice } from '../parts/notice.js';
import { addFrames, MOST_FRAMES } from './frames.js';
import { frameOf } from './pictures.js';
import { Shot } from './shot.js';

const words = t.setup.colours;
const WAYS = ['recording', 'camera', 'files'];
const NOTHING = { url: null, isLoaded: false, length: 0, at: 0, broken: false, busy: false };
const BEYOND_S = 1e7;
/** Frames taken at once from all over a recording. */
const SPREAD = 5;

export function FrameSources({ box, bench, onProblem }) {
  const [way, setWay] = useState('recording');
  const isFull = bench.frames.length >= MOST_FRAMES;
  const add = pictures => addFrames(bench, pictures, onProblem);
  const choose = event => {
    add([...event.target.files]);
    event.target.value = '';
  };
  return html`
    <div class="stack">
      <div class="row" role="group" aria-label=${words.from}>
        ${WAYS.map(one => html`<button key=${one} class="button" type="button" aria-pressed=${way === one}
          onClick=${() => setWay(one)}>${words.ways[one]}</button>`)}
      </div>
      ${isFull && html`<${Notice} quiet title=${words.full(MOST_FRAMES)}>${words.fullBody}<//>`}
      ${way === 'recording' && html`<${Recording} isFull=${isFull} most=${MOST_FRAMES - bench.frames.length} onTake=${add} />`}
      ${way === 'camera' && html`<${Shot} calibrated=${box.calibration} label=${words.take} disabled=${isFull}
        onShot=${blob => add([blob])} />`}
      ${way === 'files' && html`<${Field} type="file" label=${words.pictures} hint=${words.picturesHint} accept="image/*"
        multiple disabled=${isFull} onInput=${choose} />`}
    </div>`;
}

/** A recording on this device: nothing of it is sent but the frames that are taken. */
function Recording({ isFull, most, onTake }) {
  const video = useRef(null);
  const [state, setState] = useState(NOTHING);
  useEffect(() => () => state.url && URL.revokeObjectURL(state.url), [state.url]);
  const set = more => setState(before => ({ ...before, ...more }));
  const open = event => {
    const [file] = event.target.files;
    if (file) setState({ ...NOTHING, url: URL.createObjectURL(file) });
  };
  const spread = async () => {
    set({ busy: true });
    const count = Math.min(SPREAD, most);
    const { url } = state;
    const isHere = () => video.current?.src === url; // Another step, or another recording, ends it.
    try {
      for (let i = 0; i < count && isHere(); i++) {
        await sought(video.current, ((i + 0.5) * state.length) / count);
        if (isHere()) await onTake([await frameOf(video.current)]);
      }
    } finally {
      if (isHere()) set({ busy: false, at: video.current.currentTime });
    }
  };
  const take = async () => video.current?.videoWidth && onTake([await frameOf(video.current)]);
  /** What a browser has recorded may not say how long it is: looked for beyond its end, the browser finds out. */
  const loaded = ({ target }) => {
    set({ isLoaded: true, length: lengthOf(target) });
    if (!lengthOf(target)) target.currentTime = BEYOND_S;
  };
  const measured = ({ target }) => {
    if (!state.isLoaded || state.length || !lengthOf(target)) return;
    set({ length: lengthOf(target) });
    target.currentTime = 0;
  };
  const isOff = isFull || state.busy || !state.isLoaded;
  return html`
    <${Field} type="file" label=${words.recording} hint=${words.recordingHint} accept="video/*" onInput=${open} />
    ${state.broken && html`<${Notice} tone="warn" title=${words.unplayable}>${words.unplayableBody}<//>`}
    ${state.url && !state.broken && html`
      <div class="stack tight">
        <div class="screen own"><video ref=${video} src=${state.url} muted playsinline preload="auto" aria-label=${words.recording}
          onLoadedData=${loaded} onDurationChange=${measured} onError=${() => set({ broken: true })}
          onSeeked=${event => set({ at: event.target.currentTime })}></video></div>
        ${state.isLoaded && !state.length && html`<${Notice} tone="warn" title=${words.endless}>${words.endlessBody}<//>`}
        <label class="field"><span class="label">${words.moment(clock(state.at), clock(state.length))}</span>
          <input type="range" min="0" max=${state.length || 1} step="0.01" value=${state.at} disabled=${!state.length}
            onInput=${event => (video.current.currentTime = Number(event.target.value))} /></label>
        <div class="row">
          <button class="button" type="button" disabled=${isOff} onClick=${take}>${words.take}</button>
          <button class="button" type="button" disabled=${isOff || !state.length} onClick=${spread}>${words.spread(Math.min(SPREAD, most))}</button>
        </div>
      </div>`}`;
}

/** Zero where it is not known. */
const lengthOf = ({ duration }) => (Number.isFinite(duration) ? duration : 0);

/** The video once it shows this moment, or will never show it. */
function sought(video, second) {
  return new Promise(resolve => {
    video.addEventListener('seeked', () => requestAnimationFrame(() => requestAnimationFrame(resolve)), { once: true });
    for (const end of ['error', 'emptied']) video.addEventListener(end, resolve, { once: true });
    video.currentTime = second;
  });
}
