// What the tracker saw, drawn over the recording: past path, borders, tip, depth. Plain canvas, one call per picture.
import { colour } from '../../theme.js';
import { t } from '../../texts.js';
import { isAfterHole, isExact, MISSING, PREDICTED } from './track.js';

const PATH_S = 2;
const FONT = '600 13px system-ui, sans-serif';
const HALO = 'rgb(0 0 0 / 70%)';

/** Where the picture lies inside its element (`object-fit: contain`), in CSS pixels. */
function pictureBox(width, height, shown) {
  const scale = Math.min(width / shown.width, height / shown.height);
  const [w, h] = [shown.width * scale, shown.height * scale];
  return { width: w, height: h, left: (width - w) / 2, top: (height - h) / 2 };
}

/** Gives a canvas the resolution of the screen and clears it; returns its size in CSS pixels. */
export function fitCanvas(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const ratio = devicePixelRatio || 1;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
  const pen = canvas.getContext('2d');
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}

/**
 * `show`: the layers to draw; `hidden`: the tools that are switched off; `shown`: the size at which the video is shown, if
 * known. It has other proportions than the measured picture if pixels are not square.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {any} track
 * @param {number} frame
 * @param {{ show: Record<string, boolean>, hidden: Set<string>, size?: { width: number, height: number },
 *   shown?: { width: number, height: number } }} options
 */
export function drawOverlay(canvas, track, frame, { show, hidden, size, shown }) {
  const { pen, width, height } = fitCanvas(canvas);
  const picture = { width: track.width ?? size?.width, height: track.height ?? size?.height };
  if (!picture.width || !width || !isExact(track, frame)) return;
  const box = pictureBox(width, height, shown?.width ? shown : picture);
  const [across, down] = [box.width / picture.width, box.height / picture.height];
  // OpenCV counts from the centre of the first pixel, a canvas from its corner.
  const project = (u, v) => [box.left + (u + 0.5) * across, box.top + (v + 0.5) * down];
  pen.lineCap = pen.lineJoin = 'round';
  const missing = [];
  for (const tool of track.tools) {
    if (hidden.has(tool.name)) continue;
    if (show.path) drawPath(pen, track, tool, frame, project);
    if (show.mask) drawMask(pen, tool, frame, project);
    if (show.borders) drawBorders(pen, tool, frame, project);
    if (show.midline) drawMidline(pen, tool, frame, project);
    if (tool.state[frame] === MISSING) missing.push(tool);
    if (tool.state[frame] === MISSING || Number.isNaN(tool.tip_u_px[frame])) continue;
    const [x, y] = project(tool.tip_u_px[frame], tool.tip_v_px[frame]);
    if (show.tip) drawTip(pen, tool, tool.state[frame] === PREDICTED, x, y);
    if (show.depth) drawDepth(pen, tool, frame, x, y, width);
  }
  if (show.tip)
    missing.forEach((tool, row) =>
      drawText(
        pen,
        tool.bright,
        t.session.unseen(tool.name, whyUnseen(tool, frame)),
        box.left + 12,
        box.top + 24 + 20 * row,
      ),
    );
}

/** The last two seconds, older parts fainter; a gap stays a gap. */
function drawPath(pen, track, tool, frame, project) {
  const start = track.times[frame] - PATH_S;
  pen.lineWidth = 2.5;
  pen.strokeStyle = tool.bright;
  for (let i = frame; i > 0 && track.times[i - 1] >= start; i--) {
    if (tool.state[i] === MISSING || tool.state[i - 1] === MISSING || isAfterHole(track, i)) continue;
    if (Number.isNaN(tool.tip_u_px[i]) || Number.isNaN(tool.tip_u_px[i - 1])) continue;
    pen.globalAlpha = 0.1 + (0.8 * (track.times[i] - start)) / PATH_S;
    pen.beginPath();
    pen.moveTo(...project(tool.tip_u_px[i - 1], tool.tip_v_px[i - 1]));
    pen.lineTo(...project(tool.tip_u_px[i], tool.tip_v_px[i]));
    pen.stroke();
  }
  pen.globalAlpha = 1;
}

function drawBorders(pen, tool, frame, project) {
  for (const border of [tool.borderA[frame], tool.borderB[frame]]) {
    if (!border) continue;
    const [u1, v1, u2, v2] = border;
    pen.beginPath();
    pen.moveTo(...project(u1, v1));
    pen.lineTo(...project(u2, v2));
    strokeTwice(pen, tool.bright, 1.5);
  }
}

/** The band: the area between both borders, from its distal to its proximal end. */
function drawMask(pen, tool, frame, project) {
  const [a, b] = [tool.borderA[frame], tool.borderB[frame]];
  if (!a || !b) return;
  pen.beginPath();
  pen.moveTo(...project(a[0], a[1]));
  pen.lineTo(...project(a[2], a[3]));
  pen.lineTo(...project(b[2], b[3]));
  pen.lineTo(...project(b[0], b[1]));
  pen.closePath();
  pen.globalAlpha = 0.3;
  pen.fillStyle = tool.bright;
  pen.fill();
  pen.globalAlpha = 1;
}

/** The midline between the borders, extended to the tip. */
function drawMidline(pen, tool, frame, project) {
  const [a, b] = [tool.borderA[frame], tool.borderB[frame]];
  if (!a || !b) return;
  const middle = [0, 1, 2, 3].map(at => (a[at] + b[at]) / 2);
  pen.beginPath();
  pen.moveTo(...project(middle[2], middle[3]));
  pen.lineTo(...project(middle[0], middle[1]));
  if (Number.isFinite(tool.tip_u_px[frame])) pen.lineTo(...project(tool.tip_u_px[frame], tool.tip_v_px[frame]));
  pen.setLineDash([6, 4]);
  strokeTwice(pen, tool.bright, 1.5);
  pen.setLineDash([]);
}

/** Full ring: observed on this frame. Broken ring: bridged by the motion model. */
function drawTip(pen, tool, predicted, x, y) {
  pen.setLineDash(predicted ? [4, 4] : []);
  outline(pen, tool.shape, x, y, 9);
  strokeTwice(pen, tool.bright, 2.5);
  pen.setLineDash([]);
  if (predicted) return;
  pen.beginPath();
  pen.arc(x, y, 2, 0, 2 * Math.PI);
  pen.fillStyle = tool.bright;
  pen.fill();
}

/** The shape of a tool: circle, diamond, square or triangle. */
export function outline(pen, shape, x, y, r) {
  pen.beginPath();
  if (shape === 'circle') return void pen.arc(x, y, r, 0, 2 * Math.PI);
  const corners = { diamond: 4, square: 4, triangle: 3 }[shape];
  const turn = shape === 'square' ? Math.PI / 4 : 0;
  for (let i = 0; i < corners; i++) {
    const angle = turn - Math.PI / 2 + (i * 2 * Math.PI) / corners;
    pen.lineTo(x + 1.2 * r * Math.cos(angle), y + 1.2 * r * Math.sin(angle));
  }
  pen.closePath();
}

function drawDepth(pen, tool, frame, x, y, width) {
  const z = tool.z_mm[frame];
  if (!Number.isFinite(z)) return;
  const text = `z ${Math.round(z)} mm`;
  pen.font = FONT;
  const labelWidth = pen.measureText(text).width + 18;
  const left = x + labelWidth > width ? x - labelWidth : x + 14;
  drawText(pen, tool.bright, text, left, y - 10);
}

/** Bright text with a dark outline. */
function drawText(pen, bright, text, x, y) {
  pen.font = FONT;
  pen.lineWidth = 3.5;
  pen.strokeStyle = HALO;
  pen.strokeText(text, x, y);
  pen.fillStyle = bright;
  pen.fillText(text, x, y);
}

/** The tracker's reason why a tool is missing on a frame, in words; empty if it gave none. */
export function whyUnseen(tool, frame) {
  const reason = tool.state[frame] === MISSING ? tool.reason[frame] : null;
  return reason ? (t.session.reasons[reason] ?? reason) : '';
}

/** A dark line below a bright one is visible on any picture. */
function strokeTwice(pen, bright, width) {
  pen.strokeStyle = HALO;
  pen.lineWidth = width + 2;
  pen.stroke();
  pen.strokeStyle = bright;
  pen.lineWidth = width;
  pen.stroke();
}

/** The canvas colours of text and axes. */
export const textColours = () => ({ ink: colour('--ink'), muted: colour('--muted'), line: colour('--line') });
