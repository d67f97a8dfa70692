// The picture of this device's camera, with a button that captures it: a photo of the board, a frame of the box.
import { html, useEffect, useRef, useState } from '../preact.js';
import { t } from '../texts.js';
import { icons } from '../parts/page/icons.js';
import { CameraFields, CameraOff } from '../parts/recording/record_camera.js';
import { useCamera } from '../parts/recording/use_camera.js';
import { frameOf } from './pictures.js';

const words = t.setup.shot;
const DEFAULT_SIZE = '1920x1080';

/**
 * `calibrated`: the picture size that the box is calibrated for, if it is. `onShot(blob)`. `other`: a second button,
 * `{ label, onShot }`.
 */
export function CameraShot({ calibrated, label, onShot, disabled, other }) {
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
        <video ref=${video} muted playsinline autoplay aria-label=${t.record.picture}></video></div>`
        : html`<${CameraOff} camera=${camera} />`}
      <div class="row">
        <button class="button main" type="button" disabled=${!camera.stream || isTaking || disabled}
          onClick=${() => take(onShot)}><${icons.camera} />${label}</button>
        ${other && html`<button class="button" type="button" disabled=${!camera.stream || isTaking}
          onClick=${() => take(other.onShot)}>${other.label}</button>`}
      </div>
      <details>
        <summary>${words.settings}</summary>
        <div class="fields"><${CameraFields} camera=${camera} calibrated=${calibrated} /></div>
      </details>
    </div>`;
}
