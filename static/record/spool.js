// What was recorded and is not yet safe on the server: frames in memory, up to a limit.
import { TICKS_PER_S } from './records.js';

/** Bytes of frames that are kept: some three minutes at 6 Mbit/s. Tabs of small tablets are ended at a few times as much. */
export const MOST_BYTES = 128 * 2 ** 20;
/** What goes at a time when memory is full: whole groups from a key frame on, which are of no use in part. */
const GROUP_TICKS = TICKS_PER_S;

export class Spool {
  /** The next frame's number. */
  end = 0;
  /** Of the frames that are kept. */
  bytes = 0;
  /** Time of the newest frame, ticks. */
  newest = 0;
  newestKey = 0;
  /** What went and is not known to have arrived. */
  lostTicks = 0;
  /** Ranges in which what the server has lies. */
  pieces = 0;
  #most;
  #frames = new Map(); // By number, in the order of numbers.
  #gaps = []; // What went, group by group, until the server knows of it: `{ number, last, ticks, isTold }`.

  constructor(most = MOST_BYTES) {
    this.#most = most;
  }

  get count() {
    return this.#frames.size;
  }

  /** Seconds from the oldest frame that is kept to the newest. */
  get seconds() {
    const [oldest] = this.#frames.values();
    return oldest ? (this.newest - oldest.time) / TICKS_PER_S : 0;
  }

  get isEmpty() {
    return this.#frames.size === 0 && this.#gaps.length === 0;
  }

  push({ time, isKey, payload }) {
    const frame = { number: this.end++, time, isKey, payload };
    if (isKey) this.newestKey = frame.number;
    this.newest = Math.max(this.newest, time);
    this.#frames.set(frame.number, frame);
    this.bytes += payload.length;
    while (this.bytes > this.#most && this.#dropGroup());
  }

  holds(number) {
    return this.#frames.has(number);
  }

  /** What is to be sent of `number` or else of the next one that is kept: a frame or a gap. Whoever tells a gap marks it. */
  atOrAfter(number) {
    for (; number < this.end; number++) {
      const frame = this.#frames.get(number);
      if (frame) return frame;
      const gap = this.#gapAt(number);
      if (gap) return gap;
    }
    return null;
  }

  /** The server has these, `[first, last]` each. */
  acknowledge(ranges) {
    this.pieces = ranges.length;
    const has = (first, last) => ranges.some(range => range[0] <= first && last <= range[1]);
    for (const number of this.#frames.keys()) if (has(number, number)) this.#forget(number);
    this.#gaps = this.#gaps.filter(gap => {
      if (!has(gap.number, gap.last)) return true;
      if (!gap.isTold) this.lostTicks -= gap.ticks; // It had arrived, and a cut kept that from being heard.
      return false;
    });
  }

  /** The server misses these; whatever of them is not kept will never come. */
  miss(ranges) {
    for (const [first, last] of ranges)
      for (let number = first; number <= last; number++)
        if (!this.holds(number) && !this.#gapAt(number)) this.#lose(number, number, 0);
  }

  #gapAt(number) {
    return this.#gaps.find(gap => gap.number <= number && number <= gap.last);
  }

  /** The oldest group goes. The last one stays: more is coming that cannot be shown without it. */
  #dropGroup() {
    const going = [];
    for (const frame of this.#frames.values()) {
      if (frame.isKey && going.length && frame.time - going[0].time >= GROUP_TICKS) {
        for (const { number } of going) this.#forget(number);
        this.#lose(going[0].number, going.at(-1).number, frame.time - going[0].time);
        return true;
      }
      going.push(frame);
    }
    return false;
  }

  #forget(number) {
    this.bytes -= this.#frames.get(number).payload.length;
    this.#frames.delete(number);
  }

  #lose(number, last, ticks) {
    this.lostTicks += ticks;
    this.#gaps.push({ number, last, ticks, isTold: false });
  }
}
