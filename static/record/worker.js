// Records outside the page, so that neither a busy page nor a hidden tab delays it: frames in, a feed out.
//
// The page posts `{ begin }` with what is recorded, then `{ frame, timestamp }` where it captures frames itself, `{
// stop }`, `{ retry }`. The worker posts its status as `{ type: 'standing', … }`, and once the reason if recording
// stopped by itself.
import { H264Encoder, JpegEncoder } from './encoder.js';
import { Feed } from './feed.js';
import { TICKS_PER_S } from './records.js';
import { Spool } from './spool.js';

const STATUS_MS = 250;
const KEY_EVERY_TICKS = TICKS_PER_S;
/** The limits of one recording. */
const LIMITS = { frames: 1_000_000, ticks: 4 * 3600 * TICKS_PER_S };
/** The frame rate is counted over this many seconds. */
const RATE_S = 3;

const spool = new Spool();
let config = null;
let encoder = null;
let feed = null;
let reader = null;
let isStopped = false;
/**
 * The first frame's timestamp, µs; the times of the last frame and of the last key frame, ticks.
 *
 * @type {{ began: any, last: number, key: number, recent: any[] }}
 */
const times = { began: null, last: -1, key: -Infinity, recent: [] };
let skipped = 0; // Frames that the encoder had no time for.
let isTurned = false; // The camera gives another size, as it does when a tablet is rotated.

onmessage = ({ data }) => {
  if (data.begin) begin(data.begin);
  if (data.frame) handleFrame(data.frame, data.timestamp);
  if (data.stop) stop();
  if (data.retry) feed?.retry();
};
// The browser may notice that the network is back before the next attempt.
addEventListener('online', () => feed?.retry());

/**
 * `{ address, hello, h264, readable?, track? }`: the feed's address and first message, the encoder, and the source of
 * frames.
 */
function begin(message) {
  config = message;
  const { track } = config;
  const readable = config.readable ?? (track && new MediaStreamTrackProcessor({ track }).readable);
  if (readable) read(readable);
  setInterval(postStatus, STATUS_MS);
}

async function read(readable) {
  reader = readable.getReader();
  for (;;) {
    const { done, value: frame } = await reader.read();
    if (done) return stop('camera');
    handleFrame(frame, frame.timestamp);
  }
}

/**
 * Creates the encoder for frames like the first one: a camera's settings may differ from them. Tablets give frames with
 * a rotation, which would be lost in H.264.
 */
function createEncoder(frame, timestamp) {
  times.began = timestamp;
  const h264 = frame.rotation ? null : config.h264 && { ...config.h264, ...sizeOf(frame) };
  Object.assign(config.hello, sizeOf(frame), { codec: h264 ? 'h264' : 'jpeg' });
  const Encoder = h264 ? H264Encoder : JpegEncoder;
  encoder = new Encoder(h264 ?? sizeOf(frame), storeFrame, () => stop('encoder'));
}

const sizeOf = ({ displayWidth, displayHeight, width, height }) => ({
  width: displayWidth ?? width,
  height: displayHeight ?? height,
});

function handleFrame(frame, timestamp) {
  if (!encoder && !isStopped) createEncoder(frame, timestamp);
  const time = ticksOf(timestamp);
  const { width, height } = sizeOf(frame);
  isTurned = width !== config.hello.width || height !== config.hello.height;
  const isLate = time <= times.last; // Two frames of the same moment cannot be distinguished.
  if (isStopped || isTurned || isLate) return frame.close();
  if (encoder.isFull) {
    skipped++;
    return frame.close();
  }
  if (time > LIMITS.ticks || spool.end >= LIMITS.frames) {
    frame.close();
    return stop('length');
  }
  times.last = time;
  const wantsKey = time - times.key >= KEY_EVERY_TICKS;
  if (wantsKey) times.key = time;
  encoder.encode(frame, timestamp, wantsKey);
}

const ticksOf = timestamp => Math.round(((timestamp - times.began) * TICKS_PER_S) / 1e6);

function storeFrame({ timestamp, isKey, payload }) {
  const time = ticksOf(timestamp);
  spool.push({ time, isKey, payload });
  times.recent.push(time);
  while (times.recent[0] < time - RATE_S * TICKS_PER_S) times.recent.shift();
  feed ??= new Feed({ address: config.address, hello: config.hello, spool, onChange: postStatus });
  feed.pump();
}

/** `why` is given if recording stops by itself: `camera` (no more frames), `encoder`, `length`. */
async function stop(why = /** @type {string | null} */ (null)) {
  if (isStopped) return;
  isStopped = true;
  if (why) postMessage({ type: 'stopped', why });
  reader?.cancel().catch(() => {}); // It may have ended already.
  await encoder?.end();
  if (feed) feed.finish();
  else postMessage({ type: 'nothing' });
  postStatus();
}

function postStatus() {
  const { recent } = times;
  const span = (recent.at(-1) - recent[0]) / TICKS_PER_S;
  postMessage({
    type: 'standing',
    connection: feed?.connection ?? 'connecting',
    code: feed?.code ?? null,
    session: feed?.session ?? null,
    isStopped,
    frames: spool.end,
    seconds: spool.newest / TICKS_PER_S,
    picture: encoder && { width: config.hello.width, height: config.hello.height },
    codec: encoder && config.hello.codec,
    rate: span >= 1 ? (recent.length - 1) / span : null,
    kept: { frames: spool.count, seconds: spool.seconds, bytes: spool.bytes },
    lostSeconds: spool.lostTicks / TICKS_PER_S,
    skipped,
    isTurned,
  });
}
