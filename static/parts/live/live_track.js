// The last seconds of a session that arrives, in the shape that overlay and space are drawn from
// (`playback/track.js`). Arrays do not grow: when they are full, their newer half moves to the front.
import { boundsAround } from '../playback/space_painter.js';
import { BREAK_S, emptyTool, MISSING, OBSERVED, PREDICTED } from '../playback/track.js';

const WINDOW_S = 10;
const CAPACITY = 2400; // Rows: 10 s twice, at 120 frames a second.
const MARGIN_MM = 30; // Space around the first tip.
const STATES = { seen: OBSERVED, bridged: PREDICTED };
const FIELDS = ['x_mm', 'y_mm', 'z_mm', 'speed', 'tip_u_px', 'tip_v_px', 'sigma_xy_mm', 'sigma_z_mm'];
/**
 * Values that change from frame to frame cannot be read: a state, a reason and what is announced last at least this
 * long.
 */
const HOLD_S = { state: 0.15, reason: 1, spoken: 1 };

export class LiveTrack {
  /** The window is rows `first` to `frames − 1`. */
  first = 0;
  frames = 0;
  times = new Float64Array(CAPACITY);
  numbers = new Float64Array(CAPACITY);
  /** The distance between two tips, with its standard deviation, mm. */
  distance = null;
  bounds = boundsAround([
    [-50, 50],
    [-50, 50],
    [100, 200],
  ]);
  /** @type {[number, number][] | null} */
  #extent = null;
  /** The picture's size. */
  width;
  height;
  tools;

  constructor({ width, height, tools }) {
    [this.width, this.height, this.tools] = [width, height, tools.map(newTool)];
  }

  /** Whether picture size and tools are the same: a restored connection then continues this path. */
  matches({ width, height, tools }) {
    const names = this.tools.map(tool => tool.name);
    return this.width === width && this.height === height && tools?.join() === names.join();
  }

  get last() {
    return this.frames - 1;
  }

  get time() {
    return this.frames ? this.times[this.last] : NaN;
  }

  /** The row of a frame; the last row if the frame is not in the window. */
  rowOf(number) {
    let row = this.last;
    while (row > this.first && this.numbers[row] > number) row--;
    return this.numbers[row] === number ? row : this.last;
  }

  push({ frame, time_s, tools, distance_mm }) {
    if (this.frames && time_s - this.time > BREAK_S) this.#add(frame - 1, this.time, null);
    this.#add(frame, time_s, tools);
    this.distance = distance_mm;
    tools.forEach((seen, index) => this.tools[index]?.shown.update(seen, time_s));
  }

  #add(number, time, seen) {
    if (this.frames === CAPACITY) this.#compact();
    const row = this.frames++;
    this.times[row] = time;
    this.numbers[row] = number;
    for (const tool of this.tools) {
      fill(tool, row, seen?.[tool.index]);
      if (tool.state[row] === OBSERVED) this.#extend(['x_mm', 'y_mm', 'z_mm'].map(field => tool[field][row]));
    }
    while (this.times[this.first] < time - WINDOW_S) this.first++;
  }

  #compact() {
    const half = CAPACITY / 2;
    const arrays = tool => [tool.state, tool.reason, tool.borderA, tool.borderB, ...FIELDS.map(field => tool[field])];
    for (const array of [this.times, this.numbers, ...this.tools.flatMap(arrays)]) array.copyWithin(0, half);
    this.frames = half;
    this.first = Math.max(0, this.first - half);
  }

  /** The space that is shown grows with the paths and never shrinks: a view that moves by itself cannot be read. */
  #extend(tip) {
    if (this.#extent?.every(([low, high], axis) => low <= tip[axis] && tip[axis] <= high)) return;
    this.#extent = tip.map((at, axis) => {
      const [low, high] = this.#extent?.[axis] ?? [at - MARGIN_MM, at + MARGIN_MM];
      return [Math.min(low, at), Math.max(high, at)];
    });
    this.bounds = boundsAround(this.#extent);
  }
}

function newTool(name, index) {
  const tool = emptyTool(name, index, CAPACITY);
  for (const field of ['sigma_xy_mm', 'sigma_z_mm']) tool[field] = new Float64Array(CAPACITY).fill(NaN);
  return Object.assign(tool, { shown: new ShownState() });
}

function fill(tool, row, seen) {
  tool.state[row] = STATES[seen?.state] ?? MISSING;
  tool.reason[row] = seen?.state === 'left_view' ? 'left_view' : (seen?.reason ?? null);
  [tool.borderA[row], tool.borderB[row]] = seen?.borders_px ?? [null, null];
  const px = seen?.state === 'seen' ? seen.tip_px : null; // A tip that was found and rejected is not shown.
  const { tip_mm: tip = null, speed_mm_s: speed = null, sigma_mm: sigma = null } = seen ?? {};
  const values = [tip ?? [NaN, NaN, NaN], speed ?? NaN, px ?? [NaN, NaN], sigma ?? [NaN, NaN]];
  values.flat().forEach((value, at) => (tool[FIELDS[at]][row] = value));
}

/** A tool's state, held long enough to be read: `state`, `reason`, and `spoken` for screen readers. */
class ShownState {
  state = null;
  reason = null;
  spoken = null;
  #since = { state: 0, reason: 0, spoken: 0 };
  #next = { state: null, spoken: null };

  update({ state, reason }, time) {
    const changed = this.#holdSteady('state', state, time);
    this.#holdSteady('spoken', state, time);
    if (state !== this.state || (!changed && time - this.#since.reason < HOLD_S.reason)) return;
    this.reason = reason;
    this.#since.reason = time;
  }

  #holdSteady(what, state, time) {
    if (this.#next[what] !== state) [this.#next[what], this.#since[what]] = [state, time];
    if (this[what] === state) return false;
    if (this[what] !== null && time - this.#since[what] < HOLD_S[what]) return false;
    this[what] = state;
    return true;
  }
}
