// What is taken for tape or bare shaft on a frame, drawn over it.
import { html, useEffect, useRef } from '../preact.js';
import { drawMask } from './preview.js';

/** `mask` is a frame's, with `colours`, the labels of its classes. */
export function MaskLayer({ mask, inkOf }) {
  const canvas = useRef(null);
  useEffect(() => drawMask(canvas.current, mask, kind => inkOf(mask.colours[kind - 1])), [mask]);
  return html`<canvas ref=${canvas} class="mask" aria-hidden="true"></canvas>`;
}
