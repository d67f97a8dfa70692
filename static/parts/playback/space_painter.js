// Paints paths in space onto a canvas. The paths do not change while the video plays, so they are painted once per view
// into a layer; a tick of the clock then costs one copy and two tips.
import { number } from '../../format.js';
import { colour } from '../../theme.js';
import { fitCanvas, outline, textColours } from './overlay.js';
import { frameAt, isAfterHole, MISSING, PREDICTED } from './track.js';

/** Segments per tool: a canvas has no space for more, so longer recordings are thinned. */
const MAX_SEGMENTS = 4000;
const SHADES = 24;
const GHOST_ALPHA = 0.35;

export class SpacePainter {
  #layer = document.createElement('canvas');
  #painted = '';
  track;
  tools;
  by;
  ghost;
  bounds;

  /**
   * `ghost`: another session's `{ track, shift }`, drawn faint under this one.
   *
   * @param {any} track
   * @param {any[]} tools
   * @param {string} by
   * @param {{ track: any, shift: number } | null} [ghost]
   */
  constructor(track, tools, by, ghost = null) {
    [this.track, this.tools, this.by, this.ghost] = [track, tools, by, ghost];
    this.bounds = boundsOf([...track.tools, ...(ghost?.track.tools ?? [])]);
  }

  /** The colours have changed: the painted layer is out of date. */
  invalidate() {
    this.#painted = '';
  }

  paint(canvas, orbit, frame) {
    const { pen, width, height } = fitCanvas(canvas);
    if (!width) return;
    const project = orbit.projection(this.bounds, width, height);
    const view = [orbit.yaw, orbit.pitch, orbit.zoom, canvas.width, canvas.height].join();
    if (view !== this.#painted) this.#paintLayer(canvas, project);
    this.#painted = view;
    pen.drawImage(this.#layer, 0, 0, width, height);
    if (this.ghost) this.#paintGhostTips(pen, frame, project);
    for (const tool of this.tools) drawTip(pen, tool, frame, project);
  }

  #paintLayer({ width, height, clientWidth }, project) {
    Object.assign(this.#layer, { width, height }); // Setting the size clears it, too.
    const pen = /** @type {CanvasRenderingContext2D} */ (this.#layer.getContext('2d'));
    pen.scale(width / clientWidth, width / clientWidth);
    [pen.lineCap, pen.lineJoin] = ['butt', 'bevel']; // Round ones cost more, and at two pixels they look the same.
    drawFloor(pen, this.bounds, project);
    if (this.ghost) this.#drawGhost(pen, tool => drawPath(pen, this.ghost.track, tool, project));
    const shades = this.by === 'speed' ? speedShades() : null;
    for (const tool of this.tools) drawPath(pen, this.track, tool, project, { shades });
  }

  /** Draws the other session's tools that have the names shown. */
  #drawGhost(pen, draw) {
    const names = this.tools.map(tool => tool.name);
    pen.globalAlpha = GHOST_ALPHA;
    for (const tool of this.ghost.track.tools) if (names.includes(tool.name)) draw(tool);
    pen.globalAlpha = 1;
  }

  /** The other session's tips at the same time after its beginning. */
  #paintGhostTips(pen, frame, project) {
    const { track, shift } = this.ghost;
    const time = this.track.times[frame] + shift;
    if (!(time >= track.times[0] && time <= track.times[track.frames - 1])) return;
    this.#drawGhost(pen, tool => drawTip(pen, tool, frameAt(track.times, time), project));
  }
}

/** The space of all paths. */
function boundsOf(tools) {
  const extent = ['x_mm', 'y_mm', 'z_mm'].map(field => {
    let [low, high] = [Infinity, -Infinity];
    for (const tool of tools)
      for (const value of tool[field])
        if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
    return low > high ? [-50, 50] : [low, high];
  });
  return boundsAround(extent);
}

/** The box around a lowest and highest x, y and z, a little wider, and the radius of the ball that the view rotates. */
export function boundsAround(extent) {
  const step = 20;
  const ends = extent.map(([low, high]) => [
    Math.floor((low - 5) / step) * step,
    Math.ceil((high + 5) / step) * step + 0, // No −0.
  ]);
  const radius = Math.hypot(...ends.map(([low, high]) => (high - low) / 2));
  return { ends, radius, centre: ends.map(([low, high]) => (low + high) / 2) };
}

/** A grid of 20 mm at the greatest depth, and the three axes with their units. */
export function drawFloor(pen, { ends: [x, y, z] }, project) {
  const { muted, line } = textColours();
  const stroke = (from, to, style) => {
    pen.strokeStyle = style;
    pen.beginPath();
    pen.moveTo(...project(...from));
    pen.lineTo(...project(...to));
    pen.stroke();
  };
  pen.lineWidth = 1;
  for (let at = x[0]; at <= x[1]; at += 20) stroke([at, y[0], z[1]], [at, y[1], z[1]], line);
  for (let at = y[0]; at <= y[1]; at += 20) stroke([x[0], at, z[1]], [x[1], at, z[1]], line);
  const middle = project(...[x, y, z].map(([low, high]) => (low + high) / 2));
  const corner = [x[0], y[1], z[1]];
  const axes = [
    [[x[1], y[1], z[1]], `x ${number(x[0])} … ${number(x[1])} mm`],
    [[x[0], y[0], z[1]], `y ${number(y[0])} … ${number(y[1])} mm`],
    [[x[0], y[1], z[0]], `z ${number(z[0])} … ${number(z[1])} mm`],
  ];
  pen.font = '12px system-ui, sans-serif';
  pen.fillStyle = muted;
  for (const [end] of axes) stroke(corner, end, muted);
  pen.lineWidth = 4;
  for (const [end, name] of axes) label(pen, name, [project(...corner), project(...end)], middle);
}

/**
 * Puts a text beside its axis, on the side away from the middle, close to the axis without touching it, inside the
 * canvas.
 */
function label(pen, words, [[x0, y0], [x1, y1]], middle) {
  const labelWidth = pen.measureText(words).width;
  const [x, y] = [x0 + (x1 - x0) * 0.75, y0 + (y1 - y0) * 0.75];
  const length = Math.hypot(x1 - x0, y1 - y0) || 1; // An axis that points at the viewer is not visible.
  const [across, down] = [(y0 - y1) / length, (x1 - x0) / length];
  const side = Math.sign(across * (x - middle[0]) + down * (y - middle[1])) || 1;
  const off = side * ((Math.abs(across) * labelWidth) / 2 + Math.abs(down) * 6 + 6);
  const scale = pen.getTransform().a; // Device pixels per CSS pixel.
  const [width, height] = [pen.canvas.width / scale, pen.canvas.height / scale];
  const [left, base] = [x + across * off - labelWidth / 2, y + down * off + 4];
  const at = [Math.min(Math.max(4, left), width - labelWidth - 4), Math.min(Math.max(12, base), height - 4)];
  pen.strokeStyle = colour('--surface'); // Hides lines that pass behind the text.
  pen.strokeText(words, ...at);
  pen.fillText(words, ...at);
}

/**
 * Segments are grouped by shade and painted shade by shade: a stroke per segment would be too slow.
 *
 * @param {CanvasRenderingContext2D} pen
 * @param {any} track
 * @param {any} tool
 * @param {(x: number, y: number, z: number) => number[]} project
 * @param {{ shades?: string[] | null, from?: number, to?: number, ink?: string }} [options]
 */
export function drawPath(pen, track, tool, project, { shades, from = 0, to = track.frames, ink = tool.ink() } = {}) {
  // For a long recording, only the frames that determine its shape.
  const shapeFrames = from === 0 && to === track.frames ? track.shapeFrames : null;
  const count = shapeFrames ? shapeFrames.length : to - from;
  const stride = Math.max(1, Math.ceil(count / MAX_SEGMENTS));
  const paths = new Map();
  const top = track.topSpeed || 1;
  let [before, last] = [/** @type {number[] | null} */ (null), 0];
  for (let at = 0; at < count; at += stride) {
    const i = shapeFrames ? shapeFrames[at] : from + at;
    // Rows may have been left out by the service or by `stride`: only a missing tool or a pause is a break.
    if (shapeFrames ? i > 0 && tool.state[last + 1] === MISSING : hasHole(track, i, stride)) before = null;
    last = i;
    if (tool.state[i] === MISSING || !Number.isFinite(tool.x_mm[i])) {
      before = null;
      continue;
    }
    const point = project(tool.x_mm[i], tool.y_mm[i], tool.z_mm[i]);
    if (before) {
      const speed = Number.isFinite(tool.speed[i]) ? tool.speed[i] : 0;
      const style = shades ? shades[Math.min(SHADES - 1, Math.floor((speed / top) * SHADES))] : ink;
      if (!paths.has(style)) paths.set(style, { path: new Path2D(), end: null });
      const stroke = /** @type {{ path: Path2D, end: number[] | null }} */ (paths.get(style));
      if (stroke.end !== before) stroke.path.moveTo(before[0], before[1]);
      stroke.path.lineTo(point[0], point[1]);
      stroke.end = point;
    }
    before = point;
  }
  pen.lineWidth = 2;
  for (const [style, { path }] of paths) {
    pen.strokeStyle = style;
    pen.stroke(path);
  }
}

/** Whether frames are missing between this one and the one drawn before it. */
function hasHole(track, frame, stride) {
  for (let i = Math.max(1, frame - stride + 1); i <= frame; i++) if (isAfterHole(track, i)) return true;
  return false;
}

export function drawTip(pen, tool, frame, project) {
  if (tool.state[frame] === MISSING || !Number.isFinite(tool.x_mm[frame])) return;
  const [x, y] = project(tool.x_mm[frame], tool.y_mm[frame], tool.z_mm[frame]);
  pen.setLineDash(tool.state[frame] === PREDICTED ? [3, 3] : []);
  outline(pen, tool.shape, x, y, 8);
  pen.lineWidth = 5;
  pen.strokeStyle = colour('--surface');
  pen.stroke();
  pen.lineWidth = 2.5;
  pen.strokeStyle = tool.ink();
  pen.stroke();
  pen.setLineDash([]);
}

/** Slow to fast, mixed in the browser's perceptual colour space. */
function speedShades() {
  const [slow, fast] = [colour('--slow'), colour('--fast')];
  return Array.from(
    { length: SHADES },
    (_, i) => `color-mix(in oklab, ${fast} ${Math.round((100 * i) / (SHADES - 1))}%, ${slow})`,
  );
}
