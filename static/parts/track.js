// A session's path as pages need it: one slot per decoded frame, typed arrays, NaN where a tool was not seen.
import { colour } from '../theme.js';

export const MISSING = 0;
export const PREDICTED = 1;
export const OBSERVED = 2;
/** Over a longer pause than this no line is drawn, s. */
export const BREAK_S = 0.5;

const FIELDS = ['x_mm', 'y_mm', 'z_mm', 'tip_u_px', 'tip_v_px'];
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

/** Joins the trajectory's and the diagnostics' columns; `frames` is the video's count, where known. */
export function buildTrack(trajectory, diagnostics, frames = 0) {
  const { columns, tools: names } = trajectory;
  const seen = diagnostics?.columns ?? { frame: [], tool: [] };
  const count = Math.max(frames, 1 + largest(columns.frame), 1 + largest(seen.frame));
  const tools = names.map((name, index) => emptyTool(name, index, count));
  columns.frame.forEach((frame, row) => fillSample(tools[columns.tool[row]], frame, columns, row));
  const toolOf = (diagnostics?.tools ?? names).map(name => tools[names.indexOf(name)]);
  seen.frame.forEach((frame, row) => fillSeen(toolOf[seen.tool[row]], frame, seen, row));
  const times = frameTimes(columns, count);
  return {
    times,
    tools,
    frames: count,
    width: diagnostics?.width,
    height: diagnostics?.height,
    topSpeed: quantile(tools, 0.98),
    duration: times[count - 1] ?? 0,
  };
}

/** Do frames miss before this one? */
export const isAfterHole = ({ times }, frame) => frame > 0 && times[frame] - times[frame - 1] > BREAK_S;

/** The frames of curves over time, with a null wherever frames miss, so that no line is drawn across. */
export function curveFrames(track) {
  const frames = [];
  for (let frame = 0; frame < track.times.length; frame++) {
    if (isAfterHole(track, frame)) frames.push(null);
    frames.push(frame);
  }
  return frames;
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
  for (const field of [...FIELDS, 'speed']) tool[field] = new Float64Array(count).fill(NaN);
  tool.state = new Uint8Array(count);
  tool.borderA = new Array(count).fill(null);
  tool.borderB = new Array(count).fill(null);
  tool.reason = new Array(count).fill(null);
  return tool;
}

function fillSample(tool, frame, columns, row) {
  for (const field of FIELDS) tool[field][frame] = columns[field]?.[row] ?? NaN;
  const velocity = ['vx_mm_s', 'vy_mm_s', 'vz_mm_s'].map(field => columns[field]?.[row] ?? NaN);
  tool.speed[frame] = Math.hypot(...velocity);
  tool.state[frame] = columns.state[row] === 'observed' ? OBSERVED : PREDICTED;
}

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
  const known = [...times.keys()].filter(frame => !Number.isNaN(times[frame]));
  if (known.length < 2) return times.map((time, frame) => (Number.isNaN(time) ? frame / 25 : time));
  const [first, last] = [known[0], known[known.length - 1]];
  const step = (times[last] - times[first]) / (last - first);
  for (let frame = 0; frame < first; frame++) times[frame] = times[first] - (first - frame) * step;
  for (let frame = last + 1; frame < count; frame++) times[frame] = times[last] + (frame - last) * step;
  for (let i = 1; i < known.length; i++) {
    const [from, to] = [known[i - 1], known[i]];
    for (let frame = from + 1; frame < to; frame++)
      times[frame] = times[from] + ((times[to] - times[from]) * (frame - from)) / (to - from);
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

/** A high quantile of all speeds, so that one wild sample does not grey out the whole colour scale. */
function quantile(tools, share) {
  const speeds = tools.flatMap(tool => [...tool.speed].filter(Number.isFinite)).sort((a, b) => a - b);
  return speeds[Math.floor((speeds.length - 1) * share)] ?? 0;
}
