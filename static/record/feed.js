// A sender's end of a feed, protocol 1 of docs/feed.md: connections one after the other until the recording is whole.
import { Order } from './order.js';
import { frameRecord, gapRecord } from './records.js';

const RETRY_MS = { first: 500, most: 5_000 };
/** Close codes after which it is worth coming again by oneself: the last column of the table in docs/feed.md; and 4401,
 *  since the person signs in again on this very page. */
const COME_AGAIN = [1012, 4401, 4408, 4409, 4500];
/** Close codes of the protocol; any other is a cut, of which a browser tells no more. */
const isTold = code => code === 1012 || (code >= 4400 && code < 4600);
/** Bytes that may wait in the browser: more would only make the picture that is live older. */
const MOST_BUFFERED = 1 << 20;
/** When nothing is acknowledged for so long, the line is dead and the browser has not noticed. */
const SILENT_MS = 10_000;
/** Putting a long recording together takes its time. */
const SILENT_AT_END_MS = 120_000;
/** A sender says something at least every 20 s. A browser cannot ping: what came before is said again, and ignored. */
const SAY_EVERY_MS = 8_000;
const TICK_MS = 100;

export class Feed {
  /** `'connecting'`, `'open'`, `'lost'`, and at last `'ended'` (all is on the server), `'shortened'` (the server ended
   *  it without what is still kept here) or `'refused'`. */
  line = 'connecting';
  /** The session that the recording is, once it is known. */
  session = null;
  /** Why the line is lost or refused: a close code. */
  code = null;

  #address;
  #hello;
  #spool;
  #onChange;
  #socket = null;
  #epoch = null;
  #order = null;
  #isLive = true;
  #hasSaidEnd = false;
  #heardAt = 0;
  #saidAt = 0;
  #last = null; // The newest frame that was sent, to be said again.
  #retryMs = RETRY_MS.first;
  #retryTimer;
  #ticker;

  constructor({ address, hello, spool, onChange }) {
    [this.#address, this.#hello, this.#spool, this.#onChange] = [address, hello, spool, onChange];
    this.#ticker = setInterval(() => this.#tick(), TICK_MS);
    this.#connect();
  }

  /** Sends what there is to send, as far as the line takes it. */
  pump() {
    if (this.#epoch === null || this.#hasSaidEnd) return;
    while (this.#socket.bufferedAmount < MOST_BUFFERED) {
      const item = this.#order.next(this.#spool, this.#isLive);
      if (!item) break;
      this.#say(item.payload ? frameRecord(this.#epoch, item) : gapRecord(this.#epoch, [item.number, item.last]));
      if (item.payload) this.#last = item;
    }
    // Said once all is acknowledged: what is still kept here until then can be told to the person who waits.
    if (this.#isLive || !this.#spool.isEmpty) return;
    this.#hasSaidEnd = true;
    this.#say(JSON.stringify({ type: 'end', frames: this.#spool.end }));
  }

  /** No more frames come. */
  finish() {
    this.#isLive = false;
    this.pump();
  }

  /** Tries at once, and again after a refusal: for a person who has mended what was wrong. */
  retry() {
    if (['open', 'ended', 'shortened'].includes(this.line)) return;
    this.#hangUp();
    this.#connect();
  }

  close() {
    clearInterval(this.#ticker);
    this.#hangUp();
  }

  #connect() {
    clearTimeout(this.#retryTimer);
    this.#heardAt = performance.now();
    const socket = (this.#socket = new WebSocket(this.#address));
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => this.#say(JSON.stringify(this.#hello));
    socket.onmessage = ({ data }) => this.#hear(JSON.parse(data));
    socket.onclose = ({ code }) => this.#broke(code);
    if (this.line === 'refused') this.#become('connecting');
  }

  #hangUp() {
    clearTimeout(this.#retryTimer);
    this.#epoch = null;
    this.#hasSaidEnd = false;
    if (this.#socket) Object.assign(this.#socket, { onopen: null, onmessage: null, onclose: null }).close();
    this.#socket = null;
  }

  #hear(word) {
    this.#heardAt = performance.now();
    if (word.type === 'welcome') this.#welcomed(word);
    if (word.type === 'ack') this.#acknowledged(word.durable);
    if (word.type === 'missing') {
      this.#spool.miss(word.frames);
      this.#order.again();
      this.#hasSaidEnd = false;
    }
    if (word.type === 'ended') return this.#ended(word.session);
    this.pump();
  }

  #welcomed({ session, epoch, durable }) {
    [this.session, this.#epoch, this.#order] = [session, epoch, new Order()];
    this.#retryMs = RETRY_MS.first;
    this.#acknowledged(durable);
    this.#become('open');
  }

  #acknowledged(durable) {
    this.#spool.acknowledge(durable);
    this.#order.acknowledged(this.#spool);
  }

  #ended(session) {
    this.session = session;
    this.close();
    // Whoever was away for an hour comes back to a recording that the server has ended with what came.
    this.#become(this.#spool.isEmpty ? 'ended' : 'shortened');
  }

  #broke(code) {
    const isFirst = this.session === null;
    this.#hangUp();
    // Before anything was taken, whoever begins is told at once that the box is busy.
    const isFinal = isTold(code) && (!COME_AGAIN.includes(code) || (isFirst && code === 4409));
    if (isFinal) return this.#become('refused', code);
    this.#retryTimer = setTimeout(() => this.#connect(), this.#retryMs);
    this.#retryMs = Math.min(this.#retryMs * 2, RETRY_MS.most);
    this.#become('lost', isTold(code) ? code : null);
  }

  #tick() {
    if (this.#socket === null) return;
    const now = performance.now();
    const isAwaited = this.#epoch === null || this.#hasSaidEnd || this.#order.bytesUnderWay > 0;
    if (isAwaited && now - this.#heardAt > (this.#hasSaidEnd ? SILENT_AT_END_MS : SILENT_MS)) return this.#broke(null);
    if (!isAwaited) this.#heardAt = now;
    this.pump();
    if (this.#epoch !== null && !this.#hasSaidEnd && this.#last && now - this.#saidAt > SAY_EVERY_MS)
      this.#say(frameRecord(this.#epoch, this.#last));
  }

  #say(message) {
    this.#saidAt = performance.now();
    this.#socket.send(message);
  }

  #become(line, code = null) {
    [this.line, this.code] = [line, code];
    this.#onChange();
  }
}
