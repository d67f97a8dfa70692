// Recording away from the page, so that neither a busy page nor a hidden tab holds it up: frames in, a feed out.
//
// The page says `{ begin }` with what is recorded, then `{ frame, timestamp }` where it captures them itself, `{ stop }`,
// `{ retry }`. It is told how things stand by `{ type: 'standing', … }`, and once why recording stopped by itself.
import { H264Encoder, JpegEncoder } from './encoder.js';
import { Feed } from './feed.js';
import { TICKS_PER_S } from './records.js';
import { Spool } from './spool.js';

const TELL_MS = 250;
const KEY_EVERY_TICKS = TICKS_PER_S;
/** What a recording may be at most. */
const MOST = { frames: 1_000_000, ticks: 4 * 3600 * TICKS_PER_S };
/** Over so many seconds the frames are counted that make the rate. */
const RATE_S = 3;

const spool = new Spool();
let begun = null;
let encoder = null;
let feed = null;
let reader = null;
let isStopped = false;
/** Of frames: the first one's timestamp, µs; the last one's time and that of the last key frame, ticks. */
const times = { began: null, last: -1, key: -Infinity, recent: [] };
let skipped = 0; // Frames that the encoder had no time for.
let isTurned = false; // The camera gives another size, as it does when a tablet is turned.

onmessage = ({ data }) => {
  if (data.begin) begin(data.begin);
  if (data.frame) take(data.frame, data.timestamp);
  if (data.stop) stop();
  if (data.retry) feed?.retry();
};
// A browser that notices that the network is back knows it sooner than the next attempt.
addEventListener('online', () => feed?.retry());

/** `{ address, hello, h264, readable?, track? }`: where to, which words, how to encode, and where frames come from. */
function begin(wanted) {
  begun = wanted;
  const { track } = begun;
  const readable = begun.readable ?? (track && new MediaStreamTrackProcessor({ track }).readable);
  if (readable) read(readable);
  setInterval(tell, TELL_MS);
}

async function read(readable) {
  reader = readable.getReader();
  for (;;) {
    const { done, value: frame } = await reader.read();
    if (done) return stop('camera');
    take(frame, frame.timestamp);
  }
}

/**
 * The first frame tells what they are like; a camera's settings may not. Tablets give frames that are to be turned before
 * they are shown, which is lost in H.264.
 */
function meet(frame, timestamp) {
  times.began = timestamp;
  const h264 = frame.rotation ? null : begun.h264 && { ...begun.h264, ...sizeOf(frame) };
  Object.assign(begun.hello, sizeOf(frame), { codec: h264 ? 'h264' : 'jpeg' });
  const Encoder = h264 ? H264Encoder : JpegEncoder;
  encoder = new Encoder(h264 ?? sizeOf(frame), keep, () => stop('encoder'));
}

const sizeOf = ({ displayWidth, displayHeight, width, height }) => ({
  width: displayWidth ?? width,
  height: displayHeight ?? height,
});

function take(frame, timestamp) {
  if (!encoder && !isStopped) meet(frame, timestamp);
  const time = ticksOf(timestamp);
  const { width, height } = sizeOf(frame);
  isTurned = width !== begun.hello.width || height !== begun.hello.height;
  const isLate = time <= times.last; // Two frames of the same moment cannot be told apart.
  if (isStopped || isTurned || isLate) return frame.close();
  if (encoder.isFull) {
    skipped++;
    return frame.close();
  }
  if (time > MOST.ticks || spool.end >= MOST.frames) {
    frame.close();
    return stop('length');
  }
  times.last = time;
  const wantsKey = time - times.key >= KEY_EVERY_TICKS;
  if (wantsKey) times.key = time;
  encoder.encode(frame, timestamp, wantsKey);
}

const ticksOf = timestamp => Math.round(((timestamp - times.began) * TICKS_PER_S) / 1e6);

function keep({ timestamp, isKey, payload }) {
  const time = ticksOf(timestamp);
  spool.push({ time, isKey, payload });
  times.recent.push(time);
  while (times.recent[0] < time - RATE_S * TICKS_PER_S) times.recent.shift();
  feed ??= new Feed({ address: begun.address, hello: begun.hello, spool, onChange: tell });
  feed.pump();
}

/** `why` is told where nobody asked for it: `camera` (it gives nothing any more), `encoder`, `length`. */
async function stop(why = null) {
  if (isStopped) return;
  isStopped = true;
  if (why) postMessage({ type: 'stopped', why });
  reader?.cancel().catch(() => {}); // It has ended by itself already.
  await encoder?.end();
  if (feed) feed.finish();
  else postMessage({ type: 'nothing' });
  tell();
}

function tell() {
  const { recent } = times;
  const span = (recent.at(-1) - recent[0]) / TICKS_PER_S;
  postMessage({
    type: 'standing',
    line: feed?.line ?? 'connecting',
    code: feed?.code ?? null,
    session: feed?.session ?? null,
    isStopped,
    frames: spool.end,
    seconds: spool.newest / TICKS_PER_S,
    picture: encoder && { width: begun.hello.width, height: begun.hello.height },
    codec: encoder && begun.hello.codec,
    rate: span >= 1 ? (recent.length - 1) / span : null,
    kept: { frames: spool.count, seconds: spool.seconds, bytes: spool.bytes },
    lostSeconds: spool.lostTicks / TICKS_PER_S,
    skipped,
    isTurned,
  });
}
