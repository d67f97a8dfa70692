// A session's path as pages need it: one slot per decoded frame, typed arrays, NaN where a tool was not seen.
import { colour } from '../theme.js';

export const MISSING = 0;
export const PREDICTED = 1;
export const OBSERVED = 2;
/** Over a longer pause than this no line is drawn, s. */
export const BREAK_S = 0.5;

const FIELDS = ['x_mm', 'y_mm', 'z_mm', 'tip_u_px', 'tip_v_px'];
const DRAWN = [...FIELDS, 'speed'];
const KNOWN = ['orange', 'cyan', 'red', 'green', 'blue', 'yellow', 'purple', 'pink', 'grey'];
const ALIASES = { violet: 'purple', magenta: 'pink', turquoise: 'cyan', gray: 'grey', amber: 'orange' };
/** On the video the colours must stand out from tissue, tape and tubes in both themes. */
const BRIGHT = {
  orange: '#ffa142',
  cyan: '#38e1ff',
  red: '#ff6b6b',
  green: '#7bf07f',
  blue: '#7da7ff',
  yellow: '#ffe04d',
  purple: '#cf9dff',
  pink: '#ff8fd0',
  grey: '#e6eeee',
};
/** Shapes tell tools apart for those whom colours do not. */
export const SHAPES = ['circle', 'diamond', 'square', 'triangle'];

/** Frames whose exact rows are asked for at a time. */
export const PART = 2000;

/**
 * The track of `GET trajectory?points=…`. Of a long session these are the rows that draw the same curves; between them lies
 * a straight line until `take` brings the exact ones. `frames` is the video's count, where known.
 */
export function buildTrack(trajectory, frames = 0, size = {}) {
  const { columns, tools: names } = trajectory;
  const count = Math.max(frames, 1 + largest(columns.frame));
  const tools = names.map((name, index) => emptyTool(name, index, count));
  const times = frameTimes(columns, count);
  const whole = !trajectory.thinned;
  const track = {
    times,
    tools,
    frames: count,
    width: size.width,
    height: size.height,
    duration: times[count - 1] ?? 0,
    /** Frames that tell a curve's shape, in order; null: all. */
    telling: whole ? null : tellingFrames(columns),
    /** Which parts have exact rows, and which have what was seen in the picture. */
    exact: new Array(Math.ceil(count / PART)).fill(whole),
    seen: new Array(Math.ceil(count / PART)).fill(false),
    /** Counts up with every part that comes. */
    version: 0,
  };
  fillSamples(tools, columns);
  if (!whole) fillBetween(tools, trajectory);
  track.topSpeed = quantile(tools, 0.98);
  return track;
}

/** Exact rows of one part, in place of what was drawn between. */
export function takePart(track, part, { columns }) {
  const [from, to] = [part * PART, Math.min(track.frames, (part + 1) * PART)];
  for (const tool of track.tools) {
    for (const field of DRAWN) tool[field].fill(NaN, from, to);
    tool.state.fill(MISSING, from, to);
  }
  columns.frame.forEach((frame, row) => (track.times[frame] = columns.time_s[row]));
  fillSamples(track.tools, columns);
  track.exact[part] = true;
  track.version++;
}

/** What the tracker saw of one part. */
export function takeSeen(track, part, { columns, tools: names }) {
  const toolOf = names.map(name => track.tools.find(tool => tool.name === name));
  columns.frame.forEach((frame, row) => fillSeen(toolOf[columns.tool[row]], frame, columns, row));
  track.seen[part] = true;
  track.version++;
}

/** Is what stands at this frame what was measured there, not what was drawn between? Live tracks know no other. */
export const isExact = ({ exact }, frame) => !exact || exact[Math.floor(frame / PART)];

/** The first second that any tool was seen. */
export function firstSeen({ times, tools, frames }) {
  for (let frame = 0; frame < frames; frame++) if (tools.some(tool => tool.state[frame] === OBSERVED)) return times[frame];
  return times[0] ?? 0;
}

/** Do frames miss before this one? */
export const isAfterHole = ({ times }, frame) => frame > 0 && times[frame] - times[frame - 1] > BREAK_S;

/**
 * The frames of curves over time, with a null wherever frames miss, so that no line is drawn across: all between two
 * seconds, or, without them, those that tell the curves' shape.
 */
export function curveFrames(track, [from, to] = [-Infinity, Infinity]) {
  const all = Number.isFinite(from) || !track.telling;
  const [first, last] = all ? framesWithin(track, from, to) : [0, track.telling.length - 1];
  const frames = [];
  for (let at = first; at <= last; at++) {
    const frame = all ? at : track.telling[at];
    const before = frames[frames.length - 1];
    if (isAfterHole(track, frame)) frames.push(null);
    // Where a tool was absent between two telling frames, the frame after the first says so.
    else if (before !== undefined && frame - before > 1 && track.tools.some(tool => tool.state[before + 1] === MISSING))
      frames.push(before + 1);
    frames.push(frame);
  }
  return frames;
}

/** The first and the last frame between two seconds, and one more on either side. */
export function framesWithin({ times }, from, to) {
  const first = Number.isFinite(from) ? frameAt(times, from) : 0;
  const last = Number.isFinite(to) ? frameAt(times, to) : times.length - 1;
  return [Math.max(0, first - 1), Math.min(times.length - 1, last + 1)];
}

/** Every frame that a row of any tool is on, once. */
function tellingFrames(columns) {
  const frames = [];
  for (const frame of columns.frame) if (frame !== frames[frames.length - 1]) frames.push(frame); // Rows come in order.
  return frames;
}

/** A straight line between rows of which those between were left out; nothing where the tool was absent. */
function fillBetween(tools, { columns, after_gap: afterGap }) {
  const before = new Int32Array(tools.length).fill(-1);
  const valuesOf = tools.map(tool => DRAWN.map(field => tool[field]));
  for (let row = 0; row < columns.frame.length; row++) {
    const [index, frame] = [columns.tool[row], columns.frame[row]];
    const last = before[index];
    before[index] = frame;
    if (last < 0 || afterGap[row]) continue;
    for (const values of valuesOf[index]) drawBetween(values, last, frame);
    tools[index].state.fill(tools[index].state[last], last + 1, frame);
  }
}

function drawBetween(values, last, frame) {
  const from = values[last];
  const step = (values[frame] - from) / (frame - last);
  for (let at = last + 1; at < frame; at++) values[at] = from + step * (at - last);
}

/** A tool with its colours and its sign, and room for so many rows. */
export function emptyTool(name, index, count) {
  const lower = name.toLowerCase();
  const family = KNOWN.includes(lower) ? lower : (ALIASES[lower] ?? KNOWN[(index * 2 + 2) % KNOWN.length]);
  const tool = {
    name,
    index,
    shape: SHAPES[index % SHAPES.length],
    bright: BRIGHT[family],
    ink: () => colour(`--tool-${family}`),
  };
  for (const field of DRAWN) tool[field] = new Float64Array(count).fill(NaN);
  tool.state = new Uint8Array(count);
  tool.borderA = new Array(count).fill(null);
  tool.borderB = new Array(count).fill(null);
  tool.reason = new Array(count).fill(null);
  return tool;
}

/** Column by column: a session of twenty minutes has some ten thousand rows, and is drawn before anybody notices. */
function fillSamples(tools, columns) {
  const { frame: frames, tool: indices } = columns;
  const count = frames.length;
  for (const field of FIELDS) {
    const [column, valuesOf] = [columns[field] ?? [], tools.map(tool => tool[field])];
    for (let row = 0; row < count; row++) valuesOf[indices[row]][frames[row]] = column[row] ?? NaN;
  }
  const [vx, vy, vz] = ['vx_mm_s', 'vy_mm_s', 'vz_mm_s'].map(field => columns[field] ?? []);
  for (let row = 0; row < count; row++) {
    const tool = tools[indices[row]];
    tool.speed[frames[row]] = speedOf(vx[row], vy[row], vz[row]);
    tool.state[frames[row]] = columns.state[row] === 'observed' ? OBSERVED : PREDICTED;
  }
}

/** A velocity that is not told (null) is none of zero. */
const speedOf = (x, y, z) => Math.hypot(x ?? NaN, y ?? NaN, z ?? NaN);

function fillSeen(tool, frame, seen, row) {
  if (!tool) return;
  tool.reason[frame] = seen.reason?.[row] ?? null;
  tool.borderA[frame] = seen.border_a?.[row] ?? null;
  tool.borderB[frame] = seen.border_b?.[row] ?? null;
}

/** Presentation times: as tracked where a tool was there, on a line between such frames elsewhere. */
function frameTimes(columns, count) {
  const times = new Float64Array(count).fill(NaN);
  columns.frame.forEach((frame, row) => (times[frame] = columns.time_s[row]));
  const first = times.findIndex(time => !Number.isNaN(time));
  const last = times.findLastIndex(time => !Number.isNaN(time));
  if (first === last) return times.map((time, frame) => (Number.isNaN(time) ? frame / 25 : time));
  const step = (times[last] - times[first]) / (last - first);
  for (let frame = 0; frame < first; frame++) times[frame] = times[first] - (first - frame) * step;
  for (let frame = last + 1; frame < count; frame++) times[frame] = times[last] + (frame - last) * step;
  for (let known = first, frame = first + 1; frame <= last; frame++) {
    if (Number.isNaN(times[frame])) continue;
    drawBetween(times, known, frame);
    known = frame;
  }
  return times;
}

/** The frame on screen at a time: the last one that began, with room for rounding in the container. */
export function frameAt(times, time) {
  const step = times.length > 1 ? (times[times.length - 1] - times[0]) / (times.length - 1) : 0;
  const wanted = time + step * 0.25;
  let [low, high] = [0, times.length - 1];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= wanted) low = middle;
    else high = middle - 1;
  }
  return low;
}

const largest = column => column.reduce((most, value) => Math.max(most, value), -1);

/** So many speeds tell how fast the fast ones are; of a long session every so many-th is taken. */
const MOST_SPEEDS = 10_000;

/** A high quantile of all speeds, so that one wild sample does not grey out the whole colour scale; null where none is told, as of an
 *  imported path that came without velocities. */
function quantile(tools, share) {
  const room = tools.reduce((sum, tool) => sum + tool.speed.length, 0);
  const stride = Math.ceil(room / MOST_SPEEDS) || 1;
  const speeds = new Float64Array(MOST_SPEEDS + tools.length);
  let count = 0;
  for (const { speed } of tools)
    for (let frame = 0; frame < speed.length; frame += stride) if (Number.isFinite(speed[frame])) speeds[count++] = speed[frame];
  const sorted = speeds.subarray(0, count).sort();
  return sorted[Math.floor((count - 1) * share)] ?? null;
}
