// The picture of this device's own camera, not via the server, with what the tracker saw last drawn over it.
import { html, useEffect, useRef } from '../../preact.js';
import { drawOverlay, fitCanvas } from '../playback/overlay.js';

const SHOW = { tip: true, borders: true, path: true };
const NONE = new Set();
/** Older positions are no longer where the tools are, s. */
const MAX_DELAY_S = 1;

/** `delay()` returns the age of the newest position, s. @param {Props} props */
export function CameraScreen({ stream, name, watch, delay, children }) {
  const video = useRef(null);
  const overlay = useRef(null);
  const currentDelay = useRef(delay);
  currentDelay.current = delay;
  useEffect(() => void (video.current.srcObject = stream), [stream]);
  useEffect(() => {
    if (!watch) return undefined;
    const draw = () => {
      const { track } = watch;
      if (track?.frames && watch.isFresh && currentDelay.current() <= MAX_DELAY_S)
        drawOverlay(overlay.current, track, track.last, { show: SHOW, hidden: NONE });
      else fitCanvas(overlay.current); // This clears it.
    };
    const resize = new ResizeObserver(draw);
    resize.observe(overlay.current);
    const unsubscribe = watch.onTick(draw);
    return () => (unsubscribe(), resize.disconnect(), overlay.current && fitCanvas(overlay.current));
  }, [watch]);
  return html`
    <div class="screen own">
      <video ref=${video} muted playsinline autoplay aria-label=${name}></video>
      <canvas ref=${overlay} aria-hidden="true"></canvas>
      ${children}
    </div>`;
}
