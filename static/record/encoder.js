// Encode the frames of a camera for a feed. Both encoders take `encode(frame, timestamp, wantsKey)`, close the frame,
// and call `onFrame({ timestamp, isKey, payload })` in order. While `isFull`, frames should be skipped instead of
// queued.
import { MAX_PAYLOAD } from './records.js';

const MAX_QUEUED = 4;
const JPEG_QUALITIES = [0.9, 0.7, 0.5]; // The next lower one if a frame is too large for a record.
/**
 * An encoder that is taken away, as devices do with hidden tabs, is created again; one that never works is given up.
 */
const MAX_FAILURES = 3;
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
    this.#createEncoder();
  }

  get isFull() {
    return this.#encoder.encodeQueueSize >= MAX_QUEUED;
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
    await this.#encoder.flush().catch(() => {}); // If the encoder fails now, the frames that it still holds are lost.
    if (this.#encoder.state !== 'closed') this.#encoder.close();
  }

  #createEncoder() {
    this.#needsKey = true;
    this.#encoder = new VideoEncoder({ output: chunk => this.#handleChunk(chunk), error: error => this.#handleError(error) });
    this.#encoder.configure(this.#config);
  }

  #handleChunk(chunk) {
    this.#failures = 0;
    const bytes = new Uint8Array(chunk.byteLength);
    chunk.copyTo(bytes);
    const isKey = chunk.type === 'key';
    this.#onFrame({ timestamp: chunk.timestamp, isKey, payload: isKey ? this.#withParameters(bytes) : bytes });
  }

  /** Every key frame of a feed contains its parameter sets; some encoders emit them only once. */
  #withParameters(bytes) {
    const units = unitOffsets(bytes);
    const firstSlice = units.find(at => [1, 5].includes(bytes[at] & 31));
    if (units.some(at => (bytes[at] & 31) === SEQUENCE_PARAMETERS)) {
      this.#parameters = bytes.slice(0, Number(firstSlice) - 3); // One more zero before it does no harm.
      return bytes;
    }
    const whole = new Uint8Array(this.#parameters.length + bytes.length);
    whole.set(this.#parameters);
    whole.set(bytes, this.#parameters.length);
    return whole;
  }

  #handleError(error) {
    if (++this.#failures >= MAX_FAILURES) return this.#onFault(error);
    this.#createEncoder();
  }
}

/** The offsets of the Annex B units, after their start codes. Slices come last, so the search ends at the first one. */
function unitOffsets(bytes) {
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
  /** @type {OffscreenCanvasRenderingContext2D} */
  #pen;
  #queued = 0;
  #last = Promise.resolve();

  constructor({ width, height }, onFrame, onFault) {
    [this.#onFrame, this.#onFault] = [onFrame, onFault];
    this.#canvas = new OffscreenCanvas(width, height);
    const pen = this.#canvas.getContext('2d', { alpha: false, willReadFrequently: true });
    this.#pen = /** @type {OffscreenCanvasRenderingContext2D} */ (pen);
  }

  get isFull() {
    return this.#queued >= MAX_QUEUED;
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
      if (jpeg.size > MAX_PAYLOAD) continue;
      return this.#onFrame({ timestamp, isKey: true, payload: new Uint8Array(await jpeg.arrayBuffer()) });
    }
  }
}
