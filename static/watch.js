// A session that is watched while it arrives, as docs/live.md has it: the socket, its reconnections, what was told last.
// Positions and pictures are drawn when the screen is repainted; nothing of them goes through component state.
import { useEffect, useMemo, useReducer, useRef } from './parts/preact.js';
import { api } from './api.js';
import { inOurWords } from './said.js';
import { LiveTrack } from './parts/live_track.js';

const RETRY_MS = { first: 1_000, most: 30_000 };
/** A sender says something every 20 s: when nothing came for longer than that, it may be our line that is dead. */
const SILENT_MS = { noticed: 3_000, broken: 25_000 };
/** A device is too slow when it misses so many messages, of some 25 a second, in such a time. */
const MISSED = { most: 100, ms: 10_000 };
const PICTURE_HEAD = 8; // Bytes: the number of the frame.

export class Watch {
  /** `'connecting'`, `'waiting'` (nobody sends), `'live'`, `'silent'` (nothing comes), `'broken'` or `'ended'`. */
  state = 'connecting';
  /** The last seconds of positions; null where it is not tracked, and then `why` may say why not. */
  track = null;
  why = null;
  features = [];
  light = null;
  /** Whether camera and ports stand where they did; null where that is not known. */
  placement = null;
  isBehind = false;
  /** The newest picture: `{ frame, bitmap }`. */
  picture = null;

  #id;
  #pictures;
  #onClosed;
  #isOpen = false;
  #socket = null;
  #jpeg = null;
  #isDecoding = false;
  #retryMs = RETRY_MS.first;
  #retryTimer;
  #clock;
  #heardAt = 0;
  #missed = { since: 0, count: 0 };
  #repaint = 0;
  #watchers = new Set();
  #listeners = new Set();

  /** `onClosed` is called whenever the line ends: the session itself tells why. `pictures`: are they wanted? */
  constructor(id, onClosed, pictures = true) {
    [this.#id, this.#onClosed, this.#pictures] = [id, onClosed, pictures];
  }

  open() {
    this.#isOpen = true;
    this.#clock = setInterval(() => this.#look(), 1000);
    this.#connect();
  }

  close() {
    this.#isOpen = false;
    clearInterval(this.#clock);
    clearTimeout(this.#retryTimer);
    cancelAnimationFrame(this.#repaint);
    this.#hangUp();
    this.#jpeg = null;
    this.picture?.bitmap.close();
    this.picture = null;
  }

  /** Tries at once where it would have waited: for those who know that the line is there again. */
  retry() {
    if (this.state !== 'broken') return;
    clearTimeout(this.#retryTimer);
    this.#retryMs = RETRY_MS.first;
    this.#renew();
  }

  /** Calls `watcher()` on the repaint after positions or a picture came; returns what ends it. */
  onTick(watcher) {
    this.#watchers.add(watcher);
    watcher();
    return () => this.#watchers.delete(watcher);
  }

  /** Calls `listener()` when anything else changed: the state, features, light, tools. */
  onChange(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** Are positions what is so now? Otherwise they are what was so when the line or the sender fell silent. */
  get isFresh() {
    return this.state === 'live';
  }

  #connect() {
    const socket = (this.#socket = api.sessions.watch(this.#id, { pictures: this.#pictures }));
    socket.binaryType = 'arraybuffer';
    socket.onmessage = ({ data }) => this.#hear(data);
    socket.onclose = () => this.#broke();
  }

  #hangUp() {
    if (this.#socket) Object.assign(this.#socket, { onmessage: null, onclose: null }).close();
    this.#socket = null;
  }

  #broke() {
    this.#hangUp();
    if (this.state !== 'ended') {
      this.#become('broken');
      this.#retryTimer = setTimeout(() => this.#connect(), this.#retryMs);
      this.#retryMs = Math.min(this.#retryMs * 2, RETRY_MS.most);
    }
    this.#onClosed();
  }

  /** What was told stays until the new line says otherwise. */
  #renew() {
    this.#hangUp();
    this.#heardAt = performance.now();
    this.#connect();
  }

  #hear(data) {
    this.#heardAt = performance.now();
    this.#retryMs = RETRY_MS.first;
    if (typeof data !== 'string') return this.#takePicture(data);
    const word = inOurWords(JSON.parse(data));
    if (word.type === 'frame') return this.#takeFrame(word);
    this.#take(word);
  }

  #takeFrame(frame) {
    this.track?.push(frame);
    this.#become('live');
    if (this.track?.frames === 1) this.#changed();
    this.#soon();
  }

  #take(word) {
    if (word.type === 'waiting' || word.type === 'ended') return this.#become(word.type);
    if (word.type === 'missed') return this.#miss(word.count);
    if (word.type === 'live') {
      if (!this.track?.fits(word)) this.track = word.tools && new LiveTrack(word);
      this.why = word.why;
      // Whether a sender that had fallen silent sends again, its first frame tells.
      if (this.state !== 'silent' || !word.tools) this.#become('live');
    }
    if (word.type === 'features') [this.features, this.light, this.placement] = [word.features, word.light, word.placement];
    this.#changed();
  }

  #miss(count) {
    const now = performance.now();
    if (now - this.#missed.since > MISSED.ms) this.#missed = { since: now, count: 0 };
    this.#missed.count += count;
  }

  /** Once a second: does nothing come any more, and is too much missed? */
  #look() {
    const now = performance.now();
    const silentMs = now - this.#heardAt;
    const isUp = ['live', 'silent', 'waiting'].includes(this.state);
    if (isUp && silentMs > SILENT_MS.broken) this.#renew();
    else if (this.isFresh && this.track && silentMs > SILENT_MS.noticed) this.#become('silent');
    const isBehind = this.#missed.count > MISSED.most && now - this.#missed.since < 2 * MISSED.ms;
    if (isBehind === this.isBehind) return;
    this.isBehind = isBehind;
    this.#changed();
  }

  /** Of the pictures that come while one is being decoded, only the last is of interest. */
  async #takePicture(data) {
    this.#jpeg = data;
    if (this.#isDecoding) return;
    this.#isDecoding = true;
    while (this.#jpeg) {
      const jpeg = this.#jpeg;
      this.#jpeg = null;
      const picture = new Blob([new Uint8Array(jpeg, PICTURE_HEAD)], { type: 'image/jpeg' });
      const bitmap = await createImageBitmap(picture).catch(() => null); // A damaged one: the next comes soon.
      if (bitmap) this.#show({ frame: Number(new DataView(jpeg).getBigUint64(0)), bitmap });
    }
    this.#isDecoding = false;
  }

  #show(picture) {
    if (!this.#isOpen) return picture.bitmap.close();
    this.picture?.bitmap.close();
    this.picture = picture;
    this.#soon();
  }

  #become(state) {
    if (this.state === state) return;
    this.state = state;
    this.#changed();
    this.#soon();
  }

  #changed() {
    for (const listener of this.#listeners) listener();
  }

  #soon() {
    this.#repaint ||= requestAnimationFrame(() => {
      this.#repaint = 0;
      for (const watcher of this.#watchers) watcher();
    });
  }
}

/** Watches a session while the component is there, which is rendered again when anything but positions changes; without an
 *  id there is nothing to watch, and null. */
export function useWatch(id, onClosed, pictures) {
  const [, render] = useReducer(count => count + 1, 0);
  const latest = useRef(onClosed);
  latest.current = onClosed ?? (() => {});
  const watch = useMemo(() => id && new Watch(id, () => latest.current(), pictures), [id]);
  useEffect(() => {
    if (!watch) return undefined;
    const end = watch.onChange(render);
    watch.open();
    return () => (end(), watch.close());
  }, [watch]);
  return watch;
}
