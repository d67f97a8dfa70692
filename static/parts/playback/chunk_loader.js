// Loads the exact rows of a session in chunks while it is viewed: those at the current time, those that come next,
// those of the shown span. One after the other, so that no answer keeps the page from drawing.
import { api } from '../../api.js';
import { asProblem } from '../../data.js';
import { CHUNK_FRAMES, framesWithin, storeChunk, storeDiagnostics } from './track.js';

/** A chunk that could not be loaded is requested again after this time. */
const RETRY_MS = 5_000;

export class ChunkLoader {
  #track;
  #session;
  #listeners = new Set();
  #queued = [];
  #running = false;
  #controller = new AbortController();
  #notBefore = 0;

  /** `hasDiagnostics`: whether the session has diagnostics. */
  constructor(session, track, hasDiagnostics) {
    [this.#session, this.#track] = [session, track];
    if (!hasDiagnostics) track.diagnosed.fill(true);
  }

  /** Calls `listener(chunk)` when a chunk has arrived; returns a function that unsubscribes. */
  onChunk(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  end() {
    this.#controller.abort();
  }

  /** Requests the chunks between two times, before all others that are queued. */
  request(from, to) {
    const [first, last] = framesWithin(this.#track, from, to).map(frame => Math.floor(frame / CHUNK_FRAMES));
    const chunks = [];
    for (let chunk = first; chunk <= last; chunk++) if (!this.#isComplete(chunk)) chunks.push(chunk);
    if (!chunks.length) return;
    this.#queued = [...chunks, ...this.#queued.filter(chunk => !chunks.includes(chunk))].slice(0, 16);
    this.#run();
  }

  #isComplete(chunk) {
    return this.#track.exact[chunk] && this.#track.diagnosed[chunk];
  }

  async #run() {
    if (this.#running || performance.now() < this.#notBefore) return;
    this.#running = true;
    try {
      while (this.#queued.length && !this.#controller.signal.aborted) await this.#load(this.#queued.shift());
    } catch (error) {
      // Logged to the console; the rows so far stay, and the chunk is requested again.
      if (error.name !== 'AbortError') asProblem(error);
      this.#notBefore = performance.now() + RETRY_MS;
      this.#queued = [];
    }
    this.#running = false;
  }

  async #load(chunk) {
    const [track, signal] = [this.#track, this.#controller.signal];
    const frames = { from_frame: chunk * CHUNK_FRAMES, to_frame: (chunk + 1) * CHUNK_FRAMES };
    if (!track.exact[chunk]) {
      const rows = await api.sessions.trajectory(this.#session, { ...frames, trimmed: false }, signal);
      storeChunk(track, chunk, rows);
      this.#notify(chunk);
      await afterPaint();
    }
    if (!track.diagnosed[chunk]) {
      storeDiagnostics(track, chunk, await api.sessions.diagnostics(this.#session, frames, signal));
      this.#notify(chunk);
      await afterPaint();
    }
  }

  #notify(chunk) {
    for (const listener of this.#listeners) listener(chunk);
  }
}

/** Lets the page draw before the next answer is read. */
const afterPaint = () => new Promise(done => requestAnimationFrame(() => setTimeout(done)));
