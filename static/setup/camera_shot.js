// The picture of this device's camera, with a button that captures it: a photo of the board, a frame of the box.
import { html, useEffect, useRef, useState } from '../preact.js';
import { t } from '../texts.js';
import { icons } from '../parts/page/icons.js';
import { CameraFields, CameraOff } from '../parts/recording/record_camera.js';
import { useCamera } from '../parts/recording/use_camera.js';
import { frameOf } from './pictures.js';

const words = t.setup.shot;
const DEFAULT_SIZE = '1920x1080';

/** What is shown over the picture while photos are taken by themselves: the number so far, large enough to read from the box. */
const Counter = ({ auto }) => html`<div class="auto-photos" role="status">
  <strong>${auto.count}</strong><span>${auto.says}</span></div>`;

/**
 * `calibrated`: the picture size that the box is calibrated for, if it is. `onShot(blob)`. `other`: a second button,
 * `{ label, onShot }`. `auto`: photos that are taken by themselves, `{ label, stop, isOn, toggle(look), count, says }`.
 */
export function CameraShot({ calibrated, label, onShot, disabled, other, auto }) {
  const camera = useCamera(calibrated ? `${calibrated.width}x${calibrated.height}` : DEFAULT_SIZE);
  const video = useRef(null);
  const [isTaking, setTaking] = useState(false);
  useEffect(() => void (video.current && (video.current.srcObject = camera.stream)), [camera.stream]);
  const take = async onTaken => {
    if (!video.current?.videoWidth) return; // The camera is on but has given no picture yet.
    setTaking(true);
    try {
      onTaken(await frameOf(video.current));
    } finally {
      setTaking(false);
    }
  };
  return html`
    <div class="stack tight shot">
      ${camera.stream ? html`<div class=${`screen own ${isTaking ? 'taking' : ''}`}>
        <video ref=${video} muted playsinline autoplay aria-label=${t.record.picture}></video>
        ${auto?.isOn && html`<${Counter} auto=${auto} />`}</div>`
        : html`<${CameraOff} camera=${camera} />`}
      <div class="row">
        <button class="button main" type="button" disabled=${!camera.stream || isTaking || disabled || auto?.isOn}
          onClick=${() => take(onShot)}><${icons.camera} />${label}</button>
        ${auto && html`<button class="button" type="button" disabled=${!camera.stream} aria-pressed=${String(auto.isOn)}
          onClick=${() => auto.toggle(() => (video.current?.videoWidth ? frameOf(video.current) : null))}>${auto.isOn ? auto.stop : auto.label}</button>`}
        ${other && html`<button class="button" type="button" disabled=${!camera.stream || isTaking}
          onClick=${() => take(other.onShot)}>${other.label}</button>`}
      </div>
      <details>
        <summary>${words.settings}</summary>
        <div class="fields"><${CameraFields} camera=${camera} calibrated=${calibrated} /></div>
      </details>
    </div>`;
}
