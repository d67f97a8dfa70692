// The picture of the camera with the record button, and the time recorded so far.
import { html, useState } from '../../preact.js';
import { clock } from '../../format.js';
import { t } from '../../texts.js';
import { icons } from '../page/icons.js';
import { CameraScreen } from './camera_screen.js';
import { CameraOff } from './record_camera.js';

const words = t.record;

/** @param {Props} props */
export function RecordView({ recording, camera, watch, isReady, onPress }) {
  const [isDrawn, setDrawn] = useState(true);
  const isPhase = phase => recording?.phase === phase;
  const label = isPhase('recording') ? words.stop : isPhase('sending') ? words.sending : words.start;
  const isOff = isPhase('sending') || (!isPhase('recording') && !isReady);
  return html`
    <section class="card">
      ${camera.stream ? html`<${CameraScreen} stream=${camera.stream} name=${words.picture} watch=${isDrawn && watch}
        delay=${() => delayOf(recording, watch)} />` : html`<${CameraOff} camera=${camera} />`}
      <div class="record-bar">
        <button class=${`button record-button ${isPhase('recording') ? 'stop' : 'main'}`} type="button" disabled=${isOff}
          onClick=${onPress}>${isPhase('recording') ? html`<${icons.stop} />` : html`<${icons.record} />`}${label}</button>
        ${watch?.track && html`<button class="button" type="button" aria-pressed=${isDrawn}
          onClick=${() => setDrawn(!isDrawn)}>${words.overlay}</button>`}
        ${(isPhase('recording') || isPhase('sending')) && html`<span class=${`elapsed ${isPhase('recording') ? 'runs' : ''}`}
          role="timer" aria-label=${words.elapsed}>${clock(recording.seconds ?? 0, 0)}</span>`}
      </div>
    </section>`;
}

/** The age of the newest position, s; NaN while there is none. */
export function delayOf(recording, watch) {
  return watch?.track?.frames ? Math.max(0, recording.seconds - watch.track.time) : NaN;
}
