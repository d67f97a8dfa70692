// A session's path as pages need it: one slot per decoded frame, typed arrays, NaN where a tool was not seen.
import { colour } from '../../theme.js';

export const MISSING = 0;
export const PREDICTED = 1;
export const OBSERVED = 2;
/** No line is drawn across a longer pause than this, s. */
export const BREAK_S = 0.5;

const FIELDS = ['x_mm', 'y_mm', 'z_mm', 'tip_u_px', 'tip_v_px'];
const DRAWN_FIELDS = [...FIELDS, 'speed'];
const COLOURS = ['orange', 'cyan', 'red', 'green', 'blue', 'yellow', 'purple', 'pink', 'grey'];
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
/** Shapes distinguish tools for people who cannot distinguish the colours. */
export const SHAPES = ['circle', 'diamond', 'square', 'triangle'];

/** Frames whose exact rows are requested at a time. */
export const CHUNK_FRAMES = 2000;

/**
 * The track of `GET trajectory?points=…`. For a long session, the answer holds only the rows that draw the same curves;
 * between them the track is a straight line until `storeChunk` adds the exact rows. `frames` is the video's count, if
 * known.
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
    /** Frames that determine a curve's shape, in order; null: all. */
    shapeFrames: whole ? null : framesWithRows(columns),
    /** Which chunks have exact rows, and which have diagnostics. */
    exact: new Array(Math.ceil(count / CHUNK_FRAMES)).fill(whole),
    diagnosed: new Array(Math.ceil(count / CHUNK_FRAMES)).fill(false),
    /** Increases with every chunk that arrives. */
    version: 0,
  };
  fillSamples(tools, columns);
  if (!whole) fillInterpolated(tools, trajectory);
  track.topSpeed = speedQuantile(tools, 0.98);
  return track;
}

/** Stores the exact rows of one chunk, in place of interpolated ones. */
export function storeChunk(track, chunk, { columns }) {
  const [from, to] = [chunk * CHUNK_FRAMES, Math.min(track.frames, (chunk + 1) * CHUNK_FRAMES)];
  for (const tool of track.tools) {
    for (const field of DRAWN_FIELDS) tool[field].fill(NaN, from, to);
    tool.state.fill(MISSING, from, to);
  }
  columns.frame.forEach((frame, row) => (track.times[frame] = columns.time_s[row]));
  fillSamples(track.tools, columns);
  track.exact[chunk] = true;
  track.version++;
}

/** Stores what the tracker saw on the frames of one chunk. */
export function storeDiagnostics(track, chunk, { columns, tools: names }) {
  const toolOf = names.map(name => track.tools.find(tool => tool.name === name));
  columns.frame.forEach((frame, row) => fillDiagnostics(toolOf[columns.tool[row]], frame, columns, row));
  track.diagnosed[chunk] = true;
  track.version++;
}

/** Whether a frame's values were measured, not interpolated. Live tracks are always measured. */
export const isExact = ({ exact }, frame) => !exact || exact[Math.floor(frame / CHUNK_FRAMES)];

/** The first time at which any tool was seen, s. */
export function firstSeen({ times, tools, frames }) {
  for (let frame = 0; frame < frames; frame++) if (tools.some(tool => tool.state[frame] === OBSERVED)) return times[frame];
  return times[0] ?? 0;
}

/** Whether frames are missing before this one. */
export const isAfterHole = ({ times }, frame) => frame > 0 && times[frame] - times[frame - 1] > BREAK_S;

/**
 * The frames of curves over time, with a null wherever frames are missing, so that no line is drawn across: all between
 * two times, or, without times, those that determine the curves' shape.
 */
export function curveFrames(track, [from, to] = [-Infinity, Infinity]) {
  const all = Number.isFinite(from) || !track.shapeFrames;
  const [first, last] = all ? framesWithin(track, from, to) : [0, track.shapeFrames.length - 1];
  const frames = [];
  for (let at = first; at <= last; at++) {
    const frame = all ? at : track.shapeFrames[at];
    const before = frames[frames.length - 1];
    if (isAfterHole(track, frame)) frames.push(null);
    // Where a tool was missing between two of these frames, the frame after the first shows it.
    else if (before !== undefined && frame - before > 1 && track.tools.some(tool => tool.state[before + 1] === MISSING))
      frames.push(before + 1);
    frames.push(frame);
  }
  return frames;
}

/** The first and the last frame between two times, and one more on either side. */
export function framesWithin({ times }, from, to) {
  const first = Number.isFinite(from) ? frameAt(times, from) : 0;
  const last = Number.isFinite(to) ? frameAt(times, to) : times.length - 1;
  return [Math.max(0, first - 1), Math.min(times.length - 1, last + 1)];
}

/** Every frame with a row of any tool, once. */
function framesWithRows(columns) {
  const frames = [];
  for (const frame of columns.frame) if (frame !== frames[frames.length - 1]) frames.push(frame); // Rows are in order.
  return frames;
}

/** Draws a straight line between rows where rows were left out; nothing where the tool was missing. */
function fillInterpolated(tools, { columns, after_gap: afterGap }) {
  const before = new Int32Array(tools.length).fill(-1);
  const valuesOf = tools.map(tool => DRAWN_FIELDS.map(field => tool[field]));
  for (let row = 0; row < columns.frame.length; row++) {
    const [index, frame] = [columns.tool[row], columns.frame[row]];
    const last = before[index];
    before[index] = frame;
    if (last < 0 || afterGap[row]) continue;
    for (const values of valuesOf[index]) interpolate(values, last, frame);
    tools[index].state.fill(tools[index].state[last], last + 1, frame);
  }
}

function interpolate(values, last, frame) {
  const from = values[last];
  const step = (values[frame] - from) / (frame - last);
  for (let at = last + 1; at < frame; at++) values[at] = from + step * (at - last);
}

/** A tool with its colours and its shape, and arrays for that many rows. */
export function emptyTool(name, index, count) {
  const lower = name.toLowerCase();
  const family = COLOURS.includes(lower) ? lower : (ALIASES[lower] ?? COLOURS[(index * 2 + 2) % COLOURS.length]);
  const tool = {
    name,
    index,
    shape: SHAPES[index % SHAPES.length],
    bright: BRIGHT[family],
    ink: () => colour(`--tool-${family}`),
  };
  for (const field of DRAWN_FIELDS) tool[field] = new Float64Array(count).fill(NaN);
  tool.state = new Uint8Array(count);
  tool.borderA = new Array(count).fill(null);
  tool.borderB = new Array(count).fill(null);
  tool.reason = new Array(count).fill(null);
  return tool;
}

/**
 * Column by column: a session of twenty minutes has about ten thousand rows and must be drawn without a noticeable
 * delay.
 */
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

/** A velocity that is not known (null) is not zero. */
const speedOf = (x, y, z) => Math.hypot(x ?? NaN, y ?? NaN, z ?? NaN);

function fillDiagnostics(tool, frame, seen, row) {
  if (!tool) return;
  tool.reason[frame] = seen.reason?.[row] ?? null;
  tool.borderA[frame] = seen.border_a?.[row] ?? null;
  tool.borderB[frame] = seen.border_b?.[row] ?? null;
}

/** Presentation times: as tracked where any tool was seen, interpolated elsewhere. */
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
    interpolate(times, known, frame);
    known = frame;
  }
  return times;
}

/** The frame on screen at a time: the last one that began, with a tolerance for rounding in the container. */
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

const largest = column => column.reduce((max, value) => Math.max(max, value), -1);

/** Speeds that are enough for the quantile; of a long session every n-th is taken. */
const MAX_SPEEDS = 10_000;

/**
 * A high quantile of all speeds, so that one wild sample does not grey out the whole colour scale; null if there are
 * none, as for an imported path without velocities.
 */
function speedQuantile(tools, share) {
  const total = tools.reduce((sum, tool) => sum + tool.speed.length, 0);
  const stride = Math.ceil(total / MAX_SPEEDS) || 1;
  const speeds = new Float64Array(MAX_SPEEDS + tools.length);
  let count = 0;
  for (const { speed } of tools)
    for (let frame = 0; frame < speed.length; frame += stride) if (Number.isFinite(speed[frame])) speeds[count++] = speed[frame];
  const sorted = speeds.subarray(0, count).sort();
  return sorted[Math.floor((count - 1) * share)] ?? null;
}
