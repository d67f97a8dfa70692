// The shafts of instruments without tape that were found on a frame, drawn over it.
import { html } from '../preact.js';

/** Length of the line across a shaft's end, as a multiple of its width. */
const END_WIDTHS = 1.6;

/** `mask` gives the picture's size; `shafts` are those of this frame. */
export function ShaftLayer({ mask, shafts }) {
  const found = shafts.filter(({ edges_px }) => edges_px);
  return html`
    <svg class="shafts" viewBox=${`0 0 ${mask.width} ${mask.height}`} preserveAspectRatio="none" aria-hidden="true">
      ${found.map(shaft => html`<g key=${shaft.tool}>
        ${linesOf(shaft).map(([[x1, y1], [x2, y2]], i) => html`<line key=${i} x1=${x1} y1=${y1} x2=${x2} y2=${y2} />`)}
      </g>`)}
    </svg>`;
}

/** Both edges, and a line across the end if it was found. */
function linesOf({ edges_px, end_px }) {
  if (!end_px) return edges_px;
  const [[, one], [, other]] = edges_px;
  const half = [0, 1].map(axis => (END_WIDTHS * (other[axis] - one[axis])) / 2);
  const endAt = sign => [0, 1].map(axis => end_px[axis] + sign * half[axis]);
  return [...edges_px, [endAt(-1), endAt(1)]];
}
