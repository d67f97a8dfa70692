// The picture of a box as it arrives, with the overlay of that very frame.
import { html, useEffect, useRef } from '../../preact.js';
import { t } from '../../texts.js';
import { drawOverlay } from '../playback/overlay.js';

const words = t.watch;
const ALL = { tip: true, borders: true, path: true, depth: true };
const NONE = new Set();

/** @param {Props} props */
export function LiveScreen({ watch, name, show = ALL }) {
  const screen = useRef(null);
  const picture = useRef(null);
  const overlay = useRef(null);
  useEffect(() => {
    let shown = null;
    const draw = () => {
      if (watch.picture && watch.picture !== shown) drawPicture(picture.current, watch.picture.bitmap);
      shown = watch.picture;
      const { track } = watch;
      if (track?.frames) drawOverlay(overlay.current, track, track.rowOf(shown?.frame), { show, hidden: NONE });
    };
    const resize = new ResizeObserver(draw);
    resize.observe(screen.current);
    const unsubscribe = watch.onTick(draw);
    return () => (unsubscribe(), resize.disconnect());
  }, [watch]);
  const notice = noticeText(watch);
  return html`
    <div ref=${screen} class=${`screen live ${watch.isFresh ? '' : 'stale'}`}>
      <canvas ref=${picture} role="img" aria-label=${name}></canvas>
      <canvas ref=${overlay} aria-hidden="true"></canvas>
      ${notice && html`<p class="words" role="status">${notice}</p>`}
    </div>`;
}

/** Setting a canvas's size clears it, so it is set only when the size changes. */
function drawPicture(canvas, bitmap) {
  const { width, height } = bitmap;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  canvas.getContext('2d', { alpha: false }).drawImage(bitmap, 0, 0);
}

/** Why no current picture is shown, in words; null if one is. */
function noticeText({ state, track, why }) {
  if (state !== 'live') return words.states[state];
  if (why) return words.notTracked(why);
  return track?.frames ? null : words.begins;
}
