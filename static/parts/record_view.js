// The picture of the camera with the one button that matters, and how long it has been recorded.
import { html, useState } from './preact.js';
import { clock } from '../format.js';
import { t } from '../texts.js';
import { icons } from './icons.js';
import { OwnScreen } from './own_screen.js';
import { CameraOff } from './record_camera.js';

const words = t.record;

export function RecordView({ now, camera, watch, isReady, onPress }) {
  const [isDrawn, setDrawn] = useState(true);
  const is = phase => now?.phase === phase;
  const label = is('recording') ? words.stop : is('sending') ? words.sending : words.start;
  const isOff = is('sending') || (!is('recording') && !isReady);
  return html`
    <section class="card">
      ${camera.stream ? html`<${OwnScreen} stream=${camera.stream} name=${words.picture} watch=${isDrawn && watch}
        behind=${() => behindOf(now, watch)} />` : html`<${CameraOff} camera=${camera} />`}
      <div class="record-bar">
        <button class=${`button record-button ${is('recording') ? 'stop' : 'main'}`} type="button" disabled=${isOff}
          onClick=${onPress}>${is('recording') ? html`<${icons.stop} />` : html`<${icons.record} />`}${label}</button>
        ${watch?.track && html`<button class="button" type="button" aria-pressed=${isDrawn}
          onClick=${() => setDrawn(!isDrawn)}>${words.overlay}</button>`}
        ${(is('recording') || is('sending')) && html`<span class=${`elapsed ${is('recording') ? 'runs' : ''}`}
          role="timer" aria-label=${words.elapsed}>${clock(now.seconds ?? 0, 0)}</span>`}
      </div>
    </section>`;
}

/** How old the newest position is, seconds; NaN while there is none. */
export function behindOf(now, watch) {
  return watch?.track?.frames ? Math.max(0, now.seconds - watch.track.time) : NaN;
}
