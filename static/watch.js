// Watches a session while it arrives, as docs/live.md specifies: the socket, its reconnections, and the latest state.
// Positions and pictures are drawn on repaint and do not pass through component state.
import { useEffect, useMemo, useReducer, useRef } from './preact.js';
import { api } from './api.js';
import { LiveTrack } from './parts/live/live_track.js';

const RETRY_MS = { first: 1_000, max: 30_000 };
/** A sender sends something every 20 s. After a longer silence the page's own connection may be dead. */
const SILENT_MS = { noticed: 3_000, broken: 25_000 };
/** The device is too slow if it misses more than `max` messages, of about 25 a second, within `ms`. */
const MISSED = { max: 100, ms: 10_000 };
const PICTURE_HEAD = 8; // Bytes: the frame number.

export class LiveWatch {
  /** `'connecting'`, `'waiting'` (no sender), `'live'`, `'silent'` (nothing arrives), `'broken'` or `'ended'`. */
  state = 'connecting';
  /**
   * The last seconds of positions; null if the session is not tracked, and `why` may then give the reason.
   * @type {LiveTrack | null}
   */
  track = null;
  why = null;
  features = [];
  light = null;
  /** How far camera and ports have moved since earlier recordings; null if not known. */
  placement = null;
  /** The movement of the camera during this recording. @type {{ mm: number, at_s: number } | null} */
  movedDuring = null;
  /**
   * How well each tool was seen so far, judged as the result will be.
   * @type {{ coverage: number | null, reason: Schemas['ConcernDocument'] | null }[]}
   */
  seen = [];
  /** Whether the box behind tools without tape is still being learned. */
  isLearningBox = false;
  isBehind = false;
  /** What is known of the recording while it has no sender. @type {{ recorded_s: number | null, ends_in_s: number | null } | null} */
  interruption = null;
  /** The newest picture. @type {{ frame: number, bitmap: ImageBitmap } | null} */
  picture = null;

  #id;
  #pictures;
  #onClosed;
  #isOpen = false;
  /** @type {WebSocket | null} */
  #socket = null;
  #jpeg = null;
  #isDecoding = false;
  #retryMs = RETRY_MS.first;
  #retryTimer;
  #checkTimer;
  #receivedAt = 0;
  #missed = { since: 0, count: 0 };
  #repaintHandle = 0;
  #watchers = new Set();
  #listeners = new Set();

  /**
   * `onClosed` is called whenever the connection ends; the session itself has the reason. `pictures`: whether to
   * receive pictures.
   */
  constructor(id, onClosed, pictures = true) {
    [this.#id, this.#onClosed, this.#pictures] = [id, onClosed, pictures];
  }

  open() {
    this.#isOpen = true;
    this.#checkTimer = setInterval(() => this.#checkHealth(), 1000);
    this.#connect();
  }

  close() {
    this.#isOpen = false;
    clearInterval(this.#checkTimer);
    clearTimeout(this.#retryTimer);
    cancelAnimationFrame(this.#repaintHandle);
    this.#closeSocket();
    this.#jpeg = null;
    this.picture?.bitmap.close();
    this.picture = null;
  }

  /** Reconnects immediately instead of waiting: for callers that know that the network is back. */
  retry() {
    if (this.state !== 'broken') return;
    clearTimeout(this.#retryTimer);
    this.#retryMs = RETRY_MS.first;
    this.#reconnect();
  }

  /** Calls `watcher()` on the repaint after new positions or a new picture; returns a function that unsubscribes. */
  onTick(watcher) {
    this.#watchers.add(watcher);
    watcher();
    return () => this.#watchers.delete(watcher);
  }

  /** Calls `listener()` when anything else changes: the state, features, light, tools. */
  onChange(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /**
   * Whether the positions are current. Otherwise they are the last ones before the connection or the sender fell
   * silent.
   */
  get isFresh() {
    return this.state === 'live';
  }

  #connect() {
    const socket = (this.#socket = api.sessions.watch(this.#id, { pictures: this.#pictures }));
    socket.binaryType = 'arraybuffer';
    socket.onmessage = ({ data }) => this.#receive(data);
    socket.onclose = () => this.#handleClose();
  }

  #closeSocket() {
    if (this.#socket) Object.assign(this.#socket, { onmessage: null, onclose: null }).close();
    this.#socket = null;
  }

  #handleClose() {
    this.#closeSocket();
    if (this.state !== 'ended') {
      this.#setState('broken');
      this.#retryTimer = setTimeout(() => this.#connect(), this.#retryMs);
      this.#retryMs = Math.min(this.#retryMs * 2, RETRY_MS.max);
    }
    this.#onClosed();
  }

  /** Reconnects; the latest state stays until the new connection replaces it. */
  #reconnect() {
    this.#closeSocket();
    this.#receivedAt = performance.now();
    this.#connect();
  }

  #receive(data) {
    this.#receivedAt = performance.now();
    this.#retryMs = RETRY_MS.first;
    if (typeof data !== 'string') return this.#handlePicture(data);
    const message = JSON.parse(data);
    if (message.type === 'frame') return this.#handleFrame(message);
    this.#handleMessage(message);
  }

  #handleFrame(frame) {
    this.track?.push(frame);
    this.#setState('live');
    if (this.track?.frames === 1) this.#notifyListeners();
    this.#requestRepaint();
  }

  #handleMessage(message) {
    if (message.type === 'waiting') this.interruption = message;
    if (message.type === 'waiting' || message.type === 'ended') return this.#setState(message.type);
    if (message.type === 'missed') return this.#countMissed(message.count);
    if (message.type === 'live') {
      if (!this.track?.matches(message)) this.track = message.tools && new LiveTrack(message);
      this.why = message.why;
      // If a silent sender sends again, its first frame shows it.
      if (this.state !== 'silent' || !message.tools) this.#setState('live');
    }
    if (message.type === 'features') this.#keepFeatures(message);
    this.#notifyListeners();
  }

  #keepFeatures({ features, light, placement, moved_during: movedDuring, seen, is_learning_box: isLearningBox }) {
    [this.features, this.light, this.placement, this.seen] = [features, light, placement, seen ?? []];
    this.isLearningBox = isLearningBox;
    this.movedDuring = movedDuring ?? null;
  }

  #countMissed(count) {
    const now = performance.now();
    if (now - this.#missed.since > MISSED.ms) this.#missed = { since: now, count: 0 };
    this.#missed.count += count;
  }

  /** Runs once a second: detects silence and too many missed messages. */
  #checkHealth() {
    const now = performance.now();
    const silentMs = now - this.#receivedAt;
    const isUp = ['live', 'silent', 'waiting'].includes(this.state);
    if (isUp && silentMs > SILENT_MS.broken) this.#reconnect();
    else if (this.isFresh && this.track && silentMs > SILENT_MS.noticed) this.#setState('silent');
    const isBehind = this.#missed.count > MISSED.max && now - this.#missed.since < 2 * MISSED.ms;
    if (isBehind === this.isBehind) return;
    this.isBehind = isBehind;
    this.#notifyListeners();
  }

  /** Of the pictures that arrive while one is being decoded, only the last is decoded. */
  async #handlePicture(data) {
    this.#jpeg = data;
    if (this.#isDecoding) return;
    this.#isDecoding = true;
    while (this.#jpeg) {
      const jpeg = this.#jpeg;
      this.#jpeg = null;
      const picture = new Blob([new Uint8Array(jpeg, PICTURE_HEAD)], { type: 'image/jpeg' });
      // A damaged picture: the next one arrives soon.
      const bitmap = await createImageBitmap(picture).catch(() => null);
      if (bitmap) this.#showPicture({ frame: Number(new DataView(jpeg).getBigUint64(0)), bitmap });
    }
    this.#isDecoding = false;
  }

  #showPicture(picture) {
    if (!this.#isOpen) return picture.bitmap.close();
    this.picture?.bitmap.close();
    this.picture = picture;
    this.#requestRepaint();
  }

  #setState(state) {
    if (this.state === state) return;
    this.state = state;
    this.#notifyListeners();
    this.#requestRepaint();
  }

  #notifyListeners() {
    for (const listener of this.#listeners) listener();
  }

  #requestRepaint() {
    this.#repaintHandle ||= requestAnimationFrame(() => {
      this.#repaintHandle = 0;
      for (const watcher of this.#watchers) watcher();
    });
  }
}

/**
 * Watches a session while the component is mounted, and renders it again when anything but positions changes. Returns
 * null without an id.
 */
export function useLiveWatch(id, onClosed, pictures) {
  const [, render] = useReducer(count => count + 1, 0);
  const latest = useRef(onClosed);
  latest.current = onClosed ?? (() => {});
  const watch = useMemo(() => id && new LiveWatch(id, () => latest.current(), pictures), [id]);
  useEffect(() => {
    if (!watch) return undefined;
    const unsubscribe = watch.onChange(render);
    watch.open();
    return () => (unsubscribe(), watch.close());
  }, [watch]);
  return watch;
}
