// The order of sending on a connection, as in the agent (src/capture/send_order/): live frames first, in their order.
// A sender that has fallen behind continues with the newest key frame and sends the skipped frames later, oldest first.

/** Frames that live sending may lag behind before it skips some: five seconds at 25 Hz. */
const MAX_LAG = 125;
/** Older frames are sent only while fewer bytes than this are unacknowledged: live frames must not wait long. */
const MAX_IN_FLIGHT = 2 << 20;
/** Live sending skips frames only while there are fewer acknowledged ranges than this; the protocol allows 4096. */
const MAX_RANGES = 512;

export class SendOrder {
  #live = 0;
  #backlog = 0;
  #sent = new Set();
  #inFlight = new Map(); // Bytes of what was sent and not acknowledged, by number.

  /** The next frame or gap of the spool to send, or null if there is none. */
  next(spool, isLive) {
    const lag = spool.end - (spool.atOrAfter(this.#live)?.number ?? spool.end);
    if (isLive && lag > MAX_LAG && spool.rangeCount < MAX_RANGES) this.#live = Math.max(this.#live, spool.newestKey);
    const live = spool.atOrAfter(this.#live);
    if (live) {
      this.#live = (live.last ?? live.number) + 1;
      return this.#markSent(live);
    }
    this.#live = spool.end;
    if (this.bytesInFlight >= MAX_IN_FLIGHT) return null;
    for (;;) {
      const item = spool.atOrAfter(this.#backlog);
      if (!item) return null;
      this.#backlog = (item.last ?? item.number) + 1;
      if (!this.#sent.has(item.number)) return this.#markSent(item);
    }
  }

  get bytesInFlight() {
    return [...this.#inFlight.values()].reduce((sum, bytes) => sum + bytes, 0);
  }

  acknowledged(spool) {
    for (const number of this.#inFlight.keys()) if (!spool.holds(number)) this.#inFlight.delete(number);
  }

  /** The server misses frames: everything that is kept is sent again. */
  restart() {
    [this.#live, this.#backlog] = [0, 0];
    this.#sent.clear();
    this.#inFlight.clear();
  }

  #markSent(item) {
    this.#sent.add(item.number);
    if (item.payload) this.#inFlight.set(item.number, item.payload.length);
    else item.isSent = true;
    return item;
  }
}
