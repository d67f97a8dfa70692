// The one clock of a session page. The video drives it; where the browser cannot play the recording, it runs by itself.
// Overlay, curves and path draw when it ticks, without component state.
import { frameAt } from './track.js';

/** Seeks to a point inside a frame: at its edge, rounding would show the frame before. */
const INSIDE = 0.3;

/** Rates that every browser can play. */
const PLAYABLE_RATES = [1 / 16, 16];

export class Playback {
  constructor() {
    this.time = 0;
    this.playing = false;
    this.rate = 1;
    /** Times of the session are those of the video, counted from `startsAt` and multiplied by this factor. */
    this.factor = 1;
    /** Time of the video at which the session's time 0 lies, s: its picture may begin later than its sound. */
    this.startsAt = 0;
    /** @type {HTMLVideoElement | null} */
    this.video = null;
    /** @type {ArrayLike<number> | null} */
    this.times = null;
    this.fallbackDuration = 0;
    this.watchers = new Set();
    /** @type {[number, number] | null} */
    this.marked = null;
    /** Whether playback starts again at the end of a marked stretch. */
    this.looping = false;
    this.viewCallbacks = new Set();
  }

  /** Sets how the video's times become those of the session: see `video.clock` of a session. */
  setClock({ factor = 1, starts_at_s: startsAt = 0 }) {
    if (this.factor === factor && this.startsAt === startsAt) return;
    Object.assign(this, { factor, startsAt });
    this.setRate(this.rate);
  }

  /** Goes to a stretch and marks it in the curves. */
  show(from, to) {
    this.pause();
    this.marked = to > from ? [from, to] : null;
    this.looping = false;
    this.seek(from);
  }

  /** Marks a stretch; an empty one removes the mark. */
  mark(from, to) {
    this.marked = to > from ? [Math.max(0, from), Math.min(to, this.duration)] : null;
    if (!this.marked) this.looping = false;
    this.#notify();
  }

  /** Plays the marked stretch again and again, or stops doing so. */
  loop(wanted) {
    this.looping = wanted && this.marked !== null;
    if (this.looping && this.marked && (this.time < this.marked[0] || this.time >= this.marked[1])) this.seek(this.marked[0]);
    if (this.looping) this.play();
    this.#notify();
  }

  /** Draws again: something other than the time has changed. */
  refresh() {
    this.#notify();
  }

  /** As `show`, and also scrolls the picture into view, for people elsewhere on the page. */
  showInView(from, to) {
    this.show(from, to);
    for (const callback of this.viewCallbacks) callback();
  }

  /** Calls `callback()` when the picture should come into view; returns a function that unsubscribes. */
  onShowInView(callback) {
    this.viewCallbacks.add(callback);
    return () => this.viewCallbacks.delete(callback);
  }

  /** Calls `watcher(this)` on every new picture and change; returns a function that unsubscribes. */
  onTick(watcher) {
    this.watchers.add(watcher);
    watcher(this);
    return () => this.watchers.delete(watcher);
  }

  get frame() {
    return this.times ? frameAt(this.times, this.time) : 0;
  }

  get duration() {
    const tracked = this.times?.[this.times.length - 1] ?? 0;
    const video = this.#sessionTime(this.video?.duration ?? 0);
    return Math.max(Number.isFinite(video) ? video : 0, tracked, this.fallbackDuration);
  }

  attach(video) {
    this.video = video;
    this.setRate(this.rate);
    const follow = () => this.#setTime(this.#sessionTime(video.currentTime));
    const syncPlaying = () => {
      this.playing = !video.paused;
      this.#notify();
    };
    const handlers = {
      play: syncPlaying,
      pause: syncPlaying,
      seeked: follow,
      loadedmetadata: follow,
      timeupdate: () => video.paused && follow(),
    };
    for (const [name, handler] of Object.entries(handlers)) video.addEventListener(name, handler);
    const stop = this.#followFrames(video);
    return () => {
      stop();
      for (const [name, handler] of Object.entries(handlers)) video.removeEventListener(name, handler);
      if (this.video === video) this.video = null;
    };
  }

  /**
   * The exact time of each picture as it is shown; in browsers without that call, the video's clock on each repaint.
   */
  #followFrames(video) {
    let handle;
    if (video.requestVideoFrameCallback) {
      const shown = (_, picture) => {
        this.#setTime(this.#sessionTime(picture.mediaTime));
        handle = video.requestVideoFrameCallback(shown);
      };
      handle = video.requestVideoFrameCallback(shown);
      return () => video.cancelVideoFrameCallback(handle);
    }
    const repaint = () => {
      if (!video.paused) this.#setTime(this.#sessionTime(video.currentTime));
      handle = requestAnimationFrame(repaint);
    };
    handle = requestAnimationFrame(repaint);
    return () => cancelAnimationFrame(handle);
  }

  /** The recording cannot be played here: runs without it. */
  withoutVideo(duration) {
    this.video = null;
    this.fallbackDuration = duration;
    this.#notify();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.time >= this.duration - 0.01) this.seek(0);
    // Refused, or replaced by a pause: the state stays "paused".
    if (this.video) return void this.video.play().catch(() => {});
    this.playing = true;
    let before = performance.now();
    const run = now => {
      if (!this.playing) return;
      this.#setTime(Math.min(this.duration, this.time + ((now - before) / 1000) * this.rate));
      before = now;
      if (this.time >= this.duration) this.pause();
      else requestAnimationFrame(run);
    };
    requestAnimationFrame(run);
  }

  pause() {
    if (this.video) return this.video.pause();
    this.playing = false;
    this.#notify();
  }

  setRate(rate) {
    this.rate = rate;
    const [slowest, fastest] = PLAYABLE_RATES;
    if (this.video) this.video.playbackRate = Math.min(Math.max(rate / this.factor, slowest), fastest);
    this.#notify();
  }

  seek(time) {
    const wanted = Math.min(Math.max(0, time), this.duration);
    if (this.video) this.video.currentTime = this.startsAt + wanted / this.factor;
    this.#setTime(wanted);
  }

  seekFrame(frame) {
    if (!this.times) return;
    const last = this.times.length - 1;
    const index = Math.min(Math.max(0, frame), last);
    const step = (this.times[last] - this.times[0]) / Math.max(1, last);
    this.seek(this.times[index] + step * INSIDE);
    this.#setTime(this.times[index]);
  }

  step(frames) {
    this.pause();
    this.seekFrame(this.frame + frames);
  }

  /** Time of the session at a time of the video; before the first picture it is 0. */
  #sessionTime(time) {
    return Math.max(0, (time - this.startsAt) * this.factor);
  }

  #setTime(time) {
    this.time = time;
    if (this.looping && this.marked && this.playing && time >= Math.min(this.marked[1], this.duration - 0.05)) return this.seek(this.marked[0]);
    this.#notify();
  }

  #notify() {
    for (const watcher of this.watchers) watcher(this);
  }
}
