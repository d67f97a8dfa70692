// The one clock of a session page. The video drives it, or, where the browser cannot play the recording, it runs by
// itself. Overlay, curves and path draw when it ticks; nothing of that goes through component state.
import { frameAt } from './track.js';

/** Seeking lands inside a frame, not on its edge, where rounding would show the frame before. */
const INSIDE = 0.3;

export class Playback {
  constructor() {
    this.time = 0;
    this.playing = false;
    this.rate = 1;
    this.video = null;
    this.times = null;
    this.fallbackDuration = 0;
    this.watchers = new Set();
    this.marked = null;
    /** Does it begin again where a marked stretch ends? */
    this.looping = false;
    this.lookers = new Set();
  }

  /** Goes to a stretch and marks it in the curves. */
  show(from, to) {
    this.pause();
    this.marked = to > from ? [from, to] : null;
    this.looping = false;
    this.seek(from);
  }

  /** Marks a stretch, or with nothing, none. */
  mark(from, to) {
    this.marked = to > from ? [Math.max(0, from), Math.min(to, this.duration)] : null;
    if (!this.marked) this.looping = false;
    this.#tell();
  }

  /** Plays the marked stretch again and again, or does so no more. */
  loop(wanted) {
    this.looping = wanted && this.marked !== null;
    if (this.looping && (this.time < this.marked[0] || this.time >= this.marked[1])) this.seek(this.marked[0]);
    if (this.looping) this.play();
    this.#tell();
  }

  /** Something that is drawn has changed without the moment. */
  refresh() {
    this.#tell();
  }

  /** The same for somebody who wants to look at it: the picture comes into sight, wherever on the page they are. */
  lookAt(from, to) {
    this.show(from, to);
    for (const look of this.lookers) look();
  }

  /** Calls `look()` when somebody wants to see the picture; returns what ends it. */
  onLook(look) {
    this.lookers.add(look);
    return () => this.lookers.delete(look);
  }

  /** Calls `watch(this)` on every new picture and change; returns what ends it. */
  onTick(watch) {
    this.watchers.add(watch);
    watch(this);
    return () => this.watchers.delete(watch);
  }

  get frame() {
    return this.times ? frameAt(this.times, this.time) : 0;
  }

  get duration() {
    const tracked = this.times?.[this.times.length - 1] ?? 0;
    const video = this.video?.duration;
    return Math.max(Number.isFinite(video) ? video : 0, tracked, this.fallbackDuration);
  }

  attach(video) {
    this.video = video;
    const follow = () => this.#moved(video.currentTime);
    const state = () => {
      this.playing = !video.paused;
      this.#tell();
    };
    const handlers = {
      play: state,
      pause: state,
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

  /** The exact time of each picture as it is shown; where the browser has no such call, the video's clock on each repaint. */
  #followFrames(video) {
    let handle;
    if (video.requestVideoFrameCallback) {
      const shown = (_, picture) => {
        this.#moved(picture.mediaTime);
        handle = video.requestVideoFrameCallback(shown);
      };
      handle = video.requestVideoFrameCallback(shown);
      return () => video.cancelVideoFrameCallback(handle);
    }
    const repaint = () => {
      if (!video.paused) this.#moved(video.currentTime);
      handle = requestAnimationFrame(repaint);
    };
    handle = requestAnimationFrame(repaint);
    return () => cancelAnimationFrame(handle);
  }

  /** The recording cannot be played here: go on without it. */
  withoutVideo(duration) {
    this.video = null;
    this.fallbackDuration = duration;
    this.#tell();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.time >= this.duration - 0.01) this.seek(0);
    if (this.video) return void this.video.play().catch(() => {}); // Refused or replaced by a pause: the state stays "paused".
    this.playing = true;
    let before = performance.now();
    const run = now => {
      if (!this.playing) return;
      this.#moved(Math.min(this.duration, this.time + ((now - before) / 1000) * this.rate));
      before = now;
      if (this.time >= this.duration) this.pause();
      else requestAnimationFrame(run);
    };
    requestAnimationFrame(run);
  }

  pause() {
    if (this.video) return this.video.pause();
    this.playing = false;
    this.#tell();
  }

  setRate(rate) {
    this.rate = rate;
    if (this.video) this.video.playbackRate = rate;
    this.#tell();
  }

  seek(time) {
    const wanted = Math.min(Math.max(0, time), this.duration);
    if (this.video) this.video.currentTime = wanted;
    this.#moved(wanted);
  }

  seekFrame(frame) {
    if (!this.times) return;
    const last = this.times.length - 1;
    const index = Math.min(Math.max(0, frame), last);
    const step = (this.times[last] - this.times[0]) / Math.max(1, last);
    this.seek(this.times[index] + step * INSIDE);
    this.#moved(this.times[index]);
  }

  step(frames) {
    this.pause();
    this.seekFrame(this.frame + frames);
  }

  #moved(time) {
    this.time = time;
    if (this.looping && this.playing && time >= Math.min(this.marked[1], this.duration - 0.05)) return this.seek(this.marked[0]);
    this.#tell();
  }

  #tell() {
    for (const watch of this.watchers) watch(this);
  }
}
