// Painting on a frame: strokes, rectangles and points, by mouse, pen, finger and keyboard; draws the marks over the
// frame.
import { html, useEffect, useRef, useState } from '../preact.js';
import { t } from '../texts.js';
import { rectangleOf, strokeRectangles } from './marks.js';
import { MaskLayer } from './mask_layer.js';

const words = t.setup.colours;
const STEP_PX = 2;
const LONG_STEP_PX = 20;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** `brush`: `{ kind: brush|rectangle|move, size, label, zoom }`, sizes in pixels of the frame. `onMark(rectangles)`. */
export function Painter({ frame, brush, mask, inkOf, onMark }) {
  const canvas = useRef(null);
  const currentPath = useRef(null); // The path that is being drawn.
  const [cursor, setCursor] = useState(null); // The position of the keyboard cursor.
  const { width, height } = frame;
  const rectanglesOf = path =>
    brush.kind === 'rectangle' ? rectangleOf(path[0], path[path.length - 1], frame) : strokeRectangles(path, brush.size, frame);
  const draw = () => paint(canvas.current, { frame, brush, inkOf, path: currentPath.current, rectanglesOf, cursor });
  useEffect(draw);
  useEffect(() => cursor && reveal(canvas.current, cursor), [cursor, brush.zoom]);

  const framePoint = event => {
    const box = canvas.current.getBoundingClientRect();
    return [((event.clientX - box.left) * width) / box.width, ((event.clientY - box.top) * height) / box.height];
  };
  const down = event => {
    if (event.button !== 0) return;
    canvas.current.setPointerCapture(event.pointerId);
    if (brush.kind === 'move') return;
    setCursor(null);
    currentPath.current = [framePoint(event)];
    draw();
  };
  const move = event => {
    if (brush.kind === 'move') return event.buttons && pan(canvas.current, event);
    if (!currentPath.current) return;
    const all = event.getCoalescedEvents?.() ?? [];
    currentPath.current.push(...(all.length ? all : [event]).map(framePoint));
    draw();
  };
  const up = () => {
    if (!currentPath.current) return;
    const path = currentPath.current;
    currentPath.current = null;
    onMark(rectanglesOf(path));
    draw();
  };
  const cancel = () => ((currentPath.current = null), draw());
  const key = event => {
    const [x, y] = cursor ?? [width / 2, height / 2];
    const arrow = ARROWS[event.key];
    if (arrow) {
      const step = event.shiftKey ? LONG_STEP_PX : STEP_PX;
      setCursor([clamp(x + arrow[0] * step, width), clamp(y + arrow[1] * step, height)]);
    } else if (event.key === ' ' || event.key === 'Enter') {
      setCursor([x, y]);
      onMark(strokeRectangles([[x, y]], brush.size, frame));
    } else return;
    event.preventDefault();
  };
  return html`
    <div class="painter" tabindex="0" role="application" aria-label=${words.painter(frame.number + 1, width, height)}
      aria-describedby="painter-keys" onKeyDown=${key} onFocus=${event => event.target.matches(':focus-visible') && setCursor([width / 2, height / 2])}>
      <div class="zoomed" style=${{ width: `${100 * brush.zoom}%`, aspectRatio: `${width} / ${height}` }}>
        <img src=${frame.url} alt="" draggable="false" />
        ${mask && html`<${MaskLayer} mask=${mask} inkOf=${inkOf} />`}
        <canvas ref=${canvas} width=${width} height=${height} class=${`paint ${brush.kind}`} aria-hidden="true"
          onPointerDown=${down} onPointerMove=${move} onPointerUp=${up} onPointerCancel=${cancel}></canvas>
      </div>
    </div>`;
}

/** Scrolls a zoomed picture to the cursor, with some space around it. */
function reveal(canvas, [x, y]) {
  const container = canvas.closest('.painter');
  const scrollTarget = (from, at, size) => Math.min(Math.max(from, at - 0.8 * size), at - 0.2 * size);
  container.scrollTo(
    scrollTarget(container.scrollLeft, (x / canvas.width) * canvas.clientWidth, container.clientWidth),
    scrollTarget(container.scrollTop, (y / canvas.height) * canvas.clientHeight, container.clientHeight),
  );
}

/** A finger scrolls by itself; a mouse drags the picture. */
function pan(canvas, { movementX, movementY, pointerType }) {
  if (pointerType === 'mouse') canvas.closest('.painter').scrollBy(-movementX, -movementY);
}

const clamp = (value, size) => Math.min(size - 1, Math.max(0, value));

function paint(canvas, { frame, brush, inkOf, path, rectanglesOf, cursor }) {
  const pen = canvas.getContext('2d');
  pen.clearRect(0, 0, canvas.width, canvas.height);
  for (const { label, rectangles } of frame.marks) fill(pen, rectangles, inkOf(label));
  if (path) fill(pen, rectanglesOf(path), inkOf(brush.label));
  if (!cursor) return;
  pen.lineWidth = Math.max(1, canvas.width / 500);
  for (const [ink, radius] of [['#000', brush.size / 2 + pen.lineWidth], ['#fff', brush.size / 2]]) {
    pen.strokeStyle = ink;
    pen.beginPath();
    pen.arc(...cursor, radius, 0, 7);
    pen.stroke();
  }
}

/** Half transparent, without seams between the rectangles of one stroke. */
function fill(pen, rectangles, ink) {
  pen.globalAlpha = 0.55;
  pen.fillStyle = ink;
  pen.beginPath();
  for (const { x, y, w, h } of rectangles) pen.rect(x, y, w, h);
  pen.fill();
  pen.globalAlpha = 1;
}
