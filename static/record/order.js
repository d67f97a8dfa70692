// What goes out next on a connection, as the agent does it (src/capture/order.rs): live frames first and in their order;
// who has fallen behind goes on with the newest key frame and fills in what was left out, oldest first.

/** Frames that live may fall behind before it leaves some out: five seconds at 25 Hz. */
const MOST_LAG = 125;
/** Bytes that may be under way, unacknowledged, for more of the rest to be sent: live frames must not wait long for them. */
const MOST_UNDER_WAY = 2 << 20;
/** Pieces that the acknowledged numbers may lie in for live to leave some out once more; the protocol allows 4096. */
const MOST_PIECES = 512;

export class Order {
  #live = 0;
  #rest = 0;
  #sent = new Set();
  #underWay = new Map(); // Bytes of what was sent and not acknowledged, by number.

  /** A frame or gap of the spool, or null while nothing is to be sent. */
  next(spool, isLive) {
    const lag = spool.end - (spool.atOrAfter(this.#live)?.number ?? spool.end);
    if (isLive && lag > MOST_LAG && spool.pieces < MOST_PIECES) this.#live = Math.max(this.#live, spool.newestKey);
    const live = spool.atOrAfter(this.#live);
    if (live) {
      this.#live = (live.last ?? live.number) + 1;
      return this.#sending(live);
    }
    this.#live = spool.end;
    if (this.bytesUnderWay >= MOST_UNDER_WAY) return null;
    for (;;) {
      const item = spool.atOrAfter(this.#rest);
      if (!item) return null;
      this.#rest = (item.last ?? item.number) + 1;
      if (!this.#sent.has(item.number)) return this.#sending(item);
    }
  }

  get bytesUnderWay() {
    return [...this.#underWay.values()].reduce((sum, bytes) => sum + bytes, 0);
  }

  acknowledged(spool) {
    for (const number of this.#underWay.keys()) if (!spool.holds(number)) this.#underWay.delete(number);
  }

  /** The server misses something: everything that is kept is sent once more. */
  again() {
    [this.#live, this.#rest] = [0, 0];
    this.#sent.clear();
    this.#underWay.clear();
  }

  #sending(item) {
    this.#sent.add(item.number);
    if (item.payload) this.#underWay.set(item.number, item.payload.length);
    else item.isTold = true;
    return item;
  }
}
