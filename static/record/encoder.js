// Frames of a camera as bytes for a feed. Both encoders take `encode(frame, timestamp, wantsKey)`, close the frame, and
// call `onFrame({ timestamp, isKey, payload })` in order; while `isFull` says so, a frame is better left out than queued.
import { MOST_PAYLOAD } from './records.js';

const MOST_QUEUED = 4;
const JPEG_QUALITIES = [0.9, 0.7, 0.5]; // The next one where a frame is too large for a record.
/** An encoder that is taken away, as devices do with hidden tabs, is made anew; one that never works is given up. */
const MOST_FAILURES = 3;
const SEQUENCE_PARAMETERS = 7;

export class H264Encoder {
  #config;
  #onFrame;
  #onFault;
  #encoder;
  #failures = 0;
  #needsKey = true;
  #parameters = new Uint8Array();

  constructor(config, onFrame, onFault) {
    [this.#config, this.#onFrame, this.#onFault] = [config, onFrame, onFault];
    this.#make();
  }

  get isFull() {
    return this.#encoder.encodeQueueSize >= MOST_QUEUED;
  }

  encode(frame, _, wantsKey) {
    if (this.#encoder.state === 'configured') {
      this.#encoder.encode(frame, { keyFrame: wantsKey || this.#needsKey });
      this.#needsKey = false;
    }
    frame.close();
  }

  /** Resolves when every frame has come out. */
  async end() {
    await this.#encoder.flush().catch(() => {}); // What an encoder that fails now still held is lost.
    if (this.#encoder.state !== 'closed') this.#encoder.close();
  }

  #make() {
    this.#needsKey = true;
    this.#encoder = new VideoEncoder({ output: chunk => this.#take(chunk), error: error => this.#failed(error) });
    this.#encoder.configure(this.#config);
  }

  #take(chunk) {
    this.#failures = 0;
    const bytes = new Uint8Array(chunk.byteLength);
    chunk.copyTo(bytes);
    const isKey = chunk.type === 'key';
    this.#onFrame({ timestamp: chunk.timestamp, isKey, payload: isKey ? this.#withParameters(bytes) : bytes });
  }

  /** Every key frame of a feed bears its parameter sets; some encoders give them once. */
  #withParameters(bytes) {
    const units = startsOfUnits(bytes);
    const firstSlice = units.find(at => [1, 5].includes(bytes[at] & 31));
    if (units.some(at => (bytes[at] & 31) === SEQUENCE_PARAMETERS)) {
      this.#parameters = bytes.slice(0, firstSlice - 3); // A zero more before it is as good.
      return bytes;
    }
    const whole = new Uint8Array(this.#parameters.length + bytes.length);
    whole.set(this.#parameters);
    whole.set(bytes, this.#parameters.length);
    return whole;
  }

  #failed(error) {
    if (++this.#failures >= MOST_FAILURES) return this.#onFault(error);
    this.#make();
  }
}

/** Where the units of Annex B begin, behind their start codes; slices are the last, so looking ends with the first. */
function startsOfUnits(bytes) {
  const starts = [];
  for (let i = 0; i + 3 < bytes.length; i++) {
    if (bytes[i] !== 0 || bytes[i + 1] !== 0 || bytes[i + 2] !== 1) continue;
    starts.push(i + 3);
    if ([1, 5].includes(bytes[i + 3] & 31)) break;
  }
  return starts;
}

export class JpegEncoder {
  #onFrame;
  #onFault;
  #canvas;
  #pen;
  #queued = 0;
  #last = Promise.resolve();

  constructor({ width, height }, onFrame, onFault) {
    [this.#onFrame, this.#onFault] = [onFrame, onFault];
    this.#canvas = new OffscreenCanvas(width, height);
    this.#pen = this.#canvas.getContext('2d', { alpha: false, willReadFrequently: true });
  }

  get isFull() {
    return this.#queued >= MOST_QUEUED;
  }

  encode(frame, timestamp) {
    this.#queued++;
    this.#last = this.#last
      .then(() => this.#draw(frame, timestamp))
      .catch(error => this.#onFault(error))
      .finally(() => this.#queued--);
  }

  end() {
    return this.#last;
  }

  async #draw(frame, timestamp) {
    this.#pen.drawImage(frame, 0, 0, this.#canvas.width, this.#canvas.height);
    frame.close();
    for (const quality of JPEG_QUALITIES) {
      const jpeg = await this.#canvas.convertToBlob({ type: 'image/jpeg', quality });
      if (jpeg.size > MOST_PAYLOAD) continue;
      return this.#onFrame({ timestamp, isKey: true, payload: new Uint8Array(await jpeg.arrayBuffer()) });
    }
  }
}
