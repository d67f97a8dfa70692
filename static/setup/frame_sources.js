// Where frames come from: this device's camera, a recording of the box, or picture files.
import { html, useEffect, useRef, useState } from '../preact.js';
import { clock } from '../format.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { Notice } from '../parts/page/notice.js';
import { addFrames, MAX_FRAMES } from './frames.js';
import { frameOf } from './pictures.js';
import { CameraShot } from './camera_shot.js';

const words = t.setup.colours;
const SOURCES = ['recording', 'camera', 'files'];
/** @type {{ url: string | null, isLoaded: boolean, length: number, at: number, broken: boolean, busy: boolean }} */
const NO_RECORDING = { url: null, isLoaded: false, length: 0, at: 0, broken: false, busy: false };
const BEYOND_S = 1e7;
/** Frames taken at once, spread over a recording. */
const SPREAD_FRAMES = 5;

/** `onEmptyBox(blob)`, if the picture of the empty box is wanted. @param {Props} props */
export function FrameSources({ box, draft, onProblem, onEmptyBox }) {
  const [source, setSource] = useState('recording');
  const isFull = draft.frames.length >= MAX_FRAMES;
  const add = pictures => addFrames(draft, pictures, onProblem);
  const choose = event => {
    add([...event.target.files]);
    event.target.value = '';
  };
  return html`
    <div class="stack">
      <div class="row" role="group" aria-label=${words.from}>
        ${SOURCES.map(one => html`<button key=${one} class="button" type="button" aria-pressed=${source === one}
          onClick=${() => setSource(one)}>${words.ways[one]}</button>`)}
      </div>
      ${isFull && html`<${Notice} quiet title=${words.full(MAX_FRAMES)}>${words.fullBody}<//>`}
      ${source === 'recording' && html`<${Recording} isFull=${isFull} remaining=${MAX_FRAMES - draft.frames.length}
        onTake=${add} onEmptyBox=${onEmptyBox} />`}
      ${source === 'camera' && html`<${CameraShot} calibrated=${box.calibration} label=${words.take} disabled=${isFull}
        onShot=${blob => add([blob])} other=${onEmptyBox && { label: words.empty.shoot, onShot: onEmptyBox }} />`}
      ${source === 'files' && html`<${Field} type="file" label=${words.pictures} hint=${words.picturesHint} accept="image/*"
        multiple disabled=${isFull} onInput=${choose} />`}
    </div>`;
}

/** A recording on this device: only the frames that are taken are sent. */
function Recording({ isFull, remaining, onTake, onEmptyBox }) {
  const video = useRef(null);
  const [state, setState] = useState(NO_RECORDING);
  useEffect(() => () => state.url && URL.revokeObjectURL(state.url), [state.url]);
  const set = more => setState(before => ({ ...before, ...more }));
  const open = event => {
    const [file] = event.target.files;
    if (file) setState({ ...NO_RECORDING, url: URL.createObjectURL(file) });
  };
  const takeSpread = async () => {
    set({ busy: true });
    const count = Math.min(SPREAD_FRAMES, remaining);
    const { url } = state;
    const isCurrent = () => video.current?.src === url; // Another step or another recording ends this.
    try {
      for (let i = 0; i < count && isCurrent(); i++) {
        await seekTo(video.current, ((i + 0.5) * state.length) / count);
        if (isCurrent()) await onTake([await frameOf(video.current)]);
      }
    } finally {
      if (isCurrent()) set({ busy: false, at: video.current.currentTime });
    }
  };
  const take = async () => video.current?.videoWidth && onTake([await frameOf(video.current)]);
  const takeEmpty = async () => video.current?.videoWidth && onEmptyBox(await frameOf(video.current));
  /** A recording made by a browser may not state its length: a seek beyond its end makes the browser find it. */
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
          <button class="button" type="button" disabled=${isOff || !state.length} onClick=${takeSpread}>${words.spread(Math.min(SPREAD_FRAMES, remaining))}</button>
          ${onEmptyBox && html`<button class="button" type="button" disabled=${state.busy || !state.isLoaded}
            onClick=${takeEmpty}>${words.empty.take}</button>`}
        </div>
      </div>`}`;
}

/** Zero if it is not known. */
const lengthOf = ({ duration }) => (Number.isFinite(duration) ? duration : 0);

/** Resolves when the video shows this moment, or never will. */
function seekTo(video, second) {
  return new Promise(resolve => {
    video.addEventListener('seeked', () => requestAnimationFrame(() => requestAnimationFrame(resolve)), { once: true });
    for (const end of ['error', 'emptied']) video.addEventListener(end, resolve, { once: true });
    video.currentTime = second;
  });
}
