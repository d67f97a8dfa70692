// The stream of server-sent events, shared by all tabs of this browser: a browser opens only six connections to a host.
// One tab holds the stream and passes its events on to the others. A lock elects it, which the browser frees when the
// tab is closed. Without locks (an address that is not secure) each tab has its own stream.
import { api } from './api.js';

const EVENT_NAMES = ['session', 'job', 'queue'];
const RETRY_MS = { first: 1_000, max: 30_000 };

/** The tab's part in the shared stream, from `join` until `leave`. */
export class EventStream {
  /** `'connecting' | 'open' | 'broken'`, for all that this tab knows. */
  state = 'connecting';

  #name;
  #onEvent;
  #onState;
  /** @type {BroadcastChannel | null} */
  #channel = null;
  /** @type {EventSource | null} Only in the tab that holds the stream. */
  #source = null;
  #leave = new AbortController();
  #retryTimer;
  #retryMs = RETRY_MS.first;
  #lastQueue = null;

  /** `person`: whose stream; `onEvent(name, detail)` and `onState(state)` are called for each event and change. */
  constructor(person, { onEvent, onState }) {
    [this.#name, this.#onEvent, this.#onState] = [`trocar.events.${person}`, onEvent, onState];
  }

  join() {
    if (!navigator.locks || !('BroadcastChannel' in window)) return this.#connect();
    this.#channel = new BroadcastChannel(this.#name);
    this.#channel.onmessage = ({ data }) => this.#hear(data);
    this.#channel.postMessage({ asks: true });
    const { signal } = this.#leave;
    navigator.locks.request(this.#name, { signal }, () => this.#hold(signal)).catch(() => {}); // left before its turn
  }

  leave() {
    this.#leave.abort();
    clearTimeout(this.#retryTimer);
    this.#source?.close();
    this.#source = null;
    this.#channel?.close();
    this.#channel = null;
  }

  /** Holds the stream until this tab leaves. */
  #hold(signal) {
    if (signal.aborted) return undefined;
    this.#connect();
    return new Promise(done => signal.addEventListener('abort', () => done(undefined)));
  }

  /** A message of another tab. */
  #hear({ asks, answer, state, event }) {
    if (this.#source) return asks && this.#tell({ answer: { state: this.state, queue: this.#lastQueue } });
    if (answer && this.state === 'connecting') {
      this.#changeState(answer.state);
      if (answer.queue) this.#onEvent('queue', answer.queue);
    }
    if (state) this.#changeState(state);
    if (event) this.#onEvent(event.name, event.detail);
  }

  #tell(message) {
    this.#channel?.postMessage(message);
  }

  #connect() {
    this.#source?.close();
    const source = (this.#source = api.events());
    source.onopen = () => {
      this.#retryMs = RETRY_MS.first;
      this.#changeState('open');
    };
    source.onerror = () => this.#handleError();
    for (const name of EVENT_NAMES) source.addEventListener(name, event => this.#pass(name, JSON.parse(event.data)));
    source.addEventListener('missed', () => this.#pass('resync')); // Too slow: the service dropped events.
  }

  #handleError() {
    this.#changeState('broken');
    if (this.#source?.readyState !== EventSource.CLOSED) return; // The browser is already reconnecting.
    clearTimeout(this.#retryTimer);
    this.#retryTimer = setTimeout(() => this.#connect(), this.#retryMs);
    this.#retryMs = Math.min(this.#retryMs * 2, RETRY_MS.max);
  }

  #pass(name, detail = null) {
    if (name === 'queue') this.#lastQueue = detail;
    this.#tell({ event: { name, detail } });
    this.#onEvent(name, detail);
  }

  #changeState(state) {
    this.state = state;
    if (this.#source) this.#tell({ state });
    this.#onState(state);
  }
}
