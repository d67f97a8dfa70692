// The picture of this device's own camera, at once and not by way of the server, and over it what the tracker saw last.
import { html, useEffect, useRef } from './preact.js';
import { drawOverlay, fitCanvas } from './overlay.js';

const SHOW = { tip: true, borders: true, path: true };
const NONE = new Set();
/** Positions that are older are not where the tools are any more, seconds. */
const MOST_BEHIND_S = 1;

/** `behind()` tells how old the newest position is, seconds. */
export function OwnScreen({ stream, name, watch, behind, children }) {
  const video = useRef(null);
  const overlay = useRef(null);
  const late = useRef(behind);
  late.current = behind;
  useEffect(() => void (video.current.srcObject = stream), [stream]);
  useEffect(() => {
    if (!watch) return undefined;
    const draw = () => {
      const { track } = watch;
      if (track?.frames && watch.isFresh && late.current() <= MOST_BEHIND_S)
        drawOverlay(overlay.current, track, track.last, { show: SHOW, hidden: NONE });
      else fitCanvas(overlay.current); // Which clears it.
    };
    const resize = new ResizeObserver(draw);
    resize.observe(overlay.current);
    const end = watch.onTick(draw);
    return () => (end(), resize.disconnect(), overlay.current && fitCanvas(overlay.current));
  }, [watch]);
  return html`
    <div class="screen own">
      <video ref=${video} muted playsinline autoplay aria-label=${name}></video>
      <canvas ref=${overlay} aria-hidden="true"></canvas>
      ${children}
    </div>`;
}
