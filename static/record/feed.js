// The sender's end of a feed, protocol 1 of docs/feed.md: connects again until the recording is complete on the server.
import { SendOrder } from './send_order.js';
import { frameRecord, gapRecord } from './records.js';

const RETRY_MS = { first: 500, max: 5_000 };
/**
 * Close codes after which the feed connects again by itself: the last column of the table in docs/feed.md; and 4401,
 * since the person signs in again on this very page.
 */
const RECONNECT_CODES = [1012, 4401, 4408, 4409, 4500];
/** Close codes of the protocol. Any other means a broken connection, for which a browser gives no reason. */
const isProtocolCode = code => code === 1012 || (code >= 4400 && code < 4600);
/** Bytes that may wait in the browser: more would only delay the live picture. */
const MAX_BUFFERED = 1 << 20;
/** Without an acknowledgement for this long, the connection is dead and the browser has not noticed. */
const MAX_SILENCE_MS = 10_000;
/** The server needs time to assemble a long recording. */
const MAX_SILENCE_AT_END_MS = 120_000;
/**
 * A sender sends something at least every 20 s. A browser cannot ping, so the last frame is sent again, which the
 * server ignores.
 */
const KEEP_ALIVE_MS = 8_000;
const TICK_MS = 100;

export class Feed {
  /**
   * `'connecting'`, `'open'`, `'lost'`, and finally `'ended'` (all is on the server), `'shortened'` (the server ended
   * it without what is still kept here) or `'refused'`.
   */
  connection = 'connecting';
  /** The session of the recording, once it is known. */
  session = null;
  /** Why the connection is lost or refused: a close code. */
  code = null;

  #address;
  #hello;
  #spool;
  #onChange;
  /** @type {any} A WebSocket while there is a connection. */
  #socket = null;
  #epoch = null;
  /** @type {any} A SendOrder once the server has answered. */
  #order = null;
  #isLive = true;
  #endSent = false;
  #receivedAt = 0;
  #sentAt = 0;
  #lastFrame = null; // The newest frame that was sent, to be sent again.
  #retryMs = RETRY_MS.first;
  #retryTimer;
  #ticker;

  constructor({ address, hello, spool, onChange }) {
    [this.#address, this.#hello, this.#spool, this.#onChange] = [address, hello, spool, onChange];
    this.#ticker = setInterval(() => this.#tick(), TICK_MS);
    this.#connect();
  }

  /** Sends what is due, as much as the connection takes. */
  pump() {
    if (this.#epoch === null || this.#endSent) return;
    while (this.#socket.bufferedAmount < MAX_BUFFERED) {
      const item = this.#order.next(this.#spool, this.#isLive);
      if (!item) break;
      this.#send(item.payload ? frameRecord(this.#epoch, item) : gapRecord(this.#epoch, [item.number, item.last]));
      if (item.payload) this.#lastFrame = item;
    }
    // The end is sent only once everything is acknowledged, so that until then the page can show how much is still kept
    // here.
    if (this.#isLive || !this.#spool.isEmpty) return;
    this.#endSent = true;
    this.#send(JSON.stringify({ type: 'end', frames: this.#spool.end }));
  }

  /** No more frames will come. */
  finish() {
    this.#isLive = false;
    this.pump();
  }

  /** Connects immediately, also after a refusal: for a person who has corrected the cause. */
  retry() {
    if (['open', 'ended', 'shortened'].includes(this.connection)) return;
    this.#closeSocket();
    this.#connect();
  }

  close() {
    clearInterval(this.#ticker);
    this.#closeSocket();
  }

  #connect() {
    clearTimeout(this.#retryTimer);
    this.#receivedAt = performance.now();
    const socket = (this.#socket = new WebSocket(this.#address));
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => this.#send(JSON.stringify(this.#hello));
    socket.onmessage = ({ data }) => this.#receive(JSON.parse(data));
    socket.onclose = ({ code }) => this.#handleClose(code);
    if (this.connection === 'refused') this.#setConnection('connecting');
  }

  #closeSocket() {
    clearTimeout(this.#retryTimer);
    this.#epoch = null;
    this.#endSent = false;
    if (this.#socket) Object.assign(this.#socket, { onopen: null, onmessage: null, onclose: null }).close();
    this.#socket = null;
  }

  #receive(message) {
    this.#receivedAt = performance.now();
    if (message.type === 'welcome') this.#handleWelcome(message);
    if (message.type === 'ack') this.#handleAck(message.durable);
    if (message.type === 'missing') {
      this.#spool.reportMissing(message.frames);
      this.#order.restart();
      this.#endSent = false;
    }
    if (message.type === 'ended') return this.#handleEnded(message.session);
    this.pump();
  }

  #handleWelcome({ session, epoch, durable }) {
    [this.session, this.#epoch, this.#order] = [session, epoch, new SendOrder()];
    this.#retryMs = RETRY_MS.first;
    this.#handleAck(durable);
    this.#setConnection('open');
  }

  #handleAck(durable) {
    this.#spool.acknowledge(durable);
    this.#order.acknowledged(this.#spool);
  }

  #handleEnded(session) {
    this.session = session;
    this.close();
    // After a long outage, the server may have ended the recording with the frames that it had.
    this.#setConnection(this.#spool.isEmpty ? 'ended' : 'shortened');
  }

  #handleClose(code) {
    const isFirst = this.session === null;
    this.#closeSocket();
    // If the server has not accepted anything yet, a busy box is reported at once.
    const isFinal = isProtocolCode(code) && (!RECONNECT_CODES.includes(code) || (isFirst && code === 4409));
    if (isFinal) return this.#setConnection('refused', code);
    this.#retryTimer = setTimeout(() => this.#connect(), this.#retryMs);
    this.#retryMs = Math.min(this.#retryMs * 2, RETRY_MS.max);
    this.#setConnection('lost', isProtocolCode(code) ? code : null);
  }

  #tick() {
    if (this.#socket === null) return;
    const now = performance.now();
    const isAwaited = this.#epoch === null || this.#endSent || this.#order.bytesInFlight > 0;
    if (isAwaited && now - this.#receivedAt > (this.#endSent ? MAX_SILENCE_AT_END_MS : MAX_SILENCE_MS)) return this.#handleClose(null);
    if (!isAwaited) this.#receivedAt = now;
    this.pump();
    if (this.#epoch !== null && !this.#endSent && this.#lastFrame && now - this.#sentAt > KEEP_ALIVE_MS)
      this.#send(frameRecord(this.#epoch, this.#lastFrame));
  }

  #send(message) {
    this.#sentAt = performance.now();
    this.#socket.send(message);
  }

  #setConnection(connection, code = null) {
    [this.connection, this.code] = [connection, code];
    this.#onChange();
  }
}
