// Brings the exact rows of a session's parts while it is looked at: those at the moment, those that come next, those of the
// span that is shown. One after the other, so that no answer keeps the page from drawing.
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { framesWithin, PART, takePart, takeSeen } from './track.js';

/** So long after a part could not be had it is asked for again. */
const AGAIN_MS = 5_000;

export class PartsLoader {
  #track;
  #session;
  #listeners = new Set();
  #wanted = [];
  #running = false;
  #ending = new AbortController();
  #notBefore = 0;

  /** `hasSeen`: are there diagnostics? */
  constructor(session, track, hasSeen) {
    [this.#session, this.#track] = [session, track];
    if (!hasSeen) track.seen.fill(true);
  }

  /** Calls `listener(part)` when a part has come; returns what ends it. */
  onPart(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  end() {
    this.#ending.abort();
  }

  /** Wants the parts between two seconds, before all others that are wanted. */
  want(from, to) {
    const [first, last] = framesWithin(this.#track, from, to).map(frame => Math.floor(frame / PART));
    const parts = [];
    for (let part = first; part <= last; part++) if (!this.#has(part)) parts.push(part);
    if (!parts.length) return;
    this.#wanted = [...parts, ...this.#wanted.filter(part => !parts.includes(part))].slice(0, 16);
    this.#work();
  }

  #has(part) {
    return this.#track.exact[part] && this.#track.seen[part];
  }

  async #work() {
    if (this.#running || performance.now() < this.#notBefore) return;
    this.#running = true;
    try {
      while (this.#wanted.length && !this.#ending.signal.aborted) await this.#bring(this.#wanted.shift());
    } catch (error) {
      if (error.name !== 'AbortError') asProblem(error); // Said in the console; what is there stays, and it is asked for again.
      this.#notBefore = performance.now() + AGAIN_MS;
      this.#wanted = [];
    }
    this.#running = false;
  }

  async #bring(part) {
    const [track, signal] = [this.#track, this.#ending.signal];
    const frames = { from_frame: part * PART, to_frame: (part + 1) * PART };
    if (!track.exact[part]) {
      const rows = await api.sessions.trajectory(this.#session, { ...frames, trimmed: false }, signal);
      takePart(track, part, rows);
      this.#tell(part);
      await painted();
    }
    if (!track.seen[part]) {
      takeSeen(track, part, await api.sessions.diagnostics(this.#session, frames, signal));
      this.#tell(part);
      await painted();
    }
  }

  #tell(part) {
    for (const listener of this.#listeners) listener(part);
  }
}

/** The page may draw before the next answer is read. */
const painted = () => new Promise(done => requestAnimationFrame(() => setTimeout(done)));
