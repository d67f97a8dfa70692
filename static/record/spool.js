// Frames that were recorded and are not yet safe on the server: kept in memory, up to a limit.
import { TICKS_PER_S } from './records.js';

/**
 * Bytes of frames that are kept: about three minutes at 6 Mbit/s. Small tablets end tabs that use a few times as much.
 */
export const MAX_BYTES = 128 * 2 ** 20;
/** The unit that is dropped when memory is full: whole groups from a key frame on, since part of a group is useless. */
const GROUP_TICKS = TICKS_PER_S;

export class Spool {
  /** The next frame's number. */
  end = 0;
  /** Bytes of the frames that are kept. */
  bytes = 0;
  /** Time of the newest frame, ticks. */
  newest = 0;
  newestKey = 0;
  /** Time that was dropped and is not known to have arrived. */
  lostTicks = 0;
  /** The number of ranges of frames that the server has. */
  rangeCount = 0;
  #maxBytes;
  #frames = new Map(); // By number, in ascending order.
  #gaps = []; // What was dropped, group by group, until the server knows of it: `{ number, last, ticks, isSent }`.

  constructor(maxBytes = MAX_BYTES) {
    this.#maxBytes = maxBytes;
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
    while (this.bytes > this.#maxBytes && this.#dropGroup());
  }

  holds(number) {
    return this.#frames.has(number);
  }

  /**
   * What to send of `number`, or else of the next one that is kept: a frame or a gap. The caller that sends a gap marks
   * it.
   */
  atOrAfter(number) {
    for (; number < this.end; number++) {
      const frame = this.#frames.get(number);
      if (frame) return frame;
      const gap = this.#gapAt(number);
      if (gap) return gap;
    }
    return null;
  }

  /** The server has these ranges, `[first, last]` each. */
  acknowledge(ranges) {
    this.rangeCount = ranges.length;
    const isCovered = (first, last) => ranges.some(range => range[0] <= first && last <= range[1]);
    for (const number of this.#frames.keys()) if (isCovered(number, number)) this.#forget(number);
    this.#gaps = this.#gaps.filter(gap => {
      if (!isCovered(gap.number, gap.last)) return true;
      // It had arrived, but the acknowledgement was lost with a connection.
      if (!gap.isSent) this.lostTicks -= gap.ticks;
      return false;
    });
  }

  /** The server misses these; those that are not kept will never come. */
  reportMissing(ranges) {
    for (const [first, last] of ranges)
      for (let number = first; number <= last; number++)
        if (!this.holds(number) && !this.#gapAt(number)) this.#addGap(number, number, 0);
  }

  #gapAt(number) {
    return this.#gaps.find(gap => gap.number <= number && number <= gap.last);
  }

  /** Drops the oldest group. The last one stays: frames to come cannot be shown without it. */
  #dropGroup() {
    const group = [];
    for (const frame of this.#frames.values()) {
      if (frame.isKey && group.length && frame.time - group[0].time >= GROUP_TICKS) {
        for (const { number } of group) this.#forget(number);
        this.#addGap(group[0].number, group.at(-1).number, frame.time - group[0].time);
        return true;
      }
      group.push(frame);
    }
    return false;
  }

  #forget(number) {
    this.bytes -= this.#frames.get(number).payload.length;
    this.#frames.delete(number);
  }

  #addGap(number, last, ticks) {
    this.lostTicks += ticks;
    this.#gaps.push({ number, last, ticks, isSent: false });
  }
}
